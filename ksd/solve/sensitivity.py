"""How the answer to any question changes with a load: central difference of two equilibria beside the present one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ksd.errors import ConvergenceError, SceneError
from ksd.model.arrays import Motion
from ksd.model.compile import Model, compile_given, marked
from ksd.numerics.stopwatch import Stopwatch
from ksd.scene.drive import Load
from ksd.solve.load_steps import Way, load_steps, step_of, stopped
from ksd.solve.steps import Stop
from ksd.solve.storage import storage_of

if TYPE_CHECKING:
    from ksd.solve.configuration import Configuration

STEP = 1e-3
"""Part of the load that is added and taken away."""
RTOL = 1e-11


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
    this one is not found.
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
    answers = []
    for sign in (1.0, -1.0):
        f, m = (tuple((sign * STEP * part).tolist()) for part in (wrench[:3], wrench[3:]))
        extra = Load("sensitivity", name, f, m, tuple(np.asarray(at, float).tolist()))
        more = replace(model.scene, loads=(*model.scene.loads, extra))
        loaded = marked(compile_given(more, model.mesh), scene, model.choice)
        answers.append(question(_beside(pose, loaded, state)))
    plus, minus = answers
    if isinstance(plus, Mapping):
        return {k: (v - minus[k]) / (2 * STEP) for k, v in plus.items()}
    found = (np.asarray(plus, float) - np.asarray(minus, float)) / (2 * STEP)
    return float(found) if found.ndim == 0 else found


def _beside(pose: Configuration, loaded: Model, state: Motion) -> Configuration:
    """The equilibrium of the loaded model next to `state`, drives as they are."""
    target, clock = loaded.targets(pose.targets), Stopwatch()
    driven, how, motion, doubts = load_steps(
        storage_of(loaded), state, Way(target, target, (pose.load_factor, 1.0), rtol=RTOL), fresh=False, planar=False
    )  # fmt: skip
    found = replace(
        pose, model=loaded, motion=motion, method="conventional", method_error=None, chosen=False, load_factor=1.0,
        steps=(step_of(driven, how, clock()),), negatives=driven.negatives, expected=len(target), doubts=doubts,
        joint_motions=None, notes=(), near=False,
    )  # fmt: skip
    if driven.stop is not Stop.CONVERGED:
        raise ConvergenceError(stopped(driven, doubts), reached=driven.reached, result=found)
    return found
