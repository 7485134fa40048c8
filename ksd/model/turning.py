"""The Newton step with loads that are not conservative: the skew part of their tangent, as a correction of low rank.

A load that turns with its node, and in space a moment that does not, has the tangent K + E B E': K symmetric, as assembled
and factored; E picks the unknowns of the loaded nodes, B (w, w) per load, w = 6 in space and 3 in the plane, is skew and
what `ksd.model.loading` leaves out. Following: force rows, rotation columns: [F]x / 2; rotation rows, force columns:
[F]x / 2; rotations: [M]x / 2, M about the node. Fixed in space: rotations: -[M]x / 2, M the moment alone. (Of all that has
an energy the assembly holds the second derivatives along exp(phi) R. The moment itself, which balances M, changes with phi
by these less [M]x / 2; Argyris et al., Comp. Meth. Appl. Mech. Eng. 14, 1978, and 17/18, 1979.)

Sherman, Morrison and Woodbury: x = y - X (1 + B E'X)^-1 B E'y, y = K^-1 r, X = K^-1 E: w more solves per load, and Newton
converges quadratically.
"""

from __future__ import annotations

import numpy as np

from ksd.numerics.blocks import solve_blocks
from ksd.numerics.kernel import kernel


@kernel
def turning(loads, start):
    """Number of loads with a skew tangent on nodes that can move."""
    count = 0
    for i in range(len(loads.node)):
        if loads.skew[i] == 1 and start[loads.node[i]] >= 0:
            count += 1
    return count


@kernel
def _rest(loads, i, R, factor, B):
    """B (6, 6) of load i: see the module docstring."""
    T = R[loads.node[i]]
    p, f, m = loads.point[i], loads.force[i], loads.moment[i]
    F, M, s = np.empty(3), np.empty(3), np.empty(3)
    for r in range(3):
        F[r], s[r], M[r] = 0.0, 0.0, -0.5 * factor * m[r]
    if loads.following[i] == 1:
        for r in range(3):
            F[r] = 0.5 * factor * (T[r, 0] * f[0] + T[r, 1] * f[1] + T[r, 2] * f[2])
            M[r] = 0.5 * factor * (T[r, 0] * m[0] + T[r, 1] * m[1] + T[r, 2] * m[2])
            s[r] = T[r, 0] * p[0] + T[r, 1] * p[1] + T[r, 2] * p[2]
    B[:] = 0.0
    for r in range(3):
        j, k = (r + 1) % 3, (r + 2) % 3
        B[r, 3 + j], B[r, 3 + k] = -F[k], F[j]
        B[3 + r, j], B[3 + r, k] = -F[k], F[j]
    for r in range(3):
        M[r] += s[(r + 1) % 3] * F[(r + 2) % 3] - s[(r + 2) % 3] * F[(r + 1) % 3]
    for r in range(3):
        j, k = (r + 1) % 3, (r + 2) % 3
        B[3 + r, 3 + j], B[3 + r, 3 + k] = -M[k], M[j]


@kernel
def _gauss(G, z):
    """z <- G^-1 z in place, with pivoting by rows; G (k, k) is lost."""
    k = len(z)
    for c in range(k):
        best = c
        for r in range(c + 1, k):
            if abs(G[r, c]) > abs(G[best, c]):
                best = r
        if best != c:
            for q in range(k):
                G[c, q], G[best, q] = G[best, q], G[c, q]
            z[c], z[best] = z[best], z[c]
        for r in range(c + 1, k):
            f = G[r, c] / G[c, c]
            if f != 0.0:
                for q in range(c + 1, k):
                    G[r, q] -= f * G[c, q]
                z[r] -= f * z[c]
    for c in range(k - 1, -1, -1):
        for q in range(c + 1, k):
            z[c] -= G[c, q] * z[q]
        z[c] /= G[c, c]


@kernel
def _columns(loads, start, plan, work, width, X):
    """X (width m, n): K^-1 for every unknown of the loaded nodes."""
    row = 0
    for i in range(len(loads.node)):
        u = start[loads.node[i]]
        if loads.skew[i] != 1 or u < 0:
            continue
        for c in range(width):
            X[row, :] = 0.0
            X[row, u + c] = 1.0
            solve_blocks(plan, work.value, work.spare, X[row])
            row += 1


@kernel
def _add_rows(B, u, keep, row, X, y, G, z):
    """Rows of one load, from `row` on: G = 1 + B E'X, z = B E'y."""
    width = len(keep)
    for r in range(width):
        for q in range(len(z)):
            G[row + r, q] = 1.0 if row + r == q else 0.0
            for c in range(width):
                G[row + r, q] += B[keep[r], keep[c]] * X[q, u + c]
        z[row + r] = 0.0
        for c in range(width):
            z[row + r] += B[keep[r], keep[c]] * y[u + c]


@kernel
def _take_out(X, z, y):
    """y <- y - X' z."""
    for q in range(len(z)):
        for k in range(len(y)):
            y[k] -= z[q] * X[q, k]


@kernel
def turn_step(loads, start, keep, plan, R, work, factor):
    """Correct the step in work.rhs of a system whose matrix is factored; R (k, 3, 3): rotations of the nodes."""
    n, k = len(work.rhs), len(keep) * turning(loads, start)
    X = work.scratch[: k * n].reshape(k, n)
    G = work.scratch[k * n : k * (n + k)].reshape(k, k)
    z = work.scratch[k * (n + k) : k * (n + k + 1)]
    B = np.empty((6, 6))
    _columns(loads, start, plan, work, len(keep), X)
    row = 0
    for i in range(len(loads.node)):
        if loads.skew[i] == 1 and start[loads.node[i]] >= 0:
            _rest(loads, i, R, factor, B)
            _add_rows(B, start[loads.node[i]], keep, row, X, work.rhs, G, z)
            row += len(keep)
    _gauss(G, z)
    _take_out(X, z, work.rhs)
