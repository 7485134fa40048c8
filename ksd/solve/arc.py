"""Newton on a path: the load factor is one more unknown, the arc length one more equation.

Bordered system of Riks (Int. J. Solids Structures 15, 1979) and Keller (1977): the correction stays in the plane normal to
the predictor, in a metric of displacements over the size of the mechanism, rotations and the scaled factor. The bordered
matrix is regular at limit points, where the tangent itself is not.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ksd.model.arrays import Motion, Work
from ksd.model.compile import Model
from ksd.model.system import assemble, largest_move, largest_turn, take_step
from ksd.model.weight import weight_force
from ksd.properties.tangent import stored_matrix
from ksd.properties.turning import divergences, turning_loads
from ksd.solve.driving import RTOL
from ksd.solve.newton import GRAIN, LOOSE
from ksd.solve.pivoted import inertia, scaling

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Course:
    """What the path parameter means: drive values begin + f * span (c,), load factor base + f * rise."""

    begin: Array
    span: Array
    base: float
    rise: float

    def aim(self, f: float) -> tuple[Array, float]:
        """Drive values and load factor at f."""
        return self.begin + f * self.span, self.base + f * self.rise


@dataclass(frozen=True)
class Place:
    """An equilibrium on the path: state, parameter, inertia, exact tangent K (n, n), dR/df b (n,), local angles small."""

    motion: Motion
    f: float
    negatives: int
    K: Array
    b: Array
    iterations: int
    fits: bool = True


def factor_force(model: Model, motion: Motion, course: Course, work: Work) -> Array:
    """Derivative (n,) of the residual by the path parameter; work: as assembled at `motion`."""
    arrays = model.arrays
    b = np.zeros(arrays.plan.unknowns)
    b[arrays.terms.start] = -course.span
    loads = arrays.loads
    for i, node in enumerate(loads.node if course.rise else ()):
        u, T = int(arrays.start[node]), motion.R[node]
        turn = T if loads.following[i] else np.eye(3)
        force = turn @ loads.force[i]
        moment = turn @ loads.moment[i] + np.cross(T @ loads.point[i], force)
        b[u : u + 3] -= course.rise * force
        b[u + 3 : u + 6] -= course.rise * moment
    if course.rise and len(arrays.weight):
        b += course.rise * weight_force(arrays, work)
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


class Tracer:
    """Newton with arc length for one model and course; storage of one thread."""

    def __init__(self, model: Model, course: Course, work: Work) -> None:
        self.model, self.course, self.work = model, course, work
        self.metric = np.zeros(model.arrays.plan.unknowns + 1)
        for u in (int(s) for s in model.arrays.start if s >= 0):
            self.metric[u : u + 3] = model.arrays.size**-2
            self.metric[u + 3 : u + 6] = 1.0

    def length(self, z: Array) -> float:
        """Arc length of a step z (n + 1,)."""
        return math.sqrt(float(z @ (self.metric * z)))

    def tangent(self, at: Place, before: Array | None) -> Array:
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
    ) -> Place | None:
        """Equilibrium in the plane normal to `normal` through the predicted point, at fixed f when None.

        motion is changed in place; first (n + 1,): the predictor step, taken before. None when it fails.
        """
        arrays, work = self.model.arrays, self.work
        n = arrays.plan.unknowns
        c = np.append(np.zeros(n), 1.0) if normal is None else self.metric * normal
        moved = math.inf
        step = first
        for count in range(most + 1):
            worst, _, inside, status = assemble(arrays, motion, *self.course.aim(f), work, RTOL, 0, GRAIN)
            if not math.isfinite(worst):
                return None
            K, b = stored_matrix(arrays, work.value), factor_force(self.model, motion, self.course, work)
            # looser than `ksd.solve.newton.settled`: places of a path are passed, and chains close in on them slowly
            if step is None and (worst <= 1.0 or (worst <= LOOSE and moved <= 1.0)):
                if status == 2:
                    return None
                # chains carry stresses extrapolated from the step before; at equilibrium they are the true ones
                rest = turning_loads(self.model.arrays, motion, self.course.aim(f)[1])
                below = inertia(K)
                if rest is not None and below != len(arrays.terms.start):
                    below = divergences(arrays, K, rest)
                full = K if rest is None else K + rest
                return Place(motion, f, below + int(inside), full, b, count, status == 0)
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
            step = None
        return None

    def _full(self, K: Array, motion: Motion, f: float) -> Array:
        rest = turning_loads(self.model.arrays, motion, self.course.aim(f)[1])
        return K if rest is None else K + rest

    def advance(self, at: Place, direction: Array, length: float) -> Place | None:
        """The place an arc `length` further along `direction`; None when Newton fails there."""
        motion = at.motion.copy()
        # the members keep scratch of their last assembly, which must be that of this state
        assemble(self.model.arrays, motion, *self.course.aim(at.f), self.work, RTOL, 0, GRAIN)
        return self.correct(motion, at.f, direction, first=length * direction)
