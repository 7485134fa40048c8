"""Targets and limits of a job, parsed from its arguments into answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ksd.checks import number, show, similar_name_hint
from ksd.errors import SceneError
from ksd.study.questions import columns_above

VALUE_IF_NAN = {"buckling_positive": np.inf, "buckling_negative": -np.inf}
"""Value of an answer that is nan, by the beginning of its column: nothing buckles."""
SIZE_ENDS = ("highest", "lowest")
"""Ends of a size, in the columns of coordinates and in those of sizes of which one end is that of a named leaf spring."""
SIGNED_QUESTIONS = {"force", "parasitic"}
"""Questions whose answers have a sign: where they are minimised, it is their absolute value."""


@dataclass(frozen=True)
class Answer:
    """A target or limit: a column of `ksd.sweep` at a pose, or over all poses (None).

    role: "maximise", "minimise" or "limit"; scale: divisor of a target; low, high: of a limit; factor: multiplies a target
    to make it robust; is_absolute: the absolute value of the answer counts.
    """

    name: str
    column: str
    role: str
    pose: int | None
    scale: float = 1.0
    low: float = -np.inf
    high: float = np.inf
    factor: float = 1.0
    is_absolute: bool = False

    @property
    def asked(self) -> str:
        """The column as it was asked for: "stress_MPa" of "stress_MPa[leaf]"."""
        return self.column.split("[")[0]

    @property
    def is_size(self) -> bool:
        """Whether it is a size along an axis, over all poses."""
        return self.column.startswith("size_")

    @property
    def value_if_nan(self) -> float:
        """Value of the answer where its column is nan."""
        return next((v for begin, v in VALUE_IF_NAN.items() if self.column.startswith(begin)), np.nan)

    def merit(self, value: float) -> float:
        """A target over its scale, larger is better; infinite for a limit."""
        if self.role == "limit":
            return np.inf
        value = abs(value) if self.is_absolute else value
        return (value if self.role == "maximise" else -value) * self.factor / self.scale

    def margins(self, value: float) -> list[float]:
        """Distance to every finite side of a limit over the limit (not divided where it is 0); negative where violated."""
        margins = [(value - self.low) / (abs(self.low) or 1.0)] if np.isfinite(self.low) else []
        return margins + ([(self.high - value) / (abs(self.high) or 1.0)] if np.isfinite(self.high) else [])

    def smooth_parts(self, leaves: Sequence[str]) -> list[Answer]:
        """The answers without kinks that replace this one; leaves: names of the leaf springs.

        The worst of several values has kinks. Where all of them must be on one side, each becomes an answer: stresses and
        sizes, by the leaf spring at either end of them, below; principal stiffnesses and parasitic frequencies above.
        Otherwise the answer stays.
        """
        above = self.role == "maximise" or np.isfinite(self.low)
        below = self.role == "minimise" or np.isfinite(self.high)
        if self.is_size:
            columns = [f"{self.column}[{leaf} {end}]" for end in SIZE_ENDS for leaf in leaves]
        else:
            columns = [f"stress_MPa[{leaf}]" for leaf in leaves if self.column == "stress_MPa"]
        if columns:
            every = [replace(self, column=c, low=-np.inf) for c in columns if below]
            return [replace(self, high=np.inf), *every] if above or self.is_size else every
        return [
            self,
            *(replace(self, column=c, high=np.inf) for c in columns_above(self.column) if above),
        ]

    def moved(self, by: float, value: float) -> Answer:
        """The same answer with its limit moved in by `by`, in units of its column.

        Where a `value` is given (not nan), targets, and limits of its sign, move by the share by / |value| in logarithms.
        """
        # a logarithm is meaningful only for values that are large beside their scatter
        share = by / abs(value) if abs(value) > 2.0 * by and np.isfinite(value) else 0.0
        if self.role == "limit":
            low, high = (
                _moved_end(end, sign * by, share, value) for end, sign in ((self.low, 1), (self.high, -1))
            )
            return replace(self, low=low, high=high)
        return replace(self, factor=float(np.exp(-share if self.role == "maximise" else share)))


def parse_goals(maximise: Any, minimise: Any, limits: Any, known: Mapping[str, str]) -> list[Answer]:
    """Targets and limits without a pose from the arguments of a job; known: the possible columns. Raises SceneError."""
    if (maximise and minimise) or not (maximise or minimise or limits):
        raise SceneError(
            "give one of maximise and minimise, for example maximise='support_worst_N_per_m', or, for ksd.tolerance, limits "
            "alone"
        )
    role, goals = ("maximise", maximise) if maximise else ("minimise", minimise)
    if isinstance(goals, str):
        goals = {goals: 1.0}
    elif not isinstance(goals, Mapping):
        if not isinstance(goals, Sequence) or not all(isinstance(g, str) for g in goals):
            raise SceneError(
                f"{role} = {show(goals)}: give a column, several, or their scales by column, such as {{'stress_MPa': 500}}"
            )
        goals = dict.fromkeys(goals, 1.0)
    answers = []
    for column, scale in goals.items():
        size = number(scale, f"{role}: {column}")
        if size <= 0.0:
            raise SceneError(f"{role}: {column} = {show(scale)}: its scale must be positive")
        answers.append(Answer(column, _check_column(column, known), role, None, size))
    if limits is not None and not isinstance(limits, Mapping):
        raise SceneError(f"limits = {show(limits)}: give limits by column, such as {{'stress_MPa': 500}}")
    for column, given in (limits or {}).items():
        if column == "size_mm":
            sizes = given if isinstance(given, Sequence | np.ndarray) else ()
            if len(sizes) != 3 or all(most is None for most in sizes):
                raise SceneError(
                    f"limits: size_mm = {show(given)}: give the most along x, y and z, None for no limit"
                )
            for axis, most in zip("xyz", sizes, strict=True):
                if most is not None:
                    own = f"size_{axis}_mm"
                    answers.append(Answer(own, own, "limit", None, high=number(most, f"limits: {own}")))
            continue
        both = given if isinstance(given, Sequence) and not isinstance(given, str) else (None, given)
        if len(both) != 2 or both[0] is both[1] is None:
            raise SceneError(
                f"limits: {column} = {show(given)}: give the most, or (least, most), None for neither"
            )
        low, high = (
            side * np.inf if v is None else number(v, f"limits: {column}")
            for v, side in zip(both, (-1, 1), strict=True)
        )
        if not low < high:
            raise SceneError(
                f"limits: {column} = {show(given)} holds nothing: the least must be below the most"
            )
        answers.append(Answer(column, _check_column(column, known), "limit", None, low=low, high=high))
    return answers


def _check_column(column: Any, known: Mapping[str, str]) -> str:
    """The column; raises SceneError for one that does not exist."""
    if column not in known:
        raise SceneError(
            f"there is no answer {show(column)}; there are {', '.join(known)}{similar_name_hint(column, known)}"
        )
    return str(column)


def _moved_end(end: float, by: float, share: float, value: float) -> float:
    """An end of a limit moved by `by`, or by a share in logarithms where it has the sign of the value."""
    if share == 0.0 or not np.isfinite(end) or end * value <= 0.0:
        return end + by
    return end * float(np.exp(np.sign(by * end) * share))
