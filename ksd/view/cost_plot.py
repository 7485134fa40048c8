"""Time against error of several methods."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ksd.view.figure import LINE_COLORS, TEXT_COLOR, label_axes
from ksd.view.labels import separate_labels

SAME_ERROR_RATIO, NEAR_TIME_RATIO = 10**0.15, 1.5
"""Ratios of errors and of times up to which marks share a label."""
_STYLE = tuple(zip(LINE_COLORS, "os^", strict=False))


class Mark(NamedTuple):
    """One method: its name, the group it belongs to, time [s], relative error."""

    name: str
    group: str
    time: float
    error: float


def plot_cost(axes: Any, marks: Sequence[Mark], *, title: str = "") -> None:
    """Draw time [us] against error [%], both on log axes, with the names beside the marks."""
    for group, (color, symbol) in zip(dict.fromkeys(m.group for m in marks), _STYLE, strict=False):
        mine = [m for m in marks if m.group == group]
        label = f"{group} per leaf" if "element" in group else f"{group} leaf springs"
        style = {"color": color, "marker": symbol, "markersize": 7, "markeredgecolor": "white"}
        x, y = [1e6 * m.time for m in mine], [100 * m.error for m in mine]
        axes.plot(x, y, linestyle="none", label=label, zorder=3, **style)
        for row in shared_label_rows(mine):
            place, text = (1e6 * row[-1].time, 100 * row[-1].error), "; ".join(m.name for m in row)
            axes.annotate(
                text, place, (9, 0), textcoords="offset points", fontsize=8, color=TEXT_COLOR, va="center"
            )
    _scale_axes(axes, marks)
    time, error = "thread time of a solve [\N{MICRO SIGN}s]", "error of force and displacement [%]"
    label_axes(axes, title, x=time, y=error)
    axes.legend(fontsize=8, frameon=False, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=3)
    separate_labels(axes, np.array([(1e6 * m.time, 100 * m.error) for m in marks]), np.zeros((0, 2)))


def shared_label_rows(marks: Sequence[Any]) -> list[list[Any]]:
    """Groups of marks with equal `error` and similar `time`, fastest first; each shares a label."""
    rows: list[list[Any]] = []
    for m in sorted(marks, key=lambda m: float(m.time)):
        near = (
            r for r in rows
            if max(r[-1].error, m.error) < SAME_ERROR_RATIO * min(r[-1].error, m.error)
            and m.time < NEAR_TIME_RATIO * r[-1].time
        )  # fmt: skip
        row = next(near, None)
        if row is None:
            rows.append([m])
        else:
            row.append(m)
    return rows


def _scale_axes(axes: Any, marks: Sequence[Mark]) -> None:
    """Log axes with plain numbers, and room for the names."""
    times, errors = (np.array([getattr(m, key) for m in marks]) for key in ("time", "error"))
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlim(0.25e6 * times.min(), 9.0e6 * times.max())
    axes.set_ylim(30 * errors.min(), 500 * errors.max())
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter("{x:g}")
