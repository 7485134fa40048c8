"""Load steps from a given state: in the plane where the scene is planar, else in space.

The whole load path is tried as one step first, and steps are halved on failure (`take_load_steps`). Whether the state
reached is on the intended branch is checked by `ksd.solvers.branch_check`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Any, Literal, NamedTuple

import numpy as np

from ksd.answers.derived import cached_per_model
from ksd.answers.divergence import count_unstable_directions
from ksd.answers.doctor import doctor
from ksd.errors import SceneError
from ksd.model.arrays import LINEAR, Arrays, State, Workspace
from ksd.model.compile import Model
from ksd.model.newton import (
    CONVERGED,
    RTOL,
    SINGULAR,
    NewtonResult,
    assemble,
    check_residual,
    solve_equilibrium,
)
from ksd.model.plane import Plane
from ksd.model.turns import relative_angles
from ksd.scene.hinges import plane_supports
from ksd.solvers.pivoted_newton import WEAK_PIVOT, iterate_pivoted, moves_freely
from ksd.solvers.steps import MAX_TURN_PER_STEP, Step, Stop
from ksd.solvers.storage import NewtonStorage

EASY_ITERATIONS = 5
"""Iterations of a step up to which no part has swung round, and after which a halved step is doubled."""
SAME_STATE_TOLERANCE = 1e-6
"""Largest difference of two equal states, see `state_difference`."""
START_FRACTION = 1e-3
"""Fraction of the load path up to which a solve counts as stopped at its start."""


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


Stepping = Callable[[Model, Arrays, State, Workspace, "LoadPath"], LoadStepRecord]
"""Takes the steps of a path on a model with its arrays in space or in its plane; the state, given at the start, ends at the
last equilibrium."""


class LoadStepResult(NamedTuple):
    """Outcome of load steps, how they were taken (in words), the state they ended in, and the doubts that remain."""

    record: LoadStepRecord
    how: str
    motion: State
    doubts: tuple[str, ...] = ()


class LoadPath(NamedTuple):
    """Drive values from `start` to `target` (c,), loads between two factors, and the settings of load steps.

    steps: number of equal steps tried first; rtol, max_iterations, max_turn, eps_max: of every Newton solve, see
    `ksd.model.newton.solve_equilibrium`; smallest_step: fraction of the path below which steps are not halved any more. A
    path by arc length has no use for these settings; its fraction may leave the range from 0 to 1.
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


def largest_turn(arrays: Arrays, one: State, other: State) -> float:
    """Largest difference [rad] of a counted angle of two states."""
    change = relative_angles(arrays, one) - relative_angles(arrays, other)
    return max(map(abs, change.tolist()), default=0.0)


def state_difference(model: Model, one: State, other: State) -> float:
    """Largest difference of two states: positions over the size of the mechanism, rotation matrices, and counted angles."""
    shift = np.abs(one.x - other.x).max(initial=0.0) / model.arrays.size
    return float(max(shift, np.abs(one.R - other.R).max(initial=0.0), largest_turn(model.arrays, one, other)))


def take_load_steps(
    motion: State,
    newton: Callable[..., NewtonResult],
    path: LoadPath,
    *,
    begin: State | None = None,
    pivoting: tuple[Arrays, Workspace] | None = None,
) -> LoadStepRecord:
    """Take load steps along a path, halving them on failure and doubling them again where they are easy, but with eps_max,
    the paper's own program; `motion` ends at the last equilibrium.

    newton: brings a state to equilibrium in place, as `ksd.solvers.storage.NewtonStorage.newton`. begin: a copy of the state
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
            if count <= EASY_ITERATIONS and path.eps_max == math.inf:
                size = min(2.0 * size, 1.0 / path.steps)
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
    return reason == Stop.SINGULAR or pivot < WEAK_PIVOT or (failed and not arrays.conservative)


def take_path(
    storage: NewtonStorage,
    begin: State,
    path: LoadPath,
    planar: bool | Literal["auto"],
    from_rest: bool,
    *,
    stepping: Stepping | None = None,
) -> LoadStepResult:
    """Take load steps from `begin`, in the plane where the scene is planar, else in space.

    stepping: another way to take the steps than `take_load_steps`.
    """
    reason = ""
    if planar is not False:
        plane = storage.model.plane
        found = (
            plane
            if isinstance(plane, str)
            else _take_path_in_plane(storage, plane, begin, path, from_rest, stepping)
        )
        if not isinstance(found, str):
            record, motion = found
            # a way that is only tried has no second try in space
            tried = stepping is not None or path.smallest_step >= 1.0 / path.steps
            if planar is True or tried or record.stop in (Stop.CONVERGED, Stop.LOCAL_ANGLE):
                how = "planar, 3 unknowns per node"
                return LoadStepResult(_with_divergences(storage.model, motion, record, path), how, motion)
            # in space there is the Newton with pivoting
            found = f"in the plane {record.stop.sentence}"
        elif planar is True:
            raise SceneError(
                f"planar = True: this mechanism is not planar: {found}; use planar = 'auto' or False"
            )
        reason = f"spatial: {found}"
    motion, arrays = begin.copy(), storage.model.arrays
    if stepping is not None:
        record = stepping(storage.model, arrays, motion, storage.work, path)
    else:
        record = take_load_steps(motion, storage.newton, path, begin=begin, pivoting=(arrays, storage.work))
    return LoadStepResult(_with_divergences(storage.model, motion, record, path), reason, motion)


@cached_per_model
def _cannot_leave_plane(model: Model) -> bool:
    """Whether the plane that a mechanism names holds all its nodes, and its members have constant stiffness, so that nothing
    inside them could leave the plane."""
    held_links = {term.link for hold in plane_supports(model.scene) for term in hold.terms}
    return held_links.issuperset(model.node_names[1:]) and model.kinds <= {LINEAR}


def _take_path_in_plane(
    storage: NewtonStorage,
    plane: Plane,
    begin: State,
    path: LoadPath,
    from_rest: bool,
    stepping: Stepping | None,
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
            assemble(plane.arrays, motion, values, factor, work, settings[0], rounding=0.0)
            return (SINGULAR, *found[1:]) if moves_freely(plane.arrays, work) else found
        return found

    if stepping is not None:
        record = stepping(model, plane.arrays, motion, work, path)
    else:
        record = take_load_steps(motion, newton, path, begin=begin)
    halved = record.smallest_step < 0.9 / path.steps
    if stepping is None and (halved or record.most_iterations > EASY_ITERATIONS):
        # a part that nothing holds at the start swings round where its pivot of zero is rounded up
        assemble(plane.arrays, begin, *path.values_at(record.smallest_step), work, path.rtol, rounding=0.0)
        if moves_freely(plane.arrays, work):
            return record._replace(stop=Stop.SINGULAR, fraction_reached=0.0), begin.copy()
    if _cannot_leave_plane(model):
        return record._replace(negatives=record.negatives + len(motion.multiplier) - len(plane.rows)), motion
    values, factor = path.values_at(record.fraction_reached)
    residual, negatives, status = check_residual(
        model.arrays, motion, values, factor, storage.work, path.rtol
    )
    if residual > 1.0:
        share, node, force, moment = plane.imbalance(storage.work)
        if share > 1.0:
            reason = (
                f"its leaf springs and loads do not balance out of the plane: {force:.3g} N along its normal and "
                f"{moment:.3g} Nm across it are left on '{model.node_names[node]}'"
            )
            model.refuse_plane(reason)
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


def _rigid_conflicts(model: Model) -> Iterator[str]:
    """Sentences of the doctor on drives that contradict rigid parts alone, or that start in a singular position."""
    for redundant in doctor(model.original_scene).redundant:
        prescribed = (name.startswith(("drive ", "support ")) for name in redundant.others)
        if redundant.what.startswith("drive ") and (redundant.free or all(prescribed)):
            yield redundant.sentence


def as_step(record: LoadStepRecord, how: str, time: float, chosen: str = "") -> Step:
    """Load steps that took `time` [s] as one step of a solve; how: see `LoadStepResult`, chosen: see `Step`."""
    note = f"{record.steps_tried} load step{'s' * (record.steps_tried != 1)}{', ' * bool(how)}{how}"
    if record.steps_with_pivoting:
        note += ", with pivoting"
    return Step("equilibrium", record.factorisations, time, record.residual, record.stop, note, chosen)


def stop_sentence(model: Model, record: LoadStepRecord, doubts: tuple[str, ...]) -> str:
    """Where and why load steps stopped, as a sentence."""
    reason = doubts[0] if doubts else record.stop.sentence
    if record.fraction_reached < START_FRACTION:
        reason = next(_rigid_conflicts(model), reason)
    return f"the conventional solver stopped at {100 * record.fraction_reached:.3g} % of the drive motion: {reason}"
