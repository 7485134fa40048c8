"""The log of a job: every evaluated design, kept and, from a file, replayed."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ksd.answers.printing import progress_bar
from ksd.checks import boolean
from ksd.optimisation.job import DesignAnswers, Job
from ksd.study.arguments import check_executor
from ksd.study.questions import Row
from ksd.study.resume import ResumeFile
from ksd.study.sweep import SweepInterrupted
from ksd.study.table import Table

Array = np.ndarray
BLOCK_SIZE = 32
"""Designs evaluated together; an interruption loses at most one block."""
NO_DESIGN = ("slopes", "finer mesh")
"""Beginnings of keys of other entries than designs."""


class DesignLog:
    """Evaluates designs of a job and keeps every one: parameters, answers, status ("ok" or why not), and a label `by`.

    resume: a file of JSON lines that keeps the designs; those in it are not computed again. executor: gets blocks of
    designs. progress: whether a progress bar is shown. rows: those of the designs requested from this log, by key. Raises
    SceneError for the file of another job.
    """

    def __init__(
        self,
        job: Job,
        *,
        resume: str | os.PathLike[str] | None = None,
        executor: Executor | None = None,
        progress: bool = False,
    ) -> None:
        check_executor(executor)
        boolean(progress, "progress")
        self.job, self.executor, self.progress = job, executor, progress
        self.file = ResumeFile(resume, job.fingerprint, what="job")
        sizes = {key: len(job.parameters) if key.startswith("slopes") else 1 for key in self.file.entries}
        for key, size in sizes.items():
            rows = self.file.entries[key]
            if len(rows) != size or any(not set(job.names) <= set(row) for row in rows):
                # the hash is right, but no log writes such rows: computed again
                del self.file.entries[key]
        self.rows: dict[str, Row] = {}

    @contextmanager
    def interruptible(self, progress: Callable[[], str] = lambda: "") -> Iterator[None]:
        """Context in which Ctrl-C raises SweepInterrupted with all designs; progress: the beginning of its message."""
        try:
            yield
        except KeyboardInterrupt:
            raise SweepInterrupted(
                f"{progress()}the designs done are", self.table(), self.file.path
            ) from None

    def batch(self, X: ArrayLike, *, by: str = "") -> DesignAnswers:
        """Answers of designs X (D, P) as by `Job.batch`; a design is on disk when its block is done."""
        X = np.atleast_2d(np.asarray(X, float))
        keys = [self._key(x) for x in X]
        first_index = {key: k for k, key in reversed(list(enumerate(keys)))}
        new = sorted(k for key, k in first_index.items() if key not in self.file.entries)
        with progress_bar(self.progress and len(new) > 1) as bar:
            task = bar.add_task(by or "designs", total=len(new))
            for first in range(0, len(new), BLOCK_SIZE):
                block = new[first : first + BLOCK_SIZE]
                answers = self.job.batch(X[block], executor=self.executor)
                for k, values, status in zip(block, *answers, strict=True):
                    self._add(keys[k], X[k], values, status, by)
                bar.advance(task, len(block))
        rows = [self._requested_row(key) for key in keys]
        return DesignAnswers(
            np.array([[row[n] for n in self.job.names] for row in rows]),
            tuple(str(row["status"]) for row in rows),
        )

    def values(self, x: ArrayLike, *, by: str = "") -> Array:
        """Answers (answers,) of a design x (P,), nan where it has none."""
        return self.batch(x, by=by).values[0]

    def slopes(self, x: ArrayLike, *, by: str = "") -> tuple[Array, Array]:
        """Answers (answers,) of a design as by `values`, and their slopes (answers, P); raises what `Job.slopes` raises."""
        x = np.asarray(x, float)
        values, key = self.values(x, by=by), f"slopes {self._key(x)}"
        if key not in self.file.entries:
            slopes = self.job.slopes(x)[1]
            self.file.add(key, [dict(zip(self.job.names, s.tolist(), strict=True)) for s in slopes.T])
        rows = self.file.entries[key]
        return values, np.array([[row[n] for n in self.job.names] for row in rows]).T

    def on_finer_mesh(self, x: Array) -> DesignAnswers:
        """Answers of a design x (P,) on a finer mesh, see `Job.on_finer_mesh`."""
        key = f"finer mesh {self._key(x)}"
        if key not in self.file.entries:
            values, status = self.job.on_finer_mesh().batch(x)
            self.file.add(
                key, [dict(zip(self.job.names, values[0].tolist(), strict=True)) | {"status": status[0]}]
            )
        row = self.file.entries[key][0]
        return DesignAnswers(np.array([[row[n] for n in self.job.names]]), (str(row.get("status", "")),))

    def refuse(self, x: Array, reason: str, *, by: str = "") -> None:
        """Add a row for a design x (P,) that is not solved, as a rule has no value there; not to the file, whose entries are
        independent of rules."""
        missing = dict.fromkeys(self.job.names, np.nan)
        self.rows.setdefault(self._key(x), {**self.job.design_at(x), **missing, "by": by, "status": reason})

    def _add(self, key: str, x: Array, values: Array, status: str, by: str) -> None:
        row = {**self.job.design_at(x), **dict(zip(self.job.names, values.tolist(), strict=True))}
        self.file.add(key, [row | {"by": by, "status": status}])
        self._requested_row(key)

    def _requested_row(self, key: str) -> Row:
        """The row of a design, which is added to `rows`."""
        row: Row = self.file.entries[key][0]
        self.rows.setdefault(key, row)
        return row

    def add_from_worker(self, entries: Mapping[Any, list[Row]], rows: Mapping[str, Row]) -> None:
        """Add the entries of the file and the rows of the log of a worker, as if they had been computed here."""
        self.file.read_again()
        for key, own in entries.items():
            if key not in self.file.entries:
                self.file.add(key, own)
        for key, row in rows.items():
            self.rows.setdefault(key, row)

    def add_from_file(self, known: Collection[str]) -> None:
        """Add the designs that workers have written to the file, but those with the keys `known`."""
        self.file.read_again()
        for key in self.file.entries:
            if key not in known and not key.startswith(NO_DESIGN):
                self._requested_row(key)

    def table(self) -> Table:
        """A row per design, in the order of the first request."""
        return Table.of_rows(
            [self.job.as_told(row) for row in self.rows.values()], self.job.parameters, name="job"
        )

    def _key(self, x: Array) -> str:
        """The parameters of a design as exact hexadecimal text; with the method where it is not that of the job as given."""
        return ("conventional " if self.job.method_note else "") + " ".join(float(v).hex() for v in x)
