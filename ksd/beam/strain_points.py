"""Where the numbers of a strain-mode leaf sit, and what happens at each of its quadrature points alone.

Points are worked on four at a time, see `ksd.numerics.lanes`: arrays over the points have the point last, then end q,
then numbers without a meaning up to a multiple of four ("lanes"). Arrays over the modes have those last, up to a
multiple of four with zeros. Notation, source and gravity: see `ksd.beam.strain` and `ksd.beam.strain_fields`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ksd.numerics.kernel import kernel
from ksd.numerics.lanes import load4, pick4, spread, store4
from ksd.numerics.local import local_vector
from ksd.numerics.sums import weighted_rows


class Tables(NamedTuple):
    """Where things sit in the constants of a leaf, see `ksd.beam.strain_values`."""

    rest: int
    weight: int
    basis: int
    slack: int
    gaps: int
    sums: int
    masked: int
    stiff: int
    beyond: int


@kernel(forceinline=True)
def tables(nx, ny, nz, ng):
    """`Tables` for so many modes and points."""
    N = nx + ny + nz
    rest = 1 + nx * nx + ny * ny + nz * nz
    basis = rest + N + ng + ng * ng
    slack = basis + N * ng
    gaps = slack + 3 * ng
    sums = gaps + (N + ny * nz + nz * nx + nx * ny) * (ng + 1)
    lanes, M = (ng + 4) & -4, (N + 3) & -4
    masked = sums + ng * lanes
    stiff = masked + 3 * lanes * M
    return Tables(rest, rest + N, basis, slack, gaps, sums, masked, stiff, stiff + M * M)


class Places(NamedTuple):
    """Where things sit in the scratch of a leaf with N modes and ng points (shapes; l: lanes, M: modes padded).

    R (3, 3, l), v (3, l), S (6, l): xx, xy, xz, yy, yz, zz, r (3, l), m (3, l), carry (3, 3, l), couple (3, 6, l) and
    work (3, l): see `point_matrices`, f (ng, 3, M): scratch, fields (ng+1, 6, M): rho then psi, W with Y beside it
    (M, M + 8), t (M + 1, M + 8): scratch, eta (ng+1, 3, M); end: of all.
    """

    R: int
    v: int
    S: int
    r: int
    m: int
    carry: int
    couple: int
    work: int
    f: int
    fields: int
    W: int
    t: int
    eta: int
    end: int


@kernel(forceinline=True)
def places(N, ng):
    """`Places` for N modes and ng points."""
    lanes, M = (ng + 4) & -4, (N + 3) & -4
    fields = 54 * lanes + 3 * M * ng
    W = fields + 6 * M * (ng + 1)
    t = W + M * (M + 8)
    eta = t + (M + 1) * (M + 8)
    return Places(
        0 * N, 9 * lanes, 12 * lanes, 18 * lanes, 21 * lanes, 24 * lanes, 33 * lanes, 51 * lanes, 54 * lanes, fields,
        W, t, eta, eta + 3 * M * (ng + 1),
    )  # fmt: skip


@kernel(forceinline=True)
def _axis_turns(value, number, a, first, count, at, scratch, to):
    """int kappa over every gap about one axis, from `to` on; returns 1 if there is any curvature."""
    ng = number[3]
    gaps, lanes, bent = ng + 1, (ng + 4) & -4, 0
    weighted_rows(
        number, scratch, to, a, first, value, at + first * gaps, 0, 0, 0, 0, 1, 0, gaps, 1, 1, count, lanes, value[0],
        False,
    )  # fmt: skip
    for k in range(first, first + count):
        bent |= a[k] != 0.0
    return bent


@kernel(forceinline=True)
def _pair_turns(value, number, a, first, m, second, n, at, scratch, to, t):
    """1/2 iint_{s1<s2} of the curvatures of two axes over every gap, added from `to` on; t: scratch (m n)."""
    ng, L = number[3], value[0]
    for k in range(m):
        for l in range(n):
            scratch[t + k * n + l] = a[first + k] * a[second + l]
    weighted_rows(
        number, scratch, to, scratch, t, value, at, 0, 0, 0, 0, 1, 0, ng + 1, 1, 1, m * n, (ng + 4) & -4, 0.5 * L * L,
        True,
    )  # fmt: skip


@kernel(fastmath={"contract"}, forceinline=True)
def _gap_turns(value, number, a, at, scratch, phi, t):
    """Rotation vector (3, lanes) of every gap, int kappa + 1/2 iint_{s1<s2} kappa(s1) x kappa(s2), from phi on.

    at: place of the gap integrals in value; t: scratch. Rows of the tables are as long as there are gaps; what follows
    a row fills the lanes without a meaning.
    """
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    gaps, lanes = ng + 1, (ng + 4) & -4
    y, z, end = nx, nx + ny, nx + ny + nz
    bent = _axis_turns(value, number, a, 0, nx, at, scratch, phi)
    bent |= 2 * _axis_turns(value, number, a, y, ny, at, scratch, phi + lanes)
    bent |= 4 * _axis_turns(value, number, a, z, nz, at, scratch, phi + 2 * lanes)
    # pair integrals: y with z turn about x, z with x about y, x with y about z
    at += end * gaps
    if bent & 6 == 6:
        _pair_turns(value, number, a, y, ny, z, nz, at, scratch, phi, t)
    at += ny * nz * gaps
    if bent & 5 == 5:
        _pair_turns(value, number, a, z, nz, 0, nx, at, scratch, phi + lanes, t)
    at += nz * nx * gaps
    if bent & 3 == 3:
        _pair_turns(value, number, a, 0, nx, y, ny, at, scratch, phi + 2 * lanes, t)


@kernel(fastmath={"contract"}, forceinline=True)
def _gap_rotations(scratch, phi, lanes, E):
    """E (3, 3, lanes) = exp of phi (3, lanes) by Rodrigues' formula; series below half a radian."""
    far, first, second = local_vector(4), local_vector(4), local_vector(4)
    for o in range(0, lanes, 4):
        x, y, z = (
            load4(scratch, phi + o),
            load4(scratch, phi + lanes + o),
            load4(scratch, phi + 2 * lanes + o),
        )
        xx, yy, zz = x * x, y * y, z * z
        t2 = xx + yy + zz
        store4(far, 0, t2)
        if max(far[0], far[1]) < 0.3 and max(far[2], far[3]) < 0.3:
            # Taylor series of sin t / t and (1 - cos t) / t^2, to rounding
            a = t2 * (1 / 6227020800) - 1 / 39916800
            a = t2 * (t2 * (t2 * a + 1 / 362880) - 1 / 5040) + 1 / 120
            a = t2 * (t2 * a - 1 / 6) + 1.0
            b = t2 * (1 / 87178291200) - 1 / 479001600
            b = t2 * (t2 * (t2 * b + 1 / 3628800) - 1 / 40320) + 1 / 720
            b = t2 * (t2 * b - 1 / 24) + 0.5
        else:
            for k in range(4):
                t = math.sqrt(far[k])
                h = math.sin(0.5 * t)
                small = far[k] < 1e-12
                first[k] = 1.0 if small else math.sin(t) / t
                second[k] = 0.5 if small else 2.0 * h * h / far[k]
            a, b = load4(first, 0), load4(second, 0)
        store4(scratch, E + o, 1.0 - b * (yy + zz))
        store4(scratch, E + 4 * lanes + o, 1.0 - b * (xx + zz))
        store4(scratch, E + 8 * lanes + o, 1.0 - b * (xx + yy))
        c, d = b * x * y, a * z
        store4(scratch, E + lanes + o, c - d)
        store4(scratch, E + 3 * lanes + o, c + d)
        c, d = b * x * z, a * y
        store4(scratch, E + 2 * lanes + o, c + d)
        store4(scratch, E + 6 * lanes + o, c - d)
        c, d = b * y * z, a * x
        store4(scratch, E + 5 * lanes + o, c - d)
        store4(scratch, E + 7 * lanes + o, c + d)


@kernel(fastmath={"contract"}, forceinline=True)
def point_orientations(value, number, a, at, scratch, R, E, phi, t):
    """Orientation (3, 3, lanes) at the points and at end q, from R on in scratch; Magnus steps over the gaps.

    E, phi, t: scratch, see above.
    """
    ng = number[3]
    lanes = (ng + 4) & -4
    _gap_turns(value, number, a, at, scratch, phi, t)
    _gap_rotations(scratch, phi, lanes, E)
    x0, x1, x2 = scratch[E], scratch[E + lanes], scratch[E + 2 * lanes]
    y0, y1, y2 = scratch[E + 3 * lanes], scratch[E + 4 * lanes], scratch[E + 5 * lanes]
    z0, z1, z2 = scratch[E + 6 * lanes], scratch[E + 7 * lanes], scratch[E + 8 * lanes]
    for g in range(lanes):
        if 0 < g <= ng:
            # R <- R E
            o = E + g
            a0, a1, a2 = scratch[o], scratch[o + lanes], scratch[o + 2 * lanes]
            o += 3 * lanes
            b0, b1, b2 = scratch[o], scratch[o + lanes], scratch[o + 2 * lanes]
            o += 3 * lanes
            c0, c1, c2 = scratch[o], scratch[o + lanes], scratch[o + 2 * lanes]
            x0, x1, x2 = x0 * a0 + x1 * b0 + x2 * c0, x0 * a1 + x1 * b1 + x2 * c1, x0 * a2 + x1 * b2 + x2 * c2
            y0, y1, y2 = y0 * a0 + y1 * b0 + y2 * c0, y0 * a1 + y1 * b1 + y2 * c1, y0 * a2 + y1 * b2 + y2 * c2
            z0, z1, z2 = z0 * a0 + z1 * b0 + z2 * c0, z0 * a1 + z1 * b1 + z2 * c1, z0 * a2 + z1 * b2 + z2 * c2
        o = R + g
        scratch[o], scratch[o + lanes], scratch[o + 2 * lanes] = x0, x1, x2
        o += 3 * lanes
        scratch[o], scratch[o + lanes], scratch[o + 2 * lanes] = y0, y1, y2
        o += 3 * lanes
        scratch[o], scratch[o + lanes], scratch[o + 2 * lanes] = z0, z1, z2


@kernel(forceinline=True)
def _force(inner, N, pull, value, beyond, o, c):
    """Component c of n(s) = n + M(s) g in four lanes from o on."""
    if len(pull) > 0:
        return load4(value, beyond + o) * pull[c] + inner[N + c]
    return spread(inner[N + c])


@kernel(forceinline=True)
def point_slopes(value, inner, pull, N, lanes, slack, beyond, scratch, R, v, S):
    """v = R (e1 + C R^T n(s)) from v on and S = R C R^T from S on in scratch, at every point."""
    for o in range(0, lanes, 4):
        c0, c1, c2 = (
            pick4(value, slack + 3 * o, 3),
            pick4(value, slack + 3 * o + 1, 3),
            pick4(value, slack + 3 * o + 2, 3),
        )
        p = R + o
        a0, a1, a2 = load4(scratch, p), load4(scratch, p + lanes), load4(scratch, p + 2 * lanes)
        p += 3 * lanes
        b0, b1, b2 = load4(scratch, p), load4(scratch, p + lanes), load4(scratch, p + 2 * lanes)
        p += 3 * lanes
        d0, d1, d2 = load4(scratch, p), load4(scratch, p + lanes), load4(scratch, p + 2 * lanes)
        k0 = _force(inner, N, pull, value, beyond, o, 0)
        k1 = _force(inner, N, pull, value, beyond, o, 1)
        k2 = _force(inner, N, pull, value, beyond, o, 2)
        x, y, z = c0 * a0, c1 * a1, c2 * a2
        s0, s1, s2 = x * a0 + y * a1 + z * a2, x * b0 + y * b1 + z * b2, x * d0 + y * d1 + z * d2
        x, y, z = c0 * b0, c1 * b1, c2 * b2
        s3, s4 = x * b0 + y * b1 + z * b2, x * d0 + y * d1 + z * d2
        s5 = c0 * d0 * d0 + c1 * d1 * d1 + c2 * d2 * d2
        p = S + o
        store4(scratch, p, s0)
        store4(scratch, p + lanes, s1)
        store4(scratch, p + 2 * lanes, s2)
        store4(scratch, p + 3 * lanes, s3)
        store4(scratch, p + 4 * lanes, s4)
        store4(scratch, p + 5 * lanes, s5)
        p = v + o
        store4(scratch, p, a0 + s0 * k0 + s1 * k1 + s2 * k2)
        store4(scratch, p + lanes, b0 + s1 * k0 + s3 * k1 + s4 * k2)
        store4(scratch, p + 2 * lanes, d0 + s2 * k0 + s4 * k1 + s5 * k2)


@kernel(forceinline=True)
def point_moments(value, number, inner, pull, N, ng, sums, beyond, scratch, v, r, m, h):
    """Places r(s) from r on in scratch, m(s) = m + (r(L) - r(s)) x n + (h(L) - h(s)) x g from m on.

    h: scratch (6 lanes), used with a pull only.
    """
    lanes, L = (ng + 4) & -4, value[0]
    heavy = len(pull) > 0
    weighted_rows(
        number, scratch, r, scratch, v, value, sums, 0, lanes, 0, lanes, 1, 0, lanes, 1, 3, ng, lanes, L, False,
    )  # fmt: skip
    if heavy:
        for o in range(0, lanes, 4):
            for c in range(3):
                mv = load4(value, beyond + o) * load4(scratch, v + c * lanes + o)
                store4(scratch, h + (3 + c) * lanes + o, mv)
        weighted_rows(
            number, scratch, h, scratch, h + 3 * lanes, value, sums, 0, lanes, 0, lanes, 1, 0, lanes, 1, 3, ng, lanes,
            L, False,
        )  # fmt: skip
    n0, n1, n2 = inner[N], inner[N + 1], inner[N + 2]
    q = r + ng
    q0, q1, q2 = scratch[q], scratch[q + lanes], scratch[q + 2 * lanes]
    for o in range(0, lanes, 4):
        p = r + o
        x, y, z = (
            q0 - load4(scratch, p),
            q1 - load4(scratch, p + lanes),
            q2 - load4(scratch, p + 2 * lanes),
        )
        m0, m1, m2 = (
            inner[N + 3] + y * n2 - z * n1,
            inner[N + 4] + z * n0 - x * n2,
            inner[N + 5] + x * n1 - y * n0,
        )
        if heavy:
            p, q = h + o, h + ng
            x = scratch[q] - load4(scratch, p)
            y = scratch[q + lanes] - load4(scratch, p + lanes)
            z = scratch[q + 2 * lanes] - load4(scratch, p + 2 * lanes)
            m0, m1, m2 = (
                m0 + y * pull[2] - z * pull[1],
                m1 + z * pull[0] - x * pull[2],
                m2 + x * pull[1] - y * pull[0],
            )
        p = m + o
        store4(scratch, p, m0)
        store4(scratch, p + lanes, m1)
        store4(scratch, p + 2 * lanes, m2)


@kernel(forceinline=True)
def point_matrices(value, inner, pull, N, lanes, weight, beyond, scratch, at):
    """What couples the modes at a point, times L: carry A with rho_i' = psi_i x v - S (psi_i x n) = A psi_i; times L and
    the weight of the point, for the axis e_c of every curvature: couple (-n x e_c, e_c x m), and work e_c . m.
    """
    R, S, carry, couple, work, L = at.R, at.S, at.carry, at.couple, at.work, value[0]
    n0, n1, n2 = inner[N], inner[N + 1], inner[N + 2]
    for o in range(0, lanes, 4):
        p = at.v + o
        v0, v1, v2 = load4(scratch, p), load4(scratch, p + lanes), load4(scratch, p + 2 * lanes)
        p = S + o
        s0, s1, s2 = load4(scratch, p), load4(scratch, p + lanes), load4(scratch, p + 2 * lanes)
        p += 3 * lanes
        s3, s4, s5 = load4(scratch, p), load4(scratch, p + lanes), load4(scratch, p + 2 * lanes)
        k0 = L * _force(inner, N, pull, value, beyond, o, 0)
        k1 = L * _force(inner, N, pull, value, beyond, o, 1)
        k2 = L * _force(inner, N, pull, value, beyond, o, 2)
        v0, v1, v2 = L * v0, L * v1, L * v2
        p = carry + o
        store4(scratch, p, s1 * k2 - s2 * k1)
        store4(scratch, p + lanes, v2 + s2 * k0 - s0 * k2)
        store4(scratch, p + 2 * lanes, s0 * k1 - s1 * k0 - v1)
        p += 3 * lanes
        store4(scratch, p, s3 * k2 - s4 * k1 - v2)
        store4(scratch, p + lanes, s4 * k0 - s1 * k2)
        store4(scratch, p + 2 * lanes, v0 + s1 * k1 - s3 * k0)
        p += 3 * lanes
        store4(scratch, p, v1 + s4 * k2 - s5 * k1)
        store4(scratch, p + lanes, s5 * k0 - s2 * k2 - v0)
        store4(scratch, p + 2 * lanes, s2 * k1 - s4 * k0)
        p = at.m + o
        m0, m1, m2 = load4(scratch, p), load4(scratch, p + lanes), load4(scratch, p + 2 * lanes)
        w = L * load4(value, weight + o)
        for c in range(3):
            p = R + c * lanes + o
            e0, e1, e2 = (
                w * load4(scratch, p),
                w * load4(scratch, p + 3 * lanes),
                w * load4(scratch, p + 6 * lanes),
            )
            p = couple + 6 * c * lanes + o
            store4(scratch, p, e1 * n2 - e2 * n1)
            store4(scratch, p + lanes, e2 * n0 - e0 * n2)
            store4(scratch, p + 2 * lanes, e0 * n1 - e1 * n0)
            p += 3 * lanes
            store4(scratch, p, e1 * m2 - e2 * m1)
            store4(scratch, p + lanes, e2 * m0 - e0 * m2)
            store4(scratch, p + 2 * lanes, e0 * m1 - e1 * m0)
            store4(scratch, work + c * lanes + o, e0 * m0 + e1 * m1 + e2 * m2)
