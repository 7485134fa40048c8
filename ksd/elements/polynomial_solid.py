"""A solid body with rigid end faces whose energy is a polynomial of fourth order in its reduced coordinates.

Green-Lagrange strain is quadratic in displacement, so the energy of a displacement-based solid of
Saint-Venant-Kirchhoff material, projected on any basis, is exactly V = K1 y + K2 yy/2 + K3 yyy/6 + K4 yyyy/24: no
element is evaluated during a solve. y = (b, eta): b the displacement patterns of the end faces, which are linear in
position and rotation columns of end q and so exact for finite rotations, eta the inner coordinates, condensed here in
every Newton step.

Products y_i y_j form families that are not coupled by the tensors: four for a body symmetric about two planes (even or
odd in each), one for a body without symmetry. Each family is contracted separately, as dense rows.

Arrays (float64, SI): `number` = [0, m, nb, frame]; `value` = nb indices among the pose values of `face_jets`, nb pose
values at rest, K1 (M,), the number of families, and of each: s, p, its s coordinates, first and second indices i <= j
of its p products, K2 (p,), K3 (s, p), K4 (p, p); `inner` = eta (m,); `store` as in `ksd.elements.modal`.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.elements.modal import boundary_to_pose, condense_inner
from ksd.elements.modal_jets import JET, chord_jets, pose_jets, relative_rotation_jets
from ksd.numerics.kernel import kernel


@kernel
def face_jets(frame, d, Q, out):
    """Write pose values (19, 28).

    frame 0, node frame of end p: d and the columns of Q, the last 7 unused; frame 1, chord frame: |d|, columns of p's
    rotation, columns of q's rotation.
    """
    out[:] = 0.0
    if frame == 0:
        pose_jets(d, Q, out[:3], out[3:])
        return
    D, C = np.empty((3, JET)), np.empty((9, JET))
    pose_jets(d, Q, D, C)
    chord_jets(D, out[1:10], out[0])
    relative_rotation_jets(out[1:10], C, out[10:])


@kernel
def add_weighted_rows(table, weights, out):
    """Add weights (rows,) times table (rows, n) to out (n,), four rows per loop; weights and out may be longer."""
    rows, n = table.shape
    r = 0
    while r + 3 < rows:
        a, b, c, d = weights[r], weights[r + 1], weights[r + 2], weights[r + 3]
        A, B, C, D = table[r], table[r + 1], table[r + 2], table[r + 3]
        for q in range(n):
            out[q] += a * A[q] + b * B[q] + c * C[q] + d * D[q]
        r += 4
    while r < rows:
        a, A = weights[r], table[r]
        for q in range(n):
            out[q] += a * A[q]
        r += 1


@kernel
def quartic(value, M, y, g, G):
    """Gradient g (M,) and tangent G (M, M), lower triangle, of the quartic energy with constants `value` at y (M,)."""
    for i in range(M):
        g[i] = value[i]
    family_y, products = np.empty(M), np.empty(M * (M + 1) // 2)
    third, fourth = np.empty(len(products)), np.empty(len(products))
    at = M + 1
    for _ in range(int(value[M])):
        s, p = int(value[at]), int(value[at + 1])
        coordinates_at, first_at = at + 2, at + 2 + s
        second_at, K2 = first_at + p, first_at + 2 * p
        for q in range(s):
            family_y[q] = y[int(value[coordinates_at + q])]
        for q in range(p):
            i, j = int(value[first_at + q]), int(value[second_at + q])
            products[q] = y[i] * y[j] * (2.0 if i < j else 1.0)
            third[q] = fourth[q] = 0.0
        K3, K4 = K2 + p, K2 + p + s * p
        add_weighted_rows(value[K3:K4].reshape(s, p), family_y, third)
        add_weighted_rows(value[K4 : K4 + p * p].reshape(p, p), products, fourth)
        for q in range(p):
            i, j = int(value[first_at + q]), int(value[second_at + q])
            G[j, i] = value[K2 + q] + third[q] + 0.5 * fourth[q]
            f = value[K2 + q] + 0.5 * third[q] + fourth[q] / 6.0
            g[i] += f * y[j]
            if j > i:
                g[j] += f * y[i]
        at = K4 + p * p


@kernel
def polynomial_condense(value, number, inner, store, d, Q, lam, K):
    """Force and moment lam (12,) on end q at d (3,) [m], Q (3, 3), and tangent K (6, 6), frame of end p, as every
    member."""
    m, nb = number[1], number[2]
    M = m + nb
    jets, all_pose_jets = np.empty((nb, JET)), np.empty((19, JET))
    face_jets(number[3] % 2, d, Q, all_pose_jets)
    y, g, G = np.empty(M), np.empty(M), np.empty((M, M))
    for i in range(nb):
        at = int(value[i])
        for k in range(JET):
            jets[i, k] = all_pose_jets[at, k]
        y[i] = jets[i, 0] - value[nb + i]
    for i in range(m):
        y[nb + i] = inner[i]
    quartic(value[2 * nb :], M, y, g, G)
    coupling = np.empty((6, m))
    boundary_to_pose(jets, g, G, nb, M, lam, K, coupling)
    negatives, ef, em, failed = condense_inner(g, G, nb, m, coupling, store, lam, K)
    return negatives, ef, em, failed if math.isfinite(ef) else 2
