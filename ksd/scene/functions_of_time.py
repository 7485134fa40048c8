"""Functions of time that drives, loads and the base follow.

A function has a value, its first three time derivatives (right-sided), the instants at which its value or a derivative
jumps, and its shortest duration, from which the step in time is chosen.
"""

from __future__ import annotations

import math
from abc import ABCMeta, abstractmethod
from collections.abc import Callable
from dataclasses import KW_ONLY, dataclass, fields, replace
from functools import cached_property
from itertools import pairwise
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.checks import ClearArgumentErrors, boolean, not_negative, number, positive, show
from ksd.errors import SceneError
from ksd.scene.formula import Formula, dimension_of, si_value
from ksd.scene.toml_table import quantity

Array = NDArray[np.float64]
Rates = tuple[float, float, float]
Jumps = tuple[tuple[float, int], ...]
DIFFERENCE_STEP = 1e-4
"""Step [s] of the differences that stand for the derivatives of formulas and functions of the user."""
JUMP_INTERVALS, MOST_JUMPS, KINK_HALVINGS = 256, 16, 12
"""Intervals among which jumps of functions of the user are looked for, the most of them, and how often one of the slope is
closed in by half."""
_DIFFERENCES = np.linalg.solve(
    np.vander(np.arange(6.0), increasing=True).T, np.diag([1.0, 1, 2, 6, 24, 120])
)[:, 1:4]
"""Weights (6, 3) of values at 0, 1, ... 5 in the first three derivatives at 0."""


class _Kind(ABCMeta, ClearArgumentErrors):
    """Metaclass of functions of time: abstract, with one sentence for arguments that do not match."""


class FunctionOfTime(metaclass=_Kind):
    """A function of time t [s], zero or above.

    dimension: of the unit its values were given in, None for plain numbers.
    """

    dimension: str | None = None

    def __call__(self, t: Any) -> Any:
        """Value at an instant, or values (n,) at instants (n,)."""
        values = self._values(np.asarray(t, float))
        return float(values) if np.ndim(t) == 0 else values

    @abstractmethod
    def _values(self, t: Array) -> Array:
        """Values at instants of any shape."""

    @abstractmethod
    def rates(self, t: float) -> Rates:
        """First, second and third time derivative, just after t."""

    @property
    def jumps(self) -> Jumps:
        """Instants of jumps, each with the order of the lowest derivative that jumps there: 0 the value itself."""
        return ()

    @property
    def shortest(self) -> float:
        """Shortest duration [s] of a part, inf where there is none."""
        return math.inf

    def within(self, until: float) -> FunctionOfTime:
        """The function with its jumps up to the instant `until` [s]."""
        return self

    def before(self, t: float) -> float:
        """Value just before an instant: a step at t = 0 is not yet made when motion starts."""
        jumped = any(order == 0 and at == t for at, order in self.jumps)
        return float(self(np.nextafter(t, -math.inf))) if jumped else float(self(t))

    def __add__(self, other: FunctionOfTime) -> Sum:
        return Sum((*_parts(self), *_parts(other)))

    def _set(self, **checked: Any) -> None:
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    def _check_values(self, *names: str) -> None:
        """Values of the function to SI: numbers, or texts with a unit, all of one dimension."""
        given = {name: getattr(self, name) for name in names}
        found = {dimension_of(v) for v in given.values() if isinstance(v, str)}
        if len(found) > 1:
            raise SceneError(f"{type(self).__name__}: {show(given)} are of different dimensions")
        self._set(dimension=next(iter(found), None))
        self._set(**{n: si_value(v, f"{type(self).__name__}: {n}") for n, v in given.items()})

    def _check_times(self, *durations: str, delay: str = "") -> None:
        """Times to SI: positive durations, and an instant that is not negative."""
        owner = type(self).__name__
        for name in durations:
            self._set(
                **{name: positive(_seconds(getattr(self, name), name, owner), name, owner=owner, unit="s")}
            )
        if delay:
            self._set(
                **{
                    delay: not_negative(
                        _seconds(getattr(self, delay), delay, owner), delay, owner=owner, unit="s"
                    )
                }
            )


def _seconds(value: Any, name: str, owner: str) -> float:
    return quantity(value, "time", f"{owner}: {name}")


def _parts(given: Any) -> tuple[FunctionOfTime, ...]:
    if not isinstance(given, FunctionOfTime):
        raise SceneError(f"{show(given)} cannot be added to a function of time; add another function of time")
    return given.parts if isinstance(given, Sum) else (given,)


@dataclass(frozen=True)
class Sum(FunctionOfTime):
    """The sum of functions of time, written with +."""

    parts: tuple[FunctionOfTime, ...]

    def __post_init__(self) -> None:
        self._set(dimension=next((p.dimension for p in self.parts if p.dimension), None))

    def _values(self, t: Array) -> Array:
        return np.asarray(sum(np.asarray(p(t)) for p in self.parts))

    def rates(self, t: float) -> Rates:
        first, second, third = (float(sum(r)) for r in zip(*(p.rates(t) for p in self.parts), strict=True))
        return first, second, third

    @property
    def jumps(self) -> Jumps:
        lowest: dict[float, int] = {}
        for at, order in sorted(jump for p in self.parts for jump in p.jumps):
            lowest[at] = min(order, lowest.get(at, order))
        return tuple(lowest.items())

    @property
    def shortest(self) -> float:
        return min(p.shortest for p in self.parts)


@dataclass(frozen=True)
class Step(FunctionOfTime):
    """`end` from the instant `delay` [s] on, `start` before it.

    >>> step = ksd.Step(2.0, delay=0.1)
    >>> step(0.05), step(0.2)
    (0.0, 2.0)
    """

    end: float = 1.0
    _: KW_ONLY
    start: float = 0.0
    delay: float = 0.0

    def __post_init__(self) -> None:
        self._check_values("end", "start")
        self._check_times(delay="delay")

    def _values(self, t: Array) -> Array:
        return np.where(t < self.delay, self.start, self.end)

    def rates(self, t: float) -> Rates:
        return 0.0, 0.0, 0.0

    @property
    def jumps(self) -> Jumps:
        return ((self.delay, 0),) if self.start != self.end else ()


class _Stroke(FunctionOfTime):
    """From `start` to `end` in `duration` [s] from the instant `delay` [s] on, by a law of the share u of the duration."""

    start: float
    end: float
    duration: float
    delay: float

    def __post_init__(self) -> None:
        self._check_values("end", "start")
        self._check_times("duration", delay="delay")

    @abstractmethod
    def _law(self, u: Array) -> tuple[Array, Array, Array, Array]:
        """Share of the stroke and its derivatives by u, for 0 <= u <= 1."""

    @property
    @abstractmethod
    def _kinks(self) -> Jumps:
        """Shares of the duration at which a derivative jumps, with its order."""

    def _values(self, t: Array) -> Array:
        share = self._law(np.clip((t - self.delay) / self.duration, 0.0, 1.0))[0]
        return np.asarray(self.start + (self.end - self.start) * share)

    def rates(self, t: float) -> Rates:
        u = (t - self.delay) / self.duration
        if not 0.0 <= u < 1.0:
            return 0.0, 0.0, 0.0
        _, *rates = self._law(np.asarray(u))
        first, second, third = (
            (self.end - self.start) * float(r) / self.duration**k for k, r in enumerate(rates, 1)
        )
        return first, second, third

    @property
    def jumps(self) -> Jumps:
        return tuple((self.delay + u * self.duration, order) for u, order in self._kinks)

    @property
    def shortest(self) -> float:
        return self.duration


@dataclass(frozen=True)
class Ramp(_Stroke):
    """A rise from `start` to `end` in `duration` [s] from the instant `delay` [s] on, by half a cosine, or straight.

    >>> rise = ksd.Ramp(0.1, end=5 * mm)
    >>> [round(rise(t) / mm, 3) for t in (0, 0.05, 0.1, 1.0)]
    [0.0, 2.5, 5.0, 5.0]
    """

    duration: float
    _: KW_ONLY
    end: float = 1.0
    start: float = 0.0
    straight: bool = False
    delay: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        boolean(self.straight, "straight", owner="Ramp")

    def _law(self, u: Array) -> tuple[Array, Array, Array, Array]:
        if self.straight:
            return u, np.ones_like(u), np.zeros_like(u), np.zeros_like(u)
        w = math.pi
        c, s = np.cos(w * u), np.sin(w * u)
        return 0.5 * (1.0 - c), 0.5 * w * s, 0.5 * w**2 * c, -0.5 * w**3 * s

    @property
    def _kinks(self) -> Jumps:
        order = 1 if self.straight else 2
        return (0.0, order), (1.0, order)


@dataclass(frozen=True)
class Cycloid(_Stroke):
    """A stroke to `end` in `duration` [s] with accelerations of a whole sine, which are zero at both ends.

    start: value before it; delay [s]: instant at which it starts.

    >>> stroke = ksd.Cycloid(5 * mm, duration=0.2)
    >>> [round(stroke(t) / mm, 4) for t in (0, 0.05, 0.1, 0.2)]
    [0.0, 0.4542, 2.5, 5.0]
    """

    end: float
    _: KW_ONLY
    duration: float
    start: float = 0.0
    delay: float = 0.0

    def _law(self, u: Array) -> tuple[Array, Array, Array, Array]:
        w = 2.0 * math.pi
        c, s = np.cos(w * u), np.sin(w * u)
        return u - s / w, 1.0 - c, w * s, w**2 * c

    @property
    def _kinks(self) -> Jumps:
        return (0.0, 3), (1.0, 3)


@dataclass(frozen=True)
class Trapezoid(_Stroke):
    """A stroke to `end` in `duration` [s] whose speed rises for `rise` [s], stays, and falls for as long.

    rise: a third of the duration when None, at most half of it; start: value before it; delay [s]: instant at which it
    starts.

    >>> stroke = ksd.Trapezoid(6 * mm, duration=0.3)
    >>> [round(stroke(t) / mm, 3) for t in (0.1, 0.15, 0.3)]
    [1.5, 3.0, 6.0]
    """

    end: float
    _: KW_ONLY
    duration: float
    rise: float | None = None
    start: float = 0.0
    delay: float = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.rise is None:
            self._set(rise=self.duration / 3.0)
        self._check_times("rise")
        if self._share > 0.5 * (1.0 + 1e-12):
            raise SceneError(
                f"Trapezoid: rise = {self.rise:g} s is more than half of its duration of {self.duration:g} s"
            )

    @property
    def _share(self) -> float:
        assert self.rise is not None
        return self.rise / self.duration

    def _law(self, u: Array) -> tuple[Array, Array, Array, Array]:
        rise = min(self._share, 0.5)
        speed = 1.0 / (1.0 - rise)
        rising, falling, zero = u < rise, u >= 1.0 - rise, np.zeros_like(u)
        left = 1.0 - u
        share = np.where(
            rising, u**2 / (2 * rise), np.where(falling, 1 / speed - left**2 / (2 * rise), u - rise / 2)
        )
        rate = np.where(rising, u / rise, np.where(falling, left / rise, 1.0))
        return (
            speed * share,
            speed * rate,
            speed * np.where(rising, 1.0, np.where(falling, -1.0, zero)) / rise,
            zero,
        )

    @property
    def _kinks(self) -> Jumps:
        return tuple((u, 2) for u in sorted({0.0, self._share, 1.0 - self._share, 1.0}))

    @property
    def shortest(self) -> float:
        assert self.rise is not None
        return self.rise


@dataclass(frozen=True)
class HalfSine(FunctionOfTime):
    """A pulse amplitude * sin(pi t / duration) of `duration` [s] from the instant `delay` [s] on, zero before and after.

    >>> pulse = ksd.HalfSine(20.0, duration=10e-3)
    >>> [round(pulse(t), 3) for t in (0, 5e-3, 20e-3)]
    [0.0, 20.0, 0.0]
    """

    amplitude: float
    _: KW_ONLY
    duration: float
    delay: float = 0.0

    def __post_init__(self) -> None:
        self._check_values("amplitude")
        self._check_times("duration", delay="delay")

    def _values(self, t: Array) -> Array:
        u = (t - self.delay) / self.duration
        return np.where((u > 0.0) & (u < 1.0), self.amplitude * np.sin(math.pi * u), 0.0)

    def rates(self, t: float) -> Rates:
        u, w = (t - self.delay) / self.duration, math.pi / self.duration
        if not 0.0 <= u < 1.0:
            return 0.0, 0.0, 0.0
        c, s = self.amplitude * math.cos(math.pi * u), self.amplitude * math.sin(math.pi * u)
        return w * c, -(w**2) * s, -(w**3) * c

    @property
    def jumps(self) -> Jumps:
        return (self.delay, 1), (self.delay + self.duration, 1)

    @property
    def shortest(self) -> float:
        return self.duration


@dataclass(frozen=True)
class Sine(FunctionOfTime):
    """offset + amplitude * sin(2 pi frequency_Hz t + phase), phase [rad].

    >>> wave = ksd.Sine(2 * mm, frequency_Hz=50)
    >>> [round(wave(t) / mm, 3) for t in (0, 5e-3, 15e-3)]
    [0.0, 2.0, -2.0]
    """

    amplitude: float
    _: KW_ONLY
    frequency_Hz: float
    phase: float = 0.0
    offset: float = 0.0

    def __post_init__(self) -> None:
        self._check_values("amplitude", "offset")
        frequency = quantity(self.frequency_Hz, "frequency", "Sine: frequency_Hz")
        self._set(
            frequency_Hz=positive(frequency, "frequency_Hz", owner="Sine", unit="Hz"),
            phase=quantity(self.phase, "angle", "Sine: phase"),
        )

    def _values(self, t: Array) -> Array:
        return np.asarray(
            self.offset + self.amplitude * np.sin(2.0 * math.pi * self.frequency_Hz * t + self.phase)
        )

    def rates(self, t: float) -> Rates:
        w = 2.0 * math.pi * self.frequency_Hz
        c, s = self.amplitude * math.cos(w * t + self.phase), self.amplitude * math.sin(w * t + self.phase)
        return w * c, -(w**2) * s, -(w**3) * c

    @property
    def shortest(self) -> float:
        return 1.0 / self.frequency_Hz


@dataclass(frozen=True)
class TimeTable(FunctionOfTime):
    """A function of time by points (t [s], value), straight between them.

    smooth: cubic splines instead, of steady speed and acceleration, at rest at both ends. held: the first value holds
    before and the last one after the table; otherwise it is zero there.

    >>> stroke = ksd.TimeTable(((0, 0), (0.1, 5 * mm), (0.2, 5 * mm)))
    >>> stroke(0.05) / mm, stroke(1.0) / mm
    (2.5, 5.0)
    """

    points: tuple[tuple[float, float], ...]
    _: KW_ONLY
    smooth: bool = False
    held: bool = True

    def __post_init__(self) -> None:
        rows = self.points.tolist() if isinstance(self.points, np.ndarray) else self.points
        if not isinstance(rows, list | tuple) or any(
            not isinstance(row, list | tuple) or len(row) != 2 for row in rows
        ):
            raise SceneError(f"table of time: {show(self.points)} must be points (time [s], value).")
        found = {dimension_of(v) for _, v in rows if isinstance(v, str)}
        clean = tuple(
            (quantity(t, "time", "table of time: time"), si_value(v, "table of time: value")) for t, v in rows
        )
        if len(clean) < 2 or any(b[0] <= a[0] for a, b in pairwise(clean)):
            raise SceneError(
                f"table of time: {show(self.points)} needs two points or more, at times that rise."
            )
        for name in ("smooth", "held"):
            boolean(getattr(self, name), name, owner="table of time")
        self._set(points=clean, dimension=next(iter(found), None))

    @property
    def duration(self) -> float:
        """Time of the last point [s]."""
        return self.points[-1][0]

    @cached_property
    def _knots(self) -> tuple[Array, Array]:
        t, values = np.array(self.points).T
        return t, values

    @cached_property
    def _slopes(self) -> Array:
        """Speeds (n,) at the points of a spline at rest at both ends, by elimination of its three-term equations."""
        t, values = self._knots
        step = np.diff(t)
        right = 3.0 * np.diff(values) / step**2
        slopes, factor = np.zeros_like(t), np.zeros_like(t)
        for i in range(1, len(t) - 1):
            pivot = 2.0 * (1.0 / step[i - 1] + 1.0 / step[i]) - factor[i - 1] / step[i - 1]
            slopes[i] = (right[i - 1] + right[i] - slopes[i - 1] / step[i - 1]) / pivot
            factor[i] = 1.0 / step[i] / pivot
        for i in range(len(t) - 2, 0, -1):
            slopes[i] -= factor[i] * slopes[i + 1]
        return slopes

    def _cubic(self, t: Array) -> tuple[Array, Array, Array, Array]:
        """Value and three derivatives of the spline at instants within the table."""
        at, values = self._knots
        k = np.clip(np.searchsorted(at, t, side="right") - 1, 0, len(at) - 2)
        h, u = at[k + 1] - at[k], t - at[k]
        mean = (values[k + 1] - values[k]) / h
        first, last = self._slopes[k], self._slopes[k + 1]
        b, c = (3.0 * mean - 2.0 * first - last) / h, (first + last - 2.0 * mean) / h**2
        return (
            values[k] + u * (first + u * (b + u * c)),
            first + u * (2.0 * b + 3.0 * u * c),
            2.0 * b + 6.0 * u * c,
            6.0 * c,
        )

    def _values(self, t: Array) -> Array:
        at, values = self._knots
        inside = self._cubic(np.clip(t, at[0], at[-1]))[0] if self.smooth else np.interp(t, at, values)
        return np.asarray(inside if self.held else np.where((t < at[0]) | (t > at[-1]), 0.0, inside))

    def rates(self, t: float) -> Rates:
        at, values = self._knots
        if not at[0] <= t < at[-1]:
            return 0.0, 0.0, 0.0
        if self.smooth:
            _, first, second, third = (float(v) for v in self._cubic(np.asarray(t)))
            return first, second, third
        k = int(np.searchsorted(at, t, side="right"))
        return float((values[k] - values[k - 1]) / (at[k] - at[k - 1])), 0.0, 0.0

    @property
    def jumps(self) -> Jumps:
        at, values = self._knots
        found = [(float(t), 2 if t in at[[0, -1]] else 3) for t in at]
        if not self.smooth:
            slopes = np.concatenate([[0.0], np.diff(values) / np.diff(at), [0.0]])
            found = [(float(t), 1) for t, change in zip(at, np.diff(slopes), strict=True) if change != 0.0]
        if not self.held:
            ends = {float(t): 0 for t, v in zip(at[[0, -1]], values[[0, -1]], strict=True) if v != 0.0}
            found = sorted({**dict(found), **ends}.items())
        return tuple(found)

    @property
    def shortest(self) -> float:
        return float(np.diff(self._knots[0]).min())


@dataclass(frozen=True)
class OfUser(FunctionOfTime):
    """A function of the user, or a formula; its derivatives are differences just after t, its jumps are looked for."""

    function: Callable[[float], float]
    what: str = "function of time"
    formula: str = ""
    found: Jumps = ()

    def _values(self, t: Array) -> Array:
        return np.asarray([self._value(float(one)) for one in t.flat]).reshape(t.shape)

    def _value(self, t: float) -> float:
        try:
            value = self.function(t)
        except SceneError:
            raise
        except Exception as reason:
            raise SceneError(
                f"{self.what} raises {type(reason).__name__} at t = {t:g} s: {show(str(reason))}; "
                "it must return a number at every instant"
            ) from reason
        return number(value, f"{self.what} at t = {t:g} s")

    @property
    def jumps(self) -> Jumps:
        return self.found

    def within(self, until: float) -> OfUser:
        t = np.linspace(0.0, until, JUMP_INTERVALS + 1)
        values = self._values(t)
        found: dict[float, int] = {}
        for order, narrow in enumerate((self._jump, self._kink)):
            size = np.abs(np.diff(values, n=order + 1))
            for k in np.argsort(-size)[:MOST_JUMPS].tolist():
                if size[k] > 1e-9 * np.ptp(values):
                    at = narrow(float(t[k]), float(t[k + order + 1]))
                    if at is not None and all(abs(at - other) > 1e-6 * until for other in found):
                        found[at] = order
        return replace(self, found=tuple(sorted(found.items())))

    def _jump(self, a: float, b: float) -> float | None:
        """The first instant after a jump of the value between a and b, None where most of the change is steady."""
        first, last = self._value(a), self._value(b)
        least = 0.5 * abs(last - first)
        while a < (middle := 0.5 * (a + b)) < b:
            value = self._value(middle)
            if abs(value - first) > abs(last - value):
                b, last = middle, value
            else:
                a, first = middle, value
            if abs(last - first) < least:
                return None
        return b

    def _kink(self, a: float, b: float) -> float | None:
        """The instant between a and b at which the slope jumps, None where it changes steadily.

        Half the distance leaves a quarter of the second difference where it does, and half of it at a jump.
        """
        whole, known = b - a, 0.0
        for _ in range(KINK_HALVINGS):
            at = np.linspace(a, b, 5)
            change = np.abs(np.diff(self._values(at), n=2))
            k = int(np.argmax(change))
            a, b = float(at[k]), float(at[k + 2])
            known = known or float(change[k])
            if change[k] < 0.8 * known * (b - a) / whole:
                return None
        return 0.5 * (a + b)

    def rates(self, t: float) -> Rates:
        values = np.array([self._value(t + k * DIFFERENCE_STEP) for k in range(6)])
        first, second, third = (
            float(values @ w) / DIFFERENCE_STEP**k for k, w in enumerate(_DIFFERENCES.T, 1)
        )
        return first, second, third


def refuse_change(function: FunctionOfTime, what: str, t: float) -> None:
    """Raise SceneError for a function that returns another value when it is called again."""
    if function(t) != function(t):
        raise SceneError(
            f"{what}: it returns another value each time it is called with t = {t:g}; give a function of t alone"
        )


def as_function_of_time(given: Any, what: str) -> FunctionOfTime:
    """A function of time from one, a callable of t [s], points (t, value), a formula such as "1 - exp(-t / 5 ms)", or a
    number that stays.

    `what` names it in messages. Raises SceneError for anything else, and for a callable that returns another
    value each time.
    """
    if isinstance(given, FunctionOfTime):
        return given
    if callable(given):
        checked = OfUser(given, what)
        refuse_change(checked, what, 0.0)
        return checked
    if isinstance(given, list | tuple | np.ndarray):
        return TimeTable(given)  # type: ignore[arg-type]
    if isinstance(given, str) and dimension_of(given) is None:
        formula = Formula(given)
        written = OfUser(lambda t: formula({"t": t}), what, formula=given)
        written(0.0)
        return written
    if isinstance(given, str | Real) and not isinstance(given, bool):
        return Step(given, start=given)  # type: ignore[arg-type]
    raise SceneError(
        f"{what} = {show(given)}: give a function of time such as ksd.Ramp('20 ms'), a function of t, points (t [s], "
        "value), a formula, or a number"
    )


KINDS: dict[str, tuple[type[FunctionOfTime], str]] = {
    "ramp": (Ramp, "duration"), "cycloid": (Cycloid, "end"), "trapezoid": (Trapezoid, "end"), "step": (Step, "end"),
    "half_sine": (HalfSine, "amplitude"), "sine": (Sine, "amplitude"), "table": (TimeTable, "points"),
}  # fmt: skip
"""Functions of time in files: the key that says which, with its class and the parameter that the key holds."""


def function_of_table(table: Any, what: str) -> FunctionOfTime:
    """A function of time from a table of a file: `ramp = "20 ms"` and the like with its parameters, `formula = "..."`,
    `value = 1`, or a list of tables whose functions are added. Raises SceneError."""
    if isinstance(table, list) and table and all(isinstance(one, dict) for one in table):
        return Sum(tuple(function_of_table(one, what) for one in table))
    let_go = ", or { let_go = true }" if what.startswith("drive") else ""
    if not isinstance(table, dict):
        raise SceneError(f'{what} = {show(table)}: write a table such as {{ ramp = "20 ms" }}{let_go}')
    words = dict(table)
    kinds = [key for key in words if key in KINDS or key in ("formula", "value")]
    if len(kinds) != 1:
        raise SceneError(
            f"{what}: write one of {', '.join((*KINDS, 'formula', 'value'))}{let_go}; there is "
            + (" and ".join(kinds) or "none of them")
        )
    first = words.pop(kinds[0])
    if kinds[0] in KINDS:
        made, parameter = KINDS[kinds[0]]
        return made(**{parameter: first}, **words)
    if words:
        raise SceneError(f"{what}: key '{next(iter(words))}' does not belong to a {kinds[0]}")
    return as_function_of_time(first, f"{what}: {kinds[0]} '{first}'")


def table_of_function(function: FunctionOfTime, what: str) -> Any:
    """The table of a file from which `function_of_table` makes the function again. Raises SceneError for one of the user."""
    if isinstance(function, Sum):
        return [table_of_function(part, what) for part in function.parts]
    if isinstance(function, OfUser):
        if not function.formula:
            raise SceneError(
                f"{what} is a function of Python, which cannot be written to a file; write it as a formula in t"
            )
        return {"formula": function.formula}
    kind = next(key for key, (made, _) in KINDS.items() if type(function) is made)
    parameter = KINDS[kind][1]
    others = {f.name: getattr(function, f.name) for f in fields(function) if f.name != parameter}  # type: ignore[arg-type]
    defaults = {f.name: f.default for f in fields(function)}  # type: ignore[arg-type]
    return {kind: getattr(function, parameter)} | {n: v for n, v in others.items() if v != defaults[n]}
