"""Long use of one process: memory after many new scenes, and one prepared solver in several threads.

python benchmarks/robust_use.py [--quick]
"""

from __future__ import annotations

import argparse
import gc
import sys
import threading
from pathlib import Path

import numpy as np

import ksd

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from scenes import cross_flexure, fourbar

MAX_GROWTH_MB = 20
"""Largest growth that does not count as a leak."""


def resident_memory() -> float:
    """Memory of this process [MB]."""
    import resource

    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def memory_growth(scenes: int) -> float:
    """Growth [MB] over so many new scenes, after some that fill the caches of fixed size and compile."""

    def solved(number: int) -> None:
        ksd.solve(fourbar(joint=cross_flexure(thickness=1e-3 * (1.0 + 1e-4 * number))), top=0.1)

    for number in range(30):
        solved(number)
    gc.collect()
    begin = resident_memory()
    for number in range(30, 30 + scenes):
        solved(number)
    gc.collect()
    return resident_memory() - begin


def thread_differences(calls: int, workers: int = 2) -> int:
    """How many of the forces that `workers` threads get from one solver differ from those of one thread."""
    solver, values = ksd.prepare(fourbar()), np.linspace(0.02, 0.1, calls)

    def forces(some: np.ndarray) -> list[float]:
        return [solver(top=float(v), method="reduced").forces["top"] for v in some]

    expected, found = forces(values), {}
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        started = [
            threading.Thread(target=lambda k=k: found.update({k: forces(values[k::workers])}))
            for k in range(workers)
        ]
        for thread in started:
            thread.start()
        for thread in started:
            thread.join()
    finally:
        sys.setswitchinterval(before)
    return sum(
        one != other
        for k in range(workers)
        for one, other in zip(found[k], expected[k::workers], strict=True)
    )


def main() -> int:
    """Print the counts; returns 1 where one exceeds its limit."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true")
    quick = parser.parse_args().quick
    scenes, calls = (200, 300) if quick else (1500, 3000)
    more, wrong = memory_growth(scenes), thread_differences(calls)
    print(f"memory: {more:.1f} MB more after {scenes} new scenes (at most {MAX_GROWTH_MB})")
    print(f"threads: {wrong} of {calls} forces wrong of one solver in two threads (0)")
    return int(more > MAX_GROWTH_MB or wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
