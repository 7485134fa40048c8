"""How far states are from each other, and what a fast answer says of its own error: corrector steps of the full model."""

from __future__ import annotations

import math
from collections.abc import Generator

import numpy as np
from scipy.spatial.transform import Rotation

from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.newton import check_residual, take_step
from ksd.numerics.stopwatch import Stopwatch
from ksd.solve.five_steps import FiveStepsStorage
from ksd.solve.steps import RTOL, ErrorEstimate, Step, Stop

COARSE = 0.01
"""Estimated relative error from which a second corrector step tells whether the first was nearly all."""
NEGLIGIBLE = 1e-7
"""The same of relinearised answers."""
HALF = 0.5
"""Size of a step over that of the one before from which it is believed that the next ones shrink alike."""
MOST = 5
"""Corrector steps at most."""


def estimate_error(
    b: FiveStepsStorage, target: np.ndarray, *, relinearised: bool
) -> tuple[ErrorEstimate, Step, int]:
    """Error estimate and inertia of the full state in storage from a Newton step, or a few.

    relinearised: joints were condensed anew at the state before, so that what is linear in the error is gone from the
    forces, and one step is not nearly all.
    """
    clock = Stopwatch()
    residual, negatives, status = check_residual(b.model.arrays, b.full, target, 1.0, b.full_work, RTOL)
    error, count = newton_step_error(b.model, b.full, b.full_work.rhs), 1
    stop = Stop.CONVERGED if status == 0 else (Stop.LOCAL_ANGLE if status == 1 else Stop.NOT_FINITE)
    if (NEGLIGIBLE if relinearised else COARSE) < error.relative < math.inf and _moved(b):
        steps = _later_steps(b, target)
        error, count = _followed(error, steps)
        steps.close()
    return (
        error,
        Step("error estimate", count, clock(), residual, stop),
        negatives,
    )


Steps = Generator[tuple[ErrorEstimate, ErrorEstimate], None, None]
"""Corrector steps after the first, each with the distance gone with it."""


def _moved(b: FiveStepsStorage) -> bool:
    """Whether links are elsewhere than at rest, but for rounding."""
    off = np.abs(b.full.x - b.model.rest.x)[: b.model.links]
    return bool(off.max(initial=0.0) > 1e-9 * b.model.arrays.size)


def _followed(first: ErrorEstimate, steps: Steps) -> tuple[ErrorEstimate, int]:
    """How far Newton steps lead, and how many were looked at: the distance gone plus what is left of a geometric series
    when the next steps shrink as the last one did; without bound where they hardly shrink (Deuflhard, Newton Methods for
    Nonlinear Problems, 2.1). steps: (step, distance gone so far) of the second and later ones.

    A small first step may be followed by a larger one: the force that lateral errors make grows with their square.
    """
    last, count = first, 1
    for step, gone in steps:
        count += 1
        shrinks = step.relative / max(last.relative, 1e-300)
        settled = count > 2 or step.relative > COARSE
        if shrinks < HALF or (settled and shrinks < 1.0):
            return _sum(gone, step, shrinks / (1.0 - shrinks)), count
        if step.relative > COARSE or count == MOST:
            break
        last = step
    return ErrorEstimate(np.full_like(first.force, math.inf), math.inf, math.inf, math.inf), count


def _sum(one: ErrorEstimate, other: ErrorEstimate, share: float) -> ErrorEstimate:
    """An estimate and a share of another."""
    return ErrorEstimate(
        one.force + share * other.force, one.displacement + share * other.displacement,
        one.rotation + share * other.rotation, one.relative + share * other.relative,
    )  # fmt: skip


def _later_steps(b: FiveStepsStorage, target: np.ndarray) -> Steps:
    """Newton steps after the one in storage, each with the distance gone with it; the state in storage is put back."""
    kept = b.full.copy()
    nothing = ErrorEstimate(np.zeros(len(b.model.drive_names)), 0.0, 0.0, 0.0)
    try:
        take_step(b.model.arrays, b.full, b.full_work.rhs, b.full_work, 1.0)
        while True:
            check_residual(b.model.arrays, b.full, target, 1.0, b.full_work, RTOL)
            step = newton_step_error(b.model, b.full, b.full_work.rhs)
            take_step(b.model.arrays, b.full, b.full_work.rhs, b.full_work, 1.0)
            yield step, error_to_stored_state(kept, b, nothing)
    finally:
        b.full.assign(kept)


def newton_step_error(model: Model, motion: State, step: np.ndarray) -> ErrorEstimate:
    """A Newton step (n,) as an error of the state it is to be taken from."""
    arrays, links = model.arrays, model.links
    force = np.abs(step[arrays.terms.start])
    moves = step[arrays.start[1:links, None] + np.arange(6)]
    shift = math.sqrt(np.square(moves[:, :3]).sum(axis=1).max(initial=0.0))
    turn = math.sqrt(np.square(moves[:, 3:]).sum(axis=1).max(initial=0.0))
    return _made_relative(model, motion, force[: len(model.drive_names)], shift, turn)


def _made_relative(
    model: Model, motion: State, force: np.ndarray, shift: float, turn: float
) -> ErrorEstimate:
    """Absolute errors made relative: drive forces by their size, displacement by the largest link displacement."""
    links = model.links
    moved = float(np.abs(motion.x[:links] - model.rest.x[:links]).max())
    errors, scales = force.tolist(), [abs(m) for m in motion.multiplier.tolist()[: len(force)]]
    largest = max(scales, default=0.0)
    # a number that is none stays: it is no small error
    ratios = [e / max(s, largest, 1e-300) for e, s in zip(errors, scales, strict=True)]
    ratios.append(shift / max(moved, 1e-300))
    relative = math.nan if any(r != r for r in ratios) else max(ratios)
    return ErrorEstimate(force.copy(), shift, turn, relative if math.isfinite(relative) else math.inf)


def error_to_stored_state(motion: State, b: FiveStepsStorage, rest: ErrorEstimate) -> ErrorEstimate:
    """Distance of a state to the one in storage, plus the estimate `rest` of the latter's own error."""
    force, shift, turn = _difference(b.model, motion, b.full)
    return _made_relative(
        b.model, motion, force + rest.force, shift + rest.displacement, turn + rest.rotation
    )


def relative_error(model: Model, motion: State, truth: State) -> ErrorEstimate:
    """Difference of a state to the true one, relative to that: forces by the largest, displacement by the largest of a link.
    Rounding is none."""
    links, drives = model.links, len(model.drive_names)
    force, shift, turn = _difference(model, motion, truth)
    grain = 1e-11 * model.arrays.size
    moved = grain + float(np.linalg.norm(truth.x[:links] - model.rest.x[:links], axis=1).max())
    stiffest = np.max(
        [*model.arrays.members.stiffness_scale, *model.arrays.springs.stiffness_scale], initial=1e-300
    )
    scale = np.abs(truth.multiplier[:drives]) + grain * stiffest * min(1.0, model.arrays.size)
    of_force = float((force / np.maximum(scale, scale.max(initial=0.0))).max(initial=0.0))
    relative = max(of_force, shift / moved)
    return ErrorEstimate(force, shift, turn, relative if math.isfinite(relative) else math.inf)


def _difference(model: Model, one: State, other: State) -> tuple[np.ndarray, float, float]:
    """Differences of the drive forces (d,), and the largest of the places [m] and rotations [rad] of the links."""
    links, drives = model.links, len(model.drive_names)
    force = np.abs(one.multiplier[:drives] - other.multiplier[:drives])
    shift = float(np.linalg.norm(one.x[:links] - other.x[:links], axis=1).max())
    between = np.einsum("kij,klj->kil", other.R[:links], one.R[:links])
    return force, shift, float(Rotation.from_matrix(between).magnitude().max())
