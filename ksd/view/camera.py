"""From where a mechanism is seen: onto a coordinate plane, or from a chosen direction, without perspective."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np

from ksd.errors import SceneError
from ksd.view.figure import Array

View = Literal["xy", "xz", "yz", "3d"] | tuple[float, float]
"""A coordinate plane, "3d", or the direction of the eye: azimuth from x towards y and elevation over the xy plane [deg]."""
PLANES = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
ELEVATION = 24.0
AZIMUTHS = (-60.0, -35.0, -75.0, -120.0, -145.0, 35.0, 60.0, 120.0, 145.0)
"""Tried for "3d", the usual ones first."""
FLAT = 0.3
"""Ratio of the two smaller extents below which a mechanism is flat, and is seen with its broad side upright."""
AHEAD = 1.1
"""How many times better a direction must be to be taken before the usual ones."""


class Camera(NamedTuple):
    """Global directions (3,) to the right, upward and toward the eye; `plane` where it looks onto a coordinate plane."""

    right: Array
    up: Array
    toward: Array
    plane: str | None = None

    def flat(self, points: Array) -> Array:
        """Points (..., 3) [m] in the picture (..., 2) [mm]."""
        seen: Array = 1e3 * (points @ np.stack([self.right, self.up], axis=1))
        return seen


def camera_of(shape: Any, view: View | Camera | None, *, plane: str | None) -> Camera:
    """The camera of a `view`; None: onto `plane` if there is one, "3d" otherwise. SceneError for another view."""
    if isinstance(view, Camera):
        return view
    chosen = view if view is not None else plane or "3d"
    if isinstance(chosen, str) and chosen in PLANES:
        right, up = np.eye(3)[list(PLANES[chosen])]
        return Camera(right, up, np.cross(right, up), chosen)
    if isinstance(chosen, str) and chosen == "3d":
        return _best(shape)
    try:
        azimuth, elevation = (float(v) for v in chosen)
    except (TypeError, ValueError):
        azimuth = elevation = np.nan
    if not np.isfinite([azimuth, elevation]).all():
        raise SceneError(
            f'view = {view!r}: choose "xy", "xz", "yz", "3d", or azimuth and elevation in degrees such as (-60, 24)'
        )
    return _from(azimuth, elevation, np.eye(3))


def _from(azimuth: float, elevation: float, axes: Array) -> Camera:
    """Seen from a direction [deg] told in `axes` (3, 3), rows, the last of which is up."""
    a, e = np.radians([azimuth, elevation])
    toward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return Camera(right @ axes, np.cross(toward, right) @ axes, toward @ axes)


def _best(shape: Any) -> Camera:
    """The direction from which leaf springs and links hide each other least; z is up, y where the mechanism lies flat."""
    places = [leaf.place for leaf in shape.leaves]
    points = np.array([p.mean(axis=0) for p in places] + [b.place.mean(axis=0) for b in shape.blocks])
    spans = np.ptp(np.concatenate(places or [b.place for b in shape.blocks]), axis=0)
    flat = spans[2] < FLAT * np.sort(spans)[1]
    axes = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) if flat else np.eye(3)
    cameras = [_from(azimuth, ELEVATION, axes) for azimuth in AZIMUTHS]
    scores = [_apart(camera.flat(points)) for camera in cameras]
    best = 0
    for k, score in enumerate(scores):
        best = k if score > AHEAD * scores[best] else best
    return cameras[best]


def _apart(points: Array) -> float:
    """How far points (k, 2) are apart: the geometric mean of their distances to the nearest other."""
    gaps = np.linalg.norm(points[:, None] - points, axis=2)
    size = float(gaps.max()) or 1.0
    np.fill_diagonal(gaps, np.inf)
    return float(np.exp(np.log(np.maximum(gaps.min(axis=1), 0.01 * size)).mean())) if len(points) > 1 else 1.0
