"""Profiles of leaf springs whose section varies along them: tapered, notched, stiffened in the middle, or any function.

A profile gives the section at s in [0, 1], the fraction of the arc length from start to end; `breaks` are the fractions
where it has a kink or a step. Profiles are frozen values, so that scenes can be compared and hashed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.checks import ClearArgumentErrors, between, positive, show
from ksd.errors import SceneError
from ksd.scene.plane_curves import finite_numbers
from ksd.section import Section, rectangle
from ksd.section.closed_forms import rectangles
from ksd.section.section import SectionArrays

Array = NDArray[np.float64]
KINK_OFFSET = 1e-9
"""Offset from a kink or step, as a fraction of the length: on the step itself rounding would choose a side."""


class Profile(metaclass=ClearArgumentErrors):
    """Base of all profiles: `section(s)` and `breaks`, fractions strictly between 0 and 1 in rising order."""

    breaks: tuple[float, ...] = ()

    def section(self, s: float) -> Section:
        """The section at fraction s of the arc length."""
        raise NotImplementedError

    def sides(self, s: float) -> tuple[Section, ...]:
        """The section at fraction s, just inside the leaf, or the two on both sides of a kink or step there."""
        if any(abs(s - b) < KINK_OFFSET for b in self.breaks):
            return self.section(s - KINK_OFFSET), self.section(s + KINK_OFFSET)
        return (self.section(min(max(s, KINK_OFFSET), 1.0 - KINK_OFFSET)),)

    def sections(self, s: Array) -> SectionArrays:
        """The sections at fractions s (k,) of the arc length."""
        each = [self.section(x) for x in s.tolist()]
        return SectionArrays(*np.array([[getattr(q, name) for q in each] for name in SectionArrays._fields]))


class _Rectangles(Profile):
    """Base of profiles with rectangular sections; `sizes(s)` returns thickness and width [m]."""

    def sizes(self, s: Any) -> tuple[Any, Any]:
        """Thickness and width [m] at a fraction s, or at fractions (k,)."""
        raise NotImplementedError

    def section(self, s: float) -> Section:
        """The rectangle at fraction s of the arc length."""
        t, w = self.sizes(s)
        return rectangle(float(t), float(w))

    def sections(self, s: Array) -> SectionArrays:
        """The sections at fractions s (k,) of the arc length."""
        return rectangles(*np.broadcast_arrays(*self.sizes(s)))


def _check_positive(profile: Profile, *lengths: str) -> None:
    """Check the named lengths [m] of a profile and make them floats. Raises SceneError."""
    owner, own = type(profile).__name__, profile.__dict__
    own.update({name: positive(own[name], name, owner=owner, unit="m") for name in lengths})


@dataclass(frozen=True, kw_only=True)
class Taper(_Rectangles):
    """Thickness and width [m], two numbers each, that vary linearly from start to end. Raises SceneError for lengths that
    are not positive.

    >>> blade = ksd.Taper(thickness=(0.5 * mm, 0.3 * mm), width=(20 * mm, 10 * mm))
    >>> round(blade.section(0.5).thickness / mm, 3), round(blade.section(0.5).width / mm, 3)
    (0.4, 15.0)
    """

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
        """Thickness and width [m] at s, interpolated between the ends."""
        t, w = ((1 - s) * a + s * b for a, b in (self.thickness, self.width))
        return t, w


@dataclass(frozen=True, kw_only=True)
class CircularNotch(_Rectangles):
    """Circular notch of length 2 radius: thickness minimum + 2 (R - sqrt(R^2 - x^2)) at distance x from the middle.

    radius, minimum thickness, width [m]. A full semicircle; the leaf that carries it is 2 radius long. Source:
    Paros and Weisbord, Machine Design 37 (1965), the right circular hinge. Raises SceneError for lengths not positive.

    >>> notch = ksd.CircularNotch(radius=5 * mm, minimum=0.3 * mm, width=10 * mm)
    >>> [round(notch.section(s).thickness / mm, 3) for s in (0, 0.25, 0.5)]
    [10.3, 1.64, 0.3]
    """

    radius: float
    minimum: float
    width: float

    def __post_init__(self) -> None:
        _check_positive(self, "radius", "minimum", "width")

    def sizes(self, s: Any) -> tuple[Any, Any]:
        """Thickness and width [m] at s."""
        x = (2 * s - 1) * self.radius
        rise = self.radius - np.sqrt(np.maximum(self.radius**2 - x**2, 0.0))
        return self.minimum + 2 * rise, self.width


@dataclass(frozen=True, kw_only=True)
class FilletedNotch(_Rectangles):
    """Corner-filleted notch hinge: a straight leaf of `minimum` thickness with quarter-circle fillets at its ends.

    length [m] of leaf and both fillets together, radius of the fillets, minimum thickness, width [m].
    Source: Lobontiu et al., Journal of Mechanical Design 123 (2001), the corner-filleted hinge. Raises SceneError for
    lengths that are not positive, and fillets longer than the leaf.

    >>> notch = ksd.FilletedNotch(
    ...     length=10 * mm, radius=2 * mm, minimum=0.3 * mm, width=10 * mm
    ... )
    >>> [round(notch.section(s).thickness / mm, 3) for s in (0, 0.1, 0.5)]
    [4.3, 0.836, 0.3]
    """

    length: float
    radius: float
    minimum: float
    width: float

    def __post_init__(self) -> None:
        _check_positive(self, "length", "radius", "minimum", "width")
        if 2 * self.radius >= self.length:
            raise SceneError(
                f"FilletedNotch: radius = {self.radius:g} m must be less than half its length = {self.length:g} m."
            )
        part = self.radius / self.length
        object.__setattr__(self, "breaks", (part, 1 - part))

    def sizes(self, s: Any) -> tuple[Any, Any]:
        """Thickness and width [m] at s."""
        gap = np.maximum(self.radius - np.minimum(s, 1 - s) * self.length, 0.0)
        rise = self.radius - np.sqrt(np.maximum(self.radius**2 - gap**2, 0.0))
        return self.minimum + 2 * rise, self.width


@dataclass(frozen=True, kw_only=True)
class StiffenedMiddle(_Rectangles):
    """A leaf of one `width` [m] with a thicker middle: `thickness` [m] at both ends, `middle` [m] over the middle `part`
    (fraction of the length). Raises SceneError for lengths that are not positive, and unless 0 < part < 1.

    >>> blade = ksd.StiffenedMiddle(thickness=0.3 * mm, width=20 * mm, middle=2 * mm, part=0.5)
    >>> [round(blade.section(s).thickness / mm, 3) for s in (0.1, 0.5)]
    [0.3, 2.0]
    """

    thickness: float
    width: float
    middle: float
    part: float

    def __post_init__(self) -> None:
        _check_positive(self, "thickness", "width", "middle")
        part = between(self.part, "part", 0.0, 1.0, owner="StiffenedMiddle")
        self.__dict__.update(part=part, breaks=(0.5 - 0.5 * part, 0.5 + 0.5 * part))

    def sizes(self, s: Any) -> tuple[Any, Any]:
        """Thickness and width [m] at s: `middle` within the middle part, else `thickness`."""
        inside = np.abs(s - 0.5) < 0.5 * self.part
        return np.where(inside, self.middle, self.thickness), self.width


@dataclass(frozen=True)
class Varying(Profile):
    """Any profile: a `function` of s in [0, 1] that returns a `ksd.Section`, and `breaks`, the fractions of its kinks.

    Raises SceneError unless function is callable and breaks rise between 0 and 1.

    >>> blade = ksd.Varying(lambda s: ksd.rectangle((0.3 + 0.2 * s) * mm, 10 * mm))
    >>> round(blade.section(0.5).thickness / mm, 3)
    0.4
    """

    function: Callable[[float], Section]
    breaks: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise SceneError(f"Varying: function = {show(self.function)} must be a function of s in [0, 1].")
        breaks = finite_numbers(self.breaks, "breaks", "Varying") if np.size(self.breaks) else ()
        if not all(a < b for a, b in zip((0.0, *breaks), (*breaks, 1.0), strict=True)):
            raise SceneError(f"Varying: breaks = {show(self.breaks)} must rise between 0 and 1.")
        object.__setattr__(self, "breaks", breaks)

    def section(self, s: float) -> Section:
        """The section at fraction s. Raises SceneError when the function returns anything else than a Section."""
        section = self.function(s)
        if not isinstance(section, Section):
            raise SceneError(
                f"Varying: at s = {s:g} its function returned {show(section)}, a Section is needed."
            )
        return section


@dataclass(frozen=True)
class ProfilePart(Profile):
    """The part of the profile `whole` between two fractions `part` of its length."""

    whole: Profile
    part: tuple[float, float]

    def __post_init__(self) -> None:
        first, last = self.part
        inside = tuple((s - first) / (last - first) for s in self.whole.breaks if first < s < last)
        object.__setattr__(self, "breaks", inside)

    def section(self, s: float) -> Section:
        """The section of the whole at fraction s of the part."""
        return self.whole.section(self.part[0] + s * (self.part[1] - self.part[0]))

    def sections(self, s: Array) -> SectionArrays:
        """The sections of the whole at fractions s (k,) of the part."""
        return self.whole.sections(self.part[0] + s * (self.part[1] - self.part[0]))
