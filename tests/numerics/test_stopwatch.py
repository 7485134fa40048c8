"""The CPU time of a solve is without that of compiling or loading its kernels."""

import time

import ksd.numerics.kernel as compiler
from ksd.numerics.kernel import kernel, readied_ns
from ksd.numerics.stopwatch import Stopwatch


@kernel
def _sum_of_squares(n):
    total = 0.0
    for i in range(n):
        total += i * i
    return total


def test_getting_kernels_ready_does_not_count():
    before, begin, clock = readied_ns(), time.thread_time_ns(), Stopwatch()
    assert _sum_of_squares(4) == 14.0
    told, whole, readied = clock(), 1e-9 * (time.thread_time_ns() - begin), 1e-9 * (readied_ns() - before)
    assert readied > 0.0
    assert told <= whole - readied + 1e-3
    assert clock() < told + readied


def test_kernels_within_kernels_count_once():
    """One within another, as when a compiled function needs an entry point, is not counted twice."""
    before, begin = readied_ns(), time.thread_time_ns()
    with compiler._keeping(), compiler._keeping():
        sum(range(200_000))
    assert readied_ns() - before <= time.thread_time_ns() - begin
