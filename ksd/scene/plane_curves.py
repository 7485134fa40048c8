"""Shapes of a leaf at rest by a few numbers: curvature along it, for `ksd.FreeCurve`; all in its plane.

They are frozen values, so that curves of equal numbers are equal, and stand in scene files.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
from numpy.polynomial import legendre

from ksd.checks import number, positive, show
from ksd.errors import SceneError

MAX_NEWTON_STEPS = 30
"""Most Newton steps to where a spline has a given length."""
CHORD_QUADRATURE, LENGTH_QUADRATURE = legendre.leggauss(128), legendre.leggauss(16)
"""Points and weights by which chords are measured, and the lengths of splines."""
Points = tuple[tuple[float, ...], ...]


class PlaneCurvature:
    """Curvature about e3 [1/m] at fractions s, of any shape, of a curve of this `length` [m]; kind: its name in files."""

    kind: ClassVar[str]
    length: Any

    def bend(self, s: np.ndarray) -> np.ndarray:
        """As s."""
        raise NotImplementedError

    def __call__(self, s: Any) -> np.ndarray:
        """About e1, e2 and e3 (..., 3)."""
        at = np.asarray(s, float)
        found = np.zeros((*at.shape, 3))
        found[..., 2] = self.bend(at)
        return found


@dataclass(frozen=True)
class Sine(PlaneCurvature):
    """Angle sum_i c_i sin(2 pi i s)."""

    amplitudes: tuple[float, ...]
    length: float
    kind = "sine"

    @property
    def waves(self) -> np.ndarray:
        """2 pi i."""
        return 2.0 * np.pi * np.arange(1, len(self.amplitudes) + 1)

    def angle(self, s: np.ndarray) -> np.ndarray:
        """[rad], as s."""
        return np.asarray(np.sin(s[..., None] * self.waves) @ np.array(self.amplitudes))

    def bend(self, s: np.ndarray) -> np.ndarray:
        """[1/m], as s."""
        return np.asarray(np.cos(s[..., None] * self.waves) @ (self.waves * self.amplitudes)) / self.length


@dataclass(frozen=True)
class Legendre(PlaneCurvature):
    """Curvature times length sum_i c_ki P_i(x), x from -1 to 1 along piece k; breaks: where pieces meet."""

    pieces: Points
    length: float
    breaks: tuple[float, ...] = ()
    kind = "legendre"

    @property
    def coefficients(self) -> Any:
        """As they are said: a list for every piece, or of the only one."""
        return self.pieces if self.breaks else self.pieces[0]

    def angle(self, s: np.ndarray) -> np.ndarray:
        """[rad], as s, of a curve of one piece."""
        return np.asarray(legendre.legval(2.0 * s - 1.0, 0.5 * legendre.legint(self.pieces[0], lbnd=-1)))

    @cached_property
    def _table(self) -> tuple[np.ndarray, np.ndarray]:
        """Ends of the pieces, and their coefficients (pieces, n)."""
        found = np.zeros((len(self.pieces), max(map(len, self.pieces))))
        for row, own in zip(found, self.pieces, strict=True):
            row[: len(own)] = own
        return np.array([0.0, *self.breaks, 1.0]), found / self.length

    def bend(self, s: np.ndarray) -> np.ndarray:
        """[1/m], as s."""
        ends, c = self._table
        k = np.searchsorted(ends[1:-1], s, side="right")
        x = 2.0 * (s - ends[k]) / (ends[k + 1] - ends[k]) - 1.0
        return np.asarray((legendre.legvander(x, c.shape[1] - 1) * c[k]).sum(axis=-1))


@dataclass(frozen=True)
class Spline(PlaneCurvature):
    """Cubic spline through points (x, y) [m], over the distances between them, of these angles [rad] at its ends."""

    points: Points
    start: float | None
    end: float | None
    kind = "spline"

    @cached_property
    def _parts(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Points, distances between them, second derivatives at them, and lengths up to them."""
        r = np.array(self.points)
        apart = np.hypot(*np.diff(r, axis=0).T)
        ways = [None if a is None else np.array([np.cos(a), np.sin(a)]) for a in (self.start, self.end)]
        bends = _second_derivatives(r, apart, ways)
        k = np.arange(len(apart))
        own = self._gone((r, apart, bends), k, np.ones(len(k)))
        return r, apart, bends, np.cumsum([0.0, *own.tolist()])

    @property
    def length(self) -> float:
        """[m]."""
        return float(self._parts[3][-1])

    @staticmethod
    def _line(parts: Any, k: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First and second derivative by the distance, at fractions t of segments k."""
        r, apart, bends = parts
        h, t = apart[k][..., None], t[..., None]
        rise = (3 * t**2 - 1) * bends[k + 1] - (3 * (1 - t) ** 2 - 1) * bends[k]
        return (r[k + 1] - r[k]) / h + h / 6 * rise, (1 - t) * bends[k] + t * bends[k + 1]

    @classmethod
    def _gone(cls, parts: Any, k: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Lengths from the start of segments k."""
        x, w = LENGTH_QUADRATURE
        first, _ = cls._line(parts, k[..., None], 0.5 * t[..., None] * (x + 1.0))
        return np.asarray(0.5 * t * parts[1][k] * (np.hypot(first[..., 0], first[..., 1]) @ w))

    def bend(self, s: np.ndarray) -> np.ndarray:
        """[1/m], as s."""
        *parts, ends = self._parts
        at = s * ends[-1]
        k = np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(ends) - 2)
        t = (at - ends[k]) / (ends[k + 1] - ends[k])
        for _ in range(MAX_NEWTON_STEPS):
            first, _ = self._line(parts, k, t)
            step = (at - ends[k] - self._gone(parts, k, t)) / (
                parts[1][k] * np.hypot(first[..., 0], first[..., 1])
            )
            t = t + step
            if np.abs(step).max(initial=0.0) < 1e-14:
                break
        first, second = self._line(parts, k, t)
        turn = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
        return np.asarray(turn / np.hypot(first[..., 0], first[..., 1]) ** 3)


def finite_numbers(values: Any, what: str, owner: str) -> tuple[float, ...]:
    """One or more finite numbers. Raises SceneError."""
    try:
        found = np.atleast_1d(np.asarray(values, float))
    except (TypeError, ValueError, OverflowError):
        found = np.zeros((0, 0))
    if found.ndim != 1 or not len(found) or not np.isfinite(found).all():
        raise SceneError(f"{owner}: {what} = {show(values)} must be numbers, one or more.")
    return tuple(number(v, what, owner=owner) for v in found.tolist())


def length_of(length: Any, chord: Any, angle: Callable[[np.ndarray], np.ndarray], owner: str) -> float:
    """The length said, or that at which a line of this angle [rad] along it has the chord said."""
    if (length is None) == (chord is None):
        raise SceneError(f"{owner}: give one of length and chord [m].")
    if chord is None:
        return positive(length, "length", owner=owner, unit="m")
    x, w = CHORD_QUADRATURE
    turned = angle(0.5 * (x + 1.0))
    share = float(np.hypot(0.5 * w @ np.cos(turned), 0.5 * w @ np.sin(turned)))
    if share < 1e-6:
        raise SceneError(f"{owner}: its ends meet, so that no length gives it a chord; give its length.")
    return positive(chord, "chord", owner=owner, unit="m") / share


def sine_shape(amplitudes: Any, length: Any, chord: Any) -> Sine:
    """By its length or chord. Raises SceneError."""
    c = finite_numbers(amplitudes, "amplitudes", "FreeCurve.sine")
    return Sine(c, length_of(length, chord, Sine(c, 1.0).angle, "FreeCurve.sine"))


def legendre_shape(coefficients: Any, length: Any, chord: Any, breaks: Any) -> Legendre:
    """By its length, or without breaks its chord. Raises SceneError."""
    owner = "FreeCurve.legendre"
    if not np.size(breaks):
        whole = (finite_numbers(coefficients, "coefficients", owner),)
        return Legendre(whole, length_of(length, chord, Legendre(whole, 1.0).angle, owner))
    ends = finite_numbers(breaks, "breaks", owner)
    if chord is not None:
        raise SceneError(f"{owner}: with breaks, give its length instead of a chord.")
    if not all(a < b for a, b in zip((0.0, *ends), (*ends, 1.0), strict=True)):
        raise SceneError(f"{owner}: breaks = {show(breaks)} must rise between 0 and 1.")
    if not isinstance(coefficients, list | tuple | np.ndarray) or len(coefficients) != len(ends) + 1:
        raise SceneError(
            f"{owner}: coefficients = {show(coefficients)}: {len(ends)} breaks make {len(ends) + 1} pieces; give a list for "
            "each."
        )
    pieces = tuple(finite_numbers(own, "coefficients", owner) for own in coefficients)
    return Legendre(pieces, positive(length, "length", owner=owner, unit="m"), ends)


def spline_shape(points: Any, start: float | None, end: float | None) -> Spline:
    """Raises SceneError."""
    try:
        r = np.asarray(points, float)
    except (TypeError, ValueError, OverflowError):
        r = np.zeros(0)
    if r.ndim != 2 or r.shape[1] != 2 or len(r) < 2 or not np.isfinite(r).all():
        raise SceneError(f"FreeCurve.spline: points = {show(points)} must be two or more points (x, y) in m.")
    apart = np.hypot(*np.diff(r, axis=0).T)
    if not apart.all():
        raise SceneError(
            f"FreeCurve.spline: points {int(np.argmin(apart)) + 1} and {int(np.argmin(apart)) + 2} coincide."
        )
    ends = [
        None if a is None else number(a, what, owner="FreeCurve.spline")
        for what, a in (("start", start), ("end", end))
    ]
    return Spline(tuple(map(tuple, r.tolist())), *ends)


def _second_derivatives(r: np.ndarray, h: np.ndarray, ways: list[np.ndarray | None]) -> np.ndarray:
    """Second derivatives (k, 2) of a cubic spline at its points; none at ends without a direction."""
    n = len(r)
    A, b = np.zeros((n, n)), np.zeros((n, 2))
    slope = np.diff(r, axis=0) / h[:, None]
    for k in range(1, n - 1):
        A[k, k - 1 : k + 2] = h[k - 1], 2 * (h[k - 1] + h[k]), h[k]
        b[k] = 6 * (slope[k] - slope[k - 1])
    for k, other, way, size, rise in (
        (0, 1, ways[0], h[0], slope[0]),
        (n - 1, n - 2, ways[1], h[-1], slope[-1]),
    ):
        A[k, k] = 1.0
        if way is not None:
            A[k, k], A[k, other] = 2 * size, size
            b[k] = 6 * (rise - way) if k == 0 else 6 * (way - rise)
    return np.linalg.solve(A, b)
