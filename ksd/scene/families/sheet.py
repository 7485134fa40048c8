"""Joints cut from one sheet: every leaf of one thickness and material, all widths along the joint's z."""

from __future__ import annotations

import math
from collections.abc import Mapping
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


class JointFamily(Joint):
    """What families do unless they say otherwise: B on the x axis at `length`, and no shape parameter.

    B turns about z by +-`stroke` [rad]; without one there is no intended motion.
    """

    stroke: ClassVar[float] = 0.0

    @property
    def pose_B(self) -> Vector:
        return (self.length, 0.0, 0.0)

    @property
    def motions(self) -> tuple[Motion, ...]:
        return rotation_about_z(self.stroke) if self.stroke else ()

    def shape(self) -> dict[str, float]:
        """No parameter."""
        return {}


class InclinedLeaves(JointFamily):
    """Joints whose leaf springs lean by `angle` [rad] from the line AB, from the height of A to that of B."""

    angle: float

    @property
    def pose_B(self) -> Vector:
        return (self.length * math.cos(self.angle), 0.0, 0.0)

    def check_leaning(self, *lengths: str) -> None:
        """`check_sheet`, and the angle between 0 and 90 degrees."""
        check_sheet(self, *lengths)
        owner, unit = type(self).__name__, math.radians(1)
        angle = between(self.angle, "angle", 0.0, 0.5 * math.pi, owner=owner, unit="deg", scale=unit)
        object.__setattr__(self, "angle", angle)


def parameter_dimensions(*lengths: str, **others: str) -> dict[str, str]:
    """The `quantities` of a family: its lengths, and others by dimension."""
    return dict.fromkeys(lengths, "length") | others


def check_lengths(joint: Any, *lengths: str) -> None:
    """Check and clean material, mesh and the positive `lengths` of a joint. Raises SceneError naming joint and parameter."""
    owner = type(joint).__name__
    if not isinstance(joint.material, Material):
        raise SceneError(f"{owner}: material = {show(joint.material)} must be a Material.")
    own = joint.__dict__
    own.update(checked_mesh(joint.elements, joint.orders, owner=owner))
    own.update({key: positive(own[key], key, owner=owner, unit="m") for key in lengths})


def check_sheet(joint: Any, *lengths: str, slender: str = "thickness") -> None:
    """`check_lengths` of a joint whose leaf springs are `slender` thick.

    Raises SceneError also for a thickness of half the leaf length or more.
    """
    check_lengths(joint, "length", slender, *lengths)
    owner, thick = type(joint).__name__, getattr(joint, slender)
    if thick >= 0.5 * joint.length:
        raise SceneError(
            f"{owner}: {slender} = {thick:g} m must be below half the leaf length, {joint.length / 2:g} m; "
            "a leaf is slender."
        )


_cached_rectangle = lru_cache(maxsize=256)(rectangle)
"""Most leaf springs of a joint have the section of another."""


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
    """A leaf of `joint` between two points (x, y) [m] at height z [m], its middle plane there; of another thickness [m] than
    that of the joint where said."""
    start, end = (*ends[0], z), (*ends[1], z)
    section = _cached_rectangle(joint.thickness if thickness is None else thickness, width)
    words: dict[str, Any] = {
        "start": start, "end": end, "width_axis": (0.0, 0.0, 1.0), "section": section, "material": joint.material,
        "start_block": blocks[0], "end_block": blocks[1], "name": name, "elements": joint.elements,
        "orders": joint.orders, "profile": profile, "curve": curve, "condition": None,
    }  # fmt: skip
    if not 0.0 < math.dist(start, end) < MAX_MAGNITUDE:
        return Leaf(**words)  # says what is wrong
    # all else that a leaf checks is so in a sheet, and a design loop draws hundreds of them
    leaf = object.__new__(Leaf)
    leaf.__dict__.update(words)
    return leaf


@lru_cache(maxsize=64)
def rotation_about_z(reach: float) -> tuple[Motion, ...]:
    """The intended rotation of a hinge about z, +-reach [rad]."""
    return (Motion("angle", "rotation", (0.0, 0.0, 1.0), (-reach, reach)),)


def bending_stiffness(joint: Any, width: float) -> float:
    """E I [N m^2] of a leaf of `joint` with `width` [m]."""
    return float(joint.material.E * width * joint.thickness**3 / 12)


def number_within(value: float, name: str, bounds: tuple[float, float], *, owner: str) -> float:
    """A dimensionless number within `bounds`, ends included. Raises SceneError."""
    (low, high), found = bounds, number(value, name, owner=owner)
    if not low <= found <= high:
        raise SceneError(f"{owner}: {name} = {show(value)} must lie between {low:g} and {high:g}.")
    return found


def in_plane_blocks(points: Mapping[str, Point]) -> dict[str, Vector]:
    """Blocks at points (x, y), all at z = 0."""
    return {name: (float(x), float(y), 0.0) for name, (x, y) in points.items()}
