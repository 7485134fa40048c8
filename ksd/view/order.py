"""Polygons in space from back to front: parted by the plane of one of them, again and again, and cut where they cross it."""

from __future__ import annotations

import numpy as np

from ksd.view.bodies import Polygon
from ksd.view.figure import Array

BEHIND, BEFORE, WITHIN, CROSS = range(4)
"""Where a polygon is beside a plane."""
TRIED = 4
"""Faces whose planes are tried for every parting."""
CUT = 4
"""What a cut costs beside a polygon too many on one side."""


def back_to_front(polygons: list[Polygon], toward: Array, *, close: float) -> list[Polygon]:
    """The polygons, cut where they cross planes of others, in the order in which an eye far off at `toward` (3,) sees them,
    the farthest first. close [m]: distance of corners up to which they lie in a plane; lines in it come after its faces."""
    found: list[Polygon] = []
    left: list[tuple[list[Polygon], bool]] = [(polygons, False)]
    while left:
        group, done = left.pop()
        faces = [k for k, p in enumerate(group) if len(p.corners) > 2]
        if done or len(group) < 2 or not faces:
            found += sorted(group, key=lambda p: len(p.corners) == 2)
            continue
        corners = np.concatenate([p.corners for p in group])
        starts = np.cumsum([0, *(len(p.corners) for p in group[:-1])])
        planes = [(*_plane(group[k].corners), k) for k in faces[:: -(-len(faces) // TRIED)]]
        cost, best = np.inf, None
        for plane, far, chosen in planes:
            distance = corners @ plane - far
            low, high = np.minimum.reduceat(distance, starts), np.maximum.reduceat(distance, starts)
            side = np.where(
                low < -close, np.where(high > close, CROSS, BEHIND), np.where(high > close, BEFORE, WITHIN)
            )
            # bent a little, it is not cut by a plane of its own
            side[chosen] = WITHIN
            uneven = abs(int((side == BEFORE).sum()) - int((side == BEHIND).sum()))
            if (now := CUT * int((side == CROSS).sum()) + uneven) < cost:
                cost, best = now, (plane, side, distance)
        assert best is not None
        plane, side, distance = best
        halves: tuple[list[Polygon], ...] = ([], [], [])
        for k, polygon in enumerate(group):
            if side[k] < CROSS:
                halves[side[k]].append(polygon)
                continue
            own = distance[starts[k] : starts[k] + len(polygon.corners)]
            halves[BEHIND].append(polygon._replace(corners=_kept(polygon.corners, -own)))
            halves[BEFORE].append(polygon._replace(corners=_kept(polygon.corners, own)))
        sides = (BEHIND, BEFORE) if plane @ toward > 0.0 else (BEFORE, BEHIND)
        left += [(halves[sides[1]], False), (halves[WITHIN], True), (halves[sides[0]], False)]
    return found


def _plane(corners: Array) -> tuple[Array, float]:
    """Normal (3,) of a polygon, and the distance of its plane from the origin along it."""
    a, b = corners[1] - corners[0], corners[2] - corners[0]
    if len(corners) > 3:
        a, b = corners[2] - corners[0], corners[3] - corners[1]
    normal = np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
    normal /= max(float(np.linalg.norm(normal)), 1e-300)
    return normal, float(normal @ corners.mean(axis=0))


def _kept(corners: Array, distance: Array) -> Array:
    """What of a polygon or line lies where the distance of its corners is positive."""
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
