"""The builder: where things end up, default names, whole-scene rules, equality and fingerprint."""

import math
import re
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import ksd
from ksd.errors import SceneError
from ksd.scene import CrossFlexure, Drive, DriveTerm, FoldedLeaf, FreeCurve, Material, Mechanism, Scene
from ksd.section import rectangle
from ksd.units import GPa, deg, mm

STEEL = Material(200 * GPa, G=76.9 * GPa, density=7800)
CROSS = CrossFlexure(STEEL, length=0.1, angle=45 * deg, thickness=1 * mm, widths=(40 * mm, 20 * mm))
BLADE = rectangle(1 * mm, 40 * mm)
PLACE = {"at": (0, 0, 0), "axis": "z", "toward": "y"}


def lever():
    made = Mechanism("lever")
    arm = made.link("arm")
    made.join("ground", arm, CROSS, **PLACE)
    return made


def fourbar():
    made = Mechanism("fourbar")
    left, top, right = made.links("left", "top", "right")
    for a, b, x, y in ((made.ground, left, 0, 0), (left, top, 0, 0.3), (right, top, 0.4, 0.3)):
        made.join(a, b, CROSS, at=(x, y, 0), axis="z", toward="y")
    made.join(made.ground, right, CROSS, at=(0.4, 0, 0), axis="z", toward="y")
    made.actuate(top, along="x", at=(0.2, 0.3 + CROSS.length_AB, 0))
    return made


def sentence(call):
    with pytest.raises(SceneError) as caught:
        call()
    message = str(caught.value)
    assert "\n" not in message and message.endswith((".", "?"))
    return message


def test_fourbar_of_the_design():
    scene = fourbar().scene()
    assert scene.links == ("ground", "left", "top", "right")
    assert [j.name for j in scene.joints] == ["ground-left", "left-top", "right-top", "ground-right"]
    placed = scene.joints[2]
    assert np.allclose(placed.rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    assert placed.place(CROSS.pose_B) == pytest.approx([0.4, 0.3 + CROSS.length_AB, 0])
    (drive,) = scene.drives
    term = DriveTerm(1.0, "translation", "ground", "top", (1, 0, 0), (0.2, 0.3 + CROSS.length_AB, 0))
    assert drive == Drive("top", (term,))
    assert scene.gravity is None and scene.loads == () and scene.supports == ()


@pytest.mark.parametrize("axis", ["x", "-y", "z", (1, 2, 3)])
def test_joint_axes_are_a_rotation(axis):
    made = Mechanism()
    made.link("arm")
    z = {"x": (1, 0, 0), "-y": (0, -1, 0), "z": (0, 0, 1)}.get(axis, axis)
    toward = np.cross(z, (0.3, 0.5, -0.7))
    placed = made.join("ground", "arm", CROSS, at=(0, 0, 0), axis=axis, toward=toward)
    R = np.array(placed.rotation)
    assert np.allclose(R.T @ R, np.eye(3), atol=1e-15) and np.linalg.det(R) == pytest.approx(1)
    assert np.allclose(R[:, 2], np.array(z) / np.linalg.norm(z))
    assert np.allclose(R[:, 0], toward / np.linalg.norm(toward))


def test_default_names_of_drives():
    made = lever()
    assert made.actuate("arm", about="z").name == "arm"
    assert made.actuate("arm", along="x", at=(0, 0, 0)).name == "arm.x"
    assert made.actuate("arm", about="-x").name == "arm.rx"
    assert made.actuate("arm", along=(1, 1, 0), at=(0, 0, 0)).name == "arm.2"
    assert made.support("arm", along="z", at=(0, 0, 0)).name == "arm.held"
    assert made.load("arm", moment=(0, 0, 1)).name == "arm.load"
    assert made.load("arm", moment=(0, 0, 2)).name == "arm.load.2"


def test_a_joint_alone():
    guide = ksd.ParallelGuide(STEEL, length=60 * mm, thickness=0.3 * mm, width=20 * mm, spacing=60 * mm)
    scene = ksd.Mechanism.of_joint(guide).scene()
    assert scene.links == ("ground", "B") and [d.name for d in scene.drives] == ["stroke"]
    wire = ksd.Mechanism.of_joint(ksd.WireFlexure(STEEL, length=60 * mm, diameter=1 * mm)).scene()
    assert len(wire.leaves) == 1 and not wire.drives and not wire.joints
    with pytest.raises(ksd.SceneError, match="is not a joint; make one"):
        ksd.Mechanism.of_joint(3)


@pytest.mark.parametrize(
    "words, said",
    [
        (3, "report = 3: give a mapping"),
        ({"lnk": "B"}, "report: key 'lnk' is unknown; did you mean \"link\""),
        ({"link": "C"}, "report: link 'C' does not exist"),
        ({"at": (0, 1)}, "report: at = "),
        ({"along": "w"}, "report: along = 'w' is not a direction"),
        (
            {"freed": "anlge"},
            "report: freed = 'anlge': there is no drive or support of that name; did you mean \"angle\"",
        ),
    ],
)
def test_what_a_report_is_about_is_checked(words, said):
    scene = Mechanism.of_joint(CROSS)
    with pytest.raises(SceneError, match=re.escape(said)):
        scene.report = words
    assert scene.report is None


def test_what_a_report_is_about_is_written_back(tmp_path):
    scene = Mechanism.of_joint(CROSS)
    scene.report = {"link": scene.ground, "at": (0, 0.1, 0), "along": "-x", "freed": ["angle"]}
    ksd.save_scene(scene, tmp_path / "a.toml")
    again = ksd.load_scene(tmp_path / "a.toml")[0].report
    assert (
        again
        == scene.report
        == {"link": "ground", "at": (0, 0.1, 0), "along": (-1, 0, 0), "freed": ("angle",)}
    )
    text = (tmp_path / "a.toml").read_text()
    (tmp_path / "b.toml").write_text(text.replace("freed =", "feed ="))
    with pytest.raises(
        ksd.SceneFileError, match=r"\[report\]: key 'feed' is unknown; did you mean \"freed\""
    ):
        ksd.load_scene(tmp_path / "b.toml")


def test_joint_drive_is_the_relative_angle():
    made = fourbar()
    drive = made.actuate_joint("left-top", name="knee")
    (term,) = drive.terms
    assert (term.kind, term.base, term.link, term.direction) == ("rotation", "left", "top", (0, 0, 1))
    assert made.actuate(joint="right-top").name == "right-top"


def test_combined_drive():
    made = fourbar()
    sway = made.displacement("top", "x", at=(0, 0.3, 0)) * 0.5
    turn = made.rotation("top", "z", relative_to="left")
    drive = made.actuate(terms=sway - turn, name="mix")
    assert [t.coefficient for t in drive.terms] == [0.5, -1.0]
    assert [t.base for t in drive.terms] == ["ground", "left"]
    assert len(sway + turn + turn) == 3 and len((2 * sway) + (turn + sway)) == 3
    assert made.actuate(terms=made.rotation("left", "z"), name="one").terms[0].link == "left"


def test_masses_loads_and_gravity():
    made = lever()
    made.mass("arm", mass=1.0, inertia=(1, 2, 3), at=(0, 0, 0.1))
    made.link("tip", mass=0.5, at=(0, 0, 0))
    made.join("arm", "tip", CROSS, **PLACE)
    made.gravity = (0, -9.81, 0)
    push = made.load("tip", force=(1, 0, 0), at=(0.1, 0, 0), following=np.True_)
    scene = made.scene()
    assert push.following is True
    assert scene.masses[0].inertia == ((1, 0, 0), (0, 2, 0), (0, 0, 3))
    assert scene.masses[1].link == "tip" and scene.gravity == (0, -9.81, 0)
    assert push.moment == (0, 0, 0)


def test_free_form_leaves_and_wires():
    made = Mechanism("guide")
    stage = made.link("stage")
    made.leaf(
        made.ground, stage, start=(0, 0, 0), end=(0.1, 0, 0), width_axis="z", section=BLADE, material=STEEL
    )
    made.wire(
        made.ground, stage, start=(0, 0.1, 0), end=(0.1, 0.1, 0), diameter=1 * mm, material=STEEL, elements=3
    )
    scene = made.scene()
    assert [leaf.name for leaf in scene.leaves] == ["leaf", "wire"]
    assert (scene.leaves[0].leaf.start_block, scene.leaves[0].leaf.end_block) == ("ground", "stage")
    assert scene.leaves[1].leaf.elements == 3


def test_constraints_without_a_name_are_numbered_and_a_used_name_is_named():
    made = Mechanism("stage")
    table = made.link("table")
    fold = FoldedLeaf(STEEL, length=40 * mm, thickness=0.3 * mm, width=20 * mm)
    for x in (0.0, 0.1):
        made.constrain(made.ground, table, fold, at=(x, 0, 0), axis="z", toward="y")
    names = {leaf.name.split("/")[0] for leaf in made.scene().leaves}
    assert len(names) == 2 and "ground-table" in names
    with pytest.raises(SceneError, match="the name 'ground-table' is used already"):
        made.constrain(made.ground, table, fold, at=(0.2, 0, 0), axis="z", toward="y", name="ground-table")
    assert len(made.scene().leaves) == 4


# Bad sentences


@pytest.mark.parametrize(
    ("say", "words"),
    [
        (lambda m: m.link("arm"), ["'arm' exists already"]),
        (lambda m: m.link("ground"), ["'ground' exists already"]),
        (lambda m: m.link(""), ["link name = ''"]),
        (lambda m: m.link(3), ["link name = 3"]),
        (lambda m: m.link("x", inertia=(1, 1, 1)), ["inertia", "without mass"]),
        (lambda m: m.link("x", mass=1), ["'at' is missing"]),
        (lambda m: m.join("ground", "amr", CROSS, **PLACE), ["'ground-amr'", "'amr'", 'mean "arm"']),
        (lambda m: m.join("ground", 7, CROSS, **PLACE), ["7 is not a link"]),
        (lambda m: m.join("ground", lever().link("x"), CROSS, **PLACE), ["another mechanism"]),
        (lambda m: m.join("arm", "arm", CROSS, **PLACE), ["with itself"]),
        (lambda m: m.join("ground", "arm", "cross", **PLACE), ["'cross' is not a joint"]),
        (lambda m: m.join("ground", "arm", CROSS, **{**PLACE, "toward": "z"}), ["0 degrees"]),
        (lambda m: m.join("ground", "arm", CROSS, **{**PLACE, "axis": "up"}), ["axis = 'up'"]),
        (lambda m: m.join("ground", "arm", CROSS, **{**PLACE, "at": (0, 0, math.nan)}), ["at[2] = nan"]),
        (lambda m: m.join("ground", "arm", CROSS, **PLACE, name="ground-arm"), ["used already"]),
        (lambda m: m.join("ground", "arm", CROSS, **PLACE, name=""), ["name = ''"]),
        (lambda m: m.wire("ground", "arm", diameter=0, material=STEEL, start=(0, 0, 0), end=(1, 0, 0)),
         ["wire", "diameter = 0"]),
        (lambda m: m.actuate("arm"), ["'arm'", "along", "about"]),
        (lambda m: m.actuate("arm", along="x", about="z", at=(0, 0, 0)), ["along", "about"]),
        (lambda m: m.actuate("arm", along="x"), ["'at' is missing"]),
        (lambda m: m.actuate(), ["nothing is given"]),
        (lambda m: m.actuate("arm", about="z", joint="ground-arm"), ["link and joint"]),
        (lambda m: m.actuate("leg", about="z"), ["'leg' does not exist"]),
        (lambda m: m.actuate("arm", about="z", relative_to="arm"), ["relative to itself"]),
        (lambda m: m.actuate("arm", about=(0, 0, 0)), ["no length"]),
        (lambda m: m.actuate(joint="ground-leg"), ["'ground-leg' does not exist", 'mean "ground-arm"']),
        (lambda m: m.actuate(terms=()), ["at least one drive term"]),
        (lambda m: m.actuate(terms=[3]), ["at least one drive term"]),
        (lambda m: m.actuate(terms=0 * m.rotation("arm", "z")), ["coefficient = 0"]),
        (lambda m: m.actuate(terms=DriveTerm(1, "rotation", "ground", "leg", [0, 0, 1], [0] * 3)), ["'leg'"]),
        (lambda m: DriveTerm(1, "spin", "ground", "arm", (0, 0, 1), (0, 0, 0)), ["kind = 'spin'"]),
        (lambda m: DriveTerm(1, "rotation", "arm", "arm", (0, 0, 1), (0, 0, 0)), ["relative to itself"]),
        (lambda m: [m.actuate("arm", about="z", name="a"), m.actuate("arm", about="x", name="a")],
         ["'a' is used already"]),
        (lambda m: m.load("arm"), ["'arm.load'", "force, moment"]),
        (lambda m: m.load("arm", force=(1, 0, 0)), ["'at' is missing"]),
        (lambda m: m.load("arm", moment=(1, 0, math.nan)), ["moment[2] = nan"]),
        (lambda m: m.load("arm", moment=(1, 0, 0), following=1), ["following = 1", "True or False"]),
        (lambda m: [m.load("arm", moment=(1, 0, 0), name="p") for _ in range(2)], ["'p' is used already"]),
        (lambda m: m.mass("arm", mass=-1, at=(0, 0, 0)), ["mass = -1 kg"]),
        (lambda m: m.mass("arm", mass=1, at=(0, 0, 0), inertia=(1, 2)), ["inertia = (1, 2)"]),
        (lambda m: m.mass("arm", mass=1, at=(0, 0, 0), inertia=[[1, 2, 0], [0, 1, 0], [0, 0, 1]]), ["sym"]),
        (lambda m: m.mass("arm", mass=1, at=(0, 0, 0), inertia=(1, -1, 1)), ["negative"]),
        (lambda m: setattr(m, "gravity", (0, -math.inf, 0)), ["gravity[1] = -inf"]),
        (lambda m: setattr(m, "gravity", 9.81), ["gravity = 9.81", "three numbers"]),
        (lambda m: Mechanism(""), ["name = ''"]),
    ],
)  # fmt: skip
def test_bad_sentence(say, words):
    made = lever()
    message = sentence(lambda: say(made))
    assert all(word in message for word in words), message


def test_a_refused_sentence_leaves_nothing_behind():
    made = lever()
    before = made.scene()
    for say in (
        lambda: made.link("x", mass=-1, at=(0, 0, 0)),
        lambda: made.join("ground", "arm", CROSS, at=(0, 0, 0), axis="z", toward="z"),
        lambda: made.actuate("arm", along="x"),
        lambda: made.load("arm", force=(1, 0, 0)),
    ):
        sentence(say)
    assert made.scene() == before


# The whole


def test_link_attached_to_nothing():
    made = lever()
    made.link("loose")
    assert "link 'loose' is attached to nothing" in sentence(made.validate)
    assert "'loose'" in sentence(made.scene)


def test_group_without_path_to_ground():
    made = lever()
    made.links("p", "q")
    made.join("p", "q", CROSS, **PLACE)
    message = sentence(made.validate)
    assert "'p', 'q'" in message and "ground" in message
    made.support("p", along="x", at=(0, 0, 0))
    made.validate()


def test_no_link_at_all():
    assert "has no link" in sentence(Mechanism("empty").validate)


@pytest.mark.parametrize(
    ("first", "second", "same"),
    [
        ({"about": "z"}, {"about": "-z"}, True),
        ({"about": "z"}, {"about": (0, 0, 2), "at": (1, 2, 3)}, True),
        ({"about": "z"}, {"about": "x"}, False),
        ({"along": "x", "at": (0, 0, 0)}, {"along": (3, 0, 0), "at": (0, 0, 0)}, True),
        ({"along": "x", "at": (0, 0, 0)}, {"along": "x", "at": (0, 1, 0)}, False),
        ({"along": "x", "at": (0, 0, 0)}, {"along": "y", "at": (0, 0, 0)}, False),
    ],
)
def test_two_drives_on_one_freedom(first, second, same):
    for other in ("actuate", "support"):
        made = lever()
        made.actuate("arm", **first)
        getattr(made, other)("arm", **second)
        if same:
            message = sentence(made.validate)
            assert "same freedom" in message and "'arm'" in message
        else:
            made.validate()


def test_scaled_combination_is_the_same_freedom():
    made = fourbar()
    a, b = made.rotation("left", "z"), made.rotation("right", "z")
    made.actuate(terms=a - b, name="one")
    made.actuate(terms=(2 * b) + (-2 * a), name="two")
    assert "same freedom" in sentence(made.validate)


def test_scene_made_by_hand_is_checked_too():
    from ksd.scene.rules import check_scene

    scene = lever().scene()
    broken = Scene("x", ("ground", "other"), joints=scene.joints)
    assert "'arm' does not exist" in sentence(lambda: check_scene(broken))
    twice = Scene("x", ("ground", "arm", "arm"), joints=scene.joints)
    assert "'arm' is used for 2 links" in sentence(lambda: check_scene(twice))


# Equality and fingerprint


def test_fingerprint_sees_every_word():
    base = fourbar().scene()
    assert base == fourbar().scene() and base.fingerprint() == fourbar().scene().fingerprint()
    changes = [
        lambda m: m.actuate("left", about="z"),
        lambda m: m.support("left", about="z"),
        lambda m: m.load("left", moment=(0, 0, 1)),
        lambda m: m.mass("left", mass=1, at=(0, 0, 0)),
        lambda m: setattr(m, "gravity", (0, 0, -9.81)),
        lambda m: m.wire("left", "right", diameter=1 * mm, material=STEEL, start=(0, 0, 0), end=(0.4, 0, 0)),
    ]
    prints = {base.fingerprint()}
    for change in changes:
        made = fourbar()
        change(made)
        prints.add(made.scene().fingerprint())
    assert len(prints) == len(changes) + 1


def test_fingerprint_samples_curvature_functions():
    def guide(slope):
        made = Mechanism("guide")
        made.link("stage")
        words = {
            "width_axis": "z",
            "section": BLADE,
            "material": STEEL,
            "curve": FreeCurve(0.1, lambda s: (0, 0, slope * s)),
        }
        made.leaf("ground", "stage", start=(0, 0, 0), end=(0.1, 0, 0), **words)
        return made.scene().fingerprint()

    assert guide(1.0) == guide(1.0) != guide(2.0)


def test_fingerprint_is_the_same_in_another_process():
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import test_mechanism as t;"
        "print(t.fourbar().scene().fingerprint())"
    )
    from pathlib import Path

    run = subprocess.run(
        [sys.executable, "-c", code, str(Path(__file__).parent)], capture_output=True, text=True, check=True
    )
    assert run.stdout.strip() == fourbar().scene().fingerprint()


numbers = st.one_of(st.floats(), st.integers(), st.none(), st.text(max_size=3), st.booleans())
vectors = st.one_of(
    st.sampled_from(["x", "-y", "z", "w"]),
    st.lists(numbers, max_size=4),
    st.tuples(*[st.floats()] * 3),
    numbers,
)


@settings(max_examples=300, deadline=None)
@given(at=vectors, axis=vectors, toward=vectors)
def test_any_placing_is_a_rotation_or_a_sentence(at, axis, toward):
    made = Mechanism()
    made.link("arm")
    try:
        placed = made.join("ground", "arm", CROSS, at=at, axis=axis, toward=toward)
    except SceneError:
        return
    R = np.array(placed.rotation)
    assert np.allclose(R.T @ R, np.eye(3), atol=1e-12)
    assert np.isfinite(placed.origin).all()


@settings(max_examples=200, deadline=None)
@given(
    length=numbers, angle=numbers, thickness=numbers, widths=st.one_of(numbers, st.lists(numbers, max_size=3))
)
def test_any_cross_flexure_is_sound_or_a_sentence(length, angle, thickness, widths):
    try:
        joint = CrossFlexure(STEEL, length=length, angle=angle, thickness=thickness, widths=widths)
    except SceneError:
        return
    assert joint.length > 0 and all(w > 0 for w in joint.widths) and joint.shape()["width_ratio"] > 0


def test_a_misspelt_attribute_is_refused():
    scene = Mechanism("arm")
    with pytest.raises(
        SceneError, match=r"a mechanism has no 'gravty' to be set; did you mean \"gravity\"\?"
    ):
        scene.gravty = (0, 0, -9.81)
    scene.gravity = (0, 0, -9.81)
    scene.name = "other"


def test_a_negative_zero_is_listed_as_zero():
    scene = Mechanism()
    scene.load(scene.link("tip"), force=(-0.0, 1.0, 0.0), at=(0, 0, 0))
    assert "force (0, 1, 0) N" in str(scene)
