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

from ksd.beam.strain_fields import places, strain_fields, strain_tangent
from ksd.beam.weight import PULL
from ksd.numerics.kernel import kernel
from ksd.numerics.local import local_matrix, local_vector
from ksd.numerics.rotations import rotation_log
from ksd.numerics.sums import weighted_sum, weighted_sums


@kernel
def _invert6(F, K):
    """K (6, 6) = F^-1 for symmetric F (6, 7+) by sweeping pivot after pivot; returns (negative pivots, ok)."""
    negatives = 0
    row = local_vector(6)
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
def _factor(N, scratch, W, t):
    """W = U^T D U in place, row by row of its upper triangle (rows D U), and Y = W^-1 Y, the 8 columns beside it;
    1/D from t on. What stands below the diagonal is used up.

    Returns (negative pivots, 2 where one had to be replaced, else 0).
    """
    negatives, status, wide = 0, 0, N + 8
    o = t + N
    for i in range(N):
        row = W + wide * i
        before = abs(scratch[row + i])
        for j in range(i):
            scratch[o + j] = scratch[W + wide * j + i] * scratch[t + j]
        # whole vectors of four from the last one that starts before the diagonal
        c = i & -4
        weighted_sum(scratch, row + c, 0, wide - c, scratch, o, 0, 1, i, scratch, W + c, wide, -1.0, True)
        pivot = scratch[row + i]
        if not abs(pivot) > 1e-15 * before:
            status = 2
            pivot = 1e-15 * before + 1e-300
        if pivot < 0.0:
            negatives += 1
        scratch[t + i] = 1.0 / pivot
    for i in range(N - 1, -1, -1):
        o, y = W + wide * i + i + 1, W + wide * i + N
        weighted_sum(scratch, y, 0, 8, scratch, o, 0, 1, N - 1 - i, scratch, y + wide, wide, -1.0, True)
        w = scratch[t + i]
        for e in range(7):
            scratch[y + e] *= w
    return negatives, status


@kernel
def _solve_more(N, scratch, W, t, X):
    """X (N, 3) = W^-1 X for W as `_factor` leaves it."""
    for i in range(N):
        for j in range(i):
            w = scratch[W + (N + 8) * j + i] * scratch[t + j]
            for c in range(3):
                X[i, c] -= w * X[j, c]
    for i in range(N - 1, -1, -1):
        for k in range(i + 1, N):
            for c in range(3):
                X[i, c] -= scratch[W + (N + 8) * i + k] * X[k, c]
        for c in range(3):
            X[i, c] *= scratch[t + i]


@kernel
def _add_flexibility(w, scratch, S, A):
    """A (3, 3) += w S, S: place of a symmetric matrix as xx, xy, xz, yy, yz, zz."""
    A[0, 0] += w * scratch[S]
    A[0, 1] += w * scratch[S + 1]
    A[0, 2] += w * scratch[S + 2]
    A[1, 0] += w * scratch[S + 1]
    A[1, 1] += w * scratch[S + 3]
    A[1, 2] += w * scratch[S + 4]
    A[2, 0] += w * scratch[S + 2]
    A[2, 1] += w * scratch[S + 4]
    A[2, 2] += w * scratch[S + 5]


@kernel
def _follow_gravity(value, number, pull, scratch, K, step, X):
    """The pull (39,) of a leaf with weight, see `ksd.beam.weight`; X (N, 3) = W^-1 eta(L)^T is kept for `strain_recover`.

    With B = int M S and Z = J X + B (force rows): V_xi,g = -K Z, V_g,g = Z^T K Z - eta X - int M^2 S, and the
    first moment int M v is predicted with the step of the wrench, step = K (c + J W^-1 g).
    """
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    N = nx + ny + nz
    L = value[0]
    weight = 1 + nx * nx + ny * ny + nz * nz + N
    beyond = weight + ng + ng * ng + N * ng + 3 * ng + (N + ny * nz + nz * nx + nx * ny) * (ng + 1)
    at = places(N, ng)
    v, S, W, eta = at.v, at.S, at.W, at.eta
    psi, rho = at.fields, at.fields + 3 * N
    Z, G = local_matrix(6, 3), local_matrix(3, 3)
    for c in range(3):
        pull[3 + c] = 0.0
        for r in range(3):
            Z[r, c] = Z[3 + r, c] = G[r, c] = 0.0
    for g in range(ng):
        w = L * value[weight + g] * value[beyond + g]
        for c in range(3):
            pull[3 + c] += w * scratch[v + 4 * g + c]
        _add_flexibility(w, scratch, S + 6 * g, Z)
        _add_flexibility(w * value[beyond + g], scratch, S + 6 * g, G)
    for i in range(N):
        for c in range(3):
            X[i, c] = scratch[eta + N * c + i]
    _solve_more(N, scratch, W, at.t, X)
    for c in range(3):
        pull[6 + c] = pull[3 + c]
        for i in range(N):
            pull[3 + c] -= scratch[eta + N * c + i] * scratch[W + (N + 8) * i + N + 6]
            for r in range(3):
                Z[r, c] += scratch[rho + N * r + i] * X[i, c]
                Z[3 + r, c] += scratch[psi + N * r + i] * X[i, c]
                G[r, c] += scratch[eta + N * r + i] * X[i, c]
    for c in range(3):
        for r in range(6):
            pull[3 + c] += Z[r, c] * step[r]
            s = 0.0
            for e in range(6):
                s -= K[r, e] * Z[e, c]
            pull[9 + 3 * r + c] = s
    for r in range(3):
        for c in range(3):
            s = -G[r, c]
            for e in range(6):
                s -= Z[e, r] * pull[9 + 3 * e + c]
            pull[27 + 3 * r + c] = s


@kernel
def strain_condense(value, number, inner, store, scratch, d, Q, lam, K):
    """Condense one leaf at end pose d (3,) [m], Q (3, 3); see the module docstring for the equations.

    inner = (a (N,), lam (6,)). Writes lam[0:6] condensed end wrench, lam[6:12] the wrench the geometric terms
    use (the one before this step), K (6, 6). store keeps W^-1 J^T (N, 6), W^-1 g (N,), K (6, 6) and
    c + J W^-1 g (6,); a leaf with weight also W^-1 eta(L)^T (N, 3) and its pull (see `ksd.beam.weight`).
    scratch: `strain_values.strain_scratch` numbers or more, left undefined.
    Returns (negative pivots of W minus those of F, |change of n| [N], |change of m| [Nm], status).
    """
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    N = nx + ny + nz
    L = value[0]
    # where the weights sit, see strain_values.py
    weight = 1 + nx * nx + ny * ny + nz * nz + N
    tail = N * 7
    c0 = tail + 36
    heavy = len(store) > tail + 42
    pull = store[len(store) - PULL if heavy else len(store) :]
    at = places(N, ng)
    R, S, m, f, fields, W = at.R, at.S, at.m, at.f, at.fields, at.W
    wide, Y = N + 8, W + N
    strain_fields(value, number, inner, pull, scratch)
    strain_tangent(value, number, inner, pull, scratch)
    # Y = W^-1 [J^T, g], seven right-hand sides at once; J = (rho(L), psi(L))
    psi, rho = fields, fields + 3 * N
    for i in range(N):
        o = Y + wide * i
        for r in range(3):
            scratch[o + r] = scratch[rho + N * r + i]
            scratch[o + 3 + r] = scratch[psi + N * r + i]
        scratch[o + 7] = 0.0
    negatives, status = _factor(N, scratch, W, at.t)
    # F = J W^-1 J^T + L sum w S (force block);  c = closure + J W^-1 g
    weighted_sums(scratch, f, 8, 8, scratch, rho, N, 1, N, scratch, Y, wide, 1.0, False)
    weighted_sums(scratch, f + 24, 8, 8, scratch, psi, N, 1, N, scratch, Y, wide, 1.0, False)
    F = scratch[f : f + 48].reshape((6, 8))
    for g in range(ng):
        w = L * value[weight + g]
        _add_flexibility(w, scratch, S + 6 * g, F)
    gap, step = local_vector(3), local_matrix(3, 3)
    T = scratch[R + 9 * ng : R + 9 * ng + 9].reshape((3, 3))
    for i in range(3):
        for j in range(3):
            step[i, j] = Q[i, 0] * T[j, 0] + Q[i, 1] * T[j, 1] + Q[i, 2] * T[j, 2]
    rotation_log(step, gap)
    back, fine = _invert6(F, K)
    if not fine:
        status = 2
    for r in range(3):
        store[c0 + r] = d[r] - scratch[m + r] + F[r, 6]
        store[c0 + 3 + r] = gap[r] + F[3 + r, 6]
    for i in range(N):
        for e in range(7):
            store[i * 7 + e] = scratch[Y + wide * i + e]
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
    if heavy:
        change = local_vector(6)
        for r in range(6):
            change[r] = lam[r] - lam[6 + r]
        X = store[tail + 42 : tail + 42 + 3 * N].reshape((N, 3))
        _follow_gravity(value, number, pull, scratch, K, change, X)
    if not math.isfinite(dn + dm):
        status = 2
    return negatives - back, math.sqrt(dn), math.sqrt(dm), status


@kernel
def strain_recover(value, number, inner, store, xi, scale):
    """dlam = K (xi + c), da = W^-1 (J^T dlam - g), both times `scale`, added to the inner state.

    A leaf with weight follows the change of gravity in frame p, the last three numbers of its pull.
    """
    N = number[0] + number[1] + number[2]
    tail = N * 7
    c0 = tail + 36
    heavy = len(store) > tail + 42
    o = len(store) - PULL
    step = local_vector(6)
    for r in range(6):
        s = 0.0
        for e in range(6):
            s += store[tail + r * 6 + e] * (xi[e] + store[c0 + e])
        if heavy:
            for e in range(3):
                s += store[o + 9 + 3 * r + e] * store[o + 36 + e]
        step[r] = s
        inner[N + r] += scale * s
    for i in range(N):
        s = -store[i * 7 + 6]
        for e in range(6):
            s += store[i * 7 + e] * step[e]
        if heavy:
            for e in range(3):
                s += store[c0 + 6 + 3 * i + e] * store[o + 36 + e]
        inner[i] += scale * s
