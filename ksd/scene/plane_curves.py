"""Plane stress-free shapes of leaf springs given by a few numbers, for `ksd.FreeCurve`: sine, Legendre and spline.

They are frozen values, so that curves of equal numbers are equal and scene files can hold them.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar, NamedTuple

import numpy as np
from numpy.polynomial import legendre

from ksd.checks import number, positive, show
from ksd.errors import SceneError

MAX_NEWTON_STEPS = 30
"""Limit of the Newton steps that find a spline's parameter at a given arc length."""
QUADRATURE = legendre.leggauss(16)
"""Gauss points and weights on [-1, 1], of a panel of the chord of a curve and of the arc length of a spline segment."""
CHORD_PANELS = (8, 16, 32, 64, 128, 256, 512, 1024)
"""Counts of panels of the chord of a curve, until two agree to `CHORD_TOLERANCE` of the length."""
CHORD_TOLERANCE = 1e-13
Points = tuple[tuple[float, ...], ...]
"""Rows of numbers: points (k, 2) [m], or coefficients of pieces."""


class PlaneCurvature:
    """Base of plane curves of arc `length` [m]: their curvature about e3 [1/m] as a function of the fraction s of it.

    kind: the name of the shape in scene files; breaks: fractions s where the curvature has a jump or kink.
    """

    kind: ClassVar[str]
    length: Any
    breaks: Any = ()

    def curvature_e3(self, s: np.ndarray) -> np.ndarray:
        """Curvature about e3 [1/m] at fractions s, in the shape of s."""
        raise NotImplementedError

    def __call__(self, s: Any) -> np.ndarray:
        """Curvature about e1, e2 and e3 (..., 3) [1/m] at fractions s (...)."""
        s = np.asarray(s, float)
        curvature = np.zeros((*s.shape, 3))
        curvature[..., 2] = self.curvature_e3(s)
        return curvature


@dataclass(frozen=True)
class Sine(PlaneCurvature):
    """Curve whose tangent has the angle sum_i amplitudes_i sin(2 pi i s) [rad] to that at its start."""

    amplitudes: tuple[float, ...]
    length: float
    kind = "sine"

    @property
    def wave_numbers(self) -> np.ndarray:
        """2 pi i, per unit of s, (n,)."""
        return 2.0 * np.pi * np.arange(1, len(self.amplitudes) + 1)

    def angle(self, s: np.ndarray) -> np.ndarray:
        """Angle of the tangent [rad] at fractions s, in the shape of s."""
        return np.asarray(np.sin(s[..., None] * self.wave_numbers) @ np.array(self.amplitudes))

    def curvature_e3(self, s: np.ndarray) -> np.ndarray:
        """Curvature about e3 [1/m] at fractions s, in the shape of s."""
        k = self.wave_numbers
        return np.asarray(np.cos(s[..., None] * k) @ (k * self.amplitudes)) / self.length


@dataclass(frozen=True)
class Legendre(PlaneCurvature):
    """Curve whose curvature is a series of Legendre polynomials P_i on each of its pieces.

    Curvature times length is sum_i pieces_ki P_i(x), x from -1 to 1 along piece k; breaks: fractions s where pieces meet.
    """

    pieces: Points
    length: float
    breaks: tuple[float, ...] = ()
    kind = "legendre"

    @property
    def coefficients(self) -> Any:
        """The argument of `FreeCurve.legendre`: a list for every piece, or the list of the only one."""
        return self.pieces if self.breaks else self.pieces[0]

    def angle(self, s: np.ndarray) -> np.ndarray:
        """Angle of the tangent [rad] of a curve of one piece at fractions s, in the shape of s."""
        return np.asarray(legendre.legval(2.0 * s - 1.0, 0.5 * legendre.legint(self.pieces[0], lbnd=-1)))

    @cached_property
    def _table(self) -> tuple[np.ndarray, np.ndarray]:
        """Fractions where pieces start and end (pieces + 1,), and their coefficients over the length (pieces, n)."""
        coefficients = np.zeros((len(self.pieces), max(map(len, self.pieces))))
        for row, piece in zip(coefficients, self.pieces, strict=True):
            row[: len(piece)] = piece
        return np.array([0.0, *self.breaks, 1.0]), coefficients / self.length

    def curvature_e3(self, s: np.ndarray) -> np.ndarray:
        """Curvature about e3 [1/m] at fractions s, in the shape of s."""
        ends, c = self._table
        k = np.searchsorted(ends[1:-1], s, side="right")
        x = 2.0 * (s - ends[k]) / (ends[k + 1] - ends[k]) - 1.0
        return np.asarray((legendre.legvander(x, c.shape[1] - 1) * c[k]).sum(axis=-1))


class _Segments(NamedTuple):
    """Segments of a cubic spline by its points (k, 2) [m], distances h (k-1,) between them and second derivatives (k, 2).

    On a segment the spline is a function of the distance along its chord, from 0 to h.
    """

    points: np.ndarray
    distances: np.ndarray
    second_derivatives: np.ndarray

    def derivatives(self, k: np.ndarray, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """First and second derivatives (..., 2) at fractions t of segments k."""
        r, distances, m = self
        h, t = distances[k][..., None], t[..., None]
        rise = (3 * t**2 - 1) * m[k + 1] - (3 * (1 - t) ** 2 - 1) * m[k]
        return (r[k + 1] - r[k]) / h + h / 6 * rise, (1 - t) * m[k] + t * m[k + 1]

    def arc_lengths(self, k: np.ndarray, t: np.ndarray) -> np.ndarray:
        """Arc lengths [m] from the start of segments k to their fractions t."""
        x, w = QUADRATURE
        first, _ = self.derivatives(k[..., None], 0.5 * t[..., None] * (x + 1.0))
        return np.asarray(0.5 * t * self.distances[k] * (np.hypot(first[..., 0], first[..., 1]) @ w))


@dataclass(frozen=True)
class Spline(PlaneCurvature):
    """Cubic spline through points (x, y) [m], over the distances between them.

    start, end: angles [rad] of the tangents at its ends to the x axis; None for zero curvature there.
    """

    points: Points
    start: float | None
    end: float | None
    kind = "spline"

    @cached_property
    def _segments(self) -> _Segments:
        """The segments of the spline."""
        r = np.array(self.points)
        distances = np.hypot(*np.diff(r, axis=0).T)
        tangents = [None if a is None else np.array([np.cos(a), np.sin(a)]) for a in (self.start, self.end)]
        return _Segments(r, distances, _second_derivatives(r, distances, tangents))

    @cached_property
    def _lengths_at_points(self) -> np.ndarray:
        """Arc lengths (k,) [m] from the start to every point."""
        k = np.arange(len(self._segments.distances))
        return np.cumsum([0.0, *self._segments.arc_lengths(k, np.ones(len(k))).tolist()])

    @property
    def length(self) -> float:
        """Arc length [m]."""
        return float(self._lengths_at_points[-1])

    @property
    def breaks(self) -> tuple[float, ...]:
        """Fractions of the arc length at the points between both ends, where the curvature has kinks."""
        return tuple((self._lengths_at_points[1:-1] / self.length).tolist())

    def curvature_e3(self, s: np.ndarray) -> np.ndarray:
        """Curvature about e3 [1/m] at fractions s, in the shape of s."""
        segments, ends = self._segments, self._lengths_at_points
        at = s * ends[-1]
        k = np.clip(np.searchsorted(ends, at, side="right") - 1, 0, len(ends) - 2)
        t = (at - ends[k]) / (ends[k + 1] - ends[k])
        for _ in range(MAX_NEWTON_STEPS):
            first, _ = segments.derivatives(k, t)
            step = (at - ends[k] - segments.arc_lengths(k, t)) / (
                segments.distances[k] * np.hypot(first[..., 0], first[..., 1])
            )
            t = t + step
            if np.abs(step).max(initial=0.0) < 1e-14:
                break
        first, second = segments.derivatives(k, t)
        turn = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
        return np.asarray(turn / np.hypot(first[..., 0], first[..., 1]) ** 3)


def finite_numbers(values: Any, what: str, owner: str) -> tuple[float, ...]:
    """One or more finite numbers as a tuple; `what` names them in messages. Raises SceneError."""
    try:
        array = np.atleast_1d(np.asarray(values, float))
    except (TypeError, ValueError, OverflowError):
        array = np.zeros((0, 0))
    if array.ndim != 1 or not len(array) or not np.isfinite(array).all():
        raise SceneError(f"{owner}: {what} = {show(values)} must be numbers, one or more.")
    return tuple(number(v, what, owner=owner) for v in array.tolist())


def length_of(length: Any, chord: Any, angle: Callable[[np.ndarray], np.ndarray], owner: str) -> float:
    """The given length [m], or the length at which a curve with this angle [rad] of its tangent has the given chord [m].

    Raises SceneError.
    """
    if (length is None) == (chord is None):
        raise SceneError(f"{owner}: give one of length and chord [m].")
    if chord is None:
        return positive(length, "length", owner=owner, unit="m")
    x, w = QUADRATURE
    chord_over_length = math.inf
    for panels in CHORD_PANELS:
        theta = angle((np.arange(panels)[:, None] + 0.5 * (x + 1.0)) / panels)
        coarser = chord_over_length
        chord_over_length = float(abs((np.exp(1j * theta) @ w).sum())) / (2 * panels)
        if abs(chord_over_length - coarser) < CHORD_TOLERANCE:
            break
    if chord_over_length < 1e-6:
        raise SceneError(f"{owner}: its ends meet, so that no length gives it a chord; give its length.")
    return positive(chord, "chord", owner=owner, unit="m") / chord_over_length


def sine_shape(amplitudes: Any, length: Any, chord: Any) -> Sine:
    """The shape of `FreeCurve.sine`, by its length or chord [m]. Raises SceneError."""
    c = finite_numbers(amplitudes, "amplitudes", "FreeCurve.sine")
    return Sine(c, length_of(length, chord, Sine(c, 1.0).angle, "FreeCurve.sine"))


def legendre_shape(coefficients: Any, length: Any, chord: Any, breaks: Any) -> Legendre:
    """The shape of `FreeCurve.legendre`, by its length or, without breaks, its chord [m]. Raises SceneError."""
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
    """The shape of `FreeCurve.spline`. Raises SceneError."""
    try:
        r = np.asarray(points, float)
    except (TypeError, ValueError, OverflowError):
        r = np.zeros(0)
    if r.ndim != 2 or r.shape[1] != 2 or len(r) < 2 or not np.isfinite(r).all():
        raise SceneError(f"FreeCurve.spline: points = {show(points)} must be two or more points (x, y) in m.")
    distances = np.hypot(*np.diff(r, axis=0).T)
    if not distances.all():
        first = int(np.argmin(distances)) + 1
        raise SceneError(f"FreeCurve.spline: points {first} and {first + 1} coincide.")
    ends = [
        None if a is None else number(a, what, owner="FreeCurve.spline")
        for what, a in (("start", start), ("end", end))
    ]
    return Spline(tuple(map(tuple, r.tolist())), *ends)


def _second_derivatives(r: np.ndarray, h: np.ndarray, tangents: list[np.ndarray | None]) -> np.ndarray:
    """Second derivatives (k, 2) of a cubic spline at its points r (k, 2), h: distances between them.

    tangents: unit tangents (2,) at both ends; zero second derivative at an end without one.
    """
    n = len(r)
    A, b = np.zeros((n, n)), np.zeros((n, 2))
    slope = np.diff(r, axis=0) / h[:, None]
    for k in range(1, n - 1):
        A[k, k - 1 : k + 2] = h[k - 1], 2 * (h[k - 1] + h[k]), h[k]
        b[k] = 6 * (slope[k] - slope[k - 1])
    for k, neighbour, tangent, distance, end_slope in (
        (0, 1, tangents[0], h[0], slope[0]),
        (n - 1, n - 2, tangents[1], h[-1], slope[-1]),
    ):
        A[k, k] = 1.0
        if tangent is not None:
            A[k, k], A[k, neighbour] = 2 * distance, distance
            b[k] = 6 * (end_slope - tangent) if k == 0 else 6 * (tangent - end_slope)
    return np.linalg.solve(A, b)
