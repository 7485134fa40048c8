"""An empty cache of kernels is filled for the first answer, by a process that is killed and another.

    python benchmarks/empty_cache.py

Compiles all kernels once, which takes a minute or two; says what is wrong, and exits with 1, where a kernel of the first
answer is not compiled ahead of it, is compiled twice, or gives another force than the usual cache.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from ksd.numerics.cache import cache_name

TESTS = Path(__file__).resolve().parents[1] / "tests"
AHEAD = "from ksd.solvers.precompile import precompile_kernels; precompile_kernels()"
ANSWER = """
from scenes import fourbar
import ksd
print(ksd.solve(fourbar(), top=0.1, method="full").forces["top"])
"""
KERNELS = (
    "strain_condense", "strain_tangent", "_move_nodes", "strain_recover", "solve_blocks", "factor_blocks", "add_terms",
    "add_loads", "member_tangent", "read_joint_motions", "_worst_leaf", "_condense_blocks", "_recover_blocks",
    "place_internal_blocks",
)  # fmt: skip


def mistakes(cache: Path) -> list[str]:
    """What goes wrong with the cache in this folder."""
    usual = os.environ | {"PYTHONPATH": os.pathsep.join([str(TESTS), *sys.path])}
    given = usual | {"KSD_CACHE_DIR": str(cache), "NUMBA_NUM_THREADS": "1", "NUMBA_DISABLE_JIT": "0"}
    folder = cache / cache_name()

    def compiled() -> list[str]:
        return [file.name for file in folder.rglob("*.nbc")]

    def force(environment: dict[str, str]) -> str:
        command = [sys.executable, "-c", ANSWER]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=True).stdout

    killed = subprocess.Popen([sys.executable, "-c", AHEAD], env=given)
    while not compiled() and killed.poll() is None:
        time.sleep(0.1)
    killed.send_signal(signal.SIGKILL)
    found = [] if killed.wait() == -signal.SIGKILL else ["the first process was done before it was killed"]
    subprocess.run([sys.executable, "-c", AHEAD], env=given, check=True)
    ahead = compiled()
    found += [
        f"force {a} with the new cache, {b} with the usual one"
        for a, b in [(force(given), force(usual))]
        if a != b
    ]
    for when, files in (("ahead", ahead), ("in all", compiled())):
        counts = {name: sum(f".{name}-" in file for file in files) for name in KERNELS}
        found += [f"{name}: compiled {n} times {when}" for name, n in counts.items() if n != 1]
    return found


def main() -> int:
    """Print what is wrong; 1 where anything is."""
    with tempfile.TemporaryDirectory() as folder:
        found = mistakes(Path(folder))
    print("\n".join(found) or "every kernel once, ahead of the answer, which is the usual one")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())
