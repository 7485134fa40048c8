"""Flexible leaf springs and wires between two rigid blocks: straight or curved, uniform or with a profile."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ksd.checks import (
    Axis,
    ClearArgumentErrors,
    Vector,
    as_given,
    clear_argument_errors,
    cross,
    direction,
    dot,
    made_perpendicular,
    positive,
    show,
    unit,
    vector,
    whole_number,
    word,
)
from ksd.errors import SceneError
from ksd.scene.curve import Curve, cached_line
from ksd.scene.material import Material
from ksd.scene.profile import Profile
from ksd.section import Section, circle
from ksd.section.plate import PlateStiffening
from ksd.section.warping import RestrainedTwist

CHORD_FIT = 1e-3
"""Largest difference of the chord of a curve and the distance of the ends of its leaf, over that distance."""


@dataclass(frozen=True)
class LeafCondition:
    """Deviation of an unloaded leaf from its drawing, by the heats and fits of a scene, and its plate and warping data.

    stretch: natural over drawn length; expansion: the part of it that is by heat, which adds no mass. natural_curvature
    [1/m]: about e3, added to the drawn one; shift (3,) [m] and turn (3,) [rad]: pose of the clamp of end q relative to the
    drawn one, in leaf axes. twist: with restrained warping, None for that of the leaf alone; plate: its plate stiffening,
    None without.
    """

    stretch: float = 1.0
    expansion: float = 1.0
    natural_curvature: float = 0.0
    shift: Vector = (0.0, 0.0, 0.0)
    turn: Vector = (0.0, 0.0, 0.0)
    twist: RestrainedTwist | None = None
    plate: PlateStiffening | None = None


@dataclass(frozen=True, kw_only=True)
class Leaf(metaclass=ClearArgumentErrors):
    """A leaf spring between a point on one rigid block and a point on another, clamped at both.

    start, end (3,) [m]: undeformed positions of its ends, in the frame of the joint it belongs to (global for a
    free-form leaf). width_axis (3,): direction of the width e3, perpendicular to the leaf; e1 points from start to end,
    and the thickness is along e2 = e3 x e1. None takes any perpendicular direction, for sections that are the same in
    all of them. start_block, end_block: names of the blocks (links) it is clamped to. elements: Appendix A elements
    along the leaf; orders: numbers of curvature modes about e1, e2, e3 of the strain-mode leaf; None leaves the choice
    to the model. profile: how the section varies along the leaf (`section` is then the nominal one); None is uniform.
    curve: its stress-free shape, whose chord must equal the distance from start to end; None is straight. condition:
    set by the model from the heats and fits of a scene (`Mechanism.heat`, `Mechanism.fit`). Raises SceneError for a
    leaf without length, a width axis that is not perpendicular to it, a curve that does not fit between the ends, or numbers
    that are not finite.

    >>> leaf = ksd.Leaf(
    ...     start=(0, 0, 0), end=(60 * mm, 0, 0), width_axis="z",
    ...     section=ksd.rectangle(0.3 * mm, 20 * mm), material=ksd.Material(E=200 * GPa, nu=0.3),
    ... )
    >>> print(f"{leaf.length / mm:.1f} mm, {leaf.material.E * leaf.section.Iz:.4f} N m^2")
    60.0 mm, 0.0090 N m^2
    """

    start: Vector
    end: Vector
    width_axis: Vector | None
    section: Section
    material: Material
    start_block: str = "A"
    end_block: str = "B"
    name: str = "leaf"
    elements: int | None = None
    orders: tuple[int, int, int] | None = None
    profile: Profile | None = None
    curve: Curve | None = None
    condition: LeafCondition | None = None

    def __post_init__(self) -> None:
        # in few calls: a scene may have hundreds of leaf springs, made again for every design
        owner, own = f"leaf '{word(self.name, 'name', owner='leaf')}'", self.__dict__
        word(self.start_block, "start_block", owner=owner)
        word(self.end_block, "end_block", owner=owner)
        own["start"] = vector(self.start, "start", owner=owner, unit="m")
        own["end"] = vector(self.end, "end", owner=owner, unit="m")
        if self.elements is not None or self.orders is not None:
            own.update(checked_mesh(self.elements, self.orders, owner=owner))
        if not isinstance(self.section, Section):
            raise SceneError(f"{owner}: section = {show(self.section)} must be a Section.")
        if not isinstance(self.material, Material):
            raise SceneError(f"{owner}: material = {show(self.material)} must be a Material.")
        if self.profile is not None and not isinstance(self.profile, Profile):
            raise SceneError(f"{owner}: profile = {show(self.profile)} must be a Profile, or None.")
        if self.curve is not None and not isinstance(self.curve, Curve):
            raise SceneError(f"{owner}: curve = {show(self.curve)} must be a Curve, or None.")
        self._check_axes(owner)
        if self.curve is not None and self.condition is None:
            # with a condition it is a leaf that was checked when it was drawn
            self._check_curve(owner, self.curve)

    def _check_axes(self, owner: str) -> None:
        """Check the length and the width axis, and make the width axis a unit vector. Raises SceneError."""
        length = math.dist(self.start, self.end)
        if not math.isfinite(length) or length == 0.0:
            raise SceneError(
                f"{owner}: from start {self.start} to end {self.end} its length is {length:g} m."
            )
        (x0, y0, z0), (x1, y1, z1) = self.start, self.end
        e1 = (x1 - x0) / length, (y1 - y0) / length, (z1 - z0) / length
        if self.width_axis is None:
            sizes = tuple(map(abs, e1))
            k = sizes.index(min(sizes))
            most_normal = (float(k == 0), float(k == 1), float(k == 2))
            axis = direction(cross(unit(e1), most_normal), "width_axis", owner=owner)
        else:
            axis = direction(self.width_axis, "width_axis", owner=owner)
        perpendicular = made_perpendicular(axis, e1, "width_axis", owner)
        if perpendicular is None:
            cosine = dot(axis, e1)
            projected = [a - cosine * b for a, b in zip(axis, e1, strict=True)]
            hint = f"; nearest: ({', '.join(f'{c:.6g}' for c in projected)})" if abs(cosine) < 0.999 else ""
            raise SceneError(
                f"{owner}: width_axis = {show(self.width_axis)} must be perpendicular to the leaf along "
                f"({', '.join(f'{c:.6g}' for c in e1)}){hint}."
            )
        self.__dict__["width_axis"] = perpendicular

    def _check_curve(self, owner: str, curve: Curve) -> None:
        """Check that the curve fits between the ends, and has a chord by which it can be placed. Raises SceneError."""
        end, _ = cached_line(curve, 1.0)
        chord, distance = math.hypot(*end), math.dist(self.start, self.end)
        if not abs(chord - distance) <= CHORD_FIT * distance:
            raise SceneError(
                f"{owner}: its curve spans {chord:.6g} m from start to end, but the ends are {distance:.6g} m apart; "
                "move an end or change the curve."
            )
        if math.hypot(end[0], end[1]) < 1e-6 * chord:
            raise SceneError(
                f"{owner}: its curve ends straight along the width of its start, so that width_axis does not say how it is "
                "turned about the line between its ends; cut it into two leaves."
            )

    @property
    def length(self) -> float:
        """Undeformed length [m]: the arc length of a curved leaf, else the distance between its ends."""
        return self.curve.length if self.curve is not None else math.dist(self.start, self.end)

    @property
    def directions(self) -> tuple[Vector, Vector, Vector]:
        """Orthonormal e1 along the chord, e2 thickness, e3 width, (3,) each, in the frame of start and end."""
        e1 = unit(tuple(b - a for a, b in zip(self.start, self.end, strict=True)))
        width = self.width_axis or (0.0, 0.0, 0.0)
        cosine = dot(width, e1)
        e3 = unit(tuple(a - cosine * b for a, b in zip(width, e1, strict=True)))
        return e1, cross(e3, e1), e3

    @property
    def axes(self) -> np.ndarray:
        """The matrix (3, 3) with `directions` as columns."""
        return np.array(self.directions).T.copy()

    def section_at(self, s: float) -> tuple[np.ndarray, np.ndarray]:
        """Position (3,) [m] and axes (3, 3), columns e1, e2, e3, of the section at fraction s of the undeformed length.

        Both are in the frame of start and end.
        """
        start, chord = np.asarray(self.start, float), self.axes
        if self.curve is None:
            return start + s * (np.asarray(self.end, float) - start), chord
        # rotate the chord of the curve onto that of the leaf, with their width directions in one plane
        end, _ = cached_line(self.curve, 1.0)
        e1 = end / np.linalg.norm(end)
        e3 = np.array([0.0, 0.0, 1.0]) - e1[2] * e1
        e3 /= np.linalg.norm(e3)
        frame = chord @ np.array([e1, np.cross(e3, e1), e3])
        position, axes = cached_line(self.curve, s)
        return start + frame @ position, frame @ axes


@clear_argument_errors
def wire(
    *,
    diameter: float,
    material: Material,
    start: ArrayLike,
    end: ArrayLike,
    width_axis: Axis | None = None,
    start_block: str = "A",
    end_block: str = "B",
    name: str = "wire",
    elements: int | None = None,
    orders: tuple[int, int, int] | None = None,
    profile: Profile | None = None,
    curve: Curve | None = None,
) -> Leaf:
    """A leaf of circular section, `diameter` in m; other parameters as in `Leaf`. Raises SceneError.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> leaf = ksd.wire(diameter=0.5 * mm, material=steel, start=(0, 0, 0), end=(50 * mm, 0, 0))
    >>> print(f"{leaf.length / mm:.1f} mm, {leaf.section.name}")
    50.0 mm, circle
    """
    section = circle(positive(diameter, "diameter", owner=f"wire '{name}'", unit="m"))
    return Leaf(
        start=as_given(start), end=as_given(end), width_axis=as_given(width_axis), section=section, material=material,
        start_block=start_block, end_block=end_block, name=name, elements=elements, orders=orders,
        profile=profile, curve=curve,
    )  # fmt: skip


def checked_mesh(elements: Any, orders: Any, *, owner: str) -> dict[str, Any]:
    """The mesh parameters `elements` and `orders` of a leaf or joint, checked. Raises SceneError."""
    if elements is not None:
        elements = whole_number(elements, "elements", owner=owner)
    if orders is not None:
        if not isinstance(orders, tuple | list) or len(orders) != 3:
            raise SceneError(
                f"{owner}: orders = {show(orders)} must be three whole numbers, modes about e1, e2, e3."
            )
        orders = tuple(whole_number(n, "orders", owner=owner) for n in orders)
    return {"elements": elements, "orders": orders}
