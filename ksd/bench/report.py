"""The benchmark as a table, as numbers for JSON, and as a picture with its Pareto front."""

from __future__ import annotations

import math
import os
import platform
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from datetime import date
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from ksd.bench.measure import Measured, Row

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


def machine() -> dict[str, Any]:
    """Date, processor, versions; nothing that identifies the computer."""
    import ksd

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


def front(rows: Iterable[Row], key: str) -> list[Row]:
    """Rows that no other beats in time and in the error `key`, by rising time."""
    kept: list[Row] = []
    for row in sorted(rows, key=lambda r: r.call[1]):
        error = max(getattr(row, key), ROUNDING)
        if not math.isfinite(error) or not row.stable or not math.isfinite(row.call[1]):
            continue
        # less than 1 % better is rounding, not accuracy
        if not kept or error < 0.99 * max(getattr(kept[-1], key), ROUNDING):
            kept.append(row)
    return kept


def numbers(results: Sequence[Measured]) -> dict[str, Any]:
    """Everything for JSON: "machine", and per case its rows as in `Row`; what is not finite is None."""
    cases = {
        m.case: {
            "repeats": m.repeats,
            "rows": [_clean(asdict(r)) for r in m.rows],
            "engines": [_clean(asdict(r)) for r in m.engines],
            "one_pass": dict(m.floors),
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


def percent(error: float) -> str:
    """A relative error in percent, two digits."""
    if not math.isfinite(error):
        return "-"
    if error < 1e-9:
        return "<1e-7 %"
    digits = max(0, 1 - math.floor(math.log10(100 * error)))
    return f"{100 * error:.{digits}f} %" if digits < 6 else f"{100 * error:.1e} %"


def table(measured: Measured) -> Any:
    """A rich table of one case: * marks a way on the front of any error, ! an unstable state."""
    from rich import box
    from rich.table import Table

    marked = {id(r) for key in ERRORS for r in front(measured.rows, key)}
    found = Table(box=box.SIMPLE_HEAD, title=measured.case, title_justify="left", pad_edge=False)
    for i, name in enumerate(
        ("method", "leafs", "it.", "call [us]", "steps [us]", "force", "displ.", "stiffness")
    ):
        found.add_column(name, justify="left" if i < 2 else "right", no_wrap=True)
    before = measured.rows[0]
    for r in measured.rows:
        if r.leafs != before.leafs:
            found.add_section()
        before = r
        if r.failed:
            found.add_row(r.method, r.leafs, *["-"] * 5, "failed")
            continue
        name = r.method + " *" * (id(r) in marked) + " !" * (not r.stable)
        times = [f"{r.call[1]:.0f}", f"{r.steps[1]:.0f}"]
        found.add_row(name, r.leafs, str(r.iterations), *times, *[percent(getattr(r, key)) for key in ERRORS])
    return found


def summary(measured: Measured) -> list[str]:
    """What the rows say in words: the cheapest way of each method within GOOD, and ratios on equal meshes."""
    rows = cheapest(measured.rows)
    found = [f"{r.method}: {r.call[1]:.0f} us with {r.leafs}" for r in rows]
    said = "; ".join(found) if found else "no way"
    lines = [f"Within 0.1 % of the force and 1 % of the support stiffness: {said}."]
    for leafs in dict.fromkeys(r.leafs for r in measured.rows):
        times = {r.method: r.call[1] for r in measured.rows if r.leafs == leafs and not r.failed}
        parts = [
            f"{' / '.join(f'{times[base] / times[m]:.1f}' for m in ('full', 'reduced'))} times as fast as {name}"
            for base, name in (("plain Newton", "plain Newton"), ("conventional", "conventional in space"))
            if base in times and "full" in times and "reduced" in times
        ]
        if parts:
            lines.append(f"{leafs}: full / reduced {', '.join(parts)}.")
    return lines + engine_lines(measured)


def engine_lines(measured: Measured) -> list[str]:
    """What other engines took, one sentence each."""
    found = []
    for r in measured.engines:
        said = r.said or (
            f"{r.us:.0f} us of analysis in the plane with {r.elements} elements per leaf, {r.iterations} iterations, force "
            f"error {percent(r.force_error)}"
        )
        found.append(f"{r.engine}: {said}.")
    return found


_COLORS = {
    "kinematic": "#d9a514",
    "reduced": "#5a9a4a",
    "reduced, 1 pass": "#3b6ea5",
    "reduced, 2 passes": "#4fa3a0",
    "full": "#c2410c",
    "reduced, planar": "#93c47d",
    "reduced, 1 pass, planar": "#7aa6d6",
    "reduced, 2 passes, planar": "#8fd0cd",
    "full, planar": "#e8875a",
    "conventional": "#8a63b0",
    "conventional, planar": "#d14f8f",
    "modal": "#a0522d",
    "MIP, best eps_max": "#7d6b2b",
    "MIP on all nodes": "#a89a5b",
    "plain Newton": "#444b57",
}


def picture(results: Sequence[Measured], path: str) -> None:
    """Error over time of a whole call: a row of three panels per case, strain-mode leafs as circles.

    Squares: Appendix A elements; dotted: the Pareto front. Raises SceneError when `path` cannot be written.
    """
    from ksd.view.figure import new_figure, save_figure

    figure = new_figure(13.0, 3.4 * len(results) + 0.6)
    grid = figure.subplots(len(results), 3, squeeze=False)
    for row, measured in zip(grid, results, strict=True):
        for axes, (key, name) in zip(row, ERRORS.items(), strict=True):
            _panel(axes, measured.rows, key)
            axes.set_title(measured.case, fontsize=9, loc="left")
            axes.set_xlabel("thread time of a call [us]", fontsize=8)
            axes.set_ylabel(f"error of the {name} [%]", fontsize=8)
    known: dict[str, Any] = {}
    for axes in grid.flat:
        handles, labels = axes.get_legend_handles_labels()
        known |= dict(zip(labels, handles, strict=True))
    figure.legend(
        known.values(), known.keys(), loc="outside upper center", ncols=5, fontsize=8, frameon=False
    )
    save_figure(figure, path)


def _panel(axes: Any, rows: Sequence[Row], key: str) -> None:
    shown = [r for r in rows if not r.failed and math.isfinite(getattr(r, key))]
    for method, color in _COLORS.items():
        for strain, mark in ((True, "o"), (False, "s")):
            mine = [
                r for r in shown if r.method == method and r.leafs.startswith(("strain", "modal")) == strain
            ]
            x, y = [r.call[1] for r in mine], [100 * max(getattr(r, key), 1e-13) for r in mine]
            if not mine:
                continue
            label = "modal" if method == "modal" else f"{method}, {'strain-mode' if strain else 'elements'}"
            size = 6 if strain else 4
            axes.plot(x, y, mark, color=color, markersize=size, markeredgecolor="white", label=label)
    best = front(shown, key)
    if best:
        x, y = [r.call[1] for r in best], [100 * max(getattr(r, key), 1e-13) for r in best]
        axes.step(x, y, where="post", color="black", linewidth=0.9, linestyle=":", label="front")
    axes.set_xscale("log")
    axes.set_yscale("log")
    low, high = axes.get_xlim()
    # beyond two decades the labels between the powers of ten would touch
    marks = (1, 2, 5) if high < 100.0 * low else (1,)
    ticks = [m * 10.0**k for k in range(1, 8) for m in marks if low <= m * 10.0**k <= high]
    axes.set_xticks(ticks, labels=[f"{t:.0f}" for t in ticks])
    axes.set_xticks([], minor=True)
    axes.grid(True, color="#eceff4", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.tick_params(labelsize=7)
