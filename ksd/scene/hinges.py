"""Pins, sliders, ball joints, cylindrical hinges and the plane of a mechanism, which stand for supports between links.

In a planar mechanism displacements normal to the plane and rotations out of it are fixed; its hinges then
constrain the remaining freedoms only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any

import numpy as np

from ksd.checks import PERPENDICULAR, Vector, direction, dot, made_perpendicular, show, vector, word
from ksd.errors import SceneError
from ksd.scene.drive import GROUND, Drive, DriveTerm

PLANES = {"xy": 2, "xz": 1, "yz": 0}
"""Planes of planar mechanisms, and the index of the global axis normal to each."""
_GLOBAL_AXES = (((1.0, 0.0, 0.0), "x"), ((0.0, 1.0, 0.0), "y"), ((0.0, 0.0, 1.0), "z"))


def check_plane(plane: Any) -> str | None:
    """A key of PLANES, or None. Raises SceneError."""
    if plane is None or (isinstance(plane, str) and plane in PLANES):
        return plane
    raise SceneError(f'plane = {show(plane)} must be "xy", "xz" or "yz".')


def plane_normal(plane: str) -> Vector:
    """Unit normal (3,) of a plane."""
    return _GLOBAL_AXES[PLANES[plane]][0]


@dataclass(frozen=True)
class Hinge:
    """A joint without stiffness between links `a` and `b` at the point `at` (3,) [m], global, undeformed.

    kind "pin": b turns about `axis` (3,) through `at`; "slider": b slides along `axis`, which is fixed in a, without
    turning; "cylindrical": b turns about `axis` and slides along it; "ball": b turns about `at`, axis has no meaning.
    """

    name: str
    kind: str
    a: str
    b: str
    at: Vector
    axis: Vector = (0.0, 0.0, 1.0)

    def __post_init__(self) -> None:
        owner = f"{self.kind} '{word(self.name, 'name', owner=self.kind)}'"
        object.__setattr__(self, "at", vector(self.at, "at", owner=owner, unit="m"))
        what = "along" if self.kind == "slider" else "axis"
        object.__setattr__(self, "axis", direction(self.axis, what, owner=owner))

    def supports(self, plane: str | None) -> tuple[Drive, ...]:
        """The equivalent supports, named "name.x" ... "name.rz"; in a plane, those that the plane does not fix already."""
        across = _perpendicular_directions(self.axis)
        displacements, rotations = {
            "pin": ((*across, (self.axis, "along")), across), "slider": (across, _GLOBAL_AXES),
            "cylindrical": (across, across), "ball": (_GLOBAL_AXES, ()),
        }[self.kind]  # fmt: skip
        normal = np.zeros(3) if plane is None else np.array(plane_normal(plane))
        fixed = [("translation", e, n) for e, n in displacements if abs(float(normal @ e)) < 0.5]
        fixed += [
            ("rotation", e, f"r{n}") for e, n in rotations if plane is None or abs(float(normal @ e)) > 0.5
        ]
        turns = {"translation": None, "rotation": self.axis if self.kind in ("pin", "cylindrical") else None}
        return tuple(
            Drive(f"{self.name}.{n}", (DriveTerm(1.0, kind, self.a, self.b, e, self.at, turns[kind]),))
            for kind, e, n in fixed
        )


@lru_cache(maxsize=256)
def _perpendicular_directions(axis: Vector) -> tuple[tuple[Vector, str], ...]:
    """Two directions perpendicular to an axis, with their names; global axes where these are perpendicular to it."""
    along = np.array(axis)
    directions = [(np.array(e), n) for e, n in _GLOBAL_AXES if abs(float(along @ e)) < 1e-12]
    if not directions:
        one = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
        directions = [(one / np.linalg.norm(one), "u")]
    if len(directions) < 2:
        directions.insert(0, (np.cross(along, directions[0][0]), "across"))
    return tuple((tuple(e.tolist()), n) for e, n in directions)


def check_hinge_in_plane(hinge: Hinge, plane: str | None) -> Hinge:
    """The hinge. Raises SceneError unless a pin is normal to the plane, a slider in it, and a cylindrical hinge either."""
    if plane is None or hinge.kind == "ball":
        return hinge
    normal = plane_normal(plane)
    if hinge.kind == "cylindrical" and parallel(hinge.axis, normal):
        return hinge
    if hinge.kind == "pin" and not parallel(hinge.axis, normal):
        raise SceneError(
            f"pin '{hinge.name}': its axis {show(hinge.axis)} must be normal to the plane {plane}; leave axis out."
        )
    if hinge.kind == "pin":
        return hinge
    what = "along" if hinge.kind == "slider" else "axis"
    along = made_perpendicular(hinge.axis, normal, what, f"{hinge.kind} '{hinge.name}'")
    if along is None:
        raise SceneError(
            f"{hinge.kind} '{hinge.name}': {what} = {show(hinge.axis)} leaves the plane {plane}, in which the mechanism "
            f'lives; give a direction in it, such as {what}="{plane[0]}".'
        )
    return hinge if along == hinge.axis else replace(hinge, axis=along)


def parallel(axis: Vector, to: Vector) -> bool:
    """Whether two unit vectors are parallel, to the six digits that coordinates of files have."""
    return abs(dot(axis, to)) >= 1.0 - 1e-9


def check_drive_in_plane(drive: Drive, plane: str | None, kind: str = "drive") -> Drive:
    """The drive or support. Raises SceneError if one of its terms leaves the plane.

    A support of a motion that the plane fixes already is accepted.
    """
    if plane is None:
        return drive
    normal, terms = plane_normal(plane), []
    for term in drive.terms:
        is_normal, moves = parallel(term.direction, normal), term.kind == "translation"
        fixed_by_plane = is_normal if moves else abs(dot(term.direction, normal)) <= PERPENDICULAR
        if not moves or (kind == "support" and fixed_by_plane):
            within = term.direction if is_normal or (kind == "support" and fixed_by_plane) else None
        else:
            within = made_perpendicular(term.direction, normal, "along", f"{kind} '{drive.name}'")
        if within is None:
            word = "along" if moves else "about"
            raise SceneError(
                f"{kind} '{drive.name}' leaves the plane {plane}, in which the mechanism lives: {word} = "
                f'{show(term.direction)}; give along a direction in it, or about="{_GLOBAL_AXES[PLANES[plane]][1]}".'
            )
        terms.append(term if within == term.direction else replace(term, direction=within))
    return drive if tuple(terms) == drive.terms else replace(drive, terms=tuple(terms))


def plane_supports(scene: Any) -> tuple[Drive, ...]:
    """Supports that keep a scene in its plane: on one link of every group connected by joints, ground's group excepted."""
    if scene.plane is None:
        return ()
    # union-find over the links: each group is represented by one link, ground where it is in it
    parent = {link: link for link in scene.links}

    def representative(link: str) -> str:
        while parent[link] != link:
            link = parent[link]
        return link

    for joint in scene.joints:
        one, two = sorted((representative(joint.a), representative(joint.b)), key=lambda n: n != GROUND)
        parent[two] = one
    points = {p.name for p in scene.points}
    supported = [link for link in scene.links[1:] if parent[link] == link and link not in points]
    return tuple(s for link in supported for s in _link_plane_supports(link, scene.plane))


@lru_cache(maxsize=256)
def _link_plane_supports(link: str, plane: str) -> tuple[Drive, ...]:
    """Supports that keep a link in a plane."""
    across, normal = PLANES[plane], {"translation": None, "rotation": plane_normal(plane)}
    fixed = [("translation", across), *(("rotation", k) for k in range(3) if k != across)]
    return tuple(
        Drive(
            f"{link} in {plane}: {'r' * (kind == 'rotation')}{_GLOBAL_AXES[k][1]}",
            (DriveTerm(1.0, kind, GROUND, link, _GLOBAL_AXES[k][0], (0.0, 0.0, 0.0), normal[kind]),),
        )
        for kind, k in fixed
    )
