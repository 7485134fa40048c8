"""Stress-free shapes of leaf springs that are not straight: arcs, curves given by numbers, and curvature functions."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ksd.checks import ClearArgumentErrors, number, positive, show
from ksd.errors import SceneError
from ksd.scene.plane_curves import PlaneCurvature, legendre_shape, sine_shape, spline_shape

COARSE_STEPS = 60
"""Steps by which the line of a curve is integrated, and twice as many."""


class Curve(metaclass=ClearArgumentErrors):
    """Base of all stress-free shapes: arc `length` [m] and `curvature(s)` (3,) [1/m] about e1, e2, e3, s in [0, 1]."""

    length: float

    def curvature(self, s: float) -> np.ndarray:
        """(3,) 1/m at fraction s of the arc length."""
        raise NotImplementedError

    def curvatures(self, s: ArrayLike) -> np.ndarray:
        """(k, 3) 1/m at fractions s (k,)."""
        return np.array([self.curvature(float(x)) for x in np.asarray(s, float)], float).reshape(-1, 3)

    def line(self, s: float) -> tuple[np.ndarray, np.ndarray]:
        """Place (3,) [m] and axes (3, 3) of the section at fraction s, from the start in its axes.

        R' = R [kappa]x, r' = R e1 by steps of fourth order (Magnus), once as many and extrapolated.
        """

        def end(steps: int) -> np.ndarray:
            h, rate = s * self.length / steps, np.zeros((2, steps, 4, 4))
            gauss = np.array([[0.5 - math.sqrt(3) / 6], [0.5 + math.sqrt(3) / 6]])
            at = s * (np.arange(steps) + gauss) / steps
            x, y, z = self.curvatures(at.ravel()).T.reshape(3, 2, steps)
            rate[..., 0, 1], rate[..., 0, 2], rate[..., 1, 2] = -z, y, -x
            rate[..., 1, 0], rate[..., 2, 0], rate[..., 2, 1] = z, -y, x
            rate[..., 0, 3] = 1.0
            one, two = rate
            step = 0.5 * h * (one + two) + math.sqrt(3) / 12 * h**2 * (one @ two - two @ one)
            turn = np.eye(4) + step / 9
            for n in range(8, 0, -1):
                turn = np.eye(4) + step @ turn / n
            while len(turn) > 1:
                # in pairs, from the start on
                odd = turn[-1:] if len(turn) % 2 else turn[:0]
                turn = np.concatenate([turn[:-1:2] @ turn[1::2], odd])
            return turn[0]

        if s == 0.0:
            return np.zeros(3), np.eye(3)
        fine = end(2 * COARSE_STEPS)
        found = fine + (fine - end(COARSE_STEPS)) / 15
        return found[:3, 3], found[:3, :3]


_hashable_line = functools.lru_cache(maxsize=64)(Curve.line)


def cached_line(curve: Curve, s: float) -> tuple[np.ndarray, np.ndarray]:
    """`Curve.line`, remembered where the curve can be: points and pieces of a leaf ask for the same places."""
    try:
        return curve.line(s) if type(curve).line is not Curve.line else _hashable_line(curve, s)
    except TypeError:
        # a curve of the user's own that cannot be remembered
        return curve.line(s)


@dataclass(frozen=True)
class CurvePart(Curve):
    """The part of a curve between two fractions of its arc length."""

    whole: Curve
    part: tuple[float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "length", (self.part[1] - self.part[0]) * self.whole.length)

    def curvature(self, s: float) -> np.ndarray:
        """That of the whole."""
        return self.whole.curvature(self.part[0] + s * (self.part[1] - self.part[0]))

    def curvatures(self, s: ArrayLike) -> np.ndarray:
        """Those of the whole."""
        return self.whole.curvatures(self.part[0] + np.asarray(s, float) * (self.part[1] - self.part[0]))


@dataclass(frozen=True)
class Arc(Curve):
    """A circular arc of `radius` [m] and `angle` [rad], bending about e3 (width); positive angles bend towards e2.

    Raises SceneError for a radius that is not positive and an angle of zero or more than a turn.
    """

    radius: float
    angle: float

    def __post_init__(self) -> None:
        object.__setattr__(self, "radius", positive(self.radius, "radius", owner="Arc", unit="m"))
        angle = number(self.angle, "angle", owner="Arc")
        if not 0.0 < abs(angle) < 2 * math.pi:
            raise SceneError(f"Arc: angle = {show(angle)} rad must lie between 0 and 2 pi, either sign.")
        self.__dict__.update(angle=angle, length=self.radius * abs(angle))

    def curvature(self, s: float) -> np.ndarray:
        """Constant about e3."""
        return np.array([0.0, 0.0, math.copysign(1.0 / self.radius, self.angle)])

    def curvatures(self, s: ArrayLike) -> np.ndarray:
        """The same everywhere."""
        return np.tile(self.curvature(0.0), (np.size(s), 1))

    @property
    def chord(self) -> float:
        """Distance between its ends [m]."""
        return 2 * self.radius * abs(math.sin(self.angle / 2))

    def compliance(self, EI: float, EA: float = math.inf, GA: float = math.inf) -> np.ndarray:
        """Motion (x, y, turn) of the end of the arc per force (x, y) and moment there, (3, 3), clamped at its start.

        In the frame at that end: x along the tangent away from the arc, y to the centre. EI [N m^2]; EA and GA (with its
        shear correction) [N], without stretch and shear where left out. Source: Castigliano; paper 3 has it for EI alone.
        """
        r, a = self.radius, abs(self.angle)
        s, c = math.sin(a), math.cos(a)
        along, across = 0.5 * r * (a + s * c), 0.5 * r * (a - s * c)
        xx, yy = r**3 * (1.5 * a - 2 * s + 0.5 * s * c) / EI, r**3 * across / r / EI
        xy = r**3 * (1 - c - 0.5 * s * s) / EI + 0.5 * r * s * s * (1 / GA - 1 / EA)
        xm, ym = r * r * (a - s) / EI, r * r * (1 - c) / EI
        xx, yy = xx + along / EA + across / GA, yy + across / EA + along / GA
        return np.array([[xx, xy, xm], [xy, yy, ym], [xm, ym, r * a / EI]])


@dataclass(frozen=True)
class FreeCurve(Curve):
    """Any stress-free shape: `function(s)` returns the curvature (3,) [1/m] at fraction s of the arc `length` [m].

    Anything smooth; it is represented by the curvature modes of the leaf. `sine`, `legendre` and `spline` make it of a
    few numbers, by which answers have gradients (`ksd.gradient`, `ksd.Job`), and which scene files hold; they bend about
    e3, towards e2. Raises SceneError for a length that is not positive and what is no function.
    """

    length: float
    function: Callable[[float], Any]

    @classmethod
    def sine(
        cls, amplitudes: ArrayLike, *, length: float | None = None, chord: float | None = None
    ) -> FreeCurve:
        """Angle sum_i amplitudes_i sin(2 pi i s) [rad] to the direction of its start: level at both ends, which lie on one
        line. By its length, or the chord [m] between its ends. Source: Lan (2005), equation 5.7.
        """
        return cls.of(sine_shape(amplitudes, length, chord))

    @classmethod
    def legendre(
        cls,
        coefficients: ArrayLike | Sequence[ArrayLike],
        *,
        length: float | None = None,
        chord: float | None = None,
        breaks: ArrayLike = (),
    ) -> FreeCurve:
        """Curvature sum_i coefficients_i P_i(2 s - 1) / length, P Legendre polynomials: coefficients [rad], the first is the
        whole turn. By its length, or the chord [m] between its ends. breaks: fractions of the length at which other
        coefficients begin, a list for every piece.
        """
        return cls.of(legendre_shape(coefficients, length, chord, breaks))

    @classmethod
    def spline(cls, points: ArrayLike, *, start: float | None = None, end: float | None = None) -> FreeCurve:
        """Through points (k, 2) [m] in any axes, from the first to the last, by a cubic spline over their distances.

        start, end: angle [rad] of its ends to the first axis; without one it is straight there. Its curvature has a kink at
        every point: a `Mechanism.point` there gives each part modes of its own. Raises SceneError.
        """
        return cls.of(spline_shape(points, start, end))

    @classmethod
    def of(cls, bend: PlaneCurvature) -> FreeCurve:
        """Of a named shape."""
        return cls(bend.length, bend)

    def __post_init__(self) -> None:
        object.__setattr__(self, "length", positive(self.length, "length", owner="FreeCurve", unit="m"))
        if not callable(self.function):
            raise SceneError(
                f"FreeCurve: function = {show(self.function)} must be a function of s in [0, 1]."
            )

    def curvature(self, s: float) -> np.ndarray:
        """The function's answer as an array; SceneError unless it is three finite numbers."""
        found = np.asarray(self.function(s), float)
        if found.shape != (3,) or not np.all(np.isfinite(found)):
            raise SceneError(
                f"FreeCurve: at s = {s:g} its function returned {show(found)}, three numbers are needed."
            )
        return found

    def curvatures(self, s: ArrayLike) -> np.ndarray:
        """All at once of a named shape."""
        return self.function(s) if isinstance(self.function, PlaneCurvature) else super().curvatures(s)
