"""Every benchmark script runs with --quick and finds a figure known from elsewhere."""

import hashlib
import json
from importlib import import_module
from itertools import combinations, pairwise
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image
from readable import assert_readable

import ksd
from ksd.view.figure import new_figure

FOLDER = Path(__file__).resolve().parents[1] / "benchmarks"
DRAWN_ANEW = ("speed.png", "families.png", "fig10_fourbar_force.png")
"""Stored pictures that a test draws again; `benchmarks/pictures.py` draws all."""


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    return import_module


def test_turns_are_counted(script, capsys):
    assert script("turns").main(["--quick"]) == 0
    assert "21 cases, 0 wrong" in capsys.readouterr().out


def test_figures_of_paper_1(script, tmp_path):
    found = script("paper1").main(["--quick", "--out", str(tmp_path)])
    fourbar = found["figure_10"]["readings"][1]["elements"][2]
    # acceptance C, n = 2, d = .3
    assert fourbar["full"]["force_N"][-1] == pytest.approx(513.162, rel=1e-5)
    assert fourbar["reduced"]["force_N"][-1] == pytest.approx(519.032, rel=5e-5)
    # acceptance B, n = 2 at 15, 45, 75 degrees; EOB against FE
    moments = found["figure_7"]["default"][2]["fe"]
    assert [moments[k] for k in (2, 8, 14)] == pytest.approx([1.014307, 1.119823, 1.298602], rel=2e-6)
    assert max(found["figure_7"]["largest_difference_eob_fe"].values()) < 5e-5
    # the reduced joint does not feel the force across it in its moment (paper 1, section 4.2)
    across = found["figure_8"]["cases"][4.0]
    assert across["reduced"]["moment"][-1] / across["full"]["moment"][-1] > 1.1
    assert len(list(tmp_path.glob("fig*.png"))) == 5
    assert json.loads((tmp_path / "paper1.json").read_text())["machine"]["numba"]


def test_optima(script, tmp_path):
    found = script("optima").main(["--quick", "--out", str(tmp_path)])
    shares = found["summary"]["gradient, 4 starts"]
    assert shares["jobs"] == shares["best of all"] + shares["failed"] >= 1
    assert all(
        own["missed near, untold"] == own["violated"] == 0
        for name, own in found["summary"].items()
        if name != "worths"
    )
    assert (tmp_path / "optima.json").stat().st_size > 1000


def test_live(script, tmp_path):
    pytest.importorskip("nicegui", reason="the extra `live` is not installed")
    found = script("live").main(["--quick", "--out", str(tmp_path)])
    assert found["scenes"]["fourbar"]["over_solve"] > 1 and found["drag"]["parts_us"]["model"] > 0
    assert "| drag of a clamp |" in (tmp_path / "live.md").read_text()


def test_shape(script, tmp_path):
    found = script("shape").main(["--quick", "--out", str(tmp_path)])
    assert found["scenes"]["fourbar"]["leaves"] == 12 and found["scenes"]["gripper"]["shape_over_solve"] > 0
    assert "| gripper | 4 |" in (tmp_path / "shape.md").read_text()


def test_response(script, tmp_path):
    found = script("response").main(["--quick", "--out", str(tmp_path)])
    assert found["scenes"]["guide"]["curves"] == 2 and found["scenes"]["fourbar"]["response_over_modal"] > 0
    assert "| fourbar |" in (tmp_path / "response.md").read_text()


def test_speed(script, tmp_path):
    readme = tmp_path / "README.md"
    readme.write_text("before\n<!-- measured:begin -->\nold\n<!-- measured:end -->\nafter\n")
    found = script("speed").main(["--quick", "--out", str(tmp_path), "--readme", str(readme)])
    rows = {(r["method"], r["elements"]): r for r in found["solves"]["1"]["rows"]}
    assert rows["full", 2]["force_N"] == pytest.approx(513.162, rel=1e-5)
    assert rows["plain Newton", 5]["iterations"] in range(40, 50)
    assert rows["full", 0]["force_error"] < 5e-6
    text = readme.read_text()
    assert text.startswith("before\n<!-- measured:begin -->\n| the fourbar above")
    # the rows of the fourbar, and that of the arm by `reduced`
    assert text.count(" % |\n") == 6
    assert text.endswith("<!-- measured:end -->\nafter\n")
    assert "old" not in text
    assert (tmp_path / "speed.png").stat().st_size > 20_000
    split = found["iterations"]["full, 5 elements"]["split_us"]
    assert set(split) == {"assembly", "factorisation", "solve", "update"}


def test_the_readme_has_the_stored_table(script):
    found = json.loads((FOLDER / "results" / "speed.json").read_text())
    arm = json.loads((FOLDER / "results" / "arm.json").read_text())
    text = (FOLDER.parent / "README.md").read_text()
    assert script("speed_report").readme_table(found, arm) in text
    # and its first sentence says the same
    rows = {(r["method"], r["elements"]): r for r in found["solves"]["1"]["rows"]}
    planar = 1e-3 * rows["conventional, planar", 0]["call"]["median_us"]
    poses = list(arm["strain-mode leaves"]["location-case"].values())
    conventional, reduced = (sum(p[key] for p in poses) / len(poses) for key in ("mip_ms", "reduced_ms"))
    assert (
        f"a planar fourbar in {planar:.2f} ms, a spatial arm of 90 leaf springs in {conventional:.1f} ms, or in "
        f"{reduced:.1f} ms"
    ) in " ".join(text.split())


def test_table_needs_its_markers(script, tmp_path):
    plain = tmp_path / "README.md"
    plain.write_text("no markers\n")
    with pytest.raises(ValueError, match="measured:begin"):
        script("speed_report").insert_table(plain, "table")
    assert plain.read_text() == "no markers\n"


def test_stored_pictures_by_one_command(script, tmp_path, monkeypatch):
    """Some drawn anew, each to be read; every stored one shows the numbers that are stored, and there are no others."""
    pictures, stamped = script("pictures"), script("common").png_with_digest
    every = set(pictures.PICTURES)

    def read(figure, *words):
        assert_readable(figure)
        return stamped(figure, *words)

    monkeypatch.setattr(script("common"), "png_with_digest", read)
    monkeypatch.setattr(pictures, "PICTURES", {n: pictures.PICTURES[n] for n in DRAWN_ANEW})
    drawn = {p.name: p for p in pictures.main(["--out", str(tmp_path)])}
    assert drawn.keys() == {"hero.png", *DRAWN_ANEW}
    kept = [*(FOLDER.parent / "docs").glob("*.png"), *(FOLDER / "results").glob("*.png")]
    assert {p.name for p in kept} == {"hero.png", *every}
    for stored in kept:
        then = Image.open(stored)
        name, digest = then.text["Numbers"].split()
        assert digest == hashlib.sha256((FOLDER / "results" / name).read_bytes()).hexdigest(), (
            f"{stored.name} is older than {name}: python benchmarks/pictures.py"
        )
        if stored.name in drawn:
            shown = Image.open(drawn[stored.name])
            assert shown.text["Numbers"] == then.text["Numbers"] and shown.size == then.size


def test_the_front_of_a_work_precision_picture(script):
    """The black line goes through what nothing beats; words lie on no other word and inside the axes."""
    front = script("front")
    marks = [
        front.Mark("reduced", 0, 20.0, 0.5),
        front.Mark("conventional", 0, 60.0, 1e-5),
        front.Mark("full", 0, 65.0, 1e-5),
    ]
    marks += [front.Mark("conventional, planar", 0, 40.0, 1e-5), front.Mark("kinematic", 0, 30.0, 7.0)]
    marks += [front.Mark("plain Newton", n, 100.0 * n, 5.0 / n) for n in range(1, 6)]
    figure = new_figure(5, 4)
    axes = figure.add_subplot()
    front.draw_fronts([front.Panel(axes, marks, "scene", "time", "force")])
    (line,) = (found for found in axes.lines if found.get_gid() == "front")
    assert np.column_stack(line.get_data())[1:].tolist() == [[20.0, 0.5], [40.0, 1e-5]]
    figure.canvas.draw()
    boxes = {t.get_text(): t.get_window_extent() for t in axes.texts if t.get_text()}
    assert {"reduced", "conventional", "full", "kinematic", "plain Newton, 1 to 5\nelements per leaf"} <= set(
        boxes
    )
    for (one, a), (two, b) in combinations(boxes.items(), 2):
        assert not a.overlaps(b), f"'{one}' on '{two}'"
    for line in (found for found in axes.lines if found.get_marker() == "s" and len(found.get_xdata())):
        ends = axes.transData.transform(np.column_stack(line.get_data()))
        along = np.concatenate([np.linspace(a, b, 200) for a, b in pairwise(ends)])
        for word, box in boxes.items():
            assert not ((along > box.min) & (along < box.max)).all(axis=1).any(), f"'{word}' on a line"
    assert all(axes.bbox.x0 <= box.x0 and box.x1 <= axes.bbox.x1 for box in boxes.values())


def test_optimise(script, tmp_path):
    found = script("optimise").main(["--quick", "--out", str(tmp_path)])
    rows = found["at_best"]
    assert found["designs"] >= 40 and found["failures"] == 0
    # the best design is within what is allowed, better than the first, and the fast answer is that of `full`
    assert rows["full"]["stress_MPa"] <= 601 and rows["full"]["force_N"] <= 40.1
    assert rows["full"]["stiffness_N_per_m"] > found["at_start"]["full"]["stiffness_N_per_m"]
    assert abs(rows["reduced, 1 step"]["stiffness_error"]) < 2e-3
    assert rows["conventional, 10 elements"]["force_N"] == pytest.approx(rows["full"]["force_N"], rel=1e-3)


def test_choice_of_a_joint(script, tmp_path):
    found = script("choose").main(["--quick", "--out", str(tmp_path)])["optima"]
    # Wiersma and others 2012: over +-20 degrees the butterfly loses least; the others lose four fifths in frequency
    assert list(found) == ["butterfly", "cartwheel"]
    assert found["butterfly"]["kept"] > 0.7 > 0.3 > found["cartwheel"]["kept"]
    assert (tmp_path / "choose.png").stat().st_size > 10_000


def test_stroke(script, tmp_path):
    found = script("stroke").main(["--quick", "--out", str(tmp_path)])
    rows = {row["way"]: row for row in found["rows"]}
    assert all(row["failures"] == 0 and len(row["largest_errors"]) == 4 for row in rows.values())
    assert max(rows["full"]["largest_errors"].values()) < 1e-5
    assert rows["reduced"]["largest_errors"]["top_force_N"] < 0.013


def test_figures_of_paper_2(script, tmp_path):
    found = script("paper2").main(["--quick", "--out", str(tmp_path)])
    # as printed slightly stiffer, and no longer successful at the increased load of fig. 6
    strokes = {k: found[k]["stroke"] for k in ("figure_3", "figure_4", "figure_6")}
    names = ("full, 10 elements", "modal derivatives as printed", "director, chord, 2 internal")
    full, printed, default = (strokes["figure_4"][n] for n in names)
    assert 0.97 < printed / full < 1.0
    assert default == pytest.approx(full, rel=1e-5)
    assert strokes["figure_6"][names[1]] < 0.8 * strokes["figure_6"][names[0]]
    # the support side of the same states: as printed several times too stiff
    support = found["figure_4"]["support"]
    assert support[names[1]] < 0.3 * support[names[0]]
    assert support[names[2]] == pytest.approx(support[names[0]], rel=1e-4)
    # both bases of fig. 3 similar, the quadratic manifold stiffer than either
    tip = strokes["figure_3"]
    two = [tip[n] for n in ("2 vibration modes, 3 derivatives", "2 Craig-Bampton modes, 3 derivatives")]
    assert two[0] == pytest.approx(two[1], rel=5e-3)
    assert len(list(tmp_path.glob("paper2_fig*.png"))) == 6
    missed = [r["what"] for r in found["acceptance"] if not r["met"]]
    assert missed == []


def test_cost_and_health_of_modal_bodies(script, tmp_path):
    cost = script("modal_cost").main(["--quick", "--out", str(tmp_path)])
    rows = {r["way"]: r for r in cost["leaves"]}
    assert rows["modal, default"]["in_plane_error"] < 1.05 * rows["full, 10 elements"]["in_plane_error"]
    assert rows["strain modes (4, 3, 6)"]["across_error"] < 1e-4
    assert cost["solids"][0]["tip_error"] < 1e-4
    health = script("modal_health").main(["--quick", "--out", str(tmp_path)])
    ratios = [r["ratio"][None] for r in health["rows"]]
    assert len(ratios) >= 15 and all(0.6 <= r <= 1.4 for r in ratios)


def test_batches_and_tabulated_joints(script):
    batch = script("batch")
    stroke = [0.02, 0.2]
    designs = batch.random_designs(12, seed=3)
    found = ksd.batch(batch.fourbar, designs=designs, top=stroke, threads=1)
    assert batch.largest_force_difference(found, designs, stroke) < 1e-10
    rows = {(r["case"], r["leaves"]): r for r in batch.measure_tabulated(12)}
    assert len(rows) == 4 and all(r["solved"] == 12 and r["force_error"] < 1e-6 for r in rows.values())


def test_designs(script, tmp_path):
    found = script("designs").main(["--quick", "--out", str(tmp_path)])
    rows = {r["what"]: r for r in found["rows"]}
    # the README's fourbar at d = .3 m
    assert rows["fourbar"]["forces"]["top"] == pytest.approx(521.1948, rel=1e-6)
    assert all(r["force_error"] < 1e-5 and r["stiffness_error"] < 1e-4 for r in rows.values())
    assert [c["joints"] for c in found["chains"]] == [3, 100]
    assert (tmp_path / "designs.json").exists()


def test_gradients(script, tmp_path):
    found = script("gradients").main(["--quick", "--out", str(tmp_path)])
    assert [row["what"] for row in found["accuracy"]] == ["crossed pivot", "arc hinge"]
    for row in found["accuracy"]:
        assert not row["failed"] and len(row["errors"]) > 20
        assert all(error <= 1e-6 + 10 * own for error, _, own in row["errors"].values())
    assert found["cost"][0]["parameters"] == 18
    assert found["optima"][0]["merit"] == pytest.approx(0.5035665, abs=1e-6)
    assert (tmp_path / "gradients.json").exists()


def test_chain(script, tmp_path):
    found = script("chain").main(["--quick", "--out", str(tmp_path)])
    assert len(found["rows"]) == 4 and all(r["solved"] for r in found["rows"])
    assert (tmp_path / "chain.json").exists()


def test_arm(script, tmp_path):
    found = script("arm").main(["--quick", "--out", str(tmp_path)])
    (rows,) = (v for k, v in found.items() if "element" in k)
    for case in ("joint-case", "location-case"):
        widest = max(rows[case].items(), key=lambda item: abs(float(item[0])))[1]
        # acceptance F asks for 2 and 2, 4 and 4 iterations of steps 3 and 5; issue: error of the force below 2 %
        assert widest["step 3"] <= 4 and widest["step 5"] <= 4 and widest["force_error"] < 0.02
        assert widest["plain"] > widest["mip"] > widest["step 5"]


def test_where_a_record_pays(script, monkeypatch):
    """Guides as they are trained, when a training is worth it, and errors of all methods of one scene (not timed here)."""
    pays = script("pays")
    assert [len(pays.drawn_guide(n).leaves()) for n in (2, 24)] == [2, 24]
    row = {"us": {"conventional": 300.0, "reduced": 200.0}, "prepare_us": 1000.0}
    assert pays.poses_until_it_pays(row, 2.0) == pytest.approx((2e6 + 1e3) / 100)
    assert pays.poses_until_it_pays(row | {"us": {"conventional": 1.0, "reduced": 2.0}}, 2.0) == np.inf
    found = pays.errors_over_time(*pays.open_arm([script("common").cross_flexure()] * 2, turn=0.2), repeats=1)
    assert found["full"]["error"] < 1e-4 and found["conventional"]["error"] < 1e-4
    assert found["reduced"]["error"] < 0.1 * found["reduced alone"]["error"] < 0.01
    assert found["kinematic"]["error"] > found["reduced alone"]["error"]


def test_the_verdict_on_the_chosen_method(script):
    chosen = script("chosen")
    rows = [
        {"us": {"chosen": t, "full": 100.0, "conventional": 120.0}, "ratio": t / 100.0}
        for t in (100.0, *(9 * [105.0]))
    ]
    found = chosen.verdict(rows)
    assert found["share_within_10_percent"] == 1.0 and found["worst"] == 1.05 and not found["met"]
    assert found["sum_us"] == {"chosen": 1045.0, "full": 1000.0, "conventional": 1200.0}
    rows[0]["us"]["chosen"], rows[0]["ratio"] = 160.0, 1.6
    found = chosen.verdict(rows)
    assert (found["above_1.5"], found["share_within_10_percent"]) == (1, 0.9)
    rows[0] = {"us": {"chosen": 100.0, "full": 300.0, "conventional": 250.0, "reduced": 95.0}, "ratio": 1.05}
    assert chosen.verdict(rows)["met"]


def test_a_cable_hangs_in_its_catenary(script):
    """That of cosseratbench with a soft cable, from the elastic catenary; the package itself need not be there."""
    stuff = SimpleNamespace(youngs_modulus=1e5, shear_modulus=1e5 / 3, density=1000.0)
    rod = SimpleNamespace(material=stuff, radius=0.005, length=1.0, loads=(), start=SimpleNamespace(name="PINNED"),
                          centerline=((0.0, 0.0, 0.0), (0.8, 0.0, 0.0)))  # fmt: skip
    statics = script("cosseratbench_statics")
    scene, drives = statics.rod_of(SimpleNamespace(rods=(rod,), gravity=(0.0, 0.0, -9.81)))
    pose = ksd.solve(scene, drives)
    assert pose.iterations <= 100
    assert statics.line(pose, 25)[:, 2].min() == pytest.approx(-0.295207, rel=1e-3)
    curve = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0]])
    assert statics.distance(np.array([[0.5, 0.2, 0.1], [2, 1, 0]]), curve) == pytest.approx(1.0)


def test_bows_are_braced_and_drawn(script, tmp_path):
    found = script("bows").main(["--quick", "--out", str(tmp_path)])
    assert all(row["solved"] and row["way exists"] for row in found["rows"])
    assert found["apart"] < 1e-4 and (tmp_path / "bows.json").stat().st_size > 100
