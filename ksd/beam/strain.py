"""The strain-mode leaf: one body per leaf, condensed to its end frames inside the same Newton step.

Unknowns of a leaf: amplitudes a of its curvature modes (nx torsion, ny strong, nz weak bending; 1/m) and lam
= (n, m), force and moment on end q (N, Nm). Curvature kappa_c = sum_k a_ck B_ck(s); orientation R' = R
[kappa]x by a fourth-order Magnus step over every gap between quadrature points; r' = v = R (e1 + C R^T n)
with C = diag(1/EA, 1/kGA, 1/kGA), so stretch and shear are exact without unknowns. All vectors in the frame
of end p. Interface of all members: see `ksd.model.assembly`. Source: the stationary conditions of the mixed
functional 1/2 a K a - 1/2 int n.(R C R^T n) + lam.closure; tables are made by `ksd.beam.strain_values`,
fields and tangent of the modes by `ksd.beam.strain_fields`.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.beam.strain_fields import strain_fields, strain_tangent
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log


@kernel
def _invert6(F, K):
    """K (6, 6) = F^-1 for symmetric F (6, 7+) by sweeping pivot after pivot; returns (negative pivots, ok)."""
    negatives = 0
    row = np.empty(6)
    for i in range(6):
        for j in range(6):
            K[i, j] = 0.5 * (F[i, j] + F[j, i])
    for k in range(6):
        pivot = K[k, k]
        if not abs(pivot) > 1e-18 * abs(F[k, k]):
            return negatives, False
        if pivot < 0.0:
            negatives += 1
        inverse = 1.0 / pivot
        for j in range(6):
            row[j] = K[k, j] * inverse
        for i in range(6):
            w = K[i, k]
            for j in range(6):
                K[i, j] -= w * row[j]
        for j in range(6):
            K[k, j] = row[j]
            K[j, k] = row[j]
        K[k, k] = -inverse
    for i in range(6):
        for j in range(6):
            K[i, j] = -K[i, j]
    return negatives, True


@kernel
def strain_condense(value, number, inner, store, d, Q, lam, K):
    """Condense one leaf at end pose d (3,) [m], Q (3, 3); see the module docstring for the equations.

    inner = (a (N,), lam (6,)). Writes lam[0:6] condensed end wrench, lam[6:12] the wrench the geometric terms
    use (the one before this step), K (6, 6). store keeps W^-1 J^T (N, 6), W^-1 g (N,), K (6, 6) and
    c + J W^-1 g (6,).
    Returns (negative pivots of W minus those of F, |change of n| [N], |change of m| [Nm], status).
    """
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    N = nx + ny + nz
    L = value[0]
    # where the weights sit, see strain_values.py
    weight = 1 + nx * nx + ny * ny + nz * nz + N
    R = np.empty((ng + 1, 3, 3))
    v = np.empty((ng, 3))
    S = np.empty((ng, 6))
    m = np.empty((ng, 3))
    f = np.empty((ng, 3, N))
    psi = np.empty((ng + 1, 3, N))
    rho = np.empty((ng + 1, 3, N))
    W = np.zeros((N, N))
    Y = np.empty((N, 8))
    P = np.empty((3, N))
    res = np.zeros(N)
    q0, q1, q2 = strain_fields(value, number, inner, R, v, S, m, psi, rho, f)
    strain_tangent(value, number, inner, R, m, psi, rho, W, res, P)
    # Y = W^-1 [J^T, g], seven right-hand sides at once; W = U^T D U, row by row of its upper triangle
    for i in range(N):
        P[0, i] = abs(W[i, i])
        for x3 in range(3):
            Y[i, x3] = rho[ng, x3, i]
            Y[i, 3 + x3] = psi[ng, x3, i]
        Y[i, 6] = res[i]
        Y[i, 7] = 0.0
    negatives = 0
    status = 0
    for j in range(N):
        pivot = W[j, j]
        if not abs(pivot) > 1e-15 * P[0, j]:
            status = 2
            pivot = 1e-15 * P[0, j] + 1e-300
        if pivot < 0.0:
            negatives += 1
        inverse = 1.0 / pivot
        P[1, j] = inverse
        for i in range(j + 1, N):
            w = W[j, i] * inverse
            for k in range(i, N):
                W[i, k] -= w * W[j, k]
            for e in range(8):
                Y[i, e] -= w * Y[j, e]
    for i in range(N - 1, -1, -1):
        w = P[1, i]
        y0, y1, y2, y3 = Y[i, 0], Y[i, 1], Y[i, 2], Y[i, 3]
        y4, y5, y6 = Y[i, 4], Y[i, 5], Y[i, 6]
        for k in range(i + 1, N):
            u = W[i, k]
            y0 -= u * Y[k, 0]
            y1 -= u * Y[k, 1]
            y2 -= u * Y[k, 2]
            y3 -= u * Y[k, 3]
            y4 -= u * Y[k, 4]
            y5 -= u * Y[k, 5]
            y6 -= u * Y[k, 6]
        Y[i, 0], Y[i, 1], Y[i, 2], Y[i, 3] = w * y0, w * y1, w * y2, w * y3
        Y[i, 4], Y[i, 5], Y[i, 6] = w * y4, w * y5, w * y6

    # F = J W^-1 J^T + L sum w S (force block);  c = closure + J W^-1 g
    F = np.zeros((6, 8))
    for i in range(N):
        for x3 in range(3):
            w, u = rho[ng, x3, i], psi[ng, x3, i]
            for e in range(8):
                F[x3, e] += w * Y[i, e]
                F[3 + x3, e] += u * Y[i, e]
    for g in range(ng):
        w = L * value[weight + g]
        F[0, 0] += w * S[g, 0]
        F[0, 1] += w * S[g, 1]
        F[0, 2] += w * S[g, 2]
        F[1, 0] += w * S[g, 1]
        F[1, 1] += w * S[g, 3]
        F[1, 2] += w * S[g, 4]
        F[2, 0] += w * S[g, 2]
        F[2, 1] += w * S[g, 4]
        F[2, 2] += w * S[g, 5]
    gap = np.empty(3)
    T = R[ng]
    step = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            step[i, j] = Q[i, 0] * T[j, 0] + Q[i, 1] * T[j, 1] + Q[i, 2] * T[j, 2]
    rotation_log(step, gap)
    back, fine = _invert6(F, K)
    if not fine:
        status = 2
    tail = N * 7
    c0 = tail + 36
    store[c0 + 0] = d[0] - q0 + F[0, 6]
    store[c0 + 1] = d[1] - q1 + F[1, 6]
    store[c0 + 2] = d[2] - q2 + F[2, 6]
    for r in range(3):
        store[c0 + 3 + r] = gap[r] + F[3 + r, 6]
    for i in range(N):
        for e in range(7):
            store[i * 7 + e] = Y[i, e]
    dn, dm = 0.0, 0.0
    for r in range(6):
        s = 0.0
        for e in range(6):
            store[tail + r * 6 + e] = K[r, e]
            s += K[r, e] * store[c0 + e]
        lam[r] = inner[N + r] + s
        lam[6 + r] = inner[N + r]
        if r < 3:
            dn += s * s
        else:
            dm += s * s
    if not math.isfinite(dn + dm):
        status = 2
    return negatives - back, math.sqrt(dn), math.sqrt(dm), status


@kernel
def strain_recover(value, number, inner, store, xi, scale):
    """dlam = K (xi + c), da = W^-1 (J^T dlam - g), both times `scale`, added to the inner state."""
    N = number[0] + number[1] + number[2]
    tail = N * 7
    c0 = tail + 36
    step = np.empty(6)
    for r in range(6):
        s = 0.0
        for e in range(6):
            s += store[tail + r * 6 + e] * (xi[e] + store[c0 + e])
        step[r] = s
        inner[N + r] += scale * s
    for i in range(N):
        s = -store[i * 7 + 6]
        for e in range(6):
            s += store[i * 7 + e] * step[e]
        inner[i] += scale * s
