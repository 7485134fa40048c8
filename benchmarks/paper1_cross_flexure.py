"""Figures 7 and 8 of paper 1: the moment of the cross flexure, and the effect of a force across it.

FE is the finite element model (Appendix A elements, conventional solver), EOB the element-orientation body of
paper 1, which is what method "reduced" makes of a single joint. Moments are divided by E I_sum theta / L:
eq. 4.3 as printed is twice too stiff (its own eq. 4.7 and Table 1 give E I_sum / L).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from common import (
    bending_stiffness,
    cross_flexure,
    element_mesh,
    figure_grid,
    hinge,
    label_axes,
)

import ksd
from ksd.solvers.conventional import solve_conventional
from ksd.study.compare import REFERENCE_MESH
from ksd.units import deg, mm
from ksd.view.figure import FAINT_COLOR, TEXT_COLOR, ordered_colors

ANGLES = np.arange(5, 76, 5)
SCALED_FORCES = (0.0, 2.0, 4.0, 8.0)
WIDTH_FACTOR = 4.0
"""Factor on the width of the outer leaf springs in Fig. 7b."""


class DefaultShape:
    """The record of the cross flexure as the paper had it: trained on the default widths only.

    Whatever the joint's own width ratio, the functions of the default joint are used.
    """

    def __init__(self, family: str) -> None:
        self.record, self.shape = ksd.find_record(family), cross_flexure().shape()

    def __getattr__(self, name: str) -> Any:
        return getattr(self.record, name)

    def contract(self, shape: Any, mesh: Any, **words: Any) -> Any:
        """Functions of the default shape."""
        return self.record.contract(self.shape, mesh, **words)


def fem_path(scene: Any, mesh: ksd.Mesh) -> list[ksd.Configuration]:
    """Finite element model over ANGLES, each configuration started from the one before."""
    model = ksd.compile_scene(scene, mesh=mesh)
    found, last = [], solve_conventional(model, {"turn": 0.0}, planar=False)
    for angle in ANGLES:
        last = solve_conventional(model, {"turn": angle * deg}, start=last, planar=False)
        found.append(last)
    return found


def moments(joint: Any, n: int, *, records: Any = None) -> dict[str, list[float]]:
    """Normalised moments M / (E I_sum theta / L) of FE and EOB over ANGLES."""
    unit = bending_stiffness(joint) * ANGLES * deg
    fe = np.array([c.forces["turn"] for c in fem_path(hinge(joint), element_mesh(n))])
    solver = ksd.Solver(hinge(joint), mesh=element_mesh(n), **({"records": records} if records else {}))
    eob = np.array([solver(turn=a * deg, method="reduced", estimate=False).forces["turn"] for a in ANGLES])
    return {"fe": (fe / unit).tolist(), "eob": (eob / unit).tolist()}


def figure_7(*, meshes: tuple[int, ...]) -> dict[str, Any]:
    """Normalised moment over rotation: the default joint; outer leaf springs four times as wide."""
    default, wide = cross_flexure(), cross_flexure(widths=(40 * mm, WIDTH_FACTOR * 20 * mm))
    found: dict[str, Any] = {
        "rotation_deg": ANGLES.tolist(),
        "default": {n: moments(default, n) for n in meshes},
        "wide": {n: moments(wide, n) for n in (meshes[0], meshes[-1])},
        "wide_default_functions": {
            n: moments(wide, n, records=DefaultShape) for n in (meshes[0], meshes[-1])
        },
    }
    exact = [c.forces["turn"] for c in fem_path(hinge(default), REFERENCE_MESH)]
    found["converged"] = (np.array(exact) / (bending_stiffness(default) * ANGLES * deg)).tolist()
    found["largest_difference_eob_fe"] = {
        n: float(np.max(np.abs(np.subtract(c["eob"], c["fe"])))) for n, c in found["default"].items()
    }
    return found


def draw_7(found: dict[str, Any]) -> Any:
    """The moments of Fig. 7 as stored."""
    figure, ((a, b),) = figure_grid(
        1, 2, size=(4.6, 3.7), title="Fig. 7 of paper 1: moment of the cross flexure"
    )
    for color, (n, curves) in zip(
        ordered_colors(len(found["default"])), found["default"].items(), strict=True
    ):
        a.plot(ANGLES, curves["fe"], color=color, linewidth=3.5, alpha=0.35, label=f"FE, n = {n}")
        a.plot(ANGLES, curves["eob"], color=color, linewidth=1.2, linestyle="--", label=f"EOB, n = {n}")
    a.plot(
        ANGLES, found["converged"], color=TEXT_COLOR, linewidth=0.9, label="converged (strain-mode leaves)"
    )
    label_axes(a, x="rotation θ [deg]", y="M / (E ΣI θ / L) [-]", title="(a) default joint")
    _wide_panel(b, found)
    a.sharey(b)
    return figure


def _wide_panel(axes: Any, found: dict[str, Any]) -> None:
    for n, color in zip(found["wide"], ordered_colors(len(found["wide"])), strict=True):
        wide, fixed = found["wide"][n], found["wide_default_functions"][n]
        default = found["default"][n]["fe"]
        axes.plot(ANGLES, default, color=FAINT_COLOR, linewidth=1.0, label=f"FE, default widths, n = {n}")
        axes.plot(ANGLES, wide["fe"], color=color, linewidth=3.5, alpha=0.35, label=f"FE, wide, n = {n}")
        axes.plot(
            ANGLES, wide["eob"], color=color, linewidth=1.2, linestyle="--", label="EOB, widths in record"
        )
        axes.plot(
            ANGLES,
            fixed["eob"],
            color=color,
            linewidth=1.2,
            linestyle=":",
            label="EOB, default functions (paper)",
        )
    label_axes(
        axes, x="rotation θ [deg]", y="M / (E ΣI θ / L) [-]", title="(b) outer leaf springs 4 times as wide"
    )


def under_side_force(n: int, scaled: float) -> dict[str, Any]:
    """Lift of node B over L and moment over E I_sum / L under a force across: reduced and full."""
    joint = cross_flexure()
    unit = bending_stiffness(joint)
    force = scaled * unit / joint.length
    scene = hinge(joint, force=force)
    full = fem_path(scene, element_mesh(n))
    solver = ksd.prepare(scene, mesh=element_mesh(n))
    reduced = [solver(turn=a * deg, method="reduced", estimate=False) for a in ANGLES]
    found: dict[str, Any] = {"force_N": force, "stable": all(c.stable for c in full)}
    for name, states in (("full", full), ("reduced", reduced)):
        lifts = [c.displacement("tip", joint.pose_B)[2] for c in states]
        found[name] = {
            "lift": [v / joint.length for v in lifts],
            "moment": [c.forces["turn"] / unit for c in states],
        }
    return found


def figure_8(*, forces: tuple[float, ...] = SCALED_FORCES) -> dict[str, Any]:
    """Disturbance force in z on node B, four elements per leaf: lift and moment, reduced and full."""
    cases = {f: under_side_force(4, f) for f in forces}
    return {"rotation_deg": ANGLES.tolist(), "elements": 4, "cases": cases}


def draw_8(found: dict[str, Any]) -> Any:
    """Lift and moment of Fig. 8 as stored."""
    title = f"Fig. 8 of paper 1: force $F_z$ across the cross flexure, n = {found['elements']}"
    figure, ((a, b),) = figure_grid(1, 2, size=(4.6, 3.7), title=title)
    for color, (scaled, case) in zip(
        ordered_colors(len(found["cases"])), found["cases"].items(), strict=True
    ):
        for axes, key in ((a, "lift"), (b, "moment")):
            name = f"$\\bar F$ = {float(scaled):g} ({case['force_N']:.0f} N)"
            axes.plot(
                ANGLES, case["full"][key], color=color, linewidth=3.5, alpha=0.35, label=f"{name}, full"
            )
            axes.plot(
                ANGLES, case["reduced"][key], color=color, linewidth=1.2, linestyle="--", label="reduced"
            )
    label_axes(
        a,
        x="rotation θ [deg]",
        y="displacement of B in z / L [-]",
        title="(a)   $\\bar F = F_z L^2 / (E ΣI)$",
    )
    label_axes(b, x="rotation θ [deg]", y="M L / (E ΣI) [-]", title="(b)", legend=False)
    return figure
