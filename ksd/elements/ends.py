"""The ends of a member: their pose, and the forces and tangent of the member on the two nodes it connects, compiled.

A member depends on the relative pose of its ends only; its wrench (n, m) and stiffness K6 become forces and a symmetric
tangent on nodes a and b. With w the lever from node a to end q, s the lever from node b to end q, all global, the
relative motion is xi = (dxb - dxa + dphi_b x s - dphi_a x w, dphi_b - dphi_a), and the second derivatives of
n.xi_t + m.xi_r in the chart R <- exp(dphi) R are [xa, phia] = [n]x, [xb, phia] = -[n]x, [phib, phia] = n s^T .. see
`geometric_tangent`.

`pose` (18,) of a member: axes of end p (9, row-major), levers w (3) and s (3), and the vector d from p to q (3),
global.
"""

from __future__ import annotations

import math

from ksd.numerics.kernel import kernel


@kernel
def member_pose(node, n, offset, o, frame, f, x, R, pose, Q):
    """Pose of a member whose nodes, offsets and frames (`Members`) start at node[n], offset[o] and frame[f].

    Writes pose (18,) = end frame p (9, row-major), lever w of q about node p, lever s of q about its node, vector d from p
    to q, all global, and Q (3, 3) = orientation of q in frame p.
    """
    a, b = node[n], node[n + 1]
    for r in range(3):
        sp, sq = 0.0, 0.0
        for c in range(3):
            sp += R[a, r, c] * offset[o + c]
            sq += R[b, r, c] * offset[o + 3 + c]
            s = 0.0
            for k in range(3):
                s += R[a, r, k] * frame[f + 3 * k + c]
            pose[3 * r + c] = s
        w = x[b, r] - x[a, r] + sq
        pose[9 + r], pose[12 + r], pose[15 + r] = w, sq, w - sp
    for c in range(3):
        for r in range(3):
            Q[r, c] = 0.0
        for k in range(3):
            t = 0.0
            for l in range(3):
                t += R[b, k, l] * frame[f + 9 + 3 * l + c]
            for r in range(3):
                Q[r, c] += pose[3 * k + r] * t


@kernel(inline="late")
def _rotate_stiffness(pose, K, A, T):
    """Write A (6, 6) = diag(Rp, Rp) K diag(Rp, Rp)^T; T (6, 6 or larger): scratch."""
    for b in (0, 3):
        for r in range(3):
            for c in range(6):
                s = 0.0
                for k in range(3):
                    s += pose[3 * r + k] * K[b + k, c]
                T[b + r, c] = s
    for r in range(6):
        for b in (0, 3):
            for c in range(3):
                s = 0.0
                for k in range(3):
                    s += T[r, b + k] * pose[3 * c + k]
                A[r, b + c] = s


@kernel(inline="late")
def _times_levers(A, pose, M):
    """Write M (6, 12) = A [ -1, [w]x, 1, -[s]x ; 0, -1, 0, 1 ] for A (6, 6); levers w = pose[9:12], s = pose[12:15]."""
    w0, w1, w2, s0, s1, s2 = pose[9], pose[10], pose[11], pose[12], pose[13], pose[14]
    for r in range(6):
        a0, a1, a2, b0, b1, b2 = A[r, 0], A[r, 1], A[r, 2], A[r, 3], A[r, 4], A[r, 5]
        M[r, 0], M[r, 1], M[r, 2] = -a0, -a1, -a2
        M[r, 3], M[r, 4], M[r, 5] = a1 * w2 - a2 * w1 - b0, a2 * w0 - a0 * w2 - b1, a0 * w1 - a1 * w0 - b2
        M[r, 6], M[r, 7], M[r, 8] = a0, a1, a2
        M[r, 9], M[r, 10], M[r, 11] = a2 * s1 - a1 * s2 + b0, a0 * s2 - a2 * s0 + b1, a1 * s0 - a0 * s1 + b2


@kernel(inline="late")
def geometric_tangent(vectors, T):
    """Add the second derivatives of n.xi_t + m.xi_r to T (12, 12), see the module docstring; rows of `vectors`: n, m,
    w, s."""
    nw, ns = 0.0, 0.0
    for i in range(3):
        n, w, s = vectors[0, i], vectors[2, i], vectors[3, i]
        nw += n * w
        ns += n * s
        for j in range(3):
            T[3 + i, 3 + j] += 0.5 * (n * vectors[2, j] + w * vectors[0, j])
            T[9 + i, 9 + j] += 0.5 * (n * vectors[3, j] + s * vectors[0, j])
            # phib, phia: -[s]x [n]x = (n.s) I - n s^T, and -1/2 [m]x from the rotation part
            T[9 + i, 3 + j] -= n * vectors[3, j]
            T[3 + j, 9 + i] -= n * vectors[3, j]
    for i in range(3):
        T[3 + i, 3 + i] -= nw
        T[9 + i, 9 + i] -= ns
        T[9 + i, 3 + i] += ns
        T[3 + i, 9 + i] += ns
        # [n]x has +n_i at (k, j), -n_i at (j, k), i, j, k in turn
        j, k = (i + 1) % 3, (i + 2) % 3
        n, m = vectors[0, i], 0.5 * vectors[1, i]
        T[j, 3 + k] -= n
        T[k, 3 + j] += n
        T[3 + k, j] -= n
        T[3 + j, k] += n
        T[6 + j, 3 + k] += n
        T[6 + k, 3 + j] -= n
        T[3 + k, 6 + j] += n
        T[3 + j, 6 + k] -= n
        T[9 + j, 3 + k] += m
        T[9 + k, 3 + j] -= m
        T[3 + k, 9 + j] += m
        T[3 + j, 9 + k] -= m


@kernel
def member_tangent(pose, lam, K, T, force, A, M):
    """Write the tangent T (12, 12) and forces (12,) of one member on nodes a and b, global axes; A (6, 6), M (6, 12):
    scratch."""
    _rotate_stiffness(pose, K, A, M)
    _times_levers(A, pose, M)
    w0, w1, w2, s0, s1, s2 = pose[9], pose[10], pose[11], pose[12], pose[13], pose[14]
    # T = levers^T M: the same pattern applied to the columns of M
    for c in range(12):
        a0, a1, a2, b0, b1, b2 = M[0, c], M[1, c], M[2, c], M[3, c], M[4, c], M[5, c]
        T[0, c], T[1, c], T[2, c] = -a0, -a1, -a2
        T[3, c], T[4, c], T[5, c] = a1 * w2 - a2 * w1 - b0, a2 * w0 - a0 * w2 - b1, a0 * w1 - a1 * w0 - b2
        T[6, c], T[7, c], T[8, c] = a0, a1, a2
        T[9, c], T[10, c], T[11, c] = a2 * s1 - a1 * s2 + b0, a0 * s2 - a2 * s0 + b1, a1 * s0 - a0 * s1 + b2
    # rows of A, in global axes: wrench of the geometric terms, levers, wrench of the residual
    for r in range(3):
        for e in range(2):
            geometric, residual = 0.0, 0.0
            for c in range(3):
                geometric += pose[3 * r + c] * lam[6 + 3 * e + c]
                residual += pose[3 * r + c] * lam[3 * e + c]
            A[e, r], A[2 + e, r], A[4 + e, r] = geometric, pose[9 + 3 * e + r], residual
    geometric_tangent(A, T)
    for r in range(3):
        j, k = (r + 1) % 3, (r + 2) % 3
        n, m = A[4, r], A[5, r]
        force[r], force[6 + r] = -n, n
        force[3 + r] = -m - (A[2, j] * A[4, k] - A[2, k] * A[4, j])
        force[9 + r] = m + (A[3, j] * A[4, k] - A[3, k] * A[4, j])


@kernel
def member_norms(lam, force, norms):
    """Write norms (6,): of force and moment at end q, of force and moment on node a, and on node b."""
    for k in range(2):
        norms[k] = math.sqrt(lam[3 * k] ** 2 + lam[3 * k + 1] ** 2 + lam[3 * k + 2] ** 2)
    for k in range(4):
        norms[2 + k] = math.sqrt(force[3 * k] ** 2 + force[3 * k + 1] ** 2 + force[3 * k + 2] ** 2)
