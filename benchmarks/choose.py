"""Which joint of the library for a job: +-20 degrees, 1 kg, 80 x 80 x 60 mm, 500 MPa, 2 Nm, and the highest first frequency.

Cross flexure, butterfly, infinity hinge and cartwheel are each optimised for the same job: the worst, over the poses, of the
first frequency with the turn held. Published: "of three cross hinges and a butterfly, optimised over +-20 degrees, the
butterfly loses least support stiffness" (Wiersma, Boer, Aarts and Brouwer, Large stroke performance optimization of
spatial flexure hinges, 2012). Writes results/choose.json and choose.png. Run: python benchmarks/choose.py [--quick]
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common import STEEL, figure_grid, label_axes, machine, parse_options, save_picture, write_json

import ksd
from ksd.units import deg, mm
from ksd.view.figure import FAINT_COLOR, LEAF_COLOR, LINE_COLORS, TEXT_COLOR

TURNS = np.array([-20, 0, 20]) * deg
MASS, SIZE = 1.0, 60 * mm
"""Mass [kg] of a cube of this edge [m] about the centre of rotation."""
LIMITS = {"stress_MPa": 500, "turn_moment_Nm": (-2, 2), "size_mm": (80, 80, 60)}
GOAL = "first_parasitic_Hz"


def arm_on_joint(joint: Any, centre: float) -> ksd.Mechanism:
    """An arm on a joint whose centre of rotation, at `centre` [m] from interface A, is the origin."""
    scene = ksd.Mechanism(type(joint).__name__)
    arm = scene.link("arm")
    placed = scene.join(scene.ground, arm, joint, at=(-centre, 0, 0), axis="z", toward="x", name="hinge")
    scene.mass(arm, mass=MASS, inertia=MASS * SIZE**2 / 6 * np.eye(3), at=(0, 0, 0))
    scene.actuate_joint(placed, name="turn")
    return scene


def cross(length: float, angle: float, thickness: float, inner: float, outer: float) -> ksd.Mechanism:
    """A cross flexure."""
    joint = ksd.CrossFlexure(STEEL, length=length, angle=angle, thickness=thickness, widths=(inner, outer))
    return arm_on_joint(joint, 0.5 * joint.length_AB)


def butterfly(
    length: float, radius: float, half_angle: float, thickness: float, width: float
) -> ksd.Mechanism:
    """A butterfly pivot; radius: at which its leaf springs begin."""
    joint = ksd.Butterfly(
        STEEL, length=length, inner=radius, half_angle=half_angle, thickness=thickness, width=width
    )
    return arm_on_joint(joint, radius + length)


def infinity(length: float, thickness: float, width: float, reach: float, strut: float) -> ksd.Mechanism:
    """An infinity hinge."""
    joint = ksd.InfinityHinge(
        STEEL, length=length, thickness=thickness, width=width, reach=reach, strut=strut
    )
    return arm_on_joint(joint, 0.5 * length)


def cartwheel(length: float, angle: float, thickness: float, width: float) -> ksd.Mechanism:
    """A cartwheel hinge."""
    joint = ksd.Cartwheel(STEEL, length=length, angle=angle, thickness=thickness, width=width)
    return arm_on_joint(joint, 0.5 * length * np.cos(angle))


JOINTS: dict[str, tuple[Callable[..., ksd.Mechanism], dict[str, tuple[float, float]]]] = {
    "butterfly": (butterfly, {"length": (15 * mm, 38 * mm), "radius": (2 * mm, 20 * mm), "half_angle": (8 * deg, 25 * deg),
                              "thickness": (0.1 * mm, 1 * mm), "width": (10 * mm, 60 * mm)}),
    "cross flexure": (cross, {"length": (40 * mm, 120 * mm), "angle": (31 * deg, 59 * deg), "thickness": (0.2 * mm, 1 * mm),
                              "inner": (10 * mm, 50 * mm), "outer": (4 * mm, 25 * mm)}),
    "infinity hinge": (infinity, {"length": (30 * mm, 80 * mm), "thickness": (0.1 * mm, 1 * mm), "width": (5 * mm, 26 * mm),
                                  "reach": (0.26, 0.59), "strut": (0.11, 0.59)}),
    "cartwheel": (cartwheel, {"length": (40 * mm, 120 * mm), "angle": (31 * deg, 59 * deg), "thickness": (0.1 * mm, 1 * mm),
                              "width": (10 * mm, 60 * mm)}),
}  # fmt: skip
"""Function and bounds of every joint."""


def jobs(names: Sequence[str]) -> dict[str, ksd.Job]:
    """The same job for every joint; without trained ranges as bounds, which are no property of a joint."""
    return {
        name: ksd.Job(
            JOINTS[name][0], vary=JOINTS[name][1], maximise={GOAL: 100.0}, limits=LIMITS, link="arm", at=(0, 0, 0), freed=(),
            modes=1, turn=TURNS, method="full", extrapolate=True,
        )
        for name in names
    }  # fmt: skip


def first_frequencies(best: ksd.Optimum) -> dict[str, float]:
    """First frequencies [Hz] of an optimum: the worst over the poses, that at rest, and their ratio."""
    found = {n: v for n, v in best.answers.items() if n.startswith(GOAL)}
    rest = next(v for n, v in found.items() if "turn 0 " in n)
    return {"worst_Hz": min(found.values()), "rest_Hz": rest, "kept": min(found.values()) / rest}


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Optimise, print, write; returns what was found."""
    asked = parse_options(__doc__, argv)
    chosen = ksd.choose(
        jobs(("butterfly", "cartwheel") if asked.quick else tuple(JOINTS)), starts=1 if asked.quick else 3
    )
    rows = {
        name: {
            **first_frequencies(best), "design": dict(best.design), "held": list(best.held), "values": best.evaluations,
            "gradients": best.gradients, "seconds": best.seconds, "agreed": best.agreed,
        }
        for name, best in chosen.optima.items() if best is not None
    }  # fmt: skip
    found = {"machine": machine(), "optima": rows, "status": dict(chosen.status)}
    write_json(found, asked.out / "choose.json")
    print(chosen)
    for name, row in rows.items():
        print(f"{name:15} {row['worst_Hz']:6.1f} Hz of {row['rest_Hz']:6.1f} at rest: {row['kept']:.0%} kept")
    picture(found, asked.out / "choose.png")
    return found


def picture(found: dict[str, Any], path: Path) -> None:
    """First frequency at rest and the worst one of every joint, and their ratio."""
    figure, ((axes,),) = figure_grid(
        1, 1, size=(5.5, 3.2), title="First frequency with the turn held, optimised joints"
    )
    rows = found["optima"]
    for k, row in enumerate(rows.values()):
        ends = [row["worst_Hz"], row["rest_Hz"]]
        axes.plot(ends, [k, k], "-", color=FAINT_COLOR, linewidth=3, zorder=1)
        said = f"{100 * row['kept']:.0f} % kept"
        axes.annotate(
            said, (ends[1], k), (8, 0), textcoords="offset points", va="center", fontsize=8, color=TEXT_COLOR
        )
    places = range(len(rows))
    axes.plot([r["rest_Hz"] for r in rows.values()], places, "o", color=LINE_COLORS[1], label="at rest")
    axes.plot([r["worst_Hz"] for r in rows.values()], places, "o", color=LEAF_COLOR, label="worst over ±20°")
    axes.set_yticks(list(places), list(rows))
    axes.set_ylim(len(rows) - 0.6, -0.6)
    axes.set_xlim(0, 1.2 * max(r["rest_Hz"] for r in rows.values()))
    label_axes(axes, x="first frequency [Hz]", y="", legend=True)
    save_picture(figure, path)


if __name__ == "__main__":
    main()
