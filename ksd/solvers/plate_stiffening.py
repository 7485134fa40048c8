"""Plate stiffening of chains and modal bodies, iterated with the solve.

A strain-mode leaf has the energy of curling that is lost at a large curvature inside (`ksd.elements.plate_energy`). A
chain of Appendix A elements and the bodies made of it have bending stiffnesses only, so the secants at the moments of
the state are taken: solve, evaluate the moments, compile again, until they no longer change. The tangent is that at
fixed stiffnesses.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.interpolate import CubicSpline

from ksd.answers.forces import section_forces
from ksd.model.arrays import State
from ksd.model.chosen_effects import with_conditions
from ksd.model.compile import Model, compile_as_is
from ksd.model.leaves import rod_compliances, secant_compliances
from ksd.section.along_leaf import element_points

if TYPE_CHECKING:
    from ksd.solvers.configuration import Configuration

MAX_ROUNDS = 8
"""Rounds at most; the change shrinks at least tenfold in each."""


def secant_model(model: Model, bent: Model, motion: State) -> tuple[Model, float]:
    """`model` with the secants of its plate stiffening at the moments of a state of `bent`, and their largest change.

    bent: the same mechanism, with secants of an earlier state or as `model`.
    """
    forces, before = section_forces(bent, motion), bent.scene.leaf_names()
    conditions, largest = {}, 0.0
    for name, leaf in model.scene.leaf_names().items():
        if leaf.condition is None or leaf.condition.plate is None:
            continue
        plate = leaf.condition.plate
        edges = np.array(plate.edges)
        s = (edges[:-1, None] + np.diff(edges)[:, None] * element_points()[0]).ravel()
        at, first = np.unique(forces[name].s / forces[name].s[-1], return_index=True)
        moments = CubicSpline(at, forces[name].values[first, 5])(s)
        own = np.zeros(len(s)) if leaf.curve is None else leaf.curve.curvatures(s)[:, 2]
        small = rod_compliances(leaf, model.mesh, s)[0][2]
        ratio = secant_compliances(leaf, s, moments, small, own) / small
        values = np.concatenate([plate(s).compliance * ratio, np.zeros(2 * len(s))])
        secant = replace(plate, values=tuple(values.tolist()))
        change = values[: len(s)] / before[name].condition.plate(s).compliance - 1.0
        largest = max(largest, float(np.abs(change).max()))
        conditions[name] = replace(leaf.condition, plate=secant)
    scene = with_conditions(model.scene, conditions)
    return compile_as_is(scene, model.mesh, model.original_scene, model.choice), largest


def solve_with_secants(
    solver: Any, solve: Callable[[Any], Configuration], bound: float, *, modal: bool
) -> tuple[Configuration, Any]:
    """The result of `solve(solver)` with the secants of plate stiffening at its own state, and the solver that gave it.

    bound: relative change of the compliances up to which they are converged. modal: leaves become modal bodies. A model of
    strain-mode leaves, or without plate stiffening, is solved once; `solver` is not changed.
    """
    found, own = solve(solver), solver
    if not solver.model.mesh.plate or (not modal and solver.model.has_strain_leaves_only):
        return found, own
    for _ in range(MAX_ROUNDS):
        model, change = secant_model(solver.model, *found.unreduced_state)
        if change <= bound:
            break
        own = solver.of(model)
        found = solve(own)
    return found, own
