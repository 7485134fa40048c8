"""Compiled assembly: members, constraint rows and loads add force and tangent into one prepared storage.

A member sees only the relative pose of its ends; this file turns its wrench (n, m) and stiffness K6 into forces
and a symmetric tangent on the two nodes its ends hang on. With w the lever from node a to end q, s the lever from
node b to end q, all global, the relative motion is xi = (dxb - dxa + dphi_b x s - dphi_a x w, dphi_b - dphi_a),
and the second derivatives of n.xi_t + m.xi_r in the chart R <- exp(dphi) R are
[xa, phia] = [n]x, [xb, phia] = -[n]x, [phib, phia] = n s^T .. see `_geometric`.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.beam.corotational import condense as corotational_condense
from ksd.beam.corotational import recover as corotational_recover
from ksd.beam.linear import linear_condense
from ksd.beam.strain import strain_condense, strain_recover
from ksd.model.arrays import COROTATIONAL, STRAIN, TRANSLATION
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log


@kernel
def member_pose(members, x, R, i, pose, Q):
    """pose (18,) = end frame p (9, row-major), w, s, d (global); Q (3, 3) = relative orientation, in frame p."""
    a, b = members.node[i, 0], members.node[i, 1]
    for r in range(3):
        sp, sq = 0.0, 0.0
        for c in range(3):
            sp += R[a, r, c] * members.offset[i, 0, c]
            sq += R[b, r, c] * members.offset[i, 1, c]
        pose[9 + r] = x[b, r] - x[a, r] + sq
        pose[12 + r] = sq
        pose[15 + r] = x[b, r] - x[a, r] + sq - sp
        for c in range(3):
            pose[3 * r + c] = (
                R[a, r, 0] * members.frame[i, 0, 0, c]
                + R[a, r, 1] * members.frame[i, 0, 1, c]
                + R[a, r, 2] * members.frame[i, 0, 2, c]
            )
    for c in range(3):
        t0 = R[b, 0, 0] * members.frame[i, 1, 0, c] + R[b, 0, 1] * members.frame[i, 1, 1, c] + R[b, 0, 2] * members.frame[i, 1, 2, c]
        t1 = R[b, 1, 0] * members.frame[i, 1, 0, c] + R[b, 1, 1] * members.frame[i, 1, 1, c] + R[b, 1, 2] * members.frame[i, 1, 2, c]
        t2 = R[b, 2, 0] * members.frame[i, 1, 0, c] + R[b, 2, 1] * members.frame[i, 1, 1, c] + R[b, 2, 2] * members.frame[i, 1, 2, c]
        for r in range(3):
            Q[r, c] = pose[r] * t0 + pose[3 + r] * t1 + pose[6 + r] * t2


@kernel
def _turn_stiffness(pose, K, A):
    """A (6, 6) = diag(Rp, Rp) K diag(Rp, Rp)^T."""
    T = np.empty((6, 6))
    for b in range(2):
        for r in range(3):
            for c in range(6):
                T[3 * b + r, c] = (
                    pose[3 * r] * K[3 * b, c] + pose[3 * r + 1] * K[3 * b + 1, c] + pose[3 * r + 2] * K[3 * b + 2, c]
                )
    for r in range(6):
        for b in range(2):
            for c in range(3):
                A[r, 3 * b + c] = (
                    T[r, 3 * b] * pose[3 * c] + T[r, 3 * b + 1] * pose[3 * c + 1] + T[r, 3 * b + 2] * pose[3 * c + 2]
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
def _geometric(n, m, w, s, T):
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
def member_tangent(pose, lam, K, T, force):
    """Node tangent T (12, 12) and forces (12,) on nodes a, b of one member, global axes."""
    A = np.empty((6, 6))
    M = np.empty((6, 12))
    _turn_stiffness(pose, K, A)
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
    n, m = np.empty(3), np.empty(3)
    for r in range(3):
        n[r] = pose[3 * r] * lam[6] + pose[3 * r + 1] * lam[7] + pose[3 * r + 2] * lam[8]
        m[r] = pose[3 * r] * lam[9] + pose[3 * r + 1] * lam[10] + pose[3 * r + 2] * lam[11]
    _geometric(n, m, w, s, T)
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
def condense_member(members, inner, store, lam, i, d, Q, K):
    """Wrench and stiffness of member i at relative pose d (3,), Q (3, 3): the one place that knows the kinds."""
    number = members.number[i]
    state = inner[members.inner_at[i] : members.inner_at[i + 1]]
    kept = store[members.store_at[i] : members.store_at[i + 1]]
    value = members.value[members.value_at[i] :]
    if members.kind[i] == STRAIN:
        return strain_condense(value, number, state, kept, d, Q, lam, K)
    if members.kind[i] == COROTATIONAL:
        return corotational_condense(value, number, state, kept, d, Q, lam, K)
    return linear_condense(state, d, Q, lam, K)


@kernel
def recover_member(members, inner, store, i, xi, scale):
    """Inner update of member i after its end q moved by xi (6,) relative to its end p."""
    number = members.number[i]
    state = inner[members.inner_at[i] : members.inner_at[i + 1]]
    kept = store[members.store_at[i] : members.store_at[i + 1]]
    value = members.value[members.value_at[i] :]
    if members.kind[i] == STRAIN:
        strain_recover(value, number, state, kept, xi, scale)
    elif members.kind[i] == COROTATIONAL:
        corotational_recover(value, number, state, kept, xi, scale)


@kernel
def _scatter(block, T, force, rhs, starts, value):
    """Add T (12, 12) to the stored blocks (pp, qq, coupling, flipped) and the forces to the residual."""
    for e in range(2):
        if block[e] >= 0:
            o, u = 6 * e, starts[e]
            for r in range(6):
                rhs[u + r] += force[o + r]
                for c in range(6):
                    value[block[e] + 6 * r + c] += T[o + r, o + c]
    if block[2] >= 0:
        for r in range(6):
            for c in range(6):
                if block[3] == 1:
                    value[block[2] + 6 * r + c] += T[r, 6 + c]
                else:
                    value[block[2] + 6 * r + c] += T[6 + r, c]


@kernel
def add_members(arrays, x, R, inner, work, rtol, noise):
    """All members into work.value and work.rhs. Returns (negatives, worst inner residual over its bound, status)."""
    members = arrays.members
    negatives, worst, status = 0, 0.0, 0
    Q, K = np.empty((3, 3)), np.empty((6, 6))
    T, force, d = np.empty((12, 12)), np.empty(12), np.empty(3)
    starts = np.empty(2, np.int64)
    for i in range(len(members.kind)):
        pose, lam = work.pose[i], work.lam[i]
        member_pose(members, x, R, i, pose, Q)
        for c in range(3):
            d[c] = pose[c] * pose[15] + pose[3 + c] * pose[16] + pose[6 + c] * pose[17]
        back, dn, dm, failed = condense_member(members, inner, work.store, lam, i, d, Q, K)
        negatives += back
        status = max(status, failed)
        member_tangent(pose, lam, K, T, force)
        n = math.sqrt(lam[0] ** 2 + lam[1] ** 2 + lam[2] ** 2)
        m = math.sqrt(lam[3] ** 2 + lam[4] ** 2 + lam[5] ** 2)
        L = members.length[i]
        floor = noise * members.floor[i]
        worst = max(worst, dn / (rtol * (n + m / L) + floor), dm / (rtol * (n * L + m) + floor * L))
        for e in range(2):
            node = members.node[i, e]
            starts[e] = arrays.start[node]
            o = 6 * e
            fm = math.sqrt(force[o + 3] ** 2 + force[o + 4] ** 2 + force[o + 5] ** 2)
            work.scale[node, 0] += rtol * (n + m / L) + floor
            work.scale[node, 1] += rtol * (max(fm, m) + n * L) + floor * L
        _scatter(members.block[i], T, force, work.rhs, starts, work.value)
    return negatives, worst, status


@kernel
def add_loads(arrays, R, work, factor, rtol):
    """External loads, times `factor`: dead forces keep their direction, following ones turn with the node.

    Tangent of a dead force at lever s: -[(s F' + F s')/2 - (s.F) I]. A following load has an unsymmetric tangent;
    its symmetric part is what is added, so convergence is linear there (exact where the load does not turn).
    """
    loads = arrays.loads
    F, M, s = np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(loads.node)):
        node = loads.node[i]
        u, block = arrays.start[node], loads.block[i]
        if u < 0:
            continue
        for r in range(3):
            s[r] = R[node, r, 0] * loads.point[i, 0] + R[node, r, 1] * loads.point[i, 1] + R[node, r, 2] * loads.point[i, 2]
            F[r], M[r] = factor * loads.force[i, r], factor * loads.moment[i, r]
        if loads.following[i] == 1:
            for r in range(3):
                F[r] = factor * (R[node, r, 0] * loads.force[i, 0] + R[node, r, 1] * loads.force[i, 1] + R[node, r, 2] * loads.force[i, 2])
                M[r] = factor * (R[node, r, 0] * loads.moment[i, 0] + R[node, r, 1] * loads.moment[i, 1] + R[node, r, 2] * loads.moment[i, 2])
        sF = s[0] * F[0] + s[1] * F[1] + s[2] * F[2]
        f2, m2 = 0.0, 0.0
        for r in range(3):
            j, k = (r + 1) % 3, (r + 2) % 3
            moment = M[r] + s[j] * F[k] - s[k] * F[j]
            f2 += F[r] * F[r]
            m2 += moment * moment
            work.rhs[u + r] -= F[r]
            work.rhs[u + 3 + r] -= moment
            if loads.following[i] == 0:
                for c in range(3):
                    work.value[block + 6 * (3 + r) + 3 + c] -= 0.5 * (s[r] * F[c] + F[r] * s[c])
                work.value[block + 6 * (3 + r) + 3 + r] += sF
            else:
                # symmetric half of -d(R f)/dphi = [F]x, rows force, columns rotation
                work.value[block + 6 * r + 3 + j] -= 0.5 * F[k]
                work.value[block + 6 * j + 3 + r] += 0.5 * F[k]
                work.value[block + 6 * (3 + j) + r] -= 0.5 * F[k]
                work.value[block + 6 * (3 + r) + j] += 0.5 * F[k]
        work.scale[node, 0] += rtol * math.sqrt(f2)
        work.scale[node, 1] += rtol * math.sqrt(m2)


@kernel
def term_value(terms, x, R, t, gradient, tangent, weight):
    """Value of constraint term t, its gradient (12,) on (base, node), and weight * second derivatives -> tangent (12, 12).

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
        zero = np.zeros(3)
        n = np.empty(3)
        for r in range(3):
            n[r] = weight * u[r]
        _geometric(n, zero, lever, q, tangent)
        return value
    return _twist(R[a], R[b], u, gradient, tangent, weight)


@kernel
def _twist(Ra, Rb, u, gradient, tangent, weight):
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
def add_terms(arrays, x, R, multiplier, target, work, rtol):
    """Constraint rows: gap into the residual, gradient into the matrix, multiplier times curvature into the tangent.

    Returns the largest gap, in metres (rotations times the model's length scale).
    """
    terms = arrays.terms
    gradient, tangent = np.empty(12), np.empty((12, 12))
    largest = 0.0
    for i in range(len(terms.start)):
        gap, reach = -target[i], 1.0
        for t in range(terms.first[i], terms.first[i + 1]):
            c = terms.coefficient[t]
            gap += c * term_value(terms, x, R, t, gradient, tangent, multiplier[i] * c)
            if terms.kind[t] != TRANSLATION:
                reach = arrays.size
            block = terms.block[t]
            for e in range(2):
                u = arrays.start[terms.node[t, e]]
                if u < 0:
                    continue
                f2, m2 = 0.0, 0.0
                for r in range(6):
                    value = c * gradient[6 * e + r]
                    # the row is stored (multiplier, node) or (node, multiplier): six numbers either way
                    work.value[block[e] + r] += value
                    work.rhs[u + r] += multiplier[i] * value
                    if r < 3:
                        f2 += value * value
                    else:
                        m2 += value * value
                    for k in range(6):
                        work.value[block[2 + e] + 6 * r + k] += tangent[6 * e + r, 6 * e + k]
                work.scale[terms.node[t, e], 0] += rtol * abs(multiplier[i]) * math.sqrt(f2)
                work.scale[terms.node[t, e], 1] += rtol * abs(multiplier[i]) * math.sqrt(m2)
            if block[4] >= 0:
                for r in range(6):
                    for k in range(6):
                        if terms.flip[t] == 1:
                            work.value[block[4] + 6 * r + k] += tangent[r, 6 + k]
                        else:
                            work.value[block[4] + 6 * r + k] += tangent[6 + r, k]
        work.rhs[terms.start[i]] += gap
        largest = max(largest, abs(gap) * reach)
    return largest
