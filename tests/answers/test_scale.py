"""The same mechanism in metres, millimetres and micrometres: all answers scale."""

from contextlib import nullcontext

import numpy as np
import pytest
from effect_scenes import free_beam
from scenes import STEEL

import ksd
from ksd.answers.parasitic import default_point
from ksd.model.elastic_links import with_elastic_links
from ksd.model.warping_runs import in_line_junctions


def pivot(size):
    """A loaded cross flexure, `size` times the length of one with leaf springs of 0.1 m, and the load that is added."""
    joint = ksd.CrossFlexure(
        STEEL, length=0.1 * size, angle=0.7, thickness=5e-4 * size, widths=(0.04 * size, 0.02 * size)
    )
    scene = ksd.Mechanism("pivot")
    arm = scene.link("arm")
    placed = scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="x", name="hinge")
    scene.actuate_joint(placed, name="turn")
    tip = (0.1 * size, 0.01 * size, 0.02 * size)
    scene.mass(arm, mass=0.3 * size**3, at=tip, inertia=(1e-4 * size**5,) * 3)
    scene.load(arm, force=np.array([0.5, -0.3, 0.2]) * size**2, at=tip, following=True)
    return ksd.solve(scene, turn=0.3, method="conventional", strict=False), tip


def answers(size):
    """Answers at this size, each divided by its power of the size."""
    pose, tip = pivot(size)
    push = {"at": tip, "force": np.array([-0.8, 0.5, 0.1]) * size**2}
    parasitic, units = pose.parasitic("arm", at=tip), np.repeat([1.0, size], 3)
    return {
        "moment": pose.forces["turn"] / size**3,
        "compliance": pose.stiffness("arm", freed=["turn"]).compliance * np.outer(units, units) * size,
        "frequencies": pose.frequencies(freed=["turn"]).frequency_Hz * size,
        "held frequencies": pose.frequencies().frequency_Hz * size,
        "critical load": pose.buckling("arm", **push).factor,
        "follower load": pose.buckling("arm", **push, following=True).factor,
        "moment fixed in space": pose.buckling("arm", moment=np.array([0.1, 0.3, 0.2]) * size**3).factor,
        "own stress": pose.buckling().factor,
        "shift": parasitic.shift / size,
        "turn": parasitic.turn,
        "size": pose.extent() / size,
        "stress": pose.stress().largest_Pa,
        "verified moment": pose.verify().forces["turn"] / size**3,
    }


@pytest.mark.parametrize("size", [1e-3, 1e-6])
def test_answers_scale_with_the_size_of_the_mechanism(size):
    small = answers(size)
    for question, value in answers(1.0).items():
        scale = np.abs(value).max()
        assert small[question] == pytest.approx(value, rel=1e-6, abs=1e-6 * scale), question


@pytest.mark.parametrize(
    ("length", "aside", "junctions"), [(1e-5, 4e-7, 0), (1e-5, 4e-12, 1), (0.0123455, 1e-12, 1)]
)
def test_ends_of_leaf_springs_meet_by_their_distance_relative_to_the_length(length, aside, junctions):
    scene = ksd.Mechanism("line")
    middle, tip = scene.links("middle", "tip")
    section = ksd.rectangle(length / 100, length / 5)
    for k, (a, b) in enumerate(((scene.ground, middle), (middle, tip))):
        start, end = ((x, -k * aside, 0) for x in (k * (length - aside), (1 + k) * length))
        scene.leaf(a, b, start=start, end=end, section=section, material=STEEL, width_axis="z")
    assert len(in_line_junctions(scene.scene())) == junctions


def test_a_drive_aside_of_a_small_joint_does_not_turn_that_joint():
    joint = ksd.CrossFlexure(STEEL, length=1e-6, angle=0.7, thickness=1e-8, widths=(4e-7, 2e-7))
    points = []
    for aside in (0.0, 5e-8):
        scene = ksd.Mechanism("pivot")
        arm = scene.link("arm")
        scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="x")
        scene.actuate(arm, about="z", at=joint.pose_B + np.array([0, aside, 0]), name="turn")
        points.append(default_point(scene.scene())[1])
    assert points[0] == pytest.approx(0.5 * np.asarray(joint.pose_B))
    assert points[1] == pytest.approx(np.add(joint.pose_B, [0, 5e-8, 0]))


def test_an_attachment_aside_of_a_small_matrix_is_refused():
    points = ((0.0, 0.0, 0.0), (1e-5, 0.0, 0.0))
    scene = ksd.Mechanism("matrix")
    bar = scene.link("bar")
    stiffness = 1e-6 * free_beam(points, 1.0)
    scene.compliance(bar, matrix=ksd.LinkMatrix(points, stiffness))
    start = (-1e-5, 4e-7, 0)
    scene.leaf(scene.ground, bar, start=start, end=(0, 4e-7, 0), section=ksd.circle(1e-7), material=STEEL)
    with pytest.raises(ksd.SceneError, match="mm from the nearest interface"):
        with_elastic_links(scene.scene())


def test_an_attachment_within_a_micrometre_of_an_interface_is_at_it():
    """Coordinates of a finite element program have few digits; those of a link of ordinary size count to 1 um."""
    points = ((0.0, 0.0, 0.0), (0.05, 0.0, 0.0))
    for off, is_refused in ((9e-7, False), (1.1e-6, True)):
        scene = ksd.Mechanism("matrix")
        bar = scene.link("bar")
        scene.compliance(bar, matrix=ksd.LinkMatrix(points, free_beam(points, 1.0)))
        section = ksd.rectangle(1e-3, 1e-2)
        scene.leaf(
            scene.ground,
            bar,
            start=(-0.05, off, 0),
            end=(0, off, 0),
            section=section,
            material=STEEL,
            width_axis="z",
        )
        with pytest.raises(ksd.SceneError, match="nearest interface") if is_refused else nullcontext():
            with_elastic_links(scene.scene())
