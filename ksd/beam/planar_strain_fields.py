"""Sums over the Gauss points of the planar strain-mode leaf, and its small linear systems.

Notation, layouts and source: `ksd.beam.planar_strain`.
"""

from __future__ import annotations

from ksd.numerics.kernel import kernel
from ksd.numerics.lanes import load4, store4
from ksd.numerics.local import local_vector
from ksd.numerics.rotations import cosine_sine

TINY_PIVOT = 1e-15


@kernel(fastmath={"contract"}, forceinline=True)
def gather(value, number, inner, W, J, out, pull, E):
    """W (nz, nz, lower), J (nz, 4) = (dr/da, dtheta/da, residual g), out = r (2), theta, force block (3).

    With weight also E (nz, 2), the derivative of the first moment, and out[6:14] = first moment (2), int M R C
    R^T (3), int M^2 R C R^T (3).
    """
    nz, points = number[0], number[1]
    heavy = len(pull) > 0
    width = 3 * nz + 4
    moment = inner[nz + 2]
    last = 1 + nz * nz + nz + points * width
    end = value[last:]
    angle = 0.0
    for i in range(nz):
        g = -moment * end[nz + i]
        for j in range(nz):
            stiffness = value[1 + i * nz + j]
            W[i * nz + j] = stiffness
            g += stiffness * (inner[j] - value[1 + nz * nz + j])
        J[4 * i] = J[4 * i + 1] = 0.0
        J[4 * i + 2] = end[i]
        J[4 * i + 3] = g
        angle += inner[i] * end[i]
    x = y = xx = xy = yy = 0.0
    if heavy:
        for i in range(6, 14):
            out[i] = 0.0
        for i in range(2 * nz):
            E[i] = 0.0
    turn, cosine, sine = local_vector(8), local_vector(8), local_vector(8)
    for p in range(points):
        at = 1 + nz * nz + nz + p * width
        if p & 7 == 0:
            # angles of the next eight points
            for k in range(8):
                theta = 0.0
                if p + k < points:
                    for i in range(nz):
                        theta += inner[i] * value[at + k * width + 3 + i]
                turn[k] = theta
            for k in range(0, 8, 4):
                c4, s4 = cosine_sine(load4(turn, k))
                store4(cosine, k, c4)
                store4(sine, k, s4)
        point = value[at : at + width]
        n0, n1, mass = inner[nz], inner[nz + 1], 0.0
        if heavy:
            mass = value[last + 2 * nz + p]
            n0, n1 = n0 + mass * pull[0], n1 + mass * pull[1]
        w, cn, cv = point[0], point[1], point[2]
        c, s = cosine[p & 7], sine[p & 7]
        N, V = c * n0 + s * n1, c * n1 - s * n0
        slack = cn - cv
        # r' = R (1 + cN N, cV V) and R C R^T
        a, b = w * (1.0 + cn * N), w * cv * V
        x += c * a - s * b
        y += s * a + c * b
        s00, s01, s11 = w * (cn * c * c + cv * s * s), w * slack * c * s, w * (cn * s * s + cv * c * c)
        xx += s00
        xy += s01
        yy += s11
        if heavy:
            out[6] += mass * (c * a - s * b)
            out[7] += mass * (s * a + c * b)
            out[8] += mass * s00
            out[9] += mass * s01
            out[10] += mass * s11
            out[11] += mass * mass * s00
            out[12] += mass * mass * s01
            out[13] += mass * mass * s11
        # h', h'' and d h'/d(nx, ny)
        first = w * (V + slack * N * V)
        second = w * (slack * (V * V - N * N) - N)
        a, b = w * slack * V, w * (1.0 + slack * N)
        hx, hy = c * a - s * b, s * a + c * b
        for i in range(nz):
            psi = point[3 + i]
            J[4 * i] += hx * psi
            J[4 * i + 1] += hy * psi
            J[4 * i + 3] -= first * point[4 + 2 * nz + i]
            if heavy:
                E[2 * i] += mass * hx * psi
                E[2 * i + 1] += mass * hy * psi
            psi *= second
            for j in range(i + 1):
                W[i * nz + j] -= psi * point[3 + j]
    out[0], out[1], out[2], out[3], out[4], out[5] = x, y, angle, xx, xy, yy


@kernel(fastmath={"contract"}, forceinline=True)
def solve(nz, W, J, Y):
    """Y (nz, 4) = W^-1 J by LDL^T in place of W (lower); returns (negative pivots, status)."""
    negatives, status = 0, 0
    for j in range(nz):
        before = abs(W[j * nz + j])
        for c in range(j):
            W[j * nz + j] -= W[j * nz + c] * W[j * nz + c] * W[c * nz + c]
        pivot = W[j * nz + j]
        if not abs(pivot) > TINY_PIVOT * before:
            return negatives, 2
        if pivot < 0.0:
            negatives += 1
        inverse = 1.0 / pivot
        for i in range(j + 1, nz):
            t = W[i * nz + j]
            for c in range(j):
                t -= W[i * nz + c] * W[j * nz + c] * W[c * nz + c]
            W[i * nz + j] = t * inverse
        y0, y1, y2, y3 = J[4 * j], J[4 * j + 1], J[4 * j + 2], J[4 * j + 3]
        for c in range(j):
            t = W[j * nz + c]
            y0 -= t * Y[4 * c]
            y1 -= t * Y[4 * c + 1]
            y2 -= t * Y[4 * c + 2]
            y3 -= t * Y[4 * c + 3]
        Y[4 * j], Y[4 * j + 1], Y[4 * j + 2], Y[4 * j + 3] = y0, y1, y2, y3
    for j in range(nz - 1, -1, -1):
        inverse = 1.0 / W[j * nz + j]
        y0, y1 = Y[4 * j] * inverse, Y[4 * j + 1] * inverse
        y2, y3 = Y[4 * j + 2] * inverse, Y[4 * j + 3] * inverse
        for c in range(j + 1, nz):
            t = W[c * nz + j]
            y0 -= t * Y[4 * c]
            y1 -= t * Y[4 * c + 1]
            y2 -= t * Y[4 * c + 2]
            y3 -= t * Y[4 * c + 3]
        Y[4 * j], Y[4 * j + 1], Y[4 * j + 2], Y[4 * j + 3] = y0, y1, y2, y3
    return negatives, status


@kernel
def _solve_more(nz, W, X):
    """X (nz, 2) = W^-1 X, W factored as `solve` leaves it."""
    for j in range(nz):
        for c in range(j):
            for r in range(2):
                X[2 * j + r] -= W[j * nz + c] * X[2 * c + r]
    for j in range(nz - 1, -1, -1):
        for r in range(2):
            X[2 * j + r] /= W[j * nz + j]
            for c in range(j + 1, nz):
                X[2 * j + r] -= W[c * nz + j] * X[2 * c + r]


@kernel
def follow_gravity(nz, W, J, Y, K, sums, step, E, X, pull):
    """The pull of a leaf with weight, as `ksd.beam.strain` has it; E (nz, 2), sums (14,) from `gather`,
    step (3,): predicted change of the end wrench. X (nz, 2) = W^-1 E is kept for `recover`."""
    Z = local_vector(6)
    for i in range(2 * nz):
        X[i] = E[i]
    _solve_more(nz, W, X)
    pull[2] = pull[4] = sums[6]
    pull[3] = pull[5] = sums[7]
    for r in range(4):
        pull[12 + r] = 0.0
    Z[0], Z[1], Z[2], Z[3] = sums[8], sums[9], sums[9], sums[10]
    Z[4] = Z[5] = 0.0
    for i in range(nz):
        for c in range(2):
            pull[2 + c] -= E[2 * i + c] * Y[4 * i + 3]
            for r in range(3):
                Z[2 * r + c] += J[4 * i + r] * X[2 * i + c]
            for r in range(2):
                pull[12 + 2 * r + c] -= E[2 * i + r] * X[2 * i + c]
    pull[12] -= sums[11]
    pull[13] -= sums[12]
    pull[14] -= sums[12]
    pull[15] -= sums[13]
    for c in range(2):
        for r in range(3):
            pull[2 + c] += Z[2 * r + c] * step[r]
            pull[6 + 2 * r + c] = -(K[r, 0] * Z[c] + K[r, 1] * Z[2 + c] + K[r, 2] * Z[4 + c])
    for r in range(2):
        for c in range(2):
            for e in range(3):
                pull[12 + 2 * r + c] -= Z[2 * e + r] * pull[6 + 2 * e + c]
