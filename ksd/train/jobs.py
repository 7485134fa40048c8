"""Jobs of a training run: parallel over any executor, each result kept at once, so a run can be taken up
again.
"""

from __future__ import annotations

import hashlib
import io
import shutil
from concurrent.futures import Executor, Future, ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from ksd.errors import KsdError, RecordError, SceneError
from ksd.files import read_file, write_file
from ksd.library.record_files import make_parent_folder
from ksd.numerics.processes import end_with_parent, spawn_context
from ksd.properties.printing import progress_bar
from ksd.scene import DrawnJoint
from ksd.scene.scene import fingerprint
from ksd.train.sampling import Samples, SamplingPlan, sample_joint

WORKERS = 2
ROUNDING = 1e-7
"""Difference of a sampled function that another order of sums may make."""
SEAL = 32
"""Bytes of the checksum in front of a kept result."""


@dataclass(frozen=True)
class Job:
    """One joint to be sampled as planned; `tried`: it is no part of the family and may turn out impossible."""

    joint: DrawnJoint
    plan: SamplingPlan
    tried: bool = False

    def key(self) -> str:
        """Name of its result: a hash of the joint and of how it is sampled."""
        return fingerprint((self.joint, self.plan))[:20]


def run_job(job: Job) -> Samples:
    """Sample the joint of a job; what other processes are asked to do. Nothing for one tried that is impossible."""
    try:
        return sample_joint(job.joint, job.plan)
    except SceneError:
        if job.tried:
            return {}
        raise


class Jobs:
    """Runs jobs and keeps every result in `folder`; a context manager owning its processes and its bar.

    The first kept result of an earlier run that turns up is computed again: where it comes out otherwise, by more than
    ROUNDING, the code has changed in between and nothing kept is used.
    """

    def __init__(
        self, folder: Path, *, executor: Executor | None, resume: bool, progress: bool, title: str
    ) -> None:
        self.folder, self.resume = folder, resume
        self._given = executor
        self._pool: Executor | None = None
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
        if self._pool is not None:
            self._pool.shutdown(wait=kind is None, cancel_futures=True)

    def _expect(self, more: int) -> None:
        """So many jobs more are on the bar."""
        self._total += more
        self._bar.update(self._task, total=self._total)

    def run(self, jobs: list[Job]) -> list[Samples]:
        """Results in the order of `jobs`; finished ones of an earlier run are read back."""
        self._expect(len(jobs))
        found = {}
        if self.resume:
            found = {i: kept for i, job in enumerate(jobs) if (kept := self._load(job)) is not None}
        self._bar.advance(self._task, len(found))
        earlier = [i for i in found if self._path(jobs[i]) not in self._made]
        if earlier and not self._trusted:
            found = self._rechecked(jobs, found, earlier[0])
        self._compute(jobs, [i for i in range(len(jobs)) if i not in found], found)
        return [found[i] for i in range(len(jobs))]

    def _rechecked(self, jobs: list[Job], found: dict[int, Samples], first: int) -> dict[int, Samples]:
        """The kept results where this code still gives the `first` of them, else what it gives for that one alone."""
        made: dict[int, Samples] = {}
        self._expect(1)
        self._compute(jobs, [first], made)
        self._trusted = True
        if _same(found[first], made[first]):
            return found
        self.forget()
        self._keep(jobs[first], made[first])
        return made

    def _compute(self, jobs: list[Job], missing: list[int], found: dict[int, Samples]) -> None:
        if not missing:
            return
        executor = self._executor(jobs[missing[0]])
        waiting: dict[Future[Samples], int] = {executor.submit(run_job, jobs[i]): i for i in missing}
        try:
            for done in as_completed(waiting):
                i = waiting[done]
                found[i] = done.result()
                self._keep(jobs[i], found[i])
                self._bar.advance(self._task)
        except BrokenProcessPool as error:
            raise KsdError(
                "The training processes ended unexpectedly; finished shapes are kept. Call train under "
                "`if __name__ == '__main__':`, or give it another executor."
            ) from error
        finally:
            for future in waiting:
                future.cancel()

    def _executor(self, job: Job) -> Executor:
        """The executor given, or two processes; threads where a process could not be told the job."""
        if self._given is not None:
            return self._given
        if self._pool is None:
            # spawned, not forked: compiled kernels and threads do not survive a fork safely
            context = spawn_context(job)
            if context is not None:
                self._pool = ProcessPoolExecutor(WORKERS, mp_context=context, initializer=end_with_parent)
            else:
                self._pool = ThreadPoolExecutor(WORKERS)
        return self._pool

    def _path(self, job: Job) -> Path:
        return self.folder / f"{job.key()}.npz"

    def _keep(self, job: Job, samples: Samples) -> None:
        buffer = io.BytesIO()
        named: dict[str, Any] = {f"{mesh}|{group}": values for (mesh, group), values in samples.items()}
        np.savez(buffer, **named)
        body = buffer.getvalue()
        place = make_parent_folder(self._path(job))
        write_file(place, hashlib.sha256(body).digest() + body, what="finished shape", error=RecordError)
        self._made.add(place)

    def _load(self, job: Job) -> Samples | None:
        """A kept result; None when there is none, or one with a bit out of place."""
        try:
            content = read_file(self._path(job), error=RecordError)
        except RecordError:
            return None
        if hashlib.sha256(content[SEAL:]).digest() != content[:SEAL]:
            return None
        with np.load(io.BytesIO(content[SEAL:]), allow_pickle=False) as kept:
            stored = {name: kept[name] for name in kept.files}
        samples: Samples = {}
        for name, values in stored.items():
            mesh, group = name.split("|")
            samples[int(mesh) if mesh.isdigit() else mesh, group] = values
        return samples

    def forget(self) -> None:
        """Remove all kept results."""
        shutil.rmtree(self.folder, ignore_errors=True)


def _same(one: Samples, other: Samples) -> bool:
    """Whether two results agree to rounding."""
    return one.keys() == other.keys() and all(
        one[k].shape == other[k].shape and np.abs(one[k] - other[k]).max(initial=0.0) < ROUNDING for k in one
    )
