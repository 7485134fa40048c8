"""Stability of the undeformed configuration under preload, heat, assembly error or loads.

Where it is unstable, several minima are near, and the answer names the one that was reached.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ksd.answers.derived import cached_per_model
from ksd.answers.printing import axis_in_words, describe_node_motion, name_of_node, node_travel
from ksd.answers.tangent import assemble_tangent, row_gradients
from ksd.model.arrays import State, make_workspace
from ksd.model.compile import Model
from ksd.model.newton import RTOL, solve_equilibrium
from ksd.model.springs import is_preloaded
from ksd.numerics.rotations import rotation_log
from ksd.solvers.steps import EITHER_SIDE, MAX_TURN_PER_STEP, Stop

Array = NDArray[np.float64]
ROUNDING_TOLERANCE = 1e-9
"""Stiffness relative to the largest one below which it is rounding."""
MAX_ITERATIONS = 10
"""Newton steps from the undeformed configuration to the equilibrium next to it, whether a minimum or not."""
MAX_DISPLACEMENT = 0.05
"""Displacement over the size of the mechanism up to which an equilibrium is next to the undeformed configuration."""


@dataclass(frozen=True)
class UndeformedInstability:
    """The equilibrium next to the undeformed configuration, where it is no minimum.

    causes: preload, heat, ... in words; count: number of unstable directions; shape (nodes, 6) [m, rad]: that of the most
    negative stiffness, zeros where it is within leaf springs.
    """

    causes: tuple[str, ...]
    motion: State
    count: int
    shape: Array


@cached_per_model
def undeformed_instability(model: Model) -> tuple[UndeformedInstability, ...]:
    """The unstable equilibrium at zero drive values under preload, heat and assembly error, or else under loads too.

    A tuple of one; empty where both equilibria are stable, and where the scene has none of these.
    """
    inner, loads = strain_causes(model)
    found = _instability(model, inner, 0.0) if inner else ()
    return found or (_instability(model, (*inner, *loads), 1.0) if loads and model.conservative else ())


def _instability(model: Model, causes: tuple[str, ...], factor: float) -> tuple[UndeformedInstability, ...]:
    """See `undeformed_instability`; factor: of the loads."""
    motion, target = model.rest.copy(), np.zeros(len(model.arrays.terms.start))
    stop, *_ = solve_equilibrium(
        model.arrays,
        motion,
        target,
        factor,
        make_workspace(model.arrays),
        RTOL,
        MAX_ITERATIONS,
        MAX_TURN_PER_STEP,
        math.inf,
    )
    moved = np.abs(motion.x - model.rest.x).max(initial=0.0)
    if Stop(stop) is not Stop.CONVERGED or not moved < MAX_DISPLACEMENT * model.arrays.size:
        return ()
    count, shape = unstable_shape(model, motion, factor)
    return (UndeformedInstability(causes, motion, count, shape),) if count else ()


def unstable_shape(model: Model, motion: State, factor: float) -> tuple[int, Array]:
    """Number of unstable directions at a load factor, drives held, and the shape (nodes, 6) [m, rad] of the most negative
    stiffness, its largest component positive; zeros where that is within leaf springs."""
    tangent = assemble_tangent(model, motion, load_factor=factor)
    starts = model.arrays.start[1:]
    scale = np.array([1.0] * 3 + [1.0 / model.arrays.size] * 3)
    moves = (starts[:, None] + np.arange(6)).ravel()
    scales = np.tile(scale, len(starts))[:, None]
    rows = scales * row_gradients(model.arrays, motion, range(len(model.arrays.terms.start)))[moves]
    _, size, axes = np.linalg.svd(rows.T)
    free = scales * axes[int(np.sum(size > ROUNDING_TOLERANCE * size.max(initial=0.0))) :].T
    value, vector = np.linalg.eigh(free.T @ tangent.matrix()[np.ix_(moves, moves)] @ free)
    count = tangent.inner_negatives + int(
        np.sum(value < -ROUNDING_TOLERANCE * np.abs(value).max(initial=0.0))
    )
    if not count or value.min(initial=0.0) >= 0.0:
        return count, np.zeros((len(starts) + 1, 6))
    shape = free @ vector[:, 0]
    shape *= np.sign(shape[np.argmax(np.abs(shape / scales[:, 0]))])
    return count, np.vstack([np.zeros((1, 6)), shape.reshape(-1, 6)])


def strain_causes(model: Model) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Causes of strain in the undeformed configuration, in words: internal ones, and loads."""
    scene = model.original_scene
    springs = [n for i, n in enumerate(model.spring_names) if is_preloaded(model.arrays, model.rest, i)]
    stressed = any(f.condition is not None for f in model.scene.leaf_names().values())
    inner = {
        f"the preload of {', '.join(springs)}": springs,
        "heat": stressed and scene.heats,
        f"the assembly error of {', '.join(repr(fit.leaf) for fit in scene.fits)}": stressed and scene.fits,
    }
    loads = {"loads": len(model.arrays.loads.node), "weight": len(model.arrays.weight)}
    return tuple(c for c, there in inner.items() if there), tuple(c for c, there in loads.items() if there)


def multiple_minima_note(model: Model, motion: State, stable: bool) -> str:
    """A sentence on the minima near an unstable undeformed configuration: the cause, and which one `motion` is if it is one.

    stable: whether `motion` is a minimum. Empty where the undeformed configuration is stable.
    """
    for unstable in undeformed_instability(model):
        node = int(np.argmax(node_travel(model, unstable.shape)))
        name, movement = name_of_node(model, node), describe_node_motion(model, unstable.shape[node])
        directions = "one direction" if unstable.count == 1 else f"{unstable.count} directions"
        why = " and ".join(filter(None, [", ".join(unstable.causes[:-1]), unstable.causes[-1]]))
        makes = "make" if len(unstable.causes) > 1 or why == "loads" else "makes"
        where = f"'{name}' {movement}" if movement else "within leaf springs"
        sentence = f"{why} {makes} the undeformed configuration unstable in {directions} ({where}): several minima are near"
        if not stable:
            return f"{sentence}, and this state is between them; {EITHER_SIDE}"
        return f"{sentence}; taken is " + (
            f"the one with '{name}' {_displacement(unstable, motion, node, movement)}"
            if movement
            else "one of them"
        )
    return ""


def _displacement(unstable: UndeformedInstability, motion: State, node: int, movement: str) -> str:
    """Signed displacement of a node from the unstable equilibrium along the unstable direction, in words."""
    moved, axis = motion.x[node] - unstable.motion.x[node], unstable.shape[node, :3]
    turns = movement.startswith("turns")
    if turns:
        moved, axis = np.empty(3), unstable.shape[node, 3:]
        rotation_log(motion.R[node] @ unstable.motion.R[node].T, moved)
    # in the sense in which the axis is written
    by = float(axis @ moved) * np.sign(axis[int(np.argmax(np.abs(axis)))]) / np.linalg.norm(axis)
    return (
        f"{np.rad2deg(by):+.3g} degrees about {axis_in_words(axis)}"
        if turns
        else f"{1e3 * by:+.3g} mm along {axis_in_words(axis)}"
    )
