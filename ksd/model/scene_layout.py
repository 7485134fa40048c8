"""A scene taken apart: words, which say what hangs on what, and numbers in a fixed order.

Scenes of equal words differ in numbers alone, and make models of the same unknowns (`ksd.model.template`). A part is a
placed joint, or a free leaf between two links; curved leaves have the amplitudes of their shape among the numbers, those
that are tapered, heated or prestressed all their constants.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ksd.model.arrays import COROTATIONAL, ROTATION, STRAIN, TRANSLATION
from ksd.model.leaves import (
    cut_leaves,
    element_leaves,
    leaf_member,
    leaf_orders,
    piece_name,
    rigidity_factors,
    whole_leaf_name,
)
from ksd.model.mesh import Mesh
from ksd.model.pack import Member
from ksd.model.springs import matrix_member, spring_members
from ksd.scene.hinges import PLANES, plane_supports
from ksd.scene.leaf import LeafCondition

LEAF_NUMBERS = 21
"""Numbers of a leaf: start, end, width axis (3 each), length, E, G, A, J, Iy, Iz, ky, kz, density, factors on GJ, E Iz."""
SPRING_NUMBERS = 26
"""Numbers of a spring beside its constants: ends (2, 3), end frames (2, 3, 3), length, floor."""
GEOMETRY_NUMBERS = 25
"""Numbers of a leaf that brings its constants or its shape, beside these: ends (2, 3), end frames (2, 3, 3), mass."""
COMPARISON_PRECISION = 1e12
"""To one part in how many lengths of leaves, over that of their joint, are compared: leaves drawn alike differ in the last
digits."""


class LeafLayout(NamedTuple):
    """name; blocks at start and end; kind and settings of the member; whether it has weight; group: leaves of one group have
    the same constants; given: (constants, inner state), how many numbers it brings, None where they follow from LEAF; bent:
    modes about each axis of the amplitudes at rest that a leaf brings whose other constants follow."""

    name: str
    ends: tuple[str, str]
    kind: int
    number: tuple[int, ...]
    has_weight: bool
    group: int
    explicit: tuple[int, int] | None = None
    amplitudes: tuple[int, ...] = ()

    @property
    def explicit_count(self) -> int:
        """How many numbers beside LEAF."""
        own = self.explicit or self.amplitudes
        return GEOMETRY_NUMBERS + sum(own) if own else 0


class PartLayout(NamedTuple):
    """family, "" for a free leaf; name and kind of every intended motion; internal blocks; leaves."""

    family: str
    motions: tuple[tuple[str, str], ...]
    blocks: tuple[str, ...]
    leaves: tuple[LeafLayout, ...]


class SceneLayout(NamedTuple):
    """What scenes have in common that make models of the same unknowns.

    parts: (what stands before the names of its blocks and leaves, link at A, link at B, number in `different`), the placed
    joints first; joints: their names. rows: (kind, base, link) of every term of drives, then supports; loads: (link,
    following, whether its tangent has a skew part); springs: (name, kind, links, constants); pulls: there is gravity.
    """

    links: tuple[str, ...]
    joints: tuple[str, ...]
    parts: tuple[tuple[str, int, int, int], ...]
    distinct_parts: tuple[PartLayout, ...]
    rows: tuple[tuple[tuple[int, int, int], ...], ...]
    drives: tuple[str, ...]
    supports: tuple[str, ...]
    loads: tuple[tuple[int, bool, bool], ...]
    springs: tuple[tuple[str, int, tuple[int, int], int], ...]
    has_gravity: bool


@dataclass(frozen=True)
class SplitScene:
    """Words and numbers (flat, see `Numbers`) of a scene; joints: the different ones, in the order of `Words.different`."""

    layout: SceneLayout
    numbers: list[float]
    joints: tuple[Any, ...]


class SceneNumbers(NamedTuple):
    """The numbers of D scenes of equal words.

    origin (D, P, 3), rotation (D, P, 3, 3): of the parts; length (D, U), ends (D, U, 2, 3): of the different ones, and their
    points A and B; point (D, B, 3): internal blocks; leaf (D, F, LEAF); terms (D, T, 7): coefficient, direction and point;
    loads (D, L, 9): place, force, moment; gravity (D, 3); springs, given (D, ..): of all springs, and of leaves that bring
    their constants.
    """

    origin: np.ndarray
    rotation: np.ndarray
    length: np.ndarray
    interfaces: np.ndarray
    point: np.ndarray
    leaf: np.ndarray
    terms: np.ndarray
    loads: np.ndarray
    gravity: np.ndarray
    springs: np.ndarray
    explicit: np.ndarray


def number_slices(layout: SceneLayout) -> tuple[tuple[slice, tuple[int, ...]], ...]:
    """Where each field of `Numbers` is among the numbers of a scene of these words, and its shape; `given` is the rest."""
    leaves = sum(len(p.leaves) for p in layout.distinct_parts)
    shapes: tuple[tuple[int, ...], ...] = (
        (len(layout.parts), 3), (len(layout.parts), 3, 3), (len(layout.distinct_parts),), (len(layout.distinct_parts), 2, 3),
        (sum(len(p.blocks) for p in layout.distinct_parts), 3), (leaves, LEAF_NUMBERS), (sum(map(len, layout.rows)), 7),
        (len(layout.loads), 9), (3,), (sum(SPRING_NUMBERS + s[3] for s in layout.springs),),
    )  # fmt: skip
    found, at = [], 0
    for shape in shapes:
        end = at + math.prod(shape)
        found.append((slice(at, end), shape))
        at = end
    return (*found, (slice(at, None), (-1,)))


class _Parts:
    """Words and numbers of parts while they are collected."""

    def __init__(self, mesh: Mesh, heavy: bool, free: Container[str]) -> None:
        self.mesh, self.heavy, self.free = mesh, heavy, free
        self.different: list[PartLayout] = []
        self.length: list[float] = []
        self.ends: list[float] = []
        self.point: list[float] = []
        self.leaf: list[float] = []
        self.given: list[float] = []
        self.groups: dict[Any, int] = {}

    def add(
        self, joint: Any, leaves: Iterable[tuple[str, Any]], before: str, ends: tuple[Any, Any], length: float
    ) -> None:
        """A joint, or (None) a free leaf or a piece of one, with its leaves by name; before: what their full names begin
        with."""
        blocks = {} if joint is None else {n: p for n, p in joint.blocks().items() if n not in ("A", "B")}
        for point in blocks.values():
            self.point += point
        names, found = list(blocks), []
        for name, leaf in leaves:
            full = before + name
            mesh = self.mesh.of(full, "" if joint is not None else whole_leaf_name(name, self.free))
            own = (leaf.start_block, leaf.end_block) if joint is not None else ("A", "B")
            if not mesh.nodal:
                found.append(self._leaf(leaf, mesh, (before, name), own, length))
                continue
            # every element a leaf of its own, between nodes that are drawn as blocks
            pieces = element_leaves(leaf, leaf.elements or mesh.elements)
            between = [piece_name(name, k) for k in range(len(pieces) - 1)]
            names += between
            for piece in pieces[:-1]:
                self.point += piece.end
            pairs = pairwise([own[0], *between, own[1]])
            for k, (piece, pair) in enumerate(zip(pieces, pairs, strict=True)):
                found.append(self._leaf(piece, mesh, (before, piece_name(name, k)), pair, length))
        self.length.append(length)
        for end in ends:
            self.ends += end
        motions = () if joint is None else tuple((m.name, m.kind) for m in joint.motions)
        family = "" if joint is None else joint.family
        self.different.append(PartLayout(family, motions, tuple(names), tuple(found)))

    def _leaf(
        self, leaf: Any, mesh: Mesh, name: tuple[str, str], ends: tuple[str, str], length: float
    ) -> LeafLayout:
        """Words of a leaf, name in two parts; its numbers are put down."""
        section, material, state = leaf.section, leaf.material, leaf.condition
        torsion, plate = rigidity_factors(section, leaf, mesh)
        long, density = leaf.length, material.density or 0.0
        has_weight = self.heavy and density > 0.0
        size = (
            material.E, material.G, section.A, section.J, section.Iy, section.Iz, section.ky, section.kz, density,
        )  # fmt: skip
        self.leaf += (*leaf.start, *leaf.end, *leaf.width_axis, long, *size, torsion, plate)
        key: tuple[Any, ...] = (round(COMPARISON_PRECISION * long / length), length, size, has_weight)
        if torsion != 1.0 or plate != 1.0:
            key += (round(COMPARISON_PRECISION * torsion), round(COMPARISON_PRECISION * plate))
        if leaf.profile is not None or leaf.curve is not None or not (state is None or _as_drawn(state)):
            made = leaf_member(leaf, mesh, name="".join(name), heavy=has_weight)
            return self._given(leaf, made, LeafLayout(name[1], ends, made.kind, (), has_weight, 0), key)
        number: tuple[int, ...]
        if mesh.leaf == "strain":
            orders, points = leaf_orders(leaf, mesh)
            kind, number = STRAIN, (*orders, points)
        else:
            kind, number = COROTATIONAL, (leaf.elements or mesh.elements, int(mesh.mip))
        return LeafLayout(name[1], ends, kind, number, has_weight, self._group(*key, kind, number))

    def _given(self, leaf: Any, made: Member, words: LeafLayout, key: tuple[Any, ...]) -> LeafLayout:
        """Words of a leaf that brings its shape, or all its constants; key: what constants that follow depend on."""
        self.given += [*made.offset.ravel().tolist(), *made.frame.ravel().tolist(), made.mass]
        number = tuple(made.number.tolist())
        uniform = made.kind == STRAIN and leaf.profile is None and leaf.orders is None
        if uniform and (leaf.condition is None or leaf.condition.stretch == 1.0):
            bent = made.inner[:-6].tolist()
            self.given += bent
            group = self._group(*key, number, tuple(bent))
            return words._replace(number=number, group=group, amplitudes=number[:3])
        self.given += [*made.inner.tolist(), *made.value.tolist()]
        group = self._group(made.kind, number, made.value.tobytes())
        return words._replace(number=number, group=group, explicit=(len(made.value), len(made.inner)))

    def _group(self, *constants: Any) -> int:
        """The group of leaves with these constants, by what they depend on."""
        return self.groups.setdefault(constants, len(self.groups))


def _as_drawn(state: LeafCondition) -> bool:
    """Whether a leaf in this condition is free of stress as drawn."""
    return (
        state.stretch == 1.0
        and state.natural_curvature == 0.0
        and not any(state.shift)
        and not any(state.turn)
    )


_STILL = (0.0, 0.0, 0.0)
_AXES = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def split_scene(scene: Any, mesh: Mesh) -> SplitScene:
    """Words and numbers of a frozen scene exactly as it stands. Raises SceneError for leaves that have no model."""
    index = {link: i for i, link in enumerate(scene.links)}
    parts = _Parts(mesh, has_gravity(scene), {free.name for free in scene.leaves})
    known: dict[Any, int] = {}
    placed_parts: list[tuple[str, int, int, int]] = []
    places: list[float] = []
    turns: list[float] = []
    joints: list[Any] = []
    plain = type(mesh).of is Mesh.of
    for placed in scene.joints:
        joint, before = placed.joint, f"{placed.name}/"
        key = (id(joint), placed.conditions, "" if plain else before)
        u = known.setdefault(key, len(joints))
        if u == len(joints):
            joints.append(joint)
            own = ((leaf.name, leaf) for leaf in placed.leaves())
            parts.add(joint, own, before, (_STILL, joint.pose_B), joint.length)
        placed_parts.append((before, index[placed.a], index[placed.b], u))
        places += placed.origin
        for row in placed.rotation:
            turns += row
    for name, a, b, leaf in cut_leaves(scene):
        placed_parts.append(("", index[a], index[b], len(parts.different)))
        parts.add(None, ((name, leaf),), "", (leaf.start, leaf.end), leaf.length)
        places += _STILL
        turns += _AXES
    rows, terms = _rows(scene, index)
    loads, pushed = _loads(scene, index)
    springs = elastic_members(scene, np.zeros((len(index), 3)))
    layout = SceneLayout(
        scene.links, tuple(p.name for p in scene.joints), tuple(placed_parts), tuple(parts.different), rows,
        tuple(d.name for d in scene.drives), tuple(s.name for s in scene.supports), loads,
        tuple((s.name, s.kind, s.nodes, len(s.value)) for s in springs), parts.heavy,
    )  # fmt: skip
    numbers = [
        *places, *turns, *parts.length, *parts.ends, *parts.point, *parts.leaf, *terms, *pushed,
        *(scene.gravity or _STILL), *_spring_numbers(springs), *parts.given,
    ]  # fmt: skip
    return SplitScene(layout, numbers, tuple(joints))


def has_gravity(scene: Any) -> bool:
    """Whether the scene has gravity, so that leaf springs of known density have weight."""
    return scene.gravity is not None and any(scene.gravity)


def _rows(scene: Any, index: dict[str, int]) -> tuple[tuple[Any, ...], list[float]]:
    """Words and numbers of drives and supports."""
    words: list[tuple[tuple[int, int, int], ...]] = []
    numbers: list[float] = []
    for row in (*scene.drives, *scene.supports):
        words.append(
            tuple(
                (ROTATION if t.kind == "rotation" else TRANSLATION, index[t.base], index[t.link])
                for t in row.terms
            )
        )
        for t in row.terms:
            numbers += (t.coefficient, *t.direction, *t.point)
    return tuple(words), numbers


def _loads(scene: Any, index: dict[str, int]) -> tuple[tuple[Any, ...], list[float]]:
    """Words and numbers of the loads on links that move; gravity acts at the centre of every mass the scene names."""
    words: list[tuple[int, bool, bool]] = []
    numbers: list[float] = []
    # a link that only turns about the normal of its plane stores what a moment about it does
    flat = {t.link for s in plane_supports(scene) for t in s.terms}
    across = [k for k in range(3) if scene.plane is None or k != PLANES[scene.plane]]
    for load in scene.loads:
        node = index[load.link]
        if node:
            following = bool(load.following)
            out = load.link not in flat or any(load.moment[k] for k in across)
            words.append((node, following, following or (out and any(load.moment))))
            numbers += (*load.at, *load.force, *load.moment)
    for mass in scene.masses if scene.gravity is not None else ():
        node = index[mass.link]
        if node:
            words.append((node, False, False))
            numbers += (*mass.at, *(mass.mass * g for g in scene.gravity), 0.0, 0.0, 0.0)
    return tuple(words), numbers


def elastic_members(scene: Any, places: np.ndarray) -> list[Member]:
    """Springs of a scene and its links with a matrix, between links at reference `places`; empty where it has none."""
    links = [c for c in scene.compliances if c.matrix is not None and f"{c.link}/2" in scene.links]
    if not scene.springs and not links:
        return []
    index = {link: i for i, link in enumerate(scene.links)}
    found = spring_members(scene.springs, index, places)
    for c in links:
        nodes = (index[c.link], index[f"{c.link}/2"])
        found.append(matrix_member(c.link, c.matrix, nodes, places, np.asarray(c.width_axis)))
    return found


def _spring_numbers(springs: Sequence[Member]) -> list[float]:
    """Numbers of springs whose ends are given from the origin."""
    found: list[float] = []
    for s in springs:
        found += [
            *s.offset.ravel().tolist(),
            *s.frame.ravel().tolist(),
            s.length,
            s.stiffness_scale,
            *s.value.tolist(),
        ]
    return found
