"""Value and slope of one constraint term, without the curvature that `ksd.model.loading.term_value` adds for Newton."""

from __future__ import annotations

import math

import numpy as np

from ksd.model.arrays import TERM_DIRECTION, TERM_KIND, TERM_NODE, TERM_POINT, TRANSLATION
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log


@kernel
def term_slope(ints, floats, x, R, t, slope):
    """Value of constraint term t, its derivatives by displacement and rotation of base and node into slope[:4]; see
    `ksd.model.loading.term_value`. slope (7, 3): then direction u, the node's arm and the lever.

    A rotation is 2 atan2(q.u, q0) of the relative rotation's quaternion.
    """
    a, b = ints[ints[TERM_NODE] + 2 * t], ints[ints[TERM_NODE] + 2 * t + 1]
    direction, point = ints[TERM_DIRECTION] + 3 * t, ints[TERM_POINT] + 6 * t
    value = 0.0
    for r in range(3):
        own, p, arm = 0.0, 0.0, 0.0
        for c in range(3):
            own += R[a, r, c] * floats[direction + c]
            p += R[a, r, c] * floats[point + c]
            arm += R[b, r, c] * floats[point + 3 + c]
        lever = x[b, r] + arm - x[a, r]
        slope[4, r], slope[5, r], slope[6, r] = own, arm, lever
        value += own * (lever - p)
    if ints[ints[TERM_KIND] + t] == TRANSLATION:
        for r in range(3):
            j, k = (r + 1) % 3, (r + 2) % 3
            slope[0, r], slope[2, r] = -slope[4, r], slope[4, r]
            slope[1, r] = slope[4, j] * slope[6, k] - slope[4, k] * slope[6, j]
            slope[3, r] = slope[5, j] * slope[4, k] - slope[5, k] * slope[4, j]
        return value
    u, q, rel = slope[4], slope[5], np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            rel[i, j] = R[b, i, 0] * R[a, j, 0] + R[b, i, 1] * R[a, j, 1] + R[b, i, 2] * R[a, j, 2]
    rotation_log(rel, q)
    turn = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    q0 = math.cos(0.5 * turn)
    f = 0.5 if turn < 1e-12 else math.sin(0.5 * turn) / turn
    along = f * (q[0] * u[0] + q[1] * u[1] + q[2] * u[2])
    size = along * along + q0 * q0
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        # d(q.u) and d(q0) of a turn about axis i
        across = 0.5 * (q0 * u[i] + f * (q[j] * u[k] - q[k] * u[j]))
        by_turn = 2.0 * (q0 * across + 0.5 * along * f * q[i]) / size
        slope[0, i], slope[1, i], slope[2, i], slope[3, i] = 0.0, -by_turn, 0.0, by_turn
    return 2.0 * math.atan2(along, q0)
