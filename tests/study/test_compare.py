"""`ksd.compare`: each row is what `ksd.solve` gives, its error that against finer leaf springs, and who cannot says why."""

import csv
import math

import numpy as np
import pytest
from scenes import STEEL, fourbar, single_joint

import ksd
from ksd.cli import main
from ksd.errors import SceneError
from ksd.model.mesh import Mesh
from ksd.study.compare import METHODS, REFERENCE_MESH, compared_methods

QUIET = {"progress": False, "repeats": 3}


def row(table, method, leaves="strain-mode"):
    (found,) = table.where(method=method, leaf_springs=leaves).rows()
    return found


@pytest.fixture(scope="module")
def found():
    return ksd.compare(fourbar(), top=0.3, **QUIET)


def test_every_way_is_a_row(found):
    ways = compared_methods(fourbar().scene(), {"top": 0.3}, Mesh(), 5)
    assert [(r["method"], r["leaf_springs"]) for r in found.rows()] == [(w.method, w.leaves) for w in ways]
    assert set(METHODS) == {w.method for w in ways}


def test_answers_and_errors_are_those_of_single_solves(found):
    exact = ksd.solve(fourbar(), top=0.3, method="conventional", mesh=REFERENCE_MESH)
    links = len(exact.model.scene.links)
    moved = np.linalg.norm(exact.motion.x[:links] - exact.model.rest.x[:links], axis=1).max()
    for method, leaves, words in (
        ("kinematic", "strain-mode", {}),
        ("full", "strain-mode", {}),
        ("conventional", "5 elements", {"mesh": Mesh("corotational", elements=5)}),
    ):
        pose = ksd.solve(fourbar(), top=0.3, method=method, **words)
        told = row(found, method, leaves)
        assert told["top_force_N"] == pytest.approx(pose.forces["top"], rel=1e-9)
        off = np.linalg.norm(pose.motion.x[:links] - exact.motion.x[:links], axis=1).max()
        force = abs(pose.forces["top"] / exact.forces["top"] - 1)
        assert told["force_error_percent"] == pytest.approx(100 * force, rel=1e-4, abs=1e-7)
        assert told["displacement_error_percent"] == pytest.approx(100 * off / moved, rel=1e-4, abs=1e-7)
        assert told["error_percent"] == max(told["force_error_percent"], told["displacement_error_percent"])
        assert told["reported_error_percent"] == pytest.approx(100 * pose.error.relative, rel=1e-6, abs=1e-9)
        assert told["time_us"] >= told["steps_us"] > 0
    # figures of paper 1, reading 1
    assert row(found, "conventional, Newton", "5 elements")["top_force_N"] == pytest.approx(519.484, rel=1e-5)


def test_what_answers_tell_of_their_error_is_their_error(found):
    for told in found.rows():
        if told["status"] == "ok" and told["error_percent"] > 1e-4:
            assert told["reported_error_percent"] == pytest.approx(told["error_percent"], rel=0.15)


def test_who_cannot_do_it_says_why_and_the_others_stand(found):
    (failure,) = found.failures
    assert failure["method"] == "constant" and "not to be trusted" in failure["status"]
    said = str(found)
    assert "(1) row 0: not to be trusted" in said and max(map(len, said.splitlines())) <= 100
    assert "strain-mode leaves of order 6, 5, 9 by method conventional (their own error " in said
    heavy = fourbar()
    heavy.gravity = (0, -9.81, 0)
    table = ksd.compare(heavy, top=0.1, methods=("constant", "modal", "full"), **QUIET)
    assert "knows no leaf springs with weight" in row(table, "constant")["status"]
    assert "which modal bodies do not know" in row(table, "modal")["status"]
    assert row(table, "full")["status"] == "ok"
    lighter = ksd.compare(heavy, top=0.1, methods="modal", without="gravity", **QUIET)
    assert row(lighter, "modal")["error_percent"] < 0.1


def test_without_drives_the_way_of_the_links_is_the_answer():
    m = ksd.Mechanism("cantilever")
    tip, length = m.link("tip"), 0.1
    section = ksd.rectangle(1e-3, 0.02)
    m.leaf(
        m.ground, tip, start=(0, 0, 0), end=(length, 0, 0), section=section, material=STEEL, width_axis="z"
    )
    m.load(tip, force=(0, 0.01, 0), at=(length, 0, 0))
    table = ksd.compare(m, methods=("conventional",), **QUIET)
    # its own end moves as F L^3 / 3 EI, and a little by shear
    bend = 0.01 * length**3 / (3 * STEEL.E * section.Iz)
    for told in table.rows():
        assert told["moved_mm"] == pytest.approx(1e3 * bend, rel=1e-3)
        assert math.isnan(told["force_error_percent"])
        assert told["error_percent"] == told["displacement_error_percent"] < 0.5
    assert "moved" in str(table).partition("Times:")[0]


def test_modal_bodies_of_many_leaf_springs_wait_until_they_are_named(monkeypatch):
    monkeypatch.setattr("ksd.study.compare.MODAL_LEAVES", 2)
    words = {"methods": None, **QUIET}
    table = ksd.compare(single_joint(), turn=0.2, **words)
    assert "name it in methods to wait for it" in row(table, "modal")["status"]
    assert row(ksd.compare(single_joint(), turn=0.2, methods="modal", **QUIET), "modal")["status"] == "ok"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ({"methods": "fll"}, "method 'fll' is not compared; did you mean \"full\""),
        ({"methods": 3}, "methods = 3: give a name, or several in a list"),
        ({"elements": 0}, "elements = 0 must be a whole number of at least 1"),
        ({"repeats": 1.5}, "repeats = 1.5"),
        ({"progress": "no"}, "progress = 'no' must be True or False"),
        ({"tun": 0.1}, "drive 'tun' is not in this mechanism"),
        ({"extrapolate": 2}, "extrapolate = 2"),
    ],
)
def test_wrong_words_are_refused(words, said):
    with pytest.raises(SceneError) as caught:
        ksd.compare(single_joint(), **{"turn": 0.2, **QUIET, **words})
    assert said in str(caught.value)


def test_the_command_prints_writes_and_draws(tmp_path, capsys):
    assert main(["new", str(tmp_path / "lever")]) == 0
    scene = str(tmp_path / "lever.toml")
    out, plot = str(tmp_path / "a.csv"), str(tmp_path / "a.png")
    few = ["--method", "reduced", "--method", "conventional", "--elements", "3", "--quiet"]
    assert main(["compare", scene, "--set", "turn=10deg", *few, "--out", out, "--plot", plot]) == 0
    said = capsys.readouterr().out
    assert "3 elements" in said and "reduced" in said and "kinematic" not in said
    with open(out) as file:
        written = list(csv.DictReader(file))
    assert len(written) == 4 and {r["status"] for r in written} == {"ok"}
    made, _, _ = ksd.load_scene(scene)
    force = ksd.solve(made, turn=math.radians(10), method="conventional").forces["turn"]
    assert float(written[1]["turn_moment_Nm"]) == pytest.approx(force, rel=1e-9)
    assert (tmp_path / "a.png").stat().st_size > 10000
    assert main(["compare", scene, "--method", "constant", "--quiet", "--plot", plot]) == 2
    assert "--plot: no method has both a time and an error here" in capsys.readouterr().err
    assert main(["compare", scene, "--out", "a.txt"]) == 2
    assert "the ending must be one of" in capsys.readouterr().err
