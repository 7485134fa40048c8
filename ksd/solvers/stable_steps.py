"""Load steps that all end in a minimum of energy, for slack and heavy leaf springs, whose single step ends in a saddle.

Loads come first and the drives afterwards, as in a machine. A step is given up as soon as the tangent has been that of a
saddle a few times, which costs less than to reach that saddle; then it is tried shorter. A step of many iterations may have
snapped to another branch: it must lead back to where it came from.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.model.arrays import Arrays, State, Workspace
from ksd.model.compile import Model
from ksd.model.newton import (
    CUT_PREDICTOR_TURN,
    MAX_PREDICTOR_TURN,
    assemble,
    check_residual,
    has_converged,
    largest_displacement,
    largest_rotation,
    take_step,
)
from ksd.solvers.load_steps import SAME_STATE_TOLERANCE, LoadPath, LoadStepRecord, state_difference
from ksd.solvers.pivoted_newton import moves_freely
from ksd.solvers.steps import MAX_TURN_PER_STEP, Stop

MAX_TOTAL = 200
"""Newton iterations of all steps together, after which the path is given up."""
MAX_ITERATIONS, FEW_ITERATIONS = 25, 6
"""Newton iterations of a step at most, and those up to which the next one is made longer."""
MAX_SADDLES = 3
"""Tangents of a saddle on the way of a step, at which it is given up."""
SMALLEST_STEP = 1e-6
"""Fraction of the loads, or of the drive motion, below which steps are not shortened any more."""


class StableSteps:
    """Steps of one model along stable equilibria, in space or in its plane; `motion` ends at the last one.

    arrays: of the model, or of its plane; work: storage for these arrays.
    """

    def __init__(self, model: Model, arrays: Arrays, motion: State, work: Workspace) -> None:
        self.model, self.arrays, self.motion, self.work = model, arrays, motion, work
        self.rows = int(np.count_nonzero(arrays.terms.start >= 0))
        self.iterations, self.steps, self.residual, self.shortest = 0, 0, math.inf, 1.0

    def _solve(self, path: LoadPath, fraction: float) -> tuple[bool, int]:
        """Bring `motion` to the stable equilibrium at a fraction of a path; returns whether that succeeded, and the
        iterations."""
        target, factor = path.values_at(fraction)
        saddles, previous, moved = 0, math.inf, math.inf
        for n in range(MAX_ITERATIONS):
            worst, negatives, status = check_residual(
                self.arrays, self.motion, target, factor, self.work, path.rtol
            )
            if not math.isfinite(worst):
                return False, n
            if n > 0 and has_converged(worst, previous, moved):
                self.residual = worst
                return negatives == self.rows and status == 0, n
            saddles += negatives != self.rows
            if saddles >= MAX_SADDLES:
                return False, n
            turn = largest_rotation(self.arrays, self.work.rhs)
            shift = largest_displacement(self.arrays, self.work.rhs) / self.model.arrays.size
            longest, cut = (MAX_TURN_PER_STEP,) * 2 if n > 0 else (MAX_PREDICTOR_TURN, CUT_PREDICTOR_TURN)
            take_step(
                self.arrays, self.motion, self.work.rhs, self.work, cut / turn if turn > longest else 1.0
            )
            self.iterations += 1
            previous, moved = worst, max(turn / 1e-6, shift / 1e-7)
        return False, MAX_ITERATIONS

    def _leads_back(self, path: LoadPath, fraction: float, before: State) -> bool:
        """Whether the equilibrium at an earlier fraction of the path is the state before."""
        there = self.motion.copy()
        solved, _ = self._solve(path, fraction)
        back = self.motion.copy()
        self.motion.assign(there)
        return solved and state_difference(self.model, back, before) < SAME_STATE_TOLERANCE

    def settle(self, path: LoadPath) -> bool:
        """Bring `motion` to the equilibrium at the start of a path; whether that is a minimum."""
        return self._solve(path, 0.0)[0]

    def take(self, path: LoadPath) -> bool:
        """Follow a path to its end; whether that was reached."""
        done, size = 0.0, 1.0
        before = self.motion.copy()
        while done < 1.0:
            goal = 1.0 if done + size > 1.0 - 1e-9 else done + size
            solved, iterations = self._solve(path, goal)
            if solved and iterations > FEW_ITERATIONS:
                solved = self._leads_back(path, done, before)
            if self.iterations > MAX_TOTAL:
                return False
            self.steps += 1
            if solved:
                self.shortest = min(self.shortest, goal - done)
                done, before = goal, self.motion.copy()
                size *= 4.0 if iterations < FEW_ITERATIONS else 2.0 if iterations == FEW_ITERATIONS else 1.0
                continue
            self.motion.assign(before)
            size *= 0.25
            if size < SMALLEST_STEP:
                return False
        return True


def take_stable_steps(
    model: Model, arrays: Arrays, motion: State, work: Workspace, path: LoadPath
) -> LoadStepRecord:
    """Take the loads of a path first, then its drives, all in steps that end in a minimum; `motion` ends at the last one.

    arrays, work: of the model in space, or in its plane. The fraction reached is that of the drives.
    """
    steps = StableSteps(model, arrays, motion, work)
    assemble(arrays, motion, *path.values_at(0.0), work, path.rtol, rounding=0.0)
    if moves_freely(arrays, work):
        # a part that nothing holds, which loads would swing into some position
        return LoadStepRecord(Stop.SINGULAR, 0, math.inf, 0, 0.0, 0)
    legs = path._replace(target=path.start), path._replace(factors=(path.factors[1],) * 2)
    moving = [p for p in legs if p.factors[0] != p.factors[1] or np.any(p.target != p.start)]
    # from a saddle there are none
    reached = bool(moving) and steps.settle(path) and all(steps.take(leg) for leg in moving)
    stop = Stop.CONVERGED if reached else Stop.TOO_MANY
    return LoadStepRecord(
        stop, steps.iterations, steps.residual, steps.rows, float(reached), steps.steps,
        smallest_step=steps.shortest,
    )  # fmt: skip
