"""The strain-mode leaf: one body per leaf, condensed to its end frames inside the same Newton step.

Unknowns of a leaf: amplitudes a of its curvature modes (nx torsion, ny strong, nz weak bending; 1/m) and
lam = (n, m), force and moment on end q (N, Nm). Curvature kappa_c = sum_k a_ck B_ck(s); orientation R' = R [kappa]x
by a fourth-order Magnus step over every gap between quadrature points; r' = v = R (e1 + C R^T n) with
C = diag(1/EA, 1/kGA, 1/kGA), so stretch and shear are exact without unknowns. All vectors in the frame of end p.
Interface of all members: see `ksd.model.members`. Source: the stationary conditions of the mixed functional
1/2 a K a - 1/2 int n.(R C R^T n) + lam.closure; tables are made by `ksd.beam.strain_values`.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_exp, rotation_log


@kernel
def _multiply(A, B, C):
    """C = A B, all (3, 3); C must not alias."""
    for i in range(3):
        for j in range(3):
            C[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@kernel
def _orientations(value, number, a, at, R):
    """R (ng+1, 3, 3): orientation at the quadrature points and, last, at end q; Magnus steps over the gaps."""
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    N = nx + ny + nz
    L = value[0]
    linear = at
    yz = linear + (ng + 1) * N
    zx = yz + (ng + 1) * ny * nz
    xy = zx + (ng + 1) * nz * nx
    phi = np.empty(3)
    step = np.empty((3, 3))
    for g in range(ng + 1):
        # int kappa over the gap
        base = linear + g * N
        px, py, pz = 0.0, 0.0, 0.0
        for k in range(nx):
            px += value[base + k] * a[k]
        for k in range(ny):
            py += value[base + nx + k] * a[nx + k]
        for k in range(nz):
            pz += value[base + nx + ny + k] * a[nx + ny + k]
        # 1/2 iint_{s1<s2} kappa(s1) x kappa(s2), component by component
        cx, cy, cz = 0.0, 0.0, 0.0
        for k in range(ny):
            s = 0.0
            for l in range(nz):
                s += value[yz + (g * ny + k) * nz + l] * a[nx + ny + l]
            cx += a[nx + k] * s
        for k in range(nz):
            s = 0.0
            for l in range(nx):
                s += value[zx + (g * nz + k) * nx + l] * a[l]
            cy += a[nx + ny + k] * s
        for k in range(nx):
            s = 0.0
            for l in range(ny):
                s += value[xy + (g * nx + k) * ny + l] * a[nx + l]
            cz += a[k] * s
        phi[0] = L * px + 0.5 * L * L * cx
        phi[1] = L * py + 0.5 * L * L * cy
        phi[2] = L * pz + 0.5 * L * L * cz
        if g == 0:
            rotation_exp(phi, R[0])
        else:
            rotation_exp(phi, step)
            _multiply(R[g - 1], step, R[g])


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

    inner = (a (N,), lam (6,)). Writes lam[0:6] condensed end wrench, lam[6:12] the wrench the geometric terms use
    (the one before this step), K (6, 6). store keeps W^-1 J^T (N, 6), W^-1 g (N,), K (6, 6), c + J W^-1 g (6,).
    Returns (negative pivots of W minus those of F, |change of n| [N], |change of m| [Nm], status).
    """
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    N = nx + ny + nz
    L = value[0]
    # layout of the tables, see strain_values.py
    stiff = 1
    rest = stiff + nx * nx + ny * ny + nz * nz
    weight = rest + N
    integral = weight + ng
    basis = integral + ng * ng
    slack = basis + N * ng
    gaps = slack + 3 * ng
    a = inner[0:N]
    n0, n1, n2 = inner[N], inner[N + 1], inner[N + 2]
    m0, m1, m2 = inner[N + 3], inner[N + 4], inner[N + 5]
    R = np.empty((ng + 1, 3, 3))
    _orientations(value, number, a, gaps, R)

    # v = R e1 + R C R^T n and the matrix S = R C R^T at every point
    v = np.empty((ng, 3))
    S = np.empty((ng, 6))
    for g in range(ng):
        c0, c1, c2 = value[slack + 3 * g], value[slack + 3 * g + 1], value[slack + 3 * g + 2]
        T = R[g]
        S[g, 0] = c0 * T[0, 0] * T[0, 0] + c1 * T[0, 1] * T[0, 1] + c2 * T[0, 2] * T[0, 2]
        S[g, 1] = c0 * T[0, 0] * T[1, 0] + c1 * T[0, 1] * T[1, 1] + c2 * T[0, 2] * T[1, 2]
        S[g, 2] = c0 * T[0, 0] * T[2, 0] + c1 * T[0, 1] * T[2, 1] + c2 * T[0, 2] * T[2, 2]
        S[g, 3] = c0 * T[1, 0] * T[1, 0] + c1 * T[1, 1] * T[1, 1] + c2 * T[1, 2] * T[1, 2]
        S[g, 4] = c0 * T[1, 0] * T[2, 0] + c1 * T[1, 1] * T[2, 1] + c2 * T[1, 2] * T[2, 2]
        S[g, 5] = c0 * T[2, 0] * T[2, 0] + c1 * T[2, 1] * T[2, 1] + c2 * T[2, 2] * T[2, 2]
        v[g, 0] = T[0, 0] + S[g, 0] * n0 + S[g, 1] * n1 + S[g, 2] * n2
        v[g, 1] = T[1, 0] + S[g, 1] * n0 + S[g, 3] * n1 + S[g, 4] * n2
        v[g, 2] = T[2, 0] + S[g, 2] * n0 + S[g, 4] * n1 + S[g, 5] * n2
    # r(L) = L sum w v;  lever(s) = r(L) - r(s);  m(s) = m + lever x n
    q0, q1, q2 = 0.0, 0.0, 0.0
    for g in range(ng):
        w = L * value[weight + g]
        q0 += w * v[g, 0]
        q1 += w * v[g, 1]
        q2 += w * v[g, 2]
    m = np.empty((ng, 3))
    for g in range(ng):
        x, y, z = q0, q1, q2
        for h in range(ng):
            w = L * value[integral + g * ng + h]
            x -= w * v[h, 0]
            y -= w * v[h, 1]
            z -= w * v[h, 2]
        m[g, 0] = m0 + y * n2 - z * n1
        m[g, 1] = m1 + z * n0 - x * n2
        m[g, 2] = m2 + x * n1 - y * n0

    # mode fields psi_i = int R e_c B_i, rho_i = int psi_i x v - S (psi_i x n); last index runs over the modes
    f = np.empty((ng, 3, N))
    for g in range(ng):
        T = R[g]
        for i in range(N):
            c = 0 if i < nx else (1 if i < nx + ny else 2)
            b = L * value[basis + i * ng + g]
            f[g, 0, i] = T[0, c] * b
            f[g, 1, i] = T[1, c] * b
            f[g, 2, i] = T[2, c] * b
    psi = np.zeros((ng + 1, 3, N))
    for g in range(ng + 1):
        for h in range(ng):
            w = value[weight + h] if g == ng else value[integral + g * ng + h]
            for x3 in range(3):
                for i in range(N):
                    psi[g, x3, i] += w * f[h, x3, i]
    for g in range(ng):
        v0, v1, v2 = v[g, 0], v[g, 1], v[g, 2]
        s0, s1, s2, s3, s4, s5 = S[g, 0], S[g, 1], S[g, 2], S[g, 3], S[g, 4], S[g, 5]
        for i in range(N):
            p0, p1, p2 = psi[g, 0, i], psi[g, 1, i], psi[g, 2, i]
            t0 = p1 * n2 - p2 * n1
            t1 = p2 * n0 - p0 * n2
            t2 = p0 * n1 - p1 * n0
            f[g, 0, i] = L * (p1 * v2 - p2 * v1 - (s0 * t0 + s1 * t1 + s2 * t2))
            f[g, 1, i] = L * (p2 * v0 - p0 * v2 - (s1 * t0 + s3 * t1 + s4 * t2))
            f[g, 2, i] = L * (p0 * v1 - p1 * v0 - (s2 * t0 + s4 * t1 + s5 * t2))
    rho = np.zeros((ng + 1, 3, N))
    for g in range(ng + 1):
        for h in range(ng):
            w = value[weight + h] if g == ng else value[integral + g * ng + h]
            for x3 in range(3):
                for i in range(N):
                    rho[g, x3, i] += w * f[h, x3, i]

    # g_i = K (a - a0) - L sum w B_i (R e_c).m ; W = K - sym L sum w B_j (R e_cj).[m x psi_i + (rho_i(L) - rho_i) x n]
    W = np.zeros((N, N))
    res = np.zeros(N)
    at = stiff
    first = 0
    for c in range(3):
        k = number[c]
        for i in range(k):
            for j in range(k):
                W[first + i, first + j] = value[at + i * k + j]
                res[first + i] += value[at + i * k + j] * (a[first + j] - value[rest + first + j])
        at += k * k
        first += k
    P = np.empty((3, N))
    for g in range(ng):
        T = R[g]
        w = L * value[weight + g]
        g0, g1, g2 = m[g, 0], m[g, 1], m[g, 2]
        for i in range(N):
            p0, p1, p2 = psi[g, 0, i], psi[g, 1, i], psi[g, 2, i]
            r0 = rho[ng, 0, i] - rho[g, 0, i]
            r1 = rho[ng, 1, i] - rho[g, 1, i]
            r2 = rho[ng, 2, i] - rho[g, 2, i]
            t0 = g1 * p2 - g2 * p1 + r1 * n2 - r2 * n1
            t1 = g2 * p0 - g0 * p2 + r2 * n0 - r0 * n2
            t2 = g0 * p1 - g1 * p0 + r0 * n1 - r1 * n0
            P[0, i] = T[0, 0] * t0 + T[1, 0] * t1 + T[2, 0] * t2
            P[1, i] = T[0, 1] * t0 + T[1, 1] * t1 + T[2, 1] * t2
            P[2, i] = T[0, 2] * t0 + T[1, 2] * t1 + T[2, 2] * t2
        for j in range(N):
            c = 0 if j < nx else (1 if j < nx + ny else 2)
            b = w * value[basis + j * ng + g]
            res[j] -= b * (T[0, c] * g0 + T[1, c] * g1 + T[2, c] * g2)
            for i in range(N):
                W[j, i] -= b * P[c, i]
    for i in range(N):
        for j in range(i):
            s = 0.5 * (W[i, j] + W[j, i])
            W[i, j] = s

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
