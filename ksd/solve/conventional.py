"""The conventional solver: equilibrium of all nodes in load steps from the undeformed state (paper 1, Appendix B).

The whole step is tried first and halved on failure. Newton with mixed integration points (MIP) is the default, plain
Newton with the paper's eps_max an option of the mesh and of the call; it is the baseline of every speed claim.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from typing import Any, Literal, NamedTuple

import numpy as np

from ksd.errors import ConvergenceError, SceneError
from ksd.model.arrays import Arrays, Motion, Work, make_work
from ksd.model.compile import Model
from ksd.numerics.kernel import second_compiler_runs
from ksd.solve.configuration import Configuration, Step
from ksd.solve.newton import iterate
from ksd.solve.stops import Stop

RTOL = 1e-8
"""Residual of a node over the sum of the element forces on it (design section 5)."""
CAP = 0.3
"""Largest rotation [rad] of a node in one iteration after the predictor."""
WEAK_PIVOT = 1e-9
"""Relative pivot below which a load step is done again, or its inertia counted again, with pivoting."""


class Driven(NamedTuple):
    """How driving went: why it stopped, matrix solves including failed attempts, residual over its bound, negative
    pivots, fraction of the drive motion reached, load steps tried, load steps that needed pivoting, most iterations of a
    load step."""

    stop: Stop
    solves: int
    residual: float
    negatives: int
    reached: float
    taken: int
    pivoted: int = 0
    longest: int = 0


def drive_to(
    arrays: Arrays,
    motion: Any,
    work: Work,
    *,
    start: np.ndarray,
    target: np.ndarray,
    factors: tuple[float, float] = (1.0, 1.0),
    steps: int = 1,
    rtol: float = RTOL,
    most: int = 30,
    cap: float = CAP,
    eps_max: float = math.inf,
    smallest: float = 1e-4,
    newton: Callable[..., tuple[int, int, float, int, float]] = iterate,
) -> Driven:
    """Move the drives from `start` to `target` (c,), halving on failure; `motion` ends at the last equilibrium.

    newton: the compiled Newton that fits `arrays` and `motion` (spatial, or planar), called as `iterate` is.
    """
    done, size, solves, taken, pivoted, longest = 0.0, 1.0 / steps, 0, 0, 0, 0
    residual, negatives = math.inf, 0
    safe = motion.copy()
    while done < 1.0:
        # land on the end exactly, whatever the rounding of the steps
        goal = 1.0 if done + size > 1.0 - 1e-9 else done + size
        level = factors[0] + goal * (factors[1] - factors[0])
        want = start + goal * (target - start)
        aim = (want, level, work, rtol, most, cap, eps_max)
        reason, count, residual, negatives, pivot = newton(arrays, motion, *aim)
        solves += count
        taken += 1
        if newton is iterate and _weak(arrays, reason, pivot):
            again = _with_pivoting(arrays, motion, safe, aim, reason)
            reason, count, residual, negatives, _ = again
            solves, pivoted = solves + count, pivoted + 1
        if reason == Stop.CONVERGED:
            done, longest = goal, max(longest, count)
            safe.assign(motion)
            continue
        motion.assign(safe)
        size *= 0.5
        if size < smallest:
            return Driven(Stop(reason), solves, residual, negatives, done, taken, pivoted, longest)
    return Driven(Stop.CONVERGED, solves, residual, negatives, 1.0, taken, pivoted, longest)


def _weak(arrays: Arrays, reason: int, pivot: float) -> bool:
    """Whether pivoting may do better: a pivot of rounding, or a following load whose symmetric tangent failed."""
    failed = reason != Stop.CONVERGED
    return (
        reason == Stop.SINGULAR or pivot < WEAK_PIVOT or (failed and bool(np.any(arrays.loads.following == 1)))
    )


def _with_pivoting(
    arrays: Arrays, motion: Motion, safe: Motion, aim: tuple, reason: int
) -> tuple[int, int, float, int, float]:
    """The load step again with pivoting, from `safe`; a step that converged is only looked over (no iteration)."""
    # here, so that a scene without weak pivots never imports it
    from ksd.solve.pivoted import iterate_pivoted

    if reason != Stop.CONVERGED:
        motion.assign(safe)
    return iterate_pivoted(arrays, motion, *aim)


def _drive(
    model: Model, motion: Motion, work: Work, *, planar: bool | Literal["auto"], fresh: bool, **ways: Any
) -> tuple[Driven, str]:
    """Drive in the plane where the scene is planar, else in space; says which. fresh: motion is the rest state."""
    found: Driven | str = ""
    if planar is not False:
        # here, so that a scene solved in space never compiles the planar kernels
        from ksd.solve.planar import drive_in_plane

        found = drive_in_plane(model, motion, work, fresh=fresh, **ways)
        if not isinstance(found, str):
            return found, "planar, 3 unknowns per node"
        if planar is True:
            raise SceneError(
                f"planar = True: this mechanism is not planar: {found}; use planar = 'auto' or False"
            )
    return drive_to(model.arrays, motion, work, **ways), f"spatial: {found}" if found else ""


def conventional(
    model: Model,
    targets: Mapping[str, float],
    *,
    start: Configuration | None = None,
    planar: bool | Literal["auto"] = "auto",
    steps: int = 1,
    rtol: float = RTOL,
    cap: float = CAP,
    eps_max: float = math.inf,
    most: int = 30,
    smallest: float = 1e-4,
    work: Work | None = None,
) -> Configuration:
    """Solve `model` at the drive values `targets` [m or rad] by load stepping.

    start: a configuration of the same model to continue from (rest when None). planar: "auto" solves planar scenes with
    three unknowns per node and checks the answer in space, False never does, True raises SceneError with the reason
    where that is not possible. steps: the number of equal steps tried first (1 as in Appendix B). eps_max [N and Nm
    mixed, as in the paper]: give a step up when the residual norm exceeds it. smallest: fraction of the drive motion
    below which steps are not halved any more. Raises ConvergenceError with the
    fraction reached, SceneError for wrong drive names.
    """
    if planar not in ("auto", True, False):
        raise SceneError(f"planar = {planar!r}: choose 'auto', True or False")
    if second_compiler_runs():
        from ksd.solve.warm import ready

        ready()
    work = work or make_work(model.arrays)
    target = model.targets(targets)
    motion = (start.motion if start else model.rest).copy()
    begin = model.targets(start.targets) if start else np.zeros(len(target))
    ways: dict[str, Any] = {"steps": steps, "rtol": rtol, "cap": cap, "eps_max": eps_max, "most": most}
    ways["smallest"] = smallest
    ways |= {"start": begin, "target": target, "factors": (1.0 if start else 0.0, 1.0)}
    clock = time.thread_time_ns()
    driven, how = _drive(model, motion, work, planar=planar, fresh=start is None, **ways)
    spent = (time.thread_time_ns() - clock) * 1e-9
    note = ", ".join(filter(None, [f"{driven.taken} load step{'s' * (driven.taken != 1)}", how]))
    step = Step("equilibrium", driven.solves, spent, driven.residual, driven.stop, note=note)
    values = begin + driven.reached * (target - begin)
    reached = {n: float(v) for n, v in zip(model.drive_names, values, strict=False)}
    result = Configuration(model, motion, "conventional", reached, (step,), driven.negatives, len(target))
    if driven.stop is not Stop.CONVERGED:
        raise ConvergenceError(
            f"the conventional solver stopped at {100 * driven.reached:.3g} % of the drive motion: {driven.stop.sentence}",
            reached=driven.reached,
            result=result,
        )
    return result
