"""Parasitic motion in linkages of pins and sliders, and of joints that are driven."""

import csv

import numpy as np
import pytest
from scenes import STEEL

import ksd
from ksd.cli import main
from ksd.cli.solve import _three
from ksd.optimisation.job_file import load_job


def test_a_crank_does_not_carry_the_piston_behind_a_rod():
    scene = ksd.Mechanism("slider crank", plane="xy")
    crank, rod, piston = scene.links("crank", "rod", "piston")
    scene.pin(scene.ground, crank, at=(0, 0, 0))
    scene.pin(crank, rod, at=(0.02, 0, 0))
    words = {"section": ksd.rectangle(1e-3, 0.01), "material": ksd.Material(E=2e9, nu=0.35)}
    scene.leaf(rod, piston, start=(0.025, 0, 0), end=(0.1, 0, 0), **words)
    scene.slider(piston, along="x", at=(0.1, 0, 0))
    scene.actuate(crank, about="z", name="turn")
    pose = ksd.solve(scene, turn=np.deg2rad(60.0))
    moved = pose.displacement(piston, (0.1, 0, 0))
    assert moved[0] < -0.01
    # at rest, in the dead centre, the crank brings the piston no motion to first order
    found = pose.parasitic(piston, at=(0.1, 0, 0))
    assert np.allclose(found.shift, moved, atol=1e-12) and np.allclose(found.turn, 0.0, atol=1e-9)
    # the pin of the rod goes with the crank
    assert np.allclose(pose.parasitic(rod, at=(0.02, 0, 0)).shift, 0.0, atol=1e-9)


@pytest.mark.parametrize("ratio", [0.127322, 0.3, 0.5])
def test_a_driven_joint_prescribes_a_turn_about_its_crossing(ratio):
    """Its own shift is all that is parasitic there; elsewhere on the link that and the turn of the arm are told apart."""
    joint = ksd.CrossedPivot(STEEL, length=60e-3, angle=0.7, thickness=0.2e-3, width=15e-3, ratio=ratio)
    scene = ksd.Mechanism("pivot")
    arm = scene.link("arm")
    placed = scene.join(scene.ground, arm, joint, at=(-ratio * joint.length_AB, 0, 0), axis="z", toward="x")
    scene.actuate_joint(placed, name="turn")
    pose = ksd.solve(scene, turn=0.2)
    crossing, beyond = np.zeros(3), np.array((0.05, 0.01, 0))
    whole = pose.displacement(arm, crossing)
    assert pose.parasitic(arm, at=crossing).shift == pytest.approx(whole, abs=1e-12)
    assert pose.pivot_shift(placed).shift == pytest.approx(whole, abs=1e-12)
    assert pose.parasitic(arm, at=beyond).shift == pytest.approx(whole, abs=1e-9)


@pytest.mark.parametrize("absolute", [False, True], ids=["relative", "absolute"])
def test_a_drive_that_acts_past_the_carrier_prescribes_its_motion_too(absolute):
    """A stage on a stage: the upper one is driven from the lower one or from ground."""
    scene = ksd.Mechanism("stages")
    lower, upper = scene.links("lower", "upper")
    guide = ksd.ParallelGuide(STEEL, length=0.05, thickness=0.3e-3, width=0.02, spacing=0.04)
    scene.join(scene.ground, lower, guide, at=(0, 0, 0), axis="z", toward="x")
    scene.join(lower, upper, guide, at=(0.06, 0.1, 0), axis="z", toward="y")
    scene.actuate(lower, along="y", at=(0.05, 0, 0), name="first")
    at, base = (0.06, 0.15, 0), scene.ground if absolute else lower
    scene.actuate(upper, along="x", at=at, relative_to=base, name="second")
    pose = ksd.solve(scene, first=2e-3, second=1e-3, method="conventional")
    found = pose.parasitic(upper, at=at)
    assert set(found.drives) == {"first", "second"}
    # driven from ground, nothing is left along x; on the lower stage, the way that this stage is shortened by its arc
    shortened = 0.6 * 2e-3**2 / 0.05
    assert found.shift[0] == pytest.approx(0.0 if absolute else -shortened, rel=5e-2, abs=1e-9)


def xy_stage(length):
    """Four pairs of leaf springs: two carriages, driven along x and y, and a stage that each of them leaves free along the
    other axis."""
    scene = ksd.Mechanism("parallel XY stage")
    stage, by_x, by_y = scene.links("stage", "by x", "by y")
    words = {"section": ksd.rectangle(0.3e-3, 0.02), "material": STEEL, "width_axis": "z"}
    half = 0.02

    def pair(a, b, start, along):
        for side in (-half, half):
            across = np.array([side, 0, 0]) if along[1] else np.array([0, side, 0])
            begin = np.asarray(start) + across
            scene.leaf(a, b, start=begin, end=begin + length * np.asarray(along), **words)

    # carriage "by x" on leaf springs along y moves along x; the stage on it, on leaf springs along x, moves along y
    pair(scene.ground, by_x, (-0.1, -length, 0), (0, 1, 0))
    pair(by_x, stage, (-0.02 - length, 0, 0), (1, 0, 0))
    pair(scene.ground, by_y, (-length, -0.1, 0), (1, 0, 0))
    pair(by_y, stage, (0, -0.02 - length, 0), (0, 1, 0))
    scene.actuate(by_x, along="x", at=(-0.1, 0, 0), name="x")
    scene.actuate(by_y, along="y", at=(0, -0.1, 0), name="y")
    return scene


def test_drives_of_other_links_do_not_prescribe_what_a_stage_does_elsewhere():
    """Leaf springs moved by d shorten by .6 d^2/L: those between carriage y and the stage take it along y by that."""
    length, d = 48e-3, 3e-3
    pose = ksd.solve(xy_stage(length), x=d, y=0.0)
    rest, here = (0.0, 0.0, 0.0), pose.displacement("stage", (0, 0, 0))
    shortened = 0.6 * d**2 / length
    found = pose.parasitic("stage", at=rest)
    assert abs(here[1]) == pytest.approx(shortened, rel=0.05)
    assert found.shift[1] == pytest.approx(here[1], rel=0.02)
    # the way along x in proportion to the drive is that of a small stroke
    plus, minus = (ksd.solve(xy_stage(length), x=x, y=0.0) for x in (1e-6, -1e-6))
    slope = (plus.displacement("stage", rest) - minus.displacement("stage", rest)) / 2e-6
    assert found.shift == pytest.approx(here - d * slope, abs=1e-9)
    assert found.linear == found.drives == ("x", "y") and "in proportion, as at rest" in str(found)
    named = pose.parasitic("stage", at=rest, along="x")
    assert named.shift == pytest.approx([0, here[1], here[2]], abs=1e-12)
    assert named.turn == pytest.approx(pose.rotation("stage"), abs=1e-12)
    assert "in addition to the wanted displacement along (1 0 0)" in str(named)
    with pytest.raises(ksd.SceneError, match="along"):
        pose.parasitic("stage", along=(0, 0, 0))
    table = ksd.sweep(
        xy_stage(length), x=d, y=0.0, questions="parasitic", link="stage", at=rest, progress=False
    )
    assert table["parasitic_y_mm"][0] == pytest.approx(1e3 * found.shift[1], rel=1e-6)
    # on the carriage itself the drive prescribes its direction
    assert pose.parasitic("by x", at=(-0.1, 0, 0)).drives == ("x",)


def guide(thickness=0.3e-3):
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage")
    joint = ksd.ParallelGuide(STEEL, length=0.05, thickness=thickness, width=0.02, spacing=0.04)
    scene.join(scene.ground, stage, joint, at=(0, 0, 0), axis="z", toward="x")
    scene.actuate(stage, along="y", at=(0.05, 0, 0), name="drive")
    return scene


ASKED = [("x", "x"), ((1, 1, 0), "1,1,0")]
COLUMNS = tuple(f"parasitic_{a}_mm" for a in "xyz")


@pytest.mark.parametrize(("along", "text"), ASKED, ids=["word", "numbers"])
def test_the_wanted_direction_serves_sweeps_batches_gradients_and_jobs(along, text, tmp_path, capsys):
    """All of them tell the motion of a pose less its component along the direction, and the slope of that."""
    at, words = (0.05, 0, 0), {"questions": "parasitic", "drive": 3e-3}
    wanted = {"link": "stage", "at": at, "along": along}

    def expected(thickness=0.3e-3):
        moved = ksd.solve(guide(thickness), drive=3e-3, method="full").displacement("stage", at)
        axis = np.eye(3)[0] if along == "x" else np.array([1, 1, 0]) / np.sqrt(2)
        return 1e3 * (moved - axis * (axis @ moved))

    table = ksd.sweep(guide(), **words, **wanted, method="full", progress=False)
    assert [table[c][0] for c in COLUMNS] == pytest.approx(expected(), abs=1e-9)
    assert "in addition to the wanted displacement along" in str(table)
    found = ksd.batch(guide(), **words, **wanted, method="full")
    assert [found[c][0, 0] for c in COLUMNS] == pytest.approx(expected(), abs=1e-9)
    job = ksd.Job(guide, vary={"thickness": (2e-4, 4e-4)}, minimise=COLUMNS[:2], drive=3e-3, **wanted)
    assert job.values([0.3e-3])[:2] == pytest.approx(np.abs(expected()[:2]), rel=1e-4)
    slopes = ksd.gradient(guide, {"thickness": 0.3e-3}, **words, **wanted, method="full")
    assert slopes.values[COLUMNS[1]][0] == pytest.approx(job.values([0.3e-3])[1] * np.sign(expected()[1]))
    file = tmp_path / "guide.toml"
    ksd.save_scene(guide(), file, targets={"drive": 3e-3})
    out = tmp_path / "table.csv"
    command = ["sweep", str(file), "--question", "parasitic", "--link", "stage", "--along", text, "--quiet"]
    assert main([*command, "--method", "full", "--set", "drive=3mm", "--out", str(out)]) == 0
    assert "in addition to" in capsys.readouterr().out
    moved = ksd.solve(guide(), drive=3e-3, method="full").parasitic("stage", along=along)
    with open(out) as lines:
        row = next(csv.DictReader(line for line in lines if not line.startswith("#")))
    assert [float(row[c]) for c in COLUMNS] == pytest.approx(1e3 * moved.shift, abs=1e-9)
    listed = "'x'" if along == "x" else "[1, 1, 0]"
    (tmp_path / "job.toml").write_text(
        "[job]\nscene = 'guide.toml'\nlink = 'stage'\nat = ['50 mm', 0, 0]\nminimise = ['parasitic_x_mm']\n"
        f"along = {listed}\n[job.vary]\njoint.parallel_guide.thickness = ['0.2 mm', '0.4 mm']\n"
    )
    assert load_job(tmp_path / "job.toml").job.questions.along == job.questions.along


@pytest.mark.parametrize("call", [ksd.sweep, ksd.batch, ksd.gradient])
def test_a_direction_that_is_none_is_refused(call):
    with pytest.raises(ksd.SceneError, match="along"):
        call(guide(), drive=1e-3, questions="parasitic", along="up")


def test_a_direction_on_the_command_line_has_three_numbers():
    with pytest.raises(ksd.SceneError, match="--along 1,0: write three numbers, such as --along 1,1,0"):
        _three("1,0", "--along", "1,1,0", float)
