"""Cartwheel and butterfly: remote-centre pivots in series around one centre."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from ksd.checks import Vector
from ksd.errors import SceneError
from ksd.scene.families.crossed_pivot import pivot_stiffness
from ksd.scene.families.sheet import (
    InclinedLeaves,
    JointFamily,
    Point,
    bending_stiffness,
    check_angle,
    check_sheet,
    in_plane_blocks,
    parameter_dimensions,
    sheet_leaf,
)
from ksd.scene.leaf import Leaf

_CARTWHEEL_STROKE = math.radians(20)
_BUTTERFLY_STROKE = math.radians(30)


@dataclass(frozen=True, kw_only=True)
class Cartwheel(InclinedLeaves):
    """Two leaf springs crossing in their middle and joined there by a hub; B turns about z, +-20 degrees.

    Joint axes: A at the origin, B at (L cos(angle), 0, 0), the hub (internal block) at the middle; the four
    half leaf springs run from the hub to (0, +-h, 0) on A and (L cos(angle), +-h, 0) on B, h = L sin(angle)/2. Two
    remote-centre pivots in series, each turning half the angle (Smith, Flexures, 2000, section 5.3).

    length L [m] of a whole leaf, through the hub; angle [rad] between leaf and the line AB, 0..90 degrees;
    thickness, width [m]. Raises SceneError naming the parameter out of bounds.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> joint = ksd.Cartwheel(
    ...     steel, length=50 * mm, angle=45 * deg, thickness=0.3 * mm, width=15 * mm
    ... )
    >>> pose = ksd.solve(ksd.Mechanism.of_joint(joint), angle=15 * deg)
    >>> print(f"{pose.forces['angle']:.4f} Nm")
    0.2821 Nm
    """

    family: ClassVar[str] = "cartwheel"
    stroke = _CARTWHEEL_STROKE
    quantities = parameter_dimensions("length", "thickness", "width", angle="angle")

    length: float
    angle: float
    thickness: float
    width: float
    elements: int | None = None
    orders: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        self.check_inclined("width")

    def blocks(self) -> dict[str, Vector]:
        return {**super().blocks(), "hub": (0.5 * self.pose_B[0], 0.0, 0.0)}

    def leaves(self) -> tuple[Leaf, ...]:
        x, h = self.pose_B[0], 0.5 * self.length * math.sin(self.angle)
        hub = (0.5 * x, 0.0)
        spokes = []
        for name, y in (("low", -h), ("high", h)):
            spokes.append(sheet_leaf(self, f"A_{name}", ((0.0, y), hub), self.width, blocks=("A", "hub")))
            spokes.append(sheet_leaf(self, f"B_{name}", (hub, (x, y)), self.width, blocks=("hub", "B")))
        return tuple(spokes)

    def shape(self) -> dict[str, float]:
        """The shape parameter angle [rad]."""
        return {"angle": self.angle}

    def stiffness_at_rest(self) -> float:
        """Undeformed drive stiffness [Nm/rad], inextensible leaf springs: 8 E I / L, four times that of the crossed pair."""
        return 0.5 * pivot_stiffness(1.0, bending_stiffness(self, self.width) / (0.5 * self.length))


_PIVOTS = (
    ("A", "left", math.pi),
    ("left", "top", math.radians(120)),
    ("top", "right", math.radians(60)),
    ("right", "B", 0.0),
)
"""The pivots of a butterfly in series: two blocks, and the direction [rad] of the bisector of its leaf springs."""


@dataclass(frozen=True, kw_only=True)
class Butterfly(JointFamily):
    """Four remote-centre pivots in series around one centre O; B turns about z, +-30 degrees.

    Joint axes: A at the origin, O at (R, 0, 0) with R = inner + L, B at (2R, 0, 0). Eight leaf springs lie on rays
    from O between the radii `inner` and R, two per pivot at +-half_angle from the directions 180, 120, 60
    and 0 degrees. They join, in this order, A (outer ends), "left" (inner ends), "top" (outer), "right"
    (inner) and B (outer); each pivot turns a quarter of the angle. After the butterfly pivot of Henein and
    others (10th ESMATS, 2003); arrangement and names are our own.

    length L [m] of a leaf, inner radius, thickness, width [m]; half_angle [rad], 0..30 degrees. Raises
    SceneError naming the parameter out of bounds.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> joint = ksd.Butterfly(
    ...     steel, length=20 * mm, inner=8 * mm, half_angle=20 * deg, thickness=0.3 * mm,
    ...     width=15 * mm,
    ... )
    >>> pose = ksd.solve(ksd.Mechanism.of_joint(joint), angle=20 * deg)
    >>> print(f"{pose.forces['angle']:.4f} Nm")
    0.6233 Nm
    """

    family: ClassVar[str] = "butterfly"
    stroke = _BUTTERFLY_STROKE
    quantities = parameter_dimensions("length", "inner", "thickness", "width", half_angle="angle")

    length: float
    inner: float
    half_angle: float
    thickness: float
    width: float
    elements: int | None = None
    orders: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        check_sheet(self, "inner", "width")
        check_angle(self, "half_angle", math.pi / 6)
        if self.inner * math.sin(self.half_angle) < 0.5 * self.thickness:
            raise SceneError(
                f"Butterfly: inner = {self.inner:g} m brings the leaf springs of one pair together at half_angle = "
                f"{self.half_angle / math.radians(1):g} deg; move them outward."
            )

    @property
    def _outer_radius(self) -> float:
        """Distance R [m] of A and B from the centre O."""
        return self.inner + self.length

    @property
    def pose_B(self) -> Vector:
        return (2 * self._outer_radius, 0.0, 0.0)

    def _on_ray(self, radius: float, angle: float) -> Point:
        """The point (x, y) [m] at a radius [m] from O in the direction `angle` [rad]."""
        return self._outer_radius + radius * math.cos(angle), radius * math.sin(angle)

    def blocks(self) -> dict[str, Vector]:
        points = {
            "left": self._on_ray(self.inner, math.radians(150)),
            "top": self._on_ray(self._outer_radius, math.pi / 2),
            "right": self._on_ray(self.inner, math.radians(30)),
        }
        return {**super().blocks(), **in_plane_blocks(points)}

    def leaves(self) -> tuple[Leaf, ...]:
        leaves = []
        for first, second, bisector in _PIVOTS:
            inward = first in ("A", "top")
            radii = (self._outer_radius, self.inner) if inward else (self.inner, self._outer_radius)
            for k, side in ((1, -1.0), (2, 1.0)):
                angle = bisector + side * self.half_angle
                ends = self._on_ray(radii[0], angle), self._on_ray(radii[1], angle)
                leaves.append(
                    sheet_leaf(self, f"{first}_{second}_{k}", ends, self.width, blocks=(first, second))
                )
        return tuple(leaves)

    def shape(self) -> dict[str, float]:
        """The shape parameters inner_ratio = inner / L and half_angle [rad]."""
        return {"inner_ratio": self.inner / self.length, "half_angle": self.half_angle}

    def stiffness_at_rest(self) -> float:
        """Undeformed drive stiffness [Nm/rad]: a quarter of that of an inverted crossed pivot of ratio -inner / L."""
        ratio = -self.inner / self.length
        return 0.25 * pivot_stiffness(ratio, bending_stiffness(self, self.width) / self.length)
