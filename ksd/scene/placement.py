"""Axes of placed joints, and suffixes for the names of drives."""

from __future__ import annotations

from typing import Any

import numpy as np

from ksd.checks import cross, direction, dot, show, unit
from ksd.errors import SceneError
from ksd.scene.drive import DriveTerm
from ksd.scene.scene import Matrix


def direction_suffix(term: DriveTerm) -> str:
    """x, y, z for a displacement along a global axis, rx, ry, rz for a rotation about one; "" for other directions."""
    for axis, e in zip("xyz", np.eye(3), strict=True):
        if abs(abs(float(e @ np.asarray(term.direction))) - 1.0) < 1e-9:
            return axis if term.kind == "translation" else f"r{axis}"
    return ""


def joint_rotation(axis: Any, toward: Any, owner: str) -> Matrix:
    """Rotation matrix (3, 3) with columns x = toward, y = axis x toward, z = axis.

    Raises SceneError unless axis and toward are perpendicular.
    """
    # in plain numbers: a design loop calls this for every joint, and arrays of three cost ten times as much
    z = direction(axis, "axis", owner=owner)
    x = direction(toward, "toward", owner=owner)
    cosine = dot(x, z)
    if abs(cosine) > 1e-6:
        raise SceneError(
            f"{owner}: toward = {show(toward)} must be perpendicular to axis = {show(axis)}; "
            f"the angle between them is {np.degrees(np.arccos(np.clip(cosine, -1, 1))):.4g} degrees."
        )
    if abs(cosine) > 1e-15:
        x = unit(tuple(a - cosine * b for a, b in zip(x, z, strict=True)))
    y = cross(z, x)
    # -0.0 becomes 0.0
    return (
        (x[0] + 0.0, y[0] + 0.0, z[0] + 0.0), (x[1] + 0.0, y[1] + 0.0, z[1] + 0.0), (x[2] + 0.0, y[2] + 0.0, z[2] + 0.0),
    )  # fmt: skip
