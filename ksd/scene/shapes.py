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

from ksd.checks import positive, show, vector
from ksd.errors import SceneError

Points = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class ContactShape:
    """A convex shape: its kind and its sizes [m], for a polygon its corners in order, anticlockwise."""

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
    def reach(self) -> float:
        """Largest distance [m] of its points from its centre, inf of a wall."""
        if self.kind == "wall":
            return math.inf
        return max((math.hypot(*p) for p in self.points), default=max(self.sizes, default=0.0))


def point() -> ContactShape:
    """A point, such as the corner of a link."""
    return ContactShape("point", (0.0,))


def disc(radius: float) -> ContactShape:
    """A disc of `radius` [m] in a plane."""
    return ContactShape("disc", (positive(radius, "radius", owner="disc", unit="m"),))


def ball(radius: float) -> ContactShape:
    """A ball of `radius` [m]."""
    return ContactShape("ball", (positive(radius, "radius", owner="ball", unit="m"),))


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
