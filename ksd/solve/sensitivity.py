"""How the answer to any question changes with a load: central difference of two equilibria beside the present one.

Both are refined by Newton steps with the guarded tangent. What the last of these still changes, over the distance of the two
in the norm of the diagonal, forces of drives and supports included, is the backward error of the difference.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ksd.checks import checked_question, vector, wrench_of
from ksd.errors import ConvergenceError, KinematicsError, SceneError
from ksd.model.arrays import Motion
from ksd.model.compile import Model, compile_given
from ksd.model.newton import take_step
from ksd.numerics.rotations import rotation_log
from ksd.numerics.stopwatch import Stopwatch
from ksd.properties.tangent import assemble_tangent, factor_tangent
from ksd.scene.load import Load
from ksd.solve.load_steps import LoadPath, as_step, follow_load_path, stop_sentence
from ksd.solve.steps import Stop
from ksd.solve.storage import thread_storage

if TYPE_CHECKING:
    from ksd.solve.configuration import Configuration

Array = NDArray[np.float64]
STEP = 1e-3
"""Part of the load that is added and taken away."""
RTOL = 1e-11
LOST = 1e-4
"""Backward error of the difference of the two equilibria beyond which its digits count as lost."""


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
    this one is not found, KinematicsError where rounding leaves no four digits of how far the two lie apart.
    """
    name = getattr(link, "name", link)
    model, state = pose.unreduced_state
    scene = model.said or model.scene
    if name not in scene.links:
        raise SceneError(
            f"link '{name}' is not part of '{scene.name}'; its links are {', '.join(scene.links)}"
        )
    checked_question(question)
    load, place = (
        wrench_of(force, moment, f"load on '{name}'"),
        vector(at, "at", owner="sensitivity", unit="m"),
    )
    acting = _acting(model.scene, pose.load_factor)
    states: list[Configuration] = []
    rest: list[tuple[Array, Array]] = []
    for sign in (1.0, -1.0):
        f, m = (tuple((sign * STEP * part).tolist()) for part in (load[:3], load[3:]))
        extra = Load("sensitivity", name, f, m, place)
        more = replace(acting, loads=(*acting.loads, extra))
        loaded = compile_given(more, model.mesh, scene, model.choice)
        states.append(_beside(pose, loaded, state))
        rest.append(_refine(states[-1]))
    error = _backward_error(states[0], states[1], rest)
    if not error <= LOST:
        raise KinematicsError(
            f"sensitivity: rounding leaves fewer than four digits of what a thousandth of the load on '{name}' changes "
            f"(backward error {error:.1e}): give a larger load, or hold what hardly anything resists"
        )
    plus, minus = (question(beside) for beside in states)
    if isinstance(plus, Mapping):
        return {k: (v - minus[k]) / (2 * STEP) for k, v in plus.items()}
    found = (np.asarray(plus, float) - np.asarray(minus, float)) / (2 * STEP)
    return float(found) if found.ndim == 0 else found


def _acting(scene: Any, factor: float) -> Any:
    """The scene with its loads and gravity times a load factor."""

    def times(vector: Any) -> Any:
        return tuple(factor * part for part in vector)

    loads = tuple(replace(x, force=times(x.force), moment=times(x.moment)) for x in scene.loads)
    return replace(scene, loads=loads, gravity=None if scene.gravity is None else times(scene.gravity))


def _beside(pose: Configuration, loaded: Model, state: Motion) -> Configuration:
    """The equilibrium of the loaded model next to `state`, drives as they are."""
    target, clock = loaded.targets(pose.targets), Stopwatch()
    driven, how, motion, doubts = follow_load_path(
        thread_storage(loaded), state, LoadPath(target, target, (1.0, 1.0), rtol=RTOL), from_rest=False, planar=False
    )  # fmt: skip
    found = replace(
        pose, model=loaded, motion=motion, method="conventional", method_error=None, method_was_chosen=False,
        load_factor=1.0, steps=(as_step(driven, how, clock()),), negatives=driven.negatives, expected_negatives=len(target),
        doubts=doubts, joint_motions=None, notes=(), joints_near_intended=False,
    )  # fmt: skip
    if driven.stop is not Stop.CONVERGED:
        raise ConvergenceError(
            stop_sentence(loaded, driven, doubts), reached=driven.fraction_reached, result=found
        )
    return found


def _refine(found: Configuration) -> tuple[Array, Array]:
    """Two Newton steps more, in place: the last one (unknowns,), and the weights of its entries."""
    model, motion = found.model, found.motion
    for _ in range(2):
        assembled = assemble_tangent(model, motion, target=model.targets(found.targets))
        tangent = factor_tangent(assembled)
        step = tangent.solve(-assembled.work.rhs[:, None])[:, 0]
        take_step(assembled.arrays, motion, np.ascontiguousarray(step), assembled.work, 1.0)
    return step, tangent.weight()


def _backward_error(plus: Configuration, minus: Configuration, last: list[tuple[Array, Array]]) -> float:
    """What the last refinements of two states change, over half their distance."""
    arrays, one, other = plus.model.arrays, plus.motion, minus.motion
    apart, turned = np.zeros(arrays.plan.unknowns), np.empty(3)
    for k in np.flatnonzero(arrays.start >= 0):
        start = arrays.start[k]
        rotation_log(one.R[k] @ other.R[k].T, turned)
        apart[start : start + 6] = *(one.x[k] - other.x[k]), *turned
    apart[arrays.terms.start] = one.multiplier - other.multiplier
    norm = np.linalg.norm
    return max(float(norm(w * s)) / max(0.5 * float(norm(w * apart)), 1e-300) for s, w in last)
