"""What a scene says, apart: its words (who hangs on whom), and its numbers in a fixed order."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any

import numpy as np

from ksd.scene.joint import leafs_of

LEAF = 18
"""Numbers of a leaf: start, end, width axis (3 each), length, E, G, A, J, Iy, Iz, ky, kz."""


@dataclass(frozen=True)
class Drawing:
    """A scene of joints alone. words: equal for scenes that differ in numbers only; joints: those placed, each once;
    numbers: see `Numbers`."""

    words: tuple[Any, ...]
    joints: tuple[Any, ...]
    numbers: list[float]


@dataclass(frozen=True)
class Numbers:
    """The numbers of D scenes of equal words.

    origin (D, J, 3), rotation (D, J, 3, 3): of the placed joints; length (D, U), tip (D, U, 3): of the different joints
    and their interface B; point (D, P, 3): their internal blocks; leaf (D, F, LEAF): their leafs; terms (D, T, 7):
    coefficient, direction and point of every term of drives and supports; loads (D, L, 9): place, force, moment.
    """

    origin: np.ndarray
    rotation: np.ndarray
    length: np.ndarray
    tip: np.ndarray
    point: np.ndarray
    leaf: np.ndarray
    terms: np.ndarray
    loads: np.ndarray


def drawing(scene: Any) -> Drawing | None:
    """The drawing of a scene; None for one that has more than joints of straight uniform leafs, drives and dead loads."""
    extra = (scene.leafs, scene.springs, scene.compliances, scene.heats, scene.fits, scene.consider)
    if any(extra) or scene.gravity is not None or not scene.joints:
        return None
    known: dict[int, int] = {}
    joints: list[Any] = []
    words: list[Any] = [scene.links]
    places: list[float] = []
    turns: list[float] = []
    for placed in scene.joints:
        if placed.conditions:
            return None
        u = known.setdefault(id(placed.joint), len(joints))
        if u == len(joints):
            joints.append(placed.joint)
        words.append((placed.name, placed.a, placed.b, u))
        places += placed.origin
        for row in placed.rotation:
            turns += row
    inside = _joints(joints)
    if inside is None:
        return None
    said, numbers = inside
    driven, rows = _rows(scene)
    return Drawing((*words, *said, *driven), tuple(joints), [*places, *turns, *numbers, *rows])


def _joints(joints: Sequence[Any]) -> tuple[list[Any], list[float]] | None:
    """Words and numbers of the different joints."""
    words: list[Any] = []
    lengths: list[float] = []
    tips: list[float] = []
    points: list[float] = []
    leafs: list[float] = []
    alike: dict[tuple[Any, ...], int] = {}
    for joint in joints:
        blocks = joint.blocks()
        words.append((joint.family, tuple((m.name, m.kind) for m in joint.motions), tuple(blocks)))
        lengths.append(joint.length)
        tips += joint.pose_B
        for name, point in blocks.items():
            if name not in ("A", "B"):
                points += point
        for leaf in leafs_of(joint):
            if leaf.profile is not None or leaf.curve is not None or leaf.condition is not None:
                return None
            q, m = leaf.section, leaf.material
            size = (leaf.length, m.E, m.G, q.A, q.J, q.Iy, q.Iz, q.ky, q.kz)
            mesh = (leaf.elements, leaf.orders)
            # leafs of equal constants share them in the arrays of a model
            group = alike.setdefault((*size, *mesh), len(alike))
            words.append((leaf.name, leaf.start_block, leaf.end_block, mesh, group))
            leafs += [*leaf.start, *leaf.end, *(leaf.width_axis or ()), *size]
    return words, [*lengths, *tips, *points, *leafs]


def _rows(scene: Any) -> tuple[list[Any], list[float]]:
    """Words and numbers of drives, supports and loads."""
    words: list[Any] = []
    numbers: list[float] = []
    for kind, rows in (("drive", scene.drives), ("support", scene.supports)):
        for row in rows:
            words.append((kind, row.name, tuple((t.kind, t.base, t.link) for t in row.terms)))
            for t in row.terms:
                numbers += (t.coefficient, *t.direction, *t.point)
    for load in scene.loads:
        words.append(("load", load.link, bool(load.following)))
        numbers += (*load.at, *load.force, *load.moment)
    return words, numbers


def numbers_of(scene: Any, joints: Sequence[Any], rows: Sequence[list[float]]) -> Numbers:
    """The numbers of scenes with the words of `scene`, whose different joints are `joints`; rows: one per scene."""
    table = np.array(rows, float).reshape(len(rows), -1)
    terms = sum(len(r.terms) for r in (*scene.drives, *scene.supports))
    blocks = sum(len(j.blocks()) - 2 for j in joints)
    leafs = sum(len(leafs_of(j)) for j in joints)
    shapes = {
        "origin": (len(scene.joints), 3), "rotation": (len(scene.joints), 3, 3), "length": (len(joints),),
        "tip": (len(joints), 3), "point": (blocks, 3), "leaf": (leafs, LEAF), "terms": (terms, 7),
        "loads": (len(scene.loads), 9),
    }  # fmt: skip
    ends = np.cumsum([int(np.prod(s)) for s in shapes.values()]).tolist()
    parts = [
        table[:, a:b].reshape(len(rows), *shape)
        for a, b, shape in zip([0, *ends[:-1]], ends, shapes.values(), strict=True)
    ]
    return Numbers(*parts)


def blocks_of(joints: Sequence[Any]) -> list[tuple[int, str]]:
    """(joint, name) of every internal block, in the order of `Numbers.point`."""
    return list(
        chain.from_iterable(
            ((u, name) for name in joint.blocks() if name not in ("A", "B")) for u, joint in enumerate(joints)
        )
    )
