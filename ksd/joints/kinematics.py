"""Step 1 of the KSD method, compiled: poses of the links where joints move only as intended, loops close and drives are
met.

Unknowns are the intended motions theta of all joints. Links follow from the joints of a spanning tree; every other
joint closes a loop with six equations, and every drive or support adds one. Gauss-Newton on the least-squares problem
handles the redundant equations of overconstrained loops. Derivatives are exact. Source: paper 1, section 2.2.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.joints.joint_arrays import (
    ANCHOR,
    CLOSING,
    CLOSING_COUNT,
    FIRST_MOTION,
    JOINT_AXES,
    JOINT_NODE,
    MONOMIAL_COUNT,
    TREE,
    TREE_COUNT,
)
from ksd.joints.joint_poses import joint_poses
from ksd.model.arrays import ROWS, TERM, TRANSLATION
from ksd.model.loading import term_slope
from ksd.model.turns import add_rotations
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log

MIN_PIVOT = 1e-13
"""Relative pivot of the normal equations below which they count as singular."""
MAX_ITERATIONS = 40
"""Gauss-Newton iterations of step 1."""
MAX_STEP = 0.5
"""Largest change of an intended motion in one iteration (rad, or stroke over joint length)."""
CONVERGED_STEP = 1e-6
"""Change below which step 1 has converged, same unit; the error left is of the order of its square."""


@kernel(inline="late")
def interface_pose(joint_ints, geometry, j, end, x, R, frames, i):
    """Write the axes of interface A (end 0) or B (1) of joint j on its link into frames[i, :3], its position into
    frames[i, 3]."""
    node, F = joint_ints[joint_ints[JOINT_NODE] + 2 * j + end], joint_ints[JOINT_AXES] + 9 * j
    anchor = joint_ints[ANCHOR] + 6 * j + 3 * end
    for r in range(3):
        p, q, s = R[node, r, 0], R[node, r, 1], R[node, r, 2]
        for c in range(3):
            frames[i, r, c] = p * geometry[F + c] + q * geometry[F + 3 + c] + s * geometry[F + 6 + c]
        frames[i, 3, r] = (
            x[node, r] + p * geometry[anchor] + q * geometry[anchor + 1] + s * geometry[anchor + 2]
        )


@kernel(inline="late")
def _place_link(joint_ints, geometry, j, end, frames, x, R):
    """Write the pose of the link whose interface stands at frames[end]: the inverse of `interface_pose`."""
    node, F = joint_ints[joint_ints[JOINT_NODE] + 2 * j + end], joint_ints[JOINT_AXES] + 9 * j
    anchor = joint_ints[ANCHOR] + 6 * j + 3 * end
    for r in range(3):
        p, q, s = frames[end, r, 0], frames[end, r, 1], frames[end, r, 2]
        for c in range(3):
            R[node, r, c] = (
                p * geometry[F + 3 * c] + q * geometry[F + 3 * c + 1] + s * geometry[F + 3 * c + 2]
            )
        p, q, s = R[node, r, 0], R[node, r, 1], R[node, r, 2]
        x[node, r] = (
            frames[end, 3, r] - p * geometry[anchor] - q * geometry[anchor + 1] - s * geometry[anchor + 2]
        )


@kernel(inline="late")
def _pose_of_B(pose, j, frames, i):
    """Write frames[i]: the intended pose of interface B of joint j, for its interface A at frames[0]."""
    for r in range(3):
        p, q, s = frames[0, r, 0], frames[0, r, 1], frames[0, r, 2]
        for c in range(3):
            frames[i, r, c] = p * pose[j, c] + q * pose[j, 3 + c] + s * pose[j, 6 + c]
        frames[i, 3, r] = frames[0, 3, r] + p * pose[j, 9] + q * pose[j, 10] + s * pose[j, 11]


@kernel(inline="late")
def _pose_of_A(pose, j, frames):
    """Write frames[0]: the intended pose of interface A of joint j, for its interface B at frames[1]."""
    for r in range(3):
        p, q, s = frames[1, r, 0], frames[1, r, 1], frames[1, r, 2]
        for c in range(3):
            frames[0, r, c] = p * pose[j, 3 * c] + q * pose[j, 3 * c + 1] + s * pose[j, 3 * c + 2]
        p, q, s = frames[0, r, 0], frames[0, r, 1], frames[0, r, 2]
        frames[0, 3, r] = frames[1, 3, r] - p * pose[j, 9] - q * pose[j, 10] - s * pose[j, 11]


@kernel(inline="late")
def _own_twist(pose, j, k, frames, a0, a1, a2):
    """Twist (v, w) due to motion k of joint j, of a point at a from its interface B: w = A dphi, v = A dd + w x a, with
    the axes A of its interface A in frames[0]."""
    at = 12 + 6 * k
    d0, d1, d2 = pose[j, at], pose[j, at + 1], pose[j, at + 2]
    p0, p1, p2 = pose[j, at + 3], pose[j, at + 4], pose[j, at + 5]
    w0 = frames[0, 0, 0] * p0 + frames[0, 0, 1] * p1 + frames[0, 0, 2] * p2
    w1 = frames[0, 1, 0] * p0 + frames[0, 1, 1] * p1 + frames[0, 1, 2] * p2
    w2 = frames[0, 2, 0] * p0 + frames[0, 2, 1] * p1 + frames[0, 2, 2] * p2
    v0 = frames[0, 0, 0] * d0 + frames[0, 0, 1] * d1 + frames[0, 0, 2] * d2 + w1 * a2 - w2 * a1
    v1 = frames[0, 1, 0] * d0 + frames[0, 1, 1] * d1 + frames[0, 1, 2] * d2 + w2 * a0 - w0 * a2
    v2 = frames[0, 2, 0] * d0 + frames[0, 2, 1] * d1 + frames[0, 2, 2] * d2 + w0 * a1 - w1 * a0
    return v0, v1, v2, w0, w1, w2


@kernel(inline="late")
def _place_next_link(joint_ints, geometry, pose, t, x, R, W, ancestry, frames):
    """Write the pose and twist columns W (node, motion, 6) of the link that branch t of the tree leads to.

    ancestry[0, node]: number of leading motions that can move a node; ancestry[1, node]: the node before it in the
    tree.
    """
    j, forward = joint_ints[joint_ints[TREE] + 2 * t], joint_ints[joint_ints[TREE] + 2 * t + 1]
    pair = joint_ints[JOINT_NODE] + 2 * j
    parent, child = joint_ints[pair + 1 - forward], joint_ints[pair + forward]
    interface_pose(joint_ints, geometry, j, 1 - forward, x, R, frames, 1 - forward)
    if forward == 1:
        _pose_of_B(pose, j, frames, forward)
    else:
        _pose_of_A(pose, j, frames)
    _place_link(joint_ints, geometry, j, forward, frames, x, R)
    first, last = joint_ints[joint_ints[FIRST_MOTION] + j], joint_ints[joint_ints[FIRST_MOTION] + j + 1]
    begin, end = ancestry[0, parent], max(ancestry[0, parent], last)
    ancestry[0, child], ancestry[1, child] = end, parent
    for q in range(begin, end):
        for r in range(6):
            W[child, q, r] = 0.0
    a0, a1, a2 = x[child, 0] - x[parent, 0], x[child, 1] - x[parent, 1], x[child, 2] - x[parent, 2]
    for q in range(begin):
        w0, w1, w2 = W[parent, q, 3], W[parent, q, 4], W[parent, q, 5]
        W[child, q, 0] = W[parent, q, 0] + w1 * a2 - w2 * a1
        W[child, q, 1] = W[parent, q, 1] + w2 * a0 - w0 * a2
        W[child, q, 2] = W[parent, q, 2] + w0 * a1 - w1 * a0
        W[child, q, 3], W[child, q, 4], W[child, q, 5] = w0, w1, w2
    a0, a1, a2 = x[child, 0] - frames[1, 3, 0], x[child, 1] - frames[1, 3, 1], x[child, 2] - frames[1, 3, 2]
    sign = 2.0 * forward - 1.0
    for q in range(first, last):
        v0, v1, v2, w0, w1, w2 = _own_twist(pose, j, q - first, frames, a0, a1, a2)
        W[child, q, 0] += sign * v0
        W[child, q, 1] += sign * v1
        W[child, q, 2] += sign * v2
        W[child, q, 3] += sign * w0
        W[child, q, 4] += sign * w1
        W[child, q, 5] += sign * w2


@kernel(inline="late")
def _close_joint(joint_ints, geometry, pose, c, length_scale, x, R, W, J, residual, frames):
    """Write the six equations of the joint that closes loop c: pose of B on its own link minus that which follows from A.

    Rows 6 c to 6 c + 5 of residual and J: translation [m], and rotation [rad] times length_scale [m]. frames: scratch.
    """
    j, row = joint_ints[joint_ints[CLOSING] + c], 6 * c
    a, b = joint_ints[joint_ints[JOINT_NODE] + 2 * j], joint_ints[joint_ints[JOINT_NODE] + 2 * j + 1]
    for end in range(2):
        interface_pose(joint_ints, geometry, j, end, x, R, frames, end)
    # an expression, since numba would compile `_pose_of_B` once more for a literal
    _pose_of_B(pose, j, frames, 2 + 0 * c)
    for r in range(3):
        p, q, s = frames[1, r, 0], frames[1, r, 1], frames[1, r, 2]
        for k in range(3):
            frames[3, r, k] = p * frames[2, k, 0] + q * frames[2, k, 1] + s * frames[2, k, 2]
    rotation_log(frames[3], frames[3, 3])
    for r in range(3):
        residual[row + r] = frames[1, 3, r] - frames[2, 3, r]
        residual[row + 3 + r] = length_scale * frames[3, 3, r]
    for q in range(W.shape[1]):
        for r in range(3):
            i, k = (r + 1) % 3, (r + 2) % 3
            J[row + 3 + r, q] = length_scale * (W[b, q, 3 + r] - W[a, q, 3 + r])
            J[row + r, q] = (
                W[b, q, r] - W[a, q, r]
                + W[b, q, 3 + i] * (frames[1, 3, k] - x[b, k]) - W[b, q, 3 + k] * (frames[1, 3, i] - x[b, i])
                - W[a, q, 3 + i] * (frames[2, 3, k] - x[a, k]) + W[a, q, 3 + k] * (frames[2, 3, i] - x[a, i])
            )  # fmt: skip
    first = joint_ints[joint_ints[FIRST_MOTION] + j]
    for q in range(first, joint_ints[joint_ints[FIRST_MOTION] + j + 1]):
        v0, v1, v2, w0, w1, w2 = _own_twist(pose, j, q - first, frames, 0.0, 0.0, 0.0)
        J[row, q] -= v0
        J[row + 1, q] -= v1
        J[row + 2, q] -= v2
        J[row + 3, q] -= length_scale * w0
        J[row + 4, q] -= length_scale * w1
        J[row + 5, q] -= length_scale * w2


@kernel
def loop_equations(
    ints, floats, joint_ints, geometry, target, x, R, angle, pose, ancestry, W, J, residual, frames, slope
):  # fmt: skip
    """Write link poses (into x, R), residual (E,) and Jacobian J (E, motions) for the joint poses pose (J, 24).

    ints, floats: of a model with the links, as in `ksd.model.arrays.Arrays`; joint_ints, geometry: as in
    `ksd.joints.joint_arrays`. Rows: six for each closing joint, then one for each constraint row of the model;
    rotations are multiplied by the length scale of the model. target (c,): drive values. W (k, motions, 6): twists of
    the nodes. W and J must hold zeros at the first call: entries that stay zero are not written, so that the cost of a
    joint does not grow with the length of a chain. ancestry (2, k), frames (4, 4, 3), slope (8, 3): scratch.
    """
    for k in range(ancestry.shape[1]):
        ancestry[0, k], ancestry[1, k] = 0, -1
    for t in range(joint_ints[TREE_COUNT]):
        _place_next_link(joint_ints, geometry, pose, t, x, R, W, ancestry, frames)
    for c in range(joint_ints[CLOSING_COUNT]):
        _close_joint(joint_ints, geometry, pose, c, floats[0], x, R, W, J, residual, frames)
    _constraint_equations(
        ints, floats, target, x, R, angle, ancestry, W, J, residual, 6 * joint_ints[CLOSING_COUNT], slope
    )


@kernel(inline="late")
def _term_columns(ints, ancestry, t):
    """Range of motions (first, end) that constraint term t depends on: a rotation between neighbouring links of the
    tree depends on the joint between them only."""
    a, b = ints[ints[TERM.node] + 2 * t], ints[ints[TERM.node] + 2 * t + 1]
    from_a, from_b = ancestry[0, a], ancestry[0, b]
    before_a, before_b = ancestry[1, a], ancestry[1, b]
    first = 0
    if ints[ints[TERM.kind] + t] != TRANSLATION:
        if before_b == a:
            first = from_a
        elif before_a == b:
            first = from_b
    return first, max(from_a, from_b)


@kernel(inline="late")
def _row_columns(ints, ancestry, i):
    """Range of motions (first, end) that constraint row i depends on."""
    begin = ints[ints[TERM.first] + i]
    first, last = _term_columns(ints, ancestry, begin)
    for t in range(begin + 1, ints[ints[TERM.first] + i + 1]):
        low, high = _term_columns(ints, ancestry, t)
        first, last = min(first, low), max(last, high)
    return first, last


@kernel(inline="late")
def _constraint_equations(ints, floats, target, x, R, angle, ancestry, W, J, residual, row, slope):
    """Write one equation per drive or support: sum of its terms minus target, and its derivative by the motions."""
    for i in range(ints[ROWS]):
        rotations, length_scale, total = 0, floats[0], -target[i]
        begin, end = ints[ints[TERM.first] + i], ints[ints[TERM.first] + i + 1]
        first, last = _row_columns(ints, ancestry, i)
        for q in range(first, last):
            J[row + i, q] = 0.0
        for t in range(begin, end):
            c = floats[ints[TERM.coefficient] + t]
            total += c * term_slope(ints, floats, x, R, angle, t, slope)
            a, b = ints[ints[TERM.node] + 2 * t], ints[ints[TERM.node] + 2 * t + 1]
            low, high = _term_columns(ints, ancestry, t)
            is_rotation = ints[ints[TERM.kind] + t] != TRANSLATION
            rotations += is_rotation
            for q in range(low, high):
                s = 0.0
                for r in range(3):
                    s += slope[1, r] * W[a, q, 3 + r] + slope[3, r] * W[b, q, 3 + r]
                if not is_rotation:
                    for r in range(3):
                        s += slope[0, r] * W[a, q, r] + slope[2, r] * W[b, q, r]
                J[row + i, q] += c * s
        if rotations < end - begin:
            length_scale = 1.0
        residual[row + i] = length_scale * total
        for q in range(first, last):
            J[row + i, q] *= length_scale


@kernel
def least_squares_scratch(rows, motions):
    """Scratch of `least_squares`."""
    return np.empty((motions + 4, max(rows, motions)))


@kernel
def least_squares(J, residual, step, scratch):
    """Write step (q,) minimising |J step + residual|, by normal equations and LDL^T; return the smallest relative
    pivot.

    Rows of the factor begin where those of the normal equations do (skyline), so that the cost per joint of a chain is
    constant. scratch: as made by `least_squares_scratch`.
    """
    rows, n = J.shape
    A, before, low, begin, end = scratch, scratch[n], scratch[n + 1], scratch[n + 2], scratch[n + 3]
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


@kernel
def loop_equations_at(ints, floats, joint_ints, geometry, theta, target, x, R, angle, pose):
    """Residual (E,), Jacobian J (E, motions) and twists W (k, motions, 6) of `loop_equations` at theta.

    Link poses are written into x, R, joint poses into pose (J, 24).
    """
    rows, motions, links = 6 * joint_ints[CLOSING_COUNT] + ints[ROWS], len(theta), len(x)
    residual, J, W = np.zeros(rows), np.zeros((rows, motions)), np.zeros((links, motions, 6))
    series, ancestry = np.empty((3, joint_ints[MONOMIAL_COUNT])), np.empty((2, links), np.int64)
    joint_poses(joint_ints, geometry, theta, pose, series)
    loop_equations(
        ints, floats, joint_ints, geometry, target, x, R, angle, pose, ancestry, W, J, residual, np.empty((4, 4, 3)),
        np.empty((8, 3)),
    )  # fmt: skip
    return residual, J, W


@kernel
def close_loops(ints, floats, joint_ints, geometry, theta, target, x, R, angle, pose):
    """Solve step 1 in place, from the motions theta. Returns (reason, iterations, largest residual [m]).

    reason: 0 closed, 1 too many iterations, 3 singular, 5 not finite; arguments: see `loop_equations`.
    """
    rows, motions, links = 6 * joint_ints[CLOSING_COUNT] + ints[ROWS], len(theta), len(x)
    W, J, series = (
        np.zeros((links, motions, 6)),
        np.zeros((rows, motions)),
        np.empty((3, joint_ints[MONOMIAL_COUNT])),
    )
    residual, step, ancestry = np.zeros(rows), np.zeros(motions), np.empty((2, links), np.int64)
    scratch, frames, slope = least_squares_scratch(rows, motions), np.empty((4, 4, 3)), np.empty((8, 3))
    gap, closed, n = 0.0, False, 0
    while True:
        joint_poses(joint_ints, geometry, theta, pose, series)
        loop_equations(
            ints, floats, joint_ints, geometry, target, x, R, angle, pose, ancestry, W, J, residual, frames, slope
        )  # fmt: skip
        if closed:
            for r in range(len(residual)):
                gap = max(gap, abs(residual[r]))
            return 0, n, gap
        if n == MAX_ITERATIONS:
            return 1, n, math.inf
        if not least_squares(J, residual, step, scratch) > MIN_PIVOT:
            return 3, n, math.inf
        largest = apply_limited_step(theta, step)
        if not math.isfinite(largest):
            return 5, n, math.inf
        _count_rotations(ints, floats, W, ancestry, step, MAX_STEP / max(largest, MAX_STEP), R, angle)
        # poses still have to follow the last step
        closed = largest < CONVERGED_STEP
        n += 1


@kernel(inline="late")
def _count_rotations(ints, floats, W, ancestry, step, scale, R, angle):
    """Add the rotations of `scale` times a step of the motions, with the links still before it, to the counted angles."""
    spin = np.zeros((len(W), 3))
    for k in range(len(W)):
        for q in range(ancestry[0, k]):
            for r in range(3):
                spin[k, r] += scale * W[k, q, 3 + r] * step[q]
    add_rotations(ints, floats, R, angle, spin)


@kernel(inline="late")
def apply_limited_step(theta, step):
    """Add step to theta, scaled so that no entry changes by more than MAX_STEP; return the largest entry of the
    unscaled step.

    theta is unchanged where that is not finite.
    """
    largest = 0.0
    for q in range(len(step)):
        largest = max(largest, abs(step[q])) if step[q] == step[q] else math.inf
    if math.isfinite(largest):
        scale = MAX_STEP / largest if largest > MAX_STEP else 1.0
        for q in range(len(step)):
            theta[q] += scale * step[q]
    return largest
