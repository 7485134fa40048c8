"""Flexible constraints: joints without intended motion, stiff in one direction and soft in the five others.

`Mechanism.constrain` places them between two links whose motion other joints determine; they need no record.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from ksd.checks import Vector
from ksd.scene.families.sheet import JointFamily, check_sheet, parameter_dimensions, sheet_leaf
from ksd.scene.leaf import Leaf
from ksd.scene.leaf import wire as make_wire


@dataclass(frozen=True, kw_only=True)
class FoldedLeaf(JointFamily):
    """A leaf spring folded at a right angle: stiff along its fold line only, soft in all other directions.

    Joint axes: A at the origin, the fold (internal block) at (c, c, 0), B at (2c, 0, 0) with c = L cos(45 deg); the
    fold line runs along z, like the widths of both leaf springs (van Eijk, On the design of plate-spring mechanisms, 1985).

    length L [m] of each of the two leaf springs; thickness, width [m]. Raises SceneError naming the parameter out of bounds.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> joint = ksd.FoldedLeaf(steel, length=40 * mm, thickness=0.3 * mm, width=20 * mm)
    >>> pose = ksd.solve(ksd.Mechanism.of_joint(joint))
    >>> held = pose.stiffness("B").matrix()[2, 2]
    >>> print(f"{held:.4g} N/m along the fold line; by hand {joint.stiffness_at_rest():.4g}")
    7.847e+05 N/m along the fold line; by hand 7.845e+05
    """

    family: ClassVar[str] = "folded_leaf"
    quantities = parameter_dimensions("length", "thickness", "width")

    length: float
    thickness: float
    width: float
    elements: int | None = None
    orders: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        check_sheet(self, "width")

    @property
    def _fold_distance(self) -> float:
        """Distance c [m] of the fold from A along x and along y."""
        return self.length * math.sqrt(0.5)

    @property
    def pose_B(self) -> Vector:
        return (2 * self._fold_distance, 0.0, 0.0)

    def blocks(self) -> dict[str, Vector]:
        return {**super().blocks(), "fold": (self._fold_distance, self._fold_distance, 0.0)}

    def leaves(self) -> tuple[Leaf, ...]:
        c = self._fold_distance
        return (
            sheet_leaf(self, "A_fold", ((0.0, 0.0), (c, c)), self.width, blocks=("A", "fold")),
            sheet_leaf(self, "fold_B", ((c, c), (2 * c, 0.0)), self.width, blocks=("fold", "B")),
        )

    def stiffness_at_rest(self) -> float:
        """Stiffness [N/m] along the fold line, ends held parallel: 1 / (2 (L^3 / 3 E I + L / k G A)), I = t w^3 / 12.

        Each leaf is a cantilever in its plane: the other one resists the rotation of the fold by its torsion only, which is
        neglected.
        """
        E, G, section = self.material.E, self.material.G, self.leaves()[0].section
        cantilever = self.length**3 / (3 * E * section.Iy) + self.length / (section.kz * G * section.A)
        return 1 / (2 * cantilever)


@dataclass(frozen=True, kw_only=True)
class WireFlexure(JointFamily):
    """A round wire, clamped at both ends: stiff along its axis, soft in the five other directions.

    Joint axes: A at the origin, B at (L, 0, 0). length L, diameter [m]. Raises SceneError naming the parameter out of
    bounds.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> joint = ksd.WireFlexure(steel, length=50 * mm, diameter=0.5 * mm)
    >>> pose = ksd.solve(ksd.Mechanism.of_joint(joint))
    >>> held = pose.stiffness("B").support("x")
    >>> print(f"{held:.4g} N/m along the wire; by hand {joint.stiffness_at_rest():.4g}")
    7.854e+05 N/m along the wire; by hand 7.854e+05
    """

    family: ClassVar[str] = "wire_flexure"
    quantities = parameter_dimensions("length", "diameter")

    length: float
    diameter: float
    elements: int | None = None
    orders: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        check_sheet(self, "diameter", slender="diameter")

    def leaves(self) -> tuple[Leaf, ...]:
        wire = make_wire(
            diameter=self.diameter,
            material=self.material,
            start=(0.0, 0.0, 0.0),
            end=self.pose_B,
            elements=self.elements,
            orders=self.orders,
        )
        return (wire,)

    def stiffness_at_rest(self) -> float:
        """Stiffness [N/m] along the wire: E A / L."""
        return float(self.material.E * math.pi * self.diameter**2 / 4 / self.length)
