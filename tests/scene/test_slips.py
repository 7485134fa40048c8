"""Ordinary mistakes in the sentences of a mechanism: each is one sentence of an error of our own that says what to do."""

import copy
import pickle

import pytest
from scenes import STEEL, cross_flexure, fourbar

import ksd

HERE = {"at": (0, 0, 0), "axis": "z", "toward": "x"}
ENDS = {"start": (0, 0, 0), "end": (0.1, 0, 0), "material": STEEL, "width_axis": "z"}


def mechanism():
    m = ksd.Mechanism("m")
    m.links("a", "b")
    return m


TURN = ksd.Motion("turn", "rotation", "z", (-0.1, 0.1))


def drawn(**words):
    """A joint of two leaves that nobody named."""
    leaves = [
        ksd.Leaf(
            start=(0, y, 0),
            end=(0.1, y, 0),
            section=ksd.rectangle(1e-3, 0.02),
            material=STEEL,
            width_axis="z",
        )
        for y in (0.0, 0.03)
    ]
    return ksd.DrawnJoint(
        "d", **{"blocks": {"A": (0, 0, 0), "B": (0.1, 0, 0)}, "leaves": leaves, "motions": [TURN], **words}
    )


def numbers(**words):
    return ksd.numbers(A=1e-5, J=1e-12, Iy=1e-11, Iz=1e-12, **words)


def test_leaf_springs_of_one_name_are_told_apart():
    """Of two of one name, stresses told one alone."""
    assert [leaf.name for leaf in drawn().leaves()] == ["leaf", "leaf.2"]
    m = ksd.Mechanism("pair")
    m.actuate_joint(m.join("ground", m.link("a"), drawn(), **HERE, name="j"), name="q")
    pose = ksd.solve(m, q=0.01, method="conventional")
    assert sorted(pose.stress().leaves) == ["j/leaf", "j/leaf.2"]


@pytest.mark.parametrize(
    ("say", "sentence"),
    [
        (lambda m: m.link(), "link: missing a required argument: 'name'"),
        (lambda m: m.link("c", mas=1), "link: it has no option 'mas'; did you mean \"mass\"?"),
        (lambda m: m.join("ground", "a", cross_flexure()), "join: missing a required argument: 'at'; it takes a, b"),
        (
            lambda m: m.join("ground", "a", cross_flexure(), (0, 0, 0), "z", "x"),
            "join: more values than it takes without a name; name them: at=, axis=, toward=, name=.",
        ),
        (lambda m: m.join("ground", "a", ksd.CrossFlexure, **HERE), "CrossFlexure is not a joint; make one"),
        (
            lambda m: m.actuate_joint(m.constrain("ground", "a", cross_flexure(), **HERE)),
            "are leaf springs, which have no intended motion; drive a link, mechanism.actuate(link, ...), or connect by",
        ),
        (lambda m: m.actuate_joint("a-b"), "joint 'a-b' does not exist"),
        (lambda m: m.actuate_joint(m.ground), "joint: 'ground' is a link; drive it by mechanism.actuate"),
        (lambda m: m.actuate_joint(cross_flexure()), "joint: a cross_flexure is not part of the mechanism; give what"),
        (lambda m: m.actuate(joint=5), "joint: 5 is no joint; give what mechanism.join returned, or its name."),
        (lambda m: m.actuate("a", about="z", value=1), "its value is given when it is solved, ksd.solve(mechanism, name="),
        (lambda m: m.actuate(terms=5), "terms = 5: add up mechanism.displacement and mechanism.rotation."),
        (lambda m: m.leaf("ground", "a", thickness=1e-3, **ENDS), "give section=ksd.rectangle(thickness, width)."),
        (lambda m: m.point("x", 0.1), "no free-form leaf 'x' (leaf springs of a joint are free-form by"),
        (lambda m: m.load("a", (0, 0, 1)), "load: more values than it takes without a name; name them: force=, moment="),
        (lambda m: setattr(m, "plane", "xyz"), "plane = 'xyz' must be \"xy\", \"xz\" or \"yz\"."),
        (lambda m: setattr(m, "name", 5), "name = 5 must be a name"),
        (lambda m: m.jion("a", "b"), "a mechanism has no 'jion'; did you mean \"join\"?"),
        (lambda m: m.drive("a"), "a mechanism has no 'drive'; say mechanism.actuate."),
        (lambda m: m.solve(), "a mechanism has no 'solve'; ask it by ksd.solve(mechanism, ...)."),
        (lambda m: ksd.Mechanism("m", "xy"), "Mechanism: more values than it takes without a name; name them: plane=."),
        (lambda m: ksd.Mechanism(gravity=(0, 0, -9.81)), "no parameter 'gravity'; say mechanism.gravity = (0, 0, -9.81)."),
        (lambda m: m.elastic("a"), "a mechanism has no 'elastic'; known: actuate, "),
        (lambda m: m.load("ground", force=(1, 0, 0), at=(0, 0, 0)), "it acts on the ground, which does not move; name"),
        (lambda m: ksd.Material(), "Material: give two of E, G and nu; none is given."),
        (lambda m: ksd.Material(E=1e11), "Material: give two of E, G and nu; only E is given."),
        (lambda m: cross_flexure(angle=45), "must lie between 0 and 90 deg; did you mean 45 * ksd.units.deg?"),
        (lambda m: cross_flexure(angle=1.6), "angle = 91.6732 deg must lie between 0 and 90 deg."),
        (lambda m: ksd.Varying(1), "Varying: function = 1 must be a function of s in [0, 1]."),
        (lambda m: ksd.Varying(len, breaks=5), "Varying: breaks = 5 must rise between 0 and 1."),
        (lambda m: ksd.StiffenedMiddle(thickness=1e-3, width=0.02, middle=3e-3, part="0.5"),
         "part = '0.5' is not a number; write 0.5 without quotes."),
        (lambda m: ksd.FreeCurve.sine(10**400, length=1), "amplitudes = 1000"),
        (lambda m: ksd.FreeCurve.sine(1e300, length=1), "amplitudes = 1e+300 is too large"),
        (lambda m: ksd.rectangle(1e-3, 0.01, name=[1]), "rectangle: name = [1] must be text."),
        (lambda m: ksd.polygon([(0, 0), (1, 0), (0, 1)], 5), "polygon: holes = 5 must be a list of holes"),
        (lambda m: numbers(outline=[]), "outline = []: every ring needs three points"),
        (lambda m: numbers(outline=[[(0, 0), (1, 0)]]), "every ring needs three points"),
        (lambda m: drawn(blocks=5), "joint 'd': blocks = 5 must be {name: value}."),
        (lambda m: drawn(leaves=5), "joint 'd': leaves = 5 must be a list."),
        (lambda m: drawn(motions=[TURN, TURN]), "joint 'd': two motions are named 'turn'; give each a name of its own."),
        (
            lambda m: ksd.CrossedPivot(STEEL, length=0.1, angle=0.8, thickness=1e-3, width=0.02, ratio=True),
            "CrossedPivot: ratio = True is not a number",
        ),
        (lambda m: ksd.ModalBasis(modes=3), "ModalBasis: it has no parameter 'modes'"),
        (lambda m: ksd.ModalBasis(elements=2.5), "elements = 2.5 must be a whole number"),
        (lambda m: ksd.ModalBasis(plane="no"), "plane = 'no' must be True or False."),
        (lambda m: ksd.ModalBasis(cut="small"), "cut = 'small' is not a number"),
        (lambda m: ksd.LinkMatrix(5, 5), "link matrix: points = 5 must be its two interfaces"),
        (lambda m: ksd.LinkMatrix(((0, 0, 0), (1, 0, 0)), "soft"), "stiffness has shape (0,); 12 x 12 finite numbers"),
        (
            lambda m: m.spring("ground", "a", start=(0, 0, 0), end=(1, 0, 0), stiffness=1, name=[1]),
            "spring: name = [1] must be a name",
        ),
        (lambda m: m.slider("a", along="x", at=(0, 0, 0), relative_to=0), "0 is not a link"),
        (lambda m: ksd.train("cross_flexure", shapes={"angle": 5}), "angle = 5 must be a range (low, high)."),
        (lambda m: ksd.train("cross_flexure", shapes={"angle": ("a", 1)}), "Parameter 'angle': low = 'a' is not a number"),
        (lambda m: ksd.train(["cross_flexure"]), "cannot be trained"),
        (lambda m: ksd.LinkMatrix(), "LinkMatrix: missing a required argument: 'points'"),
        (lambda m: ksd.Job(), "Job: missing a required argument: 'function'"),
        (lambda m: ksd.train("cross_flexure", vary=5), "train: it has no option 'vary'"),
        (lambda m: ksd.load_scene(None), "scene file: None is no name of a file."),
        (lambda m: ksd.load_job(None), "job file: None is no name of a file."),
        (lambda m: ksd.link_matrix(5), "link matrix: 5 is no name of a file."),
        (lambda m: ksd.state_space(5), "pose = 5 is no configuration; give what ksd.solve returns."),
        (lambda m: ksd.rectangle(width=0.04, thicknes=1e-3), "no option 'thicknes'; did you mean \"thickness\"?"),
        (lambda m: ksd.circle(), "circle: missing a required argument: 'diameter'"),
        (lambda m: ksd.solve(), "solve: missing a required argument: 'mechanism'"),
        (lambda m: ksd.save_scene("a.toml", m), "save_scene: 'a.toml' is not a mechanism; give the mechanism"),
    ],
)  # fmt: skip
def test_a_wrong_word_is_one_sentence(say, sentence):
    with pytest.raises(ksd.SceneError) as caught:
        say(mechanism())
    assert sentence in str(caught.value)
    assert "object at 0x" not in str(caught.value) and "PlacedLeaf(" not in str(caught.value)


def test_a_mechanism_is_asked_for_words_as_any_object():
    m = mechanism()
    assert not hasattr(m, "solve") and getattr(m, "draw", None) is None
    assert copy.deepcopy(m).draft() == m.draft() == pickle.loads(pickle.dumps(m)).draft()
    with pytest.raises(AttributeError, match="did you mean"):
        m.actuated  # noqa: B018


@pytest.mark.parametrize(
    ("name", "meant"),
    [("crossflexure", "ksd.CrossFlexure"), ("mm", "ksd.units.mm"), ("rectange", "ksd.rectangle")],
)
def test_a_name_the_package_has_not(name, meant):
    with pytest.raises(AttributeError, match=f"ksd has no '{name}'; did you mean {meant}"):
        getattr(ksd, name)


@pytest.mark.parametrize(
    ("say", "sentence"),
    [
        (lambda: ksd.rectangle("1 mm", 0.04), "units are factors in Python: 1 * ksd.units.mm."),
        (lambda: ksd.Material("200 GPa", nu=0.3), "units are factors in Python: 200 * ksd.units.GPa."),
        (lambda: ksd.Material("200 mm", nu=0.3), "E = '200 mm' is not a number; give one number in Pa."),
        (lambda: ksd.Material("2e11", nu=0.3), "write 2e11 without quotes."),
        (
            lambda: ksd.Material(2e11, nu=0.3, density="7.8 g/cm^3"),
            "7.8 * ksd.units.g / ksd.units.cm**3.",
        ),
        (lambda: ksd.Material(2e11, nu=0.3, expansion="12e-6 1/K"), "write 1.2e-05, in 1/K."),
        (lambda: mechanism().load("a", force=("5 N", 0, 0), at=(0, 0, 0)), "5 * ksd.units.N."),
        (lambda: ksd.sweep(fourbar(), top="2 mm", progress=False), "units are factors in Python: 2 * ksd.units.mm"),
    ],
)  # fmt: skip
def test_text_with_units_names_the_factor(say, sentence):
    with pytest.raises(ksd.SceneError) as caught:
        say()
    assert sentence in str(caught.value)


def test_what_is_written_as_units_in_python_is_what_a_file_says():
    m = mechanism()
    with pytest.raises(ksd.SceneError) as caught:
        m.spring("a", "b", start=(0, 0, 0), end=(0, 0, 1), stiffness="200 N/mm")
    said = str(caught.value).partition("Python: ")[2].rstrip(".")
    assert eval(said) == pytest.approx(200 * ksd.units.DIMENSIONS["stiffness"]["N/mm"])


def test_parts_print_what_they_are():
    m = mechanism()
    placed = m.join("ground", "a", cross_flexure(), name="hinge", **HERE)
    assert (
        repr(placed) == "<PlacedJoint 'hinge': cross_flexure, 100 mm, from 'ground' to 'a' at (0, 0, 0) mm>"
    )
    leaf = m.leaf("a", "b", section=ksd.rectangle(1e-3, 0.04), name="blade", **ENDS)
    assert repr(leaf).startswith(
        "<PlacedLeaf 'blade': from 'a' to 'b', (0, 0, 0) mm to (100, 0, 0) mm, <Section"
    )
    section = ksd.rectangle(1e-3, 0.04)
    assert repr(section) == (
        "<Section 'rectangle': thickness 1 mm, width 40 mm, A 40 mm^2, Iy 5333 mm^4, Iz 3.333 mm^4, J 13.12 mm^4>"
    )


def test_a_link_has_no_name_of_a_block_inside_a_joint():
    scene = ksd.Mechanism("m")
    arm = scene.link("hinge/fold_low")
    hinge = ksd.InfinityHinge(STEEL, length=0.05, thickness=0.3e-3, width=0.005)
    scene.join(scene.ground, arm, hinge, **HERE, name="hinge")
    with pytest.raises(ksd.SceneError, match="the name 'hinge/fold_low' is used for 2 links"):
        scene.scene()


@pytest.mark.parametrize(
    "slip, meant",
    [("stifness", "drive_stiffness"), ("stres", "stress"), ("suport_stifness", "support_stiffness")],
)
def test_a_slip_in_one_word_of_a_name_finds_the_name(slip, meant):
    with pytest.raises(ksd.SceneError, match=f'did you mean "{meant}"'):
        ksd.sweep(fourbar(), questions=(slip,))
