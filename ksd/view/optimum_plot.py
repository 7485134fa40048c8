"""How an optimum was found: targets and limits of every design that was tried, start by start, and designs as lines."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ksd.view.design_plots import draw_designs
from ksd.view.figure import LEAF_COLOR, LINK_COLORS, label_axes, new_figure, write_title

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_KEY_STARTS = 8
"""Largest number of starts that are named in a key."""
MAX_DRAWN_DESIGNS = 60
"""Largest number of designs of a start drawn one by one; of more, the best so far is drawn."""
LIMIT_TOLERANCE = 1e-9
"""Relative excess of a limit up to which it counts as met."""


def plot_optimum(optimum: Any) -> Figure:
    """Matplotlib figure of a `ksd.optimisation.optimum.Optimum`: convergence on the left, designs on the right."""
    from matplotlib.ticker import MaxNLocator

    figure = new_figure(8.4, 4.4)
    grid = figure.add_gridspec(2, 2, height_ratios=(2, 1))
    top = figure.add_subplot(grid[0, 0])
    low, right = figure.add_subplot(grid[1, 0], sharex=top), figure.add_subplot(grid[:, 1])
    tried, job = optimum.tried, optimum.job
    by = np.array(tried.by)
    names = tried.searches
    for k, name in enumerate(names):
        own = by == name
        color = LINK_COLORS[k % len(LINK_COLORS)]
        _draw_start(top, low, tried.merits[own], tried.exceeded[own], color, name, job.merit_sign)
    top.axhline(job.merit_sign * optimum.merit, color=LEAF_COLOR, linewidth=0.8, zorder=0)
    label_axes(top, f"{job.merit_name},\n{job.merit_sign * optimum.merit:.6g} at the optimum")
    top.tick_params(labelbottom=False)
    if len(names) <= MAX_KEY_STARTS:
        top.legend(fontsize=8, frameon=False)
    label_axes(low, "limit exceeded most [%]", x="designs of a start")
    low.set_yscale("symlog", linthresh=1e-3)
    low.set_ylim(bottom=0)
    # designs are counted by whole numbers
    low.xaxis.set_major_locator(MaxNLocator(integer=True))
    met = tried.met if tried.met.any() else np.ones_like(tried.met)
    best = np.array(list(optimum.design.values()))
    draw_designs(right, job.parameters, job.bounds, tried.designs[met], tried.merits[met], best=best)
    write_title(right, "designs within the limits, the better the darker;\nthe optimum thick")
    return figure


def _draw_start(
    top: Any, low: Any, merits: np.ndarray, exceeded: np.ndarray, color: str, name: str, sign: float
) -> None:
    """Draw the designs of a start in their order, filled where limits are met; of many, the best so far that meets them."""
    count, met = np.arange(1, len(merits) + 1), exceeded <= LIMIT_TOLERANCE
    style = {"color": color, "linewidth": 1.0}
    if len(merits) > MAX_DRAWN_DESIGNS:
        best = np.maximum.accumulate(np.where(met, merits, -np.inf))
        known = np.isfinite(best)
        top.step(count[known], sign * best[known], where="post", label=name, **style)
        low.plot(count, 100 * np.minimum.accumulate(exceeded), **style)
        return
    merits = sign * merits
    top.plot(count, merits, "-", label=name, **style)
    top.plot(count[met], merits[met], "o", color=color, markersize=4)
    top.plot(count[~met], merits[~met], "o", color=color, markersize=4, markerfacecolor="white")
    low.plot(count, 100 * exceeded, "-o", markersize=3, **style)
