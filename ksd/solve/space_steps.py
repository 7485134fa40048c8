"""The five steps in space, one compiled call per configuration: no Python between the steps.

The kernels of `ksd.solve.pipeline` in a row. Storage is prepared once (`SpaceState`) and handed over as one (`Held`).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ksd.bodies.bench import (
    Inside,
    condense_joints,
    place_insides,
    recover_joints,
    relative_poses,
    set_near,
)
from ksd.bodies.joints import JointBodies
from ksd.bodies.kinematics import Loops, close_loops
from ksd.bodies.readout import intended_motions
from ksd.model.arrays import Arrays, Motion, Work, make_work
from ksd.model.compile import Model
from ksd.model.system import assemble
from ksd.numerics.blocks import factor_blocks, solve_blocks
from ksd.numerics.clock import thread_time
from ksd.numerics.held import Held, opened
from ksd.numerics.kernel import kernel
from ksd.solve.newton import GRAIN, iterate

KINEMATIC, REDUCED, FULL = 0, 1, 2
LINEAR_SIZE = 54


class SpaceBodies(NamedTuple):
    """Everything the five steps read."""

    loops: Loops
    inside: Inside
    full_node: np.ndarray
    bench: Arrays
    reduced: Arrays
    full: Arrays


class SpaceStart(NamedTuple):
    """Rest states."""

    bench: Motion
    reduced: Motion
    full: Motion


class SpaceState(NamedTuple):
    """Storage of one thread: the states and storage of bench, reduced and full mechanism.

    theta (q,), place (J, 24), relative (J, 12): of the joints; found (q,), off (J, 6), known (J,): intended motions of
    the answer and what is left, see `ksd.bodies.readout.intended_motions`.
    """

    theta: np.ndarray
    place: np.ndarray
    relative: np.ndarray
    found: np.ndarray
    off: np.ndarray
    known: np.ndarray
    bench: Motion
    reduced: Motion
    full: Motion
    bench_work: Work
    reduced_work: Work
    full_work: Work
    clock: np.ndarray


class SpaceSet(NamedTuple):
    """What one solve reads and writes."""

    bodies: SpaceBodies
    rest: SpaceStart
    state: SpaceState


def space_set(model: Model, bodies: JointBodies) -> SpaceSet:
    """Prepared storage for `model` with its joint `bodies`."""
    joints, motions = len(bodies.loops.node), len(bodies.motion_names)
    rest = SpaceStart(bodies.bench_rest, bodies.reduced_rest, model.rest)
    state = SpaceState(
        np.zeros(motions), np.zeros((joints, 24)), np.zeros((joints, 12)), np.zeros(motions), np.zeros((joints, 6)),
        np.zeros(joints, np.int64),
        rest.bench.copy(), rest.reduced.copy(), rest.full.copy(),
        make_work(bodies.bench, near=bodies.near), make_work(bodies.reduced), make_work(model.arrays),
        np.zeros(2, np.int64),
    )  # fmt: skip
    parts = (bodies.loops, bodies.inside, bodies.full_node, bodies.bench, bodies.reduced, model.arrays)
    return SpaceSet(SpaceBodies(*parts), rest, state)


@kernel
def _assign(motion, rest):
    motion.x[:] = rest.x
    motion.R[:] = rest.R
    motion.inner[:] = rest.inner
    motion.multiplier[:] = rest.multiplier


@kernel
def note_step(out, row, reason, count, residual, clock, before):
    """Record of a step: reason, iterations, residual or gap, seconds. Returns the time now."""
    now = thread_time(clock)
    out[row, 0], out[row, 1], out[row, 2], out[row, 3] = reason, count, residual, now - before
    return now


@kernel
def start_space(bodies, rest, state, target):
    """Back to rest, then step 1. Returns (reason, iterations, gap left [m])."""
    _assign(state.reduced, rest.reduced)
    _assign(state.bench, rest.bench)
    state.theta[:] = 0.0
    reason, count, left, _ = close_loops(
        bodies.reduced, bodies.loops, state.theta, target, state.reduced, state.place, 40
    )
    return reason, count, left


@kernel
def place_space(bodies, state):
    """Links, internal blocks, inner states and multipliers into the full state."""
    full, reduced, bench = state.full, state.reduced, state.bench
    links, inner = len(reduced.x), len(bench.inner)
    full.x[:links] = reduced.x
    full.R[:links] = reduced.R
    full.inner[:inner] = bench.inner
    full.inner[inner:] = reduced.inner[LINEAR_SIZE * len(bodies.loops.node) :]
    full.multiplier[:] = reduced.multiplier
    inside = bodies.inside
    place_insides(bodies.loops, inside.block_joint, inside.block_node, bodies.full_node, bench, full)


@kernel
def reduce_space(bodies, state, target, passes, kinematic, rtol, out, before):
    """Steps 2 to 4 from the closed loops on, with `passes` relinearised rounds; kinematic: step 2 alone.

    Returns (row after the last one written, negative pivots, time now, 1 when all went well).
    """
    joints, row, negatives, clock = len(bodies.loops.node), 1, 0, state.clock
    set_near(
        bodies.bench, bodies.loops, bodies.inside, state.theta, state.place, state.bench, state.bench_work
    )
    for n in range(passes + 1):
        near = 1 if n == 0 else 0
        _, _, status = condense_joints(
            bodies.bench, joints, state.bench, state.bench_work, near, state.reduced.inner
        )
        # stops of leafs: 1 a local angle, 2 singular
        before = note_step(out, row, status + (status > 0), 0, 0.0, clock, before)
        if status != 0 or kinematic:
            return row + 1, negatives, before, status == 0
        reason, count, worst, negatives, _ = iterate(
            bodies.reduced, state.reduced, target, 1.0, state.reduced_work, rtol, 25, math.inf, math.inf
        )
        before = note_step(out, row + 1, reason, count, worst, clock, before)
        if reason != 0:
            return row + 2, negatives, before, False
        shift, twist = recover_joints(
            bodies.bench, bodies.reduced, joints, state.reduced, state.bench, state.bench_work
        )
        if n == passes:
            place_space(bodies, state)
        before = note_step(out, row + 2, 0, 0, shift, clock, before)
        out[row + 2, 4] = twist
        row += 3
    return row, negatives, before, True


@kernel
def space_steps(held, target, method, passes, closed, rtol, cap, gap, out):
    """Steps 1 to 4, and 5 when `method` is 2, at the drive values target (c,).

    closed: 1 when step 1 is done already, in the held state. out (2 + 3 (passes + 1), 5): see `note_step`; the fifth
    column of step 4 is the largest unintended angle. Returns (rows written, negative pivots of the last equilibrium).
    """
    parts = opened(held)
    bodies, state, clock = parts.bodies, parts.state, parts.state.clock
    before = thread_time(clock)
    if closed == 0:
        reason, count, left = start_space(bodies, parts.rest, state, target)
        before = note_step(out, 0, reason, count, left, clock, before)
        if reason != 0 or not left < gap * bodies.reduced.size:
            return 1, 0
    row, negatives, before, sound = reduce_space(
        bodies, state, target, passes, method == KINEMATIC, rtol, out, before
    )
    if not sound:
        return row, negatives
    if method == KINEMATIC:
        place_space(bodies, state)
    if method == FULL:
        reason, count, worst, negatives, _ = iterate(
            bodies.full, state.full, target, 1.0, state.full_work, rtol, 30, cap, math.inf
        )
        before = note_step(out, row, reason, count, worst, clock, before)
        row += 1
    relative_poses(bodies.reduced, len(bodies.loops.node), state.full.x, state.full.R, state.relative)
    state.found[:] = state.theta
    intended_motions(bodies.loops, state.relative, state.found, state.place, state.off, state.known)
    return row, negatives


@kernel
def look_over(held, target, rtol, step):
    """Residual and inertia of the full state held; step: 1 leaves one Newton step of it in its storage.

    Returns (residual over its bound, negative pivots, status).
    """
    parts = opened(held)
    full, work = parts.bodies.full, parts.state.full_work
    worst, _, inside, status = assemble(full, parts.state.full, target, 1.0, work, rtol, 0 * step, GRAIN)
    negatives, _ = factor_blocks(full.plan, work.value, work.spare, len(full.plan.size))
    if step == 1:
        for i in range(len(work.rhs)):
            work.rhs[i] = -work.rhs[i]
        solve_blocks(full.plan, work.value, work.spare, work.rhs)
    return worst, negatives + inside, status


def hold(parts: SpaceSet) -> Held:
    """The set as the kernels take it."""
    return Held(parts)
