"""Solids in full beside a state of the reduced ones: the error of their bases, and the equilibrium next to the state.

Corrector steps of the full model: every solid is condensed, whole, to its face B at the state found, the mechanism comes to
equilibrium on these linear bodies, and each solid follows to where its faces went. That is Newton's method of the mechanism
of full solids; how far it leads is the error of forces and poses.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ksd.errors import ConvergenceError, SceneError
from ksd.modal.bodies import member_pose
from ksd.modal.solid_basis import SolidModel
from ksd.modal.solid_body import displaced
from ksd.modal.solid_health import SolidRange, solid_range
from ksd.modal.solid_solve import MOST_CORRECTORS, SETTLED, FullSolid
from ksd.model.arrays import LINEAR, Arrays, Motion, make_work
from ksd.model.compile import Model
from ksd.numerics.stopwatch import Stopwatch
from ksd.properties.tangent import exact
from ksd.solve.driving import CAP
from ksd.solve.error import relative_error
from ksd.solve.newton import iterate
from ksd.solve.steps import ErrorEstimate, Step
from ksd.solve.stops import Stop

if TYPE_CHECKING:
    from ksd.solve.configuration import Configuration

LINEAR_INNER = 54
"""Pose, force and stiffness of a linear body: `ksd.beam.linear`."""
GRAIN = 1e-7
"""Change of the figure that is none: below it bases are as good as the solve of either."""
TIGHT = 1e-10
"""Residual of a node over the forces on it in a corrector step: a good basis is off by less than the bound of a solve."""


def indicator(
    model: SolidModel, motion: Motion, target: np.ndarray, factor: float = 1.0
) -> tuple[ErrorEstimate, Step]:
    """Error of a state by corrector steps of the full solids, until they settle; not known where they do not."""
    clock, full = Stopwatch(), _Full(model, motion)
    lost = ErrorEstimate(np.full(len(model.drive_names), math.inf), math.inf, math.inf, math.inf)
    estimate, last, taken = lost, math.inf, 0
    while taken < MOST_CORRECTORS:
        taken += 1
        if not full.step(target, factor):
            estimate = lost
            break
        estimate = relative_error(model, motion, full.state)
        # the second of two steps says whether the first was all
        if abs(estimate.relative - last) <= max(SETTLED * estimate.relative, GRAIN):
            break
        last, estimate = estimate.relative, lost
    count = f"{taken} corrector steps of the full solids"
    return estimate, Step("error estimate", taken, clock(), full.residual, Stop.CONVERGED, count)


def settled(found: Configuration) -> Configuration:
    """The equilibrium of the full solids next to a state, every solid condensed to its faces: for questions about stiffness.

    Raises ConvergenceError.
    """
    model = found.model
    assert isinstance(model, SolidModel)
    full, target, before = _Full(model, found.motion), model.targets(found.targets), math.inf
    for _ in range(MOST_CORRECTORS):
        if not full.step(target, found.load_factor):
            break
        error = relative_error(model, found.motion, full.state).relative
        if abs(error - before) <= 1e-9 * (1.0 + error):
            return replace(found, model=full.model, motion=full.state, method_error=None)
        before = error
    raise ConvergenceError("the full solids find no equilibrium next to this state; ask for less")


@dataclass(frozen=True, repr=False)
class CondensedModel(Model):
    """A model whose full solids, by leaf, are condensed to their faces, as linear bodies."""

    condensed: tuple[str, ...] = ()

    def remade(self, model: Model) -> CondensedModel:
        """The same bodies in another model of the same scene; what they hold is of a state."""
        arrays, rest = _linear(
            model.arrays, model.rest, [model.member_names.index(n) for n in self.condensed]
        )
        kept = {k: getattr(model, k) for k in Model.__dataclass_fields__}
        return CondensedModel(**{**kept, "arrays": arrays, "rest": rest}, condensed=self.condensed)


class _Full:
    """The mechanism with its solids in full, on its way from a state of the reduced ones; state: where it is."""

    def __init__(self, model: SolidModel, motion: Motion) -> None:
        self.wholes = {}
        for name, body in model.solids.items():
            i = model.member_names.index(name)
            d, R = member_pose(model.arrays.members, i, motion)
            u = displaced(body, d, R, model.inner_of(name, motion.inner))
            self.wholes[i] = FullSolid(body.solid, u, d - np.array([body.solid.length, 0.0, 0.0]), R)
        arrays, self.state = _linear(exact(model.arrays), motion, list(self.wholes))
        kept = {k: getattr(model, k) for k in Model.__dataclass_fields__}
        self.model = CondensedModel(**{**kept, "arrays": arrays}, condensed=tuple(model.solids))
        self.arrays, self.work, self.residual = arrays, make_work(arrays), math.inf

    def step(self, target: np.ndarray, factor: float) -> bool:
        """One step of all, in place; whether it was possible."""
        for i, whole in self.wholes.items():
            _set(self.arrays, self.state, i, whole)
        found = iterate(self.arrays, self.state, target, factor, self.work, TIGHT, 30, CAP, math.inf)
        self.residual = found[2]
        if found[0] not in (Stop.CONVERGED, Stop.TOO_MANY) or not np.isfinite(self.state.x).all():
            return False
        for i, whole in self.wholes.items():
            whole.follow(*member_pose(self.arrays.members, i, self.state))
        return True


def _linear(arrays: Arrays, motion: Motion, solids: list[int]) -> tuple[Arrays, Motion]:
    """Arrays and state with the members in `solids` as linear bodies."""
    members = arrays.members
    parts = [motion.inner[members.inner_at[i] : members.inner_at[i + 1]] for i in range(len(members.kind))]
    kind, number, stores = members.kind.copy(), members.number.copy(), np.diff(members.store_at)
    for i in solids:
        kind[i], number[i], parts[i], stores[i] = LINEAR, 0, np.zeros(LINEAR_INNER), 0
    made = members._replace(
        kind=kind, number=number,
        inner_at=np.cumsum([0] + [len(p) for p in parts]).astype(np.int64),
        store_at=np.cumsum([0, *stores]).astype(np.int64),
    )  # fmt: skip
    state = motion.copy()._replace(inner=np.concatenate([np.zeros(0), *parts]))
    return arrays._replace(members=made), state


def _set(arrays: Arrays, state: Motion, i: int, whole: FullSolid) -> None:
    """Condense a full solid into the linear body that is member i."""
    whole.condense()
    inner = state.inner[arrays.members.inner_at[i] : arrays.members.inner_at[i + 1]]
    K = whole.stiffness.copy()
    # across its plane a solid meshed in 2D moves nowhere: supports hold it, and any stiffness does
    idle = np.setdiff1d(np.arange(6), whole.free)
    K[idle, idle] = np.abs(np.diagonal(K)[[0, 0, 0, 5, 5, 5]])[idle]
    inner[:3] = whole.shift + np.array([whole.solid.length, 0.0, 0.0])
    inner[3:12], inner[12:18], inner[18:] = whole.R.ravel(), whole.wrench, K.ravel()


def bent(model: SolidModel, motion: Motion) -> tuple[str, float, float]:
    """The solid bent furthest: name, displacement of face B over its length, its rotation [rad]."""
    worst = ("", 0.0, -1.0)
    for name, body in model.solids.items():
        d, R = member_pose(model.arrays.members, model.member_names.index(name), motion)
        stroke = float(np.linalg.norm(d - [body.solid.length, 0.0, 0.0]) / body.solid.length)
        turn = float(np.arccos(np.clip(0.5 * (np.trace(R) - 1.0), -1.0, 1.0)))
        if turn > worst[2]:
            worst = (name, stroke, turn)
    return worst


def validity(model: SolidModel, *, solid: str | None = None, error: float = 0.01) -> SolidRange:
    """The range of the basis of one solid (the first when None) within a relative `error`. Raises SceneError for an unknown
    name."""
    name = solid or next(iter(model.solids))
    if name not in model.solids:
        raise SceneError(f"there is no solid '{name}'; the solids are: {', '.join(model.solids)}")
    return replace(solid_range(model.solids[name], error=error), solid=name)
