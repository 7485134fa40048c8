"""Infinity hinges: a main leaf reinforced against torsion by folded leaf springs and held laterally.

The principle is that of the infinity flexure (DSPE, case "Large range of motion flexure hinge: Infinity flexure"; paper
1, references 1 and 2): a leaf leaves its bending, its torsion and its lateral motion free; folded leaf springs, stiff along
their fold only, take the torsion away, and a strut across the leaf takes the lateral motion. All proportions here are
our own: figures 1 and 14 of paper 1 are lost.
"""

from __future__ import annotations

import math
from dataclasses import KW_ONLY, dataclass
from typing import ClassVar

from ksd.checks import Vector
from ksd.scene.clearance import check_clear
from ksd.scene.families.sheet import (
    JointFamily,
    Point,
    check_sheet,
    in_plane_blocks,
    number_within,
    parameter_dimensions,
    sheet_leaf,
)
from ksd.scene.joint import joint_leaves
from ksd.scene.leaf import Leaf
from ksd.scene.material import Material

_FOOT = 0.02
_GAP = 0.1
_INFINITY = math.radians(30)
_TRIPLE = math.radians(45)


@dataclass(frozen=True)
class InfinityHinge(JointFamily):
    """A main leaf with two folded leaf springs against its torsion and a strut against its lateral motion; +-30 degrees.

    Joint axes: A at the origin, B at (L, 0, 0), everything symmetric in z and, but for the strut, in y. The
    main leaf runs from A to B in two halves of `width` at z = +-0.6 width, so that the strut passes between
    them. Each folded leaf joins A at (0, +-0.02 L, 0) and B at (L, +-0.02 L, 0) by two leaf springs of twice `width`
    that meet at the fold, the internal block ("fold_low", "fold_high") at (L/2, +-reach L, 0). The strut, a leaf of 0.2
    width at z = 0, runs along y from A at (L/2, -strut L/2, 0) to B at (L/2, strut L/2, 0).

    length L, thickness, width [m]; reach 0.25..0.6 and strut 0.1..0.6, dimensionless. Raises SceneError
    naming the parameter out of bounds.
    """

    family: ClassVar[str] = "infinity_hinge"
    stroke = _INFINITY
    quantities = parameter_dimensions("length", "thickness", "width", reach="number", strut="number")

    material: Material
    _: KW_ONLY
    length: float
    thickness: float
    width: float
    reach: float = 0.4
    strut: float = 0.3
    elements: int | None = None
    orders: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        check_sheet(self, "width")
        name = type(self).__name__
        object.__setattr__(self, "reach", number_within(self.reach, "reach", (0.25, 0.6), owner=name))
        object.__setattr__(self, "strut", number_within(self.strut, "strut", (0.1, 0.6), owner=name))
        check_clear(joint_leaves(self), owner=name, advice="raise reach or reduce strut")

    def blocks(self) -> dict[str, Vector]:
        L, y = self.length, self.reach * self.length
        folds = in_plane_blocks({"fold_low": (0.5 * L, -y), "fold_high": (0.5 * L, y)})
        return {**super().blocks(), **folds}

    def leaves(self) -> tuple[Leaf, ...]:
        L, w = self.length, self.width
        z = (0.5 + _GAP) * w
        main = ((0.0, 0.0), (L, 0.0))
        found = [sheet_leaf(self, "main_low", main, w, z=-z), sheet_leaf(self, "main_high", main, w, z=z)]
        for side, sign in (("low", -1.0), ("high", 1.0)):
            foot, fold = sign * _FOOT * L, (0.5 * L, sign * self.reach * L)
            name = f"fold_{side}"
            found.append(sheet_leaf(self, f"{name}_A", ((0.0, foot), fold), 2 * w, blocks=("A", name)))
            found.append(sheet_leaf(self, f"{name}_B", (fold, (L, foot)), 2 * w, blocks=(name, "B")))
        half = 0.5 * self.strut * L
        found.append(sheet_leaf(self, "strut", ((0.5 * L, -half), (0.5 * L, half)), 0.2 * w))
        return tuple(found)

    def shape(self) -> dict[str, float]:
        """reach and strut, over L."""
        return {"reach": self.reach, "strut": self.strut}


_MM = 1e-3
_LENGTH = 60.0
_SEGMENTS = ((0.0, 18.0), (21.0, 39.0), (42.0, 60.0))
_STATIONS = ("A", "cross_1", "cross_2", "B")
_FEET, _TOP = 1.5, 17.0
_MAIN, _MAIN_AT, _FOLD = 15.0, 13.5, 18.0
_BAR_FROM, _BAR_TO, _BAR_HALF, _BAR_LEAF = 2.0, 26.0, 10.0, 12.0
_BARS = (("inner", 1.0, 0.0, 4.0), ("outer_low", -1.0, -4.0, 2.0), ("outer_high", -1.0, 4.0, 2.0))


@dataclass(frozen=True)
class TripleInfinityHinge(JointFamily):
    """The 3x-infinity hinge: 30 flexible leaf springs of 0.45 mm, B turns about z, +-45 degrees.

    Joint axes: A at the origin, B at (60, 0, 0) mm, everything symmetric in z. Our own dimensions, in mm at
    scale 1 (`length` 60 mm):

    - main leaf, 6 leaves: three segments x = 0..18, 21..39, 42..60, each of two halves 15 wide at z = +-13.5;
      between them the rigid cross bars "cross_1" and "cross_2" (reference points x = 19.5 and 40.5);
    - torsion reinforcement, 6 folded leaves = 12 leaf springs, 18 wide, one pair per segment from x0 to x1: from (x0,
      +-1.5) to the fold block at ((x0 + x1)/2, +-17) and on to (x1, +-1.5);
    - lateral guidance, 12 leaves: two anti-parallelograms in series, A to "middle" (at (30, 0)) and "middle"
      to B. The first is made of three crossing bars between y = -26 on A and y = -2 on the middle block:
      the inner one from x = 20 to 40, 4 wide at z = 0, the two outer ones from x = 40 to 20, 2 wide at z = +-4;
      the ends of a bar are leaf springs 12 long, the rest a rigid block. The second is its image in the point (30, 0).
      Each acts as a pivot where its bars cross, so both together as a rod from A to B across the main leaf.

    Widths overlap in the drawing where folded leaf springs and bars pass: the folded leaf springs have windows there, left
    out of the model: over the stroke up to 0.19 of the area of a leaf (`ksd.train.stroke_checks.LeafWindows`; rigid blocks
    have no shape here and are not looked at). length [m] scales all dimensions but thickness [m], which is free like the
    material. Raises SceneError naming the parameter out of bounds.
    """

    family: ClassVar[str] = "triple_infinity_hinge"
    windows = True
    stroke = _TRIPLE
    quantities = parameter_dimensions("thickness", "length")

    material: Material
    _: KW_ONLY
    thickness: float = 0.45e-3
    length: float = _LENGTH * _MM
    elements: int | None = None
    orders: tuple[int, int, int] | None = None

    def __post_init__(self) -> None:
        check_sheet(self)

    @property
    def _unit(self) -> float:
        """Metres per mm of the drawing."""
        return self.length / _LENGTH

    def blocks(self) -> dict[str, Vector]:
        points: dict[str, Point] = {
            "A": (0.0, 0.0),
            "B": (_LENGTH, 0.0),
            "cross_1": (19.5, 0.0),
            "cross_2": (40.5, 0.0),
        }
        for k, (x0, x1) in enumerate(_SEGMENTS, 1):
            points |= {f"fold_{k}_low": (0.5 * (x0 + x1), -_TOP), f"fold_{k}_high": (0.5 * (x0 + x1), _TOP)}
        points["middle"] = (0.5 * _LENGTH, 0.0)
        y = 0.5 * (_BAR_FROM + _BAR_TO)
        for name, *_ in _BARS:
            points |= {f"bar_1_{name}": (0.5 * _LENGTH, -y), f"bar_2_{name}": (0.5 * _LENGTH, y)}
        return in_plane_blocks({name: (self._unit * x, self._unit * y) for name, (x, y) in points.items()})

    def leaves(self) -> tuple[Leaf, ...]:
        return (*self._main(), *self._folds(), *self._bars())

    def _strip(
        self, name: str, ends: tuple[Point, Point], width: float, blocks: tuple[str, str], z: float = 0.0
    ) -> Leaf:
        """A leaf from the drawing, all in mm."""
        u = self._unit
        (x0, y0), (x1, y1) = ends
        return sheet_leaf(self, name, ((u * x0, u * y0), (u * x1, u * y1)), u * width, blocks=blocks, z=u * z)

    def _main(self) -> list[Leaf]:
        found = []
        for k, (x0, x1) in enumerate(_SEGMENTS, 1):
            pair = (_STATIONS[k - 1], _STATIONS[k])
            for side, z in (("low", -_MAIN_AT), ("high", _MAIN_AT)):
                found.append(self._strip(f"main_{k}_{side}", ((x0, 0.0), (x1, 0.0)), _MAIN, pair, z))
        return found

    def _folds(self) -> list[Leaf]:
        found = []
        for k, (x0, x1) in enumerate(_SEGMENTS, 1):
            for side, sign in (("low", -1.0), ("high", 1.0)):
                block, top = f"fold_{k}_{side}", (0.5 * (x0 + x1), sign * _TOP)
                first, second = (x0, sign * _FEET), (x1, sign * _FEET)
                found.append(self._strip(f"{block}_a", (first, top), _FOLD, (_STATIONS[k - 1], block)))
                found.append(self._strip(f"{block}_b", (top, second), _FOLD, (block, _STATIONS[k])))
        return found

    def _bars(self) -> list[Leaf]:
        found = []
        rise, run = _BAR_TO - _BAR_FROM, 2 * _BAR_HALF
        share = _BAR_LEAF / math.hypot(rise, run)
        for k, (first, last), sign in ((1, ("A", "middle"), -1.0), (2, ("B", "middle"), 1.0)):
            for name, lean, z, width in _BARS:
                # from the arm of A (B) to the middle block; stage 2 is the image in the point (30, 0)
                start = (0.5 * _LENGTH + sign * lean * _BAR_HALF, sign * _BAR_TO)
                end = (0.5 * _LENGTH - sign * lean * _BAR_HALF, sign * _BAR_FROM)
                near, far = _between(start, end, share), _between(start, end, 1 - share)
                block = f"bar_{k}_{name}"
                found.append(self._strip(f"{block}_a", (start, near), width, (first, block), z))
                found.append(self._strip(f"{block}_b", (far, end), width, (block, last), z))
        return found


def _between(start: Point, end: Point, share: float) -> Point:
    return start[0] + share * (end[0] - start[0]), start[1] + share * (end[1] - start[1])
