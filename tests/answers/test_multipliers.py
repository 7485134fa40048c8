"""Buckling multipliers: sign, the two ways of asking, and agreement with the loss of stability of real
states."""

from dataclasses import replace

import numpy as np
import pytest
from scenes import STEEL, fourbar
from scipy.sparse import csc_matrix
from scipy.spatial.transform import Rotation

import ksd
from ksd.answers.buckling import (
    buckling,
    critical_factors,
)
from ksd.answers.finer_model import finer_state
from ksd.answers.nonconservative import cross_matrix, load_tangent
from ksd.answers.tangent import assemble_and_factor
from ksd.answers.uncondensed import chain_tangent_with_stresses, uncondensed_tangents
from ksd.errors import SceneError
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.scene.load import Load
from ksd.section import rectangle
from ksd.solvers.conventional import solve_conventional

L, T, W = 0.1, 0.5e-3, 0.02
EULER = np.pi**2 * STEEL.E * W * T**3 / 12 / (4 * L**2)


def column(force=0.0):
    scene = ksd.Mechanism("column")
    tip = scene.link("tip")
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(L, 0, 0), section=rectangle(T, W), material=STEEL,
        width_axis=(0, 0, 1), name="leaf",
    )  # fmt: skip
    frozen = scene.scene()
    if force:
        frozen = replace(
            frozen, loads=(Load("push", "tip", (force, 0.0, 0.0), (0.0, 0.0, 0.0), (L, 0.0, 0.0)),)
        )
    return frozen


def test_multiplier_counts_what_may_be_added():
    """A cantilever under 60 % of its load: 40 % may be added, or the stress multiplied by 1/0.6."""
    state = solve_conventional(compile_scene(column(-0.6 * EULER)), {})
    added = state.buckling("tip", force=(-1, 0, 0), at=(L, 0, 0))
    assert added.positive == pytest.approx(0.4 * EULER, rel=2e-3)
    assert added.unstable == 0
    assert state.buckling().positive == pytest.approx(1 / 0.6, rel=1e-3)
    pulled = state.buckling("tip", force=(1, 0, 0), at=(L, 0, 0))
    assert pulled.negative == pytest.approx(-0.4 * EULER, rel=2e-3)
    assert pulled.positive == np.inf or pulled.positive > 10 * EULER


def test_the_mode_is_the_bending_of_the_tip():
    model = compile_scene(column())
    found = buckling(model, model.rest, "tip", force=(-1, 0, 0), at=(L, 0, 0))
    tip = found.shape[0, found.model.node_names.index("tip")]
    # a quarter sine: slope over deflection at the free end is pi/(2 L)
    assert np.argmax(np.abs(tip)) == 5
    assert tip[5] / tip[1] == pytest.approx(np.pi / (2 * L), rel=1e-3)


@pytest.mark.parametrize("mesh", [Mesh(), Mesh("corotational", elements=4)], ids=("strain", "chain"))
def test_stiffness_is_lost_where_the_multiplier_says(mesh):
    """A fourbar pressed down sways sideways once its drive is let go: there its drive stiffness passes
    zero."""
    scene, at = fourbar(), (0, 0.35, 0)
    rest = solve_conventional(compile_scene(scene, mesh=mesh), {"top": 0.0})
    critical = rest.buckling("top", force=(0, -1, 0), at=at, freed="top").positive
    for share in (0.97, 1.03):
        load = Load("p", "top", (0.0, -share * critical, 0.0), (0.0, 0.0, 0.0), at)
        pressed = solve_conventional(
            compile_scene(replace(scene.scene(), loads=(load,)), mesh=mesh), {"top": 0.0}
        )
        assert pressed.stable
        assert (pressed.drive_stiffness()["top"] > 0.0) == (share < 1.0)
        assert pressed.buckling("top", force=(0, -1, 0), at=at, freed="top").unstable == int(share > 1.0)


@pytest.mark.parametrize("gravity", [None, (200.0, -981.0, 300.0)], ids=("light", "heavy"))
@pytest.mark.parametrize("mesh", [Mesh(), Mesh("corotational", elements=3)], ids=("strain", "chain"))
def test_uncondensed_tangent_condenses_to_the_solver_s(mesh, gravity):
    scene = fourbar()
    scene.gravity = gravity
    scene.load("top", force=(0, -30.0, 20.0), at=(0, 0.35, 0))
    fine, state = finer_state(
        *_of(solve_conventional(compile_scene(scene, mesh=mesh, effects="all"), {"top": 0.1}, steps=4))
    )
    assert (len(fine.arrays.weight) > 0) == (gravity is not None)
    K = uncondensed_tangents(fine, state)[0].toarray()
    assert pytest.approx(K.T, abs=1e-9 * np.abs(K).max()) == K
    n = fine.arrays.plan.unknowns
    loads = np.zeros((n, 2))
    loads[[0, 7], [0, 1]] = 1.0
    expected = np.linalg.solve(K, np.vstack([loads, np.zeros((len(K) - n, 2))]))[:n]
    found = assemble_and_factor(fine, state).solve(loads)
    if mesh.leaf == "strain":
        assert found == pytest.approx(expected, rel=1e-6, abs=1e-12)
    values = np.linalg.eigvalsh(K)
    rows = len(fine.arrays.terms.start)
    wrenches = 6 * len(fine.member_names) if mesh.leaf == "strain" else 0
    assert np.sum(values < 0) == rows + wrenches


def _of(configuration):
    return configuration.model, configuration.motion


@pytest.mark.parametrize("mesh", [Mesh(), Mesh("corotational", elements=4)], ids=("strain", "chain"))
def test_what_may_be_added_to_a_deformed_pose(mesh):
    """Both leaf models at mid-stroke: stable under half of what they say may be added, unstable under all of it. (Chains
    converge from above; taken in motions alone they would buckle at 1609 N, strain-mode leaves say 4581. Without the tangent
    of the added force at its lever both were 4 % less.)"""
    scene, at = fourbar(), (0, 0.35, 0)
    bent = solve_conventional(compile_scene(scene, mesh=mesh), {"top": 0.1}, steps=4)
    critical = bent.buckling("top", at=at, force=(0, -1, 0), count=1).positive
    assert critical == pytest.approx(4581.0 if mesh.leaf == "strain" else 4892.0, rel=5e-3)
    for share in (0.5, 1.0):
        load = Load("p", "top", (0.0, -share * critical, 0.0), (0.0, 0.0, 0.0), at)
        model = compile_scene(replace(scene.scene(), loads=(load,)), mesh=mesh)
        bent = solve_conventional(model, {"top": 0.1}, start=replace(bent, model=model), planar=False)
        assert bent.stable == (share < 1.0)


@pytest.mark.parametrize("mesh", [Mesh(), Mesh("corotational", elements=3)], ids=("strain", "chain"))
def test_multipliers_beyond_linear_theory_are_left_out(mesh):
    """With its drive let go the fourbar at mid-stroke gives way to a load from above long before it buckles: of the
    linear theory chains had made 190 to 230 N, under which it is stable when the load is really put on."""
    scene, at = fourbar(), (0, 0.35, 0)
    bent = solve_conventional(compile_scene(scene, mesh=mesh), {"top": 0.1}, steps=4)
    found = bent.buckling("top", at=at, force=(0, -1, 0), freed="top")
    assert len(found.factor) == 0 and np.isinf(found.positive)
    assert found.linear_up_to == pytest.approx(72.0, rel=0.05)
    # an empty table says why
    assert str(found).count("o critical load factor up to 7") == 1 and "ksd.follow" in str(found)
    assert (
        repr(found).startswith("<Buckling: no critical load factor up to 7")
        and np.abs(found.beyond) > found.linear_up_to
    )
    described = scene.scene()
    loads = (
        Load(
            "drive",
            "top",
            (bent.forces["top"], 0.0, 0.0),
            (0.0, 0.0, 0.0),
            described.drives[0].terms[0].point,
        ),
        Load("press", "top", (0.0, -230.0, 0.0), (0.0, 0.0, 0.0), at),
    )
    model = compile_scene(replace(described, drives=(), loads=loads), mesh=mesh)
    pressed = solve_conventional(model, {}, steps=16)
    assert pressed.stable and pressed.links["top"][0][0] > 0.25
    # where links hardly move, nothing is left out
    assert bent.buckling("top", at=at, force=(0, -1, 0), count=1).linear_up_to > 1e4


def test_stresses_eliminated_give_back_the_tangent_of_chains():
    mesh = Mesh("corotational", elements=3)
    fine, state = finer_state(
        *_of(solve_conventional(compile_scene(fourbar(), mesh=mesh), {"top": 0.1}, steps=4))
    )
    K = uncondensed_tangents(fine, state)[0].toarray()
    mixed, n = chain_tangent_with_stresses(fine, state, K).toarray(), len(K)
    back = mixed[:n, :n] - mixed[:n, n:] @ np.linalg.solve(mixed[n:, n:], mixed[n:, :n])
    assert back == pytest.approx(K, abs=1e-9 * np.abs(K).max())
    # without stress the motions are stiff through B alone
    free = finer_state(compile_scene(fourbar(), mesh=mesh), compile_scene(fourbar(), mesh=mesh).rest)
    still = uncondensed_tangents(*free)[0].toarray()
    left = chain_tangent_with_stresses(*free, still).toarray()[:n, :n]
    rows = fine.arrays.terms.start
    assert np.delete(np.delete(left, rows, 0), rows, 1) == pytest.approx(0.0, abs=1e-9 * np.abs(still).max())


def test_wrong_words_are_refused():
    model = compile_scene(column())
    with pytest.raises(SceneError, match="no stress"):
        buckling(model, model.rest)
    with pytest.raises(SceneError, match="not zero"):
        buckling(model, model.rest, "tip")
    with pytest.raises(SceneError, match="'top' is not part"):
        buckling(model, model.rest, "top", force=(1, 0, 0))


@pytest.mark.parametrize("kind", ["strain", "chain"])
def test_springs_take_part(kind):
    """A column that is held at its free end by a coil spring across it: from P = pi^2 EI/(4 L^2) up to where
    tan(kL) = kL - (kL)^3 EI/(c L^3) (Timoshenko and Gere, Theory of elastic stability, 2.7)."""
    from scipy.optimize import brentq

    EI = STEEL.E * W * T**3 / 12
    scene = ksd.Mechanism("propped")
    tip = scene.link("tip")
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(L, 0, 0), section=rectangle(T, W), material=STEEL,
        width_axis=(0, 0, 1), name="leaf",
    )  # fmt: skip
    # from so far away that its direction does not turn
    scene.spring(
        scene.ground, tip, start=(L, 100 * L, 0), end=(L, 0, 0), stiffness=5 * EI / L**3, free_length=100 * L
    )
    mesh = Mesh() if kind == "strain" else Mesh("corotational", elements=16)
    state = solve_conventional(compile_scene(scene.scene(), mesh=mesh), {})
    found = state.buckling("tip", at=(L, 0, 0), force=(-1, 0, 0))
    kL = brentq(lambda x: np.sin(x) - np.cos(x) * (x - x**3 / 5), 0.5 * np.pi + 1e-6, np.pi)
    assert found.positive == pytest.approx(kL**2 * EI / L**2, rel=2e-3)
    # and under 60 % of that, from the stresses of the state
    scene.load(tip, force=(-0.6 * kL**2 * EI / L**2, 0, 0), at=(L, 0, 0))
    state = solve_conventional(compile_scene(scene.scene(), mesh=mesh), {})
    assert state.buckling().positive == pytest.approx(1 / 0.6, rel=2e-3)


@pytest.mark.parametrize("mesh", [Mesh(), Mesh("corotational", elements=3)], ids=("strain", "chain"))
def test_the_smallest_of_either_sign_is_found(mesh):
    """At a large stroke the smallest multipliers are all negative; the positive one is the same however many are asked."""
    state = solve_conventional(compile_scene(fourbar(), mesh=mesh), {"top": 0.28}, steps=3)
    few, many = state.buckling(count=2), state.buckling(count=24)
    assert np.all(many.factor[:2] < 0.0) and np.isfinite(few.positive)
    assert few.positive == pytest.approx(many.positive, rel=1e-6)
    assert few.negative == pytest.approx(many.negative, rel=1e-6)
    assert np.all(np.diff(np.abs(few.factor)) >= 0.0)


def held_by_three_leaves(rng):
    """A stage on three leaf springs in any directions, which press each other, driven a little."""
    scene = ksd.Mechanism("three leaves")
    stage = scene.link("stage")
    for _ in range(3):
        start = rng.uniform(-0.04, 0.04, 3)
        end = start + np.array([0.02, 0.1, 0.0]) + rng.uniform(-0.03, 0.03, 3)
        width = np.cross(end - start, rng.normal(size=3))
        section = rectangle(rng.uniform(3e-4, 8e-4), rng.uniform(5e-3, 2e-2))
        scene.leaf(
            scene.ground, stage, start=start, end=end, section=section, material=STEEL, width_axis=width
        )
    scene.actuate(stage, along=rng.normal(size=3), at=(0.02, 0.1, 0.0), name="d")
    return scene


def test_the_mesh_error_is_that_of_the_factor():
    """Of the least factor, against five more modes per axis."""
    errors, told = [], []
    for seed in range(5, 16):
        scene = held_by_three_leaves(np.random.default_rng(seed))
        pose = ksd.solve(scene, d=3e-4, strict=False)
        nx, ny, nz = pose.model.mesh.orders
        fine = Mesh(orders=(nx + 5, ny + 5, nz + 5), points=max(nx, nz) + 8)
        found, better = (
            p.buckling(count=1) for p in (pose, ksd.solve(scene, d=3e-4, mesh=fine, strict=False))
        )
        least = int(np.argmin(np.abs(found.factor)))
        errors.append(np.abs(found.factor[least] / better.factor - 1.0).min())
        told.append(found.mesh_error[least])
    errors, told = np.array(errors), np.array(told)
    assert errors.max() < 7e-3 and errors.max() > 5e-4
    assert np.all(errors < told + 5e-4) and np.all(told < 6.0 * errors + 1e-4)


@pytest.mark.parametrize(("stiffness", "force"), [(1.0, 1.0), (2.0, 3.0), (0.7, 1.0), (3.0, 3.0)])
def test_a_mode_that_bends_no_leaf_spring_has_no_mesh_error(stiffness, force):
    """A rigid pendulum on a torsion spring, beside a leaf spring: k / (F a)."""
    scene = ksd.Mechanism("pendulum", plane="xy")
    rod, other = scene.links("rod", "other")
    scene.pin(scene.ground, rod, at=(0, 0, 0))
    scene.turn_spring(scene.ground, rod, at=(0, 0, 0), axis="z", stiffness=stiffness)
    scene.leaf(scene.ground, other, start=(1, 0, 0), end=(1.1, 0, 0), section=rectangle(T, W), material=STEEL)
    found = ksd.solve(scene).buckling("rod", at=(0, 0.1, 0), force=(0, -force, 0))
    assert found.positive == pytest.approx(stiffness / (0.1 * force), rel=1e-6)
    assert found.mesh_error == pytest.approx(0.0, abs=1e-9)


def test_a_critical_load_and_its_error_are_printed():
    model = compile_scene(column())
    found = buckling(model, model.rest, "tip", force=(-1, 0, 0), at=(L, 0, 0), count=2)
    assert str(found).count("under 0.05 %") == 2
    assert abs(found.factor[1] / (9 * EULER) - 1.0) < 2e-3
    chain = compile_scene(column(), mesh=Mesh("corotational", elements=4))
    found = buckling(chain, chain.rest, "tip", force=(-1, 0, 0), at=(L, 0, 0))
    assert np.isnan(found.mesh_error).all() and " - " in str(found)


def test_a_change_of_nothing_but_rounding_has_no_factors(rng):
    """Whose vectors, and with them the residual, depend on the linear algebra of the machine."""
    K = csc_matrix(np.diag(10.0 ** rng.uniform(-6, 6, 20)))
    noise = rng.normal(size=(20, 20)) * np.sqrt(np.outer(K.diagonal(), K.diagonal())) * 1e-14
    factor, shapes, largest, error = critical_factors(K, csc_matrix(noise + noise.T), 3, rounding=1e-9)
    assert factor.size == 0 and shapes.shape == (20, 0) and 0.0 < largest < 1e-9 and error == 0.0
    assert critical_factors(K, csc_matrix(noise + noise.T), 3)[0].size >= 1


@pytest.mark.parametrize("following", [False, True], ids=["dead", "following"])
def test_the_tangent_of_a_load_is_the_derivative_of_its_generalised_force(following, rng):
    """Central differences of the virtual work in a displacement and a rotation vector, whose spin is (1 + theta x / 2) its
    rate to first order."""
    force, moment, point = rng.normal(size=(3, 3))

    def generalised(q):
        R = Rotation.from_rotvec(q[3:]).as_matrix()
        F, M = (R @ force, R @ moment) if following else (force, moment)
        spin = np.eye(3) + 0.5 * cross_matrix(q[3:])
        return np.concatenate([F, spin.T @ (np.cross(R @ point, F) + M)])

    steps = 1e-5 * np.eye(6)
    slopes = np.array([generalised(-s) - generalised(s) for s in steps]).T / 2e-5
    assert load_tangent(force, moment, point, following=following) == pytest.approx(slopes, abs=1e-9)
