"""Links that only pins and sliders hold, and torsion springs between them: closed forms of rigid linkages."""

import numpy as np
import pytest

import ksd


def test_a_rigid_crank_and_slider():
    scene = ksd.Mechanism("crank", plane="xy")
    crank, rod, piston = scene.links("crank", "rod", "piston")
    scene.pin(scene.ground, crank, at=(0, 0, 0))
    scene.pin(crank, rod, at=(0.03, 0, 0))
    scene.pin(rod, piston, at=(0.13, 0, 0))
    scene.slider(piston, along="x", at=(0.13, 0, 0))
    scene.actuate(crank, about="z", name="turn")
    pose = ksd.solve(scene, turn=0.3)
    x = 0.03 * np.cos(0.3) + np.sqrt(0.1**2 - (0.03 * np.sin(0.3)) ** 2)
    assert pose.displacement("piston")[0] == pytest.approx(x - 0.13, abs=1e-10)
    assert pose.error.relative < 1e-6 and "Strain and stress are not known" in str(pose)


def test_a_link_on_a_pin_with_a_torsion_spring_under_a_force():
    scene = ksd.Mechanism("arm")
    arm = scene.link("arm")
    scene.pin(scene.ground, arm, at=(0, 0, 0), axis="z")
    scene.turn_spring(scene.ground, arm, at=(0, 0, 0), axis="z", stiffness=2.0)
    scene.load(arm, force=(0, 1, 0), at=(0.1, 0, 0))
    turned = ksd.solve(scene).rotation("arm")[2]
    assert 2.0 * turned == pytest.approx(0.1 * np.cos(turned), rel=1e-8)


def test_pins_that_leave_a_link_loose_are_a_sentence():
    scene = ksd.Mechanism("rod")
    a, b = scene.links("a", "b")
    scene.pin(scene.ground, a, at=(0, 0, 0), axis="z")
    scene.pin(a, b, at=(0.1, 0, 0), axis="z")
    scene.actuate(b, along="x", at=(0.2, 0, 0), name="d")
    with pytest.raises(ksd.ConvergenceError, match="something can move without resistance"):
        ksd.solve(scene, d=-0.01)
