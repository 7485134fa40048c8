"""A job as an optimisation problem: margins of targets, limits and rules, and their slopes, over scaled parameters.

Parameters and answers are in logarithms where possible: a step then means the same share of every parameter, and an answer
far from its limit has the same weight as one near it. Answers far below their size at the reference design, limits of zero
and rules are linear, relative to their own size there, so that no unit matters. The reference design is renewed by the
search (`ScaledProblem.renew`).
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from ksd.answers.printing import format_number
from ksd.errors import KsdError, ResumeError, SceneError
from ksd.optimisation.design_log import DesignLog
from ksd.optimisation.job import Job
from ksd.study.table import OK

Array = np.ndarray
FEASIBLE_MARGIN = 1e-12
"""Relative rounding up to which a limit or rule may be exceeded by a design that meets it."""
BACKOFF = 1e-7
"""Margin, in logarithms, that the search keeps to limits and rules, so that where it ends they are met."""
BOUND_MARGIN = 1e-7
"""Distance to a bound, in scaled parameters, up to which it counts as active."""
ACTIVE_MARGIN = 1e-4
"""Margin, in logarithms, up to which a target or limit counts as active."""
LOG_RATIO_MIN = 0.1
"""Ratio of an answer to its size below which its margin is linear in the answer instead of logarithmic."""
RENEWAL_RATIO = 2.0
"""Ratio by which a size differs from that at the reference design before a search is continued with it."""
INFINITE_ANSWER_MARGIN = 10.0
"""Margin of an answer that is infinite, because nothing moves or nothing buckles: it never binds."""
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


class EvaluatedDesign(NamedTuple):
    """Scaled parameters y (P,), answers (answers,), rule values (R,), and the merit."""

    y: Array
    values: Array
    rules: Array
    merit: float


def _extended_log(r: Array, least: Array | float = LOG_RATIO_MIN) -> tuple[Array, Array]:
    """log r, continued by its tangent below `least`, and its derivative."""
    bounded = np.maximum(r, least)
    return np.log(bounded) + np.minimum(r - least, 0.0) / least, 1.0 / bounded


class ScaledProblem:
    """A job in scaled parameters y (P,): margins (m,) of all sides of answers, then of rules, and their slopes (m, P).

    y: logarithms of parameters whose bounds are positive; other parameters over their range. The margin of a target is
    log(answer / scale), that of a limit the logarithm of the ratio to the limit; a margin is not negative where a limit is
    met. A target of which the magnitude counts has a margin for either sign. The level of a design is its least finite
    target margin, the t of the epigraph form. label: of new designs in the log. on_new_design: called after every new
    design. evaluated: all designs with answers by y as bytes; best_feasible: the one of largest merit that meets all limits
    and rules; last_valid (P,): the last y that had answers.
    """

    def __init__(
        self,
        job: Job,
        log: DesignLog,
        label: str,
        *,
        on_new_design: Callable[[ScaledProblem], None] | None = None,
    ) -> None:
        self.job, self.log, self.label, self.on_new_design = job, log, label, on_new_design
        low, high = job.bounds.T
        self.is_log = low > 0.0
        self.parameter_scale = np.where(self.is_log, 1.0, high - low)
        self.bounds = np.column_stack([self.scaled(low), self.scaled(high)])
        # bounds, tightened to where designs begin to fail
        self.edges = self.bounds.copy()
        self.sides = _sides(job)
        self.answer_of_side = np.array([s.answer for s in self.sides], int)
        self.is_target = np.array([s.is_target for s in self.sides] + [False] * len(job.rule_names))
        self.last_valid: Array | None = None
        self.best_feasible: EvaluatedDesign | None = None
        self.evaluated: dict[bytes, EvaluatedDesign] = {}
        self.raw_slopes: dict[bytes, tuple[Array, Array]] = {}
        # sizes at the reference design: of targets over their scales, of answers whose limit is zero, and of rules
        self.target_size = 1.0
        self.zero_sizes = np.ones(len(self.sides))
        self.rule_sizes = np.ones(len(job.rule_names))

    def __getstate__(self) -> dict[str, Any]:
        """What a worker returns: all but the log, which is that of the calling process again."""
        return {k: v for k, v in vars(self).items() if k != "log"}

    @cached_property
    def rule_scales(self) -> Array:
        """Ranges (R,) of the rules: the largest absolute value of each at the ends and in the middle of the bounds."""
        largest = np.zeros(len(self.job.rule_names))
        for x in (*self.job.bounds.T, self.job.bounds.mean(axis=1)):
            with suppress(SceneError):
                values = np.abs(self.job.rule_values(x))
                largest = np.fmax(largest, np.where(np.isfinite(values), values, 0.0))
        return np.where(largest > 0.0, largest, 1.0)

    def scaled(self, x: Array) -> Array:
        """y of parameters x (P,)."""
        return np.where(self.is_log, np.log(np.where(self.is_log, x, 1.0)), x / self.parameter_scale)

    def unscaled(self, y: Array) -> Array:
        """Parameters x (P,) of y, within the bounds."""
        x = np.where(self.is_log, np.exp(np.where(self.is_log, y, 0.0)), y * self.parameter_scale)
        return np.clip(x, *self.job.bounds.T)

    # ---- designs ---------------------------------------------------------------------------------------------------------

    def design(self, y: Array) -> EvaluatedDesign:
        """Answers and rules at y. Raises DesignFailed where the design has no answers or a rule no value."""
        key = y.tobytes()
        if key not in self.evaluated:
            self.designs([y])
        found = self.evaluated.get(key)
        if found is None:
            raise DesignFailed(y, self._failure(y))
        self.last_valid = y.copy()
        return found

    def designs(self, Y: list[Array], *, by: str = "") -> list[EvaluatedDesign | None]:
        """Answers and rules at several y, solved together; None where there are none. by: label in place of that of the
        problem."""
        by = by or self.label
        new: list[tuple[Array, Array, Array]] = []
        for y in Y:
            if y.tobytes() not in self.evaluated:
                x = self.unscaled(y)
                rules, reason = self.rules(x)
                if reason:
                    self.log.refuse(x, reason, by=by)
                else:
                    new.append((y, x, rules))
        if new:
            found = self.log.batch([x for _, x, _ in new], by=by)
            for (y, _, rules), values, status in zip(new, *found, strict=True):
                if status == OK and not np.isnan(values).any():
                    self._add(y, values, rules)
            if self.on_new_design is not None:
                self.on_new_design(self)
        return [self.evaluated.get(y.tobytes()) for y in Y]

    def _add(self, y: Array, values: Array, rules: Array) -> None:
        found = EvaluatedDesign(y.copy(), values, rules, self.job.merit(values))
        self.evaluated[y.tobytes()] = found
        is_better = self.best_feasible is None or found.merit > self.best_feasible.merit
        if is_better and np.isfinite(found.merit) and self.is_feasible(self.margins_from(values, rules)):
            self.best_feasible = found

    def rules(self, x: Array, *, shapes: bool = True) -> tuple[Array, str]:
        """Rule values (R,) at x as by `Job.rule_values`, nan where a rule fails; and why one has no value that counts, empty
        where all have."""
        try:
            rules = self.job.rule_values(x, shapes=shapes)
        except SceneError as reason:
            return np.full(len(self.job.rule_names if shapes else self.job.rules), np.nan), str(reason)
        bad = np.flatnonzero(np.isnan(rules) | np.isneginf(rules))
        return rules, f"rule {self.job.rule_names[bad[0]]} is {rules[bad[0]]:g}" if len(bad) else ""

    def _failure(self, y: Array) -> str:
        """Why there are no answers at y."""
        x = self.unscaled(y)
        reason = self.rules(x)[1]
        if reason:
            return reason
        values, status = self.log.batch(x, by=self.label)
        if status[0] != OK:
            return status[0]
        return f"there is no {self.job.names[int(np.argmax(np.isnan(values[0])))]}"

    # ---- margins ---------------------------------------------------------------------------------------------------------

    def renew(self, y: Array) -> bool:
        """Take the sizes at y as those of the reference design; whether one has changed by more than RENEWAL_RATIO.

        Raises DesignFailed.
        """
        found = self.design(y)
        before = np.concatenate([[self.target_size], self.zero_sizes, self.rule_sizes])
        if np.isfinite(found.merit) and found.merit != 0.0:
            self.target_size = abs(found.merit)
        columns = [a.asked for a in self.job.answers]
        for k, side in enumerate(self.sides):
            if side.reference == 0.0:
                same = [
                    abs(v)
                    for c, v in zip(columns, found.values, strict=True)
                    if c == columns[side.answer] and np.isfinite(v)
                ]
                self.zero_sizes[k] = max(same, default=0.0) or self.zero_sizes[k]
        count = len(self.job.rules)
        if count:
            sizes, own = np.abs(self._rule_slopes(y)).max(axis=1), np.abs(found.rules[:count])
            self.rule_sizes[:count] = np.where(
                sizes > 0.0, sizes, np.where(np.isfinite(own) & (own > 0.0), own, 1.0)
            )
        ratio = np.concatenate([[self.target_size], self.zero_sizes, self.rule_sizes]) / before
        return bool((np.abs(np.log(ratio)) > np.log(RENEWAL_RATIO)).any())

    def margins_from(self, values: Array, rules: Array) -> Array:
        """Margins (m,) from answers and rule values."""
        own = np.where(np.isposinf(rules), INFINITE_ANSWER_MARGIN, rules / self.rule_sizes)
        return np.concatenate([self._answer_margins(values)[0], own])

    def _answer_margins(self, values: Array) -> tuple[Array, Array]:
        """Margins of all sides of answers, and their derivatives by the answers."""
        v = values[self.answer_of_side]
        sign, reference = np.array([s.sign for s in self.sides]), np.array([s.reference for s in self.sides])
        finite, is_target = np.isfinite(v), self.is_target[: len(self.sides)]
        is_zero = reference == 0.0
        size = np.where(is_zero, self.zero_sizes, reference)
        ratio = np.where(finite, v, 1.0) / size
        least = np.where(is_target, LOG_RATIO_MIN * self.target_size, LOG_RATIO_MIN)
        value, slope = _extended_log(ratio, least)
        value, slope = np.where(is_zero, ratio, value), np.where(is_zero, 1.0, slope)
        good = is_target | (sign * np.sign(v) * np.sign(size) > 0.0)
        infinite = np.where(good, INFINITE_ANSWER_MARGIN, -INFINITE_ANSWER_MARGIN)
        return np.where(finite, sign * value, infinite), np.where(finite, sign * slope / size, 0.0)

    def margins(self, y: Array) -> Array:
        """Margins (m,) at y. Raises DesignFailed where the design has no answers."""
        found = self.design(y)
        margins = self.margins_from(found.values, found.rules)
        # an infinite target never binds, whatever the level of the others
        binding = self.binding_targets(found.values)
        level = margins[binding].min() if binding.any() else 0.0
        return np.where(
            self.is_target & ~binding, np.maximum(margins, level + INFINITE_ANSWER_MARGIN), margins
        )

    def binding_targets(self, values: Array) -> Array:
        """Which margins (m,) are those of finite targets."""
        binding = self.is_target.copy()
        binding[: len(self.sides)] &= np.isfinite(values[self.answer_of_side])
        return binding

    def slopes(self, y: Array) -> Array:
        """Slopes (m, P) of the margins at y, those of rules by differences. Raises DesignFailed."""
        key = y.tobytes()
        if key not in self.raw_slopes:
            x = self.unscaled(y)
            try:
                slopes = self.log.slopes(x, by=self.label)[1]
                rules = np.vstack([self._rule_slopes(y), self._range_slopes(x)])
            except ResumeError:
                raise
            except KsdError as reason:
                raise DesignFailed(y, str(reason)) from reason
            missing = np.isnan(slopes).any(axis=1)
            if missing.any():
                raise DesignFailed(y, f"there is no gradient of {self.job.names[int(np.argmax(missing))]}")
            self.raw_slopes[key] = slopes, rules
        slopes, rules = self.raw_slopes[key]
        inner = np.where(self.is_log, self.unscaled(y), self.parameter_scale)
        outer = self._answer_margins(self.design(y).values)[1]
        return np.vstack(
            [outer[:, None] * slopes[self.answer_of_side] * inner, rules / self.rule_sizes[:, None]]
        )

    def _range_slopes(self, x: Array) -> Array:
        """Slopes (ranges, P) by y of the last rules, the trained ranges."""
        return self.job.range_slopes(x) * np.where(self.is_log, x, self.parameter_scale)

    def _rule_slopes(self, y: Array) -> Array:
        """Slopes (R, P) of the rules of the job that are functions of the parameters; 0 where one is infinite."""
        count = len(self.job.rules)
        h, slopes = 1e-6, np.zeros((count, len(y)))
        for i in range(len(y) if count else 0):
            step = h * (np.arange(len(y)) == i)
            # a parameter at its bound, or where a rule has no value beyond, gets a one-sided difference
            ends = [np.clip(y + s * step, *self.bounds.T) for s in (1, -1)]
            values = [self.rules(self.unscaled(e), shapes=False)[0] for e in ends]
            for k in range(2):
                if np.isnan(values[k]).any():
                    ends[k], values[k] = y, self.design(y).rules[:count]
            finite = np.isfinite(values[0]) & np.isfinite(values[1])
            difference = np.where(finite, values[0], 0.0) - np.where(finite, values[1], 0.0)
            slopes[:, i] = difference / ((ends[0][i] - ends[1][i]) or 1.0)
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
        value = float(self.design(y).values[side.answer])
        return f"{self.job.names[side.answer]}: {format_number(value)}, the limit is {format_number(side.reference)}"

    def is_feasible(self, margins: Array) -> bool:
        """Whether limits and rules are met."""
        return self.violation(margins) <= FEASIBLE_MARGIN


def _sides(job: Job) -> tuple[_Side, ...]:
    """Sides of all answers: one of a target, two of one whose magnitude is minimised, one or two of a limit."""
    sides = []
    for k, a in enumerate(job.answers):
        if a.role != "limit":
            sign, scale = (1.0 if a.role == "maximise" else -1.0), a.scale / a.factor
            sides += [_Side(k, sign, scale, True)]
            sides += [_Side(k, sign, -scale, True)] if a.is_absolute else []
            continue
        # v <= high is log(high / v) >= 0, for negative numbers log(v / high) >= 0
        sides += [_Side(k, -1.0 if a.high >= 0.0 else 1.0, a.high, False)] if np.isfinite(a.high) else []
        sides += [_Side(k, 1.0 if a.low >= 0.0 else -1.0, a.low, False)] if np.isfinite(a.low) else []
    return tuple(sides)
