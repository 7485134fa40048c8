"""`ksd.optimise`: the design of a `ksd.Job` whose worst target is best.

Epigraph form: the largest t with t <= log(answer / scale) for every target at every pose, limits and rules as constraints,
in logarithms of parameters and answers (`ksd.design.scaled_problem`). The kinks of a minimax objective do no harm as
constraints, but stall a penalty method. SLSQP (Kraft 1988, `scipy.optimize`) needs about ten values and gradients; several
starts show whether there is one optimum. Where a design fails, the step from the last design with answers is halved; no
value is substituted. For a robust optimum, limits are moved in and targets lowered by standard deviations of the answers;
this is repeated until the standard deviations are those of the optimum itself.
"""

from __future__ import annotations

import importlib
import os
import time
import warnings
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import BFGS, Bounds, NonlinearConstraint, minimize, nnls

from ksd.checks import boolean, clear_argument_errors, number, show, similar_name_hint, whole_number
from ksd.design.arguments import check_executor, submit_task
from ksd.design.design_log import DesignLog
from ksd.design.job import Job, check_job
from ksd.design.optimum import Optimum, StartResult
from ksd.design.resume import ResumeFile
from ksd.design.scaled_problem import BINDING_MARGIN, DesignFailed, ScaledProblem, ScoredPoint
from ksd.design.table import OK
from ksd.design.tolerance import check_spread, first_order
from ksd.errors import ConvergenceError, SceneError
from ksd.properties.printing import format_number, progress_bar

Array = np.ndarray
METHODS = ("gradient", "trust-constr", "cobyla", "cma")
LEVEL_TOLERANCE = 1e-6
"""Change of the level (logarithm of the worst target) and violation of limits below which a design is no better."""
SLSQP_TOLERANCE = 1e-8
"""Change of the level between two gradients of SLSQP at which it stops; the answers have smaller rounding errors."""
MAX_ITERATIONS = {"gradient": 100, "trust-constr": 200, "cobyla": 2000, "cma": 1000}
"""Iterations, or generations, by method."""
CMA_TOLERANCE = 1e-4
"""Change of the fitness at which an evolution stops; gradients continue from there."""
MAX_GRADIENTS_WITHOUT_PROGRESS = 4
"""Gradients without a better design at which SLSQP is ended: where targets and limits leave a direction open, its line
searches would continue with ever smaller steps."""
MAX_RESTARTS = 40
"""Largest number of restarts after designs that fail."""
MIN_STEP = 1e-7
"""Step limit, in scaled parameters, below which no restart is made."""
RANK_TOLERANCE = 1e-5
"""Singular value of the active constraints, over the largest, below which a direction of parameters may be flat."""
FLAT_PROBE_STEP = 1e-2
"""Step, in scaled parameters, at which a direction is checked to be flat."""
ROBUST_TOLERANCE = 1e-3
"""Relative change of the standard deviations at which limits are not moved in again."""
MAX_ROBUST_ROUNDS = 12
"""Largest number of optima with limits moved in."""


class _Stalled(Exception):
    """SLSQP makes no progress; y (P,) is the design to end at."""

    def __init__(self, y: Array) -> None:
        super().__init__()
        self.y = y


class _StartRun(NamedTuple):
    """A search from one start: its result, its end in scaled parameters y (P,), its problem, and CPU time [s]."""

    result: StartResult
    y: Array
    problem: ScaledProblem
    seconds: float


class _WorkerRun(NamedTuple):
    """A `_StartRun` as a worker process returns it: without the problem itself, but with all that it found.

    margins, slopes: `known_margins` and `known_slopes` of the problem; entries: designs and slopes of the log that are new.
    """

    result: StartResult
    y: Array
    seconds: float
    margins: dict[bytes, Array]
    slopes: dict[bytes, Array]
    best: ScoredPoint
    best_feasible: ScoredPoint | None
    entries: dict[Any, Any]


ProgressCallback = Callable[[ScaledProblem, int], None]
"""Function called after every new design, with its problem and the number of starts that are done."""


@clear_argument_errors
def optimise(
    job: Job,
    *,
    start: Mapping[str, float] | ArrayLike | None = None,
    starts: int = 1,
    method: Literal["gradient", "trust-constr", "cobyla", "cma"] = "gradient",
    robust: float = 0.0,
    spread: Mapping[str, float] | None = None,
    seed: int = 0,
    executor: Executor | None = None,
    resume: str | os.PathLike[str] | None = None,
    progress: bool = False,
) -> Optimum:
    """Find the design of a job whose worst target is best under its limits and rules; returns an `Optimum`.

    start: parameters by name or in order; the middle of the bounds when None. starts: number of starts; all but the first
    are random by `seed`. method: "gradient" (SLSQP with `ksd.gradient`), "trust-constr" (interior point method with the
    same gradients), "cobyla" (no derivatives), "cma" (evolution, then gradients; needs the package cma). robust: number of
    standard deviations of the answers, to first order, by which limits are moved in and targets lowered (targets by those
    of their logarithms), where parameters scatter by `spread`, as in `ksd.tolerance`. executor: gets whole starts; with a
    single start, the populations of "cma". resume, progress: as in `ksd.sweep`; designs in the file `resume` are not
    computed again, and workers on the same disk write theirs to it at once.

    Raises SceneError for wrong arguments, ConvergenceError where no start leads to a design that meets the limits, with
    every evaluated design in its `.result`; Ctrl-C raises SweepInterrupted, with every evaluated design in its `.table`.
    """
    check_job(job)
    if not isinstance(method, str) or method not in METHODS:
        raise SceneError(
            f"method = {show(method)}: choose one of {', '.join(METHODS)}{similar_name_hint(method, METHODS)}"
        )
    if method == "cma":
        _import_cma()
    deviations = _parameter_deviations(job, robust, spread)
    count = whole_number(starts, "starts")
    X = [job.point(start), *job.random(count, seed=whole_number(seed, "seed", least=0) + 1)[: count - 1]]
    check_executor(executor)
    log = DesignLog(job, resume=resume, executor=None if count > 1 else executor)
    with log.interruptible(), progress_bar(boolean(progress, "progress")) as bar:
        task = bar.add_task("starts", total=count)

        def update_bar(problem: ScaledProblem, done: int) -> None:
            bar.update(task, description=progress_text(problem, "starts"), completed=done)

        start_executor = executor if count > 1 else None
        return optimise_from(
            job,
            log,
            X,
            method,
            executor=start_executor,
            robust=float(robust),
            deviations=deviations,
            progress=update_bar,
        )


def optimise_from(
    job: Job,
    log: DesignLog,
    X: list[Array],
    method: str,
    *,
    executor: Executor | None = None,
    robust: float = 0.0,
    deviations: Array | None = None,
    progress: ProgressCallback,
) -> Optimum:
    """`optimise` from starts X, each (P,), with a log that may hold designs already.

    robust: number of standard deviations; deviations (P,): standard deviations of the parameters. Raises ConvergenceError.
    """
    runs: list[_StartRun] = []

    def report(problem: ScaledProblem) -> None:
        progress(problem, min(len(runs), len(X)))

    for run in _run_starts(job, X, method, log, executor, report):
        runs.append(run)
        report(run.problem)
    good = [run for run in runs if run.result.status == OK]
    if not good:
        meant = "".join(f"; {hint}" for hint in job.far_drives())
        goal = _best_feasible_text(job, runs) or "a design that meets the limits"
        raise ConvergenceError(
            f"none of {len(X)} starts led to {goal}; the first: {runs[0].result.status}{meant}",
            result=log.table(),
        )
    best, margins = max(good, key=lambda run: run.result.merit), dict[str, float]()
    if robust and deviations is not None:
        rounds, margins = _robust_optima(job, best, log, robust, deviations, method, report)
        best, runs = rounds[-1], [*runs, *rounds]
    held, flat = _active_constraints(best.problem, best.y)
    x, job = best.problem.unscaled(best.y), best.problem.job
    return Optimum(
        job, method, job.design_at(x), best.result.merit, dict(zip(job.names, log.values(x).tolist(), strict=True)), held,
        flat, tuple(run.result for run in runs[: len(X)]), log.table(), sum(run.seconds for run in runs), robust, margins,
    )  # fmt: skip


def _best_feasible_text(job: Job, runs: list[_StartRun]) -> str:
    """The best design met by starts that ended elsewhere, as text; empty where no design meets the limits."""
    feasible = [run.problem.best_feasible for run in runs if run.problem.best_feasible is not None]
    if not feasible:
        return ""
    x = runs[0].problem.unscaled(max(feasible, key=lambda point: point.score).y)
    design = ", ".join(f"{n} {v:.5g}" for n, v in job.design_at(x).items())
    return f"an optimum, the best design that meets the limits is {design}"


def _parameter_deviations(job: Job, robust: float, spread: Mapping[str, float] | None) -> Array:
    """Standard deviations (P,) of the parameters. Raises SceneError for wrong `robust` or `spread`."""
    if number(robust, "robust") < 0.0:
        raise SceneError(
            f"robust = {show(robust)}: give a number of standard deviations, 3 for example, 0 for none"
        )
    if bool(robust) != (spread is not None):
        missing = "spread: give" if robust else "robust = 0: give a number of"
        raise SceneError(
            f"{missing} standard deviations{' of the parameters' if robust else ''}; robust and spread go together, such as "
            "robust=3, spread={'thickness': 4e-6}"
        )
    return np.zeros(len(job.parameters)) if spread is None else check_spread(job, spread)


def progress_text(problem: ScaledProblem, tasks: str) -> str:
    """Text beside a progress bar of `tasks`: "starts" or "points"."""
    key = problem.best.y.tobytes()
    known = key in problem.known_margins
    worst = np.exp(problem.level(problem.known_margins[key])) if known else np.nan
    count = len(problem.known_margins)
    return f"{problem.label}: {count} designs, worst target {format_number(float(worst))}, {tasks} done"


def _run_starts(
    job: Job,
    X: list[Array],
    method: str,
    log: DesignLog,
    executor: Executor | None,
    on_new_design: Callable[[ScaledProblem], None],
) -> Iterator[_StartRun]:
    """Run every start, one after the other or in the workers of an executor; yields them in order.

    Designs are added to the log when they are done.
    """
    labels = [f"{method}, start {k + 1}" for k in range(len(X))]
    if executor is None:
        for x, label in zip(X, labels, strict=True):
            yield _run_start(ScaledProblem(job, log, label, on_new_design=on_new_design), x, method)
        return
    known, file = set(log.file.entries), log.file.for_worker()
    futures = [
        submit_task(executor, _run_start_in_worker, job, x, method, label, file)
        for x, label in zip(X, labels, strict=True)
    ]
    collected: list[Future[_WorkerRun]] = []
    try:
        for future, label in zip(futures, labels, strict=True):
            yield _collect(job, future, log, label)
            collected.append(future)
    except BaseException:
        for future, label in zip(futures, labels, strict=True):
            # designs of the other starts that are done are kept
            if (
                future not in collected
                and not future.cancel()
                and future.done()
                and future.exception() is None
            ):
                _collect(job, future, log, label)
        log.add_from_file(known)
        raise


def _run_start_in_worker(job: Job, x: Array, method: str, label: str, file: ResumeFile) -> _WorkerRun:
    """Run one start in a worker; file: that of the log of the calling process, with its entries."""
    log, known = DesignLog(job), set(file.entries)
    log.file = file.for_worker()
    if not file.is_there():
        log.file.path = None
    run = _run_start(ScaledProblem(job, log, label), x, method, time.thread_time)
    entries = {k: rows for k, rows in log.file.entries.items() if k in log.rows or k not in known}
    p = run.problem
    return _WorkerRun(
        run.result, run.y, run.seconds, p.known_margins, p.known_slopes, p.best, p.best_feasible, entries
    )


def _collect(job: Job, future: Future[_WorkerRun], log: DesignLog, label: str) -> _StartRun:
    """The run of a worker, with its designs added to the log."""
    run = future.result()
    log.add_from_worker(run.entries)
    problem = ScaledProblem(job, log, label)
    problem.known_margins, problem.known_slopes = run.margins, run.slopes
    problem.best, problem.best_feasible = run.best, run.best_feasible
    return _StartRun(run.result, run.y, problem, run.seconds)


def _run_start(
    problem: ScaledProblem, x: Array, method: str, clock: Callable[[], float] = time.process_time
) -> _StartRun:
    """Search from a start x (P,)."""
    begin, job = clock(), problem.job
    merit, y = np.nan, problem.scaled(x)
    try:
        y = _evolve(problem, y) if method == "cma" else _descend(problem, y, method)
        feasible = problem.is_feasible(problem.margins(y))
        merit = job.merit(problem.log.values(problem.unscaled(y)))
        status = (
            OK if feasible else f"the limits are not met, farthest from it is {problem.worst_violation(y)}"
        )
        if feasible and np.isinf(merit):
            status = f"{job.merit_name} is infinite there: nothing moves that it asks for, or nothing buckles"
    except DesignFailed as failed:
        y, status = failed.y, str(failed)
    first, last = job.design_at(x), job.design_at(problem.unscaled(y))
    counts = len(problem.known_margins), len(problem.known_slopes)
    return _StartRun(StartResult(first, last, merit, *counts, status), y, problem, clock() - begin)


def _robust_optima(
    job: Job,
    best: _StartRun,
    log: DesignLog,
    robust: float,
    deviations: Array,
    method: str,
    on_new_design: Callable[[ScaledProblem], None],
) -> tuple[list[_StartRun], dict[str, float]]:
    """Optima with limits moved in, and the margins of the last one by answer, in units of its column.

    Every round takes `robust` standard deviations of the answers at the optimum before as margins, the first at `best`, the
    optimum without margins. Raises ConvergenceError where no design meets the limits.
    """
    margins, runs = np.zeros(len(job.answers)), []
    for k in range(MAX_ROBUST_ROUNDS):
        values, slopes = log.slopes(best.problem.unscaled(best.y), by=best.problem.label)
        wanted = robust * first_order(slopes, deviations)
        # margins that are negligible beside their limit, such as of a moment at rest, need not converge
        tolerance = ROBUST_TOLERANCE * wanted + LEVEL_TOLERANCE * _limit_scales(job, values)
        if k and (np.abs(wanted - margins) <= tolerance).all():
            break
        # where the rounds do not converge by themselves, margins may only grow
        margins = np.maximum(wanted, margins) if k > MAX_ROBUST_ROUNDS // 2 else wanted
        label = f"{method}, robust {k + 1}"
        problem = ScaledProblem(job.moved(margins, values), log, label, on_new_design=on_new_design)
        best = _run_start(problem, problem.unscaled(best.y), "gradient" if method == "cma" else method)
        runs.append(best)
        if best.result.status != OK:
            raise ConvergenceError(
                f"limits moved in by {robust:g} standard deviations are met by no design near the optimum: "
                f"{best.result.status}; {_largest_margin_text(job, margins)}",
                result=log.table(),
            )
    return runs, dict(zip(job.names, margins.tolist(), strict=True))


def _largest_margin_text(job: Job, margins: Array) -> str:
    """The limit that is moved in most relative to its size, as text."""
    is_limit = np.array([a.role == "limit" for a in job.answers])
    k = int(np.argmax(np.where(is_limit, margins / _limit_scales(job, margins), 0.0)))
    return f"moved in farthest is {job.names[k]}, by {format_number(float(margins[k]))}"


def _limit_scales(job: Job, values: Array) -> Array:
    """Size (answers,) of the limits of every answer; of targets that of `values` (answers,)."""
    ends = [[abs(e) for e in (a.low, a.high) if np.isfinite(e) and e] for a in job.answers]
    scales = [max(e, default=abs(v)) for e, v in zip(ends, values.tolist(), strict=True)]
    return np.array([v if np.isfinite(v) and v else 1.0 for v in scales])


def _import_cma() -> Any:
    """The package cma. Raises SceneError where it is not installed."""
    try:
        return importlib.import_module("cma")
    except ImportError:
        raise SceneError("method = 'cma' needs the package cma: pip install cma") from None


def _descend(problem: ScaledProblem, y: Array, method: str) -> Array:
    """The end of a local method from y (P,).

    After a design that fails, the method restarts from the last design with answers, within half the step to the failed
    one; after a run that ends at the border of its box, within a box twice as large; after one that ends nearer to the
    limits but does not meet them, from there.
    """
    radius, box = np.inf, problem.bounds
    problem.margins(y)
    for _ in range(MAX_RESTARTS):
        score = problem.best.score
        try:
            end = _minimise_in_box(problem, y, box, method)
        except DesignFailed as failed:
            assert problem.last_valid is not None
            if np.array_equal(failed.y, problem.last_valid):
                # it has answers, but no gradient: no shorter step helps
                raise
            y = problem.last_valid
            radius = 0.5 * min(radius, float(np.abs(failed.y - y).max()))
            if radius < MIN_STEP:
                break
        else:
            is_inside = np.abs(end - y).max() < 0.99 * radius
            y, radius = end, 2.0 * radius
            if is_inside and (problem.best_feasible or problem.best.score <= score + LEVEL_TOLERANCE):
                break
        box = np.column_stack(
            [np.maximum(problem.bounds[:, 0], y - radius), np.minimum(problem.bounds[:, 1], y + radius)]
        )
    return y


def _minimise_in_box(problem: ScaledProblem, y: Array, box: Array, method: str) -> Array:
    """The end (P,) of SLSQP, trust-constr or COBYLA from y within a box (P, 2); variables z are y and the level t."""
    is_target = problem.is_target.astype(float)

    def gap(z: Array) -> Array:
        return problem.margins(_clipped(z[:-1], box)) - is_target * z[-1]

    def gap_slopes(z: Array) -> Array:
        return np.column_stack([problem.slopes(_clipped(z[:-1], box)), -is_target])

    best_score, remaining, level = -np.inf, MAX_GRADIENTS_WITHOUT_PROGRESS, -np.inf

    def gap_slopes_or_stall(z: Array) -> Array:
        nonlocal best_score, remaining, level
        y = _clipped(z[:-1], box)
        margins = problem.margins(y)
        level, change = problem.level(margins), abs(problem.level(margins) - level)
        if max(change, problem.violation(margins)) <= SLSQP_TOLERANCE:
            # SLSQP sums the violations; where these are rounding, its line search would halve steps without end
            raise _Stalled(y)
        if problem.best.score > best_score + LEVEL_TOLERANCE:
            best_score, remaining = problem.best.score, MAX_GRADIENTS_WITHOUT_PROGRESS
        elif np.isfinite(best_score):
            remaining -= 1
        if remaining <= 0:
            raise _Stalled((problem.best_feasible or problem.best).y)
        return gap_slopes(z)

    z = np.append(y, problem.level(problem.margins(y)))
    down = -np.eye(len(z))[-1]
    common: dict[str, Any] = {"fun": lambda z: -z[-1], "x0": z}
    if method == "gradient":
        try:
            found = minimize(
                **common, method="SLSQP", jac=lambda z: down, bounds=[*box.tolist(), (None, None)],
                constraints={"type": "ineq", "fun": gap, "jac": gap_slopes_or_stall},
                options={"ftol": SLSQP_TOLERANCE, "maxiter": MAX_ITERATIONS[method]},
            )  # fmt: skip
        except _Stalled as stalled:
            return stalled.y
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
                    "xtol": LEVEL_TOLERANCE, "gtol": 0.0, "barrier_tol": LEVEL_TOLERANCE,
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
    return _clipped(found.x[:-1], box)


def _clipped(y: Array, box: Array) -> Array:
    """The nearest y (P,) within a box (P, 2)."""
    return np.ascontiguousarray(np.clip(y, *box.T))


def _evolve(problem: ScaledProblem, y: Array) -> Array:
    """The best design of an evolution from y, improved by gradients; designs that fail count as the worst."""
    low, span = problem.bounds[:, 0], np.diff(problem.bounds)[:, 0]
    options = {
        "bounds": [0.0, 1.0], "seed": 1, "verbose": -9, "tolfun": CMA_TOLERANCE, "maxiter": MAX_ITERATIONS["cma"],
    }  # fmt: skip
    es = _import_cma().CMAEvolutionStrategy(np.clip((y - low) / span, 0.02, 0.98), 0.2, options)
    problem.margins(y)
    while not es.stop():
        points = es.ask()
        Y = [np.ascontiguousarray(low + span * np.clip(p, 0.0, 1.0)) for p in points]
        answers = problem.log.batch([problem.unscaled(own) for own in Y], by=problem.label)
        costs = []
        for own, values, status in zip(Y, *answers, strict=True):
            if status != OK or np.isnan(values).any():
                costs.append(np.inf)
                continue
            margins = problem.margins_from(values, problem.job.rule_values(problem.unscaled(own)))
            problem.known_margins[own.tobytes()] = margins
            costs.append(-problem.fitness(margins))
        problem.on_new_design(problem)
        es.tell(points, [c if np.isfinite(c) else 1e6 for c in costs])
    try:
        return _descend(problem, _clipped(low + span * es.result.xbest, problem.bounds), "gradient")
    except DesignFailed:
        if problem.best_feasible is None:
            raise
        # the best of the evolution stands where there is no gradient
        return problem.best_feasible.y


def _active_constraints(problem: ScaledProblem, y: Array) -> tuple[dict[str, float], dict[str, float]]:
    """The multipliers of targets, limits, rules and bounds that are active at an optimum, and a flat direction, by name.

    Both are empty where there is no gradient.
    """
    try:
        job, margins, slopes = problem.job, problem.margins(y), problem.slopes(y)
    except DesignFailed:
        return {}, {}
    level = problem.level(margins)
    names = [job.names[s.answer] for s in problem.sides] + [f"rule {n}" for n in job.rule_names]
    active = np.where(problem.is_target, margins - level, margins) <= 10 * BINDING_MARGIN
    rows = [(names[i], slopes[i], float(problem.is_target[i])) for i in np.flatnonzero(active)]
    without_bounds = len(rows)
    for i, name in enumerate(job.parameters):
        for side, end, sign in (("least", 0, 1.0), ("most", 1, -1.0)):
            if abs(y[i] - problem.bounds[i, end]) <= 1e-7:
                rows.append((f"{name} at its {side}", sign * (np.arange(len(y)) == i), 0.0))
    # stationarity: multipliers that balance the slopes, those of targets with sum 1
    A = np.array([[*row, target] for _, row, target in rows]).T
    multipliers = nnls(A, np.append(np.zeros(len(y)), 1.0))[0]
    held: dict[str, float] = {}
    for (name, _, _), w in zip(rows, multipliers.tolist(), strict=True):
        if w > 1e-7:
            held[name] = held.get(name, 0.0) + w
    _, values, directions = np.linalg.svd(A[:-1].T - np.outer(A[-1], A[:-1].T[A[-1] > 0].mean(axis=0)))
    rank = int(np.sum(values > RANK_TOLERANCE * values[0])) if len(values) else 0
    if without_bounds == 0 or rank >= len(y) or not len(values):
        return held, {}
    return held, _flat_direction(problem, y, directions[-1], active)


def _flat_direction(problem: ScaledProblem, y: Array, direction: Array, active: Array) -> dict[str, float]:
    """The direction (P,) by name of parameter, where a step along it changes no active margin; else empty."""
    direction = direction / np.abs(direction).max()
    margins = problem.margins(y)
    for s in (1.0, -1.0):
        try:
            end = problem.margins(_clipped(y + s * FLAT_PROBE_STEP * direction, problem.bounds))
        except DesignFailed:
            return {}
        if np.abs(end - margins)[active].max() > BINDING_MARGIN * FLAT_PROBE_STEP * 10:
            return {}
    return {n: float(v) for n, v in zip(problem.job.parameters, direction, strict=True) if abs(v) > 1e-3}
