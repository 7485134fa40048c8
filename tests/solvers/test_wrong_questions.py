"""Names and numbers that do not fit the questions of a configuration: one sentence each, and answers that print."""

import pickle

import pytest
from scenes import fourbar

import ksd


@pytest.fixture(scope="module")
def pose():
    return ksd.solve(fourbar(), top=0.1)


@pytest.mark.parametrize(
    ("ask", "sentence"),
    [
        (lambda p: p.forces["tpo"], "there is no drive 'tpo'; did you mean \"top\"?"),
        (lambda p: p.links["tp"], "there is no link 'tp'; did you mean \"top\"?"),
        (lambda p: p.reactions["x"], "there is no support 'x'; none is known."),
        (lambda p: p.motions["x"], "there is no joint motion 'x'; known: lower left"),
        (lambda p: p.unintended["x"], "there is no joint 'x'; known: lower left"),
        (lambda p: p.stress().leaves["x"], "there is no leaf 'x'; known: lower left/inner"),
        (lambda p: p.strain_energy()["x"], "there is no leaf or spring 'x'; known: lower left/inner"),
        (lambda p: p.internal_stress().stress_Pa["lower left/inner"], "give a leaf, of 'lower left/inner', "),
        (
            lambda p: p.internal_stress().worst_leaf["lower left/inner", "x"],
            "and a direction, of along, across",
        ),
        (
            lambda p: p.internal_stress(offset="1 um"),
            "offset = '1 um' is not a number; units are factors in Python",
        ),
        (lambda p: p.internal_stress(leaves=5), "leaves = 5: give a name, or several in a list"),
        (lambda p: p.stress("x"), "stress: more values than it takes without a name; name them: points=."),
        (lambda p: p.stress(points="a"), "points = 'a' must be a whole number"),
        (lambda p: p.displacement("top", at=(0, 0)), "at = (0, 0) must be three numbers (x, y, z) in m."),
        (lambda p: p.frequencies(count=0), "count = 0 must be a whole number of at least 1"),
        (lambda p: p.frequencies(modes=3), "frequencies: it has no option 'modes'"),
        (lambda p: p.frequencies(freed=5), "freed = 5: give a name, or several in a list"),
        (
            lambda p: p.link_forces("x"),
            "link_forces: more values than it takes without a name; it takes none.",
        ),
        (
            lambda p: p.gradient(5),
            "question = 5: give a function of a pose, such as lambda pose: pose.forces['top'].",
        ),
        (lambda p: p.plot(path=5), "picture: 5 is no name of a file."),
        (lambda p: ksd.state_space(p, damping="a"), "damping = 'a': give a ratio"),
        (lambda p: ksd.state_space(p, modes=0), "modes = 0 must be a whole number of at least 1."),
        (
            lambda p: p.buckling("top", force="x", at=(0, 0, 0)),
            "buckling load on 'top': force = 'x' must be three numbers",
        ),
        (
            lambda p: p.buckling("top", force=(0, 0, 0), at=(0, 0, 0)),
            "force and moment are zero; give one that is not zero.",
        ),
        (
            lambda p: p.sensitivity("x", "top", at=(0, 0, 0), force=(1, 0, 0)),
            "question = 'x': give a function of a pose",
        ),
        (
            lambda p: p.sensitivity(len, "top", at=(0, 0), force=(1, 0, 0)),
            "sensitivity: at = (0, 0) must be three numbers",
        ),
        (
            lambda p: p.sensitivity(len, "top", at=(0, 0, 0), force=(1, float("nan"), 0)),
            "force[1] = nan is not finite",
        ),
        (
            lambda p: ksd.follow(p.model, {"top": 0.1}, control="drives", until=float("nan")),
            "until = nan is not finite",
        ),
        (
            lambda p: ksd.follow(p.model, {"top": 0.1}, control="drives", most=0),
            "most = 0 must be a whole number",
        ),
        (
            lambda p: ksd.follow(p.model, {"top": 0.1}, control="drives", first=-1),
            "first = -1 must be positive",
        ),
        (lambda p: p.buckling(count="a"), "count = 'a' must be a whole number"),
    ],
)
def test_a_wrong_question_is_one_sentence(pose, ask, sentence):
    with pytest.raises(ksd.SceneError) as caught:
        ask(pose)
    assert sentence in str(caught.value)


def test_what_is_left_out_prints_as_a_table(pose):
    found = pose.left_out
    assert repr(found).startswith("<LeftOut: plate {force: +3.6 %, ")
    assert "support stiffness" in str(found) and "warping" in str(found)
    assert pickle.loads(pickle.dumps(found)) == found and isinstance(found["plate"]["force"], float)


@pytest.mark.parametrize("method", ["conventional", "reduced"])
def test_effects_that_are_left_out_change_nothing_of_a_force_that_is_rounding(method):
    unloaded = ksd.solve(fourbar(), top=0.0, method=method).left_out
    for changes in unloaded.values():
        assert (changes["force"], changes["displacement"]) == (0.0, 0.0)
    assert unloaded["warping"]["support_stiffness"] > 1e-5
