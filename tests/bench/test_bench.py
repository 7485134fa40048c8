"""The benchmark itself: scenes build, errors are those known from elsewhere, the front is a front."""

import json
import math

import pytest
from bench_measure import (
    Measurement,
    fastest_accurate,
    is_accurate,
    json_results,
    measure,
    pareto_indices,
    pareto_rows,
    summary,
    table,
)
from bench_scenes import SUITE, Case

import ksd
from ksd.answers.printing import render_text
from ksd.cli import main
from ksd.model.compile import compile_scene
from ksd.study.compare import METHODS


def row(method, call, force, stiffness=0.0, stable=True):
    times = (call,) * 3
    return Measurement(method, "2 elements", 2, 5, times, times, call, force, force, stiffness, stable)


def found(measured, method, leaves):
    return next(r for r in measured.rows if (r.method, r.leaves) == (method, leaves))


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
    assert is_accurate(strain)
    assert strain.force_error < 3e-6
    assert all(r.stable and not r.failed for r in fourbar.rows)


def test_times_are_ordered_and_steps_below_the_call(fourbar):
    for r in fourbar.rows:
        assert 0 < r.steps[1] <= r.call[1]
        assert r.call[0] <= r.call[1] <= r.call[2]


def test_points_that_no_other_beats():
    points = [(3, 1), (1, 5), (2, 6), (2, 4), (4, 2)]
    assert [points[n] for n in pareto_indices(points)] == [(1, 5), (2, 4), (3, 1)]


def test_front_and_cheapest():
    rows = [
        row("a", 3, 1e-6),
        row("b", 1, 1e-1),
        row("c", 2, 1e-4),
        row("c", 4, 1e-8),
        row("d", 1.5, 1e-8, stable=False),
    ]
    assert [r.method for r in pareto_rows(rows, "force_error")] == ["b", "c", "a", "c"]
    assert [(r.method, r.call[1]) for r in fastest_accurate(rows)] == [("c", 2), ("a", 3)]
    assert not is_accurate(row("e", 1, 0.0, stiffness=0.1))
    assert not is_accurate(row("e", 1, math.nan))


def test_numbers_are_strict_json_and_every_row_is_in_the_table(fourbar):
    text = json.dumps(json_results([fourbar]), allow_nan=False)
    assert json.loads(text)["cases"][fourbar.case]["rows"][0]["method"] == "kinematic"
    assert table(fourbar).row_count == len(fourbar.rows)
    assert any("plain Newton" in line for line in summary(fourbar))


def test_the_table_of_a_file_or_pipe_is_not_cut(fourbar):
    text = str(render_text(table(fourbar)))
    assert "\N{HORIZONTAL ELLIPSIS}" not in text and "conventional, planar" in text


def test_command(tmp_path, capsys):
    """One scene by every method; its rows are those of `ksd.compare`."""
    path = tmp_path / "bench.json"
    assert main(["bench", "--quick", "--case", "guide", "--json", str(path)]) == 0
    assert "guide" in capsys.readouterr().out
    found = json.loads(path.read_text())
    (rows,) = (case["rows"] for case in found["cases"].values())
    assert list(found["cases"]) == ["guide"] and found["machine"]["numba"]
    assert {row["method"] for row in rows} == set(METHODS) and all(row["status"] for row in rows)
    assert main(["bench", "--case", "rocket"]) == 2
    assert "rocket" in capsys.readouterr().err


def test_a_link_that_is_held_in_every_direction_has_no_error_of_stiffness():
    """The six-joint arm: its last link is driven in every direction."""

    def held():
        scene = ksd.Mechanism("held")
        end = scene.link("end")
        scene.leaf(
            scene.ground, end, start=(0, 0, 0), end=(0.1, 0, 0), width_axis="z", section=ksd.rectangle(5e-4, 0.02),
            material=ksd.Material(200e9, nu=0.3),
        )  # fmt: skip
        for axis in "xyz":
            scene.actuate(end, along=axis, at=(0.1, 0, 0), name=axis)
            scene.actuate(end, about=axis, name=f"about {axis}")
        return scene, {
            name: 0.005 * (name == "y") for name in ("x", "y", "z", "about x", "about y", "about z")
        }

    rows = measure(Case("held", held, "end", (0.1, 0.0, 0.0), baseline=()), quick=True, repeats=2).rows
    found = [row for row in rows if not row.failed]
    assert found and all(row.stiffness_error == 0.0 for row in found)
