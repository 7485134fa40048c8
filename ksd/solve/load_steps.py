"""Equilibrium by load steps from a given state, in the plane where the scene is planar, on the intended branch.

The whole load path is tried as one step first, and steps are halved on failure (`take_load_steps`). A residual of zero does
not identify the branch: 75 degrees in one step can end at a moment of the wrong sign. Signs of a jump that cost nothing: an
inertia that is not that of a minimum; negative work of loads and drives together on a mechanism that was undeformed (the
strain energy that it becomes is positive); an iteration that took long; loads that do much of the work and did not converge
easily. Then 4, 8, ... load steps are tried until two rounds end in the same minimum; failing that, the path is followed by
arc length, which detects limit points and bifurcations on it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Literal, NamedTuple

import numpy as np

from ksd.errors import ConvergenceError, SceneError
from ksd.model.arrays import LINEAR, Arrays, State, Workspace, carries_load
from ksd.model.compile import Model
from ksd.model.newton import CONVERGED, SINGULAR, NewtonResult, assemble, solve_equilibrium
from ksd.model.plane import Plane, plane_of, refuse_plane
from ksd.numerics.rotations import rotation_log
from ksd.properties.cache import cached_per_model
from ksd.properties.doctor import doctor
from ksd.scene.hinges import plane_supports
from ksd.solve.arc_length import END_REACHED, PathContinuation, PathParameter, follow_by_arc_length
from ksd.solve.nonconservative_stability import count_unstable_directions
from ksd.solve.pivoted_newton import iterate_pivoted, moves_freely
from ksd.solve.steps import MAX_TURN_PER_STEP, RTOL, Step, Stop
from ksd.solve.storage import NewtonStorage

WEAK_PIVOT = 1e-9
"""Relative pivot below which a load step, or the count of its negative pivots, is repeated with pivoting."""
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
SAME_STATE_TOLERANCE = 1e-6
"""Largest difference of two equal states: rotation matrices, and positions over the size of the mechanism."""
START_FRACTION = 1e-3
"""Fraction of the load path up to which a solve counts as stopped at its start."""
NOT_A_MINIMUM = "its inertia is not that of a minimum"
"""The doubt that only a path by arc length settles: load steps may have passed a limit point or a bifurcation."""


class LoadStepRecord(NamedTuple):
    """Outcome of a sequence of load steps.

    factorisations: failed attempts included; residual: over its bound; negatives: negative pivots; fraction_reached: of the
    load path; steps_tried, steps_with_pivoting: numbers of load steps; most_iterations: of an accepted load step;
    smallest_step: fraction of the load path.
    """

    stop: Stop
    factorisations: int
    residual: float
    negatives: int
    fraction_reached: float
    steps_tried: int
    steps_with_pivoting: int = 0
    most_iterations: int = 0
    smallest_step: float = 1.0


class LoadStepResult(NamedTuple):
    """Outcome of load steps, how they were taken (in words), the state they ended in, and the doubts that remain."""

    record: LoadStepRecord
    how: str
    motion: State
    doubts: tuple[str, ...] = ()


class LoadPath(NamedTuple):
    """Drive values from `start` to `target` (c,), loads between two factors, and the settings of the steps.

    steps: number of equal steps tried first; rtol, max_iterations, max_turn, eps_max: of every Newton solve, see
    `ksd.model.newton.solve_equilibrium`; smallest_step: fraction of the path below which steps are not halved any more.
    """

    start: np.ndarray
    target: np.ndarray
    factors: tuple[float, float] = (0.0, 1.0)
    steps: int = 1
    rtol: float = RTOL
    max_iterations: int = 30
    max_turn: float = MAX_TURN_PER_STEP
    eps_max: float = math.inf
    smallest_step: float = 1e-4

    def values_at(self, fraction: float) -> tuple[np.ndarray, float]:
        """Drive values and load factor at a fraction of the path."""
        low, high = self.factors
        if fraction == 1.0:
            # the end exactly
            return self.target, high
        return self.start + fraction * (self.target - self.start), low + fraction * (high - low)


def take_load_steps(
    motion: State,
    newton: Callable[..., NewtonResult],
    path: LoadPath,
    *,
    begin: State | None = None,
    pivoting: tuple[Arrays, Workspace] | None = None,
) -> LoadStepRecord:
    """Take load steps along a path, halving them on failure; `motion` ends at the last equilibrium.

    newton: brings a state to equilibrium in place, as `ksd.solve.storage.NewtonStorage.newton`. begin: a copy of the state
    that `motion` starts from, where there is one. pivoting: spatial arrays and storage with which steps of weak pivots are
    repeated.
    """
    done, solves, tried, pivoted, most, residual, negatives = 0.0, 0, 0, 0, 0, math.inf, 0
    size = smallest = 1.0 / path.steps
    safe = begin
    settings = path.rtol, path.max_iterations, path.max_turn, path.eps_max
    while done < 1.0:
        goal = 1.0 if done + size > 1.0 - 1e-9 else done + size
        arguments = (*path.values_at(goal), *settings)
        safe = motion.copy() if safe is None else safe
        reason, count, residual, negatives, pivot = newton(motion, *arguments)
        solves, tried = solves + count, tried + 1
        if pivoting is not None and _needs_pivoting(pivoting[0], reason, pivot):
            arrays, work = pivoting
            if reason != CONVERGED:
                motion.assign(safe)
            # a step that has converged is assembled once, without an iteration
            reason, count, residual, negatives, _ = iterate_pivoted(
                arrays, motion, *arguments[:2], work, *arguments[2:]
            )
            solves, pivoted = solves + count, pivoted + 1
        if reason == CONVERGED:
            done, most, smallest, safe = goal, max(most, count), min(smallest, size), None
            continue
        motion.assign(safe)
        size *= 0.5
        if size < path.smallest_step:
            return LoadStepRecord(
                Stop(reason), solves, residual, negatives, done, tried, pivoted, most, smallest
            )
    return LoadStepRecord(Stop.CONVERGED, solves, residual, negatives, 1.0, tried, pivoted, most, smallest)


def _needs_pivoting(arrays: Arrays, reason: int, pivot: float) -> bool:
    """Whether pivoting may help: a pivot of rounding, or a step that failed under loads with a skew tangent."""
    failed = reason != Stop.CONVERGED
    return reason == Stop.SINGULAR or pivot < WEAK_PIVOT or (failed and bool(arrays.loads.skew.any()))


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
        rotation_log(motion.R[loads.node[i]], turned)
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
    """Loads and weight of a model; half the weight of a leaf at each end, as its centre moves about like their mean."""
    loads, weight, members = model.arrays.loads, model.arrays.weight, model.arrays.members
    force, lever = np.zeros_like(model.rest.x), np.zeros_like(model.rest.R)
    np.add.at(force, loads.node, loads.force)
    np.add.at(lever, loads.node, loads.force[:, :, None] * loads.point[:, None])
    if len(weight):
        half = 0.5 * weight[:, :1] * weight[:, 1:]
        for end in (0, 1):
            np.add.at(force, members.node[:, end], half)
            np.add.at(lever, members.node[:, end], half[:, :, None] * members.offset[:, end, None])
    at_rest = float(np.vdot(force, model.rest.x) + np.trace(lever, axis1=1, axis2=2).sum())
    moments = tuple(np.flatnonzero(np.any(loads.moment, axis=1)).tolist())
    return _DeadLoads(force, lever, at_rest, moments, bool(np.any(loads.following == 1)))


def loads_dominate(model: Model, motion: State, target: np.ndarray, most_iterations: int) -> bool:
    """Whether loads do much of the work and a step took more than a few iterations, so that one step proves little."""
    if most_iterations <= FEW_ITERATIONS or not carries_load(model.arrays):
        return False
    driving, loading = secant_work(model, motion, target)
    # negated, so that work that depends on the path (nan) counts as large
    return not abs(loading) <= DOMINANT_LOAD_SHARE * (abs(driving) + abs(loading))


def branch_doubt(
    model: Model, motion: State, record: LoadStepRecord, target: np.ndarray, *, from_rest: bool, steps: int
) -> str:
    """Why the state may be on another branch than the intended one; empty without a doubt.

    from_rest: the load path began at the undeformed state; steps: number of equal steps tried first.
    """
    if record.negatives != len(target):
        return NOT_A_MINIMUM
    if record.most_iterations > MANY_ITERATIONS:
        return f"a load step took {record.most_iterations} iterations"
    if record.smallest_step < min(SMALL_STEP, 0.9 / steps):
        return f"a load step had to be cut to {100 * record.smallest_step:.2g} % of the way"
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


def state_difference(model: Model, one: State, other: State) -> float:
    """Largest difference of two states: positions over the size of the mechanism, and rotation matrices."""
    shift = np.abs(one.x - other.x).max(initial=0.0) / model.arrays.size
    return float(max(shift, np.abs(one.R - other.R).max(initial=0.0)))


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
    end, confirmed, reason = max(MIN_CONFIRMING_STEPS, 4 * size), False, doubt
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
        return LoadStepResult(last.record._replace(negatives=end.negatives), last.how, end.motion)
    obstacle = f"no end: {path.stop_reason}"
    if path.singular_points:
        first, more = path.singular_points[0], len(path.singular_points) - 1
        obstacle = (
            f"a {first.kind} point at {100 * first.point.f:.3g} % of the way"
            + f", and {more} more" * (more > 0)
        )
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
        stop=Stop.CONVERGED, residual=1.0, negatives=end.negatives, fraction_reached=1.0
    )
    return LoadStepResult(record, ", ".join(filter(None, [first.how, "by arc length"])), end.motion)


def _take_path(
    storage: NewtonStorage, begin: State, path: LoadPath, planar: bool | Literal["auto"], from_rest: bool
) -> LoadStepResult:
    """Take load steps from `begin`, in the plane where the scene is planar, else in space."""
    reason = ""
    if planar is not False:
        plane = plane_of(storage.model)
        found = (
            plane if isinstance(plane, str) else _take_path_in_plane(storage, plane, begin, path, from_rest)
        )
        if not isinstance(found, str):
            record, motion = found
            if planar is True or record.stop in (Stop.CONVERGED, Stop.LOCAL_ANGLE):
                how = "planar, 3 unknowns per node"
                return LoadStepResult(_with_divergences(storage.model, motion, record, path), how, motion)
            # in space there is the Newton with pivoting
            found = f"in the plane {record.stop.sentence}"
        elif planar is True:
            raise SceneError(
                f"planar = True: this mechanism is not planar: {found}; use planar = 'auto' or False"
            )
        reason = f"spatial: {found}"
    motion = begin.copy()
    record = take_load_steps(
        motion, storage.newton, path, begin=begin, pivoting=(storage.model.arrays, storage.work)
    )
    return LoadStepResult(_with_divergences(storage.model, motion, record, path), reason, motion)


@cached_per_model
def _cannot_leave_plane(model: Model) -> bool:
    """Whether the plane that a mechanism names holds all its nodes, and its members have constant stiffness, so that nothing
    inside them could leave the plane."""
    held_links = {term.link for hold in plane_supports(model.scene) for term in hold.terms}
    return held_links.issuperset(model.node_names[1:]) and model.kinds <= {LINEAR}


def _take_path_in_plane(
    storage: NewtonStorage, plane: Plane, begin: State, path: LoadPath, from_rest: bool
) -> tuple[LoadStepRecord, State] | str:
    """`take_load_steps` with three unknowns per node, and the state reached; or the reason why that is not possible.

    The state is checked in space: a residual out of the plane refuses it, and the residual and the negative pivots returned
    are those of the spatial tangent, so that buckling out of the plane is detected.
    """
    model, motion, work = storage.model, begin.copy(), storage.planar(plane)
    if not from_rest:
        if not plane.contains(begin):
            return "the configuration to start from is not in the plane"
        # forces that only hold the mechanism in its plane
        motion.multiplier[np.setdiff1d(np.arange(len(motion.multiplier)), plane.rows)] = 0.0

    def newton(motion: State, values: np.ndarray, factor: float, *settings: Any) -> NewtonResult:
        found = solve_equilibrium(plane.arrays, motion, values, factor, work, *settings)
        if found[0] == CONVERGED and found[4] < WEAK_PIVOT:
            # a part that nothing holds has converged too, at rest and where no force acts against it
            assemble(plane.arrays, motion, values, factor, work, settings[0], 0, 0.0)
            return (SINGULAR, *found[1:]) if moves_freely(plane.arrays, work) else found
        return found

    record = take_load_steps(motion, newton, path, begin=begin)
    if record.smallest_step < 0.9 / path.steps:
        # a step was halved: a part that nothing holds at the start swings to and fro where its pivot of zero is rounded up
        assemble(plane.arrays, begin, *path.values_at(record.smallest_step), work, path.rtol, 0, 0.0)
        if moves_freely(plane.arrays, work):
            return record._replace(stop=Stop.SINGULAR, fraction_reached=0.0), begin.copy()
    if _cannot_leave_plane(model):
        return record._replace(negatives=record.negatives + len(motion.multiplier) - len(plane.rows)), motion
    values, factor = path.values_at(record.fraction_reached)
    residual, negatives, status = storage.check_residual(motion, values, path.rtol, factor)
    if residual > 1.0:
        share, node, force, moment = plane.imbalance(storage.work)
        if share > 1.0:
            reason = (
                f"its leaf springs and loads do not balance out of the plane: {force:.3g} N along its normal and "
                f"{moment:.3g} Nm across it are left on '{model.node_names[node]}'"
            )
            refuse_plane(model, reason)
            return reason
    if record.stop is not Stop.CONVERGED:
        return record, motion
    if residual > max(1.0, 2.0 * record.residual) or status != 0:
        return "what was found is no equilibrium in space"
    return record._replace(residual=residual, negatives=negatives), motion


def _with_divergences(model: Model, motion: State, record: LoadStepRecord, path: LoadPath) -> LoadStepRecord:
    """The record with the count that replaces negative pivots where loads are not conservative."""
    if record.stop is not Stop.CONVERGED or model.conservative:
        return record
    return record._replace(
        negatives=count_unstable_directions(model, motion, path.factors[1], record.negatives)
    )


def follow_load_path(
    storage: NewtonStorage,
    begin: State,
    path: LoadPath,
    *,
    from_rest: bool,
    planar: bool | Literal["auto"] = "auto",
) -> LoadStepResult:
    """Follow a load path from the equilibrium `begin` by load steps, and confirm a doubtful result.

    from_rest: whether `begin` is the undeformed state; planar: see `ksd.solve.conventional.solve_conventional`.
    """
    model = storage.model
    first = _take_path(storage, begin, path, planar, from_rest)
    # with eps_max it is the paper's own program, which accepts every converged state
    if path.eps_max < math.inf:
        return first

    def repeat(steps: int) -> LoadStepResult:
        finer = path._replace(steps=steps, smallest_step=min(path.smallest_step, 0.25 / steps))
        return _take_path(storage, begin, finer, planar, from_rest)

    def continuation(max_singular_points: float = math.inf) -> PathContinuation:
        low, high = path.factors
        parameter = PathParameter(path.start, path.target - path.start, low, high - low)
        return follow_by_arc_length(model, parameter, begin, max_singular_points=max_singular_points)

    if first.record.stop is Stop.SINGULAR and first.record.fraction_reached == 0.0:
        # a part that nothing holds from the start on has no path
        return first
    if first.record.stop is not Stop.CONVERGED:
        return complete_by_arc_length(first, lambda: continuation(max_singular_points=1))
    doubt = branch_doubt(
        model, first.motion, first.record, path.target, from_rest=from_rest, steps=path.steps
    )
    return confirm_by_smaller_steps(model, first, repeat, continuation, doubt) if doubt else first


def _rigid_conflicts(model: Model) -> Iterator[str]:
    """Sentences of the doctor on drives that contradict rigid parts alone, so that no leaf spring can give way."""
    for fight in doctor(model.original_scene).fights:
        if fight.what.startswith("drive ") and all(
            o.startswith(("drive ", "support ")) for o in fight.others
        ):
            yield fight.sentence


def as_step(record: LoadStepRecord, how: str, time: float) -> Step:
    """Load steps that took `time` [s] as one step of a solve; how: see `LoadStepResult`."""
    note = f"{record.steps_tried} load step{'s' * (record.steps_tried != 1)}{', ' * bool(how)}{how}"
    if record.steps_with_pivoting:
        note += ", with pivoting"
    return Step("equilibrium", record.factorisations, time, record.residual, record.stop, note)


def stop_sentence(model: Model, record: LoadStepRecord, doubts: tuple[str, ...]) -> str:
    """Where and why load steps stopped, as a sentence."""
    reason = doubts[0] if doubts else record.stop.sentence
    if record.fraction_reached < START_FRACTION:
        reason = next(_rigid_conflicts(model), reason)
    return f"the conventional solver stopped at {100 * record.fraction_reached:.3g} % of the drive motion: {reason}"
