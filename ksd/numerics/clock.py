"""The thread's CPU clock inside compiled code, so that steps of one compiled call can be timed apart.

Reading it is a system call, as long as a small step; the clock of the wall is thirty times cheaper. So a call reads the
CPU clock twice and the wall's between its steps, and shares the CPU time out as the wall's went (`share_time`).
"""

from __future__ import annotations

import time

from ksd.numerics.kernel import external, kernel

_CPU, _WALL = (getattr(time, name, -1) for name in ("CLOCK_THREAD_CPUTIME_ID", "CLOCK_MONOTONIC"))

if min(_CPU, _WALL) >= 0:
    _read = external("clock_gettime", "int32(int32, CPointer(int64))")

    @kernel
    def thread_time(buffer):
        """CPU time of this thread [s]; buffer (2,) int64 is scratch."""
        _read(_CPU, buffer.ctypes)
        return float(buffer[0]) + 1e-9 * float(buffer[1])

    @kernel
    def wall_time(buffer):
        """Time [s] that passes for everybody; buffer (2,) int64 is scratch."""
        _read(_WALL, buffer.ctypes)
        return float(buffer[0]) + 1e-9 * float(buffer[1])

else:

    @kernel
    def thread_time(buffer):
        """No such clock on this system: 0, and steps are not timed apart."""
        return 0.0 * float(buffer[0])

    @kernel
    def wall_time(buffer):
        """As `thread_time`."""
        return 0.0 * float(buffer[0])


@kernel
def share_time(spent, cpu, wall):
    """Turn the wall times spent (rows,) [s] of the steps into CPU times, given both of the whole call."""
    if wall > 0.0:
        for row in range(len(spent)):
            spent[row] *= cpu / wall
