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
import os
import shutil
import subprocess
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from common import RESULTS, machine, write_json
from scipy.optimize import brentq

import ksd
from ksd.model.compile import Model
from ksd.model.leaves import cut_leaves
from ksd.units import GPa, deg, mm

GROWTH = 1.6
"""Growth from one element to the next at ends and edges."""
SMALL_VALUE = 1e-3
"""Drive value [m or rad] up to which a solid is loaded in one step."""
LONGEST_RUN = 1800.0
"""Seconds after which a run of CalculiX is given up."""


class Mesh(NamedTuple):
    """Elements in half the length of a leaf, in half its width and through its thickness; size [thicknesses] of those at its
    ends and edges, from which they grow by a constant factor."""

    along: int = 6
    across: int = 3
    through: int = 1
    end: float = 1.0


PLAIN_MESH = Mesh()


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


def graded(elements: int, length: float, finest: float) -> np.ndarray:
    """Corners (elements + 1,) in [m] of elements that grow from `finest` [m] at 0, by `GROWTH` up to a largest size
    where this reaches, else by more."""
    grown = finest * GROWTH ** np.arange(elements)
    if elements == 1 or finest * elements > 0.999 * length:
        sizes = np.ones(elements)
    elif grown.sum() > length:
        sizes = np.minimum(grown, brentq(lambda most: np.minimum(grown, most).sum() - length, 0.0, grown[-1]))
    else:
        factor = brentq(lambda q: finest * (q**elements - 1.0) / (q - 1.0) - length, 1.1, 1e3)
        sizes = factor ** np.arange(elements)
    return np.concatenate([[0.0], length * np.cumsum(sizes) / sizes.sum()])


def with_middles(corners: np.ndarray, parts: int) -> np.ndarray:
    """Corners and middles of elements that are each divided into equal parts."""
    return np.interp(
        np.arange(2 * parts * (len(corners) - 1) + 1) / (2 * parts), np.arange(len(corners)), corners
    )


class Deck:
    """The input of CalculiX of one half, z >= 0, of a mechanism with one drive that is symmetric about z = 0."""

    def __init__(self, model: Model, mesh: Mesh, parts: int) -> None:
        self.nodes: list[np.ndarray] = []
        self.elements: list[str] = []
        self.count = self.number = 0
        self.faces: dict[int, list[int]] = {}
        self.middle: list[int] = []
        self.model = model
        leaves = {f"{j.name}/{leaf.name}": (j, leaf) for j in model.scene.joints for leaf in j.leaves()}
        leaves |= {name: (None, leaf) for name, _, _, leaf in cut_leaves(model.scene)}
        for name, ends in zip(model.member_names, model.arrays.members.node.tolist(), strict=True):
            self._mesh(*leaves[name], ends, mesh, parts)

    def _mesh(self, joint: Any, leaf: Any, ends: list[int], mesh: Mesh, parts: int) -> None:
        """Add the elements of a leaf; i along, j through the thickness, k across the width."""
        t, w = leaf.section.thickness, leaf.section.width
        sections = [leaf.section_at(0.5), leaf.section_at(0.0)]
        at = [p if joint is None else joint.place(p) for p, _ in sections]
        if at[0][2] < -1e-9:
            return
        axes_z = sections[1][1] if joint is None else np.asarray(joint.rotation) @ sections[1][1]
        half = graded(mesh.along, 0.5 * leaf.length, mesh.end * t)
        u = with_middles(np.concatenate([half, leaf.length - half[-2::-1]]), parts) / leaf.length
        inside = 0.5 * w - graded(mesh.across, 0.5 * w, mesh.end * t)[::-1]
        if abs(at[0][2]) > 1e-9:
            inside = np.concatenate([-inside[:0:-1], inside])
        v = with_middles(inside, parts)
        # into z >= 0
        v = v if axes_z[2, 2] > 0.0 else -v
        shape = (len(u), 2 * mesh.through + 1, len(v))
        ids = np.zeros(shape, int)
        for i, s in enumerate(u):
            place, axes = leaf.section_at(float(s))
            if joint is not None:
                place, axes = joint.place(place), np.asarray(joint.rotation) @ axes
            for j in range(shape[1]):
                for k in range(shape[2]):
                    if (i % 2) + (j % 2) + (k % 2) > 1:
                        continue
                    self.count += 1
                    ids[i, j, k] = self.count
                    offset = np.array([0.0, (0.5 * j / mesh.through - 0.5) * t, v[k]])
                    self.nodes.append(place + axes @ offset)
        for end, face in zip(ends, (ids[0], ids[-1]), strict=True):
            self.faces.setdefault(end, []).extend(face[face > 0].tolist())
        # nodes of rigid bodies take no condition
        if abs(v[0]) < 1e-9 * w:
            self.middle += [n for n in ids[1:-1, :, 0].ravel().tolist() if n]
        order = [(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (0, 0, 2), (2, 0, 2), (2, 2, 2), (0, 2, 2),
                 (1, 0, 0), (2, 1, 0), (1, 2, 0), (0, 1, 0), (1, 0, 2), (2, 1, 2), (1, 2, 2), (0, 1, 2),
                 (0, 0, 1), (2, 0, 1), (2, 2, 1), (0, 2, 1)]  # fmt: skip
        mirror = v[-1] < v[0]
        for i in range(0, shape[0] - 1, 2):
            for j in range(0, shape[1] - 1, 2):
                for k in range(0, shape[2] - 1, 2):
                    self.number += 1
                    numbers = [str(ids[i + a, j + b, k + (2 - c if mirror else c)]) for a, b, c in order]
                    self.elements.append(
                        f"{self.number}, {', '.join(numbers[:10])},\n{', '.join(numbers[10:])}"
                    )

    def text(self, value: float, steps: int) -> str:
        """The deck in mm, N and MPa with the drive at `value` [m or rad]."""
        scene, material = self.model.scene, next(iter(self.model.scene.leaf_names().values())).material
        (term,) = scene.drives[0].terms
        driven = scene.links.index(term.link)
        lines = ["*NODE"] + [
            f"{n}, {', '.join(f'{1e3 * x:.12g}' for x in p)}" for n, p in enumerate(self.nodes, 1)
        ]
        lines += ["*ELEMENT, TYPE=C3D20R, ELSET=LEAVES", *self.elements]
        lines += ["*MATERIAL, NAME=M", "*ELASTIC", f"{1e-6 * material.E:.12g}, {material.nu:.12g}"]
        lines += ["*SOLID SECTION, ELSET=LEAVES, MATERIAL=M"]
        fixed, held = [], ["*BOUNDARY"]
        for node, face in sorted(self.faces.items()):
            lines += [f"*NSET, NSET=B{node}", ",\n".join(map(str, face))]
            if node == 0:
                fixed = ["*BOUNDARY", "B0, 1, 3"]
                continue
            ref, rot = self.count + 2 * node, self.count + 2 * node + 1
            at = term.point if node == driven else self.model.rest.x[node]
            place = ", ".join(f"{1e3 * x:.12g}" for x in at)
            lines += ["*NODE", f"{ref}, {place}", f"{rot}, {place}"]
            lines += [f"*RIGID BODY, NSET=B{node}, REF NODE={ref}, ROT NODE={rot}"]
            # symmetry
            held += [f"{ref}, 3, 3", f"{rot}, 1, 2"]
            if node == driven:
                self.reference, self.rotation = ref, rot
        axis = int(np.abs(term.direction).argmax()) + 1
        sign = float(np.sign(term.direction[axis - 1]))
        rotates = term.kind == "rotation"
        for support in scene.supports:
            (own,) = support.terms
            dof = int(np.abs(own.direction).argmax()) + 1
            held.append(f"{self.rotation if own.kind == 'rotation' else self.reference}, {dof}, {dof}")
        node = self.rotation if rotates else self.reference
        self.output = node, axis, sign, 2e-3 if rotates else 2.0
        given = sign * value * (1.0 if rotates else 1e3)
        held += [f"{n}, 3, 3" for n in self.middle]
        lines += fixed + held
        lines += [
            f"*NSET, NSET=OUT\n{node}",
            "*STEP, NLGEOM, INC=1000",
            "*STATIC",
            f"{1 / steps:.6g}, 1.0, 1e-6, {1 / steps:.6g}",
        ]
        # the usual residual is half a percent of the mean force
        lines += ["*CONTROLS, PARAMETERS=FIELD", "1e-5, 1e-2"]
        lines += ["*BOUNDARY", f"{node}, {axis}, {axis}, {given:.12g}"]
        lines += ["*NODE PRINT, NSET=OUT, FREQUENCY=1000", "U, RF", "*END STEP"]
        return "\n".join(lines) + "\n"


def solid_effort(model: Model, value: float, mesh: Mesh, parts: int, steps: int) -> float:
    """Drive force [N] or moment [Nm] of the solid. Raises RuntimeError where CalculiX fails."""
    deck = Deck(model, mesh, parts)
    with tempfile.TemporaryDirectory() as folder:
        Path(folder, "deck.inp").write_text(deck.text(value, steps))
        threads = {**os.environ, "OMP_NUM_THREADS": "1", "CCX_NPROC_EQUATION_SOLVER": "1"}
        run = subprocess.run(
            ["ccx", "deck"],
            cwd=folder,
            capture_output=True,
            text=True,
            timeout=LONGEST_RUN,
            check=False,
            env=threads,
        )
        results = Path(folder, "deck.dat")
        rows = results.read_text().split("forces (fx,fy,fz)") if results.exists() else []
        if len(rows) < 2:
            raise RuntimeError(f"CalculiX gave no forces: {run.stdout[-400:]}")
    node, axis, sign, unit = deck.output
    numbers = next(line.split() for line in rows[-1].splitlines() if line.split()[:1] == [str(node)])
    return sign * unit * float(numbers[axis])


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
