"""Two-axis universal joint: two cross flexures in series, their axes perpendicular."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from ksd.checks import Vector
from ksd.scene.families.sheet import JointFamily, bending_stiffness, check_sheet, parameter_dimensions
from ksd.scene.joint import Motion
from ksd.scene.leaf import Leaf
from ksd.section import rectangle

_STROKE = math.radians(25)
_ANGLE = math.radians(45)
"""Angle [rad] between the leaf springs and the x axis."""


@dataclass(frozen=True, kw_only=True)
class UniversalJoint(JointFamily):
    """Two cross flexures in series; B turns about z and about y, +-25 degrees each.

    Joint axes: A at the origin, the middle block at (D, 0, 0) with D = L cos(45 deg), B at (2D, 0, 0). The
    first flexure is the `CrossFlexure` at 45 degrees with an inner leaf and two outer ones of half its
    width, from A to the middle; the second is the same, shifted by D and turned about x by -90 degrees, so
    that its axis is y. Its rotations are the twist angles of B relative to A about z and y, in the axes of A.

    length L [m] of a leaf; thickness [m]; width [m] of the inner leaf springs, whose ratio to L is the shape parameter
    `aspect`. Raises SceneError naming the parameter out of bounds.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> joint = ksd.UniversalJoint(steel, length=40 * mm, thickness=0.3 * mm, width=15 * mm)
    >>> pose = ksd.solve(ksd.Mechanism.of_joint(joint), about_z=10 * deg, about_y=5 * deg)
    >>> {name: round(moment, 4) for name, moment in pose.forces.items()}
    {'about_z': 0.0591, 'about_y': 0.0294}
    """

    family: ClassVar[str] = "universal"
    quantities = parameter_dimensions("length", "thickness", "width")

    length: float
    thickness: float
    width: float
    elements: int | None = None
    orders: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        check_sheet(self, "width")

    @property
    def _stage_length(self) -> float:
        """Length D [m] of one cross flexure along x."""
        return self.length * math.cos(_ANGLE)

    @property
    def pose_B(self) -> Vector:
        return (2 * self._stage_length, 0.0, 0.0)

    @property
    def motions(self) -> tuple[Motion, ...]:
        stroke_range = (-_STROKE, _STROKE)
        return (
            Motion("about_z", "rotation", (0.0, 0.0, 1.0), stroke_range),
            Motion("about_y", "rotation", (0.0, 1.0, 0.0), stroke_range),
        )

    def blocks(self) -> dict[str, Vector]:
        return {**super().blocks(), "middle": (self._stage_length, 0.0, 0.0)}

    def leaves(self) -> tuple[Leaf, ...]:
        h, c = 0.5 * self.length * math.sin(_ANGLE), 0.75 * self.width
        # name, y and z of the start, width over that of the inner leaf
        drawing = (("inner", -h, 0.0, 1.0), ("outer_low", h, -c, 0.5), ("outer_high", h, c, 0.5))
        return tuple(
            self._leaf(f"{stage}_{name}", (y, z), ratio * self.width, is_second=stage == "second")
            for stage in ("first", "second")
            for name, y, z, ratio in drawing
        )

    def _leaf(self, name: str, start_yz: tuple[float, float], width: float, *, is_second: bool) -> Leaf:
        """A leaf from (y, z) at its start to (-y, z) at its end, of the first or the turned second cross flexure."""
        (y, z), x = start_yz, self._stage_length
        start, end, axis = (0.0, y, z), (x, -y, z), (0.0, 0.0, 1.0)
        if is_second:
            # rotation about x by -90 degrees and shift by D: (x, y, z) -> (x + D, z, -y)
            start, end, axis = (x, z, -y), (2 * x, z, y), (0.0, 1.0, 0.0)
        return Leaf(
            start=start,
            end=end,
            width_axis=axis,
            section=rectangle(self.thickness, width),
            material=self.material,
            start_block="middle" if is_second else "A",
            end_block="B" if is_second else "middle",
            name=name,
            elements=self.elements,
            orders=self.orders,
        )

    def shape(self) -> dict[str, float]:
        """The shape parameter aspect = width / L, which sets the distance of the outer leaf springs from each other."""
        return {"aspect": self.width / self.length}

    def stiffness_at_rest(self) -> float:
        """Undeformed drive stiffness [Nm/rad] about either axis, the other released: E I_sum / L (errata, eq. 4.3)."""
        return 2 * bending_stiffness(self, self.width) / self.length
