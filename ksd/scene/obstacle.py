"""End stops and cables: parts that act in one sense only, and the contact of surfaces."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass, fields, replace
from itertools import pairwise
from typing import Any

from ksd.checks import Vector, cross, not_negative, number, positive, show, vector, word
from ksd.errors import SceneError
from ksd.scene.drive import GROUND, Drive, DriveTerm, dimension_of
from ksd.scene.shapes import ContactShape


@dataclass(frozen=True)
class Stop:
    """End stops of a sum of drive terms: low <= its value <= high [m or rad]; a limit that is None does not stop.

    softness [m/N or rad/Nm]: how far a stop gives way under a unit force, 0 for a rigid one.
    """

    name: str
    terms: tuple[DriveTerm, ...]
    low: float | None = None
    high: float | None = None
    softness: float = 0.0

    def __post_init__(self) -> None:
        owner = f"stop '{word(self.name, 'name', owner='stop')}'"
        object.__setattr__(self, "terms", Drive(self.name, self.terms).terms)
        for key in ("low", "high"):
            value = getattr(self, key)
            object.__setattr__(
                self, key, None if value is None else number(value, key, owner=owner, unit="m or rad")
            )
        object.__setattr__(
            self, "softness", not_negative(self.softness, "softness", owner=owner, unit="m/N or rad/Nm")
        )
        if self.low is None and self.high is None:
            raise SceneError(f"{owner}: give low=, high= or both, the values of the motion at its ends.")
        check_limits(owner, self.low, self.high)

    @property
    def dimension(self) -> str:
        """Dimension of its limits, see `Drive.dimension`."""
        return dimension_of(self.terms)

    @property
    def limits(self) -> dict[str, float]:
        """Its limits by the names under which a solve takes other values."""
        both = {f"{self.name}.low": self.low, f"{self.name}.high": self.high}
        return {name: value for name, value in both.items() if value is not None}


def check_limits(owner: str, low: float | None, high: float | None) -> None:
    """Raise SceneError where the lower limit is above the upper one."""
    if low is not None and high is not None and low > high:
        raise SceneError(f"{owner}: low = {low:g} is above high = {high:g}; exchange them.")


@dataclass(frozen=True)
class Cable:
    """A cable that pulls only: from a point of a link through points of others, which guide it without friction, to its end.

    points: link and point (3,) [m], global at rest, in order; length [m]: without tension, that at rest when None; stiffness
    [N/m]: of the whole cable, None where it cannot stretch. Its drive, of the same name, winds up a part of it [m].
    """

    name: str
    points: tuple[tuple[str, Vector], ...]
    length: float | None = None
    stiffness: float | None = None

    def __post_init__(self) -> None:
        owner = f"cable '{word(self.name, 'name', owner='cable')}'"
        points = tuple((link, vector(at, "point", owner=owner, unit="m")) for link, at in self.points)
        object.__setattr__(self, "points", points)
        for (_, a), (_, b) in pairwise(points):
            if a == b:
                raise SceneError(
                    f"{owner}: two of its points in order are both at {show(a)}; move one, or leave it out."
                )
        if self.length is not None:
            object.__setattr__(self, "length", positive(self.length, "length", owner=owner, unit="m"))
        if self.stiffness is not None:
            object.__setattr__(
                self, "stiffness", positive(self.stiffness, "stiffness", owner=owner, unit="N/m")
            )
        if self.stiffness is None and self.rest_length > self.free_length * (1.0 + 1e-9):
            raise SceneError(
                f"{owner}: length = {self.free_length:g} m is shorter than its way at rest, {self.rest_length:g} m, and it "
                "cannot stretch; give a longer one, a stiffness=, or wind it up by its drive."
            )

    @property
    def rest_length(self) -> float:
        """Length [m] of its way at rest."""
        places = [at for _, at in self.points]
        return sum(math.dist(a, b) for a, b in pairwise(places))

    @property
    def free_length(self) -> float:
        """Its length [m] without tension."""
        return self.rest_length if self.length is None else self.length

    @property
    def a(self) -> str:
        """Link of its start."""
        return self.points[0][0]

    @property
    def b(self) -> str:
        """Link of its end."""
        return self.points[-1][0]

    @property
    def start(self) -> Vector:
        """Its first point (3,) [m] at rest."""
        return self.points[0][1]

    @property
    def end(self) -> Vector:
        """Its last point (3,) [m] at rest."""
        return self.points[-1][1]

    @property
    def via(self) -> tuple[tuple[str, Vector], ...]:
        """Links and points (3,) [m] at rest between its ends."""
        return self.points[1:-1]


@dataclass(frozen=True)
class Surface:
    """A convex shape on a link: its centre `at` (3,) [m], global at rest, its z along `axis` and its x along `toward`."""

    name: str
    link: str
    shape: ContactShape
    at: Vector
    axis: Vector
    toward: Vector

    @property
    def axes(self) -> tuple[Vector, Vector, Vector]:
        """Its axes x, y and z at rest, global."""
        return self.toward, cross(self.axis, self.toward), self.axis


@dataclass(frozen=True)
class Contact:
    """Two surfaces, by name, that may touch, with Coulomb friction.

    friction: coefficient; softness [m/N]: how far they sink in per force, 0 for rigid ones. One of them may be a leaf.
    """

    name: str
    a: str
    b: str
    friction: float = 0.0
    softness: float = 0.0

    def __post_init__(self) -> None:
        owner = f"contact '{word(self.name, 'name', owner='contact')}'"
        for key in ("friction", "softness"):
            unit = "m/N" if key == "softness" else ""
            object.__setattr__(self, key, not_negative(getattr(self, key), key, owner=owner, unit=unit))


def check_leaf_pair(owner: str, leaf: str, surface: Surface, *, flat: bool, is_round: bool) -> None:
    """Raise SceneError for a surface whose contact along a leaf is not known; flat: in a plane."""
    kind = surface.shape.kind
    if not surface.shape.is_ball and kind != "ellipse":
        raise SceneError(
            f"{owner}: a {kind} and leaf spring '{leaf}' are not known to touch; give its corners by ksd.shapes.point, or a "
            "disc, ball or ellipse, and a wall a point of the leaf (mechanism.point) or its end."
        )
    if is_round and not flat:
        raise SceneError(
            f"{owner}: '{leaf}' is round and has no side in space; touch points of it (mechanism.point) with balls."
        )


def check_pair(owner: str, a: Surface, b: Surface) -> None:
    """Raise SceneError for two surfaces whose contact is not known."""
    kinds = {a.shape.kind, b.shape.kind}
    if a.link == b.link:
        raise SceneError(
            f"{owner}: both surfaces are on link '{a.link}', which cannot touch itself; name two links."
        )
    bodies = {"ellipse", "ellipsoid", "box", "capsule", "polyhedron"}
    known = a.shape.is_ball or b.shape.is_ball or kinds <= {"polygon", "wall"} or kinds - bodies == {"wall"}
    if "polyhedron" in kinds and "wall" not in kinds:
        raise SceneError(
            f"{owner}: a polyhedron touches walls only, and no {min(kinds - {'polyhedron'}, default='other polyhedron')}; "
            "give balls or points a box, capsule or ellipsoid."
        )
    if not known or kinds == {"wall"} or kinds == {"point"}:
        raise SceneError(
            f"{owner}: a {a.shape.kind} and a {b.shape.kind} are not known to touch; one of them must be a disc, ball or "
            "point, or a wall, or they are two polygons."
        )


def contact_drives(scene: Any) -> dict[str, float]:
    """Values that a solve may give besides those of the drives, by name, with those of the scene: limits of stops, and what
    cables are shortened by."""
    stops = {name: value for stop in scene.stops for name, value in stop.limits.items()}
    return stops | {cable.name: 0.0 for cable in scene.cables}


def has_contacts(scene: Any) -> bool:
    """Whether a scene has parts that act in one sense only."""
    return bool(scene.stops or scene.cables or scene.contacts)


PARTS = "stops", "cables", "surfaces", "contacts"
"""Fields of a scene with these parts."""


def without_contacts(scene: Any) -> Any:
    """The scene without them."""
    return replace(scene, **dict.fromkeys(PARTS, ()))


def same_without_contacts(one: Any, other: Any) -> bool:
    """Whether two scenes are the same without them."""
    names = (field.name for field in fields(one) if field.name not in PARTS)
    return all(getattr(one, name) == getattr(other, name) for name in names)


def free_objects(scene: Any) -> list[str]:
    """Links that nothing but contacts holds."""
    held = {link for spring in scene.springs for link in (spring.a, spring.b)}
    held |= {link for drive in scene.drives for t in drive.terms for link in (t.base, t.link)}
    held |= {link for cable in scene.cables for link, _ in cable.points}
    held |= {link for stop in scene.stops for t in stop.terms for link in (t.base, t.link)}
    others = scene.neighbours(hinges=True, supports=True)
    touched = dict.fromkeys(surface.link for surface in scene.surfaces)
    return [link for link in touched if link != GROUND and link not in held and not others[link]]


def refuse_loose(scene: Any, closed: Collection[str]) -> None:
    """Raise SceneError for a free object on which none of the contacts `closed` is."""
    owner = {surface.name: surface.link for surface in scene.surfaces}
    for link in free_objects(scene):
        if not any(link in (owner.get(c.a), owner.get(c.b)) for c in scene.contacts if c.name in closed):
            raise SceneError(
                f"link '{link}' is held by nothing here: no contact on it is closed, and it is on no spring, drive or "
                "support; close its contacts step by step (ksd.walk), or hold it by one of these."
            )


def one_sided_sentences(scene: Any) -> Iterator[str]:
    """A sentence about every stop and cable: what it holds, and by how much it is open at rest."""
    for stop in scene.stops:
        where = f"of '{stop.terms[0].link}'" + (" and others" if len(stop.terms) > 1 else "")
        limits = " and ".join(
            f"at {name.rpartition('.')[2]} = {value:.4g}" for name, value in stop.limits.items()
        )
        yield f"stop '{stop.name}' holds a motion {where} in one sense {limits}; it is counted as no constraint"
    for cable in scene.cables:
        slack = cable.free_length - cable.rest_length
        state = "taut" if slack <= 1e-9 * cable.free_length else f"slack by {1e3 * slack:.4g} mm"
        yield f"cable '{cable.name}' from '{cable.a}' to '{cable.b}' is {state} at rest; it is counted as no constraint"
    for c in scene.contacts:
        yield f"contact '{c.name}' of '{c.a}' and '{c.b}', friction {c.friction:.4g}, is counted as no constraint"


def refuse_contacts(scene: Any) -> None:
    """Raise SceneError for a scene with parts that act in one sense only."""
    if has_contacts(scene):
        kind, part = next(
            (k, p)
            for k, parts in (("stop", scene.stops), ("cable", scene.cables), ("contact", scene.contacts))
            for p in parts
        )
        raise SceneError(
            f"{kind} '{part.name}': stops, cables and contacts are known to ksd.solve, ksd.prepare, ksd.sweep, "
            "ksd.batch, ksd.gradient, ksd.Job and ksd.walk so far, and not to this; leave them out of the scene, or solve "
            "pose by pose."
        )
