"""The bank of hard cases: every case by every method, right, refused or wrong.

    python benchmarks/hard_cases.py [--verify]

Cases and verified answers: `hard_cases.py`, `hard_classics.py` and `hard_families.py` in `tests/validation`. "right"
matches the verified answer to its tolerance (a fast method: to 1.5 times the error it states; ten Appendix A elements: to
2 %, or to the tolerance what 96 load steps of the same elements end in), "rough" states an error above 10 %, "refused" is a
typed error with its reason, "wrong" must not occur.
The table goes to `benchmarks/results/hard_cases.md`. --verify walks every case in 96 small load steps with finer leaves and
prints the answers instead.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT / "tests" / "validation"), str(ROOT / "tests"), str(ROOT)]

from common import RESULTS, machine, machine_line  # noqa: E402
from hard_bank import CASES, FINE, Case  # noqa: E402

import ksd  # noqa: E402
from ksd.errors import ConvergenceError, KsdError  # noqa: E402
from ksd.model.compile import compile_scene  # noqa: E402
from ksd.model.mesh import Mesh  # noqa: E402
from ksd.solvers.conventional import solve_conventional  # noqa: E402

METHODS: dict[str, dict[str, Any]] = {
    "default": {},
    "kinematic": {"method": "kinematic"},
    "reduced": {"method": "reduced"},
    "1 step": {"method": "reduced", "relinearisations": 1},
    "full": {"method": "full"},
    "conventional": {"method": "conventional"},
    "chain": {"mesh": Mesh("corotational", elements=10)},
    "chain, full": {"mesh": Mesh("corotational", elements=10), "method": "full"},
    "plain Newton": {"mesh": Mesh("corotational", elements=10, mip=False), "method": "conventional"},
    "modal": {"method": "modal"},
    "spatial": {"method": "conventional", "planar": False},
    "path": {"path": True},
}
"""Columns of the table: words for `ksd.solve`; "spatial" is the conventional solver kept out of the plane."""
ELEMENT_TOLERANCE = 0.02
"""Tolerance of 10 Appendix A elements per leaf against finer answers: far from any other branch."""
FAST = ("kinematic", "reduced", "modal")
STATED, ROUGH = 1.5, 0.1
"""A fast method is right within STATED times the error it states; beyond ROUGH it says itself that it is no answer."""


def has_joints(scene: Any) -> bool:
    """Whether the five-step methods apply; a scene that is refused is refused by all methods."""
    try:
        return bool(scene.scene().joints)
    except KsdError:
        return True


def applies(case: Case, scene: Any, method: str) -> bool:
    """Whether a column says something about a case: paths are for `follow`, five steps for joints, chains and modal bodies,
    which have chains of their own, where the mesh is not part of the case."""
    ways = METHODS[method]
    if method == "path":
        return case.path is not None
    if case.path is not None and (case.path.get("control") != "drives" or method != "default"):
        return False
    if ways.get("method") in ("kinematic", "reduced", "full", "modal") and not has_joints(scene):
        return False
    if method == "modal" and case.mesh is not None and case.mesh.leaf != "strain":
        return False
    return not ("mesh" in ways and case.mesh is not None)


def solve_case(case: Case, scene: Any, method: str) -> Any:
    """Answer of the method of a column to a case. Raises KsdError where it refuses."""
    ways = METHODS[method]
    if method == "path":
        return ksd.follow(scene, dict(case.targets), mesh=case.mesh, **(case.path or {}))
    return ksd.solve(scene, case.targets, **{"mesh": case.mesh, **ways})


def attempt(case: Case, method: str) -> tuple[str, str]:
    """(right, rough, refused, wrong or -, the reason) of one column on one case."""
    scene = case.build()
    if not applies(case, scene, method):
        return "-", ""
    try:
        found = solve_case(case, scene, method)
        seen = found
        if case.path is not None and method != "path":
            seen = type("OneState", (), {"states": [found]})()
        value = case.value(seen)
    except KsdError as reason:
        return "refused", f"{type(reason).__name__}: {reason}"
    except IndexError:
        return "wrong", "no limit point found"
    fast = case.path is None and found.method in FAST
    if fast and found.error.relative > ROUGH:
        return "rough", f"states an error of {100 * found.error.relative:.2g} %"
    if case.answer is None:
        return "wrong", f"answered {value}, should refuse"
    scale = np.abs(case.answer).max() or 1.0
    error = float(np.abs(value - case.answer).max() / scale)
    allowed = case.tolerance
    if "mesh" in METHODS[method]:
        allowed = max(allowed, ELEMENT_TOLERANCE)
    if fast:
        allowed = max(allowed, STATED * found.error.relative)
    said = f"error {error:.1e}, {allowed:.1e} allowed"
    if error > allowed and "mesh" in METHODS[method]:
        try:
            own = float(np.abs(value - fine_solution(case, METHODS[method]["mesh"])).max() / scale)
        except KsdError:
            return "wrong", said
        error, allowed, said = (
            own,
            case.tolerance,
            f"{said}; {own:.1e} from fine load steps of these elements",
        )
    return ("right" if error <= allowed else "wrong"), said


def fine_solution(case: Case, mesh: Mesh | None = None) -> np.ndarray:
    """The answer in 96 small load steps with finer leaf springs, or with `mesh`.

    Raises ConvergenceError when the last state is not a minimum of energy.
    """
    mesh = mesh or case.mesh or FINE
    if case.path is not None:
        return case.value(ksd.follow(case.build(), dict(case.targets), mesh=mesh, **case.path))
    model = compile_scene(case.build(), mesh=mesh)
    found = solve_conventional(model, dict(case.targets), planar=False, steps=96)
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
                print(f"{case.name}: {fine_solution(case).tolist()}  ({case.answer})")
            except KsdError as reason:
                print(f"{case.name}: {reason}")
        return 0
    counts = {m: dict.fromkeys(("right", "rough", "refused", "wrong", "-"), 0) for m in METHODS}
    lines = ["| case | verified by | " + " | ".join(METHODS) + " |", "| --- " * (len(METHODS) + 2) + "|"]
    reasons = []
    for case in CASES:
        row = []
        for method in METHODS:
            verdict, why = attempt(case, method)
            counts[method][verdict] += 1
            row.append(verdict)
            if verdict in ("rough", "refused", "wrong"):
                reasons.append(f"- {case.name}, {method}: {verdict}: {why}")
        lines.append(f"| {case.name} | {case.verified} | " + " | ".join(row) + " |")
        print(f"{case.name:52}" + " ".join(row), flush=True)
    said = [
        f"{m}: " + ", ".join(f"{n} {v}" for v, n in count.items() if v != "-") for m, count in counts.items()
    ]
    print(*said, sep="\n")
    head = [
        f"# {len(CASES)} hard cases",
        "",
        f"By `python benchmarks/hard_cases.py`, {machine_line(machine())}.",
        "",
        *said,
        "",
    ]
    (RESULTS / "hard_cases.md").write_text("\n".join([*head, *lines, "", *reasons]) + "\n")
    return sum(c["wrong"] for c in counts.values())


if __name__ == "__main__":
    sys.exit(main())
