"""The strain-mode leaf: one body per leaf, condensed to its end frames in every Newton step.

Unknowns of a leaf: amplitudes a of its curvature modes (nx torsion, ny strong, nz weak bending; [1/m]) and
lam = (n, m), force and moment on end q [N, Nm]. Curvature kappa_c = sum_i a_i B_i(s) over the modes of axis c; orientation
R' = R [kappa]x by a sixth-order Magnus step over every interval between quadrature points (`ksd.elements.magnus`);
r' = v = R (e1 + C R^T n) with C = diag(1/EA, 1/kGA, 1/kGA), so stretch and shear are exact without unknowns. All
vectors are in the frame of end p. Interface of all members: see `ksd.model.assembly`; constants:
`ksd.elements.strain_values`.

Source: the stationary conditions of the mixed functional 1/2 (a - a0) K (a - a0) - H + n.d + m.log(Q R(L)^T) for end q
at d, Q (its derivative by lam is the closure gap c there), with the sum over the quadrature points
H = L sum w (n.R e1 + 1/2 n.R C R^T n). Residual and tangent are the derivatives of this sum, by the chain rule through
the Magnus steps, so the tangent is symmetric and exact for any number of points. Of the derivative of m.psi by the
amplitudes the tangent has the symmetric part; the skew part is that of a moment that rotates by half of the rotation
c + xi of the closure. m is rotated by this in every step, which keeps Newton's method quadratic inside the leaf. The end
of the leaf is r(L) = dH/dn, and by partial summation the residual has at every interval the moment m + sum L w v x n over
the points behind it, in place of m + (r(L) - r(s)) x n of the rod.

A leaf with weight has line mass mu [kg/m] in gravity g [m/s^2], in frame p; its tables end with M(s) = int_s^L mu. Then
the force is n(s) = n + M g. dH/dg = int M v is the first moment of the mass about end p, and eta_i its derivative by
the amplitudes. The gravity block of its store holds g (`ksd.elements.weight`). A leaf with inertia has several force modes
in place of M g, and couples on its width axis, tau(s).e3 in H (`ksd.elements.inertia`).

For a leaf bent in its plane only, `ksd.elements.strain_flat` computes the same tangent faster.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ksd.elements.magnus import magnus_rotation, magnus_second_derivative
from ksd.elements.plate_energy import POINT_NUMBERS, plate_point
from ksd.elements.strain_flat import flat_tangent, is_flat
from ksd.elements.strain_values import mode_counts
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log, tangent_factors

TINY_PIVOT = 1e-15
"""A pivot below this fraction of its diagonal before elimination counts as zero."""


class LeafFields(NamedTuple):
    """Working arrays of a leaf with up to N modes and ng points: at the points, at end p, points and end q (ng+2), and
    over the intervals between these (ng+1).

    Over an interval, see `ksd.elements.magnus`: moment (ng+1, 9) of its curvature; turn (ng+1, 3) and J (ng+1, 3, 9); T
    (ng+1, 3, 3): from a change of turn to the rotation of everything behind; G = T J. R (ng+2, 3, 3): orientation; psi
    (ng+2, 3, N): rotation by the amplitudes. n (ng, 3): force; v (ng, 3) = r'; S (ng, 3, 3) = R C R^T [1/N]; slope (ng,
    3, N): v by the amplitudes, at fixed n. end (3,) [m]: position of end q; rho, eta (3, N): that position, and the
    first moment of the mass of every mode (3 rows each), by the amplitudes; eta only with weight. tau (ng, 3): vectors that
    the width axis is multiplied with in H, only with couple modes. W (N, N): tangent of the amplitudes; Y (N, 8):
    right-hand sides, the seventh their residual; X (3, N), Z (N, 9), M (9, 9), V (3, 3): scratch.
    """

    moment: np.ndarray
    turn: np.ndarray
    J: np.ndarray
    T: np.ndarray
    G: np.ndarray
    R: np.ndarray
    psi: np.ndarray
    n: np.ndarray
    v: np.ndarray
    S: np.ndarray
    slope: np.ndarray
    end: np.ndarray
    rho: np.ndarray
    eta: np.ndarray
    tau: np.ndarray
    W: np.ndarray
    Y: np.ndarray
    X: np.ndarray
    Z: np.ndarray
    M: np.ndarray
    V: np.ndarray


@kernel
def constant_offsets(number):
    """Offsets in `value` of the stress-free amplitudes, weights, compliances, moments over the intervals and masses
    beyond the points, see `ksd.elements.strain_values`; plate numbers, if any, stand before the masses."""
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    N = nx + ny + nz
    amplitudes = 1 + nx * nx + ny * ny + nz * nz
    weight = amplitudes + N
    compliance = weight + ng + ng * ng + N * ng
    moment = compliance + 3 * ng
    return (
        amplitudes,
        weight,
        compliance,
        moment,
        moment + 3 * N * (ng + 1) + (POINT_NUMBERS + nz) * number[4],
    )


def allocate_leaf_fields(N, ng, modes=1):  # type: ignore[no-untyped-def]
    """`LeafFields` for N curvature modes, ng points and `modes` of a distributed load; `allocate_leaf_fields_compiled` is
    the same for kernels."""
    return LeafFields(
        np.empty((ng + 1, 9)), np.empty((ng + 1, 3)), np.empty((ng + 1, 3, 9)), np.empty((ng + 1, 3, 3)),
        np.empty((ng + 1, 3, 9)), np.empty((ng + 2, 3, 3)), np.empty((ng + 2, 3, N)), np.empty((ng, 3)),
        np.empty((ng, 3)), np.empty((ng, 3, 3)), np.empty((ng, 3, N)), np.empty(3), np.empty((3, N)),
        np.empty((3 * modes, N)), np.empty((ng, 3)), np.empty((N, N)), np.empty((N, 8)), np.empty((3, N)),
        np.empty((N, 9)), np.empty((9, 9)), np.empty((3, 3)),
    )  # fmt: skip


allocate_leaf_fields_compiled = kernel(inline="always")(allocate_leaf_fields)


def leaf_fields(number: np.ndarray) -> LeafFields:
    """`LeafFields` for one leaf with settings `number`."""
    return allocate_leaf_fields(int(number[:3].sum()), int(number[3]), max(int(number[5:7].sum()), 1))


@kernel(inline="late")
def _orientations(value, number, a, fields):
    """Write R and psi at the points and at end q.

    Over every interval R <- R exp(turn) and psi <- psi + G d(moments), with exp(turn) = I + T [turn]x, where T is the
    tangent of the exponential, rotated into frame p.
    """
    moment, turn, J = fields.moment, fields.turn, fields.J
    T, G = fields.T, fields.G
    R, psi = fields.R, fields.psi
    N, length = number[0] + number[1] + number[2], value[0]
    _, _, _, modes, _ = constant_offsets(number)
    for r in range(3):
        for e in range(3):
            R[0, r, e] = 1.0 if r == e else 0.0
        for i in range(N):
            psi[0, r, i] = 0.0
    for h in range(number[3] + 1):
        first, at = 0, modes + 3 * N * h
        for axis in range(3):
            p, q, s = 0.0, 0.0, 0.0
            for i in range(first, first + number[axis]):
                p += a[i] * value[at + i]
                q += a[i] * value[at + N + i]
                s += a[i] * value[at + 2 * N + i]
            moment[h, axis], moment[h, 3 + axis], moment[h, 6 + axis] = length * p, length * q, length * s
            first += number[axis]
        magnus_rotation(h, moment, turn, J)
        x, y, z = turn[h, 0], turn[h, 1], turn[h, 2]
        t, u, _, _ = tangent_factors(x * x + y * y + z * z)
        for r in range(3):
            # row x turn, and (row x turn) x turn
            p, q, s = R[h, r, 0], R[h, r, 1], R[h, r, 2]
            p1, q1, s1 = q * z - s * y, s * x - p * z, p * y - q * x
            p2, q2, s2 = q1 * z - s1 * y, s1 * x - p1 * z, p1 * y - q1 * x
            d, e, g = p + t * p1 + u * p2, q + t * q1 + u * q2, s + t * s1 + u * s2
            T[h, r, 0], T[h, r, 1], T[h, r, 2] = d, e, g
            R[h + 1, r, 0] = p + e * z - g * y
            R[h + 1, r, 1] = q + g * x - d * z
            R[h + 1, r, 2] = s + d * y - e * x
            for k in range(9):
                G[h, r, k] = d * J[h, 0, k] + e * J[h, 1, k] + g * J[h, 2, k]
        first = 0
        for axis in range(3):
            a0, a1, a2 = length * G[h, 0, axis], length * G[h, 1, axis], length * G[h, 2, axis]
            b0, b1, b2 = length * G[h, 0, 3 + axis], length * G[h, 1, 3 + axis], length * G[h, 2, 3 + axis]
            c0, c1, c2 = length * G[h, 0, 6 + axis], length * G[h, 1, 6 + axis], length * G[h, 2, 6 + axis]
            for i in range(first, first + number[axis]):
                p, q, s = value[at + i], value[at + N + i], value[at + 2 * N + i]
                x, y, z = psi[h, 0, i], psi[h, 1, i], psi[h, 2, i]
                psi[h + 1, 0, i] = x + a0 * p + b0 * q + c0 * s
                psi[h + 1, 1, i] = y + a1 * p + b1 * q + c1 * s
                psi[h + 1, 2, i] = z + a2 * p + b2 * q + c2 * s
            first += number[axis]


@kernel(inline="late")
def _slopes(value, number, inner, gravity, fields):
    """Write n(s), v = R (e1 + C R^T n(s)), S = R C R^T and slope = psi x v - S (psi x n(s)) at every point; end, rho
    and eta.

    gravity: the gravity block, empty without weight.
    """
    R, psi, force = fields.R, fields.psi, fields.n
    v, S, slope = fields.v, fields.S, fields.slope
    end, rho, eta = fields.end, fields.rho, fields.eta
    N, tau = number[0] + number[1] + number[2], fields.tau
    forces, modes, _ = mode_counts(number, len(gravity) > 0)
    _, weight, compliance, _, beyond = constant_offsets(number)
    for r in range(3):
        end[r] = 0.0
        for i in range(N):
            rho[r, i] = 0.0
    for r in range(3 * modes):
        for i in range(N):
            eta[r, i] = 0.0
    for g in range(number[3]):
        w = value[0] * value[weight + g]
        for r in range(3):
            s, t = inner[N + r], 0.0
            for k in range(forces):
                s += value[beyond + modes * g + k] * gravity[3 * k + r]
            for k in range(forces, modes):
                t += value[beyond + modes * g + k] * gravity[3 * k + r]
            force[g, r], tau[g, r] = s, t
        k0, k1, k2 = force[g, 0], force[g, 1], force[g, 2]
        for i in range(3):
            for j in range(3):
                s = 0.0
                for e in range(3):
                    s += value[compliance + 3 * g + e] * R[g + 1, i, e] * R[g + 1, j, e]
                S[g, i, j] = s
            v[g, i] = R[g + 1, i, 0] + S[g, i, 0] * k0 + S[g, i, 1] * k1 + S[g, i, 2] * k2
            end[i] += w * v[g, i]
        v0, v1, v2 = v[g, 0], v[g, 1], v[g, 2]
        for r in range(3):
            # row r of S [n]x - [v]x
            b0 = S[g, r, 1] * k2 - S[g, r, 2] * k1
            b1 = S[g, r, 2] * k0 - S[g, r, 0] * k2
            b2 = S[g, r, 0] * k1 - S[g, r, 1] * k0
            if r == 0:
                b1, b2 = b1 + v2, b2 - v1
            elif r == 1:
                b0, b2 = b0 - v2, b2 + v0
            else:
                b0, b1 = b0 + v1, b1 - v0
            for i in range(N):
                s = b0 * psi[g + 1, 0, i] + b1 * psi[g + 1, 1, i] + b2 * psi[g + 1, 2, i]
                slope[g, r, i] = s
                rho[r, i] += w * s
                for k in range(forces):
                    eta[3 * k + r, i] += w * value[beyond + modes * g + k] * s
            for k in range(forces, modes):
                j, l = (r + 1) % 3, (r + 2) % 3
                s = w * value[beyond + modes * g + k]
                for i in range(N):
                    eta[3 * k + r, i] += s * (
                        psi[g + 1, j, i] * R[g + 1, l, 2] - psi[g + 1, l, i] * R[g + 1, j, 2]
                    )


@kernel(inline="late")
def fill_leaf_fields(value, number, inner, gravity, fields):
    """Fill the `LeafFields` of a leaf with inner state `inner` = (a (N,), n (3,), m (3,)), except W and Y."""
    _orientations(value, number, inner, fields)
    _slopes(value, number, inner, gravity, fields)


@kernel(inline="late")
def strain_tangent(value, number, inner, fields):
    """Write W and the residual g of the amplitudes at fixed end wrench and gravity into the fields left by
    `fill_leaf_fields`.

    g_i = K (a - a0) - dH/da_i - m.psi_i(L), and W_ij is the symmetric part of its derivative. The skew part, half of
    m.(psi_i(L) x psi_j(L)), is that of a moment fixed in space; it acts on end q only and is not part of the leaf.
    Going back from end q: M, the moment carried by an interval, and X, its derivative by the amplitudes.
    """
    moment, turn, J = fields.moment, fields.turn, fields.J
    T, G = fields.T, fields.G
    R, psi = fields.R, fields.psi
    n, v, slope = fields.n, fields.v, fields.slope
    M, V, W = fields.M, fields.V, fields.W
    tau, has_couples = fields.tau, number[6] > 0
    Y, X, Z = fields.Y, fields.X, fields.Z
    N, ng, length = number[0] + number[1] + number[2], number[3], value[0]
    amplitudes, weight, _, modes, _ = constant_offsets(number)
    M0, M1, M2 = inner[N + 3], inner[N + 4], inner[N + 5]
    for i in range(N):
        # with half the moment rotating with end q, W is the symmetric part
        p0, p1, p2 = 0.5 * psi[ng + 1, 0, i], 0.5 * psi[ng + 1, 1, i], 0.5 * psi[ng + 1, 2, i]
        X[0, i], X[1, i], X[2, i] = M2 * p1 - M1 * p2, M0 * p2 - M2 * p0, M1 * p0 - M0 * p1
        Y[i, 6] = 0.0
        for j in range(i + 1):
            W[i, j] = 0.0
    # without load, as at rest, W is the leaf's own stiffness
    loaded = M0 != 0.0 or M1 != 0.0 or M2 != 0.0 or has_couples
    for h in range(ng):
        loaded = loaded or n[h, 0] != 0.0 or n[h, 1] != 0.0 or n[h, 2] != 0.0
    flat = loaded and not has_couples and is_flat(number, inner, n)
    if flat:
        flat_tangent(value, number, inner, modes, weight, moment, J, G, psi, n, v, slope, W, Y, X, Z)
    for h in range(ng if loaded and not flat else -1, -1, -1):
        if h < ng:
            w = length * value[weight + h]
            k0, k1, k2 = w * n[h, 0], w * n[h, 1], w * n[h, 2]
            v0, v1, v2 = v[h, 0], v[h, 1], v[h, 2]
            M0, M1, M2 = M0 + v1 * k2 - v2 * k1, M1 + v2 * k0 - v0 * k2, M2 + v0 * k1 - v1 * k0
            for i in range(N):
                v0, v1, v2 = slope[h, 0, i], slope[h, 1, i], slope[h, 2, i]
                X[0, i] += v1 * k2 - v2 * k1
                X[1, i] += v2 * k0 - v0 * k2
                X[2, i] += v0 * k1 - v1 * k0
            if has_couples:
                k0, k1, k2 = w * tau[h, 0], w * tau[h, 1], w * tau[h, 2]
                v0, v1, v2 = R[h + 1, 0, 2], R[h + 1, 1, 2], R[h + 1, 2, 2]
                M0, M1, M2 = M0 + v1 * k2 - v2 * k1, M1 + v2 * k0 - v0 * k2, M2 + v0 * k1 - v1 * k0
                along = v0 * k0 + v1 * k1 + v2 * k2
                for i in range(N):
                    # (psi x e) x tau
                    p0, p1, p2 = psi[h + 1, 0, i], psi[h + 1, 1, i], psi[h + 1, 2, i]
                    d = p0 * k0 + p1 * k1 + p2 * k2
                    X[0, i] += v0 * d - p0 * along
                    X[1, i] += v1 * d - p1 * along
                    X[2, i] += v2 * d - p2 * along
        u0 = T[h, 0, 0] * M0 + T[h, 1, 0] * M1 + T[h, 2, 0] * M2
        u1 = T[h, 0, 1] * M0 + T[h, 1, 1] * M1 + T[h, 2, 1] * M2
        u2 = T[h, 0, 2] * M0 + T[h, 1, 2] * M1 + T[h, 2, 2] * M2
        # in the axes at the start of the interval
        m0 = R[h, 0, 0] * M0 + R[h, 1, 0] * M1 + R[h, 2, 0] * M2
        m1 = R[h, 0, 1] * M0 + R[h, 1, 1] * M1 + R[h, 2, 1] * M2
        m2 = R[h, 0, 2] * M0 + R[h, 1, 2] * M1 + R[h, 2, 2] * M2
        magnus_second_derivative(h, moment, turn, J, m0, m1, m2, u0, u1, u2, V, M)
        h0, h1, h2 = 0.5 * M0, 0.5 * M1, 0.5 * M2
        first, at = 0, modes + 3 * N * h
        for axis in range(3):
            d = G[h, 0, axis] * M0 + G[h, 1, axis] * M1 + G[h, 2, axis] * M2
            e = G[h, 0, 3 + axis] * M0 + G[h, 1, 3 + axis] * M1 + G[h, 2, 3 + axis] * M2
            g = G[h, 0, 6 + axis] * M0 + G[h, 1, 6 + axis] * M1 + G[h, 2, 6 + axis] * M2
            for i in range(first, first + number[axis]):
                p, q, s = length * value[at + i], length * value[at + N + i], length * value[at + 2 * N + i]
                Y[i, 6] -= p * d + q * e + s * g
                # twice the rotation at the middle of the interval includes the skew part of the second derivative
                x, y, z = (
                    psi[h, 0, i] + psi[h + 1, 0, i],
                    psi[h, 1, i] + psi[h + 1, 1, i],
                    psi[h, 2, i] + psi[h + 1, 2, i],
                )
                x, y, z = X[0, i] + h1 * z - h2 * y, X[1, i] + h2 * x - h0 * z, X[2, i] + h0 * y - h1 * x
                # the lower triangle of W needs columns of this axis and later ones only
                for c in range(axis, 3):
                    for k in range(c, 9, 3):
                        Z[i, k] = (p * M[axis, k] + q * M[3 + axis, k] + s * M[6 + axis, k]) + (
                            G[h, 0, k] * x + G[h, 1, k] * y + G[h, 2, k] * z
                        )
                for j in range(i + 1):
                    W[i, j] -= p * Z[j, axis] + q * Z[j, 3 + axis] + s * Z[j, 6 + axis]
            first += number[axis]
    for i in range(N):
        for j in range(i):
            W[j, i] = W[i, j]
    first, at = 0, 1
    # a leaf with weight has no such numbers
    rate_at = N + 6 + 6 * (number[5] + number[6])
    is_damped = number[5] > 0 and len(inner) > rate_at
    for axis in range(3):
        count = number[axis]
        for i in range(first, first + count):
            for j in range(first, first + count):
                W[i, j] += value[at]
                Y[i, 6] += value[at] * (inner[j] - value[amplitudes + j])
                if is_damped:
                    W[i, j] += inner[rate_at] * value[at]
                    Y[i, 6] += inner[rate_at] * value[at] * (inner[j] - inner[rate_at + 1 + j])
                at += 1
        first += count
    if number[4]:
        _add_plate(value, number, inner, W, Y)


@kernel
def _add_plate(value, number, inner, W, Y):
    """Add the energy of curling that is lost at a large curvature (`ksd.elements.plate_energy`) to W and the residual."""
    nz, first = number[2], number[0] + number[1]
    amplitudes, _, _, _, at = constant_offsets(number)
    for _ in range(number[4]):
        at -= POINT_NUMBERS + nz
        curvature, own, basis = 0.0, 0.0, at + POINT_NUMBERS
        for i in range(nz):
            curvature += inner[first + i] * value[basis + i]
            own += value[amplitudes + first + i] * value[basis + i]
        moment, stiffness = plate_point(value, at, curvature, curvature - own)
        for i in range(nz):
            Y[first + i, 6] += moment * value[basis + i]
            for j in range(nz):
                W[first + i, first + j] += stiffness * value[basis + i] * value[basis + j]


@kernel(inline="late")
def _solve_modes(N, W, Y):
    """Overwrite Y (N, 7) with W^-1 Y, and W with its LDL^T factor: L below the diagonal, D on it.

    Y[:, 7]: smallest pivots allowed. Returns (negative pivots, 2 where a pivot had to be replaced, else 0).
    """
    negatives, status = 0, 0
    for j in range(N):
        Y[j, 7] = TINY_PIVOT * abs(W[j, j])
    for j in range(N):
        pivot = W[j, j]
        if not abs(pivot) > Y[j, 7]:
            status = 2
            pivot = Y[j, 7] + 1e-300
            W[j, j] = pivot
        negatives += pivot < 0.0
        for i in range(j + 1, N):
            l = W[j, i] / pivot
            W[i, j] = l
            # bending in the plane of a leaf is not coupled with motions out of it
            if l != 0.0:
                for c in range(i, N):
                    W[i, c] -= l * W[j, c]
                for e in range(7):
                    Y[i, e] -= l * Y[j, e]
    for j in range(N - 1, -1, -1):
        for e in range(7):
            Y[j, e] /= W[j, j]
        for c in range(j + 1, N):
            l = W[c, j]
            if l != 0.0:
                for e in range(7):
                    Y[j, e] -= l * Y[c, e]
    return negatives, status


@kernel
def _substitute(N, W, Y):
    """Overwrite Y (N, n) with W^-1 Y, W factored by `_solve_modes`."""
    n = Y.shape[1]
    for j in range(N):
        for c in range(j):
            l = W[j, c]
            if l != 0.0:
                for e in range(n):
                    Y[j, e] -= l * Y[c, e]
    for j in range(N - 1, -1, -1):
        inverse = 1.0 / W[j, j]
        for e in range(n):
            Y[j, e] *= inverse
        for c in range(j + 1, N):
            l = W[c, j]
            if l != 0.0:
                for e in range(n):
                    Y[j, e] -= l * Y[c, e]


@kernel(inline="late")
def _invert6(F, K, row):
    """Write K (6, 6) = F^-1 for symmetric F (6, 6 or larger) by sweeping the pivots; return (negative pivots, regular).

    row (6,): scratch.
    """
    negatives, is_regular = 0, True
    for i in range(6):
        for j in range(6):
            K[i, j] = F[i, j]
    for k in range(6):
        pivot = K[k, k]
        is_regular &= abs(pivot) > 1e-18 * abs(F[k, k])
        negatives += pivot < 0.0
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
    return negatives, is_regular


@kernel(inline="always")
def _half_cross(m, x, y, z, r):
    """Component r of half of m x (x, y, z)."""
    if r == 0:
        component = m[1] * z - m[2] * y
    elif r == 1:
        component = m[2] * x - m[0] * z
    else:
        component = m[0] * y - m[1] * x
    return 0.5 * component


@kernel
def strain_gravity_block(value, number, inner, store, fields, lam, K):
    """Write the gravity block of a leaf with weight or inertia after `strain_condense`, see `ksd.elements.weight`; nothing
    without.

    Before it in the store stands X (N, D) = W^-1 eta(L)^T, for `strain_recover`. With B = int M S and Z = J X + B
    (force rows): V_xi,g = -K Z, V_g,g = Z^T K Z - eta X - int M^2 S. The first moment int M v is predicted with the
    step K (c + J W^-1 g) of the wrench: lam[0:6] - lam[6:12] and the rotation of m.
    """
    N, ng = number[0] + number[1] + number[2], number[3]
    _, weight, _, _, beyond = constant_offsets(number)
    if len(store) == 8 * N + 42:
        return
    forces, modes, block_size = mode_counts(number, True)
    block_at, D, v, S = len(store) - block_size, 3 * modes, fields.v, fields.S
    rho, psi, eta = fields.rho, fields.psi, fields.eta
    R = fields.R
    X, Z = store[8 * N + 42 : 8 * N + 42 + D * N].reshape(N, D), np.zeros((6, D))
    G, step = np.zeros((D, D)), np.empty(6)
    for r in range(3):
        step[r] = lam[r] - lam[6 + r]
        step[3 + r] = lam[3 + r] - lam[9 + r] + _half_cross(lam[9:], store[7], store[15], store[23], r)
    for i in range(N):
        for e in range(D):
            X[i, e] = eta[e, i]
    _substitute(N, fields.W, X)
    for k in range(modes):
        for c in range(3):
            s = 0.0
            for g in range(ng):
                w = value[0] * value[weight + g] * value[beyond + modes * g + k]
                s += w * (v[g, c] if k < forces else R[g + 1, c, 2])
            store[block_at + 2 * D + 3 * k + c] = s
    for g in range(ng):
        for k in range(forces):
            w = value[0] * value[weight + g] * value[beyond + modes * g + k]
            for r in range(3):
                for c in range(3):
                    Z[r, 3 * k + c] += w * S[g, r, c]
            for l in range(k + 1):
                t = w * value[beyond + modes * g + l]
                for r in range(3):
                    for c in range(3):
                        G[3 * k + r, 3 * l + c] += t * S[g, r, c]
    for i in range(N):
        for r in range(3):
            x, y = rho[r, i], psi[ng + 1, r, i]
            for e in range(D):
                Z[r, e] += x * X[i, e]
                Z[3 + r, e] += y * X[i, e]
        for r in range(D):
            x = eta[r, i]
            for e in range(r + 1):
                G[r, e] += x * X[i, e]
    rows, block = block_at + 3 * D, block_at + 9 * D
    for e in range(D):
        s = store[block_at + 2 * D + e]
        for i in range(N):
            s -= eta[e, i] * store[8 * i + 6]
        for r in range(6):
            s += Z[r, e] * step[r]
        store[block_at + D + e] = s
    for r in range(6):
        for e in range(D):
            s = 0.0
            for k in range(6):
                s -= K[r, k] * Z[k, e]
            store[rows + D * r + e] = s
    for r in range(D):
        for e in range(r + 1):
            s = -G[r, e]
            for k in range(6):
                s -= Z[k, r] * store[rows + D * k + e]
            store[block + D * r + e], store[block + D * e + r] = s, s


@kernel
def strain_condense(value, number, inner, store, fields, d, Q, lam, K):
    """Condense one leaf at end pose d (3,) [m], Q (3, 3); see the module docstring for the equations.

    inner = (a (N,), lam (6,)). Writes lam[0:6], condensed end wrench, lam[6:12], the wrench for the geometric terms
    (that before this step), and K (6, 6). store: W^-1 J^T and W^-1 g (N, 8; the last column of the first three rows:
    the closure rotation c), K (6, 6) and c + J W^-1 g (6,), for a leaf with weight also what `strain_gravity_block`
    adds. fields: `LeafFields` large enough for the leaf, their contents undefined. Returns (negative pivots of W minus
    those of F, |change of n| [N], |change of m| [Nm], status).
    """
    N, ng = number[0] + number[1] + number[2], number[3]
    _, weight, _, _, _ = constant_offsets(number)
    stiffness_at = N * 8
    gap_at = stiffness_at + 36
    _, _, block_size = mode_counts(number, len(store) > stiffness_at + 42)
    gravity = store[len(store) - block_size :]
    # `fill_leaf_fields` inlined, so that it is not compiled
    _orientations(value, number, inner, fields)
    _slopes(value, number, inner, gravity, fields)
    strain_tangent(value, number, inner, fields)
    W, Y, R = fields.W, fields.Y, fields.R
    rho, psi = fields.rho, fields.psi
    S, end = fields.S, fields.end
    # Y = W^-1 [J^T, g], seven right-hand sides at once; J = (rho(L), psi(L))
    for i in range(N):
        for r in range(3):
            Y[i, r], Y[i, 3 + r] = rho[r, i], psi[ng + 1, r, i]
    negatives, status = _solve_modes(N, W, Y)
    # F = J W^-1 J^T + L sum w S (force block);  gap = closure + J W^-1 g
    F, relative = fields.M, fields.V
    row, step = fields.moment[0], fields.moment[1]
    for r in range(6):
        for e in range(6):
            F[r, e] = 0.0
    for i in range(3):
        for j in range(3):
            relative[i, j] = Q[i, 0] * R[ng + 1, j, 0] + Q[i, 1] * R[ng + 1, j, 1] + Q[i, 2] * R[ng + 1, j, 2]
    rotation_log(relative, step)
    for r in range(3):
        store[gap_at + r], store[gap_at + 3 + r], store[8 * r + 7] = d[r] - end[r], step[r], step[r]
    for i in range(N):
        for e in range(7):
            store[8 * i + e] = Y[i, e]
        for r in range(6):
            j = rho[r, i] if r < 3 else psi[ng + 1, r - 3, i]
            for e in range(r + 1):
                F[r, e] += j * Y[i, e]
            store[gap_at + r] += j * Y[i, 6]
    for p in range(ng):
        w = value[0] * value[weight + p]
        for i in range(3):
            for j in range(i + 1):
                F[i, j] += w * S[p, i, j]
    for r in range(6):
        for e in range(r):
            F[e, r] = F[r, e]
    condensed_negatives, is_regular = _invert6(F, K, row)
    if not is_regular:
        status = 2
    dn, dm = 0.0, 0.0
    for r in range(6):
        s = 0.0
        for e in range(6):
            store[stiffness_at + r * 6 + e] = K[r, e]
            s += K[r, e] * store[gap_at + e]
        step[r] = s
        lam[r], lam[6 + r] = inner[N + r] + s, inner[N + r]
        if r >= 3:
            lam[r] -= _half_cross(inner[N + 3 :], store[7], store[15], store[23], r - 3)
        if r < 3:
            dn += s * s
        else:
            dm += s * s
    if not math.isfinite(dn + dm):
        status = 2
    return negatives - condensed_negatives, math.sqrt(dn), math.sqrt(dm), status


@kernel
def strain_energy(value, number, inner, store, fields):
    """Strain energy [J] of a leaf at a state at which its gravity block was set, without plate stiffening."""
    N = number[0] + number[1] + number[2]
    amplitudes, weight, _, _, _ = constant_offsets(number)
    _, _, block_size = mode_counts(number, len(store) > N * 8 + 42)
    _orientations(value, number, inner, fields)
    _slopes(value, number, inner, store[len(store) - block_size :], fields)
    n, S = fields.n, fields.S
    energy, first, at = 0.0, 0, 1
    for axis in range(3):
        for i in range(first, first + number[axis]):
            for j in range(first, first + number[axis]):
                a, b = inner[i] - value[amplitudes + i], inner[j] - value[amplitudes + j]
                energy += 0.5 * a * value[at] * b
                at += 1
        first += number[axis]
    for g in range(number[3]):
        for r in range(3):
            for c in range(3):
                energy += 0.5 * value[0] * value[weight + g] * n[g, r] * S[g, r, c] * n[g, c]
    return energy


@kernel
def strain_recover(value, number, inner, store, xi, scale, step):
    """Add dlam = K (xi + gap) and da = W^-1 (J^T dlam - g), times `scale`, to the inner state; m is rotated by half of
    c + xi.

    A leaf with weight includes the change of gravity in frame p, the last numbers of its gravity block. step
    (6,): scratch.
    """
    N = number[0] + number[1] + number[2]
    stiffness_at = N * 8
    gap_at = stiffness_at + 36
    _, modes, block_size = mode_counts(number, len(store) > stiffness_at + 42)
    D = 3 * modes
    rows = len(store) - block_size + 3 * D
    change = rows + 6 * D + D * D
    m0, m1, m2 = inner[N + 3], inner[N + 4], inner[N + 5]
    for r in range(6):
        s = 0.0
        for e in range(6):
            s += store[stiffness_at + r * 6 + e] * (xi[e] + store[gap_at + e])
        for e in range(D):
            s += store[rows + D * r + e] * store[change + e]
        step[r] = s
        inner[N + r] += scale * s
    x, y, z = store[7] + xi[3], store[15] + xi[4], store[23] + xi[5]
    inner[N + 3] -= scale * 0.5 * (m1 * z - m2 * y)
    inner[N + 4] -= scale * 0.5 * (m2 * x - m0 * z)
    inner[N + 5] -= scale * 0.5 * (m0 * y - m1 * x)
    for i in range(N):
        s = -store[i * 8 + 6]
        for e in range(6):
            s += store[i * 8 + e] * step[e]
        for e in range(D):
            s += store[gap_at + 6 + D * i + e] * store[change + e]
        inner[i] += scale * s
