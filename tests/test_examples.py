"""Every script of examples/ runs, prints its answers, draws its picture, and its numbers are those of this table."""

import math
import runpy
from pathlib import Path

import pytest

FOLDER = Path(__file__).resolve().parents[1] / "examples"
LINES = 60
SHOOTING = "shooting of exact rods, order 8"

NUMBERS = {
    "cantilever": {
        "x": (0.0859561617, 1e-6, "Lan 2005, table 2.3"),
        "y": (0.0491835530, 1e-6, "Lan 2005, table 2.3"),
        "angle": (0.7651820133, 1e-6, "Lan 2005, table 2.3"),
    },
    "indexer": {
        "force_one": (126.9213, 1e-5, SHOOTING),
        "turn": (-0.0365683, 1e-5, SHOOTING),
        "force_two": (212.4774, 1e-5, SHOOTING),
        "C_x": (0.8138033e-3, 1e-5, SHOOTING),
        "C_y": (-0.0506014e-3, 1e-5, SHOOTING),
    },
    "parallel_mechanism": {
        "force_quarter": (2948.737, 1e-5, SHOOTING),
        "drop_A": (-0.94576e-3, 1e-5, SHOOTING),
        "drop_B": (-0.98923e-3, 1e-5, SHOOTING),
        "force_half": (7370.185, 1e-5, SHOOTING),
        "tilt": (0.0107066, 1e-5, SHOOTING),
    },
    "planar_spring": {
        "pull": (34224.63, 1e-5, SHOOTING),
        "press": (31148.72, 1e-5, SHOOTING),
        # the reference is the secant of 1 nm, 2.4e-5 stiffer
        "at_rest": (32572.91 - 0.77, 1e-5, SHOOTING),
    },
    "slider": {
        "force": (5.199210, 1e-5, SHOOTING),
        "pin_x": (5.199210, 1e-5, SHOOTING),
        "pin_y": (-0.737897, 1e-5, SHOOTING),
        "C_x": (-0.03552664e-3, 1e-5, SHOOTING),
        "C_y": (-2.440338e-3, 1e-5, SHOOTING),
    },
}  # fmt: skip
"""Script: answer: value [SI], relative tolerance, and where the value comes from."""


def test_table_and_folder_agree():
    assert sorted(path.stem for path in FOLDER.glob("*.py")) == sorted(NUMBERS)


@pytest.mark.parametrize("name", sorted(NUMBERS))
def test_example(name, capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("MPLBACKEND", "Agg")
    monkeypatch.chdir(tmp_path)
    script = FOLDER / f"{name}.py"
    assert len(script.read_text().splitlines()) <= LINES
    # not as "__main__": nothing is written
    answers = runpy.run_path(str(script))
    assert "?" in answers["__doc__"].splitlines()[0], "the docstring begins with the question"
    printed = capsys.readouterr().out
    assert any(sign.isdigit() for sign in printed), "no numbers printed"
    for answer, (value, within, source) in NUMBERS[name].items():
        found = float(answers[answer])
        assert math.isclose(found, value, rel_tol=within, abs_tol=1e-300), (
            f"{answer} {found}: {value}, {source}"
        )
    assert answers["picture"]().axes, "nothing drawn"
    assert not list(tmp_path.iterdir()), "a picture that nobody asked for"
