"""The stroke as an animation (GIF): one frame per configuration, axes that stand still."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ksd.errors import SceneError
from ksd.view.figure import new_figure
from ksd.view.flat import best_plane, plot_mechanism


def animate_stroke(
    configurations: Sequence[Any],
    path: str | os.PathLike[str],
    *,
    plane: str | None = None,
    frames_per_second: int = 12,
    back: bool = True,
    dpi: int = 80,
) -> Path:
    """Write the `configurations` of one mechanism as an animated GIF, forth and (with `back`) back again.

    plane: as in `plot_mechanism`, the widest of the last configuration when None. Returns the path. Raises SceneError
    for no configurations, another file type than .gif, or a folder that does not exist.
    """
    target = Path(path)
    if target.suffix.lower() != ".gif":
        raise SceneError(f"animation '{target}': write it as .gif")
    if not target.parent.is_dir():
        raise SceneError(f"animation '{target}': folder '{target.parent}' does not exist; make it first")
    if not configurations:
        raise SceneError(f"animation '{target}': there are no configurations to show")
    from matplotlib.animation import PillowWriter

    shapes = [c.shape() for c in configurations]
    plane = plane or best_plane(shapes[-1])
    pick = ["xyz".index(a) for a in plane]
    low, high = _window(shapes, pick)
    wide, tall = high - low
    figure = new_figure(7.0, float(np.clip(6.2 * tall / wide + 0.9, 2.8, 7.0)), dpi=dpi)
    axes = figure.add_subplot()
    order = [*configurations, *(configurations[-2:0:-1] if back else ())]
    writer = PillowWriter(fps=frames_per_second)
    with writer.saving(figure, str(target), dpi):
        for c in order:
            axes.clear()
            plot_mechanism(c, axes=axes, plane=plane)
            axes.set_xlim(low[0], high[0])
            axes.set_ylim(low[1], high[1])
            writer.grab_frame()
    return target


def _window(shapes: Sequence[Any], pick: list[int]) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner [mm] of a window that holds every frame, with room for the labels."""
    points = np.concatenate([p for s in shapes for leaf in s.leafs for p in (leaf.rest, leaf.place)])[:, pick]
    low, high = 1e3 * points.min(axis=0), 1e3 * points.max(axis=0)
    room = np.maximum(0.14 * (high - low), 0.05 * float((high - low).max()))
    return low - room, high + room * np.array([2.2, 1.0])
