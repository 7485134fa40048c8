"""Signals over time, their spectra, and rates over values."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING

from ksd.view.figure import LINE_COLORS, Array, label_axes, new_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def plot_over_time(t: Array, curves: Sequence[tuple[str, str, Array]]) -> Figure:
    """Curves (label, unit, values (k,)) over t (k,) [s], a panel for each unit."""
    panels = list(dict.fromkeys(unit for _, unit, _ in curves))
    figure = new_figure(7.0, 0.8 + 1.7 * len(panels))
    axes = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
    for panel, unit in zip(axes, panels, strict=True):
        for (label, _, values), color in zip(
            (c for c in curves if c[1] == unit), cycle(LINE_COLORS), strict=False
        ):
            panel.plot(t, values, color=color, linewidth=1.3, label=label)
        label_axes(panel, "", y=f"[{unit}]")
        panel.legend(fontsize=7, loc="best")
    axes[-1].set_xlabel("time [s]", fontsize=9)
    return figure


def plot_phase(values: Array, rates: Array, name: str, unit: str) -> Figure:
    """Rates (k,) of a signal over its values (k,), start and end marked."""
    figure = new_figure(5.0, 4.2)
    axes = figure.add_subplot()
    axes.plot(values, rates, color=LINE_COLORS[0], linewidth=1.1)
    axes.plot(values[:1], rates[:1], "o", color=LINE_COLORS[1], markersize=4, label="start")
    axes.plot(values[-1:], rates[-1:], "s", color=LINE_COLORS[1], markersize=4, label="end")
    label_axes(axes, "", x=f"{name} [{unit}]", y=f"rate [{unit}/s]")
    axes.legend(fontsize=7, loc="best")
    return figure


def plot_spectrum(frequency_Hz: Array, amplitude: Array, label: str) -> Figure:
    """Amplitudes (n,) over frequencies (n,) [Hz], both logarithmic, without the one at zero."""
    figure = new_figure(7.0, 3.2)
    axes = figure.add_subplot()
    axes.loglog(frequency_Hz[1:], amplitude[1:], color=LINE_COLORS[0], linewidth=1.2)
    label_axes(axes, "", x="frequency [Hz]", y=label)
    return figure
