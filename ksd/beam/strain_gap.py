"""The turn of a strain-mode leaf over one gap between quadrature points, to sixth order in its length, with derivatives.

Of the curvature along a gap, times its length, kappa(t) = k1 + t k2 + t^2 k3 with t from -1/2 to 1/2, the moments p = k1 +
k3/12 (its integral), s = k2 and q = k3 are taken, in the axes of the leaf at the start of the gap: `moment` (9,), p first.
The orientation turns by exp(turn), R <- R exp([turn]x), with the Magnus expansion for R' = R [kappa]x

turn = p + p x s/12 + (s x q + p x (p x q))/360 + (p x s) x s/240 - p x (p x (p x s))/720

in the form (1 - s.s/240 + p.q/360) p + (p.s/240) s - (p.p/360) q + (1/12 + p.p/720) p x s + s x q/360. Source: Blanes,
Casas, Oteo and Ros, The Magnus expansion and some of its applications, Physics Reports 470 (2009), section 5.2.
"""

from __future__ import annotations

from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import tangent_factors


@kernel
def _add_cross(M, row, column, x, y, z):
    """[(x, y, z)]x onto the block (3, 3) of M from row, column."""
    M[row, column + 1] -= z
    M[row, column + 2] += y
    M[row + 1, column] += z
    M[row + 1, column + 2] -= x
    M[row + 2, column] -= y
    M[row + 2, column + 1] += x


@kernel
def gap_turn(moment, turn, J):
    """turn (3,) of a gap and its derivative J (3, 9) by the moments (9,)."""
    p0, p1, p2 = moment[0], moment[1], moment[2]
    s0, s1, s2 = moment[3], moment[4], moment[5]
    q0, q1, q2 = moment[6], moment[7], moment[8]
    x0, x1, x2 = p1 * s2 - p2 * s1, p2 * s0 - p0 * s2, p0 * s1 - p1 * s0
    pp, ps = p0 * p0 + p1 * p1 + p2 * p2, p0 * s0 + p1 * s1 + p2 * s2
    a = 1.0 - (s0 * s0 + s1 * s1 + s2 * s2) / 240.0 + (p0 * q0 + p1 * q1 + p2 * q2) / 360.0
    b, c, d = ps / 240.0, -pp / 360.0, 1.0 / 12.0 + pp / 720.0
    turn[0] = a * p0 + b * s0 + c * q0 + d * x0 + (s1 * q2 - s2 * q1) / 360.0
    turn[1] = a * p1 + b * s1 + c * q1 + d * x1 + (s2 * q0 - s0 * q2) / 360.0
    turn[2] = a * p2 + b * s2 + c * q2 + d * x2 + (s0 * q1 - s1 * q0) / 360.0
    for r, p, s, q, x in ((0, p0, s0, q0, x0), (1, p1, s1, q1, x1), (2, p2, s2, q2, x2)):
        f, g = (x - 2.0 * q) / 360.0, p / 360.0
        h, k = s / 240.0, -p / 120.0
        J[r, 0], J[r, 1], J[r, 2] = (
            f * p0 + g * q0 + h * s0,
            f * p1 + g * q1 + h * s1,
            f * p2 + g * q2 + h * s2,
        )
        J[r, 3], J[r, 4], J[r, 5] = h * p0 + k * s0, h * p1 + k * s1, h * p2 + k * s2
        J[r, 6], J[r, 7], J[r, 8] = g * p0, g * p1, g * p2
        J[r, r] += a
        J[r, 3 + r] += b
        J[r, 6 + r] += c
    _add_cross(J, 0, 0, -d * s0, -d * s1, -d * s2)
    _add_cross(J, 0, 3, d * p0 - q0 / 360.0, d * p1 - q1 / 360.0, d * p2 - q2 / 360.0)
    _add_cross(J, 0, 6, s0 / 360.0, s1 / 360.0, s2 / 360.0)


@kernel
def gap_second(moment, turn, J, m0, m1, m2, u0, u1, u2, M):
    """M (9, 9): symmetric second derivative by the moments of the work of m on the rotation of all behind the gap.

    m: moment carried, in the axes at the start of the gap; u = T^T m with the tangent T of exp(turn); turn and J of
    `gap_turn`. The skew part, half of m on the cross product of two rotations, is left to the caller.
    """
    p0, p1, p2 = moment[0], moment[1], moment[2]
    s0, s1, s2 = moment[3], moment[4], moment[5]
    q0, q1, q2 = moment[6], moment[7], moment[8]
    t0, t1, t2 = turn[0], turn[1], turn[2]
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
    # u.turn by the moments
    pp = p0 * p0 + p1 * p1 + p2 * p2
    up, us = (u0 * p0 + u1 * p1 + u2 * p2) / 360.0, (u0 * s0 + u1 * s1 + u2 * s2) / 240.0
    v0, v1, v2 = s1 * u2 - s2 * u1, s2 * u0 - s0 * u2, s0 * u1 - s1 * u0
    w0, w1, w2 = (u1 * p2 - u2 * p1) / 360.0, (u2 * p0 - u0 * p2) / 360.0, (u0 * p1 - u1 * p0) / 360.0
    # u.(p x s) = p.(s x u)
    k = (p0 * v0 + p1 * v1 + p2 * v2 - 2.0 * (u0 * q0 + u1 * q1 + u2 * q2)) / 360.0
    for e, p, s, q, u, v in ((0, p0, s0, q0, u0, v0), (1, p1, s1, q1, u1, v1), (2, p2, s2, q2, u2, v2)):
        a, b, c = J[0, e], J[1, e], J[2, e]
        x, y, z = A00 * a + A10 * b + A20 * c, A10 * a + A11 * b + A21 * c, A20 * a + A21 * b + A22 * c
        p, q, u, v = p / 360.0, q / 360.0, u / 360.0, v / 360.0
        M[0, e] = J[0, 0] * x + J[1, 0] * y + J[2, 0] * z + u0 * q + q0 * u + p0 * v + v0 * p
        M[1, e] = J[0, 1] * x + J[1, 1] * y + J[2, 1] * z + u1 * q + q1 * u + p1 * v + v1 * p
        M[2, e] = J[0, 2] * x + J[1, 2] * y + J[2, 2] * z + u2 * q + q2 * u + p2 * v + v2 * p
        f, g, h = s / 240.0, -3.0 * u, 360.0 * p
        M[3, e] = M[e, 3] = J[0, 3] * x + J[1, 3] * y + J[2, 3] * z + f * u0 + g * s0 + h * w0
        M[4, e] = M[e, 4] = J[0, 4] * x + J[1, 4] * y + J[2, 4] * z + f * u1 + g * s1 + h * w1
        M[5, e] = M[e, 5] = J[0, 5] * x + J[1, 5] * y + J[2, 5] * z + f * u2 + g * s2 + h * w2
        M[6, e] = M[e, 6] = J[0, 6] * x + J[1, 6] * y + J[2, 6] * z + u * p0 - 2.0 * p * u0
        M[7, e] = M[e, 7] = J[0, 7] * x + J[1, 7] * y + J[2, 7] * z + u * p1 - 2.0 * p * u1
        M[8, e] = M[e, 8] = J[0, 8] * x + J[1, 8] * y + J[2, 8] * z + u * p2 - 2.0 * p * u2
        a, b, c = J[0, 3 + e], J[1, 3 + e], J[2, 3 + e]
        x, y, z = A00 * a + A10 * b + A20 * c, A10 * a + A11 * b + A21 * c, A20 * a + A21 * b + A22 * c
        f, g = 1.5 * p, 1.5 * u
        M[3, 3 + e] = J[0, 3] * x + J[1, 3] * y + J[2, 3] * z + f * u0 + g * p0
        M[4, 3 + e] = J[0, 4] * x + J[1, 4] * y + J[2, 4] * z + f * u1 + g * p1
        M[5, 3 + e] = J[0, 5] * x + J[1, 5] * y + J[2, 5] * z + f * u2 + g * p2
        M[6, 3 + e] = M[3 + e, 6] = J[0, 6] * x + J[1, 6] * y + J[2, 6] * z
        M[7, 3 + e] = M[3 + e, 7] = J[0, 7] * x + J[1, 7] * y + J[2, 7] * z
        M[8, 3 + e] = M[3 + e, 8] = J[0, 8] * x + J[1, 8] * y + J[2, 8] * z
        a, b, c = J[0, 6 + e], J[1, 6 + e], J[2, 6 + e]
        x, y, z = A00 * a + A10 * b + A20 * c, A10 * a + A11 * b + A21 * c, A20 * a + A21 * b + A22 * c
        M[6, 6 + e] = J[0, 6] * x + J[1, 6] * y + J[2, 6] * z
        M[7, 6 + e] = J[0, 7] * x + J[1, 7] * y + J[2, 7] * z
        M[8, 6 + e] = J[0, 8] * x + J[1, 8] * y + J[2, 8] * z
    for r in range(3):
        M[r, r] += k
        M[r, 3 + r] += us
        M[3 + r, r] += us
        M[r, 6 + r] += up
        M[6 + r, r] += up
        M[3 + r, 3 + r] -= 3.0 * up
    d = 1.0 / 12.0 + pp / 720.0
    _add_cross(M, 0, 3, -d * u0, -d * u1, -d * u2)
    _add_cross(M, 3, 0, d * u0, d * u1, d * u2)
    d = 1.0 / 360.0
    _add_cross(M, 3, 6, -d * u0, -d * u1, -d * u2)
    _add_cross(M, 6, 3, d * u0, d * u1, d * u2)
