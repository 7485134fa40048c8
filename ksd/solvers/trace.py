"""The plain record of a motion in time, which the steps fill and `ksd.study.history.History` answers from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.scene.functions_of_time import FunctionOfTime

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Trace:
    """Instants of a motion.

    t (k,) [s], rising; x (k, n): flattened states of `model` (`flat_state`). Nodes, ground first, as in the model:
    position (k, nodes, 3) [m], rotation (k, nodes, 3, 3), velocity and acceleration (k, nodes, 6) [m/s, rad/s ...], global,
    relative to a base that shakes. drive_value, drive_rate (k, d): of all drives, those let go included; drive_force (k, d)
    [N or Nm]: positive along the drive, 0 of those let go. energy: kinetic, strain, gravity, work, damped, lost (k,) [J], by
    name. error: estimated error of places, relative to the largest stroke, nan where only one step size was run. steps:
    number of steps; halved: how often a step was halved. stop: why the motion ended early, None where it did not; at_end:
    whether it got to its end. massless: names of links whose accelerations are algebra. notes: sentences on the run. loads:
    factors of loads by name, 1 of others.
    """

    model: Model
    t: Array
    x: Array
    position: Array
    rotation: Array
    velocity: Array
    acceleration: Array
    drive_value: Array
    drive_rate: Array
    drive_force: Array
    energy: Mapping[str, Array]
    error: float
    steps: int
    halved: int
    stop: str | None
    at_end: bool
    massless: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    loads: Mapping[str, FunctionOfTime] = field(default_factory=dict)

    def state(self, x: Array) -> State:
        """The state of a row of `x`, or of numbers between rows."""
        return state_of_row(x, self.model.rest)


def flat_state(state: State) -> Array:
    """A state as one row of `Trace.x`."""
    return np.concatenate([part.ravel() for part in state])


def state_of_row(row: Array, like: State) -> State:
    """The state of one flat row; like: a state of the same sizes."""
    parts = np.split(row, np.cumsum([field.size for field in like])[:-1])
    return State(*(part.reshape(field.shape).copy() for part, field in zip(parts, like, strict=True)))


def with_load_factors(scene: Any, factors: Mapping[str, float]) -> Any:
    """A frozen scene with loads and line loads times their factors, 1 of those not named."""

    def times(vector: Any, factor: float) -> tuple[float, ...]:
        return tuple(factor * v for v in vector)

    loads, lines = [], []
    for load in scene.loads:
        factor = factors.get(load.name, 1.0)
        loads.append(replace(load, force=times(load.force, factor), moment=times(load.moment, factor)))
    for line in scene.line_loads:
        factor = factors.get(line.name, 1.0)
        force, to = times(line.force, factor), times(line.end_force, factor)
        moment, to_moment = times(line.moment, factor), times(line.end_moment, factor)
        lines.append(replace(line, force=force, to=to, moment=moment, to_moment=to_moment))
    return replace(scene, loads=tuple(loads), line_loads=tuple(lines))
