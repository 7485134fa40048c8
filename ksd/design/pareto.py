"""`ksd.pareto`: what a target costs in another answer; `ksd.choose`: one optimum each of several jobs, such as joints."""

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

from ksd.checks import boolean, clear_argument_errors, number, show, whole_number
from ksd.design.arguments import check_executor, submit_task
from ksd.design.design_log import DesignLog
from ksd.design.job import Job, check_job
from ksd.design.optimise import optimise, optimise_from, progress_text
from ksd.design.optimum import Optimum
from ksd.design.scaled_problem import ScaledProblem
from ksd.design.sweep import SweepInterrupted
from ksd.design.table import OK, Table
from ksd.errors import KsdError, SceneError
from ksd.properties.printing import PrintableAnswer, format_number, format_table, progress_bar
from ksd.view import save_figure
from ksd.view.front import plot_front

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = np.ndarray
SPAN = 10.0
"""From the optimum without it down to this part of it, where no span of the other answer is given."""


@dataclass(frozen=True, repr=False, eq=False)
class Front(PrintableAnswer):
    """Optima of a job under ever tighter limits of one answer.

    against: its column; limits (n,): of the points, the widest first; points: their optima, None where there is none, and
    status "ok" or why.
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
    def designs(self) -> Array:
        """Parameters (n, P) of the points."""
        blank = dict.fromkeys(self.job.parameters, np.nan)
        return np.array([list((blank if p is None else p.design).values()) for p in self.points])

    @property
    def table(self) -> Table:
        """A row per point: limit, merit, parameters, status."""
        rows = [
            {f"most {self.against}": float(limit), "merit": float(merit), **dict(zip(self.job.parameters, x, strict=True)),
             "status": status}
            for limit, merit, x, status in zip(self.limits, self.merits, self.designs.tolist(), self.status, strict=True)
        ]  # fmt: skip
        return Table.of_rows(rows, (f"most {self.against}",), name="front")

    def _line(self) -> str:
        good = self.merits[np.isfinite(self.merits)]
        said = self.job.merit_spoken(float(good.min()), float(good.max()))
        most = f"{format_number(float(self.limits.min()))} to {format_number(float(self.limits.max()))}"
        return f"{len(good)} of {len(self.points)} points, {said} against {self.against} {most}"

    def __str__(self) -> str:
        rows = [
            (
                format_number(limit),
                format_number(merit, 5),
                *map(format_number, x),
                "" if status == OK else status,
            )
            for limit, merit, *x, status in (row.values() for row in self.table.rows())
        ]
        return format_table(
            (f"most {self.against}", "worst target", *self.job.parameters, "<"),
            rows,
            f"Front: {self._line()}",
        )

    def plot(self, path: str | os.PathLike[str] | None = None) -> Figure:
        """Matplotlib figure of the front and, as parallel coordinates, of its designs; written to `path` if given."""
        figure = plot_front(self)
        return figure if path is None else save_figure(figure, path)


@clear_argument_errors
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
    """The best worst target of a job for ever smaller values of another answer; returns a `Front`.

    against: column of `ksd.sweep` that is limited from above, at every pose and load case. span: its least and most, in
    units of the column; by default from its value at the optimum without such a limit down to a tenth of that. The points
    follow by equal ratios, each by gradients from beyond its neighbours. start, starts, seed: of the first; resume,
    progress: as in `ksd.optimise`; points share their designs. Ctrl-C raises SweepInterrupted, with every design in its
    `.table`. Raises SceneError for wrong words and what the first optimum raises.
    """
    check_job(job)
    count = whole_number(points, "points", least=2)
    high = np.inf if span is None else _ends(span)[1]
    wide = job.limited(against, high)
    several = whole_number(starts, "starts")
    X = [wide.point(start), *wide.random(several, whole_number(seed, "seed", least=0) + 1)[: several - 1]]
    log = DesignLog(wide, resume=resume)
    found: list[Optimum | None] = []
    status: list[str] = []

    def done() -> str:
        return f"{len(found)} of {count} points are done, "

    with log.interruptible(done), progress_bar(boolean(progress, "progress")) as bar:
        task = bar.add_task("points", total=count)

        def told(search: ScaledProblem, _: int) -> None:
            bar.update(task, description=progress_text(search, "points"), completed=len(found))

        best = optimise_from(wide, log, X, "gradient", told=told)
        found.append(best)
        status.append(OK)
        if span is None:
            most = max(
                best.answers[a.name] for a in wide.answers
                if a.role == "limit" and a.column.split("[")[0] == against and np.isfinite(a.high)
            )  # fmt: skip
            if most <= 0.0:
                raise SceneError(
                    f"{against} is {format_number(most)} at the optimum: give a span of limits for it"
                )
            span = most / SPAN, most
        limits = np.geomspace(span[1], span[0], count)
        way = ScaledProblem(wide, log, "gradient, start 1")
        for limit in limits[1:].tolist():
            try:
                near = _ahead(way, found)
                found.append(optimise_from(job.limited(against, limit), log, [near], "gradient", told=told))
                status.append(OK)
            except KsdError as why:
                found.append(None)
                status.append(str(why))
    return Front(job, against, limits, tuple(found), tuple(status))


def _ahead(search: ScaledProblem, found: list[Optimum | None]) -> Array:
    """Where the next point is looked for (P,): as far beyond the last one as that is from the one before, if designs there
    have answers; else at the last one."""
    good = [search.scaled(np.array(list(p.design.values()))) for p in found if p is not None]
    last = search.x(good[-1])
    if len(found) < 2 or None in found[-2:]:
        return last
    ahead = search.x(2 * good[-1] - good[-2])
    return ahead if search.log.batch(ahead, by=search.by).status[0] == OK else last


def _ends(span: Any) -> tuple[float, float]:
    low, high = (number(v, "span") for v in span) if np.shape(span) == (2,) else (1.0, 0.0)
    if not 0.0 < low < high:
        raise SceneError(f"span = {show(span)}: give the least and the most of the limit, both positive")
    return low, high


@dataclass(frozen=True, repr=False, eq=False)
class Choice(PrintableAnswer):
    """What `ksd.choose` found.

    optima: of the jobs by name, the best first, None where there is none; status: "ok" or why there is none.
    """

    optima: Mapping[str, Optimum | None]
    status: Mapping[str, str]

    @property
    def best(self) -> str:
        """Name of the best."""
        return next(iter(self.optima))

    def __getitem__(self, name: str) -> Optimum:
        found = self.optima.get(name)
        if found is None:
            raise SceneError(
                self.status.get(name, f"there is no job '{name}'; there are {', '.join(self.optima)}")
            )
        return found

    def _line(self) -> str:
        merits = (f"{n} {'-' if o is None else format_number(o.merit)}" for n, o in self.optima.items())
        return f"worst target over its scale: {', '.join(merits)}"

    def __str__(self) -> str:
        rows = [
            (
                name,
                *(
                    (format_number(o.merit, 5), str(o.evaluations), ", ".join(o.held))
                    if o
                    else ("", "", self.status[name])
                ),
            )
            for name, o in self.optima.items()
        ]
        best = "No job has an optimum" if self.optima[self.best] is None else f"Best: {self.best}"
        return format_table(("job", "worst target", "values", "<held by"), rows, best)


@clear_argument_errors
def choose(
    jobs: Mapping[str, Job],
    *,
    starts: int = 1,
    seed: int = 0,
    executor: Executor | None = None,
    resume: str | os.PathLike[str] | None = None,
    progress: bool = False,
) -> Choice:
    """The optimum of every job by name, such as one joint of the library each, the best first; returns a `Choice`.

    Their targets should be measured in the same scales. starts, seed, progress: as in `ksd.optimise`; executor: gets one
    job each; resume: a folder that keeps the designs of every job in a file of its own. Raises SceneError for what is no
    job; a job without an optimum says why. Ctrl-C raises SweepInterrupted, with a row for every job done in its `.table`.
    """
    if not isinstance(jobs, Mapping) or not jobs or not all(isinstance(j, Job) for j in jobs.values()):
        raise SceneError(f"jobs = {show(jobs)}: give jobs by name, such as {{'cross': ksd.Job(...)}}")
    check_executor(executor)
    files = _files(resume, list(jobs))
    said = [(job, starts, seed, file) for job, file in zip(jobs.values(), files, strict=True)]
    waiting = [None if executor is None else submit_task(executor, _one, *own) for own in said]
    found: dict[str, Any] = {}
    with progress_bar(boolean(progress, "progress")) as bar:
        task = bar.add_task("jobs", total=len(jobs))
        try:
            for name, own, waited in zip(jobs, said, waiting, strict=True):
                bar.update(task, description=f"{name}, jobs done")
                found[name] = _one(*own) if waited is None else waited.result()
                bar.update(task, completed=len(found))
        except KeyboardInterrupt:
            for one in waiting:
                if one is not None:
                    one.cancel()
            done = f"{len(found)} of {len(jobs)} jobs are done, the rows of these are"
            raise SweepInterrupted(done, _table_of(found), resume) from None
    order = sorted(found, key=lambda n: -found[n].merit if isinstance(found[n], Optimum) else np.inf)
    return Choice(
        {n: found[n] if isinstance(found[n], Optimum) else None for n in order},
        {n: OK if isinstance(found[n], Optimum) else str(found[n]) for n in order},
    )


def _files(folder: Any, names: list[str]) -> list[Path | None]:
    """A file for the designs of every job; raises SceneError where the folder is none."""
    if folder is None:
        return [None] * len(names)
    if not isinstance(folder, str | os.PathLike) or not Path(folder).is_dir():
        raise SceneError(
            f"resume = {show(folder)}: give a folder that is there; every job keeps a file in it"
        )
    return [
        Path(folder) / f"{k + 1}_{re.sub('[^A-Za-z0-9]+', '_', name)}.jsonl" for k, name in enumerate(names)
    ]


def _table_of(found: Mapping[str, Any]) -> Table:
    """A row per job that is done: its worst target, parameters, and status."""
    rows = [
        {"job": name, "merit": one.merit, **one.design, "status": OK}
        if isinstance(one, Optimum)
        else {"job": name, "status": str(one)}
        for name, one in found.items()
    ]
    return Table.of_rows(rows, ("job",), name="choice")


def _one(job: Job, starts: int, seed: int, resume: Path | None) -> Any:
    """The optimum of a job, or why there is none."""
    try:
        return optimise(job, starts=starts, seed=seed, resume=resume)
    except KsdError as why:
        return str(why)
