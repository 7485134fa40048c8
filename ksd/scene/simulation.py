"""What a motion in time is asked for: how long, how exactly, and what drives, loads and the base do meanwhile."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ksd.checks import (
    Vector,
    between,
    boolean,
    direction,
    name_hint,
    not_negative,
    positive,
    show,
    vector,
    whole_number,
    word,
)
from ksd.errors import SceneError
from ksd.scene.drive import GROUND
from ksd.scene.formula import si_value
from ksd.scene.functions_of_time import (
    FunctionOfTime,
    Ramp,
    Sum,
    TimeTable,
    as_function_of_time,
    function_of_table,
    refuse_change,
    table_of_function,
)
from ksd.scene.sensor import KINDS
from ksd.scene.toml_table import quantity
from ksd.units import DIMENSIONS

METHODS = ("generalised_alpha",)
STARTS = ("equilibrium", "undeformed")
DEFAULT_ACCURACY = 1e-3
"""Error of places, relative to the largest stroke, where neither it nor a step is given."""
MAX_HISTORY_BYTES = 4 << 30
"""Largest history that is kept [bytes]."""
POSITION_TOLERANCE = 1e-9
"""Difference of a drive from its pose at the start, relative to the larger of its stroke and value, that is rounding."""


@dataclass(frozen=True)
class Shake:
    """Motion of the base: its acceleration along a direction, a function of time [m/s^2]; at rest before.

    Places and speeds of the answer are relative to the base.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> history = ksd.simulate(
    ...     guide, until="20 ms", dt="0.5 ms", drives={"table": None},
    ...     base=ksd.Shake("x", ksd.HalfSine(20.0, duration=10e-3)),
    ... )
    >>> print(f"back by {-min(history.drives['table'].value) / mm:.2f} mm")
    back by 1.76 mm
    """

    along: Any
    acceleration: Any

    def __post_init__(self) -> None:
        object.__setattr__(self, "along", direction(self.along, "along", owner="Shake"))
        function = as_function_of_time(self.acceleration, "acceleration of the base")
        object.__setattr__(self, "acceleration", function)


@dataclass(frozen=True)
class Event:
    """The end of a motion: when a drive or a sensor rises above, or falls below, a value (SI, or text with a unit).

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> history = ksd.simulate(
    ...     guide, until="20 ms", dt="0.5 ms", drives={"table": ksd.Ramp(20e-3, end=5 * mm)},
    ...     stop=ksd.Event("table", above="2 mm"),
    ... )
    >>> print(history.stop)
    event: 'table' above 0.002 at t = 0.0087... s
    """

    of: str
    above: Any = None
    below: Any = None

    def __post_init__(self) -> None:
        owner = f"event of '{word(self.of, 'of', owner='Event')}'"
        if (self.above is None) == (self.below is None):
            raise SceneError(f"{owner}: give one of above= and below=")
        for key in ("above", "below"):
            if getattr(self, key) is not None:
                object.__setattr__(self, key, si_value(getattr(self, key), f"{owner}: {key}"))

    @property
    def limit(self) -> float:
        """The value that is crossed."""
        return float(self.below if self.above is None else self.above)

    def excess(self, value: float) -> float:
        """How far a value is beyond the limit; negative before the event."""
        return value - self.limit if self.below is None else self.limit - value

    def __str__(self) -> str:
        return f"'{self.of}' {'above' if self.below is None else 'below'} {self.limit:g}"


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """Words of `ksd.simulate`, checked as far as that is possible without the mechanism.

    until, dt [s]; accuracy: relative, where no dt is given; drives: functions of time by name, None for one that is let go
    (in files { let_go = true });
    loads: factors by name; base; start: "equilibrium", "undeformed" or a pose; speeds (6,): of the centre of mass of a
    link, and of its rotation [m/s, rad/s], by name; stop: events that end the motion; damping_at [Hz]: frequency at which
    dashpots in the material take its loss factor; release: a `Ramp` from 1 to 0, factor on the force of drives that are let
    go, given as its duration [s], None where it is gone at once; every: so many steps are made for each that is kept;
    mass_at_ends: leaf springs have their mass at their ends, faster by what their own inertia costs.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> guide.simulation = ksd.Simulation(until="20 ms", dt="0.5 ms", drives={"table": None})
    >>> len(ksd.simulate(guide).t)
    41
    """

    until: Any
    dt: Any = None
    accuracy: Any = None
    method: str = METHODS[0]
    rho: Any = 0.8
    drives: Mapping[str, Any] = field(default_factory=dict)
    loads: Mapping[str, Any] = field(default_factory=dict)
    base: Shake | None = None
    start: Any = STARTS[0]
    speeds: Mapping[str, Any] = field(default_factory=dict)
    stop: Any = ()
    damping_at: Any = None
    release: Any = None
    every: int = 1
    mass_at_ends: bool = False

    def __post_init__(self) -> None:
        self._set(until=positive(_time(self.until, "until"), "until", owner="simulate", unit="s"))
        if self.dt is not None and self.accuracy is not None:
            raise SceneError(
                "simulate: dt and accuracy exclude each other; give a step, or let the accuracy choose it"
            )
        if self.dt is not None:
            self._set(dt=positive(_time(self.dt, "dt"), "dt", owner="simulate", unit="s"))
            if self.dt > self.until:
                raise SceneError(f"simulate: dt = {self.dt:g} s is longer than until = {self.until:g} s")
        else:
            wanted = DEFAULT_ACCURACY if self.accuracy is None else self.accuracy
            self._set(accuracy=between(wanted, "accuracy", 0.0, 1.0, owner="simulate"))
        if self.method not in METHODS:
            raise SceneError(
                f"simulate: method = {show(self.method)} is unknown{name_hint(str(self.method), METHODS)}"
            )
        rho = not_negative(self.rho, "rho", owner="simulate")
        if rho > 1.0:
            raise SceneError(
                f"simulate: rho = {rho:g}: 0 (most damping of what the step does not follow) to 1 (none)"
            )
        at_ends = boolean(self.mass_at_ends, "mass_at_ends")
        self._set(rho=rho, every=whole_number(self.every, "every"), mass_at_ends=at_ends)
        self._set(
            drives={
                n: None if f is None else as_function_of_time(f, f"drive '{n}'")
                for n, f in _named(self.drives, "drives")
            },
            loads={n: as_function_of_time(f, f"load '{n}'") for n, f in _named(self.loads, "loads")},
            speeds={n: _speeds(v, n) for n, v in _named(self.speeds, "speeds")},
        )
        if self.release is not None and not isinstance(self.release, Ramp):
            if None not in self.drives.values():
                raise SceneError(
                    "simulate: release is that of drives that are let go; let one go by drives={'push': None}"
                )
            duration = positive(_time(self.release, "release"), "release", owner="simulate", unit="s")
            self._set(release=Ramp(duration, start=1.0, end=0.0))
        if self.base is not None and not isinstance(self.base, Shake):
            raise SceneError(
                f'simulate: base = {show(self.base)}: give ksd.Shake(along="y", acceleration=...)'
            )
        for what, function in self.functions().items():
            for t in (0.5 * self.until, self.until):
                refuse_change(function, what, t)
        self._set(
            drives={n: f if f is None else f.within(self.until) for n, f in self.drives.items()},
            loads={n: f.within(self.until) for n, f in self.loads.items()},
        )
        if isinstance(self.start, str) and self.start not in STARTS:
            raise SceneError(
                f"simulate: start = {show(self.start)}: {' or '.join(map(repr, STARTS))}, or a pose that ksd.solve returned"
            )
        events = (self.stop,) if isinstance(self.stop, Event) else self.stop
        if not isinstance(events, list | tuple) or any(not isinstance(e, Event) for e in events):
            raise SceneError(
                f"simulate: stop = {show(self.stop)}: give ksd.Event('push', above='4 mm'), or several"
            )
        self._set(stop=tuple(events))
        if self.damping_at is not None:
            f = quantity(self.damping_at, "frequency", "simulate: damping_at")
            self._set(damping_at=positive(f, "damping_at", owner="simulate", unit="Hz"))

    def _set(self, **checked: Any) -> None:
        for name, value in checked.items():
            object.__setattr__(self, name, value)

    def functions(self) -> dict[str, FunctionOfTime]:
        """All functions of time, by what follows them."""
        found = {f"drive '{n}'": f for n, f in self.drives.items() if f is not None}
        found |= {f"load '{n}'": f for n, f in self.loads.items()}
        found |= {"release": self.release} if isinstance(self.release, Ramp) else {}
        return found | ({} if self.base is None else {"the base": self.base.acceleration})

    @property
    def shortest(self) -> float:
        """Shortest duration [s] of a part of a function of time, inf where there is none."""
        return min((f.shortest for f in self.functions().values()), default=math.inf)

    def check(self, scene: Any) -> tuple[str, ...]:
        """Sentences to say about this motion of a scene. Raises SceneError for what it cannot do."""
        drives = {d.name: d for d in scene.drives}
        _known(self.drives, drives, "drive")
        _known(self.loads, {load.name: load for load in (*scene.loads, *scene.line_loads)}, "load")
        _known(self.speeds, {n: n for n in scene.links if n != GROUND}, "link")
        sensors = {s.name: s.kind for s in scene.sensors}
        _known({e.of: e for e in self.stop}, drives | sensors, "drive or sensor")
        for name in (e.of for e in self.stop if e.of not in drives and KINDS[sensors[e.of]]):
            raise SceneError(
                f"event of '{name}': an event is a place, not a {sensors[name]}; use a sensor of displacement or rotation"
            )
        for name, f in self.drives.items():
            if f is not None:
                _check_dimension(f, drives[name].dimension, f"drive '{name}'")
                self._check_drive(f, name, drives[name].dimension)
        for name, f in self.loads.items():
            _check_dimension(f, "number", f"load '{name}'")
        if self.base is not None:
            _check_dimension(self.base.acceleration, "acceleration", "the base")
            _check_plane(self.base.along, scene.plane)
        self._check_masses(scene)
        return (*self._speed_jumps(), *self._close_knots())

    def _check_masses(self, scene: Any) -> None:
        materials = {leaf.material for leaf in scene.leaf_names().values()}
        if not any(m.mass > 0.0 for m in scene.masses) and all(m.density is None for m in materials):
            raise SceneError(
                "simulate: nothing has mass: no material has a density and no link a mass; say density= of a material, or "
                "mechanism.mass(link, mass=...)"
            )
        lossy = [m for m in materials if m.loss_factor]
        if lossy and self.damping_at is None:
            eta, name = lossy[0].loss_factor, lossy[0].name or "a material"
            raise SceneError(
                f"simulate: {name} has a loss factor of {eta:g}, which needs a frequency in time: say damping_at='8.6 Hz', "
                "for example, at which it holds; damping then grows with the frequency"
            )
        if self.damping_at is not None and not lossy:
            raise SceneError(
                f"simulate: damping_at = {self.damping_at:g} Hz, but no material has a loss factor"
            )

    def _check_drive(self, f: FunctionOfTime, name: str, dimension: str) -> None:
        for at, order in f.jumps:
            if order == 0 and 0.0 <= at < self.until:
                raise SceneError(
                    f"drive '{name}': its motion jumps in place at t = {at:g} s, which takes an infinite force; give it a "
                    "duration, such as ksd.Cycloid(end, duration=...)"
                )
        pose = self.start_value(name)
        value = f(0.0)
        unit = next(iter(DIMENSIONS.get(dimension, {"": 1.0})))
        if pose is not None and abs(value - pose) > POSITION_TOLERANCE * max(abs(value), abs(pose), 1e-3):
            raise SceneError(
                f"drive '{name}': its motion starts at {value:g} {unit}, but the pose at {pose:g} {unit}; start both at one "
                "place"
            )

    def start_value(self, drive: str) -> float | None:
        """Value of a drive in the pose at the start; None where that is the equilibrium of its own function."""
        if isinstance(self.start, str):
            return 0.0 if self.start == "undeformed" else None
        return float(self.start.targets[drive])

    def _speed_jumps(self) -> list[str]:
        """A sentence for every jump of the speed of a drive."""
        said = []
        for name, f in self.drives.items():
            if f is None:
                continue
            instants = {at for at, order in f.jumps if order == 1 and at < self.until}
            if f.rates(0.0)[0] != 0.0 and not self.speeds and isinstance(self.start, str):
                instants.add(0.0)
            for at in sorted(instants):
                said.append(
                    f"drive '{name}': its speed jumps at t = {at:g} s; its force there is an impulse, and no number"
                )
        return said

    def _close_knots(self) -> list[str]:
        """A sentence for every table with knots closer than the step."""
        if self.dt is None:
            return []
        said = []
        for name, f in self.functions().items():
            parts = f.parts if isinstance(f, Sum) else (f,)
            closest = min((p.shortest for p in parts if isinstance(p, TimeTable)), default=math.inf)
            if closest < self.dt * (1.0 - 1e-9):
                said.append(
                    f"{name}: its table has points {closest:.3g} s apart, closer than dt = {self.dt:g} s; what happens "
                    "between steps is left out"
                )
        return said

    def check_memory(self, steps: int, *, numbers: int) -> None:
        """Raise SceneError for a history of `steps` steps with so many `numbers` each that would not fit: all of them are
        there until the energies are known."""
        size = 8 * (steps + 1) * numbers
        if size > MAX_HISTORY_BYTES:
            raise SceneError(
                f"simulate: the history would take {size / 2**30:.3g} GiB ({steps + 1} instants of "
                f"{8 * numbers / 2**10:.3g} KiB), more than {MAX_HISTORY_BYTES >> 30} GiB; take a larger dt, or simulate in "
                "parts, each from start=history[t] of the one before"
            )


def _time(value: Any, what: str) -> float:
    return quantity(value, "time", f"simulate: {what}")


def _named(given: Any, what: str) -> Any:
    if not isinstance(given, Mapping):
        raise SceneError(
            f"simulate: {what} = {show(given)} must be given by name, such as {{\"push\": ksd.Ramp('20 ms')}}"
        )
    return given.items()


def _speeds(given: Any, link: str) -> tuple[float, ...]:
    """Speed [m/s] and angular speed [rad/s] of a link, the latter 0 where three numbers are given."""
    values = list(given) if isinstance(given, list | tuple | np.ndarray) else []
    if len(values) not in (3, 6):
        raise SceneError(
            f"speeds of '{link}' = {show(given)} must be three numbers in m/s, or six with those in rad/s behind"
        )
    turning: Vector = (
        vector(values[3:], f"speeds of '{link}'", unit="rad/s") if len(values) == 6 else (0.0, 0.0, 0.0)
    )
    return (*vector(values[:3], f"speeds of '{link}'", unit="m/s"), *turning)


def _known(given: Mapping[str, Any], known: Mapping[str, Any], kind: str) -> None:
    for name in given:
        if name not in known:
            raise SceneError(f"simulate: there is no {kind} {show(name)}{name_hint(str(name), known)}")


def _check_dimension(f: FunctionOfTime, expected: str, what: str) -> None:
    if f.dimension is not None and f.dimension != expected:
        article = "a plain factor" if expected == "number" else f"in {next(iter(DIMENSIONS[expected]))}"
        raise SceneError(f"{what}: its function of time is of dimension {f.dimension}, but must be {article}")


def _check_plane(along: Vector, plane: str | None) -> None:
    out = {*"xyz"} - {*(plane or "xyz")}
    if any(abs(along["xyz".index(axis)]) > 1e-12 for axis in out):
        raise SceneError(
            f"simulate: the base shakes out of the plane {plane} of the mechanism; shake it within"
        )


def simulation_of_table(words: Mapping[str, Any]) -> Simulation:
    """A motion from the keys of [simulate]. Raises SceneError."""
    words = dict(words)
    for part in ("drives", "loads"):
        if isinstance(tables := words.get(part), dict):
            words[part] = {
                name: None if table == {"let_go": True} else function_of_table(table, f"{part[:-1]} '{name}'")
                for name, table in tables.items()
            }
    if "base" in words:
        base = dict(words["base"]) if isinstance(words["base"], dict) else {}
        along = base.pop("along", None)
        words["base"] = Shake(along, function_of_table(base.pop("acceleration", base), "base"))
    if "stop" in words:
        given = words["stop"]
        words["stop"] = tuple(_event(one) for one in (given if isinstance(given, list) else [given]))
    return Simulation(**words)


def _event(given: Any) -> Event:
    if not isinstance(given, dict) or "of" not in given or not {"of", "above", "below"} >= given.keys():
        raise SceneError(f'stop = {show(given)}: write {{ of = "push", above = "4 mm" }}')
    return Event(**given)


def table_of_simulation(s: Simulation) -> dict[str, Any]:
    """The table [simulate] of a scene file. Raises SceneError for functions of Python and a start from a pose."""
    if not isinstance(s.start, str):
        raise SceneError("simulate: a start from a pose cannot be written to a file; keep it in Python")
    keys = "until", "dt", "accuracy", "method", "rho", "damping_at", "every", "mass_at_ends", "start"
    plain = {key: getattr(s, key) for key in keys}
    default = Simulation(until=1.0)
    table = {k: v for k, v in plain.items() if v is not None and (k == "until" or v != getattr(default, k))}
    if s.release is not None:
        table["release"] = s.release.duration
    if s.drives:
        table["drives"] = {
            n: {"let_go": True} if f is None else table_of_function(f, f"drive '{n}'")
            for n, f in s.drives.items()
        }
    if s.loads:
        table["loads"] = {n: table_of_function(f, f"load '{n}'") for n, f in s.loads.items()}
    if s.base is not None:
        table["base"] = {
            "along": s.base.along,
            "acceleration": table_of_function(s.base.acceleration, "the base"),
        }
    if s.speeds:
        table["speeds"] = dict(s.speeds)
    if s.stop:
        table["stop"] = [{k: v for k, v in vars(e).items() if v is not None} for e in s.stop]
    return table
