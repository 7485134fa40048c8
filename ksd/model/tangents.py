"""What a member does to the two nodes it hangs on, compiled.

A member sees only the relative pose of its ends; this file turns its wrench (n, m) and stiffness K6 into forces
and a symmetric tangent on the two nodes its ends hang on. With w the lever from node a to end q, s the lever from
node b to end q, all global, the relative motion is xi = (dxb - dxa + dphi_b x s - dphi_a x w, dphi_b - dphi_a),
and the second derivatives of n.xi_t + m.xi_r in the chart R <- exp(dphi) R are
[xa, phia] = [n]x, [xb, phia] = -[n]x, [phib, phia] = n s^T .. see `geometric_tangent`.
"""

from __future__ import annotations

import math

from ksd.numerics.kernel import kernel


@kernel
def _turn_stiffness(pose, K, A, T):
    """A (6, 6) = diag(Rp, Rp) K diag(Rp, Rp)^T; T (6, 6 or more): scratch."""
    for b in range(2):
        for r in range(3):
            for c in range(6):
                T[3 * b + r, c] = (
                    pose[3 * r] * K[3 * b, c]
                    + pose[3 * r + 1] * K[3 * b + 1, c]
                    + pose[3 * r + 2] * K[3 * b + 2, c]
                )
    for r in range(6):
        for b in range(2):
            for c in range(3):
                A[r, 3 * b + c] = (
                    T[r, 3 * b] * pose[3 * c]
                    + T[r, 3 * b + 1] * pose[3 * c + 1]
                    + T[r, 3 * b + 2] * pose[3 * c + 2]
                )


@kernel
def _times_levers(A, w, s, M):
    """M (rows, 12) = A [ -1, [w]x, 1, -[s]x ; 0, -1, 0, 1 ] for A (rows, 6)."""
    for r in range(A.shape[0]):
        a0, a1, a2 = A[r, 0], A[r, 1], A[r, 2]
        M[r, 0], M[r, 1], M[r, 2] = -a0, -a1, -a2
        M[r, 3] = a1 * w[2] - a2 * w[1] - A[r, 3]
        M[r, 4] = a2 * w[0] - a0 * w[2] - A[r, 4]
        M[r, 5] = a0 * w[1] - a1 * w[0] - A[r, 5]
        M[r, 6], M[r, 7], M[r, 8] = a0, a1, a2
        M[r, 9] = a2 * s[1] - a1 * s[2] + A[r, 3]
        M[r, 10] = a0 * s[2] - a2 * s[0] + A[r, 4]
        M[r, 11] = a1 * s[0] - a0 * s[1] + A[r, 5]


@kernel
def geometric_tangent(n, m, w, s, T):
    """Add the second derivatives of n.xi_t + m.xi_r (levers w, s) to T (12, 12); see the module docstring."""
    nw = n[0] * w[0] + n[1] * w[1] + n[2] * w[2]
    ns = n[0] * s[0] + n[1] * s[1] + n[2] * s[2]
    for i in range(3):
        for j in range(3):
            T[3 + i, 3 + j] += 0.5 * (n[i] * w[j] + w[i] * n[j])
            T[9 + i, 9 + j] += 0.5 * (n[i] * s[j] + s[i] * n[j])
            # phib, phia: -[s]x [n]x = (n.s) I - n s^T, and -1/2 [m]x from the rotation part
            T[9 + i, 3 + j] -= n[i] * s[j]
            T[3 + j, 9 + i] -= n[i] * s[j]
        T[3 + i, 3 + i] -= nw
        T[9 + i, 9 + i] -= ns
        T[9 + i, 3 + i] += ns
        T[3 + i, 9 + i] += ns
        j, k = (i + 1) % 3, (i + 2) % 3
        # [n]x has +n_k at (j, i)... written by cyclic entries (i, j) = -n_k, (j, i) = n_k
        T[i, 3 + j] -= n[k]
        T[j, 3 + i] += n[k]
        T[3 + j, i] -= n[k]
        T[3 + i, j] += n[k]
        T[6 + i, 3 + j] += n[k]
        T[6 + j, 3 + i] -= n[k]
        T[3 + j, 6 + i] += n[k]
        T[3 + i, 6 + j] -= n[k]
        T[9 + i, 3 + j] += 0.5 * m[k]
        T[9 + j, 3 + i] -= 0.5 * m[k]
        T[3 + j, 9 + i] += 0.5 * m[k]
        T[3 + i, 9 + j] -= 0.5 * m[k]


@kernel
def member_tangent(pose, lam, K, T, force, A, M):
    """Node tangent T (12, 12) and forces (12,) on nodes a, b of one member, global axes; A (6, 6), M (6, 12): scratch."""
    _turn_stiffness(pose, K, A, M)
    w, s = pose[9:12], pose[12:15]
    _times_levers(A, w, s, M)
    # T = levers^T M: the same pattern applied to the columns of M
    for c in range(12):
        a0, a1, a2 = M[0, c], M[1, c], M[2, c]
        T[0, c], T[1, c], T[2, c] = -a0, -a1, -a2
        T[3, c] = a1 * w[2] - a2 * w[1] - M[3, c]
        T[4, c] = a2 * w[0] - a0 * w[2] - M[4, c]
        T[5, c] = a0 * w[1] - a1 * w[0] - M[5, c]
        T[6, c], T[7, c], T[8, c] = a0, a1, a2
        T[9, c] = a2 * s[1] - a1 * s[2] + M[3, c]
        T[10, c] = a0 * s[2] - a2 * s[0] + M[4, c]
        T[11, c] = a1 * s[0] - a0 * s[1] + M[5, c]
    n, m = M[0], M[1]
    for r in range(3):
        n[r] = pose[3 * r] * lam[6] + pose[3 * r + 1] * lam[7] + pose[3 * r + 2] * lam[8]
        m[r] = pose[3 * r] * lam[9] + pose[3 * r + 1] * lam[10] + pose[3 * r + 2] * lam[11]
    geometric_tangent(n, m, w, s, T)
    for r in range(3):
        n[r] = pose[3 * r] * lam[0] + pose[3 * r + 1] * lam[1] + pose[3 * r + 2] * lam[2]
        m[r] = pose[3 * r] * lam[3] + pose[3 * r + 1] * lam[4] + pose[3 * r + 2] * lam[5]
    for r in range(3):
        j, k = (r + 1) % 3, (r + 2) % 3
        force[r] = -n[r]
        force[3 + r] = -m[r] - (w[j] * n[k] - w[k] * n[j])
        force[6 + r] = n[r]
        force[9 + r] = m[r] + (s[j] * n[k] - s[k] * n[j])


@kernel
def member_norms(lam, force, norms):
    """norms (6,): of force and moment at end q, of force and moment on node a, and on node b."""
    for k in range(3):
        row = lam if k == 0 else force
        o = 0 if k == 0 else 6 * (k - 1)
        norms[2 * k] = math.sqrt(row[o] * row[o] + row[o + 1] * row[o + 1] + row[o + 2] * row[o + 2])
        norms[2 * k + 1] = math.sqrt(
            row[o + 3] * row[o + 3] + row[o + 4] * row[o + 4] + row[o + 5] * row[o + 5]
        )


@kernel
def scatter(keep, block, T, force, rhs, starts, value):
    """Add T (12, 12) to the stored blocks (pp, qq, coupling, flipped) and force (12,) to the residual, of the unknowns
    `keep` (w,) of every node."""
    w = len(keep)
    for e in range(2):
        if block[e] >= 0:
            o, u = 6 * e, starts[e]
            for r in range(w):
                rhs[u + r] += force[o + keep[r]]
                for c in range(w):
                    value[block[e] + w * r + c] += T[o + keep[r], o + keep[c]]
    couple(keep, block[2], block[3], T, value)


@kernel
def couple(keep, at, flipped, T, value):
    """Add the coupling of T (12, 12) to the block stored from `at` on, whose rows are of the first node where flipped."""
    w = len(keep)
    if at >= 0:
        for r in range(w):
            for c in range(w):
                if flipped == 1:
                    value[at + w * r + c] += T[keep[r], 6 + keep[c]]
                else:
                    value[at + w * r + c] += T[6 + keep[r], keep[c]]
