"""Picture of error over time: the Pareto front of all methods in black, a few methods by name, the others as faint dots."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from bench_measure import pareto_indices

from ksd.view.cost_plot import shared_label_rows
from ksd.view.figure import (
    GROUND_COLOR,
    LABEL_BACKGROUND,
    LEAF_COLOR,
    LINE_COLORS,
    TEXT_COLOR,
    UNDEFORMED_COLOR,
    label_axes,
)
from ksd.view.labels import separate_labels

NAMED_METHODS = {
    "kinematic": LINE_COLORS[4],
    "reduced": LINE_COLORS[2],
    "reduced, 1 step": LINE_COLORS[1],
    "full": LEAF_COLOR,
    "conventional": LINE_COLORS[3],
    "plain Newton": GROUND_COLOR,
}
"""Methods that are named in the picture with strain-mode leaf springs, and their colours."""
CHAINS = ("conventional", "plain Newton")
"""Methods whose row of element meshes is drawn."""
LABELS = {"reduced, 1 step": "reduced, one step", "plain Newton": "plain Newton, as the paper's baseline"}
MIN_ERROR = 1e-6
"""Errors [%] below this are those of the reference, and are drawn at this value."""


class Mark(NamedTuple):
    """A method with strain-mode leaf springs (elements 0) or elements per leaf: time [us], error [%]."""

    method: str
    elements: int
    time: float
    error: float


def merge_planar(marks: Iterable[Mark]) -> list[Mark]:
    """Marks in which a method in the plane and in space has one name, the faster one at each mesh."""
    best: dict[tuple[str, int], Mark] = {}
    for mark in marks:
        mark = mark._replace(method=mark.method.replace(", planar", ""), error=max(mark.error, MIN_ERROR))
        key = mark.method, mark.elements
        if key not in best or mark.time < best[key].time:
            best[key] = mark
    return list(best.values())


class Panel(NamedTuple):
    """Axes, the marks drawn in them, title and axis labels."""

    axes: Any
    marks: Sequence[Mark]
    title: str
    time: str
    error: str


def draw_fronts(panels: Sequence[Panel]) -> None:
    """Error over time, both logarithmic, of every method on the scene of each panel."""
    parted = []
    for panel in panels:
        parted.append(_draw(panel.axes, panel.marks))
        time, error = f"{panel.time} [\N{MICRO SIGN}s]", f"error of the {panel.error} [%]"
        label_axes(panel.axes, panel.title, x=time, y=error)
    # all words have their place before the labels look for one
    for panel, (busy, rest) in zip(panels, parted, strict=True):
        separate_labels(panel.axes, busy, rest)


def _draw(axes: Any, every: Iterable[Mark]) -> tuple[Any, Any]:
    """One panel; returns points (n, 2) of named marks and along its lines, and of the others."""
    marks = merge_planar(every)
    rest = [m for m in marks if m.method not in NAMED_METHODS or (m.elements and m.method not in CHAINS)]
    axes.plot(
        [m.time for m in rest], [m.error for m in rest], ".", color=UNDEFORMED_COLOR, markersize=4, zorder=1
    )
    lines = []
    for method in CHAINS:
        row = sorted((m for m in marks if m.method == method and m.elements), key=lambda m: m.elements)
        look = {"color": NAMED_METHODS[method], "markersize": 3.5, "linewidth": 0.8, "zorder": 2}
        axes.plot([m.time for m in row], [m.error for m in row], "s-", **look)
        lines.append([(m.time, m.error) for m in row])
    best = [(marks[n].time, marks[n].error) for n in pareto_indices((m.time, m.error) for m in marks)]
    low, high = 0.5 * min(m.time for m in marks), 2.2 * max(m.time for m in marks)
    steps = [(best[0][0], 10.0 * max(m.error for m in marks)), *best]
    axes.step(
        *zip(*steps, strict=True), where="post", color=TEXT_COLOR, linewidth=1.3, zorder=1.5, gid="front"
    )
    strain = [m for m in marks if m.method in NAMED_METHODS and not m.elements]
    for m in strain:
        look = {"color": NAMED_METHODS[m.method], "markersize": 7, "markeredgecolor": "white", "zorder": 4}
        axes.plot(m.time, m.error, "o", **look)
    axes.set_xlim(low, high)
    axes.set_ylim(0.15 * min(m.error for m in marks), 6.0 * max(m.error for m in marks))
    for row in shared_label_rows(strain):
        said = "; ".join(LABELS.get(m.method, m.method) for m in row)
        _annotate(axes, said, row[-1], TEXT_COLOR, (9, 0), side="left")
    for method in CHAINS:
        if row := [m for m in marks if m.method == method and m.elements]:
            ends = (" and " if len(row) == 2 else " to ").join(
                f"{pick(m.elements for m in row)}" for pick in (min, max)
            )
            slow = max(row, key=lambda m: m.time)
            said = f"{method}, {ends}\nelements per leaf"
            _annotate(axes, said, slow, NAMED_METHODS[method], (0, -14), side="right")
    plain_scales(axes)
    lines.append([point for a, b in pairwise(steps) for point in (a, (b[0], a[1]), b)])
    named = [(m.time, m.error) for m in marks if m not in rest]
    busy = np.concatenate([named, *(_along(line) for line in lines if line)])
    return busy, np.array([(m.time, m.error) for m in rest])


def _along(line: Sequence[tuple[float, float]]) -> np.ndarray:
    """Points (n, 2) along a line that is straight in the logarithms."""
    corners = np.log(line)
    along = np.linspace(0, len(corners) - 1, 20 * len(corners))
    return np.exp(np.stack([np.interp(along, np.arange(len(corners)), c) for c in corners.T], axis=1))


def _annotate(axes: Any, words: str, m: Mark, color: str, shift: tuple[float, float], *, side: str) -> None:
    axes.annotate(
        words, (m.time, m.error), shift, textcoords="offset points", fontsize=8, color=color, ha=side, va="center", zorder=5,
        bbox=LABEL_BACKGROUND, in_layout=False,
    )  # fmt: skip


def plain_scales(axes: Any) -> None:
    """Logarithmic axes with plain numbers that do not run into each other."""
    from matplotlib.ticker import LogLocator, NullFormatter, NullLocator

    axes.set_xscale("log")
    axes.set_yscale("log")
    low, high = axes.get_xlim()
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high < 200 * low else (1.0,)))
    low, high = axes.get_ylim()
    axes.yaxis.set_major_locator(LogLocator(base=10.0 if high < 1e7 * low else 100.0))
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
        axis.set_minor_formatter(NullFormatter())
        axis.set_minor_locator(NullLocator())
