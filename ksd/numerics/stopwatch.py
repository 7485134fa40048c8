"""A stopwatch for CPU time."""

from __future__ import annotations

import time


class Stopwatch:
    """A callable that returns the CPU time [s] of this thread since its last call."""

    def __init__(self) -> None:
        self._at = time.thread_time_ns()

    def __call__(self) -> float:
        before, self._at = self._at, time.thread_time_ns()
        return 1e-9 * (self._at - before)
