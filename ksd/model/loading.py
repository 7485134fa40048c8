"""Compiled external loads and constraint rows (drives, supports), with their second derivatives."""

from __future__ import annotations

import math

import numpy as np

from ksd.model.arrays import TRANSLATION
from ksd.model.tangents import couple, geometric_tangent
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log


@kernel
def add_loads(loads, start, keep, R, work, factor, rtol):
    """External loads, times `factor`: dead forces keep their direction, following ones turn with the node.

    Tangent of a dead force at lever s: -[(s F' + F s')/2 - (s.F) I]. A following load and a moment have an unsymmetric
    tangent; its symmetric part is what is added, the rest is for the solve (`ksd.model.turning`).
    """
    F, M, s = np.empty(3), np.empty(3), np.empty(3)
    force, tangent = np.empty(6), np.empty((6, 6))
    w = len(keep)
    for i in range(len(loads.node)):
        node = loads.node[i]
        u, block = start[node], loads.block[i]
        if u < 0:
            continue
        T = R[node]
        p, f, m = loads.point[i], loads.force[i], loads.moment[i]
        for r in range(3):
            s[r] = T[r, 0] * p[0] + T[r, 1] * p[1] + T[r, 2] * p[2]
            F[r], M[r] = factor * f[r], factor * m[r]
        if loads.following[i] == 1:
            for r in range(3):
                F[r] = factor * (T[r, 0] * f[0] + T[r, 1] * f[1] + T[r, 2] * f[2])
                M[r] = factor * (T[r, 0] * m[0] + T[r, 1] * m[1] + T[r, 2] * m[2])
        sF = s[0] * F[0] + s[1] * F[1] + s[2] * F[2]
        f2, m2 = 0.0, 0.0
        tangent[:, :] = 0.0
        for r in range(3):
            j, k = (r + 1) % 3, (r + 2) % 3
            force[r] = F[r]
            force[3 + r] = M[r] + s[j] * F[k] - s[k] * F[j]
            f2 += F[r] * F[r]
            m2 += force[3 + r] * force[3 + r]
            if loads.following[i] == 0:
                for c in range(3):
                    tangent[3 + r, 3 + c] -= 0.5 * (s[r] * F[c] + F[r] * s[c])
                tangent[3 + r, 3 + r] += sF
            else:
                # symmetric half of -d(R f)/dphi = [F]x, rows force, columns rotation
                tangent[r, 3 + j] -= 0.5 * F[k]
                tangent[j, 3 + r] += 0.5 * F[k]
                tangent[3 + j, r] -= 0.5 * F[k]
                tangent[3 + r, j] += 0.5 * F[k]
        for r in range(w):
            work.rhs[u + r] -= force[keep[r]]
            for c in range(w):
                work.value[block + w * r + c] += tangent[keep[r], keep[c]]
        work.scale[node, 0] += rtol * math.sqrt(f2)
        work.scale[node, 1] += rtol * math.sqrt(m2)


@kernel
def term_value(terms, x, R, t, gradient, tangent, weight):
    """Value of constraint term t; its gradient (12,) on (base, node), and weight * second derivatives (12, 12).

    Translation: u.(x_b + s_b - x_a - s_a) with u, s_a turning with base. Rotation: twist of R_a^T R_b about u.
    """
    a, b = terms.node[t, 0], terms.node[t, 1]
    u, p, q = np.empty(3), np.empty(3), np.empty(3)
    for r in range(3):
        u[r], p[r], q[r] = 0.0, 0.0, 0.0
        for c in range(3):
            u[r] += R[a, r, c] * terms.direction[t, c]
            p[r] += R[a, r, c] * terms.point[t, 0, c]
            q[r] += R[b, r, c] * terms.point[t, 1, c]
    for i in range(12):
        gradient[i] = 0.0
        for j in range(12):
            tangent[i, j] = 0.0
    if terms.kind[t] == TRANSLATION:
        value = 0.0
        lever = np.empty(3)
        for r in range(3):
            # the base's own point only shifts the value by a constant along u fixed in base
            lever[r] = x[b, r] + q[r] - x[a, r]
            value += u[r] * (lever[r] - p[r])
        for r in range(3):
            j, k = (r + 1) % 3, (r + 2) % 3
            gradient[r] = -u[r]
            gradient[3 + r] = u[j] * lever[k] - u[k] * lever[j]
            gradient[6 + r] = u[r]
            gradient[9 + r] = q[j] * u[k] - q[k] * u[j]
        zero, n = np.empty(3), np.empty(3)
        for r in range(3):
            zero[r], n[r] = 0.0, weight * u[r]
        geometric_tangent(n, zero, lever, q, tangent)
        return value
    return twist(R[a], R[b], u, gradient, tangent, weight)


@kernel
def twist(Ra, Rb, u, gradient, tangent, weight):
    """Twist angle 2 atan2(q.u, q0) of the relative rotation, with derivatives in D = dphi_b - dphi_a.

    Quaternion (q0, q) of Rb Ra^T in global axes, u turning with a: the same number as in base axes.
    Second derivatives keep the part symmetric in D; with dphi_a they add -1/2 [m]x coupling, m = gradient.
    """
    rel = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            rel[i, j] = Rb[i, 0] * Ra[j, 0] + Rb[i, 1] * Ra[j, 1] + Rb[i, 2] * Ra[j, 2]
    v = np.empty(3)
    rotation_log(rel, v)
    t = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    q0 = math.cos(0.5 * t)
    f = 0.5 if t < 1e-12 else math.sin(0.5 * t) / t
    for i in range(3):
        v[i] *= f
    N = v[0] * u[0] + v[1] * u[1] + v[2] * u[2]
    r2 = N * N + q0 * q0
    # q0' = -q.D/2, (q.u)' = (q0 u + q x u ... ).D/2 : d(q)/dD = (q0 D + D x q)/2
    g = np.empty(3)
    dN, d0 = np.empty(3), np.empty(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        dN[i] = 0.5 * (q0 * u[i] + v[j] * u[k] - v[k] * u[j])
        d0[i] = -0.5 * v[i]
        g[i] = 2.0 * (q0 * dN[i] - N * d0[i]) / r2
    for i in range(3):
        gradient[3 + i], gradient[9 + i] = -g[i], g[i]
    # N'' = -N/4 and q0'' = -q0/4 cancel in atan2; the symmetric part left is -(g r2' + r2' g)/2 / r2
    for i in range(3):
        for j in range(3):
            di = 2.0 * (N * dN[i] + q0 * d0[i])
            dj = 2.0 * (N * dN[j] + q0 * d0[j])
            h = -0.5 * weight * (g[i] * dj + g[j] * di) / r2
            tangent[3 + i, 3 + j] += h
            tangent[9 + i, 9 + j] += h
            tangent[3 + i, 9 + j] -= h
            tangent[9 + i, 3 + j] -= h
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        c = 0.5 * weight * g[k]
        tangent[9 + i, 3 + j] += c
        tangent[9 + j, 3 + i] -= c
        tangent[3 + j, 9 + i] += c
        tangent[3 + i, 9 + j] -= c
    return 2.0 * math.atan2(N, q0)


@kernel
def add_terms(terms, start, keep, size, x, R, multiplier, target, work, rtol):
    """Constraint rows: gap into the residual, gradient into the matrix, multiplier times curvature into the tangent.

    Returns the largest gap, in metres (rotations times the model's length scale).
    """
    gradient, tangent = np.empty(12), np.empty((12, 12))
    largest, w, matrix, rhs, scale = 0.0, len(keep), work.value, work.rhs, work.scale
    for i in range(len(terms.start)):
        if terms.start[i] < 0:
            continue
        gap, reach = -target[i], 1.0
        for t in range(terms.first[i], terms.first[i + 1]):
            c = terms.coefficient[t]
            gap += c * term_value(terms, x, R, t, gradient, tangent, multiplier[i] * c)
            if terms.kind[t] != TRANSLATION:
                reach = size
            block = terms.block[t]
            for e in range(2):
                u = start[terms.node[t, e]]
                if u < 0:
                    continue
                f2, m2 = 0.0, 0.0
                for r in range(w):
                    value = c * gradient[6 * e + keep[r]]
                    # the row is stored (multiplier, node) or (node, multiplier): w numbers either way
                    matrix[block[e] + r] += value
                    rhs[u + r] += multiplier[i] * value
                    if keep[r] < 3:
                        f2 += value * value
                    else:
                        m2 += value * value
                    for k in range(w):
                        matrix[block[2 + e] + w * r + k] += tangent[6 * e + keep[r], 6 * e + keep[k]]
                scale[terms.node[t, e], 0] += rtol * abs(multiplier[i]) * math.sqrt(f2)
                scale[terms.node[t, e], 1] += rtol * abs(multiplier[i]) * math.sqrt(m2)
            couple(keep, block[4], terms.flip[t], tangent, matrix)
        rhs[terms.start[i]] += gap
        largest = max(largest, abs(gap) * reach)
    return largest
