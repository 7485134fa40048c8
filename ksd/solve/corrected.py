"""Error figures of any answer: the same question asked of the truth next to the state, as far as a finer mesh knows it.

Every leaf becomes a strain-mode leaf of more modes and Newton steps lead to equilibrium (`ksd.solve.error`), so the figure
holds what the method is off and what the mesh is off. Where `solve` itself took a fast method, for its error in forces and
poses, further questions are asked of the equilibrium next to its state (`settled`): a soft direction of the arm is 80 % off
in a state whose forces are right to a thousandth.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ksd.errors import ConvergenceError
from ksd.model.arrays import Motion, make_work
from ksd.model.newton import iterate
from ksd.solve.error import truth_of
from ksd.solve.full_bodies import settled as settled_solids
from ksd.solve.steps import CAP, RTOL, Stop

if TYPE_CHECKING:
    from ksd.solve.configuration import Configuration

MOST = 20
"""Newton steps to the equilibrium next to such a state; two or three are usual."""


def corrected(pose: Configuration) -> Configuration:
    """The equilibrium next to the state on the finer mesh of `ksd.solve.error.refined`; of reduced solids that of the whole
    solids.

    Raises ConvergenceError where Newton steps find none.
    """
    if pose.model.solids:
        words = pose.model, pose.motion, pose.model.targets(pose.targets), pose.load_factor
        model, motion = settled_solids(*words)
        return replace(pose, model=model, motion=motion, method="conventional", method_error=None)
    fine, state, negatives = truth_of(pose)
    if state is None:
        raise ConvergenceError(
            "the error of this answer cannot be told: Newton steps find no equilibrium next to it on a finer mesh; ask the "
            "question of method='full' on a finer mesh"
        )
    return replace(
        pose,
        model=fine,
        motion=state,
        negatives=negatives,
        method="conventional",
        method_error=None,
        chosen=False,
    )


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
    """The answer of question(pose) and its error, that of method and mesh: |change| to the answer of `corrected`, in the
    shape of the answer (number, array, or mapping of them)."""
    answer, better = question(pose), question(corrected(pose))
    if isinstance(answer, Mapping):
        return answer, {k: _change(v, better[k]) for k, v in answer.items()}
    return answer, _change(answer, better)


def _change(one: Any, other: Any) -> Any:
    found = np.abs(np.asarray(other, float) - np.asarray(one, float))
    return float(found) if found.ndim == 0 else found
