"""The rigid links of a mechanism, their names and their masses."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from numpy.typing import ArrayLike

from ksd.errors import SceneError, UnknownNameError
from ksd.scene.drive import GROUND, PointMass
from ksd.section.checks import Vector, all_worded, as_given, nearest, show, word


@dataclass(frozen=True)
class Link:
    """A rigid link of a mechanism, known by its name; at (3,) [m]: where it is, of a point of a leaf."""

    name: str
    owner: Links = field(compare=False, repr=False)
    at: Vector | None = field(default=None, compare=False, repr=False)

    def __str__(self) -> str:
        return self.name


def spoken(link: Any) -> str:
    """A link's name for messages and default names."""
    return link.name if isinstance(link, Link) else str(link)


@all_worded
class Links:
    """The links of a mechanism by name; "ground" is always one of them."""

    def __init__(self, name: str) -> None:
        self.name = word(name, "name", owner="Mechanism")
        self.ground = Link(GROUND, self)
        self._links: dict[str, Link] = {GROUND: self.ground}
        self._masses: list[PointMass] = []

    def link(
        self,
        name: str,
        *,
        mass: float | None = None,
        inertia: ArrayLike | None = None,
        at: ArrayLike | None = None,
    ) -> Link:
        """A new rigid link; mass [kg], inertia [kg m^2] and its centre `at` [m] as in `mass`."""
        word(name, "link name", owner=self.name)
        if name in self._links:
            raise SceneError(f"link '{name}' exists already; every link needs its own name.")
        added = Link(name, self)
        if mass is None and inertia is not None:
            raise SceneError(f"link '{name}': inertia is given without mass; give both.")
        self._links[name] = added
        if mass is not None:
            try:
                self.mass(added, mass=mass, inertia=inertia, at=at)
            except SceneError:
                # a refused sentence leaves nothing behind
                del self._links[name]
                raise
        return added

    def links(self, *names: str) -> tuple[Link, ...]:
        """New links, one per name."""
        return tuple(self.link(name) for name in names)

    def _known(self, link: Link | str, owner: str) -> str:
        """The name of a link of this mechanism."""
        if isinstance(link, Link):
            if link.owner is not self:
                raise SceneError(
                    f"{owner}: link '{link.name}' belongs to another mechanism, '{link.owner.name}'."
                )
            return link.name
        if not isinstance(link, str):
            raise SceneError(
                f"{owner}: {show(link)} is not a link; give a link of the mechanism or its name."
            )
        if link not in self._links:
            raise UnknownNameError(
                f"{owner}: link '{link}' does not exist{nearest(link, self._links)}", kind="link", name=link
            )
        return link

    def _spot(self, link: str, at: ArrayLike | None) -> Any:
        """`at` as said; of a point of a leaf, where nothing is said, its own place."""
        return self._links[link].at if at is None else as_given(at)

    def _pair(self, a: Link | str, b: Link | str, owner: str) -> tuple[str, str]:
        first, second = self._known(a, owner), self._known(b, owner)
        if first == second:
            raise SceneError(f"{owner} connects link '{first}' with itself; it needs two different links.")
        return first, second

    def mass(
        self, link: Link | str, *, mass: float, inertia: ArrayLike | None = None, at: ArrayLike | None = None
    ) -> PointMass:
        """A rigid mass [kg]: centre `at` (3,) [m], inertia (3,) or (3, 3) [kg m^2] about it, global axes."""
        known = self._known(link, "mass")
        place = self._spot(known, at)
        if place is None:
            raise SceneError(f"mass on '{known}': 'at' is missing; give its centre (x, y, z) in m.")
        added = PointMass(known, mass, as_given(inertia), place)
        self._masses.append(added)
        return added
