"""Crossed pivots: leaf springs that cross at any fraction of their length, or only on their extension."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from ksd.checks import not_negative
from ksd.scene.families.sheet import (
    InclinedLeaves,
    bending_stiffness,
    check_ratio,
    parameter_dimensions,
    sheet_leaf,
)
from ksd.scene.leaf import Leaf

_STROKE = math.radians(30)
_RATIO_RANGE = (-1.0, 2.0)


def pivot_stiffness(ratio: float, bending_per_length: float) -> float:
    """Undeformed stiffness [Nm/rad] of two leaf springs of E I / L = `bending_per_length` [Nm] crossing at `ratio`.

    K = 8 (1 - 3 ratio + 3 ratio^2) E I / L for inextensible leaf springs: each carries M/2 at its middle, and the shear
    force by which its end stays on a circle about the crossing (Haringx 1949; paper 4, chapter 3).
    """
    return 8 * (1 - 3 * ratio + 3 * ratio**2) * bending_per_length


@dataclass(frozen=True, kw_only=True)
class CrossedPivot(InclinedLeaves):
    """Two leaf springs crossing at the fraction `ratio` of their length from A; B turns about z, +-30 degrees.

    Joint axes: A at the origin, B at (L cos(angle), 0, 0). With s = L sin(angle) the rising leaf runs from
    (0, -ratio s, 0) to (L cos(angle), (1 - ratio) s, 0), the falling one is its mirror image in y = 0; they
    cross at x = ratio L cos(angle). ratio 0.5: the symmetric cross; 0 or 1: crossing at A or B (remote
    centre); outside 0..1: the inverted pivot, whose leaf springs meet only on their extension. Both leaf springs lie in
    one plane: where they cross, one passes through a window of the other, whose effect on the stiffness is
    left out (half the width over up to 0.3 L at 60 degrees).

    length L [m] and thickness, width [m] of each leaf; angle [rad] between leaf and the line AB, 0..90
    degrees. Raises SceneError naming the parameter out of bounds.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> joint = ksd.CrossedPivot(
    ...     steel, length=50 * mm, angle=45 * deg, thickness=0.3 * mm, width=15 * mm
    ... )
    >>> pose = ksd.solve(ksd.Mechanism.of_joint(joint), angle=20 * deg)
    >>> print(f"{pose.forces['angle']:.4f} Nm")
    0.0961 Nm
    """

    family: ClassVar[str] = "crossed_pivot"
    stroke = _STROKE
    windows = True
    quantities = parameter_dimensions("length", "thickness", "width", angle="angle", ratio="number")

    length: float
    angle: float
    thickness: float
    width: float
    ratio: float = 0.5
    elements: int | None = None
    orders: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        self.check_inclined("width")
        check_ratio(self, "ratio", *_RATIO_RANGE)

    def leaves(self) -> tuple[Leaf, ...]:
        x, s = self.pose_B[0], self.length * math.sin(self.angle)
        low, high = -self.ratio * s, (1 - self.ratio) * s
        rising = sheet_leaf(self, "rising", ((0.0, low), (x, high)), self.width)
        return rising, sheet_leaf(self, "falling", ((0.0, -low), (x, -high)), self.width)

    def shape(self) -> dict[str, float]:
        """The shape parameters angle [rad] and ratio."""
        return {"angle": self.angle, "ratio": self.ratio}

    def stiffness_at_rest(self) -> float:
        """Undeformed drive stiffness [Nm/rad], 8 (1 - 3 ratio + 3 ratio^2) E I / L, see `pivot_stiffness`."""
        return pivot_stiffness(self.ratio, bending_stiffness(self, self.width) / self.length)


@dataclass(frozen=True, kw_only=True)
class BalancedCrossedPivot(InclinedLeaves):
    """The crossed pivot with one inner and two outer leaf springs, symmetric in z; B turns about z, +-30 degrees.

    The inner leaf is the rising one of `CrossedPivot`, the outer leaf springs are the falling one at z = +-c, c =
    (inner + outer)/2 + gap, so that no windows are needed and out-of-plane loads are carried symmetrically. ratio 0.5 is
    the cross flexure of paper 1, with a smaller stroke.

    inner_width, outer_width [m], the latter that of each outer leaf; gap [m] along z between inner
    and outer leaf springs; the others as in `CrossedPivot`. Raises SceneError naming the parameter out of bounds.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> joint = ksd.BalancedCrossedPivot(
    ...     steel, length=50 * mm, angle=45 * deg, thickness=0.3 * mm,
    ...     inner_width=20 * mm, outer_width=10 * mm, ratio=0.2,
    ... )
    >>> pose = ksd.solve(ksd.Mechanism.of_joint(joint), angle=20 * deg)
    >>> print(f"{pose.forces['angle']:.4f} Nm")
    0.2638 Nm
    """

    family: ClassVar[str] = "balanced_crossed_pivot"
    stroke = _STROKE
    quantities = parameter_dimensions(
        "length", "thickness", "inner_width", "outer_width", "gap", angle="angle", ratio="number"
    )

    length: float
    angle: float
    thickness: float
    inner_width: float
    outer_width: float
    ratio: float = 0.5
    gap: float = 0.0
    elements: int | None = None
    orders: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        self.check_inclined("inner_width", "outer_width")
        check_ratio(self, "ratio", *_RATIO_RANGE)
        object.__setattr__(self, "gap", not_negative(self.gap, "gap", owner="BalancedCrossedPivot", unit="m"))

    def leaves(self) -> tuple[Leaf, ...]:
        x, s = self.pose_B[0], self.length * math.sin(self.angle)
        low, high = -self.ratio * s, (1 - self.ratio) * s
        c = 0.5 * (self.inner_width + self.outer_width) + self.gap
        falling = ((0.0, -low), (x, -high))
        return (
            sheet_leaf(self, "inner", ((0.0, low), (x, high)), self.inner_width),
            sheet_leaf(self, "outer_low", falling, self.outer_width, z=-c),
            sheet_leaf(self, "outer_high", falling, self.outer_width, z=c),
        )

    def shape(self) -> dict[str, float]:
        """The shape parameters angle [rad], ratio, and width_ratio = both outer widths over the inner one."""
        width_ratio = 2 * self.outer_width / self.inner_width
        return {"angle": self.angle, "ratio": self.ratio, "width_ratio": width_ratio}

    def stiffness_at_rest(self) -> float:
        """Undeformed drive stiffness [Nm/rad] for inextensible leaf springs; both planes share one end rotation."""
        mean = 0.5 * (self.inner_width + 2 * self.outer_width)
        return pivot_stiffness(self.ratio, bending_stiffness(self, mean) / self.length)
