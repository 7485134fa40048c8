"""Every method on the scenes of `ksd bench`: what is asked, other engines, the picture, and the tables.

Writes bench.json: what `ksd bench --json` writes, and per case "engines" (engine, elements, us, iterations, force_error,
said) and "one_pass" (by leaf springs, operations and bytes of one pass over all leaf springs, in words); the tables as
bench.md; and bench.png.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bench_engines import measure_engines
from bench_tables import Told, asked_table, engine_lines, page
from common import options, write_json
from floor import one_pass

from ksd.bench import SUITE, Case, Measured, Row, measure
from ksd.bench.measure import ERRORS, front, numbers, summary
from ksd.bench.suite import label_of, meshes_of
from ksd.model.compile import compile_scene
from ksd.view.figure import new_figure, save_figure

ENGINES_ON = ("fourbar", (5, 10, 20))
"""Scenes other engines are given, and with how many elements per leaf."""


def told(case: Case, measured: Measured, *, quick: bool) -> Told:
    """A measured case with other engines and the least a pass must do."""
    scene, targets = case.build()
    word, elements = ENGINES_ON
    engines = []
    if word in case.name:
        force = next(iter(measured.forces.values()))
        engines = measure_engines(scene, targets, force, elements=elements[:1] if quick else elements)
    meshes = meshes_of(case, quick=quick)
    floors = {label_of(mesh): str(one_pass(compile_scene(scene, mesh=mesh).arrays)) for mesh in meshes}
    return Told(**vars(measured), engines=tuple(engines), floors=floors)


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure, print, write."""
    found = options(
        __doc__ or "",
        argv,
        lambda p: p.add_argument(
            "--case", metavar="WORD", default="", help="only cases whose name holds WORD"
        ),
    )
    results = []
    for case in SUITE:
        if found.case.lower() in case.name.lower():
            measured = measure(case, quick=found.quick, repeats=5 if found.quick else 15)
            results.append(told(case, measured, quick=found.quick))
            print(case.name, *summary(measured), *engine_lines(results[-1]), sep="\n")
    print(asked_table(results))
    written = numbers(results)
    for m in results:
        written["cases"][m.case] |= {"engines": [asdict(r) for r in m.engines], "one_pass": dict(m.floors)}
    write_json(written, found.out / "bench.json")
    picture(results, found.out / "bench.png")
    (found.out / "bench.md").write_text(page(results))
    return written


_COLORS = {
    "kinematic": "#d9a514",
    "reduced": "#5a9a4a",
    "reduced, 1 pass": "#3b6ea5",
    "reduced, 2 passes": "#4fa3a0",
    "full": "#c2410c",
    "conventional": "#8a63b0",
    "conventional, planar": "#d14f8f",
    "modal": "#a0522d",
    "MIP, best eps_max": "#7d6b2b",
    "MIP on all nodes": "#a89a5b",
    "plain Newton": "#444b57",
}


def picture(results: Sequence[Measured], path: Path) -> None:
    """Error over time of a whole call: a row of three panels per case, strain-mode leaves as circles.

    Squares: Appendix A elements; dotted: the Pareto front.
    """
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
    save_figure(figure, str(path))


def _panel(axes: Any, rows: Sequence[Row], key: str) -> None:
    shown = [r for r in rows if not r.failed and math.isfinite(getattr(r, key))]
    for method, color in _COLORS.items():
        for strain, mark in ((True, "o"), (False, "s")):
            mine = [
                r for r in shown if r.method == method and r.leaves.startswith(("strain", "modal")) == strain
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


if __name__ == "__main__":
    main()
