"""How far the basis of a reduced solid can be believed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ksd.errors import ConvergenceError
from ksd.modal.solid_basis import SolidBasis
from ksd.modal.solid_solve import Pressed, press_reduced

FAR, STEPS, HALVINGS = 0.8, 8, 4
"""Linear stroke over the length up to which a range is tried, in how many steps, and halvings of the last one at least."""


@dataclass(frozen=True)
class SolidRange:
    """Strokes over the length and rotations of face B [rad] up to which a reduced solid stays within `error`, by way of
    loading: force across, moment; beyond: ways in which the limit lies further than was tried."""

    error: float
    stroke: dict[str, float]
    turn: dict[str, float]
    beyond: tuple[str, ...]
    solid: str = ""

    @property
    def sentence(self) -> str:
        """The range in words: the smallest of all ways."""
        at = min(self.stroke.values()), np.rad2deg(min(self.turn.values()))
        name = f"solid '{self.solid}'" if self.solid else "the solid"
        return f"{name} is within {100 * self.error:g} % to a stroke of {at[0]:.2g} L and {at[1]:.2g} degrees"


def solid_range(body: SolidBasis, *, error: float = 0.01) -> SolidRange:
    """The range of a reduced solid, face A held: loads raised until the indicator passes `error`."""
    length, plane = body.solid.length, np.ix_([1, 5], [1, 5])
    rest = press_reduced(body, np.zeros(3), np.zeros(3), steps=1)
    soft = np.linalg.inv(rest.stiffness[plane])
    stroke, turn, beyond = {}, {}, []
    for way, row, load in (
        ("across", 1, FAR * length / soft[0, 0]),
        ("turned", 5, FAR / soft[1, 1]),
    ):
        unit, high = np.eye(6)[row], math.inf
        stroke[way] = turn[way] = low = 0.0
        for k in range(1, STEPS + HALVINGS + 1):
            share = k / STEPS if math.isinf(high) else 0.5 * (low + high)
            found = _within(body, share * load * unit, error)
            if found is None:
                high = share
                continue
            low, stroke[way] = share, float(np.linalg.norm(found.shift) / length)
            turn[way] = float(np.arccos(np.clip(0.5 * (np.trace(found.R) - 1.0), -1.0, 1.0)))
            if low == 1.0:
                beyond.append(way)
                break
    return SolidRange(error, stroke, turn, tuple(beyond))


def _within(body: SolidBasis, wrench: np.ndarray, error: float) -> Pressed | None:
    """The state under a load, None where its error is beyond `error` or there is none."""
    try:
        found = press_reduced(body, wrench[:3], wrench[3:], strict=False)
    except ConvergenceError:
        return None
    return found if found.error <= error else None


__all__ = ["SolidRange", "solid_range"]
