"""Contact along leaf springs: a leaf is cut where a surface touches it, and states of a leaf cut elsewhere.

At the cut is a node without mass, with a strip of the surface of the leaf around it (`ksd.model.gaps`), which continues it
as an arc. A force on the strip is that on the leaf to first order in the distance from the cut, and the cut moves to the
place of contact, so that nothing of second order is left.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ksd.errors import SceneError
from ksd.model.arrays import Arrays, State
from ksd.model.compile import Model, compile_as_is
from ksd.model.leaves import leaf_orders, restrained_twist
from ksd.model.recut import bends_at, recut, section_at
from ksd.scene.leaf import Leaf
from ksd.scene.obstacle import Surface
from ksd.scene.scene import LeafPoint, Scene
from ksd.scene.shapes import ContactShape
from ksd.section.section import thickness_and_width

Array = NDArray[np.float64]
SHORTEST = 1e-3
"""Shortest piece of a leaf, over its length."""


class Strip(NamedTuple):
    """A leaf that a surface may touch: name of the contact and of its node, the leaf, the surface, and the side of the leaf
    that it is on: 1 for that of e2, -1 for the other."""

    contact: str
    node: str
    leaf: Leaf
    surface: Surface
    side: float


def strips(model: Model) -> tuple[Strip, ...]:
    """The strips of a model, in the order of its contacts; cached with it, and with those cut from it."""
    if "strips" not in model.derived:
        model.derived["strips"] = _strips(model)
    found: tuple[Strip, ...] = model.derived["strips"]
    return found


def _strips(model: Model) -> tuple[Strip, ...]:
    scene = model.original_scene
    surfaces, leaves = {s.name: s for s in scene.surfaces}, {f.name: f.leaf for f in scene.leaves}
    found = []
    for contact in scene.contacts:
        for name, other in ((contact.a, contact.b), (contact.b, contact.a)):
            if name not in surfaces:
                leaf, surface = replace(leaves[name], name=name), surfaces[other]
                place, axes = leaf.section_at(nearest_station(leaf, surface) / leaf.length)
                side = 1.0 if (np.asarray(surface.at) - place) @ axes[:, 1] >= 0.0 else -1.0
                found.append(Strip(contact.name, f"{name} at {contact.name}", leaf, surface, side))
    if found and (model.mesh.leaf != "strain" or model.bodies):
        raise SceneError(
            f"contact '{found[0].contact}': contact along leaf spring '{found[0].leaf.name}' is known on strain-mode leaves "
            "only; give no mesh of another leaf model and no reduced bodies, or touch a point of it (mechanism.point)."
        )
    return tuple(found)


def nearest_station(leaf: Leaf, surface: Surface) -> float:
    """Arc length [m], roughly, where a leaf at rest is nearest to the centre of a surface."""
    stations = np.linspace(0.0, 1.0, 101)
    apart = [math.dist(leaf.section_at(s)[0].tolist(), surface.at) for s in stations.tolist()]
    return float(stations[int(np.argmin(apart))] * leaf.length)


def rest_curvature(leaf: Leaf, s: float) -> Array:
    """Curvature (3,) [1/m] of a leaf at rest at arc length s [m]."""
    return np.zeros(3) if leaf.curve is None else leaf.curve.curvatures([s / leaf.length])[0]


def strip_numbers(strip: Strip, s: float, kappa: Array) -> tuple[float, ...]:
    """Of the strip on the node at arc length s [m]: its curvature [1/m] from kappa (3,) of the leaf, and where the leaf
    begins and ends from there [m]."""
    side = strip.side
    return kappa[0], side * kappa[1], side * kappa[2], -s, strip.leaf.length - s


def strip_surface(strip: Strip, s: float, kappa: Array) -> Surface:
    """The strip on the node at arc length s [m], with the curvature kappa (3,) [1/m] about e1, e2, e3."""
    leaf, side = strip.leaf, strip.side
    place, axes = leaf.section_at(s / leaf.length)
    thickness, width = _sizes(leaf, s)
    step = 1e-4 * leaf.length
    slope = (_sizes(leaf, s + step)[0] - _sizes(leaf, s - step)[0]) / (2.0 * step)
    shape = ContactShape(
        "strip", (0.5 * thickness, 0.5 * slope, 0.5 * width), (strip_numbers(strip, s, kappa),)
    )
    at, axis, toward = (tuple(v.tolist()) for v in (place, side * axes[:, 2], axes[:, 0]))
    return Surface(leaf.name, strip.node, shape, at, axis, toward)


def _sizes(leaf: Leaf, s: float) -> tuple[float, float]:
    """Thickness and width [m] at arc length s [m]."""
    section = (
        leaf.section if leaf.profile is None else leaf.profile.section(min(max(s / leaf.length, 0.0), 1.0))
    )
    return thickness_and_width(section)


def cut_places(model: Model, wanted: Mapping[str, float]) -> dict[str, float]:
    """Where leaves are cut [m] for the places wanted, by the name of the node: not too near to ends and other nodes, beside
    which a node stays on its side."""
    found, now = dict(wanted), places_of(model)
    for strip in strips(model):
        node, length, least = strip.node, strip.leaf.length, SHORTEST * strip.leaf.length
        others = [p.s for p in model.scene.points if p.leaf == strip.leaf.name and p.name not in found]
        for other in strips(model):
            if other.node == node:
                break
            others += [found[other.node]] * (other.leaf.name == strip.leaf.name)
        taken = [(-math.inf, least)]
        for first, last in (*((s - least, s + least) for s in sorted(others)), (length - least, math.inf)):
            if first < taken[-1][1]:
                taken[-1] = taken[-1][0], last
            else:
                taken.append((first, last))
        for first, last in taken:
            if first < found[node] < last:
                found[node] = last if now.get(node, found[node]) >= 0.5 * (first + last) else first
                break
    return found


def places_of(model: Model) -> dict[str, float]:
    """Where the leaves of a model are cut [m], by the name of the node."""
    nodes = {strip.node for strip in strips(model)}
    return {p.name: p.s for p in model.scene.points if p.name in nodes}


def cut_at(model: Model, places: Mapping[str, float]) -> Model:
    """The model with the nodes of its strips at these arc lengths [m]."""
    if not places_of(model):
        return _compiled_at(model, places)
    if "moved_cuts" not in model.derived:
        model.derived["moved_cuts"] = MovedCuts(model) if _cuts_are_linear(model) else None
    moved: MovedCuts | None = model.derived["moved_cuts"]
    if moved is None or moved.order != _order(model.scene, places):
        return _compiled_at(model, places)
    return moved.at(places)


def _compiled_at(model: Model, places: Mapping[str, float]) -> Model:
    scene: Scene = model.scene
    leaf = {strip.node: strip.leaf.name for strip in strips(model)}
    points = tuple(p for p in scene.points if p.name not in places)
    points += tuple(LeafPoint(name, leaf[name], s, unlisted=True) for name, s in places.items())
    links = (*(link for link in scene.links if link not in places), *places)
    # pieces of a curved leaf keep their modes wherever it is cut
    leaves = tuple(
        replace(f, leaf=replace(f.leaf, orders=leaf_orders(f.leaf, model.mesh)[0]))
        if f.name in leaf.values() and f.leaf.curve is not None and f.leaf.orders is None
        else f
        for f in scene.leaves
    )
    made = compile_as_is(
        replace(scene, links=links, points=points, leaves=leaves),
        model.mesh,
        model.original_scene,
        model.choice,
    )
    made.derived["strips"] = strips(model)
    return made


def _order(scene: Scene, places: Mapping[str, float]) -> list[str]:
    """The points of all leaf springs in their order along them, for nodes of strips at these places [m]."""
    along = sorted((p.leaf, places.get(p.name, p.s), p.name) for p in scene.points)
    return [name for _, _, name in along]


def _cuts_are_linear(model: Model) -> bool:
    """Whether the numbers of pieces are linear in the place of a cut: of straight leaf springs of one section, whose warping
    is free."""
    cut, scene = {strip.leaf.name for strip in strips(model)}, model.scene
    return not any(load.leaf in cut for load in scene.loads_along) and all(
        f.leaf.curve is None
        and f.leaf.profile is None
        and f.leaf.condition is None
        and restrained_twist(f.leaf, model.mesh) is None
        for f in scene.leaves
        if f.name in cut
    )


class MovedCuts:
    """Models like `model`, whose cuts are at other places in the same `order`, and their arrays: those of `model` plus their
    rates by the places of the cuts. See `_cuts_are_linear`."""

    def __init__(self, model: Model) -> None:
        # the model of a pose has contact forces as loads
        self.places = places_of(model)
        self.model = _compiled_at(model, self.places)
        self.order = _order(model.scene, self.places)
        self.steps, self.moved = [], []
        for strip in strips(model):
            s = self.places[strip.node]
            after = [p.s for p in model.scene.points if p.leaf == strip.leaf.name and p.s > s]
            self.steps.append(0.5 * (min(after, default=strip.leaf.length) - s))
            self.moved.append(_compiled_at(model, self.places | {strip.node: s + self.steps[-1]}))
        self.nodes = [strip.node for strip in strips(model)]
        x = np.array([other.rest.x for other in (self.model, *self.moved)])
        self.rates = [(b - x[0]) / step for b, step in zip(x[1:], self.steps, strict=True)]
        self.known: dict[Hashable, tuple[Arrays, Array, Array]] = {}

    def at(self, places: Mapping[str, float]) -> Model:
        """The model with its cuts at these places [m]."""
        own, scene = self.model, self.model.scene
        points = tuple(replace(p, s=places.get(p.name, p.s)) for p in scene.points)
        x = own.rest.x + sum(
            shift * rate for shift, rate in zip(self._shifts(places), self.rates, strict=True)
        )
        made = replace(
            own,
            scene=replace(scene, points=points),
            arrays=self.arrays("own", lambda model: model.arrays, places),
            rest=own.rest._replace(x=x),
        )
        made.derived.update(strips=strips(own), moved_cuts=self)
        made.__dict__["conservative"] = own.conservative
        return made

    def arrays(self, name: Hashable, make: Callable[[Model], Arrays], places: Mapping[str, float]) -> Arrays:
        """What `make`, known by its name, gives of the model with its cuts at these places [m]."""
        if name not in self.known:
            own = make(self.model)
            more = [
                (make(b).floats - own.floats) / step for b, step in zip(self.moved, self.steps, strict=True)
            ]
            self.known[name] = own, np.array(more), own.members.stiffness_scale * own.members.length
        own, rates, stiffness = self.known[name]
        found = Arrays(own.ints, own.floats + self._shifts(places) @ rates, own.topology)
        # the longest piece may be the size of the mechanism, which is no linear number
        found.floats[0] = own.size
        found.members.stiffness_scale[:] = stiffness / found.members.length
        return found

    def _shifts(self, places: Mapping[str, float]) -> Array:
        return np.array([places[node] - self.places[node] for node in self.nodes])


def _pieces(model: Model, leaf: Leaf) -> tuple[int, Array]:
    """The first member of a leaf, and where its pieces begin and end [m]."""
    marks = np.array([0.0, *sorted(p.s for p in model.scene.points if p.leaf == leaf.name), leaf.length])
    return model.member_names.index(leaf.name if len(marks) == 2 else f"{leaf.name}:1"), marks


def curvatures(model: Model, motion: State, leaf: Leaf, s: Array) -> Array:
    """Curvatures (n, 3) [1/m] about e1, e2, e3 at arc lengths s (n,) [m] of a leaf; the mean of both sides at a node."""
    kappa = np.empty((len(s), 3))
    bends_at(*model.arrays.flat, motion.inner, *_pieces(model, leaf), s, kappa)
    return kappa


def node_poses(model: Model, motion: State, places: Mapping[str, float]) -> dict[str, tuple[Array, Array]]:
    """Place (3,) [m] and rotation from rest (3, 3) of the sections of leaves where other nodes would cut them, by the name
    of the node."""
    found, leaf = {}, {strip.node: strip.leaf for strip in strips(model)}
    for name, s in places.items():
        place, axes = np.empty(3), np.empty((3, 3))
        section_at(
            *model.arrays.flat, motion.x, motion.R, motion.inner, *_pieces(model, leaf[name]), s, place, axes
        )
        found[name] = place, axes @ leaf[name].section_at(s / leaf[name].length)[1].T
    return found


def cut_state(old: Model, motion: State, new: Model) -> State:
    """A state of a model as one of the model cut elsewhere, as near as its modes come."""
    if old.node_names == new.node_names:
        state = motion.copy()
    else:
        state, own = new.rest.copy(), places_of(new)
        state.multiplier[:] = motion.multiplier
        rows = len(state.angle) - 3 * len(new.node_names)
        state.angle[:rows] = motion.angle[:rows]
        for k, name in enumerate(new.node_names):
            if name not in own:
                i = old.node_names.index(name)
                state.x[k], state.R[k] = motion.x[i], motion.R[i]
                state.angle[rows + 3 * k :][:3] = motion.angle[rows + 3 * i :][:3]
        before, after = old.arrays.members.inner_at, new.arrays.members.inner_at
        for k, name in enumerate(new.member_names):
            if name in old.member_names and not any(name.startswith(f"{s.leaf.name}:") for s in strips(new)):
                i = old.member_names.index(name)
                state.inner[after[k] : after[k + 1]] = motion.inner[before[i] : before[i + 1]]
    for leaf in {strip.leaf.name: strip.leaf for strip in strips(new)}.values():
        recut(
            *old.arrays.flat, motion.x, motion.R, motion.inner, *_pieces(old, leaf),
            *new.arrays.flat, state.x, state.R, state.inner, *_pieces(new, leaf),
        )  # fmt: skip
    return state
