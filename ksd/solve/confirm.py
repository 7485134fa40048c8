"""A converged load step that may have jumped to another branch is walked again in smaller steps before it is believed.

A residual of zero does not tell the branch: 75 degrees in one step can end at a moment of the wrong sign. What gives a
jump away, at no cost: an inertia that is not that of a minimum, loads and drives that together did no positive work
on a mechanism that was at rest (the strain energy they should have become is positive), or an iteration that
wandered. Then 4, 8, ... load steps are tried until two rounds end in the same state.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ksd.model.arrays import Motion
from ksd.model.compile import Model
from ksd.solve.driving import Driven
from ksd.solve.stops import Stop

WANDERED = 12
"""Iterations of an accepted load step above which its branch is confirmed."""
FINE = 16
"""Load steps from which on an answer is believed as it is."""
SAME = 1e-6
"""Largest difference of two equal states, over the size of the mechanism."""


def work_done(model: Model, motion: Motion, target: np.ndarray) -> float:
    """Secant work [J] of drives and dead loads from rest to `motion`: positive where it became strain energy.

    nan where following loads make it depend on the path.
    """
    loads = model.arrays.loads
    if np.any(loads.following == 1):
        return float("nan")
    work = -float(motion.multiplier @ target)
    for i, node in enumerate(loads.node):
        lever = (motion.R[node] - np.eye(3)) @ loads.point[i]
        work += float(loads.force[i] @ (motion.x[node] - model.rest.x[node] + lever))
        if np.any(loads.moment[i]):
            from scipy.spatial.transform import Rotation

            work += float(loads.moment[i] @ Rotation.from_matrix(motion.R[node]).as_rotvec())
    return 0.5 * work


def doubt(model: Model, motion: Motion, driven: Driven, target: np.ndarray, *, fresh: bool) -> str:
    """Why the state reached may not be the one meant, or nothing. fresh: the mechanism was at rest before."""
    if driven.stop is not Stop.CONVERGED or driven.taken >= FINE:
        return ""
    if driven.negatives != len(target):
        return "its inertia is not that of a minimum"
    if driven.longest > WANDERED:
        return f"a load step took {driven.longest} iterations"
    if fresh and work_done(model, motion, target) < 0.0:
        return "drives and loads did negative work on it"
    return ""


def difference(model: Model, one: Motion, other: Motion) -> float:
    """Largest difference of two states over the size of the mechanism (rotations as they are)."""
    shift = np.abs(one.x - other.x).max(initial=0.0) / model.arrays.size
    return float(max(shift, np.abs(one.R - other.R).max(initial=0.0)))


Round = tuple[Driven, str, Motion]


def confirmed(
    model: Model, first: Round, again: Callable[[int], Round], reason: str
) -> tuple[Driven, str, Motion, tuple[str, ...]]:
    """The state that two rounds of load steps agree on, what was done in words, and the doubts that remain.

    first: how the doubtful round went; again: goes the same way in so many steps.
    """
    solves, taken = first[0].solves, first[0].taken
    last, size = first, 4
    doubts: tuple[str, ...] = (f"{reason}, and no two rounds of smaller load steps agree",)
    while size <= FINE:
        fresh = again(size)
        solves, taken = solves + fresh[0].solves, taken + fresh[0].taken
        if fresh[0].stop is not Stop.CONVERGED:
            doubts = (
                f"{reason}, and smaller load steps stop at {100 * fresh[0].reached:.3g} % of the way: "
                f"{fresh[0].stop.sentence}",
            )
            break
        same = difference(model, fresh[2], last[2]) < SAME
        last = fresh
        if same:
            doubts = ()
            break
        size *= 2
    driven = last[0]._replace(solves=solves, taken=taken)
    how = ", ".join(filter(None, [last[1], f"walked again in smaller steps: {reason}"]))
    return driven, how, last[2], doubts
