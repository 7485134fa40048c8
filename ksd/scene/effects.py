"""What a scene may mention beyond leaf springs, drives and loads: springs, flexible links, heat, assembly error, prestress.

Each is one frozen sentence of the scene; a scene that does not say it has nothing of it. Positions are global at
rest [m], forces N, moments Nm, angles rad, temperatures K above the undeformed configuration.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ksd.checks import (
    ClearArgumentErrors,
    Vector,
    direction,
    name_hint,
    not_negative,
    number,
    positive,
    show,
    vector,
    word,
)
from ksd.errors import SceneError
from ksd.scene.leaf import LeafCondition
from ksd.scene.material import Material
from ksd.section import Section

OPTIONAL_EFFECTS = ("warping", "plate")
"""Effects of the leaf that a scene may ask to be considered; see `ksd.model.effects`."""


@dataclass(frozen=True)
class Distance:
    """What is asked about, not simulated: the distance [m] of point `end` of link `b` from point `start` of link `a`.

    start, end (3,) [m]: global at rest. along (3,): only its component along this direction, which turns with `a`, signed;
    the whole distance when None.
    """

    name: str
    a: str
    b: str
    start: Vector
    end: Vector
    along: Vector | None = None

    def __post_init__(self) -> None:
        owner = f"distance '{word(self.name, 'name', owner='distance')}'"
        for key in ("start", "end"):
            object.__setattr__(self, key, vector(getattr(self, key), key, owner=owner, unit="m"))
        if self.along is not None:
            object.__setattr__(self, "along", direction(self.along, "along", owner=owner))
        elif self.start == self.end:
            raise SceneError(
                f"{owner}: its two points are one and the same at rest, {self.start}; give along= a direction, that in "
                "which they part."
            )


@dataclass(frozen=True)
class Spring:
    """A coil spring between point `start` of link `a` and point `end` of link `b`: pull = stiffness (l - free_length).

    stiffness [N/m]; free_length [m]: 0 is the zero-free-length spring of static balancing. The force acts along
    the line between the two points, wherever they are; it pushes when shorter than its free length.
    """

    name: str
    a: str
    b: str
    start: Vector
    end: Vector
    stiffness: float
    free_length: float

    def __post_init__(self) -> None:
        owner = f"spring '{word(self.name, 'name', owner='spring')}'"
        self.__dict__.update(
            start=vector(self.start, "start", owner=owner, unit="m"),
            end=vector(self.end, "end", owner=owner, unit="m"),
            stiffness=positive(self.stiffness, "stiffness", owner=owner, unit="N/m"),
            free_length=not_negative(self.free_length, "free_length", owner=owner, unit="m"),
        )
        if self.start == self.end and self.free_length > 0.0:
            raise SceneError(
                f"{owner}: its ends coincide at rest, where a spring of free_length = {self.free_length:g} m has no "
                "direction; move an end, or use free_length = 0."
            )


@dataclass(frozen=True)
class TurnSpring:
    """A torsion spring from link `a` to link `b` about `axis` through `at`: moment = stiffness (angle - rest_angle).

    stiffness [Nm/rad]; rest_angle [rad]: rotation of b relative to a at which it is relaxed. The angle is the
    component about `axis`, which turns with a, of the rotation vector of b relative to a; below 180 degrees.
    """

    name: str
    a: str
    b: str
    at: Vector
    axis: Vector
    stiffness: float
    rest_angle: float = 0.0

    def __post_init__(self) -> None:
        owner = f"joint spring '{word(self.name, 'name', owner='joint spring')}'"
        angle = number(self.rest_angle, "rest_angle", owner=owner, unit="rad")
        if not abs(angle) < math.pi:
            raise SceneError(f"{owner}: rest_angle = {show(self.rest_angle)} rad must be below 180 degrees.")
        self.__dict__.update(
            at=vector(self.at, "at", owner=owner, unit="m"),
            axis=direction(self.axis, "axis", owner=owner),
            stiffness=positive(self.stiffness, "stiffness", owner=owner, unit="Nm/rad"),
            rest_angle=angle,
        )


MAX_STIFFNESS = 1e30
"""Stiffness [N/m] beyond which a link matrix is damage: squares and products of it would overflow."""


@dataclass(frozen=True)
class LinkMatrix(metaclass=ClearArgumentErrors):
    """Stiffness of a flexible link between its two interfaces, as a Craig-Bampton reduction gives it.

    points (2, 3) [m]: the interfaces, global at rest; stiffness (12, 12): forces and moments on both interfaces by
    their displacements and rotations in global axes at rest (N/m, N, Nm). Raises SceneError unless it is symmetric,
    has no negative eigenvalue and no force under the six rigid motions (1e-6 of its largest number).
    """

    points: tuple[Vector, Vector]
    stiffness: tuple[tuple[float, ...], ...]

    def __post_init__(self) -> None:
        owner = "link matrix"
        rows = self.points.tolist() if isinstance(self.points, np.ndarray) else self.points
        if not isinstance(rows, tuple | list):
            raise SceneError(
                f"{owner}: points = {show(self.points)} must be its two interfaces (x, y, z) in m."
            )
        if len(rows) != 2:
            raise SceneError(
                f"{owner}: {len(rows)} interfaces are given; a matrix stands for a link with two. Give a link with "
                "more attachments a section instead."
            )
        object.__setattr__(self, "points", tuple(vector(p, "points", owner=owner, unit="m") for p in rows))
        try:
            K = np.asarray(self.stiffness, float)
        except (TypeError, ValueError, OverflowError):
            K = np.zeros(0)
        if K.shape != (12, 12) or not np.all(np.isfinite(K)):
            raise SceneError(f"{owner}: stiffness has shape {K.shape}; 12 x 12 finite numbers are needed.")
        self._check(K, owner)
        object.__setattr__(self, "stiffness", tuple(tuple(float(v) for v in row) for row in 0.5 * (K + K.T)))

    def _check(self, K: np.ndarray, owner: str) -> None:
        arm = np.subtract(self.points[1], self.points[0])
        size = float(np.linalg.norm(arm))
        if size == 0.0:
            raise SceneError(f"{owner}: both interfaces are at {self.points[0]}; they must be apart.")
        # rotations scaled by the distance, so that all numbers are N/m
        scale = np.tile(np.repeat([1.0, 1.0 / size], 3), 2)
        with np.errstate(all="ignore"):
            S = K * np.outer(scale, scale)
        largest = np.abs(S).max()
        if not largest < MAX_STIFFNESS:
            raise SceneError(
                f"{owner}: stiffness holds {largest:.3g} N/m; check its units and the distance {size:.3g} m."
            )
        if not largest > 0.0:
            raise SceneError(f"{owner}: stiffness is zero; leave the matrix out, or check its units.")
        if np.abs(S - S.T).max() > 1e-6 * largest:
            raise SceneError(f"{owner}: stiffness is not symmetric (to 1e-6); check the export.")
        rigid = np.zeros((12, 6))
        rigid[:3, :3] = rigid[6:9, :3] = rigid[3:6, 3:] = rigid[9:, 3:] = np.eye(3)
        x, y, z = arm
        rigid[6:9, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
        left = np.abs(S @ (rigid / scale[:, None]) / np.repeat([1.0, size], 3)).max()
        if left > 1e-6 * largest:
            raise SceneError(
                f"{owner}: rigid motions meet a force ({left / largest:.1e} of its largest stiffness); the matrix must "
                "be that of the free link, in global axes at rest, about the given points."
            )
        if np.linalg.eigvalsh(0.5 * (S + S.T)).min() < -1e-6 * largest:
            raise SceneError(f"{owner}: stiffness has a negative eigenvalue; check its signs.")


@dataclass(frozen=True)
class Compliance:
    """Link `link` is not rigid: a beam of `section` from its hub to every attachment, or a matrix.

    hub (3,) [m]: where the beams meet, and what loads, drives, masses and springs of the link act on; None is the
    mean of the attachments. width_axis (3,): direction of the section's width e3; None takes the axis of the first
    joint on the link.
    """

    link: str
    section: Section | None = None
    material: Material | None = None
    hub: Vector | None = None
    width_axis: Vector | None = None
    matrix: LinkMatrix | None = None

    def __post_init__(self) -> None:
        owner = f"compliance of link '{word(self.link, 'link', owner='compliance')}'"
        beam = self.section is not None or self.material is not None
        if beam == (self.matrix is not None):
            raise SceneError(f"{owner}: give section and material, or a matrix.")
        if beam and not (isinstance(self.section, Section) and isinstance(self.material, Material)):
            raise SceneError(f"{owner}: a section needs its material, and a material its section; give both.")
        if self.matrix is not None and not isinstance(self.matrix, LinkMatrix):
            raise SceneError(f"{owner}: matrix = {show(self.matrix)} must be a LinkMatrix or a file name.")
        if self.hub is not None:
            object.__setattr__(self, "hub", vector(self.hub, "hub", owner=owner, unit="m"))
        if self.width_axis is not None:
            axis = direction(self.width_axis, "width_axis", owner=owner)
            object.__setattr__(self, "width_axis", axis)


@dataclass(frozen=True)
class Heat:
    """Leaf springs warmer than at rest: `temperature` [K] in the mean, `through` [K] warmer at their +e2 face than at -e2.

    leaves: full names ("joint/leaf", or that of a free-form leaf), None is all of them. A leaf free to move grows by
    expansion * temperature of its length and bends about e3 with curvature -expansion * through / thickness.
    """

    temperature: float = 0.0
    through: float = 0.0
    leaves: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        for key in ("temperature", "through"):
            object.__setattr__(self, key, number(getattr(self, key), key, owner="heat", unit="K"))
        if self.leaves is not None:
            object.__setattr__(self, "leaves", tuple(word(n, "leaves", owner="heat") for n in self.leaves))


@dataclass(frozen=True)
class Fit:
    """How a leaf was put in: its natural length, and where its clamp on the end block really is.

    natural_length [m]: length it has when free of stress, None as drawn; shift (3,) [m] and turn (3,) [rad], rotation
    vector: from where end q would be as drawn to where it is clamped, in the leaf's axes e1, e2, e3.
    """

    leaf: str
    natural_length: float | None = None
    shift: Vector = (0.0, 0.0, 0.0)
    turn: Vector = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        owner = f"fit of leaf '{word(self.leaf, 'leaf', owner='fit')}'"
        if self.natural_length is not None:
            length = positive(self.natural_length, "natural_length", owner=owner, unit="m")
            object.__setattr__(self, "natural_length", length)
        for key, unit in (("shift", "m"), ("turn", "rad")):
            object.__setattr__(self, key, vector(getattr(self, key), key, owner=owner, unit=unit))


def leaf_conditions(
    leaves: Mapping[str, Any], heats: tuple[Heat, ...], fits: tuple[Fit, ...]
) -> dict[str, LeafCondition]:
    """What heat and fits make of every leaf (by full name) they touch.

    Raises SceneError for an unknown leaf, a material without expansion, a section without thickness, or a natural
    length that is not within 10 % of the drawn one.
    """
    found: dict[str, LeafCondition] = {}
    for heat in heats:
        for name in leaves if heat.leaves is None else heat.leaves:
            _leaf_of(name, leaves, "heat")
            found[name] = _add_heat(found.get(name, LeafCondition()), leaves[name], heat, name)
    for fit in fits:
        leaf = _leaf_of(fit.leaf, leaves, "fit")
        before = found.get(fit.leaf, LeafCondition())
        stretch = 1.0 if fit.natural_length is None else fit.natural_length / leaf.length
        if not 0.9 < stretch < 1.1:
            raise SceneError(
                f"fit of leaf '{fit.leaf}': natural_length = {fit.natural_length:g} m is more than 10 % off its drawn "
                f"length of {leaf.length:g} m; redraw the leaf."
            )
        found[fit.leaf] = LeafCondition(
            before.stretch * stretch,
            before.bow,
            _add(before.shift, fit.shift),
            _add(before.turn, fit.turn),
        )
    return found


def _add(a: Vector, b: Vector) -> Vector:
    x, y, z = (float(p + q) for p, q in zip(a, b, strict=True))
    return x, y, z


def _leaf_of(name: str, leaves: Mapping[str, Any], what: str) -> Any:
    if name not in leaves:
        raise SceneError(f"{what}: leaf '{name}' does not exist{name_hint(name, leaves)}")
    return leaves[name]


def _add_heat(before: LeafCondition, leaf: Any, heat: Heat, name: str) -> LeafCondition:
    """Stress-free shape of a leaf with heat added to what it had before; raises SceneError."""
    alpha, thickness = leaf.material.expansion, leaf.section.thickness
    if alpha is None:
        said = leaf.material.name or "its material"
        raise SceneError(f"heat: leaf '{name}': {said} has no expansion [1/K]; give Material(expansion=...).")
    if heat.through != 0.0 and not thickness > 0.0:
        raise SceneError(f"heat: leaf '{name}': its section has no thickness, which 'through' needs.")
    bow = -alpha * heat.through / thickness if heat.through != 0.0 else 0.0
    return LeafCondition(
        before.stretch * (1.0 + alpha * heat.temperature), before.bow + bow, before.shift, before.turn
    )
