"""A pose that swings in one of its modes, or in the shape in which it buckles."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Protocol, cast

import numpy as np
from numpy.typing import NDArray

from ksd.errors import SceneError
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.view.drawable import Drawable

Array = NDArray[np.float64]
SMALL_SWING = 1e-4
"""Size of the swing, over that of the mechanism, by which the displacement of a shape is measured."""


class Shapes(Protocol):
    """Modes (`Configuration.frequencies`) or shapes of buckling (`Configuration.buckling`) as pictures see them."""

    @property
    def model(self) -> Model:
        """The model whose states they are."""

    @property
    def motion(self) -> State:
        """The state about which they are."""

    @property
    def shape(self) -> Array:
        """Displacement and rotation (k, nodes, 6) of the nodes."""

    @property
    def names(self) -> tuple[str, ...]:
        """Name of every shape."""

    def caption(self, row: int) -> str:
        """What a shape is, and its frequency or critical load factor."""

    def moved(self, row: int, size: float) -> State:
        """The state displaced by `size` times a shape."""


def row_of(shapes: Shapes, shape: int | str) -> int:
    """Row of a shape given by its number in the printed table, from 1, or by its name. Raises SceneError."""
    names = shapes.names
    if shape in names:
        return names.index(cast(str, shape))
    if isinstance(shape, bool) or not isinstance(shape, int | np.integer) or not 1 <= shape <= len(names):
        raise SceneError(
            f"mode = {shape!r}: give the number of a mode as its table counts them, 1 to {len(names)}, or one of the names "
            f"{', '.join(names)}"
        )
    return int(shape) - 1


def swing(pose: Drawable, shapes: Shapes, row: int, amplitude: float) -> Callable[[float], Drawable]:
    """A function from the share (-1 to 1) of a swing to the pose displaced in a shape; amplitude: its largest displacement
    over the size of the mechanism."""
    still: Any = replace(cast(Any, pose), model=shapes.model, motion=shapes.motion, method_was_chosen=False)
    size = float(shapes.model.arrays.size)
    before, after = shapes.motion, shapes.moved(row, 1.0)
    moves = (
        np.abs(after.x - before.x).max(), size * np.abs(after.R - before.R).max(),
        size**2 * np.abs(after.inner - before.inner).max(initial=0.0),
    )  # fmt: skip
    little = SMALL_SWING * size / max(*map(float, moves), 1e-300)
    places = [_places(replace(still, motion=s)) for s in (before, shapes.moved(row, little))]
    largest = float(np.abs(places[1] - places[0]).max())
    unit = amplitude * size * little / max(largest, 1e-300)
    return lambda share: replace(still, motion=shapes.moved(row, unit * share))


def _places(pose: Drawable) -> Array:
    """Points (n, 3) [m] of leaf springs and links."""
    shape = pose.shape()
    return np.concatenate([leaf.place for leaf in shape.leaves] + [b.place for b in shape.blocks])
