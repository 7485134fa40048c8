"""A session without a page: it follows the newest wish, keeps the last good pose, and no mistake ends it."""

import sys
import threading
import time
import tomllib
from pathlib import Path

import pytest

import ksd
from ksd.cli import main
from ksd.errors import SceneError
from ksd.interactive import numbers
from ksd.interactive.drawing import Drawing
from ksd.interactive.numbers import BETWEEN_PICTURES, FOLLOWING, PARTS, parts_in_time
from ksd.interactive.session import Session
from ksd.interactive.sliders import Slider, design_sliders, rounded_end, scene_sliders, with_loads
from ksd.scene.toml_file import shipped_scenes
from ksd.units import N, deg, mm

pytest.importorskip("tomlkit", reason="the extra `live` is not installed")
GUIDE = shipped_scenes()["guide"].read_text()


def guide(length=60 * mm, *, force=0.0):
    m = ksd.Mechanism("guide", plane="xy")
    table = m.link("table")
    steel = ksd.Material(E=200e9, nu=0.3, density=7800.0, yield_stress=900e6)
    for name, x in (("left", -30 * mm), ("right", 30 * mm)):
        blade = ksd.section.rectangle(0.3 * mm, 20 * mm)
        m.leaf(
            "ground",
            table,
            start=(x, 0, 0),
            end=(x, length, 0),
            width_axis="z",
            section=blade,
            material=steel,
            name=name,
        )
    m.actuate(table, along="x", at=(0, 30 * mm, 0), name="table")
    if force:
        m.load(table, force=(0, force, 0), at=(0, length, 0), name="push")
    return m


@pytest.fixture
def started():
    sessions = []

    def start(*args, **words):
        sessions.append(Session(*args, **words))
        sessions[-1].refresh()
        sessions[-1].settle()
        return sessions[-1]

    yield start
    for session in sessions:
        session.close()


def until(condition, seconds=60.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "it did not happen"
        time.sleep(0.01)


def numbers_of(update):
    return {what: text for rows in update.rows.values() for what, text, _ in rows}


def test_the_newest_wish_wins_and_its_numbers_are_those_of_solve(started):
    session, told = started(guide(force=2 * N), {"table": 5 * mm}), []
    session.subscribe(told.append)
    for k in range(200):
        session.wish("table", k * 0.02 * mm)
    update = session.settle()
    assert update.values["table"] == 3.98 * mm
    until(lambda: told and told[-1].number == update.number)
    assert len({u.number for u in told}) < 200
    pose = ksd.solve(guide(force=2 * N), table=3.98 * mm)
    assert update.asked.pose.forces["table"] == pose.forces["table"]
    until(lambda: not session.latest.old and set(session.latest.rows) == set(PARTS))
    rows = numbers_of(session.latest)
    assert float(rows["force of table"].split()[0]) == pytest.approx(pose.forces["table"], rel=1e-5)
    assert float(rows["largest stress"].split()[0]) == pytest.approx(pose.strength.stress_Pa / 1e6, rel=1e-3)
    assert float(rows["share of yield stress"].split()[0]) == pytest.approx(
        100 * pose.strength.yield_share, rel=5e-3
    )
    assert f"{pose.frequencies(count=3).frequency_Hz[0]:.5g}" in rows["frequencies, drives held"]
    assert "Trusted" in str(session.latest.rows["trust"])


def test_loads_are_moved_and_all_else_stays(started):
    session = started(guide(force=2 * N), {"table": 5 * mm})
    session.wish("push", -3 * N)
    pushed = session.settle().asked.pose
    assert pushed.forces["table"] == ksd.solve(guide(force=-3 * N), table=5 * mm).forces["table"]
    model = pushed.model
    session.wish("table", 4 * mm)
    assert session.settle().asked.pose.model is model


def test_a_design_follows_its_parameters_and_says_why_it_cannot_be_built(started):
    def design(length=70 * mm):
        if length > 90 * mm:
            raise ValueError("no room for that")
        return guide(length)

    session = started(design, {"table": 2 * mm}, ranges={"length": ("50 mm", "100 mm")})
    assert session.latest.values == {"length": 70 * mm, "table": 2 * mm}
    session.wish("length", 80 * mm)
    good = session.settle().asked.pose
    assert good.forces["table"] == ksd.solve(guide(80 * mm), table=2 * mm).forces["table"]
    session.wish("length", 95 * mm)
    update = session.settle()
    assert "no room for that" in update.refused and update.asked.pose is good
    session.wish("length", 60 * mm)
    assert not session.settle().refused


def test_a_refused_state_keeps_the_last_good_pose_and_marks_what_can_be_reached(started):
    mechanism, targets, _ = ksd.load_scene(shipped_scenes()["gripper"])
    session = started(mechanism, targets)
    good = session.latest.asked.pose
    session.wish("crank", 200 * deg)
    update = session.settle()
    assert "200 deg" in update.refused and update.asked.pose is good and update.old == set(update.rows)
    until(lambda: 175 * deg < session.sliders["crank"].reached[1] < 185 * deg)
    session.wish("crank", 190 * deg)
    assert session.settle().refused and session.sliders["crank"].reached[1] < 185 * deg
    session.wish("crank", 10 * deg)
    assert not session.settle().refused


def test_what_nothing_holds_is_said_by_the_doctor(started):
    loose = ksd.Mechanism("loose", plane="xy")
    arm = loose.link("arm")
    loose.pin("ground", arm, at=(0, 0, 0))
    session = started(loose)
    until(lambda: "Free: " in session.latest.refused)


def test_mistakes_of_a_file_are_sentences_and_the_session_goes_on(started):
    session = started(guide())
    wrong = GUIDE.replace('link = "table"\nalong', 'link = "tabel"\nalong').replace('"0.3 mm"', '"0.3 mn"', 1)
    session.draw(tomllib.loads(wrong.replace('mass = "500 g"', 'mass = "-1 kg"')), Path("guide.toml"))
    refused = session.settle().refused
    assert "3 mistakes" in refused and all(w in refused for w in ("tabel", "0.3 mn", "mass"))
    session.draw(tomllib.loads(GUIDE), Path("guide.toml"))
    assert not session.settle().refused and session.values == {"table": 5 * mm}


def test_a_file_with_mistakes_opens_with_a_sentence_for_each(tmp_path, monkeypatch):
    served = []
    monkeypatch.setattr(
        "ksd.interactive.live.serve", lambda session, *_, **address: served.append((session, address))
    )
    file = tmp_path / "wrong.toml"
    wrong = GUIDE.replace('link = "table"\nalong', 'link = "tabel"\nalong').replace('"0.3 mm"', '"0.3 mn"', 1)
    file.write_text(wrong.replace('mass = "500 g"', 'mass = "-1 kg"'))
    assert main(["live", str(file), "--no-browser", "--port", "0"]) == 0
    file.write_text(GUIDE)
    assert main(["live", str(file), "--set", "table=2mm", "--method", "conventional"]) == 0
    assert main(["live", str(tmp_path / "new.toml")]) == 0
    (session, address), (good, _), (empty, _) = served
    assert "3 mistakes" in session.latest.refused and address["show"] is False and address["port"] == 0
    assert good.settle().asked.pose.targets == {"table": 2 * mm} and "no link" in empty.latest.refused
    for one in (session, good, empty):
        one.close()


def test_the_extra_is_asked_for(monkeypatch, capsys, tmp_path):
    monkeypatch.setitem(sys.modules, "nicegui", None)
    assert main(["live", str(tmp_path / "new.toml")]) == 2
    assert "pip install 'ksd[live]'" in capsys.readouterr().err
    with pytest.raises(SceneError, match="pip install"):
        ksd.live(guide())


def test_two_drives_of_one_name_and_no_drive_at_all(started):
    session = started(guide())
    twice = GUIDE + '\n[[actuate]]\nname = "table"\nlink = "table"\nalong = "y"\nat = [0, 0, 0]\n'
    session.draw(tomllib.loads(twice), Path("guide.toml"))
    assert "name 'table' is used already" in session.settle().refused
    head, _, rest = GUIDE.partition("[[actuate]]")
    free = (
        head
        + rest[rest.index("[[mass]]") :]
        + '\n[[load]]\nlink = "table"\nforce = [1, 0, 0]\nat = [0, 0, 0]\n'
    )
    session.draw(tomllib.loads(free), Path("guide.toml"))
    update = session.settle()
    assert not update.refused and list(session.sliders) == ["table.load"]


def test_a_part_that_fails_is_a_sentence_and_a_viewer_that_fails_ends_nothing(started, monkeypatch, caplog):
    session, told = started(guide()), []

    def fail(*_):
        raise ZeroDivisionError("by hand")

    monkeypatch.setitem(numbers.PARTS, "stiffness", fail)
    session.subscribe(fail)
    session.subscribe(told.append)
    session.wish("table", 1 * mm)
    session.settle()
    until(lambda: told and "stiffness" in told[-1].rows)
    assert session.latest.rows["stiffness"] == [("stiffness", "ZeroDivisionError: by hand", False)]
    assert "a viewer failed" in caplog.text


def test_questions_are_answered_at_the_present_pose(started):
    session = started(guide(), {"table": 3 * mm})
    assert session.question(lambda pose: pose.targets["table"]).result(20) == 3 * mm
    with pytest.raises(SceneError, match="by hand"):
        session.question(lambda pose: (_ for _ in ()).throw(ValueError("by hand"))).result(20)


def test_a_closed_session_leaves_no_thread():
    before = threading.active_count()
    session = Session(guide())
    session.refresh()
    session.close()
    assert threading.active_count() == before


def test_parts_follow_as_long_as_they_fit():
    assert parts_in_time({}, 0.0) == tuple(FOLLOWING)
    assert parts_in_time({"stress": 0.5 * BETWEEN_PICTURES, "stiffness": 0.6 * BETWEEN_PICTURES}, 0.0) == (
        "forces",
        "stress",
    )
    assert parts_in_time({}, 2 * BETWEEN_PICTURES) == ("forces",)


def test_loads_along_leaf_springs_have_sliders_and_are_written_in_their_unit(tmp_path):
    file = tmp_path / "guide.toml"
    file.write_text(
        GUIDE
        + '[[line_load]]\nleaf = "left"\nforce = ["20 N/m", 0, 0]\nto = ["0.01 N/mm", 0, 0]\n'
        + '[[pressure]]\nleaf = "right"\npressure = "-0.2 bar"\nname = "air"\n'
    )
    mechanism, targets, _ = ksd.load_scene(file)
    scene = mechanism.scene()
    line, air = scene_sliders(scene, targets)[-2:]
    assert (line.name, line.value, line.high, line.unit) == ("left.line_load", 20.0, 40.0, "N/m")
    assert (air.name, air.value, air.high) == ("air", pytest.approx(-2e4), pytest.approx(4e4))
    changed = with_loads(scene, {line.name: 10.0, air.name: 5e3})
    assert changed.line_loads[0].force == (10.0, 0.0, 0.0) and changed.line_loads[0].to == (5.0, 0.0, 0.0)
    assert changed.pressures[0].pressure == 5e3 and with_loads(scene, {air.name: air.value}) is scene
    drawing = Drawing(file)
    drawing.set_load(line.name, 10.0)
    drawing.set_load("air", 5e3)
    assert drawing.tables["line_load"][0]["force"] == ["10 N/m", 0, 0]
    assert drawing.tables["line_load"][0]["to"] == ["0.005 N/mm", 0, 0]
    assert drawing.tables["pressure"][0]["pressure"] == "0.05 bar"


def test_sliders_take_typed_values_and_say_what_is_wrong():
    drive = Slider("top", "drive", "length", -10 * mm, 10 * mm, 0.0)
    assert drive.read("3") == 3 * mm and drive.read("0.2 cm") == 2 * mm
    with pytest.raises(SceneError, match="top = 'fast'"):
        drive.read("fast")
    with pytest.raises(SceneError, match="a number is needed"):
        drive.moved(float("nan"))
    drive.moved(-12 * mm)
    assert drive.low == -15 * mm and rounded_end(0.0) == 1.0
    scene = guide(force=2 * N).scene()
    assert [(s.name, s.low, s.high) for s in scene_sliders(scene, {"table": 0.0})] == [
        ("table", -6 * mm, 6 * mm), ("push", -4.0, 4.0),
    ]  # fmt: skip
    assert scene_sliders(scene, {"table": -5 * mm})[0].low == -8 * mm
    assert with_loads(scene, {"push": 2 * N}) is scene
    mechanism, targets, _ = ksd.load_scene(shipped_scenes()["gripper"])
    crank = scene_sliders(mechanism.scene(), targets)[0]
    assert crank.high == mechanism.scene().joints[0].joint.motion().range[1] > 15 * deg
    for ranges, sentence in (
        ({"long": (1, 2)}, "no parameter 'long'"),
        ({"length": 3}, "lowest and highest"),
        ({"length": (2, 1)}, "below the second"),
    ):
        with pytest.raises(SceneError, match=sentence):
            design_sliders(guide, ranges)
    with pytest.raises(SceneError, match="ranges belong to a function"):
        Session(guide(), ranges={"length": (1, 2)})
