"""Newton iterations with contact: in every one a small complementarity problem on the compliance of the touched nodes.

An iteration assembles and factors the mechanism without contact, but with the contact forces found so far as loads; E picks
the unknowns of the touched nodes:

    d0 = -K^-1 r,  X = K^-1 E,  C = E'X,  e0 = E'd0
    motions z and forces w of these nodes: solved to the end (`ksd.model.complementarity`), at exactly moved poses
    step = d0 + X (w - w before)

So contacts open, close, stick and slip inside one iteration, and geometry of contact needs no tangent. A node that nothing
but contacts holds gets a stiffness S, which the small problem takes away again.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ksd.model.arrays import Arrays, State, Workspace
from ksd.model.complementarity import move_bodies, pair_wrenches, solve_complementarity, unknown_count
from ksd.model.gaps import BODIES, BODY_COUNT, FRICTIONS, GAP, PLACES, SOFTNESS, WRENCH, touch
from ksd.model.newton import (
    ROUNDING_MULTIPLE,
    NewtonResult,
    assemble,
    has_converged,
    largest_displacement,
    largest_rotation,
    take_step,
)
from ksd.numerics.blocks import factor_blocks, solve_blocks
from ksd.solvers.pivoted_newton import WEAK_PIVOT
from ksd.solvers.steps import Stop
from ksd.solvers.touching import Touching

Array = NDArray[np.float64]
SAME_GAP = 1e-11
"""Largest gap of a closed contact, over the size of the mechanism."""


class ContactNewton:
    """Newton with contact on arrays whose last loads are the contact forces (`ksd.solvers.touching.contact_model`).

    forces (m, 3) [N]: of the pairs in the last state found. out (m, ...): outputs of `ksd.model.gaps.touch` there.
    """

    def __init__(self, what: Touching, arrays: Arrays, work: Workspace) -> None:
        self.what, self.arrays, self.work = what, arrays, work
        self.active = arrays.active_dofs
        moving, width = arrays.start[what.nodes] >= 0, len(self.active)
        self.first = np.where(moving, width * (np.cumsum(moving) - 1), -1)
        self.count = int(moving.sum())
        self.unknowns = (arrays.start[what.nodes[moving]][:, None] + np.arange(width)).ravel()
        self.loads = slice(len(arrays.loads.node) - self.count, None)
        most = int(what.pairs[:, BODY_COUNT].max(initial=0))
        self.out = np.zeros((len(what.pairs), WRENCH + 18 * most))
        self.forces = np.zeros((len(what.pairs), 3))
        self.spring = np.zeros(len(self.unknowns))
        self.data = what.data.copy()
        self.before = np.zeros((0, 3)), np.zeros((0, 3, 3))

    def poses(self, motion: State) -> tuple[Array, Array]:
        """Positions (k, 3) and rotations (k, 3, 3) of the bodies that may touch."""
        return motion.x[self.what.nodes], motion.R[self.what.nodes]

    def look(self, motion: State, before: tuple[Array, Array], factor: float = 1.0) -> None:
        """Evaluate all pairs at a state, and write the contact forces into the loads, which `factor` multiplies."""
        pairs, x_R = self.what.pairs, self.poses(motion)
        for i in range(len(pairs)):
            touch(pairs[i], self.data, self.what.bodies, *x_R, *before, np.zeros(2), self.out[i])
        w = np.zeros((self.count, 6))
        first = np.where(self.first >= 0, self.first // len(self.active) * 6, -1)
        pair_wrenches(pairs, self.what.bodies, first, np.arange(6), self.forces, self.out, w.ravel())
        self.arrays.loads.force[self.loads] = w[:, :3] / factor
        self.arrays.loads.moment[self.loads] = w[:, 3:] / factor

    def newton(
        self,
        motion: State,
        values: Array,
        factor: float,
        rtol: float,
        max_steps: int,
        max_turn: float,
        limit: float,
    ) -> NewtonResult:
        """Iterate to equilibrium as `ksd.model.newton.solve_equilibrium` does; `motion` begins at the last equilibrium.

        values: those of drives and supports, then those of `Touching.values`.
        """
        arrays, work, what = self.arrays, self.work, self.what
        rows, size = len(arrays.terms.start), arrays.size
        # the symmetric tangent alone is used, so that steps under follower loads shrink by a factor only
        rtol *= 1.0 if arrays.conservative else 1e-2
        target = np.ascontiguousarray(values[:rows])
        self.data = what.with_values(values[rows:])
        what.count_turns(self.data, arrays, motion)
        before = self.before = self.poses(motion)
        plan, blocks = arrays.plan.ints, len(arrays.plan.size)
        begin = self.forces.copy()
        worst, previous, moved, unsolved, solved = math.inf, math.inf, math.inf, 0, False
        for n in range(max_steps + 1):
            self.look(motion, before, factor)
            worst, _, inside, status = assemble(
                arrays, motion, target, factor, work, rtol, rounding=ROUNDING_MULTIPLE if n > 0 else 0.0
            )
            if not math.isfinite(worst):
                return self._stop(Stop.NOT_FINITE, n, worst, begin)
            done = has_converged(worst, previous, moved) or self._is_rounding(moved)
            if n > 0 and solved and done and self._is_closed(size):
                negatives, pivot = factor_blocks(plan, work.matrix, work.scaled_rows, blocks)
                reason = (Stop.CONVERGED, Stop.LOCAL_ANGLE, Stop.SINGULAR)[status]
                return int(reason), n, worst, int(negatives + inside), float(pivot)
            if n == max_steps:
                break
            if n > 0 and np.linalg.norm(work.rhs) > limit:
                return self._stop(Stop.DIVERGED, n, worst, begin)
            found = self._step(motion, before, plan, blocks)
            if found is None:
                return self._stop(Stop.SINGULAR, n, worst, begin)
            step, solved = found
            unsolved = 0 if solved else unsolved + 1
            if unsolved > 2:
                return self._stop(Stop.JAMMED, n, worst, begin)
            if not np.isfinite(step).all():
                return self._stop(Stop.NOT_FINITE, n, worst, begin)
            previous, turn = worst, largest_rotation(arrays, step)
            moved = max(turn / 1e-6, largest_displacement(arrays, step) / (1e-7 * size))
            take_step(arrays, motion, step, work, max_turn / turn if n > 0 and turn > max_turn else 1.0)
        return self._stop(Stop.TOO_MANY, max_steps, worst, begin)

    def residual(self, motion: State, values: Array, factor: float, before: tuple[Array, Array]) -> float:
        """Residual over its bound at a state found on other arrays of the same mechanism."""
        self.before = before
        self.look(motion, before, factor)
        target = np.ascontiguousarray(values[: len(self.arrays.terms.start)])
        return assemble(self.arrays, motion, target, factor, self.work)[0]

    def count_unstable(self, motion: State, values: Array, factor: float) -> int:
        """Number of directions in which the state found is no minimum, closed contacts held; see the theory of contact.

        With K' = K + E S E' as factored, contact forces of stiffness G = S - D, and the directions B of closed contacts, the
        negative pivots of the whole follow from those of K' and of a small matrix (Haynsworth).
        """
        arrays, work, q = self.arrays, self.work, len(self.unknowns)
        self.look(motion, self.before, factor)
        target = np.ascontiguousarray(values[: len(arrays.terms.start)])
        _, _, inside, _ = assemble(arrays, motion, target, factor, work)
        plan, blocks = arrays.plan.ints, len(arrays.plan.size)
        own = self._factor(plan, blocks)[0] + inside
        X = np.zeros((q, len(work.rhs)))
        X[np.arange(q), self.unknowns] = 1.0
        for row in X:
            solve_blocks(plan, work.matrix, work.scaled_rows, row)
        B, soft = self._closed_directions()
        C, D = X[:, self.unknowns], np.diag(self.spring) - self._stiffness(motion)
        share, axes = np.linalg.eigh(0.5 * (D + D.T))
        kept = np.abs(share) > 1e-12 * np.abs(share).max(initial=0.0)
        share, axes = share[kept], axes[:, kept]
        to = np.hstack([axes, B])
        small = -to.T @ C @ to
        small[range(len(share)), range(len(share))] += 1.0 / share
        small[range(len(share), len(to.T)), range(len(share), len(to.T))] -= soft
        scale = 1.0 / np.sqrt(np.maximum(np.abs(np.diag(small)), 1e-300))
        found = np.linalg.eigvalsh(small * np.outer(scale, scale))
        # redundant contacts count as held
        negative = int((found < 1e-11).sum()) - int((share < 0.0).sum())
        return int(own) + negative - len(arrays.terms.start) - len(soft)

    def _closed_directions(self) -> tuple[Array, Array]:
        """Directions (q, c) in which closed contacts hold the touched nodes, and their softness (c,)."""
        pairs, columns, soft = self.what.pairs, [], []
        for i, row in enumerate(pairs):
            if not self.forces[i, 0] > 0.0:
                continue
            unit = np.zeros(len(self.unknowns))
            for b in range(row[BODY_COUNT]):
                k = self.first[self.what.bodies[row[BODIES] + b]]
                if k >= 0:
                    unit[k : k + len(self.active)] += self.out[i, WRENCH + 18 * b + 3 * self.active]
            columns.append(unit)
            soft.append(self.data[row[1] + SOFTNESS])
        return np.array(columns).reshape(len(columns), len(self.unknowns)).T, np.array(soft)

    def _stiffness(self, motion: State) -> Array:
        """Stiffness (q, q) of the contact forces at constant size: minus the derivative of their wrenches by the motions."""
        found, width = np.zeros((len(self.unknowns),) * 2), len(self.active)
        out, moved = np.empty_like(self.out), [a.copy() for a in self.poses(motion)]
        for k in self.first:
            for r in range(width if k >= 0 else 0):
                sides = []
                for sign in (1.0, -1.0):
                    y = np.zeros(len(self.unknowns))
                    y[k + r] = sign * 1e-6 * (self.arrays.size if self.active[r] < 3 else 1.0)
                    move_bodies(self.first, self.active, *self.poses(motion), y, *moved)
                    for i, row in enumerate(self.what.pairs):
                        touch(row, self.data, self.what.bodies, *moved, *self.before, np.zeros(2), out[i])
                    w = np.zeros(len(self.unknowns))
                    pair_wrenches(
                        self.what.pairs, self.what.bodies, self.first, self.active, self.forces, out, w
                    )
                    sides.append(w)
                found[:, k + r] = (sides[1] - sides[0]) / (2.0 * abs(y[k + r]))
        return found

    def _stop(self, reason: Stop, n: int, worst: float, begin: Array) -> NewtonResult:
        """The result of a failed try, after which the forces are those before it."""
        self.forces = begin
        return int(reason), n, worst, 0, 1.0

    def _is_rounding(self, moved: float) -> bool:
        """Whether the residual is rounding of the stiffest member, as on bodies without one, after a step of no size."""
        stiffness = float(self.arrays.members.stiffness_scale.max(initial=0.0))
        noise = ROUNDING_MULTIPLE * np.finfo(float).eps * stiffness * self.arrays.size
        return moved <= 1.0 and bool(
            np.abs(self.work.rhs).max(initial=0.0) <= noise * min(1.0, self.arrays.size)
        )

    def _is_closed(self, size: float) -> bool:
        """Whether no pair overlaps, and closed ones touch, at the state last looked at."""
        for i, out in enumerate(self.out):
            gap = out[GAP] + self.data[self.what.pairs[i, 1] + SOFTNESS] * self.forces[i, 0]
            if gap < -SAME_GAP * size or (self.forces[i, 0] > 0.0 and gap > SAME_GAP * size):
                return False
        return True

    def _factor(self, plan: Array, blocks: int) -> tuple[int, float]:
        """Factor the tangent, with a stiffness on the touched nodes where they need one; returns its negative pivots and the
        smallest one."""
        work, width = self.work, len(self.active)
        if not self.spring.any():
            stored = work.matrix.copy()
            negatives, pivot = factor_blocks(plan, work.matrix, work.scaled_rows, blocks)
            if pivot > WEAK_PIVOT:
                return int(negatives), float(pivot)
            work.matrix[:] = stored
            stiff = float(self.arrays.members.stiffness_scale.max(initial=1.0)) * 1e-4
            scale = np.where(self.active < 3, 1.0, self.arrays.size**2)
            self.spring = np.tile(stiff * scale, self.count)
        block = self.arrays.loads.block[self.loads]
        for k in range(self.count):
            work.matrix[block[k] + (width + 1) * np.arange(width)] += self.spring[width * k : width * (k + 1)]
        negatives, pivot = factor_blocks(plan, work.matrix, work.scaled_rows, blocks)
        return int(negatives), float(pivot)

    def _step(
        self, motion: State, before: tuple[Array, Array], plan: Array, blocks: int
    ) -> tuple[Array, bool] | None:
        """Newton step (n,) with the contact forces of the small problem, and whether that was solved; None where the tangent
        is singular."""
        work, pairs, q = self.work, self.what.pairs, len(self.unknowns)
        w_before = np.zeros(q)
        pair_wrenches(pairs, self.what.bodies, self.first, self.active, self.forces, self.out, w_before)
        rhs = -work.rhs
        if not self._factor(plan, blocks)[1] > 0.0:
            return None
        solve_blocks(plan, work.matrix, work.scaled_rows, rhs)
        X = np.zeros((q, len(rhs)))
        X[np.arange(q), self.unknowns] = 1.0
        for row in X:
            solve_blocks(plan, work.matrix, work.scaled_rows, row)
        C = np.ascontiguousarray(X[:, self.unknowns].T)
        e0 = rhs[self.unknowns] - C @ w_before
        y = np.zeros(unknown_count(pairs, q))
        rho, u = np.zeros(len(pairs)), q
        for i, row in enumerate(pairs):
            y[u : u + 1 + row[FRICTIONS]] = self.forces[i, : 1 + row[FRICTIONS]]
            u += 1 + row[FRICTIONS] + row[PLACES]
            unit, trace = np.zeros(q), 0.0
            for c in range(1 + row[FRICTIONS]):
                unit[:] = 0.0
                for b in range(row[BODY_COUNT]):
                    k = self.first[self.what.bodies[row[BODIES] + b]]
                    if k >= 0:
                        at = WRENCH + 18 * b + 3 * self.active + c
                        unit[k : k + len(self.active)] += self.out[i, at]
                trace += float(unit @ C @ unit)
            # negative where the tangent without contact is unstable
            rho[i] = 1.0 / abs(trace) if trace else 0.0
        rho[rho == 0.0] = rho.max(initial=0.0) or 1.0
        w = np.zeros(q)
        solved, _, _ = solve_complementarity(
            pairs, self.data, self.what.bodies, self.first, self.active, *self.poses(motion), *before, e0, C, self.spring,
            rho, self.arrays.size, y, self.out, w,
        )  # fmt: skip
        u = q
        for i, row in enumerate(pairs):
            self.forces[i] = 0.0
            soft = self.data[row[1] + SOFTNESS]
            # an open contact has no force, not even one of rounding
            if y[u] - rho[i] * (self.out[i, GAP] + soft * y[u]) > 0.0:
                self.forces[i, : 1 + row[FRICTIONS]] = y[u : u + 1 + row[FRICTIONS]]
            u += 1 + row[FRICTIONS] + row[PLACES]
        return rhs + (w + self.spring * y[:q] - w_before) @ X, solved
