"""Drives and supports: prescribed components of the motion of links."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from ksd.checks import Vector, direction, number, show, vector, word
from ksd.errors import SceneError

GROUND = "ground"
"""Name of the link that does not move."""


@dataclass(frozen=True)
class DriveTerm:
    """One component of the motion of `link` relative to `base`, zero in the undeformed configuration.

    kind "translation" [m]: displacement of `point` of the link along `direction`; "rotation" [rad]: rotation about
    `direction`. direction (3,), a unit vector, and point (3,) [m] are global, undeformed; the direction then turns with
    `base`. axis (3,): normal to the direction of a held rotation, where the link turns freely about it, as on a pin. Terms
    can be added and scaled: 2 * a - b is a tuple of terms for `Mechanism.actuate(terms=...)`.
    """

    coefficient: float
    kind: str
    base: str
    link: str
    direction: Vector
    point: Vector
    axis: Vector | None = None

    def __post_init__(self) -> None:
        owner = f"drive term on '{self.link}'"
        if self.kind not in ("translation", "rotation"):
            raise SceneError(f'{owner}: kind = {show(self.kind)} must be "translation" or "rotation".')
        coefficient = number(self.coefficient, "coefficient", owner=owner)
        if coefficient == 0.0:
            raise SceneError(f"{owner}: coefficient = 0 leaves nothing to prescribe; leave the term out.")
        word(self.base, "base", owner=owner)
        word(self.link, "link", owner=owner)
        self.__dict__.update(
            coefficient=coefficient,
            direction=direction(self.direction, "direction", owner=owner),
            point=vector(self.point, "point", owner=owner, unit="m"),
        )
        if self.base == self.link:
            raise SceneError(f"{owner}: it is measured relative to itself; relative_to must be another link.")

    def __mul__(self, factor: float) -> DriveTerm:
        return replace(self, coefficient=self.coefficient * number(factor, "factor", owner="drive term"))

    __rmul__ = __mul__

    def __neg__(self) -> DriveTerm:
        return self * -1.0

    def __add__(self, other: DriveTerm | tuple[DriveTerm, ...]) -> tuple[DriveTerm, ...]:
        return (self, *other) if isinstance(other, tuple) else (self, other)

    def __radd__(self, other: tuple[DriveTerm, ...]) -> tuple[DriveTerm, ...]:
        return (*other, self)

    def __sub__(self, other: DriveTerm) -> tuple[DriveTerm, ...]:
        return (self, -other)


def dimension_of(terms: tuple[DriveTerm, ...]) -> str:
    """Dimension of a sum of terms: "length", "angle", or "number" for terms of both kinds."""
    kinds = {term.kind for term in terms}
    return {"translation": "length", "rotation": "angle"}[kinds.pop()] if len(kinds) == 1 else "number"


@dataclass(frozen=True)
class Drive:
    """A prescribed sum of terms, sum_i coefficient_i * component_i; a support is a drive fixed at zero."""

    name: str
    terms: tuple[DriveTerm, ...]

    def __post_init__(self) -> None:
        word(self.name, "name", owner="drive")
        if not self.terms or not all(isinstance(t, DriveTerm) for t in self.terms):
            raise SceneError(
                f"drive '{self.name}': terms = {show(self.terms)} must be at least one drive term."
            )
        object.__setattr__(self, "terms", tuple(self.terms))

    @property
    def dimension(self) -> str:
        """`dimension_of` its terms."""
        return dimension_of(self.terms)

    def freedom(self) -> tuple[Any, ...]:
        """The prescribed component without its scale, sign and name; equal for two drives of one freedom."""
        components = sorted(_component(t) for t in self.terms)
        first_coefficient = components[0][-1]
        return tuple((*c[:-1], round(c[-1] / first_coefficient, 9)) for c in components)


def _component(term: DriveTerm) -> tuple[Any, ...]:
    """(kind, base, link, direction, point, coefficient), the first non-zero direction component positive."""
    sign = next(1.0 if c > 0 else -1.0 for c in term.direction if abs(c) > 1e-9)
    along = tuple(round(sign * c, 9) + 0.0 for c in term.direction)
    # the rotation of a rigid link is the same at every point of it
    point = tuple(round(c, 12) + 0.0 for c in term.point) if term.kind == "translation" else ()
    return (term.kind, term.base, term.link, along, point, sign * term.coefficient)


def direction_suffix(term: DriveTerm) -> str:
    """x, y, z for a displacement along a global axis, rx, ry, rz for a rotation about one; "" for other directions."""
    for axis, component in zip("xyz", term.direction, strict=True):
        if abs(abs(component) - 1.0) < 1e-9:
            return axis if term.kind == "translation" else f"r{axis}"
    return ""
