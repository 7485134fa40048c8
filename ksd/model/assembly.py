"""Compiled assembly of the forces and tangents of all members (`ksd.elements.ends`)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ksd.elements import corotational, planar_leaf
from ksd.elements.corotational_linearised import condense_linearised
from ksd.elements.ends import member_norms, member_pose, member_tangent
from ksd.elements.inertia import move_inertia_forces, set_inertia_forces
from ksd.elements.leaf_loads import add_member_loads, move_member_loads, set_member_loads
from ksd.elements.linear import linear_condense
from ksd.elements.modal import modal_condense, modal_recover
from ksd.elements.polynomial_solid import polynomial_condense
from ksd.elements.pressure import GIVEN_MODES, pressure_in_plane, pressure_in_space
from ksd.elements.spring import coil_condense, torsion_condense
from ksd.elements.strain import (
    allocate_leaf_fields_compiled,
    strain_condense,
    strain_gravity_block,
    strain_recover,
)
from ksd.model.arrays import (
    AT,
    COIL,
    COROTATIONAL,
    DOFS_PER_NODE,
    LEAF_COUNT,
    MEMBER,
    MEMBER_COUNT,
    MODAL,
    PLANAR,
    ROWS,
    SETTINGS,
    SOLID,
    STRAIN,
    TERM,
    TORSION,
)  # fmt: skip
from ksd.numerics.kernel import kernel


@kernel(inline="always")
def condense_any(kind, value, number, state, store, linearisation, counted, d, Q, lam, K, A, M):
    """Wrench lam (12,) and stiffness K (6, 6), in frame p, of a member that is not a strain-mode leaf.

    d (3,), Q (3, 3): pose of end q in frame p; linearisation: rotation vectors about which a chain is linearised, empty for
    the exact tangent; counted: from the counted angle of a torsion spring, which is replaced; A (6, 6), M (6, 12): scratch.
    Returns (negative pivots, force error [N], moment error [Nm], status).
    """
    if kind == MODAL:
        result = modal_condense(value, number, state, store, d, Q, lam, K)
    elif kind == SOLID:
        result = polynomial_condense(value, number, state, store, d, Q, lam, K)
    else:
        result = condense_beam(kind, value, number, state, store, linearisation, counted, d, Q, lam, K, A, M)
    return result


@kernel(inline="always")
def condense_beam(kind, value, number, state, store, linearisation, counted, d, Q, lam, K, A, M):
    """`condense_any` without modal bodies and solids, which take as long to compile as all others together."""
    if len(linearisation) > 0:
        result = condense_linearised(value, number, state, store, linearisation, d, Q, lam, K, A, M)
    elif kind == COROTATIONAL:
        result = corotational.condense(value, number, state, store, d, Q, lam, K)
    elif kind == COIL:
        result = 0, 0.0, 0.0, coil_condense(value, d, lam, K)
    elif kind == TORSION:
        torsion_condense(value, counted, Q, lam, K)
        result = 0, 0.0, 0.0, 0
    else:
        # condensed joints have their numbers as inner state, elastic links as constants
        result = linear_condense(state if len(state) > 0 else value, d, Q, lam, K, A, M)
    return result


@kernel(inline="always")
def condense_linear(kind, value, number, state, store, linearisation, counted, d, Q, lam, K, A, M):
    """`condense_any` for linear bodies only."""
    return linear_condense(state, d, Q, lam, K, A, M)


@kernel
def set_spatial_loads(value, number, state, store, leaf, lam, K):
    """Set the gravity block of a spatial leaf with distributed loads, after it was condensed, in its store."""
    strain_gravity_block(value, number, state, store, leaf, lam, K)
    if number[5] > GIVEN_MODES:
        pressure_in_space(value, number, store, leaf, lam)


@kernel
def set_planar_loads(value, number, state, store, lam, K):
    """`set_spatial_loads` of a planar leaf."""
    planar_leaf.gravity_block(value, number, state, store, lam)
    if number[5] > GIVEN_MODES:
        pressure_in_plane(value, number, state, store, lam, K)


@kernel(inline="always")
def set_planar_inertia(value, number, state, store, lam, K):
    """`set_planar_loads` in a time step."""
    planar_leaf.gravity_block(value, number, state, store, lam)


@kernel(inline="always")
def skip_spatial_loads(value, number, state, store, leaf, lam, K):
    """`set_spatial_loads` for mechanisms without weight of members."""


@kernel(inline="always")
def skip_planar_loads(value, number, state, store, lam, K):
    """`set_planar_loads` for mechanisms without weight of members."""


@kernel(inline="always")
def recover_leaf(kind, value, number, state, store, xi, scale, step):
    """`recover_any` for strain-mode leaves and linear bodies only."""
    if kind == PLANAR:
        planar_leaf.recover(value, number, state, store, xi, scale)
    elif kind == STRAIN:
        strain_recover(value, number, state, store, xi, scale, step)


@kernel(inline="always")
def recover_beam(kind, value, number, state, store, xi, scale, step):
    """`recover_any` without modal bodies and solids."""
    if kind == COROTATIONAL:
        corotational.recover(value, number, state, store, xi, scale)
    else:
        recover_leaf(kind, value, number, state, store, xi, scale, step)


@kernel(inline="always")
def recover_any(kind, value, number, state, store, xi, scale, step):
    """Update the inner state of a member after a motion xi (6,) of its end q relative to end p; step (6,): scratch."""
    if kind in (MODAL, SOLID):
        modal_recover(value, number, state, store, xi, scale)
    else:
        recover_beam(kind, value, number, state, store, xi, scale, step)


@kernel(inline="always")
def set_gravity(is_planar, number, pose, weight, i, factor, state, store):
    """Write the distributed loads of a member, in its frame p, into its gravity block."""
    set_member_loads(number, is_planar, pose, weight[i], factor, state, store)


@kernel(inline="always")
def add_weight(active, w, c0, value, number, is_planar, xa, pose, state, store, mass, T, force):
    """Add the distributed loads of a condensed member to its tangent T (12, 12) and forces (12,) on both nodes; arguments
    and what is returned: `ksd.elements.inertia.add_member_inertia`."""
    change, heavy = add_member_loads(value, number, is_planar, pose, store, mass, T, force)
    return 0, change, heavy, 0


@kernel(inline="always")
def rotate_gravity(ints, is_planar, number, pose, move, xi, state, scale, store):
    """Write the change of the distributed loads in frame p, when the nodes of a member move by move (12,) and its end q by
    xi (6,) relative to end p, into its gravity block."""
    move_member_loads(number, is_planar, pose, move, xi, state, scale, store)


@kernel(inline="always")
def skip_set_gravity(is_planar, number, pose, weight, i, factor, state, store):
    """`set_gravity` for mechanisms without weight of members."""


@kernel(inline="always")
def skip_add_weight(active, w, c0, value, number, is_planar, xa, pose, state, store, mass, T, force):
    """`add_weight` for mechanisms without weight of members."""
    return 0, 0.0, 0.0, 0


@kernel(inline="always")
def skip_rotate_gravity(ints, is_planar, number, pose, move, xi, state, scale, store):
    """`rotate_gravity` for mechanisms without weight of members."""


@kernel(inline="always")
def set_inertia(is_planar, number, pose, weight, i, factor, state, store):
    """`set_gravity` in a time step."""
    set_inertia_forces(number, is_planar, pose, state, store)


@kernel(inline="always")
def move_inertia(ints, is_planar, number, pose, move, xi, state, scale, store):
    """`rotate_gravity` in a time step."""
    active, w = ints[ints[AT.active_dofs] :], ints[DOFS_PER_NODE]
    move_inertia_forces(active, w, number, is_planar, pose, move, state, scale, store)


@kernel(inline="always")
def has_loads(weight, i, kind, number):
    """Whether member i has distributed loads; weight, number: `Arrays.weight` and its settings."""
    return i < len(weight) and (weight[i, 0] > 0.0 or (kind in (STRAIN, PLANAR) and number[5] > 0))


@kernel(inline="late")
def _equals_previous(ints, i, numbers, one, two, count, d, Q, previous):
    """Whether member i equals the previous one to the last bit, in constants, pose and `count` numbers.

    The numbers of the previous member start at numbers[one], those of member i at numbers[two]. previous (12,): d and Q of
    the previous member, overwritten by those of member i.
    """
    kind, value_at, number = (
        ints[MEMBER.kind] + i,
        ints[MEMBER.value_at] + i,
        ints[MEMBER.number] + SETTINGS * i,
    )
    same = i > 0
    for r in range(3):
        same &= previous[r] == d[r]
        previous[r] = d[r]
        for c in range(3):
            same &= previous[3 + 3 * r + c] == Q[r, c]
            previous[3 + 3 * r + c] = Q[r, c]
    same &= ints[value_at] == ints[value_at - 1]
    same &= ints[kind] == ints[kind - 1]
    for c in range(SETTINGS):
        same &= ints[number + c] == ints[number - SETTINGS + c]
    for k in range(count if same else 0):
        same &= numbers[one + k] == numbers[two + k]
    return same


@kernel(inline="late")
def _copy(numbers, one, two, count):
    """Copy `count` numbers from numbers[one:] to numbers[two:]."""
    for k in range(count):
        numbers[two + k] = numbers[one + k]


@kernel
def scatter(ints, block, T, force, a, b, matrix, rhs):
    """Add tangent T (12, 12) and force (12,) of a node pair to the block matrix and the residual, for the active degrees of
    freedom. ints[block:]: offsets of the blocks as in `Members.block`; a, b: first unknowns of the nodes."""
    active, w = ints[AT.active_dofs], ints[DOFS_PER_NODE]
    for e in range(2):
        at, u = ints[block + e], a if e == 0 else b
        if at >= 0:
            for r in range(w):
                i = 6 * e + ints[active + r]
                rhs[u + r] += force[i]
                for c in range(w):
                    matrix[at + w * r + c] += T[i, 6 * e + ints[active + c]]
    couple(ints, ints[block + 2], ints[block + 3], T, matrix)


@kernel(inline="late")
def couple(ints, at, flipped, T, matrix):
    """Add the coupling block of T (12, 12) to the block stored at `at`, whose rows belong to the first node where flipped
    is 1."""
    active, w = ints[AT.active_dofs], ints[DOFS_PER_NODE]
    if at >= 0:
        for r in range(w):
            i = ints[active + r]
            for c in range(w):
                j = ints[active + c]
                matrix[at + w * r + c] += T[i, 6 + j] if flipped == 1 else T[6 + i, j]


class MemberScratch(NamedTuple):
    """Scratch for one member at a time.

    pose (18,), Q, d: see `ksd.elements.ends.member_pose`; lam, K: wrench and stiffness; T, force: tangent and forces on its
    nodes; norms (6,): of these; previous (12,): pose of the previous member; A, M: scratch of `member_tangent`.
    """

    pose: np.ndarray
    Q: np.ndarray
    d: np.ndarray
    lam: np.ndarray
    K: np.ndarray
    T: np.ndarray
    force: np.ndarray
    norms: np.ndarray
    previous: np.ndarray
    A: np.ndarray
    M: np.ndarray


@kernel
def allocate_member_scratch():
    """Allocate `MemberScratch`."""
    return MemberScratch(
        np.empty(18), np.empty((3, 3)), np.empty(3), np.empty(12), np.empty((6, 6)), np.empty((12, 12)), np.empty(12),
        np.empty(6), np.empty(12), np.empty((6, 6)), np.empty((6, 12)),
    )  # fmt: skip


@kernel
def allocate_leaf_scratch(ints):
    """`ksd.elements.strain.LeafFields` for the strain-mode leaves there are."""
    # no literals, for which numba would compile twice
    modes = points = ints[0] * 0
    loads = points + 1
    for i in range(ints[MEMBER_COUNT]):
        if ints[ints[MEMBER.kind] + i] == STRAIN:
            number = ints[MEMBER.number] + SETTINGS * i
            modes = max(modes, ints[number] + ints[number + 1] + ints[number + 2])
            points = max(points, ints[number + 3])
            loads = max(loads, ints[number + 5] + ints[number + 6])
    return allocate_leaf_fields_compiled(modes, points, loads)


@kernel(inline="always")
def add_members(
    condense, set_gravity, planar_loads, spatial_loads, add_weight, ints, floats, x, R, inner, angle, work, scratch, leaf,
    factor, rtol, noise, linearise, first,
):  # fmt: skip
    """Add the members from number `first` on, with `factor` times their weight, to work.matrix and work.rhs.

    condense, set_gravity, planar_loads, spatial_loads, add_weight: kernels for the kinds of members of the mechanism.
    linearise 0: exact tangents at the state; 1: Appendix A chains are linearised about the element orientations in
    work.linearisation (paper 1, section 3), and their inner states are set. A member in the same state as the previous one,
    such as the second outer leaf of a cross flexure in its plane, copies its results; with weight or inertia also its
    tangent, where both are on the same nodes. Returns (negative pivots, largest inner residual over its bound, status).
    """
    # local names, because every access to a field of a named tuple counts the references of an array
    pose, Q, d = scratch.pose, scratch.Q, scratch.d
    lam, K, T = scratch.lam, scratch.K, scratch.T
    force, norms, previous = scratch.force, scratch.norms, scratch.previous
    A, M = scratch.A, scratch.M
    store, weight = work.store, work.weight
    linearisation_at, linearisation = work.linearisation_at, work.linearisation
    matrix, rhs, scale = work.matrix, work.rhs, work.scale
    poses, lams = work.pose, work.lam
    node, value_at, number_at = ints[MEMBER.node], ints[MEMBER.value_at], ints[MEMBER.number]
    inner_at, store_at, block = ints[MEMBER.inner_at], ints[MEMBER.store_at], ints[MEMBER.block]
    negatives, worst, status = 0, 0.0, 0
    member_negatives, dn, dm, member_status = 0, 0.0, 0.0, 0
    weight_negatives, df, heavy, weight_status = 0, 0.0, 0.0, 0
    active, unknowns, c0 = ints[ints[AT.active_dofs] :], ints[DOFS_PER_NODE], floats[ints[AT.rates]]
    # counted angles of the springs, the last members, follow those of the constraint terms
    previous[0] = np.nan
    turns = ints[ints[TERM.first] + ints[ROWS]] - ints[LEAF_COUNT]
    for i in range(first, ints[MEMBER_COUNT]):
        a, b, kind = ints[node + 2 * i], ints[node + 2 * i + 1], ints[ints[MEMBER.kind] + i]
        member_pose(
            ints, node + 2 * i, floats, ints[MEMBER.offset] + 6 * i, floats, ints[MEMBER.frame] + 18 * i, x, R, pose, Q
        )  # fmt: skip
        for c in range(3):
            d[c] = pose[c] * pose[15] + pose[3 + c] * pose[16] + pose[6 + c] * pose[17]
        linearised = linearise == 1 and linearisation_at[i] < linearisation_at[i + 1]
        number = ints[number_at + SETTINGS * i : number_at + SETTINGS * (i + 1)]
        has_weight = has_loads(weight, i, kind, number)
        inner_start, store_start = ints[inner_at + i], ints[store_at + i]
        # sizes of its inner state and store, and where those of the previous member start
        state_size, store_size = ints[inner_at + i + 1] - inner_start, ints[store_at + i + 1] - store_start
        inner_previous, store_previous = ints[inner_at + max(i - 1, 0)], ints[store_at + max(i - 1, 0)]
        if linearised:
            # the inner state follows from the configuration of the linearisation
            at = linearisation_at[i]
            is_equal = _equals_previous(
                ints, i, linearisation, linearisation_at[max(i - 1, 0)], at, linearisation_at[i + 1] - at, d, Q, previous
            )  # fmt: skip
        else:
            is_equal = _equals_previous(
                ints, i, inner, inner_previous, inner_start, state_size, d, Q, previous
            )
        has_same_ends = False
        if has_weight:
            # gravity in the frame of the member is the same in equal frames
            for r in range(weight.shape[1]):
                is_equal = is_equal and weight[i - 1, r] == weight[i, r]
            for r in range(9):
                is_equal = is_equal and poses[i - 1, r] == pose[r]
            has_same_ends = is_equal and a == ints[node + 2 * i - 2] and b == ints[node + 2 * i - 1]
            for r in range(9, 18):
                # across the plane there are no levers
                if unknowns == 6 or r % 3 == active[0] or r % 3 == active[1]:
                    has_same_ends = has_same_ends and poses[i - 1, r] == pose[r]
        state = inner[inner_start : inner_start + state_size]
        member_store = store[store_start : store_start + store_size]
        value = floats[ints[MEMBER.value] + ints[value_at + i] :]
        if is_equal and kind != TORSION:
            _copy(store, store_previous, store_start, store_size)
            if linearised:
                _copy(inner, inner_previous, inner_start, state_size)
        else:
            if has_weight:
                set_gravity(kind == PLANAR, number, pose, weight, i, factor, state, member_store)
            # leaf springs are not called by `condense`, as handing on their scratch counts references of two dozen arrays
            if kind == PLANAR:
                member_negatives, dn, dm, member_status = planar_leaf.condense(
                    value, number, state, member_store, d, Q, lam, K
                )
                if has_weight:
                    planar_loads(value, number, state, member_store, lam, K)
            elif kind == STRAIN:
                member_negatives, dn, dm, member_status = strain_condense(
                    value, number, state, member_store, leaf, d, Q, lam, K
                )
                if has_weight:
                    spatial_loads(value, number, state, member_store, leaf, lam, K)
            else:
                member_negatives, dn, dm, member_status = condense(
                    kind, value, number, state, member_store,
                    linearisation[linearisation_at[i] : linearisation_at[i + 1] if linearised else linearisation_at[i]],
                    angle[max(turns + i, 0) :], d, Q, lam, K, A, M,
                )  # fmt: skip
        rounding = noise * floats[ints[MEMBER.stiffness_scale] + i]
        if not has_same_ends:
            member_tangent(pose, lam, K, T, force, A, M)
            weight_negatives, df, heavy, weight_status = 0, 0.0, 0.0, 0
            if has_weight:
                weight_negatives, df, heavy, weight_status = add_weight(
                    active, unknowns, c0, value, number, kind == PLANAR, x[a], pose, state, member_store, weight[i, 0], T,
                    force,
                )  # fmt: skip
        negatives += member_negatives + weight_negatives
        status = max(status, member_status, weight_status)
        if has_weight:
            rounding += noise * weight[i, 0] * c0
        member_norms(lam, force, norms)
        n, m, L = norms[0], norms[1], floats[ints[MEMBER.length] + i]
        worst = max(
            worst,
            df / (rtol * (n + m / L + heavy) + rounding + 1e-300),
            dn / (rtol * (n + m / L) + rounding + 1e-300),
            dm / (rtol * (n * L + m) + rounding * L + 1e-300),
        )
        for e in range(2):
            k = ints[node + 2 * i + e]
            scale[k, 0] += rtol * (max(norms[2 + 2 * e], n) + m / L) + rounding
            scale[k, 1] += rtol * (max(norms[3 + 2 * e], m) + n * L) + rounding * L
        for r in range(18):
            poses[i, r] = pose[r]
        for r in range(12):
            lams[i, r] = lam[r]
        scatter(
            ints, block + 4 * i, T, force, ints[ints[AT.start] + a], ints[ints[AT.start] + b], matrix, rhs
        )
    return negatives, worst, status
