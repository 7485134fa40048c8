"""Local optimisers over the scaled parameters of a job: SLSQP, trust-constr, COBYLA.

Epigraph form: the largest t with t <= margin of every target, limits and rules as constraints. The kinks of a minimax
objective do no harm as constraints, but stall a penalty method. Each method ends by its own convergence; a design that is
not stationary to first order (`ksd.optimisation.optimality`) is improved by steps of linear programs within a trust
region, which need no curvature, and handed back to SLSQP. Where a design fails, the step from the last design with
answers is halved; no value is substituted.
"""

from __future__ import annotations

import warnings
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import BFGS, Bounds, NonlinearConstraint, minimize

from ksd.optimisation.optimality import STATIONARY, linear_program, remainder
from ksd.optimisation.scaled_problem import BACKOFF, DesignFailed, ScaledProblem

Array = np.ndarray
LEVEL_TOLERANCE = 1e-7
"""Change of the fitness, in logarithms, below which a design is no better."""
INFEASIBLE_TOLERANCE = 1e-3
"""The same as long as no design meets the limits."""
SLSQP_TOLERANCE = 1e-9
"""Change of the level between two gradients of SLSQP at which it stops; the answers have smaller rounding errors."""
TRUST_TOLERANCE = 1e-6
"""Tolerance of steps and barrier of trust-constr."""
NEAR_CHANGE = 1e-3
"""Change of the level between two gradients of SLSQP from which on it is checked whether the design is stationary."""
CONVERGED = 1e-4
"""Growth of the level per step, to first order, at which SLSQP is ended."""
STALL_GRADIENTS = 12
"""Gradients of SLSQP in which the level grows by more than STALL_GAIN; else its line search creeps along a limit."""
STALL_GAIN = 1e-4
"""Growth of the level, see STALL_GRADIENTS."""
MAX_ITERATIONS = {"gradient": 100, "trust-constr": 200, "cobyla": 2000}
"""Iterations by method."""
MAX_ROUNDS = 16
"""Largest number of searches continued from the end of the last one: with renewed sizes, or because it did not converge."""
MAX_FAILURES = 40
"""Largest number of restarts after designs that fail."""
MIN_STEP = 1e-7
"""Step limit, in scaled parameters, below which no restart is made."""
EDGE_STEP = 1e-5
"""Step of a parameter, scaled, below which the place where designs begin to fail counts as a bound of it."""
FIRST_TRUST_RADIUS = 0.05
"""Largest step, in scaled parameters, of the first linear program."""
MAX_LINEAR_PROGRAMS = 12
"""Largest number of linear programs in a row."""


class StartResult(NamedTuple):
    """Result of one start.

    start, design: its first and last design by parameter; merit: worst target over its scale at the last one; values,
    gradients: number of evaluations; status: "ok" or why it is no optimum; note: where the search began elsewhere, or ended
    for want of a gradient.
    """

    start: dict[str, float]
    design: dict[str, float]
    merit: float
    values: int
    gradients: int
    status: str
    note: str = ""


class _Converged(Exception):
    """SLSQP need not go on: the design at y (P,) meets the limits and is stationary, or next to nothing is gained."""

    def __init__(self, y: Array) -> None:
        super().__init__()
        self.y = y


def descend(problem: ScaledProblem, y: Array, method: str) -> Array:
    """The end of a local method from y (P,): the best design that meets limits and rules, where there is one.

    Raises DesignFailed where the first design has no answers, or its gradient cannot be had.
    """
    problem.renew(y)
    for k in range(MAX_ROUNDS):
        problem.edges = problem.bounds.copy()
        before = _rank(problem, y)
        # derivative-free and interior point methods are continued by themselves once
        y = _best(problem, _descend_in_boxes(problem, y, method))
        is_renewed = problem.renew(y)
        if method == "cobyla":
            if not is_renewed and (k > 0 and _rank(problem, y) <= before + LEVEL_TOLERANCE):
                break
            continue
        if method == "trust-constr" and not is_renewed:
            method = "gradient"
            continue
        if is_renewed:
            continue
        if problem.is_feasible(problem.margins(y)) and remainder(problem, y) <= STATIONARY:
            break
        improved = _descend_by_linear_programs(problem, y)
        if _rank(problem, improved) <= before + (
            LEVEL_TOLERANCE if problem.best_feasible else INFEASIBLE_TOLERANCE
        ):
            return improved
        y = improved
    return y


def _rank(problem: ScaledProblem, y: Array) -> float:
    """The fitness at y; what SLSQP leaves of a violation does not count beside progress."""
    return problem.fitness(problem.margins(y))


def _best(problem: ScaledProblem, y: Array) -> Array:
    """y, or the best design that meets limits and rules where that is better or y does not meet them."""
    best = problem.best_feasible
    if best is None:
        return y
    found = problem.design(y)
    if problem.is_feasible(problem.margins(y)) and found.merit >= best.merit:
        return y
    return best.y


def _descend_in_boxes(problem: ScaledProblem, y: Array, method: str) -> Array:
    """The end of a local method from y (P,).

    After a design that fails, the method restarts from the last design with answers. Where a parameter alone makes the
    design fail, its step is quartered, so that the search continues along the edge of what has answers; else all steps are.
    After a run that ends at the border of its box, the next box is twice as large.
    """
    # largest steps down and up
    radius = np.full((2, len(y)), np.inf)
    for _ in range(MAX_FAILURES):
        box = np.column_stack(
            [np.maximum(problem.bounds[:, 0], y - radius[0]), np.minimum(problem.bounds[:, 1], y + radius[1])]
        )
        try:
            end = _minimise_in_box(problem, y, box, method)
        except DesignFailed as failed:
            assert problem.last_valid is not None
            if np.array_equal(failed.y, problem.last_valid):
                # it has answers, but no gradient: no shorter step helps
                raise
            y = problem.last_valid
            step = failed.y - y
            alone = _fails_alone(problem, y, step)
            up = (step > 0.0).astype(int)
            index = np.flatnonzero(alone if alone.any() else step)
            radius[up[index], index] = np.minimum(0.25 * np.abs(step[index]), radius[up[index], index])
            # the edge of what has answers counts as a bound
            at_edge = np.flatnonzero(alone & (np.abs(step) <= EDGE_STEP))
            problem.edges[at_edge, up[at_edge]] = y[at_edge]
            radius[up[at_edge], at_edge] = 0.0
            if np.abs(step).max() < MIN_STEP:
                break
        else:
            at_border = (end - y < -0.99 * radius[0]) | (end - y > 0.99 * radius[1])
            y, radius = end, 2.0 * radius
            if not at_border.any():
                break
    return y


def _fails_alone(problem: ScaledProblem, y: Array, step: Array) -> Array:
    """Whether each parameter (P,) makes the design at y + step fail by its own step."""
    moving = np.flatnonzero(step)
    if len(moving) < 2:
        return step != 0.0
    found = problem.designs([y + step * (np.arange(len(y)) == i) for i in moving])
    fails = np.zeros(len(y), bool)
    fails[moving] = [f is None for f in found]
    return fails


def _minimise_in_box(problem: ScaledProblem, y: Array, box: Array, method: str) -> Array:
    """The end (P,) of SLSQP, trust-constr or COBYLA from y within a box (P, 2); variables z are y and the level t."""
    is_target = problem.is_target.astype(float)
    moved_in = BACKOFF * (1.0 - is_target) if method == "cobyla" else backoff(problem, y)

    def gap(z: Array) -> Array:
        return problem.margins(clipped(z[:-1], box)) - is_target * z[-1] - moved_in

    levels: list[float] = []

    def gap_slopes(z: Array) -> Array:
        y = clipped(z[:-1], box)
        margins = problem.margins(y)
        levels.append(problem.level(margins))
        if method == "gradient" and problem.is_feasible(margins):
            near = len(levels) > 1 and abs(levels[-1] - levels[-2]) < NEAR_CHANGE
            creeps = len(levels) > STALL_GRADIENTS and np.ptp(levels[-STALL_GRADIENTS:]) < STALL_GAIN
            if creeps or (near and remainder(problem, y) <= CONVERGED):
                # SLSQP sums the violations; where these are rounding, its line search would halve steps without end
                raise _Converged(y)
        return np.column_stack([problem.slopes(y), -is_target])

    z = np.append(y, problem.level(problem.margins(y)))
    down = -np.eye(len(z))[-1]
    common: dict[str, Any] = {"fun": lambda z: -z[-1], "x0": z}
    if method == "gradient":
        try:
            found = minimize(
                **common, method="SLSQP", jac=lambda z: down, bounds=[*box.tolist(), (None, None)],
                constraints={"type": "ineq", "fun": gap, "jac": gap_slopes},
                options={"ftol": SLSQP_TOLERANCE, "maxiter": MAX_ITERATIONS[method]},
            )  # fmt: skip
        except _Converged as converged:
            return converged.y
    elif method == "trust-constr":
        zeros = np.zeros((len(z), len(z)))
        # the interior point method starts inside the box
        margin = 0.01 * np.diff(box)[:, 0]
        common["x0"] = np.append(np.clip(y, box[:, 0] + margin, box[:, 1] - margin), z[-1])
        # gtol would be met before the barrier parameter is small
        with warnings.catch_warnings():
            # raised for a step so short that no slope changes
            warnings.filterwarnings("ignore", message="delta_grad == 0.0")
            found = minimize(
                **common, method="trust-constr", jac=lambda z: down, hess=lambda z: zeros,
                bounds=Bounds(*np.vstack([box, [-np.inf, np.inf]]).T, keep_feasible=True),
                constraints=NonlinearConstraint(gap, 0.0, np.inf, jac=gap_slopes, hess=BFGS()),
                options={
                    "xtol": TRUST_TOLERANCE, "gtol": 0.0, "barrier_tol": TRUST_TOLERANCE,
                    "maxiter": MAX_ITERATIONS[method],
                },
            )  # fmt: skip
    else:

        def within(z: Array) -> Array:
            return np.concatenate([gap(z), z[:-1] - box[:, 0], box[:, 1] - z[:-1]])

        found = minimize(
            **common, method="COBYLA", constraints={"type": "ineq", "fun": within}, tol=1e-8,
            options={"rhobeg": 0.1, "maxiter": MAX_ITERATIONS[method]},
        )  # fmt: skip
    return clipped(found.x[:-1], box)


def backoff(problem: ScaledProblem, y: Array) -> Array:
    """What a search from y keeps to the margins (m,): a little to limits and rules, so that they are met in spite of
    rounding; nothing where no parameter moves one by as much, as the size of a leaf spring that is not varied."""
    moves = np.abs(problem.slopes(y)) @ np.diff(problem.bounds)[:, 0]
    return BACKOFF * (~problem.is_target & (moves > BACKOFF))


def _descend_by_linear_programs(problem: ScaledProblem, y: Array) -> Array:
    """The end (P,) of steps from y, each the best of the linearised problem within a trust region that shrinks by a quarter
    where the design at its end is not better."""
    radius = FIRST_TRUST_RADIUS
    for _ in range(MAX_LINEAR_PROGRAMS):
        if radius < MIN_STEP:
            break
        step = linear_step(problem, y, radius)
        if step is None:
            break
        end = clipped(y + step, problem.bounds)
        try:
            least = _rank(problem, y) + LEVEL_TOLERANCE
            is_better = _rank(problem, end) > least
            if not is_better:
                # second-order correction: the limits bend, and are taken as they are at the end of the step
                step = linear_step(problem, y, radius, problem.margins(end) - problem.slopes(y) @ (end - y))
                end = end if step is None else clipped(y + step, problem.bounds)
                is_better = _rank(problem, end) > least
            if is_better:
                problem.slopes(end)
        except DesignFailed:
            is_better = False
        y, radius = (end, 2.0 * radius) if is_better else (y, 0.25 * radius)
    return _best(problem, y)


def linear_step(
    problem: ScaledProblem, y: Array, radius: float, margins: Array | None = None
) -> Array | None:
    """The step (P,) within a radius that raises the level most to first order, violations not counted less than by
    `fitness`; None where the linear program has no answer. margins (m,): in place of those at y."""
    ends = np.clip(problem.edges - y[:, None], -radius, radius)
    room = (problem.margins(y) if margins is None else margins) - backoff(problem, y)
    found = linear_program(problem, y, room, ends, most_violation=np.inf)
    return None if found is None else found[0]


def clipped(y: Array, box: Array) -> Array:
    """The nearest y (P,) within a box (P, 2)."""
    return np.ascontiguousarray(np.clip(y, *box.T))
