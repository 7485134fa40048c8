"""What a job is judged by: targets and limits, in words and as answers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ksd.checks import number, show, similar_name_hint
from ksd.design.questions import other_principal_columns
from ksd.errors import SceneError

INFINITE = {"support": np.inf, "buckling_positive": np.inf, "buckling_negative": -np.inf}
"""What an answer that is no number stands for, by the beginning of its column: nothing moves, or nothing buckles."""
SIGNED_QUESTIONS = {"force", "parasitic"}
"""Questions whose answers have a sign: of what is minimised their size counts."""


@dataclass(frozen=True)
class Answer:
    """One number a design is judged by: a column of `ksd.sweep` at a pose, or over all of them (None).

    role: "maximise", "minimise" or "limit"; scale: what a target is measured in; low, high: of a limit; factor: by which a
    target is multiplied before it counts; amount: its size is the answer.
    """

    name: str
    column: str
    role: str
    pose: int | None
    scale: float = 1.0
    low: float = -np.inf
    high: float = np.inf
    factor: float = 1.0
    amount: bool = False

    @property
    def infinite(self) -> float:
        """What it stands for where it is no number; nan where that is nothing."""
        return next((v for begin, v in INFINITE.items() if self.column.startswith(begin)), np.nan)

    def merit(self, value: float) -> float:
        """A target over its scale, larger is better; infinite for a limit, which is none."""
        if self.role == "limit":
            return np.inf
        return (value if self.role == "maximise" else -value) * self.factor / self.scale

    def margins(self, value: float) -> list[float]:
        """How far every side of a limit is met, over the limit (by itself where that is 0); negative where it is not."""
        found = [(value - self.low) / (abs(self.low) or 1.0)] if np.isfinite(self.low) else []
        return found + ([(self.high - value) / (abs(self.high) or 1.0)] if np.isfinite(self.high) else [])

    def parts(self, leaves: Sequence[str]) -> list[Answer]:
        """The answers that it asks for at a pose: the worst of several has kinks, so where all of them are to be on one side
        each is an answer: stresses (columns `leaves`) below, principal stiffnesses above. Else it is one itself."""
        above = self.role == "maximise" or np.isfinite(self.low)
        if self.column == "stress_MPa":
            below = self.role == "minimise" or np.isfinite(self.high)
            every = [replace(self, column=c, low=-np.inf) for c in leaves if below]
            return [*every, replace(self, high=np.inf)] if above else every
        return [
            self,
            *(replace(self, column=c, high=np.inf) for c in other_principal_columns(self.column) if above),
        ]

    def moved(self, by: float, value: float) -> Answer:
        """The same with a limit moved in by this much, in units of its column; where a `value` is given (not nan), limits of
        its sign, and targets, by that share of it in logarithms."""
        # far from what it scatters by; else its logarithm says nothing
        share = by / abs(value) if abs(value) > 2.0 * by and np.isfinite(value) else 0.0
        if self.role == "limit":
            low, high = (
                _moved(end, sign * by, share, value) for end, sign in ((self.low, 1), (self.high, -1))
            )
            return replace(self, low=low, high=high)
        return replace(self, factor=float(np.exp(-share if self.role == "maximise" else share)))


def goals_of(maximise: Any, minimise: Any, limits: Any, known: Mapping[str, str]) -> list[Answer]:
    """Every target and limit, of no pose yet; known: columns there are. Raises SceneError."""
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
    found = []
    for column, scale in goals.items():
        size = number(scale, f"{role}: {column}")
        if size <= 0.0:
            raise SceneError(f"{role}: {column} = {show(scale)}: its scale must be positive")
        found.append(Answer(column, _column(column, known), role, None, size))
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
                    found.append(Answer(own, own, "limit", None, high=number(most, f"limits: {own}")))
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
        found.append(Answer(column, _column(column, known), "limit", None, low=low, high=high))
    return found


def _column(column: Any, known: Mapping[str, str]) -> str:
    if column not in known:
        raise SceneError(
            f"there is no answer {show(column)}; there are {', '.join(known)}{similar_name_hint(column, known)}"
        )
    return str(column)


def _moved(end: float, by: float, share: float, value: float) -> float:
    """An end of a limit moved by this much, or by a share of it where it is of the sign of the value."""
    if share == 0.0 or not np.isfinite(end) or end * value <= 0.0:
        return end + by
    return end * float(np.exp(np.sign(by * end) * share))
