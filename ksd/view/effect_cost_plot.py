"""Bars of what every effect of a scene changes, and what it costs in time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ksd.view.figure import LABEL_BACKGROUND, LEAF_COLOR, TEXT_COLOR, UNDEFORMED_COLOR, label_axes

SIMULATED_COLOR, LEFT_OUT_COLOR = LEAF_COLOR, UNDEFORMED_COLOR


def plot_effect_cost(
    axes: tuple[Any, Any],
    names: Sequence[str],
    changes: Sequence[float],
    costs: Sequence[float],
    *,
    kept: Sequence[bool],
    reasons: Sequence[str],
    accuracy: float,
) -> None:
    """Bars from top to bottom: `changes` (largest relative change of a quantity, log) and `costs` (time, relative), under
    each what is simulated or left out, and why."""
    left, right = axes
    y = np.arange(len(names))[::-1]
    colors = [SIMULATED_COLOR if k else LEFT_OUT_COLOR for k in kept]
    floor = 1e-6
    shown = [100 * max(abs(c), floor) for c in changes]
    left.barh(y, shown, color=colors, height=0.5)
    left.set_xscale("log")
    left.set_xlim(100 * floor, max(1e3 * floor, 4 * max(shown, default=1.0)))
    left.axvline(100 * accuracy, color=TEXT_COLOR, linewidth=0.9, linestyle=(0, (4, 3)))
    right.barh(y, [100 * c for c in costs], color=colors, height=0.5)
    right.axvline(0.0, color=TEXT_COLOR, linewidth=0.9)
    for row, name, one, why in zip(y, names, kept, reasons, strict=True):
        text = f"{name}, {'simulated' if one else 'left out'}: {why}"
        left.annotate(
            text, (0.0, row + 0.34), (2, 1), xycoords=("axes fraction", "data"), textcoords="offset points", fontsize=8,
            color=TEXT_COLOR, va="bottom", annotation_clip=False, bbox=LABEL_BACKGROUND,
        )  # fmt: skip
    left.set_yticks(y, [""] * len(y))
    right.set_yticks(y, [""] * len(y))
    title = "What an effect changes (orange: simulated, grey: left out)"
    change = "largest change of a quantity asked for [%] (dashed: accuracy asked for)"
    label_axes(left, title, x=change, grid="x")
    label_axes(right, "What it costs", x="change of solve time [%]", grid="x")
    for one in axes:
        one.set_ylim(-0.5, len(names) + 0.05)
        one.xaxis.set_major_formatter("{x:g}")
        one.tick_params(axis="y", length=0)
