"""The words of print(model) and of the report: which effects a model simulates, and which it leaves out."""

from __future__ import annotations

from typing import Any

import numpy as np

from ksd.model.chosen_effects import EFFECT_MEANINGS, NOT_MENTIONED, Effect, EffectChoice
from ksd.model.mesh import Mesh
from ksd.model.plate_runs import plate_conditions
from ksd.model.warping_runs import (
    clamped_twist,
    folded_junctions,
    half_clamped_torsion_factor,
    in_line_junctions,
    run_twists,
)

NEGLIGIBLE_CURVED_BAR = 1e-5
"""Softening of curved bars that is not said."""
_CURVE_STATIONS = np.linspace(0.0, 1.0, 33)


def constraint_lines(scene: Any) -> list[tuple[str, str]]:
    """Lines on the plane, the pins and sliders, and the points of leaf springs of a scene."""
    lines = []
    if scene.plane is not None:
        lines.append(("plane", f"{scene.plane}: links are held in it"))
    if scene.hinges:
        hinges = (f"{h.kind} '{h.name}' of '{h.b}' on '{h.a}'" for h in scene.hinges)
        lines.append(("without stiffness", ", ".join(hinges)))
    if points := [
        f"'{p.name}' at s = {1e3 * p.s:.4g} mm of '{p.leaf}'" for p in scene.points if not p.unlisted
    ]:
        lines.append(("points of leaf springs", ", ".join(points)))
    return lines


def shape_text(scene: Any) -> str:
    """Counts of curved, tapered, notched and stiffened leaf springs, whose shape is no effect that can be switched."""
    counts: dict[str, int] = {}
    for leaf in scene.leaf_names().values():
        for part, words in ((leaf.curve, "curved at rest"), (leaf.profile, "")):
            if part is not None:
                shape = words or _PROFILES.get(type(part).__name__, "of varying section")
                counts[shape] = counts.get(shape, 0) + 1
    return "".join(f"; {n} {'leaf springs' if n > 1 else 'leaf'} {shape}" for shape, n in counts.items())


_PROFILES = {
    "Taper": "tapered",
    "CircularNotch": "with a circular notch",
    "FilletedNotch": "with a filleted notch",
    "StiffenedMiddle": "with a stiffened middle",
}


def effect_lines(
    choice: EffectChoice | None, mesh: Mesh, scene: Any
) -> tuple[list[tuple[str, str]], list[tuple[str, str]]]:
    """(heading, text) of the effects that are present, and of those that are left out; scene: as the user described it.

    choice: None where the scene was compiled as it is, with the effects of its mesh.
    """
    lines: dict[bool, list[tuple[str, str]]] = {True: [], False: []}
    if choice is None:
        for name in ("shear", "warping", "plate"):
            is_present = getattr(mesh, name)
            lines[is_present].append((f"{'with' if is_present else 'without'} {name}", "as the mesh says"))
        return lines[True], lines[False]
    silent = []
    for effect in choice.effects:
        if not effect.present and effect.reason == NOT_MENTIONED:
            silent.append(EFFECT_MEANINGS[effect.name])
        elif effect.name != "spatial":
            heading = f"{'with' if effect.present else 'without'} {effect.name}"
            lines[effect.present].append((heading, effect_reason(effect, scene)))
    if silent:
        lines[False].append(("left out", f"{', '.join(silent)}: {NOT_MENTIONED.removesuffix('it')}them"))
    return lines[True], lines[False]


def effect_reason(effect: Effect, scene: Any) -> str:
    """Why an effect is simulated or not; for warping and plate stiffening with their influence on single leaf springs."""
    influence = {"warping": _warping_text, "plate": _plate_text}.get(effect.name)
    if influence is None:
        return effect.reason
    return f"{effect.reason}; {'' if effect.present else 'would be '}{influence(scene)}"


def _plate_text(scene: Any) -> str:
    """The bending stiffness that plate stiffening adds to the leaf to which it adds most, at small and at any curvature."""
    largest, text = 0.0, "no leaf is wide: 0 % more bending stiffness"
    leaves = scene.leaf_names()
    for name, condition in plate_conditions(scene).items():
        bent, guided = (1.0, 1.0) if condition.plate is None else condition.plate.small_factors
        if guided > largest:
            most = 1.0 / (1.0 - leaves[name].material.nu ** 2)
            largest, ratio = guided, leaves[name].section.width / leaves[name].length
            text = (
                f"{100 * (bent - 1):.2g} % more bending stiffness at small curvature, {100 * (guided - 1):.2g} % with its "
                f"ends kept parallel, at most {100 * (most - 1):.2g} % at a large one (leaf '{name}', w/L = {ratio:.3g})"
            )
    return text


def curved_bar_text(scene: Any) -> str:
    """What bars of a small radius are softer than beams in bending, of the leaf with the smallest over its thickness; empty
    below `NEGLIGIBLE_CURVED_BAR`."""
    ratios = {
        name: leaf.section.thickness * float(np.abs(leaf.curve.curvatures(_CURVE_STATIONS)[:, 2]).max())
        for name, leaf in scene.leaf_names().items()
        if leaf.curve is not None
    }
    name = max(ratios, key=ratios.__getitem__, default="")
    if not name or ratios[name] ** 2 / 30.0 < NEGLIGIBLE_CURVED_BAR:
        return ""
    return (
        f"curved bars: by up to (t/R)^2/30 = {100 * ratios[name] ** 2 / 30.0:.2g} % softer in bending "
        f"(leaf '{name}', t/R = {ratios[name]:.2g})"
    )


def _warping_text(scene: Any) -> str:
    """The largest torsional stiffness that restrained warping adds to a leaf, alone or in its run."""
    factors = {name: twist.factor for name, twist in run_twists(scene).items()}
    largest, which = 0.0, "no leaf has warping"
    for name, leaf in scene.leaf_names().items():
        if leaf.section.Iw > 0.0:
            more = (factors[name] if name in factors else clamped_twist(leaf).factor) - 1.0
            if more > largest:
                largest = more
                which = f"leaf '{name}', L/w = {leaf.length / max(leaf.section.width, 1e-300):.3g}"
    return f"{100 * largest:.2g} % more torsional stiffness ({which}){_junction_text(scene, factors)}"


def _junction_text(scene: Any, run_factors: dict[str, float]) -> str:
    """Text on the first junction of two leaf springs with warping: torsion factors with and without continuous warping."""
    leaves = scene.leaf_names()
    for one, two, block, warping_passes in in_line_junctions(scene):
        if not all(leaves[n].section.Iw > 0.0 for n in (one, two)):
            continue
        alone = [f"{clamped_twist(leaves[n]).factor:.3g}" for n in (one, two)]
        if warping_passes:
            return (
                f"; warping passes from leaf '{one}' to '{two}', as '{block}' carries nothing else: one run, "
                f"whose factors are {run_factors[one]:.3g} and {run_factors[two]:.3g} instead of {' and '.join(alone)}"
            )
        return (
            f"; leaf springs '{one}' and '{two}' meet end to end on '{block}', a body that holds their ends plane: their "
            f"factors are {' and '.join(alone)}, and would be less if warping could pass"
        )
    for one, two, block, _ in folded_junctions(scene):
        if all(leaves[n].section.Iw > 0.0 for n in (one, two)):
            factors = [
                " and ".join(f"{f(leaves[n]):.3g}" for n in (one, two))
                for f in (lambda leaf: clamped_twist(leaf).factor, half_clamped_torsion_factor)
            ]
            return (
                f"; leaf springs '{one}' and '{two}' meet at an angle on '{block}', taken to hold their ends plane: their "
                f"factors are {factors[0]}, and {factors[1]} if it did not hold them at all"
            )
    return ""
