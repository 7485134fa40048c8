"""Viewing direction of a picture: onto a coordinate plane, or from a chosen direction, without perspective."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from ksd.answers.shape import Shape
from ksd.errors import SceneError
from ksd.view.figure import Array

View = Literal["xy", "xz", "yz", "3d"] | tuple[float, float]
"""A coordinate plane, "3d", or the direction of the eye: azimuth from x towards y and elevation over the xy plane [deg]."""
PLANES = {"xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
ELEVATION = 24.0
AZIMUTHS = (-60.0, -35.0, -75.0, -120.0, -145.0, 35.0, 60.0, 120.0, 145.0)
"""Azimuths tried for "3d" [deg], in order of preference."""
FLAT_RATIO = 0.3
"""Extent along z over the middle extent below which a mechanism lies flat and is shown with y up."""
PREFERENCE_FACTOR = 1.1
"""Factor by which a direction must score better to be taken instead of a preferred one."""


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


def camera_of(shape: Shape, view: View | Camera | None, *, plane: str | None) -> Camera:
    """The camera of a `view`; None: onto `plane` if there is one, "3d" otherwise. SceneError for another view."""
    if isinstance(view, Camera):
        return view
    chosen = view if view is not None else plane or "3d"
    if isinstance(chosen, str) and chosen in PLANES:
        right, up = np.eye(3)[list(PLANES[chosen])]
        return Camera(right, up, np.cross(right, up), chosen)
    if isinstance(chosen, str) and chosen == "3d":
        return _clearest_camera(shape)
    try:
        azimuth, elevation = (float(v) for v in chosen)
    except (TypeError, ValueError):
        azimuth = elevation = np.nan
    if not np.isfinite([azimuth, elevation]).all():
        raise SceneError(
            f'view = {view!r}: choose "xy", "xz", "yz", "3d", or azimuth and elevation in degrees such as (-60, 24)'
        )
    return _camera_at(azimuth, elevation, np.eye(3))


def _camera_at(azimuth: float, elevation: float, axes: Array) -> Camera:
    """Camera at an azimuth and elevation [deg] in the frame `axes` (3, 3) of row vectors, the last of which is up."""
    a, e = np.radians([azimuth, elevation])
    toward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return Camera(right @ axes, np.cross(toward, right) @ axes, toward @ axes)


def _clearest_camera(shape: Shape) -> Camera:
    """The direction from which leaf springs and links hide each other least; z is up, y where the mechanism lies flat."""
    places = [leaf.place for leaf in shape.leaves]
    points = np.array([p.mean(axis=0) for p in places] + [b.place.mean(axis=0) for b in shape.blocks])
    spans = np.ptp(np.concatenate(places or [b.place for b in shape.blocks]), axis=0)
    flat = spans[2] < FLAT_RATIO * np.sort(spans)[1]
    axes = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]) if flat else np.eye(3)
    cameras = [_camera_at(azimuth, ELEVATION, axes) for azimuth in AZIMUTHS]
    scores = [_mean_separation(camera.flat(points)) for camera in cameras]
    best = 0
    for k, score in enumerate(scores):
        best = k if score > PREFERENCE_FACTOR * scores[best] else best
    return cameras[best]


def _mean_separation(points: Array) -> float:
    """Geometric mean of the distances of points (k, 2) to their nearest neighbours."""
    gaps = np.linalg.norm(points[:, None] - points, axis=2)
    size = float(gaps.max()) or 1.0
    np.fill_diagonal(gaps, np.inf)
    return float(np.exp(np.log(np.maximum(gaps.min(axis=1), 0.01 * size)).mean())) if len(points) > 1 else 1.0
