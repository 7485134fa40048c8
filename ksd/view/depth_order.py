"""Depth order of polygons in space by binary space partitioning: split by a polygon's plane, cut where others cross it."""

from __future__ import annotations

import numpy as np

from ksd.view.bodies import Polygon
from ksd.view.figure import Array

BEHIND, IN_FRONT, IN_PLANE, CROSSING = range(4)
"""Position of a polygon relative to a plane."""
TRIED_PLANES = 4
"""Number of planes tried for every split."""
CUT_COST = 4
"""Cost of a cut relative to one polygon of imbalance between the sides."""


def back_to_front(polygons: list[Polygon], toward: Array, *, close: float) -> list[Polygon]:
    """The polygons, cut where they cross planes of others, in the order in which an eye far off at `toward` (3,) sees them,
    the farthest first. close [m]: distance of corners up to which they lie in a plane; lines in it come after its faces."""
    ordered: list[Polygon] = []
    left: list[tuple[list[Polygon], bool]] = [(polygons, False)]
    while left:
        group, done = left.pop()
        faces = [k for k, p in enumerate(group) if len(p.corners) > 2]
        if done or len(group) < 2 or not faces:
            ordered += sorted(group, key=lambda p: len(p.corners) == 2)
            continue
        corners = np.concatenate([p.corners for p in group])
        starts = np.cumsum([0, *(len(p.corners) for p in group[:-1])])
        planes = [(*_plane(group[k].corners), k) for k in faces[:: -(-len(faces) // TRIED_PLANES)]]
        cost, best = np.inf, None
        for plane, far, chosen in planes:
            distance = corners @ plane - far
            low, high = np.minimum.reduceat(distance, starts), np.maximum.reduceat(distance, starts)
            side = np.where(
                low < -close,
                np.where(high > close, CROSSING, BEHIND),
                np.where(high > close, IN_FRONT, IN_PLANE),
            )
            # a polygon that is not quite flat is not cut by its own plane
            side[chosen] = IN_PLANE
            uneven = abs(int((side == IN_FRONT).sum()) - int((side == BEHIND).sum()))
            if (now := CUT_COST * int((side == CROSSING).sum()) + uneven) < cost:
                cost, best = now, (plane, side, distance)
        assert best is not None
        plane, side, distance = best
        halves: tuple[list[Polygon], ...] = ([], [], [])
        for k, polygon in enumerate(group):
            if side[k] < CROSSING:
                halves[side[k]].append(polygon)
                continue
            own = distance[starts[k] : starts[k] + len(polygon.corners)]
            halves[BEHIND].append(polygon._replace(corners=_positive_side(polygon.corners, -own)))
            halves[IN_FRONT].append(polygon._replace(corners=_positive_side(polygon.corners, own)))
        sides = (BEHIND, IN_FRONT) if plane @ toward > 0.0 else (IN_FRONT, BEHIND)
        left += [(halves[sides[1]], False), (halves[IN_PLANE], True), (halves[sides[0]], False)]
    return ordered


def _plane(corners: Array) -> tuple[Array, float]:
    """Normal (3,) of a polygon, and the distance of its plane from the origin along it."""
    a, b = corners[1] - corners[0], corners[2] - corners[0]
    if len(corners) > 3:
        a, b = corners[2] - corners[0], corners[3] - corners[1]
    normal = np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
    normal /= max(float(np.linalg.norm(normal)), 1e-300)
    return normal, float(normal @ corners.mean(axis=0))


def _positive_side(corners: Array, distance: Array) -> Array:
    """The part of a polygon or line on the side where the distance of its corners to the plane is positive."""
    kept, count = [], len(corners)
    for i in range(count if count > 2 else 1):
        j = (i + 1) % count
        if distance[i] >= 0.0:
            kept.append(corners[i])
        if distance[i] * distance[j] < 0.0:
            share = distance[i] / (distance[i] - distance[j])
            kept.append(corners[i] + share * (corners[j] - corners[i]))
    if count == 2 and distance[1] >= 0.0:
        kept.append(corners[1])
    return np.array(kept)
