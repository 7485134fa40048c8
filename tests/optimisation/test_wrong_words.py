"""What `ksd.batch` and `ksd.sweep` are given and cannot use: one sentence before any solve, and no bare Python error."""

import math

import pytest
from scenes import cross_flexure, fourbar

import ksd

ROW = [0.05, 0.1]


def drawn(thickness=1e-3, length=0.1):
    return fourbar(joint=cross_flexure(thickness=thickness, length=length))


def sweep(mechanism, *targets, **ways):
    return ksd.sweep(mechanism, *targets, **{"progress": False, **ways})


def told(call, *given, **ways):
    with pytest.raises(ksd.SceneError) as caught:
        call(*given, **ways)
    return str(caught.value)


both = pytest.mark.parametrize("call", [ksd.batch, sweep], ids=["batch", "sweep"])


@both
@pytest.mark.parametrize(
    "values",
    [
        "abc",
        ["a", 1],
        [],
        None,
        1j,
        True,
        [[1], [1, 2]],
        [[0.1, 0.2]],
        {"a": 1},
        [math.nan],
        [math.inf],
        1e40,
    ],
    ids=repr,
)
def test_drive_values(call, values):
    assert told(call, fourbar(), top=values).startswith("drive values top = ")


@both
@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"targets": "top"}, "targets = 'top': give drive values by name"),
        ({"targets": [0.1]}, "targets = [0.1]: give drive values by name"),
        ({"tpo": 0.1}, "'tpo' is not a drive of 'fourbar', whose drives are top; did you mean \"top\"?"),
        ({"top": 0.1, "mesh": "fine"}, "mesh = 'fine': give a ksd.Mesh"),
        ({"top": 0.1, "methd": "full"}, 'did you mean "method"?'),
        ({"top": 0.1, "extrapolat": True}, 'did you mean "extrapolate"?'),
        ({"top": 0.1, "method": "reducd"}, 'did you mean "reduced"?'),
        ({"top": 0.1, "method": ["full"]}, "method = ['full']"),
        ({"top": 0.1, "relinearisations": "a"}, "relinearisations = 'a' must be a whole number"),
        ({"top": 0.1, "relinearisations": 1.5}, "relinearisations = 1.5 must be a whole number"),
        ({"top": 0.1, "relinearisations": -1}, "relinearisations = -1 must be a whole number"),
        ({"top": 0.1, "relinearisations": 1000}, "relinearisations = 1000"),
        ({"top": 0.1, "extrapolate": "a"}, "extrapolate = 'a' must be True or False"),
        ({"top": 0.1, "executor": "a"}, "executor = 'a': give a concurrent.futures.Executor"),
        ({"top": 0.1, "designs": [{"thickness": 1e-3}]}, "needs a function of these parameters"),
    ],
)
def test_words_of_both(call, given, sentence):
    assert sentence in told(call, fourbar(), **given)


@both
@pytest.mark.parametrize(
    ("designs", "sentence"),
    [
        ("abc", "designs = 'abc': give sets of parameters by name"),
        (5, "designs = 5: give sets of parameters by name"),
        ([], "designs is empty"),
        ({"thickness": []}, "designs is empty"),
        ([5], "designs: 5 is not a set of parameters by name"),
        ([{5: 1.0}], "designs: {5: 1.0} is not a set of parameters by name"),
        ({"thickness": [[1.0], [1.0, 2.0]]}, "designs: thickness ="),
        ({"thicknes": [1e-3]}, "designs: drawn has no parameter 'thicknes'; did you mean \"thickness\"?"),
        ([{"thickness": 1e-3}, {"thicknes": 1e-3}], 'did you mean "thickness"?'),
    ],
)
def test_designs(call, designs, sentence):
    assert sentence in told(call, drawn, designs=designs, top=ROW)


@both
def test_parameters_without_a_value(call):
    assert "parameter 'width' of draw has no value in {'length': 0.1}" in told(
        call, lambda length, width: drawn(length=length), designs=[{"length": 0.1}], top=ROW
    ).replace("<lambda>", "draw")
    assert "give their values with designs" in told(call, lambda length: drawn(length=length), top=ROW)


@both
@pytest.mark.parametrize("mechanism", ["fourbar.toml", None, 5, lambda: None])
def test_no_mechanism(call, mechanism):
    assert (
        "is not a mechanism: give a function returning a mechanism, or give a ksd.Mechanism or its scene"
        in told(call, mechanism, top=0.1)
    )


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"threads": -1}, "threads = -1 must be a whole number of at least 1"),
        ({"threads": 0}, "threads = 0 must be a whole number of at least 1"),
        ({"threads": "a"}, "threads = 'a' must be a whole number of at least 1"),
        ({"thread": 2}, 'did you mean "threads"?'),
        ({"tabulated": "yes"}, "tabulated = 'yes' must be True or False"),
        ({"top": [[0.1]]}, "drive values top"),
    ],
)
def test_words_of_batch(given, sentence):
    assert sentence in told(ksd.batch, fourbar(), **{"top": ROW, **given})


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ({"modes": "a"}, "modes = 'a' must be a whole number"),
        ({"modes": 1.5}, "modes = 1.5 must be a whole number"),
        ({"modes": None}, "modes = None must be a whole number"),
        ({"at": 5}, "at = 5 must be three numbers (x, y, z) in m"),
        ({"at": "abc"}, "at = 'abc' must be three numbers"),
        ({"at": ("a", 0, 0)}, "at[0] = 'a' is not a number"),
        ({"at": (math.nan, 0, 0)}, "at[0] = nan is not finite"),
        ({"link": 5}, "link = 5 must be a name"),
        ({"link": "tpo"}, "link = 'tpo': there is no such link in 'fourbar'; did you mean \"top\"?"),
        (
            {"freed": "tpo"},
            "freed = 'tpo': there is no such drive or support in 'fourbar'; did you mean \"top\"?",
        ),
        ({"freed": 5}, "freed = 5: give a name, or several in a list"),
        ({"freed": [5]}, "freed = 5 must be a name"),
        ({"questions": 5}, "questions = 5: give a name, or several in a list"),
        ({"questions": [[]]}, "questions = [] must be a name"),
        ({"questions": "forces"}, 'did you mean "force"?'),
        ({"accuracy": "a"}, "accuracy = 'a' is not a number"),
        ({"accuracy": -1}, "accuracy = -1"),
        ({"errors": "a"}, "errors = 'a' must be True or False"),
        ({"together": "a"}, "together = 'a' must be True or False"),
        ({"progress": "a"}, "progress = 'a' must be True or False"),
        ({"resume": 5}, "resume = 5: give the name of a file"),
        ({"loads": {"a": 5}}, "a load case is a list such as"),
        ({"loads": {"a": "top"}}, "a load case is a list such as"),
        ({"loads": {"a": [5]}}, "load case 'a 1': 5 is no load"),
        (
            {"loads": {"a": [{"link": "top", "force": (0, 1, 0)}]}},
            "load case 'a 1': give at, the point (3,) [m] of",
        ),
        ({"modess": 3}, 'did you mean "modes"?'),
        ({"question": "force"}, 'did you mean "questions"?'),
    ],
)
def test_words_of_sweep(given, sentence):
    assert sentence in told(sweep, fourbar(), **{"top": ROW, **given})


def test_a_drive_without_a_value():
    assert "drive 'top' of 'fourbar' has no value" in told(sweep, fourbar())
    assert "a batch needs drive values" in told(ksd.batch, fourbar())


def test_designs_that_cannot_be_built_are_in_the_result():
    """The same for both: a number that does not do, and what the user's function says itself."""
    designs = [{"thickness": 1e-3}, {"thickness": -1.0}]
    found = ksd.batch(drawn, designs=designs, top=0.05)
    assert found.status[:, 0].tolist() == [0, 20]
    assert "this design cannot be built: CrossFlexure: thickness = -1.0" in found.why(1, 0)
    rows = sweep(drawn, designs=designs, questions="force", top=0.05)
    assert rows["status"][0] == "ok" and rows["status"][1] == found.why(1, 0)
