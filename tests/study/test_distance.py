"""Distances of two points that a scene asks for: pose, file, sweep, gradient and job against displacements of the links."""

from importlib import resources

import numpy as np
import pytest

import ksd
from ksd.errors import SceneError
from ksd.units import mm

PLASTIC = ksd.Material(E=2.5e9, nu=0.3)
TIP, TOP = (0.05, 0.0, 0.0), (0.05, 0.02, 0.0)


def tweezers(thickness=0.5 * mm, *, along=None, turns_with=None):
    """Two leaf springs side by side with tips that a drive and a load close."""
    scene = ksd.Mechanism("tweezers", plane="xy")
    low, high = scene.links("low", "high")
    for link, y in ((low, 0.0), (high, 0.02)):
        scene.leaf("ground", link, start=(0, y, 0), end=(0.05, y, 0), section=ksd.rectangle(thickness, 5 * mm),
                   material=PLASTIC)  # fmt: skip
    scene.load(low, force=(0, 0.02, 0), at=TIP)
    scene.actuate(high, along="y", at=TOP, name="close")
    scene.distance(low, high, start=TIP, end=TOP, along=along, turns_with=turns_with, name="opening")
    return scene


def parted(pose):
    """The vector (3,) [m] from tip to tip."""
    return np.subtract(TOP, TIP) + pose.displacement("high", TOP) - pose.displacement("low", TIP)


def test_distance_of_a_pose():
    pose = ksd.solve(tweezers(), close=-4 * mm)
    assert pose.distance("opening") == pytest.approx(np.linalg.norm(parted(pose)), rel=1e-12)
    (drawn,) = pose.shape().distances
    assert drawn.direction == pytest.approx(parted(pose) / np.linalg.norm(parted(pose)), abs=1e-12)
    across = ksd.solve(tweezers(along="y"), close=-4 * mm)
    # a direction of the scene stays, that of a link turns with it, whichever end it is
    assert across.distance("opening") == pytest.approx(parted(across)[1], rel=1e-12)
    for link in ("low", "high"):
        pose = ksd.solve(tweezers(along="y", turns_with=link), close=-4 * mm)
        turn = pose.rotation(link)[2]
        want = parted(pose) @ (-np.sin(turn), np.cos(turn), 0)
        assert abs(turn) > 0.05 and abs(want - parted(pose)[1]) > 1e-5
        assert pose.distance("opening") == pytest.approx(want, rel=1e-12)
        (drawn,) = pose.shape().distances
        assert drawn.direction == pytest.approx([-np.sin(turn), np.cos(turn), 0], abs=1e-12)


def test_sweep_gradient_and_job():
    shown = ksd.sweep(tweezers(), close=[0.0, -2 * mm, -4 * mm])
    poses = [ksd.solve(tweezers(), close=d) for d in (0.0, -2 * mm, -4 * mm)]
    assert shown["distance_opening_mm"] == pytest.approx(
        [1e3 * p.distance("opening") for p in poses], rel=1e-9
    )
    found = ksd.gradient(tweezers, {"thickness": 0.5 * mm}, questions="distance", close=-2 * mm)
    slope = found["distance_opening_mm", "thickness"][0]
    h = 1e-3 * mm
    one, other = (
        1e3 * ksd.solve(tweezers(t), close=-2 * mm).distance("opening") for t in (0.5 * mm + h, 0.5 * mm - h)
    )
    assert slope == pytest.approx((one - other) / (2 * h), rel=1e-4)
    assert slope != 0.0
    # the softest that the load leaves 15 mm between its tips
    job = ksd.Job(tweezers, vary={"thickness": (0.4 * mm, 0.9 * mm)}, minimise="close_stiffness_N_per_m",
                  limits={"distance_opening_mm": (15.0, None)}, method="conventional", close=0.0)  # fmt: skip
    best = ksd.optimise(job, start={"thickness": 0.7 * mm})
    held = ksd.solve(tweezers(best.design["thickness"]), close=0.0)
    assert held.distance("opening") == pytest.approx(15 * mm, rel=1e-4)


def test_file_round_trip(tmp_path):
    scene = tweezers(along="y", turns_with="high")
    ksd.save_scene(scene, tmp_path / "tweezers.toml")
    back, _, _ = ksd.load_scene(tmp_path / "tweezers.toml")
    assert back.scene() == scene.scene()
    assert ksd.solve(back, close=-1 * mm).distance("opening") == pytest.approx(
        ksd.solve(scene, close=-1 * mm).distance("opening")
    )


def test_opening_of_the_gripper():
    """Section G: crank at 15 degrees, inextensible -7.647798 mm; the scene's arcs stretch."""
    with resources.as_file(resources.files("ksd") / "scenes" / "gripper.toml") as path:
        mechanism, targets, _ = ksd.load_scene(path)
    pose = ksd.solve(mechanism, targets)
    assert pose.distance("opening") == pytest.approx(
        -pose.displacement("jaw", (0.07, 0.045, 0))[0], rel=1e-12
    )
    assert pose.distance("opening") == pytest.approx(7.647798 * mm, rel=1e-3)


def test_refusals():
    scene = tweezers()
    with pytest.raises(SceneError, match="distance 'same': its two points are one and the same at rest"):
        scene.distance("low", "high", start=TIP, end=TIP, name="same")
    with pytest.raises(
        SceneError, match=r"distance 'other': turns_with names the link .*; give along= as well"
    ):
        scene.distance("low", "high", start=TIP, end=TOP, turns_with="low", name="other")
    with pytest.raises(SceneError, match=r"lo.*low"):
        scene.distance("low", "high", start=TIP, end=TOP, along="y", turns_with="lo", name="other")
    with pytest.raises(SceneError, match="the name is used already"):
        scene.distance("low", "high", start=TIP, end=TOP, name="opening")
    with pytest.raises(SceneError, match=r"lo.*low"):
        scene.distance("lo", "high", start=TIP, end=TOP, name="other")
    with pytest.raises(SceneError, match=r"'openin' is not defined in this mechanism.*opening"):
        ksd.solve(scene, close=0.0).distance("openin")
