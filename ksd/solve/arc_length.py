"""An equilibrium path followed by arc length, as states: Newton with the load factor as one more unknown.

Bordered system of Riks (Int. J. Solids Structures 15, 1979) and Keller (1977): the correction stays in the plane normal to
the predictor, in a metric of displacements over the size of the mechanism, rotations and the scaled factor. The bordered
matrix is regular at limit points, where the tangent itself is not.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ksd.errors import ConvergenceError
from ksd.model.arrays import Motion, Work, make_work
from ksd.model.compile import Model
from ksd.model.newton import GRAIN, LOOSE, assemble, largest_move, largest_turn, take_step
from ksd.model.weight import weight_force
from ksd.numerics.indefinite import inertia, scaling
from ksd.properties.nonconservative import count_negative_eigenvalues, skew_tangent
from ksd.properties.tangent import stored_matrix
from ksd.solve.steps import RTOL, Stop

Array = NDArray[np.float64]
LARGEST = 0.15
"""Largest arc of a step: rad, or displacement over the size of the mechanism, summed over the nodes."""
MOST_BEND = 0.5
"""Largest turn [rad] of the path's tangent in a step."""
WITHIN = 1e-2
"""Smallest eigenvalue, scaled by the diagonal, of a tangent that is not singular."""
MOST_STRAY = 0.15
"""Largest correction of a step, over its arc: a longer one may lead to another path."""
SHORT = 1e-5
"""An arc below which its bend is accepted, whatever it is."""
LEAST = 3e-7
"""An arc below which two paths are one."""
SAME = 1e-6
"""Largest distance, rad or over the size of the mechanism, of a state found again."""
BISECTIONS = 16
"""Halvings of an arc."""


@dataclass(frozen=True)
class PathParameter:
    """What the path parameter means: drive values begin + f * span (c,), load factor base + f * rise."""

    begin: Array
    span: Array
    base: float
    rise: float

    def values_at(self, f: float) -> tuple[Array, float]:
        """Drive values and load factor at f."""
        return self.begin + f * self.span, self.base + f * self.rise


@dataclass(frozen=True)
class ArcLengthPoint:
    """An equilibrium on the path: state, parameter, inertia, exact tangent K (n, n), dR/df b (n,), local angles small,
    residual over its bound, arc from where it was predicted."""

    motion: Motion
    f: float
    negatives: int
    K: Array
    b: Array
    iterations: int
    fits: bool = True
    residual: float = 0.0
    strayed: float = 0.0


def residual_rate(model: Model, motion: Motion, parameter: PathParameter, work: Work) -> Array:
    """Derivative (n,) of the residual by the path parameter; work: as assembled at `motion`."""
    arrays = model.arrays
    b = np.zeros(arrays.plan.unknowns)
    b[arrays.terms.start] = -parameter.span
    loads = arrays.loads
    for i, node in enumerate(loads.node if parameter.rise else ()):
        u, T = int(arrays.start[node]), motion.R[node]
        turn = T if loads.following[i] else np.eye(3)
        force = turn @ loads.force[i]
        moment = turn @ loads.moment[i] + np.cross(T @ loads.point[i], force)
        b[u : u + 3] -= parameter.rise * force
        b[u + 3 : u + 6] -= parameter.rise * moment
    if parameter.rise and len(arrays.weight):
        b += parameter.rise * weight_force(arrays, work)
    return b


def bordered(K: Array, b: Array, c: Array, right: Array) -> Array:
    """z (n + 1,) of [K b; c] z = right, equilibrated."""
    n = len(K)
    A = np.zeros((n + 1, n + 1))
    A[:n, :n], A[:n, n], A[n] = K, b, c
    rows = np.append(scaling(0.5 * (K + K.T)), 1.0)
    columns = rows.copy()
    columns[n] = 1.0 / max(float(np.abs(rows[:n] * b).max(initial=0.0)), 1e-300)
    A *= columns
    rows[n] = 1.0 / float(np.abs(A[n]).max())
    A *= rows[:, None]
    return columns * np.linalg.solve(A, rows * right)


class ArcLengthNewton:
    """Newton with arc length for one model and course; storage of one thread."""

    def __init__(self, model: Model, parameter: PathParameter, work: Work) -> None:
        self.model, self.parameter, self.work = model, parameter, work
        self.metric = np.zeros(model.arrays.plan.unknowns + 1)
        for u in (int(s) for s in model.arrays.start if s >= 0):
            self.metric[u : u + 3] = model.arrays.size**-2
            self.metric[u + 3 : u + 6] = 1.0

    def length(self, z: Array) -> float:
        """Arc length of a step z (n + 1,)."""
        return math.sqrt(float(z @ (self.metric * z)))

    def bend(self, one: Array, other: Array) -> float:
        """Angle [rad] between two unit directions (n + 1,)."""
        return math.acos(min(1.0, float(one @ (self.metric * other))))

    def tangent(self, at: ArcLengthPoint, before: Array | None) -> Array:
        """Unit direction (n + 1,) of the path, forward in the sense of `before` (rising parameter when None)."""
        n = len(at.b)
        c = np.append(np.zeros(n), 1.0) if before is None else self.metric * before
        t = bordered(at.K, at.b, c, np.append(np.zeros(n), 1.0))
        if before is None:
            # one unit of the parameter counts as much as the displacement it causes at first
            self.metric[n] = max(float(t[:n] @ (self.metric[:n] * t[:n])), 1e-12)
        return t / self.length(t)

    def correct(
        self, motion: Motion, f: float, normal: Array | None, *, first: Array | None = None, most: int = 14
    ) -> ArcLengthPoint | None:
        """Equilibrium in the plane normal to `normal` through the predicted point, at fixed f when None.

        motion is changed in place; first (n + 1,): the predictor step, taken before. None when it fails.
        """
        arrays, work = self.model.arrays, self.work
        n = arrays.plan.unknowns
        c = np.append(np.zeros(n), 1.0) if normal is None else self.metric * normal
        moved = math.inf
        step, strayed = first, np.zeros(n + 1)
        for count in range(most + 1):
            worst, _, inside, status = assemble(
                arrays, motion, *self.parameter.values_at(f), work, RTOL, 0, GRAIN
            )
            if not math.isfinite(worst):
                return None
            K, b = stored_matrix(arrays, work.value), residual_rate(self.model, motion, self.parameter, work)
            # looser than `ksd.model.newton.settled`: places of a path are passed, and chains close in on them slowly
            if step is None and (worst <= 1.0 or (worst <= LOOSE and moved <= 1.0)):
                if status == 2:
                    return None
                # chains carry stresses extrapolated from the step before; at equilibrium they are the true ones
                rest = skew_tangent(self.model.arrays, motion, self.parameter.values_at(f)[1])
                below = inertia(K)
                if rest is not None and below != len(arrays.terms.start):
                    below = count_negative_eigenvalues(arrays, K, rest)
                full = K if rest is None else K + rest
                away = self.length(strayed)
                return ArcLengthPoint(
                    motion, f, below + int(inside), full, b, count, status == 0, worst, away
                )
            if step is None:
                right = np.append(-work.rhs, 0.0)
                try:
                    step = bordered(self._full(K, motion, f), b, c, right)
                except np.linalg.LinAlgError:
                    return None
            size = max(largest_turn(arrays, step[:n]), largest_move(arrays, step[:n]) / arrays.size)
            if not size < (0.5 if first is None or count > 0 else 2.0):
                return None
            moved = max(
                largest_turn(arrays, step[:n]) / 1e-6, largest_move(arrays, step[:n]) / (1e-7 * arrays.size)
            )
            take_step(arrays, motion, np.ascontiguousarray(step[:n]), work, 1.0)
            f += float(step[n])
            if step is not first:
                strayed += step
            step = None
        return None

    def _full(self, K: Array, motion: Motion, f: float) -> Array:
        rest = skew_tangent(self.model.arrays, motion, self.parameter.values_at(f)[1])
        return K if rest is None else K + rest

    def advance(self, at: ArcLengthPoint, direction: Array, length: float) -> ArcLengthPoint | None:
        """The place an arc `length` further along `direction`; None when Newton fails there."""
        motion = at.motion.copy()
        # the members keep scratch of their last assembly, which must be that of this state
        assemble(self.model.arrays, motion, *self.parameter.values_at(at.f), self.work, RTOL, 0, GRAIN)
        return self.correct(motion, at.f, direction, first=length * direction)


@dataclass(frozen=True)
class SingularPoint:
    """Where the path turns or branches: the kind, the place, and the null vector (n,) of its tangent; zeros where what
    buckles is inside a leaf spring, whose nodes stay."""

    kind: Literal["limit", "bifurcation"]
    point: ArcLengthPoint
    mode: Array


def _another_path_crosses(
    before: ArcLengthPoint, direction: Array, after: ArcLengthPoint, ahead: Array
) -> bool:
    """Whether the determinant of the bordered tangent has another sign: it keeps its sign along a path and changes where
    another one crosses (Allgower and Georg, Introduction to numerical continuation methods, 2003, chapter 8). That sign is
    (-1)^negatives times that of the rate of the factor."""
    turned = direction[-1] * ahead[-1] < 0.0
    return turned != ((after.negatives - before.negatives) % 2 == 1)


END_REACHED = "the end was reached"
"""Why a walk stopped that came to the end asked for."""
RETURNED_TO_START = (
    "it came back to its start, over another path that passes closely, as where a small imperfection takes a bifurcation "
    "apart: leave that out and switch at the bifurcation (ksd.follow, branch=), or make it larger"
)
"""Why a walk stopped that would go on from its start backwards."""


class PathContinuation:
    """A path while it is followed: places passed (without their tangents), turns found, and why it stopped."""

    def __init__(self, model: Model, parameter: PathParameter) -> None:
        self.model, self.parameter = model, parameter
        self.newton = ArcLengthNewton(model, parameter, make_work(model.arrays))
        self.points: list[ArcLengthPoint] = []
        self.singular_points: list[SingularPoint] = []
        self.stop_reason = ""

    @property
    def factorisations(self) -> int:
        """Factorisations of all places together."""
        return sum(at.iterations for at in self.points)

    def keep(self, at: ArcLengthPoint) -> None:
        """Record a place; its dense tangent would fill the memory on a long path."""
        self.points.append(replace(at, K=np.zeros((0, 0)), b=np.zeros(0)))

    def turn(
        self, before: ArcLengthPoint, direction: Array, after: ArcLengthPoint, ahead: Array, arc: float
    ) -> bool:
        """Locate and record what lies between two places, if anything does; False, and nothing recorded, where they are of
        two paths, as beside a bifurcation that an imperfection has taken apart."""
        limit = direction[-1] * ahead[-1] < 0.0
        branches = None
        if _another_path_crosses(before, direction, after, ahead):
            branches = after if arc < LEAST else self._crossing(before, direction, ahead, arc)
            if branches is None:
                return False
        elif abs(after.negatives - before.negatives) > int(limit):
            ends = self._bisected(before, direction, arc, lambda at, _: at.negatives != before.negatives)
            branches = after if ends is None or ends[1] is None else ends[1]
        if limit:
            self._record("limit", self._limit(before, direction, after, ahead, arc))
        if branches is not None:
            self._record("bifurcation", branches)
        return True

    def _record(self, kind: Literal["limit", "bifurcation"], at: ArcLengthPoint) -> None:
        scale = scaling(0.5 * (at.K + at.K.T))
        values, vectors = np.linalg.eigh(0.5 * (at.K + at.K.T) * np.outer(scale, scale))
        least = int(np.argmin(np.abs(values)))
        mode = scale * vectors[:, least]
        mode = mode / self.newton.length(np.append(mode, 0.0))
        # a tangent of the nodes that is regular there: what is singular is condensed inside the leaf springs
        inside = kind == "bifurcation" and abs(values[least]) > WITHIN
        self.singular_points.append(SingularPoint(kind, at, np.zeros_like(mode) if inside else mode))

    def _limit(
        self, before: ArcLengthPoint, direction: Array, after: ArcLengthPoint, ahead: Array, arc: float
    ) -> ArcLengthPoint:
        """Where d(factor)/ds vanishes, by the false position (Illinois) on the arc."""
        low, high, g_low, g_high = 0.0, arc, float(direction[-1]), float(ahead[-1])
        best, smallest = after, abs(g_high)
        for _ in range(12):
            s = (low * g_high - high * g_low) / (g_high - g_low)
            at = self.newton.advance(before, direction, s)
            if at is None:
                break
            g = float(self.newton.tangent(at, direction)[-1])
            if abs(g) < smallest:
                best, smallest = at, abs(g)
            if abs(g) < 1e-6 * abs(direction[-1] - ahead[-1]):
                break
            if g * g_high > 0.0:
                high, g_high, g_low = s, g, 0.5 * g_low
            else:
                low, g_low, g_high = s, g, 0.5 * g_high
        return best

    def _crossing(
        self, before: ArcLengthPoint, direction: Array, ahead: Array, arc: float
    ) -> ArcLengthPoint | None:
        """Where the path crosses another one, None where there are two that do not meet."""
        ends = self._bisected(
            before, direction, arc, lambda at, onward: _another_path_crosses(before, direction, at, onward)
        )
        one, other = ends or (before, None)
        if other is None:
            return None
        size, wide = self.model.arrays.size, 5.0 * arc * 0.5**BISECTIONS + LEAST
        apart = max(
            np.abs(one.motion.x - other.motion.x).max() / size, np.abs(one.motion.R - other.motion.R).max()
        )
        steep = max(abs(direction[-1]), abs(ahead[-1]))
        return other if apart < wide and abs(one.f - other.f) < steep * wide + 1e-9 else None

    def _bisected(
        self,
        before: ArcLengthPoint,
        direction: Array,
        arc: float,
        beyond: Callable[[ArcLengthPoint, Array], bool],
    ) -> tuple[ArcLengthPoint, ArcLengthPoint | None] | None:
        """The last place before and the first one beyond what lies on an arc, which is halved; None past a sharp turn."""
        low, high = 0.0, arc
        ends: tuple[ArcLengthPoint, ArcLengthPoint | None] = before, None
        for _ in range(BISECTIONS):
            s = 0.5 * (low + high)
            at = self.newton.advance(before, direction, s)
            if at is None:
                return None
            onward = self.newton.tangent(at, direction)
            if self.newton.bend(direction, onward) > MOST_BEND:
                return None
            if beyond(at, onward):
                high, ends = s, (ends[0], at)
            else:
                low, ends = s, (at, ends[1])
        return ends

    def _arc(self, at: ArcLengthPoint, ahead: Array, arc: float, until: float) -> float:
        """Not past the end: the arc that would just reach `until`, if that is shorter."""
        slope = float(ahead[-1])
        if slope * (until - at.f) > 0.0:
            return min(arc, abs((until - at.f) / slope))
        return arc

    def _returned(self, at: ArcLengthPoint, found: ArcLengthPoint) -> bool:
        """Whether the start lies between two places."""
        home = self.points[0]
        if (
            len(self.points) == 1
            or not (at.f - home.f) * (found.f - home.f) < 0.0
            or found.negatives != home.negatives
        ):
            return False
        back = self.newton.correct(found.motion.copy(), home.f, None)
        if back is None:
            return False
        apart = np.abs(back.motion.x - home.motion.x).max() / self.model.arrays.size
        return bool(max(apart, np.abs(back.motion.R - home.motion.R).max()) < SAME)

    def follow(
        self,
        at: ArcLengthPoint,
        ahead: Array,
        *,
        until: float,
        arc: float,
        most: int,
        turns: float = math.inf,
    ) -> None:
        """Follow from `at` in direction `ahead`, through so many turning points at most."""
        self.stop_reason = self._follow(at, ahead, until=until, arc=arc, most=most, turns=turns)

    def _follow(
        self, at: ArcLengthPoint, ahead: Array, *, until: float, arc: float, most: int, turns: float
    ) -> str:
        self.keep(at)
        if at.f == until:
            return END_REACHED
        sign, largest = (1.0 if until >= at.f else -1.0), LARGEST * np.sqrt(len(self.model.node_names))
        for _ in range(most):
            length = self._arc(at, ahead, min(arc, largest), until)
            found = self.newton.advance(at, ahead, length)
            if found is None or (found.f - until) * sign > 1e-6 * abs(until):
                # too far, or no equilibrium in that plane
                arc = 0.5 * length
                if arc < 1e-9:
                    return "the arc was halved to its smallest size without reaching equilibrium"
                continue
            onward = self.newton.tangent(found, ahead)
            bend = self.newton.bend(ahead, onward)
            if (bend > MOST_BEND or found.strayed > MOST_STRAY * length) and length > SHORT:
                # a sharp turn: closer, lest a limit point and the next one both lie in one step
                arc = 0.5 * length
                continue
            if not self.turn(at, ahead, found, onward, length):
                # closer, where the path itself turns
                arc = 0.5 * length
                continue
            if len(self.singular_points) >= turns:
                return "it turns"
            if self._returned(at, found):
                return RETURNED_TO_START
            at, ahead = found, onward
            if abs(at.f - until) <= 2e-6 * abs(until):
                self.keep(self.newton.correct(at.motion, until, None) or at)
                return END_REACHED
            self.keep(at)
            if not at.fits:
                return Stop.LOCAL_ANGLE.sentence
            growth = min((4.0 / max(at.iterations, 1)) ** 0.5, 0.5 * MOST_BEND / max(bend, 1e-9))
            arc = max(arc, length) * float(np.clip(growth, 0.5, 1.5))
        return f"{most} steps were taken"


def require_start(at: ArcLengthPoint | None) -> ArcLengthPoint:
    """The place; ConvergenceError where there is none."""
    if at is None:
        raise ConvergenceError(
            "the start of the path is no equilibrium; solve it first and pass it as start=..."
        )
    return at


def follow_by_arc_length(
    model: Model,
    parameter: PathParameter,
    motion: Motion,
    *,
    f: float = 0.0,
    first: float = 0.02,
    most: int = 300,
    turns: float = math.inf,
) -> PathContinuation:
    """Follow a course of drives and loads from the equilibrium `motion` at parameter f to 1, by arc length, or until it has
    turned so many times.

    Raises ConvergenceError where the start is no equilibrium.
    """
    walk = PathContinuation(model, parameter)
    at = require_start(walk.newton.correct(motion.copy(), f, None, most=40))
    ahead = walk.newton.tangent(at, None)
    walk.follow(at, ahead, until=1.0, arc=first / max(abs(float(ahead[-1])), 1e-9), most=most, turns=turns)
    return walk


def switch_branch(
    newton: ArcLengthNewton, motion: Motion, f: float, mode: Array
) -> tuple[ArcLengthPoint, Array]:
    """A place on the other branch, 0.01 along `mode`, and the direction away from the bifurcation."""
    n = len(mode)
    if not mode.any():
        names = ", ".join(f"'{name}'" for name in newton.model.member_names[:3])
        raise ConvergenceError(
            "at this bifurcation a leaf spring buckles between its ends, where the path has no node to leave along: draw a "
            f"point on it, mechanism.point(leaf, s) with s [m] off its middle (leaf springs: {names}), and follow that "
            "mechanism"
        )
    at = require_start(newton.correct(motion, f, None))
    newton.tangent(at, None)
    away = np.append(mode, 0.0)
    for size in (0.01, 0.003, 0.03, 0.001):
        found = newton.advance(at, away, size)
        if found is not None and newton.length(np.append(np.zeros(n), found.f - f)) < 50 * size:
            return found, newton.tangent(found, away)
    raise ConvergenceError(
        "the other branch was not found along the mode of this bifurcation; follow the mechanism with a small imperfection "
        "of that shape instead (mechanism.fit, or a curve)"
    )
