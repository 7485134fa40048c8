"""Plate stiffening compared with solids: leaf springs of quadratic bricks in CalculiX, with geometric nonlinearity.

Every leaf spring is made of C3D20R elements, finer towards its ends and its edges, one through the thickness, two in arcs
(with one they are softer by (t/R)^2/20 than with many); blocks and links are rigid bodies that hold its end faces. All
cases are symmetric about z = 0, so half is solved: on a mesh, on one or two each twice as fine as the last along and across,
and by ksd with and without `plate`. The effect of the solid is its drive force or moment over that of ksd without `plate`,
less 1; with Poisson's ratio 0 this is what else differs. Needs `ccx` (Debian: calculix-ccx) on the path; skipped with a word
where it is not.
"""

from __future__ import annotations

import argparse
import json
import math
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from common import RESULTS, machine, write_json

import ksd
from ksd.export.calculix import Deck, Mesh
from ksd.export.calculix_run import run
from ksd.model.compile import Model
from ksd.units import GPa, deg, mm

SMALL_VALUE = 1e-3
"""Drive value [m or rad] up to which a solid is loaded in one step."""


PLAIN_MESH = Mesh(6, 3)


@dataclass(frozen=True)
class Case:
    """A mechanism by Poisson's ratio, the value of its only drive, and the coarsest mesh of its leaf springs."""

    name: str
    scene: Callable[[float], ksd.Mechanism]
    value: float
    nu: float = 0.3
    mesh: Mesh = PLAIN_MESH


def material(nu: float, E: float = 200 * GPa) -> ksd.Material:
    """Steel, or another material, with Poisson's ratio nu."""
    return ksd.Material(E=E, nu=nu)


def leaf(
    length: float, width: float, thickness: float, *, guided: bool, radius: float = 0.0
) -> Callable[[float], ksd.Mechanism]:
    """One leaf: ends kept parallel and moved apart along y (`guided`), or bent by a rotation; an arc where a radius is
    given."""

    def scene(nu: float) -> ksd.Mechanism:
        made = ksd.Mechanism("leaf")
        tip = made.link("tip")
        curve = ksd.Arc(radius=radius, angle=length / radius) if radius else None
        chord = 2 * radius * math.sin(0.5 * length / radius) if radius else length
        made.leaf(
            made.ground, tip, start=(0, 0, 0), end=(chord, 0, 0), section=ksd.rectangle(thickness, width),
            material=material(nu), width_axis="z", curve=curve,
        )  # fmt: skip
        if guided:
            made.actuate(tip, along="y", at=(chord, 0, 0), name="drive")
            made.support(tip, about="z")
        else:
            made.actuate(tip, about="z", name="drive")
        return made

    return scene


def cross_flexure(nu: float) -> ksd.Mechanism:
    """A cross flexure of 100 mm, driven by its angle."""
    joint = ksd.CrossFlexure(
        material(nu), length=100 * mm, angle=45 * deg, thickness=0.5 * mm, widths=(20 * mm, 10 * mm)
    )
    made = ksd.Mechanism("cross flexure")
    tip = made.link("tip")
    made.join(made.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x", name="hinge")
    made.actuate(tip, about="z", name="drive")
    return made


def fourbar(nu: float) -> ksd.Mechanism:
    """The fourbar of the README."""
    joint = ksd.CrossFlexure(
        material(nu), length=100 * mm, angle=45 * deg, thickness=1 * mm, widths=(40 * mm, 20 * mm)
    )
    made = ksd.Mechanism("fourbar")
    left, top, right = made.links("left", "top", "right")
    made.join(made.ground, left, joint, at=(-200 * mm, 0, 0), axis="z", toward="y")
    made.join(left, top, joint, at=(-200 * mm, 300 * mm, 0), axis="z", toward="y")
    made.join(right, top, joint, at=(200 * mm, 300 * mm, 0), axis="z", toward="y")
    made.join(made.ground, right, joint, at=(200 * mm, 0, 0), axis="z", toward="y")
    made.actuate(top, along="x", at=(0, 300 * mm + joint.length_AB, 0), name="drive")
    return made


def gripper(nu: float) -> ksd.Mechanism:
    """The gripper of `ksd/scenes/gripper.toml`, driven by its crank."""
    joint = ksd.ArcHinge(
        material(nu, 2.5 * GPa), radius=4 * mm, angle=270 * deg, thickness=0.4 * mm, width=6 * mm
    )
    made = ksd.Mechanism("gripper")
    crank, jaw, rocker = made.links("crank", "jaw", "rocker")
    made.join(made.ground, crank, joint, at=(-4 * mm, 0, 0), axis="z", toward=(1, 1, 0))
    made.join(crank, jaw, joint, at=(0, 34 * mm, 0), axis="z", toward=(1, -1, 0))
    made.join(rocker, jaw, joint, at=(44 * mm, 30 * mm, 0), axis="z", toward=(-1, -1, 0))
    made.join(made.ground, rocker, joint, at=(36 * mm, 0, 0), axis="z", toward=(1, 1, 0))
    made.actuate(crank, about="z", name="drive")
    return made


def cases() -> list[Case]:
    """All cases, quick ones first."""
    sizes = {"60 x 20 x .3": (60 * mm, 20 * mm, 0.3 * mm), "100 x 20 x .5": (100 * mm, 20 * mm, 0.5 * mm),
             "50 x 40 x .5": (50 * mm, 40 * mm, 0.5 * mm), "100 x 50 x .5": (100 * mm, 50 * mm, 0.5 * mm),
             "100 x 10 x .5": (100 * mm, 10 * mm, 0.5 * mm)}  # fmt: skip
    found = []
    for name, size in sizes.items():
        found += [
            Case(f"{name}, bent by .01 deg", leaf(*size, guided=False), 0.01 * deg),
            Case(f"{name}, guided by .01 mm", leaf(*size, guided=True), 0.01 * mm),
        ]
    short = sizes["60 x 20 x .3"]
    found += [
        Case("60 x 20 x .3, bent by 5 deg", leaf(*short, guided=False), 5 * deg),
        Case("60 x 20 x .3, bent by 20 deg", leaf(*short, guided=False), 20 * deg),
        Case("60 x 20 x .3, guided by 5 mm", leaf(*short, guided=True), 5 * mm),
        Case("60 x 20 x .3, guided by .01 mm", leaf(*short, guided=True), 0.01 * mm, 0.0),
        Case("60 x 20 x .3, guided by .01 mm", leaf(*short, guided=True), 0.01 * mm, 0.45),
        Case("100 x 50 x .5, guided by 10 mm", leaf(*sizes["100 x 50 x .5"], guided=True), 10 * mm),
        Case("50 x 40 x .5, bent by 10 deg, nu .45", leaf(*sizes["50 x 40 x .5"], guided=False), 10 * deg, 0.45),
        Case("arc of 60 mm, radius 60, 20 x .3, bent by .01 deg",
             leaf(*short, guided=False, radius=60 * mm), 0.01 * deg),
        Case("arc of 19 mm, radius 4, 6 x .4, bent by 1 deg",
             leaf(1.5 * math.pi * 4 * mm, 6 * mm, 0.4 * mm, guided=False, radius=4 * mm), 1 * deg, mesh=Mesh(8, 2, 2)),
        Case("arc of 19 mm, radius 4, 6 x .4, bent by 1 deg",
             leaf(1.5 * math.pi * 4 * mm, 6 * mm, 0.4 * mm, guided=False, radius=4 * mm), 1 * deg, 0.0, Mesh(8, 2, 2)),
        Case("cross flexure, 2 deg", cross_flexure, 2 * deg, mesh=Mesh(8, 2, end=0.5)),
        Case("cross flexure, 20 deg", cross_flexure, 20 * deg, mesh=Mesh(10, 2)),
        Case("gripper, 15 deg", gripper, 15 * deg, mesh=Mesh(5, 1, 2)),
        Case("fourbar, 100 mm", fourbar, 100 * mm, mesh=Mesh(4, 1)),
    ]  # fmt: skip
    return found


def solid_effort(model: Model, value: float, mesh: Mesh, parts: int, steps: int) -> float:
    """Drive force [N] or moment [Nm] of the solid, of which half is solved. Raises ConvergenceError where CalculiX fails."""
    deck = Deck(model, mesh._replace(parts=parts), {"drive": value}, increments=steps, half=True)
    _, held = run(deck)
    output = deck.forces["drive"]
    return 2.0 * output.unit * float(held[output.node] @ output.direction)


def solids(case: Case, factors: tuple[int, ...]) -> dict[str, Any]:
    """Effects [%] of solids of a case on meshes refined by these factors, and the finest mesh.

    Where a leaf is bent far, less what the same mesh has with Poisson's ratio 0, which is its error.
    """
    bent = abs(case.value) > SMALL_VALUE and case.nu > 0.0
    found = [_solid(case, f) - (_solid(replace(case, nu=0.0), f) if bent else 0.0) for f in factors]
    return {
        "case": case.name,
        "nu": case.nu,
        "solid_percent": found[-1],
        "last_doubling_percent": found[-1] - found[-2] if len(found) > 1 else None,
        "mesh": [2 * factors[-1] * case.mesh.along, 2 * factors[-1] * case.mesh.across],
    }


def _solid(case: Case, parts: int) -> float:
    """Drive force or moment of a solid over that of ksd without `plate`, less 1 [%]."""
    model, steps = ksd.compile_scene(case.scene(case.nu)), 1 if abs(case.value) <= SMALL_VALUE else 3
    return 100 * (solid_effort(model, case.value, case.mesh, parts, steps) / effort(case, ()) - 1)


def effort(case: Case, with_: tuple[str, ...]) -> float:
    """Drive force [N] or moment [Nm] of ksd."""
    found = ksd.solve(case.scene(case.nu), drive=case.value, method="conventional", with_=with_)
    return float(found.forces["drive"])


def with_answers(case: Case, row: dict[str, Any]) -> dict[str, Any]:
    """The row of a case with the effects [%] that ksd simulates and lists as left out."""
    left_out = ksd.solve(case.scene(case.nu), drive=case.value, method="conventional").left_out
    return row | {
        "plate_percent": 100 * (effort(case, ("plate",)) / effort(case, ()) - 1),
        "left_out_percent": 100 * left_out.get("plate", {}).get("force", 0.0),
    }


def table(rows: list[dict[str, Any]]) -> str:
    """The rows as a table in Markdown."""
    lines = [
        "| case | nu | elements | solid | doubled | `plate` | off by, % of the effect |",
        "|---|---|---|---|---|---|---|",
    ]
    for r in rows:
        solid, plate, doubled = r["solid_percent"], r["plate_percent"], r["last_doubling_percent"]
        off = f"{100 * (plate / solid - 1):+.1f}" if r["nu"] else "-"
        change = "-" if doubled is None else f"{doubled:+.2f}"
        mesh = " x ".join(map(str, r["mesh"]))
        lines.append(f"| {r['case']} | {r['nu']:g} | {mesh} | {solid:.2f} | {change} | {plate:.2f} | {off} |")
    return "\n".join(lines) + "\n"


def main() -> None:
    """Measure all cases, print the table, and write the results."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="coarse meshes, three cases")
    parser.add_argument(
        "--stored", action="store_true", help="take the solids from the results of the last run"
    )
    parser.add_argument("--out", type=Path, default=RESULTS)
    options = parser.parse_args()
    path = options.out / "clamped_width.json"
    if options.stored:
        known = {(r["case"], r["nu"]): r for r in json.loads(path.read_text())["rows"]}
        rows = [with_answers(case, known[case.name, case.nu]) for case in cases()]
    elif shutil.which("ccx") is None:
        print("clamped_width: skipped, as CalculiX (ccx, Debian package calculix-ccx) is not installed")
        return
    else:
        rows = []
        for case in cases()[: 3 if options.quick else None]:
            single = len(case.scene(case.nu).scene().leaf_names()) == 1
            factors = (1,) if options.quick else (1, 2, 4) if single else (1, 2)
            rows.append(with_answers(case, solids(case, factors)))
            print(table(rows[-1:]).splitlines()[-1], flush=True)
    print(table(rows))
    if not options.quick:
        write_json({"machine": machine(), "rows": rows}, path)
        (options.out / "clamped_width.md").write_text(table(rows))


if __name__ == "__main__":
    main()
