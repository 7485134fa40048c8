"""The record of a solve: steps, stop reasons, error estimate and verdict."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

from ksd.model.newton import RTOL

MAX_TURN_PER_STEP = 0.3
"""Largest rotation [rad] of a node in one Newton iteration after the predictor."""


class Stop(IntEnum):
    """Stop reasons of the compiled solvers; the numbers are those that the kernels return."""

    CONVERGED = 0
    TOO_MANY = 1
    LOCAL_ANGLE = 2
    SINGULAR = 3
    DIVERGED = 4
    NOT_FINITE = 5

    @property
    def sentence(self) -> str:
        """The reason as a sentence."""
        return _SENTENCES[self]


_SENTENCES = {
    Stop.CONVERGED: "equilibrium reached: every residual is within its bound",
    Stop.TOO_MANY: "the iteration limit was reached before equilibrium",
    Stop.LOCAL_ANGLE: "an element turned more than 60 degrees relative to its chord, beyond what the Appendix A element can "
    "represent; use more elements per leaf, or strain-mode leaf springs (no mesh=)",
    Stop.SINGULAR: "the stiffness matrix is singular: something can move without resistance at this state",
    Stop.DIVERGED: "the residual exceeded eps_max, so the step was given up",
    Stop.NOT_FINITE: "a number overflowed: the last step left the region where the equations make sense",
}


class Step(NamedTuple):
    """One step of a solve.

    iterations: Newton iterations (factorisations); time: thread time [s]; residual: largest residual over its bound (of step
    1: largest loop gap [m]); stop: stop reason; note: remark printed with the step.
    """

    name: str
    iterations: int
    time: float
    residual: float
    stop: Stop
    note: str = ""

    @property
    def reason(self) -> str:
        """Why the step stopped, in one sentence."""
        if self.stop != Stop.CONVERGED:
            return Stop(self.stop).sentence
        if self.name.startswith("1 "):
            return "loops closed"
        if self.name == "error estimate":
            return "looked at, not iterated"
        if self.residual <= 1.0:
            return Stop.CONVERGED.sentence
        return (
            f"equilibrium reached: the last step moved nothing, the residual of {self.residual:.2g} times its bound is what "
            "rounding leaves in the stiff directions"
        )


FAST_METHODS = ("kinematic", "reduced", "modal", "constant")
"""Methods whose states are not equilibria of the full model."""


@dataclass(frozen=True)
class ErrorEstimate:
    """Estimated error of a result: that of a fast method, by corrector steps of the full model, or the total error.

    force (drives,): error of the drive forces [N or Nm]; displacement [m], rotation [rad]: largest error of any link;
    relative: the larger of force error over force and displacement error over displacement; mesh: the same of the mesh
    alone, 0 where it was not estimated. All are inf where the error is not known: corrector steps grow, or no equilibrium is
    found on a finer mesh.
    """

    force: np.ndarray
    displacement: float
    rotation: float
    relative: float
    mesh: float = 0.0

    @staticmethod
    def unknown(drives: int, *, mesh: float = 0.0) -> ErrorEstimate:
        """The estimate where the error of a model with so many drives is not known."""
        return ErrorEstimate(np.full(drives, np.inf), np.inf, np.inf, np.inf, mesh)

    def __str__(self) -> str:
        if not np.isfinite(self.relative):
            return "not known"
        if self.relative <= RTOL:
            return f"{percent(self.relative)} %"
        links = f"links within {_two_digits(1e6 * self.displacement)} um and {_two_digits(1e3 * self.rotation)} mrad"
        of_mesh = f", of which mesh {percent(self.mesh)} %" if self.mesh > 0.0 else ""
        return f"{percent(self.relative)} %{of_mesh} ({links})"


def percent(error: float) -> str:
    """A relative error in percent; below the tolerance RTOL of the residual, "under" that tolerance."""
    return _two_digits(100 * error) if error > RTOL else f"under {100 * RTOL:.0e}"


def _two_digits(value: float) -> str:
    """A number with two significant digits, without an exponent where it is large."""
    return f"{value:.2g}" if value < 99.5 else f"{value:.0f}"


@dataclass(frozen=True)
class Verdict:
    """Yes or no, and why in one sentence."""

    yes: bool
    sentence: str

    def __bool__(self) -> bool:
        return self.yes

    def __str__(self) -> str:
        return self.sentence


_STEP_NAMES = ("1 close loops", "2 joint stiffness", "3 reduced equilibrium", "4 recovery")


class StepRow(NamedTuple):
    """Numbers of one of the five steps: stop reason, iterations, residual over its bound (step 1: loop gap [m]; step 4:
    largest unintended displacement [m]), thread time [s], and largest unintended rotation [rad] (step 4)."""

    stop: int
    iterations: int
    residual: float
    time: float
    rotation: float = 0.0


class FiveStepRecord(Sequence[Step]):
    """The steps of a solve by the five-step method; each row is made a `Step` when it is read.

    rows: one for each step, in order; relinearisations: relinearisation steps; along_drive: whether step 1 was taken along
    the drive. later_steps: steps after the five, assigned when they are done.
    """

    def __init__(self, rows: list[StepRow], relinearisations: int, *, along_drive: bool = False) -> None:
        self.rows, self.relinearisations, self.along_drive = rows, relinearisations, along_drive
        self.later_steps: tuple[Step, ...] = ()

    def __len__(self) -> int:
        return len(self.rows) + len(self.later_steps)

    def __getitem__(self, k: Any) -> Any:
        if isinstance(k, slice):
            return tuple(self._step(n) for n in range(*k.indices(len(self))))
        if not -len(self) <= k < len(self):
            raise IndexError(f"step {k}: there are {len(self)}")
        return self._step(k % len(self))

    def __iter__(self) -> Iterator[Step]:
        return iter(self[:])

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Sequence) and self[:] == tuple(other)

    def __repr__(self) -> str:
        return repr(self[:])

    @property
    def last_stop(self) -> Stop:
        """Stop reason of the last step."""
        return self.later_steps[-1].stop if self.later_steps else Stop(self.rows[-1].stop)

    def _step(self, k: int) -> Step:
        """Step k with its name and note."""
        if k >= len(self.rows):
            return self.later_steps[k - len(self.rows)]
        row = self.rows[k]
        kind = 0 if k == 0 else 1 + (k - 1) % 3
        name = _STEP_NAMES[kind] if k <= 3 * (self.relinearisations + 1) else "5 full equilibrium"
        residual, note = row.residual, ""
        if name is _STEP_NAMES[0]:
            note = "in steps along the drive" if self.along_drive else f"gap {residual:.1e} m"
        elif name is _STEP_NAMES[3]:
            note, residual = f"moved {residual:.1e} m, {row.rotation:.1e} rad", 0.0
        return Step(name, int(row.iterations), row.time, residual, Stop(row.stop), note)
