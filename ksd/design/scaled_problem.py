"""A job as an optimisation problem: margins of targets, limits and rules, and their slopes, over scaled parameters.

Parameters and answers are in logarithms where possible: a step then means the same share of every parameter, and an answer
far from its limit has the same weight as one near it.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ksd.design.design_log import DesignLog
from ksd.design.job import Job
from ksd.design.table import OK
from ksd.errors import KsdError, ResumeError
from ksd.properties.printing import format_number

Array = np.ndarray
BINDING_MARGIN = 1e-5
"""Margin, in logarithms, up to which a target or limit counts as active, and up to which a limit may be exceeded."""
LOG_RATIO_MIN = 0.1
"""Ratio of an answer to its limit below which its margin is linear in the answer instead of logarithmic."""
INFINITE_ANSWER_MARGIN = 10.0
"""Margin of an answer that is infinite, because nothing moves or nothing buckles."""
VIOLATION_PENALTY = 10.0
"""Weight of the sum of violations, in logarithms, in the fitness of a design."""


class DesignFailed(Exception):
    """The design at scaled parameters y (P,) has no answers."""

    def __init__(self, y: Array, reason: str) -> None:
        super().__init__(reason)
        self.y = y


class _Side(NamedTuple):
    """One margin of an answer: index of the answer, sign and reference value of the margin, and whether it is a target."""

    answer: int
    sign: float
    reference: float
    is_target: bool


class ScoredPoint(NamedTuple):
    """Scaled parameters y (P,) and their score."""

    score: float
    y: Array


def _extended_log(r: Array) -> tuple[Array, Array]:
    """log r, continued by its tangent below LOG_RATIO_MIN, and its derivative."""
    bounded = np.maximum(r, LOG_RATIO_MIN)
    return np.log(bounded) + np.minimum(r - LOG_RATIO_MIN, 0.0) / LOG_RATIO_MIN, 1.0 / bounded


class ScaledProblem:
    """A job in scaled parameters y (P,): margins (m,) of all sides of answers, then of rules, and their slopes (m, P).

    y: logarithms of parameters whose bounds are positive; other parameters over their range. The margin of a target is
    log(answer / scale), that of a limit the logarithm of the ratio to the limit; a margin is not negative where a limit is
    met. The level of a design is its least target margin, the t of the epigraph form. label: of new designs in the log.
    on_new_design: called after every new design. best: the point of largest fitness; best_feasible: the point of largest
    level that meets all limits and rules; last_valid (P,): the last y that had answers.
    """

    def __init__(
        self,
        job: Job,
        log: DesignLog,
        label: str,
        *,
        on_new_design: Callable[[ScaledProblem], None] = lambda problem: None,
    ) -> None:
        self.job, self.log, self.label, self.on_new_design = job, log, label, on_new_design
        low, high = job.bounds.T
        self.is_log = low > 0.0
        self.parameter_scale = np.where(self.is_log, 1.0, high - low)
        self.bounds = np.column_stack([self.scaled(low), self.scaled(high)])
        self.sides = _sides(job)
        self.is_target = np.array([s.is_target for s in self.sides] + [False] * len(job.rule_names))
        self.last_valid: Array | None = None
        self.best = ScoredPoint(-np.inf, np.zeros(len(low)))
        self.best_feasible: ScoredPoint | None = None
        self.known_margins: dict[bytes, Array] = {}
        self.known_slopes: dict[bytes, Array] = {}

    def scaled(self, x: Array) -> Array:
        """y of parameters x (P,)."""
        return np.where(self.is_log, np.log(np.where(self.is_log, x, 1.0)), x / self.parameter_scale)

    def unscaled(self, y: Array) -> Array:
        """Parameters x (P,) of y, within the bounds."""
        x = np.where(self.is_log, np.exp(np.where(self.is_log, y, 0.0)), y * self.parameter_scale)
        return np.clip(x, *self.job.bounds.T)

    def margins_from(self, values: Array, rules: Array) -> Array:
        """Margins (m,) from answers and rule values."""
        return np.concatenate([self._answer_margins(values)[0], rules / self.rule_scales])

    def _answer_margins(self, values: Array) -> tuple[Array, Array]:
        """Margins of all sides of answers, and their derivatives by the answers."""
        v = values[[s.answer for s in self.sides]]
        sign, reference = np.array([s.sign for s in self.sides]), np.array([s.reference for s in self.sides])
        finite = np.isfinite(v)
        size = np.where(reference == 0.0, 1.0, reference)
        ratio = np.where(finite, v, 1.0) / size
        value, slope = _extended_log(ratio)
        value, slope = np.where(reference == 0.0, ratio, value), np.where(reference == 0.0, 1.0, slope)
        good = sign * np.sign(v) * np.sign(size) > 0.0
        infinite = np.where(good, INFINITE_ANSWER_MARGIN, -INFINITE_ANSWER_MARGIN)
        return np.where(finite, sign * value, infinite), np.where(finite, sign * slope / size, 0.0)

    @cached_property
    def rule_scales(self) -> Array:
        """Scales (R,) of the rules: the largest absolute value of each at the ends and in the middle of the bounds."""
        designs = (*self.job.bounds.T, self.job.bounds.mean(axis=1))
        largest = np.nan_to_num(np.max([np.abs(self.job.rule_values(x)) for x in designs], axis=0))
        return np.where(largest > 0.0, largest, 1.0)

    def margins(self, y: Array) -> Array:
        """Margins (m,) at y. Raises DesignFailed where the design has no answers."""
        key = y.tobytes()
        is_new = key not in self.known_margins
        if is_new:
            x = self.unscaled(y)
            values, status = self.log.batch(x, by=self.label)
            missing = np.isnan(values[0])
            if status[0] != OK or missing.any():
                no_answer = f"there is no {self.job.names[int(np.argmax(missing))]}"
                raise DesignFailed(y, status[0] if status[0] != OK else no_answer)
            self.known_margins[key] = self.margins_from(values[0], self.job.rule_values(x))
        self.last_valid = y.copy()
        margins = self.known_margins[key]
        if self.fitness(margins) > self.best.score:
            self.best = ScoredPoint(self.fitness(margins), y.copy())
        if self.is_feasible(margins) and (
            self.best_feasible is None or self.level(margins) > self.best_feasible.score
        ):
            self.best_feasible = ScoredPoint(self.level(margins), y.copy())
        if is_new:
            self.on_new_design(self)
        return margins

    def slopes(self, y: Array) -> Array:
        """Slopes (m, P) of the margins at y, those of rules by central differences. Raises DesignFailed."""
        key = y.tobytes()
        if key not in self.known_slopes:
            x = self.unscaled(y)
            try:
                values, slopes = self.log.slopes(x, by=self.label)
            except ResumeError:
                raise
            except KsdError as reason:
                raise DesignFailed(y, str(reason)) from reason
            inner = np.where(self.is_log, x, self.parameter_scale)
            _, outer = self._answer_margins(values)
            rows = outer[:, None] * slopes[[s.answer for s in self.sides]] * inner
            missing = np.isnan(rows).any(axis=1)
            if missing.any():
                name = self.job.names[self.sides[int(np.argmax(missing))].answer]
                raise DesignFailed(y, f"there is no gradient of {name}")
            ranges = self.job.range_slopes(x) * inner / self.rule_scales[len(self.job.rules) :, None]
            self.known_slopes[key] = np.vstack([rows, self._rule_slopes(y), ranges])
        return self.known_slopes[key]

    def _rule_slopes(self, y: Array) -> Array:
        """Slopes (R, P) of the rules of the job that are functions of the parameters."""
        count = len(self.job.rules)
        h, slopes = 1e-6, np.zeros((count, len(y)))
        for i in range(len(y) if count else 0):
            step = h * (np.arange(len(y)) == i)
            # a parameter at its bound gets a one-sided difference
            ends = [np.clip(y + s * step, *self.bounds.T) for s in (1, -1)]
            plus, minus = (self.job.rule_values(self.unscaled(e), shapes=False) for e in ends)
            slopes[:, i] = (plus - minus) / (ends[0][i] - ends[1][i]) / self.rule_scales[:count]
        return slopes

    def level(self, margins: Array) -> float:
        """The least margin of the targets."""
        return float(margins[self.is_target].min())

    def fitness(self, margins: Array) -> float:
        """The level less VIOLATION_PENALTY times the sum by which limits and rules are exceeded."""
        return self.level(margins) - VIOLATION_PENALTY * float(
            np.maximum(-margins[~self.is_target], 0.0).sum()
        )

    def violation(self, margins: Array) -> float:
        """The most by which a limit or rule is exceeded; 0 where all are met."""
        return float(-margins[~self.is_target].min(initial=0.0))

    def worst_violation(self, y: Array) -> str:
        """The limit or rule that is exceeded most at y, as text."""
        k = int(np.argmin(np.where(self.is_target, np.inf, self.margins(y))))
        if k >= len(self.sides):
            return f"rule {self.job.rule_names[k - len(self.sides)]}"
        side = self.sides[k]
        value = float(self.log.values(self.unscaled(y))[side.answer])
        return f"{self.job.names[side.answer]}: {format_number(value)}, the limit is {format_number(side.reference)}"

    def is_feasible(self, margins: Array) -> bool:
        """Whether limits and rules are met."""
        return self.violation(margins) <= BINDING_MARGIN


def _sides(job: Job) -> tuple[_Side, ...]:
    """Sides of all answers: one of a target, one or two of a limit."""
    sides = []
    for k, a in enumerate(job.answers):
        if a.role != "limit":
            sign = 1.0 if a.role == "maximise" else -1.0
            sides.append(_Side(k, sign, a.scale / a.factor, True))
            continue
        # v <= high is log(high / v) >= 0, for negative numbers log(v / high) >= 0
        sides += [_Side(k, -1.0 if a.high >= 0.0 else 1.0, a.high, False)] if np.isfinite(a.high) else []
        sides += [_Side(k, 1.0 if a.low >= 0.0 else -1.0, a.low, False)] if np.isfinite(a.low) else []
    return tuple(sides)
