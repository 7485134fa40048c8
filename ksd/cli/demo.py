"""`ksd demo`: the fourbar of paper 1 by every method, time and error side by side, and a picture.

Layout of the JSON file: "case" (mechanism, drive value in mm), "reference" (force in N and where it
comes from), "rows": method, leaf_model, time_us (median thread time of a solve), estimate_time_us
(of its error estimate, on top), iterations (factorisations), force_N, error_percent,
estimated_error_percent (estimates are null where the method is exact).
"""

from __future__ import annotations

import argparse
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from importlib.resources import as_file, files
from typing import Any

import numpy as np
from rich import box
from rich.table import Table
from rich.text import Text

from ksd.cli.output import STDOUT, check_json, check_plot, console, write_json
from ksd.model.compile import compile_scene
from ksd.model.leaves import Mesh
from ksd.scene.toml_file import load_scene
from ksd.solve.conventional import conventional
from ksd.solve.report import number
from ksd.solve.solver import prepare
from ksd.view import plot_mechanism, save_figure
from ksd.view.compare import Mark, plot_cost
from ksd.view.figure import new_figure

ESTIMATE = "error estimate"
"""Name of the step that is not part of the solve proper."""
REPEATS = 9
ELEMENTS = 5
"""Appendix A elements per leaf, as in the fourbar of paper 1."""
FINER = 50
"""Elements per leaf of the coarser of the two meshes behind the reference; the other has twice as many."""


@dataclass(frozen=True)
class Row:
    """One way to the same configuration: median thread time [s] of the solve and of its error estimate
    (check), iterations, force [N], relative errors."""

    method: str
    leaves: str
    time: float
    check: float
    iterations: int
    force: float
    error: float
    estimate: float | None


@dataclass(frozen=True)
class Reference:
    """What the errors are counted from: force of the drive [N], positions (links, 3) of the links [m] and how far the
    farthest has come [m]; by the Appendix A elements alone, their error, of second order, taken out by two meshes."""

    force: float
    places: np.ndarray
    moved: float
    words: str = f"{FINER} and {2 * FINER} Appendix A elements per leaf, extrapolated to infinitely many"


def run(options: argparse.Namespace) -> int:
    """Solve, print, draw. Raises RecordError without the record of the cross flexure."""
    check_json(options.json)
    check_plot(options.plot)
    with as_file(files("ksd") / "scenes" / "fourbar.toml") as path:
        mechanism, targets, _ = load_scene(path)
    scene = mechanism.scene()
    reference, shown, rows = compare(scene, targets)
    if options.json:
        write_json(numbers(reference, shown, rows), options.json)
    if options.json != STDOUT:
        _print(shown, rows)
    _draw(shown, rows, options.plot)
    if options.json != STDOUT:
        console().print(f"Picture: {options.plot}")
    return 0


def limit(scene: Any, targets: dict[str, float]) -> Reference:
    """Where ever finer chains lead to."""
    meshes = (Mesh(leaf="corotational", elements=n) for n in (FINER, 2 * FINER))
    coarse, fine = (conventional(compile_scene(scene, mesh=m), targets) for m in meshes)
    ((one, two),) = zip(coarse.forces.values(), fine.forces.values(), strict=True)
    links = fine.model.links
    x, y = coarse.motion.x[:links], fine.motion.x[:links]
    places = y + (y - x) / 3.0
    moved = np.linalg.norm(places - fine.model.rest.x[:links], axis=1).max()
    return Reference(two + (two - one) / 3.0, places, float(moved))


def compare(scene: Any, targets: dict[str, float]) -> tuple[Reference, Any, list[Row]]:
    """The reference, the configuration solved in full, and a row per method."""
    strain, chain = prepare(scene), prepare(scene, mesh=Mesh(leaf="corotational", elements=ELEMENTS))
    nodal = compile_scene(scene, mesh=Mesh(leaf="corotational", elements=ELEMENTS, mip=False, nodal=True))
    fine, coarse = "strain-mode", f"{ELEMENTS} elements"
    cases: list[tuple[str, str, Callable[[], Any]]] = [
        ("kinematic", fine, lambda: strain(targets, method="kinematic")),
        ("reduced", fine, lambda: strain(targets, method="reduced")),
        ("relinearised once", fine, lambda: strain(targets, method="reduced", relinearisations=1)),
        ("full", fine, lambda: strain(targets, method="full")),
        ("conventional", fine, lambda: strain(targets, method="conventional")),
        ("reduced", coarse, lambda: chain(targets, method="reduced")),
        ("full", coarse, lambda: chain(targets, method="full")),
        ("conventional", coarse, lambda: chain(targets, method="conventional")),
        ("conventional, Newton", coarse, lambda: conventional(nodal, targets)),
    ]
    reference = limit(scene, targets)
    rows, shown = [], None
    for method, leaves, solve in cases:
        solve()
        results = [solve() for _ in range(REPEATS)]
        rows.append(_row(method, leaves, results, reference))
        shown = results[0] if (method, leaves) == ("full", fine) else shown
    return reference, shown, rows


def _row(method: str, leaves: str, results: list[Any], reference: Reference) -> Row:
    result = results[0]
    spent = [sum(s.time for s in r.steps if s.name == ESTIMATE) for r in results]
    time = statistics.median(r.time - s for r, s in zip(results, spent, strict=True))
    count = sum(s.iterations for s in result.steps if s.name != ESTIMATE)
    (force,) = result.forces.values()
    off = np.linalg.norm(result.motion.x[: len(reference.places)] - reference.places, axis=1).max()
    error = max(abs(force / reference.force - 1), off / reference.moved)
    estimate = None if result.method_error is None else result.method_error.relative
    return Row(method, leaves, time, statistics.median(spent), count, force, float(error), estimate)


def numbers(reference: Reference, shown: Any, rows: list[Row]) -> dict[str, Any]:
    """The table as plain numbers, for JSON."""
    ((drive, value),) = shown.targets.items()
    return {
        "case": {"mechanism": shown.model.scene.name, "drive": drive, "value_mm": 1e3 * value},
        "reference": {"force_N": reference.force, "leaf_model": reference.words},
        "rows": [
            {
                "method": r.method,
                "leaf_model": r.leaves,
                "time_us": 1e6 * r.time,
                "estimate_time_us": None if r.estimate is None else 1e6 * r.check,
                "iterations": r.iterations,
                "force_N": r.force,
                "error_percent": 100 * r.error,
                "estimated_error_percent": None if r.estimate is None else 100 * r.estimate,
            }
            for r in rows
        ],
    }


_COLUMNS = (
    "method", "leaves", "time\n[us]", "factor-\nisations", "force\n[N]", "\nerror", "\nestimated",
    "found in\n[us]",
)  # fmt: skip


def _print(shown: Any, rows: list[Row]) -> None:
    screen = console()
    ((drive, value),) = shown.targets.items()
    screen.print(f"{shown.model.scene.name}: drive '{drive}' at {1e3 * value:.6g} mm", style="bold")
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for i, name in enumerate(_COLUMNS):
        table.add_column(Text(name), justify="left" if i < 2 else "right")
    for before, r in zip([rows[0], *rows[:-1]], rows, strict=True):
        if before.leaves != r.leaves:
            table.add_section()
        estimate = "-" if r.estimate is None else f"{number(100 * r.estimate, 2)} %"
        table.add_row(
            r.method,
            r.leaves,
            number(1e6 * r.time, 3),
            str(r.iterations),
            f"{r.force:.3f}",
            f"{number(100 * r.error, 2)} %",
            estimate,
            "-" if r.estimate is None else number(1e6 * r.check, 3),
        )
    screen.print(table)
    screen.print(
        "Time: median thread time, kernels loaded. Error: the larger of force and displacement error,\n"
        "against the limit of finer meshes. Estimated: what the solve itself says of it, apart from its mesh, and the\n"
        "time that takes. Elements: Appendix A of Dwarshuis et al. (2020), per leaf; Newton: plain, as in\n"
        "its Appendix B, instead of mixed integration points."
    )


def _draw(shown: Any, rows: list[Row], path: str) -> None:
    figure = new_figure(12.0, 4.6)
    left, right = figure.subplots(1, 2, width_ratios=(1.35, 1.0))
    ((_, value),) = shown.targets.items()
    plot_mechanism(
        shown, axes=left, title=f"Compliant fourbar moved {1e3 * value:.4g} mm; undeformed in grey"
    )
    plot_cost(
        right,
        [Mark(r.method, r.leaves, r.time, r.error) for r in rows],
        title="What each method costs and misses",
    )
    save_figure(figure, path)
