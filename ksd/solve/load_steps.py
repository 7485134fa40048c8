"""Equilibrium by load steps from a given state, in the plane where the scene is planar, and on the branch meant.

The whole step is tried first and halved on failure (`take_load_steps`). A residual of zero does not tell the branch: 75
degrees in one step can end at a moment of the wrong sign. What gives a jump away, at no cost: an inertia that is not that of
a minimum, loads and drives that together did no positive work on a mechanism that was at rest (the strain energy they should
have become is positive), an iteration that wandered, or loads that do much of the work and did not come in easily. Then 4,
8, ... load steps are tried until two rounds end in the same minimum; failing that, the path is followed by arc length, which
tells limit points and bifurcations on the way.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Literal, NamedTuple

import numpy as np

from ksd.errors import ConvergenceError, SceneError
from ksd.model.arrays import LINEAR, Arrays, Motion, Work, carries_load
from ksd.model.compile import Model
from ksd.model.newton import CONVERGED, SINGULAR, Newton, assemble, iterate
from ksd.model.plane import Plane, plane_of, refuse_plane
from ksd.numerics.rotations import rotation_log
from ksd.properties.cache import cached_per_model
from ksd.properties.doctor import doctor
from ksd.scene.hinges import plane_holds
from ksd.solve.arc_length import END_REACHED, PathContinuation, PathParameter, follow_by_arc_length
from ksd.solve.following import counted
from ksd.solve.pivoted_newton import iterate_pivoted, moves_freely
from ksd.solve.steps import CAP, RTOL, Step, Stop
from ksd.solve.storage import Storage

WEAK_PIVOT = 1e-9
"""Relative pivot below which a load step is done again, or its inertia counted again, with pivoting."""


class LoadStepRecord(NamedTuple):
    """How driving went: why it stopped, factorisations including failed attempts, residual over its bound, negative
    pivots, fraction of the drive motion reached, load steps tried, load steps that needed pivoting, most iterations of a
    load step, the smallest one (fraction of the way)."""

    stop: Stop
    factorisations: int
    residual: float
    negatives: int
    fraction_reached: float
    steps_tried: int
    steps_with_pivoting: int = 0
    most_iterations: int = 0
    smallest_step: float = 1.0


class LoadPath(NamedTuple):
    """Drives from `start` to `target` (c,) and loads between two factors, and how to go: steps: equal ones tried first;
    rtol, most, cap, eps_max: of every Newton solve (`ksd.model.newton.iterate`); smallest: fraction of the way below which
    steps are not halved any more."""

    start: np.ndarray
    target: np.ndarray
    factors: tuple[float, float] = (0.0, 1.0)
    steps: int = 1
    rtol: float = RTOL
    most: int = 30
    cap: float = CAP
    eps_max: float = math.inf
    smallest: float = 1e-4

    def values_at(self, share: float) -> tuple[np.ndarray, float]:
        """Drive values and load factor at a fraction of the way."""
        low, high = self.factors
        if share == 1.0:
            # land on the end exactly
            return self.target, high
        return self.start + share * (self.target - self.start), low + share * (high - low)


def take_load_steps(
    motion: Motion,
    newton: Callable[..., Newton],
    way: LoadPath,
    *,
    begin: Motion | None = None,
    pivoting: tuple[Arrays, Work] | None = None,
) -> LoadStepRecord:
    """Go a way, halving its steps on failure; `motion` ends at the last equilibrium.

    newton: brings a state to equilibrium in place, as `ksd.solve.storage.Storage.newton`. begin: what `motion` starts from,
    where that is kept elsewhere. pivoting: spatial arrays and storage with which a step of weak pivots is done again.
    """
    done, solves, taken, pivoted, longest, residual, negatives = 0.0, 0, 0, 0, 0, math.inf, 0
    size = shortest = 1.0 / way.steps
    safe = begin
    bounds = way.rtol, way.most, way.cap, way.eps_max
    while done < 1.0:
        goal = 1.0 if done + size > 1.0 - 1e-9 else done + size
        aim = (*way.values_at(goal), *bounds)
        safe = motion.copy() if safe is None else safe
        reason, count, residual, negatives, pivot = newton(motion, *aim)
        solves, taken = solves + count, taken + 1
        if pivoting is not None and _weak(pivoting[0], reason, pivot):
            reason, count, residual, negatives, _ = _with_pivoting(pivoting, motion, safe, aim, reason)
            solves, pivoted = solves + count, pivoted + 1
        if reason == CONVERGED:
            done, longest, shortest, safe = goal, max(longest, count), min(shortest, size), None
            continue
        motion.assign(safe)
        size *= 0.5
        if size < way.smallest:
            return LoadStepRecord(
                Stop(reason), solves, residual, negatives, done, taken, pivoted, longest, shortest
            )
    return LoadStepRecord(Stop.CONVERGED, solves, residual, negatives, 1.0, taken, pivoted, longest, shortest)


def _weak(arrays: Arrays, reason: int, pivot: float) -> bool:
    """Whether pivoting may do better: a pivot of rounding, or a step that failed under loads with a skew tangent."""
    failed = reason != Stop.CONVERGED
    return reason == Stop.SINGULAR or pivot < WEAK_PIVOT or (failed and bool(arrays.loads.skew.any()))


def _with_pivoting(
    storage: tuple[Arrays, Work], motion: Motion, safe: Motion, aim: tuple, reason: int
) -> tuple[int, int, float, int, float]:
    """The load step again with pivoting, from `safe`; a step that converged is only looked over (no iteration)."""
    if reason != Stop.CONVERGED:
        motion.assign(safe)
    arrays, work = storage
    return iterate_pivoted(arrays, motion, *aim[:2], work, *aim[2:])


class LoadStepResult(NamedTuple):
    """How driving went, in what, in words, where it ended, and the doubts that remain."""

    record: LoadStepRecord
    how: str
    motion: Motion
    doubts: tuple[str, ...] = ()


MANY_ITERATIONS = 12
"""Iterations of an accepted load step above which its branch is confirmed."""
EASY, LADEN = 5, 0.1
"""Iterations of a step, and share of the loads in the work done, above both of which its branch is confirmed."""
FINE = 16
"""Load steps up to which an answer is confirmed, at least."""
CUT = 0.2
"""A load step that had to be cut below this fraction of the way is confirmed."""
SAME = 1e-6
"""Largest difference of two equal states, over the size of the mechanism."""
SADDLE = "its inertia is not that of a minimum"
"""The doubt that only a path by arc length settles: the way there may lead over a limit point or a bifurcation."""


def secant_work(model: Model, motion: Motion, target: np.ndarray) -> tuple[float, float]:
    """Secant work [J] of the drives, and of dead loads, from rest to `motion`; their sum becomes strain energy.

    That of the loads is nan where following loads make it depend on the path.
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
    """Dead loads and weight as forces on nodes: force (n, 3) on their places, lever (n, 3, 3) on their rotation matrices.

    Their potential is linear in both; at_rest: what it is there. moments: numbers of the loads with one; follow: whether
    any load follows its link.
    """

    force: np.ndarray
    lever: np.ndarray
    at_rest: float
    moments: tuple[int, ...]
    follow: bool


@cached_per_model
def _dead_loads(model: Model) -> _DeadLoads:
    """The loads and weight of a model; half the weight of a leaf at each end, since its centre moves about as their mean."""
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


def loads_dominate(model: Model, motion: Motion, target: np.ndarray, longest: int) -> bool:
    """Whether loads do so much of the work, and a step took so many iterations, that one step proves little."""
    if longest <= EASY or not carries_load(model.arrays):
        return False
    driving, loading = secant_work(model, motion, target)
    # work that depends on the path is not small
    return not abs(loading) <= LADEN * (abs(driving) + abs(loading))


def doubt(
    model: Model, motion: Motion, driven: LoadStepRecord, target: np.ndarray, *, fresh: bool, steps: int
) -> str:
    """Why the state reached in `steps` may not be the one meant, or nothing. fresh: the mechanism was at rest before."""
    if driven.negatives != len(target):
        return SADDLE
    if driven.most_iterations > MANY_ITERATIONS:
        return f"a load step took {driven.most_iterations} iterations"
    if driven.smallest_step < min(CUT, 0.9 / steps):
        return f"a load step had to be cut to {100 * driven.smallest_step:.2g} % of the way"
    if not fresh:
        return ""
    if sum(secant_work(model, motion, target)) < 0.0:
        return "drives and loads did negative work on it"
    if loads_dominate(model, motion, target, driven.most_iterations):
        return f"loads do much of the work, and a load step took {driven.most_iterations} iterations"
    return ""


def slow_step_doubts(steps: Iterable[Step]) -> tuple[str, ...]:
    """Doubts about equilibrium steps of a kinematic start that took long: they may have wandered to another branch."""
    return tuple(
        f"step '{s.name}' took {s.iterations} iterations" for s in steps if s.iterations > MANY_ITERATIONS
    )


def state_difference(model: Model, one: Motion, other: Motion) -> float:
    """Largest difference of two states over the size of the mechanism (rotations as they are)."""
    shift = np.abs(one.x - other.x).max(initial=0.0) / model.arrays.size
    return float(max(shift, np.abs(one.R - other.R).max(initial=0.0)))


def confirmed(
    model: Model,
    first: LoadStepResult,
    again: Callable[[int], LoadStepResult],
    arc: Callable[[], PathContinuation],
    reason: str,
) -> LoadStepResult:
    """The state that two rounds of load steps agree on.

    first: how the doubtful round went; again: goes the same way in so many steps; arc: goes it by arc length, which is
    asked last, when smaller steps do not settle it or end in a state that is no minimum.
    """
    solves, taken = first.record.factorisations, first.record.steps_tried
    last, size = first, max(4, int(np.ceil(2.0 / first.record.smallest_step)))
    end, settled, said = max(FINE, 4 * size), False, reason
    while size <= end and not settled:
        fresh = again(size)
        solves, taken = solves + fresh.record.factorisations, taken + fresh.record.steps_tried
        if fresh.record.stop is not Stop.CONVERGED:
            said = f"{reason}, and smaller load steps stop at {100 * fresh.record.fraction_reached:.3g} % of the way"
            break
        same = state_difference(model, fresh.motion, last.motion) < SAME
        settled = same and reason != SADDLE and fresh.record.negatives == len(model.arrays.terms.start)
        last, size = fresh, 2 * size
        if same and not settled:
            break
    how = ", ".join(filter(None, [last.how, f"walked again in smaller steps: {reason}"]))
    found = LoadStepResult(last.record._replace(factorisations=solves, steps_tried=taken), how, last.motion)
    return found if settled else by_arc(found._replace(doubts=(said,)), arc)


def _gone(
    last: LoadStepResult, arc: Callable[[], PathContinuation]
) -> tuple[LoadStepResult, PathContinuation | None]:
    """The path by arc length, None where it does not begin, and `last` with its factorisations."""
    try:
        path = arc()
    except (ConvergenceError, np.linalg.LinAlgError):
        return last, None
    return last._replace(
        record=last.record._replace(factorisations=last.record.factorisations + path.factorisations)
    ), path


def by_arc(last: LoadStepResult, arc: Callable[[], PathContinuation]) -> LoadStepResult:
    """The last resort: what the path followed by arc length says of the state `last` and of what is doubted about it."""
    last, path = _gone(last, arc)
    if path is None:
        return last
    last = last._replace(how=f"{last.how}, then by arc length")
    if path.stop_reason == END_REACHED and not path.singular_points:
        end = path.points[-1]
        return LoadStepResult(last.record._replace(negatives=end.negatives), last.how, end.motion)
    at = f"no end: {path.stop_reason}"
    if path.singular_points:
        turn, more = path.singular_points[0], len(path.singular_points) - 1
        at = f"a {turn.kind} point at {100 * turn.point.f:.3g} % of the way" + f", and {more} more" * (
            more > 0
        )
    return last._replace(doubts=(f"{last.doubts[0]}; the path from its start has {at}",))


def rescued(first: LoadStepResult, arc: Callable[[], PathContinuation]) -> LoadStepResult:
    """Where load steps end before the way does: what the path followed by arc length finds at its end, or why there is
    none. A path that turns on the way is not gone along: the mechanism would snap."""
    first, path = _gone(first, arc)
    if path is None:
        return first
    if path.singular_points:
        turn = path.singular_points[0]
        kind = "turns back at a limit" if turn.kind == "limit" else "branches at a bifurcation"
        said = f"the path from its start {kind} point at {100 * turn.point.f:.3g} % of the way, where the mechanism snaps or"
        return first._replace(
            doubts=(f"{said} buckles; ksd.follow goes along the path, here on {path.model.mesh}",)
        )
    if path.stop_reason != END_REACHED:
        return first
    end = path.points[-1]
    record = first.record._replace(
        stop=Stop.CONVERGED, residual=1.0, negatives=end.negatives, fraction_reached=1.0
    )
    return LoadStepResult(record, ", ".join(filter(None, [first.how, "by arc length"])), end.motion)


def _drive(
    storage: Storage, begin: Motion, way: LoadPath, planar: bool | Literal["auto"], fresh: bool
) -> LoadStepResult:
    """Drive from `begin` in the plane where the scene is planar, else in space. fresh: it is the rest state."""
    why = ""
    if planar is not False:
        plane = plane_of(storage.model)
        found = plane if isinstance(plane, str) else _drive_in_plane(storage, plane, begin, way, fresh)
        if not isinstance(found, str):
            driven, arrived = found
            if planar is True or driven.stop in (Stop.CONVERGED, Stop.LOCAL_ANGLE):
                how = "planar, 3 unknowns per node"
                return LoadStepResult(_counted(storage.model, arrived, driven, way), how, arrived)
            # space has the Newton with pivoting
            found = f"in the plane {driven.stop.sentence}"
        elif planar is True:
            raise SceneError(
                f"planar = True: this mechanism is not planar: {found}; use planar = 'auto' or False"
            )
        why = f"spatial: {found}"
    arrived = begin.copy()
    driven = take_load_steps(
        arrived, storage.newton, way, begin=begin, pivoting=(storage.model.arrays, storage.work)
    )
    return LoadStepResult(_counted(storage.model, arrived, driven, way), why, arrived)


AT_START = 1e-3
"""Share of a way up to which a stop is one of the start."""


@cached_per_model
def _is_held(model: Model) -> bool:
    """Whether all nodes are held in the plane that a mechanism names, on members of constant stiffness, which have nothing
    inside that could leave it."""
    held = {term.link for hold in plane_holds(model.scene) for term in hold.terms}
    return held.issuperset(model.node_names[1:]) and model.kinds <= {LINEAR}


def _drive_in_plane(
    storage: Storage, plane: Plane, begin: Motion, way: LoadPath, fresh: bool
) -> tuple[LoadStepRecord, Motion] | str:
    """`take_load_steps` with three unknowns per node and where it led, or the reason why that is not possible.

    What it arrives at is looked at in space: a residual out of the plane refuses it, and the residual and the negative
    pivots told are those of the spatial tangent, so that buckling out of the plane is seen.
    """
    model, motion, work = storage.model, begin.copy(), storage.planar(plane)
    if not fresh:
        if not plane.holds(begin):
            return "the configuration to start from is not in the plane"
        # forces that only hold the mechanism in its plane
        motion.multiplier[np.setdiff1d(np.arange(len(motion.multiplier)), plane.rows)] = 0.0

    def newton(motion: Motion, values: np.ndarray, factor: float, *bounds: Any) -> Newton:
        found = iterate(plane.arrays, motion, values, factor, work, *bounds)
        if found[0] == CONVERGED and found[4] < WEAK_PIVOT:
            # what nothing holds has converged too, at rest and where no force goes against it
            assemble(plane.arrays, motion, values, factor, work, bounds[0], 0, 0.0)
            return (SINGULAR, *found[1:]) if moves_freely(plane.arrays, work) else found
        return found

    driven = take_load_steps(motion, newton, way, begin=begin)
    if driven.smallest_step < 0.9 / way.steps:
        # a step was cut: what nothing holds at the start swings to and fro where its pivot of zero is rounded up
        assemble(plane.arrays, begin, *way.values_at(driven.smallest_step), work, way.rtol, 0, 0.0)
        if moves_freely(plane.arrays, work):
            return driven._replace(stop=Stop.SINGULAR, fraction_reached=0.0), begin.copy()
    if _is_held(model):
        return driven._replace(negatives=driven.negatives + len(motion.multiplier) - len(plane.rows)), motion
    values, factor = way.values_at(driven.fraction_reached)
    residual, negatives, status = storage.look(motion, values, way.rtol, factor)
    if residual > 1.0:
        share, node, force, moment = plane.imbalance(storage.work)
        if share > 1.0:
            said = (
                f"its leaf springs and loads do not balance out of the plane: {force:.3g} N along its normal and "
                f"{moment:.3g} Nm across it are left on '{model.node_names[node]}'"
            )
            refuse_plane(model, said)
            return said
    if driven.stop is not Stop.CONVERGED:
        return driven, motion
    if residual > max(1.0, 2.0 * driven.residual) or status != 0:
        return "what was found is no equilibrium in space"
    return driven._replace(residual=residual, negatives=negatives), motion


def _counted(model: Model, motion: Motion, driven: LoadStepRecord, way: LoadPath) -> LoadStepRecord:
    """With what stands for negative pivots where loads are not conservative."""
    if driven.stop is not Stop.CONVERGED or model.conservative:
        return driven
    return driven._replace(negatives=counted(model, motion, way.factors[1], driven.negatives))


def solve_by_load_steps(
    storage: Storage, begin: Motion, way: LoadPath, *, fresh: bool, planar: bool | Literal["auto"] = "auto"
) -> LoadStepResult:
    """Go a way from the equilibrium `begin`, confirming what is doubtful. fresh: `begin` is the rest state; planar: as of
    `conventional`.
    """
    model = storage.model
    first = _drive(storage, begin, way, planar, fresh)
    # with eps_max it is the paper's own program, which believes whatever converged
    if way.eps_max < math.inf:
        return first

    def again(size: int) -> LoadStepResult:
        finer = way._replace(steps=size, smallest=min(way.smallest, 0.25 / size))
        return _drive(storage, begin, finer, planar, fresh)

    def arc(turns: float = math.inf) -> PathContinuation:
        low, high = way.factors
        return follow_by_arc_length(
            model, PathParameter(way.start, way.target - way.start, low, high - low), begin, turns=turns
        )

    if first.record.stop is Stop.SINGULAR and first.record.fraction_reached == 0.0:
        # what nothing holds from the start on has no path
        return first
    if first.record.stop is not Stop.CONVERGED:
        return rescued(first, lambda: arc(turns=1))
    reason = doubt(model, first.motion, first.record, way.target, fresh=fresh, steps=way.steps)
    return confirmed(model, first, again, arc, reason) if reason else first


def _rigid_fights(model: Model) -> Iterator[str]:
    """Sentences of the doctor on drives that fight what is rigid as they are, so that no leaf spring can give way."""
    for fight in doctor(model.said or model.scene).fights:
        if fight.what.startswith("drive ") and all(
            o.startswith(("drive ", "support ")) for o in fight.others
        ):
            yield fight.sentence


def as_step(driven: LoadStepRecord, how: str, time: float) -> Step:
    """The record of load steps that took `time` [s]; how: as of `solve_by_load_steps`."""
    note = f"{driven.steps_tried} load step{'s' * (driven.steps_tried != 1)}{', ' * bool(how)}{how}"
    if driven.steps_with_pivoting:
        note += ", with pivoting"
    return Step("equilibrium", driven.factorisations, time, driven.residual, driven.stop, note)


def stop_sentence(model: Model, driven: LoadStepRecord, doubts: tuple[str, ...]) -> str:
    """Where and why load steps stopped, a sentence."""
    why = doubts[0] if doubts else driven.stop.sentence
    if driven.fraction_reached < AT_START:
        why = next(_rigid_fights(model), why)
    return (
        f"the conventional solver stopped at {100 * driven.fraction_reached:.3g} % of the drive motion: {why}"
    )
