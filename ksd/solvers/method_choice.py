"""Which way a solver takes where no method is named: that which took least on its last poses.

Two ways lead to every answer. FIVE_STEPS: the reduced state, which one Newton step of the full model corrects and tells the
error of; where that is larger than the accuracy asked for, it goes on from there as `full` (`ksd.solvers.method_error`).
ONE_STEP: the conventional solver, if it converges in one load step. The first pose goes by the size of the mechanism, the
next ones by the other way, unless that cannot be faster, and all others by the faster one. The slower one is tried again
after some poses, after twice as many each time that it stays slower. Where both fail, LOAD_STEPS.

Other programs make single times too large, so the time of a way is the least of its last poses per assembly of the leaf
springs, times the number of assemblies that its last pose took.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from ksd.solvers.steps import Step

FIVE_STEPS, ONE_STEP, LOAD_STEPS = "five steps", "one load step", "load steps"
REMEMBERED, TRIALS, FIRST_RETRY, LAST_RETRY = 8, 2, 1, 64
"""Poses of each way whose times are remembered, how often a way is tried before it is judged, and after how many poses the
slower one is tried again, at first and at last."""
RETRY_ESTIMATE = 10
"""After how many poses of `full` the error of the reduced state is told again, where it was above the accuracy before."""
FEWEST_ITERATIONS, FEWEST_ITERATIONS_IN_PLANE = 4, 2
"""Iterations of the full model in space that a load step is worth at least."""
WORTH, WORTH_IN_PLANE = 3, 5
"""Iterations of a load step, in space and in the plane, that the five steps cost at least in small mechanisms."""


def work_of(steps: Sequence[Step]) -> int:
    """Work of a solve: assemblies of all leaf springs, and one for everything else."""
    work = 1
    for step in steps:
        if step.name[0] == "2" or step.name == "error estimate":
            work += max(step.iterations, 1)
        elif step.name[0] in "5e":
            # one more finds that it has converged
            work += step.iterations + 1
    return work


class WayTimes:
    """What is known of a way. rates: times [s] of its last poses over their work (`work_of`), inf where it failed; time [s]:
    of a pose with the work of the last one, inf where that is not known."""

    def __init__(self) -> None:
        self.rates: list[float] = []
        self.time = math.inf

    def add(self, time: float, work: int) -> None:
        """Add a pose that took `time` [s], inf where it failed."""
        if time == math.inf:
            self.rates.clear()
        self.rates.append(time / work)
        del self.rates[:-REMEMBERED]
        self.time = work * min(self.rates)


class MethodChoice:
    """Which way the next pose takes, from what its last ones told.

    first: the way of the first pose; in_plane: whether load steps are in a plane; rejected: of the last poses by five steps,
    how many needed the full model; at first TRIALS where the records themselves are fitted no better than the accuracy.
    ways: what is known of them; slower: the way without times that cannot be the faster one; poses: number of poses since
    the slower way was last tried, which is tried again after `retry` of them.
    """

    def __init__(self, first: str, *, in_plane: bool = False, rejected: int = 0) -> None:
        self.first, self.faster, self.slower = first, first, ""
        self.in_plane, self.rejected = in_plane, rejected
        self.ways = {FIVE_STEPS: WayTimes(), ONE_STEP: WayTimes()}
        self.poses, self.retry = 0, FIRST_RETRY

    @property
    def next(self) -> tuple[str, str]:
        """The way of the next pose, and why, in words."""
        if not self.ways[self.first].rates:
            size = "a mechanism of one joint or in a plane" if self.first == ONE_STEP else "joints in space"
            return self.first, f"chosen first, for {size}"
        for way in (_other(self.first), self.first):
            rates = self.ways[way].rates
            if len(rates) < TRIALS and rates != [math.inf] and (rates or way != self.slower):
                return way, "chosen to see how fast it is"
        slower = _other(self.faster)
        if self.poses >= self.retry and self.ways[slower].rates:
            return slower, "chosen to see whether it is faster by now"
        if self.ways[self.faster].time == math.inf:
            return LOAD_STEPS, "chosen because faster ways failed on the last poses"
        return self.faster, "chosen as the fastest on the last poses"

    @property
    def needs_full(self) -> bool:
        """Whether the five steps go to the full model at once, as the reduced state was too far off."""
        return self.rejected >= TRIALS and (self.rejected - TRIALS) % RETRY_ESTIMATE < RETRY_ESTIMATE - 1

    def told(self, way: str, time: float, steps: Sequence[Step] = (), *, by_full: bool = False) -> None:
        """Take in a pose by `way` that took `time` [s], inf where it failed, in these steps.

        by_full: whether the five steps needed the full model.
        """
        self.ways[way].add(time, work_of(steps))
        if way == FIVE_STEPS:
            self.rejected = self.rejected + 1 if by_full else 0
        before, other = self.faster, _other(self.first)
        self.faster = other if self.ways[other].time < self.ways[self.first].time else self.first
        if way == before and time < math.inf:
            self.poses += 1
        else:
            self.poses = 0
            self.retry = min(2 * self.retry, LAST_RETRY) if self.faster == before else FIRST_RETRY
        if not self.ways[_other(way)].rates:
            self.slower = _other(way) if self._cannot_be_slower(way, time, steps) else ""

    def _cannot_be_slower(self, way: str, time: float, steps: Sequence[Step]) -> bool:
        """Whether the other way takes no less than this pose by `way`."""
        if way == ONE_STEP:
            return sum(s.iterations for s in steps) <= (WORTH_IN_PLANE if self.in_plane else WORTH)
        fewest = FEWEST_ITERATIONS_IN_PLANE if self.in_plane else FEWEST_ITERATIONS
        return any(time <= fewest * s.time for s in steps if s.name == "error estimate")

    def by_neither(self) -> None:
        """Take in a pose by LOAD_STEPS."""
        self.poses += 1


def _other(way: str) -> str:
    """The other way."""
    return ONE_STEP if way == FIVE_STEPS else FIVE_STEPS
