"""Fields of the strain-mode leaf at its quadrature points, and the tangent of its inner unknowns.

Both the equilibrium (`ksd.beam.strain`) and the mass and buckling questions (`ksd.beam.strain_mass`) read
them here, so that all stand on the same equations. Notation and sources: see `ksd.beam.strain`. The two large
kernels are inlined into their callers: a call with so many arrays costs 15 % (4.4 instead of 3.8 us per
leaf).

A leaf with weight has line mass mu [kg/m] in gravity g [m/s^2], in frame p; its tables end with M(s) = int_s^L
mu. Then the force is n(s) = n + M g, the moment m(s) = m + int_s^L v x n(s), which by parts is m + (r(L) -
r(s)) x n + (h(L) - h(s)) x g with h = int M v; h(L) is the first moment of the mass about end p, and eta_i =
int M rho_i' its derivative by the amplitudes. `pull` holds g, and is empty for a leaf without weight.
"""

from __future__ import annotations

from typing import NamedTuple

from ksd.numerics.kernel import kernel
from ksd.numerics.local import local_matrix, local_vector
from ksd.numerics.rotations import rotation_exp
from ksd.numerics.sums import weighted_rows, weighted_sum, weighted_sums


class Places(NamedTuple):
    """Where things sit in the scratch of a leaf with N modes and ng points (their shapes).

    R (ng+1, 3, 3), v (ng, 4), S (ng, 6), m (ng+1, 4), f (ng, 3, N), fields (ng+1, 6, N): psi then rho, W with Y beside
    it (N, N + 8), t: weights of sums, eta (ng+1, 3, N); end: of all. R ends with end q; m, fields and eta begin with
    it. Vectors in rows of four have a spare number.
    """

    R: int
    v: int
    S: int
    m: int
    f: int
    fields: int
    W: int
    t: int
    eta: int
    end: int


@kernel
def places(N, ng):
    """`Places` for N modes and ng points."""
    v = 9 * (ng + 1)
    S = v + 4 * ng
    m = S + 6 * ng
    f = m + 4 * (ng + 1)
    fields = f + 3 * N * ng
    W = fields + 6 * N * (ng + 1)
    t = W + N * (N + 8)
    eta = t + N * N + 4 * ng
    return Places(0 * N, v, S, m, f, fields, W, t, eta, eta + 3 * N * (ng + 1))


@kernel
def _orientations(value, number, a, at, scratch, R, phi, t):
    """Orientation (ng+1, 3, 3) at the points and, last, at end q, from R on in scratch; Magnus steps over the gaps.

    phi, t: places of scratch for the rotation vector of every gap (3, ng+1), int kappa + 1/2 iint_{s1<s2}
    kappa(s1) x kappa(s2), and for weights. at: place of the gap integrals in value.
    """
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    L = value[0]
    gaps = ng + 1
    # int kappa, mode by mode, all gaps side by side
    first = 0
    for c in range(3):
        weighted_sum(
            scratch, phi + c * gaps, 0, gaps, a, first, 0, 1, number[c], value, at + first * gaps, gaps, L,
            False,
        )  # fmt: skip
        first += number[c]
    # pair integrals: y with z turn about x, z with x about y, x with y about z
    base = at + (nx + ny + nz) * gaps
    for c in range(3):
        one = c + 1 if c < 2 else 0
        two = c - 1 if c > 0 else 2
        first = nx if one == 1 else (nx + ny if one == 2 else 0)
        second = nx if two == 1 else (nx + ny if two == 2 else 0)
        count, largest = 0, 0.0
        for k in range(number[one]):
            for l in range(number[two]):
                u = a[first + k] * a[second + l]
                scratch[t + count] = u
                largest = max(largest, abs(u))
                count += 1
        if largest > 0.0:
            weighted_sum(
                scratch, phi + c * gaps, 0, gaps, scratch, t, 0, 1, count, value, base, gaps, 0.5 * L * L,
                True,
            )  # fmt: skip
        base += count * gaps
    v, step = local_vector(3), local_matrix(3, 3)
    turned = scratch[R : R + 9 * gaps].reshape((gaps, 3, 3))
    for g in range(gaps):
        v[0], v[1], v[2] = scratch[phi + g], scratch[phi + gaps + g], scratch[phi + 2 * gaps + g]
        if g == 0:
            rotation_exp(v, turned[0])
        else:
            rotation_exp(v, step)
            for i in range(3):
                x, y, z = turned[g - 1, i, 0], turned[g - 1, i, 1], turned[g - 1, i, 2]
                for j in range(3):
                    turned[g, i, j] = x * step[0, j] + y * step[1, j] + z * step[2, j]


@kernel
def _slopes(value, inner, pull, N, ng, slack, beyond, scratch, R, v, S):
    """v = R (e1 + C R^T n(s)) from v on and S = R C R^T from S on in scratch, at every point."""
    n0, n1, n2 = inner[N], inner[N + 1], inner[N + 2]
    for g in range(ng):
        c0, c1, c2 = value[slack + 3 * g], value[slack + 3 * g + 1], value[slack + 3 * g + 2]
        o = R + 9 * g
        a0, a1, a2 = scratch[o], scratch[o + 1], scratch[o + 2]
        b0, b1, b2 = scratch[o + 3], scratch[o + 4], scratch[o + 5]
        d0, d1, d2 = scratch[o + 6], scratch[o + 7], scratch[o + 8]
        k0, k1, k2 = n0, n1, n2
        if len(pull) > 0:
            M = value[beyond + g]
            k0, k1, k2 = n0 + M * pull[0], n1 + M * pull[1], n2 + M * pull[2]
        x, y, z = c0 * a0, c1 * a1, c2 * a2
        s0, s1, s2 = x * a0 + y * a1 + z * a2, x * b0 + y * b1 + z * b2, x * d0 + y * d1 + z * d2
        x, y, z = c0 * b0, c1 * b1, c2 * b2
        s3, s4 = x * b0 + y * b1 + z * b2, x * d0 + y * d1 + z * d2
        s5 = c0 * d0 * d0 + c1 * d1 * d1 + c2 * d2 * d2
        o = S + 6 * g
        scratch[o], scratch[o + 1], scratch[o + 2] = s0, s1, s2
        scratch[o + 3], scratch[o + 4], scratch[o + 5] = s3, s4, s5
        o = v + 4 * g
        scratch[o] = a0 + s0 * k0 + s1 * k1 + s2 * k2
        scratch[o + 1] = b0 + s1 * k0 + s3 * k1 + s4 * k2
        scratch[o + 2] = d0 + s2 * k0 + s4 * k1 + s5 * k2
        scratch[o + 3] = 0.0


@kernel
def _moments(value, inner, pull, N, ng, weight, beyond, scratch, v, m, f):
    """m(s) = m + (r(L) - r(s)) x n + (h(L) - h(s)) x g from m on in scratch, after r(L). f: scratch (8 ng + 4)."""
    L = value[0]
    n0, n1, n2 = inner[N], inner[N + 1], inner[N + 2]
    heavy = len(pull) > 0
    # the weights and, after them, the integration matrix
    weighted_rows(ng + 1, scratch, m, 4, 4, value, weight, ng, 1, ng, scratch, v, 4, L, False)
    h = f + 4 * ng
    if heavy:
        for g in range(ng):
            M = value[beyond + g]
            for r in range(4):
                scratch[f + 4 * g + r] = M * scratch[v + 4 * g + r]
        weighted_rows(ng + 1, scratch, h, 4, 4, value, weight, ng, 1, ng, scratch, f, 4, L, False)
    q0, q1, q2 = scratch[m], scratch[m + 1], scratch[m + 2]
    for g in range(ng):
        o = m + 4 * g + 4
        x, y, z = q0 - scratch[o], q1 - scratch[o + 1], q2 - scratch[o + 2]
        scratch[o] = inner[N + 3] + y * n2 - z * n1
        scratch[o + 1] = inner[N + 4] + z * n0 - x * n2
        scratch[o + 2] = inner[N + 5] + x * n1 - y * n0
        if heavy:
            p = h + 4 * g + 4
            x, y, z = (
                scratch[h] - scratch[p],
                scratch[h + 1] - scratch[p + 1],
                scratch[h + 2] - scratch[p + 2],
            )
            scratch[o] += y * pull[2] - z * pull[1]
            scratch[o + 1] += z * pull[0] - x * pull[2]
            scratch[o + 2] += x * pull[1] - y * pull[0]


@kernel
def strain_fields(value, number, inner, pull, scratch):
    """Fields of a leaf with inner state `inner` = (a (N,), n (3,), m (3,)), in frame p, into scratch (see `places`).

    R: orientation at the points and, last, at end q; v = r'; S = R C R^T (xx, xy, xz, yy, yz, zz) [1/N]; m: the
    place r(L) of end q, then the moment [Nm] at the points; psi, rho: rotation and displacement per unit amplitude
    at fixed n, at end q and at the points; eta: see the module docstring, only where there is a `pull`.
    """
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    N = nx + ny + nz
    L = value[0]
    heavy = len(pull) > 0
    # layout of the tables, see strain_values.py
    weight = 1 + nx * nx + ny * ny + nz * nz + N
    basis = weight + ng + ng * ng
    slack = basis + N * ng
    gaps = slack + 3 * ng
    beyond = gaps + (N + ny * nz + nz * nx + nx * ny) * (ng + 1)
    at = places(N, ng)
    R, v, S, m, f, fields, eta = at.R, at.v, at.S, at.m, at.f, at.fields, at.eta
    _orientations(value, number, inner, gaps, scratch, R, f, at.t)
    _slopes(value, inner, pull, N, ng, slack, beyond, scratch, R, v, S)
    _moments(value, inner, pull, N, ng, weight, beyond, scratch, v, m, f)
    n0, n1, n2 = inner[N], inner[N + 1], inner[N + 2]

    # mode fields psi_i = int R e_c B_i; last index runs over the modes
    for g in range(ng):
        o, T = f + 3 * N * g, R + 9 * g
        for i in range(N):
            c = 0 if i < nx else (1 if i < nx + ny else 2)
            b = L * value[basis + i * ng + g]
            scratch[o + i] = scratch[T + c] * b
            scratch[o + N + i] = scratch[T + 3 + c] * b
            scratch[o + 2 * N + i] = scratch[T + 6 + c] * b
    weighted_rows(
        ng + 1, scratch, fields, 6 * N, 3 * N, value, weight, ng, 1, ng, scratch, f, 3 * N, 1.0, False
    )
    # rho_i = int psi_i x v - S (psi_i x n) = int A psi_i
    A = local_vector(9)
    for g in range(ng):
        o = v + 4 * g
        v0, v1, v2 = L * scratch[o], L * scratch[o + 1], L * scratch[o + 2]
        o = S + 6 * g
        s0, s1, s2 = L * scratch[o], L * scratch[o + 1], L * scratch[o + 2]
        s3, s4, s5 = L * scratch[o + 3], L * scratch[o + 4], L * scratch[o + 5]
        k0, k1, k2 = n0, n1, n2
        if heavy:
            M = value[beyond + g]
            k0, k1, k2 = n0 + M * pull[0], n1 + M * pull[1], n2 + M * pull[2]
        A[0], A[1], A[2] = s1 * k2 - s2 * k1, v2 + s2 * k0 - s0 * k2, s0 * k1 - s1 * k0 - v1
        A[3], A[4], A[5] = s3 * k2 - s4 * k1 - v2, s4 * k0 - s1 * k2, v0 + s1 * k1 - s3 * k0
        A[6], A[7], A[8] = v1 + s4 * k2 - s5 * k1, s5 * k0 - s2 * k2 - v0, s2 * k1 - s4 * k0
        psi = fields + 6 * N * (g + 1)
        weighted_sums(scratch, f + 3 * N * g, N, N, A, 0, 3, 1, 3, scratch, psi, N, 1.0, False)
    weighted_rows(
        ng + 1, scratch, fields + 3 * N, 6 * N, 3 * N, value, weight, ng, 1, ng, scratch, f, 3 * N, 1.0, False
    )
    if heavy:
        for g in range(ng):
            M = value[beyond + g]
            for i in range(3 * N):
                scratch[f + 3 * N * g + i] *= M
        weighted_rows(
            ng + 1, scratch, eta, 3 * N, 3 * N, value, weight, ng, 1, ng, scratch, f, 3 * N, 1.0, False
        )


@kernel
def strain_tangent(value, number, inner, pull, scratch):
    """Residual (N,) and tangent W (N, N) of the amplitudes at fixed end wrench and gravity, into scratch as left by
    `strain_fields`: the upper triangle of W, symmetrised, and the residual as column N + 6 beside it.
    """
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    N = nx + ny + nz
    L = value[0]
    rest = 1 + nx * nx + ny * ny + nz * nz
    weight = rest + N
    basis = weight + ng + ng * ng
    at = places(N, ng)
    R, m, f, fields, W, t, eta = at.R, at.m, at.f, at.fields, at.W, at.t, at.eta
    n0, n1, n2 = inner[N], inner[N + 1], inner[N + 2]
    wide = N + 8
    heavy = len(pull) > 0
    g0 = g1 = g2 = 0.0
    if heavy:
        g0, g1, g2 = pull[0], pull[1], pull[2]
    # g_i = K (a - a0) - L sum w B_i (R e_c).m
    # W = K - sym L sum w B_j (R e_cj).[m x psi_i + (rho_i(L) - rho_i) x n + (eta_i(L) - eta_i) x g]
    # with e.(m x psi) = (e x m).psi and e.(rho x n) = (n x e).rho; here all but the terms at the end, into f
    A = local_vector(18)
    for g in range(ng):
        o = m + 4 * g + 4
        m0, m1, m2 = scratch[o], scratch[o + 1], scratch[o + 2]
        for c in range(3):
            o = R + 9 * g + c
            e0, e1, e2 = scratch[o], scratch[o + 3], scratch[o + 6]
            o = 6 * c
            A[o], A[o + 1], A[o + 2] = e1 * m2 - e2 * m1, e2 * m0 - e0 * m2, e0 * m1 - e1 * m0
            A[o + 3], A[o + 4], A[o + 5] = n2 * e1 - n1 * e2, n0 * e2 - n2 * e0, n1 * e0 - n0 * e1
            # (R e_c).m times the weight, for the residual
            scratch[t + ng * c + g] = L * value[weight + g] * (e0 * m0 + e1 * m1 + e2 * m2)
        to = f + 3 * N * g
        weighted_sums(scratch, to, N, N, A, 0, 6, 1, 6, scratch, fields + 6 * N * (g + 1), N, 1.0, False)
        if heavy:
            for c in range(3):
                o = R + 9 * g + c
                e0, e1, e2 = scratch[o], scratch[o + 3], scratch[o + 6]
                o = 6 * c
                A[o], A[o + 1], A[o + 2] = g2 * e1 - g1 * e2, g0 * e2 - g2 * e0, g1 * e0 - g0 * e1
            weighted_sums(scratch, to, N, N, A, 0, 6, 1, 3, scratch, eta + 3 * N * (g + 1), N, 1.0, True)
        # times the weight of the point
        w = L * value[weight + g]
        for i in range(3 * N):
            scratch[to + i] *= w
    stiff, first = 1, 0
    for c in range(3):
        k = number[c]
        row = W + wide * first
        # - sum B_j P, and the terms at the end: psi_j(L) = L sum w B_j R e_c
        weighted_rows(
            k, scratch, row, wide, N, value, basis + first * ng, ng, 1, ng, scratch, f + c * N, 3 * N, -1.0,
            False,
        )  # fmt: skip
        o = t + 3 * ng
        for i in range(k):
            p = fields + first + i
            e0, e1, e2 = scratch[p], scratch[p + N], scratch[p + 2 * N]
            scratch[o + 3 * i] = n1 * e2 - n2 * e1
            scratch[o + 3 * i + 1] = n2 * e0 - n0 * e2
            scratch[o + 3 * i + 2] = n0 * e1 - n1 * e0
        weighted_rows(k, scratch, row, wide, N, scratch, o, 3, 1, 3, scratch, fields + 3 * N, N, -1.0, True)
        if heavy:
            for i in range(k):
                p = fields + first + i
                e0, e1, e2 = scratch[p], scratch[p + N], scratch[p + 2 * N]
                scratch[o + 3 * i] = g1 * e2 - g2 * e1
                scratch[o + 3 * i + 1] = g2 * e0 - g0 * e2
                scratch[o + 3 * i + 2] = g0 * e1 - g1 * e0
            weighted_rows(k, scratch, row, wide, N, scratch, o, 3, 1, 3, scratch, eta, N, -1.0, True)
        for i in range(k):
            residual = 0.0
            for l in range(k):
                x = value[stiff + i * k + l]
                residual += x * (inner[first + l] - value[rest + first + l])
                scratch[row + wide * i + first + l] += x
            for g in range(ng):
                residual -= value[basis + (first + i) * ng + g] * scratch[t + ng * c + g]
            scratch[row + wide * i + N + 6] = residual
        stiff += k * k
        first += k
    for i in range(N):
        for j in range(i):
            o = W + wide * j + i
            scratch[o] = 0.5 * (scratch[o] + scratch[W + wide * i + j])
