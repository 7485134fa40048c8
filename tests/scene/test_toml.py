"""Scene files: the same scene as in Python, exact round trips, and a sentence for every mistake."""

import math
import os
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import ksd.scene
from ksd.errors import SceneError, SceneFileError, SceneWarning
from ksd.scene import CrossFlexure, DrawnJoint, FreeCurve, Leaf, Material, Mechanism, Motion
from ksd.scene.json_schema import json_schema
from ksd.scene.toml_file import load_scene, save_scene
from ksd.scene.toml_lines import LineNumbers
from ksd.scene.toml_table import find_unit, quantity
from ksd.section import circle, numbers, polygon, rectangle, tube
from ksd.units import DIMENSIONS, deg

SHIPPED = Path(ksd.scene.__file__).parent.parent / "scenes"
STEEL = Material(200e9, G=76.9e9, density=7800, name="steel")
CROSS = CrossFlexure(STEEL, length=0.1, angle=math.pi / 4, thickness=1e-3, widths=(0.04, 0.02))

GOOD = """
name = "lever"
gravity = [0, -9.81, 0]
links = ["arm"]
[material.steel]
E = "200 GPa"
G = "76.9 GPa"
[section.blade]
kind = "rectangle"
thickness = "1 mm"
width = "40 mm"
[joint.cross]
family = "cross_flexure"
material = "steel"
length = "100 mm"
angle = "45 deg"
thickness = "1 mm"
widths = ["40 mm", 0.02]
[[join]]
a = "ground"
b = "arm"
joint = "cross"
at = [0, 0, "1 mm"]
axis = "z"
toward = "x"
[[leaf]]
a = "ground"
b = "arm"
start = [0, 0.2, 0]
end = [0.1, 0.2, 0]
width_axis = "z"
section = "blade"
material = "steel"
elements = 3
[[wire]]
a = "ground"
b = "arm"
start = [0, 0.3, 0]
end = [0.1, 0.3, 0]
diameter = "0.5 mm"
material = "steel"
[[actuate]]
link = "arm"
about = "z"
value = "30 deg"
[[support]]
link = "arm"
along = "z"
at = [0, 0, 0]
[[load]]
link = "arm"
force = ["2 N", 0, 0]
moment = [0, 0, "3 mNm"]
at = [0, 0, 0]
following = true
[[mass]]
link = "arm"
mass = "500 g"
at = [0.1, 0, 0]
inertia = [1e-3, 1e-3, 2e-3]
[options]
method = "reduced"
"""


@pytest.fixture
def read(tmp_path):
    def load(text, **options):
        file = tmp_path / "case.toml"
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
        return load_scene(file, **options)

    return load


def sentence(call):
    with pytest.raises(SceneError) as caught:
        call()
    message = str(caught.value)
    assert "\n" not in message and message.endswith((".", "?")), message
    return message


def test_good_file_says_the_same_as_python(read):
    found, targets, options = read(GOOD)
    made = Mechanism("lever")
    made.gravity = (0, -9.81, 0)
    arm = made.link("arm")
    steel = Material(200e9, G=76.9e9, name="steel")
    cross = CrossFlexure(steel, length=100 * 1e-3, angle=45 * deg, thickness=1e-3, widths=(40 * 1e-3, 0.02))
    made.join("ground", arm, cross, at=(0, 0, 1e-3), axis="z", toward="x")
    blade = rectangle(1e-3, 40 * 1e-3)
    ends = {"start": (0, 0.2, 0), "end": (0.1, 0.2, 0)}
    made.leaf("ground", arm, **ends, width_axis="z", section=blade, material=steel, elements=3)
    made.wire("ground", arm, start=(0, 0.3, 0), end=(0.1, 0.3, 0), diameter=5e-4, material=steel)
    made.actuate(arm, about="z")
    made.support(arm, along="z", at=(0, 0, 0))
    made.load(arm, force=(2, 0, 0), moment=(0, 0, 3e-3), at=(0, 0, 0), following=True)
    made.mass(arm, mass=0.5, at=(0.1, 0, 0), inertia=(1e-3, 1e-3, 2e-3))
    assert found.scene() == made.scene()
    assert found.scene().fingerprint() == made.scene().fingerprint()
    assert targets == {"arm": pytest.approx(math.pi / 6)}
    assert options == {"method": "reduced"}


def test_shipped_fourbar():
    # acceptance.md C
    made, targets, _ = load_scene(SHIPPED / "fourbar.toml")
    scene = made.scene()
    D0 = 0.1 * math.cos(math.pi / 4)
    assert targets == {"top": pytest.approx(0.3)}
    places = {(j.a, j.b): j.origin for j in scene.joints}
    assert places == {
        ("ground", "left"): (-0.2, 0, 0),
        ("left", "top"): (-0.2, pytest.approx(0.3), 0),
        ("right", "top"): (0.2, pytest.approx(0.3), 0),
        ("ground", "right"): (0.2, 0, 0),
    }
    assert all(j.place(j.joint.pose_B) - j.origin == pytest.approx([0, D0, 0]) for j in scene.joints)
    (term,) = scene.drives[0].terms
    assert (term.kind, term.link, term.direction) == ("translation", "top", (1, 0, 0))
    assert term.point == pytest.approx((0, 0.3 + D0, 0))


@pytest.mark.parametrize("file", sorted(SHIPPED.glob("*[!b].toml")), ids=lambda f: f.stem)
def test_shipped_scenes_load_and_round_trip(file, tmp_path):
    made, targets, options = load_scene(file)
    assert made.name == file.stem and targets
    save_scene(made, tmp_path / "copy.toml", targets=targets, options=options)
    again, same_targets, same_options = load_scene(tmp_path / "copy.toml")
    assert again.scene() == made.scene()
    assert again.scene().fingerprint() == made.scene().fingerprint()
    assert (same_targets, same_options) == (targets, options)


def test_every_unit_has_one_dimension():
    names = [unit for units in DIMENSIONS.values() for unit in units]
    assert len(set(names)) == len(names)
    assert all(next(iter(units.values())) == 1.0 for units in DIMENSIONS.values())


def fits_schema(text, dimension):
    """Whether an editor takes the text for a quantity of this dimension."""
    _, as_text = json_schema()["definitions"][dimension]["anyOf"]
    return re.search(as_text["pattern"], text) is not None


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("100 mm", "length", 0.1),
        (" -1.5e2um", "length", -1.5e-4),
        (".5 m", "length", 0.5),
        ("3. N", "force", 3),
    ],
)
def test_quantities(text, dimension, value):
    assert quantity(text, dimension, "x") == pytest.approx(value)


# One mistake at a time: (what stands in the good file, what is put there, essential words of the sentence)
MISTAKES = [
    ('thickness = "1 mm"\nwidths', 'thickness = "1 deg"\nwidths',
     ["[joint.cross]", "thickness = '1 deg': a length is expected, e.g. '1 mm'"]),
    ('"45 deg"', '"45 mm"', ["[joint.cross]", "angle = '45 mm': an angle is expected", "'45 deg'"]),
    ('"45 deg"', '"45 deeg"', ["angle = '45 deeg'", "unit 'deeg' is unknown", '"deg"']),
    ('"45 deg"', '"steep"', ["angle = 'steep'", "an angle is expected"]),
    ('"45 deg"', '"1e999 deg"', ["angle", "finite"]),
    ('"45 deg"', "nan", ["angle = nan", "finite"]),
    ('"45 deg"', "true", ["angle = True", "not a number"]),
    ('"45 deg"', "[1]", ["angle", "not a number"]),
    ('"45 deg"', "45", ["[joint.cross]", "angle = 2578", "90 deg"]),
    ('"45 deg"', "0x" + "f" * 5000, ["angle", "finite"]),
    ('"45 deg"', "9" * 5000, ["not valid TOML"]),
    ("[[join]]", 'lenght = 1\n[[join]]', ["[joint.cross]", "'lenght' is unknown", '"length"']),
    ('length = "100 mm"', "", ["[joint.cross]", "'length' is missing"]),
    ('length = "100 mm"', "length = -1", ["[joint.cross]", "length = -1", "positive"]),
    ('length = "100 mm"', 'lenth = "100 mm"', ["[joint.cross]: key 'lenth' is unknown; did you mean \"length\"?"]),
    ('widths = ["40 mm", 0.02]', "widths = 0.04", ["widths = 0.04", "two lengths"]),
    ('widths = ["40 mm", 0.02]', 'widths = ["40 N", 0.02]', ["widths[0] = '40 N': a length"]),
    ('"cross_flexure"', '"crossflexure"', ["[joint.cross]", "'crossflexure' is unknown", '"cross_flexure"']),
    ('family = "cross_flexure"', "", ["[joint.cross]", "'family' is missing"]),
    ('family = "cross_flexure"', "family = 3", ["family = 3", "text in quotes"]),
    ('material = "steel"\nlength', 'material = "steal"\nlength', ["no material of that name", '"steel"']),
    ('joint = "cross"', 'joint = "cros"', ["[[join]] 1", "no joint of that name", '"cross"']),
    ('joint = "cross"', "", ["[[join]] 1", "'joint' is missing"]),
    ('b = "arm"\njoint', 'b = "amr"\njoint', ["[[join]] 1", "'amr' does not exist", '"arm"']),
    ('b = "arm"\njoint', 'b = "ground"\njoint', ["[[join]] 1", "with itself"]),
    ('axis = "z"', 'axis = "up"', ["[[join]] 1", "axis = 'up'", "direction"]),
    ('axis = "z"', "axis = [0, 0]", ["axis = [0, 0]", "three numbers"]),
    ('toward = "x"', 'toward = "z"', ["[[join]] 1", "perpendicular"]),
    ('toward = "x"', 'towards = "x"', ["[[join]] 1: key 'towards' is unknown; did you mean \"toward\"?"]),
    ('toward = "x"', 'toward = "x"\ncolour = "red"', ["[[join]] 1", "'colour' is unknown"]),
    ('at = [0, 0, "1 mm"]', "at = 0", ["[[join]] 1", "at = 0", "list of 3"]),
    ('at = [0, 0, "1 mm"]', 'at = [0, 0, "1 kg"]', ["at[2] = '1 kg': a length"]),
    ("[[join]]", "[join]", ["join", "[[join]]"]),
    ("[material.steel]", "[[material]]", ["[material]", "must be a table"]),
    ("[section.blade]", "[section]\nblade = 3\n[section.other]", ["[section.blade] = 3 must be a table"]),
    ('E = "200 GPa"', "E = 0", ["[material.steel]", "E = 0", "positive"]),
    ('E = "200 GPa"', "", ["[material.steel]", "two of E, G and nu"]),
    ('E = "200 GPa"', 'E = "200 mPa"', ["unit 'mPa' may be MPa; write"]),
    ('kind = "rectangle"', 'kind = "rectangel"', ["[section.blade]", '"rectangle"']),
    ('width = "40 mm"', "", ["[section.blade]", "'width' is missing"]),
    ('width = "40 mm"', "width = 0", ["[section.blade]", "width = 0", "positive"]),
    ('section = "blade"', 'section = "blad"', ["[[leaf]] 1", "no section of that name", '"blade"']),
    ("elements = 3", "elements = 0", ["[[leaf]] 1", "elements = 0"]),
    ("elements = 3", "orders = [4, 3]", ["[[leaf]] 1", "orders = [4, 3]"]),
    ('width_axis = "z"', 'width_axis = "x"', ["[[leaf]] 1", "perpendicular"]),
    ('diameter = "0.5 mm"', "diameter = 0", ["[[wire]] 1", "diameter = 0"]),
    ('diameter = "0.5 mm"', 'diameter = "0.5 mm"\nthickness = 1', ["[[wire]] 1", "'thickness' is unknown"]),
    ('value = "30 deg"', 'value = "30 mm"', ["[[actuate]] 1", "value = '30 mm': an angle is expected"]),
    ('about = "z"', "", ["[[actuate]] 1", "along", "about"]),
    ('about = "z"\nvalue = "30 deg"', 'along = "z"', ["[[actuate]] 1", "'at' is missing"]),
    ('about = "z"', 'along = "z"\nat = [0, 0, 0]', ["[[actuate]] 1", "value = '30 deg': a length is expected"]),
    ('[[support]]\nlink = "arm"\nalong = "z"\nat = [0, 0, 0]', '[[support]]\nlink = "arm"\nabout = "-z"',
     ["same freedom", "'arm'"]),
    ("[[support]]", '[[support]]\nvalue = 3', ["[[support]] 1", "'value' is unknown"]),
    ("[[support]]", '[[actuate]]\nterms = [{link = "arm"}]\n[[support]]',
     ["[[actuate.terms]] 1", "along", "about"]),
    ("[[support]]", "[[actuate]]\nterms = [3]\n[[support]]", ["[[actuate.terms]] 1", "must be a table"]),
    ("[[support]]", "[[actuate]]\nterms = []\n[[support]]", ["at least one drive term"]),
    ("[[support]]", '[[actuate]]\njoint = "arm"\n[[support]]',
     ["[[actuate]] 2", "joint 'arm' does not exist"]),
    ("following = true", 'following = "yes"', ["[[load]] 1", "following = 'yes'", "true or false"]),
    ('force = ["2 N", 0, 0]', 'force = ["2 kg", 0, 0]', ["[[load]] 1", "force[0] = '2 kg': a force"]),
    ('mass = "500 g"', "mass = -1", ["[[mass]] 1", "mass = -1"]),
    ("inertia = [1e-3, 1e-3, 2e-3]", 'inertia = ["1", 2, 3]', ["[[mass]] 1", "inertia"]),
    ('links = ["arm"]', "", ["case.toml", "'links' is missing"]),
    ('links = ["arm"]', 'links = "arm"', ["links = 'arm'", "list of names"]),
    ('links = ["arm"]', 'links = ["arm", "arm"]', ["'arm' exists already"]),
    ('links = ["arm"]', 'links = ["arm", "loose"]', ["case.toml", "'loose' is attached to nothing"]),
    ('links = ["arm"]', 'links = ["arm", 3]', ["link name = 3"]),
    ("gravity = [0, -9.81, 0]", "gravity = -9.81", ["gravity = -9.81", "list of 3"]),
    ("gravity = [0, -9.81, 0]", 'gravity = [0, "9.81", 0]', ["gravity[1] = '9.81'", "e.g. '9.81 m/s^2'"]),
    ("gravity = [0, -9.81, 0]", 'gravity = [0, "-9.81 m/s", 0]', ["gravity[1]", "the unit 'm/s' is unknown", "m/s^2"]),
    ("gravity = [0, -9.81, 0]", 'gravity = [0, "-9.81 mm", 0]', ["gravity[1]", "an acceleration is expected"]),
    ('"45 deg"', '"45,5 deg"', ["angle = '45,5 deg'", "write a decimal point"]),
    ("inertia = [1e-3, 1e-3, 2e-3]", 'inertia = ["1 kg m", 1, 1]', ["inertia[0]", "'kg m' is unknown", "kg m^2"]),
    ('moment = [0, 0, "3 mNm"]', 'moment = [0, 0, "3 m N"]', ["moment[2]", "the unit 'm N' is unknown"]),
    ('thickness = "1 mm"\nwidths', "thickness = 10\nwidths",
     ["thickness", "Plain numbers are in SI: thickness = 10 is 10 m: did you mean '10 mm'?"]),
    ("gravity =", "gravty =", ["case.toml", "'gravty' is unknown", '"gravity"']),
    ('name = "lever"', "name = 3", ["name = 3", "text in quotes"]),
    ('name = "lever"', 'name = ""', ["name = ''"]),
    ('name = "lever"', 'name = "lever"\nname = "x"', ["not valid TOML", "line 3"]),
    ('name = "lever"', "name = lever", ["not valid TOML", "line 2"]),
    ('name = "lever"', "[[[", ["not valid TOML", "line"]),
    ("[options]", "[options]\n[options]", ["not valid TOML", "line"]),
    ("[[join]]", "[[joins]]\n[[join]]", ["'joins' is unknown", '"join"']),
]  # fmt: skip


@pytest.mark.parametrize(("old", "new", "words"), MISTAKES, ids=range(len(MISTAKES)))
def test_one_mistake_gets_a_sentence(read, old, new, words):
    assert GOOD.count(old) >= 1
    message = sentence(lambda: read(GOOD.replace(old, new, 1)))
    assert message.count("case.toml") == 1
    assert all(word in message for word in words), message


# Several mistakes at once: what is put where, and what each line says; nothing more is said of what only follows
TOGETHER = [
    ({'E = "200 GPa"': 'E = "200 GPx"', 'joint = "cross"\n': 'joint = "cros"\n', '"0.5 mm"': '"0.5 kg"'},
     ["[material.steel]: E = '200 GPx'", "[[join]] 1: joint = 'cros'", "[[wire]] 1: diameter = '0.5 kg'"]),
    # one key twice wrong, one missing, one unknown in the same table
    ({'length = "100 mm"': 'lenght = "100 mm"', '"45 deg"': '"45 mm"', '"1 mm"\nwidths': '"1 kg"\ncolour = 3\nwidths'},
     ["[joint.cross]: key 'lenght' is unknown; did you mean \"length\"?", "[joint.cross]: angle = '45 mm'",
      "[joint.cross]: thickness = '1 kg'", "[joint.cross]: key 'colour' is unknown"]),
    # nothing is said of the joints and leaves that are of the material
    ({"[material.steel]": "[materials.steel]", 'about = "z"': 'about = "up"'},
     ["key 'materials' is unknown", "[[actuate]] 1: about = 'up'"]),
    ({"[material.steel]": "[[material]]", "gravity = [0, -9.81, 0]": "gravity = 3"},
     ["gravity = 3", "[material] = "]),
    # nor of the link, loose without its joint, or of drives of the joint
    ({'b = "arm"\njoint': 'name = "base"\nb = "amr"\njoint', 'link = "arm"\nabout = "z"': 'joint = "base"',
      'link = "arm"\nforce': 'link = "amr"\nforce'},
     ["[[join]] 1: b: link 'amr' does not exist", "[[load]] 1: link: link 'amr' does not exist"]),
    ({'b = "arm"\njoint': 'name = "base"\nb = "amr"\njoint', 'link = "arm"\nabout = "z"': 'joint = "bas"'},
     ["[[join]] 1: b: link 'amr' does not exist", "[[actuate]] 1: joint 'bas' does not exist"]),
    ({'b = "arm"\njoint': 'b = "amr"\njoint', 'toward = "x"': "", 'link = "arm"\nabout = "z"': 'joint = "ground-arm"'},
     ["[[join]] 1: key 'toward' is missing", "[[join]] 1: b: link 'amr' does not exist"]),
    ({'links = ["arm"]': "links = 3", 'axis = "z"': 'axis = "w"', "elements = 3": "elements = 0"},
     ["links = 3", "[[join]] 1: axis = 'w'"]),
    ({'name = "lever"': 'name = "lever"\nplane = "ab"', '"30 deg"': '"30 kg"'},
     ["plane = 'ab'", "[[actuate]] 1: value = '30 kg'"]),
    # what only the whole shows, all of it
    ({'links = ["arm"]': 'links = ["arm", "one", "two"]'},
     ["link 'one' is attached to nothing", "link 'two' is attached to nothing"]),
    ({'method = "reduced"': 'method = "reduced"\nhaste = 1', "following = true": 'following = "yes"'},
     ["[options]: key 'haste' is unknown", "[[load]] 1: following = 'yes'"]),
    ({'links = ["arm"]': 'links = ["arm", "arm"]\nconsider = ["shear"]', 'mass = "500 g"': ""},
     ["link 'arm' exists already", "consider: 'shear' is unknown", "[[mass]] 1: key 'mass' is missing"]),
]  # fmt: skip


@pytest.mark.parametrize(("changes", "lines"), TOGETHER, ids=range(len(TOGETHER)))
def test_all_mistakes_are_told_at_once(read, changes, lines):
    text = GOOD
    for old, new in changes.items():
        assert old in text, old
        text = text.replace(old, new, 1)
    with pytest.raises(SceneFileError) as caught:
        read(text, option_names=("method",))
    head, *told = str(caught.value).splitlines()
    assert head == f"case.toml has {len(lines)} mistakes:" and len(told) == len(caught.value.mistakes)
    assert sorted(told) == sorted(set(told))
    for line in lines:
        assert sum(re.sub(r"^  line \d+[,:] ?", "  ", said).startswith(f"  {line}") for said in told) == 1, (
            line,
            told,
        )
    assert all(said.endswith((".", "?")) for said in told)
    assert all(said.startswith("case.toml") for said in caught.value.mistakes)
    again = pickle.loads(pickle.dumps(caught.value))
    assert (str(again), again.mistakes) == (str(caught.value), caught.value.mistakes)


INDEPENDENT = {
    'E = "200 GPa"': 'E = "two"', 'kind = "rectangle"': "kind = 3", '"45 deg"': '"45 m"', 'axis = "z"': 'axis = "q"',
    "elements = 3": "elments = 3", '"0.5 mm"': '"0.5 W"', '"30 deg"': '"30 s"', 'along = "z"': 'along = "zz"',
    "following = true": "following = 1", 'mass = "500 g"': 'mass = "heavy"', 'method = "reduced"': 'haste = "much"',
    "gravity = [0, -9.81, 0]": 'gravity = "down"',
}  # fmt: skip


@settings(max_examples=60, deadline=None)
@given(st.lists(st.sampled_from(sorted(INDEPENDENT)), min_size=1, unique=True))
def test_any_mistakes_together_are_as_many_as_apart(tmp_path_factory, chosen):
    file = tmp_path_factory.getbasetemp() / f"several{os.getpid()}.toml"
    text = GOOD
    for old in chosen:
        text = text.replace(old, INDEPENDENT[old], 1)
    file.write_text(text)
    with pytest.raises(SceneFileError) as caught:
        load_scene(file, option_names=("method",))
    assert len(caught.value.mistakes) == len(chosen), caught.value


def test_mistakes_tell_the_line_of_their_key_or_table(read):
    text = GOOD
    for old, new in {
        '["40 mm", 0.02]': '["40 mm", "2 s"]', 'axis = "z"\ntoward = "x"': '"axis" = "w"', "mass = ": " mas = ",
        "[[wire]]": "[[ wire ]]  # round", "diameter = ": "# diameter = ", '"lever"': '"lever"\nlevel = 3',
        '[[support]]\nlink = "arm"': '[[support]]\nlink = "amr"\nhaste = 3',
    }.items():  # fmt: skip
        assert old in text
        text = text.replace(old, new, 1)
    lines = text.splitlines()
    with pytest.raises(SceneFileError) as caught:
        read(text)
    told = {int(re.match(r"case\.toml, line (\d+)[,:]", said)[1]): said for said in caught.value.mistakes}
    found = {lines[number - 1].split(" = ")[0]: said for number, said in told.items()}
    assert found.keys() == {
        "level",
        "widths",
        '"axis"',
        "[[join]]",
        "[[ wire ]]  # round",
        "link",
        "haste",
        " mas",
    }
    assert "line 3: key 'level' is unknown" in found["level"] and "widths[1] = '2 s'" in found["widths"]
    assert (
        "key 'toward' is missing" in found["[[join]]"]
        and "key 'diameter' is missing" in found["[[ wire ]]  # round"]
    )
    assert "link: link 'amr' does not exist" in found["link"]


@settings(max_examples=100, deadline=None)
@given(st.text(max_size=40), st.text(max_size=200))
def test_lines_of_any_text_leave_the_sentence(place, text):
    sentence = f"a.toml, [{place}]: E = 3 is wrong."
    told = LineNumbers("a.toml", text).add_to(sentence)
    assert re.sub(r"^a\.toml, line \d+", "a.toml", told) == sentence
    assert LineNumbers("b", text).add_to(sentence) == sentence


def test_of_very_many_mistakes_the_first_are_listed(read):
    with pytest.raises(SceneFileError) as caught:
        read(GOOD + "\n".join(f'[[point]]\nleaf = "{k}"\ns = 1' for k in range(40)))
    told = str(caught.value).splitlines()
    assert len(told) == 32 and told[-1] == "  and 10 more." and len(caught.value.mistakes) == 40


def test_a_plain_number_in_another_unit_stands_at_the_end_of_the_mistakes(read):
    text = GOOD.replace('"40 mm"', "40", 1).replace('"30 deg"', '"30 s"').replace('"500 g"', '"500 s"')
    with pytest.raises(SceneFileError) as caught:
        read(text)
    assert str(caught.value).splitlines()[-1] == (
        "  line 11, [section.blade]: width = 40 is 40 m: did you mean '40 mm'?"
    )


@pytest.mark.parametrize(
    ("text", "unit"),
    [
        ("N m", "Nm"), ("N*m", "Nm"), ("N·mm", "Nmm"), ("mN m", "mNm"), ("N mm/rad", "Nmm/rad"), ("kg/m3", "kg/m^3"),
        ("kg / m³", "kg/m^3"), ("m/s2", "m/s^2"), ("µm", "um"), ("μm", "um"), ("°", "deg"), ("kg·m²", "kg m^2"),
        ("/K", "1/K"), ("µm/m/K", "um/m/K"), ("mm4", "mm^4"), ("in", "in"), ("m N", None), ("MM", "mm"), ("", None),
        ("kgm^2", None), ("mm\n", None), ("N/mm2", "N/mm^2"), ("N/mm^2", "N/mm^2"), ("PSI", "psi"), ("Ksi", "ksi"),
        ("lbf", "lbf"), ("FT", "ft"), ("lbf·in", "lbf in"), ("in-lbf", "in lbf"), ("kg-m2", "kg m^2"), ("gpa", "GPa"),
        ("Kn", "kN"), ("mPa", None), ("Mm", None), ("Mm2", None), ("mn", "mN"), ("MHZ", None), ("KHZ", "kHz"),
        ("NM", None), ("MNM", None), ("µM", "um"),
        ("M/s^2", "m/s^2"), ("mm⁴", "mm^4"),
    ],
)  # fmt: skip
def test_units_as_engineers_write_them(text, unit):
    assert find_unit(text) == unit


@pytest.mark.parametrize(
    ("text", "dimension", "value"),
    [
        ("−5 mm", "length", -5e-3), ("–5\u202fmm", "length", -5e-3), ("1\u2009234.5 mm", "length", 1.2345),
        ("12’500 mm", "length", 12.5), ("12·10⁻⁶ 1/K", "expansion", 12e-6), ("2 × 10^5 N/mm²", "stress", 2e11),
        ("1.2*10-5 1/K", "expansion", 1.2e-5), ("45º", "angle", math.pi / 4), ("9.81 m∕s²", "acceleration", 9.81),
        ("30e6 psi", "stress", 30e6 * 4.4482216152605 / 0.0254**2), ("10 ksi", "stress", 68.9475729e6),
        ("2 lbf", "force", 8.896443230521), ("3 FT", "length", 0.9144), ("7 NM", "moment", 7.0), ("7 NM", "length", 7e-9),
        ("1 lbf in", "moment", 0.1129848290276167), ("0.29 lb/in^3", "density", 8027.171),
        ("1 lbf/in", "stiffness", 175.126835246), ("200 GPA", "stress", 2e11),
    ],
)  # fmt: skip
def test_numbers_and_units_of_other_places(text, dimension, value):
    """Values of the pound and inch: NIST SP 811 (2008), appendix B."""
    assert quantity(text, dimension, "x") == pytest.approx(value, rel=1e-6)
    assert fits_schema(text, dimension)


@pytest.mark.parametrize(
    ("text", "dimension", "said"),
    [
        ("70 mPa", "stress", "'mPa' may be MPa; write the one you mean"), ("3 Mm", "length", "'Mm' may be mm"),
        ("5 MNM", "moment", "'MNM' may be mNm"), ("1,5 mm", "length", "write a decimal point"),
        ("1/2 in", "length", "not a fraction: '0.5 in'"),
    ],
)  # fmt: skip
def test_units_in_another_case_are_not_guessed(text, dimension, said):
    with pytest.raises(SceneError, match=said):
        quantity(text, dimension, "x")
    assert not fits_schema(text, dimension)


OTHER_FILES = [
    ("a.step", b"ISO-10303-21;\nHEADER;\n", "a STEP file"),
    ("a.inp", b"** made by hand\n*HEADING\nbeam\n*NODE\n1, 0., 0.\n", "an Abaqus or CalculiX input file"),
    ("a.dat", b"/BATCH\n/PREP7\nET,1,BEAM188\n", "an ANSYS input file"),
    ("a.mac", b"! leaf spring\nfinish\n/clear\n", "an ANSYS input file"),
    ("a.bdf", b"SOL 101\nCEND\nBEGIN BULK\n", "a Nastran input file"),
    ("a.dat", b"PLBEAM 1 1 2 3 4\nHINGE 2 4 5\n", "a SPACAR input file"),
    ("a.json", b'{"links": ["arm"]}', "a JSON file"),
    ("a.yaml", b"name: lever\nlinks:\n  - arm\n", "a YAML file"),
    ("a.urdf", b'<?xml version="1.0"?>\n<robot name="r">', "a robot description"),
    ("a.py", b"import ksd\n", "a Python script"),
    ("a.m", b"% flexure\nclear all; clc\n", "a MATLAB script"),
    ("a.stl", b"solid part\n facet normal 0 0 1\n", "an STL mesh"),
    ("a.stl", bytes(80) + b"\xff\xfe\x80", "an STL mesh"),
    ("a.h5", b"\x89HDF\r\n\x1a\n", "an HDF5 file"),
    ("a.mph", b"PK\x03\x04\xff\xff", "a COMSOL model"),
    ("a.pdf", b"%PDF-1.7\n\xff", "a PDF document"),
    ("a.csv", b"x,y,z\n0,1,2\n", "a table of comma-separated values"),
    ("a.k", b"$ header\n*KEYWORD\n" + b" " * (5 << 20), "an LS-DYNA input file"),
]


@pytest.mark.parametrize(("name", "content", "what"), OTHER_FILES)
def test_a_file_of_another_program_is_named(tmp_path, name, content, what):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(SceneError, match=f"{name} is {what}.*ksd new"):
        ksd.load_scene(tmp_path / name)


@pytest.mark.parametrize(
    "start", ["[[leaf]]\na = \n", "# scene\nname = lever\n", "[material.steel\n", "links = [\n", "=\n"]
)
def test_a_broken_scene_is_no_other_file(tmp_path, start):
    (tmp_path / "a.toml").write_text(start)
    with pytest.raises(SceneError, match="not valid TOML"):
        ksd.load_scene(tmp_path / "a.toml")


def test_a_mistake_in_a_part_hides_none_in_what_is_made_of_it(read):
    """Of the material in its joint and its leaf, of the section in its leaf, and of the joint in its placement."""
    text = GOOD
    for old, new in (
        ('E = "200 GPa"', 'E = "-200 GPa"'), ('angle = "45 deg"', 'angle = "145 deg"'), ('thickness = "1 mm"\nwidth =',
        'thickness = "1 kg"\nwidth ='), ("end = [0.1, 0.2, 0]", "end = [0, 0.2, 0]"), ('toward = "x"', 'toward = "z"'),
    ):  # fmt: skip
        assert old in text
        text = text.replace(old, new, 1)
    with pytest.raises(SceneFileError) as caught:
        read(text)
    for part in ("E = -200000000000.0 Pa", "angle = 145", "thickness = '1 kg'", "[[leaf]] 1", "[[join]] 1"):
        assert sum(part in said for said in caught.value.mistakes) == 1, (part, caught.value.mistakes)
    assert len(caught.value.mistakes) == 5
    with pytest.raises(SceneFileError) as caught:
        read(GOOD.replace('material = "steel"', 'material = "stel"', 1).replace('"45 deg"', '"145 deg"', 1))
    assert len(caught.value.mistakes) == 2


UNITS = [(dimension, unit) for dimension, units in DIMENSIONS.items() for unit in units]


@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(UNITS),
    st.floats(-1e6, 1e6),
    st.sampled_from(["", " ", "\t"]),
    st.sampled_from([repr, "{:.3e}".format]),
)
def test_quantities_with_any_unit_are_the_number_times_its_factor(kind, value, space, written):
    dimension, unit = kind
    # 0.01/K is a hundredth per kelvin
    space = space or " " * unit[0].isdigit()
    found = quantity(f"{written(value)}{space}{unit}", dimension, "x")
    assert found == float(written(value)) * DIMENSIONS[dimension][unit]
    others = [d for d in DIMENSIONS if unit not in DIMENSIONS[d]]
    for other in others:
        with pytest.raises(SceneError, match=r"is expected, e\.g\. "):
            quantity(f"{value!r} {unit}", other, "x")


def test_everything_with_a_dimension_may_have_a_unit(read):
    text = GOOD.replace("gravity = [0, -9.81, 0]", 'gravity = [0, "-9810 mm/s^2", 0]')
    text = text.replace("inertia = [1e-3, 1e-3, 2e-3]", 'inertia = ["1000 kg mm^2", "1e-3 kg m2", 2e-3]')
    text = text.replace('["40 mm", 0.02]', '["4 cm", "20 mm"]').replace('"3 mNm"', '"3 N mm"')
    found, plain = read(text)[0].scene(), read(GOOD)[0].scene()
    assert found.loads == plain.loads and found.gravity == pytest.approx(plain.gravity)
    assert np.allclose(found.masses[0].inertia, plain.masses[0].inertia, rtol=1e-15)
    assert found.joints[0].joint.widths == pytest.approx((0.04, 0.02))
    springs = """
[[spring]]
a = "ground"
b = "arm"
start = [0, "-10 cm", 0]
end = [0, "2 inch", 0]
stiffness = "0.2 N/mm"
[[turn_spring]]
a = "ground"
b = "arm"
at = [0, 0, 0]
axis = "z"
stiffness = "3 N mm/deg"
[[heat]]
temperature = "20 K"
[section.thread]
kind = "numbers"
A = "1 mm^2"
J = "2 mm^4"
Iy = "1 mm^4"
Iz = "1e-12 m^4"
tilt = "30 deg"
[section.plate]
kind = "polygon"
points = [[0, 0], ["1 mm", 0], ["1 mm", "5 mm"], [0, "5 mm"]]
"""
    text = text.replace('E = "200 GPa"', 'E = "200 GPa"\nexpansion = "12 um/m/K"')
    found = read(text.replace("[options]", springs + "[options]"))[0].scene()
    coil, turning = found.springs
    assert coil.stiffness == pytest.approx(200) and coil.end[1] == pytest.approx(0.0508)
    assert turning.stiffness == pytest.approx(3e-3 * 180 / math.pi)
    assert found.heats[0].temperature == 20 and found.leaves[0].leaf.material.expansion == pytest.approx(
        12e-6
    )


def test_option_names_are_checked_when_given(read):
    assert read(GOOD, option_names=("method",))[2] == {"method": "reduced"}
    message = sentence(lambda: read(GOOD, option_names=("methods", "accuracy")))
    assert "[options]" in message and "'method' is unknown" in message and '"methods"' in message


def test_files_that_cannot_be_read(tmp_path, read):
    assert "does not exist" in sentence(lambda: load_scene(tmp_path / "no.toml"))
    assert "cannot be read" in sentence(lambda: load_scene(tmp_path))
    assert "byte 9 is not UTF-8" in sentence(lambda: read(b'name = "\xff"'))
    assert "nested too deeply" in sentence(lambda: read("x = " + "[" * 100000))
    assert "cannot be read" in sentence(lambda: load_scene("a\0b.toml"))
    assert "cannot be written" in sentence(lambda: save_scene(lever(), tmp_path))


def test_saving_what_cannot_be_written(tmp_path):
    made = lever()
    words = {"start": (0, 0, 0), "end": (0.1, 0, 0), "material": STEEL, "section": circle(1e-3)}
    made.leaf("ground", "arm", **words, curve=FreeCurve(0.1, lambda s: (0, 0, s)), name="bow")
    assert "'bow'" in sentence(lambda: save_scene(made, tmp_path / "x.toml"))
    assert "target 'leg'" in sentence(lambda: save_scene(lever(), tmp_path / "x.toml", targets={"leg": 1}))
    assert "'tuning'" in sentence(lambda: save_scene(lever(), tmp_path / "x.toml", options={"tuning": {1}}))


def lever():
    made = Mechanism("lever")
    arm = made.link("arm")
    made.join("ground", arm, CROSS, at=(0, 0, 0), axis="z", toward="x")
    return made


def round_trip(made, tmp_path, **words):
    file = tmp_path / "round.toml"
    save_scene(made, file, **words)
    return load_scene(file)


@pytest.mark.parametrize(
    "section",
    [
        rectangle(1e-3, 3e-3, cowper=0.3),
        circle(1e-3, name="thread"),
        tube(3e-3, 1e-3),
        numbers(A=1e-5, J=1e-12, Iy=1e-11, Iz=1e-12),
        polygon([(0, 0), (1e-3, 0), (1e-3, 5e-3), (2e-4, 5e-3)]),
    ],
    ids=lambda s: s.name,
)
def test_every_section_round_trips(section, tmp_path):
    made = lever()
    ends = {"start": (0, 1, 0), "end": (0.1, 1, 0), "width_axis": (0, 0.6, 0.8)}
    made.leaf("ground", "arm", **ends, section=section, material=STEEL, orders=(3, 2, 4))
    again, _, _ = round_trip(made, tmp_path)
    assert again.scene() == made.scene()


def test_sections_and_leaves_in_file_words(read):
    text = GOOD.replace('kind = "rectangle"\nthickness = "1 mm"\nwidth = "40 mm"', "{}")
    for words, expected in {
        'kind = "tube"\nouter = "2 mm"\ninner = "1 mm"': tube(2 * 1e-3, 1e-3),
        'kind = "circle"\ndiameter = 0.002': circle(0.002),
        'kind = "polygon"\npoints = [[0, 0], [0.001, 0], [0.001, 0.002], [0, 0.002]]': polygon(
            [(0, 0), (1e-3, 0), (1e-3, 2e-3), (0, 2e-3)]
        ),
        'kind = "numbers"\nA = 1.0\nJ = 2.0\nIy = 3.0\nIz = 4.0': numbers(A=1, J=2, Iy=3, Iz=4),
    }.items():
        made, _, _ = read(text.replace("{}", words))
        assert made.scene().leaves[0].leaf.section == expected
    inline = GOOD.replace('section = "blade"\nmaterial', 'thickness = "2 mm"\nwidth = 0.01\nmaterial')
    assert read(inline)[0].scene().leaves[0].leaf.section == rectangle(2 * 1e-3, 0.01)


def test_drawn_joint_round_trips(tmp_path):
    first = Leaf(
        start=(0, 0, 0), end=(0.05, 0, 0), width_axis="z", section=rectangle(1e-3, 1e-2), material=STEEL,
        end_block="mid", name="first",
    )  # fmt: skip
    second = Leaf(
        start=(0.05, 0, 0), end=(0.1, 0, 0), width_axis=None, section=circle(1e-3), material=STEEL,
        start_block="mid", name="second", elements=2,
    )  # fmt: skip
    joint = DrawnJoint(
        "mine",
        blocks={"A": (0, 0, 0), "B": (0.1, 0, 0), "mid": (0.05, 0, 0)},
        leaves=[first, second],
        motions=[
            Motion("tilt", "rotation", (0.6, 0, 0.8), (-0.3, 0.4)),
            Motion("s", "translation", "x", (0, 1)),
        ],
        shape={"ratio": 0.5},
    )
    made = Mechanism("drawn")
    arm = made.link("arm")
    made.join("ground", arm, joint, at=(1, 2, 3), axis=(1, 1, 0), toward=(1, -1, 1))
    again, _, _ = round_trip(made, tmp_path)
    assert again.scene() == made.scene()
    assert again.scene().fingerprint() == made.scene().fingerprint()


def test_drawn_joint_mistakes(tmp_path):
    joint = DrawnJoint(
        "mine",
        blocks={"A": (0, 0, 0), "B": (0.1, 0, 0)},
        leaves=[Leaf(start=(0, 0, 0), end=(0.1, 0, 0), width_axis="z", section=circle(1e-3), material=STEEL)],
        motions=[Motion("tilt", "rotation", "z", (-0.3, 0.4))],
    )
    made = Mechanism("drawn")
    made.join("ground", made.link("arm"), joint, at=(0, 0, 0), axis="z", toward="x")
    file = tmp_path / "drawn.toml"
    save_scene(made, file)
    text = file.read_text()
    for old, new, words in (
        ('kind = "rotation"', 'kind = "spin"', ["[[joint.mine.motion]] 1", "'spin'"]),
        ('end_block = "B"', 'end_block = "C"', ["[joint.mine]", "'C'"]),
        ('end_block = "B"', "", ["[[joint.mine.leaf]] 1", "'end_block' is missing"]),
        ("B = [0.1", 'B = ["1 deg"', ["[joint.mine.blocks]", "B[0] = '1 deg'"]),
    ):
        assert old in text
        file.write_text(text.replace(old, new, 1))
        message = sentence(lambda: load_scene(file))
        assert all(word in message for word in words), message


# Properties

coordinates = st.floats(-10, 10, allow_nan=False).map(lambda x: x + 0.0)
points = st.tuples(coordinates, coordinates, coordinates)
directions = st.one_of(
    st.sampled_from(["x", "y", "z", "-x", "-y", "-z"]), points.filter(lambda p: np.linalg.norm(p) > 1e-3)
)
names = st.text(min_size=1, max_size=8).filter(lambda t: t.strip() and t.isprintable())
lengths = st.floats(1e-4, 10)


@st.composite
def mechanisms(draw):
    made = Mechanism(draw(names))
    links = draw(st.lists(names.filter(lambda n: n != "ground"), min_size=1, max_size=4, unique=True))
    for i, link in enumerate(links):
        made.link(link)
        material = Material(draw(lengths), G=draw(lengths), name=draw(st.text(max_size=3)))
        joint = CrossFlexure(
            material,
            length=1.0,
            angle=draw(st.floats(0.1, 1.4)),
            thickness=draw(st.floats(1e-6, 0.4)),
            widths=draw(st.tuples(lengths, lengths)),
            gap=draw(st.none() | st.floats(0, 1)),
            elements=draw(st.none() | st.integers(1, 9)),
        )
        z = np.array(ksd.checks.direction(draw(directions), "axis"))
        x = np.cross(z, np.eye(3)[np.argmin(np.abs(z))])
        made.join(
            draw(st.sampled_from(["ground", *links[:i]])), link, joint, at=draw(points), axis=z, toward=x
        )
    for link in links:
        if draw(st.booleans()):
            made.actuate(link, along=draw(directions), at=draw(points))
        if draw(st.booleans()):
            made.support(link, about=draw(directions), relative_to=None, name=draw(names))
        if draw(st.booleans()):
            made.load(link, force=draw(points), at=draw(points), following=draw(st.booleans()))
        if draw(st.booleans()):
            # of a body: none is more than the sum of the other two
            a, b, c = draw(st.tuples(lengths, lengths, lengths))
            made.mass(link, mass=draw(lengths), at=draw(points), inertia=(b + c, a + c, a + b))
    if len(links) > 1 and draw(st.booleans()):
        term = made.rotation(links[0], draw(directions), relative_to=links[1])
        made.actuate(terms=draw(st.floats(0.1, 3)) * term - made.displacement(links[1], "x", at=draw(points)))
    made.gravity = draw(st.none() | points)
    return made


@pytest.mark.filterwarnings(f"ignore::{SceneWarning.__module__}.SceneWarning")
@settings(max_examples=60, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_any_scene_round_trips(data, tmp_path_factory):
    try:
        made = data.draw(mechanisms())
        scene = made.scene()
    except SceneError as error:
        assert re.search("same freedom|used", str(error)), error
        return
    folder = tmp_path_factory.getbasetemp()
    targets = {d.name: 0.5 for d in scene.drives}
    again, same_targets, _ = round_trip(made, folder, targets=targets)
    assert again.scene() == scene
    assert again.scene().fingerprint() == scene.fingerprint()
    assert same_targets == targets


def refused_or_fine(content, folder):
    file = folder / f"bytes{os.getpid()}.toml"
    file.write_bytes(content)
    try:
        load_scene(file)
    except SceneError as error:
        assert str(error)


@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
@given(content=st.binary(max_size=200))
@example(content=b"x = 2026-13-45")
@example(content=b"links = []\nx = 1979-05-27")
def test_random_bytes_raise_nothing_but_scene_errors(content, tmp_path_factory):
    refused_or_fine(content, tmp_path_factory.getbasetemp())


toml_values = st.sampled_from([
    "0", "-1", "1e400", "nan", "inf", "true", '""', '"1 mm"', '"1 deg"', '"arm"', '"ground"', '"x"', "[]",
    "[0, 0, 0]", '["1 mm", 1, 2]', "[[0, 0], [1, 0], [1, 1]]", "{}", "{a = 1}", "[{}]", "1979-05-27",
    '[{link = "arm", about = "z"}]', "07:32:00", "0x" + "f" * 400, "[nan, 0, 0]", '[1, "x", true]',
])  # fmt: skip


@settings(max_examples=400, deadline=None, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_mutated_files_raise_nothing_but_scene_errors(data, tmp_path_factory):
    lines = GOOD.splitlines()
    for _ in range(data.draw(st.integers(1, 3))):
        i = data.draw(st.integers(0, len(lines) - 1))
        action = data.draw(st.sampled_from(["value", "drop", "repeat", "move"]))
        if action == "value" and "=" in lines[i]:
            lines[i] = f"{lines[i].partition('=')[0]}= {data.draw(toml_values)}"
        elif action == "drop":
            del lines[i]
        elif action == "repeat":
            lines.insert(i, lines[i])
        else:
            lines.insert(data.draw(st.integers(0, len(lines) - 1)), lines.pop(i))
    refused_or_fine("\n".join(lines).encode(), tmp_path_factory.getbasetemp())


@pytest.mark.parametrize("misspelt", ["thicknes", "widht"])
def test_a_misspelt_size_of_a_leaf_is_the_one_mistake(tmp_path, misspelt):
    meant = {"thicknes": "thickness", "widht": "width"}[misspelt]
    file = tmp_path / "leaf.toml"
    file.write_text(
        'links = ["tip"]\n[material.steel]\nE = "200 GPa"\nnu = 0.3\n[[leaf]]\na = "ground"\nb = "tip"\n'
        'start = [0, 0, 0]\nend = ["100 mm", 0, 0]\nmaterial = "steel"\nwidth_axis = "z"\n'
        'thickness = "1 mm"\nwidth = "20 mm"\n'.replace(f"{meant} =", f"{misspelt} =")
    )
    with pytest.raises(SceneFileError) as caught:
        ksd.load_scene(file)
    line = 12 if misspelt == "thicknes" else 13
    assert caught.value.mistakes == (
        f"leaf.toml, line {line}, [[leaf]] 1: key '{misspelt}' is unknown; did you mean \"{meant}\"?",
    )


def test_a_file_of_windows_editors_is_read(tmp_path):
    # a byte order mark before the text, and two characters at the ends of its lines
    file = tmp_path / "marked.toml"
    file.write_bytes(b"\xef\xbb\xbf" + GOOD.replace("\n", "\r\n").encode())
    assert ksd.load_scene(file)[0].scene().links


def test_a_shipped_scene_is_read_by_its_name_unless_a_file_has_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert ksd.load_scene("guide")[1] == {"table": 5e-3}
    assert ksd.load_job("pivot_job").words["starts"] == 2
    (tmp_path / "guide").write_text(GOOD)
    assert ksd.load_scene("guide")[0].scene() == ksd.load_scene(tmp_path / "guide")[0].scene()
    with pytest.raises(ksd.SceneError, match="`ksd new NAME --like guide`"):
        ksd.load_scene("guide.toml")


@pytest.mark.parametrize("name", ["pivot", "pivot.toml"])
def test_a_shipped_scene_that_is_not_here_is_told_of(name, tmp_path):
    with pytest.raises(
        ksd.SceneError, match=r"does not exist; check the path; `ksd new NAME --like pivot` writes the scene"
    ):
        ksd.load_scene(tmp_path / name)
    with pytest.raises(ksd.SceneError, match=r"does not exist; check the path\.$"):
        ksd.load_scene(tmp_path / "other.toml")
