"""A Pareto front, and its designs as parallel coordinates."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ksd.view.figure import FAINT, INK, LEAF, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_front(front: Any) -> Figure:
    """Matplotlib figure of a `ksd.design.pareto.Front`."""
    figure = new_figure(10.0, 4.0)
    left, right = figure.subplots(1, 2)
    good = np.isfinite(front.merits)
    left.plot(front.limits[good], front.merits[good], "o-", color=LEAF, markersize=4)
    left.set_xlabel(f"most {front.against}")
    left.set_ylabel("worst target over its scale")
    names, bounds = front.job.parameters, front.job.bounds
    share = (front.designs - bounds[:, 0]) / np.diff(bounds)[:, 0]
    for place, merit in zip(share[good], front.merits[good], strict=True):
        shade = (merit - front.merits[good].min()) / (np.ptp(front.merits[good]) or 1.0)
        right.plot(range(len(names)), place, color=LEAF, alpha=0.2 + 0.8 * shade)
    for k, (low, high) in enumerate(bounds.tolist()):
        right.axvline(k, color=FAINT, linewidth=0.8)
        right.annotate(f"{low:.3g}", (k, -0.03), ha="center", va="top", color=INK, fontsize=7)
        right.annotate(f"{high:.3g}", (k, 1.03), ha="center", va="bottom", color=INK, fontsize=7)
    right.set_xticks(range(len(names)), names)
    right.set_yticks([])
    right.set_ylim(-0.12, 1.12)
    right.set_title("designs, the best dark")
    return figure
