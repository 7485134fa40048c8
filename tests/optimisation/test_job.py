"""A job's answers are those of sweeps, its slopes those of re-solves, its rows outlive it; bad input is told at once."""

import json
import pickle
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from scenes import STEEL, fourbar

import ksd
from ksd.library import find_record, write_record
from ksd.optimisation import design_log
from ksd.optimisation.design_log import DesignLog
from ksd.optimisation.scaled_problem import ScaledProblem
from ksd.study import sweep_path
from ksd.units import deg, mm

VARY = {
    "length": (40 * mm, 120 * mm), "angle": (31 * deg, 59 * deg), "thickness": (0.2 * mm, 1 * mm),
    "inner": (10 * mm, 60 * mm), "outer": (4 * mm, 30 * mm),
}  # fmt: skip
BEST = {
    "length": 80 * mm,
    "angle": 41.6407 * deg,
    "thickness": 0.626876 * mm,
    "inner": 43.975 * mm,
    "outer": 13.0123 * mm,
}
GOALS = {"support_worst_N_per_m": 1e6, "support_worst_Nm_per_rad": 300}
TURNS = np.array([0, 15, 30]) * deg


def pivot(length, angle, thickness, inner, outer):
    """A cross flexure about the origin, its turn driven."""
    joint = ksd.CrossFlexure(STEEL, length=length, angle=angle, thickness=thickness, widths=(inner, outer))
    scene = ksd.Mechanism("pivot")
    arm = scene.link("arm")
    at = (-0.5 * joint.length_AB, 0, 0)
    scene.actuate_joint(
        scene.join(scene.ground, arm, joint, at=at, axis="z", toward="x", name="hinge"), name="turn"
    )
    return scene


def wide(p):
    return 70 * mm - p["inner"] - 2 * p["outer"]


def job(**changes):
    words = {
        "vary": VARY, "maximise": GOALS, "limits": {"stress_MPa": 500, "turn_moment_Nm": (-3, 3)}, "link": "arm",
        "at": (0, 0, 0), "rules": [wide], "turn": TURNS, **changes,
    }  # fmt: skip
    return ksd.Job(words.pop("function", pivot), **words)


def taut(thickness):
    """A leaf spring held at both ends in its length, moved across: it bends next to its clamps alone."""
    scene = ksd.Mechanism("taut", plane="xy")
    body, at = scene.link("body"), (0.1, 0, 0)
    scene.leaf(
        "ground", body, start=(0, 0, 0), end=at, section=ksd.rectangle(thickness, 0.01), material=STEEL
    )
    scene.support(body, along="x", at=at)
    scene.support(body, about="z")
    scene.actuate(body, along="y", at=at, name="across")
    return scene


def test_a_job_has_the_curvature_modes_that_a_solve_has():
    """Its stress was 21 % off that of the same pose by ksd.solve, in silence."""
    words = {
        "vary": {"thickness": (0.1 * mm, 0.3 * mm)}, "minimise": "stress_MPa", "limits": {"across_force_N": 30},
        "across": 5 * mm,
    }  # fmt: skip
    job, solved = ksd.Job(taut, **words), ksd.solve(taut(0.2 * mm), across=5 * mm)
    stress, force = job.values([0.2 * mm])
    assert stress == pytest.approx(1e-6 * solved.stress().largest_Pa, rel=1e-9)
    assert force == pytest.approx(solved.forces["across"], rel=1e-9) and not job.few_modes([0.2 * mm])
    # those of a mesh that is given stay, and it is told that they are few
    coarse = ksd.Job(taut, mesh=ksd.Mesh(orders=(4, 3, 9), points=10), **words)
    assert coarse.values([0.2 * mm])[0] > 1.05 * stress
    best = ksd.optimise(coarse)
    said = "the curvature modes {} are few for this state: raise the orders of the mesh"
    assert said.format((4, 3, 9)) in coarse.few_modes([0.2 * mm]) and said.format((4, 3, 9)) in str(best)
    # where a leaf spring is not resolved at all, ksd.solve refuses the pose, and so does the job
    refused = ksd.Job(taut, mesh=ksd.Mesh(), **words).batch([[0.2 * mm]])
    with pytest.raises(ksd.TrustError) as why:
        ksd.solve(taut(0.2 * mm), across=5 * mm, mesh=ksd.Mesh())
    assert refused.status == (str(why.value),) and said.format((4, 3, 6)) in refused.status[0]
    assert np.isnan(refused.values).all()


def test_a_design_that_is_not_stable_has_no_answers():
    """A straight column beyond its Euler load is in equilibrium, and would not stay."""

    def column(load):
        scene = ksd.Mechanism("column", plane="xy")
        tip = scene.link("tip")
        blade = ksd.rectangle(0.5 * mm, 10 * mm)
        scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=blade, material=STEEL)
        scene.load(tip, force=(-load, 0, 0), at=(0.1, 0, 0))
        scene.actuate(tip, about="z", name="turn")
        return scene

    euler = np.pi**2 * STEEL.E * 10 * mm * (0.5 * mm) ** 3 / 12 / 0.1**2
    job = ksd.Job(column, vary={"load": (0.1 * euler, 1.5 * euler)}, limits={"stress_MPa": 500}, turn=0.0)
    judged = job.batch([[0.9 * euler], [1.1 * euler]])
    assert judged.status[0] == "ok" and judged.status[1].startswith("not to be trusted: UNSTABLE")
    assert np.isfinite(judged.values[0]).all() and np.isnan(judged.values[1]).all()


@pytest.fixture(scope="module")
def plain():
    return job()


def test_answers_are_those_of_a_sweep_and_the_worst_counts(plain):
    x = plain.point(BEST)
    found = dict(zip(plain.names, plain.values(x), strict=True))
    table = ksd.sweep(pivot, turn=TURNS, designs=[BEST], questions=("force", "support_stiffness", "stress"), link="arm",
                      at=(0, 0, 0), method="full", progress=False)  # fmt: skip
    for n, row in enumerate(table.rows()):
        label = f" at turn {('0', '15.00', '30.00')[n]} deg"
        for column in (*GOALS, "turn_moment_Nm"):
            assert found[column + label] == pytest.approx(row[column], rel=1e-6, abs=1e-12)
        own = {
            name: v for name, v in found.items() if name.startswith("stress_MPa[") and name.endswith(label)
        }
        assert max(own.values()) == pytest.approx(row["stress_MPa"], rel=1e-6, abs=1e-9) and len(own) == 3
    # specification: the optimum of this job, held by stress
    values = np.array(list(found.values()))
    assert plain.merit(values) == pytest.approx(0.50356647, rel=2e-5)
    margins = plain.margins(values)
    assert len(margins) == 9 + 2 * 3 and margins.min() == pytest.approx(0, abs=1e-5)
    assert plain.rule_values(x)[0] == pytest.approx(0, abs=1e-6)
    assert "maximise support_worst_N_per_m, maximise support_worst_Nm_per_rad by" in str(
        plain
    ) and "stress_MPa at most 500" in str(plain)


def test_slopes_are_those_of_solves_beside(plain):
    x = plain.point(
        {"length": 70 * mm, "angle": 40 * deg, "thickness": 0.4 * mm, "inner": 30 * mm, "outer": 15 * mm}
    )
    values, slopes = plain.slopes(x)
    turned = np.array([a.pose != 0 for a in plain.answers])
    assert values[turned] == pytest.approx(plain.values(x)[turned], rel=1e-7)
    # about the axis of the drive that holds it nothing moves: the third principal stiffness
    held = np.isinf(values)
    assert [a.column for a, h in zip(plain.answers, held, strict=True) if h] == [
        "support_worst_Nm_per_rad[3]"
    ] * 3
    assert not slopes[held].any()
    turned &= ~held
    for k in (1, 2):
        step = 1e-5 * x[k] * (np.arange(5) == k)
        pair = plain.batch([x + step, x - step]).values
        wanted = (pair[0][turned] - pair[1][turned]) / (2 * step[k])
        assert slopes[turned, k] == pytest.approx(wanted, rel=2e-5)


@pytest.mark.parametrize("method", ["full", "reduced", "conventional"])
def test_slopes_are_gradients_at_the_equilibria_of_values(method, monkeypatch):
    loads = {"empty": [], "payload": [{"link": "arm", "force": (0, 0, -20.0), "at": (0.1, 0, 0)}]}
    asked = job(method=method, loads=loads)
    x = asked.point(BEST) * 0.99
    words = {
        "link": "arm",
        "at": (0, 0, 0),
        "loads": loads,
        "method": method,
        "mesh": ksd.Mesh(),
        "turn": TURNS,
    }
    found = ksd.gradient(pivot, asked.design_at(x), questions=asked.questions.names, **words)
    alone = np.nan_to_num([found.slopes[found.columns.index(a.column), :, a.pose] for a in asked.answers])
    asked.values(x)
    honest, solved = ksd.Job._solve_batch, []

    def beside(self, X):
        solved.append(X)
        found = honest(self, X)
        # another thread asks in between
        self.__dict__["last_solved"] = b"another", []
        return found

    monkeypatch.setattr(ksd.Job, "_solve_batch", beside)
    slopes = asked.slopes(x)[1] * x
    assert not solved
    most = np.abs(alone * x).max(axis=1, keepdims=True)
    # rounding alone at rest
    assert (np.abs(slopes - alone * x) <= 1e-6 * np.maximum(most, 1e-6)).all()
    assert pickle.loads(pickle.dumps(job())).last_solved is None
    # of another design than the last
    found = ksd.gradient(pivot, asked.design_at(x * 0.99), questions="force", **words)
    slopes = dict(zip(asked.names, asked.slopes(x * 0.99)[1], strict=True))
    assert len(solved) == 1
    for n, turn in enumerate(("0", "15.00", "30.00")):
        own = slopes[f"turn_moment_Nm at payload, turn {turn} deg"]
        assert own * x == pytest.approx(found.slopes[0, :, 3 + n] * x, rel=1e-6, abs=1e-6)


def test_forces_of_reduced_jobs_are_of_the_equilibrium_their_slopes_are_of():
    """Under a load that bends the leaf springs otherwise than their records know, `reduced` is some per cent off."""
    words = {"loads": {"payload": [{"link": "arm", "force": (30.0, 0, -20.0), "at": (0.1, 0.05, 0.2)}]}}
    fast, full = (job(method=method, **words) for method in ("reduced", "full"))
    x = fast.point(BEST)
    (values,), (same,) = fast.batch([x]).values, full.batch([x]).values
    assert values == pytest.approx(same, rel=1e-6, abs=1e-6)
    own = ksd.batch(
        fast.scene_at(fast.design_at(x), "payload"), method="reduced", questions="force", turn=TURNS
    )["turn_moment_Nm"][0]
    k = [fast.names.index(f"turn_moment_Nm at payload, turn {turn} deg") for turn in ("15.00", "30.00")]
    assert np.abs(own[1:] / values[k] - 1).max() > 1e-3
    assert values[k] == pytest.approx(fast.slopes(x)[0][k], rel=1e-9)


def test_a_design_is_drawn_once_for_rules_answers_and_slopes():
    drawn = []

    def counted(**parameters):
        drawn.append(parameters)
        return pivot(**parameters)

    asked = job(function=counted)
    problem = ScaledProblem(asked, DesignLog(asked), "")
    assert asked.coupled_ranges and len(problem.rule_scales) == 2
    y = problem.scaled(asked.point(BEST)) - 0.01
    drawn.clear()
    problem.margins(y)
    slopes = problem.slopes(y)[-1]
    assert len(drawn) == 1 + 2 * len(BEST)
    # inner over outer width within its trained range, by the parameters in logarithms
    for k in range(len(y)):
        ends = [problem.margins(y + s * (np.arange(len(y)) == k))[-1] for s in (1e-4, -1e-4)]
        assert slopes[k] == pytest.approx((ends[0] - ends[1]) / 2e-4, rel=1e-6, abs=1e-9)
    again = pickle.loads(pickle.dumps(job().build))
    assert again(**BEST).fingerprint() == pivot(**BEST).scene().fingerprint()


def test_loads_size_and_conventional_poses():
    small = {"vary": {"thickness": (0.3 * mm, 0.5 * mm)}, "rules": ()}

    def of(thickness):
        return pivot(70 * mm, 40 * deg, thickness, 30 * mm, 15 * mm)

    loads = {"empty": [], "payload": [{"link": "arm", "force": (0, 0, -20.0), "at": (0.1, 0, 0)}]}
    limits = {"size_mm": (None, 60, None), "stress_MPa": 500}
    words = {**small, "function": of, "loads": loads, "limits": limits, "maximise": "support_worst_N_per_m"}
    many, alone = job(**words), job(**words, method="conventional")
    assert many.answers[0].name == "support_worst_N_per_m at empty, turn 0 deg" and len(many.poses) == 6
    one, other = many.values([0.4 * mm]), alone.values([0.4 * mm])
    assert one == pytest.approx(other, rel=1e-5, abs=1e-9)
    names = list(many.names)
    k = names.index("stress_MPa[hinge/inner] at payload, turn 30.00 deg")
    assert one[k] != pytest.approx(one[names.index(names[k].replace("payload", "empty"))], rel=1e-3)
    scene = of(0.4 * mm)
    scene.load("arm", force=(0, 0, -20.0), at=(0.1, 0, 0))
    poses = [ksd.solve(s, turn=t, method="full").extent() for s in (of(0.4 * mm), scene) for t in TURNS]
    high, low = max(p[1, 1] for p in poses), min(p[0, 1] for p in poses)
    assert one[names.index("size_y_mm")] == pytest.approx(1e3 * (high - low), rel=1e-6)
    slope, h = many.jacobian([0.4 * mm])[names.index("size_y_mm"), 0], 1e-7
    pair = [many.values([0.4 * mm + s * h])[names.index("size_y_mm")] for s in (1, -1)]
    assert slope == pytest.approx((pair[0] - pair[1]) / (2 * h), rel=1e-4)


def test_designs_that_fail_are_rows_with_the_reason_and_replayed(tmp_path, monkeypatch, plain):
    file = tmp_path / "pivot.jsonl"
    log = DesignLog(plain, resume=file)
    good = plain.point(BEST)
    bad = good * (1, 1, 1, 1, 20)
    judged = log.batch([good, bad], by="me")
    assert judged.status[0] == "ok" and "width_ratio" in judged.status[1]
    assert not np.isnan(judged.values[0]).any() and np.isnan(judged.values[1]).all()
    slopes = log.slopes(good)
    with pytest.raises(ksd.KsdError, match="width_ratio"):
        log.slopes(bad)
    lines = file.read_text().splitlines()
    assert len(lines) == 4 and json.loads(lines[1].partition(" ")[2])["rows"][0]["by"] == "me"
    # a kill in the middle of a line costs that line alone
    file.write_text("\n".join(lines[:-1]) + "\n" + lines[-1][:40])
    counted = []
    again = DesignLog(job(), resume=file)
    monkeypatch.setattr(ksd.Job, "batch", lambda *a, **k: counted.append(a))
    same = again.batch([good, bad])
    assert np.array_equal(same.values, judged.values, equal_nan=True) and same.status == judged.status
    assert not counted and len(again.rows) == 2 and again.table()["thickness"][0] == good[2]
    again_slopes = again.slopes(good)
    assert all(np.array_equal(a, b) for a, b in zip(again_slopes, slopes, strict=True))
    with pytest.raises(ksd.SceneError, match="belongs to another job"):
        DesignLog(job(turn=[0.1]), resume=file)


def test_slopes_at_the_edge_of_what_can_be_built(tmp_path):
    """There are no designs on one side: differences are those of the other one; a design that cannot be built has none."""

    def edge(length, thickness):
        if length > 70 * mm:
            raise ValueError("longer than the stock")
        return pivot(length, 40 * deg, thickness, 30 * mm, 15 * mm)

    words = {
        "function": edge, "rules": [], "turn": 0.3,
        "vary": {"length": (40 * mm, 80 * mm), "thickness": (0.3 * mm, 0.8 * mm)},
    }  # fmt: skip
    asked, path = job(**words), tmp_path / "job.jsonl"
    whole = job(
        **{
            **words,
            "function": lambda length, thickness: pivot(length, 40 * deg, thickness, 30 * mm, 15 * mm),
        }
    )
    first, x = DesignLog(asked, resume=path), np.array([70 * mm, 0.5 * mm])
    (_, slopes), (values, free) = first.slopes(x), whole.slopes(x)
    finite = np.isfinite(values)
    assert np.abs((slopes - free) * x)[finite] == pytest.approx(
        0.0, abs=1e-3 * np.abs(free * x).max(initial=1.0)
    )
    assert slopes[finite] == pytest.approx(free[finite], rel=2e-3)
    with pytest.raises(ksd.KsdError, match=r"no gradient: .*longer than the stock"):
        first.slopes(1.1 * x)
    known = DesignLog(asked, resume=path).batch([x, 1.1 * x])
    assert known.status[0] == "ok" and known.values[0] == pytest.approx(asked.values(x), rel=1e-12)
    assert "longer than the stock" in known.status[1] and np.isnan(known.values[1]).all()


def test_where_there_is_no_gradient_the_printout_says_so(tmp_path):
    """The function of one design alone: a method without derivatives ends there, and nothing holds it."""

    def only(length, thickness):
        if abs(length - 60 * mm) > 1e-9 or abs(thickness - 0.5 * mm) > 1e-9:
            raise KeyError("stock")
        return pivot(length, 40 * deg, thickness, 30 * mm, 15 * mm)

    asked = job(
        function=only,
        rules=[],
        turn=0.3,
        vary={"length": (50 * mm, 70 * mm), "thickness": (0.3 * mm, 0.7 * mm)},
    )
    best = ksd.optimise(asked, start=[60 * mm, 0.5 * mm], method="cobyla")
    said = "there is no gradient at this design"
    assert not best.held and said in str(best) and said in best.report(tmp_path / "p.html").read_text()
    assert best.status == "stopped"
    assert any("cannot be built: KeyError: 'stock'" in row["status"] for row in best.table.rows())


def test_poses_beyond_one_that_fails_are_not_solved():
    """Each was followed to its limit points by arc length: 7 s for a design without answers."""

    def solved(turn):
        own, poses = job(method="conventional", turn=turn), []
        with pytest.MonkeyPatch.context() as patch:
            judge = sweep_path.PathSolver.judge
            patch.setattr(
                sweep_path.PathSolver, "judge", lambda self, v: poses.append(v["turn"]) or judge(self, v)
            )
            status = own.batch(own.point(None)).status[0]
        return poses, status

    poses, status = solved([0.0, 9.0, 0.1, 0.2])
    assert poses == [0.0, 9.0] and status != "ok"
    assert solved([0.0, 0.1, 0.2]) == ([0.0, 0.1, 0.2], "ok")


def test_ctrl_c_keeps_the_blocks_that_are_done(tmp_path, monkeypatch, plain):
    monkeypatch.setattr(design_log, "BLOCK_SIZE", 2)
    honest, calls = ksd.Job.batch, []

    def interrupted(self, X, **how):
        calls.append(len(X))
        if len(calls) == 2:
            raise KeyboardInterrupt
        return honest(self, X, **how)

    monkeypatch.setattr(ksd.Job, "batch", interrupted)
    X = plain.random(3)
    log = DesignLog(plain, resume=tmp_path / "rows.jsonl")
    with pytest.raises(KeyboardInterrupt):
        log.batch(X)
    assert len(DesignLog(plain, resume=tmp_path / "rows.jsonl").file.entries) == 2


def test_trained_ranges_are_bounds_or_rules():
    found = job(vary={**VARY, "angle": (10 * deg, 59 * deg)})
    assert found.bounds[1] == pytest.approx((30 * deg, 59 * deg), rel=1e-9)
    assert "angle" in found.bound_reasons["angle", "least"] and ("angle", "most") not in found.bound_reasons
    assert found.rule_names == ("'wide'", "width_ratio of cross_flexure 'hinge'")
    x = found.random(1)[0]
    assert found.rule_values(x)[1] > 0 > found.rule_values(x * (1, 1, 1, 1, 20))[1]
    free = job(vary={**VARY, "angle": (10 * deg, 59 * deg)}, method="conventional")
    assert free.bounds[1, 0] == pytest.approx(10 * deg) and free.rule_names == ("'wide'",)


def failing(thickness):
    raise ksd.SceneError(f"no sheet is {thickness} thick")


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"maximise": {"support_wurst_N_per_m": 1}}, 'did you mean "support_worst_N_per_m"?'),
        ({"limits": {"stress_Mpa": 500}}, "there is no answer 'stress_Mpa'"),
        ({"vary": {**VARY, "thicknes": (1e-4, 1e-3)}}, "vary: pivot has no parameter 'thicknes'"),
        ({"vary": {"length": (0.04, 0.12)}}, "vary: parameter 'angle' of pivot has no value in {'length': (0.04,"),
        ({"vary": {**VARY, "angle": (0.6, 0.6)}}, "holds no design"),
        ({"vary": {**VARY, "angle": 0.6}}, "give (least, most)"),
        ({"vary": {}}, "vary: give least and most"),
        ({"vary": {**VARY, "angle": (1 * deg, 9 * deg)}}, "angle of cross_flexure 'hinge'; vary it within"),
        ({"rules": [lambda p: p["iner"]]}, "no parameter 'iner'; did you mean \"inner\"?"),
        ({"rules": [lambda p: -1.0]}, "rule 1 is met by none of"),
        ({"rules": [lambda p: p["inner"], lambda p: p["width"]]}, "rule 2 gives no number: no parameter 'width'"),
        ({"rules": [lambda p: p["inner"] < 0.02]}, "rule 1 gives no number: it is False; in place of a < b give b - a"),
        ({"rules": [lambda p: p.inner]}, "rule 1 gives no number: 'dict' object has no attribute 'inner'"),
        ({"rules": [lambda p: [][0]]}, "rule 1 gives no number: list index out of range"),
        ({"rules": [lambda p: 0.08 - p["length"], lambda p: p["length"] - 0.09]}, "all rules are met together by none of"),
        ({"rules": "wide"}, "give functions of the parameters"),
        ({"turn": None}, "drive values turn"),
        ({"turm": [0.1]}, "'turm' is not a drive"),
        ({"function": failing, "vary": {"thickness": (1e-4, 1e-3)}}, "no design within the bounds could be built"),
        ({"function": fourbar()}, "a job needs a function"),
        ({"maximise": 3.0}, "maximise = 3.0: give a column, several"),
        ({"maximise": [["support_z_N_per_m"]]}, "give a column, several"),
        ({"minimise": "stress_MPa"}, "give one of maximise and minimise"),
        ({"maximise": {"support_z_N_per_m": 0.0}}, "its scale must be positive"),
        ({"limits": {"stress_MPa": (500, 100)}}, "the least must be below the most"),
        ({"limits": {"stress_MPa": (None, None)}}, "give the most, or (least, most)"),
        ({"limits": {"size_mm": 80}}, "give the most along x, y and z"),
        ({"limits": {"size_mm": (None, None, None)}}, "give the most along x, y and z"),
        ({"link": "leg", "loads": {"p": [{"link": "leg", "force": (0, 0, 1), "at": (0, 0, 0)}]}}, "acts on link 'leg'"),
        ({"method": "modal"}, "method = 'modal': choose one of"),
        ({"link": "arn"}, "link = 'arn': there is no such link in 'pivot'; did you mean \"arm\"?"),
        ({"freed": "turm"}, "freed = 'turm': there is no such drive or support in 'pivot'; did you mean \"turn\"?"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_before_a_solve(changes, sentence):
    with pytest.raises(ksd.SceneError) as told:
        job(**changes)
    assert sentence in str(told.value), told.value


def test_designs_within_the_rules_that_cannot_be_built_are_told():
    count = 0

    def late(**parameters):
        nonlocal count
        count += 1
        if count > 500:
            raise ValueError("no steel is left")
        return pivot(**parameters)

    own = job(function=late)
    count = 500
    with pytest.raises(ksd.SceneError, match=r"within the bounds and rules could be built.*no steel is left"):
        own.random(1, seed=3)


def stocked(length, thickness):
    """A pivot of sheet that is on stock, which is not that in the middle of the bounds."""
    if thickness >= 0.4 * mm:
        # as of an assert, which pytest would rewrite
        raise AssertionError
    if length > 60 * mm:
        raise RuntimeError("too long for the machine")
    return pivot(length, 40 * deg, thickness, 30 * mm, 15 * mm)


def test_starts_can_be_built_where_a_function_refuses_the_middle_of_the_bounds():
    """Functions refuse designs by assert and RuntimeError too."""
    words = {
        "function": stocked, "rules": [], "turn": 0.3, "maximise": "turn_stiffness_Nm_per_rad",
        "limits": {"stress_MPa": 200},
    }  # fmt: skip
    thickness = (0.3 * mm, 0.8 * mm)
    one = job(vary={"length": (40 * mm, 90 * mm), "thickness": thickness}, **words)
    assert all(length <= 60 * mm and thickness < 0.4 * mm for length, thickness in one.random(8))
    answers = one.batch([one.point(None), [70 * mm, 0.35 * mm], [50 * mm, 0.5 * mm]])
    assert answers.status[0] == "ok" and answers.status[1].endswith("too long for the machine")
    assert answers.status[2] == "this design cannot be built: AssertionError"
    best = ksd.optimise(job(vary={"length": (40 * mm, 55 * mm), "thickness": thickness}, **words))
    assert best.starts[0].status == "ok" and best.design["length"] == pytest.approx(55 * mm)


def sheets(count, thickness):
    """So many leaf springs side by side."""
    scene = ksd.Mechanism("sheets")
    body = scene.link("body")
    for k in range(round(count)):
        start, end = (0.02 * k, 0, 0), (0.02 * k, 0.06, 0)
        scene.leaf("ground", body, start=start, end=end, width_axis="z", section=ksd.rectangle(thickness, 0.02),
                   material=STEEL)  # fmt: skip
    scene.actuate(body, along="x", at=(0.02, 0.03, 0), name="push")
    return scene


def test_designs_of_other_leaf_springs_are_told_where_each_counts():
    """The stress of a leaf spring that the design in the middle does not have was left out in silence."""
    words = {"vary": {"count": (2, 5), "thickness": (0.2 * mm, 0.6 * mm)}, "push": 2 * mm}
    X = [[n, 0.3 * mm] for n in (4, 3, 5)]
    for goal in ({"minimise": "stress_MPa"}, {"limits": {"size_mm": (200, None, None)}}):
        own = ksd.Job(sheets, **goal, **words).batch(X)
        assert (
            own.status[0] == "ok" and "it has no leaf spring 'leaf.4': the stress and size" in own.status[1]
        )
        assert "it has an additional leaf spring 'leaf.5'" in own.status[2]
    force = ksd.Job(sheets, minimise="push_force_N", **words).batch(X)
    assert force.status == ("ok",) * 3 and np.ptp(force.values[:, 0] / (4, 3, 5)) < 1e-3 * force.values[0, 0]


def test_a_job_without_drives_and_starts_outside(plain):
    with pytest.raises(ksd.SceneError, match="a job needs drive values"):
        ksd.Job(pivot, vary=VARY, maximise="support_worst_N_per_m")
    for start, sentence in (
        ({**BEST, "angle": 1.2}, "angle = 1.200 lies outside 0.5411 to 1.030"),
        ({**BEST, "angel": 1.2}, '.angel. is not varied; did you mean "angle"'),
        ({"angle": 1.0}, "parameter 'length' has no value"),
        ([1.0, 2.0], "is 5 numbers: length, angle"),
    ):
        with pytest.raises(ksd.SceneError, match=sentence):
            plain.point(start)
    assert plain.names[0].startswith("support_worst_N_per_m") and plain.parameters == tuple(VARY)


def test_conventional_designs_go_to_the_executor_too():
    own = job(method="conventional", turn=TURNS[:2])
    X = own.random(3)

    class Counting(ThreadPoolExecutor):
        blocks = 0

        def submit(self, *said):
            self.blocks += 1
            return super().submit(*said)

    alone = own.batch(X)
    with Counting(2) as pool:
        found = own.batch(X, executor=pool)
        assert pool.blocks == 3
    assert np.array_equal(found.values, alone.values) and found.status == alone.status


def test_the_worst_target_is_spoken_by_its_column_where_it_has_no_scale(plain):
    assert plain.merit_spoken(0.5) == "worst target 0.500 of its scale"
    most = job(maximise="support_z_N_per_m")
    assert most.merit_spoken(1234.0, 2345.0, digits=4) == "worst support_z_N_per_m 1234 to 2345"
    least = job(maximise=(), minimise="turn_moment_Nm")
    assert least.merit_spoken(-0.5) == "worst turn_moment_Nm 0.500"
    assert least.merit_name == "worst turn_moment_Nm" and (least.merit_sign, most.merit_sign) == (-1.0, 1.0)
    two = job(maximise=("support_z_N_per_m", "support_x_N_per_m"))
    assert two.merit_spoken(0.5) == "worst target 0.500" and two.merit_name == "worst target"


def leaning(lean):
    """A drawn joint that no record is there for."""
    leaves = [
        ksd.Leaf(
            start=(0, side * 20 * mm, 0), end=(40 * mm, side * lean, 0), width_axis="z", material=STEEL, name=name,
            section=ksd.rectangle(0.2 * mm, 15 * mm),
        )
        for name, side in (("low", -1), ("high", 1))
    ]  # fmt: skip
    joint = ksd.DrawnJoint(
        "leaning", blocks={"A": (0, 0, 0), "B": (40 * mm, 0, 0)}, leaves=leaves,
        motions=[ksd.Motion("turn", "rotation", "z", (-0.2, 0.2))],
    )  # fmt: skip
    scene = ksd.Mechanism("leaning")
    arm = scene.link("arm")
    placed = scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="x")
    scene.actuate_joint(placed, name="turn")
    return scene


def strip(lean):
    """A leaf spring without any joint."""
    scene = ksd.Mechanism("strip")
    arm = scene.link("arm")
    scene.leaf(
        scene.ground, arm, start=(0, 0, 0), end=(40 * mm, lean, 0), section=ksd.rectangle(0.2 * mm, 15 * mm),
        material=STEEL, width_axis="z",
    )  # fmt: skip
    scene.actuate(arm, about="z", name="turn")
    return scene


def elastic(lean):
    """A pivot with a link that bends."""
    scene = pivot(60 * mm, 45 * deg, 0.3 * mm, 20 * mm, 10 * mm + lean)
    scene.compliance("arm", section=ksd.rectangle(5 * mm, 20 * mm), material=STEEL, hub=(80 * mm, 0, 0))
    return scene


def plated(lean):
    """A pivot whose leaf springs stiffen as plates."""
    scene = pivot(60 * mm, 45 * deg, 0.3 * mm, 20 * mm, 10 * mm + lean)
    scene.consider("plate")
    return scene


@pytest.mark.parametrize("function", [leaning, strip, elastic, plated])
def test_without_records_or_with_elastic_links_a_job_is_conventional(function, plain):
    assert plain.method == "full"
    own = ksd.Job(function, vary={"lean": (4 * mm, 8 * mm)}, turn=0.05, maximise="turn_stiffness_Nm_per_rad")
    swept = ksd.sweep(
        function, designs=[{"lean": 6 * mm}], turn=0.05, questions="drive_stiffness", progress=False
    )
    # plate stiffening is part of the leaf springs of every method
    assert own.method == ("full" if function is plated else "conventional")
    assert own.values([6 * mm])[0] == pytest.approx(swept["turn_stiffness_Nm_per_rad"][0], rel=1e-5)


def test_of_parasitic_motion_and_moments_that_are_minimised_the_size_counts():
    words = {"vary": {"lean": (4 * mm, 8 * mm)}, "link": "arm", "at": (60 * mm, 0, 0), "turn": [-0.05, 0.05]}
    goals = ("parasitic_x_mm", "parasitic_y_mm", "turn_moment_Nm")
    own, x = ksd.Job(leaning, minimise=goals, **words), [6 * mm]
    signed = ksd.Job(leaning, maximise=goals, **words)
    assert (signed.values(x) < 0).sum() >= 3
    assert own.values(x) == pytest.approx(np.abs(signed.values(x)))
    assert own.merit(own.values(x)) == pytest.approx(-np.abs(signed.values(x)).max())
    h = 1e-6
    expected = (own.values([6 * mm + h]) - own.values([6 * mm - h])) / (2 * h)
    assert own.jacobian(x)[:, 0] == pytest.approx(expected, rel=1e-4, abs=1e-6)
    assert own.merit_spoken(-0.25) == "worst target 0.250"
    scaled = ksd.Job(leaning, minimise={"parasitic_x_mm": 0.1, "turn_moment_Nm": 1.0}, **words)
    assert scaled.merit_spoken(-0.25) == "worst target 0.250 of its scale"


def test_a_limit_of_what_is_minimised_by_its_size_has_a_name_of_its_own():
    """A log keeps answers by name: both must come back as they are, and no file of sizes is one of signed numbers."""
    words = {"vary": {"lean": (4 * mm, 8 * mm)}, "turn": [-0.05]}
    own = ksd.Job(leaning, minimise="turn_moment_Nm", limits={"turn_moment_Nm": (-9, 9)}, **words)
    x, log = [6 * mm], DesignLog(own)
    assert len(set(own.names)) == 2
    size, signed = log.values(x)
    assert size == -signed > 0
    assert log.slopes(x)[1] == pytest.approx(own.jacobian(x), rel=1e-12)
    sizes, numbers = (
        ksd.Job(leaning, **{way: "turn_moment_Nm"}, **words) for way in ("minimise", "maximise")
    )
    assert sizes.names == numbers.names and sizes.fingerprint != numbers.fingerprint


class Leaner:
    """Draws mechanisms; what it keeps has names that a job uses too."""

    def __init__(self):
        self.function, self.maxsize, self.cached = strip, 1, None

    def __call__(self, lean):
        return self.function(lean)


def test_a_job_of_a_callable_object_leaves_its_attributes_to_it():
    words = {"vary": {"lean": (4 * mm, 8 * mm)}, "turn": 0.05, "maximise": "turn_stiffness_Nm_per_rad"}
    assert ksd.Job(Leaner(), **words).values([6 * mm]) == pytest.approx(
        ksd.Job(strip, **words).values([6 * mm])
    )


def test_poses_close_together_have_names_of_their_own():
    close = job(turn=[0.3, 0.3 + 1e-7, 0.3 + 2e-7], limits=None, method="conventional")
    assert len(set(close.names)) == len(close.names) and "17.1887339 deg" in close.names[0]
    x = close.point(BEST)
    log = DesignLog(close)
    # by equal names one would be taken for the other
    assert np.array_equal(log.values(x), close.values(x)) and len(set(log.values(x)[:9:3].tolist())) == 3


def test_kept_designs_of_other_joint_records_are_not_taken_for_those_of_these(tmp_path, monkeypatch, plain):
    file, words = tmp_path / "pivot.jsonl", {"questions": "force", "turn": [0.2], "progress": False}
    design = [{**BEST}]
    DesignLog(plain, resume=file).values(plain.point(BEST))
    ksd.sweep(pivot, designs=design, resume=tmp_path / "sweep.jsonl", **words)
    record = find_record("cross_flexure")
    write_record(replace(record, trained="2001-01-01"), tmp_path / "cross_flexure.h5")
    monkeypatch.setenv("KSD_DATABASE", str(tmp_path))
    with pytest.raises(ksd.SceneError, match=r"another job .* or joint records"):
        DesignLog(plain, resume=file)
    with pytest.raises(ksd.SceneError, match=r"another sweep .* or joint records"):
        ksd.sweep(pivot, designs=design, resume=tmp_path / "sweep.jsonl", **words)
    # what knows no records goes on
    free = job(method="conventional", turn=[0.2])
    DesignLog(free, resume=tmp_path / "free.jsonl").values(free.point(BEST))
    monkeypatch.delenv("KSD_DATABASE")
    assert len(DesignLog(free, resume=tmp_path / "free.jsonl").file.entries) == 1
    assert len(DesignLog(plain, resume=file).file.entries) == 1


def test_a_moment_needs_no_point():
    """It acts on the link as a whole; a force does not."""
    at = {"link": "arm", "moment": (0, 0, 0.1)}
    words = {"questions": "force", "turn": 0.2, "progress": False}
    free = ksd.sweep(pivot(**BEST), loads={"wind": at}, **words)
    somewhere = ksd.sweep(pivot(**BEST), loads={"wind": {**at, "at": (0.1, 0.2, 0.3)}}, **words)
    none = ksd.sweep(pivot(**BEST), **words)
    moments = [table["turn_moment_Nm"][0] for table in (free, somewhere, none)]
    assert moments[0] == pytest.approx(moments[1], rel=1e-12) and moments[2] - moments[0] == pytest.approx(
        0.1
    )
    with pytest.raises(
        ksd.SceneError, match=r"'wind 1': give at, the point .* of link 'arm' where the force acts"
    ):
        ksd.sweep(pivot(**BEST), loads={"wind": {"link": "arm", "force": (0, 1, 0)}}, **words)
