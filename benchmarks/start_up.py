"""Time of a fresh process until its first solution, with and without compiled kernels on disk."""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
PROGRAM = """
import sys, time
from common import element_mesh, fourbar
import ksd
solver = ksd.prepare(fourbar(), mesh={mesh})
ready = time.time()
solver(top=0.3, method="{method}")
begin = float(sys.argv[1])
print(ready - begin, time.time() - begin)
"""
CASES = {
    "full, strain-mode": PROGRAM.format(mesh="None", method="full"),
    "full, 5 elements": PROGRAM.format(mesh="element_mesh(5)", method="full"),
}

DEMO = """
import sys, time, tempfile, pathlib
begin = float(sys.argv[1])
from ksd.cli import main
ready = time.time()
with tempfile.TemporaryDirectory() as place:
    main(["demo", "--json", str(pathlib.Path(place, "d.json")), "--plot", str(pathlib.Path(place, "d.png"))])
print()
print(ready - begin, time.time() - begin)
"""
"""`ksd demo`: both leaf models, every method."""


def first_solution(program: str, cache: str | None = None) -> dict[str, Any]:
    """Wall time [s] from starting a process to a prepared solver and to its first solution, and its CPU time [s].

    cache: folder of the compiled kernels (the user's own when None).
    """
    before = os.times()
    settings = {**os.environ, **({"KSD_CACHE_DIR": cache} if cache else {})}
    command = [sys.executable, "-c", program, repr(time.time())]
    done = subprocess.run(command, capture_output=True, text=True, cwd=HERE, env=settings, check=True)
    ready, solved = (float(t) for t in done.stdout.splitlines()[-1].split())
    after = os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return {"prepared_s": ready, "solved_s": solved, "cpu_s": used, "message": "compiling" in done.stderr}


def start_up() -> dict[str, Any]:
    """Medians for a warm cache, and one run with an empty one."""
    found: dict[str, Any] = {}
    for name, program in CASES.items():
        first_solution(program)
        runs = [first_solution(program) for _ in range(3)]
        found[name] = {
            key: statistics.median(r[key] for r in runs) for key in ("prepared_s", "solved_s", "cpu_s")
        }
    for name, program in (("empty cache", CASES["full, strain-mode"]), ("empty cache, demo", DEMO)):
        with tempfile.TemporaryDirectory() as empty:
            found[name] = first_solution(program, empty)
    return found
