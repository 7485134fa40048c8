"""A modal body: a chain of Appendix A elements whose nodes move in the span of a reduction basis.

Paper 2: Craig-Bampton modes and modal derivatives, with the options of `ksd.modal`. The values of all nodes are
z = z0 + Z (b, eta): b are the boundary values, functions of the pose of end q (interface nodes are shared, so bodies join
without multipliers); eta are the inner coordinates, condensed here in every Newton step. The energy is that of the
elements, summed over those with a weight (all with weight 1, or the sample of `ksd.numerics.reduction`).

Arrays (float64, SI): `value` = reference orientations 18 (columns of ends p and q), boundary values at the expansion
point (nb,), extra stiffness of inner coordinates without stiffness of their own (m,), then per element: weight,
constants 25 as in `ksd.elements.corotational` with n = 1, orientations 18, z0 (2 q,), Z (2 q, nb + m) of its two nodes, and
on a quadratic manifold, z = z0 + Z y + T y y / 2, T (2 q, nb + m, nb + m); `inner` = eta (m,); `number` = [elements, m,
nb, frame + 2 angle + 4 manifold]; `store` holds the factor of the inner tangent, its coupling and its residual.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.elements.modal_jets import JET, boundary_jets
from ksd.elements.modal_nodes import element_values
from ksd.numerics.kernel import kernel

ELEMENT_CONSTANTS = 44
"""Numbers of an element before its z0: weight, 25 constants, orientations."""
ELEMENT_SCRATCH_SIZE = 300
"""Scratch of one element."""


def modal_sizes(m: int) -> tuple[int, int]:
    """Lengths of `inner` and `store` of a body with m inner coordinates."""
    return m, m * m + 7 * m + ELEMENT_SCRATCH_SIZE


@kernel
def factor_dense(A, m):
    """Factor A (m*m,), row-major symmetric, into L (below) and 1/D of L D L^T; return the number of negative pivots, -1
    where a pivot vanished."""
    negatives = 0
    for j in range(m):
        pivot = A[m * j + j]
        if not abs(pivot) > 0.0:
            return -1
        negatives += pivot < 0.0
        inverse = 1.0 / pivot
        for i in range(j + 1, m):
            f = A[m * i + j] * inverse
            for k in range(j + 1, i + 1):
                A[m * i + k] -= f * A[m * k + j]
        for i in range(j + 1, m):
            A[m * i + j] *= inverse
        A[m * j + j] = inverse
    return negatives


@kernel
def solve_dense(A, m, x):
    """Overwrite x with (L D L^T)^-1 x for the factor of `factor_dense`."""
    for i in range(m):
        s = x[i]
        for j in range(i):
            s -= A[m * i + j] * x[j]
        x[i] = s
    for i in range(m - 1, -1, -1):
        s = x[i] * A[m * i + i]
        for j in range(i + 1, m):
            s -= A[m * j + i] * x[j]
        x[i] = s


@kernel
def add_projected(Z, gradient, H, weight, g, G, Y):
    """Add w Z^T gradient to g and w Z^T H Z to G (lower triangle) for Z (rows, M); Y (rows, M): scratch."""
    rows, M = Z.shape
    for r in range(rows):
        for c in range(M):
            Y[r, c] = 0.0
        for k in range(rows):
            h = weight * H[r, k]
            for c in range(M):
                Y[r, c] += h * Z[k, c]
    for r in range(rows):
        f = weight * gradient[r]
        for i in range(M):
            z = Z[r, i]
            g[i] += z * f
            for c in range(i + 1):
                G[i, c] += z * Y[r, c]


@kernel
def manifold_columns(T, y, Z, z, J):
    """Write J (rows, M) = Z + T y, and add T y y / 2 to z (rows,), for a quadratic manifold T (rows, M, M)."""
    rows, M = Z.shape
    for r in range(rows):
        s = 0.0
        for i in range(M):
            t = 0.0
            for k in range(M):
                t += T[r, i, k] * y[k]
            J[r, i] = Z[r, i] + t
            s += t * y[i]
        z[r] += 0.5 * s


@kernel
def add_manifold_curvature(T, gradient, weight, G):
    """Add w gradient . T, the curvature of the manifold, to G (lower triangle)."""
    rows, M = T.shape[0], T.shape[1]
    for r in range(rows):
        f = weight * gradient[r]
        for i in range(M):
            for c in range(i + 1):
                G[i, c] += f * T[r, i, c]


@kernel
def modal_gradient_and_tangent(value, number, y, store, g, G):
    """Gradient g (M,) and tangent G (M, M), lower triangle, by the coordinates y = (b - b0, eta); returns the status."""
    angle, manifold = (number[3] // 2) % 2, number[3] // 4
    q2 = 12 if angle else 18
    M = number[1] + number[2]
    at, status = 18 + M, 0
    z, gradient, H, Y = np.empty(q2), np.empty(q2), np.empty((q2, q2)), np.empty((q2, M))
    J = np.empty((q2, M))
    g[:] = 0.0
    G[:] = 0.0
    for i in range(number[2], M):
        extra_stiffness = value[18 + i]
        g[i], G[i, i] = extra_stiffness * y[i], extra_stiffness
    for _ in range(number[0]):
        record, R0 = value[at + 1 : at + 26], value[at + 26 : at + ELEMENT_CONSTANTS]
        first = at + ELEMENT_CONSTANTS + q2
        last = first + q2 * M
        Z = value[first:last].reshape(q2, M)
        T = value[last : last + manifold * q2 * M * M].reshape(manifold * q2, M, M)
        for r in range(q2):
            s = value[at + ELEMENT_CONSTANTS + r]
            for c in range(M):
                s += Z[r, c] * y[c]
                J[r, c] = Z[r, c]
            z[r] = s
        if manifold:
            manifold_columns(T, y, Z, z, J)
        status = max(status, element_values(record, store, z, R0, angle, gradient, H))
        add_projected(J, gradient, H, value[at], g, G, Y)
        if manifold:
            add_manifold_curvature(T, gradient, value[at], G)
        at = last + manifold * q2 * M * M
    return status


@kernel
def boundary_to_pose(jets, g, G, nb, M, lam, K, coupling):
    """Force lam (6,), tangent K (6, 6) and coupling (6, M - nb) by the pose of end q, from those by the boundary
    values."""
    half = np.empty((nb, 6))
    for i in range(nb):
        for c in range(6):
            s = 0.0
            for j in range(nb):
                s += (G[i, j] if j <= i else G[j, i]) * jets[j, 1 + c]
            half[i, c] = s
    for r in range(6):
        s = 0.0
        for i in range(nb):
            s += jets[i, 1 + r] * g[i]
        lam[r] = s
        for c in range(r, 6):
            t = 0.0
            at = 7 + 6 * r - (r * (r - 1)) // 2 + c - r
            for i in range(nb):
                t += jets[i, 1 + r] * half[i, c] + g[i] * jets[i, at]
            K[r, c] = K[c, r] = t
        for k in range(M - nb):
            s = 0.0
            for i in range(nb):
                s += jets[i, 1 + r] * G[nb + k, i]
            coupling[r, k] = s


@kernel
def condense_inner(g, G, nb, m, coupling, store, lam, K):
    """Condense the inner coordinates out of lam (12,) and K (6, 6); store what `modal_recover` needs.

    lam[6:] stays the force of the state itself. Returns (negative pivots, force error, moment error, status).
    """
    A, X = store[: m * m], store[m * m : m * m + 7 * m].reshape(7, m)
    for i in range(m):
        X[6, i] = g[nb + i]
        for c in range(i + 1):
            A[m * i + c] = G[nb + i, nb + c]
        for r in range(6):
            X[r, i] = coupling[r, i]
    for r in range(6):
        lam[6 + r] = lam[r]
    negatives = factor_dense(A, m)
    if negatives < 0:
        return 0, math.inf, math.inf, 2
    for r in range(7):
        solve_dense(A, m, X[r])
    ef = em = 0.0
    for r in range(6):
        s = 0.0
        for k in range(m):
            s += coupling[r, k] * X[6, k]
        lam[r] -= s
        if r < 3:
            ef += s * s
        else:
            em += s * s
        for c in range(r, 6):
            s = 0.0
            for k in range(m):
                s += coupling[r, k] * X[c, k]
            K[r, c] -= s
            K[c, r] = K[r, c]
    finite = math.isfinite(ef + em + lam[0] + K[0, 0])
    return negatives, math.sqrt(ef), math.sqrt(em), 0 if finite else 2


@kernel
def modal_condense(value, number, inner, store, d, Q, lam, K):
    """Force and moment lam (12,) on end q at d (3,) [m], Q (3, 3), and tangent K (6, 6), frame of end p.

    As every member; returns (negative pivots, force error [N], moment error [Nm], status).
    """
    m, nb = number[1], number[2]
    M = m + nb
    jets = np.empty((nb, JET))
    boundary_jets(number[3] % 2, (number[3] // 2) % 2, value[:18], d, Q, jets)
    y, g, G = np.empty(M), np.empty(M), np.empty((M, M))
    for i in range(nb):
        y[i] = jets[i, 0] - value[18 + i]
    for i in range(m):
        y[nb + i] = inner[i]
    scratch_at = m * m + 7 * m
    status = modal_gradient_and_tangent(value, number, y, store[scratch_at:], g, G)
    if status == 2:
        return 0, math.inf, math.inf, 2
    coupling = np.empty((6, m))
    boundary_to_pose(jets, g, G, nb, M, lam, K, coupling)
    negatives, ef, em, failed = condense_inner(g, G, nb, m, coupling, store, lam, K)
    return negatives, ef, em, max(status, failed)


@kernel
def modal_recover(value, number, inner, store, xi, scale):
    """Move the inner coordinates after end q moved by xi (6,), frame of p; the whole update is multiplied by `scale`."""
    m = number[1]
    X = store[m * m : m * m + 7 * m].reshape(7, m)
    for i in range(m):
        s = X[6, i]
        for r in range(6):
            s += X[r, i] * xi[r]
        inner[i] -= scale * s


@kernel
def chain_tangent(record, orientation, first, z, angle, g, H):
    """Gradient g (q k,) and tangent H (q k, q k) of a whole chain by the values z (k, q) of its k nodes, as bases need
    them.

    record (k-1, 25), orientation (k, 9) as in `element_values`; first (k-1,): first node of each element. Returns the
    worst status.
    """
    q = 6 if angle else 9
    store, two = np.empty(ELEMENT_SCRATCH_SIZE), np.empty(2 * q)
    R0, ge, He = np.empty(18), np.empty(2 * q), np.empty((2 * q, 2 * q))
    g[:] = 0.0
    H[:] = 0.0
    status = 0
    for e in range(len(first)):
        a = first[e]
        for i in range(q):
            two[i], two[q + i] = z[a, i], z[a + 1, i]
        for i in range(9):
            R0[i], R0[9 + i] = orientation[a, i], orientation[a + 1, i]
        status = max(status, element_values(record[e], store, two, R0, angle, ge, He))
        for i in range(2 * q):
            g[q * a + i] += ge[i]
            for j in range(2 * q):
                H[q * a + i, q * a + j] += He[i, j]
    return status
