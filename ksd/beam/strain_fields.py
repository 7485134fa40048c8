"""Fields of the strain-mode leaf at its quadrature points, and the tangent of its inner unknowns.

Both the equilibrium (`ksd.beam.strain`) and the mass and buckling questions (`ksd.beam.strain_mass`) read
them here, so that all stand on the same equations. Notation and sources: see `ksd.beam.strain`. The two large
kernels are inlined into their callers: a call with so many arrays costs 15 % (4.4 instead of 3.8 us per
leaf).
"""

from __future__ import annotations

import numpy as np

from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_exp


@kernel
def _multiply(A, B, C):
    """C = A B, all (3, 3); C must not alias."""
    for i in range(3):
        for j in range(3):
            C[i, j] = A[i, 0] * B[0, j] + A[i, 1] * B[1, j] + A[i, 2] * B[2, j]


@kernel
def _orientations(value, number, a, at, R, phi):
    """R (ng+1, 3, 3): orientation at the points and, last, at end q; Magnus steps over the gaps.

    phi (3, ng+1) is scratch: the rotation vector of every gap, int kappa + 1/2 iint_{s1<s2} kappa(s1) x kappa(s2).
    """
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    L = value[0]
    gaps = ng + 1
    for c in range(3):
        for g in range(gaps):
            phi[c, g] = 0.0
    # int kappa, mode by mode, all gaps side by side
    k = 0
    for c in range(3):
        for _ in range(number[c]):
            w = L * a[k]
            for g in range(gaps):
                phi[c, g] += w * value[at + k * gaps + g]
            k += 1
    # pair integrals: y with z turn about x, z with x about y, x with y about z
    base = at + (nx + ny + nz) * gaps
    for c in range(3):
        one = c + 1 if c < 2 else 0
        two = c - 1 if c > 0 else 2
        first = nx if one == 1 else (nx + ny if one == 2 else 0)
        second = nx if two == 1 else (nx + ny if two == 2 else 0)
        for k in range(number[one]):
            w = 0.5 * L * L * a[first + k]
            if w != 0.0:
                for l in range(number[two]):
                    u = w * a[second + l]
                    if u != 0.0:
                        o = base + (k * number[two] + l) * gaps
                        for g in range(gaps):
                            phi[c, g] += u * value[o + g]
        base += number[one] * number[two] * gaps
    v, step = np.empty(3), np.empty((3, 3))
    for g in range(gaps):
        v[0], v[1], v[2] = phi[0, g], phi[1, g], phi[2, g]
        if g == 0:
            rotation_exp(v, R[0])
        else:
            rotation_exp(v, step)
            _multiply(R[g - 1], step, R[g])


@kernel
def _integrate(value, weight, integral, ng, f, F):
    """F (ng+1, k): integrals of f (ng, k) from 0 to every point and, last, to the end."""
    for g in range(ng + 1):
        row = weight if g == ng else integral + g * ng
        w = value[row]
        for i in range(f.shape[1]):
            F[g, i] = w * f[0, i]
        for h in range(1, ng):
            w = value[row + h]
            for i in range(f.shape[1]):
                F[g, i] += w * f[h, i]


@kernel(inline="always")
def strain_fields(value, number, inner, R, v, S, m, psi, rho, f):
    """Fields of a leaf with inner state `inner` = (a (N,), n (3,), m (3,)), in frame p; returns r(L).

    R (ng+1, 3, 3): orientation at the points and, last, at end q; v (ng, 3) = r'; S (ng, 6) = R C R^T
    (xx, xy, xz, yy, yz, zz) [1/N]; m (ng, 3): moment [Nm]; psi, rho (ng+1, 3, N): rotation and
    displacement per unit amplitude at fixed n, at the points and at end q. f (ng, 3, N) is scratch.
    """
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    N = nx + ny + nz
    L = value[0]
    # layout of the tables, see strain_values.py
    weight = 1 + nx * nx + ny * ny + nz * nz + N
    integral = weight + ng
    basis = integral + ng * ng
    slack = basis + N * ng
    gaps = slack + 3 * ng
    n0, n1, n2 = inner[N], inner[N + 1], inner[N + 2]
    m0, m1, m2 = inner[N + 3], inner[N + 4], inner[N + 5]
    _orientations(value, number, inner[0:N], gaps, R, np.empty((3, ng + 1)))

    # v = R e1 + R C R^T n and the matrix S = R C R^T at every point
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

    flat = f.reshape((ng, 3 * N))
    # mode fields psi_i = int R e_c B_i, rho_i = int psi_i x v - S (psi_i x n); last index runs over the modes
    for g in range(ng):
        T = R[g]
        for i in range(N):
            c = 0 if i < nx else (1 if i < nx + ny else 2)
            b = L * value[basis + i * ng + g]
            f[g, 0, i] = T[0, c] * b
            f[g, 1, i] = T[1, c] * b
            f[g, 2, i] = T[2, c] * b
    _integrate(value, weight, integral, ng, flat, psi.reshape((ng + 1, 3 * N)))
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
    _integrate(value, weight, integral, ng, flat, rho.reshape((ng + 1, 3 * N)))
    return q0, q1, q2


@kernel(inline="always")
def strain_tangent(value, number, inner, R, m, psi, rho, W, res, P):
    """Residual res (N,) and symmetric tangent W (N, N) of the amplitudes at fixed end wrench.

    Both zero on entry; R, m, psi, rho as left by `strain_fields`; P (3, N) is scratch.
    """
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    N = nx + ny + nz
    L = value[0]
    stiff = 1
    rest = stiff + nx * nx + ny * ny + nz * nz
    weight = rest + N
    basis = weight + ng + ng * ng
    a = inner[0:N]
    n0, n1, n2 = inner[N], inner[N + 1], inner[N + 2]
    # g_i = K (a - a0) - L sum w B_i (R e_c).m
    # W = K - sym L sum w B_j (R e_cj).[m x psi_i + (rho_i(L) - rho_i) x n]
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
            W[j, i] = s
