"""How far reduced solids can be believed: their error inside a mechanism, and the range of a basis."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ksd.beam.modal import modal_sizes
from ksd.beam.polynomial import polynomial_condense
from ksd.errors import ConvergenceError, SceneError
from ksd.modal.bodies import member_pose
from ksd.modal.solid_body import SolidBasis
from ksd.modal.solid_solve import Pressed, indicator, press_reduced
from ksd.model.arrays import Motion
from ksd.model.compile import Model

FAR, STEPS, HALVINGS = 0.8, 8, 4
"""Linear stroke over the length up to which a range is tried, in how many steps, and halvings of the last one at least."""


def solid_errors(model: Model, motion: Motion, solids: Mapping[str, SolidBasis]) -> dict[str, float]:
    """Error of every solid of `with_solids` at a state: its full model under the force and moment it exerts there.

    Relative, of the displacement of its face B seen from face A; inf where the full model does not settle: beyond
    `ksd.modal.solid_solve.SUCCESSFUL` a basis is no longer successful. Raises SceneError for unknown names.
    """
    members, found = model.arrays.members, {}
    for name, body in solids.items():
        if name not in model.member_names:
            raise SceneError(f"there is no solid '{name}'; the leafs are: {', '.join(model.member_names)}")
        i = model.member_names.index(name)
        d, R = member_pose(members, i, motion)
        eta = motion.inner[members.inner_at[i] : members.inner_at[i + 1]].copy()
        lam, K = np.zeros(12), np.zeros((6, 6))
        polynomial_condense(body.value, body.number, eta, np.zeros(modal_sizes(len(eta))[1]), d, R, lam, K)
        found[name] = indicator(body, d, R, eta, lam[:6])
    return found


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


__all__ = ["SolidRange", "solid_errors", "solid_range"]
