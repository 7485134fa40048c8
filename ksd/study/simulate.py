"""`ksd.simulate`: the motion of a mechanism in time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

from ksd.checks import boolean, clear_argument_errors, show, warn_user
from ksd.errors import KsdError, SceneError, SceneWarning
from ksd.model.mesh import Mesh
from ksd.scene.mechanism import Mechanism
from ksd.scene.scene import Scene
from ksd.scene.simulation import Event, Shake, Simulation
from ksd.solvers.configuration import Configuration
from ksd.solvers.dynamics import trace_motion
from ksd.study.history import History, Instant

STEPS_PER_PERIOD = 10.0
"""Steps in the longest free period below which a step that was given is warned of."""


@clear_argument_errors
def simulate(
    mechanism: Mechanism | Scene,
    until: float | str | None = None,
    *,
    dt: float | str | None = None,
    accuracy: float | None = None,
    method: str | None = None,
    rho: float | None = None,
    drives: Mapping[str, Any] | None = None,
    loads: Mapping[str, Any] | None = None,
    base: Shake | None = None,
    start: str | Configuration | None = None,
    speeds: Mapping[str, Any] | None = None,
    stop: Event | Sequence[Event] | None = None,
    damping_at: float | str | None = None,
    release: float | str | None = None,
    every: int | None = None,
    mass_at_ends: bool | None = None,
    mesh: Mesh | None = None,
    progress: bool = False,
) -> History:
    """The motion of a mechanism from t = 0 to `until` [s], as a `History`. Times and values are SI, or text with a unit.

    accuracy: of places, relative to the largest stroke (1e-3): two runs of different steps tell the error, and the step is
    made small enough; or dt [s]: one run of this step. drives, loads: functions of time by name (`ksd.Cycloid`, `ksd.Ramp`,
    a callable of t, points (t, value), a formula such as "1 - exp(-t / 5 ms)", a number), of a load its factor; a drive that
    is not named keeps its value, one that is None is let go. base: `ksd.Shake`. start: "equilibrium" of all that acts just
    before t = 0, "undeformed" (weight and loads act from t = 0 on), or a pose that `ksd.solve` returned or a history has at
    an instant. speeds: (vx, vy, vz, wx, wy, wz) [m/s, rad/s] by link. stop: `ksd.Event` that ends the motion. damping_at
    [Hz]: frequency at which the loss factors of materials hold. release [s]: time in which the force of drives that are let
    go falls by half a cosine, at once when None. rho: 0 to 1, spectral radius of the method at infinite
    frequency (0.8). every: steps per kept instant. mass_at_ends: leaf springs have their mass at their ends, several
    times faster where these are many. mesh: of the leaf springs. progress: shows a bar.

    Words that are not given are those of [simulate] of the file that the mechanism was loaded from. Raises SceneError for
    bad input, ConvergenceError where there is no equilibrium to start from; a motion that ends early returns what it has,
    with the reason in `History.stop`.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> push = ksd.Cycloid(5 * mm, duration=20e-3)
    >>> history = ksd.simulate(guide, until="20 ms", dt="0.5 ms", drives={"table": push})
    >>> print(f"at most {max(history.drives['table'].force):.1f} N")
    at most 42.4 N
    """
    given = {
        "until": until, "dt": dt, "accuracy": accuracy, "method": method, "rho": rho, "drives": drives, "loads": loads,
        "base": base, "start": start, "speeds": speeds, "stop": stop, "damping_at": damping_at, "release": release,
        "every": every, "mass_at_ends": mass_at_ends,
    }  # fmt: skip
    words = _words(mechanism, {name: value for name, value in given.items() if value is not None})
    scene = mechanism.scene() if isinstance(mechanism, Mechanism) else mechanism
    if not isinstance(scene, Scene):
        raise SceneError(f"simulate: {show(mechanism)} is no mechanism; give what is to move, then until=")
    if not isinstance(words.start, str | Configuration):
        raise SceneError(f"simulate: start = {show(words.start)}: give a pose that ksd.solve returned")
    if isinstance(words.start, Instant) and not words.speeds:
        words = replace(words, speeds=words.start.speeds)
    said = words.check(scene)
    trace = trace_motion(scene, words, mesh=mesh, progress=boolean(progress, "progress"))
    history = History(replace(trace, notes=(*said, *trace.notes)), words.base)
    if words.dt is not None and (note := _coarse_step(history, words)):
        history = History(replace(history.trace, notes=(*history.notes, note)), words.base)
    for note in history.notes:
        warn_user(note, SceneWarning)
    return history


def _words(mechanism: Any, given: dict[str, Any]) -> Simulation:
    """Words of a motion: those given, before those of the mechanism's file."""
    own = getattr(mechanism, "simulation", None) if isinstance(mechanism, Mechanism) else None
    if own is None:
        if "until" not in given:
            raise SceneError("simulate: until is missing; say how long, such as until='1 s'")
        return Simulation(**given)
    if {"dt", "accuracy"} & given.keys():
        given = {"dt": None, "accuracy": None} | given
    return Simulation(**{**vars(own), **given})


def _coarse_step(history: History, words: Simulation) -> str:
    """A sentence where the step that was given is long beside the longest free period."""
    freed = tuple(n for n, f in words.drives.items() if f is None)
    try:
        found = history[float(history.t[0])].frequencies(count=3, freed=freed).frequency_Hz
    except KsdError:
        return ""
    elastic = found[found > 0.0]
    if not len(elastic) or words.dt * elastic[0] * STEPS_PER_PERIOD <= 1.0:
        return ""
    return (
        f"dt = {words.dt:g} s is more than a tenth of the longest free period, {1.0 / elastic[0]:.3g} s; ringing is "
        "not followed with it"
    )
