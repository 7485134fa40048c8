"""Bode plots: gain and phase of frequency responses, one curve for every pair of input and output."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from ksd.view.figure import LINE_COLORS, Array, label_axes, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_bode(frequency_Hz: Array, value: Any, labels: Sequence[str], units: Sequence[str]) -> Figure:
    """Gain and phase of responses value (n, k) at frequencies (n,) [Hz]; curves of one unit share a panel of gains.

    labels, units (k,): of the curves.
    """
    panels = list(dict.fromkeys(units))
    figure = new_figure(7.0, 1.9 + 2.1 * len(panels))
    axes = figure.subplots(
        len(panels) + 1, 1, sharex=True, squeeze=False, height_ratios=[*[2.0] * len(panels), 1.3]
    )
    below = axes[-1, 0]
    for k, (label, color) in enumerate(zip(labels, cycle(LINE_COLORS), strict=False)):
        above = axes[panels.index(units[k]), 0]
        gain = np.abs(value[:, k])
        above.loglog(
            frequency_Hz, np.where(gain > 0.0, gain, np.nan), color=color, label=label, linewidth=1.4
        )
        below.semilogx(frequency_Hz, phase_in_degrees(value[:, k]), color=color, linewidth=1.4)
    for panel, unit in zip(axes[:-1, 0], panels, strict=True):
        label_axes(panel, "", y=f"gain [{unit}]")
        panel.legend(fontsize=7, loc="best")
    label_axes(below, "", x="frequency [Hz]", y="phase [deg]")
    below.set_yticks([-360, -270, -180, -90, 0, 90, 180], minor=False)
    lowest = min(float(np.nanmin(phase_in_degrees(v))) for v in value.T)
    highest = max(float(np.nanmax(phase_in_degrees(v))) for v in value.T)
    below.set_ylim(lowest - 20.0, highest + 20.0)
    return figure


def phase_in_degrees(value: Any) -> Array:
    """Phase (n,) [deg] of a response (n,) without jumps, starting between -180 and 180; 0 where the response is."""
    phase = np.unwrap(np.angle(np.where(np.abs(value) > 0.0, value, 1.0)))
    return np.asarray(np.degrees(phase))
