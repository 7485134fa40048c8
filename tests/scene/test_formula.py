"""Formulas in files: numbers, units and names of the file; anything else is refused in a sentence."""

import math

import pytest

from ksd import SceneError
from ksd.scene.formula import evaluate_formula, si_value

TABLES = {
    "joint": {"cross": {"length": "100 mm", "angle": "45 deg", "widths": ["40 mm", 0.02], "half": "= 1"}},
    "join": [{"name": "lower left", "at": [0.1, 0, 0]}, {"a": "ground", "at": [0.3, 0, 0]}],
}


@pytest.mark.parametrize(
    ("formula", "value"),
    [
        ("70 mm - joint.cross.widths[0] - 2 * joint.cross.widths[1]", -0.01),
        (" -0.5*joint.cross.length*cos(joint.cross.angle) ", -0.05 * math.cos(math.pi / 4)),
        ('join["lower left"].at[0] + join[2].at[0]', 0.4),
        ("2e-3 - 1", -0.998),
        ("1e2 mm/2", 0.05),
        ("min(3, max(1 mm, 2), 5) ** 2 + pi - +sqrt(4)", 2 + math.pi),
    ],
)
def test_values(formula, value):
    assert evaluate_formula(formula, TABLES) == pytest.approx(value, rel=1e-15)


@pytest.mark.parametrize(
    ("formula", "sentence"),
    [
        ("joint.cros.length", r"there is no cros.length in joint; did you mean \"cross\""),
        ("joint.cross.widths[2]", r"there is no \[2\] in joint.cross.widths"),
        ("joint.cross.half * 2", "joint.cross.half is a formula itself"),
        ("join[1]", r"join\[1\]"),
        ("sine(1)", r"there is no function sine; did you mean \"sin\""),
        ("sin(1, 2)", "sin of 2 numbers is none"),
        ("1 +", "cannot be read"),
        ("1 / 0", "has no value: "),
        ("(-1) ** 0.5", "has no value"),
        ("1e400", "has no value"),
        ("3 parsec", "give a number in SI, or text with a unit"),
        ("__import__('os').system('ls')", "no number, name or sum"),
        ("[1][0]", "no number, name or sum"),
        ("'70'", "no number, name or sum"),
        ("(" * 300 + ")" * 300, "cannot be read"),
        ("1+" * 600 + "1", "longer than 1000 letters"),
    ],
)
def test_what_is_no_formula_is_told(formula, sentence):
    with pytest.raises(SceneError, match=sentence):
        evaluate_formula(formula, TABLES)


def test_amounts_of_any_dimension():
    assert (
        si_value("4 um", "spread") == pytest.approx(4e-6)
        and si_value("500 MPa", "") == 5e8
        and si_value(3, "") == 3
    )
    with pytest.raises(SceneError, match=r"spread = '4 ells': give a number"):
        si_value("4 ells", "spread")
