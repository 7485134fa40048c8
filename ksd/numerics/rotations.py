"""Finite rotations as 3x3 matrices: exponential, logarithm and their tangents.

Rotation updates are spatial, R <- exp(dphi) R. All kernels write into arrays of the caller. Vectors (3,) in rad, matrices
(3, 3).
"""

from __future__ import annotations

import math

import numpy as np

from ksd.numerics.kernel import kernel

ORTHONORMALISATION_STEPS = 9
"""Newton steps to the nearest rotation from a mean of two rotations that are up to 120 degrees apart."""
FULL_TURN = 2.0 * math.pi


@kernel(inline="late")
def nearest_turn(angle, counted):
    """The angle [rad] that differs from `angle` by whole turns and is nearest to `counted`."""
    return angle + FULL_TURN * np.rint((counted - angle) / FULL_TURN)


@kernel(inline="late")
def _sine_series(u):
    """sin h / h for u = h^2 up to 2.5, to rounding, by its Taylor series."""
    s = 1.0 / 51090942171709440000.0 * u - 1.0 / 121645100408832000.0
    s = s * u + 1.0 / 355687428096000.0
    s = s * u - 1.0 / 1307674368000.0
    s = s * u + 1.0 / 6227020800.0
    s = s * u - 1.0 / 39916800.0
    s = s * u + 1.0 / 362880.0
    s = s * u - 1.0 / 5040.0
    s = s * u + 1.0 / 120.0
    s = s * u - 1.0 / 6.0
    return s * u + 1.0


@kernel(inline="late")
def rotation_factors(t2):
    """(sin t / t, (1 - cos t) / t^2) for t2 = t^2; below a quarter turn by series, in half the time of sines."""
    if t2 <= 0.01:
        a = 1.0 + t2 * (t2 * (1.0 / 120.0 + t2 * (t2 * (1.0 / 362880.0) - 1.0 / 5040.0)) - 1.0 / 6.0)
        b = 0.5 + t2 * (t2 * (1.0 / 720.0 + t2 * (t2 * (1.0 / 3628800.0) - 1.0 / 40320.0)) - 1.0 / 24.0)
        return a, b
    if t2 < 2.5:
        half = _sine_series(0.25 * t2)
        return _sine_series(t2), 0.5 * half * half
    t = math.sqrt(t2)
    h = math.sin(0.5 * t)
    return math.sin(t) / t, 2.0 * h * h / t2


@kernel(inline="late")
def rotation_exp(v, R):
    """R (3, 3) = exp([v]x), Rodrigues' formula."""
    a, b = rotation_factors(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    _rotation_polynomial(v[0], v[1], v[2], a, b, R)


@kernel(inline="late")
def rotation_log_below_150(R, v):
    """`rotation_log` for angles below 150 degrees.

    The tangent of half the angle is halved repeatedly until below 11 degrees, then converted to the angle by its series.
    """
    w4 = 1.0 + R[0, 0] + R[1, 1] + R[2, 2]
    x, y, z = R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]
    f = 1.0 / w4
    u = (x * x + y * y + z * z) * (f * f)
    f = 2.0 * f
    halved = 0
    while u > 0.04 and halved < 60:
        h = 1.0 / (1.0 + math.sqrt(1.0 + u))
        u = u * (h * h)
        f = 2.0 * f * h
        halved += 1
    g = 1.0 / 19.0 - u * (1.0 / 21.0)
    g = 1.0 / 17.0 - u * g
    g = 1.0 / 15.0 - u * g
    g = 1.0 / 13.0 - u * g
    g = 1.0 / 11.0 - u * g
    g = 1.0 / 9.0 - u * g
    g = 1.0 / 7.0 - u * g
    g = 1.0 / 5.0 - u * g
    g = 1.0 / 3.0 - u * g
    f = f * (1.0 - u * g)
    v[0], v[1], v[2] = f * x, f * y, f * z


@kernel(inline="late")
def rotation_log(R, v):
    """v (3,) = rotation vector of R (3, 3), |v| <= pi, accurate near 0 and pi (by the quaternion)."""
    if not 1.0 + R[0, 0] + R[1, 1] + R[2, 2] < 0.25:
        rotation_log_below_150(R, v)
        return
    # Shepperd's method, from the largest diagonal entry
    k = 0
    if R[1, 1] > R[0, 0]:
        k = 1
    if R[2, 2] > R[k, k]:
        k = 2
    i, j = (k + 1) % 3, (k + 2) % 3
    q = math.sqrt(max(0.0, 1.0 + R[k, k] - R[i, i] - R[j, j]))
    v[k] = q * q
    v[i] = R[i, k] + R[k, i]
    v[j] = R[j, k] + R[k, j]
    # the vector above is 2 q (x, y, z); the scalar part is (R[j, i] - R[i, j]) / (2 q)
    w = R[j, i] - R[i, j]
    x, y, z = v[0], v[1], v[2]
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    n = math.sqrt(x * x + y * y + z * z)
    f = 2.0 * math.atan2(n, w) / n
    v[0] = f * x
    v[1] = f * y
    v[2] = f * z


@kernel(inline="late")
def rotate(v, R):
    """R (3, 3) <- exp([v]x) R in place, column by column."""
    a, b, c = v[0], v[1], v[2]
    f, g = rotation_factors(a * a + b * b + c * c)
    for j in range(3):
        # column + f v x column + g v x (v x column)
        p, q, r = R[0, j], R[1, j], R[2, j]
        x, y, z = b * r - c * q, c * p - a * r, a * q - b * p
        R[0, j] = p + f * x + g * (b * z - c * y)
        R[1, j] = q + f * y + g * (c * x - a * z)
        R[2, j] = r + f * z + g * (a * y - b * x)


@kernel(inline="late")
def reorthonormalise(R):
    """Remove rounding drift of R (3, 3), in place, by a Newton step of the polar decomposition: R <- R (3 I - R^T R) / 2."""
    c00, c11, c22, c01, c02, c12 = 1.5, 1.5, 1.5, 0.0, 0.0, 0.0
    for i in range(3):
        a, b, c = R[i, 0], R[i, 1], R[i, 2]
        c00, c11, c22 = c00 - 0.5 * a * a, c11 - 0.5 * b * b, c22 - 0.5 * c * c
        c01, c02, c12 = c01 - 0.5 * a * b, c02 - 0.5 * a * c, c12 - 0.5 * b * c
    for i in range(3):
        a, b, c = R[i, 0], R[i, 1], R[i, 2]
        R[i, 0] = a * c00 + b * c01 + c * c02
        R[i, 1] = a * c01 + b * c11 + c * c12
        R[i, 2] = a * c02 + b * c12 + c * c22


@kernel
def make_rotations(A):
    """Replace matrices (k, 3, 3) by the nearest rotations, in place; they are means of two rotations that are up to 120
    degrees apart."""
    for k in range(len(A)):
        for _ in range(ORTHONORMALISATION_STEPS):
            reorthonormalise(A[k])


@kernel(inline="late")
def exp_tangent(v, T):
    """T (3, 3): exp(v + dv) = exp(T dv) exp(v) to first order (left Jacobian of the rotation group)."""
    x, y, z = v[0], v[1], v[2]
    b, c, _, _ = tangent_factors(x * x + y * y + z * z)
    _rotation_polynomial(x, y, z, b, c, T)


@kernel(inline="late")
def tangent_factors(t2):
    """(b, c, b', c') of the tangent of the exponential, T = I + b [v]x + c [v]x^2, with db = b' v.dv, dc = c' v.dv.

    t2 = |v|^2; exp([v]x) = I + [v]x T.
    """
    if t2 < 0.3:
        # Taylor, to rounding
        c = 1.0 / 6.0 + t2 * (
            t2 * (1.0 / 5040.0 + t2 * (t2 * (1.0 / 39916800.0 - t2 * (1.0 / 6227020800.0)) - 1.0 / 362880.0))
            - 1.0 / 120.0
        )
        dc = (
            t2 * (1.0 / 1260.0 + t2 * (t2 * (1.0 / 4989600.0 - t2 * (1.0 / 622702080.0)) - 1.0 / 60480.0))
            - 1.0 / 60.0
        )
        db = (
            t2 * (1.0 / 180.0 + t2 * (t2 * (1.0 / 453600.0 - t2 * (1.0 / 47900160.0)) - 1.0 / 6720.0))
            - 1.0 / 12.0
        )
        return 3.0 * c + t2 * dc, c, db, dc
    a, b = rotation_factors(t2)
    c = (1.0 - a) / t2
    return b, c, (a - 2.0 * b) / t2, (b - 3.0 * c) / t2


@kernel(inline="late")
def log_tangent(v, T):
    """Write T (3, 3): log(exp(dphi) exp(v)) = v + T dphi to first order (inverse of `exp_tangent`)."""
    x, y, z = v[0], v[1], v[2]
    t2 = x * x + y * y + z * z
    if t2 < 0.01:
        c = 1.0 / 12.0 + t2 * (1.0 / 720.0 + t2 * (1.0 / 30240.0 + t2 * (1.0 / 1209600.0 + t2 / 47900160.0)))
    else:
        h = 0.5 * math.sqrt(t2)
        c = (1.0 - h / math.tan(h)) / t2
    _rotation_polynomial(x, y, z, -0.5, c, T)


@kernel(inline="late")
def _rotation_polynomial(x, y, z, b, c, T):
    """Write T (3, 3) = I + b [v]x + c [v]x^2, v = (x, y, z)."""
    T[0, 0] = 1.0 - c * (y * y + z * z)
    T[1, 1] = 1.0 - c * (x * x + z * z)
    T[2, 2] = 1.0 - c * (x * x + y * y)
    T[0, 1] = c * x * y - b * z
    T[1, 0] = c * x * y + b * z
    T[0, 2] = c * x * z + b * y
    T[2, 0] = c * x * z - b * y
    T[1, 2] = c * y * z - b * x
    T[2, 1] = c * y * z + b * x
