"""Where joints are by their records: derivatives by their motions against differences."""

import numpy as np
import pytest
from scenes import STEEL, cross_flexure

import ksd
from ksd.bodies.joint_poses import joint_poses
from ksd.bodies.joints import joint_bodies
from ksd.library import find_record
from ksd.numerics.rotations import rotation_log


def places(loops, theta):
    """(J, 24)."""
    place, series = np.zeros((len(loops.node), 24)), np.zeros((3, loops.pose.shape[2]))
    joint_poses(*loops.flat, theta, place, series)
    return place


@pytest.mark.parametrize("theta", [(0.2, 0.1, -0.15), (-0.3, 0.0, 0.2), (0.1, -0.2, 0.0)])
def test_derivatives_of_places_are_their_differences(theta):
    """Of a joint that moves in its plane and one with two motions out of it."""
    scene = ksd.Mechanism("two")
    middle, tip = scene.link("middle"), scene.link("tip")
    scene.join(scene.ground, middle, cross_flexure(), at=(0, 0, 0), axis="z", toward="x")
    universal = ksd.UniversalJoint(STEEL, length=0.1, thickness=5e-4, width=0.04)
    scene.join(middle, tip, universal, at=(0.2, 0, 0), axis="z", toward="x")
    loops = joint_bodies(ksd.compile_scene(scene), find_record).kinematics
    assert loops.first.tolist() == [0, 1, 3]
    theta, step, turn = np.array(theta), 1e-5, np.empty(3)
    found = places(loops, theta)
    for j, k, motion in ((0, 0, 0), (1, 0, 1), (1, 1, 2)):
        away = step * np.eye(3)[motion]
        more, less = places(loops, theta + away)[j], places(loops, theta - away)[j]
        rotation_log(more[:9].reshape(3, 3) @ less[:9].reshape(3, 3).T, turn)
        shift = more[9:12] - less[9:12]
        at = 12 + 6 * k
        assert np.linalg.norm(found[j, at : at + 6]) > 0.1
        assert found[j, at : at + 3] == pytest.approx(shift / (2 * step), abs=1e-10)
        assert found[j, at + 3 : at + 6] == pytest.approx(turn / (2 * step), abs=1e-9)
