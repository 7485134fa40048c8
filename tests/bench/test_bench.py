"""The benchmark itself: scenes build, errors are those known from elsewhere, the front is a front."""

import json
import math

import numpy as np
import pytest

from ksd.bench import SUITE, Row, asked, measure
from ksd.bench.engines import frame_of, measure_engines
from ksd.bench.floor import factor_operations, one_pass
from ksd.bench.report import cheapest, front, good, numbers, picture, summary, table
from ksd.bench.suite import REACH, chain
from ksd.bench.suite import fourbar as fourbar_scene
from ksd.cli import main
from ksd.model.compile import compile_scene
from ksd.numerics.blocks import plan_blocks


def row(method, call, force, stiffness=0.0, stable=True):
    times = (call,) * 3
    return Row(method, "2 elements", 2, 5, times, times, call, force, force, stiffness, stable)


@pytest.fixture(scope="module")
def fourbar():
    case = next(c for c in SUITE if "reading 1" in c.name)
    return measure(case, quick=True, repeats=2)


def found(measured, method, leafs):
    return next(r for r in measured.rows if (r.method, r.leafs) == (method, leafs))


def test_every_scene_of_the_suite_compiles():
    for case in SUITE:
        if "location" not in case.name and "100" not in case.name:
            scene, targets = case.build()
            model = compile_scene(scene)
            assert set(model.drive_names) == set(targets)
            assert case.link in model.node_names


def test_errors_and_counts_of_the_fourbar(fourbar):
    # acceptance C, n = 5: full 519.484 N; converged 521.195 N
    assert found(fourbar, "full", "5 elements").force_error == pytest.approx(1 - 519.484 / 521.1948, rel=1e-3)
    assert found(fourbar, "reduced", "5 elements").force_error == pytest.approx(
        525.516 / 521.1948 - 1, rel=1e-2
    )
    # acceptance F: plain Newton 46-47, MIP 8
    assert found(fourbar, "plain Newton", "5 elements").iterations in (46, 47)
    for method in ("conventional", "MIP on all nodes"):
        assert found(fourbar, method, "5 elements").iterations == 8
    strain = found(fourbar, "full", "strain 4,3,6")
    assert good(strain)
    assert strain.force_error < 3e-6
    assert all(r.stable and not r.failed for r in fourbar.rows)


def test_times_are_ordered_and_steps_below_the_call(fourbar):
    for r in fourbar.rows:
        assert 0 < r.steps[1] <= r.call[1]
        assert r.call[0] <= r.call[1] <= r.call[2]


def test_front_and_cheapest():
    rows = [
        row("a", 3, 1e-6),
        row("b", 1, 1e-1),
        row("c", 2, 1e-4),
        row("c", 4, 1e-8),
        row("d", 1.5, 1e-8, stable=False),
    ]
    assert [r.method for r in front(rows, "force_error")] == ["b", "c", "a", "c"]
    assert [(r.method, r.call[1]) for r in cheapest(rows)] == [("c", 2), ("a", 3)]
    assert not good(row("e", 1, 0.0, stiffness=0.1))
    assert not good(row("e", 1, math.nan))


def test_numbers_are_strict_json_and_the_picture_is_drawn(fourbar, tmp_path):
    text = json.dumps(numbers([fourbar]), allow_nan=False)
    assert json.loads(text)["cases"][fourbar.case]["rows"][0]["method"] == "kinematic"
    picture([fourbar], str(tmp_path / "bench.png"))
    assert (tmp_path / "bench.png").stat().st_size > 20_000
    assert table(fourbar).row_count == len(fourbar.rows)
    assert any("plain Newton" in line for line in summary(fourbar))


def test_what_was_asked_is_met_or_missed_with_the_reason(fourbar):
    text = asked.table([fourbar])
    lines = {tuple(line.split("|")[1:3]): line for line in text.splitlines()[2:]}
    # six ratios, and two bounds: of the strain-mode leaf, with five elements none of four
    assert len(lines) == 8
    ratio = next(line for line in text.splitlines() if "full / MIP on condensed leafs >= 1.8" in line)
    full, mip = (found(fourbar, method, "5 elements") for method in ("full", "conventional"))
    # MIP: 8 solves and a look at the end (acceptance F); full: step 2, two iterations or three and a look
    assert mip.passes == 9 and full.passes in (4, 5)
    if mip.call[1] / full.call[1] < 1.8:
        assert (
            "missed" in ratio
            and f"passes over the leafs, full {full.passes}" in ratio
            and "operations" in ratio
        )
    else:
        assert "met" in ratio
    assert "missed" not in next(line for line in text.splitlines() if "conventional, strain" in line)


def test_operations_of_a_pass_grow_with_the_mechanism():
    # a full matrix of six in blocks of three: n^3 / 3 and what the lower blocks take whole
    plan, *_ = plan_blocks(np.array([3, 3]), [(0, 1)])
    assert factor_operations(plan) == 9 + 27 + 54 + 9
    few, many = (one_pass(compile_scene(chain(n)[0]).arrays) for n in (16, 48))
    assert many.leafs == 3 * few.leafs and many.matrix == 3 * few.matrix
    # the ends of the chain are cheaper
    assert 3.0 * few.factor <= many.factor <= 3.3 * few.factor
    assert 2.2 * few.bytes <= many.bytes <= 3 * few.bytes


def test_the_frame_other_engines_get_is_the_scene():
    scene, targets = fourbar_scene(REACH)
    frame = frame_of(scene, targets, 4)
    leafs = [bar for bar in frame.bars if math.inf > bar.GA]
    assert len(leafs) == 4 * 2 * 4
    # inner leaf 40 x 1 mm, and the two outer ones in one
    assert {round(bar.EA) for bar in leafs} == {8_000_000}
    assert pytest.approx(5 / 6 * 76.9e9 * 40e-6, rel=1e-6) == leafs[0].GA
    assert pytest.approx(200e9 * 40e-15 / 12 * 1e3, rel=1e-9) == leafs[0].EI
    rows = measure_engines(scene, targets, 521.1948, elements=(10,), repeats=1)
    assert {r.engine for r in rows} == {"OpenSees", "Exudyn"}
    assert all(r.said.startswith("skipped") or r.force_error < 5e-3 for r in rows)


def test_command(tmp_path, capsys):
    path = tmp_path / "bench.json"
    assert main(["bench", "--quick", "--case", "guide", "--json", str(path)]) == 0
    assert "parallel guide" in capsys.readouterr().out
    assert list(json.loads(path.read_text())["cases"]) == ["parallel guide, 20 mm"]
    assert main(["bench", "--case", "rocket"]) == 2
    assert "rocket" in capsys.readouterr().err
