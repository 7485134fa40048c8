"""Run the ways to a case in turns, put the error beside the time, and say so in a table, in words and in numbers."""

from __future__ import annotations

import math
import os
import platform
import statistics
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.table import Table

import ksd
from ksd.bench.suite import FINEST, Case, Way, ways_of
from ksd.errors import ConvergenceError, KsdError
from ksd.model.compile import Model, compile_scene
from ksd.solve.configuration import Configuration
from ksd.solve.conventional import solve_conventional
from ksd.solve.solver import Solver
from ksd.solve.steps import percent

WARM = 2
"""Rounds not counted."""
SLOW, LONGEST = 2e4, 1e6
"""Ways whose first call takes longer than SLOW us are repeated less, at least thrice and not beyond LONGEST us in all."""
BRIEF, BURST = 2e3, 5
"""Of calls shorter than BRIEF [us] the mean of BURST in a row is taken, after one that is not timed: as in a loop over one
mechanism they do not pay for what another way left in the processor's caches. Longer ones fill these themselves."""


ERRORS = {
    "force_error": "drive force",
    "displacement_error": "displacement",
    "stiffness_error": "support stiffness",
}
"""The three errors of a row and how they are called."""
GOOD = {"force_error": 1e-3, "stiffness_error": 1e-2}
"""What the comparison at equal accuracy asks for."""
ROUNDING = 1e-9
"""Errors below are not told apart."""


@dataclass(frozen=True)
class Row:
    """One way to a case. Thread times [us] as (lower quartile, median, upper quartile): of the whole call, and
    of the compiled steps alone. Errors are relative to the converged state: largest drive force error over the
    largest force, largest link displacement error over the largest displacement, worst support stiffness of
    the case's point. nan where unknown; failed: why it did not converge. passes: over all leaf springs, each a condensation.
    """

    method: str
    leaves: str
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
    """All rows of one case, how often every way was run, and the drive forces [N or Nm] of the converged state."""

    case: str
    repeats: int
    rows: tuple[Row, ...]
    forces: Mapping[str, float]


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
    exact = converged(compile_scene(scene, mesh=FINEST), targets, extrapolate=True)
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
    rounds = {k: rounds_of(first[k], repeats) for k in results}
    calls, steps = in_turns({k: ways[k] for k in results}, rounds)
    for k, c in results.items():
        times = (quartiles(calls[k]), quartiles(steps[k]), first[k])
        rows[k] = _row(ways[k], c, times, (exact, right, case))
    return Measured(case.name, repeats, tuple(r for r in rows if r is not None), dict(exact.forces))


def converged(model: Model, targets: Mapping[str, float], *, extrapolate: bool) -> Configuration:
    """The state errors are counted from: conventional, or full where that does not arrive."""
    try:
        return solve_conventional(model, targets)
    except ConvergenceError:
        return Solver(model, extrapolate=extrapolate)(targets, method="full", relinearisations=1)


def rounds_of(took: float, repeats: int) -> int:
    """How often a way is timed whose first call took so many us, compilation perhaps among them."""
    return repeats if took <= SLOW else max(3, min(repeats, int(LONGEST / took)))


def in_turns(
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
        # nothing to be wrong about where drives hold the link in every direction
        stiffness = float(np.abs(_supports(c, case)[kept] / right[kept] - 1).max(initial=0.0))
    except KsdError:
        stiffness = math.nan
    return Row(
        way.method, way.leaves, way.size, c.iterations, call, steps, first,
        float(np.abs(forces - wanted).max() / np.abs(wanted).max()), float(off / moved), stiffness,
        bool(c.stable), way.note, passes=passes_of(c),
    )  # fmt: skip


def passes_of(c: Configuration) -> int:
    """How often a solve went over all leaves: condensations of step 2, and every look at the equilibrium of everything."""
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
    return Row(way.method, way.leaves, way.size, 0, none, none, math.nan, *errors, False, way.note, why)


def machine() -> dict[str, Any]:
    """Date, processor, versions; nothing that identifies the computer."""
    found: dict[str, Any] = {
        "date": date.today().isoformat(),
        "processor": _processor(),
        "logical_cores": os.cpu_count(),
        "load_average": round(os.getloadavg()[0], 1) if hasattr(os, "getloadavg") else None,
        "python": platform.python_version(),
        "ksd": ksd.__version__,
    }
    for package in ("numpy", "numba"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "unknown"
    return found


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    named = [s.split(":", 1)[1].strip() for s in lines if s.startswith("model name")]
    return named[0] if named else platform.machine()


def good(row: Row) -> bool:
    """Whether a row is stable and within GOOD."""
    return row.stable and all(getattr(row, key) <= bound for key, bound in GOOD.items())


def cheapest(rows: Iterable[Row]) -> list[Row]:
    """For every method the cheapest row within GOOD, by the time of a whole call."""
    found: dict[str, Row] = {}
    for row in rows:
        if good(row) and (row.method not in found or row.call[1] < found[row.method].call[1]):
            found[row.method] = row
    return sorted(found.values(), key=lambda r: r.call[1])


def unbeaten(points: Iterable[tuple[float, float]]) -> list[int]:
    """Numbers of the points (time, error) that no other beats in both, by rising time."""
    kept: list[int] = []
    known = list(points)
    for n in sorted(range(len(known)), key=known.__getitem__):
        # less than 1 % better is rounding, not accuracy
        if not kept or known[n][1] < 0.99 * known[kept[-1]][1]:
            kept.append(n)
    return kept


def front(rows: Iterable[Row], key: str) -> list[Row]:
    """Stable rows that no other beats in time and in the error `key`, by rising time."""
    known = [r for r in rows if r.stable and math.isfinite(r.call[1]) and math.isfinite(getattr(r, key))]
    return [known[n] for n in unbeaten((r.call[1], max(getattr(r, key), ROUNDING)) for r in known)]


def numbers(results: Sequence[Measured]) -> dict[str, Any]:
    """Everything for JSON: "machine", and per case its rows as in `Row`; what is not finite is None."""
    cases = {
        m.case: {
            "repeats": m.repeats,
            "rows": [_clean(asdict(r)) for r in m.rows],
        }
        for m in results
    }
    return {
        "machine": machine(),
        "times": "thread CPU time [us]: lower quartile, median, upper",
        "cases": cases,
    }


def _clean(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _clean(v) for k, v in value.items()}
    if isinstance(value, tuple | list):
        return [_clean(v) for v in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def table(measured: Measured) -> Any:
    """A rich table of one case: * marks a way on the front of any error, ! an unstable state."""
    marked = {id(r) for key in ERRORS for r in front(measured.rows, key)}
    found = Table(box=box.SIMPLE_HEAD, title=measured.case, title_justify="left", pad_edge=False)
    for i, name in enumerate(
        ("method", "leaves", "it.", "call [us]", "steps [us]", "force", "displ.", "stiffness")
    ):
        found.add_column(name, justify="left" if i < 2 else "right", no_wrap=True)
    before = measured.rows[0]
    for r in measured.rows:
        if r.leaves != before.leaves:
            found.add_section()
        before = r
        if r.failed:
            found.add_row(r.method, r.leaves, *["-"] * 5, "failed")
            continue
        name = r.method + " *" * (id(r) in marked) + " !" * (not r.stable)
        times = [f"{r.call[1]:.0f}", f"{r.steps[1]:.0f}"]
        found.add_row(
            name, r.leaves, str(r.iterations), *times, *[f"{percent(getattr(r, key))} %" for key in ERRORS]
        )
    return found


def summary(measured: Measured) -> list[str]:
    """What the rows say in words: the cheapest way of each method within GOOD, and ratios on equal meshes."""
    rows = cheapest(measured.rows)
    found = [f"{r.method}: {r.call[1]:.0f} us with {r.leaves}" for r in rows]
    said = "; ".join(found) if found else "no way"
    lines = [f"Within 0.1 % of the force and 1 % of the support stiffness: {said}."]
    for leaves in dict.fromkeys(r.leaves for r in measured.rows):
        times = {r.method: r.call[1] for r in measured.rows if r.leaves == leaves and not r.failed}
        parts = [
            f"{' / '.join(f'{times[base] / times[m]:.1f}' for m in ('full', 'reduced'))} times as fast as {name}"
            for base, name in (("plain Newton", "plain Newton"), ("conventional", "conventional in space"))
            if base in times and "full" in times and "reduced" in times
        ]
        if parts:
            lines.append(f"{leaves}: full / reduced {', '.join(parts)}.")
    return lines
