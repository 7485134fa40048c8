"""Answers that must not be trusted in silence: scenes in other units, blocks bent like leaves, taut leaves, loose residuals;
and refusals of states under heavy dead loads that a stable path leads to.

    python benchmarks/robust_trust.py [count]

Counted are answers that are wrong, or that no flexure can have, without a word, and false refusals; all counts should be
zero.
"""

from __future__ import annotations

import sys
from collections import Counter
from typing import Any

import numpy as np
from robust_estimates import JOINTED, REFERENCE_MESH, scenes, softest
from scipy.integrate import solve_bvp

import ksd
from ksd.errors import KsdError
from ksd.solvers.conventional import solve_conventional

E, NU = 200e9, 0.3
ACCURACY = 1e-3
SAME_STATE_TOLERANCE = 0.02
"""Largest difference of positions, over the size, of an answer from the end of its path."""


def leaf(length: float, thickness: float, width: float, *, held: bool, modulus: float = E) -> ksd.Mechanism:
    """A leaf along x, its end moved across with length and direction `held`, or turned."""
    m = ksd.Mechanism("leaf")
    tip = m.link("tip")
    m.leaf(
        m.ground, tip, start=(0, 0, 0), end=(length, 0, 0), section=ksd.rectangle(thickness, width),
        material=ksd.Material(modulus, nu=NU), width_axis="z", name="leaf",
    )  # fmt: skip
    if held:
        m.actuate(tip, along="y", at=(length, 0, 0), name="drive")
        m.support(tip, along="x", at=(length, 0, 0))
        m.support(tip, about="z")
    else:
        m.actuate(tip, about="z", name="drive")
    return m


def rod(slenderness: float, way: float, before: Any = None) -> Any:
    """Clamped Reissner rod of unit length, EA = 1, length over thickness `slenderness`, its end moved across by `way`.

    Returns the solution of scipy; its p are the forces along and across over 0.01 EA.
    """
    EI, GA = 1 / (12 * slenderness**2), 5 / 6 / (2 * (1 + NU))

    def slope(_: Any, Y: Any, p: Any) -> Any:
        c, s = np.cos(Y[2]), np.sin(Y[2])
        stretch, shear = 1 + 0.01 * (p[0] * c + p[1] * s), 0.01 * (p[1] * c - p[0] * s) / GA
        dx, dy = stretch * c - shear * s, stretch * s + shear * c
        return np.vstack([dx, dy, Y[3], -0.01 * (dx * p[1] - dy * p[0]) / EI])

    def ends(a: Any, b: Any, _: Any) -> Any:
        return np.array([a[0], a[1], a[2], b[0] - 1, b[1] - way, b[2]])

    # ends of taut rods bend within a hundredth of the length
    s = 0.5 * (1 - np.cos(np.pi * np.linspace(0, 1, 401)))
    if before is None:
        start = np.vstack([s, way * (3 * s**2 - 2 * s**3), way * 6 * (s - s * s), way * (6 - 12 * s)])
        found = solve_bvp(slope, ends, s, start, p=np.array([0.01, 0.01]), tol=1e-7, max_nodes=100_000)
    else:
        found = solve_bvp(slope, ends, before.x, before.y, p=before.p, tol=1e-7, max_nodes=100_000)
    if not found.success:
        raise RuntimeError(found.message)
    return found


def check_taut(count: int, rng: np.random.Generator) -> int:
    """Taut leaf springs against the rod: wrong by more than the accuracy asked for, and trusted without a word."""
    silent, worst, told = 0, 0.0, 0
    for _ in range(count):
        slenderness, way = 10 ** rng.uniform(1.3, 2.5), 10 ** rng.uniform(-1.7, -0.5)
        solution: Any = None
        for share in np.linspace(0.25, 1.0, 4):
            solution = rod(slenderness, share * way, solution)
        right = 0.01 * solution.p[1] * E * 0.1 / slenderness * 0.02
        pose = ksd.solve(leaf(0.1, 0.1 / slenderness, 0.02, held=True), {"drive": 0.1 * way}, strict=False)
        off = abs(pose.forces["drive"] / right - 1)
        told += bool(pose.warnings)
        if off > ACCURACY and pose.trusted and not pose.warnings:
            silent += 1
        if not pose.warnings:
            worst = max(worst, off)
    print(
        f"taut leaves: {silent} of {count} off by more than {ACCURACY:g} in silence; {told} with a warning, ",
        end="",
    )
    print(f"the others off by at most {worst:.1e}")
    return silent


def check_units(count: int, rng: np.random.Generator) -> int:
    """Random leaf springs in SI, and the same with moduli in MPa, lengths in mm, or the thickness of a block."""
    loud = silent = trusted = 0
    for _ in range(count):
        length = 10 ** rng.uniform(-2.5, -0.3)
        thickness, width, angle = length / 10 ** rng.uniform(1.5, 2.5), length * rng.uniform(0.1, 0.9), 0.1
        loud += bool(ksd.solve(leaf(length, thickness, width, held=False), {"drive": angle}).warnings)
        wrong = (
            leaf(length, thickness, width, held=False, modulus=1e-6 * E),
            leaf(1e3 * max(length, 0.01), 1e3 * thickness, 1e3 * width, held=False),
            leaf(length, length / rng.uniform(1.5, 4.5), 0.5 * length, held=False),
        )
        silent += sum(not ksd.solve(scene, {"drive": angle}).warnings for scene in wrong)
        block = ksd.solve(leaf(length, length / 2.5, 0.2 * length, held=False), {"drive": 0.4})
        trusted += block.trusted
    print(
        f"units: {silent} of {3 * count} scenes in other units or of blocks silent, {loud} of {count} good ones warned of"
    )
    print(f"blocks bent to 8 %: {trusted} of {count} trusted")
    return silent + loud + trusted


def check_residuals(count: int, rng: np.random.Generator) -> int:
    """Residuals beyond their bound beside "within its bound", and forces changed by one more Newton step."""
    wrong, solved, most = 0, 0, 0.0
    for _ in range(count):
        slenderness, way = 10 ** rng.uniform(1.3, 3.2), 10 ** rng.uniform(-3.0, -0.5)
        model = ksd.compile_scene(leaf(0.1, 0.1 / slenderness, 0.02, held=True).scene())
        try:
            pose = solve_conventional(model, {"drive": 0.1 * way})
        except KsdError:
            continue
        again = solve_conventional(model, {"drive": 0.1 * way}, start=pose)
        solved += 1
        wrong += pose.steps[-1].residual > 1.0 and "within its bound" in pose.steps[-1].reason
        most = max(most, abs(again.forces["drive"] / pose.forces["drive"] - 1))
    print(
        f"residuals: {wrong} of {solved} said to be within a bound they exceed; a force moves by {most:.1e} at most"
    )
    return wrong


def check_heavy_loads(count: int) -> int:
    """Heavy dead forces on mechanisms at a tenth of their way: those refused though a path of stable states leads there, the
    loads put on after the drives, on leaf springs of many modes; and answers that are not the end of that path."""
    told: Counter[str] = Counter()
    draw = scenes(23, JOINTED)
    for k in range(count):
        scene, targets, rng = next(draw)
        targets = {name: 0.1 * value for name, value in targets.items()}
        made = scene.scene()
        link, stiff = made.joints[-1].b, softest([placed.joint for placed in made.joints])
        force = rng.normal(size=3) * (1, 1, 0.3)
        force *= stiff * 10 ** rng.uniform(0.5, 2.0) / np.linalg.norm(force)
        place = made.joints[-1].place(made.joints[-1].joint.pose_B)
        scene.load(link, force=tuple(force), at=tuple(place))
        pose = None
        try:
            pose = ksd.solve(scene, targets)
        except KsdError as reason:
            said = str(reason)
        try:
            path = ksd.follow(scene, targets, mesh=REFERENCE_MESH)
            end = path.ended and not path.turnings and all(s.stable for s in path.states) and path.states[-1]
        except KsdError:
            end = None
        if pose is None:
            told["refused"] += 1
            if end:
                told["refused falsely"] += 1
                print(f"scene {k}: a stable path leads there, but: {said}", flush=True)
        elif end:
            size, own = pose.model.arrays.size, {n: d for n, (d, _) in pose.links.items()}
            off = max(np.abs(own[n] - d).max() for n, (d, _) in end.links.items()) / size
            told[
                "answered, the end of its path" if off < SAME_STATE_TOLERANCE else "answered, another minimum"
            ] += 1
            if off >= SAME_STATE_TOLERANCE:
                print(f"scene {k}: another minimum than the path ends in, by {off:.1e}: {pose.trust.branch}")
        else:
            told["answered, its path turns or is not followed"] += 1
    print(f"heavy dead loads, {count}: {dict(told)}")
    return told["refused falsely"] + told["answered, another minimum"]


def main(count: int = 100) -> int:
    """Returns the sum of all counts."""
    rng = np.random.default_rng(19)
    return (
        check_units(count, rng)
        + check_residuals(count, rng)
        + check_taut(count, rng)
        + check_heavy_loads(2 * count)
    )


if __name__ == "__main__":
    sys.exit(main(*(int(word) for word in sys.argv[1:])) > 0)
