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
from ksd.design.scaled_problem import BINDING, DesignFailed, ScaledProblem
from ksd.design.table import OK
from ksd.design.tolerance import check_spread, first_order
from ksd.errors import ConvergenceError, SceneError
from ksd.properties.printing import format_number, progress_bar

Array = np.ndarray
METHODS = ("gradient", "trust-constr", "cobyla", "cma")
TOLERANCE = 1e-6
"""Change of the logarithm of the worst answer, and of limits exceeded, at which it counts as no better."""
STILL = 1e-8
"""The same between two gradients of SLSQP; answers are rounded by less."""
MOST = {"gradient": 100, "trust-constr": 200, "cobyla": 2000, "cma": 1000}
"""Iterations, or generations, of every method."""
EVOLVED = 1e-4
"""Change of the fitness at which an evolution stops: gradients go on from there."""
PATIENCE = 4
"""Gradients without a design better by that at which SLSQP is ended: where targets and limits leave a direction open, its
line searches go on for ever smaller steps."""
ROUNDS, SHORTEST = 40, 1e-7
"""How often it goes on where designs fail, and the step below which it does not."""
FLAT = 1e-5
"""Singular value of what holds an optimum, over the largest, below which a direction of parameters may be flat."""
TRIED = 1e-2
"""Step along such a direction at which it is looked whether anything changes."""
SETTLED, AGAIN = 1e-3, 12
"""Change of the standard deviations at which limits are moved in no further, and how often at most."""


class _Stalled(Exception):
    """No better design than y (P,) for a while."""

    def __init__(self, y: Array) -> None:
        super().__init__()
        self.y = y


class _Way(NamedTuple):
    """One start: how it ended, where in scaled parameters, its search, and CPU time [s]."""

    ended: StartResult
    y: Array
    search: ScaledProblem
    seconds: float


Told = Callable[[ScaledProblem, int], None]
"""Called after every new design of a search, with the count of starts that are done."""


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
    """The design of a job whose worst target is best under its limits and rules; returns an `Optimum`.

    start: parameters by name or in order, the middle of the bounds when None; starts: how many, the others random by
    `seed`. method: "gradient" (SLSQP with `ksd.gradient`), "trust-constr" (interior points with the same), "cobyla" (no
    derivatives), "cma" (evolution, then a polish by gradients; needs the package cma). robust: limits are moved in, and
    targets count less, by so many standard deviations of their answers (of targets: of their logarithms), to first order,
    where parameters scatter by `spread`, as in `ksd.tolerance`. executor: gets whole starts, of a single one the
    populations of "cma". resume, progress: as in `ksd.sweep`; with `resume` designs in the file are not computed again.

    Raises SceneError for wrong words, ConvergenceError where no start leads to a design that meets the limits, with every
    design evaluated in its `.result`; Ctrl-C raises SweepInterrupted, with every design evaluated in its `.table`.
    """
    check_job(job)
    if not isinstance(method, str) or method not in METHODS:
        raise SceneError(
            f"method = {show(method)}: choose one of {', '.join(METHODS)}{similar_name_hint(method, METHODS)}"
        )
    if method == "cma":
        _cma()
    times, scatter = _scatter(job, robust, spread)
    count = whole_number(starts, "starts")
    X = [job.point(start), *job.random(count, whole_number(seed, "seed", least=0) + 1)[: count - 1]]
    check_executor(executor)
    log = DesignLog(job, resume=resume, executor=None if count > 1 else executor)
    with log.interruptible(), progress_bar(boolean(progress, "progress")) as bar:
        task = bar.add_task("starts", total=count)

        def told(search: ScaledProblem, done: int) -> None:
            bar.update(task, description=progress_text(search, "starts"), completed=done)

        elsewhere = executor if count > 1 else None
        return optimise_from(job, log, X, method, executor=elsewhere, times=times, scatter=scatter, told=told)


def optimise_from(
    job: Job,
    log: DesignLog,
    X: list[Array],
    method: str,
    *,
    executor: Executor | None = None,
    times: float = 0.0,
    scatter: Array | None = None,
    told: Told,
) -> Optimum:
    """`optimise` from starts X, each (P,), with a log that may hold designs already; `times`: the standard deviations
    of `robust`, `scatter` (P,) those of the parameters. Raises ConvergenceError."""
    ways: list[_Way] = []

    def heard(search: ScaledProblem) -> None:
        told(search, min(len(ways), len(X)))

    for way in _all_ways(job, X, method, log, executor, heard):
        ways.append(way)
        heard(way.search)
    good = [w for w in ways if w.ended.status == OK]
    if not good:
        meant = "".join(f"; {said}" for said in job.far_drives())
        led = _led(job, ways) or "a design that meets the limits"
        raise ConvergenceError(
            f"none of {len(X)} starts led to {led}; the first: {ways[0].ended.status}{meant}",
            result=log.table(),
        )
    best, margins = max(good, key=lambda w: w.ended.merit), dict[str, float]()
    if times and scatter is not None:
        rounds, margins = _robust(job, best, log, times, scatter, method, heard)
        best, ways = rounds[-1], [*ways, *rounds]
    held, flat = _holds(best.search, best.y)
    x, job = best.search.x(best.y), best.search.job
    return Optimum(
        job, method, job.design_at(x), best.ended.merit, dict(zip(job.names, log.values(x).tolist(), strict=True)), held,
        flat, tuple(w.ended for w in ways[: len(X)]), log.table(), sum(w.seconds for w in ways), times, margins,
    )  # fmt: skip


def _led(job: Job, ways: list[_Way]) -> str:
    """The best design on the way of starts that ended elsewhere, in words; nothing where none meets the limits."""
    met = [w.search.met_best for w in ways if w.search.met_best is not None]
    if not met:
        return ""
    x = ways[0].search.x(max(met, key=lambda own: own[0])[1])
    said = ", ".join(f"{n} {v:.5g}" for n, v in job.design_at(x).items())
    return f"an optimum, the best design that meets the limits is {said}"


def _scatter(job: Job, robust: float, spread: Mapping[str, float] | None) -> tuple[float, Array]:
    """How many standard deviations limits are moved in by, and those of the parameters (P,). Raises SceneError."""
    times = number(robust, "robust")
    if times < 0.0:
        raise SceneError(
            f"robust = {show(robust)}: give a number of standard deviations, 3 for example, 0 for none"
        )
    if bool(times) != (spread is not None):
        missing = "spread: give" if times else "robust = 0: give a number of"
        raise SceneError(
            f"{missing} standard deviations{' of the parameters' if times else ''}; robust and spread go together, such as "
            "robust=3, spread={'thickness': 4e-6}"
        )
    return times, np.zeros(len(job.parameters)) if spread is None else check_spread(job, spread)


def progress_text(search: ScaledProblem, of: str) -> str:
    """What a progress bar of starts, or points, says."""
    at = search.best[1].tobytes()
    t = np.exp(search.level(search.asked[at])) if at in search.asked else np.nan
    return f"{search.by}: {len(search.asked)} designs, worst target {format_number(float(t))}, {of} done"


def _all_ways(
    job: Job,
    X: list[Array],
    method: str,
    log: DesignLog,
    executor: Executor | None,
    told: Callable[[ScaledProblem], None],
) -> Iterator[_Way]:
    """Every start, one after the other or in the workers of an executor, in order; designs go into the log as they are
    done."""
    names = [f"{method}, start {k + 1}" for k in range(len(X))]
    if executor is None:
        for x, name in zip(X, names, strict=True):
            yield _way(ScaledProblem(job, log, name, told=told), x, method)
        return
    known = dict(log.file.entries)
    waiting = [
        submit_task(executor, _elsewhere, job, x, method, name, known)
        for x, name in zip(X, names, strict=True)
    ]
    taken: list[Future[Any]] = []
    try:
        for one, name in zip(waiting, names, strict=True):
            yield _taken(job, one, log, name)
            taken.append(one)
    except BaseException:
        for one, name in zip(waiting, names, strict=True):
            # what others have finished is kept
            if one not in taken and not one.cancel() and one.done() and one.exception() is None:
                _taken(job, one, log, name)
        raise


def _elsewhere(job: Job, x: Array, method: str, by: str, known: Mapping[Any, Any]) -> Any:
    """One start in a worker, to which designs and slopes are `known`: how it ended, where, what its search found, and what
    its log holds of it."""
    log = DesignLog(job)
    log.file.entries |= known
    way = _way(ScaledProblem(job, log, by), x, method, time.thread_time)
    mine = {k: rows for k, rows in log.file.entries.items() if k in log.rows or k not in known}
    s = way.search
    return way.ended, way.y, way.seconds, (s.asked, s.sloped, s.best, s.met_best), mine


def _taken(job: Job, one: Future[Any], log: DesignLog, by: str) -> _Way:
    """A start done by a worker, as if it had been done here."""
    ended, y, seconds, found, kept = one.result()
    log.add_from_worker(kept)
    search = ScaledProblem(job, log, by)
    search.asked, search.sloped, search.best, search.met_best = found
    return _Way(ended, y, search, seconds)


def _way(
    search: ScaledProblem, x: Array, method: str, clock: Callable[[], float] = time.process_time
) -> _Way:
    """From a start (P,) to where it ends."""
    began, job = clock(), search.job
    merit, y = np.nan, search.scaled(x)
    try:
        y = _evolved(search, y) if method == "cma" else _descended(search, y, method)
        met = search.met(search.margins(y))
        merit = job.merit(search.log.values(search.x(y)))
        status = OK if met else f"the limits are not met, farthest from it is {search.farthest(y)}"
        if met and np.isinf(merit):
            status = f"{job.merit_name} is infinite there: nothing moves that it asks for, or nothing buckles"
    except DesignFailed as failed:
        y, status = failed.y, str(failed)
    first, last = job.design_at(x), job.design_at(search.x(y))
    ended = StartResult(first, last, merit, len(search.asked), len(search.sloped), status)
    return _Way(ended, y, search, clock() - began)


def _robust(
    job: Job,
    best: _Way,
    log: DesignLog,
    times: float,
    scatter: Array,
    method: str,
    told: Callable[[ScaledProblem], None],
) -> tuple[list[_Way], dict[str, float]]:
    """Optima with ever other margins, the last one with `times` its own standard deviations, from the one without; and these
    margins by answer."""
    by, found = np.zeros(len(job.answers)), []
    for k in range(AGAIN):
        values, slopes = log.slopes(best.search.x(best.y), by=best.search.by)
        wanted = times * first_order(slopes, scatter)
        # what is nothing of its limit, such as a moment at rest, may stay unsettled
        if k and (np.abs(wanted - by) <= SETTLED * wanted + TOLERANCE * _sizes(job, values)).all():
            break
        # where rounds do not settle of themselves the wider of two margins is kept
        by = np.maximum(wanted, by) if k > AGAIN // 2 else wanted
        search = ScaledProblem(job.moved(by, values), log, f"{method}, robust {k + 1}", told=told)
        best = _way(search, search.x(best.y), "gradient" if method == "cma" else method)
        found.append(best)
        if best.ended.status != OK:
            raise ConvergenceError(
                f"limits moved in by {times:g} standard deviations are met by no design near the optimum: "
                f"{best.ended.status}; {_tightest(job, by)}"
            )
    return found, dict(zip(job.names, by.tolist(), strict=True))


def _tightest(job: Job, by: Array) -> str:
    """The limit that is moved in farthest over its size, in words."""
    limits = np.array([a.role == "limit" for a in job.answers])
    k = int(np.argmax(np.where(limits, by / _sizes(job, by), 0.0)))
    return f"moved in farthest is {job.names[k]}, by {format_number(float(by[k]))}"


def _sizes(job: Job, values: Array) -> Array:
    """(answers,): the size of what each is limited by, of targets their own."""
    ends = [[abs(e) for e in (a.low, a.high) if np.isfinite(e) and e] for a in job.answers]
    found = [max(e, default=abs(v)) for e, v in zip(ends, values.tolist(), strict=True)]
    return np.array([v if np.isfinite(v) and v else 1.0 for v in found])


def _cma() -> Any:
    """The package cma. Raises SceneError where it is not installed."""
    try:
        return importlib.import_module("cma")
    except ImportError:
        raise SceneError("method = 'cma' needs the package cma: pip install cma") from None


def _descended(search: ScaledProblem, y: Array, method: str) -> Array:
    """The end of SLSQP or COBYLA from y; where designs fail, within half the step that led there, and twice that again
    where it went well."""
    reach, box = np.inf, search.bounds
    search.margins(y)
    for _ in range(ROUNDS):
        try:
            found = _minimised(search, y, box, method)
        except DesignFailed as failed:
            assert search.good is not None
            if np.array_equal(failed.y, search.good):
                # it has answers, but no gradient: no shorter step helps
                raise
            y = search.good
            reach = 0.5 * min(reach, float(np.abs(failed.y - y).max()))
            if reach < SHORTEST:
                break
        else:
            inside = np.abs(found - y).max() < 0.99 * reach
            y, reach = found, 2.0 * reach
            if inside:
                break
        box = np.column_stack(
            [np.maximum(search.bounds[:, 0], y - reach), np.minimum(search.bounds[:, 1], y + reach)]
        )
    return y


def _minimised(search: ScaledProblem, y: Array, box: Array, method: str) -> Array:
    """The end within a box (P, 2)."""
    targets = search.targets.astype(float)

    def gap(z: Array) -> Array:
        return search.margins(_inside(z[:-1], box)) - targets * z[-1]

    reached, patience, before = -np.inf, PATIENCE, -np.inf

    def sloped(z: Array) -> Array:
        return np.column_stack([search.slopes(_inside(z[:-1], box)), -targets])

    def slope(z: Array) -> Array:
        nonlocal reached, patience, before
        y = _inside(z[:-1], box)
        margins = search.margins(y)
        before, moved = search.level(margins), abs(search.level(margins) - before)
        if max(moved, search.exceeded(margins)) <= STILL:
            # SLSQP sums what is exceeded, and where that is rounding its line search halves steps to no end
            raise _Stalled(y)
        better = search.best[0] > reached + TOLERANCE
        reached, patience = (
            (search.best[0], PATIENCE) if better else (reached, patience - np.isfinite(reached))
        )
        if patience <= 0:
            raise _Stalled((search.met_best or search.best)[1])
        return sloped(z)

    z = np.append(y, search.level(search.margins(y)))
    down = -np.eye(len(z))[-1]
    common: dict[str, Any] = {"fun": lambda z: -z[-1], "x0": z}
    if method == "gradient":
        try:
            found = minimize(
                **common, method="SLSQP", jac=lambda z: down, bounds=[*box.tolist(), (None, None)],
                constraints={"type": "ineq", "fun": gap, "jac": slope},
                options={"ftol": STILL, "maxiter": MOST[method]},
            )  # fmt: skip
        except _Stalled as stalled:
            return stalled.y
    elif method == "trust-constr":
        zeros = np.zeros((len(z), len(z)))
        # interior points begin inside
        margin = 0.01 * np.diff(box)[:, 0]
        common["x0"] = np.append(np.clip(y, box[:, 0] + margin, box[:, 1] - margin), z[-1])
        # gtol is met while the barrier still stands
        with warnings.catch_warnings():
            # a step so short that no slope changes
            warnings.filterwarnings("ignore", message="delta_grad == 0.0")
            found = minimize(
                **common, method="trust-constr", jac=lambda z: down, hess=lambda z: zeros,
                bounds=Bounds(*np.vstack([box, [-np.inf, np.inf]]).T, keep_feasible=True),
                constraints=NonlinearConstraint(gap, 0.0, np.inf, jac=sloped, hess=BFGS()),
                options={"xtol": TOLERANCE, "gtol": 0.0, "barrier_tol": TOLERANCE, "maxiter": MOST[method]},
            )  # fmt: skip
    else:

        def within(z: Array) -> Array:
            return np.concatenate([gap(z), z[:-1] - box[:, 0], box[:, 1] - z[:-1]])

        found = minimize(
            **common, method="COBYLA", constraints={"type": "ineq", "fun": within}, tol=1e-8,
            options={"rhobeg": 0.1, "maxiter": MOST[method]},
        )  # fmt: skip
    return _inside(found.x[:-1], box)


def _inside(y: Array, box: Array) -> Array:
    return np.ascontiguousarray(np.clip(y, *box.T))


def _evolved(search: ScaledProblem, y: Array) -> Array:
    """The best of an evolution from y, polished by gradients; designs that fail are the worst."""
    low, spread = search.bounds[:, 0], np.diff(search.bounds)[:, 0]
    options = {"bounds": [0.0, 1.0], "seed": 1, "verbose": -9, "tolfun": EVOLVED, "maxiter": MOST["cma"]}
    es = _cma().CMAEvolutionStrategy(np.clip((y - low) / spread, 0.02, 0.98), 0.2, options)
    search.margins(y)
    while not es.stop():
        places = es.ask()
        Y = [np.ascontiguousarray(low + spread * np.clip(p, 0.0, 1.0)) for p in places]
        judged = search.log.batch([search.x(own) for own in Y], by=search.by)
        cost = []
        for own, values, status in zip(Y, *judged, strict=True):
            if status != OK or np.isnan(values).any():
                cost.append(np.inf)
                continue
            margins = search.margins_of(values, search.job.rule_values(search.x(own)))
            search.asked[own.tobytes()] = margins
            cost.append(-search.fitness(margins))
        search.told(search)
        es.tell(places, [c if np.isfinite(c) else 1e6 for c in cost])
    try:
        return _descended(search, _inside(low + spread * es.result.xbest, search.bounds), "gradient")
    except DesignFailed:
        if search.met_best is None:
            raise
        # evolution needs no gradient where there is none
        return search.met_best[1]


def _holds(search: ScaledProblem, y: Array) -> tuple[dict[str, float], dict[str, float]]:
    """What holds an optimum, with its multiplier, and a flat direction; nothing where there is no gradient."""
    try:
        job, margins, slopes = search.job, search.margins(y), search.slopes(y)
    except DesignFailed:
        return {}, {}
    level = search.level(margins)
    names = [job.names[s.answer] for s in search.sides] + [f"rule {n}" for n in job.rule_names]
    close = np.where(search.targets, margins - level, margins) <= 10 * BINDING
    rows = [(names[i], slopes[i], float(search.targets[i])) for i in np.flatnonzero(close)]
    free = len(rows)
    for i, name in enumerate(job.parameters):
        for side, end, sign in (("least", 0, 1.0), ("most", 1, -1.0)):
            if abs(y[i] - search.bounds[i, end]) <= 1e-7:
                rows.append((f"{name} at its {side}", sign * (np.arange(len(y)) == i), 0.0))
    A = np.array([[*row, target] for _, row, target in rows]).T
    worth = nnls(A, np.append(np.zeros(len(y)), 1.0))[0]
    held: dict[str, float] = {}
    for (name, _, _), w in zip(rows, worth.tolist(), strict=True):
        if w > 1e-7:
            held[name] = held.get(name, 0.0) + w
    _, values, ways = np.linalg.svd(A[:-1].T - np.outer(A[-1], A[:-1].T[A[-1] > 0].mean(axis=0)))
    rank = int(np.sum(values > FLAT * values[0])) if len(values) else 0
    if free == 0 or rank >= len(y) or not len(values):
        return held, {}
    return held, _flat(search, y, ways[-1], close)


def _flat(search: ScaledProblem, y: Array, way: Array, close: Array) -> dict[str, float]:
    """The direction `way` (P,) by name, where a step along it changes nothing that is `close`; else nothing."""
    way = way / np.abs(way).max()
    here = search.margins(y)
    for s in (1.0, -1.0):
        try:
            end = search.margins(_inside(y + s * TRIED * way, search.bounds))
        except DesignFailed:
            return {}
        if np.abs(end - here)[close].max() > BINDING * TRIED * 10:
            return {}
    return {n: float(v) for n, v in zip(search.job.parameters, way, strict=True) if abs(v) > 1e-3}
