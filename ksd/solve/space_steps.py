"""The five steps in space, one compiled call or two for each; storage is prepared once (`SpaceSet`)."""

from __future__ import annotations

import math
import time
from typing import NamedTuple

import numpy as np

from ksd.bodies.flat import JOINT_LENGTH, JOINTS, Inside, Loops
from ksd.bodies.joints import JointBodies
from ksd.bodies.kinematics import close_loops
from ksd.bodies.readout import intended_motions
from ksd.bodies.substructures import (
    condense_joints,
    place_insides,
    recover_joints,
    relative_poses,
    set_near,
)
from ksd.bodies.weight import Hung, hang_joints, turn_gravity
from ksd.model.arrays import Arrays, Motion, Work, make_work
from ksd.model.compile import Model
from ksd.model.newton import iterate
from ksd.numerics.kernel import kernel
from ksd.solve.joint_range import look_at_joints, motion_limits

KINEMATIC, REDUCED, FULL = 0, 1, 2
LINEAR_SIZE = 54


class SpaceBodies(NamedTuple):
    """Everything the five steps read."""

    loops: Loops
    inside: Inside
    full_node: np.ndarray
    substructures: Arrays
    reduced: Arrays
    full: Arrays
    hung: Hung


class SpaceStart(NamedTuple):
    """Rest states."""

    substructures: Motion
    reduced: Motion
    full: Motion


class SpaceState(NamedTuple):
    """Storage of one thread: the states and storage of substructures, reduced and full mechanism.

    theta (q,), place (J, 24), relative (J, 12), series (3, M): of the joints; found (q,), off (J, 6), known
    (J,): intended motions of the answer and what is left, see `ksd.bodies.readout.intended_motions`; limits (q, 4),
    seen (2,): see `ksd.solve.joint_range`.
    """

    theta: np.ndarray
    place: np.ndarray
    relative: np.ndarray
    series: np.ndarray
    found: np.ndarray
    off: np.ndarray
    known: np.ndarray
    substructures: Motion
    reduced: Motion
    full: Motion
    substructure_work: Work
    reduced_work: Work
    full_work: Work
    limits: np.ndarray
    seen: np.ndarray


class SpaceSet(NamedTuple):
    """What one solve reads and writes."""

    bodies: SpaceBodies
    rest: SpaceStart
    state: SpaceState


def space_set(model: Model, bodies: JointBodies, state: SpaceState | None = None) -> SpaceSet:
    """Prepared storage for `model` with its joint `bodies`; state: storage of a design of the same words, taken over."""
    joints, motions = len(bodies.loops.node), len(bodies.motion_names)
    rest = SpaceStart(bodies.substructure_rest, bodies.reduced_rest, model.rest)
    if state is not None:
        state.full.assign(model.rest)
        every = (
            (state.substructure_work, bodies.substructures),
            (state.reduced_work, bodies.reduced),
            (state.full_work, model.arrays),
        )
        for work, arrays in every:
            work.weight[...] = arrays.weight
    state = state or SpaceState(
        np.zeros(motions), np.zeros((joints, 24)), np.zeros((joints, 12)),
        np.zeros((3, bodies.loops.pose.shape[2])), np.zeros(motions), np.zeros((joints, 6)),
        np.zeros(joints, np.int64),
        rest.substructures.copy(), rest.reduced.copy(), rest.full.copy(),
        make_work(bodies.substructures, near=bodies.near), make_work(bodies.reduced), make_work(model.arrays),
        motion_limits(bodies.motion_range), np.zeros(2, np.int64),
    )  # fmt: skip
    parts = (
        bodies.loops, bodies.inside, bodies.full_node, bodies.substructures, bodies.reduced, model.arrays, bodies.hung,
    )  # fmt: skip
    return SpaceSet(SpaceBodies(*parts), rest, state)


def size_of(arrays: Arrays) -> float:
    """Length scale [m] as compiled code reads it: another design may have been written into the arrays."""
    return float(arrays.flat.floats[0])


def close_from_rest(s: SpaceSet, target: np.ndarray) -> tuple[int, int, float]:
    """Back to rest, then step 1. Returns (reason, iterations, gap left [m])."""
    state = s.state
    state.reduced.assign(s.rest.reduced)
    state.substructures.assign(s.rest.substructures)
    state.theta[:] = 0.0
    reason, count, left, _ = close_loops(
        s.bodies.reduced, s.bodies.loops, state.theta, target, state.reduced, state.place, 40
    )
    return reason, count, left


def place_space(s: SpaceSet) -> None:
    """Links, internal blocks, inner states and multipliers into the full state."""
    bodies, full, reduced, substructures = s.bodies, s.state.full, s.state.reduced, s.state.substructures
    links, inner = len(reduced.x), len(substructures.inner)
    full.x[:links], full.R[:links] = reduced.x, reduced.R
    free = reduced.inner[LINEAR_SIZE * len(bodies.loops.node) :]
    full.inner[:inner], full.inner[inner : inner + len(free)] = substructures.inner, free
    full.multiplier[:] = reduced.multiplier
    place_insides(
        *bodies.loops.flat, bodies.inside.flat.ints, bodies.full_node, substructures.x, substructures.R, full.x, full.R,
    )  # fmt: skip


def near_space(s: SpaceSet) -> None:
    """Step 2, first half: the near configuration of all joints."""
    b, state = s.bodies, s.state
    set_near(b.loops, b.inside, state.theta, state.place, state.substructures, state.substructure_work)


def condense_space(s: SpaceSet, near: int) -> int:
    """Step 2, second half: the joints condensed. Returns the worst status of a leaf."""
    b, state, work = s.bodies, s.state, s.state.substructure_work
    loops, hung, members = b.loops, b.hung, b.substructures.members
    if len(hung.owner):
        turn_gravity(
            hung.owner, loops.node, state.reduced.R, loops.frame, b.substructures.weight, work.weight
        )
    _, _, status = condense_joints(
        b.substructures, len(loops.node), state.substructures, work, near, state.reduced.inner
    )
    if len(hung.owner):
        hang_joints(
            hung.owner, hung.load, members.node, members.store_at, state.substructures.x, work.pose, work.store,
            work.weight, loops.anchor, loops.frame, b.reduced.loads.point,
        )  # fmt: skip
    return status


def recover_space(s: SpaceSet) -> tuple[float, float]:
    """Step 4. Returns the largest displacement [m] and rotation [rad] of an interface off its near pose."""
    b, state = s.bodies, s.state
    return recover_joints(
        b.substructures,
        b.loops,
        state.reduced,
        state.substructures,
        state.substructure_work,
        state.relative,
    )


@kernel
def read_joints(loops, shapes, x, R, theta, found, relative, place, series, off, known, limits, seen):
    """Intended motions found (q,) of all joints where links are at x, R, their search begun at theta (q,); loops, shapes: as
    in `ksd.bodies.flat`; the rest as in `SpaceState`."""
    relative_poses(loops, shapes, x, R, relative)
    for q in range(len(theta)):
        found[q] = theta[q]
    intended_motions(loops, shapes, relative, found, place, series, off, known)
    length = shapes[loops[JOINT_LENGTH] : loops[JOINT_LENGTH] + loops[JOINTS]]
    # a variable, not the literal 3
    look_at_joints(theta, found, off, known, 3 + 0 * len(theta), limits, length, seen)


def read_space(s: SpaceSet) -> None:
    """Intended motions of the answer."""
    state = s.state
    read_joints(
        *s.bodies.loops.flat, state.full.x, state.full.R, state.theta, state.found, state.relative, state.place,
        state.series, state.off, state.known, state.limits, state.seen,
    )  # fmt: skip


class _Record:
    """Rows of steps: reason, iterations, residual or gap, seconds of this thread, largest unintended angle."""

    def __init__(self, out: np.ndarray) -> None:
        self.out, self.rows, self.at = out, 0, time.thread_time_ns()

    def step(self, reason: int, count: int, residual: float, twist: float = 0.0) -> None:
        before, self.at = self.at, time.thread_time_ns()
        self.out[self.rows] = reason, count, residual, 1e-9 * (self.at - before), twist
        self.rows += 1


def _reduce(
    s: SpaceSet, target: np.ndarray, relinearisations: int, kinematic: bool, rtol: float, record: _Record
) -> tuple[int, bool]:
    """Steps 2 to 4 from the closed loops on, with `relinearisations` relinearised rounds; kinematic: step 2 alone.

    Returns (negative pivots, whether all went well).
    """
    negatives, state = 0, s.state
    near_space(s)
    for n in range(relinearisations + 1):
        status = condense_space(s, 1 if n == 0 else 0)
        # stops of leaves: 1 a local angle, 2 singular
        record.step(status + (status > 0), 0, 0.0)
        if status != 0 or kinematic:
            return negatives, status == 0
        reason, count, worst, negatives, _ = iterate(
            s.bodies.reduced, state.reduced, target, 1.0, state.reduced_work, rtol, 25, math.inf, math.inf
        )
        record.step(reason, count, worst)
        if reason != 0:
            return negatives, False
        shift, twist = recover_space(s)
        if n == relinearisations:
            place_space(s)
        record.step(0, 0, shift, twist)
    return negatives, True


def space_steps(
    s: SpaceSet, target: np.ndarray, method: int, relinearisations: int, closed: int, rtol: float, cap: float, gap: float,
    out: np.ndarray,
) -> tuple[int, int]:  # fmt: skip
    """Steps 1 to 4, and 5 when `method` is 2, at the drive values target (c,).

    closed: 1 when step 1 is done already, in the storage. out (2 + 3 (passes + 1), 5): see `_Record`. Returns (rows
    written, negative pivots of the last equilibrium).
    """
    record, state = _Record(out), s.state
    if not closed:
        reason, count, left = close_from_rest(s, target)
        record.step(reason, count, left)
        if reason != 0 or not left < gap * size_of(s.bodies.reduced):
            return 1, 0
    negatives, sound = _reduce(s, target, relinearisations, method == KINEMATIC, rtol, record)
    if not sound:
        return record.rows, negatives
    if method == KINEMATIC:
        place_space(s)
    if method == FULL:
        reason, count, worst, negatives, _ = iterate(
            s.bodies.full, state.full, target, 1.0, state.full_work, rtol, 30, cap, math.inf
        )
        record.step(reason, count, worst)
    read_space(s)
    return record.rows, negatives
