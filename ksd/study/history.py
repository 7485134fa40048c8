"""The answer of `ksd.simulate`: motions, forces, sensors and energies over time, and the pose at any instant."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ksd.answers.forces import InterfaceForces, interface_forces
from ksd.answers.inertia_forces import moving_section_forces
from ksd.answers.link_forces import LinkForces, link_forces
from ksd.answers.mass import centre_of_mass
from ksd.answers.printing import NamedAnswers, PrintableAnswer, format_number, format_table
from ksd.answers.strength import Strength, strength_of
from ksd.answers.stress import Stress, stress_from_forces
from ksd.checks import (
    clear_argument_errors_of_methods,
    names_of,
    number,
    show,
    vector,
    warn_user,
    whole_number,
)
from ksd.errors import SceneError, SceneWarning, UnknownNameError
from ksd.model.compile import compile_as_is
from ksd.scene.drive import GROUND, DriveTerm
from ksd.scene.link import Link
from ksd.scene.sensor import KINDS, Sensor
from ksd.scene.simulation import Shake
from ksd.solvers.configuration import Configuration
from ksd.solvers.steps import Step, Stop
from ksd.solvers.trace import Trace, with_load_factors
from ksd.study.questions import RMS_UNITS
from ksd.study.table import Table
from ksd.view import animate_stroke, save_figure, write_page
from ksd.view.camera import View
from ksd.view.time_plot import plot_over_time, plot_phase, plot_spectrum

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]
UNITS = RMS_UNITS | {"m": ("mm", 1e3)}
"""Unit of a column, and the factor to it, by SI unit."""
ENERGIES = ("kinetic", "strain", "gravity", "work", "damped", "lost")
SPECTRUM_POINTS = 1 << 20
"""Largest number of even instants of a spectrum."""
FRAMES_PER_SECOND, LEAST_FRAMES, MOST_FRAMES = 25, 40, 120
"""Of an animation; motions that are shorter or longer are shown slower or faster."""


@dataclass(frozen=True)
class LinkMotion:
    """Motion of a point of a link: position (k, 3) [m], rotation matrices (k, 3, 3), velocity (k, 6) [m/s, rad/s] and
    acceleration (k, 6) [m/s^2, rad/s^2] of the point and the link, global; displacement (k, 3) [m]."""

    rest: Array
    position: Array
    rotation: Array
    velocity: Array
    _acceleration: Array
    massless: str = ""

    @property
    def displacement(self) -> Array:
        """Displacement (k, 3) [m] of the point."""
        return self.position - self.rest

    @property
    def acceleration(self) -> Array:
        """Acceleration (k, 6) [m/s^2, rad/s^2]; warns where the link has no mass, whose acceleration is no motion."""
        if self.massless:
            warn_user(
                f"link '{self.massless}' has no mass: its acceleration follows from those of others and may alternate from "
                "step to step; ask that of a link with mass",
                SceneWarning,
            )
        return self._acceleration

    def at(self, point: ArrayLike) -> LinkMotion:
        """Motion of the point of the link that is at `point` (3,) [m] in the undeformed configuration."""
        place = np.asarray(vector(point, "point", unit="m"))
        arm = self.rotation @ (place - self.rest)
        v, a, w, alpha = self.velocity, self._acceleration, self.velocity[:, 3:], self._acceleration[:, 3:]
        carried = np.cross(w, arm)
        speed = np.hstack([v[:, :3] + carried, w])
        rate = np.hstack([a[:, :3] + np.cross(alpha, arm) + np.cross(w, carried), alpha])
        return LinkMotion(place, self.position + arm, self.rotation, speed, rate, self.massless)


@dataclass(frozen=True)
class DriveMotion:
    """Value (k,) [m or rad], rate and force [N or Nm] of a drive, positive along it; the force of one let go is 0."""

    value: Array
    rate: Array
    force: Array


@dataclass(frozen=True)
class Energies:
    """Energies (k,) [J]: kinetic, strain (springs too) and gravity; work of drives, loads and base; damped: taken by
    dashpots and materials; lost: what is missing in the balance, by the numerical method."""

    kinetic: Array
    strain: Array
    gravity: Array
    work: Array
    damped: Array
    lost: Array


@dataclass(frozen=True, repr=False)
class Instant(Configuration):
    """The mechanism at an instant t [s] of a motion: a `Configuration` that is no equilibrium.

    velocity (nodes, 6) [m/s, rad/s]: of all nodes. Section forces, stress, strength, and forces on interfaces and links are
    those of the moving leaf springs, their inertia included (strain energy too is in `History.energy`); stiffness,
    frequencies and linear models are those about the place it is passing, as if it were held there, under the loads of this
    instant and, where a base shakes, gravity less its acceleration. around: states `step` [s] before and after; moving: the
    model of the motion.
    """

    t: float = 0.0
    velocity: Any = None
    around: Any = None
    step: float = 0.0
    moving: Any = None

    def section_forces(self, *, points: int = 25) -> Any:
        """As `Configuration.section_forces`, with the inertia of the leaf springs."""
        return moving_section_forces(
            self.model, self.around, self.step, points=whole_number(points, "points", least=2)
        )

    def stress(self, *, points: int = 25) -> Stress:
        """As `Configuration.stress`, with the inertia of the leaf springs."""
        return stress_from_forces(self.model, self.section_forces(points=points))

    def interface_forces(self) -> InterfaceForces:
        """As `Configuration.interface_forces`, with the inertia of the leaf springs."""
        return interface_forces(self.model, self.motion, sections=self.section_forces(points=2))

    def link_forces(self) -> LinkForces:
        """As `Configuration.link_forces`, with the inertia of the leaf springs; that of a link is in what is applied to
        it."""
        return link_forces(self.model, self.motion, sections=self.section_forces(points=2))

    @cached_property
    def strength(self) -> Strength | None:
        """As `Configuration.strength`, with the inertia of the leaf springs."""
        return strength_of(self.model, self.stress().leaves)

    @property
    def speeds(self) -> dict[str, Array]:
        """Velocity (6,) [m/s, rad/s] of every link, of its centre of mass, as `ksd.simulate` takes them."""
        found = {}
        for i, name in enumerate(self.model.scene.links):
            arm = self.motion.R[i] @ (centre_of_mass(self.model, name) - self.model.rest.x[i])
            v, w = np.split(self.velocity[i], 2)
            found[name] = np.concatenate([v + np.cross(w, arm), w])
        return {name: speed for name, speed in found.items() if name != GROUND}

    @property
    def stable(self) -> bool:
        """False: an instant of a motion is no equilibrium."""
        return False


@dataclass(frozen=True, repr=False)
class Spectrum(PrintableAnswer):
    """Amplitude (n,) of a signal by frequency_Hz (n,), with a Hann window; name, unit: of the signal."""

    frequency_Hz: Array
    amplitude: Array
    name: str
    unit: str

    @property
    def peaks(self) -> tuple[tuple[float, float], ...]:
        """Frequency [Hz] and amplitude of the peaks, the largest first, by parabolas through the logarithms."""
        a = np.log(np.maximum(self.amplitude, 1e-300))
        k = np.flatnonzero((a[1:-1] > a[:-2]) & (a[1:-1] >= a[2:])) + 1
        k = k[self.amplitude[k] > 1e-3 * self.amplitude.max(initial=0.0)]
        bend = a[k - 1] - 2.0 * a[k] + a[k + 1]
        off = 0.5 * (a[k - 1] - a[k + 1]) / np.where(bend == 0.0, 1.0, bend)
        f = self.frequency_Hz[k] + off * self.frequency_Hz[1]
        height = np.exp(a[k] - 0.25 * (a[k - 1] - a[k + 1]) * off)
        return tuple(sorted(zip(f.tolist(), height.tolist(), strict=True), key=lambda p: -p[1]))

    def _line(self) -> str:
        shown = ", ".join(
            f"{format_number(a)} {self.unit} at {format_number(f)} Hz" for f, a in self.peaks[:3]
        )
        return f"of {self.name}: {shown or 'no peaks'}"

    def __str__(self) -> str:
        rows = [(format_number(f, 5), format_number(a)) for f, a in self.peaks[:8]]
        return format_table(("frequency [Hz]", f"amplitude [{self.unit}]"), rows, f"Peaks of '{self.name}'")

    def plot(self, path: str | os.PathLike[str] | None = None) -> Figure:
        """Matplotlib figure of the spectrum, written to `path` (.png, .pdf, .svg ...) if given."""
        figure = plot_spectrum(self.frequency_Hz, self.amplitude, f"{self.name} [{self.unit}]")
        return figure if path is None else save_figure(figure, path)


@clear_argument_errors_of_methods
class History(PrintableAnswer):
    """A motion in time. ``history["stage"]`` is the motion of a link, ``history[0.25]`` the pose at an instant [s].

    t (k,) [s]; drives, sensors (k,), energy: by name; error: estimated error of places relative to the largest stroke, nan
    where one step size alone was run; steps: number of steps; stop: why the motion ended early, None where it did not;
    notes: sentences on the run; trace: the plain numbers of all nodes.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> push = ksd.Cycloid(5 * mm, duration=20e-3)
    >>> history = ksd.simulate(guide, until="20 ms", dt="0.5 ms", drives={"table": push})
    >>> table, middle = history.drives["table"], len(history.t) // 2
    >>> print(f"{table.value[middle] / mm:.2f} mm at {table.rate[middle]:.3f} m/s")
    2.50 mm at 0.500 m/s
    """

    def __init__(self, trace: Trace, base: Shake | None = None) -> None:
        self.trace, self._base = trace, base
        self._last_model: tuple[Any, Any] = (None, None)
        self.t, self.error, self.steps = trace.t, trace.error, trace.steps
        self.stop, self.notes = trace.stop, trace.notes
        self.energy = Energies(**{name: trace.energy[name] for name in ENERGIES})
        columns = zip(trace.drive_value.T, trace.drive_rate.T, trace.drive_force.T, strict=True)
        motions = dict(zip(trace.model.drive_names, (DriveMotion(*c) for c in columns), strict=True))
        self.drives: NamedAnswers[DriveMotion] = NamedAnswers(motions, "drive")

    @cached_property
    def sensors(self) -> NamedAnswers[Array]:
        """Readings (k,) of all sensors of the scene, SI."""
        return NamedAnswers({s.name: self._reading(s) for s in self.trace.model.scene.sensors}, "sensor")

    def __len__(self) -> int:
        return len(self.t)

    def __getitem__(self, key: str | Link | float) -> Any:
        """The `LinkMotion` of a link, or the `Instant` at a time [s]. Raises SceneError."""
        if isinstance(key, str | Link):
            return self._link(key.name if isinstance(key, Link) else key)
        return self._instant(number(key, "time", unit="s"))

    def _link(self, name: str) -> LinkMotion:
        trace, known = self.trace, self.trace.model.node_names
        if name not in known:
            listed = ", ".join(trace.model.listed_names)
            raise UnknownNameError(
                f"there is no link {show(name)}; there are {listed}", kind="link", name=name
            )
        k = known.index(name)
        return LinkMotion(
            trace.model.rest.x[k], trace.position[:, k], trace.rotation[:, k], trace.velocity[:, k],
            trace.acceleration[:, k], name if name in trace.massless else "",
        )  # fmt: skip

    def _instant(self, t: float) -> Instant:
        """The pose at t, and the states next to it from which accelerations follow."""
        trace, times = self.trace, self.t
        if not times[0] <= t <= times[-1]:
            raise SceneError(f"time {t:g} s is outside of the motion, {times[0]:g} to {times[-1]:g} s")
        state, velocity, values = self._between(t)
        k = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, max(len(times) - 2, 0)))
        step = float(times[min(k + 1, len(times) - 1)] - times[k]) or 1.0
        middle = (
            float(np.clip(t, times[0] + step, times[-1] - step)) if times[-1] - times[0] >= 2.0 * step else t
        )
        ends = [float(np.clip(middle + side * step, times[0], times[-1])) for side in (-1.0, 0.0, 1.0)]
        around = [self._between(one)[0] for one in ends]
        if middle != t:
            # at the ends of the motion the acceleration of the next instant
            shift = state.inner - around[1].inner, state.x - around[1].x
            around = [one._replace(inner=one.inner + shift[0], x=one.x + shift[1]) for one in around]
        around[1] = state
        targets = dict(zip(trace.model.drive_names, values.tolist(), strict=True))
        return Instant(
            self._model(t), state, f"motion at t = {t:.4g} s", targets,
            (Step("motion", trace.steps, 0.0, 0.0, Stop.MOVING),), negatives=0, expected_negatives=0, t=t, velocity=velocity,
            around=tuple(around), step=step, moving=trace.model,
        )  # fmt: skip

    def _model(self, t: float) -> Any:
        """The model under the loads at t, and where a base shakes under gravity less its acceleration; the last is kept."""
        model = self.trace.model
        factors = tuple(float(f(t)) for f in self.trace.loads.values())
        base = 0.0 if self._base is None else float(self._base.acceleration(t))
        if all(f == 1.0 for f in factors) and base == 0.0:
            return model
        if self._last_model[0] != (factors, base):
            scene = with_load_factors(model.scene, dict(zip(self.trace.loads, factors, strict=True)))
            if self._base is not None:
                gravity = np.zeros(3) if scene.gravity is None else np.asarray(scene.gravity, float)
                scene = replace(
                    scene, gravity=tuple((gravity - base * np.asarray(self._base.along)).tolist())
                )
            self._last_model = ((factors, base), compile_as_is(scene, model.mesh))
        return self._last_model[1]

    def _between(self, t: float) -> tuple[Any, Array, Array]:
        """State, velocities of the nodes and values of drives at t: cubics in time through places and speeds, straight lines
        for forces."""
        trace, times = self.trace, self.t
        k = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, max(len(times) - 2, 0)))
        state, velocity = trace.state(trace.x[k]), trace.velocity[k]
        values = trace.drive_value[k]
        if t != times[k]:
            h, u = times[k + 1] - times[k], (t - times[k]) / (times[k + 1] - times[k])
            later = trace.state(trace.x[k + 1])
            rates = trace.velocity[k : k + 2]
            state.x[:], velocity_x = _hermite(state.x, later.x, rates[0, :, :3], rates[1, :, :3], h, u)
            turned, w = _turn(
                trace.rotation[k], trace.rotation[k + 1], rates[0, :, 3:], rates[1, :, 3:], h, u
            )
            state.R[:], velocity = turned, np.hstack([velocity_x, w])
            slopes = [self._slope(i) for i in (k, k + 1)]
            state.inner[:], _ = _hermite(state.inner, later.inner, slopes[0].inner, slopes[1].inner, h, u)
            state.angle[:], _ = _hermite(state.angle, later.angle, slopes[0].angle, slopes[1].angle, h, u)
            state.multiplier[:] += u * (later.multiplier - state.multiplier)
            values, _ = _hermite(
                values, trace.drive_value[k + 1], trace.drive_rate[k], trace.drive_rate[k + 1], h, u
            )
        return state, velocity, values

    def _slope(self, k: int) -> Any:
        """Rates of the numbers of a state at instant k, by the parabola through it and its neighbours."""
        t, x, last = self.t, self.trace.x, len(self.t) - 1
        if last == 1:
            return self.trace.state((x[1] - x[0]) / (t[1] - t[0]))
        i = min(max(k, 1), last - 1)
        before, after = (x[i] - x[i - 1]) / (t[i] - t[i - 1]), (x[i + 1] - x[i]) / (t[i + 1] - t[i])
        bend = (after - before) / (t[i + 1] - t[i - 1])
        return self.trace.state(before + bend * (2.0 * t[k] - t[i] - t[i - 1]))

    def _reading(self, sensor: Sensor) -> Array:
        """Reading (k,) of a sensor; `absolute` adds the motion of the base."""
        order = KINDS[sensor.kind]
        reading = sensor.term.coefficient * _component(self, sensor.term)[order]
        if sensor.absolute and self._base is not None and sensor.term.kind == "translation":
            along = float(np.asarray(self._base.along) @ np.asarray(sensor.term.direction))
            reading = reading + sensor.term.coefficient * along * self._base_motion[order]
        return np.asarray(reading)

    @cached_property
    def _base_motion(self) -> tuple[Array, Array, Array]:
        """Place, speed and acceleration (k,) of the base, at rest at first, by Simpson's rule."""
        assert self._base is not None
        f, h = self._base.acceleration, np.diff(self.t)
        a, middle = f(self.t), f(self.t[:-1] + 0.5 * h)
        v = np.concatenate([[0.0], np.cumsum(h / 6.0 * (a[:-1] + 4.0 * middle + a[1:]))])
        x = np.concatenate([[0.0], np.cumsum(h * v[:-1] + h**2 / 6.0 * (a[:-1] + 2.0 * middle))])
        return x, v, np.asarray(a)

    # What is shown

    @cached_property
    def signals(self) -> dict[str, tuple[Array, str]]:
        """Values (k,) and SI unit by name: drives ("push"), their forces ("push force"), sensors, energies ("kinetic
        energy"), and displacements and rotations of links ("stage x", "stage rz")."""
        found: dict[str, tuple[Array, str]] = {}
        dimensions = {d.name: d.dimension for d in self.trace.model.scene.drives}
        for name, drive in self.drives.items():
            length = dimensions.get(name) != "angle"
            found[name] = drive.value, "m" if length else "rad"
            found[f"{name} force"] = drive.force, "N" if length else "Nm"
        for s in self.trace.model.scene.sensors:
            found[s.name] = self.sensors[s.name], s.unit
        for link in self.trace.model.scene.links:
            if link != GROUND and link not in self.trace.model.scene.unlisted:
                moved, turned = self[link].displacement, _rotation_vectors(self[link].rotation)
                found |= {f"{link} {axis}": (moved[:, i], "m") for i, axis in enumerate("xyz")}
                found |= {f"{link} r{axis}": (turned[:, i], "rad") for i, axis in enumerate("xyz")}
        return found | {f"{name} energy": (getattr(self.energy, name), "J") for name in ENERGIES}

    def signal(self, name: str) -> tuple[Array, str]:
        """Values (k,) and SI unit of one of the `signals`. Raises UnknownNameError."""
        return NamedAnswers(self.signals, "signal")[name]

    def table(self) -> Table:
        """All signals over time as a `Table`, mm, mrad, N and J."""
        columns: dict[str, Any] = {"t_s": tuple(self.t.tolist())}
        for name, (values, unit) in self.signals.items():
            shown, factor = UNITS.get(unit, (unit, 1.0))
            columns[f"{name.replace(' ', '_')}_{shown}"] = tuple((factor * values).tolist())
        columns["status"] = ("ok",) * len(self)
        about = " ".join((*self.notes, *([self.stop] if self.stop else [])))
        facts = {"about": about, "error": f"{self.error:g}", "steps": f"{self.steps}"}
        return Table(columns, ("t_s",), ("t_s",), self.trace.model.scene.name, facts)

    def to_csv(self, path: str | os.PathLike[str]) -> Path:
        """Write `table` as comma-separated values. Returns the path."""
        return self.table().to_csv(path)

    def to_hdf5(self, path: str | os.PathLike[str]) -> Path:
        """Write `table` as HDF5 with a checksum; `ksd.Table.from_hdf5` reads it, and refuses a damaged file. Returns the
        path."""
        return self.table().to_hdf5(path)

    def to_mat(self, path: str | os.PathLike[str]) -> Path:
        """Write `table` for MATLAB. Returns the path."""
        return self.table().to_mat(path)

    def to_xarray(self) -> Any:
        """`table` as an xarray Dataset. Raises SceneError without xarray."""
        return self.table().to_xarray()

    def plot(self, *names: str, path: str | os.PathLike[str] | None = None) -> Figure:
        """Matplotlib figure of signals over time, a panel for each unit, written to `path` if given.

        names: of `signals`; drives with their forces, sensors and energies when none is named.
        """
        chosen = names_of(names, "names") or self._main_signals()
        curves = [(name, *self.signal(name)) for name in chosen]
        shown = [(n, UNITS.get(u, (u, 1.0)), v) for n, v, u in curves]
        figure = plot_over_time(self.t, [(n, unit.replace("_per_", "/"), f * v) for n, (unit, f), v in shown])
        return figure if path is None else save_figure(figure, path)

    def _main_signals(self) -> tuple[str, ...]:
        """Drives and their forces, sensors (displacements of links where there is neither), and energies; no forces and
        energies of zero."""
        forces = {d: [f"{d} force"] * bool(np.any(motion.force)) for d, motion in self.drives.items()}
        names = [n for d, force in forces.items() for n in (d, *force)] + [*self.sensors]
        if not names:
            links = [n for n, (_, unit) in self.signals.items() if unit == "m"]
            names = links[:6]
        most = {e: float(np.abs(getattr(self.energy, e)).max(initial=0.0)) for e in ENERGIES}
        energies = [f"{e} energy" for e, value in most.items() if value > 1e-20 * max(most.values())]
        return (*names, *energies)

    def phase_plot(self, name: str, path: str | os.PathLike[str] | None = None) -> Figure:
        """Matplotlib figure of the rate of a signal over its value, written to `path` if given."""
        values, unit = self.signal(name)
        shown, factor = UNITS.get(unit, (unit, 1.0))
        rate = self.drives[name].rate if name in self.drives else np.gradient(values, self.t)
        figure = plot_phase(factor * values, factor * rate, name, shown.replace("_per_", "/"))
        return figure if path is None else save_figure(figure, path)

    def spectrum(self, name: str, *, since: float = 0.0) -> Spectrum:
        """Amplitudes of a signal by frequency, from the instant `since` [s] on. Raises SceneError for too short a part."""
        from scipy.interpolate import CubicSpline

        values, unit = self.signal(name)
        first = number(since, "since", unit="s")
        part = self.t >= first
        if part.sum() < 8:
            raise SceneError(
                f"spectrum: since = {first:g} s leaves {part.sum()} instants; at least 8 are needed"
            )
        t = self.t[part]
        count = min(round((t[-1] - t[0]) / float(np.median(np.diff(t)))) + 1, SPECTRUM_POINTS)
        even = np.linspace(t[0], t[-1], count)
        x = CubicSpline(t, values[part])(even)
        window = np.hanning(count)
        amplitude = 2.0 * np.abs(np.fft.rfft((x - x.mean()) * window)) / window.sum()
        return Spectrum(np.fft.rfftfreq(count, even[1] - even[0]), amplitude, name, unit)

    def poses(self, count: int) -> list[Instant]:
        """`count` poses at even times, first and last instant included."""
        whole_number(count, "count", least=2)
        return [self[float(t)] for t in np.linspace(self.t[0], self.t[-1], count)]

    def animate(
        self,
        path: str | os.PathLike[str],
        *,
        slower: float | None = None,
        view: View | None = None,
        dpi: int = 80,
    ) -> Path:
        """Write the motion as an animated GIF, or as a page (.html) to be turned by hand, with a slider for the time, see
        `ksd.view.write_page`. Returns the path.

        slower: factor on the duration; such that the film has 40 to 120 frames when None. view, dpi: of a GIF, as in
        `ksd.view.animate_stroke`. Raises SceneError for another file type.
        """
        length = float(self.t[-1] - self.t[0])
        frames = FRAMES_PER_SECOND * length * (1.0 if slower is None else number(slower, "slower"))
        if slower is None:
            frames = float(np.clip(frames, LEAST_FRAMES, MOST_FRAMES))
        poses = self.poses(max(2, round(frames)))
        if Path(path).suffix.lower() in (".html", ".htm"):
            return write_page(poses, path, names=[f"{pose.t:.4g} s" for pose in poses])
        return animate_stroke(
            poses, path, view=view, frames_per_second=FRAMES_PER_SECOND, back=False, dpi=dpi
        )

    def _line(self) -> str:
        ended = "" if self.stop is None else f", stopped: {self.stop}"
        return f"'{self.trace.model.scene.name}', {self.t[-1]:g} s in {self.steps} steps{ended}"

    def __str__(self) -> str:
        rows = []
        for name in self._main_signals():
            values, unit = self.signal(name)
            shown, factor = UNITS.get(unit, (unit, 1.0))
            numbers = factor * np.array([values[0], values.min(), values.max(), values[-1]])
            rows.append(
                (name, shown.replace("_per_", "/"), *(format_number(float(v), zero=1e-12) for v in numbers))
            )
        known = np.isfinite(self.error)
        error = f"places within {format_number(100 * self.error, 2)} % of the largest stroke" if known else ""
        halved = f"{self.trace.halved} times halved" if self.trace.halved else ""
        facts = ", ".join(filter(None, (f"{self.steps} steps to t = {self.t[-1]:g} s", halved, error)))
        lines = [f"Motion of '{self.trace.model.scene.name}': {facts}", *self.notes]
        if self.stop is not None:
            lines.append(f"Stopped at t = {self.t[-1]:g} s: {self.stop}")
        return format_table(("signal", "<unit", "at first", "least", "most", "at last"), rows, *lines)


def _hermite(a: Array, b: Array, va: Array, vb: Array, h: float, u: float) -> tuple[Array, Array]:
    """Value and rate of the cubic from a to b with rates va and vb, at the share u of a step h."""
    mean = (b - a) / h
    bend, twist = 3.0 * mean - 2.0 * va - vb, va + vb - 2.0 * mean
    return a + u * h * (va + u * (bend + u * twist)), va + u * (2.0 * bend + 3.0 * u * twist)


def _turn(Ra: Array, Rb: Array, wa: Array, wb: Array, h: float, u: float) -> tuple[Array, Array]:
    """Rotation matrices and angular speeds of the cubic of rotation vectors from Ra to Rb (n, 3, 3)."""
    from scipy.spatial.transform import Rotation

    v = Rotation.from_matrix(Rb @ Ra.transpose(0, 2, 1)).as_rotvec()
    # the rate of the rotation vector at its end: inverse of the tangent map, to the third order in the turn of a step
    end = wb - 0.5 * np.cross(v, wb) + np.cross(v, np.cross(v, wb)) / 12.0
    phi, rate = _hermite(np.zeros_like(v), v, wa, end, h, u)
    w = rate + 0.5 * np.cross(phi, rate) + np.cross(phi, np.cross(phi, rate)) / 6.0
    return Rotation.from_rotvec(phi).as_matrix() @ Ra, w


def _rotation_vectors(R: Array) -> Array:
    """Rotation vectors (k, 3) [rad] of rotations over time (k, 3, 3), with their whole turns."""
    from scipy.spatial.transform import Rotation

    v = Rotation.from_matrix(R).as_rotvec()
    angle = np.linalg.norm(v, axis=1)
    # the axis with one sign throughout, and the angle about it without jumps
    axis = v / np.where(angle > 1e-9, angle, 1.0)[:, None]
    sign = np.ones(len(v))
    for k in range(1, len(v)):
        sign[k] = np.copysign(1.0, axis[k] @ axis[k - 1] * sign[k - 1]) if angle[k] > 1e-9 else sign[k - 1]
    unwrapped = np.unwrap(sign * angle)
    return np.asarray(unwrapped[:, None] * sign[:, None] * axis)


def _component(history: History, term: DriveTerm) -> tuple[Array, Array, Array]:
    """Component of the motion of a term over time, its rate and acceleration (k,), relative to its base."""
    moved = history[term.link].at(term.point)
    direction = np.asarray(term.direction)
    ground = term.base == GROUND
    base = None if ground else history[term.base].at(term.point)
    if term.kind == "rotation":
        w, alpha = moved.velocity[:, 3:], moved._acceleration[:, 3:]
        if base is None:
            return _rotation_vectors(moved.rotation) @ direction, w @ direction, alpha @ direction
        back = base.rotation.transpose(0, 2, 1)
        wb, ab = base.velocity[:, 3:], base._acceleration[:, 3:]
        turned = _rotation_vectors(back @ moved.rotation) @ direction
        rates = (w - wb, alpha - ab - np.cross(wb, w))
        return (turned, *(np.einsum("kij,kj->ki", back, r) @ direction for r in rates))
    v, a = moved.velocity[:, :3], moved._acceleration[:, :3]
    if base is None:
        return moved.displacement @ direction, v @ direction, a @ direction
    back = base.rotation.transpose(0, 2, 1)
    d, wb, ab = moved.position - base.position, base.velocity[:, 3:], base._acceleration[:, 3:]
    rate = v - base.velocity[:, :3] - np.cross(wb, d)
    second = (
        a
        - base._acceleration[:, :3]
        - np.cross(ab, d)
        - np.cross(wb, np.cross(wb, d))
        - 2.0 * np.cross(wb, rate)
    )
    return tuple(np.einsum("kij,kj->ki", back, part) @ direction for part in (d, rate, second))
