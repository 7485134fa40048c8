"""Springs, elastic links, heat and fits in scene files, in the words of `Mechanism`.

consider = ["warping", "plate"]
[material.steel]    ... expansion = 12e-6
[[spring]]          a, b, start, end, stiffness, free_length
[[joint_spring]]    joint, stiffness, rest_angle, motion
[[turn_spring]]     a, b, at, axis, stiffness, rest_angle
[[compliance]]      link, section and material (hub, width_axis); or matrix = "file.npz" or "file.h5"
[[heat]]            temperature, through, leafs = ["joint/leaf", ...]
[[fit]]             leaf, natural_length, shift, turn
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from ksd.errors import SceneError
from ksd.scene.contents import Scene
from ksd.scene.effects import LinkMatrix, Spring
from ksd.scene.mechanism import Mechanism
from ksd.scene.toml_table import Table, placed_at
from ksd.section.checks import show

Tree = dict[str, Any]


def read_effects(
    mechanism: Mechanism, top: Table, folder: Path, parts: Mapping[str, Mapping[str, Any]]
) -> None:
    """All of it from the tables of a scene file; parts: its "section"s and "material"s by name."""
    consider = top.take("consider", [])
    if not isinstance(consider, list):
        raise SceneError(f"{top.where}: consider = {show(consider)} must be a list of effects.")
    with placed_at(top.where):
        mechanism.consider(*consider)
    for table in top.tables("spring"):
        _say(table, partial(mechanism.spring, table.text("a"), table.text("b")), _spring(table))
    for table in top.tables("joint_spring"):
        _say(table, partial(mechanism.joint_spring, table.text("joint")), _turning(table, joint=True))
    for table in top.tables("turn_spring"):
        _say(table, partial(mechanism.turn_spring, table.text("a"), table.text("b")), _turning(table))
    for table in top.tables("compliance"):
        _say(table, partial(mechanism.compliance, table.text("link")), _compliance(table, folder, parts))
    for table in top.tables("heat"):
        words = {key: table.quantity(key, "number", 0.0) for key in ("temperature", "through")}
        _say(table, mechanism.heat, words | {"leafs": table.take("leafs", None)})
    for table in top.tables("fit"):
        words = {
            "natural_length": table.quantity("natural_length", "length", None),
            "shift": table.quantities("shift", "length", (0.0, 0.0, 0.0)),
            "turn": table.quantities("turn", "angle", (0.0, 0.0, 0.0)),
        }
        _say(table, partial(mechanism.fit, table.text("leaf")), words)


def _say(table: Table, say: Callable[..., Any], words: dict[str, Any]) -> None:
    """Refuse unknown keys, then say the sentence; its errors get file and table in front."""
    table.finish()
    with placed_at(table.where):
        say(**words)


def _spring(table: Table) -> dict[str, Any]:
    return {
        "start": table.quantities("start", "length"),
        "end": table.quantities("end", "length"),
        "stiffness": table.quantity("stiffness", "number"),
        "free_length": table.quantity("free_length", "length", None),
        "name": table.text("name", None),
    }


def _turning(table: Table, *, joint: bool = False) -> dict[str, Any]:
    words = {
        "stiffness": table.quantity("stiffness", "number"),
        "rest_angle": table.quantity("rest_angle", "angle", 0.0),
        "name": table.text("name", None),
    }
    if joint:
        return words | {"motion": table.text("motion", None)}
    return words | {"at": table.quantities("at", "length"), "axis": table.direction("axis")}


def _compliance(table: Table, folder: Path, parts: Mapping[str, Mapping[str, Any]]) -> dict[str, Any]:
    words: dict[str, Any] = {
        "hub": table.quantities("hub", "length", None),
        "width_axis": table.direction("width_axis", None),
    }
    for kind in ("section", "material"):
        words[kind] = parts[kind][table.name_of(kind, parts[kind], kind)] if kind in table else None
        table.take(kind, None)
    file = table.text("matrix", None)
    points, stiffness = table.take("points", None), table.take("stiffness", None)
    with placed_at(table.where):
        if file is not None:
            words["matrix"] = folder / file
        elif points is not None or stiffness is not None:
            words["matrix"] = LinkMatrix(points or (), stiffness or ())  # type: ignore[arg-type]
    return words


def effects_tree(scene: Scene, names: Any) -> Tree:
    """The same as tables to be written; names: gives materials and sections their names."""
    tree: Tree = {"consider": list(scene.consider)}
    springs: dict[str, list[Tree]] = {"spring": [], "turn_spring": []}
    for s in scene.springs:
        own: Tree = {"name": s.name, "a": s.a, "b": s.b, "stiffness": s.stiffness}
        if isinstance(s, Spring):
            springs["spring"].append(own | {"start": s.start, "end": s.end, "free_length": s.free_length})
        else:
            springs["turn_spring"].append(own | {"at": s.at, "axis": s.axis, "rest_angle": s.rest_angle})
    tree |= springs
    tree["compliance"] = [_compliance_tree(c, names) for c in scene.compliances]
    tree["heat"] = [
        {"temperature": h.temperature, "through": h.through}
        | ({} if h.leafs is None else {"leafs": list(h.leafs)})
        for h in scene.heats
    ]
    tree["fit"] = [
        {"leaf": f.leaf, "shift": f.shift, "turn": f.turn}
        | ({} if f.natural_length is None else {"natural_length": f.natural_length})
        for f in scene.fits
    ]
    return {key: value for key, value in tree.items() if value}


def _compliance_tree(said: Any, names: Any) -> Tree:
    tree: Tree = {"link": said.link}
    if said.matrix is not None:
        tree |= {"points": said.matrix.points, "stiffness": said.matrix.stiffness}
    else:
        tree |= {"section": names.section(said.section), "material": names.material(said.material)}
    for key in ("hub", "width_axis"):
        if getattr(said, key) is not None:
            tree[key] = getattr(said, key)
    return tree
