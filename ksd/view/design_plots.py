"""A Pareto front, and designs as parallel coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ksd.view.figure import (
    FAINT_COLOR,
    LEAF_COLOR,
    TEXT_COLOR,
    Array,
    color_map,
    label_axes,
    new_figure,
    parameter_with_unit,
    write_title,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_STRAIGHT_LABEL = 9
"""Longest name [letters] written straight below its axis; longer ones are slanted."""


def plot_front(front: Any) -> Figure:
    """Matplotlib figure of a `ksd.optimisation.pareto.Front`."""
    figure = new_figure(8.4, 3.6)
    left, right = figure.subplots(1, 2)
    good = np.isfinite(front.merits)
    job = front.job
    left.plot(front.limits[good], job.merit_sign * front.merits[good], "o-", color=LEAF_COLOR, markersize=4)
    label_axes(left, job.merit_name, x=f"most {front.against}")
    draw_designs(right, job.parameters, job.bounds, front.designs[good], front.merits[good])
    write_title(right, "designs, the best dark")
    return figure


def draw_designs(
    axes: Any,
    names: Sequence[str],
    bounds: Array,
    designs: Array,
    merits: Array,
    *,
    best: Array | None = None,
) -> None:
    """Designs (n, P) as lines across one axis per parameter, from its lower to its upper bound; better designs are
    darker. best (P,): drawn thick."""
    share = (designs - bounds[:, 0]) / np.diff(bounds)[:, 0]
    span = np.ptp(merits) if len(merits) else 0.0
    # a single line, or lines of equal merit, are as dark as the best
    shades = (merits - merits.min()) / span if span > 0.0 else np.ones(len(merits))
    for k in np.argsort(merits):
        axes.plot(range(len(names)), share[k], color=color_map()(shades[k]), linewidth=1.2)
    if best is not None:
        thick = (best - bounds[:, 0]) / np.diff(bounds)[:, 0]
        axes.plot(range(len(names)), thick, color=TEXT_COLOR, linewidth=2.4, gid="best")
    for k, (name, (low, high)) in enumerate(zip(names, bounds.tolist(), strict=True)):
        axes.axvline(k, color=FAINT_COLOR, linewidth=0.8, zorder=1)
        ends = ((low, -0.03, "top"), (high, 1.03, "bottom"))
        for value, place, side in ends:
            text = parameter_with_unit(name, value, most=high, digits=3)
            words = axes.annotate(text, (k, place), ha="center", va=side, color=TEXT_COLOR, fontsize=7)
            words.set_bbox({"color": "white", "pad": 1.0})
    slanted = max(map(len, names)) > MAX_STRAIGHT_LABEL and len(names) > 2
    axes.set_xticks(
        range(len(names)), names, fontsize=8, **({"rotation": 20, "ha": "right"} if slanted else {})
    )
    axes.set_yticks([])
    axes.set_ylim(-0.12, 1.12)
    axes.set_xlim(-0.35, len(names) - 0.65)
    axes.spines[:].set_visible(False)
    axes.tick_params(axis="x", length=0)
