"""The record of a run: places, speeds and forces over time, and the balance of its energies."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ksd.answers.forces import spring_energy
from ksd.solvers.motion import STEP_RTOL, Motion, Taken
from ksd.solvers.motion_run import Marcher, Run, term_values
from ksd.solvers.time_steps import SCALARS
from ksd.solvers.trace import Trace, state_of_row

Array = NDArray[np.float64]
MISSING_ENERGY = 0.01
"""Energy missing in the balance, over the largest change of one of its parts, that is said."""
GROWN_ENERGY = 3.0
"""Energy that came from nothing, over all that was put in, of a motion that is said to be unstable."""


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
            values[:, i] = sum(t.coefficient * term_values(model, t, x, R) for t in terms)
    energy = _energies(motion, run, rows, states, (model, values, forces, x, R))
    mass = moving.leaf_mass.sum() + sum(m.mass for m in model.scene.masses)
    rounding = 10.0 * np.finfo(float).eps * moving.arrays.size / np.diff(rows.t).min(initial=math.inf)
    marcher.notes += missing_energy(energy, float(mass * rounding**2))
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


def _energies(motion: Motion, run: Run, rows: Taken, states: Array, trace_of: Any) -> dict[str, Array]:
    """Energies (k,) [J] of a motion by name."""
    model, values, forces, x, R = trace_of
    springs = np.zeros(len(rows.t))
    if model.spring_names:
        for k, row in enumerate(states):
            springs[k] = sum(spring_energy(model, state_of_row(row, model.rest)).values())
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


def _work(motion: Motion, run: Run, rows: Taken, x: Array, R: Array, values: Array, forces: Array) -> Array:
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


def missing_energy(energy: Mapping[str, Array], rounding: float) -> list[str]:
    """A sentence where the balance of the energies lacks much of the kinetic energy, or of the largest change of another.

    rounding [J]: energy of speeds that are none.
    """
    most = max(float(np.ptp(part)) for name, part in energy.items() if name != "lost")
    most = max(most, float(energy["kinetic"].max()))
    level = max(float(np.abs(part).max()) for part in energy.values())
    lost = float(np.abs(energy["lost"]).max())
    # where all that changes is what the tolerance of steps leaves of the energies, nothing moves
    if most <= 10.0 * STEP_RTOL * level or lost <= max(MISSING_ENERGY * most, 1e-9 * level, rounding):
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


def _spins(rates: Array, R: Array) -> Array:
    """Skew parts (k, n, 3) of rates (k, n, 3, 3) of orientations: angular speeds, or angular accelerations."""
    M = rates @ R.swapaxes(-1, -2)
    return 0.5 * np.stack(
        [M[..., 2, 1] - M[..., 1, 2], M[..., 0, 2] - M[..., 2, 0], M[..., 1, 0] - M[..., 0, 1]], axis=-1
    )
