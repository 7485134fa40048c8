"""What is trained: a joint as a function of its shape parameters, and the changes that must not matter."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ksd.errors import SceneError
from ksd.library import Parameter
from ksd.scene import CrossFlexure, DrawnJoint, Joint, Leaf, Material
from ksd.section.checks import Vector, nearest


@dataclass(frozen=True)
class Design:
    """A family for the trainer: make(**shape) draws the joint at shape parameters within `parameters`.

    numbers: what is held fixed, SI.
    """

    family: str
    parameters: tuple[Parameter, ...]
    make: Callable[..., Joint]
    numbers: Mapping[str, float] = field(default_factory=dict)

    def joint(self, places: np.ndarray) -> DrawnJoint:
        """The joint at places (s,) in [-1, 1], without mesh choices of its own."""
        return bare(self.make(**self.shape(places)))

    def shape(self, places: np.ndarray) -> dict[str, float]:
        """Shape parameters at places (s,) in [-1, 1]."""
        return {p.name: p.value(float(x)) for p, x in zip(self.parameters, places, strict=True)}


def bare(joint: Joint) -> DrawnJoint:
    """The same joint as a drawing whose leafs leave the mesh to the trainer."""
    leafs = tuple(replace(leaf, elements=None, orders=None) for leaf in joint.leafs())
    return _redrawn(joint, leafs)


def _redrawn(joint: Joint, leafs: tuple[Leaf, ...]) -> DrawnJoint:
    return DrawnJoint(
        joint.family,
        blocks=joint.blocks(),
        leafs=leafs,
        motions=joint.motions,
        length=joint.length,
        shape=joint.shape(),
    )


_NUMBERS = {"length": 0.1, "thickness": 1e-3, "inner_width": 0.04, "E": 200e9, "G": 76.9e9}


def _cross_flexure(*, angle: float, width_ratio: float) -> CrossFlexure:
    """The cross flexure of paper 1, table 1, at another leaf angle and width ratio."""
    inner = _NUMBERS["inner_width"]
    return CrossFlexure(
        Material(E=_NUMBERS["E"], G=_NUMBERS["G"]),
        length=_NUMBERS["length"],
        angle=angle,
        thickness=_NUMBERS["thickness"],
        widths=(inner, 0.5 * width_ratio * inner),
    )


_SHAPES = {
    "cross_flexure": (
        Parameter("angle", math.radians(30), math.radians(60)),
        Parameter("width_ratio", 0.25, 4.0, "log"),
    )
}
_MAKERS: dict[str, Callable[..., Joint]] = {"cross_flexure": _cross_flexure}


def known_designs() -> tuple[str, ...]:
    """Families `train` knows by name."""
    return tuple(_MAKERS)


def design_of(
    family_or_joint: str | Joint | Design, shapes: Mapping[str, tuple[float, float]] | None = None
) -> Design:
    """The design of a family by name, of one joint as drawn (its shape fixed), or as given.

    shapes: other ranges {parameter: (low, high)}, SI. Raises SceneError for unknown names or empty ranges.
    """
    if isinstance(family_or_joint, Joint):
        design = _fixed(family_or_joint)
    elif isinstance(family_or_joint, Design):
        design = family_or_joint
    elif family_or_joint in _MAKERS:
        name = family_or_joint
        design = Design(name, _SHAPES[name], _MAKERS[name], _NUMBERS)
    else:
        raise SceneError(
            f"joint family {family_or_joint!r} cannot be trained{nearest(family_or_joint, _MAKERS)}"
        )
    return _with_ranges(design, shapes or {})


def _with_ranges(design: Design, shapes: Mapping[str, tuple[float, float]]) -> Design:
    known = {p.name: p for p in design.parameters}
    for name, (low, high) in shapes.items():
        if name not in known:
            raise SceneError(f"{design.family}: shape parameter {name!r} is unknown{nearest(name, known)}")
        if not (math.isfinite(low) and math.isfinite(high) and low <= high):
            raise SceneError(
                f"{design.family}: range {low:g} to {high:g} of {name} must rise; give (low, high)."
            )
        known[name] = replace(known[name], low=low, high=high)
    return replace(design, parameters=tuple(known.values()))


@dataclass(frozen=True)
class Fixed:
    """A maker that ignores the shape: one joint as drawn."""

    joint: Joint

    def __call__(self, **_: float) -> Joint:
        return self.joint


def _fixed(joint: Joint) -> Design:
    single = tuple(Parameter(name, value, value) for name, value in joint.shape().items())
    return Design(joint.family, single, Fixed(joint), {"length": joint.length})


def _thickness(leaf: Leaf, factor: float) -> Leaf:
    """The leaf with `factor` times the thickness, as a thin section."""
    s, f = leaf.section, factor
    section = replace(s, A=f * s.A, J=f**3 * s.J, Iy=f * s.Iy, Iz=f**3 * s.Iz, thickness=f * s.thickness)
    return replace(leaf, section=section)


def _material(leaf: Leaf) -> Leaf:
    """The leaf in an aluminium alloy."""
    return replace(leaf, material=Material(E=71e9, nu=0.33))


def _times(point: Vector, factor: float) -> Vector:
    x, y, z = (factor * c for c in point)
    return x, y, z


@dataclass(frozen=True)
class _Scaled:
    """A curvature function of a leaf drawn `factor` times as long."""

    curvature: Callable[[float], object]
    factor: float

    def __call__(self, s: float) -> np.ndarray:
        return np.asarray(self.curvature(s / self.factor), float) / self.factor


def _longer_leaf(leaf: Leaf, factor: float) -> Leaf:
    curve = None if leaf.curvature is None else _Scaled(leaf.curvature, factor)
    return replace(leaf, start=_times(leaf.start, factor), end=_times(leaf.end, factor), curvature=curve)


def _longer(joint: Joint, factor: float) -> DrawnJoint:
    """All distances `factor` times, sections as they are."""
    leafs = tuple(_longer_leaf(leaf, factor) for leaf in joint.leafs())
    blocks = {name: _times(point, factor) for name, point in joint.blocks().items()}
    motions = tuple(
        replace(m, range=(factor * m.range[0], factor * m.range[1])) if m.kind == "translation" else m
        for m in joint.motions
    )
    return DrawnJoint(
        joint.family,
        blocks=blocks,
        leafs=leafs,
        motions=motions,
        length=factor * joint.length,
        shape=joint.shape(),
    )


def changes(joint: Joint) -> dict[tuple[str, str], DrawnJoint]:
    """(parameter, change in words): the joint with one thing changed that records take to be irrelevant."""
    found = {}
    for factor, words in ((0.5, "half"), (2.0, "twice")):
        found["thickness", words] = _redrawn(joint, tuple(_thickness(leaf, factor) for leaf in joint.leafs()))
        found["length", words] = _longer(joint, factor)
    aluminium = tuple(_material(leaf) for leaf in joint.leafs())
    found["material", "aluminium for steel"] = _redrawn(joint, aluminium)
    return found
