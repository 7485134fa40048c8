"""Jobs of a training run: parallel on any executor, with every result stored at once so that a run can be resumed."""

from __future__ import annotations

import hashlib
import io
import shutil
from concurrent.futures import Executor, Future, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from ksd.answers.printing import progress_bar
from ksd.errors import KsdError, RecordError, SceneError
from ksd.files import read_file, write_file
from ksd.library.record_files import make_parent_folder
from ksd.numerics.processes import process_pool, spawn_context
from ksd.scene import DrawnJoint
from ksd.scene.scene import fingerprint
from ksd.training.sampling import Samples, SamplingPlan, sample_joint

WORKERS = 2
"""Processes used without an executor."""
ROUNDING_TOLERANCE = 1e-7
"""Difference of a sampled function that a different order of summation may cause."""
CHECKSUM_SIZE = 32
"""Bytes of the checksum before a stored result."""


@dataclass(frozen=True)
class Job:
    """One joint to be sampled by a plan; may_be_impossible: it is outside the family, so that sampling it may fail."""

    joint: DrawnJoint
    plan: SamplingPlan
    may_be_impossible: bool = False

    def key(self) -> str:
        """Name of its stored result: a hash of the joint and the plan."""
        return fingerprint((self.joint, self.plan))[:20]


def run_job(job: Job) -> Samples:
    """Sample the joint of a job, the function that other processes run; empty where an impossible joint is allowed."""
    try:
        return sample_joint(job.joint, job.plan)
    except SceneError:
        if job.may_be_impossible:
            return {}
        raise


class Jobs:
    """Runs jobs and stores every result in `folder`; a context manager owning its processes and its progress bar.

    The first stored result of an earlier run that is read is computed again: where it differs by more than
    ROUNDING_TOLERANCE, the code has changed since and no stored result is used.
    """

    def __init__(
        self, folder: Path, *, executor: Executor | None, resume: bool, progress: bool, title: str
    ) -> None:
        self.folder, self.resume = folder, resume
        self._given = executor
        self._pool: Executor | None = None
        self._closing = ExitStack()
        self._bar = progress_bar(progress)
        self._task = self._bar.add_task(title, total=0)
        self._made: set[Path] = set()
        self._total = 0
        self._trusted = False

    def __enter__(self) -> Jobs:
        self._bar.start()
        return self

    def __exit__(self, kind: type | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self._bar.stop()
        if isinstance(self._pool, ThreadPoolExecutor):
            self._pool.shutdown(wait=kind is None, cancel_futures=True)
        self._closing.__exit__(kind, error, trace)

    def _add_to_total(self, count: int) -> None:
        """Add `count` jobs to the progress bar."""
        self._total += count
        self._bar.update(self._task, total=self._total)

    def run(self, jobs: list[Job]) -> list[Samples]:
        """Results in the order of `jobs`; those finished in an earlier run are read back."""
        self._add_to_total(len(jobs))
        results = {}
        if self.resume:
            results = {i: stored for i, job in enumerate(jobs) if (stored := self._load(job)) is not None}
        self._bar.advance(self._task, len(results))
        earlier = [i for i in results if self._path(jobs[i]) not in self._made]
        if earlier and not self._trusted:
            results = self._check_stored(jobs, results, earlier[0])
        self._compute(jobs, [i for i in range(len(jobs)) if i not in results], results)
        return [results[i] for i in range(len(jobs))]

    def _check_stored(self, jobs: list[Job], stored: dict[int, Samples], first: int) -> dict[int, Samples]:
        """The stored results where this code reproduces the `first` of them, else only what it computes for that one."""
        computed: dict[int, Samples] = {}
        self._add_to_total(1)
        self._compute(jobs, [first], computed)
        self._trusted = True
        if _equal_samples(stored[first], computed[first]):
            return stored
        self.forget()
        self._store(jobs[first], computed[first])
        return computed

    def _compute(self, jobs: list[Job], missing: list[int], results: dict[int, Samples]) -> None:
        if not missing:
            return
        executor = self._executor(jobs[missing[0]])
        futures: dict[Future[Samples], int] = {executor.submit(run_job, jobs[i]): i for i in missing}
        try:
            for done in as_completed(futures):
                i = futures[done]
                results[i] = done.result()
                self._store(jobs[i], results[i])
                self._bar.advance(self._task)
        except BrokenProcessPool as error:
            raise KsdError(
                "The training processes ended unexpectedly; finished shapes are kept. Call train under "
                "`if __name__ == '__main__':`, or give it another executor."
            ) from error
        except KeyboardInterrupt:
            again = f"the finished shapes are kept in '{self.folder}'; train it again to continue"
            raise KeyboardInterrupt(f"interrupted: {again}") from None
        finally:
            for future in futures:
                future.cancel()

    def _executor(self, job: Job) -> Executor:
        """The executor given, or two processes; threads where the job cannot be sent to another process."""
        if self._given is not None:
            return self._given
        if self._pool is None:
            # spawned, not forked: compiled kernels and threads are not safe across a fork
            context = spawn_context(job)
            if context is not None:
                self._pool = self._closing.enter_context(process_pool(context, WORKERS))
            else:
                self._pool = ThreadPoolExecutor(WORKERS)
        return self._pool

    def _path(self, job: Job) -> Path:
        return self.folder / f"{job.key()}.npz"

    def _store(self, job: Job, samples: Samples) -> None:
        buffer = io.BytesIO()
        named: dict[str, Any] = {f"{mesh}|{group}": values for (mesh, group), values in samples.items()}
        np.savez(buffer, **named)
        body = buffer.getvalue()
        place = make_parent_folder(self._path(job))
        write_file(place, hashlib.sha256(body).digest() + body, what="finished shape", error=RecordError)
        self._made.add(place)

    def _load(self, job: Job) -> Samples | None:
        """A stored result; None without one, or where its checksum does not match."""
        try:
            content = read_file(self._path(job), error=RecordError)
        except RecordError:
            return None
        if hashlib.sha256(content[CHECKSUM_SIZE:]).digest() != content[:CHECKSUM_SIZE]:
            return None
        with np.load(io.BytesIO(content[CHECKSUM_SIZE:]), allow_pickle=False) as archive:
            stored = {name: archive[name] for name in archive.files}
        samples: Samples = {}
        for name, values in stored.items():
            mesh, group = name.split("|")
            samples[int(mesh) if mesh.isdigit() else mesh, group] = values
        return samples

    def forget(self) -> None:
        """Remove all stored results."""
        shutil.rmtree(self.folder, ignore_errors=True)


def _equal_samples(one: Samples, other: Samples) -> bool:
    """Whether two results agree to rounding."""
    return one.keys() == other.keys() and all(
        one[k].shape == other[k].shape and np.abs(one[k] - other[k]).max(initial=0.0) < ROUNDING_TOLERANCE
        for k in one
    )
