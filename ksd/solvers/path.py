"""Following an equilibrium path through limit points and bifurcations, and switching branches on request."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ksd.answers.printing import PrintableAnswer, format_number, format_table
from ksd.checks import clear_argument_errors, positive, whole_number
from ksd.checks import number as checked_number
from ksd.errors import SceneError
from ksd.model.arrays import carries_load
from ksd.model.compile import Model, compile_scene
from ksd.model.mesh import Mesh
from ksd.numerics.stopwatch import Stopwatch
from ksd.numerics.threads import small_matrices
from ksd.scene.mechanism import Mechanism
from ksd.scene.scene import Scene
from ksd.solvers.arc_length import (
    END_REACHED,
    ArcLengthPoint,
    PathContinuation,
    require_start,
    switch_branch,
)
from ksd.solvers.configuration import Configuration
from ksd.solvers.conventional import solve_without_loads
from ksd.solvers.load_steps import LoadPath
from ksd.solvers.solver import (
    COMPILED_MODEL_MESSAGE,
    given_values,
    refuse_unknown_drives,
    require_start_of,
)
from ksd.solvers.steps import DEFAULT_ACCURACY, Step, Stop
from ksd.solvers.verdict import with_mesh_check

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Turning:
    """A point where the path turns or branches.

    kind: "limit" (the parameter has an extremum) or "bifurcation" (another path crosses). factor: parameter there;
    configuration: the state there; mode (n,): null vector of the tangent in the order of the unknowns, used to switch
    branches.
    """

    kind: Literal["limit", "bifurcation"]
    factor: float
    configuration: Configuration
    mode: Array


@dataclass(frozen=True, repr=False)
class Path(PrintableAnswer):
    """Equilibria in order along a path.

    factor (k,): of the loads or of the drive motion; states: one configuration for each; turnings: limit points and
    bifurcations passed; stop: why the path ended, in words.

    >>> guide, _, _ = ksd.load_scene("guide")
    >>> path = ksd.follow(guide, table=5 * mm, control="drives", first=0.25)
    >>> print(f"{path.factor[-1]:.1f} of the way: {path.states[-1].forces['table']:.3f} N")
    1.0 of the way: 5.036 N
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
        """Warnings about the mesh, those of the state for which it is least adequate."""
        return max(self.states, key=lambda s: s.mesh_adequacy.missed_share).notes

    @property
    def ended(self) -> bool:
        """Whether the requested end was reached."""
        return self.stop.startswith(END_REACHED)

    @property
    def bifurcations(self) -> tuple[Turning, ...]:
        """The points where another branch crosses, in order."""
        return tuple(t for t in self.turnings if t.kind == "bifurcation")


@clear_argument_errors
@small_matrices
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
    **drives: float,
) -> Path:
    """Follow the equilibrium path by arc length, through limit points.

    scene: a Mechanism, Scene or Model. Drive values [m or rad] by name, as keywords or in a mapping, `targets`. control
    "load": the parameter is a factor on the loads, from 0 (or that of `start`) to `until`, with the drives constant at their
    values, to which they are moved first. control "drives": the parameter is the fraction of the drive motion to these
    values, from 0 (or `start`) to `until`, with constant loads; rotations may take any number of turns. branch: switch to
    the other branch at this bifurcation of an earlier path, on the `side` (+-1, times 0.01 rad or size) of its mode. until <
    0 goes backward. first: first step in the parameter; most: largest number of steps. mesh: that of `start` when None, or
    the default one; it stays as it is, where `ksd.solve` refines it; states for which it is too coarse carry a warning, and
    so does the path (`Path.warnings`). Raises SceneError for a path without a parameter (no load, no drive motion) and a
    start of another mechanism, ConvergenceError where the start is no equilibrium.

    >>> column = ksd.Mechanism("column", plane="xy")
    >>> leaf = column.leaf(
    ...     "ground", column.link("top"), start=(0, 0, 0), end=(0, 100 * mm, 0),
    ...     section=ksd.rectangle(1 * mm, 10 * mm), material=ksd.Material(E=200 * GPa, nu=0.3),
    ... )
    >>> load = column.load("top", force=(0, -50, 0), at=(0, 100 * mm, 0))
    >>> [turning.kind for turning in ksd.follow(column).turnings]
    ['bifurcation']
    """
    for value, name in ((until, "until"), (side, "side")):
        checked_number(value, name)
    positive(first, "first")
    whole_number(most, "most")
    if isinstance(scene, Model) and mesh is not None:
        raise SceneError(COMPILED_MODEL_MESSAGE)
    begin = start or (branch.configuration if branch else None)
    if mesh is None and isinstance(begin, Configuration):
        mesh = begin.model.mesh
    model = scene if isinstance(scene, Model) else compile_scene(scene, mesh=mesh)
    if begin is not None:
        require_start_of(model, begin)
    values = given_values(targets, drives)
    refuse_unknown_drives(drives, model.drive_names, follow)
    if (
        begin is None
        and control == "load"
        and model.targets({**dict.fromkeys(model.drive_names, 0.0), **values}).any()
    ):
        begin = solve_without_loads(model, values)
    load_path, f = _load_path(model, values, control, start=begin, branched=branch is not None)
    path = PathContinuation(model, load_path)
    clock = Stopwatch()
    motion = (begin.motion if begin else model.rest).copy()
    if branch is not None:
        at, direction = switch_branch(path.newton, motion, f, branch.mode * side)
    else:
        at = require_start(path.newton.correct(motion, f, None, max_iterations=40))
        direction = path.newton.direction(at, None)
        direction = direction if until >= at.f else -direction
    arc = first / max(abs(float(direction[-1])), 1e-9) if branch is None else 0.01
    path.follow(at, direction, until=until, arc=arc, max_steps=most)
    turnings = tuple(
        Turning(t.kind, t.point.f, _configuration(path, t.point), t.mode) for t in path.singular_points
    )
    states = tuple(_configuration(path, point) for point in path.points)
    factors = np.array([point.f for point in path.points])
    return Path(factors, states, turnings, f"{path.stop_reason} ({clock():.2f} s)")


def _configuration(path: PathContinuation, at: ArcLengthPoint) -> Configuration:
    """A point of the path as a configuration."""
    target, factor = path.newton.path.values_at(at.f)
    names = zip(path.model.drive_names, target, strict=False)
    stop = Stop.CONVERGED if at.local_angles_small else Stop.LOCAL_ANGLE
    step = Step("path", at.iterations, 0.0, at.residual, stop)
    found = Configuration(
        path.model, at.motion, "path", {n: float(v) for n, v in names}, (step,),
        negatives=path.newton.count_unstable(at), expected_negatives=len(target), load_factor=factor,
    )  # fmt: skip
    return with_mesh_check(found, DEFAULT_ACCURACY)


def _load_path(
    model: Model,
    values: Mapping[str, float],
    control: str,
    *,
    start: Configuration | None,
    branched: bool,
) -> tuple[LoadPath, float]:
    """The path of `follow`, and the value of its parameter at the start."""
    start_values = dict(start.targets) if start else dict.fromkeys(model.drive_names, 0.0)
    start_factor = start.load_factor if start else 0.0
    if control not in ("load", "drives"):
        raise SceneError(f"control = {control!r}: choose 'load' or 'drives'")
    if control == "load" and not carries_load(model.arrays):
        raise SceneError("control = 'load': this mechanism carries no load; use control = 'drives'")
    goal, here = model.targets({**start_values, **values}), model.targets(start_values)
    if control == "load":
        model.refuse_turns(goal, here)
        return LoadPath(goal, goal), start_factor
    begin = np.zeros(len(goal)) if branched else here
    change = goal - begin
    if not change.any():
        raise SceneError(
            "control = 'drives': give drive values that differ from where the path starts, for example top=0.1"
        )
    f = float((here - begin) @ change / (change @ change))
    factor = start_factor if start else 1.0
    return LoadPath(begin, goal, (factor, factor)), f
