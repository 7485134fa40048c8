"""Infinity hinges: a main leaf reinforced against torsion by folded leaf springs, and against lateral motion.

The principle is that of the infinity flexure (DSPE, case "Large range of motion flexure hinge: Infinity flexure"; paper 1,
references 1 and 2): a single leaf is soft in bending, torsion and lateral motion; folded leaf springs, stiff along their
fold only, constrain the torsion, and a strut across the leaf constrains the lateral motion. All proportions are those of
this package, since figures 1 and 14 of paper 1 are not available.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from ksd.checks import Vector
from ksd.scene.clearance import check_clear
from ksd.scene.families.sheet import (
    JointFamily,
    Point,
    check_ratio,
    check_sheet,
    in_plane_blocks,
    parameter_dimensions,
    sheet_leaf,
)
from ksd.scene.joint import joint_leaves
from ksd.scene.leaf import Leaf

_FOOT = 0.02
"""Distance |y| of the ends of folded leaf springs from the main leaf, over L."""
_GAP = 0.1
"""Distance in z of the inner edges of the main leaf from the middle plane, over the width of its halves."""
_INFINITY_STROKE = math.radians(30)
_TRIPLE_INFINITY_STROKE = math.radians(45)


@dataclass(frozen=True, kw_only=True)
class InfinityHinge(JointFamily):
    """A main leaf with two folded leaf springs against torsion and a strut against lateral motion; +-30 degrees about z.

    Joint axes: A at the origin, B at (L, 0, 0), everything symmetric in z and, but for the strut, in y. The
    main leaf runs from A to B in two halves of `width` at z = +-0.6 width, so that the strut passes between
    them. Each folded leaf joins A at (0, +-0.02 L, 0) and B at (L, +-0.02 L, 0) by two leaf springs of twice `width`
    that meet at the fold, the internal block ("fold_low", "fold_high") at (L/2, +-reach L, 0). The strut, a leaf of 0.2
    width at z = 0, runs along y from A at (L/2, -strut L/2, 0) to B at (L/2, strut L/2, 0).

    length L, thickness, width [m]; reach 0.25..0.6 and strut 0.1..0.6, dimensionless. Raises SceneError
    naming the parameter out of bounds.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> joint = ksd.InfinityHinge(steel, length=60 * mm, thickness=0.3 * mm, width=15 * mm)
    >>> pose = ksd.solve(ksd.Mechanism.of_joint(joint), angle=20 * deg)
    >>> print(f"{pose.forces['angle']:.4f} Nm")
    0.6903 Nm
    """

    family: ClassVar[str] = "infinity_hinge"
    stroke = _INFINITY_STROKE
    quantities = parameter_dimensions("length", "thickness", "width", reach="number", strut="number")

    length: float
    thickness: float
    width: float
    reach: float = 0.4
    strut: float = 0.3
    elements: int | None = None
    orders: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        check_sheet(self, "width")
        check_ratio(self, "reach", 0.25, 0.6)
        check_ratio(self, "strut", 0.1, 0.6)
        check_clear(joint_leaves(self), owner="InfinityHinge", advice="raise reach or reduce strut")

    def blocks(self) -> dict[str, Vector]:
        L, y = self.length, self.reach * self.length
        folds = in_plane_blocks({"fold_low": (0.5 * L, -y), "fold_high": (0.5 * L, y)})
        return {**super().blocks(), **folds}

    def leaves(self) -> tuple[Leaf, ...]:
        L, w = self.length, self.width
        z = (0.5 + _GAP) * w
        main = ((0.0, 0.0), (L, 0.0))
        leaves = [sheet_leaf(self, "main_low", main, w, z=-z), sheet_leaf(self, "main_high", main, w, z=z)]
        for side, sign in (("low", -1.0), ("high", 1.0)):
            foot, fold = sign * _FOOT * L, (0.5 * L, sign * self.reach * L)
            name = f"fold_{side}"
            leaves.append(sheet_leaf(self, f"{name}_A", ((0.0, foot), fold), 2 * w, blocks=("A", name)))
            leaves.append(sheet_leaf(self, f"{name}_B", (fold, (L, foot)), 2 * w, blocks=(name, "B")))
        half = 0.5 * self.strut * L
        leaves.append(sheet_leaf(self, "strut", ((0.5 * L, -half), (0.5 * L, half)), 0.2 * w))
        return tuple(leaves)

    def shape(self) -> dict[str, float]:
        """The shape parameters reach and strut, over L."""
        return {"reach": self.reach, "strut": self.strut}


# the drawing of the triple infinity hinge, in mm for a length of 60 mm
_MM = 1e-3
_LENGTH = 60.0
_SEGMENTS = ((0.0, 18.0), (21.0, 39.0), (42.0, 60.0))
"""Start and end in x of the segments of the main leaf."""
_MAIN_BLOCKS = ("A", "cross_1", "cross_2", "B")
"""Blocks between which the segments are."""
_MAIN_WIDTH, _MAIN_Z = 15.0, 13.5
"""Width of the two halves of the main leaf, and their distance from the middle plane."""
_FOLD_WIDTH, _FOLD_START_Y, _FOLD_TOP_Y = 18.0, 1.5, 17.0
"""Width of the folded leaf springs, and distance in y from the main leaf at their ends and at their folds."""
_BAR_START_Y, _BAR_END_Y, _BAR_HALF_X, _BAR_LEAF_LENGTH = 2.0, 26.0, 10.0, 12.0
"""Bars of the lateral guidance: range in y and half their range in x; length of the leaf springs at their ends."""
_BARS = (("inner", 1.0, 0.0, 4.0), ("outer_low", -1.0, -4.0, 2.0), ("outer_high", -1.0, 4.0, 2.0))
"""Bars of one stage: name, sign of the slope, z, width."""


@dataclass(frozen=True, kw_only=True)
class TripleInfinityHinge(JointFamily):
    """The 3x-infinity hinge: 30 flexible leaf springs of 0.45 mm, B turns about z, +-45 degrees.

    Joint axes: A at the origin, B at (60, 0, 0) mm, everything symmetric in z. Dimensions, in mm for a `length` of
    60 mm:

    - main leaf, 6 leaves: three segments x = 0..18, 21..39, 42..60, each of two halves 15 wide at z = +-13.5;
      between them the rigid cross bars "cross_1" and "cross_2" (reference points x = 19.5 and 40.5);
    - torsion reinforcement, 6 folded leaves = 12 leaf springs, 18 wide, one pair per segment from x0 to x1: from (x0,
      +-1.5) to the fold block at ((x0 + x1)/2, +-17) and on to (x1, +-1.5);
    - lateral guidance, 12 leaves: two anti-parallelograms in series, A to "middle" (at (30, 0)) and "middle"
      to B. The first is made of three crossing bars between y = -26 on A and y = -2 on the middle block:
      the inner one from x = 20 to 40, 4 wide at z = 0, the two outer ones from x = 40 to 20, 2 wide at z = +-4;
      the ends of a bar are leaf springs 12 long, the rest a rigid block. The second is its image in the point (30, 0).
      Each acts as a pivot where its bars cross, so both together as a rod from A to B across the main leaf.

    Where folded leaf springs and bars cross, the folded leaf springs have windows, which are not modelled: over the stroke
    up to 0.19 of the area of a leaf (`ksd.training.stroke_checks.LeafWindows`; rigid blocks
    have no shape here and are not counted). length [m] scales all dimensions but thickness [m], which is free like the
    material. Raises SceneError naming the parameter out of bounds.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> joint = ksd.TripleInfinityHinge(steel)
    >>> pose = ksd.solve(ksd.Mechanism.of_joint(joint), angle=30 * deg)
    >>> print(f"{pose.forces['angle']:.3f} Nm")
    2.062 Nm
    """

    family: ClassVar[str] = "triple_infinity_hinge"
    windows = True
    stroke = _TRIPLE_INFINITY_STROKE
    quantities = parameter_dimensions("thickness", "length")

    thickness: float = 0.45e-3
    length: float = _LENGTH * _MM
    elements: int | None = None
    orders: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        check_sheet(self)

    @property
    def _unit(self) -> float:
        """Metres per mm of the drawing, 1e-3 for a length of 60 mm."""
        return self.length / _LENGTH

    def blocks(self) -> dict[str, Vector]:
        points: dict[str, Point] = {
            "A": (0.0, 0.0),
            "B": (_LENGTH, 0.0),
            "cross_1": (19.5, 0.0),
            "cross_2": (40.5, 0.0),
        }
        for k, (x0, x1) in enumerate(_SEGMENTS, 1):
            points |= {
                f"fold_{k}_low": (0.5 * (x0 + x1), -_FOLD_TOP_Y),
                f"fold_{k}_high": (0.5 * (x0 + x1), _FOLD_TOP_Y),
            }
        points["middle"] = (0.5 * _LENGTH, 0.0)
        y = 0.5 * (_BAR_START_Y + _BAR_END_Y)
        for name, *_ in _BARS:
            points |= {f"bar_1_{name}": (0.5 * _LENGTH, -y), f"bar_2_{name}": (0.5 * _LENGTH, y)}
        return in_plane_blocks({name: (self._unit * x, self._unit * y) for name, (x, y) in points.items()})

    def leaves(self) -> tuple[Leaf, ...]:
        return (*self._main_leaves(), *self._folded_leaves(), *self._bar_leaves())

    def _drawn_leaf(
        self, name: str, ends: tuple[Point, Point], width: float, blocks: tuple[str, str], z: float = 0.0
    ) -> Leaf:
        """A leaf of the joint, from numbers of the drawing in mm."""
        u = self._unit
        (x0, y0), (x1, y1) = ends
        return sheet_leaf(self, name, ((u * x0, u * y0), (u * x1, u * y1)), u * width, blocks=blocks, z=u * z)

    def _main_leaves(self) -> list[Leaf]:
        """The two halves of the three segments of the main leaf."""
        leaves = []
        for k, (x0, x1) in enumerate(_SEGMENTS, 1):
            pair = (_MAIN_BLOCKS[k - 1], _MAIN_BLOCKS[k])
            for side, z in (("low", -_MAIN_Z), ("high", _MAIN_Z)):
                leaves.append(
                    self._drawn_leaf(f"main_{k}_{side}", ((x0, 0.0), (x1, 0.0)), _MAIN_WIDTH, pair, z)
                )
        return leaves

    def _folded_leaves(self) -> list[Leaf]:
        """The folded leaf springs, two leaf springs each."""
        leaves = []
        for k, (x0, x1) in enumerate(_SEGMENTS, 1):
            for side, sign in (("low", -1.0), ("high", 1.0)):
                block, top = f"fold_{k}_{side}", (0.5 * (x0 + x1), sign * _FOLD_TOP_Y)
                first, second = (x0, sign * _FOLD_START_Y), (x1, sign * _FOLD_START_Y)
                leaves.append(
                    self._drawn_leaf(f"{block}_a", (first, top), _FOLD_WIDTH, (_MAIN_BLOCKS[k - 1], block))
                )
                leaves.append(
                    self._drawn_leaf(f"{block}_b", (top, second), _FOLD_WIDTH, (block, _MAIN_BLOCKS[k]))
                )
        return leaves

    def _bar_leaves(self) -> list[Leaf]:
        """The leaf springs at both ends of the bars of the lateral guidance."""
        leaves = []
        rise, run = _BAR_END_Y - _BAR_START_Y, 2 * _BAR_HALF_X
        flexible = _BAR_LEAF_LENGTH / math.hypot(rise, run)
        for k, (first, last), sign in ((1, ("A", "middle"), -1.0), (2, ("B", "middle"), 1.0)):
            for name, slope, z, width in _BARS:
                # from the arm of A (B) to the middle block; stage 2 is the image in the point (30, 0)
                start = (0.5 * _LENGTH + sign * slope * _BAR_HALF_X, sign * _BAR_END_Y)
                end = (0.5 * _LENGTH - sign * slope * _BAR_HALF_X, sign * _BAR_START_Y)
                near, far = _point_between(start, end, flexible), _point_between(start, end, 1 - flexible)
                block = f"bar_{k}_{name}"
                leaves.append(self._drawn_leaf(f"{block}_a", (start, near), width, (first, block), z))
                leaves.append(self._drawn_leaf(f"{block}_b", (far, end), width, (block, last), z))
        return leaves


def _point_between(start: Point, end: Point, fraction: float) -> Point:
    """The point at a fraction of the line from start to end."""
    return start[0] + fraction * (end[0] - start[0]), start[1] + fraction * (end[1] - start[1])
