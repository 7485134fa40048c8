"""A linear state-space model (A, B, C, D) about a deformed, loaded pose, from drive forces, loads and a shaken base to drive
motions and sensors.

It is the modal model of `ksd.answers.plant`, x = (eta, eta') with unit modal mass: eta'' + 2 zeta omega eta' + omega^2
eta = Phi^T f and y = Phi eta + D f. D is the compliance of the truncated modes, so the gain at zero frequency is that of the
full model (residual flexibility; Craig and Kurdila, Fundamentals of Structural Dynamics, 2006). A motion without stiffness
is a mode of 0 Hz, a double integrator.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.answers.plant import Damping
from ksd.answers.printing import PrintableAnswer, format_number, format_table
from ksd.checks import clear_argument_errors, names_of, show, whole_number
from ksd.errors import SceneError
from ksd.solvers.configuration import Configuration
from ksd.study.table import write_mat

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class StateSpace(PrintableAnswer):
    """State-space model x' = A x + B u, y = C x + D u about a pose.

    u: inputs, forces of freed drives in addition to those at the pose [N or Nm], factors of loads, or accelerations of the
    base; y: outputs, drive motions from the pose [m or rad] and sensors; x (2k,): modal amplitudes [m kg^0.5] and their
    rates. inputs, outputs, input_units, output_units: their names and units; frequency_Hz (k,): of the modes; static_gain
    (outputs, inputs): at zero frequency, infinite where nothing resists; pose: drive values [m or rad]; freed: released
    drives.
    """

    A: Array
    B: Array
    C: Array
    D: Array
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    frequency_Hz: Array
    static_gain: Array
    pose: dict[str, float]
    freed: tuple[str, ...]

    def _line(self) -> str:
        return f"{len(self.A)} states, {', '.join(self.inputs)} to {', '.join(self.outputs)}"

    def __str__(self) -> str:
        rows = [
            (f"{n} [{o}]", *(format_number(g, 5) for g in row))
            for n, o, row in zip(self.outputs, self.output_units, self.static_gain, strict=True)
        ]
        at = ", ".join(f"{n} = {v:.6g}" for n, v in self.pose.items())
        return format_table(
            ("output", *(f"{n} [{u}]" for n, u in zip(self.inputs, self.input_units, strict=True))),
            rows,
            f"State-space model about {at}: {len(self.A)} states",
            f"Modes of {', '.join(format_number(f) for f in self.frequency_Hz)} Hz",
            "Gain at zero frequency, output of a row per input of a column:",
        )

    def response(self, frequency_Hz: Any) -> Array:
        """Complex frequency response (n, outputs, inputs) at frequencies (n,) [Hz]."""
        eye = np.eye(len(self.A))
        points = 2j * np.pi * np.atleast_1d(np.asarray(frequency_Hz, float))
        response: Array = np.array(
            [self.C @ np.linalg.solve(s * eye - self.A, self.B) + self.D for s in points]
        )
        return response

    def to_scipy(self) -> Any:
        """The model as `scipy.signal.StateSpace`."""
        from scipy.signal import StateSpace as Scipy

        return Scipy(self.A, self.B, self.C, self.D)

    def to_mat(self, path: str | os.PathLike[str]) -> Path:
        """Write A, B, C, D, names and units for MATLAB: ``load file; sys = ss(A, B, C, D)``. Returns the path."""
        numbers = {"A": self.A, "B": self.B, "C": self.C, "D": self.D, "frequency_Hz": self.frequency_Hz}
        names = ("inputs", "outputs", "input_units", "output_units", "freed")
        texts = {key: np.array(getattr(self, key), dtype=object) for key in names}
        values = {"drives": np.array(list(self.pose), dtype=object), "pose": np.array([*self.pose.values()])}
        return write_mat(path, {**numbers, **texts, **values})


@clear_argument_errors
def state_space(
    pose: Configuration,
    *,
    modes: int = 6,
    damping: Damping | None = None,
    drives: Iterable[str] | None = None,
    inputs: str | Iterable[str] | None = None,
    outputs: str | Iterable[str] | None = None,
) -> StateSpace:
    """State-space model of a `Configuration`, returned as a `StateSpace`.

    modes: number of lowest modes; inputs, outputs, damping: as in `Configuration.response`, but that outputs are all drives
    when None. drives: those released, also where inputs and outputs are None; those among inputs and outputs when None, and
    all where these are None, too; the others stay fixed. Raises SceneError for names, modes or damping out of range, for a
    scene without mass, and under loads that are not conservative; KinematicsError for an unstable pose.

    >>> guide, stroke, _ = ksd.load_scene("guide")
    >>> plant = ksd.state_space(ksd.solve(guide, stroke), modes=2)
    >>> plant.A.shape, plant.frequency_Hz.round(1)
    ((4, 4), array([ 7.1, 60.8]))
    """
    if not isinstance(pose, Configuration):
        raise SceneError(f"pose = {show(pose)} is no configuration; give what ksd.solve returns.")
    known = pose.model.drive_names
    freed = None if drives is None else names_of(drives, "drives")
    if freed is not None and (not freed or any(d not in known for d in freed)):
        raise SceneError(f"drives = {freed}: name drives to be let go, out of {', '.join(known) or 'none'}")
    every = known if freed is None else freed
    plant = pose.plant(
        inputs=every if inputs is None else inputs, outputs=every if outputs is None else outputs, damping=damping,
        modes=whole_number(modes, "modes"), freed=freed,
    )  # fmt: skip
    A, B, C, D = plant.state_space()
    return StateSpace(
        A, B, C, D, plant.inputs, plant.outputs, plant.input_units, plant.output_units, plant.frequency_Hz.copy(),
        plant.static_gain(), dict(pose.targets), plant.freed,
    )  # fmt: skip
