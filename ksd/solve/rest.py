"""Whether preloaded springs make the undeformed configuration unstable: then several minima are near, and which is taken."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ksd.model.arrays import COIL, TURN, Motion
from ksd.model.compile import Model
from ksd.numerics.rotations import rotation_log
from ksd.properties.kept import per_model
from ksd.properties.springs import energy_of_spring
from ksd.properties.tangent import assembled_tangent, row_gradients
from ksd.properties.words import axis_in_words, movement_of, ways
from ksd.solve.driving import CAP, RTOL
from ksd.solve.storage import Storage

Array = NDArray[np.float64]
FREE = 1e-15
"""Energy of a spring, over its stiffness (and the size squared, of a coil spring), up to which it is free of force."""
NEGATIVE = 1e-9
"""Negative stiffness, over the largest one, that is no rounding."""
PASSES = 5
"""Newton steps from the undeformed configuration to the equilibrium beside it, minimum or not."""


@dataclass(frozen=True)
class UnstableRest:
    """The equilibrium beside the undeformed configuration, where preload makes it no minimum: springs: names of those
    preloaded; count: its unstable directions; shape (nodes, 6) [m, rad]: the one of the most negative stiffness."""

    springs: tuple[str, ...]
    motion: Motion
    count: int
    shape: Array


@per_model
def unstable_rest(model: Model) -> tuple[UnstableRest, ...]:
    """The equilibrium of the preload alone, drives at zero, where it is unstable: one, or none."""
    springs = _preloaded(model)
    if not springs:
        return ()
    storage = Storage(model)
    storage.motion.assign(model.rest)
    storage.newton(np.zeros(len(model.arrays.terms.start)), 0.0, RTOL, PASSES, CAP, math.inf)
    motion = storage.motion.copy()
    if not np.isfinite(motion.x).all():
        return ()
    K = assembled_tangent(model, motion, load_factor=0.0).matrix()
    starts = model.arrays.start[1:]
    scale = np.array([1.0] * 3 + [1.0 / model.arrays.size] * 3)
    moves = (starts[:, None] + np.arange(6)).ravel()
    scales = np.tile(scale, len(starts))[:, None]
    held = scales * row_gradients(model, motion, range(len(model.arrays.terms.start)))[moves]
    _, size, axes = np.linalg.svd(held.T)
    free = scales * axes[int(np.sum(size > NEGATIVE * size.max(initial=0.0))) :].T
    value, vector = np.linalg.eigh(free.T @ K[np.ix_(moves, moves)] @ free)
    count = int(np.sum(value < -NEGATIVE * np.abs(value).max(initial=0.0)))
    if not count:
        return ()
    shape = np.vstack([np.zeros((1, 6)), (free @ vector[:, 0]).reshape(-1, 6)])
    return (UnstableRest(springs, motion, count, shape),)


def _preloaded(model: Model) -> tuple[str, ...]:
    """Springs that exert a force in the undeformed configuration."""
    springs = model.arrays.springs
    found = []
    for i, name in enumerate(model.spring_names):
        unit = {COIL: model.arrays.size**2, TURN: 1.0}.get(int(springs.kind[i]))
        stiffness = float(springs.value[springs.value_at[i]])
        if unit is not None and energy_of_spring(model, model.rest, i) > FREE * stiffness * unit:
            found.append(name)
    return tuple(found)


def minimum_taken(model: Model, motion: Motion, stable: bool) -> str:
    """That several minima are near because preload makes the undeformed configuration unstable, and which one `motion` is
    where it is one, in one sentence; nothing where the undeformed configuration is stable."""
    for rest in unstable_rest(model):
        node = int(np.argmax(ways(model, rest.shape)))
        name, does = model.node_names[node], movement_of(model, rest.shape[node])
        many = "one direction" if rest.count == 1 else f"{rest.count} directions"
        said = (
            f"the preload of {', '.join(rest.springs)} makes the undeformed configuration unstable in {many} ('{name}' "
            f"{does}): several minima are near"
        )
        if not stable:
            return f"{said}, and this state is between them; a load or another path leads to one (ksd.follow)"
        return f"{said}; taken is the one with '{name}' {_way(rest, motion, node, does)}"
    return ""


def _way(rest: UnstableRest, motion: Motion, node: int, does: str) -> str:
    """How far and in which sense a node is from the unstable equilibrium along its unstable direction, in words."""
    moved, axis = motion.x[node] - rest.motion.x[node], rest.shape[node, :3]
    turns = does.startswith("turns")
    if turns:
        moved, axis = np.empty(3), rest.shape[node, 3:]
        rotation_log(motion.R[node] @ rest.motion.R[node].T, moved)
    # in the sense in which the axis is written
    by = float(axis @ moved) * np.sign(axis[int(np.argmax(np.abs(axis)))]) / np.linalg.norm(axis)
    return (
        f"{np.rad2deg(by):+.3g} degrees about {axis_in_words(axis)}"
        if turns
        else f"{1e3 * by:+.3g} mm along {axis_in_words(axis)}"
    )
