"""Markdown tables of the benchmark: times at equal accuracy, time ratios, and requirements, met or missed and why."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

from bench_engines import EngineRow
from bench_measure import CaseResult, Measurement, is_accurate

from ksd.cli.bench import machine_facts
from ksd.solvers.steps import percent


@dataclass(frozen=True)
class ExtendedCase(CaseResult):
    """A case with the results of other engines and, by leaf model, operations and bytes of an evaluation of all leaves."""

    engines: tuple[EngineRow, ...] = ()
    floors: Mapping[str, str] = field(default_factory=dict)


METHODS = (
    "kinematic", "reduced", "reduced, 1 step", "reduced, 2 steps", "full", "conventional", "conventional, planar", "modal",
    "MIP, best eps_max", "MIP on all nodes", "plain Newton",
)  # fmt: skip
KINDS = ("strain-mode", "Appendix A", "modal")
_MISSED = "not reached"


def leaf_kind(row: Measurement) -> str:
    """Kind of leaf model of a measurement."""
    return {"strain": "strain-mode", "modal": "modal"}.get(row.leaves.split(",")[0].split()[0], "Appendix A")


def equal_accuracy(results: Sequence[ExtendedCase]) -> str:
    """Markdown: the cheapest setting of every method within GOOD, in us of a whole call, and its error in force.

    Appendix A elements and strain-mode leaves apart; with the ratios of the papers' comparison below.
    """
    cases = [m for m in results if any(is_accurate(r) for r in m.rows)]
    lines = ["| method | leaf springs | " + " | ".join(m.case for m in cases) + " |"]
    lines.append("|---" * (2 + len(cases)) + "|")
    for method in METHODS:
        for kind in KINDS:
            cells = [_fastest_cell(m.rows, method, kind) for m in cases]
            if any(c not in ("-", _MISSED) for c in cells):
                lines.append(f"| {method} | {kind} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def _fastest_cell(rows: Iterable[Measurement], method: str, kind: str) -> str:
    mine = [r for r in rows if r.method == method and leaf_kind(r) == kind]
    fit = [r for r in mine if is_accurate(r)]
    if not fit:
        return _MISSED if mine else "-"
    best = min(fit, key=lambda r: r.call[1])
    error = f"{percent(best.force_error)} %"
    which = best.leaves.removeprefix("strain ").removeprefix("modal, ")
    which = which.replace(" elements", "").replace(" element", "")
    return f"{best.call[1]:.0f} ({which}; {error})"


def call_times(m: CaseResult, leaves: str) -> dict[str, float]:
    """Whole calls [us] by method; "conventional" is the better of its two ways to choose steps."""
    found = {r.method: r.call[1] for r in m.rows if r.leaves == leaves and not r.failed}
    if "conventional" in found:
        found["conventional"] = min(found["conventional"], found.get("MIP, best eps_max", math.inf))
    return found


def ratio_table(results: Sequence[ExtendedCase]) -> str:
    """Markdown: time ratios of conventional methods to the five steps on equal Appendix A elements, whole calls."""
    leaves = f"{COMPARED_ELEMENTS} elements"
    times = [call_times(m, leaves) for m in results]
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
    ("conventional in the plane / plain Newton", "conventional, planar", "plain Newton"),
)
"""Compared methods: heading, fast method, method it is compared with."""


COMPARED_ELEMENTS = 5
"""Appendix A elements per leaf of the papers' comparison."""


@dataclass(frozen=True)
class Ratio:
    """Asked: `way` at least `times` as fast as `base`, whole calls in space on EQUAL elements, in the case of that name.

    base "conventional": MIP on condensed leaf springs, the better of our steps and the best eps_max.
    """

    case: str
    way: str
    base: str
    times: float


@dataclass(frozen=True)
class Bound:
    """Asked: `method` below `us` in the case that holds `case`; leaves: one leaf model, or "good", the cheapest setting of
    strain-mode leaves within the accuracy compared at, or "chain", the same of Appendix A elements."""

    case: str
    method: str
    leaves: str
    us: float


_ARMS = (("arm by joints", (80, 600, 40, 300)), ("arm by location", (65, 600, 20, 200)))
RATIOS = tuple(
    Ratio(case, way, base, times)
    for case, four in (("fourbar, reading 1", (10, 60, 1.8, 10)), *_ARMS)
    for (way, base), times in zip(
        (
            ("full", "plain Newton"),
            ("reduced", "plain Newton"),
            ("full", "MIP on all nodes"),
            ("reduced", "MIP on all nodes"),
            ("full", "conventional"),
            ("reduced", "conventional"),
        ),
        (*four, *four[2:]),
        strict=True,
    )
)
BOUNDS = (
    *(
        Bound(f"fourbar, reading {r}", method, leaves, us)
        for r in (1, 2)
        for method, us in (("full", 1000), ("conventional", 3000))
        for leaves in ("strain 4,3,6", "4 elements")
    ),
    Bound("fourbar, reading 2", "conventional", "good", 700),
    Bound("fourbar, reading 2", "full", "good", 300),
    Bound("fourbar, reading 2", "reduced, 1 step", "good", 100),
    Bound("fourbar, reading 2", "conventional, planar", "good", 130),
)


def requirement_table(results: Sequence[ExtendedCase]) -> str:
    """Markdown: all requirements that were measured, with the verdict."""
    lines = ["| case | asked | found | verdict |", "|---|---|---:|---|"]
    lines += [line for m in results for line in (*_ratios(m), *_bounds(m))]
    return "\n".join(lines) if len(lines) > 2 else ""


def _ratios(m: ExtendedCase) -> list[str]:
    leaves, found = f"{COMPARED_ELEMENTS} elements", []
    rows = {r.method: r for r in m.rows if r.leaves == leaves and not r.failed}
    for asked in RATIOS:
        if asked.case not in m.case or asked.way not in rows or asked.base not in rows:
            continue
        fast, slow = rows[asked.way], rows[asked.base]
        other = rows.get("MIP, best eps_max")
        if asked.base == "conventional" and other is not None and other.call[1] < slow.call[1]:
            slow = other
        times = slow.call[1] / fast.call[1]
        name = {"conventional": "MIP on condensed leaf springs"}.get(asked.base, asked.base)
        said = "met" if times >= asked.times else f"missed: {_why_ratio_missed(m, fast, slow, times)}"
        found.append(f"| {m.case} | {asked.way} / {name} >= {asked.times:g} | {times:.3g} | {said} |")
    return found


def _why_ratio_missed(m: ExtendedCase, fast: Measurement, slow: Measurement, times: float) -> str:
    """Why a required time ratio is missed."""
    most = slow.passes / max(fast.passes, 1)
    words = [
        f"{slow.method} makes {slow.passes} passes over the leaf springs, {fast.method} {fast.passes}, so at equal cost of "
        f"a pass {most:.3g} would be the most"
        + (f" (a pass of {slow.method} costs more)" if times > most else "")
    ]
    around = fast.call[1] - fast.steps[1]
    words.append(f"compiled steps {fast.steps[1]:.0f} us, Python around them {around:.0f} us")
    floor = m.floors.get(fast.leaves)
    if floor:
        words.append(f"one pass is {floor}")
    return "; ".join(words)


def _bounds(m: ExtendedCase) -> list[str]:
    found = []
    for asked in BOUNDS:
        rows = [r for r in m.rows if r.method == asked.method and not r.failed]
        if asked.leaves == "good":
            rows = [r for r in rows if r.leaves.startswith("strain") and is_accurate(r)]
        else:
            rows = [r for r in rows if r.leaves == asked.leaves]
        if asked.case not in m.case or not rows:
            continue
        best = min(rows, key=lambda r: r.call[1])
        said = "met" if best.call[1] <= asked.us else f"missed: {_why_time_missed(m, best)}"
        leaves = f"{best.leaves}, within 0.1 % and 1 %" if asked.leaves == "good" else best.leaves
        found.append(
            f"| {m.case} | {asked.method}, {leaves} <= {asked.us:g} us | {best.call[1]:.0f} us | {said} |"
        )
    return found


def _why_time_missed(m: ExtendedCase, row: Measurement) -> str:
    """Why a required time is missed."""
    around = row.call[1] - row.steps[1]
    words = f"compiled steps {row.steps[1]:.0f} us, Python around them {around:.0f} us"
    floor = m.floors.get(row.leaves)
    return f"{words}; {row.passes} passes over the leaf springs, each {floor}" if floor else words


def engine_sentences(measured: ExtendedCase) -> list[str]:
    """Results of other engines, one sentence each."""
    found = []
    for r in measured.engines:
        said = r.said or (
            f"{r.us:.0f} us of analysis in the plane with {r.elements} elements per leaf, {r.iterations} iterations, force "
            f"error {percent(r.force_error)} %"
        )
        found.append(f"{r.engine}: {said}.")
    return found


_SHOWN = ("fourbar", "three-joint arm")
"""Scenes of the tables side by side; all are printed."""


def benchmark_page(results: Sequence[ExtendedCase]) -> str:
    """The text of bench.md: the comparison at equal accuracy, the ratios, the requirements, other engines."""
    m = machine_facts()
    shown = [r for r in results if r.case.startswith(_SHOWN)] or results
    return "\n".join(
        [
            "# Methods at equal accuracy",
            "",
            f"Cheapest setting of every method within 0.1 % of the drive force and 1 % of the support stiffness: thread "
            f"time of a whole call [µs] (orders, or elements per leaf; force error). {m['date']}, one thread of "
            f"{m['processor']}; load average {m['load_average']}; `python benchmarks/bench.py` renews it. Methods and "
            "leaf springs that reach it nowhere, with up to 8 elements, are left out; `bench.json` has every scene.",
            "",
            equal_accuracy(shown),
            "",
            "Times as fast, 5 Appendix A elements per leaf, whole calls, warm (plain Newton and MIP on all "
            "nodes: the papers' program, on all element nodes, in space, best eps_max; MIP: the best conventional we know, "
            "on condensed leaf springs, the better of our steps and the best eps_max):",
            "",
            ratio_table(shown),
            "",
            "What was asked, in thread time of whole calls; a pass is one condensation of all leaves with its way into the "
            "matrix:",
            "",
            requirement_table(results),
            "",
            "Other engines, given the planar model of the same scene:",
            "",
            *(f"- {m.case}: {line}" for m in results for line in engine_sentences(m)),
            "",
        ]
    )
