"""Sliders of a session: drives, loads and design parameters, with unit, range and the part that can be reached."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ksd.checks import as_vector, show
from ksd.errors import SceneError
from ksd.scene.drive import Drive
from ksd.scene.line_load import LineLoad, Pressure
from ksd.scene.load import Load
from ksd.scene.scene import Scene
from ksd.scene.toml_table import parse_quantity, quantity
from ksd.units import DIMENSIONS, deg

SHOWN = {
    "length": "mm", "angle": "deg", "force": "N", "moment": "Nm", "stiffness": "N/m", "stress": "kPa",
    "moment per length": "Nm/m", "number": "",
}  # fmt: skip
"""Unit of a slider by dimension."""
ANGLE = 30 * deg
"""End of the slider of a rotation that no record limits [rad]."""
LENGTHS = (
    "length",
    "width",
    "thickness",
    "height",
    "radius",
    "diameter",
    "spacing",
    "distance",
    "gap",
    "offset",
)
"""Last words of the names of design parameters that are lengths."""


@dataclass
class Slider:
    """A number that is moved: its name, "drive", "load" or "design", dimension, range and value [SI].

    reached: the part of the range, in SI, that is known to solve; values beyond are refused.
    """

    name: str
    kind: str
    dimension: str
    low: float
    high: float
    value: float
    reached: tuple[float, float] = field(default=(-math.inf, math.inf))

    @property
    def unit(self) -> str:
        """Unit in which it is shown."""
        return SHOWN[self.dimension]

    @property
    def factor(self) -> float:
        """That unit in SI."""
        return DIMENSIONS[self.dimension][self.unit] if self.unit else 1.0

    def read(self, typed: str) -> float:
        """A typed value [SI]: a number in the unit of the slider, or with a unit of its own. Raises SceneError."""
        try:
            return float(typed) * self.factor
        except ValueError:
            return quantity(typed, self.dimension, self.name)

    def moved(self, value: float) -> None:
        """Take a value [SI], beyond the ends too, which then widen. Raises SceneError where it is not finite."""
        if not math.isfinite(value):
            raise SceneError(f"{self.name} = {value}: a number is needed.")
        self.value = value
        if value > self.high:
            self.high = rounded_end(value)
        elif value < self.low:
            self.low = -rounded_end(-value)

    def judged(self, solved: bool, last_good: float) -> None:
        """Narrow or widen the part that can be reached by whether the present value solves."""
        low, high = self.reached
        if solved:
            self.reached = (-math.inf if self.value <= low else low, math.inf if self.value >= high else high)
        elif self.value > last_good:
            self.reached = (low, last_good)
        elif self.value < last_good:
            self.reached = (last_good, high)


def rounded_end(value: float) -> float:
    """The next number above |value| of one digit, or of 1.5 and 2.5."""
    if not value:
        return 1.0
    power = 10.0 ** math.floor(math.log10(abs(value)))
    lead = abs(value) / power
    end = next(n for n in (1, 1.5, 2, 2.5, 3, 4, 5, 6, 8, 10) if n >= lead * (1 - 1e-9)) * power
    return math.copysign(end, value)


def scene_sliders(scene: Scene, targets: Mapping[str, float]) -> list[Slider]:
    """Sliders of the drives and loads of a scene."""
    size = _size(scene)
    sliders = [_drive_slider(scene, d, float(targets.get(d.name, 0.0)), size) for d in scene.drives]
    used = {s.name for s in sliders}
    for load in (*scene.loads, *scene.loads_along):
        size_of, kind = load_size(load)
        if size_of:
            name = load.name if load.name not in used else f"{load.name} (load)"
            end = rounded_end(2 * abs(size_of))
            sliders.append(Slider(name, "load", kind, -end, end, size_of))
    return sliders


def _size(scene: Scene) -> float:
    points = [p for leaf in scene.leaves for p in (leaf.leaf.start, leaf.leaf.end)]
    points += [j.origin for j in scene.joints]
    spread = float(np.ptp(np.array(points), axis=0).max()) if points else 0.0
    longest = max(
        [j.joint.length for j in scene.joints] + [leaf.leaf.length for leaf in scene.leaves], default=0.1
    )
    return max(spread, longest)


def _drive_slider(scene: Scene, drive: Drive, value: float, size: float) -> Slider:
    """A drive; to the ends of the record of the joint that it turns, else half as far again as its value goes."""
    term = drive.terms[0]
    for placed in scene.joints if drive.dimension == "angle" else ():
        motions = [m for m in placed.joint.motions if m.kind == "rotation"]
        if {placed.a, placed.b} == {term.base, term.link} and len(motions) == 1 and len(drive.terms) == 1:
            low, high = motions[0].range
            return Slider(drive.name, "drive", "angle", min(low, value), max(high, value), value)
    usual = {"angle": ANGLE, "length": rounded_end(0.1 * size), "number": 1.0}[drive.dimension]
    end = rounded_end(1.5 * abs(value)) if value else usual
    return Slider(drive.name, "drive", drive.dimension, -end, end, value)


def load_size(load: Load | LineLoad | Pressure) -> tuple[float, str]:
    """The size of a load [N, Nm, N/m, Nm/m or Pa], of its force where it has one, and its dimension; pressure is signed."""
    if isinstance(load, Pressure):
        return load.pressure, "stress"
    force = math.hypot(*load.force)
    if isinstance(load, LineLoad):
        # a force per length has the units of a stiffness
        size = max(force, math.hypot(*load.end_force))
        moment = max(math.hypot(*load.moment), math.hypot(*load.end_moment))
        return (size, "stiffness") if load.has_force else (moment, "moment per length")
    return (force, "force") if force else (math.hypot(*load.moment), "moment")


def with_loads(scene: Scene, sizes: Mapping[str, float]) -> Scene:
    """The scene with loads of other sizes by the name of their slider, along the direction they have."""

    def resized(load: Any) -> Any:
        own, _ = load_size(load)
        size = sizes.get(load.name, sizes.get(f"{load.name} (load)"))
        if size is None or not own or size == own:
            return load
        keys = [
            key
            for key in ("force", "moment", "to", "to_moment", "pressure")
            if getattr(load, key, None) is not None
        ]
        values = {key: np.asarray(getattr(load, key)) * (size / own) for key in keys}
        return replace(load, **{k: as_vector(v) if v.ndim else float(v) for k, v in values.items()})

    changed: dict[str, Any] = {
        key: tuple(map(resized, getattr(scene, key))) for key in ("loads", "line_loads", "pressures")
    }
    same = all(new == getattr(scene, key) for key, new in changed.items())
    return scene if same else replace(scene, **changed)


def design_sliders(design: Callable[..., Any], ranges: Mapping[str, Any]) -> list[Slider]:
    """Sliders of the parameters of a design function from (low, high), numbers in SI or texts with a unit. Raises
    SceneError."""
    import inspect

    known = inspect.signature(design).parameters
    sliders = []
    for name, pair in ranges.items():
        if not isinstance(pair, tuple | list) or len(pair) != 2:
            raise SceneError(
                f"live: {name} = {show(pair)}: give its lowest and highest value, ({name} = (1e-3, 2e-3))."
            )
        if name not in known:
            raise SceneError(
                f"live: the design function has no parameter '{name}'; it has {', '.join(known) or 'none'}."
            )
        parsed = parse_quantity(pair[0]) if isinstance(pair[0], str) else None
        word = name.rpartition("_")[2]
        dimension = (
            parsed[1] if parsed else "length" if word in LENGTHS else "angle" if word == "angle" else "number"
        )
        if dimension not in SHOWN:
            dimension = "number"
        low, high = (quantity(v, dimension, name) if dimension != "number" else float(v) for v in pair)
        if not low < high:
            raise SceneError(f"live: {name} = {show(pair)}: the first number must be below the second.")
        given = known[name].default
        value = (
            float(given) if isinstance(given, int | float) and low <= given <= high else 0.5 * (low + high)
        )
        sliders.append(Slider(name, "design", dimension, low, high, value))
    return sliders
