"""Cost of a new design: the same mechanism with other numbers, prepared and solved for force and 6x6 support stiffness.

Crossed pivot, the README's fourbar and the spatial arm of three joints, length and thickness changed each time as in an
optimisation loop, so that nothing of an earlier design serves but what depends on topology; the same designs in one
`ksd.batch`; an unchanged mechanism at new drive values, bare and with gravity, a spring and heat; chains of joints,
prepared and solved once; memory left by new scenes. Beside the times the error of the force, mesh included, against
finer leaves. Thread CPU time, medians, cases in turns, kernels compiled before.
Run: python benchmarks/designs.py [--quick]
"""

from __future__ import annotations

import gc
import itertools
import os
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from bench_scenes import TIP, chain
from common import (
    STEEL,
    cross_flexure,
    linkage,
    machine,
    parse_options,
    thread_us,
    time_in_turns,
    write_json,
)
from gradients import arm

import ksd
from ksd.study.compare import REFERENCE_MESH
from ksd.units import deg, mm

TARGET_MS = {
    "crossed pivot": (8.7, 1.0, 0.5),
    "fourbar": (18.0, 2.0, 1.0),
    "three-joint arm": (55.0, 6.0, 3.0),
}
"""Time of a new design in the first release, measured on another day; target for a single one; target in a batch of 1000."""
CHAIN_TARGET_MS = {3: 3.0, 100: 30.0, 1000: 300.0}
"""Target of preparing and solving a chain, by its number of joints."""
REPEAT_TARGET_US = {"prepared": 130.0, "ksd.solve": 180.0, "ksd.solve with gravity, spring, heat": 400.0}
"""Targets of the fourbar at new drive values."""


def pivot(length: float = 60 * mm, thickness: float = 0.4 * mm) -> ksd.Mechanism:
    """A crossed pivot driven by its angle."""
    joint = ksd.CrossedPivot(STEEL, length=length, angle=45 * deg, thickness=thickness, width=20 * mm)
    scene = ksd.Mechanism("pivot")
    tip = scene.link("tip")
    scene.actuate_joint(scene.join(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x"), name="turn")
    return scene


def fourbar(length: float = 100 * mm, thickness: float = 1 * mm, *, effects: bool = False) -> ksd.Mechanism:
    """The fourbar of the README; `effects`: with gravity, a spring and heat."""
    steel = ksd.Material(E=STEEL.E, G=STEEL.G, density=STEEL.density, expansion=12e-6 if effects else None)
    joint = cross_flexure(length=length, thickness=thickness, material=steel)
    scene = linkage([joint] * 4, 0.3)
    scene.actuate("top", along="x", at=(0, 0.3 + joint.length_AB, 0))
    if effects:
        scene.spring("ground", "top", start=(0, 0, 0), end=(0, 0.3, 0), stiffness=200, free_length=0)
        scene.gravity = (0, -9.81, 0)
        scene.heat(20)
    return scene


CASES: dict[str, tuple[Callable[..., ksd.Mechanism], dict[str, float], str, Any, tuple[float, float]]] = {
    "crossed pivot": (pivot, {"turn": 15 * deg}, "tip", (0.0, 0.0, 0.0), (60 * mm, 0.4 * mm)),
    "fourbar": (fourbar, {"top": 300 * mm}, "top", (0.0, 0.3, 0.0), (100 * mm, 1 * mm)),
    "three-joint arm": (
        arm, dict.fromkeys(("base", "shoulder", "elbow"), 30 * deg), "third", TIP, (60 * mm, 0.45 * mm),
    ),
}  # fmt: skip
"""By name: function that returns the scene, drive values, link of the stiffness, nominal length and thickness [m]."""


def design(name: str, n: int) -> dict[str, Any]:
    """The n-th design: length and thickness slightly changed."""
    length, thickness = CASES[name][4]
    rng = np.random.default_rng(n)
    return {"length": length * rng.uniform(0.95, 1.05), "thickness": thickness * rng.uniform(0.9, 1.1)}


def solve_and_answer(name: str, scene: ksd.Mechanism, **how: Any) -> tuple[ksd.Configuration, np.ndarray]:
    """Configuration with its forces, and the 6x6 compliance of the link."""
    _, targets, link, at, _ = CASES[name]
    pose = ksd.prepare(scene, **how)(targets)
    return pose, pose.stiffness(link, at=at).compliance


def new_designs(repeats: int) -> list[dict[str, Any]]:
    """Medians [ms] of building a scene and of prepare + force + stiffness, and the errors of the answer."""
    fresh = itertools.count(1)
    pool = {name: itertools.cycle([make(**design(name, next(fresh))) for _ in range(repeats + 3)])
            for name, (make, *_) in CASES.items()}  # fmt: skip

    def solving(name: str) -> Callable[[], Any]:
        return lambda: solve_and_answer(name, next(pool[name]))

    def building(name: str) -> Callable[[], Any]:
        return lambda: CASES[name][0](**design(name, next(fresh)))

    whole = time_in_turns({name: solving(name) for name in CASES}, repeats=repeats)
    scene = time_in_turns({name: building(name) for name in CASES}, repeats=repeats)
    rows = []
    for name, (make, *_) in CASES.items():
        near, stiffness = solve_and_answer(name, make())
        fine, exact = solve_and_answer(name, make(), mesh=REFERENCE_MESH)
        assert near.error is not None
        force = max(abs(near.forces[k] / fine.forces[k] - 1) for k in near.forces)
        before, alone, _ = TARGET_MS[name]
        rows.append(
            {
                "what": name, "ms": whole[name].median / 1e3, "wanted_ms": alone, "first_release_ms": before,
                "scene_alone_ms": scene[name].median / 1e3, "forces": dict(near.forces), "force_error": force,
                "force_error_told": near.error.relative, "stiffness_error": _compliance_difference(stiffness, exact),
            }
        )  # fmt: skip
    return rows


def _compliance_difference(one: np.ndarray, other: np.ndarray) -> float:
    """Largest difference of two compliances (6, 6), forces apart from moments, over the largest entry of their kind."""
    blocks = [(slice(a, a + 3), slice(b, b + 3)) for a in (0, 3) for b in (0, 3)]
    return float(max(np.max(np.abs(one[at] - other[at])) / np.max(np.abs(other[at])) for at in blocks))


def batch_time(name: str, count: int, questions: Sequence[str] = ("support_stiffness",)) -> float:
    """CPU time of a design [ms] among `count` in one `ksd.batch`, scenes made in it, with force and answers."""
    make, targets, link, at, _ = CASES[name]
    ways: dict[str, Any] = {"threads": 1, "questions": questions, "link": link, "at": at}
    ksd.batch(make, targets, designs=[design(name, n) for n in range(5)], **ways)
    some = [design(name, n) for n in range(count)]
    # of the process: the designs are solved in a thread of their own
    begin = time.process_time_ns()
    ksd.batch(make, targets, designs=some, **ways)
    return 1e-6 * (time.process_time_ns() - begin) / count


def chain_times(joints: int, repeats: int) -> float:
    """Time [ms] of preparing a chain and solving it once."""
    spent = []
    for _ in range(repeats + 1):
        scene, targets = chain(joints)
        spent.append(thread_us(partial(_prepare_and_solve, scene, targets)) / 1e3)
    return float(np.median(spent[1:]))


def _prepare_and_solve(scene: ksd.Mechanism, targets: dict[str, float]) -> ksd.Configuration:
    return ksd.prepare(scene)(targets)


def memory_left(count: int) -> float:
    """Growth of the process [MB] by `count` new fourbars solved, after fifty others."""

    def resident() -> float:
        gc.collect()
        return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

    before = 0.0
    for n in range(count + 50):
        if n == 50:
            before = resident()
        ksd.solve(fourbar(**design("fourbar", n)), top=300 * mm)
    return resident() - before


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure, print, write designs.json; returns what was found."""
    given = parse_options(__doc__, argv)
    quick = given.quick
    rows = new_designs(3 if quick else 25)
    for row in rows:
        name, count = row["what"], 10 if quick else 1000
        row["batch_ms"], row["batch_wanted_ms"] = batch_time(name, count), TARGET_MS[name][2]
        row["batch_stress_ms"] = batch_time(name, count, ("support_stiffness", "stress"))
        print(
            f"{row['what']:16} {row['ms']:7.2f} ms (wanted {row['wanted_ms']:g}, first release "
            f"{row['first_release_ms']:g}), the scene alone {row['scene_alone_ms']:.2f}; {row['batch_ms']:.2f} each in one "
            f"call, {row['batch_stress_ms']:.2f} with stress; force "
            f"{row['force_error']:.1e} off, told {row['force_error_told']:.1e}, stiffness "
            f"{row['stiffness_error']:.1e} off"
        )
    bare, full = fourbar(), fourbar(effects=True)
    solver = ksd.prepare(bare)
    stroke = itertools.cycle(np.linspace(0.1, 0.3, 17))
    calls: dict[str, Callable[[], Any]] = dict(zip(REPEAT_TARGET_US, (
        lambda: solver(top=float(next(stroke))),
        lambda: ksd.solve(bare, top=float(next(stroke))),
        lambda: ksd.solve(full, top=float(next(stroke))),
    ), strict=True))  # fmt: skip
    again = time_in_turns(calls, repeats=20 if quick else 400, warm=10)
    for name, wanted in REPEAT_TARGET_US.items():
        print(f"{name:36} {again[name].median:7.1f} us (wanted {wanted:g})")
    chains = [
        {"joints": joints, "ms": chain_times(joints, 1 if quick else 3), "wanted_ms": wanted}
        for joints, wanted in CHAIN_TARGET_MS.items()
        if joints <= 100 or not quick
    ]
    for found in chains:
        print(
            f"chain of {found['joints']:4} joints, prepared and solved: {found['ms']:.1f} ms (wanted {found['wanted_ms']:g})"
        )
    left = memory_left(20 if quick else 1500)
    print(f"memory after many new scenes: {left:+.1f} MB")
    result = {
        "machine": machine(), "rows": rows, "chains": chains,
        "again_us": {name: t.numbers() for name, t in again.items()}, "memory_left_MB": left,
    }  # fmt: skip
    write_json(result, given.out / "designs.json")
    return result


if __name__ == "__main__":
    main()
