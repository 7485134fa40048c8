"""Motion in time: runs of time steps (`ksd.solvers.time_steps`) from a start, through known jumps, to an end."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ksd.answers.forces import energy_of_one_spring
from ksd.answers.frequencies import frequencies
from ksd.answers.mass import centre_of_mass
from ksd.answers.printing import progress_bar
from ksd.errors import ConvergenceError, KinematicsError, SceneError
from ksd.model.arrays import State, make_workspace
from ksd.model.compile import Model, compile_scene
from ksd.model.leaves import mass_density
from ksd.model.mesh import DEFAULT_MESH, Mesh
from ksd.model.newton import (
    CONVERGED,
    LOCAL_ANGLE_LIMIT,
    NOT_FINITE,
    RTOL,
    SINGULAR,
    STEP_LIMIT,
    assemble,
    take_step,
)
from ksd.model.plane import Plane
from ksd.numerics.kernel import announce_compiling
from ksd.scene.functions_of_time import FunctionOfTime
from ksd.scene.simulation import DEFAULT_ACCURACY, Simulation
from ksd.solvers.configuration import Configuration
from ksd.solvers.mass_at_ends import lowest_frequency_change, with_mass_at_ends
from ksd.solvers.moving_model import HEAVY_LEAVES, MovingModel, moving_model
from ksd.solvers.solver import solve
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
from ksd.solvers.trace import Trace, flat_state, with_load_factors

Array = NDArray[np.float64]
CHUNK = 64
"""Most steps of one compiled call."""
MAX_HALVINGS = 12
"""How often a step is halved before the motion is stopped."""
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
STEPS_PER_RAMP, STEPS_PER_PERIOD = 20.0, 100.0
"""Steps in the shortest part of a function of time, and in the longest period, of the first pair of runs."""
SINGULAR_SIZE = 1e-14
"""Smallest singular value of the scaled tangent of a step below which something moves freely and without mass."""
MISSING_ENERGY = 0.01
"""Energy missing in the balance, over the largest change of one of its parts, that is said."""
GROWN_ENERGY = 3.0
"""Energy that came from nothing, over all that was put in, of a motion that is said to be unstable."""
MAX_PAIRS = 4
"""How often the step is made smaller for the accuracy."""
FINE_ORDERS = (5, 4, 8)
"""Orders of leaf springs that carry little but themselves."""

REASONS = {
    STEP_LIMIT: f"{MAX_ITERATIONS} iterations did not suffice", LOCAL_ANGLE_LIMIT: "a leaf spring left its range",
    SINGULAR: "the tangent is singular", NOT_FINITE: "numbers left their range",
}  # fmt: skip
"""Words for the reasons of a refused step (`ksd.model.newton`)."""


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
        self._read_places(self.history[0])

    def _read_places(self, q: Array) -> None:
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
    ) -> tuple[_Taken, int]:
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
        taken = _Taken(
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
        return _Taken(*(part[:done] for part in taken.parts)), reason

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

    def row(self) -> _Taken:
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
        return _Taken(
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
        matrix = _dense(self.arrays.plan, self.work.matrix)
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
        self._read_places(q)
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


def _dense(plan: Any, values: Array) -> Array:
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
class _Taken:
    """Rows of consecutive instants: t (k,), states (k, n), speeds and accelerations (k, 12 nodes), scalars (k, SCALARS)."""

    t: Array
    states: Array
    speeds: Array
    accelerations: Array
    scalars: Array

    @property
    def last(self) -> _Taken:
        """The last row alone."""
        return _Taken(*(part[-1:] for part in self.parts))

    @property
    def parts(self) -> tuple[Array, ...]:
        """All arrays."""
        return self.t, self.states, self.speeds, self.accelerations, self.scalars


@dataclass
class Run:
    """A motion with steps of one size: rows of all instants, and the multipliers just after those at which they jump."""

    parts: list[_Taken]
    right: dict[int, Array]
    steps: int = 0
    halved: int = 0
    stop: str | None = None
    at_event: bool = False

    @property
    def all(self) -> _Taken:
        """All rows."""
        return _Taken(*(np.concatenate(field) for field in zip(*(p.parts for p in self.parts), strict=True)))

    @property
    def instants(self) -> int:
        """Number of rows."""
        return sum(len(p.t) for p in self.parts)


def _kicks(words: Simulation, freed: Iterable[str]) -> dict[float, bool]:
    """Instants at which accelerations or their rates jump, and whether speeds of drives do."""
    found: dict[float, bool] = {}
    for name, f in words.functions().items():
        is_drive = name.startswith("drive")
        instants = [t for t, order in f.jumps if order <= (3 if is_drive else 1)]
        if any(f.rates(0.0)):
            instants.append(0.0)
        for t in instants:
            if 0.0 <= t < words.until:
                found[t] = found.get(t, False) or is_drive
    if words.speeds or freed or words.start != "equilibrium":
        found[0.0] = found.get(0.0, False) or bool(words.speeds)
    return found


def _segments(words: Simulation, kicks: Iterable[float], dt: float) -> list[tuple[float, float, int]]:
    """(start, end, number of steps) of the parts of a motion between jumps."""
    near = 1e-9 * words.until
    edges = [0.0]
    for t in sorted({*kicks, words.until}):
        if t - edges[-1] > near:
            edges.append(t)
    edges[-1] = words.until
    return [(a, b, max(1, math.ceil((b - a) / dt - 1e-9))) for a, b in pairwise(edges)]


class Marcher:
    """Runs of one motion with several steps; advance: called with the number of steps made."""

    def __init__(
        self,
        moving: MovingModel,
        words: Simulation,
        start: State,
        values: Mapping[str, float],
        freed: Iterable[str],
    ) -> None:
        self.moving, self.words, self.start, self.values = moving, words, start, values
        self.kicks = _kicks(words, freed)
        self.readers = {event.of: self._reader(event.of) for event in words.stop}
        self.notes: list[str] = []

    def _reader(self, name: str) -> Any:
        """The value of a drive or sensor, by the flat state and the instant."""
        moving, scene = self.moving, self.moving.model.scene
        model, nodes = moving.model, len(moving.rest.x)
        drive = {d.name: d for d in scene.drives}.get(name)
        f = self.words.drives.get(name, 0.0)
        if drive is not None and f is not None:
            return lambda row, t: float(f(t)) if callable(f) else self.values[name]
        terms = drive.terms if drive else tuple(s.term for s in scene.sensors if s.name == name)

        def read(row: Array, t: float) -> float:
            x, R = row[: 3 * nodes].reshape(1, -1, 3), row[3 * nodes : 12 * nodes].reshape(1, -1, 3, 3)
            return float(sum(one.coefficient * _term_values(model, one, x, R)[0] for one in terms))

        return read

    def run(self, dt: float, finer: int = 1, advance: Any = None) -> Run:
        """A run with the largest step of at most `dt`, `finer` times as many steps."""
        motion = Motion(self.moving, self.words, self.start, self.values)
        if self.words.speeds:
            motion.set_speeds(self.words.speeds)
        run = Run([], {})
        try:
            for a, b, count in _segments(self.words, self.kicks, dt):
                near = (t for t in self.kicks if abs(t - b) <= 1e-9 * self.words.until)
                motion.t, motion.jump = a, min(near, default=math.inf)
                step = generalised_alpha((b - a) / (finer * count), self.words.rho)
                kick = min(self.kicks, key=lambda t: abs(t - a), default=math.inf)
                motion.known_past = 0
                if a > 0.0 and abs(kick - a) <= 1e-9 * self.words.until and not self.kicks[kick]:
                    self._push(motion, step, run, kick)
                elif abs(kick - a) <= 1e-9 * self.words.until:
                    # speeds on the way are off those of the drives by dt^2, which a tiny step would make a huge q''
                    self._restart(motion, step, run, self.kicks[kick] or a > 0.0)
                if not run.parts:
                    run.parts.append(motion.row())
                self._march(motion, step, finer * count, run, advance)
                if run.stop is not None:
                    break
        except KeyboardInterrupt:
            run.stop = f"interrupted at t = {motion.t:.6g} s"
        except Refused:
            run.stop = f"at t = {motion.t:.6g} s the accelerations after a jump were not found"
        if not run.parts:
            run.parts.append(motion.row())
        self.motion = motion
        return run

    def _push(self, motion: Motion, step: Step, run: Run, t: float) -> None:
        before, after = (motion.acting(np.array([t]), before=side) for side in (True, False))
        if any((a != b).any() for a, b in zip(before, after, strict=True)):
            motion.push(step, before, after)
            run.right[max(run.instants - 1, 0)] = motion.right_multiplier.copy()

    def _restart(self, motion: Motion, step: Step, run: Run, is_pushed: bool) -> None:
        before = motion.history[1].copy()
        motion.restart(step, is_pushed=is_pushed)
        run.right[max(run.instants - 1, 0)] = motion.right_multiplier.copy()
        if motion.t == 0.0 and self.words.speeds and not self.notes:
            self._say_speeds(before, motion)

    def _say_speeds(self, before: Array, motion: Motion) -> None:
        """Say by how much speeds given to links with mass contradict the constraints; others follow in any case."""
        for name in sorted(self.words.speeds.keys() & {m.link for m in self.moving.model.scene.masses}):
            own = 12 * self.moving.model.node_names.index(name)
            given = before[own : own + 12]
            off = float(np.abs(motion.right_speeds[own : own + 3] - given[:3]).max())
            size = float(self.moving.arrays.size)
            fastest = max(np.abs(given[:3]).max(), size * np.abs(given[3:]).max())
            # less than that are the speeds of something at rest
            if off > max(1e-3 * fastest, 1e-9 * size / self.words.until):
                self.notes.append(
                    f"speeds of '{name}' contradict what holds it, by {off:.3g} m/s; it starts with the nearest that do not"
                )

    def _march(self, motion: Motion, step: Step, count: int, run: Run, advance: Any) -> None:
        """Take `count` steps; one that finds no solution is halved."""
        whole = 1 << MAX_HALVINGS
        left, size, begin = count * whole, whole, motion.t
        end = begin + count * step.dt
        while left > 0 and run.stop is None:
            now = step if size == whole else generalised_alpha(step.dt * size / whole, self.words.rho)
            chunk = min(left // size, CHUNK if size == whole else 2)
            saved = Saved(motion) if self.words.stop else None
            taken, reason = motion.take(now, chunk)
            done = len(taken.t)
            left -= done * size
            # instants without the rounding of many sums
            taken.t[:] = end - step.dt / whole * (left + size * np.arange(done - 1, -1, -1))
            motion.t = end - step.dt / whole * left
            if saved is not None and done:
                taken = self._until_event(motion, now, saved, taken, run)
                done = len(taken.t)
            run.parts.append(taken)
            run.steps += done
            if advance is not None:
                advance(done * size / whole)
            if not (np.isfinite(taken.states).all() and np.isfinite(taken.scalars).all()):
                run.stop = f"numbers are no longer finite at t = {motion.t:.6g} s"
                run.parts[-1] = _Taken(*(part[:0] for part in taken.parts))
            elif run.stop is None and reason != CONVERGED:
                run.halved += 1
                size //= 2
                motion.known_past = 0
                if size == 0:
                    run.stop = (
                        f"at t = {motion.t:.6g} s no step was found, down to {step.dt / whole:.3g} s: "
                        f"{REASONS.get(reason, 'it did not converge')}"
                    )
            elif size < whole and left % (2 * size) == 0:
                size *= 2
                motion.known_past = 0

    def _until_event(self, motion: Motion, step: Step, saved: Saved, taken: _Taken, run: Run) -> _Taken:
        """What was taken up to the first event, if there is one, with a last step that ends there."""
        for event in self.words.stop:
            reading = self.readers[event.of]
            rows, t = np.vstack([flat_state(saved.state), taken.states]), np.concatenate([[saved.t], taken.t])
            values = np.array([event.excess(reading(row, one)) for row, one in zip(rows, t, strict=True)])
            crossed = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0))
            if not len(crossed):
                continue
            k = int(crossed[0])
            saved.restore(motion)
            kept = motion.take(step, k)[0] if k else _Taken(*(part[:0] for part in taken.parts))
            kept.t[:] = taken.t[:k]
            share = float(values[k] / (values[k] - values[k + 1]))
            motion.t, motion.known_past = float(t[k]), 0
            mark = Saved(motion)
            last = taken
            for _ in range(3):
                mark.restore(motion)
                last, reason = motion.take(generalised_alpha(max(share, 1e-3) * step.dt, self.words.rho), 1)
                if reason != CONVERGED:
                    break
                off = event.excess(reading(last.states[0], float(last.t[0])))
                share = min(max(share - off / (values[k + 1] - values[k]), 1e-3), 1.0)
            run.stop = f"event: {event} at t = {motion.t:.6g} s"
            run.at_event = True
            return _Taken(*(np.concatenate(pair) for pair in zip(kept.parts, last.parts, strict=True)))
        return taken


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


def _term_values(model: Model, term: Any, x: Array, R: Array) -> Array:
    """Displacement [m] or rotation [rad], up to whole turns, of a component of motion, at places x (k, nodes, 3) and
    orientations R (k, nodes, 3, 3)."""
    base, link = (model.node_names.index(n) for n in (term.base, term.link))
    along, rest = np.asarray(term.direction), model.rest.x
    if term.kind == "rotation":
        turned = Rotation.from_matrix(R[:, base].swapaxes(1, 2) @ R[:, link]).as_rotvec()
        return np.asarray(turned @ along)
    a, b = (x[:, k] + R[:, k] @ (np.asarray(term.point) - rest[k]) for k in (base, link))
    return np.asarray(((R[:, base] @ along) * (b - a)).sum(axis=1))


def _work(motion: Motion, run: Run, rows: _Taken, x: Array, R: Array, values: Array, forces: Array) -> Array:
    """Work (k,) [J] of loads, drives and a base since the first instant, by the trapezoidal rule; values, forces (k, d)."""
    done = np.zeros(len(rows.t))
    if len(rows.t) < 2:
        return done
    right = forces.copy()
    held = np.array([f is not None for f in motion.drives], bool)
    for i, multiplier in run.right.items():
        right[i, held] = -multiplier[: forces.shape[1]][held]
    done[1:] += (0.5 * (right[:-1] + forces[1:]) * np.diff(values, axis=0)).sum(axis=1)
    arrays = motion.arrays
    after, before = motion.load_factors(rows.t[:-1]), motion.load_factors(rows.t[1:], before=True)
    for i, node in enumerate(arrays.loads.node.tolist()):
        point = x[:, node] + R[:, node] @ arrays.loads.point[i]
        turn = Rotation.from_matrix(R[1:, node] @ R[:-1, node].swapaxes(1, 2)).as_rotvec()
        axes = R[:, node] if arrays.loads.following[i] else np.broadcast_to(np.eye(3), (len(x), 3, 3))
        for vector, moved in zip(motion.loads, (np.diff(point, axis=0), turn), strict=True):
            push = axes @ vector[i]
            mean = 0.5 * (after[:, i, None] * push[:-1] + before[:, i, None] * push[1:])
            done[1:] += (mean * moved).sum(axis=1)
    own = slice(arrays.loads.node.size, None)
    done[1:] += (0.5 * (after[:, own] + before[:, own]) * np.diff(rows.scalars[:, SCALARS:], axis=0)).sum(
        axis=1
    )
    if motion.words.base is not None:
        moment, pulled = (
            rows.scalars[:, 4:7],
            motion.gravities(rows.t[:-1]) + motion.gravities(rows.t[1:], before=True),
        )
        done[1:] += ((0.5 * pulled - motion.gravity) * np.diff(moment, axis=0)).sum(axis=1)
    return np.cumsum(done)


def _energies(motion: Motion, run: Run, rows: _Taken, states: Array, trace_of: Any) -> dict[str, Array]:
    """Energies (k,) [J] of a motion by name."""
    model, values, forces, x, R = trace_of
    springs = np.zeros(len(rows.t))
    if model.spring_names:
        for k, row in enumerate(states):
            state = _unflatten(row, model.rest)
            springs[k] = sum(energy_of_one_spring(model, state, i) for i in range(len(model.spring_names)))
    kinetic, strain = rows.scalars[:, 0], rows.scalars[:, 1] + springs
    gravity = -(rows.scalars[:, 4:7] - rows.scalars[0, 4:7]) @ motion.gravity
    power = rows.scalars[:, 2] + rows.scalars[:, 3]
    damped = np.concatenate([[0.0], np.cumsum(0.5 * (power[:-1] + power[1:]) * np.diff(rows.t))])
    work = _work(motion, run, rows, x, R, values, forces)
    total = kinetic + strain + gravity
    return {
        "kinetic": kinetic, "strain": strain, "gravity": gravity, "work": work, "damped": damped,
        "lost": work - damped - (total - total[0]),
    }  # fmt: skip


def _missing_energy(energy: Mapping[str, Array], rounding: float) -> list[str]:
    """A sentence where the balance of the energies lacks much of the kinetic energy, or of the largest change of another.

    rounding [J]: energy of speeds that are none.
    """
    most = max(float(np.ptp(part)) for name, part in energy.items() if name != "lost")
    most = max(most, float(energy["kinetic"].max()))
    level = max(float(np.abs(part).max()) for part in energy.values())
    lost = float(np.abs(energy["lost"]).max())
    if lost <= max(MISSING_ENERGY * most, 10.0 * STEP_RTOL * level, rounding):
        return []
    supplied = float(
        np.ptp(energy["work"]) + np.ptp(energy["gravity"]) + energy["kinetic"][0] + energy["strain"][0]
    )
    grown = float(-energy["lost"].min())
    if grown > GROWN_ENERGY * supplied:
        return [
            f"{grown:.2g} J came from nothing, {grown / max(supplied, 1e-300):.2g} times what was put in: the motion is "
            "unstable with steps of this length; take a smaller dt"
        ]
    return [
        f"{lost:.2g} J are missing in the balance of energies, {100.0 * lost / most:.2g} % of the largest: what dampers "
        "took, or the motion itself, is followed no better than that; take a smaller dt"
    ]


def _unflatten(row: Array, like: State) -> State:
    """The state of a flat row."""
    parts = np.split(row, np.cumsum([field.size for field in like])[:-1])
    return State(*(part.reshape(field.shape) for part, field in zip(parts, like, strict=True)))


def _spins(rates: Array, R: Array) -> Array:
    """Skew parts (k, n, 3) of rates (k, n, 3, 3) of orientations: angular speeds, or angular accelerations."""
    M = rates @ R.swapaxes(-1, -2)
    return 0.5 * np.stack(
        [M[..., 2, 1] - M[..., 1, 2], M[..., 0, 2] - M[..., 2, 0], M[..., 1, 0] - M[..., 0, 1]], axis=-1
    )


def trace_of_run(marcher: Marcher, run: Run, error: float) -> Trace:
    """The record of a run."""
    moving, motion, rows = marcher.moving, marcher.motion, run.all
    kept = np.arange(len(rows.t))[:: marcher.words.every]
    if len(kept) and kept[-1] != len(rows.t) - 1:
        kept = np.append(kept, len(rows.t) - 1)
    model, nodes = moving.model, len(moving.rest.x)
    states = rows.states[:, moving.static_parts()]
    x, R = (
        states[:, : 3 * nodes].reshape(-1, nodes, 3),
        states[:, 3 * nodes : 12 * nodes].reshape(-1, nodes, 3, 3),
    )
    drives = len(model.drive_names)
    values = motion.targets(rows.t)[:, :drives]
    at = 12 * nodes + len(moving.rest.inner)
    forces = -rows.states[:, at : at + drives]
    for i, name in enumerate(model.drive_names):
        if marcher.words.drives.get(name, 0.0) is None:
            forces[:, i] = -values[:, i]
            states[:, at - len(moving.rest.inner) + len(model.rest.inner) + i] = values[:, i]
            terms = model.scene.drives[i].terms
            values[:, i] = sum(t.coefficient * _term_values(model, t, x, R) for t in terms)
    energy = _energies(motion, run, rows, states, (model, values, forces, x, R))
    mass = moving.leaf_mass.sum() + sum(m.mass for m in model.scene.masses)
    rounding = 10.0 * np.finfo(float).eps * moving.arrays.size / np.diff(rows.t).min(initial=math.inf)
    marcher.notes += _missing_energy(energy, float(mass * rounding**2))
    rates = np.gradient(values, rows.t, axis=0) if len(rows.t) > 1 else np.zeros_like(values)
    for i, f in enumerate(motion.drives):
        if callable(f):
            rates[:, i] = [f.rates(t)[0] for t in rows.t]
    speeds, accelerations = (
        np.concatenate([part[..., :3], _spins(part[..., 3:].reshape(*part.shape[:2], 3, 3), R)], axis=-1)
        for part in (p.reshape(len(rows.t), nodes, 12) for p in (rows.speeds, rows.accelerations))
    )
    massless = tuple(n for k, n in enumerate(model.scene.links) if k and k not in moving.arrays.bodies.node)
    return Trace(
        model, rows.t[kept], states[kept], x[kept], R[kept], speeds[kept], accelerations[kept], values[kept], rates[kept],
        forces[kept], {n: e[kept] for n, e in energy.items()}, error, run.steps, run.halved, run.stop,
        run.stop is None or run.at_event, massless, tuple(marcher.notes), marcher.words.loads,
    )  # fmt: skip


def _difference(fine: Run, coarse: Run, order: float, links: NDArray[np.int64]) -> float:
    """Estimated error of the places of `links` in the finer of two runs, relative to the largest stroke.

    order: the ratio of the errors of both runs.
    """
    rows, others = fine.all, coarse.all
    _, own, other = np.intersect1d(np.round(rows.t, 12), np.round(others.t, 12), return_indices=True)
    places = [r.states[:, : 3 * (links[-1] + 1)].reshape(len(r.t), -1, 3)[:, links] for r in (rows, others)]
    stroke = np.linalg.norm(places[0] - places[0][:1], axis=2).max(initial=0.0)
    off = np.linalg.norm(places[0][own] - places[1][other], axis=2).max(initial=0.0)
    return float(off / (order - 1.0) / stroke) if stroke > 0.0 else 0.0


def _start(
    scene: Any, words: Simulation, mesh: Mesh
) -> tuple[Model, State, dict[str, float], tuple[str, ...]]:
    """Model, state and drive values at the start of a motion, and notes."""
    names = [d.name for d in scene.drives]
    values = {n: 0.0 if words.drives.get(n) is None else float(words.drives[n](0.0)) for n in names}
    if isinstance(words.start, Configuration):
        pose = words.start
        own = getattr(pose, "moving", None) or pose.model
        values |= {n: pose.targets[n] for n in names if words.drives.get(n) is None}
        return compile_scene(scene, mesh=own.mesh) if words.mass_at_ends else own, pose.motion, values, ()
    model = compile_scene(scene, mesh=mesh)
    if words.start == "undeformed":
        return model, model.rest, values, ()
    still = with_load_factors(scene, {name: f.before(0.0) for name, f in words.loads.items()})
    moved = tuple(load for load in still.loads if any(load.force) or any(load.moment))
    still = replace(still, loads=moved)
    is_pushed = moved or any(any(line.force) or any(line.end_force) for line in still.line_loads)
    if not any(values.values()) and not is_pushed and (scene.gravity is None or not any(scene.gravity)):
        work = make_workspace(model.arrays)
        if assemble(model.arrays, model.rest.copy(), model.targets(values), 0.0, work)[0] <= 1.0:
            return model, model.rest, values, ()
    found = solve(still, values, method="conventional", mesh=mesh, estimate=False, strict=False)
    notes = () if found.stable else ("it starts from an equilibrium that is not stable",)
    return model, found.motion, values, notes


def _first_step(moving: MovingModel, start: State, words: Simulation, freed: Iterable[str]) -> float:
    """The step [s] of the finer of the first pair of runs."""
    ramp = words.shortest / STEPS_PER_RAMP
    try:
        found = frequencies(moving.model, start, count=3, freed=tuple(freed)).frequency_Hz
    except (SceneError, KinematicsError):
        found = np.zeros(0)
    longest = float((1.0 / found[found > 0.0]).max(initial=0.0)) or math.inf
    return min(ramp, longest / STEPS_PER_PERIOD, words.until / STEPS_PER_PERIOD)


def _moving(model: Model, freed: Iterable[str], words: Simulation, *, spatial: bool = False) -> MovingModel:
    released = words.release is not None
    return moving_model(
        model, tuple(freed), damping_at=words.damping_at, is_released=released, spatial=spatial
    )


def _refuse_free_motions(motion: Motion, step: Step) -> None:
    """Raise SceneError where a link can move with neither mass nor stiffness against it, under the loads before t = 0."""
    arrays = motion.arrays
    factors = motion.load_factors(np.zeros(1), before=True)[0, : len(motion.loads[0]), None]
    arrays.loads.force[:], arrays.loads.moment[:] = (factors * part for part in motion.loads)
    motion.assemble(step.c0, step.c1)
    matrix = _dense(arrays.plan, motion.work.matrix)
    scale = 1.0 / np.sqrt(np.linalg.norm(matrix, axis=1).clip(1e-300))
    _, sizes, motions = np.linalg.svd(scale[:, None] * matrix * scale)
    if sizes[-1] > SINGULAR_SIZE:
        return
    free = scale * motions[-1]
    found = (0.0, "", "")
    for k, name in enumerate(motion.moving.model.node_names):
        for r, dof in enumerate(arrays.active_dofs.tolist() if arrays.start[k] >= 0 else ()):
            size = abs(free[arrays.start[k] + r]) * (1.0 if dof < 3 else arrays.size)
            found = max(found, (size, name, f"{'along' if dof < 3 else 'about'} {'xyz'[dof % 3]}"))
    raise SceneError(
        f"simulate: link '{found[1]}' is free to move {found[2]} and has no mass against it: give it a mass and an inertia, "
        "or hold it by a support, a drive or a spring"
    )


def begin_motion(
    scene: Any, words: Simulation, mesh: Mesh | None = None
) -> tuple[Marcher, float, tuple[str, ...], tuple[str, ...]]:
    """What marches from the start of a motion, the step [s] to begin with, the drives that are let go, and notes."""
    announce_compiling(
        "ksd.solvers.time_steps", "march", "the kernels of motion for this machine (once; one or two minutes)"
    )
    freed = tuple(n for n, f in words.drives.items() if f is None)
    grid, whole = DEFAULT_MESH if mesh is None else mesh, scene
    if words.mass_at_ends:
        scene = with_mass_at_ends(scene)
    if mesh is None and leaf_share(compile_scene(scene, mesh=grid)) > HEAVY_LEAVES:
        grid = replace(grid, orders=FINE_ORDERS, points=FINE_ORDERS[2] + 1)
    try:
        model, start, values, notes = _start(scene, words, grid)
    except ConvergenceError:
        model = compile_scene(scene, mesh=grid)
        still = Motion(_moving(model, freed, words), words, model.rest, dict.fromkeys(model.drive_names, 0.0))
        _refuse_free_motions(still, generalised_alpha(words.until, words.rho))
        raise
    moving = _moving(model, freed, words)
    if words.mass_at_ends:
        change = lowest_frequency_change(model, compile_scene(whole, mesh=model.mesh), start, freed)
        if abs(change) > (words.accuracy or DEFAULT_ACCURACY):
            notes += (
                f"with the mass of leaf springs at their ends the lowest frequency is {100.0 * change:+.2g} % off at the "
                "start; simulate without mass_at_ends where that counts",
            )
    if _starts_out_of_plane(moving, start, words):
        moving = _moving(model, freed, words, spatial=True)
    dt = words.dt or _first_step(moving, start, words, freed)
    marcher = Marcher(moving, words, start, values, freed)
    return marcher, dt, freed, notes


def trace_motion(scene: Any, words: Simulation, *, mesh: Mesh | None = None, progress: bool = True) -> Trace:
    """The motion of a frozen scene; words: checked; mesh: of the leaf springs, chosen when None.

    Raises SceneError for what cannot move in time.
    """
    marcher, dt, freed, notes = begin_motion(scene, words, mesh)
    run, error = _runs(marcher, dt, progress)
    if run.stop is not None and not run.at_event:
        still = Motion(marcher.moving, words, marcher.start, marcher.values)
        _refuse_free_motions(still, generalised_alpha(dt, words.rho))
    if _leaves_plane(marcher, run, freed):
        moving = _moving(marcher.moving.model, freed, words, spatial=True)
        marcher = Marcher(moving, words, marcher.start, marcher.values, freed)
        run, error = _runs(marcher, dt, progress)
    marcher.notes += notes
    return trace_of_run(marcher, run, error)


def _runs(marcher: Marcher, dt: float, progress: bool) -> tuple[Run, float]:
    """The run of the step that was given, or of one small enough for the accuracy, and its estimated error."""
    moving, words = marcher.moving, marcher.words
    steps = sum(n for _, _, n in _segments(words, marcher.kicks, dt))
    numbers = sum(f.size for f in moving.rest) + 24 * len(moving.rest.x) + SCALARS
    words.check_memory(steps, numbers=numbers)
    links = np.array(list(range(1, moving.model.links)) or [0])
    with progress_bar(progress) as bar:
        task = bar.add_task("motion", total=steps if words.dt else 1.5 * steps)

        def advance(done: float) -> None:
            bar.advance(task, done)

        if words.dt is not None:
            return marcher.run(words.dt, 1, advance), math.nan
        # the step of the coarser run of a pair, divided by whole numbers, so that instants agree
        whole, finer = 2.0 * dt, 1
        run, error, made = marcher.run(whole, 1, advance), math.inf, 1
        expected = 0.5 * steps
        for _ in range(MAX_PAIRS):
            if run.stop is not None and not run.at_event:
                finer = 2 * made
            elif made > 1 and error <= words.accuracy:
                break
            else:
                wanted = 2 if made == 1 else math.ceil(math.sqrt(error / (0.8 * words.accuracy)))
                finer = made * min(max(wanted, 2), 8)
            try:
                words.check_memory(finer * steps // 2, numbers=numbers)
            except SceneError as reason:
                marcher.notes.append(str(reason))
                break
            expected += 0.5 * finer * steps
            bar.update(task, total=expected)
            other = marcher.run(whole, finer, advance)
            if run.stop is not None and run.stop.startswith("interrupted"):
                break
            error = _difference(other, run, (finer / made) ** 2, links)
            run, made = other, finer
            if run.stop is not None and run.stop.startswith("interrupted"):
                break
        if error > words.accuracy:
            marcher.notes.append(
                f"the estimated error of {error:.2g} of the largest stroke is above the accuracy of {words.accuracy:g}; "
                "motion that is chaotic is not followed for long with any step"
            )
        return run, error


def _starts_out_of_plane(moving: MovingModel, start: State, words: Simulation) -> bool:
    """Whether the start, its speeds or the base are not in the plane of a planar model."""
    if moving.plane is None:
        return False
    k = moving.plane.normal
    speeds = [np.asarray(v, float) for v in words.speeds.values()]
    across = [v[:3] @ k for v in speeds] + [v[3:] @ k * k - v[3:] for v in speeds]
    if words.base is not None:
        across.append(np.asarray(words.base.along) @ k)
    return not moving.plane.contains(start) or any(np.any(np.abs(a) > 0.0) for a in across)


def _leaves_plane(marcher: Marcher, run: Run, freed: tuple[str, ...]) -> bool:
    """Whether forces out of the plane do not balance at some instants of a planar motion, found by the residual in space."""
    flat, rows = marcher.moving, run.all
    plane = flat.plane
    if plane is None or len(rows.t) < 2:
        return False
    moving = _moving(flat.model, freed, marcher.words, spatial=True)
    space = Plane(moving.arrays, moving.rest, plane.axis, plane.rows)
    nodes = len(moving.rest.x)
    strongest = int(np.argmax(np.abs(rows.accelerations[1:, :]).max(axis=1))) + 1
    for i in sorted({1, strongest, len(rows.t) - 1}):
        other = Motion(moving, marcher.words, flat.model.rest, marcher.values)
        state = _unflatten(rows.states[i], flat.rest)
        static = State(state.x, state.R, state.inner[flat.inner], state.multiplier[: len(flat.model.arrays.terms.start)],
                       flat.model.rest.angle)  # fmt: skip
        other.state.assign(moving.moving_state(static))
        for m in np.flatnonzero(moving.modes[:, 1]).tolist():
            own = moving.arrays.members.inner_at[m] + int(moving.arrays.members.number[m, :3].sum()) + 6
            at = flat.arrays.members.inner_at[m] + int(flat.arrays.members.number[m, 3]) + 6
            count = 3 * int(flat.modes[m, 0])
            other.state.inner[own : own + count] = state.inner[at : at + count]
        q = np.empty_like(other.q)
        other._read_places(q)
        gravity = other.gravities(rows.t[i : i + 1])[0]
        for m in np.flatnonzero(moving.modes[:, 1]).tolist():
            own = moving.arrays.members.inner_at[m] + int(moving.arrays.members.number[m, :3].sum()) + 6
            size = 3 * int(moving.modes[m, 1])
            at = 12 * nodes + 3 * int(moving.modes[:m, 1].sum())
            other.state.inner[own + size : own + 2 * size] = (
                q[at : at + size] + other.state.inner[own : own + size]
            )
        other.arrays.known[:] = (q[: 12 * nodes] - rows.accelerations[i]).reshape(nodes, 12)
        other.arrays.known[:, :3] += gravity
        factors = other.load_factors(rows.t[i : i + 1])[0, : len(other.loads[0]), None]
        other.arrays.loads.force[:], other.arrays.loads.moment[:] = (factors * part for part in other.loads)
        other.assemble()
        if space.imbalance(other.work)[0] > 1.0:
            return True
    return False


def leaf_share(model: Model) -> float:
    """Share of the leaf springs in the mass that moves."""
    own = sum(
        float(mass_density(leaf)) * leaf.section.A * leaf.length for leaf in model.scene.leaf_names().values()
    )
    rigid = sum(m.mass for m in model.scene.masses if m.link != model.scene.links[0])
    return own / (own + rigid) if own > 0.0 else 0.0
