"""Loads along free-form leaf springs: a force and a moment per length, and a pressure on a face."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ksd.checks import Vector, as_vector, number, show, vector, word
from ksd.errors import SceneError

SIDES = {"+e2": 1.0, "-e2": -1.0}
"""Sides of a leaf: e2 is e1, from its start to its end, turned left about its width axis e3; the sign of the push by
side."""


def _checked_span(load: Any, owner: str) -> None:
    """Check and convert the part of the leaf that a load covers, `start` and `end` [m] from the start of the leaf."""
    start = number(load.start, "start", owner=owner, unit="m")
    end = load.end if load.end is None else number(load.end, "end", owner=owner, unit="m")
    if start < 0.0 or (end is not None and not end > start):
        raise SceneError(
            f"{owner}: it covers the leaf from start = {start:g} m to end = {show(end)} m; give "
            "0 <= start < end along the leaf."
        )
    load.__dict__.update(start=start, end=end)


@dataclass(frozen=True)
class LineLoad:
    """Dead force (3,) [N/m] and moment (3,) [Nm/m] per length of a leaf, in global axes: `force` and `moment` at `start`,
    `to` and `to_moment` at `end`, linear between.

    start, end [m]: arc lengths from the start of the leaf, undeformed; end None: its end; to, to_moment None: `force`,
    `moment` all along. It acts on the centreline; both keep their direction in space.
    """

    name: str
    leaf: str
    force: Vector = (0.0, 0.0, 0.0)
    to: Vector | None = None
    start: float = 0.0
    end: float | None = None
    moment: Vector = (0.0, 0.0, 0.0)
    to_moment: Vector | None = None

    def __post_init__(self) -> None:
        owner = f"line load '{word(self.name, 'name', owner='line load')}'"
        for key, unit in {"force": "N/m", "to": "N/m", "moment": "Nm/m", "to_moment": "Nm/m"}.items():
            if getattr(self, key) is not None:
                self.__dict__[key] = vector(getattr(self, key), key, owner=owner, unit=unit)
        _checked_span(self, owner)

    @property
    def end_force(self) -> Vector:
        """Force per length (3,) [N/m] at `end`."""
        return self.force if self.to is None else self.to

    @property
    def end_moment(self) -> Vector:
        """Moment per length (3,) [Nm/m] at `end`."""
        return self.moment if self.to_moment is None else self.to_moment

    @property
    def has_moment(self) -> bool:
        """Whether it has a moment per length."""
        return any(self.moment) or any(self.end_moment)

    @property
    def has_force(self) -> bool:
        """Whether it has a force per length, be it one of zero."""
        return any(self.force) or any(self.end_force) or not self.has_moment


@dataclass(frozen=True)
class Pressure:
    """Pressure [Pa] that pushes a leaf along its side `side`, "+e2" or "-e2", over its whole width, and turns with it.

    start, end [m]: as of `LineLoad`. A negative pressure pulls.
    """

    name: str
    leaf: str
    pressure: float
    side: str = "+e2"
    start: float = 0.0
    end: float | None = None

    def __post_init__(self) -> None:
        owner = f"pressure '{word(self.name, 'name', owner='pressure')}'"
        self.__dict__["pressure"] = number(self.pressure, "pressure", owner=owner, unit="Pa")
        if self.side not in SIDES:
            raise SceneError(
                f"{owner}: side = {show(self.side)}: give '+e2' or '-e2', the direction in which it pushes; e2 is the "
                "direction "
                "from the start of the leaf to its end, turned left about its width axis."
            )
        _checked_span(self, owner)


def forces_along(scene: Any) -> list[LineLoad | Pressure]:
    """The loads along leaf springs that are forces."""
    return [x for x in scene.loads_along if isinstance(x, Pressure) or x.has_force]


def load_edges(scene: Any, leaf: str, length: float) -> list[float]:
    """Arc lengths [m] inside a leaf at which a force along it begins or ends."""
    edges = {
        edge
        for load in forces_along(scene)
        if load.leaf == leaf
        for edge in (load.start, load.end)
        if edge is not None and 1e-9 * length < edge < (1.0 - 1e-9) * length
    }
    return sorted(edges)


def loads_between(
    loads: Iterable[LineLoad | Pressure], length: float, first: float, last: float
) -> tuple[Vector, Vector, float]:
    """Line load at the start and its change to the end (3,) [N/m], and pressure [Pa], of the part from `first` to `last`
    [m] of a leaf, in which none of its loads begins or ends."""
    ends, push, middle = np.zeros((2, 3)), 0.0, 0.5 * (first + last)
    for load in loads:
        end = length if load.end is None else load.end
        if not load.start < middle < end:
            continue
        if isinstance(load, Pressure):
            push += SIDES[load.side] * load.pressure
        else:
            shares = (np.array([first, last]) - load.start) / (end - load.start)
            ends += np.outer(1.0 - shares, load.force) + np.outer(shares, load.end_force)
    return as_vector(ends[0]), as_vector(ends[1] - ends[0]), push
