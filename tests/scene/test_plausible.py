"""Scenes in another unit, and leaf springs that are no beams, are named; scenes as flexures are stay silent."""

import pytest

import ksd
from ksd.errors import SceneWarning
from ksd.scene.plausibility import drive_value_warnings, likely_unit, plausibility_warnings
from ksd.scene.profile import CircularNotch


def scene(*, length=0.1, thickness=1e-3, width=0.04, profile=None, **material):
    m = ksd.Mechanism("leaf")
    tip = m.link("tip")
    stuff = ksd.Material(**({"E": 200e9, "nu": 0.3, "name": "steel"} | material))
    m.leaf(
        m.ground, tip, start=(0, 0, 0), end=(length, 0, 0), section=ksd.rectangle(thickness, width), material=stuff,
        width_axis="z", name="leaf", profile=profile,
    )  # fmt: skip
    m.actuate(tip, about="z", name="drive")
    return m


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"E": 210000.0}, "E = 210000 Pa is softer than rubber; if it is meant in MPa"),
        ({"E": 2.1e14}, "stiffer than diamond"),
        (
            {"E": 200e6, "name": "Steel"},
            "material 'Steel': E = 2e+08 Pa is softer than any metal: did you mean 200 GPa?",
        ),
        ({"E": 71e6, "name": "", "density": 2700.0}, "any metal of 2700 kg/m^3: did you mean 71 GPa?"),
        ({"E": 2e9, "density": 7800.0}, "softer than any metal of 7800 kg/m^3; moduli are in Pa"),
        ({"length": 50.0}, "leaf 'leaf': length 50 m is that of no flexure"),
        ({"length": 1e-7, "thickness": 1e-9, "width": 1e-8}, "length 1e-07 m"),
        ({"length": 0.05, "thickness": 0.02, "width": 0.01}, "only 2.5 thicknesses"),
        ({"length": 0.03}, "width 40 mm is more than its length 30 mm"),
        ({"density": 7.8}, "density = 7.8 kg/m^3 is that of no solid"),
        ({"yield_stress": 500.0}, "yield_stress = 500 Pa"),
        ({"fatigue_limit": 5e11}, "fatigue_limit = 5e+11 Pa"),
    ],
)
def test_what_no_flexure_has_is_said_once_everywhere(words, said):
    made = scene(**words)
    found = plausibility_warnings(made.scene())
    assert sum(said in sentence for sentence in found) == 1
    assert all("\n" not in sentence and not sentence.endswith(".") for sentence in found)
    diagnosis = ksd.doctor(made)
    assert diagnosis.unusual == found and f"unusual: {found[0]}" in str(diagnosis)
    assert diagnosis.as_dict()["unusual"] == list(found)
    pose = ksd.solve(made, {"drive": 1e-3})
    assert set(found) <= set(pose.warnings) and said in " ".join(str(pose).split())


def test_flexures_are_silent():
    made = scene(density=7800.0, yield_stress=1.2e9, fatigue_limit=0.5e9)
    assert plausibility_warnings(made.scene()) == ()
    assert ksd.solve(made, {"drive": 0.1}).warnings == ()


@pytest.mark.parametrize(
    ("name", "E", "density"),
    [("rubber", 5e6, 1100.0), ("PTFE", 0.5e9, 2200.0), ("lead", 16e9, 11340.0), ("", 2e9, None)],
)
def test_soft_materials_are_silent(name, E, density):
    assert plausibility_warnings(scene(name=name, E=E, density=density).scene()) == ()


def far_apart(spacing, off):
    m, steel = ksd.Mechanism("guide"), ksd.Material(200e9, nu=0.3)
    stage = m.link("stage")
    for x in (0.0, off):
        guide = ksd.ParallelGuide(steel, length=0.1, thickness=5e-4, width=0.02, spacing=spacing)
        m.join(m.ground, stage, guide, at=(0, x, 0), axis="z", toward="x")
    return m.draft()


def test_parts_too_far_apart_are_doubted_once():
    assert plausibility_warnings(far_apart(0.06, 0.5)) == ()
    assert plausibility_warnings(far_apart(60.0, 0.5))[0] == (
        "joint 'ground-stage': spacing = 60.0 is in m, and that of no flexure; did you mean mm?"
    )
    (said,) = plausibility_warnings(far_apart(0.06, 60.0))
    assert said == "its parts are 60 m apart along y, joint 'ground-stage' farthest off; lengths are in m"


@pytest.mark.parametrize(
    ("place", "said"),
    [
        (lambda m, at: m.pin("ground", m.link("crank"), at=at, axis="z"), "pin 'ground-crank'"),
        (lambda m, at: m.load("stage", force=(1, 0, 0), at=at), "load 'stage.load'"),
        (lambda m, at: m.actuate("stage", along="x", at=at), "the point of drive 'stage'"),
        (lambda m, at: m.mass("stage", mass=0.1, at=at), "a mass on 'stage'"),
        (
            lambda m, at: m.spring("ground", "stage", start=(0, 0, 0), end=at, stiffness=1.0),
            "an end of spring 'spring'",
        ),
    ],
)
def test_one_point_far_off_is_named(place, said):
    for far, mechanism in ((0.02, ksd.Mechanism("near")), (20.0, ksd.Mechanism("far"))):
        stage, steel = mechanism.link("stage"), ksd.Material(200e9, nu=0.3)
        guide = ksd.ParallelGuide(steel, length=0.1, thickness=5e-4, width=0.02, spacing=0.06)
        mechanism.join(mechanism.ground, stage, guide, at=(0, 0, 0), axis="z", toward="x")
        place(mechanism, (0, far, 0))
        found = plausibility_warnings(mechanism.draft())
        expected = f"its parts are 20 m apart along y, {said} farthest off; lengths are in m"
        assert found == (() if far < 1 else (expected,))


def test_a_moment_has_no_place_and_the_longest_side_counts():
    """Moments act on their link; of a frame 12 m high the height is told, though a part is farther off along x."""
    mechanism, steel = ksd.Mechanism("frame"), ksd.Material(200e9, nu=0.3)
    tip = mechanism.link("tip")
    for x, y in ((100.0, 0.0), (100.0, 12.0), (107.0, 6.0)):
        guide = ksd.ParallelGuide(steel, length=0.1, thickness=5e-4, width=0.02, spacing=0.06)
        mechanism.join(mechanism.ground, tip, guide, at=(x, y, 0), axis="z", toward="x")
    mechanism.load(tip, moment=(0, 0, 0.1))
    (said,) = plausibility_warnings(mechanism.draft())
    assert said == "its parts are 12 m apart along y, joint 'ground-tip' farthest off; lengths are in m"


def test_a_notch_is_judged_where_it_is_thinnest():
    notch = CircularNotch(radius=5e-3, minimum=5e-4, width=0.01)
    assert (
        plausibility_warnings(scene(length=0.01, thickness=0.0105, width=0.01, profile=notch).scene()) == ()
    )


def test_equal_leaves_share_a_sentence():
    m = ksd.Mechanism("four")
    tip = m.link("tip")
    for k in range(5):
        m.leaf(
            m.ground, tip, start=(0, 0.1 * k, 0), end=(0.05, 0.1 * k, 0), section=ksd.rectangle(0.02, 0.01),
            material=ksd.Material(200e9, nu=0.3), width_axis="z", name=f"leaf {k}",
        )  # fmt: skip
    m.actuate(tip, about="z", name="drive")
    (found,) = plausibility_warnings(m.scene())
    assert found.startswith("leaf springs 'leaf 0', 'leaf 1', 'leaf 2' and 2 more: ")


def test_a_scene_file_in_the_wrong_units_says_so(tmp_path):
    file = tmp_path / "wrong.toml"
    file.write_text(
        """
name = "wrong"
links = ["tip"]
[material.steel]
E = 210000
nu = 0.3
yield_stress = "800 MPa"
fatigue_limit = 4e8
[[leaf]]
a = "ground"
b = "tip"
start = [0, 0, 0]
end = [50, 0, 0]
width_axis = "z"
thickness = 0.5
width = 10
material = "steel"
[[actuate]]
link = "tip"
about = "z"
value = "10 deg"
"""
    )
    with pytest.warns(SceneWarning) as caught:
        made, targets, _ = ksd.load_scene(file)
    (said,) = caught
    assert str(said.message) == (
        "wrong.toml, line 5, [material.steel]: E = 210000 is 210000 Pa: did you mean '210000 MPa'? Plain numbers are in SI. "
        "So for 2 more."
    )
    assert said.filename == __file__
    material = made.scene().leaves[0].leaf.material
    assert (material.yield_stress, material.fatigue_limit) == (8e8, 4e8)
    said = " ".join(ksd.doctor(made).unusual)
    assert "E = 210000 Pa" in said and "length 50 m" in said and "yield_stress = 8e+08 Pa" in said
    ksd.save_scene(made, tmp_path / "again.toml", targets=targets)
    with pytest.warns(SceneWarning, match=r"So for 3 more"):
        assert ksd.load_scene(tmp_path / "again.toml")[0].scene() == made.scene()


@pytest.mark.parametrize("width", ['"1 inc"', "-1"])
def test_a_bare_number_beside_a_mistake_is_named_once(tmp_path, width):
    file = tmp_path / "wrong.toml"
    file.write_text(
        f"""links = ["tip"]
[material.steel]
E = "210 GPa"
nu = 0.3
[[leaf]]
a = "ground"
b = "tip"
start = [0, 0, 0]
end = ["50 mm", 60, 0]
width_axis = "z"
thickness = "0.5 mm"
width = {width}
material = "steel"
"""
    )
    with pytest.raises(ksd.SceneError) as caught:
        ksd.load_scene(file)
    assert str(caught.value).count("end = 60 is 60 m: did you mean '60 mm'?") == 1
    assert "width" in str(caught.value)


@pytest.mark.parametrize(
    ("value", "dimension", "key", "unit"),
    [
        (50.0, "length", "length", "mm"),
        (-300.0, "length", "at", "mm"),
        (0.3, "length", "at", ""),
        (45.0, "angle", "angle", "deg"),
        (0.8, "angle", "angle", ""),
        (200.0, "stress", "E", "GPa"),
        (200e3, "stress", "E", "MPa"),
        (500.0, "stress", "yield_stress", "MPa"),
        (200e9, "stress", "E", ""),
        (0.0, "stress", "E", ""),
        (7.8, "density", "density", "g/cm^3"),
        (7800.0, "density", "density", ""),
        (1e6, "force", "force", ""),
    ],
)
def test_the_unit_a_plain_number_was_meant_in(value, dimension, key, unit):
    assert likely_unit(value, dimension, key) == unit


def guide():
    m = ksd.Mechanism("guide")
    stage, steel = m.link("stage"), ksd.Material(E=200e9, nu=0.3)
    for x in (0.0, 0.05):
        m.leaf(m.ground, stage, start=(x, 0, 0), end=(x, 0.1, 0), section=ksd.rectangle(0.5e-3, 0.02), material=steel,
               width_axis="z")  # fmt: skip
    m.actuate(stage, along="x", at=(0.025, 0.1, 0), name="push")
    return m


def test_a_drive_value_in_another_unit_is_doubted_where_the_solve_stops_and_where_it_does_not():
    said = "push = 2 is 2 m and the mechanism 0.1 m large: did you mean 2 mm (2 * ksd.units.mm in Python)?"
    with pytest.raises(ksd.ConvergenceError) as caught:
        ksd.solve(guide(), push=2)
    assert str(caught.value).startswith(said)
    assert said in ksd.solve(guide(), push=2, strict=False).warnings
    assert "did you mean" not in " ".join(ksd.solve(guide(), push=2e-3).warnings)
    assert drive_value_warnings(guide().scene(), {"push": 0.15}, 0.1) == ()
    turned = scene()
    with pytest.raises(ksd.SceneError) as caught:
        ksd.solve(turned, drive=20)
    assert str(caught.value).endswith(
        "drive = 20 is 20 rad: did you mean 20 deg (20 * ksd.units.deg in Python)?"
    )


@pytest.mark.parametrize(
    ("value", "dimension", "unit"),
    [
        (-9810.0, "acceleration", "mm/s^2"),
        (-9.81, "acceleration", ""),
        (500.0, "mass", "g"),
        (0.5, "mass", ""),
    ],
)
def test_plain_gravity_and_masses_in_another_unit(value, dimension, unit):
    assert likely_unit(value, dimension, "") == unit


def planar_leaf(**words):
    m = ksd.Mechanism("planar leaf", plane=words.pop("plane", "xy"))
    tip = m.link("tip", at=(0.1, 0, 0), mass=words.pop("mass", None))
    steel = ksd.Material(E=200e9, nu=0.3, density=7800.0)
    m.leaf(
        m.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(5e-4, 0.02), material=steel,
        **({} if m.plane else {"width_axis": "z"}),
    )  # fmt: skip
    m.actuate(tip, about="z", name="turn")
    return m, tip


@pytest.mark.parametrize(
    ("effort", "said"),
    [
        (lambda m, t: m.load(t, force=(1, 0, 5), at=(0.1, 0, 0), name="push"), "5 N along z of load 'push'"),
        (
            lambda m, t: m.load(t, moment=(0.3, 0.4, 9), name="twist"),
            "0.5 Nm about axes in it of load 'twist'",
        ),
        # a leaf spring of 7.8 g
        (lambda m, t: setattr(m, "gravity", (0, 0, -10)), "-0.078 N along z of gravity on 0.0078 kg"),
        (
            lambda m, t: m.spring(
                m.ground,
                t,
                start=(0.1, 0, 0.03),
                end=(0.1, 0.04, 0),
                stiffness=100,
                free_length=0.0,
                name="pull",
            ),
            "-3 N along z of spring 'pull'",
        ),
        (
            lambda m, t: m.turn_spring(
                m.ground, t, at=(0, 0, 0), axis="x", stiffness=2.0, rest_angle=0.1, name="coil"
            ),
            "0.2 Nm about axes in it of torsion spring 'coil'",
        ),
    ],
)
def test_what_acts_out_of_the_plane_of_a_mechanism_is_told(effort, said):
    """The plane holds it: the answer has no displacement by it, and says so with its size, as the doctor does."""
    mechanism, tip = planar_leaf()
    effort(mechanism, tip)
    pose = ksd.solve(mechanism, turn=0.1)
    (warning,) = [w for w in pose.warnings if "the plane xy holds what acts out of it" in w]
    assert said in warning and "leave plane='xy' out to simulate" in warning
    assert abs(pose.displacement(tip)[2]) < 1e-12 and said in str(ksd.doctor(mechanism))


def test_what_acts_in_the_plane_is_no_warning():
    mechanism, tip = planar_leaf()
    mechanism.load(tip, force=(1, 2, 0), moment=(0, 0, 0.01), at=(0.1, 0, 0))
    mechanism.gravity = (0, -9.81, 0)
    mechanism.spring(
        mechanism.ground,
        tip,
        start=(0.1, 0.05, 0),
        end=(0.1, 0, 0),
        stiffness=10,
        free_length=0.01,
        name="pull",
    )
    assert not any("plane" in w for w in plausibility_warnings(mechanism.scene()))
    free, end = planar_leaf(plane=None)
    free.load(end, force=(0, 0, 5), at=(0.1, 0, 0))
    assert not any("plane xy" in w for w in plausibility_warnings(free.scene()))
