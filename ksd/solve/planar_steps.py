"""The five steps in a plane, one compiled call per configuration: no Python between the steps.

Twin of `ksd.solve.pipeline` with three unknowns per node. The state found is lifted to space; `full` is accepted there as
the conventional planar answer is (`ksd.solve.planar`), `reduced` is looked at there by its error estimate.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ksd.bodies.planar_bench import (
    condense_planar,
    place_planar,
    planar_relative,
    recover_planar_joints,
    set_planar_near,
)
from ksd.bodies.planar_bodies import PlanarBodies, PlanarStart
from ksd.bodies.planar_kinematics import PLACE, close_planar, planar_motions
from ksd.bodies.planar_readout import planar_drive_forces
from ksd.bodies.weight import PLANAR_JOINT_ENTRIES, hang_planar_joints, turn_planar_gravity
from ksd.model.arrays import Work
from ksd.model.planar_arrays import PlanarMotion, make_planar_work
from ksd.numerics.clock import share_time, thread_time, wall_time
from ksd.numerics.copies import copy_numbers, copy_rows
from ksd.numerics.held import Held, part
from ksd.numerics.kernel import compile_late, kernel
from ksd.solve.driving import CAP, RTOL
from ksd.solve.near import look_at_joints, motion_limits
from ksd.solve.planar import iterate_planar
from ksd.solve.space_steps import FULL, KINEMATIC, note_step

GAP = 2e-3
"""Largest gap of the closed loops over the size of the mechanism: overconstrained joints never fit exactly, and their
elasticity takes it up in step 3; a linkage that locks leaves more."""
YIELDING = 0.03
"""The same where joints are known not to be aligned, or a drive is known to be met by elasticity alone."""


class PlanarState(NamedTuple):
    """Storage of one thread for repeated planar solves: every array the five steps write into.

    theta (q,): intended motions of step 1; place (J, 9), relative (J, 3), value (J, M), slope (2, M): of the joints;
    found (q,), off (J, 3), known (J,): intended motions of the answer, and what is left; see `planar_motions`; limits
    (q, 4), seen (2,): see `ksd.solve.near`.
    """

    theta: np.ndarray
    place: np.ndarray
    relative: np.ndarray
    value: np.ndarray
    slope: np.ndarray
    found: np.ndarray
    off: np.ndarray
    known: np.ndarray
    bench: PlanarMotion
    reduced: PlanarMotion
    full: PlanarMotion
    bench_work: Work
    reduced_work: Work
    full_work: Work
    clock: np.ndarray
    limits: np.ndarray
    seen: np.ndarray


class PlanarSet(NamedTuple):
    """What one solve reads and writes."""

    bodies: PlanarBodies
    rest: PlanarStart
    state: PlanarState


def planar_state(bodies: PlanarBodies, start: PlanarStart, motion_range: np.ndarray) -> PlanarState:
    """Prepared storage for `bodies`, whose motions are trained over motion_range (q, 2)."""
    loops = bodies.loops
    joints, size, motions = len(loops.node), loops.pose.shape[2], int(loops.first[-1])
    return PlanarState(
        np.zeros(motions), np.zeros((joints, PLACE)), np.zeros((joints, 3)), np.zeros((joints, size)),
        np.zeros((2, size)), np.zeros(motions), np.zeros((joints, 3)),
        np.zeros(joints, np.int64),
        start.bench.copy(), start.reduced.copy(), start.full.copy(),
        make_planar_work(bodies.bench, near=start.near), make_planar_work(bodies.reduced),
        make_planar_work(bodies.full), np.zeros(2, np.int64), motion_limits(motion_range), np.zeros(2, np.int64),
    )  # fmt: skip


@kernel
def _assign(motion, rest):
    first = 0 * len(rest.pose)
    copy_rows(motion.pose, rest.pose)
    copy_numbers(motion.inner, first, rest.inner, first)
    copy_numbers(motion.multiplier, first, rest.multiplier, first)


@kernel
def start_planar(held, target):
    """Back to rest, then step 1. Returns (reason, iterations, gap left [m])."""
    reduced, theta = part(held, "state.reduced"), part(held, "state.theta")
    _assign(reduced, part(held, "rest.reduced"))
    _assign(part(held, "state.bench"), part(held, "rest.bench"))
    theta[:] = 0.0
    reason, count, left, _ = close_planar(
        part(held, "bodies.loops"), part(held, "bodies.reduced.terms"), part(held, "bodies.reduced.size"), theta, target,
        reduced.pose, part(held, "state.reduced_work.near"), part(held, "state.value"), part(held, "state.slope"),
        part(held, "state.place"), 40,
    )  # fmt: skip
    return reason, count, left


@kernel
def near_planar(held):
    """Step 2, first half: the near configuration of all joints."""
    set_planar_near(
        part(held, "bodies.bench"), part(held, "bodies.loops"), part(held, "bodies.inside"), part(held, "state.value"),
        part(held, "state.slope"), part(held, "state.place"), part(held, "state.bench"), part(held, "state.bench_work"),
    )  # fmt: skip


@kernel
def condense_flat(held, near):
    """Step 2, second half: the joints condensed. Returns the worst status of a leaf."""
    hung = part(held, "bodies.hung")
    if len(hung.owner) > 0:
        turn_planar_gravity(
            hung.size.ctypes, hung.owner.ctypes, part(held, "bodies.loops.node").ctypes,
            part(held, "state.reduced.pose").ctypes, part(held, "bodies.loops.frame").ctypes,
            part(held, "bodies.bench.weight").ctypes, part(held, "state.bench_work.weight").ctypes,
        )  # fmt: skip
    _, _, status = condense_planar(
        part(held, "bodies.bench"), len(part(held, "bodies.loops.node")), part(held, "state.bench"),
        part(held, "state.bench_work"), near, part(held, "state.reduced.inner"),
    )  # fmt: skip
    if len(hung.owner) > 0:
        hang_planar_joints(
            hung.size.ctypes, hung.owner.ctypes, hung.load.ctypes, part(held, "bodies.bench.members.node").ctypes,
            part(held, "bodies.bench.members.store_at").ctypes, part(held, "state.bench.pose").ctypes,
            part(held, "bodies.bench.members.offset").ctypes, part(held, "state.bench_work.pose").ctypes,
            part(held, "state.bench_work.store").ctypes, part(held, "state.bench_work.weight").ctypes,
            part(held, "bodies.loops.anchor").ctypes, part(held, "bodies.loops.frame").ctypes,
            part(held, "bodies.reduced.loads.point").ctypes,
        )  # fmt: skip
    return status


@kernel
def recover_flat(held):
    """Step 4. Returns the largest displacement [m] and rotation [rad] of an interface off its near pose."""
    return recover_planar_joints(
        part(held, "bodies.bench"), part(held, "bodies.reduced"), len(part(held, "bodies.loops.node")),
        part(held, "state.reduced.pose"), part(held, "state.reduced_work.near"), part(held, "state.bench"),
        part(held, "state.bench_work"), part(held, "state.relative"),
    )  # fmt: skip


@kernel
def place_flat(held):
    """Links, internal blocks, inner states and multipliers into the full state."""
    place_planar(
        part(held, "bodies.loops"), part(held, "bodies.inside"), part(held, "bodies.full_node"),
        part(held, "state.bench"), part(held, "state.reduced"), part(held, "state.full"),
    )  # fmt: skip


@kernel
def weigh_flat(held, target):
    """Drive forces of the kinematic answer, which is the closed loops as they are."""
    planar_drive_forces(
        part(held, "bodies.reduced"), part(held, "bodies.loops"), part(held, "state.theta"), target,
        part(held, "state.reduced"), part(held, "state.reduced_work.near"), part(held, "state.place"),
        part(held, "state.reduced.multiplier"),
    )  # fmt: skip
    place_flat(held)


@kernel
def read_planar(held, again):
    """Intended motions of the answer; again: the links have moved since step 4."""
    loops, turns, relative = (
        part(held, "bodies.loops"),
        part(held, "state.reduced_work.near"),
        part(held, "state.relative"),
    )
    if again:
        links = part(held, "state.full.pose")[: len(part(held, "state.reduced.pose"))]
        planar_relative(part(held, "bodies.reduced.members"), len(loops.node), links, turns, relative)
    found = part(held, "state.found")
    first = 0 * len(found)
    copy_numbers(found, first, part(held, "state.theta"), first)
    value, slope = part(held, "state.value"), part(held, "state.slope")
    place, off = part(held, "state.place"), part(held, "state.off")
    known = part(held, "state.known")
    planar_motions(loops, relative, found, value, slope, place, off, known)
    turn_at = 2 + first
    limits, seen = part(held, "state.limits"), part(held, "state.seen")
    look_at_joints(part(held, "state.theta"), found, off, known, turn_at, limits, loops.length, seen)


@kernel
def untimed_planar(held, target, method, passes, rtol, cap, gap, out):
    """`planar_steps` without the clock of the thread, whose reading costs as much as a joint: for batches."""
    clock = part(held, "state.clock")
    before = wall_time(clock)
    reason, count, left = start_planar(held, target)
    before = note_step(out, 0, reason, count, left, clock, before)
    if reason != 0 or not left < gap * part(held, "bodies.reduced.size"):
        return 1, 0
    near_planar(held)
    row, negatives = 1, 0
    for n in range(passes + 1):
        near = 1 if n == 0 else 0
        status = condense_flat(held, near)
        # the third stop of a leaf is a singular one
        before = note_step(out, row, status + (status > 0), 0, 0.0, clock, before)
        if status != 0:
            return row + 1, negatives
        if method == KINEMATIC:
            weigh_flat(held, target)
            note_step(out, row, 0, 0, 0.0, clock, before)
            read_planar(held, method == KINEMATIC)
            return row + 1, negatives
        reason, count, worst, negatives, _ = iterate_planar(
            part(held, "bodies.reduced"), part(held, "state.reduced"), target, 1.0, part(held, "state.reduced_work"),
            rtol, 25, math.inf, math.inf,
        )  # fmt: skip
        before = note_step(out, row + 1, reason, count, worst, clock, before)
        if reason != 0:
            return row + 2, negatives
        shift, twist = recover_flat(held)
        if n == passes:
            place_flat(held)
        before = note_step(out, row + 2, 0, 0, shift, clock, before)
        out[row + 2, 4] = twist
        row += 3
    if method == FULL:
        reason, count, worst, negatives, _ = iterate_planar(
            part(held, "bodies.full"), part(held, "state.full"), target, 1.0, part(held, "state.full_work"), rtol, 30,
            cap, math.inf,
        )  # fmt: skip
        before = note_step(out, row, reason, count, worst, clock, before)
        row += 1
    read_planar(held, method == FULL)
    return row, negatives


@kernel(needs=("iterate_planar_apart",))
def planar_steps(held, target, method, passes, rtol, cap, gap, out):
    """Steps 1 to 4, and 5 when `method` is 2, 1 and 2 alone when it is 0, at the drive values target (c,).

    passes: relinearised rounds. out (2 + 3 (passes + 1), 5): see `note_step`, the seconds those of this thread; the fifth
    column of step 4 is the largest unintended angle. Returns (rows of `out` written, negative pivots of the last
    equilibrium); the last row says why it stopped.
    """
    clock = part(held, "state.clock")
    cpu, wall = thread_time(clock), wall_time(clock)
    rows, negatives = untimed_planar(held, target, method, passes, rtol, cap, gap, out)
    passed = wall_time(clock) - wall
    share_time(out[:rows, 3], thread_time(clock) - cpu, passed)
    return rows, negatives


class PlanarSteps:
    """The planar five steps of one model, prepared: call with drive values (c,) of the rows that act in the plane."""

    def __init__(
        self, bodies: PlanarBodies, start: PlanarStart, motion_range: np.ndarray, gap: float = GAP
    ) -> None:
        self.bodies, self.start, self.gap = bodies, start, gap
        if len(bodies.hung.owner):
            compile_late(*PLANAR_JOINT_ENTRIES)
        self.state = planar_state(bodies, start, motion_range)
        self.held = Held(PlanarSet(bodies, start, self.state))
        self._out: dict[int, np.ndarray] = {}

    def __call__(self, target: np.ndarray, *, method: int, passes: int) -> tuple[np.ndarray, int, int]:
        """Solve in place; returns the record, its rows, and the negative pivots."""
        out = self._out.get(passes)
        if out is None:
            out = self._out[passes] = np.zeros((2 + 3 * (passes + 1), 5))
        rows, negatives = planar_steps(self.held, target, method, passes, RTOL, CAP, self.gap, out)
        return out, rows, negatives

    def converged(self, record: list[list[float]], *, method: int, passes: int) -> bool:
        """Whether all steps were taken and the last one converged."""
        whole = 2 if method == KINEMATIC else 1 + 3 * (passes + 1) + (method == FULL)
        return len(record) == whole and record[-1][0] == 0.0 and self.closed(record)

    def closed(self, record: list[list[float]]) -> bool:
        """Whether step 1 closed the loops."""
        return record[0][0] == 0.0 and record[0][2] < self.gap * self.bodies.reduced.size


def prepare_planar(model: Any, bodies: Any, gap: float = GAP) -> PlanarSteps | str:
    """The planar five steps of `model`, or why it has none; gap: as GAP."""
    from ksd.bodies.planar_bodies import planar_bodies
    from ksd.model.plane import plane_of

    plane = plane_of(model)
    if isinstance(plane, str):
        return plane
    made = planar_bodies(plane, bodies)
    return made if isinstance(made, str) else PlanarSteps(*made, bodies.motion_range, gap)
