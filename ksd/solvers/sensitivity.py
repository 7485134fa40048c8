"""Sensitivity of any answer to a load: central difference of two equilibria with the load added and taken away.

Both equilibria are refined by Newton steps with the guarded tangent. The last of these steps relative to the distance of the
two states, in the norm of the diagonal, forces of drives and supports included, is the backward error of the difference.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.answers.tangent import assemble_tangent, factor_tangent
from ksd.checks import checked_question, vector, wrench_of
from ksd.errors import ConvergenceError, KinematicsError, SceneError
from ksd.model.arrays import State
from ksd.model.compile import Model, compile_as_is
from ksd.model.newton import take_step
from ksd.numerics.rotations import rotation_log
from ksd.numerics.stopwatch import Stopwatch
from ksd.scene.load import Load
from ksd.solvers.branch_check import follow_load_path
from ksd.solvers.load_steps import LoadPath, as_step, stop_sentence
from ksd.solvers.perturbed import difference_quotient
from ksd.solvers.result import Result, Solved
from ksd.solvers.steps import Stop
from ksd.solvers.storage import thread_storage

Array = NDArray[np.float64]
LOAD_FRACTION = 1e-3
"""Fraction of the load that is added and taken away."""
RTOL = 1e-11
"""Residual of a node relative to the sum of the element forces on it."""
MAX_BACKWARD_ERROR = 1e-4
"""Largest backward error of the difference of the two equilibria: four digits."""


def sensitivity(
    pose: Solved,
    question: Callable[[Solved], Any],
    link: Any,
    *,
    at: Any,
    force: Any = (0.0, 0.0, 0.0),
    moment: Any = (0.0, 0.0, 0.0),
) -> Any:
    """Change of ``question(pose)`` (number, array, or mapping of numbers) per whole of a dead load, to first order.

    The load: force (3,) [N], moment (3,) [Nm], global, on the point of `link` that is at `at` (3,) [m] at rest; it is added
    to those of the scene while the drives stay. Equilibria with plus and minus a thousandth of it are solved with the full
    model (chains in place of modal bodies) from the present state, so the question may be any: a stiffness, a frequency, a
    stress. Raises SceneError for wrong names or a load of zero, ConvergenceError where one of the equilibria is not found,
    KinematicsError where rounding leaves fewer than four digits of their difference.
    """
    name = getattr(link, "name", link)
    model, state = pose.unreduced_state
    scene = model.original_scene
    if name not in scene.links:
        raise SceneError(
            f"link '{name}' is not part of '{scene.name}'; its links are {', '.join(scene.links)}"
        )
    checked_question(question)
    load, place = (
        wrench_of(force, moment, f"load on '{name}'"),
        vector(at, "at", owner="sensitivity", unit="m"),
    )
    scaled = _scale_loads(model.scene, pose.load_factor)
    states: list[Solved] = []
    refinements: list[tuple[Array, Array]] = []
    for sign in (1.0, -1.0):
        f, m = (tuple((sign * LOAD_FRACTION * part).tolist()) for part in (load[:3], load[3:]))
        extra = Load("sensitivity", name, f, m, place)
        loaded_scene = replace(scaled, loads=(*scaled.loads, extra))
        loaded = compile_as_is(loaded_scene, model.mesh, scene, model.choice)
        states.append(_loaded_equilibrium(pose, loaded, state))
        refinements.append(_refine(states[-1]))
    error = _backward_error(states[0], states[1], refinements)
    if not error <= MAX_BACKWARD_ERROR:
        raise KinematicsError(
            f"sensitivity: rounding leaves fewer than four digits of what a thousandth of the load on '{name}' changes "
            f"(backward error {error:.1e}): give a larger load, or hold what hardly anything resists"
        )
    plus, minus = (question(loaded_pose) for loaded_pose in states)
    return difference_quotient(plus, minus, 2 * LOAD_FRACTION)


def _scale_loads(scene: Any, factor: float) -> Any:
    """The scene with its loads and gravity times a load factor."""

    def times(vector: Any) -> Any:
        return tuple(factor * part for part in vector)

    loads = tuple(replace(x, force=times(x.force), moment=times(x.moment)) for x in scene.loads)
    lines = tuple(
        replace(
            x,
            force=times(x.force),
            to=times(x.end_force),
            moment=times(x.moment),
            to_moment=times(x.end_moment),
        )
        for x in scene.line_loads
    )
    pressures = tuple(replace(x, pressure=factor * x.pressure) for x in scene.pressures)
    return replace(
        scene,
        loads=loads,
        line_loads=lines,
        pressures=pressures,
        gravity=None if scene.gravity is None else times(scene.gravity),
    )


def _loaded_equilibrium(pose: Solved, loaded: Model, state: State) -> Solved:
    """The equilibrium of the loaded model next to `state`, at the drive values of the pose."""
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


def _refine(found: Result) -> tuple[Array, Array]:
    """Two more Newton steps, in place; returns the last one (unknowns,) and the weights of its entries."""
    model, motion = found.model, found.motion
    for _ in range(2):
        assembled = assemble_tangent(model, motion, target=model.targets(found.targets))
        tangent = factor_tangent(assembled)
        step = tangent.solve(-assembled.work.rhs[:, None])[:, 0]
        take_step(assembled.arrays, motion, np.ascontiguousarray(step), assembled.work, 1.0)
    return step, tangent.weight()


def _backward_error(plus: Result, minus: Result, last: list[tuple[Array, Array]]) -> float:
    """Largest weighted norm of the last Newton steps of two states, over half that of their difference."""
    arrays, one, other = plus.model.arrays, plus.motion, minus.motion
    apart, turned = np.zeros(arrays.plan.unknowns), np.empty(3)
    for k in np.flatnonzero(arrays.start >= 0):
        start = arrays.start[k]
        rotation_log(one.R[k] @ other.R[k].T, turned)
        apart[start : start + 6] = *(one.x[k] - other.x[k]), *turned
    apart[arrays.terms.start] = one.multiplier - other.multiplier
    norm = np.linalg.norm
    return max(float(norm(w * s)) / max(0.5 * float(norm(w * apart)), 1e-300) for s, w in last)
