"""A state judged by integration: every leaf spring as the geometrically exact rod that its model stands for.

From end p, with the wrench that the state holds there, the rod is integrated to its other end (`ksd.beam.rod`, order 8).
By how far it misses end q is what the modes or elements of the leaf are wrong by. Where it came to, the rod is an exact one,
so at end q its wrench is what it arrived with plus K6 times the gap, K6 the condensed stiffness of the leaf. One Newton step
of the whole model on what that adds to its nodes leads to where all leaves close; the distance gone is the error of the
state, of method, mesh and residual together. The tangent is that of the model: what it is wrong by makes the figure wrong in
the same proportion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ksd.beam import corotational
from ksd.beam.rod import NODES, ROD, WEIGHTS, integrate_rods
from ksd.beam.weight import PULL
from ksd.model.arrays import STRAIN, Motion
from ksd.model.compile import Model
from ksd.model.leaves import (
    cut_leaves,
    element_leaves,
    leaf_ends,
    leaf_member,
    leaf_of,
    line_mass,
    natural,
    rigidities,
)
from ksd.numerics.rotations import rotation_exp
from ksd.properties.cache import per_model
from ksd.properties.leaf_groups import EndFrames, end_frames, end_levers
from ksd.properties.shape import crossed
from ksd.properties.tangent import Assembled, assembled_tangent, factored
from ksd.properties.words import Shown, listed, number, printed

Array = NDArray[np.float64]
STEPS = 12
"""Steps along a leaf; along every part between the breaks of a profile, where they are shorter towards the ends: there the
thickness of a fillet runs like a root."""
INSIDE = 1e-9
"""Share of a step by which its ends lie inside it, where a section may jump."""
FAR = 0.5
"""Gap from which a rod is not led: steps from so far end in other equilibria of it."""
WIDE = 0.01
"""Gap, over the length or in rad, at which a rod counts as come to its end."""
CLOSED = 1e-8
"""One that is always closed."""
NARROW = 0.3
"""Gap, over EI/(EA L^2), up to which K6 closes it: the stretch that goes with its square is then the smaller part."""
SQUARE = 0.2
"""Force of this stretch, over that by which K6 closes a gap, from which a rod is led."""
ROUNDS = 40
"""Most of these steps."""
GRAIN = 1e-11
"""Displacement, over the size of the mechanism, that counts as rounding."""


class Gaps(NamedTuple):
    """By how far every leaf, integrated from its start, misses its end: names (of elements where the mesh is nodal), values
    (k, 6), shift [m] and turn [rad] in the axes of its start, and lengths (k,) [m]."""

    names: tuple[str, ...]
    values: Array
    lengths: Array


@dataclass(frozen=True, repr=False)
class Verification(Shown):
    """What integration of every leaf spring says of a state, and the state that it corrects this to.

    gaps: of all leaves. forces: of the drives, corrected [N or Nm], force_errors: by how much; reactions: of the supports,
    corrected. links: corrected displacement (3,) [m] of the reference point and rotation matrix (3, 3), by name.
    displacement [m], rotation [rad]: the largest correction of a link. relative: the larger of force error over force and
    displacement error over displacement. unclosed: leaves that could not be integrated to their ends; then nothing is
    corrected and relative is infinite.
    """

    gaps: Gaps
    forces: Mapping[str, float]
    force_errors: Mapping[str, float]
    reactions: Mapping[str, float]
    links: Mapping[str, tuple[Array, Array]]
    displacement: float
    rotation: float
    relative: float
    unclosed: tuple[str, ...] = ()

    def _line(self) -> str:
        if self.unclosed:
            return f"not known, '{self.unclosed[0]}' cannot be integrated to its end"
        return f"{number(100 * self.relative, 2, zero=1e-9)} % by integration of {len(self.gaps.names)} leaf springs"

    @property
    def sentence(self) -> str:
        """The error in words."""
        if self.unclosed:
            names = ", ".join(f"'{name}'" for name in self.unclosed)
            return (
                f"Not verified: integration of {names} does not lead to the end it has; it is too taut for integration from "
                "one end, or not in equilibrium"
            )
        shift, turn = number(1e6 * self.displacement, 2, zero=1e-6), number(1e3 * self.rotation, 2, zero=1e-6)
        worst = ""
        if self.gaps.names:
            miss = _misses(self.gaps.values, self.gaps.lengths)
            name, most = self.gaps.names[int(np.argmax(miss))], number(100 * float(miss.max()), 2, zero=1e-12)
            worst = f"; '{name}' misses its end most, by {most} % of its length"
        return (
            f"Verified by integration of every leaf spring: {number(100 * self.relative, 2, zero=1e-9)} % off (links within "
            f"{shift} um and {turn} mrad{worst})"
        )

    def __str__(self) -> str:
        shift, turn = (
            np.linalg.norm(part, axis=1) for part in (self.gaps.values[:, :3], self.gaps.values[:, 3:])
        )
        rows = [
            (name, number(1e6 * a, 3, zero=1e-9), number(1e3 * b, 3, zero=1e-9))
            for name, a, b in zip(self.gaps.names, shift.tolist(), turn.tolist(), strict=True)
        ]
        forces = [
            (name, number(value, 6, zero=1e-12), number(self.force_errors[name], 2, zero=1e-12))
            for name, value in self.forces.items()
        ]
        drives = [listed(("drive", "corrected [N, Nm]", "error [N, Nm]"), forces)] if forces else []
        return printed(self.sentence, listed(("leaf", "gap [um]", "turned [mrad]"), rows), *drives)


class _Steps(NamedTuple):
    """Rods cut into steps: first[i] to first[i+1] are those of rod i, with lengths step (s,) and numbers rod (s, 5, ROD)."""

    first: NDArray[np.int64]
    step: Array
    rod: Array

    def of(self, which: NDArray[np.int64]) -> _Steps:
        """Those of the rods `which` (k,), which may be named more than once."""
        own = [np.arange(self.first[i], self.first[i + 1]) for i in which.tolist()]
        steps = np.concatenate(own)
        return _Steps(np.cumsum([0, *map(len, own)]), self.step[steps], self.rod[steps])


class _Rods(NamedTuple):
    """All leaves of a model as rods: steps; length, mass, axial stiffness EA (k,); narrow (k,): gap that K6 always closes.
    moved: by what rods differ from their members where they lie at rest, as the end of a curve is found by each in its own
    way: axes (k, 3, 3) of end p seen from those of the member, axes (k, 3, 3) and place (k, 3) of end q alike; None where no
    leaf is curved."""

    steps: _Steps
    length: Array
    mass: Array
    axial: Array
    narrow: Array
    moved: tuple[Array, Array, Array] | None


@per_model
def _rods(model: Model) -> _Rods:
    weight = model.arrays.weight
    made, known = [], {}
    for i, name in enumerate(model.member_names):
        leaf, mesh = _leaf(model, name)
        heavy = len(weight) > 0 and weight[i, 0] > 0.0
        # the leaf is kept beside, or another one might come to have its number
        key = id(leaf), mesh, heavy
        if key not in known:
            known[key] = leaf, _sampled(natural(leaf), mesh, heavy), _moved(leaf, mesh)
        made.append(known[key])
    _, sampled, moves = zip(*made, strict=True)
    first = np.cumsum([0, *(len(step) for step, _ in sampled)])
    step, rod = (np.concatenate(part) for part in zip(*sampled, strict=True))
    length = np.add.reduceat(step, first[:-1])
    mass = np.add.reduceat(step * (rod[:, :, 9] @ WEIGHTS), first[:-1])
    # of the section in the middle
    middle = (first[:-1] + first[1:]) // 2
    axial = 1.0 / np.maximum(rod[middle, 2, 6], 1e-300)
    narrow = NARROW * rod[middle, 2, 6] / (rod[middle, 2, 3:6].max(axis=1) * length**2)
    moved = None
    if any(moves):
        still = np.eye(3), np.eye(3), np.zeros(3)
        turn, end, shift = (np.stack(part) for part in zip(*(m or still for m in moves), strict=True))
        moved = turn, end, shift
    return _Rods(_Steps(first, step, rod), length, mass, axial, np.clip(narrow, CLOSED, WIDE), moved)


def _leaf(model: Model, name: str) -> tuple[Any, Any]:
    """What a member stands for: the leaf, its piece between points, or an element where the mesh is nodal; and its mesh."""
    leaves, wholes = _pieces(model)
    piece = leaf_of(name, leaves)
    leaf, mesh = leaves[piece], model.mesh.of(leaf_of(piece, wholes))
    # elements are equal parts
    return (leaf if name == piece else element_leaves(leaf, leaf.elements or mesh.elements)[0]), mesh


@per_model
def _pieces(model: Model) -> tuple[dict[str, Any], dict[str, Any]]:
    """All leaves of a model by full name, cut at the points on them; and whole."""
    scene = model.scene
    inside = {f"{j.name}/{leaf.name}": leaf for j in scene.joints for leaf in j.leaves()}
    return inside | {name: leaf for name, _, _, leaf in cut_leaves(scene)}, scene.leaf_names()


def _sampled(leaf: Any, mesh: Any, heavy: bool) -> tuple[Array, Array]:
    """Lengths of the steps along a leaf (s,) [m], and its numbers (s, 5, ROD) at their places."""
    edges = np.linspace(0.0, 1.0, STEPS + 1)
    if leaf.profile is not None:
        graded = 0.5 - 0.5 * np.cos(np.pi * edges)
        cuts = [0.0, *leaf.profile.breaks, 1.0]
        edges = np.unique([a + (b - a) * x for a, b in pairwise(cuts) for x in graded])
    share = np.diff(edges)
    s = (edges[:-1, None] + share[:, None] * np.clip(NODES, INSIDE, 1.0 - INSIDE)).ravel()
    rod = np.zeros((len(s), ROD))
    if leaf.curve is not None:
        rod[:, :3] = [leaf.curve.curvature(float(x)) for x in s]
    sections = [leaf.section] if leaf.profile is None else [leaf.profile.section(float(x)) for x in s]
    stiff, soft = zip(*(rigidities(section, leaf, mesh) for section in sections), strict=True)
    rod[:, 3:6], rod[:, 6:9] = 1.0 / np.array(stiff), soft
    if heavy:
        rod[:, 9] = line_mass(leaf, s)
    return leaf.length * share, rod.reshape(-1, len(NODES), ROD)


def _moved(leaf: Any, mesh: Any) -> tuple[Array, Array, Array] | None:
    """turn, end and shift of `_Rods` of one leaf; None of one that is drawn straight."""
    if leaf.curve is None:
        return None
    step, rod = _sampled(leaf, mesh, False)
    none = _Aim(np.zeros((1, 3)), np.eye(3)[None], np.zeros((1, 3)))
    shot = _shoot(_Steps(np.array([0, len(step)]), step, rod), none, np.zeros((1, 6)))
    # what is left of the way from the origin, unrotated
    Q = np.empty((3, 3))
    rotation_exp(-shot.gap[0, 3:], Q)
    place, axes = leaf_ends(leaf, -shot.gap[0, :3], Q, leaf.name)
    made = leaf_member(leaf, mesh, name=leaf.name)
    clamp = made.frame[1].T
    return made.frame[0].T @ axes[0], clamp @ axes[1], clamp @ (place[1] - made.offset[1])


class _Shot(NamedTuple):
    """Rods from wrenches (k, 6) at end p: place, moment and force at end q (k, 9), and the gaps (k, 6) left there; frame
    p."""

    wrench: Array
    end: Array
    gap: Array


class _Aim(NamedTuple):
    """Where rods are to come to, d (k, 3), Q (k, 3, 3), in gravity (k, 3) [m/s^2]; frame p."""

    d: Array
    Q: Array
    gravity: Array


def _shoot(steps: _Steps, aim: _Aim, wrench: Array, tangent: Array | None = None) -> _Shot:
    """Integrate rods from wrenches (k, 6) [N, Nm] at end p; tangent (k, 6, 6): where the motion of end q by these is put."""
    end, gap = np.empty((len(wrench), 9)), np.empty((len(wrench), 6))
    tangent = np.empty((0, 6, 6)) if tangent is None else tangent
    integrate_rods(*steps, aim.gravity, wrench, aim.d, aim.Q, end, gap, tangent)
    return _Shot(wrench, end, gap)


def _misses(gap: Array, length: Array) -> Array:
    """Gaps (k, 6) over the lengths, (k,)."""
    shift, turn = (np.sqrt((part * part).sum(axis=1)) for part in (gap[:, :3], gap[:, 3:]))
    return np.asarray(np.maximum(shift / length, turn))


def _lead(rods: _Rods, aim: _Aim, shot: _Shot, left: NDArray[np.int64]) -> None:
    """Lead the rods `left` to their ends, in place, by Newton steps on the wrenches at end p, halved where they lead further
    off."""
    shot.gap[left] = _shoot(rods.steps.of(left), _Aim(*(part[left] for part in aim)), shot.wrench[left]).gap
    miss = _misses(shot.gap, rods.length)
    change, share, fresh = np.zeros((len(miss), 6)), np.ones(len(miss)), left
    for _ in range(ROUNDS):
        if not len(left):
            return
        if len(fresh):
            tangent = np.empty((len(fresh), 6, 6))
            _shoot(rods.steps.of(fresh), _Aim(*(part[fresh] for part in aim)), shot.wrench[fresh], tangent)
            change[fresh] = np.linalg.solve(tangent, shot.gap[fresh, :, None])[..., 0]
        trial = shot.wrench[left] + share[left, None] * change[left]
        found = _shoot(rods.steps.of(left), _Aim(*(part[left] for part in aim)), trial)
        now = _misses(found.gap, rods.length[left])
        nearer = now < miss[left]
        fresh = left[nearer]
        for part, new in zip(shot, found, strict=True):
            part[fresh] = new[nearer]
        miss[fresh] = now[nearer]
        share[fresh] = np.minimum(1.0, 2.0 * share[fresh])
        share[left[~nearer]] *= 0.5
        left, fresh = (part[miss[part] > rods.narrow[part]] for part in (left, fresh))


def _wrenches(assembled: Assembled) -> tuple[Array, Array]:
    """Force and moment (k, 6) on end q of every leaf, inner residual condensed out, and stiffness K6 (k, 6, 6)."""
    work, motion, members = assembled.work, assembled.motion, assembled.arrays.members
    stiffness = np.empty((len(members.kind), 6, 6))
    for i, kind in enumerate(members.kind.tolist()):
        store = work.store[members.store_at[i] : members.store_at[i + 1]]
        if kind == STRAIN:
            # as `ksd.beam.strain.strain_condense` leaves it
            at = 8 * int(members.number[i, :3].sum())
            stiffness[i] = store[at : at + 36].reshape(6, 6)
            continue
        frame = work.pose[i, :9].reshape(3, 3)
        state = motion.inner[members.inner_at[i] : members.inner_at[i + 1]]
        pose = frame.T @ work.pose[i, 15:], frame.T @ motion.R[members.node[i, 1]] @ members.frame[i, 1]
        value = members.value[members.value_at[i] :]
        corotational.condense(
            value, members.number[i], state, store.copy(), *pose, np.empty(12), stiffness[i]
        )
    return work.lam[: len(stiffness), :6], stiffness


class _Leaves(NamedTuple):
    """The leaves of a state: their ends; wrench (k, 6) at end q and stiffness K6 (k, 6, 6); gravity (k, 3), the moment of
    the weight about end p, weighed (k, 3), and its pull (k, PULL); into (k, 3, 3): from the member's axes to the rod's."""

    ends: EndFrames
    wrench: Array
    stiffness: Array
    gravity: Array
    weighed: Array
    pull: Array
    into: Array | None


def _leaves_of(assembled: Assembled, rods: _Rods, load_factor: float) -> tuple[_Leaves, _Aim, Array]:
    """The leaves, where their rods are to end, and the wrenches (k, 6) of these at end p."""
    model, motion, arrays, work = assembled.model, assembled.motion, assembled.arrays, assembled.work
    members, weight, count = arrays.members, arrays.weight, len(rods.length)
    ends = end_frames(model, motion, np.arange(count))
    Q = ends.frame.swapaxes(1, 2) @ motion.R[members.node[:, 1]] @ members.frame[:, 1]
    wrench, stiffness = _wrenches(assembled)
    n, m = wrench[:, :3], wrench[:, 3:]
    gravity, weighed, pull = np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, PULL))
    heavy = np.flatnonzero(rods.mass > 0.0)
    if len(heavy):
        pull[heavy] = work.store[(members.store_at[heavy + 1] - PULL)[:, None] + np.arange(PULL)]
        gravity[heavy] = load_factor * (weight[heavy, None, 1:] @ ends.frame[heavy])[:, 0]
        weighed = crossed(pull[:, 3:6], gravity)
    at_p = np.hstack([n + rods.mass[:, None] * gravity, m + crossed(ends.d, n) + weighed])
    aim, into = _Aim(ends.d, Q, gravity), None
    if rods.moved is not None:
        turn, clamp, shift = rods.moved
        into = turn.swapaxes(1, 2)
        aim = _Aim(*(_turned(v, into) for v in (ends.d + _turned(shift, Q), Q @ clamp, gravity)))
        at_p = _turned(at_p, into)
    return _Leaves(ends, wrench, stiffness, gravity, weighed, pull, into), aim, at_p


def _added(
    assembled: Assembled, rods: _Rods, leaves: _Leaves, shot: _Shot, moved: Array, kept: NDArray[np.bool_]
) -> Array:
    """Residual (unknowns,) of a state with the leaves `kept` (k,) as rods, which are known from shots at ends that are moved
    (k, 6) from those of the state."""
    arrays, weight, n, m = (
        assembled.arrays,
        assembled.arrays.weight,
        leaves.wrench[:, :3],
        leaves.wrench[:, 3:],
    )
    out = None if leaves.into is None else leaves.into.swapaxes(1, 2)
    gap, end, at_p = (_turned(v, out) for v in (shot.gap, shot.end, shot.wrench))
    r, m_q, n_q = end[:, :3], end[:, 3:6], end[:, 6:]
    # from where the rod came to, to where its end is in this state; beyond K6, which is symmetric, a moment turns with its
    # end by half
    back = gap - moved
    added = (leaves.stiffness @ back[..., None])[..., 0]
    added[:, :3] += n_q - n
    added[:, 3:] += m_q - m + crossed(back[:, :3] + r - leaves.ends.d, n_q) + 0.5 * crossed(back[:, 3:], m_q)
    own, relative = end_levers(leaves.ends)
    added = (added[:, None] @ relative)[:, 0]
    if rods.mass.any():
        # the weight at end p, beyond what the model has there; its moment changes with the gap
        first = -(back[:, None] @ leaves.pull[:, 9:27].reshape(-1, 6, 3))[:, 0]
        moment = at_p[:, 3:] - m_q - crossed(r, n_q) - leaves.weighed + crossed(first, leaves.gravity)
        lost = (rods.mass - weight[:, 0])[:, None] * leaves.gravity
        added -= (np.hstack([lost, moment])[:, None] @ own)[:, 0]
    added[~kept] = 0.0
    rhs, starts = assembled.work.rhs.copy(), arrays.start[arrays.members.node]
    for e in (0, 1):
        free = starts[:, e] >= 0
        np.add.at(rhs, starts[free, e, None] + np.arange(6), added[free, 6 * e : 6 * e + 6])
    return rhs


def _corrected(
    assembled: Assembled, rods: _Rods, solve: Callable[[Array], Array], load_factor: float
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Step (unknowns,) to where all leaves close, their gaps (k, 6) in this state, and whether each rod came to its end.

    Where K6 is no tangent for what a rod has to go, a first step tells about where its ends come to lie; the rod is led
    there, and the step made again.
    """
    leaves, aim, at_p = _leaves_of(assembled, rods, load_factor)
    shot = _shoot(rods.steps, aim, at_p)
    lost = ~np.isfinite(shot.gap[:, 0])
    for part in (shot.end, shot.gap):
        part[lost] = 0.0
    missed = _turned(shot.gap, None if leaves.into is None else leaves.into.swapaxes(1, 2)).copy()
    still, miss = np.zeros_like(missed), np.where(lost, math.inf, _misses(missed, rods.length))
    step = solve(_added(assembled, rods, leaves, shot, still, miss < WIDE))
    moved = _ends_moved(assembled, leaves, step)
    # what is left for the rod to go from where it came to
    left = _misses(missed + moved, rods.length)
    force = (leaves.stiffness[:, :3] @ (missed + moved)[..., None])[..., 0]
    bent = rods.axial * left**2 > SQUARE * np.sqrt((force * force).sum(axis=1))
    led = np.flatnonzero((miss < FAR) & ((miss >= WIDE) | (bent & (left > rods.narrow))))
    if len(led):
        moved[np.setdiff1d(np.arange(len(miss)), led)] = 0.0
        shift = _turned(moved, leaves.into)
        turn = np.empty_like(aim.Q)
        for i, v in enumerate(shift[:, 3:]):
            rotation_exp(v, turn[i])
        _lead(rods, _Aim(aim.d + shift[:, :3], turn @ aim.Q, aim.gravity), shot, led)
        miss[led] = _misses(shot.gap, rods.length)[led]
        step = solve(_added(assembled, rods, leaves, shot, moved, miss < WIDE))
    missed[lost] = math.inf
    return step, missed, miss < WIDE


def _ends_moved(assembled: Assembled, leaves: _Leaves, step: Array) -> Array:
    """Motion (k, 6) of end q relative to end p by a step (unknowns,), frame p."""
    arrays = assembled.arrays
    starts = arrays.start[arrays.members.node]
    moves = np.where(starts[..., None] < 0, 0.0, step[np.maximum(starts, 0)[..., None] + np.arange(6)])
    _, relative = end_levers(leaves.ends)
    return np.asarray((relative @ moves.reshape(-1, 12, 1))[..., 0])


def _turned(v: Array, turn: Array | None) -> Array:
    """Vectors, one or more after another in rows (k, 3 n), or axes (k, 3, 3), turned by (k, 3, 3); as they are for None."""
    if turn is None:
        return v
    rows = v.swapaxes(1, 2) if v.ndim == 3 else v.reshape(len(v), -1, 3)
    found = rows @ turn.swapaxes(1, 2)
    return np.asarray(found.swapaxes(1, 2) if v.ndim == 3 else found.reshape(v.shape))


def verify(model: Model, motion: Motion, target: Array, *, load_factor: float = 1.0) -> Verification:
    """Integrate every leaf of a state, its drives at target (c,) and loads times load_factor; leaves are strain-mode leaves
    or chains. Raises KinematicsError where a motion is left that nothing resists."""
    assembled = assembled_tangent(model, motion, load_factor=load_factor, target=target)
    tangent = factored(assembled)
    gap, length = np.zeros((0, 6)), np.zeros(0)
    unclosed: tuple[str, ...] = ()

    def solve(rhs: Array) -> Array:
        return tangent.solve(-rhs[:, None])[:, 0]

    if len(model.member_names):
        rods = _rods(model)
        step, gap, closed = _corrected(assembled, rods, solve, load_factor)
        length, unclosed = rods.length, tuple(model.member_names[i] for i in np.flatnonzero(~closed))
    else:
        step = solve(assembled.work.rhs)
    return _answer(model, motion, step, Gaps(model.member_names, gap, length), unclosed)


def _answer(model: Model, motion: Motion, step: Array, gaps: Gaps, unclosed: tuple[str, ...]) -> Verification:
    """The verification, from the Newton step (unknowns,) to where all leaves close."""
    arrays, links, drives = model.arrays, model.links, len(model.drive_names)
    known = not unclosed
    moves = step[arrays.start[1:links, None] + np.arange(6)] if known else np.full((links - 1, 6), math.nan)
    change = step[arrays.terms.start] if known else np.full(len(motion.multiplier), math.nan)
    forces, errors = -(motion.multiplier + change), np.abs(change[:drives])
    shift, turn = (float(np.sqrt((p * p).sum(axis=1)).max(initial=0.0)) for p in (moves[:, :3], moves[:, 3:]))
    placed = {}
    for i, link in enumerate(model.scene.links):
        move, turned = moves[i - 1] if i else np.zeros(6), np.empty((3, 3))
        rotation_exp(move[3:], turned)
        placed[link] = motion.x[i] + move[:3] - model.rest.x[i], turned @ motion.R[i]
    moved = GRAIN * arrays.size + np.linalg.norm(motion.x[:links] - model.rest.x[:links], axis=1).max()
    noise = GRAIN * arrays.size * arrays.members.floor.max(initial=0.0) * min(1.0, arrays.size)
    scale = noise + np.abs(motion.multiplier[:drives]).max(initial=0.0)
    relative = max(float(errors.max(initial=0.0)) / max(scale, 1e-300), shift / moved)
    named = model.drive_names, model.support_names
    return Verification(
        gaps, dict(zip(named[0], forces.tolist(), strict=False)), dict(zip(named[0], errors.tolist(), strict=True)),
        dict(zip(named[1], forces[drives:].tolist(), strict=True)), placed, shift, turn,
        relative if known and math.isfinite(relative) else math.inf, unclosed,
    )  # fmt: skip
