"""Rotation of a strain-mode leaf over one interval between quadrature points, to sixth order in its length, with
derivatives.

Along an interval the curvature times its length is kappa(t) = k1 + t k2 + t^2 k3 with t from -1/2 to 1/2. It enters by
the moments p = k1 + k3/12 (its integral), s = k2 and q = k3, in the axes of the leaf at the start of the interval:
`moment` (9,), p first. The orientation follows R <- R exp([turn]x), with the Magnus expansion for R' = R [kappa]x

turn = p + p x s/12 + (s x q + p x (p x q))/360 + (p x s) x s/240 - p x (p x (p x s))/720

in the form (1 - s.s/240 + p.q/360) p + (p.s/240) s - (p.p/360) q + (1/12 + p.p/720) p x s + s x q/360. Source: Blanes,
Casas, Oteo and Ros, The Magnus expansion and some of its applications, Physics Reports 470 (2009), section 5.2.
"""

from __future__ import annotations

from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import tangent_factors

INVERSE_240, INVERSE_360, INVERSE_720 = 1.0 / 240.0, 1.0 / 360.0, 1.0 / 720.0
"""Factors of the Magnus expansion: a multiplication takes a fifth of the time of a division."""


@kernel(inline="late")
def magnus_rotation(h, moment, turn, J):
    """Write turn (.., 3) of interval h, the rotation vector over it, and its derivative J (.., 3, 9) by the moments
    (.., 9)."""
    p0, p1, p2 = moment[h, 0], moment[h, 1], moment[h, 2]
    s0, s1, s2 = moment[h, 3], moment[h, 4], moment[h, 5]
    q0, q1, q2 = moment[h, 6], moment[h, 7], moment[h, 8]
    pp, ps = p0 * p0 + p1 * p1 + p2 * p2, p0 * s0 + p1 * s1 + p2 * s2
    a = 1.0 - (s0 * s0 + s1 * s1 + s2 * s2) * INVERSE_240 + (p0 * q0 + p1 * q1 + p2 * q2) * INVERSE_360
    b, c, d = ps * INVERSE_240, -pp * INVERSE_360, 1.0 / 12.0 + pp * INVERSE_720
    for r in range(3):
        i, j = (r + 1) % 3, (r + 2) % 3
        p, s, q = moment[h, r], moment[h, 3 + r], moment[h, 6 + r]
        x = moment[h, i] * moment[h, 3 + j] - moment[h, j] * moment[h, 3 + i]
        y = moment[h, 3 + i] * moment[h, 6 + j] - moment[h, 3 + j] * moment[h, 6 + i]
        turn[h, r] = a * p + b * s + c * q + d * x + y * INVERSE_360
        x, p, s = (x - 2.0 * q) * INVERSE_360, p * INVERSE_360, s * INVERSE_240
        for e in range(3):
            J[h, r, e] = x * moment[h, e] + p * moment[h, 6 + e] + s * moment[h, 3 + e]
            J[h, r, 3 + e] = s * moment[h, e] - 3.0 * p * moment[h, 3 + e]
            J[h, r, 6 + e] = p * moment[h, e]
    for r in range(3):
        # derivatives of the vectors p, s, q themselves, and of d (p x s) + (s x q)/360
        i, j = (r + 1) % 3, (r + 2) % 3
        p, s, q = moment[h, r], moment[h, 3 + r], moment[h, 6 + r]
        J[h, r, r] += a
        J[h, r, 3 + r] += b
        J[h, r, 6 + r] += c
        J[h, i, j] += d * s
        J[h, j, i] -= d * s
        J[h, i, 3 + j] -= d * p - q * INVERSE_360
        J[h, j, 3 + i] += d * p - q * INVERSE_360
        J[h, i, 6 + j] -= s * INVERSE_360
        J[h, j, 6 + i] += s * INVERSE_360


@kernel(inline="late")
def magnus_second_derivative(h, moment, turn, J, m0, m1, m2, u0, u1, u2, V, M):
    """Write M (9, 9): symmetric second derivative by the moments of the work of m on the rotation of everything behind
    interval h.

    Only entries whose row axis is the column axis or before it are set. m: moment carried, in the axes at the start of
    the interval; u = T^T m with the tangent T of exp(turn); turn and J as of `magnus_rotation`; V (3, 3): scratch. The
    skew part, half of m on the cross product of two rotations, is left to the caller.
    """
    p0, p1, p2 = moment[h, 0], moment[h, 1], moment[h, 2]
    s0, s1, s2 = moment[h, 3], moment[h, 4], moment[h, 5]
    t0, t1, t2 = turn[h, 0], turn[h, 1], turn[h, 2]
    # T^T m by the turn: b [m]x, which is skew, + v turn^T + c turn m^T + c (m.turn) I with v = db m x turn
    # + dc (m.turn) turn - (2 c + dc turn.turn) m; A is its symmetric part
    tt, mt = t0 * t0 + t1 * t1 + t2 * t2, t0 * m0 + t1 * m1 + t2 * m2
    _, c, db, dc = tangent_factors(tt)
    f, g = 0.5 * dc * mt, 0.5 * (c - dc * tt) - c
    db *= 0.5
    v0 = db * (m1 * t2 - m2 * t1) + f * t0 + g * m0
    v1 = db * (m2 * t0 - m0 * t2) + f * t1 + g * m1
    v2 = db * (m0 * t1 - m1 * t0) + f * t2 + g * m2
    c *= mt
    A00, A11, A22 = 2.0 * v0 * t0 + c, 2.0 * v1 * t1 + c, 2.0 * v2 * t2 + c
    A10, A20, A21 = v1 * t0 + v0 * t1, v2 * t0 + v0 * t2, v2 * t1 + v1 * t2
    # J^T A J
    for axis in range(3):
        for e in range(axis, 9, 3):
            a, b, c = J[h, 0, e], J[h, 1, e], J[h, 2, e]
            x, y, z = A00 * a + A10 * b + A20 * c, A10 * a + A11 * b + A21 * c, A20 * a + A21 * b + A22 * c
            for other in range(axis, 3):
                for k in range(other, 9, 3):
                    M[e, k] = J[h, 0, k] * x + J[h, 1, k] * y + J[h, 2, k] * z
    # second derivative of u.turn by the moments, with u / 360; v = s x u, w = u x p
    u0, u1, u2 = u0 * INVERSE_360, u1 * INVERSE_360, u2 * INVERSE_360
    v0, v1, v2 = s1 * u2 - s2 * u1, s2 * u0 - s0 * u2, s0 * u1 - s1 * u0
    V[0, 0], V[0, 1], V[0, 2] = u0, u1, u2
    V[1, 0], V[1, 1], V[1, 2] = v0, v1, v2
    V[2, 0], V[2, 1], V[2, 2] = u1 * p2 - u2 * p1, u2 * p0 - u0 * p2, u0 * p1 - u1 * p0
    for r in range(3):
        u, v, w = V[0, r], V[1, r], V[2, r]
        p, s, q = moment[h, r], moment[h, 3 + r], moment[h, 6 + r]
        for e in range(3):
            pe, se, ue = moment[h, e], moment[h, 3 + e], V[0, e]
            by_s, by_q = 1.5 * u * se - 3.0 * ue * s + pe * w, ue * p - 2.0 * pe * u
            if r <= e:
                M[r, e] += u * moment[h, 6 + e] + q * ue + p * V[1, e] + v * pe
                M[3 + r, 3 + e] += 1.5 * (pe * u + ue * p)
                M[3 + r, e] += by_s
                M[6 + r, e] += by_q
            if e <= r:
                M[e, 3 + r] += by_s
                M[e, 6 + r] += by_q
    # u.(p x s) = p.(s x u)
    up, us = u0 * p0 + u1 * p1 + u2 * p2, 1.5 * (u0 * s0 + u1 * s1 + u2 * s2)
    uq = u0 * moment[h, 6] + u1 * moment[h, 7] + u2 * moment[h, 8]
    k = p0 * v0 + p1 * v1 + p2 * v2 - 2.0 * uq
    for r in range(3):
        M[r, r] += k
        M[r, 3 + r] += us
        M[3 + r, r] += us
        M[r, 6 + r] += up
        M[6 + r, r] += up
        M[3 + r, 3 + r] -= 3.0 * up
    # cross products of moments
    d = 30.0 + 0.5 * (p0 * p0 + p1 * p1 + p2 * p2)
    for r in range(2):
        for e in range(r + 1, 3):
            # e1 x e2 = e3, e2 x e3 = e1, but e1 x e3 = -e2
            u = V[0, 0] if r == 1 else (V[0, 2] if e == 1 else -V[0, 1])
            M[r, 3 + e] += d * u
            M[3 + r, e] -= d * u
            M[3 + r, 6 + e] += u
            M[6 + r, 3 + e] -= u
