"""Poses confirmed by solids: `ksd.export.confirm` (CalculiX) of mechanisms with Poisson's ratio 0, and with .3.

With nu = 0 a solid has no plate stiffening and no clamped width, so that forces and positions must agree: to 1e-4, arcs to
1e-3, of which the law of curved bars is (t/R)^2/15. With nu = .3 the difference stands beside what `plate` explains of it.
Every mesh is divided once along and across, where that takes no hours. Of the delta stage restrained warping is simulated,
which solids have: .4 % of its forces at the larger pose. Needs `ccx` (Debian: calculix-ccx) on the path;
skipped with a word where it is not.

    python benchmarks/confirm.py [--quick] [--only NAME] [--out FOLDER]

`--only` renews the rows of the cases whose name has this in it. Writes confirm.md and .json.
"""

from __future__ import annotations

import argparse
import json
import shutil
import time
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

from clamped_width import cross_flexure
from common import RESULTS, machine, machine_line, write_json

import ksd
from ksd.export import confirm
from ksd.scene.toml_file import scene_from_tables, shipped_scenes
from ksd.units import deg, mm

LIMIT = 1e-4
"""Largest difference in force, and in position over the stroke, that is aimed at with nu = 0."""


class Case(NamedTuple):
    """A pose; scene: of the shipped ones, or the cross flexure; values of its drives; refined: into how many parts each
    element is divided; limit: of the differences; effects: that solids have, simulated besides."""

    name: str
    scene: str
    values: dict[str, float]
    nu: float = 0.0
    refined: tuple[int, ...] = (1, 2)
    limit: float = LIMIT
    effects: tuple[str, ...] = ()


CASES = (
    Case("guide, 5 mm", "guide", {"table": 5 * mm}),
    Case("cross flexure, 10 deg", "cross flexure", {"drive": 10 * deg}),
    Case("cross flexure, 30 deg", "cross flexure", {"drive": 30 * deg}),
    Case("gripper, 15 deg", "gripper", {"crank": 15 * deg}, limit=1e-3),
    Case("fourbar, 100 mm", "fourbar", {"top": 100 * mm}),
    # the leaf springs of its universal joints are bent and twisted at once
    Case(
        "delta stage, 2, 1, 1 mm",
        "delta_stage",
        {"x": 2 * mm, "y": 1 * mm, "z": 1 * mm},
        effects=("warping",),
    ),
    Case(
        "delta stage, 20, 10, 10 mm",
        "delta_stage",
        {"x": 20 * mm, "y": 10 * mm, "z": 10 * mm},
        refined=(1,),
        effects=("warping",),
    ),
    Case("guide, 5 mm", "guide", {"table": 5 * mm}, 0.3),
    Case("cross flexure, 10 deg", "cross flexure", {"drive": 10 * deg}, 0.3),
    Case("cross flexure, 30 deg", "cross flexure", {"drive": 30 * deg}, 0.3),
    Case("gripper, 15 deg", "gripper", {"crank": 15 * deg}, 0.3),
    Case("fourbar, 100 mm", "fourbar", {"top": 100 * mm}, 0.3, (1,)),
)


def scene_of(case: Case) -> ksd.Mechanism:
    """The mechanism of a case, whose materials have its Poisson's ratio, with its effects."""
    if case.scene == "cross flexure":
        return cross_flexure(case.nu)
    path = Path(str(shipped_scenes()[case.scene]))
    tables = tomllib.loads(path.read_text(encoding="utf-8"))
    for material in tables["material"].values():
        material.pop("G", None)
        material["nu"] = case.nu
    scene = scene_from_tables(tables, path)[0]
    if case.effects:
        scene.consider(*case.effects)
    return scene


def measure(case: Case, parts: int) -> dict[str, Any]:
    """Differences of a case with elements divided into `parts`, and the time [s] of both programs together."""
    pose = ksd.solve(scene_of(case), case.values, method="conventional")
    begin = time.perf_counter()
    found = confirm(pose, refine=parts)
    plate = pose.left_out.get("plate", {}).get("force", 0.0) if case.nu else 0.0
    return {
        "case": case.name, "nu": case.nu, "parts": parts, "solids": found.elements, "limit": case.limit,
        "forces": {drive: found.relative_force(drive) for drive in found.forces},
        "position": max(found.distance(link) for link in found.displacements) / found.stroke,
        "plate": plate, "seconds": time.perf_counter() - begin,
    }  # fmt: skip


def table(rows: list[dict[str, Any]]) -> str:
    """The rows as a table in Markdown."""
    lines = [
        "| case | nu | solids | force | position over stroke | force by the finer mesh | explained by `plate` |",
        "|---|---|---|---|---|---|---|",
    ]
    coarse = {(r["case"], r["nu"]): r for r in rows if r["parts"] == 1}
    for r in rows:
        forces = ", ".join(f"{value:+.1e}" for value in r["forces"].values())
        first = coarse[r["case"], r["nu"]]["forces"]
        change = ", ".join(f"{r['forces'][d] - first[d]:+.1e}" for d in first) if r["parts"] > 1 else "-"
        plate = f"{r['plate']:+.1e}" if r["nu"] else "-"
        lines.append(
            f"| {r['case']} | {r['nu']:g} | {r['solids']} | {forces} | {r['position']:.1e} | {change} | {plate} |"
        )
    missed = [
        f"{r['case']} ({r['solids']} solids)" for r in rows
        if not r["nu"] and max(r["position"], *map(abs, r["forces"].values())) > r["limit"]
    ]  # fmt: skip
    lines += ["", f"Above {LIMIT:g} (arcs 1e-3) with nu = 0: {', '.join(missed) or 'none'}."]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure all cases, print the table, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="the first two cases, coarse")
    parser.add_argument("--only", default="", help="renew the rows of the cases whose name has this in it")
    parser.add_argument("--out", type=Path, default=RESULTS)
    options = parser.parse_args()
    if shutil.which("ccx") is None:
        print("confirm: skipped, as CalculiX (ccx, Debian package calculix-ccx) is not installed")
        return
    path = options.out / "confirm.json"
    known = json.loads(path.read_text())["rows"] if options.only and path.exists() else []
    stored = {(r["case"], r["nu"], r["parts"]): r for r in known}
    for parts in (1,) if options.quick else (1, 2):
        for case in CASES[: 2 if options.quick else None]:
            if options.only not in case.name or parts not in case.refined:
                continue
            stored[case.name, case.nu, parts] = measure(case, parts)
            rows = [r for c in CASES for k in c.refined if (r := stored.get((c.name, c.nu, k)))]
            said = f"Measured on {machine_line(machine())}.\n\n{table(rows)}"
            print(json.dumps(stored[case.name, case.nu, parts]), flush=True)
            if not options.quick:
                # after every run, as they take minutes
                write_json({"machine": machine(), "rows": rows}, path)
                (options.out / "confirm.md").write_text(said)
    print(said)


if __name__ == "__main__":
    main()
