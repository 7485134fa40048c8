"""Plate stiffening settled with the answer: the coefficient of a wide leaf depends on how much it is bent.

One coefficient per leaf, taken at the root mean square of its elastic curvature about e3: solve, take the curvatures,
compile again with the factors that belong to them, until these no longer change. The factor lies between 1 and
1/(1 - nu^2), so two or three rounds do. The tangent of the answer is that at fixed factors.
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

POINTS = 9
"""Stations along a leaf at which its moment is taken."""
MOST = 8
"""Rounds; the change shrinks at least tenfold in each."""


def rms_curvatures(model: Model, motion: State) -> dict[str, float]:
    """Root mean square of M / (E Iz), the elastic curvature about e3 [1/m], of every leaf by full name."""
    stiff, found = _bending_stiffness(model), {}
    for name, forces in section_forces(model, motion, points=POINTS).items():
        square = trapezoid(forces.values[:, 5] ** 2, forces.s) / forces.s[-1]
        found[name] = math.sqrt(float(square)) / stiff[name]
    return found


@cached_per_model
def _leaves(model: Model) -> dict[str, Any]:
    """All leaf springs by full name, with their conditions."""
    return dict(model.scene.leaf_names())


@cached_per_model
def _bending_stiffness(model: Model) -> dict[str, float]:
    """E Iz [N m^2] of every leaf, with its factor."""
    return {
        name: float(rigidities(leaf.section, leaf, model.mesh)[0][2]) for name, leaf in _leaves(model).items()
    }


def plate_conditions(model: Model, motion: State) -> tuple[dict[str, LeafCondition], float]:
    """Conditions of all wide leaf springs at their present curvature, and the largest relative change of their factors."""
    known = rms_curvatures(model, motion)
    conditions, worst = {}, 0.0
    for name, leaf in _leaves(model).items():
        q = leaf.section
        if not (q.width > q.thickness > 0.0 and name in known):
            continue
        state = leaf.condition or LeafCondition()
        factors = [
            plate_factor(q.width, q.thickness, b, leaf.material.nu)
            for b in (state.plate_curvature, known[name])
        ]
        worst = max(worst, abs(factors[1] / factors[0] - 1.0))
        conditions[name] = replace(state, plate_curvature=known[name])
    return conditions, worst


def solve_with_plate_factors(
    solver: Any, solve: Callable[[Any], Configuration], bound: float
) -> tuple[Configuration, Any]:
    """The answer of `solve(solver)` with plate factors that fit it to `bound`, relative, and the solver that gave it.

    Each round has a solver of its own: what `solver` holds stays as it was made, and no answer depends on those before
    it. A model without plate stiffening is solved once.
    """
    found = solve(solver)
    if not solver.model.mesh.plate:
        return found, solver
    for _ in range(MOST):
        conditions, moved = plate_conditions(*found.unreduced_state)
        if moved <= bound:
            break
        model = solver.model
        scene = with_conditions(model.scene, conditions)
        solver = solver.of(compile_as_is(scene, model.mesh, model.said, model.choice))
        found = solve(solver)
    return found, solver
