"""The log of a job: every evaluated design, written down and replayed."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import Executor
from contextlib import contextmanager
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ksd.checks import boolean
from ksd.design.arguments import check_executor
from ksd.design.job import Job, Judged
from ksd.design.questions import Row
from ksd.design.resume import ResumeFile
from ksd.design.sweep import SweepInterrupted
from ksd.design.table import Table
from ksd.properties.printing import progress_bar

Array = np.ndarray
BLOCK_SIZE = 32
"""Designs evaluated between two looks at the keyboard."""


class DesignLog:
    """Evaluates designs of a job and writes every one down: parameters, answers, "ok" or why not, and who asked.

    resume: a file of JSON lines that keeps them; what is in it is replayed, not computed. executor: gets blocks of designs.
    Raises SceneError for a file of another job.
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
                # right by its hash, but not what a log writes: computed again
                del self.file.entries[key]
        self.rows: dict[str, Row] = {}

    @property
    def count(self) -> int:
        """How many designs were evaluated or replayed."""
        return len(self.rows)

    @contextmanager
    def interruptible(self, done: Callable[[], str] = lambda: "") -> Iterator[None]:
        """Ctrl-C inside raises SweepInterrupted with all designs; done: what else is said."""
        try:
            yield
        except KeyboardInterrupt:
            raise SweepInterrupted(f"{done()}the designs done are", self.table(), self.file.path) from None

    def batch(self, X: ArrayLike, *, by: str = "") -> Judged:
        """`Job.batch`, block by block, each design on disk when its block is done."""
        X = np.atleast_2d(np.asarray(X, float))
        keys = [_key(x) for x in X]
        at = {key: k for k, key in reversed(list(enumerate(keys)))}
        new = sorted(k for key, k in at.items() if key not in self.file.entries)
        with progress_bar(self.progress and len(new) > 1) as bar:
            task = bar.add_task(by or "designs", total=len(new))
            for first in range(0, len(new), BLOCK_SIZE):
                block = new[first : first + BLOCK_SIZE]
                judged = self.job.batch(X[block], executor=self.executor)
                for k, values, status in zip(block, *judged, strict=True):
                    self._keep(keys[k], X[k], values, status, by)
                bar.advance(task, len(block))
        found = [self._read(key) for key in keys]
        return Judged(
            np.array([[row[n] for n in self.job.names] for row in found]),
            tuple(str(row["status"]) for row in found),
        )

    def values(self, x: ArrayLike, *, by: str = "") -> Array:
        """`Job.values`."""
        return self.batch(x, by=by).values[0]

    def slopes(self, x: ArrayLike, *, by: str = "") -> tuple[Array, Array]:
        """Answers (answers,) of a design, as `values` has them, and slopes of `Job.slopes`; raises what that raises."""
        x = np.asarray(x, float)
        values, key = self.values(x, by=by), f"slopes {_key(x)}"
        if key not in self.file.entries:
            slopes = self.job.slopes(x)[1]
            self.file.add(key, [dict(zip(self.job.names, s.tolist(), strict=True)) for s in slopes.T])
        rows = self.file.entries[key]
        return values, np.array([[row[n] for n in self.job.names] for row in rows]).T

    def _keep(self, key: str, x: Array, values: Array, status: str, by: str) -> None:
        row = {**self.job.design_at(x), **dict(zip(self.job.names, values.tolist(), strict=True))}
        self.file.add(key, [row | {"by": by, "status": status}])
        self._read(key)

    def _read(self, key: str) -> Row:
        """The row of a design, noted as asked for."""
        row: Row = self.file.entries[key][0]
        self.rows.setdefault(key, row)
        return row

    def add_from_worker(self, found: Mapping[Any, list[Row]]) -> None:
        """Designs and slopes that the log of a worker holds, as if they had been computed here."""
        for key, rows in found.items():
            if key not in self.file.entries:
                self.file.add(key, rows)
            if not key.startswith("slopes"):
                self._read(key)

    def table(self) -> Table:
        """Every design, in the order it was first asked for."""
        return Table.of_rows(list(self.rows.values()), self.job.parameters, name="job")


def _key(x: Array) -> str:
    return " ".join(float(v).hex() for v in x)
