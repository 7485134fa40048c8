"""The picture at the top of the README: the fourbar of paper 1 and what each method costs and misses.

    python benchmarks/hero.py [--quick] [--out FOLDER]

Left: leaf springs coloured by their largest von Mises stress, at rest (grey), on the way and at d = 0.3 m. Right: error
over time of every method with strain-mode leaves and with five Appendix A elements. Writes hero.png into docs/, or
into FOLDER if given.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common import RESULTS, STROKE, fourbar, options
from speed import whole_solves
from speed_report import SERIES, log_ticks

import ksd
from ksd.properties.stress import stress
from ksd.view import plot_mechanism
from ksd.view.figure import hull

DOCS = Path(__file__).resolve().parents[1] / "docs"
COLORS = "inferno_r"
FAINT = "#9aa3b2"
POINTS = 61
SHOWN = {"kinematic": "#d9a514", **SERIES}


def coloured_leaves(axes: Any, pose: ksd.Configuration, *, most: float, alpha: float = 1.0) -> Any:
    """Centrelines of all leaf springs in x and y [mm], coloured by their largest von Mises stress [MPa]."""
    from matplotlib.collections import LineCollection

    found, last = stress(pose.model, pose.motion, points=POINTS).leaves, None
    for leaf in pose.shape(points=POINTS).leaves:
        values = 1e-6 * found[leaf.name].von_mises_Pa.max(axis=1)
        line = 1e3 * leaf.place[:, :2]
        pieces = np.stack([line[:-1], line[1:]], axis=1)
        last = LineCollection(pieces, cmap=COLORS, linewidths=2.6, alpha=alpha, capstyle="round", zorder=5)
        last.set_array(0.5 * (values[:-1] + values[1:]))
        last.set_clim(0.0, most)
        axes.add_collection(last)
    return last


def faint_links(axes: Any, pose: ksd.Configuration) -> None:
    """Outlines of the links, hardly visible."""
    for block in pose.shape(points=POINTS).blocks:
        if block.name != "ground":
            corners = 1e3 * hull(block.place[:, :2])
            # the top link is a line in this view
            style = (
                {"alpha": 0.14, "linewidth": 1.2} if len(corners) > 2 else {"alpha": 0.4, "linewidth": 3.0}
            )
            axes.fill(*corners.T, facecolor="#8fa3b8", edgecolor="#8fa3b8", zorder=1, **style)


def draw_mechanism(figure: Any, axes: Any, solver: ksd.Solver) -> ksd.Configuration:
    """The fourbar at rest, on the way and at its end."""
    pose = solver(top=STROKE, method="full")
    leaves = stress(pose.model, pose.motion, points=POINTS).leaves.values()
    most = max(1e-6 * leaf.von_mises_Pa.max() for leaf in leaves)
    plot_mechanism(pose, axes=axes, labels=False, title="")
    for d in (0.1, 0.2):
        passed = solver(top=d, method="full")
        faint_links(axes, passed)
        coloured_leaves(axes, passed, most=most, alpha=0.35)
    last = coloured_leaves(axes, pose, most=most)
    bar = figure.colorbar(last, ax=axes, shrink=0.62, pad=0.01)
    bar.set_label("von Mises stress in the leaf springs [MPa]", fontsize=9)
    bar.ax.tick_params(labelsize=8)
    said = f"Fourbar of four cross flexures, moved {1e3 * STROKE:.0f} mm by {pose.forces['top']:.1f} N"
    axes.set_title(said, fontsize=10, loc="left")
    return pose


def draw_costs(axes: Any, rows: list[dict[str, Any]]) -> None:
    """Error of the drive force over the thread time of the steps."""
    for name, mark, size in (("strain-mode", "o", 9), ("5 elements", "s", 7)):
        for r in rows:
            if r["leaves"] == name and r["method"] in SHOWN:
                style = {"color": SHOWN[r["method"]], "markeredgecolor": "white", "zorder": 3}
                axes.plot(r["steps"]["median_us"], 100 * r["force_error"], mark, markersize=size, **style)
    for method, color in SHOWN.items():
        said = "conventional, plain Newton" if method == "plain Newton" else method
        axes.plot([], [], color=color, linewidth=5, label=said)
    axes.plot([], [], "o", color=FAINT, markersize=9, label="strain-mode leaves")
    axes.plot([], [], "s", color=FAINT, markersize=7, label="5 elements per leaf")
    log_ticks(axes)
    axes.set_ylim(3e-5, 20)
    axes.set_xlabel("thread time of the compiled steps [µs]", fontsize=9)
    axes.set_ylabel("error of the drive force [%]", fontsize=9)
    axes.set_title("What a method costs and misses", fontsize=10, loc="left")
    axes.legend(fontsize=8, frameon=False, loc="lower right", bbox_to_anchor=(1.0, 0.08))


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Draw hero.png; returns the figures in it."""
    from ksd.view.figure import new_figure, save_figure

    chosen = options(__doc__, argv)
    out = DOCS if chosen.out == RESULTS else chosen.out
    out.mkdir(parents=True, exist_ok=True)
    rows = whole_solves(1, (5,), repeats=3 if chosen.quick else 31)["rows"]
    figure = new_figure(12.0, 4.3)
    left, right = figure.subplots(1, 2, width_ratios=(1.75, 1.0))
    pose = draw_mechanism(figure, left, ksd.prepare(fourbar(1)))
    for side in ("top", "right"):
        right.spines[side].set_visible(False)
    right.grid(True, color="#eceff4", linewidth=0.8)
    right.set_axisbelow(True)
    draw_costs(right, rows)
    save_figure(figure, out / "hero.png")
    return {"force_N": pose.forces["top"], "rows": rows}


if __name__ == "__main__":
    main()
