"""Nodes of a modal body: orientation and spin from their values, and one element between two of them.

A node has 3 positions and either 3 rotation-vector values psi (`angle`: R = exp(psi) R0) or 6 director values: two
vectors a, b, from which R follows by Gram-Schmidt, so that their span need not be orthonormal. In director values an
unstretched, unsheared leaf has r' = a, a linear relation that a linear span can satisfy. In rotation vectors the
relation is not linear, and refining the mesh makes a reduced leaf stiffer (errata, paper 2, points 2 and 3).
"""

from __future__ import annotations

import math

import numpy as np

from ksd.elements.corotational import condense
from ksd.elements.corotational_element import CHAIN_SCRATCH_SIZE, ELEMENT_STORE_SIZE
from ksd.elements.ends import member_tangent
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import exp_tangent, rotation_exp, tangent_factors


@kernel
def _angle_node(v, R0, R, W):
    """Write R = exp(v) R0 and spin W (3, 3 or larger): dphi = W dv."""
    turned = np.empty((3, 3))
    rotation_exp(v, turned)
    for r in range(3):
        for c in range(3):
            R[r, c] = turned[r, 0] * R0[3 * c] + turned[r, 1] * R0[3 * c + 1] + turned[r, 2] * R0[3 * c + 2]
    exp_tangent(v, W)


@kernel
def _angle_curvature(v, m, H):
    """Write H (3, 3): second derivatives of m . phi by v, phi the rotation vector of the increment of exp(v)."""
    t2 = v[0] * v[0] + v[1] * v[1] + v[2] * v[2]
    _, B, A1, B1 = tangent_factors(t2)
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
    """Write R (3, 3) by Gram-Schmidt from a = z[:3], b = z[3:6], and spin W (3, 6); return |a|, b.e1, |b - (b.e1) e1|."""
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
    """Write H (6, 6): second derivatives of m . phi by (a, b), phi the rotation vector of the increment of the frame."""
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

    record (25,): constants of a chain of one element; scratch: its inner state (6), then its store.
    """
    lam, K, d, Q = np.empty(12), np.empty((6, 6)), np.empty(3), np.empty((3, 3))
    pose, A, M = np.empty(18), np.empty((6, 6)), np.empty((6, 12))
    for r in range(3):
        # ends are the nodes: the lever of a is the vector from a to b, that of b is zero
        pose[9 + r], pose[12 + r] = xb[r] - xa[r], 0.0
        for c in range(3):
            pose[3 * r + c] = Ra[r, c]
            Q[r, c] = Ra[0, r] * Rb[0, c] + Ra[1, r] * Rb[1, c] + Ra[2, r] * Rb[2, c]
    for r in range(3):
        d[r] = Ra[0, r] * pose[9] + Ra[1, r] * pose[10] + Ra[2, r] * pose[11]
    number = np.empty(4, np.int64)
    number[0], number[1] = 1, 0
    # a longer store would mean a chain with weight
    _, _, _, status = condense(
        record, number, scratch[:6], scratch[6 : 6 + ELEMENT_STORE_SIZE + CHAIN_SCRATCH_SIZE], d, Q, lam, K
    )
    member_tangent(pose, lam, K, T, force, A, M)
    return status


@kernel
def element_values(record, scratch, z, R0, angle, gradient, H):
    """Gradient (2 q,) and tangent (2 q, 2 q) of one element by the values z (2 q,) of its nodes; returns the status.

    q = 6 (position, rotation vector from R0 (18,), columns of both nodes) when `angle`, else 9 (position, directors).
    """
    q = 6 if angle else 9
    R, W, n3 = np.empty((2, 3, 3)), np.empty((2, 3, 6)), q - 3
    norms = np.empty((2, 3))
    for e in range(2):
        at = q * e + 3
        if angle:
            _angle_node(z[at : at + 3], R0[9 * e : 9 * e + 9], R[e], W[e])
        else:
            norms[e, 0], norms[e, 1], norms[e, 2] = _director_node(z[at : at + 6], R[e], W[e])
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
            _director_curvature(norms[e, 0], norms[e, 1], norms[e, 2], R[e], m, C)
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
