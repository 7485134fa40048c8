"""Designs that can be trained: the shipped families with their ranges of shapes and a function drawing each, and single
joints.

A make function draws a steel joint of one size; thickness, length and material hardly affect the functions, as the
evidence in every record shows. `numbers` of a family are what its make function holds fixed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

from ksd.checks import name_hint, show
from ksd.errors import SceneError
from ksd.library import Mesh, Parameter
from ksd.scene import CrossFlexure, DrawnJoint, Joint, Material
from ksd.scene.families.cartwheel import Butterfly, Cartwheel
from ksd.scene.families.crossed_pivot import BalancedCrossedPivot, CrossedPivot
from ksd.scene.families.guide import ParallelGuide, StiffenedGuide
from ksd.scene.families.infinity import InfinityHinge, TripleInfinityHinge
from ksd.scene.families.notch import ArcHinge, CircularNotchHinge, FilletedNotchHinge
from ksd.scene.families.universal import UniversalJoint
from ksd.scene.joint import joint_proportions
from ksd.training.designs import Design

STEEL = {"E": 200e9, "G": 76.9e9}
_STEEL = Material(E=STEEL["E"], G=STEEL["G"])
_NOTCH: dict[str, Any] = {"radius": 0.01, "width": 0.01}
_NECK = {"length": 0.02, "width": 0.01}
SHEET: dict[str, Any] = {"length": 0.1, "thickness": 5e-4, "width": 0.04}
_LEAF = {"length": SHEET["length"], "thickness": SHEET["thickness"]}
_CROSS = {"length": 0.1, "thickness": 1e-3, "inner_width": 0.04}
SHORT_CHAINS: tuple[Mesh, ...] = ("strain", 1, 2, 3, 4, 5, 6)
"""Meshes of families whose functions are trained on chains of at most six elements."""


def _cross_flexure(*, angle: float, width_ratio: float, gap: float = 0.0) -> CrossFlexure:
    """The cross flexure of paper 1, table 1, with another leaf angle and width ratio."""
    inner = _CROSS["inner_width"]
    return CrossFlexure(
        _STEEL,
        length=_CROSS["length"],
        angle=angle,
        thickness=_CROSS["thickness"],
        widths=(inner, 0.5 * width_ratio * inner),
        gap=gap,
    )


def _balanced_crossed_pivot(
    *, angle: float, ratio: float, width_ratio: float, gap: float = 0.0
) -> BalancedCrossedPivot:
    inner = SHEET["width"]
    return BalancedCrossedPivot(
        _STEEL,
        length=SHEET["length"],
        thickness=SHEET["thickness"],
        inner_width=inner,
        outer_width=0.5 * width_ratio * inner,
        angle=angle,
        ratio=ratio,
        gap=gap,
    )


def _butterfly(*, inner_ratio: float, half_angle: float) -> Butterfly:
    return Butterfly(_STEEL, inner=inner_ratio * SHEET["length"], half_angle=half_angle, **SHEET)


def _parallel_guide(*, spacing: float) -> ParallelGuide:
    return ParallelGuide(_STEEL, spacing=spacing * SHEET["length"], **SHEET)


def _stiffened_guide(*, flexible: float, spacing: float) -> StiffenedGuide:
    return StiffenedGuide(_STEEL, spacing=spacing * SHEET["length"], flexible=flexible, **SHEET)


def _universal(*, aspect: float) -> UniversalJoint:
    return UniversalJoint(_STEEL, **{**SHEET, "width": aspect * SHEET["length"]})


def _circular_notch(*, slenderness: float) -> CircularNotchHinge:
    radius = _NOTCH["radius"]
    return CircularNotchHinge(_STEEL, radius=radius, minimum=slenderness * radius, width=_NOTCH["width"])


def _filleted_notch(*, slenderness: float, fillet: float) -> FilletedNotchHinge:
    length = _NECK["length"]
    return FilletedNotchHinge(
        _STEEL, length=length, radius=fillet * length, minimum=slenderness * length, width=_NECK["width"]
    )


def _arc_hinge(*, angle: float) -> ArcHinge:
    # same arc length, so that slenderness is the same at every angle
    return ArcHinge(
        _STEEL,
        radius=SHEET["length"] / angle,
        angle=angle,
        thickness=SHEET["thickness"],
        width=SHEET["width"],
    )


def _parameter(
    name: str, low: float, high: float, *, scale: str = "linear", degrees: bool = False
) -> Parameter:
    """A shape parameter; degrees: low and high are given in degrees."""
    factor = math.radians(1) if degrees else 1.0
    return Parameter(name, factor * low, factor * high, scale)


_GAPS = {"gap": (0.01, 0.04)}
_ANGLE = _parameter("angle", 30, 60, degrees=True)
# with closer leaf springs B tilts as easily as it moves at the end of the stroke
_SPACING = _parameter("spacing", 0.3, 3.0, scale="log")

FAMILY_DESIGNS: dict[str, Design] = {
    design.family: design
    for design in (
        Design(
            "cross_flexure", (_ANGLE, _parameter("width_ratio", 0.25, 4.0, scale="log")), _cross_flexure,
            {**STEEL, **_CROSS}, others=_GAPS,
        ),
        Design(
            "crossed_pivot", (_ANGLE, _parameter("ratio", -0.25, 1.25)), partial(CrossedPivot, _STEEL, **SHEET),
            {**STEEL, **SHEET},
        ),
        Design(
            "balanced_crossed_pivot",
            (_ANGLE, _parameter("ratio", 0.0, 1.0), _parameter("width_ratio", 0.5, 2.0, scale="log")),
            _balanced_crossed_pivot, {**STEEL, **SHEET}, SHORT_CHAINS, 1.5, _GAPS,
        ),
        Design("cartwheel", (_ANGLE,), partial(Cartwheel, _STEEL, **SHEET), {**STEEL, **SHEET}),
        Design(
            "butterfly", (_parameter("inner_ratio", 0.1, 0.6), _parameter("half_angle", 8, 21, degrees=True)), _butterfly,
            {**STEEL, **SHEET}, SHORT_CHAINS,
        ),
        Design(
            "infinity_hinge", (_parameter("reach", 0.35, 0.5), _parameter("strut", 0.15, 0.4)),
            partial(InfinityHinge, _STEEL, **SHEET), {**STEEL, **SHEET}, SHORT_CHAINS, 3.0,
        ),
        Design(
            "triple_infinity_hinge", (), partial(TripleInfinityHinge, _STEEL),
            {**STEEL, "length": 0.06, "thickness": 0.45e-3},
        ),
        Design("parallel_guide", (_SPACING,), _parallel_guide, {**STEEL, **SHEET}, tolerance_factor=0.5),
        Design(
            "stiffened_guide", (_parameter("flexible", 0.1, 0.4), _SPACING), _stiffened_guide, {**STEEL, **SHEET},
        ),
        Design(
            "circular_notch", (_parameter("slenderness", 0.02, 0.3, scale="log"),), _circular_notch, {**STEEL, **_NOTCH},
            tolerance_factor=3.0,
        ),
        # functions of longer chains jump where the middle of an element moves from fillet to neck
        Design(
            "filleted_notch", (_parameter("slenderness", 0.01, 0.1, scale="log"), _parameter("fillet", 0.05, 0.35)),
            _filleted_notch, {**STEEL, **_NECK}, ("strain", 1), 3.0,
        ),
        Design(
            "arc_hinge", (_parameter("angle", 20, 270, degrees=True),), _arc_hinge,
            {**STEEL, **SHEET}, tolerance_factor=3.0,
        ),
        Design("universal", (_parameter("aspect", 0.32, 0.64, scale="log"),), _universal, {**STEEL, **_LEAF}, SHORT_CHAINS),
    )
}  # fmt: skip
"""Designs of the families that can be trained by name."""


def known_designs() -> tuple[str, ...]:
    """Names of the families that `train` accepts."""
    return tuple(FAMILY_DESIGNS)


def design_of(
    family_or_joint: str | Joint | Design, shapes: Mapping[str, tuple[float, float]] | None = None
) -> Design:
    """The design of a family by name, of one joint as drawn (its shape fixed), or as given.

    shapes: other ranges {parameter: (low, high)}, SI. Raises SceneError for unknown names and invalid ranges.
    """
    if isinstance(family_or_joint, Joint):
        design = _design_of_joint(family_or_joint)
    elif isinstance(family_or_joint, Design):
        design = family_or_joint
    elif isinstance(family_or_joint, str) and family_or_joint in FAMILY_DESIGNS:
        design = FAMILY_DESIGNS[family_or_joint]
    else:
        raise SceneError(
            f"joint family {family_or_joint!r} cannot be trained{name_hint(family_or_joint, FAMILY_DESIGNS)}"
        )
    return _with_ranges(design, shapes or {})


def _with_ranges(design: Design, shapes: Mapping[str, tuple[float, float]]) -> Design:
    """The design with other ranges of shape parameters. Raises SceneError."""
    known = {p.name: p for p in design.parameters}
    for name, ends in shapes.items():
        if name not in known:
            raise SceneError(f"{design.family}: shape parameter {name!r} is unknown{name_hint(name, known)}")
        if not isinstance(ends, tuple | list) or len(ends) != 2:
            raise SceneError(f"{design.family}: {name} = {show(ends)} must be a range (low, high).")
        known[name] = replace(known[name], low=ends[0], high=ends[1])
    return replace(design, parameters=tuple(known.values()))


def _design_of_joint(joint: Joint) -> Design:
    """The design of one joint, with its shape fixed."""
    parameters = tuple(Parameter(name, value, value) for name, value in joint.shape().items())
    # a family is identified by its shape parameters, a drawing by all its proportions
    drawing = joint_proportions(joint) if isinstance(joint, DrawnJoint) else {}
    return Design(joint.family, parameters, lambda **_: joint, {"length": joint.length, **drawing})
