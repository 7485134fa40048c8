"""The command line in process: results, files, exit codes, one sentence for everything that goes wrong."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from processes import environment

import ksd
from ksd.cli import main

ROOT = Path(__file__).resolve().parents[1]
SCENES = ROOT / "ksd" / "scenes"
FOURBAR, CROSS = str(SCENES / "fourbar.toml"), str(SCENES / "cross_flexure.toml")
needs_full = pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
LEAF = """
name = "leaf"
links = ["tip"]
[material.steel]
E = "200 GPa"
nu = 0.3
[[leaf]]
a = "ground"
b = "tip"
start = [0, 0, 0]
end = ["100 mm", 0, 0]
width_axis = "z"
thickness = "0.5 mm"
width = "20 mm"
material = "steel"
[[actuate]]
link = "tip"
about = "z"
name = "turn"
"""


@pytest.fixture
def record(monkeypatch):
    """The trained record that ships with the package."""
    assert (ROOT / "database" / "cross_flexure.h5").is_file(), (
        "run `ksd train cross_flexure` in the project root"
    )
    monkeypatch.setenv("KSD_DATABASE", str(ROOT / "database"))


@pytest.fixture
def no_record(monkeypatch, tmp_path):
    """A place without any joint record."""
    monkeypatch.setattr("ksd.library.record_files._folder_names", lambda: [str(tmp_path / "none")])


@pytest.fixture
def scene(tmp_path):
    """A scene file with a single leaf and lines added to it; no joint record needed."""

    def write(more=""):
        (tmp_path / "leaf.toml").write_text(LEAF + more)
        return str(tmp_path / "leaf.toml")

    return write


def refused(capsys, argv, code, *words):
    """`argv` ends with `code` and one sentence on stderr that says all `words`."""
    assert main(argv) == code
    out, err = capsys.readouterr()
    assert err.startswith("ksd: ") and err.count("\n") == 1 and err.rstrip().endswith((".", "?", "!")), err
    assert "Traceback" not in err
    for word in words:
        assert word in err, err
    return out


def test_solve_prints_tables_and_writes_files(record, capsys, tmp_path):
    argv = ["solve", FOURBAR, "--method", "reduced", "--set", "top=100mm"]
    assert main([*argv, "--json", str(tmp_path / "a.json"), "--plot", str(tmp_path / "a.png")]) == 0
    out = capsys.readouterr().out
    for word in (
        "fourbar: solved by reduced",
        "1 close loops",
        "Estimated error",
        "stable",
        "lower left",
        "top",
    ):
        assert word in out
    numbers = json.loads((tmp_path / "a.json").read_text())
    assert numbers["drives"]["top"]["value_mm"] == pytest.approx(100)
    assert numbers["drives"]["top"]["force_N"] == pytest.approx(64.1, rel=2e-3)
    assert (tmp_path / "a.png").stat().st_size > 10000


def test_value_comes_from_the_file_and_json_goes_to_stdout(record, capsys):
    assert main(["solve", FOURBAR, "--method", "full", "--json", "-"]) == 0
    numbers = json.loads(capsys.readouterr().out)
    assert numbers["drives"]["top"]["value_mm"] == pytest.approx(300)
    assert numbers["drives"]["top"]["force_N"] == pytest.approx(521.195, rel=1e-4)


def test_curvature_modes_are_raised_as_ksd_solve_does(capsys):
    """The arm twists one leaf so much that its highest torsion mode holds a share of its energy."""
    assert main(["solve", str(SCENES / "arm.toml"), "--json", "-"]) == 0
    told = json.loads(capsys.readouterr().out)
    mechanism, targets, _ = ksd.load_scene(SCENES / "arm.toml")
    assert told["leaf_model"] == str(ksd.solve(mechanism, targets).model.mesh) != str(ksd.Mesh())
    assert all("width 18 mm is more than its length" in w for w in told["warnings"])


def test_elements_passes_accuracy_and_vtu(record, capsys, tmp_path):
    assert (
        main(
            [
                "solve",
                FOURBAR,
                "--method",
                "reduced",
                "--relinearisations",
                "1",
                "--elements",
                "5",
                "--json",
                "-",
            ]
        )
        == 0
    )
    numbers = json.loads(capsys.readouterr().out)
    assert "5 Appendix A elements" in numbers["leaf_model"]
    assert sum(s["name"].startswith("3") for s in numbers["steps"]) == 2
    assert main(["solve", FOURBAR, "--accuracy", "0.05", "--plot", str(tmp_path / "a.vtu")]) == 0
    assert "solved by conventional" in capsys.readouterr().out
    assert "VTKFile" in (tmp_path / "a.vtu").read_text()


@pytest.mark.parametrize("text", ["turn=0.5", "turn = 0.5 rad", "turn=500mrad"])
def test_drive_values_with_units(scene, capsys, text):
    assert main(["solve", scene(), "--set", text, "--method", "conventional", "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["drives"]["turn"]["value_deg"] == pytest.approx(
        28.6479, rel=1e-5
    )


def test_options_in_the_file_and_over_it(scene, capsys):
    path = scene('value = "10 deg"\n[options]\nmethod = "conventional"\nelements = 3\n')
    assert main(["solve", path, "--json", "-"]) == 0
    assert json.loads(capsys.readouterr().out)["leaf_model"].startswith("3 Appendix A")
    assert main(["solve", path, "--json", "-", "--elements", "6"]) == 0
    assert json.loads(capsys.readouterr().out)["leaf_model"].startswith("6 Appendix A")


@pytest.mark.parametrize(
    "argv,words",
    [
        (["--set", "top=1kg"], ["length is expected"]),
        (["--set", "tpo=1mm"], ["no drive 'tpo'", "top"]),
        (["--set", "top"], ["DRIVE=VALUE"]),
        (["--set", "top=nan"], ["top", "nan", "finite"]),
        (["--method", "magic"], ["'magic'", "reduced"]),
        (["--method", "full", "--accuracy", "1e-3"], ["exclude each other"]),
        (["--relinearisations", "2"], ["relinearisations = 2", "--method reduced"]),
        (["--relinearisations", "-1", "--method", "reduced"], ["relinearisations = -1"]),
        (["--accuracy", "7"], ["accuracy = 7"]),
        (["--elements", "0"], ["elements = 0"]),
        (["--plot", "picture.xyz"], ["xyz", ".png"]),
        (["--plot", "no/such/folder.png"], ["does not exist"]),
        (["--plot", "no/such/folder.vtu"], ["does not exist"]),
        (["--json", "no/such/folder.json"], ["does not exist"]),
        (["--set", "top=325mm", "--method", "reduced"], ["trained range", "extrapolate"]),
    ],
    ids=lambda v: " ".join(v) if v and str(v[0]).startswith("--") else "",
)
def test_bad_input_exits_2(record, capsys, argv, words):
    refused(capsys, ["solve", FOURBAR, *argv], 2, *words)


@pytest.mark.parametrize(
    "options,words",
    [
        ("method = 3", ["[options] method = 3", "text"]),
        ("elements = 2.5", ["elements = 2.5", "whole number"]),
        ("elements = true", ["elements = True", "whole number"]),
        ("extrapolate = 1", ["extrapolate = 1", "true or false"]),
        ("metod = 'full'", ["metod", "method"]),
    ],
)
def test_bad_options_in_the_file_exit_2(scene, capsys, options, words):
    refused(capsys, ["solve", scene(f"[options]\n{options}\n")], 2, *words)


@pytest.mark.parametrize("command", ["compare", "effects", "report", "sweep"])
def test_every_command_checks_the_options_of_a_file(scene, capsys, command):
    path = scene("[options]\neffects = 5\n")
    refused(capsys, [command, path, "--set", "turn=5deg"], 2, "effects = 5", "text is needed")


def test_missing_things_exit_2(scene, capsys, tmp_path):
    refused(capsys, ["solve", str(tmp_path / "none.toml")], 2, "none.toml", "does not exist")
    refused(capsys, ["solve", str(tmp_path)], 2, "cannot be read")
    (tmp_path / "bad.toml").write_text("links = [")
    refused(capsys, ["solve", str(tmp_path / "bad.toml")], 2, "not valid TOML")
    refused(capsys, ["solve", scene()], 2, "'turn' has no value")
    refused(capsys, ["train", "cros_flexure"], 2, "cross_flexure")


def test_a_pose_out_of_reach_exits_3(record, capsys):
    refused(capsys, ["solve", FOURBAR, "--method", "kinematic", "--set", "top=700mm"], 3, "% of the way")


def test_a_missing_record_exits_4(no_record, capsys, tmp_path):
    refused(capsys, ["solve", CROSS, "--method", "reduced"], 4, "ksd train cross_flexure")
    refused(capsys, ["info"], 4, "ksd train cross_flexure")
    refused(capsys, ["demo", "--plot", str(tmp_path / "a.png")], 4, "ksd train cross_flexure")
    assert not (tmp_path / "a.png").exists()


def test_a_damaged_record_exits_4(capsys, monkeypatch, tmp_path):
    (tmp_path / "cross_flexure.h5").write_bytes(b"ksd joint record\nformat 1\nsha256 0\n".ljust(600, b"\0"))
    monkeypatch.setenv("KSD_DATABASE", str(tmp_path))
    refused(capsys, ["solve", CROSS, "--method", "reduced"], 4, "damaged")
    out = refused(capsys, ["info"], 4, "cannot be used")
    assert "problem" in out and "damaged" in out


def test_info_of_every_family(capsys):
    """Source, symmetry, closed form, ranges, evidence and errors on fresh shapes are printed for all that ships."""
    from ksd.library import describe_database
    from ksd.scene import joint_families
    from ksd.training.catalogue import FAMILY_DESIGNS

    shipped = {entry.family for entry in describe_database()}
    assert shipped >= set(FAMILY_DESIGNS)
    for family in joint_families():
        assert main(["info", family]) == 0
        out = " ".join(capsys.readouterr().out.split())
        rows = ["source", "symmetry", "closed form"]
        if family in FAMILY_DESIGNS:
            rows += [
                "motion",
                "others to check the fit",
                "thickness twice",
                "fresh shapes rms",
                "trained at",
            ]
            rows += [f"shape {p.name}" for p in FAMILY_DESIGNS[family].parameters]
            rows += [] if family in ("infinity_hinge", "triple_infinity_hinge") else ["Here"]
        rows += [] if family in FAMILY_DESIGNS else ["typical ranges"]
        assert all(row in out for row in rows), (family, [row for row in rows if row not in out])
        assert ("flexible constraint" in out) == (family not in FAMILY_DESIGNS)


def test_info_of_an_unknown_family(capsys):
    refused(capsys, ["info", "cros_flexure"], 2, "did you mean")


def test_info_lists_the_record(record, capsys):
    assert main(["info"]) == 0
    out = capsys.readouterr().out
    speed = ("about 8 such joints or more in space (3 leaf springs each)", "one joint, joints in a plane;")
    for word in ("cross_flexure", "-75 to 75 deg", "width_ratio", "sha256", "days ago", "strain", *speed):
        assert word in out


def test_demo(record, capsys, tmp_path):
    assert main(["demo", "--plot", str(tmp_path / "demo.png"), "--json", str(tmp_path / "demo.json")]) == 0
    out = capsys.readouterr().out
    numbers = json.loads((tmp_path / "demo.json").read_text())
    rows = {(r["method"], r["leaf_model"]): r for r in numbers["rows"]}
    for method in ("kinematic", "reduced", "relinearised once", "full", "conventional"):
        assert method in out and (method, "strain-mode") in rows
    assert rows["full", "strain-mode"]["error_percent"] < 1e-3
    assert rows["reduced", "strain-mode"]["error_percent"] < 1.3
    assert rows["relinearised once", "strain-mode"]["error_percent"] < 0.5
    assert rows["full", "5 elements"]["force_N"] == pytest.approx(519.484, rel=1e-5)
    assert (
        rows["conventional, Newton", "5 elements"]["iterations"]
        > rows["conventional", "5 elements"]["iterations"]
    )
    assert all(r["time_us"] > 0 for r in rows.values())
    assert (tmp_path / "demo.png").stat().st_size > 30000


def test_train_reports_errors(monkeypatch, capsys):
    seen = {}

    def stand_in(family, **options):
        seen.update(options, family=family)
        from ksd.library import find_record

        return find_record(family)

    monkeypatch.setenv("KSD_DATABASE", str(ROOT / "database"))
    monkeypatch.setattr(import_module("ksd.cli.train"), "train", stand_in)
    assert main(["train", "cross_flexure", "--out", "here", "--restart", "--quiet"]) == 0
    assert seen == {"family": "cross_flexure", "out": "here", "resume": False, "progress": False}
    assert "largest error" in capsys.readouterr().out


def test_checking_a_record_against_a_fresh_one(monkeypatch, capsys):
    """What differs by more than rounding is an error."""
    from ksd.library import find_record, write_record

    monkeypatch.setenv("KSD_DATABASE", str(ROOT / "database"))
    kept = find_record("cartwheel")
    strain = kept.functions["strain"]
    made = {"record": kept}

    def stand_in(family, *, out, **_):
        if made["record"] is kept:
            shutil.copy(ROOT / "database" / f"{family}.h5", out)
        else:
            write_record(made["record"], out / f"{family}.h5")
        return made["record"]

    monkeypatch.setattr(import_module("ksd.cli.train"), "train", stand_in)
    assert main(["train", "cartwheel", "--check", "--quiet"]) == 0
    assert "cartwheel: the record is, byte for byte, what the sources give" in capsys.readouterr().out
    rounded = replace(strain, wrench=strain.wrench + 1e-10)
    made["record"] = replace(kept, functions={**kept.functions, "strain": rounded})
    assert main(["train", "cartwheel", "--check", "--quiet"]) == 0
    assert "what the sources give, coefficients within 1e-10" in capsys.readouterr().out
    moved = replace(strain, interface=strain.interface + 1e-7)
    made["record"] = replace(kept, functions={**kept.functions, "strain": moved})
    refused(capsys, ["train", "cartwheel", "--check"], 4, "differ by up to 1e-07; run `ksd train cartwheel`")
    made["record"] = replace(kept, orders=(4, 3, 6))
    refused(capsys, ["train", "cartwheel", "--check"], 4, "orders differ")
    # all are checked before the first that differs is refused
    refused(capsys, ["train", "all", "--check"], 4, "13 of 13 records", "arc_hinge, ", ", universal")


def test_training_what_is_up_to_date_says_so(monkeypatch, tmp_path, capsys):
    """A record that agrees with the solver is left alone, and trained all the same on request."""
    from ksd.library import find_record

    asked = []
    monkeypatch.setattr(
        import_module("ksd.cli.train"),
        "train",
        lambda family, **_: asked.append(family) or find_record(family),
    )
    shutil.copy(ROOT / "database" / "cartwheel.h5", tmp_path)
    before = (tmp_path / "cartwheel.h5").read_bytes()
    assert main(["train", "cartwheel", "--out", str(tmp_path), "--quiet"]) == 0
    out = capsys.readouterr().out
    assert "cartwheel: up to date; 4 probe states" in out and not asked
    assert (tmp_path / "cartwheel.h5").read_bytes() == before
    assert main(["train", "cartwheel", "--out", str(tmp_path), "--restart", "--quiet"]) == 0
    assert asked == ["cartwheel"]


def test_checking_the_probes_of_a_record(monkeypatch, tmp_path, capsys):
    from ksd.library import find_record, write_record

    assert main(["info", "cartwheel", "--check"]) == 0
    assert "solved again, within" in " ".join(capsys.readouterr().out.split())
    record = find_record("cartwheel")
    monkeypatch.setenv("KSD_DATABASE", str(tmp_path))
    write_record(replace(record, family="mine"), tmp_path / "mine.h5")
    assert main(["info", "mine", "--check"]) == 0
    assert "not solved again" in " ".join(capsys.readouterr().out.split())
    write_record(replace(record, design={"length": 0.1}), tmp_path / "cartwheel.h5")
    assert main(["info", "cartwheel", "--check"]) == 0
    assert "not solved again" in " ".join(capsys.readouterr().out.split())
    moved = replace(record.probes, values=record.probes.values + 1e-8)
    write_record(replace(record, probes=moved), tmp_path / "cartwheel.h5")
    refused(capsys, ["info", "cartwheel", "--check"], 4, "does not agree", "ksd train cartwheel")
    refused(capsys, ["info", "--check"], 2, "needs the name of a family")


def test_training_all_families(monkeypatch, capsys):
    from ksd.library import find_record

    asked = []
    monkeypatch.setattr(
        import_module("ksd.cli.train"),
        "train",
        lambda family, **_: asked.append(family) or find_record(family),
    )
    assert main(["train", "all", "--restart", "--quiet"]) == 0
    assert asked == sorted(set(asked), key=asked.index) and len(asked) == len(
        list((ROOT / "database").glob("*.h5"))
    )
    assert f"{len(asked)} families in " in capsys.readouterr().out


def test_interruption_exits_130(monkeypatch, capsys):
    def interrupted(*arguments, **options):
        raise KeyboardInterrupt

    monkeypatch.setattr(import_module("ksd.cli.train"), "train", interrupted)
    refused(capsys, ["train", "cross_flexure", "--restart"], 130, "run the same command again")
    monkeypatch.setattr("ksd.cli.solve.load_scene", interrupted)
    refused(capsys, ["solve", FOURBAR], 130, "interrupted")


@pytest.mark.parametrize(
    "argv", [["fly"], ["solve"], ["solve", "a.toml", "--elements", "many"], ["demo", "--nope"]]
)
def test_wrong_arguments_exit_2(argv, capsys):
    with pytest.raises(SystemExit) as stop:
        main(argv)
    assert stop.value.code == 2
    assert "usage" in capsys.readouterr().err


@pytest.mark.parametrize("argv", [["report", "a.toml", "b.html"], ["report", "a.toml", "-o", "b.html"]])
def test_unknown_arguments_show_the_usage_of_their_command(argv, capsys):
    with pytest.raises(SystemExit) as stop:
        main(argv)
    told = capsys.readouterr().err
    assert stop.value.code == 2
    assert "usage: ksd report" in told and "b.html" in told and "--out FILE" in told


def test_version(capsys):
    with pytest.raises(SystemExit) as stop:
        main(["--version"])
    assert stop.value.code == 0 and ksd.__version__ in capsys.readouterr().out


def run(*arguments, **options):
    words = environment(KSD_DATABASE=str(ROOT / "database"))
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    return subprocess.Popen([sys.executable, "-m", "ksd", *arguments], env=words, **pipes, **options)


def test_as_a_program(record, tmp_path):
    process = run("info", cwd=tmp_path)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0 and "cross_flexure" in out and err == ""


def test_a_reader_that_leaves_early_is_no_error(record, tmp_path):
    process = run("info", cwd=tmp_path)
    process.stdout.close()
    err = process.stderr.read()
    process.stderr.close()
    assert process.wait(timeout=60) in (0, 141) and err == ""


def test_sweep_writes_the_table_and_the_picture(scene, capsys, tmp_path):
    out, picture = tmp_path / "stroke.csv", tmp_path / "stroke.png"
    argv = ["sweep", scene(), "--set", "turn=0deg:20deg:3", "--question", "force", "--quiet"]
    assert main([*argv, "--out", str(out), "--plot", str(picture)]) == 0
    assert "3 rows" in capsys.readouterr().out
    lines = out.read_text().splitlines()
    assert len(lines) == 4 and lines[0].split(",")[-1] == "status"
    assert all(line.endswith(",ok") for line in lines[1:])
    assert picture.stat().st_size > 5000


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["--set", "turn=0deg:20deg:1"], ("POSES = 1", "between 2 and 100000")),
        (["--set", "turn=0deg:20deg:3:4"], ("DRIVE=FROM:TO:POSES",)),
        (["--set", "turn=0deg:20mm:3"], ("mm",)),
        (["--set", "trun=0deg:20deg"], ("no drive 'trun'", "turn")),
        (["--set", "turn=0deg:20deg", "--out", "a.xls"], (".csv", ".h5", ".mat")),
        (["--set", "turn=0deg:20deg", "--question", "strss"], ("strss", "stress")),
    ],
)
def test_sweep_refuses(scene, capsys, argv, words):
    refused(capsys, ["sweep", scene(), *argv, "--quiet"], 2, *words)


def test_sweep_with_a_failing_pose_exits_3_and_keeps_the_others(record, capsys, tmp_path):
    out = tmp_path / "stroke.csv"
    argv = ["sweep", FOURBAR, "--set", "top=300mm:360mm:2", "--method", "reduced", "--question", "force"]
    refused(capsys, [*argv, "--out", str(out), "--quiet"], 3, "1 of 2 poses")
    assert out.read_text().count(",ok") == 1


def test_the_point_that_is_asked_about(capsys, scene, tmp_path):
    """[report] of the file, then the options; a place said for one link is not that of another."""
    path = scene('\n[report]\nlink = "tip"\nat = [0, 0, 0]\n')
    out = tmp_path / "a.csv"

    def stiffness(*words):
        argv = [
            "sweep",
            path,
            "--set",
            "turn=0deg",
            "--question",
            "support_stiffness",
            "--quiet",
            "--out",
            str(out),
        ]
        assert main([*argv, *words]) == 0
        (row,) = csv.DictReader(out.open())
        return float(row["support_y_N_per_m"])

    there, _, _ = ksd.load_scene(path)
    pose = ksd.solve(there, turn=0.0)
    for words, at in (
        ((), (0, 0, 0)),
        (("--at", "100mm,0,0"), (0.1, 0, 0)),
        (("--link", "tip"), None),
        (("--link", "tip", "--at", "50 mm, 0, 0"), (0.05, 0, 0)),
    ):
        assert stiffness(*words) == pytest.approx(pose.stiffness("tip", at=at).support("y"), rel=1e-9)
    capsys.readouterr()
    refused(capsys, ["sweep", path, "--at", "0,1mm"], 2, "--at 0,1mm: write three numbers")
    refused(capsys, ["sweep", path, "--at", "0,1deg,0"], 2, "--at", "a length is expected")
    refused(capsys, ["sweep", path, "--along", "1,x,0"], 2, "--along")
    refused(capsys, ["report", path, "--freed", "tun", "--set", "turn=1deg"], 2, "tun")
    refused(capsys, ["report", path, "--set", "turn=0"], 2, "every drive is at 0")


NAME = "[bold red]x[/nope] :smile: $x_{$"


@pytest.mark.parametrize(
    "words",
    [
        ["solve"],
        ["effects"],
        ["doctor"],
        ["sweep", "--set", "turn=0deg:20deg:3", "--question", "force"],
        ["report", "--poses", "3"],
    ],
    ids=lambda words: words[0],
)
def test_names_are_no_markup(words, capsys, tmp_path, monkeypatch):
    """Brackets, colons and dollars in the name of a mechanism, a drive, a folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "[b][").mkdir()
    path = tmp_path / "[b][/i].toml"
    # without --set, so that the file gives the value
    drive = NAME if "--set" not in words else "turn"
    text = LEAF.replace('name = "leaf"', f'name = "{NAME}"').replace('"turn"', f'"{drive}"\nvalue = "20 deg"')
    path.write_text(text)
    picture = [] if words[0] in ("doctor", "report") else ["--plot", "[b][/y].png"]
    assert main([words[0], str(path), *words[1:], *picture]) == 0
    out, err = capsys.readouterr()
    assert "[/i]" in out if words[0] == "report" else NAME in " ".join(out.split()), (out, err)


@needs_full
@pytest.mark.parametrize("option", ["--json", "--plot"])
def test_a_device_is_no_file(scene, capsys, option):
    before = os.stat("/dev/full")
    target = "/dev/full"
    if option == "--plot":
        # a picture needs an ending
        target = os.path.join(os.path.dirname(scene()), "full.png")
        os.symlink("/dev/full", target)
    refused(capsys, ["solve", scene(), "--set", "turn=5deg", option, target], 2, "a device")
    after = os.stat("/dev/full")
    assert (before.st_ino, before.st_rdev) == (after.st_ino, after.st_rdev)


@needs_full
@pytest.mark.parametrize(
    "words",
    [
        ["solve", "--set", "turn=5deg", "--json", "a.json"],
        ["solve", "--set", "turn=5deg", "--plot", "a.png"],
        ["solve", "--set", "turn=5deg", "--plot", "a.vtu"],
        ["sweep", "--set", "turn=0deg:5deg:41", "--question", "force", "--quiet", "--out", "a.csv"],
        ["sweep", "--set", "turn=0deg:5deg:41", "--question", "force", "--quiet", "--plot", "a.pdf"],
        ["report", "--set", "turn=5deg", "--poses", "3", "--quiet", "--out", "a.html"],
    ],
    ids=lambda words: words[-1],
)
def test_a_full_disk_leaves_the_old_file_and_exits_2(scene, words, tmp_path, monkeypatch, capsys):
    """A limit on the size of files does what a full disk does."""
    resource = pytest.importorskip("resource")
    path, kept = scene(), tmp_path / "kept"
    (tmp_path / words[-1]).write_text("old")
    # compiled kernels and fonts are files, too: kept before the disk is full
    kept.mkdir()
    monkeypatch.chdir(kept)
    assert main([words[0], path, *words[1:]]) == 0 and (kept / words[-1]).stat().st_size > 500
    capsys.readouterr()
    monkeypatch.chdir(tmp_path)
    before = {p.name for p in tmp_path.iterdir()}
    ignored = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (500, hard))
    try:
        refused(capsys, [words[0], path, *words[1:]], 2, "cannot be written")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, ignored)
    assert (tmp_path / words[-1]).read_text() == "old"
    assert {p.name for p in tmp_path.iterdir()} == before


@needs_full
@pytest.mark.parametrize("shell", ["{0} >&-", "{0} >/dev/full", "{0} >&- 2>&-", "{0} 2>&-"])
def test_streams_that_are_closed_or_full(shell, tmp_path):
    command = shell.format(f"{sys.executable} -m ksd info")
    done = subprocess.run(
        ["sh", "-c", command], env=environment(), capture_output=True, text=True, cwd=tmp_path
    )
    assert done.returncode == (0 if shell == "{0} 2>&-" else 2), done
    if "2>&-" not in shell:
        assert done.stderr.startswith("ksd: ") and done.stderr.count("\n") == 1, done.stderr
    assert "Traceback" not in done.stdout + done.stderr


@pytest.mark.parametrize("resume", [[], ["--resume", "kept.jsonl"]])
def test_interrupting_a_sweep_says_how_to_go_on(scene, capsys, monkeypatch, tmp_path, resume):
    monkeypatch.chdir(tmp_path)

    import_module("ksd.study.sweep")

    def stop(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(sys.modules["ksd.study.sweep"], "run_path", stop)
    argv = ["sweep", scene(), "--set", "turn=0deg:5deg:3", "--out", "a.csv", "--quiet", *resume]
    said = ("kept.jsonl", "same command") if resume else ("--resume",)
    assert main(argv) == 130
    err = capsys.readouterr().err
    assert "exception" not in err and ".table" not in err and all(word in err for word in said), err
    assert "no table was written" in err and not Path("a.csv").exists()
    assert main(["report", scene(), "--set", "turn=5deg", "--quiet"]) == 130
    assert "no report was written" in capsys.readouterr().err and not Path("leaf.html").exists()


def test_training_elsewhere_says_where_it_is_looked_for(monkeypatch, capsys, tmp_path):
    from ksd.library import find_record

    kept = find_record("cross_flexure")
    monkeypatch.delenv("KSD_DATABASE", raising=False)
    monkeypatch.setattr(import_module("ksd.cli.train"), "train", lambda family, **_: kept)
    argv = ["train", "cross_flexure", "--quiet", "--restart"]
    assert main([*argv, "--out", str(tmp_path)]) == 0
    assert f"KSD_DATABASE={tmp_path}" in "".join(capsys.readouterr().out.split("\n"))
    shutil.copy(ROOT / "database" / "cross_flexure.h5", tmp_path)
    monkeypatch.setenv("KSD_DATABASE", str(tmp_path))
    assert main([*argv, "--out", str(tmp_path)]) == 0
    assert "KSD_DATABASE" not in capsys.readouterr().out


def test_without_a_command_the_commands_are_listed(capsys):
    assert main([]) == 2
    said = capsys.readouterr().err
    assert "optimise  find the best design of a job" in said and said.endswith("ksd: give a command.\n")


@pytest.mark.parametrize("keys", [1, 7])
def test_table_of_effects_never_cuts_a_number_off(capsys, keys):
    """Three drives once cut "172-298" to "172-29…" and dropped the column of unknowns."""
    from types import SimpleNamespace

    from ksd.cli.effects import _print
    from ksd.study.effect_cost import EffectCost

    off = {f"support stiffness {i}": 1.0 for i in range(keys)}
    on = dict.fromkeys(off, 0.98765)
    row = EffectCost("plate", False, on, off, (298e-6, 172e-6), (1234, 567))
    scene = SimpleNamespace(name="stage", leaf_names=dict)
    _print(scene, SimpleNamespace(effects=()), [row])
    said = capsys.readouterr().out
    assert "172\N{EN DASH}298" in said and "567\N{EN DASH}1234" in said
    assert "\N{HORIZONTAL ELLIPSIS}" not in said and said.count("-1.2 %") == keys and "without" in said


def test_help_begins_with_two_commands_and_names_every_exit_code_and_method(capsys):
    from ksd.solvers.solver import METHODS

    with pytest.raises(SystemExit):
        main(["--help"])
    said = " ".join(capsys.readouterr().out.split())
    assert "ksd solve mine.toml" in said and "130 interrupted" in said
    with pytest.raises(SystemExit):
        main(["solve", "--help"])
    said = " ".join(capsys.readouterr().out.split())
    assert all(method in said for method in METHODS)


SHAKEN = """
links = ["stage"]
plane = "xy"
[material.steel]
E = "200 GPa"
nu = 0.3
density = 7800
loss_factor = 0.004
[[leaf]]
a = "ground"
b = "stage"
start = [0, 0, 0]
end = [0, "60 mm", 0]
thickness = "0.3 mm"
width = "20 mm"
material = "steel"
[[actuate]]
link = "stage"
along = "x"
at = [0, "60 mm", 0]
name = "push"
value = 0
[[mass]]
link = "stage"
mass = 1.0
inertia = [1e-3, 1e-3, 1e-3]
at = [0, "60 mm", 0]
[[sensor]]
link = "stage"
along = "x"
at = [0, "60 mm", 0]
name = "tip"
[[damper]]
a = "ground"
b = "stage"
about = "z"
damping = "2e-3 Nm s/rad"
"""


def test_respond_prints_writes_and_draws(tmp_path, capsys):
    import ksd

    scene = tmp_path / "shaken.toml"
    scene.write_text(SHAKEN)
    files = {
        word: tmp_path / name
        for word, name in (("--out", "a.csv"), ("--json", "a.json"), ("--plot", "a.svg"))
    }
    words = [text for word, file in files.items() for text in (word, str(file))]
    argv = ["respond", str(scene), "--base", "x", "--freed", "push", "--frequencies", "1Hz:0.1kHz:20"]
    assert main([*argv, *words]) == 0
    assert "tip" in capsys.readouterr().out and all(file.stat().st_size for file in files.values())
    numbers = ksd.read_result(files["--json"])
    (found,) = numbers["responses"]
    pose = ksd.solve(ksd.load_scene(scene)[0], push=0.0)
    response = pose.response(np.geomspace(1, 100, 20), inputs="base x", outputs="tip", freed=["push"])
    assert found["gain"] == pytest.approx(response.gain[:, 0, 0].tolist(), rel=1e-12)
    assert main(["respond", str(scene), "--psd", "base x=1Hz:1e-3,.05 kHz:1e-3", "--freed", "push"]) == 0
    assert "Random vibration, 1.000 to 50.00 Hz" in capsys.readouterr().out


def test_vibration_over_a_stroke(tmp_path):
    """Rms and settling time as columns, with Rayleigh damping as the response has it."""
    import ksd

    scene = tmp_path / "shaken.toml"
    scene.write_text(SHAKEN)
    argv = ["sweep", str(scene), "--set", "push=0mm:1mm:2", "--quiet", "--out", str(tmp_path / "a.csv")]
    words = ["--psd", "base x=1:1e-3,50:1e-3", "--damping", "1:0.01,50:0.03"]
    assert main([*argv, "--question", "vibration", *words]) == 0
    lines = (line for line in (tmp_path / "a.csv").read_text().splitlines() if not line.startswith("#"))
    table = list(csv.DictReader(lines))
    pose = ksd.solve(ksd.load_scene(scene)[0], push=1e-3)
    spectrum = {"base x": [(1, 1e-3), (50, 1e-3)]}
    found = pose.random_vibration(spectrum, freed=["push"], damping=[(1, 0.01), (50, 0.03)])
    assert float(table[1]["rms_tip_um"]) == pytest.approx(1e6 * found.rms[0], rel=1e-6)
    assert float(table[1]["settling_s"]) > 0.0
    assert main(["respond", str(scene), *words, "--freed", "push", "--json", str(tmp_path / "a.json")]) == 0
    assert ksd.read_result(tmp_path / "a.json")["outputs"][0]["rms"] > 0.0
    assert main([*argv, "--psd", "base q=1:1,2:1"]) == 2 == main([*argv, "--damping", "1"])


@pytest.mark.parametrize(
    "words, sentence",
    [
        (["--damping", "5:0.01"], "Rayleigh damping needs two pairs"),
        (["--damping", "0.01,much"], "damping"),
        (["--frequencies", "1Hz"], "write FROM:TO or FROM:TO:POINTS"),
        (["--frequencies", "2Hz:1Hz"], "from above 0 up"),
        (["--frequencies", "1Hz:2mm"], "a frequency is expected"),
        (["--psd", "base x"], "write INPUT=HZ:DENSITY"),
        (["--psd", "base x=1:1e-3"], "one point is no spectrum"),
        (["--psd", "base x=1Hz:a,2:1"], "density in the unit"),
        (["--psd", "base x=1kg:1,2:1"], "1kg"),
        (["--psd", "base x=1:1,2:1", "--plot", "a.png"], "leave --psd out"),
        (["--base", "q"], "a base moves along or about an axis"),
        (["--out", "a.txt"], "the ending must be .csv"),
        (["--output", "tipp"], 'did you mean "tip"'),
    ],
)
def test_respond_refuses(tmp_path, capsys, words, sentence):
    scene = tmp_path / "shaken.toml"
    scene.write_text(SHAKEN)
    refused(capsys, ["respond", str(scene), *words], 2, sentence)


def test_damping_of_a_torsional_dashpot_is_not_that_of_a_translation(tmp_path, capsys):
    scene = tmp_path / "shaken.toml"
    scene.write_text(SHAKEN.replace("Nm s/rad", "N s/m"))
    refused(capsys, ["solve", str(scene)], 2, "a torsional damping is expected")


def test_stops_and_cables_are_printed_written_and_set(tmp_path, capsys):
    scene = ksd.Mechanism("strip", plane="xy")
    steel = ksd.Material(E=200e9, nu=0.3)
    section, tip = ksd.rectangle(1e-3, 0.01), (0.1, 0, 0)
    scene.leaf("ground", scene.link("tip"), start=(0, 0, 0), end=tip, section=section, material=steel)
    scene.load("tip", force=(0, 1.0, 0), at=tip)
    scene.stop("tip", along="y", at=tip, high=3e-4, name="end")
    scene.cable("ground", "tip", start=(0.1, -0.05, 0), end=tip, length=0.051, name="tie")
    file, out = tmp_path / "strip.toml", tmp_path / "pose.json"
    ksd.save_scene(scene, file)
    assert main(["solve", str(file), "--json", str(out)]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"end\.high +0\.8500 +0 ", printed) and re.search(r"tie +0 +0\.7000 ", printed)
    found = json.loads(out.read_text())
    assert found["stops"]["end.high"]["effort"] == pytest.approx(0.85, rel=1e-3)
    assert found["cables"]["tie"] == pytest.approx(
        {"tension_N": 0, "slack_mm": 0.7, "length_mm": 51}, abs=1e-6
    )
    assert main(["solve", str(file), "--set", "tie=2mm", "--set", "end.high=2mm"]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"end\.high +0 ", printed) and re.search(r"tie +1\.500 ", printed)
    assert main(["solve", str(file), "--set", "tye=2mm"]) == 2
    assert "there is no drive 'tye'; did you mean \"tie\"?" in capsys.readouterr().err
