"""The three mechanisms of paper 2, and stroke and support compliance of any basis beside the full model.

Dimensions are ours (the paper prints none): leaf springs 100 x 20 x 0.5 mm, so t/L = 1/200. Loads in EI/L^2 and EI/L of
one leaf.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

import ksd
from ksd.answers.stiffness import point_stiffness
from ksd.modal import ModalBasis, with_modal_bodies
from ksd.model.compile import Model, compile_scene
from ksd.model.mesh import Mesh
from ksd.section import rectangle
from ksd.solvers.configuration import Configuration
from ksd.solvers.conventional import solve_conventional

STEEL = ksd.Material(E=200e9, G=76.9e9, density=7800)
L, W, T = 0.1, 0.02, 0.5e-3
EI = STEEL.E * W * T**3 / 12
LEAF_DISTANCE = 0.1
"""Distance [m] of the leaves of the parallel guide: a leaf's length. The paper prints none; from .9 to 1.5 L the stroke of
1 % error and its order are those of section E. The closer they are, the more the shuttle turns with one leaf pulled and
the other pushed, which hides the order and asks for shapes of a buckled leaf (`paper2.spacings`)."""
PRINTED = ModalBasis(coordinates="angle", frame="node", internal=0, plane=True)
"""Paper 2 as printed."""
DEFAULT = ModalBasis(plane=True)
"""Director coordinates, chord frame, 2 internal modes: 19 unknowns in the plane of a leaf."""


def add_leaves(scene: ksd.Mechanism, link: Any, ends: list[tuple[tuple, tuple]]) -> None:
    """Leaf springs from ground to a link, each between two points (x, y) [m]."""
    for k, (start, end) in enumerate(ends):
        scene.leaf(
            scene.ground, link, start=(*start, 0.0), end=(*end, 0.0), section=rectangle(T, W), material=STEEL,
            width_axis="z", name=f"leaf {k + 1}",
        )  # fmt: skip


def cantilever(load: float) -> ksd.Mechanism:
    """A leaf with a dead transverse tip load [EI/L^2]; stroke: deflection over L."""
    scene = ksd.Mechanism("cantilever")
    tip = scene.link("tip")
    add_leaves(scene, tip, [((0, 0), (L, 0))])
    scene.load(tip, force=(0, load * EI / L**2, 0), at=(L, 0, 0))
    return scene


def guide(
    load: float, *, spread: float = LEAF_DISTANCE, held: bool = False, level: float = 1.0
) -> ksd.Mechanism:
    """Two parallel leaf springs, loaded across [EI/L^2] at `level` of their length; stroke: deflection over L.

    held: the shuttle does not turn.
    """
    scene = ksd.Mechanism("parallel guide")
    tip = scene.link("tip")
    add_leaves(scene, tip, [((0, y), (L, y)) for y in (-0.5 * spread, 0.5 * spread)])
    if held:
        scene.support(tip, about="z")
    scene.load(tip, force=(0, load * EI / L**2, 0), at=(level * L, 0, 0))
    return scene


def cross(load: float) -> ksd.Mechanism:
    """Two leaf springs crossing at 90 degrees under a moment [EI/L]; stroke: rotation in degrees."""
    scene = ksd.Mechanism("cross flexure")
    tip, c = scene.link("tip"), L * np.sqrt(0.5)
    add_leaves(scene, tip, [((0, -0.5 * c), (c, 0.5 * c)), ((0, 0.5 * c), (c, -0.5 * c))])
    scene.load(tip, moment=(0, 0, load * EI / L))
    return scene


CASES: dict[str, tuple[Callable[..., ksd.Mechanism], tuple[float, float, float]]] = {
    "cantilever": (cantilever, (L, 0.0, 0.0)),
    "parallel guide": (guide, (L, 0.0, 0.0)),
    "cross flexure": (cross, (L * np.sqrt(0.5) / 2, 0.0, 0.0)),
}
"""Function of the load, and of words for the scene, that returns it, and the point of the support stiffness."""


def stroke(found: Configuration) -> float:
    """Deflection over L of the tip's end, or rotation in degrees of the cross flexure."""
    if found.model.scene.name == "cross flexure":
        return float(np.rad2deg(found.rotation("tip")[2]))
    return float(found.displacement("tip", (L, 0, 0))[1] / L)


def support_compliance(found: Configuration, at: tuple[float, float, float]) -> float:
    """Compliance along x [m/N] of the point that is at `at` at rest, with the stroke held."""
    held = "rz" if found.model.scene.name == "cross flexure" else "y"
    return 1.0 / point_stiffness(found.model, found.motion, "tip", at=at).support("x", held=(held,))


def full_model(case: str, load: float, elements: int, **words: Any) -> Model:
    """Model of a case with chains of Appendix A elements; words: of its scene."""
    return compile_scene(CASES[case][0](load, **words), mesh=Mesh("corotational", elements=elements))


def solve_loads(model: Model, *, planar: bool = False) -> Configuration:
    """Equilibrium under the loads of the scene, in four load steps."""
    return solve_conventional(model, {}, planar=planar, steps=4)


def basis_errors(case: str, load: float, basis: ModalBasis, **words: Any) -> dict[str, float]:
    """Stroke of the full model, and errors of stroke and support compliance of the reduced one (fractions); words: of the
    scene."""
    model = full_model(case, load, basis.elements, **words)
    reduced = with_modal_bodies(model, basis)
    a, b = solve_loads(model, planar=True), solve_loads(reduced)
    at = CASES[case][1]
    return {
        "stroke": stroke(a),
        "stroke_error": stroke(b) / stroke(a) - 1.0,
        "support_error": support_compliance(b, at) / support_compliance(a, at) - 1.0,
        "unknowns": float(max(b.unknowns for b in reduced.bodies.values())),
    }


def strain_mode_errors(case: str, load: float, order: int, reference: Mesh) -> dict[str, float]:
    """The same of the strain-mode leaf with `order` modes of weak bending, against a strain-mode `reference`."""
    scene = CASES[case][0](load)
    made = []
    for mesh in (reference, Mesh(orders=(4, 3, order), points=order + 3)):
        found = solve_loads(compile_scene(scene, mesh=mesh), planar=False)
        made.append((stroke(found), support_compliance(found, CASES[case][1])))
    (a, c), (b, d) = made
    return {"stroke": a, "stroke_error": b / a - 1.0, "support_error": d / c - 1.0, "unknowns": float(order)}


def one_percent(case: str, basis: ModalBasis, **words: Any) -> tuple[float, float]:
    """Stroke at which the stroke error is 1 %, and the order with which the error grows there; words: of the scene."""
    from scipy.optimize import brentq

    low, high = {"cantilever": (0.15, 0.5), "parallel guide": (1.0, 5.0), "cross flexure": (0.2, 0.6)}[case]
    found: dict[float, dict[str, float]] = {}

    def excess(load: float) -> float:
        found[load] = basis_errors(case, load, basis, **words)
        return abs(found[load]["stroke_error"]) - 0.01

    load = float(brentq(excess, low, high, xtol=1e-3 * low))
    at = found.get(load) or basis_errors(case, load, basis, **words)
    half = basis_errors(case, 0.5 * load, basis, **words)
    order = np.log(at["stroke_error"] / half["stroke_error"]) / np.log(at["stroke"] / half["stroke"])
    return at["stroke"], float(order)
