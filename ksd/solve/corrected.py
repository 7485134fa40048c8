"""Error figures for questions asked of a fast method's state: the same question after one Newton step of the full model.

The answers of `full` and `conventional` are those of an equilibrium and have no error but the mesh's. A `kinematic` or
`reduced` state is off it; a Newton step squares its distance, so the change of an answer over that step is its error to
first order, whatever the question is. Where `solve` itself took a fast method, for its error in forces and poses,
further questions are asked of the equilibrium next to its state (`settled`): a soft direction of the arm is 80 % off in
a state whose forces are right to a thousandth.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ksd.errors import ConvergenceError
from ksd.model.arrays import Motion, make_work
from ksd.solve.configuration import Configuration
from ksd.solve.driving import CAP, RTOL
from ksd.solve.newton import iterate
from ksd.solve.steps import FAST
from ksd.solve.stops import Stop

MOST = 20
"""Newton steps to the equilibrium next to such a state; two or three are usual."""


def corrected(pose: Configuration) -> Configuration:
    """The state one Newton step of the full model further; the pose itself where it is an equilibrium. Of modal bodies the
    equilibrium of the chains they stand for, found from their nodes: one step is not enough there.

    Raises ConvergenceError where the steps leave what the leafs can follow.
    """
    if hasattr(pose.model, "solids"):
        from ksd.solve.solids import settled as of_solids

        return of_solids(pose)
    if pose.method not in FAST:
        return pose
    if pose.method == "modal":
        full, state = pose.insides
        chains = replace(pose, model=full, motion=state)
        return replace(chains, motion=settled(chains), method="conventional", method_error=None)
    arrays, motion = pose.model.arrays, pose.motion.copy()
    work, target = make_work(arrays), pose.model.targets(pose.targets)
    ways = pose.load_factor, work, 1e-8, 1, math.inf, math.inf
    reason, *_, negatives, _ = iterate(arrays, motion, target, *ways)
    if reason not in (Stop.CONVERGED, Stop.TOO_MANY) or not all(np.isfinite(part).all() for part in motion):
        raise ConvergenceError(
            "the error of this answer cannot be told: the state is too far from equilibrium for a Newton step; "
            "ask the question of method='full'"
        )
    return replace(pose, motion=motion, negatives=int(negatives), chosen=False)


def settled(pose: Configuration) -> Motion:
    """The equilibrium of the full model next to the state of a fast method.

    Raises ConvergenceError where Newton steps from there do not reach one.
    """
    motion, target = pose.motion.copy(), pose.model.targets(pose.targets)
    work = make_work(pose.model.arrays)
    reason, *_ = iterate(pose.model.arrays, motion, target, pose.load_factor, work, RTOL, MOST, CAP, math.inf)
    if Stop(reason) is not Stop.CONVERGED:
        raise ConvergenceError(
            f"no equilibrium found next to the {pose.method} answer ({Stop(reason).sentence}); ask the question of "
            "method='full'"
        )
    return motion


def with_error(pose: Configuration, question: Callable[[Configuration], Any]) -> tuple[Any, Any]:
    """The answer of question(pose) and its error: |change| over one Newton step (see `corrected`), in the shape of the
    answer (number, array, or mapping of them); zero for methods that are exact but for the mesh."""
    answer = question(pose)
    exact = pose.method not in FAST and not hasattr(pose.model, "solids")
    better = answer if exact else question(corrected(pose))
    if isinstance(answer, Mapping):
        return answer, {k: _change(v, better[k]) for k, v in answer.items()}
    return answer, _change(answer, better)


def _change(one: Any, other: Any) -> Any:
    found = np.abs(np.asarray(other, float) - np.asarray(one, float))
    return float(found) if found.ndim == 0 else found
