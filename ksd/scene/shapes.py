"""Convex shapes of surfaces that may touch: `ksd.shapes.disc(radius)` and others, placed by `Mechanism.surface`.

Each is described in axes of its own: its centre at the origin, x along `toward` and z along `axis` of the surface, which in
a plane is its normal. A wall is the half space beyond the plane through `at`, with the outward normal along `axis`.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from ksd.checks import positive, show, vector
from ksd.errors import SceneError

Points = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class ContactShape:
    """A convex shape: its kind and its sizes [m], or its corners, of a polygon in order, anticlockwise."""

    kind: str
    sizes: tuple[float, ...] = ()
    points: Points = ()

    @property
    def is_plane(self) -> bool:
        """Whether it lives in a plane, as a disc does."""
        return self.kind in ("disc", "ellipse", "polygon")

    @property
    def is_ball(self) -> bool:
        """Whether all its points are at one distance from its centre."""
        return self.kind in ("point", "disc", "ball")

    @property
    def tips(self) -> Points:
        """Centres (x, y, z) [m] of the balls, of radius `tip_radius`, that its surface is spanned by: corners, and the ends
        of a capsule; none of other shapes."""
        if self.kind == "box":
            x, y, z = (0.5 * size for size in self.sizes)
            return tuple(
                (i * x, j * y, k * z) for k in (-1, 1) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))
            )
        if self.kind == "capsule":
            return ((0.0, 0.0, -0.5 * self.sizes[1]), (0.0, 0.0, 0.5 * self.sizes[1]))
        return tuple((*corner, 0.0)[:3] for corner in self.points)

    @property
    def tip_radius(self) -> float:
        """Radius [m] of its `tips`."""
        return self.sizes[0] if self.kind == "capsule" else 0.0


def point() -> ContactShape:
    """A point, such as the corner of a link."""
    return ContactShape("point", (0.0,))


def disc(radius: float) -> ContactShape:
    """A disc of `radius` [m] in a plane."""
    return ContactShape("disc", (positive(radius, "radius", owner="disc", unit="m"),))


def ball(radius: float) -> ContactShape:
    """A ball of `radius` [m]."""
    return ContactShape("ball", (positive(radius, "radius", owner="ball", unit="m"),))


def box(x: float, y: float, z: float) -> ContactShape:
    """A box of the sizes x, y, z [m] along its axes."""
    sizes = zip("xyz", (x, y, z), strict=True)
    return ContactShape("box", tuple(positive(v, n, owner="box", unit="m") for n, v in sizes))


def capsule(radius: float, length: float) -> ContactShape:
    """A capsule: all within `radius` [m] of a line of `length` [m] along its z."""
    sizes = (("radius", radius), ("length", length))
    return ContactShape("capsule", tuple(positive(v, n, owner="capsule", unit="m") for n, v in sizes))


def ellipsoid(a: float, b: float, c: float) -> ContactShape:
    """An ellipsoid with the semi-axes a, b, c [m] along its axes."""
    sizes = zip("abc", (a, b, c), strict=True)
    return ContactShape("ellipsoid", tuple(positive(v, n, owner="ellipsoid", unit="m") for n, v in sizes))


def wall() -> ContactShape:
    """The half space beyond a plane."""
    return ContactShape("wall")


def ellipse(a: float, b: float) -> ContactShape:
    """An ellipse in a plane with the semi-axes a [m] along `toward` and b [m]."""
    return ContactShape(
        "ellipse", tuple(positive(v, n, owner="ellipse", unit="m") for v, n in ((a, "a"), (b, "b")))
    )


def polygon(points: Iterable[Any]) -> ContactShape:
    """A convex polygon in a plane by its corners (x, y) [m], anticlockwise. Raises SceneError for another one."""
    given = points.tolist() if hasattr(points, "tolist") else points
    if not isinstance(given, list | tuple) or len(given) < 3:
        raise SceneError(f"polygon: points = {show(given)} must be at least three corners (x, y) in m.")
    corners = tuple(vector((*p, 0.0), "corner", owner="polygon", unit="m")[:2] for p in given)
    turns = []
    for (a, b), (_, c) in pairwise([*pairwise((*corners, corners[0])), (corners[0], corners[1])]):
        turns.append((b[0] - a[0]) * (c[1] - b[1]) - (b[1] - a[1]) * (c[0] - b[0]))
    size = max(math.dist(p, q) for p in corners for q in corners)
    area = 0.5 * sum(p[0] * q[1] - p[1] * q[0] for p, q in pairwise((*corners, corners[0])))
    if abs(area) <= 1e-12 * size**2:
        raise SceneError(f"polygon: points = {show(given)} enclose no area; give the corners of a polygon.")
    if area < 0.0:
        raise SceneError(
            f"polygon: points = {show(given)} go clockwise, so it is inside out; reverse their order."
        )
    if min(turns) <= 0.0:
        raise SceneError(
            f"polygon: points = {show(given)} are no convex polygon; leave out corners that point inwards, or make several."
        )
    return ContactShape("polygon", (), corners)


def polyhedron(points: Iterable[Any]) -> ContactShape:
    """The smallest convex body around points (x, y, z) [m], which walls touch at its corners.

    Raises SceneError for points that enclose no volume.
    """
    given = points.tolist() if hasattr(points, "tolist") else points
    if not isinstance(given, list | tuple) or len(given) < 4:
        raise SceneError(f"polyhedron: points = {show(given)} must be at least four points (x, y, z) in m.")
    own = tuple(vector(p, "point", owner="polyhedron", unit="m") for p in given)
    if np.linalg.matrix_rank(np.array(own) - own[0], tol=1e-9 * np.ptp(own)) < 3:
        raise SceneError(f"polyhedron: points = {show(given)} enclose no volume; give the corners of a body.")
    return ContactShape("polyhedron", (), own)
