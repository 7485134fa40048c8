"""Error of a fast method, by corrector steps of the full model, and differences of two states as errors."""

from __future__ import annotations

import math
from collections.abc import Generator

import numpy as np

from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.newton import check_residual, take_step
from ksd.numerics.stopwatch import Stopwatch
from ksd.solvers.five_steps import FiveStepsStorage
from ksd.solvers.steps import ErrorEstimate, Step, Stop

MAX_ONE_STEP_ERROR = 0.01
"""Relative size of the first corrector step above which further ones are taken: it may be only part of the error."""
MAX_ONE_STEP_ERROR_RELINEARISED = 1e-7
"""The same after relinearisation steps."""
MAX_CONTRACTION = 0.5
"""Size of a step over that of the one before up to which the following steps are assumed to shrink by the same factor."""
MAX_CORRECTOR_STEPS = 5


def estimate_error(
    b: FiveStepsStorage, target: np.ndarray, *, relinearised: bool
) -> tuple[ErrorEstimate, Step, int]:
    """Error estimate of the full state in storage by one Newton step or a few, its step, and its negative pivots.

    relinearised: the joints were condensed anew at the state before, so that the forces have no error of first order and
    one step does not measure it.
    """
    clock = Stopwatch()
    residual, negatives, status = check_residual(b.model.arrays, b.full_state, target, 1.0, b.full_work)
    error, count = newton_step_error(b.model, b.full_state, b.full_work.rhs), 1
    stop = Stop.CONVERGED if status == 0 else (Stop.LOCAL_ANGLE if status == 1 else Stop.NOT_FINITE)
    threshold = MAX_ONE_STEP_ERROR_RELINEARISED if relinearised else MAX_ONE_STEP_ERROR
    if threshold < error.relative < math.inf and _has_moved(b):
        steps = _further_steps(b, target)
        error, count = _extrapolated_error(error, steps)
        steps.close()
    return error, Step("error estimate", count, clock(), residual, stop), negatives


def full_model_negatives(b: FiveStepsStorage, target: np.ndarray) -> int:
    """Negative pivots of the full model at the full state in storage: those of condensed joints miss leaf springs that
    buckle inside a joint, or out of the plane."""
    _, negatives, _ = check_residual(b.model.arrays, b.full_state, target, 1.0, b.full_work)
    return int(negatives)


Corrections = Generator[tuple[ErrorEstimate, ErrorEstimate], None, None]
"""Corrector steps after the first: (the step, the sum of all steps)."""


def _has_moved(b: FiveStepsStorage) -> bool:
    """Whether links have moved from rest by more than rounding."""
    shift = np.abs(b.full_state.x - b.model.rest.x)[: b.model.links]
    return bool(shift.max(initial=0.0) > 1e-9 * b.model.arrays.size)


def _extrapolated_error(first: ErrorEstimate, steps: Corrections) -> tuple[ErrorEstimate, int]:
    """Distance to the limit of the corrector steps, and the number of steps evaluated.

    The limit is extrapolated by a geometric series once steps shrink; the error is unknown where they do not (Deuflhard,
    Newton Methods for Nonlinear Problems, 2.1). A small first step may be followed by a larger one: the force made by
    lateral errors grows with their square.
    """
    last, count = first, 1
    for step, distance in steps:
        count += 1
        contraction = step.relative / max(last.relative, 1e-300)
        reliable = count > 2 or step.relative > MAX_ONE_STEP_ERROR
        if contraction < MAX_CONTRACTION or (reliable and contraction < 1.0):
            return distance.plus(step, contraction / (1.0 - contraction)), count
        if step.relative > MAX_ONE_STEP_ERROR or count == MAX_CORRECTOR_STEPS:
            break
        last = step
    return ErrorEstimate.unknown(len(first.force)), count


def _further_steps(b: FiveStepsStorage, target: np.ndarray) -> Corrections:
    """Newton steps after the one in storage; restores the state in storage when closed."""
    arrays, start, total = b.model.arrays, b.full_state.copy(), b.full_work.rhs.copy()
    try:
        while True:
            take_step(arrays, b.full_state, b.full_work.rhs, b.full_work, 1.0)
            check_residual(arrays, b.full_state, target, 1.0, b.full_work)
            step = b.full_work.rhs
            total += step
            yield (
                newton_step_error(b.model, b.full_state, step),
                newton_step_error(b.model, b.full_state, total),
            )
    finally:
        b.full_state.assign(start)


def newton_step_error(model: Model, motion: State, step: np.ndarray) -> ErrorEstimate:
    """A Newton step (n,) as the error of the state from which it leads."""
    arrays, links = model.arrays, model.links
    force = np.abs(step[arrays.terms.start])
    moves = step[arrays.start[1:links, None] + np.arange(6)]
    shift = math.sqrt(np.square(moves[:, :3]).sum(axis=1).max(initial=0.0))
    turn = math.sqrt(np.square(moves[:, 3:]).sum(axis=1).max(initial=0.0))
    return _relative_to_state(model, motion, force[: len(model.drive_names)], shift, turn)


def _relative_to_state(
    model: Model, motion: State, force: np.ndarray, shift: float, turn: float
) -> ErrorEstimate:
    """Error estimate with absolute errors made relative: by the drive forces, and by the largest link displacement."""
    links = model.links
    moved = float(np.abs(motion.x[:links] - model.rest.x[:links]).max())
    errors, scales = force.tolist(), [abs(m) for m in motion.multiplier.tolist()[: len(force)]]
    largest = max(scales, default=0.0)
    # nan must not be lost: it is not a small error
    ratios = [e / max(s, largest, 1e-300) for e, s in zip(errors, scales, strict=True)]
    ratios.append(shift / max(moved, 1e-300))
    relative = math.nan if any(math.isnan(r) for r in ratios) else max(ratios)
    return ErrorEstimate(force.copy(), shift, turn, relative if math.isfinite(relative) else math.inf)


def error_to_stored_state(motion: State, b: FiveStepsStorage, stored: ErrorEstimate) -> ErrorEstimate:
    """Distance of a state to the full state in storage, plus the error estimate `stored` of the latter."""
    force, shift, turn = _difference(b.model, motion, b.full_state)
    return _relative_to_state(
        b.model, motion, force + stored.force, shift + stored.displacement, turn + stored.rotation
    )


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
