"""Loads that turn with their links: Newton on the unsymmetric tangent, and stability that no count of pivots tells."""

import numpy as np
import pytest
from hard_scenes import lee
from scenes import STEEL, fourbar

import ksd
from ksd.answers.nonconservative import skew_tangent
from ksd.answers.tangent import stored_matrix
from ksd.model.arrays import make_workspace
from ksd.model.compile import compile_scene
from ksd.model.newton import ROUNDING_MULTIPLE, assemble, solve_equilibrium, take_step
from ksd.numerics.blocks import factor_blocks
from ksd.section import rectangle
from ksd.solvers.conventional import solve_conventional

L, SECTION = 0.1, rectangle(0.5e-3, 0.02)
EI = STEEL.E * SECTION.Iz


def cantilever(force, *, material=STEEL, mesh=None):
    """A leaf along x with a following force (3,), in units of EI/L^2, on its tip."""
    scene = ksd.Mechanism("cantilever")
    tip = scene.link("tip")
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(L, 0, 0), section=SECTION, material=material,
               width_axis="z")  # fmt: skip
    scene.load(tip, force=tuple(np.array(force) * EI / L**2), at=(L, 0, 0), following=True)
    return compile_scene(scene, mesh=mesh)


def pushed():
    """The fourbar with three following loads, two of them on one link, off its reference point."""
    scene = fourbar()
    scene.load("left", force=(20.0, 5.0, -3.0), moment=(0.2, 0.1, 0.4), at=(-0.25, 0.2, 0.02), following=True)
    scene.load("left", force=(-7.0, 9.0, 2.0), at=(-0.2, 0.1, 0), following=True)
    scene.load("top", force=(4.0, -8.0, 1.0), at=(0.1, 0.4, 0), following=True)
    return scene


def test_the_step_is_that_of_the_unsymmetric_tangent():
    """One iteration of the compiled Newton against a dense solve with K + rest."""
    model = compile_scene(pushed())
    arrays, work, target = model.arrays, make_workspace(model.arrays), np.array([0.1])
    state = solve_conventional(model, {"top": 0.05}).motion
    one = state.copy()
    solve_equilibrium(arrays, one, target, 1.3, work, 1e-8, 1, np.inf, np.inf)
    other = state.copy()
    assemble(arrays, other, target, 1.3, work, 1e-8, 0, 0 * ROUNDING_MULTIPLE)
    full = stored_matrix(arrays, work.matrix) + skew_tangent(arrays, other, 1.3)
    step = np.linalg.solve(full, -work.rhs)
    factor_blocks(arrays.plan.ints, work.matrix, work.scaled_rows, len(arrays.plan.size))
    take_step(arrays, other, step, work, 1.0)
    assert one.x == pytest.approx(other.x, abs=1e-10)
    assert one.multiplier == pytest.approx(other.multiplier, rel=1e-8)
    assert np.abs(other.x - state.x).max() > 0.01


def test_the_step_in_the_plane_is_that_in_space():
    model = cantilever((0.3, 2.0, 0.0))
    plane = model.plane
    found = []
    for arrays in (plane.arrays, model.arrays):
        motion, work = model.rest.copy(), make_workspace(arrays)
        for _ in range(2):
            solve_equilibrium(arrays, motion, np.zeros(0), 1.0, work, 1e-8, 1, np.inf, np.inf)
        found.append(motion.x)
    assert found[0] == pytest.approx(found[1], abs=1e-12)


@pytest.mark.parametrize("planar", ["auto", False])
def test_newton_converges_quadratically(planar):
    """With the symmetric part alone the force that stays normal to the tip took 14 iterations and more."""
    found = solve_conventional(cantilever((0, 2.0, 0)), {}, planar=planar)
    assert found.iterations <= 4 and found.steps[0].note.startswith("1 load step")


def test_the_five_steps_with_following_loads():
    solver = ksd.prepare(pushed())
    full, exact = (solver(top=0.2, method=m) for m in ("full", "conventional"))
    assert full.forces["top"] == pytest.approx(exact.forces["top"], rel=1e-9)
    assert full.steps[-1].iterations <= 4
    fast = solver(top=0.2, method="reduced", relinearisations=1)
    assert abs(fast.forces["top"] - exact.forces["top"]) < 1.5 * fast.error.force[0]


def flutters(p, **ways):
    return (
        solve_conventional(cantilever((-p, 0, 0), **ways), {}).frequencies(count=8).growth_per_s.max() > 0.0
    )


@pytest.mark.parametrize("mesh", [None, ksd.Mesh("corotational", elements=8)])
def test_becks_column(mesh):
    """Beck 1952: flutter at 20.0510 EI/L^2 (here with shear and rotary inertia, t/L = 1/200), divergence never."""
    for p in (5.0, 15.0, 19.9):
        found = solve_conventional(cantilever((-p, 0, 0), mesh=mesh), {})
        assert found.stable and found.trusted and "no mode of its masses flutters" in str(found.trust.stable)
        assert found.iterations <= 2
    low, high = 18.0, 22.0
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if flutters(middle, mesh=mesh) else (middle, high)
    assert high == pytest.approx(20.0510, rel=5e-4 if mesh is None else 0.03)


def test_flutter_is_refused_with_its_frequency():
    """At the flutter load of Beck's column omega = 11.016 sqrt(EI / rho A L^4)."""
    with pytest.raises(ksd.TrustError, match="FLUTTER") as refused:
        ksd.solve(cantilever((-20.06, 0, 0)))
    modes = refused.value.result.frequencies()
    pair = np.flatnonzero(modes.growth_per_s)
    assert len(pair) == 2
    unit = np.sqrt(EI / (7800 * SECTION.A * L**4)) / (2 * np.pi)
    assert modes.frequency_Hz[pair] == pytest.approx(11.016 * unit, rel=5e-3)
    assert ksd.solve(cantilever((-20.06, 0, 0)), strict=False).converged


def test_without_mass_flutter_is_said_not_to_be_looked_at():
    found = ksd.solve(cantilever((-15.0, 0, 0), material=ksd.Material(E=STEEL.E, G=STEEL.G)))
    assert found.trusted and "flutter was not checked" in str(found.trust.stable)


def test_divergence_under_a_following_load_is_seen():
    """Lee's frame under a following force has a limit point: beyond it the state diverges."""
    path = ksd.follow(lee(following=True), control="load", until=60.0)
    assert path.limits
    top = path.limits[0]
    peak = int(np.argmax(np.array(path.factor) > 0.99 * top))
    assert all(s.stable for s in path.states[:peak])
    assert not any(s.stable for s in path.states[peak + 2 : peak + 10])
    # out of the snap it is stable again
    assert path.states[-1].stable and path.ended


def test_modes_of_a_following_load_of_nothing_are_those_without():
    bare, idle = (
        solve_conventional(cantilever((0, 1e-9 * k, 0)), {}).frequencies(count=5) for k in (0.0, 1.0)
    )
    assert idle.frequency_Hz == pytest.approx(bare.frequency_Hz, rel=1e-6)
    assert not idle.growth_per_s.any()


def test_the_verdicts_agree():
    found = ksd.solve(cantilever((-21.0, 0, 0)), strict=False)
    assert not found.stable and not found.trusted and not found.trust.stable
    assert "FLUTTER" in found.as_dict()["stability"] and found.as_dict()["stable"] is False


def test_a_column_that_flutters_is_not_said_to_diverge():
    # Beck's column flutters beyond 20.05 EI/L^2 and never diverges
    model = cantilever((-24.0, 0.0, 0.0))
    pose = ksd.solve(model, strict=False)
    said = str(pose)
    assert (
        "UNSTABLE: FLUTTER, as loads follow, at" in said and "diverges" not in said and "minima" not in said
    )
    assert "The state itself diverges" not in str(pose.buckling())
    assert str(pose.frequencies()).count("(flutter)") == 2
    with pytest.raises(ksd.TrustError, match="FLUTTER"):
        ksd.solve(model)


def test_a_path_to_where_it_starts_is_that_place():
    scene = fourbar()
    scene.load("top", force=(0.0, -3.0, 0.0), at=(0.0, 0.3, 0.0))
    path = ksd.follow(scene, {"top": 0.05}, until=0.0)
    assert path.ended and path.factor.tolist() == [0.0]
