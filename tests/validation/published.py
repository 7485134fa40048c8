"""Published and independent numbers, each beside the function that asks ksd for it.

One source: `test_published.py` holds ksd to every number, `docs/tables.py` prints them all. The numbers themselves stand in
the other files that begin with `published_`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import NamedTuple


class Number(NamedTuple):
    """One number: what it is, SI unit, value, where it comes from, relative tolerance, and ksd's own."""

    group: str
    what: str
    unit: str
    value: float
    source: str
    within: float
    ask: Callable[[], float]


def _pick(answer: Callable[[], Sequence[float]], place: int) -> float:
    return float(answer()[place])


def numbers(
    group: str,
    source: str,
    answer: Callable[[], Sequence[float]],
    *wanted: tuple[str, str, float, float],
) -> list[Number]:
    """Numbers of one computation: `answer` gives them in the order of `wanted` (what, unit, value, tolerance)."""
    once = cache(answer)
    return [
        Number(group, what, unit, value, source, within, partial(_pick, once, k))
        for k, (what, unit, value, within) in enumerate(wanted)
    ]
