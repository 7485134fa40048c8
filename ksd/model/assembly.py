"""Compiled assembly: members add force and tangent into one prepared storage (`ksd.model.tangents`)."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ksd.beam import corotational, planar_leaf
from ksd.beam.corotational_near import near_condense
from ksd.beam.linear import linear_condense
from ksd.beam.modal import modal_condense, modal_recover
from ksd.beam.polynomial import polynomial_condense
from ksd.beam.strain import strain_condense, strain_recover
from ksd.model.arrays import COROTATIONAL, MODAL, PLANAR, SOLID, STRAIN
from ksd.model.poses import member_pose
from ksd.model.tangents import member_norms, member_tangent, scatter
from ksd.numerics.kernel import kernel


def condense_member(
    kind: Any,
    value: Any,
    number: Any,
    state: Any,
    store: Any,
    scratch: Any,
    near: Any,
    d: Any,
    Q: Any,
    lam: Any,
    K: Any,
) -> Any:
    """Wrench lam (12,) and stiffness K (6, 6) of a member at relative pose d (3,), Q (3, 3), in frame p.

    near: rotation vectors about which a chain is linearised, empty for the exact tangent. Returns (negative pivots, force
    error [N], moment error [Nm], status).
    """
    if len(near) > 0:
        told = near_condense(value, number, state, store, near, d, Q, lam, K)
    elif kind == COROTATIONAL:
        told = corotational.condense(value, number, state, store, d, Q, lam, K)
    elif kind == MODAL:
        told = modal_condense(value, number, state, store, d, Q, lam, K)
    elif kind == SOLID:
        told = polynomial_condense(value, number, state, store, d, Q, lam, K)
    else:
        told = condense_leaf(kind, value, number, state, store, scratch, near, d, Q, lam, K)
    return told


@kernel(inline="always")
def condense_leaf(kind, value, number, state, store, scratch, near, d, Q, lam, K):
    """`condense_member` of strain-mode leaves and linear bodies alone, which compile in half the time."""
    if kind == PLANAR:
        told = planar_leaf.condense(value, number, state, store, d, Q, lam, K)
    elif kind == STRAIN:
        told = strain_condense(value, number, state, store, scratch, d, Q, lam, K)
    else:
        told = linear_condense(state, d, Q, lam, K)
    return told


condense_any = kernel(inline="always")(condense_member)


@kernel(inline="always")
def recover_leaf(kind, value, number, state, store, xi, scale):
    """`recover_any` of strain-mode leaves and linear bodies alone."""
    if kind == PLANAR:
        planar_leaf.recover(value, number, state, store, xi, scale)
    elif kind == STRAIN:
        strain_recover(value, number, state, store, xi, scale)


@kernel(inline="always")
def recover_any(kind, value, number, state, store, xi, scale):
    """Inner update of a member after its end q moved by xi (6,) relative to its end p."""
    if kind == COROTATIONAL:
        corotational.recover(value, number, state, store, xi, scale)
    elif kind in (MODAL, SOLID):
        modal_recover(value, number, state, store, xi, scale)
    else:
        recover_leaf(kind, value, number, state, store, xi, scale)


@kernel(inline="always")
def no_weight(pose, weight, factor, store):
    """`ksd.beam.weight_entry.pull_member` where nothing weighs anything."""


@kernel(inline="always")
def no_weight_added(pose, store, mass, T, force):
    """`ksd.beam.weight_entry.weigh_member` where nothing weighs anything."""


@kernel
def _as_before(value_at, number, kind, numbers, at, i, d, Q, before):
    """Whether member i has the constants, the pose and the part of `numbers`, from at[i] on, of the one before, whose d and
    Q are in before (12,), to the last bit; its own d and Q are written there."""
    same = i > 0 and value_at[i] == value_at[i - 1] and kind[i] == kind[i - 1]
    for r in range(3):
        same = same and before[r] == d[r]
        before[r] = d[r]
        for c in range(3):
            same = same and before[3 + 3 * r + c] == Q[r, c]
            before[3 + 3 * r + c] = Q[r, c]
    if same:
        for c in range(4):
            same = same and number[i, c] == number[i - 1, c]
        one, two, k = at[i - 1], at[i], 0
        while same and k < at[i + 1] - two:
            same = numbers[one + k] == numbers[two + k]
            k += 1
    return same


@kernel
def _copy_before(numbers, at, i):
    """Part i of `numbers` becomes the part before, of the same length."""
    last, own = at[i - 1], at[i]
    for k in range(at[i + 1] - own):
        numbers[own + k] = numbers[last + k]


@kernel(inline="always")
def add_members(condense, pull, weigh, arrays, x, R, inner, work, factor, rtol, noise, near):
    """All members, their weight times `factor`, into work.value and work.rhs; condense, pull, weigh: for what there is.

    near 0: exact tangents at the state; 1: Appendix A chains are linearised about the element orientations in work.near
    (paper 1, section 3), their inner state is set. Of neighbours without weight that are in the same state, as the two
    outer leaves of a cross flexure in its plane, one is worked on. Returns (negatives, worst inner residual over its bound,
    status).
    """
    # by names of their own: every look into a named tuple counts the users of an array
    members, start, keep = arrays.members, arrays.start, arrays.keep
    kinds, node, offset, frame, number = (
        members.kind,
        members.node,
        members.offset,
        members.frame,
        members.number,
    )
    value_at, value, inner_at, store_at = members.value_at, members.value, members.inner_at, members.store_at
    length, floors, block = members.length, members.floor, members.block
    poses, wrenches, store, near_at, close = work.pose, work.lam, work.store, work.near_at, work.near
    matrix, rhs, scale, weight, scratch = work.value, work.rhs, work.scale, work.weight, work.scratch
    negatives, worst, status = 0, 0.0, 0
    back, dn, dm, told = 0, 0.0, 0.0, 0
    Q, d, K, T, force = np.empty((3, 3)), np.empty(3), np.empty((6, 6)), np.empty((12, 12)), np.empty(12)
    starts, before, norms = np.empty(2, np.int64), np.empty(12), np.empty(6)
    A, M = np.empty((6, 6)), np.empty((6, 12))
    for i in range(len(kinds)):
        pose, lam = poses[i], wrenches[i]
        member_pose(node, offset, frame, x, R, i, pose, Q)
        for c in range(3):
            d[c] = pose[c] * pose[15] + pose[3 + c] * pose[16] + pose[6 + c] * pose[17]
        linearised = near == 1 and near_at[i] < near_at[i + 1]
        heavy = len(weight) > 0 and weight[i, 0] > 0.0
        same = False
        if heavy:
            pull(pose, weight[i], factor, store[store_at[i] : store_at[i + 1]])
            before[0] = math.nan
        elif linearised:
            # the inner state follows from the near configuration
            same = _as_before(value_at, number, kinds, close, near_at, i, d, Q, before)
        else:
            same = _as_before(value_at, number, kinds, inner, inner_at, i, d, Q, before)
        if same:
            for r in range(12):
                lam[r] = wrenches[i - 1, r]
            _copy_before(store, store_at, i)
            if linearised:
                _copy_before(inner, inner_at, i)
        else:
            about = close[near_at[i] : near_at[i + 1] if linearised else near_at[i]]
            back, dn, dm, told = condense(
                kinds[i], value[value_at[i] :], number[i], inner[inner_at[i] : inner_at[i + 1]],
                store[store_at[i] : store_at[i + 1]], scratch, about, d, Q, lam, K,
            )  # fmt: skip
        member_tangent(pose, lam, K, T, force, A, M)
        negatives += back
        status = max(status, told)
        if heavy:
            weigh(pose, store[store_at[i] : store_at[i + 1]], weight[i, 0], T, force)
        member_norms(lam, force, norms)
        n, m, L, floor = norms[0], norms[1], length[i], noise * floors[i]
        worst = max(
            worst, dn / (rtol * (n + m / L) + floor + 1e-300), dm / (rtol * (n * L + m) + floor * L + 1e-300)
        )
        for e in range(2):
            k = node[i, e]
            starts[e] = start[k]
            scale[k, 0] += rtol * (max(norms[2 + 2 * e], n) + m / L) + floor
            scale[k, 1] += rtol * (max(norms[3 + 2 * e], m) + n * L) + floor * L
        scatter(keep, block[i], T, force, rhs, starts, matrix)
    return negatives, worst, status
