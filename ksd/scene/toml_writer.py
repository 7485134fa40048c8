"""Writing of scenes to TOML files that `load_scene` reads; numbers are SI with all digits."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ksd.checks import clear_argument_errors, number, show, unused_name
from ksd.errors import SceneError
from ksd.files import write_file
from ksd.scene.curve import FreeCurve
from ksd.scene.drive import GROUND, Drive, DriveTerm
from ksd.scene.effects import Compliance, Spring, TurnSpring
from ksd.scene.families import joint_families
from ksd.scene.hinges import Hinge
from ksd.scene.joint import DrawnJoint, Joint
from ksd.scene.leaf import Leaf
from ksd.scene.material import Material
from ksd.scene.mechanism import Mechanism
from ksd.scene.obstacle import Cable, Stop, Surface
from ksd.scene.scene import PlacedJoint, PlacedLeaf, Scene
from ksd.scene.sensor import Damper, Sensor
from ksd.scene.simulation import table_of_simulation
from ksd.scene.toml_schema import (
    BLOCKS,
    CONTACT_SHAPES,
    DRAWN,
    LEAF,
    MATERIAL,
    MOTIONS,
    SECTIONS,
    SHAPE_CLASSES,
    SHAPES,
    SIZES,
    STATEMENTS,
    family_schema,
)
from ksd.section import Section, circle, rectangle

Tree = dict[str, Any]
"""A TOML table as nested dictionaries and lists."""


@clear_argument_errors
def save_scene(
    mechanism: Mechanism | Scene,
    path: str | os.PathLike[str],
    *,
    targets: Mapping[str, float] | None = None,
    options: Mapping[str, Any] | None = None,
) -> None:
    """Write the scene file `path` (UTF-8), from which `load_scene` reads an equal scene with equal fingerprint.

    mechanism: a mechanism or its scene; targets: {drive: value in SI}; options: contents of [options]. Raises SceneError for
    an incomplete scene, a leaf whose profile or curve, or a motion in time, is a function of Python, a joint of an unknown
    family, and a target without drive.

    >>> guide, stroke, _ = ksd.load_scene("guide")
    >>> ksd.save_scene(guide, "mine.toml", targets=stroke)
    >>> ksd.load_scene("mine.toml")[0].scene() == guide.scene()
    True
    """
    scene = mechanism.scene() if isinstance(mechanism, Mechanism) else mechanism
    if not isinstance(scene, Scene):
        raise SceneError(
            f"save_scene: {show(mechanism)} is not a mechanism; give the mechanism, then the file."
        )
    tree = _scene_tree(scene, dict(targets or {}))
    if isinstance(mechanism, Mechanism) and mechanism.simulation is not None:
        tree["simulate"] = table_of_simulation(mechanism.simulation)
    if isinstance(mechanism, Mechanism) and mechanism.report:
        tree["report"] = dict(mechanism.report)
    if options:
        tree["options"] = dict(options)
    text = "\n".join(toml_tree_lines(tree, ""))
    write_file(path, text.lstrip("\n") + "\n", what="scene file")


def _scene_tree(scene: Scene, targets: dict[str, float]) -> Tree:
    """The tables of a scene file as a tree; removes all used `targets`. Raises SceneError."""
    names = _PartNames()
    of_hinges = {s.name for h in scene.hinges for s in h.supports(scene.plane)}
    statements = {
        "join": [_join_tree(j, names) for j in scene.joints],
        "leaf": [_leaf_tree(p.leaf, names, {"a": p.a, "b": p.b}) for p in scene.leaves],
        "actuate": [_drive_tree(d) | _target_value(d.name, targets) for d in scene.drives],
        "support": [_drive_tree(s) for s in scene.supports if s.name not in of_hinges],
        "pin": [_hinge_tree(h) for h in scene.hinges if h.kind == "pin"],
        "slider": [_hinge_tree(h) for h in scene.hinges if h.kind == "slider"],
        "ball": [_hinge_tree(h) for h in scene.hinges if h.kind == "ball"],
        "cylindrical": [_hinge_tree(h) for h in scene.hinges if h.kind == "cylindrical"],
        "sensor": [_sensor_tree(s) for s in scene.sensors],
        "damper": [_damper_tree(d) for d in scene.dampers],
        "stop": [_stop_tree(s) for s in scene.stops],
        "cable": [_cable_tree(c, names) for c in scene.cables],
        "surface": [_surface_tree(s) for s in scene.surfaces],
        "compliance": [_compliance_tree(c, names) for c in scene.compliances],
    }
    by_schema: dict[str, Iterable[Any]] = {
        "point": scene.points,
        "load": scene.loads,
        "line_load": scene.line_loads,
        "pressure": scene.pressures,
        "mass": scene.masses,
        "distance": scene.distances,
        "contact": scene.contacts,
        "spring": [s for s in scene.springs if isinstance(s, Spring)],
        "turn_spring": [s for s in scene.springs if isinstance(s, TurnSpring)],
        "heat": scene.heats,
        "fit": scene.fits,
    }
    statements |= {
        key: [_keys_tree(part, STATEMENTS[key], names) for part in parts] for key, parts in by_schema.items()
    }
    for table, line in zip(statements["line_load"], scene.line_loads, strict=True):
        for key in [
            *("force", "to") * (not line.has_force),
            *("moment", "to_moment") * (not line.has_moment),
        ]:
            table.pop(key, None)
    if targets:
        raise SceneError(f"target '{next(iter(targets))}' belongs to no drive of '{scene.name}'.")
    tree: Tree = {
        "name": scene.name,
        "links": [n for n in scene.links[1:] if n not in {p.name for p in scene.points}],
    }
    tree |= {} if scene.plane is None else {"plane": scene.plane}
    tree |= {"consider": list(scene.consider)} if scene.consider else {}
    tree |= {} if scene.gravity is None else {"gravity": scene.gravity}
    tree |= {kind: names.trees(kind) for kind in ("material", "section", "joint")} | statements
    return {key: value for key, value in tree.items() if value not in ({}, [])}


def _target_value(name: str, targets: dict[str, float]) -> Tree:
    """The key `value` of a drive with a target, which is removed from `targets`."""
    return {"value": number(targets.pop(name), f"target '{name}'")} if name in targets else {}


class _PartNames:
    """Tables of the materials, sections and joints of a scene, each once under a name of its own."""

    def __init__(self) -> None:
        self._labels_and_tables: dict[str, dict[Any, tuple[str, Tree]]] = {
            "material": {},
            "section": {},
            "joint": {},
        }

    def trees(self, kind: str) -> Tree:
        """The tables of a kind by name."""
        return dict(self._labels_and_tables[kind].values())

    def name_of(self, value: Any) -> Any:
        """The name of a material, section or joint, whose table is added if it is new; any other value unchanged."""
        for kind, (part_class, make_tree) in _PART_KINDS.items():
            if isinstance(value, part_class):
                written = self._labels_and_tables[kind]
                if value not in written:
                    preferred = value.family if isinstance(value, Joint) else value.name
                    label = unused_name(preferred or kind, {name for name, _ in written.values()})
                    written[value] = (label, make_tree(value, self, label))
                return written[value][0]
        return value


def _keys_tree(value: Any, schema: Iterable[str], names: _PartNames, own: Tree | None = None) -> Tree:
    """The attributes of a value by the keys of a schema, replaced and extended by `own`; None is left out."""
    tree = {key: getattr(value, key, None) for key in schema} | (own or {})
    return {key: names.name_of(v) for key, v in tree.items() if v is not None}


def _material_tree(material: Material, names: _PartNames, label: str) -> Tree:
    """The table [material.label]."""
    return _keys_tree(
        material, MATERIAL, names, {"nu": None, "name": None if material.name == label else material.name}
    )


def _section_tree(section: Section, names: _PartNames, label: str) -> Tree:
    """The table [section.label]: a rectangle or circle if it is exactly this section, else all numbers."""
    t, w, name = section.thickness, section.width, section.name
    if t > 0.0 and w > 0.0:
        if section == rectangle(t, w, name=name):
            return {"kind": "rectangle", "thickness": t, "width": w, "name": name}
        if section == circle(w, name=name):
            return {"kind": "circle", "diameter": w, "name": name}
    return {"kind": "numbers"} | _keys_tree(section, SECTIONS["numbers"], names)


def _joint_tree(joint: Joint, names: _PartNames, label: str) -> Tree:
    """The table [joint.label]. Raises SceneError for an unknown family."""
    if isinstance(joint, DrawnJoint):
        return _drawn_joint_tree(joint, names)
    family = joint_families().get(joint.family)
    if family is not type(joint):
        raise SceneError(
            f"joint family '{joint.family}' is not registered, so it cannot be written to a file."
        )
    return {"family": joint.family} | _keys_tree(joint, family_schema(family), names)


_PART_KINDS: dict[str, tuple[type[Any], Callable[[Any, _PartNames, str], Tree]]] = {
    "material": (Material, _material_tree),
    "section": (Section, _section_tree),
    "joint": (Joint, _joint_tree),
}


def _drawn_joint_tree(joint: DrawnJoint, names: _PartNames) -> Tree:
    """The table of a drawn joint."""
    flags = {key: getattr(joint, key) or None for key in ("windows", "held_by_others")}
    tree: Tree = {"family": "drawn"} | _keys_tree(joint, DRAWN, names, flags) | {"blocks": joint.blocks()}
    if joint.shape():
        tree["shape"] = joint.shape()
    leaves = [(leaf, {key: getattr(leaf, key) for key in BLOCKS}) for leaf in joint.leaves()]
    tree["leaf"] = [_leaf_tree(leaf, names, blocks) for leaf, blocks in leaves]
    tree["motion"] = [_keys_tree(m, MOTIONS[m.kind], names) for m in joint.motions]
    return tree


def _leaf_tree(leaf: Leaf, names: _PartNames, ends: Tree) -> Tree:
    """The table of a leaf; ends: keys and names of its links or blocks."""
    shapes = {key: _shape_tree(key, getattr(leaf, key), leaf.name) for key in SHAPES}
    given = {key: tree for key, tree in shapes.items() if tree}
    return ends | _keys_tree(leaf, LEAF | SIZES["leaf"], names) | given


def leaf_tables(placed: PlacedLeaf) -> Tree:
    """The tables of one leaf as in a scene file, SI: "leaf", and "material" and "section" with its own by name.

    A curve or profile that is a function is left out.
    """
    names, ends = _PartNames(), {"a": placed.a, "b": placed.b}
    try:
        tree = _leaf_tree(placed.leaf, names, ends)
    except SceneError:
        tree = _leaf_tree(replace(placed.leaf, curve=None, profile=None), names, ends)
    return {"leaf": tree, "material": names.trees("material"), "section": names.trees("section")}


def _shape_tree(key: str, value: Any, leaf: str) -> Tree:
    """The table of a curve or profile, empty for None. Raises SceneError for one that is a function."""
    own = value.function if isinstance(value, FreeCurve) else value
    for kind, (made, _) in SHAPE_CLASSES[key].items():
        if type(own) is made:
            tree = {word: getattr(own, word, None) for word in SHAPES[key][kind]}
            return {"kind": kind} | {word: v for word, v in tree.items() if v not in (None, ())}
    if value is None:
        return {}
    raise SceneError(
        f"leaf '{leaf}': its {key} is a function, which cannot be written to a file; make it of numbers ({key} of kind "
        f"{', '.join(SHAPE_CLASSES[key])}), or keep it in Python."
    )


def _join_tree(placed: PlacedJoint, names: _PartNames) -> Tree:
    """The table [[join]] of a placed joint."""
    axes = np.asarray(placed.rotation).T.tolist()
    return _keys_tree(
        placed, STATEMENTS["join"], names, {"at": placed.origin, "axis": axes[2], "toward": axes[0]}
    )


def _compliance_tree(compliance: Compliance, names: _PartNames) -> Tree:
    """The table [[compliance]] of an elastic link, its matrix as points and stiffness."""
    matrix = compliance.matrix
    own = {"points": matrix.points, "stiffness": matrix.stiffness} if matrix is not None else {}
    return _keys_tree(compliance, STATEMENTS["compliance"], names, {"matrix": None, **own})


def _drive_tree(drive: Drive) -> Tree:
    """The table [[actuate]] or [[support]] of a drive or support."""
    if len(drive.terms) == 1 and drive.terms[0].coefficient == 1.0:
        return {"name": drive.name} | _term_tree(drive.terms[0])
    return {
        "name": drive.name,
        "terms": [{"coefficient": t.coefficient} | _term_tree(t) for t in drive.terms],
    }


def _hinge_tree(hinge: Hinge) -> Tree:
    """The table [[pin]], [[slider]], [[ball]] or [[cylindrical]] of a hinge."""
    tree: Tree = {"name": hinge.name, "at": hinge.at}
    if hinge.kind != "slider":
        axis = {} if hinge.kind == "ball" else {"axis": hinge.axis}
        return tree | {"a": hinge.a, "b": hinge.b} | axis
    base = {} if hinge.a == GROUND else {"relative_to": hinge.a}
    return tree | {"link": hinge.b, "along": hinge.axis} | base


def _term_tree(term: DriveTerm) -> Tree:
    """The keys of a drive term, but for its coefficient."""
    key = "along" if term.kind == "translation" else "about"
    tree = {"link": term.link, key: term.direction, "at": term.point}
    return tree if term.base == GROUND else tree | {"relative_to": term.base}


def _sensor_tree(sensor: Sensor) -> Tree:
    """The table [[sensor]] of a sensor."""
    # the default of an acceleration is absolute
    base = {"relative_to": "absolute"} if sensor.absolute else {"relative_to": sensor.term.base}
    return {"name": sensor.name, "kind": sensor.kind} | _term_tree(sensor.term) | base


def _damper_tree(damper: Damper) -> Tree:
    """The table [[damper]] of a dashpot."""
    tree = _term_tree(damper.term) | {"a": damper.term.base, "b": damper.term.link}
    del tree["link"]
    tree.pop("relative_to", None)
    return {"name": damper.name, "damping": damper.damping} | tree


def _stop_tree(stop: Stop) -> Tree:
    """The table [[stop]] of end stops."""
    keys = ("low", "high", *(["softness"] if stop.softness else []))
    limits = {key: value for key in keys if (value := getattr(stop, key)) is not None}
    return _drive_tree(Drive(stop.name, stop.terms)) | limits


def _surface_tree(surface: Surface) -> Tree:
    """The table [[surface]] of a surface."""
    shape = surface.shape
    keys, sizes = CONTACT_SHAPES[shape.kind], dict[str, Any]()
    if "radius" in keys:
        sizes = dict(zip(keys, shape.sizes, strict=True))
    elif keys:
        sizes = {keys[0]: shape.points or shape.sizes}
    tree = {"name": surface.name, "link": surface.link, "shape": shape.kind} | sizes
    return tree | {"at": surface.at, "axis": surface.axis, "toward": surface.toward}


def _cable_tree(cable: Cable, names: _PartNames) -> Tree:
    """The table [[cable]] of a cable."""
    via = [{"link": link, "at": at} for link, at in cable.via]
    return _keys_tree(cable, STATEMENTS["cable"], names) | ({"via": via} if via else {})


def toml_tree_lines(tree: Tree, path: str) -> list[str]:
    """Lines of TOML of the table `path`: values first, then [tables], then [[arrays of tables]]."""
    lines, tables, arrays = [], [], []
    for key, value in tree.items():
        inside = f"{path}.{_toml_key(key)}" if path else _toml_key(key)
        if isinstance(value, dict):
            body = toml_tree_lines(value, inside)
            # a table that holds tables only needs no header of its own
            only_tables = bool(value) and all(isinstance(v, dict) for v in value.values())
            tables += body if only_tables else ["", f"[{inside}]", *body]
        elif isinstance(value, list) and value and all(isinstance(v, dict) for v in value):
            for item in value:
                arrays += ["", f"[[{inside}]]", *toml_tree_lines(item, inside)]
        else:
            lines.append(f"{_toml_key(key)} = {_toml_value(value, key)}")
    return lines + tables + arrays


def _toml_key(key: str) -> str:
    """A key in TOML, quoted if necessary. Raises SceneError."""
    is_bare = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if is_bare else toml_string(key)


def _toml_value(value: Any, key: str) -> str:
    """A value in TOML; `key` names it in messages. Raises SceneError."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return toml_string(value)
    if isinstance(value, int | float):
        # 7800 and 2e+11, where that is the same number
        return min(repr(value), f"{value:g}", key=lambda text: (float(text) != value, len(text)))
    if isinstance(value, tuple | list):
        return f"[{', '.join(_toml_value(v, key) for v in value)}]"
    raise SceneError(f"'{key}' = {show(value)} cannot be written to a scene file.")


def toml_string(text: str) -> str:
    """Text as a basic string of TOML. Raises SceneError."""
    if any("\ud800" <= c <= "\udfff" for c in text):
        raise SceneError(f"the name {show(text)} holds half a character and cannot be written to a file.")
    # a string of JSON is one of TOML, but that TOML escapes DEL, too
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")
