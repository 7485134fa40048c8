"""Critical load factors of loads that are not conservative, or act beside a link: closed forms, and the paths of solves."""

import numpy as np
import pytest
from published_divergence import (
    EI,
    SMALL,
    L,
    beck,
    beck_exactly,
    clamped,
    on_an_arm,
    on_an_arm_exactly,
    on_arms,
    own_factors,
    shaft,
)
from scenes import STEEL

import ksd
from ksd.answers.buckling import buckling
from ksd.answers.nonconservative import load_tangent, skew_tangent
from ksd.answers.tangent import assemble_tangent
from ksd.model.compile import compile_scene
from ksd.section import rectangle

MESHES = pytest.mark.parametrize(
    "mesh, error",
    [(ksd.Mesh(), 4e-3), (ksd.Mesh("corotational", elements=16), 2e-2)],
    ids=("strain", "chain"),
)


@MESHES
@pytest.mark.parametrize("arm", [0.5 * L, -0.3 * L])
def test_a_force_at_the_end_of_a_rigid_arm(mesh, error, arm):
    """cot(kL) = k c, k^2 = P/EI, for a column with a rigid bar of length c on its end (Timoshenko and Gere, 2.1). Without
    the tangent of the load at its lever the bar made no difference."""
    found, kL = on_an_arm(arm, mesh), on_an_arm_exactly(arm)
    assert found.factor[0] == pytest.approx(kL**2 * EI / L**2, rel=error)
    assert found.conservative


@MESHES
def test_greenhills_shaft(mesh, error):
    """A shaft on two bearings between torques fixed in space: M = 2 pi EI/L (Greenhill 1883; Ziegler, Principles of
    structural stability, 1968, sec. 5.2). The symmetric part of the tangent gave .78 of it."""
    found, factor = shaft(mesh)
    assert (factor.max() > 0) and (factor.min() < 0)
    assert np.abs(factor[:2]) == pytest.approx(2 * np.pi, rel=1.5 * error)
    assert not found.conservative and "flutter" in str(found) and "unsymmetric tangent" in found.criterion


@pytest.mark.parametrize("following", [False, True])
@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 0, 1)], ids=("torque", "bending"))
@MESHES
def test_a_cantilever_under_an_axial_or_tangential_moment_does_not_diverge(axis, following, mesh, error):
    """Moments fixed in space (axial) or turning with the end (tangential) leave a clamped rod no other equilibrium
    (Ziegler 1968, sec. 5.3): at a torque the symmetric part of the tangent had it buckle at pi EI/L."""
    scene, tip = clamped()
    scene.load(tip, moment=tuple(SMALL * EI / L * np.array(axis)), following=following)
    found, factor = own_factors(scene, mesh)
    assert len(factor) == 0 and np.isinf(found.positive) and np.isinf(found.negative)
    assert "no critical load factor" in found.reason and not found.conservative


@pytest.mark.parametrize("kind, expected", [("quasi", 0.5), ("semi", 1.0)])
def test_moments_of_dead_forces_on_arms(kind, expected):
    """Quasitangential moments (two forces on one arm) pi/2 EI/L, semitangential ones (four on two arms) pi EI/L (Ziegler
    1968; Argyris et al., Comp. Meth. Appl. Mech. Eng. 14, 1978): conservative."""
    found, factor = on_arms(kind)
    assert np.abs(factor[:2]) == pytest.approx(expected * np.pi, rel=3e-3)
    assert found.conservative


@MESHES
@pytest.mark.parametrize("spring", [0.0, 100.0])
def test_a_column_under_a_force_that_follows(mesh, error, spring):
    """Beck's column (1952) does not diverge. With a lateral spring c on its tip it does: EI (kL)^3/(c L^3) = kL cos kL - sin
    kL (from EI w'''' + P w'' = 0 with w'' = 0 and EI w''' = c w at the tip)."""
    added, own, factor = beck(spring, mesh)
    for found in (added, own):
        assert not found.conservative
    if not spring:
        # meshes find some far off
        far = 100 * EI / L**2
        assert np.all(np.abs(added.factor) > far) and np.all(np.abs(own.factor) * SMALL * EI / L**2 > far)
        return
    exact = beck_exactly(spring)
    assert factor[0] == pytest.approx(exact, rel=error)
    assert added.positive * L**2 / EI == pytest.approx(exact, rel=error)


def smallest(pose, factor):
    """Smallest over largest singular value of the scaled unsymmetric tangent of a state."""
    found = assemble_tangent(pose.model, pose.motion, load_factor=factor)
    K = found.matrix() + skew_tangent(found.arrays, pose.motion, factor)
    scale = 1 / np.sqrt(np.abs(K).max(axis=0))
    values = np.linalg.svd(K * np.outer(scale, scale), compute_uv=False)
    return values[-1] / values[0]


@pytest.mark.parametrize("following", [False, True])
def test_a_bent_strip_diverges_where_its_path_branches(following):
    """A strip whose tip is held laterally, bent in its plane by a moment: the factor of what may be added leads to where the
    followed path has a singular tangent, to first order in what is left of the way."""
    mesh, section = ksd.Mesh(orders=(8, 8, 8), points=12), rectangle(1e-3, 4e-3)
    scene, tip = clamped(section)
    scene.support(tip, along="z", at=(L, 0, 0))
    moment = np.array([0, 0, np.sqrt(STEEL.E * section.Iz * STEEL.G * section.J) / L])
    scene.load(tip, moment=tuple(moment), following=following)
    path = ksd.follow(scene, until=5.0, mesh=mesh)
    branch = path.bifurcations[0]
    assert smallest(branch.configuration, branch.factor) < 1e-4 * smallest(path.states[0], 0.0)
    errors = []
    for share in (0.9, 0.95):
        state = ksd.follow(scene, until=share * branch.factor, mesh=mesh).states[-1]
        found = state.buckling("tip", moment=moment, at=(L, 0, 0), following=following, count=1)
        errors.append(abs(found.positive / ((1 - share) * branch.factor) - 1))
        assert found.unstable == 0
    assert errors[1] < 5e-3 and errors[1] < 0.6 * errors[0]
    state = next(s for f, s in zip(path.factor, path.states, strict=True) if f > branch.factor)
    after = state.buckling("tip", moment=moment, at=(L, 0, 0), following=following, count=1)
    assert after.unstable == 1 and "diverges, in 1" in str(after)


@pytest.mark.parametrize("following", [False, True])
def test_the_tangent_of_a_load_is_its_derivative(following):
    """Up to half of the whole moment, [M]x/2, which the members that balance it have with the other sign."""
    from scipy.spatial.transform import Rotation

    force, moment, lever = np.array([[1.0, 2.0, -0.5], [0.3, -0.7, 0.4], [0.2, 0.1, -0.6]])
    exact, step = np.zeros((6, 6)), 1e-6
    for k in range(3):
        moved = []
        for sign in (1, -1):
            R = Rotation.from_rotvec(sign * step * np.eye(3)[k]).as_matrix()
            turn = R if following else np.eye(3)
            moved.append(np.append(turn @ force, turn @ moment + np.cross(R @ lever, turn @ force)))
        exact[:, 3 + k] = -(moved[0] - moved[1]) / (2 * step)
    x, y, z = moment + np.cross(lever, force)
    exact[3:, 3:] -= 0.5 * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    assert load_tangent(force, moment, lever, following=following) == pytest.approx(exact, abs=1e-8)


@pytest.mark.parametrize("orders", [(4, 3, 6), (5, 4, 7), (8, 8, 12)])
def test_factors_of_the_mesh_are_none(orders):
    """Beck's column has no factor of divergence; its leaf springs have one at -104 Euler loads with default orders, at
    13,400 with one mode more."""
    scene, _ = clamped(rectangle(2.5e-4, 5e-3))
    model = compile_scene(scene, mesh=ksd.Mesh(orders=orders, points=16))
    euler = np.pi**2 * STEEL.E * 5e-3 * 2.5e-4**3 / 48 / L**2
    found = buckling(model, model.rest, "tip", force=(-euler, 0, 0), at=(L, 0, 0), following=True)
    assert not len(found.factor) and found.linear_up_to > 1e3
