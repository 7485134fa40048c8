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
"""Integration steps along a curve of the coarser of two solutions, from which the line is extrapolated."""


class Curve(metaclass=ClearArgumentErrors):
    """Base of all stress-free shapes: arc `length` [m] and `curvature(s)` (3,) [1/m] about e1, e2, e3, s in [0, 1]."""

    length: float

    def curvature(self, s: float) -> np.ndarray:
        """Curvature (3,) [1/m] at fraction s of the arc length."""
        raise NotImplementedError

    def curvatures(self, s: ArrayLike) -> np.ndarray:
        """Curvatures (k, 3) [1/m] at fractions s (k,) of the arc length."""
        return np.array([self.curvature(float(x)) for x in np.asarray(s, float)], float).reshape(-1, 3)

    def line(self, s: float) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) [m] and axes (3, 3) of the section at fraction s, relative to the start and in its axes.

        Integrates R' = R [kappa]x, r' = R e1 by Magnus steps of fourth order, twice, and extrapolates (Richardson).
        """

        def transform(steps: int) -> np.ndarray:
            """Homogeneous transformation (4, 4) from the start to fraction s."""
            h, rate = s * self.length / steps, np.zeros((2, steps, 4, 4))
            gauss = np.array([[0.5 - math.sqrt(3) / 6], [0.5 + math.sqrt(3) / 6]])
            at = s * (np.arange(steps) + gauss) / steps
            x, y, z = self.curvatures(at.ravel()).T.reshape(3, 2, steps)
            rate[..., 0, 1], rate[..., 0, 2], rate[..., 1, 2] = -z, y, -x
            rate[..., 1, 0], rate[..., 2, 0], rate[..., 2, 1] = z, -y, x
            rate[..., 0, 3] = 1.0
            one, two = rate
            step = 0.5 * h * (one + two) + math.sqrt(3) / 12 * h**2 * (one @ two - two @ one)
            # exponentials of all steps by a Taylor series, then their product by pairs from the start on
            product = np.eye(4) + step / 9
            for n in range(8, 0, -1):
                product = np.eye(4) + step @ product / n
            while len(product) > 1:
                odd = product[-1:] if len(product) % 2 else product[:0]
                product = np.concatenate([product[:-1:2] @ product[1::2], odd])
            return product[0]

        if s == 0.0:
            return np.zeros(3), np.eye(3)
        fine = transform(2 * COARSE_STEPS)
        end = fine + (fine - transform(COARSE_STEPS)) / 15
        return end[:3, 3], end[:3, :3]


_hashable_line = functools.lru_cache(maxsize=64)(Curve.line)


def cached_line(curve: Curve, s: float) -> tuple[np.ndarray, np.ndarray]:
    """`Curve.line`, cached for hashable curves: points and parts of a leaf need it at the same fractions."""
    try:
        return curve.line(s) if type(curve).line is not Curve.line else _hashable_line(curve, s)
    except TypeError:
        # a curve of the user that is not hashable
        return curve.line(s)


@dataclass(frozen=True)
class CurvePart(Curve):
    """The part of the curve `whole` between two fractions `part` of its arc length."""

    whole: Curve
    part: tuple[float, float]

    def __post_init__(self) -> None:
        object.__setattr__(self, "length", (self.part[1] - self.part[0]) * self.whole.length)

    def curvature(self, s: float) -> np.ndarray:
        """Curvature (3,) [1/m] of the whole curve at fraction s of the part."""
        return self.whole.curvature(self.part[0] + s * (self.part[1] - self.part[0]))

    def curvatures(self, s: ArrayLike) -> np.ndarray:
        """Curvatures (k, 3) [1/m] of the whole curve at fractions s (k,) of the part."""
        return self.whole.curvatures(self.part[0] + np.asarray(s, float) * (self.part[1] - self.part[0]))


@dataclass(frozen=True)
class Arc(Curve):
    """A circular arc of `radius` [m] and `angle` [rad], curved about e3 (width), towards e2 for positive angles.

    Raises SceneError for a radius that is not positive, and an angle that is zero or 2 pi or more.
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
        """Curvature (3,) [1/m], constant about e3."""
        return np.array([0.0, 0.0, math.copysign(1.0 / self.radius, self.angle)])

    def curvatures(self, s: ArrayLike) -> np.ndarray:
        """Curvatures (k, 3) [1/m], the same at all fractions s (k,)."""
        return np.tile(self.curvature(0.0), (np.size(s), 1))

    @property
    def chord(self) -> float:
        """Distance between its ends [m]."""
        return 2 * self.radius * abs(math.sin(self.angle / 2))

    def compliance(self, EI: float, EA: float = math.inf, GA: float = math.inf) -> np.ndarray:
        """Compliance (3, 3) of the end of the arc: displacements x, y and rotation per force x, y and moment there.

        The start is clamped. The frame at the end has x along the tangent away from the arc and y to the centre. EI [N m^2];
        EA and GA (with its shear correction) [N], rigid in extension and shear when left out. Source: Castigliano's theorem;
        paper 3 has it for EI alone.
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

    The function must be smooth; the curvature modes of the leaf represent it. `sine`, `legendre` and `spline` make a
    curve from a few numbers, which scene files can hold and by which answers have gradients (`ksd.gradient`,
    `ksd.Job`); these bend about e3, positive towards e2. Raises SceneError for a length that is not positive, and
    unless function is callable.
    """

    length: float
    function: Callable[[float], Any]

    @classmethod
    def sine(
        cls, amplitudes: ArrayLike, *, length: float | None = None, chord: float | None = None
    ) -> FreeCurve:
        """A curve whose tangent has the angle sum_i amplitudes_i sin(2 pi i s) [rad] to that at its start.

        Give its length, or the chord [m] between its ends. The tangents at both ends are parallel, and the ends lie on one
        line with this direction. Source: Lan (2005), equation 5.7. Raises SceneError.
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
        """A curve of curvature sum_i coefficients_i [rad] P_i(2 s - 1) / length about e3, P_i Legendre polynomials.

        coefficients [rad]: the first is the angle between the tangents at both ends. Give its length, or the chord [m]
        between its ends. breaks: fractions of the length where pieces meet; coefficients is then a list for every
        piece, and the length must be given. Raises SceneError.
        """
        return cls.of(legendre_shape(coefficients, length, chord, breaks))

    @classmethod
    def spline(cls, points: ArrayLike, *, start: float | None = None, end: float | None = None) -> FreeCurve:
        """A cubic spline through points (k, 2) [m] in any axes, parametrised by the distances between them.

        start, end: angles [rad] of the tangents at its ends to the first axis; without one the curvature there is zero. The
        curvature has a kink at every point: a `Mechanism.point` there gives each part modes of its own. Raises SceneError.
        """
        return cls.of(spline_shape(points, start, end))

    @classmethod
    def of(cls, bend: PlaneCurvature) -> FreeCurve:
        """The free curve of a plane curve `bend`, see `ksd.scene.plane_curves`."""
        return cls(bend.length, bend)

    def __post_init__(self) -> None:
        object.__setattr__(self, "length", positive(self.length, "length", owner="FreeCurve", unit="m"))
        if not callable(self.function):
            raise SceneError(
                f"FreeCurve: function = {show(self.function)} must be a function of s in [0, 1]."
            )

    def curvature(self, s: float) -> np.ndarray:
        """Curvature (3,) [1/m] at fraction s. Raises SceneError unless the function returns three finite numbers."""
        curvature = np.asarray(self.function(s), float)
        if curvature.shape != (3,) or not np.all(np.isfinite(curvature)):
            raise SceneError(
                f"FreeCurve: at s = {s:g} its function returned {show(curvature)}, three numbers are needed."
            )
        return curvature

    def curvatures(self, s: ArrayLike) -> np.ndarray:
        """Curvatures (k, 3) [1/m] at fractions s (k,), in one call for a plane curve."""
        return self.function(s) if isinstance(self.function, PlaneCurvature) else super().curvatures(s)
