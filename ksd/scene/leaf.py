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


@dataclass(frozen=True)
class LeafCondition:
    """How a leaf differs from what is drawn when nothing loads it; made from the heats and fits of a scene.

    stretch: natural over drawn length; bow [1/m]: natural curvature about e3 on top of the drawn one; shift (3,) [m]
    and turn (3,) [rad]: where end q is clamped, seen from where it is drawn, in leaf axes. bend [1/m]: curvature at
    which plate stiffening is taken; torsion: factor on GJ where warping is restrained, 0 that of the leaf by itself.
    """

    stretch: float = 1.0
    bow: float = 0.0
    shift: Vector = (0.0, 0.0, 0.0)
    turn: Vector = (0.0, 0.0, 0.0)
    bend: float = 0.0
    torsion: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Leaf(metaclass=ClearArgumentErrors):
    """A flexible leaf between a point on one rigid block and a point on another, clamped at both.

    start, end [m], (3,): its ends at rest, in the frame of the joint it belongs to (global for a free-form
    leaf). width_axis (3,): unit direction of the width e3, perpendicular to the leaf; e1 runs from start to
    end, the thickness e2 = e3 x e1. None picks any perpendicular, for sections that are the same in all
    directions. start_block, end_block: names of the blocks (links) it is clamped to. elements: Appendix A
    elements along the leaf; orders: curvature modes (about e1, e2, e3) of the strain-mode leaf; None leaves
    the choice to the model. profile: how the section varies along it (`section` is then its nominal one); None is
    uniform. curve: its stress-free shape, whose chord must fit start and end; None is straight. condition: set by the
    model from the heats and fits of a scene (`Mechanism.heat`, `Mechanism.fit`).
    Raises SceneError for a leaf without
    length, a width axis not perpendicular to it, or numbers that are not finite.
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
        # in few calls: a scene may have hundreds of them, made anew for every design
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

    def _check_axes(self, owner: str) -> None:
        length = math.dist(self.start, self.end)
        if not math.isfinite(length) or length == 0.0:
            raise SceneError(
                f"{owner}: from start {self.start} to end {self.end} its length is {length:g} m."
            )
        (x0, y0, z0), (x1, y1, z1) = self.start, self.end
        e1 = (x1 - x0) / length, (y1 - y0) / length, (z1 - z0) / length
        if self.width_axis is None:
            least = np.eye(3)[np.argmin(np.abs(e1))]
            axis = direction(np.cross(unit(e1), least), "width_axis", owner=owner)
        else:
            axis = direction(self.width_axis, "width_axis", owner=owner)
        lean = dot(axis, e1)
        if abs(lean) > 1e-6:
            flat = [a - lean * b for a, b in zip(axis, e1, strict=True)]
            hint = f"; nearest: ({', '.join(f'{c:.6g}' for c in flat)})" if abs(lean) < 0.999 else ""
            raise SceneError(
                f"{owner}: width_axis = {show(self.width_axis)} must be perpendicular to the leaf along "
                f"({', '.join(f'{c:.6g}' for c in e1)}){hint}."
            )
        self.__dict__["width_axis"] = axis

    @property
    def length(self) -> float:
        """Length at rest [m]: of the arc for a curved leaf, else the distance between its ends."""
        return self.curve.length if self.curve is not None else math.dist(self.start, self.end)

    @property
    def directions(self) -> tuple[Vector, Vector, Vector]:
        """Unit vectors e1 along the chord, e2 thickness, e3 width, orthonormal, in the frame of start and end."""
        e1 = unit(tuple(b - a for a, b in zip(self.start, self.end, strict=True)))
        width = self.width_axis or (0.0, 0.0, 0.0)
        lean = dot(width, e1)
        e3 = unit(tuple(a - lean * b for a, b in zip(width, e1, strict=True)))
        return e1, cross(e3, e1), e3

    @property
    def axes(self) -> np.ndarray:
        """(3, 3): `directions` as columns."""
        return np.array(self.directions).T.copy()

    def section_at(self, s: float) -> tuple[np.ndarray, np.ndarray]:
        """Place (3,) [m] and axes (3, 3), columns e1 along, e2, e3, of its section at fraction s of its length at rest, in
        the frame of start and end."""
        start, chord = np.asarray(self.start, float), self.axes
        if self.curve is None:
            return start + s * (np.asarray(self.end, float) - start), chord
        # its line from the end p, whose chord is turned onto that of the leaf with the widths in one plane
        end, _ = cached_line(self.curve, 1.0)
        e1 = end / np.linalg.norm(end)
        e3 = np.array([0.0, 0.0, 1.0]) - e1[2] * e1
        e3 /= np.linalg.norm(e3)
        frame = chord @ np.array([e1, np.cross(e3, e1), e3])
        place, axes = cached_line(self.curve, s)
        return start + frame @ place, frame @ axes


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
    """A leaf of circular section, `diameter` in m; other words as in `Leaf` (no width_axis needed). Raises SceneError."""
    section = circle(positive(diameter, "diameter", owner=f"wire '{name}'", unit="m"))
    return Leaf(
        start=as_given(start), end=as_given(end), width_axis=as_given(width_axis), section=section, material=material,
        start_block=start_block, end_block=end_block, name=name, elements=elements, orders=orders,
        profile=profile, curve=curve,
    )  # fmt: skip


def checked_mesh(elements: Any, orders: Any, *, owner: str) -> dict[str, Any]:
    """Checked `elements` and `orders` of a leaf or a joint."""
    if elements is not None:
        elements = whole_number(elements, "elements", owner=owner)
    if orders is not None:
        if not isinstance(orders, tuple | list) or len(orders) != 3:
            raise SceneError(
                f"{owner}: orders = {show(orders)} must be three whole numbers, modes about e1, e2, e3."
            )
        orders = tuple(whole_number(n, "orders", owner=owner) for n in orders)
    return {"elements": elements, "orders": orders}
