"""Corrector steps of the full model next to a state of reduced bodies: the error of that state, and the equilibrium there.

A modal leaf becomes the chain it reduces, from the nodes it has. A reduced solid becomes its whole mesh: condensed at
every step to its face B, a linear body among the members, which then follows to where its face went. That is Newton's
method of the full mechanism; how far it leads is the error of forces and poses.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.errors import ConvergenceError
from ksd.modal.leaf_bodies import full_model_state
from ksd.modal.solid_solve import FullSolid
from ksd.model.arrays import LINEAR, State, make_workspace
from ksd.model.compile import Model
from ksd.model.newton import solve_equilibrium
from ksd.model.reduced_bodies import inner_state, relative_end_pose, transfer_state, with_bodies
from ksd.numerics.stopwatch import Stopwatch
from ksd.properties.tangent import exact_tangent_arrays
from ksd.solve.method_error import relative_error
from ksd.solve.steps import MAX_TURN_PER_STEP, RTOL, ErrorEstimate, Step, Stop

CORRECTORS, MORE, MOST = 3, 2, 20
"""Corrector steps of chains at first, each time again, and at most: far from equilibrium the first ones lead astray."""
SETTLED, GRAIN = 0.02, 1e-7
"""Relative and absolute change of the error by further steps at which it is believed; at a relative change of 0.1 one of 225
states was 62 % off."""
TIGHT = 1e-10
"""Residual over the forces on a node in a step with full solids: a good basis is off by less than the bound of a solve."""


class Condensed:
    """A full solid condensed to its faces, a linear body that holds its constants as inner state."""

    kind = LINEAR

    def constants(self) -> tuple[np.ndarray, np.ndarray]:
        """None."""
        return np.zeros(0), np.zeros(4, np.int64)


class FullBodies:
    """A mechanism with its bodies in full, `model`, on its way from a state of the reduced ones; state: where it is.

    leaves: model and state of the leaf springs on another mesh; times: cells of the solids along every axis, over theirs.
    """

    def __init__(
        self,
        reduced: Model,
        motion: State,
        *,
        leaves: tuple[Model, State] | None = None,
        times: float = 1.0,
    ) -> None:
        chains, state = leaves or full_model_state(reduced, motion)
        self.model = with_bodies(chains, {name: Condensed() for name in reduced.solids})
        self.state, self.wholes = transfer_state(chains, state, self.model), {}
        for name in reduced.solids:
            i, body = reduced.member_names.index(name), reduced.bodies[name]
            d, R = relative_end_pose(reduced.arrays.members, i, motion)
            u = body.displacements(d, R, inner_state(reduced, motion, i))
            whole = FullSolid(body.solid, u, d - np.array([body.solid.length, 0.0, 0.0]), R)
            self.wholes[self.model.member_names.index(name)] = (
                whole if times == 1.0 else whole.on_mesh(body.solid.refine(times))
            )
        self.arrays, self.residual, self.negatives = exact_tangent_arrays(self.model), math.inf, 0
        self.work = make_workspace(self.arrays)

    def step(self, target: np.ndarray, factor: float, *, most: int) -> int | None:
        """At most so many Newton steps with chains, one of all full solids, in place; steps taken, None where that was
        not possible."""
        for i, whole in self.wholes.items():
            _condense(inner_state(self.model, self.state, i), whole)
        rtol, most = (TIGHT, 30) if self.wholes else (RTOL, most)
        reason, count, self.residual, self.negatives, _ = solve_equilibrium(
            self.arrays, self.state, target, factor, self.work, rtol, most, MAX_TURN_PER_STEP, math.inf
        )
        if reason in (Stop.NOT_FINITE, Stop.SINGULAR) or not np.isfinite(self.state.x).all():
            return None
        for i, whole in self.wholes.items():
            whole.follow(*relative_end_pose(self.arrays.members, i, self.state))
        return 1 if self.wholes else count


def _condense(inner: np.ndarray, whole: FullSolid) -> None:
    """Condense a full solid into the inner state of its linear body."""
    whole.condense()
    K = whole.stiffness.copy()
    # out of its plane a solid meshed in 2D moves nowhere: supports hold it, and any stiffness does
    idle = np.setdiff1d(np.arange(6), whole.free)
    K[idle, idle] = np.abs(np.diagonal(K)[[0, 0, 0, 5, 5, 5]])[idle]
    inner[:3] = whole.shift + np.array([whole.solid.length, 0.0, 0.0])
    inner[3:12], inner[12:18], inner[18:] = whole.R.ravel(), whole.wrench, K.ravel()


def error_indicator(
    model: Model,
    motion: State,
    target: np.ndarray,
    factor: float = 1.0,
    *,
    correctors: int | None = None,
    negatives: int | None = None,
) -> tuple[ErrorEstimate, Step]:
    """Error of a state of reduced bodies, which is left alone, at drives target (c,) and loads times factor.

    correctors: how many steps; when None, so many until further ones change the error by 2 % at most. Where they do not
    settle it is not known, nor where they end at another number of negative pivots than `negatives`: the state is on no
    branch of the full model then.
    """
    clock, full = Stopwatch(), FullBodies(model, motion)
    lost = ErrorEstimate(np.full(len(model.drive_names), math.inf), math.inf, math.inf, math.inf)
    estimate, last, taken = lost, math.inf, 0
    while taken < MOST:
        most = correctors or (CORRECTORS if taken == 0 else MORE)
        count = full.step(target, factor, most=most)
        if count is None:
            estimate = lost
            break
        taken += count
        estimate = relative_error(model, motion, full.state)
        settled = abs(estimate.relative - last) <= max(SETTLED * estimate.relative, GRAIN)
        if correctors or settled or (count < most and not full.wholes):
            break
        last, estimate = estimate.relative, lost
    if negatives is not None and full.negatives != negatives:
        estimate = lost
    note = f"{taken} corrector steps of the full model"
    return estimate, Step("error estimate", taken, clock(), full.residual, Stop.CONVERGED, note)


def full_equilibrium(
    model: Model,
    motion: State,
    target: np.ndarray,
    factor: float,
    *,
    leaves: tuple[Model, State] | None = None,
    times: float = 1.0,
) -> tuple[Model, State]:
    """Full model and its equilibrium next to a state with reduced solids: what questions about stiffness are asked of.

    leaves, times: see `FullBodies`. Raises ConvergenceError.
    """
    full, before = FullBodies(model, motion, leaves=leaves, times=times), math.inf
    for _ in range(MOST):
        if full.step(target, factor, most=MOST) is None:
            break
        error = relative_error(model, motion, full.state).relative
        if abs(error - before) <= 1e-9 * (1.0 + error):
            return full.model, full.state
        before = error
    raise ConvergenceError("the full solids find no equilibrium next to this state; ask for less")
