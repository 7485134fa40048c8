"""The cost of every effect of a scene: changes of its answers, solve time and number of unknowns.

Each effect alone is added to, or removed from, the effects that the scene mentions. Both variants are solved
conventionally, so that no difference of methods enters, and their answers and solve times are compared.
"""

from __future__ import annotations

import contextlib
import math
import statistics
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ksd.errors import KsdError, SceneError
from ksd.model.chosen_effects import INTRINSIC_EFFECTS, EffectChoice, choose_effects, mentioned_effects
from ksd.model.mesh import Mesh
from ksd.solvers.solver import Solver

TIMED_SOLVES = 9
"""Timed solves of every variant, interleaved; the median is used."""


@dataclass(frozen=True)
class EffectCost:
    """Answers and cost of a scene with and without one effect.

    is_simulated: whether the effect is simulated by default; with_, without: answers by quantity; times: thread time of a
    solve [s] with and without it; unknowns: numbers of unknowns with and without it; failure: why there are no numbers.
    """

    name: str
    is_simulated: bool
    with_: Mapping[str, float]
    without: Mapping[str, float]
    times: tuple[float, float] = (math.nan, math.nan)
    unknowns: tuple[int, int] = (0, 0)
    failure: str = ""

    def relative_changes(self) -> dict[str, float]:
        """Relative change of every quantity when the effect is added."""
        changes = {}
        for quantity, off in self.without.items():
            on = self.with_.get(quantity, math.nan)
            largest = max(abs(on), abs(off))
            changes[quantity] = (on - off) / largest if largest > 0.0 else 0.0
        return changes


def _compared_quantities(pose: Any) -> dict[str, float]:
    """Drive forces, largest displacement of a link, least support stiffness and first frequency of a pose, SI."""
    values = {f"force {name}": float(value) for name, value in pose.forces.items()}
    model, motion = pose.model, pose.motion
    moved = np.linalg.norm(motion.x[1 : model.links] - model.rest.x[1 : model.links], axis=1)
    values["largest displacement"] = float(moved.max())
    terms = [t for d in model.scene.drives for t in d.terms] or [None]
    link = model.scene.links[1] if terms[0] is None else terms[0].link
    try:
        values["support stiffness"] = pose.stiffness(link).worst[0]
    except KsdError:
        values["support stiffness"] = math.nan
    # there is none where nothing has mass
    with contextlib.suppress(KsdError, IndexError):
        values["first frequency"] = float(pose.frequencies(count=1).frequency_Hz[0])
    return values


def effect_cost(
    scene: Any, targets: Mapping[str, float], *, rounds: int | None = None
) -> tuple[EffectChoice, list[EffectCost]]:
    """The effects that are simulated by default, and the cost of every effect that the scene can have.

    scene: a Mechanism or Scene; targets: drive values [m or rad]; rounds: timed solves of each variant, `TIMED_SOLVES` when
    None. A variant that cannot be solved has a `failure`. Raises SceneError for a wrong scene.
    """
    frozen = scene.scene() if hasattr(scene, "scene") else scene
    mesh = Mesh()
    choice = choose_effects(frozen, mesh)
    mentioned = mentioned_effects(frozen, mesh)
    names = [e.name for e in choice.effects if e.name in mentioned or e.name in INTRINSIC_EFFECTS]
    solvers: dict[tuple[str, ...], Solver] = {}

    def solver_with(effects: set[str]) -> Solver:
        key = tuple(sorted(effects))
        if key not in solvers:
            solvers[key] = Solver(frozen, mesh=mesh, effects=key)
        return solvers[key]

    chosen = set(choice.present)
    costs = []
    for name in names:
        pair = solver_with(chosen | {name}), solver_with(chosen - {name})
        costs.append(_cost_of(choice, name, pair, targets, rounds or TIMED_SOLVES))
    return choice, costs


def _cost_of(
    choice: EffectChoice, name: str, pair: tuple[Solver, Solver], targets: Mapping[str, float], rounds: int
) -> EffectCost:
    """The cost of one effect; pair: solvers with and without it."""
    is_simulated = choice[name].present
    try:
        # the first solve of each is not timed: it compiles and prepares
        answers = [_compared_quantities(solver(targets, method="conventional")) for solver in pair]
        times = _solve_times(pair, targets, rounds)
    except SceneError:
        raise
    except KsdError as reason:
        return EffectCost(name, is_simulated, {}, {}, failure=str(reason))
    counts = (pair[0].model.unknown_count, pair[1].model.unknown_count)
    return EffectCost(name, is_simulated, answers[0], answers[1], times, counts)


def _solve_times(
    pair: tuple[Solver, Solver], targets: Mapping[str, float], rounds: int
) -> tuple[float, float]:
    """Median thread times [s] of the solves of two solvers, which take turns."""
    times_ns: tuple[list[int], list[int]] = ([], [])
    for _ in range(rounds):
        for solver, own in zip(pair, times_ns, strict=True):
            begin = time.thread_time_ns()
            solver(targets, method="conventional")
            own.append(time.thread_time_ns() - begin)
    return 1e-9 * statistics.median(times_ns[0]), 1e-9 * statistics.median(times_ns[1])
