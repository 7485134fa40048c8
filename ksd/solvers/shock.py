"""Shock about a pose: the response of sensors to a pulse of base acceleration or of a force, and its response spectrum.

The modal equations are integrated exactly for an input that is straight between steps (first-order hold), so that the step
need only follow the pulse and the modes, not keep an integrator stable.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from ksd.answers.plant import Plant
from ksd.answers.printing import PrintableAnswer, format_number, format_table
from ksd.checks import show
from ksd.errors import SceneError
from ksd.scene.functions_of_time import HalfSine, TimeTable

Array = NDArray[np.float64]
STEPS_PER_PULSE = 200
"""Least number of steps in a pulse."""
STEPS_PER_PERIOD = 40
"""Steps in the shortest period of the modes that the pulse reaches."""
REACH = 20.0
"""Modes up to so many times the reciprocal of the duration are resolved; above, they follow the pulse statically."""
RINGING_PERIODS = 3.0
"""Time after the pulse, in periods of the lowest mode, at which responses are largest at the latest."""
MAX_STEPS = 200_000
"""Largest number of steps, of the pulse and of what follows."""


@dataclass(frozen=True, repr=False)
class Shock(PrintableAnswer):
    """Response to a pulse.

    t (n,) [s]; value (n, outputs): readings of sensors and drives; outputs, units (outputs,). pulse (n,): the input, named
    source. spectrum (m, 2): frequency [Hz] and largest absolute acceleration of an oscillator of it with the damping of the
    lowest mode (shock response spectrum).
    """

    t: Array
    value: Array
    pulse: Array
    source: str
    outputs: tuple[str, ...]
    units: tuple[str, ...]
    spectrum: Array

    @property
    def largest(self) -> dict[str, float]:
        """Largest magnitude of every output."""
        return dict(zip(self.outputs, np.abs(self.value).max(axis=0).tolist(), strict=True))

    def _line(self) -> str:
        return ", ".join(
            f"{n} {format_number(v)} {u}" for (n, v), u in zip(self.largest.items(), self.units, strict=True)
        )

    def __str__(self) -> str:
        at = self.t[np.abs(self.value).argmax(axis=0)]
        rows = [
            (n, format_number(v), u, f"{1e3 * float(t):.4g}")
            for (n, v), u, t in zip(self.largest.items(), self.units, at, strict=True)
        ]
        return format_table(
            ("output", "largest", "<unit", "at [ms]"),
            rows,
            f"Response to a pulse of '{self.source}' of {format_number(float(np.abs(self.pulse).max()))}",
        )


def check_pulse(pulse: Any) -> HalfSine | TimeTable:
    """A pulse: a HalfSine, or points (t [s], value). Raises SceneError."""
    if isinstance(pulse, HalfSine | TimeTable):
        return pulse
    if isinstance(pulse, list | tuple | np.ndarray):
        return TimeTable(pulse, held=False)  # type: ignore[arg-type]
    raise SceneError(
        f"pulse = {show(pulse)}: give ksd.HalfSine(amplitude=, duration=), or points (t [s], value)"
    )


def shake(plant: Plant, pulse: HalfSine | TimeTable) -> Shock:
    """Response of a plant with one input to a pulse of it, and while it rings."""
    A, B, C, D = plant.state_space()
    f = plant.frequency_Hz[plant.frequency_Hz > 0.0]
    reached = f[f < REACH / pulse.duration]
    ringing = RINGING_PERIODS / f[0] if len(f) else 0.0
    period = 1.0 / reached[-1] if len(reached) else np.inf
    # steps that follow the pulse, then longer ones that follow the modes
    during = _even_steps(pulse.duration, min(pulse.duration / STEPS_PER_PULSE, period / STEPS_PER_PERIOD))
    after = _even_steps(ringing, period / STEPS_PER_PERIOD) if len(reached) else np.zeros(0)
    if len(during) + len(after) > MAX_STEPS:
        raise SceneError(
            f"shock: a pulse of {pulse.duration:.3g} s and modes down to {f[0]:.3g} Hz need {len(during) + len(after)} "
            "steps; take fewer modes"
        )
    t = np.concatenate([[0.0], during, pulse.duration + after])
    u = pulse(t)
    x = _first_order_hold(A, B[:, 0], u[: len(during) + 1], pulse.duration / len(during))
    if len(after):
        later = _first_order_hold(A, B[:, 0], u[len(during) :], ringing / len(after), start=x[-1])
        x = np.concatenate([x, later[1:]])
    value = x @ C.T + u[:, None] * D[:, 0]
    ratio = float(plant.ratio[plant.frequency_Hz > 0.0][0]) if len(f) else 0.0
    return Shock(
        t, value, u, plant.inputs[0], plant.outputs, plant.output_units, response_spectrum(pulse, ratio)
    )


def _even_steps(end: float, longest: float) -> Array:
    """Ends (n,) of equal steps up to `end`, none longer than `longest`."""
    count = max(1, int(np.ceil(end / longest)))
    return np.asarray(end / count * np.arange(1, count + 1))


def _first_order_hold(A: Array, b: Array, u: Array, step: float, start: Any = 0.0) -> Array:
    """States (n, k) of x' = A x + b u from `start`, exact for u (n,) straight between steps."""
    k = len(A)
    # x, u and its slope as one autonomous system (Van Loan, Computing integrals involving the matrix exponential, 1978)
    whole = np.zeros((k + 2, k + 2))
    whole[:k, :k], whole[:k, k] = A * step, b * step
    whole[k, k + 1] = 1.0
    E = expm(whole)
    F, at_start, by_slope = E[:k, :k], E[:k, k], E[:k, k + 1]
    forced = np.outer(u[:-1], at_start) + np.outer(np.diff(u), by_slope)
    x = np.zeros((len(u), k))
    x[0] = start
    for n, drive in enumerate(forced):
        x[n + 1] = F @ x[n] + drive
    return x


def response_spectrum(pulse: HalfSine | TimeTable, ratio: float, *, points: int = 60) -> Array:
    """Frequency [Hz] and largest absolute acceleration (points, 2) of an oscillator whose base follows a pulse."""
    f = np.geomspace(0.05, 20.0, points) / pulse.duration
    largest = []
    for one in f:
        w = 2.0 * np.pi * one
        A = np.array([[0.0, 1.0], [-w * w, -2.0 * ratio * w]])
        step = min(pulse.duration / STEPS_PER_PULSE, 1.0 / (STEPS_PER_PERIOD * one))
        t = np.arange(0.0, pulse.duration + 1.0 / one, step)
        x = _first_order_hold(A, np.array([0.0, -1.0]), pulse(t), step)
        largest.append(np.abs(x @ A[1]).max())
    return np.column_stack([f, largest])
