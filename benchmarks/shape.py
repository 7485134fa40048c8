"""Cost of the drawn shape of a configuration, in prepared solves: `pose.shape()` at 17 stations per leaf.

    python benchmarks/shape.py [--quick] [--out FOLDER]

Shipped scenes at the drive values of their files; thread CPU time in one process, solve and shape in turns, medians.
A page that follows the mouse draws every answer, so a shape should cost little more than a solve. Writes shape.md and .json.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from common import machine, machine_line, parse_options, time_in_turns, write_json

import ksd
from ksd.scene.toml_file import shipped_scenes

SCENES = ("guide", "fourbar", "gripper", "delta_stage", "six_joint_arm")
STATIONS = 17


def cost(name: str, *, repeats: int) -> dict[str, Any]:
    """Time [us] of a prepared solve and of the shape of its answer, and their ratio."""
    mechanism, targets, _ = ksd.load_scene(str(shipped_scenes()[name]))
    solver = ksd.prepare(mechanism)
    pose = solver(targets)
    cases: dict[str, Callable[[], Any]] = {
        "solve": partial(solver, targets),
        "shape": partial(pose.shape, points=STATIONS),
    }
    times = time_in_turns(cases, repeats=repeats)
    solve, shape = (times[key].median for key in cases)
    leaves = len(pose.shape(points=STATIONS).leaves)
    return {"leaves": leaves, "solve_us": solve, "shape_us": shape, "shape_over_solve": shape / solve}


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Print and store times and ratios of all scenes."""
    chosen = parse_options(__doc__, argv)
    repeats = 5 if chosen.quick else 200
    found: dict[str, Any] = {
        "machine": machine(),
        "scenes": {n: cost(n, repeats=repeats) for n in SCENES[: 3 if chosen.quick else None]},
    }
    rows = [
        f"| {n} | {c['leaves']} | {c['solve_us']:.0f} | {c['shape_us']:.0f} | {c['shape_over_solve']:.2f} |"
        for n, c in found["scenes"].items()
    ]
    head = "| scene | leaf springs | solve [µs] | shape [µs] | shape over solve |\n| --- | ---: | ---: | ---: | ---: |"
    text = "\n".join([f"Measured on {machine_line(found['machine'])}.\n", head, *rows, ""])
    (chosen.out / "shape.md").write_text(text)
    write_json(found, chosen.out / "shape.json")
    print(text)
    return found


if __name__ == "__main__":
    main()
