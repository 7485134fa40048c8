"""Step 1 of the KSD method in a plane, compiled: three coordinates per link, three equations per closed loop.

The planar twin of `ksd.bodies.kinematics`; J = [0 -1; 1 0]. Angles are about the plane's normal k.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ksd.bodies.kinematics import least_squares, room_for, row_columns, stride, term_columns
from ksd.bodies.series import monomials
from ksd.model.arrays import TRANSLATION
from ksd.model.planar_assembly import TURN, planar_term
from ksd.numerics.kernel import kernel
from ksd.numerics.local import local_vector

MATCHES = 1e-9
"""Last correction of an intended motion (rad, or stroke over joint length) at which it counts as found."""
PLACE = 9
"""Numbers per joint: pose of interface B in the axes of interface A (angle, x, y), and its two derivatives."""


class PlanarLoops(NamedTuple):
    """Kinematics of J joints in the plane; as `ksd.bodies.kinematics.Loops`, with anchor (J, 2, 2), frame (J,): angle of
    the joint axes at rest, pose (J, 3, M): rotation and chord of interface B by monomial.
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
def planar_place(coefficient, length, value, slope, count, motions, place):
    """place: angle w and d = L exp(w/2) c of the polynomials (3, M), then their derivatives by each motion."""
    w, cx, cy = 0.0, 0.0, 0.0
    for i in range(count):
        w += coefficient[0, i] * value[i]
        cx += coefficient[1, i] * value[i]
        cy += coefficient[2, i] * value[i]
    c, s = length * math.cos(0.5 * w), length * math.sin(0.5 * w)
    x, y = c * cx - s * cy, s * cx + c * cy
    place[0], place[1], place[2] = w, x, y
    for k in range(motions):
        dw, dx, dy = 0.0, 0.0, 0.0
        for i in range(count):
            dw += coefficient[0, i] * slope[k, i]
            dx += coefficient[1, i] * slope[k, i]
            dy += coefficient[2, i] * slope[k, i]
        at = 3 + 3 * k
        place[at] = dw
        place[at + 1], place[at + 2] = c * dx - s * dy - 0.5 * dw * y, s * dx + c * dy + 0.5 * dw * x


@kernel
def planar_places(loops, theta, value, slope, place):
    """place (J, 9) of all joints; value (J, M) and slope (2, M): scratch, value holds the monomials afterwards."""
    for j in range(len(loops.node)):
        count = monomials(loops, theta, j, value[j], slope)
        motions = loops.first[j + 1] - loops.first[j]
        planar_place(loops.pose[j], loops.length[j], value[j], slope, count, motions, place[j])


@kernel(inline="always")
def _arm(turn, s):
    """A point s (2,) of a body turned by `turn`."""
    c, n = math.cos(turn), math.sin(turn)
    return c * s[0] - n * s[1], n * s[0] + c * s[1]


@kernel
def _hang(loops, place, j, forward, pose, W, reach):
    """Pose of the link beyond tree joint j and its twist columns W (node, motion, 3), from the link before it; reach as in
    space."""
    a, b = loops.node[j, 0], loops.node[j, 1]
    near, far, sign = (a, b, 1.0) if forward == 1 else (b, a, -1.0)
    pose[far, 2] = pose[near, 2] + sign * place[j, 0]
    turned = pose[a, 2] + loops.frame[j]
    c, s = math.cos(turned), math.sin(turned)
    dx, dy = c * place[j, 1] - s * place[j, 2], s * place[j, 1] + c * place[j, 2]
    ax, ay = _arm(pose[a, 2], loops.anchor[j, 0])
    bx, by = _arm(pose[b, 2], loops.anchor[j, 1])
    pose[far, 0] = pose[near, 0] + sign * (ax + dx - bx)
    pose[far, 1] = pose[near, 1] + sign * (ay + dy - by)
    x, y = pose[far, 0] - pose[near, 0], pose[far, 1] - pose[near, 1]
    # from interface B to the far link's reference point
    rx, ry = pose[far, 0] - pose[b, 0] - bx, pose[far, 1] - pose[b, 1] - by
    for q in range(reach[0, near]):
        w = W[near, q, 2]
        W[far, q, 0], W[far, q, 1], W[far, q, 2] = W[near, q, 0] - w * y, W[near, q, 1] + w * x, w
    reach[0, far], reach[1, far] = max(reach[0, near], loops.first[j + 1]), near
    for q in range(reach[0, near], reach[0, far]):
        W[far, q, 0], W[far, q, 1], W[far, q, 2] = 0.0, 0.0, 0.0
    for q in range(loops.first[j], loops.first[j + 1]):
        at = 3 + 3 * (q - loops.first[j])
        w, vx, vy = place[j, at], place[j, at + 1], place[j, at + 2]
        W[far, q, 0] += sign * (c * vx - s * vy - w * ry)
        W[far, q, 1] += sign * (s * vx + c * vy + w * rx)
        W[far, q, 2] += sign * w


@kernel
def _close(loops, place, c, size, pose, W, J, residual):
    """Three equations of closing joint number c: gap of interface B, and its angle times `size`."""
    j = loops.closing[c]
    a, b = loops.node[j, 0], loops.node[j, 1]
    turned = pose[a, 2] + loops.frame[j]
    n, s = math.cos(turned), math.sin(turned)
    ax, ay = _arm(pose[a, 2], loops.anchor[j, 0])
    bx, by = _arm(pose[b, 2], loops.anchor[j, 1])
    ax, ay = ax + n * place[j, 1] - s * place[j, 2], ay + s * place[j, 1] + n * place[j, 2]
    gap = pose[b, 2] - pose[a, 2] - place[j, 0]
    row = 3 * c
    residual[row], residual[row + 1] = pose[b, 0] + bx - pose[a, 0] - ax, pose[b, 1] + by - pose[a, 1] - ay
    residual[row + 2] = size * (gap - TURN * round(gap / TURN))
    for q in range(W.shape[1]):
        J[row, q] = W[b, q, 0] - W[b, q, 2] * by - W[a, q, 0] + W[a, q, 2] * ay
        J[row + 1, q] = W[b, q, 1] + W[b, q, 2] * bx - W[a, q, 1] - W[a, q, 2] * ax
        J[row + 2, q] = size * (W[b, q, 2] - W[a, q, 2])
    for q in range(loops.first[j], loops.first[j + 1]):
        at = 3 + 3 * (q - loops.first[j])
        J[row, q] -= n * place[j, at + 1] - s * place[j, at + 2]
        J[row + 1, q] -= s * place[j, at + 1] + n * place[j, at + 2]
        J[row + 2, q] -= size * place[j, at]


@kernel
def planar_equations(loops, terms, size, target, pose, turns, place, reach, W, J, residual):
    """Link poses (k, 3) from the joints' `place`, residual (E,) and Jacobian J (E, motions) of loops and rows.

    W and J hold zeros at the first call; what stays zero is not written, so that a joint of a long chain costs little more.
    reach (2, k): scratch.
    """
    reach[0, :], reach[1, :] = 0, -1
    for t in range(len(loops.tree)):
        _hang(loops, place, loops.tree[t, 0], loops.tree[t, 1], pose, W, reach)
    for c in range(len(loops.closing)):
        _close(loops, place, c, size, pose, W, J, residual)
    for k in range(len(pose)):
        turns[2 * k], turns[2 * k + 1] = math.cos(pose[k, 2]), math.sin(pose[k, 2])
    first, row = terms.first, 3 * len(loops.closing)
    g = local_vector(10)
    for i in range(len(target)):
        rotations = 0
        residual[row + i] = -target[i]
        begin, last = row_columns(terms, reach, i)
        for q in range(begin, last):
            J[row + i, q] = 0.0
        for t in range(first[i], first[i + 1]):
            c, a, b = terms.coefficient[t], terms.node[t, 0], terms.node[t, 1]
            residual[row + i] += c * planar_term(
                terms.kind[t], terms.node[t], terms.direction[t], terms.point[t], pose, turns, g
            )
            turning = terms.kind[t] != TRANSLATION
            rotations += turning
            low, high = term_columns(terms, reach, t)
            for q in range(low, high):
                s = g[2] * W[a, q, 2] + g[5] * W[b, q, 2]
                if not turning:
                    s += g[0] * W[a, q, 0] + g[1] * W[a, q, 1] + g[3] * W[b, q, 0] + g[4] * W[b, q, 1]
                J[row + i, q] += c * s
        if rotations == first[i + 1] - first[i]:
            residual[row + i] *= size
            for q in range(begin, last):
                J[row + i, q] *= size


@kernel
def close_planar(loops, terms, size, theta, target, pose, turns, value, slope, place, most):
    """Step 1 in place; rules and returns are those of `ksd.bodies.kinematics.close_loops`."""
    motions, rows = len(theta), 3 * len(loops.closing) + len(target)
    W, reach = np.zeros((len(pose), motions, 3)), np.empty((2, len(pose)), np.int64)
    J, residual, step = np.zeros((rows, motions)), np.zeros(rows), np.zeros(motions)
    room = room_for(rows, motions)
    return _close_all(
        loops, terms, size, theta, target, pose, turns, value, slope, place, most, reach, W, J, residual, step, room
    )  # fmt: skip


@kernel
def _close_all(
    loops, terms, size, theta, target, pose, turns, value, slope, place, most, reach, W, J, residual, step, room
):  # fmt: skip
    """`close_planar` in given storage."""
    pivot, gap = 1.0, 0.0
    for n in range(most):
        planar_places(loops, theta, value, slope, place)
        planar_equations(loops, terms, size, target, pose, turns, place, reach, W, J, residual)
        pivot = least_squares(J, residual, step, room)
        if not pivot > 1e-13:
            return 3, n, math.inf, pivot
        largest = stride(theta, step)
        if not math.isfinite(largest):
            return 5, n, math.inf, pivot
        if largest < 1e-6:
            # quadratic: the error left is the square of this step; poses follow it
            planar_places(loops, theta, value, slope, place)
            planar_equations(loops, terms, size, target, pose, turns, place, reach, W, J, residual)
            for r in range(len(residual)):
                gap = max(gap, abs(residual[r]))
            return 0, n + 1, gap, pivot
    return 1, most, math.inf, pivot


@kernel
def planar_motions(loops, relative, theta, value, slope, place, off, found):
    """Split relative poses (J, 3; x, y, angle) into intended motion theta and the rest off (J, 3), in place.

    The planar twin of `ksd.bodies.readout.intended_motions`, for joints of one motion; found (J,) as there.
    """
    found[:] = 0
    for _ in range(40):
        # one look more after the last correction, so that `off` belongs to the theta returned
        planar_places(loops, theta, value, slope, place)
        missing = 0
        for j in range(len(loops.node)):
            off[j, 0], off[j, 1] = relative[j, 0] - place[j, 1], relative[j, 1] - place[j, 2]
            gap = relative[j, 2] - place[j, 0]
            off[j, 2] = gap - TURN * round(gap / TURN)
            if found[j] == 1:
                continue
            missing += 1
            spin, vx, vy = place[j, 3], place[j, 4], place[j, 5]
            if abs(spin) * loops.length[j] > 0.1 * max(abs(vx), abs(vy)):
                change = off[j, 2] / spin
            else:
                change = (vx * off[j, 0] + vy * off[j, 1]) / (vx * vx + vy * vy)
            if not abs(change) < math.inf:
                continue
            theta[loops.first[j]] += min(0.3, max(-0.3, change))
            if abs(change) < MATCHES:
                found[j] = 1
        if missing == 0:
            break
