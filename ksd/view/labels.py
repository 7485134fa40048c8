"""Labels of a picture moved so that none lies on another, on a drive's arrow or outside the axes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ksd.view.figure import Array, without_formulas

if TYPE_CHECKING:
    from matplotlib.transforms import Bbox

FIXED = "fixed"
"""What words that are not to be moved are marked by (matplotlib's gid)."""
_FAR = (12.0, 22.0, 34.0, 48.0, 64.0, 84.0, 112.0)
"""Distances tried, in points, from the place a label was given."""
_WAYS = np.array([(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1)], float)
_MOVES = np.concatenate([np.zeros((1, 2)), *(far * _WAYS for far in _FAR)])
_NEAR = 10.0
"""Distance, in points, up to which one place is as good as another."""
_LED = 18.0
"""Distance, in points, from which a line leads to a label."""
AROUND = np.array([5.0, 4.0])
"""Points left free on the sides and above and below a label."""
_CROSSED, _CROSSING, _OFF = 0.06, 0.3, 2e-3
"""Cost, in label areas, of a point of a leaf that is covered, of another label on the way to what a label names, and of each
point of that way."""


def part_labels(axes: Any, keep_off: Array, avoid: Array) -> None:
    """Move the labels of `axes` in turn to the best place about them. keep_off, avoid (n, 2): points in data coordinates
    that no label may cover, and that labels had better not cover."""
    figure = axes.figure
    said = [text for text in axes.texts if text.get_text()]
    labels = [text for text in said if text.get_gid() != FIXED]
    for text in labels:
        # the picture must not shrink to make room for a label that will be moved
        text.set_in_layout(False)
    without_formulas(figure)
    # scales of equal length are settled by the first
    for _ in range(2):
        figure.draw_without_rendering()
    figure.set_layout_engine("none")
    renderer, scale = figure.canvas.get_renderer(), figure.dpi / 72
    marks, lines = (axes.transData.transform(np.reshape(p, (-1, 2))) for p in (keep_off, avoid))
    taken: list[Bbox] = [text.get_window_extent(renderer) for text in said if text not in labels]
    for text in labels:
        box = text.get_window_extent(renderer)
        # also with its end or its middle where its start was
        back = np.array([[box.width, 0.0]]) / scale
        moves = np.concatenate([_MOVES, _MOVES - 0.5 * back, _MOVES - back])
        boxes = [box.translated(*(scale * move)) for move in moves]
        named = axes.transData.transform(text.xy)
        meant = max(_gap(box, named), _NEAR * scale)
        costs = [
            _lost(b, taken, axes.bbox)
            + _covered(b.padded(*(scale * AROUND)), marks)
            + _CROSSED * _covered(b, lines)
            + _OFF * max(_gap(b, named) - meant, 0.0) / scale
            + _CROSSING * sum(_covered(other, _way(b, named)) > 0 for other in taken)
            for b in boxes
        ]
        best = int(np.argmin(costs))
        text.set_position(tuple(np.array(text.get_position(), float) + moves[best]))
        taken.append(boxes[best])
        if _gap(boxes[best], named) > _LED * scale:
            # a fine line to it
            way = _way(boxes[best], named)
            marks = np.concatenate([marks, way])
            line = axes.transData.inverted().transform(way[[0, -1]])
            look = {"color": text.get_color(), "linewidth": 0.5, "alpha": 0.6, "zorder": 5}
            axes.plot(*line.T, scalex=False, scaley=False, **look)


def _way(box: Bbox, point: Array) -> Array:
    """Points (n, 2) from a point to a box, straight."""
    return np.linspace(point, np.clip(point, box.min, box.max), 20)


def _gap(box: Bbox, point: Array) -> float:
    """Pixels from a point to a box; 0 inside."""
    return float(np.linalg.norm(np.diff(_way(box, point)[[0, -1]], axis=0)))


def _lost(box: Bbox, taken: list[Bbox], frame: Bbox) -> float:
    """Share of the label that is outside the frame, and of it or of others where they lie on each other."""
    area = box.width * box.height
    near = box.padded(12.0, 4.0)
    on_others = sum(_shared(near, other) / min(area, other.width * other.height) for other in taken)
    # what is cut off cannot be read at all
    return 20.0 * (1.0 - _shared(box, frame) / area) + on_others


def _shared(one: Bbox, other: Bbox) -> float:
    both = one.intersection(one, other)
    return 0.0 if both is None else float(both.width * both.height)


def _covered(box: Bbox, points: Array) -> int:
    return int(np.all((points > box.min) & (points < box.max), axis=1).sum())
