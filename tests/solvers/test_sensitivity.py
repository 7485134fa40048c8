"""Answers as functions of a load: against the answers under that load, and reciprocity."""

import numpy as np
import pytest
from scenes import STEEL, cross_flexure, fourbar

import ksd
from ksd.errors import KinematicsError, SceneError

POINT = (0.0, 0.3 + cross_flexure().length_AB, 0.0)


@pytest.fixture(scope="module")
def pose():
    return ksd.solve(fourbar(), top=0.2, method="full")


def asked(pose):
    """Drive force [N], drive stiffness [N/m], first frequency [Hz], largest stress [Pa], energy [J]."""
    return {
        "force": pose.forces["top"],
        "stiffness": pose.drive_stiffness()["top"],
        "frequency": pose.frequencies(count=1, freed=("top",)).frequency_Hz[0],
        "stress": pose.stress().largest_Pa,
        "buckling": pose.buckling().negative,
    }


def test_against_the_answers_under_a_small_load(pose):
    load = {"force": (0.0, -4.0, 0.5), "at": POINT}
    slope = pose.sensitivity(asked, "top", **load)
    scenes = []
    for sign in (0.5, -0.5):
        scene = fourbar()
        scene.load("top", force=tuple(sign * f for f in load["force"]), at=POINT)
        scenes.append(asked(ksd.solve(scene, top=0.2, method="full")))
    for name, value in slope.items():
        # multipliers are told to their sixth digit, their slopes to less
        off = 5e-2 if name == "buckling" else 2e-3
        assert value == pytest.approx(scenes[0][name] - scenes[1][name], rel=off), name


def test_reciprocity(pose):
    """What a load changes in the drive force is minus what the drive moves the loaded point."""
    slope = pose.sensitivity(lambda p: p.forces["top"], "left", force=(0, 1, 0), at=(-0.2, 0.2, 0.0))
    from ksd.answers.stiffness import drive_coupling

    moved = drive_coupling(pose.model, pose.motion, "left", at=(-0.2, 0.2, 0.0))["top"]
    assert slope == pytest.approx(-moved[1], rel=1e-5)


def test_arrays_and_wrong_words(pose):
    turned = pose.sensitivity(lambda p: p.rotation("top"), "top", moment=(0, 0, 0.1), at=POINT)
    assert isinstance(turned, np.ndarray) and turned[2] > 0
    with pytest.raises(SceneError, match="link 'roof' is not part"):
        pose.sensitivity(lambda p: 0.0, "roof", force=(0, 1, 0), at=POINT)
    with pytest.raises(SceneError, match="not zero"):
        pose.sensitivity(lambda p: 0.0, "top", at=POINT)


def test_a_load_too_small_to_be_told_from_rounding_is_refused(pose):
    """The slope is linear in the load: a thousandth of a newton keeps five digits, a millionth none."""
    slopes = [
        pose.sensitivity(lambda p: p.forces["top"], "top", force=(0, f, 0), at=POINT) / f for f in (1.0, 1e-3)
    ]
    assert slopes[1] == pytest.approx(slopes[0], rel=1e-6)
    with pytest.raises(KinematicsError, match="fewer than four digits"):
        pose.sensitivity(lambda p: p.forces["top"], "top", force=(0, 1e-6, 0), at=POINT)


def test_a_load_on_a_held_direction_is_not_refused(pose):
    """The drive takes all of it: nothing moves, and the answer is exact."""
    slope = pose.sensitivity(lambda p: p.forces["top"], "top", force=(1.0, 0, 0), at=POINT)
    assert slope == pytest.approx(-1.0, rel=1e-9)


def test_a_state_under_part_of_its_loads_keeps_that_part():
    """What a load along a leaf does to its softness depends on how much of it acts."""
    scene = ksd.Mechanism("cantilever")
    tip = scene.link("tip")
    section = ksd.rectangle(0.5e-3, 0.02)
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=section, material=STEEL, width_axis="z"
    )
    scene.load(tip, at=(0.1, 0, 0), force=(-30.0, 0, 0))
    state = ksd.follow(scene, until=0.4).states[-1]
    assert state.load_factor == pytest.approx(0.4)
    push = {"force": (0, 1e-2, 0), "at": (0.1, 0, 0)}
    moved = state.sensitivity(lambda p: p.displacement("tip")[1], "tip", **push)
    assert moved == pytest.approx(1e-2 * state.stiffness("tip", at=(0.1, 0, 0)).compliance[1, 1], rel=1e-4)
