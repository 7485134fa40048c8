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
    [[point]]          leaf, s = "30 mm", name
    [[pin]]            a, b, at (and axis, where there is no plane);  [[slider]]  link, along, at
    [[actuate]]        link, about = "z", value = "30 deg"; or along and at; or joint; or terms = [{...}, ...]
    [[compliance]]     link, section and material (hub, width_axis); or matrix = "file.npz" or "file.h5"
    [options]          what the solver is asked, e.g. method = "reduced"

Numbers are SI, or text with a unit ("100 mm", "45 deg", "200 GPa"); files are read as UTF-8.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Collection
from functools import partial
from pathlib import Path
from typing import Any

from ksd import section
from ksd.errors import SceneError
from ksd.files import read_file
from ksd.scene import toml_schema as schema
from ksd.scene.drive import Drive, DriveTerm
from ksd.scene.effects import LinkMatrix
from ksd.scene.families import joint_families, make_joint
from ksd.scene.joint import DrawnJoint, Joint, Motion
from ksd.scene.leaf import Leaf
from ksd.scene.leaf import wire as make_wire
from ksd.scene.material import Material
from ksd.scene.mechanism import Mechanism
from ksd.scene.toml_table import Table, placed_at
from ksd.scene.toml_writer import save_scene
from ksd.section import Section, rectangle
from ksd.section.checks import nearest, show

__all__ = ["load_scene", "save_scene"]

LARGEST = 1 << 22
"""Bytes of a scene file that is read, 4 MiB."""
Loaded = tuple[Mechanism, dict[str, float], dict[str, Any]]


def load_scene(path: str | os.PathLike[str], *, option_names: Collection[str] | None = None) -> Loaded:
    """Read a scene file: (mechanism, targets {drive: value in SI}, options as written).

    option_names: the keys allowed in [options]; any when None. Raises SceneError, naming file, table and key,
    for a file that cannot be read, is no TOML, misses a key, has an unknown one, or holds a wrong type, unit
    or value.
    """
    file = Path(path)
    return scene_of_tables(parsed_file(file), file, option_names=option_names)


def scene_of_tables(
    tables: dict[str, Any], file: Path, *, option_names: Collection[str] | None = None
) -> Loaded:
    """The same from the tables of a file, as read or changed; file: whose name errors tell, whose folder holds others."""
    top = Table(tables, file.name)
    said = {"name": file.stem, "plane": None, "gravity": None, "consider": []} | top.read(schema.TOP)
    for key, what in (("links", "names"), ("consider", "effects")):
        if not isinstance(said[key], list):
            raise SceneError(f"{file.name}: {key} = {show(said[key])} must be a list of {what}.")
    with placed_at(file.name):
        mechanism = Mechanism(said["name"], plane=said["plane"])
        mechanism.gravity = said["gravity"]
        mechanism.links(*said["links"])
        mechanism.consider(*said["consider"])
    reader = _Reader(mechanism, top, file.parent)
    for sentence in schema.SENTENCES:
        for table in top.tables(sentence):
            reader.say(sentence, table)
    options = _options(top, option_names)
    top.finish()
    with placed_at(file.name):
        mechanism.validate()
    return mechanism, reader.targets, options


def parsed_file(file: Path) -> dict[str, Any]:
    """The tables of a TOML file as they are written. Raises SceneError for a file that cannot be read or is no TOML."""
    content = read_file(file, what="scene file", most=LARGEST, hint="check the path")
    try:
        text = content.decode()
    except UnicodeDecodeError as error:
        raise SceneError(
            f"{file.name}: byte {error.start + 1} is not UTF-8 text; save the file as UTF-8."
        ) from None
    try:
        return tomllib.loads(text)
    except RecursionError:
        raise SceneError(f"{file.name}: brackets are nested too deeply.") from None
    except tomllib.TOMLDecodeError as error:
        raise SceneError(f"{file.name} is not valid TOML: {error}.") from None
    except ValueError:
        raise SceneError(
            f"{file.name} is not valid TOML: it holds a number of thousands of digits."
        ) from None


class _Reader:
    """Materials, sections and joints a scene file defines, by name, and what it says with them about a mechanism."""

    def __init__(self, mechanism: Mechanism, top: Table, folder: Path) -> None:
        self.mechanism, self.folder = mechanism, folder
        self.targets: dict[str, float] = {}
        self.parts: dict[str, dict[str, Any]] = {
            "material": {name: _material(t, name) for name, t in top.named("material").items()},
            "section": {name: _section(t) for name, t in top.named("section").items()},
        }
        self.parts["joint"] = {name: self._joint(t) for name, t in top.named("joint").items()}

    def say(self, sentence: str, table: Table) -> None:
        """One table of `schema.SENTENCES`, said to the mechanism."""
        words = table.read(schema.SENTENCES[sentence], self.parts)
        if sentence == "actuate":
            self._actuate(table, words)
            return
        if sentence == "support":
            words |= self._terms(table)
        elif sentence in ("leaf", "wire"):
            words |= self._sizes(table, sentence)
        elif sentence == "compliance":
            words = self._with_matrix(table, words)
        table.say(getattr(self.mechanism, sentence), words)

    def _sizes(self, table: Table, kind: str) -> dict[str, Any]:
        """The diameter of a wire, or the section of a leaf, by name or from thickness and width."""
        if kind == "leaf" and "thickness" in table and "section" not in table:
            sizes = table.read(schema.SIZES["rectangle"])
            with placed_at(table.where):
                return {"section": rectangle(**sizes)}
        return table.read(schema.SIZES[kind], self.parts)

    def _with_matrix(self, table: Table, words: dict[str, Any]) -> dict[str, Any]:
        """The words of a compliance, its matrix from a file or from points and stiffness."""
        points, stiffness = words.pop("points", None), words.pop("stiffness", None)
        if "matrix" in words:
            words["matrix"] = self.folder / words["matrix"]
        elif points is not None or stiffness is not None:
            with placed_at(table.where):
                words["matrix"] = LinkMatrix(points or (), stiffness or ())  # type: ignore[arg-type]
        return words

    def _actuate(self, table: Table, words: dict[str, Any]) -> None:
        """A drive, and its value in the unit of its motion."""
        words |= self._terms(table)
        table.read({"value": "any"})
        drive: Drive = table.say(self.mechanism.actuate, words)
        kinds = {term.kind for term in drive.terms}
        dimension = (
            {"translation": "length", "rotation": "angle"}[kinds.pop()] if len(kinds) == 1 else "number"
        )
        for value in table.read({"value": dimension}).values():
            self.targets[drive.name] = value

    def _terms(self, table: Table) -> dict[str, list[DriveTerm]]:
        terms = [self._term(t) for t in table.tables("terms")]
        return {"terms": terms} if "terms" in table else {}

    def _term(self, table: Table) -> DriveTerm:
        words = table.read(schema.TERM)
        table.finish()
        with placed_at(table.where):
            if ("along" in words) == ("about" in words):
                raise SceneError("give one of along (a displacement) and about (a rotation).")
            if "along" in words:
                return self.mechanism.displacement(**{"at": None} | words)
            return self.mechanism.rotation(**words)

    def _joint(self, table: Table) -> Joint:
        family = table.read({"family": "text!"})["family"]
        if family == "drawn":
            return self._drawn(table)
        families = joint_families()
        if family not in families:
            near = nearest(family, [*families, "drawn"])
            raise SceneError(f"{table.where}: joint family '{family}' is unknown{near}")
        joint: Joint = table.say(
            partial(make_joint, family), table.read(schema.of_family(families[family]), self.parts)
        )
        return joint

    def _drawn(self, table: Table) -> DrawnJoint:
        """A joint drawn leaf by leaf."""
        blocks, shape = table.table("blocks"), table.table("shape")
        words: dict[str, Any] = {"name": "drawn"} | table.read(schema.DRAWN)
        words["blocks"] = blocks.read(dict.fromkeys(blocks.values, "length[3]"))
        words["leaves"] = [self._drawn_leaf(t, k) for k in ("leaf", "wire") for t in table.tables(k)]
        words["motions"] = [_motion(t) for t in table.tables("motion")]
        words["shape"] = shape.read(dict.fromkeys(shape.values, "number"))
        joint: DrawnJoint = table.say(DrawnJoint, words)
        return joint

    def _drawn_leaf(self, table: Table, kind: str) -> Leaf:
        words = {"name": kind, "width_axis": None} | table.read(schema.LEAF, self.parts)
        words |= self._sizes(table, kind) | table.read(schema.BLOCKS)
        leaf: Leaf = table.say(make_wire if kind == "wire" else Leaf, words)
        return leaf


def _material(table: Table, name: str) -> Material:
    material: Material = table.say(Material, {"name": name} | table.read(schema.MATERIAL))
    return material


def _section(table: Table) -> Section:
    kind = table.read({"kind": "text!"})["kind"]
    if kind not in schema.SECTIONS:
        raise SceneError(f"{table.where}: kind = {show(kind)} is unknown{nearest(kind, schema.SECTIONS)}")
    made: Section = table.say(getattr(section, kind), table.read(schema.SECTIONS[kind]))
    return made


def _motion(table: Table) -> Motion:
    kind = table.read({"kind": "text!"})["kind"]
    motion: Motion = table.say(Motion, table.read(schema.MOTIONS.get(kind, schema.MOTIONS["rotation"])))
    return motion


def _options(top: Table, names: Collection[str] | None) -> dict[str, Any]:
    table = top.table("options")
    options = table.read(dict.fromkeys(table.values if names is None else names, "any"))
    table.finish()
    return options
