"""Every method on the scenes of `bench_scenes.py`: requirements, other engines, the picture, and the tables.

Writes bench.json: the measurements of every case, and per case "engines" (engine, elements, us, iterations, force_error,
said) and "one_pass" (by leaf springs, operations and bytes of one pass over all leaf springs, in words); the tables as
bench.md; and bench.png.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from bench_engines import measure_engines
from bench_measure import CaseResult, json_results, measure, summary
from bench_scenes import SUITE, Case, leaf_label, leaf_meshes
from bench_tables import ExtendedCase, benchmark_page, engine_sentences, requirement_table
from common import parse_options, save_picture, write_json
from floor import one_pass
from front import Mark, Panel, draw_fronts

from ksd.model.compile import compile_scene
from ksd.view.figure import new_figure

ENGINE_SCENES = ("fourbar", (5, 10, 20))
"""Scenes that are solved by other engines, and numbers of elements per leaf."""


def case_with_engines(case: Case, measured: CaseResult, *, quick: bool) -> ExtendedCase:
    """A measured case with the results of other engines and the least work of an evaluation of all leaves."""
    scene, targets = case.build()
    word, elements = ENGINE_SCENES
    engines = []
    if word in case.name:
        force = next(iter(measured.forces.values()))
        engines = measure_engines(scene, targets, force, elements=elements[:1] if quick else elements)
    meshes = leaf_meshes(case, quick=quick)
    floors = {leaf_label(mesh): str(one_pass(compile_scene(scene, mesh=mesh).arrays)) for mesh in meshes}
    return ExtendedCase(**vars(measured), engines=tuple(engines), floors=floors)


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure, print, write."""
    found = parse_options(
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
            results.append(case_with_engines(case, measured, quick=found.quick))
            print(case.name, *summary(measured), *engine_sentences(results[-1]), sep="\n")
    print(requirement_table(results))
    written = json_results(results)
    for m in results:
        written["cases"][m.case] |= {"engines": [asdict(r) for r in m.engines], "one_pass": dict(m.floors)}
    write_json(written, found.out / "bench.json")
    picture(written, found.out / "bench.png")
    (found.out / "bench.md").write_text(benchmark_page(results))
    return written


def picture(found: Mapping[str, Any], path: Path) -> None:
    """Error of the drive force over the time of a whole call, a panel per case; the other errors are in bench.json."""
    cases = {name: case["rows"] for name, case in found["cases"].items()}
    wide = min(2, len(cases))
    figure = new_figure(5.5 * wide, 3.6 * -(-len(cases) // wide))
    grid = figure.subplots(-(-len(cases) // wide), wide, squeeze=False)
    panels = []
    for axes, (case, rows) in zip(grid.flat, cases.items(), strict=False):
        good = [r for r in rows if not r["failed"] and r["force_error"] is not None]
        marks = [Mark(r["method"], _elements(r), r["call"][1], 100 * r["force_error"]) for r in good]
        panels.append(Panel(axes, marks, case, "thread time of a call", "drive force"))
    draw_fronts(panels)
    for axes in grid.flat[len(cases) :]:
        axes.set_visible(False)
    save_picture(figure, path)


def _elements(row: Mapping[str, Any]) -> int:
    """Elements per leaf; 0 for strain-mode leaf springs and modal bodies."""
    counted = re.match(r"(\d+) ", row["leaves"])
    return int(counted[1]) if counted else 0


if __name__ == "__main__":
    main()
