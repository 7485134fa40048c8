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

from ksd.beam.strain_fields import strain_fields, strain_tangent
from ksd.beam.strain_points import places, tables
from ksd.beam.weight import PULL
from ksd.numerics.kernel import kernel
from ksd.numerics.lanes import load4, spread, store4, transpose4
from ksd.numerics.local import local_matrix, local_vector
from ksd.numerics.rotations import rotation_log
from ksd.numerics.sums import weighted_rows
from ksd.numerics.views import matrix_at


@kernel(forceinline=True)
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


@kernel(forceinline=True)
def _pivot(x, before):
    """(1 / pivot, 1 if negative, 2 where it had to be replaced else 0), for one that was `before` at first."""
    status = 0
    if not abs(x) > 1e-15 * abs(before):
        status = 2
        x = 1e-15 * abs(before) + 1e-300
    return 1.0 / x, x < 0.0, status


@kernel(fastmath={"contract"}, forceinline=True)
def _factor(M, number, scratch, W, t):
    """W = U^T D U by fours of rows, and Y = W^-1 Y for the 8 columns beside it: W (M, M + 8) keeps D U in its upper
    triangle; t (M + 1, M + 8) gets U with the new Y beside it, and 1/D as its last row.

    Returns (negative pivots, 2 where one had to be replaced, else 0).
    """
    wide = M + 8
    negatives, status, inverse = 0, 0, t + wide * M
    for p in range(0, M, 4):
        o = W + (wide + 1) * p
        w0, w1, w2, w3 = (
            scratch[o],
            scratch[o + wide + 1],
            scratch[o + 2 * wide + 2],
            scratch[o + 3 * wide + 3],
        )
        if p > 0:
            weighted_rows(
                number, scratch, o, scratch, W + p, scratch, t + p, 0, wide, 0, 1, wide, 0, wide, 1, 4, p, wide - p,
                -1.0, True,
            )  # fmt: skip
        # the four rows among themselves: pivots and U between them
        i0, n0, s0 = _pivot(scratch[o], w0)
        a1, a2, a3 = scratch[o + 1], scratch[o + 2], scratch[o + 3]
        l1, l2, l3 = a1 * i0, a2 * i0, a3 * i0
        o += wide
        i1, n1, s1 = _pivot(scratch[o + 1] - l1 * a1, w1)
        b2, b3 = scratch[o + 2] - l1 * a2, scratch[o + 3] - l1 * a3
        k2, k3 = b2 * i1, b3 * i1
        o += wide
        i2, n2, s2 = _pivot(scratch[o + 2] - l2 * a2 - k2 * b2, w2)
        c3 = scratch[o + 3] - l2 * a3 - k2 * b3
        j3 = c3 * i2
        i3, n3, s3 = _pivot(scratch[o + wide + 3] - l3 * a3 - k3 * b3 - j3 * c3, w3)
        negatives += n0 + n1 + n2 + n3
        status = max(status, s0, s1, s2, s3)
        scratch[inverse + p], scratch[inverse + p + 1] = i0, i1
        scratch[inverse + p + 2], scratch[inverse + p + 3] = i2, i3
        for c in range(p, wide, 4):
            o, q = W + wide * p + c, t + wide * p + c
            r0 = load4(scratch, o)
            r1 = load4(scratch, o + wide) - l1 * r0
            r2 = load4(scratch, o + 2 * wide) - l2 * r0 - k2 * r1
            r3 = load4(scratch, o + 3 * wide) - l3 * r0 - k3 * r1 - j3 * r2
            store4(scratch, o + wide, r1)
            store4(scratch, o + 2 * wide, r2)
            store4(scratch, o + 3 * wide, r3)
            store4(scratch, q, i0 * r0)
            store4(scratch, q + wide, i1 * r1)
            store4(scratch, q + 2 * wide, i2 * r2)
            store4(scratch, q + 3 * wide, i3 * r3)
    for p in range(M - 4, -1, -4):
        o = t + wide * p
        y = o + M
        weighted_rows(
            number, scratch, y, scratch, o + p + 4, scratch, y + 4 * wide, 0, wide, 0, wide, 1, 0, wide, 1, 4,
            M - p - 4, 8, -1.0, True,
        )  # fmt: skip
        o += p
        l1, l2, l3 = scratch[o + 1], scratch[o + 2], scratch[o + 3]
        k2, k3, j3 = scratch[o + wide + 2], scratch[o + wide + 3], scratch[o + 2 * wide + 3]
        for c in range(y, y + 8, 4):
            r3 = load4(scratch, c + 3 * wide)
            r2 = load4(scratch, c + 2 * wide) - j3 * r3
            r1 = load4(scratch, c + wide) - k2 * r2 - k3 * r3
            store4(scratch, c + 2 * wide, r2)
            store4(scratch, c + wide, r1)
            store4(scratch, c, load4(scratch, c) - l1 * r1 - l2 * r2 - l3 * r3)
    return negatives, status


@kernel
def _solve_more(N, M, scratch, t, X):
    """X (N, 3) = W^-1 X with t as `_factor` leaves it."""
    wide = M + 8
    for i in range(N):
        for j in range(i):
            for c in range(3):
                X[i, c] -= scratch[t + wide * j + i] * X[j, c]
    for i in range(N - 1, -1, -1):
        for c in range(3):
            X[i, c] *= scratch[t + wide * M + i]
        for k in range(i + 1, N):
            for c in range(3):
                X[i, c] -= scratch[t + wide * i + k] * X[k, c]


@kernel
def _add_flexibility(w, scratch, S, lanes, A):
    """A (3, 3) += w S, S: place of a symmetric matrix as xx, xy, xz, yy, yz, zz, `lanes` apart."""
    first = 0
    for i in range(3):
        for j in range(i, 3):
            x = w * scratch[S + lanes * (first + j)]
            A[i, j] += x
            if i != j:
                A[j, i] += x
        first += 2 - i


@kernel
def _follow_gravity(value, number, pull, scratch, K, step, X):
    """The pull (39,) of a leaf with weight, see `ksd.beam.weight`; X (N, 3) = W^-1 eta(L)^T is kept for `strain_recover`.

    With B = int M S and Z = J X + B (force rows): V_xi,g = -K Z, V_g,g = Z^T K Z - eta X - int M^2 S, and the
    first moment int M v is predicted with the step of the wrench, step = K (c + J W^-1 g).
    """
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    N = nx + ny + nz
    L = value[0]
    M, lanes = (N + 3) & -4, (ng + 4) & -4
    of, at = tables(nx, ny, nz, ng), places(N, ng)
    weight, beyond = of.weight, of.beyond
    v, S, eta = at.v, at.S, at.eta + 3 * M * ng
    rho = at.fields + 6 * M * ng
    Z, G = local_matrix(6, 3), local_matrix(3, 3)
    for c in range(3):
        pull[3 + c] = 0.0
        for r in range(3):
            Z[r, c] = Z[3 + r, c] = G[r, c] = 0.0
    for g in range(ng):
        w = L * value[weight + g] * value[beyond + g]
        for c in range(3):
            pull[3 + c] += w * scratch[v + lanes * c + g]
        _add_flexibility(w, scratch, S + g, lanes, Z)
        _add_flexibility(w * value[beyond + g], scratch, S + g, lanes, G)
    for i in range(N):
        for c in range(3):
            X[i, c] = scratch[eta + M * c + i]
    _solve_more(N, M, scratch, at.t, X)
    for c in range(3):
        pull[6 + c] = pull[3 + c]
        for i in range(N):
            pull[3 + c] -= scratch[eta + M * c + i] * scratch[at.t + (M + 8) * i + M + 6]
            for r in range(3):
                Z[r, c] += scratch[rho + M * r + i] * X[i, c]
                Z[3 + r, c] += scratch[rho + M * (3 + r) + i] * X[i, c]
                G[r, c] += scratch[eta + M * r + i] * X[i, c]
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
    use (the one before this step), K (6, 6). store keeps W^-1 J^T, W^-1 g and a spare number (N, 8), K (6, 6) and
    c + J W^-1 g (6,); a leaf with weight also W^-1 eta(L)^T (N, 3) and its pull (see `ksd.beam.weight`).
    scratch: `strain_values.strain_scratch` numbers or more, left undefined.
    Returns (negative pivots of W minus those of F, |change of n| [N], |change of m| [Nm], status).
    """
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    N = nx + ny + nz
    M, lanes = (N + 3) & -4, (ng + 4) & -4
    L, weight = value[0], tables(nx, ny, nz, ng).weight
    tail = N * 8
    c0 = tail + 36
    heavy = len(store) > tail + 42
    pull = store[len(store) - PULL if heavy else len(store) :]
    at = places(N, ng)
    W, f, wide = at.W, at.f, M + 8
    end, Y = at.fields + 6 * M * ng, at.t + M
    strain_fields(value, number, inner, pull, scratch)
    strain_tangent(value, number, inner, pull, scratch)
    # Y = W^-1 [J^T, g], seven right-hand sides at once; J = (rho(L), psi(L))
    for i in range(0, M, 4):
        o, p = W + wide * i + M, end + i
        a, b, c, e = transpose4(
            load4(scratch, p), load4(scratch, p + M), load4(scratch, p + 2 * M), load4(scratch, p + 3 * M)
        )
        p += 4 * M
        a4, b4, c4, e4 = transpose4(
            load4(scratch, p), load4(scratch, p + M), load4(scratch, at.t + i), spread(0.0)
        )
        store4(scratch, o, a)
        store4(scratch, o + 4, a4)
        store4(scratch, o + wide, b)
        store4(scratch, o + wide + 4, b4)
        store4(scratch, o + 2 * wide, c)
        store4(scratch, o + 2 * wide + 4, c4)
        store4(scratch, o + 3 * wide, e)
        store4(scratch, o + 3 * wide + 4, e4)
    negatives, status = _factor(M, number, scratch, W, at.t)
    # F = J W^-1 J^T + L sum w S (force block);  c = closure + J W^-1 g
    weighted_rows(
        number, scratch, f, scratch, end, scratch, Y, 0, 8, 0, M, 1, 0, wide, 1, 6, N, 8, 1.0, False,
    )  # fmt: skip
    F = matrix_at(scratch, f, 6, 8)
    first = 0
    for i in range(3):
        for j in range(i, 3):
            x = 0.0
            for g in range(ng):
                x += value[weight + g] * scratch[at.S + lanes * (first + j) + g]
            F[i, j] += L * x
            if i != j:
                F[j, i] += L * x
        first += 2 - i
    gap, step = local_vector(3), local_matrix(3, 3)
    for j in range(3):
        o = at.R + ng + 3 * lanes * j
        x, y, z = scratch[o], scratch[o + lanes], scratch[o + 2 * lanes]
        for i in range(3):
            step[i, j] = Q[i, 0] * x + Q[i, 1] * y + Q[i, 2] * z
    rotation_log(step, gap)
    back, fine = _invert6(F, K)
    if not fine:
        status = 2
    for r in range(3):
        store[c0 + r] = d[r] - scratch[at.r + lanes * r + ng] + F[r, 6]
        store[c0 + 3 + r] = gap[r] + F[3 + r, 6]
    for i in range(N):
        store4(store, 8 * i, load4(scratch, Y + wide * i))
        store4(store, 8 * i + 4, load4(scratch, Y + wide * i + 4))
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
        X = matrix_at(store, tail + 42, N, 3)
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
    tail = N * 8
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
        s = -store[i * 8 + 6]
        for e in range(6):
            s += store[i * 8 + e] * step[e]
        if heavy:
            for e in range(3):
                s += store[c0 + 6 + 3 * i + e] * store[o + 36 + e]
        inner[i] += scale * s
