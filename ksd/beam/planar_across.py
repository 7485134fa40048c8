"""Stiffness of a strain-mode leaf across the plane it is bent in: torsion and bending about its strong axis.

In a planar state these modes are not coupled with those in the plane, so that a wide leaf's stability asks for nx + ny of
its modes and three motions of end q: displacement along the normal, rotations about both axes in the plane. The same
equations and quadrature as in `ksd.beam.strain`, where every orientation is a turn by theta about the normal: curvature
modes a have the axes e = (cos, sin) for torsion and (-sin, cos) for bending, and with psi' = e B, rho' = psi_1 (v_2 - S n_2)
- psi_2 (v_1 - S n_1), S = 1/(kz G A),

W = K - sym L sum w B_j e_j . [m (-psi_2, psi_1)_i + (rho_i(L) - rho_i) (-n_2, n_1)],  F = J W^-1 J^T + L sum w S,

J = (rho(L), psi(L)). `value`: L; angle per amplitude in the plane at the points and end q (nz, l); weight times L (l); 1/EA,
1/(ky G A), 1/(kz G A) (3, l); integration matrix (ng, l); torsion modes, then strong bending ones, (2, ng, M); K (M, M).
`number` = [nz, points, modes across]; l and M: points + 1 and modes rounded up to fours.
"""

from __future__ import annotations

import numpy as np

from ksd.beam.strain_points import tables
from ksd.numerics.kernel import kernel
from ksd.numerics.lanes import load4, store4
from ksd.numerics.local import local_matrix
from ksd.numerics.rotations import cosine_sine
from ksd.numerics.sums import weighted_rows

TINY = 1e-12
"""A pivot below this fraction of its diagonal is nearly zero."""


def across_values(value: np.ndarray, number: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(value, number) of a leaf without weight, from its constants `value` and `number` in space."""
    nx, ny, nz, ng = (int(n) for n in number[:4])
    N, m = nx + ny + nz, nx + ny
    l, M = (ng + 4) & -4, (m + 3) & -4
    at, length = tables(nx, ny, nz, ng), float(value[0])
    gap = value[at.gaps : at.gaps + N * (ng + 1)].reshape(N, ng + 1)[m:]
    angle, lanes, slack = np.zeros((nz, l)), np.zeros(l), np.zeros((3, l))
    angle[:, : ng + 1] = length * np.cumsum(gap, axis=1)
    lanes[:ng] = length * value[at.weight : at.weight + ng]
    slack[:, :ng] = value[at.slack : at.slack + 3 * ng].reshape(ng, 3).T
    basis = value[at.basis : at.basis + N * ng].reshape(N, ng)
    modes, stiff = np.zeros((2, ng, M)), np.eye(M)
    modes[0, :, :nx], modes[1, :, nx:m] = basis[:nx].T, basis[nx:m].T
    stiff[:nx, :nx] = value[1 : 1 + nx * nx].reshape(nx, nx)
    stiff[nx:m, nx:m] = value[1 + nx * nx : 1 + nx * nx + ny * ny].reshape(ny, ny)
    sums = value[at.sums : at.sums + ng * l]
    parts = [value[:1], angle.ravel(), lanes, slack.ravel(), sums, modes.ravel(), stiff.ravel()]
    return np.concatenate(parts), np.array([nz, ng, m, 0], np.int64)


def across_scratch(number: np.ndarray) -> int:
    """Numbers of scratch `across` needs."""
    ng, m = int(number[1]), int(number[2])
    l, M = (ng + 4) & -4, (m + 3) & -4
    return 10 * l + 4 * ng * M + 3 * (ng + 1) * M + M * (M + 4)


@kernel
def _points(value, number, inner, n0, n1, m2, scratch):
    """Places of a leaf's points: cos, sin (2, l), v less S n (2, l) and moment times L and weight (l), from scratch on."""
    nz, ng = number[0], number[1]
    l, L = (ng + 4) & -4, value[0]
    wide = 1 + nz * l
    slack, sums = wide + l, wide + 4 * l
    # theta in place of the cosines, v beside the places r
    v, r = 6 * l, 8 * l
    weighted_rows(
        number, scratch, 0, inner, 0, value, 1, 0, 0, 0, 0, 1, 0, l, 1,
        1, nz, l, 1.0, False,
    )  # fmt: skip
    for o in range(0, l, 4):
        c, s = cosine_sine(load4(scratch, o))
        N, V = c * n0 + s * n1, c * n1 - s * n0
        a, b = 1.0 + load4(value, slack + o) * N, load4(value, slack + l + o) * V
        x, y, z = c * a - s * b, s * a + c * b, load4(value, slack + 2 * l + o)
        store4(scratch, o, c)
        store4(scratch, l + o, s)
        store4(scratch, v + o, x)
        store4(scratch, v + l + o, y)
        store4(scratch, 2 * l + o, x - z * n0)
        store4(scratch, 3 * l + o, y - z * n1)
    weighted_rows(
        number, scratch, r, scratch, v, value, sums, 0, l, 0, l, 1, 0, l, 1, 2, ng, l, L,
        False,
    )  # fmt: skip
    x, y = scratch[r + ng], scratch[r + l + ng]
    for o in range(0, l, 4):
        m = m2 + (x - load4(scratch, r + o)) * n1 - (y - load4(scratch, r + l + o)) * n0
        store4(scratch, 4 * l + o, load4(value, wide + o) * m)


@kernel
def _modes(value, number, n0, n1, scratch, D, psi, rho, W):
    """Modes from what `_points` left: psi (ng + 1, 2, M), rho (ng + 1, M), and W (M, M + 4) less K, not symmetric."""
    nz, ng = number[0], number[1]
    l, M, L = (ng + 4) & -4, (number[2] + 3) & -4, value[0]
    sums = 1 + nz * l + 4 * l
    modes, f = sums + ng * l, rho + (ng + 1) * M
    for g in range(ng):
        c, s = scratch[g], scratch[l + g]
        for i in range(0, M, 4):
            x, y = load4(value, modes + g * M + i), load4(value, modes + (ng + g) * M + i)
            store4(scratch, D + 2 * g * M + i, c * x - s * y)
            store4(scratch, D + 2 * g * M + M + i, s * x + c * y)
    weighted_rows(
        number, scratch, psi, value, sums, scratch, D, 0, 2 * M, 0, 1, l, 0, 2 * M, 1, ng + 1, ng,
        2 * M, L, False,
    )  # fmt: skip
    for g in range(ng):
        a, b = scratch[2 * l + g], scratch[3 * l + g]
        for i in range(0, M, 4):
            p = psi + 2 * g * M + i
            store4(scratch, f + g * M + i, b * load4(scratch, p) - a * load4(scratch, p + M))
    weighted_rows(
        number, scratch, rho, value, sums, scratch, f, 0, M, 0, 1, l, 0, M, 1, ng + 1, ng, M, L,
        False,
    )  # fmt: skip
    for g in range(ng):
        w, q = value[1 + nz * l + g], scratch[4 * l + g]
        for i in range(0, M, 4):
            p, o = psi + 2 * g * M + i, f + 2 * g * M + i
            far = w * (load4(scratch, rho + ng * M + i) - load4(scratch, rho + g * M + i))
            store4(scratch, o, -q * load4(scratch, p + M) - n1 * far)
            store4(scratch, o + M, q * load4(scratch, p) + n0 * far)
    weighted_rows(
        number, scratch, W, scratch, D, scratch, f, 0, M + 4, 0, 1, M, 0, M, 1, M, 2 * ng, M, -1.0,
        False,
    )  # fmt: skip


@kernel
def _eliminated(scratch, W, stiff, value, M, F):
    """F (3, 3) += J W^-1 J^T, W (M, M) less K with J^T (M, 4) beside it. Returns (negative pivots, whether none is tiny)."""
    negatives, sound, wide = 0, True, M + 4
    for i in range(M):
        for j in range(i, M):
            x = value[stiff + i * M + j] + 0.5 * (scratch[W + i * wide + j] + scratch[W + j * wide + i])
            scratch[W + i * wide + j] = x
    for j in range(M):
        o = W + j * wide
        d = scratch[o + j]
        sound = sound and abs(d) > TINY * value[stiff + j * M + j]
        negatives += d < 0.0
        inverse = 1.0 / d
        a, b, c = scratch[o + M], scratch[o + M + 1], scratch[o + M + 2]
        F[0, 0] += a * a * inverse
        F[1, 0] += b * a * inverse
        F[1, 1] += b * b * inverse
        F[2, 0] += c * a * inverse
        F[2, 1] += c * b * inverse
        F[2, 2] += c * c * inverse
        for i in range(j + 1, M):
            t, p = scratch[o + i] * inverse, W + i * wide
            # by fours from the diagonal on; what is left of it is read no more
            for k in range(i & -4, wide, 4):
                store4(scratch, p + k, load4(scratch, p + k) - t * load4(scratch, o + k))
    return negatives, sound


@kernel
def _inverse(F, K):
    """K (3, 3) = F^-1, F by its lower triangle. Returns (negative pivots, whether none is nearly zero)."""
    d0 = F[0, 0]
    a, b = F[1, 0] / d0, F[2, 0] / d0
    d1 = F[1, 1] - a * F[1, 0]
    e = F[2, 1] - b * F[1, 0]
    c = e / d1
    d2 = F[2, 2] - b * F[2, 0] - c * e
    # rows of the inverse of the unit triangle: (1), (-a, 1), (a c - b, -c, 1)
    u = a * c - b
    i0, i1, i2 = 1.0 / d0, 1.0 / d1, 1.0 / d2
    K[0, 0] = i0 + a * a * i1 + u * u * i2
    K[1, 0] = K[0, 1] = -a * i1 - c * u * i2
    K[1, 1] = i1 + c * c * i2
    K[2, 0] = K[0, 2] = u * i2
    K[2, 1] = K[1, 2] = -c * i2
    K[2, 2] = i2
    sound = abs(d0) > 0.0 and abs(d1) > TINY * abs(F[1, 1]) and abs(d2) > TINY * abs(F[2, 2])
    return (d0 < 0.0) + (d1 < 0.0) + (d2 < 0.0), sound


@kernel
def across(value, number, inner, share, scratch, K):
    """K (3, 3) [N/m, N, Nm] against displacement of end q along e3 and its rotations about e1 and e2 of end p.

    inner: of the leaf in the plane, its wrench `share` of what is written there. Returns (negative pivots of W minus those
    of F, whether no pivot is nearly zero); where one is, K means nothing.
    """
    nz, ng = number[0], number[1]
    l, M = (ng + 4) & -4, (number[2] + 3) & -4
    n0, n1, m2 = share * inner[nz], share * inner[nz + 1], share * inner[nz + 2]
    D = 10 * l
    psi = D + 2 * ng * M
    rho = psi + (ng + 1) * 2 * M
    W = rho + (ng + 1) * M + 2 * ng * M
    wide = 1 + nz * l
    stiff = wide + 4 * l + ng * l + 2 * ng * M
    _points(value, number, inner, n0, n1, m2, scratch)
    _modes(value, number, n0, n1, scratch, D, psi, rho, W)
    for i in range(M):
        o, p = W + i * (M + 4) + M, psi + 2 * ng * M + i
        scratch[o], scratch[o + 1], scratch[o + 2] = scratch[rho + ng * M + i], scratch[p], scratch[p + M]
        scratch[o + 3] = 0.0
    F = local_matrix(3, 3)
    F[0, 0] = F[1, 0] = F[1, 1] = F[2, 0] = F[2, 1] = F[2, 2] = 0.0
    for g in range(ng):
        F[0, 0] += value[wide + g] * value[wide + 3 * l + g]
    negatives, sound = _eliminated(scratch, W, stiff, value, M, F)
    back, fine = _inverse(F, K)
    return negatives - back, sound and fine
