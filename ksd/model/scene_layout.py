"""Split of a scene into its layout, which gives the connections, and its numbers in a fixed order.

Scenes with equal layouts differ in numbers only and give models with the same unknowns (`ksd.model.template`). A part is a
placed joint, or a free leaf between two links. Most constants of a leaf follow from its LEAF_NUMBERS. Curved leaves have the
amplitudes of their undeformed shape among the explicit numbers; tapered, heated and prestressed leaves, and those that
clamps stiffen, have all their constants there.
"""

from __future__ import annotations

import math
from collections.abc import Container, Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ksd.elements.pressure import GIVEN_MODES, PRESSURE_MODES
from ksd.errors import SceneError
from ksd.model.arrays import ALIGNMENT, COROTATIONAL, ROTATION, STRAIN, TRANSLATION
from ksd.model.leaves import (
    cut_leaves,
    element_leaves,
    leaf_member,
    leaf_orders,
    loads_of_pieces,
    piece_name,
    restrained_twist,
    whole_leaf_name,
)
from ksd.model.mesh import Mesh
from ksd.model.pack import Member
from ksd.model.springs import matrix_member, spring_members
from ksd.scene.drive import DriveTerm
from ksd.scene.hinges import PLANES, plane_supports
from ksd.scene.leaf import LeafCondition
from ksd.scene.obstacle import refuse_contacts

LEAF_NUMBERS, LEAF_E, LEAF_IZ = 19, 10, 15
"""Count of the numbers of a leaf: start, end, width axis (3 each), length, E, G, A, J, Iy, Iz, ky, kz, density; and the
columns of E and Iz."""
SPRING_NUMBERS = 26
"""Count of the numbers of a spring before its constants: ends (2, 3), end frames (2, 3, 3), length, stiffness scale."""
PUSH_NUMBERS = 7
"""Count of the numbers of the loads along a leaf, see `ksd.model.leaves.loads_of_pieces`."""
GEOMETRY_NUMBERS = 25
"""Count of the explicit numbers of a leaf before its constants or amplitudes: ends (2, 3), end frames (2, 3, 3), mass."""
COMPARISON_PRECISION = 1e12
"""Lengths of leaves over that of their joint are compared after rounding to 1 / COMPARISON_PRECISION, as equal leaves may
differ in the last digits."""


class LeafLayout(NamedTuple):
    """A leaf of a part: its connections and everything else about it that is not a number.

    ends: names of the blocks at start and end; kind, number: kind and settings of the member; group: leaves of one group
    have the same constants, each part has groups of its own. explicit: lengths of the constants and of the inner state where
    they are explicit numbers, None where they follow from LEAF_NUMBERS. amplitudes: number of modes about each axis where
    only the amplitudes of the undeformed shape are explicit.
    """

    name: str
    ends: tuple[str, str]
    kind: int
    number: tuple[int, ...]
    has_weight: bool
    group: int
    explicit: tuple[int, int] | None = None
    amplitudes: tuple[int, ...] = ()

    @property
    def load_modes(self) -> int:
        """Number of the modes of its distributed loads, where there are more than its weight."""
        return self.number[5] if self.kind == STRAIN and len(self.number) > 5 else 0

    @property
    def explicit_count(self) -> int:
        """Count of its explicit numbers."""
        own = self.explicit or self.amplitudes
        return GEOMETRY_NUMBERS + sum(own) if own else 0


class PartLayout(NamedTuple):
    """A part: family of the joint, "" for a free leaf; (name, kind) of every intended motion; internal blocks; leaves."""

    family: str
    motions: tuple[tuple[str, str], ...]
    blocks: tuple[str, ...]
    leaves: tuple[LeafLayout, ...]


class SceneLayout(NamedTuple):
    """The connections of a scene; scenes with equal layouts give models with the same unknowns.

    parts: (prefix of the names of its blocks and leaves, link at A, link at B, index in `distinct_parts`), placed joints
    first; joints: names of the placed joints. rows: (kind, base, link) of every term of drives, then of supports; loads:
    (link, whether it follows its link, whether its tangent has a skew part); springs: (name, kind, links, count of
    constants).
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
    """Layout and flat numbers (see `SceneNumbers`) of a scene; joints: in the order of `SceneLayout.distinct_parts`."""

    layout: SceneLayout
    numbers: list[float]
    joints: tuple[Any, ...]


class SceneNumbers(NamedTuple):
    """The numbers of D scenes with equal layouts; lengths m, forces N, moments Nm, gravity m/s^2.

    origin (D, P, 3), rotation (D, P, 3, 3): of the P parts; length (D, U), interfaces (D, U, 2, 3): lengths and points A and
    B of the U distinct parts; point (D, B, 3): internal blocks; leaf (D, F, LEAF_NUMBERS); terms (D, T, 7): coefficient,
    direction, point; loads (D, L, 9): position, force, moment; gravity (D, 3); springs (D, ..): SPRING_NUMBERS and constants
    of every spring; pushes (D, K, PUSH_NUMBERS): loads along the leaves that have any; explicit (D, ..): explicit numbers
    of the leaves that have them.
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
    pushes: np.ndarray
    explicit: np.ndarray


def number_slices(layout: SceneLayout) -> tuple[tuple[slice, tuple[int, ...]], ...]:
    """(slice, shape) of each field of `SceneNumbers` in the flat numbers of a scene with this layout, `explicit` last."""
    leaves = sum(len(p.leaves) for p in layout.distinct_parts)
    shapes: tuple[tuple[int, ...], ...] = (
        (len(layout.parts), 3), (len(layout.parts), 3, 3), (len(layout.distinct_parts),), (len(layout.distinct_parts), 2, 3),
        (sum(len(p.blocks) for p in layout.distinct_parts), 3), (leaves, LEAF_NUMBERS), (sum(map(len, layout.rows)), 7),
        (len(layout.loads), 9), (3,), (sum(SPRING_NUMBERS + s[3] for s in layout.springs),),
        (sum(leaf.load_modes > 0 for p in layout.distinct_parts for leaf in p.leaves), PUSH_NUMBERS),
    )  # fmt: skip
    slices, at = [], 0
    for shape in shapes:
        end = at + math.prod(shape)
        slices.append((slice(at, end), shape))
        at = end
    return (*slices, (slice(at, None), (-1,)))


class _PartCollector:
    """Layouts and numbers of the distinct parts, collected one by one."""

    def __init__(self, mesh: Mesh, heavy: bool, free: Container[str]) -> None:
        self.mesh, self.heavy, self.free = mesh, heavy, free
        self.distinct: list[PartLayout] = []
        self.length: list[float] = []
        self.ends: list[float] = []
        self.point: list[float] = []
        self.leaf: list[float] = []
        self.explicit: list[float] = []
        self.groups: dict[Any, int] = {}
        self.load_modes: dict[str, int] = {}

    def add(
        self, joint: Any, leaves: Iterable[tuple[str, Any]], before: str, ends: tuple[Any, Any], length: float
    ) -> None:
        """Add a joint, or a free leaf or piece of one (joint None), with its leaves by name.

        before: prefix of the full names of its leaves; ends: points A and B; length: of the part [m].
        """
        blocks = {} if joint is None else {n: p for n, p in joint.blocks().items() if n not in ("A", "B")}
        for point in blocks.values():
            self.point += point
        names, layouts = list(blocks), []
        for name, leaf in leaves:
            full = before + name
            mesh = self.mesh.for_leaf(full, "" if joint is not None else whole_leaf_name(name, self.free))
            own = (leaf.start_block, leaf.end_block) if joint is not None else ("A", "B")
            if not mesh.nodal:
                layouts.append(self._leaf(leaf, mesh, (before, name), own, length))
                continue
            self._refuse_loads(name)
            # every element is a leaf of its own, its nodes are blocks
            pieces = element_leaves(leaf, leaf.elements or mesh.elements)
            between = [piece_name(name, k) for k in range(len(pieces) - 1)]
            names += between
            for piece in pieces[:-1]:
                self.point += piece.end
            pairs = pairwise([own[0], *between, own[1]])
            for k, (piece, pair) in enumerate(zip(pieces, pairs, strict=True)):
                layouts.append(self._leaf(piece, mesh, (before, piece_name(name, k)), pair, length))
        self.length.append(length)
        for end in ends:
            self.ends += end
        motions = () if joint is None else tuple((m.name, m.kind) for m in joint.motions)
        family = "" if joint is None else joint.family
        self.distinct.append(PartLayout(family, motions, tuple(names), tuple(layouts)))

    def _refuse_loads(self, name: str) -> None:
        """Raise SceneError for loads along a leaf that is divided into elements."""
        if name in self.load_modes:
            raise SceneError(
                f"leaf '{name}' is a chain of elements, which takes no load along its length; leave mesh out, or "
                "load its links"
            )

    def _leaf(
        self, leaf: Any, mesh: Mesh, name: tuple[str, str], ends: tuple[str, str], length: float
    ) -> LeafLayout:
        """Collect the numbers of a leaf and return its layout; name: (prefix, name in its part)."""
        section, material, state = leaf.section, leaf.material, leaf.condition
        twist = restrained_twist(leaf, mesh)
        long, density = leaf.length, material.density or 0.0
        has_weight = self.heavy and density > 0.0
        size = (
            material.E, material.G, section.A, section.J, section.Iy, section.Iz, section.ky, section.kz, density,
        )  # fmt: skip
        self.leaf += (*leaf.start, *leaf.end, *leaf.width_axis, long, *size)
        key: tuple[Any, ...] = (round(COMPARISON_PRECISION * long / length), length, size, has_weight)
        load_modes = self.load_modes.get(name[1], 0)
        if mesh.leaf != "strain":
            self._refuse_loads(name[1])
        if (
            load_modes
            or leaf.profile is not None
            or leaf.curve is not None
            or twist is not None
            or not (state is None or _has_constants_of_its_section(state))
        ):
            member = leaf_member(leaf, mesh, name="".join(name), heavy=has_weight, load_modes=load_modes)
            return self._explicit_leaf(
                leaf, member, LeafLayout(name[1], ends, member.kind, (), has_weight, 0), key, twist is None
            )
        number: tuple[int, ...]
        if mesh.leaf == "strain":
            orders, points = leaf_orders(leaf, mesh)
            kind, number = STRAIN, (*orders, points, 0)
        else:
            kind, number = COROTATIONAL, (leaf.elements or mesh.elements, int(mesh.mip))
        return LeafLayout(name[1], ends, kind, number, has_weight, self._group(*key, kind, number))

    def _explicit_leaf(
        self, leaf: Any, member: Member, layout: LeafLayout, key: tuple[Any, ...], warps_freely: bool
    ) -> LeafLayout:
        """Collect the explicit numbers of a leaf and return its layout; key: what its other constants depend on;
        warps_freely: whether they follow from the section."""
        self.explicit += [*member.offset.ravel().tolist(), *member.frame.ravel().tolist(), member.mass]
        number = tuple(member.number.tolist())
        uniform = warps_freely and member.kind == STRAIN and leaf.profile is None and leaf.orders is None
        state = leaf.condition or LeafCondition()
        if uniform and state.stretch == 1.0 and state.plate is None and not self.load_modes.get(layout.name):
            amplitudes = member.inner[:-6].tolist()
            self.explicit += amplitudes
            group = self._group(*key, number, tuple(amplitudes))
            return layout._replace(number=number, group=group, amplitudes=number[:3])
        self.explicit += [*member.inner.tolist(), *member.value.tolist()]
        group = self._group(member.kind, number, member.value.tobytes())
        return layout._replace(number=number, group=group, explicit=(len(member.value), len(member.inner)))

    def _group(self, *constants: Any) -> int:
        """Number of the group of leaves of the present part whose constants depend on these values.

        Equal leaves of two joints are two groups, so that changing one joint does not change the layout.
        """
        return self.groups.setdefault((len(self.distinct), *constants), len(self.groups))


def _has_constants_of_its_section(state: LeafCondition) -> bool:
    """Whether a leaf in this condition is free of stress as described, and its constants are those of its section."""
    return (
        state.plate is None
        and state.stretch == 1.0
        and state.natural_curvature == 0.0
        and not any(state.shift)
        and not any(state.turn)
    )


_STILL = (0.0, 0.0, 0.0)
_AXES = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


def split_scene(scene: Any, mesh: Mesh) -> SplitScene:
    """Layout and numbers of a frozen scene with all its effects. Raises SceneError for leaves that have no model."""
    refuse_contacts(scene)
    index = {link: i for i, link in enumerate(scene.links)}
    parts = _PartCollector(mesh, has_gravity(scene), {free.name for free in scene.leaves})
    pushes = loads_of_pieces(scene)
    known: dict[Any, int] = {}
    placed_parts: list[tuple[str, int, int, int]] = []
    places: list[float] = []
    turns: list[float] = []
    joints: list[Any] = []
    plain = type(mesh).for_leaf is Mesh.for_leaf
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
    pressed = {load.leaf for load in scene.pressures}
    parts.load_modes = {
        name: GIVEN_MODES + PRESSURE_MODES * (whole_leaf_name(name, parts.free) in pressed) for name in pushes
    }
    for name, a, b, leaf in cut_leaves(scene):
        placed_parts.append(("", index[a], index[b], len(parts.distinct)))
        parts.add(None, ((name, leaf),), "", (leaf.start, leaf.end), leaf.length)
        places += _STILL
        turns += _AXES
    rows, terms = _rows(scene, index)
    loads, pushed = _loads(scene, index)
    springs = elastic_members(scene, np.zeros((len(index), 3)))
    layout = SceneLayout(
        scene.links, tuple(p.name for p in scene.joints), tuple(placed_parts), tuple(parts.distinct), rows,
        tuple(d.name for d in scene.drives), tuple(s.name for s in scene.supports), loads,
        tuple((s.name, s.kind, s.nodes, len(s.value)) for s in springs), parts.heavy,
    )  # fmt: skip
    numbers = [
        *places, *turns, *parts.length, *parts.ends, *parts.point, *parts.leaf, *terms, *pushed,
        *(scene.gravity or _STILL), *_spring_numbers(springs), *(x for own in pushes.values() for x in own), *parts.explicit,
    ]  # fmt: skip
    return SplitScene(layout, numbers, tuple(joints))


def has_gravity(scene: Any) -> bool:
    """Whether the scene has gravity, so that leaf springs of known density have weight."""
    return scene.gravity is not None and any(scene.gravity)


def _rows(scene: Any, index: dict[str, int]) -> tuple[tuple[Any, ...], list[float]]:
    """Layout and numbers of drives and supports."""
    layout: list[tuple[tuple[int, int, int], ...]] = []
    numbers: list[float] = []
    for row in (*scene.drives, *scene.supports):
        layout.append(tuple((_term_kind(t), index[t.base], index[t.link]) for t in row.terms))
        for t in row.terms:
            numbers += (t.coefficient, *t.direction, *(t.point if t.axis is None else t.axis))
    return tuple(layout), numbers


def _term_kind(term: DriveTerm) -> int:
    """Kind of a term of a drive or support in `ksd.model.arrays.Terms`."""
    if term.kind == "translation":
        return TRANSLATION
    return ROTATION if term.axis is None else ALIGNMENT


def _loads(scene: Any, index: dict[str, int]) -> tuple[tuple[Any, ...], list[float]]:
    """Layout and numbers of the loads on moving links, with the weights of the masses of the scene."""
    layout: list[tuple[int, bool, bool]] = []
    numbers: list[float] = []
    # a moment about the normal of a plane is conservative for a link that stays in the plane
    flat = {t.link for s in plane_supports(scene) for t in s.terms}
    across = [k for k in range(3) if scene.plane is None or k != PLANES[scene.plane]]
    for load in scene.loads:
        node = index[load.link]
        if node:
            following = bool(load.following)
            out = load.link not in flat or any(load.moment[k] for k in across)
            layout.append((node, following, following or (out and any(load.moment))))
            numbers += (*load.at, *load.force, *load.moment)
    for mass in scene.masses if scene.gravity is not None else ():
        node = index[mass.link]
        if node:
            layout.append((node, False, False))
            numbers += (*mass.at, *(mass.mass * g for g in scene.gravity), 0.0, 0.0, 0.0)
    return tuple(layout), numbers


def elastic_members(scene: Any, places: np.ndarray) -> list[Member]:
    """Members of the springs of a scene and of its links with a matrix; places (k, 3): reference points of the links."""
    links = [c for c in scene.compliances if c.matrix is not None and f"{c.link}/2" in scene.links]
    if not scene.springs and not links:
        return []
    index = {link: i for i, link in enumerate(scene.links)}
    members = spring_members(scene.springs, index, places)
    for c in links:
        nodes = (index[c.link], index[f"{c.link}/2"])
        members.append(matrix_member(c.link, c.matrix, nodes, places, np.asarray(c.width_axis)))
    return members


def _spring_numbers(springs: Sequence[Member]) -> list[float]:
    """Flat numbers of springs whose ends are positions from the origin."""
    numbers: list[float] = []
    for s in springs:
        numbers += [
            *s.offset.ravel().tolist(),
            *s.frame.ravel().tolist(),
            s.length,
            s.stiffness_scale,
            *s.value.tolist(),
        ]
    return numbers
