"""Optima known from elsewhere: closed forms of crossed pivots and stiffened guides, and the front of the specification."""

import numpy as np
import pytest
from scenes import STEEL
from test_job import BEST, VARY, job

import ksd
from ksd.units import deg, mm


def crossed(ratio):
    """A crossed pivot, its crossing point at the origin, the turn of the arm driven."""
    joint = ksd.CrossedPivot(
        STEEL, length=60 * mm, angle=45 * deg, thickness=0.3 * mm, width=20 * mm, ratio=ratio
    )
    scene = ksd.Mechanism("pivot")
    arm = scene.link("arm")
    scene.join(
        scene.ground, arm, joint, at=(-ratio * joint.length_AB, 0, 0), axis="z", toward="x", name="pivot"
    )
    scene.actuate(arm, about="z", name="turn")
    return scene


def guide(thickness, flexible, stroke=10 * mm):
    """A stage on two leaf springs of 100 mm x 30 mm that are stiff in their middle."""
    joint = ksd.StiffenedGuide(
        STEEL, length=100 * mm, thickness=thickness, width=30 * mm, spacing=80 * mm, flexible=flexible
    )
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage")
    placed = scene.join(scene.ground, stage, joint, at=(0, 0, 0), axis="z", toward="x", name="guide")
    scene.actuate_joint(placed, name="push")
    return scene


def plain_guide(thickness):
    """The same of plain leaf springs."""
    joint = ksd.ParallelGuide(STEEL, length=100 * mm, thickness=thickness, width=30 * mm, spacing=80 * mm)
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage")
    placed = scene.join(scene.ground, stage, joint, at=(0, 0, 0), axis="z", toward="x", name="guide")
    scene.actuate_joint(placed, name="push")
    return scene


@pytest.mark.parametrize(("turn", "ratio", "within"), [(1 * deg, 0.127325, 1e-5), (20 * deg, 0.12857, 3e-5)])
def test_the_crossing_that_moves_the_centre_least(turn, ratio, within):
    """1/2 - sqrt(5)/6 = .127322 at small turns (Zhao and others 2011); Gauss-Newton steps by values and slopes of a job."""
    asked = ksd.Job(
        crossed, turn=turn, vary={"ratio": (0.05, 0.5)}, minimise=("parasitic_x_mm", "parasitic_y_mm"), link="arm",
        at=(0, 0, 0), method="conventional",
    )  # fmt: skip
    x = np.array([0.2])
    for _ in range(8):
        slope = asked.jacobian(x)[:, 0]
        x -= slope @ asked.values(x) / (slope @ slope)
    assert x[0] == pytest.approx(ratio, abs=within)


def test_the_crossing_that_turns_most_easily_is_the_middle():
    best = ksd.optimise(
        ksd.Job(
            crossed, turn=1 * deg, vary={"ratio": (0.1, 0.8)}, minimise="turn_stiffness_Nm_per_rad",
            method="conventional",
        ),
        start=[0.2],
    )  # fmt: skip
    assert best.design["ratio"] == pytest.approx(0.5, abs=1e-3)
    EI = STEEL.E * 20 * mm * (0.3 * mm) ** 3 / 12
    assert best.answers["turn_stiffness_Nm_per_rad"] == pytest.approx(2 * EI / (60 * mm), rel=2e-3)


def test_without_a_least_thickness_a_stiffened_guide_is_stiff_all_but_at_its_ends():
    """Along the leaf springs, gain over the plain guide of the same stress: 4.15 by second-order theory."""
    words = {
        "push": 10 * mm, "link": "stage", "maximise": "support_x_N_per_m", "limits": {"stress_MPa": 400},
        "method": "conventional",
    }  # fmt: skip
    best = ksd.optimise(
        ksd.Job(guide, vary={"thickness": (0.1 * mm, 0.8 * mm), "flexible": (0.06, 0.4)}, **words),
        start=[0.3 * mm, 0.1],
    )
    assert best.design["flexible"] == pytest.approx(0.06) and "flexible at its least" in best.held

    other = ksd.optimise(ksd.Job(plain_guide, vary={"thickness": (0.2 * mm, 2 * mm)}, **words))
    assert best.merit / other.merit == pytest.approx(4.17, abs=0.02)


def test_across_its_leaf_springs_stiffening_gains_little():
    """Largest stiffness across, half way along the leaf springs, over that of a plain guide of the same stress: 4 % more at
    5 mm, and nothing at 10 mm, where it ends all but plain."""
    words = {
        "link": "stage", "at": (50 * mm, 0, 0), "maximise": "support_z_N_per_m", "limits": {"stress_MPa": 400},
        "method": "conventional",
    }  # fmt: skip
    for stroke, gain, flexible in ((5 * mm, 1.04, 0.33), (10 * mm, 1.00, 0.45)):
        best = ksd.optimise(
            ksd.Job(
                guide, push=stroke, vary={"thickness": (0.1 * mm, 2 * mm), "flexible": (0.06, 0.49)}, **words
            ),
            start=[0.4 * mm, 0.25],
        )
        other = ksd.optimise(
            ksd.Job(plain_guide, push=stroke, vary={"thickness": (0.2 * mm, 2 * mm)}, **words)
        )
        assert best.merit / other.merit == pytest.approx(gain, abs=0.005)
        assert best.design["flexible"] == pytest.approx(flexible, abs=0.02)


def test_points_of_the_front_of_the_specification():
    wanted, at = {1.0283: 0.32774, 0.5565: 0.19993, 0.2: 0.07394}, BEST
    wide = job(vary={**VARY, "length": (40 * mm, 80 * mm)}, extrapolate=True)
    for moment, merit in wanted.items():
        best = ksd.optimise(wide.limited("turn_moment_Nm", moment), start=at)
        assert best.merit == pytest.approx(merit, abs=1e-4)
        at = best.design


def test_a_finer_mesh_and_many_elements_agree_on_the_optimum():
    """At the optimum itself: with fewer digits another target, of another mesh error, is the worst."""
    words = {"vary": {**VARY, "length": (40 * mm, 80 * mm)}, "method": "conventional"}
    best = ksd.optimise(job(**words), start=BEST)
    x = best.job.point(best.design)
    fine = job(**words, mesh=ksd.Mesh(orders=(6, 5, 9), points=14))
    assert fine.merit(fine.values(x)) == pytest.approx(best.merit, rel=1e-10)
    chains = job(**words, mesh=ksd.Mesh("corotational", elements=20))
    assert chains.merit(chains.values(x)) == pytest.approx(0.50370, abs=5e-6)
