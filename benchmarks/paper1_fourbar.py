"""Figures 10, 11 and 12 of paper 1: the fourbar, in both readings of its lost Fig. 9.

Reading 1: H = 0.3 m between the joint centres; reading 2: H is the rigid side link, so that the joint centres
are 0.3707 m apart. The conventional method is the paper's own: plain Newton on all element nodes, halving the
step when the residual exceeds eps_max, with the eps_max best for it in each case. All of it is solved in space.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from common import (
    READINGS,
    STROKE,
    PlainNewton,
    bending_stiffness,
    cross_flexure,
    element_mesh,
    figure_grid,
    fourbar,
    height,
    label_axes,
    summarise_times,
)

import ksd
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.solver import Method
from ksd.view.figure import GROUND_COLOR, LEAF_COLOR, LINE_COLORS, ordered_colors

COLORS = {"plain": GROUND_COLOR, "mip": LINE_COLORS[3], "step 3": LINE_COLORS[2], "step 5": LEAF_COLOR}
NAMES = {
    "plain": "conventional, plain Newton",
    "mip": "conventional, MIP",
    "step 3": "KSD reduced, step 3",
    "step 5": "KSD full, step 5",
}
MOMENTS = np.linspace(-360.0, 250.0, 21)


def forces(reading: int, n: int, places: np.ndarray) -> dict[str, Any]:
    """Force and rotation of the top link at displacements `places` [m], full and reduced."""
    solver = ksd.prepare(fourbar(reading), mesh=element_mesh(n))
    found: dict[str, Any] = {}
    methods: tuple[Method, ...] = ("full", "reduced")
    for method in methods:
        states = [solver({"top": d}, method=method, estimate=method == "full") for d in places]
        found[method] = {
            "force_N": [c.forces["top"] for c in states],
            "rotation_rad": [float(c.rotation("top")[2]) for c in states],
            "stable": all(c.stable for c in states),
        }
    return found


def figure_10(*, meshes: tuple[int, ...] = (1, 2, 3, 4, 5, 6), steps: int = 20) -> dict[str, Any]:
    """Normalised force over normalised displacement; drawn for n = 1 and 3, computed for every mesh."""
    places = np.linspace(0.0, STROKE, steps + 1)
    found: dict[str, Any] = {"displacement_m": places.tolist(), "readings": {}}
    for reading in READINGS:
        cases = {n: forces(reading, n, places) for n in meshes}
        found["readings"][reading] = {"height_m": height(reading), "elements": cases}
    return found


def draw_10(found: dict[str, Any]) -> Any:
    """Forces of Fig. 10 as stored."""
    title = "Fig. 10 of paper 1: force on the fourbar, $F_{lin}$ = 4 E ΣI d / (L h²), h between joint centres"
    figure, (row,) = figure_grid(1, 2, size=(4.6, 3.6), title=title)
    places = np.array(found["displacement_m"])
    for axes, (reading, spoken) in zip(row, READINGS.items(), strict=True):
        stored = found["readings"][str(reading)]
        h, cases = stored["height_m"], stored["elements"]
        unit = 4 * bending_stiffness(cross_flexure()) / h**2 * places[1:]
        for n, color in zip("13", ordered_colors(2), strict=True):
            if n in cases:
                full, reduced = (np.array(cases[n][m]["force_N"])[1:] / unit for m in ("full", "reduced"))
                axes.plot(
                    places[1:] / h, full, color=color, linewidth=3.5, alpha=0.35, label=f"full, n = {n}"
                )
                axes.plot(
                    places[1:] / h,
                    reduced,
                    color=color,
                    linewidth=1.2,
                    linestyle="--",
                    label=f"reduced, n = {n}",
                )
        label_axes(
            axes, x="d / h [-]", y="F / $F_{lin}$ [-]", title=f"reading {reading}: {spoken}; h = {h:.4g} m"
        )
    return figure


def effort(reading: int, n: int, *, repeats: int) -> dict[str, Any]:
    """Iterations and time per iteration [us] of the four ways at d = 0.3 m, measured in turns."""
    scene, targets = fourbar(reading), {"top": STROKE}
    plain, solver = PlainNewton(scene, n, targets), ksd.prepare(scene, mesh=element_mesh(n))
    spent: dict[str, list[float]] = {name: [] for name in NAMES}
    totals: dict[str, list[float]] = {name: [] for name in ("plain", "mip", "reduced", "full")}
    counts: dict[str, int] = {}
    for turn in range(repeats + 2):
        old, mip = plain(), solve_conventional(solver.model, targets, planar=False)
        reduced = solver(targets, method="reduced", estimate=False)
        full = solver(targets, method="full")
        steps = {s.name[0]: s for s in full.steps}
        taken = {"plain": old.steps[0], "mip": mip.steps[0], "step 3": steps["3"], "step 5": steps["5"]}
        for name, step in taken.items():
            counts[name] = step.iterations
            if turn >= 2:
                spent[name].append(1e6 * step.time / step.iterations)
        if turn >= 2:
            for name, state in (("plain", old), ("mip", mip), ("reduced", reduced), ("full", full)):
                totals[name].append(1e6 * state.time)
    return {
        "eps_max": plain.eps_max,
        "plain_newton_solves_by_eps_max": plain.tried,
        "iterations": counts,
        "time_per_iteration": {name: summarise_times(values).numbers() for name, values in spent.items()},
        "time_of_all_steps": {name: summarise_times(values).numbers() for name, values in totals.items()},
        "force_N": {"plain": old.forces["top"], "full": full.forces["top"], "reduced": reduced.forces["top"]},
    }


def figure_11(*, meshes: tuple[int, ...] = (1, 2, 3, 4, 5, 6), repeats: int = 15) -> dict[int, Any]:
    """Iterations, and time per iteration, over the number of elements per leaf.

    Time per iteration: time of the step over its factorisations, so that it carries the last assembly, which
    finds the residual small, and the factorisation of the final state, which shows whether it is stable.
    """
    return {r: {n: effort(r, n, repeats=repeats) for n in meshes} for r in READINGS}


def draw_11(found: dict[str, Any]) -> Any:
    """Effort of Fig. 11 as stored."""
    title = "Fig. 11 of paper 1: effort for the fourbar at d = 0.3 m (conventional: best ε_max per case)"
    figure, grid = figure_grid(2, 2, size=(4.8, 3.0), title=title)
    for row, (reading, spoken) in zip(grid, READINGS.items(), strict=True):
        cases = found[str(reading)]
        meshes = [int(n) for n in cases]
        for k, (name, color) in enumerate(COLORS.items()):
            x = np.array(meshes) + 0.2 * (k - 1.5)
            counts = [case["iterations"][name] for case in cases.values()]
            row[0].bar(x, counts, 0.19, color=color, label=NAMES[name])
            for at, count in zip(x, counts, strict=True):
                row[0].annotate(
                    str(count), (at, count), (0, 2), textcoords="offset points", ha="center", fontsize=6
                )
            times = [case["time_per_iteration"][name]["median_us"] for case in cases.values()]
            row[1].bar(x, times, 0.19, color=color, label=NAMES[name])
        row[0].set_yscale("log")
        row[0].set_ylim(0.5, 300)
        row[0].set_yticks([1, 3, 10, 30, 100], labels=["1", "3", "10", "30", "100"])
        for axes in row:
            axes.set_xticks(meshes)
        where: dict[str, Any] = {"legend": reading == 1, "ncols": 2, "loc": "upper left"}
        title = f"reading {reading}: {spoken}"
        label_axes(row[0], x="elements per leaf n", y="iterations", title=title, **where)
        label_axes(
            row[1], x="elements per leaf n", y="thread time per iteration [µs]", title=title, legend=False
        )
    return figure


def attempt(solve: Callable[[], Any]) -> Any:
    """The configuration, or None where the solver does not converge."""
    try:
        return solve()
    except ksd.ConvergenceError:
        return None


def under_moment(reading: int, moment: float, n: int, *, repeats: int) -> dict[str, Any]:
    """Rotation of the top link at d = 0.3 m under a moment about z, and the effort of the ways to it.

    None marks what does not converge. `same` tells whether a way ends in the stable state that step 5 finds.
    """
    scene, targets = fourbar(reading, moment=moment), {"top": STROKE}
    solver = ksd.prepare(scene, mesh=element_mesh(n))
    plain = attempt(lambda: PlainNewton(scene, n, targets))
    ways: dict[str, Callable[[], Any]] = {
        "step 5": lambda: solver(targets, method="full"),
        "reduced": lambda: solver(targets, method="reduced", estimate=False),
        "mip": lambda: solve_conventional(solver.model, targets, planar=False),
        "plain": plain or (lambda: None),
    }
    states = {name: attempt(way) for name, way in ways.items()}
    times: dict[str, list[float]] = {name: [] for name, c in states.items() if c}
    total: list[float] = []
    for _ in range(repeats):
        for name, spent in times.items():
            solved = ways[name]()
            spent.append(1e6 * solved.steps[-1].time)
            if name == "step 5":
                total.append(1e6 * solved.time)
    turned = {name: float(c.rotation("top")[2]) if c else None for name, c in states.items()}
    full = turned["step 5"] if states["step 5"] and states["step 5"].stable else None
    return {
        "rotation_rad": turned,
        "force_N": {name: c.forces["top"] if c else None for name, c in states.items()},
        "stable": {name: bool(c.stable) if c else None for name, c in states.items()},
        "same": {k: full is not None and v is not None and abs(v - full) < 1e-6 for k, v in turned.items()},
        "iterations": {name: c.steps[-1].iterations if c else None for name, c in states.items()},
        "time_us": {name: summarise_times(spent).numbers() for name, spent in times.items()},
        "time_of_steps_1_to_5_us": summarise_times(total).numbers() if total else None,
        "eps_max": plain.eps_max if plain else None,
    }


def figure_12(*, n: int = 5, moments: np.ndarray = MOMENTS, repeats: int = 9) -> dict[str, Any]:
    """External moment about z on the top link, d = 0.3 m: rotation, iterations and time."""
    readings = {r: [under_moment(r, float(m), n, repeats=repeats) for m in moments] for r in READINGS}
    return {"moment_Nm": moments.tolist(), "elements": n, "readings": readings}


def draw_12(found: dict[str, Any]) -> Any:
    """Rotation, iterations and time of Fig. 12 as stored."""
    n, moments = found["elements"], np.array(found["moment_Nm"])
    title = f"Fig. 12 of paper 1: fourbar at d = 0.3 m under a moment about z on the top link, n = {n}"
    figure, grid = figure_grid(2, 3, size=(3.9, 3.0), title=title)
    for row, (reading, spoken) in zip(grid, READINGS.items(), strict=True):
        cases = found["readings"][str(reading)]
        _panels_12(row, moments, cases)
        label_axes(
            row[0], x="moment [Nm]", y="rotation of the top link [mrad]", title=f"reading {reading}: {spoken}"
        )
        label_axes(row[1], x="moment [Nm]", y="iterations", legend=reading == 1, loc="upper center")
        label_axes(row[2], x="moment [Nm]", y="thread time [ms]", legend=reading == 1, loc="upper center")
    return figure


def _panels_12(row: Any, moments: np.ndarray, cases: list[dict[str, Any]]) -> None:
    good = [k for k, c in enumerate(cases) if c["same"]["step 5"]]
    lost = [k for k in range(len(cases)) if k not in good]
    x = moments[good]
    for name, key, style in (
        ("full (step 5)", "step 5", {"linewidth": 3.5, "alpha": 0.35}),
        ("reduced", "reduced", {"linewidth": 1.2, "linestyle": "--"}),
    ):
        # a way that is refused leaves a gap
        angles = [cases[k]["rotation_rad"][key] for k in good]
        turned = [math.nan if angle is None else 1e3 * angle for angle in angles]
        row[0].plot(x, turned, color=COLORS["step 5"], label=name, **style)
    if lost:
        bottom = 1e3 * min(cases[k]["rotation_rad"]["step 5"] for k in good)
        said = "no stable state on the intended branch"
        row[0].plot(moments[lost], [bottom] * len(lost), "x", color=COLORS["plain"], markersize=5, label=said)
    for name in ("plain", "mip", "step 5"):
        both = [k for k in good if cases[k]["same"][name]]
        style = {
            "color": COLORS[name],
            "marker": "o",
            "markersize": 3,
            "linewidth": 1.2,
            "label": NAMES[name],
        }
        row[1].plot(moments[both], [cases[k]["iterations"][name] for k in both], **style)
        row[2].plot(moments[both], [1e-3 * cases[k]["time_us"][name]["median_us"] for k in both], **style)
    whole = [1e-3 * cases[k]["time_of_steps_1_to_5_us"]["median_us"] for k in good]
    row[2].plot(
        x, whole, color=COLORS["step 5"], linewidth=1.2, linestyle=":", label="KSD full, steps 1 to 5"
    )
    for axes, low, high in ((row[1], 1, 1500), (row[2], 0.05, 200)):
        axes.set_yscale("log")
        axes.set_ylim(low, high)
        axes.yaxis.set_major_formatter("{x:g}")
    for axes in row:
        axes.set_xlim(1.05 * moments.min(), 1.05 * moments.max())
