"""The thread's CPU clock inside compiled code, so that steps of one compiled call can be timed apart."""

from __future__ import annotations

import time

from ksd.numerics.kernel import external, kernel

_CLOCK = getattr(time, "CLOCK_THREAD_CPUTIME_ID", -1)

if _CLOCK >= 0:
    _read = external("clock_gettime", "int32(int32, CPointer(int64))")

    @kernel
    def thread_time(buffer):
        """CPU time of this thread [s]; buffer (2,) int64 is scratch."""
        _read(_CLOCK, buffer.ctypes)
        return float(buffer[0]) + 1e-9 * float(buffer[1])

else:

    @kernel
    def thread_time(buffer):
        """No such clock on this system: 0, and steps are not timed apart."""
        return 0.0 * float(buffer[0])
