"""The method that `ksd.prepare` chooses by itself, against the fastest one that suffices, in 100 random scenes.

All families, drawn joints of 2 to 8 leaf springs, arms, loops, doors, sliders and frames, with small and large loads and
strokes. Every scene is solved at `POSES` poses on the way to its stroke, so that the choice has seen some; then at the last
one in turns by every method, thread CPU medians, ratios within each turn. A method suffices where the error that it tells
is within the accuracy.
Wanted: chosen within 10 % of the fastest sufficient method in 90 % of the scenes, never above 1.5 times; in sum below
always `full` and below always `conventional`. Writes results/chosen.json and chosen.md.
Run: python benchmarks/chosen.py [--quick]
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from common import machine, machine_line, parse_options, times_in_turns, write_json
from pays import drawn_guide, open_arm, platform
from robust_estimates import HINGES, JOINTED, frame, hinge, random_hinge

import ksd
from ksd.errors import KsdError

SCENES, POSES, ROUNDS = 100, 8, 61
ACCURACY, MAX_TIME = 1e-3, 0.1
"""Accuracy, and time [s] of all rounds of a scene by the method chosen."""
METHODS: tuple[Any, ...] = ("reduced", "full", "conventional")
WITHIN, NEVER, SHARE = 1.10, 1.5, 0.9
DRAWN = (2, 4, 8)
"""Leaf springs of the drawn joints."""


def arm(rng: np.random.Generator) -> tuple[Any, dict[str, float]]:
    """An arm of two to twelve hinges of one family, driven at its joints."""
    joint = random_hinge(rng, HINGES)
    return open_arm([joint] * int(rng.integers(2, 13)), turn=float(rng.uniform(0.02, 0.5)))


def drawn(rng: np.random.Generator) -> tuple[Any, dict[str, float]]:
    """One to three drawn guides in series, or a platform on four of them."""
    joint = drawn_guide(int(rng.choice(DRAWN)))
    count = int(rng.integers(1, 4))
    return open_arm([joint] * count, turn=float(rng.uniform(0.001, 0.006)))


def loops(rng: np.random.Generator) -> tuple[Any, dict[str, float]]:
    """A platform of two to six legs with a joint at either end of each."""
    return platform(
        random_hinge(rng, HINGES[:6]), legs=int(rng.integers(2, 7)), share=float(rng.uniform(0.05, 0.5))
    )


KINDS = (*JOINTED, hinge, arm, arm, drawn, drawn, loops, loops, frame)
"""Kinds of scenes, in turns."""


def measured(scene: Any, targets: dict[str, float], rounds: int) -> dict[str, Any] | None:
    """Times [us] of the choice and of every method that suffices; None where nothing solves the scene."""
    solver = ksd.prepare(scene, accuracy=ACCURACY)
    try:
        for share in np.linspace(1 / POSES, 1.0, POSES):
            pose = solver({n: share * v for n, v in targets.items()})
    except KsdError:
        return None
    cases = {"chosen": partial(solver, targets)}
    for method in METHODS:
        try:
            found = solver(targets, method=method)
        except KsdError:
            continue
        if found.method_error is None or found.method_error.relative <= ACCURACY:
            cases[method] = partial(solver, targets, method=method)
    if len(cases) == 1:
        return None
    # load steps of seconds are not repeated as often
    rounds = max(5, min(rounds, int(MAX_TIME / pose.time)))
    spent = times_in_turns(cases, repeats=rounds, warm=5)
    times = {name: float(np.median(values)) for name, values in spent.items()}
    fastest = min(spent.keys() - {"chosen"}, key=lambda name: times[name])
    return {
        "method": solver(targets).method,
        "fastest": fastest,
        "ratio": float(np.median(np.array(spent["chosen"]) / np.array(spent[fastest]))),
        "us": times,
        "drives": len(targets),
        "joints": len(pose.model.scene.joints),
    }


def verdict(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What the rows say of the choice."""
    ratios = np.array([row["ratio"] for row in rows])
    sums = {"chosen": float(sum(r["us"]["chosen"] for r in rows))}
    for method in METHODS[1:]:
        # where a method does not solve a scene, another one has to
        sums[method] = float(sum(r["us"].get(method, max(r["us"].values())) for r in rows))
    share = float(np.mean(ratios <= WITHIN))
    met = (
        share >= SHARE and ratios.max() <= NEVER and sums["chosen"] <= min(sums["full"], sums["conventional"])
    )
    return {
        "scenes": len(rows), "share_within_10_percent": share, "above_1.5": int(np.sum(ratios > NEVER)),
        "worst": float(ratios.max()), "median": float(np.median(ratios)), "sum_us": sums, "met": bool(met),
        "ratios": ratios,
    }  # fmt: skip


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure, print, write; returns what was found."""
    asked = parse_options(__doc__, argv)
    count, rounds = (len(KINDS), 15) if asked.quick else (SCENES, ROUNDS)
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as folder:
        for leaves in DRAWN:
            ksd.train(drawn_guide(leaves), out=folder, meshes=("strain",), progress=False)
        os.environ["KSD_DATABASE"] = folder
        number = 0
        while len(rows) < count:
            rng = np.random.default_rng((11, number))
            kind = KINDS[number % len(KINDS)]
            scene, targets = kind(rng)
            share = float(rng.uniform(0.05, 1.0))
            row = measured(scene, {n: share * v for n, v in targets.items()}, rounds)
            if row is not None:
                rows.append({"kind": kind.__name__, "number": number, **row})
                print(f"{kind.__name__:16} {row['method']:13}", {n: round(v) for n, v in row["us"].items()})
            number += 1
    found = {"machine": machine(), **verdict(rows), "rows": rows}
    write_json(found, asked.out / "chosen.json")
    lines = table(found)
    (asked.out / "chosen.md").write_text("\n".join(lines) + "\n")
    print("\n".join(lines))
    return found


def table(found: dict[str, Any]) -> list[str]:
    """The verdict as a table in Markdown."""
    sums = ", ".join(f"{n} {v / 1000:.1f} ms" for n, v in found["sum_us"].items())
    ratios = found["ratios"]
    return [
        f"Measured {machine_line(found['machine'])}.", "",
        "| chosen over the fastest sufficient method | |", "|---|---|",
        f"| scenes | {found['scenes']} |",
        f"| within 10 % | {100 * found['share_within_10_percent']:.0f} % |",
        f"| median, worst | {np.median(ratios):.2f}, {found['worst']:.2f} |",
        f"| above 1.5 times | {found['above_1.5']} |",
        f"| sum of all scenes | {sums} |",
    ]  # fmt: skip


if __name__ == "__main__":
    main()
