"""What is asked of the benchmark, and what it found: met, or missed with the reason and the least a solve must do."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ksd.bench.measure import Measured, Row
from ksd.bench.report import good

EQUAL = 5
"""Appendix A elements per leaf of the papers' comparison."""


@dataclass(frozen=True)
class Ratio:
    """Asked: `way` at least `times` as fast as `base`, whole calls in space on EQUAL elements, in the case of that name.

    base "conventional": MIP on condensed leafs, the better of our steps and the best eps_max.
    """

    case: str
    way: str
    base: str
    times: float


@dataclass(frozen=True)
class Bound:
    """Asked: `method` below `us` in the case that holds `case`; leafs: one leaf model, or "good", the cheapest setting of
    strain-mode leafs within the accuracy compared at, or "chain", the same of Appendix A elements."""

    case: str
    method: str
    leafs: str
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
        Bound(f"fourbar, reading {r}", method, leafs, us)
        for r in (1, 2)
        for method, us in (("full", 1000), ("conventional", 3000))
        for leafs in ("strain 4,3,6", "4 elements")
    ),
    Bound("fourbar, reading 2", "conventional", "good", 700),
    Bound("fourbar, reading 2", "full", "good", 300),
    Bound("fourbar, reading 2", "reduced, 1 pass", "good", 100),
    Bound("fourbar, reading 2", "full, planar", "good", 300),
    Bound("fourbar, reading 2", "reduced, 1 pass, planar", "good", 100),
)


def table(results: Sequence[Measured]) -> str:
    """Markdown: everything asked that was measured, with the verdict."""
    lines = ["| case | asked | found | verdict |", "|---|---|---:|---|"]
    lines += [line for m in results for line in (*_ratios(m), *_bounds(m))]
    return "\n".join(lines) if len(lines) > 2 else ""


def _ratios(m: Measured) -> list[str]:
    leafs, found = f"{EQUAL} elements", []
    rows = {r.method: r for r in m.rows if r.leafs == leafs and not r.failed}
    for asked in RATIOS:
        if asked.case not in m.case or asked.way not in rows or asked.base not in rows:
            continue
        fast, slow = rows[asked.way], rows[asked.base]
        other = rows.get("MIP, best eps_max")
        if asked.base == "conventional" and other is not None and other.call[1] < slow.call[1]:
            slow = other
        times = slow.call[1] / fast.call[1]
        name = {"conventional": "MIP on condensed leafs"}.get(asked.base, asked.base)
        said = "met" if times >= asked.times else f"missed: {_slow(m, fast, slow, times)}"
        found.append(f"| {m.case} | {asked.way} / {name} >= {asked.times:g} | {times:.3g} | {said} |")
    return found


def _slow(m: Measured, fast: Row, slow: Row, times: float) -> str:
    """Why a ratio of so many times is missed."""
    most = slow.passes / max(fast.passes, 1)
    words = [
        f"{slow.method} makes {slow.passes} passes over the leafs, {fast.method} {fast.passes}, so at equal cost of a pass "
        f"{most:.3g} would be the most"
        + (" (that of step 2, four chains at a time, costs less)" if times > most else "")
    ]
    around = fast.call[1] - fast.steps[1]
    words.append(f"compiled steps {fast.steps[1]:.0f} us, Python around them {around:.0f} us")
    floor = m.floors.get(fast.leafs)
    if floor:
        words.append(f"one pass is {floor}")
    return "; ".join(words)


def _bounds(m: Measured) -> list[str]:
    found = []
    for asked in BOUNDS:
        rows = [r for r in m.rows if r.method == asked.method and not r.failed]
        if asked.leafs == "good":
            rows = [r for r in rows if r.leafs.startswith("strain") and good(r)]
        else:
            rows = [r for r in rows if r.leafs == asked.leafs]
        if asked.case not in m.case or not rows:
            continue
        best = min(rows, key=lambda r: r.call[1])
        said = "met" if best.call[1] <= asked.us else f"missed: {_long(m, best)}"
        leafs = f"{best.leafs}, within 0.1 % and 1 %" if asked.leafs == "good" else best.leafs
        found.append(
            f"| {m.case} | {asked.method}, {leafs} <= {asked.us:g} us | {best.call[1]:.0f} us | {said} |"
        )
    return found


def _long(m: Measured, row: Row) -> str:
    """Why a time is missed."""
    around = row.call[1] - row.steps[1]
    words = f"compiled steps {row.steps[1]:.0f} us, Python around them {around:.0f} us"
    floor = m.floors.get(row.leafs)
    return f"{words}; {row.passes} passes over the leafs, each {floor}" if floor else words
