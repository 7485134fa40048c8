"""Hinges of one flexible part: circular and corner-filleted notches, and the circular arc of paper 3.

A single leaf is soft not only in bending: it is at most twice as stiff in torsion, and an arc a few times as stiff against a
shift of B. The mechanism around them has to constrain those motions (`held_by_others`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from ksd.checks import Vector
from ksd.errors import SceneError
from ksd.scene.curve import Arc
from ksd.scene.families.sheet import (
    JointFamily,
    check_angle,
    check_lengths,
    parameter_dimensions,
    sheet_leaf,
)
from ksd.scene.leaf import Leaf
from ksd.scene.profile import CircularNotch, FilletedNotch

_NOTCH_STROKE = math.radians(10)
_ARC_STROKE = math.radians(30)


@dataclass(frozen=True, kw_only=True)
class CircularNotchHinge(JointFamily):
    """A neck between two half circles; B turns about z, +-10 degrees.

    Joint axes: A at the origin, B at (2R, 0, 0); the neck runs along x, t(x) = minimum + 2 (R - sqrt(R^2 - (x - R)^2))
    thick in y (Paros and Weisbord, Machine Design 37, 1965), width along z.

    radius R, minimum thickness and width [m]; minimum below R. Raises SceneError naming the parameter out of bounds.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> joint = ksd.CircularNotchHinge(
    ...     steel, radius=5 * mm, minimum=0.3 * mm, width=10 * mm
    ... )
    >>> pose = ksd.solve(ksd.Mechanism.of_joint(joint), angle=2 * deg)
    >>> print(f"{pose.forces['angle']:.4f} Nm")
    0.1097 Nm
    """

    family: ClassVar[str] = "circular_notch"
    held_by_others = True
    stroke = _NOTCH_STROKE
    quantities = parameter_dimensions("radius", "minimum", "width")

    radius: float
    minimum: float
    width: float
    elements: int | None = None
    orders: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        check_lengths(self, "radius", "minimum", "width")
        if self.minimum >= self.radius:
            raise SceneError(
                f"CircularNotchHinge: minimum = {self.minimum:g} m must be below radius = {self.radius:g} m."
            )

    @property
    def length(self) -> float:  # type: ignore[override]
        """Length of the neck [m], 2R."""
        return 2 * self.radius

    def leaves(self) -> tuple[Leaf, ...]:
        return (_neck(self, CircularNotch(radius=self.radius, minimum=self.minimum, width=self.width)),)

    def shape(self) -> dict[str, float]:
        """The shape parameter slenderness = minimum / R."""
        return {"slenderness": self.minimum / self.radius}

    def stiffness_at_rest(self) -> float:
        """Undeformed drive stiffness [Nm/rad], all sections in series (closed form of Paros and Weisbord).

        With h(a) = minimum + 2R (1 - cos a): 1 / K = 12 R / (E width) int cos a / h^3 da over -90..90 degrees.
        """
        g = 1 + 0.5 * self.minimum / self.radius
        return self.material.E * self.width / (12 * self.radius * _notch_integral(g) / (2 * self.radius) ** 3)


def _notch_integral(g: float) -> float:
    """int_-pi/2^pi/2 cos a / (g - cos a)^3 da for g > 1."""
    # u = tan(a/2) makes the integrands rational; int da/(g - cos a) is differentiated twice with respect to g
    s = g * g - 1
    limit = 2 * math.atan(math.sqrt((g + 1) / (g - 1)))
    first = 2 * limit / math.sqrt(s)
    second = (g * first + 2 / g) / s
    third = (3 * g * second - first + 2 / g**2) / (2 * s)
    return g * third - second


@dataclass(frozen=True, kw_only=True)
class FilletedNotchHinge(JointFamily):
    """A straight neck with quarter-circle fillets at both ends; B turns about z, +-10 degrees.

    Joint axes: A at the origin, B at (length, 0, 0); the neck runs along x, width along z (Lobontiu, Compliant
    Mechanisms, 2003, the corner-filleted hinge).

    length [m] with both fillets, radius of the fillets below half of it, minimum thickness, width [m]. Raises SceneError
    naming the parameter out of bounds.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> joint = ksd.FilletedNotchHinge(
    ...     steel, length=10 * mm, radius=2 * mm, minimum=0.3 * mm, width=10 * mm
    ... )
    >>> pose = ksd.solve(ksd.Mechanism.of_joint(joint), angle=3 * deg)
    >>> print(f"{pose.forces['angle']:.4f} Nm")
    0.0342 Nm
    """

    family: ClassVar[str] = "filleted_notch"
    held_by_others = True
    stroke = _NOTCH_STROKE
    quantities = parameter_dimensions("length", "radius", "minimum", "width")

    length: float
    radius: float
    minimum: float
    width: float
    elements: int | None = None
    orders: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        check_lengths(self, "length", "radius", "minimum", "width")
        if self.minimum >= 0.5 * self.length:
            raise SceneError(
                f"FilletedNotchHinge: minimum = {self.minimum:g} m must be below half its length, {self.length / 2:g} m."
            )

    def leaves(self) -> tuple[Leaf, ...]:
        return (
            _neck(
                self,
                FilletedNotch(length=self.length, radius=self.radius, minimum=self.minimum, width=self.width),
            ),
        )

    def shape(self) -> dict[str, float]:
        """The shape parameters slenderness = minimum / length and fillet = radius / length."""
        return {"slenderness": self.minimum / self.length, "fillet": self.radius / self.length}

    def stiffness_at_rest(self) -> float:
        """Undeformed drive stiffness [Nm/rad], all sections in series (Lobontiu 2003).

        Both fillets together are a circular notch; the straight neck of length - 2 radius has E I = E width minimum^3 / 12.
        """
        fillets = self.radius * _notch_integral(1 + 0.5 * self.minimum / self.radius) / (2 * self.radius) ** 3
        neck = (self.length - 2 * self.radius) / self.minimum**3
        return self.material.E * self.width / 12 / (fillets + neck)


def _neck(joint: Any, profile: CircularNotch | FilletedNotch) -> Leaf:
    """The notch as one leaf of varying thickness."""
    ends = (0.0, 0.0), (joint.length, 0.0)
    return sheet_leaf(joint, "neck", ends, joint.width, thickness=joint.minimum, profile=profile)


@dataclass(frozen=True, kw_only=True)
class ArcHinge(JointFamily):
    """A leaf whose undeformed shape is a circular arc, the curved beam of paper 3; B turns about z, +-30 degrees.

    Joint axes: A at the origin, B at (2 r sin(angle/2), 0, 0), the chord; the arc lies at y < 0 and curves about +z,
    widths along z. B turns under a pure moment, so that the curvature stays constant along the arc.

    radius r [m] and angle [rad] of the arc, up to 270 degrees; thickness, width [m]. Raises SceneError naming the parameter
    out of bounds.

    >>> plastic = ksd.Material(E=2.5 * GPa, nu=0.3)
    >>> joint = ksd.ArcHinge(
    ...     plastic, radius=4 * mm, angle=270 * deg, thickness=0.4 * mm, width=6 * mm
    ... )
    >>> pose = ksd.solve(ksd.Mechanism.of_joint(joint), angle=15 * deg)
    >>> print(f"{pose.forces['angle']:.6f} Nm")
    0.001111 Nm
    """

    family: ClassVar[str] = "arc_hinge"
    held_by_others = True
    stroke = _ARC_STROKE
    quantities = parameter_dimensions("radius", "thickness", "width", angle="angle")

    radius: float
    angle: float
    thickness: float
    width: float
    elements: int | None = None
    orders: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        check_lengths(self, "radius", "thickness", "width")
        # an angle of 270 degrees is allowed
        check_angle(self, "angle", 1.5 * math.pi * (1 + 1e-12))
        if self.thickness >= 0.5 * self.radius:
            raise SceneError(
                f"ArcHinge: thickness = {self.thickness:g} m must be below half the radius, {self.radius / 2:g} m."
            )

    @property
    def length(self) -> float:  # type: ignore[override]
        """Length of the arc [m]."""
        return self.radius * self.angle

    @property
    def pose_B(self) -> Vector:
        return (2 * self.radius * math.sin(0.5 * self.angle), 0.0, 0.0)

    def leaves(self) -> tuple[Leaf, ...]:
        ends = (0.0, 0.0), self.pose_B[:2]
        return (sheet_leaf(self, "arc", ends, self.width, curve=Arc(radius=self.radius, angle=self.angle)),)

    def shape(self) -> dict[str, float]:
        """The shape parameter angle of the arc [rad]."""
        return {"angle": self.angle}

    def stiffness_at_rest(self) -> float:
        """Undeformed drive stiffness [Nm/rad] for a pure moment: E I / (r angle) (errata, paper 3)."""
        return self.material.E * self.width * self.thickness**3 / 12 / self.length
