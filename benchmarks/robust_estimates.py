"""Error estimates of answers against their true errors, over random scenes; prints counts.

    python benchmarks/robust_estimates.py [--scenes 1000] [--seed 0] [--part NAME ...]

Parts: `reduced`, what it tells of its force, against `full`; `mesh`, the error of answers on chains of elements and
strain-mode leaves of few modes by every method; `modal`, that of modal bodies, all joints of a scene or one; `questions`,
that of stiffness, frequencies, stress and energy (`with_error`). The truth of the last three is on strain-mode leaves of
orders (8, 8, 12), more than what an error is found with.
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

import ksd
from ksd.errors import KsdError
from ksd.modal import ModalBasis
from ksd.solvers.method_error import relative_error
from ksd.training.catalogue import FAMILY_DESIGNS

HINGES = (
    "cross_flexure", "crossed_pivot", "balanced_crossed_pivot", "cartwheel", "butterfly", "infinity_hinge",
    "circular_notch", "filleted_notch", "arc_hinge",
)  # fmt: skip
STEEL = ksd.Material(E=200e9, G=76.9e9)
REFERENCE_MESH = ksd.Mesh(orders=(8, 8, 12), points=16)
MIN_CHECKED_ERROR = 1e-4
"""Relative error above which an estimate may not be below a third of it."""


def random_hinge(rng: np.random.Generator, names: tuple[str, ...] = HINGES) -> Any:
    """A hinge of any trained family, of any trained shape."""
    entry = FAMILY_DESIGNS[str(rng.choice(names))]
    return entry.make(**{p.name: float(rng.uniform(p.low, p.high)) for p in entry.parameters})


def softest(joints: list[Any]) -> float:
    """Smallest EI/L^2 [N] of the leaf springs of some joints."""
    return min(f.material.E * f.section.Iz / f.length**2 for j in joints for f in j.leaves())


def fourbar(rng: np.random.Generator) -> tuple[Any, dict[str, float]]:
    """Four equal hinges, sides of any length, driven in its plane."""
    joint = random_hinge(rng)
    size = joint.length
    wide, high = size * rng.uniform(1.5, 5.0), size * rng.uniform(1.5, 5.0)
    scene = ksd.Mechanism("random fourbar")
    left, top, right = scene.links("left", "top", "right")
    for a, b, x, y, name in (
        (scene.ground, left, -wide / 2, 0.0, "lower left"), (left, top, -wide / 2, high, "upper left"),
        (right, top, wide / 2, high, "upper right"), (scene.ground, right, wide / 2, 0.0, "lower right"),
    ):  # fmt: skip
        scene.join(a, b, joint, at=(x, y, 0), axis="z", toward="y", name=name)
    scene.actuate(top, along="x", at=(0, high + joint.length_AB, 0), name="drive")
    if rng.random() < 0.6:
        scene.load(
            top, force=tuple(softest([joint]) * rng.uniform(-10, 10, 3) * (1, 1, 0.3)), at=(0, high, 0)
        )
    return scene, {"drive": float(high * math.sin(rng.uniform(-1.0, 1.0)))}


def arm(rng: np.random.Generator) -> tuple[Any, dict[str, float]]:
    """One to three hinges in series about any axes, each driven, a force at the end."""
    scene, at = ksd.Mechanism("random arm"), np.zeros(3)
    base, targets, stiff = scene.ground, {}, math.inf
    for k in range(int(rng.integers(1, 4))):
        joint = random_hinge(rng)
        link, axis = scene.link(f"link {k}"), rng.normal(size=3)
        axis /= np.linalg.norm(axis)
        toward = np.cross(axis, rng.normal(size=3))
        scene.join(base, link, joint, at=tuple(at), axis=tuple(axis), toward=tuple(toward), name=f"joint {k}")
        at, base = at + joint.length * rng.uniform(0.5, 2.0) * toward / np.linalg.norm(toward), link
        stiff = min(stiff, softest([joint]))
    by_tip = int(rng.integers(0, 2))
    for k, placed in enumerate(scene.scene().joints[by_tip:]):
        scene.actuate_joint(placed.name, name=f"turn {k}")
        targets[f"turn {k}"] = float(rng.uniform(-1.0, 1.0))
    if by_tip:
        first = scene.scene().joints[0]
        along = np.cross(np.asarray(first.rotation)[:, 2], at - np.asarray(first.origin))
        scene.actuate(base, along=tuple(along / np.linalg.norm(along)), at=tuple(at), name="tip")
        targets["tip"] = float(np.linalg.norm(along) * rng.uniform(-0.7, 0.7))
    if rng.random() < 0.8:
        scene.load(base, force=tuple(stiff * rng.uniform(-5, 5, 3)), at=tuple(at))
    return scene, targets


def unequal_fourbar(rng: np.random.Generator) -> tuple[Any, dict[str, float]]:
    """A fourbar of four different hinges under a force, also out of its plane."""
    joints = [random_hinge(rng) for _ in range(4)]
    size = max(j.length for j in joints)
    wide, high = size * rng.uniform(1.5, 5.0), size * rng.uniform(1.5, 5.0)
    scene = ksd.Mechanism("random fourbar of four hinges")
    left, top, right = scene.links("left", "top", "right")
    places = (
        (scene.ground, left, -wide / 2, 0.0), (left, top, -wide / 2, high), (right, top, wide / 2, high),
        (scene.ground, right, wide / 2, 0.0),
    )  # fmt: skip
    for k, (joint, (a, b, x, y)) in enumerate(zip(joints, places, strict=True)):
        scene.join(a, b, joint, at=(x, y, 0), axis="z", toward="y", name=f"hinge {k}")
    scene.actuate(top, along="x", at=(0, high, 0), name="drive")
    scene.load(top, force=tuple(softest(joints) * rng.uniform(-20, 20, 3) * (1, 1, 0.3)), at=(0, high, 0))
    return scene, {"drive": float(high * math.sin(rng.uniform(-1, 1)))}


def door(rng: np.random.Generator) -> tuple[Any, dict[str, float]]:
    """A link on two hinges of one axis, held more than once, under a force."""
    joint, scene = random_hinge(rng), ksd.Mechanism("random door")
    leaf, size = scene.link("door"), joint.length
    for k in range(2):
        scene.join(
            scene.ground, leaf, joint, at=(0, 0, 3 * k * size), axis="z", toward="x", name=f"hinge {k}"
        )
    scene.actuate_joint("hinge 0", name="turn")
    scene.load(leaf, force=tuple(softest([joint]) * rng.uniform(-20, 20, 3)), at=(2 * size, 0, size))
    return scene, {"turn": float(rng.uniform(-1, 1))}


def universal(rng: np.random.Generator) -> tuple[Any, dict[str, float]]:
    """A universal joint turned about both axes under a force."""
    joint, scene = random_hinge(rng, ("universal",)), ksd.Mechanism("random universal joint")
    arm, targets = scene.link("arm"), {}
    scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="x", name="joint")
    for motion in joint.motions:
        scene.actuate_joint("joint", name=motion.name, motion=motion.name)
        targets[motion.name] = float(rng.uniform(-0.8, 0.8))
    scene.load(arm, force=tuple(softest([joint]) * rng.uniform(-10, 10, 3)), at=(0.2, 0.05, 0.02))
    return scene, targets


def slider(rng: np.random.Generator) -> tuple[Any, dict[str, float]]:
    """A parallel guide that carries a hinge about any axis, both driven, a force at the end."""
    scene = ksd.Mechanism("random slider")
    stage, hand = scene.links("stage", "hand")
    guide = random_hinge(rng, ("parallel_guide", "stiffened_guide"))
    joint = random_hinge(rng)
    axis = rng.normal(size=3)
    scene.join(scene.ground, stage, guide, at=(0, 0, 0), axis="z", toward="x", name="guide")
    toward = tuple(np.cross(axis, rng.normal(size=3)))
    scene.join(stage, hand, joint, at=(0.12, 0, 0), axis=tuple(axis), toward=toward, name="hinge")
    scene.actuate(stage, along="y", at=(0.1, 0, 0), name="stroke")
    scene.actuate_joint("hinge", name="turn")
    scene.load(hand, force=tuple(softest([joint, guide]) * rng.uniform(-5, 5, 3)), at=(0.15, 0.02, 0))
    return scene, {"stroke": float(rng.uniform(-0.03, 0.03)), "turn": float(rng.uniform(-1, 1))}


def frame(rng: np.random.Generator) -> tuple[Any, dict[str, float]]:
    """Leaves without joints: a stage on one to three leaves that lie about side by side, in a plane or in space, moved
    across them under a force."""
    scene = ksd.Mechanism("random frame")
    stage, flat, L, stiff = scene.link("stage"), rng.random() < 0.5, 0.1, math.inf
    for k in range(int(rng.integers(1, 4))):
        along = (
            L * rng.uniform(0.6, 1.0) * (np.array([1.0, 0, 0]) + rng.uniform(-0.2, 0.2, 3) * (0, 1, not flat))
        )
        foot = np.array([0.0, 0.5 * k * L, 0.0 if flat else rng.uniform(-0.2, 0.2) * L])
        across = np.cross(along, (0.0, 1.0, 0.0))
        section = ksd.rectangle(L / rng.uniform(50, 300), L * rng.uniform(0.1, 0.4))
        scene.leaf(scene.ground, stage, start=tuple(foot), end=tuple(foot + along), section=section, material=STEEL,
                   width_axis=tuple(across), name=f"leaf {k}")  # fmt: skip
        stiff = min(stiff, STEEL.E * section.Iz / L**2)
    scene.actuate(stage, along="y", at=(0, 0, 0), name="drive")
    scene.load(stage, force=tuple(stiff * rng.uniform(-3, 3, 3) * (1, 1, 0 if flat else 0.3)), at=(L, 0, 0))
    return scene, {"drive": float(L * rng.uniform(-0.2, 0.2))}


JOINTED = (fourbar, unequal_fourbar, door, arm, slider, universal)
"""Kinds of scenes of joints."""


def scenes(seed: int, kinds: tuple[Any, ...]) -> Iterator[tuple[Any, dict[str, float], np.random.Generator]]:
    """Random scenes with drive values, an endless iterator."""
    number = 0
    while True:
        rng = np.random.default_rng((seed, number))
        scene, targets = kinds[number % len(kinds)](rng)
        # most mechanisms move half their range
        share = float(rng.uniform(0.1, 1.0))
        yield scene, {n: share * v for n, v in targets.items()}, rng
        number += 1


def relative_force(pose: Any, truth: Any) -> tuple[float, float]:
    """Error of the drive forces over the largest one: the true one, and the estimate of the solve (`pose.method_error`)."""
    one, other = (np.array(list(p.forces.values())) for p in (pose, truth))
    most = max(np.abs(other).max(), 1e-300)
    return float(np.abs(one - other).max() / most), float(np.max(pose.method_error.force) / most)


def answer_errors(
    scene: Any, targets: dict[str, float], method: Any, mesh: Any, **words: Any
) -> tuple[float, float]:
    """Error of an answer, true and told: the larger of that of forces and of displacements; KsdError where not solved."""
    pose = ksd.solve(scene, targets, method=method, mesh=mesh, **words)
    truth = equilibrium_near(pose)
    if truth is None or pose.error is None:
        raise KsdError("no truth next to it")
    return relative_error(pose.model, pose.motion, truth.motion).relative, pose.error.relative


def equilibrium_near(pose: Any, mesh: Any = REFERENCE_MESH) -> Any:
    """The state of a whole solve of its own on the finest mesh, where that is stable and the branch of `pose`; else None."""
    truth = ksd.solve(pose.model.scene, dict(pose.targets), method="conventional", mesh=mesh, strict=False)
    far = np.abs(truth.motion.x[: pose.model.links] - pose.motion.x[: pose.model.links]).max()
    return truth if truth.stable and far < 0.05 * pose.model.arrays.size else None


def random_mesh(scene: Any, rng: np.random.Generator) -> tuple[Any, Any]:
    """Any method and a coarse mesh."""
    elements = int(rng.integers(2, 11))
    grid = ksd.Mesh("corotational", elements=elements) if rng.random() < 0.7 else ksd.Mesh(orders=(3, 2, 4))
    jointed = scene.scene().joints
    return str(rng.choice(["conventional", "full", "reduced"])) if jointed else "conventional", grid


def mesh(count: int, seed: int) -> bool:
    """Errors on coarse meshes, by every method."""

    def one(scene: Any, targets: dict[str, float], rng: np.random.Generator) -> list[tuple[float, float]]:
        return [answer_errors(scene, targets, *random_mesh(scene, rng))]

    return _count_errors("mesh", count, scenes(seed, (*JOINTED, frame, frame)), one)


def modal(count: int, seed: int) -> bool:
    """Errors of modal bodies: of all joints, or of one joint of several with the others condensed."""

    def one(scene: Any, targets: dict[str, float], rng: np.random.Generator) -> list[tuple[float, float]]:
        names, words = [j.name for j in scene.scene().joints], {}
        if len(names) > 1 and rng.random() < 0.4:
            words["basis"] = {str(rng.choice(names)): ModalBasis()}
        return [answer_errors(scene, targets, "modal", None, **words)]

    return _count_errors("modal", count, scenes(seed, (hinge, hinge, fourbar, arm, slider)), one)


QUESTIONS = (
    lambda p: p.drive_stiffness()[p.model.drive_names[0]],
    lambda p: p.stiffness(p.model.scene.drives[0].terms[0].link).compliance.trace(),
    lambda p: p.stress().largest_Pa,
    lambda p: sum(p.strain_energy().values()),
    lambda p: p.frequencies(count=1, freed=p.model.drive_names).frequency_Hz[0],
)


def questions(count: int, seed: int) -> bool:
    """Errors of questions, on coarse meshes by every method and of modal bodies."""

    def one(scene: Any, targets: dict[str, float], rng: np.random.Generator) -> list[tuple[float, float]]:
        method, grid = random_mesh(scene, rng)
        if scene.scene().joints and rng.random() < 0.2:
            method, grid = "modal", None
        driven = {t.link for d in scene.scene().drives for t in d.terms}
        for link in driven:
            scene.mass(link, mass=0.1, inertia=(1e-5, 1e-5, 1e-5), at=(0.05, 0.02, 0.0))
        pose = ksd.solve(scene, targets, method=method, mesh=grid)
        truth = equilibrium_near(pose)
        if truth is None:
            raise KsdError("no truth next to it")
        found = []
        for question in QUESTIONS:
            try:
                answer, told = pose.with_error(question)
                right = question(truth)
            except KsdError:
                continue
            found.append((abs(answer - right) / abs(right), told / abs(right)))
        return found

    return _count_errors("questions", count, scenes(seed, (*JOINTED, frame)), one)


def _count_errors(
    name: str, count: int, drawn: Iterator[Any], one: Callable[..., list[tuple[float, float]]]
) -> bool:
    """`one` (scene, drive values, random numbers): errors, true and told, or KsdError, of so many scenes; see `report`."""
    ratios: list[tuple[float, float, int]] = []
    answered, number = 0, 0
    for number, (scene, targets, rng) in enumerate(drawn):
        if answered == count:
            break
        try:
            found = one(scene, targets, rng)
        except (KsdError, np.linalg.LinAlgError):
            continue
        answered += 1
        ratios += [(told / max(true, 1e-300), true, number) for true, told in found if math.isfinite(told)]
    return report(name, ratios, number)


def hinge(rng: np.random.Generator) -> tuple[Any, dict[str, float]]:
    """One hinge of any family, turned."""
    scene = ksd.Mechanism("random hinge")
    arm_ = scene.link("arm")
    scene.join(scene.ground, arm_, random_hinge(rng), at=(0, 0, 0), axis="z", toward="x", name="hinge")
    scene.actuate_joint("hinge", name="turn")
    return scene, {"turn": float(rng.uniform(-0.8, 0.8))}


def reduced(count: int, seed: int) -> bool:
    """Errors of `reduced` as told, against those of the state before the step that tells them, as in `report`; and whether
    the answer after it is nowhere further off than twice what is told."""
    ratios: list[tuple[float, float, int]] = []
    tried = worse = 0
    for scene, targets, _ in scenes(seed, JOINTED):
        if len(ratios) == count:
            break
        tried += 1
        solver = ksd.prepare(scene)
        try:
            pose, plain = (
                solver(targets, method="reduced", strict=False, estimate=estimate)
                for estimate in (True, False)
            )
            truth = solver(targets, method="full")
        except KsdError:
            continue
        true, told = relative_force(pose, truth)
        if np.linalg.norm(pose.motion.x - truth.motion.x) > 0.2 * pose.model.arrays.size:
            continue
        if not math.isfinite(told):
            continue
        worse += true > max(2.0 * told, MIN_CHECKED_ERROR)
        # at equilibrium, or where the step that tells went on to it, there is nothing left to tell
        if told > 0.0 and not pose.steps[-1].name.startswith("5"):
            before = relative_error(plain.model, plain.motion, truth.motion).force
            most = max(np.abs(truth.motion.multiplier[: len(before)]).max(), 1e-300)
            ratios.append((told / max(before.max() / most, 1e-300), float(before.max() / most), tried - 1))
    print(f"reduced: {worse} answers further off than twice what they tell")
    return report("reduced", ratios, tried) and not worse


def report(name: str, found: list[tuple[float, float, int]], tried: int) -> bool:
    """Counts of told over true, where the true error is above rounding; whether 95 % are within a factor of two and none is
    below a third above MIN_CHECKED_ERROR."""
    seen = [(r, t, n) for r, t, n in found if t > 1e-9]
    within = sum(0.5 <= r <= 2.0 for r, _, _ in seen)
    low = [(r, t, n) for r, t, n in seen if r < 1 / 3 and t > MIN_CHECKED_ERROR]
    ratio = np.array([r for r, _, _ in seen])
    print(
        f"{name}: {tried} drawn, {len(found)} answered, {len(seen)} with an error above 1e-9; "
        f"{100 * within / len(seen):.1f} % "
        f"within a factor 2; {(ratio < 0.5).sum()} below half, {(ratio > 2).sum()} above twice; "
        f"{len(low)} below a third where the error exceeds {MIN_CHECKED_ERROR:g}; 1, 50, 99 % quantiles of told over true "
        + ", ".join(f"{q:.3g}" for q in np.quantile(ratio, [0.01, 0.5, 0.99])),
        flush=True,
    )
    for r, t, n in sorted(low)[:10]:
        print(f"    scene {n}: {100 * t:.3g} % true, {100 * r * t:.3g} % told")
    return within >= 0.95 * len(seen) and not low


def main() -> int:
    """Returns the number of parts that fall short."""
    words = argparse.ArgumentParser()
    words.add_argument("--scenes", type=int, default=1000)
    words.add_argument("--seed", type=int, default=0)
    words.add_argument("--part", action="append", choices=PARTS, default=[])
    asked = words.parse_args()
    return sum(not PARTS[part](asked.scenes, asked.seed) for part in asked.part or PARTS)


PARTS = {"reduced": reduced, "mesh": mesh, "modal": modal, "questions": questions}

if __name__ == "__main__":
    sys.exit(main())
