"""Figure 15 of paper 1: the spatial three-link arm with 3x-infinity hinges, 19 positions, joint-case and location-case.

    python benchmarks/arm.py [--quick] [--out FOLDER]

All three joints turn by the same angle, -45 to 45 degrees in steps of 5. Joint-case: the joints are driven;
location-case: the tip is driven to where the joint-case had it. Every position is solved from rest, by the
conventional method (plain Newton on all nodes, with the eps_max that is best for it at the widest position, and mixed
integration points), by KSD reduced and by KSD full, with one Appendix A element per leaf as in the paper, and with
strain-mode leafs. Times are thread times of the solver's steps. Prints the tables, writes arm.md and arm.json.
Figures 13 and 14 of the paper are lost; dimensions are ours.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common import PlainNewton, chain, machine, options, write_json

import ksd
from ksd.model.mesh import Mesh
from ksd.solve.conventional import conventional
from ksd.units import deg

SCENES = Path(ksd.__file__).parent / "scenes"
TIP = np.array([0.51, 0.0, 0.05])
JOINTS = ("base", "shoulder", "elbow")
MESHES = {"1 element per leaf": chain(1), "strain-mode leafs": Mesh()}
REPEATS = 5


def tip_moved(state: ksd.Configuration) -> dict[str, float]:
    """Displacement of the tip [m] by drive name of the location-case."""
    node = state.model.node_names.index("third")
    place = state.motion.x[node] + state.motion.R[node] @ (TIP - state.model.rest.x[node])
    return dict(zip("xyz", (place - TIP).tolist(), strict=True))


class Case:
    """One way of driving the arm with one mesh: the solvers, and what each does at a position."""

    def __init__(self, scene: Any, mesh: Mesh, hardest: Mapping[str, float]) -> None:
        self.solver = ksd.prepare(scene, mesh=mesh)
        # the paper's own program has no strain-mode leafs
        self.plain = PlainNewton(scene, mesh.elements, hardest) if mesh.leaf == "corotational" else None

    def row(self, targets: Mapping[str, float], *, repeats: int) -> dict[str, Any]:
        """Iterations, median thread times [ms] and errors at one position."""
        solve = self.solver
        ways = {
            "mip": lambda: conventional(solve.model, targets),
            "reduced": lambda: solve(targets, method="reduced", estimate=False),
            "full": lambda: solve(targets, method="full"),
        }
        if self.plain is not None:
            limit, model = self.plain.eps_max, self.plain.model
            ways["plain"] = lambda: conventional(model, targets, eps_max=limit, most=60, cap=math.inf)
        states: dict[str, ksd.Configuration] = {}
        times: dict[str, list[float]] = {name: [] for name in ways}
        for _ in range(repeats):
            for name, way in ways.items():
                states[name] = way()
                times[name].append(1e3 * states[name].time)
        steps = {s.name[0]: s for s in states["full"].steps}
        found: dict[str, Any] = {f"{name}_ms": statistics.median(values) for name, values in times.items()}
        found |= {name: states[name].iterations for name in ("plain", "mip") if name in states}
        found |= {f"step {k}": steps[k].iterations for k in "135"}
        return found | errors(states)


def errors(states: Mapping[str, ksd.Configuration]) -> dict[str, float]:
    """Error of the reduced answer in drive force and link displacement, and how far the exact ways are apart."""
    force = {name: np.array(list(c.forces.values())) for name, c in states.items()}
    exact, links = states["full"].motion.x[:4], states["full"].model.rest.x[:4]
    size, moved = np.linalg.norm(force["full"]), np.abs(exact - links).max()
    if not moved > 1e-9:
        return {"force_error": 0.0, "displacement_error": 0.0, "apart": 0.0}
    apart = max(np.linalg.norm(force[n] - force["full"]) for n in force if n not in ("full", "reduced"))
    return {
        "force_error": float(np.linalg.norm(force["reduced"] - force["full"]) / size),
        "displacement_error": float(np.abs(states["reduced"].motion.x[:4] - exact).max() / moved),
        "apart": float(apart / size),
    }


def run(mesh: Mesh, angles: Sequence[float], *, repeats: int) -> dict[str, Any]:
    """Both cases over all angles [deg]."""
    joints, _, _ = ksd.load_scene(SCENES / "arm_joints.toml")
    location, _, _ = ksd.load_scene(SCENES / "arm.toml")
    turned = {a: dict.fromkeys(JOINTS, a * deg) for a in angles}
    widest = max(angles, key=abs)
    case = Case(joints, mesh, turned[widest])
    moved = {a: tip_moved(case.solver(turned[a], method="full")) for a in angles}
    other = Case(location, mesh, moved[widest])
    found: dict[str, Any] = {}
    for name, way, targets in (("joint-case", case, turned), ("location-case", other, moved)):
        found[name] = {a: way.row(targets[a], repeats=repeats) for a in angles}
        if way.plain is not None:
            found[f"{name} eps_max"] = way.plain.eps_max
    return found


COLUMNS = ("plain", "mip", "step 1", "step 3", "step 5", "plain_ms", "mip_ms", "reduced_ms", "full_ms")


def table(title: str, rows: Mapping[float, Mapping[str, Any]]) -> str:
    """The rows as Markdown, with a last row of sums."""
    heads = [c.replace("_ms", " [ms]") for c in COLUMNS]
    lines = [f"### {title}", "", "| angle | " + " | ".join(heads) + " | full, times faster | force error |"]
    lines.append("|---" * (len(COLUMNS) + 3) + "|")
    for angle, row in rows.items():
        lines.append(_line(f"{angle:g}", row))
    sums: dict[str, Any] = {
        c: sum(r[c] for r in rows.values()) for c in COLUMNS if c in next(iter(rows.values()))
    }
    sums["force_error"] = max(r["force_error"] for r in rows.values())
    return "\n".join([*lines, _line("all", sums), ""])


def _line(name: str, row: Mapping[str, Any]) -> str:
    cells = [(f"{row[c]:.2f}" if c.endswith("_ms") else str(row[c])) if c in row else "-" for c in COLUMNS]
    faster = row.get("plain_ms", row["mip_ms"]) / row["full_ms"]
    return f"| {name} | " + " | ".join(cells) + f" | {faster:.1f} | {row['force_error']:.1e} |"


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Solve, print the tables, write arm.json; returns every number."""
    chosen = options(__doc__, argv)
    angles = (-45.0, 0.0, 45.0) if chosen.quick else tuple(np.arange(-45.0, 46.0, 5.0).tolist())
    found: dict[str, Any] = {"machine": machine(), "angles_deg": angles}
    tables = []
    for name, mesh in MESHES.items():
        found[name] = run(mesh, angles, repeats=2 if chosen.quick else REPEATS)
        for case in ("joint-case", "location-case"):
            tables.append(table(f"{case}, {name}", found[name][case]))
            print(tables[-1])
    (chosen.out / "arm.md").write_text("\n".join(tables))
    write_json(found, chosen.out / "arm.json")
    return found


if __name__ == "__main__":
    main()
