"""The axes in which a joint is placed, and names of directions."""

from __future__ import annotations

from typing import Any

import numpy as np

from ksd.checks import cross, direction, dot, show, unit
from ksd.errors import SceneError
from ksd.scene.drive import DriveTerm
from ksd.scene.scene import Matrix


def direction_suffix(term: DriveTerm) -> str:
    """x, y, z for a displacement along an axis, rx, ry, rz for a rotation; empty for other directions."""
    for axis, e in zip("xyz", np.eye(3), strict=True):
        if abs(abs(float(e @ np.asarray(term.direction))) - 1.0) < 1e-9:
            return axis if term.kind == "translation" else f"r{axis}"
    return ""


def joint_rotation(axis: Any, toward: Any, owner: str) -> Matrix:
    """Columns x = toward, y = axis x toward, z = axis, after a check that the two are perpendicular."""
    # plain numbers: a design loop comes by here for every joint, and arrays of three cost ten times as much
    z = direction(axis, "axis", owner=owner)
    x = direction(toward, "toward", owner=owner)
    lean = dot(x, z)
    if abs(lean) > 1e-6:
        raise SceneError(
            f"{owner}: toward = {show(toward)} must be perpendicular to axis = {show(axis)}; "
            f"the angle between them is {np.degrees(np.arccos(np.clip(lean, -1, 1))):.4g} degrees."
        )
    if abs(lean) > 1e-15:
        x = unit(tuple(a - lean * b for a, b in zip(x, z, strict=True)))
    y = cross(z, x)
    # -0.0 becomes 0.0
    return (
        (x[0] + 0.0, y[0] + 0.0, z[0] + 0.0), (x[1] + 0.0, y[1] + 0.0, z[1] + 0.0), (x[2] + 0.0, y[2] + 0.0, z[2] + 0.0),
    )  # fmt: skip
