"""Sweeps: answers of every pose, load case and design in one table, failures included, on any executor."""

import concurrent.futures
import csv
import pickle
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from processes import environment
from scenes import cross_flexure, fourbar, single_joint

import ksd
from ksd.files import write_csv
from ksd.library.result_files import read_columns
from ksd.solvers.verdict import refusal
from ksd.study import sweep_path
from ksd.study.questions import ALL_QUESTIONS, Questions
from ksd.study.sweep import sweep
from ksd.study.sweep_path import error_sentence

QUIET = {"progress": False}
ROOT = Path(__file__).resolve().parents[2]


def thin(thickness, length=0.1):
    """A cross flexure whose leaf springs are `thickness` thick."""
    return single_joint(cross_flexure(thickness=thickness, length=length))


@pytest.fixture(scope="module")
def stroke():
    """Eleven poses of the fourbar with every question."""
    return sweep(fourbar(), method="full", questions=ALL_QUESTIONS, top=np.linspace(0, 0.3, 11), **QUIET)


def test_answers_are_those_of_single_configurations(stroke):
    pose = ksd.solve(fourbar(), top=0.3, method="full")
    row = list(stroke.rows())[-1]
    assert row["status"] == "ok" and row["top_mm"] == pytest.approx(300)
    assert row["top_force_N"] == pytest.approx(pose.forces["top"], rel=1e-9)
    assert row["top_force_N"] == pytest.approx(521.2, rel=1e-4)
    assert row["top_stiffness_N_per_m"] == pytest.approx(pose.drive_stiffness()["top"], rel=1e-6)
    point = (0, 0.3 + cross_flexure().length_AB, 0)
    assert row["support_z_N_per_m"] == pytest.approx(pose.stiffness("top", at=point).supports["z"], rel=1e-6)
    assert row["support_x_N_per_m"] == np.inf, "held by the drive"
    modes = pose.frequencies(freed=("top",))
    assert row["intended_Hz"] == pytest.approx(modes.frequency_Hz[0], rel=1e-6)
    assert row["first_parasitic_Hz"] == pytest.approx(modes.first_parasitic_Hz, rel=1e-6)
    assert row["stress_MPa"] == pytest.approx(1e-6 * pose.stress().largest_Pa)
    assert row["parasitic_y_mm"] == pytest.approx(1e3 * pose.displacement("top", point)[1])
    assert row["parasitic_x_mm"] == pytest.approx(0, abs=1e-9)
    assert row["strain_energy_J"] == pytest.approx(sum(pose.strain_energy().values()))
    assert row["buckling_negative"] == pytest.approx(pose.buckling().negative, rel=1e-6)


def test_work_of_the_drive_is_the_strain_energy(stroke):
    d, F = 1e-3 * stroke["top_mm"], stroke["top_force_N"]
    fine = sweep(fourbar(), method="full", questions="force", top=np.linspace(0, 0.3, 121), **QUIET)
    work = np.trapezoid(fine["top_force_N"], 1e-3 * fine["top_mm"])
    assert len(d) == len(F) == 11
    assert work == pytest.approx(stroke["strain_energy_J"][-1], rel=1e-3)


def test_conventional_continues_from_pose_to_pose():
    values = {"turn": np.deg2rad([15, 30, 45, 60])}
    there = sweep(single_joint(), values, method="conventional", questions="force", **QUIET)
    alone = [ksd.solve(single_joint(), turn=v, method="conventional").forces["turn"] for v in values["turn"]]
    assert there["turn_moment_Nm"] == pytest.approx(alone, rel=1e-6)


def test_failures_are_rows_that_say_why():
    table = sweep(fourbar(), method="full", questions="force", top=[0.1, 0.5, 0.2], **QUIET)
    assert len(table) == 3 and table["top_mm"] == pytest.approx([100, 500, 200])
    assert [s == "ok" for s in table["status"]] == [True, False, True]
    assert "lock" in table.failures[0]["status"] or "range" in table.failures[0]["status"]
    assert np.isnan(table["top_force_N"][1])


def test_designs_that_cannot_be_built_are_rows_too():
    table = sweep(thin, designs={"thickness": [1e-3, -1e-3]}, questions="force", turn=[0.1, 0.2], **QUIET)
    assert len(table) == 4 and len(table.failures) == 2
    assert all("cannot be built" in row["status"] and row["thickness"] == -1e-3 for row in table.failures)
    # in the columns of the designs that could be
    assert table["turn_deg"] == pytest.approx(np.rad2deg([0.1, 0.2, 0.1, 0.2]))
    assert "turn" not in table.columns


def test_designs_loads_and_drives_combine():
    loads = {"bare": [], "pulled": {"link": "tip", "force": (0, 0, 5.0), "at": (0.05, 0, 0)}}
    table = sweep(
        thin, designs={"thickness": [5e-4, 1e-3]}, loads=loads, questions=("force", "stress", "parasitic"),
        turn=[0.2, 0.4, 0.6], method="full", **QUIET,
    )  # fmt: skip
    assert len(table) == 2 * 2 * 3 and not table.failures
    assert table.labels == ("thickness", "load_case", "turn_deg") and table.moving == ("turn_deg",)
    thick, slim = (table.where(thickness=t, load_case="bare")["turn_moment_Nm"] for t in (1e-3, 5e-4))
    assert thick / slim == pytest.approx(np.full(3, 8.0), rel=1e-3)
    assert (table.where(load_case="pulled")["parasitic_z_mm"] > 1e-5).all()
    assert np.abs(table.where(load_case="bare")["parasitic_z_mm"]).max() < 1e-9


def test_a_moment_alone_needs_no_point():
    moment = (0, 0, 0.01)
    cases = {"twisted": {"link": "tip", "moment": moment}}
    table = sweep(thin(1e-3), loads=cases, questions="force", turn=0.2, method="conventional", **QUIET)
    loaded = thin(1e-3)
    loaded.load("tip", moment=moment)
    alone = ksd.solve(loaded, turn=0.2, method="conventional").forces["turn"]
    assert table["turn_moment_Nm"] == pytest.approx([alone], rel=1e-9)


def test_two_drives_walk_a_grid_or_together():
    scene = fourbar()
    scene.actuate("top", along="z", at=(0, 0.37, 0), name="side")
    grid = sweep(
        scene,
        {"top": [0.1, 0.2], "side": [0.0, 1e-4, 2e-4]},
        questions="force",
        method="conventional",
        **QUIET,
    )
    assert len(grid) == 6 and not grid.failures
    assert grid["top_mm"] == pytest.approx([100, 100, 100, 200, 200, 200])
    way = sweep(
        scene,
        {"top": [0.1, 0.2], "side": [0.0, 1e-4]},
        questions="force",
        method="conventional",
        together=True,
        **QUIET,
    )
    assert len(way) == 2 and way["side_mm"] == pytest.approx([0, 0.1])
    assert way["side_force_N"][1] == pytest.approx(grid["side_force_N"][4], rel=1e-6)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"questions": "colour"}, "not known"),
        ({"method": "magic"}, "choose one"),
        ({"lift": 0.1}, "not a drive"),
        ({"top": [np.nan]}, "finite"),
        ({"designs": {"a": [1]}}, "function"),
        ({"loads": {"x": [{"force": (1, 0, 0)}]}}, "link"),
        ({"modes": 0}, "modes"),
        ({"resume": "/no/such/folder/a.jsonl"}, "folder"),
    ],
)
def test_wrong_words_are_told_before_the_work(how, words):
    with pytest.raises(ksd.SceneError, match=words):
        sweep(fourbar(), **{"top": 0.1, **QUIET, **how})


def test_threads_and_processes_give_the_same_rows():
    how = {
        "designs": {"thickness": [8e-4, 1e-3]},
        "questions": ("force", "frequencies"),
        "turn": [0.2, 0.4],
        **QUIET,
    }
    here = sweep(thin, method="full", **how)
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        there = sweep(thin, method="full", executor=pool, **how)
    context = __import__("multiprocessing").get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(1, mp_context=context) as pool:
        away = sweep(thin, method="full", executor=pool, **how)
    for other in (there, away):
        assert other.columns.keys() == here.columns.keys() and other["status"] == here["status"]
        for column in ("turn_moment_Nm", "first_parasitic_Hz"):
            assert other[column] == pytest.approx(here[column], rel=1e-12)


def test_dask_cluster():
    distributed = pytest.importorskip(
        "distributed", reason="dask is not installed: pip install '.[distributed]'"
    )
    local = distributed.LocalCluster(n_workers=1, threads_per_worker=1, dashboard_address=None)
    with local as cluster, distributed.Client(cluster) as client:
        table = sweep(
            thin, designs={"thickness": [8e-4, 1e-3]}, questions="force", method="full", turn=[0.2],
            executor=client.get_executor(), **QUIET,
        )  # fmt: skip
    assert len(table) == 2 and not table.failures


class Impatient(ksd.Solver):
    """Presses Ctrl-C where the second line begins: a line of two poses is two solves, the farthest first."""

    count = 0

    def __call__(self, *values, **options):
        Impatient.count += 1
        if Impatient.count == 3:
            raise KeyboardInterrupt
        return super().__call__(*values, **options)


def test_interrupted_sweep_keeps_its_rows_and_goes_on(tmp_path, monkeypatch):
    how = {
        "designs": {"thickness": [8e-4, 1e-3]},
        "questions": "force",
        "method": "full",
        "turn": [0.2, 0.4],
        **QUIET,
    }
    kept = tmp_path / "sweep.jsonl"
    monkeypatch.setattr("ksd.study.sweep_path.Solver", Impatient)
    with pytest.raises(KeyboardInterrupt) as stop:
        sweep(thin, resume=kept, **how)
    table = stop.value.table
    assert [s == "ok" for s in table["status"]] == [True, True, False, False]
    assert "not reached" in table["status"][2] and "resume" in str(stop.value)
    Impatient.count = 10
    whole = sweep(thin, resume=kept, **how)
    assert Impatient.count == 12, "only the line missing"
    assert not whole.failures and whole["turn_moment_Nm"][:2] == pytest.approx(table["turn_moment_Nm"][:2])
    with pytest.raises(ksd.SceneError, match="another sweep"):
        sweep(thin, resume=kept, **{**how, "turn": [0.3]})
    kept.write_text(kept.read_text()[:-30])
    again = sweep(thin, resume=kept, **how)
    assert Impatient.count == 14 and again.columns["turn_moment_Nm"] == whole.columns["turn_moment_Nm"]


def test_exports(stroke, tmp_path):
    from scipy.io import loadmat

    with open(stroke.to_csv(tmp_path / "a.csv"), newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 11 and float(rows[-1]["top_force_N"]) == stroke["top_force_N"][-1]
    assert "-0.0" not in {value for row in rows for value in row.values()}
    assert write_csv(tmp_path / "b.csv", "ab", [(-0.0, "-0.0")]).read_text().split() == ["a,b", "0.0,-0.0"]
    columns, about = read_columns(stroke.to_hdf5(tmp_path / "a.h5"))
    assert list(columns) == list(stroke.columns) and about["name"] == "fourbar"
    assert np.array_equal(columns["support_z_N_per_m"], stroke["support_z_N_per_m"])
    assert columns["stress_leaf"] == stroke["stress_leaf"]
    found = loadmat(stroke.to_mat(tmp_path / "a.mat"))["sweep"]
    assert found["first_parasitic_Hz"][0, 0].ravel() == pytest.approx(stroke["first_parasitic_Hz"])
    with pytest.raises(ksd.SceneError, match="folder"):
        stroke.to_csv(tmp_path / "no" / "a.csv")
    assert pickle.loads(pickle.dumps(stroke)).columns.keys() == stroke.columns.keys()


def test_xarray(stroke):
    try:
        import xarray  # noqa: F401
    except ImportError:
        with pytest.raises(ksd.SceneError, match="pip install xarray"):
            stroke.to_xarray()
        return
    assert stroke.to_xarray()["top_force_N"].sizes["row"] == 11


@pytest.mark.parametrize("method", ["reduced", "full"])
def test_a_stroke_with_all_standard_questions(method):
    """31 poses, every question answered at every pose (their time: benchmarks)."""
    table = sweep(fourbar(), method=method, top=np.linspace(0, 0.3, 31), **QUIET)
    assert not table.failures and len(table) == 31
    for column in ("top_force_N", "support_z_N_per_m", "first_parasitic_Hz", "strain_energy_J"):
        assert np.all(np.isfinite(table[column])), column


def test_error_figures_of_a_fast_method():
    """Every question of `reduced`, which its error estimate brings next to `full` or there, against that."""
    at = {"top": np.array([0.0, 0.15, 0.28])}
    exact = sweep(fourbar(), method="full", questions=ALL_QUESTIONS, **at, **QUIET)
    assert not [c for c in exact.columns if c.endswith("_error_percent")]
    for relinearisations in (0, 1):
        fast = sweep(
            fourbar(),
            method="reduced",
            relinearisations=relinearisations,
            questions=ALL_QUESTIONS,
            errors=True,
            **at,
            **QUIET,
        )
        for question, column in (
            ("force", "top_force_N"), ("drive_stiffness", "top_stiffness_N_per_m"), ("energy", "strain_energy_J"),
            ("frequencies", "intended_Hz"), ("support_stiffness", "support_rz_Nm_per_rad"), ("stress", "stress_MPa"),
        ):  # fmt: skip
            told = fast[f"{question}_error_percent"]
            true = 100 * np.abs(fast[column] / np.where(exact[column] == 0, 1, exact[column]) - 1)
            assert told[0] == pytest.approx(0, abs=1e-6)
            # the worst of its columns, to first order
            assert np.all(told[1:] > 0.6 * true[1:] - 1e-6)
            assert (told[2] > 0 or question == "energy") and told[2] < 0.1


def test_a_question_with_its_error_figure():
    solve = ksd.prepare(fourbar())
    fast, exact = (solve(top=0.2, method=m, estimate=False) for m in ("reduced", "full"))
    value, error = fast.with_error(lambda pose: pose.drive_stiffness()["top"])
    assert error == pytest.approx(abs(value - exact.drive_stiffness()["top"]), rel=0.1)
    stresses, errors = fast.with_error(
        lambda pose: {n: s.largest_Pa for n, s in pose.stress().leaves.items()}
    )
    assert errors.keys() == stresses.keys() and max(errors.values()) > 0
    finer = ksd.solve(fourbar(), top=0.2, method="full", mesh=ksd.Mesh(orders=(8, 7, 12), points=16))
    for question in (lambda p: p.stress().largest_Pa, lambda p: p.stiffness("top").support("rz")):
        value, error = exact.with_error(question)
        assert error == pytest.approx(abs(value - question(finer)), rel=0.3) and 0 < error < 1e-3 * value


QUESTIONS = {
    "drive stiffness": lambda p: p.drive_stiffness()["top"],
    "frequencies": lambda p: p.frequencies(count=3, freed="top").frequency_Hz,
    "stress": lambda p: p.stress().largest_Pa,
    "buckling": lambda p: p.buckling().positive,
    "energy": lambda p: sum(p.strain_energy().values()),
}


@pytest.mark.parametrize("name", QUESTIONS)
@pytest.mark.parametrize("method", ["full", "reduced"])
def test_the_error_of_a_question_is_against_the_truth(name, method):
    """Chains of four elements, whose mesh is most of the error of `full`: told none."""
    coarse = ksd.solve(
        fourbar(), top=0.2, method=method, mesh=ksd.Mesh("corotational", elements=4), strict=False
    )
    finer = ksd.solve(fourbar(), top=0.2, method="full", mesh=ksd.Mesh(orders=(8, 7, 12), points=16))
    value, error = coarse.with_error(QUESTIONS[name])
    true = np.abs(value - QUESTIONS[name](finer))
    assert error == pytest.approx(true, rel=0.05, abs=1e-6 * np.max(np.abs(value)))
    assert np.max(true / np.abs(value)) > 5e-4


def test_printed_table_fits_the_terminal(stroke):
    lines = str(stroke).splitlines()
    assert max(map(len, lines)) <= 120 and "[N/m]" in str(stroke)


def test_pool_by_default_in_a_script(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(
        "import numpy as np, ksd\nfrom scenes import cross_flexure, single_joint\n"
        "if __name__ == '__main__':\n"
        "    t = ksd.sweep(lambda t: single_joint(cross_flexure(thickness=t)), designs={'t': [8e-4, 1e-3]},\n"
        "                  questions='force', turn=np.linspace(0, 0.5, 101), method='full', progress=False)\n"
        "    print(len(t), len(t.failures))\n"
    )
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, cwd=ROOT,
        env=environment(ROOT / "tests"),
    )  # fmt: skip
    assert done.stdout.split() == ["202", "0"], done.stderr


def test_a_sweep_raises_the_curvature_modes_as_solve_does():
    mechanism, targets, _ = ksd.load_scene(ROOT / "ksd/scenes/arm.toml")
    share = np.array([0.5, 1.0])
    values = {name: share * value for name, value in targets.items()}
    table = sweep(mechanism, values, together=True, questions="force", **QUIET)
    assert not table.failures and not any("curvature modes" in said for said in table["warnings"])
    alone = ksd.solve(mechanism, targets)
    assert table["x_force_N"][1] == pytest.approx(alone.forces["x"], rel=1e-6)
    # a mesh that is asked for stays
    for method in (None, "conventional"):
        words = {"questions": "force", "mesh": ksd.Mesh(), "method": method}
        assert "curvature modes" in sweep(mechanism, values, together=True, **words, **QUIET)["warnings"][1]


def test_a_sweep_raises_the_curvature_modes_for_its_nearest_pose_too():
    """A strip stretched by cold at rest, slack at the end of the stroke: its clamps bend it within 4 of 100 mm."""
    scene = ksd.Mechanism("strip")
    tip = scene.link("tip")
    steel = ksd.Material(E=200e9, G=77e9, expansion=12e-6)
    strip = {"section": ksd.rectangle(3e-4, 0.01), "material": steel, "width_axis": "z"}
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), **strip)
    scene.load(tip, force=(0, 0.3, 0), at=(0.1, 0, 0))
    scene.support(tip, about="z")
    scene.heat(-50)
    scene.actuate(tip, along="x", at=(0.1, 0, 0), name="slack")
    values = np.array([0.0, -60e-6])
    table = sweep(scene, slack=values, questions="support_stiffness", **QUIET)
    fine = [ksd.solve(scene, slack=v, mesh=ksd.Mesh(orders=(4, 3, 24), points=26)) for v in values]
    truth = [p.stiffness("tip", at=(0.1, 0, 0)).supports["y"] for p in fine]
    assert table["support_y_N_per_m"] == pytest.approx(truth, rel=2e-6)
    assert not any(table["warnings"])


def test_a_failure_says_how_far_it_came():
    failed = ksd.ConvergenceError("no\n equilibrium", reached=0.25)
    assert error_sentence(failed) == "no equilibrium (reached 25 % of the motion)"


def test_the_text_in_fingerprints_is_that_of_resume_files_written_before():
    recipe = sweep_path.Recipe(Questions(("stress",), detailed=True), method="full", with_verdict=False)
    assert recipe.fingerprint_text() == (
        "Recipe(asked=Asked(questions=('stress',), link=None, at=None, freed=None, modes=3, points=25, errors=False, "
        "every=True, usual=False), method='full', accuracy=None, relinearisations=0, mesh=None, extrapolate=False, "
        "effects=(), judged=False, strict=True)"
    )


def test_a_pose_without_answers_leaves_those_of_the_poses_behind_it_where_they_are(monkeypatch):
    values = [{"top": 1e-3 * d} for d in (50, 100, 150)]
    path = sweep_path.SweepPath(0, {}, fourbar().scene(), tuple(values))
    asked = Questions(("force", "drive_stiffness", "stress"), link="top")
    recipe = sweep_path.Recipe(asked, method="conventional", with_verdict=False)
    every, some = [], []
    sweep_path.run_path(path, recipe, None, every)
    solve = sweep_path._pose_or_reason

    def second_is_unstable(solver, target):
        pose, _ = solve(solver, target)
        pose = replace(pose, negatives=pose.negatives + 1) if target == values[1] else pose
        return pose, refusal(pose)

    monkeypatch.setattr(sweep_path, "_pose_or_reason", second_is_unstable)
    sweep_path.run_path(path, recipe, None, some)
    assert [row["status"] == "ok" for row in some] == [True, False, True]
    assert "UNSTABLE" in some[1]["status"]
    for one, other in zip(every[::2], some[::2], strict=True):
        assert one.keys() == other.keys() and one["stress_MPa"] == other["stress_MPa"]
        assert one["top_stiffness_N_per_m"] == pytest.approx(other["top_stiffness_N_per_m"], rel=1e-9)
    assert every[0]["stress_MPa"] < 0.8 * every[2]["stress_MPa"]
