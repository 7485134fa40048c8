"""Newton iterations with contact: in every one a small complementarity problem on the compliance of the touched nodes.

An iteration assembles and factors the mechanism without contact, but with the contact forces found so far as loads; E picks
the unknowns of the touched nodes:

    d0 = -K^-1 r,  X = K^-1 E,  C = E'X,  e0 = E'd0
    motions z and forces w of these nodes: solved to the end (`ksd.model.complementarity`), at exactly moved poses
    step = d0 + X (w - w before)

So contacts open, close, stick and slip inside one iteration, and geometry of contact needs no tangent. A node that nothing
but contacts holds gets a stiffness S, which the small problem takes away again. A leaf that is touched is cut anew after
iterations that converge, until it is cut where it is touched (`ksd.solvers.leaf_contact`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ksd.model.arrays import Arrays, State, make_workspace
from ksd.model.compile import Model
from ksd.model.contact_step import contact_step, load_contacts, stability_matrix, touched_compliance
from ksd.model.gaps import BODY_COUNT, CORNERS, NORMAL, SHIFT, WRENCH
from ksd.model.newton import (
    ROUNDING_MULTIPLE,
    NewtonResult,
    assemble,
    has_converged,
    take_step,
)
from ksd.solvers.contact_state import Touched
from ksd.solvers.leaf_contact import cut_at, cut_places, cut_state, node_poses, places_of, strips
from ksd.solvers.steps import Stop
from ksd.solvers.touching import Touching, contact_model

Array = NDArray[np.float64]
SAME_GAP = 1e-11
"""Largest gap of a closed contact, over the size of the mechanism."""
MAX_CUTS = 12
"""How often a leaf is cut in one load step at most."""
SAME_PLACE, SAME_OPEN_PLACE = 1e-6, 1e-3
"""How far from the place where it is touched, or comes nearest, a leaf may be cut, over its length; forces are off by the
square of it."""


class ContactNewton:
    """Newton with contact on arrays whose last loads are the contact forces (`ksd.solvers.touching.contact_model`), with its
    storage: not for two threads at once.

    make: the arrays of a model. model: as it is cut. forces (m, 3) [N]: of the pairs in the last state found. out (m, ...):
    outputs of `ksd.model.gaps.touch` there.
    """

    def __init__(self, what: Touching, model: Model, make: Callable[[Model], Arrays]) -> None:
        self.what, self.make = what, make
        self._build(model)
        arrays = self.arrays
        self.size = arrays.size
        stiffest = float(arrays.members.stiffness_scale.max(initial=0.0))
        self.stiff = 1e-4 * (stiffest or 1.0)
        self.noise = ROUNDING_MULTIPLE * np.finfo(float).eps * stiffest * arrays.size * min(1.0, arrays.size)
        self.exchange(what, model)

    def exchange(self, what: Touching, model: Model) -> None:
        """Go over to other pairs of the same bodies; model: the same mechanism with these."""
        self.what, self.model = what, model
        most = int(what.pairs[:, BODY_COUNT].max(initial=0))
        self.out = np.zeros((len(what.pairs), WRENCH + 18 * most))
        self.rest_data = what.with_values(np.array(list(what.values.values())))
        self.none = np.zeros((len(what.pairs), 3))
        self.begin(self.none)

    def _build(self, model: Model) -> None:
        """Arrays of a model, and where they have the bodies and contact forces."""
        what, self.model, self.links = self.what, model, model.arrays.ints
        arrays = self._made(model)
        self.arrays, self.work, self.plan = arrays, make_workspace(arrays), arrays.plan.ints
        self.active = arrays.active_dofs
        moving, width = arrays.start[what.nodes] >= 0, len(self.active)
        self.first = np.where(moving, width * (np.cumsum(moving) - 1), -1)
        self.unknowns = (arrays.start[what.nodes[moving]][:, None] + np.arange(width)).ravel()
        self.loads = slice(len(arrays.loads.node) - int(moving.sum()), None)
        self.push, self.turn, self.block = (
            getattr(arrays.loads, name)[self.loads] for name in ("force", "moment", "block")
        )

    def _made(self, model: Model) -> Arrays:
        """Arrays of a model, with contact forces as its last loads."""
        return self.make(contact_model(model, self.what.nodes))

    def begin(self, forces: Array) -> None:
        """Forget the solve before, and start from these contact forces (m, 3)."""
        self.forces, self.spring = forces.copy(), np.zeros(len(self.unknowns))
        self.data = self.what.data
        self.before = np.zeros((0, 3)), np.zeros((0, 3, 3))

    def cut(self, model: Model, motion: State, what: Touching | None = None) -> None:
        """Go over to a model cut elsewhere, at a state of it; what: its tables there, where they are known."""
        if model is not self.model:
            ints, moved = model.arrays.ints, model.derived.get("moved_cuts")
            if ints is not self.links and not np.array_equal(ints, self.links):
                # a leaf is cut beyond another node of it
                self._build(model)
            made = self._made(model) if moved is None else moved.arrays(self, self._made, places_of(model))
            self.arrays.floats[:], self.model = made.floats, model
        if self.what.strips:
            what = self.what = what or self.what.on_strips(model, motion)
            self.data, self.rest_data = what.data, what.with_values(np.array(list(what.values.values())))

    def poses(self, motion: State) -> tuple[Array, Array]:
        """Positions (k, 3) and rotations (k, 3, 3) of the bodies that may touch."""
        return motion.x[self.what.nodes], motion.R[self.what.nodes]

    def look(self, motion: State, before: tuple[Array, Array], factor: float) -> bool:
        """Evaluate all pairs at a state, and write the contact forces into the loads, which `factor` multiplies; returns
        whether no pair overlaps, and closed ones touch."""
        what = self.what
        found: bool = load_contacts(
            what.pairs, self.data, what.bodies, what.nodes, self.first, self.active, motion.x, motion.R, *before, factor,
            SAME_GAP * self.size, self.forces, self.out, self.push, self.turn,
        )  # fmt: skip
        return found

    def newton(
        self,
        motion: State,
        values: Array,
        factor: float,
        rtol: float,
        max_steps: int,
        max_turn: float,
        limit: float,
        before: tuple[Array, Array] | None = None,
    ) -> NewtonResult:
        """Iterate to equilibrium as `ksd.model.newton.solve_equilibrium` does.

        values: those of drives and supports, then those of `Touching.values`. before: poses of the bodies at the last
        equilibrium; None where `motion` begins there.
        """
        words = values, factor, rtol, max_steps, max_turn, limit
        x_last, R_last = before = self.before = self.poses(motion) if before is None else before
        if not self.what.strips:
            return self._iterate(motion, before, *words)
        model, forces, begin, total = self.model, self.forces.copy(), motion.copy(), 0
        for _ in range(MAX_CUTS):
            reason, count, worst, negatives, pivot = self._iterate(motion, before, *words)
            total += count
            moved = self.better_cut(motion) if reason == Stop.CONVERGED else {}
            if not moved:
                break
            cut = cut_at(self.model, moved)
            motion.assign(cut_state(self.model, motion, cut))
            poses = node_poses(model, begin, moved)
            before = self.before = x_last.copy(), R_last.copy()
            for k, node in enumerate(self.what.nodes.tolist()):
                if (name := cut.node_names[node]) in poses:
                    # moved along the leaf spring as it was at the beginning
                    turn = R_last[k] @ begin.R[node].T
                    before[0][k] += turn @ (poses[name][0] - begin.x[node])
                    before[1][k] = turn @ poses[name][1]
            self.cut(cut, motion)
        else:
            reason = int(Stop.NO_PLACE)
        if reason != Stop.CONVERGED:
            self.cut(model, begin)
            self.forces = forces
        return reason, total, worst, negatives, pivot

    def better_cut(self, motion: State) -> dict[str, float]:
        """Where leaves are to be cut [m] by the name of the node, empty where they are cut there."""
        now, far = places_of(self.model), False
        own = {s.contact: s for s in strips(self.model)}
        pairs = [(i, own[part.name]) for i, part in enumerate(self.what.parts) if part.name in own]
        wanted = {strip.node: now[strip.node] + float(self.out[i, SHIFT]) for i, strip in pairs}
        wanted = cut_places(self.model, wanted)
        for i, strip in pairs:
            tolerance = SAME_PLACE if self.forces[i, 0] > 0.0 else SAME_OPEN_PLACE
            apart = abs(self.out[i, SHIFT])
            far = far or abs(wanted[strip.node] - now[strip.node]) > tolerance * strip.leaf.length
            if not far and apart > tolerance * strip.leaf.length:
                # beside an end or another node, where the strip has to have the curvature of the leaf
                at = self.what.strips[strip.node] + CORNERS
                bend = self.what.on_strips(self.model, motion).data[at : at + 3] - self.what.data[at : at + 3]
                far = float(np.abs(bend).max()) * apart > tolerance
        return wanted if far else {}

    def _iterate(
        self, motion: State, before: tuple[Array, Array], values: Array, factor: float, rtol: float, max_steps: int,
        max_turn: float, limit: float,
    ) -> NewtonResult:  # fmt: skip
        """`newton` with leaf springs cut where they are; before: poses of the bodies at the last equilibrium."""
        arrays, work, what = self.arrays, self.work, self.what
        rows, size = len(arrays.terms.start), self.size
        # the symmetric tangent alone is used, so that steps under follower loads shrink by a factor only
        rtol *= 1.0 if arrays.conservative else 1e-2
        target = np.ascontiguousarray(values[:rows])
        self.data = what.with_values(values[rows:])
        what.count_turns(self.data, arrays, motion)
        begin = self.forces.copy()
        worst, previous, moved, unsolved, solved = math.inf, math.inf, math.inf, 0, False
        for n in range(max_steps + 1):
            closed = self.look(motion, before, factor)
            if n == 0:
                normals = self.out[:, NORMAL : NORMAL + 3].copy()
            worst, _, _, status = assemble(
                arrays, motion, target, factor, work, rtol, rounding=ROUNDING_MULTIPLE if n > 0 else 0.0
            )
            if not math.isfinite(worst):
                return self._stop(Stop.NOT_FINITE, n, worst, begin)
            if solved and closed and (has_converged(worst, previous, moved) or self._is_rounding(moved)):
                turned = what.turned(normals, self.out)
                if turned is not None and what.overlap_between(
                    turned, self.out, self.data, before, self.poses(motion)
                ):
                    return self._stop(Stop.PASSED, n, worst, begin)
                # `check` counts negative pivots
                stop = (Stop.CONVERGED, Stop.LOCAL_ANGLE, Stop.SINGULAR)[status]
                return int(stop), n, self._over_bound(worst), 0, 1.0
            if n == max_steps:
                break
            if n > 0 and limit < math.inf and np.linalg.norm(work.rhs) > limit:
                return self._stop(Stop.DIVERGED, n, worst, begin)
            regular, solved, turn, shift = contact_step(
                arrays.ints, self.plan, work.matrix, work.scaled_rows, work.rhs, self.unknowns, self.block, self.active,
                self.first, what.pairs, self.data, what.bodies, what.nodes, motion.x, motion.R, *before, size, self.stiff,
                self.spring, self.forces, self.out,
            )  # fmt: skip
            if not regular:
                return self._stop(Stop.SINGULAR, n, worst, begin)
            unsolved = 0 if solved else unsolved + 1
            if unsolved > 2:
                return self._stop(Stop.JAMMED, n, worst, begin)
            previous, moved = worst, max(turn / 1e-6, shift / (1e-7 * size))
            if not math.isfinite(moved):
                return self._stop(Stop.NOT_FINITE, n, worst, begin)
            take_step(arrays, motion, work.rhs, work, max_turn / turn if n > 0 and turn > max_turn else 1.0)
        return self._stop(Stop.TOO_MANY, max_steps, worst, begin)

    def check(
        self, motion: State, values: Array, factor: float, before: tuple[Array, Array]
    ) -> tuple[float, int]:
        """Residual over its bound at a state found, maybe on other arrays of the same mechanism, and the number of
        directions in which it is no minimum, closed contacts held; see the theory of contact.

        With K' = K + E S E' as factored, contact forces of stiffness G = S - D, and the directions B of closed contacts, the
        negative pivots of the whole follow from those of K' and of a small matrix (Haynsworth).
        """
        arrays, work, what, q = self.arrays, self.work, self.what, len(self.unknowns)
        self.before = before
        self.look(motion, before, factor)
        target = np.ascontiguousarray(values[: len(arrays.terms.start)])
        worst, _, inside, _ = assemble(arrays, motion, target, factor, work)
        if not math.isfinite(worst):
            return worst, 0
        worst = self._over_bound(worst)
        X, C = np.empty((q, len(work.rhs))), np.empty((q, q))
        self.spring[:] = 0.0
        own, _ = touched_compliance(
            self.plan, work.matrix, work.scaled_rows, self.unknowns, self.block, self.active, self.stiff, arrays.size,
            self.spring, X, C,
        )  # fmt: skip
        small, alike = stability_matrix(
            what.pairs, self.data, what.bodies, what.nodes, self.first, self.active, motion.x, motion.R, *before,
            arrays.size, self.forces, self.out, self.spring, C,
        )  # fmt: skip
        if alike and own + inside == len(arrays.terms.start):
            return worst, 0
        # redundant contacts count as held
        negative = int((np.linalg.eigvalsh(small) < 1e-11).sum()) + q - len(small)
        return worst, int(own + inside) + negative - len(arrays.terms.start)

    def found(self, values: Mapping[str, float], *, converged: bool = True) -> tuple[Model, Touched]:
        """The model with the contact forces found as its loads, and these; values: as `Touching.values`."""
        held = contact_model(self.model, self.what.nodes)
        arrays = held.arrays.copy()
        if converged:
            arrays.loads.force[self.loads], arrays.loads.moment[self.loads] = self.push, self.turn
        model = replace(held, arrays=arrays)
        # known already, and asked by every pose
        model.__dict__["conservative"] = self.model.conservative
        model.derived["strips"] = strips(self.model)
        forces = self.forces.copy()
        closed = bool(forces[:, 0].any())
        return model, Touched(self.what, dict(values), forces, self.out.copy(), self.before, closed=closed)

    def _stop(self, reason: Stop, n: int, worst: float, begin: Array) -> NewtonResult:
        """The result of a failed try, after which the forces are those before it."""
        self.forces = begin
        return int(reason), n, worst, 0, 1.0

    def _is_rounding(self, moved: float) -> bool:
        """Whether the residual is rounding of the stiffest member, as on bodies without one, after a step of no size."""
        return moved <= 1.0 and self._rounding() <= 1.0

    def _over_bound(self, worst: float) -> float:
        """The residual over its bound; rounding is the bound of bodies without leaf springs."""
        if worst <= 1.0:
            return worst
        rounding = self._rounding()
        return rounding if rounding <= 1.0 else worst

    def _rounding(self) -> float:
        """The largest residual over what rounding leaves of the stiffest member."""
        return float(np.abs(self.work.rhs).max(initial=0.0)) / self.noise
