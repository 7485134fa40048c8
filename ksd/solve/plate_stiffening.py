"""Plate stiffening iterated with the solve: the coefficient of a wide leaf depends on how much it is bent.

One coefficient per leaf, taken at the root mean square of its elastic curvature about e3: solve, evaluate the curvatures,
compile again with the plate factors at these, until the factors no longer change. A factor is between 1 and 1/(1 - nu^2), so
that two or three rounds suffice. The tangent of the result is that at fixed factors.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from scipy.integrate import trapezoid

from ksd.model.arrays import State
from ksd.model.compile import Model, compile_as_is
from ksd.model.effects import with_conditions
from ksd.model.leaves import rigidities
from ksd.properties.cache import cached_per_model
from ksd.properties.forces import section_forces
from ksd.scene.leaf import LeafCondition
from ksd.section.plate import plate_factor

if TYPE_CHECKING:
    from ksd.solve.configuration import Configuration

MOMENT_STATIONS = 9
"""Stations along a leaf at which its moment is evaluated."""
MAX_ROUNDS = 8
"""Rounds at most; the change shrinks at least tenfold in each."""


def rms_curvatures(model: Model, motion: State) -> dict[str, float]:
    """Root mean square of M / (E Iz), the elastic curvature about e3 [1/m], of every leaf by full name."""
    stiffness, curvatures = _bending_stiffness(model), {}
    for name, forces in section_forces(model, motion, points=MOMENT_STATIONS).items():
        square = trapezoid(forces.values[:, 5] ** 2, forces.s) / forces.s[-1]
        curvatures[name] = math.sqrt(float(square)) / stiffness[name]
    return curvatures


@cached_per_model
def _leaves(model: Model) -> dict[str, Any]:
    """All leaf springs by full name, with their conditions."""
    return dict(model.scene.leaf_names())


@cached_per_model
def _bending_stiffness(model: Model) -> dict[str, float]:
    """E Iz [N m^2] of every leaf, plate factor included."""
    return {
        name: float(rigidities(leaf.section, leaf, model.mesh)[0][2]) for name, leaf in _leaves(model).items()
    }


def plate_conditions(model: Model, motion: State) -> tuple[dict[str, LeafCondition], float]:
    """Conditions of all wide leaf springs at their present curvatures, and the largest relative change of their factors."""
    curvatures = rms_curvatures(model, motion)
    conditions, largest = {}, 0.0
    for name, leaf in _leaves(model).items():
        q = leaf.section
        if not (q.width > q.thickness > 0.0 and name in curvatures):
            continue
        state = leaf.condition or LeafCondition()
        factors = [
            plate_factor(q.width, q.thickness, b, leaf.material.nu)
            for b in (state.plate_curvature, curvatures[name])
        ]
        largest = max(largest, abs(factors[1] / factors[0] - 1.0))
        conditions[name] = replace(state, plate_curvature=curvatures[name])
    return conditions, largest


def solve_with_plate_factors(
    solver: Any, solve: Callable[[Any], Configuration], bound: float
) -> tuple[Configuration, Any]:
    """The result of `solve(solver)` with converged plate factors, and the solver that gave it.

    bound: relative change of the factors up to which they are converged. Every round makes a solver of its own: `solver` is
    not changed, and no result depends on earlier ones. A model without plate stiffening is solved once.
    """
    found = solve(solver)
    if not solver.model.mesh.plate:
        return found, solver
    for _ in range(MAX_ROUNDS):
        conditions, change = plate_conditions(*found.unreduced_state)
        if change <= bound:
            break
        model = solver.model
        scene = with_conditions(model.scene, conditions)
        solver = solver.of(compile_as_is(scene, model.mesh, model.original_scene, model.choice))
        found = solve(solver)
    return found, solver
