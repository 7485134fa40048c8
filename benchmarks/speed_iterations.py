"""Time of one iteration and of its parts, by calling the compiled kernels directly."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from common import STROKE, element_mesh, fourbar, summarise_times

import ksd
from ksd.model.arrays import Arrays, State, Workspace, make_workspace
from ksd.model.newton import RTOL, assemble, solve_equilibrium, take_step
from ksd.numerics.blocks import backward_blocks, factor_blocks, solve_blocks
from ksd.solvers.five_step_solver import CLOSURE_TOLERANCE
from ksd.solvers.five_steps import run_five_steps
from ksd.solvers.steps import MAX_TURN_PER_STEP

TARGET = np.array([STROKE])
WARM_UP_ROUNDS = 3
CALLS_IN_A_ROW = 9


class System(NamedTuple):
    """A system to iterate: its arrays, the state it starts from, storage, and two iteration counts.

    Both counts must be below what the state needs to converge.
    """

    arrays: Arrays
    start: State
    work: Workspace
    counts: tuple[int, int]


def systems() -> dict[str, System]:
    """The fourbar (reading 1) at d = 0.3 m: full from rest, reduced from the closed loops."""
    found = {}
    for name, mesh in (("5 elements", element_mesh(5)), ("strain-mode", ksd.Mesh())):
        solver = ksd.prepare(fourbar(1), mesh=mesh)
        b = solver.five_steps.storage
        # steps 1 and 2
        run_five_steps(b, TARGET, "kinematic", 0, CLOSURE_TOLERANCE, solver.five_steps.limits)
        arrays, reduced = b.model.arrays, b.bodies.reduced
        found[f"full, {name}"] = System(arrays, b.model.rest.copy(), b.full_work, (1, 4))
        found[f"reduced, {name}"] = System(reduced, b.reduced_state.copy(), b.reduced_work, (0, 2))
    model = ksd.compile_scene(fourbar(1), mesh=element_mesh(5, mip=False, nodal=True))
    baseline = System(model.arrays, model.rest.copy(), make_workspace(model.arrays), (1, 4))
    found["full, 5 elements, nodal plain Newton"] = baseline
    return found


class _Clock:
    """Thread times [us] of named pieces."""

    def __init__(self) -> None:
        self.spent: dict[str, list[float]] = {}

    def __call__(self, name: str, call: Callable[[], Any]) -> None:
        begin = time.thread_time_ns()
        call()
        self.spent.setdefault(name, []).append(1e-3 * (time.thread_time_ns() - begin))


def _run(system: System, motion: State, most: int) -> float:
    """Thread time [us], the median of CALLS_IN_A_ROW after one that is not counted: the call itself costs more than an
    iteration of the reduced mechanism, and the first call even more."""
    spent = []
    for _ in range(CALLS_IN_A_ROW + 1):
        motion.assign(system.start)
        begin = time.thread_time_ns()
        solve_equilibrium(
            system.arrays, motion, TARGET, 1.0, system.work, RTOL, most, MAX_TURN_PER_STEP, math.inf
        )
        spent.append(1e-3 * (time.thread_time_ns() - begin))
    return statistics.median(spent[1:])


def _time_pieces(system: System, motion: State, clock: _Clock) -> None:
    arrays, work = system.arrays, system.work
    plan, blocks = arrays.plan, len(arrays.plan.size)
    motion.assign(system.start)
    nothing = partial(backward_blocks, plan.ints, work.matrix, work.scaled_rows, work.rhs, 0)
    nothing()  # the first of a kind finds the caches cold
    clock("call", nothing)
    clock("assembly", lambda: assemble(arrays, motion, TARGET, 1.0, work, RTOL, 0, 10.0))
    clock("factorisation", lambda: factor_blocks(plan.ints, work.matrix, work.scaled_rows, blocks))
    np.negative(work.rhs, out=work.rhs)
    clock("solve", lambda: solve_blocks(plan.ints, work.matrix, work.scaled_rows, work.rhs))
    clock("update", lambda: take_step(arrays, motion, work.rhs, work, 1.0))


def iteration_costs(*, repeats: int) -> dict[str, Any]:
    """Per system: time of one iteration [us], its split, what calling from Python adds, and sizes.

    An iteration is assembly, factorisation, solve and update. Its time is that of counts[1] iterations minus
    that of counts[0], over the difference, so in compiled code without the call. The pieces are called from
    Python one by one, and the time of a call that does nothing is subtracted. Systems are measured in turns.
    """
    cases = systems()
    motions = {name: s.start.copy() for name, s in cases.items()}
    clocks = {name: _Clock() for name in cases}
    whole: dict[str, list[float]] = {name: [] for name in cases}
    for _ in range(WARM_UP_ROUNDS + repeats):
        for name, s in cases.items():
            few, many = (_run(s, motions[name], most) for most in s.counts)
            whole[name].append((many - few) / (s.counts[1] - s.counts[0]))
            _time_pieces(s, motions[name], clocks[name])
    return {name: _row(s, whole[name], clocks[name]) for name, s in cases.items()}


def _row(system: System, whole: list[float], clock: _Clock) -> dict[str, Any]:
    pieces = {name: summarise_times(spent[WARM_UP_ROUNDS:]).median for name, spent in clock.spent.items()}
    call = pieces.pop("call")
    split = {name: spent - call for name, spent in pieces.items()}
    return {
        "iteration": summarise_times(whole[WARM_UP_ROUNDS:]).numbers(),
        "split_us": split,
        "call_from_python_us": call,
        "members": len(system.arrays.members.kind),
        "unknowns": int(system.arrays.plan.unknowns),
    }
