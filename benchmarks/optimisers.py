"""Optimisers side by side: exact gradients against evolution (CMA-ES, package cma) and Nelder-Mead (scipy).

Two jobs. A pivot of five parameters, as stiff at its worst of three poses as stress and moment allow, each optimiser from
five random starts. A fourbar of four different cross flexures, 18 parameters: the largest worst support stiffness of its top
over 0 to 300 mm under limits of stress and force. Gradients are `ksd.optimise`; the others maximise the worst target less
ten times what limits are exceeded by, all in logarithms, as `ksd.optimise(method="cma")` does before its polish. All
optimisers ask the same job for values, evolution whole populations at once. Writes optimisers.json and optimisers.png.
Run: python benchmarks/optimisers.py [--quick] [--minutes M: for evolution of the fourbar]
"""

from __future__ import annotations

import contextlib
import importlib.util
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common import figure_grid, label_axes, machine, parse_options, save_picture, write_json
from gradients import SIDES, fourbar, pivot_job
from scipy.optimize import minimize

import ksd
from ksd.optimisation.design_log import DesignLog
from ksd.optimisation.optimise import optimise_from
from ksd.optimisation.scaled_problem import ScaledProblem
from ksd.units import mm
from ksd.view.figure import LINE_COLORS

SAME_VALUE_SHARE = 0.999
"""Fraction of an optimum from which on a value counts as equal to it."""
COLORS = dict(zip(("gradient", "CMA-ES", "Nelder-Mead"), LINE_COLORS, strict=False))


def fourbar_job() -> ksd.Job:
    """Eighteen parameters, four poses."""
    sizes = {"length": (80 * mm, 120 * mm), "thickness": (0.3 * mm, 1 * mm)}
    sizes |= {"inner": (25 * mm, 60 * mm), "outer": (12 * mm, 30 * mm)}
    vary = {"height": (250 * mm, 350 * mm), "span": (300 * mm, 500 * mm)}
    vary |= {f"{name}_{side}": ends for side in SIDES for name, ends in sizes.items()}
    return ksd.Job(
        fourbar, top=np.linspace(0, 300, 4) * mm, link="top", vary=vary, maximise={"support_worst_N_per_m": 1e4},
        limits={"stress_MPa": 600, "top_force_N": 150}, extrapolate=True,
    )  # fmt: skip


class Course:
    """Records CPU time [s] and the best objective so far of designs that meet limits and rules."""

    def __init__(self) -> None:
        self.began, self.best = time.process_time(), -np.inf
        self.rows: list[tuple[float, float]] = []

    def __call__(self, merit: float, met: bool) -> None:
        if met and merit > self.best:
            self.best = merit
            self.rows.append((time.process_time() - self.began, merit))


def by_gradients(job: ksd.Job, x: np.ndarray) -> tuple[Course, int, int]:
    """Course, values and gradients of `ksd.optimise` from one start."""
    told = Course()

    def heard(search: ScaledProblem, _: int) -> None:
        for found in list(search.evaluated.values())[-1:]:
            told(found.merit, search.is_feasible(search.margins(found.y)))

    found = optimise_from(job, DesignLog(job), [x], "gradient", progress=heard)
    return told, found.evaluations, found.gradients


def penalised_fitness(
    job: ksd.Job, told: Course
) -> tuple[ScaledProblem, Callable[[Sequence[np.ndarray]], list[float]]]:
    """The job in scaled parameters, and what evolution minimises for some of them; designs that fail are the worst."""
    search = ScaledProblem(job, DesignLog(job), "")

    def cost(Y: Sequence[np.ndarray]) -> list[float]:
        X = [search.unscaled(y) for y in Y]
        costs = []
        for x, values, status in zip(X, *job.batch(X), strict=True):
            if status != "ok" or np.isnan(values).any():
                costs.append(1e3)
                continue
            margins = search.margins_from(values, job.rule_values(x))
            told(float(np.exp(search.level(margins))), search.is_feasible(margins))
            costs.append(-search.fitness(margins))
        return costs

    return search, cost


def by_evolution(job: ksd.Job, x: np.ndarray, seed: int, most: float) -> tuple[Course, int, int]:
    """Course and values of CMA-ES from one start, ended at its own tolerance or after `most` seconds of CPU time."""
    import cma

    told = Course()
    search, cost = penalised_fitness(job, told)
    low, spread = search.bounds[:, 0], np.diff(search.bounds)[:, 0]
    start = np.clip((search.scaled(x) - low) / spread, 0.02, 0.98)
    es = cma.CMAEvolutionStrategy(
        start, 0.2, {"bounds": [0.0, 1.0], "seed": seed + 1, "verbose": -9, "tolfun": 1e-8}
    )
    # Ctrl-C ends this run alone
    with contextlib.suppress(KeyboardInterrupt):
        while not es.stop() and time.process_time() - told.began < most:
            places = es.ask()
            es.tell(places, cost([low + spread * np.clip(p, 0, 1) for p in places]))
    return told, int(es.result.evaluations), 0


def by_simplex(job: ksd.Job, x: np.ndarray, most: int) -> tuple[Course, int, int]:
    """Course and values of Nelder-Mead from one start."""
    told = Course()
    search, cost = penalised_fitness(job, told)
    found = minimize(
        lambda y: cost([np.clip(y, *search.bounds.T)])[0], search.scaled(x), method="Nelder-Mead",
        bounds=search.bounds, options={"maxfev": most, "xatol": 1e-6, "fatol": 1e-8, "adaptive": True},
    )  # fmt: skip
    return told, int(found.nfev), 0


def row(way: str, start: int, course: tuple[Course, int, int]) -> dict[str, Any]:
    """One run as numbers."""
    told, values, gradients = course
    seconds = told.rows[-1][0] if told.rows else np.nan
    print(
        f"  {way:12} start {start + 1}: {told.best:.7f}, {values} values, {gradients} gradients, {seconds:.2f} s",
        flush=True,
    )
    return {
        "way": way, "start": start + 1, "merit": told.best, "values": values, "gradients": gradients, "course": told.rows,
    }  # fmt: skip


def five_parameters(starts: int, ways: Sequence[str]) -> list[dict[str, Any]]:
    """Every way from the same random starts."""
    job = pivot_job()
    X = job.random(starts + 1, seed=7)[1:]
    by_gradients(job, X[0])
    rows = []
    for k, x in enumerate(X):
        rows.append(row("gradient", k, by_gradients(job, x)))
        if "CMA-ES" in ways:
            rows.append(row("CMA-ES", k, by_evolution(job, x, k, np.inf)))
        if "Nelder-Mead" in ways:
            rows.append(row("Nelder-Mead", k, by_simplex(job, x, 3000)))
    return rows


def eighteen_parameters(minutes: float, evolve: bool) -> list[dict[str, Any]]:
    """Gradients from the middle of the bounds against evolution from there."""
    job = fourbar_job()
    x = job.point(None)
    rows = [row("gradient", 0, by_gradients(job, x))]
    if evolve:
        rows.append(row("CMA-ES", 0, by_evolution(job, x, 0, 60 * minutes)))
    return rows


def compare_times(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """CPU time [s] to the best value that evolution found, and by gradients to the same one."""
    evolved = [r for r in rows if r["way"] == "CMA-ES"]
    if not evolved:
        return {}

    def until(r: dict[str, Any], merit: float) -> float:
        return next((t for t, m in r["course"] if m >= merit), np.nan)

    pairs = []
    for r in evolved:
        (other,) = (o for o in rows if o["way"] == "gradient" and o["start"] == r["start"])
        same = SAME_VALUE_SHARE * min(r["merit"], other["merit"])
        pairs.append((until(other, same), until(r, same)))
    ratios = [b / a for a, b in pairs]
    return {"seconds": pairs, "ratio_median": float(np.nanmedian(ratios)), "ratios": ratios}


def picture(found: dict[str, Any], path: Path) -> None:
    """Best value so far over CPU time, one line per run."""
    parts = found["parts"]
    title = "The best of the designs so far that meet all limits, one line per run"
    figure, axes = figure_grid(1, len(parts), size=(5.2, 3.6), title=title)
    for ax, (name, rows) in zip(axes[0], parts.items(), strict=True):
        end = 1.2 * max(r["course"][-1][0] for r in rows if r["course"])
        for r in rows:
            if r["course"]:
                t, merit = np.array(r["course"]).T
                own = {"color": COLORS[r["way"]], "label": r["way"] if r["start"] == 1 else None}
                ax.step([*t, end], [*merit, merit[-1]], where="post", **own)
        ax.set_xscale("log")
        ax.xaxis.set_major_formatter("{x:g}")
        label_axes(ax, x="CPU time [s]", y="worst target over its scale", title=name)
    save_picture(figure, path)


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Run, compare, write; returns what was found."""
    asked = parse_options(__doc__, argv, lambda p: p.add_argument("--minutes", type=float, default=8.0))
    evolve = importlib.util.find_spec("cma") is not None
    if not evolve:
        print("the package cma is not installed (pip install cma): evolution is left out")
    ways = () if asked.quick else ("CMA-ES", "Nelder-Mead") if evolve else ("Nelder-Mead",)
    print("pivot, 5 parameters, 3 poses")
    parts = {"pivot, 5 parameters": five_parameters(1 if asked.quick else 5, ways)}
    if not asked.quick:
        print("fourbar, 18 parameters, 4 poses")
        parts["fourbar, 18 parameters"] = eighteen_parameters(asked.minutes, evolve)
    found = {
        "machine": machine(),
        "parts": parts,
        "compared": {n: compare_times(rows) for n, rows in parts.items()},
    }
    for name, said in found["compared"].items():
        if said:
            print(f"{name}: evolution takes {said['ratio_median']:.0f} times as long to the same value")
    write_json(found, asked.out / "optimisers.json")
    picture(found, asked.out / "optimisers.png")
    return found


if __name__ == "__main__":
    main()
