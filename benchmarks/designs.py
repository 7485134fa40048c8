"""What a new design costs: scene, preparation, one solve and the 6x6 support stiffness, and chains of joints.

Every design differs from those before in its numbers, never in its topology, as in an optimisation loop; nothing of an
earlier design can be used but what depends on topology alone. Thread CPU time, medians, cases in turns; kernels compiled
before. Beside the times the error figure of the answer, mesh included, and the drive force itself. Also: the same
mechanism again at other drive values, and the memory that many scenes leave behind.
Run: python benchmarks/designs.py [--quick]
"""

from __future__ import annotations

import gc
import itertools
import os
import statistics
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from common import STEEL, cross_flexure, fourbar, interleaved, machine, options, thread_us, write_json

import ksd
from ksd.units import deg, mm

FIRST_RELEASE = {"crossed pivot": 8.7, "fourbar": 18.0, "three-joint arm": 55.0}
"""Milliseconds of the first release, on another day."""
WANTED = {"crossed pivot": 1.0, "fourbar": 2.0, "three-joint arm": 6.0}
CHAINS = {3: 3.0, 100: 30.0, 1000: 300.0}
"""Joints of a chain, and the milliseconds wanted for preparing and solving it."""


def pivot(n: int) -> ksd.Mechanism:
    """A crossed pivot of the n-th thickness, driven by its angle."""
    scene = ksd.Mechanism("pivot")
    tip = scene.link("tip")
    joint = ksd.CrossedPivot(
        STEEL, length=(50 + 1e-3 * n) * mm, angle=45 * deg, thickness=0.3 * mm, width=10 * mm
    )
    placed = scene.join(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x", name="pivot")
    scene.actuate_joint(placed, name="turn")
    return scene


def four(n: int) -> ksd.Mechanism:
    """The README's fourbar with joints of the n-th thickness."""
    joint = cross_flexure(thickness=(1 + 1e-6 * n) * mm)
    scene = ksd.Mechanism("fourbar")
    left, top, right = scene.links("left", "top", "right")
    scene.join(scene.ground, left, joint, at=(-0.2, 0, 0), axis="z", toward="y")
    scene.join(left, top, joint, at=(-0.2, 0.3, 0), axis="z", toward="y")
    scene.join(right, top, joint, at=(0.2, 0.3, 0), axis="z", toward="y")
    scene.join(scene.ground, right, joint, at=(0.2, 0, 0), axis="z", toward="y")
    scene.actuate(top, along="x", at=(0, 0.3 + joint.length_AB, 0))
    return scene


def arm(n: int) -> ksd.Mechanism:
    """Three infinity hinges about axes in space, the n-th thickness, each driven."""
    scene = ksd.Mechanism("arm")
    joint = ksd.InfinityHinge(STEEL, length=60 * mm, thickness=(0.5 + 1e-6 * n) * mm, width=30 * mm)
    last = scene.ground
    for k, (axis, toward) in enumerate((("z", "x"), ("y", "x"), ("x", "y"))):
        link = scene.link(f"link {k + 1}")
        placed = scene.join(
            last, link, joint, at=(0.3 * k, 0, 0), axis=axis, toward=toward, name=f"hinge {k + 1}"
        )
        scene.actuate_joint(placed, name=f"turn_{k + 1}")
        last = link
    return scene


TARGETS: dict[str, dict[str, float]] = {
    "crossed pivot": {"turn": 20 * deg},
    "fourbar": {"top": 0.15},
    "three-joint arm": {"turn_1": 10 * deg, "turn_2": 10 * deg, "turn_3": 10 * deg},
}
MAKERS: dict[str, Callable[[int], ksd.Mechanism]] = {
    "crossed pivot": pivot,
    "fourbar": four,
    "three-joint arm": arm,
}
MOVED = {"crossed pivot": "tip", "fourbar": "top", "three-joint arm": "link 3"}


def answer(name: str, n: int) -> tuple[float, float, Any]:
    """First drive force, support stiffness along z of the 6x6, and error figure of the n-th design."""
    pose = ksd.prepare(MAKERS[name](n))(**TARGETS[name])
    return next(iter(pose.forces.values())), pose.stiffness(MOVED[name]).support("z"), pose


def chain_of(joints: int, n: int = 0) -> ksd.Mechanism:
    """An open chain of crossed pivots in a plane, turned by a moment at its end."""
    joint = ksd.CrossedPivot(
        STEEL, length=50 * mm, angle=45 * deg, thickness=(0.3 + 1e-7 * n) * mm, width=10 * mm
    )
    scene = ksd.Mechanism(f"chain of {joints}")
    last = scene.ground
    for k in range(joints):
        link = scene.link(f"link {k + 1}")
        scene.join(last, link, joint, at=(0.1 * k, 0, 0), axis="z", toward="x", name=f"joint {k + 1}")
        last = link
    scene.load(last, moment=(0, 0, 1e-3))
    return scene


def memory_mb() -> float:
    """Resident memory of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure, print, write designs.json; returns what was found."""
    asked = options(__doc__, argv)
    repeats, many = (2, 20) if asked.quick else (25, 1000)
    fresh = itertools.count(1)
    times = interleaved(
        {name: (lambda name=name: answer(name, next(fresh))) for name in MAKERS}, repeats=repeats, warm=3
    )
    scenes = interleaved(
        {name: (lambda name=name: MAKERS[name](next(fresh))) for name in MAKERS}, repeats=repeats
    )
    rows = []
    for name, spent in times.items():
        force, support, pose = answer(name, 0)
        rows.append(
            {
                "what": name, "ms": spent.median / 1e3, "wanted_ms": WANTED[name],
                "first_release_ms": FIRST_RELEASE[name], "scene_alone_ms": scenes[name].median / 1e3, "force": force,
                "support_z": support, "error": pose.error.relative,
            }
        )  # fmt: skip
    chains = []
    for joints, wanted in CHAINS.items():
        if asked.quick and joints > 100:
            continue
        spent = []
        for _ in range(2 if joints > 100 else 5):
            scene = chain_of(joints, next(fresh))
            spent.append(thread_us(lambda scene=scene: ksd.prepare(scene)()) / 1e3)
        chains.append({"joints": joints, "ms": statistics.median(spent[1:]), "wanted_ms": wanted})
    again = fourbar()
    stroke = itertools.cycle(np.linspace(0.1, 0.2, 17))
    solver = ksd.prepare(again)
    same = interleaved(
        {
            "prepared": lambda: solver(top=float(next(stroke))),
            "ksd.solve": lambda: ksd.solve(again, top=float(next(stroke))),
        },
        repeats=20 if asked.quick else 400,
        warm=10,
    )
    begin = time.thread_time()
    found = ksd.batch(four, {"top": [0.15]}, designs={"n": np.arange(1.0, many + 1)}, threads=1)
    batch_ms = 1e3 * (time.thread_time() - begin) / many
    gc.collect()
    before = memory_mb()
    for n in range(20 if asked.quick else 1500):
        ksd.solve(pivot(10_000 + n), turn=0.1)
    gc.collect()
    left = memory_mb() - before
    result = {
        "machine": machine(), "rows": rows, "chains": chains,
        "again_us": {name: t.numbers() for name, t in same.items()},
        "batch": {"designs": many, "ms_each": batch_ms, "solved": found.solved}, "memory_left_MB": left,
    }  # fmt: skip
    for row in rows:
        print(
            f"{row['what']:16s} {row['ms']:7.2f} ms (wanted {row['wanted_ms']:g}, first release "
            f"{row['first_release_ms']:g}), its scene {row['scene_alone_ms']:.2f} ms; error figure {row['error']:.1e}"
        )
    for row in chains:
        print(f"chain of {row['joints']:4d}    {row['ms']:7.1f} ms (wanted {row['wanted_ms']:g})")
    for name, t in same.items():
        print(f"{name} again: {t.median:.0f} us")
    print(f"batch of {many}: {batch_ms:.2f} ms a design; memory left after many scenes: {left:.1f} MB")
    write_json(result, asked.out / "designs.json")
    return result


if __name__ == "__main__":
    main()
