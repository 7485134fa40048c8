"""Newton with pivoting, for states at which the block factorisation without pivoting breaks down.

The fixed elimination order is right as long as every link rests on leaf springs that lead to ground. A link held by drives
or supports alone, or a state close to a critical one, gives a pivot of pure rounding although the whole matrix is regular.
Here the same assembled matrix is equilibrated and solved densely with partial pivoting; its inertia comes from Bunch-Kaufman
LDL^T. Follower loads enter with their full, unsymmetric tangent, so convergence stays quadratic. It is slower by a factor of
ten or more, and used only after the block factorisation has failed.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ksd.answers.nonconservative import skew_tangent
from ksd.answers.tangent import stored_matrix
from ksd.model.arrays import Arrays, State, Workspace
from ksd.model.newton import (
    CUT_PREDICTOR_TURN,
    MAX_PREDICTOR_TURN,
    ROUNDING_MULTIPLE,
    assemble,
    has_converged,
    largest_displacement,
    largest_rotation,
    take_step,
)
from ksd.numerics.blocks import factor_blocks
from ksd.numerics.indefinite import equilibration, negative_inertia, solve_scaled
from ksd.solvers.steps import Stop

MIN_RECIPROCAL_CONDITION = 1e-15
"""Reciprocal condition number of the equilibrated matrix below which it counts as singular."""
WEAK_PIVOT = 1e-9
"""Relative pivot of the block factorisation below which a step, or the count of its negative pivots, is repeated with
pivoting."""
ZERO_EIGENVALUE = 1e-14
"""Eigenvalue of the equilibrated matrix below which it is rounding."""


def iterate_pivoted(arrays: Arrays, motion: State, *arguments: Any) -> tuple[int, int, float, int, float]:
    """`ksd.model.newton.solve_equilibrium` with pivoting: the same arguments, rules and returns; motion is changed in place.

    arguments: target, factor, work, rtol, most, cap, blow_up. The last number returned is the reciprocal condition number of
    the equilibrated matrix.
    """
    target, factor, work, rtol, most, cap, blow_up = arguments
    worst, before, moved, condition = math.inf, math.inf, math.inf, 1.0
    for n in range(most + 1):
        worst, _, inside, status = assemble(
            arrays, motion, target, factor, work, rtol, rounding=ROUNDING_MULTIPLE if n > 0 else 0.0
        )
        if not math.isfinite(worst):
            return Stop.NOT_FINITE, n, worst, 0, condition
        K = stored_matrix(arrays, work.matrix)
        if not np.isfinite(K).all():
            return Stop.NOT_FINITE, n, worst, 0, condition
        if has_converged(worst, before, moved):
            reason = (Stop.CONVERGED, Stop.LOCAL_ANGLE, Stop.SINGULAR)[status]
            if reason == Stop.CONVERGED and moves_freely(arrays, work):
                reason = Stop.SINGULAR
            return reason, n, worst, negative_inertia(K) + inside, condition
        if n == most:
            break
        if n > 0 and np.linalg.norm(work.rhs) > blow_up:
            return Stop.DIVERGED, n, worst, 0, condition
        skew = skew_tangent(arrays, motion, factor, work)
        step, condition = solve_scaled(K if skew is None else K + skew, -work.rhs[:, None], equilibration(K))
        if not condition > MIN_RECIPROCAL_CONDITION:
            return Stop.SINGULAR, n, worst, 0, condition
        work.rhs[:] = step[:, 0]
        before = worst
        turn = largest_rotation(arrays, work.rhs)
        moved = max(turn / 1e-6, largest_displacement(arrays, work.rhs) / (1e-7 * arrays.size))
        longest = cap if n > 0 else (MAX_PREDICTOR_TURN if math.isinf(blow_up) else math.inf)
        shortened = cap if n > 0 else CUT_PREDICTOR_TURN
        take_step(arrays, motion, work.rhs, work, shortened / turn if turn > longest else 1.0)
    return Stop.TOO_MANY, most, worst, 0, condition


def moves_freely(arrays: Arrays, work: Workspace) -> bool:
    """Whether some motion of the state assembled in `work` meets no resistance.

    The null space of its tangent then contains more than forces of redundant supports.
    """
    value = work.matrix.copy()
    _, pivot = factor_blocks(arrays.plan.ints, value, np.empty_like(value), len(arrays.plan.size))
    if pivot > WEAK_PIVOT:
        return False
    K = stored_matrix(arrays, work.matrix)
    scale = equilibration(K)
    values, vectors = np.linalg.eigh(K * np.outer(scale, scale))
    motions = np.delete(vectors[:, np.abs(values) < ZERO_EIGENVALUE], arrays.terms.start, axis=0)
    return bool((np.linalg.norm(motions, axis=0) > 1e-3).any())
