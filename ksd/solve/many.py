"""Many configurations of one design in one compiled call, releasing the interpreter: for batches in threads.

Every configuration starts from rest, as a single solve does (tabulated ones from their neighbour where that is near), and
gets a status: solved, or why not. `tabulated_many` takes the condensed matrices of the joints from a table over their
stroke (`ksd.solve.tables`) instead of step 2, and leaves the insides alone.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.bodies.bench import relative_poses
from ksd.bodies.kinematics import close_loops
from ksd.bodies.readout import intended_motions
from ksd.model.system import assemble, largest_move, largest_turn, solve_step, take_step
from ksd.numerics.blocks import factor_blocks
from ksd.numerics.copies import copy_numbers
from ksd.numerics.held import part
from ksd.numerics.kernel import kernel
from ksd.numerics.local import local_matrix, local_vector
from ksd.numerics.rotations import rotation_log, turn
from ksd.solve.near import far, outside
from ksd.solve.newton import CONVERGED, GRAIN, LOCAL_ANGLE, NOT_FINITE, SINGULAR, TOO_MANY, settled
from ksd.solve.space_steps import LINEAR_SIZE, start_space, untimed_space

LOCKED, OUT_OF_RANGE, UNSTABLE, FAR = 10, 11, 12, 13
"""Statuses beyond those of `ksd.solve.stops.Stop`."""
SPOKEN = {
    LOCKED: "the joints cannot reach this pose by their intended motions",
    OUT_OF_RANGE: "a joint would leave its trained range",
    UNSTABLE: "the state found is not a minimum of energy",
    FAR: "a joint is too far off its intended motion to be the state its record describes",
}
PIECES = 27
"""Numbers of a condensed joint: wrench (6), then the upper triangle of its stiffness (21)."""


@kernel(needs=("iterate_apart",))
def space_many(held, targets, expected, method, passes, ways, limits, force, x, R, motion, status):
    """Solve at targets (N, c); ways = (rtol, cap, gap), limits (q, 2): trained ranges with slack.

    expected: negative pivots of the rows. Writes force (N, c), x (N, links, 3), R (N, links, 3, 3), motion (N, q), status
    (N,).
    """
    theta, off, found = part(held, "state.theta"), part(held, "state.off"), part(held, "state.found")
    full, length, size = (
        part(held, "state.full"),
        part(held, "bodies.loops.length"),
        part(held, "bodies.reduced.size"),
    )
    out = np.zeros((2 + 3 * (passes + 1), 5))
    closed = 0 * passes
    for n in range(len(targets)):
        rows, negatives = untimed_space(
            held, targets[n], method, passes, closed, ways[0], ways[1], ways[2], out
        )
        status[n] = int(out[rows - 1, 0])
        if out[0, 0] != 0 or not out[0, 2] < ways[2] * size:
            status[n] = LOCKED
        elif outside(theta, limits, 0 * n):
            status[n] = OUT_OF_RANGE
        elif status[n] == 0 and negatives != expected:
            status[n] = UNSTABLE
        elif status[n] == 0 and far(off, 3 + 0 * n, length, 0 * n):
            status[n] = FAR
        force[n] = -full.multiplier
        x[n], R[n] = full.x[: x.shape[1]], full.R[: x.shape[1]]
        motion[n] = found


@kernel
def _from_table(table, which, share, inner):
    """Wrench and stiffness of a joint at `share` (0 to 1) of its trained range, into inner (54,)."""
    pieces = table.shape[1]
    at = min(max(share * pieces, 0.0), pieces - 1e-9)
    k = int(at)
    u = at - k
    cubic = table[which, k]
    for e in range(6):
        inner[12 + e] = cubic[0, e] + u * (cubic[1, e] + u * (cubic[2, e] + u * cubic[3, e]))
    e = 6
    for r in range(6):
        for c in range(r, 6):
            value = cubic[0, e] + u * (cubic[1, e] + u * (cubic[2, e] + u * cubic[3, e]))
            inner[18 + 6 * r + c], inner[18 + 6 * c + r] = value, value
            e += 1


@kernel
def _newton(arrays, motion, target, work, rtol, most):
    """As `ksd.solve.newton.iterate` for links and condensed joints alone, without the crossing into a function compiled
    apart, which costs as much as an iteration. Returns (reason, negative pivots)."""
    worst, before, moved = math.inf, math.inf, math.inf
    # a variable, not the literal 0, for which numba would compile `assemble` a second time
    near = 0 * most
    for n in range(most + 1):
        worst, _, inside, status = assemble(
            arrays, motion, target, 1.0, work, rtol, near, GRAIN if n > 0 else 0.0
        )
        if not math.isfinite(worst):
            return NOT_FINITE, 0
        if settled(worst, before, moved):
            negatives, _ = factor_blocks(arrays.plan, work.value, work.spare, len(arrays.plan.size))
            return LOCAL_ANGLE if status == 1 else (
                SINGULAR if status == 2 else CONVERGED
            ), negatives + inside
        _, pivot = solve_step(arrays, work)
        if not pivot > 0.0:
            return SINGULAR, 0
        before = worst
        moved = max(
            largest_turn(arrays, work.rhs) / 1e-6, largest_move(arrays, work.rhs) / (1e-7 * arrays.size)
        )
        take_step(arrays, motion, work.rhs, work, 1.0)
    return TOO_MANY, 0


@kernel
def _nearer(target, before):
    """Whether target (c,) is much nearer to `before` than to rest."""
    far, near = 0.0, 0.0
    for i in range(len(target)):
        far += target[i] ** 2
        near += (target[i] - before[i]) ** 2
    return near < 0.1 * far


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
def _note_offset(motion, kept, off):
    """off (links, 6): displacement and rotation of every link since `kept` (links, 12), its position and rotation."""
    turned, v = local_matrix(3, 3), local_vector(3)
    for k in range(len(kept)):
        for r in range(3):
            off[k, r] = motion.x[k, r] - kept[k, r]
            for c in range(3):
                turned[r, c] = (
                    motion.R[k, r, 0] * kept[k, 3 + 3 * c]
                    + motion.R[k, r, 1] * kept[k, 4 + 3 * c]
                    + motion.R[k, r, 2] * kept[k, 5 + 3 * c]
                )
        rotation_log(turned, v)
        for r in range(3):
            off[k, 3 + r] = v[r]


@kernel
def _keep_links(motion, kept):
    """kept (links, 12): positions and rotations of the links."""
    for k in range(len(kept)):
        for r in range(3):
            kept[k, r] = motion.x[k, r]
            for c in range(3):
                kept[k, 3 + 3 * r + c] = motion.R[k, r, c]


@kernel
def _set_links(motion, kept, off):
    """Links at `kept` and off it by off (links, 6)."""
    for k in range(len(kept)):
        for r in range(3):
            motion.x[k, r] = kept[k, r] + off[k, r]
            for c in range(3):
                motion.R[k, r, c] = kept[k, 3 + 3 * r + c]
        turn(off[k, 3:6], motion.R[k])


@kernel
def _settle(arrays, motion, target, work, rtol, kept, off):
    """Equilibrium of links and condensed joints, first as far off the kinematic pose as the pose before was, off (links, 6),
    where that is anything; which becomes what this one is. Returns (reason, negative pivots)."""
    _keep_links(motion, kept)
    warm = False
    for k in range(len(off)):
        for r in range(6):
            warm = warm or off[k, r] != 0.0
    reason, negatives = TOO_MANY, 0
    if warm:
        _set_links(motion, kept, off)
        reason, negatives = _newton(arrays, motion, target, work, rtol, 4 + 0 * len(kept))
    if reason != CONVERGED:
        # from the kinematic pose itself, with nothing of an attempt that may have left numbers that are none
        off[:] = 0.0
        _set_links(motion, kept, off)
        motion.multiplier[:] = 0.0
        reason, negatives = _newton(arrays, motion, target, work, rtol, 25 + 0 * len(kept))
    if reason == CONVERGED:
        _note_offset(motion, kept, off)
    return reason, negatives


@kernel
def tabulated_many(held, table, which, targets, expected, ways, limits, force, x, R, motion, status):
    """Steps 1 and 3 at targets (N, c), the joints from table (T, pieces, 4, 27); which (J,): table of every joint.

    limits (q, 4): trained ranges with slack, then as they are. A pose much nearer to the one before than to rest starts
    where the last two lead to, and from rest if that fails. Otherwise as `space_many`.
    """
    theta, place, found = part(held, "state.theta"), part(held, "state.place"), part(held, "state.found")
    off, relative, loops = part(held, "state.off"), part(held, "state.relative"), part(held, "bodies.loops")
    reduced, arrays = part(held, "state.reduced"), part(held, "bodies.reduced")
    work = part(held, "state.reduced_work")
    joints, size = len(loops.node), arrays.size
    then, links = theta.copy(), len(reduced.x)
    kept, shift = np.empty((links, 12)), np.zeros((links, 6))
    for n in range(len(targets)):
        reason, gap = TOO_MANY, math.inf
        if n > 0 and status[n - 1] == 0 and _nearer(targets[n], targets[n - 1]):
            if n > 1 and status[n - 2] == 0:
                _go_on(targets[n], targets[n - 1], targets[n - 2], theta, then)
            else:
                then[:] = theta
            reason, _, gap, _ = close_loops(arrays, loops, theta, targets[n], reduced, place, 40)
        else:
            then[:] = theta
            shift[:] = 0.0
        status[n] = 0
        if reason != 0 or not gap < ways[2] * size or outside(theta, limits, 0 * n):
            reason, _, gap = start_space(held, targets[n])
        motion[n] = theta
        if reason != 0 or not gap < ways[2] * size:
            status[n] = LOCKED
            continue
        if outside(theta, limits, 0 * n):
            status[n] = OUT_OF_RANGE
            continue
        for j in range(joints):
            q, inner = loops.first[j], reduced.inner[LINEAR_SIZE * j : LINEAR_SIZE * (j + 1)]
            for r in range(3):
                inner[r] = place[j, 9 + r]
                for c in range(3):
                    inner[3 + 3 * r + c] = place[j, 3 * r + c]
            share = (theta[q] - limits[q, 2]) / (limits[q, 3] - limits[q, 2])
            _from_table(table, which[j], share, inner)
        reason, negatives = _settle(arrays, reduced, targets[n], work, ways[0], kept, shift)
        status[n] = reason
        relative_poses(arrays.members, joints, reduced.x, reduced.R, relative)
        copy_numbers(found, 0 * n, theta, 0 * n)
        series = part(held, "state.series")
        intended_motions(loops, relative, found, place, series, off, part(held, "state.known"))
        if reason == 0 and negatives != expected:
            status[n] = UNSTABLE
        elif reason == 0 and far(off, 3 + 0 * n, loops.length, 0 * n):
            status[n] = FAR
        force[n] = -reduced.multiplier
        x[n], R[n] = reduced.x, reduced.R
        motion[n] = found
