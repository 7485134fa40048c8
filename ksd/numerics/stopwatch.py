"""The CPU time of a piece of Python."""

from __future__ import annotations

import time

from ksd.numerics.kernel import readied_ns


def thread_ns() -> int:
    """CPU time [ns] of this thread without what went into getting kernels ready; differences of it mean something."""
    return time.thread_time_ns() - readied_ns()


class Stopwatch:
    """CPU time [s] of this thread since the last call, without what went into getting kernels ready."""

    def __init__(self) -> None:
        self._at = thread_ns()

    def __call__(self) -> float:
        before, self._at = self._at, thread_ns()
        return 1e-9 * (self._at - before)
