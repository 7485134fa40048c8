"""Leaf springs of a model as exact rods: their numbers along them, in steps and parts that keep the digits of an integration
from the start of each (`ksd.beam.rod`, `ksd.model.rods`)."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ksd.beam.rod import NODES, ROD, WEIGHTS, unloaded_rod_end
from ksd.model.compile import Model
from ksd.model.leaves import (
    cut_leaves,
    element_leaves,
    leaf_ends,
    leaf_member,
    line_mass,
    rigidities,
    stress_free_leaf,
    whole_leaf_name,
)
from ksd.model.rods import Rods
from ksd.properties.cache import cached_per_model

Array = NDArray[np.float64]
STEPS, SHAPED = 4, 16
"""Least steps along a leaf; along every part between the breaks of a profile, and of a curve. Those of a profile are shorter
towards the ends: there the thickness of a fillet runs like a root."""
TURN = 0.35
"""Turning of a rod by its curvature, and growth of its changes, in one step."""
VARIES = 1.5
"""Turning [rad] that a section counts for whose stiffness varies by e."""
GROWTH, HEAVY_GROWTH = 2.0, 8.0
"""Growth of the changes of a rod by its tension, as an exponent, from one station to the next; of one with weight."""
LIMIT = 300.0
"""Most turning, or growth, that is followed."""
INSIDE = 1e-9
"""Share of a step by which its ends lie inside it, where a section may jump."""
KEPT = 8
"""Ways to cut the leaves of a model that are kept."""


class _Sampled(NamedTuple):
    """A leaf cut into steps: lengths step (s,), numbers rod (s, 5, ROD); moved: by what the rod differs from its member
    where it lies at rest, as the end of a curve is found by each in its own way: axes (3, 3) of end p in those of the
    member, axes (3, 3) and place (3,) of end q alike; None for a straight leaf."""

    step: Array
    rod: Array
    moved: tuple[Array, Array, Array] | None


class LeafRod(NamedTuple):
    """What a member stands for: the leaf, its piece between points, or an element where the mesh is nodal; its mesh, whether
    it has weight; length [m]; bent: by how much it turns at rest [rad]; soft: 1/EI about its softest axis; axial: EA; mass
    [kg]; known: its samples by number of steps, shared by equal leaves."""

    leaf: Any
    mesh: Any
    heavy: bool
    length: float
    bent: float
    soft: float
    axial: float
    mass: float
    known: dict[int, _Sampled]

    def sampled(self, count: int) -> _Sampled:
        """The leaf in so many steps."""
        if count not in self.known:
            self.known[count] = _sample(self.leaf, self.mesh, self.heavy, count)
        return self.known[count]


class RodSizes(NamedTuple):
    """Of all leaves of a model (k,), see `LeafRod`; least: the least steps they are cut into."""

    length: Array
    soft: Array
    bent: Array
    mass: Array
    least: NDArray[np.int64]


@cached_per_model
def rod_sizes(model: Model) -> RodSizes:
    """`RodSizes` of a model."""
    leaves = leaf_rods(model)
    plain = [leaf.leaf.profile is None and leaf.leaf.curve is None for leaf in leaves]
    sizes = np.array([(leaf.length, leaf.soft, leaf.bent, leaf.mass) for leaf in leaves])
    length, soft, bent, mass = sizes.T.copy()
    return RodSizes(length, soft, bent, mass, np.where(plain, STEPS, SHAPED))


@cached_per_model
def leaf_rods(model: Model) -> tuple[LeafRod, ...]:
    """What the members of a model stand for."""
    weight = model.arrays.weight
    made: list[LeafRod] = []
    known: dict[tuple[int, Any, bool], LeafRod] = {}
    for i, name in enumerate(model.member_names):
        leaf, mesh = _leaf(model, name)
        heavy = len(weight) > 0 and weight[i, 0] > 0.0
        # the leaf is kept beside, or another one might come to have its number
        key = id(leaf), mesh, heavy
        if key not in known:
            sample = _sample(leaf, mesh, heavy, SHAPED)
            step, rod = sample.step, sample.rod
            middle = rod[len(step) // 2, 2]
            bent = float(step @ (np.sqrt((rod[:, :, :3] ** 2).sum(axis=2)) @ WEIGHTS))
            if leaf.profile is not None:
                # a section that changes is followed as a curve that turns
                bent += VARIES * math.log(float(rod[:, :, 3:6].max() / rod[:, :, 3:6].min(axis=(0, 1)).max()))
            mass = float(step @ (rod[:, :, 9] @ WEIGHTS))
            soft, axial = float(rod[:, :, 3:6].max()), 1.0 / max(float(middle[6]), 1e-300)
            made.append(
                LeafRod(leaf, mesh, heavy, float(step.sum()), bent, soft, axial, mass, {SHAPED: sample})
            )
            known[key] = made[-1]
        else:
            made.append(known[key])
    return tuple(made)


def _leaf(model: Model, name: str) -> tuple[Any, Any]:
    """What a member stands for: the leaf, its piece between points, or an element where the mesh is nodal; and its mesh."""
    leaves, wholes = _pieces(model)
    piece = whole_leaf_name(name, leaves)
    leaf, mesh = leaves[piece], model.mesh.of(whole_leaf_name(piece, wholes))
    # elements are equal parts
    return (leaf if name == piece else element_leaves(leaf, leaf.elements or mesh.elements)[0]), mesh


@cached_per_model
def _pieces(model: Model) -> tuple[dict[str, Any], dict[str, Any]]:
    """All leaves of a model by full name, cut at the points on them; and whole."""
    scene = model.scene
    inside = {f"{j.name}/{leaf.name}": leaf for j in scene.joints for leaf in j.leaves()}
    return inside | {name: leaf for name, _, _, leaf in cut_leaves(scene)}, scene.leaf_names()


def _sample(leaf: Any, mesh: Any, heavy: bool, count: int) -> _Sampled:
    """A leaf in `count` steps between breaks."""
    return _Sampled(*_sampled(stress_free_leaf(leaf), mesh, heavy, count), _moved(leaf, mesh, count))


def _sampled(leaf: Any, mesh: Any, heavy: bool, count: int) -> tuple[Array, Array]:
    """Lengths of the steps along a leaf (s,) [m], `count` between breaks, and its numbers (s, 5, ROD) at their places."""
    edges = np.linspace(0.0, 1.0, count + 1)
    if leaf.profile is not None:
        graded = 0.5 - 0.5 * np.cos(np.pi * edges)
        cuts = [0.0, *leaf.profile.breaks, 1.0]
        edges = np.unique([a + (b - a) * x for a, b in pairwise(cuts) for x in graded])
    share = np.diff(edges)
    s = (edges[:-1, None] + share[:, None] * np.clip(NODES, INSIDE, 1.0 - INSIDE)).ravel()
    rod = np.zeros((len(s), ROD))
    if leaf.curve is not None:
        rod[:, :3] = leaf.curve.curvatures(s)
    section = leaf.section if leaf.profile is None else leaf.profile.sections(s)
    stiff, soft = rigidities(section, leaf, mesh)
    rod[:, 3:6], rod[:, 6:9] = 1.0 / stiff.T, soft.T
    if heavy:
        rod[:, 9] = line_mass(leaf, s)
    return leaf.length * share, rod.reshape(-1, len(NODES), ROD)


def _moved(leaf: Any, mesh: Any, count: int) -> tuple[Array, Array, Array] | None:
    """`_Sampled.moved` of one leaf."""
    if leaf.curve is None:
        return None
    end, Q = unloaded_rod_end(*_sampled(leaf, mesh, False, count))
    place, axes = leaf_ends(leaf, end, Q, leaf.name)
    made = leaf_member(leaf, mesh, name=leaf.name)
    clamp = made.frame[1].T
    return made.frame[0].T @ axes[0], clamp @ axes[1], clamp @ (place[1] - made.offset[1])


class RodParts(NamedTuple):
    """The leaves of a model, cut. turn (k, 3, 3): axes of end p, in those of the member; length, axial, mass (p,): length
    [m], stiffness EA [N] and mass [kg] of every part; of (p,): the leaf it is of; share (p,): of its leaf, before it."""

    rods: Rods
    turn: Array
    length: Array
    axial: Array
    mass: Array
    of: NDArray[np.int64]
    share: Array


def cut_rods(model: Model, wrench: Array) -> RodParts:
    """All leaves in the steps and parts that an integration from wrenches (k, 6) at end p takes."""
    length, soft, bent, mass, least = rod_sizes(model)
    pull, bend = np.sqrt((wrench * wrench).reshape(-1, 2, 3).sum(axis=2)).T
    growth = np.minimum(length * np.sqrt(pull * soft), LIMIT)
    turning = np.minimum(bent + length * soft * bend + growth, LIMIT)
    # the tangent of a part does not know how its weight turns with the station it begins at: few stations for these
    parts = np.maximum(1, np.ceil(growth / np.where(mass > 0.0, HEAVY_GROWTH, GROWTH) - 0.5)).astype(int)
    turning = np.maximum(turning, TURN * np.where(parts > 1, parts, 0))
    # the least, one and a half, two, three, four ... times it
    times = np.maximum(turning / TURN / least, 1.0)
    power = 2.0 ** np.floor(np.log2(times))
    counts = (0.5 * least * power * np.ceil(2.0 * times / power)).astype(int)
    known, ways = _known(model), (counts.tobytes(), parts.tobytes())
    # other threads may forget what is known at any time
    found = known.get(ways)
    if found is None:
        if len(known) >= KEPT:
            known.clear()
        found = known[ways] = _cut(model, counts.tolist(), parts.tolist())
    return found


@cached_per_model
def _known(model: Model) -> dict[tuple[bytes, bytes], RodParts]:
    """Ways to cut the leaves of a model, by steps and parts of every leaf."""
    return {}


def _cut(model: Model, counts: list[int], parts: list[int]) -> RodParts:
    """All leaves in so many steps and parts each."""
    leaves, members = leaf_rods(model), model.arrays.members
    samples = [leaf.sampled(n) for leaf, n in zip(leaves, counts, strict=True)]
    at_part, at_step, of = [0], [0], []
    offset, frame = members.offset.copy(), members.frame.copy()
    turn, share = np.tile(np.eye(3), (len(leaves), 1, 1)), []
    for i, (sample, count) in enumerate(zip(samples, parts, strict=True)):
        along = np.cumsum(sample.step)
        ends = 1 + np.searchsorted(along, along[-1] * (np.arange(1, count) / count - 1e-9))
        cuts = sorted({*ends.tolist(), len(along)})
        share += [0.0, *(along[[cut - 1 for cut in cuts[:-1]]] / along[-1])]
        first = at_step[-1]
        at_step += [first + cut for cut in cuts]
        at_part.append(len(at_step) - 1)
        of += [i] * len(cuts)
        if sample.moved is not None:
            turn[i], clamp, shift = sample.moved
            offset[i, 1] += frame[i, 1] @ shift
            frame[i, 0], frame[i, 1] = frame[i, 0] @ turn[i], frame[i, 1] @ clamp
    step, rod = (np.concatenate([getattr(s, n) for s in samples]) for n in ("step", "rod"))
    rods = Rods(np.array(at_part), np.array(at_step), step, rod, offset, frame)
    axial = np.array([leaves[i].axial for i in of])
    length, mass = (np.add.reduceat(a, at_step[:-1]) for a in (step, step * (rod[:, :, 9] @ WEIGHTS)))
    return RodParts(rods, turn, length, axial, mass, np.array(of), np.array(share))
