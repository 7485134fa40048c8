"""`ksd.optimise`: the design of a `ksd.Job` whose worst target is best.

A search runs from every start (`ksd.optimisation.local_search`; SLSQP, Kraft 1988, `scipy.optimize`, needs about ten
values and gradients); several starts show whether there is one optimum. The best end is checked to be an optimum
(`ksd.optimisation.optimality`) and searched on from where a neighbour is better. For a robust optimum, limits are moved
in and targets lowered by standard deviations of the answers; this is repeated until the standard deviations are those of the
optimum itself.
"""

from __future__ import annotations

import importlib
import os
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor, Future
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ksd.answers.printing import format_number, progress_bar
from ksd.checks import boolean, clear_argument_errors, number, show, similar_name_hint, whole_number
from ksd.errors import ConvergenceError, SceneError
from ksd.numerics.threads import small_matrices
from ksd.optimisation.design_log import DesignLog
from ksd.optimisation.job import Job, check_job
from ksd.optimisation.local_search import StartResult, clipped, descend
from ksd.optimisation.optimality import flat_direction, on_finer_mesh, prove, worths
from ksd.optimisation.optimum import Optimum
from ksd.optimisation.scaled_problem import DesignFailed, ScaledProblem
from ksd.optimisation.tolerance import check_spread, first_order
from ksd.study.arguments import check_executor, submit_task
from ksd.study.questions import Row
from ksd.study.resume import ResumeFile
from ksd.study.table import OK

Array = np.ndarray
METHODS = ("gradient", "trust-constr", "cobyla", "cma")
MARGIN_TOLERANCE = 1e-6
"""Change of a robust margin relative to its limit that is negligible."""
CMA_TOLERANCE = 1e-4
"""Change of the fitness at which an evolution stops; gradients continue from there."""
MAX_GENERATIONS = 1000
"""Largest number of generations of an evolution."""
START_TRIALS = 64
"""Random designs among which one with answers is looked for where a start has none."""
EQUAL_MERIT = 1e-9
"""Relative difference of merits of equal ends."""
MAX_BETTER_NEIGHBOURS = 4
"""Largest number of searches continued from a better neighbour of an optimum."""
ROBUST_TOLERANCE = 1e-3
"""Relative change of the standard deviations at which limits are not moved in again."""
MAX_ROBUST_ROUNDS = 12
"""Largest number of optima with limits moved in."""


class _StartRun(NamedTuple):
    """A search from one start: its result, its end in scaled parameters y (P,), its problem, and CPU time [s]."""

    result: StartResult
    y: Array
    problem: ScaledProblem
    seconds: float


_WorkerRun = tuple[_StartRun, dict[Any, Any], dict[str, Row]]
"""The run of a worker, designs and slopes of its log that are new, and the rows of its log."""
ProgressCallback = Callable[[ScaledProblem, int], None]
"""Function called after every new design, with its problem and the number of starts that are done."""


@clear_argument_errors
@small_matrices
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

    Its `status` says whether it is shown to be an optimum: "optimum", "no better neighbour found" or "stopped". Infinite
    targets never bind. Where a start has no answers, the search begins at the nearest of some random designs that has; where
    it is beyond the trained ranges and the job names no method, the conventional method is taken; either is printed.
    start: parameters by name or in order; the middle of the bounds when None. starts: number of starts; all but the first
    are random by `seed`. method: "gradient" (SLSQP with `ksd.gradient`), "trust-constr" (interior point method with the
    same gradients), "cobyla" (no derivatives), "cma" (evolution, then gradients; needs the package cma). robust: number of
    standard deviations of the answers, to first order, by which limits are moved in and targets lowered (targets by those
    of their logarithms), where parameters scatter by `spread`, as in `ksd.tolerance`. executor: gets whole starts; with a
    single start, the populations of "cma". resume, progress: as in `ksd.sweep`; designs in the file `resume` are not
    computed again, and workers on the same disk write theirs to it at once.

    Raises SceneError for wrong arguments, ConvergenceError where no start leads to a design that meets the limits, with
    every evaluated design in its `.result`; Ctrl-C raises SweepInterrupted, with every evaluated design in its `.table`.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> def pivot(thickness):
    ...     return ksd.Mechanism.of_joint(ksd.CrossedPivot(
    ...         steel, length=50 * mm, angle=45 * deg, thickness=thickness, width=15 * mm
    ...     ))
    >>> job = ksd.Job(
    ...     pivot, angle=20 * deg, vary={"thickness": (0.1 * mm, 0.5 * mm)},
    ...     maximise="support_worst_N_per_m", limits={"stress_MPa": 600},
    ... )
    >>> best = ksd.optimise(job)
    >>> print(f"{best.status}: {best.design['thickness'] / mm:.3f} mm, held by {list(best.held)}")
    optimum: 0.500 mm, held by ['support_worst_N_per_m', 'thickness at its most']
    """
    check_job(job)
    if not isinstance(method, str) or method not in METHODS:
        raise SceneError(
            f"method = {show(method)}: choose one of {', '.join(METHODS)}{similar_name_hint(method, METHODS)}"
        )
    if method == "cma":
        _import_cma()
    deviations = _parameter_deviations(job, robust, spread)
    count, seed = whole_number(starts, "starts"), whole_number(seed, "seed", least=0)
    check_executor(executor)
    log = DesignLog(job.with_signs(), resume=resume, executor=None if count > 1 else executor)
    with log.interruptible(), progress_bar(boolean(progress, "progress")) as bar:
        task = bar.add_task("starts", total=count)
        job, x = answering_start(log, start, f"{method}, start 1")
        X = [x, *job.random(count, seed=seed + 1)[: count - 1]]

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


def answering_start(log: DesignLog, start: Any, by: str) -> tuple[Job, Array]:
    """The job of a log and x (P,) of a start.

    Where no method was given and the start, within the bounds as given, is beyond the trained ranges, job and log become
    those of the conventional method, if that answers. Raises SceneError for a start outside the bounds.
    """
    job, reason = log.job, ""
    try:
        x = job.point(start)
    except SceneError as outside:
        reason = str(outside)
    if job.method == "conventional" or job.arguments["method"] is not None:
        return job, job.point(start)
    reason = reason or log.batch(x, by=by).status[0]
    if reason == OK:
        return job, x
    other = job.conventionally(reason)
    assert other is not None
    x, log.job = other.point(start), other
    if log.batch(x, by=by).status[0] == OK:
        return other, x
    log.job = job
    return job, job.point(start)


@small_matrices
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
    # of equal ends the first, whatever rounding says, so that a run with fewer starts goes on from the same file
    top = max(run.result.merit for run in good)
    best = next(run for run in good if run.result.merit >= top - EQUAL_MERIT * abs(top))
    margins: dict[str, float] = {}
    if robust and deviations is not None:
        rounds, margins = _robust_optima(job, best, log, robust, deviations, method, report)
        best, runs = rounds[-1], [*runs, *rounds]
    problem, y = best.problem, best.y
    begin = time.process_time()
    for k in range(MAX_BETTER_NEIGHBOURS + 1):
        proof, active, better = prove(problem, y)
        if better is None or k == MAX_BETTER_NEIGHBOURS:
            break
        try:
            end = descend(problem, better, "cobyla" if method == "cobyla" else "gradient")
        except DesignFailed:
            end = better
        if (
            not problem.is_feasible(problem.margins(end))
            or problem.design(end).merit <= problem.design(y).merit
        ):
            end = better
        y = end
    if y is not best.y:
        ended = best.result._replace(design=job.design_at(problem.unscaled(y)), merit=problem.design(y).merit)
        runs = [run._replace(result=ended) if run is best else run for run in runs]
    proof = on_finer_mesh(problem, y, proof)
    held = {} if active is None else worths(problem, y, active)
    flat = {} if active is None else flat_direction(problem, y, active)
    x, job = problem.unscaled(y), problem.job
    seconds = sum(run.seconds for run in runs) + time.process_time() - begin
    values = job.as_told(dict(zip(job.names, log.values(x).tolist(), strict=True)))
    return Optimum(
        job.with_signs(False), method, job.design_at(x), problem.design(y).merit, values, held, flat,
        tuple(run.result for run in runs[: len(X)]), log.table(), seconds, robust, margins, proof,
    )  # fmt: skip


def _best_feasible_text(job: Job, runs: list[_StartRun]) -> str:
    """The best design met by starts that ended elsewhere, as text; empty where no design meets the limits."""
    feasible = [run.problem.best_feasible for run in runs if run.problem.best_feasible is not None]
    if not feasible:
        return ""
    x = runs[0].problem.unscaled(max(feasible, key=lambda found: found.merit).y)
    return f"an optimum, the best design that meets the limits is {job.design_text(x)}"


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
    best = np.nan if problem.best_feasible is None else problem.job.merit_sign * problem.best_feasible.merit
    return (
        f"{problem.label}: {len(problem.evaluated)} designs, worst target {format_number(best)}, {tasks} done"
    )


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
        for future in futures:
            yield _collect(job, future, log)
            collected.append(future)
    except BaseException:
        for future in futures:
            # designs of the other starts that are done are kept
            if (
                future not in collected
                and not future.cancel()
                and future.done()
                and future.exception() is None
            ):
                _collect(job, future, log)
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
    return run, entries, log.rows


def _collect(job: Job, future: Future[_WorkerRun], log: DesignLog) -> _StartRun:
    """The run of a worker, with its designs added to the log."""
    run, entries, rows = future.result()
    log.add_from_worker(entries, rows)
    run.problem.job, run.problem.log = job, log
    return run


def _run_start(
    problem: ScaledProblem, x: Array, method: str, clock: Callable[[], float] = time.process_time
) -> _StartRun:
    """Search from a start x (P,)."""
    begin, job = clock(), problem.job
    merit, y, note = np.nan, problem.scaled(x), ""
    try:
        y, note = _with_answers(problem, y)
        y = _evolve(problem, y) if method == "cma" else descend(problem, y, method)
        feasible, merit = problem.is_feasible(problem.margins(y)), problem.design(y).merit
        status = (
            OK if feasible else f"the limits are not met, farthest from it is {problem.worst_violation(y)}"
        )
        if feasible and np.isinf(merit):
            status = f"{job.merit_name} is infinite there: nothing moves that it asks for, or nothing buckles"
    except DesignFailed as failed:
        y, status = failed.y, str(failed)
        best = problem.best_feasible
        if best is not None and problem.raw_slopes:
            # where there is no gradient, the best design that was met stands
            y, merit, status, note = (
                best.y,
                best.merit,
                OK,
                "; ".join(filter(None, [note, f"the search ended where {failed}"])),
            )
    first, last = job.design_at(x), job.design_at(problem.unscaled(y))
    counts = len(problem.evaluated), len(problem.raw_slopes)
    return _StartRun(StartResult(first, last, merit, *counts, status, note), y, problem, clock() - begin)


def _with_answers(problem: ScaledProblem, y: Array) -> tuple[Array, str]:
    """y (P,) where it has answers, or the nearest of some random designs that has, and what to say about it.

    Raises DesignFailed where none has.
    """
    try:
        problem.design(y)
        return y, ""
    except DesignFailed as failed:
        job, reason = problem.job, failed
    try:
        points = [problem.scaled(x) for x in job.random(START_TRIALS)]
    except SceneError:
        raise reason from None
    points = sorted(points, key=lambda point: float(np.linalg.norm(point - y)))
    for k in range(0, len(points), 8):
        for found in problem.designs(points[k : k + 8]):
            if found is not None and np.isfinite(found.merit):
                design = job.design_text(problem.unscaled(found.y))
                return found.y, f"the start has no answers ({reason}); the search began at {design}"
    raise reason


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
        tolerance = ROBUST_TOLERANCE * wanted + MARGIN_TOLERANCE * _limit_scales(job, values)
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


def _evolve(problem: ScaledProblem, y: Array) -> Array:
    """The best design of an evolution from y, improved by gradients; designs that fail count as the worst."""
    low, span = problem.bounds[:, 0], np.diff(problem.bounds)[:, 0]
    options = {
        "bounds": [0.0, 1.0], "seed": 1, "verbose": -9, "tolfun": CMA_TOLERANCE, "maxiter": MAX_GENERATIONS,
    }  # fmt: skip
    es = _import_cma().CMAEvolutionStrategy(np.clip((y - low) / span, 0.02, 0.98), 0.2, options)
    problem.renew(y)
    while not es.stop():
        points = es.ask()
        found = problem.designs([np.ascontiguousarray(low + span * np.clip(p, 0.0, 1.0)) for p in points])
        fitness = [-1e6 if f is None else problem.fitness(problem.margins(f.y)) for f in found]
        es.tell(points, [-f for f in fitness])
    return descend(problem, clipped(low + span * es.result.xbest, problem.bounds), "gradient")
