"""Contact along leaf springs: a leaf is cut where a surface touches it, and states of a leaf cut elsewhere.

At the cut is a node without mass, with a strip of the surface of the leaf around it (`ksd.model.gaps`), which continues it
as an arc. A force on the strip is that on the leaf to first order in the distance from the cut, and the cut moves to the
place of contact, so that nothing of second order is left.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ksd.answers.centrelines import (
    fitted_amplitudes,
    member_arrays,
    member_ends,
    quadrature_points,
    strains_along,
)
from ksd.elements.strain_centreline import follow_centreline
from ksd.errors import SceneError
from ksd.model.arrays import State
from ksd.model.compile import Model, compile_as_is
from ksd.model.leaves import leaf_orders
from ksd.scene.leaf import Leaf
from ksd.scene.obstacle import Surface
from ksd.scene.scene import LeafPoint, Scene
from ksd.scene.shapes import ContactShape
from ksd.section.section import thickness_and_width

Array = NDArray[np.float64]
SHORTEST = 1e-3
"""Shortest piece of a leaf, over its length."""
SAMPLES = 12
"""Steps of the integration along a part of a piece."""


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
        node, least = strip.node, SHORTEST * strip.leaf.length
        others = [p.s for p in model.scene.points if p.leaf == strip.leaf.name and p.name not in found]
        for other in strips(model):
            if other.node == node:
                break
            others += [found[other.node]] * (other.leaf.name == strip.leaf.name)
        for other_s in others:
            if abs(found[node] - other_s) < least:
                found[node] = other_s + (least if now.get(node, found[node]) >= other_s else -least)
        found[node] = min(max(found[node], least), strip.leaf.length - least)
    return found


def cut_at(model: Model, places: Mapping[str, float]) -> Model:
    """The model with the nodes of its strips at these arc lengths [m]."""
    scene: Scene = model.scene
    leaf = {strip.node: strip.leaf.name for strip in strips(model)}
    points = tuple(p for p in scene.points if p.name not in places)
    points += tuple(LeafPoint(name, leaf[name], s) for name, s in places.items())
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


def places_of(model: Model) -> dict[str, float]:
    """Where the leaves of a model are cut [m], by the name of the node."""
    nodes = {strip.node for strip in strips(model)}
    return {p.name: p.s for p in model.scene.points if p.name in nodes}


def _pieces(model: Model, leaf: Leaf) -> list[tuple[int, float, float]]:
    """Number, start and end [m] of the members of a leaf, in order."""
    marks = [0.0, *sorted(p.s for p in model.scene.points if p.leaf == leaf.name), leaf.length]
    if len(marks) == 2:
        return [(model.member_names.index(leaf.name), 0.0, leaf.length)]
    first = model.member_names.index(f"{leaf.name}:1")
    return [(first + k, marks[k], marks[k + 1]) for k in range(len(marks) - 1)]


def curvatures(model: Model, motion: State, leaf: Leaf, s: Array) -> Array:
    """Curvatures (n, 3) [1/m] about e1, e2, e3 at arc lengths s (n,) [m] of a leaf; the mean of both sides at a node."""
    total, count = np.zeros((len(s), 3)), np.zeros((len(s), 1))
    for i, start, end in _pieces(model, leaf):
        inside = (s >= start - 1e-12 * leaf.length) & (s <= end + 1e-12 * leaf.length)
        if inside.any():
            at = np.clip((s[inside] - start) / (end - start), 0.0, 1.0)
            total[inside] += strains_along(*member_arrays(model, motion, i), at)[0]
            count[inside] += 1.0
    found: Array = total / count
    return found


def section_pose(model: Model, motion: State, leaf: Leaf, s: float) -> tuple[Array, Array]:
    """Place (3,) [m] and rotation from rest (3, 3) of the section of a leaf at arc length s [m], from the nearer end of its
    piece."""
    i, start, end = next(p for p in _pieces(model, leaf) if s <= p[2] or p[2] == leaf.length)
    value, number, inner = member_arrays(model, motion, i)
    ends, share, total = member_ends(model, motion, i), (s - start) / (end - start), int(number[:3].sum())
    begin, place, axes = (0.0, np.zeros(3), np.eye(3)) if share < 0.5 else (1.0, ends.d, ends.Q)
    place, axes = place.copy(), axes.copy()
    follow_centreline(value, number, inner, inner[total : total + 3], begin, share, SAMPLES, place, axes)
    return ends.start + ends.frame @ place, ends.frame @ axes @ leaf.section_at(s / leaf.length)[1].T


def node_poses(model: Model, motion: State, places: Mapping[str, float]) -> dict[str, tuple[Array, Array]]:
    """Place (3,) and rotation (3, 3) of the sections of leaves where other nodes would cut them, by the name of the node."""
    leaf = {strip.node: strip.leaf for strip in strips(model)}
    return {name: section_pose(model, motion, leaf[name], s) for name, s in places.items()}


def cut_state(old: Model, motion: State, new: Model) -> State:
    """A state of a model as one of the model cut elsewhere, as near as its modes come."""
    places, state = places_of(new), new.rest.copy()
    state.multiplier[:] = motion.multiplier
    rows = len(state.angle) - 3 * len(new.node_names)
    state.angle[:rows] = motion.angle[:rows]
    index = {name: k for k, name in enumerate(old.node_names)}
    poses = node_poses(old, motion, places)
    for k, name in enumerate(new.node_names):
        if name in poses:
            state.x[k], state.R[k] = poses[name]
        else:
            state.x[k], state.R[k] = motion.x[index[name]], motion.R[index[name]]
            state.angle[rows + 3 * k :][:3] = motion.angle[rows + 3 * index[name] :][:3]
    before, after = old.arrays.members, new.arrays.members
    own = {name: slice(*before.inner_at[i : i + 2]) for i, name in enumerate(old.member_names)}
    cut = {strip.leaf.name: strip.leaf for strip in strips(new)}
    for i, name in enumerate(new.member_names):
        if name in own and not any(name.startswith(f"{leaf}:") for leaf in cut):
            state.inner[slice(*after.inner_at[i : i + 2])] = motion.inner[own[name]]
    for leaf in cut.values():
        for i, start, end in _pieces(new, leaf):
            value, number, inner = member_arrays(new, state, i)
            source = next(p for p in _pieces(old, leaf) if 0.5 * (start + end) <= p[2])[0]
            given, n = motion.inner[own[old.member_names[source]]], int(number[:3].sum())
            inner[n:] = given[len(given) + n - len(inner) :]
            at = start + (end - start) * quadrature_points(value, number)
            inner[:n] = fitted_amplitudes(value, number, curvatures(old, motion, leaf, at))
    return state
