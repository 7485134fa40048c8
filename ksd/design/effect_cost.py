"""What every effect of a scene changes in its answers, and what it costs in time and unknowns.

Each effect is put on and taken off alone, beside those the scene mentions; both are solved conventionally (so
that no difference of methods is mixed in), asked the same questions and timed.
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
from ksd.model.arrays import PLANAR
from ksd.model.compile import Model
from ksd.model.effects import INTRINSIC_EFFECTS, EffectChoice, choose_effects, mentioned_effects
from ksd.model.mesh import Mesh
from ksd.model.plane import plane_of
from ksd.solve.solver import Solver

TIMED_SOLVES = 9
"""Timed solves of every variant, interleaved; their median is shown."""


@dataclass(frozen=True)
class EffectCost:
    """One effect with and without: answers by quantity, thread time of a solve [s], unknowns solved for.

    kept: is it simulated when nobody says otherwise; why: the reason. failed says why there are no numbers.
    """

    name: str
    kept: bool
    why: str
    with_: Mapping[str, float]
    without: Mapping[str, float]
    times: tuple[float, float] = (math.nan, math.nan)
    unknowns: tuple[int, int] = (0, 0)
    failed: str = ""

    def changes(self) -> dict[str, float]:
        """Relative change of every quantity when the effect is put on."""
        found = {}
        for key, off in self.without.items():
            on = self.with_.get(key, math.nan)
            most = max(abs(on), abs(off))
            found[key] = (on - off) / most if most > 0.0 else 0.0
        return found


def unknown_count(model: Model) -> int:
    """Unknowns a solve of this model has, those condensed inside the leaves included: in its plane where it has one."""
    plane = plane_of(model)
    arrays = model.arrays if isinstance(plane, str) else plane.arrays
    members = arrays.members
    inner = np.diff(members.inner_at)
    # in its plane a leaf has its weak-bending amplitudes and three numbers of its wrench
    inner[members.kind == PLANAR] = members.number[members.kind == PLANAR, 0] + 3
    return int(arrays.plan.unknowns + inner.sum())


def quantities(pose: Any) -> dict[str, float]:
    """What is asked of every variant: drive forces, how far links move, softest support stiffness, first frequency."""
    found = {f"force {name}": float(value) for name, value in pose.forces.items()}
    model, motion = pose.model, pose.motion
    moved = np.linalg.norm(motion.x[1 : model.links] - model.rest.x[1 : model.links], axis=1)
    found["largest displacement"] = float(moved.max())
    terms = [t for d in model.scene.drives for t in d.terms] or [None]
    link = model.scene.links[1] if terms[0] is None else terms[0].link
    try:
        found["support stiffness"] = pose.stiffness(link).worst[0]
    except KsdError:
        found["support stiffness"] = math.nan
    # where nothing has mass there is none
    with contextlib.suppress(KsdError, IndexError):
        found["first frequency"] = float(pose.frequencies(count=1).frequency_Hz[0])
    return found


def effect_cost(
    scene: Any,
    targets: Mapping[str, float],
    *,
    mesh: Mesh | None = None,
    rounds: int | None = None,
) -> tuple[EffectChoice, list[EffectCost]]:
    """What is simulated, and the price of every effect the scene can have.

    scene: a Mechanism or Scene; targets: drive values [m or rad]. Raises SceneError for what is wrong with the scene;
    a variant that fails says so in its row. rounds: timed solves of each, `TIMED_SOLVES` when None.
    """
    frozen = scene.scene() if hasattr(scene, "scene") else scene
    grid = mesh or Mesh()
    choice = choose_effects(frozen, grid)
    spoken = mentioned_effects(frozen, grid)
    names = [e.name for e in choice.effects if e.name in spoken or e.name in INTRINSIC_EFFECTS]
    solvers: dict[tuple[str, ...], Solver] = {}

    def variant(present: set[str]) -> Solver:
        key = tuple(sorted(present))
        if key not in solvers:
            solvers[key] = Solver(frozen, mesh=grid, effects=key)
        return solvers[key]

    chosen = set(choice.present)
    return choice, [
        _price(
            choice,
            name,
            (variant(chosen | {name}), variant(chosen - {name})),
            targets,
            rounds or TIMED_SOLVES,
        )
        for name in names
    ]


def _price(
    choice: EffectChoice, name: str, pair: tuple[Solver, Solver], targets: Mapping[str, float], rounds: int
) -> EffectCost:
    """What one effect changes and costs: `pair` solves with and without it."""
    kept, why = choice[name].present, choice[name].reason
    try:
        # the first solve of each loads what it needs
        answers = [quantities(solver(targets, method="conventional")) for solver in pair]
        times = _times(pair, targets, rounds)
    except SceneError:
        raise
    except KsdError as reason:
        return EffectCost(name, kept, why, {}, {}, failed=str(reason))
    counts = (unknown_count(pair[0].model), unknown_count(pair[1].model))
    return EffectCost(name, kept, why, answers[0], answers[1], times, counts)


def _times(pair: tuple[Solver, Solver], targets: Mapping[str, float], rounds: int) -> tuple[float, float]:
    """Medians [s] of two solvers, in turns."""
    found: tuple[list[int], list[int]] = ([], [])
    for _ in range(rounds):
        for solver, mine in zip(pair, found, strict=True):
            begin = time.thread_time_ns()
            solver(targets, method="conventional")
            mine.append(time.thread_time_ns() - begin)
    return 1e-9 * statistics.median(found[0]), 1e-9 * statistics.median(found[1])
