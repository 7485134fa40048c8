"""Coil and torsion springs; interface as `ksd.elements.linear`.

Energy of a coil spring: k (l - l0)^2 / 2 with l the distance of its ends. Force on end q along u = d / l:
n = k (l - l0) u, tangent dn/dd = k u u^T + k (1 - l0/l) (I - u u^T); with l0 = 0 simply n = k d.

A torsion spring about u = e3 of end p has the moment M = k (turn - rest) along the gradient g of its angle, turn =
2 atan2(q.u, q0) with (q0, q) the quaternion of the relative rotation, and the tangent k g g^T + M (second derivatives of the
angle); see `ksd.model.loading.twist`.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import nearest_turn, rotation_log


@kernel
def coil_condense(value, d, lam, K):
    """Write lam (12,), K (6, 6) of value = (k [N/m], l0 [m]) at d (3,) [m], end q in frame p; return 2 where l = 0 <
    l0, else 0."""
    k, free_length = value[0], value[1]
    l = math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2])
    K[:, :] = 0.0
    lam[:] = 0.0
    if free_length > 0.0 and not l > 1e-9 * free_length:
        return 2
    across = k if free_length == 0.0 else k * (1.0 - free_length / l)
    along = 0.0 if free_length == 0.0 else k * free_length / (l * l * l)
    for i in range(3):
        lam[i] = across * d[i]
        lam[6 + i] = lam[i]
        K[i, i] = across
        for j in range(3):
            K[i, j] += along * d[i] * d[j]
    return 0


@kernel
def torsion_condense(value, counted, Q, lam, K):
    """Write lam (12,), K (6, 6) of value = (k [Nm/rad], rest angle [rad]) at orientation Q (3, 3) of end q in frame p.

    counted[0] [rad]: the angle before, of which the whole turns are kept; replaced by the angle.
    """
    q, slope, change = np.empty(3), np.empty(3), np.empty(3)
    rotation_log(Q, q)
    t = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    f = 0.5 if t < 1e-12 else math.sin(0.5 * t) / t
    q0, x, y, z = math.cos(0.5 * t), f * q[0], f * q[1], f * q[2]
    counted[0] = nearest_turn(2.0 * math.atan2(z, q0), counted[0])
    moment, r2 = value[0] * (counted[0] - value[1]), z * z + q0 * q0
    slope[0], slope[1], slope[2] = (q0 * y + z * x) / r2, (z * y - q0 * x) / r2, 1.0
    # half the derivative of r2, by r2
    change[0], change[1], change[2] = (z * y - q0 * x) / r2, -(z * x + q0 * y) / r2, 0.0
    K[:, :] = 0.0
    lam[:] = 0.0
    for i in range(3):
        lam[3 + i] = moment * slope[i]
        lam[9 + i] = lam[3 + i]
        for j in range(3):
            curvature = slope[i] * change[j] + slope[j] * change[i]
            K[3 + i, 3 + j] = value[0] * slope[i] * slope[j] - 0.5 * moment * curvature
