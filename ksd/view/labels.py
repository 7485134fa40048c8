"""Labels of a picture moved so that none lies on another, on a drive's arrow or outside the axes."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ksd.view.figure import Array, without_math_text

if TYPE_CHECKING:
    from matplotlib.transforms import Bbox

FIXED_LABEL = "fixed"
"""The gid (matplotlib) of labels that stay where they are."""
_DISTANCES = (12.0, 22.0, 34.0, 48.0, 64.0, 84.0, 112.0)
"""Distances tried from the given position of a label [points]."""
_DIRECTIONS = np.array([(0, 1), (0, -1), (1, 0), (-1, 0), (1, 1), (-1, -1), (1, -1), (-1, 1)], float)
_MOVES = np.concatenate([np.zeros((1, 2)), *(far * _DIRECTIONS for far in _DISTANCES)])
_FREE_DISTANCE = 10.0
"""Distance from the named point up to which all positions count as equally near [points]."""
_LEADER_DISTANCE = 18.0
"""Distance from the named point above which a leader line is drawn [points]."""
LABEL_MARGIN = np.array([5.0, 4.0])
"""Free margin around a label, horizontally and vertically [points]."""
_COVERED_POINT_COST, _CROSSED_LABEL_COST, _DISTANCE_COST = 0.06, 0.3, 2e-3
"""Cost, in label areas, of a point of a leaf that is covered, of another label on the line to the named point, and of each
point of additional distance."""


def separate_labels(axes: Any, keep_off: Array, avoid: Array) -> None:
    """Move the labels of `axes` in turn to the best position around their points. keep_off, avoid (n, 2): points in data
    coordinates that no label may cover, and that labels should not cover if possible."""
    figure = axes.figure
    texts = [text for text in axes.texts if text.get_text()]
    labels = [text for text in texts if text.get_gid() != FIXED_LABEL]
    for text in labels:
        # the picture must not shrink to make room for a label that will be moved
        text.set_in_layout(False)
    without_math_text(figure)
    # the first draw adjusts axes of equal scales, the second the positions in them
    for _ in range(2):
        figure.draw_without_rendering()
    figure.set_layout_engine("none")
    renderer, scale = figure.canvas.get_renderer(), figure.dpi / 72
    marks, lines = (axes.transData.transform(np.reshape(p, (-1, 2))) for p in (keep_off, avoid))
    taken: list[Bbox] = [text.get_window_extent(renderer) for text in texts if text not in labels]
    for text in labels:
        box = text.get_window_extent(renderer)
        # also right-aligned or centred at the given position
        back = np.array([[box.width, 0.0]]) / scale
        moves = np.concatenate([_MOVES, _MOVES - 0.5 * back, _MOVES - back])
        boxes = [box.translated(*(scale * move)) for move in moves]
        named = axes.transData.transform(text.xy)
        free_distance = max(_distance(box, named), _FREE_DISTANCE * scale)
        costs = [
            _hidden_share(b, taken, axes.bbox)
            + _points_inside(b.padded(*(scale * LABEL_MARGIN)), marks)
            + _COVERED_POINT_COST * _points_inside(b, lines)
            + _DISTANCE_COST * max(_distance(b, named) - free_distance, 0.0) / scale
            + _CROSSED_LABEL_COST
            * sum(_points_inside(other, _leader_points(b, named)) > 0 for other in taken)
            for b in boxes
        ]
        best = int(np.argmin(costs))
        text.set_position(tuple(np.array(text.get_position(), float) + moves[best]))
        taken.append(boxes[best])
        if _distance(boxes[best], named) > _LEADER_DISTANCE * scale:
            leader = _leader_points(boxes[best], named)
            marks = np.concatenate([marks, leader])
            line = axes.transData.inverted().transform(leader[[0, -1]])
            style = {"color": text.get_color(), "linewidth": 0.5, "alpha": 0.6, "zorder": 5}
            axes.plot(*line.T, scalex=False, scaley=False, **style)


def _leader_points(box: Bbox, point: Array) -> Array:
    """Points (n, 2) on the straight line from a point to the nearest point of a box."""
    return np.linspace(point, np.clip(point, box.min, box.max), 20)


def _distance(box: Bbox, point: Array) -> float:
    """Distance from a point to a box [pixels]; 0 inside."""
    return float(np.linalg.norm(np.diff(_leader_points(box, point)[[0, -1]], axis=0)))


def _hidden_share(box: Bbox, taken: list[Bbox], frame: Bbox) -> float:
    """Share of the label that is outside the frame, and of it or of others where they lie on each other."""
    area = box.width * box.height
    near = box.padded(12.0, 4.0)
    on_others = sum(_overlap_area(near, other) / min(area, other.width * other.height) for other in taken)
    # a label that is cut off cannot be read
    return 20.0 * (1.0 - _overlap_area(box, frame) / area) + on_others


def _overlap_area(one: Bbox, other: Bbox) -> float:
    """Area common to two boxes [pixels^2]."""
    both = one.intersection(one, other)
    return 0.0 if both is None else float(both.width * both.height)


def _points_inside(box: Bbox, points: Array) -> int:
    """Number of points (n, 2) inside a box."""
    return int(np.all((points > box.min) & (points < box.max), axis=1).sum())
