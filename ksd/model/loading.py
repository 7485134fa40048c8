"""Compiled external loads and constraint rows (drives, supports), with their second derivatives."""

from __future__ import annotations

import math

import numpy as np

from ksd.elements.ends import geometric_tangent
from ksd.elements.inertia import add_body
from ksd.model.arrays import (
    ALIGNMENT,
    AT,
    BODIES,
    BODY,
    DOFS_PER_NODE,
    LOAD,
    LOADS,
    ROWS,
    TERM,
    TRANSLATION,
)
from ksd.model.assembly import couple
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import nearest_turn, rotation_log


@kernel
def add_loads(ints, floats, R, factor, rtol, matrix, rhs, scale):
    """Add `factor` times the external loads: dead loads keep their direction, follower loads rotate with the node.

    The tangent of a dead force at lever s is -[(s F' + F s')/2 - (s.F) I]. Follower loads and moments have an unsymmetric
    tangent, whose symmetric part is added here; its skew part enters in the solve (`ksd.model.follower_correction`).
    """
    active, w = ints[AT.active_dofs], ints[DOFS_PER_NODE]
    F, M, s, force, tangent = np.empty(3), np.empty(3), np.empty(3), np.empty(6), np.empty((6, 6))
    for i in range(ints[LOADS]):
        node = ints[ints[LOAD.node] + i]
        u, block = ints[ints[AT.start] + node], ints[ints[LOAD.block] + i]
        if u < 0:
            continue
        point, own, twist = ints[LOAD.point] + 3 * i, ints[LOAD.force] + 3 * i, ints[LOAD.moment] + 3 * i
        following = ints[ints[LOAD.following] + i] == 1
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
            p = ints[active + r]
            rhs[u + r] -= force[p]
            for c in range(w):
                matrix[block + w * r + c] += tangent[p, ints[active + c]]
        scale[node, 0] += rtol * math.sqrt(f2)
        scale[node, 1] += rtol * math.sqrt(m2)


@kernel(inline="late")
def term_slope(ints, floats, x, R, angle, t, slope):
    """Value of constraint term t; writes its derivatives and auxiliary vectors into slope (8, 3).

    Translation: u.(x_b + s_b - x_a - s_a), where u and s_a rotate with the base a. Alignment of an axis n normal to u, as of
    a pin: (u x n).m, where u x n rotates with a and m, which is n at rest, with b. Rotation: twist of R_a^T R_b about u,
    with the whole turns that angle[t] has counted, where it is stored.
    slope[:4]: derivatives by displacement and rotation of base and node; slope[4]: u; slope[5:]: for a translation zero, the
    lever and s_b; for an alignment zero, u x n and m; for a rotation (q0, .., ..), unused, and q, see `twist`.
    """
    a, b = ints[ints[TERM.node] + 2 * t], ints[ints[TERM.node] + 2 * t + 1]
    direction, point = ints[TERM.direction] + 3 * t, ints[TERM.point] + 6 * t
    value = 0.0
    for r in range(3):
        u, p, arm = 0.0, 0.0, 0.0
        for c in range(3):
            u += R[a, r, c] * floats[direction + c]
            p += R[a, r, c] * floats[point + c]
            arm += R[b, r, c] * floats[point + 3 + c]
        # the point of the base only adds a constant, as u is fixed in the base
        lever = x[b, r] + arm - x[a, r]
        slope[4, r], slope[5, r], slope[6, r], slope[7, r] = u, 0.0, lever, arm
        value += u * (lever - p)
    if ints[ints[TERM.kind] + t] == TRANSLATION:
        for r in range(3):
            j, k = (r + 1) % 3, (r + 2) % 3
            slope[0, r], slope[2, r] = -slope[4, r], slope[4, r]
            slope[1, r] = slope[4, j] * slope[6, k] - slope[4, k] * slope[6, j]
            slope[3, r] = slope[7, j] * slope[4, k] - slope[7, k] * slope[4, j]
    elif ints[ints[TERM.kind] + t] == ALIGNMENT:
        value = 0.0
        for r in range(3):
            j, k = (r + 1) % 3, (r + 2) % 3
            n_j, n_k = 0.0, 0.0
            for c in range(3):
                n_j += R[a, j, c] * floats[point + c]
                n_k += R[a, k, c] * floats[point + c]
            slope[6, r] = slope[4, j] * n_k - slope[4, k] * n_j
            value += slope[6, r] * slope[7, r]
        for r in range(3):
            j, k = (r + 1) % 3, (r + 2) % 3
            slope[3, r] = slope[7, j] * slope[6, k] - slope[7, k] * slope[6, j]
            slope[0, r], slope[1, r], slope[2, r] = 0.0, -slope[3, r], 0.0
    else:
        value, slope[5, 0] = twist(R[a], R[b], slope[4], slope[7], slope[3], slope)
        value = nearest_turn(value, angle[t])
        angle[t] = value
        for r in range(3):
            slope[0, r], slope[1, r], slope[2, r] = 0.0, -slope[3, r], 0.0
    return value


@kernel(inline="late")
def twist(Ra, Rb, u, q, slope, rel):
    """Twist angle 2 atan2(q.u, q0) [rad] of the relative rotation, and q0; writes q (3,) and slope (3,).

    (q0, q): quaternion of Rb Ra^T in global axes, with u (3,) rotating with a; the angle is the same as in base axes. slope:
    derivative of the angle by dphi_b - dphi_a. rel (3, 3) or more: scratch.
    """
    for i in range(3):
        for j in range(3):
            rel[i, j] = Rb[i, 0] * Ra[j, 0] + Rb[i, 1] * Ra[j, 1] + Rb[i, 2] * Ra[j, 2]
    rotation_log(rel, q)
    t = math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2])
    q0 = math.cos(0.5 * t)
    f = 0.5 if t < 1e-12 else math.sin(0.5 * t) / t
    N = 0.0
    for i in range(3):
        q[i] *= f
        N += q[i] * u[i]
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        # (q.u)' and q0' are halves of this and of -q
        along = q0 * u[i] + q[j] * u[k] - q[k] * u[j]
        slope[i] = (q0 * along + N * q[i]) / (N * N + q0 * q0)
    return 2.0 * math.atan2(N, q0), q0


@kernel(inline="late")
def twist_curvature(u, q, q0, slope, weight, tangent):
    """Add weight times the second derivatives of `twist` by the rotations of (a, b) to tangent (12, 12).

    They consist of the part that is symmetric in D = dphi_b - dphi_a and of the coupling -1/2 [m]x of D with dphi_a, where
    m = slope.
    """
    N = q[0] * u[0] + q[1] * u[1] + q[2] * u[2]
    r2, dr = N * N + q0 * q0, np.empty(3)
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        # the derivative of r2
        dr[i] = N * (q0 * u[i] + q[j] * u[k] - q[k] * u[j]) - q0 * q[i]
    # N'' = -N/4 and q0'' = -q0/4 cancel in atan2; the symmetric part left is -(g r2' + r2' g)/2 / r2
    for i in range(3):
        g = slope[i]
        for j in range(3):
            h = -0.5 * weight * (g * dr[j] + slope[j] * dr[i]) / r2
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


@kernel(inline="late")
def _alignment_curvature(d, m, weight, tangent):
    """Add weight times the second derivatives of d.m, where d (3,) rotates with a and m (3,) with b, to tangent (12, 12)."""
    product = weight * (d[0] * m[0] + d[1] * m[1] + d[2] * m[2])
    for i in range(3):
        tangent[3 + i, 3 + i] -= product
        tangent[9 + i, 9 + i] -= product
        tangent[3 + i, 9 + i] += product
        tangent[9 + i, 3 + i] += product
        for j in range(3):
            both = 0.5 * weight * (d[i] * m[j] + m[i] * d[j])
            tangent[3 + i, 3 + j] += both
            tangent[9 + i, 9 + j] += both
            tangent[3 + i, 9 + j] -= weight * m[i] * d[j]
            tangent[9 + i, 3 + j] -= weight * d[i] * m[j]


@kernel
def add_terms(ints, floats, x, R, multiplier, angle, target, rtol, matrix, rhs, scale):
    """Add constraint rows: gap to the residual, gradient to the matrix, multiplier times second derivative to the tangent.

    A row without multiplier but with damping is a dashpot: a spring of stiffness damping c1 to its target. Returns the
    largest gap, in metres (rotations times the model's length scale).
    """
    slope, tangent = np.empty((8, 3)), np.empty((12, 12))
    largest, active, w, size = 0.0, ints[AT.active_dofs], ints[DOFS_PER_NODE], floats[0]
    for i in range(ints[ROWS]):
        row, mu = ints[ints[TERM.start] + i], multiplier[i]
        stiffness = floats[ints[AT.rates] + 1] * floats[ints[TERM.damping] + i] if row < 0 else 0.0
        if row < 0 and stiffness == 0.0:
            continue
        gap, reach = -target[i], 1.0
        for t in range(ints[ints[TERM.first] + i], ints[ints[TERM.first] + i + 1]):
            c = floats[ints[TERM.coefficient] + t]
            gap += c * term_slope(ints, floats, x, R, angle, t, slope)
            tangent[:, :] = 0.0
            if row < 0:
                mu = stiffness * gap
                for p in range(12):
                    for k in range(12):
                        tangent[p, k] = stiffness * c * c * slope[p // 3, p % 3] * slope[k // 3, k % 3]
            if ints[ints[TERM.kind] + t] == TRANSLATION:
                # as for a member with the force mu c u
                for r in range(3):
                    slope[4, r] *= mu * c
                geometric_tangent(slope[4:], tangent)
            elif ints[ints[TERM.kind] + t] == ALIGNMENT:
                reach = size
                _alignment_curvature(slope[6], slope[7], mu * c, tangent)
            else:
                reach = size
                twist_curvature(slope[4], slope[7], slope[5, 0], slope[3], mu * c, tangent)
            block = ints[TERM.block] + 5 * t
            for e in range(2):
                node = ints[ints[TERM.node] + 2 * t + e]
                u, at, own = ints[ints[AT.start] + node], ints[block + e], ints[block + 2 + e]
                if u < 0:
                    continue
                f2, m2 = 0.0, 0.0
                for r in range(w):
                    p = ints[active + r]
                    value = c * slope[2 * e + p // 3, p % 3]
                    # the row is stored (multiplier, node) or (node, multiplier): w numbers either way
                    if row >= 0:
                        matrix[at + r] += value
                    rhs[u + r] += mu * value
                    if p < 3:
                        f2 += value * value
                    else:
                        m2 += value * value
                    for k in range(w):
                        matrix[own + w * r + k] += tangent[6 * e + p, 6 * e + ints[active + k]]
                scale[node, 0] += rtol * abs(mu) * math.sqrt(f2)
                scale[node, 1] += rtol * abs(mu) * math.sqrt(m2)
            couple(ints, ints[block + 4], ints[ints[TERM.flip] + t], tangent, matrix)
        if row >= 0:
            rhs[row] += gap
            largest = max(largest, abs(gap) * reach)
    return largest


@kernel
def add_bodies(ints, floats, x, R, rtol, noise, matrix, rhs, scale):
    """Add the inertia of the rigid bodies of a time step (`ksd.elements.inertia`); noise [m]: rounding of places."""
    active, w, c0 = ints[AT.active_dofs], ints[DOFS_PER_NODE], floats[ints[AT.rates]]
    force, tangent = np.empty(6), np.empty((6, 6))
    for i in range(ints[BODIES]):
        node = ints[ints[BODY.node] + i]
        u, block, body = ints[ints[AT.start] + node], ints[ints[BODY.block] + i], ints[BODY.inertia] + 13 * i
        add_body(
            floats[body : body + 13],
            floats[ints[AT.known] + 12 * node :],
            c0,
            x[node],
            R[node],
            force,
            tangent,
        )
        f2, m2, spread = 0.0, 0.0, 0.0
        for r in range(3):
            f2 += force[r] ** 2
            m2 += force[3 + r] ** 2
            spread += floats[body + 4 + 4 * r]
        for r in range(w):
            p = ints[active + r]
            rhs[u + r] += force[p]
            for c in range(w):
                matrix[block + w * r + c] += tangent[p, ints[active + c]]
        scale[node, 0] += rtol * math.sqrt(f2) + noise * c0 * floats[body]
        # orientations are rounded as numbers of size 1
        scale[node, 1] += rtol * math.sqrt(m2) + 2e-15 * c0 * spread + noise * c0 * floats[body] * floats[0]
