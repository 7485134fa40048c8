"""Shared by all pictures: colours, figures that need no display, numbers with units, and saving."""

from __future__ import annotations

import io
import os
import re
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from ksd.errors import SceneError
from ksd.files import check_target, named_file, write_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
TEXT_COLOR = "#1f2430"
FAINT_COLOR = "#9aa3b2"
UNDEFORMED_COLOR = "#c3c9d4"
LEAF_COLOR = "#c2410c"
DRIVE_COLOR = "#b91c1c"
LOAD_COLOR = "#0f6674"
SENSOR_COLOR = "#6d28d9"
GROUND_COLOR = "#4b5563"
NOTEBOOK_SCALE = 0.64
"""Displayed width of a figure in a notebook relative to its pixels, for screens of double resolution."""
GRID_COLOR = "#eceff4"
UNDEFORMED_FACE = "#eef0f4"
"""Face colour of the undeformed mechanism."""
LINE_COLORS = (LEAF_COLOR, "#3b6ea5", "#6a9f58", "#9a7bb5", "#b8925b", "#4fa3a0", "#b8657f", TEXT_COLOR)
"""Colours of unordered curves, marks and bars; ordered ones take `ordered_colors`."""
LINK_COLORS = ("#5b8db8", "#6a9f58", "#9a7bb5", "#b8925b", "#4fa3a0", "#b8657f")
"""Colours of links in turn; leaf springs share one colour so that they stand out."""
LABEL_BACKGROUND = {"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.75}
"""Box behind labels in pictures of mechanisms (matplotlib bbox)."""
_LARGEST_IN_UNITS = {
    "thickness": 0.05, "diameter": 0.05, "gap": 0.05, "fillet": 0.05, "length": 2.0, "width": 2.0, "spacing": 2.0,
    "radius": 2.0, "inner": 2.0, "outer": 2.0, "angle": 3.15,
}  # fmt: skip
"""Design parameters that are lengths [m] or angles [rad], and what they are at most: beyond, they are in units of the
user's own."""


def new_figure(width: float, height: float, *, dpi: int = 150) -> Figure:
    """An empty matplotlib figure of `width` x `height` inches that needs no display, and that notebooks show."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg

    figure = _notebook_figure()(figsize=(width, height), dpi=dpi, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


@cache
def _notebook_figure() -> type[Figure]:
    """Figure class that notebooks display without a magic command, at `NOTEBOOK_SCALE` of its pixels."""
    from matplotlib.figure import Figure

    class NotebookFigure(Figure):
        def __repr__(self) -> str:
            wide, high = self.get_size_inches()
            return f"<picture of {wide:.3g} x {high:.3g} inches>"

        def _repr_png_(self) -> tuple[bytes, dict[str, int]]:
            wide, high = (round(NOTEBOOK_SCALE * inches * self.dpi) for inches in self.get_size_inches())
            return figure_bytes(self, "png"), {"width": wide, "height": high}

    return NotebookFigure


def check_picture(path: str | os.PathLike[str]) -> Path:
    """The path, if a picture can be written there. SceneError for an unknown type, a missing folder, or what is no file."""
    from matplotlib.backend_bases import FigureCanvasBase

    target = named_file(path, "picture")
    known = FigureCanvasBase.get_supported_filetypes()
    kind = target.suffix.lstrip(".").lower()
    if kind not in known:
        raise SceneError(f"picture '{target}': type '{kind}' is unknown; choose one of .png, .pdf, .svg")
    check_target(target, what="picture")
    return target


def save_figure(figure: Figure, path: str | os.PathLike[str]) -> Figure:
    """Write a figure to `path` (.png, .pdf, .svg ...) and return it. SceneError when that is not possible."""
    target = check_picture(path)
    write_file(target, figure_bytes(figure, target.suffix.lstrip(".").lower()), what="picture")
    return figure


def figure_bytes(figure: Any, kind: str, **words: Any) -> bytes:
    """Content of a figure file of kind "png", "pdf", "svg" ...; `words` are passed to matplotlib's savefig."""
    content = io.BytesIO()
    without_math_text(figure).savefig(content, format=kind, **words)
    return content.getvalue()


def without_math_text(figure: Any) -> Any:
    """The figure with dollar signs in its texts taken literally; labels of logarithmic axes stay math text."""
    from matplotlib.text import Text

    for text in figure.findobj(Text):
        if "$" in text.get_text() and "\\mathdefault" not in text.get_text():
            text.set_parse_math(False)
    return figure


def blended(color: str, white: float) -> str:
    """The colour "#rrggbb" blended with a share of white, or of black if negative."""
    share, other = abs(white), 255.0 if white > 0 else 0.0
    parts = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return "#" + "".join(f"{round((1.0 - share) * part + share * other):02x}" for part in parts)


def color_map() -> Any:
    """The colour map of all pictures, light (small) to dark (large), without what white paper hides, and without black."""
    from matplotlib import colormaps
    from matplotlib.colors import ListedColormap

    return ListedColormap(colormaps["inferno_r"](np.linspace(0.1, 0.8, 256)), name="light to dark")


def ordered_colors(count: int) -> list[Any]:
    """`count` colours of `color_map`, light to dark, for ordered curves."""
    return list(color_map()(np.linspace(0.2, 0.95, count) if count > 1 else np.array([0.5])))


def plain_axes(axes: Any, *, grid: Literal["both", "x"] = "both") -> None:
    """Give axes a faint grid in the background and no frame at the top and right."""
    axes.grid(True, axis=grid, color=GRID_COLOR, linewidth=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def write_title(axes: Any, title: str) -> None:
    """Write the title of axes at their left."""
    axes.set_title(title, fontsize=10, loc="left", color=TEXT_COLOR)


def label_axes(
    axes: Any, title: str, *, x: str = "", y: str = "", grid: Literal["both", "x"] = "both"
) -> None:
    """Write the title and the axis labels, with small numbers, on `plain_axes`."""
    write_title(axes, title)
    axes.set_xlabel(x, fontsize=9)
    axes.set_ylabel(y, fontsize=9)
    axes.tick_params(labelsize=8)
    plain_axes(axes, grid=grid)


def value_with_unit(value: float, kind: str) -> str:
    """A drive value with its unit: mm or, where small, µm for translations, degrees for rotations."""
    if kind != "translation":
        return f"{np.degrees(value):.4g}\N{DEGREE SIGN}"
    return f"{1e6 * value:.4g} \N{MICRO SIGN}m" if 0 < abs(value) < 1e-4 else f"{1e3 * value:.4g} mm"


def label_with_value(label: str, value: float) -> str:
    """A label with its value and unit: "x 10 mm" of x_mm = 10, "thickness 0.8 mm" of thickness = 0.0008 (m)."""
    name, _, unit = label.rpartition("_")
    if name and unit in ("mm", "deg"):
        return f"{name} {value:.4g} {unit}".replace(" deg", "\N{DEGREE SIGN}")
    return f"{label.replace('_', ' ')} {parameter_with_unit(label, value)}"


def parameter_with_unit(name: str, value: float, *, most: float | None = None, digits: int = 4) -> str:
    """A design parameter with its unit, if its name implies one, and if neither it nor `most`, the largest value shown with
    it, is too large for that unit."""
    kind = re.split(r"[_.]", name)[-1].partition("[")[0]
    largest = _LARGEST_IN_UNITS.get(kind, _LARGEST_IN_UNITS.get(kind.removesuffix("s")))
    if largest is None or not max(abs(value), abs(most or 0.0)) <= largest:
        return f"{value:.{digits}g}"
    if kind.startswith("angle"):
        return f"{np.degrees(value):.{digits}g}\N{DEGREE SIGN}"
    return f"{1e3 * value:.{digits}g} mm"


THOUSANDS_UNIT = {"N": "kN", "Nm": "kNm", "kg": "t"}
THOUSANDTHS_UNIT = {"N": "mN", "Nm": "mNm", "kg": "g"}


def amount_with_unit(value: float, unit: str) -> str:
    """A force [N], moment [Nm] or mass [kg] with its unit, of thousands or thousandths where it is large or small."""
    if abs(value) >= 1e4:
        return f"{1e-3 * value:.4g} {THOUSANDS_UNIT[unit]}"
    if 0.0 < abs(value) < 1e-4 and unit != "kg":
        return f"{1e6 * value:.4g} \N{MICRO SIGN}{unit}"
    if 0.0 < abs(value) < 1e-3:
        return f"{1e3 * value:.4g} {THOUSANDTHS_UNIT[unit]}"
    return f"{value + 0.0:.4g} {unit}"  # not "-0"
