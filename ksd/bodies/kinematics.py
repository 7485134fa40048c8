"""Step 1 of the KSD method, compiled: joints move only as intended, loops close, drives are met.

Unknowns are the intended motions theta of all joints. Links hang on a spanning tree; every joint left over
closes a loop with six equations, every drive or support adds one. Gauss-Newton on the least-squares problem
handles the redundant equations of an overconstrained loop. Paper 1, section 2.2. No finite differences.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.bodies.joint_arrays import (
    ANCHOR,
    AXES,
    BRANCHES,
    CLOSING,
    CLOSINGS,
    FIRST,
    JOINT_NODE,
    MONOMIALS,
    TREE,
    JointKinematics,
)
from ksd.bodies.joint_poses import joint_poses
from ksd.model.arrays import (
    ROWS,
    TERM_COEFFICIENT,
    TERM_FIRST,
    TERM_KIND,
    TERM_NODE,
    TRANSLATION,
    Arrays,
    State,
)
from ksd.model.loading import term_slope
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log


@kernel(inline="late")
def interface_pose(loops, shapes, j, end, x, R, frames, i):
    """Axes of interface A (end 0) or B (1) of joint j on its link into frames[i, :3], its position into frames[i, 3]."""
    node, F = loops[loops[JOINT_NODE] + 2 * j + end], loops[AXES] + 9 * j
    anchor = loops[ANCHOR] + 6 * j + 3 * end
    for r in range(3):
        p, q, s = R[node, r, 0], R[node, r, 1], R[node, r, 2]
        for c in range(3):
            frames[i, r, c] = p * shapes[F + c] + q * shapes[F + 3 + c] + s * shapes[F + 6 + c]
        frames[i, 3, r] = x[node, r] + p * shapes[anchor] + q * shapes[anchor + 1] + s * shapes[anchor + 2]


@kernel(inline="late")
def _place_link(loops, shapes, j, end, frames, x, R):
    """`interface_pose` the other way round: the link whose interface stands at frames[end]."""
    node, F = loops[loops[JOINT_NODE] + 2 * j + end], loops[AXES] + 9 * j
    anchor = loops[ANCHOR] + 6 * j + 3 * end
    for r in range(3):
        p, q, s = frames[end, r, 0], frames[end, r, 1], frames[end, r, 2]
        for c in range(3):
            R[node, r, c] = p * shapes[F + 3 * c] + q * shapes[F + 3 * c + 1] + s * shapes[F + 3 * c + 2]
        p, q, s = R[node, r, 0], R[node, r, 1], R[node, r, 2]
        x[node, r] = frames[end, 3, r] - p * shapes[anchor] - q * shapes[anchor + 1] - s * shapes[anchor + 2]


@kernel(inline="late")
def _onward(place, j, frames, i):
    """frames[i]: where interface B of joint j is meant to be, its interface A at frames[0]."""
    for r in range(3):
        p, q, s = frames[0, r, 0], frames[0, r, 1], frames[0, r, 2]
        for c in range(3):
            frames[i, r, c] = p * place[j, c] + q * place[j, 3 + c] + s * place[j, 6 + c]
        frames[i, 3, r] = frames[0, 3, r] + p * place[j, 9] + q * place[j, 10] + s * place[j, 11]


@kernel(inline="late")
def _backward(place, j, frames):
    """frames[0]: where interface A of joint j is meant to be, its interface B at frames[1]."""
    for r in range(3):
        p, q, s = frames[1, r, 0], frames[1, r, 1], frames[1, r, 2]
        for c in range(3):
            frames[0, r, c] = p * place[j, 3 * c] + q * place[j, 3 * c + 1] + s * place[j, 3 * c + 2]
        p, q, s = frames[0, r, 0], frames[0, r, 1], frames[0, r, 2]
        frames[0, 3, r] = frames[1, 3, r] - p * place[j, 9] - q * place[j, 10] - s * place[j, 11]


@kernel(inline="late")
def _own_twist(place, j, k, frames, a0, a1, a2):
    """Twist (v, w) by the joint's own motion k of a point at a from its interface B: w = A dphi, v = A dd + w x a, with the
    axes A of its interface A in frames[0]."""
    at = 12 + 6 * k
    d0, d1, d2 = place[j, at], place[j, at + 1], place[j, at + 2]
    p0, p1, p2 = place[j, at + 3], place[j, at + 4], place[j, at + 5]
    w0 = frames[0, 0, 0] * p0 + frames[0, 0, 1] * p1 + frames[0, 0, 2] * p2
    w1 = frames[0, 1, 0] * p0 + frames[0, 1, 1] * p1 + frames[0, 1, 2] * p2
    w2 = frames[0, 2, 0] * p0 + frames[0, 2, 1] * p1 + frames[0, 2, 2] * p2
    v0 = frames[0, 0, 0] * d0 + frames[0, 0, 1] * d1 + frames[0, 0, 2] * d2 + w1 * a2 - w2 * a1
    v1 = frames[0, 1, 0] * d0 + frames[0, 1, 1] * d1 + frames[0, 1, 2] * d2 + w2 * a0 - w0 * a2
    v2 = frames[0, 2, 0] * d0 + frames[0, 2, 1] * d1 + frames[0, 2, 2] * d2 + w0 * a1 - w1 * a0
    return v0, v1, v2, w0, w1, w2


@kernel(inline="late")
def _hang(loops, shapes, place, t, x, R, W, reach, frames):
    """Pose of the link beyond branch t of the tree and its twist columns W (node, motion, 6), from the link before it;
    motions from reach[0] (node) on do not move a link, reach[1] is the one before it."""
    j, forward = loops[loops[TREE] + 2 * t], loops[loops[TREE] + 2 * t + 1]
    near, far = loops[loops[JOINT_NODE] + 2 * j + 1 - forward], loops[loops[JOINT_NODE] + 2 * j + forward]
    interface_pose(loops, shapes, j, 1 - forward, x, R, frames, 1 - forward)
    if forward == 1:
        _onward(place, j, frames, forward)
    else:
        _backward(place, j, frames)
    _place_link(loops, shapes, j, forward, frames, x, R)
    first, last = loops[loops[FIRST] + j], loops[loops[FIRST] + j + 1]
    begin, end = reach[0, near], max(reach[0, near], last)
    reach[0, far], reach[1, far] = end, near
    for q in range(begin, end):
        for r in range(6):
            W[far, q, r] = 0.0
    a0, a1, a2 = x[far, 0] - x[near, 0], x[far, 1] - x[near, 1], x[far, 2] - x[near, 2]
    for q in range(begin):
        w0, w1, w2 = W[near, q, 3], W[near, q, 4], W[near, q, 5]
        W[far, q, 0] = W[near, q, 0] + w1 * a2 - w2 * a1
        W[far, q, 1] = W[near, q, 1] + w2 * a0 - w0 * a2
        W[far, q, 2] = W[near, q, 2] + w0 * a1 - w1 * a0
        W[far, q, 3], W[far, q, 4], W[far, q, 5] = w0, w1, w2
    a0, a1, a2 = x[far, 0] - frames[1, 3, 0], x[far, 1] - frames[1, 3, 1], x[far, 2] - frames[1, 3, 2]
    sign = 2.0 * forward - 1.0
    for q in range(first, last):
        v0, v1, v2, w0, w1, w2 = _own_twist(place, j, q - first, frames, a0, a1, a2)
        W[far, q, 0] += sign * v0
        W[far, q, 1] += sign * v1
        W[far, q, 2] += sign * v2
        W[far, q, 3] += sign * w0
        W[far, q, 4] += sign * w1
        W[far, q, 5] += sign * w2


@kernel(inline="late")
def _close_joint(loops, shapes, place, c, size, x, R, W, J, residual, frames):
    """Six equations of the joint that closes loop c: interface B on its link where the one from A on is."""
    j, row = loops[loops[CLOSING] + c], 6 * c
    a, b = loops[loops[JOINT_NODE] + 2 * j], loops[loops[JOINT_NODE] + 2 * j + 1]
    for end in range(2):
        interface_pose(loops, shapes, j, end, x, R, frames, end)
    # no literal, for which numba would compile `_onward` once more
    _onward(place, j, frames, 2 + 0 * c)
    for r in range(3):
        p, q, s = frames[1, r, 0], frames[1, r, 1], frames[1, r, 2]
        for k in range(3):
            frames[3, r, k] = p * frames[2, k, 0] + q * frames[2, k, 1] + s * frames[2, k, 2]
    rotation_log(frames[3], frames[3, 3])
    for r in range(3):
        residual[row + r] = frames[1, 3, r] - frames[2, 3, r]
        residual[row + 3 + r] = size * frames[3, 3, r]
    for q in range(W.shape[1]):
        for r in range(3):
            i, k = (r + 1) % 3, (r + 2) % 3
            J[row + 3 + r, q] = size * (W[b, q, 3 + r] - W[a, q, 3 + r])
            J[row + r, q] = (
                W[b, q, r] - W[a, q, r]
                + W[b, q, 3 + i] * (frames[1, 3, k] - x[b, k]) - W[b, q, 3 + k] * (frames[1, 3, i] - x[b, i])
                - W[a, q, 3 + i] * (frames[2, 3, k] - x[a, k]) + W[a, q, 3 + k] * (frames[2, 3, i] - x[a, i])
            )  # fmt: skip
    first = loops[loops[FIRST] + j]
    for q in range(first, loops[loops[FIRST] + j + 1]):
        v0, v1, v2, w0, w1, w2 = _own_twist(place, j, q - first, frames, 0.0, 0.0, 0.0)
        J[row, q] -= v0
        J[row + 1, q] -= v1
        J[row + 2, q] -= v2
        J[row + 3, q] -= size * w0
        J[row + 4, q] -= size * w1
        J[row + 5, q] -= size * w2


@kernel
def loop_equations(ints, floats, loops, shapes, target, x, R, place, reach, W, J, residual, frames, slope):
    """Link poses for the joints' places (into x, R), residual (E,) and Jacobian J (E, motions); rotations times the size.

    ints, floats: of a model with the links, as in `ksd.model.arrays.FlatArrays`; loops, shapes: as in
    `ksd.bodies.joint_arrays`. Rows: six per closing joint, then one per constraint row of the model. W and J hold zeros
    at the first call; what stays zero is not written, so that a joint of a long chain costs little more. reach (2, k),
    frames (4, 4, 3), slope (8, 3): scratch.
    """
    for k in range(reach.shape[1]):
        reach[0, k], reach[1, k] = 0, -1
    for t in range(loops[BRANCHES]):
        _hang(loops, shapes, place, t, x, R, W, reach, frames)
    for c in range(loops[CLOSINGS]):
        _close_joint(loops, shapes, place, c, floats[0], x, R, W, J, residual, frames)
    _constraint_equations(ints, floats, target, x, R, reach, W, J, residual, 6 * loops[CLOSINGS], slope)


@kernel(inline="late")
def _term_columns(ints, reach, t):
    """First and last but one motion that constraint term t depends on: a rotation between a link and the one it hangs on
    knows the joint between them alone."""
    a, b = ints[ints[TERM_NODE] + 2 * t], ints[ints[TERM_NODE] + 2 * t + 1]
    from_a, from_b = reach[0, a], reach[0, b]
    before_a, before_b = reach[1, a], reach[1, b]
    first = 0
    if ints[ints[TERM_KIND] + t] != TRANSLATION:
        if before_b == a:
            first = from_a
        elif before_a == b:
            first = from_b
    return first, max(from_a, from_b)


@kernel(inline="late")
def _row_columns(ints, reach, i):
    """The same of row i."""
    begin = ints[ints[TERM_FIRST] + i]
    first, last = _term_columns(ints, reach, begin)
    for t in range(begin + 1, ints[ints[TERM_FIRST] + i + 1]):
        low, high = _term_columns(ints, reach, t)
        first, last = min(first, low), max(last, high)
    return first, last


@kernel(inline="late")
def _constraint_equations(ints, floats, target, x, R, reach, W, J, residual, row, slope):
    """One equation per drive or support: sum of terms minus target, with its derivative along the twist columns."""
    for i in range(ints[ROWS]):
        rotations, size, total = 0, floats[0], -target[i]
        begin, end = ints[ints[TERM_FIRST] + i], ints[ints[TERM_FIRST] + i + 1]
        first, last = _row_columns(ints, reach, i)
        for q in range(first, last):
            J[row + i, q] = 0.0
        for t in range(begin, end):
            c = floats[ints[TERM_COEFFICIENT] + t]
            total += c * term_slope(ints, floats, x, R, t, slope)
            a, b = ints[ints[TERM_NODE] + 2 * t], ints[ints[TERM_NODE] + 2 * t + 1]
            low, high = _term_columns(ints, reach, t)
            turns = ints[ints[TERM_KIND] + t] != TRANSLATION
            rotations += turns
            for q in range(low, high):
                s = 0.0
                for r in range(3):
                    s += slope[1, r] * W[a, q, 3 + r] + slope[3, r] * W[b, q, 3 + r]
                if not turns:
                    for r in range(3):
                        s += slope[0, r] * W[a, q, r] + slope[2, r] * W[b, q, r]
                J[row + i, q] += c * s
        if rotations < end - begin:
            size = 1.0
        residual[row + i] = size * total
        for q in range(first, last):
            J[row + i, q] *= size


@kernel
def least_squares_scratch(rows, motions):
    """Scratch of `least_squares`."""
    return np.empty((motions + 4, max(rows, motions)))


@kernel
def least_squares(J, residual, step, room):
    """step (q,) minimising |J step + residual| by normal equations and LDL^T; returns the smallest relative pivot.

    A row of the factor begins where that of the normal equations does (skyline), so that a chain of joints costs each of
    them the same. room: scratch of `least_squares_scratch`.
    """
    rows, n = J.shape
    A, before, low, begin, end = room, room[n], room[n + 1], room[n + 2], room[n + 3]
    for i in range(n):
        low[i], step[i] = i, 0.0
    for r in range(rows):
        first, last = 0, n
        while first < n and J[r, first] == 0.0:
            first += 1
        while last > first and J[r, last - 1] == 0.0:
            last -= 1
        begin[r], end[r] = first, last
        for i in range(first, last):
            if J[r, i] != 0.0:
                low[i] = min(low[i], first)
    for i in range(n):
        for j in range(int(low[i]), i + 1):
            A[i, j] = 0.0
    for r in range(rows):
        first = int(begin[r])
        for i in range(first, int(end[r])):
            v = J[r, i]
            if v != 0.0:
                step[i] -= v * residual[r]
                for j in range(first, i + 1):
                    A[i, j] += v * J[r, j]
    worst = 1.0
    for i in range(n):
        before[i] = A[i, i]
        for j in range(int(low[i]), i):
            v = A[i, j]
            if v != 0.0:
                for k in range(j + 1, i):
                    if low[k] <= j:
                        A[i, k] -= v * A[k, j]
                A[i, j] = v / A[j, j]
                A[i, i] -= v * A[i, j]
        d = A[i, i]
        if not d > 0.0:
            return 0.0
        worst = min(worst, d / before[i])
    for i in range(n):
        for c in range(int(low[i]), i):
            step[i] -= A[i, c] * step[c]
    for i in range(n):
        step[i] /= A[i, i]
    for i in range(n - 1, -1, -1):
        for c in range(int(low[i]), i):
            step[c] -= A[i, c] * step[i]
    return worst


def close_loops(
    arrays: Arrays,
    loops: JointKinematics,
    theta: np.ndarray,
    target: np.ndarray,
    motion: State,
    place: np.ndarray,
    most: int,
) -> tuple[int, int, float]:
    """Solve step 1 in place. Returns (reason 0 closed / 1 too many / 3 singular, iterations, gap left [m]).

    A step of theta is limited to 0.5 (rad, or stroke over joint length); converged when it falls below 1e-6, which leaves
    the square of that.
    """
    found: tuple[int, int, float] = _close(
        *arrays.flat[:2], *loops.flat, theta, target, motion.x, motion.R, place, most
    )
    return found


@kernel
def _close(ints, floats, loops, shapes, theta, target, x, R, place, most):
    rows, motions, links = 6 * loops[CLOSINGS] + ints[ROWS], len(theta), len(x)
    W, J, series = np.zeros((links, motions, 6)), np.zeros((rows, motions)), np.empty((3, loops[MONOMIALS]))
    residual, step, reach = np.zeros(rows), np.zeros(motions), np.empty((2, links), np.int64)
    room, frames, slope = least_squares_scratch(rows, motions), np.empty((4, 4, 3)), np.empty((8, 3))
    gap, closed, n = 0.0, False, 0
    while True:
        joint_poses(loops, shapes, theta, place, series)
        loop_equations(ints, floats, loops, shapes, target, x, R, place, reach, W, J, residual, frames, slope)
        if closed:
            for r in range(len(residual)):
                gap = max(gap, abs(residual[r]))
            return 0, n, gap
        if n == most:
            return 1, most, math.inf
        if not least_squares(J, residual, step, room) > 1e-13:
            return 3, n, math.inf
        largest = stride(theta, step)
        if not math.isfinite(largest):
            return 5, n, math.inf
        # quadratic: the error left is the square of this step; poses follow it
        closed = largest < 1e-6
        n += 1


@kernel(inline="late")
def stride(theta, step):
    """theta <- theta + step, no entry by more than 0.5; returns the largest entry of the whole step, nothing done where
    that is not finite."""
    largest = 0.0
    for q in range(len(step)):
        largest = max(largest, abs(step[q])) if step[q] == step[q] else math.inf
    if math.isfinite(largest):
        scale = 0.5 / largest if largest > 0.5 else 1.0
        for q in range(len(step)):
            theta[q] += scale * step[q]
    return largest
