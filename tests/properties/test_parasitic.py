"""Parasitic motion in linkages of pins and sliders."""

import numpy as np

import ksd


def test_a_crank_does_not_carry_the_piston_behind_a_rod():
    scene = ksd.Mechanism("slider crank", plane="xy")
    crank, rod, piston = scene.links("crank", "rod", "piston")
    scene.pin(scene.ground, crank, at=(0, 0, 0))
    scene.pin(crank, rod, at=(0.02, 0, 0))
    words = {"section": ksd.rectangle(1e-3, 0.01), "material": ksd.Material(E=2e9, nu=0.35)}
    scene.leaf(rod, piston, start=(0.025, 0, 0), end=(0.1, 0, 0), **words)
    scene.slider(piston, along="x", at=(0.1, 0, 0))
    scene.actuate(crank, about="z", name="turn")
    pose = ksd.solve(scene, turn=np.deg2rad(60.0))
    moved = pose.displacement(piston, (0.1, 0, 0))
    assert moved[0] < -0.01
    # at rest, in the dead centre, the crank brings the piston no motion to first order
    found = pose.parasitic(piston, at=(0.1, 0, 0))
    assert np.allclose(found.shift, moved, atol=1e-12) and np.allclose(found.turn, 0.0, atol=1e-9)
    # the pin of the rod goes with the crank
    assert np.allclose(pose.parasitic(rod, at=(0.02, 0, 0)).shift, 0.0, atol=1e-9)
