"""Step 1 of the KSD method, compiled: joints move only as intended, loops close, drives are met.

Unknowns are the intended motions theta of all joints. Links hang on a spanning tree; every joint left over
closes a loop with six equations, every drive or support adds one. Gauss-Newton on the least-squares problem
handles the redundant equations of an overconstrained loop. Paper 1, section 2.2. No finite differences.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ksd.bodies.series import joint_places
from ksd.bodies.slopes import term_slope
from ksd.model.arrays import TRANSLATION, Arrays, Motion
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log


class Loops(NamedTuple):
    """Kinematics of J joints between nodes (0 ground, links 1..), all polynomials already for this design.

    node (J, 2); anchor (J, 2, 3): interface points A, B at rest from the nodes' reference points [m]; frame
    (J, 3, 3): joint axes at rest; length (J,); first (J+1,): motions of joint j are theta[first[j]:first[j+1]];
    tree (T, 2): joint, and 1 when it leads from A to B; closing (C,): joints closing loops; power_first (J+1,),
    power (P, 2): exponents; pose (J, 6, M): rotation vector and chord of interface B by monomial.
    """

    node: np.ndarray
    anchor: np.ndarray
    frame: np.ndarray
    length: np.ndarray
    first: np.ndarray
    tree: np.ndarray
    closing: np.ndarray
    power_first: np.ndarray
    power: np.ndarray
    pose: np.ndarray


@kernel
def _axes(A, B, C):
    """C = A B for (3, 3) matrices."""
    for r in range(3):
        for c in range(3):
            C[r, c] = A[r, 0] * B[0, c] + A[r, 1] * B[1, c] + A[r, 2] * B[2, c]


@kernel
def _axes_turned(A, B, C):
    """C = A B^T for (3, 3) matrices."""
    for r in range(3):
        for c in range(3):
            C[r, c] = A[r, 0] * B[c, 0] + A[r, 1] * B[c, 1] + A[r, 2] * B[c, 2]


@kernel
def _point(R, s, sign, x, p):
    """p = x + sign R s."""
    for r in range(3):
        p[r] = x[r] + sign * (R[r, 0] * s[0] + R[r, 1] * s[1] + R[r, 2] * s[2])


@kernel
def _hang(loops, place, j, forward, x, R, W, reach):
    """Pose of the link beyond tree joint j and its twist columns W (node, motion, 6), from the link before it; motions from
    reach[0] (node) on do not move a link, reach[1] is the one before it."""
    a, b = loops.node[j, 0], loops.node[j, 1]
    RA, RB, rel = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    pA, pB = np.empty(3), np.empty(3)
    for r in range(3):
        for c in range(3):
            rel[r, c] = place[j, 3 * r + c]
    d = place[j, 9:12]
    if forward == 1:
        _axes(R[a], loops.frame[j], RA)
        _axes(RA, rel, RB)
        _point(R[a], loops.anchor[j, 0], 1.0, x[a], pA)
        _point(RA, d, 1.0, pA, pB)
        _axes_turned(RB, loops.frame[j], R[b])
        _point(R[b], loops.anchor[j, 1], -1.0, pB, x[b])
        near, far, sign = a, b, 1.0
    else:
        _axes(R[b], loops.frame[j], RB)
        _axes_turned(RB, rel, RA)
        _point(R[b], loops.anchor[j, 1], 1.0, x[b], pB)
        _point(RA, d, -1.0, pB, pA)
        _axes_turned(RA, loops.frame[j], R[a])
        _point(R[a], loops.anchor[j, 0], -1.0, pA, x[a])
        near, far, sign = b, a, -1.0
    reach[0, far], reach[1, far] = max(reach[0, near], loops.first[j + 1]), near
    for q in range(reach[0, near], reach[0, far]):
        for r in range(6):
            W[far, q, r] = 0.0
    for q in range(reach[0, near]):
        for r in range(3):
            i, k = (r + 1) % 3, (r + 2) % 3
            W[far, q, 3 + r] = W[near, q, 3 + r]
            W[far, q, r] = (
                W[near, q, r]
                + W[near, q, 3 + i] * (x[far, k] - x[near, k])
                - W[near, q, 3 + k] * (x[far, i] - x[near, i])
            )
    for q in range(loops.first[j], loops.first[j + 1]):
        _own_twist(place[j], q - loops.first[j], RA, pB, x[far], sign, W[far, q])


@kernel
def _own_twist(place, k, RA, pB, y, sign, column):
    """Add the joint's own motion k: w = RA dphi, velocity RA dd + w x (y - pB), times sign."""
    at = 12 + 6 * k
    d0, d1, d2, p0, p1, p2 = (
        place[at],
        place[at + 1],
        place[at + 2],
        place[at + 3],
        place[at + 4],
        place[at + 5],
    )
    w0 = RA[0, 0] * p0 + RA[0, 1] * p1 + RA[0, 2] * p2
    w1 = RA[1, 0] * p0 + RA[1, 1] * p1 + RA[1, 2] * p2
    w2 = RA[2, 0] * p0 + RA[2, 1] * p1 + RA[2, 2] * p2
    a0, a1, a2 = y[0] - pB[0], y[1] - pB[1], y[2] - pB[2]
    column[0] += sign * (RA[0, 0] * d0 + RA[0, 1] * d1 + RA[0, 2] * d2 + w1 * a2 - w2 * a1)
    column[1] += sign * (RA[1, 0] * d0 + RA[1, 1] * d1 + RA[1, 2] * d2 + w2 * a0 - w0 * a2)
    column[2] += sign * (RA[2, 0] * d0 + RA[2, 1] * d1 + RA[2, 2] * d2 + w0 * a1 - w1 * a0)
    column[3] += sign * w0
    column[4] += sign * w1
    column[5] += sign * w2


@kernel
def loop_equations(terms, size, loops, theta, target, x, R, place, series, reach, W, J, residual):
    """Link poses for theta (into x, R), residual (E,) and Jacobian J (E, motions); rotations times `size`.

    Rows: six per closing joint, then one per constraint row of the model. W and J hold zeros at the first call; what stays
    zero is not written, so that a joint of a long chain costs little more. reach (2, k): scratch.
    """
    motions = len(theta)
    joint_places(loops, theta, place, series)
    reach[0, :], reach[1, :] = 0, -1
    for t in range(len(loops.tree)):
        _hang(loops, place, loops.tree[t, 0], loops.tree[t, 1], x, R, W, reach)
    RA, RB, want, rel = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    pA, pB, pW, turned = np.empty(3), np.empty(3), np.empty(3), np.empty(3)
    own = np.empty(6)
    for c in range(len(loops.closing)):
        j = loops.closing[c]
        a, b = loops.node[j, 0], loops.node[j, 1]
        _axes(R[a], loops.frame[j], RA)
        for r in range(3):
            for k in range(3):
                rel[r, k] = place[j, 3 * r + k]
        _axes(RA, rel, want)
        _axes(R[b], loops.frame[j], RB)
        _point(R[a], loops.anchor[j, 0], 1.0, x[a], pA)
        _point(RA, place[j, 9:12], 1.0, pA, pW)
        _point(R[b], loops.anchor[j, 1], 1.0, x[b], pB)
        _axes_turned(RB, want, rel)
        rotation_log(rel, turned)
        row = 6 * c
        for r in range(3):
            residual[row + r] = pB[r] - pW[r]
            residual[row + 3 + r] = size * turned[r]
        for q in range(motions):
            for r in range(3):
                i, k = (r + 1) % 3, (r + 2) % 3
                J[row + 3 + r, q] = size * (W[b, q, 3 + r] - W[a, q, 3 + r])
                J[row + r, q] = (
                    W[b, q, r] + W[b, q, 3 + i] * (pB[k] - x[b, k]) - W[b, q, 3 + k] * (pB[i] - x[b, i])
                    - W[a, q, r] - W[a, q, 3 + i] * (pW[k] - x[a, k]) + W[a, q, 3 + k] * (pW[i] - x[a, i])
                )  # fmt: skip
        for q in range(loops.first[j], loops.first[j + 1]):
            own[:] = 0.0
            _own_twist(place[j], q - loops.first[j], RA, pW, pW, 1.0, own)
            for r in range(3):
                J[row + r, q] -= own[r]
                J[row + 3 + r, q] -= size * own[3 + r]
    _constraint_equations(terms, size, target, x, R, reach, W, J, residual, 6 * len(loops.closing))


@kernel
def term_columns(terms, reach, t):
    """First and last but one motion that constraint term t depends on: a rotation between a link and the one it hangs on
    knows the joint between them alone."""
    a, b = terms.node[t, 0], terms.node[t, 1]
    first, last = 0, max(reach[0, a], reach[0, b])
    if terms.kind[t] != TRANSLATION:
        if reach[1, b] == a:
            first = reach[0, a]
        elif reach[1, a] == b:
            first = reach[0, b]
    return first, last


@kernel
def row_columns(terms, reach, i):
    """The same of row i."""
    first, last = term_columns(terms, reach, terms.first[i])
    for t in range(terms.first[i] + 1, terms.first[i + 1]):
        low, high = term_columns(terms, reach, t)
        first, last = min(first, low), max(last, high)
    return first, last


@kernel
def _constraint_equations(terms, size, target, x, R, reach, W, J, residual, row):
    """One equation per drive or support: sum of terms minus target, with its derivative along the twist columns."""
    gradient, scratch = np.empty(12), np.empty(9)
    for i in range(len(terms.start)):
        rotations = 0
        residual[row + i] = -target[i]
        first, last = row_columns(terms, reach, i)
        for q in range(first, last):
            J[row + i, q] = 0.0
        for t in range(terms.first[i], terms.first[i + 1]):
            c = terms.coefficient[t]
            residual[row + i] += c * term_slope(terms, x, R, t, gradient, scratch)
            a, b = terms.node[t, 0], terms.node[t, 1]
            low, high = term_columns(terms, reach, t)
            turns = terms.kind[t] != TRANSLATION
            rotations += turns
            for q in range(low, high):
                s = 0.0
                for r in range(3):
                    s += gradient[3 + r] * W[a, q, 3 + r] + gradient[9 + r] * W[b, q, 3 + r]
                if not turns:
                    for r in range(3):
                        s += gradient[r] * W[a, q, r] + gradient[6 + r] * W[b, q, r]
                J[row + i, q] += c * s
        if rotations == terms.first[i + 1] - terms.first[i]:
            residual[row + i] *= size
            for q in range(first, last):
                J[row + i, q] *= size


@kernel
def room_for(rows, motions):
    """Scratch of `least_squares`."""
    return np.empty((motions + 4, max(rows, motions)))


@kernel
def least_squares(J, residual, step, room):
    """step (q,) minimising |J step + residual| by normal equations and LDL^T; returns the smallest relative pivot.

    A row of the factor begins where that of the normal equations does (skyline), so that a chain of joints costs each of
    them the same. room: scratch of `room_for`.
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
    loops: Loops,
    theta: np.ndarray,
    target: np.ndarray,
    motion: Motion,
    place: np.ndarray,
    most: int,
) -> tuple[int, int, float, float]:
    """Solve step 1 in place. Returns (reason 0 closed / 1 too many / 3 singular, iterations, gap left [m], pivot).

    A step of theta is limited to 0.5 (rad, or stroke over joint length); converged when it falls below 1e-6, which leaves
    the square of that.
    """
    found: tuple[int, int, float, float] = _close(
        arrays.terms, float(arrays.flat.floats[0]), loops, theta, target, motion.x, motion.R, place, most
    )
    return found


@kernel
def _close(terms, size, loops, theta, target, x, R, place, most):
    rows, motions = 6 * len(loops.closing) + len(terms.start), len(theta)
    W, series = np.zeros((len(x), motions, 6)), np.empty((3, loops.pose.shape[2]))
    J, residual, step = np.zeros((rows, motions)), np.zeros(rows), np.zeros(motions)
    room, reach = room_for(rows, motions), np.empty((2, len(x)), np.int64)
    pivot, gap = 1.0, 0.0
    for n in range(most):
        loop_equations(terms, size, loops, theta, target, x, R, place, series, reach, W, J, residual)
        pivot = least_squares(J, residual, step, room)
        if not pivot > 1e-13:
            return 3, n, math.inf, pivot
        largest = stride(theta, step)
        if not math.isfinite(largest):
            return 5, n, math.inf, pivot
        if largest < 1e-6:
            # quadratic: the error left is the square of this step; poses follow it
            loop_equations(terms, size, loops, theta, target, x, R, place, series, reach, W, J, residual)
            for r in range(len(residual)):
                gap = max(gap, abs(residual[r]))
            return 0, n + 1, gap, pivot
    return 1, most, math.inf, pivot


@kernel
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
