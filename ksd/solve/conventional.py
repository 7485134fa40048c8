"""The conventional solver: equilibrium of all nodes in load steps from the undeformed state (paper 1, Appendix B).

The whole step is tried first and halved on failure (`ksd.solve.driving`); an answer that may lie on another branch is
walked again in smaller steps (`ksd.solve.confirm`). Newton with mixed integration points (MIP) is the default, plain
Newton with the paper's eps_max an option of the mesh and of the call; it is the baseline of every speed claim.
"""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, Literal

import numpy as np

from ksd.errors import ConvergenceError, KsdError, SceneError
from ksd.model.arrays import Arrays, Loads, Motion, carries_load
from ksd.model.compile import Model
from ksd.model.plane import Plane, plane_of, refuse_plane
from ksd.numerics.stopwatch import thread_ns
from ksd.solve.arc import Course
from ksd.solve.configuration import Configuration
from ksd.solve.confirm import confirmed, doubt, rescued
from ksd.solve.driving import CAP, RTOL, Driven, drive_to
from ksd.solve.following import counted
from ksd.solve.path import Path, trace
from ksd.solve.steps import Step
from ksd.solve.stops import Stop
from ksd.solve.storage import Newton, Storage, storage_of
from ksd.solve.trust import solved_well

Arrived = tuple[Driven, str, Motion]
"""How driving went, in what, and where it ended."""


def _drive(
    storage: Storage, begin: Motion, ways: Mapping[str, Any], planar: bool | Literal["auto"], fresh: bool
) -> Arrived:
    """Drive from `begin` in the plane where the scene is planar, else in space; ways: options of `drive_to`. fresh: it is
    the rest state."""
    found: Driven | str = ""
    if planar is not False:
        plane = plane_of(storage.model)
        found = plane if isinstance(plane, str) else _drive_in_plane(storage, plane, begin, ways, fresh)
        if not isinstance(found, str):
            if planar is True or found.stop in (Stop.CONVERGED, Stop.LOCAL_ANGLE):
                arrived = storage.motion.copy()
                return _counted(storage.model, arrived, found, ways), "planar, 3 unknowns per node", arrived
            # space has the Newton with pivoting
            found = f"in the plane {found.stop.sentence}"
        elif planar is True:
            raise SceneError(
                f"planar = True: this mechanism is not planar: {found}; use planar = 'auto' or False"
            )
    storage.motion.assign(begin)
    pivoting = storage.model.arrays, storage.work
    driven = drive_to(storage.motion, storage.newton, pivoting=pivoting, begin=begin, **ways)
    arrived = storage.motion.copy()
    return _counted(storage.model, arrived, driven, ways), f"spatial: {found}" if found else "", arrived


POLISH = 3
"""Spatial iterations allowed to bring the rounding of a planar answer within the spatial bounds."""


def _drive_in_plane(
    storage: Storage, plane: Plane, begin: Motion, ways: Mapping[str, Any], fresh: bool
) -> Driven | str:
    """`drive_to` with three unknowns per node, or the reason why that is not possible.

    What it arrives at is looked at in space: a residual across the plane refuses it, and the residual and the negative
    pivots told are those of the spatial tangent, so that buckling out of the plane is seen.
    """
    model, motion = storage.model, storage.motion
    motion.assign(begin)
    if not fresh:
        if not plane.holds(begin):
            return "the configuration to start from is not in the plane"
        # forces that only hold the mechanism in its plane
        motion.multiplier[np.setdiff1d(np.arange(len(motion.multiplier)), plane.rows)] = 0.0

    def newton(*aim: Any) -> Newton:
        return storage.planar_newton(plane, *aim)

    driven = drive_to(motion, newton, begin=begin, **ways)
    start, target, (low, high), rtol = ways["start"], ways["target"], ways["factors"], ways["rtol"]
    done = driven.reached
    values, factor = target if done == 1.0 else start + done * (target - start), low + done * (high - low)
    residual, negatives, status = storage.look(values, rtol, factor)
    if residual > 1.0:
        share, node, force, moment = plane.imbalance(storage.work)
        if share > 1.0:
            said = (
                f"its leafs and loads do not balance across the plane: {force:.3g} N along its normal and "
                f"{moment:.3g} Nm across it are left on '{model.node_names[node]}'"
            )
            refuse_plane(model, said)
            return said
    if driven.stop is not Stop.CONVERGED:
        return driven
    count = 0
    if residual > max(1.0, 2.0 * driven.residual) or status != 0:
        reason, count, residual, negatives, _ = storage.newton(
            values, factor, rtol, POLISH, math.inf, math.inf
        )
        if reason != Stop.CONVERGED:
            return "what was found is no equilibrium in space"
    return driven._replace(solves=driven.solves + count, residual=residual, negatives=negatives)


def _counted(model: Model, motion: Motion, driven: Driven, ways: Mapping[str, Any]) -> Driven:
    """With what stands for negative pivots where loads are not conservative."""
    if driven.stop is not Stop.CONVERGED:
        return driven
    return driven._replace(negatives=counted(model, motion, ways["factors"][1], driven.negatives))


def _walk(
    storage: Storage, begin: Motion, ways: Mapping[str, Any], planar: bool | Literal["auto"], fresh: bool
) -> tuple[Driven, str, Motion, Any]:
    """As `_drive`, and what is doubtful is confirmed. Returns how it went, in words, where to, and doubts."""
    model = storage.model
    first = _drive(storage, begin, ways, planar, fresh)
    # with eps_max it is the paper's own program, which believes whatever converged
    if math.isfinite(ways["eps_max"]):
        return *first, ()
    reason = doubt(model, first[2], first[0], ways["target"], fresh=fresh, steps=ways["steps"])

    def again(steps: int) -> Arrived:
        finer = {**ways, "steps": steps, "smallest": min(ways["smallest"], 0.25 / steps)}
        return _drive(storage, begin, finer, planar, fresh)

    def arc() -> Path:
        low, high = ways["factors"]
        course = Course(ways["start"], ways["target"] - ways["start"], low, high - low)
        return trace(model, course, begin)

    if first[0].stop is not Stop.CONVERGED:
        return rescued(first, arc)
    if not reason:
        return *first, ()
    return confirmed(model, first, again, arc, reason)


def conventional(
    model: Model,
    targets: Mapping[str, float],
    *,
    start: Configuration | None = None,
    planar: bool | Literal["auto"] = "auto",
    steps: int = 1,
    rtol: float = RTOL,
    cap: float = CAP,
    eps_max: float = math.inf,
    most: int = 30,
    smallest: float = 1e-4,
    storage: Storage | None = None,
) -> Configuration:
    """Solve `model` at the drive values `targets` [m or rad] by load stepping.

    start: a configuration of the same model to continue from (rest when None). planar: "auto" solves planar scenes with
    three unknowns per node and checks the answer in space, False never does, True raises SceneError with the reason
    where that is not possible. steps: the number of equal steps tried first (1 as in Appendix B). eps_max [N and Nm
    mixed, as in the paper]: give a step up when the residual norm exceeds it. smallest: fraction of the drive motion
    below which steps are not halved any more. storage: of this model, not used by another thread meanwhile (that of the
    last call in this thread when None).
    Raises ConvergenceError with the fraction reached, SceneError for wrong drive names.
    """
    if planar not in ("auto", True, False):
        raise SceneError(f"planar = {planar!r}: choose 'auto', True or False")
    target = model.targets(targets)
    model.refuse_turns(target)
    begin = model.targets(start.targets) if start else np.zeros(len(target))
    ways: dict[str, Any] = {
        "start": begin, "target": target, "factors": (start.load_factor if start else 0.0, 1.0), "steps": steps,
        "rtol": rtol, "cap": cap, "eps_max": eps_max, "most": most, "smallest": smallest,
    }  # fmt: skip
    result, driven = _solved(storage or storage_of(model), start, ways, planar)
    if driven.stop is not Stop.CONVERGED:
        why = result.doubts[0] if result.doubts else driven.stop.sentence
        raise ConvergenceError(
            f"the conventional solver stopped at {100 * driven.reached:.3g} % of the drive motion: {why}",
            reached=driven.reached,
            result=result,
        )
    return result


def _solved(
    storage: Storage, start: Configuration | None, ways: Mapping[str, Any], planar: bool | Literal["auto"]
) -> tuple[Configuration, Driven]:
    """The walk from `start` and its record."""
    model, clock = storage.model, thread_ns()
    motion = model.rest if start is None else start.motion
    driven, how, found, doubts = _walk(storage, motion, ways, planar, start is None)
    spent = 1e-9 * (thread_ns() - clock)
    note = f"{driven.taken} load step{'s' * (driven.taken != 1)}{', ' * bool(how)}{how}"
    if driven.pivoted:
        note += ", with pivoting"
    step = Step("equilibrium", driven.solves, spent, driven.residual, driven.stop, note)
    begin, target, (low, high) = ways["start"], ways["target"], ways["factors"]
    values = target if driven.reached == 1.0 else begin + driven.reached * (target - begin)
    # supports follow the drives
    reached = dict(zip(model.drive_names, values.tolist(), strict=False))
    result = Configuration(
        model, found, "conventional", reached, (step,), negatives=driven.negatives, expected=len(target),
        load_factor=low + driven.reached * (high - low), doubts=doubts,
    )  # fmt: skip
    return result, driven


def loads_last(
    model: Model,
    targets: Mapping[str, float],
    *,
    steps: int = 4,
    unloaded: Configuration | None = None,
    planar: bool | Literal["auto"] = "auto",
) -> Configuration:
    """Solve at `targets` by moving the drives without the loads first, and putting the loads on there.

    The way of a designer who thinks of the intended motion first. unloaded: the state without loads, where it is known;
    planar: see `conventional`. Raises ConvergenceError as `conventional`.
    """
    moved = unloaded or conventional(bare(model), targets, planar=planar)
    start = replace(moved, model=model, load_factor=0.0)
    return conventional(model, targets, start=start, steps=steps, planar=planar)


def by_load_steps(
    model: Model,
    targets: Mapping[str, float],
    told: Callable[[Configuration], Configuration],
    *,
    storage: Storage | None = None,
    kinematic: Callable[[], Configuration] | None = None,
    planar: bool | Literal["auto"] = "auto",
) -> Configuration:
    """Drives and loads together; where that fails or cannot be trusted, the drives first and the loads on top of them; at
    last the loads on top of the unloaded state of the five steps, that of `kinematic`.

    told: adds what joint records know to a configuration. storage, planar: see `conventional`. Raises ConvergenceError.
    """
    result, stopped = None, None
    try:
        result = told(conventional(model, targets, storage=storage, planar=planar))
    except ConvergenceError as reason:
        stopped = reason
    ways: dict[str, Callable[[], Configuration | None]] = {"loads put on after the drives": lambda: None}
    if kinematic is not None:
        ways["loads put on the unloaded state of the five steps"] = kinematic
    for said, begin in ways.items() if carries_load(model.arrays) else ():
        if result is not None and solved_well(result):
            break
        with contextlib.suppress(KsdError):
            other = told(loads_last(model, targets, unloaded=begin(), planar=planar))
            if solved_well(other) or result is None:
                result = replace(other, notes=(*other.notes, said))
    if result is None:
        assert stopped is not None
        raise stopped
    return result


def bare(model: Model) -> Model:
    """The same mechanism without loads and weight, in arrays of the same kind."""
    scene = replace(model.scene, loads=(), gravity=None)
    return replace(model, scene=scene, arrays=without_loads(model.arrays))


def without_loads(arrays: Arrays) -> Arrays:
    """The same mechanism without loads and weight, in arrays of the same kind."""
    loads = Loads(*(a[:0] for a in arrays.loads))
    return arrays._replace(loads=loads, weight=arrays.weight[:0])
