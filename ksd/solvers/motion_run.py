"""Runs of one motion: time steps of one size, halved where they find no solution, through known jumps, to an event or the
end."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.newton import CONVERGED, LOCAL_ANGLE_LIMIT, NOT_FINITE, SINGULAR, STEP_LIMIT
from ksd.scene.simulation import Simulation
from ksd.solvers.motion import MAX_ITERATIONS, Motion, Refused, Saved, Taken
from ksd.solvers.moving_model import MovingModel
from ksd.solvers.time_steps import Step, generalised_alpha
from ksd.solvers.trace import flat_state

Array = NDArray[np.float64]
CHUNK = 64
"""Most steps of one compiled call."""
MAX_HALVINGS = 12
"""How often a step is halved before the motion is stopped."""
REASONS = {
    STEP_LIMIT: f"{MAX_ITERATIONS} iterations did not suffice", LOCAL_ANGLE_LIMIT: "a leaf spring left its range",
    SINGULAR: "the tangent is singular", NOT_FINITE: "numbers left their range",
}  # fmt: skip
"""Words for the reasons of a refused step (`ksd.model.newton`)."""


@dataclass
class Run:
    """A motion with steps of one size: rows of all instants, and the multipliers just after those at which they jump."""

    parts: list[Taken]
    right: dict[int, Array]
    steps: int = 0
    halved: int = 0
    stop: str | None = None
    at_event: bool = False

    @property
    def all(self) -> Taken:
        """All rows."""
        return Taken(*(np.concatenate(field) for field in zip(*(p.parts for p in self.parts), strict=True)))

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


def segments(words: Simulation, kicks: Iterable[float], dt: float) -> list[tuple[float, float, int]]:
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
            return float(sum(one.coefficient * term_values(model, one, x, R)[0] for one in terms))

        return read

    def run(self, dt: float, finer: int = 1, advance: Any = None) -> Run:
        """A run with the largest step of at most `dt`, `finer` times as many steps."""
        motion = Motion(self.moving, self.words, self.start, self.values)
        if self.words.speeds:
            motion.set_speeds(self.words.speeds)
        run = Run([], {})
        try:
            for a, b, count in segments(self.words, self.kicks, dt):
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
                run.parts[-1] = Taken(*(part[:0] for part in taken.parts))
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

    def _until_event(self, motion: Motion, step: Step, saved: Saved, taken: Taken, run: Run) -> Taken:
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
            kept = motion.take(step, k)[0] if k else Taken(*(part[:0] for part in taken.parts))
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
            return Taken(*(np.concatenate(pair) for pair in zip(kept.parts, last.parts, strict=True)))
        return taken


def term_values(model: Model, term: Any, x: Array, R: Array) -> Array:
    """Displacement [m] or rotation [rad], up to whole turns, of a component of motion, at places x (k, nodes, 3) and
    orientations R (k, nodes, 3, 3)."""
    base, link = (model.node_names.index(n) for n in (term.base, term.link))
    along, rest = np.asarray(term.direction), model.rest.x
    if term.kind == "rotation":
        turned = Rotation.from_matrix(R[:, base].swapaxes(1, 2) @ R[:, link]).as_rotvec()
        return np.asarray(turned @ along)
    a, b = (x[:, k] + R[:, k] @ (np.asarray(term.point) - rest[k]) for k in (base, link))
    return np.asarray(((R[:, base] @ along) * (b - a)).sum(axis=1))
