"""Equilibrium of a mechanism in one compiled call: assembly, factorisation, solve and update, iterated to convergence.

The same function serves the full model, the reduced one (condensed joints), training and the conventional
solver. Convergence is scale-free (design section 5): at every node |R| <= rtol sum |f_e| + 10 eps (EA/L) max|x|,
for forces and moments apart, the same for the inner residual of every member, and constraint gaps to rounding.
In the stiff directions of thin leaves rounding may exceed that bound: a residual up to a thousand times larger is accepted
(`has_converged`) when the last Newton step moved nothing by more than 1e-7 of the size, turned nothing by more than 1e-6
rad, and no longer lowered the residual. Without the last condition forces of taut leaves were off by 5e-5: nodes that stand
still say nothing of the insides of leaf springs, and what leaves positions right to 1e-14 is still a force in a stiff one.

Every compiled caller of the leaf kernels contains them and takes as long to compile, so there is one, `newton`, with a
task, `newton_beams` and `newton_any` for what fewer mechanisms have; the functions below them are what Python calls.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.beam.weight_assembly import add_member_weight, rotate_member_gravity, set_member_gravity
from ksd.model.arrays import (
    ACTIVE_DOFS,
    DOFS_PER_NODE,
    INNER_AT,
    KIND,
    LOADS,
    MEMBER_COUNT,
    MEMBERS,
    NODE,
    NODES,
    NUMBER,
    PLAN,
    SPRING_COUNT,
    START,
    STORE_AT,
    TERM_START,
    VALUE,
    VALUE_AT,
    Arrays,
    KernelArrays,
    State,
    Workspace,
    unflatten_workspace_kernel,
)
from ksd.model.assembly import (
    add_members,
    condense_any,
    condense_beam,
    condense_linear,
    follow_leaf,
    no_weight,
    no_weight_added,
    no_weight_followed,
    open_leaf_room,
    open_member_room,
    recover_any,
    recover_beam,
    recover_leaf,
)
from ksd.model.loading import add_loads, add_terms
from ksd.model.nonconservative import turn_step
from ksd.model.springs import add_springs
from ksd.numerics.blocks import BLOCKS, factor_blocks, solve_blocks
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import reorthonormalise, rotate

ROUNDING_MULTIPLE = 10.0
"""Multiples of rounding in the residual bounds."""
STALLED_RESIDUAL_LIMIT = 1000.0
"""How far the residual may exceed its bound when the last step was negligible."""
STALLED_RATIO = 0.1
"""Residual over that before the step from which on steps no longer lower it."""

RUNNING, CONVERGED, STEP_LIMIT, LOCAL_ANGLE_LIMIT, SINGULAR, DIVERGED, NOT_FINITE = -1, 0, 1, 2, 3, 4, 5
SOLVE, WHOLE, HELD, LOOK, ASSEMBLE, NODES_ALONE, TAKE = 0, 1, 2, 3, 4, 5, 6
"""Tasks of `newton`: iterate; assemble, find the Newton step and take it; the same, drives and supports where they are, and
the nodes too where one would go further than `cap`; assemble and find it; assemble; assemble without members; take the
step."""
SINGULAR_PIVOT = 1e-14
"""Relative pivot below which the tangent counts as singular."""


def has_converged(worst: float, before: float, moved: float) -> bool:
    """Whether Newton is done. worst, before: residual over its bound now and before the last step; moved: that step over
    what is negligible."""
    return worst <= 1.0 or (
        worst <= STALLED_RESIDUAL_LIMIT and moved <= 1.0 and worst > STALLED_RATIO * before
    )


_settled = kernel(inline="always")(has_converged)


@kernel(inline="late")
def _worst_node(ints, rhs, scale):
    """Largest residual of a node over its bound."""
    worst = 0.0
    for k in range(ints[NODES]):
        u = ints[ints[START] + k]
        if u >= 0:
            f, m = 0.0, 0.0
            for r in range(ints[DOFS_PER_NODE]):
                if ints[ints[ACTIVE_DOFS] + r] < 3:
                    f += rhs[u + r] ** 2
                else:
                    m += rhs[u + r] ** 2
            worst = max(worst, math.sqrt(f) / (scale[k, 0] + 1e-300), math.sqrt(m) / (scale[k, 1] + 1e-300))
    return worst


@kernel(inline="late")
def _reach(ints, floats, x):
    """Largest coordinate, or the size [m]."""
    reach = floats[0]
    for k in range(ints[NODES]):
        for r in range(3):
            reach = max(reach, abs(x[k, r]))
    return reach


@kernel(inline="always")
def _add_others(
    springs, ints, floats, x, R, multiplier, target, matrix, rhs, scale, poses, lams, factor, rtol, noise
):  # fmt: skip
    """All but the members into matrix and residual. Returns (largest gap [m], status)."""
    status = 0
    if ints[SPRING_COUNT] > 0:
        status = springs(ints, floats, x, R, rtol, noise, matrix, rhs, scale, poses, lams)
    if ints[LOADS] > 0:
        add_loads(ints, floats, R, factor, rtol, matrix, rhs, scale)
    return add_terms(ints, floats, x, R, multiplier, target, rtol, matrix, rhs, scale), status


@kernel
def _largest(ints, step, first):
    """Largest norm, over the nodes, of the three components from `first` on, as far as they are unknown."""
    largest = 0.0
    for k in range(ints[NODES]):
        u = ints[ints[START] + k]
        if u >= 0:
            s = 0.0
            for r in range(ints[DOFS_PER_NODE]):
                if first <= ints[ints[ACTIVE_DOFS] + r] < first + 3:
                    s += step[u + r] ** 2
            largest = max(largest, s)
    return math.sqrt(largest)


@kernel(inline="late")
def _relative_motion(ints, poses, i, step, move, xi):
    """Motion (12,) of the nodes a, b of member i in the step, and xi (6,) in frame p of it: (dxb - dxa + dphib x s
    - dphia x w, dphib - dphia)."""
    node = ints[MEMBERS + NODE] + 2 * i
    for e in range(2):
        u = ints[ints[START] + ints[node + e]]
        for r in range(6):
            move[6 * e + r] = 0.0
        if u >= 0:
            for r in range(ints[DOFS_PER_NODE]):
                move[6 * e + ints[ints[ACTIVE_DOFS] + r]] = step[u + r]
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
def _move_nodes(ints, x, R, multiplier, step, scale, v):
    """Positions, rotations (R <- exp(dphi) R) and multipliers; v (6,) or more: scratch."""
    for r in range(6):
        v[r] = 0.0
    for k in range(ints[NODES]):
        u = ints[ints[START] + k]
        if u >= 0:
            for r in range(ints[DOFS_PER_NODE]):
                v[ints[ints[ACTIVE_DOFS] + r]] = scale * step[u + r]
            for r in range(3):
                x[k, r] += v[r]
            rotate(v[3:], R[k])
            reorthonormalise(R[k])
    for i in range(len(multiplier)):
        row = ints[ints[TERM_START] + i]
        if row >= 0:
            multiplier[i] += scale * step[row]


@kernel(inline="always")
def _take(
    recover, turn_weight, ints, floats, x, R, inner, multiplier, step, store, poses, weight, move, xi, scale
):
    """The step (n,) times `scale`: members first (their frames are the old ones), then nodes and multipliers; move (12,),
    xi (6,): scratch."""
    for i in range(ints[MEMBER_COUNT]):
        _relative_motion(ints, poses, i, step, move, xi)
        own, kept = ints[MEMBERS + INNER_AT] + i, ints[MEMBERS + STORE_AT] + i
        value, number = ints[ints[MEMBERS + VALUE_AT] + i], ints[MEMBERS + NUMBER] + 4 * i
        mine = store[ints[kept] : ints[kept + 1]]
        if len(weight) > 0 and weight[i, 0] > 0.0:
            turn_weight(poses[i], move, mine)
        recover(
            ints[ints[MEMBERS + KIND] + i], floats[ints[MEMBERS + VALUE] + value :], ints[number : number + 4],
            inner[ints[own] : ints[own + 1]], mine, xi, scale, move,
        )  # fmt: skip
    _move_nodes(ints, x, R, multiplier, step, scale, move)


@kernel(inline="always")
def _newton(
    members, condense, pull, follow, weigh, springs, recover, turn_weight, turn_rest,
    ints, floats, x, R, inner, multiplier, target, flat, at, task, near, most, factor, rtol, grain, cap, blow_up,
):  # fmt: skip
    """See `newton`; the first nine: what to do with the members, springs and loads there are. Members is `add_members`:
    called by its name it would be inlined here first, and copied once more with all of this."""
    work, plan = unflatten_workspace_kernel(flat, at), ints[ints[PLAN] :]
    room, leaf = open_member_room(), open_leaf_room(ints)
    # by names of their own: every look into a named tuple counts the users of an array
    matrix, spare, rhs = work.matrix, work.scaled_rows, work.rhs
    scales, poses, lams = work.scale, work.pose, work.lam
    store, weight = work.store, work.weight
    move, xi = room.force, room.norms
    negatives, inside, status, pivot = 0, 0, 0, 1.0
    worst, before, moved, gap = math.inf, math.inf, math.inf, 0.0
    n, polished, reason = 0, False, RUNNING
    # one way out: at every other one all arrays would be let go anew, a third of the kernel
    while reason == RUNNING:
        done = False
        if task <= NODES_ALONE:
            # a load too small to rise above rounding still gets one step: at first the bounds have no grain
            bound = ROUNDING_MULTIPLE if n > 0 or polished else grain
            reach = _reach(ints, floats, x)
            noise = bound * 2.220446049250313e-16 * reach
            matrix[:] = 0.0
            rhs[:] = 0.0
            scales[:, :] = 0.0
            inside, worst, status = 0, 0.0, 0
            if task != NODES_ALONE:
                inside, worst, status = members(
                    condense, pull, follow, weigh, ints, floats, x, R, inner, work, room, leaf, factor, rtol, noise, near
                )  # fmt: skip
            gap, told = _add_others(
                springs, ints, floats, x, R, multiplier, target, matrix, rhs, scales, poses, lams, factor, rtol, noise
            )  # fmt: skip
            worst = max(worst, gap / (1e-11 * floats[0] + 2e-15 * reach), _worst_node(ints, rhs, scales))
            status = max(status, told)
            if not math.isfinite(worst) or status == 2:
                worst, status = math.inf, 2
            if task == HELD:
                for i in range(len(multiplier)):
                    row = ints[ints[TERM_START] + i]
                    if row >= 0:
                        rhs[row] = 0.0
        if LOOK < task <= NODES_ALONE:
            reason, negatives, pivot = status, inside, gap
        elif task == SOLVE:
            if not math.isfinite(worst):
                reason = NOT_FINITE
            elif polished and _settled(worst, before, moved):
                reason = CONVERGED
                negatives += inside
            else:
                # a rest of the way that did not settle it was a step
                n += polished
                done = worst <= 1.0 or (worst <= STALLED_RESIDUAL_LIMIT and moved <= 1.0)
                if n > most or (n == most and not done):
                    reason = STEP_LIMIT
                elif n > 0 and not done and math.isfinite(blow_up):
                    s = 0.0
                    for i in range(len(rhs)):
                        s += rhs[i] * rhs[i]
                    if math.sqrt(s) > blow_up:
                        reason = DIVERGED
        if reason == RUNNING and task != TAKE:
            # the inertia belongs to the state before the step
            negatives, pivot = factor_blocks(plan, matrix, spare, plan[BLOCKS])
            for i in range(len(rhs)):
                rhs[i] = -rhs[i]
            solve_blocks(plan, matrix, spare, rhs)
            # the factors made for the inertia also lead the rest of the way, too short to count as a step
            polished = done and worst > 1.0 and pivot > 0.0
            if not polished:
                negatives += inside
            if task == SOLVE and not done and not pivot > 0.0:
                reason = SINGULAR
            elif done and not polished:
                reason = CONVERGED
            else:
                turn_rest(ints, floats, plan, R, matrix, spare, rhs, factor)
                if task == LOOK:
                    reason = status
        if reason == RUNNING:
            scale = cap if task == TAKE else 1.0
            before = worst
            if task == TAKE:
                reason, worst = CONVERGED, 0.0
            elif not polished:
                turned = _largest(ints, rhs, 3 + 0 * n)
                if n > 0 and turned > cap:
                    scale = cap / turned
                # a variable, not the literal 0, for which numba would compile the function once more
                shift = _largest(ints, rhs, 0 * n) / floats[0]
                moved = max(turned / 1e-6, shift / 1e-7)
                n += 1
                if task == HELD and (max(turned, shift) > cap or not pivot > SINGULAR_PIVOT):
                    rhs[:] = 0.0
                if task != SOLVE:
                    reason, worst = status, moved
            _take(
                recover, turn_weight, ints, floats, x, R, inner, multiplier, rhs, store, poses, weight, move, xi, scale
            )  # fmt: skip
    if task == SOLVE and reason == CONVERGED and status > 0:
        # a leaf with a replaced tiny pivot or a folded angle is no answer, however small the residual
        reason = LOCAL_ANGLE_LIMIT if status == 1 else SINGULAR
    return reason, min(n, most), worst, negatives, pivot


@kernel(inline="always")
def _no_springs(ints, floats, x, R, rtol, noise, matrix, rhs, scale, poses, lams):
    """`add_springs` where there are none."""
    return 0


@kernel(inline="always")
def _no_weight_turned(pose, move, store):
    """`rotate_member_gravity` where nothing weighs anything."""


@kernel(inline="always")
def _no_turn_step(ints, floats, plan, R, matrix, spare, rhs, factor):
    """`turn_step` where no load has a skew tangent."""


@kernel
def newton(
    ints, floats, x, R, inner, multiplier, target, flat, at, task, near, most, factor, rtol, grain, cap, blow_up
):  # fmt: skip
    """A task on a system: see `solve_equilibrium`; ints, floats as in `FlatArrays`, flat, at as in `Workspace`.

    Returns (reason, steps taken, residual over its bound, negative pivots, smallest relative pivot); of LOOK, ASSEMBLE and
    NODES_ALONE the status of the members for the reason, of the last two those of the members alone, and the largest gap
    [m] for the pivot; of WHOLE and HELD that status, and the size of the step (see `newton_step`) for the residual.
    """
    return _newton(
        add_members, condense_linear, no_weight, no_weight_followed, no_weight_added, _no_springs, recover_leaf,
        _no_weight_turned, _no_turn_step,
        ints, floats, x, R, inner, multiplier, target, flat, at, task, near, most, factor, rtol, grain, cap, blow_up,
    )  # fmt: skip


@kernel
def newton_beams(
    ints, floats, x, R, inner, multiplier, target, flat, at, task, near, most, factor, rtol, grain, cap, blow_up
):  # fmt: skip
    """`newton` for chains too, springs, weight, and loads that are not conservative."""
    return _newton(
        add_members, condense_beam, set_member_gravity, follow_leaf, add_member_weight, add_springs, recover_beam,
        rotate_member_gravity, turn_step,
        ints, floats, x, R, inner, multiplier, target, flat, at, task, near, most, factor, rtol, grain, cap, blow_up,
    )  # fmt: skip


@kernel
def newton_any(
    ints, floats, x, R, inner, multiplier, target, flat, at, task, near, most, factor, rtol, grain, cap, blow_up
):  # fmt: skip
    """`newton_beams` for members of every kind."""
    return _newton(
        add_members, condense_any, set_member_gravity, follow_leaf, add_member_weight, add_springs, recover_any,
        rotate_member_gravity, turn_step,
        ints, floats, x, R, inner, multiplier, target, flat, at, task, near, most, factor, rtol, grain, cap, blow_up,
    )  # fmt: skip


_ENTRIES = (newton, newton_beams, newton_any)
"""By `FlatArrays.member_kinds`."""

NewtonResult = tuple[int, int, float, int, float]
"""Reason, steps taken, residual over its bound, negative pivots, smallest relative pivot: see `solve_equilibrium`."""


def _run(
    arrays: Arrays | KernelArrays, motion: State, target: np.ndarray, work: Workspace, task: int, *, near: int = 0,
    most: int = 0, factor: float = 1.0, rtol: float = 1e-8, grain: float = ROUNDING_MULTIPLE, cap: float = math.inf,
    blow_up: float = math.inf,
) -> NewtonResult:  # fmt: skip
    # one type of every argument: for another one all would be compiled again
    flat = arrays.flat
    found: NewtonResult = _ENTRIES[flat.member_kinds](
        flat.ints, flat.floats, *motion, np.ascontiguousarray(target, np.float64), work.flat, work.at,
        task, int(near), int(most), float(factor), float(rtol), float(grain), float(cap), float(blow_up),
    )  # fmt: skip
    return found


def solve_equilibrium(
    arrays: Arrays, motion: State, target: np.ndarray, factor: float, work: Workspace, rtol: float, most: int, cap: float,
    blow_up: float,
) -> NewtonResult:  # fmt: skip
    """Newton to equilibrium at the drive values `target` (c,) and load `factor`, in place.

    The first step (the predictor) is taken whole; later ones are scaled so that no node turns more than `cap` rad.
    `blow_up`: stop when the residual norm exceeds it (the eps_max of Appendix B); inf switches it off.
    Local angles beyond 60 degrees may pass on the way; a converged state that has one is refused.
    Returns (reason, steps taken, residual over its bound, negative pivots, smallest relative pivot).
    """
    return _run(
        arrays, motion, target, work, SOLVE, most=most, factor=factor, rtol=rtol, grain=0.0, cap=cap, blow_up=blow_up
    )  # fmt: skip


def assemble(
    arrays: Arrays | KernelArrays,
    motion: State,
    target: np.ndarray,
    factor: float,
    work: Workspace,
    rtol: float,
    near: int,
    grain: float,
) -> tuple[float, float, int, int]:
    """Residual and tangent at `motion`. Returns (residual over its bound, largest gap [m], negatives, status).

    near: 1 where chains are linearised about the near configuration in `work`, else 0. grain: how many times the rounding
    of stiffness times position the bounds include (design section 5: 10 eps).
    """
    status, _, worst, negatives, gap = _run(
        arrays, motion, target, work, ASSEMBLE, near=near, factor=factor, rtol=rtol, grain=grain
    )
    return worst, gap, negatives, status


def assemble_nodes(
    arrays: Arrays, motion: State, factor: float, work: Workspace, *, target: np.ndarray | None = None
) -> None:
    """Residual and tangent of constraint rows, at the drive values `target` (c,) or zero, loads and springs alone."""
    values = np.zeros(len(motion.multiplier)) if target is None else target
    _run(arrays, motion, values, work, NODES_ALONE, factor=factor, grain=0.0)


def check_residual(
    arrays: Arrays | KernelArrays,
    motion: State,
    target: np.ndarray,
    factor: float,
    work: Workspace,
    rtol: float,
) -> tuple[float, int, int]:
    """Residual over its bound, negative pivots and status at `motion`; the Newton step is left in work.rhs."""
    status, _, worst, negatives, _ = _run(arrays, motion, target, work, LOOK, factor=factor, rtol=rtol)
    return worst, negatives, status


def take_newton_step(
    arrays: Arrays | KernelArrays,
    motion: State,
    target: np.ndarray,
    factor: float,
    work: Workspace,
    rtol: float,
) -> float:
    """A whole Newton step from `motion`, in place. Returns its size: the larger of 1e6 times the largest rotation of a node
    [rad], and 1e7 times the largest displacement over the size of the mechanism."""
    return _run(arrays, motion, target, work, WHOLE, factor=factor, rtol=rtol)[2]


def take_step_at_fixed_rows(
    arrays: Arrays | KernelArrays, motion: State, factor: float, work: Workspace, most: float
) -> None:
    """A Newton step from `motion`, in place, drives and supports where they are. Inside the members alone where a node would
    turn by more than `most` [rad], or go further than that, over the size of the mechanism: what hardly anything resists."""
    _run(arrays, motion, np.zeros(len(motion.multiplier)), work, HELD, factor=factor, cap=most)


def take_step(
    arrays: Arrays | KernelArrays, motion: State, step: np.ndarray, work: Workspace, scale: float
) -> None:
    """motion <- motion + scale * step (n,), which is left in work.rhs; `work` as assembled at `motion`."""
    work.rhs[:] = step
    _run(arrays, motion, np.zeros(0), work, TAKE, cap=scale)


def move_nodes(arrays: Arrays, motion: State, step: np.ndarray, scale: float) -> None:
    """Positions, rotations and multipliers of `take_step`, members left alone."""
    x, R, _, multiplier = motion
    _move_nodes(arrays.flat.ints, x, R, multiplier, np.ascontiguousarray(step), float(scale), np.empty(6))


def largest_rotation(arrays: Arrays | KernelArrays, step: np.ndarray) -> float:
    """Largest rotation of any node in `step` (n,), rad."""
    return float(_largest(arrays.flat.ints, np.ascontiguousarray(step), 3))


def largest_displacement(arrays: Arrays | KernelArrays, step: np.ndarray) -> float:
    """Largest displacement of any node in `step` (n,), m."""
    return float(_largest(arrays.flat.ints, np.ascontiguousarray(step), 0))
