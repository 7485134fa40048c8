"""Whether a picture can be read: its words lie apart and inside, its colours are those of the package."""

from itertools import combinations
from unittest.mock import patch

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.colors import to_hex
from matplotlib.text import Text

from ksd.view.figure import color_map

CYCLE = {f"C{k}" for k in range(10)}
"""Matplotlib's own colours: one of them in a picture was forgotten."""
SLACK = 1.0
"""Pixels by which boxes of words may share an edge."""


def drawn_words(figure):
    """The texts that are really drawn: ticks beyond an axis are not."""
    found = []
    draw = Text.draw

    def heard(self, renderer, *more):
        if self.get_visible() and self.get_text().strip():
            found.append(self)
        return draw(self, renderer, *more)

    with patch.object(Text, "draw", heard):
        figure.canvas.draw()
    return list(dict.fromkeys(found))


def box_of(text):
    """Corners (4, 2) [px] of the words themselves, turned as they are."""
    angle = np.radians(text.get_rotation())
    around = Text.get_window_extent(text)  # without the arrow of an annotation
    text.set_rotation(0)
    level = Text.get_window_extent(text)
    text.set_rotation(np.degrees(angle))
    along, up = np.array([np.cos(angle), np.sin(angle)]), np.array([-np.sin(angle), np.cos(angle)])
    half = 0.5 * np.maximum(np.array([level.width, level.height]) - SLACK, 0.1)
    middle = 0.5 * (np.array(around.min) + around.max)
    return np.array(
        [middle + a * half[0] * along + b * half[1] * up for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    )


def apart(one, other):
    """Whether a line parts two rectangles (4, 2)."""
    for box in (one, other):
        for way in (box[1] - box[0], box[2] - box[1]):
            a, b = one @ way, other @ way
            if a.max() <= b.min() or b.max() <= a.min():
                return True
    return False


def assert_readable(figure):
    """No words lie on others or are cut off; no colour comes from elsewhere."""
    words = drawn_words(figure)
    boxes = [box_of(text) for text in words]
    for (one, a), (two, b) in combinations(zip(words, boxes, strict=True), 2):
        assert apart(a, b), f"'{one.get_text()}' lies on '{two.get_text()}'"
    low, high = np.array(figure.bbox.min) - SLACK, np.array(figure.bbox.max) + SLACK
    for text, box in zip(words, boxes, strict=True):
        assert (box >= low).all() and (box <= high).all(), f"'{text.get_text()}' is cut off"
    forgotten = {to_hex(name) for name in CYCLE}
    for artist in figure.findobj():
        for asked in ("get_color", "get_facecolor", "get_edgecolor"):
            found = getattr(artist, asked, lambda: "none")()
            each = found if isinstance(found, list | np.ndarray) and np.ndim(found) == 2 else [found]
            for color in dict.fromkeys(c if isinstance(c, str) else tuple(c) for c in each):
                assert to_hex(color) not in forgotten, f"{artist}: {to_hex(color)} is matplotlib's own"
        if isinstance(artist, ScalarMappable) and artist.get_array() is not None:
            assert artist.get_cmap().name == color_map().name, f"{artist} has another colour map"
