"""The bank of hard cases: every case by every method, right, refused or wrong.

    python benchmarks/hard_cases.py [--verify]

Cases and verified answers: `tests/validation/hard_cases.py`. "right" matches the verified answer to its tolerance,
"refused" is a typed error with its reason, "wrong" must not occur. --verify walks every case in 96 small load steps with
finer leafs and prints the answers instead.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / "validation"), str(ROOT / "tests"), str(ROOT)]

from hard_cases import CASES, FINE, Case  # noqa: E402

import ksd  # noqa: E402
from ksd.errors import ConvergenceError, KsdError  # noqa: E402
from ksd.model.compile import compile_scene  # noqa: E402
from ksd.solve.conventional import conventional  # noqa: E402

METHODS = ("default", "full", "conventional", "path")


def attempt(case: Case, method: str) -> tuple[str, str]:
    """(right, refused, wrong or -, the reason) of one method on one case."""
    scene = case.build()
    try:
        if method == "path":
            if case.path is None:
                return "-", ""
            found: Any = ksd.follow(scene, dict(case.targets), mesh=case.mesh, **case.path)
        else:
            if case.path is not None and case.path.get("control") != "drives":
                return "-", ""
            if method == "full" and not scene.scene().joints:
                return "-", ""
            found = ksd.solve(
                scene, case.targets, mesh=case.mesh, method=None if method == "default" else method
            )
            if case.path is not None:
                found = type("OneState", (), {"states": [found]})()
        value = case.value(found)
    except KsdError as reason:
        return "refused", f"{type(reason).__name__}: {reason}"
    except IndexError:
        return "wrong", "no limit point found"
    if case.answer is None:
        return "wrong", f"answered {value}, should refuse"
    scale = np.abs(case.answer).max() or 1.0
    error = float(np.abs(value - case.answer).max() / scale)
    return ("right" if error <= case.tolerance else "wrong"), f"error {error:.1e}"


def walked(case: Case) -> np.ndarray:
    """The answer in 96 small load steps with finer leafs; ConvergenceError when that walk does not end in a minimum."""
    mesh = case.mesh or FINE
    if case.path is not None:
        return case.value(ksd.follow(case.build(), dict(case.targets), mesh=mesh, **case.path))
    model = compile_scene(case.build(), mesh=mesh)
    found = conventional(model, dict(case.targets), planar=False, steps=96)
    if not found.stable:
        raise ConvergenceError("the walk ends in a state that is no minimum")
    return case.value(found)


def main() -> int:
    """Print the table; returns the number of wrong answers."""
    if "--verify" in sys.argv:
        for case in CASES:
            if case.answer is None:
                continue
            try:
                print(f"{case.name}: {walked(case).tolist()}  ({case.answer})")
            except KsdError as reason:
                print(f"{case.name}: {reason}")
        return 0
    counts = {m: dict.fromkeys(("right", "refused", "wrong", "-"), 0) for m in METHODS}
    print(f"{'case':52}" + "".join(f"{m:14}" for m in METHODS))
    reasons = []
    for case in CASES:
        row = f"{case.name:52}"
        for method in METHODS:
            verdict, why = attempt(case, method)
            counts[method][verdict] += 1
            row += f"{verdict:14}"
            if verdict in ("refused", "wrong"):
                reasons.append(f"{case.name}, {method}: {verdict}: {why}")
        print(row, flush=True)
    for method, count in counts.items():
        print(f"{method}: " + ", ".join(f"{n} {v}" for v, n in count.items() if v != "-"))
    print(*reasons, sep="\n")
    return sum(c["wrong"] for c in counts.values())


if __name__ == "__main__":
    sys.exit(main())
