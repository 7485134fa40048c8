"""A linear state-space model (A, B, C, D) about a deformed, loaded pose: drive forces in, drive motions out.

In modal coordinates x = (eta, eta') with unit modal mass: eta'' + 2 zeta omega eta' + omega^2 eta = Phi^T f and
y = Phi eta + D f. D is the compliance of the truncated modes (exact static compliance less that of the retained modes), so
the gain at zero frequency is that of the full model (residual flexibility; Craig and Kurdila, Fundamentals of Structural
Dynamics, 2006). A motion without stiffness is a mode of 0 Hz, a double integrator.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.checks import clear_argument_errors, names_of, not_negative, show, whole_number
from ksd.design.questions import DRIVE_VALUE_UNITS
from ksd.design.table import write_mat
from ksd.errors import SceneError
from ksd.properties.printing import PrintableAnswer, format_number, format_table
from ksd.properties.tangent import assemble_and_factor
from ksd.solve.answer import drive_kind
from ksd.solve.configuration import Configuration
from ksd.solve.nonconservative_stability import MAX_DAMPED_SKEW_SHARE

Array = NDArray[np.float64]


@dataclass(frozen=True, repr=False)
class StateSpace(PrintableAnswer):
    """State-space model x' = A x + B u, y = C x + D u about a pose.

    u: force or moment of every freed drive in addition to that at the pose [N or Nm]; y: its motion from the pose [m or
    rad]; x (2k,): modal amplitudes [m kg^0.5] and their rates. drives, input_units, output_units: names and units of the
    entries of u and y; frequency_Hz (k,): frequencies of the modes; pose: drive values [m or rad].
    """

    A: Array
    B: Array
    C: Array
    D: Array
    drives: tuple[str, ...]
    input_units: tuple[str, ...]
    output_units: tuple[str, ...]
    frequency_Hz: Array
    pose: dict[str, float]

    def _line(self) -> str:
        return f"{len(self.A)} states, drives {', '.join(self.drives)}"

    def __str__(self) -> str:
        gain = self._static_gain()
        rows = [
            (f"{n} [{o}]", *(format_number(g, 5) for g in row))
            for n, o, row in zip(self.drives, self.output_units, gain, strict=True)
        ]
        at = ", ".join(
            f"{n} = {v:.6g} {u}" for (n, v), u in zip(self.pose.items(), self.output_units, strict=False)
        )
        return format_table(
            ("motion", *(f"{n} [{u}]" for n, u in zip(self.drives, self.input_units, strict=True))),
            rows,
            f"State-space model about {at}: {len(self.A)} states",
            f"Modes of {', '.join(format_number(f) for f in self.frequency_Hz)} Hz",
            "Gain at zero frequency, motion of a row per force or moment of a column:",
        )

    def _static_gain(self) -> Array:
        """Gain at zero frequency; infinite where a force moves a drive without resistance."""
        k = len(self.frequency_Hz)
        rigid, phi = self.frequency_Hz == 0.0, self.C[:, :k]
        elastic = phi[:, ~rigid]
        unbounded = phi[:, rigid] @ phi[:, rigid].T
        finite = (elastic / -self.A[k:, :k].diagonal()[~rigid]) @ elastic.T + self.D
        # rounding, relative to the drives
        unbounded[np.abs(unbounded) <= 1e-12 * np.abs(phi @ phi.T)] = 0.0
        return np.where(unbounded == 0.0, finite, np.copysign(np.inf, unbounded))

    def response(self, frequency_Hz: Any) -> Array:
        """Complex frequency response (n, outputs, inputs) at frequencies (n,) [Hz]."""
        eye = np.eye(len(self.A))
        points = 2j * np.pi * np.atleast_1d(np.asarray(frequency_Hz, float))
        response: Array = np.array(
            [self.C @ np.linalg.solve(s * eye - self.A, self.B) + self.D for s in points]
        )
        return response

    def to_mat(self, path: str | os.PathLike[str]) -> Path:
        """Write A, B, C, D, names and units for MATLAB: ``load file; sys = ss(A, B, C, D)``. Returns the path."""
        numbers = {"A": self.A, "B": self.B, "C": self.C, "D": self.D, "frequency_Hz": self.frequency_Hz}
        texts = {"drives": self.drives, "input_units": self.input_units, "output_units": self.output_units}
        named = {k: np.array(v, dtype=object) for k, v in texts.items()}
        values = np.array([self.pose.get(d, 0.0) for d in self.drives])
        return write_mat(path, {**numbers, **named, "pose": values})


@clear_argument_errors
def state_space(
    pose: Configuration, *, modes: int = 6, damping: float = 0.01, drives: Iterable[str] | None = None
) -> StateSpace:
    """State-space model of a `Configuration`, returned as a `StateSpace`.

    modes: number of lowest modes; damping: modal damping ratio zeta of every mode. drives: those released and used as
    inputs and outputs, all when None; the others stay fixed. Raises SceneError for names, modes or damping out of range,
    for a scene without mass, and under loads that are not conservative.
    """
    if not isinstance(pose, Configuration):
        raise SceneError(f"pose = {show(pose)} is no configuration; give what ksd.solve returns.")
    known = pose.model.drive_names
    freed = tuple(known) if drives is None else names_of(drives, "drives")
    if not freed or any(d not in known for d in freed):
        raise SceneError(f"drives = {freed}: name drives to be let go, out of {', '.join(known) or 'none'}")
    if not not_negative(damping, "damping") < 1.0:
        raise SceneError(f"damping = {damping}: a ratio from 0 to below 1 is needed")
    lowest_modes = pose.frequencies(count=whole_number(modes, "modes"), freed=freed)
    if (
        not lowest_modes.conservative
        and assemble_and_factor(*pose.unreduced_state, load_factor=pose.load_factor).skew_share()
        > MAX_DAMPED_SKEW_SHARE
    ):
        raise SceneError(
            "state_space: the loads follow their link or are moments fixed in space, and not conservative: modes are "
            "no basis of a linear model then; take those loads off, or put them on as forces that keep their direction"
        )
    columns = [list(known).index(d) for d in freed]
    phi, squared = lowest_modes.drive_motion[:, columns].T, lowest_modes.omega_squared
    k = len(squared)
    A = np.zeros((2 * k, 2 * k))
    A[:k, k:] = np.eye(k)
    A[k:, :k] = -np.diag(squared)
    A[k:, k:] = -np.diag(2 * damping * np.sqrt(np.abs(squared)))
    B = np.vstack([np.zeros((k, len(freed))), phi.T])
    C = np.hstack([phi, np.zeros((len(freed), k))])
    elastic = squared != 0.0
    order = np.argsort(np.argsort(columns))
    D = (
        lowest_modes.drive_compliance[np.ix_(order, order)]
        - (phi[:, elastic] / squared[elastic]) @ phi[:, elastic].T
    )
    kinds = {d.name: drive_kind(d) for d in pose.model.scene.drives}
    inputs = tuple({"translation": "N", "rotation": "Nm"}.get(kinds[d], "SI") for d in freed)
    outputs = tuple({"mm": "m", "deg": "rad"}.get(DRIVE_VALUE_UNITS[kinds[d]][0], "SI") for d in freed)
    return StateSpace(
        A, B, C, 0.5 * (D + D.T), freed, inputs, outputs, lowest_modes.frequency_Hz.copy(), dict(pose.targets)
    )
