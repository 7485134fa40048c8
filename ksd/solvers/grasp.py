"""How a link is held by contacts: its stiffness, and the friction that it needs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ksd.answers.printing import PrintableAnswer, format_number
from ksd.answers.stiffness import PointStiffness
from ksd.errors import SceneError
from ksd.scene.obstacle import Contact
from ksd.scene.scene import Scene
from ksd.solvers.contact_state import ContactPoint


@dataclass(frozen=True, repr=False)
class Grasp(PrintableAnswer):
    """How contacts hold a link: `stiffness` of its point, and the friction that it needs.

    needed: largest |T| / N of its closed contacts, so the coefficient of friction with which it would just hold as it is
    held here; margin: the least coefficient of a contact over its |T| / N, 1 where one slips, inf without friction forces;
    forces (k, 3) [N]: of the contacts on the link, by `names`.
    """

    link: str
    names: tuple[str, ...]
    forces: NDArray[np.float64]
    needed: float
    margin: float
    stiffness: PointStiffness

    def _line(self) -> str:
        least = f"friction {format_number(self.needed)} needed, {format_number(self.margin)} times as much is there"
        return f"'{self.link}' in {len(self.names)} contacts: {least}"

    def __str__(self) -> str:
        return f"{self._line()}\n{self.stiffness}"


def _contact(scene: Scene, point: str) -> Contact:
    """The contact of a scene that a point, of that name or "name, corner", belongs to."""
    return next(c for c in scene.contacts if c.name == point or point.startswith(f"{c.name}, "))


def contacts_on(link: str, scene: Scene, points: Mapping[str, ContactPoint]) -> dict[str, float]:
    """Closed contacts of a link, with 1 where it has the second surface and -1 where the first. Raises SceneError where
    there are none."""
    owner, found = {surface.name: surface.link for surface in scene.surfaces}, {}
    for name, point in points.items():
        contact = _contact(scene, name)
        links = owner.get(contact.a), owner.get(contact.b)
        if link in links and point.N > 0.0:
            found[name] = 1.0 if links[1] == link else -1.0
    if not found:
        raise SceneError(
            f"grasp: no closed contact is on link '{link}'; name a link that is held by contacts here."
        )
    return found


def grasp(
    link: str,
    scene: Scene,
    points: Mapping[str, ContactPoint],
    signs: Mapping[str, float],
    stiffness: PointStiffness,
) -> Grasp:
    """See `Grasp`; signs: of `contacts_on`."""
    needed, margin = 0.0, math.inf
    for name in signs:
        share = float(np.linalg.norm(points[name].T)) / points[name].N
        needed = max(needed, share)
        if share > 0.0:
            margin = min(margin, _contact(scene, name).friction / share)
    forces = np.array([sign * points[name].force for name, sign in signs.items()])
    return Grasp(link, tuple(signs), forces, needed, margin, stiffness)
