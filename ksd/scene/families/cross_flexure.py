"""The cross flexure of paper 1, section 4.1: an inner leaf crossed by two outer leaf springs."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

from ksd.checks import not_negative, positive, show
from ksd.errors import SceneError
from ksd.scene.clearance import check_clear
from ksd.scene.families.sheet import InclinedLeaves, parameter_dimensions, sheet_leaf
from ksd.scene.joint import joint_leaves
from ksd.scene.leaf import Leaf
from ksd.scene.material import Material

_STROKE = math.radians(75)
_OWNER = "CrossFlexure"
"""Start of messages."""


@dataclass(frozen=True)
class CrossFlexure(InclinedLeaves):
    """Three leaf springs crossing in their middle; B turns about z relative to A, +-75 degrees.

    Joint axes: A at the origin, B at (L cos(angle), 0, 0), z along the widths. With h = L sin(angle)/2 the
    inner leaf runs from (0, -h, 0) to (L cos(angle), +h, 0), the two outer ones from (0, +h, +-c) to (L
    cos(angle), -h, +-c), c = spacing.

    length L [m] of the leaf springs; angle [rad] between leaf and the line AB, 0..90 degrees; thickness [m];
    widths (inner, outer) [m], the outer width being that of each outer leaf. gap [m]: free distance along z
    between inner and outer leaf springs, c = (inner + outer)/2 + gap; spacing [m] gives c itself instead. elements,
    orders: mesh of every leaf, see `Leaf`. Raises SceneError naming the parameter out of bounds.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> joint = ksd.CrossFlexure(
    ...     steel, length=100 * mm, angle=45 * deg, thickness=1 * mm,
    ...     widths=(40 * mm, 20 * mm),
    ... )
    >>> pose = ksd.solve(ksd.Mechanism.of_joint(joint), angle=45 * deg)
    >>> print(f"{pose.forces['angle']:.3f} Nm")
    11.448 Nm
    """

    family: ClassVar[str] = "cross_flexure"
    stroke = _STROKE
    quantities = parameter_dimensions("length", "thickness", "widths", "gap", "spacing", angle="angle")

    material: Material
    length: float
    angle: float
    thickness: float
    widths: tuple[float, float]
    spacing: float
    elements: int | None
    orders: tuple[int, int, int] | None

    def __init__(
        self,
        material: Material,
        *,
        length: float,
        angle: float,
        thickness: float,
        widths: tuple[float, float],
        gap: float | None = None,
        spacing: float | None = None,
        elements: int | None = None,
        orders: tuple[int, int, int] | None = None,
    ) -> None:
        pair = _widths(widths)
        self.__dict__.update(
            material=material, length=length, angle=angle, thickness=thickness, widths=pair,
            spacing=_spacing(pair, gap, spacing), elements=elements, orders=orders,
        )  # fmt: skip
        self.check_inclined()
        check_clear(
            joint_leaves(self), owner=_OWNER, advice="raise the spacing to half the sum of the widths"
        )

    def leaves(self) -> tuple[Leaf, ...]:
        x, h, c = self.pose_B[0], 0.5 * self.length * math.sin(self.angle), self.spacing
        inner, outer = self.widths
        places = (("inner", inner, -h, 0.0), ("outer_low", outer, h, -c), ("outer_high", outer, h, c))
        return tuple(sheet_leaf(self, name, ((0.0, y), (x, -y)), width, z=z) for name, width, y, z in places)

    def shape(self) -> dict[str, float]:
        """The shape parameters angle [rad] and width_ratio = both outer widths over the inner one."""
        return {"angle": self.angle, "width_ratio": 2 * self.widths[1] / self.widths[0]}

    def stiffness_at_rest(self) -> float:
        """Undeformed drive stiffness [Nm/rad]: the sum of E I / L of all leaf springs, for any angle.

        Each bends to a circle (paper 1, eq. 4.3 without its factor 2, see errata).
        """
        return self.material.E * (self.widths[0] + 2 * self.widths[1]) * self.thickness**3 / 12 / self.length


def _widths(widths: Any) -> tuple[float, float]:
    """Widths (inner, outer) [m], checked. Raises SceneError."""
    if not isinstance(widths, tuple | list) or len(widths) != 2:
        raise SceneError(f"{_OWNER}: widths = {show(widths)} must be two lengths (inner, outer) in m.")
    inner, outer = (
        positive(w, f"widths[{i}] ({k})", owner=_OWNER, unit="m")
        for i, (w, k) in enumerate(zip(widths, ("inner", "outer"), strict=True))
    )
    return inner, outer


def _spacing(widths: tuple[float, float], gap: Any, spacing: Any) -> float:
    """Distance [m] of the outer leaf springs from the inner one along z, from gap or spacing. Raises SceneError."""
    if gap is not None and spacing is not None:
        raise SceneError(
            f"{_OWNER}: gap = {show(gap)} and spacing = {show(spacing)} say the same; give one of them."
        )
    if spacing is not None:
        return positive(spacing, "spacing", owner=_OWNER, unit="m")
    clearance = 0.0 if gap is None else not_negative(gap, "gap", owner=_OWNER, unit="m")
    return 0.5 * (widths[0] + widths[1]) + clearance
