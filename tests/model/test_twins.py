"""Leaf springs in the same state are worked on once: that must not show in any number."""

import numpy as np
import pytest
from scenes import fourbar

import ksd
from ksd.model.arrays import make_workspace
from ksd.model.newton import assemble, take_newton_step
from ksd.solvers.five_steps import condense_joint_bodies, set_linearisation_point

MESHES = {"strain": ksd.Mesh(), "chain": ksd.Mesh("corotational", elements=3)}
SLIGHT = 1e-14


@pytest.mark.parametrize("gravity", [None, (0.0, -9.81, 0.0)], ids=["light", "heavy"])
@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_tangent_residual_and_step_are_those_of_leaves_worked_on_one_by_one(mesh, gravity):
    """The outer leaf springs of a cross flexure in its plane; a node 1e-14 rad out of it, and each is worked on."""
    scene = fourbar()
    if gravity:
        scene.gravity = gravity
    model = ksd.compile_scene(scene, mesh=mesh)
    assert bool(len(model.arrays.weight)) == bool(gravity)
    begin = ksd.solve(model, top=0.2, method="conventional").motion
    found, inner = [], []
    for tilt in (0.0, SLIGHT):
        motion, work = begin.copy(), make_workspace(model.arrays)
        # out of balance, in the plane
        motion.x[2] += (1e-4, -2e-4, 0.0)
        motion.R[1, 0, 2], motion.R[1, 2, 0] = motion.R[1, 0, 2] + tilt, motion.R[1, 2, 0] - tilt
        target = model.targets({"top": 0.21})
        assemble(model.arrays, motion, target, 1.0, work, 1e-8, 0, 10.0)
        found.append((work.matrix.copy(), work.rhs.copy(), work.store.copy()))
        take_newton_step(model.arrays, motion, target, 1.0, work)
        inner.append(motion.inner.copy())
    once, each = found
    scale = np.abs(each[0]).max()
    assert np.abs(once[0] - each[0]).max() < 1e-11 * scale
    assert np.abs(once[1] - each[1]).max() < 1e-8 * np.abs(each[1]).max()
    assert inner[0] == pytest.approx(inner[1], rel=1e-8, abs=1e-9 * np.abs(inner[1]).max())
    members = model.arrays.members
    one, two = (slice(members.inner_at[i], members.inner_at[i + 1]) for i in (1, 2))
    assert np.array_equal(inner[0][one], inner[0][two]), "twins stay twins"


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
def test_condensed_joints_are_those_of_leaves_worked_on_one_by_one(mesh):
    """Step 2 near the intended motion, where the inner nodes of a chain are set as well."""
    steps = ksd.prepare(fourbar(), mesh=mesh, planar=False)
    steps(top=0.25, method="reduced", estimate=False)
    storage = steps.five_steps.storage
    b, state, work = storage.bodies, storage.substructure_state, storage.substructure_work
    given = b.substructures.members
    found = []
    for change in (0.0, SLIGHT):
        state.assign(b.substructure_rest)
        set_linearisation_point(storage)
        if mesh.leaf == "strain":
            state.inner[given.inner_at[2]] += change
        else:
            work.linearisation[work.linearisation_at[2]] += change
        storage.reduced_state.inner[:] = 0.0
        condense_joint_bodies(storage, 1)
        found.append((storage.reduced_state.inner.copy(), state.inner.copy()))
    (once, inside), (each, other) = found
    assert once == pytest.approx(each, rel=1e-9, abs=1e-10 * np.abs(each).max())
    assert inside == pytest.approx(other, rel=1e-9, abs=1e-12 * np.abs(other).max())
