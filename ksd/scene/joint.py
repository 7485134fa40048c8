"""Joints: rigid blocks connected by leaf springs, with two interfaces A and B and intended motions of B relative to A."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np

from ksd.checks import (
    ClearArgumentErrors,
    Vector,
    boolean,
    direction,
    name_hint,
    number,
    positive,
    show,
    unused_name,
    vector,
    word,
)
from ksd.errors import SceneError
from ksd.scene.clearance import check_clear
from ksd.scene.leaf import Leaf


@dataclass(frozen=True)
class Motion(metaclass=ClearArgumentErrors):
    """One intended motion of interface B relative to A.

    name: the name by which it is driven. kind: "rotation" [rad] or "translation" [m]; axis (3,): its direction, in joint
    axes; range (low, high): range it may be used in. point (3,) [m], undeformed, in joint axes: the point of B whose
    displacement a translation is, and on which its force acts; interface B when None. Raises SceneError for another kind, an
    axis without length, and a range that does not rise.

    >>> turn = ksd.Motion("turn", "rotation", "z", (-10 * deg, 10 * deg))
    >>> turn.kind, turn.axis, round(turn.range[1] / deg, 6)
    ('rotation', (0.0, 0.0, 1.0), 10.0)
    """

    name: str
    kind: str
    axis: Vector
    range: tuple[float, float]
    point: Vector | None = None

    def __post_init__(self) -> None:
        owner = f"motion '{word(self.name, 'name', owner='motion')}'"
        if self.kind not in ("rotation", "translation"):
            raise SceneError(f'{owner}: kind = {show(self.kind)} must be "rotation" or "translation".')
        object.__setattr__(self, "axis", direction(self.axis, "axis", owner=owner))
        if not isinstance(self.range, Sequence) or len(self.range) != 2:
            raise SceneError(f"{owner}: range = {show(self.range)} must be two numbers, lowest and highest.")
        low, high = (number(v, "range", owner=owner) for v in self.range)
        if not low < high:
            raise SceneError(
                f"{owner}: range = ({low:g}, {high:g}) must rise from its first to its second number."
            )
        object.__setattr__(self, "range", (low, high))
        if self.point is not None:
            object.__setattr__(self, "point", vector(self.point, "point", owner=owner, unit="m"))


class Joint(metaclass=ClearArgumentErrors):
    """Base of all joints, drawn in joint axes: interface A at the origin, x from A to B, z the intended axis.

    A family is a frozen dataclass with a `family` name that implements the methods below; all lengths are in m, all points
    (3,) in joint axes and undeformed, where every block is parallel to the joint axes. `length` [m]: the length L by which
    its record is made dimensionless. `quantities`: dimension ("length", "angle") of its numeric parameters, for scene files.
    `windows`: leaf springs may cross, one through a window of the other. `held_by_others`: the joint is soft in other
    directions than its intended motions, as a single leaf is in torsion, and the mechanism around it constrains those.

    >>> steel = ksd.Material(E=200 * GPa, nu=0.3)
    >>> joint = ksd.CrossedPivot(
    ...     steel, length=50 * mm, angle=45 * deg, thickness=0.3 * mm, width=15 * mm
    ... )
    >>> isinstance(joint, ksd.Joint), joint.family, round(joint.length_AB / mm, 2)
    (True, 'crossed_pivot', 35.36)
    >>> [motion.name for motion in joint.motions], [leaf.name for leaf in joint.leaves()]
    (['angle'], ['rising', 'falling'])
    """

    family: ClassVar[str]
    quantities: ClassVar[dict[str, str]] = {}
    windows: bool = False
    held_by_others: bool = False
    length: float

    @property
    def pose_B(self) -> Vector:
        """Undeformed position (3,) [m] of interface B."""
        raise NotImplementedError

    @property
    def length_AB(self) -> float:
        """Undeformed distance [m] from interface A to interface B."""
        return float(np.linalg.norm(self.pose_B))

    @property
    def motions(self) -> tuple[Motion, ...]:
        """The intended motions of B relative to A."""
        raise NotImplementedError

    def motion(self, name: str | None = None) -> Motion:
        """The intended motion of this name; None takes the only one. Raises SceneError."""
        motions = self.motions
        if name is None and len(motions) == 1:
            return motions[0]
        for motion in motions:
            if isinstance(name, str) and motion.name == name:
                return motion
        names = ", ".join(repr(m.name) for m in motions)
        raise SceneError(f"{self.family}: motion = {show(name)} must be one of its intended motions {names}.")

    def blocks(self) -> dict[str, Vector]:
        """Reference points (3,) [m] of the rigid blocks by name: "A" and "B", then the internal ones."""
        return {"A": (0.0, 0.0, 0.0), "B": self.pose_B}

    def leaves(self) -> tuple[Leaf, ...]:
        """The leaf springs between the blocks."""
        raise NotImplementedError

    def without_mass(self) -> Joint:
        """The joint of leaf springs without density."""
        raise NotImplementedError

    def shape(self) -> dict[str, float]:
        """Dimensionless shape parameters (angles in rad) on which its record depends, by name."""
        raise NotImplementedError


def joint_leaves(joint: Joint) -> tuple[Leaf, ...]:
    """`joint.leaves()`, cached for equal joints: a mechanism needs them several times, and mostly of the same joint."""
    try:
        return _cached_leaves(joint)
    except TypeError:  # a joint family of the user that is not hashable
        return joint.leaves()


@lru_cache(maxsize=256)
def _cached_leaves(joint: Joint) -> tuple[Leaf, ...]:
    return joint.leaves()


COMPARED_STATIONS = (0.05, 0.2, 0.45, 0.7, 0.95)
"""Fractions of the length at which leaf springs are compared; unevenly spaced, so as not to miss periodic shapes."""


def joint_proportions(joint: Joint) -> dict[str, float]:
    """The dimensionless numbers that describe the drawing of a joint, by name.

    Over the `length` of the joint: positions of blocks and of the ends of leaf springs, and lengths of leaf springs.
    Further the width axes, the bending stiffnesses E Iz over the smallest one, and at `COMPARED_STATIONS` of varying
    leaf springs the same and the undeformed curvatures times the length of the leaf. A record of one drawn joint holds
    for these numbers only.
    """
    leaves, L = joint_leaves(joint), joint.length
    vectors = {f"block {n}": np.divide(point, L) for n, point in enumerate(joint.blocks().values())}
    for n, leaf in enumerate(leaves, 1):
        vectors |= {
            f"start of leaf {n}": np.divide(leaf.start, L),
            f"end of leaf {n}": np.divide(leaf.end, L),
            f"width axis of leaf {n}": leaf.axes[:, 2],
        }
    proportions = {
        f"{name}, {axis}": c
        for name, components in vectors.items()
        for axis, c in zip("xyz", components.tolist(), strict=True)
    }
    EI = [leaf.material.E * leaf.section.Iz for leaf in leaves]
    for n, leaf in enumerate(leaves, 1):
        proportions |= {
            f"length of leaf {n}": leaf.length / L,
            f"bending stiffness of leaf {n}": EI[n - 1] / min(EI),
        }
        curve, profile = leaf.curve, leaf.profile
        curvatures = (
            np.zeros((len(COMPARED_STATIONS), 3))
            if curve is None
            else leaf.length * curve.curvatures(COMPARED_STATIONS)
        )
        for s, curvature in zip(COMPARED_STATIONS, curvatures.tolist(), strict=True):
            section = leaf.section if profile is None else profile.section(s)
            proportions[f"bending stiffness of leaf {n} at {s:g}"] = leaf.material.E * section.Iz / min(EI)
            proportions |= {
                f"curvature of leaf {n} at {s:g}, {axis}": c for axis, c in zip("xyz", curvature, strict=True)
            }
    return proportions


@dataclass(frozen=True, init=False)
class DrawnJoint(Joint):
    """A joint drawn by the user from blocks, leaf springs and intended motions, in joint axes.

    name: its family name, under which a record can be trained. blocks: {"A": point, "B": point, others} (3,) [m], with
    A at the origin and B elsewhere. leaves: its leaf springs; equal names are numbered, "leaf", "leaf.2". motions: its
    intended motions. length [m]: length by which the record is made dimensionless, |AB| when not given. shape: its
    dimensionless shape parameters by name, when it belongs to a range of similar joints. windows: leaf springs may
    cross, one through a window of the other (the window itself is not modelled). held_by_others: the joint is soft in
    other directions than its intended motions, and the mechanism around it constrains those. Raises SceneError when A
    or B is missing, a leaf is on an unknown block, a block is not connected to A, or leaf springs run through each
    other.

    >>> steel, sheet = ksd.Material(E=200 * GPa, nu=0.3), ksd.rectangle(0.3 * mm, 10 * mm)
    >>> leaf = ksd.Leaf(
    ...     start=(0, 0, 0), end=(40 * mm, 0, 0), width_axis="z", section=sheet, material=steel
    ... )
    >>> turn = ksd.Motion("turn", "rotation", "z", (-10 * deg, 10 * deg))
    >>> joint = ksd.DrawnJoint(
    ...     "blade", blocks={"A": (0, 0, 0), "B": (40 * mm, 0, 0)}, leaves=[leaf],
    ...     motions=[turn], held_by_others=True,
    ... )
    >>> pose = ksd.solve(ksd.Mechanism.of_joint(joint), turn=5 * deg)
    >>> print(f"{pose.forces['turn']:.5f} Nm")
    0.00982 Nm
    """

    name: str
    block_points: tuple[tuple[str, Vector], ...]
    drawn_leaves: tuple[Leaf, ...]
    intended: tuple[Motion, ...]
    length: float
    shape_numbers: tuple[tuple[str, float], ...]
    windows: bool
    held_by_others: bool

    def __init__(
        self,
        name: str,
        *,
        blocks: Mapping[str, Any],
        leaves: Sequence[Leaf],
        motions: Sequence[Motion],
        length: float | None = None,
        shape: Mapping[str, float] | None = None,
        windows: bool = False,
        held_by_others: bool = False,
    ) -> None:
        owner = f"joint '{word(name, 'name', owner='DrawnJoint')}'"
        for key, parts, kind in (("blocks", blocks, Mapping), ("shape", shape or {}, Mapping),
                                 ("leaves", leaves, Sequence), ("motions", motions, Sequence)):  # fmt: skip
            if not isinstance(parts, kind):
                how = "{name: value}" if kind is Mapping else "a list"
                raise SceneError(f"{owner}: {key} = {show(parts)} must be {how}.")
        points = {
            word(k, "block name", owner=owner): vector(v, f"block '{k}'", owner=owner, unit="m")
            for k, v in blocks.items()
        }
        _check_blocks(points, leaves, owner)
        windows = boolean(windows, "windows", owner=owner)
        held_by_others = boolean(held_by_others, "held_by_others", owner=owner)
        if not windows:
            check_clear(leaves, owner=owner, advice=_OVERLAP_ADVICE)
        if not motions or not all(isinstance(m, Motion) for m in motions):
            raise SceneError(f"{owner}: motions = {show(motions)} must be at least one Motion.")
        duplicates = [m for k, m in enumerate(motions) if m.name in {other.name for other in motions[:k]}]
        if duplicates:
            raise SceneError(
                f"{owner}: two motions are named '{duplicates[0].name}'; give each a name of its own."
            )
        leaves, named = list(leaves), set[str]()
        for k, leaf in enumerate(leaves):
            own = unused_name(leaf.name, named)
            named.add(own)
            leaves[k] = leaf if own == leaf.name else replace(leaf, name=own)
        given = np.linalg.norm(points["B"]) if length is None else length
        numbers = {k: number(v, f"shape '{k}'", owner=owner) for k, v in (shape or {}).items()}
        self.__dict__.update(
            name=name, block_points=tuple(points.items()), drawn_leaves=tuple(leaves), intended=tuple(motions),
            length=positive(given, "length", owner=owner, unit="m"), shape_numbers=tuple(numbers.items()),
            windows=windows, held_by_others=held_by_others,
        )  # fmt: skip

    def __str__(self) -> str:
        lines = [f"{self.name}: blocks {', '.join(name for name, _ in self.block_points)}"]
        for m in self.intended:
            unit, factor = ("deg", 180.0 / math.pi) if m.kind == "rotation" else ("mm", 1e3)
            low, high = (f"{factor * v:.6g}" for v in m.range)
            lines.append(f"motion {m.name}: {m.kind}, {low} to {high} {unit}")
        lines += [
            f"leaf spring {leaf.name}: {leaf.start_block} to {leaf.end_block}, {1e3 * leaf.length:.6g} mm"
            for leaf in self.drawn_leaves
        ]
        return "\n".join(lines)

    @property
    def family(self) -> str:  # type: ignore[override]
        """The name of the joint."""
        return self.name

    @property
    def pose_B(self) -> Vector:
        return self.blocks()["B"]

    @property
    def motions(self) -> tuple[Motion, ...]:
        return self.intended

    def blocks(self) -> dict[str, Vector]:
        return dict(self.block_points)

    def leaves(self) -> tuple[Leaf, ...]:
        return self.drawn_leaves

    def without_mass(self) -> DrawnJoint:
        made = copy(self)
        leaves = (replace(leaf, material=leaf.material.without_mass()) for leaf in self.drawn_leaves)
        made.__dict__.update(drawn_leaves=tuple(leaves))
        return made

    def shape(self) -> dict[str, float]:
        return dict(self.shape_numbers)


_OVERLAP_ADVICE = "move them apart, or say windows=True where one passes through a window of the other"


def _check_blocks(points: Mapping[str, Vector], leaves: Sequence[Leaf], owner: str) -> None:
    """Check that A and B exist, A at the origin, every leaf is between two known blocks, and all are connected to A.

    points: reference points (3,) [m] of the blocks. Raises SceneError.
    """
    for end in ("A", "B"):
        if end not in points:
            raise SceneError(f"{owner}: block '{end}' is missing; every joint has interface blocks A and B.")
    if any(points["A"]):
        raise SceneError(f"{owner}: block 'A' is at {points['A']} m; interface A is the origin (0, 0, 0).")
    if not leaves or not all(isinstance(leaf, Leaf) for leaf in leaves):
        raise SceneError(f"{owner}: leaves = {show(leaves)} must be at least one Leaf.")
    connected, count = {"A"}, 0
    for leaf in leaves:
        for block in (leaf.start_block, leaf.end_block):
            if block not in points:
                raise SceneError(
                    f"{owner}: leaf '{leaf.name}' hangs on block '{block}'" + name_hint(block, points)
                )
        if leaf.start_block == leaf.end_block:
            raise SceneError(
                f"{owner}: leaf '{leaf.name}' starts and ends on the same block '{leaf.end_block}'."
            )
    while len(connected) > count:
        count = len(connected)
        for leaf in leaves:
            if connected & {leaf.start_block, leaf.end_block}:
                connected |= {leaf.start_block, leaf.end_block}
    for block in points:
        if block not in connected:
            raise SceneError(
                f"{owner}: no chain of leaf springs connects block '{block}' with block 'A'; add a leaf."
            )
