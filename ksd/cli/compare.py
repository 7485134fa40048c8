"""`ksd compare SCENE.toml`: one pose by every method, as a table, a file and a picture of time against error."""

from __future__ import annotations

import argparse
import math

from ksd.cli.output import check_plot, check_table, console, write_table
from ksd.cli.solve import effect_options, load_with_options
from ksd.errors import SceneError
from ksd.study.compare import compare
from ksd.study.table import Table
from ksd.view.cost_plot import Mark, plot_cost
from ksd.view.figure import new_figure, save_figure


def run(options: argparse.Namespace) -> int:
    """Load, solve, print, write. Errors as in `ksd.load_scene` and `ksd.compare`."""
    check_plot(options.plot)
    check_table(options.out)
    scene, targets, written = load_with_options(options.scene, options.set)
    settings = {key: getattr(options, key) or written.get(key) for key in ("effects", "with", "without")}
    table = compare(
        scene, targets, methods=options.method, elements=options.elements or written.get("elements") or 5,
        extrapolate=bool(options.extrapolate or written.get("extrapolate")), progress=not options.quiet,
        **effect_options(settings),
    )  # fmt: skip
    console().print(str(table), soft_wrap=True)
    write_table(table, options.out)
    if options.plot:
        _draw(table, options.plot)
    return 0


def _draw(table: Table, path: str) -> None:
    """Time against error of the rows that have both. Raises SceneError where there are none."""
    marks = [
        Mark(
            row["method"], row["leaf_springs"], 1e-6 * row["time_us"], max(1e-2 * row["error_percent"], 1e-9)
        )
        for row in table.rows()
        if math.isfinite(row.get("time_us", math.nan)) and math.isfinite(row.get("error_percent", math.nan))
    ]
    if not marks:
        raise SceneError("--plot: no method has both a time and an error here; see the table")
    figure = new_figure(8.0, 5.0)
    plot_cost(figure.subplots(), marks, title=f"{table.name}: time and error of every method")
    save_figure(figure, path)
