"""Springs, elastic links, heat and fits in scene files: the words of Python, read, written and refused."""

import inspect

import numpy as np
import pytest
from effect_scenes import free_beam

import ksd
from ksd.errors import SceneError
from ksd.scene import toml_schema as schema
from ksd.units import DIMENSIONS

SCENE = """
name = "all of it"
links = ["tip", "arm"]
gravity = [0, -9.81, 0]
consider = ["plate", "warping"]

[material.steel]
E = "200 GPa"
nu = 0.3
expansion = 12e-6

[section.bar]
kind = "rectangle"
thickness = "5 mm"
width = "20 mm"

[joint.cross]
family = "cross_flexure"
material = "steel"
length = "100 mm"
angle = "45 deg"
thickness = "1 mm"
widths = ["40 mm", "20 mm"]

[[join]]
name = "hinge"
a = "ground"
b = "tip"
joint = "cross"
at = [0, 0, 0]
axis = "z"
toward = "x"

[[leaf]]
name = "blade"
a = "tip"
b = "arm"
start = ["150 mm", 0, 0]
end = ["250 mm", 0, 0]
width_axis = "z"
thickness = "1 mm"
width = "20 mm"
material = "steel"

[[actuate]]
joint = "hinge"
value = "10 deg"

[[load]]
link = "arm"
force = [0, 1, 0]
at = ["250 mm", 0, 0]
following = true

[[mass]]
link = "arm"
mass = "20 g"
at = ["260 mm", 0, 0]

[[spring]]
name = "coil"
a = "ground"
b = "tip"
start = [0, "-100 mm", 0]
end = ["50 mm", 0, 0]
stiffness = 200
free_length = "80 mm"

[[joint_spring]]
joint = "hinge"
stiffness = 1.5
rest_angle = "5 deg"

[[turn_spring]]
name = "turner"
a = "tip"
b = "arm"
at = ["200 mm", 0, 0]
axis = "z"
stiffness = 0.2

[[compliance]]
link = "tip"
section = "bar"
material = "steel"

[[heat]]
temperature = 20
through = 2
leaves = ["blade"]

[[fit]]
leaf = "hinge/inner"
natural_length = "99.99 mm"
turn = [0, 0, "1 mrad"]
"""


def in_python():
    steel = ksd.Material(E=200e9, nu=0.3, expansion=12e-6, name="steel")
    scene = ksd.Mechanism("all of it")
    tip, arm = scene.links("tip", "arm")
    scene.gravity = (0, -9.81, 0)
    scene.consider("warping", "plate")
    joint = ksd.CrossFlexure(steel, length=0.1, angle=np.deg2rad(45), thickness=1e-3, widths=(0.04, 0.02))
    hinge = scene.join(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x", name="hinge")
    blade = scene.leaf(
        tip, arm, start=(0.15, 0, 0), end=(0.25, 0, 0), width_axis=(0, 0, 1), section=ksd.rectangle(1e-3, 20e-3),
        material=steel, name="blade",
    )  # fmt: skip
    scene.actuate_joint(hinge)
    scene.load(arm, force=(0, 1, 0), at=(0.25, 0, 0), following=True)
    scene.mass(arm, mass=0.02, at=(0.26, 0, 0))
    scene.spring(
        "ground", tip, start=(0, -0.1, 0), end=(0.05, 0, 0), stiffness=200.0, free_length=0.08, name="coil"
    )
    scene.joint_spring(hinge, stiffness=1.5, rest_angle=5 * np.pi / 180)
    scene.turn_spring(tip, arm, at=(0.2, 0, 0), axis="z", stiffness=0.2, name="turner")
    scene.compliance(tip, section=ksd.rectangle(5e-3, 20e-3, name="rectangle"), material=steel)
    scene.heat(20, through=2, leaves=blade.name)
    scene.fit("hinge/inner", natural_length=0.09999, turn=(0, 0, 1e-3))
    return scene


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "scene.toml"
    path.write_text(SCENE)
    return path


def test_the_same_words_make_the_same_scene(file):
    found, targets, _ = ksd.load_scene(file)
    mine, theirs = found.scene(), in_python().scene()
    for part in ("springs", "compliances", "heats", "fits", "consider", "gravity", "loads"):
        assert getattr(mine, part) == getattr(theirs, part), part
    assert mine.fingerprint() == theirs.fingerprint()
    pair = [ksd.solve(s, targets, method="conventional").forces["hinge"] for s in (found, in_python())]
    assert pair[0] == pytest.approx(pair[1], rel=1e-12)


def test_what_is_written_is_read_again(file, tmp_path):
    found, targets, _ = ksd.load_scene(file)
    ksd.save_scene(found, tmp_path / "again.toml", targets=targets)
    again, values, _ = ksd.load_scene(tmp_path / "again.toml")
    assert again.scene() == found.scene() and values == targets
    assert again.scene().fingerprint() == found.scene().fingerprint()


def test_a_matrix_beside_the_scene_file(tmp_path):
    points = np.array([[0.0, 0, 0], [0.2, 0, 0]])
    np.savez(tmp_path / "arm.npz", points=points, K=free_beam(points, 1.0))
    start = SCENE.index("[[compliance]]")
    text = (
        SCENE[:start]
        + '[[compliance]]\nlink = "tip"\nmatrix = "arm.npz"\n'
        + SCENE[SCENE.index("[[heat]]") :]
    )
    (tmp_path / "scene.toml").write_text(text)
    found, _, _ = ksd.load_scene(tmp_path / "scene.toml")
    (said,) = found.scene().compliances
    assert np.allclose(said.matrix.stiffness, free_beam(points, 1.0))
    ksd.save_scene(found, tmp_path / "again.toml")
    again, _, _ = ksd.load_scene(tmp_path / "again.toml")
    assert again.scene() == found.scene()
    # the blade hangs nowhere near its second interface
    with pytest.raises(SceneError, match=r"compliance of link 'tip': 'hinge' is attached at .* 70.7 mm"):
        ksd.compile_scene(found, with_="compliance")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("stiffness = 200\n", "stiffness = -200\n", ["[[spring]] 1", "stiffness = -200"]),
        ('joint = "hinge"\nstiffness', 'joint = "hinges"\nstiffness', ["hinges", "hinge"]),
        ('free_length = "80 mm"', 'free_lenght = "80 mm"', ["free_lenght", "unknown"]),
        ('link = "tip"\nsection', 'link = "top"\nsection', ["'top'", "does not exist"]),
        ('section = "bar"\nmaterial = "steel"\n', 'section = "bar"\n', ["section needs its material"]),
        ('leaves = ["blade"]', 'leaves = ["blades"]', ["heat: leaf 'blades'", "blade"]),
        ('"99.99 mm"', '"50 mm"', ["natural_length", "10 %"]),
        ("expansion = 12e-6\n", "", ["steel has no expansion"]),
        ('consider = ["plate", "warping"]', 'consider = ["shear"]', ["consider", "shear"]),
        ('link = "tip"\nsection', 'link = "ground"\nsection', ["ground cannot be elastic"]),
    ],
)
def test_wrong_words_name_file_table_and_key(tmp_path, old, new, words):
    assert old in SCENE
    path = tmp_path / "scene.toml"
    path.write_text(SCENE.replace(old, new, 1))
    with pytest.raises(SceneError) as caught:
        ksd.load_scene(path)
    message = str(caught.value)
    assert message.startswith("scene.toml") and all(w in message for w in words), message


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda K, p: (K[:6, :6], p), ["(6, 6)", "square, 12 or more"]),
        (lambda K, p: (K + np.eye(12) * K.max() * 1e-3, p), ["rigid motions meet a force"]),
        (lambda K, p: (-K, p), ["negative eigenvalue"]),
        (lambda K, p: (K + np.triu(np.full((12, 12), 1e5)), p), ["not symmetric"]),
        (lambda K, p: (np.zeros((12, 12)), p), ["is zero"]),
        (
            lambda K, p: (np.kron(np.eye(2), K)[:18, :18], np.vstack([p, p[:1] + 1])),
            ["3 interfaces", "a section"],
        ),
    ],
)
def test_matrices_that_are_none_are_refused(tmp_path, spoil, words):
    points = np.array([[0.0, 0, 0], [0.2, 0, 0]])
    K, places = spoil(free_beam(points, 1.0), points)
    np.savez(tmp_path / "arm.npz", points=places, K=K)
    with pytest.raises(SceneError) as caught:
        ksd.link_matrix(tmp_path / "arm.npz")
    assert all(w in str(caught.value) for w in words), caught.value


def test_missing_matrix_files_are_named(tmp_path):
    for name, words in (
        ("no.npz", "cannot be read"),
        ("no.h5", "cannot be read"),
        ("no.mat", r"\.npz or \.h5"),
    ):
        with pytest.raises(SceneError, match=words):
            ksd.link_matrix(tmp_path / name)
    np.savez(tmp_path / "half.npz", K=np.eye(12))
    with pytest.raises(SceneError, match="array 'points' is missing"):
        ksd.link_matrix(tmp_path / "half.npz")


def test_the_schema_holds_words_of_python_only():
    """Every table is a sentence of `Mechanism`, its keys are words of that, and every kind is one that is read."""
    kinds = {
        *DIMENSIONS,
        "number",
        "text",
        "flag",
        "direction",
        "any",
        "names",
        "material",
        "section",
        "joint",
    }
    beside = {
        "actuate": {"value"},
        "support": set(),
        "leaf": {"thickness", "width"},
        "compliance": {"points", "stiffness"},
        # sizes of its shape
        "surface": {"radius", "semi_axes", "points", "size", "length"},
    }
    for sentence, keys in schema.STATEMENTS.items():
        words = {*inspect.signature(getattr(ksd.Mechanism, sentence)).parameters}
        if further := {"support": "actuate", "wire": "leaf"}.get(sentence):
            words |= {*inspect.signature(getattr(ksd.Mechanism, further)).parameters}
        assert keys.keys() <= words | beside.get(sentence, set()), sentence
    made = {
        "rectangle": ksd.rectangle,
        "circle": ksd.circle,
        "tube": ksd.tube,
        "polygon": ksd.polygon,
        "numbers": ksd.numbers,
    }
    assert schema.SECTIONS.keys() == made.keys()
    for kind, keys in schema.SECTIONS.items():
        assert keys.keys() == {*inspect.signature(made[kind]).parameters}, kind
    assert schema.MATERIAL.keys() == {*inspect.signature(ksd.Material).parameters}
    families = [schema.family_schema(family) for family in ksd.joint_families().values()]
    tables = [
        *schema.STATEMENTS.values(),
        *schema.SECTIONS.values(),
        *schema.SIZES.values(),
        *schema.MOTIONS.values(),
        *families,
    ]
    for keys in (*tables, schema.TOP, schema.MATERIAL, schema.DRAWN, schema.LEAF, schema.BLOCKS, schema.TERM):
        assert {kind.rstrip("!").partition("[")[0] for kind in keys.values()} <= kinds


@pytest.mark.parametrize("leaves", [0.3, -1, {"a": 1}])
def test_heat_of_leaves_that_are_no_names_is_one_sentence(leaves):
    with pytest.raises(SceneError, match=r"heat: leaves = .* must be names of leaf springs in a list\."):
        ksd.Mechanism("m").heat(10.0, leaves=leaves)
