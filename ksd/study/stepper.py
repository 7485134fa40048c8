"""One step in time after another, for control loops: `step(state, inputs, dt)`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from functools import cached_property
from typing import Any

import numpy as np

from ksd.answers.printing import NamedAnswers
from ksd.checks import clear_argument_errors, name_hint, number, positive, show
from ksd.errors import ConvergenceError, SceneError
from ksd.model.mesh import Mesh
from ksd.model.newton import CONVERGED
from ksd.scene.functions_of_time import Step as Constant
from ksd.scene.mechanism import Mechanism
from ksd.scene.scene import Scene
from ksd.scene.simulation import Shake, Simulation
from ksd.scene.toml_table import quantity
from ksd.solvers.configuration import Configuration
from ksd.solvers.dynamics import begin_motion
from ksd.solvers.motion import Motion, Refused, Saved
from ksd.solvers.motion_record import trace_of_run
from ksd.solvers.motion_run import Run
from ksd.solvers.time_steps import generalised_alpha
from ksd.study.history import DriveMotion, History, Instant

MAX_HALVINGS = 8
"""How often the part of a step is halved before the step is refused."""


class MovingState:
    """A mechanism in motion at t [s]. It is not changed by steps: any state can be gone on from, again and again.

    history: the same as a `History` of this instant alone; saved, inputs, part: what the next step goes on from.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> push = ksd.Cycloid(5 * mm, duration=20e-3)
    >>> step = ksd.stepper(guide, longest="0.5 ms", drives={"table": push})
    >>> state = step(step.start, {}, 10e-3)
    >>> print(f"{state.t} s: {state.drives['table'].value[0] / mm:.2f} mm")
    0.01 s: 2.50 mm
    """

    def __init__(
        self, t: float, *, history: History, saved: Saved, inputs: Mapping[str, float], part: float
    ) -> None:
        self.t, self.history = t, history
        self._saved, self._inputs, self._part = saved, inputs, part

    def __repr__(self) -> str:
        read = ", ".join(f"{name} {value:.6g}" for name, value in self.sensors.items())
        return f"<MovingState at t = {self.t:g} s{': ' if read else ''}{read}>"

    @cached_property
    def sensors(self) -> NamedAnswers[float]:
        """Readings of the sensors, SI."""
        return NamedAnswers({name: float(v[0]) for name, v in self.history.sensors.items()}, "sensor")

    @property
    def drives(self) -> NamedAnswers[DriveMotion]:
        """Values, rates and forces (1,) of the drives."""
        return self.history.drives

    @property
    def pose(self) -> Instant:
        """The mechanism at this instant as a `Configuration`."""
        found: Instant = self.history[float(self.history.t[0])]
        return found


class Stepper:
    """``state = step(state, inputs, dt)``, from ``step.start`` on; made by `ksd.stepper`.

    scene: what moves; words: how; longest [s]: longest part of a step; mesh: of the leaf springs.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> push = ksd.Ramp(10e-3, end=2 * mm)
    >>> step = ksd.stepper(guide, longest="0.5 ms", drives={"table": push})
    >>> state = step.start
    >>> for _ in range(3):
    ...     state = step(state, {}, 5e-3)
    >>> print(f"{state.t} s: {state.drives['table'].value[0] / mm:.2f} mm")
    0.015 s: 2.00 mm
    """

    def __init__(self, scene: Scene, words: Simulation, longest: float | None, mesh: Mesh | None) -> None:
        marcher, chosen, _, _ = begin_motion(scene, words, mesh)
        self._marcher = marcher
        self._motion = marcher.motion = Motion(marcher.moving, words, marcher.start, marcher.values)
        if words.speeds:
            self._motion.set_speeds(words.speeds)
        self.longest = chosen if longest is None else longest
        self.loads = (*(x.name for x in scene.loads), *(x.name for x in scene.line_loads))
        # a moment along a leaf is several loads of its name
        own = self._motion.moving.model.scene
        names = [x.name for x in (*own.loads, *own.line_loads)]
        self._factors = list(zip(names, self._motion.factors, strict=True))
        self._rho = words.rho
        self.start = self._state(Run([self._motion.row()], {}), {}, math.nan)

    def _state(self, run: Any, inputs: Mapping[str, float], part: float) -> MovingState:
        history = History(trace_of_run(self._marcher, run, math.nan), None)
        return MovingState(
            float(self._motion.t), history=history, saved=Saved(self._motion), inputs=inputs, part=part
        )

    def __call__(self, state: MovingState, inputs: Mapping[str, float], dt: float | str) -> MovingState:
        """The state `dt` [s] later. inputs: factors of loads, constant meanwhile; loads that are not named keep theirs.

        A load of 1 N is so the force [N] of an actuator. Raises SceneError for unknown names, ConvergenceError where steps
        find no solution.
        """
        if not isinstance(state, MovingState):
            raise SceneError(
                f"step: state = {show(state)}: start from step.start, and go on with what step returned"
            )
        if not isinstance(inputs, Mapping):
            raise SceneError(f"step: inputs = {show(inputs)} must be factors of loads by name")
        given = dict(state._inputs)
        for name, value in inputs.items():
            if name not in self.loads:
                raise SceneError(
                    f"step: there is no load {show(name)}{name_hint(str(name), self.loads)} An input is a load of the "
                    "scene; an actuator is a load of 1 N on the link it pushes"
                )
            given[name] = number(value, f"step: input '{name}'")
        whole = positive(quantity(dt, "time", "step: dt"), "dt", owner="step", unit="s")
        motion, count = self._motion, max(1, math.ceil(whole / self.longest * (1.0 - 1e-9)))
        before, after = self._acting(state._inputs, state.t), self._acting(given, state.t)
        for _ in range(MAX_HALVINGS):
            state._saved.restore(motion)
            step = generalised_alpha(whole / count, self._rho)
            with suppress(Refused):
                if math.isnan(state._part):
                    motion.restart(step, is_pushed=True)
                elif given != state._inputs:
                    motion.push(step, before, after)
                taken, reason = motion.take(step, count)
                if reason == CONVERGED:
                    return self._state(Run([taken.last], {}), given, step.dt)
            count *= 2
        raise ConvergenceError(
            f"step: no motion was found from t = {state.t:g} s on, with {count} parts of the step"
        )

    def _acting(self, inputs: Mapping[str, float], t: float) -> Any:
        """Set the factors of the loads to inputs, and give loads and gravity at an instant."""
        self._motion.factors = [
            Constant(inputs[name], start=inputs[name]) if name in inputs else f for name, f in self._factors
        ]
        return self._motion.acting(np.array([t]))


@clear_argument_errors
def stepper(
    mechanism: Mechanism | Scene,
    *,
    longest: float | str | None = None,
    drives: Mapping[str, Any] | None = None,
    loads: Mapping[str, Any] | None = None,
    base: Shake | None = None,
    start: str | Configuration = "equilibrium",
    speeds: Mapping[str, Any] | None = None,
    damping_at: float | str | None = None,
    rho: float = 0.8,
    mass_at_ends: bool = False,
    mesh: Mesh | None = None,
) -> Stepper:
    """A callable ``step(state, inputs, dt)`` that moves a mechanism on in time; ``step.start`` is the first state.

    Inputs are factors of loads. longest [s]: longest part of a step, a hundredth of the longest free period when None.
    Others are as in `ksd.simulate`; drives that are None are let go.
    Raises SceneError for bad input, ConvergenceError where there is no equilibrium to start from.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> push = ksd.Cycloid(5 * mm, duration=20e-3)
    >>> step = ksd.stepper(guide, longest="0.5 ms", drives={"table": push})
    >>> state = step(step.start, {}, 10e-3)
    >>> print(f"{state.t} s: {state.drives['table'].value[0] / mm:.2f} mm")
    0.01 s: 2.50 mm
    """
    scene = mechanism.scene() if isinstance(mechanism, Mechanism) else mechanism
    if not isinstance(scene, Scene):
        raise SceneError(f"stepper: {show(mechanism)} is no mechanism")
    made = Simulation(
        until=1.0, drives=drives or {}, loads=loads or {}, base=base, start=start, speeds=speeds or {},
        damping_at=damping_at, rho=rho, mass_at_ends=mass_at_ends,
    )  # fmt: skip
    made.check(scene)
    part = (
        None
        if longest is None
        else positive(quantity(longest, "time", "longest"), "longest", owner="stepper", unit="s")
    )
    return Stepper(scene, made, part, mesh)
