"""Job files: the job of the specification from its file and from the command line, and every mistake in a sentence."""

import json
import pickle
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from test_job import BEST

import ksd
from ksd.cli import main
from ksd.optimisation import optimise as room

SHIPPED = Path(ksd.__file__).parent / "scenes" / "pivot_job.toml"
TEXT = SHIPPED.read_text(encoding="utf-8")
WIDTHS = "joint.cross.widths = [["
SMALL = TEXT.replace('turn = ["0 deg", "15 deg", "30 deg"]', 'turn = "30 deg"').replace("starts = 2\n", "")
"""The shipped job at one pose."""


def written(folder, text=SMALL, name="job.toml"):
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def test_the_shipped_job_is_that_of_the_specification():
    job, words = ksd.load_job(SHIPPED)
    names = [f"joint.cross.{n}" for n in ("length", "angle", "thickness", "widths[0]", "widths[1]")]
    assert list(job.parameters) == names and words["starts"] == 2
    assert words["spread"]["joint.cross.widths[1]"] == pytest.approx(20e-6)
    x = job.point(list(BEST.values()))
    assert job.merit(job.values(x)) == pytest.approx(0.5035665, abs=1e-5)
    assert job.margins(job.values(x)).min() == pytest.approx(0, abs=1e-5) and job.rule_values(x)[
        0
    ] == pytest.approx(0, abs=1e-6)
    assert [dict(step)["turn"] for _, step in job.poses] == pytest.approx(np.radians([0, 15, 30]))
    # the point asked about is the crossing, wherever the joint begins
    assert job.function(**job.design_at(x)).scene().joints[0].origin[0] == pytest.approx(
        -0.04 * np.cos(BEST["angle"])
    )
    other = pickle.loads(pickle.dumps(job))
    assert np.array_equal(other.values(x), job.values(x))


def test_the_command_line_writes_what_is_asked(tmp_path, capsys):
    path = written(tmp_path)
    to = {
        n: str(tmp_path / n) for n in ("a.json", "all.csv", "how.png", "page.html", "best.toml", "rows.jsonl")
    }
    words = [
        "--json",
        to["a.json"],
        "--out",
        to["all.csv"],
        "--plot",
        to["how.png"],
        "--report",
        to["page.html"],
    ]
    words += ["--save", to["best.toml"], "--resume", to["rows.jsonl"], "--quiet"]
    assert main(["optimise", str(path), *words]) == 0
    printed = capsys.readouterr().out
    assert "1 of 1 starts end here" in printed and "joint.cross.length at its most" in printed
    found = json.loads(Path(to["a.json"]).read_text())
    best = found.get("answer", found)
    assert best["design"]["joint.cross.thickness"] == pytest.approx(BEST["thickness"], rel=1e-4)
    mechanism, targets, _ = ksd.load_scene(to["best.toml"])
    pose = ksd.solve(mechanism, targets, method="full")
    assert pose.stress(points=9).largest_Pa == pytest.approx(500e6, rel=1e-4)
    # names and units of the file stay
    lines = Path(to["best.toml"]).read_text().splitlines()
    assert {"[joint.cross]", 'length = "80 mm"', 'value = "30 deg"'} <= set(lines), lines
    assert len(Path(to["all.csv"]).read_text().splitlines()) > best["values"]
    assert all(Path(p).stat().st_size > 300 for p in to.values())


def test_command_line_over_the_file(tmp_path, capsys):
    path = written(tmp_path)
    start = [w for n, v in (("length", "80mm"), ("angle", "41.64deg"), ("thickness", "0.62mm"), ("widths[0]", "43.97mm"),
                            ("widths[1]", "0.013")) for w in ("--start", f"joint.cross.{n}={v}")]  # fmt: skip
    words = ["--set", "turn=20deg:30deg:2", "--robust", "3", *start, "--json", "-", "--quiet"]
    assert main(["optimise", str(path), *words]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["merit"] == pytest.approx(0.4482, abs=1e-3) and found["robust"] == 3
    assert found["starts"][0]["start"]["joint.cross.angle"] == pytest.approx(np.radians(41.64))
    assert any("turn 20.00 deg" in name for name in found["answers"])


def test_a_scene_in_a_file_of_its_own_loads_and_free_sides(tmp_path):
    shutil.copy(SHIPPED.parent / "cross_flexure.toml", tmp_path / "cross.toml")
    text = """
    [job]
    scene = "cross.toml"
    link = "lever"
    minimise = "strain_energy_J"
    limits = {support_z_N_per_m = [1e5, inf], size_mm = [inf, 90, inf]}
    [job.vary]
    "joint.cross.widths" = [["20 mm", "60 mm"], "20 mm"]
    join.1.at = [["-60 mm", "-20 mm"], 0, 0]
    [[job.loads.laden]]
    link = "lever"
    force = [0, 0, "-5 N"]
    at = ["100 mm", 0, 0]
    [job.loads]
    """
    text = text.replace("    [job.loads]\n", "")
    job, words = ksd.load_job(written(tmp_path, text))
    assert job.parameters == ("joint.cross.widths[0]", "join[1].at[0]") and words == {}
    assert dict(job.poses[0][1]) == {"lever": pytest.approx(np.pi / 4)} and job.poses[0][0] == "laden"
    assert job.limits == {"support_z_N_per_m": (1e5, np.inf), "size_y_mm": (-np.inf, 90)}
    drawn = job.function(**{"joint.cross.widths[0]": 0.03, "join[1].at[0]": -0.05}).scene()
    assert drawn.joints[0].origin[0] == -0.05 and drawn.joints[0].joint.widths == (0.03, 0.02)


def test_what_varies_may_stand_as_a_formula_in_the_scene(tmp_path):
    text = SMALL.replace('thickness = "0.4 mm"', 'thickness = "= 0.01 * joint.cross.length"')
    job, _ = ksd.load_job(written(tmp_path, text))
    assert (
        job.function(**job.design_at(job.point(None))).scene().joints[0].joint.thickness == job.point(None)[2]
    )


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("maximise =", "maximize =", r"\[job\]: key 'maximize' is unknown; did you mean \"maximise\""),
        ("support_worst_N_per_m =", "suport_worst_N_per_m =", r"no answer 'suport_worst_N_per_m'.*did you mean"),
        ("joint.cross.length = [", "joint.crss.length = [", r"no 'crss' in joint in the scene; did you mean \"cross\""),
        ("joint.cross.angle = [", "joint.cross.angel = [", r"key 'angel' is unknown; did you mean \"angle\""),
        ('["31 deg", "59 deg"]', '["31 mm", "59 mm"]', r"angle = '31 mm': an angle is expected"),
        ('["31 deg", "59 deg"]', '["59 deg", "31 deg"]', r"holds no design: the least must be below the most"),
        ('["31 deg", "59 deg"]', '"31 deg"', r"joint.cross.angle = '31 deg': give least and most"),
        ('["31 deg", "59 deg"]', '["1 deg", "9 deg"]', r"lies outside the trained range"),
        (WIDTHS + '"10 mm", "60 mm"], [', "joint.cross.widths = [[", r"it is a list of 2 in the scene"),
        ("rules = [", 'rules = ["-1 mm", ', r"rule '-1 mm' is met by none"),
        ("rules = [", "rules = [1, ", r"rules = \[1, .*give formulas"),
        ("rules = [", 'rules = ["joint.cross.width", ', r"no width in joint.cross; did you mean \"widths\""),
        ("0.5 * joint", "0.5 * jont", r"there is no jont.cross.length; did you mean \"joint\""),
        ('turn = "30 deg"', 'turm = "30 deg"', r"there is no drive 'turm'; did you mean \"turn\""),
        ('turn = "30 deg"', 'turn = "30 mm"', r"\[job.drives\]: turn = '30 mm': an angle is expected"),
        ('turn = "30 deg"', 'turn = "0deg:30deg"', r"write a range as FROM:TO:POSES"),
        ('turn = "30 deg"', "", r"the scene names no drive values"),
        ("[optimise]", "[optimise]\nstart.joint.cross.angle = 1.2", r"start: parameter 'joint.cross.length' has no value"),
        ("[optimise]", "[optimise]\nstarts = 0", r"starts = 0"),
        ("[optimise]", '[optimise]\nmethod = "gradiant"', r"method = 'gradiant'.*gradient"),
        ("[optimise]", "[optimise]\nstrats = 3", r"\[optimise\]: key 'strats' is unknown; did you mean \"starts\""),
        ("[optimise.spread]", "[optimise.spred]", r"key 'spred' is unknown; did you mean \"spread\""),
        ("[job]\n", '[job]\nscene = "cross_flexure.toml"\n', r"names the scene file .*, but 'name' stands"),
        ("[job]\n", '[options]\nwith = "warping"\n[job]\n', r"\[options\]: with = 'warping' changes what is simulated"),
    ],
)  # fmt: skip
def test_mistakes_are_told_in_one_sentence(old, new, sentence, tmp_path, capsys):
    assert old in SMALL
    assert main(["optimise", str(written(tmp_path, SMALL.replace(old, new, 1))), "--quiet"]) == 2
    told = capsys.readouterr().err

    assert re.search(sentence, told), told
    assert "Traceback" not in told and told.startswith("ksd: ")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["--start", "joint.cross.length"], "write it as NAME=VALUE"),
        (["--start", "joint.cross.length=9 ells"], "give a number in SI"),
        (["--set", "turm=3deg"], "there is no drive 'turm'"),
        (["--out", "a.txt"], "--out a.txt: the ending must be one of"),
        (["--plot", "a.doc"], "type 'doc' is unknown"),
        (["--report", "none/a.html"], "folder 'none' does not exist"),
        (["--robust", "-1"], "robust = -1"),
        (["--method", "cmaes"], "choose one of gradient, trust-constr, cobyla, cma"),
    ],
)
def test_wrong_options(words, sentence, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["optimise", str(written(tmp_path)), *words, "--quiet"]) == 2
    assert sentence in capsys.readouterr().err


def test_no_design_exits_3_and_ctrl_c_130(tmp_path, capsys, monkeypatch):
    path = written(tmp_path, SMALL.replace("stress_MPa = 500", "stress_MPa = 1"))
    tried = tmp_path / "tried.csv"
    assert main(["optimise", str(path), "--out", str(tried), "--quiet"]) == 3
    assert "none of 1 starts led to a design that meets the limits" in capsys.readouterr().err
    assert len(tried.read_text().splitlines()) > 3

    def pressed(*words):
        raise KeyboardInterrupt

    monkeypatch.setattr(room, "_run_start", pressed)
    rows = str(tmp_path / "rows.jsonl")
    assert main(["optimise", str(written(tmp_path)), "--quiet", "--resume", rows]) == 130
    assert f"the designs done are in {rows}" in capsys.readouterr().err
    assert main(["optimise", str(SHIPPED.parent / "cross_flexure.toml")]) == 2
    assert "[job] is missing" in capsys.readouterr().err
    assert main(["optimise", str(tmp_path / "none.toml")]) == 2
    assert "none.toml" in capsys.readouterr().err
