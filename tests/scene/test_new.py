"""`ksd new`: scenes to start from, which are read without a warning and solve as they are."""

import json
import warnings
from importlib.resources import files

import pytest

import ksd
from ksd.cli import main

SHIPPED = sorted(
    f.name.removesuffix(".toml")
    for f in (files("ksd") / "scenes").iterdir()
    # jobs are for `ksd optimise`
    if f.name.endswith(".toml") and not f.name.endswith("_job.toml")
)


@pytest.mark.parametrize("like", SHIPPED)
def test_a_new_scene_is_read_without_a_warning(like, tmp_path, capsys):
    file = tmp_path / "my \u00e9tage.toml"
    assert main(["new", str(file.with_suffix("")), "--like", like]) == 0
    assert f"ksd solve {file}" in capsys.readouterr().out
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        made, targets, options = ksd.load_scene(file)
    assert made.name == "my \u00e9tage" and options == {} and targets
    shipped, same, _ = ksd.load_scene(str(files("ksd") / "scenes" / f"{like}.toml"))
    made.name = like
    assert made.scene() == shipped.scene() and targets == same
    head, *lines = file.read_text(encoding="utf-8").splitlines()
    assert head == "#:schema ./ksd.schema.json" and f"{like}.toml" not in "\n".join(lines)
    assert json.loads((tmp_path / "ksd.schema.json").read_text())["title"] == "Scene file of ksd"


@pytest.mark.parametrize("like", ["pivot", "guide", "fourbar", "gripper"])
def test_a_new_scene_solves(like, tmp_path):
    file = tmp_path / "mine.toml"
    assert main(["new", str(file), "--like", like]) == 0
    made, targets, _ = ksd.load_scene(file)
    pose = ksd.solve(made, targets)
    # the fourbar of paper 1 is strained by more than a per cent
    assert pose.trusted and (like == "fourbar" or not pose.warnings)


def test_the_usual_one_is_a_commented_pivot(tmp_path, capsys):
    assert main(["new", str(tmp_path / "lever.toml")]) == 0
    text = (tmp_path / "lever.toml").read_text()
    assert "ksd sweep lever.toml" in text and text.count("#") > 25
    # what stands in it for later: with the mark taken away it is read too
    later = [line.removeprefix("# ") for line in text.splitlines() if line.startswith("# [[leaf")]
    assert later == ["[[leaf]]"]
    told = text.replace("# [[leaf]]", "[[leaf]]").splitlines()
    start = told.index("[[leaf]]") + 1
    told[start : start + 8] = [line.removeprefix("# ") for line in told[start : start + 8]]
    more = [line.removeprefix("# ") for line in told]
    keys = ("plane = ", "consider = ", "moment = ", "[options]", "method = ", "accuracy = ")
    told = [short if short.startswith(keys) else line for line, short in zip(told, more, strict=True)]
    (tmp_path / "lever.toml").write_text("\n".join(told))
    scene, _, options = ksd.load_scene(tmp_path / "lever.toml")
    found = scene.scene()
    assert (
        len(found.leaves) == 1
        and found.plane == "xy"
        and found.consider
        and found.loads[0].moment[2] == 0.005
    )
    assert options == {"method": "full", "accuracy": 1e-4}


def test_a_new_job_is_read_and_fits_its_schema(tmp_path, capsys):
    file = tmp_path / "hinge.toml"
    assert main(["new", str(file), "--like", "pivot_job"]) == 0
    assert f"ksd optimise {file}" in capsys.readouterr().out
    head, *lines = file.read_text().splitlines()
    assert head == "#:schema ./ksd.job.schema.json" and 'name = "hinge"' in lines
    assert "ksd optimise hinge.toml" in lines[0] and "pivot_job" not in "\n".join(lines)
    assert json.loads((tmp_path / "ksd.job.schema.json").read_text())["title"] == "Job file of ksd"
    made = ksd.load_job(file)
    shipped = ksd.load_job(str(files("ksd") / "scenes" / "pivot_job.toml"))
    assert made.job.names == shipped.job.names and made.words == shipped.words


def test_nothing_is_overwritten_and_wrong_words_are_refused(tmp_path, capsys):
    file, schema = tmp_path / "lever.toml", tmp_path / "ksd.schema.json"
    file.write_text("mine")
    assert main(["new", str(tmp_path / "lever")]) == 2
    assert "lever.toml is there already and is not overwritten" in capsys.readouterr().err
    assert file.read_text() == "mine" and not schema.exists()
    assert main(["new", str(tmp_path / "other"), "--like", "guied"]) == 2
    assert 'there is no such scene; did you mean "guide"?' in capsys.readouterr().err
    schema.write_text("mine too")
    assert main(["new", str(tmp_path / "other")]) == 0 and schema.read_text() == "mine too"
    assert "schema" not in capsys.readouterr().out
    assert main(["new", str(tmp_path / "no folder" / "x")]) == 2
    assert "does not exist" in capsys.readouterr().err
    assert main(["new", str(tmp_path / "a\tb")]) == 2
    assert "printable characters" in capsys.readouterr().err


def test_a_plain_number_in_another_unit_is_one_line_of_the_command(tmp_path, capsys):
    assert main(["new", str(tmp_path / "lever")]) == 0
    text = (tmp_path / "lever.toml").read_text().replace('at = ["200 mm", 0, 0]', "at = [200, 0, 0]")
    (tmp_path / "lever.toml").write_text(text)
    capsys.readouterr()
    assert main(["doctor", str(tmp_path / "lever.toml")]) == 0
    said = capsys.readouterr().err
    number = text.splitlines().index("at = [200, 0, 0]") + 1
    assert said == (
        f"ksd: lever.toml, line {number}, [[load]] 1: at = 200 is 200 m: did you mean '200 mm'? Plain numbers are in SI.\n"
    )


def test_a_plain_drive_value_in_another_unit_is_one_line_too(tmp_path, capsys):
    assert main(["new", str(tmp_path / "lever")]) == 0
    capsys.readouterr()
    assert (
        main(["compare", str(tmp_path / "lever.toml"), "--set", "turn=20", "--method", "full", "--quiet"])
        == 2
    )
    said = capsys.readouterr().err.splitlines()
    assert said[0] == "ksd: --set turn=20 is 20 rad: did you mean --set turn=20deg? Plain numbers are in SI."
    assert len(said) == 2
    assert (
        main(["compare", str(tmp_path / "lever.toml"), "--set", "turn=20deg", "--method", "full", "--quiet"])
        == 0
    )
    assert not capsys.readouterr().err.strip()  # an old rich leaves an empty line
