"""How far reduced solids can be believed: their error inside a mechanism, and the range of a basis."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ksd.beam.modal import modal_sizes
from ksd.beam.polynomial import polynomial_condense
from ksd.errors import ConvergenceError, SceneError
from ksd.modal.bodies import member_pose
from ksd.modal.solid_basis import SolidBasis
from ksd.modal.solid_solve import indicator, press_reduced
from ksd.model.arrays import Motion
from ksd.model.compile import Model

FAR, STEPS = 0.8, 8
"""Linear stroke over the length up to which a range is tried, and in how many steps."""


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
        unit = np.eye(6)[row]
        stroke[way] = turn[way] = 0.0
        for k in range(1, STEPS + 1):
            wrench = k / STEPS * load * unit
            try:
                found = press_reduced(body, wrench[:3], wrench[3:], strict=False)
            except ConvergenceError:
                break
            if not found.error <= error:
                break
            stroke[way] = float(np.linalg.norm(found.shift) / length)
            turn[way] = float(np.arccos(np.clip(0.5 * (np.trace(found.R) - 1.0), -1.0, 1.0)))
        else:
            beyond.append(way)
    return SolidRange(error, stroke, turn, tuple(beyond))


__all__ = ["SolidRange", "solid_errors", "solid_range"]
