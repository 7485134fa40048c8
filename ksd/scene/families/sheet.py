"""Base classes, checks and drawing functions of joint families; most joints are cut from a sheet with all widths along z."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar

from ksd.checks import MAX_MAGNITUDE, Vector, between, number, positive, show
from ksd.errors import SceneError
from ksd.scene.curve import Curve
from ksd.scene.joint import Joint, Motion
from ksd.scene.leaf import Leaf, checked_mesh
from ksd.scene.material import Material
from ksd.scene.profile import Profile
from ksd.section import rectangle

Point = tuple[float, float]
"""A point (x, y) [m] in the plane of a sheet."""


@dataclass(frozen=True)
class JointFamily(Joint):
    """Base of joint families of one material, with their defaults: B on the x axis at `length`, no shape parameter.

    B turns about z by +-`stroke` [rad]; for a stroke of zero there is no intended motion.
    """

    material: Material
    stroke: ClassVar[float] = 0.0

    @property
    def pose_B(self) -> Vector:
        return (self.length, 0.0, 0.0)

    @property
    def motions(self) -> tuple[Motion, ...]:
        return rotation_about_z(self.stroke) if self.stroke else ()

    def shape(self) -> dict[str, float]:
        """No shape parameters."""
        return {}

    def without_mass(self) -> JointFamily:
        return replace(self, material=self.material.without_mass())


class InclinedLeaves(JointFamily):
    """Base of families whose leaf springs are inclined by `angle` [rad] to the line AB."""

    angle: float

    @property
    def pose_B(self) -> Vector:
        return (self.length * math.cos(self.angle), 0.0, 0.0)

    def check_inclined(self, *lengths: str) -> None:
        """Apply `check_sheet`, and check that the angle is between 0 and 90 degrees. Raises SceneError."""
        check_sheet(self, *lengths)
        check_angle(self, "angle", 0.5 * math.pi)


def parameter_dimensions(*lengths: str, **others: str) -> dict[str, str]:
    """The `quantities` of a family: dimension by parameter, "length" for `lengths`."""
    return dict.fromkeys(lengths, "length") | others


def check_lengths(joint: Any, *lengths: str) -> None:
    """Check material, mesh parameters and the positive `lengths` of a joint, and make the lengths floats.

    Raises SceneError naming joint and parameter.
    """
    owner = type(joint).__name__
    if not isinstance(joint.material, Material):
        raise SceneError(f"{owner}: material = {show(joint.material)} must be a Material.")
    own = joint.__dict__
    own.update(checked_mesh(joint.elements, joint.orders, owner=owner))
    own.update({key: positive(own[key], key, owner=owner, unit="m") for key in lengths})


def check_sheet(joint: Any, *lengths: str, slender: str = "thickness") -> None:
    """Apply `check_lengths`, and check that the parameter `slender` is below half the leaf length. Raises SceneError."""
    check_lengths(joint, "length", slender, *lengths)
    owner, thickness = type(joint).__name__, getattr(joint, slender)
    if thickness >= 0.5 * joint.length:
        raise SceneError(
            f"{owner}: {slender} = {thickness:g} m must be below half the leaf length, {joint.length / 2:g} m; "
            "a leaf is slender."
        )


def check_angle(joint: Any, name: str, high: float) -> None:
    """Check that the angle `name` [rad] of a joint lies between 0 and `high`, and make it a float. Raises SceneError."""
    own, owner = joint.__dict__, type(joint).__name__
    own[name] = between(own[name], name, 0.0, high, owner=owner, unit="deg", scale=math.radians(1))


def check_ratio(joint: Any, name: str, low: float, high: float) -> None:
    """Check that the number `name` of a joint lies within its bounds, ends included, and make it a float.

    Raises SceneError.
    """
    own, owner = joint.__dict__, type(joint).__name__
    value = number(own[name], name, owner=owner)
    if not low <= value <= high:
        raise SceneError(f"{owner}: {name} = {show(own[name])} must lie between {low:g} and {high:g}.")
    own[name] = value


_cached_rectangle = lru_cache(maxsize=256)(rectangle)
"""`rectangle`, cached since most leaf springs of a joint have the same section."""


def sheet_leaf(
    joint: Any,
    name: str,
    ends: tuple[Point, Point],
    width: float,
    *,
    blocks: tuple[str, str] = ("A", "B"),
    z: float = 0.0,
    thickness: float | None = None,
    profile: Profile | None = None,
    curve: Curve | None = None,
) -> Leaf:
    """A leaf of `joint` between the points `ends` (x, y) [m], with its width [m] along z and its middle at height z [m].

    thickness [m]: default that of the joint. Raises SceneError for a leaf without length.
    """
    start, end = (*ends[0], z), (*ends[1], z)
    section = _cached_rectangle(joint.thickness if thickness is None else thickness, width)
    words: dict[str, Any] = {
        "start": start, "end": end, "width_axis": (0.0, 0.0, 1.0), "section": section, "material": joint.material,
        "start_block": blocks[0], "end_block": blocks[1], "name": name, "elements": joint.elements,
        "orders": joint.orders, "profile": profile, "curve": curve, "condition": None,
    }  # fmt: skip
    if not 0.0 < math.dist(start, end) < MAX_MAGNITUDE:
        return Leaf(**words)  # raises SceneError with the reason
    # all other checks of a leaf hold by construction; they are skipped since design loops draw hundreds of leaf springs
    leaf = object.__new__(Leaf)
    leaf.__dict__.update(words)
    return leaf


@lru_cache(maxsize=64)
def rotation_about_z(stroke: float) -> tuple[Motion, ...]:
    """The intended rotation about z of a hinge, +-stroke [rad]."""
    return (Motion("angle", "rotation", (0.0, 0.0, 1.0), (-stroke, stroke)),)


def bending_stiffness(joint: Any, width: float) -> float:
    """E I [N m^2] of a leaf of `joint` with `width` [m]."""
    return float(joint.material.E * width * joint.thickness**3 / 12)


def in_plane_blocks(points: Mapping[str, Point]) -> dict[str, Vector]:
    """Reference points (3,) [m] of blocks by name, from points (x, y) [m] in the plane z = 0."""
    return {name: (float(x), float(y), 0.0) for name, (x, y) in points.items()}
