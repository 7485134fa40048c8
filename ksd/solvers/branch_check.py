"""The end of a load path on the intended branch: load steps, and the confirmation of a doubtful result.

A residual of zero does not identify the branch: 75 degrees in one step can end at a moment of the wrong sign. Signs of a
jump that cost nothing: an inertia that is not that of a minimum; negative work of loads and drives together on a mechanism
that was undeformed (the strain energy that it becomes is positive); an iteration that took long; loads that do much of the
work and did not converge easily. Then 4, 8, ... load steps are tried until two rounds end in the same minimum; failing that,
the path is followed by arc length, which detects limit points and bifurcations on it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from typing import Literal, NamedTuple

import numpy as np

from ksd.answers.derived import cached_per_model
from ksd.errors import ConvergenceError
from ksd.model.arrays import State, carries_load
from ksd.model.compile import Model
from ksd.model.newton import MAX_PREDICTOR_TURN, check_residual, largest_rotation
from ksd.model.turns import counted_rotation, node_rotations
from ksd.solvers.arc_length import END_REACHED, PathContinuation, follow_by_arc_length
from ksd.solvers.load_steps import (
    SAME_STATE_TOLERANCE,
    LoadPath,
    LoadStepRecord,
    LoadStepResult,
    largest_turn,
    state_difference,
    take_path,
)
from ksd.solvers.stable_steps import take_stable_steps
from ksd.solvers.steps import Step, Stop
from ksd.solvers.storage import NewtonStorage

MANY_ITERATIONS = 12
"""Iterations of an accepted load step above which its branch is confirmed."""
FEW_ITERATIONS = 5
"""Iterations of a step up to which its branch is not doubted for its loads."""
DOMINANT_LOAD_SHARE = 0.1
"""Share of the loads in the work done above which the branch of a step with more iterations is confirmed."""
SMALL_STEP = 0.2
"""Fraction of the load path; a solve that needed a smaller step is confirmed."""
MIN_CONFIRMING_STEPS = 16
"""Number of load steps up to which an answer is confirmed at least."""
MAX_CONFIRMING_STEPS = 128
"""Number of load steps above which an answer is confirmed by arc length at once, whose steps adapt to the path."""
NOT_A_MINIMUM = "its inertia is not that of a minimum"
"""The doubt that only a path by arc length settles: load steps may have passed a limit point or a bifurcation."""


def secant_work(model: Model, motion: State, target: np.ndarray) -> tuple[float, float]:
    """Secant work [J] of the drives, and of dead loads, from the undeformed state; their sum becomes strain energy.

    That of the loads is nan where follower loads make it depend on the path.
    """
    loads = model.arrays.loads
    driving = -0.5 * float(motion.multiplier.dot(target))
    if not carries_load(model.arrays):
        return driving, 0.0
    dead = _dead_loads(model)
    if dead.follow:
        return driving, float("nan")
    work, turned = (
        float(np.vdot(dead.force, motion.x) + np.vdot(dead.lever, motion.R)) - dead.at_rest,
        np.empty(3),
    )
    for i in dead.moments:
        node = loads.node[i]
        counted_rotation(motion.R[node], node_rotations(model.arrays, motion)[node], turned)
        work += float(loads.moment[i] @ turned)
    return driving, 0.5 * work


class _DeadLoads(NamedTuple):
    """Dead loads and weight as factors of a potential linear in the poses of the nodes.

    force (n, 3) [N]: on positions; lever (n, 3, 3) [Nm]: on rotation matrices; at_rest [J]: their sum in the undeformed
    state. moments: indices of the loads with a moment; follow: whether any load follows its link.
    """

    force: np.ndarray
    lever: np.ndarray
    at_rest: float
    moments: tuple[int, ...]
    follow: bool


@cached_per_model
def _dead_loads(model: Model) -> _DeadLoads:
    """Loads of a model; half the weight of a leaf at each end, as its centre moves about like their mean; line loads
    likewise."""
    loads, weight, members = model.arrays.loads, model.arrays.weight, model.arrays.members
    force, lever = np.zeros_like(model.rest.x), np.zeros_like(model.rest.R)
    np.add.at(force, loads.node, loads.force)
    np.add.at(lever, loads.node, loads.force[:, :, None] * loads.point[:, None])
    if len(weight):
        for end in (0, 1):
            line = members.length[:, None] * (weight[:, 4:7] / 2 + weight[:, 7:10] / (6 - 3 * end))
            half = 0.5 * weight[:, :1] * weight[:, 1:4] + line
            np.add.at(force, members.node[:, end], half)
            np.add.at(lever, members.node[:, end], half[:, :, None] * members.offset[:, end, None])
    at_rest = float(np.vdot(force, model.rest.x) + np.trace(lever, axis1=1, axis2=2).sum())
    moments = tuple(np.flatnonzero(np.any(loads.moment, axis=1)).tolist())
    follow = bool(np.any(loads.following == 1) or len(model.arrays.under_pressure))
    return _DeadLoads(force, lever, at_rest, moments, follow)


def loads_dominate(model: Model, motion: State, target: np.ndarray, most_iterations: int) -> bool:
    """Whether loads do much of the work and a step took more than a few iterations, so that one step proves little."""
    if most_iterations <= FEW_ITERATIONS or not carries_load(model.arrays):
        return False
    driving, loading = secant_work(model, motion, target)
    # negated, so that work that depends on the path (nan) counts as large
    return not abs(loading) <= DOMINANT_LOAD_SHARE * (abs(driving) + abs(loading))


def branch_doubt(
    model: Model, begin: State, motion: State, record: LoadStepRecord, target: np.ndarray, *, from_rest: bool, steps: int
) -> str:  # fmt: skip
    """Why the state may be on another branch than the intended one; empty without a doubt.

    begin: where the load path began, from_rest: at the undeformed state; steps: number of equal steps tried first.
    """
    if record.negatives != len(target):
        return NOT_A_MINIMUM
    if record.most_iterations > MANY_ITERATIONS:
        return f"a load step took {record.most_iterations} iterations"
    if record.smallest_step < min(SMALL_STEP, 0.9 / steps):
        return f"a load step had to be cut to {100 * record.smallest_step:.2g} % of the way"
    turned = largest_turn(model.arrays, motion, begin) / steps
    if turned > math.pi:
        return f"a load step turned a torsion spring or a drive by {math.degrees(turned):.4g} deg"
    if not from_rest:
        return ""
    if sum(secant_work(model, motion, target)) < 0.0:
        return "drives and loads did negative work on it"
    if loads_dominate(model, motion, target, record.most_iterations):
        return f"loads do much of the work, and a load step took {record.most_iterations} iterations"
    return ""


def slow_step_doubts(steps: Iterable[Step]) -> tuple[str, ...]:
    """Doubts about equilibrium steps from a kinematic start that took long: they may have ended on another branch."""
    return tuple(
        f"step '{s.name}' took {s.iterations} iterations" for s in steps if s.iterations > MANY_ITERATIONS
    )


def confirm_by_smaller_steps(
    model: Model,
    first: LoadStepResult,
    repeat: Callable[[int], LoadStepResult],
    continuation: Callable[[], PathContinuation],
    doubt: str,
) -> LoadStepResult:
    """The state in which two rounds of load steps agree.

    first: the doubtful result; repeat: takes the same path in so many steps; continuation: follows it by arc length, last,
    where smaller steps do not agree or end in a state that is no minimum.
    """
    solves, tried = first.record.factorisations, first.record.steps_tried
    last, size = first, max(4, int(np.ceil(2.0 / first.record.smallest_step)))
    end, confirmed, reason = min(max(MIN_CONFIRMING_STEPS, 4 * size), MAX_CONFIRMING_STEPS), False, doubt
    while size <= end and not confirmed:
        finer = repeat(size)
        solves, tried = solves + finer.record.factorisations, tried + finer.record.steps_tried
        if finer.record.stop is not Stop.CONVERGED:
            reason = f"{doubt}, and smaller load steps stop at {100 * finer.record.fraction_reached:.3g} % of the way"
            break
        same = state_difference(model, finer.motion, last.motion) < SAME_STATE_TOLERANCE
        confirmed = (
            same and doubt != NOT_A_MINIMUM and finer.record.negatives == len(model.arrays.terms.start)
        )
        last, size = finer, 2 * size
        if same and not confirmed:
            break
    how = ", ".join(filter(None, [last.how, f"repeated in smaller steps: {doubt}"]))
    result = LoadStepResult(last.record._replace(factorisations=solves, steps_tried=tried), how, last.motion)
    return result if confirmed else confirm_by_arc_length(result._replace(doubts=(reason,)), continuation)


def _continue(
    last: LoadStepResult, continuation: Callable[[], PathContinuation]
) -> tuple[LoadStepResult, PathContinuation | None]:
    """The path by arc length, None where it has no start; and `last` with its factorisations added."""
    try:
        path = continuation()
    except (ConvergenceError, np.linalg.LinAlgError):
        return last, None
    factorisations = last.record.factorisations + path.factorisations
    return last._replace(record=last.record._replace(factorisations=factorisations)), path


def confirm_by_arc_length(
    last: LoadStepResult, continuation: Callable[[], PathContinuation]
) -> LoadStepResult:
    """The end of the path followed by arc length; where that has singular points or no end, `last` with its first doubt and
    these."""
    last, path = _continue(last, continuation)
    if path is None:
        return last
    last = last._replace(how=f"{last.how}, then by arc length")
    if path.stop_reason == END_REACHED and not path.singular_points:
        end = path.points[-1]
        return LoadStepResult(
            last.record._replace(negatives=path.newton.count_unstable(end)), last.how, end.motion
        )
    obstacle = f"no end: {path.stop_reason}"
    if path.singular_points:
        first = path.singular_points[0]
        obstacle = f"a {first.kind} point at {100 * first.point.f:.3g} % of the way"
    return last._replace(doubts=(f"{last.doubts[0]}; the path from its start has {obstacle}",))


def complete_by_arc_length(
    first: LoadStepResult, continuation: Callable[[], PathContinuation]
) -> LoadStepResult:
    """The end of the path followed by arc length, where load steps have stopped before it; `first` where it has
    no end.

    A path with a singular point is not followed past it, since the mechanism would snap there; a doubt names the point.
    """
    first, path = _continue(first, continuation)
    if path is None:
        return first
    if path.singular_points:
        singular = path.singular_points[0]
        kind = "turns back at a limit" if singular.kind == "limit" else "branches at a bifurcation"
        at = f"{100 * singular.point.f:.3g} % of the way"
        doubt = (
            f"the path from its start {kind} point at {at}, where the mechanism snaps or buckles; ksd.follow goes along "
            f"the path, here on {path.model.mesh}"
        )
        return first._replace(doubts=(doubt,))
    if path.stop_reason != END_REACHED:
        return first
    end = path.points[-1]
    record = first.record._replace(
        stop=Stop.CONVERGED, residual=1.0, negatives=path.newton.count_unstable(end), fraction_reached=1.0
    )
    return LoadStepResult(record, ", ".join(filter(None, [first.how, "by arc length"])), end.motion)


def _take_first_steps(
    storage: NewtonStorage, begin: State, path: LoadPath, planar: bool | Literal["auto"], from_rest: bool
) -> tuple[LoadStepResult, bool]:
    """The path in steps that are halved on failure; where loads would turn a link by more than half a turn in one, as in
    cables, in stable steps.

    Returns it and whether it needs no confirmation: stable steps, and a path that may not be cut, which is an attempt only.
    """
    is_attempt = path.smallest_step >= 1.0 / path.steps
    if is_attempt or not _predicts_nothing(storage, begin, path):
        first = take_path(storage, begin, path, planar, from_rest)
        return first, is_attempt and not _is_minimum(first, path)
    once = path._replace(
        smallest_step=1.0 / path.steps, max_iterations=min(path.max_iterations, MANY_ITERATIONS)
    )
    first = take_path(storage, begin, once, planar, from_rest)
    if _is_minimum(first, path):
        return first, False
    stable = take_path(storage, begin, path, planar, from_rest, stepping=take_stable_steps)
    if _is_minimum(stable, path):
        how = ", ".join(filter(None, [stable.how, "loads first, every step to a minimum"]))
        return _with_tries(stable._replace(how=how), first), True
    return take_path(storage, begin, path, planar, from_rest), False


def _predicts_nothing(storage: NewtonStorage, begin: State, path: LoadPath) -> bool:
    """Whether a step over the whole path is cut, see `ksd.model.newton.MAX_PREDICTOR_TURN`, under loads that are weight."""
    model = storage.model
    # under loads without a potential the inertia is no verdict, nor is that of chains, whose stresses are extrapolated
    if not len(model.arrays.weight) or not model.conservative or model.chains:
        return False
    check_residual(model.arrays, begin.copy(), *path.values_at(1.0), storage.work, path.rtol)
    return largest_rotation(model.arrays, storage.work.rhs) > MAX_PREDICTOR_TURN


def _with_tries(last: LoadStepResult, *tries: LoadStepResult) -> LoadStepResult:
    """The last result, with the iterations and load steps of the tries before it."""
    record = last.record._replace(
        factorisations=sum(t.record.factorisations for t in (*tries, last)),
        steps_tried=sum(t.record.steps_tried for t in (*tries, last)),
    )
    return last._replace(record=record)


def _is_minimum(found: LoadStepResult, path: LoadPath) -> bool:
    """Whether the end of the path was reached, in a minimum."""
    return found.record.stop is Stop.CONVERGED and found.record.negatives == len(path.target)


def follow_load_path(
    storage: NewtonStorage,
    begin: State,
    path: LoadPath,
    *,
    from_rest: bool,
    planar: bool | Literal["auto"] = "auto",
) -> LoadStepResult:
    """Follow a load path from the equilibrium `begin` by load steps, and confirm a doubtful result.

    from_rest: whether `begin` is the undeformed state; planar: see `ksd.solvers.conventional.solve_conventional`.
    """
    model = storage.model
    # with eps_max it is the paper's own program, which accepts every converged state
    if path.eps_max < math.inf:
        return take_path(storage, begin, path, planar, from_rest)
    first, settled = _take_first_steps(storage, begin, path, planar, from_rest)
    if settled:
        return first

    def repeat(steps: int) -> LoadStepResult:
        finer = path._replace(steps=steps, smallest_step=min(path.smallest_step, 0.25 / steps))
        return take_path(storage, begin, finer, planar, from_rest)

    def continuation() -> PathContinuation:
        return follow_by_arc_length(model, path, begin, max_singular_points=1)

    if first.record.stop is Stop.SINGULAR and first.record.fraction_reached == 0.0:
        # a part that nothing holds from the start on has no path
        return first
    if first.record.stop is not Stop.CONVERGED:
        return complete_by_arc_length(first, continuation)
    doubt = branch_doubt(
        model, begin, first.motion, first.record, path.target, from_rest=from_rest, steps=path.steps
    )
    return confirm_by_smaller_steps(model, first, repeat, continuation, doubt) if doubt else first
