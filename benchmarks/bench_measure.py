"""Time the methods of a case in turns, compute their errors, and report both as a table, a summary and numbers for JSON."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from bench_scenes import Case, Variant, case_variants
from rich import box
from rich.table import Table
from rich.text import Text

from ksd.cli.bench import machine_facts
from ksd.errors import KsdError
from ksd.library.result_files import json_object
from ksd.model.compile import compile_scene
from ksd.solvers.configuration import Configuration
from ksd.solvers.steps import percent
from ksd.study.compare import (
    REFERENCE_MESH,
    quartiles,
    reference_configuration,
    round_count,
    time_in_turns,
)

ERROR_LABELS = {
    "force_error": "drive force",
    "displacement_error": "displacement",
    "stiffness_error": "support stiffness",
}
"""Labels of the three errors of a measurement, by field."""
ERROR_LIMITS = {"force_error": 1e-3, "stiffness_error": 1e-2}
"""Limits of the comparison at equal accuracy."""
ROUNDING_ERROR = 1e-9
"""Errors below this count as equal."""


@dataclass(frozen=True)
class Measurement:
    """One method with one leaf model on a case.

    Thread times [us] as (lower quartile, median, upper quartile): call, of the whole call; steps, of the compiled steps.
    Errors are relative to the reference configuration: largest drive force error over the largest force, largest link
    displacement error over the largest displacement, worst support stiffness of the point of the case; nan where unknown.
    failed: why it did not converge. passes: evaluations of all leaf springs, each a condensation.
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
class CaseResult:
    """Measurements of one case, number of timed rounds, and drive forces [N or Nm] of the reference configuration."""

    case: str
    repeats: int
    rows: tuple[Measurement, ...]
    forces: Mapping[str, float]


def measure(case: Case, *, quick: bool = False, repeats: int = 15) -> CaseResult:
    """Measure every method with every leaf model on `case`, in turns after WARM_UP_ROUNDS rounds.

    Those that do not converge have a measurement with the reason, and no times.
    """
    variants = list(case_variants(case, quick=quick))
    scene, targets = case.build()
    reference = reference_configuration(compile_scene(scene, mesh=REFERENCE_MESH), targets, extrapolate=True)
    reference_stiffness = _support_stiffness(reference, case)
    rows: list[Measurement | None] = [None] * len(variants)
    results: dict[int, Configuration] = {}
    first: dict[int, float] = {}
    for k, variant in enumerate(variants):
        begin = time.thread_time_ns()
        try:
            results[k] = variant.solve()
            first[k] = 1e-3 * (time.thread_time_ns() - begin)
        except KsdError as error:
            rows[k] = _failed(variant, str(error))
    rounds = {k: round_count(first[k], repeats) for k in results}
    calls, steps = time_in_turns({k: variants[k].solve for k in results}, rounds)
    for k, pose in results.items():
        times = (quartiles(calls[k]), quartiles(steps[k]), first[k])
        rows[k] = _measurement(variants[k], pose, times, reference, reference_stiffness, case)
    return CaseResult(case.name, repeats, tuple(r for r in rows if r is not None), dict(reference.forces))


def _support_stiffness(pose: Configuration, case: Case) -> np.ndarray:
    """Support stiffness (6,) of the point of the case, drives held; inf where a drive holds it."""
    return np.array(list(pose.stiffness(case.link, at=case.at).supports.values()))


def _measurement(
    variant: Variant,
    pose: Configuration,
    times: tuple[tuple[float, float, float], tuple[float, float, float], float],
    reference: Configuration,
    reference_stiffness: np.ndarray,
    case: Case,
) -> Measurement:
    """The measurement of a solved variant; times [us]: quartiles of calls and of steps, and the first call."""
    links = len(reference.model.scene.links)
    forces, reference_forces = (np.array(list(p.forces.values())) for p in (pose, reference))
    x = reference.motion.x[:links]
    largest_displacement = np.linalg.norm(x - reference.model.rest.x[:links], axis=1).max()
    difference = np.linalg.norm(pose.motion.x[:links] - x, axis=1).max()
    try:
        finite = np.isfinite(reference_stiffness)
        # no error where drives hold the link in every direction
        ratios = _support_stiffness(pose, case)[finite] / reference_stiffness[finite]
        stiffness_error = float(np.abs(ratios - 1).max(initial=0.0))
    except KsdError:
        stiffness_error = math.nan
    return Measurement(
        variant.method, variant.leaves, variant.size, pose.iterations, *times,
        float(np.abs(forces - reference_forces).max() / np.abs(reference_forces).max()),
        float(difference / largest_displacement), stiffness_error,
        bool(pose.stable), variant.note, passes=leaf_evaluations(pose),
    )  # fmt: skip


def leaf_evaluations(pose: Configuration) -> int:
    """How often a solve evaluated all leaf springs: condensations of step 2, and evaluations of the full equilibrium."""
    count = 0
    for step in pose.steps:
        if step.name[0] == "2":
            count += 1
        elif step.name[0] == "5":
            count += step.iterations + 1
        elif step.name == "equilibrium":
            # one more evaluation at the end of every load step; the note begins with their number
            count += step.iterations + int(step.note.split()[0])
    return count


def _failed(variant: Variant, reason: str) -> Measurement:
    """The measurement of a variant that did not converge."""
    unknown = (math.nan,) * 3
    return Measurement(
        variant.method, variant.leaves, variant.size, 0, unknown, unknown, math.nan, *unknown, False,
        variant.note, reason,
    )  # fmt: skip


def is_accurate(row: Measurement) -> bool:
    """Whether a measurement is stable and within ERROR_LIMITS."""
    return row.stable and all(getattr(row, key) <= bound for key, bound in ERROR_LIMITS.items())


def fastest_accurate(rows: Iterable[Measurement]) -> list[Measurement]:
    """The fastest measurement of every method within ERROR_LIMITS, by the median time of a call."""
    fastest: dict[str, Measurement] = {}
    for row in rows:
        if is_accurate(row) and (row.method not in fastest or row.call[1] < fastest[row.method].call[1]):
            fastest[row.method] = row
    return sorted(fastest.values(), key=lambda r: r.call[1])


def pareto_indices(points: Iterable[tuple[float, float]]) -> list[int]:
    """Indices of the points (time, error) that are not dominated by another one, by increasing time."""
    front: list[int] = []
    known = list(points)
    for n in sorted(range(len(known)), key=known.__getitem__):
        # less than 1 % better is rounding, not accuracy
        if not front or known[n][1] < 0.99 * known[front[-1]][1]:
            front.append(n)
    return front


def pareto_rows(rows: Iterable[Measurement], key: str) -> list[Measurement]:
    """Stable measurements on the Pareto front of time and the error `key`, by increasing time."""
    known = [r for r in rows if r.stable and math.isfinite(r.call[1]) and math.isfinite(getattr(r, key))]
    return [
        known[n] for n in pareto_indices((r.call[1], max(getattr(r, key), ROUNDING_ERROR)) for r in known)
    ]


def json_results(results: Sequence[CaseResult]) -> dict[str, Any]:
    """Results for JSON: "machine", and per case the fields of its measurements; numbers that are not finite are None."""
    cases = {m.case: {"repeats": m.repeats, "rows": [asdict(r) for r in m.rows]} for m in results}
    times = "thread CPU time [us]: lower quartile, median, upper"
    return json_object({"machine": machine_facts(), "times": times, "cases": cases})


def table(measured: CaseResult) -> Any:
    """A rich table of one case: * marks the Pareto front of time and any error, ! an unstable state."""
    marked = {id(r) for key in ERROR_LABELS for r in pareto_rows(measured.rows, key)}
    grid = Table(box=box.SIMPLE_HEAD, title=measured.case, title_justify="left", padding=(0, 1, 0, 0))
    heads = (
        "method",
        "leaves",
        "it.",
        "call\n[us]",
        "steps\n[us]",
        "force\n[%]",
        "displ.\n[%]",
        "stiffness\n[%]",
    )
    for i, name in enumerate(heads):
        grid.add_column(Text(name), justify="left" if i < 2 else "right", no_wrap=True)
    before = measured.rows[0]
    for r in measured.rows:
        if r.leaves != before.leaves:
            grid.add_section()
        before = r
        if r.failed:
            grid.add_row(r.method, r.leaves, *["-"] * 5, "failed")
            continue
        name = r.method + " *" * (id(r) in marked) + " !" * (not r.stable)
        numbers = (str(r.iterations), f"{r.call[1]:.0f}", f"{r.steps[1]:.0f}")
        grid.add_row(name, r.leaves, *numbers, *(percent(getattr(r, key)) for key in ERROR_LABELS))
    return grid


def summary(measured: CaseResult) -> list[str]:
    """Sentences about a case: fastest measurement of each method within ERROR_LIMITS, and time ratios on equal meshes."""
    rows = fastest_accurate(measured.rows)
    fastest = "; ".join(f"{r.method}: {r.call[1]:.0f} us with {r.leaves}" for r in rows) or "no way"
    lines = [f"Within 0.1 % of the force and 1 % of the support stiffness: {fastest}."]
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
