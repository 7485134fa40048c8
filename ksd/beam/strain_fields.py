"""Fields of the strain-mode leaf at its quadrature points, and the tangent of its inner unknowns.

Both the equilibrium (`ksd.beam.strain`) and the mass and buckling questions (`ksd.beam.strain_mass`) read
them here, so that all stand on the same equations. Notation and sources: see `ksd.beam.strain`; where things sit
and what happens at the points: `ksd.beam.strain_points`.

A leaf with weight has line mass mu [kg/m] in gravity g [m/s^2], in frame p; its tables end with M(s) = int_s^L
mu. Then the force is n(s) = n + M g, the moment m(s) = m + int_s^L v x n(s), which by parts is m + (r(L) -
r(s)) x n + (h(L) - h(s)) x g with h = int M v; h(L) is the first moment of the mass about end p, and eta_i =
int M rho_i' its derivative by the amplitudes. `pull` holds g, and is empty for a leaf without weight.
"""

from __future__ import annotations

from ksd.beam.strain_points import (
    places,
    point_matrices,
    point_moments,
    point_orientations,
    point_slopes,
    tables,
)
from ksd.numerics.kernel import kernel
from ksd.numerics.lanes import load4, spread, store4, transpose4
from ksd.numerics.sums import weighted_rows


@kernel(forceinline=True)
def strain_fields(value, number, inner, pull, scratch):
    """Fields of a leaf with inner state `inner` = (a (N,), n (3,), m (3,)), in frame p, into scratch (see
    `ksd.beam.strain_points`).

    R: orientation at the points and at end q; v = r'; S = R C R^T (xx, xy, xz, yy, yz, zz) [1/N]; r: places [m]; m:
    moment [Nm]; psi, rho: rotation and displacement per unit amplitude at fixed n, at the points and at end q; eta:
    see the module docstring, only where there is a `pull`; carry, couple, work: see `point_matrices`.
    """
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    N = nx + ny + nz
    M, lanes = (N + 3) & -4, (ng + 4) & -4
    heavy = len(pull) > 0
    of, at = tables(nx, ny, nz, ng), places(N, ng)
    f, psi = at.f, at.fields + 3 * M
    point_orientations(value, number, inner, of.gaps, scratch, at.R, at.couple, at.carry, at.t)
    point_slopes(value, inner, pull, N, lanes, of.slack, of.beyond, scratch, at.R, at.v, at.S)
    point_moments(value, number, inner, pull, N, ng, of.sums, of.beyond, scratch, at.v, at.r, at.m, at.couple)
    point_matrices(value, inner, pull, N, lanes, of.weight, of.beyond, scratch, at)
    # mode fields psi_i = int R e_c B_i: first the integrand at every point
    weighted_rows(
        number, scratch, f, scratch, at.R, value, of.masked, 3 * M, M, 1, 3 * lanes, lanes, M, lanes * M, ng, 3, 3, M,
        value[0], False,
    )  # fmt: skip
    weighted_rows(
        number, scratch, psi, value, of.sums, scratch, f, 0, 6 * M, 0, 1, lanes, 0, 3 * M, 1, ng + 1, ng, 3 * M, 1.0,
        False,
    )  # fmt: skip
    # rho_i = int psi_i x v - S (psi_i x n) = int A psi_i
    weighted_rows(
        number, scratch, f, scratch, at.carry, scratch, psi, 3 * M, M, 1, 3 * lanes, lanes, 6 * M, M, ng, 3, 3, M,
        1.0, False,
    )  # fmt: skip
    weighted_rows(
        number, scratch, at.fields, value, of.sums, scratch, f, 0, 6 * M, 0, 1, lanes, 0, 3 * M, 1, ng + 1, ng, 3 * M,
        1.0, False,
    )  # fmt: skip
    if heavy:
        for g in range(ng):
            for i in range(3 * M):
                scratch[f + 3 * M * g + i] *= value[of.beyond + g]
        weighted_rows(
            number, scratch, at.eta, value, of.sums, scratch, f, 0, 3 * M, 0, 1, lanes, 0, 3 * M, 1, ng + 1, ng,
            3 * M, 1.0, False,
        )  # fmt: skip


@kernel(forceinline=True)
def _gravity_couplings(value, pull, lanes, weight, scratch, R, couple):
    """-g x e_c times L and the weight of the point, as the first rows of couple; see `point_matrices`."""
    for o in range(0, lanes, 4):
        w = value[0] * load4(value, weight + o)
        for c in range(3):
            p = R + c * lanes + o
            e0, e1, e2 = (
                w * load4(scratch, p),
                w * load4(scratch, p + 3 * lanes),
                w * load4(scratch, p + 6 * lanes),
            )
            p = couple + 6 * c * lanes + o
            store4(scratch, p, e1 * pull[2] - e2 * pull[1])
            store4(scratch, p + lanes, e2 * pull[0] - e0 * pull[2])
            store4(scratch, p + 2 * lanes, e0 * pull[1] - e1 * pull[0])


@kernel(forceinline=True)
def _crossed(scratch, x0, x1, x2, psi, M, to):
    """x cross psi_i of all modes, from `to` on (3, M)."""
    for i in range(0, M, 4):
        p = psi + i
        e0, e1, e2 = load4(scratch, p), load4(scratch, p + M), load4(scratch, p + 2 * M)
        store4(scratch, to + i, x1 * e2 - x2 * e1)
        store4(scratch, to + M + i, x2 * e0 - x0 * e2)
        store4(scratch, to + 2 * M + i, x0 * e1 - x1 * e0)


@kernel(forceinline=True)
def _moment_rows(value, number, basis, first, count, scratch, f, W):
    """Rows of W of one axis, - sum B_j P; P (ng, M), 3 M apart, from f on."""
    ng = number[3]
    M = (number[0] + number[1] + number[2] + 3) & -4
    wide = M + 8
    weighted_rows(
        number, scratch, W + wide * first, value, basis + first * ng, scratch, f, 0, wide, 0, ng, 1, 0, 3 * M, 1,
        count, ng, M, -1.0, False,
    )  # fmt: skip


@kernel(forceinline=True)
def strain_tangent(value, number, inner, pull, scratch):
    """Residual (N,) and tangent W (N, N) of the amplitudes at fixed end wrench and gravity, into scratch as left by
    `strain_fields`: the upper triangle of W, symmetrised, and the residual from t on (M: N rounded up to fours, for
    which W is 1). Changes `couple`.
    """
    nx, ny, nz, ng = number[0], number[1], number[2], number[3]
    N = nx + ny + nz
    M, lanes = (N + 3) & -4, (ng + 4) & -4
    wide = M + 8
    of, at = tables(nx, ny, nz, ng), places(N, ng)
    f, fields, W, t = at.f, at.fields, at.W, at.t
    heavy = len(pull) > 0
    # g_i = K (a - a0) - L sum w B_i (R e_c).m
    # W = K - sym L sum w B_j (R e_cj).[m x psi_i + (rho_i(L) - rho_i) x n + (eta_i(L) - eta_i) x g]
    # with e.(m x psi) = (e x m).psi and e.(rho x n) = (n x e).rho; here all but the terms at the end, into f
    weighted_rows(
        number, scratch, f, scratch, at.couple, scratch, fields, 3 * M, M, 1, 6 * lanes, lanes, 6 * M, M, ng, 3, 6, M,
        1.0, False,
    )  # fmt: skip
    if heavy:
        _gravity_couplings(value, pull, lanes, of.weight, scratch, at.R, at.couple)
        weighted_rows(
            number, scratch, f, scratch, at.couple, scratch, at.eta, 3 * M, M, 1, 6 * lanes, lanes, 3 * M, M, ng, 3,
            3, M, 1.0, True,
        )  # fmt: skip
    # rows without a mode
    for i in range(N, M):
        for j in range(0, M, 4):
            store4(scratch, W + wide * i + j, spread(0.0))
    # - sum B_j P
    _moment_rows(value, number, of.basis, 0, nx, scratch, f, W)
    _moment_rows(value, number, of.basis, nx, ny, scratch, f + M, W)
    _moment_rows(value, number, of.basis, nx + ny, nz, scratch, f + 2 * M, W)
    # the terms at the end: psi_j(L) = L sum w B_j R e_c
    end = fields + 6 * M * ng
    u = t + M
    _crossed(scratch, inner[N], inner[N + 1], inner[N + 2], end + 3 * M, M, u)
    weighted_rows(
        number, scratch, W, scratch, u, scratch, end, 0, wide, 0, 1, M, 0, M, 1, N, 3, M, -1.0, True,
    )  # fmt: skip
    if heavy:
        _crossed(scratch, pull[0], pull[1], pull[2], end + 3 * M, M, u)
        eta = at.eta + 3 * M * ng
        weighted_rows(
            number, scratch, W, scratch, u, scratch, eta, 0, wide, 0, 1, M, 0, M, 1, N, 3, M, -1.0, True,
        )  # fmt: skip
    # the residual: (R e_c).m times the weight is `work`
    for i in range(0, M, 4):
        store4(scratch, u + i, load4(inner, i) - load4(value, of.rest + i))
    weighted_rows(
        number, scratch, t, scratch, at.work, value, of.masked, 0, 0, 0, 0, 1, 0, M, 1, 1, 3 * lanes, M, -1.0, False,
    )  # fmt: skip
    weighted_rows(number, scratch, t, scratch, u, value, of.stiff, 0, 0, 0, 0, 1, 0, M, 1, 1, N, M, 1.0, True)
    _symmetrise(scratch, W, M, value, of.stiff)


@kernel(forceinline=True)
def _symmetrise(scratch, W, M, value, stiff):
    """W (M, M + 8) <- K + (W + W^T) / 2 in the fours of its upper triangle, K (M, M) from `stiff` on in value."""
    wide = M + 8
    for p in range(0, M, 4):
        for q in range(p, M, 4):
            o, k = W + wide * q + p, stiff + M * p + q
            a, b, c, d = transpose4(
                load4(scratch, o),
                load4(scratch, o + wide),
                load4(scratch, o + 2 * wide),
                load4(scratch, o + 3 * wide),
            )
            o = W + wide * p + q
            a = 0.5 * (a + load4(scratch, o)) + load4(value, k)
            b = 0.5 * (b + load4(scratch, o + wide)) + load4(value, k + M)
            c = 0.5 * (c + load4(scratch, o + 2 * wide)) + load4(value, k + 2 * M)
            d = 0.5 * (d + load4(scratch, o + 3 * wide)) + load4(value, k + 3 * M)
            store4(scratch, o, a)
            store4(scratch, o + wide, b)
            store4(scratch, o + 2 * wide, c)
            store4(scratch, o + 3 * wide, d)
