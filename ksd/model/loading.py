"""Compiled external loads and constraint rows (drives, supports), with their second derivatives."""

from __future__ import annotations

import math

import numpy as np

from ksd.model.arrays import (
    KEEP,
    LOAD_BLOCK,
    LOAD_FOLLOWING,
    LOAD_FORCE,
    LOAD_MOMENT,
    LOAD_NODE,
    LOAD_POINT,
    LOADS,
    ROWS,
    START,
    TERM_BLOCK,
    TERM_COEFFICIENT,
    TERM_DIRECTION,
    TERM_FIRST,
    TERM_FLIP,
    TERM_KIND,
    TERM_NODE,
    TERM_POINT,
    TERM_START,
    TRANSLATION,
    WIDTH,
)
from ksd.model.tangents import couple, geometric_tangent
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log


@kernel
def add_loads(ints, floats, R, factor, rtol, matrix, rhs, scale):
    """External loads, times `factor`: dead forces keep their direction, following ones turn with the node.

    Tangent of a dead force at lever s: -[(s F' + F s')/2 - (s.F) I]. A following load and a moment have an unsymmetric
    tangent; its symmetric part is what is added, the rest is for the solve (`ksd.model.nonconservative`).
    """
    keep, w = ints[KEEP], ints[WIDTH]
    F, M, s, force, tangent = np.empty(3), np.empty(3), np.empty(3), np.empty(6), np.empty((6, 6))
    for i in range(ints[LOADS]):
        node = ints[ints[LOAD_NODE] + i]
        u, block = ints[ints[START] + node], ints[ints[LOAD_BLOCK] + i]
        if u < 0:
            continue
        point, own, twist = ints[LOAD_POINT] + 3 * i, ints[LOAD_FORCE] + 3 * i, ints[LOAD_MOMENT] + 3 * i
        following = ints[ints[LOAD_FOLLOWING] + i] == 1
        for r in range(3):
            s[r], F[r], M[r] = 0.0, 0.0, 0.0
            for c in range(3):
                s[r] += R[node, r, c] * floats[point + c]
                F[r] += factor * R[node, r, c] * floats[own + c]
                M[r] += factor * R[node, r, c] * floats[twist + c]
            if not following:
                F[r], M[r] = factor * floats[own + r], factor * floats[twist + r]
        f2, m2, sF = 0.0, 0.0, s[0] * F[0] + s[1] * F[1] + s[2] * F[2]
        tangent[:, :] = 0.0
        for r in range(3):
            j, k = (r + 1) % 3, (r + 2) % 3
            f, m = F[r], M[r] + s[j] * F[k] - s[k] * F[j]
            force[r], force[3 + r] = f, m
            f2 += f * f
            m2 += m * m
            if following:
                # symmetric half of -d(R f)/dphi = [F]x, rows force, columns rotation
                tangent[j, 3 + k] -= 0.5 * f
                tangent[k, 3 + j] += 0.5 * f
                tangent[3 + k, j] -= 0.5 * f
                tangent[3 + j, k] += 0.5 * f
            else:
                for c in range(3):
                    tangent[3 + r, 3 + c] -= 0.5 * (s[r] * F[c] + f * s[c])
                tangent[3 + r, 3 + r] += sF
        for r in range(w):
            p = ints[keep + r]
            rhs[u + r] -= force[p]
            for c in range(w):
                matrix[block + w * r + c] += tangent[p, ints[keep + c]]
        scale[node, 0] += rtol * math.sqrt(f2)
        scale[node, 1] += rtol * math.sqrt(m2)


@kernel
def term_value(ints, floats, t, x, R, gradient, tangent, weight):
    """Value of constraint term t; its gradient (12,) on (base, node), and weight * second derivatives (12, 12).

    Translation: u.(x_b + s_b - x_a - s_a) with u, s_a turning with base. Rotation: twist of R_a^T R_b about u.
    """
    a, b = ints[ints[TERM_NODE] + 2 * t], ints[ints[TERM_NODE] + 2 * t + 1]
    direction, point = ints[TERM_DIRECTION] + 3 * t, ints[TERM_POINT] + 6 * t
    # n = weight u, no moment, the levers, and u
    of, value = np.zeros((5, 3)), 0.0
    for i in range(12):
        gradient[i] = 0.0
        for j in range(12):
            tangent[i, j] = 0.0
    for r in range(3):
        u, p, q = 0.0, 0.0, 0.0
        for c in range(3):
            u += R[a, r, c] * floats[direction + c]
            p += R[a, r, c] * floats[point + c]
            q += R[b, r, c] * floats[point + 3 + c]
        # the base's own point only shifts the value by a constant along u fixed in base
        lever = x[b, r] + q - x[a, r]
        of[0, r], of[2, r], of[3, r], of[4, r] = weight * u, lever, q, u
        value += u * (lever - p)
    if ints[ints[TERM_KIND] + t] == TRANSLATION:
        for r in range(3):
            j, k = (r + 1) % 3, (r + 2) % 3
            gradient[r], gradient[6 + r] = -of[4, r], of[4, r]
            gradient[3 + r] = of[4, j] * of[2, k] - of[4, k] * of[2, j]
            gradient[9 + r] = of[3, j] * of[4, k] - of[3, k] * of[4, j]
        geometric_tangent(of, tangent)
    else:
        value = twist(R[a], R[b], of[4], gradient, tangent, weight)
    return value


@kernel
def twist(Ra, Rb, u, gradient, tangent, weight):
    """Twist angle 2 atan2(q.u, q0) of the relative rotation, with derivatives in D = dphi_b - dphi_a.

    Quaternion (q0, q) of Rb Ra^T in global axes, u turning with a: the same number as in base axes.
    Second derivatives keep the part symmetric in D; with dphi_a they add -1/2 [m]x coupling, m = gradient.
    """
    rel, v, dr = np.empty((3, 3)), np.empty(3), np.empty(3)
    for i in range(3):
        for j in range(3):
            rel[i, j] = Rb[i, 0] * Ra[j, 0] + Rb[i, 1] * Ra[j, 1] + Rb[i, 2] * Ra[j, 2]
    rotation_log(rel, v)
    t = math.sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])
    q0 = math.cos(0.5 * t)
    f = 0.5 if t < 1e-12 else math.sin(0.5 * t) / t
    N = 0.0
    for i in range(3):
        v[i] *= f
        N += v[i] * u[i]
    r2 = N * N + q0 * q0
    # q0' = -q.D/2, (q.u)' = (q0 u + q x u ... ).D/2 : d(q)/dD = (q0 D + D x q)/2; dr = (r2)'
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        dN, d0 = 0.5 * (q0 * u[i] + v[j] * u[k] - v[k] * u[j]), -0.5 * v[i]
        g = 2.0 * (q0 * dN - N * d0) / r2
        dr[i] = 2.0 * (N * dN + q0 * d0)
        gradient[3 + i], gradient[9 + i] = -g, g
    # N'' = -N/4 and q0'' = -q0/4 cancel in atan2; the symmetric part left is -(g r2' + r2' g)/2 / r2
    for i in range(3):
        g = gradient[9 + i]
        for j in range(3):
            h = -0.5 * weight * (g * dr[j] + gradient[9 + j] * dr[i]) / r2
            tangent[3 + i, 3 + j] += h
            tangent[9 + i, 9 + j] += h
            tangent[3 + i, 9 + j] -= h
            tangent[9 + i, 3 + j] -= h
        j, k = (i + 1) % 3, (i + 2) % 3
        c = 0.5 * weight * g
        tangent[9 + j, 3 + k] += c
        tangent[9 + k, 3 + j] -= c
        tangent[3 + k, 9 + j] += c
        tangent[3 + j, 9 + k] -= c
    return 2.0 * math.atan2(N, q0)


@kernel
def add_terms(ints, floats, x, R, multiplier, target, rtol, matrix, rhs, scale):
    """Constraint rows: gap into the residual, gradient into the matrix, multiplier times curvature into the tangent.

    Returns the largest gap, in metres (rotations times the model's length scale).
    """
    gradient, tangent = np.empty(12), np.empty((12, 12))
    largest, keep, w, size = 0.0, ints[KEEP], ints[WIDTH], floats[0]
    for i in range(ints[ROWS]):
        row, mu = ints[ints[TERM_START] + i], multiplier[i]
        if row < 0:
            continue
        gap, reach = -target[i], 1.0
        for t in range(ints[ints[TERM_FIRST] + i], ints[ints[TERM_FIRST] + i + 1]):
            c = floats[ints[TERM_COEFFICIENT] + t]
            gap += c * term_value(ints, floats, t, x, R, gradient, tangent, mu * c)
            if ints[ints[TERM_KIND] + t] != TRANSLATION:
                reach = size
            block = ints[TERM_BLOCK] + 5 * t
            for e in range(2):
                node = ints[ints[TERM_NODE] + 2 * t + e]
                u, at, own = ints[ints[START] + node], ints[block + e], ints[block + 2 + e]
                if u < 0:
                    continue
                f2, m2 = 0.0, 0.0
                for r in range(w):
                    p = ints[keep + r]
                    value = c * gradient[6 * e + p]
                    # the row is stored (multiplier, node) or (node, multiplier): w numbers either way
                    matrix[at + r] += value
                    rhs[u + r] += mu * value
                    if p < 3:
                        f2 += value * value
                    else:
                        m2 += value * value
                    for k in range(w):
                        matrix[own + w * r + k] += tangent[6 * e + p, 6 * e + ints[keep + k]]
                scale[node, 0] += rtol * abs(mu) * math.sqrt(f2)
                scale[node, 1] += rtol * abs(mu) * math.sqrt(m2)
            couple(ints, ints[block + 4], ints[ints[TERM_FLIP] + t], tangent, matrix)
        rhs[row] += gap
        largest = max(largest, abs(gap) * reach)
    return largest
