"""What a solve of the fourbar costs and misses: time per iteration and its split, whole solves, start-up.

    python benchmarks/speed.py [--quick] [--no-start-up] [--out FOLDER] [--readme README.md]

Everything is thread CPU time in one process, cases measured in turns, warm-up left out; start-up is the wall time of
fresh processes. Writes speed.json, speed.md (the tables) and speed.png (error over time), and with --readme
replaces the table between the markers of that file.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common import (
    FINEST,
    READINGS,
    STROKE,
    PlainNewton,
    Times,
    chain,
    fourbar,
    machine,
    options,
    times_of,
    write_json,
)
from speed_report import insert_table, markdown, picture, readme_table
from start_up import start_up

import ksd
from ksd.model.system import assemble, solve_step, take_step
from ksd.numerics.blocks import backward_blocks, factor_blocks, solve_blocks
from ksd.solve import pipeline
from ksd.solve.conventional import CAP, RTOL, conventional
from ksd.solve.newton import iterate

TARGETS = {"top": STROKE}


class Timed:
    """Thread times [us] of named pieces, gathered in turns."""

    def __init__(self) -> None:
        self.spent: dict[str, list[float]] = {}

    def __call__(self, name: str, call: Callable[[], Any]) -> Any:
        begin = time.thread_time_ns()
        result = call()
        self.spent.setdefault(name, []).append(1e-3 * (time.thread_time_ns() - begin))
        return result

    def times(self, *, skip: int) -> dict[str, Times]:
        """Medians and quartiles, the first `skip` rounds left out."""
        return {name: times_of(values[skip:]) for name, values in self.spent.items()}


def iteration(arrays: Any, motion: Any, work: Any, *, counts: tuple[int, int], repeats: int) -> dict[str, Any]:
    """Cost of one iteration (assembly, factorisation, solve, update) of a prepared system, from the state `motion`.

    The time of `counts[1]` iterations minus that of `counts[0]`, in compiled code without the call; then its pieces
    one by one, called from Python, the cost of passing the arrays subtracted. `motion` is left as it was.
    """
    target, kept, timed = np.array([STROKE]), motion.copy(), Timed()
    raw: dict[str, list[float]] = {"iteration": []}
    for _ in range(repeats + 3):
        ends = []
        for most in counts:
            motion.assign(kept)
            begin = time.thread_time_ns()
            iterate(arrays, motion, target, 1.0, work, RTOL, most, CAP, np.inf)
            ends.append(1e-3 * (time.thread_time_ns() - begin))
        raw["iteration"].append((ends[1] - ends[0]) / (counts[1] - counts[0]))
        motion.assign(kept)
        _pieces(timed, arrays, motion, work, target)
    motion.assign(kept)
    found = {"iteration": times_of(raw["iteration"][3:]).numbers(), "unknowns": int(arrays.plan.unknowns)}
    found["members"] = len(arrays.members.kind)
    pieces = {name: t.median for name, t in timed.times(skip=3).items()}
    calls = {"all arrays": pieces.pop("call"), "matrix only": pieces.pop("call of a solve")}
    net = {n: t - calls["all arrays" if n in ("assembly", "update") else "matrix only"] for n, t in pieces.items()}
    return {**found, "split_us": net, "call_from_python_us": calls}


def _pieces(timed: Timed, arrays: Any, motion: Any, work: Any, target: np.ndarray) -> None:
    plan, blocks = arrays.plan, len(arrays.plan.size)
    timed("call", lambda: iterate(arrays, motion, target, 1.0, work, RTOL, -1, CAP, np.inf))
    timed("call of a solve", lambda: backward_blocks(plan, work.value, work.spare, work.rhs, 0))
    timed("assembly", lambda: assemble(arrays, motion, target, 1.0, work, RTOL, 0))
    timed("factorisation", lambda: factor_blocks(plan, work.value, work.spare, blocks))
    np.negative(work.rhs, out=work.rhs)
    timed("solve", lambda: solve_blocks(plan, work.value, work.spare, work.rhs))
    timed("update", lambda: take_step(arrays, motion, work.rhs, work, 1.0))


def iterations(*, repeats: int) -> dict[str, Any]:
    """Cost of one iteration: full and reduced, Appendix A elements n = 5 and strain-mode leafs, reading 1."""
    found = {}
    for name, mesh in (("n = 5", chain(5)), ("strain-mode", ksd.Mesh())):
        solver = ksd.prepare(fourbar(1), mesh=mesh)
        solver(TARGETS, method="conventional")
        b = solver.bench
        b.restart()
        found[f"full, {name}"] = iteration(b.model.arrays, b.full, b.full_work, counts=(1, 4), repeats=repeats)
        pipeline.close(b, np.array([STROKE]))
        pipeline.linearise(b, near=1, first=True)
        reduced = b.bodies.reduced
        found[f"reduced, {name}"] = iteration(reduced, b.reduced, b.reduced_work, counts=(0, 2), repeats=repeats)
    model = ksd.compile_scene(fourbar(1), mesh=chain(5, mip=False, nodal=True))
    work = ksd.solve.conventional.make_work(model.arrays) if hasattr(ksd.solve, "conventional") else None
    from ksd.model.arrays import make_work

    work = make_work(model.arrays)
    assemble(model.arrays, model.rest.copy(), np.array([0.0]), 1.0, work, RTOL, 0)
    solve_step(model.arrays, work)
    found["full, n = 5, every element node"] = iteration(
        model.arrays, model.rest.copy(), work, counts=(1, 4), repeats=repeats
    )
    return found
