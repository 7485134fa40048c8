"""Torsion springs and drives of several turns against closed forms, over random mechanisms; prints counts.

    python benchmarks/turns.py [--cases 300] [--seed 0]

Pins in a plane or about any axis in space, with wound torsion springs, drives and moments of 0 to 3 turns; gears; leaf
springs rolled up to rings; and arms of three flexure hinges each, by every method that knows springs. A path goes through
random values in any order, by `ksd.sweep`, `ksd.follow` and `ksd.solve` from a pose, saved and loaded on the way. Forces and
rotations count as wrong beyond `TOLERANCE`.
"""

from __future__ import annotations

import argparse
import math
import pickle
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

import ksd

TURN = 2.0 * math.pi
MOST = 3.0 * TURN
"""Largest rotation [rad] of a drive or a wound spring."""
LONGEST_STEP = 0.98 * math.pi
"""Largest step [rad] of a path of single solves."""
TOLERANCE = 1e-8
"""Largest relative error."""
STEEL = ksd.Material(E=200e9, G=76.9e9)
METHODS = ("conventional", "full", "reduced", "constant", None)
"""Of the arms."""


class Case(NamedTuple):
    """A mechanism with one value `angle` that goes along a path, and its closed forms.

    drives: values of all drives at an angle; force: what the first drive exerts there [Nm]; turned: rotation vectors
    [rad] of links by name; scale [Nm]: of the force; reference: the same mechanism without the spring, whose force is
    subtracted; method: of its solves.
    """

    scene: Any
    drives: Callable[[float], dict[str, float]]
    force: Callable[[float], float]
    turned: Callable[[float], dict[str, np.ndarray]]
    scale: float
    most: float = MOST
    reference: Any = None
    method: Any = None


def frame(rng: np.random.Generator) -> tuple[Any, np.ndarray, dict[str, Any]]:
    """An empty mechanism in a plane or in space, the axis of its pins, and the words that give it to a pin."""
    plane = rng.choice(["xy", "xz", "yz", ""])
    if plane:
        return ksd.Mechanism("turns", plane=str(plane)), np.eye(3)[["yz", "xz", "xy"].index(plane)], {}
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    return ksd.Mechanism("turns"), axis, {"axis": tuple(axis)}


def wound(rng: np.random.Generator) -> Case:
    """A link on a pin with a wound spring, driven; ground may be either link of pin and spring."""
    scene, axis, words = frame(rng)
    a, k, rest = scene.link("a"), 10.0 ** rng.uniform(-3, 3), rng.uniform(-MOST, MOST)
    at, flipped = tuple(np.cross(axis, rng.normal(size=3))), rng.random() < 0.5
    pair, sign = ((a, scene.ground), -1.0) if flipped else ((scene.ground, a), 1.0)
    scene.pin(*pair, at=at, **words)
    scene.turn_spring(*pair, at=at, axis=tuple(axis), stiffness=k, rest_angle=sign * rest)
    scene.actuate(a, about=tuple(axis), name="turn")
    return Case(
        scene, lambda t: {"turn": t}, lambda t: k * (t - rest), lambda t: {"a": t * axis}, k * MOST
    )  # fmt: skip


def two(rng: np.random.Generator) -> Case:
    """Two links on pins, one drive each, and a spring between the links."""
    scene, axis, words = frame(rng)
    a, b = scene.links("a", "b")
    k, rest, share = 10.0 ** rng.uniform(-3, 3), rng.uniform(-MOST, MOST), rng.uniform(-1.0, 1.0)
    for link in (a, b):
        scene.pin(scene.ground, link, at=(0, 0, 0), **words)
    scene.actuate(a, about=tuple(axis), name="turn")
    scene.actuate(b, about=tuple(axis), name="other")
    scene.turn_spring(a, b, at=(0, 0, 0), axis=tuple(axis), stiffness=k, rest_angle=rest)
    return Case(
        scene, lambda t: {"turn": t, "other": share * t}, lambda t: -k * ((share - 1.0) * t - rest),
        lambda t: {"a": t * axis, "b": share * t * axis}, k * MOST,
    )  # fmt: skip


def series(rng: np.random.Generator) -> Case:
    """A driven link, a free one, and ground, with two wound springs in series: the free link shares the turns."""
    scene, axis, words = frame(rng)
    a, b = scene.links("a", "b")
    k, (r1, r2) = 10.0 ** rng.uniform(-2, 2, 2), rng.uniform(-MOST, MOST, 2)
    for pair in ((scene.ground, a), (a, b)):
        scene.pin(*pair, at=(0, 0, 0), **words)
    for pair, stiffness, rest in (((scene.ground, a), k[0], r1), ((a, b), k[1], r2)):
        scene.turn_spring(*pair, at=(0, 0, 0), axis=tuple(axis), stiffness=float(stiffness), rest_angle=rest)
    scene.actuate(b, about=tuple(axis), name="turn")

    def free(t: float) -> float:
        return float((k[0] * r1 + k[1] * (t - r2)) / (k[0] + k[1]))

    return Case(
        scene, lambda t: {"turn": t}, lambda t: float(k[1] * (t - free(t) - r2)),
        lambda t: {"a": free(t) * axis, "b": t * axis}, float(k.max()) * MOST,
    )  # fmt: skip


def gear(rng: np.random.Generator) -> Case:
    """Two links on parallel pins, coupled by a ratio, each with a wound spring."""
    scene, axis, words = frame(rng)
    a, b = scene.links("a", "b")
    ratio, k, rest = rng.uniform(0.4, 2.5), 10.0 ** rng.uniform(-2, 2, 2), rng.uniform(-MOST, MOST, 2)
    for link, at, stiffness, angle in (
        (a, (0, 0, 0), k[0], rest[0]),
        (b, np.cross(axis, (0.1, 0.2, 0.3)), k[1], rest[1]),
    ):
        scene.pin(scene.ground, link, at=tuple(at), **words)
        scene.turn_spring(
            scene.ground, link, at=tuple(at), axis=tuple(axis), stiffness=float(stiffness), rest_angle=angle
        )
    turns = [scene.rotation(link, tuple(axis)) for link in (a, b)]
    scene.actuate(terms=turns[0], name="turn")
    scene.actuate(terms=ratio * turns[0] + turns[1], name="mesh")
    return Case(
        scene, lambda t: {"turn": t, "mesh": 0.0},
        lambda t: float(k[0] * (t - rest[0]) - ratio * k[1] * (-ratio * t - rest[1])),
        lambda t: {"a": t * axis, "b": -ratio * t * axis}, float(k.max()) * MOST * ratio**2, most=MOST / max(ratio, 1.0),
    )  # fmt: skip


def ring(rng: np.random.Generator) -> Case:
    """A leaf spring whose tip is turned, so that it bends to an arc and on to a ring: M = EI turn / L."""
    plane = rng.random() < 0.5
    scene = ksd.Mechanism("ring", plane="xy") if plane else ksd.Mechanism("ring")
    tip, length, thickness = scene.link("tip"), rng.uniform(0.05, 0.3), rng.uniform(0.1e-3, 0.3e-3)
    section = ksd.section.rectangle(thickness, 0.02)
    scene.leaf(
        scene.ground,
        tip,
        start=(0, 0, 0),
        end=(length, 0, 0),
        section=section,
        material=STEEL,
        width_axis="z",
    )
    k, rest = STEEL.E * section.Iz / length, rng.uniform(-MOST, MOST)
    spring = k * rng.uniform(0.1, 2.0)
    scene.turn_spring(scene.ground, tip, at=(0, 0, 0), axis="z", stiffness=spring, rest_angle=rest)
    scene.actuate(tip, about="z", name="turn")
    return Case(
        scene, lambda t: {"turn": t}, lambda t: k * t + spring * (t - rest), lambda t: {"tip": t * np.eye(3)[2]},
        (k + spring) * MOST, most=1.2 * TURN,
    )  # fmt: skip


def arms(rng: np.random.Generator) -> Case:
    """Two arms of three flexure hinges, bent apart by up to 210 degrees, with a wound spring between their ends."""
    k, rest, method = (
        float(10.0 ** rng.uniform(-3, 1)),
        rng.uniform(-MOST, MOST),
        METHODS[rng.integers(len(METHODS))],
    )
    scenes = []
    for sprung in (True, False):
        scene = ksd.Mechanism("arms")
        hinge = ksd.CrossFlexure(STEEL, length=0.1, angle=math.pi / 4, thickness=0.3e-3, widths=(0.04, 0.02))
        for side, letter in ((-1.0, "a"), (1.0, "b")):
            before = scene.ground
            for n in range(3):
                link = scene.link(f"{letter}{n}")
                placed = scene.join(
                    before, link, hinge, at=(0.4 * side * (n + 1), 0, 0), axis="z", toward="y"
                )
                scene.actuate_joint(placed, name=f"{letter}{n} turn")
                before = link
        if sprung:
            scene.turn_spring("a2", "b2", at=(0, 0, 0), axis="z", stiffness=k, rest_angle=rest)
        scenes.append(scene)

    def drives(t: float) -> dict[str, float]:
        return {d.name: (-t if d.name.startswith("a") else t) / 6.0 for d in scenes[0].scene().drives[::-1]}

    # the first drive of the answer is that of the last hinge of the second arm
    return Case(
        scenes[0], drives, lambda t: k * (t - rest),
        lambda t: {"a2": -0.5 * t * np.eye(3)[2], "b2": 0.5 * t * np.eye(3)[2]}, max(k * MOST, 1.0),
        most=math.radians(210.0), reference=scenes[1], method=method,
    )  # fmt: skip


FAMILIES = (wound, two, series, gear, ring, arms)
"""Of mechanisms whose drives follow a path; `loaded` has none."""


def waypoints(rng: np.random.Generator, most: float) -> list[float]:
    """Values [rad] of a path from 0, at most `LONGEST_STEP` apart, that ends anywhere up to `most`."""
    values = [0.0]
    for _ in range(int(rng.integers(1, 4))):
        goal = rng.uniform(-most, most)
        steps = max(1, math.ceil(abs(goal - values[-1]) / LONGEST_STEP))
        values += np.linspace(values[-1], goal, steps + 1)[1:].tolist()
    return values


def saved_and_loaded(pose: Any) -> Any:
    """The pose after it was pickled."""
    return pickle.loads(pickle.dumps(pose))


def errors_of(case: Case, pose: Any, t: float) -> list[float]:
    """Relative errors of the force and of the rotations of a pose at the angle t [rad]."""
    drives = case.drives(t)
    first = next(iter(drives))
    force = pose.forces[first]
    if case.reference is not None:
        force -= ksd.solve(case.reference, drives, method=case.method, strict=False).forces[first]
    errors = [abs(force - case.force(t)) / case.scale]
    for link, vector in case.turned(t).items():
        errors.append(float(np.linalg.norm(pose.rotation(link) - vector)) / MOST)
    return errors


def check(case: Case, rng: np.random.Generator) -> tuple[str, float]:
    """How the path of a case was followed, and the largest relative error on it."""
    values = waypoints(rng, case.most)
    if case.reference is not None:
        # arms need no path: no drive goes far
        t = values[-1]
        return f"solve by {case.method}", max(
            errors_of(case, ksd.solve(case.scene, case.drives(t), method=case.method, strict=False), t)
        )
    how = str(rng.choice(["sweep", "conventional sweep", "follow", "solve"]))
    if "sweep" in how:
        columns = {n: [case.drives(t)[n] for t in values] for n in case.drives(0.0)}
        method: Any = "conventional" if how != "sweep" else None
        table = ksd.sweep(
            case.scene, columns, questions=("force",), method=method, together=True, progress=False
        )
        found = table["turn_moment_Nm"]
        assert len(found) == len(values)
        return how, max(abs(f - case.force(t)) / case.scale for f, t in zip(found, values, strict=True))
    worst, pose = 0.0, None
    for t in values:
        if how == "follow" and pose is not None and case.drives(t) != pose.targets:
            path = ksd.follow(case.scene, case.drives(t), control="drives", start=pose)
            if not path.ended:
                return f"follow: {path.stop}", math.inf
            pose = path.states[-1]
        else:
            pose = ksd.solve(case.scene, case.drives(t), start=pose)
        worst = max(worst, *errors_of(case, pose, t))
        if rng.random() < 0.5:
            pose = saved_and_loaded(pose)
    return how, worst


def loaded(rng: np.random.Generator) -> tuple[str, float]:
    """A link on a pin with a spring, turned by a moment, in one solve, or along the path of the load from the drawn pose."""
    scene, axis, words = frame(rng)
    a, k, single = scene.link("a"), 10.0 ** rng.uniform(-3, 3), rng.random() < 0.5
    rest, goal = rng.uniform(-MOST, MOST, 2) * [single, 1.0]
    scene.pin(scene.ground, a, at=(0, 0, 0), **words)
    scene.turn_spring(scene.ground, a, at=(0, 0, 0), axis=tuple(axis), stiffness=k, rest_angle=rest)
    scene.load(a, moment=tuple(k * (goal - rest) * axis))
    pose = ksd.solve(scene) if single else ksd.follow(scene).states[-1]
    error = float(np.linalg.norm(saved_and_loaded(pose).rotation("a") - goal * axis)) / MOST
    return "one solve" if single else "follow", error


def run(number: int, seed: int) -> tuple[str, str, float]:
    """Family, way and largest relative error of case `number`."""
    rng = np.random.default_rng((seed, number))
    which = number % (len(FAMILIES) + 1)
    if which == len(FAMILIES):
        return "loaded", *loaded(rng)
    return FAMILIES[which].__name__, *check(FAMILIES[which](rng), rng)


def main(arguments: list[str] | None = None) -> int:
    """Run the cases, print a line per family and way, and return the number of wrong ones."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--cases", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="21 cases only")
    words = parser.parse_args(arguments)
    counts: dict[tuple[str, str], list[float]] = {}
    for number in range(21 if words.quick else words.cases):
        family, how, error = run(number, words.seed)
        counts.setdefault((family, how), []).append(error)
        if not error < TOLERANCE:
            print(f"wrong: case {number}, {family}, {how}: {error:.1e}")
    for (family, how), errors in sorted(counts.items()):
        print(f"{family:8} {how:24} {len(errors):4} cases, worst error {max(errors):.1e}")
    everything = [e for errors in counts.values() for e in errors]
    wrong = sum(not e < TOLERANCE for e in everything)
    print(f"{len(everything)} cases, {wrong} wrong beyond {TOLERANCE:.0e}")
    return wrong


if __name__ == "__main__":
    raise SystemExit(min(main(), 1))
