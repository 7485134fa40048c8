"""Leaf springs that are not the same all along: tapered, notched, stiffened in the middle, or curved at rest.

A profile gives the section at s in [0, 1], the fraction of the arc length from start to end; `breaks` are the
fractions where it has a kink or a step. A curve gives the stress-free curvature. All are frozen values, so that
scenes can be compared and hashed.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ksd.checks import Worded, between, number, positive, show
from ksd.errors import SceneError
from ksd.scene.curves import Bend, Legendre, Sine, Spline, legendre_shape, numbers, sine_shape, spline_shape
from ksd.section import Section, rectangle
from ksd.section.closed_forms import rectangles
from ksd.section.constants import Sections

Array = NDArray[np.float64]
STEPS = 60
"""Steps by which the line of a curve is integrated, and twice as many."""
SIDE = 1e-9
"""Fraction of the length by which a section is beside a step: on it, rounding would choose a side."""


class Profile(metaclass=Worded):
    """Base of all profiles: `section(s)` and `breaks`, fractions strictly between 0 and 1 in rising order."""

    breaks: tuple[float, ...] = ()

    def section(self, s: float) -> Section:
        """The section at fraction s of the arc length."""
        raise NotImplementedError

    def sides(self, s: float) -> tuple[Section, ...]:
        """The section at fraction s, just inside the leaf; where it has a kink or a step there those on both sides."""
        near = any(abs(s - b) < SIDE for b in self.breaks)
        places = (s - SIDE, s + SIDE) if near else (min(max(s, SIDE), 1.0 - SIDE),)
        return tuple(map(self.section, places))

    def sections(self, s: Array) -> Sections:
        """Those at fractions s (k,)."""
        found = [self.section(x) for x in s.tolist()]
        return Sections(*np.array([[getattr(q, name) for q in found] for name in Sections._fields]))


class _Rectangles(Profile):
    """Base of profiles whose sections are rectangles: `sizes(s)`, thickness and width [m] at a fraction or many (k,)."""

    def sizes(self, s: Any) -> tuple[Any, Any]:
        raise NotImplementedError

    def section(self, s: float) -> Section:
        """The rectangle at fraction s of the arc length."""
        t, w = self.sizes(s)
        return rectangle(float(t), float(w))

    def sections(self, s: Array) -> Sections:
        """Those at fractions s (k,)."""
        return rectangles(*np.broadcast_arrays(*self.sizes(s)))


def _positive(profile: Profile, *lengths: str) -> None:
    """Check and clean lengths of a profile [m]. Raises SceneError."""
    owner, own = type(profile).__name__, profile.__dict__
    own.update({name: positive(own[name], name, owner=owner, unit="m") for name in lengths})


@dataclass(frozen=True)
class Taper(_Rectangles):
    """Thickness and width [m], two numbers each, running linearly from start to end. Raises SceneError for what is not
    positive."""

    thickness: tuple[float, float]
    width: tuple[float, float]

    def __post_init__(self) -> None:
        for name, pair in (("thickness", self.thickness), ("width", self.width)):
            if not isinstance(pair, tuple | list) or len(pair) != 2:
                raise SceneError(
                    f"Taper: {name} = {show(pair)} must be two lengths in m, at start and at end."
                )
            object.__setattr__(self, name, tuple(positive(v, name, owner="Taper", unit="m") for v in pair))

    def sizes(self, s: Any) -> tuple[Any, Any]:
        """Between those at the ends."""
        t, w = ((1 - s) * a + s * b for a, b in (self.thickness, self.width))
        return t, w


@dataclass(frozen=True)
class CircularNotch(_Rectangles):
    """Circular notch hinge of length 2 radius: t(x) = minimum + 2 (R - sqrt(R^2 - x^2)) about the middle.

    radius, minimum thickness, width [m]. A full semicircle; the leaf that carries it is 2 radius long. Source:
    Paros and Weisbord, Machine Design 37 (1965), the right circular hinge. Raises SceneError for what is not positive.
    """

    radius: float
    minimum: float
    width: float

    def __post_init__(self) -> None:
        _positive(self, "radius", "minimum", "width")

    def sizes(self, s: Any) -> tuple[Any, Any]:
        """As thick as the notch is at s."""
        x = (2 * s - 1) * self.radius
        rise = self.radius - np.sqrt(np.maximum(self.radius**2 - x**2, 0.0))
        return self.minimum + 2 * rise, self.width


@dataclass(frozen=True)
class FilletedNotch(_Rectangles):
    """Corner-filleted notch hinge: a straight leaf of `minimum` thickness with quarter-circle fillets at its ends.

    length [m] of leaf and both fillets together, radius of the fillets, minimum thickness, width [m].
    Source: Lobontiu et al., Journal of Mechanical Design 123 (2001), the corner-filleted hinge. Raises SceneError for
    what is not positive, and fillets longer than the leaf.
    """

    length: float
    radius: float
    minimum: float
    width: float

    def __post_init__(self) -> None:
        _positive(self, "length", "radius", "minimum", "width")
        if 2 * self.radius >= self.length:
            raise SceneError(
                f"FilletedNotch: radius = {self.radius:g} m must be less than half its length = {self.length:g} m."
            )
        part = self.radius / self.length
        object.__setattr__(self, "breaks", (part, 1 - part))

    def sizes(self, s: Any) -> tuple[Any, Any]:
        """As thick as the notch is at s."""
        gap = np.maximum(self.radius - np.minimum(s, 1 - s) * self.length, 0.0)
        rise = self.radius - np.sqrt(np.maximum(self.radius**2 - gap**2, 0.0))
        return self.minimum + 2 * rise, self.width


@dataclass(frozen=True)
class StiffenedMiddle(_Rectangles):
    """A leaf of one `width` [m] with a thicker middle: `thickness` [m] at both ends, `middle` [m] over the middle `part`
    (fraction). Raises SceneError for what is not positive, and another fraction than between 0 and 1."""

    thickness: float
    width: float
    middle: float
    part: float

    def __post_init__(self) -> None:
        _positive(self, "thickness", "width", "middle")
        part = between(self.part, "part", 0.0, 1.0, owner="StiffenedMiddle")
        self.__dict__.update(part=part, breaks=(0.5 - 0.5 * part, 0.5 + 0.5 * part))

    def sizes(self, s: Any) -> tuple[Any, Any]:
        """Thick inside the middle part, thin outside."""
        inside = np.abs(s - 0.5) < 0.5 * self.part
        return np.where(inside, self.middle, self.thickness), self.width


@dataclass(frozen=True)
class Varying(Profile):
    """Any profile: a `function` of s in [0, 1] returning a `ksd.Section`, with `breaks`, the fractions of its kinks. Raises
    SceneError for what is no function or no fraction."""

    function: Callable[[float], Section]
    breaks: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise SceneError(f"Varying: function = {show(self.function)} must be a function of s in [0, 1].")
        breaks = numbers(self.breaks, "breaks", "Varying") if np.size(self.breaks) else ()
        if not all(a < b for a, b in zip((0.0, *breaks), (*breaks, 1.0), strict=True)):
            raise SceneError(f"Varying: breaks = {show(self.breaks)} must rise between 0 and 1.")
        object.__setattr__(self, "breaks", breaks)

    def section(self, s: float) -> Section:
        """The function's answer; SceneError when it is not a Section."""
        found = self.function(s)
        if not isinstance(found, Section):
            raise SceneError(
                f"Varying: at s = {s:g} its function returned {show(found)}, a Section is needed."
            )
        return found


class Curve(metaclass=Worded):
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
        fine = end(2 * STEPS)
        found = fine + (fine - end(STEPS)) / 15
        return found[:3, 3], found[:3, :3]


_line = functools.lru_cache(maxsize=64)(Curve.line)


def line_of(curve: Curve, s: float) -> tuple[np.ndarray, np.ndarray]:
    """`Curve.line`, remembered where the curve can be: points and pieces of a leaf ask for the same places."""
    try:
        return curve.line(s) if type(curve).line is not Curve.line else _line(curve, s)
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
class ProfilePart(Profile):
    """The part of a profile between two fractions of the length."""

    whole: Profile
    part: tuple[float, float]

    def __post_init__(self) -> None:
        first, last = self.part
        inside = tuple((s - first) / (last - first) for s in self.whole.breaks if first < s < last)
        object.__setattr__(self, "breaks", inside)

    def section(self, s: float) -> Section:
        """That of the whole."""
        return self.whole.section(self.part[0] + s * (self.part[1] - self.part[0]))

    def sections(self, s: Array) -> Sections:
        """Those of the whole."""
        return self.whole.sections(self.part[0] + s * (self.part[1] - self.part[0]))


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
    def of(cls, bend: Bend) -> FreeCurve:
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
        return self.function(s) if isinstance(self.function, Bend) else super().curvatures(s)


NAMED: dict[str, dict[str, tuple[type[Any], Callable[..., Any]]]] = {
    "curve": {
        "arc": (Arc, Arc), "sine": (Sine, FreeCurve.sine), "legendre": (Legendre, FreeCurve.legendre),
        "spline": (Spline, FreeCurve.spline),
    },
    "profile": {
        "taper": (Taper, Taper), "circular_notch": (CircularNotch, CircularNotch),
        "filleted_notch": (FilletedNotch, FilletedNotch), "stiffened_middle": (StiffenedMiddle, StiffenedMiddle),
    },
}  # fmt: skip
"""Shapes that scene files hold, by their kind: what holds their numbers, and what is made of them."""
