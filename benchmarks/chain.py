"""Cost of a joint in a chain of 3, 10, 30 and 100 cross flexures, by `reduced` and by `full`.

Every joint turned by 10 to 20 degrees, left and right in turns; thread time of one configuration over the number of joints,
many configurations in one compiled call, cases in turns. `reduced` and `full`, both leaf models. Target: from 3 to 100
joints the cost of a joint stays within 25 %.
Run: python benchmarks/chain.py
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from bench_scenes import chain
from common import machine, parse_options, time_in_turns, write_json

import ksd
from ksd.solvers.solver import Solver
from ksd.study.prepared_design import PreparedDesign

JOINTS = (3, 10, 30, 100)
MAX_RELATIVE_INCREASE = 0.25
LEAVES = {"strain-mode": ksd.Mesh(), "5 elements": ksd.Mesh("corotational", elements=5)}


def storage_bytes(part: Any) -> int:
    """Bytes of all arrays in nested named tuples."""
    if isinstance(part, tuple):
        return sum(storage_bytes(field) for field in part)
    return int(getattr(part, "nbytes", 0))


class Case:
    """One chain by one method: called, it solves `count` configurations."""

    def __init__(self, joints: int, method: Any, mesh: ksd.Mesh) -> None:
        scene, targets = chain(joints)
        self.prepared = PreparedDesign(Solver(scene, mesh=mesh).five_steps, method=method)
        self.count = max(3, 300 // joints)
        self.values = {n: np.linspace(0.5, 1.0, self.count) * v for n, v in targets.items()}
        b = self.prepared.solver.storage
        self.bytes = storage_bytes(
            (*vars(b).values(), *vars(b.bodies).values(), b.model.arrays, b.model.rest)
        )
        self.solved = bool((self.prepared(self.values).status == 0).all())

    def __call__(self) -> None:
        self.prepared(self.values)


def joint_times(leaves: str, method: str, joints: Sequence[int], *, repeats: int) -> dict[str, Any]:
    """Time per joint and configuration [us] by number of joints, and its relative difference from the shortest chain."""
    cases = {n: Case(n, method, LEAVES[leaves]) for n in joints}
    times = time_in_turns({str(n): case for n, case in cases.items()}, repeats=repeats)
    each = {n: times[str(n)].median / case.count / n for n, case in cases.items()}
    off = max(abs(us / each[joints[0]] - 1.0) for us in each.values())
    few, more = joints[:2]
    slope = (more * each[more] - few * each[few]) / (more - few)
    row = {
        "fixed_us": few * (each[few] - slope),
        "storage_bytes": {n: case.bytes for n, case in cases.items()},
        "leaves": leaves, "method": method, "us_per_joint": each,
        "largest_change": off, "met": off <= MAX_RELATIVE_INCREASE, "solved": all(c.solved for c in cases.values()),
    }  # fmt: skip
    said = ", ".join(f"{n}: {us:.2f}" for n, us in each.items())
    verdict = "met"
    if not row["met"]:
        verdict = (
            f"MISSED: {row['fixed_us']:.0f} us of every configuration belong to no joint; storage of "
            f"{cases[joints[0]].bytes >> 10} to {cases[joints[-1]].bytes >> 10} kB"
        )
    print(f"{leaves:11} {method:8} us per joint: {said}; changes by {100 * off:.0f} % ({verdict})")
    return row


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure, print, write chain.json; returns what was found."""
    asked = parse_options(__doc__, argv)
    joints, repeats = ((3, 10), 2) if asked.quick else (JOINTS, 9)
    rows = [
        joint_times(leaves, method, joints, repeats=repeats)
        for leaves in LEAVES
        for method in ("reduced", "full")
    ]
    found = {"machine": machine(), "bound": MAX_RELATIVE_INCREASE, "rows": rows}
    write_json(found, asked.out / "chain.json")
    return found


if __name__ == "__main__":
    main()
