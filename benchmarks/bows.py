"""Random bows with a string off their middle, braced and drawn: solved wherever a way of small steps leads to a minimum.

    python benchmarks/bows.py [--quick] [--out FOLDER]

The bows of `tests/hard_scenes.py`: limbs of unequal length, thickness and slant, the string off the middle, too short by 2
to 9 %, in one or two pieces, perhaps drawn at a nock. The judge makes the string shorter in sixty steps, leaves the straight
bow to one side where that is unstable, follows the draw by arc length (`ksd.follow`), and is on a mesh of its own. Counted
are bows that the judge solves and `ksd.solve` does not, and differences of the tips over the size. Where the draw snaps on
its way both may end elsewhere. Writes bows.json.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests"), str(ROOT)]

from common import machine, parse_options, write_json  # noqa: E402
from hard_scenes import bow  # noqa: E402

import ksd  # noqa: E402
from ksd.errors import KsdError  # noqa: E402
from ksd.solvers.conventional import solve_conventional  # noqa: E402
from ksd.solvers.either_side import nearby_minimum  # noqa: E402
from ksd.solvers.undeformed_stability import unstable_shape  # noqa: E402

MESH = ksd.Mesh(orders=(4, 3, 24), points=28)
STEPS = 60


def judge(seed: int, steps: int = STEPS) -> tuple[Any, str]:
    """The stable end of the way in small steps, None without one; and what the way met."""
    pose: Any = None
    said = ""
    for k in range(1, steps + 1):
        scene, drives = bow(np.random.default_rng(seed), share=k / steps)
        model, still = ksd.compile_scene(scene, mesh=MESH), dict.fromkeys(drives, 0.0)
        try:
            pose = solve_conventional(model, still, start=pose and replace(pose, model=model))
        except KsdError as reason:
            return None, str(reason)
        if not pose.stable:
            state, _ = nearby_minimum(model, pose, unstable_shape(model, pose.motion, 1.0)[1])
            if state is None:
                return None, "no minimum beside the unstable state"
            pose = replace(pose, motion=state, negatives=len(drives))
    if drives:
        path = ksd.follow(pose.model, drives, control="drives", start=pose)
        said = ", ".join(f"{t.kind} at {t.factor:.2g} of the draw" for t in path.turnings)
        pose = path.states[-1] if path.ended else None
    return (pose if pose is not None and pose.stable else None), said


def measure(count: int, steps: int) -> list[dict[str, Any]]:
    """A row for every bow."""
    rows = []
    for seed in range(count):
        scene, drives = bow(np.random.default_rng(seed))
        begin = time.thread_time()
        try:
            pose, said = ksd.solve(scene, drives), ""
        except KsdError as reason:
            pose, said = None, str(reason)
        taken = time.thread_time() - begin
        right, way = judge(seed, steps)
        row: dict[str, Any] = {
            "bow": seed, "drives": drives, "time": taken, "solved": pose is not None, "way exists": right is not None,
            "way": way, "said": said,
        }  # fmt: skip
        if pose is not None and right is not None:
            size = right.model.arrays.size
            row["apart"] = (
                max(float(np.abs(pose.displacement(n) - right.displacement(n)).max()) for n in ("up", "down"))
                / size
            )
        rows.append(row)
        print(row, flush=True)
    return rows


def main(arguments: Sequence[str] | None = None) -> dict[str, Any]:
    """Run the bows; returns what is written."""
    options = parse_options(__doc__ or "", arguments)
    rows = measure(*((2, 15) if options.quick else (20, STEPS)))
    missed = [row["bow"] for row in rows if row["way exists"] and not row["solved"]]
    apart = [row["apart"] for row in rows if not row["way"] and "apart" in row]
    print(f"{sum(row['solved'] for row in rows)} of {len(rows)} solved, {len(missed)} missed: {missed}")
    print(f"without a singular point on the way: {max(apart, default=0.0):.1g} of the size apart at most")
    found = {"machine": machine(), "rows": rows, "missed": missed, "apart": max(apart, default=0.0)}
    write_json(found, options.out / "bows.json")
    return found


if __name__ == "__main__":
    main()
