"""The benchmark at equal accuracy, and its ratios, as the Markdown tables of the README."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path

from ksd.bench import asked
from ksd.bench.measure import Measured, Row
from ksd.bench.report import engine_lines, good, machine, percent
from ksd.errors import SceneError

METHODS = (
    "kinematic", "reduced", "reduced, 1 pass", "reduced, 2 passes", "full", "reduced, planar", "reduced, 1 pass, planar",
    "reduced, 2 passes, planar", "full, planar", "conventional", "conventional, planar", "modal", "MIP, best eps_max",
    "MIP on all nodes", "plain Newton",
)  # fmt: skip
KINDS = ("strain-mode", "Appendix A", "modal")
_MISSED = "not reached"
BEGIN, END = "<!-- bench:begin -->", "<!-- bench:end -->"


def kind_of(row: Row) -> str:
    """Which leaf model a row has."""
    return {"strain": "strain-mode", "modal": "modal"}.get(row.leafs.split(",")[0].split()[0], "Appendix A")


def equal_accuracy(results: Sequence[Measured]) -> str:
    """Markdown: the cheapest setting of every method within GOOD, in us of a whole call, and its error in force.

    Appendix A elements and strain-mode leafs apart; with the ratios of the papers' comparison below.
    """
    cases = [m for m in results if any(good(r) for r in m.rows)]
    lines = ["| method | leafs | " + " | ".join(m.case for m in cases) + " |"]
    lines.append("|---" * (2 + len(cases)) + "|")
    for method in METHODS:
        for kind in KINDS:
            cells = [_cheapest_cell(m.rows, method, kind) for m in cases]
            if any(c not in ("-", _MISSED) for c in cells):
                lines.append(f"| {method} | {kind} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _cheapest_cell(rows: Iterable[Row], method: str, kind: str) -> str:
    mine = [r for r in rows if r.method == method and kind_of(r) == kind]
    fit = [r for r in mine if good(r)]
    if not fit:
        return _MISSED if mine else "-"
    best = min(fit, key=lambda r: r.call[1])
    error = percent(best.force_error)
    which = best.leafs.removeprefix("strain ").removeprefix("modal, ")
    which = which.replace(" elements", "").replace(" element", "")
    return f"{best.call[1]:.0f} ({which}; {error})"


def best_times(m: Measured, leafs: str) -> dict[str, float]:
    """Whole calls [us] by method; "conventional" is the better of its two ways to choose steps."""
    found = {r.method: r.call[1] for r in m.rows if r.leafs == leafs and not r.failed}
    if "conventional" in found:
        found["conventional"] = min(found["conventional"], found.get("MIP, best eps_max", math.inf))
    return found


def ratios(results: Sequence[Measured], elements: int = 5) -> str:
    """Markdown: how many times as fast the five steps are on Appendix A elements, whole calls, like beside like."""
    leafs = f"{elements} element{'s' * (elements > 1)}"
    times = [best_times(m, leafs) for m in results]
    shown = [(m.case, t) for m, t in zip(results, times, strict=True) if len(t) > 1]
    lines = ["| times as fast | " + " | ".join(case for case, _ in shown) + " |"]
    lines.append("|---" + "|---:" * len(shown) + "|")
    for name, way, base in _COMPARED:
        cells = [f"{t[base] / t[way]:.3g}" if base in t and way in t else "-" for _, t in shown]
        if any(c != "-" for c in cells):
            lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


_COMPARED = (
    ("full / plain Newton", "full", "plain Newton"),
    ("reduced / plain Newton", "reduced", "plain Newton"),
    ("full / MIP on all nodes", "full", "MIP on all nodes"),
    ("reduced / MIP on all nodes", "reduced", "MIP on all nodes"),
    ("full / MIP, in space", "full", "conventional"),
    ("reduced / MIP, in space", "reduced", "conventional"),
    ("planar full / plain Newton", "full, planar", "plain Newton"),
    ("planar reduced / plain Newton", "reduced, planar", "plain Newton"),
    ("full / MIP, in the plane", "full, planar", "conventional, planar"),
    ("reduced / MIP, in the plane", "reduced, planar", "conventional, planar"),
    ("planar full / MIP in space", "full, planar", "conventional"),
    ("planar reduced / MIP in space", "reduced, planar", "conventional"),
)
"""What is compared: heading, the fast way, the base it is held against."""


_SHOWN = ("fourbar", "three-joint arm")
"""Scenes of the tables in the README; all are printed."""


def readme_text(results: Sequence[Measured]) -> str:
    """What stands between BEGIN and END of a README: the comparison at equal accuracy, and the ratios."""
    m = machine()
    shown = [r for r in results if r.case.startswith(_SHOWN)] or results
    return "\n".join(
        [
            f"Cheapest setting of every method within 0.1 % of the drive force and 1 % of the support stiffness: thread "
            f"time of a whole call [µs] (orders, or elements per leaf; force error). {m['date']}, one thread of "
            f"{m['processor']}; load average {m['load_average']}; `ksd bench --readme README.md` renews it. Methods and "
            "leafs that reach it nowhere, with up to 8 elements, are left out; `ksd bench` prints every scene.",
            "",
            equal_accuracy(shown),
            "",
            "Times as fast, 5 Appendix A elements per leaf, whole calls, warm (plain Newton and MIP on all "
            "nodes: the papers' program, on all element nodes, in space, best eps_max; MIP: the best conventional we know, "
            "on condensed leafs, the better of our steps and the best eps_max):",
            "",
            ratios(shown),
            "",
            "What was asked, in thread time of whole calls; a pass is one condensation of all leafs with its way into the "
            "matrix:",
            "",
            asked.table(results),
            "",
            "Other engines, given the planar model of the same scene:",
            "",
            *(f"- {m.case}: {line}" for m in results for line in engine_lines(m)),
        ]
    )


def renew(path: str, results: Sequence[Measured]) -> None:
    """Replace what stands between the marks of the file `path`. Raises SceneError without them."""
    file = Path(path)
    try:
        text = file.read_text(encoding="utf-8")
    except OSError as error:
        raise SceneError(f"--readme {path}: {error.strerror}; name a text file") from None
    if text.count(BEGIN) != 1 or text.count(END) != 1 or text.index(BEGIN) > text.index(END):
        raise SceneError(
            f"--readme {path}: the lines '{BEGIN}' and '{END}' are needed, once each, in this order"
        )
    head, rest = text.split(BEGIN)
    file.write_text(f"{head}{BEGIN}\n{readme_text(results)}\n{END}{rest.split(END)[1]}", encoding="utf-8")
