"""The frozen scene: everything said about a mechanism, in one value that can be compared and hashed."""

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

from ksd.checks import Vector, as_given, as_vector, dot
from ksd.html import InNotebooks
from ksd.scene.curve import Curve
from ksd.scene.drive import GROUND, Drive
from ksd.scene.effects import Compliance, Distance, Fit, Heat, Spring, TurnSpring
from ksd.scene.hinges import Hinge
from ksd.scene.joint import Joint, Motion, joint_leaves
from ksd.scene.leaf import Leaf, LeafCondition
from ksd.scene.listing import in_millimetres, printed_scene
from ksd.scene.load import Load, PointMass
from ksd.scene.profile import Profile

Matrix = tuple[Vector, Vector, Vector]


MECHANISM_HINT = (
    "give a ksd.Mechanism or its scene; of a file: mechanism, targets, options = ksd.load_scene(file), then "
    "ksd.solve(mechanism, targets)"
)
"""What to give where a mechanism is wanted."""


@dataclass(frozen=True, repr=False)
class PlacedJoint:
    """A joint between links `a` (interface A) and `b` (interface B).

    origin (3,) [m]: interface A, global; rotation (3, 3): columns are the joint's x, y, z axes in global
    axes. conditions: of its leaf springs by name, set by the model from the heats and fits of a scene.
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
        """The leaf springs of the joint, in joint axes, with their conditions."""
        leaves = joint_leaves(self.joint)
        if not self.conditions:
            return leaves
        found = dict(self.conditions)
        return tuple(replace(leaf, condition=found.get(leaf.name)) for leaf in leaves)

    def place(self, point: ArrayLike) -> np.ndarray:
        """Global position (3,) [m] at rest of a point (3,) given in joint axes."""
        return np.asarray(self.origin) + np.asarray(self.rotation) @ np.asarray(point, float)

    def turn(self, axis: ArrayLike) -> np.ndarray:
        """Global direction (3,) at rest of a direction (3,) given in joint axes."""
        return np.asarray(self.rotation) @ np.asarray(axis, float)


@dataclass(frozen=True, repr=False)
class PlacedLeaf:
    """A free-form leaf from link `a` to link `b`; the leaf's own numbers are global."""

    name: str
    a: str
    b: str
    leaf: Leaf

    def __repr__(self) -> str:
        ends = " to ".join(in_millimetres(p) for p in (self.leaf.start, self.leaf.end))
        return f"<PlacedLeaf '{self.name}': from '{self.a}' to '{self.b}', {ends}, {self.leaf.section!r}>"


@dataclass(frozen=True)
class LeafPoint:
    """A point of the free-form leaf `leaf` at arc length s [m] from its start: link `name`, clamped there without mass."""

    name: str
    leaf: str
    s: float


@dataclass(frozen=True)
class Scene(InNotebooks):
    """A mechanism as described: links[0] is "ground"; all positions global at rest, SI units.

    name: of the mechanism; links: names; joints, leaves: as placed; drives, supports, loads, masses: as said. gravity (3,)
    [m/s^2] or None when the scene does not mention it; springs, compliances, heats, fits: see
    `ksd.scene.effects`; consider: effects of the leaf that may be taken up. plane: the one it lives in ("xy", "xz", "yz");
    hinges: pins and sliders, whose supports are among `supports`; points: links that are points of leaves; distances: asked
    for. Two scenes are equal when everything said in them is; `fingerprint` is then the same in every process and on every
    machine.
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

    def __str__(self) -> str:
        """What it is made of, a line each."""
        return printed_scene(self)

    def leaf_names(self) -> dict[str, Leaf]:
        """Every leaf by its full name: "joint/leaf", and free-form leaf springs by their own."""
        inside = {f"{j.name}/{leaf.name}": leaf for j in self.joints for leaf in j.leaves()}
        return inside | {placed.name: placed.leaf for placed in self.leaves}

    def leaves_apart(self) -> list[tuple[str, str]]:
        """Full names of every two leaf springs that share no block and are not in one joint with windows."""
        blocks: dict[str, set[str]] = {}
        for j in self.joints:
            ends = {"A": j.a, "B": j.b}
            for leaf in joint_leaves(j.joint):
                both = (leaf.start_block, leaf.end_block)
                found = blocks[f"{j.name}/{leaf.name}"] = {ends.get(e, f"{j.name}/{e}") for e in both}
                # what passes through windows of one another shares the joint as if it were a block
                found |= {f"{j.name}/"} if j.joint.windows else set()
        blocks |= {placed.name: {placed.a, placed.b} for placed in self.leaves}
        for point in self.points:
            blocks[point.leaf].add(point.name)
        return [(one, two) for one, two in combinations(blocks, 2) if not blocks[one] & blocks[two]]

    @cached_property
    def unchangeable(self) -> bool:
        """Whether everything in it is frozen: no joint family of the user's own that is not, no function of his."""
        leaves = self.leaf_names().values()
        params = (getattr(j.joint, "__dataclass_params__", None) for j in self.joints)
        return all(p is not None and p.frozen for p in params) and all(
            leaf.curve is None and leaf.profile is None for leaf in leaves
        )

    def fingerprint(self) -> str:
        """SHA-256 (hexadecimal) of all contents."""
        return self._fingerprint if self.unchangeable else fingerprint(self)

    @cached_property
    def _fingerprint(self) -> str:
        return fingerprint(self)

    def neighbours(self, *, hinges: bool = False, supports: bool = False) -> dict[str, set[str]]:
        """Links next to each link through joints and free-form leaf springs, and through pins and sliders, or all supports,
        when asked."""
        found: dict[str, set[str]] = {link: set() for link in self.links}
        pairs = [(j.a, j.b) for j in self.joints] + [(f.a, f.b) for f in self.leaves]
        ends = {f.name: f.a for f in self.leaves}
        pairs += [(ends[p.leaf], p.name) for p in self.points if p.leaf in ends]
        if hinges:
            pairs += [(h.a, h.b) for h in self.hinges]
        if supports:
            pairs += [(t.base, t.link) for s in self.supports for t in s.terms]
        for a, b in pairs:
            found.setdefault(a, set()).add(b)
            found.setdefault(b, set()).add(a)
        return found


def connected_links(
    next_to: Mapping[str, set[str]], start: str = GROUND, without: Collection[str] = ()
) -> set[str]:
    """Links that hang together with `start`, see `Scene.neighbours`, when others are taken away."""
    found, rest = {start}, [start]
    while rest:
        fresh = next_to[rest.pop()] - found - set(without)
        found |= fresh
        rest += fresh
    return found


def hold_same_objects(one: Mapping[str, Any], other: Mapping[str, Any]) -> bool:
    """Whether the words of two scenes hold the very same objects: as fast as it is strict."""
    for key, mine in one.items():
        theirs = other[key]
        if mine is theirs:
            continue
        if type(mine) is not tuple or type(theirs) is not tuple or len(mine) != len(theirs):
            return False
        if not all(map(operator.is_, mine, theirs)):
            return False
    return True


def joint_angle(joint: PlacedJoint, motion: Motion) -> tuple[str, Vector, Vector]:
    """(kind, global direction, global point of B) of an intended motion of a placed joint."""
    place = joint.joint.pose_B if motion.point is None else motion.point
    # plain numbers: a design loop comes by here for every drive
    e, f, g = joint.rotation
    x, y, z = joint.origin
    axis = dot(e, motion.axis), dot(f, motion.axis), dot(g, motion.axis)
    return motion.kind, axis, (x + dot(e, place), y + dot(f, place), z + dot(g, place))


def global_leaf(joint: PlacedJoint, leaf: Leaf, links: Mapping[str, str]) -> PlacedLeaf:
    """A leaf of a placed joint as a free-form leaf in global coordinates; links: link by block."""
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
    """SHA-256 (hexadecimal) of all that a value of numbers, texts, tuples and frozen sentences holds."""
    digest = hashlib.sha256()
    for piece in _canonical_text(value):
        digest.update(piece.encode())
        digest.update(b"\n")
    return digest.hexdigest()


def _canonical_text(value: Any) -> Iterator[str]:
    """Unambiguous text of a value, part by part: types, field names, exact floats."""
    if isinstance(value, np.ndarray):
        value = value.tolist()
    own = dataclasses.is_dataclass(value) and not isinstance(value, type)
    if own or isinstance(value, Curve | Profile):
        yield f"<{type(value).__name__}"
        for field in dataclasses.fields(value) if own else ():
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
        # -0.0 == 0.0, so both must hash alike
        yield (value + 0.0).hex()
    else:
        if callable(value):
            return
        raise TypeError(f"a scene holds numbers, text and tuples, not {type(value).__name__}")


def _curve_samples(value: Curve | Profile) -> Any:
    """A curve or profile at 17 stations: a function in it has no contents that could be hashed."""
    stations = [float(s) for s in np.linspace(0.0, 1.0, 17)]
    if isinstance(value, Curve):
        return tuple(map(as_vector, value.curvatures(stations)))
    return tuple(value.section(s) for s in stations)
