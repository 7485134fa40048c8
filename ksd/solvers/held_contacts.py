"""A pose in contact with its closed contacts as supports and springs, for questions about small motions from it.

To second order, the gap of two surfaces that touch is the distance of their centres of curvature less that at the pose. So a
closed contact is a support along its normal at the centre of the first surface, and carries its force as a spring of
constant force between both centres, which has the stiffness that the force has by its change of direction; on a flat surface
the support, which turns with it, carries the force itself. A contact that sticks is held along its tangent too, where it
rolls by r times the rotation of the first surface. The friction of a contact that slips stays as it is, a dead load. A stop
is a support of its motion, a taut cable one of its length with springs of constant force between its points.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.errors import SceneError
from ksd.model.arrays import State
from ksd.model.compile import Model, compile_as_is
from ksd.model.contact_step import SLIPPING
from ksd.model.gaps import (
    BODIES,
    CORNERS,
    COUNT,
    DATA,
    ELLIPSOID,
    FIRST,
    NORMAL,
    PLACE,
    POLYGON,
    ROUNDED,
    SHAPE,
    SIZES,
    SLIDE,
    STRIP,
    SURFACE,
    WALL,
)
from ksd.model.turns import count_from_links, node_rotations
from ksd.scene.drive import GROUND, Drive, DriveTerm
from ksd.scene.effects import Spring
from ksd.scene.load import Load
from ksd.solvers.contact_state import Touched

Array = NDArray[np.float64]
SOFT_SPRING = 1e-6
"""Stiffness of a spring of constant force, over that which the force has across it."""


class _Collector:
    """Supports with their multipliers, springs and loads in the place of the contact forces of a pose."""

    def __init__(self, model: Model, motion: State) -> None:
        self.model, self.motion = model, motion
        self.supports: list[Drive] = []
        self.multipliers: list[float] = []
        self.springs: list[Spring] = []
        self.loads: list[Load] = []

    def at_rest(self, node: int, v: Array, *, is_point: bool) -> Any:
        """A point or direction (3,) of a node at the pose as it is at rest."""
        rest, turn = self.model.rest, self.model.rest.R[node] @ self.motion.R[node].T
        moved = rest.x[node] + turn @ (v - self.motion.x[node]) if is_point else turn @ v
        return tuple(moved.tolist())

    def term(self, base: int, node: int, direction: Array, place: Array) -> DriveTerm:
        """The motion of a point of a node along a direction that turns with the base."""
        names = self.model.node_names
        along, point = self.at_rest(base, direction, is_point=False), self.at_rest(node, place, is_point=True)
        return DriveTerm(1.0, "translation", names[base], names[node], along, point)

    def support(self, name: str, terms: tuple[DriveTerm, ...], multiplier: float) -> None:
        """Hold a sum of terms; multiplier: minus the force with which it does."""
        self.supports.append(Drive(name, terms))
        self.multipliers.append(multiplier)

    def constant_force(self, name: str, a: int, b: int, start: Array, end: Array, force: float) -> None:
        """A spring that pulls both points together by a force [N], whatever their distance."""
        names, length = self.model.node_names, math.dist(start, end)
        stiffness = SOFT_SPRING * abs(force) / length
        ends = self.at_rest(a, start, is_point=True), self.at_rest(b, end, is_point=True)
        spring = Spring(name, names[a], names[b], *ends, stiffness, 0.0)
        # no spring of a scene has a negative free length
        spring.__dict__["free_length"] = length - force / stiffness
        self.springs.append(spring)

    def dead_load(self, name: str, node: int, force: Array, place: Array) -> None:
        """A force (3,) [N] on a point of a node."""
        link = self.model.node_names[node]
        if link != GROUND:
            point = self.at_rest(node, place, is_point=True)
            self.loads.append(Load(name, link, tuple(force.tolist()), (0.0, 0.0, 0.0), point))


def hold_contacts(old: Model, motion: State, touched: Touched) -> tuple[Model, State]:
    """Model and state of the mechanism with its closed contacts held, see above.

    Raises SceneError for one that cannot be held so: a soft stop or contact, and some that stick.
    """
    bare, found = old.scene, _Collector(old, motion)
    for i, part in enumerate(touched.what.parts):
        if touched.forces[i, 0] > 0.0:
            {"stop": _hold_stop, "cable": _hold_cable, "contact": _hold_contact}[part.kind](found, touched, i)
    scene = replace(
        bare, supports=(*bare.supports, *found.supports), springs=(*bare.springs, *found.springs),
        loads=(*bare.loads, *found.loads),
    )  # fmt: skip
    model = compile_as_is(scene, old.mesh, scene, old.choice)
    rows = dict(zip((*old.drive_names, *old.support_names), motion.multiplier, strict=True))
    rows |= {support.name: m for support, m in zip(found.supports, found.multipliers, strict=True)}
    multiplier = np.array([rows[name] for name in (*model.drive_names, *model.support_names)])
    state = State(motion.x, motion.R, motion.inner, multiplier, np.zeros_like(model.rest.angle)).copy()
    count_from_links(model.arrays, state, node_rotations(old.arrays, motion))
    return model, state


def _refuse_soft(name: str, softness: float, kind: str) -> None:
    if softness:
        raise SceneError(
            f"{kind} '{name}' acts here and is soft, which stiffness, frequencies and the like do not know; give it no "
            "softness, or a spring in its place."
        )


def _hold_stop(found: _Collector, touched: Touched, i: int) -> None:
    part, N = touched.what.parts[i], float(touched.forces[i, 0])
    stop = next(s for s in found.model.original_scene.stops if s.name == part.name)
    _refuse_soft(stop.name, stop.softness, "stop")
    found.support(f"{part.name}.{part.end}", stop.terms, N if part.end == "high" else -N)


def _hold_cable(found: _Collector, touched: Touched, i: int) -> None:
    name, T = touched.what.parts[i].name, float(touched.forces[i, 0])
    cable = next(c for c in found.model.original_scene.cables if c.name == name)
    index, rest, motion = found.model.node_names.index, found.model.rest, found.motion
    nodes = [index(link) for link, _ in cable.points]
    places = [
        motion.x[k] + motion.R[k] @ rest.R[k].T @ (np.asarray(at) - rest.x[k])
        for k, (_, at) in zip(nodes, cable.points, strict=True)
    ]
    terms = []
    for s, ((a, start), (b, end)) in enumerate(pairwise(zip(nodes, places, strict=True))):
        if a == b:
            continue
        found.constant_force(f"{name} {s + 1}", a, b, start, end, T)
        terms.append(found.term(a, b, (end - start) / math.dist(start, end), end))
    if cable.stiffness is not None:
        _refuse_soft(name, 1.0 / cable.stiffness, "cable")
    found.support(name, tuple(terms), 0.0)


def _hold_contact(found: _Collector, touched: Touched, i: int) -> None:
    what, part, out = touched.what, touched.what.parts[i], touched.out[i]
    row, name = what.pairs[i], ", ".join(filter(None, (part.name, part.end)))
    contact = next(c for c in found.model.original_scene.contacts if c.name == part.name)
    _refuse_soft(name, contact.softness, "contact")
    a, b = (int(what.nodes[what.bodies[row[BODIES] + k]]) for k in (0, 1))
    at, (N, T1, T2) = row[DATA] + FIRST, touched.forces[i].tolist()
    n, t1, place = (out[k : k + 3] for k in (NORMAL, SLIDE, PLACE))
    own = _radius(what.data, at + 3, found.motion.R[a], found.motion.x[a], n, place)
    other = _radius(what.data, at + 3 + SURFACE, found.motion.R[b], found.motion.x[b], -n, place)
    centre = place - own * n
    along = found.term(b, a, n, centre)
    flat = found.model.original_scene.plane is not None
    shapes = {int(what.data[at + 3 + SHAPE]), int(what.data[at + 3 + SURFACE + SHAPE])}
    if STRIP in shapes and not flat:
        raise SceneError(
            f"contact '{name}' along a leaf spring acts here, and how its place moves in space is not known to stiffness, "
            "frequencies and the like; ask them in the plane of the mechanism (plane=), or of a point of the leaf."
        )
    if math.isinf(other):
        found.support(f"{name} normal", (along,), N)
    else:
        found.support(f"{name} normal", (along,), 0.0)
        # a hollow surface has its centre beyond that of the first
        sign = 1.0 if own + other > 0.0 else -1.0
        found.constant_force(f"{name} force", a, b, centre, place + other * n, -sign * N)
    friction, drag = contact.friction * N, T1 * t1 + T2 * np.cross(n, t1)
    if not friction:
        return
    if friction - float(np.linalg.norm(drag)) <= SLIPPING * friction:
        found.dead_load(f"{name} friction on {found.model.node_names[a]}", a, drag, place)
        found.dead_load(f"{name} friction on {found.model.node_names[b]}", b, -drag, place)
        return
    if ELLIPSOID in shapes or (own > 0.0 and not flat):
        raise SceneError(
            f"contact '{name}' sticks here, and how {'an ellipse' if flat else 'a ball'} rolls on what it sticks to is not "
            "known to stiffness, frequencies and the like; they know sliding ones, and discs, points and polygons."
        )
    stuck: tuple[DriveTerm, ...] = (found.term(b, a, t1, centre),)
    if own > 0.0:
        reference = np.asarray(what.data[at : at + 3])
        roll = replace(found.term(b, a, reference, centre), kind="rotation", coefficient=-own)
        stuck = (*stuck, roll)
    found.support(f"{name} tangent", stuck, -T1)
    if not flat:
        found.support(f"{name} tangent 2", (found.term(b, a, np.cross(n, t1), centre),), -T2)


def _radius(data: Array, at: int, R: Array, x: Array, outward: Array, place: Array) -> float:
    """Radius of curvature [m] of a surface in the plane of the contact, inf where flat, negative where hollow."""
    kind, axes = int(data[at + SHAPE]), R @ data[at + 3 : at + 12].reshape(3, 3)
    local = axes.T @ (place - x - R @ data[at : at + 3])
    if kind == WALL:
        return math.inf
    if (kind == ELLIPSOID and data[at + SIZES + 2]) or (
        kind == ROUNDED and data[at + SIZES + 1 : at + SIZES + 4].any()
    ):
        raise SceneError(
            "a box, capsule or ellipsoid is touched here, and how its place moves is not known to stiffness, frequencies "
            "and the like; they know balls, points and walls in space."
        )
    if kind == STRIP:
        h, slope, kappa = float(data[at + SIZES]), float(data[at + SIZES + 1]), float(data[at + CORNERS + 2])
        size, up = math.hypot(1.0, slope), axes.T @ outward
        if up[1] - slope * up[0] < (1.0 - 1e-9) * size:
            # at an end of the leaf
            return 0.0
        along = (1.0 - h * kappa + slope * slope) / size
        return math.inf if abs(kappa) < 1e-6 else -along / kappa
    if kind == ELLIPSOID:
        a, b = data[at + SIZES : at + SIZES + 2].tolist()
        return float((a * b) ** 2 * ((local[0] / a**2) ** 2 + (local[1] / b**2) ** 2) ** 1.5)
    if kind == POLYGON:
        corners = data[at + CORNERS : at + CORNERS + 2 * int(data[at + COUNT])].reshape(-1, 2)
        edges = np.roll(corners, -1, axis=0) - corners
        sine = edges @ (axes.T @ outward)[:2] / np.hypot(*edges.T)
        return math.inf if np.abs(sine).min() < 1e-9 else 0.0
    return float(data[at + SIZES])
