"""The conventional solver: equilibrium of all nodes in load steps from the undeformed state (paper 1, Appendix B).

The load steps are those of `ksd.solvers.load_steps`. Newton with mixed integration points (MIP) is the default; plain Newton
with the paper's eps_max, an option of the mesh and of the call, is the baseline of every speed claim.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Literal

import numpy as np

from ksd.errors import ConvergenceError, SceneError
from ksd.model.arrays import Arrays, Loads
from ksd.model.compile import Model
from ksd.model.newton import RTOL
from ksd.numerics.stopwatch import Stopwatch
from ksd.solvers.branch_check import follow_load_path
from ksd.solvers.configuration import Configuration
from ksd.solvers.joint_motions import JointMotionReader
from ksd.solvers.load_steps import LoadPath, as_step, stop_sentence
from ksd.solvers.steps import MAX_TURN_PER_STEP, Stop
from ksd.solvers.storage import NewtonStorage, thread_storage


def solve_conventional(
    model: Model,
    targets: Mapping[str, float],
    *,
    start: Configuration | None = None,
    planar: bool | Literal["auto"] = "auto",
    steps: int = 1,
    rtol: float = RTOL,
    max_turn: float = MAX_TURN_PER_STEP,
    eps_max: float = math.inf,
    max_iterations: int = 30,
    smallest_step: float = 1e-4,
    storage: NewtonStorage | None = None,
    joints: JointMotionReader | None = None,
    method: str = "conventional",
    chosen: str = "",
) -> Configuration:
    """Solve `model` at the drive values `targets` [m or rad] by load stepping.

    start: configuration of the same model to continue from (rest when None). planar: "auto" solves planar scenes with three
    unknowns per node and checks the result in space; False never does; True raises SceneError with the reason where that is
    not possible. steps: number of equal steps tried first (1 as in Appendix B). rtol, max_turn, max_iterations: see
    `ksd.model.newton.solve_equilibrium`; eps_max [N and Nm mixed, as in the paper]: norm of the residual above which a step
    is given up; smallest_step: fraction of the path below which steps are not halved any more. storage: of this model, not
    used by another thread meanwhile (that of this thread when None). joints: computes the joint motions of the result when
    they are read. method: name of the method in the result; chosen: see `Step`. Raises ConvergenceError with the fraction
    reached, SceneError for wrong drive names.
    """
    if planar not in ("auto", True, False):
        raise SceneError(f"planar = {planar!r}: choose 'auto', True or False")
    target = model.targets(targets)
    storage, clock = storage or thread_storage(model), Stopwatch()
    begin = model.targets(start.targets) if start else np.zeros(len(target))
    model.refuse_turns(target, begin if start else None)
    begin_factor = start.load_factor if start else 0.0
    path = LoadPath(
        begin, target, (begin_factor, 1.0), steps, rtol, max_iterations, max_turn, eps_max, smallest_step
    )
    record, words, motion, doubts = follow_load_path(
        storage, start.motion if start else model.rest, path, from_rest=start is None, planar=planar
    )
    time = clock()
    values, factor = path.values_at(record.fraction_reached)
    # the values of supports come after those of the drives
    drive_values = dict(zip(model.drive_names, values.tolist(), strict=False))
    result = Configuration(
        model, motion, method, drive_values, (as_step(record, words, time, chosen),), negatives=record.negatives,
        expected_negatives=len(target), load_factor=factor, doubts=doubts, joint_motions=joints,
    )  # fmt: skip
    if record.stop is not Stop.CONVERGED:
        raise ConvergenceError(
            stop_sentence(model, record, doubts),
            reached=record.fraction_reached,
            result=result,
        )
    return result


def solve_without_loads(model: Model, targets: Mapping[str, float]) -> Configuration:
    """The equilibrium at `targets` without loads, with the model that has them and a load factor of 0. Raises
    ConvergenceError."""
    scene = replace(model.scene, loads=(), gravity=None, line_loads=(), pressures=())
    unloaded = replace(model, scene=scene, arrays=without_loads_arrays(model.arrays))
    return replace(solve_conventional(unloaded, targets), model=model, load_factor=0.0)


def without_loads_arrays(arrays: Arrays) -> Arrays:
    """The same arrays without loads and weight."""
    loads = Loads(*(a[:0] for a in arrays.loads))
    return arrays.replace(loads=loads, weight=arrays.weight[:0])
