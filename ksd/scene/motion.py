"""Functions of time that a base or a load follows."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.checks import number, positive, show
from ksd.errors import SceneError

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class HalfSine:
    """A pulse amplitude * sin(pi t / duration) for 0 < t < duration [s], zero before and after."""

    amplitude: float
    duration: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "amplitude", number(self.amplitude, "amplitude", owner="HalfSine"))
        object.__setattr__(self, "duration", positive(self.duration, "duration", owner="HalfSine", unit="s"))

    def __call__(self, t: Any) -> Array:
        """Values at times t [s]."""
        t = np.asarray(t, float)
        inside = (t > 0.0) & (t < self.duration)
        return np.where(inside, self.amplitude * np.sin(math.pi * t / self.duration), 0.0)


@dataclass(frozen=True)
class TimeTable:
    """A function of time by points (t [s], value), straight between them, zero before the first and after the last."""

    points: tuple[tuple[float, float], ...]

    def __post_init__(self) -> None:
        rows = self.points.tolist() if isinstance(self.points, np.ndarray) else self.points
        if not isinstance(rows, list | tuple) or any(
            not isinstance(row, list | tuple) or len(row) != 2 for row in rows
        ):
            raise SceneError(f"table of time: {show(self.points)} must be points (time [s], value).")
        clean = tuple(
            (number(t, "time", owner="table of time", unit="s"), number(v, "value", owner="table of time"))
            for t, v in rows
        )
        if len(clean) < 2 or any(b[0] <= a[0] for a, b in pairwise(clean)):
            raise SceneError(
                f"table of time: {show(self.points)} needs two points or more, at times that rise."
            )
        object.__setattr__(self, "points", clean)

    @property
    def duration(self) -> float:
        """Time of the last point [s]."""
        return self.points[-1][0]

    def __call__(self, t: Any) -> Array:
        """Values at times t [s]."""
        at, values = np.array(self.points).T
        return np.asarray(np.interp(np.asarray(t, float), at, values, left=0.0, right=0.0))
