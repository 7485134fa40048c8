"""Labels of a picture moved so that none lies on another, on a drive's arrow or outside the axes."""

from __future__ import annotations

from typing import Any

import numpy as np

from ksd.view.figure import Array, without_math_text

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
    frame, margin = axes.bbox.get_points(), scale * LABEL_MARGIN
    taken = [text.get_window_extent(renderer).get_points() for text in texts if text not in labels]
    for text in labels:
        box = text.get_window_extent(renderer).get_points()
        # also right-aligned or centred at the given position
        back = np.array([[box[1, 0] - box[0, 0], 0.0]]) / scale
        moves = np.concatenate([_MOVES, _MOVES - 0.5 * back, _MOVES - back])
        boxes = box + scale * moves[:, None]
        named = axes.transData.transform(text.xy)
        leaders = _leader_points(boxes, named)
        distances = np.linalg.norm(leaders[:, -1] - named, axis=1)
        free_distance = max(distances[0], _FREE_DISTANCE * scale)
        costs = (
            _hidden_share(boxes, taken, frame)
            + _points_inside(boxes + np.array([-margin, margin]), marks)
            + _COVERED_POINT_COST * _points_inside(boxes, lines)
            + _DISTANCE_COST * np.maximum(distances - free_distance, 0.0) / scale
            + _CROSSED_LABEL_COST * sum(_is_inside(leaders, other).any(axis=1) for other in taken)
        )
        best = int(np.argmin(costs))
        text.set_position(tuple(np.array(text.get_position(), float) + moves[best]))
        taken.append(boxes[best])
        if distances[best] > _LEADER_DISTANCE * scale:
            leader = leaders[best]
            marks = np.concatenate([marks, leader])
            line = axes.transData.inverted().transform(leader[[0, -1]])
            style = {"color": text.get_color(), "linewidth": 0.5, "alpha": 0.6, "zorder": 5}
            axes.plot(*line.T, scalex=False, scaley=False, **style)


def _leader_points(boxes: Array, point: Array) -> Array:
    """Points (m, 20, 2) on the straight lines from a point (2,) to the nearest points of boxes (m, 2, 2)."""
    return np.linspace(point, np.clip(point, boxes[:, 0], boxes[:, 1]), 20, axis=1)


def _hidden_share(boxes: Array, taken: list[Array], frame: Array) -> Array:
    """Share (m,) of the label that is outside the frame, and of it or of others where they lie on each other."""
    area = _area(boxes)
    near = boxes + np.array([[-12.0, -4.0], [12.0, 4.0]])
    on_others = sum(_overlap_area(near, other) / np.minimum(area, _area(other)) for other in taken)
    # a label that is cut off cannot be read
    return 20.0 * (1.0 - _overlap_area(boxes, frame) / area) + on_others


def _area(boxes: Array) -> Array:
    """Areas of boxes (..., 2, 2), lower left and upper right corner [pixels^2]."""
    return np.asarray((boxes[..., 1, :] - boxes[..., 0, :]).prod(axis=-1))


def _overlap_area(boxes: Array, other: Array) -> Array:
    """Areas (m,) that boxes (m, 2, 2) have in common with another (2, 2) [pixels^2]."""
    sides = np.minimum(boxes[:, 1], other[1]) - np.maximum(boxes[:, 0], other[0])
    return np.asarray(np.maximum(sides, 0.0).prod(axis=1))


def _is_inside(points: Array, box: Array) -> Array:
    """Which points (..., 2) are inside a box (2, 2)."""
    return np.asarray(((points > box[0]) & (points < box[1])).all(axis=-1))


def _points_inside(boxes: Array, points: Array) -> Array:
    """Numbers (m,) of points (n, 2) inside boxes (m, 2, 2)."""
    x, y = points[np.argsort(points[:, 0])].T
    first, end = np.searchsorted(x, boxes[:, 0, 0], "right"), np.searchsorted(x, boxes[:, 1, 0], "left")
    columns = zip(first.tolist(), end.tolist(), boxes[:, :, 1].tolist(), strict=True)
    return np.array([np.count_nonzero((y[i:j] > low) & (y[i:j] < high)) for i, j, (low, high) in columns])
