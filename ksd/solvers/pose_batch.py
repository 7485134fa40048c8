"""Solve many poses of one design, for batches.

Every pose starts from rest, as a single solve does (a tabulated one from its neighbour where that is near), and gets a
status: solved, or why not; `judge` gives it the verdict of `ksd.solve`. `solve_tabulated_poses` takes the condensed joints
from a table over their stroke (`ksd.solvers.joint_tables`) instead of step 2, and does not recover their substructures.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from ksd.elements.linear import LINEAR_INNER
from ksd.joints.intended_motions import intended_motions
from ksd.joints.substructures import relative_poses
from ksd.model.newton import CONVERGED, RTOL, solve_equilibrium
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotate, rotation_log
from ksd.solvers.five_steps import (
    FiveStepsStorage,
    close_joints,
    read_answer_motions,
    run_five_steps,
)
from ksd.solvers.joint_range import is_outside
from ksd.solvers.steps import Step, equilibrium_iterations

LOCKED, OUT_OF_RANGE, UNSTABLE, REFUSED, UNANSWERED, NOT_SOLVED = 10, 11, 12, 13, 14, 15
"""Statuses of a pose beyond those of `ksd.solvers.steps.Stop`."""
STATUS_MESSAGES = {
    LOCKED: "the joints cannot reach this pose by their intended motions",
    OUT_OF_RANGE: "a joint would leave its trained range",
    UNSTABLE: "the equilibrium next to the state found is not a minimum of energy",
    REFUSED: "the state found is not to be trusted",
    UNANSWERED: "a question was not answered",
    NOT_SOLVED: "no state was found",
}
MAX_WARM_ITERATIONS, MAX_ITERATIONS = 4, 25
"""Newton iterations from the offset of the pose before, and from the kinematic pose."""
MAX_NEIGHBOUR_DISTANCE = 0.1
"""Squared distance of the drive values to those of the pose before, over their squared size, up to which a tabulated pose
starts from there."""
MAX_EXTENSION = 3.0
"""Distance to the new drive values over that of the last two poses up to which motions are extrapolated."""


class Judged(NamedTuple):
    """A pose for `judge`: its number, the steps taken (none with tabulated joints), the largest number of Newton iterations
    to its equilibrium, and the negative pivots of that."""

    n: int
    steps: Sequence[Step]
    iterations: int
    negatives: int


class PoseArrays(NamedTuple):
    """Results of N poses, written in place: force (N, c) [N or Nm], x (N, links, 3) [m], R (N, links, 3, 3), motion (N, q),
    status (N,)."""

    force: np.ndarray
    x: np.ndarray
    R: np.ndarray
    motion: np.ndarray
    status: np.ndarray


def solve_poses(
    b: FiveStepsStorage, targets: np.ndarray, method: str, relinearisations: int, gap: float, limits: np.ndarray,
    result: PoseArrays, judge: Callable[[Judged], int], answer: Callable[[int], int] | None = None,
) -> None:  # fmt: skip
    """Solve at targets (N, c) by the five steps and write into `result`.

    method, gap: see `run_five_steps`; limits (q, 2): trained ranges with tolerance. judge: returns 0 or REFUSED for a
    converged pose, whose state is in the storage; answer: called with the number of every pose that is solved, or refused
    as a flag only, returns its status.
    """
    full, links = b.full_state, result.x.shape[1]
    for n, target in enumerate(targets):
        steps, negatives = run_five_steps(b, target, method, relinearisations, gap, limits)
        status = int(steps[-1].stop)
        if steps[0].stop != 0 or not steps[0].residual < gap * b.bodies.reduced.size:
            status = LOCKED
        elif is_outside(b.theta, limits, 0):
            status = OUT_OF_RANGE
        elif status == 0:
            read_answer_motions(b)
            status = judge(Judged(n, steps, equilibrium_iterations(steps), negatives))
        result.force[n], result.motion[n] = -full.multiplier, b.answer_theta
        result.x[n], result.R[n] = full.x[:links], full.R[:links]
        answered = answer(n) if answer is not None and status in (0, REFUSED) else 0
        result.status[n] = status or answered


@kernel
def _interpolate_joints(cubic, table, share, inner):
    """Write wrench and stiffness of every joint at `share` (J,), 0 to 1, of its trained range into inner (J, 54).

    cubic (T, pieces, 4, 27): see `JointTables`; table (J,): number of the joint's table.
    """
    pieces = cubic.shape[1]
    for j in range(len(table)):
        at = min(max(share[j] * pieces, 0.0), pieces - 1e-9)
        k = int(at)
        u, c, n = at - k, cubic[table[j], k], 6
        for i in range(6):
            inner[j, 12 + i] = c[0, i] + u * (c[1, i] + u * (c[2, i] + u * c[3, i]))
        for row in range(6):
            for column in range(row, 6):
                value = c[0, n] + u * (c[1, n] + u * (c[2, n] + u * c[3, n]))
                inner[j, 18 + 6 * row + column] = inner[j, 18 + 6 * column + row] = value
                n += 1


@kernel
def _extrapolate_motions(target, last, before, theta, previous):
    """Extrapolate theta (q,) along the line through the motions of the last two poses, `previous` and theta, as far as
    target (c,) lies along the line through their drive values, `before` and `last`.

    Where that is backwards or beyond MAX_EXTENSION, theta is left unchanged. `previous` becomes the theta given.
    """
    along, square = 0.0, 0.0
    for i in range(len(target)):
        step = last[i] - before[i]
        along += step * (target[i] - last[i])
        square += step * step
    share = along / square if 0.0 < along < MAX_EXTENSION * square else 0.0
    for q in range(len(theta)):
        now = theta[q]
        theta[q] += share * (now - previous[q])
        previous[q] = now


@kernel
def _link_offsets(x, R, start_x, start_R, offset):
    """Write displacement [m] and rotation vector of every link from start_x, start_R to x, R into offset (links, 6)."""
    turned, v = np.empty((3, 3)), np.empty(3)
    for k in range(len(offset)):
        for r in range(3):
            offset[k, r] = x[k, r] - start_x[k, r]
            for c in range(3):
                turned[r, c] = (
                    R[k, r, 0] * start_R[k, c, 0]
                    + R[k, r, 1] * start_R[k, c, 1]
                    + R[k, r, 2] * start_R[k, c, 2]
                )
        rotation_log(turned, v)
        for r in range(3):
            offset[k, 3 + r] = v[r]


@kernel
def _move_links(x, R, offset):
    """Move and turn all links by offset (links, 6), in place."""
    for k in range(len(offset)):
        for r in range(3):
            x[k, r] += offset[k, r]
        rotate(offset[k, 3:6], R[k])


def _reduced_equilibrium(b: FiveStepsStorage, target: np.ndarray, offset: np.ndarray) -> tuple[int, int, int]:
    """Equilibrium of links and condensed joints, in storage. Returns (stop reason, iterations, negative pivots).

    offset (links, 6): that of the pose before from its kinematic pose, from which Newton starts unless it is zero; becomes
    that of this pose.
    """
    arrays, motion, work = b.bodies.reduced, b.reduced_state, b.reduced_work
    x, R, reason, count, negatives = motion.x.copy(), motion.R.copy(), -1, 0, 0

    def newton(most: int) -> tuple[int, int, int]:
        found = solve_equilibrium(arrays, motion, target, 1.0, work, RTOL, most, math.inf, math.inf)
        return found[0], found[1], found[3]

    if offset.any():
        _move_links(motion.x, motion.R, offset)
        reason, count, negatives = newton(MAX_WARM_ITERATIONS)
    if reason != CONVERGED:
        # from the kinematic pose itself; the failed attempt may have left numbers that are not finite
        motion.x[:], motion.R[:], motion.multiplier[:], offset[:] = x, R, 0.0, 0.0
        reason, count, negatives = newton(MAX_ITERATIONS)
    if reason == CONVERGED:
        _link_offsets(motion.x, motion.R, x, R, offset)
    return reason, count, negatives


def solve_tabulated_poses(
    b: FiveStepsStorage, cubic: np.ndarray, table: np.ndarray, targets: np.ndarray, gap: float, limits: np.ndarray,
    result: PoseArrays, judge: Callable[[Judged], int],
) -> None:  # fmt: skip
    """Take steps 1 and 3 at targets (N, c) with tabulated joints, and write into `result`.

    cubic (T, pieces, 4, 27), table (J,): see `JointTables`; gap: see `run_five_steps`; limits (q, 4): trained ranges with
    tolerance, then as they are. judge: see `solve_poses`. A pose near the one before starts from the extrapolation of the
    last two, and from rest if that fails.
    """
    loops, reduced, theta, status = b.bodies.kinematics, b.reduced_state, b.theta, result.status
    joints, max_gap = len(loops.node), gap * b.bodies.reduced.size
    previous, offset, first = theta.copy(), np.zeros((len(reduced.x), 6)), loops.first[:-1]
    low, span = limits[first, 2], limits[first, 3] - limits[first, 2]
    inner = reduced.inner[: LINEAR_INNER * joints].reshape(joints, LINEAR_INNER)
    for n, target in enumerate(targets):
        closed, step = False, target - targets[n - 1]
        if n and status[n - 1] == 0 and step @ step < MAX_NEIGHBOUR_DISTANCE * (target @ target):
            if n > 1 and status[n - 2] == 0:
                _extrapolate_motions(target, targets[n - 1], targets[n - 2], theta, previous)
            else:
                previous[:] = theta
            reason, _, open_gap = close_joints(b, target)
            closed = reason == 0 and open_gap < max_gap and not is_outside(theta, limits, 0)
        else:
            previous[:] = theta
            offset[:] = 0.0
        if not closed:
            b.restart()
            reason, _, open_gap = close_joints(b, target)
            closed = reason == 0 and open_gap < max_gap
        result.motion[n] = theta
        if not closed or is_outside(theta, limits, 0):
            status[n] = OUT_OF_RANGE if closed else LOCKED
            continue
        inner[:, :3], inner[:, 3:12] = b.joint_pose[:, 9:12], b.joint_pose[:, :9]
        _interpolate_joints(cubic, table, (theta[first] - low) / span, inner)
        status[n], count, negatives = _reduced_equilibrium(b, target, offset)
        relative_poses(*loops.flat, reduced.x, reduced.R, b.relative_pose)
        b.answer_theta[:] = theta
        intended_motions(
            *loops.flat, b.relative_pose, b.answer_theta, b.joint_pose, b.series, b.unintended, b.is_known
        )
        if status[n] == 0:
            status[n] = judge(Judged(n, (), count, negatives))
        result.force[n], result.motion[n] = -reduced.multiplier, b.answer_theta
        result.x[n], result.R[n] = reduced.x, reduced.R
