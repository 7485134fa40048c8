"""The conventional solver: equilibrium of all nodes in load steps from the undeformed state (paper 1, Appendix B).

The whole step is tried first and halved on failure. Newton with mixed integration points (MIP) is the default, plain
Newton with the paper's eps_max an option of the mesh and of the call; it is the baseline of every speed claim.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping

import numpy as np

from ksd.errors import ConvergenceError
from ksd.model.arrays import Arrays, Motion, Work, make_work
from ksd.model.compile import Model
from ksd.solve.configuration import Configuration, Step
from ksd.solve.newton import iterate
from ksd.solve.stops import Stop

RTOL = 1e-8
"""Residual of a node over the sum of the element forces on it (design section 5)."""
CAP = 0.3
"""Largest rotation [rad] of a node in one iteration after the predictor."""


def drive_to(
    arrays: Arrays,
    motion: Motion,
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
) -> tuple[Stop, int, float, int, float, int]:
    """Move the drives from `start` to `target` (c,), halving on failure; `motion` ends at the last equilibrium.

    Returns (reason, matrix solves including failed attempts, residual, negative pivots, fraction reached, steps).
    """
    done, size, solves, taken = 0.0, 1.0 / steps, 0, 0
    residual, negatives = math.inf, 0
    safe = motion.copy()
    while done < 1.0:
        # land on the end exactly, whatever the rounding of the steps
        goal = 1.0 if done + size > 1.0 - 1e-9 else done + size
        level = factors[0] + goal * (factors[1] - factors[0])
        want = start + goal * (target - start)
        reason, count, residual, negatives, _ = iterate(
            arrays, motion, want, level, work, rtol, most, cap, eps_max
        )
        solves += count
        taken += 1
        if reason == Stop.CONVERGED:
            done = goal
            safe.assign(motion)
            continue
        motion.assign(safe)
        size *= 0.5
        if size < smallest:
            return Stop(reason), solves, residual, negatives, done, taken
    return Stop.CONVERGED, solves, residual, negatives, 1.0, taken


def conventional(
    model: Model,
    targets: Mapping[str, float],
    *,
    start: Configuration | None = None,
    steps: int = 1,
    rtol: float = RTOL,
    cap: float = CAP,
    eps_max: float = math.inf,
    most: int = 30,
    work: Work | None = None,
) -> Configuration:
    """Solve `model` at the drive values `targets` [m or rad] by load stepping.

    start: a configuration of the same model to continue from (rest when None). steps: the number of equal steps tried
    first (1 as in Appendix B). eps_max [N and Nm mixed, as in the paper]: give a step up when the residual norm
    exceeds it. Raises ConvergenceError with the fraction reached, SceneError for wrong drive names.
    """
    arrays = model.arrays
    work = work or make_work(arrays)
    target = model.targets(targets)
    motion = (start.motion if start else model.rest).copy()
    begin = model.targets(start.targets) if start else np.zeros(len(target))
    clock = time.thread_time_ns()
    stop, solves, residual, negatives, reached, taken = drive_to(
        arrays,
        motion,
        work,
        start=begin,
        target=target,
        factors=(1.0 if start else 0.0, 1.0),
        steps=steps,
        rtol=rtol,
        cap=cap,
        eps_max=eps_max,
        most=most,
    )
    spent = (time.thread_time_ns() - clock) * 1e-9
    step = Step("equilibrium", solves, spent, residual, stop, note=f"{taken} load step{'s' * (taken != 1)}")
    reached_values = {n: float(b + reached * (t - b)) for n, b, t in zip(model.drive_names, begin, target, strict=False)}
    result = Configuration(
        model, motion, "conventional", dict(reached_values), (step,), negatives, len(target)
    )
    if stop is not Stop.CONVERGED:
        raise ConvergenceError(
            f"the conventional solver stopped at {100 * reached:.3g} % of the drive motion: {stop.sentence}",
            reached=reached,
            result=result,
        )
    return result
