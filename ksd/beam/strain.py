"""The strain-mode leaf: one body per leaf, condensed to its end frames inside the same Newton step.

Unknowns of a leaf: amplitudes a of its curvature modes (nx torsion, ny strong, nz weak bending; 1/m) and lam = (n, m),
force and moment on end q (N, Nm). Curvature kappa_c = sum_i a_i B_i(s) over the modes of axis c; orientation
R' = R [kappa]x by a fourth-order Magnus step over every gap between quadrature points; r' = v = R (e1 + C R^T n) with
C = diag(1/EA, 1/kGA, 1/kGA), so stretch and shear are exact without unknowns. All vectors in the frame of end p.
Interface of all members: see `ksd.model.assembly`; constants: `ksd.beam.strain_values`.

Source: the stationary conditions of the mixed functional 1/2 (a - a0) K (a - a0) - H + lam.closure, with the sum over the
quadrature points H = L sum w (n.R e1 + 1/2 n.R C R^T n). Residual and tangent are the derivatives of that very sum, by the
chain of the Magnus steps, so that the tangent is symmetric and exact however few the points. Then the end of the leaf is
r(L) = dH/dn, and by partial summation the residual has at every gap the moment m + sum over the points behind it of
L w v x n, for the m + (r(L) - r(s)) x n of the rod.

A leaf with weight has line mass mu [kg/m] in gravity g [m/s^2], in frame p; its tables end with M(s) = int_s^L mu. Then
the force is n(s) = n + M g. dH/dg = int M v is the first moment of the mass about end p, and eta_i its derivative by the
amplitudes. `pull` holds g (`ksd.beam.weight`), and is empty for a leaf without weight.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ksd.beam.weight import PULL
from ksd.numerics.kernel import kernel
from ksd.numerics.local import local_matrix, local_vector
from ksd.numerics.rotations import rotation_log, tangent_factors

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
    """A leaf at one inner state, at its ng quadrature points and, last, at end q; gap h ends at point h.

    turn (ng+1, 3), rate (ng+1, 3, N): rotation vector of every gap, in the frame of the point before it, and its derivative
    by the amplitudes; carry (ng+1, 3, 3): from that derivative to the rotation of all behind; R (ng+1, 3, 3): orientation;
    psi (ng+1, 3, N): rotation by the amplitudes. n (ng, 3): force; v (ng, 3) = r'; S (ng, 3, 3) = R C R^T [1/N]; slope
    (ng, 3, N): v by the amplitudes, at fixed n. end (3,) [m]: place of end q; rho, eta (3, N): that place, and the first
    moment of the mass, by the amplitudes; eta only with weight. W (N, N) tangent and g (N,) residual of the amplitudes;
    Y (N, 7) right-hand sides; moment (3, ng+1) [Nm]: on the turns; X, Z (3, N): scratch.
    """

    turn: np.ndarray
    rate: np.ndarray
    carry: np.ndarray
    R: np.ndarray
    psi: np.ndarray
    n: np.ndarray
    v: np.ndarray
    S: np.ndarray
    slope: np.ndarray
    end: np.ndarray
    rho: np.ndarray
    eta: np.ndarray
    W: np.ndarray
    g: np.ndarray
    Y: np.ndarray
    X: np.ndarray
    Z: np.ndarray
    moment: np.ndarray


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
    rate = 3 * (ng + 1)
    carry = rate + 3 * N * (ng + 1)
    R = carry + 9 * (ng + 1)
    psi = R + 9 * (ng + 1)
    n = psi + 3 * N * (ng + 1)
    v = n + 3 * ng
    S = v + 3 * ng
    slope = S + 9 * ng
    end = slope + 3 * N * ng
    rho = end + 3
    eta = rho + 3 * N
    W = eta + 3 * N
    g = W + N * N
    Y = g + N
    X = Y + 7 * N
    Z = X + 3 * N
    moment = Z + 3 * N
    return Fields(
        scratch[:rate].reshape(ng + 1, 3),
        scratch[rate:carry].reshape(ng + 1, 3, N),
        scratch[carry:R].reshape(ng + 1, 3, 3),
        scratch[R:psi].reshape(ng + 1, 3, 3),
        scratch[psi:n].reshape(ng + 1, 3, N),
        scratch[n:v].reshape(ng, 3),
        scratch[v:S].reshape(ng, 3),
        scratch[S:slope].reshape(ng, 3, 3),
        scratch[slope:end].reshape(ng, 3, N),
        scratch[end:rho],
        scratch[rho:eta].reshape(3, N),
        scratch[eta:W].reshape(3, N),
        scratch[W:g].reshape(N, N),
        scratch[g:Y],
        scratch[Y:X].reshape(N, 7),
        scratch[X:Z].reshape(3, N),
        scratch[Z:moment].reshape(3, N),
        scratch[moment : moment + 3 * (ng + 1)].reshape(3, ng + 1),
    )


@kernel
def _turns(length, number, a, c, f):
    """Rotation vector of every gap, int kappa + 1/2 iint_{s1<s2} kappa(s1) x kappa(s2), and its rates."""
    gaps, first, pair = number[3] + 1, 0, 0
    for g in range(gaps):
        for axis in range(3):
            f.turn[g, axis] = 0.0
            for i in range(len(a)):
                f.rate[g, axis, i] = 0.0
    for axis in range(3):
        for i in range(first, first + number[axis]):
            for g in range(gaps):
                w = length * c.gap[i, g]
                f.rate[g, axis, i] = w
                f.turn[g, axis] += a[i] * w
        first += number[axis]
    # pairs of modes: y with z turn about x, z with x about y, x with y about z
    for axis in range(3):
        j, k = (axis + 1) % 3, (axis + 2) % 3
        one = 0 if j == 0 else (number[0] if j == 1 else number[0] + number[1])
        two = 0 if k == 0 else (number[0] if k == 1 else number[0] + number[1])
        for i in range(one, one + number[j]):
            for l in range(two, two + number[k]):
                for g in range(gaps):
                    w = 0.5 * length * length * c.pairs[pair, g]
                    f.rate[g, axis, i] += w * a[l]
                    f.rate[g, axis, l] += w * a[i]
                    f.turn[g, axis] += w * a[i] * a[l]
                pair += 1


@kernel
def _orientations(number, f):
    """R and psi at the points and at end q, from the turn of every gap: R <- R exp(turn), psi <- psi + R T(turn) rate with
    the tangent T of the exponential, `carry` = R T, and exp(turn) = I + T [turn]x."""
    for g in range(number[3] + 1):
        x, y, z = f.turn[g, 0], f.turn[g, 1], f.turn[g, 2]
        b, c, _, _ = tangent_factors(x * x + y * y + z * z)
        carry, rate, psi = f.carry[g], f.rate[g], f.psi[g]
        for r in range(3):
            if g > 0:
                p, q, s = f.R[g - 1, r, 0], f.R[g - 1, r, 1], f.R[g - 1, r, 2]
            else:
                p, q, s = 1.0 * (r == 0), 1.0 * (r == 1), 1.0 * (r == 2)
            # row x turn, and once more
            p1, q1, s1 = q * z - s * y, s * x - p * z, p * y - q * x
            p2, q2, s2 = q1 * z - s1 * y, s1 * x - p1 * z, p1 * y - q1 * x
            u, v, w = p + b * p1 + c * p2, q + b * q1 + c * q2, s + b * s1 + c * s2
            carry[r, 0], carry[r, 1], carry[r, 2] = u, v, w
            f.R[g, r, 0], f.R[g, r, 1], f.R[g, r, 2] = p + v * z - w * y, q + w * x - u * z, s + u * y - v * x
            for i in range(psi.shape[1]):
                t = u * rate[0, i] + v * rate[1, i] + w * rate[2, i]
                psi[r, i] = t + f.psi[g - 1, r, i] if g > 0 else t


@kernel
def _slopes(length, number, n, pull, c, f):
    """n(s), v = R (e1 + C R^T n(s)), S = R C R^T and slope = psi x v - S (psi x n(s)) at every point; end, rho and eta."""
    N, heavy = f.psi.shape[2], len(pull) > 0
    for r in range(3):
        f.end[r] = 0.0
        for i in range(N):
            f.rho[r, i], f.eta[r, i] = 0.0, 0.0
    for g in range(number[3]):
        R, S, v, psi, slope, k = f.R[g], f.S[g], f.v[g], f.psi[g], f.slope[g], f.n[g]
        w = length * c.weight[g]
        for r in range(3):
            k[r] = n[r] + c.beyond[g] * pull[r] if heavy else n[r]
        for i in range(3):
            for j in range(3):
                S[i, j] = (
                    c.soft[g, 0] * R[i, 0] * R[j, 0]
                    + c.soft[g, 1] * R[i, 1] * R[j, 1]
                    + c.soft[g, 2] * R[i, 2] * R[j, 2]
                )
            v[i] = R[i, 0] + S[i, 0] * k[0] + S[i, 1] * k[1] + S[i, 2] * k[2]
            f.end[i] += w * v[i]
        for i in range(N):
            p0, p1, p2 = psi[0, i], psi[1, i], psi[2, i]
            q0, q1, q2 = p1 * k[2] - p2 * k[1], p2 * k[0] - p0 * k[2], p0 * k[1] - p1 * k[0]
            slope[0, i] = p1 * v[2] - p2 * v[1] - S[0, 0] * q0 - S[0, 1] * q1 - S[0, 2] * q2
            slope[1, i] = p2 * v[0] - p0 * v[2] - S[1, 0] * q0 - S[1, 1] * q1 - S[1, 2] * q2
            slope[2, i] = p0 * v[1] - p1 * v[0] - S[2, 0] * q0 - S[2, 1] * q1 - S[2, 2] * q2
        for r in range(3):
            for i in range(N):
                f.rho[r, i] += w * slope[r, i]
                if heavy:
                    f.eta[r, i] += w * c.beyond[g] * slope[r, i]


@kernel
def _fields(value, number, inner, pull, c, f):
    """See `strain_fields`."""
    N = number[0] + number[1] + number[2]
    _turns(value[0], number, inner[:N], c, f)
    _orientations(number, f)
    _slopes(value[0], number, inner[N : N + 3], pull, c, f)


@kernel
def strain_fields(value, number, inner, pull, scratch):
    """`Fields` of a leaf with inner state `inner` = (a (N,), n (3,), m (3,)) into scratch, without W, g and Y."""
    _fields(value, number, inner, pull, constants_of(value, number), fields_of(number, scratch))


@kernel
def _tangent(value, number, inner, c, f):
    """See `strain_tangent`. From end q back: M, the moment a gap carries, and X, its derivative by the amplitudes."""
    N, ng, length = number[0] + number[1] + number[2], number[3], value[0]
    W, X, Z = f.W, f.X, f.Z
    M0, M1, M2 = inner[N + 3], inner[N + 4], inner[N + 5]
    for i in range(N):
        # a moment fixed in space is no gradient: half of what turns with the end makes W its symmetric part
        p0, p1, p2 = 0.5 * f.psi[ng, 0, i], 0.5 * f.psi[ng, 1, i], 0.5 * f.psi[ng, 2, i]
        X[0, i], X[1, i], X[2, i] = M2 * p1 - M1 * p2, M0 * p2 - M2 * p0, M1 * p0 - M0 * p1
        f.g[i] = 0.0
        for j in range(i + 1):
            W[i, j] = 0.0
    for h in range(ng, -1, -1):
        if h < ng:
            w, v, slope = length * c.weight[h], f.v[h], f.slope[h]
            k0, k1, k2 = w * f.n[h, 0], w * f.n[h, 1], w * f.n[h, 2]
            M0, M1, M2 = M0 + v[1] * k2 - v[2] * k1, M1 + v[2] * k0 - v[0] * k2, M2 + v[0] * k1 - v[1] * k0
            for i in range(N):
                X[0, i] += slope[1, i] * k2 - slope[2, i] * k1
                X[1, i] += slope[2, i] * k0 - slope[0, i] * k2
                X[2, i] += slope[0, i] * k1 - slope[1, i] * k0
        rate, T, x, y, z = f.rate[h], f.carry[h], f.turn[h, 0], f.turn[h, 1], f.turn[h, 2]
        u0 = T[0, 0] * M0 + T[1, 0] * M1 + T[2, 0] * M2
        u1 = T[0, 1] * M0 + T[1, 1] * M1 + T[2, 1] * M2
        u2 = T[0, 2] * M0 + T[1, 2] * M1 + T[2, 2] * M2
        f.moment[0, h], f.moment[1, h], f.moment[2, h] = u0, u1, u2
        # moment in the frame of the point before
        m0, m1, m2 = M0, M1, M2
        if h > 0:
            R = f.R[h - 1]
            m0 = R[0, 0] * M0 + R[1, 0] * M1 + R[2, 0] * M2
            m1 = R[0, 1] * M0 + R[1, 1] * M1 + R[2, 1] * M2
            m2 = R[0, 2] * M0 + R[1, 2] * M1 + R[2, 2] * M2
        # u = T(turn)^T m by the turn: D = b [m]x + (db m x turn + dc (m.turn) turn - (2 c + dc turn^2) m) turn^T
        # + c turn m^T + c (m.turn) I
        b, t, db, dt = tangent_factors(x * x + y * y + z * z)
        along = x * m0 + y * m1 + z * m2
        e, d = dt * along, 2.0 * t + dt * (x * x + y * y + z * z)
        d0 = db * (m1 * z - m2 * y) + e * x - d * m0
        d1 = db * (m2 * x - m0 * z) + e * y - d * m1
        d2 = db * (m0 * y - m1 * x) + e * z - d * m2
        along, x0, x1, x2 = t * along, t * x, t * y, t * z
        D00, D01, D02 = d0 * x + x0 * m0 + along, d0 * y + x0 * m1 - b * m2, d0 * z + x0 * m2 + b * m1
        D10, D11, D12 = d1 * x + x1 * m0 + b * m2, d1 * y + x1 * m1 + along, d1 * z + x1 * m2 - b * m0
        D20, D21, D22 = d2 * x + x2 * m0 - b * m1, d2 * y + x2 * m1 + b * m0, d2 * z + x2 * m2 + along
        for i in range(N):
            r0, r1, r2 = rate[0, i], rate[1, i], rate[2, i]
            x0, x1, x2 = X[0, i], X[1, i], X[2, i]
            if h > 0:
                p0, p1, p2 = f.psi[h - 1, 0, i], f.psi[h - 1, 1, i], f.psi[h - 1, 2, i]
                x0, x1, x2 = x0 + M1 * p2 - M2 * p1, x1 + M2 * p0 - M0 * p2, x2 + M0 * p1 - M1 * p0
            Z[0, i] = T[0, 0] * x0 + T[1, 0] * x1 + T[2, 0] * x2 + D00 * r0 + D01 * r1 + D02 * r2
            Z[1, i] = T[0, 1] * x0 + T[1, 1] * x1 + T[2, 1] * x2 + D10 * r0 + D11 * r1 + D12 * r2
            Z[2, i] = T[0, 2] * x0 + T[1, 2] * x1 + T[2, 2] * x2 + D20 * r0 + D21 * r1 + D22 * r2
        for i in range(N):
            r0, r1, r2 = rate[0, i], rate[1, i], rate[2, i]
            f.g[i] -= r0 * u0 + r1 * u1 + r2 * u2
            for j in range(i + 1):
                W[i, j] -= r0 * Z[0, j] + r1 * Z[1, j] + r2 * Z[2, j]
    _second_rates(length, number, c, f)
    for i in range(N):
        for j in range(i):
            W[j, i] = W[i, j]
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
def _second_rates(length, number, c, f):
    """Into W (lower): the moment on the second derivatives of the turns, those of the pairs of modes."""
    pair = 0
    for axis in range(3):
        j, k = (axis + 1) % 3, (axis + 2) % 3
        one = 0 if j == 0 else (number[0] if j == 1 else number[0] + number[1])
        two = 0 if k == 0 else (number[0] if k == 1 else number[0] + number[1])
        for i in range(one, one + number[j]):
            for l in range(two, two + number[k]):
                s = 0.0
                for g in range(number[3] + 1):
                    s += c.pairs[pair, g] * f.moment[axis, g]
                f.W[max(i, l), min(i, l)] -= 0.5 * length * length * s
                pair += 1


@kernel
def strain_tangent(value, number, inner, pull, scratch):
    """W and g of the amplitudes at fixed end wrench and gravity, into scratch as left by `strain_fields`:

    g_i = K (a - a0) - dH/da_i - m.psi_i(L), and W_ij the symmetric part of its derivative. The skew part, a half of
    m.(psi_i(L) x psi_j(L)), is that of a moment that is fixed in space, on end q alone: no matter of the leaf.
    """
    _tangent(value, number, inner, constants_of(value, number), fields_of(number, scratch))


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
            X[i, e] = f.eta[e, i]
    _substitute(f.W, X)
    for e in range(3):
        pull[6 + e] = pull[3 + e]
        for i in range(N):
            pull[3 + e] -= f.eta[e, i] * f.Y[i, 6]
            for r in range(3):
                Z[r, e] += f.rho[r, i] * X[i, e]
                Z[3 + r, e] += f.psi[ng, r, i] * X[i, e]
                G[r, e] += f.eta[r, i] * X[i, e]
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
    _tangent(value, number, inner, c, f)
    # Y = W^-1 [J^T, g], seven right-hand sides at once; J = (rho(L), psi(L))
    for i in range(N):
        for r in range(3):
            f.Y[i, r], f.Y[i, 3 + r] = f.rho[r, i], f.psi[ng, r, i]
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
        gap[r] = d[r] - f.end[r] if r < 3 else twist[r - 3]
        for e in range(6):
            F[r, e] = 0.0
    for i in range(N):
        for r in range(6):
            j = f.rho[r, i] if r < 3 else f.psi[ng, r - 3, i]
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
