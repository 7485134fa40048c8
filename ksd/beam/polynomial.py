"""A solid body with rigid end faces whose energy is a polynomial of fourth order in its reduced coordinates.

Green-Lagrange strain is quadratic in displacement, so the energy of a displacement-based solid of Saint-Venant-Kirchhoff
material, projected on any basis, is exactly V = K1 y + K2 yy/2 + K3 yyy/6 + K4 yyyy/24: no element is visited any more.
y = (b, eta): b the displacement patterns of the end faces, which are linear in position and rotation columns of
end q and so exact for finite rotations, eta the inner coordinates, condensed here inside every Newton step.

Arrays (float64, SI): `number` = [jets chosen, m, nb, frame]; `value` = nb places among the pose values of
`face_jets`, nb pose values at rest, K1 (M,), K2 (P,), K3 (M, P), K4 (P, P), where P = M (M + 1) / 2 pairs i <= j by
rows; `inner` = eta (m,); `store` as in `ksd.beam.modal`.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.beam.modal import eliminate_inner, to_pose
from ksd.beam.modal_jets import JET, chord_jets, jet_product, pose_jets
from ksd.numerics.kernel import kernel


@kernel
def face_jets(frame, d, Q, out):
    """Pose values (19, 28): frame 0, node frame of end p: d and the columns of Q, the last 7 not used;
    frame 1, chord frame: |d|, columns of p's rotation, columns of q's rotation."""
    D, C = np.empty((3, JET)), np.empty((9, JET))
    pose_jets(d, Q, D, C)
    out[:] = 0.0
    if frame == 0:
        for k in range(JET):
            for r in range(3):
                out[r, k] = D[r, k]
            for r in range(9):
                out[3 + r, k] = C[r, k]
        return
    F = np.empty((9, JET))
    chord_jets(D, F, out[0])
    for r in range(9):
        for k in range(JET):
            out[1 + r, k] = F[r, k]
    for c in range(3):
        for r in range(3):
            for k in range(3):
                jet_product(F[3 * k + r], C[3 * c + k], 1.0, out[10 + 3 * c + r])


@kernel
def quartic(value, M, y, g, G):
    """Gradient g (M,) and tangent G (M, M), lower triangle, of the quartic energy with constants `value` at y (M,)."""
    P = M * (M + 1) // 2
    K1, K2 = value[:M], value[M : M + P]
    K3 = value[M + P : M + P + M * P].reshape(M, P)
    at = M + P + M * P
    K4 = value[at : at + P * P].reshape(P, P)
    third, fourth, pairs = np.zeros(P), np.zeros(P), np.empty(P)
    p = 0
    for i in range(M):
        pairs[p] = y[i] * y[i]
        for j in range(i + 1, M):
            pairs[p + j - i] = 2.0 * y[i] * y[j]
        p += M - i
    for i in range(M):
        w, row = y[i], K3[i]
        for q in range(P):
            third[q] += w * row[q]
    for i in range(P):
        w, row = pairs[i], K4[i]
        if w != 0.0:
            for q in range(P):
                fourth[q] += w * row[q]
    for i in range(M):
        g[i] = K1[i]
    p = 0
    for i in range(M):
        for j in range(i, M):
            G[j, i] = K2[p] + third[p] + 0.5 * fourth[p]
            f = K2[p] + 0.5 * third[p] + fourth[p] / 6.0
            g[i] += f * y[j]
            if j > i:
                g[j] += f * y[i]
            p += 1


@kernel
def polynomial_condense(value, number, inner, store, d, Q, lam, K):
    """Force and moment lam (12,) on end q at d (3,) m, Q (3, 3), and tangent K (6, 6), frame of end p, as every member."""
    m, nb = number[1], number[2]
    M = m + nb
    jets, every = np.empty((nb, JET)), np.empty((19, JET))
    face_jets(number[3] % 2, d, Q, every)
    y, g, G = np.empty(M), np.empty(M), np.empty((M, M))
    for i in range(nb):
        at = int(value[i])
        for k in range(JET):
            jets[i, k] = every[at, k]
        y[i] = jets[i, 0] - value[nb + i]
    for i in range(m):
        y[nb + i] = inner[i]
    quartic(value[2 * nb :], M, y, g, G)
    coupling = np.empty((6, m))
    to_pose(jets, g, G, nb, M, lam, K, coupling)
    negatives, ef, em, failed = eliminate_inner(g, G, nb, m, coupling, store, lam, K)
    return negatives, ef, em, failed if math.isfinite(ef) else 2
