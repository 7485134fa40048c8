"""The record of a solve: steps, stop reasons, error estimate and verdict."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from ksd.model.newton import RTOL

MAX_TURN_PER_STEP = 0.3
"""Largest rotation [rad] of a node in one Newton iteration after the predictor."""

EITHER_SIDE = (
    "where it is symmetric, a small push picks the side: ksd.solve(..., side=1) or side=-1; "
    "or go along the path (ksd.follow)"
)
"""What to do about a state between two others, in words."""


class Stop(IntEnum):
    """Stop reasons of the compiled solvers; the numbers are those that the kernels return."""

    CONVERGED = 0
    TOO_MANY = 1
    LOCAL_ANGLE = 2
    SINGULAR = 3
    DIVERGED = 4
    NOT_FINITE = 5
    MOVING = 6
    JAMMED = 7
    PASSED = 8
    NO_PLACE = 9

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
    Stop.JAMMED: "no contact forces hold the mechanism there: an object slides out of its contacts, or stops, cables and "
    "drives contradict one another",
    Stop.PASSED: "surfaces in contact would pass through one another in one step",
    Stop.NO_PLACE: "the place where a surface touches a leaf spring was not found",
    Stop.MOVING: "this is an instant of a motion, and no equilibrium",
}


class Step(NamedTuple):
    """One step of a solve.

    iterations: Newton iterations (factorisations); time: thread time [s]; residual: largest residual over its bound (of step
    1: largest loop gap [m]); stop: stop reason; note: remark printed with the step; chosen: of the last step, why the method
    was chosen where none was named.
    """

    name: str
    iterations: int
    time: float
    residual: float
    stop: Stop
    note: str = ""
    chosen: str = ""

    @property
    def reason(self) -> str:
        """Why the step stopped, in one sentence."""
        if self.stop != Stop.CONVERGED:
            return Stop(self.stop).sentence
        if self.name.startswith("1 "):
            return "loops closed"
        if self.name == "error estimate":
            return "steps of the full model, not iterated to equilibrium"
        if self.residual <= 1.0:
            return Stop.CONVERGED.sentence
        return (
            f"equilibrium reached: the last step moved nothing, the residual of {self.residual:.2g} times its bound is what "
            "rounding leaves in the stiff directions"
        )


def equilibrium_steps(steps: Iterable[Step]) -> list[Step]:
    """The steps of the five that iterate to an equilibrium, 3 and 5."""
    return [s for s in steps if s.name[0] in "35"]


def equilibrium_iterations(steps: Iterable[Step]) -> int:
    """The largest number of Newton iterations of one of the `equilibrium_steps`."""
    return max((s.iterations for s in equilibrium_steps(steps)), default=0)


DEFAULT_ACCURACY = 1e-3
"""Relative accuracy that is wanted where none is named."""
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

    def plus(self, other: ErrorEstimate, factor: float) -> ErrorEstimate:
        """The sum of this estimate and a multiple of another; `mesh` is that of this one."""
        return ErrorEstimate(
            self.force + factor * other.force, self.displacement + factor * other.displacement,
            self.rotation + factor * other.rotation, self.relative + factor * other.relative, self.mesh,
        )  # fmt: skip

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
