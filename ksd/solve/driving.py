"""Moving the drives: load steps that are halved on failure, whatever the Newton underneath."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ksd.model.arrays import Arrays, Motion, Work
from ksd.solve.pivoted import iterate_pivoted
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
    load step, the smallest one (fraction of the way)."""

    stop: Stop
    solves: int
    residual: float
    negatives: int
    reached: float
    taken: int
    pivoted: int = 0
    longest: int = 0
    shortest: float = 1.0


def drive_to(
    motion: Any,
    newton: Callable[..., tuple[int, int, float, int, float]],
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
    pivoting: tuple[Arrays, Work] | None = None,
    begin: Any = None,
) -> Driven:
    """Move the drives from `start` to `target` (c,), halving on failure; `motion` ends at the last equilibrium.

    newton: brings `motion` to equilibrium in place, as `ksd.solve.storage.Storage.newton`. pivoting: spatial arrays and
    storage with which a step of weak pivots is done again. begin: what `motion` starts from, where that is kept elsewhere.
    """
    done, solves, taken, pivoted, longest, residual, negatives = 0.0, 0, 0, 0, 0, math.inf, 0
    size = shortest = 1.0 / steps
    safe = motion.copy() if begin is None else begin
    while done < 1.0:
        # land on the end exactly, whatever the rounding of the steps
        goal = 1.0 if done + size > 1.0 - 1e-9 else done + size
        level = factors[0] + goal * (factors[1] - factors[0])
        want = target if goal == 1.0 else start + goal * (target - start)
        aim = (want, level, rtol, most, cap, eps_max)
        reason, count, residual, negatives, pivot = newton(*aim)
        solves, taken = solves + count, taken + 1
        if pivoting is not None and _weak(pivoting[0], reason, pivot):
            reason, count, residual, negatives, _ = _with_pivoting(pivoting, motion, safe, aim, reason)
            solves, pivoted = solves + count, pivoted + 1
        if reason == Stop.CONVERGED:
            done, longest = goal, max(longest, count)
            shortest = min(shortest, size)
            if done < 1.0:
                safe = motion.copy()
            continue
        motion.assign(safe)
        size *= 0.5
        if size < smallest:
            return Driven(Stop(reason), solves, residual, negatives, done, taken, pivoted, longest, shortest)
    return Driven(Stop.CONVERGED, solves, residual, negatives, 1.0, taken, pivoted, longest, shortest)


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
