"""Pins, sliders and the plane of a mechanism: sugar for supports between links, kept by name so that they can be drawn.

A mechanism with a plane lives in it: displacements across it and rotations out of it are held, and its pins and sliders hold
what is left in the plane alone.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from ksd.checks import Vector, direction, show, vector, word
from ksd.errors import SceneError
from ksd.scene.drive import GROUND, Drive, DriveTerm

PLANES = {"xy": 2, "xz": 1, "yz": 0}
"""Planes a mechanism can live in, and the axis across each."""
_GLOBAL_AXES = (((1.0, 0.0, 0.0), "x"), ((0.0, 1.0, 0.0), "y"), ((0.0, 0.0, 1.0), "z"))


def check_plane(plane: Any) -> str | None:
    """A word of PLANES, or None. Raises SceneError."""
    if plane is None or (isinstance(plane, str) and plane in PLANES):
        return plane
    raise SceneError(f'plane = {show(plane)} must be "xy", "xz" or "yz".')


def plane_normal(plane: str) -> Vector:
    """Unit vector (3,) across a plane."""
    return _GLOBAL_AXES[PLANES[plane]][0]


@dataclass(frozen=True)
class Hinge:
    """A joint without stiffness of link `b` on link `a`, at `at` (3,) [m], global at rest.

    kind "pin": b turns about `axis` (3,) through `at`; "slider": b slides along `axis`, fixed in a, and does not turn.
    """

    name: str
    kind: str
    a: str
    b: str
    at: Vector
    axis: Vector

    def __post_init__(self) -> None:
        owner = f"{self.kind} '{word(self.name, 'name', owner=self.kind)}'"
        object.__setattr__(self, "at", vector(self.at, "at", owner=owner, unit="m"))
        what = "axis" if self.kind == "pin" else "along"
        object.__setattr__(self, "axis", direction(self.axis, what, owner=owner))

    def supports(self, plane: str | None) -> tuple[Drive, ...]:
        """The supports it stands for, "name.x" ... "name.rz"; those of a mechanism that lives in `plane`."""
        across = _perpendicular_directions(self.axis)
        moves, turns = (
            ([*across, (self.axis, "along")], across) if self.kind == "pin" else (across, _GLOBAL_AXES)
        )
        normal = np.zeros(3) if plane is None else np.array(plane_normal(plane))
        held = [("translation", e, n) for e, n in moves if abs(float(normal @ e)) < 0.5]
        held += [("rotation", e, f"r{n}") for e, n in turns if plane is None or abs(float(normal @ e)) > 0.5]
        return tuple(
            Drive(f"{self.name}.{n}", (DriveTerm(1.0, kind, self.a, self.b, e, self.at),))
            for kind, e, n in held
        )


@lru_cache(maxsize=256)
def _perpendicular_directions(axis: Vector) -> tuple[tuple[Vector, str], ...]:
    """Two directions across an axis with their names: global axes where they are across it."""
    way = np.array(axis)
    found = [(np.array(e), n) for e, n in _GLOBAL_AXES if abs(float(way @ e)) < 1e-12]
    if not found:
        one = np.cross(way, np.eye(3)[int(np.argmin(np.abs(way)))])
        found = [(one / np.linalg.norm(one), "u")]
    if len(found) < 2:
        found.insert(0, (np.cross(way, found[0][0]), "across"))
    return tuple((tuple(e.tolist()), n) for e, n in found)


def check_hinge_in_plane(hinge: Hinge, plane: str | None) -> Hinge:
    """The hinge, its axis seen to fit the plane. Raises SceneError."""
    if plane is None:
        return hinge
    lean = abs(float(np.dot(hinge.axis, plane_normal(plane))))
    if hinge.kind == "pin" and lean < 1.0 - 1e-9:
        raise SceneError(
            f"pin '{hinge.name}': its axis {show(hinge.axis)} must be across the plane {plane}; leave axis out."
        )
    if hinge.kind == "slider" and lean > 1e-9:
        raise SceneError(
            f"slider '{hinge.name}': along = {show(hinge.axis)} leaves the plane {plane}, in which the mechanism lives; "
            f'give a direction in it, such as along="{plane[0]}".'
        )
    return hinge


def check_drive_in_plane(drive: Drive, plane: str | None, kind: str = "drive") -> Drive:
    """The drive or support, seen to be of the plane in all of its terms. Raises SceneError."""
    for term in drive.terms if plane else ():
        lean = abs(float(np.dot(term.direction, plane_normal(str(plane)))))
        held = lean > 1.0 - 1e-9 if term.kind == "translation" else lean < 1e-9
        if kind == "support" and held:
            # the plane holds it already
            continue
        if lean > 1e-9 if term.kind == "translation" else lean < 1.0 - 1e-9:
            word = "along" if term.kind == "translation" else "about"
            raise SceneError(
                f"{kind} '{drive.name}' leaves the plane {plane}, in which the mechanism lives: {word} = "
                f'{show(term.direction)}; give along a direction in it, or about="{_GLOBAL_AXES[PLANES[str(plane)]][1]}".'
            )
    return drive


def plane_supports(scene: Any) -> tuple[Drive, ...]:
    """Supports that hold a scene in its plane: one link of every group that joints tie together, none of ground's."""
    if scene.plane is None:
        return ()
    group = {link: link for link in scene.links}

    def head(link: str) -> str:
        while group[link] != link:
            link = group[link]
        return link

    for joint in scene.joints:
        one, two = sorted((head(joint.a), head(joint.b)), key=lambda n: n != GROUND)
        group[two] = one
    points = {p.name for p in scene.points}
    loose = [link for link in scene.links[1:] if group[link] == link and link not in points]
    return tuple(hold for link in loose for hold in _link_plane_supports(link, scene.plane))


@lru_cache(maxsize=256)
def _link_plane_supports(link: str, plane: str) -> tuple[Drive, ...]:
    """Supports that hold a link in a plane."""
    across = PLANES[plane]
    held = [("translation", across), *(("rotation", k) for k in range(3) if k != across)]
    return tuple(
        Drive(
            f"{link} in {plane}: {'r' * (kind == 'rotation')}{_GLOBAL_AXES[k][1]}",
            (DriveTerm(1.0, kind, GROUND, link, _GLOBAL_AXES[k][0], (0.0, 0.0, 0.0)),),
        )
        for kind, k in held
    )
