"""Answers over the stroke: force, stiffness, frequencies, stress, parasitic motion; one panel per unit."""

from __future__ import annotations

import re
from collections.abc import Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ksd.errors import SceneError
from ksd.view.drawable import DrawableTable
from ksd.view.figure import (
    DRIVE_COLOR,
    GROUND_COLOR,
    LINE_COLORS,
    Array,
    blended,
    label_axes,
    label_with_value,
    new_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


_STYLES = ("-", "--", ":", "-.")
_MAX_KEY_ENTRIES = 8
"""Largest number of designs in the key."""
_ZERO_SHARE = 1e-9
"""Series below this share of the largest of their panel are rounding and left out."""


_COVERED_STYLE = {"linewidth": 5.0, "alpha": 0.3, "zorder": 1.5}
"""Line style of a curve that another covers."""
_SAME_CURVE_TOLERANCE = 0.01
"""Relative difference below which two curves count as the same."""
_MIN_PANEL_VALUE = 1e-9
"""Panels whose largest value (in their unit) is below this are left out."""


class _Panel(NamedTuple):
    """One panel: pattern of its columns (group 1: name in the legend), label of the y axis, title, and whether the y axis is
    logarithmic and magnitudes are drawn."""

    pattern: str
    label: str
    title: str
    log: bool = False
    magnitude: bool = False


_PANELS: dict[str, tuple[_Panel, ...]] = {
    "force": (
        _Panel(r"(.+)_force_N", "drive force [N]", "Drive force"),
        _Panel(r"(.+)_moment_Nm", "drive moment [Nm]", "Drive moment"),
    ),
    "drive_stiffness": (
        _Panel(r"(?!support_)(.+)_stiffness_N_per_m", "drive stiffness [N/m]", "Drive stiffness"),
        _Panel(r"(?!support_)(.+)_stiffness_Nm_per_rad", "drive stiffness [Nm/rad]", "Drive stiffness"),
    ),
    "support_stiffness": (
        _Panel(
            r"support_(.|worst)_N_per_m", "support stiffness [N/m]", "Support stiffness, translations", True
        ),
        _Panel(
            r"support_(r.|worst)_Nm_per_rad",
            "support stiffness [Nm/rad]",
            "Support stiffness, rotations",
            True,
        ),
    ),
    "frequencies": (
        _Panel(
            r"(intended|intended_\d+|parasitic_\d+)_Hz", "frequency [Hz]", "Frequencies, modes followed", True
        ),
    ),
    "stress": (_Panel(r"(stress)_MPa", "largest von Mises stress [MPa]", "Stress"),),
    "parasitic": (
        _Panel(r"parasitic_([xyz])_mm", "parasitic displacement [mm]", "Parasitic displacement"),
        _Panel(r"parasitic_(r[xyz])_mrad", "parasitic rotation [mrad]", "Parasitic rotation"),
    ),
    "energy": (_Panel(r"(strain_energy)_J", "strain energy [J]", "Strain energy"),),
    "buckling": (
        _Panel(
            r"buckling_(positive|negative)",
            "factor on all stresses, magnitude [-]",
            "Critical load factors",
            True,
            True,
        ),
    ),
    "size": (_Panel(r"size_([xyz])_mm", "extent of the leaf springs [mm]", "Size"),),
    "distance": (_Panel(r"distance_(.+)_mm", "distance [mm]", "Distances asked for"),),
    "clearance": (_Panel(r"(clearance)_mm", "smallest distance of leaf springs [mm]", "Clearance"),),
}


def plot_stroke(
    table: DrawableTable, questions: Sequence[str] = (), *, over: str | None = None, wide: int = 2
) -> Figure:
    """Draw the answers in `table` (of `ksd.sweep`) over a drive; returns the matplotlib figure.

    questions: which, all that the table holds when empty. over: label column of the horizontal axis, the one with most
    values when None. wide: panels side by side. Other labels (designs, load cases) have different line styles. Raises
    SceneError for a question the table has no answer to.
    """
    over = over or _stroke_column(table)
    if over not in table.labels:
        raise SceneError(f"over = {over!r}: choose one of the labels of the table, {', '.join(table.labels)}")
    panels = _panels_to_draw(table, questions)
    wide = min(wide, len(panels))
    high = -(-len(panels) // wide)
    figure = new_figure(4.1 * wide, 3.0 * high)
    grid = figure.subplots(high, wide, squeeze=False).ravel()
    groups = _groups(table, over)
    for axes, (panel, columns) in zip(grid, panels, strict=False):
        _draw_panel(axes, table, panel, columns, over=over, groups=groups)
    for axes in grid[len(panels) :]:
        axes.set_visible(False)
    _draw_key(figure, table, groups)
    return figure


def _finite(values: Array) -> Array:
    """The finite ones of values."""
    return values[np.isfinite(values)]


def _stroke_column(table: DrawableTable) -> str:
    """Default column of the horizontal axis: the drive, or else the label, with most different values."""
    usable = table.moving or table.labels
    counts = {n: len(set(table.columns[n])) for n in usable if not isinstance(table[n], list)}
    if not counts or max(counts.values()) < 2:
        raise SceneError("this table has one pose only: a picture over the stroke needs two")
    return max(counts, key=lambda n: (counts[n], n.endswith(("_mm", "_deg"))))


def _panels_to_draw(table: DrawableTable, questions: Sequence[str]) -> list[tuple[_Panel, dict[str, str]]]:
    """Panels with values to draw, each with its columns (column -> name in the legend)."""
    for q in questions:
        if q not in _PANELS:
            raise SceneError(f"question {q!r} has no picture; choose among {', '.join(_PANELS)}")
    panels = []
    for q in questions or _PANELS:
        drawn = []
        for panel in _PANELS[q]:
            matches = {c: re.fullmatch(panel.pattern, c) for c in table.columns}
            columns = {c: m.group(1).replace("_", " ") for c, m in matches.items() if m}
            # columns that are zero throughout are drawn only on request, and infinite ones never
            least = 0.0 if questions else _MIN_PANEL_VALUE
            if any(np.max(np.abs(_finite(table[c])), initial=-1.0) >= least for c in columns):
                drawn.append((panel, columns))
        if questions and not drawn:
            raise SceneError(f"the table has no answers to {q!r}; ask for it with questions=(..., {q!r})")
        panels += drawn
    if not panels:
        raise SceneError(
            "the table has no answers to draw: " + (table.failures or [{"status": "no rows"}])[0]["status"]
        )
    return panels


def _groups(table: DrawableTable, over: str) -> dict[str, np.ndarray]:
    """Row numbers of every design and load case, by the labels that distinguish them."""
    still = [n for n in table.labels if n != over and n not in table.moving]
    others = [n for n in still if len(set(table.columns[n])) > 1]
    named: dict[str, list[int]] = {}
    for k, row in enumerate(table.rows()):
        label = ", ".join(row[n] if isinstance(row[n], str) else label_with_value(n, row[n]) for n in others)
        named.setdefault(label, []).append(k)
    return {label: np.array(rows) for label, rows in named.items()}


def _white_shares(count: int) -> Array:
    """Share of white, of black where negative, in the lines of `count` designs, loads or drive values: light to dark."""
    return np.linspace(0.55, -0.35, count) if count > 1 else np.zeros(1)


def _draw_panel(
    axes: Any, table: DrawableTable, panel: _Panel, columns: dict[str, str], *, over: str, groups: Any
) -> None:
    """Draw the curves of one panel, a cross for every failed pose, and its legend."""
    x = table[over]
    # the same range in all panels, whichever values are missing in them
    low, high = float(np.nanmin(x)), float(np.nanmax(x))
    axes.set_xlim(low - 0.04 * (high - low), high + 0.04 * (high - low))
    largest = max(np.max(np.abs(_finite(table[c])), initial=0.0) for c in columns)
    noise = 0.0 if panel.log else _ZERO_SHARE * largest
    # a single point makes no line
    shown = {c: n for c, n in columns.items() if np.sum(np.abs(_finite(table[c])) > noise) > 1}
    hidden = _covered_columns(table, shown)
    for color, (column, name) in zip(cycle(LINE_COLORS), (shown or columns).items(), strict=False):
        for style, shade, (label, rows) in zip(
            _line_styles(len(groups)), _white_shares(len(groups)), groups.items(), strict=True
        ):
            y = np.abs(table[column][rows]) if panel.magnitude else table[column][rows]
            y = np.where(y > 0, y, np.nan) if panel.log else y
            last = label == next(reversed(groups))
            tone = blended(color, float(shade))
            options = _COVERED_STYLE if column in hidden else {"linewidth": 1.6}
            axes.plot(x[rows], y, style, color=tone, label=name if last else None, **options)
    bad = np.isin(np.arange(len(x)), [k for k, s in enumerate(table["status"]) if s != "ok"])
    if bad.any():
        mark = {"transform": axes.get_xaxis_transform(), "color": DRIVE_COLOR, "clip_on": False}
        axes.plot(x[bad], np.full(bad.sum(), 0.02), "x", markersize=5, **mark)
    _format_panel(axes, panel, _axis_label(over))
    if shown and len(columns) > 1:
        _legend(axes, len(shown), panel.log, crowded=len(shown) * len(groups) > 3)


def _covered_columns(table: DrawableTable, shown: dict[str, str]) -> set[str]:
    """Columns whose curves later ones cover, and the worst direction, which repeats one of the others."""
    worst = {one for one in shown if shown[one] == "worst" and len(shown) > 1}
    plain = [one for one in shown if one not in worst]
    return worst | {
        one for k, one in enumerate(plain) for other in plain[k + 1 :]
        if np.allclose(table[one], table[other], rtol=_SAME_CURVE_TOLERANCE, atol=0.0, equal_nan=True)
    }  # fmt: skip


def _legend(axes: Any, count: int, log: bool, *, crowded: bool) -> None:
    """Draw the legend; with more than three curves, in room of its own above them."""
    if crowded:
        low, high = axes.get_ylim()
        room = 0.12 * -(-count // 3)
        axes.set_ylim(low, high * (high / low) ** room if log else high + room * (high - low))
    place = "upper center" if crowded else "best"
    options = {"fontsize": 8, "framealpha": 0.8, "edgecolor": "none"}
    axes.legend(ncols=3 if crowded else 1, loc=place, **options)


def _format_panel(axes: Any, panel: _Panel, over: str) -> None:
    """Set scale, labels, title and ticks of a panel; over: label of the horizontal axis."""
    if panel.log:
        axes.set_yscale("log")
        low, high = axes.get_ylim()
        # powers of ten alone would leave an axis of few decades without numbers
        if high / low < 300:
            from matplotlib.ticker import LogFormatterSciNotation, LogLocator, NullFormatter

            plain = low > 1e-4 and high < 1e4
            powers = LogFormatterSciNotation(labelOnlyBase=False, minor_thresholds=(9, 9))
            axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0) if high / low < 30 else (1.0, 3.0)))
            axes.yaxis.set_major_formatter("{x:g}" if plain else powers)
            axes.yaxis.set_minor_formatter(NullFormatter())
    label_axes(axes, panel.title, x=over, y=panel.label)


def _axis_label(column: str) -> str:
    """ "top_mm" as "top [mm]"."""
    name, _, unit = column.rpartition("_")
    return f"{name} [{unit}]" if name and unit in ("mm", "deg", "SI") else column.replace("_", " ")


def _draw_key(figure: Any, table: DrawableTable, groups: dict[str, np.ndarray]) -> None:
    """Draw the key of designs, load cases or drive values above all panels, and of the marks of failed poses."""
    from matplotlib.lines import Line2D

    key = []
    if len(groups) > 1:
        every = zip(groups, _line_styles(len(groups)), _white_shares(len(groups)), strict=True)
        lines = [
            Line2D(
                [], [], color=blended(GROUND_COLOR, float(shade)), linestyle=style, linewidth=1.6, label=label
            )
            for label, style, shade in every
        ]
        # of many designs, evenly spaced ones from the first to the last
        key = [
            lines[k]
            for k in sorted(
                {round(k) for k in np.linspace(0, len(lines) - 1, min(len(lines), _MAX_KEY_ENTRIES))}
            )
        ]
    if table.failures:
        count = len(table.failures)
        label = f"{count} pose{'s' * (count != 1)} without full answer"
        key.append(Line2D([], [], color=DRIVE_COLOR, linestyle="none", marker="x", markersize=5, label=label))
    if key:
        wide = max(1, int(figure.get_figwidth() / 0.078 / (7 + max(len(line.get_label()) for line in key))))
        # legends are filled column by column; reordered, the key reads row by row
        key = [line for k in range(wide) for line in key[k::wide]]
        figure.legend(handles=key, loc="outside upper left", ncols=wide, fontsize=8, frameon=False)


def _line_styles(count: int) -> list[Any]:
    """Line styles; plain lines where there are more than styles, told apart by their shade."""
    return list(_STYLES[:count]) if count <= len(_STYLES) else ["-"] * count
