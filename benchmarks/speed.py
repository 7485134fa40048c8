"""Time and error of solves of the fourbar: time per iteration and its parts, whole solves, start-up.

    python benchmarks/speed.py [--quick] [--out FOLDER] [--readme README.md]

Everything is thread CPU time in one process, cases measured in turns, warm-up left out; start-up is the wall
time of fresh processes. Writes speed.json, speed.md (the tables) and speed.png (error over time), and with
--readme replaces the table between the markers of that file.
"""

from __future__ import annotations

import json
import math
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from common import (
    STROKE,
    PlainNewton,
    element_mesh,
    fourbar,
    machine,
    parse_options,
    summarise_times,
    write_json,
)
from speed_iterations import iteration_costs
from speed_report import insert_table, markdown, picture, readme_table
from start_up import start_up

import ksd
from ksd.solvers.conventional import solve_conventional
from ksd.study.compare import REFERENCE_MESH

TARGETS = {"top": STROKE}
WARM_UP_ROUNDS = 2


class Case(NamedTuple):
    """A method with a leaf model: labels, elements per leaf (0: strain-mode), and the call."""

    method: str
    leaves: str
    elements: int
    solve: Callable[[], ksd.Configuration]


def five_steps(scene: Any, mesh: ksd.Mesh, leaves: str, elements: int) -> list[Case]:
    """Every method, and the conventional one in the plane; without the error estimate, which has a row of its own."""
    solver = ksd.prepare(scene, mesh=mesh)

    def case(name: str, method: Any, **more: Any) -> Case:
        return Case(name, leaves, elements, lambda: solver(TARGETS, method=method, **more))

    def in_space(name: str, *, planar: bool) -> Case:
        model, storage = solver.model, solver.storage
        call = partial(solve_conventional, model, TARGETS, planar=planar, storage=storage)
        return Case(name, leaves, elements, call)

    return [
        case("kinematic", "kinematic", estimate=False),
        case("reduced", "reduced", estimate=False),
        case("reduced with estimate", "reduced"),
        case("reduced, 1 step", "reduced", relinearisations=1, estimate=False),
        case("full", "full"),
        in_space("conventional", planar=False),
        in_space("conventional, planar", planar=True),
    ]


def fourbar_cases(reading: int, meshes: Sequence[int]) -> list[Case]:
    """All methods and leaf models for the fourbar at d = 0.3 m."""
    found = five_steps(fourbar(reading), ksd.Mesh(), "strain-mode", 0)
    for n in meshes:
        leaves = f"{n} element{'s' * (n > 1)}"
        found += five_steps(fourbar(reading), element_mesh(n), leaves, n)
        found.append(Case("plain Newton", leaves, n, PlainNewton(fourbar(reading), n, TARGETS)))
    n = 5 if 5 in meshes else meshes[-1]
    leaves = f"{n} elements"
    condensed = PlainNewton(fourbar(reading), n, TARGETS, nodal=False)
    found.append(Case("plain Newton, condensed leaf springs", leaves, n, condensed))
    nodal = ksd.compile_scene(fourbar(reading), mesh=element_mesh(n, mip=False, nodal=True))
    capped = partial(solve_conventional, nodal, TARGETS, planar=False)
    found.append(Case("plain Newton, turns capped", leaves, n, capped))
    planar = PlainNewton(fourbar(reading), n, TARGETS, planar=True)
    found.append(Case("plain Newton, planar", leaves, n, planar))
    return found


def whole_solves(reading: int, meshes: Sequence[int], *, repeats: int) -> dict[str, Any]:
    """Times of the steps and of the whole call of every case, in turns, and their errors."""
    exact = solve_conventional(
        ksd.compile_scene(fourbar(reading), mesh=REFERENCE_MESH), TARGETS, planar=False
    )
    cases = fourbar_cases(reading, meshes)
    steps: list[list[float]] = [[] for _ in cases]
    calls: list[list[float]] = [[] for _ in cases]
    results: list[Any] = [None] * len(cases)
    for turn in range(WARM_UP_ROUNDS + repeats):
        for k, case in enumerate(cases):
            # once untimed, so that a case does not pay for what the one before it left in the processor's caches
            case.solve()
            begin = time.thread_time_ns()
            results[k] = case.solve()
            took = 1e-3 * (time.thread_time_ns() - begin)
            if turn >= WARM_UP_ROUNDS:
                calls[k].append(took)
                steps[k].append(1e6 * results[k].time)
    rows = [
        {
            **_figures(case, c, exact),
            "steps": summarise_times(s).numbers(),
            "call": summarise_times(w).numbers(),
        }
        for case, c, s, w in zip(cases, results, steps, calls, strict=True)
    ]
    reference = {"force_N": exact.forces["top"], "rotation_rad": float(exact.rotation("top")[2])}
    return {"reference": {**reference, "leaves": str(REFERENCE_MESH)}, "rows": rows}


def _figures(case: Case, c: ksd.Configuration, exact: ksd.Configuration) -> dict[str, Any]:
    turned, right = (float(x.rotation("top")[2]) for x in (c, exact))
    found: dict[str, Any] = {
        "method": case.method,
        "leaves": case.leaves,
        "elements": case.elements,
        "iterations": c.iterations,
        "force_N": c.forces["top"],
        "rotation_rad": turned,
        "force_error": abs(c.forces["top"] / exact.forces["top"] - 1),
        "rotation_error": abs(turned / right - 1),
        "estimated_error": c.error.relative if c.error else math.nan,
        "steps_us": {s.name: 1e6 * s.time for s in c.steps},
    }
    if isinstance(case.solve, PlainNewton):
        found["eps_max"] = case.solve.eps_max
    return found


def claims(found: dict[str, Any]) -> list[dict[str, Any]]:
    """Targets of these figures, and the measured values."""
    costs = found["iterations"]
    rows = [r for r in found["solves"]["1"]["rows"] if r["method"] == "reduced" and r["elements"] in (0, 5)]
    listed = [
        ("full iteration, 5 elements [µs]", 250.0, costs["full, 5 elements"]["iteration"]["median_us"]),
        ("reduced iteration [µs]", 20.0, costs["reduced, 5 elements"]["iteration"]["median_us"]),
    ]
    for r in rows:
        listed.append((f"`reduced`, {r['leaves']}: the steps [µs]", 400.0, r["steps"]["median_us"]))
        listed.append((f"`reduced`, {r['leaves']}: the whole call [µs]", 400.0, r["call"]["median_us"]))
    if "start_up" in found:
        warm = max(v["prepared_s"] for k, v in found["start_up"].items() if "empty cache" not in k)
        listed.append(("second process, until it solves [s]", 2.0, warm))
        cold = found["start_up"]["empty cache"]
        listed.append(("empty kernel cache, until solved [s]", 40.0, cold["solved_s"]))
        demo = found["start_up"]["empty cache, demo"]
        listed.append(("empty kernel cache, `ksd demo` [s]", 40.0, demo["solved_s"]))
    found_claims = [{"what": w, "bound": f"<= {t:g}", "measured": m, "met": m <= t} for w, t, m in listed]
    return found_claims + speed_ratios(found["solves"])


def speed_ratios(solves: dict[str, Any]) -> list[dict[str, Any]]:
    """Time ratios of the conventional method to the others, whole calls, 5 elements per leaf, and their targets."""
    listed = []
    for reading, solved in solves.items():
        times = {r["method"]: r["call"]["median_us"] for r in solved["rows"] if r["elements"] == 5}
        for base, name, wanted in (
            ("plain Newton", "plain Newton", {"full": 10.0, "reduced": 60.0}),
            ("conventional", "MIP", {"full": 1.8, "reduced": 10.0}),
        ):
            for method, least in wanted.items():
                ratio = times[base] / times[method]
                what = f"`{method}` over {name}, 5 elements, reading {reading}, in space [times as fast]"
                listed.append(
                    {"what": what, "bound": f">= {least:g}", "measured": ratio, "met": ratio >= least}
                )
    return listed


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure, print and write everything; returns every number."""
    add = [lambda p: p.add_argument("--readme", type=Path, help="file whose measured table is replaced")]
    chosen = parse_options(__doc__, argv, *add)
    quick = chosen.quick
    meshes, repeats = ((2, 5), 3) if quick else ((1, 2, 3, 4, 5, 6), 31)
    print("iterations ...", file=sys.stderr)
    found: dict[str, Any] = {
        "machine": machine(),
        "iterations": iteration_costs(repeats=20 if quick else 200),
    }
    print("whole solves ...", file=sys.stderr)
    found["solves"] = {str(r): whole_solves(r, meshes, repeats=repeats) for r in ((1,) if quick else (1, 2))}
    if not quick:
        print("fresh processes ...", file=sys.stderr)
        found["start_up"] = start_up()
    found["claims"] = claims(found)
    write_json(found, chosen.out / "speed.json")
    text = markdown(found)
    (chosen.out / "speed.md").write_text(text)
    picture(found, chosen.out / "speed.png")
    if chosen.readme:
        arm = json.loads((Path(__file__).parent / "results" / "arm.json").read_text())
        insert_table(chosen.readme, readme_table(found, arm))
    print(text)
    return found


if __name__ == "__main__":
    main()
