"""Open chains of joints with inner blocks: what their tangent answers, against differences of solves and pivoting."""

import numpy as np
import pytest
from random_arms import (
    buckling_error,
    differences,
    frequency_error,
    pivoted_errors,
    random_arm,
    solved,
    stiffness_error,
    three_universal,
)

import ksd
from ksd.answers.stiffness import drive_stiffness
from ksd.answers.tangent import assemble_tangent, factor_tangent
from ksd.errors import KinematicsError

INNER = ("universal", "cartwheel", "butterfly", "infinity_hinge")


@pytest.mark.parametrize("method", ["full", "conventional"])
def test_three_universal_joints_in_series_all_driven(method):
    scene = three_universal()
    found = ksd.solve(scene, {drive.name: 0.0 for drive in scene.scene().drives}, method=method)
    own = np.diagonal(found.drive_stiffness().matrix)
    assert own == pytest.approx(np.diagonal(differences(found, step=1e-3)), rel=1e-6)
    assert own.min() > 0.3


@pytest.mark.parametrize("family", INNER)
def test_arms_of_joints_with_inner_blocks(family, rng):
    arm = random_arm(rng, joints=3, families=(family,), drives="joints")
    found = ksd.solve(arm.scene, arm.targets, method="full")
    assert stiffness_error(found) < 1e-4
    assert max(pivoted_errors(found, arm.tip)) < 1e-6
    assert frequency_error(found) < 1e-6
    assert buckling_error(found) < 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_random_arms_driven_anyhow(seed):
    arm = random_arm(np.random.default_rng(seed), joints=3)
    found = ksd.solve(arm.scene, arm.targets, method="conventional")
    assert max(pivoted_errors(found, arm.tip)) < 1e-6
    assert frequency_error(found) < 1e-6


@pytest.mark.parametrize("mesh", [ksd.Mesh(), ksd.Mesh("corotational", elements=1)])
def test_independent_joints_in_series_are_solved_by_all_methods(mesh):
    rng = np.random.default_rng(7)
    arms = [random_arm(rng, joints=3, families=("universal",), drives="joints") for _ in range(2)]
    for arm in arms:
        for method in ("reduced", "full", "conventional"):
            found = solved(arm.scene, arm.targets, method=method, mesh=mesh)
            assert isinstance(found, ksd.Configuration), found
            assert found.trusted


def test_an_answer_without_digits_is_refused():
    """A factorisation that is not that of its matrix stands for one that lost them."""
    scene = three_universal()
    found = ksd.solve(scene, {drive.name: 0.1 for drive in scene.scene().drives}, method="full")
    tangent = factor_tangent(assemble_tangent(found.model, found.motion))
    tangent.assembled[tangent.arrays.plan.diagonal[0]] *= 3.0
    with pytest.raises(KinematicsError, match="all but singular"):
        drive_stiffness(found.model, found.motion, tangent=tangent)


def test_answers_say_their_backward_error():
    scene = three_universal()
    found = ksd.solve(scene, {drive.name: 0.1 for drive in scene.scene().drives}, method="full")
    answers = [found.stiffness("three"), found.drive_stiffness()]
    assert all(0.0 < answer.backward_error < 1e-9 for answer in answers)


def test_the_part_of_moments_fixed_in_space_is_refined_and_guarded():
    scene = three_universal()
    scene.load("three", moment=(0.3, -0.2, 0.4), at=(0.6, 0, 0))
    found = ksd.solve(scene, {drive.name: 0.2 for drive in scene.scene().drives}, method="conventional")
    assembled = assemble_tangent(found.model, found.motion)
    tangent = factor_tangent(assembled)
    loads = np.zeros((assembled.arrays.plan.unknowns, 6))
    loads[tangent.unknowns(found.model.node_names.index("three"))] = np.eye(6)
    right = tangent.solve(loads)
    K, (places, rest) = assembled.matrix(), assembled.skew
    K[np.ix_(places, places)] += rest
    assert np.abs(K @ right - loads).max() < 1e-9
    X, small = tangent.woodbury
    # a correction that is not that of its matrix stands for one that lost its digits
    tangent.__dict__["woodbury"] = X * (1.0 + 1e-6), small
    again, error = tangent.solve_with_error(loads)
    assert 1e-12 < error < 1e-6
    assert again == pytest.approx(right, rel=1e-12, abs=1e-14 * np.abs(right).max())
    tangent.__dict__["woodbury"] = X * 1.1, small
    with pytest.raises(KinematicsError, match="all but singular"):
        tangent.solve(loads)
