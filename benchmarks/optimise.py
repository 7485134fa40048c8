"""A design loop: the fourbar of paper 1 made as stiff out of its plane as stress and drive force allow.

Four numbers of its joints are free (thickness, leaf angle, inner and outer width). At d = 150 mm the out-of-plane
support stiffness of the top link is to be as large as possible, with the stress below 600 MPa and the drive force
below 40 N. Differential evolution (scipy) asks `reduced` with one relinearised pass; the same designs are then asked of
`full`, and of the conventional method with 10 Appendix A elements per leaf, so that the error of the fast answer
stands beside its time. Any other optimiser takes the same function (`pip install '.[optimise]'` brings cma and nlopt).
Run: python benchmarks/optimise.py [--quick]
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from common import (
    STEEL,
    element_mesh,
    figure_grid,
    label_axes,
    linkage,
    machine,
    parse_options,
    save_picture,
    write_json,
)
from scipy.optimize import differential_evolution

import ksd
from ksd.units import deg, mm
from ksd.view.figure import LEAF_COLOR

STROKE = 150 * mm
STRESS, FORCE = 600e6, 40.0
"""Limits of von Mises stress [Pa] and drive force [N] at the end of the stroke."""
BOUNDS = {
    "thickness": (0.3e-3, 1e-3),
    "angle": (32 * deg, 58 * deg),
    "inner": (20e-3, 60e-3),
    "outer": (10e-3, 30e-3),
}
START = (0.6e-3, 45 * deg, 40e-3, 20e-3)
"""The proportions of paper 1, thin enough for the allowed stress."""


@dataclass(frozen=True)
class Answer:
    """Support stiffness z [N/m], stress [Pa] and drive force [N] of one design at the end of the stroke."""

    stiffness: float
    stress: float
    force: float

    def cost(self) -> float:
        """-log of the stiffness, with a penalty on the excess over the limits."""
        over = max(0.0, self.stress / STRESS - 1.0) + max(0.0, abs(self.force) / FORCE - 1.0)
        return -np.log(self.stiffness) + 20.0 * over


def fourbar(x: Sequence[float] | np.ndarray) -> ksd.Mechanism:
    """The fourbar with joints of thickness, angle and widths `x`; the joint centres stay where they are."""
    t, angle, inner, outer = (float(v) for v in x)
    joint = ksd.CrossFlexure(STEEL, length=100 * mm, angle=angle, thickness=t, widths=(inner, outer))
    scene = linkage([joint] * 4, 0.3, low=-0.5 * joint.length_AB)
    scene.actuate("top", along="x", at=(0, 0.3, 0))
    return scene


def answer(x: Sequence[float] | np.ndarray, mesh: ksd.Mesh | None = None, **how: Any) -> Answer:
    """Answers of one design at the end of the stroke."""
    pose = ksd.prepare(fourbar(x), mesh=mesh)(top=STROKE, **how)
    stiffness = pose.stiffness("top", at=(0, 0.3, 0)).support("z")
    return Answer(stiffness, pose.stress(points=9).largest_Pa, pose.forces["top"])


class Loop:
    """The function an optimiser calls; counts designs and failures, and keeps the best so far."""

    def __init__(self) -> None:
        self.designs, self.failures, self.best = 0, 0, [float("inf")]

    def __call__(self, x: np.ndarray) -> float:
        """Cost of a design; one that cannot be solved costs more than any that can."""
        self.designs += 1
        try:
            cost = answer(x, method="reduced", relinearisations=1).cost()
        except ksd.KsdError:
            self.failures += 1
            cost = 1e3
        self.best.append(min(self.best[-1], cost))
        return cost


WAYS: dict[str, tuple[ksd.Mesh | None, dict[str, Any]]] = {
    "reduced, 1 step": (None, {"method": "reduced", "relinearisations": 1}),
    "full": (None, {"method": "full"}),
    "conventional": (None, {"method": "conventional"}),
    "conventional, 10 elements": (element_mesh(10), {"method": "conventional"}),
}


def compare_methods(x: Sequence[float], repeats: int) -> dict[str, dict[str, float]]:
    """The same design by every method: answers, and thread time [ms] of building, solving and answering, in turns."""
    spent: dict[str, list[float]] = {name: [] for name in WAYS}
    found: dict[str, Answer] = {}
    for n in range(repeats + 1):
        for name, (mesh, how) in WAYS.items():
            # another thickness each time, so that nothing is remembered from the design before
            trial = (x[0] * (1 - 1e-6 * n), *x[1:])
            begin = time.thread_time()
            found[name] = answer(trial, mesh, **how)
            spent[name].append(1e3 * (time.thread_time() - begin))
    exact = found["full"]
    return {
        name: {
            "time_ms": float(np.median(spent[name][1:])),
            "stiffness_N_per_m": a.stiffness,
            "stress_MPa": 1e-6 * a.stress,
            "force_N": a.force,
            "stiffness_error": a.stiffness / exact.stiffness - 1,
            "force_error": a.force / exact.force - 1,
        }
        for name, a in found.items()
    }


def picture(found: dict[str, Any], path: Path) -> None:
    """Stiffness of the best design so far over the designs tried."""
    figure, axes = figure_grid(
        1, 1, size=(5.5, 3.4), title="Fourbar, out-of-plane support stiffness at d = 150 mm"
    )
    best = 1e-3 * np.array(found["best_so_far_N_per_m"])
    axes[0, 0].step(range(1, len(best) + 1), best, where="post", color=LEAF_COLOR)
    axes[0, 0].set_ylim(bottom=0)
    label_axes(axes[0, 0], x="designs tried", y="best support stiffness z [kN/m]", legend=False)
    save_picture(figure, path)


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Optimise, compare, write optimise.json and optimise.png; returns what was found."""
    asked = parse_options(__doc__, argv)
    loop = Loop()
    begin = time.thread_time()
    best = differential_evolution(
        loop, list(BOUNDS.values()), x0=START, seed=1, polish=False,
        maxiter=2 if asked.quick else 40, popsize=4 if asked.quick else 10,
    )  # fmt: skip
    spent = time.thread_time() - begin
    found = {
        "machine": machine(),
        "designs": loop.designs,
        "failures": loop.failures,
        "time_per_design_ms": 1e3 * spent / loop.designs,
        "start": dict(zip(BOUNDS, START, strict=True)),
        "best": dict(zip(BOUNDS, best.x, strict=True)),
        "best_so_far_N_per_m": np.exp(-np.array(loop.best[1:])),
        "at_start": compare_methods(START, 3 if asked.quick else 15),
        "at_best": compare_methods(best.x, 3 if asked.quick else 15),
    }
    write_json(found, asked.out / "optimise.json")
    picture(found, asked.out / "optimise.png")
    print(
        f"{loop.designs} designs, {loop.failures} failed, {found['time_per_design_ms']:.2f} ms each (thread time)"
    )
    print("best: " + ", ".join(f"{n} {v:.5g}" for n, v in found["best"].items()) + " (SI)")
    for name, row in found["at_best"].items():
        print(
            f"{name:26} {row['time_ms']:7.2f} ms   kz {row['stiffness_N_per_m']:9.0f} N/m ({row['stiffness_error']:+.2%})   "
            f"force {row['force_N']:.3f} N ({row['force_error']:+.3%})   stress {row['stress_MPa']:.1f} MPa"
        )
    return found


if __name__ == "__main__":
    main()
