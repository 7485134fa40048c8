"""Motions that released drives leave without stiffness: 0 Hz, stiffness 0, double integrators; the other answers as if a
spring of vanishing stiffness held them."""

import numpy as np
import pytest
import scipy.linalg
from scenes import STEEL
from uncondensed import uncondensed

import ksd
from ksd.errors import KinematicsError
from ksd.units import mm


def reaction_stage(*, spring=0.0, material=STEEL, carriages=1, plane="xy", massless=()):
    """Carriages on slides along x, each with a drive of its own and two stages on parallel leaf springs."""
    scene = ksd.Mechanism("reaction", plane=plane)
    for c in range(carriages):
        at = np.array([0.0, 0.3 * c, 0.0])
        carriage = scene.link(f"carriage{c}")
        if c not in massless:
            scene.mass(carriage, mass=2.0 + c, inertia=(1e-2, 1e-2, 1e-2), at=at)
        scene.slider(carriage, along="x", at=at)
        scene.actuate(carriage, along="x", at=at, name=f"push{c}")
        if spring:
            scene.spring(scene.ground, carriage, start=at - (0.1, 0, 0), end=at, stiffness=spring)
        for k in range(2):
            stage = scene.link(f"stage{c}{k}")
            scene.mass(
                stage,
                mass=0.3 + 0.2 * k,
                inertia=(1e-4, 1e-4, 1e-4),
                at=at + np.array([0.2 * k + 0.025, 0.06, 0]),
            )
            for foot in at + np.array([[0.2 * k, 0, 0], [0.2 * k + 0.05, 0, 0]]):
                leaf = ksd.rectangle(width=20 * mm, thickness=(0.3 + 0.1 * c) * mm)
                scene.leaf(
                    carriage, stage, start=foot, end=foot + np.array([0, 0.06, 0]), section=leaf, material=material,
                    width_axis="z",
                )  # fmt: skip
    return scene


FREED = ["push0"]


@pytest.fixture(scope="module")
def pose():
    return ksd.solve(reaction_stage(), push0=1 * mm)


@pytest.mark.parametrize("dense", [True, False], ids=("dense", "iterated"))
@pytest.mark.parametrize("plane", ["xy", None], ids=("planar", "spatial"))
def test_a_free_carriage_is_a_mode_of_no_frequency_and_leaves_the_others(plane, dense):
    mesh = ksd.Mesh(orders=(6, 5, 9), points=10)
    pose = ksd.solve(reaction_stage(plane=plane), push0=1 * mm, mesh=mesh)
    modes = pose.frequencies(freed=FREED, dense=dense)
    # two soft springs, extrapolated to none
    soft, softer = (
        ksd.solve(reaction_stage(plane=plane, spring=k), push0=1 * mm, mesh=mesh).frequencies(
            freed=FREED, dense=dense
        )
        for k in (0.2, 0.1)
    )
    without = 2 * softer.frequency_Hz - soft.frequency_Hz
    assert modes.frequency_Hz[0] == 0.0
    assert modes.frequency_Hz[1:] == pytest.approx(without[1:], rel=1e-7)
    assert modes.names[0] == "intended" and "'carriage0' moves along x" in modes.movements[0]
    assert modes.first_parasitic_Hz == modes.frequency_Hz[1]
    # against all unknowns at once, where a shift makes the stiffness regular
    K, M = uncondensed(pose.model, pose.motion, FREED)
    shift = (2 * np.pi) ** 2
    values = np.sort(scipy.linalg.eigvals(np.linalg.solve(K + shift * M, M)).real)[::-1][:6]
    squared = 1 / values - shift
    assert abs(squared[0]) < 1e-6 * squared[1]
    assert (2 * np.pi * modes.frequency_Hz[1:]) ** 2 == pytest.approx(squared[1:], rel=1e-6)
    # without an outer force the momentum along x stays zero
    mass = modes.mass.matrix
    assert np.abs(modes.vector[1:] @ mass @ modes.vector[0]).max() < 1e-8


def test_two_free_carriages_have_two():
    pose = ksd.solve(reaction_stage(carriages=2), push0=0.0, push1=2 * mm)
    modes = pose.frequencies(freed=["push0", "push1"], count=8)
    one = pose.frequencies(freed=["push1"], count=8)
    assert list(modes.frequency_Hz[:2]) == [0.0, 0.0] and modes.frequency_Hz[2] > 1.0
    assert list(modes.intended) == [0, 1]
    assert one.frequency_Hz[0] == 0.0 < one.frequency_Hz[1]


def test_the_stiffness_of_a_free_motion_is_none(pose):
    at, spring = (0.025, 0.06, 0), 1e-5
    found = pose.stiffness("stage00", at=at, freed=FREED)
    soft = ksd.solve(reaction_stage(spring=spring), push0=1 * mm).stiffness("stage00", at=at, freed=FREED)
    assert found.support("x") == 0.0 and found.compliance[0, 0] == np.inf
    assert soft.support("x") == pytest.approx(spring, rel=1e-6)
    for direction in ("y", "rz"):
        assert found.support(direction) == pytest.approx(soft.support(direction), rel=1e-5)
    assert found.support("rz", held=["x", "y"]) == pytest.approx(
        soft.support("rz", held=["x", "y"]), rel=1e-5
    )
    assert found.support("x", held=["y"]) == 0.0
    pick = ("x", "y", "rz")
    assert found.matrix(pick) == pytest.approx(
        soft.matrix(pick), rel=1e-5, abs=1e-5 * soft.matrix(pick)[2, 2]
    )
    assert list(found.principal[0, :2]) == [0.0, pytest.approx(soft.principal[0, 1], rel=1e-5)]
    assert found.worst[0] == 0.0
    assert "nothing resists this motion with push0 freed" in str(found) and "unbounded" in str(found)
    # a force on the carriage moves the whole; on nothing that is held
    assert pose.drive_stiffness(freed=FREED).names == ()


def test_a_free_drive_is_a_double_integrator(pose):
    system = ksd.state_space(pose, modes=40, damping=0.0)
    assert system.frequency_Hz[0] == 0.0 and "inf" in str(system)
    K, M = uncondensed(pose.model, pose.motion, FREED)
    row = np.zeros(len(K))
    start = pose.model.arrays.start[1]
    row[start] = 1.0
    for f in (0.5, 3.0, 9.0, 50.0):
        direct = row @ np.linalg.solve(K - (2 * np.pi * f) ** 2 * M, row)
        assert system.response(f)[0, 0, 0] == pytest.approx(direct, rel=1e-6)


def test_sweeps_answer_free_drives():
    table = ksd.sweep(
        reaction_stage(), push0=np.linspace(0, 2, 3) * mm, questions=["frequencies", "support_stiffness"]
    )
    assert list(table["intended_Hz"]) == [0.0] * 3
    assert table["first_parasitic_Hz"][0] == pytest.approx(7.6713, rel=1e-4)


def test_what_has_neither_stiffness_nor_mass_has_no_frequency():
    scene = reaction_stage()
    idle = scene.link("idle")
    scene.slider(idle, along="x", at=(0, 1, 0))
    scene.actuate(idle, along="x", at=(0, 1, 0), name="nothing")
    pose = ksd.solve(scene, push0=0.0, nothing=0.0)
    with pytest.raises(
        KinematicsError, match="with push0, nothing released a motion has neither stiffness nor mass"
    ):
        pose.frequencies(freed=["push0", "nothing"])


def test_a_hexapod_on_six_released_carriages_has_six_free_motions():
    """Rods with ball joints at both ends; a small stage on the platform has the modes that are left."""
    scene = ksd.Mechanism("hexapod")
    platform = scene.link("platform", mass=1.0, inertia=(2e-3, 2e-3, 4e-3), at=(0, 0, 0.2))
    for k in range(6):
        foot, top = (
            r * np.array([np.cos(a), np.sin(a), 0.0])
            for r, a in ((0.15, np.pi / 3 * k), (0.08, np.pi / 3 * k + 0.4 * (-1) ** k))
        )
        top = top + np.array([0, 0, 0.2])
        carriage = scene.link(f"carriage {k}", mass=0.3, inertia=(1e-4, 1e-4, 1e-4), at=foot)
        rod = scene.link(f"rod {k}", mass=0.05, inertia=(1e-4, 1e-4, 1e-4), at=0.5 * (foot + top))
        scene.slider(carriage, along="z", at=foot)
        scene.actuate(carriage, along="z", at=foot, name=f"lift {k}")
        scene.ball(carriage, rod, at=foot)
        scene.ball(rod, platform, at=top)
        # a rod with two balls turns about itself
        scene.support(rod, about=top - foot)
    stage = scene.link("stage", mass=0.2, inertia=(1e-4, 1e-4, 1e-4), at=(0.02, 0, 0.27))
    for x in (0.0, 0.04):
        leaf = ksd.rectangle(0.3 * mm, 15 * mm)
        scene.leaf(platform, stage, start=(x, 0, 0.21), end=(x, 0, 0.26), section=leaf, material=STEEL)
    drives = [f"lift {k}" for k in range(6)]
    pose = ksd.solve(scene, dict.fromkeys(drives, 0.0))
    modes = pose.frequencies(count=9, freed=drives)
    assert list(modes.frequency_Hz[:6]) == [0.0] * 6 and modes.frequency_Hz[6] > 5.0
    # what is free has no elastic energy, and moves the platform in all six ways
    assert np.linalg.matrix_rank(modes.shape[:6, 1]) == 6
    held = pose.frequencies(count=3).frequency_Hz
    assert modes.frequency_Hz[6] > held[0]
