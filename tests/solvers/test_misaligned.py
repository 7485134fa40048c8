"""Overconstrained mechanisms with joints not aligned: loops close in the least-squares sense, leaves take up the rest."""

import numpy as np
import pytest
from scenes import STEEL, cross_flexure, fourbar, single_joint
from scipy.spatial.transform import Rotation

import ksd
from ksd.solvers.solver import Solver

GUIDE = ksd.ParallelGuide(STEEL, length=0.1, thickness=0.5e-3, width=0.03, spacing=0.06)


def turned(rng, size):
    """Axes turned by `size` rad about a random direction."""
    v = rng.normal(size=3)
    return Rotation.from_rotvec(size * v / np.linalg.norm(v)).as_matrix()


def loop(rng, size):
    """The fourbar with every joint turned at random."""
    joint, scene = cross_flexure(), ksd.Mechanism("fourbar")
    left, top, right = scene.links("left", "top", "right")
    places = ((scene.ground, left, -0.2, 0), (left, top, -0.2, 0.3), (right, top, 0.2, 0.3))
    for a, b, x, y in (*places, (scene.ground, right, 0.2, 0)):
        T = turned(rng, size)
        scene.join(a, b, joint, at=(x, y, 0), axis=tuple(T[:, 2]), toward=tuple(T[:, 1]))
    scene.actuate(top, along="x", at=(0, 0.3 + joint.length_AB, 0), name="drive")
    return scene, 0.3


def door(rng, size):
    """A door on two hinges."""
    scene = ksd.Mechanism("door")
    leaf = scene.link("door")
    for z in (-0.2, 0.2):
        T = turned(rng, size)
        scene.join(
            scene.ground, leaf, cross_flexure(), at=(0, 0, z), axis=tuple(T[:, 2]), toward=tuple(T[:, 1])
        )
    scene.actuate(leaf, about="z", name="drive")
    return scene, 0.7


def guides(rng, size):
    """A stage on two guides."""
    scene = ksd.Mechanism("guides")
    stage = scene.link("stage")
    for y in (0.0, 0.2):
        T = turned(rng, size)
        scene.join(scene.ground, stage, GUIDE, at=(0, y, 0), axis=tuple(T[:, 2]), toward=tuple(T[:, 0]))
    scene.actuate(stage, along="y", at=(0.1, 0.1, 0), name="drive")
    return scene, 0.01


@pytest.mark.parametrize("size", [1e-3, 1e-2])
@pytest.mark.parametrize("made", [loop, door, guides])
def test_the_five_steps_solve_misaligned_loops(made, size, rng):
    scene, d = made(rng, size)
    solver = Solver(scene)
    exact = solver(drive=d, method="conventional")
    full = solver(drive=d, method="full")
    assert full.forces["drive"] == pytest.approx(exact.forces["drive"], rel=1e-8)
    assert full.motion.x == pytest.approx(exact.motion.x, abs=1e-9)
    assert 0.1 * size < solver.five_steps.compatibility.misalignment < 2 * size
    assert any("overconstrained and misaligned" in w and "gap" in w for w in full.warnings)
    for method, relinearisations in (("kinematic", 0), ("reduced", 0), ("reduced", 1)):
        fast = solver(drive=d, method=method, relinearisations=relinearisations)
        off = abs(fast.forces["drive"] / exact.forces["drive"] - 1)
        assert off < 1.2 * fast.error.relative + 1e-8
        assert fast.error.relative < 0.1


def test_aligned_loops_fit_exactly():
    fit = Solver(fourbar()).five_steps.compatibility
    assert fit.is_exact and fit.misalignment == 0.0 and not fit.unmet_drives


def test_a_drive_that_only_elasticity_meets():
    """A hinge tilted by 10 mrad about an axis across its own."""
    scene = single_joint()
    scene.actuate("tip", about="x", name="tilt")
    solver = ksd.prepare(scene)
    exact, full, fast = (solver(turn=0.8, tilt=0.01, method=m) for m in ("conventional", "full", "reduced"))
    assert solver.five_steps.compatibility.unmet_drives == ("tilt",)
    for name in ("turn", "tilt"):
        assert full.forces[name] == pytest.approx(exact.forces[name], rel=1e-7)
        assert fast.forces[name] == pytest.approx(exact.forces[name], rel=5e-3)
    with pytest.raises(ksd.KinematicsError, match="knows no force of 'tilt'"):
        solver(turn=0.8, tilt=0.01, method="kinematic")
    with pytest.raises(ksd.ConvergenceError, match="cannot reach this pose"):
        solver(turn=0.8, tilt=0.1, method="full")


def test_batches_of_misaligned_designs():
    made = [loop(np.random.default_rng(k), 5e-3)[0] for k in range(2)]
    found = ksd.batch(lambda k: made[k], designs=[{"k": 0}, {"k": 1}], drive=[0.1], method="full", threads=1)
    for k in range(2):
        exact = ksd.solve(made[k], drive=0.1, method="conventional")
        assert found.forces["drive"][k, 0] == pytest.approx(exact.forces["drive"], rel=1e-8)
