"""A linear state-space model (A, B, C, D) about a deformed, loaded pose: drive forces in, drive motions out.

Modal: x = (eta, eta'), eta'' + 2 zeta omega eta' + omega^2 eta = Phi^T f with unit modal mass, y = Phi eta + D f. D is the
compliance of the modes left out (exact static compliance less that of the modes kept), so the gain at zero frequency
is that of the full model (residual flexibility; Craig and Kurdila, Fundamentals of Structural Dynamics, 2006).
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
    """x' = A x + B u, y = C x + D u. u: force or moment of every freed drive beyond its present one [N or Nm]; y: its
    motion from the pose [m or rad]; x (2k,): modal amplitudes [m kg^0.5] and their rates. drives, input_units,
    output_units name the entries of u and y; frequency_Hz (k,): of the modes; pose: drive values [m or rad]."""

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
        gain = self.C @ np.linalg.solve(-self.A, self.B) + self.D
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

    def response(self, frequency_Hz: Any) -> Array:
        """Complex frequency response (n, outputs, inputs) at frequencies (n,) [Hz]."""
        eye = np.eye(len(self.A))
        points = 2j * np.pi * np.atleast_1d(np.asarray(frequency_Hz, float))
        found: Array = np.array([self.C @ np.linalg.solve(s * eye - self.A, self.B) + self.D for s in points])
        return found

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
    """State-space model of a `Configuration` with its `modes` lowest modes, returned as a `StateSpace`.

    damping: modal damping ratio zeta of every mode. drives: those let go and used as inputs and outputs, all when None;
    the others stay held. Raises SceneError for names, modes or damping out of range, and for a scene without mass or under
    loads that are not conservative.
    """
    if not isinstance(pose, Configuration):
        raise SceneError(f"pose = {show(pose)} is no configuration; give what ksd.solve returns.")
    known = pose.model.drive_names
    freed = tuple(known) if drives is None else names_of(drives, "drives")
    if not freed or any(d not in known for d in freed):
        raise SceneError(f"drives = {freed}: name drives to be let go, out of {', '.join(known) or 'none'}")
    if not not_negative(damping, "damping") < 1.0:
        raise SceneError(f"damping = {damping}: a ratio from 0 to below 1 is needed")
    found = pose.frequencies(count=whole_number(modes, "modes"), freed=freed)
    if (
        not found.conservative
        and assemble_and_factor(*pose.unreduced_state, load_factor=pose.load_factor).skew_share()
        > MAX_DAMPED_SKEW_SHARE
    ):
        raise SceneError(
            "state_space: the loads follow their link or are moments fixed in space, and not conservative: modes are "
            "no basis of a linear model then; take those loads off, or put them on as forces that keep their direction"
        )
    columns = [list(known).index(d) for d in freed]
    phi, squared = found.drive_motion[:, columns].T, found.omega_squared
    k = len(squared)
    A = np.zeros((2 * k, 2 * k))
    A[:k, k:] = np.eye(k)
    A[k:, :k] = -np.diag(squared)
    A[k:, k:] = -np.diag(2 * damping * np.sqrt(np.abs(squared)))
    B = np.vstack([np.zeros((k, len(freed))), phi.T])
    C = np.hstack([phi, np.zeros((len(freed), k))])
    D = _static(pose, freed) - (phi / squared) @ phi.T
    by = {d.name: drive_kind(d) for d in pose.model.scene.drives}
    inputs = tuple({"translation": "N", "rotation": "Nm"}.get(by[d], "SI") for d in freed)
    outputs = tuple({"mm": "m", "deg": "rad"}.get(DRIVE_VALUE_UNITS[by[d]][0], "SI") for d in freed)
    return StateSpace(
        A, B, C, 0.5 * (D + D.T), freed, inputs, outputs, found.frequency_Hz.copy(), dict(pose.targets)
    )


def _static(pose: Any, freed: tuple[str, ...]) -> Array:
    """Static compliance (d, d) between the freed drives, the others held."""
    held = pose.drive_stiffness()
    pick = [held.names.index(d) for d in freed]
    inverse: Array = np.linalg.inv(held.matrix[np.ix_(pick, pick)])
    return inverse
