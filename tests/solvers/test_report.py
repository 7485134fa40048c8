"""Tables and JSON: every number the table prints is in the JSON, and every key is documented."""

import fnmatch
import json
import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scenes import fourbar, single_joint

import ksd
from ksd.answers.printing import TABLE_WIDTH, format_number, format_signed_percent
from ksd.model.compile import compile_scene
from ksd.solvers.answer import SCHEMA, as_dict
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.joint_motions import JointMotions
from ksd.solvers.report import error_sentence
from ksd.solvers.steps import ErrorEstimate

SCENES = Path(ksd.__file__).parent / "scenes"


def paths(value, at=""):
    """Keys of nested numbers as in SCHEMA: lists of entries as [], lists of numbers as their key."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from paths(inner, f"{at}.{key}" if at else key)
    elif isinstance(value, list) and value and not isinstance(value[0], float | int | type(None)):
        for inner in value:
            yield from paths(inner, f"{at}[]")
    elif not (isinstance(value, list) and not value):
        yield at


def documented(path):
    # names may hold dots and slashes, so the stars of SCHEMA match anything
    return any(fnmatch.fnmatch(path.replace("[", "("), key.replace("[", "(")) for key in SCHEMA)


@pytest.fixture(scope="module")
def exact():
    return solve_conventional(compile_scene(fourbar()), {"top": 0.1})


@pytest.fixture(scope="module")
def estimated(exact):
    """As a fast method returns it: with an error estimate, unintended motion and a warning."""
    estimate = ErrorEstimate(np.array([0.5]), 2e-6, 3e-5, 8e-3, 2e-3)
    joints = tuple(j.name for j in exact.model.scene.joints)
    one = np.ones(len(joints))
    read = JointMotions(joints, joints, one, 0.25 * one, np.outer(one, [1e-6, -2e-6, 0, 1e-15, 0, 3e-4]))
    found = replace(exact, method="reduced", joint_motions=read, notes=("out of range",))
    return told(found, estimate)


def told(pose, error):
    """The pose, off the truth by what is told."""
    pose.__dict__["error"] = error
    return pose


@pytest.mark.parametrize("which", ["exact", "estimated"])
def test_every_key_is_documented_and_the_file_is_strict_json(which, request):
    d = as_dict(request.getfixturevalue(which))
    assert json.loads(json.dumps(d, allow_nan=False)) == d
    missing = [p for p in paths(d) if not documented(p)]
    assert not missing


def test_every_documented_key_of_a_mechanism_occurs(estimated):
    scene = single_joint()
    scene.support("tip", along="z", at=(0.1, 0, 0))
    turned = told(solve_conventional(compile_scene(scene), {"turn": 0.2}), estimated.error)
    modal = ksd.solve(single_joint(), turn=0.2, method="modal")
    seen = {*paths(as_dict(estimated)), *paths(as_dict(turned)), *paths(as_dict(modal))}
    rare = {
        "drives.*.value",
        "drives.*.effort",
        "drives.*.effort_error",
        "supports.*.effort",
        "supports.*.moment_Nm",
    }
    rare |= {"joints.*.intended.*_mm", "error", "strength", "doubts[]"}
    for key in SCHEMA:
        found = any(fnmatch.fnmatch(p.replace("[", "("), key.replace("[", "(")) for p in seen)
        assert found or key in rare or key.startswith(("stops", "cables", "contacts")), key


def test_a_reduced_answer_carries_its_range():
    """Size of the basis, how far its leaf is bent and how far it is good; without an estimate no exactness is claimed."""
    words = {"turn": 0.2, "method": "modal"}
    found = ksd.solve(single_joint(), **words)
    basis = as_dict(found)["basis"]
    assert (
        0.05 < basis["stroke"] < 0.3 < basis["most_stroke"]
        and 2 < basis["turn_deg"] < 15 < basis["most_turn_deg"]
    )
    assert (
        basis["coordinates"] == max(b.unknowns for b in found.model.bodies.values())
        and basis["condition"] > 1
    )
    assert f"Basis of '{basis['of']}', bent furthest" in str(found) and "within 1 % to" in str(found)
    trained = ksd.ModalBasis(expansion="trained", frame="node", internal=0)
    assert "good about the trained configuration alone" in " ".join(
        str(ksd.solve(single_joint(), basis=trained, **words)).split()
    )
    plain = ksd.solve(single_joint(), estimate=False, **words)
    assert plain.error is None and "against the model: not estimated" in " ".join(str(plain).split())


@pytest.mark.parametrize("which", ["exact", "estimated"])
def test_tables_fit_their_width(which, request):
    assert max(len(line) for line in str(request.getfixturevalue(which)).splitlines()) <= TABLE_WIDTH


def test_the_numbers_of_the_tables_are_in_the_json(estimated):
    d = as_dict(estimated)
    known = []

    def collect(value):
        if isinstance(value, dict):
            for inner in value.values():
                collect(inner)
        elif isinstance(value, list):
            for inner in value:
                collect(inner)
        elif isinstance(value, int | float):
            known.append(float(value))

    collect(d)
    lines = str(estimated).splitlines()
    drive = next(line for line in lines if line.strip().startswith("top ") and " N " in line)
    link = [line for line in lines if line.strip().startswith("top ")][-1]
    for text in re.findall(r"-?\d+\.\d+(?:e[+-]\d+)?", drive + link):
        assert any(math.isclose(float(text), k, rel_tol=1e-3) for k in known), text


def test_units(estimated):
    d = as_dict(estimated)
    assert d["drives"]["top"]["value_mm"] == pytest.approx(100)
    assert d["drives"]["top"]["force_N"] == pytest.approx(estimated.forces["top"])
    assert d["drives"]["top"]["force_error_N"] == 0.5
    assert d["error"] == pytest.approx(
        {"relative_percent": 0.8, "mesh_percent": 0.2, "displacement_um": 2.0, "rotation_mrad": 0.03}
    )
    joint = d["joints"]["lower left"]
    assert joint["unintended_displacement_um"] == pytest.approx([1, -2, 0])
    assert joint["unintended_rotation_mrad"] == pytest.approx([0, 0, 0.3])
    assert joint["intended"] == pytest.approx({"angle_deg": math.degrees(0.25)})
    assert d["links"]["top"]["displacement_mm"][0] == pytest.approx(100, rel=1e-3)


def test_intended_motion_without_a_record_is_read_from_the_poses():
    c = solve_conventional(compile_scene(single_joint()), {"turn": 0.4})
    assert as_dict(c)["joints"]["hinge"]["intended"]["angle_deg"] == pytest.approx(
        math.degrees(0.4), rel=1e-9
    )
    assert as_dict(c)["joints"]["hinge"]["unintended_displacement_um"] is None


def test_instability_and_doubt_are_said(exact):
    assert "stable: a minimum" in str(exact)
    assert "UNSTABLE" in str(replace(exact, negatives=exact.expected_negatives + 1))
    assert "NOT CERTAIN" in str(replace(exact, negatives=exact.expected_negatives - 1))


def test_a_number_that_is_not_finite_is_null_and_said(exact):
    bad = ErrorEstimate(np.array([math.inf]), math.inf, math.nan, math.inf)
    c = told(replace(exact, method="reduced"), bad)
    json.dumps(as_dict(c), allow_nan=False)
    assert "do not use" in str(c)


@pytest.mark.parametrize(
    "value,digits,text",
    [(None, 4, "-"), (0.0, 4, "0"), (12345.678, 4, "12346"), (0.0123456, 4, "0.01235"), (1e-9, 4, "1.00e-09"),
     (-521.1952, 6, "-521.195"), (2.5e7, 4, "2.50e+07")],
)  # fmt: skip
def test_number(value, digits, text):
    assert format_number(value, digits) == text


def test_mixed_drive_has_a_value_without_unit():
    scene = ksd.Mechanism("mixed")
    tip = scene.link("tip")
    steel = ksd.Material(E=2e11, nu=0.3)
    blade = {"section": ksd.rectangle(5e-4, 0.02), "material": steel, "width_axis": "z"}
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), **blade)
    scene.actuate(
        terms=scene.displacement(tip, "y", at=(0.1, 0, 0)) + 0.05 * scene.rotation(tip, "z"), name="sum"
    )
    d = as_dict(solve_conventional(compile_scene(scene), {"sum": 1e-3}))
    assert set(d["drives"]["sum"]) == {"value", "effort", "effort_error"}
    assert d["joints"] == {} and set(d["leaves"]) == {"leaf"}


def test_forces_of_leaf_springs_in_the_file_are_those_of_the_equilibrium():
    """A fast answer goes to it before questions, also before those of the file; torsion was 1 % off its moment."""
    mechanism, targets, _ = ksd.load_scene(SCENES / "six_joint_arm.toml")
    pose = ksd.solve(mechanism, targets)
    assert pose.method == "reduced"
    truth = ksd.solve(mechanism, targets, method="conventional").section_forces()
    for name, said in as_dict(pose)["leaves"].items():
        for end in ("start", "end"):
            expected = getattr(truth[name], end)[3:]
            assert said[f"{end}_moment_Nm"] == pytest.approx(expected, abs=1e-6 * max(abs(expected)))


def test_an_error_too_small_to_see_is_under_the_bound_of_a_residual(exact):
    """1e-8 of the force of `RTOL`, told as such; it was told as 0."""
    none = ErrorEstimate(np.zeros(1), 0.0, 0.0, 0.0, 0.0)
    assert str(none) == "under 1e-06 %"
    assert "mesh under 1e-06 %" in str(replace(none, relative=1e-3, mesh=1e-13))
    assert str(replace(none, relative=1.7e-14)) == "under 1e-06 %"
    told = as_dict(exact)
    told["error"] = {
        "relative_percent": 0.0, "mesh_percent": 0.0, "displacement_um": 0.0, "rotation_mrad": 0.0
    }  # fmt: skip
    assert error_sentence(told) == "Estimated error: under 1e-06 %, all of it of the mesh"


def test_without_drives_there_is_no_table_of_drives():
    scene = ksd.Mechanism("hung")
    end = scene.link("end")
    scene.leaf(
        scene.ground, end, start=(0, 0, 0), end=(0.06, 0, 0), width_axis="z", section=ksd.rectangle(3e-4, 0.02),
        material=ksd.Material(200e9, nu=0.3),
    )  # fmt: skip
    scene.load(end, force=(0, 0.1, 0), at=(0.06, 0, 0))
    said = str(ksd.solve(scene))
    assert "hung: solved" in said and "force or moment" not in said


@pytest.mark.parametrize(
    ("percent", "text"),
    [(203.4, "+203"), (-99.6, "-100"), (12.34, "+12"), (-0.0123, "-0.012"), (99.4, "+99")],
)
def test_changes_have_a_sign_and_no_exponent_where_they_are_large(percent, text):
    assert format_signed_percent(percent) == text


def test_first_solve_of_a_process_tells_its_own_times(monkeypatch):
    from ksd.solvers import solver

    calls, answer = [], solver.Solver._answer
    monkeypatch.setattr(solver, "_LOADED", set())
    monkeypatch.setattr(solver.Solver, "_answer", lambda *a: calls.append(0) or answer(*a))
    prepared = ksd.prepare(fourbar())
    first, again = prepared(top=0.1), prepared(top=0.1)
    assert len(calls) == 3 and first.forces == again.forces
    assert first.kernel_time >= 0.0 == again.kernel_time
    loaded = replace(first, kernel_time=0.25)
    assert as_dict(loaded)["time_us"] == as_dict(first)["time_us"] and "first call: kernels" not in str(again)
    assert re.search(r"first call: kernels +- +0\.25 s +loaded +not in the total", str(loaded))
