"""Fronts are optima under tighter limits, and the choice among jobs is that of their optima."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from test_job import pivot
from test_optimise import sheet, small

import ksd
from ksd.answers import printing
from ksd.optimisation import pareto as room

MOMENT = "turn_moment_Nm"


@pytest.fixture(scope="module")
def front():
    return ksd.pareto(small(), against=MOMENT, points=3)


def test_points_are_optima_under_their_limit(front):
    most = front.points[0].answers[MOMENT]
    assert front.limits == pytest.approx(most * np.array([1.0, 10**-0.5, 0.1]))
    assert front.points[0].merit == pytest.approx(ksd.optimise(small()).merit, rel=1e-6)
    limited = small(limits={"stress_MPa": 400, MOMENT: front.limits[1]})
    assert front.merits[1] == pytest.approx(ksd.optimise(limited).merit, rel=1e-6)
    assert front.merits[0] > 1.1 * front.merits[1]
    assert front.points[1].answers[MOMENT] == pytest.approx(front.limits[1], rel=1e-6)


def test_a_point_is_looked_for_beyond_the_two_before():
    found = ksd.pareto(small(), against=MOMENT, points=5, span=(0.1, 1.0))
    x = np.log(found.designs)
    first = [np.log(list(p.starts[0].start.values())) for p in found.points]
    assert first[3] == pytest.approx(2 * x[2] - x[1], rel=1e-9)
    assert found.points[3].evaluations <= found.points[1].evaluations


def test_a_front_is_told_and_drawn(front, tmp_path):
    rows = list(front.table.rows())
    assert rows[1]["merit"] == front.merits[1] and rows[1]["thickness"] == front.points[1].design["thickness"]
    assert "points, worst support_worst_Nm_per_rad" in str(front) and f"most {MOMENT}" in str(front)
    figure = front.plot(tmp_path / "front.png")
    assert (tmp_path / "front.png").stat().st_size > 5000
    assert figure.axes[0].lines[0].get_xdata()[0] == front.limits[0]
    assert [t.get_text() for t in figure.axes[1].get_xticklabels()] == ["length", "thickness"]


def test_a_point_without_a_design_says_why():
    found = ksd.pareto(small(), against=MOMENT, points=2, span=(1e-5, 3.0))
    assert found.points[1] is None and "none of 1 starts" in found.status[1] and np.isnan(found.merits[1])
    assert found.points[0] is not None and "none of 1 starts" in str(found)


def test_a_limit_there_is_only_gets_tighter():
    job = small(limits={"stress_MPa": 400, MOMENT: (-1, 2)})
    (own,) = [a for a in job.limited(MOMENT, 1.0).answers if a.column == MOMENT]
    assert (own.low, own.high) == (-1, 1)
    assert [a.high for a in job.limited(MOMENT, 5.0).answers if a.column == MOMENT] == [2]
    assert job.limited("strain_energy_J", 0.1).names[-1] == "strain_energy_J"
    above = small(limits={"strain_energy_J": (0.05, None)}).limited("strain_energy_J", 0.1)
    assert above.limits["strain_energy_J"] == (0.05, 0.1)
    with pytest.raises(ksd.SceneError, match="there is no answer 'turn_moment_nm'"):
        job.limited("turn_moment_nm", 1.0)


def test_the_best_of_several_jobs():
    thin = small(vary={"length": (40e-3, 80e-3), "thickness": (0.2e-3, 0.3e-3)})
    never = small(limits={"stress_MPa": 1})
    found = ksd.choose({"thin": thin, "never": never, "thick": small()})
    assert found.best == "thick" and list(found.optima) == ["thick", "thin", "never"]
    assert found["thick"].merit > found["thin"].merit and "Best: thick" in str(found)
    with pytest.raises(ksd.SceneError, match="none of 1 starts"):
        found["never"]


def test_progress_and_ctrl_c_across_the_points_of_a_front(front, monkeypatch, tmp_path):
    said, honest, calls = [], room.optimise_from, []

    class Bar:
        def __enter__(self):
            return self

        def __exit__(self, *why):
            pass

        def add_task(self, name, total):
            said.append((name, total))

        def update(self, task, description, completed):
            said.append((description, completed))

    def interrupted(*given, **how):
        calls.append(given)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return honest(*given, **how)

    monkeypatch.setattr(room, "progress_bar", lambda shown: Bar() if shown else printing.progress_bar(False))
    monkeypatch.setattr(room, "optimise_from", interrupted)
    file = tmp_path / "front.jsonl"
    with pytest.raises(ksd.SweepInterrupted, match=r"2 of 3 points are done.*front.jsonl") as caught:
        ksd.pareto(small(), against=MOMENT, points=3, resume=file, progress=True)
    assert said[0] == ("points", 3) and {done for _, done in said[1:]} == {0, 1}
    assert "worst target" in said[-1][0]
    done = {(row["length"], row["thickness"]) for row in caught.value.table.rows()}
    asked = []
    batch = ksd.Job.batch
    monkeypatch.setattr(ksd.Job, "batch", lambda job, X, **how: asked.append(X) or batch(job, X, **how))
    again = ksd.pareto(small(), against=MOMENT, points=3, resume=file)
    assert again.merits == pytest.approx(front.merits, rel=1e-12)
    # the designs of the first two points are not computed again
    assert len(done) > 5 and not done & {tuple(x) for X in asked for x in np.atleast_2d(X).tolist()}


def test_choices_go_on_and_run_in_executors(monkeypatch, tmp_path):
    thin = small(vary={"length": (40e-3, 80e-3), "thickness": (0.2e-3, 0.3e-3)})
    jobs, honest = {"thin/1": thin, "thick": small()}, room._optimum_or_reason
    with ThreadPoolExecutor(2) as pool:
        found = ksd.choose(jobs, executor=pool, resume=tmp_path)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["1_thin_1.jsonl", "2_thick.jsonl"]

    def interrupted(job, *how):
        if job is not thin:
            raise KeyboardInterrupt
        return honest(job, *how)

    monkeypatch.setattr(room, "_optimum_or_reason", interrupted)
    with pytest.raises(ksd.SweepInterrupted, match="1 of 2 jobs are done") as caught:
        ksd.choose(jobs, resume=tmp_path)
    (row,) = caught.value.table.rows()
    assert row["job"] == "thin/1" and row["merit"] == found["thin/1"].merit
    with pytest.raises(ksd.SceneError, match="give a folder that is there"):
        ksd.choose(jobs, resume=tmp_path / "none")


@pytest.mark.parametrize(
    ("call", "sentence"),
    [
        (lambda: ksd.pareto(pivot, against=MOMENT), "is no job"),
        (lambda: ksd.pareto(small(), against=MOMENT, points=1), "points = 1"),
        (lambda: ksd.pareto(small(), against=MOMENT, span=(2, 1)), "give the least and the most"),
        (lambda: ksd.pareto(small(), against="moment", span=(1, 2)), "there is no answer 'moment'"),
        (lambda: ksd.choose({"one": sheet}), "give jobs by name"),
        (lambda: ksd.choose({}), "give jobs by name"),
        (lambda: ksd.choose({"one": small()}, starts=0), "starts = 0 must be"),
        (lambda: ksd.choose({"one": small()}, seed=-1), "seed = -1 must be"),
    ],
)
def test_wrong_words(call, sentence):
    with pytest.raises(ksd.SceneError, match=sentence):
        call()
