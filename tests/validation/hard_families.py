"""Hard cases of further kinds of scenes: arms of every trained family, drives that hold a body together in space, thick and
taut leaf springs."""

from functools import partial

import numpy as np
from hard_cases import Case
from scenes import STEEL, guided_leaf

import ksd
from ksd.training.catalogue import FAMILY_DESIGNS

CHAINS = "chains of 200 and 400 elements, extrapolated"


def arm(family: str, count: int) -> ksd.Mechanism:
    """Joints of a family in series about z, y, z, ..., every motion driven, a force across and along at the end."""
    entry = FAMILY_DESIGNS[family]
    joint = entry.make(**{p.name: 0.5 * (p.low + p.high) for p in entry.parameters})
    soft = min(f.material.E * f.section.Iz / f.length**2 for f in joint.leaves())
    scene, base, size = ksd.Mechanism(f"arm of {family}"), "ground", joint.length
    for k in range(count):
        link = scene.link(f"link {k}")
        axis, toward = ("z", "x") if k % 2 == 0 else ("y", "x")
        scene.join(base, link, joint, at=(2 * k * size, 0, 0), axis=axis, toward=toward, name=f"joint {k}")
        for motion in joint.motions:
            scene.actuate_joint(f"joint {k}", name=f"{motion.name} {k}", motion=motion.name)
        base = link
    scene.load(base, force=(0.3 * soft, soft, 0.5 * soft), at=(2 * count * size, 0, 0))
    return scene


def moved(family: str, count: int) -> dict[str, float]:
    """Drive values of `arm`: rotations of .2 to .4 rad, strokes of a tenth of the length, of either sign."""
    entry = FAMILY_DESIGNS[family]
    joint = entry.make(**{p.name: 0.5 * (p.low + p.high) for p in entry.parameters})
    notch = 0.25 if "notch" in family else 1.0
    found = {}
    for k in range(count):
        for m, motion in enumerate(joint.motions):
            size = 0.1 * joint.length if motion.kind == "translation" else notch * (0.4 - 0.1 * k)
            found[f"{motion.name} {k}"] = size * (-1) ** (k + m)
    return found


def forces(found):
    """All drive forces."""
    return np.array(list(found.forces.values()))


def platform(drives: str) -> ksd.Mechanism:
    """A body on three folded leaf springs, lifted and tilted by three points or by sums of them, a force across it."""
    scene, radius = ksd.Mechanism("platform"), 0.05
    top = scene.link("platform", at=(0, 0, 0))
    leaf = ksd.FoldedLeaf(STEEL, length=0.03, thickness=0.3e-3, width=0.015)
    turns = np.deg2rad([90.0, 210.0, 330.0])
    feet = np.stack([radius * np.cos(turns), radius * np.sin(turns), np.zeros(3)], axis=1)
    for k, p in enumerate(feet):
        out = p / radius
        scene.constrain(
            top, scene.ground, leaf, at=p, axis=np.cross((0, 0, 1.0), out), toward=out, name=f"fold {k}"
        )
    z = [scene.displacement(top, "z", at=p) for p in feet]
    if drives == "points":
        for k, term in enumerate(z):
            scene.actuate(terms=term, name=f"z{k}")
    else:
        scene.actuate(terms=[t * (1 / 3) for t in z], name="lift")
        scene.actuate(
            terms=[z[0] * (2 / 3 / radius), z[1] * (-1 / 3 / radius), z[2] * (-1 / 3 / radius)], name="tip"
        )
        scene.actuate(terms=[z[2] * (1 / 3**0.5 / radius), z[1] * (-1 / 3**0.5 / radius)], name="tilt")
    scene.load(top, force=(5.0, -3.0, 2.0), at=(0.01, 0.02, 0.03))
    return scene


def sheared(slenderness: float, way: float) -> float:
    """Force [N] of a thick `guided_leaf` for small `way` [m]: two halves of a cantilever, L^3 / (12 EI) + L / (k G A)."""
    section = ksd.rectangle(0.1 / slenderness, 0.02)
    return way / (0.1**3 / (12 * STEEL.E * section.Iz) + 0.1 / (5 / 6 * STEEL.G * section.A))


def _arms() -> list[Case]:
    return [
        Case(
            f"arm of three {family}", "joints in series about z, y, z, all driven, loaded in space", partial(arm, family, 3),
            answer, moved(family, 3), read=forces,
        )
        for family, answer in ANSWERS["arms"].items()
    ]  # fmt: skip


def _held() -> list[Case]:
    points = {"z0": 1.5e-3, "z1": -0.5e-3, "z2": 0.4e-3}
    sums = {"lift": 5e-4, "tip": 0.02, "tilt": -0.03}
    cases = [
        Case(f"platform on three folds, {name}", "drives hold lift and tilts together", partial(platform, drives),
             ANSWERS[drives], values, read=forces, quick=True)
        for name, drives, values in (("three points", "points", points), ("sums of points", "sums", sums))
    ]  # fmt: skip
    cases += [
        Case(f"taut leaf, 1 : {slenderness}, moved {100 * way:g} %", "its ends bend within sqrt(EI/N)",
             partial(guided_leaf, slenderness, taut=True), (answer,), {"drive": 0.1 * way}, verified=CHAINS,
             quick=slenderness > 250)
        for (slenderness, way), answer in ANSWERS["taut"].items()
    ]  # fmt: skip
    cases += [
        Case(f"thick leaf, 1 : {slenderness}", "shear", partial(guided_leaf, slenderness, taut=False),
             (sheared(slenderness, 1e-6),), {"drive": 1e-6}, verified="closed form of Timoshenko", tolerance=1e-6,
             quick=slenderness == 3)
        for slenderness in (3, 5, 8)
    ]  # fmt: skip
    return cases


ANSWERS = {
    "arms": {
        "cross_flexure": (-19.77868127, 0.7392390391, -3.024636902),
        "crossed_pivot": (-2.86858464, 0.4470028847, -0.546054051),
        "balanced_crossed_pivot": (-1.442400372, -0.01248487222, -0.1860101411),
        "cartwheel": (-11.31386913, 1.709904958, -1.954041317),
        "butterfly": (-1.383108974, -0.5650280098, 0.4679133396),
        "infinity_hinge": (2.294515671, -3.442834655, 2.037119084),
        "triple_infinity_hinge": (-3.744848064, 0.1153200114, -0.509173066),
        "parallel_guide": (11.73253612, -15.6579796, 12.15036067),
        "stiffened_guide": (-139.6121811, 76.26775973, -33.23910611),
        "circular_notch": (-161.9336246, 46.38798578, -39.07489758),
        "filleted_notch": (-54.25345958, 20.86300968, -13.62179421),
        "arc_hinge": (-1.849427508, 0.1341453552, -0.01055506882),
        "universal": (-1.224121297, -0.7956302097, -0.7181814748, 1.94886368, -0.3340856028, -0.4719457304),
    },
    "points": (-0.985088068, -3.54999255, 3.600713542),
    "sums": (-0.9147488323, -0.05641031102, 0.02672492678),
    "taut": {
        (100, 0.05): 318.3326048,
        (300, 0.05): 90.22421052,
        (500, 0.05): 52.40231542,
        (500, 0.08): 210.097183,
    },
}
FAMILIES: list[Case] = [*_arms(), *_held()]
