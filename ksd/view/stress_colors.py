"""Leaf springs coloured by stress: the largest von Mises stress over the section at every station drawn."""

from __future__ import annotations

from typing import Any

import numpy as np

from ksd.answers.shape import Shape
from ksd.errors import SceneError
from ksd.view.drawable import Drawable
from ksd.view.figure import Array, color_map

STRESS_LABEL = "von Mises stress [MPa]"
EVEN, EVEN_SCALE = 0.8, 1.5
"""Least stress over the largest from which stress counts as even, and the end of its scale over the largest."""


def stress_along(configuration: Drawable, shape: Shape) -> dict[str, Array]:
    """Largest von Mises stress [MPa] over the section at the stations of every leaf of `shape`, by name."""
    stress = configuration.stress()
    return {
        leaf.name: 1e-6 * np.interp(leaf.s, stress[leaf.name].s, stress[leaf.name].von_mises_Pa.max(axis=1))
        for leaf in shape.leaves
    }


class StressColors:
    """Largest von Mises stress [MPa] along every leaf by name (`values`) and its colours."""

    def __init__(self, configuration: Drawable, shape: Shape) -> None:
        from matplotlib.colors import Normalize

        self.values = stress_along(configuration, shape)
        least, most = (end(float(end(v)) for v in self.values.values()) for end in (min, max))
        # leaf springs of the same stress everywhere have a colour of the middle, not the dark end of the scale
        self.norm = Normalize(0.0, (EVEN_SCALE if least > EVEN * most else 1.0) * most or 1.0)
        self.map = color_map()

    def between(self, name: str) -> Array:
        """Colours (k-1, 4) of a leaf between its k stations."""
        v = self.values[name]
        return np.asarray(self.map(self.norm(0.5 * (v[1:] + v[:-1]))))

    def bar(self, axes: Any, **place: Any) -> None:
        """Draw the colour bar."""
        from matplotlib.cm import ScalarMappable

        bar = axes.figure.colorbar(ScalarMappable(self.norm, self.map), ax=axes, **place)
        bar.set_label(STRESS_LABEL, fontsize=9)
        bar.ax.tick_params(labelsize=8)
        bar.outline.set_visible(False)


def stress_colors(configuration: Drawable, shape: Shape, color: str | None) -> StressColors | None:
    """Colours for `color="stress"`; None without a colour option. Raises SceneError for any other."""
    if color is None:
        return None
    if color != "stress":
        raise SceneError(f"color = {color!r}: choose 'stress', or leave it out")
    return StressColors(configuration, shape)
