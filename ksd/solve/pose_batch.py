"""Many configurations of one design, for batches.

Every configuration starts from rest, as a single solve does (tabulated ones from their neighbour where that is near), and
gets a status: solved, or why not. `tabulated_many` takes the condensed matrices of the joints from a table over their
stroke (`ksd.solve.joint_tables`) instead of step 2, and leaves the insides alone.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ksd.bodies.intended_motions import intended_motions
from ksd.bodies.substructures import relative_poses
from ksd.model.newton import CONVERGED, solve_equilibrium
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotate, rotation_log
from ksd.solve.five_steps import LINEAR_SIZE, FiveStepsStorage, close_joints, run_five_steps
from ksd.solve.joint_range import is_far_off, is_outside
from ksd.solve.steps import RTOL

LOCKED, OUT_OF_RANGE, UNSTABLE, FAR, UNANSWERED = 10, 11, 12, 13, 14
"""Statuses beyond those of `ksd.solve.steps.Stop`."""
STATUS_MESSAGES = {
    LOCKED: "the joints cannot reach this pose by their intended motions",
    OUT_OF_RANGE: "a joint would leave its trained range",
    UNSTABLE: "the state found is not a minimum of energy",
    UNANSWERED: "a question was not answered",
    FAR: "a joint is too far off its intended motion to be the state its record describes",
}
NUMBERS_PER_JOINT = 27
"""Numbers of a condensed joint: wrench (6), then the upper triangle of its stiffness (21)."""


class PoseArrays(NamedTuple):
    """Numbers of N poses: force (N, c), x (N, links, 3), R (N, links, 3, 3), motion (N, q), status (N,)."""

    force: np.ndarray
    x: np.ndarray
    R: np.ndarray
    motion: np.ndarray
    status: np.ndarray


def solve_poses(
    b: FiveStepsStorage, targets: np.ndarray, method: int, relinearisations: int, gap: float, limits: np.ndarray,
    found: PoseArrays, ask: Callable[[int], int] | None = None,
) -> None:  # fmt: skip
    """Solve at targets (N, c) into `found`; gap: see `space_steps`; limits (q, 2): trained ranges with slack.

    ask: asks more of every pose that was solved, whose state is in the storage, and returns its status.
    """
    full, links, length = b.full, found.x.shape[1], b.bodies.kinematics.length
    for n, target in enumerate(targets):
        rows, negatives = run_five_steps(b, target, method, relinearisations, gap)
        status = int(rows[-1].stop)
        if rows[0].stop != 0 or not rows[0].residual < gap * b.bodies.reduced.size:
            status = LOCKED
        elif is_outside(b.theta, limits, 0):
            status = OUT_OF_RANGE
        elif status == 0 and negatives != len(target):
            status = UNSTABLE
        elif status == 0 and is_far_off(b.off, 3, length, 0):
            status = FAR
        found.force[n], found.motion[n] = -full.multiplier, b.found
        found.x[n], found.R[n] = full.x[:links], full.R[:links]
        found.status[n] = ask(n) if ask is not None and status == 0 else status


@kernel
def _from_table(cubic, which, share, inner):
    """Wrench and stiffness of every joint at `share` (J,), 0 to 1, of its trained range, into inner (J, 54)."""
    pieces = cubic.shape[1]
    for j in range(len(which)):
        at = min(max(share[j] * pieces, 0.0), pieces - 1e-9)
        k = int(at)
        u, c, n = at - k, cubic[which[j], k], 6
        for i in range(6):
            inner[j, 12 + i] = c[0, i] + u * (c[1, i] + u * (c[2, i] + u * c[3, i]))
        for row in range(6):
            for column in range(row, 6):
                value = c[0, n] + u * (c[1, n] + u * (c[2, n] + u * c[3, n]))
                inner[j, 18 + 6 * row + column] = inner[j, 18 + 6 * column + row] = value
                n += 1


@kernel
def _go_on(target, last, before, theta, then):
    """theta (q,) along the line through the motions of the last two poses, `then` and theta, as far as target (c,) is along
    that of theirs, `before` and `last`; left alone where that is more than thrice as far, or back. then becomes theta."""
    along, square = 0.0, 0.0
    for i in range(len(target)):
        way = last[i] - before[i]
        along += way * (target[i] - last[i])
        square += way * way
    share = along / square if 0.0 < along < 3.0 * square else 0.0
    for q in range(len(theta)):
        now = theta[q]
        theta[q] += share * (now - then[q])
        then[q] = now


@kernel
def _note_offset(x, R, start_x, start_R, off):
    """off (links, 6): displacement and rotation of every link since start_x, start_R."""
    turned, v = np.empty((3, 3)), np.empty(3)
    for k in range(len(off)):
        for r in range(3):
            off[k, r] = x[k, r] - start_x[k, r]
            for c in range(3):
                turned[r, c] = (
                    R[k, r, 0] * start_R[k, c, 0]
                    + R[k, r, 1] * start_R[k, c, 1]
                    + R[k, r, 2] * start_R[k, c, 2]
                )
        rotation_log(turned, v)
        for r in range(3):
            off[k, 3 + r] = v[r]


@kernel
def _add_offset(x, R, off):
    """Links moved and turned by off (links, 6)."""
    for k in range(len(off)):
        for r in range(3):
            x[k, r] += off[k, r]
        rotate(off[k, 3:6], R[k])


def _settle(b: FiveStepsStorage, target: np.ndarray, off: np.ndarray) -> tuple[int, int]:
    """Equilibrium of links and condensed joints, first as far off the kinematic pose as the pose before was, off (links, 6),
    where that is anything; which becomes what this one is. Returns (reason, negative pivots)."""
    arrays, motion, work = b.bodies.reduced, b.reduced, b.reduced_work
    x, R, reason, negatives = motion.x.copy(), motion.R.copy(), -1, 0

    def newton(most: int) -> tuple[int, int]:
        found = solve_equilibrium(arrays, motion, target, 1.0, work, RTOL, most, math.inf, math.inf)
        return found[0], found[3]

    if off.any():
        _add_offset(motion.x, motion.R, off)
        reason, negatives = newton(4)
    if reason != CONVERGED:
        # from the kinematic pose itself, with nothing of an attempt that may have left numbers that are none
        motion.x[:], motion.R[:], motion.multiplier[:], off[:] = x, R, 0.0, 0.0
        reason, negatives = newton(25)
    if reason == CONVERGED:
        _note_offset(motion.x, motion.R, x, R, off)
    return reason, negatives


def solve_tabulated_poses(
    b: FiveStepsStorage, cubic: np.ndarray, which: np.ndarray, targets: np.ndarray, gap: float, limits: np.ndarray,
    found: PoseArrays,
) -> None:  # fmt: skip
    """Steps 1 and 3 at targets (N, c), the joints from cubic (T, pieces, 4, 27); which (J,): table of every joint.

    limits (q, 4): trained ranges with slack, then as they are. A pose much nearer to the one before than to rest starts
    where the last two lead to, and from rest if that fails. Otherwise as `space_many`.
    """
    loops, reduced, theta, status = b.bodies.kinematics, b.reduced, b.theta, found.status
    joints, wide = len(loops.node), gap * b.bodies.reduced.size
    then, shift, first = theta.copy(), np.zeros((len(reduced.x), 6)), loops.first[:-1]
    low, span = limits[first, 2], limits[first, 3] - limits[first, 2]
    inner = reduced.inner[: LINEAR_SIZE * joints].reshape(joints, LINEAR_SIZE)
    for n, target in enumerate(targets):
        closed, way = False, target - targets[n - 1]
        if n and status[n - 1] == 0 and way @ way < 0.1 * (target @ target):
            if n > 1 and status[n - 2] == 0:
                _go_on(target, targets[n - 1], targets[n - 2], theta, then)
            else:
                then[:] = theta
            reason, _, left = close_joints(b, target)
            closed = reason == 0 and left < wide and not is_outside(theta, limits, 0)
        else:
            then[:] = theta
            shift[:] = 0.0
        if not closed:
            b.restart()
            reason, _, left = close_joints(b, target)
            closed = reason == 0 and left < wide
        found.motion[n] = theta
        if not closed or is_outside(theta, limits, 0):
            status[n] = OUT_OF_RANGE if closed else LOCKED
            continue
        inner[:, :3], inner[:, 3:12] = b.place[:, 9:12], b.place[:, :9]
        _from_table(cubic, which, (theta[first] - low) / span, inner)
        status[n], negatives = _settle(b, target, shift)
        relative_poses(*loops.flat, reduced.x, reduced.R, b.relative)
        b.found[:] = theta
        intended_motions(*loops.flat, b.relative, b.found, b.place, b.series, b.off, b.known)
        if status[n] == 0 and negatives != len(target):
            status[n] = UNSTABLE
        elif status[n] == 0 and is_far_off(b.off, 3, loops.length, 0):
            status[n] = FAR
        found.force[n], found.motion[n] = -reduced.multiplier, b.found
        found.x[n], found.R[n] = reduced.x, reduced.R
