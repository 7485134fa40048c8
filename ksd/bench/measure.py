"""Run the ways to a case in turns and put the error beside the time."""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ksd.bench.engines import EngineRow, measure_engines
from ksd.bench.floor import one_pass
from ksd.bench.suite import Case
from ksd.bench.ways import FINEST, Way, ways_of
from ksd.errors import ConvergenceError, KsdError
from ksd.model.compile import compile_scene
from ksd.solve.configuration import Configuration
from ksd.solve.conventional import conventional
from ksd.solve.solver import Solver

WARM = 2
"""Rounds not counted."""
SLOW, LONGEST = 2e4, 1e6
"""Ways whose first call takes longer than SLOW us are repeated less, at least thrice and not beyond LONGEST us in all."""
BRIEF, BURST = 2e3, 5
"""Of calls shorter than BRIEF [us] the mean of BURST in a row is taken, after one that is not timed: as in a loop over one
mechanism they do not pay for what another way left in the processor's caches. Longer ones fill these themselves."""


@dataclass(frozen=True)
class Row:
    """One way to a case. Thread times [us] as (lower quartile, median, upper quartile): of the whole call, and
    of the compiled steps alone. Errors are relative to the converged state: largest drive force error over the
    largest force, largest link displacement error over the largest displacement, worst support stiffness of
    the case's point. nan where unknown; failed: why it did not converge. passes: over all leafs, each a condensation.
    """

    method: str
    leafs: str
    size: int
    iterations: int
    call: tuple[float, float, float]
    steps: tuple[float, float, float]
    first_us: float
    force_error: float
    displacement_error: float
    stiffness_error: float
    stable: bool
    note: str = ""
    failed: str = ""
    passes: int = 0


@dataclass(frozen=True)
class Measured:
    """All rows of one case, how often every way was run, what other engines took, and, by leaf model, operations and bytes
    of one pass over all leafs, in words."""

    case: str
    repeats: int
    rows: tuple[Row, ...]
    engines: tuple[EngineRow, ...] = ()
    floors: Mapping[str, str] = field(default_factory=dict)


def quartiles(spent: Sequence[float]) -> tuple[float, float, float]:
    """Lower quartile, median, upper quartile."""
    if len(spent) < 2:
        return (spent[0],) * 3
    low, middle, high = statistics.quantiles(spent, n=4, method="inclusive")
    return low, middle, high


def measure(case: Case, *, quick: bool = False, repeats: int = 15) -> Measured:
    """Every way to `case`, run in turns after WARM rounds that do not count.

    Ways that do not converge have a row that says why, and no times.
    """
    ways = list(ways_of(case, quick=quick))
    scene, targets = case.build()
    exact = _converged(scene, targets)
    right = _supports(exact, case)
    rows: list[Row | None] = [None] * len(ways)
    results: dict[int, Configuration] = {}
    first: dict[int, float] = {}
    for k, way in enumerate(ways):
        begin = time.thread_time_ns()
        try:
            results[k] = way.solve()
            first[k] = 1e-3 * (time.thread_time_ns() - begin)
        except KsdError as error:
            rows[k] = _failed(way, str(error))
    rounds = {k: _rounds(first[k], repeats) for k in results}
    calls, steps = _in_turns({k: ways[k] for k in results}, rounds)
    for k, c in results.items():
        times = (quartiles(calls[k]), quartiles(steps[k]), first[k])
        rows[k] = _row(ways[k], c, times, (exact, right, case))
    other: list[EngineRow] = []
    if case.engines:
        force = next(iter(exact.forces.values()))
        other = measure_engines(scene, targets, force, elements=case.engines[:1] if quick else case.engines)
    floors = {ways[k].leafs: str(one_pass(c.model.arrays)) for k, c in results.items() if c.method == "full"}
    return Measured(case.name, repeats, tuple(r for r in rows if r is not None), tuple(other), floors)


def _converged(scene: Any, targets: dict[str, float]) -> Configuration:
    """The state errors are counted from: finest leafs, conventional, or full where that does not arrive."""
    try:
        return conventional(compile_scene(scene, mesh=FINEST), targets)
    except ConvergenceError:
        return Solver(scene, mesh=FINEST, extrapolate=True)(targets, method="full", passes=1)


def _rounds(took: float, repeats: int) -> int:
    """How often a way is timed whose first call took so many us, compilation perhaps among them."""
    return repeats if took <= SLOW else max(3, min(repeats, int(LONGEST / took)))


def _in_turns(
    ways: dict[int, Way], rounds: dict[int, int]
) -> tuple[dict[int, list[float]], dict[int, list[float]]]:
    """Thread times [us] of the calls and of their steps; way k is timed rounds[k] times after the warm-up."""
    several = dict.fromkeys(ways, BURST)
    calls: dict[int, list[float]] = {k: [] for k in ways}
    steps: dict[int, list[float]] = {k: [] for k in ways}
    for turn in range(WARM + max(rounds.values(), default=0)):
        for k, way in ways.items():
            # the slow ones have no need of a warm-up
            warm = WARM if rounds[k] > 3 else 0
            if turn >= warm + rounds[k]:
                continue
            if turn >= warm and several[k] > 1:
                way.solve()
            inside = 0.0
            begin = time.thread_time_ns()
            for _ in range(several[k]):
                inside += way.solve().time
            took, inside = 1e-3 * (time.thread_time_ns() - begin) / several[k], inside / several[k]
            several[k] = BURST if took < BRIEF else 1
            if turn >= warm:
                calls[k].append(took)
                steps[k].append(1e6 * inside)
    return calls, steps


def _supports(c: Configuration, case: Case) -> np.ndarray:
    """Support stiffness of the case's point in all six directions, drives held; inf where a drive holds it."""
    return np.array(list(c.stiffness(case.link, at=case.at).supports.values()))


def _row(way: Way, c: Configuration, times: Any, truth: tuple[Configuration, np.ndarray, Case]) -> Row:
    exact, right, case = truth
    call, steps, first = times
    links = len(exact.model.scene.links)
    forces, wanted = (np.array(list(x.forces.values())) for x in (c, exact))
    moved = np.linalg.norm(exact.motion.x[:links] - exact.model.rest.x[:links], axis=1).max()
    off = np.linalg.norm(c.motion.x[:links] - exact.motion.x[:links], axis=1).max()
    try:
        kept = np.isfinite(right)
        stiffness = float(np.abs(_supports(c, case)[kept] / right[kept] - 1).max())
    except KsdError:
        stiffness = math.nan
    return Row(
        way.method, way.leafs, way.size, c.iterations, call, steps, first,
        float(np.abs(forces - wanted).max() / np.abs(wanted).max()), float(off / moved), stiffness,
        bool(c.stable), way.note, passes=passes_of(c),
    )  # fmt: skip


def passes_of(c: Configuration) -> int:
    """How often a solve went over all leafs: condensations of step 2, and every look at the equilibrium of everything."""
    count = 0
    for step in c.steps:
        if step.name[0] == "2":
            count += 1
        elif step.name[0] == "5":
            count += step.iterations + 1
        elif step.name == "equilibrium":
            # one look more at the end of every load step; the note begins with their number
            count += step.iterations + int(step.note.split()[0])
    return count


def _failed(way: Way, why: str) -> Row:
    none = (math.nan,) * 3
    errors = (math.nan,) * 3
    return Row(way.method, way.leafs, way.size, 0, none, none, math.nan, *errors, False, way.note, why)
