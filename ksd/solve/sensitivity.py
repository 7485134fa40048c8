"""How the answer to any question changes with a load: central difference of two equilibria beside the present one.

The two must lie apart as the guarded tangent between them says: where they do not, digits are lost, by rounding near a
critical load or because the load is no small one, and the answer is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from ksd.errors import ConvergenceError, KinematicsError, SceneError
from ksd.model.arrays import Motion
from ksd.model.compile import Model, compile_given, marked
from ksd.numerics.stopwatch import Stopwatch
from ksd.properties.stiffness import node_of, point_motion
from ksd.properties.tangent import factored_tangent
from ksd.scene.drive import Load
from ksd.solve.load_steps import load_steps, step_of, stopped
from ksd.solve.steps import Stop
from ksd.solve.storage import storage_of

if TYPE_CHECKING:
    from ksd.solve.configuration import Configuration

STEP = 1e-3
"""Part of the load that is added and taken away."""
RTOL = 1e-11
LOST = 1e-4
"""Share by which the difference of the two equilibria may differ from the response of the tangent."""


def sensitivity(
    pose: Configuration,
    question: Callable[[Configuration], Any],
    link: Any,
    *,
    at: Any,
    force: Any = (0.0, 0.0, 0.0),
    moment: Any = (0.0, 0.0, 0.0),
) -> Any:
    """Change of ``question(pose)`` (number, array, or mapping of numbers) per whole of a dead load, to first order.

    The load: force (3,) [N], moment (3,) [Nm], global, on the point of `link` that is at `at` (3,) [m] at rest; it
    is added to those of the scene while the drives stay. A thousandth of it either way is solved for with the full
    model (of modal bodies the chains they stand for) from the present state, so anything may be asked: a stiffness,
    a frequency, a stress. Raises SceneError for wrong names or a load of zero, ConvergenceError where a state beside
    this one is not found, KinematicsError where rounding or the size of the load leaves no four digits of the difference.
    """
    name = getattr(link, "name", link)
    model, state = pose.insides
    scene = model.said or model.scene
    if name not in scene.links:
        raise SceneError(
            f"link '{name}' is not part of '{scene.name}'; its links are {', '.join(scene.links)}"
        )
    wrench = np.concatenate([np.asarray(force, float), np.asarray(moment, float)])
    if wrench.shape != (6,) or not np.isfinite(wrench).all() or not wrench.any():
        raise SceneError(f"load on '{name}': give a finite force (3,) or moment (3,) that is not zero")
    states = []
    for sign in (1.0, -1.0):
        f, m = (tuple((sign * STEP * part).tolist()) for part in (wrench[:3], wrench[3:]))
        extra = Load("sensitivity", name, f, m, tuple(np.asarray(at, float).tolist()))
        more = replace(model.scene, loads=(*model.scene.loads, extra))
        loaded = marked(compile_given(more, model.mesh), scene, model.choice)
        states.append(_beside(pose, loaded, state))
    off = _off_tangent(states, link, at, wrench)
    if not off <= LOST:
        raise KinematicsError(
            f"sensitivity: a thousandth of the load on '{name}', to and fro, moves the links by {off:.1e} of their way "
            "otherwise than the tangent says: the state is near its critical load, or the load is too large or too small"
        )
    plus, minus = (question(state) for state in states)
    if isinstance(plus, Mapping):
        return {k: (v - minus[k]) / (2 * STEP) for k, v in plus.items()}
    found = (np.asarray(plus, float) - np.asarray(minus, float)) / (2 * STEP)
    return float(found) if found.ndim == 0 else found


def _off_tangent(states: list[Configuration], link: Any, at: Any, wrench: np.ndarray) -> float:
    """By how much two states under loads +-STEP times `wrench` (6,) on a point of `link` differ otherwise than the mean
    response of their tangents, over the largest way of a node."""
    responses = []
    for state in states:
        model, motion = state.model, state.motion
        tangent = factored_tangent(model, motion)
        node = node_of(model, link)
        loads = np.zeros((model.arrays.plan.unknowns, 1))
        loads[tangent.unknowns(node), 0] = point_motion(model, motion, node, at)[1].T @ wrench
        found = np.append(tangent.solve(loads)[:, 0], np.zeros(6))
        start = np.where(model.arrays.start < 0, len(found) - 6, model.arrays.start)
        responses.append(found[start[:, None] + np.arange(6)])
    plus, minus = states[0].motion, states[1].motion
    turned = Rotation.from_matrix(plus.R @ minus.R.swapaxes(1, 2)).as_rotvec()
    size = np.repeat([1.0, states[0].model.arrays.size], 3)
    there = np.hstack([plus.x - minus.x, turned]) / (2 * STEP) * size
    told = 0.5 * (responses[0] + responses[1]) * size
    return float(np.abs(there - told)[1:].max() / max(np.abs(told)[1:].max(), 1e-300))


def _beside(pose: Configuration, loaded: Model, state: Motion) -> Configuration:
    """The equilibrium of the loaded model next to `state`, drives as they are."""
    target, clock = loaded.targets(pose.targets), Stopwatch()
    driven, how, motion, doubts = load_steps(
        storage_of(loaded), state, start=target, target=target, fresh=False, factors=(pose.load_factor, 1.0),
        planar=False, rtol=RTOL,
    )  # fmt: skip
    found = replace(
        pose, model=loaded, motion=motion, method="conventional", method_error=None, chosen=False, load_factor=1.0,
        steps=(step_of(driven, how, clock()),), negatives=driven.negatives, expected=len(target), doubts=doubts,
        joint_motions=None, notes=(), near=False,
    )  # fmt: skip
    if driven.stop is not Stop.CONVERGED:
        raise ConvergenceError(stopped(driven, doubts), reached=driven.reached, result=found)
    return found
