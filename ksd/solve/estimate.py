"""What a fast answer says of its own error: corrector steps of the full model, looked at and not taken."""

from __future__ import annotations

import math
from collections.abc import Generator
from typing import NamedTuple

import numpy as np

from ksd.model.arrays import Motion
from ksd.model.planar_arrays import PlanarMotion
from ksd.model.system import take_step
from ksd.numerics.stopwatch import thread_ns
from ksd.solve.driving import RTOL
from ksd.solve.pipeline import Bench
from ksd.solve.steps import ErrorEstimate, Step
from ksd.solve.stops import Stop
from ksd.solve.storage import FlatStorage

COARSE = 0.01
"""Estimated relative error from which a second corrector step tells whether the first was nearly all."""
NEGLIGIBLE = 1e-7
"""The same of relinearised answers."""
HALF = 0.5
"""Size of a step over that of the one before from which it is believed that the next ones shrink alike."""
MOST = 5
"""Corrector steps at most."""


def estimate_error(
    b: Bench, target: np.ndarray, flat: FlatStorage | None = None, *, relinearised: bool = False
) -> tuple[ErrorEstimate, Step, int]:
    """Error estimate and inertia of the full state on the bench from a Newton step in space, or a few; flat: the same state
    in its plane, where it has one, from which both are seen where that is its mirror.

    relinearised: joints were condensed anew at the state before, so that what is linear in the error is gone from the
    forces, and one step is not nearly all.
    """
    begin = thread_ns()
    seen = None if flat is None else _from_plane(b, target, flat)
    if seen is None or flat is None or seen.sound < 2 or seen.negatives != len(target):
        residual, negatives, status = b.storage.look(target, RTOL, step=2 if flat is None else 1)
        error = _size_of_step(b)
        if (
            seen is not None
            and flat is not None
            and seen.sound
            and seen.negatives == negatives == len(target)
        ):
            flat.note()
    else:
        error, residual, negatives, status = seen[:4]
    stop = Stop.CONVERGED if status == 0 else (Stop.LOCAL_ANGLE if status == 1 else Stop.NOT_FINITE)
    count = 1
    if (NEGLIGIBLE if relinearised else COARSE) < error.relative < math.inf and _moved(b):
        steps = _steps_in_space(b, target) if flat is None else _steps_in_plane(b, target, flat)
        error, count = _followed(error, steps)
        steps.close()
    return error, Step("error estimate", count, 1e-9 * (thread_ns() - begin), residual, stop), negatives


Steps = Generator[tuple[ErrorEstimate, ErrorEstimate], None, None]
"""Corrector steps after the first, each with the distance gone with it."""


class _Seen(NamedTuple):
    """What a Newton step in the plane says: error, residual over its bound, negative pivots, status; sound: see
    `ksd.solve.planar.step_in_plane`."""

    error: ErrorEstimate
    residual: float
    negatives: int
    status: int
    sound: int


def _from_plane(b: Bench, target: np.ndarray, flat: FlatStorage) -> _Seen | None:
    """The Newton step seen from the plane; None where that is not the mirror of the mechanism."""
    if not flat.mirror:
        return None
    rows, force = flat.plane.lifting.row, np.empty(len(target))
    (moved, shift, turn, residual), *counted = flat.step(target[rows], b.model.links, RTOL, force)
    drives = len(b.model.drive_names)
    return _Seen(_over(b.full.multiplier, force[:drives], moved, shift, turn), residual, *counted)


def _moved(b: Bench) -> bool:
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


def _steps_in_space(b: Bench, target: np.ndarray) -> Steps:
    """Newton steps after the one in storage, each with the distance gone with it; the state on the bench is put back."""
    kept = b.full.copy()
    nothing = ErrorEstimate(np.zeros(len(b.model.drive_names)), 0.0, 0.0, 0.0)
    try:
        take_step(b.model.arrays, b.full, b.full_work.rhs, b.full_work, 1.0)
        while True:
            b.storage.look(target, RTOL, step=2)
            step = _size_of_step(b)
            take_step(b.model.arrays, b.full, b.full_work.rhs, b.full_work, 1.0)
            yield step, distance(kept, b, nothing)
    finally:
        b.full.assign(kept)


def _steps_in_plane(b: Bench, target: np.ndarray, flat: FlatStorage) -> Steps:
    """As `_steps_in_space`, of the planar state, whose steps are those in space."""
    kept, aim = flat.motion.copy(), target[flat.plane.lifting.row]
    one = (1.0, RTOL, 1, math.inf, math.inf)
    try:
        flat.newton(aim, *one)
        while True:
            before = flat.motion.copy()
            flat.newton(aim, *one)
            yield _between(b, flat, before), _between(b, flat, kept)
    finally:
        flat.motion.assign(kept)


def _between(b: Bench, flat: FlatStorage, before: PlanarMotion) -> ErrorEstimate:
    """The way from a planar state to the one in storage as an error of the former."""
    moves = np.abs(flat.motion.pose - before.pose)[: b.model.links]
    force = np.zeros(len(b.model.drive_names) + len(b.model.support_names))
    force[flat.plane.lifting.row] = np.abs(flat.motion.multiplier - before.multiplier)
    shift, turn = np.hypot(moves[:, 0], moves[:, 1]).max(), moves[:, 2].max()
    return _made_relative(b, b.full, force[: len(b.model.drive_names)], float(shift), float(turn))


def _size_of_step(b: Bench) -> ErrorEstimate:
    """The Newton step of the full model in storage as an error of the state on the bench."""
    arrays, links = b.model.arrays, b.model.links
    step = b.full_work.rhs
    force = np.abs(step[arrays.terms.start])
    moves = step[arrays.start[1:links, None] + np.arange(6)]
    shift = math.sqrt(np.square(moves[:, :3]).sum(axis=1).max(initial=0.0))
    turn = math.sqrt(np.square(moves[:, 3:]).sum(axis=1).max(initial=0.0))
    return _made_relative(b, b.full, force[: len(b.model.drive_names)], shift, turn)


def _made_relative(b: Bench, motion: Motion, force: np.ndarray, shift: float, turn: float) -> ErrorEstimate:
    """Absolute errors made relative: drive forces by their size, displacement by the largest link displacement."""
    links = b.model.links
    moved = float(np.abs(motion.x[:links] - b.model.rest.x[:links]).max())
    return _over(motion.multiplier, force, moved, shift, turn)


def _over(
    multiplier: np.ndarray, force: np.ndarray, moved: float, shift: float, turn: float
) -> ErrorEstimate:
    """The same with the largest link displacement `moved`."""
    errors, scales = force.tolist(), [abs(m) for m in multiplier.tolist()[: len(force)]]
    largest = max(scales, default=0.0)
    # a number that is none stays: it is no small error
    ratios = [e / max(s, largest, 1e-300) for e, s in zip(errors, scales, strict=True)]
    ratios.append(shift / max(moved, 1e-300))
    relative = math.nan if any(r != r for r in ratios) else max(ratios)
    return ErrorEstimate(force.copy(), shift, turn, relative if math.isfinite(relative) else math.inf)


def distance(motion: Motion, b: Bench, rest: ErrorEstimate) -> ErrorEstimate:
    """Distance of a state to the one on the bench, plus the estimate `rest` of the latter's own error."""
    from scipy.spatial.transform import Rotation

    links, drives = b.model.links, len(b.model.drive_names)
    force = np.abs(motion.multiplier[:drives] - b.full.multiplier[:drives]) + rest.force
    shift = float(np.linalg.norm(motion.x[:links] - b.full.x[:links], axis=1).max()) + rest.displacement
    between = np.einsum("kij,klj->kil", motion.R[:links], b.full.R[:links])
    turn = float(Rotation.from_matrix(between).magnitude().max()) + rest.rotation
    return _made_relative(b, motion, force, shift, turn)
