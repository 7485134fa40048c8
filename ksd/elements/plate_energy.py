"""Energy of curling that a large curvature suppresses, at a point of a wide leaf bent about its width.

A leaf with plate stiffening has the stiffness K of its small curvature (`ksd.section.plate`) and in addition, at every
quadrature point, the energy

    U = 1/2 A (kappa - kappa0)^2 (X(z) - X(z0)),   X = chi phi / (1 + r phi),   phi = 1/C - 1,   z = B kappa^2 = p^4,

C(p) = 2/p (cosh p - cos p)/(sinh p + sin p) that of Ashwell's strip, kappa the whole and kappa0 the stress-free curvature
about the width. A = nu^2 D w times the length of the point. Far from clamps chi = r = 1, which is the strip; at a clamp,
where the section does not curl anyhow, chi = 0. In terms of z both 1/C and its parts are quotients of series with positive
terms.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.numerics.kernel import kernel

POINT_NUMBERS = 5
"""Numbers of a point: A [N m^3], B [m^2], chi, r, X(z0)."""
SERIES_TERMS, MAX_SERIES_Z = 11, 1296.0
"""Terms of the series, to rounding up to p = 6."""
DENOMINATOR = np.array([2.0 / math.factorial(4 * k + 2) for k in range(SERIES_TERMS)])
NUMERATOR = np.array([4.0 * k / math.factorial(4 * k + 2) for k in range(SERIES_TERMS)])
"""Coefficients of powers of z: phi is the quotient of both series."""


@kernel
def curl_loss(z):
    """phi and its first two derivatives by z."""
    if z < MAX_SERIES_Z:
        a, a1, a2, b, b1, b2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(SERIES_TERMS - 1, -1, -1):
            a2, b2 = a2 * z + 2.0 * a1, b2 * z + 2.0 * b1
            a1, b1 = a1 * z + a, b1 * z + b
            a, b = a * z + NUMERATOR[k], b * z + DENOMINATOR[k]
        phi = a / b
        first = (a1 - phi * b1) / b
        second = (a2 - 2.0 * first * b1 - phi * b2) / b
    else:
        p = math.sqrt(math.sqrt(z))
        t, sine, cosine = math.exp(-p), math.sin(p), math.cos(p)
        # hyperbolic functions times exp(-p)
        sh, ch = 0.5 * (1.0 - t * t), 0.5 * (1.0 + t * t)
        s = sh + sine * t
        edge = t * sh * sine / (s * s)
        edge1 = t * (ch * sine + sh * cosine) / (s * s) - 2.0 * edge * (ch + cosine * t) / s
        c = 2.0 / p * (ch - cosine * t) / s
        c1 = (4.0 * edge - c) / p
        c2 = 4.0 * edge1 / p - 2.0 * c1 / p
        phi = 1.0 / c - 1.0
        slope = -c1 / (c * c)
        first = slope / (4.0 * p**3)
        second = ((2.0 * c1 * c1 / c - c2) / (c * c) - 3.0 * slope / p) / (16.0 * p**6)
    return phi, first, second


@kernel
def plate_point(value, at, curvature, bend):
    """Moment dU/dkappa [N m^2] and its derivative at a point with numbers value[at:], of whole curvature `curvature` and
    bent by `bend` from its stress-free one [1/m]."""
    A, B, chi, r = value[at], value[at + 1], value[at + 2], value[at + 3]
    z1 = 2.0 * B * curvature
    phi, first, second = curl_loss(B * curvature * curvature)
    share = 1.0 / (1.0 + r * phi)
    # by phi, then by the curvature
    x, x1, x2 = chi * phi * share, chi * share * share, -2.0 * r * chi * share**3
    phi1, phi2 = first * z1, second * z1 * z1 + 2.0 * B * first
    x2 = x2 * phi1 * phi1 + x1 * phi2
    x1 *= phi1
    x -= value[at + 4]
    return A * bend * (x + 0.5 * bend * x1), A * (x + 2.0 * bend * x1 + 0.5 * bend * bend * x2)
