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
    """K (6, 6) = F^-1 by LDL^T without pivoting; returns (negative pivots, ok)."""
    negatives = 0
    D = np.empty(6)
    M = np.empty((6, 6))
    for j in range(6):
        d = F[j, j]
        for c in range(j):
            d -= M[j, c] * M[j, c] * D[c]
        if not abs(d) > 1e-18 * abs(F[j, j]):
            return negatives, False
        D[j] = d
        if d < 0.0:
            negatives += 1
        for i in range(j + 1, 6):
            s = F[i, j]
            for c in range(j):
                s -= M[i, c] * M[j, c] * D[c]
            M[i, j] = s / d
    for col in range(6):
        x = K[col]
        for i in range(6):
            s = 1.0 if i == col else 0.0
            for c in range(i):
                s -= M[i, c] * x[c]
            x[i] = s
        for i in range(5, -1, -1):
            s = x[i] / D[i]
            for c in range(i + 1, 6):
                s -= M[c, i] * x[c]
            x[i] = s
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
    psi = np.zeros((ng + 1, 3, N))
    rho = np.zeros((ng + 1, 3, N))
    q0, q1, q2 = strain_fields(value, number, inner, R, v, S, m, psi, rho, f)
    W = np.zeros((N, N))
    res = np.zeros(N)
    P = np.empty((3, N))
    strain_tangent(value, number, inner, R, m, psi, rho, W, res, P)

    # W = L D L^T, then Y = W^-1 [J^T, g] for the seven right-hand sides at once
    negatives = 0
    status = 0
    for j in range(N):
        before = abs(W[j, j])
        for c in range(j):
            W[j, j] -= W[j, c] * W[j, c] * W[c, c]
        pivot = W[j, j]
        if not abs(pivot) > 1e-15 * before:
            status = 2
            pivot = 1e-15 * before + 1e-300
            W[j, j] = pivot
        if pivot < 0.0:
            negatives += 1
        for i in range(j + 1, N):
            s = W[i, j]
            for c in range(j):
                s -= W[i, c] * W[j, c] * W[c, c]
            W[i, j] = s / pivot
    Y = np.empty((N, 8))
    for i in range(N):
        for x3 in range(3):
            Y[i, x3] = rho[ng, x3, i]
            Y[i, 3 + x3] = psi[ng, x3, i]
        Y[i, 6] = res[i]
        Y[i, 7] = 0.0
    for i in range(N):
        for c in range(i):
            w = W[i, c]
            for e in range(8):
                Y[i, e] -= w * Y[c, e]
    for i in range(N - 1, -1, -1):
        w = 1.0 / W[i, i]
        for e in range(8):
            Y[i, e] *= w
        for c in range(i + 1, N):
            w = W[c, i]
            for e in range(8):
                Y[i, e] -= w * Y[c, e]

    # F = J W^-1 J^T + L sum w S (force block);  c = closure + J W^-1 g
    F = np.zeros((6, 7))
    for i in range(N):
        for r in range(6):
            t0 = rho[ng, r, i] if r < 3 else psi[ng, r - 3, i]
            for e in range(7):
                F[r, e] += t0 * Y[i, e]
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
