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
from ksd.bodies.weight import JOINT_ENTRIES, Hung, hang_joints, turn_gravity
from ksd.model.arrays import Arrays, Motion, Work, make_work
from ksd.model.compile import Model
from ksd.numerics.clock import share_time, thread_time, wall_time
from ksd.numerics.copies import copy_frames, copy_numbers, copy_rows
from ksd.numerics.held import Held, part
from ksd.numerics.kernel import compile_late, kernel
from ksd.solve.near import look_at_joints, motion_limits
from ksd.solve.newton import iterate

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
    hung: Hung


class SpaceStart(NamedTuple):
    """Rest states."""

    bench: Motion
    reduced: Motion
    full: Motion


class SpaceState(NamedTuple):
    """Storage of one thread: the states and storage of bench, reduced and full mechanism.

    theta (q,), place (J, 24), relative (J, 12), series (3, M): of the joints; found (q,), off (J, 6), known
    (J,): intended motions of the answer and what is left, see `ksd.bodies.readout.intended_motions`; limits (q, 4),
    seen (2,): see `ksd.solve.near`.
    """

    theta: np.ndarray
    place: np.ndarray
    relative: np.ndarray
    series: np.ndarray
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
    limits: np.ndarray
    seen: np.ndarray


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
        np.zeros(motions), np.zeros((joints, 24)), np.zeros((joints, 12)),
        np.zeros((3, bodies.loops.pose.shape[2])), np.zeros(motions), np.zeros((joints, 6)),
        np.zeros(joints, np.int64),
        rest.bench.copy(), rest.reduced.copy(), rest.full.copy(),
        make_work(bodies.bench, near=bodies.near), make_work(bodies.reduced), make_work(model.arrays),
        np.zeros(2, np.int64), motion_limits(bodies.motion_range), np.zeros(2, np.int64),
    )  # fmt: skip
    if len(bodies.hung.owner):
        compile_late(*JOINT_ENTRIES)
    parts = (
        bodies.loops, bodies.inside, bodies.full_node, bodies.bench, bodies.reduced, model.arrays, bodies.hung,
    )  # fmt: skip
    return SpaceSet(SpaceBodies(*parts), rest, state)


@kernel
def _assign(motion, rest):
    first = 0 * len(rest.x)
    copy_rows(motion.x, rest.x)
    copy_frames(motion.R, rest.R)
    copy_numbers(motion.inner, first, rest.inner, first)
    copy_numbers(motion.multiplier, first, rest.multiplier, first)


@kernel
def note_step(out, row, reason, count, residual, clock, before):
    """Record of a step: reason, iterations, residual or gap, seconds of the wall. Returns the time now."""
    now = wall_time(clock)
    out[row, 0], out[row, 1], out[row, 2], out[row, 3] = reason, count, residual, now - before
    return now


@kernel
def start_space(held, target):
    """Back to rest, then step 1. Returns (reason, iterations, gap left [m])."""
    reduced, theta = part(held, "state.reduced"), part(held, "state.theta")
    _assign(reduced, part(held, "rest.reduced"))
    _assign(part(held, "state.bench"), part(held, "rest.bench"))
    theta[:] = 0.0
    reason, count, left, _ = close_loops(
        part(held, "bodies.reduced"),
        part(held, "bodies.loops"),
        theta,
        target,
        reduced,
        part(held, "state.place"),
        40,
    )
    return reason, count, left


@kernel
def place_space(held):
    """Links, internal blocks, inner states and multipliers into the full state."""
    full, reduced, bench = part(held, "state.full"), part(held, "state.reduced"), part(held, "state.bench")
    loops, inside = part(held, "bodies.loops"), part(held, "bodies.inside")
    inner = len(bench.inner)
    first = 0 * inner
    copy_rows(full.x, reduced.x)
    copy_frames(full.R, reduced.R)
    copy_numbers(full.inner, first, bench.inner, first)
    copy_numbers(full.inner, inner, reduced.inner, LINEAR_SIZE * len(loops.node))
    copy_numbers(full.multiplier, first, reduced.multiplier, first)
    place_insides(loops, inside.block_joint, inside.block_node, part(held, "bodies.full_node"), bench, full)


@kernel
def near_space(held):
    """Step 2, first half: the near configuration of all joints."""
    set_near(
        part(held, "bodies.bench"), part(held, "bodies.loops"), part(held, "bodies.inside"), part(held, "state.theta"),
        part(held, "state.place"), part(held, "state.bench"), part(held, "state.bench_work"),
    )  # fmt: skip


@kernel
def condense_space(held, near):
    """Step 2, second half: the joints condensed. Returns the worst status of a leaf."""
    hung = part(held, "bodies.hung")
    if len(hung.owner) > 0:
        turn_gravity(
            hung.size.ctypes, hung.owner.ctypes, part(held, "bodies.loops.node").ctypes,
            part(held, "state.reduced.R").ctypes, part(held, "bodies.loops.frame").ctypes,
            part(held, "bodies.bench.weight").ctypes, part(held, "state.bench_work.weight").ctypes,
        )  # fmt: skip
    _, _, status = condense_joints(
        part(held, "bodies.bench"), len(part(held, "bodies.loops.node")), part(held, "state.bench"),
        part(held, "state.bench_work"), near, part(held, "state.reduced").inner,
    )  # fmt: skip
    if len(hung.owner) > 0:
        hang_joints(
            hung.size.ctypes, hung.owner.ctypes, hung.load.ctypes, part(held, "bodies.bench.members.node").ctypes,
            part(held, "bodies.bench.members.store_at").ctypes, part(held, "state.bench.x").ctypes,
            part(held, "state.bench_work.pose").ctypes, part(held, "state.bench_work.store").ctypes,
            part(held, "state.bench_work.weight").ctypes, part(held, "bodies.loops.anchor").ctypes,
            part(held, "bodies.loops.frame").ctypes, part(held, "bodies.reduced.loads.point").ctypes,
        )  # fmt: skip
    return status


@kernel
def recover_space(held):
    """Step 4. Returns the largest displacement [m] and rotation [rad] of an interface off its near pose."""
    return recover_joints(
        part(held, "bodies.bench"), part(held, "bodies.reduced"), len(part(held, "bodies.loops.node")),
        part(held, "state.reduced"), part(held, "state.bench"), part(held, "state.bench_work"),
        part(held, "state.relative"),
    )  # fmt: skip


@kernel
def reduce_space(held, target, passes, kinematic, rtol, out, before):
    """Steps 2 to 4 from the closed loops on, with `passes` relinearised rounds; kinematic: step 2 alone.

    Returns (row after the last one written, negative pivots, time now, 1 when all went well).
    """
    row, negatives, clock = 1, 0, part(held, "state.clock")
    near_space(held)
    for n in range(passes + 1):
        near = 1 if n == 0 else 0
        status = condense_space(held, near)
        # stops of leafs: 1 a local angle, 2 singular
        before = note_step(out, row, status + (status > 0), 0, 0.0, clock, before)
        if status != 0 or kinematic:
            return row + 1, negatives, before, status == 0
        reason, count, worst, negatives, _ = iterate(
            part(held, "bodies.reduced"), part(held, "state.reduced"), target, 1.0, part(held, "state.reduced_work"),
            rtol, 25, math.inf, math.inf,
        )  # fmt: skip
        before = note_step(out, row + 1, reason, count, worst, clock, before)
        if reason != 0:
            return row + 2, negatives, before, False
        shift, twist = recover_space(held)
        if n == passes:
            place_space(held)
        before = note_step(out, row + 2, 0, 0, shift, clock, before)
        out[row + 2, 4] = twist
        row += 3
    return row, negatives, before, True


@kernel
def read_space(held):
    """Intended motions of the answer."""
    loops, full, relative = part(held, "bodies.loops"), part(held, "state.full"), part(held, "state.relative")
    found = part(held, "state.found")
    relative_poses(part(held, "bodies.reduced.members"), len(loops.node), full.x, full.R, relative)
    first = 0 * len(found)
    copy_numbers(found, first, part(held, "state.theta"), first)
    place, off = part(held, "state.place"), part(held, "state.off")
    known = part(held, "state.known")
    intended_motions(loops, relative, found, place, part(held, "state.series"), off, known)
    turn_at = 3 + first
    limits, seen = part(held, "state.limits"), part(held, "state.seen")
    look_at_joints(part(held, "state.theta"), found, off, known, turn_at, limits, loops.length, seen)


@kernel
def untimed_space(held, target, method, passes, closed, rtol, cap, gap, out):
    """`space_steps` without the clock of the thread: for batches."""
    clock = part(held, "state.clock")
    before = wall_time(clock)
    if closed == 0:
        reason, count, left = start_space(held, target)
        before = note_step(out, 0, reason, count, left, clock, before)
        if reason != 0 or not left < gap * part(held, "bodies.reduced.size"):
            return 1, 0
    row, negatives, before, sound = reduce_space(held, target, passes, method == KINEMATIC, rtol, out, before)
    if not sound:
        return row, negatives
    if method == KINEMATIC:
        place_space(held)
    if method == FULL:
        reason, count, worst, negatives, _ = iterate(
            part(held, "bodies.full"), part(held, "state.full"), target, 1.0, part(held, "state.full_work"), rtol, 30,
            cap, math.inf,
        )  # fmt: skip
        before = note_step(out, row, reason, count, worst, clock, before)
        row += 1
    read_space(held)
    return row, negatives


@kernel(needs=("iterate_apart",))
def space_steps(held, target, method, passes, closed, rtol, cap, gap, out):
    """Steps 1 to 4, and 5 when `method` is 2, at the drive values target (c,).

    closed: 1 when step 1 is done already, in the held state. out (2 + 3 (passes + 1), 5): see `note_step`, the seconds
    those of this thread; the fifth column of step 4 is the largest unintended angle. Returns (rows written, negative
    pivots of the last equilibrium).
    """
    clock = part(held, "state.clock")
    cpu, wall = thread_time(clock), wall_time(clock)
    rows, negatives = untimed_space(held, target, method, passes, closed, rtol, cap, gap, out)
    passed = wall_time(clock) - wall
    share_time(out[:rows, 3], thread_time(clock) - cpu, passed)
    return rows, negatives


def hold(parts: SpaceSet) -> Held:
    """The set as the kernels take it."""
    return Held(parts)
