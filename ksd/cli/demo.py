"""`ksd demo`: the fourbar of paper 1 by every method, time and error side by side, and a picture.

Layout of the JSON file: "case" (mechanism, drive value in mm), "reference" (force in N and where it
comes from), "rows": method, leaf_model, time_us (median thread time of a solve), estimate_time_us
(of its error estimate, on top), iterations (factorisations), force_N, error_percent,
estimated_error_percent (estimates are null where the method is exact).
"""

from __future__ import annotations

import argparse
from importlib.resources import as_file, files
from multiprocessing.context import SpawnContext
from typing import Any

from rich import box
from rich.table import Table
from rich.text import Text

from ksd.answers.printing import format_number
from ksd.cli.output import STDOUT, check_json, check_plot, console, write_json
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.numerics.processes import process_pool, spawn_context
from ksd.scene.toml_file import load_scene
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.solver import solve
from ksd.study.compare import MethodResult, Reference, compared_methods, measure_methods, reference_from
from ksd.view import plot_mechanism, save_figure
from ksd.view.cost_plot import Mark, plot_cost
from ksd.view.figure import new_figure

REPEATS = 9
ELEMENTS = 5
"""Appendix A elements per leaf, as in the fourbar of paper 1."""
REFERENCE_ELEMENTS = 50
"""Elements per leaf of the coarser of the two meshes of the reference; the finer has twice as many."""
OMITTED_METHODS = ("constant", "modal")
"""Methods the demo leaves out."""


def run(options: argparse.Namespace) -> int:
    """Solve, print, draw. Raises RecordError without the record of the cross flexure."""
    check_json(options.json)
    check_plot(options.plot)
    with as_file(files("ksd") / "scenes" / "fourbar.toml") as path:
        mechanism, targets, _ = load_scene(path)
    scene = mechanism.scene()
    reference, shown, rows = reference_and_rows(scene, targets)
    if options.json:
        write_json(as_dict(reference, shown, rows), options.json)
    if options.json != STDOUT:
        _print(shown, rows)
    _draw(shown, rows, options.plot)
    if options.json != STDOUT:
        console().print(f"Picture: {options.plot}")
    return 0


def extrapolated_reference(scene: Any, targets: dict[str, float]) -> Reference:
    """The reference: Richardson extrapolation (second order) of chains of two meshes."""
    counts = (REFERENCE_ELEMENTS, 2 * REFERENCE_ELEMENTS)
    meshes = (Mesh(leaf="corotational", elements=n) for n in counts)
    coarse, fine = (solve_conventional(compile_scene(scene, mesh=m), targets) for m in meshes)
    forces = {n: f + (f - coarse.forces[n]) / 3.0 for n, f in fine.forces.items()}
    one, two = reference_from(coarse, ""), reference_from(fine, "")
    places = two.positions + (two.positions - one.positions) / 3.0
    words = f"{counts[0]} and {counts[1]} Appendix A elements per leaf, extrapolated to infinitely many"
    return Reference(
        forces,
        places,
        two.largest_displacement + (two.largest_displacement - one.largest_displacement) / 3.0,
        words,
    )


def reference_and_rows(scene: Any, targets: dict[str, float]) -> tuple[Reference, Any, list[MethodResult]]:
    """The reference, the configuration by method `full`, and a row per method."""
    cases = compared_methods(scene, targets, Mesh(), ELEMENTS)
    shown = [case for case in cases if case.method not in OMITTED_METHODS]
    # on an empty kernel cache, chains and strain-mode leaves compile in parallel
    with process_pool(spawn_context(scene, targets) or SpawnContext(), 1) as others:
        pending = others.submit(extrapolated_reference, scene, targets)
        full = solve(scene, targets, method="full")
        reference = pending.result()
    return reference, full, measure_methods(shown, scene.name, reference, REPEATS, report_error=False)


def as_dict(reference: Reference, shown: Any, rows: list[MethodResult]) -> dict[str, Any]:
    """The table as plain numbers, for JSON."""
    ((drive, value),) = shown.targets.items()
    return {
        "case": {"mechanism": shown.model.scene.name, "drive": drive, "value_mm": 1e3 * value},
        "reference": {"force_N": _drive_force(reference.forces), "leaf_model": reference.description},
        "rows": [
            {
                "method": r.method,
                "leaf_model": r.leaves,
                "time_us": 1e6 * r.steps_time,
                "estimate_time_us": None if r.estimated_error is None else 1e6 * r.estimate_time,
                "iterations": r.factorisations,
                "force_N": _drive_force(r.forces),
                "error_percent": 100 * r.error,
                "estimated_error_percent": None if r.estimated_error is None else 100 * r.estimated_error,
            }
            for r in rows
        ],
    }


def _drive_force(forces: Any) -> float:
    """Force of the only drive [N]."""
    (force,) = forces.values()
    return float(force)


_COLUMNS = (
    "method", "leaves", "time\n[us]", "factor-\nisations", "force\n[N]", "\nerror", "\nestimated",
    "found in\n[us]",
)  # fmt: skip


def _print(shown: Any, rows: list[MethodResult]) -> None:
    """Print the results by method; shown: a Configuration of the scene with one drive."""
    screen = console()
    ((drive, value),) = shown.targets.items()
    screen.print(f"{shown.model.scene.name}: drive '{drive}' at {1e3 * value:.6g} mm", style="bold")
    table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
    for i, name in enumerate(_COLUMNS):
        table.add_column(Text(name), justify="left" if i < 2 else "right")
    for before, r in zip([rows[0], *rows[:-1]], rows, strict=True):
        if before.leaves != r.leaves:
            table.add_section()
        estimate = "-" if r.estimated_error is None else f"{format_number(100 * r.estimated_error, 2)} %"
        table.add_row(
            r.method,
            r.leaves,
            format_number(1e6 * r.steps_time, 3),
            str(r.factorisations),
            f"{_drive_force(r.forces):.3f}",
            f"{format_number(100 * r.error, 2)} %",
            estimate,
            "-" if r.estimated_error is None else format_number(1e6 * r.estimate_time, 3),
        )
    screen.print(table)
    screen.print(
        "Time: median thread time, kernels loaded. Error: the larger of force and displacement error,\n"
        "against the limit of finer meshes. Estimated: what the solve itself says of it, apart from its mesh, and the\n"
        "time that takes. Elements: Appendix A of Dwarshuis et al. (2020), per leaf; Newton: plain, as in\n"
        "its Appendix B, instead of mixed integration points."
    )


def _draw(shown: Any, rows: list[MethodResult], path: str) -> None:
    """Write a picture of the mechanism, and of time against error by method, to `path`."""
    figure = new_figure(12.0, 4.6)
    left, right = figure.subplots(1, 2, width_ratios=(1.35, 1.0))
    ((_, value),) = shown.targets.items()
    plot_mechanism(
        shown, axes=left, title=f"Compliant fourbar moved {1e3 * value:.4g} mm; undeformed in grey"
    )
    plot_cost(
        right,
        [Mark(r.method, r.leaves, r.steps_time, r.error) for r in rows],
        title="Time and error of every method",
    )
    save_figure(figure, path)
