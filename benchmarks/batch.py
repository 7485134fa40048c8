"""Very many configurations: 10,000 designs of the fourbar at 10 poses each, and tabulated joints of the three-joint arm.

Designs differ in thickness, leaf length, angle, inner width, height and Young's modulus; some are drawn outside the trained
range or beyond what the linkage reaches, and must be told as failures. Wall time in one thread, in threads of one process
and in worker processes, in turns, with the CPU time of one design and its parts; forces against designs prepared one by
one. Tabulated joints: thread time of a configuration of the arm, by joints and by location, beside the same without tables,
and the force error.
Targets: 100,000 configurations under 20 s on two cores, a tabulated configuration of the arm under 30 us.
Run: python benchmarks/batch.py
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from typing import Any

import numpy as np
from bench_scenes import TIP, arm_by_joints, arm_by_location
from common import linkage, machine, parse_options, time_in_turns, write_json
from floor import one_pass

import ksd
from ksd.solvers.solver import Solver
from ksd.study.batch import NOT_BUILT
from ksd.study.prepared_design import PreparedDesign
from ksd.units import GPa, deg, mm

DESIGNS, POSES = 10_000, 10
ROUNDS = 5
"""Parts of the designs, which threads and processes solve in turns."""
TARGET_S, TARGET_US = 20.0, 30.0
RANGES = {
    "thickness": (0.6 * mm, 1.2 * mm), "length": (90 * mm, 110 * mm), "angle": (40 * deg, 50 * deg),
    "inner": (30 * mm, 45 * mm), "high": (0.28, 0.32), "E": (70 * GPa, 210 * GPa),
}  # fmt: skip
UNTRAINED_SHARE = 0.01
"""Share of designs with an angle outside the trained range."""


def fourbar(
    *, thickness: float, length: float, angle: float, inner: float, high: float, E: float
) -> ksd.Mechanism:
    """One design; lengths in m, the angle in rad."""
    joint = ksd.CrossFlexure(
        ksd.Material(E=E, G=E / 2.6),
        length=length,
        angle=angle,
        thickness=thickness,
        widths=(inner, 0.5 * inner),
    )
    scene = linkage([joint] * 4, high)
    scene.actuate("top", along="x", at=(0, high + joint.length_AB, 0))
    return scene


def random_designs(count: int, seed: int = 1) -> list[dict[str, float]]:
    """Random designs, one in a hundred with an angle outside the trained range."""
    rng = np.random.default_rng(seed)
    found = [{name: float(rng.uniform(*r)) for name, r in RANGES.items()} for _ in range(count)]
    for design in found:
        if rng.uniform() < UNTRAINED_SHARE:
            design["angle"] = 10 * deg
    return found


def measure_designs(count: int) -> dict[str, Any]:
    """Wall and CPU time of a batch in threads and in processes, its failures, and its forces against fresh models."""
    designs, stroke = random_designs(count), np.linspace(0.02, 0.3, POSES)
    workers = os.cpu_count() or 1
    ksd.batch(fourbar, designs=designs[:5], top=stroke)
    ways: dict[str, Any] = {"one thread": {"threads": 1}, f"{workers} threads": {"threads": workers}}
    rows: dict[str, dict[str, Any]] = {}
    failures: list[str] = []
    with ProcessPoolExecutor(workers) as pool:
        # workers that have started and loaded their kernels
        ksd.batch(fourbar, designs=designs[: 200 * workers], top=stroke, executor=pool)
        ways[f"{workers} processes"] = {"executor": pool}
        for first in range(0, count, -(-count // ROUNDS)):
            some = designs[first : first + -(-count // ROUNDS)]
            for name, how in ways.items():
                row = rows.setdefault(name, {"way": name, "wall_s": 0.0, "cpu_s": 0.0})
                begin, spent = time.perf_counter(), time.process_time()
                found = ksd.batch(fourbar, designs=some, top=stroke, **how)
                row["wall_s"] += time.perf_counter() - begin
                row["cpu_s"] += time.process_time() - spent
            failures += [why for _, _, why in found.failures]
    for row in rows.values():
        row["over_one_thread"] = row["wall_s"] / rows["one thread"]["wall_s"]
        row["met"] = row["wall_s"] <= TARGET_S * count / DESIGNS
        print(
            f"{count} designs x {POSES} poses, {row['way']:12}: {row['wall_s']:6.2f} s wall, "
            f"{row['over_one_thread']:.2f} times one thread"
        )
    few = designs[:40]
    near = ksd.batch(fourbar, designs=few, top=stroke, threads=1)
    off = largest_force_difference(near, few, stroke)
    print(f"largest difference of a force from designs prepared one by one: {off:.1e}")
    return {
        "designs": count, "poses": POSES, "target_s": TARGET_S, "rows": list(rows.values()),
        "solved": count * POSES - len(failures), "failures": len(failures), "reasons": sorted(set(failures))[:5],
        "difference_from_fresh": off, "parts_us": time_parts(designs[1:641], stroke),
    }  # fmt: skip


def largest_force_difference(found: ksd.Batch, designs: Sequence[Mapping[str, float]], stroke: Any) -> float:
    """Largest difference of a force from designs prepared one by one, over the largest force of its design."""
    off = 0.0
    for d, design in enumerate(designs):
        if found.status[d, 0] != NOT_BUILT:
            five = Solver(fourbar(**design)).five_steps
            force = PreparedDesign(five)({"top": np.asarray(stroke, float)}).force[:, 0]
            good = found.status[d] == 0
            off = max(
                off, float(np.abs(found.forces["top"][d] - force)[good].max() / np.abs(force[good]).max())
            )
    return off


def time_parts(designs: list[dict[str, float]], stroke: np.ndarray) -> dict[str, float]:
    """Thread time [us] of a design: building its scene, the rest of its preparation, and one pose; alone and in a batch."""
    scenes = [fourbar(**d).scene() for d in designs]
    one = stroke[:1]

    def batch(poses: np.ndarray) -> None:
        ksd.batch(
            lambda number: scenes[number],
            designs=[{"number": k} for k in range(len(scenes))],
            top=poses,
            threads=1,
        )

    spent: dict[str, float] = {}
    calls: dict[str, Callable[[], Any]] = {
        "scene": lambda: [fourbar(**d) for d in designs],
        "in a batch, one pose": lambda: batch(one),
        f"in a batch, {POSES} poses": lambda: batch(stroke),
        "alone, one pose": lambda: [
            PreparedDesign(Solver(s).five_steps)({"top": one}) for s in scenes if _has_record(s)
        ],
    }
    for name, call in calls.items():
        call()
        # threads of a batch are not this one, so process time is what tells
        begin = time.process_time()
        call()
        spent[name] = 1e6 * (time.process_time() - begin) / len(designs)
        print(f"{name:24} {spent[name]:7.0f} us per design")
    return spent


def _has_record(scene: Any) -> bool:
    return bool(scene.joints[0].joint.angle > 20 * deg)


def measure_tabulated(count: int) -> list[dict[str, Any]]:
    """The arm by joints and by location, with tables and without: time of a configuration and error of its forces."""
    rows = []
    for case, (scene, targets) in {"by joints": arm_by_joints(), "by location": arm_by_location()}.items():
        for leaves, mesh in {
            "strain-mode": ksd.Mesh(),
            "5 elements": ksd.Mesh("corotational", elements=5),
        }.items():
            near, exact = (
                PreparedDesign(Solver(scene, mesh=mesh).five_steps, tabulated=t) for t in (True, False)
            )
            values = arm_positions(case, targets, count)
            few = {name: v[:: max(1, count // 20)] for name, v in values.items()}
            times = time_in_turns({"near": partial(near, values), "exact": partial(exact, few)}, repeats=5)
            a, b = near(few), exact(few)
            good = (a.status == 0) & (b.status == 0)
            off = float(np.abs(a.force - b.force)[good].max() / np.abs(b.force[good]).max())
            us = times["near"].median / count
            assert near.tables is not None
            least = minimum_work(near, {name: float(v[-1]) for name, v in few.items()})
            rows.append({
                "case": case, "leaves": leaves, "us": us, "target_us": TARGET_US, "met": us <= TARGET_US,
                "without_tables_us": times["exact"].median / len(few[next(iter(few))]),
                "solved": int(np.sum(near(values).status == 0)), "of": count, "force_error": off,
                "interpolation_error": near.tables.error, "pieces": near.tables.cubic.shape[1], "floor": least,
            })  # fmt: skip
            verdict = "met" if rows[-1]["met"] else f"MISSED: {least}"
            print(
                f"arm {case:11} {leaves:11}: {us:5.1f} us (target {TARGET_US:g}: {verdict}), without tables "
                f"{rows[-1]['without_tables_us']:.0f} us; {rows[-1]['solved']} of {count} solved; force error {off:.1e}, "
                f"{near.tables}"
            )
    return rows


def minimum_work(prepared: PreparedDesign, values: Mapping[str, float]) -> str:
    """The least work of a tabulated configuration, as a sentence with counts."""
    five = prepared.solver
    found = five(values, five.model.targets(values), method="reduced", relinearisations=0, estimate=False)
    one = one_pass(five.storage.bodies.reduced)
    first, third = (next(s.iterations for s in found.steps if s.name[0] == n) for n in "13")
    return (
        f"from rest step 1 takes {first} iterations and one residual check, step 3 {third} and one residual check of {one} "
        "each, in blocks of six, too short for vector registers"
    )


def arm_positions(case: str, targets: Mapping[str, float], count: int) -> dict[str, np.ndarray]:
    """Drive values where all joints of the arm turn by 0.05 to 0.99 times their angle; by location these are the places that
    moves its end to."""
    scene, angles = arm_by_joints()
    shares = np.linspace(0.05, 0.99, count)
    by_joints = {name: shares * value for name, value in angles.items()}
    if case == "by joints":
        return by_joints
    found = PreparedDesign(Solver(scene).five_steps, tabulated=True)(by_joints)
    rest = Solver(scene).model.rest.x
    link, end = found.links.index("third"), np.array(TIP)
    moved = found.x[:, link] + found.R[:, link] @ (end - rest[link]) - end
    return {name: moved[:, k].copy() for k, name in enumerate(targets)}


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure, print, write batch.json; returns what was found."""
    asked = parse_options(__doc__, argv)
    found = {
        "machine": machine(),
        "designs": measure_designs(200 if asked.quick else DESIGNS),
        "tabulated": measure_tabulated(100 if asked.quick else 2000),
    }
    write_json(found, asked.out / "batch.json")
    return found


if __name__ == "__main__":
    main()
