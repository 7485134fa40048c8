"""The conventional solver: equilibrium of all nodes in load steps from the undeformed state (paper 1, Appendix B).

The steps are those of `ksd.solve.load_steps`. Newton with mixed integration points (MIP) is the default, plain
Newton with the paper's eps_max an option of the mesh and of the call; it is the baseline of every speed claim.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from ksd.errors import ConvergenceError, KsdError, SceneError
from ksd.model.arrays import Arrays, Loads, carries_load
from ksd.model.compile import Model
from ksd.numerics.stopwatch import Stopwatch
from ksd.solve.configuration import Configuration
from ksd.solve.joint_motions import JointMotionReader
from ksd.solve.load_steps import LoadPath, as_step, follow_load_path, stop_sentence
from ksd.solve.steps import MAX_TURN_PER_STEP, RTOL, Stop
from ksd.solve.storage import NewtonStorage, thread_storage
from ksd.solve.verdict import is_solved


def solve_conventional(
    model: Model,
    targets: Mapping[str, float],
    *,
    start: Configuration | None = None,
    planar: bool | Literal["auto"] = "auto",
    steps: int = 1,
    rtol: float = RTOL,
    cap: float = MAX_TURN_PER_STEP,
    eps_max: float = math.inf,
    most: int = 30,
    smallest: float = 1e-4,
    storage: NewtonStorage | None = None,
    joints: JointMotionReader | None = None,
    method: str = "conventional",
) -> Configuration:
    """Solve `model` at the drive values `targets` [m or rad] by load stepping.

    start: a configuration of the same model to continue from (rest when None). planar: "auto" solves planar scenes with
    three unknowns per node and checks the answer in space, False never does, True raises SceneError with the reason
    where that is not possible. steps: the number of equal steps tried first (1 as in Appendix B). eps_max [N and Nm
    mixed, as in the paper]: give a step up when the residual norm exceeds it. smallest: fraction of the drive motion
    below which steps are not halved any more. storage: of this model, not used by another thread meanwhile (that of the
    last call in this thread when None). joints: who reads the motions of the joints from the answer, when that is asked.
    method: what the answer is said to be by. Raises ConvergenceError with the fraction reached, SceneError for wrong drive
    names.
    """
    if planar not in ("auto", True, False):
        raise SceneError(f"planar = {planar!r}: choose 'auto', True or False")
    target = model.targets(targets)
    model.refuse_turns(target)
    storage, clock = storage or thread_storage(model), Stopwatch()
    begin = model.targets(start.targets) if start else np.zeros(len(target))
    low = start.load_factor if start else 0.0
    way = LoadPath(begin, target, (low, 1.0), steps, rtol, most, cap, eps_max, smallest)
    driven, how, found, doubts = follow_load_path(
        storage, start.motion if start else model.rest, way, from_rest=start is None, planar=planar
    )
    spent = clock()
    values, factor = way.values_at(driven.fraction_reached)
    result = Configuration(
        model, found, method,
        # supports follow the drives
        dict(zip(model.drive_names, values.tolist(), strict=False)),
        (as_step(driven, how, spent),),
        negatives=driven.negatives, expected_negatives=len(target), load_factor=factor, doubts=doubts, joint_motions=joints,
    )  # fmt: skip
    if driven.stop is not Stop.CONVERGED:
        raise ConvergenceError(
            stop_sentence(model, driven, doubts),
            reached=driven.fraction_reached,
            result=result,
        )
    return result


def solve_drives_first(
    model: Model,
    targets: Mapping[str, float],
    *,
    planar: bool | Literal["auto"] = "auto",
    joints: JointMotionReader | None = None,
) -> Configuration:
    """Solve at `targets` by moving the drives without the loads first, and putting the loads on there.

    The way of a designer who thinks of the intended motion first. planar, joints: see `solve_conventional`. Raises
    ConvergenceError as `solve_conventional`.
    """
    start = solve_without_loads(model, targets, planar=planar)
    return solve_conventional(model, targets, start=start, steps=4, planar=planar, joints=joints)


def solve_without_loads(
    model: Model, targets: Mapping[str, float], *, planar: bool | Literal["auto"] = "auto"
) -> Configuration:
    """The equilibrium at `targets` before the loads come on, to start from. Raises ConvergenceError."""
    return replace(
        solve_conventional(without_loads_model(model), targets, planar=planar), model=model, load_factor=0.0
    )


def solve_in_either_order(
    model: Model,
    targets: Mapping[str, float],
    *,
    storage: NewtonStorage | None = None,
    planar: bool | Literal["auto"] = "auto",
    joints: JointMotionReader | None = None,
    method: str = "conventional",
) -> Configuration:
    """Drives and loads together; where that fails or cannot be trusted, the drives first and the loads on top of them.

    storage, planar, joints, method: see `solve_conventional`. Raises ConvergenceError.
    """
    result, stopped = None, None
    try:
        result = solve_conventional(
            model, targets, storage=storage, planar=planar, joints=joints, method=method
        )
    except ConvergenceError as reason:
        stopped = reason
    if carries_load(model.arrays) and not (result is not None and is_solved(result)):
        with contextlib.suppress(KsdError):
            other = solve_drives_first(model, targets, planar=planar, joints=joints)
            if is_solved(other) or result is None:
                result = replace(other, notes=(*other.notes, "loads put on after the drives"), method=method)
    if result is None:
        assert stopped is not None
        raise stopped
    return result


def without_loads_model(model: Model) -> Model:
    """The same mechanism without loads and weight, in arrays of the same kind."""
    scene = replace(model.scene, loads=(), gravity=None)
    return replace(model, scene=scene, arrays=without_loads_arrays(model.arrays))


def without_loads_arrays(arrays: Arrays) -> Arrays:
    """The same mechanism without loads and weight, in arrays of the same kind."""
    loads = Loads(*(a[:0] for a in arrays.loads))
    return arrays._replace(loads=loads, weight=arrays.weight[:0])
