"""Stress-free shapes of leaf springs that are not straight: arcs, curves given by numbers, and curvature functions."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ksd.checks import ClearArgumentErrors, number, positive, show
from ksd.errors import SceneError
from ksd.scene.plane_curves import PlaneCurvature, legendre_shape, sine_shape, spline_shape

LINE_TOLERANCE = 2e-11
"""Largest difference of one step and two along a panel: of the position at its end, over the length, and of its axes."""
FIRST_PANELS, MAX_HALVINGS, MAX_PANELS = 12, 40, 20_000
"""Panels of every piece before any is halved; how often one is halved at most, so that a jump takes no length; and how
many there may be."""


class Curve(metaclass=ClearArgumentErrors):
    """Base of all stress-free shapes: arc `length` [m] and `curvature(s)` (3,) [1/m] about e1, e2, e3, s in [0, 1].

    breaks: fractions s where the curvature has a jump or kink, strictly between 0 and 1 in rising order.
    """

    length: float
    breaks: tuple[float, ...] = ()

    def curvature(self, s: float) -> np.ndarray:
        """Curvature (3,) [1/m] at fraction s of the arc length."""
        raise NotImplementedError

    def curvatures(self, s: ArrayLike) -> np.ndarray:
        """Curvatures (k, 3) [1/m] at fractions s (k,) of the arc length."""
        return np.array([self.curvature(float(x)) for x in np.asarray(s, float)], float).reshape(-1, 3)

    def line(self, s: float) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) [m] and axes (3, 3) of the section at fraction s, relative to the start and in its axes.

        Integrates R' = R [kappa]x, r' = R e1 from break to break by Magnus steps of fourth order on panels that are halved
        until one step and two of half its length agree; their extrapolation (Richardson) is kept.
        """
        ends = np.array([0.0, *(b for b in self.breaks if b < s), s])
        first = np.concatenate(
            [a + (b - a) * np.arange(FIRST_PANELS) / FIRST_PANELS for a, b in pairwise(ends)]
        )
        size = np.repeat(np.diff(ends) / FIRST_PANELS, FIRST_PANELS)
        starts, steps = np.zeros(0), np.zeros((0, 4, 4))
        for halving in range(MAX_HALVINGS + 1):
            whole, halves = (self._steps(first, size, parts) for parts in (1, 2))
            error = np.abs(halves - whole).max(axis=(1, 2))
            if len(starts) + len(first) > MAX_PANELS or not np.isfinite(error).all():
                raise SceneError(
                    f"{type(self).__name__}: its curvature varies too fast to be integrated, {MAX_PANELS} panels along it "
                    "are not enough; smooth it, or cut the leaf."
                )
            kept = (error <= LINE_TOLERANCE) | (halving == MAX_HALVINGS)
            starts = np.concatenate([starts, first[kept]])
            steps = np.concatenate([steps, (halves + (halves - whole) / 15)[kept]])
            if kept.all():
                break
            size = np.repeat(0.5 * size[~kept], 2)
            first = np.repeat(first[~kept], 2)
            first[1::2] += size[1::2]
        # their product by pairs from the start on
        product = steps[np.argsort(starts)]
        while len(product) > 1:
            odd = product[-1:] if len(product) % 2 else product[:0]
            product = np.concatenate([product[:-1:2] @ product[1::2], odd])
        return self.length * product[0, :3, 3], product[0, :3, :3]

    def _steps(self, first: np.ndarray, size: np.ndarray, parts: int) -> np.ndarray:
        """Homogeneous transformations (k, 4, 4) along panels by Magnus steps, `parts` each; positions over the length.

        first, size (k,): fraction at which a panel starts, and its size.
        """
        h = np.repeat(size / parts, parts)
        start = np.repeat(first, parts) + np.tile(np.arange(parts), len(first)) * h
        # Simpson's points, which miss no jump, as points inside of a step may; its ends are just inside of it
        at = start + np.array([[1e-9], [0.5], [1.0 - 1e-9]]) * h
        rate = np.zeros((3, len(h), 4, 4))
        x, y, z = self.length * self.curvatures(at.ravel()).T.reshape(3, 3, len(h))
        rate[..., 0, 1], rate[..., 0, 2], rate[..., 1, 2] = -z, y, -x
        rate[..., 1, 0], rate[..., 2, 0], rate[..., 2, 1] = z, -y, x
        rate[..., 0, 3] = 1.0
        one, middle, two = rate
        h = h[:, None, None]
        step = h / 6 * (one + 4 * middle + two) + h**2 / 12 * (one @ two - two @ one)
        # exponentials of all steps by a Taylor series
        product = np.eye(4) + step / 9
        for n in range(8, 0, -1):
            product = np.eye(4) + step @ product / n
        return product if parts == 1 else product[::2] @ product[1::2]


_hashable_line = functools.lru_cache(maxsize=256)(Curve.line)


def _deviation(curve: Curve) -> float:
    """Rotation [rad], root mean square, by which the curvature modes of a leaf miss its curve."""
    kappa = curve.length * curve.curvatures(0.5 * (_legendre_projector()[0] + 1.0))
    share = max(projection_error(curve)[-1], 0.0)
    return float(np.sqrt(share * (kappa**2).sum(axis=1).mean()) / MAX_CURVE_MODES)


_hashable_deviation = functools.lru_cache(maxsize=256)(_deviation)


def cached_deviation(curve: Curve) -> float:
    """`_deviation`, cached for hashable curves."""
    try:
        return _hashable_deviation(curve)
    except TypeError:
        return _deviation(curve)


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
        first, last = self.part
        inside = tuple((b - first) / (last - first) for b in self.whole.breaks if first < b < last)
        self.__dict__.update(length=(last - first) * self.whole.length, breaks=inside)

    def curvature(self, s: float) -> np.ndarray:
        """Curvature (3,) [1/m] of the whole curve at fraction s of the part."""
        return self.whole.curvature(self.part[0] + s * (self.part[1] - self.part[0]))

    def curvatures(self, s: ArrayLike) -> np.ndarray:
        """Curvatures (k, 3) [1/m] of the whole curve at fractions s (k,) of the part."""
        return self.whole.curvatures(self.part[0] + np.asarray(s, float) * (self.part[1] - self.part[0]))

    def line(self, s: float) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) [m] and axes (3, 3) of the section at fraction s of the part, relative to its start."""
        first, last = self.part
        (start, axes), (end, turned) = (
            cached_line(self.whole, a) for a in (first, first + s * (last - first))
        )
        return axes.T @ (end - start), axes.T @ turned


MAX_CURVE_MODES = 16
"""Largest number of curvature modes about an axis that a leaf gets because it is curved."""


@functools.cache
def _legendre_projector() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gauss points (64,) in [-1, 1], roots of their weights (64, 1), orthonormal Legendre polynomials there (64, modes)."""
    x, w = np.polynomial.legendre.leggauss(64)
    root = np.sqrt(w)[:, None]
    norm = np.sqrt(np.arange(MAX_CURVE_MODES) + 0.5)
    return x, root, root * np.polynomial.legendre.legvander(x, MAX_CURVE_MODES - 1) * norm


def projection_error(curve: Curve, pieces: int = 1) -> np.ndarray:
    """Shares (MAX_CURVE_MODES,) of the squared curvature that 1, 2, ... modes on each of equal pieces do not represent."""
    x, root, V = _legendre_projector()
    s = (np.arange(pieces) + 0.5 * (x[:, None] + 1.0)) / pieces
    kappa = root * curve.curvatures(s.ravel()).reshape(64, -1)
    represented = ((V.T @ kappa) ** 2).sum(axis=1).cumsum()
    return np.asarray(1.0 - represented / max((kappa**2).sum(), 1e-300))


@dataclass(frozen=True, kw_only=True)
class Arc(Curve):
    """A circular arc of `radius` [m] and `angle` [rad], curved about e3 (width), towards e2 for positive angles.

    Raises SceneError for a radius that is not positive, and an angle that is zero or 2 pi or more.

    >>> arc = ksd.Arc(radius=20 * mm, angle=90 * deg)
    >>> print(f"length {arc.length / mm:.3f} mm, chord {arc.chord / mm:.3f} mm")
    length 31.416 mm, chord 28.284 mm
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

    def compliance(self, EI: float, *, EA: float = math.inf, GA: float = math.inf) -> np.ndarray:
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

    The function must be smooth, since the curvature modes of the leaf represent it; put a `Mechanism.point` where it jumps.
    `sine`, `legendre` and `spline` make a curve from a few numbers, which scene files can hold and by which answers have
    gradients (`ksd.gradient`, `ksd.Job`); these bend about e3, positive towards e2. Raises SceneError for a length that is
    not positive, and unless function is callable.

    >>> wave = ksd.FreeCurve.sine((0.5,), length=50 * mm)
    >>> wave.curvatures([0, 0.25, 0.5])[:, 2].round(2)
    array([ 62.83,   0.  , -62.83])
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
        if isinstance(self.function, PlaneCurvature):
            object.__setattr__(self, "breaks", self.function.breaks)

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
