"""Ctrl-C at random moments, again and again, on everything that owns a pool of processes; nothing may hang or be left.

    python benchmarks/interrupts.py [--count 50] [--load 2] [--quick]

Training of a joint on chains of 40 elements, whose results do not fit into a pipe, and a sweep of many
paths are interrupted by a signal to the whole process group, as a terminal sends it, while `--load` other processes keep
the cores busy. Counts the runs that did not end within LIMIT seconds, did not end by the interruption, or left a process
behind. An interruption that falls into a callback of LLVM while numba loads a kernel ends as an error of numba's.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
LIMIT = 60.0
TRAIN = """
import sys, math, ksd
from ksd.training import train
print("ready", flush=True)
shapes = {"angle": (math.radians(44), math.radians(46)), "width_ratio": (0.9, 1.1)}
while True:
    train("cross_flexure", shapes=shapes, meshes=("strain", 40), out=sys.argv[1], resume=False, progress=False)
"""
SWEEP = """
import numpy as np, ksd
from importlib.resources import files
from ksd.scene.toml_file import load_scene
mechanism, targets, _ = load_scene(files("ksd") / "scenes" / "fourbar.toml")
(drive,) = targets
print("ready", flush=True)
loads = {f"case {i}": [dict(link=mechanism.scene().links[1], moment=(0, 0, 1e-4 * i))] for i in range(400)}
while True:
    ksd.sweep(mechanism, {drive: np.linspace(0, targets[drive], 60)}, loads=loads, progress=False)
"""
CASES = {"train": TRAIN, "sweep": SWEEP}


def interrupted(code: str, folder: str, wait: float) -> str:
    """What was wrong with one interrupted run, empty where nothing was."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    run = subprocess.Popen(
        [sys.executable, "-c", code, folder],
        env=environment,
        start_new_session=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert run.stdout is not None
    run.stdout.readline()
    time.sleep(wait)
    os.killpg(run.pid, signal.SIGINT)
    try:
        _, errors = run.communicate(timeout=LIMIT)
    except subprocess.TimeoutExpired:
        os.killpg(run.pid, signal.SIGKILL)
        run.communicate()
        return f"hung after {wait:.2f} s"
    last = errors.strip().splitlines()[-1] if errors.strip() else ""
    if "Interrupt" not in last and "no compiled object yet" not in last:
        return f"ended with {run.returncode} after {wait:.2f} s: {last}"
    if errors.count("Traceback") > 1 and "During handling" not in errors and "direct cause" not in errors:
        return f"more than one traceback after {wait:.2f} s:\n{errors}"
    end = time.monotonic() + LIMIT
    while time.monotonic() < end:
        try:
            os.killpg(run.pid, 0)
        except ProcessLookupError:
            return ""
        time.sleep(0.2)
    os.killpg(run.pid, signal.SIGKILL)
    return f"left processes after {wait:.2f} s"


def main() -> int:
    """Returns the number of runs with something wrong."""
    words = argparse.ArgumentParser()
    words.add_argument("--count", type=int, default=50, help="interruptions of each kind")
    words.add_argument("--load", type=int, default=2, help="processes that keep the cores busy")
    words.add_argument("--quick", action="store_true")
    asked = words.parse_args()
    count, rng, wrong = 5 if asked.quick else asked.count, random.Random(0), 0
    load = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(asked.load)]
    try:
        with tempfile.TemporaryDirectory() as folder:
            for name, code in CASES.items():
                found = [interrupted(code, folder, rng.uniform(0.0, 12.0)) for _ in range(count)]
                bad = [words for words in found if words]
                wrong += len(bad)
                print(f"{name}: {count} interruptions, {len(bad)} wrong", *bad, sep="\n  ", flush=True)
    finally:
        for process in load:
            process.kill()
            process.wait()
    return wrong


if __name__ == "__main__":
    sys.exit(main())
