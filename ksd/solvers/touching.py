"""The stops and cables of a scene as tables for `ksd.model.gaps`, and arrays whose loads are the contact forces."""

from __future__ import annotations

from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ksd.answers.derived import cached_per_model
from ksd.errors import SceneError
from ksd.model.arrays import Arrays, State
from ksd.model.compile import Model
from ksd.model.contact_step import look_at_gaps
from ksd.model.gaps import (
    BALL,
    CABLE,
    CORNERS,
    ELLIPSOID,
    FIRST,
    FRICTION,
    FRICTIONS,
    GAP,
    LIMIT,
    NORMAL,
    OFFSET,
    OVAL,
    POLYGON,
    ROUNDED,
    SHIFT,
    STRIP,
    SURFACE,
    TERM_SIZE,
    WALL,
    WRENCH,
    touch,
)
from ksd.model.turns import node_rotations
from ksd.scene.hinges import plane_normal
from ksd.scene.obstacle import Surface, contact_drives
from ksd.scene.shapes import ContactShape
from ksd.solvers.leaf_contact import (
    curvatures,
    cut_at,
    cut_places,
    nearest_station,
    places_of,
    rest_curvature,
    strip_numbers,
    strip_surface,
    strips,
)

Array = NDArray[np.float64]
REST_STEPS = 50
"""Newton steps to the place of a leaf at rest that is nearest to a surface."""


class Pair(NamedTuple):
    """A row of the table: the part of the scene it is made of, which end of it ("high", "low", a corner, or ""), its kind,
    and whether its surfaces are in the other order."""

    name: str
    end: str
    kind: str
    swapped: bool = False


@dataclass(frozen=True)
class Touching:
    """What may touch in a model.

    nodes (k,): of the bodies; pairs (m, 6), data, bodies: tables of `ksd.model.complementarity`; parts: of every pair;
    values: by the name of a value that a solve may give, those of the scene; slots: where it enters the offset of a gap, and
    its sign; normals (m, 3): at rest, zero where a pair has none; strips: where the numbers of a strip of a leaf begin, by
    the name of its node.
    """

    nodes: NDArray[np.int64]
    pairs: NDArray[np.int64]
    data: Array
    bodies: NDArray[np.int64]
    parts: tuple[Pair, ...]
    values: Mapping[str, float]
    slots: Mapping[str, tuple[int, float]]
    normals: Array
    strips: Mapping[str, int]

    @cached_property
    def counts_turns(self) -> bool:
        """Whether a stop is on a rotation, whose whole turns are counted."""
        limits = self.pairs[self.pairs[:, 0] == LIMIT]
        return any(
            self.data[row[1] + FIRST + TERM_SIZE * t + 1] for row in limits.tolist() for t in range(row[2])
        )

    @cached_property
    def has_surfaces(self) -> bool:
        """Whether a pair has a normal."""
        return bool(self.normals.any())

    def turned(self, normals: Array, out: Array) -> NDArray[np.bool_] | None:
        """Which normals have turned by more than a right angle from `normals` (m, 3); None where none has."""
        if not self.has_surfaces:
            return None
        found = np.add.reduce(normals * out[:, NORMAL : NORMAL + 3], axis=1) < 0.0
        return found if found.any() else None

    def overlap_between(
        self,
        turned: NDArray[np.bool_],
        out: Array,
        data: Array,
        before: tuple[Array, Array],
        now: tuple[Array, Array],
    ) -> bool:
        """Whether surfaces whose normals have `turned` overlap between the poses before and now, on straight lines, so that
        they have passed through one another."""
        between, all_nodes = np.empty_like(out), np.arange(len(self.nodes))
        for s in np.linspace(0.0, 1.0, 34)[1:-1]:
            x, R = (a + s * (b - a) for a, b in zip(before, now, strict=True))
            U, _, V = np.linalg.svd(R)
            look_at_gaps(self.pairs, data, self.bodies, all_nodes, x, U @ V, x[:0], R[:0], between)
            if (between[turned, GAP] < 0.0).any():
                return True
        return False

    def with_values(self, values: Array) -> Array:
        """The numbers of all pairs with these values, in the order of `values`."""
        data = self.data.copy()
        for (at, sign), value in zip(self.slots.values(), values.tolist(), strict=True):
            data[at] += sign * value
        return data

    def on_strips(self, model: Model, motion: State) -> Touching:
        """The same with the strips of a model cut elsewhere, at a state of it."""
        if not self.strips:
            return self
        # what it has found out of its pairs stays true
        moved, places = copy(self), places_of(model)
        data = moved.__dict__["data"] = self.data.copy()
        for strip in strips(model):
            s, at = places[strip.node], self.strips[strip.node]
            kappa = curvatures(model, motion, strip.leaf, np.array([s]))[0]
            if strip.leaf.curve is None and strip.leaf.profile is None:
                data[at + CORNERS : at + CORNERS + 5] = strip_numbers(strip, s, kappa)
                continue
            numbers = _numbers(
                strip_surface(strip, s, kappa), model.rest.x[model.node_names.index(strip.node)]
            )
            data[at : at + len(numbers)] = numbers
        return moved

    def count_turns(self, data: Array, arrays: Arrays, motion: State) -> None:
        """Write the counted angles of rotation terms at a state into `data`, in place."""
        if not self.counts_turns:
            return
        turned = node_rotations(arrays, motion)
        for row in self.pairs[self.pairs[:, 0] == LIMIT]:
            own = self.nodes[self.bodies[row[3] : row[3] + row[4]]]
            for t in range(row[2]):
                at = row[1] + FIRST + TERM_SIZE * t
                if data[at + 1]:
                    a, b = own[int(data[at + 2])], own[int(data[at + 3])]
                    data[at + 13] = (motion.R[a] @ data[at + 4 : at + 7]) @ (turned[b] - turned[a])


@cached_per_model
def touching(model: Model) -> Touching:
    """The tables of a model; stops and cables in the order of the scene. Leaf springs are cut where they touch at rest."""
    model = cut_model(model)
    scene, index = model.original_scene, {link: i for i, link in enumerate(model.scene.links)}
    nodes: list[int] = []
    pairs: list[list[int]] = []
    data: list[float] = []
    bodies: list[int] = []
    parts: list[Pair] = []
    slots: dict[str, tuple[int, float]] = {}

    def add(
        kind: int, links: list[str], part: Pair, softness: float, offset: float, own: list[float], count: int
    ) -> int:
        names = list(dict.fromkeys(links))
        numbers = [index[link] for link in names]
        nodes.extend(n for n in numbers if n not in nodes)
        pairs.append([kind, len(data), count, len(bodies), len(names), 0])
        bodies.extend(nodes.index(n) for n in numbers)
        parts.append(part)
        at = len(data) + OFFSET
        data.extend([0.0, softness, offset, *own])
        return at

    for stop in scene.stops:
        links = [link for t in stop.terms for link in (t.base, t.link)]
        names = list(dict.fromkeys(links))
        for end, sign in (("low", -1.0), ("high", 1.0)):
            if f"{stop.name}.{end}" not in stop.limits:
                continue
            own: list[float] = []
            for t in stop.terms:
                arms = [np.asarray(t.point) - model.rest.x[index[link]] for link in (t.base, t.link)]
                own += [
                    sign * t.coefficient,
                    float(t.kind == "rotation"),
                    names.index(t.base),
                    names.index(t.link),
                ]
                own += [*t.direction, *arms[0].tolist(), *arms[1].tolist(), 0.0]
            at = add(LIMIT, links, Pair(stop.name, end, "stop"), stop.softness, 0.0, own, len(stop.terms))
            slots[f"{stop.name}.{end}"] = at, sign
    for cable in scene.cables:
        links = [link for link, _ in cable.points]
        names, own = list(dict.fromkeys(links)), []
        for link, at_rest in cable.points:
            own += [names.index(link), *(np.asarray(at_rest) - model.rest.x[index[link]]).tolist()]
        soft = 0.0 if cable.stiffness is None else 1.0 / cable.stiffness
        at = add(CABLE, links, Pair(cable.name, "", "cable"), soft, cable.free_length, own, len(cable.points))
        slots[cable.name] = at, -1.0
    surfaces = {s.name: s for s in scene.surfaces}
    on_leaf, places, cut = {strip.contact: strip for strip in strips(model)}, places_of(model), {}
    flat = scene.plane is not None
    for contact in scene.contacts:
        if strip := on_leaf.get(contact.name):
            s = places[strip.node]
            surfaces[strip.leaf.name] = strip_surface(
                strip, s, curvatures(model, model.rest, strip.leaf, np.array([s]))[0]
            )
        a, b = surfaces[contact.a], surfaces[contact.b]
        for kind, first, second, end in _pairs_of(a, b):
            own = [0.36, 0.48, 0.8]
            own += _numbers(first, model.rest.x[index[first.link]]) + _numbers(
                second, model.rest.x[index[second.link]]
            )
            at = add(
                kind,
                [first.link, second.link],
                Pair(contact.name, end, "contact", first.name != a.name),
                contact.softness,
                0.0,
                own,
                0,
            )
            data[at - OFFSET + FRICTION] = contact.friction
            if strip:
                cut[strip.node] = at - OFFSET + FIRST + 3 + SURFACE
            pairs[-1][FRICTIONS] = (1 if flat else 2) if contact.friction else 0
    values = contact_drives(scene)
    found = Touching(
        np.array(nodes, np.int64), np.array(pairs, np.int64).reshape(-1, 6), np.array(data), np.array(bodies, np.int64),
        tuple(parts), values, {name: slots[name] for name in values}, np.zeros((len(pairs), 3)), cut,
    )  # fmt: skip
    _look_at_rest(model, found)
    return found


@cached_per_model
def cut_model(model: Model) -> Model:
    """The model with its leaf springs cut where surfaces are nearest to them at rest, or as they are cut already."""
    if not strips(model) or places_of(model):
        return model
    places = {}
    for strip in strips(model):
        s, leaf, out = nearest_station(strip.leaf, strip.surface), strip.leaf, np.zeros(WRENCH + 36)
        (kind, *both, _), *_ = _pairs_of(strip.surface, strip_surface(strip, 0.5 * leaf.length, np.zeros(3)))
        for _ in range(REST_STEPS):
            on_leaf = _numbers(strip_surface(strip, s, rest_curvature(leaf, s)), np.zeros(3))
            numbers = [*[0.0] * FIRST, 0.36, 0.48, 0.8, *_numbers(both[0], np.zeros(3)), *on_leaf]
            row, data = np.array([kind, 0, 0, 0, 2, 0]), np.array(numbers)
            poses = np.zeros((2, 3)), np.array([np.eye(3)] * 2)
            touch(row, data, np.array([0, 1]), *poses, *poses, out)
            s += float(out[SHIFT])
            if abs(out[SHIFT]) <= 1e-12 * leaf.length:
                break
        places[strip.node] = s
    return cut_at(model, cut_places(model, places))


def _pairs_of(a: Surface, b: Surface) -> list[tuple[int, Surface, Surface, str]]:
    """Kind, both surfaces, and corner, of every pair that a contact stands for; the first surface is a ball or an oval."""
    if a.shape.is_ball or b.shape.is_ball:
        return [(BALL, a, b, "")] if a.shape.is_ball else [(BALL, b, a, "")]
    oval = {"ellipse", "ellipsoid"}
    if a.shape.kind in oval or b.shape.kind in oval:
        return [(OVAL, a, b, "")] if a.shape.kind in oval else [(OVAL, b, a, "")]
    found = []
    for own, other in ((a, b), (b, a)):
        ball = ContactShape("ball", (own.shape.tip_radius,))
        for k, tip in enumerate(own.shape.tips):
            place = np.asarray(own.at) + np.array(tip) @ np.array(own.axes)
            end = f"{own.name} {'end' if own.shape.tip_radius else 'corner'} {k + 1}"
            found.append((BALL, replace(own, shape=ball, at=tuple(place.tolist())), other, end))
    return found


def _numbers(surface: Surface, origin: Array) -> list[float]:
    """A surface as `ksd.model.gaps` reads it; origin (3,) [m]: of its body at rest."""
    shape = surface.shape
    codes = {"wall": WALL, "polygon": POLYGON, "ellipse": ELLIPSOID, "ellipsoid": ELLIPSOID, "strip": STRIP}
    code, sizes = codes.get(shape.kind, ROUNDED), [*shape.sizes, 0.0, 0.0, 0.0, 0.0][:4]
    if shape.kind in ("box", "capsule"):
        sizes = [shape.tip_radius, *np.max(shape.tips, axis=0).tolist()]
    corners = [c for point in shape.points for c in point]
    place = (np.asarray(surface.at) - origin).tolist()
    return [*place, *np.array(surface.axes).T.ravel().tolist(), code, *sizes, len(shape.points), *corners]


def _look_at_rest(model: Model, what: Touching) -> None:
    """Choose the references of the directions of friction. Raises SceneError for surfaces that overlap at rest, or that are
    at different heights over the plane of the mechanism."""
    scene, size = model.original_scene, model.arrays.size
    poses = model.rest.x[what.nodes], model.rest.R[what.nodes]
    normal = None if scene.plane is None else np.asarray(plane_normal(scene.plane))
    for i, (row, part) in enumerate(zip(what.pairs, what.parts, strict=True)):
        if part.kind != "contact":
            continue
        out = np.zeros(WRENCH + 36)
        touch(row, what.data, what.bodies, *poses, *poses, out)
        n = what.normals[i] = out[NORMAL : NORMAL + 3]
        what.data[row[1] + FIRST : row[1] + FIRST + 3] = (
            np.eye(3)[np.argmin(np.abs(n))] if normal is None else normal
        )
        if normal is not None and abs(n @ normal) > 1e-6:
            raise SceneError(
                f"contact '{part.name}': its surfaces are at different heights over the plane {scene.plane}; give both "
                "the same."
            )
        if out[GAP] < -1e-9 * size:
            raise SceneError(
                f"contact '{part.name}': its surfaces overlap at rest by {-1e3 * out[GAP]:.4g} mm; draw them apart, or let "
                "them touch."
            )


def contact_model(model: Model, nodes: NDArray[np.int64]) -> Model:
    """The model with one more dead load at the reference point of every moving body that may touch, of these `nodes`
    (`Touching.nodes`): its contact forces. Cached with the model."""
    if "contact" not in model.derived:
        moved = model.derived.get("moved_cuts")
        model.derived["contact"] = (
            _with_contact_loads(model, nodes)
            if moved is None or model is moved.model or model in moved.moved
            else replace(
                model,
                arrays=moved.arrays("contact", lambda m: contact_model(m, nodes).arrays, places_of(model)),
            )
        )
    found: Model = model.derived["contact"]
    return found


def _with_contact_loads(model: Model, nodes: NDArray[np.int64]) -> Model:
    arrays, loads = model.arrays, model.arrays.loads
    moving = nodes[arrays.start[nodes] >= 0]
    block = arrays.plan.diagonal[np.searchsorted(arrays.plan.start, arrays.start[moving])]
    none, count = np.zeros((len(moving), 3)), len(moving)
    more = type(loads)(moving, none, none, none, np.zeros(count, np.int64), np.zeros(count, np.int64), block)
    joined = type(loads)(*(np.concatenate([a, b]) for a, b in zip(loads, more, strict=True)))
    return replace(model, arrays=arrays.replace(loads=joined))
