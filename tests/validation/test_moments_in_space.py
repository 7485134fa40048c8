"""Moments fixed in space and loads that follow against a rod integrated on its own, and against differences of solves."""

import numpy as np
import pytest
from scenes import STEEL, fourbar, single_joint
from scipy.integrate import solve_ivp
from scipy.optimize import fsolve
from scipy.spatial.transform import Rotation

import ksd
from ksd.answers.nonconservative import skew_tangent
from ksd.answers.tangent import assemble_and_factor, exact_tangent_arrays, stored_matrix
from ksd.model.arrays import make_workspace
from ksd.model.compile import compile_scene
from ksd.model.newton import assemble, move_nodes, take_step
from ksd.section import rectangle
from ksd.solvers.conventional import solve_conventional
from ksd.solvers.nonconservative_stability import MAX_DAMPED_SKEW_SHARE
from ksd.study.state_space import state_space

L, SECTION = 0.1, rectangle(0.5e-3, 0.02)
EI = STEEL.E * SECTION.Iz
SIZE = np.array([1, 1, 1, L, L, L])
AXIAL = STEEL.E * SECTION.A * np.array([1.0, 0, 0]) + STEEL.G * SECTION.A * np.array(
    [0, SECTION.ky, SECTION.kz]
)
BENDING = np.array([STEEL.G * SECTION.J, STEEL.E * SECTION.Iy, EI])


def bent(moment, *, force=(0.0, 0.0, 0.0), following=False, section=SECTION):
    """A leaf along x with a moment and a force on its tip, in units of EI/L and EI/L^2 of `section`."""
    scene = ksd.Mechanism("leaf")
    tip = scene.link("tip")
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(L, 0, 0), section=section, material=STEEL, width_axis="z"
    )
    unit = STEEL.E * section.Iz / L
    scene.load(tip, moment=tuple(unit * np.array(moment)), force=tuple(unit / L * np.array(force)), at=(L, 0, 0),
               following=following)  # fmt: skip
    return compile_scene(scene)


def _cross(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0.0]])


def rod_tip(force, moment):
    """Tip (3,) and orientation (3, 3) of the rod under a force and a moment fixed in space (shooting for the clamp)."""

    def rates(s, y, clamp):
        R = y[3:].reshape(3, 3)
        strain = R.T @ force / AXIAL + [1.0, 0, 0]
        return np.append(R @ strain, (R @ _cross(R.T @ (clamp - np.cross(y[:3], force)) / BENDING)).ravel())

    def end(clamp):
        first = np.append(np.zeros(3), np.eye(3))
        return solve_ivp(rates, (0, L), first, args=(clamp,), rtol=1e-11, atol=1e-13, method="DOP853").y[
            :, -1
        ]

    clamp = moment
    if np.any(force):
        clamp = fsolve(lambda m: m - np.cross(end(m)[:3], force) - moment, moment, xtol=1e-13)
    found = end(clamp)
    return found[:3], found[3:].reshape(3, 3)


def rod_compliance(moment):
    """Compliance (6, 6) of the tip by central differences of the integrated rod."""
    found, unit = np.zeros((6, 6)), np.array([EI / L**2] * 3 + [EI / L] * 3)
    for k in range(6):
        step = 1e-4 * unit * (np.arange(6) == k)
        (one, R), (other, T) = (rod_tip(s * step[:3], moment + s * step[3:]) for s in (1, -1))
        found[:3, k] = (one - other) / (2 * step[k])
        found[3:, k] = Rotation.from_matrix(R @ T.T).as_rotvec() / (2 * step[k])
    return found


def rod_determinant(moment, frequency):
    """Zero at an eigenfrequency [Hz] of the rod bent by a moment fixed in space, all its perturbations integrated."""
    squared, line = (2 * np.pi * frequency) ** 2, STEEL.density * SECTION.A
    polar = STEEL.density * np.array([SECTION.Iy + SECTION.Iz, SECTION.Iy, SECTION.Iz])

    def rates(s, y):
        R, rest = y[:9].reshape(3, 3), y[9:].reshape(12, 6)
        u, phi, n, m = rest[:3], rest[3:6], rest[6:9], rest[9:]
        along = R[:, 0]
        du = -_cross(along) @ phi + R @ ((R.T @ n) / AXIAL[:, None])
        dphi = R @ ((R.T @ (m - _cross(moment).T @ phi)) / BENDING[:, None])
        dn = -squared * line * u
        dm = -_cross(along) @ n - squared * R @ (polar[:, None] * (R.T @ phi))
        return np.concatenate(
            [(R @ _cross(R.T @ moment / BENDING)).ravel(), du.ravel(), dphi.ravel(), dn.ravel(), dm.ravel()]
        )

    # columns: the wrench at the clamp
    first = np.zeros((12, 6))
    first[6:] = np.eye(6)
    start = np.concatenate([np.eye(3).ravel(), first.ravel()])
    end = solve_ivp(rates, (0, L), start, rtol=1e-9, atol=1e-12, method="DOP853").y[9:, -1].reshape(12, 6)
    return np.linalg.det(end[6:])


@pytest.mark.parametrize("degrees", [60, 90, 180])
def test_stiffness_and_frequencies_under_a_moment_are_those_of_an_integrated_rod(degrees):
    """Without the skew part of the tangent the stiffness along z, rx, ry was 1 % (60) to 37 % (180 degrees) off."""
    moment = np.array([0, 0, np.deg2rad(degrees) * EI / L])
    pose = solve_conventional(bent((0, 0, np.deg2rad(degrees))), {})
    found, exact = pose.stiffness("tip", at=(L, 0, 0)), rod_compliance(moment) * np.outer(SIZE, SIZE)
    assert found.compliance * np.outer(SIZE, SIZE) == pytest.approx(exact, abs=1e-6 * np.abs(exact).max())
    assert not found.conservative and "not symmetric" in " ".join(str(found).split())
    assert found.matrix() @ found.compliance == pytest.approx(np.eye(6), abs=1e-9)
    assert np.abs(exact - exact.T).max() > 0.02 * np.abs(exact).max()
    for f in pose.frequencies(count=3).frequency_Hz:
        near = [rod_determinant(moment, f * (1 + e)) for e in (-1e-3, 1e-3)]
        assert near[0] * near[1] < 0.0


def test_a_moment_across_the_plane_and_a_force_are_those_of_the_rod():
    """A leaf turned in space, by a slender rod with a force too."""
    moment, force = np.array([0.2, 0.3, 0.8]) * EI / L, np.array([0.3, 0.4, 0.2]) * EI / L**2
    pose = solve_conventional(bent((0.2, 0.3, 0.8), force=(0.3, 0.4, 0.2)), {})
    x, R = rod_tip(force, moment)
    assert pose.links["tip"][0] == pytest.approx(x - [L, 0, 0], abs=1e-6 * L)
    assert pose.links["tip"][1] == pytest.approx(R, abs=1e-6)


@pytest.mark.parametrize("following", [False, True])
def test_the_tangent_is_the_derivative_of_the_residual(following):
    """K and its skew part together, against differences of the residual, at an equilibrium with turned links."""
    model = turned_arm(following)
    state, arrays = solve_conventional(model, {"turn": 0.4}).motion, exact_tangent_arrays(model)
    work = make_workspace(arrays)
    aim = np.array([0.4]), 1.0, work, 1e-8, 0, 10.0
    assemble(arrays, state, *aim)
    tangent = stored_matrix(arrays, work.matrix) + skew_tangent(arrays, state, 1.0)
    assert np.abs(tangent - tangent.T).max() > 0.1
    # leaf springs at their own equilibrium for the moved nodes: the condensed tangent is that of the nodes alone
    for k in range(*model_unknowns(model, "tip")):
        moved, step = [], 1e-6 * (np.arange(len(tangent)) == k)
        for sign in (1.0, -1.0):
            motion = state.copy()
            move_nodes(arrays, motion, step, sign)
            for _ in range(6):
                assemble(arrays, motion, *aim)
                work.rhs[:] = 0.0
                take_step(arrays, motion, work.rhs, work, 1.0)
            assemble(arrays, motion, *aim)
            moved.append(work.rhs.copy())
        column = (moved[0] - moved[1]) / 2e-6
        scale = np.abs(tangent[:, k]).max()
        assert column == pytest.approx(tangent[:, k], abs=1e-5 * scale)


def turned_arm(following):
    """A cross flexure, driven, with a moment in space and a force on its tip."""
    scene = single_joint()
    scene.load("tip", moment=(0.5, 0.3, 1.0), force=(3.0, -2.0, 5.0), at=(0.05, 0.01, 0), following=following)
    return compile_scene(scene, mesh=ksd.Mesh())


def model_unknowns(model, link):
    start = int(model.arrays.start[model.node_names.index(link)])
    return start, start + 6


@pytest.mark.parametrize("following", [False, True])
def test_stiffness_is_that_of_differences_of_solves(following):
    """The stiffness between two drives, column by column."""
    base = two_drives(following)
    pose = solve_conventional(
        compile_scene(base, mesh=ksd.Mesh("corotational", elements=12)), {"lift": 2e-3, "tilt": 0.2}
    )
    found = pose.drive_stiffness()
    step = {"lift": 1e-5, "tilt": 1e-4}
    for k, name in enumerate(found.names):
        force = []
        for sign in (1, -1):
            targets = {**pose.targets, name: pose.targets[name] + sign * step[name]}
            force.append(solve_conventional(pose.model, targets, start=pose, rtol=1e-12).forces)
        column = [(force[0][n] - force[1][n]) / (2 * step[name]) for n in found.names]
        assert found.matrix[:, k] == pytest.approx(column, rel=1e-6)
    assert abs(found.matrix[0, 1] / found.matrix[1, 0] - 1.0) > 0.01
    assert not found.conservative and "not symmetric" in " ".join(str(found).split())


def two_drives(following):
    """A leaf whose end is lifted and tilted, with a moment and a force that make its tangent unsymmetric."""
    scene = ksd.Mechanism("two drives")
    tip = scene.link("tip")
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(L, 0, 0), section=rectangle(1e-3, 1.5e-3), material=STEEL,
               width_axis="z")  # fmt: skip
    scene.actuate(tip, along="z", at=(L, 0, 0), name="lift")
    scene.actuate(tip, about="x", name="tilt")
    scene.load(tip, moment=(0.05, 0.2, 0.3), force=(1.0, 2.0, 1.0), at=(L, 0, 0), following=following)
    return scene


@pytest.mark.parametrize("degrees", [120, 220, 270, 330])
@pytest.mark.parametrize("axis", [(0.2, 0.0, 1.0), (0.0, 1.0, 0.1)])
def test_moments_fixed_in_space_are_solved_in_space(degrees, axis):
    """With the symmetric part alone there was no convergence beyond 210 degrees."""
    model = bent(np.deg2rad(degrees) * np.array(axis), section=rectangle(1e-3, 1.5e-3))
    assert solve_conventional(model, {}, planar=False).converged


def test_newton_converges_quadratically_under_a_moment():
    model = bent(np.deg2rad(60.0) * np.array([0.3, 0.2, 1.0]), section=rectangle(1e-3, 1.5e-3))
    found = solve_conventional(model, {}, steps=2)
    assert found.steps[0].iterations <= 12


def test_the_answer_names_its_criterion():
    """A small share of the skew part is left to damping; a larger one has its modes looked at; both say so."""
    for moment, words in ((1e-4, "damping ratio"), (1.0, "no mode of its masses flutters")):
        pose = ksd.solve(bent((0, 0, moment)))
        assert pose.stable and pose.trusted
        said = str(pose.trust.stable)
        assert words in said and "not conservative" in said and "positive definite" in said
        share = assemble_and_factor(*pose.unreduced_state).skew_share()
        assert (share <= MAX_DAMPED_SKEW_SHARE) == (words == "damping ratio")
    assert "not conservative" in " ".join(str(pose.frequencies(count=2)).split())


def test_a_round_rod_flutters_under_a_twisting_moment():
    """Ziegler: a rod of equal bending stiffnesses flutters under any dead twisting moment at its free end."""
    model = bent((0.5, 0, 0), section=rectangle(1e-3, 1e-3))
    pose = solve_conventional(model, {})
    assert not pose.stable and "FLUTTER" in str(pose.trust.stable)
    with pytest.raises(ksd.TrustError, match="FLUTTER"):
        ksd.solve(model)


def test_both_ways_to_modes_that_grow_agree():
    """Arnoldi iteration and the dense eigensolution, conjugate pairs among them."""
    scene = fourbar()
    scene.load("top", moment=(1.0, 3.0, 40.0), at=(0, 0.4, 0))
    pose = solve_conventional(compile_scene(scene), {"top": 0.2})
    one, other = (pose.frequencies(count=5, dense=dense) for dense in (True, False))
    assert one.frequency_Hz == pytest.approx(other.frequency_Hz, rel=1e-7)


def test_a_state_space_model_of_modes_is_refused():
    """Its modes are not orthogonal, and its static compliance is not symmetric."""
    pose = solve_conventional(compile_scene(two_drives(False)), {"lift": 2e-3, "tilt": 0.2})
    with pytest.raises(ksd.SceneError, match="not conservative"):
        state_space(pose, modes=2)
