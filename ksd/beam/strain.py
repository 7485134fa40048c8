"""The strain-mode leaf: one body per leaf, condensed to its end frames inside the same Newton step.

Unknowns of a leaf: amplitudes a of its curvature modes (nx torsion, ny strong, nz weak bending; 1/m) and lam = (n, m),
force and moment on end q (N, Nm). Curvature kappa_c = sum_i a_i B_i(s) over the modes of axis c; orientation
R' = R [kappa]x by a fourth-order Magnus step over every gap between quadrature points; r' = v = R (e1 + C R^T n) with
C = diag(1/EA, 1/kGA, 1/kGA), so stretch and shear are exact without unknowns. All vectors in the frame of end p.
Source: the stationary conditions of the mixed functional 1/2 a K a - 1/2 int n.(R C R^T n) + lam.closure. Interface of all
members: see `ksd.model.assembly`; constants: `ksd.beam.strain_values`.

A leaf with weight has line mass mu [kg/m] in gravity g [m/s^2], in frame p; its tables end with M(s) = int_s^L mu. Then
the force is n(s) = n + M g, the moment m(s) = m + int_s^L v x n(s), which by parts is m + (r(L) - r(s)) x n +
(h(L) - h(s)) x g with h = int M v; h(L) is the first moment of the mass about end p, and eta_i = int M rho_i' its
derivative by the amplitudes. `pull` holds g (`ksd.beam.weight`), and is empty for a leaf without weight.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ksd.beam.weight import PULL
from ksd.numerics.kernel import kernel
from ksd.numerics.local import local_matrix, local_vector
from ksd.numerics.rotations import rotation_exp, rotation_log

TINY_PIVOT = 1e-15


class Constants(NamedTuple):
    """The constants of a leaf by name, see `ksd.beam.strain_values`."""

    stiffness: np.ndarray
    rest: np.ndarray
    weight: np.ndarray
    integral: np.ndarray
    basis: np.ndarray
    soft: np.ndarray
    gap: np.ndarray
    pairs: np.ndarray
    beyond: np.ndarray


class Fields(NamedTuple):
    """A leaf at one inner state, at its ng quadrature points and, last, at end q.

    R (ng+1, 3, 3) orientation; v (ng, 3) = r'; S (ng, 3, 3) = R C R^T [1/N]; r (ng+1, 3) place [m]; m (ng, 3) moment [Nm];
    psi, rho, eta (ng+1, 3, N): rotation, displacement and first moment of the mass per unit amplitude, at fixed n; eta only
    with weight. W (N, N) tangent and g (N,) residual of the amplitudes; Y (N, 7) right-hand sides; slope (ng, 3, N) and
    turn (3, ng+1): scratch.
    """

    R: np.ndarray
    v: np.ndarray
    S: np.ndarray
    r: np.ndarray
    m: np.ndarray
    psi: np.ndarray
    rho: np.ndarray
    eta: np.ndarray
    W: np.ndarray
    g: np.ndarray
    Y: np.ndarray
    slope: np.ndarray
    turn: np.ndarray


@kernel
def constants_of(value, number):
    """`Constants` over the flat array."""
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    N = nx + ny + nz
    rest = 1 + nx * nx + ny * ny + nz * nz
    weight = rest + N
    integral = weight + ng
    basis = integral + ng * ng
    soft = basis + N * ng
    gap = soft + 3 * ng
    pairs = gap + N * (ng + 1)
    beyond = pairs + (ny * nz + nz * nx + nx * ny) * (ng + 1)
    return Constants(
        value[1:rest],
        value[rest:weight],
        value[weight:integral],
        value[integral:basis].reshape(ng, ng),
        value[basis:soft].reshape(N, ng),
        value[soft:gap].reshape(ng, 3),
        value[gap:pairs].reshape(N, ng + 1),
        value[pairs:beyond].reshape(ny * nz + nz * nx + nx * ny, ng + 1),
        value[beyond:],
    )


@kernel
def fields_of(number, scratch):
    """`Fields` over `strain_values.strain_scratch` numbers or more."""
    N, ng = number[0] + number[1] + number[2], number[3]
    v = 9 * (ng + 1)
    S = v + 3 * ng
    r = S + 9 * ng
    m = r + 3 * (ng + 1)
    psi = m + 3 * ng
    rho = psi + 3 * N * (ng + 1)
    eta = rho + 3 * N * (ng + 1)
    W = eta + 3 * N * (ng + 1)
    g = W + N * N
    Y = g + N
    slope = Y + 7 * N
    turn = slope + 3 * N * ng
    return Fields(
        scratch[:v].reshape(ng + 1, 3, 3),
        scratch[v:S].reshape(ng, 3),
        scratch[S:r].reshape(ng, 3, 3),
        scratch[r:m].reshape(ng + 1, 3),
        scratch[m:psi].reshape(ng, 3),
        scratch[psi:rho].reshape(ng + 1, 3, N),
        scratch[rho:eta].reshape(ng + 1, 3, N),
        scratch[eta:W].reshape(ng + 1, 3, N),
        scratch[W:g].reshape(N, N),
        scratch[g:Y],
        scratch[Y:slope].reshape(N, 7),
        scratch[slope:turn].reshape(ng, 3, N),
        scratch[turn : turn + 3 * (ng + 1)].reshape(3, ng + 1),
    )


@kernel
def _orientations(length, number, a, c, f):
    """R at the points and at end q: over every gap exp(int kappa + 1/2 iint_{s1<s2} kappa(s1) x kappa(s2))."""
    gaps, first, pair = number[3] + 1, 0, 0
    for axis in range(3):
        turn = f.turn[axis]
        for g in range(gaps):
            turn[g] = 0.0
        for i in range(first, first + number[axis]):
            for g in range(gaps):
                turn[g] += length * a[i] * c.gap[i, g]
        first += number[axis]
    # pairs of modes: y with z turn about x, z with x about y, x with y about z
    for axis in range(3):
        j, k = (axis + 1) % 3, (axis + 2) % 3
        one = 0 if j == 0 else (number[0] if j == 1 else number[0] + number[1])
        two = 0 if k == 0 else (number[0] if k == 1 else number[0] + number[1])
        for m in range(number[j]):
            for n in range(number[k]):
                w = 0.5 * length * length * a[one + m] * a[two + n]
                if w != 0.0:
                    for g in range(gaps):
                        f.turn[axis, g] += w * c.pairs[pair, g]
                pair += 1
    phi, E = local_vector(3), local_matrix(3, 3)
    for g in range(gaps):
        phi[0], phi[1], phi[2] = f.turn[0, g], f.turn[1, g], f.turn[2, g]
        R = f.R[g]
        if g == 0:
            rotation_exp(phi, R)
            continue
        rotation_exp(phi, E)
        for r in range(3):
            x, y, z = f.R[g - 1, r, 0], f.R[g - 1, r, 1], f.R[g - 1, r, 2]
            for e in range(3):
                R[r, e] = x * E[0, e] + y * E[1, e] + z * E[2, e]


@kernel
def _slopes(number, n, pull, c, f):
    """v = R (e1 + C R^T n(s)) and S = R C R^T at every point."""
    for g in range(number[3]):
        R, S = f.R[g], f.S[g]
        k0, k1, k2 = n[0], n[1], n[2]
        if len(pull) > 0:
            k0 += c.beyond[g] * pull[0]
            k1 += c.beyond[g] * pull[1]
            k2 += c.beyond[g] * pull[2]
        for i in range(3):
            for j in range(3):
                S[i, j] = (
                    c.soft[g, 0] * R[i, 0] * R[j, 0]
                    + c.soft[g, 1] * R[i, 1] * R[j, 1]
                    + c.soft[g, 2] * R[i, 2] * R[j, 2]
                )
            f.v[g, i] = R[i, 0] + S[i, 0] * k0 + S[i, 1] * k1 + S[i, 2] * k2


@kernel
def _integrate(length, c, slope, found):
    """found (ng+1, k) = length times the integral of slope (ng, k) from end p to every point and to end q."""
    ng, k = slope.shape
    for g in range(ng + 1):
        for e in range(k):
            found[g, e] = 0.0
        for h in range(ng):
            w = length * (c.integral[g, h] if g < ng else c.weight[h])
            for e in range(k):
                found[g, e] += w * slope[h, e]


@kernel
def _moments(length, number, n, m, pull, c, f):
    """r, and m(s) = m + (r(L) - r(s)) x n + (h(L) - h(s)) x g at every point."""
    ng = number[3]
    _integrate(length, c, f.v, f.r)
    heavy = len(pull) > 0
    for g in range(ng):
        x, y, z = f.r[ng, 0] - f.r[g, 0], f.r[ng, 1] - f.r[g, 1], f.r[ng, 2] - f.r[g, 2]
        f.m[g, 0] = m[0] + y * n[2] - z * n[1]
        f.m[g, 1] = m[1] + z * n[0] - x * n[2]
        f.m[g, 2] = m[2] + x * n[1] - y * n[0]
        if heavy:
            # h(L) - h(s)
            x, y, z = 0.0, 0.0, 0.0
            for h in range(ng):
                w = length * (c.weight[h] - c.integral[g, h]) * c.beyond[h]
                x += w * f.v[h, 0]
                y += w * f.v[h, 1]
                z += w * f.v[h, 2]
            f.m[g, 0] += y * pull[2] - z * pull[1]
            f.m[g, 1] += z * pull[0] - x * pull[2]
            f.m[g, 2] += x * pull[1] - y * pull[0]


@kernel
def _mode_fields(length, number, n, pull, c, f):
    """psi_i = int R e_c B_i, rho_i = int [psi_i x v - S (psi_i x n(s))], eta_i = int M rho_i'."""
    ng, N = number[3], f.psi.shape[2]
    heavy = len(pull) > 0
    slopes = f.slope.reshape(ng, 3 * N)
    for g in range(ng):
        first = 0
        for axis in range(3):
            for i in range(first, first + number[axis]):
                for r in range(3):
                    f.slope[g, r, i] = f.R[g, r, axis] * c.basis[i, g]
            first += number[axis]
    _integrate(length, c, slopes, f.psi.reshape(ng + 1, 3 * N))
    for g in range(ng):
        S, v, psi, slope = f.S[g], f.v[g], f.psi[g], f.slope[g]
        k0, k1, k2 = n[0], n[1], n[2]
        if heavy:
            k0 += c.beyond[g] * pull[0]
            k1 += c.beyond[g] * pull[1]
            k2 += c.beyond[g] * pull[2]
        for i in range(N):
            p0, p1, p2 = psi[0, i], psi[1, i], psi[2, i]
            q0, q1, q2 = p1 * k2 - p2 * k1, p2 * k0 - p0 * k2, p0 * k1 - p1 * k0
            slope[0, i] = p1 * v[2] - p2 * v[1] - S[0, 0] * q0 - S[0, 1] * q1 - S[0, 2] * q2
            slope[1, i] = p2 * v[0] - p0 * v[2] - S[1, 0] * q0 - S[1, 1] * q1 - S[1, 2] * q2
            slope[2, i] = p0 * v[1] - p1 * v[0] - S[2, 0] * q0 - S[2, 1] * q1 - S[2, 2] * q2
    _integrate(length, c, slopes, f.rho.reshape(ng + 1, 3 * N))
    if heavy:
        for g in range(ng):
            for e in range(3 * N):
                slopes[g, e] *= c.beyond[g]
        _integrate(length, c, slopes, f.eta.reshape(ng + 1, 3 * N))


@kernel
def _fields(value, number, inner, pull, c, f):
    """See `strain_fields`."""
    N = number[0] + number[1] + number[2]
    n = inner[N : N + 3]
    _orientations(value[0], number, inner, c, f)
    _slopes(number, n, pull, c, f)
    _moments(value[0], number, n, inner[N + 3 : N + 6], pull, c, f)
    _mode_fields(value[0], number, n, pull, c, f)


@kernel
def strain_fields(value, number, inner, pull, scratch):
    """`Fields` of a leaf with inner state `inner` = (a (N,), n (3,), m (3,)) into scratch, without W, g and Y."""
    _fields(value, number, inner, pull, constants_of(value, number), fields_of(number, scratch))


@kernel
def _tangent(value, number, inner, pull, c, f):
    """See `strain_tangent`."""
    N, ng, length = number[0] + number[1] + number[2], number[3], value[0]
    n = inner[N : N + 3]
    heavy = len(pull) > 0
    W, X = f.W, f.slope[0]
    for i in range(N):
        f.g[i] = 0.0
        for j in range(N):
            W[i, j] = 0.0
    for g in range(ng):
        R, m, w = f.R[g], f.m[g], length * c.weight[g]
        psi, rho, eta = f.psi[g], f.rho[g], f.eta[g]
        for i in range(N):
            p0, p1, p2 = psi[0, i], psi[1, i], psi[2, i]
            d0, d1, d2 = f.rho[ng, 0, i] - rho[0, i], f.rho[ng, 1, i] - rho[1, i], f.rho[ng, 2, i] - rho[2, i]
            x = m[1] * p2 - m[2] * p1 + d1 * n[2] - d2 * n[1]
            y = m[2] * p0 - m[0] * p2 + d2 * n[0] - d0 * n[2]
            z = m[0] * p1 - m[1] * p0 + d0 * n[1] - d1 * n[0]
            if heavy:
                d0, d1, d2 = (
                    f.eta[ng, 0, i] - eta[0, i],
                    f.eta[ng, 1, i] - eta[1, i],
                    f.eta[ng, 2, i] - eta[2, i],
                )
                x += d1 * pull[2] - d2 * pull[1]
                y += d2 * pull[0] - d0 * pull[2]
                z += d0 * pull[1] - d1 * pull[0]
            for axis in range(3):
                X[axis, i] = w * (R[0, axis] * x + R[1, axis] * y + R[2, axis] * z)
        first = 0
        for axis in range(3):
            work = w * (R[0, axis] * m[0] + R[1, axis] * m[1] + R[2, axis] * m[2])
            for j in range(first, first + number[axis]):
                b = c.basis[j, g]
                f.g[j] -= b * work
                for i in range(N):
                    W[j, i] -= b * X[axis, i]
            first += number[axis]
    for i in range(N):
        for j in range(i):
            W[i, j] = W[j, i] = 0.5 * (W[i, j] + W[j, i])
    first, at = 0, 0
    for axis in range(3):
        count = number[axis]
        for i in range(count):
            for j in range(count):
                k = c.stiffness[at + i * count + j]
                W[first + i, first + j] += k
                f.g[first + i] += k * (inner[first + j] - c.rest[first + j])
        first += count
        at += count * count


@kernel
def strain_tangent(value, number, inner, pull, scratch):
    """W and g of the amplitudes at fixed end wrench and gravity, into scratch as left by `strain_fields`:

    g_i = K (a - a0) - L sum w B_i (R e_c).m
    W_ij = K - sym L sum w B_j (R e_cj).[m x psi_i + (rho_i(L) - rho_i) x n + (eta_i(L) - eta_i) x g]
    """
    _tangent(value, number, inner, pull, constants_of(value, number), fields_of(number, scratch))


@kernel
def _solve_modes(W, Y, before):
    """Y (N, k) <- W^-1 Y by LDL^T in place of W, whose diagonal is put into before (N,): L below the diagonal, D on it.

    Returns (negative pivots, 2 where one had to be replaced, else 0).
    """
    N, k = Y.shape
    negatives, status = 0, 0
    for j in range(N):
        before[j] = abs(W[j, j])
    for j in range(N):
        pivot = W[j, j]
        if not abs(pivot) > TINY_PIVOT * before[j]:
            status = 2
            pivot = TINY_PIVOT * before[j] + 1e-300
            W[j, j] = pivot
        negatives += pivot < 0.0
        for i in range(j + 1, N):
            l = W[j, i] / pivot
            for c in range(i, N):
                W[i, c] -= l * W[j, c]
            for e in range(k):
                Y[i, e] -= l * Y[j, e]
            W[i, j] = l
    for j in range(N - 1, -1, -1):
        for e in range(k):
            Y[j, e] /= W[j, j]
        for c in range(j + 1, N):
            l = W[c, j]
            for e in range(k):
                Y[j, e] -= l * Y[c, e]
    return negatives, status


@kernel
def _substitute(W, Y):
    """Y (N, k) <- W^-1 Y, W factored by `_solve_modes`."""
    N, k = Y.shape
    for j in range(N):
        for c in range(j):
            w = W[j, c]
            for e in range(k):
                Y[j, e] -= w * Y[c, e]
    for j in range(N - 1, -1, -1):
        for e in range(k):
            Y[j, e] /= W[j, j]
        for c in range(j + 1, N):
            w = W[c, j]
            for e in range(k):
                Y[j, e] -= w * Y[c, e]


@kernel
def _invert6(F, K):
    """K (6, 6) = F^-1 for symmetric F (6, 6) by sweeping pivot after pivot; returns (negative pivots, ok)."""
    negatives = 0
    row = local_vector(6)
    for i in range(6):
        for j in range(6):
            K[i, j] = F[i, j]
    for k in range(6):
        pivot = K[k, k]
        if not abs(pivot) > 1e-18 * abs(F[k, k]):
            return negatives, False
        if pivot < 0.0:
            negatives += 1
        for j in range(6):
            row[j] = K[k, j] / pivot
        for i in range(6):
            w = K[i, k]
            for j in range(6):
                K[i, j] -= w * row[j]
        for j in range(6):
            K[k, j] = row[j]
            K[j, k] = row[j]
        K[k, k] = -1.0 / pivot
    for i in range(6):
        for j in range(6):
            K[i, j] = -K[i, j]
    return negatives, True


@kernel
def _follow_gravity(length, number, pull, c, f, K, step, X):
    """The pull (39,) of a leaf with weight, see `ksd.beam.weight`; X (N, 3) = W^-1 eta(L)^T is kept for `strain_recover`.

    With B = int M S and Z = J X + B (force rows): V_xi,g = -K Z, V_g,g = Z^T K Z - eta X - int M^2 S, and the
    first moment int M v is predicted with the step of the wrench, step = K (c + J W^-1 g).
    """
    N, ng = number[0] + number[1] + number[2], number[3]
    Z, G = local_matrix(6, 3), local_matrix(3, 3)
    for e in range(3):
        pull[3 + e] = 0.0
        for r in range(3):
            Z[r, e], Z[3 + r, e], G[r, e] = 0.0, 0.0, 0.0
    for g in range(ng):
        w = length * c.weight[g] * c.beyond[g]
        for r in range(3):
            pull[3 + r] += w * f.v[g, r]
            for e in range(3):
                Z[r, e] += w * f.S[g, r, e]
                G[r, e] += w * c.beyond[g] * f.S[g, r, e]
    for i in range(N):
        for e in range(3):
            X[i, e] = f.eta[ng, e, i]
    _substitute(f.W, X)
    for e in range(3):
        pull[6 + e] = pull[3 + e]
        for i in range(N):
            pull[3 + e] -= f.eta[ng, e, i] * f.Y[i, 6]
            for r in range(3):
                Z[r, e] += f.rho[ng, r, i] * X[i, e]
                Z[3 + r, e] += f.psi[ng, r, i] * X[i, e]
                G[r, e] += f.eta[ng, r, i] * X[i, e]
    for e in range(3):
        for r in range(6):
            pull[3 + e] += Z[r, e] * step[r]
            s = 0.0
            for k in range(6):
                s -= K[r, k] * Z[k, e]
            pull[9 + 3 * r + e] = s
    for r in range(3):
        for e in range(3):
            s = -G[r, e]
            for k in range(6):
                s -= Z[k, r] * pull[9 + 3 * k + e]
            pull[27 + 3 * r + e] = s


@kernel
def strain_condense(value, number, inner, store, scratch, d, Q, lam, K):
    """Condense one leaf at end pose d (3,) [m], Q (3, 3); see the module docstring for the equations.

    inner = (a (N,), lam (6,)). Writes lam[0:6] condensed end wrench, lam[6:12] the wrench the geometric terms
    use (the one before this step), K (6, 6). store keeps W^-1 J^T and W^-1 g (N, 8, the last a spare), K (6, 6) and
    c + J W^-1 g (6,); a leaf with weight also W^-1 eta(L)^T (N, 3) and its pull (see `ksd.beam.weight`).
    scratch: `strain_values.strain_scratch` numbers or more, left undefined.
    Returns (negative pivots of W minus those of F, |change of n| [N], |change of m| [Nm], status).
    """
    N, ng = number[0] + number[1] + number[2], number[3]
    tail = N * 8
    gap = store[tail + 36 : tail + 42]
    heavy = len(store) > tail + 42
    pull = store[len(store) - PULL if heavy else len(store) :]
    c, f = constants_of(value, number), fields_of(number, scratch)
    _fields(value, number, inner, pull, c, f)
    _tangent(value, number, inner, pull, c, f)
    # Y = W^-1 [J^T, g], seven right-hand sides at once; J = (rho(L), psi(L))
    for i in range(N):
        for r in range(3):
            f.Y[i, r], f.Y[i, 3 + r] = f.rho[ng, r, i], f.psi[ng, r, i]
        f.Y[i, 6] = f.g[i]
    negatives, status = _solve_modes(f.W, f.Y, f.g)
    # F = J W^-1 J^T + L sum w S (force block);  gap = closure + J W^-1 g
    F, turned, twist = local_matrix(6, 6), local_matrix(3, 3), local_vector(3)
    end = f.R[ng]
    for i in range(3):
        for j in range(3):
            turned[i, j] = Q[i, 0] * end[j, 0] + Q[i, 1] * end[j, 1] + Q[i, 2] * end[j, 2]
    rotation_log(turned, twist)
    for r in range(6):
        gap[r] = d[r] - f.r[ng, r] if r < 3 else twist[r - 3]
        for e in range(6):
            F[r, e] = 0.0
    for i in range(N):
        for r in range(6):
            j = f.rho[ng, r, i] if r < 3 else f.psi[ng, r - 3, i]
            gap[r] += j * f.Y[i, 6]
            for e in range(6):
                F[r, e] += j * f.Y[i, e]
            store[8 * i + r] = f.Y[i, r]
        store[8 * i + 6] = f.Y[i, 6]
    for g in range(ng):
        w = value[0] * c.weight[g]
        for i in range(3):
            for j in range(3):
                F[i, j] += w * f.S[g, i, j]
    for r in range(6):
        for e in range(r):
            F[r, e] = F[e, r] = 0.5 * (F[r, e] + F[e, r])
    back, fine = _invert6(F, K)
    if not fine:
        status = 2
    dn, dm = 0.0, 0.0
    change = local_vector(6)
    for r in range(6):
        s = 0.0
        for e in range(6):
            store[tail + r * 6 + e] = K[r, e]
            s += K[r, e] * gap[e]
        change[r] = s
        lam[r], lam[6 + r] = inner[N + r] + s, inner[N + r]
        if r < 3:
            dn += s * s
        else:
            dm += s * s
    if heavy:
        X = store[tail + 42 : tail + 42 + 3 * N].reshape(N, 3)
        _follow_gravity(value[0], number, pull, c, f, K, change, X)
    if not math.isfinite(dn + dm):
        status = 2
    return negatives - back, math.sqrt(dn), math.sqrt(dm), status


@kernel
def strain_recover(value, number, inner, store, xi, scale):
    """dlam = K (xi + gap), da = W^-1 (J^T dlam - g), both times `scale`, added to the inner state.

    A leaf with weight follows the change of gravity in frame p, the last three numbers of its pull.
    """
    N = number[0] + number[1] + number[2]
    tail = N * 8
    gap = tail + 36
    heavy = len(store) > tail + 42
    o = len(store) - PULL
    step = local_vector(6)
    for r in range(6):
        s = 0.0
        for e in range(6):
            s += store[tail + r * 6 + e] * (xi[e] + store[gap + e])
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
                s += store[gap + 6 + 3 * i + e] * store[o + 36 + e]
        inner[i] += scale * s
