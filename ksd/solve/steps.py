"""What a solve writes down: its steps, why each stopped, error estimates; and the bounds it works to."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np

RTOL = 1e-8
"""Residual of a node over the sum of the element forces on it (design section 5)."""
CAP = 0.3
"""Largest rotation [rad] of a node in one iteration after the predictor."""


class Stop(IntEnum):
    """Stop reasons of the compiled solvers; the numbers are those the kernels return."""

    CONVERGED = 0
    TOO_MANY = 1
    LOCAL_ANGLE = 2
    SINGULAR = 3
    DIVERGED = 4
    NOT_FINITE = 5

    @property
    def sentence(self) -> str:
        """The reason in words."""
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
    """One step of a solve: name, Newton iterations (factorisations), thread time [s], residual over its bound, reason."""

    name: str
    iterations: int
    time: float
    residual: float
    stop: Stop
    note: str = ""

    @property
    def reason(self) -> str:
        """Why it stopped, a sentence that fits its residual."""
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


FAST = ("kinematic", "reduced", "modal", "constant")
"""Methods whose states are not equilibria of the full model."""


@dataclass(frozen=True)
class ErrorEstimate:
    """Estimated error of an answer: what a fast method adds, by corrector steps of the full model, or all of it.

    force (drives,): N or Nm; displacement [m] and rotation [rad]: largest of any link; relative: the larger of force error
    over force and displacement error over displacement; mesh: that of the mesh alone, relative alike, 0 where it was not
    looked at. All inf where it is not known: corrector steps grow, or there is no equilibrium on a finer mesh.
    """

    force: np.ndarray
    displacement: float
    rotation: float
    relative: float
    mesh: float = 0.0

    def __str__(self) -> str:
        if not np.isfinite(self.relative):
            return "not known"
        if self.relative <= RTOL:
            return f"{percent(self.relative)} %"
        links = f"links within {_two(1e6 * self.displacement)} um and {_two(1e3 * self.rotation)} mrad"
        of_mesh = f", of which mesh {percent(self.mesh)} %" if self.mesh > 0.0 else ""
        return f"{percent(self.relative)} %{of_mesh} ({links})"


def percent(error: float) -> str:
    """A relative error in percent; the bound of a residual where it is less, and cannot be seen."""
    return _two(100 * error) if error > RTOL else f"under {100 * RTOL:.0e}"


def _two(value: float) -> str:
    """Two digits, or without an exponent where it is large."""
    return f"{value:.2g}" if value < 99.5 else f"{value:.0f}"


_NAMES = ("1 close loops", "2 joint stiffness", "3 reduced equilibrium", "4 recovery")


class FiveStepRecord(Sequence[Step]):
    """What the five steps wrote down, one row per step, as `Step`s; a row is put in words when it is looked at.

    rows: see `ksd.solve.space_steps.Rows`; relinearisations: rounds after the first. first: step 1 where it was done apart,
    without a row; more: steps after the five, put there when they are done.
    """

    def __init__(self, rows: list[list[float]], relinearisations: int, *, first: Step | None = None) -> None:
        # a row that `_step` leaves alone
        alone = [] if first is None else [[0.0, first.iterations, first.residual, first.time, 0.0]]
        self.rows, self.relinearisations, self.first = [*alone, *rows], relinearisations, first
        self.more: tuple[Step, ...] = ()

    def __len__(self) -> int:
        return len(self.rows) + len(self.more)

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
    def last(self) -> Stop:
        """Why the last step stopped."""
        if self.more:
            return self.more[-1].stop
        return Stop.CONVERGED if self.rows[-1][0] == 0.0 else Stop(int(self.rows[-1][0]))

    def wandered(self, most: int) -> bool:
        """Whether an equilibrium took more than `most` iterations."""
        return max([row[1] for row in self.rows]) > most

    def _step(self, k: int) -> Step:
        if k >= len(self.rows):
            return self.more[k - len(self.rows)]
        if k == 0 and self.first is not None:
            return self.first
        reason, count, residual, spent, twist = self.rows[k]
        kind = 0 if k == 0 else 1 + (k - 1) % 3
        name = _NAMES[kind] if k <= 3 * (self.relinearisations + 1) else "5 full equilibrium"
        note = f"gap {residual:.1e} m" if kind == 0 else ""
        if name is _NAMES[3]:
            note, residual = f"moved {residual:.1e} m, {twist:.1e} rad", 0.0
        return Step(name, int(count), spent, residual, Stop(int(reason)), note)
