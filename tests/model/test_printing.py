"""Models and configurations say in a line or a few what they are."""

import numpy as np
from scenes import fourbar

import ksd


def test_a_model_says_what_is_simulated_and_left_out():
    model = ksd.compile_scene(fourbar())
    text = str(model)
    assert "3 links, 4 joints, 12 leaf springs" in text
    assert "18 at nodes, 1 multiplier," in text
    assert "left out:" in text and "gravity" in text
    assert repr(model).count("\n") == 0 and len(repr(model)) < 200
    heavy = fourbar()
    heavy.mass("top", mass=1.0, at=(0, 0.37, 0))
    heavy.gravity = (0, -9.81, 0)
    assert "gravity among them" in str(ksd.compile_scene(heavy))


def test_a_configuration_is_short_in_the_interpreter():
    found = ksd.solve(fourbar(), top=0.1)
    assert len(repr(found)) < 200 and "forces top 64.0" in repr(found)


def test_the_weight_of_the_leaves_is_listed():
    scene = fourbar()
    assert "weight of the leaf springs" not in str(ksd.compile_scene(scene))
    scene.gravity = (0, -9.81, 0)
    # four joints of one 40 mm and two 20 mm leaf springs, 1 mm thick and 100 mm long
    mass = 4 * 7800 * 0.08 * 1e-3 * 0.1
    listed = f"weight of the leaf springs: {mass:.3g} kg along them, {9.81 * mass:.3g} N"
    assert listed in str(ksd.compile_scene(scene, with_="gravity"))
    assert "weight of the leaf springs" not in str(ksd.compile_scene(scene, without="gravity"))


def test_curved_bars_are_said_where_they_matter():
    """(t/R)^2/30 of the exact solution of a curved bar (Golovin): .033 % of an arc of a radius ten times its thickness."""
    a, b, R = 0.95, 1.05, 1.0
    exact = (b**2 - a**2) ** 2 - (2 * a * b * np.log(b / a)) ** 2
    golovin = 1.0 - 3.0 * exact * R / (2.0 * (b - a) ** 3 * (b**2 - a**2))
    scene = ksd.Mechanism("arcs")
    tip = scene.link("tip")
    words = {
        "section": ksd.rectangle(0.4e-3, 6e-3),
        "material": ksd.Material(E=200e9, nu=0.3),
        "width_axis": "z",
    }
    for name, radius in (("mild", 9e-3), ("tight", 4e-3)):
        curve = ksd.Arc(radius=radius, angle=1.0)
        chord = 2 * radius * np.sin(0.5)
        scene.leaf("ground", tip, start=(0, 0, 0), end=(chord, 0, 0), curve=curve, name=name, **words)
    text = str(ksd.compile_scene(scene))
    assert f"(t/R)^2/30 = {100 * golovin:.2g} % softer in bending (leaf 'tight', t/R = 0.1)" in text
    assert "curved bars" not in str(ksd.compile_scene(fourbar()))
