"""Loads and point masses on the links of a mechanism."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ksd.checks import Vector, boolean, number, show, vector, word
from ksd.errors import SceneError
from ksd.scene.drive import GROUND


@dataclass(frozen=True)
class Load:
    """Force (3,) [N] at point `at` (3,) [m] of a link and moment (3,) [Nm], in global axes, undeformed.

    A dead load keeps its direction in space, a following one turns with the link; the point moves with the link.
    """

    name: str
    link: str
    force: Vector
    moment: Vector
    at: Vector
    following: bool = False

    def __post_init__(self) -> None:
        owner = f"load '{word(self.name, 'name', owner='load')}'"
        if self.link == GROUND:
            raise SceneError(f"{owner}: it acts on the ground, which does not move; name another link.")
        for key, unit in {"force": "N", "moment": "Nm", "at": "m"}.items():
            object.__setattr__(self, key, vector(getattr(self, key), key, owner=owner, unit=unit))
        object.__setattr__(self, "following", boolean(self.following, "following", owner=owner))


@dataclass(frozen=True)
class PointMass:
    """A rigid mass [kg] on a link: centre `at` (3,) [m], inertia (3, 3) [kg m^2] about it, in global axes, undeformed."""

    link: str
    mass: float
    inertia: tuple[Vector, Vector, Vector]
    at: Vector

    def __post_init__(self) -> None:
        owner = f"mass on '{self.link}'"
        mass = number(self.mass, "mass", owner=owner, unit="kg")
        if mass < 0.0:
            raise SceneError(f"{owner}: mass = {mass:g} kg must be zero or positive.")
        at = vector(self.at, "at", owner=owner, unit="m")
        self.__dict__.update(mass=mass, at=at, inertia=_inertia(self.inertia, owner))


def _inertia(value: Any, owner: str) -> tuple[Vector, Vector, Vector]:
    """Inertia matrix (3, 3) [kg m^2] from None (zero), three moments or a matrix.

    Raises SceneError unless it is symmetric without negative moments on its diagonal.
    """
    if value is None:
        value = (0.0, 0.0, 0.0)
    rows = value.tolist() if hasattr(value, "tolist") else value
    if not isinstance(rows, list | tuple) or len(rows) != 3:
        raise SceneError(
            f"{owner}: inertia = {show(value)} must be three moments or a 3 x 3 matrix in kg m^2."
        )
    if not any(isinstance(row, list | tuple) for row in rows):
        a, b, c = vector(rows, "inertia", owner=owner, unit="kg m^2")
        rows = ((a, 0.0, 0.0), (0.0, b, 0.0), (0.0, 0.0, c))
    matrix = tuple(vector(row, "inertia", owner=owner, unit="kg m^2") for row in rows)
    largest = max(abs(c) for row in matrix for c in row)
    skew = max(abs(matrix[i][j] - matrix[j][i]) for i in range(3) for j in range(3))
    if skew > 1e-9 * largest or min(matrix[i][i] for i in range(3)) < 0.0:
        raise SceneError(
            f"{owner}: inertia = {show(value)} must be symmetric without negative moments on its diagonal."
        )
    return matrix[0], matrix[1], matrix[2]
