"""Whether preload, heat, assembly error or loads make the undeformed state unstable: then several minima are near, and
which is taken."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ksd.model.arrays import COIL, TURN, Motion, make_work
from ksd.model.compile import Model
from ksd.model.newton import iterate
from ksd.numerics.rotations import rotation_log
from ksd.properties.cache import cached_per_model
from ksd.properties.forces import energy_of_one_spring
from ksd.properties.printing import axis_in_words, describe_node_motion, node_travel
from ksd.properties.tangent import assemble_tangent, row_gradients
from ksd.solve.steps import MAX_TURN_PER_STEP, RTOL, Stop

Array = NDArray[np.float64]
FREE = 1e-15
"""Energy of a spring, over its stiffness (and the size squared, of a coil spring), up to which it is free of force."""
NEGATIVE = 1e-9
"""Negative stiffness, over the largest one, that is no rounding."""
PASSES = 10
"""Newton steps from the undeformed configuration to the equilibrium next to it, minimum or not."""
NEXT = 0.05
"""Displacement of a link, over the size of the mechanism, up to which an equilibrium is next to the undeformed one."""


@dataclass(frozen=True)
class UndeformedInstability:
    """The equilibrium next to the undeformed configuration, where it is no minimum: causes, in words: what of the scene
    strains it; count: its unstable directions; shape (nodes, 6) [m, rad]: the one of the most negative stiffness."""

    causes: tuple[str, ...]
    motion: Motion
    count: int
    shape: Array


@cached_per_model
def undeformed_instability(model: Model) -> tuple[UndeformedInstability, ...]:
    """The equilibrium, drives at zero, under preload, heat, assembly error, where unstable, or else under loads too, where
    that is: one, or none."""
    inner, loads = _causes(model)
    found = _unstable(model, inner, 0.0) if inner else ()
    return found or (_unstable(model, (*inner, *loads), 1.0) if loads and model.conservative else ())


def _unstable(model: Model, causes: tuple[str, ...], factor: float) -> tuple[UndeformedInstability, ...]:
    """See `undeformed_instability`; loads times factor."""
    motion, held = model.rest.copy(), np.zeros(len(model.arrays.terms.start))
    stop, *_ = iterate(
        model.arrays, motion, held, factor, make_work(model.arrays), RTOL, PASSES, MAX_TURN_PER_STEP, math.inf
    )
    moved = np.abs(motion.x - model.rest.x).max(initial=0.0)
    if Stop(stop) is not Stop.CONVERGED or not moved < NEXT * model.arrays.size:
        return ()
    tangent = assemble_tangent(model, motion, load_factor=factor)
    starts = model.arrays.start[1:]
    scale = np.array([1.0] * 3 + [1.0 / model.arrays.size] * 3)
    moves = (starts[:, None] + np.arange(6)).ravel()
    scales = np.tile(scale, len(starts))[:, None]
    rows = scales * row_gradients(model.arrays, motion, range(len(model.arrays.terms.start)))[moves]
    _, size, axes = np.linalg.svd(rows.T)
    free = scales * axes[int(np.sum(size > NEGATIVE * size.max(initial=0.0))) :].T
    value, vector = np.linalg.eigh(free.T @ tangent.matrix()[np.ix_(moves, moves)] @ free)
    count = tangent.inside + int(np.sum(value < -NEGATIVE * np.abs(value).max(initial=0.0)))
    if not count:
        return ()
    still = value.min(initial=0.0) >= 0.0
    shape = np.zeros((len(starts), 6)) if still else (free @ vector[:, 0]).reshape(-1, 6)
    return (UndeformedInstability(causes, motion, count, np.vstack([np.zeros((1, 6)), shape])),)


def _causes(model: Model) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What of the scene strains the undeformed configuration, in words: what is inside it, and loads."""
    springs, said = _preloaded(model), model.said or model.scene
    stressed = any(f.condition is not None for f in model.scene.leaf_names().values())
    inner = {
        f"the preload of {', '.join(springs)}": springs,
        "heat": stressed and said.heats,
        f"the fit of {', '.join(repr(fit.leaf) for fit in said.fits)}": stressed and said.fits,
    }
    loads = {"loads": len(model.arrays.loads.node), "weight": len(model.arrays.weight)}
    return tuple(c for c, there in inner.items() if there), tuple(c for c, there in loads.items() if there)


def _preloaded(model: Model) -> tuple[str, ...]:
    """Springs that exert a force in the undeformed configuration."""
    springs = model.arrays.springs
    found = []
    for i, name in enumerate(model.spring_names):
        unit = {COIL: model.arrays.size**2, TURN: 1.0}.get(int(springs.kind[i]))
        stiffness = float(springs.value[springs.value_at[i]])
        if unit is not None and energy_of_one_spring(model, model.rest, i) > FREE * stiffness * unit:
            found.append(name)
    return tuple(found)


def multiple_minima_note(model: Model, motion: Motion, stable: bool) -> str:
    """That several minima are near because the undeformed configuration is unstable, why, and which one `motion` is where
    it is one, in one sentence; nothing where the undeformed configuration is stable."""
    for rest in undeformed_instability(model):
        node = int(np.argmax(node_travel(model, rest.shape)))
        name, does = model.node_names[node], describe_node_motion(model, rest.shape[node])
        many = "one direction" if rest.count == 1 else f"{rest.count} directions"
        why = " and ".join(filter(None, [", ".join(rest.causes[:-1]), rest.causes[-1]]))
        makes = "make" if len(rest.causes) > 1 or why == "loads" else "makes"
        where = f"'{name}' {does}" if does else "within leaf springs"
        said = f"{why} {makes} the undeformed configuration unstable in {many} ({where}): several minima are near"
        if not stable:
            return f"{said}, and this state is between them; a load or another path leads to one (ksd.follow)"
        return f"{said}; taken is " + (
            f"the one with '{name}' {_way(rest, motion, node, does)}" if does else "one of them"
        )
    return ""


def _way(rest: UndeformedInstability, motion: Motion, node: int, does: str) -> str:
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
