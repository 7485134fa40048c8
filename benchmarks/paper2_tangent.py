"""The tangent basis: modes and derivatives about a trained configuration, in the plane and in space (section E, row 4).

Load at strokes 5 degrees or 0.05 L away and support stiffness at the configuration itself, against the chains that are
reduced; then drive moment and first parasitic frequency of the cross flexure from joint records alone, 0 to 45 degrees,
with the strain-mode leaf beside.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from paper2_cases import CASES, L

import ksd
from ksd.answers.stiffness import point_stiffness
from ksd.modal import ModalBasis, with_modal_bodies
from ksd.model.compile import Model, compile_scene
from ksd.model.mesh import Mesh
from ksd.numerics.stopwatch import Stopwatch
from ksd.solvers.configuration import Configuration
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.steps import Step, Stop

BASIS = ModalBasis(frame="node", internal=0)
STEEL = ksd.Material(E=200e9, G=200e9 / 2.6, density=7800)
TRAINED_STROKES = {"cantilever": (0.2, 0.4), "parallel guide": (0.2, 0.4), "cross flexure": (np.deg2rad(30),)}
"""Strokes [L] or rotations [rad] of the configurations at which bases are computed."""
STROKE_DIFFERENCE = {"cantilever": 0.05, "parallel guide": 0.05, "cross flexure": np.deg2rad(5)}
INTERFACE_DISTANCE = 0.1 * np.sqrt(0.5)
"""Distance [m] of the interfaces of the cross flexure in space."""
ABSOLUTE = "tangent basis of 16 elements against strain modes (6, 5, 9)"
ANGLES = (0.0, 15.0, 30.0, 45.0)


def driven_mechanism(case: str) -> Model:
    """A mechanism of paper 2 driven by its stroke instead of a load, on chains of ten elements."""
    scene = CASES[case][0](0.0)
    if case == "cross flexure":
        scene.actuate("tip", about="z", name="stroke")
    else:
        scene.actuate("tip", along="y", at=(L, 0, 0), name="stroke")
    return compile_scene(scene, mesh=Mesh("corotational", elements=10))


def tangent_solve(
    model: Model, basis: ModalBasis, goal: dict[str, float], about: Configuration
) -> Configuration:
    """Equilibrium of bodies expanded at a configuration of the chains they reduce, from there in one go."""
    clock = Stopwatch()
    reduced = with_modal_bodies(model, basis, about=about.motion)
    made = Step("tangent bases", 0, clock(), 0.0, Stop.CONVERGED)
    start = reduced.rest.copy()
    start.x[:], start.R[:], start.multiplier[:] = about.motion.x, about.motion.R, about.motion.multiplier
    found = solve_conventional(reduced, goal, start=replace(about, model=reduced, motion=start), planar=False)
    return replace(found, steps=(made, *found.steps))


def supports(found: Configuration, case: str) -> dict[str, float]:
    """Support stiffness in all directions the drive does not hold."""
    stiff = point_stiffness(found.model, found.motion, "tip", at=CASES[case][1]).supports
    return {k: v for k, v in stiff.items() if k != ("rz" if case == "cross flexure" else "y")}


def errors_around(case: str) -> list[dict[str, Any]]:
    """Rows of one mechanism: load away from the configuration, support stiffness at it."""
    model, rows = driven_mechanism(case), []
    unit = 1.0 if case == "cross flexure" else L
    for place in TRAINED_STROKES[case]:
        about = solve_conventional(model, {"stroke": place * unit}, steps=4)
        said = f"{np.rad2deg(place):.0f} degrees" if unit == 1.0 else f"{place:g} L"
        worst = 0.0
        for step in (-1, -0.5, 0, 0.5, 1):
            goal = {"stroke": (place + step * STROKE_DIFFERENCE[case]) * unit}
            full = solve_conventional(model, goal, start=about)
            found = tangent_solve(model, BASIS, goal, about)
            off = found.forces["stroke"] / full.forces["stroke"] - 1.0
            worst = max(worst, off, key=abs)
            if step == 0:
                a, b = supports(found, case), supports(full, case)
                stiff = max((a[k] / b[k] - 1.0 for k in b), key=abs)
        away = "+-5 degrees" if unit == 1.0 else "+-.05 L"
        rows.append({"what": f"tangent basis: load within {away} of {said}", "case": case, "value": worst, "aim": "0.0002",
                     "met": abs(worst) <= 2e-4})  # fmt: skip
        rows.append({"what": f"tangent basis: support stiffness at {said}", "case": case, "value": stiff, "aim": "1e-06",
                     "met": abs(stiff) <= 1e-6})  # fmt: skip
    return rows


def hinge() -> ksd.Mechanism:
    """The cross flexure of section B with the payload whose parasitic frequencies are known."""
    scene = ksd.Mechanism("cross flexure in space")
    tip = scene.link("tip")
    joint = ksd.CrossFlexure(
        STEEL, length=0.1, angle=np.pi / 4, thickness=1e-3, widths=(0.04, 0.02), spacing=0.035
    )
    scene.actuate_joint(
        scene.join(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="y", name="h"), name="turn"
    )
    scene.mass(tip, mass=1.0, at=(0, INTERFACE_DISTANCE + 0.02, 0), inertia=np.diag([1.2e-3, 8e-4, 1.2e-3]))
    return scene


def in_space(angles: tuple[float, ...] = ANGLES) -> list[dict[str, Any]]:
    """Errors of moment and first parasitic frequency by the tangent basis at the trained configuration, the undeformed
    default and strain modes, against their own limit of fine leaf springs."""
    scene, rows = hinge(), []
    fine = Mesh(orders=(6, 5, 9), points=14)
    for angle in angles:
        turn = -np.deg2rad(angle)
        best = ksd.solve(scene, turn=turn, method="conventional", mesh=fine)
        full = ksd.solve(scene, turn=turn, method="conventional", mesh=Mesh("corotational", elements=10))
        ways = {
            "tangent basis": (
                ksd.solve(scene, turn=turn, method="modal", basis=ModalBasis(expansion="trained", frame="node", internal=0)),
                full,
            ),
            ABSOLUTE: (
                ksd.solve(
                    scene, turn=turn, method="modal",
                    basis=ModalBasis(expansion="trained", frame="node", internal=0, elements=16),
                ),
                best,
            ),
            "modal, default": (ksd.solve(scene, turn=turn, method="modal"), full),
            "strain modes (4, 3, 6)": (ksd.solve(scene, turn=turn, method="full"), best),
            "chains of 10 elements": (full, best),
        }  # fmt: skip
        for way, (found, truth) in ways.items():
            a, b = (c.frequencies(count=1).frequency_Hz[0] for c in (found, truth))
            moment = found.forces["turn"] / truth.forces["turn"] - 1.0 if angle else 0.0
            c, d = (
                p.stiffness("tip", at=(0.0, 0.5 * INTERFACE_DISTANCE, 0.0)).supports for p in (found, truth)
            )
            support = max((c[k] / d[k] - 1.0 for k in ("x", "y", "z", "rx", "ry")), key=abs)
            rows.append({"angle": angle, "way": way, "moment": moment, "support": support, "frequency": a / b - 1.0,
                         "Hz": a})  # fmt: skip
    return rows


def space_acceptance(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Largest errors over all angles, and their required limits."""
    found = []
    for way in ("tangent basis", ABSOLUTE, "strain modes (4, 3, 6)"):
        for what, aim in (("moment", 3e-3), ("frequency", 5e-3)):
            worst = max((r[what] for r in rows if r["way"] == way), key=abs)
            found.append({"what": f"{way}: {what}, 0 to 45 degrees", "case": "cross flexure in space", "value": worst,
                          "aim": f"{aim:g}", "met": abs(worst) <= aim})  # fmt: skip
    return found


def space_table(rows: list[dict[str, Any]]) -> list[str]:
    """Markdown lines."""
    said = ["", "## Cross flexure in space, from joint records", "",
            "Errors of modal bodies against the chains they reduce (of 10 elements, 0.5 % off in frequency), of the "
            "others against strain modes (6, 5, 9). Known: 283.5, 97.3, 54.5 Hz at 0, 20, 45 degrees.", "",
            "| angle | way | moment | worst support stiffness | first frequency | Hz |",
            "|---:|---|---:|---:|---:|---:|"]  # fmt: skip
    for r in rows:
        errors = " | ".join(f"{100 * r[k]:.2g} %" for k in ("moment", "support", "frequency"))
        said.append(f"| {r['angle']:g} | {r['way']} | {errors} | {r['Hz']:.1f} |")
    return said
