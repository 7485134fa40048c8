"""Newton stops when its answer no longer changes: taut leaf springs, whose stiffness turns tiny steps into forces."""

import numpy as np
import pytest

import ksd
from ksd.model.mesh import Mesh
from ksd.model.newton import STALLED_RATIO, STALLED_RESIDUAL_LIMIT, has_converged
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.steps import Step, Stop


def taut(slenderness, mesh):
    m = ksd.Mechanism("taut")
    tip = m.link("tip")
    m.leaf(
        m.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(0.1 / slenderness, 0.02),
        material=ksd.Material(200e9, nu=0.3), width_axis="z", name="leaf",
    )  # fmt: skip
    m.actuate(tip, along="y", at=(0.1, 0, 0), name="drive")
    m.support(tip, along="x", at=(0.1, 0, 0))
    m.support(tip, about="z")
    return ksd.compile_scene(m.scene(), mesh=mesh)


@pytest.mark.parametrize("planar", [True, False])
@pytest.mark.parametrize("mesh", [Mesh(), Mesh(leaf="corotational", elements=8)])
def test_one_more_step_changes_no_force(mesh, planar):
    moved, residuals = [], []
    for slenderness in (40.0, 230.0):
        model = taut(slenderness, mesh)
        for way in np.geomspace(1e-4, 3e-3, 9):
            pose = solve_conventional(model, {"drive": way}, planar=planar)
            again = solve_conventional(model, {"drive": way}, start=pose, planar=planar)
            moved.append(abs(again.forces["drive"] / pose.forces["drive"] - 1))
            residuals.append(pose.steps[-1].residual)
    assert max(moved) < 1e-8
    assert max(residuals) < 1.0


def test_a_residual_beyond_its_bound_is_not_said_to_be_within():
    within = Step("equilibrium", 3, 0.0, 0.5, Stop.CONVERGED)
    beyond = Step("equilibrium", 3, 0.0, 465.0, Stop.CONVERGED)
    assert "within its bound" in within.reason
    assert (
        "within its bound" not in beyond.reason and "465" not in within.reason and "4.6e+02" in beyond.reason
    )


def test_a_loose_residual_is_taken_where_steps_no_longer_lower_it():
    assert has_converged(0.9, 1e9, np.inf)
    assert not has_converged(2.0, np.inf, np.inf) and not has_converged(2.0, 1e9, 0.5)
    assert has_converged(2.0, 1.9 / STALLED_RATIO, 0.5) and not has_converged(2.0, 1.9 / STALLED_RATIO, 1.5)
    assert not has_converged(2.0, 1e9, 0.0) and not has_converged(
        1.1 * STALLED_RESIDUAL_LIMIT, 2.0 * STALLED_RESIDUAL_LIMIT, 0.0
    )
