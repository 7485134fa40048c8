"""Sensors, dampers and inertias that cannot be meant: what the doctor says of them, and what is refused."""

import pytest
from scenes import STEEL

import ksd
from ksd.errors import SceneError
from ksd.pages.report_page import _vibrations
from ksd.units import mm
from ksd.view.swing import swing


def guide(plane="xy", inertia=(1e-3, 1e-3, 1e-3)):
    """A stage on two leaf springs that stand along y."""
    scene = ksd.Mechanism("guide", plane=plane)
    stage = scene.link("stage", mass=1.0, inertia=inertia, at=(0, 0.06, 0))
    for x in (0, 0.05):
        leaf = ksd.rectangle(0.3 * mm, 20 * mm)
        scene.leaf(
            "ground", stage, start=(x, 0, 0), end=(x, 0.06, 0), section=leaf, material=STEEL, width_axis="z"
        )
    return scene


@pytest.mark.parametrize("plane", ["xy", None])
def test_the_doctor_knows_sensors_and_dampers(plane):
    scene = guide(plane)
    assert ksd.doctor(scene).observed == ()
    scene.sensor("stage", along="x", at=(0, 0.06, 0), name="moves")
    scene.sensor("stage", about="z", name="stiff")
    scene.damper("ground", "stage", along="y", at=(0, 0.06, 0), damping=2.0, name="idle")
    scene.damper("ground", "stage", along="x", at=(0, 0.06, 0), damping=2.0, name="works")
    found = ksd.doctor(scene)
    held = {s.split("'")[1]: "hold it" in s for s in found.observed}
    assert held == {"moves": False, "stiff": True, "idle": True, "works": False}
    text = str(found)
    assert "sensor 'moves' reads the displacement of 'stage' along (1 0 0) relative to 'ground'" in text
    assert "damper 'idle' resists the motion of 'stage' along (0 1 0)" in text
    assert found.as_dict()["observed"] == list(found.observed)


def test_an_inertia_that_no_body_has_is_refused():
    with pytest.raises(SceneError, match=r"moments 0\.001, 0\.001 and 0\.003"):
        guide(None, (1e-3, 1e-3, 3e-3)).scene()
    with pytest.raises(SceneError, match="is that of no body"):
        guide(None, [[1e-3, 2e-3, 0], [2e-3, 1e-3, 0], [0, 0, 1e-3]]).scene()
    # a thin plate is the limit, and in a plane one moment counts
    assert guide(None, (1e-3, 2e-3, 3e-3)).scene().masses
    assert guide("xy", (0, 0, 3e-3)).scene().masses


def test_dampers_and_sensors_that_cannot_be_are_refused():
    scene = guide()
    for words, sentence in (
        ({"b": "ground"}, "connects link 'ground' with itself"),
        ({"damping": -1.0}, "damping = -1.0 N s/m must be positive"),
        ({"along": None}, "give one of along=direction"),
    ):
        with pytest.raises(SceneError) as refused:
            scene.damper(
                **{"a": "ground", "b": "stage", "along": "x", "at": (0, 0, 0), "damping": 1.0, **words}
            )
        assert sentence in str(refused.value)
    for words, sentence in (
        ({"link": "stag"}, "link 'stag' does not exist; did you mean \"stage\""),
        ({"kind": "speed"}, "kind = 'speed' must be one of displacement"),
        ({"relative_to": "grund"}, "link 'grund' does not exist"),
    ):
        with pytest.raises(SceneError) as refused:
            scene.sensor(**{"link": "stage", "along": "x", "at": (0, 0, 0), **words})
        assert sentence in str(refused.value)
    for value in (-0.1, 1.1):
        with pytest.raises(SceneError, match=f"loss_factor = {value} must lie between 0 and 1"):
            ksd.Material(E=1e9, nu=0.3, loss_factor=value)


def test_no_density_anywhere_has_no_response():
    scene, plain = ksd.Mechanism("light"), ksd.Material(E=1e9, nu=0.3)
    tip = scene.link("tip")
    leaf = ksd.rectangle(0.3 * mm, 20 * mm)
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0, 0.06, 0), section=leaf, material=plain, width_axis="z")
    scene.sensor(tip, along="x", at=(0, 0.06, 0))
    with pytest.raises(SceneError, match="nothing in this scene has mass"):
        ksd.solve(scene).response([1.0], inputs="base x")


def test_the_report_has_modes_and_what_sensors_see():
    """Six modes in a table, three in pictures; a Bode plot with a sensor."""
    scene = guide()
    scene.actuate("stage", along="x", at=(0, 0.06, 0), name="push")
    pose = ksd.solve(scene, push=0.0)
    without = "".join(_vibrations(pose, ["push"]))
    assert "with push let go" in without and without.count("<img") == 3 and without.count("<tr>") == 7
    scene.sensor("stage", along="x", at=(0, 0.06, 0), name="tip")
    pose = ksd.solve(scene, push=0.0)
    assert "".join(_vibrations(pose, ["push"])).count("<img") == 4
    # a mode of the leaf springs is drawn by their own largest displacement
    modes = pose.frequencies(freed="push")
    leaf = next(k for k, what in enumerate(modes.movements) if "between the ends" in what)
    swung, still = (swing(pose, modes, leaf, 0.02)(share) for share in (0.01, 0.0))
    places = zip(swung.shape().leaves, still.shape().leaves, strict=True)
    largest = max(abs(one.place - other.place).max() for one, other in places)
    assert largest == pytest.approx(2e-4 * pose.model.arrays.size, rel=1e-3)
    assert largest > 10 * abs(swung.motion.x - still.motion.x).max()
