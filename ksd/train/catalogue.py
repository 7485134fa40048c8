"""The shipped families: over which shapes each is trained, and the joint that is drawn at a shape.

A maker draws a steel joint of one size; thickness, length and material hardly matter to the functions, which every
record proves by its evidence. `numbers` of a family are what its maker holds fixed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from ksd.library import Mesh, Parameter
from ksd.scene import CrossFlexure, Joint, Material
from ksd.scene.families.cartwheel import Butterfly, Cartwheel
from ksd.scene.families.crossed_pivot import BalancedCrossedPivot, CrossedPivot
from ksd.scene.families.guide import ParallelGuide, StiffenedGuide
from ksd.scene.families.infinity import InfinityHinge, TripleInfinityHinge
from ksd.scene.families.notch import ArcHinge, CircularNotchHinge, FilletedNotchHinge
from ksd.scene.families.universal import UniversalJoint

STEEL = {"E": 200e9, "G": 76.9e9}
_NOTCH: dict[str, Any] = {"radius": 0.01, "width": 0.01}
_NECK = {"length": 0.02, "width": 0.01}
SHEET: dict[str, Any] = {"length": 0.1, "thickness": 5e-4, "width": 0.04}
_LEAF = {"length": SHEET["length"], "thickness": SHEET["thickness"]}
FULL: tuple[Mesh, ...] = ("strain", 1, 2, 3, 4, 5, 6, 7, 8)
SHORT: tuple[Mesh, ...] = ("strain", 1, 2, 3, 4, 5, 6)


@dataclass(frozen=True)
class Entry:
    """A family to train: make(**shape) draws it; parameters are its ranges; meshes it is trained on; `loose`
    times the usual tolerances; others: values of parameters that must not matter, shown in the record.
    """

    make: Callable[..., Joint]
    parameters: tuple[Parameter, ...] = ()
    numbers: Mapping[str, float] = field(default_factory=dict)
    meshes: tuple[Mesh, ...] = FULL
    loose: float = 1.0
    others: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


def _steel() -> Material:
    return Material(E=STEEL["E"], G=STEEL["G"])


_CROSS = {"length": 0.1, "thickness": 1e-3, "inner_width": 0.04}


def _cross_flexure(*, angle: float, width_ratio: float, gap: float = 0.0) -> CrossFlexure:
    """The cross flexure of paper 1, table 1, at another leaf angle and width ratio."""
    inner = _CROSS["inner_width"]
    return CrossFlexure(
        _steel(),
        length=_CROSS["length"],
        angle=angle,
        thickness=_CROSS["thickness"],
        widths=(inner, 0.5 * width_ratio * inner),
        gap=gap,
    )


def _crossed_pivot(*, angle: float, ratio: float) -> CrossedPivot:
    return CrossedPivot(_steel(), angle=angle, ratio=ratio, **SHEET)


def _balanced_crossed_pivot(
    *, angle: float, ratio: float, width_ratio: float, gap: float = 0.0
) -> BalancedCrossedPivot:
    inner = SHEET["width"]
    return BalancedCrossedPivot(
        _steel(),
        length=SHEET["length"],
        thickness=SHEET["thickness"],
        inner_width=inner,
        outer_width=0.5 * width_ratio * inner,
        angle=angle,
        ratio=ratio,
        gap=gap,
    )


def _cartwheel(*, angle: float) -> Cartwheel:
    return Cartwheel(_steel(), angle=angle, **SHEET)


def _butterfly(*, inner_ratio: float, half_angle: float) -> Butterfly:
    return Butterfly(_steel(), inner=inner_ratio * SHEET["length"], half_angle=half_angle, **SHEET)


def _infinity(*, reach: float, strut: float) -> InfinityHinge:
    return InfinityHinge(_steel(), reach=reach, strut=strut, **SHEET)


def _triple_infinity() -> TripleInfinityHinge:
    return TripleInfinityHinge(_steel())


def _parallel_guide(*, spacing: float) -> ParallelGuide:
    return ParallelGuide(_steel(), spacing=spacing * SHEET["length"], **SHEET)


def _stiffened_guide(*, flexible: float, spacing: float) -> StiffenedGuide:
    return StiffenedGuide(_steel(), spacing=spacing * SHEET["length"], flexible=flexible, **SHEET)


def _universal(*, aspect: float) -> UniversalJoint:
    return UniversalJoint(_steel(), **{**SHEET, "width": aspect * SHEET["length"]})


def _circular_notch(*, slenderness: float) -> CircularNotchHinge:
    radius = _NOTCH["radius"]
    return CircularNotchHinge(_steel(), radius=radius, minimum=slenderness * radius, width=_NOTCH["width"])


def _filleted_notch(*, slenderness: float, fillet: float) -> FilletedNotchHinge:
    length = _NECK["length"]
    return FilletedNotchHinge(
        _steel(), length=length, radius=fillet * length, minimum=slenderness * length, width=_NECK["width"]
    )


def _arc_hinge(*, angle: float) -> ArcHinge:
    # one arc length, so that slenderness is the same at every angle
    return ArcHinge(
        _steel(),
        radius=SHEET["length"] / angle,
        angle=angle,
        thickness=SHEET["thickness"],
        width=SHEET["width"],
    )


def _range(name: str, low: float, high: float, *, scale: str = "linear", degrees: bool = False) -> Parameter:
    unit = math.radians(1) if degrees else 1.0
    return Parameter(name, unit * low, unit * high, scale)


_GAPS = {"gap": (0.01, 0.04)}
_ANGLE = _range("angle", 30, 60, degrees=True)
# closer leaf springs let B tilt as easily as move at the end of the stroke
_SPACING = _range("spacing", 0.3, 3.0, scale="log")

ENTRIES: dict[str, Entry] = {
    "cross_flexure": Entry(
        _cross_flexure,
        (_ANGLE, _range("width_ratio", 0.25, 4.0, scale="log")),
        {**STEEL, **_CROSS},
        others=_GAPS,
    ),
    "crossed_pivot": Entry(_crossed_pivot, (_ANGLE, _range("ratio", -0.25, 1.25)), {**STEEL, **SHEET}),
    "balanced_crossed_pivot": Entry(
        _balanced_crossed_pivot,
        (_ANGLE, _range("ratio", 0.0, 1.0), _range("width_ratio", 0.5, 2.0, scale="log")),
        {**STEEL, **SHEET},
        SHORT,
        1.5,
        _GAPS,
    ),
    "cartwheel": Entry(_cartwheel, (_ANGLE,), {**STEEL, **SHEET}),
    "butterfly": Entry(
        _butterfly,
        (_range("inner_ratio", 0.1, 0.6), _range("half_angle", 8, 21, degrees=True)),
        {**STEEL, **SHEET},
        SHORT,
        1.0,
    ),
    "infinity_hinge": Entry(
        _infinity, (_range("reach", 0.35, 0.5), _range("strut", 0.15, 0.4)), {**STEEL, **SHEET}, SHORT, 3.0
    ),
    "triple_infinity_hinge": Entry(_triple_infinity, (), {**STEEL, "length": 0.06, "thickness": 0.45e-3}),
    "parallel_guide": Entry(_parallel_guide, (_SPACING,), {**STEEL, **SHEET}, loose=0.5),
    "stiffened_guide": Entry(_stiffened_guide, (_range("flexible", 0.1, 0.4), _SPACING), {**STEEL, **SHEET}),
    "circular_notch": Entry(
        _circular_notch, (_range("slenderness", 0.02, 0.3, scale="log"),), {**STEEL, **_NOTCH}, loose=3.0
    ),
    "filleted_notch": Entry(
        _filleted_notch,
        (_range("slenderness", 0.01, 0.1, scale="log"), _range("fillet", 0.05, 0.35)),
        {**STEEL, **_NECK},
        # longer chains jump where the middle of an element passes from fillet to neck
        ("strain", 1),
        3.0,
    ),
    "arc_hinge": Entry(_arc_hinge, (_range("angle", 20, 270, degrees=True),), {**STEEL, **SHEET}, loose=3.0),
    "universal": Entry(
        _universal, (_range("aspect", 0.32, 0.64, scale="log"),), {**STEEL, **_LEAF}, SHORT, loose=1.0
    ),
}
