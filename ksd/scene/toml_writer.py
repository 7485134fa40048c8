"""Writing a scene as TOML in the words `load_scene` reads; numbers are SI with all digits."""

from __future__ import annotations

import inspect
import os
from collections.abc import Mapping
from typing import Any

import numpy as np

from ksd.errors import SceneError
from ksd.files import write_file
from ksd.scene.contents import PlacedJoint, PlacedLeaf, Scene
from ksd.scene.drive import GROUND, Drive, DriveTerm
from ksd.scene.families import joint_families
from ksd.scene.joint import DrawnJoint, Joint
from ksd.scene.leaf import Leaf
from ksd.scene.material import Material
from ksd.scene.mechanism import Mechanism
from ksd.scene.placing import numbered
from ksd.scene.toml_effects import effects_tree
from ksd.section import Section, circle, rectangle
from ksd.section.checks import number, show

Tree = dict[str, Any]


def save_scene(
    mechanism: Mechanism | Scene,
    path: str | os.PathLike[str],
    *,
    targets: Mapping[str, float] | None = None,
    options: Mapping[str, Any] | None = None,
) -> None:
    """Write a scene file (UTF-8) that `load_scene` reads back into an equal scene, with equal fingerprint.

    targets: {drive: value in SI}; options: contents of [options]. Raises SceneError for an incomplete scene,
    a leaf with a profile or a curve or a joint of no known family (neither can be written), or a target of no
    drive.
    """
    scene = mechanism.scene() if isinstance(mechanism, Mechanism) else mechanism
    tree = _scene_tree(scene, dict(targets or {}))
    if options:
        tree["options"] = dict(options)
    text = "\n".join(_lines(tree, ""))
    write_file(path, text.lstrip("\n") + "\n", what="scene file")


def _scene_tree(scene: Scene, targets: dict[str, float]) -> Tree:
    names = _Names()
    tree: Tree = {"name": scene.name, "links": list(scene.links[1:])}
    if scene.gravity is not None:
        tree["gravity"] = scene.gravity
    joins = [_join(j, names) for j in scene.joints]
    leafs = [_placed_leaf(leaf, names) for leaf in scene.leafs]
    effects = effects_tree(scene, names)
    drives = [_drive(d) | _value(d.name, targets) for d in scene.drives]
    if targets:
        raise SceneError(f"target '{next(iter(targets))}' belongs to no drive of '{scene.name}'.")
    tree |= {"material": names.trees("material"), "section": names.trees("section")}
    tree |= {"joint": names.trees("joint"), "join": joins, "leaf": leafs, "actuate": drives}
    tree["support"] = [_drive(s) for s in scene.supports]
    tree["load"] = [
        {"name": p.name, "link": p.link, "force": p.force, "moment": p.moment, "at": p.at}
        | {"following": p.following}
        for p in scene.loads
    ]
    tree["mass"] = [{"link": m.link, "mass": m.mass, "inertia": m.inertia, "at": m.at} for m in scene.masses]
    # plain values before tables
    consider = {"consider": effects.pop("consider")} if "consider" in effects else {}
    tree = consider | tree | effects
    return {key: value for key, value in tree.items() if value not in ({}, [])}


def _value(name: str, targets: dict[str, float]) -> Tree:
    return {"value": number(targets.pop(name), f"target '{name}'")} if name in targets else {}


class _Names:
    """Materials, sections and joints met so far, each written once under its own name."""

    def __init__(self) -> None:
        self._met: dict[str, dict[Any, tuple[str, Tree]]] = {"material": {}, "section": {}, "joint": {}}

    def trees(self, kind: str) -> Tree:
        return dict(self._met[kind].values())

    def name(self, kind: str, value: Any, wish: str) -> str:
        met = self._met[kind]
        if value not in met:
            label = numbered(wish or kind, {name for name, _ in met.values()})
            met[value] = (label, self._tree(kind, value, label))
        return met[value][0]

    def _tree(self, kind: str, value: Any, label: str) -> Tree:
        if kind == "material":
            return _material(value, label)
        return _section(value) if kind == "section" else _joint(value, self)

    def material(self, material: Material) -> str:
        return self.name("material", material, material.name)

    def section(self, section: Section) -> str:
        return self.name("section", section, section.name)


def _material(material: Material, label: str) -> Tree:
    tree: Tree = {"E": material.E, "G": material.G}
    for key in ("density", "expansion", "yield_stress", "fatigue_limit"):
        if getattr(material, key) is not None:
            tree[key] = getattr(material, key)
    return tree if material.name == label else tree | {"name": material.name}


def _section(section: Section) -> Tree:
    """Short where a closed form gives exactly this section, else all its numbers."""
    t, w, name = section.thickness, section.width, section.name
    if t > 0.0 and w > 0.0:
        if section == rectangle(t, w, name=name):
            return {"kind": "rectangle", "thickness": t, "width": w, "name": name}
        if section == circle(w, name=name):
            return {"kind": "circle", "diameter": w, "name": name}
    keys = ("A", "J", "Iy", "Iz", "ky", "kz", "Iw", "width", "thickness", "shear_centre", "tilt", "name")
    tree: Tree = {"kind": "numbers"} | {key: getattr(section, key) for key in keys}
    return tree if section.outline is None else tree | {"outline": section.outline}


def _joint(joint: Joint, names: _Names) -> Tree:
    if isinstance(joint, DrawnJoint):
        return _drawn(joint, names)
    family = joint_families().get(joint.family)
    if family is not type(joint):
        raise SceneError(
            f"joint family '{joint.family}' is not registered, so it cannot be written to a file."
        )
    tree: Tree = {"family": joint.family}
    for key in inspect.signature(family).parameters:
        value = getattr(joint, key, None)
        if value is not None:
            tree[key] = names.material(value) if isinstance(value, Material) else value
    return tree


def _drawn(joint: DrawnJoint, names: _Names) -> Tree:
    tree: Tree = {"family": "drawn", "name": joint.name, "length": joint.length, "blocks": joint.blocks()}
    if joint.shape():
        tree["shape"] = joint.shape()
    tree |= {key: True for key in ("windows", "held_by_others") if getattr(joint, key)}
    tree["leaf"] = [
        {"start_block": leaf.start_block, "end_block": leaf.end_block} | _leaf(leaf, names)
        for leaf in joint.leafs()
    ]
    tree["motion"] = [
        {"name": m.name, "kind": m.kind, "axis": m.axis, "range": m.range}
        | ({} if m.point is None else {"point": m.point})
        for m in joint.motions
    ]
    return tree


def _leaf(leaf: Leaf, names: _Names) -> Tree:
    for key in ("profile", "curve"):
        if getattr(leaf, key) is not None:
            raise SceneError(
                f"leaf '{leaf.name}': a leaf with a {key} cannot be written to a file; keep it in Python."
            )
    tree: Tree = {"name": leaf.name, "start": leaf.start, "end": leaf.end, "width_axis": leaf.width_axis}
    tree |= {"section": names.section(leaf.section), "material": names.material(leaf.material)}
    for key in ("elements", "orders"):
        if getattr(leaf, key) is not None:
            tree[key] = getattr(leaf, key)
    return tree


def _placed_leaf(placed: PlacedLeaf, names: _Names) -> Tree:
    return {"a": placed.a, "b": placed.b} | _leaf(placed.leaf, names)


def _join(placed: PlacedJoint, names: _Names) -> Tree:
    axes = np.asarray(placed.rotation).T.tolist()
    kind = names.name("joint", placed.joint, placed.joint.family)
    tree = {"name": placed.name, "a": placed.a, "b": placed.b, "joint": kind}
    return tree | {"at": placed.origin, "axis": axes[2], "toward": axes[0]}


def _drive(drive: Drive) -> Tree:
    if len(drive.terms) == 1 and drive.terms[0].coefficient == 1.0:
        return {"name": drive.name} | _term(drive.terms[0])
    return {
        "name": drive.name,
        "terms": [{"coefficient": t.coefficient} | _term(t) for t in drive.terms],
    }


def _term(term: DriveTerm) -> Tree:
    key = "along" if term.kind == "translation" else "about"
    tree = {"link": term.link, key: term.direction, "at": term.point}
    return tree if term.base == GROUND else tree | {"relative_to": term.base}


def _lines(tree: Tree, path: str) -> list[str]:
    """TOML of a table: plain values first, then [tables], then [[arrays of tables]]."""
    lines, tables, arrays = [], [], []
    for key, value in tree.items():
        inside = f"{path}.{_key(key)}" if path else _key(key)
        if isinstance(value, dict):
            body = _lines(value, inside)
            # a table that holds nothing but tables needs no heading of its own
            only_tables = bool(value) and all(isinstance(v, dict) for v in value.values())
            tables += body if only_tables else ["", f"[{inside}]", *body]
        elif isinstance(value, list) and value and all(isinstance(v, dict) for v in value):
            for item in value:
                arrays += ["", f"[[{inside}]]", *_lines(item, inside)]
        else:
            lines.append(f"{_key(key)} = {_plain(value, key)}")
    return lines + tables + arrays


def _key(key: str) -> str:
    bare = key.isascii() and key.replace("_", "").replace("-", "").isalnum()
    return key if bare else _quoted(key)


def _plain(value: Any, key: str) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return _quoted(value)
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, tuple | list):
        return f"[{', '.join(_plain(v, key) for v in value)}]"
    raise SceneError(f"'{key}' = {show(value)} cannot be written to a scene file.")


def _quoted(text: str) -> str:
    """A TOML basic string."""
    if any("\ud800" <= c <= "\udfff" for c in text):
        raise SceneError(f"the name {show(text)} holds half a character and cannot be written to a file.")
    marks = {'"': '\\"', "\\": "\\\\"}
    return (
        '"' + "".join(marks.get(c, f"\\u{ord(c):04x}" if c < " " or c == "\x7f" else c) for c in text) + '"'
    )
