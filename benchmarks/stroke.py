"""All questions over a stroke: 31 poses of the fourbar, by `reduced` and by `full`, with the error of each answer.

Every standard question (force, drive and support stiffness, frequencies with modes followed, stress, parasitic motion,
energy), and buckling besides; thread CPU time of the whole sweep, methods in turns. Errors are the largest over the
stroke against `conventional` with strain-mode leaves of orders (6, 5, 9). Targets: 0.3 s with `reduced`, 1.5 s with `full`.
Run: python benchmarks/stroke.py
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from common import STROKE, fourbar, machine, parse_options, time_in_turns, write_json

import ksd
from ksd.study.compare import REFERENCE_MESH

QUESTIONS = (
    "force", "drive_stiffness", "support_stiffness", "frequencies", "stress", "parasitic", "energy", "buckling",
)  # fmt: skip
TARGETS = {"reduced": 0.3, "full": 1.5}
"""Seconds of thread time, see above."""
COMPARED_COLUMNS = ("top_force_N", "support_z_N_per_m", "first_parasitic_Hz", "stress_MPa")


def stroke(poses: int, questions: Sequence[str], **how: Any) -> ksd.Table:
    """The table of one sweep."""
    return ksd.sweep(
        fourbar(), top=np.linspace(0.0, STROKE, poses), questions=questions, progress=False, **how
    )


def errors(table: ksd.Table, exact: ksd.Table) -> dict[str, float]:
    """Largest relative differences over the stroke, the first pose (at rest) left out."""
    found = {}
    for column in COMPARED_COLUMNS:
        if column in table.columns:
            found[column] = float(np.max(np.abs(table[column][1:] / exact[column][1:] - 1)))
    return found


def main(argv: Sequence[str] | None = None) -> dict[str, Any]:
    """Measure, print, write stroke.json; returns what was found."""
    asked = parse_options(__doc__, argv)
    poses, repeats = (5, 1) if asked.quick else (31, 7)
    ways: dict[str, tuple[str, tuple[str, ...]]] = {
        f"{method}{' and buckling' if 'buckling' in questions else ''}": (method, questions)
        for method in TARGETS
        for questions in (QUESTIONS[:-1], QUESTIONS)
    }
    calls = {name: partial(stroke, poses, questions, method=m) for name, (m, questions) in ways.items()}
    times = time_in_turns(calls, repeats=repeats, warm=1)
    exact = stroke(poses, QUESTIONS[:-1], method="conventional", mesh=REFERENCE_MESH)
    rows = []
    for name, (method, _) in ways.items():
        table = calls[name]()
        seconds = 1e-6 * times[name].median
        rows.append({
            "way": name, "seconds": seconds, "target_s": TARGETS[method], "met": seconds <= TARGETS[method],
            **times[name].numbers(), "failures": len(table.failures), "largest_errors": errors(table, exact),
        })  # fmt: skip
        said = ", ".join(f"{k} {v:.1e}" for k, v in rows[-1]["largest_errors"].items())
        verdict = "met" if rows[-1]["met"] else "MISSED"
        print(f"{name:24} {seconds:6.3f} s (target {TARGETS[method]} s: {verdict}); errors: {said}")
    found = {"machine": machine(), "poses": poses, "rows": rows}
    write_json(found, asked.out / "stroke.json")
    return found


if __name__ == "__main__":
    main()
