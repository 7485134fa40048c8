"""Drawing without a page: actions of the mouse become words of the scene, are undone as a whole, and keep the file."""

import copy
import difflib
import math
import tomllib

import numpy as np
import pytest

import ksd
from ksd.errors import SceneError
from ksd.interactive.drawing import LIBRARY, NEW_LINK, Drawing
from ksd.interactive.hand import TOOLS, Hand
from ksd.interactive.numbers import Asked
from ksd.interactive.plane_view import EMPTY_BOX, fitted_box, plane_svg
from ksd.interactive.scene_text import python_text, rewritten
from ksd.interactive.session import Session
from ksd.interactive.tools import drawing_tools
from ksd.scene.toml_file import scene_from_tables, shipped_scenes
from ksd.scene.toml_table import in_unit_of
from ksd.units import deg, mm

pytest.importorskip("tomlkit", reason="the extra `live` is not installed")
SCENES = {n: f.read_text() for n, f in shipped_scenes().items() if not n.endswith("_job")}


@pytest.fixture
def drawn(tmp_path):
    """A drawing from nothing with its session and a hand."""
    session = Session(None)
    drawing, _ = drawing_tools(tmp_path / "mine.toml", session)
    yield drawing, session, Hand(drawing, session)
    session.close()


def drag(hand, tool, start, end=None, *, name="", shift=False, between=()):
    """Press, move and let go, in millimetres."""
    hand.tool = tool
    points = [(x * mm, y * mm) for x, y in (start, *between, end or start)]
    hand.press(points[0], name, shift=shift)
    for point in points[1:]:
        hand.move(point, shift=shift)
    hand.release(points[-1], shift=shift)


def draw_fourbar(hand):
    drag(hand, "leaf", (-31, 1), (-30, 19))
    drag(hand, "leaf", (30, 0), (30, 20))
    drag(hand, "pin", (-30, 20), (-30, 60))
    hand.end = "link.3"
    drag(hand, "pin", (30, 20), (30, 60))
    drag(hand, "drive", (-30, 60), (0, 61))


def test_a_fourbar_is_drawn_by_the_mouse_and_solves_as_its_file_does(drawn):
    drawing, session, hand = drawn
    draw_fourbar(hand)
    assert not session.settle().refused
    session.wish("drive", 4 * mm)
    pose = session.settle().asked.pose
    drawing.set_drive("drive", 4 * mm, "mm")
    drawing.save()
    mechanism, targets, _ = ksd.load_scene(drawing.file)
    again = ksd.solve(mechanism, targets)
    assert targets == {"drive": 4 * mm} and again.forces["drive"] == pose.forces["drive"] != 0.0
    assert [(leaf.a, leaf.b) for leaf in mechanism.scene().leaves] == [
        ("ground", "link"),
        ("ground", "link.2"),
    ]
    assert mechanism.scene().leaves[0].leaf.end == (-30 * mm, 20 * mm, 0.0)


def test_a_middle_bends_a_leaf_and_its_ends_keep_the_arc(drawn):
    drawing, session, hand = drawn
    draw_fourbar(hand)
    for x in (-38, -22):
        drag(hand, "move", (-30, 10), (x, 10), name="leaf/0/middle")
        leaf = drawing.draft.leaves[0].leaf
        assert leaf.section_at(0.5)[0][0] == pytest.approx(x * mm, abs=0.2 * mm)
    drag(hand, "move", (-30, 0), (-40, -10), between=[(-33, -4), (-41, -11)])
    leaf = drawing.draft.leaves[0].leaf
    assert leaf.start == (-40 * mm, -10 * mm, 0.0) and leaf.curve.chord == pytest.approx(
        math.hypot(10, 30) * mm
    )
    assert not session.settle().refused
    drag(hand, "move", (-22, 10), (-35, 5), name="leaf/0/middle")
    assert drawing.draft.leaves[0].leaf.curve is None


def test_undo_and_redo_by_whole_drags(drawn):
    drawing, session, hand = drawn
    draw_fourbar(hand)
    before = copy.deepcopy(drawing.tables)
    drag(hand, "move", (-30, 0), (-45, -10), between=[(-35, 0), (-40, -5)])
    moved = copy.deepcopy(drawing.tables)
    assert moved != before
    drawing.undo()
    assert drawing.tables == before
    drawing.redo()
    assert drawing.tables == moved
    for _ in range(6):
        drawing.undo()
    assert "leaf" not in drawing.tables and drawing.tables["links"] == []
    with pytest.raises(SceneError, match="nothing to undo"):
        drawing.undo()
    assert "no link" in session.settle().refused
    for _ in range(6):
        drawing.redo()
    with pytest.raises(SceneError, match="nothing to redo"):
        drawing.redo()


def test_an_escape_gives_back_what_was(drawn):
    drawing, session, hand = drawn
    draw_fourbar(hand)
    before = copy.deepcopy(drawing.tables)
    hand.tool = "move"
    hand.press((-30 * mm, 0.0))
    hand.move((-60 * mm, 0.0))
    assert drawing.tables != before
    hand.cancel()
    assert drawing.tables == before
    session.settle()
    hand.press((-30 * mm, 60 * mm), "drive/drive")
    hand.move((-25 * mm, 60 * mm))
    assert session.settle().values["drive"] == pytest.approx(5 * mm)
    hand.cancel()
    assert session.settle().values["drive"] == 0.0


def test_where_the_button_comes_up_counts_without_a_move_before(drawn):
    """As from a page that had no time for the last move; a click changes nothing."""
    drawing, session, hand = drawn
    draw_fourbar(hand)
    session.settle()
    hand.tool, before = "move", copy.deepcopy(drawing.tables)
    for name, at in (("drive/drive", (-30 * mm, 60 * mm)), ("", (-30 * mm, 0.0))):
        hand.press(at, name)
        hand.release(at)
        assert drawing.tables == before
    hand.press((-30 * mm, 60 * mm), "drive/drive")
    hand.release((-26 * mm, 60 * mm))
    assert drawing.tables["actuate"][0]["value"] == "4 mm"
    assert session.settle().values["drive"] == pytest.approx(4 * mm)
    hand.press((-30 * mm, 0.0))
    hand.release((-45 * mm, 0.0))
    assert drawing.tables["leaf"][0]["start"][0] == "-45 mm"


def test_a_wish_while_a_drawing_is_read_is_kept(drawn, monkeypatch):
    drawing, session, hand = drawn
    draw_fourbar(hand)
    session.settle()
    read = scene_from_tables

    def slowly(*words, **options):
        found = read(*words, **options)
        if session.values["drive"] == 0.0:
            session.wish("drive", 2 * mm)
        return found

    monkeypatch.setattr("ksd.interactive.session.scene_from_tables", slowly)
    drawing.tell()
    assert session.settle().values["drive"] == 2 * mm


def test_a_driven_link_follows_the_mouse(drawn):
    drawing, session, hand = drawn
    draw_fourbar(hand)
    session.settle()
    drag(hand, "move", (-30, 60), (-27, 66), name="drive/drive")
    assert session.settle().values["drive"] == pytest.approx(3 * mm)
    assert drawing.tables["actuate"][0]["value"] == "3 mm"
    drawing.undo()
    assert session.settle().values["drive"] == 0.0
    turning = Drawing(shipped_file("gripper", drawing.file.parent), lambda d: session.draw(d.tables, d.file))
    turning.tell()
    assert not session.settle().refused
    hand = Hand(turning, session)
    pivot = hand._pivot(session.scene.drives[0].terms[0])
    hand.press((pivot[0] + 20 * mm, pivot[1]), "drive/crank")
    hand.move((pivot[0] + 20 * mm * math.cos(0.1), pivot[1] + 20 * mm * math.sin(0.1)))
    assert session.settle().values["crank"] == pytest.approx(15 * deg + 0.1, abs=1e-4)


def shipped_file(name, folder):
    file = folder / f"{name}.toml"
    file.write_text(SCENES[name])
    return file


@pytest.mark.parametrize("tool", [t for t in TOOLS if t != "move"])
def test_every_tool_states_its_word_or_says_what_to_do(drawn, tool):
    drawing, _, hand = drawn
    draw_fourbar(hand)
    before = copy.deepcopy(drawing.tables)
    kind = {"drive": "actuate", "joint": "join"}.get(tool, tool)
    count = len(before.get(kind, []))
    hand.end = NEW_LINK
    drag(hand, tool, (30, 60), (50, 80))
    rows = drawing.tables[kind]
    assert len(rows) == count + 1 and drawing.selected == f"{kind}/{count}"
    mechanism, *_ = scene_from_tables(drawing.tables, drawing.file, whole=False)
    assert mechanism.draft().name == "mine"
    drawing.undo()
    assert drawing.tables == before
    if tool in ("support", "drive"):
        drag(hand, tool, (30, 60))
        assert drawing.tables[kind][-1]["about"] == "z"
    elif tool == "pin":
        drag(hand, tool, (-30, 0))
        assert drawing.tables["pin"][-1]["a"] == "ground"
    else:
        with pytest.raises(SceneError, match=tool):
            drag(hand, tool, (30, 60))
        assert drawing.tables == before


@pytest.mark.parametrize("family", LIBRARY)
def test_joints_of_the_library_solve_as_they_are_placed(drawn, family):
    _, session, hand = drawn
    hand.family = family
    drag(hand, "joint", (0, 0), (0, 40))
    hand.end = "link"
    drag(hand, "drive", (10, 60), (30, 60)) if family == "parallel_guide" else drag(hand, "drive", (10, 60))
    update = session.settle()
    assert not update.refused and session.scene.joints[0].joint.family == family
    placed = session.scene.joints[0]
    assert placed.place(placed.joint.pose_B)[1] == pytest.approx(40 * mm, rel=0.35)


def test_a_load_is_an_arrow_whose_tip_is_dragged(drawn):
    drawing, session, hand = drawn
    draw_fourbar(hand)
    drag(hand, "load", (30, 60), (30, 40))
    assert drawing.tables["load"][0]["force"] == [0, "-2 N", 0]
    drag(hand, "move", (30, 40), (45, 40), name="load/0/tip")
    assert drawing.tables["load"][0]["force"] == ["1.5 N", "-2 N", 0]
    drawing.set_load("load", 5.0)
    assert drawing.tables["load"][0]["force"] == ["3 N", "-4 N", 0]
    assert session.settle().values["load"] == 5.0


def test_delete_copy_mirror_and_typed_keys(drawn):
    drawing, _, hand = drawn
    drag(hand, "leaf", (-30, 0), (-20, 20))
    drag(hand, "move", (-25, 10), (-35, 15), name="leaf/0/middle")
    drawing.mirror()
    one, two = drawing.draft.leaves
    assert two.leaf.start == (30 * mm, 0.0, 0.0) and (two.a, two.b) == (one.a, one.b)
    assert two.leaf.section_at(0.5)[0] * [-1, 1, 1] == pytest.approx(one.leaf.section_at(0.5)[0])
    drawing.copy((20 * mm, 0.0))
    assert drawing.draft.leaves[2].leaf.start == (50 * mm, 0.0, 0.0)
    drawing.set_key("thickness", "0.2 mm")
    drawing.set_key("start", '["55 mm", 0, 0]')
    assert (
        drawing.tables["leaf"][2]["thickness"] == "0.2 mm"
        and drawing.tables["leaf"][2]["start"][0] == "55 mm"
    )
    with pytest.raises(SceneError, match="no key 'colour'"):
        drawing.set_key("colour", "red")
    drawing.delete()
    drawing.selected = "leaf/1"
    drawing.delete()
    drawing.selected = "leaf/0"
    drawing.delete()
    assert drawing.tables["links"] == [] and "leaf" not in drawing.tables
    with pytest.raises(SceneError, match="nothing is selected"):
        drawing.delete()


def changed_lines(before, after):
    lines = difflib.unified_diff(before.splitlines(), after.splitlines(), n=0)
    return [line for line in lines if line[0] in "+-" and line[:3] not in ("+++", "---")]


def test_a_file_changed_by_one_slider_differs_in_that_line_only(tmp_path):
    drawing = Drawing(shipped_file("guide", tmp_path))
    drawing.set_drive("table", -3.5 * mm, "mm")
    drawing.save()
    assert changed_lines(SCENES["guide"], drawing.file.read_text()) == [
        '-value = "5 mm"',
        '+value = "-3.5 mm"',
    ]
    drawing.undo()
    assert drawing.text == SCENES["guide"]


def test_comments_units_and_order_stay(tmp_path):
    for text in SCENES.values():
        assert rewritten(text, tomllib.loads(text)) == text
    tables = tomllib.loads(SCENES["fourbar"])
    tables["joint"]["cross"]["widths"][1] = "22 mm"
    del tables["join"][1]
    tables["links"].append("more")
    text = rewritten(SCENES["fourbar"], tables)
    assert tomllib.loads(text) == tables
    assert '+widths = ["40 mm", "22 mm"]    # inner leaf, each outer leaf' in changed_lines(
        SCENES["fourbar"], text
    )
    assert "# `at` is interface A of the joint" in text
    tables["leaf"] = [{"name": "new", "curve": {"kind": "arc"}}]
    assert tomllib.loads(rewritten(SCENES["fourbar"], tables)) == tables


@pytest.mark.parametrize(
    "old, value, unit, written",
    [
        ("40 mm", 0.0412, "", "41.2 mm"), ("1.5 in", 0.0254, "", "1 in"), ("45 deg", 0.5 * math.pi, "", "90 deg"),
        (0.04, 0.1 + 0.2, "mm", 0.3), (None, 0.04, "mm", "40 mm"), (0, 0.04, "mm", "40 mm"), ("x", 2.0, "", 2.0),
    ],
)  # fmt: skip
def test_a_number_is_written_in_the_unit_of_the_one_it_replaces(old, value, unit, written):
    assert in_unit_of(old, value, unit) == written


@pytest.mark.parametrize("name", SCENES)
def test_the_python_beside_makes_the_same_scene(name):
    tables = tomllib.loads(SCENES[name])
    source, space = python_text(tables), {}
    exec(source.rpartition("print(")[0], space)
    mechanism, *_ = ksd.load_scene(shipped_scenes()[name])
    assert space["m"].scene().fingerprint() == mechanism.scene().fingerprint()
    assert source.count("drive1.name: ") == ("value" in tables["actuate"][0])


def test_typed_text_is_taken_and_mistakes_are_sentences(tmp_path):
    drawing = Drawing(shipped_file("guide", tmp_path))
    drawing.set_text(
        drawing.text.replace("# A table on two", "# One table on two").replace('"5 mm"', '"6 mm"')
    )
    assert drawing.tables["actuate"][0]["value"] == "6 mm" and drawing.text.startswith("# One table")
    with pytest.raises(SceneError, match="not valid TOML"):
        drawing.set_text("name = ")
    assert "# " in Drawing(shipped_file("gripper", tmp_path)).text
    drawing.tables["leaf"][0]["curve"] = {"kind": "helix"}
    assert drawing.python.startswith("# ")


def test_a_folder_that_is_gone_is_said_when_saving(tmp_path):
    folder = tmp_path / "gone"
    folder.mkdir()
    drawing = Drawing(shipped_file("guide", folder))
    drawing.file.unlink()
    folder.rmdir()
    with pytest.raises(SceneError, match="guide"):
        drawing.save()
    assert drawing.save(tmp_path / "guide.toml").exists()


def test_the_plane_view_shows_every_part_and_no_text_becomes_markup(drawn):
    drawing, session, hand = drawn
    assert fitted_box(drawing) == EMPTY_BOX
    draw_fourbar(hand)
    drag(hand, "load", (30, 60), (30, 40))
    drawing.set_key("name", "<script>")
    update = session.settle()
    assert isinstance(update.asked, Asked)
    svg = plane_svg(
        drawing, update.asked, fitted_box(drawing), grid=5 * mm, refused=False, line=((0, 0), (1, 1))
    )
    for name in ("leaf/0/start", "leaf/0/middle", "leaf/1/line", "pin/1/at", "load/0/tip", "drive/drive"):
        assert f'data-name="{name}"' in svg
    assert "<script>" not in svg and np.all(np.isfinite(fitted_box(drawing, update.asked)))
    for name in ("gripper", "fourbar"):
        other = Drawing(shipped_file(name, drawing.file.parent))
        assert plane_svg(other, None, fitted_box(other), grid=5 * mm, refused=True).count("<polyline") > 20
