"""How a table is printed, and what a sweep asks when nothing is said."""

import math
import re

import numpy as np
import pytest
from scenes import fourbar, single_joint

import ksd
from ksd.answers.printing import TABLE_WIDTH
from ksd.study import Table
from ksd.study.questions import ALL_QUESTIONS, unanswerable_questions
from ksd.study.table import LEADING_COLUMNS, label_and_unit

QUIET = {"progress": False}


def rows(count, **more):
    return [
        {"top_mm": 10.0 * k, "top_force_N": 1.5 * k, "stress_MPa": 0.0, "mac": 1.0, "stable": 1.0, "warnings": ""} | more
        | {"status": "ok"}
        for k in range(count)
    ]  # fmt: skip


def table(found):
    return Table.of_rows(found, ["top_mm"], moving=("top_mm",), name="fourbar")


def lines(of):
    return [line for line in str(of).splitlines() if line.strip()]


def test_of_a_long_table_the_ends_are_printed():
    said = lines(table(rows(31)))
    assert said[0] == "Table of 'fourbar': 31 rows, 7 columns, 0 failed"
    body = [line.split() for line in said[1:-1]]
    # stress is zero in all rows, and the MAC is no answer
    assert body[:3] == [["top", "top", "force"], ["[mm]", "[N]"], ["\u2500" * len(body[2][0])]]
    assert [cells[0] for cells in body[3:]] == [
        *("0", "10.000", "20.000", "30.000", "40.000"), "\u22ee", *("260.00", "270.00", "280.00", "290.00", "300.00"),
    ]  # fmt: skip
    assert said[-1] == "columns: top_mm, top_force_N, stress_MPa, mac, stable, warnings, status"


@pytest.mark.parametrize("count", [0, 1, 12])
def test_of_a_short_table_all_rows_are_printed(count):
    said = str(table(rows(count)))
    assert "\u22ee" not in said and len(re.findall(r"^ *(?:0|\d+\.\d+) ", said, re.M)) == count


def test_failures_warnings_and_states_that_are_not_stable_are_told_once_with_their_rows():
    found = rows(20)
    for k in (3, 4, 5, 9):
        found[k] |= {"status": "it is out of reach", "top_force_N": math.nan}
    found[19] |= {"status": "another reason"}
    found[7] |= {"warnings": "strained by 2 %"}
    found[8] |= {"warnings": "strained by 3 %", "stable": 0.0}
    said = str(table(found))
    assert "(1) rows 3-5, 9: it is out of reach" in said and "(2) row 19: another reason" in said
    assert "warnings of 2 rows, the first: strained by 2 %" in said and "unstable: row 8" in said
    assert re.search(r"30\.000 +- +\(1\)", said) and re.search(r"190\.00 +28\.500 +\(2\)", said)
    assert said.count("out of reach") == 1


def test_wide_tables_are_folded_with_their_labels_and_every_number_is_there():
    more = {f"support_worst_{k}": float(k) for k in range(1, 30)}
    of = table(rows(4, **more))
    said = lines(of)
    assert max(map(len, said)) <= TABLE_WIDTH
    assert sum(line.split()[0] == "10.000" for line in said) > 1
    cells = [cell for line in said if line.split()[0] == "10.000" for cell in line.split()[1:]]
    assert [float(c) for c in cells if c != "0"] == [1.5, *more.values()]


def test_a_column_that_is_not_there_is_named_with_the_nearest():
    of = table(rows(2))
    for call in (lambda: of["top_force"], lambda: of.where(top_force=1.0)):
        with pytest.raises(
            ksd.SceneError, match=r"there is no column 'top_force'; did you mean \"top_force_N\"\?"
        ):
            call()


def test_rows_that_are_not_there_leave_the_columns():
    none = table(rows(2)).where(top_mm=99.0)
    assert len(none) == 0 and none["top_force_N"].shape == (0,) and "0 rows" in str(none)


def test_leading_columns_are_printed_whatever_they_are_called(tmp_path):
    of = Table.of_rows(
        rows(3), ["top_mm"], name="mine", leading=("mac", "warnings"), facts={"left_out": "size (no)"}
    )
    said = str(of)
    assert re.search(r"^ +\[mm\] +mac +warnings$", said, re.M) and "not asked: size (no)" in said
    again = Table.from_hdf5(of.to_hdf5(tmp_path / "a.h5"))
    assert str(again) == said and str(again.where(top_mm=10.0)).count("10.000") == 1


def test_columns_only_later_rows_have_stand_beside_their_like():
    """A mode first met on the way; the first row without an answer at all."""
    first = {"top_mm": 0.0, "parasitic_1_Hz": 9.0, "stress_MPa": 1.0, "warnings": "", "status": "ok"}
    later = {
        "top_mm": 1.0,
        "parasitic_1_Hz": 8.0,
        "parasitic_2_Hz": 9.0,
        "stress_MPa": 1.0,
        "warnings": "",
        "status": "ok",
    }
    for found in ([first, later], [{"top_mm": 0.0, "status": "no"}, later, first]):
        assert list(table(found).columns) == list(later)


def test_every_answer_of_a_sweep_has_words_and_unit():
    assert label_and_unit("time_us") == ("time", "us") and label_and_unit("error_percent") == ("error", "%")
    known = ksd.study.questions.column_questions(fourbar().scene(), 2)
    shown = {
        q for column, q in known.items() if any(re.fullmatch(pattern, column) for pattern in LEADING_COLUMNS)
    }
    assert shown == set(ALL_QUESTIONS) - {"parasitic", "energy", "size", "distance"} | {"vibration"}


def test_a_sweep_asks_all_that_has_an_answer():
    found = ksd.sweep(fourbar(), top=[0.1], method="full", **QUIET)
    named = ksd.sweep(fourbar(), top=[0.1], method="full", questions=ALL_QUESTIONS, **QUIET)
    assert found.columns.keys() == named.columns.keys() and found.failures == []
    assert all(
        np.array_equal(found[c], named[c], equal_nan=found[c].__class__ is not list) for c in found.columns
    )
    assert "not asked" not in str(found)


def test_what_a_mechanism_has_no_answer_to_is_said_and_not_asked():
    m = ksd.Mechanism("guide")
    table_, stuff = m.link("table"), ksd.Material(200e9, nu=0.3)
    words = {"section": ksd.rectangle(3e-4, 0.02), "material": stuff, "width_axis": "z"}
    m.leaf("ground", table_, start=(0, 0, 0), end=(0, 0.06, 0), **words)
    m.leaf("ground", table_, start=(0.06, 0, 0), end=(0.06, 0.06, 0), **words)
    m.actuate(table_, along="x", at=(0.03, 0.03, 0), name="drive")
    reasons = {
        "frequencies": "nothing has mass",
        "vibration": "nothing has mass",
        "clearance": "every two leaf springs share a block or are in one joint with windows",
    }
    assert unanswerable_questions(m.scene()) == reasons
    found = ksd.sweep(m, drive=[0.0, 2e-3], **QUIET)
    assert found.failures == [] and "first_parasitic_Hz" not in found.columns
    assert "not asked: frequencies (nothing has mass), clearance (" in str(found)
    # named, they are asked, and the rows say why there is no answer
    named = ksd.sweep(m, drive=[2e-3], questions=tuple(reasons), **QUIET)
    assert all(f"{q}: " in named.failures[0]["status"] for q in reasons)
    m.mass(table_, mass=1.0, at=(0, 0.1, 0))
    assert "frequencies" not in unanswerable_questions(m.scene())
    assert unanswerable_questions(single_joint().scene()) == {"clearance": reasons["clearance"]}
    assert unanswerable_questions(fourbar().scene()) == {}


def test_without_critical_load_factors_the_usual_questions_have_not_failed(monkeypatch):
    def none(*_, **__):
        raise ksd.ConvergenceError("no critical load factor was found")

    monkeypatch.setattr("ksd.solvers.configuration.buckling", none)
    found = ksd.sweep(single_joint(), turn=[0.2], **QUIET)
    assert found.failures == [] and np.isnan(found["buckling_positive"]).all()
    assert "buckling" not in str(found).partition("columns:")[0]
    named = ksd.sweep(single_joint(), turn=[0.2], questions="buckling", **QUIET)
    assert "buckling: no critical load factor" in named.failures[0]["status"]


def test_a_point_is_not_asked_about_where_no_drive_and_no_link_tells_it():
    m = ksd.Mechanism("hung")
    end = m.link("end")
    m.leaf(
        "ground", end, start=(0, 0, 0), end=(0.06, 0, 0), width_axis="z", section=ksd.rectangle(3e-4, 0.02),
        material=ksd.Material(200e9, nu=0.3),
    )  # fmt: skip
    cases = {"some": [{"link": "end", "force": (0, 0.1, 0), "at": (0.06, 0, 0)}]}
    found = ksd.sweep(m, loads=cases, **QUIET)
    assert found.failures == [] and "support_stiffness (no drive whose point" in str(found)
    assert "support_worst_N_per_m" in ksd.sweep(m, loads=cases, link=end, **QUIET).columns


def test_where_takes_names():
    with pytest.raises(ksd.SceneError, match="where: more values than it takes without a name"):
        ksd.sweep(single_joint(), turn=[0.1], questions="force", progress=False).where(5)
    with pytest.raises(ksd.SceneError, match=r"questions = \[\] must be a name"):
        ksd.sweep(single_joint(), turn=[0.1], questions="force", progress=False).plot([])


def test_small_forces_are_printed_and_rounding_beside_larger_ones_is_not():
    """A micro-mechanism has nN and nNm; 1e-12 of the largest force of a table is rounding."""
    made = Table(
        {"turn_deg": (0.0, 1.0), "turn_moment_Nm": (2e-11, 4.5e-10), "status": ("ok", "ok")}, ("turn_deg",)
    )
    assert "4.50e-10" in str(made) and "2.00e-11" in str(made)
    both = {
        "push_mm": (0.0, 1.0),
        "a_force_N": (1e-13, 3.0),
        "b_force_N": (2e-12, -1e-12),
        "status": ("ok", "ok"),
    }
    said = str(Table(both, ("push_mm",)))
    assert (
        "e-1" not in said
        and "3.0000" in said
        and "a force" in said
        and "b force" not in said.partition("columns:")[0]
    )
