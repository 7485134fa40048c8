"""Leaf springs of a model as exact rods, sampled along their length and divided into parts over which an integration from
the start is well conditioned (`ksd.elements.rod`, `ksd.model.rods`)."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ksd.answers.derived import cached_per_model
from ksd.answers.forces import forces_of_members
from ksd.elements.rod import NODES, ROD, WEIGHTS, unloaded_rod_end
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.leaves import (
    cut_leaves,
    element_leaves,
    leaf_ends,
    leaf_member,
    line_mass,
    rod_compliances,
    secant_compliances,
    stress_free_leaf,
    whole_leaf_name,
)
from ksd.model.rods import Rods

Array = NDArray[np.float64]
MIN_STEPS, MIN_STEPS_VARYING = 4, 16
"""Smallest number of steps along a leaf, and along every part between the breaks of a leaf with a profile or curve.

Steps along a profile are shorter towards its ends, where the thickness of a fillet varies like a square root.
"""
MAX_TURN_PER_STEP = 0.35
"""Largest rotation by curvature plus exponent of growth of perturbations, per step [rad]."""
TURN_PER_STIFFNESS_RATIO_E = 1.5
"""Rotation [rad] that counts for a variation of the bending stiffness by a factor e."""
MAX_GROWTH_PER_PART, MAX_GROWTHS_PER_PART_WITH_WEIGHT = 2.0, (8.0, 2.0)
"""Exponent of the growth of perturbations by tension between two stations, without and with loads along the leaf.

The tangent of a part neglects that these turn with its first station: such leaves get few parts, and more where the gaps of
these do not close.
"""
MAX_TOTAL_TURN = 300.0
"""Upper limit of rotation and growth for which steps are provided."""
END_MARGIN = 1e-9
"""Distance, relative to a step, of sampling points from the ends of the step, where a section may jump."""
MOMENT_STATIONS = 25
"""Stations at which the moments along a leaf with plate stiffening are evaluated."""
MAX_CACHED_CUTS = 8
"""Largest number of divisions of the leaves that are cached per model."""


class _EndOffsets(NamedTuple):
    """Difference between the undeformed ends of a rod and of its member, which integrate a curve differently.

    start_axes (3, 3): axes of end p of the rod in those of the member; end_axes (3, 3), end (3,) [m]: axes and position of
    end q of the rod in the frame q of the member.
    """

    start_axes: Array
    end_axes: Array
    end: Array


class _LeafSamples(NamedTuple):
    """A leaf divided into steps of lengths step (s,) [m], with rod constants (s, 5, ROD) at the nodes of every step.

    offsets: None for a straight leaf.
    """

    step: Array
    rod: Array
    offsets: _EndOffsets | None


class LeafRod(NamedTuple):
    """A leaf as a rod: a leaf of the scene, its piece between points, or an element where the mesh is nodal.

    length [m]; rest_turn: rotation along the undeformed leaf [rad]; max_compliance: largest 1/EI or 1/GJ [1/Nm^2]; axial: EA
    [N]; mass [kg]; samples_by_count: cache of samples by number of steps, shared by equal leaves.
    """

    leaf: Any
    mesh: Any
    has_weight: bool
    length: float
    rest_turn: float
    max_compliance: float
    axial: float
    mass: float
    samples_by_count: dict[int, _LeafSamples]

    def samples(self, count: int) -> _LeafSamples:
        """The leaf divided into `count` steps between breaks."""
        if count not in self.samples_by_count:
            self.samples_by_count[count] = _sample_leaf(self.leaf, self.mesh, self.has_weight, count)
        return self.samples_by_count[count]


class RodSizes(NamedTuple):
    """Fields of `LeafRod` of all leaves of a model, as arrays (k,); min_steps (k,): smallest number of steps."""

    length: Array
    max_compliance: Array
    rest_turn: Array
    mass: Array
    min_steps: NDArray[np.int64]


@cached_per_model
def rod_sizes(model: Model) -> RodSizes:
    """`RodSizes` of a model."""
    leaves = leaf_rods(model)
    uniform = [leaf.leaf.profile is None and leaf.leaf.curve is None for leaf in leaves]
    sizes = np.array([(leaf.length, leaf.max_compliance, leaf.rest_turn, leaf.mass) for leaf in leaves])
    length, max_compliance, rest_turn, mass = sizes.T.copy()
    min_steps = np.where(uniform, MIN_STEPS, MIN_STEPS_VARYING)
    return RodSizes(length, max_compliance, rest_turn, mass, min_steps)


@cached_per_model
def leaf_rods(model: Model) -> tuple[LeafRod, ...]:
    """Rods of all members of a model."""
    weight = model.arrays.weight
    rods: list[LeafRod] = []
    known: dict[tuple[int, Any, bool], LeafRod] = {}
    for i, name in enumerate(model.member_names):
        leaf, mesh = _leaf_and_mesh(model, name)
        has_weight = len(weight) > 0 and weight[i, 0] > 0.0
        # the leaf stays alive in its rod, so its id is not given to another one
        key = id(leaf), mesh, has_weight
        if key not in known:
            known[key] = _leaf_rod(leaf, mesh, has_weight)
        rods.append(known[key])
    return tuple(rods)


def _leaf_rod(leaf: Any, mesh: Any, has_weight: bool) -> LeafRod:
    """A leaf as a rod, with one set of samples."""
    samples = _sample_leaf(leaf, mesh, has_weight, MIN_STEPS_VARYING)
    step, rod = samples.step, samples.rod
    middle = rod[len(step) // 2, 2]
    rest_turn = float(step @ (np.sqrt((rod[:, :, :3] ** 2).sum(axis=2)) @ WEIGHTS))
    if leaf.profile is not None:
        # a varying section needs as many steps as a curve
        ratio = float(rod[:, :, 3:6].max() / rod[:, :, 3:6].min(axis=(0, 1)).max())
        rest_turn += TURN_PER_STIFFNESS_RATIO_E * math.log(ratio)
    mass = float(step @ (rod[:, :, 9] @ WEIGHTS))
    max_compliance, axial = float(rod[:, :, 3:6].max()), 1.0 / max(float(middle[6]), 1e-300)
    cache = {MIN_STEPS_VARYING: samples}
    return LeafRod(leaf, mesh, has_weight, float(step.sum()), rest_turn, max_compliance, axial, mass, cache)


def _leaf_and_mesh(model: Model, name: str) -> tuple[Any, Any]:
    """Leaf (or its piece between points, or an element where the mesh is nodal) and mesh of the member `name`."""
    leaves, wholes = _pieces_and_leaves(model)
    piece = whole_leaf_name(name, leaves)
    leaf, mesh = leaves[piece], model.mesh.for_leaf(whole_leaf_name(piece, wholes))
    # elements are equal parts
    return (leaf if name == piece else element_leaves(leaf, leaf.elements or mesh.elements)[0]), mesh


@cached_per_model
def _pieces_and_leaves(model: Model) -> tuple[dict[str, Any], dict[str, Any]]:
    """Pieces between points of all leaves of a model by full name, and the whole leaves by full name."""
    scene = model.scene
    inside = {f"{j.name}/{leaf.name}": leaf for j in scene.joints for leaf in j.leaves()}
    return inside | {name: leaf for name, _, _, leaf in cut_leaves(scene)}, scene.leaf_names()


def _sample_leaf(leaf: Any, mesh: Any, has_weight: bool, count: int) -> _LeafSamples:
    """A leaf in `count` steps between breaks."""
    step, rod = _sample_sections(stress_free_leaf(leaf), mesh, has_weight, count)
    return _LeafSamples(step, rod, _end_offsets(leaf, mesh, count))


def _sample_sections(leaf: Any, mesh: Any, has_weight: bool, count: int) -> tuple[Array, Array]:
    """Lengths (s,) [m] of the steps along a leaf, `count` between breaks, and rod constants (s, 5, ROD) at their nodes."""
    edges = np.linspace(0.0, 1.0, count + 1)
    if leaf.profile is not None or (leaf.curve is not None and leaf.curve.breaks):
        graded = 0.5 - 0.5 * np.cos(np.pi * edges)
        inside = {b for part in (leaf.profile, leaf.curve) if part is not None for b in part.breaks}
        cuts = [0.0, *sorted(inside), 1.0]
        edges = np.unique([a + (b - a) * x for a, b in pairwise(cuts) for x in graded])
    if leaf.condition is not None and leaf.condition.plate is not None:
        edges = np.unique([*edges, *leaf.condition.plate.breaks])
    share = np.diff(edges)
    s = (edges[:-1, None] + share[:, None] * np.clip(NODES, END_MARGIN, 1.0 - END_MARGIN)).ravel()
    rod = np.zeros((len(s), ROD))
    if leaf.curve is not None:
        rod[:, :3] = leaf.curve.curvatures(s)
    bending, soft = rod_compliances(leaf, mesh, s)
    rod[:, 3:6], rod[:, 6:9] = bending.T, soft.T
    if has_weight:
        rod[:, 9] = line_mass(leaf, s)
    rod[:, 10] = s
    rod[:, 11] = leaf.section.width if leaf.profile is None else leaf.profile.sections(s).width
    return leaf.length * share, rod.reshape(-1, len(NODES), ROD)


def with_plate_moments(model: Model, motion: State, cut: RodParts) -> RodParts:
    """The rods of `cut_rods` with the secant compliance in bending that plate stiffening has at the moments of a state."""
    if not model.mesh.plate:
        return cut
    forces = forces_of_members(
        model, motion, {n: [i] for i, n in enumerate(model.member_names)}, MOMENT_STATIONS, 1.0
    )
    rods, rod = cut.rods, cut.rods.rod.copy()
    for i, name in enumerate(model.member_names):
        leaf, _ = _leaf_and_mesh(model, name)
        plate = None if leaf.condition is None else leaf.condition.plate
        if plate is None or i not in model.strain_leaves:
            continue
        own = slice(*rods.at_step[rods.at_part[[i, i + 1]]])
        along = np.cumsum(rods.step[own]) - rods.step[own]
        s = ((along[:, None] + rods.step[own][:, None] * NODES) / rods.step[own].sum()).ravel()
        moments = CubicSpline(forces[name].s / forces[name].s[-1], forces[name].values[:, 5])(s)
        at = rod[own].reshape(-1, ROD)
        at[:, 5] = secant_compliances(leaf, s, moments, at[:, 5], at[:, 2])
        rod[own] = at.reshape(rod[own].shape)
    return cut._replace(rods=rods._replace(rod=rod))


def _end_offsets(leaf: Any, mesh: Any, count: int) -> _EndOffsets | None:
    """Offsets of the ends of a leaf divided into `count` steps; None for a straight leaf."""
    if leaf.curve is None:
        return None
    end, Q = unloaded_rod_end(*_sample_sections(leaf, mesh, False, count))
    position, axes = leaf_ends(leaf, end, Q, leaf.name)
    member = leaf_member(leaf, mesh, name=leaf.name)
    to_end = member.frame[1].T
    return _EndOffsets(
        member.frame[0].T @ axes[0], to_end @ axes[1], to_end @ (position[1] - member.offset[1])
    )


class RodParts(NamedTuple):
    """Leaves of a model divided into parts.

    start_axes (k, 3, 3): axes of end p of every leaf in those of the member; length, axial, mass (p,): length [m], stiffness
    EA [N] and mass [kg] of every part; leaf (p,): number of its leaf; share (p,): fraction of the leaf before the part.
    """

    rods: Rods
    start_axes: Array
    length: Array
    axial: Array
    mass: Array
    leaf: NDArray[np.int64]
    share: Array


def cut_rods(model: Model, wrench: Array, max_growth_with_weight: float) -> RodParts:
    """Divide all leaves into the steps and parts required by an integration from wrenches (k, 6) at end p.

    max_growth_with_weight: one of `MAX_GROWTHS_PER_PART_WITH_WEIGHT`.
    """
    length, compliance, rest_turn, _, min_steps = rod_sizes(model)
    force, moment = np.sqrt((wrench * wrench).reshape(-1, 2, 3).sum(axis=2)).T
    growth = np.minimum(length * np.sqrt(force * compliance), MAX_TOTAL_TURN)
    turn = np.minimum(rest_turn + length * compliance * moment + growth, MAX_TOTAL_TURN)
    max_growth = np.where(model.arrays.load_modes > 0, max_growth_with_weight, MAX_GROWTH_PER_PART)
    parts = np.maximum(1, np.ceil(growth / max_growth - 0.5)).astype(int)
    turn = np.maximum(turn, MAX_TURN_PER_STEP * np.where(parts > 1, parts, 0))
    # 1, 1.5, 2, 3, 4, 6 ... times the smallest number of steps, so that few divisions occur
    factor = np.maximum(turn / MAX_TURN_PER_STEP / min_steps, 1.0)
    power = 2.0 ** np.floor(np.log2(factor))
    counts = (0.5 * min_steps * power * np.ceil(2.0 * factor / power)).astype(int)
    cache, key = _cached_cuts(model), (counts.tobytes(), parts.tobytes())
    # another thread may clear the cache at any time
    cut = cache.get(key)
    if cut is None:
        if len(cache) >= MAX_CACHED_CUTS:
            cache.clear()
        cut = cache[key] = _cut_at(model, counts.tolist(), parts.tolist())
    return cut


@cached_per_model
def _cached_cuts(model: Model) -> dict[tuple[bytes, bytes], RodParts]:
    """Cache of divisions of the leaves of a model, by numbers of steps and parts of every leaf."""
    return {}


def _cut_at(model: Model, counts: list[int], parts: list[int]) -> RodParts:
    """Divide every leaf into its number of steps between breaks, and of parts."""
    leaves, members = leaf_rods(model), model.arrays.members
    samples = [leaf.samples(n) for leaf, n in zip(leaves, counts, strict=True)]
    at_part, at_step, owner = [0], [0], []
    offset, frame = members.offset.copy(), members.frame.copy()
    start_axes, share = np.tile(np.eye(3), (len(leaves), 1, 1)), []
    for i, (sample, count) in enumerate(zip(samples, parts, strict=True)):
        along = np.cumsum(sample.step)
        ends = 1 + np.searchsorted(along, along[-1] * (np.arange(1, count) / count - 1e-9))
        cuts = sorted({*ends.tolist(), len(along)})
        share += [0.0, *(along[[cut - 1 for cut in cuts[:-1]]] / along[-1])]
        first = at_step[-1]
        at_step += [first + cut for cut in cuts]
        at_part.append(len(at_step) - 1)
        owner += [i] * len(cuts)
        if sample.offsets is not None:
            start_axes[i], end_axes, end = sample.offsets
            offset[i, 1] += frame[i, 1] @ end
            frame[i, 0], frame[i, 1] = frame[i, 0] @ start_axes[i], frame[i, 1] @ end_axes
    step, rod = (np.concatenate([getattr(s, n) for s in samples]) for n in ("step", "rod"))
    rods = Rods(np.array(at_part), np.array(at_step), step, rod, offset, frame)
    axial = np.array([leaves[i].axial for i in owner])
    length, mass = (np.add.reduceat(a, at_step[:-1]) for a in (step, step * (rod[:, :, 9] @ WEIGHTS)))
    return RodParts(rods, start_axes, length, axial, mass, np.array(owner), np.array(share))
