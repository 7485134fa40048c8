"""Reading of scenes from TOML files, with the words of `Mechanism`; all keys are in `ksd.scene.toml_schema`.

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
    [[ball]]           a, b, at;  [[cylindrical]]  a, b, at, axis
    [[actuate]]        link, about = "z", value = "30 deg"; or along and at; or joint; or terms = [{...}, ...]
    [[stop]]           as [[actuate]], with low = "-2 mm", high = "3 mm" instead of value
    [[cable]]          a, b, start, end, via = [{link, at}, ...], length, stiffness
    [[surface]]        link, shape = "disc", radius, at;  [[contact]]  a, b (surfaces), friction
    [[distance]]       a, b, start, end, name (and along, turns_with): to be reported, such as the opening of a jaw
    [[compliance]]     link, section and material (hub, width_axis); or matrix = "file.npz" or "file.h5"
    [simulate]         words of `ksd.simulate`: until = "1 s", accuracy;  [simulate.drives.push]  cycloid = "5 mm", duration
    [report]           link = "table", at, along, freed = ["push"]: what `ksd sweep` and `ksd report` ask about
    [options]          options of the solver, e.g. method = "reduced"

Numbers are SI, or text with a unit ("100 mm", "45 deg", "3 N mm", "9.81 m/s^2"); files are read as UTF-8. All mistakes of a
file are reported together.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Callable, Collection
from contextlib import suppress
from functools import partial
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any, TypeVar

from ksd import section
from ksd.checks import name_hint, show, similar_name_hint, warn_user
from ksd.errors import SceneError, SceneFileError, SceneWarning, UnknownNameError
from ksd.files import named_file, read_file
from ksd.scene import shapes
from ksd.scene import toml_schema as schema
from ksd.scene.drive import Drive, DriveTerm, dimension_of
from ksd.scene.effects import LinkMatrix
from ksd.scene.families import joint_families, make_joint
from ksd.scene.joint import DrawnJoint, Joint, Motion
from ksd.scene.leaf import Leaf
from ksd.scene.leaf import wire as make_wire
from ksd.scene.material import Material
from ksd.scene.mechanism import Mechanism
from ksd.scene.other_files import HEAD_BYTES, other_format
from ksd.scene.rules import broken_rules
from ksd.scene.scene import joint_rotation
from ksd.scene.simulation import simulation_of_table
from ksd.scene.toml_lines import LineNumbers
from ksd.scene.toml_schema import SHAPE_CLASSES
from ksd.scene.toml_table import ANY_NAME, FileMistakes, InvalidTable, Table, make_each
from ksd.scene.toml_writer import save_scene
from ksd.section import Section, rectangle

__all__ = ["load_scene", "save_scene"]

T = TypeVar("T")
MAX_LISTED_MISTAKES = 30
"""Limit of the number of mistakes in one message."""
MAX_FILE_BYTES = 1 << 22
"""Largest scene file that is read [bytes], 4 MiB."""
LoadedScene = tuple[Mechanism, dict[str, float], dict[str, Any]]


def load_scene(path: str | os.PathLike[str], *, option_names: Collection[str] | None = None) -> LoadedScene:
    """Read the scene file `path`: (mechanism, targets {drive: value in SI}, options as written).

    path: of the file, or the name alone of a shipped scene ("guide"), where no file has it. option_names: the keys allowed
    in [options]; any when None. Raises SceneError for a file that cannot be read or is no TOML, and SceneFileError, with
    file, line, table and key of every mistake, for missing and unknown keys and wrong types, units or values. Warns once
    (SceneWarning) about plain numbers that are probably in another unit.

    >>> guide, stroke, options = ksd.load_scene("guide")
    >>> guide.name, stroke, options
    ('guide', {'table': 0.005}, {})
    """
    file = named_file(path, "scene file")
    text = _read_text(file)
    return scene_from_tables(_parse_toml(text, file.name), file, option_names=option_names, text=text)


def scene_from_tables(
    tables: dict[str, Any],
    file: Path,
    *,
    option_names: Collection[str] | None = None,
    text: str = "",
    whole: bool = True,
) -> LoadedScene:
    """As `load_scene`, from the tables of a file, as read or modified.

    file: path for messages and for the folder of other files; text: text of the file, for line numbers in messages; whole:
    False takes a mechanism that is not complete yet.
    """
    file_mistakes = FileMistakes()
    top = Table(tables, file.name, file_mistakes=file_mistakes)
    options = _read_options(top, option_names)
    simulate, report = top.table("simulate"), top.table("report")
    reader = _SceneReader(top, file)
    reader.state_all()
    if simulate.values or not simulate.is_valid:
        _state_simulation(reader.mechanism, simulate)
    report_words = report.read(schema.REPORT)
    report.note_unknown_keys()
    if report_words and report.is_valid:
        with report.collect_errors():
            reader.mechanism.report = report_words
    if whole and not file_mistakes.mistakes:
        draft = reader.mechanism.draft()
        file_mistakes.mistakes += [f"{reader.location_of(rule)}: {rule}" for rule in broken_rules(draft)]
        if reader.mechanism.simulation is not None:
            with simulate.collect_errors():
                reader.mechanism.simulation.check(draft)
    line_numbers = LineNumbers(file.name, text)
    mistakes = [line_numbers.add_to(message) for message in file_mistakes.mistakes]
    # messages of mistakes contain the doubts about their own numbers
    doubts = [
        line_numbers.add_to(f"{where}: {doubt}")
        for where, doubt in file_mistakes.unit_doubts
        if not any(doubt in m for m in mistakes)
    ]
    if mistakes:
        raise SceneFileError(_mistake_list(file.name, mistakes, doubts), mistakes=tuple(mistakes))
    if doubts:
        more = f" So for {len(doubts) - 1} more." if len(doubts) > 1 else ""
        warn_user(f"{doubts[0]} Plain numbers are in SI.{more}", SceneWarning)
    return reader.mechanism, reader.targets, options


def _mistake_list(name: str, mistakes: list[str], doubts: list[str]) -> str:
    """The message of one mistake or a list of several, with the first doubt about a unit."""
    lines = [
        message.removeprefix(name).lstrip(",: ") for message in (*mistakes[:MAX_LISTED_MISTAKES], *doubts[:1])
    ]
    if len(mistakes) == 1:
        return "\n  ".join([mistakes[0], *lines[1:]])
    if len(mistakes) > MAX_LISTED_MISTAKES:
        lines.insert(MAX_LISTED_MISTAKES, f"and {len(mistakes) - MAX_LISTED_MISTAKES} more.")
    return "\n  ".join([f"{name} has {len(mistakes)} mistakes:", *lines])


def read_tables(file: Path) -> dict[str, Any]:
    """The tables of a TOML file. Raises SceneError for a file that cannot be read or is no TOML."""
    return _parse_toml(_read_text(file), file.name)


def shipped_scenes() -> dict[str, Traversable]:
    """The scene and job files that come with the package, by name."""
    return {Path(f.name).stem: f for f in (files("ksd") / "scenes").iterdir() if f.name.endswith(".toml")}


def _read_text(file: Path) -> str:
    """The text of a scene file. Raises SceneError."""
    shipped = shipped_scenes().get(file.stem) if not os.path.lexists(file) else None
    if shipped is not None and str(file) == file.stem:
        return shipped.read_text(encoding="utf-8")
    hint = (
        f"check the path; `ksd new NAME --like {file.stem}` writes the scene of that name" if shipped else ""
    )
    try:
        content = read_file(file, what="scene file", most=MAX_FILE_BYTES, hint=hint or "check the path")
    except SceneError:
        head = b""
        with suppress(OSError, ValueError):
            if file.is_file():
                with file.open("rb") as opened:
                    head = opened.read(HEAD_BYTES)
        _refuse_other_format(head, file.name)
        raise
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        _refuse_other_format(content[:HEAD_BYTES], file.name)
        raise SceneError(
            f"{file.name}: byte {error.start + 1} is not UTF-8 text; save the file as UTF-8."
        ) from None


def _refuse_other_format(head: bytes, name: str) -> None:
    """Raise SceneError where the first bytes of a file are those of another program."""
    if found := other_format(head, Path(name).suffix):
        raise SceneError(
            f"{name} is {found}, and no scene file, which is text in TOML: `ksd new NAME` writes one to start from."
        )


def _parse_toml(text: str, name: str) -> dict[str, Any]:
    """The tables of TOML text; `name` of its file starts messages. Raises SceneError."""
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise SceneError(f"{name}: brackets are nested too deeply.") from None
    except tomllib.TOMLDecodeError as error:
        _refuse_other_format(text[:HEAD_BYTES].encode(), name)
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
"""Kinds of names that a statement adds to a mechanism."""
_NAMES_IN_RULES = {"join": "joint", "wire": "leaf", "actuate": "drive", "line_load": "line load"}
"""Words with which messages of `ksd.scene.rules` name the part of a statement, where it is not the statement's name."""


class _SceneReader:
    """Reader of a scene file: makes its materials, sections and joints, then a mechanism from its statements.

    A table with a mistake defines nothing, so statements that refer to its name are skipped without a mistake of their own.
    unknown_names: such names by kind ("joint", "leaf", "link"). locations: table of every part, by its name in messages.
    """

    def __init__(self, top: Table, file: Path) -> None:
        self.folder = file.parent
        self.file, self.locations = file.name, dict[str, str]()
        self.targets: dict[str, float] = {}
        self.mechanism, self.plane_is_valid = Mechanism("scene"), False
        self.unknown_names: dict[str, set[str]] = {"joint": set(), "leaf": set(), "link": set()}
        words = {"name": file.stem, "plane": None, "gravity": None, "consider": []} | top.read(schema.TOP)
        defined = {kind: top.table(kind) for kind in ("material", "section", "joint")}
        self.statements = {name: top.tables(name) for name in schema.STATEMENTS}
        misspelt = [key for key in top.unread_keys() if isinstance(top.values[key], dict | list)]
        top.note_unknown_keys()
        if misspelt:
            self.unknown_names = {kind: {ANY_NAME} for kind in self.unknown_names}
        self._start_mechanism(top, words)
        self.parts: dict[str, dict[str, Any]] = {kind: {} for kind in defined}
        for kind, make in (
            ("material", _make_material),
            ("section", _make_section),
            ("joint", self._make_joint),
        ):
            # [materials.steel] is one mistake, not another one for each leaf of steel
            if (
                any(f'"{kind}"' in similar_name_hint(key, defined) for key in misspelt)
                or not defined[kind].is_valid
            ):
                self.parts[kind][ANY_NAME] = None
            self.parts[kind] |= {n: _make_part(make, t, n) for n, t in defined[kind].children().items()}

    def _start_mechanism(self, top: Table, words: dict[str, Any]) -> None:
        """Make the mechanism from the keys above all tables: name, plane, gravity, links and consider."""
        with top.collect_errors():
            self.mechanism, self.plane_is_valid = Mechanism(words["name"], plane=words["plane"]), True
        with top.collect_errors():
            self.mechanism.gravity = words["gravity"]
        for name in words.get("links", ()):
            with top.collect_errors():
                self.mechanism.link(name)
        for effect in words["consider"]:
            with top.collect_errors():
                self.mechanism.consider(effect)
        if "links" not in words:
            self.unknown_names["link"] = {ANY_NAME}

    def state_all(self) -> None:
        """Apply all statements to the mechanism, in the order of `schema.STATEMENTS`."""
        for statement, tables in self.statements.items():
            for table in tables:
                try:
                    self._state(statement, table)
                except InvalidTable:
                    name = table.values.get("name")
                    for kind in _NAME_KINDS.get(statement, ()):
                        self.unknown_names[kind].add(name if isinstance(name, str) else ANY_NAME)

    def location_of(self, rule: str) -> str:
        """File and table of the part with which the message of a broken rule begins."""
        return next((where for own, where in self.locations.items() if rule.startswith(own)), self.file)

    def _or_invalid(self, statement: Callable[..., T]) -> Callable[..., T]:
        """`statement`, raising InvalidTable instead of an error for a name that is missing because of another mistake."""

        def call(**words: Any) -> T:
            if not self.plane_is_valid:
                raise InvalidTable("without its plane nothing can be said of a mechanism")
            try:
                return statement(**words)
            except UnknownNameError as error:
                if {ANY_NAME, error.name, error.name.partition("/")[0]} & self.unknown_names[error.kind]:
                    raise InvalidTable(str(error)) from None
                raise

        return call

    def _state(self, statement: str, table: Table) -> None:
        """Apply the statement of one table to the mechanism."""
        keys = schema.STATEMENTS[statement]
        if statement == "damper" and "about" in table:
            keys = keys | {"damping": "torsional damping!"}
        words = table.read(keys, self.parts)
        for key in schema.LINK_KEYS:
            with table.collect_errors():
                if (
                    key in words
                    and (statement, words[key]) != ("sensor", "absolute")
                    and statement != "contact"
                ):
                    self._or_invalid(self.mechanism._checked_link)(link=words[key], owner=key)
        if statement == "actuate":
            self._state_drive(table, words)
            return
        if statement == "stop":
            words |= self._read_terms(table)
            words |= self._read_limits(table, words)
        elif statement == "cable":
            words |= self._read_via(table)
        elif statement == "surface":
            words = _surface_words(table, words)
        if "joint" in table and "joint" not in words and {"axis", "toward"} <= words.keys():
            # the joint has a mistake of its own, its placement may have others
            with table.collect_errors():
                joint_rotation(words["axis"], words["toward"], statement)
        if statement == "support":
            words |= self._read_terms(table)
        elif statement in ("leaf", "wire"):
            words |= self._read_section(table, statement) | _read_shapes(table)
        elif statement == "compliance":
            words = self._compliance_words(table, words)
        made = table.call(self._or_invalid(getattr(self.mechanism, statement)), words)
        self.locations[f"{_NAMES_IN_RULES.get(statement, statement)} '{getattr(made, 'name', '')}'"] = (
            table.where
        )

    def _read_section(self, table: Table, kind: str) -> dict[str, Any]:
        """Diameter of a wire, or section of a leaf by name or from thickness and width."""
        if kind == "leaf" and "section" not in table and ("thickness" in table or "width" in table):
            sizes = table.read(schema.SIZES["rectangle"])
            with table.collect_errors():
                return {"section": rectangle(**sizes)} if len(sizes) == len(schema.SIZES["rectangle"]) else {}
            return {}
        return table.read(schema.SIZES[kind], self.parts)

    def _compliance_words(self, table: Table, words: dict[str, Any]) -> dict[str, Any]:
        """Arguments of a compliance, its matrix from a file or from points and stiffness."""
        points, stiffness = words.pop("points", None), words.pop("stiffness", None)
        if "matrix" in words:
            words["matrix"] = self.folder / words["matrix"]
        elif points is not None or stiffness is not None:
            with table.collect_errors():
                words["matrix"] = LinkMatrix(points or (), stiffness or ())  # type: ignore[arg-type]
        return words

    def _state_drive(self, table: Table, words: dict[str, Any]) -> None:
        """Apply an [[actuate]] table to the mechanism, and store its value as target in the unit of its motion."""
        words |= self._read_terms(table)
        dimension = "length" if "along" in words else "angle" if "about" in words else "any"
        value = table.read({"value": dimension})
        drive: Drive = table.call(self._or_invalid(self.mechanism.actuate), words)
        if dimension == "any":
            value = table.read({"value": drive.dimension})
        if value:
            self.targets[drive.name] = value["value"]
        self.locations[f"drive '{drive.name}'"] = table.where

    def _read_terms(self, table: Table) -> dict[str, list[DriveTerm]]:
        """The argument `terms` of a drive or support, if its table has it."""
        terms = make_each(self._make_term, table.tables("terms"))
        return {"terms": terms} if "terms" in table else {}

    def _read_limits(self, table: Table, words: dict[str, Any]) -> dict[str, Any]:
        """Limits and softness of a stop, in the unit of its motion."""
        table.read(dict.fromkeys(schema.LIMITS["number"], "any"))
        motion = {key: value for key, value in words.items() if key != "name"}
        parts, _ = table.call(self._or_invalid(self.mechanism._drive_terms), motion)
        return table.read(schema.LIMITS[dimension_of(parts)])

    def _read_via(self, table: Table) -> dict[str, list[tuple[str, Any]]]:
        """The argument `via` of a cable, if its table has it."""
        read = [own.read(schema.VIA) for own in table.tables("via")]
        return (
            {"via": [(w["link"], w["at"]) for w in read if len(w) == len(schema.VIA)]}
            if "via" in table
            else {}
        )

    def _make_term(self, table: Table) -> DriveTerm:
        """One term of a drive or support. Raises InvalidTable."""
        words = table.read(schema.TERM)

        def term(**words: Any) -> DriveTerm:
            if ("along" in words) == ("about" in words):
                raise SceneError("give one of along (a displacement) and about (a rotation).")
            if "along" in words:
                return self.mechanism.displacement(**{"at": None} | words)
            return self.mechanism.rotation(**words)

        return table.call(self._or_invalid(term), words)

    def _make_joint(self, table: Table, name: str) -> Joint:
        """A joint of a family, or one drawn leaf by leaf. Raises InvalidTable."""
        families = joint_families()
        family = _read_kind(table, "family", [*families, "drawn"], "joint family")
        if family == "drawn":
            return self._make_drawn_joint(table)
        words = table.read(schema.family_schema(families[family]), self.parts)
        return table.call(partial(make_joint, family), words)

    def _make_drawn_joint(self, table: Table) -> DrawnJoint:
        """A joint that is drawn leaf by leaf."""
        blocks, shape = table.table("blocks"), table.table("shape")
        words: dict[str, Any] = {"name": "drawn"} | table.read(schema.DRAWN)
        words["blocks"] = blocks.read(dict.fromkeys(blocks.values, "length[3]"))
        words["shape"] = shape.read(dict.fromkeys(shape.values, "number"))
        leaf_tables = [(t, kind) for kind in ("leaf", "wire") for t in table.tables(kind)]
        motions = table.tables("motion")
        with table.collect_errors():
            words["leaves"] = make_each(self._make_drawn_leaf, leaf_tables)
        with table.collect_errors():
            words["motions"] = make_each(_make_motion, motions)
        table.is_valid &= blocks.is_valid and shape.is_valid
        table.has_gaps |= blocks.has_gaps or shape.has_gaps
        return table.call(DrawnJoint, words)

    def _make_drawn_leaf(self, table_and_kind: tuple[Table, str]) -> Leaf:
        """A "leaf" or "wire" of a drawn joint. Raises InvalidTable."""
        table, kind = table_and_kind
        words = {"name": kind, "width_axis": None} | table.read(schema.LEAF, self.parts)
        words |= self._read_section(table, kind) | _read_shapes(table) | table.read(schema.BLOCKS)
        return table.call(make_wire if kind == "wire" else Leaf, words)


def _surface_words(table: Table, words: dict[str, Any]) -> dict[str, Any]:
    """Arguments of a surface, with its shape made of the sizes of its table. Raises InvalidTable."""
    kind = _read_kind(table, "shape", schema.CONTACT_SHAPES, "shape")
    wanted = schema.CONTACT_SHAPES[kind]
    sizes: dict[str, Any] = {key: words.pop(key) for key in schema.SHAPE_SIZES if key in words}

    def make(**given: Any) -> Any:
        if given.keys() != set(wanted):
            raise SceneError(
                f"a {kind} needs {' and '.join(wanted) or 'no sizes'}, and {', '.join(given) or 'none'} is given."
            )
        spread = "semi_axes" in wanted or "size" in wanted
        if "semi_axes" in wanted and len(given["semi_axes"]) != (2 if kind == "ellipse" else 3):
            raise SceneError(f"an {kind} has {'two' if kind == 'ellipse' else 'three'} semi_axes.")
        values = [v for value in given.values() for v in (value if spread else [value])]
        return getattr(shapes, kind)(*values)

    return words | {"shape": table.call(make, sizes)}


def _make_part(make: Callable[[Table, str], T], table: Table, name: str) -> T | None:
    """A material, section or joint of the file; None if its table has a mistake."""
    try:
        return make(table, name)
    except InvalidTable:
        return None


def _read_kind(table: Table, key: str, known: Collection[str], what: str) -> str:
    """The value of the key that determines the other keys of a table. Raises InvalidTable unless it is known."""
    word = table.read({key: "text!"}, known=known).get(key, "")
    if table.is_valid and word not in known:
        table.note_mistake(f"{table.where}: {what} {show(word)} is unknown{name_hint(word, known)}")
    if not table.is_valid:
        raise InvalidTable(f"{table.where}: what it is, is not known")
    return str(word)


def _read_shapes(table: Table) -> dict[str, Any]:
    """The curve and the profile of a leaf, as far as its table has them."""
    shapes = {}
    for key in [key for key in schema.SHAPES if key in table]:
        own = table.table(key)
        with table.collect_errors():
            kind = _read_kind(own, "kind", schema.SHAPES[key], key)
            shapes[key] = own.call(SHAPE_CLASSES[key][kind][1], own.read(schema.SHAPES[key][kind]))
    return shapes


def _make_material(table: Table, name: str) -> Material:
    """A material. Raises InvalidTable."""
    return table.call(Material, {"name": name} | table.read(schema.MATERIAL))


def _make_section(table: Table, name: str) -> Section:
    """A section. Raises InvalidTable."""
    kind = _read_kind(table, "kind", schema.SECTIONS, "section kind")
    made: Section = table.call(getattr(section, kind), table.read(schema.SECTIONS[kind]))
    return made


def _make_motion(table: Table) -> Motion:
    """An intended motion of a drawn joint. Raises InvalidTable."""
    kind = table.read({"kind": "text!"}).get("kind")
    return table.call(Motion, table.read(schema.MOTIONS.get(str(kind), schema.MOTIONS["rotation"])))


def _state_simulation(mechanism: Mechanism, table: Table) -> None:
    """The words of the table [simulate] as those of a mechanism."""
    words = table.read(schema.SIMULATE)
    table.note_unknown_keys()
    if table.is_valid:
        with table.collect_errors():
            mechanism.simulation = simulation_of_table(words)


def _read_options(top: Table, names: Collection[str] | None) -> dict[str, Any]:
    """The table [options]; names: its allowed keys, any when None."""
    table = top.table("options")
    options = table.read(dict.fromkeys(table.values if names is None else names, "any"))
    table.note_unknown_keys()
    return options
