"""Parallel leaf-spring guides: B moves along y, parallel to A."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from ksd.checks import Vector
from ksd.scene.families.sheet import (
    JointFamily,
    bending_stiffness,
    check_ratio,
    check_sheet,
    parameter_dimensions,
    sheet_leaf,
)
from ksd.scene.joint import Motion
from ksd.scene.leaf import Leaf

_STROKE = 0.25
"""Stroke of a guide to either side, over its length."""


class _Guide(JointFamily):
    """Base of guides: the motion of B, driven at half the length of the leaf springs, where its force causes no moment,
    and the sides.
    """

    spacing: float

    @property
    def motions(self) -> tuple[Motion, ...]:
        L = self.length
        stroke_range = (-_STROKE * L, _STROKE * L)
        return (Motion("stroke", "translation", (0.0, 1.0, 0.0), stroke_range, (0.5 * L, 0.0, 0.0)),)

    def _sides(self) -> tuple[tuple[str, float], ...]:
        """Name and y [m] of both sides."""
        return ("low", -0.5 * self.spacing), ("high", 0.5 * self.spacing)


@dataclass(frozen=True, kw_only=True)
class ParallelGuide(_Guide):
    """Two parallel leaf springs; B moves along y, +-L/4, and sinks toward A by 0.6 stroke^2 / L.

    Joint axes: A at the origin, B at (L, 0, 0); the leaf springs run along x at y = +-spacing/2. The stroke is that
    of the point of B at (L/2, 0, 0), level with the middle of the leaf springs, so that its force does not rotate B.
    Tension and compression of the leaf springs tilt B, the more the smaller the spacing: for 0.3 L by 3e-4 rad, and there B
    is hardly stiffer in tilt than along the stroke at the end of the stroke.

    length L, thickness, width [m] of each leaf; spacing [m] of the leaf springs. Raises SceneError naming the
    parameter out of bounds.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> joint = ksd.ParallelGuide(
    ...     steel, length=60 * mm, thickness=0.3 * mm, width=20 * mm, spacing=60 * mm
    ... )
    >>> pose = ksd.solve(ksd.Mechanism.of_joint(joint), stroke=5 * mm)
    >>> print(f"{pose.forces['stroke']:.3f} N; linear {joint.stiffness_at_rest() * 5 * mm:.3f} N")
    5.036 N; linear 5.000 N
    """

    family: ClassVar[str] = "parallel_guide"
    quantities = parameter_dimensions("length", "thickness", "width", "spacing")

    length: float
    thickness: float
    width: float
    spacing: float
    elements: int | None = None
    orders: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        check_sheet(self, "width", "spacing")

    def leaves(self) -> tuple[Leaf, ...]:
        return tuple(
            sheet_leaf(self, name, ((0.0, y), (self.length, y)), self.width) for name, y in self._sides()
        )

    def shape(self) -> dict[str, float]:
        """The shape parameter spacing, over L."""
        return {"spacing": self.spacing / self.length}

    def stiffness_at_rest(self) -> float:
        """Undeformed drive stiffness [N/m] of two clamped-guided leaf springs: 24 E I / L^3."""
        return 24 * bending_stiffness(self, self.width) / self.length**3


@dataclass(frozen=True, kw_only=True)
class StiffenedGuide(_Guide):
    """The parallel guide with a stiffened middle in both leaf springs; B moves along y, +-L/4.

    As `ParallelGuide`, but each leaf consists of two leaf springs of length `flexible` L at its ends and a rigid block
    ("low", "high") between them: stiffer in all supporting directions, with hardly less stroke.

    flexible: flexible length at each end over L, 0.05..0.45; the other parameters as in `ParallelGuide`.
    Raises SceneError naming the parameter out of bounds.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> joint = ksd.StiffenedGuide(
    ...     steel, length=60 * mm, flexible=0.3, thickness=0.3 * mm, width=20 * mm,
    ...     spacing=60 * mm,
    ... )
    >>> pose = ksd.solve(ksd.Mechanism.of_joint(joint), stroke=5 * mm)
    >>> print(f"{pose.forces['stroke']:.3f} N")
    5.378 N
    """

    family: ClassVar[str] = "stiffened_guide"
    quantities = parameter_dimensions("length", "thickness", "width", "spacing", flexible="number")

    length: float
    flexible: float
    thickness: float
    width: float
    spacing: float
    elements: int | None = None
    orders: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        check_sheet(self, "width", "spacing")
        check_ratio(self, "flexible", 0.05, 0.45)

    def blocks(self) -> dict[str, Vector]:
        middles = {name: (0.5 * self.length, y, 0.0) for name, y in self._sides()}
        return {**super().blocks(), **middles}

    def leaves(self) -> tuple[Leaf, ...]:
        a, L = self.flexible * self.length, self.length
        leaves = []
        for name, y in self._sides():
            leaves.append(sheet_leaf(self, f"{name}_A", ((0.0, y), (a, y)), self.width, blocks=("A", name)))
            leaves.append(sheet_leaf(self, f"{name}_B", ((L - a, y), (L, y)), self.width, blocks=(name, "B")))
        return tuple(leaves)

    def shape(self) -> dict[str, float]:
        """The shape parameters flexible, the flexible length at each end over L, and spacing, over L."""
        return {"flexible": self.flexible, "spacing": self.spacing / self.length}

    def stiffness_at_rest(self) -> float:
        """Undeformed drive stiffness [N/m]: 24 E I / (L^3 (1 - (1 - 2 flexible)^3))."""
        stiff = 1 - (1 - 2 * self.flexible) ** 3
        return 24 * bending_stiffness(self, self.width) / (self.length**3 * stiff)
