"""Shapes of a leaf at rest by a few numbers: length and curvature along it, for `ksd.FreeCurve`; all in its plane."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.polynomial import legendre

from ksd.errors import SceneError
from ksd.section.checks import number, positive, show

POINTS = 128
"""Gauss points by which chords are measured."""
ROUNDS = 30
"""Most Newton steps to where a spline has a given length."""
Shape = tuple[float, Callable[[float], tuple[float, float, float]]]
"""Length [m] and curvature (3,) [1/m] at every fraction of it."""


def numbers(values: Any, what: str, owner: str) -> np.ndarray:
    """One or more finite numbers (k,). Raises SceneError."""
    try:
        found = np.atleast_1d(np.asarray(values, float))
    except (TypeError, ValueError):
        found = np.zeros((0, 0))
    if found.ndim != 1 or not len(found) or not np.isfinite(found).all():
        raise SceneError(f"{owner}: {what} = {show(values)} must be numbers, one or more.")
    return found


def length_of(length: Any, chord: Any, angle: Callable[[np.ndarray], np.ndarray], owner: str) -> float:
    """The length said, or that at which a line of this angle [rad] along it has the chord said."""
    if (length is None) == (chord is None):
        raise SceneError(f"{owner}: give one of length and chord [m].")
    if chord is None:
        return positive(length, "length", owner=owner, unit="m")
    x, w = legendre.leggauss(POINTS)
    turned = angle(0.5 * (x + 1.0))
    share = float(np.hypot(0.5 * w @ np.cos(turned), 0.5 * w @ np.sin(turned)))
    if share < 1e-6:
        raise SceneError(f"{owner}: its ends meet, so that no length gives it a chord; give its length.")
    return positive(chord, "chord", owner=owner, unit="m") / share


def sine_shape(amplitudes: Any, length: Any, chord: Any) -> Shape:
    """Angle sum_i c_i sin(2 pi i s)."""
    c = numbers(amplitudes, "amplitudes", "FreeCurve.sine")
    waves = 2.0 * np.pi * np.arange(1, len(c) + 1)
    own = length_of(length, chord, lambda s: np.sin(np.multiply.outer(s, waves)) @ c, "FreeCurve.sine")
    return own, lambda s: (0.0, 0.0, float(np.cos(waves * s) @ (waves * c)) / own)


def legendre_shape(coefficients: Any, length: Any, chord: Any) -> Shape:
    """Curvature times length sum_i c_i P_i(2 s - 1)."""
    c = numbers(coefficients, "coefficients", "FreeCurve.legendre")
    turn = 0.5 * legendre.legint(c, lbnd=-1)
    own = length_of(length, chord, lambda s: legendre.legval(2.0 * s - 1.0, turn), "FreeCurve.legendre")
    return own, lambda s: (0.0, 0.0, float(legendre.legval(2.0 * s - 1.0, c)) / own)


def spline_shape(points: Any, start: float | None, end: float | None) -> Shape:
    """Cubic spline through points (k, 2) [m], over the distances between them, of these angles [rad] at its ends."""
    try:
        r = np.asarray(points, float)
    except (TypeError, ValueError):
        r = np.zeros(0)
    if r.ndim != 2 or r.shape[1] != 2 or len(r) < 2 or not np.isfinite(r).all():
        raise SceneError(f"FreeCurve.spline: points = {show(points)} must be two or more points (x, y) in m.")
    apart = np.hypot(*np.diff(r, axis=0).T)
    if not apart.all():
        raise SceneError(
            f"FreeCurve.spline: points {int(np.argmin(apart)) + 1} and {int(np.argmin(apart)) + 2} coincide."
        )
    ways = [
        None if a is None else np.array([np.cos(t := number(a, what, owner="FreeCurve.spline")), np.sin(t)])
        for what, a in (("start", start), ("end", end))
    ]
    bends = _second(r, apart, ways)
    x, w = legendre.leggauss(16)

    def line(k: int, t: Any) -> tuple[np.ndarray, np.ndarray]:
        """First and second derivative by the distance, at fractions t of segment k."""
        h, t = apart[k], np.asarray(t, float)[..., None]
        first = (r[k + 1] - r[k]) / h + h / 6 * (
            (3 * t**2 - 1) * bends[k + 1] - (3 * (1 - t) ** 2 - 1) * bends[k]
        )
        return first, (1 - t) * bends[k] + t * bends[k + 1]

    def gone(k: int, t: float) -> float:
        """Length from the start of segment k."""
        first, _ = line(k, 0.5 * t * (x + 1.0))
        return float(0.5 * t * apart[k] * (w @ np.hypot(first[:, 0], first[:, 1])))

    ends = np.cumsum([0.0, *(gone(k, 1.0) for k in range(len(apart)))])
    own = float(ends[-1])

    def curvature(s: float) -> tuple[float, float, float]:
        k = min(max(int(np.searchsorted(ends, s * own, side="right")) - 1, 0), len(apart) - 1)
        t = (s * own - ends[k]) / (ends[k + 1] - ends[k])
        for _ in range(ROUNDS):
            first, _ = line(k, t)
            step = (s * own - float(ends[k]) - gone(k, t)) / (apart[k] * float(np.hypot(*first)))
            t += step
            if abs(step) < 1e-14:
                break
        first, second = line(k, t)
        return 0.0, 0.0, float(first[0] * second[1] - first[1] * second[0]) / float(np.hypot(*first)) ** 3

    return own, curvature


def _second(r: np.ndarray, h: np.ndarray, ways: list[np.ndarray | None]) -> np.ndarray:
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


__all__ = ["legendre_shape", "sine_shape", "spline_shape"]
