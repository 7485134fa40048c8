"""A job as an optimiser sees it: margins of targets, limits and rules, and their slopes, over scaled parameters.

In logarithms of parameters and answers, where that is possible: what is far from its limit then weighs as much as what is
near, and a step means the same share of every parameter.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ksd.design.design_log import DesignLog
from ksd.design.job import Job
from ksd.design.table import OK
from ksd.errors import KsdError
from ksd.properties.printing import format_number

Array = np.ndarray
BINDING = 1e-5
"""Margin, in logarithms, up to which a target or limit holds an optimum back."""
LINEAR = 0.1
"""Share of its limit below which an answer counts as it is, not by its logarithm."""
FREE = 10.0
"""Margin of an answer that is infinite: nothing moves, nothing buckles."""
PENALTY = 10.0
"""Of what is beyond its limit, in logarithms, in the fitness of a design."""


class DesignFailed(Exception):
    """A design at scaled parameters y that has no answers."""

    def __init__(self, y: Array, reason: str) -> None:
        super().__init__(reason)
        self.y = y


class _Side(NamedTuple):
    """One side of an answer: its number among the answers, the sign and the reference of its margin, and whether it is a
    target."""

    answer: int
    sign: float
    reference: float
    target: bool


def _logs(r: Array) -> tuple[Array, Array]:
    """log r, below LINEAR continued by its tangent, and its derivative."""
    far = np.maximum(r, LINEAR)
    return np.log(far) + np.minimum(r - LINEAR, 0.0) / LINEAR, 1.0 / far


class ScaledProblem:
    """A job in scaled parameters y (P,): margins (m,) of all sides of answers, then of rules, and their slopes (m, P).

    y: logarithms of parameters whose bounds are positive, others over their range. Margins of targets are log(answer /
    scale), of limits the logarithm of how far they are from being reached; not negative where they are met. told: called
    after every new design.
    """

    def __init__(
        self,
        job: Job,
        log: DesignLog,
        by: str,
        *,
        told: Callable[[ScaledProblem], None] = lambda search: None,
    ) -> None:
        self.job, self.log, self.by, self.told = job, log, by, told
        low, high = job.bounds.T
        self.positive = low > 0.0
        self.size = np.where(self.positive, 1.0, high - low)
        self.bounds = np.column_stack([self.scaled(low), self.scaled(high)])
        self.sides = _sides(job)
        self.targets = np.array([s.target for s in self.sides] + [False] * len(job.rule_names))
        self.good: Array | None = None
        self.best = -np.inf, np.zeros(len(low))
        self.met_best: tuple[float, Array] | None = None
        self.asked: dict[bytes, Array] = {}
        self.sloped: dict[bytes, Array] = {}

    def scaled(self, x: Array) -> Array:
        """y of x."""
        return np.where(self.positive, np.log(np.where(self.positive, x, 1.0)), x / self.size)

    def x(self, y: Array) -> Array:
        """x of y, within the bounds."""
        found = np.where(self.positive, np.exp(np.where(self.positive, y, 0.0)), y * self.size)
        return np.clip(found, *self.job.bounds.T)

    def margins_of(self, values: Array, rules: Array) -> Array:
        """Margins from answers and rules."""
        return np.concatenate([self._of_answers(values)[0], rules / self.rule_sizes])

    def _of_answers(self, values: Array) -> tuple[Array, Array]:
        """Margins of all sides, and their derivatives by the answers."""
        v = values[[s.answer for s in self.sides]]
        sign, reference = np.array([s.sign for s in self.sides]), np.array([s.reference for s in self.sides])
        whole_ = np.isfinite(v)
        size = np.where(reference == 0.0, 1.0, reference)
        ratio = np.where(whole_, v, 1.0) / size
        value, slope = _logs(ratio)
        value, slope = np.where(reference == 0.0, ratio, value), np.where(reference == 0.0, 1.0, slope)
        free = np.where(sign * np.sign(v) * np.sign(size) > 0.0, FREE, -FREE)
        return np.where(whole_, sign * value, free), np.where(whole_, sign * slope / size, 0.0)

    @cached_property
    def rule_sizes(self) -> Array:
        """What rules (R,) are measured by: the largest size of each at the ends and in the middle of the bounds."""
        places = (*self.job.bounds.T, self.job.bounds.mean(axis=1))
        found = np.nan_to_num(np.max([np.abs(self.job.rule_values(x)) for x in places], axis=0))
        return np.where(found > 0.0, found, 1.0)

    def margins(self, y: Array) -> Array:
        """Margins (m,) at y. raises DesignFailed where the design has no answers."""
        key, new = y.tobytes(), False
        if key not in self.asked:
            x = self.x(y)
            values, status = self.log.batch(x, by=self.by)
            if status[0] != OK or np.isnan(values[0]).any():
                raise DesignFailed(y, self._why(values[0], status[0]))
            self.asked[key] = self.margins_of(values[0], self.job.rule_values(x))
            new = True
        self.good = y.copy()
        margins = self.asked[key]
        if self.fitness(margins) > self.best[0]:
            self.best = self.fitness(margins), y.copy()
        if self.met(margins) and (self.met_best is None or self.level(margins) > self.met_best[0]):
            self.met_best = self.level(margins), y.copy()
        if new:
            self.told(self)
        return margins

    def _why(self, values: Array, status: str) -> str:
        if status != OK:
            return status
        return f"there is no {self.job.names[int(np.argmax(np.isnan(values)))]}"

    def slopes(self, y: Array) -> Array:
        """Slopes (m, P) at y, rules by central differences. raises DesignFailed."""
        key = y.tobytes()
        if key not in self.sloped:
            x = self.x(y)
            try:
                values, slopes = self.log.slopes(x, by=self.by)
            except KsdError as reason:
                raise DesignFailed(y, str(reason)) from reason
            inner = np.where(self.positive, x, self.size)
            _, outer = self._of_answers(values)
            rows = outer[:, None] * slopes[[s.answer for s in self.sides]] * inner
            bad = np.isnan(rows).any(axis=1)
            if bad.any():
                name = self.job.names[self.sides[int(np.argmax(bad))].answer]
                raise DesignFailed(y, f"there is no gradient of {name}")
            ranges = self.job.range_slopes(x) * inner / self.rule_sizes[len(self.job.rules) :, None]
            self.sloped[key] = np.vstack([rows, self._rule_slopes(y), ranges])
        return self.sloped[key]

    def _rule_slopes(self, y: Array) -> Array:
        """Slopes (R, P) of the rules of the job."""
        count = len(self.job.rules)
        h, found = 1e-6, np.zeros((count, len(y)))
        for i in range(len(y) if len(found) else 0):
            step = h * (np.arange(len(y)) == i)
            # a parameter at its bound is stepped to one side
            ends = [np.clip(y + s * step, *self.bounds.T) for s in (1, -1)]
            plus, minus = (self.job.rule_values(self.x(e), shapes=False) for e in ends)
            found[:, i] = (plus - minus) / (ends[0][i] - ends[1][i]) / self.rule_sizes[:count]
        return found

    def level(self, margins: Array) -> float:
        """The least margin of the targets: the t that a design reaches."""
        return float(margins[self.targets].min())

    def fitness(self, margins: Array) -> float:
        """The level less PENALTY times what limits and rules are exceeded by."""
        return self.level(margins) - PENALTY * float(np.maximum(-margins[~self.targets], 0.0).sum())

    def exceeded(self, margins: Array) -> float:
        """The most by which a limit or rule is exceeded; 0 where all are met."""
        return float(-margins[~self.targets].min(initial=0.0))

    def farthest(self, y: Array) -> str:
        """The limit or rule that is exceeded most at y, in words."""
        k = int(np.argmin(np.where(self.targets, np.inf, self.margins(y))))
        if k >= len(self.sides):
            return f"rule {self.job.rule_names[k - len(self.sides)]}"
        side = self.sides[k]
        value = float(self.log.values(self.x(y))[side.answer])
        return f"{self.job.names[side.answer]}: {format_number(value)}, the limit is {format_number(side.reference)}"

    def met(self, margins: Array) -> bool:
        """Whether limits and rules are met."""
        return self.exceeded(margins) <= BINDING


def _sides(job: Job) -> tuple[_Side, ...]:
    """Sides of all answers: one of a target, one or two of a limit."""
    found = []
    for k, a in enumerate(job.answers):
        if a.role != "limit":
            sign = 1.0 if a.role == "maximise" else -1.0
            found.append(_Side(k, sign, a.scale / a.factor, True))
            continue
        # v <= high is log(high / v) >= 0, of negative numbers log(v / high)
        found += [_Side(k, -1.0 if a.high >= 0.0 else 1.0, a.high, False)] if np.isfinite(a.high) else []
        found += [_Side(k, 1.0 if a.low >= 0.0 else -1.0, a.low, False)] if np.isfinite(a.low) else []
    return tuple(found)
