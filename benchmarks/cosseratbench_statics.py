"""Static experiments of the package cosseratbench beside its own solvers: a catenary of a soft cable, a cantilever.

    python benchmarks/cosseratbench_statics.py [--quick] [--out FOLDER]

Every variation of the physical parameters is solved by ksd as one leaf spring and as four, and by the solvers of
cosseratbench that are installed (PyElastica, MuJoCo), at the resolution that it prescribes. The error is the largest
distance of their nodes, over the length, from the same rod by ksd in eight leaf springs of higher orders, which is within
1 % of the closed forms of cosseratbench; these leave out bending, or shear and large displacements. Times are process times
of one run each, of ksd of the first solve of a scene, kernels loaded. --quick: without the solvers of others. Skipped where
cosseratbench is not installed (`pip install cosseratbench pyelastica mujoco`).
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np
from common import machine, parse_options, write_json

import ksd

FINE = ksd.Mesh(orders=(6, 4, 16), points=20)
PIECES = 8
"""Leaf springs of the refined rod."""
OURS = {"ksd": 1, "ksd, four": 4}
"""Leaf springs of the rods that are measured."""
SOLVERS = {"pyelastica": "elastica", "mujoco": "mujoco"}


def rod_of(scenario: Any, pieces: int = 1) -> tuple[ksd.Mechanism, dict[str, float]]:
    """The one rod of a scenario, drawn straight from its start along x, and drive values that bring its end to its place."""
    rod = scenario.rods[0]
    pinned = rod.start.name == "PINNED"
    scene = ksd.Mechanism("rod", plane="xz")
    scene.gravity = tuple(scenario.gravity)
    begin, end = (scene.link("start") if pinned else scene.ground), scene.link("end")
    stuff = ksd.Material(
        E=rod.material.youngs_modulus, G=rod.material.shear_modulus, density=rod.material.density
    )
    tip = (rod.length, 0, 0)
    leaf = scene.leaf(
        begin, end, start=(0, 0, 0), end=tip, section=ksd.circle(2 * rod.radius), material=stuff, name="rod"
    )
    for k in range(1, pieces):
        scene.point(leaf, s=k * rod.length / pieces)
    for load in rod.loads:
        scene.load(end, force=tuple(load.force), at=tip)
    if not pinned:
        return scene, {}
    scene.pin(scene.ground, begin, at=(0, 0, 0))
    scene.support(end, along="z", at=tip)
    scene.actuate(end, along="x", at=tip, name="in")
    return scene, {"in": rod.centerline[-1][0] - rod.centerline[0][0] - rod.length}


def line(pose: Any, points: int) -> np.ndarray:
    """Places (k, 3) [m] along the rod."""
    return np.asarray(pose.shape(points=points).leaves[0].place)


def distance(places: np.ndarray, curve: np.ndarray) -> float:
    """Largest distance [m] of places (k, 3) from a polyline (n, 3)."""
    a, b = curve[:-1], curve[1:]
    along = b - a
    share = np.clip(((places[:, None] - a) * along).sum(axis=2) / (along * along).sum(axis=1), 0.0, 1.0)
    return float(np.linalg.norm(places[:, None] - a - share[..., None] * along, axis=2).min(axis=1).max())


def by_others(name: str, scenario: Any, elements: int) -> tuple[np.ndarray, float]:
    """Final nodes (k, 3) [m] of a solver of cosseratbench, and its process time [s]."""
    from cosseratbench.registry import load_solver

    solver, begin = load_solver(name), time.process_time()
    found = solver.run(scenario, n_elements=elements, n_frames=2)
    return np.asarray(found.positions[0][-1]), time.process_time() - begin


def measure(*, others: bool) -> list[dict[str, Any]]:
    """A row for every variation: errors over the length, and times [s], by solver."""
    from cosseratbench.registry import load_experiment
    from cosseratbench.variations import variants

    rows: list[dict[str, Any]] = []
    experiments: list[Any] = [load_experiment(name) for name in ("cantilever", "catenary")]
    for experiment in experiments:
        for variant in variants(experiment, [p.name for p in experiment.parameters]):
            scenario = experiment.build(
                **{p.name: p.default for p in experiment.parameters} | dict(variant.parameters)
            )
            length = scenario.rods[0].length
            fine = line(ksd.solve(*rod_of(scenario, PIECES), mesh=FINE), 2000)
            closed = distance(fine[::20], experiment.reference(scenario)[0]) / length
            row: dict[str, Any] = {
                "experiment": experiment.name,
                "variation": variant.key,
                "closed form": closed,
            }
            for name, pieces in OURS.items():
                # loads kernels
                ksd.solve(*rod_of(scenario, pieces))
                scene, drives = rod_of(scenario, pieces)
                begin = time.process_time()
                pose = ksd.solve(scene, drives)
                taken = time.process_time() - begin
                row[name] = [distance(line(pose, 100), fine) / length, taken, pose.iterations]
            for name, package in SOLVERS.items():
                if not others or not find_spec(package):
                    continue
                try:
                    nodes, spent = by_others(name, scenario, experiment.n_elements)
                except Exception as reason:  # versions of their backends that do not fit
                    row[f"{name} failed"] = str(reason).splitlines()[0]
                    continue
                row[name] = [distance(nodes, fine) / length, spent]
            rows.append(row)
            print(row, flush=True)
    return rows


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    """Run all variations; returns what is written."""
    options = parse_options(__doc__ or "", arguments)
    if not find_spec("cosseratbench"):
        print("cosseratbench is not installed: pip install cosseratbench pyelastica mujoco")
        return {}
    rows = measure(others=not options.quick)
    for name in SOLVERS:
        both = [row for row in rows if name in row]
        if both:
            for own in OURS:
                errors, times = ([row[own][k] / row[name][k] for row in both] for k in (0, 1))
                print(f"{own} over {name}: error {max(errors):.2g}, time {max(times):.2g} at most")
    found = {"machine": machine(), "rows": rows}
    write_json(found, options.out / "cosseratbench_statics.json")
    return found


if __name__ == "__main__":
    main()
