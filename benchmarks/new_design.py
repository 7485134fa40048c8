"""What a new design costs: the same words, other numbers, prepared and asked for force and 6x6 support stiffness.

Crossed pivot, the README's fourbar and the spatial arm of three joints, one of their lengths or thicknesses changed each
time; a thousand designs in one `ksd.batch`; chains of 3, 100 and 1,000 joints, prepared and solved once; memory after 1,500
new scenes. Thread CPU time, medians.
Run: python benchmarks/new_design.py [--chains] [--memory] [--profile pivot]
"""

from __future__ import annotations

import argparse
import cProfile
import gc
import pstats
import statistics
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

import ksd
from ksd.bench.suite import TIP, chain
from ksd.units import GPa, deg, mm

STEEL = ksd.Material(E=200 * GPa, G=76.9 * GPa, density=7800)
ARM = Path(ksd.__file__).parent / "scenes" / "arm_joints.toml"


def pivot(length: float = 60 * mm, thickness: float = 0.4 * mm) -> ksd.Mechanism:
    """A crossed pivot turned by 15 degrees."""
    joint = ksd.CrossedPivot(STEEL, length=length, angle=45 * deg, thickness=thickness, width=20 * mm)
    scene = ksd.Mechanism("pivot")
    arm = scene.link("arm")
    scene.actuate_joint(scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="x"), name="turn")
    return scene


def fourbar(length: float = 100 * mm, thickness: float = 1 * mm) -> ksd.Mechanism:
    """The fourbar of the README, its top link moved by 0.3 m."""
    cross = ksd.CrossFlexure(
        STEEL, length=length, angle=45 * deg, thickness=thickness, widths=(40 * mm, 20 * mm)
    )
    scene = ksd.Mechanism("fourbar")
    left, top, right = scene.links("left", "top", "right")
    scene.join(scene.ground, left, cross, at=(-0.2, 0, 0), axis="z", toward="y")
    scene.join(left, top, cross, at=(-0.2, 0.3, 0), axis="z", toward="y")
    scene.join(right, top, cross, at=(0.2, 0.3, 0), axis="z", toward="y")
    scene.join(scene.ground, right, cross, at=(0.2, 0, 0), axis="z", toward="y")
    scene.actuate(top, along="x", at=(0, 0.3 + cross.length_AB, 0))
    return scene


def arm(length: float = 60 * mm, thickness: float = 0.45 * mm) -> ksd.Mechanism:
    """The spatial arm the package brings, its hinges drawn anew."""
    hinge = ksd.TripleInfinityHinge(STEEL, thickness=thickness, length=length)
    scene = ksd.Mechanism("arm")
    first, second, third = scene.links("first", "second", "third")
    for a, b, at, axis, toward, name in (
        (scene.ground, first, (0, 0, 0), "z", "x", "base"),
        (first, second, (150 * mm, 0, 50 * mm), "y", (1, 0, 1), "shoulder"),
        (second, third, (330 * mm, 0, 230 * mm), "y", (1, 0, -1), "elbow"),
    ):
        scene.actuate_joint(scene.join(a, b, hinge, at=at, axis=axis, toward=toward, name=name), name=name)
    return scene


TURNS = dict.fromkeys(("base", "shoulder", "elbow"), 30 * deg)
CASES: dict[str, tuple[Callable[..., ksd.Mechanism], dict[str, float], str, Any]] = {
    "pivot": (pivot, {"turn": 15 * deg}, "arm", (0.0, 0.0, 0.0)),
    "fourbar": (fourbar, {"top": 300 * mm}, "top", (0.0, 0.3, 0.0)),
    "arm": (arm, TURNS, "third", TIP),
}
NOMINAL = {"pivot": (60 * mm, 0.4 * mm), "fourbar": (100 * mm, 1 * mm), "arm": (60 * mm, 0.45 * mm)}


def design(name: str, n: int) -> dict[str, float]:
    """The n-th design: thickness and length a little off."""
    length, thickness = NOMINAL[name]
    rng = np.random.default_rng(n)
    return {
        "length": length * float(rng.uniform(0.95, 1.05)),
        "thickness": thickness * float(rng.uniform(0.9, 1.1)),
    }


def asked(name: str, scene: ksd.Mechanism) -> tuple[Any, Any]:
    """Force and support stiffness of a scene."""
    _, targets, link, at = CASES[name]
    pose = ksd.prepare(scene)(targets)
    return pose.forces, pose.stiffness(link, at=at).matrix


def one_by_one(name: str, repeats: int) -> dict[str, float]:
    """Medians [ms]: making the scene, prepare + force + stiffness, and the force alone."""
    make, targets = CASES[name][0], CASES[name][1]
    rows = []
    for n in range(repeats + 3):
        t0 = time.thread_time()
        scene = make(**design(name, n))
        t1 = time.thread_time()
        asked(name, scene)
        t2 = time.thread_time()
        scene = make(**design(name, 10_000 + n))
        t3 = time.thread_time()
        solver = ksd.prepare(scene)
        t4 = time.thread_time()
        solver(targets)
        t5 = time.thread_time()
        rows.append((t1 - t0, t2 - t1, t4 - t3, t5 - t4))
    found = [1e3 * statistics.median(r[k] for r in rows[3:]) for k in range(4)]
    return dict(zip(("scene", "prepare + force + stiffness", "prepare", "force"), found, strict=True))


def in_one_call(name: str, count: int, **how: Any) -> float:
    """CPU time of a design [ms] among `count` in one `ksd.batch`."""
    make, targets = CASES[name][0], CASES[name][1]
    ksd.batch(make, targets, designs=[design(name, n) for n in range(5)], threads=1, **how)
    some = [design(name, n) for n in range(count)]
    begin = time.process_time()
    ksd.batch(make, targets, designs=some, threads=1, **how)
    return 1e3 * (time.process_time() - begin) / count


def chains(joints: int) -> float:
    """Prepare and first solve [ms] of a chain whose kernels are compiled."""
    scene, targets = chain(joints)
    frozen = scene.scene()
    begin = time.thread_time()
    ksd.prepare(frozen)(targets)
    return 1e3 * (time.thread_time() - begin)


def memory(count: int) -> float:
    """Growth [MB] of the process over `count` new fourbars solved."""

    def size() -> float:
        gc.collect()
        return int(Path("/proc/self/statm").read_text().split()[1]) * 4096 / 2**20

    for n in range(50):
        ksd.solve(fourbar(**design("fourbar", n)), top=300 * mm)
    before = size()
    for n in range(count):
        ksd.solve(fourbar(**design("fourbar", 100 + n)), top=300 * mm)
    return size() - before


def main() -> None:
    """Print the numbers asked for."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--repeats", type=int, default=15)
    parser.add_argument("--batch", type=int, default=0)
    parser.add_argument("--chains", action="store_true")
    parser.add_argument("--memory", action="store_true")
    parser.add_argument("--profile", default="")
    said = parser.parse_args()
    if said.profile:
        make = CASES[said.profile][0]
        for n in range(3):
            asked(said.profile, make(**design(said.profile, n)))
        scenes = [make(**design(said.profile, 100 + n)) for n in range(said.repeats)]
        profile = cProfile.Profile()
        profile.enable()
        for scene in scenes:
            asked(said.profile, scene)
        profile.disable()
        pstats.Stats(profile).sort_stats("cumtime").print_stats(70)
        pstats.Stats(profile).sort_stats("tottime").print_stats(30)
        return
    for name in CASES:
        print(name, {k: round(v, 3) for k, v in one_by_one(name, said.repeats).items()})
    for name in CASES if said.batch else ():
        print(name, f"{in_one_call(name, said.batch):.3f} ms each of {said.batch} in one call")
    for joints in (3, 100, 1000) if said.chains else ():
        chains(joints)
        print(f"chain of {joints}: {chains(joints):.1f} ms")
    if said.memory:
        print(f"memory: {memory(1500):+.1f} MB")


if __name__ == "__main__":
    main()
