"""The five steps in one compiled call: batches are single solves, tables are close."""

import numpy as np
import pytest
from scenes import cross_flexure, fourbar, single_joint

import ksd
from ksd.model.mesh import Mesh
from ksd.solvers.pose_batch import LOCKED, OUT_OF_RANGE
from ksd.study.batch import NOT_BUILT
from ksd.study.prepared_design import PreparedDesign
from ksd.units import deg

MESHES = {"strain": Mesh(), "chain": Mesh("corotational", elements=3)}


def test_batch_is_what_single_solves_are():
    tops = np.array([0.0, 0.12, 0.3])
    solver = ksd.prepare(fourbar())
    for options in ({}, {"relinearisations": 1}, {"method": "full"}):
        found = ksd.batch(fourbar(), top=tops, **options)
        ways = {"method": "reduced", "estimate": False} | options
        for n, top in enumerate(tops):
            single = solver(top=top, **ways)
            assert found.forces["top"][0, n] == pytest.approx(single.forces["top"], rel=1e-8, abs=1e-9)
            assert found.positions[0, n] == pytest.approx(single.motion.x[:4], abs=1e-10)
            assert found.rotations[0, n] == pytest.approx(single.motion.R[:4], abs=1e-10)
            assert found.motions["lower left"][0, n] == pytest.approx(single.motions["lower left"], abs=1e-9)
    assert found.solved == 3 and not found.failures


def test_batch_says_of_every_configuration_what_became_of_it():
    def design(thickness, angle):
        return fourbar(joint=cross_flexure(thickness=thickness, angle=angle))

    good, bad = {"thickness": 1e-3, "angle": 45 * deg}, {"thickness": 1e-3, "angle": 5 * deg}
    found = ksd.batch(design, designs=[good, bad, good], top=[0.1, 0.36, 0.9], threads=2)
    assert found.status[0].tolist() == [0, LOCKED, LOCKED]
    assert ksd.batch(single_joint(), turn=[0.2, 80 * deg]).status.tolist() == [[0, OUT_OF_RANGE]]
    assert (found.status[1] == NOT_BUILT).all() and "angle" in found.why(1, 0)
    assert np.isnan(found.forces["top"][found.status != 0]).all()
    assert np.isfinite(found.forces["top"][found.status == 0]).all()
    assert len(found.failures) == 7 and found.solved == 2
    assert "design 0, pose 1" in str(found)
    for words, options in (("method", {"method": "kinematic"}), ("drive values", {"top": [[1.0]]})):
        with pytest.raises(ksd.SceneError, match=words):
            ksd.batch(fourbar(), **({"top": 0.1} | options))


def test_tabulated_joints_are_as_close_as_they_say():
    tops = np.linspace(-0.25, 0.3, 12)
    exact, near = (ksd.batch(fourbar(), top=tops, tabulated=t) for t in (False, True))
    assert 0 < near.errors[0] <= 1e-6
    off = np.abs(near.forces["top"] - exact.forces["top"]).max() / np.abs(exact.forces["top"]).max()
    assert off <= 30 * near.errors[0]
    assert near.status.tolist() == exact.status.tolist()


def test_tabulated_poses_do_not_depend_on_those_before_them(rng):
    """To and fro, with jumps and poses nobody reaches in between: each is what it is on its own."""
    fine = np.linspace(0.05, 0.3, 40)
    tops = np.concatenate(
        [fine, fine[::-1], [0.9, -0.2, 0.29, 0.9, 0.9], fine[:7], rng.permutation(fine), [0.1, 0.1]]
    )
    design = PreparedDesign(ksd.prepare(fourbar()).five_steps, tabulated=True)
    along = design({"top": tops})
    assert (along.status != 0).sum() == 3
    for n, top in enumerate(tops):
        alone = design({"top": np.array([top])})
        assert along.status[n] == alone.status[0]
        if alone.status[0] == 0:
            assert along.force[n] == pytest.approx(alone.force[0], rel=1e-7, abs=1e-7)
            assert along.x[n] == pytest.approx(alone.x[0], abs=1e-9)


@pytest.mark.parametrize("more", [0, 1])
def test_every_step_is_written_down(more):
    pose = ksd.solve(fourbar(), top=0.1, method="reduced", relinearisations=more)
    again = ["2 joint stiffness", "3 reduced equilibrium", "4 recovery"] * (1 + more)
    assert [step.name for step in pose.steps] == ["1 close loops", *again, "error estimate"]
    assert len(pose.steps) == 5 + 3 * more and pose.steps[-1].name == "error estimate"
