"""Materials, leaf springs, wires, joints and families: meaning, defaults, and the sentence each bad value gets."""

import math
import subprocess
import sys
import warnings
from dataclasses import fields, replace

import numpy as np
import pytest

import ksd
from ksd.checks import dot
from ksd.errors import SceneError
from ksd.scene import (
    Butterfly,
    CircularNotch,
    CrossFlexure,
    DrawnJoint,
    FilletedNotch,
    FreeCurve,
    Joint,
    Leaf,
    Material,
    Mechanism,
    Motion,
    StiffenedMiddle,
    Taper,
    Varying,
    joint_families,
    joint_family,
    make_joint,
    wire,
)
from ksd.scene.profile import ProfilePart
from ksd.section import circle, rectangle
from ksd.training.catalogue import FAMILY_DESIGNS
from ksd.units import GPa, deg, mm

STEEL = Material(200 * GPa, G=76.9 * GPa, density=7800)
BLADE = rectangle(1 * mm, 40 * mm)
SIZES = {"length": 0.1, "angle": 45 * deg, "thickness": 1 * mm, "widths": (40 * mm, 20 * mm)}
TURN = Motion("angle", "rotation", "z", (-1.0, 1.0))


def leaf(**words):
    given = {"start": (0, 0, 0), "end": (0.1, 0, 0), "width_axis": "z", "section": BLADE, "material": STEEL}
    return Leaf(**{**given, **words})


def cross(**words):
    return CrossFlexure(words.pop("material", STEEL), **{**SIZES, **words})


def drawn(**words):
    given = {"blocks": {"A": (0, 0, 0), "B": (0.1, 0, 0)}, "leaves": [leaf()], "motions": [TURN]}
    return DrawnJoint("mine", **{**given, **words})


def test_a_truth_of_numpy_counts_in_a_drawn_joint():
    joint = drawn(windows=np.True_, held_by_others=np.False_)
    assert joint.windows is True and joint.held_by_others is False


def sentence(call):
    with pytest.raises(SceneError) as caught:
        call()
    message = str(caught.value)
    assert "\n" not in message and message.endswith((".", "?"))
    return message


# Materials


def test_third_modulus_follows():
    assert pytest.approx(200e9 / 2.6) == Material(200e9, nu=0.3).G
    assert pytest.approx(192.5e9) == Material(G=77e9, nu=0.25).E
    assert STEEL.nu == pytest.approx(200 / 153.8 - 1)
    assert Material(200e9, G=200e9 / 2.6, nu=0.3).nu == 0.3
    assert Material(200e9, nu=0.0).G == 100e9
    assert Material(200 * GPa, G=76.9 * GPa, density=7800) == STEEL
    assert STEEL.density == 7800.0 and Material(1, G=1).density is None


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: Material(-1, G=1), ["Material", "E = -1 Pa", "positive"]),
        (lambda: Material(0, G=1), ["E = 0", "positive"]),
        (lambda: Material(1, G=math.nan), ["G = nan", "finite"]),
        (lambda: Material(1, nu=0.6), ["nu", "0.6", "between -1 and 0.5"]),
        (lambda: Material(1, nu=-1), ["nu", "-1", "between"]),
        (lambda: Material(1), ["two of E, G and nu", "only E"]),
        (lambda: Material(), ["two of E, G and nu", "none"]),
        (lambda: Material(200e9, G=100e9, nu=0.3), ["contradict", "give two"]),
        (lambda: Material(1, G=1, density=0, name="foam"), ["'foam'", "density = 0", "positive"]),
        (lambda: Material("200 GPa", G=1), ["E = '200 GPa'", "not a number"]),
        (lambda: Material(1, G=1, name=3), ["name = 3", "text"]),
    ],
)
def test_bad_material(call, words):
    message = sentence(call)
    assert all(word in message for word in words), message


# Leaf springs


def test_leaf_axes_are_right_handed_and_follow_the_width():
    tilted = leaf(end=(0.03, 0.04, 0))
    assert tilted.length == pytest.approx(0.05)
    assert np.allclose(tilted.axes, [[0.6, -0.8, 0], [0.8, 0.6, 0], [0, 0, 1]])
    assert np.linalg.det(leaf(width_axis="-y").axes) == pytest.approx(1.0)


def test_wire_needs_no_width_axis():
    made = wire(diameter=1 * mm, material=STEEL, start=(0, 0, 0), end=(0.1, 0.1, 0.1))
    assert made.section == circle(1 * mm)
    assert np.allclose(made.axes.T @ made.axes, np.eye(3))


def test_leaf_keeps_mesh_and_curvature():
    curve = FreeCurve(1.0, lambda s: (0, 0, s))
    chord = float(np.linalg.norm(curve.line(1.0)[0]))
    made = leaf(elements=3, orders=[4, 3, 5], end=(chord, 0, 0), curve=curve)
    assert (made.elements, made.orders) == (3, (4, 3, 5))
    assert tuple(made.curve.curvature(0.5)) == (0, 0, 0.5)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: leaf(end=(0, 0, 0)), ["leaf 'leaf'", "length is 0"]),
        (lambda: leaf(end=(1e308, 0, 0), start=(-1e308, 0, 0)), ["too large"]),
        (lambda: leaf(start=(0, 0)), ["start = (0, 0)", "three numbers"]),
        (lambda: leaf(start="abc"), ["start = 'abc'", "three numbers"]),
        (lambda: leaf(start=np.zeros((3, 1))), ["start", "three numbers"]),
        (lambda: leaf(start=(0, math.inf, 0)), ["start[1] = inf", "finite"]),
        (lambda: leaf(width_axis=(1, 0, 0)), ["width_axis", "perpendicular"]),
        (lambda: leaf(width_axis=(0.1, 0, 1)), ["perpendicular", "nearest: (0, 0, 0.995"]),
        (lambda: leaf(width_axis=(0, 0, 0)), ["width_axis", "no length"]),
        (lambda: leaf(width_axis="w"), ["width_axis = 'w'", "not a direction"]),
        (lambda: leaf(section=3), ["section = 3", "Section"]),
        (lambda: leaf(material="steel"), ["material = 'steel'", "Material"]),
        (lambda: leaf(elements=0), ["elements = 0", "at least 1"]),
        (lambda: leaf(elements=2.5), ["elements = 2.5", "whole number"]),
        (lambda: leaf(orders=(4, 3)), ["orders = (4, 3)", "three"]),
        (lambda: leaf(orders=(4, 3, 0)), ["orders = 0", "at least 1"]),
        (lambda: leaf(curve=3), ["curve = 3", "Curve"]),
        (lambda: leaf(name=""), ["name = ''"]),
        (lambda: leaf(name="a\nb"), ["name", "printable"]),
        (lambda: leaf(start_block=""), ["start_block"]),
        (
            lambda: wire(diameter=0, material=STEEL, start=(0, 0, 0), end=(1, 0, 0)),
            ["diameter = 0", "positive"],
        ),
    ],
)
def test_bad_leaf(call, words):
    message = sentence(call)
    assert all(word in message for word in words), message


# The cross flexure


def test_cross_flexure_geometry():
    # acceptance.md B
    joint = cross()
    D0, h = 0.1 * math.cos(math.pi / 4), 0.05 * math.sin(math.pi / 4)
    inner, low, high = joint.leaves()
    assert inner.start == pytest.approx((0, -h, 0)) and inner.end == pytest.approx((D0, h, 0))
    assert low.start == pytest.approx((0, h, -0.03)) and low.end == pytest.approx((D0, -h, -0.03))
    assert high.start == pytest.approx((0, h, 0.03)) and high.end == pytest.approx((D0, -h, 0.03))
    assert [f.section.width for f in (inner, low, high)] == [0.04, 0.02, 0.02]
    assert all(f.length == pytest.approx(0.1) and f.width_axis == (0, 0, 1) for f in (inner, low, high))
    assert joint.length_AB == pytest.approx(D0)
    assert joint.blocks() == {"A": (0.0, 0.0, 0.0), "B": joint.pose_B}
    assert joint.shape() == {"angle": pytest.approx(math.pi / 4), "width_ratio": 1.0}
    (motion,) = joint.motions
    assert (motion.kind, motion.axis) == ("rotation", (0, 0, 1))
    assert motion.range == pytest.approx((-75 * deg, 75 * deg))


def test_cross_flexure_spacing():
    assert cross(gap=5 * mm).spacing == pytest.approx(0.035)
    assert cross(spacing=0.035).spacing == 0.035
    assert cross(elements=4, orders=(3, 2, 4)).leaves()[0].elements == 4
    assert cross(orders=(3, 2, 4)).leaves()[2].orders == (3, 2, 4)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ({"length": 0}, ["CrossFlexure", "length = 0 m", "positive"]),
        ({"length": math.nan}, ["length = nan", "finite"]),
        ({"thickness": -1e-3}, ["thickness = -0.001 m", "positive"]),
        ({"thickness": 0.06}, ["thickness = 0.06 m", "half the leaf length"]),
        ({"angle": 0}, ["angle = 0 deg", "between 0 and 90 deg"]),
        ({"angle": 45}, ["angle = 2578", "between 0 and 90 deg"]),
        ({"widths": 0.04}, ["widths = 0.04", "two lengths"]),
        ({"widths": (0.04,)}, ["widths", "two lengths"]),
        ({"widths": (0.04, 0)}, ["widths[1] (outer) = 0", "positive"]),
        ({"gap": -1e-3}, ["gap = -0.001", "zero or positive"]),
        ({"spacing": 0}, ["spacing = 0", "positive"]),
        ({"spacing": 0.03, "gap": 0}, ["gap", "spacing", "give one"]),
        ({"material": None}, ["material = None", "Material"]),
        ({"elements": -1}, ["elements = -1"]),
    ],
)
def test_bad_cross_flexure(words, expected):
    message = sentence(lambda: cross(**words))
    assert all(word in message for word in expected), message


# Families


def test_families_by_name():
    assert joint_family("cross_flexure") is CrossFlexure
    assert make_joint("cross_flexure", material=STEEL, **SIZES) == cross()
    for name, family in joint_families().items():
        assert family.family == name and issubclass(family, Joint)


@pytest.mark.parametrize("family", sorted(FAMILY_DESIGNS))
def test_leaves_of_families_pass_the_checks_of_a_leaf(family):
    """They are drawn past them, being right by the bounds of their family: made anew with all checks they are the same."""
    entry = FAMILY_DESIGNS[family]
    for end in ("low", "high"):
        joint = entry.make(**{p.name: getattr(p, end) for p in entry.parameters})
        for leaf in joint.leaves():
            again = replace(leaf)
            assert again == leaf and hash(again) == hash(leaf)
            assert all(getattr(again, f.name) == getattr(leaf, f.name) for f in fields(leaf))


def test_a_leaf_of_a_family_without_length_is_refused():
    """What rounding leaves of a thousandth beside 1e26."""
    joint = Butterfly(STEEL, length=1e-3, inner=1e26, half_angle=10 * deg, thickness=1e-5, width=1e-2)
    message = sentence(lambda: joint.leaves())
    assert "its length is 0 m" in message


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (
            lambda: joint_family("cross_flexur"),
            ["'cross_flexur'", "unknown", 'did you mean "cross_flexure"?'],
        ),
        (lambda: joint_family("hovercraft"), ["unknown", "known: ", "cross_flexure"]),
        (lambda: joint_family(3), ["3", "unknown"]),
        (lambda: make_joint("cross_flexure", material=STEEL, **SIZES, lenght=1), ['"length"', "'lenght'"]),
        (lambda: make_joint("cross_flexure", material=STEEL), ["'length' is missing"]),
    ],
)
def test_unknown_family_or_parameter(call, words):
    message = sentence(call)
    assert all(word in message for word in words), message


# Joints drawn by the user


def test_drawn_joint_answers_like_a_family():
    joint = drawn(shape={"ratio": 0.5}, length=0.2)
    assert (joint.family, joint.length, joint.length_AB) == ("mine", 0.2, 0.1)
    assert joint.shape() == {"ratio": 0.5} and joint.motions == (TURN,)
    assert drawn().length == pytest.approx(0.1)
    assert drawn() == drawn() and hash(drawn()) == hash(drawn())


def test_drawn_joint_with_an_internal_block():
    first, second = leaf(end_block="mid", end=(0.05, 0, 0)), leaf(start_block="mid", start=(0.05, 0, 0))
    joint = drawn(blocks={"A": (0, 0, 0), "B": (0.1, 0, 0), "mid": (0.05, 0, 0)}, leaves=[first, second])
    assert set(joint.blocks()) == {"A", "B", "mid"} and joint.pose_B == (0.1, 0, 0)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: drawn(blocks={"A": (0, 0, 0)}), ["joint 'mine'", "'B' is missing"]),
        (lambda: drawn(blocks={"A": (1, 0, 0), "B": (0.1, 0, 0)}), ["'A'", "origin"]),
        (lambda: drawn(leaves=[]), ["at least one Leaf"]),
        (lambda: drawn(leaves=[leaf(end_block="C")]), ["'C'", "known: A, B"]),
        (lambda: drawn(leaves=[leaf(end_block="A")]), ["same block 'A'"]),
        (lambda: drawn(blocks={"A": (0, 0, 0), "B": (1, 0, 0), "C": (2, 0, 0)}), ["block 'C'", "add a leaf"]),
        (lambda: drawn(motions=[]), ["at least one Motion"]),
        (lambda: drawn(length=-1), ["length = -1", "positive"]),
        (lambda: drawn(blocks={"A": (0, 0, 0), "B": (0, 0, 0)}), ["length", "positive"]),
        (lambda: drawn(shape={"ratio": math.inf}), ["shape 'ratio'", "finite"]),
        (lambda: Motion("m", "twist", "z", (-1, 1)), ["kind = 'twist'", '"rotation"']),
        (lambda: Motion("m", "rotation", "z", (1, -1)), ["range = (1, -1)", "rise"]),
        (lambda: Motion("m", "rotation", "z", (1,)), ["range = (1,)", "two numbers"]),
        (lambda: Motion("m", "rotation", "q", (-1, 1)), ["axis = 'q'", "not a direction"]),
    ],
)
def test_bad_drawn_joint(call, words):
    message = sentence(call)
    assert all(word in message for word in words), message


def test_scene_imports_numpy_alone():
    heavy = "{'numba', 'scipy', 'h5py', 'skfem', 'matplotlib'}"
    code = f"import sys, ksd.scene; sys.exit(bool({heavy} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_drawn_joint_and_a_link_print_as_what_they_are():
    scene = Mechanism("printed")
    assert f"{scene.link('jaw')}, {scene.ground}" == "jaw, ground"
    assert str(drawn(leaves=[leaf(name="strip")])).split("\n") == [
        "mine: blocks A, B",
        "motion angle: rotation, -57.2958 to 57.2958 deg",
        "leaf spring strip: A to B, 100 mm",
    ]


@pytest.mark.parametrize(
    "profile",
    [
        Taper(thickness=(1 * mm, 0.3 * mm), width=(40 * mm, 0.6 * mm)),
        CircularNotch(radius=5 * mm, minimum=0.2 * mm, width=8 * mm),
        FilletedNotch(length=20 * mm, radius=3 * mm, minimum=0.5 * mm, width=8 * mm),
        StiffenedMiddle(thickness=0.4 * mm, width=20 * mm, middle=2 * mm, part=0.6),
        Varying(lambda s: rectangle((1 + s) * mm, 5 * mm) if s < 0.5 else circle(2 * mm), (0.5,)),
        ProfilePart(FilletedNotch(length=20 * mm, radius=3 * mm, minimum=0.5 * mm, width=8 * mm), (0.1, 0.7)),
    ],
    ids=lambda profile: type(profile).__name__,
)  # fmt: skip
def test_sections_of_a_profile_are_those_at_each_place(profile):
    places = np.linspace(0.013, 0.987, 37)
    found, each = profile.sections(places), [profile.section(s) for s in places.tolist()]
    for name, values in found._asdict().items():
        assert values == pytest.approx([getattr(q, name) for q in each], rel=1e-12), name


def test_sizes_of_notches():
    """At their middle, where a fillet ends, and at their ends, by hand."""
    round_, filleted = (
        CircularNotch(radius=5 * mm, minimum=0.2 * mm, width=8 * mm),
        FilletedNotch(length=20 * mm, radius=3 * mm, minimum=0.5 * mm, width=8 * mm),
    )
    assert round_.sections(np.array([0.0, 0.2, 0.5])).thickness == pytest.approx(
        [10.2 * mm, 2.2 * mm, 0.2 * mm]
    )
    assert filleted.sections(np.array([0.0, 0.06, 0.15, 0.5])).thickness == pytest.approx(
        [6.5 * mm, 0.5 * mm + 6 * mm * (1 - math.sqrt(0.64)), 0.5 * mm, 0.5 * mm]
    )


def test_a_part_of_a_profile_breaks_where_the_whole_does():
    whole = Varying(lambda s: rectangle(1e-3 * (1 + s), 0.01), breaks=(0.2, 0.5, 0.8))
    assert ProfilePart(whole, (0.25, 0.85)).breaks == pytest.approx([5 / 12, 11 / 12])


def six_digits(direction):
    """A direction as files with six digits have it."""
    return tuple(float(f"{c:.5f}") for c in direction)


@pytest.mark.parametrize("off, warned", [(0.5e-6, False), (2e-6, True), (0.9e-5, True)])
def test_width_axes_of_six_digits_are_made_perpendicular(off, warned):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        made = leaf(width_axis=(off, 0, 1))
    assert abs(made.axes[:, 0] @ made.axes[:, 2]) < 1e-15
    assert bool(said) == warned
    if warned:
        assert made.width_axis == (0, 0, 1)
        (one,) = said
        assert one.filename == __file__ and issubclass(one.category, ksd.SceneWarning)
        assert "leaf 'leaf': width_axis is" in str(one.message) and "rad off a right angle" in str(
            one.message
        )


@pytest.mark.filterwarnings("ignore::ksd.SceneWarning")
def test_directions_of_six_digits_are_accepted_everywhere():
    """Random axes rounded to five digits behind the point: leaf springs, joints, and all directions in a plane."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0].T
        one, two = map(six_digits, axes[:2])
        made = leaf(start=(0, 0, 0), end=one, width_axis=two)
        assert abs(dot(made.width_axis, made.axes[:, 0])) <= 1e-6
        m = ksd.Mechanism()
        b = m.link("b")
        m.join("ground", b, CrossFlexure(STEEL, length=0.1, angle=0.8, thickness=1e-3, widths=(0.04, 0.02)),
               at=(0, 0, 0), axis=one, toward=two)  # fmt: skip
        rotation = np.array(m.scene().joints[0].rotation)
        assert np.abs(rotation.T @ rotation - np.eye(3)).max() < 1e-14
    m = ksd.Mechanism(plane="xy")
    b = m.link("b")
    words = {"section": rectangle(1 * mm, 8 * mm), "material": STEEL}
    m.leaf("ground", b, start=(0, 0, 0), end=(0.1, 0, 5e-7), **words)
    slider = m.slider(b, along=(1, 0, 5e-6), at=(0.1, 0, 0))
    drive = m.actuate(b, along=(0.6, 0.8, -3e-6), at=(0.1, 0, 0), name="d")
    support = m.support(b, about=(3e-6, 0, 1), name="s")
    assert slider.axis[2] == drive.terms[0].direction[2] == 0.0 and support.terms
    with pytest.raises(SceneError, match="leaves the plane xy"):
        m.actuate(b, along=(0.6, 0.8, 2e-5), at=(0.1, 0, 0), name="e")
    with pytest.raises(SceneError, match="perpendicular"):
        leaf(width_axis=(1.2e-5, 0, 1))
