"""Optional statements of a scene: springs, elastic links, heat, assembly errors, prestress, and distances to report.

Each is a frozen value, and an effect is simulated only when a scene mentions it. Positions are global and undeformed [m];
forces are in N, moments in Nm, angles in rad, temperatures in K above that of the undeformed configuration.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
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
"""Arguments of `Mechanism.consider`: effects of leaf springs simulated on request, see `ksd.model.chosen_effects`."""


@dataclass(frozen=True)
class Distance:
    """A distance to report: that [m] of point `end` of link `b` from point `start` of link `a`.

    start, end (3,) [m]: global, undeformed. along (3,): report the signed component along this direction of the scene, or of
    link `turns_with`, with which it turns; None for the whole distance.
    """

    name: str
    a: str
    b: str
    start: Vector
    end: Vector
    along: Vector | None = None
    turns_with: str | None = None

    def __post_init__(self) -> None:
        owner = f"distance '{word(self.name, 'name', owner='distance')}'"
        for key in ("start", "end"):
            object.__setattr__(self, key, vector(getattr(self, key), key, owner=owner, unit="m"))
        if self.along is not None:
            object.__setattr__(self, "along", direction(self.along, "along", owner=owner))
        elif self.turns_with is not None:
            raise SceneError(
                f"{owner}: turns_with names the link that a direction turns with; give along= as well."
            )
        if self.along is None and self.start == self.end:
            raise SceneError(
                f"{owner}: its two points are one and the same at rest, {self.start}; give along= a direction, that in "
                "which they part."
            )


@dataclass(frozen=True)
class Spring:
    """A coil spring between point `start` of link `a` and point `end` of link `b`: tension = stiffness (l - free_length).

    stiffness [N/m]; free_length [m]: 0 is the zero-free-length spring of static balancing. The force acts along the line
    between the two points in the deformed configuration, at distance l; it pushes when l is below free_length.
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

    stiffness [Nm/rad]; rest_angle [rad]: rotation of b relative to a without moment, zero as drawn; that of a wound spring
    may be several turns. The angle is the rotation of b about `axis`, which turns with a, with its whole turns as counted
    along the path of the solve.
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
        self.__dict__.update(
            at=vector(self.at, "at", owner=owner, unit="m"),
            axis=direction(self.axis, "axis", owner=owner),
            stiffness=positive(self.stiffness, "stiffness", owner=owner, unit="Nm/rad"),
            rest_angle=angle,
        )


MAX_STIFFNESS = 1e30
"""Limit of the stiffness [N/m] in a link matrix: squares and products of larger numbers overflow."""


@dataclass(frozen=True)
class LinkMatrix(metaclass=ClearArgumentErrors):
    """Stiffness of a flexible link between its two interfaces, as a Craig-Bampton reduction gives it.

    points (2, 3) [m]: the interfaces, global, undeformed; stiffness (12, 12): forces and moments on both interfaces per
    displacement and rotation of them, in global axes, undeformed (N/m, N, Nm). Raises SceneError unless it is symmetric,
    has no negative eigenvalue and gives no force under the six rigid motions (to 1e-6 of its largest number).

    >>> K = np.zeros((12, 12))
    >>> K[np.ix_([0, 6], [0, 6])] = 1e5 * np.array([[1, -1], [-1, 1]])
    >>> rod = ksd.LinkMatrix(((0, 0, 0), (0.1, 0, 0)), K.tolist())
    >>> rod.stiffness[0][0], rod.stiffness[0][6]
    (100000.0, -100000.0)
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
        """Check size, symmetry, rigid motions and eigenvalues of the stiffness K (12, 12). Raises SceneError."""
        arm = np.subtract(self.points[1], self.points[0])
        distance = float(np.linalg.norm(arm))
        if distance == 0.0:
            raise SceneError(f"{owner}: both interfaces are at {self.points[0]}; they must be apart.")
        # rotations scaled by the distance, so that all numbers are in N/m
        scale = np.tile(np.repeat([1.0, 1.0 / distance], 3), 2)
        with np.errstate(all="ignore"):
            S = K * np.outer(scale, scale)
        largest = np.abs(S).max()
        if not largest < MAX_STIFFNESS:
            raise SceneError(
                f"{owner}: stiffness holds {largest:.3g} N/m; check its units and the distance {distance:.3g} m."
            )
        if not largest > 0.0:
            raise SceneError(f"{owner}: stiffness is zero; leave the matrix out, or check its units.")
        if np.abs(S - S.T).max() > 1e-6 * largest:
            raise SceneError(f"{owner}: stiffness is not symmetric (to 1e-6); check the export.")
        rigid = np.zeros((12, 6))
        rigid[:3, :3] = rigid[6:9, :3] = rigid[3:6, 3:] = rigid[9:, 3:] = np.eye(3)
        x, y, z = arm
        rigid[6:9, 3:] = [[0, z, -y], [-z, 0, x], [y, -x, 0]]
        rigid_force = np.abs(S @ (rigid / scale[:, None]) / np.repeat([1.0, distance], 3)).max()
        if rigid_force > 1e-6 * largest:
            raise SceneError(
                f"{owner}: rigid motions meet a force ({rigid_force / largest:.1e} of its largest stiffness); the matrix "
                "must be that of the free link, in global axes at rest, about the given points."
            )
        if np.linalg.eigvalsh(0.5 * (S + S.T)).min() < -1e-6 * largest:
            raise SceneError(f"{owner}: stiffness has a negative eigenvalue; check its signs.")


@dataclass(frozen=True)
class Compliance:
    """Link `link` is elastic: beams of `section` and `material` from its hub to every attachment, or a stiffness matrix.

    hub (3,) [m]: the point where the beams meet and on which loads, drives, masses and springs of the link act; None is the
    mean of the attachments. width_axis (3,): direction of the section's width e3; None takes the axis of the first joint on
    the link.
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
    """Temperature rise of leaf springs: `temperature` [K] in the mean, `through` [K] more at the +e2 than at the -e2 face.

    leaves: full names ("joint/leaf", or that of a free-form leaf), None for all. An unconstrained leaf extends by
    expansion * temperature times its length and bends about e3 with the curvature -expansion * through / thickness.
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
    """Assembly of a leaf: its stress-free length, and the pose error of its clamp on the end block.

    natural_length [m]: stress-free length, None as drawn; shift (3,) [m] and turn (3,) [rad], a rotation vector: from the
    drawn pose of end q to the pose in which it is clamped, in the leaf's axes e1, e2, e3 at its start.
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
    """Conditions by full name of the leaf springs that heats and fits mention.

    leaves: all leaf springs by full name. Raises SceneError for an unknown leaf, a material without expansion, a
    section without thickness, or a natural length that is not within 10 % of the drawn one.
    """
    conditions: dict[str, LeafCondition] = {}
    for heat in heats:
        for name in leaves if heat.leaves is None else heat.leaves:
            _leaf_of(name, leaves, "heat")
            conditions[name] = _add_heat(conditions.get(name, LeafCondition()), leaves[name], heat, name)
    for fit in fits:
        leaf = _leaf_of(fit.leaf, leaves, "fit")
        before = conditions.get(fit.leaf, LeafCondition())
        stretch = 1.0 if fit.natural_length is None else fit.natural_length / leaf.length
        if not 0.9 < stretch < 1.1:
            raise SceneError(
                f"fit of leaf '{fit.leaf}': natural_length = {fit.natural_length:g} m is more than 10 % off its drawn "
                f"length of {leaf.length:g} m; redraw the leaf."
            )
        conditions[fit.leaf] = replace(
            before,
            stretch=before.stretch * stretch,
            shift=_add(before.shift, fit.shift),
            turn=_add(before.turn, fit.turn),
        )
    return conditions


def _add(a: Vector, b: Vector) -> Vector:
    """Sum of two vectors (3,)."""
    x, y, z = (float(p + q) for p, q in zip(a, b, strict=True))
    return x, y, z


def _leaf_of(name: str, leaves: Mapping[str, Any], what: str) -> Any:
    """The leaf of this full name. Raises SceneError, starting with `what`, when it does not exist."""
    if name not in leaves:
        raise SceneError(f"{what}: leaf '{name}' does not exist{name_hint(name, leaves)}")
    return leaves[name]


def _add_heat(before: LeafCondition, leaf: Any, heat: Heat, name: str) -> LeafCondition:
    """The condition of a leaf with the effect of a heat added. Raises SceneError."""
    alpha, thickness = leaf.material.expansion, leaf.section.thickness
    if alpha is None:
        material = leaf.material.name or "its material"
        raise SceneError(
            f"heat: leaf '{name}': {material} has no expansion [1/K]; give Material(expansion=...)."
        )
    if heat.through != 0.0 and not thickness > 0.0:
        raise SceneError(f"heat: leaf '{name}': its section has no thickness, which 'through' needs.")
    curvature = -alpha * heat.through / thickness if heat.through != 0.0 else 0.0
    longer = 1.0 + alpha * heat.temperature
    return replace(
        before,
        stretch=before.stretch * longer,
        expansion=before.expansion * longer,
        natural_curvature=before.natural_curvature + curvature,
    )
