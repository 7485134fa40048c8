"""The frozen scene: the whole description of a mechanism, as one value that can be compared and hashed."""

from __future__ import annotations

import dataclasses
import hashlib
import operator
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ksd.checks import Vector, as_given, as_vector, cross, direction, dot, made_perpendicular, show, unit
from ksd.errors import SceneError
from ksd.html import NotebookTables
from ksd.scene.curve import Curve
from ksd.scene.drive import GROUND, Drive
from ksd.scene.effects import Compliance, Distance, Fit, Heat, Spring, TurnSpring
from ksd.scene.hinges import Hinge
from ksd.scene.joint import Joint, Motion, joint_leaves
from ksd.scene.leaf import Leaf, LeafCondition
from ksd.scene.line_load import LineLoad, Pressure
from ksd.scene.listing import in_millimetres, printed_scene
from ksd.scene.load import Load, PointMass
from ksd.scene.obstacle import Cable, Contact, Stop, Surface
from ksd.scene.profile import Profile
from ksd.scene.sensor import Damper, Sensor

Matrix = tuple[Vector, Vector, Vector]
"""A matrix (3, 3) as a tuple of rows."""


MECHANISM_HINT = (
    "give a ksd.Mechanism or its scene; of a file: mechanism, targets, options = ksd.load_scene(file), then "
    "ksd.solve(mechanism, targets)"
)
"""End of the message where an argument should be a mechanism and is not."""


@dataclass(frozen=True, repr=False)
class PlacedJoint:
    """A joint between links `a` (interface A) and `b` (interface B).

    origin (3,) [m]: global position of interface A; rotation (3, 3): columns are the joint's x, y, z axes in global axes.
    conditions: (leaf name, condition) pairs, set by the model from the heats and fits of a scene.
    """

    name: str
    a: str
    b: str
    joint: Joint
    origin: Vector
    rotation: Matrix
    conditions: tuple[tuple[str, LeafCondition], ...] = ()

    def __repr__(self) -> str:
        at, length = in_millimetres(self.origin), 1e3 * self.joint.length
        return f"<PlacedJoint '{self.name}': {self.joint.family}, {length:.4g} mm, from '{self.a}' to '{self.b}' at {at}>"

    def leaves(self) -> tuple[Leaf, ...]:
        """The leaf springs of the joint in joint axes, with their conditions."""
        leaves = joint_leaves(self.joint)
        if not self.conditions:
            return leaves
        conditions = dict(self.conditions)
        return tuple(replace(leaf, condition=conditions.get(leaf.name)) for leaf in leaves)

    def place(self, point: ArrayLike) -> np.ndarray:
        """Undeformed global position (3,) [m] of a point (3,) [m] given in joint axes."""
        return np.asarray(self.origin) + np.asarray(self.rotation) @ np.asarray(point, float)

    def turn(self, axis: ArrayLike) -> np.ndarray:
        """Undeformed global direction (3,) of a direction (3,) given in joint axes."""
        return np.asarray(self.rotation) @ np.asarray(axis, float)


@dataclass(frozen=True, repr=False)
class PlacedLeaf:
    """A free-form leaf from link `a` to link `b`, described in global axes."""

    name: str
    a: str
    b: str
    leaf: Leaf

    def __repr__(self) -> str:
        ends = " to ".join(in_millimetres(p) for p in (self.leaf.start, self.leaf.end))
        return f"<PlacedLeaf '{self.name}': from '{self.a}' to '{self.b}', {ends}, {self.leaf.section!r}>"


@dataclass(frozen=True)
class LeafPoint:
    """Link `name`, without mass, clamped to the free-form leaf `leaf` at arc length s [m] from its start.

    unlisted: whether it is none of the user's: made for a moment (`ksd.model.line_moments`) or contact along the leaf.
    """

    name: str
    leaf: str
    s: float
    unlisted: bool = False


@dataclass(frozen=True)
class Scene(NotebookTables):
    """The frozen description of a mechanism; all positions are global and undeformed, in SI units.

    name: of the mechanism; links: their names, links[0] is "ground"; joints, leaves: placed joints and free-form leaf
    springs; drives, supports, loads, masses: in the order of their statements. gravity (3,) [m/s^2], None when not
    mentioned; springs, compliances, heats, fits: see `ksd.scene.effects`; consider: optional effects of the leaf springs to
    simulate. plane: "xy", "xz" or "yz" for a planar mechanism; hinges: those without stiffness, whose supports are among
    `supports`; points: links that are points of leaf springs; distances: to be reported; sensors, dampers: see
    `ksd.scene.sensor`; stops, cables, surfaces, contacts: see `ksd.scene.obstacle`; line_loads, pressures: along free-form
    leaf springs. Scenes with the same contents are equal, and have the same `fingerprint` in every process and on every
    machine.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> scene = guide.scene()
    >>> scene.links, len(scene.leaves), scene == guide.scene()
    (('ground', 'table'), 2, True)
    """

    name: str
    links: tuple[str, ...]
    joints: tuple[PlacedJoint, ...] = ()
    leaves: tuple[PlacedLeaf, ...] = ()
    drives: tuple[Drive, ...] = ()
    supports: tuple[Drive, ...] = ()
    loads: tuple[Load, ...] = ()
    masses: tuple[PointMass, ...] = ()
    gravity: Vector | None = None
    springs: tuple[Spring | TurnSpring, ...] = ()
    compliances: tuple[Compliance, ...] = ()
    heats: tuple[Heat, ...] = ()
    fits: tuple[Fit, ...] = ()
    consider: tuple[str, ...] = ()
    plane: str | None = None
    hinges: tuple[Hinge, ...] = ()
    points: tuple[LeafPoint, ...] = ()
    distances: tuple[Distance, ...] = ()
    sensors: tuple[Sensor, ...] = ()
    dampers: tuple[Damper, ...] = ()
    stops: tuple[Stop, ...] = ()
    cables: tuple[Cable, ...] = ()
    surfaces: tuple[Surface, ...] = ()
    contacts: tuple[Contact, ...] = ()
    line_loads: tuple[LineLoad, ...] = ()
    pressures: tuple[Pressure, ...] = ()

    def __str__(self) -> str:
        """The parts of the mechanism, one per line."""
        return printed_scene(self)

    @property
    def loads_along(self) -> tuple[LineLoad | Pressure, ...]:
        """Line loads and pressures."""
        return (*self.line_loads, *self.pressures)

    @property
    def unlisted(self) -> frozenset[str]:
        """Links that are points made for moments and contacts along leaf springs."""
        return frozenset(p.name for p in self.points if p.unlisted)

    @property
    def loads_on_links(self) -> tuple[Load, ...]:
        """The loads without those that stand for moments along leaf springs."""
        unlisted = self.unlisted
        return tuple(x for x in self.loads if x.link not in unlisted)

    def leaf_names(self) -> dict[str, Leaf]:
        """All leaf springs by full name: "joint/leaf" in joints, their own name for free-form ones."""
        inside = {f"{j.name}/{leaf.name}": leaf for j in self.joints for leaf in j.leaves()}
        return inside | {placed.name: placed.leaf for placed in self.leaves}

    def leaves_apart(self) -> list[tuple[str, str]]:
        """Pairs of full names of leaf springs that share no block and are not in one joint with windows."""
        blocks: dict[str, set[str]] = {}
        for j in self.joints:
            ends = {"A": j.a, "B": j.b}
            for leaf in joint_leaves(j.joint):
                both = (leaf.start_block, leaf.end_block)
                own = blocks[f"{j.name}/{leaf.name}"] = {ends.get(e, f"{j.name}/{e}") for e in both}
                # leaf springs that pass through windows of one another share the joint as if it were a block
                own |= {f"{j.name}/"} if j.joint.windows else set()
        blocks |= {placed.name: {placed.a, placed.b} for placed in self.leaves}
        for point in self.points:
            blocks[point.leaf].add(point.name)
        return [(one, two) for one, two in combinations(blocks, 2) if not blocks[one] & blocks[two]]

    @cached_property
    def is_immutable(self) -> bool:
        """Whether all contents are immutable: every joint is a frozen dataclass, and no leaf has a curve or profile."""
        leaves = self.leaf_names().values()
        params = (getattr(j.joint, "__dataclass_params__", None) for j in self.joints)
        return all(p is not None and p.frozen for p in params) and all(
            leaf.curve is None and leaf.profile is None for leaf in leaves
        )

    def fingerprint(self) -> str:
        """SHA-256 of all contents, in hexadecimal."""
        return self._fingerprint if self.is_immutable else fingerprint(self)

    @cached_property
    def _fingerprint(self) -> str:
        return fingerprint(self)

    def neighbours(self, *, hinges: bool = False, supports: bool = False) -> dict[str, set[str]]:
        """Links connected to each link by joints and free-form leaf springs.

        hinges: pins and sliders connect too; supports: all supports connect too.
        """
        neighbours: dict[str, set[str]] = {link: set() for link in self.links}
        pairs = [(j.a, j.b) for j in self.joints] + [(f.a, f.b) for f in self.leaves if f.a != f.b]
        ends = {f.name: f.a for f in self.leaves}
        pairs += [(ends[p.leaf], p.name) for p in self.points if p.leaf in ends]
        if hinges:
            pairs += [(h.a, h.b) for h in self.hinges]
        if supports:
            pairs += [(t.base, t.link) for s in self.supports for t in s.terms]
        for a, b in pairs:
            neighbours.setdefault(a, set()).add(b)
            neighbours.setdefault(b, set()).add(a)
        return neighbours


def connected_links(
    neighbours: Mapping[str, set[str]], start: str = GROUND, without: Collection[str] = ()
) -> set[str]:
    """Links connected to `start`, itself included, when the links `without` are removed; see `Scene.neighbours`."""
    connected, pending = {start}, [start]
    while pending:
        new = neighbours[pending.pop()] - connected - set(without)
        connected |= new
        pending += new
    return connected


def hold_same_objects(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether the fields of two scenes are the same objects, or tuples of the same objects; nothing is compared by value."""
    for key, first in one.items():
        second = other[key]
        if first is second:
            continue
        if type(first) is not tuple or type(second) is not tuple or len(first) != len(second):
            return False
        if not all(map(operator.is_, first, second)):
            return False
    return True


def joint_rotation(axis: Any, toward: Any, owner: str) -> Matrix:
    """Rotation matrix (3, 3) with columns x = toward, y = axis x toward, z = axis.

    Raises SceneError unless axis and toward are perpendicular.
    """
    # in plain numbers: a design loop calls this for every joint, and arrays of three cost ten times as much
    z = direction(axis, "axis", owner=owner)
    x = direction(toward, "toward", owner=owner)
    perpendicular = made_perpendicular(x, z, "toward", owner)
    if perpendicular is None:
        cosine = dot(x, z)
        raise SceneError(
            f"{owner}: toward = {show(toward)} must be perpendicular to axis = {show(axis)}; "
            f"the angle between them is {np.degrees(np.arccos(np.clip(cosine, -1, 1))):.4g} degrees."
        )
    x, cosine = perpendicular, dot(perpendicular, z)
    if abs(cosine) > 1e-15:
        x = unit(tuple(a - cosine * b for a, b in zip(x, z, strict=True)))
    y = cross(z, x)
    # -0.0 becomes 0.0
    return (
        (x[0] + 0.0, y[0] + 0.0, z[0] + 0.0), (x[1] + 0.0, y[1] + 0.0, z[1] + 0.0), (x[2] + 0.0, y[2] + 0.0, z[2] + 0.0),
    )  # fmt: skip


def joint_angle(joint: PlacedJoint, motion: Motion) -> tuple[str, Vector, Vector]:
    """(kind, global direction (3,), global point (3,) [m] of B) of an intended motion of a placed joint."""
    point = joint.joint.pose_B if motion.point is None else motion.point
    # in plain numbers, since a design loop calls this for every drive
    e, f, g = joint.rotation
    x, y, z = joint.origin
    axis = dot(e, motion.axis), dot(f, motion.axis), dot(g, motion.axis)
    return motion.kind, axis, (x + dot(e, point), y + dot(f, point), z + dot(g, point))


def global_leaf(joint: PlacedJoint, leaf: Leaf, links: Mapping[str, str]) -> PlacedLeaf:
    """A leaf of a placed joint as a free-form leaf in global axes; links: name of the link of each block."""
    label = f"{joint.name}/{leaf.name}"
    moved = replace(
        leaf,
        start=as_vector(joint.place(leaf.start)),
        end=as_vector(joint.place(leaf.end)),
        width_axis=as_vector(joint.turn(as_given(leaf.width_axis))),
        start_block=links[leaf.start_block],
        end_block=links[leaf.end_block],
        name=label,
    )
    return PlacedLeaf(label, moved.start_block, moved.end_block, moved)


def fingerprint(value: Any) -> str:
    """SHA-256 (hexadecimal) of a value made of numbers, text, tuples and dataclasses."""
    digest = hashlib.sha256()
    for text in _canonical_text(value):
        digest.update(text.encode())
        digest.update(b"\n")
    return digest.hexdigest()


def _canonical_text(value: Any) -> Iterator[str]:
    """Unambiguous text of a value, part by part: types, field names and exact floats."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    is_instance = dataclasses.is_dataclass(value) and not isinstance(value, type)
    if is_instance or isinstance(value, Curve | Profile):
        yield f"<{type(value).__name__}"
        for field in dataclasses.fields(value) if is_instance else ():
            if field.compare:
                yield field.name
                yield from _canonical_text(getattr(value, field.name))
        if isinstance(value, Curve | Profile):
            yield from _canonical_text(_curve_samples(value))
        yield ">"
    elif isinstance(value, tuple | list):
        yield f"({len(value)}"
        for item in value:
            yield from _canonical_text(item)
        yield ")"
    elif isinstance(value, bool | int | str) or value is None:
        yield f"{type(value).__name__} {value!r}"
    elif isinstance(value, float):
        # -0.0 == 0.0, so both must give the same text
        yield (value + 0.0).hex()
    elif not callable(value):
        raise TypeError(f"a scene holds numbers, text and tuples, not {type(value).__name__}")


def _curve_samples(value: Curve | Profile) -> Any:
    """A curve or profile at 17 stations, in place of its function, whose contents cannot be hashed."""
    stations = [float(s) for s in np.linspace(0.0, 1.0, 17)]
    if isinstance(value, Curve):
        return tuple(map(as_vector, value.curvatures(stations)))
    return tuple(value.section(s) for s in stations)
