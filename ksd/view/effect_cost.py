"""Bars of what every effect of a scene changes, and what it costs in time."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ksd.view.figure import INK

KEPT, LEFT = "#c2410c", "#b8c0cc"


def plot_effect_cost(
    axes: tuple[Any, Any],
    names: Sequence[str],
    changes: Sequence[float],
    costs: Sequence[float],
    *,
    kept: Sequence[bool],
    accuracy: float,
) -> None:
    """Bars from top to bottom: `changes` (largest relative change of a quantity, log) and `costs` (time, relative)."""
    left, right = axes
    y = np.arange(len(names))[::-1]
    colors = [KEPT if k else LEFT for k in kept]
    floor = 1e-6
    shown = [100 * max(abs(c), floor) for c in changes]
    left.barh(y, shown, color=colors, height=0.62)
    left.set_xscale("log")
    left.set_xlim(100 * floor, max(1e3 * floor, 4 * max(shown, default=1.0)))
    left.axvline(100 * accuracy, color=INK, linewidth=0.9, linestyle=(0, (4, 3)))
    left.text(100 * accuracy, len(names) - 0.42, " accuracy asked for", fontsize=8, color=INK, va="bottom")
    left.set_xlabel("largest change of a quantity asked for [%]")
    right.barh(y, [100 * c for c in costs], color=colors, height=0.62)
    right.axvline(0.0, color=INK, linewidth=0.9)
    right.set_xlabel("change of solve time [%]")
    left.set_yticks(y, names)
    right.set_yticks(y, [""] * len(y))
    for one in axes:
        one.set_ylim(-0.6, len(names) + 0.1)
        one.xaxis.set_major_formatter("{x:g}")
        one.grid(True, axis="x", color="#eceff4", linewidth=0.8)
        one.set_axisbelow(True)
        one.tick_params(axis="y", length=0)
        for side in ("top", "right"):
            one.spines[side].set_visible(False)
    left.set_title("orange: simulated, grey: left out", fontsize=9, color=INK, loc="left")
