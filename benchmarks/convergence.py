"""Claim: the Appendix A chains converge to the strain-mode leaf under refinement, at second order or better,
in every quantity.

`python benchmarks/convergence.py` computes moment, length, support stiffness, buckling, frequencies, large deflection
and notch compliance with 2 to 32 elements per leaf, takes the strain-mode leaf as reference, and writes the errors into
convergence.json and convergence.png.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import common
import numpy as np
from common import STEEL, machine, parse_options, save_picture, write_json

import ksd
from ksd.answers.buckling import buckling
from ksd.model.mesh import Mesh
from ksd.solvers.conventional import solve_conventional
from ksd.units import deg
from ksd.view.figure import GROUND_COLOR, TEXT_COLOR, label_axes, new_figure, ordered_colors

REFERENCE = Mesh(orders=(7, 5, 10), points=14)
ELEMENTS = (2, 4, 8, 16, 32)
THIN = ksd.rectangle(0.5e-3, 20e-3)


def _state(scene: ksd.Mechanism, mesh: Mesh, steps: int = 1, **drives: float) -> ksd.Configuration:
    return solve_conventional(ksd.compile_scene(scene, mesh=mesh), drives, steps=steps)


def hinge_moment(mesh: Mesh) -> float:
    """Moment of the cross flexure at 60 degrees [Nm]."""
    return _state(common.hinge(), mesh, steps=4, turn=60 * deg).forces["turn"]


def hinge_length(mesh: Mesh) -> float:
    """Distance of its interfaces at 60 degrees [m]."""
    return float(np.linalg.norm(_state(common.hinge(), mesh, steps=4, turn=60 * deg).motion.x[1]))


def _support(mesh: Mesh, direction: str) -> float:
    found = _state(common.hinge(), mesh, steps=2, turn=-30 * deg)
    middle = tuple(0.5 * np.asarray(common.cross_flexure().pose_B))
    return found.stiffness("tip", at=middle).support(direction)


def support_x(mesh: Mesh) -> float:
    """Support stiffness of the cross flexure at -30 degrees along A to B [N/m]."""
    return _support(mesh, "x")


def support_z(mesh: Mesh) -> float:
    """The same along the hinge axis [N/m]."""
    return _support(mesh, "z")


def support_y(mesh: Mesh) -> float:
    """The same across, in the plane of motion [N/m]."""
    return _support(mesh, "y")


def _guide(mesh: Mesh, direction: str) -> float:
    scene = ksd.Mechanism("guide")
    shuttle = scene.link("shuttle")
    for k, y in enumerate((-0.03, 0.03)):
        scene.leaf(
            scene.ground, shuttle, start=(0, y, 0), end=(0.1, y, 0), width_axis=(0, 0, 1), name=f"leaf {k}",
            section=ksd.rectangle(0.5e-3, 30e-3), material=STEEL,
        )  # fmt: skip
    scene.actuate(shuttle, along="y", at=(0.1, 0, 0), name="stroke")
    scene.support(shuttle, about="z", name="level")
    found = _state(scene, mesh, steps=2, stroke=5e-3)
    return found.stiffness("shuttle", at=(0.1, 0, 0), freed=["level"]).support(direction)


def guide_x(mesh: Mesh) -> float:
    """Support stiffness of a parallel guide along its leaf springs at 5 mm [N/m]."""
    return _guide(mesh, "x")


def guide_z(mesh: Mesh) -> float:
    """The same out of its plane [N/m]."""
    return _guide(mesh, "z")


def fourbar_force(mesh: Mesh) -> float:
    """Drive force of the fourbar, second reading, d = 0.3 m [N]."""
    return _state(common.fourbar(2), mesh, steps=3, top=0.3).forces["top"]


def fourbar_rotation(mesh: Mesh) -> float:
    """Rotation of its top link there [rad]."""
    return float(_state(common.fourbar(2), mesh, steps=3, top=0.3).rotation("top")[2])


def _strip(**leaf: Any) -> ksd.Mechanism:
    scene = ksd.Mechanism("strip")
    tip = scene.link("tip")
    words: dict[str, Any] = {
        "section": THIN,
        "material": STEEL,
        "width_axis": (0, 0, 1),
        "end": (0.1, 0, 0),
        **leaf,
    }
    scene.leaf(scene.ground, tip, start=(0, 0, 0), name="leaf", **words)
    return scene


def column(mesh: Mesh) -> float:
    """Buckling load of a clamped-clamped leaf [N]."""
    scene = _strip()
    for axis in "yz":
        scene.support("tip", along=axis, at=(0.1, 0, 0))
    for axis in "xyz":
        scene.support("tip", about=axis, at=(0.1, 0, 0))
    model = ksd.compile_scene(scene, mesh=mesh)
    return float(buckling(model, model.rest, "tip", force=(-1, 0, 0), at=(0.1, 0, 0)).positive)


def strip(mesh: Mesh) -> float:
    """Lateral buckling load of a cantilever strip (Prandtl) [N]."""
    model = ksd.compile_scene(_strip(), mesh=mesh)
    return float(buckling(model, model.rest, "tip", force=(0, 0, 1), at=(0.1, 0, 0)).positive)


def _clamped(mesh: Mesh) -> np.ndarray:
    """Frequencies [Hz] of a clamped-clamped leaf so thin that the inertia of its shear does not count."""
    scene = _strip(section=ksd.rectangle(0.05e-3, 20e-3))
    scene.actuate("tip", along="x", at=(0.1, 0, 0), name="pull")
    for axis in "yz":
        scene.support("tip", along=axis, at=(0.1, 0, 0))
    for axis in "xyz":
        scene.support("tip", about=axis)
    return _state(scene, mesh, pull=0.0).frequencies(count=2).frequency_Hz


def frequency(mesh: Mesh) -> float:
    """First frequency of a clamped-clamped leaf [Hz]."""
    return float(_clamped(mesh)[0])


def second_frequency(mesh: Mesh) -> float:
    """Its second one [Hz]."""
    return float(_clamped(mesh)[1])


def elastica(mesh: Mesh) -> float:
    """Deflection of a cantilever under P L^2 / E I = 5 [m]."""
    scene = _strip()
    scene.load("tip", force=(0, 5 * STEEL.E * THIN.Iz / 0.01, 0), at=(0.1, 0, 0))
    return float(_state(scene, mesh, steps=4).links["tip"][0][1])


def curved(mesh: Mesh) -> float:
    """Tip displacement of the 45 degree bend under 600, out of its plane [R = 100, published units]."""
    material = ksd.Material(E=1e7, nu=0.0)
    square = ksd.numbers(A=1.0, J=1 / 6, Iy=1 / 12, Iz=1 / 12, ky=1.0, kz=1.0, width=1.0, thickness=1.0)
    a = math.pi / 4
    end = (100 * math.sin(a), 100 * (1 - math.cos(a)), 0)
    scene = _strip(end=end, section=square, material=material, curve=ksd.Arc(radius=100.0, angle=a))
    scene.load("tip", force=(0, 0, 600), at=end)
    return float(np.linalg.norm(_state(scene, mesh, steps=6).links["tip"][0]))


def taper(mesh: Mesh) -> float:
    """Tip deflection of a tapered cantilever [m]."""
    profile = ksd.Taper(thickness=(1e-3, 0.5e-3), width=(40e-3, 20e-3))
    scene = _strip(section=profile.section(0.5), profile=profile)
    scene.load("tip", force=(0, 5.0, 0), at=(0.1, 0, 0))
    return float(_state(scene, mesh).links["tip"][0][1])


def notch(mesh: Mesh) -> float:
    """Rotation of a circular notch hinge, t/R = 0.2, under a moment [rad]."""
    profile = ksd.CircularNotch(radius=5e-3, minimum=1e-3, width=10e-3)
    scene = _strip(section=profile.section(0.5), profile=profile, end=(10e-3, 0, 0))
    scene.load("tip", moment=(0, 0, 1e-3), at=(10e-3, 0, 0))
    return float(_state(scene, mesh).rotation("tip")[2])


def arc(mesh: Mesh) -> float:
    """Linear compliance of a circular arc of 180 degrees, across its ends [m]."""
    end = (0.0, 0.1, 0.0)
    scene = _strip(end=end, curve=ksd.Arc(radius=0.05, angle=math.pi))
    scene.load("tip", force=(0, 1e-4, 0), at=end)
    return float(_state(scene, mesh).links["tip"][0][1])


QUANTITIES: tuple[Callable[[Mesh], float], ...] = (
    hinge_moment, hinge_length, support_x, support_y, support_z, guide_x, guide_z, fourbar_force, fourbar_rotation,
    column, strip, frequency, second_frequency, elastica, curved, arc, taper, notch,
)  # fmt: skip


def errors(quantity: Callable[[Mesh], float], elements: tuple[int, ...]) -> list[float]:
    """Relative errors of chains of `elements` against the strain-mode leaf."""
    exact = quantity(REFERENCE)
    return [abs(quantity(Mesh("corotational", elements=n)) / exact - 1) for n in elements]


def observed_order(found: Sequence[float]) -> float:
    """Observed order of the last refinement, elements doubling."""
    return math.log2(found[-2] / found[-1])


def picture(found: Mapping[str, Any], path: Path) -> None:
    """Errors over elements per leaf, the coarsest at the end light, named where they end."""
    figure = new_figure(8.4, 5.4)
    axes = figure.add_subplot()
    elements, table = found["elements"], found["errors"]
    order = sorted(table, key=lambda name: -table[name][-1])
    ends = spread_labels([math.log10(table[name][-1]) for name in order], 0.25)
    for name, end, color in zip(order, ends, ordered_colors(len(order)), strict=True):
        axes.loglog(elements, table[name], "o-", lw=1.2, ms=3.5, color=color)
        there = (elements[-1], table[name][-1])
        line = {
            "arrowstyle": "-",
            "color": color,
            "linewidth": 0.6,
            "shrinkA": 0,
            "shrinkB": 3,
            "relpos": (0, 0.5),
        }
        axes.annotate(
            name.replace("_", " "), there, (1.4 * elements[-1], 10**end), textcoords="data", va="center", fontsize=8,
            color=TEXT_COLOR, arrowprops=line, annotation_clip=False,
        )  # fmt: skip
    slope = [1e-3 * (elements[0] / n) ** 2 for n in elements]
    axes.loglog(elements, slope, "--", color=GROUND_COLOR, lw=1.2)
    place = (elements[0], slope[0])
    axes.annotate(
        "second order", place, (-4, -20), textcoords="offset points", fontsize=8, color=GROUND_COLOR
    )
    axes.set_xticks(elements, [str(n) for n in elements])
    axes.minorticks_off()
    axes.yaxis.set_major_formatter("{x:g}")
    label_axes(
        axes, "Chains of Appendix A elements converge to the strain-mode leaf",
        x="Appendix A elements per leaf", y="relative error against the strain-mode leaf",
    )  # fmt: skip
    save_picture(figure, path)


def spread_labels(places: Sequence[float], gap: float) -> list[float]:
    """Descending positions, moved as little as possible so that each is at least `gap` below the one before."""
    # the mean of the places of a crowd, each less what those before it take, is where the crowd fits best
    crowds: list[list[float]] = []
    for k, place in enumerate(places):
        crowds.append([place + k * gap])
        while len(crowds) > 1 and np.mean(crowds[-1]) > np.mean(crowds[-2]):
            last = crowds.pop()
            crowds[-1] += last
    flat = [float(np.mean(crowd)) for crowd in crowds for _ in crowd]
    return [place - k * gap for k, place in enumerate(flat)]


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Table of errors and observed orders, convergence.json and the picture; returns the numbers."""
    asked = parse_options(__doc__, argv)
    elements = ELEMENTS[:3] if asked.quick else ELEMENTS
    table = {}
    for quantity in QUANTITIES:
        table[quantity.__name__] = found = errors(quantity, elements)
        cells = "  ".join(f"{e:9.2e}" for e in found)
        print(f"{quantity.__name__:17s} {cells}   order {observed_order(found):.2f}")
    written = {"machine": machine(), "elements": elements, "errors": table}
    write_json(written, asked.out / "convergence.json")
    picture(written, asked.out / "convergence.png")
    return written


if __name__ == "__main__":
    main()
