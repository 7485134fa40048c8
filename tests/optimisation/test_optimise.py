"""The optimum of a job: found from any start, held by what is said, at a price that moving a limit confirms."""

import errno
import json
import multiprocessing
import os
import re
import signal
import sys
import threading
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from checked_page import Checked
from test_job import BEST, GOALS, TURNS, VARY, pivot, wide
from test_job import job as full
from test_tolerance import SPREAD

import ksd
from ksd.errors import ResumeError
from ksd.optimisation import job as rooms
from ksd.optimisation import optimise as room
from ksd.optimisation import scaled_problem
from ksd.optimisation.local_search import MAX_ITERATIONS
from ksd.optimisation.scaled_problem import _extended_log
from ksd.units import mm

LIMITS = {"stress_MPa": 500, "turn_moment_Nm": (-3, 3)}
SHAPE = {"length": 80 * mm, "angle": 0.72, "inner": 40 * mm, "outer": 12 * mm}


def job(function=pivot, **changes):
    """The job of the specification at conventional poses, whose answers have no trained ranges."""
    words = {
        "vary": {**VARY, "length": (40 * mm, 80 * mm)}, "maximise": GOALS, "limits": LIMITS, "link": "arm", "at": (0, 0, 0),
        "rules": [wide], "turn": TURNS, "method": "conventional", **changes,
    }  # fmt: skip
    return ksd.Job(function, **words)


def sheet(length, thickness):
    """The pivot by two of its parameters."""
    return pivot(**{**SHAPE, "length": length, "thickness": thickness})


def small(function=sheet, **changes):
    """A job of two parameters at one pose: as stiff as stress allows."""
    words = {
        "vary": {"length": (40 * mm, 80 * mm), "thickness": (0.2 * mm, 1 * mm)}, "maximise": "support_worst_Nm_per_rad",
        "limits": {"stress_MPa": 400}, "rules": [], "turn": 0.3, **changes,
    }  # fmt: skip
    return job(function, **words)


def test_the_job_of_the_specification_from_five_random_starts():
    best = ksd.optimise(job(), starts=5, seed=3)
    assert best.merit == pytest.approx(0.5035665, abs=1e-6) and best.agreed == len(best.starts) == 5
    for name, value in BEST.items():
        assert best.design[name] == pytest.approx(value, rel=1e-4)
    assert all(end.values <= 15 and end.gradients <= 15 for end in best.starts)
    assert best.evaluations == sum(end.values for end in best.starts) <= len(list(best.table.rows()))
    # held by stress, length, depth, in-plane and tilt stiffness at 30 degrees
    held = {name.split(" at ")[0].split("[")[0] for name in best.held}
    assert held == {*GOALS, "stress_MPa", "length", "rule 'wide'"}
    assert sum(best.held[n] for n in best.held if n.startswith("support")) == pytest.approx(1.0)
    assert not best.flat and "5 of 5 starts end here" in str(best) and "worth" in str(best)
    assert "value [SI]" in str(best)
    assert best.mechanism.scene().name == "pivot"


def test_parameters_are_printed_in_the_units_of_their_bounds():
    """The same optimum, whatever the bounds are written in."""
    plain = ksd.optimise(small())
    vary = {"length": ("4 cm", "8 cm"), "thickness": (0.2 * mm, 1 * mm)}
    best = ksd.optimise(small(vary=vary))
    assert best.design == plain.design and best.job.vary == plain.job.vary
    (line,) = re.findall(r"length +(.*)", str(best).split("held by")[0])
    assert re.fullmatch(r"8 cm +4 cm +8 cm *", line)
    assert re.search(r"thickness +0\.000", str(best)) and "value [SI]" not in str(best)
    assert "length 8 cm" in repr(best)
    with pytest.raises(
        ksd.SceneError, match="vary: length = '4 cmm': give a number in SI, or text with a unit"
    ):
        small(vary={"length": ("4 cmm", 0.1)})


def test_starts_that_end_as_near_as_limits_are_met_agree():
    """A limit worth 3.6 that is met to 1e-5 is 3.6e-5 of the target."""
    best = ksd.optimise(small(), starts=3)
    ends = [
        end._replace(merit=best.merit * (1 - short))
        for end, short in zip(best.starts, (0, 3.6e-5, 2e-4), strict=True)
    ]
    assert best.agreed == 3 and replace(best, starts=tuple(ends)).agreed == 2


def test_worth_is_what_moving_a_limit_changes():
    best = ksd.optimise(small())
    (name, worth), *others = [(n, w) for n, w in best.held.items() if "stress" in n]
    worth += sum(w for _, w in others)
    looser = ksd.optimise(small(limits={"stress_MPa": 400 * 1.001}), start=best.design)
    assert np.log(looser.merit / best.merit) / np.log(1.001) == pytest.approx(worth, rel=1e-2)
    shorter = ksd.optimise(
        small(vary={"length": (40 * mm, 80 * mm * 0.999), "thickness": (0.2 * mm, 1 * mm)})
    )
    change = np.log(shorter.merit / best.merit) / np.log(0.999)
    assert best.answers[name] == pytest.approx(400, rel=1e-5)
    assert change == pytest.approx(best.held["length at its most"], rel=1e-2)


def test_minimise_lower_limits_and_rules():
    wanted = small(
        minimise="turn_moment_Nm",
        maximise=(),
        limits={"support_worst_N_per_m": (2e5, None), "stress_MPa": 600},
    )
    best = ksd.optimise(wanted)
    assert best.merit == pytest.approx(-best.answers["turn_moment_Nm"])
    assert best.answers["support_worst_N_per_m"] == pytest.approx(2e5, rel=1e-5)
    ruled = ksd.optimise(small(rules=[lambda p: 0.4 * mm - p["thickness"]]))
    assert ruled.design["thickness"] == pytest.approx(0.4 * mm, rel=1e-6) and "rule 1" in ruled.held


def test_where_one_of_several_is_enough_it_is_the_worst():
    """The least principal stiffness is minimised or limited from above alone, and the largest stress from below."""
    words = {"minimise": "support_worst_N_per_m", "maximise": (), "limits": {"stress_MPa": (300, 450)}}
    best = ksd.optimise(small(**words))
    pose = best.pose()
    assert best.merit == pytest.approx(-pose.stiffness("arm", at=(0, 0, 0)).worst[0], rel=1e-6)
    assert pose.stress(points=25).largest_Pa == pytest.approx(300e6, rel=1e-5) and "stress_MPa" in best.held
    names = best.job.names
    assert {"support_worst_N_per_m", "stress_MPa", "stress_MPa[hinge/inner]"} < {*names}
    assert not any(name.endswith("]") and name.startswith("support") for name in names)
    both = small(maximise="support_z_N_per_m", limits={"support_worst_Nm_per_rad": (50, 180)})
    ends = {a.name: (a.low, a.high) for a in both.answers if a.role == "limit"}
    assert ends == {"support_worst_Nm_per_rad": (50, 180)} | dict.fromkeys(
        (f"support_worst_Nm_per_rad[{k}]" for k in (2, 3)), (50, np.inf)
    )
    assert both.limits == {"support_worst_Nm_per_rad": (50, 180)}
    assert str(both).endswith("support_worst_Nm_per_rad at least 50.00 and at most 180.0")
    # of the axis that the drive holds there is no stiffness that the limit could be about
    found = ksd.optimise(both)
    assert found.answers["support_worst_Nm_per_rad"] == pytest.approx(180, rel=2e-5)
    front = ksd.pareto(small(), against="support_worst_Nm_per_rad", points=2)
    assert front.limits[1] == pytest.approx(front.merits[0] / 10) and front.status == ("ok", "ok")
    assert front.merits[1] == pytest.approx(front.limits[1], rel=2e-5)


def test_a_target_that_is_infinite_is_no_optimum():
    with pytest.raises(
        ksd.ConvergenceError, match=r"worst support_rz_Nm_per_rad is infinite there: nothing moves"
    ):
        ksd.optimise(small(maximise="support_rz_Nm_per_rad"))


def test_the_edge_of_what_can_be_built_is_searched_along():
    """The search ended at the first design beside which the function returns nothing: steps go to the other side there."""

    def half(length, thickness):
        return sheet(length, thickness) if thickness < 0.6 * mm else None

    best = ksd.optimise(small(half))
    assert best.design["thickness"] == pytest.approx(0.6 * mm, rel=1e-4)
    # the edge is found by trial
    assert best.status == "no better neighbour found"
    edge = ksd.optimise(small(vary={"length": (40 * mm, 80 * mm), "thickness": (0.2 * mm, 0.6 * mm)}))
    assert best.merit == pytest.approx(edge.merit, rel=1e-3)
    assert best.held["thickness at the most that has answers"] == pytest.approx(
        edge.held["thickness at its most"], rel=1e-3
    )


def test_evolution_ends_at_the_same_design():
    pytest.importorskip("cma")
    best, other = ksd.optimise(small()), ksd.optimise(small(), method="cma")
    assert other.merit == pytest.approx(best.merit, rel=1e-5)
    assert other.gradients > 0 and other.evaluations > best.evaluations


def test_evolution_asks_for_populations_and_is_polished(monkeypatch):
    """With a stand-in for the package: three designs of two generations, then SLSQP from the best."""
    asked = []

    class Strategy:
        def __init__(self, start, sigma, options):
            assert options["bounds"] == [0.0, 1.0]
            self.rounds, self.cost = 0, []
            self.result = SimpleNamespace(xbest=np.asarray(start))

        def stop(self):
            return self.rounds == 2

        def ask(self):
            self.rounds += 1
            return [np.clip(self.result.xbest + d, 0, 1) for d in (0.0, 0.1 * self.rounds, -0.1)]

        def tell(self, places, cost):
            self.result.xbest = places[int(np.argmin(cost))]
            self.cost.append(cost)
            asked.append(len(places))

    monkeypatch.setitem(sys.modules, "cma", SimpleNamespace(CMAEvolutionStrategy=Strategy))
    best = ksd.optimise(small(), method="cma")
    assert asked == [3, 3] and best.merit == pytest.approx(ksd.optimise(small()).merit, rel=1e-6)


def test_designs_that_fail_halve_the_step():
    start = {"length": 50 * mm, "thickness": 0.25 * mm}
    free = ksd.optimise(small(), start=start)
    tried = [row["thickness"] for row in free.table.rows()][1]

    def hole(length, thickness):
        if abs(thickness / tried - 1) < 1e-2:
            raise ValueError("not on stock")
        return sheet(length, thickness)

    assert abs(free.design["thickness"] / tried - 1) > 2e-2
    found = ksd.optimise(small(hole), start=start)
    failed = [row for row in found.table.rows() if "not on stock" in row["status"]]
    assert failed and all(np.isnan(row["support_worst_Nm_per_rad"]) for row in failed)
    assert found.merit == pytest.approx(free.merit, rel=1e-6) and found.starts[0].status == "ok"


def test_a_gap_that_gradients_end_at_loses_nothing():
    """The search goes past it, or along its edge where the better designs are beyond the bounds; so does evolution."""

    def gap(length, thickness):
        if 0.45 * mm < thickness < 0.6 * mm:
            raise ValueError("not on stock")
        return sheet(length, thickness)

    free = ksd.optimise(small()).merit
    for thickness in (0.4 * mm, 0.7 * mm):
        found = ksd.optimise(small(gap), start={"length": 60 * mm, "thickness": thickness})
        assert found.merit == pytest.approx(free, rel=1e-6)
    within = small(gap, vary={"length": (40 * mm, 80 * mm), "thickness": (0.2 * mm, 0.55 * mm)})
    pytest.importorskip("cma")
    best = ksd.optimise(within, method="cma")
    assert best.design["thickness"] == pytest.approx(0.45 * mm, rel=1e-3) and best.starts[0].status == "ok"
    edge = ksd.optimise(small(vary={"length": (40 * mm, 80 * mm), "thickness": (0.2 * mm, 0.45 * mm)}))
    assert best.merit == pytest.approx(edge.merit, rel=2e-3)


def test_no_start_that_works_is_told():
    def never(length, thickness):
        if abs(thickness - 0.6 * mm) > 1e-9:
            raise ValueError("not made")
        return sheet(length, thickness)

    with pytest.raises(ksd.ConvergenceError, match=r"none of 1 starts.*not made"):
        ksd.optimise(small(never), start=[50 * mm, 0.5 * mm])
    with pytest.raises(ksd.ConvergenceError, match=r"farthest from it is stress_MPa") as told:
        ksd.optimise(small(limits={"stress_MPa": 1.0}))
    with pytest.raises(ksd.ConvergenceError, match=r"turn = 20 is 20 rad: did you mean 20 deg"):
        ksd.optimise(small(turn=20))
    # nothing is lost
    assert len(told.value.result) > 3 and told.value.result["stress_MPa[hinge/inner]"].min() > 1.0


def test_a_tight_limit_is_met_by_every_method():
    """Interior points stuck outside of it from the middle of the bounds, and gradients to 1e-5 of it."""
    tight = small(limits={"stress_MPa": 150})
    best = ksd.optimise(tight)
    for method in ("gradient", "trust-constr", "cobyla"):
        other = best if method == "gradient" else ksd.optimise(tight, method=method)
        assert (other.gradients == 0) == (method == "cobyla") and other.evaluations >= best.evaluations
        assert max(v for n, v in other.answers.items() if "stress" in n) <= 150
        assert other.merit == pytest.approx(best.merit, rel=1e-6) and other.status == "optimum"


def test_a_flat_direction_is_named():
    """Stress at a given turn knows thickness over length alone: all sizes in one ratio are as good."""
    ratio = small(
        minimise="stress_MPa", maximise=(), limits={}, rules=[lambda p: p["thickness"] / p["length"] - 8e-3]
    )
    best = ksd.optimise(ratio, start=[60 * mm, 0.6 * mm])
    assert set(best.flat) == {"length", "thickness"} and "Flat" in str(best)
    assert best.flat["length"] == pytest.approx(best.flat["thickness"], rel=1e-3)


def test_a_run_that_stops_before_the_limits_are_met_is_continued(monkeypatch):
    largest = {name: high for name, (_, high) in VARY.items()}
    whole = ksd.optimise(full(), start=largest)
    monkeypatch.setitem(MAX_ITERATIONS, "gradient", 2)
    assert ksd.optimise(full(), start=largest).merit == pytest.approx(whole.merit, rel=1e-4)


def test_a_run_goes_on_from_its_file(tmp_path, monkeypatch):
    path = tmp_path / "job.jsonl"
    first = ksd.optimise(small(), resume=path)
    monkeypatch.setattr(rooms.Job, "batch", None)
    monkeypatch.setattr(rooms.Job, "slopes", None)
    again = ksd.optimise(small(), resume=path)
    assert again.design == first.design and len(list(again.table.rows())) == len(list(first.table.rows()))


def test_workers_go_on_from_the_file_too(tmp_path, monkeypatch):
    path = tmp_path / "job.jsonl"
    first = ksd.optimise(small(), starts=2, resume=path)
    monkeypatch.setattr(rooms.Job, "batch", None)
    monkeypatch.setattr(rooms.Job, "slopes", None)
    for starts in (2, 1):
        with ThreadPoolExecutor(2) as pool:
            again = ksd.optimise(small(), starts=starts, resume=path, executor=pool)
        ends = first.starts[:starts]
        assert [s.design for s in again.starts] == [s.design for s in ends]
        around = sum(row["by"].startswith("neighbours") for row in again.table.rows())
        assert len(again.table) == sum(s.values for s in ends) + around and around == again.proof.neighbours


def test_an_answer_that_does_not_scatter_blames_no_parameter():
    found = ksd.tolerance(
        small(), {"length": 70 * mm, "thickness": 0.5 * mm}, spread={"length": 2e-5}, samples=4
    )
    still = [k for k, sd in enumerate(found.first_order) if sd == 0.0]
    assert [found.names[k] for k in still] == ["support_worst_Nm_per_rad[3]"] and np.isinf(
        found.nominal[still]
    ).all()
    assert "support_worst_Nm_per_rad[3]" in str(found) and "length 100 %" in str(found)
    assert "length 0 %" not in str(found)


@pytest.mark.parametrize(
    ("search", "room_for"),
    [
        (lambda folder: ksd.optimise(small(), resume=folder / "job.jsonl"), 8),
        # past its first optimum
        (lambda folder: ksd.pareto(small(), against="stress_MPa", points=3, resume=folder / "job.jsonl"), 30),
        (lambda folder: ksd.choose({"one": small(), "other": small()}, resume=folder), 8),
    ],
)
def test_a_full_disk_ends_a_search_and_is_no_failed_design(search, room_for, monkeypatch, tmp_path):
    written, fsync = [], os.fsync

    def full_disk(number):
        written.append(number)
        if len(written) > room_for:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        fsync(number)

    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(ResumeError, match=r"^resume = '.*jsonl' cannot be written any more: No space left"):
        search(tmp_path)
    assert len(written) == room_for + 1


def test_interrupted_runs_keep_what_is_done_and_end_as_others(monkeypatch, tmp_path):
    undisturbed = ksd.optimise(small())
    whole, calls = rooms.Job.slopes, []

    def interrupted(self, x):
        calls.append(x)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return whole(self, x)

    monkeypatch.setattr(rooms.Job, "slopes", interrupted)
    with pytest.raises(ksd.SweepInterrupted, match=r"designs done.*job.jsonl") as caught:
        ksd.optimise(small(), resume=tmp_path / "job.jsonl")
    assert len(list(caught.value.table.rows())) >= 2
    resumed = ksd.optimise(small(), resume=tmp_path / "job.jsonl")
    assert resumed.design == undisturbed.design and len(resumed.table) == len(undisturbed.table)
    # two slopes before Ctrl-C, which are not computed again
    assert len(calls) == 1 + undisturbed.gradients


def test_margins_of_limits_of_either_sign():
    value, slope = _extended_log(np.array([2.0, 0.1, 0.0, -1.0]))
    assert value[0] == pytest.approx(np.log(2)) and value[2] == pytest.approx(np.log(0.1) - 1)
    assert np.all(np.diff(value) < 0) and slope == pytest.approx([0.5, 10, 10, 10])
    at = scaled_problem.ScaledProblem(small(limits={"turn_moment_Nm": (-3, 2)}), None, "")
    of = dict(
        zip(
            [(s.sign, s.reference) for s in at.sides],
            at._answer_margins(np.array([1e5, np.inf, np.inf, 1.0]))[0],
            strict=True,
        )
    )
    assert of[-1.0, 2.0] == pytest.approx(np.log(2)) and of[-1.0, -3.0] > 0
    beyond = at._answer_margins(np.array([1e5, np.inf, np.inf, -6.0]))[0]
    assert beyond[-1] == pytest.approx(-np.log(2)) and beyond[-2] > 0
    held = at._answer_margins(np.array([np.inf, np.inf, np.inf, 0.0]))[0]
    assert held[0] == scaled_problem.INFINITE_ANSWER_MARGIN


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"method": "gradent"}, r"method = 'gradent'.*gradient"),
        ({"starts": 0}, r"starts"),
        ({"seed": -1}, r"seed"),
        ({"start": {"length": 50 * mm}}, r"'thickness' has no value"),
        ({"start": {"length": 50 * mm, "thicknes": 1e-4}}, r"'thicknes' is not varied.*thickness"),
        ({"start": {"length": 1.0, "thickness": 0.5 * mm}}, r"lies outside"),
        ({"executor": 3}, r"executor"),
    ],
)
def test_wrong_words_are_told(change, message):
    with pytest.raises(ksd.SceneError, match=message):
        ksd.optimise(small(), **change)


def test_more_wrong_words(monkeypatch):
    with pytest.raises(ksd.SceneError, match=r"is no job"):
        ksd.optimise(sheet)
    monkeypatch.setitem(sys.modules, "cma", None)
    with pytest.raises(ksd.SceneError, match=r"pip install cma"):
        ksd.optimise(small(), method="cma")


def test_a_robust_optimum_is_that_of_the_specification():
    plain = full(vary={**VARY, "length": (40 * mm, 80 * mm)})
    sure = ksd.optimise(plain, start=BEST, robust=3, spread=SPREAD)
    assert sure.merit == pytest.approx(0.4482, abs=1e-4)
    assert sure.design["thickness"] == pytest.approx(0.61471 * mm, rel=1e-4)
    made = ksd.tolerance(plain, sure, spread=SPREAD, samples=150)
    assert made.yield_fraction >= 0.99
    # limits are moved in by three standard deviations of the answers there
    k = plain.names.index("stress_MPa[hinge/inner] at turn 30.00 deg")
    assert sure.margins[plain.names[k]] == pytest.approx(3 * made.first_order[k], rel=1e-3)
    assert sure.job.answers[k].high == pytest.approx(500 - 3 * made.first_order[k], rel=1e-3)
    assert "For 3 standard deviations" in str(sure) and sure.starts[0].status == "ok"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ({"robust": 3}, "spread: give standard deviations of the parameters"),
        ({"spread": {"thickness": 1e-6}}, "robust = 0: give a number of standard deviations"),
        ({"robust": -1, "spread": {"thickness": 1e-6}}, r"robust = -1: give a number"),
        ({"robust": 3, "spread": {"thicknes": 1e-6}}, r"'thicknes' is not varied.*thickness"),
        ({"robust": "3", "spread": {"thickness": 1e-6}}, r"robust"),
    ],
)
def test_wrong_words_of_a_robust_optimum(words, sentence):
    with pytest.raises(ksd.SceneError, match=sentence):
        ksd.optimise(small(), **words)


def test_margins_that_no_design_can_keep_are_told():
    with pytest.raises(
        ksd.ConvergenceError, match=r"moved in by 3 standard deviations.*farthest is stress_MPa"
    ) as told:
        ksd.optimise(small(), robust=3, spread={"thickness": 0.3 * mm})
    assert len(told.value.result) > 3


def stocked(p):
    """A rule that fails beyond the sheets of a table."""
    return 1.0 if p["thickness"] < 0.7 * mm else {}["none"]


def test_threads_and_processes_end_where_one_thread_ends(tmp_path):
    """Their tables hold every design, also those where a rule fails, which no worker writes to the file."""
    words, job = {"starts": 3, "seed": 2}, small(rules=[stocked])
    alone = ksd.optimise(job, **words)
    failed = [row for row in alone.table.rows() if "rule 'stocked' gives no number" in row["status"]]
    assert failed and all(row["thickness"] >= 0.7 * mm for row in failed)
    assert {row["by"] for row in failed} >= {f"gradient, start {k}" for k in (1, 2, 3)}
    spawn = multiprocessing.get_context("spawn")
    with ThreadPoolExecutor(2) as threads, ProcessPoolExecutor(1, mp_context=spawn) as processes:
        for pool, file in ((threads, tmp_path / "job.jsonl"), (processes, None)):
            many = ksd.optimise(job, executor=pool, resume=file, **words)
            assert many.design == alone.design
            assert repr(list(many.table.rows())) == repr(list(alone.table.rows()))
            assert many.starts == alone.starts
    again = ksd.optimise(job, resume=tmp_path / "job.jsonl", **words)
    assert again.design == alone.design and len(again.table) == len(alone.table)


def test_what_worker_processes_cannot_be_sent_is_told_in_words():
    nameless = small(rules=[lambda p: 1.0])
    said = "worker processes cannot be sent .*lambda.*: define design functions and rules by name at the top level"
    with ProcessPoolExecutor(1) as pool:
        for call in (
            lambda: ksd.optimise(nameless, starts=2, executor=pool),
            lambda: ksd.choose({"one": nameless}, executor=pool),
            lambda: ksd.batch(lambda **p: pivot(**p), designs=[BEST], turn=0.1, executor=pool),
        ):
            with pytest.raises(ksd.SceneError, match=said):
                call()


def test_a_worker_that_fails_loses_no_start_that_is_done(monkeypatch):
    def interrupted(job, x, method, by, file):
        if by.endswith("2"):
            raise KeyboardInterrupt
        return room._run_start_in_worker_again(job, x, method, by, file)

    monkeypatch.setattr(room, "_run_start_in_worker_again", room._run_start_in_worker, raising=False)
    monkeypatch.setattr(room, "_run_start_in_worker", interrupted)
    with ThreadPoolExecutor(1) as pool, pytest.raises(ksd.SweepInterrupted) as caught:
        ksd.optimise(small(), starts=3, executor=pool)
    assert {row["by"] for row in caught.value.table.rows()} >= {"gradient, start 1"}


def test_ctrl_c_keeps_the_designs_of_starts_that_still_run(tmp_path):
    """All designs of the starts in workers were lost, even those in the file."""
    path, words = tmp_path / "job.jsonl", {"starts": 2, "seed": 2}
    alone = ksd.optimise(small(rules=[]), **words)

    def waits(function):
        def waiting(self, y):
            if len(self.evaluated) == 3:
                pressed.set()
                after.wait(60)
            return function(self, y)

        return waiting

    def press():
        pressed.wait(60)
        os.kill(os.getpid(), signal.SIGINT)

    pressed, after = threading.Event(), threading.Event()
    with pytest.MonkeyPatch.context() as patch, ThreadPoolExecutor(2) as pool:
        patch.setattr(scaled_problem.ScaledProblem, "margins", waits(scaled_problem.ScaledProblem.margins))
        threading.Thread(target=press).start()
        try:
            with pytest.raises(ksd.SweepInterrupted) as caught:
                ksd.optimise(small(rules=[]), executor=pool, resume=path, **words)
        finally:
            after.set()
    assert len(caught.value.table) >= 3
    # the workers have ended, and what they found is in the file
    again = ksd.optimise(small(rules=[]), resume=path, **words)
    assert again.design == alone.design and list(again.table.rows()) == list(alone.table.rows())
    keys = [json.loads(line.partition(" ")[2])["line"] for line in path.read_text().splitlines()[1:]]
    assert len(keys) == len(set(keys)) > len(again.table)


def test_pictures_and_page_of_an_optimum(tmp_path):
    best = ksd.optimise(small(turn=[0.1, 0.3]), starts=2)
    assert best.worst.startswith("support_worst_Nm_per_rad") and best.worst.endswith("at turn 17.19 deg")
    assert best.pose().targets["turn"] == 0.3
    figure = best.plot(tmp_path / "convergence.png")
    assert (tmp_path / "convergence.png").stat().st_size > 10_000
    own = [
        row["support_worst_Nm_per_rad at turn 17.19 deg"]
        for row in best.table.rows()
        if "start 1" in row["by"]
    ]
    assert figure.axes[0].lines[0].get_ydata() == pytest.approx(own, rel=1e-6)
    assert [t.get_text() for t in figure.axes[2].get_xticklabels()] == ["length", "thickness"]
    page = best.report(tmp_path / "pivot.html").read_text(encoding="utf-8")
    checked = Checked()
    checked.feed(page)
    assert not checked.open and checked.headings == [
        "The job", "The optimum and what holds it", "How it was found", "Answers",
    ]  # fmt: skip
    assert all(a.startswith("data:image/png") for a in checked.addresses) and len(checked.addresses) == 2
    assert "length at its most" in page and f"{best.design['thickness']:.6g}" in page
    with pytest.raises(ksd.SceneError, match="there is no answer 'stress'"):
        best.pose("stress")
    with pytest.raises(ksd.SceneError, match="type 'doc' is unknown"):
        best.plot(tmp_path / "a.doc")
    with pytest.raises(ksd.SceneError, match="does not exist"):
        best.report(tmp_path / "none" / "a.html")


def test_a_design_without_a_gradient_says_why():
    """Its link has another name at every length, so that no two designs are one mechanism."""

    def renamed(length):
        scene = ksd.Mechanism("renamed", plane="xy")
        tip = scene.link(f"tip {length!r}")
        scene.leaf("ground", tip, start=(0, 0, 0), end=(length, 0, 0), section=ksd.rectangle(0.5 * mm, 10 * mm),
                   material=ksd.Material(E=200e9, nu=0.3))  # fmt: skip
        scene.actuate(tip, along="y", at=(length, 0, 0), name="d")
        return scene

    job = ksd.Job(
        renamed, vary={"length": (50 * mm, 90 * mm)}, minimise="d_force_N", d=1 * mm, method="conventional"
    )
    with pytest.raises(
        ksd.ConvergenceError, match=r"no gradient: a small change of a parameter changes what"
    ):
        ksd.optimise(job)
