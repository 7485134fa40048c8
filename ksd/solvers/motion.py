"""A model in motion: its state and history at an instant, what drives, loads and base do then, its steps and jumps."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.answers.mass import centre_of_mass
from ksd.model.arrays import State, make_workspace
from ksd.model.newton import CONVERGED, RTOL, assemble, take_step
from ksd.scene.functions_of_time import FunctionOfTime
from ksd.scene.simulation import Simulation
from ksd.solvers.moving_model import MovingModel
from ksd.solvers.time_steps import (
    SCALARS,
    Step,
    count_places,
    first_acceleration,
    generalised_alpha,
    impulse,
    march,
    measure,
    second_acceleration,
    start_places,
)
from ksd.solvers.trace import flat_state

Array = NDArray[np.float64]
MAX_ITERATIONS = 12
STEP_RTOL = 1e-6
"""Residual of a step, relative to the forces: places are 1e-8 of the stroke off, far less than by the step."""
RATE_PART, FIRST_PART, PUSH_PART = 0.5, 0.25, 1e-3
"""Parts of a step from which the rates of accelerations after a jump, these, and speeds are found.

The first two are no smaller, so that a jump does not excite motion too fast for the steps: with .25 and .025 it had up to
770 times the energy of what a load does to a mass on a stiff spring.
"""
START_PARTS = (1.0, 0.25, 2.0**-4, 2.0**-6)
"""Parts of a step with which accelerations after a jump are looked for, one after the other."""


class Motion:
    """A model in motion: its state and history at `t`, and what drives, loads and base do.

    Arrays of a step are allocated once.
    """

    def __init__(
        self, moving: MovingModel, words: Simulation, state: State, values: Mapping[str, float]
    ) -> None:
        """values: of the drives that do not move."""
        self.moving, self.words = moving, words
        scene = moving.model.scene
        self.pull = state.multiplier[: len(moving.model.drive_names)].copy()
        self.drives = [words.drives.get(n, values[n]) for n in moving.model.drive_names]
        moved = [load for load in scene.loads if load.link != scene.links[0]]
        self.factors = [words.loads.get(load.name) for load in (*moved, *scene.line_loads)]
        self.gravity = np.zeros(3) if scene.gravity is None else np.asarray(scene.gravity, float)
        self.arrays = moving.arrays.copy()
        self.loads = self.arrays.loads.force.copy(), self.arrays.loads.moment.copy()
        self.lines: Array = np.zeros((2, len(scene.line_loads), 0))
        self.state = moving.moving_state(state)
        self.work = make_workspace(self.arrays)
        self.t, self.jump = 0.0, math.inf
        count = int(count_places(self.arrays.ints, moving.tau))
        self.history, self.known, self.q = np.zeros((4, count)), np.zeros((2, count)), np.zeros(count)
        self.lines = self._place_lines(count)
        s = self.state
        self.past = np.zeros((2, *s.x.shape)), np.zeros((2, *s.R.shape)), np.zeros((2, len(s.inner)))
        self.known_past = 0
        self.multiplier = self.right_multiplier = s.multiplier.copy()
        self.right_speeds = self.history[1]
        self._set_weight()
        self.read_places(self.history[0])

    def read_places(self, q: Array) -> None:
        """Write the places q (p,) of the present state."""
        s = self.state
        self.assemble()
        start_places(
            *self.arrays.flat, s.x, s.R, s.inner, s.angle, self.moving.tau, self.work.flat, self.work.at, q
        )

    def assemble(self, c0: float = 1.0, c1: float = 0.0) -> None:
        """Residual and tangent at the present state, in a step with these c0 and c1."""
        self.arrays.rates[:] = c0, c1
        assemble(self.arrays, self.state, self.targets(np.zeros(1))[0], 1.0, self.work)

    def _place_lines(self, count: int) -> Array:
        """`MovingModel.lines` over the places (2, l, count)."""
        found = np.zeros((2, self.lines.shape[1], count))
        at, moving = 12 * len(self.state.x), self.moving
        for i, (forces, modes) in enumerate(moving.modes.tolist()):
            own = moving.lines[:, :, i, :forces]
            found[..., at : at + 3 * forces] = own.reshape(*own.shape[:2], 3 * forces)
            at += 3 * modes + (self._amplitudes(i) if moving.tau[i] > 0.0 else 0)
        return found

    def _set_weight(self) -> None:
        """Write the forces of gravity and line loads alone into the leaf springs."""
        members, factors = self.arrays.members, self.load_factors(np.zeros(1), before=True)[0]
        for i in np.flatnonzero(self.moving.modes[:, 1]).tolist():
            at, own = members.inner_at[i] + self._amplitudes(i) + 6, self.moving.lines[0, :, i]
            forces = np.einsum("l,lkr->kr", factors[len(self.loads[0]) :], own)[: self.moving.modes[i, 0]]
            forces[0] += self.gravity
            self.state.inner[at : at + forces.size] = forces.ravel()

    def _amplitudes(self, i: int) -> int:
        number = self.arrays.members.number[i]
        return int(number[3] if self.moving.plane is not None else number[:3].sum())

    def targets(self, t: Array) -> Array:
        """Right-hand sides (k, c) of all rows at instants; of drives that are let go the multipliers that are left."""
        found = np.zeros((len(t), len(self.moving.rows)))
        for i, f in enumerate(self.drives):
            found[:, i] = self.released(i, t) if f is None else f(t) if callable(f) else f
        return found

    def released(self, i: int, t: Array) -> Array:
        """What is left at instants of the multiplier of drive i, which is let go."""
        ramp = self.words.release
        return np.zeros(len(t)) if ramp is None else self.pull[i] * ramp(t)

    def gravities(self, t: Array, *, before: bool = False) -> Array:
        """Gravity less the acceleration of the base (k, 3) [m/s^2] at instants; before: just before them."""
        found, base = np.tile(self.gravity, (len(t), 1)), self.words.base
        if base is not None:
            shaken = _before(base.acceleration, t) if before else base.acceleration(t)
            found -= np.asarray(shaken)[:, None] * np.asarray(base.along)
        return found

    def load_factors(self, t: Array, *, before: bool = False) -> Array:
        """Factors (k, l) of all loads on links, weights of links, and line loads at instants; before: just before them."""
        links = len(self.loads[0])
        found = np.ones((len(t), links + self.lines.shape[1]))
        # the weights of links come between, which have none
        own = [*range(len(self.factors) - self.lines.shape[1]), *range(links, found.shape[1])]
        for i, f in zip(own, self.factors, strict=True):
            if f is not None:
                found[:, i] = _before(f, t) if before else f(t)
        return found

    def acting(self, t: Array, *, before: bool = False) -> tuple[Array, Array]:
        """`load_factors` and `gravities` at instants."""
        return self.load_factors(t, before=before), self.gravities(t, before=before)

    def take(
        self, step: Step, count: int, *, keep: bool = True, acting: tuple[Array, Array] | None = None
    ) -> tuple[Taken, int]:
        """Take steps, or try one and leave the state as it is. Returns what was kept, and the reason of the last step.

        acting: loads and gravity of a step that is tried; those of its instant when None.
        """
        s, moving = self.state, self.moving
        t: Array = self.t + step.dt * np.arange(1.0, count + 1.0)
        pushes, pulls = self.acting(t) if acting is None else acting
        if acting is None and abs(t[-1] - self.jump) <= 1e-6 * step.dt:
            # the step ends just before the jump
            pushes[-1:], pulls[-1:] = self.acting(np.array([self.jump]), before=True)
        nodes = 12 * len(s.x)
        size = sum(field.size for field in s)
        speeds, accelerations = np.empty((count, nodes)), np.empty((count, nodes))
        taken = Taken(
            t,
            np.empty((count, size)),
            speeds,
            accelerations,
            np.empty((count, SCALARS + self.lines.shape[1])),
        )
        before = None if keep else s.copy()
        done, reason = march(
            *self.arrays.flat, *s, self.work.flat, self.work.at, self.history, self.known, self.q, moving.body,
            moving.tau, step.flat, *self.past, self.known_past if keep else 0,
            self.targets(t), pushes, pulls, *self.loads, self.lines, taken.states, speeds,
            accelerations, taken.scalars, int(keep),
            MAX_ITERATIONS, STEP_RTOL if keep else RTOL,
        )  # fmt: skip
        if before is not None:
            self.multiplier = s.multiplier.copy()
            s.assign(before)
        elif done:
            self.t = float(t[done - 1])
            self.known_past = min(self.known_past + done, 2)
        return Taken(*(part[:done] for part in taken.parts)), reason

    def probe(self, step: Step, acting: tuple[Array, Array] | None = None) -> Array:
        """q'' (p,) of one step that is not taken. Raises Refused."""
        _, reason = self.take(step, 1, keep=False, acting=acting)
        if reason != CONVERGED:
            raise Refused
        return np.asarray(step.c0 * (self.q - self.known[0]))

    def _with_shorter(self, step: Step, start: Callable[[Step], None]) -> None:
        """Start with `step`, or with a shorter one where that finds no solution. Raises Refused."""
        history = self.history.copy()
        for shorter in START_PARTS:
            try:
                return start(generalised_alpha(shorter * step.dt, self.words.rho))
            except Refused:
                self.history[...] = history
        raise Refused

    def restart(self, step: Step, *, is_pushed: bool) -> None:
        """Set the history to accelerations that fit places, speeds and loads just after t, before steps `step`.

        is_pushed: the speeds of drives jump, or speeds were given: first make speeds fit the constraints. Raises Refused.
        """
        self.known_past = 0
        self._with_shorter(step, lambda one: self._restart(one, is_pushed))

    def _restart(self, step: Step, is_pushed: bool) -> None:
        dt, history = step.dt, self.history
        if is_pushed:
            # linear in the length of the push, so two of them tell the speeds after none
            once, twice = impulse(PUSH_PART * dt), impulse(2.0 * PUSH_PART * dt)
            self.probe(once)
            speed = 2.0 * (self.q - history[0]) / once.dt
            self.probe(twice)
            history[1] = speed - (self.q - history[0]) / twice.dt
        jerk = np.zeros_like(self.q)
        for _ in range(2):
            history[2] = jerk
            first, second = first_acceleration(FIRST_PART * dt), second_acceleration(RATE_PART * dt)
            history[3] = self.probe(first) - first.dt * jerk
            self.right_multiplier = self.multiplier
            # an error of the rate comes back as this part of it
            jerk += ((self.probe(second) - history[3]) / second.dt - jerk) / (1.0 - FIRST_PART / RATE_PART)
        lag = step.am - step.af
        beta = 0.25 * (step.gamma + 0.5) ** 2
        history[2] = history[3] + lag * dt * jerk
        self.right_speeds = history[1].copy()
        history[1] += (1.0 / 6.0 - beta - 0.5 * lag) * dt**2 * jerk

    def push(self, step: Step, before: tuple[Array, Array], after: tuple[Array, Array]) -> None:
        """Add to the accelerations what loads and base do that jump from `before` to `after` (see `acting`), before steps
        `step`.

        They come from two small steps that differ in nothing else, so that jumps may follow one another. Raises Refused.
        """
        self._with_shorter(step, lambda one: self._push(one, before, after))

    def _push(self, step: Step, before: tuple[Array, Array], after: tuple[Array, Array]) -> None:
        lagging, tiny = self.history[2].copy(), first_acceleration(FIRST_PART * step.dt)
        self.history[2] = 0.0
        change = -self.probe(tiny, before)
        change += self.probe(tiny, after)
        self.right_multiplier = self.multiplier
        self.history[2] = lagging + change
        self.history[3] += change

    def row(self) -> Taken:
        """The present instant as a row of what was taken, with speeds that are not shifted for the steps to come."""
        s, nodes, scalars = self.state, 12 * len(self.state.x), np.zeros((1, SCALARS + self.lines.shape[1]))
        history = self.history.copy()
        history[1] = self.right_speeds
        measure(
            *self.arrays.flat,
            s.x,
            s.R,
            s.inner,
            self.moving.tau,
            history,
            self.work.flat,
            self.work.at,
            scalars[0, :SCALARS],
        )
        scalars[0, SCALARS:] = self.lines[1] @ history[0]
        return Taken(
            np.array([self.t]), flat_state(s)[None], history[1, None, :nodes], history[3, None, :nodes], scalars,
        )  # fmt: skip

    def set_speeds(self, speeds: Mapping[str, tuple[float, ...]]) -> None:
        """Give links speeds (6,) of their centres of mass; links that are not named and have mass stay at rest, all else
        follows as in statics."""
        model, start = self.moving.model, self.arrays.start
        w, active = len(self.arrays.active_dofs), self.arrays.active_dofs
        held = [
            *speeds,
            *(m.link for m in model.scene.masses if m.link not in speeds and m.link != model.node_names[0]),
        ]
        velocity = np.zeros((len(start), 6))
        for name, own in speeds.items():
            node = model.node_names.index(name)
            arm = self.state.R[node] @ (model.rest.x[node] - centre_of_mass(model, name))
            velocity[node] = *(np.asarray(own[:3]) + np.cross(own[3:], arm)), *own[3:]
        self.assemble()
        matrix = dense_matrix(self.arrays.plan, self.work.matrix)
        given = np.concatenate([start[model.node_names.index(n)] + np.arange(w) for n in dict.fromkeys(held)])
        step = np.zeros(len(matrix))
        for k in np.flatnonzero(start >= 0).tolist():
            step[start[k] : start[k] + w] = velocity[k, active]
        # constraint rows are left to the impulse
        rest = np.setdiff1d(
            np.concatenate([start[k] + np.arange(w) for k in range(len(start)) if start[k] >= 0]), given
        )
        if len(rest):
            step[rest] = -np.linalg.solve(
                matrix[np.ix_(rest, rest)], matrix[np.ix_(rest, given)] @ step[given]
            )
        fastest = float(np.abs(step).max(initial=0.0))
        if fastest == 0.0:
            return
        h, before, q = 1e-6 * self.arrays.size / fastest, self.state.copy(), np.empty_like(self.q)
        take_step(self.arrays, self.state, step, self.work, h)
        self.read_places(q)
        self.history[1] = (q - self.history[0]) / h
        for k in np.flatnonzero(start >= 0).tolist():
            v = np.zeros(6)
            v[active] = step[start[k] : start[k] + w]
            self.history[1, 12 * k : 12 * k + 3] = v[:3]
            self.history[1, 12 * k + 3 : 12 * k + 12] = np.cross(v[3:], before.R[k].T).T.ravel()
        self.state.assign(before)


def _before(f: FunctionOfTime, t: Array) -> Array:
    """Values (k,) of a function just before instants (k,)."""
    values = np.array(f(t), float)
    for at in {at for at, order in f.jumps if order == 0}:
        values[t == at] = f.before(at)
    return values


def dense_matrix(plan: Any, values: Array) -> Array:
    """The symmetric matrix (n, n) of a block plan."""
    found = np.zeros((plan.unknowns, plan.unknowns))
    for k in range(len(plan.size)):
        places = [(k, plan.diagonal[k])]
        places += [(plan.row[e], plan.place[e]) for e in range(plan.first[k], plan.first[k + 1])]
        for i, at in places:
            block = values[at : at + plan.size[i] * plan.size[k]].reshape(plan.size[i], plan.size[k])
            rows, columns = (slice(plan.start[b], plan.start[b] + plan.size[b]) for b in (i, k))
            found[rows, columns] = block
            found[columns, rows] = block.T
    return found


class Refused(Exception):
    """A step without which the motion cannot go on found no solution."""


@dataclass
class Taken:
    """Rows of consecutive instants: t (k,), states (k, n), speeds and accelerations (k, 12 nodes), scalars (k, SCALARS)."""

    t: Array
    states: Array
    speeds: Array
    accelerations: Array
    scalars: Array

    @property
    def last(self) -> Taken:
        """The last row alone."""
        return Taken(*(part[-1:] for part in self.parts))

    @property
    def parts(self) -> tuple[Array, ...]:
        """All arrays."""
        return self.t, self.states, self.speeds, self.accelerations, self.scalars


class Saved:
    """A copy of a state of motion."""

    def __init__(self, motion: Motion) -> None:
        self.t, self.state, self.history = motion.t, motion.state.copy(), motion.history.copy()
        self.past, self.known_past = tuple(part.copy() for part in motion.past), motion.known_past

    def restore(self, motion: Motion) -> None:
        """Set a motion to it."""
        motion.t, motion.known_past = self.t, self.known_past
        motion.state.assign(self.state)
        motion.history[...] = self.history
        for part, own in zip(motion.past, self.past, strict=True):
            part[...] = own
