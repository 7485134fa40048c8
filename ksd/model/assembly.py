"""Compiled assembly: members, constraint rows and loads add force and tangent into one prepared storage.

A member sees only the relative pose of its ends; this file turns its wrench (n, m) and stiffness K6 into forces
and a symmetric tangent on the two nodes its ends hang on. With w the lever from node a to end q, s the lever from
node b to end q, all global, the relative motion is xi = (dxb - dxa + dphi_b x s - dphi_a x w, dphi_b - dphi_a),
and the second derivatives of n.xi_t + m.xi_r in the chart R <- exp(dphi) R are
[xa, phia] = [n]x, [xb, phia] = -[n]x, [phib, phia] = n s^T .. see `geometric_tangent`.
"""

from __future__ import annotations

import math

from ksd.beam.entry import (
    DEFAULT,
    LENGTHS,
    chain_condense,
    chain_near,
    chain_recover,
    modal_condense,
    modal_recover,
    polynomial_condense,
    strain_condense,
    strain_condense_default,
    strain_recover,
)
from ksd.beam.linear import linear_condense
from ksd.beam.weight_entry import pull_member, weigh_member
from ksd.model.arrays import COROTATIONAL, LINEAR, MODAL, SOLID, STRAIN
from ksd.numerics.kernel import kernel
from ksd.numerics.local import local_counts, local_matrix, local_vector


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
        f0, f1, f2 = members.frame[i, 1, 0, c], members.frame[i, 1, 1, c], members.frame[i, 1, 2, c]
        t0 = R[b, 0, 0] * f0 + R[b, 0, 1] * f1 + R[b, 0, 2] * f2
        t1 = R[b, 1, 0] * f0 + R[b, 1, 1] * f1 + R[b, 1, 2] * f2
        t2 = R[b, 2, 0] * f0 + R[b, 2, 1] * f1 + R[b, 2, 2] * f2
        for r in range(3):
            Q[r, c] = pose[r] * t0 + pose[3 + r] * t1 + pose[6 + r] * t2


@kernel
def _turn_stiffness(pose, K, A):
    """A (6, 6) = diag(Rp, Rp) K diag(Rp, Rp)^T."""
    T = local_matrix(6, 6)
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
def member_tangent(pose, lam, K, T, force):
    """Node tangent T (12, 12) and forces (12,) on nodes a, b of one member, global axes."""
    A = local_matrix(6, 6)
    M = local_matrix(6, 12)
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
    n, m = local_vector(3), local_vector(3)
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
def _parts(members, inner, store, i, size):
    """Constants, settings, inner state and `store` of member i; the lengths its C entry needs into size (5,)."""
    number = members.number[i]
    state = inner[members.inner_at[i] : members.inner_at[i + 1]]
    kept = store[members.store_at[i] : members.store_at[i + 1]]
    value = members.value[members.value_at[i] :]
    size[0], size[1], size[2], size[3], size[4] = len(value), len(state), len(kept), 0, 0
    return value, number, state, kept


@kernel
def condense_member(members, inner, work, i, d, Q, K, near):
    """Wrench and stiffness of member i at relative pose d (3,), Q (3, 3): the one place that knows the kinds.

    near 0 or less: exact tangent at the state. near 1, 2: Appendix A chains are linearised about the element orientations
    in work.near instead (paper 1, section 3), without (1) or with (2) the geometric stiffness.
    """
    lam = work.lam[i]
    size = local_counts(5)
    value, number, state, kept = _parts(members, inner, work.store, i, size)
    if members.kind[i] == LINEAR:
        return linear_condense(state, d, Q, lam, K)
    out = local_vector(4)
    V, N, S, W = value.ctypes, number.ctypes, state.ctypes, kept.ctypes
    if members.kind[i] == STRAIN:
        scratch = work.scratch
        size[4] = len(scratch)
        own = len(kept) == LENGTHS[1]
        for k in range(4):
            own = own and number[k] == DEFAULT[k]
        if own:
            strain_condense_default(
                V, N, S, W, scratch.ctypes, d.ctypes, Q.ctypes, lam.ctypes, K.ctypes, out.ctypes, size.ctypes
            )
        else:
            strain_condense(
                V, N, S, W, scratch.ctypes, d.ctypes, Q.ctypes, lam.ctypes, K.ctypes, out.ctypes, size.ctypes
            )
    elif members.kind[i] == MODAL:
        modal_condense(V, N, S, W, d.ctypes, Q.ctypes, lam.ctypes, K.ctypes, out.ctypes, size.ctypes)
    elif members.kind[i] == SOLID:
        polynomial_condense(V, N, S, W, d.ctypes, Q.ctypes, lam.ctypes, K.ctypes, out.ctypes, size.ctypes)
    elif near > 0:
        rotations = work.near[work.near_at[i] : work.near_at[i + 1]]
        size[3] = len(rotations)
        chain_near(
            V,
            N,
            S,
            W,
            rotations.ctypes,
            d.ctypes,
            Q.ctypes,
            lam.ctypes,
            K.ctypes,
            near - 1,
            out.ctypes,
            size.ctypes,
        )
    else:
        chain_condense(V, N, S, W, d.ctypes, Q.ctypes, lam.ctypes, K.ctypes, out.ctypes, size.ctypes)
    return int(out[0]), out[1], out[2], int(out[3])


@kernel
def recover_member(members, inner, store, i, xi, scale):
    """Inner update of member i after its end q moved by xi (6,) relative to its end p."""
    size = local_counts(5)
    value, number, state, kept = _parts(members, inner, store, i, size)
    V, N, S, W = value.ctypes, number.ctypes, state.ctypes, kept.ctypes
    if members.kind[i] == STRAIN:
        strain_recover(V, N, S, W, xi.ctypes, scale, size.ctypes)
    elif members.kind[i] == COROTATIONAL:
        chain_recover(V, N, S, W, xi.ctypes, scale, size.ctypes)
    elif members.kind[i] >= MODAL:
        modal_recover(V, N, S, W, xi.ctypes, scale, size.ctypes)


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
def _as_before(members, inner, work, i, d, Q, near, before):
    """Whether member i has the constants, the inner state and the pose of the one before, whose d and Q are in before (12,),
    to the last bit; otherwise its own d and Q are written there. Inner nodes set by orientations are taken over."""
    same = i > 0 and members.value_at[i] == members.value_at[i - 1] and members.kind[i] == members.kind[i - 1]
    for r in range(3):
        same = same and before[r] == d[r]
        before[r] = d[r]
        for c in range(3):
            same = same and before[3 + 3 * r + c] == Q[r, c]
            before[3 + 3 * r + c] = Q[r, c]
    if not same:
        return False
    for c in range(4):
        if members.number[i, c] != members.number[i - 1, c]:
            return False
    if near == 1 and members.kind[i] == COROTATIONAL:
        # what is made of the orientations alone: the inner nodes are set by them
        if not _equal(work.near, work.near_at, i):
            return False
        one, two = members.inner_at[i - 1], members.inner_at[i]
        for k in range(12 * (members.number[i, 0] - 1)):
            inner[two + k] = inner[one + k]
        return True
    return near <= 1 and _equal(inner, members.inner_at, i)


@kernel
def _equal(numbers, at, i):
    """Whether part i of `numbers` holds the same as the part before, of the same length."""
    one, two = at[i - 1], at[i]
    for k in range(at[i + 1] - two):  # noqa: SIM110
        if numbers[one + k] != numbers[two + k]:
            return False
    return True


@kernel
def add_members(arrays, x, R, inner, work, factor, rtol, noise, near):
    """All members, their weight times `factor`, into work.value and work.rhs; near: see `condense_member`.

    Of neighbours without weight that are in the same state, as the two outer leafs of a cross flexure in its plane, one is
    worked on. near -1: nothing is left in work.store for `recover_member`. Returns (negatives, worst inner residual over
    its bound, status).
    """
    members = arrays.members
    weight = work.weight
    negatives, worst, status = 0, 0.0, 0
    Q, K = local_matrix(3, 3), local_matrix(6, 6)
    T, force, d = local_matrix(12, 12), local_vector(12), local_vector(3)
    starts, before = local_counts(2), local_vector(12)
    back, dn, dm, failed = 0, 0.0, 0.0, 0
    for i in range(len(members.kind)):
        pose, lam = work.pose[i], work.lam[i]
        member_pose(members, x, R, i, pose, Q)
        for c in range(3):
            d[c] = pose[c] * pose[15] + pose[3 + c] * pose[16] + pose[6 + c] * pose[17]
        kept = work.store[members.store_at[i] : members.store_at[i + 1]]
        heavy = len(weight) > 0 and weight[i, 0] > 0.0
        if heavy:
            pull_member(pose.ctypes, weight[i].ctypes, factor, kept.ctypes, len(kept))
            before[0] = math.nan
        if not heavy and _as_before(members, inner, work, i, d, Q, near, before):
            # K is still that of the one before
            for r in range(12):
                lam[r] = work.lam[i - 1, r]
            if near >= 0:
                last = members.store_at[i - 1]
                for k in range(len(kept)):
                    kept[k] = work.store[last + k]
        else:
            back, dn, dm, failed = condense_member(members, inner, work, i, d, Q, K, near)
        negatives += back
        status = max(status, failed)
        member_tangent(pose, lam, K, T, force)
        if heavy:
            weigh_member(pose.ctypes, kept.ctypes, len(kept), weight[i, 0], T.ctypes, force.ctypes)
        n = math.sqrt(lam[0] ** 2 + lam[1] ** 2 + lam[2] ** 2)
        m = math.sqrt(lam[3] ** 2 + lam[4] ** 2 + lam[5] ** 2)
        L = members.length[i]
        floor = noise * members.floor[i]
        worst = max(
            worst, dn / (rtol * (n + m / L) + floor + 1e-300), dm / (rtol * (n * L + m) + floor * L + 1e-300)
        )
        for e in range(2):
            node = members.node[i, e]
            starts[e] = arrays.start[node]
            o = 6 * e
            fm = math.sqrt(force[o + 3] ** 2 + force[o + 4] ** 2 + force[o + 5] ** 2)
            fn = math.sqrt(force[o] ** 2 + force[o + 1] ** 2 + force[o + 2] ** 2)
            work.scale[node, 0] += rtol * (max(fn, n) + m / L) + floor
            work.scale[node, 1] += rtol * (max(fm, m) + n * L) + floor * L
        _scatter(members.block[i], T, force, work.rhs, starts, work.value)
    return negatives, worst, status
