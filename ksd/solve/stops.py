"""Why a solve stopped: a closed list, each with a full sentence."""

from __future__ import annotations

from enum import IntEnum


class Stop(IntEnum):
    """Stop reasons of the compiled solvers; the numbers are those the kernels return."""

    CONVERGED = 0
    TOO_MANY = 1
    LOCAL_ANGLE = 2
    SINGULAR = 3
    DIVERGED = 4
    NOT_FINITE = 5
    SMALLEST_STEP = 6

    @property
    def sentence(self) -> str:
        """The reason in words."""
        return _SENTENCES[self]


_SENTENCES = {
    Stop.CONVERGED: "equilibrium reached: every residual is within its bound",
    Stop.TOO_MANY: "the iteration limit was reached before equilibrium",
    Stop.LOCAL_ANGLE: "an element turned more than 60 degrees relative to its chord, beyond what the Appendix A element can "
    "represent; use more elements per leaf or leaf='strain'",
    Stop.SINGULAR: "the stiffness matrix is singular: something can move without resistance at this state",
    Stop.DIVERGED: "the residual exceeded eps_max, so the step was given up",
    Stop.NOT_FINITE: "a number overflowed: the last step left the region where the equations make sense",
    Stop.SMALLEST_STEP: "the drive step was halved to its smallest size without reaching equilibrium",
}
