"""A design for the trainer: a joint as a function of its shape parameters, and changes of it that records leave out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ksd.checks import Vector, as_vector
from ksd.library import Mesh, Parameter
from ksd.scene import DrawnJoint, Joint, Leaf, Link, Material, Mechanism
from ksd.scene.curve import Curve
from ksd.scene.profile import Profile
from ksd.section import Section

ALL_MESHES: tuple[Mesh, ...] = ("strain", 1, 2, 3, 4, 5, 6, 7, 8)
"""Meshes that families are trained on by default."""


@dataclass(frozen=True)
class Design:
    """A family for the trainer: make(**shape) draws the joint at shape parameters within `parameters`.

    numbers: values held fixed, SI. meshes: those trained by default; tolerance_factor: factor on all wanted errors. others:
    further parameters of make, {name: values}, that must not matter: the record holds the evidence. idle: parameters
    found not to matter; they stay in the middle of their range while sampling.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> def draw(ratio):
    ...     return ksd.CrossedPivot(
    ...         steel, length=50 * mm, angle=45 * deg, thickness=0.3 * mm, width=15 * mm,
    ...         ratio=ratio,
    ...     )
    >>> design = ksd.Design("my_pivot", (ksd.Parameter("ratio", 0.1, 0.3),), draw)
    >>> design.make(ratio=0.2).family, design.parameters[0].name
    ('crossed_pivot', 'ratio')
    """

    family: str
    parameters: tuple[Parameter, ...]
    make: Callable[..., Joint]
    numbers: Mapping[str, float] = field(default_factory=dict)
    meshes: tuple[Mesh, ...] = ALL_MESHES
    tolerance_factor: float = 1.0
    others: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    idle: tuple[str, ...] = ()

    def other_joints(self) -> dict[tuple[str, str], DrawnJoint]:
        """{(parameter, change in words): joint in the middle of its shapes with one of `others` changed}."""
        middle = self.shape(np.zeros(len(self.parameters)))
        return {
            (name, f"{value:.6g}"): without_mesh_choices(self.make(**middle, **{name: value}))
            for name, values in self.others.items()
            for value in values
        }

    def joint(self, places: np.ndarray) -> DrawnJoint:
        """The joint at coordinates places (s,) in [-1, 1] of its shape parameters, without mesh options of its own."""
        return without_mesh_choices(self.make(**self.shape(places)))

    def shape(self, places: np.ndarray) -> dict[str, float]:
        """Shape parameters at coordinates places (s,) in [-1, 1]."""
        return {p.name: p.value(float(x)) for p, x in zip(self.parameters, places, strict=True)}


def without_mesh_choices(joint: Joint) -> DrawnJoint:
    """The same joint as a drawing whose leaf springs have no mesh options of their own."""
    leaves = tuple(replace(leaf, elements=None, orders=None) for leaf in joint.leaves())
    return redraw_joint(joint, leaves)


def redraw_joint(joint: Joint, leaves: tuple[Leaf, ...], **changed: Any) -> DrawnJoint:
    """The same joint as a drawing with other leaf springs between its blocks; changed: other arguments of `DrawnJoint`."""
    arguments: dict[str, Any] = {
        "blocks": joint.blocks(), "motions": joint.motions, "length": joint.length, "shape": joint.shape(),
        "windows": joint.windows, "held_by_others": joint.held_by_others,
    }  # fmt: skip
    return DrawnJoint(joint.family, leaves=leaves, **(arguments | changed))


def held_joint(joint: Joint) -> tuple[Mechanism, Link]:
    """A mechanism of the joint alone, in the global axes, and its link B; interface A is ground."""
    scene = Mechanism(joint.family)
    link = scene.link("B")
    scene.join(scene.ground, link, joint, at=(0, 0, 0), axis="z", toward="x", name="joint")
    return scene, link


def _scale_thickness(section: Section, factor: float) -> Section:
    """A thin section with `factor` times its thickness."""
    s, f = section, factor
    return replace(s, A=f * s.A, J=f**3 * s.J, Iy=f * s.Iy, Iz=f**3 * s.Iz, thickness=f * s.thickness)


def _scale_width(section: Section, factor: float) -> Section:
    """A thin section with `factor` times its width."""
    s, f = section, factor
    return replace(s, A=f * s.A, J=f * s.J, Iy=f**3 * s.Iy, Iz=f * s.Iz, width=f * s.width)


@dataclass(frozen=True)
class _ChangedProfile(Profile):
    """A profile whose sections are changed by `change(section, factor)`."""

    profile: Profile
    change: Callable[[Section, float], Section]
    factor: float

    @property
    def breaks(self) -> tuple[float, ...]:  # type: ignore[override]
        return self.profile.breaks

    def section(self, s: float) -> Section:
        return self.change(self.profile.section(s), self.factor)


def _with_changed_sections(
    joint: Joint, change: Callable[[Section, float], Section], factor: float
) -> DrawnJoint:
    """The joint with changed sections; windows are allowed, since overlap of wider leaf springs does not affect their
    bending."""
    leaves = []
    for leaf in joint.leaves():
        profile = None if leaf.profile is None else _ChangedProfile(leaf.profile, change, factor)
        leaves.append(replace(leaf, section=change(leaf.section, factor), profile=profile))
    return redraw_joint(joint, tuple(leaves), windows=True)


def _scale_soft_stiffness(section: Section, factor: float) -> Section:
    """A section with `factor` times the stiffnesses against which thin leaf springs are flexible: weak bending and
    torsion."""
    # a wire is flexible in both bending directions; a leaf below a width of three thicknesses counts as a wire
    bends_both_ways = section.Iy < 10 * section.Iz
    Iy = factor * section.Iy if bends_both_ways else section.Iy
    return replace(section, J=factor * section.J, Iy=Iy, Iz=factor * section.Iz)


def soften_leaves(joint: Joint, factor: float) -> DrawnJoint:
    """The joint with `factor` times the weak-bending and torsional stiffness of every leaf."""
    return _with_changed_sections(joint, _scale_soft_stiffness, factor)


@dataclass(frozen=True)
class _ScaledCurve(Curve):
    """A curve `factor` times as long."""

    curve: Curve
    factor: float

    @property
    def length(self) -> float:  # type: ignore[override]
        return self.factor * self.curve.length

    def curvature(self, s: float) -> np.ndarray:
        return self.curve.curvature(s) / self.factor


def _scale_lengths(joint: Joint, factor: float) -> DrawnJoint:
    """The joint with all distances multiplied by `factor` and unchanged sections."""

    def scaled(point: Vector) -> Vector:
        return as_vector(factor * c for c in point)

    leaves = tuple(
        replace(
            leaf, start=scaled(leaf.start), end=scaled(leaf.end),
            curve=None if leaf.curve is None else _ScaledCurve(leaf.curve, factor),
        )
        for leaf in joint.leaves()
    )  # fmt: skip
    blocks = {name: scaled(point) for name, point in joint.blocks().items()}
    motions = tuple(
        replace(
            m,
            range=(factor * m.range[0], factor * m.range[1]),
            point=None if m.point is None else scaled(m.point),
        )
        if m.kind == "translation"
        else m
        for m in joint.motions
    )
    return redraw_joint(
        joint, leaves, blocks=blocks, motions=motions, length=factor * joint.length, windows=True
    )


def irrelevant_changes(joint: Joint) -> dict[tuple[str, str], DrawnJoint]:
    """{(parameter, change in words): joint with one thing changed that records assume to be irrelevant}."""
    changed = {}
    for factor, words in ((0.5, "half"), (2.0, "twice")):
        changed["thickness", words] = _with_changed_sections(joint, _scale_thickness, factor)
        changed["width", words] = _with_changed_sections(joint, _scale_width, factor)
        changed["length", words] = _scale_lengths(joint, factor)
    aluminium = Material(E=71e9, nu=0.33)
    leaves = tuple(replace(leaf, material=aluminium) for leaf in joint.leaves())
    changed["material", "aluminium for steel"] = redraw_joint(joint, leaves)
    return changed
