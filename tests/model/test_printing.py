"""Models and configurations say in a line or a few what they are."""

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
