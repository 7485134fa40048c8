"""Sensors and dampers: components of relative motion that are observed, or resisted in proportion to their speed.

Both are small-motion statements about a pose (`ksd.answers`): no static answer depends on them.
"""

from __future__ import annotations

from dataclasses import dataclass

from ksd.checks import positive, show, word
from ksd.errors import SceneError
from ksd.scene.drive import GROUND, DriveTerm

KINDS = {"displacement": 0, "rotation": 0, "velocity": 1, "acceleration": 2}
"""Kinds of sensors, and the number of time derivatives in each; velocities and accelerations are of displacements or of
rotations."""


@dataclass(frozen=True)
class Sensor:
    """An observed component of motion: of a point along a direction [m], or a rotation about one [rad], or its rate [/s] or
    acceleration [/s^2].

    term: the component, relative to ground or to another link, in whose axes its direction is fixed; kind: a key of KINDS.
    absolute: measured in space, not relative to a ground that may shake.
    """

    name: str
    term: DriveTerm
    kind: str
    absolute: bool = False

    def __post_init__(self) -> None:
        owner = f"sensor '{word(self.name, 'name', owner='sensor')}'"
        if self.kind not in KINDS:
            raise SceneError(f"{owner}: kind = {show(self.kind)} must be one of {', '.join(KINDS)}.")
        if (self.term.kind, self.kind) in (("translation", "rotation"), ("rotation", "displacement")):
            way = "about" if self.kind == "rotation" else "along"
            raise SceneError(f"{owner}: a {self.kind} is measured {way} a direction; give {way}=.")
        if self.absolute and self.term.base != GROUND:
            raise SceneError(f"{owner}: it is relative to '{self.term.base}', and cannot be absolute, too.")

    @property
    def unit(self) -> str:
        """SI unit of what it reads."""
        plain = "m" if self.term.kind == "translation" else "rad"
        return plain + ("", "/s", "/s^2")[KINDS[self.kind]]


@dataclass(frozen=True)
class Damper:
    """A dashpot: force = damping times the rate of a component of motion of one link relative to another.

    damping [N s/m, or Nm s/rad for a rotation]: positive.
    """

    name: str
    term: DriveTerm
    damping: float

    def __post_init__(self) -> None:
        owner = f"damper '{word(self.name, 'name', owner='damper')}'"
        unit = "N s/m" if self.term.kind == "translation" else "Nm s/rad"
        object.__setattr__(self, "damping", positive(self.damping, "damping", owner=owner, unit=unit))
