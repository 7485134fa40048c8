"""Compiled assembly: members add force and tangent into one prepared storage (`ksd.model.tangents`)."""

from __future__ import annotations

import math

from ksd.beam.entry import (
    chain_condense,
    chain_near,
    chain_recover,
    modal_condense,
    modal_recover,
    planar_condense,
    planar_recover,
    polynomial_condense,
    strain_condense,
    strain_recover,
)
from ksd.beam.linear import linear_condense
from ksd.beam.weight_entry import pull_member, weigh_member
from ksd.model.arrays import COROTATIONAL, LINEAR, MODAL, PLANAR, SOLID, STRAIN
from ksd.model.poses import member_pose
from ksd.model.tangents import member_norms, member_tangent, scatter
from ksd.numerics.kernel import kernel
from ksd.numerics.local import local_counts, local_matrix, local_vector


@kernel
def condense_member(members, inner, work, i, d, Q, K):
    """Wrench and stiffness of member i at relative pose d (3,), Q (3, 3): the one place that knows the kinds."""
    lam = work.lam[i]
    size = local_counts(5)
    number, value = members.number[i], members.value[members.value_at[i] :]
    state = inner[members.inner_at[i] : members.inner_at[i + 1]]
    kept = work.store[members.store_at[i] : members.store_at[i + 1]]
    size[0], size[1], size[2], size[3], size[4] = len(value), len(state), len(kept), 0, 0
    if members.kind[i] == LINEAR:
        return linear_condense(state, d, Q, lam, K)
    out = local_vector(4)
    V, N, S, W = value.ctypes, number.ctypes, state.ctypes, kept.ctypes
    if members.kind[i] == PLANAR:
        planar_condense(V, N, S, W, d.ctypes, Q.ctypes, lam.ctypes, K.ctypes, out.ctypes, size.ctypes)
    elif members.kind[i] == STRAIN:
        size[4] = len(work.scratch)
        strain_condense(
            V, N, S, W, work.scratch.ctypes, d.ctypes, Q.ctypes, lam.ctypes, K.ctypes, out.ctypes, size.ctypes
        )
    elif members.kind[i] == MODAL:
        modal_condense(V, N, S, W, d.ctypes, Q.ctypes, lam.ctypes, K.ctypes, out.ctypes, size.ctypes)
    elif members.kind[i] == SOLID:
        polynomial_condense(V, N, S, W, d.ctypes, Q.ctypes, lam.ctypes, K.ctypes, out.ctypes, size.ctypes)
    else:
        chain_condense(V, N, S, W, d.ctypes, Q.ctypes, lam.ctypes, K.ctypes, out.ctypes, size.ctypes)
    return int(out[0]), out[1], out[2], int(out[3])


@kernel
def _condense_near(members, inner, work, i, d, Q, K):
    """As `condense_member`, of a chain linearised about the element orientations in work.near."""
    size, out = local_counts(5), local_vector(4)
    number, value = members.number[i], members.value[members.value_at[i] :]
    state = inner[members.inner_at[i] : members.inner_at[i + 1]]
    kept = work.store[members.store_at[i] : members.store_at[i + 1]]
    near, lam = work.near[work.near_at[i] : work.near_at[i + 1]], work.lam[i]
    size[0], size[1], size[2], size[3], size[4] = len(value), len(state), len(kept), len(near), 0
    V, N, S, W = value.ctypes, number.ctypes, state.ctypes, kept.ctypes
    chain_near(V, N, S, W, near.ctypes, d.ctypes, Q.ctypes, lam.ctypes, K.ctypes, out.ctypes, size.ctypes)
    return int(out[0]), out[1], out[2], int(out[3])


@kernel
def recover_member(members, inner, store, i, xi, scale):
    """Inner update of member i after its end q moved by xi (6,) relative to its end p."""
    size = local_counts(5)
    number, value = members.number[i], members.value[members.value_at[i] :]
    state = inner[members.inner_at[i] : members.inner_at[i + 1]]
    kept = store[members.store_at[i] : members.store_at[i + 1]]
    size[0], size[1], size[2], size[3], size[4] = len(value), len(state), len(kept), 0, 0
    V, N, S, W = value.ctypes, number.ctypes, state.ctypes, kept.ctypes
    if members.kind[i] == PLANAR:
        planar_recover(V, N, S, W, xi.ctypes, scale, size.ctypes)
    elif members.kind[i] == STRAIN:
        strain_recover(V, N, S, W, xi.ctypes, scale, size.ctypes)
    elif members.kind[i] == COROTATIONAL:
        chain_recover(V, N, S, W, xi.ctypes, scale, size.ctypes)
    elif members.kind[i] == MODAL or members.kind[i] == SOLID:
        modal_recover(V, N, S, W, xi.ctypes, scale, size.ctypes)


@kernel
def _as_before(members, state, at, i, d, Q, before):
    """Whether member i has the constants, the pose and the part of `state`, from at[i] on, of the one before, whose d and Q
    are in before (12,), to the last bit; otherwise its own d and Q are written there."""
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
    return _equal(state, at, i)


@kernel
def _equal(numbers, at, i):
    """Whether part i of `numbers` holds the same as the part before, of the same length."""
    one, two = at[i - 1], at[i]
    for k in range(at[i + 1] - two):  # noqa: SIM110
        if numbers[one + k] != numbers[two + k]:
            return False
    return True


@kernel
def _copy_before(numbers, at, i):
    """Part i of `numbers` becomes the part before, of the same length."""
    last, own = at[i - 1], at[i]
    for k in range(at[i + 1] - own):
        numbers[own + k] = numbers[last + k]


@kernel
def _take_member(members, x, R, inner, work, factor, near, i, K, before, told):
    """Pose, wrench, stiffness of member i, and told (4,): negatives, errors, status, see `condense_member`.

    K, before (12,) and told are those of the member before when this one is in the same state; near: see `add_members`.
    """
    pose, lam = work.pose[i], work.lam[i]
    Q, d = local_matrix(3, 3), local_vector(3)
    member_pose(members, x, R, i, pose, Q)
    for c in range(3):
        d[c] = pose[c] * pose[15] + pose[3 + c] * pose[16] + pose[6 + c] * pose[17]
    state, at = inner, members.inner_at
    linearised = near == 1 and work.near_at[i] < work.near_at[i + 1]
    if linearised:
        # the inner state follows from these
        state, at = work.near, work.near_at
    if len(work.weight) > 0 and work.weight[i, 0] > 0.0:
        kept = work.store[members.store_at[i] : members.store_at[i + 1]]
        pull_member(pose.ctypes, work.weight[i].ctypes, factor, kept.ctypes, len(kept))
        before[0] = math.nan
    elif _as_before(members, state, at, i, d, Q, before):
        for r in range(12):
            lam[r] = work.lam[i - 1, r]
        if near >= 0:
            _copy_before(work.store, members.store_at, i)
        if linearised:
            _copy_before(inner, members.inner_at, i)
        return
    if linearised:
        told[0], told[1], told[2], told[3] = _condense_near(members, inner, work, i, d, Q, K)
    else:
        told[0], told[1], told[2], told[3] = condense_member(members, inner, work, i, d, Q, K)


@kernel
def add_members(arrays, x, R, inner, work, factor, rtol, noise, near):
    """All members, their weight times `factor`, into work.value and work.rhs.

    near 0: exact tangents at the state; -1: the same, but nothing is left in work.store for `recover_member`; 1: Appendix A
    chains are linearised about the element orientations in work.near (paper 1, section 3), their
    inner state is set. Of neighbours without weight that are in the same state, as the two outer leafs of a cross flexure in
    its plane, one is worked on. Returns (negatives, worst inner residual over its bound, status).
    """
    members, weight = arrays.members, work.weight
    negatives, worst, status = 0.0, 0.0, 0.0
    K, T, force = local_matrix(6, 6), local_matrix(12, 12), local_vector(12)
    starts, before, told, norms = local_counts(2), local_vector(12), local_vector(4), local_vector(6)
    for i in range(len(members.kind)):
        pose, lam = work.pose[i], work.lam[i]
        _take_member(members, x, R, inner, work, factor, near, i, K, before, told)
        member_tangent(pose, lam, K, T, force)
        member_norms(lam, force, norms)
        dn, dm = told[1], told[2]
        negatives += told[0]
        status = max(status, told[3])
        heavy = len(weight) > 0 and weight[i, 0] > 0.0
        if heavy:
            kept = work.store[members.store_at[i] : members.store_at[i + 1]]
            weigh_member(pose.ctypes, kept.ctypes, len(kept), weight[i, 0], T.ctypes, force.ctypes)
            member_norms(lam, force, norms)
        n, m = norms[0], norms[1]
        L = members.length[i]
        floor = noise * members.floor[i]
        worst = max(
            worst, dn / (rtol * (n + m / L) + floor + 1e-300), dm / (rtol * (n * L + m) + floor * L + 1e-300)
        )
        for e in range(2):
            node = members.node[i, e]
            starts[e] = arrays.start[node]
            work.scale[node, 0] += rtol * (max(norms[2 + 2 * e], n) + m / L) + floor
            work.scale[node, 1] += rtol * (max(norms[3 + 2 * e], m) + n * L) + floor * L
        scatter(arrays.keep, members.block[i], T, force, work.rhs, starts, work.value)
    return int(negatives), worst, int(status)
