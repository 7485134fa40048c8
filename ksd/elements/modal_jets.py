"""Jets, numbers with their first and second derivatives in the six motions of end q: boundary values of a modal body.

A jet is (28,): value, 6 first derivatives, 21 second derivatives (upper triangle by rows), with respect to xi = (t,
psi), d <- d + t, Q <- exp(psi) Q. Products and functions of jets are exact to second order, so force and tangent of a
reduced body follow from the pose of its end without further derivation.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.numerics.kernel import kernel

JET = 28
"""Length of a jet."""


@kernel
def jet_product(a, b, factor, out):
    """out += factor * a * b."""
    out[0] += factor * a[0] * b[0]
    for i in range(1, 7):
        out[i] += factor * (a[0] * b[i] + a[i] * b[0])
    k = 7
    for i in range(1, 7):
        for j in range(i, 7):
            out[k] += factor * (a[0] * b[k] + a[k] * b[0] + a[i] * b[j] + a[j] * b[i])
            k += 1


@kernel
def jet_function(a, f, f1, f2, out):
    """out = f(a) from the value and first two derivatives of f at a[0]."""
    out[0] = f
    for i in range(1, 7):
        out[i] = f1 * a[i]
    k = 7
    for i in range(1, 7):
        for j in range(i, 7):
            out[k] = f1 * a[k] + f2 * a[i] * a[j]
            k += 1


@kernel
def pose_jets(d, Q, D, C):
    """Write jets D (3, 28) of the position and C (9, 28) of the columns of Q, column by column."""
    D[:] = 0.0
    C[:] = 0.0
    for r in range(3):
        D[r, 0] = d[r]
        D[r, 1 + r] = 1.0
    for c in range(3):
        for r in range(3):
            jet = C[3 * c + r]
            i, j = (r + 1) % 3, (r + 2) % 3
            v, vi, vj = Q[r, c], Q[i, c], Q[j, c]
            # (psi x v)_r = psi_i v_j - psi_j v_i
            jet[0], jet[4 + i], jet[4 + j] = v, vj, -vi
            # second derivatives of (psi (psi . v) - v psi^2) / 2
            for a in range(3):
                for b in range(a, 3):
                    s = 0.0
                    if a == r:
                        s += 0.5 * Q[b, c]
                    if b == r:
                        s += 0.5 * Q[a, c]
                    if a == b:
                        s -= v
                    jet[_second_derivative_index(3 + a, 3 + b)] = s


@kernel
def _second_derivative_index(i, j):
    """Index of the second derivative (i, j), i <= j."""
    return 7 + 6 * i - (i * (i - 1)) // 2 + j - i


@kernel
def chord_jets(D, F, length):
    """Write jets F (9, 28) of the rows of the chord frame (row r of F = F^T e_r) and `length` (28,) of |d|.

    D (3, 28): jets of the position d of end q. The chord frame is the shortest rotation of e1 onto d: it adds no roll, and
    is defined where the leaf is straight.
    """
    s, inverse = np.zeros(JET), np.zeros(JET)
    for r in range(3):
        jet_product(D[r], D[r], 1.0, s)
    n = math.sqrt(s[0])
    jet_function(s, n, 0.5 / n, -0.25 / (n * n * n), length)
    jet_function(s, 1.0 / n, -0.5 / (n * n * n), 0.75 / (n * n * n * n * n), inverse)
    u = np.zeros((3, JET))
    for r in range(3):
        jet_product(D[r], inverse, 1.0, u[r])
    k, ky, kz = np.zeros(JET), np.zeros(JET), np.zeros(JET)
    g = 1.0 / (1.0 + u[0, 0])
    jet_function(u[0], g, -g * g, 2.0 * g * g * g, k)
    jet_product(k, u[1], 1.0, ky)
    jet_product(k, u[2], 1.0, kz)
    F[:] = 0.0
    for i in range(JET):
        F[0, i], F[1, i], F[2, i] = u[0, i], -u[1, i], -u[2, i]
        F[3, i], F[6, i] = u[1, i], u[2, i]
    F[4, 0] = F[8, 0] = 1.0
    jet_product(ky, u[1], -1.0, F[4])
    jet_product(ky, u[2], -1.0, F[5])
    jet_product(kz, u[1], -1.0, F[7])
    jet_product(kz, u[2], -1.0, F[8])


@kernel
def _log_factor(c):
    """h = angle / sin(angle) as a function of c = cos(angle), with h' and h''."""
    e = 1.0 - c
    if e < 1e-3:
        h = 1.0 + e * (1 / 3 + e * (2 / 15 + e * (2 / 35 + e * 8 / 315)))
        h1 = -(1 / 3 + e * (4 / 15 + e * (6 / 35 + e * 32 / 315)))
        return h, h1, 4 / 15 + e * (12 / 35 + e * 96 / 315)
    t = math.acos(max(-1.0, c))
    s2 = e * (1.0 + c)
    h = t / math.sqrt(s2)
    h1 = (c * h - 1.0) / s2
    return h, h1, (3.0 * c * h1 + h) / s2


@kernel
def rotation_jets(M, v):
    """Write jets v (3, 28) of the rotation vector of the rotation with columns M (9, 28)."""
    c, h = np.zeros(JET), np.zeros(JET)
    for i in range(JET):
        c[i] = 0.5 * (M[0, i] + M[4, i] + M[8, i])
    c[0] -= 0.5
    f, f1, f2 = _log_factor(c[0])
    jet_function(c, f, f1, f2, h)
    half = np.empty(JET)
    v[:] = 0.0
    for r in range(3):
        i, j = (r + 1) % 3, (r + 2) % 3
        for k in range(JET):
            # entry (j, i) minus entry (i, j); column c, row r sits at 3 c + r
            half[k] = 0.5 * (M[3 * i + j, k] - M[3 * j + i, k])
        jet_product(half, h, 1.0, v[r])


@kernel
def relative_rotation_jets(F, C, M):
    """Write M (9, 28): columns of F^T Q; row r of F is F[3 r ..]."""
    M[:] = 0.0
    for c in range(3):
        for r in range(3):
            for k in range(3):
                jet_product(F[3 * k + r], C[3 * c + k], 1.0, M[3 * c + r])


@kernel
def _end_rotation_jets(A, reference, angle, out):
    """Rotation values of an end with columns A (9, 28): 3 rotation-vector jets when `angle`, else 6 director jets.

    reference (9,): columns of the orientation from which rotation vectors are measured.
    """
    if not angle:
        for i in range(6):
            for k in range(JET):
                out[i, k] = A[i, k]
        return
    M = np.zeros((9, JET))
    for c in range(3):
        for r in range(3):
            for k in range(3):
                # A times the transposed reference, whose column k is reference[3 k ..]
                w = reference[3 * k + c]
                for i in range(JET):
                    M[3 * c + r, i] += w * A[3 * k + r, i]
    rotation_jets(M, out)


@kernel
def boundary_jets(frame, angle, reference, d, Q, out):
    """Write boundary values out (nb, 28) of a body whose end q is at d, Q (rotation from rest) in the frame of end p.

    frame 0: node frame of end p; values d, rotation of q. frame 1: chord frame; values |d|, rotation of p, of q.
    Rotation values are rotation vectors from the orientations `reference` (18,) (columns, p then q) when `angle`, else
    the first two columns. Values are absolute; the caller subtracts those of its expansion point.
    """
    D, C = np.empty((3, JET)), np.empty((9, JET))
    pose_jets(d, Q, D, C)
    out[:] = 0.0
    if frame == 0:
        for r in range(3):
            for k in range(JET):
                out[r, k] = D[r, k]
        _end_rotation_jets(C, reference[9:], angle, out[3:])
        return
    F, A = np.empty((9, JET)), np.empty((9, JET))
    chord_jets(D, F, out[0])
    _end_rotation_jets(F, reference[:9], angle, out[1:])
    relative_rotation_jets(F, C, A)
    _end_rotation_jets(A, reference[9:], angle, out[4 if angle else 7 :])
