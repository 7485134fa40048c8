"""Equilibrium paths by arc length: Newton with the path parameter as one more unknown.

Bordered system of Riks (Int. J. Solids Structures 15, 1979) and Keller (1977): the correction stays in the plane normal to
the predictor, in a metric of displacements over the size of the mechanism, rotations and the scaled parameter. The bordered
matrix (`ksd.solvers.bordered`) is regular at limit points, where the tangent itself is singular.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ksd.answers.divergence import count_unstable_directions
from ksd.answers.leaf_groups import shape_difference
from ksd.answers.tangent import Tangent
from ksd.errors import ConvergenceError
from ksd.model.arrays import State, Workspace, make_workspace
from ksd.model.compile import Model
from ksd.model.load_rate import distributed_force
from ksd.model.newton import (
    STALLED_RESIDUAL_LIMIT,
    assemble,
    largest_displacement,
    largest_rotation,
    take_step,
)
from ksd.solvers.bordered import determinant_parity, path_tangent, solve_bordered
from ksd.solvers.load_steps import SAME_STATE_TOLERANCE, LoadPath, state_difference
from ksd.solvers.steps import Stop

Array = NDArray[np.float64]
MAX_ARC = 0.15
"""Largest arc of a step per square root of the number of nodes: rad, or displacement over the size of the mechanism."""
MAX_ANGLE = 0.5
"""Largest angle [rad] between the path tangents at both ends of a step."""
MAX_CORRECTION = 0.15
"""Largest Newton correction of a step relative to its arc; a longer one may end on another path."""
MAX_BEND_CORRECTION, MIN_CHECKED_BEND = 0.3, 1e-4
"""Largest Newton correction of the shape of a leaf spring relative to its change on a step, and that [rad] which is always
accepted: a larger one may be that of a leaf spring that buckles between its ends, to another side than the path."""
MIN_CHECKED_ARC, MIN_BEND_ARC = 1e-5, 1e-8
"""Arcs below which a step is accepted at any angle and correction, and at any correction of the shape of leaf springs, which
may buckle while nodes hardly move."""
MIN_SINGULAR_SPACING = 1e-4
"""Arc, or parameter over its range, between singular points below which they are recorded as one."""
MIN_SEPARATION = 3e-7
"""Arc below which two paths are not distinguished."""
MIN_REGULAR_EIGENVALUE = 1e-2
"""Smallest absolute eigenvalue of a tangent in the metric of its diagonal that counts as regular."""
BISECTIONS = 16
"""Bisections of an arc on which a singular point is located."""


@dataclass(frozen=True)
class ArcLengthPoint:
    """An equilibrium on the path.

    f: path parameter, the fraction of the `LoadPath`; negatives: negative pivots, those inside members and one per
    constraint row included; changes: what changes at singular points, `negatives`, or under non-conservative loads the
    parity of the determinant; tangent: None for a point that is only kept; b (n,): derivative of the residual by f;
    residual: over its bound; correction: arc length of the Newton steps after the predictor; bend_correction: what they
    change of the shape of a leaf spring, see `shape_difference`. local_angles_small: whether all elements are within their
    range.
    """

    motion: State
    f: float
    negatives: int
    changes: int
    tangent: Tangent | None
    b: Array
    iterations: int
    local_angles_small: bool = True
    residual: float = 0.0
    correction: float = 0.0
    bend_correction: float = 0.0


def residual_rate(model: Model, motion: State, path: LoadPath, work: Workspace) -> Array:
    """Derivative (n,) of the residual by the path parameter; work: as assembled at `motion`."""
    arrays = model.arrays
    b = np.zeros(arrays.plan.unknowns)
    b[arrays.terms.start] = path.start - path.target
    loads, factor_rate = arrays.loads, path.factors[1] - path.factors[0]
    for i, node in enumerate(loads.node if factor_rate else ()):
        u, T = int(arrays.start[node]), motion.R[node]
        turn = T if loads.following[i] else np.eye(3)
        force = turn @ loads.force[i]
        moment = turn @ loads.moment[i] + np.cross(T @ loads.point[i], force)
        b[u : u + 3] -= factor_rate * force
        b[u + 3 : u + 6] -= factor_rate * moment
    if factor_rate and len(arrays.weight):
        b += factor_rate * distributed_force(arrays, work)
    return b


class ArcLengthNewton:
    """Newton with arc length for one model and path; not for two threads at once.

    Steps and directions are arrays (n + 1,): the unknowns of the model, and the path parameter.
    """

    def __init__(self, model: Model, path: LoadPath) -> None:
        self.model, self.path, self.work = model, path, make_workspace(model.arrays)
        self.metric = np.zeros(model.arrays.plan.unknowns + 1)
        for u in (int(s) for s in model.arrays.start if s >= 0):
            self.metric[u : u + 3] = model.arrays.size**-2
            self.metric[u + 3 : u + 6] = 1.0

    def arc_length(self, z: Array) -> float:
        """Arc length of a step z."""
        return math.sqrt(float(z @ (self.metric * z)))

    def angle(self, one: Array, other: Array) -> float:
        """Angle [rad] between two unit directions."""
        return math.acos(min(1.0, float(one @ (self.metric * other))))

    def direction(self, at: ArcLengthPoint, before: Array | None) -> Array:
        """Unit direction of the path, at an acute angle to the direction `before`; of rising parameter when None."""
        n = len(at.b)
        c = np.append(np.zeros(n), 1.0) if before is None else self.metric * before
        assert at.tangent is not None
        t = solve_bordered(at.tangent, at.b, c, np.append(np.zeros(n), 1.0))
        if before is None:
            # one unit of the parameter counts as much as the displacement it causes at first
            self.metric[n] = max(float(t[:n] @ (self.metric[:n] * t[:n])), 1e-12)
        return t / self.arc_length(t)

    def correct(
        self,
        motion: State,
        f: float,
        normal: Array | None,
        *,
        predictor: Array | None = None,
        max_iterations: int = 14,
    ) -> ArcLengthPoint | None:
        """Equilibrium in the plane normal to `normal` through the predicted point, or at fixed f when None.

        motion is changed in place; predictor (n + 1,): a step taken first. None where Newton fails.
        """
        arrays, work = self.model.arrays, self.work
        n = arrays.plan.unknowns
        c = np.append(np.zeros(n), 1.0) if normal is None else self.metric * normal
        moved = math.inf
        step, corrections, predicted = predictor, np.zeros(n + 1), motion.inner
        for count in range(max_iterations + 1):
            worst, _, inside, status = assemble(arrays, motion, *self.path.values_at(f), work)
            if not math.isfinite(worst):
                return None
            # looser than `ksd.model.newton.has_converged`: points are only passed, and chains converge to them slowly
            done = step is None and (worst <= 1.0 or (worst <= STALLED_RESIDUAL_LIMIT and moved <= 1.0))
            if (done and status == 2) or (not done and count == max_iterations):
                return None
            if step is None:
                factor, b = self.path.values_at(f)[1], residual_rate(self.model, motion, self.path, work)
                tangent = path_tangent(self.model, motion, factor, work, int(inside))
                if done:
                    below = tangent.unstable + len(arrays.terms.start)
                    changes = below if self.model.conservative else determinant_parity(tangent)
                    return ArcLengthPoint(
                        motion,
                        f,
                        below,
                        changes,
                        tangent,
                        b,
                        count,
                        status == 0,
                        worst,
                        self.arc_length(corrections),
                        shape_difference(self.model, motion.inner, predicted),
                    )
                try:
                    step = solve_bordered(tangent, b, c, np.append(-work.rhs, 0.0))
                except np.linalg.LinAlgError:
                    return None
            turn, move = largest_rotation(arrays, step[:n]), largest_displacement(arrays, step[:n])
            if not max(turn, move / arrays.size) < (0.5 if predictor is None or count > 0 else 2.0):
                return None
            moved = max(turn / 1e-6, move / (1e-7 * arrays.size))
            take_step(arrays, motion, np.ascontiguousarray(step[:n]), work, 1.0)
            f += float(step[n])
            if step is predictor:
                predicted = motion.inner.copy()
            else:
                corrections += step
            step = None
        return None

    def count_unstable(self, at: ArcLengthPoint) -> int:
        """Negative pivots of a point, or the count that replaces them, see `count_unstable_directions`."""
        return count_unstable_directions(self.model, at.motion, self.path.values_at(at.f)[1], at.negatives)

    def advance(self, at: ArcLengthPoint, direction: Array, arc: float) -> ArcLengthPoint | None:
        """The point an arc further along `direction`; None where Newton fails."""
        motion = at.motion.copy()
        # the members store results of their last assembly, which must be that of this state
        assemble(self.model.arrays, motion, *self.path.values_at(at.f), self.work)
        return self.correct(motion, at.f, direction, predictor=arc * direction)


@dataclass(frozen=True)
class SingularPoint:
    """A limit point or bifurcation, and the null vector (n,) of the tangent there; zeros where a leaf spring buckles between
    its nodes, which stay."""

    kind: Literal["limit", "bifurcation"]
    point: ArcLengthPoint
    mode: Array


def _another_path_crosses(
    before: ArcLengthPoint, direction: Array, after: ArcLengthPoint, next_direction: Array
) -> bool:
    """Whether the determinant of the bordered tangent has opposite signs at two points.

    It keeps its sign along a path and changes it where another path crosses (Allgower and Georg, Introduction to numerical
    continuation methods, 2003, chapter 8). The sign is (-1)^changes times that of the rate of the parameter.
    """
    reversed_ = direction[-1] * next_direction[-1] < 0.0
    return reversed_ != ((after.changes - before.changes) % 2 == 1)


END_REACHED = "the end was reached"
"""Stop reason of a path that was followed to its end."""
RETURNED_TO_START = (
    "it came back to its start, over another path that passes closely, as where a small imperfection takes a bifurcation "
    "apart: leave that out and switch at the bifurcation (ksd.follow, branch=), or make it larger"
)
"""Stop reason of a path that would continue from its start backwards."""


class PathContinuation:
    """A path while it is followed: its points (without their tangents), its singular points, and why it stopped."""

    def __init__(self, model: Model, path: LoadPath) -> None:
        self.model = model
        self.newton = ArcLengthNewton(model, path)
        self.points: list[ArcLengthPoint] = []
        self.singular_points: list[SingularPoint] = []
        self.stop_reason = ""

    @property
    def factorisations(self) -> int:
        """Factorisations for all points together."""
        return sum(at.iterations for at in self.points)

    def _store(self, at: ArcLengthPoint) -> None:
        """Append a point without its tangent, which would fill the memory on a long path."""
        self.points.append(replace(at, tangent=None))

    def _find_singular_points(
        self,
        before: ArcLengthPoint,
        direction: Array,
        after: ArcLengthPoint,
        next_direction: Array,
        arc: float,
    ) -> bool:
        """Locate and record the singular points between two points, if any.

        Returns False, and records nothing, where the points are on two different paths, as near a bifurcation that an
        imperfection has taken apart.
        """
        limit = direction[-1] * next_direction[-1] < 0.0
        branches = None
        if _another_path_crosses(before, direction, after, next_direction):
            branches = self._crossing(before, direction, next_direction, arc)
            if branches is None and arc >= MIN_SEPARATION:
                return False
            branches = branches or after
        elif abs(after.changes - before.changes) > int(limit):
            ends = self._bisect(before, direction, arc, lambda at, _: at.changes != before.changes)
            branches = after if ends is None or ends[1] is None else ends[1]
        if limit:
            self._record("limit", self._limit_point(before, direction, after, next_direction, arc))
        if branches is not None:
            self._record("bifurcation", branches)
        return True

    def _record(self, kind: Literal["limit", "bifurcation"], at: ArcLengthPoint) -> None:
        """Append a singular point with its mode, see `Tangent.softest`."""
        assert at.tangent is not None
        mode, value = at.tangent.softest()
        mode = mode / self.newton.arc_length(np.append(mode, 0.0))
        # a tangent of the nodes that is regular there: the singular part is condensed inside the leaf springs
        inside = kind == "bifurcation" and value > MIN_REGULAR_EIGENVALUE
        self.singular_points.append(SingularPoint(kind, at, np.zeros_like(mode) if inside else mode))

    def _limit_point(
        self,
        before: ArcLengthPoint,
        direction: Array,
        after: ArcLengthPoint,
        next_direction: Array,
        arc: float,
    ) -> ArcLengthPoint:
        """The point on an arc where df/ds vanishes, by regula falsi (Illinois)."""
        low, high, g_low, g_high = 0.0, arc, float(direction[-1]), float(next_direction[-1])
        best, smallest = after, abs(g_high)
        for _ in range(12):
            s = (low * g_high - high * g_low) / (g_high - g_low)
            at = self.newton.advance(before, direction, s)
            if at is None:
                break
            g = float(self.newton.direction(at, direction)[-1])
            if abs(g) < smallest:
                best, smallest = at, abs(g)
            if abs(g) < 1e-6 * abs(direction[-1] - next_direction[-1]):
                break
            if g * g_high > 0.0:
                high, g_high, g_low = s, g, 0.5 * g_low
            else:
                low, g_low, g_high = s, g, 0.5 * g_high
        return best

    def _crossing(
        self, before: ArcLengthPoint, direction: Array, next_direction: Array, arc: float
    ) -> ArcLengthPoint | None:
        """The point on an arc where another path crosses; None where two paths pass each other without meeting."""
        ends = self._bisect(
            before, direction, arc, lambda at, onward: _another_path_crosses(before, direction, at, onward)
        )
        one, other = ends or (before, None)
        if other is None:
            return None
        tolerance = 5.0 * arc * 0.5**BISECTIONS + MIN_SEPARATION
        steepest = max(abs(direction[-1]), abs(next_direction[-1]))
        meets = (
            state_difference(self.model, one.motion, other.motion) < tolerance
            and abs(one.f - other.f) < steepest * tolerance + 1e-9
        )
        return other if meets else None

    def _bisect(
        self,
        before: ArcLengthPoint,
        direction: Array,
        arc: float,
        beyond: Callable[[ArcLengthPoint, Array], bool],
    ) -> tuple[ArcLengthPoint, ArcLengthPoint | None] | None:
        """Bisect an arc: the last point for which `beyond` is false, and the first one for which it is true, if any.

        None where the path turns sharply or Newton fails.
        """
        low, high = 0.0, arc
        ends: tuple[ArcLengthPoint, ArcLengthPoint | None] = before, None
        for _ in range(BISECTIONS):
            s = 0.5 * (low + high)
            at = self.newton.advance(before, direction, s)
            if at is None:
                return None
            onward = self.newton.direction(at, direction)
            if self.newton.angle(direction, onward) > MAX_ANGLE:
                return None
            if beyond(at, onward):
                high, ends = s, (ends[0], at)
            else:
                low, ends = s, (at, ends[1])
        return ends

    def _returned(self, at: ArcLengthPoint, found: ArcLengthPoint) -> bool:
        """Whether the start of the path lies between two points."""
        home = self.points[0]
        if (
            len(self.points) == 1
            or not (at.f - home.f) * (found.f - home.f) < 0.0
            or found.changes != home.changes
        ):
            return False
        back = self.newton.correct(found.motion.copy(), home.f, None)
        if back is None:
            return False
        return state_difference(self.model, back.motion, home.motion) < SAME_STATE_TOLERANCE

    def follow(
        self,
        at: ArcLengthPoint,
        direction: Array,
        *,
        until: float,
        arc: float,
        max_steps: int,
        max_singular_points: float = math.inf,
    ) -> None:
        """Follow the path from `at` along `direction` to the parameter `until`, with a first step of length `arc`.

        It stops once `max_singular_points` limit points and bifurcations have been found, or after `max_steps` steps.
        """
        self._store(at)
        self.stop_reason = END_REACHED
        if at.f == until:
            return
        rate: Array | None = None
        sign, max_arc = (1.0 if until >= at.f else -1.0), MAX_ARC * np.sqrt(len(self.model.node_names))
        for _ in range(max_steps):
            length, slope = min(arc, max_arc), float(direction[-1])
            if slope * (until - at.f) > 0.0:
                # not past the end
                length = min(length, abs((until - at.f) / slope))
            found = self.newton.advance(at, direction, length)
            if found is None or (found.f - until) * sign > 1e-6 * abs(until):
                # no equilibrium in that plane, or past the end
                arc = 0.5 * length
                if arc < 1e-9:
                    self.stop_reason = "the arc was halved to its smallest size without reaching equilibrium"
                    return
                continue
            onward = self.newton.direction(found, direction)
            angle = self.newton.angle(direction, onward)
            bend = shape_difference(self.model, found.motion.inner, at.motion.inner)
            foretold = at.motion.inner if rate is None else at.motion.inner + length * rate
            missed = min(found.bend_correction, shape_difference(self.model, found.motion.inner, foretold))
            snaps = missed > MIN_CHECKED_BEND + MAX_BEND_CORRECTION * bend
            turns = angle > MAX_ANGLE or found.correction > MAX_CORRECTION * length
            if (snaps and length > MIN_BEND_ARC) or (turns and length > MIN_CHECKED_ARC):
                # a sharp turn: smaller steps, lest a limit point and the next one both lie in one step
                arc = 0.5 * length
                continue
            spacing = max(length, abs(found.f - at.f) / abs(until - self.points[0].f))
            if abs(found.changes - at.changes) > 1 and spacing > MIN_SINGULAR_SPACING:
                # several singular points: smaller steps, so that each one is recorded
                arc = 0.5 * length
                continue
            if not self._find_singular_points(at, direction, found, onward, length):
                arc = 0.5 * length
                continue
            if len(self.singular_points) >= max_singular_points:
                self.stop_reason = "it turns"
                return
            if self._returned(at, found):
                self.stop_reason = RETURNED_TO_START
                return
            rate = (found.motion.inner - at.motion.inner) / length
            at, direction = found, onward
            if abs(at.f - until) <= 2e-6 * abs(until):
                self._store(self.newton.correct(at.motion, until, None) or at)
                return
            self._store(at)
            if not at.local_angles_small:
                self.stop_reason = Stop.LOCAL_ANGLE.sentence
                return
            growth = min((4.0 / max(at.iterations, 1)) ** 0.5, 0.5 * MAX_ANGLE / max(angle, 1e-9))
            arc = max(arc, length) * float(np.clip(growth, 0.5, 1.5))
        self.stop_reason = f"{max_steps} steps were taken"


def require_start(at: ArcLengthPoint | None) -> ArcLengthPoint:
    """The start of a path; raises ConvergenceError where Newton found none."""
    if at is None:
        raise ConvergenceError(
            "the start of the path is no equilibrium; solve it first and pass it as start=..."
        )
    return at


def follow_by_arc_length(
    model: Model, path: LoadPath, motion: State, *, max_singular_points: float = math.inf
) -> PathContinuation:
    """Follow a path from the equilibrium `motion` at its start to its end, or until `max_singular_points` limit points and
    bifurcations have been found.

    Raises ConvergenceError where the start is no equilibrium.
    """
    followed = PathContinuation(model, path)
    at = require_start(followed.newton.correct(motion.copy(), 0.0, None, max_iterations=40))
    direction = followed.newton.direction(at, None)
    arc = 0.02 / max(abs(float(direction[-1])), 1e-9)
    followed.follow(at, direction, until=1.0, arc=arc, max_steps=300, max_singular_points=max_singular_points)
    return followed


def switch_branch(
    newton: ArcLengthNewton, motion: State, f: float, mode: Array
) -> tuple[ArcLengthPoint, Array]:
    """A point of the other branch, 0.01 along `mode`, and its direction away from the bifurcation.

    Raises ConvergenceError where the other branch is not found, and for a mode of zero.
    """
    n = len(mode)
    if not mode.any():
        names = ", ".join(f"'{name}'" for name in newton.model.member_names[:3])
        raise ConvergenceError(
            "at this bifurcation a leaf spring buckles between its ends, where the path has no node to leave along: draw a "
            f"point on it, mechanism.point(leaf, s) with s [m] off its middle (leaf springs: {names}), and follow that "
            "mechanism"
        )
    at = require_start(newton.correct(motion, f, None))
    newton.direction(at, None)
    away = np.append(mode, 0.0)
    for arc in (0.01, 0.003, 0.03, 0.001):
        found = newton.advance(at, away, arc)
        if found is not None and newton.arc_length(np.append(np.zeros(n), found.f - f)) < 50 * arc:
            return found, newton.direction(found, away)
    raise ConvergenceError(
        "the other branch was not found along the mode of this bifurcation; follow the mechanism with a small imperfection "
        "of that shape instead (mechanism.fit, or a curve)"
    )
