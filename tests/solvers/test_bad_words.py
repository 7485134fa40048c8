"""Words and values of the Python calls that do not fit: each gets one sentence, and no bare Python error."""

import pickle

import pytest
from scenes import STEEL, cross_flexure, fourbar

import ksd
from ksd.errors import SceneError


@pytest.mark.parametrize(
    ("make", "sentence"),
    [
        (
            lambda: ksd.CrossFlexure(STEEL, lenght=0.1),
            "CrossFlexure: it has no parameter 'lenght'; did you mean \"length\"",
        ),
        (lambda: ksd.CrossFlexure(STEEL), "CrossFlexure: missing a required argument: 'length'"),
        (lambda: ksd.Material(E=2e11, nuu=0.3), "Material: it has no parameter 'nuu'"),
        (
            lambda: ksd.Mesh("corotational", elemens=3),
            "Mesh: it has no parameter 'elemens'; did you mean \"elements\"",
        ),
        (lambda: ksd.Mesh("corotational", elements=2.5), "elements = 2.5 must be a whole number"),
        (lambda: ksd.Mesh(points=float("nan")), "points = nan must be a whole number"),
        (lambda: ksd.Mesh(orders="a"), "orders = 'a' must be three numbers"),
        (lambda: ksd.Mesh(shear="no"), "Mesh: shear = 'no' must be True or False"),
        (lambda: ksd.Mesh(plate=1), "Mesh: plate = 1 must be True or False"),
    ],
)
def test_a_description_with_a_wrong_word(make, sentence):
    with pytest.raises(SceneError) as caught:
        make()
    assert sentence in str(caught.value)


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"top": "a"}, "drive 'top' = 'a' is not a number"),
        (
            {"top": "2 mm"},
            "drive 'top' = '2 mm' is not a number; units are factors in Python: 2 * ksd.units.mm.",
        ),
        ({"top": 0.1, "effects": 5}, "effects = 5: name effects, such as effects='shear', 'auto' or 'all'."),
        ({"top": 0.1, "effects": "al"}, "effects: there is no effect 'al'; did you mean \"all\"?"),
        ({"top": [1, 2]}, "drive 'top' = [1, 2] is not a number"),
        (
            {"targets": {"top": 0.1}, "top": 0.2},
            "drive 'top' has two values, 0.1 in targets and 0.2; give it one",
        ),
        ({"top": 0.1, "accuracy": "a"}, "accuracy = 'a' is not a number"),
        (
            {"top": 0.1, "method": "reduced", "relinearisations": "a"},
            "relinearisations = 'a' must be a whole number",
        ),
        ({"top": 0.1, "method": "reduced", "relinearisations": 51}, "relinearisations = 51"),
        ({"top": 0.1, "mesh": "fine"}, "mesh = 'fine': give a ksd.Mesh"),
    ],
)
def test_a_solve_with_a_wrong_value(options, sentence):
    with pytest.raises(SceneError) as caught:
        ksd.solve(fourbar(), **options)
    assert sentence in str(caught.value)


def test_what_is_no_mechanism_is_named():
    with pytest.raises(SceneError, match=r"'fourbar\.toml' is no mechanism"):
        ksd.solve("fourbar.toml", top=0.1)


def test_joints_survive_pickling():
    joint = cross_flexure()
    assert pickle.loads(pickle.dumps(joint)) == joint


@pytest.mark.parametrize("method", ["conventional", None])
def test_planar_false_solves_in_space(method):
    """The same answer with six unknowns per node, as the steps say, asked of `prepare` or of `solve`."""
    flat = ksd.solve(fourbar(), top=0.1, method=method)
    for found in (
        ksd.prepare(fourbar(), planar=False)(top=0.1, method=method),
        ksd.solve(fourbar(), top=0.1, method=method, planar=False),
        ksd.solve(ksd.compile_scene(fourbar()), top=0.1, method=method, planar=False),
    ):
        assert "planar" in str(flat.steps) and "planar" not in str(found.steps)
        assert found.forces["top"] == pytest.approx(flat.forces["top"], rel=1e-3)


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: ksd.solve(fourbar(), top=0.1, planr=False), 'nor is it an option; did you mean "planar"?'),
        (
            lambda: ksd.solve(fourbar(), topp=0.1),
            'its drives are: top; nor is it an option; did you mean "top"?',
        ),
        (lambda: ksd.solve(fourbar(), {"topp": 0.1}), 'its drives are: top; did you mean "top"?'),
        (lambda: ksd.prepare(fourbar())(top=0.1, metod="full"), 'did you mean "method"?'),
        (
            lambda: ksd.prepare(fourbar(), planr=False),
            "prepare: it has no option 'planr'; did you mean \"planar\"?",
        ),
        (lambda: ksd.solve(fourbar(), top=0.1, planar="no"), "planar = 'no'"),
        (lambda: ksd.prepare(fourbar(), planar=0.3), "planar = 0.3"),
    ],
)
def test_an_unknown_word_is_told_the_nearest(call, sentence):
    with pytest.raises(SceneError) as caught:
        call()
    assert sentence in str(caught.value)
