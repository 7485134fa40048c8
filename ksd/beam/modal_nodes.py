"""Nodes of a modal body: from its values to pose and spin, and one element between two of them.

A node has 3 positions and either 3 rotation-vector values psi (`angle`: R = exp(psi) R0) or 6 director values: two
vectors a, b, from which R follows by Gram-Schmidt, so that their span need not be orthonormal. In director values
an unstretched, unsheared leaf has r' = a, a linear relation which a linear span can hold; in angles it has not, and
refining the mesh makes a reduced leaf stiffer (errata, paper 2, points 2 and 3).
"""

from __future__ import annotations

import math

import numpy as np

from ksd.beam.corotational import condense
from ksd.beam.corotational_element import KEPT, TAIL
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_exp


@kernel
def _spin_coefficients(t2):
    """A = (1 - cos t)/t^2, B = (t - sin t)/t^3 and their derivatives by t, over t."""
    if t2 < 0.04:
        A = 0.5 - t2 * (1 / 24 - t2 * (1 / 720 - t2 / 40320))
        B = 1 / 6 - t2 * (1 / 120 - t2 * (1 / 5040 - t2 / 362880))
        return A, B, -1 / 12 + t2 * (1 / 180 - t2 / 6720), -1 / 60 + t2 * (1 / 1260 - t2 / 60480)
    t = math.sqrt(t2)
    c, s = math.cos(t), math.sin(t)
    A, B = (1.0 - c) / t2, (t - s) / (t2 * t)
    return A, B, (s / t - 2.0 * A) / t2, ((1.0 - c) / t2 - 3.0 * B) / t2


@kernel
def _angle_node(v, R0, R, W):
    """R = exp(v) R0 and spin W (3, 3): dphi = W dv."""
    turned = np.empty((3, 3))
    rotation_exp(v, turned)
    for r in range(3):
        for c in range(3):
            R[r, c] = turned[r, 0] * R0[3 * c] + turned[r, 1] * R0[3 * c + 1] + turned[r, 2] * R0[3 * c + 2]
    A, B, _, _ = _spin_coefficients(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    t2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    for r in range(3):
        i, j = (r + 1) % 3, (r + 2) % 3
        for c in range(3):
            W[r, c] = B * v[r] * v[c]
        W[r, r] += 1.0 - B * t2
        W[r, i] -= A * v[j]
        W[r, j] += A * v[i]


@kernel
def _angle_curvature(v, m, H):
    """H (3, 3): second derivatives of m . phi by v, phi the rotation vector of the increment of exp(v)."""
    t2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    _, B, A1, B1 = _spin_coefficients(t2)
    mv = m[0] * v[0] + m[1] * v[1] + m[2] * v[2]
    for r in range(3):
        for c in range(3):
            H[r, c] = 0.0
    for r in range(3):
        i, j = (r + 1) % 3, (r + 2) % 3
        # gradient of A m.(v x d) + B m.(v (v.d) - d t2) by d, at fixed A and B
        turning = m[i] * v[j] - m[j] * v[i]
        double = mv * v[r] - m[r] * t2
        for c in range(3):
            w = v[c] * (A1 * turning + B1 * double)
            w += B * (0.5 * (m[c] * v[r] + m[r] * v[c]) - 2.0 * m[r] * v[c])
            H[r, c] += 0.5 * w
            H[c, r] += 0.5 * w
        H[r, r] += B * mv


@kernel
def _director_node(z, R, W):
    """R (3, 3) by Gram-Schmidt from a = z[:3], b = z[3:6], and spin W (3, 6). Returns |a|, b.e1, |b across|."""
    alpha = math.sqrt(z[0] * z[0] + z[1] * z[1] + z[2] * z[2])
    beta = 0.0
    for r in range(3):
        R[r, 0] = z[r] / alpha
        beta += z[3 + r] * R[r, 0]
    across = 0.0
    for r in range(3):
        R[r, 1] = z[3 + r] - beta * R[r, 0]
        across += R[r, 1] * R[r, 1]
    across = math.sqrt(across)
    for r in range(3):
        R[r, 1] /= across
    for r in range(3):
        i, j = (r + 1) % 3, (r + 2) % 3
        R[r, 2] = R[i, 0] * R[j, 1] - R[j, 0] * R[i, 1]
    for r in range(3):
        for c in range(3):
            W[r, c] = (R[r, 2] * R[c, 1] - R[r, 1] * R[c, 2] - beta / across * R[r, 0] * R[c, 2]) / alpha
            W[r, 3 + c] = R[r, 0] * R[c, 2] / across
    return alpha, beta, across


@kernel
def _director_curvature(alpha, beta, across, R, m, H):
    """H (6, 6): second derivatives of m . phi by (a, b), phi the rotation vector of the increment of the frame."""
    n = np.empty(3)
    for r in range(3):
        n[r] = R[0, r] * m[0] + R[1, r] * m[1] + R[2, r] * m[2]
    G = np.zeros((6, 6))
    ia, ib, k = 1.0 / alpha, 1.0 / across, beta / alpha
    G[0, 2] = n[0] * k * ia * ib + n[1] * ia * ia
    G[0, 1] = -n[2] * ia * ia
    G[2, 3] = -n[0] * ia * ib
    G[1, 2] = -0.5 * n[0] * ia * ia - n[0] * ib * ib * k * k - 0.5 * n[1] * ia * ib * k
    G[4, 5] = -n[0] * ib * ib
    G[1, 5] = n[0] * ib * ib * k + 0.5 * n[1] * ia * ib
    G[2, 4] = n[0] * ib * ib * k
    G[2, 5] = 0.5 * n[2] * ia * ib
    G[2, 2] = -n[2] * ia * ib * k
    for i in range(6):
        for j in range(i + 1, 6):
            if G[i, j] == 0.0:
                G[i, j] = G[j, i]
            G[j, i] = G[i, j]
    T = np.empty((6, 6))
    for e in range(2):
        for r in range(3):
            for c in range(6):
                o = 3 * e
                T[o + r, c] = R[r, 0] * G[o, c] + R[r, 1] * G[o + 1, c] + R[r, 2] * G[o + 2, c]
    for r in range(6):
        for e in range(2):
            for c in range(3):
                o = 3 * e
                H[r, o + c] = T[r, o] * R[c, 0] + T[r, o + 1] * R[c, 1] + T[r, o + 2] * R[c, 2]


@kernel
def _element(record, scratch, xa, Ra, xb, Rb, force, T):
    """Force (12,) and tangent (12, 12) of one element on nodes a, b in the chart R <- exp(dphi) R; returns the status.

    `scratch`: store of a chain of one element, after it room for its constants.
    """
    lam, K, d, Q = np.empty(12), np.empty((6, 6)), np.empty(3), np.empty((3, 3))
    w = np.empty(3)
    for r in range(3):
        w[r] = xb[r] - xa[r]
    for r in range(3):
        d[r] = Ra[0, r] * w[0] + Ra[1, r] * w[1] + Ra[2, r] * w[2]
        for c in range(3):
            Q[r, c] = Ra[0, r] * Rb[0, c] + Ra[1, r] * Rb[1, c] + Ra[2, r] * Rb[2, c]
    number = np.empty(4, np.int64)
    number[0], number[1] = 1, 0
    # a longer store would mean a chain with weight
    _, _, _, status = condense(record, number, scratch[:6], scratch[6 : 6 + KEPT + TAIL], d, Q, lam, K)
    # to global axes
    A, B = np.empty((6, 6)), np.empty((6, 6))
    for e in range(2):
        for r in range(3):
            for c in range(6):
                o = 3 * e
                B[o + r, c] = Ra[r, 0] * K[o, c] + Ra[r, 1] * K[o + 1, c] + Ra[r, 2] * K[o + 2, c]
    for r in range(6):
        for e in range(2):
            for c in range(3):
                o = 3 * e
                A[r, o + c] = B[r, o] * Ra[c, 0] + B[r, o + 1] * Ra[c, 1] + B[r, o + 2] * Ra[c, 2]
    n, m = np.empty(3), np.empty(3)
    for r in range(3):
        n[r] = Ra[r, 0] * lam[0] + Ra[r, 1] * lam[1] + Ra[r, 2] * lam[2]
        m[r] = Ra[r, 0] * lam[3] + Ra[r, 1] * lam[4] + Ra[r, 2] * lam[5]
    _levers(A, n, m, w, force, T)
    return status


@kernel
def _levers(A, n, m, w, force, T):
    """Node force and tangent from force n, moment m and stiffness A (6, 6) at end b, lever w from a to b.

    xi = (dxb - dxa - dphi_a x w, dphi_b - dphi_a); second derivatives as in `ksd.model.assembly`.
    """
    M = np.empty((6, 12))
    for r in range(6):
        a0, a1, a2 = A[r, 0], A[r, 1], A[r, 2]
        M[r, 0], M[r, 1], M[r, 2], M[r, 6], M[r, 7], M[r, 8] = -a0, -a1, -a2, a0, a1, a2
        M[r, 3] = a1 * w[2] - a2 * w[1] - A[r, 3]
        M[r, 4] = a2 * w[0] - a0 * w[2] - A[r, 4]
        M[r, 5] = a0 * w[1] - a1 * w[0] - A[r, 5]
        M[r, 9], M[r, 10], M[r, 11] = A[r, 3], A[r, 4], A[r, 5]
    for c in range(12):
        a0, a1, a2 = M[0, c], M[1, c], M[2, c]
        T[0, c], T[1, c], T[2, c], T[6, c], T[7, c], T[8, c] = -a0, -a1, -a2, a0, a1, a2
        T[3, c] = a1 * w[2] - a2 * w[1] - M[3, c]
        T[4, c] = a2 * w[0] - a0 * w[2] - M[4, c]
        T[5, c] = a0 * w[1] - a1 * w[0] - M[5, c]
        T[9, c], T[10, c], T[11, c] = M[3, c], M[4, c], M[5, c]
    nw = n[0] * w[0] + n[1] * w[1] + n[2] * w[2]
    for i in range(3):
        for j in range(3):
            T[3 + i, 3 + j] += 0.5 * (n[i] * w[j] + w[i] * n[j])
        T[3 + i, 3 + i] -= nw
        j, k = (i + 1) % 3, (i + 2) % 3
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
        force[i], force[6 + i], force[9 + i] = -n[i], n[i], m[i]
        force[3 + i] = -m[i] - (w[j] * n[k] - w[k] * n[j])


@kernel
def element_values(record, scratch, z, R0, angle, gradient, H):
    """Gradient (2 q,) and tangent (2 q, 2 q) of one element by the values z (2 q,) of its nodes; returns the status.

    q = 6 (position, rotation vector from R0 (18,), columns of both nodes) when `angle`, else 9 (position, directors).
    """
    q = 6 if angle else 9
    R, W, n3 = np.empty((2, 3, 3)), np.empty((2, 3, 6)), q - 3
    size = np.empty((2, 3))
    for e in range(2):
        at = q * e + 3
        if angle:
            _angle_node(z[at : at + 3], R0[9 * e : 9 * e + 9], R[e], W[e])
        else:
            size[e, 0], size[e, 1], size[e, 2] = _director_node(z[at : at + 6], R[e], W[e])
    force, T = np.empty(12), np.empty((12, 12))
    status = _element(record, scratch, z[:3], R[0], z[q : q + 3], R[1], force, T)
    X, C = np.empty((12, 18)), np.empty((6, 6))
    for r in range(12):
        for e in range(2):
            for c in range(3):
                X[r, q * e + c] = T[r, 6 * e + c]
            for c in range(n3):
                s = 0.0
                for k in range(3):
                    s += T[r, 6 * e + 3 + k] * W[e, k, c]
                X[r, q * e + 3 + c] = s
    for e in range(2):
        m = force[6 * e + 3 : 6 * e + 6]
        if angle:
            _angle_curvature(z[q * e + 3 : q * e + 6], m, C)
        else:
            _director_curvature(size[e, 0], size[e, 1], size[e, 2], R[e], m, C)
        for r in range(3):
            gradient[q * e + r] = force[6 * e + r]
            for c in range(2 * q):
                H[q * e + r, c] = X[6 * e + r, c]
        for r in range(n3):
            gradient[q * e + 3 + r] = W[e, 0, r] * m[0] + W[e, 1, r] * m[1] + W[e, 2, r] * m[2]
            for c in range(2 * q):
                s = 0.0
                for k in range(3):
                    s += W[e, k, r] * X[6 * e + 3 + k, c]
                H[q * e + 3 + r, c] = s
            for c in range(n3):
                H[q * e + 3 + r, q * e + 3 + c] += C[r, c]
    return status
