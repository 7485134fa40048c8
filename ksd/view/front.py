"""A Pareto front, and designs as parallel coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ksd.view.figure import FAINT, INK, LEAF, Array, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

LONG = 9
"""Letters of a name that fit below its axis; longer ones are slanted."""


def plot_front(front: Any) -> Figure:
    """Matplotlib figure of a `ksd.design.pareto.Front`."""
    figure = new_figure(10.0, 4.0)
    left, right = figure.subplots(1, 2)
    good = np.isfinite(front.merits)
    left.plot(front.limits[good], front.merits[good], "o-", color=LEAF, markersize=4)
    left.set_xlabel(f"most {front.against}")
    job = front.job
    left.set_ylabel(job.merit_name)
    draw_designs(right, job.parameters, job.bounds, front.designs[good], front.merits[good])
    right.set_title("designs, the best dark")
    return figure


def draw_designs(
    axes: Any, names: Sequence[str], bounds: Array, designs: Array, merits: Array, *, color: str = LEAF
) -> None:
    """Designs (n, P) as lines across an axis per parameter, from its least to its most; the better the darker."""
    share = (designs - bounds[:, 0]) / np.diff(bounds)[:, 0]
    span = np.ptp(merits) if len(merits) else 0.0
    for k in np.argsort(merits):
        # a line alone, or one as good as all others, is the best
        shade = (merits[k] - merits.min()) / span if span > 0.0 else 1.0
        axes.plot(range(len(names)), share[k], color=color, alpha=0.15 + 0.85 * shade, linewidth=1.2)
    for k, (low, high) in enumerate(bounds.tolist()):
        axes.axvline(k, color=FAINT, linewidth=0.8)
        axes.annotate(f"{low:.3g}", (k, -0.03), ha="center", va="top", color=INK, fontsize=7)
        axes.annotate(f"{high:.3g}", (k, 1.03), ha="center", va="bottom", color=INK, fontsize=7)
    slanted = max(map(len, names)) > LONG and len(names) > 2
    axes.set_xticks(range(len(names)), names, **({"rotation": 20, "ha": "right"} if slanted else {}))
    axes.set_yticks([])
    axes.set_ylim(-0.12, 1.12)
