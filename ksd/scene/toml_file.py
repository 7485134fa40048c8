"""Scenes in TOML files, in the words of the Python scene; all keys stand in `ksd.scene.toml_schema`.

    name = "lever"
    links = ["lever"]
    plane = "xy"
    consider = ["warping", "plate"]
    [material.steel]   E = "200 GPa", G = "76.9 GPa", density = 7800, yield_stress = "1 GPa"
    [section.blade]    kind = "rectangle", thickness = "1 mm", width = "40 mm"
    [joint.cross]      family = "cross_flexure", material = "steel", length = "100 mm", angle = "45 deg", ...
    [[join]]           a = "ground", b = "lever", joint = "cross", at = [0, 0, 0], axis = "z", toward = "x"
    [[leaf]]           a, b, start, end, width_axis, section (or thickness and width), material
    [leaf.curve]       behind it: kind = "arc", radius, angle; or "sine", "legendre", "spline";  [leaf.profile]  likewise
    [[point]]          leaf, s = "30 mm", name
    [[pin]]            a, b, at (and axis, where there is no plane);  [[slider]]  link, along, at
    [[actuate]]        link, about = "z", value = "30 deg"; or along and at; or joint; or terms = [{...}, ...]
    [[distance]]       a, b, start, end, name (and along, a direction): asked for, such as the opening of a jaw
    [[compliance]]     link, section and material (hub, width_axis); or matrix = "file.npz" or "file.h5"
    [options]          what the solver is asked, e.g. method = "reduced"

Numbers are SI, or text with a unit ("100 mm", "45 deg", "3 N mm", "9.81 m/s^2"); files are read as UTF-8. All mistakes of a
file are told at once.
"""

from __future__ import annotations

import os
import tomllib
import warnings
from collections.abc import Callable, Collection
from functools import partial
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, TypeVar

from ksd import section
from ksd.checks import name_hint, show, similar_name_hint
from ksd.errors import SceneError, SceneFileError, SceneWarning, UnknownNameError
from ksd.files import named_file, read_file
from ksd.scene import toml_schema as schema
from ksd.scene.drive import Drive, DriveTerm
from ksd.scene.effects import LinkMatrix
from ksd.scene.families import joint_families, make_joint
from ksd.scene.joint import DrawnJoint, Joint, Motion
from ksd.scene.leaf import Leaf
from ksd.scene.leaf import wire as make_wire
from ksd.scene.material import Material
from ksd.scene.mechanism import Mechanism
from ksd.scene.rules import broken_rules
from ksd.scene.toml_lines import LineNumbers
from ksd.scene.toml_schema import SHAPE_CLASSES
from ksd.scene.toml_table import ANY_NAME, FileMistakes, InvalidTable, Table, make_each
from ksd.scene.toml_writer import save_scene
from ksd.section import Section, rectangle

__all__ = ["load_scene", "save_scene"]

T = TypeVar("T")
MAX_LISTED_MISTAKES = 30
"""Mistakes that are listed."""
MAX_FILE_BYTES = 1 << 22
"""Bytes of a scene file that is read, 4 MiB."""
Loaded = tuple[Mechanism, dict[str, float], dict[str, Any]]


def load_scene(path: str | os.PathLike[str], *, option_names: Collection[str] | None = None) -> Loaded:
    """Read a scene file: (mechanism, targets {drive: value in SI}, options as written).

    option_names: the keys allowed in [options]; any when None. Raises SceneError for a file that cannot be read or is no
    TOML, SceneFileError, a sentence with file, line, table and key per mistake, for one that misses a key, has an unknown
    one, or holds a wrong type, unit or value. Warns (SceneWarning) once of plain numbers that were probably meant in another
    unit.
    """
    file = named_file(path, "scene file")
    text = _read_text(file)
    return scene_from_tables(_parse_toml(text, file.name), file, option_names=option_names, text=text)


def scene_from_tables(
    tables: dict[str, Any], file: Path, *, option_names: Collection[str] | None = None, text: str = ""
) -> Loaded:
    """The same from the tables of a file, as read or changed; file: whose name errors tell, whose folder holds others; text:
    of the file as it was read, in which errors tell the line."""
    noted = FileMistakes()
    top = Table(tables, file.name, noted=noted)
    options = _read_options(top, option_names)
    reader = _SceneReader(top, file)
    reader.say_all()
    if not noted.mistakes:
        noted.mistakes += [
            f"{reader.place_of(rule)}: {rule}" for rule in broken_rules(reader.mechanism.draft())
        ]
    lines = LineNumbers(file.name, text)
    mistakes = [lines.at(said) for said in noted.mistakes]
    # what was refused tells its own
    doubts = [
        lines.at(f"{where}: {said}") for where, said in noted.doubts if not any(said in m for m in mistakes)
    ]
    if mistakes:
        raise SceneFileError(_mistake_list(file.name, mistakes, doubts), mistakes=tuple(mistakes))
    if doubts:
        more = f" So for {len(doubts) - 1} more." if len(doubts) > 1 else ""
        warnings.warn(f"{doubts[0]} Plain numbers are in SI.{more}", SceneWarning, stacklevel=3)
    return reader.mechanism, reader.targets, options


def _mistake_list(name: str, mistakes: list[str], doubts: list[str]) -> str:
    """The sentence of one mistake, or a list of several, with the first plain number that was probably meant otherwise."""
    lines = [said.removeprefix(name).lstrip(",: ") for said in (*mistakes[:MAX_LISTED_MISTAKES], *doubts[:1])]
    if len(mistakes) == 1:
        return "\n  ".join([mistakes[0], *lines[1:]])
    if len(mistakes) > MAX_LISTED_MISTAKES:
        lines.insert(MAX_LISTED_MISTAKES, f"and {len(mistakes) - MAX_LISTED_MISTAKES} more.")
    return "\n  ".join([f"{name} has {len(mistakes)} mistakes:", *lines])


def read_tables(file: Path) -> dict[str, Any]:
    """The tables of a TOML file as they are written. Raises SceneError for a file that cannot be read or is no TOML."""
    return _parse_toml(_read_text(file), file.name)


def shipped_scenes() -> dict[str, Traversable]:
    """The scene and job files that come with the package, by name."""
    return {Path(f.name).stem: f for f in (files("ksd") / "scenes").iterdir() if f.name.endswith(".toml")}


def _read_text(file: Path) -> str:
    ships = file.stem in shipped_scenes() and not os.path.lexists(file)
    meant = (
        f"check the path; `ksd new NAME --like {file.stem}` writes the scene of that name" if ships else ""
    )
    content = read_file(file, what="scene file", most=MAX_FILE_BYTES, hint=meant or "check the path")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SceneError(
            f"{file.name}: byte {error.start + 1} is not UTF-8 text; save the file as UTF-8."
        ) from None


def _parse_toml(text: str, name: str) -> dict[str, Any]:
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise SceneError(f"{name}: brackets are nested too deeply.") from None
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{name} is not valid TOML: {error}.") from None
    except ValueError:
        raise SceneError(f"{name} is not valid TOML: it holds a number of thousands of digits.") from None


_NAME_KINDS = {
    "join": ("joint",),
    "constrain": ("leaf", "link"),
    "leaf": ("leaf",),
    "wire": ("leaf",),
    "point": ("link",),
}
"""What kinds of names a sentence brings into a mechanism."""
_NAMES_IN_RULES = {"join": "joint", "wire": "leaf", "actuate": "drive"}
"""What mistakes call that of a sentence, where not by its name."""


class _SceneReader:
    """Materials, sections and joints a scene file defines, by name, and what it says with them about a mechanism.

    A mistake hides what its table would have named; sentences that speak of it have no mistake of their own. lost: such
    names by kind (joint, leaf, link).
    """

    def __init__(self, top: Table, file: Path) -> None:
        self.folder = file.parent
        self.file, self.places = file.name, dict[str, str]()
        self.targets: dict[str, float] = {}
        self.mechanism, self.planned = Mechanism("scene"), False
        self.lost: dict[str, set[str]] = {"joint": set(), "leaf": set(), "link": set()}
        said = {"name": file.stem, "plane": None, "gravity": None, "consider": []} | top.read(schema.TOP)
        defined = {kind: top.table(kind) for kind in ("material", "section", "joint")}
        self.sentences = {name: top.tables(name) for name in schema.SENTENCES}
        misspelt = [key for key in top.unknown() if isinstance(top.values[key], dict | list)]
        top.finish()
        if misspelt:
            self.lost = {kind: {ANY_NAME} for kind in self.lost}
        self._begin(top, said)
        self.parts: dict[str, dict[str, Any]] = {kind: {} for kind in defined}
        for kind, make in (("material", _make_material), ("section", _make_section), ("joint", self._joint)):
            # [materials.steel] is one mistake, not one more for each leaf that is of steel
            if (
                any(f'"{kind}"' in similar_name_hint(key, defined) for key in misspelt)
                or not defined[kind].sound
            ):
                self.parts[kind][ANY_NAME] = None
            self.parts[kind] |= {n: _make_part(make, t, n) for n, t in defined[kind].children().items()}

    def _begin(self, top: Table, said: dict[str, Any]) -> None:
        """What stands above all tables."""
        with top.judged():
            self.mechanism, self.planned = Mechanism(said["name"], plane=said["plane"]), True
        with top.judged():
            self.mechanism.gravity = said["gravity"]
        for name in said.get("links", ()):
            with top.judged():
                self.mechanism.link(name)
        for effect in said["consider"]:
            with top.judged():
                self.mechanism.consider(effect)
        if "links" not in said:
            self.lost["link"] = {ANY_NAME}

    def say_all(self) -> None:
        """All tables, in the order of `schema.SENTENCES`."""
        for sentence, tables in self.sentences.items():
            for table in tables:
                try:
                    self._say(sentence, table)
                except InvalidTable:
                    name = table.values.get("name")
                    for kind in _NAME_KINDS.get(sentence, ()):
                        self.lost[kind].add(name if isinstance(name, str) else ANY_NAME)

    def place_of(self, rule: str) -> str:
        """File and table of what a broken rule begins with."""
        return next((where for own, where in self.places.items() if rule.startswith(own)), self.file)

    def _heard(self, sentence: Callable[..., T]) -> Callable[..., T]:
        """A sentence of the mechanism; Unsaid where it speaks of what only a mistake elsewhere keeps from being there."""

        def said(**words: Any) -> T:
            if not self.planned:
                raise InvalidTable("without its plane nothing can be said of a mechanism")
            try:
                return sentence(**words)
            except UnknownNameError as error:
                if {ANY_NAME, error.name, error.name.partition("/")[0]} & self.lost[error.kind]:
                    raise InvalidTable(str(error)) from None
                raise

        return said

    def _say(self, sentence: str, table: Table) -> None:
        """One table of `schema.SENTENCES`, said to the mechanism."""
        words = table.read(schema.SENTENCES[sentence], self.parts)
        for key in schema.LINK_KEYS:
            with table.judged():
                if key in words:
                    self._heard(self.mechanism._checked_link)(link=words[key], owner=key)
        if sentence == "actuate":
            self._actuate(table, words)
            return
        if sentence == "support":
            words |= self._terms(table)
        elif sentence in ("leaf", "wire"):
            words |= self._sizes(table, sentence) | _read_shapes(table)
        elif sentence == "compliance":
            words = self._with_matrix(table, words)
        made = table.say(self._heard(getattr(self.mechanism, sentence)), words)
        self.places[f"{_NAMES_IN_RULES.get(sentence, sentence)} '{getattr(made, 'name', '')}'"] = table.where

    def _sizes(self, table: Table, kind: str) -> dict[str, Any]:
        """The diameter of a wire, or the section of a leaf, by name or from thickness and width."""
        if kind == "leaf" and "section" not in table and ("thickness" in table or "width" in table):
            sizes = table.read(schema.SIZES["rectangle"])
            with table.judged():
                return {"section": rectangle(**sizes)} if len(sizes) == len(schema.SIZES["rectangle"]) else {}
            return {}
        return table.read(schema.SIZES[kind], self.parts)

    def _with_matrix(self, table: Table, words: dict[str, Any]) -> dict[str, Any]:
        """The words of a compliance, its matrix from a file or from points and stiffness."""
        points, stiffness = words.pop("points", None), words.pop("stiffness", None)
        if "matrix" in words:
            words["matrix"] = self.folder / words["matrix"]
        elif points is not None or stiffness is not None:
            with table.judged():
                words["matrix"] = LinkMatrix(points or (), stiffness or ())  # type: ignore[arg-type]
        return words

    def _actuate(self, table: Table, words: dict[str, Any]) -> None:
        """A drive, and its value in the unit of its motion."""
        words |= self._terms(table)
        dimension = "length" if "along" in words else "angle" if "about" in words else "any"
        value = table.read({"value": dimension})
        drive: Drive = table.say(self._heard(self.mechanism.actuate), words)
        if dimension == "any":
            value = table.read({"value": drive.dimension})
        if value:
            self.targets[drive.name] = value["value"]
        self.places[f"drive '{drive.name}'"] = table.where

    def _terms(self, table: Table) -> dict[str, list[DriveTerm]]:
        terms = make_each(self._term, table.tables("terms"))
        return {"terms": terms} if "terms" in table else {}

    def _term(self, table: Table) -> DriveTerm:
        words = table.read(schema.TERM)

        def said(**words: Any) -> DriveTerm:
            if ("along" in words) == ("about" in words):
                raise SceneError("give one of along (a displacement) and about (a rotation).")
            if "along" in words:
                return self.mechanism.displacement(**{"at": None} | words)
            return self.mechanism.rotation(**words)

        return table.say(self._heard(said), words)

    def _joint(self, table: Table, name: str) -> Joint:
        families = joint_families()
        family = _read_kind(table, "family", [*families, "drawn"], "joint family")
        if family == "drawn":
            return self._drawn(table)
        words = table.read(schema.family_schema(families[family]), self.parts)
        return table.say(partial(make_joint, family), words)

    def _drawn(self, table: Table) -> DrawnJoint:
        """A joint drawn leaf by leaf."""
        blocks, shape = table.table("blocks"), table.table("shape")
        words: dict[str, Any] = {"name": "drawn"} | table.read(schema.DRAWN)
        words["blocks"] = blocks.read(dict.fromkeys(blocks.values, "length[3]"))
        words["shape"] = shape.read(dict.fromkeys(shape.values, "number"))
        hung = [(t, kind) for kind in ("leaf", "wire") for t in table.tables(kind)]
        motions = table.tables("motion")
        with table.judged():
            words["leaves"] = make_each(self._drawn_leaf, hung)
        with table.judged():
            words["motions"] = make_each(_make_motion, motions)
        table.sound &= blocks.sound and shape.sound
        return table.say(DrawnJoint, words)

    def _drawn_leaf(self, hung: tuple[Table, str]) -> Leaf:
        table, kind = hung
        words = {"name": kind, "width_axis": None} | table.read(schema.LEAF, self.parts)
        words |= self._sizes(table, kind) | _read_shapes(table) | table.read(schema.BLOCKS)
        return table.say(make_wire if kind == "wire" else Leaf, words)


def _make_part(make: Callable[[Table, str], T], table: Table, name: str) -> T | None:
    """A part of the file; None where it has a mistake."""
    try:
        return make(table, name)
    except InvalidTable:
        return None


def _read_kind(table: Table, key: str, known: Collection[str], what: str) -> str:
    """The word that says what else a table holds. Raises Unsaid."""
    found = table.read({key: "text!"}, known=known).get(key, "")
    if table.sound and found not in known:
        table.note(f"{table.where}: {what} {show(found)} is unknown{name_hint(found, known)}")
    if not table.sound:
        raise InvalidTable(f"{table.where}: what it is, is not known")
    return str(found)


def _read_shapes(table: Table) -> dict[str, Any]:
    """The curve and the profile of a leaf, where it has them."""
    found = {}
    for key in [key for key in schema.SHAPES if key in table]:
        own = table.table(key)
        with table.judged():
            kind = _read_kind(own, "kind", schema.SHAPES[key], key)
            found[key] = own.say(SHAPE_CLASSES[key][kind][1], own.read(schema.SHAPES[key][kind]))
    return found


def _make_material(table: Table, name: str) -> Material:
    return table.say(Material, {"name": name} | table.read(schema.MATERIAL))


def _make_section(table: Table, name: str) -> Section:
    kind = _read_kind(table, "kind", schema.SECTIONS, "section kind")
    made: Section = table.say(getattr(section, kind), table.read(schema.SECTIONS[kind]))
    return made


def _make_motion(table: Table) -> Motion:
    kind = table.read({"kind": "text!"}).get("kind")
    return table.say(Motion, table.read(schema.MOTIONS.get(str(kind), schema.MOTIONS["rotation"])))


def _read_options(top: Table, names: Collection[str] | None) -> dict[str, Any]:
    table = top.table("options")
    options = table.read(dict.fromkeys(table.values if names is None else names, "any"))
    table.finish()
    return options
