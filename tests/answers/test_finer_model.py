"""The equilibrium on the finer mesh that questions stand on."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import STEEL, fourbar

import ksd
from ksd.answers.finer_model import finer_state
from ksd.model.compile import compile_scene
from ksd.numerics.rotations import rotation_exp
from ksd.solvers.error import find_equilibrium


def cantilever():
    scene = ksd.Mechanism("cantilever")
    tip = scene.link("tip")
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(5e-4, 1e-2), width_axis="z",
               material=STEEL)  # fmt: skip
    return scene


@pytest.mark.parametrize(("turn", "left"), [(0.05, 0.0), (0.2, 0.2)])
def test_a_node_is_led_to_equilibrium_unless_it_is_far(turn, left):
    """The tip of an unloaded leaf spring, turned out of equilibrium: back to rest, or left where it is."""
    model = compile_scene(cantilever())
    motion = model.rest.copy()
    rotation_exp(np.array([0.0, 0.0, turn]), motion.R[1])
    _, state = finer_state(model, motion)
    assert np.arcsin(state.R[1][1, 0]) == pytest.approx(left, abs=1e-12)


def test_a_node_that_would_be_moved_far_stays():
    """A link that next to nothing holds, out of its spring's equilibrium by more than the mechanism is long."""
    scene = cantilever()
    scene.link("loose")
    scene.slider("loose", along="x", at=(0, 0.02, 0))
    scene.spring(
        scene.ground, "loose", start=(-0.05, 0.02, 0), end=(0, 0.02, 0), stiffness=1e-3, free_length=0.3
    )
    model = compile_scene(scene)
    _, state = finer_state(model, model.rest)
    loose = model.node_names.index("loose")
    assert np.array_equal(state.x[loose], model.rest.x[loose])


def test_drives_and_supports_stay_where_they_are():
    """A driven tip on the finer mesh: the same drive value, to the last digit but rounding."""
    scene = cantilever()
    scene.actuate("tip", along="y", at=(0.1, 0, 0), name="d")
    scene.support("tip", about="z", name="turn")
    pose = ksd.solve(scene, d=2e-4)
    _, state = finer_state(pose.model, pose.motion)
    assert state.x[1, 1] == pytest.approx(2e-4, rel=1e-9)
    assert pose.stiffness("tip", freed="d").supports["y"] == pytest.approx(
        pose.drive_stiffness()["d"], rel=1e-6
    )


@pytest.mark.parametrize(("method", "off"), [("kinematic", 6e-3), ("reduced", 1e-3)])
def test_a_stiffness_by_a_fast_method_is_that_of_a_newton_step_beside_it(method, off):
    """Also where its links are .02 rad off, and a stiffness of that very state by half."""
    found, exact = (ksd.solve(fourbar(), top=0.3, method=m) for m in (method, "full"))
    assert found.drive_stiffness()["top"] == pytest.approx(exact.drive_stiffness()["top"], rel=off)


@pytest.mark.parametrize(("drive", "alone"), [(0.01, True), (0.15, False)])
def test_a_fast_answer_beside_equilibrium_goes_to_the_finer_mesh_at_once(drive, alone):
    """With the answers of that equilibrium; one further off is led there first."""
    pose = ksd.prepare(fourbar(), planar=False)(top=drive)
    assert (pose.method_error.relative < 1e-5) == (pose.refinement_start is pose.motion) == alone
    led = replace(pose, method_error=None)
    assert led.refinement_start is led.equilibrium
    assert pose.drive_stiffness()["top"] == pytest.approx(led.drive_stiffness()["top"], rel=1e-9)
    assert pose.frequencies().frequency_Hz == pytest.approx(led.frequencies().frequency_Hz, rel=1e-9)
    model = pose.model
    exact = find_equilibrium(model.arrays, pose.motion.copy(), model.targets(pose.targets), 1.0)
    assert pose.equilibrium.multiplier == pytest.approx(exact.multiplier, rel=1e-9, abs=1e-9)
