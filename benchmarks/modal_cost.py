"""Cost and error of modal bodies: time per iteration and per solve, errors of moment and support stiffness.

    python benchmarks/modal_cost.py [--quick] [--out FOLDER]

The cross flexure of paper 1 at 45 degrees, in space, by chains of 4, 10 and 48 elements, strain-mode leaves of several
orders and modal bodies, interleaved in one process, thread CPU time, medians; then solids by scikit-fem against their
tensors. Errors against strain-mode leaves of orders (6, 5, 9). Times also over that of four plain elements.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
from common import (
    STEEL,
    fourbar,
    hinge,
    machine,
    machine_line,
    parse_options,
    time_in_turns,
    write_json,
)
from paper2_tangent import tangent_solve
from reduced_solids import LoadedFace, load_face, press_reduced

import ksd
from ksd.elements.modal import factor_dense, modal_recover, modal_sizes, solve_dense
from ksd.elements.polynomial_solid import polynomial_condense
from ksd.modal import ModalBasis, with_modal_bodies
from ksd.modal.leaf_basis import _cached_undeformed_basis
from ksd.modal.solid import block
from ksd.modal.solid_basis import SolidBasis, reduce_solid
from ksd.model.compile import Model, compile_scene
from ksd.model.mesh import Mesh
from ksd.solvers.configuration import Configuration
from ksd.solvers.conventional import solve_conventional
from ksd.study.compare import REFERENCE_MESH

LENGTH, STROKE = 0.1, np.deg2rad(45.0)
DIRECTIONS = ("x", "y", "z", "rx", "ry")
SUPPORTS = ("y", "z", "rx", "ry", "rz")
"""Directions in which the top link of the fourbar is not driven."""


def leaf_variants() -> dict[str, Callable[[], Configuration]]:
    """Prepared solves of the same pose by label; each call starts from the undeformed configuration, or the trained one."""
    scene = hinge()

    def model(**words: Any) -> Model:
        return compile_scene(scene, mesh=Mesh(**words))

    def solving(made: Model) -> Callable[[], Configuration]:
        return lambda: solve_conventional(made, {"turn": STROKE}, planar=False)

    found = {f"full, {n} elements": solving(model(leaf="corotational", elements=n)) for n in (4, 10, 48)}
    for orders, points in (((4, 2, 4), 6), ((4, 3, 6), 7), ((5, 3, 6), 8)):
        found[f"strain modes {orders}"] = solving(model(orders=orders, points=points))
    chains = model(leaf="corotational", elements=10)
    bases = {
        "modal, as printed (in space)": ModalBasis(coordinates="angle", frame="node", internal=0),
        "modal, default": ModalBasis(),
        "modal, 3 internal": ModalBasis(internal=3),
        "modal, in-plane derivatives only": ModalBasis(plane=True),
    }
    for name, basis in bases.items():
        found[name] = solving(with_modal_bodies(chains, basis))
    about = solve_conventional(chains, {"turn": STROKE - np.deg2rad(5.0)}, planar=False)
    tangent = ModalBasis(frame="node", internal=0)
    found["modal, tangent basis 5 deg away"] = lambda: tangent_solve(chains, tangent, {"turn": STROKE}, about)
    return found


def measure(repeats: int) -> list[dict[str, Any]]:
    """One row per leaf model: time of an iteration and of a solve [us], errors of moment and support stiffness."""
    best = solve_conventional(compile_scene(hinge(), mesh=REFERENCE_MESH), {"turn": STROKE}, planar=False)
    aim = _answers(best)
    prepared = leaf_variants()
    times: dict[str, list[tuple[float, float]]] = {n: [] for n in prepared}
    last: dict[str, Configuration] = {}
    for k in range(repeats + 1):
        for name, call in prepared.items():
            last[name] = found = call()
            step = found.steps[-1]
            if k > 0:
                times[name].append((step.time / max(step.iterations, 1), step.time))
    rows = []
    plain = statistics.median(t[1] for t in times["full, 4 elements"])
    for name, found in last.items():
        answers = _answers(found)
        iteration, whole = (1e6 * statistics.median(t[i] for t in times[name]) for i in (0, 1))
        basis = 1e6 * found.steps[0].time if found.steps[0].name == "tangent bases" else 0.0
        bodies = max((b.unknowns for b in found.model.bodies.values()), default=0)
        rows.append(
            {"way": name, "unknowns per leaf": bodies, "iterations": found.steps[-1].iterations,
             "iteration_us": iteration, "solve_us": whole, "basis_us": basis,
             "moment_error": abs(answers[0] / aim[0] - 1),
             "in_plane_error": max(abs(a / b - 1) for a, b in zip(answers[1:3], aim[1:3], strict=True)),
             "across_error": max(abs(a / b - 1) for a, b in zip(answers[3:], aim[3:], strict=True)),
             "over_4_elements": 1e-6 * whole / plain}
        )  # fmt: skip
    return rows


def _answers(found: Configuration) -> list[float]:
    """Drive moment, then support stiffness in five directions at the crossing point."""
    at = np.array([LENGTH * np.cos(np.pi / 4) / 2, 0.0, 0.0])
    stiff = found.stiffness("tip", at=tuple(at)).supports
    return [found.forces["turn"], *(stiff[d] for d in DIRECTIONS)]


def time_calls(repeats: int) -> list[dict[str, Any]]:
    """Whole calls of a prepared solver, fourbar at 0.3 m: the first with its bases, the median of later ones without
    and with the error indicator [ms]."""
    trained = ModalBasis(expansion="trained", frame="node", internal=0)
    chains, names = Mesh("corotational", elements=10), ("lower left", "upper right")
    variants: dict[str, tuple[dict[str, Any], Any]] = {
        "reduced, strain modes": ({}, "reduced"),
        "full, strain modes": ({}, "full"),
        "full, chains of 10 elements": ({"mesh": chains}, "full"),
        "modal, default": ({"basis": ModalBasis()}, "modal"),
        "modal, tangent basis": ({"basis": trained}, "modal"),
        "modal, two of four joints, the others condensed": ({"basis": dict.fromkeys(names, ModalBasis())}, "modal"),
    }  # fmt: skip
    rows: list[dict[str, Any]] = []
    solvers, exact = {n: ksd.prepare(fourbar(), **w) for n, (w, _) in variants.items()}, math.nan
    aim: dict[str, float] = {}
    for name, (words, method) in variants.items():
        # compiled before, its bases made anew
        ksd.prepare(fourbar(), **words)(top=0.3, method=method)
        _cached_undeformed_basis.cache_clear()
        clock = time.thread_time_ns()
        found = solvers[name](top=0.3, method=method)
        first = 1e-6 * (time.thread_time_ns() - clock)
        exact = found.forces["top"] if name == "full, strain modes" else exact
        stiff = found.stiffness("top", at=(0.0, 0.3, 0.0)).supports
        aim = stiff if name == "full, strain modes" else aim
        rows.append({"way": name, "first_ms": first, "force": found.forces["top"], "stiffness": stiff})
    for row in rows:
        row["error"] = row["force"] / exact - 1.0
        row["support_error"] = max((row["stiffness"][d] / aim[d] - 1.0 for d in SUPPORTS), key=abs)
    for key, estimate in (("alone_ms", False), ("whole_ms", True)):
        calls = {
            n: partial(solvers[n], {"top": 0.3}, method=m, estimate=estimate)
            for n, (_, m) in variants.items()
        }
        times = time_in_turns(calls, repeats=repeats, warm=0)
        for row in rows:
            row[key] = 1e-3 * times[row["way"]].median
    return rows


def notch(s: np.ndarray) -> np.ndarray:
    """Thickness of a notch hinge over that of its ends: a smooth notch to 0.4 in the middle."""
    return 1.0 - 0.6 * np.exp(-(((s - 0.5) / 0.15) ** 2)) * (1.0 - (2.0 * s - 1.0) ** 8)


def iteration_timer(body: SolidBasis, at: LoadedFace) -> Callable[[], float]:
    """Function that times one iteration [s] of a reduced solid at a state: force, tangent, condensation, step, recovery."""
    d, inner = at.shift + np.array([body.solid.length, 0.0, 0.0]), at.state.copy()
    store, lam, K = np.zeros(modal_sizes(len(inner))[1]), np.empty(12), np.empty((6, 6))
    free = np.array([0, 1, 5] if body.solid.is_2d else range(6))
    still, rounds, block = np.zeros(6), 20, np.ix_(free, free)

    def iteration() -> float:
        clock = time.thread_time_ns()
        for _ in range(rounds):
            polynomial_condense(body.value, body.number, inner, store, d, at.R, lam, K)
            held, step = K[block].ravel(), lam[free]
            factor_dense(held, len(free))
            solve_dense(held, len(free), step)
            modal_recover(body.value, body.number, inner, store, still, 1.0)
        return (time.thread_time_ns() - clock) * 1e-9 / rounds

    iteration()
    return iteration


def solids(*, quick: bool) -> list[dict[str, Any]]:
    """Solids: unknowns and time per iteration of both models, error of the tip and of the axial compliance at its stroke."""
    cases: list[tuple[str, float, tuple[int, ...], Any, float]] = [
        ("thick flexure, 2D", 0.01, (40, 4), None, 0.63),
        ("thick flexure, 2D, finer", 0.01, (80, 6), None, 0.63),
        ("notch hinge, 2D", 0.01, (48, 6), notch, 0.24),
    ]
    if not quick:
        cases += [
            ("thick flexure, 3D", 0.01, (16, 2, 2), None, 0.63),
            ("notch hinge, 3D", 0.01, (20, 2, 2), notch, 0.24),
        ]
    rows = []
    for name, thickness, cells, outline, load in cases[: 1 if quick else None]:
        solid = block(STEEL, LENGTH, thickness, width=0.02, cells=cells, outline=outline)
        clock = time.thread_time()
        body = reduce_solid(solid)
        made = time.thread_time() - clock
        force = np.array([0.0, load * STEEL.E * 0.02 * thickness**3 / 12 / LENGTH**2, 0.0])
        full = load_face(solid, force, np.zeros(3))
        fast = press_reduced(body, force, np.zeros(3))
        iteration = iteration_timer(body, fast)
        pairs = [(iteration(), load_face(solid, 1e-3 * force, np.zeros(3), steps=1).time) for _ in range(8)]
        spent, whole = (statistics.median(p[k] for p in pairs[1:]) for k in (0, 1))
        free = [0, 1, 5]
        axial = [np.linalg.inv(p.stiffness[np.ix_(free, free)]) for p in (full, fast)]
        # along x with the stroke y held
        held = [C[0, 0] - C[0, 1] ** 2 / C[1, 1] for C in axial]
        rows.append(
            {"solid": name, "dofs": solid.dof_count, "unknowns": body.unknowns, "basis_s": made,
             "stroke": full.shift[1] / LENGTH, "full_us": 1e6 * whole, "reduced_us": 1e6 * spent,
             "faster": whole / spent,
             "told": fast.error, "tip_error": float(np.linalg.norm(fast.shift - full.shift) / np.linalg.norm(full.shift)),
             "support_error": held[1] / held[0] - 1.0}
        )  # fmt: skip
    return rows


def _markdown_row(*cells: Any) -> str:
    return "| " + " | ".join(str(c) for c in cells) + " |"


WHY_DEARER = """Why a modal body of a leaf is dearer than its chain, however it is coded: the energy of a chain is no
polynomial, so every iteration visits its ten elements and projects each tangent (18 x 18) on 44 columns, 13 of
the ends and 31 inside, then eliminates the full matrix of these 31: 0.7 million operations a leaf by default,
where the chain eliminates 54 unknowns of a narrow band, some ten thousand. Energy-conserving sampling
(`benchmarks/sampling.py`) saves elements of fine chains, not the projection; the tensors of a solid, below, need
neither. So for leaf springs take strain modes."""


def markdown_tables(found: dict[str, Any]) -> str:
    """Markdown of both tables."""
    said = [
        "# What modal bodies cost",
        "",
        f"{machine_line(found['machine'])}; thread time, medians, cases in turns; load average "
        f"{found['machine']['load_average']}.",
        "",
        "Cross flexure of paper 1, 45 degrees, in space.",
        "",
    ]
    said += ["| leaves | unknowns per leaf | iterations | iteration [us] | solve [us] | over 4 elements | moment | kx, ky | "
             "kz, rx, ry | |", "|---|---:|---:|---:|---:|---:|---:|---:|---:|---|"]  # fmt: skip
    chain = next(r["solve_us"] for r in found["leaves"] if r["way"] == "full, 10 elements")
    for r in found["leaves"]:
        modal = r["way"].startswith("modal")
        verdict = f"{r['solve_us'] / chain:.3g} times its chain of 10" if modal else ""
        if r["basis_us"]:
            verdict += f", and {1e-3 * r['basis_us']:.0f} ms for the bases"
        errors = [f"{100 * r[k]:.2g} %" for k in ("moment_error", "in_plane_error", "across_error")]
        times = [
            r["iterations"],
            *(f"{r[k]:.0f}" for k in ("iteration_us", "solve_us")),
            f"{r['over_4_elements']:.2f}",
        ]
        said.append(_markdown_row(r["way"], r["unknowns per leaf"] or "", *times, *errors, verdict))
    said += ["", WHY_DEARER]
    said += ["", "## Whole calls of a prepared solver, fourbar at 0.3 m", "",
             _markdown_row("way", "first call [ms]", "later ones [ms]", "with error estimate [ms]",
                           "force, off strain modes", "worst support stiffness, off strain modes"),
             "|---|---:|---:|---:|---:|---:|"]  # fmt: skip
    for r in found["calls"]:
        times = [f"{r[k]:.2g}" if r[k] < 10 else f"{r[k]:.0f}" for k in ("first_ms", "alone_ms", "whole_ms")]
        said.append(
            _markdown_row(r["way"], *times, f"{100 * r['error']:.2g} %", f"{100 * r['support_error']:.2g} %")
        )
    said += ["", "## Solids with exact polynomial tensors", "",
             "Thread time of a Newton iteration, interleaved, medians: the full model in stacked products of numpy on a",
             "scikit-fem mesh and solved by SuperLU; the reduced one compiled: force, tangent, condensation, recovery.", "",
             _markdown_row("solid", "dofs", "unknowns", "stroke", "full [us]", "reduced [us]", "faster", "tip error", "told",
                  "support error", "aim: 300 times, 0.01 %"),
             "|---|---:|---:|---:|---:|---:|---:|---:|---:|---:|---|"]  # fmt: skip
    for r in found["solids"]:
        met = r["faster"] >= 300 and r["tip_error"] <= 1e-4
        times = [f"{r[k]:.0f}" for k in ("full_us", "reduced_us", "faster")]
        numbers = [r["dofs"], r["unknowns"], f"{r['stroke']:.3g} L", *times]
        errors = [f"{100 * r[k]:.2g} %" for k in ("tip_error", "told", "support_error")]
        said.append(_markdown_row(r["solid"], *numbers, *errors, "met" if met else "MISSED"))
    return "\n".join([*said, ""])


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Run, write, return the numbers."""
    chosen = parse_options(__doc__, argv)
    found = {
        "machine": machine(),
        "leaves": measure(2 if chosen.quick else 15),
        "calls": time_calls(2 if chosen.quick else 9),
        "solids": solids(quick=chosen.quick),
    }
    write_json(found, chosen.out / "modal_cost.json")
    (chosen.out / "modal_cost.md").write_text(markdown_tables(found))
    print(markdown_tables(found))
    return found


if __name__ == "__main__":
    main()
