"""Error of a fast method, by Newton steps of the full model that are taken, and differences of two states as errors."""

from __future__ import annotations

import math

import numpy as np

from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.newton import check_residual, take_step
from ksd.numerics.kernel import kernel
from ksd.numerics.stopwatch import Stopwatch
from ksd.solvers.five_steps import FiveStepsStorage, full_equilibrium_step
from ksd.solvers.steps import ErrorEstimate, Step, Stop

MAX_ONE_STEP_ERROR = 0.01
"""Relative size of the first Newton step up to which it alone tells the error: a larger one may be only part of it."""
MAX_ONE_STEP_ERROR_RELINEARISED = 1e-7
"""The same after relinearisation steps."""


def correct(
    b: FiveStepsStorage, target: np.ndarray, *, accuracy: float
) -> tuple[ErrorEstimate, list[Step], int]:
    """Take the Newton step of the full model that tells the error of the state of the condensed joints in storage, in place;
    where it is larger than `accuracy`, further ones to equilibrium.

    Returns the error, the steps taken, and the negative pivots. The error is the size of the one step, which is that of the
    state before it: the state after it is better. At equilibrium it is 0. Where the step is not finite, or the further ones
    end at no equilibrium, the state is left as it was, with an unknown error.
    """
    clock = Stopwatch()
    residual, negatives, status = check_residual(b.model.arrays, b.full_state, target, 1.0, b.full_work)
    error = newton_step_error(b.model, b.full_state, b.full_work.rhs)
    stop = Stop.CONVERGED if status == 0 else (Stop.LOCAL_ANGLE if status == 1 else Stop.NOT_FINITE)
    step = Step("error estimate", 1, 0.0, residual, stop)
    if stop is not Stop.CONVERGED or not math.isfinite(b.full_work.rhs @ b.full_work.rhs):
        return error, [step._replace(time=clock())], negatives
    is_enough = error.relative <= accuracy or not _has_moved(b)
    before = b.full_state if is_enough else b.full_state.copy()
    take_step(b.model.arrays, b.full_state, b.full_work.rhs, b.full_work, 1.0)
    if is_enough:
        return error, [step._replace(time=clock(), note="its step is taken: better than told")], negatives
    step = step._replace(time=clock(), note="its step is taken, and goes on")
    last, pivots = full_equilibrium_step(b, target)
    if last.stop is not Stop.CONVERGED:
        b.full_state.assign(before)
        count = 1 + last.iterations
        failed = f"no equilibrium next to this state: {last.stop.sentence}"
        step = step._replace(iterations=count, time=step.time + clock(), note=failed)
        return ErrorEstimate.unknown(len(error.force)), [step], negatives
    exact = ErrorEstimate(np.zeros(len(error.force)), 0.0, 0.0, 0.0)
    return exact, [step, last._replace(time=clock())], pivots


def full_model_negatives(b: FiveStepsStorage, target: np.ndarray) -> int:
    """Negative pivots of the full model at the full state in storage: those of condensed joints miss leaf springs that
    buckle inside a joint, or out of the plane."""
    _, negatives, _ = check_residual(b.model.arrays, b.full_state, target, 1.0, b.full_work)
    return int(negatives)


def _has_moved(b: FiveStepsStorage) -> bool:
    """Whether links have moved from rest by more than rounding."""
    shift = np.abs(b.full_state.x - b.model.rest.x)[: b.model.links]
    return bool(shift.max(initial=0.0) > 1e-9 * b.model.arrays.size)


def newton_step_error(model: Model, motion: State, step: np.ndarray) -> ErrorEstimate:
    """A Newton step (n,) as the error of the state from which it leads."""
    arrays, force = model.arrays, np.empty(len(model.drive_names))
    sizes = _step_sizes(
        model.links, arrays.start, arrays.terms.start, step, motion.x, model.rest.x, motion.multiplier, force
    )
    return ErrorEstimate(force, *sizes)


@kernel
def _step_sizes(
    links: int, start: np.ndarray, row: np.ndarray, step: np.ndarray, x: np.ndarray, rest: np.ndarray,
    multiplier: np.ndarray, force: np.ndarray,
) -> tuple[float, float, float]:  # fmt: skip
    """Write the errors of the drive forces into force (d,), and return those of displacement, rotation, and relative to the
    state, inf where it is not finite: see `ErrorEstimate`.

    start (k,), row (c,): unknowns of nodes and multipliers in the step (n,); x, rest (k, 3): places now and at rest.
    """
    shift, turn, moved, error, largest, total = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(1, links):
        u, square, angle = start[k], 0.0, 0.0
        for r in range(3):
            square += step[u + r] ** 2
            angle += step[u + 3 + r] ** 2
            moved = max(moved, abs(x[k, r] - rest[k, r]))
        shift, turn, total = max(shift, square), max(turn, angle), total + square + angle
    for i in range(len(force)):
        force[i] = abs(step[row[i]])
        error, largest, total = max(error, force[i]), max(largest, abs(multiplier[i])), total + force[i]
    shift, turn = math.sqrt(shift), math.sqrt(turn)
    relative = max(error / max(largest, 1e-300), shift / max(moved, 1e-300))
    # the sum, because the largest of some numbers may lose nan, which is not a small error
    return shift, turn, relative if math.isfinite(total) else math.inf


def error_to_stored_state(motion: State, b: FiveStepsStorage, stored: ErrorEstimate) -> ErrorEstimate:
    """Distance of a state to the full state in storage, plus the error estimate `stored` of the latter."""
    force, shift, turn = _difference(b.model, motion, b.full_state)
    force, shift, turn = force + stored.force, shift + stored.displacement, turn + stored.rotation
    moved = float(np.abs(motion.x - b.model.rest.x)[: b.model.links].max())
    largest = float(np.abs(motion.multiplier[: len(force)]).max(initial=0.0))
    relative = max(float(force.max(initial=0.0)) / max(largest, 1e-300), shift / max(moved, 1e-300))
    is_known = math.isfinite(float(force.sum()) + shift)
    return ErrorEstimate(force, shift, turn, relative if is_known else math.inf)


def relative_error(model: Model, motion: State, exact: State) -> ErrorEstimate:
    """Difference of a state to the exact one, relative to the largest force and link displacement of that; differences of
    the size of rounding count as none."""
    links, drives = model.links, len(model.drive_names)
    force, shift, turn = _difference(model, motion, exact)
    rounding = 1e-11 * model.arrays.size
    moved = rounding + float(np.linalg.norm(exact.x[:links] - model.rest.x[:links], axis=1).max())
    stiffest = np.max(
        [*model.arrays.members.stiffness_scale, *model.arrays.springs.stiffness_scale], initial=1e-300
    )
    scale = np.abs(exact.multiplier[:drives]) + rounding * stiffest * min(1.0, model.arrays.size)
    of_force = float((force / np.maximum(scale, scale.max(initial=0.0))).max(initial=0.0))
    relative = max(of_force, shift / moved)
    return ErrorEstimate(force, shift, turn, relative if math.isfinite(relative) else math.inf)


def _difference(model: Model, one: State, other: State) -> tuple[np.ndarray, float, float]:
    """Differences of the drive forces (d,), and the largest difference of link positions [m] and rotations [rad]."""
    links, drives = model.links, len(model.drive_names)
    force = np.abs(one.multiplier[:drives] - other.multiplier[:drives])
    return force, *one.largest_move(other, links)
