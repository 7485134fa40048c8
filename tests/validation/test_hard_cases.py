"""The quick part of the bank of hard cases: right or refused with a typed error, never wrong.

All cases by all methods: `python benchmarks/hard_cases.py`.
"""

import numpy as np
import pytest
from hard_bank import CASES
from hard_classics import RODS, pushed_arm, rod
from hard_scenes import cantilever, frame
from scenes import fourbar

import ksd
from ksd.errors import ConvergenceError
from ksd.model.compile import compile_scene
from ksd.solvers.conventional import solve_conventional

QUICK = [c for c in CASES if c.quick]


def test_the_bank_is_as_large_as_it_says():
    assert len(CASES) >= 130
    assert len({c.name for c in CASES}) == len(CASES)
    assert len(QUICK) >= 15


def test_the_independent_rod_finds_what_the_bank_holds():
    load = 4.03 * np.pi**2 / 4
    assert rod(-load, 1e-4 * load) == pytest.approx(RODS[4.03], abs=1e-8)
    assert pushed_arm(20.0) == pytest.approx(RODS["following"], abs=1e-8)
    # Timoshenko and Gere 1961, table 2-3: 160 degrees
    assert RODS[4.03] == pytest.approx((-0.340, 0.625), abs=6e-4)


@pytest.mark.parametrize("case", QUICK, ids=lambda c: c.name)
def test_default_answer(case):
    """The default answers what is verified, and refuses where there is no state to believe."""

    def answer():
        if case.path is not None:
            return ksd.follow(case.build(), dict(case.targets), mesh=case.mesh, **case.path)
        return ksd.solve(case.build(), case.targets, mesh=case.mesh)

    if case.answer is None:
        with pytest.raises(ConvergenceError):
            answer()
        return
    scale = np.abs(case.answer).max() or 1.0
    assert case.value(answer()) / scale == pytest.approx(np.array(case.answer) / scale, abs=case.tolerance)


@pytest.mark.parametrize("case", [c for c in QUICK if c.path is None], ids=lambda c: c.name)
@pytest.mark.parametrize("method", ["full", "conventional"])
def test_no_method_is_wrong(case, method):
    try:
        found = ksd.solve(case.build(), case.targets, mesh=case.mesh, method=method)
    except ksd.KsdError:
        return
    assert case.answer is not None
    scale = np.abs(case.answer).max() or 1.0
    assert case.value(found) / scale == pytest.approx(np.array(case.answer) / scale, abs=case.tolerance)


def test_zero_load_for_200_steps():
    state = None
    model = compile_scene(fourbar())
    for _ in range(200):
        state = solve_conventional(model, {"top": 0.0}, start=state)
    assert state.motion.x == pytest.approx(model.rest.x, abs=1e-15)
    assert np.abs(state.motion.inner).max() < 1e-12


def states(way, method, force=0.0):
    """Displacement and rotation of the top link in units of the scene, seen in its own axes, and the force."""
    unit, turn = way.get("unit", 1.0), way.get("turn", np.eye(3))
    found = ksd.solve(frame(force=force * unit**2, **way), top=0.3 * unit, method=method, mesh=ksd.Mesh())
    shift, R = found.links["top"]
    return np.concatenate(
        [turn.T @ shift / unit, (turn.T @ R @ turn).ravel(), [found.forces["top"] / unit**2 / 500]]
    )


@pytest.mark.parametrize("force", [0.0, 100.0])
@pytest.mark.parametrize("method", ["kinematic", "full", "conventional"])
def test_units_size_place_and_orientation_do_not_matter(method, force, rng):
    """The same scene from micrometres to kilometres, a kilometre away, turned at random: the same digits to 1e-9."""
    here = states({}, method, force)
    ways = [{"unit": 1e-6}, {"unit": 1e-3}, {"unit": 1e6}, {"shift": (1e3, -1e3, 1e3)}]
    ways += [{"unit": 1e-3, "shift": (1.0, -1.0, 1.0)}]
    for _ in range(3):
        turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        ways.append({"turn": turn * np.sign(np.linalg.det(turn))})
    for way in ways:
        assert states(way, method, force) == pytest.approx(here, abs=1e-9), way


def test_a_mechanism_far_from_the_origin_is_no_larger():
    """Its size is what gaps, steps and singular values are measured by; ground was taken to reach back to the origin."""
    here, far = (compile_scene(frame(**way)).arrays.size for way in ({}, {"shift": (1e3, -1e3, 1e3)}))
    assert far == pytest.approx(here, rel=1e-9)


def test_stiff_and_soft_materials():
    """E from 1 Pa to 1e15 Pa: the shape under a load in units of EI/L^2 does not change."""
    tips = []
    for E in (1.0, 2e11, 1e15):
        scene = ksd.Mechanism("cantilever")
        tip = scene.link("tip")
        section = ksd.rectangle(0.5e-3, 0.02)
        scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), section=section,
                   material=ksd.Material(E=E, nu=0.3), width_axis="z")  # fmt: skip
        scene.load(tip, force=(0, 3 * E * section.Iz / 0.01, 0), at=(0.1, 0, 0))
        tips.append(ksd.solve(scene).links["tip"][0])
    assert tips[0] == pytest.approx(tips[1], abs=1e-10)
    assert tips[2] == pytest.approx(tips[1], abs=1e-10)


def test_a_leaf_rolled_up_too_far_for_its_points_says_so():
    E = 200e9 * ksd.rectangle(0.5e-3, 0.02).Iz
    found = ksd.solve(cantilever(moment=4 * np.pi * E / 0.1), strict=False)
    assert "quadrature points" in str(found.trust.stable)
