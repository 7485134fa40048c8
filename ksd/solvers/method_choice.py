"""Which way a solver takes where no method is named: that which took least on its last poses.

Two ways lead to every answer. FIVE_STEPS: the reduced state, which one Newton step of the full model corrects and tells the
error of; where that is larger than the accuracy asked for, it goes on from there as `full` (`ksd.solvers.method_error`).
ONE_STEP: the conventional solver, if it converges in one load step. The first pose goes by the size of the mechanism, the
next ones by the other way, unless that cannot be faster, and all others by the faster one.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

FIVE_STEPS, ONE_STEP = "five steps", "one load step"
REMEMBERED, TRIALS, RETRY = 2, 2, 50
"""Poses of each way whose times are remembered, how often a way is tried before it is judged, and after how many poses the
slower one is tried again."""
RETRY_ESTIMATE = 10
"""After how many poses of `full` the error of the reduced state is told again, where it was above the accuracy before."""
FEWEST_ITERATIONS, FEWEST_ITERATIONS_IN_PLANE = 4, 2
"""Iterations of the full model in space that a load step is worth at least."""
WORTH, WORTH_IN_PLANE = 3, 5
"""Iterations of a load step, in space and in the plane, that the five steps cost at least."""

Times = Mapping[str, tuple[float, ...]]


class MethodChoice(NamedTuple):
    """What is known of both ways, by name: times [s] of the last poses, inf where it failed, and the ways that cannot be
    the faster one. first: the way of the first pose; poses: number of poses since the slower way was last tried; rejected:
    of the last poses by five steps, how many needed the full model; at first TRIALS where the records themselves are fitted
    no better than the accuracy."""

    first: str
    times: Times = MappingProxyType({FIVE_STEPS: (), ONE_STEP: ()})
    slower: frozenset[str] = frozenset()
    poses: int = 0
    rejected: int = 0

    @property
    def faster(self) -> str:
        """The way that took less on its last poses."""
        return min((self.first, _other(self.first)), key=lambda way: min(self.times[way], default=math.inf))

    @property
    def next(self) -> tuple[str, str]:
        """The way of the next pose, and why, in words."""
        other = _other(self.first)
        if not self.times[self.first]:
            size = "a mechanism of one joint or in a plane" if self.first == ONE_STEP else "joints in space"
            return self.first, f"chosen first, for {size}"
        for way in (other, self.first):
            times = self.times[way]
            if len(times) < TRIALS and times != (math.inf,) and (times or way not in self.slower):
                return way, "chosen to measure its time"
        slower = _other(self.faster)
        if self.poses >= RETRY and slower not in self.slower:
            return slower, "chosen to measure its time again"
        return self.faster, "chosen as the fastest on the last poses"

    @property
    def needs_full(self) -> bool:
        """Whether the five steps go to the full model at once, as the reduced state was too far off."""
        return self.rejected >= TRIALS and (self.rejected - TRIALS) % RETRY_ESTIMATE < RETRY_ESTIMATE - 1

    def told(
        self, way: str, time: float, *, iterations: float = math.inf, worth: float = 0.0, by_full: bool = False
    ) -> MethodChoice:  # fmt: skip
        """What is known after a pose by `way` that took `time` [s], inf where it failed.

        iterations: of the full model that this time is worth; worth: how many the other way is worth at least; by_full:
        whether the five steps needed the full model.
        """
        taken = (math.inf,) if time == math.inf else (*self.times[way], time)[-REMEMBERED:]
        ruled_out = {_other(way)} if worth >= iterations else set()
        return self._replace(
            times={**self.times, way: taken},
            slower=(self.slower - {way, _other(way)}) | ruled_out,
            poses=self.poses + 1 if way == self.faster else 0,
            rejected=self.rejected if way == ONE_STEP else self.rejected + 1 if by_full else 0,
        )


def _other(way: str) -> str:
    """The other way."""
    return ONE_STEP if way == FIVE_STEPS else FIVE_STEPS
