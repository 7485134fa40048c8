"""Corrector steps of the full model next to a state of reduced bodies: error of that state, and the equilibrium near it.

A modal leaf becomes the chain that it reduces, from the chain's own nodes. A reduced solid becomes its whole mesh, condensed
at every step to its face B: a linear body among the members, whose interior then follows the motion of the face. This is
Newton's method of the full mechanism; the distance that it leads is the error of forces and poses.
"""

from __future__ import annotations

import math

import numpy as np

from ksd.answers.tangent import exact_tangent_arrays
from ksd.errors import ConvergenceError
from ksd.modal.leaf_bodies import full_model_state
from ksd.modal.solid_solve import FullSolid
from ksd.model.arrays import State, make_workspace
from ksd.model.compile import Model
from ksd.model.newton import RTOL, solve_equilibrium
from ksd.model.reduced_bodies import LinearBody, inner_state, relative_end_pose, transfer_state, with_bodies
from ksd.numerics.stopwatch import Stopwatch
from ksd.solvers.method_error import relative_error
from ksd.solvers.steps import MAX_TURN_PER_STEP, ErrorEstimate, Step, Stop

FIRST_STEPS, FURTHER_STEPS, MAX_STEPS = 3, 2, 20
"""Corrector steps of chains at first, in every further round, and at most: far from equilibrium the first ones may lead away
from it."""
RELATIVE_CHANGE, ABSOLUTE_CHANGE = 0.02, 1e-7
"""Changes of the error by further steps below which it is accepted; at a relative change of 0.1 one of 225 states was off by
62 %."""
SOLID_TOLERANCE = 1e-10
"""Residual over the forces on a node in a step with full solids: the error of a good basis may be below RTOL."""
MAX_SOLID_ITERATIONS = 30
"""Newton iterations of the mechanism for one condensation of its full solids."""


class FullBodies:
    """A mechanism with all bodies in full, `model`, and its present `state`, at first that of the reduced bodies.

    leaves: model and state of the leaf springs on another mesh; cell_factor: factor on the cells of the solids along every
    axis. residual, negatives: of the last step.
    """

    def __init__(
        self,
        reduced: Model,
        motion: State,
        *,
        leaves: tuple[Model, State] | None = None,
        cell_factor: float = 1.0,
    ) -> None:
        chains, state = leaves or full_model_state(reduced, motion)
        self.model = with_bodies(chains, {name: LinearBody() for name in reduced.solids})
        self.state = transfer_state(chains, state, self.model)
        self.full_solids: dict[int, FullSolid] = {}
        for name in reduced.solids:
            i, body = reduced.member_names.index(name), reduced.bodies[name]
            d, R = relative_end_pose(reduced.arrays.members, i, motion)
            u = body.displacements(d, R, inner_state(reduced.arrays.members, i, motion))
            solid = FullSolid(body.solid, u, d - np.array([body.solid.length, 0.0, 0.0]), R)
            if cell_factor != 1.0:
                solid = solid.on_mesh(body.solid.refine(cell_factor))
            self.full_solids[self.model.member_names.index(name)] = solid
        self.arrays, self.residual, self.negatives = exact_tangent_arrays(self.model), math.inf, 0
        self.work = make_workspace(self.arrays)

    def step(self, target: np.ndarray, factor: float, *, most: int) -> int | None:
        """Take at most `most` Newton steps of the chains, with full solids one step of these, in place.

        Returns the number of steps taken, None where the tangent is singular or numbers overflow.
        """
        for i, solid in self.full_solids.items():
            _condense(inner_state(self.arrays.members, i, self.state), solid)
        rtol, most = (SOLID_TOLERANCE, MAX_SOLID_ITERATIONS) if self.full_solids else (RTOL, most)
        reason, count, self.residual, self.negatives, _ = solve_equilibrium(
            self.arrays, self.state, target, factor, self.work, rtol, most, MAX_TURN_PER_STEP, math.inf
        )
        if reason in (Stop.NOT_FINITE, Stop.SINGULAR) or not np.isfinite(self.state.x).all():
            return None
        for i, solid in self.full_solids.items():
            solid.follow(*relative_end_pose(self.arrays.members, i, self.state))
        return 1 if self.full_solids else count


def _condense(inner: np.ndarray, solid: FullSolid) -> None:
    """Condense a full solid into the inner state of its linear body."""
    solid.condense()
    K = solid.stiffness.copy()
    # a solid meshed in 2D has no stiffness out of its plane; supports hold it there, so any stiffness will do
    idle = np.setdiff1d(np.arange(6), solid.free)
    K[idle, idle] = np.abs(np.diagonal(K)[[0, 0, 0, 5, 5, 5]])[idle]
    inner[:3] = solid.shift + np.array([solid.solid.length, 0.0, 0.0])
    inner[3:12], inner[12:18], inner[18:] = solid.R.ravel(), solid.wrench, K.ravel()


def error_indicator(
    model: Model,
    motion: State,
    target: np.ndarray,
    factor: float = 1.0,
    *,
    correctors: int | None = None,
    negatives: int | None = None,
) -> tuple[ErrorEstimate, Step]:
    """Estimated error of a state of reduced bodies at drives target (c,) and loads times factor; the state is not changed.

    correctors: number of steps; when None, steps are taken until further ones change the error by 2 % at most. The error is
    unknown where that does not happen, and where the steps end with another number of negative pivots than `negatives`: then
    the state is on no branch of the full model.
    """
    clock, full = Stopwatch(), FullBodies(model, motion)
    unknown = ErrorEstimate.unknown(len(model.drive_names))
    estimate, last, taken = unknown, math.inf, 0
    while taken < MAX_STEPS:
        most = correctors or (FIRST_STEPS if taken == 0 else FURTHER_STEPS)
        count = full.step(target, factor, most=most)
        if count is None:
            estimate = unknown
            break
        taken += count
        estimate = relative_error(model, motion, full.state)
        accepted = abs(estimate.relative - last) <= max(RELATIVE_CHANGE * estimate.relative, ABSOLUTE_CHANGE)
        if correctors or accepted or (count < most and not full.full_solids):
            break
        last, estimate = estimate.relative, unknown
    if negatives is not None and full.negatives != negatives:
        estimate = unknown
    note = f"{taken} corrector steps of the full model"
    return estimate, Step("error estimate", taken, clock(), full.residual, Stop.CONVERGED, note)


def full_equilibrium(
    model: Model,
    motion: State,
    target: np.ndarray,
    factor: float,
    *,
    leaves: tuple[Model, State] | None = None,
    cell_factor: float = 1.0,
) -> tuple[Model, State]:
    """Full model and its equilibrium next to a state with reduced solids, for questions about stiffness.

    leaves, cell_factor: see `FullBodies`. Raises ConvergenceError.
    """
    full, before = FullBodies(model, motion, leaves=leaves, cell_factor=cell_factor), math.inf
    for _ in range(MAX_STEPS):
        if full.step(target, factor, most=MAX_STEPS) is None:
            break
        error = relative_error(model, motion, full.state).relative
        if abs(error - before) <= 1e-9 * (1.0 + error):
            return full.model, full.state
        before = error
    raise ConvergenceError("the full solids find no equilibrium next to this state; ask for less")
