"""`ksd.pareto`: the trade-off between the targets and another answer; `ksd.choose`: the best of several jobs."""

from __future__ import annotations

import os
import re
from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ksd.answers.printing import PrintableAnswer, format_number, format_table, progress_bar
from ksd.checks import boolean, clear_argument_errors, number, show, whole_number
from ksd.errors import KsdError, ResumeError, SceneError
from ksd.numerics.threads import small_matrices
from ksd.optimisation.design_log import DesignLog
from ksd.optimisation.job import Job, check_job
from ksd.optimisation.optimality import BETTER_SHARE, OPTIMUM, relative_gain
from ksd.optimisation.optimise import answering_start, optimise, optimise_from, progress_text
from ksd.optimisation.optimum import Optimum
from ksd.optimisation.scaled_problem import ScaledProblem
from ksd.study.arguments import check_executor, submit_task
from ksd.study.sweep import SweepInterrupted
from ksd.study.table import OK, Table
from ksd.view import save_figure
from ksd.view.design_plots import plot_front

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = np.ndarray
DEFAULT_SPAN_RATIO = 10.0
"""Largest limit over the smallest one, where no span is given."""
EXTRA_STARTS = 2
"""Random starts in addition at the first, the middle and the last point; at all points where these find better designs."""


@dataclass(frozen=True, repr=False, eq=False)
class Front(PrintableAnswer):
    """Optima of a job under ever tighter limits of one answer.

    job: the job without these limits; against: column of the limited answer; limits (n,): limit at each point, the widest
    first; points: optimum at each point, None where there is none; status: "ok" or why there is none.

    >>> job, _ = ksd.load_job("pivot_job", drives={"turn": "30deg"})
    >>> front = ksd.pareto(job, against="turn_moment_Nm", points=2, span=(1, 2))
    >>> print([f"{point.merit:.2f}" for point in front.points])
    ['0.50', '0.32']
    """

    job: Job
    against: str
    limits: Array
    points: tuple[Optimum | None, ...]
    status: tuple[str, ...]

    @property
    def merits(self) -> Array:
        """Worst target over its scale (n,), nan where a point has no optimum."""
        return np.array([np.nan if p is None else p.merit for p in self.points])

    @property
    def proven(self) -> int:
        """Number of points that are shown to be optima, see `ksd.optimisation.optimality.Proof`."""
        return sum(p is not None and p.status == OPTIMUM for p in self.points)

    @property
    def designs(self) -> Array:
        """Parameters (n, P) of the points."""
        blank = dict.fromkeys(self.job.parameters, np.nan)
        return np.array([list((blank if p is None else p.design).values()) for p in self.points])

    @property
    def table(self) -> Table:
        """Table with a row per point: limit, merit, parameters, what is shown of it, status."""
        rows = [
            {f"most {self.against}": float(limit), "merit": float(merit), **dict(zip(self.job.parameters, x, strict=True)),
             "proof": "" if p is None else p.status, "status": status}
            for limit, merit, x, p, status in zip(
                self.limits, self.merits, self.designs.tolist(), self.points, self.status, strict=True
            )
        ]  # fmt: skip
        return Table.of_rows(rows, (f"most {self.against}",), name="front")

    def _line(self) -> str:
        good = self.merits[np.isfinite(self.merits)]
        merits = self.job.merit_spoken(float(good.min()), float(good.max()))
        limits = f"{format_number(float(self.limits.min()))} to {format_number(float(self.limits.max()))}"
        return f"{len(good)} of {len(self.points)} points, {merits} against {self.against} {limits}"

    def __str__(self) -> str:
        units = [self.job.unit(name) for name in self.job.parameters]
        heads = [
            # names of scene files, broken at their dots
            name.replace(".", ".\n") + (f"\n[{unit}]" if name in self.job.units else "")
            for name, (unit, _) in zip(self.job.parameters, units, strict=True)
        ]
        rows = [
            (
                format_number(limit),
                format_number(merit, 5),
                *(format_number(v / factor) for v, (_, factor) in zip(x, units, strict=True)),
                proof if status == OK else status,
            )
            for limit, merit, *x, proof, status in (row.values() for row in self.table.rows())
        ]
        return format_table(
            (f"most {self.against}", "worst target", *heads, "<"),
            rows,
            f"Front: {self._line()}; {self.proven} points are proven optima",
        )

    def plot(self, path: str | os.PathLike[str] | None = None) -> Figure:
        """Matplotlib figure of the front, and of its designs as parallel coordinates; written to `path` if given."""
        figure = plot_front(self)
        return figure if path is None else save_figure(figure, path)


@clear_argument_errors
@small_matrices
def pareto(
    job: Job,
    *,
    against: str,
    points: int = 12,
    span: tuple[float, float] | None = None,
    start: Mapping[str, float] | ArrayLike | None = None,
    starts: int = 1,
    seed: int = 0,
    resume: str | os.PathLike[str] | None = None,
    progress: bool = False,
) -> Front:
    """Find the best worst target of a job under ever tighter limits of another answer; returns a `Front`.

    against: column of `ksd.sweep` that is limited from above, at every pose and load case. points: number of limits, in
    equal ratios. span: least and most limit, in units of the column; by default from its value at the optimum without such
    a limit down to a tenth of that. Each point is found by gradients, starting beyond the points before it. start, starts,
    seed: as in `ksd.optimise`, for the first point; resume, progress: as in `ksd.optimise`; points share their designs.

    Ctrl-C raises SweepInterrupted, with every design in its `.table`. Raises SceneError for wrong arguments, and what the
    first optimum raises.

    >>> job, _ = ksd.load_job("pivot_job", drives={"turn": "30deg"})
    >>> front = ksd.pareto(job, against="turn_moment_Nm", points=2, span=(1, 2))
    >>> front.limits, front.status
    (array([2., 1.]), ('ok', 'ok'))
    """
    check_job(job)
    count = whole_number(points, "points", least=2)
    high = np.inf if span is None else _check_span(span)[1]
    widest = job.limited(against, high)
    start_count, seed = whole_number(starts, "starts"), whole_number(seed, "seed", least=0)
    log = DesignLog(widest.with_signs(), resume=resume)
    optima: list[Optimum | None] = []
    status: list[str] = []

    def progress_count() -> str:
        return f"{len(optima)} of {count} points are done, "

    with log.interruptible(progress_count), progress_bar(boolean(progress, "progress")) as bar:
        task = bar.add_task("points", total=count)

        def update_bar(problem: ScaledProblem, _: int) -> None:
            bar.update(task, description=progress_text(problem, "points"), completed=len(optima))

        widest, x = answering_start(log, start, "gradient, start 1")
        told = job
        job = (job.conventionally(widest.method_note) if widest.method_note else None) or job
        job = job.with_signs()
        extra = list(widest.random(EXTRA_STARTS, seed=seed + 2))
        X = [x, *widest.random(start_count, seed=seed + 1)[: start_count - 1]]
        first = optimise_from(widest, log, X, "gradient", progress=update_bar)
        optima.append(first)
        status.append(OK)
        if span is None:
            most = max(
                first.answers[a.name] for a in widest.answers
                if a.role == "limit" and a.asked == against and np.isfinite(a.high)
            )  # fmt: skip
            if most <= 0.0:
                raise SceneError(
                    f"{against} is {format_number(most)} at the optimum: give a span of limits for it"
                )
            span = most / DEFAULT_SPAN_RATIO, most
        limits = np.geomspace(span[1], span[0], count)

        def point(k: int, X: list[Array]) -> tuple[Optimum | None, str]:
            """The optimum of point k from starts X, and "ok" or why there is none."""
            try:
                own = widest if k == 0 else job.limited(against, float(limits[k]))
                return optimise_from(own, log, X, "gradient", progress=update_bar), OK
            except ResumeError:
                raise
            except KsdError as reason:
                return None, str(reason)

        def improve(k: int, X: list[Array]) -> bool:
            """Search point k again from starts X; whether it is better then."""
            found = point(k, X)[0]
            if found is None or not _is_better(found, optima[k]):
                return False
            optima[k], status[k] = found, OK
            return True

        problem = ScaledProblem(widest, log, "gradient, start 1")
        for k in range(1, count):
            found, reason = point(k, [_next_start(problem, optima)])
            optima.append(found)
            status.append(reason)
        checked = {0, count // 2, count - 1}
        improved = [improve(k, extra) for k in sorted(checked)]
        if any(improved):
            for k in set(range(count)) - checked:
                improve(k, extra)
        # a tighter limit gives no better optimum: where it seems to, the wider one is searched again from there
        for k in reversed(range(count - 1)):
            tighter = optima[k + 1]
            if tighter is not None and _is_better(tighter, optima[k]):
                improve(k, [np.array(list(tighter.design.values()))])
        # and where a point is better than before, so may be those beyond it
        for k in range(1, count):
            own, wider = optima[k], optima[k - 1]
            if wider is not None and (own is None or own.status != OPTIMUM):
                improve(k, [np.array(list(wider.design.values()))])
    return Front(told, against, limits, tuple(optima), tuple(status))


def _is_better(one: Optimum, other: Optimum | None) -> bool:
    """Whether an optimum is better than another by more than counts, or there is no other."""
    return other is None or relative_gain(one.merit, other.merit) > BETTER_SHARE


def _next_start(problem: ScaledProblem, optima: list[Optimum | None]) -> Array:
    """Start (P,) of the next point: linear extrapolation of the last two, or the last one where that has no answers."""
    points = [problem.scaled(np.array(list(p.design.values()))) for p in optima if p is not None]
    last = problem.unscaled(points[-1])
    if len(optima) < 2 or None in optima[-2:]:
        return last
    extrapolated = problem.unscaled(2 * points[-1] - points[-2])
    return extrapolated if problem.log.batch(extrapolated, by=problem.label).status[0] == OK else last


def _check_span(span: Any) -> tuple[float, float]:
    """The least and the most limit. Raises SceneError for what is no span."""
    low, high = (number(v, "span") for v in span) if np.shape(span) == (2,) else (1.0, 0.0)
    if not 0.0 < low < high:
        raise SceneError(f"span = {show(span)}: give the least and the most of the limit, both positive")
    return low, high


@dataclass(frozen=True, repr=False, eq=False)
class Choice(PrintableAnswer):
    """Optima of several jobs, as returned by `ksd.choose`.

    optima: by name of job, the best first, None where there is none; status: "ok" or why there is none, by name.

    >>> job, _ = ksd.load_job("pivot_job", drives={"turn": "30deg"})
    >>> choice = ksd.choose({"cross flexure": job})
    >>> print(choice.status, f"{choice.optima['cross flexure'].merit:.2f}")
    {'cross flexure': 'ok'} 0.50
    """

    optima: Mapping[str, Optimum | None]
    status: Mapping[str, str]

    @property
    def best(self) -> str:
        """Name of the best job."""
        return next(iter(self.optima))

    def __getitem__(self, name: str) -> Optimum:
        """The optimum of a job; raises SceneError where there is none."""
        optimum = self.optima.get(name)
        if optimum is None:
            raise SceneError(
                self.status.get(name, f"there is no job '{name}'; there are {', '.join(self.optima)}")
            )
        return optimum

    def _line(self) -> str:
        merits = (f"{n} {'-' if o is None else format_number(o.merit)}" for n, o in self.optima.items())
        return f"worst target over its scale: {', '.join(merits)}"

    def __str__(self) -> str:
        rows = [
            (
                name,
                *(
                    (format_number(o.merit, 5), str(o.evaluations), o.status, ", ".join(o.held))
                    if o
                    else ("", "", "", self.status[name])
                ),
            )
            for name, o in self.optima.items()
        ]
        best = "No job has an optimum" if self.optima[self.best] is None else f"Best: {self.best}"
        return format_table(("job", "worst target", "values", "<", "<held by"), rows, best)


@clear_argument_errors
@small_matrices
def choose(
    jobs: Mapping[str, Job],
    *,
    starts: int = 1,
    seed: int = 0,
    executor: Executor | None = None,
    resume: str | os.PathLike[str] | None = None,
    progress: bool = False,
) -> Choice:
    """Find the optimum of every job, such as one job per joint family, and sort them, the best first; returns a `Choice`.

    jobs: by name; their targets should have the same scales. starts, seed, progress: as in `ksd.optimise`; executor: gets
    whole jobs; resume: a folder that keeps the designs of every job in a file of its own. A job without an optimum gets a
    status with the reason.

    Raises SceneError for what is no job. Ctrl-C raises SweepInterrupted, with a row for every job done in its `.table`.

    >>> job, _ = ksd.load_job("pivot_job", drives={"turn": "30deg"})
    >>> choice = ksd.choose({"cross flexure": job})
    >>> print(choice.status, f"{choice.optima['cross flexure'].merit:.2f}")
    {'cross flexure': 'ok'} 0.50
    """
    if not isinstance(jobs, Mapping) or not jobs or not all(isinstance(j, Job) for j in jobs.values()):
        raise SceneError(f"jobs = {show(jobs)}: give jobs by name, such as {{'cross': ksd.Job(...)}}")
    check_executor(executor)
    whole_number(starts, "starts")
    whole_number(seed, "seed", least=0)
    files = _resume_files(resume, list(jobs))
    tasks = [(job, starts, seed, file) for job, file in zip(jobs.values(), files, strict=True)]
    futures = [
        None if executor is None else submit_task(executor, _optimum_or_reason, *task) for task in tasks
    ]
    results: dict[str, Optimum | str] = {}
    with progress_bar(boolean(progress, "progress")) as bar:
        bar_task = bar.add_task("jobs", total=len(jobs))
        try:
            for name, task, future in zip(jobs, tasks, futures, strict=True):
                bar.update(bar_task, description=f"{name}, jobs done")
                results[name] = _optimum_or_reason(*task) if future is None else future.result()
                bar.update(bar_task, completed=len(results))
        except KeyboardInterrupt:
            for future in futures:
                if future is not None:
                    future.cancel()
            done = f"{len(results)} of {len(jobs)} jobs are done, the rows of these are"
            raise SweepInterrupted(done, _table_of_results(results), resume) from None
    optima = {name: result for name, result in results.items() if isinstance(result, Optimum)}
    order = sorted(results, key=lambda name: -optima[name].merit if name in optima else np.inf)
    return Choice(
        {name: optima.get(name) for name in order},
        {name: OK if name in optima else str(results[name]) for name in order},
    )


def _resume_files(folder: Any, names: list[str]) -> list[Path | None]:
    """Path of the file for the designs of every job; None without a folder. Raises SceneError where there is no folder."""
    if folder is None:
        return [None] * len(names)
    if not isinstance(folder, str | os.PathLike) or not Path(folder).is_dir():
        raise SceneError(
            f"resume = {show(folder)}: give a folder that is there; every job keeps a file in it"
        )
    return [
        Path(folder) / f"{k + 1}_{re.sub('[^A-Za-z0-9]+', '_', name)}.jsonl" for k, name in enumerate(names)
    ]


def _table_of_results(results: Mapping[str, Optimum | str]) -> Table:
    """Table with a row per finished job: its worst target and parameters, and its status."""
    rows = [
        {"job": name, "merit": result.merit, **result.design, "status": OK}
        if isinstance(result, Optimum)
        else {"job": name, "status": result}
        for name, result in results.items()
    ]
    return Table.of_rows(rows, ("job",), name="choice")


def _optimum_or_reason(job: Job, starts: int, seed: int, resume: Path | None) -> Optimum | str:
    """The optimum of a job, or why there is none. Raises ResumeError."""
    try:
        return optimise(job, starts=starts, seed=seed, resume=resume)
    except ResumeError:
        raise
    except KsdError as reason:
        return str(reason)
