"""Newton iterations to the equilibrium of a mechanism in one compiled call: assembly, factorisation, solve and update.

The full model, the reduced one (condensed joints), training and the conventional solver all use it. Convergence is
scale-free (design section 5): at every node |R| <= rtol sum |f_e| + 10 eps (EA/L) max|x|, separately for forces and moments;
the same holds for the inner residual of every member, and constraint gaps must vanish to rounding. In the stiff directions
of thin leaves rounding may exceed this bound. A residual up to a thousand times larger is accepted (`has_converged`) when
the last Newton step displaced no node by more than 1e-7 of the size, rotated none by more than 1e-6 rad, and no longer
reduced the residual. The last condition is needed because nodes at rest do not imply equilibrium inside stiff leaf springs:
without it forces of taut leaves were wrong by 5e-5.

Every kernel that calls the leaf kernels contains a copy of them, which takes long to compile. So there is one kernel with
several tasks, `newton`, and the variants `newton_beams` and `newton_any` for kinds of members that fewer mechanisms have.
Python code calls the functions below them.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.elements.inertia import add_member_inertia
from ksd.elements.strain import strain_gravity_block
from ksd.model.arrays import (
    AT,
    CARRIED_NODES,
    DOFS_PER_NODE,
    LEAF_COUNT,
    LOADS,
    MEMBER,
    MEMBER_COUNT,
    NODES,
    PLANAR,
    SETTINGS,
    STRAIN,
    TERM,
    Arrays,
    State,
    Workspace,
    unflatten_workspace_kernel,
)
from ksd.model.assembly import (
    add_members,
    add_weight,
    allocate_leaf_scratch,
    allocate_member_scratch,
    condense_any,
    condense_beam,
    condense_linear,
    has_loads,
    move_inertia,
    recover_any,
    recover_beam,
    recover_leaf,
    rotate_gravity,
    set_gravity,
    set_inertia,
    set_planar_inertia,
    set_planar_loads,
    set_spatial_loads,
    skip_add_weight,
    skip_planar_loads,
    skip_rotate_gravity,
    skip_set_gravity,
    skip_spatial_loads,
)
from ksd.model.follower_correction import correct_newton_step
from ksd.model.loading import add_bodies, add_loads, add_terms
from ksd.model.turns import add_rotations, anchor_rotations
from ksd.numerics.blocks import BLOCKS, factor_blocks, solve_blocks
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import reorthonormalise, rotate, rotation_factors

RTOL = 1e-8
"""Residual of a node, relative to the sum of the element forces on it, at which Newton has converged."""
ROUNDING_MULTIPLE = 10.0
"""Factor on the rounding error of stiffness times position in the residual bounds."""
STALLED_RESIDUAL_LIMIT = 1000.0
"""Largest residual over its bound that is accepted after a negligible step."""
SETTLED_STEP, SETTLED_BEND = 30.0, 1e-6
"""Newton step of a time step, over the negligible one, after which it has converged: 3e-5 rad, or 3e-6 of the size; and that
of the modes of leaf springs [rad]."""
STALLED_RATIO = 0.1
"""Ratio of the residual after and before a step above which the step did not reduce it."""

RUNNING, CONVERGED, STEP_LIMIT, LOCAL_ANGLE_LIMIT, SINGULAR, DIVERGED, NOT_FINITE = -1, 0, 1, 2, 3, 4, 5
SOLVE, FULL_STEP, FIXED_ROWS_STEP, CHECK, ASSEMBLE, ASSEMBLE_NODES, TAKE_STEP = 0, 1, 2, 3, 4, 5, 6
"""Tasks of `newton`.

SOLVE: iterate to equilibrium; FULL_STEP: assemble and take a Newton step; FIXED_ROWS_STEP: the same with fixed drives and
supports, and with fixed nodes where one would move by more than `max_turn`; CHECK: assemble and compute the Newton step;
ASSEMBLE: assemble; ASSEMBLE_NODES: assemble with springs only; TAKE_STEP: take a given step.
"""
MAX_PREDICTOR_TURN, CUT_PREDICTOR_TURN = 3.2, 1.0
"""Rotation of a node [rad] above which the first step predicts nothing, as in a slack cable, and the one it is cut to.

A drive may turn a link by half a turn in one step.
"""
SINGULAR_PIVOT = 1e-14
"""Relative pivot below which the tangent counts as singular."""


def has_converged(residual: float, previous: float, step: float) -> bool:
    """Whether the Newton iterations have converged.

    residual, previous: residual over its bound now and before the last step; step: size of that step over the negligible
    one.
    """
    return residual <= 1.0 or (
        residual <= STALLED_RESIDUAL_LIMIT and step <= 1.0 and residual > STALLED_RATIO * previous
    )


_has_converged = kernel(inline="always")(has_converged)


@kernel(inline="late")
def _largest_node_residual(ints, rhs, scale):
    """Largest residual of a node over its bound."""
    worst = 0.0
    for k in range(ints[NODES]):
        u = ints[ints[AT.start] + k]
        if u >= 0:
            f, m = 0.0, 0.0
            for r in range(ints[DOFS_PER_NODE]):
                if ints[ints[AT.active_dofs] + r] < 3:
                    f += rhs[u + r] ** 2
                else:
                    m += rhs[u + r] ** 2
            worst = max(worst, math.sqrt(f) / (scale[k, 0] + 1e-300), math.sqrt(m) / (scale[k, 1] + 1e-300))
    return worst


@kernel(inline="late")
def _largest_coordinate(ints, floats, x):
    """Largest coordinate of a node [m], at least the size of the mechanism."""
    reach = floats[0]
    for k in range(ints[NODES]):
        for r in range(3):
            reach = max(reach, abs(x[k, r]))
    return reach


@kernel
def _largest(ints, step, first):
    """Largest norm over the nodes of three components of a step: displacements for first = 0, rotations for first = 3."""
    largest = 0.0
    for k in range(ints[NODES]):
        u = ints[ints[AT.start] + k]
        if u >= 0:
            s = 0.0
            for r in range(ints[DOFS_PER_NODE]):
                if first <= ints[ints[AT.active_dofs] + r] < first + 3:
                    s += step[u + r] ** 2
            largest = max(largest, s)
    return math.sqrt(largest)


@kernel(inline="late")
def _relative_motion(ints, poses, i, step, move, xi):
    """Displacements and rotations (12,) of the nodes a, b of member i in a step, into `move`, and the motion xi (6,) of
    its end q relative to its end p, in frame p: (dxb - dxa + dphib x s - dphia x w, dphib - dphia)."""
    node = ints[MEMBER.node] + 2 * i
    for e in range(2):
        u = ints[ints[AT.start] + ints[node + e]]
        for r in range(6):
            move[6 * e + r] = 0.0
        if u >= 0:
            for r in range(ints[DOFS_PER_NODE]):
                move[6 * e + ints[ints[AT.active_dofs] + r]] = step[u + r]
    for r in range(6):
        xi[r] = 0.0
    for r in range(3):
        j, k = (r + 1) % 3, (r + 2) % 3
        g = (
            move[6 + r] - move[r]
            + move[9 + j] * poses[i, 12 + k] - move[9 + k] * poses[i, 12 + j]
            - move[3 + j] * poses[i, 9 + k] + move[3 + k] * poses[i, 9 + j]
        )  # fmt: skip
        for c in range(3):
            xi[c] += poses[i, 3 * r + c] * g
            xi[3 + c] += poses[i, 3 * r + c] * (move[9 + r] - move[3 + r])


@kernel(inline="late")
def _move_nodes(ints, floats, x, R, multiplier, angle, step, scale):
    """Take `scale` times a step in positions, rotations (R <- exp(dphi) R) and multipliers, and count the rotations."""
    spin = np.zeros((ints[NODES], 3))
    for k in range(ints[NODES]):
        u = ints[ints[AT.start] + k]
        if u >= 0:
            for r in range(ints[DOFS_PER_NODE]):
                c = ints[ints[AT.active_dofs] + r]
                if c < 3:
                    x[k, c] += scale * step[u + r]
                else:
                    spin[k, c - 3] = scale * step[u + r]
    add_rotations(ints, floats, R, angle, spin)
    for k in range(ints[NODES]):
        if ints[ints[AT.start] + k] >= 0:
            rotate(spin[k], R[k])
            reorthonormalise(R[k])
    for i in range(len(multiplier)):
        row = ints[ints[TERM.start] + i]
        if row >= 0:
            multiplier[i] += scale * step[row]


@kernel
def _carry_nodes(ints, x, R, step, scale, v):
    """Move the nodes of long chains (`Arrays.carried`) again, after `_move_nodes` has moved all; v (12,): scratch.

    Each one takes its part of the step relative to the node that carries it, in the axes of that node, which have turned
    through the whole angle. Along straight lines the nodes of a chain that turns by t would stretch its leaf springs by
    t^2 / 2, which the following iterations have to take back: the more of them, the finer the chain.
    """
    first, count = ints[AT.carried], ints[CARRIED_NODES]
    # from the far ends, because here the carrying nodes must be where `_move_nodes` left them
    for c in range(count - 1, -1, -1):
        for e in range(2):
            u = ints[ints[AT.start] + ints[first + 2 * c + e]]
            for r in range(6):
                v[6 * e + r] = 0.0
            if u >= 0:
                for r in range(ints[DOFS_PER_NODE]):
                    v[6 * e + ints[ints[AT.active_dofs] + r]] = scale * step[u + r]
        k, p = ints[first + 2 * c], ints[first + 2 * c + 1]
        # R <- exp(dphi_p) exp(dphi - dphi_p) exp(-dphi) R, x <- exp(dphi_p) (d - dphi_p x (d - dx + dx_p)), d = x - x_p
        a, b, e = v[9], v[10], v[11]
        v[9], v[10], v[11] = -v[3], -v[4], -v[5]
        rotate(v[9:], R[k])
        v[9], v[10], v[11] = v[3] - a, v[4] - b, v[5] - e
        rotate(v[9:], R[k])
        v[9], v[10], v[11] = a, b, e
        rotate(v[9:], R[k])
        for r in range(3):
            v[r] = x[k, r] - x[p, r] - v[r] + v[6 + r]
        for r in range(3):
            i, j = (r + 1) % 3, (r + 2) % 3
            v[3 + r] = x[k, r] - x[p, r] - (v[9 + i] * v[j] - v[9 + j] * v[i])
        f, g = rotation_factors(a * a + b * b + e * e)
        for r in range(3):
            i, j = (r + 1) % 3, (r + 2) % 3
            v[r] = v[9 + i] * v[3 + j] - v[9 + j] * v[3 + i]
        for r in range(3):
            i, j = (r + 1) % 3, (r + 2) % 3
            v[6 + r] = v[3 + r] + f * v[r] + g * (v[9 + i] * v[j] - v[9 + j] * v[i])
        # into the axes of the carrying node
        for r in range(3):
            x[k, r] = R[p, 0, r] * v[6] + R[p, 1, r] * v[7] + R[p, 2, r] * v[8]
        for j in range(3):
            a, b, e = R[k, 0, j], R[k, 1, j], R[k, 2, j]
            for r in range(3):
                R[k, r, j] = R[p, 0, r] * a + R[p, 1, r] * b + R[p, 2, r] * e
    for c in range(count):
        k, p = ints[first + 2 * c], ints[first + 2 * c + 1]
        a, b, e = x[k, 0], x[k, 1], x[k, 2]
        for r in range(3):
            x[k, r] = x[p, r] + R[p, r, 0] * a + R[p, r, 1] * b + R[p, r, 2] * e
        for j in range(3):
            a, b, e = R[k, 0, j], R[k, 1, j], R[k, 2, j]
            for r in range(3):
                R[k, r, j] = R[p, r, 0] * a + R[p, r, 1] * b + R[p, r, 2] * e
        reorthonormalise(R[k])


@kernel(inline="always")
def _take_step(
    recover,
    rotate_gravity,
    ints,
    floats,
    x,
    R,
    inner,
    multiplier,
    angle,
    step,
    store,
    poses,
    weight,
    move,
    xi,
    scale,
):
    """Take `scale` times a step (n,), members first, as they need the old frames; move (12,), xi (6,): scratch."""
    for i in range(ints[MEMBER_COUNT]):
        _relative_motion(ints, poses, i, step, move, xi)
        inner_at, store_at = ints[MEMBER.inner_at] + i, ints[MEMBER.store_at] + i
        value, number = ints[ints[MEMBER.value_at] + i], ints[MEMBER.number] + SETTINGS * i
        member_store, state = (
            store[ints[store_at] : ints[store_at + 1]],
            inner[ints[inner_at] : ints[inner_at + 1]],
        )
        kind, settings = ints[ints[MEMBER.kind] + i], ints[number : number + SETTINGS]
        if has_loads(weight, i, kind, settings):
            rotate_gravity(ints, kind == PLANAR, settings, poses[i], move, xi, state, scale, member_store)
        recover(kind, floats[ints[MEMBER.value] + value :], settings, state, member_store, xi, scale, move)
    _move_nodes(ints, floats, x, R, multiplier, angle, step, scale)
    if ints[CARRIED_NODES] > 0:
        _carry_nodes(ints, x, R, step, scale, move)


@kernel(inline="always")
def _newton(
    members, condense, set_gravity, planar_loads, spatial_loads, add_weight, recover, rotate_gravity, bodies, correct_step,
    keep, settles,
    ints, floats, x, R, inner, multiplier, angle, target, flat, at, task, linearise,
    max_steps, factor, rtol, rounding, max_turn, divergence_limit,
):  # fmt: skip
    """See `newton`; the first twelve arguments are the kernels for the kinds of members and loads of the mechanism.

    `members` is `add_members`, handed on because a call by its name would be inlined here once more in every variant.
    """
    work, plan = unflatten_workspace_kernel(flat, at), ints[ints[AT.plan] :]
    scratch, leaf = allocate_member_scratch(), allocate_leaf_scratch(ints)
    # local names, because every access to a field of a named tuple counts the references of an array
    matrix, spare, rhs = work.matrix, work.scaled_rows, work.rhs
    scales, poses = work.scale, work.pose
    store, weight = work.store, work.weight
    move, xi = scratch.force, scratch.norms
    negatives, member_negatives, status, pivot = 0, 0, 0, 1.0
    worst, previous, step_size, gap = math.inf, math.inf, math.inf, 0.0
    n, extra_step, reason = 0, False, RUNNING
    # a single return: each one releases all arrays, which would be a third of the kernel
    while reason == RUNNING:
        done = False
        if task <= ASSEMBLE_NODES:
            # the first bounds may exclude rounding, so that a load that is smaller than it still gets one step
            multiple = ROUNDING_MULTIPLE if n > 0 or extra_step else rounding
            coordinate = _largest_coordinate(ints, floats, x)
            noise = multiple * 2.220446049250313e-16 * coordinate
            matrix[:] = 0.0
            rhs[:] = 0.0
            scales[:, :] = 0.0
            member_negatives, worst, status = members(
                condense, set_gravity, planar_loads, spatial_loads, add_weight, ints, floats, x, R, inner, angle, work,
                scratch, leaf, factor, rtol, noise, linearise, ints[LEAF_COUNT] if task == ASSEMBLE_NODES else 0,
            )  # fmt: skip
            bodies(ints, floats, x, R, rtol, noise, matrix, rhs, scales)
            if ints[LOADS] > 0:
                add_loads(ints, floats, R, factor, rtol, matrix, rhs, scales)
            gap = add_terms(ints, floats, x, R, multiplier, angle, target, rtol, matrix, rhs, scales)
            worst = max(
                worst,
                gap / (1e-11 * floats[0] + 2e-15 * coordinate),
                _largest_node_residual(ints, rhs, scales),
            )
            if not math.isfinite(worst) or status == 2:
                worst, status = math.inf, 2
            if task == FIXED_ROWS_STEP:
                for i in range(len(multiplier)):
                    row = ints[ints[TERM.start] + i]
                    if row >= 0:
                        rhs[row] = 0.0
        if CHECK < task <= ASSEMBLE_NODES:
            reason, negatives, pivot = status, member_negatives, gap
        elif task == SOLVE:
            if not math.isfinite(worst):
                reason = NOT_FINITE
            elif extra_step and _has_converged(worst, previous, step_size):
                reason = CONVERGED
                negatives += member_negatives
            else:
                # an extra step after which the iterations continue counts as a step
                n += extra_step
                done = worst <= 1.0 or (worst <= STALLED_RESIDUAL_LIMIT and step_size <= 1.0)
                if n > max_steps or (n == max_steps and not done):
                    reason = STEP_LIMIT
                elif n > 0 and not done and math.isfinite(divergence_limit):
                    s = 0.0
                    for i in range(len(rhs)):
                        s += rhs[i] * rhs[i]
                    if math.sqrt(s) > divergence_limit:
                        reason = DIVERGED
        if reason == RUNNING and task != TAKE_STEP:
            # the inertia belongs to the state before the step
            negatives, pivot = factor_blocks(plan, matrix, spare, plan[BLOCKS])
            for i in range(len(rhs)):
                rhs[i] = -rhs[i]
            solve_blocks(plan, matrix, spare, rhs)
            # the factorisation made for the inertia also serves for one more step, too small to count
            extra_step = done and worst > 1.0 and pivot > 0.0
            if not extra_step:
                negatives += member_negatives
            if task == SOLVE and not done and not pivot > 0.0:
                reason = SINGULAR
            elif done and not extra_step:
                reason = CONVERGED
            else:
                correct_step(ints, floats, plan, R, matrix, spare, rhs, factor, store)
                if task == CHECK:
                    reason = status
        if reason == RUNNING:
            scale = max_turn if task == TAKE_STEP else 1.0
            previous = worst
            if task == TAKE_STEP:
                reason, worst = CONVERGED, 0.0
            elif not extra_step:
                turned = _largest(ints, rhs, 3 + 0 * n)
                if n > 0 and turned > max_turn:
                    scale = max_turn / turned
                elif task == SOLVE and turned > MAX_PREDICTOR_TURN and not math.isfinite(divergence_limit):
                    # without members it is springs that turn links, by whole turns
                    scale = CUT_PREDICTOR_TURN / turned if ints[LEAF_COUNT] > 0 else 1.0
                # a variable instead of the literal 0, for which numba would compile the function once more
                shift = _largest(ints, rhs, 0 * n) / floats[0]
                step_size = max(turned / 1e-6, shift / 1e-7)
                n += 1
                if task == FIXED_ROWS_STEP and (max(turned, shift) > max_turn or not pivot > SINGULAR_PIVOT):
                    rhs[:] = 0.0
                if task != SOLVE:
                    reason, worst = status, step_size
            before = keep(inner)
            _take_step(
                recover, rotate_gravity, ints, floats, x, R, inner, multiplier, angle, rhs, store, poses, weight, move, xi,
                scale,
            )  # fmt: skip
            if (
                task == SOLVE
                and not extra_step
                and pivot > 0.0
                and settles(ints, floats, step_size, before, inner)
            ):
                reason = CONVERGED
    if task == SOLVE and reason == CONVERGED:
        anchor_rotations(ints, R, angle)
    if task == SOLVE and reason == CONVERGED and status > 0:
        # a state with a replaced tiny pivot or a local angle beyond its range is refused, however small the residual
        reason = LOCAL_ANGLE_LIMIT if status == 1 else SINGULAR
    return reason, min(n, max_steps), worst, negatives, pivot


@kernel(inline="always")
def _keep_nothing(inner):
    """`_keep_inner` in statics."""
    return inner


@kernel(inline="always")
def _keep_inner(inner):
    """The inner state before a step."""
    return inner.copy()


@kernel(inline="always")
def _never_settles(ints, floats, step_size, before, inner):
    """In statics the residual after a step is always looked at."""
    return False


@kernel
def _settles(ints, floats, step_size, before, inner):
    """Whether a Newton step of a time step is so small that what is left is of the order of its square.

    In leaf springs too: between ends that hardly move they may buckle, and stiff ones have to bend for it.
    """
    if step_size > SETTLED_STEP:
        return False
    largest = 0.0
    for i in range(ints[LEAF_COUNT]):
        first, number = ints[ints[MEMBER.inner_at] + i], ints[MEMBER.number] + SETTINGS * i
        modes = ints[number + 3]
        if ints[ints[MEMBER.kind] + i] == STRAIN:
            modes = ints[number] + ints[number + 1] + ints[number + 2]
        for k in range(first, first + modes):
            largest = max(largest, floats[ints[MEMBER.length] + i] * abs(inner[k] - before[k]))
    return largest <= SETTLED_BEND


@kernel(inline="always")
def _skip_bodies(ints, floats, x, R, rtol, noise, matrix, rhs, scale):
    """`add_bodies` in statics."""


@kernel(inline="always")
def _skip_step_correction(ints, floats, plan, R, matrix, spare, rhs, factor, store):
    """`correct_newton_step` for mechanisms whose loads are conservative."""


@kernel
def newton(
    ints, floats, x, R, inner, multiplier, angle, target, flat, at, task, linearise,
    max_steps, factor, rtol, rounding, max_turn, divergence_limit
):  # fmt: skip
    """Perform a task on a mechanism: see `solve_equilibrium`; ints, floats as in `Arrays`, flat, at as in `Workspace`.

    max_turn: largest rotation of a node per step [rad], or of TAKE_STEP the scale of the step; linearise: see `assemble`.
    Returns (reason, steps taken, residual over its bound, negative pivots, smallest relative pivot). For CHECK, ASSEMBLE and
    ASSEMBLE_NODES the first is the status of the members; for the last two the fourth counts the members only and the fifth
    is the largest gap [m]. For FULL_STEP and FIXED_ROWS_STEP the first is the status, the third the size of the step (see
    `take_newton_step`).
    """
    return _newton(
        add_members, condense_linear, skip_set_gravity, skip_planar_loads, skip_spatial_loads, skip_add_weight,
        recover_leaf, skip_rotate_gravity, _skip_bodies, _skip_step_correction, _keep_nothing, _never_settles,
        ints, floats, x, R, inner, multiplier, angle, target, flat, at, task, linearise,
        max_steps, factor, rtol, rounding, max_turn, divergence_limit,
    )  # fmt: skip


@kernel
def newton_beams(
    ints, floats, x, R, inner, multiplier, angle, target, flat, at, task, linearise,
    max_steps, factor, rtol, rounding, max_turn, divergence_limit
):  # fmt: skip
    """`newton` also for chains, springs, weight of members, and loads that are not conservative."""
    return _newton(
        add_members, condense_beam, set_gravity, set_planar_loads, set_spatial_loads, add_weight, recover_beam,
        rotate_gravity, _skip_bodies, correct_newton_step, _keep_nothing, _never_settles,
        ints, floats, x, R, inner, multiplier, angle, target, flat, at, task, linearise,
        max_steps, factor, rtol, rounding, max_turn, divergence_limit,
    )  # fmt: skip


@kernel
def newton_any(
    ints, floats, x, R, inner, multiplier, angle, target, flat, at, task, linearise,
    max_steps, factor, rtol, rounding, max_turn, divergence_limit
):  # fmt: skip
    """`newton_beams` for members of every kind."""
    return _newton(
        add_members, condense_any, set_gravity, set_planar_loads, set_spatial_loads, add_weight, recover_any,
        rotate_gravity, _skip_bodies, correct_newton_step, _keep_nothing, _never_settles,
        ints, floats, x, R, inner, multiplier, angle, target, flat, at, task, linearise,
        max_steps, factor, rtol, rounding, max_turn, divergence_limit,
    )  # fmt: skip


@kernel
def newton_motion(
    ints, floats, x, R, inner, multiplier, angle, target, flat, at, task, linearise,
    max_steps, factor, rtol, rounding, max_turn, divergence_limit
):  # fmt: skip
    """`newton` for a time step (`ksd.elements.inertia`) of strain-mode leaves, linear bodies and springs."""
    return _newton(
        add_members, condense_beam, set_inertia, set_planar_inertia, strain_gravity_block, add_member_inertia, recover_leaf,
        move_inertia, add_bodies, correct_newton_step, _keep_inner, _settles,
        ints, floats, x, R, inner, multiplier, angle, target, flat, at, task, linearise,
        max_steps, factor, rtol, rounding, max_turn, divergence_limit,
    )  # fmt: skip


_ENTRIES = (newton, newton_beams, newton_any, newton_motion)
"""The kernel for each value of `Arrays.member_kinds`."""

NewtonResult = tuple[int, int, float, int, float]
"""Reason, steps taken, residual over its bound, negative pivots, smallest relative pivot: see `solve_equilibrium`."""


def _run(
    arrays: Arrays, motion: State, target: np.ndarray, work: Workspace, task: int, *, linearise: int = 0,
    max_steps: int = 0, factor: float = 1.0, rtol: float = RTOL, rounding: float = ROUNDING_MULTIPLE,
    max_turn: float = math.inf, divergence_limit: float = math.inf,
) -> NewtonResult:  # fmt: skip
    # arguments are converted because every other type would be compiled again
    result: NewtonResult = _ENTRIES[arrays.member_kinds](
        *arrays.flat, *motion, np.ascontiguousarray(target, np.float64), work.flat, work.at,
        task, int(linearise), int(max_steps), float(factor), float(rtol), float(rounding), float(max_turn),
        float(divergence_limit),
    )  # fmt: skip
    return result


def solve_equilibrium(
    arrays: Arrays, motion: State, target: np.ndarray, factor: float, work: Workspace, rtol: float, max_steps: int,
    max_turn: float, divergence_limit: float,
) -> NewtonResult:  # fmt: skip
    """Newton iterations to equilibrium at the drive values `target` (c,) and load `factor`, in place.

    The first step (the predictor) is taken in full, unless it turns a node by more than MAX_PREDICTOR_TURN; later ones are
    scaled so that no node rotates by more than `max_turn` [rad]. divergence_limit: stop when the norm of the residual
    exceeds it (the eps_max of Appendix B, with which all predictors are full); inf switches it off.
    Local angles beyond 60 degrees are allowed during the iterations, but not in a converged state.
    Returns (reason, steps taken, residual over its bound, negative pivots, smallest relative pivot).
    """
    return _run(
        arrays, motion, target, work, SOLVE, max_steps=max_steps, factor=factor, rtol=rtol, rounding=0.0, max_turn=max_turn,
        divergence_limit=divergence_limit,
    )  # fmt: skip


def assemble(
    arrays: Arrays,
    motion: State,
    target: np.ndarray,
    factor: float,
    work: Workspace,
    rtol: float = RTOL,
    linearise: int = 0,
    rounding: float = ROUNDING_MULTIPLE,
) -> tuple[float, float, int, int]:
    """Residual and tangent at `motion`. Returns (residual over its bound, largest gap [m], negatives, status).

    linearise: 1 where chains are linearised about the configuration in `work.linearisation`, else 0. rounding: factor on the
    rounding error of stiffness times position in the bounds (design section 5: 10).
    """
    status, _, worst, negatives, gap = _run(
        arrays,
        motion,
        target,
        work,
        ASSEMBLE,
        linearise=linearise,
        factor=factor,
        rtol=rtol,
        rounding=rounding,
    )
    return worst, gap, negatives, status


def assemble_nodes(
    arrays: Arrays, motion: State, factor: float, work: Workspace, *, target: np.ndarray | None = None
) -> None:
    """Residual and tangent of constraint rows, loads and springs only; target (c,): drive values, zero when None."""
    values = np.zeros(len(motion.multiplier)) if target is None else target
    _run(arrays, motion, values, work, ASSEMBLE_NODES, factor=factor, rounding=0.0)


def check_residual(
    arrays: Arrays,
    motion: State,
    target: np.ndarray,
    factor: float,
    work: Workspace,
    rtol: float = RTOL,
) -> tuple[float, int, int]:
    """Residual over its bound, negative pivots and status at `motion`; the Newton step is left in work.rhs."""
    status, _, worst, negatives, _ = _run(arrays, motion, target, work, CHECK, factor=factor, rtol=rtol)
    return worst, negatives, status


def take_newton_step(
    arrays: Arrays,
    motion: State,
    target: np.ndarray,
    factor: float,
    work: Workspace,
) -> float:
    """Take a full Newton step from `motion`, in place, and return its size.

    The size is the larger of 1e6 times the largest rotation of a node [rad] and 1e7 times the largest displacement over the
    size of the mechanism.
    """
    return _run(arrays, motion, target, work, FULL_STEP, factor=factor)[2]


def take_step_at_fixed_rows(
    arrays: Arrays, motion: State, factor: float, work: Workspace, max_motion: float
) -> None:
    """Take a Newton step from `motion`, in place, with fixed drives and supports.

    Nodes are fixed as well where one would rotate by more than max_motion [rad], or be displaced by more than max_motion
    times the size of the mechanism, as in a direction of almost no stiffness.
    """
    _run(
        arrays,
        motion,
        np.zeros(len(motion.multiplier)),
        work,
        FIXED_ROWS_STEP,
        factor=factor,
        max_turn=max_motion,
    )


def take_step(arrays: Arrays, motion: State, step: np.ndarray, work: Workspace, scale: float) -> None:
    """motion <- motion + scale * step (n,), in place; `work` as assembled at `motion`; the step is left in work.rhs."""
    work.rhs[:] = step
    _run(arrays, motion, np.zeros(0), work, TAKE_STEP, max_turn=scale)


def move_nodes(arrays: Arrays, motion: State, step: np.ndarray, scale: float) -> None:
    """As `take_step`, for positions, rotations and multipliers only."""
    (ints, floats), (x, R, _, multiplier, angle) = arrays.flat, motion
    _move_nodes(ints, floats, x, R, multiplier, angle, np.ascontiguousarray(step), float(scale))


def largest_rotation(arrays: Arrays, step: np.ndarray) -> float:
    """Largest rotation of any node in `step` (n,), rad."""
    return float(_largest(arrays.ints, np.ascontiguousarray(step), 3))


def largest_displacement(arrays: Arrays, step: np.ndarray) -> float:
    """Largest displacement of any node in `step` (n,), m."""
    return float(_largest(arrays.ints, np.ascontiguousarray(step), 0))
