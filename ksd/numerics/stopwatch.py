"""The CPU time of a piece of Python."""

from __future__ import annotations

import time


class Stopwatch:
    """CPU time [s] of this thread since the last call."""

    def __init__(self) -> None:
        self._at = time.thread_time_ns()

    def __call__(self) -> float:
        before, self._at = self._at, time.thread_time_ns()
        return 1e-9 * (self._at - before)
