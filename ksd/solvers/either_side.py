"""From an unstable state, as a symmetric one, to the minimum of energy on one side of it.

The path from rest is left at its first bifurcation. Where this does not lead to a stable state, the unstable one is
displaced a little along its unstable motion and left to itself: Newton's method, with a multiple of the diagonal added to
the stiffness where that is not positive, goes down the energy as a viscous mechanism would (pseudo-transient continuation;
Kelley and Keyes, SIAM J. Numer. Anal. 35, 1998).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ksd.answers.tangent import stored_matrix
from ksd.errors import ConvergenceError
from ksd.model.arrays import State, make_workspace
from ksd.model.compile import Model
from ksd.model.newton import assemble, largest_displacement, largest_rotation, take_step
from ksd.numerics.indefinite import equilibration, negative_inertia, solve_scaled
from ksd.numerics.stopwatch import Stopwatch
from ksd.solvers.arc_length import END_REACHED, PathContinuation, follow_by_arc_length, switch_branch
from ksd.solvers.configuration import Configuration
from ksd.solvers.load_steps import LoadPath
from ksd.solvers.steps import FAST_METHODS, Step, Stop
from ksd.solvers.undeformed_stability import unstable_shape

Array = NDArray[np.float64]
FIRST_MOVE, LARGEST_MOVE = 0.01, 0.1
"""Rotation [rad] of a link, or displacement over the size of the mechanism, of the push aside, and of a step at most."""
MAX_STEPS = 200
"""Steps after which no minimum is found."""
GROWTH = 4.0
"""Factor on the added stiffness where it does not suffice; it is divided by its square after a step."""


def take_side(found: Configuration, side: float) -> Configuration:
    """The minimum on one side of an unstable equilibrium of conservative loads; else the result itself.

    side: sign of the motion away from the bifurcation, whose largest component is positive. Raises ConvergenceError where
    leaf springs are unstable between their ends, and where no minimum is reached.
    """
    model, clock = found.model, Stopwatch()
    if found.negatives <= found.expected_negatives or not model.conservative:
        return found
    state, steps = _on_branch(model, found, np.sign(side))
    if state is None:
        count, shape = unstable_shape(model, found.motion, found.load_factor)
        if count and not shape.any():
            raise ConvergenceError(
                f"side={side:+g}: this state is unstable within leaf springs, which have no node to push there; draw a "
                "point on them, mechanism.point(leaf, s) with s [m] off their middle"
            )
        state, more = nearby_minimum(model, found, np.sign(side) * shape)
        steps += more
    if state is None:
        raise ConvergenceError(
            f"side={side:+g}: no stable state was found on this side in {steps} steps; go along the path (ksd.follow)",
            result=found,
        )
    step = Step(
        "equilibrium", steps, clock(), 1.0, Stop.CONVERGED, f"from an unstable state to the side {side:+g}"
    )
    note = f"taken is the stable state on the side {side:+g} of one that is unstable"
    return replace(
        found, motion=state, negatives=found.expected_negatives, doubts=(), steps=(*found.steps, step),
        notes=(*found.notes, note), method="conventional" if found.method in FAST_METHODS else found.method,
        method_error=None, method_was_chosen=False, joints_near_intended=False,
    )  # fmt: skip


def _on_branch(model: Model, found: Configuration, side: float) -> tuple[State | None, int]:
    """The stable end of the path that leaves that from rest at its first bifurcation, None where there is none; and the
    factorisations."""
    target = model.targets(found.targets)
    path = LoadPath(np.zeros_like(target), target, (0.0, found.load_factor))
    try:
        trunk = follow_by_arc_length(model, path, model.rest, max_singular_points=1)
        if not trunk.singular_points or trunk.singular_points[0].kind == "limit":
            return None, trunk.factorisations
        crossing = trunk.singular_points[0]
        branch = PathContinuation(model, path)
        at, direction = switch_branch(
            branch.newton, crossing.point.motion.copy(), crossing.point.f, side * crossing.mode
        )
        branch.follow(at, direction, until=1.0, arc=FIRST_MOVE, max_steps=MAX_STEPS)
    except (ConvergenceError, np.linalg.LinAlgError):
        return None, 0
    end, count = branch.points[-1], trunk.factorisations + branch.factorisations
    stable = branch.stop_reason == END_REACHED and end.negatives == len(target)
    return (end.motion if stable else None), count


def nearby_minimum(model: Model, found: Configuration, shape: Array) -> tuple[State | None, int]:
    """The minimum reached from a state pushed along a shape (nodes, 6), None where there is none; and the steps."""
    arrays, work, motion = model.arrays, make_workspace(model.arrays), found.motion.copy()
    target, rows = model.targets(found.targets), len(arrays.terms.start)
    step, moving = np.zeros(arrays.plan.unknowns), arrays.start >= 0
    step[arrays.start[moving, None] + np.arange(6)] = shape[moving]
    longest, added = FIRST_MOVE, 0.0
    for n in range(MAX_STEPS + 1):
        worst, _, inside, status = assemble(arrays, motion, target, found.load_factor, work)
        if n > 0:
            K, longest = stored_matrix(arrays, work.matrix), LARGEST_MOVE
            if not np.isfinite(worst) or not np.isfinite(K).all():
                return None, n
            stable = negative_inertia(K) + inside == rows
            if worst <= 1.0 and stable:
                return (motion if status == 0 else None), n
            if stable:
                added = 0.0
            scale = equilibration(K)
            viscous = 1.0 / scale**2
            viscous[arrays.terms.start] = 0.0
            while negative_inertia(K + np.diag(added * viscous)) > rows:
                added = max(GROWTH * added, 1e-6)
            step = solve_scaled(K + np.diag(added * viscous), -work.rhs[:, None], scale)[0][:, 0]
            added /= GROWTH**2
        move = max(largest_rotation(arrays, step), largest_displacement(arrays, step) / arrays.size)
        if n == 0 and move > 0.0:
            # the push is scaled itself, lest the inner unknowns be too
            step, move = step * (longest / move), longest
        take_step(arrays, motion, step, work, min(1.0, longest / max(move, longest)))
    return None, MAX_STEPS
