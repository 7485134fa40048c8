"""Compiled assembly: members add force and tangent into one prepared storage (`ksd.beam.member_tangent`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ksd.beam import corotational, planar_leaf
from ksd.beam.corotational_linearised import condense_linearised
from ksd.beam.linear import linear_condense
from ksd.beam.member_tangent import member_norms, member_tangent
from ksd.beam.modal import modal_condense, modal_recover
from ksd.beam.polynomial_solid import polynomial_condense
from ksd.beam.strain import (
    allocate_leaf_fields_compiled,
    strain_condense,
    strain_gravity_block,
    strain_recover,
)
from ksd.model.arrays import (
    BLOCK,
    COROTATIONAL,
    FRAME,
    INNER_AT,
    KIND,
    LENGTH,
    MEMBER_COUNT,
    MEMBERS,
    MODAL,
    NODE,
    NUMBER,
    OFFSET,
    PLANAR,
    SOLID,
    START,
    STIFFNESS_SCALE,
    STORE_AT,
    STRAIN,
    VALUE,
    VALUE_AT,
)
from ksd.model.poses import member_pose
from ksd.model.tangents import scatter
from ksd.numerics.kernel import kernel


@kernel(inline="always")
def condense_any(kind, value, number, state, store, near, d, Q, lam, K, A, M):
    """Wrench lam (12,) and stiffness K (6, 6) of a member, not a strain-mode leaf, at relative pose d (3,), Q (3, 3), in
    frame p.

    near: rotation vectors about which a chain is linearised, empty for the exact tangent; A (6, 6), M (6, 12): scratch.
    Returns (negative pivots, force error [N], moment error [Nm], status).
    """
    if kind == MODAL:
        told = modal_condense(value, number, state, store, d, Q, lam, K)
    elif kind == SOLID:
        told = polynomial_condense(value, number, state, store, d, Q, lam, K)
    else:
        told = condense_beam(kind, value, number, state, store, near, d, Q, lam, K, A, M)
    return told


@kernel(inline="always")
def condense_beam(kind, value, number, state, store, near, d, Q, lam, K, A, M):
    """`condense_any` but of modal bodies and solids, which take as long to compile as the others together."""
    if len(near) > 0:
        told = condense_linearised(value, number, state, store, near, d, Q, lam, K, A, M)
    elif kind == COROTATIONAL:
        told = corotational.condense(value, number, state, store, d, Q, lam, K)
    else:
        told = condense_linear(kind, value, number, state, store, near, d, Q, lam, K, A, M)
    return told


@kernel(inline="always")
def condense_linear(kind, value, number, state, store, near, d, Q, lam, K, A, M):
    """`condense_any` of linear bodies alone."""
    return linear_condense(state, d, Q, lam, K, A, M)


@kernel(inline="always")
def follow_leaf(kind, value, number, state, store, leaf, lam, K):
    """What the weight of a strain-mode leaf does, after it was condensed."""
    if kind == STRAIN:
        strain_gravity_block(value, number, state, store, leaf, lam, K)
    elif kind == PLANAR:
        planar_leaf.gravity_block(value, number, state, store, lam)


@kernel(inline="always")
def no_weight_followed(kind, value, number, state, store, leaf, lam, K):
    """`follow_leaf` where nothing weighs anything."""


@kernel(inline="always")
def recover_leaf(kind, value, number, state, store, xi, scale, step):
    """`recover_beam` of strain-mode leaves and linear bodies alone."""
    if kind == PLANAR:
        planar_leaf.recover(value, number, state, store, xi, scale)
    elif kind == STRAIN:
        strain_recover(value, number, state, store, xi, scale, step)


@kernel(inline="always")
def recover_beam(kind, value, number, state, store, xi, scale, step):
    """`recover_any` but of modal bodies and solids."""
    if kind == COROTATIONAL:
        corotational.recover(value, number, state, store, xi, scale)
    else:
        recover_leaf(kind, value, number, state, store, xi, scale, step)


@kernel(inline="always")
def recover_any(kind, value, number, state, store, xi, scale, step):
    """Inner update of a member after its end q moved by xi (6,) relative to its end p; step (6,) or more: scratch."""
    if kind in (MODAL, SOLID):
        modal_recover(value, number, state, store, xi, scale)
    else:
        recover_beam(kind, value, number, state, store, xi, scale, step)


@kernel(inline="always")
def no_weight(pose, weight, i, factor, store):
    """`ksd.beam.weight_assembly.set_member_gravity` where nothing weighs anything."""


@kernel(inline="always")
def no_weight_added(pose, store, mass, T, force):
    """`ksd.beam.weight_assembly.add_member_weight` where nothing weighs anything."""


@kernel(inline="late")
def _as_before(ints, i, numbers, one, two, count, d, Q, before):
    """Whether member i has the constants, the pose and the part of `numbers`, `count` of them from `two` on, of the one
    before, whose d and Q are in before (12,) and part begins at `one`, to the last bit; its d and Q are written there."""
    kind, value_at, number = (
        ints[MEMBERS + KIND] + i,
        ints[MEMBERS + VALUE_AT] + i,
        ints[MEMBERS + NUMBER] + 4 * i,
    )
    same = i > 0
    for r in range(3):
        same &= before[r] == d[r]
        before[r] = d[r]
        for c in range(3):
            same &= before[3 + 3 * r + c] == Q[r, c]
            before[3 + 3 * r + c] = Q[r, c]
    same &= ints[value_at] == ints[value_at - 1]
    same &= ints[kind] == ints[kind - 1]
    for c in range(4):
        same &= ints[number + c] == ints[number - 4 + c]
    for k in range(count if same else 0):
        same &= numbers[one + k] == numbers[two + k]
    return same


@kernel(inline="late")
def _repeat(numbers, one, two, count):
    """The `count` numbers from `two` on become those from `one` on."""
    for k in range(count):
        numbers[two + k] = numbers[one + k]


class Room(NamedTuple):
    """Storage for one member at a time: its pose and relative orientation, wrench and stiffness, tangent and forces on its
    nodes, norms of these, pose of the member before, scratch of `member_tangent`."""

    pose: np.ndarray
    Q: np.ndarray
    d: np.ndarray
    lam: np.ndarray
    K: np.ndarray
    T: np.ndarray
    force: np.ndarray
    norms: np.ndarray
    before: np.ndarray
    A: np.ndarray
    M: np.ndarray


@kernel
def open_member_room():
    """`Room` for a member."""
    return Room(
        np.empty(18), np.empty((3, 3)), np.empty(3), np.empty(12), np.empty((6, 6)), np.empty((12, 12)), np.empty(12),
        np.empty(6), np.empty(12), np.empty((6, 6)), np.empty((6, 12)),
    )  # fmt: skip


@kernel
def open_leaf_room(ints):
    """`ksd.beam.strain.LeafFields` for the strain-mode leaves there are."""
    # no literals, for which numba would compile twice
    modes = points = ints[0] * 0
    for i in range(ints[MEMBER_COUNT]):
        if ints[ints[MEMBERS + KIND] + i] == STRAIN:
            number = ints[MEMBERS + NUMBER] + 4 * i
            modes = max(modes, ints[number] + ints[number + 1] + ints[number + 2])
            points = max(points, ints[number + 3])
    return allocate_leaf_fields_compiled(modes, points)


@kernel(inline="always")
def add_members(
    condense, pull, follow, weigh, ints, floats, x, R, inner, work, room, leaf, factor, rtol, noise, near
):
    """All members, their weight times `factor`, into work.matrix and work.rhs; condense, pull, follow, weigh: for what there
    is.

    near 0: exact tangents at the state; 1: Appendix A chains are linearised about the element orientations in
    work.linearisation (paper 1, section 3), their inner state is set. Of neighbours that are in the same state, as the two
    outer leaves of a cross flexure in its plane, one is worked on. Returns (negatives, worst inner residual over its bound,
    status).
    """
    # by names of their own: every look into a named tuple counts the users of an array
    pose, Q, d = room.pose, room.Q, room.d
    lam, K, T = room.lam, room.K, room.T
    force, norms, before = room.force, room.norms, room.before
    A, M = room.A, room.M
    store, weight = work.store, work.weight
    near_at, close = work.linearisation_at, work.linearisation
    matrix, rhs, scale = work.matrix, work.rhs, work.scale
    poses, lams = work.pose, work.lam
    node, value_at, number_at = ints[MEMBERS + NODE], ints[MEMBERS + VALUE_AT], ints[MEMBERS + NUMBER]
    inner_at, store_at, block = ints[MEMBERS + INNER_AT], ints[MEMBERS + STORE_AT], ints[MEMBERS + BLOCK]
    negatives, worst, status = 0, 0.0, 0
    back, dn, dm, told = 0, 0.0, 0.0, 0
    for i in range(ints[MEMBER_COUNT]):
        a, b, kind = ints[node + 2 * i], ints[node + 2 * i + 1], ints[ints[MEMBERS + KIND] + i]
        member_pose(
            ints, node + 2 * i, floats, ints[MEMBERS + OFFSET] + 6 * i, floats, ints[MEMBERS + FRAME] + 18 * i, x, R, pose, Q
        )  # fmt: skip
        for c in range(3):
            d[c] = pose[c] * pose[15] + pose[3 + c] * pose[16] + pose[6 + c] * pose[17]
        linearised = near == 1 and near_at[i] < near_at[i + 1]
        heavy = len(weight) > 0 and weight[i, 0] > 0.0
        own, kept = ints[inner_at + i], ints[store_at + i]
        # lengths of its inner state and store, and where those of the member before begin
        state_size, store_size = ints[inner_at + i + 1] - own, ints[store_at + i + 1] - kept
        own_before, kept_before = ints[inner_at + max(i - 1, 0)], ints[store_at + max(i - 1, 0)]
        if linearised:
            # the inner state follows from the near configuration
            at = near_at[i]
            same = _as_before(ints, i, close, near_at[max(i - 1, 0)], at, near_at[i + 1] - at, d, Q, before)
        else:
            same = _as_before(ints, i, inner, own_before, own, state_size, d, Q, before)
        if heavy:
            # gravity is the same in equal frames
            for r in range(4):
                same = same and weight[i - 1, r] == weight[i, r]
            for r in range(9):
                same = same and poses[i - 1, r] == pose[r]
        if same:
            _repeat(store, kept_before, kept, store_size)
            if linearised:
                _repeat(inner, own_before, own, state_size)
        else:
            mine = store[kept : kept + store_size]
            if heavy:
                pull(pose, weight, i, factor, mine)
            state, number = inner[own : own + state_size], ints[number_at + 4 * i : number_at + 4 * i + 4]
            value = floats[ints[MEMBERS + VALUE] + ints[value_at + i] :]
            # leaf springs apart: to hand on their room counts the users of two dozen arrays
            if kind == PLANAR:
                back, dn, dm, told = planar_leaf.condense(value, number, state, mine, d, Q, lam, K)
            elif kind == STRAIN:
                back, dn, dm, told = strain_condense(value, number, state, mine, leaf, d, Q, lam, K)
            else:
                back, dn, dm, told = condense(
                    kind, value, number, state, mine, close[near_at[i] : near_at[i + 1] if linearised else near_at[i]],
                    d, Q, lam, K, A, M,
                )  # fmt: skip
            if heavy:
                follow(kind, value, number, state, mine, leaf, lam, K)
        member_tangent(pose, lam, K, T, force, A, M)
        negatives += back
        status = max(status, told)
        if heavy:
            weigh(pose, store[kept : kept + store_size], weight[i, 0], T, force)
        member_norms(lam, force, norms)
        n, m, L = norms[0], norms[1], floats[ints[MEMBERS + LENGTH] + i]
        floor = noise * floats[ints[MEMBERS + STIFFNESS_SCALE] + i]
        worst = max(
            worst, dn / (rtol * (n + m / L) + floor + 1e-300), dm / (rtol * (n * L + m) + floor * L + 1e-300)
        )
        for e in range(2):
            k = ints[node + 2 * i + e]
            scale[k, 0] += rtol * (max(norms[2 + 2 * e], n) + m / L) + floor
            scale[k, 1] += rtol * (max(norms[3 + 2 * e], m) + n * L) + floor * L
        for r in range(18):
            poses[i, r] = pose[r]
        for r in range(12):
            lams[i, r] = lam[r]
        scatter(ints, block + 4 * i, T, force, ints[ints[START] + a], ints[ints[START] + b], matrix, rhs)
    return negatives, worst, status
