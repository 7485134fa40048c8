"""Following an equilibrium path through limit points and bifurcations, and switching branches on request."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ksd.errors import ConvergenceError, SceneError
from ksd.model.arrays import Motion, carries_load, make_work
from ksd.model.compile import Model, compile_scene
from ksd.model.mesh import Mesh
from ksd.numerics.stopwatch import Stopwatch
from ksd.properties.words import Shown, listed, number
from ksd.scene.contents import Scene
from ksd.scene.mechanism import Mechanism
from ksd.solve.arc import Course, Place, Tracer
from ksd.solve.configuration import Configuration
from ksd.solve.pivoted import scaling
from ksd.solve.steps import Step
from ksd.solve.stops import Stop

Array = NDArray[np.float64]
LARGEST = 0.15
"""Largest arc of a step: rad, or displacement over the size of the mechanism, summed over the nodes."""
MOST_BEND = 0.5
"""Largest turn [rad] of the path's tangent in a step."""
SHORT = 1e-5
"""An arc below which its bend is accepted, whatever it is."""


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
class Path(Shown):
    """Equilibria in order along the path: factor (k,) of the loads or of the drive motion, one state for each.

    turnings: limit points and bifurcations passed; stop: why it ended, in words.
    """

    factor: Array
    states: tuple[Configuration, ...]
    turnings: tuple[Turning, ...]
    stop: str

    def _line(self) -> str:
        return f"{len(self.states)} states to {number(self.factor[-1])}, {len(self.turnings)} turning points; {self.stop}"

    def __str__(self) -> str:
        rows = [(number(f), *(number(v) for v in s.forces.values()), "yes" if s.stable else "no")
                for f, s in zip(self.factor, self.states, strict=True)]  # fmt: skip
        turns = [f"A {t.kind} point at factor {number(t.factor)}" for t in self.turnings]
        forces = (f"force or moment of {n}" for n in self.states[0].forces)
        return listed(
            ("factor", *forces, "<stable"), rows, f"Path of {len(rows)} equilibria: {self.stop}", *turns
        )

    @property
    def limits(self) -> tuple[float, ...]:
        """Factors at the limit points, in order."""
        return tuple(t.factor for t in self.turnings if t.kind == "limit")

    @property
    def ended(self) -> bool:
        """Whether the end asked for was reached."""
        return self.stop.startswith("the end was reached")

    @property
    def bifurcations(self) -> tuple[Turning, ...]:
        """The points where another branch crosses."""
        return tuple(t for t in self.turnings if t.kind == "bifurcation")


class _Walk:
    """One path while it is followed."""

    def __init__(self, model: Model, course: Course) -> None:
        self.model, self.course = model, course
        self.tracer = Tracer(model, course, make_work(model.arrays))
        self.states: list[Configuration] = []
        self.factors: list[float] = []
        self.turnings: list[Turning] = []

    def shown(self, at: Place) -> Configuration:
        """A place as a configuration."""
        target, factor = self.course.aim(at.f)
        names = zip(self.model.drive_names, target, strict=False)
        step = Step("path", at.iterations, 0.0, 0.0, Stop.CONVERGED if at.fits else Stop.LOCAL_ANGLE)
        return Configuration(
            self.model, at.motion, "path", {n: float(v) for n, v in names}, (step,),
            negatives=at.negatives, expected=len(target), load_factor=factor,
        )  # fmt: skip

    def keep(self, at: Place) -> None:
        """Record a place."""
        self.states.append(self.shown(at))
        self.factors.append(at.f)

    def turn(self, before: Place, direction: Array, after: Place, ahead: Array, arc: float) -> None:
        """Locate and record what lies between two places, if anything does."""
        if direction[-1] * ahead[-1] < 0.0:
            self._record("limit", self._limit(before, direction, after, ahead, arc))
            if abs(after.negatives - before.negatives) <= 1:
                return
        if after.negatives != before.negatives:
            self._record("bifurcation", self._bifurcation(before, direction, after, arc))

    def _record(self, kind: Literal["limit", "bifurcation"], at: Place) -> None:
        scale = scaling(0.5 * (at.K + at.K.T))
        values, vectors = np.linalg.eigh(0.5 * (at.K + at.K.T) * np.outer(scale, scale))
        mode = scale * vectors[:, int(np.argmin(np.abs(values)))]
        mode = mode / self.tracer.length(np.append(mode, 0.0))
        self.turnings.append(Turning(kind, at.f, self.shown(at), mode))

    def _limit(self, before: Place, direction: Array, after: Place, ahead: Array, arc: float) -> Place:
        """Where d(factor)/ds vanishes, by the false position (Illinois) on the arc."""
        low, high, g_low, g_high = 0.0, arc, float(direction[-1]), float(ahead[-1])
        best, smallest = after, abs(g_high)
        for _ in range(12):
            s = (low * g_high - high * g_low) / (g_high - g_low)
            at = self.tracer.advance(before, direction, s)
            if at is None:
                break
            g = float(self.tracer.tangent(at, direction)[-1])
            if abs(g) < smallest:
                best, smallest = at, abs(g)
            if abs(g) < 1e-6 * abs(direction[-1] - ahead[-1]):
                break
            if g * g_high > 0.0:
                high, g_high, g_low = s, g, 0.5 * g_low
            else:
                low, g_low, g_high = s, g, 0.5 * g_high
        return best

    def _bifurcation(self, before: Place, direction: Array, after: Place, arc: float) -> Place:
        """Where the inertia changes, by bisection of the arc."""
        low, high, best = 0.0, arc, after
        for _ in range(20):
            s = 0.5 * (low + high)
            at = self.tracer.advance(before, direction, s)
            if at is None:
                break
            if at.negatives == before.negatives:
                low = s
            else:
                high, best = s, at
        return best

    def _arc(self, at: Place, ahead: Array, arc: float, until: float) -> float:
        """Not past the end: the arc that would just reach `until`, if that is shorter."""
        slope = float(ahead[-1])
        if slope * (until - at.f) > 0.0:
            return min(arc, abs((until - at.f) / slope))
        return arc

    def go(self, at: Place, ahead: Array, *, until: float, arc: float, most: int) -> str:
        """Follow from `at` in direction `ahead`; returns why it stopped."""
        self.keep(at)
        sign, largest = (1.0 if until >= at.f else -1.0), LARGEST * np.sqrt(len(self.model.node_names))
        for _ in range(most):
            length = self._arc(at, ahead, min(arc, largest), until)
            found = self.tracer.advance(at, ahead, length)
            if found is None or (found.f - until) * sign > 1e-6 * abs(until):
                # too far, or no equilibrium in that plane
                arc = 0.5 * length
                if arc < 1e-9:
                    return "the arc was halved to its smallest size without reaching equilibrium"
                continue
            onward = self.tracer.tangent(found, ahead)
            bend = math.acos(min(1.0, float(ahead @ (self.tracer.metric * onward))))
            if bend > MOST_BEND and length > SHORT:
                # a sharp turn: closer, lest a limit point and the next one both lie in one step
                arc = 0.5 * length
                continue
            self.turn(at, ahead, found, onward, length)
            at, ahead = found, onward
            if abs(at.f - until) <= 2e-6 * abs(until):
                self.keep(self.tracer.correct(at.motion, until, None) or at)
                return "the end was reached"
            self.keep(at)
            if not at.fits:
                return Stop.LOCAL_ANGLE.sentence
            growth = min((4.0 / max(at.iterations, 1)) ** 0.5, 0.5 * MOST_BEND / max(bend, 1e-9))
            arc = max(arc, length) * float(np.clip(growth, 0.5, 1.5))
        return f"{most} steps were taken"


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
    most: int = 400,
    mesh: Mesh | None = None,
) -> Path:
    """Follow the equilibrium path by arc length, through limit points.

    scene: a Mechanism, Scene or Model. control "load": the loads times a factor from 0 (that of `start`) to `until`, the
    drives held at `targets`, brought there first. control "drives": the fraction of the way to `targets`, from 0 (`start`)
    to `until`, loads held. branch: switch to the other branch at this bifurcation of an earlier path, on the `side` (+-1,
    times 0.01 rad or size) of its mode. first: first step in the parameter; most: largest number of steps. until < 0 goes
    backward. Raises SceneError for a path without a parameter (no load, no drive motion), ConvergenceError where its start
    is no equilibrium.
    """
    model = scene if isinstance(scene, Model) else compile_scene(scene, mesh=mesh)
    begin = start or (branch.configuration if branch else None)
    if begin is None and control == "load" and any((targets or {}).values()):
        begin = _unloaded(model, targets or {})
    course, f = _course(model, targets, control, start=begin, branched=branch is not None)
    walk = _Walk(model, course)
    clock = Stopwatch()
    motion = (begin.motion if begin else model.rest).copy()
    if branch is not None:
        at, ahead = _switched(walk.tracer, motion, f, branch.mode * side)
    else:
        at = _found(walk.tracer.correct(motion, f, None, most=40))
        ahead = walk.tracer.tangent(at, None)
        ahead = ahead if until >= at.f else -ahead
    arc = first / max(abs(float(ahead[-1])), 1e-9) if branch is None else 0.01
    stop = walk.go(at, ahead, until=until, arc=arc, most=most)
    spent = clock()
    return Path(np.array(walk.factors), tuple(walk.states), tuple(walk.turnings), f"{stop} ({spent:.2f} s)")


def trace(
    model: Model, course: Course, motion: Motion, *, f: float = 0.0, first: float = 0.02, most: int = 300
) -> Path:
    """Follow a course of drives and loads from the equilibrium `motion` at parameter f to 1, by arc length.

    Raises ConvergenceError where the start is no equilibrium.
    """
    walk = _Walk(model, course)
    at = _found(walk.tracer.correct(motion.copy(), f, None, most=40))
    ahead = walk.tracer.tangent(at, None)
    stop = walk.go(at, ahead, until=1.0, arc=first / max(abs(float(ahead[-1])), 1e-9), most=most)
    return Path(np.array(walk.factors), tuple(walk.states), tuple(walk.turnings), stop)


def _unloaded(model: Model, targets: Mapping[str, float]) -> Configuration:
    """The equilibrium at drive values `targets` before the loads come on."""
    from ksd.solve.conventional import bare, conventional

    return replace(conventional(bare(model), targets), model=model, load_factor=0.0)


def _found(at: Place | None) -> Place:
    if at is None:
        raise ConvergenceError(
            "the start of the path is no equilibrium; solve it first and pass it as start=..."
        )
    return at


def _course(
    model: Model,
    targets: Mapping[str, float] | None,
    control: str,
    *,
    start: Configuration | None,
    branched: bool,
) -> tuple[Course, float]:
    """What is driven, and the parameter at the start."""
    held = dict(start.targets) if start else dict.fromkeys(model.drive_names, 0.0)
    level = start.load_factor if start else 0.0
    if control == "load":
        if not carries_load(model.arrays):
            raise SceneError("control = 'load': this mechanism carries no load; use control = 'drives'")
        target = model.targets({**held, **(targets or {})})
        return Course(target, np.zeros(len(target)), 0.0, 1.0), level
    if control != "drives":
        raise SceneError(f"control = {control!r}: choose 'load' or 'drives'")
    goal = model.targets({**held, **(targets or {})})
    begin = np.zeros(len(goal)) if branched else model.targets(held)
    if not np.any(goal != begin):
        raise SceneError("control = 'drives': give targets that differ from where the path starts")
    f = 0.0
    if branched and start is not None:
        f = float((model.targets(held) - begin) @ (goal - begin) / ((goal - begin) @ (goal - begin)))
    return Course(begin, goal - begin, level if start else 1.0, 0.0), f


def _switched(tracer: Tracer, motion: Motion, f: float, mode: Array) -> tuple[Place, Array]:
    """A place on the other branch, 0.01 along `mode`, and the direction away from the bifurcation."""
    n = len(mode)
    at = _found(tracer.correct(motion, f, None))
    tracer.tangent(at, None)
    away = np.append(mode, 0.0)
    for size in (0.01, 0.003, 0.03, 0.001):
        found = tracer.advance(at, away, size)
        if found is not None and tracer.length(np.append(np.zeros(n), found.f - f)) < 50 * size:
            return found, tracer.tangent(found, away)
    raise ConvergenceError("the other branch was not found along the mode of this bifurcation")
