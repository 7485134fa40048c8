"""Figure 15 of paper 1: the spatial three-link arm with 3x-infinity hinges, 19 positions, joint-case and location-case.

    python benchmarks/arm.py [--quick] [--elements 1 2 5] [--out FOLDER]

All three joints turn by the same angle, -45 to 45 degrees in steps of 5. Joint-case: the joints are driven;
location-case: the tip is driven to where the joint-case had it. Every position is solved from rest: by the
conventional method of Appendix B (plain Newton on all element nodes, the eps_max that takes fewest solves at the widest
position), by mixed integration points (MIP) on all element nodes, as in the paper, and on condensed leaves, each with its
own best eps_max, there also without one, and by
KSD reduced and full; with 1, 2 and 5 Appendix A elements per leaf, and strain-mode leaves. Tabulated: the reduced arm with
its joints from tables over their stroke, per configuration of a batch of a thousand. Times are thread times of the
solver's steps, of brief calls in bursts.
Prints the tables, writes arm.md and arm.json. Figures 13 and 14 of the paper are lost; dimensions are
ours, so counts differ from those quoted (plain Newton about 235 solves, MIP about 98, step 3: 2 and step 5: 2 joint-case,
4 and 4 location-case). The counts of Appendix B are sums over all its steps, given-up ones included, and eps_max, not given
there, decides them: with one element per leaf (30 flexible elements, as in the paper) the joint-case at 45 degrees takes
plain Newton 262 solves at eps_max = 1e4, 174 at 1e5, 231 at 3e8, and MIP 198, 68 (97 at 7e4), 31; the best are quoted here.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from common import PlainNewton, element_mesh, machine, parse_options, write_json
from scipy.interpolate import CubicSpline

import ksd
from ksd.model.mesh import Mesh
from ksd.study.prepared_design import PreparedDesign
from ksd.units import deg

SCENES = Path(ksd.__file__).parent / "scenes"
TIP = np.array([0.51, 0.0, 0.05])
JOINTS = ("base", "shoulder", "elbow")
ELEMENTS = (1, 2, 5)
SLOW_REPEATS = {"plain": 1, "mip_nodes": 1, "mip": 2, "mip_free": 1}
"""Repeats of the slow methods; the others are repeated REPEATS times."""
REPEATS = 5
SHORT_CALL_MS, CALLS_IN_A_ROW = 3.0, 5
"""Of calls shorter than SHORT_CALL_MS the mean of CALLS_IN_A_ROW is taken, after one that is not timed: as in a loop over
one mechanism, the cache of the processor is then filled by the method itself, as in `bench.py`."""
BATCH_SIZE = 1000
"""Configurations of the batch with tabulated joints."""


def tip_displacement(state: ksd.Configuration) -> dict[str, float]:
    """Displacement of the tip [m], by drive name of the location-case."""
    return dict(zip("xyz", state.displacement("third", TIP).tolist(), strict=True))


class Case:
    """The arm driven by joints or by location with one mesh: its solvers, and their results at a position."""

    def __init__(self, scene: Any, mesh: Mesh, hardest: Mapping[str, float]) -> None:
        self.scene, self.mesh = scene, mesh
        self.solver = ksd.prepare(scene, mesh=mesh)
        self.conventional: dict[str, PlainNewton] = {
            "mip": PlainNewton(self.solver.model, mesh.elements, hardest)
        }
        # the paper's own program has no strain-mode leaves
        if mesh.leaf == "corotational":
            self.conventional["plain"] = PlainNewton(scene, mesh.elements, hardest)
            self.conventional["mip_nodes"] = PlainNewton(scene, mesh.elements, hardest, mip=True)

    def row(self, targets: Mapping[str, float], *, repeats: int) -> dict[str, Any]:
        """Iterations, median thread times [ms] and errors at one position."""
        solve = self.solver
        ways: dict[str, Callable[[], ksd.Configuration]] = {
            "reduced": lambda: solve(targets, method="reduced", estimate=False),
            "full": lambda: solve(targets, method="full"),
            "mip": lambda: self.conventional["mip"](targets=targets),
            "mip_free": lambda: self.conventional["mip"](1e300, targets),
        }
        for base in ("plain", "mip_nodes"):
            if base in self.conventional:
                ways[base] = partial(self.conventional[base], targets=targets)
        states: dict[str, ksd.Configuration] = {}
        times: dict[str, list[float]] = {name: [] for name in ways}
        for turn in range(repeats):
            for name, way in ways.items():
                if turn >= SLOW_REPEATS.get(name, repeats):
                    continue
                states[name] = way()
                if 1e3 * states[name].time > SHORT_CALL_MS:
                    times[name].append(1e3 * states[name].time)
                else:
                    times[name].append(1e3 * sum(way().time for _ in range(CALLS_IN_A_ROW)) / CALLS_IN_A_ROW)
        steps = {s.name[0]: s for s in states["full"].steps}
        found: dict[str, Any] = {f"{name}_ms": statistics.median(values) for name, values in times.items()}
        found |= {name: states[name].iterations for name in self.conventional | {"mip_free": None}}
        found |= {f"step {k}": steps[k].iterations for k in "135"}
        found["steps_us"] = {s.name: 1e6 * s.time for s in states["full"].steps}
        return found | state_errors(states)

    def tabulated(self, targets: Mapping[str, np.ndarray]) -> dict[str, Any]:
        """Time per configuration [us] of a batch with tabulated joints, and its error figure.

        targets: by drive name, from which MANY are interpolated. Tables and arrays are made before the clock starts.
        """
        at = np.linspace(0.0, 1.0, BATCH_SIZE)
        given = np.linspace(0.0, 1.0, len(next(iter(targets.values()))))
        # three positions of --quick are too few: straight lines between them leave the reach of the arm
        fine = {n: CubicSpline(given, v)(at) for n, v in targets.items()}
        solver = PreparedDesign(self.solver.five_steps, tabulated=True)
        spent = []
        for _ in range(3):
            begin = time.thread_time_ns()
            found = solver(fine)
            spent.append(1e-3 * (time.thread_time_ns() - begin) / BATCH_SIZE)
        return {"us": min(spent), "error": found.error, "unsolved": int(np.sum(found.status != 0))}


def state_errors(states: Mapping[str, ksd.Configuration]) -> dict[str, float]:
    """Errors of the reduced answer in drive force and link displacement, and largest difference of the exact methods."""
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


def run_mesh(mesh: Mesh, angles: Sequence[float], *, repeats: int) -> dict[str, Any]:
    """Both cases over all angles [deg]."""
    joints, location = (ksd.load_scene(SCENES / name)[0] for name in ("arm_joints.toml", "arm.toml"))
    turned = {a: dict.fromkeys(JOINTS, a * deg) for a in angles}
    widest = max(angles, key=abs)
    case = Case(joints, mesh, turned[widest])
    moved = {a: tip_displacement(case.solver(turned[a], method="full")) for a in angles}
    other = Case(location, mesh, moved[widest])
    found: dict[str, Any] = {}
    for name, way, targets in (("joint-case", case, turned), ("location-case", other, moved)):
        found[name] = {a: way.row(targets[a], repeats=repeats) for a in angles}
        found[f"{name} eps_max"] = {n: p.eps_max for n, p in way.conventional.items()}
        drives = targets[widest]
        along = {d: np.array([targets[a][d] for a in angles]) for d in drives}
        found[f"{name} tabulated"] = way.tabulated(along)
    return found


COLUMNS = (
    "plain", "mip_nodes", "mip_free", "mip", "step 1", "step 3", "step 5", "plain_ms", "mip_nodes_ms", "mip_ms",
    "reduced_ms", "full_ms",
)  # fmt: skip
HEADINGS = {
    "mip_free": "MIP, no eps_max", "mip": "MIP", "mip_nodes": "MIP on all nodes", "mip_nodes_ms": "MIP on all nodes [ms]",
}  # fmt: skip


def table(title: str, rows: Mapping[float, Mapping[str, Any]]) -> str:
    """The rows as Markdown, with a last row of sums."""
    heads = [HEADINGS.get(c, c.replace("mip", "MIP").replace("_ms", " [ms]")) for c in COLUMNS]
    more = [f"{way}/{base}" for base in ("plain", "MIP on all nodes", "MIP") for way in ("full", "reduced")]
    more += ["force error", "displacement error"]
    lines = [f"### {title}", "", "| angle | " + " | ".join([*heads, *more]) + " |"]
    lines.append("|---" * (len(COLUMNS) + len(more) + 1) + "|")
    for angle, row in rows.items():
        lines.append(_table_row(f"{angle:g}", row))
    sums: dict[str, Any] = {
        c: sum(r[c] for r in rows.values()) for c in COLUMNS if c in next(iter(rows.values()))
    }
    sums |= {e: max(r[e] for r in rows.values()) for e in ("force_error", "displacement_error")}
    return "\n".join([*lines, _table_row("all", sums), ""])


BASES = ("plain_ms", "mip_nodes_ms", "mip_ms")


def _ratios(row: Mapping[str, Any]) -> list[float]:
    """How many times as fast full and reduced are as plain Newton, then as MIP on all nodes and on condensed leaves; nan
    where that was not measured."""
    return [row.get(base, math.nan) / row[way] for base in BASES for way in ("full_ms", "reduced_ms")]


def _table_row(name: str, row: Mapping[str, Any]) -> str:
    cells = [(f"{row[c]:.2f}" if c.endswith("_ms") else str(row[c])) if c in row else "-" for c in COLUMNS]
    cells += ["-" if math.isnan(r) else f"{r:.3g}" for r in _ratios(row)]
    return (
        f"| {name} | "
        + " | ".join(cells)
        + f" | {row['force_error']:.1e} | {row['displacement_error']:.1e} |"
    )


ACCURACY = (
    ("joint-case", "force_error", "moments", 1e-4, "exact to 1e-4"),
    ("location-case", "force_error", "force", 7e-3, "2 % (paper), aim 0.7 %"),
    ("location-case", "displacement_error", "displacement", 5e-4, "0.3 % (paper), aim 0.05 %"),
)
"""Required accuracy of the reduced answers at all positions."""


def accuracy_table(found: Mapping[str, Any], meshes: Sequence[str]) -> str:
    """Largest errors of the reduced answers over all positions, against the equilibrium of the same leaf springs."""
    lines = ["### Errors of the reduced answers, all positions", ""]
    lines += [
        "Against `full` on the same leaf springs; 0 where the reduced state is within its bound and it takes no step.",
        "",
    ]
    lines += [
        "| case | error of the | asked | " + " | ".join(meshes) + " | |",
        "|---" * (len(meshes) + 4) + "|",
    ]
    for case, key, words, limit, asked in ACCURACY:
        worst = [max(row[key] for row in found[mesh][case].values()) for mesh in meshes]
        said = "met" if max(worst) <= limit else "MISSED"
        lines.append(
            f"| {case} | {words} | {asked} | " + " | ".join(f"{w:.1e}" for w in worst) + f" | {said} |"
        )
    return "\n".join([*lines, ""])


TARGET_RATIOS = {"joint-case": (80, 600, 40, 300), "location-case": (65, 600, 20, 200)}
"""Required time ratios at 45 degrees and n = 5: full and reduced over plain Newton, full and reduced over MIP."""
RATIO_NAMES = tuple(
    f"{way} over {base}"
    for base in ("plain Newton", "MIP on all nodes", "MIP on condensed leaf springs")
    for way in ("full", "reduced")
)


def targets_table(found: Mapping[str, Any], mesh: str) -> str:
    """Required and measured time ratios at 45 degrees, the best of all positions, and why targets are missed."""
    lines = [
        f"### Targets, {mesh}",
        "",
        "| case | ratio | asked | at 45 degrees | best of all positions | tabulated | |",
    ]
    lines.append("|---" * 7 + "|")
    for case, wanted in TARGET_RATIOS.items():
        rows, table_us = found[case], found[f"{case} tabulated"]["us"]
        here = rows[45.0]
        for k, least in enumerate((*wanted, *wanted[2:])):
            value = _ratios(here)[k]
            best = max(_ratios(r)[k] for r in rows.values())
            base = here[BASES[k // 2]]
            quick = f"{1e3 * base / table_us:.3g}" if k % 2 else "-"
            solved = found[f"{case} tabulated"]["unsolved"] == 0
            by_tables = k % 2 and solved and 1e3 * base / table_us >= least
            said = "met" if value >= least else ("met by tables alone" if by_tables else "MISSED")
            lines.append(
                f"| {case} | {RATIO_NAMES[k]} | {least} | {value:.3g} | {best:.3g} | {quick} | {said} |"
            )
        lines.append(_floor_row(case, here, found[f"{case} tabulated"]))
    return "\n".join([*lines, ""])


def _floor_row(case: str, row: Mapping[str, Any], tabulated: Mapping[str, Any]) -> str:
    """Bound of the ratios to MIP on condensed leaves: both spend nearly all time in the same leaf kernel, so the number of
    evaluations of all leaves counts."""
    passes = row["step 5"] + 2
    each = row["mip_ms"] / row["mip"]
    parts = ", ".join(f"{n} {t:.0f}" for n, t in row["steps_us"].items())
    return (
        f"| {case} | floor | | {row['mip'] / passes:.3g} | | | MIP on condensed leaves takes {row['mip']} passes over them "
        f"({1e3 * each:.0f} us each), full {passes} (step 2, step 5 and its check); steps of full [us]: {parts}; "
        f"tabulated {tabulated['us']:.0f} us, interpolation error {tabulated['error']:.0e}, {tabulated['unsolved']} of "
        f"{BATCH_SIZE} not solved |"
    )


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Solve, print the tables, write arm.json; returns every number."""
    add = [lambda p: p.add_argument("--elements", type=int, nargs="*", default=list(ELEMENTS))]
    chosen = parse_options(__doc__, argv, *add)
    angles = (-45.0, 0.0, 45.0) if chosen.quick else tuple(np.arange(-45.0, 46.0, 5.0).tolist())
    begin = time.perf_counter()
    found: dict[str, Any] = {"machine": machine(), "angles_deg": angles}
    elements = chosen.elements[:1] if chosen.quick else chosen.elements
    meshes = {f"{n} element{'s' * (n > 1)} per leaf": element_mesh(n) for n in elements}
    tables, spent = [], {}
    if not chosen.quick:
        meshes["strain-mode leaves"] = Mesh()
    for name, mesh in meshes.items():
        since = time.perf_counter()
        found[name] = run_mesh(mesh, angles, repeats=2 if chosen.quick else REPEATS)
        spent[name] = time.perf_counter() - since
        for case in TARGET_RATIOS:
            tables.append(table(f"{case}, {name}", found[name][case]))
        if mesh.leaf == "corotational":
            tables.append(targets_table(found[name], name))
    tables.insert(0, accuracy_table(found, list(meshes)))
    found["script_s"] = spent
    parts = ", ".join(f"{name} {value:.0f} s" for name, value in spent.items())
    on = found["machine"]
    tables.insert(
        0,
        f"Thread times, medians of {REPEATS} (plain Newton once, MIP twice); {on['date']}, one thread of {on['processor']}, "
        f"load average {on['load_average']} at the start. The script took {time.perf_counter() - begin:.0f} s: {parts}.\n",
    )
    text = "\n".join(tables)
    print(text)
    (chosen.out / "arm.md").write_text(text)
    write_json(found, chosen.out / "arm.json")
    return found


if __name__ == "__main__":
    main()
