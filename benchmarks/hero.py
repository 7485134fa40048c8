"""The picture at the top of the README: the fourbar of paper 1 and time and error of each method.

    python benchmarks/hero.py [--out FOLDER]

Left: leaf springs coloured by their largest von Mises stress, at rest (grey), on the way and at d = 0.3 m. Right: error
over time of the methods, as `speed.py` measured it. Writes hero.png into docs/, or into FOLDER if given.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from common import RESULTS, STROKE, fourbar, parse_options, save_picture
from front import Panel, draw_fronts
from speed_report import marks_of

import ksd
from ksd.view import plot_mechanism
from ksd.view.bodies import convex_hull
from ksd.view.figure import FAINT_COLOR, LEAF_COLOR, TEXT_COLOR, blended, new_figure

DOCS = Path(__file__).resolve().parents[1] / "docs"
POINTS = 61


def draw_mechanism(axes: Any, solver: ksd.Solver) -> ksd.Configuration:
    """The fourbar at rest, on the way and at its end."""
    pose = solver(top=STROKE, method="full")
    for d in (0.1, 0.2):
        passed = solver(top=d, method="full").shape(points=POINTS)
        for block in passed.blocks:
            axes.fill(*(1e3 * convex_hull(block.place[:, :2])).T, color=FAINT_COLOR, alpha=0.13, zorder=0.5)
        for leaf in passed.leaves:
            axes.plot(*(1e3 * leaf.place[:, :2].T), color=blended(LEAF_COLOR, 0.6), linewidth=1.4, zorder=1.5)
    plot_mechanism(pose, axes=axes, labels=False, title="", color="stress")
    axes.set_anchor("NW")
    axes.set_title(
        f"Fourbar of four cross flexures, moved {1e3 * STROKE:.0f} mm by {pose.forces['top']:.1f} N",
        fontsize=10, loc="left", color=TEXT_COLOR,
    )  # fmt: skip
    return pose


def draw(path: Path, numbers: Path) -> ksd.Configuration:
    """The picture, its right half from the rows of `speed.json`."""
    figure = new_figure(10.4, 3.5)
    left, right = figure.subplots(1, 2, width_ratios=(1.7, 1.0))
    pose = draw_mechanism(left, ksd.prepare(fourbar(1)))
    marks = marks_of(json.loads(numbers.read_text())["solves"]["1"]["rows"], "force_error")
    title = "What accuracy costs (black: the front)"
    draw_fronts([Panel(right, marks, title, "thread time of the compiled steps", "drive force")])
    save_picture(figure, path, numbers=numbers)
    return pose


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Draw hero.png; returns the figures in it."""
    chosen = parse_options(__doc__, argv)
    out = DOCS if chosen.out == RESULTS else chosen.out
    out.mkdir(parents=True, exist_ok=True)
    pose = draw(out / "hero.png", RESULTS / "speed.json")
    return {"force_N": pose.forces["top"]}


if __name__ == "__main__":
    main()
