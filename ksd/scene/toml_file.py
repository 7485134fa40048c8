"""Scenes in TOML files, in the words of the Python scene.

    name = "lever"
    links = ["lever"]
    [material.steel]   E = "200 GPa", G = "76.9 GPa", density = 7800, yield_stress = "1 GPa"
    [section.blade]    kind = "rectangle", thickness = "1 mm", width = "40 mm"
    [joint.cross]      family = "cross_flexure", material = "steel", length = "100 mm", angle = "45 deg", ...
    [[join]]           a = "ground", b = "lever", joint = "cross", at = [0, 0, 0], axis = "z", toward = "x"
    [[constrain]]      as [[join]], for joints without intended motion
    [[leaf]]           a, b, start, end, width_axis, section (or thickness and width), material
    [[wire]]           a, b, start, end, diameter, material
    [[actuate]]        link, about = "z", value = "30 deg"; or along and at; or joint; or terms = [{...}, ...]
    [[support]] [[load]] [[mass]]   as the methods of `Mechanism`; springs, elastic links, heat: `ksd.scene.toml_effects`
    [options]          what the solver is asked, e.g. method = "reduced"

Numbers are SI, or text with a unit ("100 mm", "45 deg", "200 GPa"); files are read as UTF-8.
"""

from __future__ import annotations

import inspect
import os
import tomllib
from collections.abc import Callable, Collection
from functools import partial
from pathlib import Path
from typing import Any

from ksd.errors import SceneError
from ksd.files import read_file
from ksd.scene.drive import Drive, DriveTerm
from ksd.scene.families import joint_families, make_joint
from ksd.scene.joint import DrawnJoint, Joint, Motion
from ksd.scene.leaf import Leaf
from ksd.scene.material import Material
from ksd.scene.mechanism import Mechanism
from ksd.scene.toml_effects import read_effects
from ksd.scene.toml_table import Table, placed_at
from ksd.scene.toml_writer import save_scene
from ksd.section import Section, circle, numbers, polygon, rectangle, tube
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
    top = Table(_parsed(file), file.name)
    name, gravity = top.text("name", file.stem), top.quantities("gravity", "number", None)
    links = top.take("links")
    if not isinstance(links, list):
        raise SceneError(f"{file.name}: links = {show(links)} must be a list of names.")
    with placed_at(file.name):
        mechanism = Mechanism(name)
        mechanism.gravity = gravity
        mechanism.links(*links)
    parts = _Parts(top)
    for table in top.tables("join"):
        _join(table, parts, mechanism.join)
    for table in top.tables("constrain"):
        _join(table, parts, mechanism.constrain)
    for kind in ("leaf", "wire"):
        for table in top.tables(kind):
            _connect(mechanism, table, parts, kind)
    targets: dict[str, float] = {}
    for table in top.tables("actuate"):
        _actuate(mechanism, table, targets)
    for table in top.tables("support"):
        _said(table, mechanism.support, _motion(mechanism, table))
    _loads(mechanism, top)
    read_effects(mechanism, top, file.parent, {"section": parts.sections, "material": parts.materials})
    options = _options(top, option_names)
    top.finish()
    with placed_at(file.name):
        mechanism.validate()
    return mechanism, targets, options


def _parsed(file: Path) -> dict[str, Any]:
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


class _Parts:
    """Materials, sections and joints a scene file defines, by name."""

    def __init__(self, top: Table) -> None:
        self.materials = {name: _material(t, name) for name, t in top.named("material").items()}
        self.sections = {name: _section(t) for name, t in top.named("section").items()}
        self.joints = {name: self._joint(t) for name, t in top.named("joint").items()}

    def material(self, table: Table) -> Material:
        return self.materials[table.name_of("material", self.materials, "material")]

    def leaf_words(self, table: Table, kind: str) -> dict[str, Any]:
        """Ends, section, material and mesh of a [[leaf]] or [[wire]]."""
        words = {
            "start": table.quantities("start", "length"),
            "end": table.quantities("end", "length"),
            "width_axis": table.direction("width_axis", None),
            "material": self.material(table),
            "name": table.text("name", kind),
            "elements": table.take("elements", None),
            "orders": table.take("orders", None),
        }
        if kind == "wire":
            make: Callable[..., Section] = circle
            sizes = [table.quantity("diameter", "length")]
        elif "section" in table or "thickness" not in table:
            words["section"] = self.sections[table.name_of("section", self.sections, "section")]
            return words
        else:
            make = rectangle
            sizes = [table.quantity(key, "length") for key in ("thickness", "width")]
        with placed_at(table.where):
            words["section"] = make(*sizes)
        return words

    def _joint(self, table: Table) -> Joint:
        family = table.text("family")
        if family == "drawn":
            return self._drawn(table)
        families = joint_families()
        if family not in families:
            near = nearest(family, [*families, "drawn"])
            raise SceneError(f"{table.where}: joint family '{family}' is unknown{near}")
        words: dict[str, Any] = {}
        for key in inspect.signature(families[family]).parameters:
            if key == "material":
                words[key] = self.material(table)
            elif key in table:
                words[key] = self._parameter(table, key, families[family].quantities.get(key))
            else:
                table.take(key, None)
        return _said(table, partial(make_joint, family), words)

    def _parameter(self, table: Table, key: str, dimension: str | None) -> Any:
        value = table.take(key)
        if dimension is None:
            return value
        if isinstance(value, list):
            return table.quantities(key, dimension, count=len(value))
        return table.quantity(key, dimension)

    def _drawn(self, table: Table) -> DrawnJoint:
        blocks = table.table("blocks")
        shape = table.table("shape")
        words: dict[str, Any] = {
            "name": table.text("name", "drawn"),
            "blocks": {name: blocks.quantities(name, "length") for name in blocks.values},
            "leafs": [self._drawn_leaf(t, kind) for kind in ("leaf", "wire") for t in table.tables(kind)],
            "motions": [_motion_of(t) for t in table.tables("motion")],
            "length": table.quantity("length", "length", None),
            "shape": {name: shape.quantity(name, "number") for name in shape.values},
            "windows": table.yes_or_no("windows", False),
            "held_by_others": table.yes_or_no("held_by_others", False),
        }
        return _said(table, DrawnJoint, words)

    def _drawn_leaf(self, table: Table, kind: str) -> Leaf:
        words = self.leaf_words(table, kind)
        words |= {k: table.text(k) for k in ("start_block", "end_block")}
        return _said(table, Leaf, words)


def _said(table: Table, say: Callable[..., Any], words: dict[str, Any]) -> Any:
    """Refuse unknown keys, then say the sentence; its errors get file and table in front."""
    table.finish()
    with placed_at(table.where):
        return say(**words)


def _material(table: Table, name: str) -> Material:
    words = {
        "E": table.quantity("E", "stress", None),
        "G": table.quantity("G", "stress", None),
        "nu": table.quantity("nu", "number", None),
        "density": table.quantity("density", "density", None),
        "expansion": table.quantity("expansion", "number", None),
        "yield_stress": table.quantity("yield_stress", "stress", None),
        "fatigue_limit": table.quantity("fatigue_limit", "stress", None),
        "name": table.text("name", name),
    }
    return _said(table, Material, words)


_SECTIONS: dict[str, tuple[Callable[..., Section], dict[str, str]]] = {
    "rectangle": (rectangle, {"thickness": "length", "width": "length", "cowper": "number"}),
    "circle": (circle, {"diameter": "length", "cowper": "number"}),
    "tube": (tube, {"outer": "length", "inner": "length", "cowper": "number"}),
    "polygon": (polygon, {"mesh_size": "length", "nu": "number"}),
    "numbers": (
        numbers,
        dict.fromkeys(("A", "J", "Iy", "Iz", "ky", "kz", "Iw", "tilt"), "number")
        | {"width": "length", "thickness": "length"},
    ),
}
_OPTIONAL = ("cowper", "mesh_size", "nu", "ky", "kz", "Iw", "tilt")


def _section(table: Table) -> Section:
    kind = table.text("kind")
    if kind not in _SECTIONS:
        raise SceneError(f"{table.where}: kind = {show(kind)} is unknown{nearest(kind, _SECTIONS)}")
    make, keys = _SECTIONS[kind]
    words: dict[str, Any] = {"name": table.text("name", kind)}
    for key, dimension in keys.items():
        optional = key in _OPTIONAL or (kind == "numbers" and dimension == "length")
        value = table.quantity(key, dimension, None) if optional else table.quantity(key, dimension)
        if value is not None:
            words[key] = value
    if kind == "polygon":
        words["points"], words["holes"] = table.take("points"), table.take("holes", [])
    if kind == "numbers":
        words["outline"] = table.take("outline", None)
        words["shear_centre"] = table.quantities("shear_centre", "length", (0.0, 0.0), count=2)
    return _said(table, make, words)


def _motion_of(table: Table) -> Motion:
    kind = table.text("kind")
    dimension = "length" if kind == "translation" else "angle"
    words = {
        "name": table.text("name"),
        "kind": kind,
        "axis": table.direction("axis"),
        "range": table.quantities("range", dimension, count=2),
        "point": table.quantities("point", "length", None),
    }
    return _said(table, Motion, words)


def _join(table: Table, parts: _Parts, say: Callable[..., Any]) -> None:
    """[[join]] and [[constrain]] tables."""
    joint = parts.joints[table.name_of("joint", parts.joints, "joint")]
    a, b = table.text("a"), table.text("b")
    words = {
        "at": table.quantities("at", "length"),
        "axis": table.direction("axis"),
        "toward": table.direction("toward"),
        "name": table.text("name", None),
    }
    _said(table, partial(say, a, b, joint), words)


def _connect(mechanism: Mechanism, table: Table, parts: _Parts, kind: str) -> None:
    a, b = table.text("a"), table.text("b")
    words = parts.leaf_words(table, kind)
    if "name" not in table:
        words["name"] = None
    if kind == "wire":
        words["diameter"] = words.pop("section").width
    _said(table, partial(getattr(mechanism, kind), a, b), words)


def _term(mechanism: Mechanism, table: Table) -> DriveTerm:
    words = {"relative_to": table.text("relative_to", None)}
    words["coefficient"] = table.quantity("coefficient", "number", 1.0)
    link, at = table.text("link"), table.quantities("at", "length", None)
    along, about = table.direction("along", None), table.direction("about", None)
    table.finish()
    with placed_at(table.where):
        if (along is None) == (about is None):
            raise SceneError("give one of along (a displacement) and about (a rotation).")
        if along is not None:
            return mechanism.displacement(link, along, at=at, **words)
        return mechanism.rotation(link, about, at=(0.0, 0.0, 0.0) if at is None else at, **words)


def _motion(mechanism: Mechanism, table: Table) -> dict[str, Any]:
    """The words of `Mechanism.actuate` and `Mechanism.support`."""
    terms = [_term(mechanism, t) for t in table.tables("terms")]
    return {
        "link": table.text("link", None),
        "along": table.direction("along", None),
        "about": table.direction("about", None),
        "at": table.quantities("at", "length", None),
        "relative_to": table.text("relative_to", None),
        "name": table.text("name", None),
        "joint": table.text("joint", None),
        "motion": table.text("motion", None),
        "terms": terms if "terms" in table else None,
    }


def _actuate(mechanism: Mechanism, table: Table, targets: dict[str, float]) -> None:
    words = _motion(mechanism, table)
    table.take("value", None)
    drive: Drive = _said(table, mechanism.actuate, words)
    kinds = {term.kind for term in drive.terms}
    dimension = {"translation": "length", "rotation": "angle"}[kinds.pop()] if len(kinds) == 1 else "number"
    value = table.quantity("value", dimension, None)
    if value is not None:
        targets[drive.name] = value


def _loads(mechanism: Mechanism, top: Table) -> None:
    """[[load]] and [[mass]] tables."""
    for table in top.tables("load"):
        link, following = table.text("link"), table.yes_or_no("following", False)
        words = {
            "force": table.quantities("force", "force", None),
            "moment": table.quantities("moment", "moment", None),
            "at": table.quantities("at", "length", None),
            "name": table.text("name", None),
        }
        _said(table, partial(mechanism.load, link, following=following), words)
    for table in top.tables("mass"):
        link = table.text("link")
        words = {
            "mass": table.quantity("mass", "mass"),
            "inertia": table.take("inertia", None),
            "at": table.quantities("at", "length"),
        }
        _said(table, partial(mechanism.mass, link), words)


def _options(top: Table, names: Collection[str] | None) -> dict[str, Any]:
    table = top.table("options")
    for key in table.values if names is None else names:
        table.take(key, None)
    table.finish()
    return dict(table.values)
