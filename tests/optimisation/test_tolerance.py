"""Tolerances: first order against samples, the yield of the optimum of the specification, and limits moved in."""

import numpy as np
import pytest
from test_job import BEST, VARY, job, pivot, strip

import ksd
from ksd.optimisation import design_log
from ksd.optimisation.design_log import DesignLog
from ksd.optimisation.tolerance import check_spread
from ksd.units import deg, mm

SPREAD = {"length": 20e-6, "inner": 20e-6, "outer": 20e-6, "angle": 0.1 * deg, "thickness": 4e-6}


@pytest.fixture(scope="module")
def made():
    return ksd.tolerance(job(turn=[0.5235987755982988]), BEST, spread=SPREAD, samples=120, seed=3)


def test_samples_scatter_as_to_first_order_and_half_of_them_hold_the_limit(made):
    # four standard errors of a standard deviation and of a share
    assert made.sampled == pytest.approx(made.first_order, rel=4 / np.sqrt(2 * 120) + 0.05)
    assert made.yield_fraction == pytest.approx(0.48, abs=4 * np.sqrt(0.25 / 120)) and len(made.table) == 121
    assert np.nanmean(made.merits) == pytest.approx(0.5036, abs=4 * np.nanstd(made.merits) / np.sqrt(120))
    blame = made.to_blame("stress_MPa[hinge/inner]")
    assert next(iter(blame)) == "thickness" and sum(blame.values()) == pytest.approx(1.0)
    assert "hold every limit" in str(made) and "thickness 99 %" in str(made)


def test_limits_alone_are_enough_and_say_the_same_as_beside_a_target():
    words = {"turn": [0.5], "limits": {"stress_MPa": 469.0}}
    alone, both = job(maximise=(), **words), job(**words)
    found, asked = (ksd.tolerance(j, BEST, spread=SPREAD, samples=16, seed=1) for j in (alone, both))
    names = [n for n in found.names if n.startswith("stress")]
    assert names == list(found.names) and 0.0 < found.yield_fraction == asked.yield_fraction < 1.0
    k = [asked.names.index(n) for n in names]
    assert found.nominal == pytest.approx(asked.nominal[k])
    assert found.first_order == pytest.approx(asked.first_order[k])
    assert str(alone).startswith("Job: limits alone by length, ")
    named = job(**words, vary={**VARY, "length": ("40 mm", "80 mm")})
    assert "length: 40.00 to 80.00 mm\n" in str(named) and "length: 0.0400" in str(alone)
    assert np.isnan(found.merits).all() and found._line().endswith("of 16 samples hold every limit")
    # what has no answer is no worst target
    missing = np.where(np.arange(len(both.answers)) == 1, np.nan, both.values(both.point(BEST)))
    assert both.answers[1].role != "limit" and np.isnan(both.merit(missing))
    for call in (ksd.optimise, lambda j: ksd.pareto(j, against="stress_MPa")):
        with pytest.raises(ksd.SceneError, match="this job has limits alone, and nothing to make better"):
            call(alone)
    chosen = ksd.choose({"alone": alone})
    assert "this job has limits alone" in chosen.status["alone"]
    assert "No job has an optimum" in str(chosen) and "Best" not in str(chosen)


def test_so_many_standard_deviations_lead_to_the_limit_or_to_the_worst_target():
    """A value moved by them lies on its nearest limit; a target moved by them is as bad as the worst."""
    one, kinds = job(turn=[0.5235987755982988], limits={"stress_MPa": 500, "turn_moment_Nm": (1.5, 3)}), set()
    made = ksd.tolerance(one, BEST, spread=SPREAD, samples=2)
    for k, (answer, far) in enumerate(zip(one.answers, made.sds_to_limit, strict=True)):
        if not np.isfinite(far):
            assert made.first_order[k] == 0.0
            continue
        gap = far * made.first_order[k] * np.array([1, -1])
        moved = made.nominal[k] + gap
        if answer.role == "limit":
            # and none is nearer
            assert all(min(answer.margins(v)) > 0.0 for v in made.nominal[k] + 0.99 * gap)
            left = [np.abs(answer.margins(v)).min() for v in moved]
        else:
            left = [abs(answer.merit(v) - one.merit(made.nominal)) for v in moved]
        assert min(left) == pytest.approx(0.0, abs=1e-9)
        kinds.add((answer.role, np.isfinite(answer.low), far > 0.0))
    # limits on one side and on both, the worst target and others
    assert kinds == {
        ("limit", False, True),
        ("limit", True, True),
        ("maximise", False, True),
        ("maximise", False, False),
    }


def test_standard_deviations_are_those_of_slopes(made):
    one = job(turn=[0.5235987755982988])
    x = one.point(BEST)
    k = one.names.index("turn_moment_Nm")
    found = 0.0
    for i, name in enumerate(one.parameters):
        step = 0.1 * SPREAD[name] * (np.arange(5) == i)
        pair = one.batch([x + step, x - step]).values[:, k]
        found += (5.0 * (pair[0] - pair[1])) ** 2
    assert made.first_order[k] == pytest.approx(np.sqrt(found), rel=1e-5)


def test_samples_without_answers_are_told():
    def stock(length, thickness):
        if thickness > 0.505 * mm:
            raise ValueError("no such sheet")
        return pivot(length, 40 * deg, thickness, 30 * mm, 15 * mm)

    vary = {"length": (60 * mm, 80 * mm), "thickness": (0.4 * mm, 0.6 * mm)}
    made = ksd.tolerance(job(function=stock, vary=vary, rules=[], turn=[0.1]), [70 * mm, 0.5 * mm],
                         spread={"thickness": 0.01 * mm}, samples=40)  # fmt: skip
    count = int(np.isnan(made.merits).sum())
    assert 0 < count < 40 and made.yield_fraction == pytest.approx(1 - count / 40)
    assert f"of 40 samples hold every limit, {count} have no answers, worst target" in str(made)


def test_samples_beyond_a_trained_range_are_parts_as_others():
    """At the end of a trained range half of the samples had no answers, and counted as bad parts."""
    one = job(vary={**VARY, "angle": (31 * deg, 80 * deg)}, turn=[0.2], limits={"turn_moment_Nm": 3.0})
    x = one.point({**BEST, "angle": 60 * deg, "thickness": 0.4 * mm})
    made = ksd.tolerance(one, x, spread={"angle": 0.1 * deg}, samples=40)
    assert made.yield_fraction == 1.0 and not made.table.failures
    free = ksd.tolerance(job(method="conventional", turn=[0.2], vary={**VARY, "angle": (31 * deg, 80 * deg)},
                             limits={"turn_moment_Nm": 3.0}), x, spread={"angle": 0.1 * deg}, samples=40)  # fmt: skip
    assert made.sampled[-1] == pytest.approx(free.sampled[-1], rel=1e-6)
    # the job itself keeps to its ranges
    assert "outside its trained range" in one.batch([x * (1, 1.01, 1, 1, 1)]).status[0]


def test_limits_are_moved_in_on_both_sides():
    one = job(turn=[0.5])
    by = np.arange(1.0, len(one.answers) + 1)
    moved = one.moved(by)
    for a, b, own in zip(one.answers, moved.answers, by, strict=True):
        assert (b.low, b.high) == ((a.low + own, a.high - own) if a.role == "limit" else (a.low, a.high))
    values = one.values(one.point(BEST))
    assert (moved.margins(values) < one.margins(values)).all()


def test_ctrl_c_keeps_the_samples_that_are_done(monkeypatch, tmp_path):
    monkeypatch.setattr(design_log, "BLOCK_SIZE", 2)
    honest, calls = ksd.Job.batch, []

    def interrupted(self, X, **how):
        calls.append(len(X))
        if len(calls) == 4:
            raise KeyboardInterrupt
        return honest(self, X, **how)

    monkeypatch.setattr(ksd.Job, "batch", interrupted)
    words = {"spread": SPREAD, "samples": 6, "resume": tmp_path / "rows.jsonl"}
    with pytest.raises(ksd.SweepInterrupted, match=r"call again with resume='.*rows.jsonl' to go on") as told:
        ksd.tolerance(job(turn=[0.5]), BEST, **words)
    # the design itself, and two blocks of samples
    assert calls == [1, 2, 2, 2] and told.value.table["status"] == ["ok"] * 5
    assert ksd.tolerance(job(turn=[0.5]), BEST, **words).merits.shape == (6,) and calls == [1, 2, 2, 2, 2]


def test_wrong_words_of_tolerance():
    one = job(turn=[0.5])
    for words, sentence in (
        ({"spread": {"thick": 1e-6}}, "'thick' is not varied"),
        ({"spread": {}}, "give standard deviations"),
        ({"spread": {"thickness": 0.0}}, "must be positive"),
        ({"spread": SPREAD, "samples": 1}, "samples = 1"),
        ({"spread": SPREAD, "design": {**BEST, "angle": 2.0}}, "lies outside"),
        ({"spread": SPREAD, "design": "cross"}, "design 'cross': a design of this job is 5 numbers: length"),
        ({"spread": SPREAD, "design": [0.1, 0.2]}, "a design of this job is 5 numbers: length"),
    ):
        with pytest.raises(ksd.SceneError, match=sentence):
            ksd.tolerance(one, words.pop("design", BEST), **words)
    with pytest.raises(ksd.SceneError, match="is no job"):
        ksd.tolerance(DesignLog, BEST, spread=SPREAD)


def test_what_is_minimised_is_told_and_drawn_as_it_is():
    """The longest strip turns most easily: EI/L times the turn."""
    one = ksd.Job(strip, vary={"lean": (4 * mm, 8 * mm)}, turn=0.05, minimise="turn_moment_Nm")
    best = ksd.optimise(one)
    assert best.merit == pytest.approx(
        -200e9 * 15e-3 * 0.2e-3**3 / 12 * 0.05 / np.hypot(40e-3, 8e-3), rel=1e-3
    )
    (top, *_) = best.plot().axes
    assert top.get_title(loc="left").endswith(f"{-best.merit:.6g} at the optimum")
    assert all(
        (line.get_ydata() > 0.0).all() for line in top.lines if line.get_label().startswith("gradient")
    )
    made = ksd.tolerance(one, best, spread={"lean": 1e-5}, samples=4)
    assert (made.merits < 0.0).all() and "worst target 0." in str(made)


def test_parameters_without_a_spread_stay_as_they_are():
    one = job()
    assert check_spread(one, {"inner": 2e-5}).tolist() == [2e-5 * (n == "inner") for n in one.parameters]
