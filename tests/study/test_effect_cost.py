"""The effect cost of a scene: `ksd effects`, its table, JSON and picture, and what it says."""

import json
from importlib.resources import files
from itertools import count

import numpy as np
import pytest
from scenes import fourbar

import ksd
from ksd.cli import main
from ksd.study.effect_cost import _solve_times, effect_cost

FOURBAR = str(files("ksd") / "scenes" / "fourbar.toml")


@pytest.fixture(scope="module")
def costs():
    scene = fourbar()
    scene.joint_spring("lower left", stiffness=0.5)
    return effect_cost(scene, {"top": 0.1}, rounds=1)


def test_every_effect_has_its_cost(costs):
    choice, rows = costs
    assert [r.name for r in rows] == ["spatial", "shear", "warping", "plate", "springs"]
    by_name = {r.name: r for r in rows}
    assert (
        [r.is_simulated for r in rows]
        == [choice[r.name].present for r in rows]
        == [False, True, False, False, True]
    )
    # the plane changes nothing but the number of unknowns
    spatial = by_name["spatial"]
    assert max(abs(c) for c in spatial.relative_changes().values()) < 1e-9
    assert spatial.unknowns[0] > 2 * spatial.unknowns[1]
    # warping has no part in the plane, but in what holds the link across it
    warping = by_name["warping"].relative_changes()
    assert warping["force top"] == pytest.approx(0.0, abs=1e-9) and warping["support stiffness"] > 0.01
    for name, answers in (("springs", {"with_": "springs"}), ("plate", {"with_": "plate"})):
        scene = fourbar()
        scene.joint_spring("lower left", stiffness=0.5)
        with_, without = (
            ksd.solve(scene, top=0.1, method="conventional", **w).forces["top"]
            for w in (answers, {"without": name})
        )
        assert by_name[name].relative_changes()["force top"] == pytest.approx(
            (with_ - without) / with_, rel=1e-6
        )
    assert all(min(r.times) > 0 for r in rows)


def test_times_are_seconds(monkeypatch):
    clock = count(0, 2_000_000)
    monkeypatch.setattr("ksd.study.effect_cost.time.thread_time_ns", lambda: next(clock))
    assert _solve_times((lambda *_, **__: None,) * 2, {}, 3) == pytest.approx((2e-3, 2e-3))


def test_unknowns_are_those_solved_for():
    model = ksd.compile_scene(fourbar())
    spatial = ksd.compile_scene(fourbar(), with_="spatial")
    inner = model.arrays.members.inner_at[-1]
    assert spatial.unknown_count == 18 + 1 + inner == 247
    assert model.unknown_count == 9 + 1 + 12 * 9


def test_the_command(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("ksd.study.effect_cost.TIMED_SOLVES", 1)
    out, picture = tmp_path / "costs.json", tmp_path / "costs.png"
    assert main(["effects", FOURBAR, "--set", "top=50mm", "--json", str(out), "--plot", str(picture)]) == 0
    said = capsys.readouterr().out
    assert "with shear" in said and "without warping: not mentioned; would be 23 %" in said
    found = json.loads(out.read_text())
    assert set(found["effect_cost"]) == {"spatial", "shear", "warping", "plate"}
    row = found["effect_cost"]["shear"]
    assert row["simulated"] and abs(row["relative_change"]["force top"]) < 1e-3
    assert np.isfinite(row["time_with_s"]) and row["unknowns_with"] == row["unknowns_without"]
    assert picture.stat().st_size > 10_000


def test_solving_with_words_from_the_command_line(tmp_path, capsys):
    out = tmp_path / "a.json"
    forces = {}
    for words in ((), ("--with", "plate"), ("--effects", "all"), ("--without", "shear")):
        assert main(["solve", FOURBAR, "--set", "top=50mm", "--json", str(out), *words]) == 0
        forces[words] = json.loads(out.read_text())["drives"]["top"]["force_N"]
    assert forces["--with", "plate"] > 1.005 * forces[()]
    assert forces["--effects", "all"] == pytest.approx(forces["--with", "plate"], rel=1e-3)
    assert forces["--without", "shear"] != forces[()]
    assert main(["solve", FOURBAR, "--without", "sheer"]) == 2
    assert "did you mean" in capsys.readouterr().err


def test_options_of_a_scene_file(tmp_path):
    text = (files("ksd") / "scenes" / "fourbar.toml").read_text()
    path, out = tmp_path / "scene.toml", tmp_path / "a.json"
    path.write_text(text + '\n[options]\nwith = "plate"\nmethod = "conventional"\n')
    assert main(["solve", str(path), "--json", str(out)]) == 0
    with_plate = ksd.solve(fourbar(), top=0.3, with_="plate", method="conventional").forces["top"]
    assert json.loads(out.read_text())["drives"]["top"]["force_N"] == pytest.approx(with_plate, rel=1e-4)


def test_the_report_lists_effects(tmp_path):
    out = tmp_path / "page.html"
    scene = fourbar()
    scene.mass("top", mass=1e-5, at=(0, 0.37, 0))
    scene.gravity = (0, -9.81, 0)
    path = tmp_path / "scene.toml"
    ksd.save_scene(scene, path, targets={"top": 0.05})
    assert main(["report", str(path), "--out", str(out), "--poses", "2", "--quiet"]) == 0
    text = out.read_text()
    assert "with shear" in text and "with gravity" in text and "(0, -9.81, 0) m/s^2 on 1 mass" in text
    assert "without plate" in text and "would be" in text
