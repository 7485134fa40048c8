"""A converged load step that may have jumped to another branch is walked again in smaller steps before it is believed.

A residual of zero does not tell the branch: 75 degrees in one step can end at a moment of the wrong sign. What gives a
jump away, at no cost: an inertia that is not that of a minimum, loads and drives that together did no positive work
on a mechanism that was at rest (the strain energy they should have become is positive), an iteration that
wandered, or loads that do much of the work and did not come in easily. Then 4, 8, ... load steps are tried until two
rounds end in the same minimum; failing that, the path is followed by arc length, which tells limit points and
bifurcations on the way.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable

import numpy as np

from ksd.errors import ConvergenceError
from ksd.model.arrays import Motion, carries_load
from ksd.model.compile import Model
from ksd.solve.driving import Driven
from ksd.solve.path import Path
from ksd.solve.steps import Step
from ksd.solve.stops import Stop

WANDERED = 12
"""Iterations of an accepted load step above which its branch is confirmed."""
EASY, LADEN = 5, 0.1
"""Iterations of a step, and share of the loads in the work done, above both of which its branch is confirmed."""
FINE = 16
"""Load steps up to which an answer is confirmed, at least."""
CUT = 0.2
"""A load step that had to be cut below this fraction of the way is confirmed."""
SAME = 1e-6
"""Largest difference of two equal states, over the size of the mechanism."""
SADDLE = "its inertia is not that of a minimum"
"""The doubt that only a path by arc length settles: the way there may lead over a limit point or a bifurcation."""


def works(model: Model, motion: Motion, target: np.ndarray) -> tuple[float, float]:
    """Secant work [J] of the drives, and of dead loads, from rest to `motion`; their sum becomes strain energy.

    That of the loads is nan where following loads make it depend on the path.
    """
    loads = model.arrays.loads
    driving = -0.5 * float(motion.multiplier.dot(target))
    if not carries_load(model.arrays):
        return driving, 0.0
    if np.any(loads.following == 1):
        return driving, float("nan")
    work = 0.0
    for i, node in enumerate(loads.node):
        lever = (motion.R[node] - np.eye(3)) @ loads.point[i]
        work += float(loads.force[i] @ (motion.x[node] - model.rest.x[node] + lever))
        if np.any(loads.moment[i]):
            from scipy.spatial.transform import Rotation

            work += float(loads.moment[i] @ Rotation.from_matrix(motion.R[node]).as_rotvec())
    weight, members = model.arrays.weight, model.arrays.members
    if len(weight):
        # the centre of mass of a leaf moves about as the mean of its ends
        lever = ((motion.R - np.eye(3))[members.node] @ members.offset[..., None])[..., 0]
        moved = (motion.x - model.rest.x)[members.node] + lever
        work += 0.5 * float(weight[:, 0] @ (weight[:, None, 1:] @ moved.swapaxes(1, 2)).sum(axis=(1, 2)))
    return driving, 0.5 * work


def laden(model: Model, motion: Motion, target: np.ndarray, longest: int) -> bool:
    """Whether loads do so much of the work, and a step took so many iterations, that one step proves little."""
    if longest <= EASY or not carries_load(model.arrays):
        return False
    driving, loading = works(model, motion, target)
    # work that depends on the path is not small
    return not abs(loading) <= LADEN * (abs(driving) + abs(loading))


def doubt(
    model: Model, motion: Motion, driven: Driven, target: np.ndarray, *, fresh: bool, steps: int
) -> str:
    """Why the state reached in `steps` may not be the one meant, or nothing. fresh: the mechanism was at rest before."""
    if driven.stop is not Stop.CONVERGED:
        return ""
    if driven.negatives != len(target):
        return SADDLE
    if driven.longest > WANDERED:
        return f"a load step took {driven.longest} iterations"
    if driven.shortest < min(CUT, 0.9 / steps):
        return f"a load step had to be cut to {100 * driven.shortest:.2g} % of the way"
    if not fresh:
        return ""
    loaded = carries_load(model.arrays)
    if (sum(works(model, motion, target)) if loaded else -motion.multiplier.dot(target)) < 0.0:
        return "drives and loads did negative work on it"
    if loaded and laden(model, motion, target, driven.longest):
        return f"loads do much of the work, and a load step took {driven.longest} iterations"
    return ""


def wandered(steps: Iterable[Step]) -> tuple[str, ...]:
    """Doubts about equilibrium steps of a kinematic start that took long: they may have wandered to another branch."""
    return tuple(f"step '{s.name}' took {s.iterations} iterations" for s in steps if s.iterations > WANDERED)


def difference(model: Model, one: Motion, other: Motion) -> float:
    """Largest difference of two states over the size of the mechanism (rotations as they are)."""
    shift = np.abs(one.x - other.x).max(initial=0.0) / model.arrays.size
    return float(max(shift, np.abs(one.R - other.R).max(initial=0.0)))


Round = tuple[Driven, str, Motion]


def confirmed(
    model: Model, first: Round, again: Callable[[int], Round], arc: Callable[[], Path], reason: str
) -> tuple[Driven, str, Motion, tuple[str, ...]]:
    """The state that two rounds of load steps agree on, what was done in words, and the doubts that remain.

    first: how the doubtful round went; again: goes the same way in so many steps; arc: goes it by arc length, which is
    asked last, when smaller steps do not settle it or end in a state that is no minimum.
    """
    solves, taken = first[0].solves, first[0].taken
    last, size = first, max(4, int(np.ceil(2.0 / first[0].shortest)))
    end, settled, doubts = max(FINE, 4 * size), False, (reason,)
    while size <= end and not settled:
        fresh = again(size)
        solves, taken = solves + fresh[0].solves, taken + fresh[0].taken
        if fresh[0].stop is not Stop.CONVERGED:
            doubts = (f"{reason}, and smaller load steps stop at {100 * fresh[0].reached:.3g} % of the way",)
            break
        same = difference(model, fresh[2], last[2]) < SAME
        settled = same and reason != SADDLE and fresh[0].negatives == len(model.arrays.terms.start)
        last, size = fresh, 2 * size
        if same and not settled:
            break
    how = ", ".join(filter(None, [last[1], f"walked again in smaller steps: {reason}"]))
    driven = last[0]._replace(solves=solves, taken=taken)
    if settled:
        return driven, how, last[2], ()
    return by_arc(model, (driven, how, last[2]), arc, doubts)


def by_arc(
    model: Model, last: Round, arc: Callable[[], Path], doubts: tuple[str, ...]
) -> tuple[Driven, str, Motion, tuple[str, ...]]:
    """The last resort: what the path followed by arc length says of the state `last` and its `doubts`."""
    driven, how, motion = last
    try:
        path = arc()
    except (ConvergenceError, np.linalg.LinAlgError):
        return driven, how, motion, doubts
    driven = driven._replace(solves=driven.solves + sum(s.iterations for s in path.states))
    how = f"{how}, then by arc length"
    at = "; ".join(f"a {t.kind} point at {100 * t.factor:.3g} % of the way" for t in path.turnings)
    if not path.ended or path.turnings:
        return (
            driven,
            how,
            motion,
            (f"{doubts[0]}; the path from its start has {at or 'no end: ' + path.stop}",),
        )
    state = path.states[-1]
    return driven._replace(negatives=state.negatives), how, state.motion, ()


def rescued(first: Round, arc: Callable[[], Path]) -> tuple[Driven, str, Motion, tuple[str, ...]]:
    """Where load steps end before the way does: what the path followed by arc length finds at its end, or why there is
    none. A path that turns on the way is not gone along: the mechanism would snap."""
    driven, how, motion = first
    try:
        path = arc()
    except (ConvergenceError, np.linalg.LinAlgError):
        return driven, how, motion, ()
    driven = driven._replace(solves=driven.solves + sum(s.iterations for s in path.states))
    if path.turnings:
        turn = path.turnings[0]
        kind = "turns back at a limit" if turn.kind == "limit" else "branches at a bifurcation"
        said = f"the path from its start {kind} point at {100 * turn.factor:.3g} % of the way, where the mechanism snaps or"
        return driven, how, motion, (f"{said} buckles; ksd.follow goes along the path",)
    if not path.ended:
        return driven, how, motion, ()
    state = path.states[-1]
    driven = driven._replace(stop=Stop.CONVERGED, residual=1.0, negatives=state.negatives, reached=1.0)
    return driven, ", ".join(filter(None, [how, "by arc length"])), state.motion, ()
