"""Paths through limit points and bifurcations: arches, Lee's frame, a bistable beam, a column on its buckled branch."""

import numpy as np
import pytest
from hard_scenes import arch, bistable, column, lee
from random_arms import three_universal

import ksd
from ksd.errors import SceneError
from ksd.model.compile import compile_scene
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.path import follow
from ksd.units import deg

CHAIN = ksd.Mesh("corotational", elements=16)


def test_deep_arch_limit_load():
    """Acceptance A: 897 (Da Deppo and Schmidt 1975: 8.97 EI/R^2), within 0.5 %, in both leaf models."""
    assert follow(arch(107.5 * deg, hinged=False), until=1000, first=20, most=60).limits[0] == pytest.approx(
        897.0, rel=1e-3
    )
    fine = follow(arch(107.5 * deg, hinged=False, parts=2), until=1000, first=20, most=60, mesh=CHAIN)
    assert fine.limits[0] == pytest.approx(897.0, rel=5e-3)


def test_deep_arch_beyond_its_limit():
    """Past the limit the path turns back, branches, and rises again; the inertia tells which states are stable."""
    found = follow(arch(107.5 * deg, hinged=False), until=1500, first=20)
    assert found.stop.startswith("the end was reached")
    assert len(found.limits) == 2
    assert found.states[0].stable and not found.states[-1].stable
    up = [s for f, s in zip(found.factor, found.states, strict=True) if f < 897][0:4]
    assert all(s.stable for s in up)


def test_shallow_arch_snaps_through():
    """Two limit points with a valley between; strain modes and chains agree; before the first it is stable."""
    found = follow(arch(5 * deg, hinged=True), until=20000, first=20)
    chain = follow(arch(5 * deg, hinged=True), until=20000, first=20, mesh=CHAIN)
    assert len(found.limits) == len(chain.limits) >= 2
    assert chain.limits == pytest.approx(found.limits, rel=2.5e-2)
    assert found.states[-1].stable


def test_lees_frame():
    """Lee, Manuel and Rossow 1968: critical load 18.55 EI/L^2 (EI/L^2 = 1000)."""
    found = follow(lee(), until=30, first=1.0)
    chain = follow(lee(), until=30, first=1.0, mesh=ksd.Mesh("corotational", elements=24))
    assert found.limits[0] == pytest.approx(18.55, rel=5e-3)
    assert chain.limits == pytest.approx(found.limits, rel=5e-3)
    assert found.states[-1].stable


def test_lees_frame_with_a_following_load():
    found = follow(lee(following=True), until=60, first=1.0)
    chain = follow(lee(following=True), until=60, first=1.0, most=105, mesh=CHAIN)
    assert chain.limits[:2] == pytest.approx(found.limits[:2], rel=2e-2)


def test_bistable_beam():
    """Qiu's approximation for large Q: 8 pi^4 - 6 pi^4 D on the third-mode branch (D = push / h), in EI h/l^3; stable
    all along, zero force in three places."""
    scene, unit, rise = bistable()
    found = follow(scene, {"push": -2.1 * rise}, control="drives", first=0.02)
    force = -np.array([s.forces["push"] for s in found.states]) / unit
    depth = 2.1 * found.factor
    assert found.stop.startswith("the end was reached")
    assert all(s.stable for s in found.states)
    middle = (depth > 0.3) & (depth < 1.5)
    assert force[middle] == pytest.approx(np.pi**4 * (8 - 6 * depth[middle]), abs=0.05 * 8 * np.pi**4)
    assert len(np.flatnonzero(np.diff(np.sign(force[1:])))) == 2


def test_the_perfect_bistable_beam_branches_and_says_so():
    scene, _, rise = bistable(flaw=0.0)
    found = follow(scene, {"push": -0.5 * rise}, control="drives", first=0.02)
    assert found.bifurcations
    assert not found.states[-1].stable


def perfect(marks):
    """Half of a double curved beam, its middle on a slider, pushed down, with points at fractions of its length."""
    length, lean = 0.05, 0.0942
    curve = ksd.FreeCurve(length, lambda s: (0, 0, lean * np.pi * np.cos(np.pi * s) / length))
    end = tuple(curve.line(1.0)[0])
    scene = ksd.Mechanism("half", plane="xy")
    scene.leaf("ground", scene.link("shuttle"), start=(0, 0, 0), end=end, curve=curve, name="beam",
               section=ksd.rectangle(0.5e-3, 8e-3), material=ksd.Material(E=2e9, nu=0.35))  # fmt: skip
    for s in marks:
        scene.point("beam", s * length)
    scene.slider("shuttle", along="y", at=end)
    scene.load("shuttle", force=(0, -0.25, 0), at=end)
    return scene


def test_a_branch_inside_a_leaf_needs_a_point():
    """A beam that buckles between its ends tells no motion of its links; with a point on it its branch is followed, to the
    same states on both sides."""
    whole = follow(perfect(()))
    (inner,) = whole.bifurcations[:1]
    with pytest.raises(ksd.ConvergenceError, match=r"draw a point on it.*'beam'"):
        follow(perfect(()), branch=inner)
    cut = perfect((0.5,))
    (point,) = follow(cut).bifurcations[:1]
    assert point.factor == pytest.approx(inner.factor, rel=1e-3)
    ends = [follow(cut, branch=point, side=side, most=60) for side in (1, -1)]
    # Qiu: -.370 of this load for a beam of large Q, here it is 6
    assert [end.limits[0] for end in ends] == pytest.approx([-0.3396, -0.3396], rel=1e-3)


def elastica(share):
    """Shortening over length of a clamped column at `share` of its Euler load, in elliptic integrals."""
    from scipy.optimize import brentq
    from scipy.special import ellipe, ellipk

    m = brentq(lambda m: (2 * ellipk(m) / np.pi) ** 2 - share, 1e-9, 0.9)
    return 2 * (1 - ellipe(m) / ellipk(m))


def test_branch_of_a_buckled_column():
    straight = follow(column(), until=1.2, first=0.2)
    (point,) = straight.bifurcations[:1]
    assert point.factor == pytest.approx(1.0, rel=1e-3)
    for side in (1, -1):
        bent = follow(column(), branch=point, side=side, until=1.1)
        assert bent.stop.startswith("the end was reached")
        last = bent.states[-1]
        assert last.stable
        assert -last.links["top"][0][0] / 0.1 == pytest.approx(elastica(1.1), rel=4e-3)
    both = [follow(column(), branch=point, side=s, until=1.1).states[-1].links["middle"][0] for s in (1, -1)]
    assert both[0][1] == pytest.approx(-both[1][1], rel=1e-6)


def test_imperfect_column_goes_through_its_buckling_load():
    found = follow(column(1e-3), until=1.2, first=0.1)
    assert not found.turnings
    assert found.states[-1].stable
    assert -found.states[-1].links["top"][0][0] / 0.1 == pytest.approx(elastica(1.2), rel=0.02)


def test_path_and_load_steps_agree():
    model = compile_scene(column(1e-2))
    state = follow(model, until=1.0, first=0.1).states[-1]
    assert 0.0 < state.steps[-1].residual <= 1.0
    step = solve_conventional(model, {}, steps=20)
    assert state.motion.x == pytest.approx(step.motion.x, abs=1e-9)


def test_a_path_needs_a_parameter():
    scene, _, _ = bistable()
    with pytest.raises(SceneError, match="no load"):
        follow(scene)
    with pytest.raises(SceneError, match="give drive values that differ"):
        follow(scene, control="drives")
    with pytest.raises(SceneError, match="choose"):
        follow(scene, control="force")


def test_drive_values_are_keywords_or_a_mapping():
    scene, _, rise = bistable()
    mapped = follow(scene, {"push": -0.1 * rise}, control="drives", first=0.2)
    named = follow(scene, push=-0.1 * rise, control="drives", first=0.2)
    assert named.states[-1].forces == mapped.states[-1].forces
    with pytest.raises(SceneError, match="two values"):
        follow(scene, {"push": 0.1}, push=0.2, control="drives")
    with pytest.raises(SceneError, match=r"drive 'pusch' is not in .*\"push\""):
        follow(scene, pusch=0.1, control="drives")
    with pytest.raises(SceneError, match="push"):
        follow(scene, push=[0.1, 0.2], control="drives")
    with pytest.raises(SceneError, match="push"):
        follow(scene, push=[0.1, 0.2])


def test_a_path_on_a_coarse_mesh_warns_and_a_finer_one_turns():
    """Three universal joints bent and pressed by 60 N: taut leaf springs of default modes carry a quarter of their energy in
    the highest and reach the end; with more modes the path has two limit points, those of chains of 12 elements."""
    arm = three_universal()
    drives = [d.name for d in arm.scene().drives]
    targets = dict(zip(drives, np.random.default_rng(2000).uniform(-0.6, 0.6, 6).tolist(), strict=True))
    arm.load("three", force=(0, 0, -60.0), at=(0.6, 0, 0))
    coarse = follow(arm, targets)
    assert coarse.ended and not coarse.turnings
    assert "energy in its highest torsion mode" in coarse.warnings[0]
    assert coarse.warnings[0] in " ".join(str(coarse).split())
    assert not coarse.states[-1].trusted
    fine = follow(arm, targets, mesh=ksd.Mesh(orders=(8, 8, 12), points=16))
    assert fine.limits[:2] == pytest.approx((0.64, 0.60), abs=0.01)
    assert fine.states[-1].trusted
    # what following reaches is answered, and said
    found = ksd.solve(arm, targets)
    assert found.forces == pytest.approx(fine.states[-1].forces, rel=1e-5)
    assert any("past a limit point at 64 % of the loads" in note for note in found.notes)
