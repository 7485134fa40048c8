"""Following an equilibrium path through limit points and bifurcations, and switching branches on request."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ksd.checks import clear_argument_errors, positive, whole_number
from ksd.checks import number as checked_number
from ksd.errors import SceneError
from ksd.model.arrays import carries_load
from ksd.model.compile import Model, compile_scene
from ksd.model.mesh import Mesh
from ksd.numerics.stopwatch import Stopwatch
from ksd.properties.printing import PrintableAnswer, format_number, format_table
from ksd.scene.mechanism import Mechanism
from ksd.scene.scene import Scene
from ksd.solve.arc_length import (
    END_REACHED,
    ArcLengthPoint,
    PathContinuation,
    PathParameter,
    require_start,
    switch_branch,
)
from ksd.solve.configuration import Configuration
from ksd.solve.conventional import unloaded
from ksd.solve.solver import COMPILED, DEFAULT_ACCURACY
from ksd.solve.steps import Step, Stop
from ksd.solve.verdict import mesh_check

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Turning:
    """A point where the path turns or branches.

    kind: "limit" (the parameter has an extremum) or "bifurcation" (another path crosses). factor: parameter there;
    configuration: the state; mode (n,): null vector of the tangent in the order of the unknowns, to switch branches by.
    """

    kind: Literal["limit", "bifurcation"]
    factor: float
    configuration: Configuration
    mode: Array


@dataclass(frozen=True, repr=False)
class Path(PrintableAnswer):
    """Equilibria in order along the path: factor (k,) of the loads or of the drive motion; states: one for each.

    turnings: limit points and bifurcations passed; stop: why it ended, in words.
    """

    factor: Array
    states: tuple[Configuration, ...]
    turnings: tuple[Turning, ...]
    stop: str

    def _line(self) -> str:
        last = format_number(self.factor[-1])
        return f"{len(self.states)} states to {last}, {len(self.turnings)} turning points; {self.stop}"

    def __str__(self) -> str:
        rows = [(format_number(f), *(format_number(v) for v in s.forces.values()), "yes" if s.stable else "no")
                for f, s in zip(self.factor, self.states, strict=True)]  # fmt: skip
        turns = [f"A {t.kind} point at factor {format_number(t.factor)}" for t in self.turnings] + list(
            self.warnings
        )
        forces = (f"force or moment of {n}" for n in self.states[0].forces)
        return format_table(
            ("factor", *forces, "<stable"), rows, f"Path of {len(rows)} equilibria: {self.stop}", *turns
        )

    @property
    def limits(self) -> tuple[float, ...]:
        """Factors at the limit points, in order."""
        return tuple(t.factor for t in self.turnings if t.kind == "limit")

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the user should know of the mesh: the warning of the state it resolves least."""
        return max(self.states, key=lambda s: s.resolution.missed_share).notes

    @property
    def ended(self) -> bool:
        """Whether the end asked for was reached."""
        return self.stop.startswith(END_REACHED)

    @property
    def bifurcations(self) -> tuple[Turning, ...]:
        """The points where another branch crosses."""
        return tuple(t for t in self.turnings if t.kind == "bifurcation")


@clear_argument_errors
def follow(
    scene: Mechanism | Scene | Model,
    targets: Mapping[str, float] | None = None,
    *,
    control: Literal["load", "drives"] = "load",
    start: Configuration | None = None,
    branch: Turning | None = None,
    side: float = 1.0,
    until: float = 1.0,
    first: float = 0.02,
    most: int = 1000,
    mesh: Mesh | None = None,
) -> Path:
    """Follow the equilibrium path by arc length, through limit points.

    scene: a Mechanism, Scene or Model. control "load": the loads times a factor from 0 (that of `start`) to `until`, the
    drives held at `targets`, brought there first. control "drives": the fraction of the way to `targets`, from 0 (`start`)
    to `until`, loads held. branch: switch to the other branch at this bifurcation of an earlier path, on the `side` (+-1,
    times 0.01 rad or size) of its mode. first: first step in the parameter; most: largest number of steps. until < 0 goes
    backward. mesh: stays as given, where `ksd.solve` raises it; states it is too coarse for warn of it, and so does the
    path (`Path.warnings`). Raises SceneError for a path without a parameter (no load, no drive motion), ConvergenceError
    where its start is no equilibrium.
    """
    for value, name in ((until, "until"), (side, "side")):
        checked_number(value, name)
    positive(first, "first")
    whole_number(most, "most")
    if isinstance(scene, Model) and mesh is not None:
        raise SceneError(COMPILED)
    model = scene if isinstance(scene, Model) else compile_scene(scene, mesh=mesh)
    begin = start or (branch.configuration if branch else None)
    if begin is None and control == "load" and any((targets or {}).values()):
        begin = unloaded(model, targets or {})
    course, f = _course(model, targets, control, start=begin, branched=branch is not None)
    walk = PathContinuation(model, course)
    clock = Stopwatch()
    motion = (begin.motion if begin else model.rest).copy()
    if branch is not None:
        at, ahead = switch_branch(walk.newton, motion, f, branch.mode * side)
    else:
        at = require_start(walk.newton.correct(motion, f, None, most=40))
        ahead = walk.newton.tangent(at, None)
        ahead = ahead if until >= at.f else -ahead
    arc = first / max(abs(float(ahead[-1])), 1e-9) if branch is None else 0.01
    walk.follow(at, ahead, until=until, arc=arc, most=most)
    turnings = tuple(Turning(t.kind, t.point.f, _shown(walk, t.point), t.mode) for t in walk.singular_points)
    states = tuple(_shown(walk, place) for place in walk.points)
    factors = np.array([place.f for place in walk.points])
    return Path(factors, states, turnings, f"{walk.stop_reason} ({clock():.2f} s)")


def _shown(walk: PathContinuation, at: ArcLengthPoint) -> Configuration:
    """A place as a configuration."""
    target, factor = walk.parameter.values_at(at.f)
    names = zip(walk.model.drive_names, target, strict=False)
    step = Step("path", at.iterations, 0.0, at.residual, Stop.CONVERGED if at.fits else Stop.LOCAL_ANGLE)
    found = Configuration(
        walk.model, at.motion, "path", {n: float(v) for n, v in names}, (step,),
        negatives=at.negatives, expected=len(target), load_factor=factor,
    )  # fmt: skip
    return mesh_check(found, DEFAULT_ACCURACY)


def _course(
    model: Model,
    targets: Mapping[str, float] | None,
    control: str,
    *,
    start: Configuration | None,
    branched: bool,
) -> tuple[PathParameter, float]:
    """What is driven, and the parameter at the start."""
    held = dict(start.targets) if start else dict.fromkeys(model.drive_names, 0.0)
    level = start.load_factor if start else 0.0
    if control not in ("load", "drives"):
        raise SceneError(f"control = {control!r}: choose 'load' or 'drives'")
    if control == "load" and not carries_load(model.arrays):
        raise SceneError("control = 'load': this mechanism carries no load; use control = 'drives'")
    goal = model.targets({**held, **(targets or {})})
    model.refuse_turns(goal)
    if control == "load":
        return PathParameter(goal, np.zeros(len(goal)), 0.0, 1.0), level
    here = model.targets(held)
    begin = np.zeros(len(goal)) if branched else here
    way = goal - begin
    if not way.any():
        raise SceneError("control = 'drives': give targets that differ from where the path starts")
    return PathParameter(begin, way, level if start else 1.0, 0.0), float((here - begin) @ way / (way @ way))
