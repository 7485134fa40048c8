"""The CPU time of a piece of Python."""

from __future__ import annotations

import time

from ksd.numerics.kernel import readied_ns


class Stopwatch:
    """CPU time [s] of this thread since the last call, without what went into getting kernels ready."""

    def __init__(self) -> None:
        self._at, self._readied = time.thread_time_ns(), readied_ns()

    def __call__(self) -> float:
        now, readied = time.thread_time_ns(), readied_ns()
        spent = now - self._at - (readied - self._readied)
        self._at, self._readied = now, readied
        return 1e-9 * spent
