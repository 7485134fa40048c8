"""Value and slope of one constraint term, without the curvature that `ksd.model.loading.term_value` adds for Newton."""

from __future__ import annotations

import math

import numpy as np

from ksd.model.arrays import TRANSLATION
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log


@kernel
def term_slope(terms, x, R, t, gradient, scratch):
    """Value of constraint term t and its gradient (12,) on (base, node); see `ksd.model.loading.term_value`.

    scratch (9,). A rotation is 2 atan2(q.u, q0) of the relative rotation's quaternion.
    """
    a, b = terms.node[t, 0], terms.node[t, 1]
    u, q, lever = scratch[0:3], scratch[3:6], scratch[6:9]
    value = 0.0
    for r in range(3):
        u[r] = (
            R[a, r, 0] * terms.direction[t, 0]
            + R[a, r, 1] * terms.direction[t, 1]
            + R[a, r, 2] * terms.direction[t, 2]
        )
    if terms.kind[t] == TRANSLATION:
        for r in range(3):
            q[r], p = 0.0, 0.0
            for c in range(3):
                p += R[a, r, c] * terms.point[t, 0, c]
                q[r] += R[b, r, c] * terms.point[t, 1, c]
            lever[r] = x[b, r] + q[r] - x[a, r]
            value += u[r] * (lever[r] - p)
        for r in range(3):
            j, k = (r + 1) % 3, (r + 2) % 3
            gradient[r] = -u[r]
            gradient[3 + r] = u[j] * lever[k] - u[k] * lever[j]
            gradient[6 + r] = u[r]
            gradient[9 + r] = q[j] * u[k] - q[k] * u[j]
        return value
    rel = np.empty((3, 3))
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
        slope = 2.0 * (q0 * across + 0.5 * along * f * q[i]) / size
        gradient[i], gradient[6 + i] = 0.0, 0.0
        gradient[3 + i], gradient[9 + i] = -slope, slope
    return 2.0 * math.atan2(along, q0)
