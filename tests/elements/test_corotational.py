"""The corotational chain of paper 1, Appendix A: derivatives, known rods, refusals, near configuration."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from scipy.linalg import expm

from ksd.elements import corotational as chain
from ksd.elements import corotational_values as setup
from ksd.elements.corotational_linearised import condense_linearised
from ksd.elements.strain_values import GRAVITY_BLOCK_SIZE
from ksd.numerics.rotations import rotation_exp, rotation_log

pytestmark = pytest.mark.plain

L = 0.1
LEAF = setup.ElementSection(E=200e9, G=76.9e9, A=3e-5, J=0.98e-11, Iy=2.25e-9, Iz=2.5e-12, ky=5 / 6, kz=5 / 6)
SCRATCH = np.empty((6, 6)), np.empty((6, 12))
SLENDER = setup.ElementSection(E=1.0, G=0.4, A=1e9, J=2.0, Iy=2.0, Iz=1.0, ky=1.0, kz=1.0)


def exp(v):
    R = np.empty((3, 3))
    rotation_exp(np.asarray(v, float), R)
    return R


def log(R):
    v = np.empty(3)
    rotation_log(np.ascontiguousarray(R), v)
    return v


class Leaf:
    """One chain clamped at p, with its state."""

    def __init__(self, section, length, n, *, mip=1, curve=None):
        self.value = setup.chain_values(section, length, n, curve)
        self.number = np.array([n, mip])
        self.size = length
        self.inner = setup.undeformed_inner(self.value, self.number)
        self.store = np.zeros(setup.sizes(n).store)
        self.d, self.Q = setup.undeformed_end(self.value, self.number)
        self.lam, self.K = np.zeros(12), np.zeros((6, 6))

    def condense(self, status=0):
        args = self.value, self.number, self.inner, self.store, self.d, self.Q, self.lam, self.K
        found = chain.condense(*args)
        assert found[3] == status
        return found

    def move(self, xi, scale=1.0):
        chain.recover(self.value, self.number, self.inner, self.store, xi, scale)
        self.d = self.d + scale * xi[:3]
        self.Q = exp(scale * xi[3:]) @ self.Q

    def settle(self, iterations=12):
        """Converge the inner nodes at the present end pose."""
        for _ in range(iterations):
            self.condense()
            self.move(np.zeros(6))
        return self.condense()

    def bring(self, goal, steps=10):
        """Move end q by translation goal[:3] and the rotation vector goal[3:] in equal steps; settle."""
        for _ in range(steps):
            self.condense()
            self.move(np.asarray(goal, float) / steps)
        return self.settle()

    def load(self, wrench, steps=1, iterations=40, tolerance=1e-11):
        """Newton on end q until lam equals the wrench (6,)."""
        for step in range(1, steps + 1):
            target = np.asarray(wrench, float) * step / steps
            for _ in range(iterations):
                self.condense()
                xi = np.linalg.solve(self.K, target - self.lam[:6])
                self.move(xi)
                if max(np.abs(xi[3:]).max(), np.abs(xi[:3]).max() / self.size) < tolerance:
                    break
            else:
                pytest.fail(f"no equilibrium at load step {step}")


def sample(seed, n, mip=0):
    """A leaf in a random state of large bending, twist and shear."""
    rng = np.random.default_rng(seed)
    leaf = Leaf(LEAF, L, n, mip=mip)
    angle = rng.uniform(-0.5, 0.5, 3) * [0.5, 0.2, 1.5]
    shift = L * np.array([-0.05, 0.45 * angle[2], -0.45 * angle[1]])
    leaf.bring(np.concatenate([shift, angle]))
    return leaf


@pytest.mark.parametrize("n", [1, 2, 4])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_tangent_is_the_symmetric_derivative_of_the_force(n, seed):
    leaf = sample(seed, n)
    K = leaf.K.copy()
    m = leaf.lam[3:6].copy()
    start = leaf.d, leaf.Q, leaf.inner.copy()
    derivative = np.empty((6, 6))
    for j in range(6):
        xi = np.zeros(6)
        xi[j] = 1e-6 * (L if j < 3 else 1.0)
        ends = []
        for sign in (1.0, -1.0):
            leaf.d, leaf.Q = start[0] + sign * xi[:3], exp(sign * xi[3:]) @ start[1]
            leaf.inner[:] = start[2]
            leaf.settle(4)
            ends.append(leaf.lam[:6].copy())
        derivative[:, j] = (ends[0] - ends[1]) / (2 * xi[j])
    scale = np.sqrt(np.abs(np.diag(K)))
    error = (0.5 * (derivative + derivative.T) - K) / np.outer(scale, scale)
    assert np.abs(error).max() < 1e-7
    # the chart is symmetric up to half the moment, the commutator of spatial increments
    skew = 0.5 * (derivative - derivative.T)
    half = 0.5 * np.array([[0, -m[2], m[1]], [m[2], 0, -m[0]], [-m[1], m[0], 0]])
    assert np.abs(np.abs(skew[3:, 3:]) - np.abs(half)).max() < 1e-5 * np.abs(K[3:, 3:]).max()


@pytest.mark.parametrize("mip", [0, 1])
def test_inner_nodes_converge_faster_than_linearly(mip):
    leaf = sample(6, 4, mip)
    leaf.move(np.array([-0.0002, 0.001, 0.0002, 0.02, 0.01, 0.1]))
    errors = []
    for _ in range(6):
        errors.append(leaf.condense()[2])
        leaf.move(np.zeros(6))
    assert errors[0] > 1e-3 and errors[-1] < 1e-8
    assert errors[2] < 1e-2 * errors[1] < 1e-4 * errors[0] / errors[1] * errors[0]
    assert np.allclose(leaf.lam[:6], leaf.lam[6:], rtol=1e-6, atol=1e-6)


def test_both_tangents_find_the_same_state():
    a, b = sample(5, 4, mip=0), sample(5, 4, mip=1)
    assert np.allclose(a.lam[:6], b.lam[:6], rtol=1e-9, atol=1e-6)
    assert np.allclose(a.K, b.K, rtol=1e-6, atol=1e-6 * np.abs(a.K).max())


def test_scaled_update_moves_everything_by_the_scale():
    whole, half = Leaf(LEAF, L, 3), Leaf(LEAF, L, 3)
    xi = np.array([0, 1e-6, 0, 0, 0, 2e-5])
    for leaf, scale in ((whole, 1.0), (half, 0.5)):
        leaf.condense()
        leaf.move(xi, scale)
    rest = Leaf(LEAF, L, 3).inner
    assert np.allclose(half.inner - rest, 0.5 * (whole.inner - rest), rtol=1e-4, atol=1e-10)


@pytest.mark.parametrize("n", [1, 3])
def test_small_loads_give_the_timoshenko_cantilever(n):
    leaf = Leaf(LEAF, L, n)
    leaf.condense()
    E, G, A = LEAF.E, LEAF.G, LEAF.A
    C = np.linalg.inv(leaf.K)
    assert C[0, 0] == pytest.approx(L / (E * A), rel=1e-9)
    assert C[3, 3] == pytest.approx(L / (G * LEAF.J), rel=1e-9)
    assert C[1, 1] == pytest.approx(L**3 / (3 * E * LEAF.Iz) + L / (LEAF.ky * G * A), rel=1e-9)
    assert C[2, 2] == pytest.approx(L**3 / (3 * E * LEAF.Iy) + L / (LEAF.kz * G * A), rel=1e-9)
    assert C[5, 1] == pytest.approx(L**2 / (2 * E * LEAF.Iz), rel=1e-9)
    assert C[4, 2] == pytest.approx(-(L**2) / (2 * E * LEAF.Iy), rel=1e-9)


def test_axial_stiffness_is_EA_over_L():
    leaf = Leaf(LEAF, L, 5)
    leaf.load([1000.0, 0, 0, 0, 0, 0])
    assert leaf.d[0] - L == pytest.approx(1000.0 * L / (LEAF.E * LEAF.A), rel=1e-9)


@pytest.mark.parametrize("axis", [1, 2])
def test_end_moment_closes_a_circle(axis):
    """Acceptance A: moment 2 pi EI/L, n = 10, tip back at the origin within 1e-9 L."""
    leaf = Leaf(LEAF, L, 10)
    moment = np.zeros(6)
    moment[3 + axis] = 2 * np.pi * LEAF.E * (LEAF.Iy if axis == 1 else LEAF.Iz) / L
    leaf.load(moment, steps=20)
    assert np.abs(leaf.d).max() < 1e-9 * L
    assert np.abs(leaf.Q - np.eye(3)).max() < 1e-9


def test_elastica_in_a_tilted_plane_converges_with_order_two():
    """Acceptance A: dead transverse load P L^2/EI = 5; the section is round in bending, so any plane does."""
    section = SLENDER._replace(Iy=1.0)
    across = np.array([0.0, 0.6, 0.8])
    errors = []
    for n in (8, 16, 32):
        leaf = Leaf(section, 1.0, n)
        leaf.load(np.concatenate([5.0 * across, np.zeros(3)]), steps=4)
        angle = np.arccos(leaf.Q[0, 0])
        found = leaf.d @ across, 1.0 - leaf.d[0], angle
        errors.append(np.abs(np.array(found) - [0.71379152, 0.38762836, 1.21536812]).max())
    rates = np.log2(np.array(errors[:-1]) / errors[1:])
    assert np.allclose(rates, 2.0, atol=0.1)
    assert errors[-1] < 1e-3


def arc_nodes(curvature, length, n):
    """Nodes of a leaf of constant curvature (3,) at rest: the exact helix, by the exponential of a rigid motion."""
    x, y, z = curvature
    along = np.array([[0, -z, y, 1], [z, 0, -x, 0], [-y, x, 0, 0], [0, 0, 0, 0]])
    poses = np.array([expm(s * along) for s in np.linspace(0, length, n + 1)])
    return poses[:, :3, 3], poses[:, :3, :3]


def test_forty_five_degree_bend():
    """Acceptance A: R = 100, unit square, E = 1e7, nu = 0, tip load 600; tip (15.685, 47.150, 53.475).

    The literature takes the polar moment 1/6 for J and no shear factor.
    """
    square = setup.ElementSection(E=1e7, G=5e6, A=1.0, J=1 / 6, Iy=1 / 12, Iz=1 / 12, ky=1.0, kz=1.0)
    tips = []
    for n in (8, 16):
        curve = arc_nodes(np.array([0, 0, 0.01]), 25 * np.pi, n)
        leaf = Leaf(square, 25 * np.pi, n, curve=curve)
        leaf.load([0, 0, 600.0, 0, 0, 0], steps=6)
        tips.append(leaf.d[[1, 0, 2]])
    assert np.allclose(tips[0], [15.79, 47.23, 53.37], atol=0.5)
    assert np.allclose((4 * tips[1] - tips[0]) / 3, [15.685, 47.150, 53.475], atol=0.02)


def test_undeformed_curved_leaf_is_free_of_force():
    curve = arc_nodes(np.array([3.0, -4.0, 9.0]), L, 4)
    leaf = Leaf(LEAF, L, 4, curve=curve)
    assert np.allclose(leaf.d, curve[0][-1], atol=1e-15)
    leaf.condense()
    assert np.abs(leaf.lam).max() < 1e-7
    assert chain.energy(leaf.value, leaf.number, leaf.inner, leaf.d, leaf.Q) < 1e-20


def test_energy_is_the_work_of_the_end_force():
    leaf = sample(7, 4)
    start = chain.energy(leaf.value, leaf.number, leaf.inner, leaf.d, leaf.Q)
    goal = np.array([-0.002, 0.01, 0.001, 0.1, 0.05, 0.2])
    points, steps = 20, []
    for _ in range(points + 1):
        leaf.settle(5)
        steps.append(leaf.lam[:6] @ goal / points)
        leaf.condense()
        leaf.move(goal / points)
    leaf.d, leaf.Q = leaf.d - goal[:3] / points, exp(-goal[3:] / points) @ leaf.Q
    leaf.settle()
    simpson = np.array([1, *([4, 2] * (points // 2))[:-1], 1]) / 3
    stored = chain.energy(leaf.value, leaf.number, leaf.inner, leaf.d, leaf.Q)
    assert simpson @ steps == pytest.approx(stored - start, rel=1e-6)


@pytest.mark.parametrize(
    "turn", [[0, 0, 1.1], [0, -1.1, 0], [0, 0, 2.3], [1.2, 0, 0], [1.8, 0, 0], [0, 0, 3.0]]
)
def test_local_angles_beyond_sixty_degrees_are_refused(turn):
    leaf = Leaf(LEAF, L, 1)
    leaf.Q = exp(turn)
    leaf.condense(status=1)


def test_numbers_that_are_not_finite_are_refused():
    leaf = Leaf(LEAF, L, 2)
    leaf.inner[0] = np.nan
    leaf.condense(status=2)


def test_clamped_leaf_loses_stability_where_the_element_does():
    """Acceptance A: 1.25 times the Euler load with n = 4; seen as a negative inner pivot."""
    euler = 4 * np.pi**2 * LEAF.E * LEAF.Iz / L**2
    for ratio, expected in ((1.20, 0), (1.30, 1)):
        leaf = Leaf(LEAF, L, 4, mip=0)
        leaf.d = leaf.d * (1 - ratio * euler / (LEAF.E * LEAF.A))
        # keep the leaf straight: inner nodes on the line
        for k in range(3):
            leaf.inner[12 * k] = leaf.d[0] * (k + 1) / 4
        assert leaf.condense()[0] == expected


def near_rotations(leaf):
    """Element and node rotation vectors of the present state, from the undeformed state."""
    n = int(leaf.number[0])
    nodes = [(np.zeros(3), np.eye(3))]
    for k in range(n - 1):
        record = leaf.inner[12 * k : 12 * k + 12]
        nodes.append((record[:3], record[3:].reshape(3, 3)))
    nodes.append((leaf.d, leaf.Q @ leaf.value[16 * n :][:9].reshape(3, 3).T))
    turns = []
    for k, ((rp, Rp), (rq, Rq)) in enumerate(pairwise(nodes)):
        rest = leaf.value[16 * k + 7 : 16 * k + 16].reshape(3, 3)
        x = (rq - rp) / np.linalg.norm(rq - rp)
        y = (Rp + Rq) @ rest[:, 1]
        y -= (y @ x) * x
        y /= np.linalg.norm(y)
        turns.append(log(np.column_stack([x, y, np.cross(x, y)]) @ rest.T))
    turns += [log(R) for _, R in nodes[1:-1]]
    return np.concatenate(turns)


def near(leaf, rotations, *, folded=0):
    args = (
        leaf.value,
        leaf.number,
        leaf.inner,
        leaf.store,
        rotations,
        leaf.d,
        leaf.Q,
        leaf.lam,
        leaf.K,
        *SCRATCH,
    )
    assert condense_linearised(*args)[3] == folded


def bent(n=4, angle=0.7):
    """Pure bending to 0.7 rad, a typical intended motion."""
    leaf = Leaf(LEAF, L, n)
    leaf.load([0, 0, 0, 0, 0, angle * LEAF.E * LEAF.Iz / L], steps=2)
    leaf.settle()
    return leaf


@pytest.mark.parametrize(("n", "angle"), [(1, 0.3), (2, -0.5), (4, 0.7), (5, 1.5)])
def test_near_configuration_reproduces_the_state_it_was_made_from(n, angle):
    leaf = bent(n, angle)
    rotations, exact, inner = near_rotations(leaf), leaf.lam[:6].copy(), leaf.inner.copy()
    leaf.inner[:] = 0.0
    near(leaf, rotations)
    scale = LEAF.E * LEAF.Iz / L
    assert np.allclose(leaf.lam[3:6], exact[3:], atol=1e-7 * scale)
    leaf.move(np.zeros(6))
    assert np.allclose(leaf.inner, inner, atol=1e-9, rtol=1e-6)


@pytest.mark.parametrize("wrong", [2.5, np.nan])
def test_a_folded_element_of_the_near_configuration_is_told(wrong):
    leaf = bent(2)
    rotations = near_rotations(leaf)
    rotations[5] = wrong
    near(leaf, rotations, folded=1)


def near_moment_error(shift):
    """Relative error of the moment when an intended state is shifted by `shift` m out of its plane."""
    leaf = bent()
    rotations = near_rotations(leaf)
    leaf.condense()
    leaf.move(np.array([0, 0, shift, 0, 0, 0]))
    leaf.settle()
    exact = leaf.lam[5]
    near(leaf, rotations)
    return abs(leaf.lam[5] / exact - 1)


def test_moment_error_of_the_near_configuration_is_of_second_order():
    errors = [near_moment_error(shift) for shift in (4e-5, 2e-5)]
    assert errors[0] < 2e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.05)


def test_near_configuration_of_a_straight_leaf_is_the_linear_leaf():
    leaf = Leaf(LEAF, L, 3)
    leaf.d = leaf.d + np.array([1e-9, 2e-9, 3e-9])
    near(leaf, np.zeros(15))
    K, lam = leaf.K.copy(), leaf.lam[:6].copy()
    rest = Leaf(LEAF, L, 3)
    rest.condense()
    assert np.allclose(K, rest.K, rtol=1e-9, atol=1e-9)
    assert np.allclose(lam, rest.K[:, :3] @ [1e-9, 2e-9, 3e-9], rtol=1e-6, atol=1e-12)
    leaf.Q = exp([3e-8, 0, 0])
    near(leaf, np.zeros(15))
    assert leaf.lam[3] == pytest.approx(rest.K[3, 3] * 3e-8, rel=1e-6)


def test_element_mass_carries_rigid_motion_exactly():
    length, rhoA, rhoIy, rhoIz, rhoIp = 0.3, 2.0, 0.05, 0.02, 0.07
    mass = setup.element_mass(length, rhoA=rhoA, rhoIy=rhoIy, rhoIz=rhoIz, rhoIp=rhoIp, phi_y=0.4, phi_z=0.2)
    assert np.allclose(mass, mass.T)
    for i in range(3):
        u = np.zeros(12)
        u[i] = u[6 + i] = 1.0
        assert u @ mass @ u == pytest.approx(rhoA * length)
    inertia = (rhoIp * length, *(rhoA * length**3 / 3 + r * length for r in (rhoIy, rhoIz)))
    for i, turn in enumerate(np.eye(3)):
        u = np.concatenate([np.zeros(3), turn, np.cross(turn, [length, 0, 0]), turn])
        assert u @ mass @ u == pytest.approx(inertia[i])


def test_bad_descriptions_are_refused():
    with pytest.raises(ValueError, match="at least one element"):
        setup.chain_values(LEAF, L, 0)
    with pytest.raises(ValueError, match="must be positive"):
        setup.chain_values(LEAF, 0.0, 2)


def test_near_configuration_keeps_nothing_of_the_states_before():
    """The store of a chain is used again: stresses of an earlier state do not stiffen it."""
    leaf = bent(3)
    rotations = near_rotations(leaf)
    near(leaf, rotations)
    K, lam = leaf.K.copy(), leaf.lam.copy()
    leaf.store[:] = 0.0
    near(leaf, rotations)
    assert np.array_equal(leaf.K, K)
    assert np.array_equal(leaf.lam, lam)


def test_a_chain_that_resists_nothing_is_told():
    """No pivot is left to eliminate an inner node with."""
    leaf = Leaf(LEAF, L, 3)
    for k in range(2):
        leaf.value[16 * k + 1 : 16 * k + 7] = 0.0
    leaf.condense(status=2)
    args = leaf.value, leaf.number, leaf.inner, leaf.store, np.zeros(15), leaf.d, leaf.Q, leaf.lam, leaf.K
    assert condense_linearised(*args, *SCRATCH)[3] == 2


def test_near_configuration_of_a_curved_leaf_is_the_state_it_was_made_from():
    curve = arc_nodes(np.array([0.0, 0.0, 9.0]), L, 4)
    leaf = Leaf(LEAF, L, 4, curve=curve)
    leaf.load([0, 0, 0, 0, 0, 0.5 * LEAF.E * LEAF.Iz / L], steps=2)
    leaf.settle()
    rotations, exact, inner = near_rotations(leaf), leaf.lam[:6].copy(), leaf.inner.copy()
    leaf.inner[:] = 0.0
    near(leaf, rotations)
    scale = LEAF.E * LEAF.Iz / L
    assert leaf.lam[3:6] == pytest.approx(exact[3:], abs=1e-7 * scale)
    leaf.move(np.zeros(6))
    assert leaf.inner == pytest.approx(inner, abs=1e-9, rel=1e-6)


def test_a_gap_of_the_near_configuration_is_spread_over_its_nodes():
    gap, n = np.array([1e-4, 2e-4, -3e-4]), 4
    curve = arc_nodes(np.array([3.0, -4.0, 9.0]), L, n)
    leaf, share = Leaf(LEAF, L, n, curve=curve), np.arange(1, n)[:, None] / n
    leaf.d = leaf.d + gap
    near(leaf, np.zeros(3 * (2 * n - 1)))
    places = leaf.inner[: 12 * (n - 1)].reshape(n - 1, 12)[:, :3]
    assert places == pytest.approx(curve[0][1:-1] + share * gap, abs=1e-15)


def test_what_a_chain_recovers_is_off_by_the_square_of_the_step():
    """Nodes, and the stresses extrapolated for the geometric stiffness, end q moved and turned about all axes."""
    off, n = [], 4
    for share in (1.0, 0.1):
        leaf = sample(3, n, mip=1)
        before = leaf.inner.copy()
        leaf.move(share * np.array([1e-6, 2e-5, -1e-6, 2e-3, 1e-4, -3e-3]))
        found = leaf.inner.copy()
        leaf.settle()
        cut, parts = 12 * (n - 1), []
        for i in range(6):
            # stresses of one kind in all elements
            parts.append(slice(cut + i, None, 6))
        parts += [slice(i, cut, 12) for i in range(12)]
        off.append(
            [np.abs((found - leaf.inner)[p]).max() / np.abs((leaf.inner - before)[p]).max() for p in parts]
        )
    assert np.all(np.array(off[1]) < 0.2 * np.array(off[0]))


def test_lumped_masses_of_a_curved_chain():
    """Half of each element at each of its nodes; the levers of the halves at the ends are a sixth of their elements."""
    n, line = 3, np.array([2.0, 3.0, 5.0])
    positions, axes = arc_nodes(np.array([3.0, -4.0, 9.0]), L, n)
    value = setup.chain_values(LEAF, L, n, (positions, axes))
    half = 0.5 * line * np.linalg.norm(np.diff(positions, axis=0), axis=1)
    lumps = [half[0], half[0] + half[1], half[1] + half[2], half[2]]
    chords = np.diff(positions, axis=0) / 6.0
    found = setup.lumped_masses(value, n, line)
    exact = np.concatenate([lumps, half[0] * chords[0], -axes[-1].T @ (half[2] * chords[2])])
    assert found == pytest.approx(exact)
    sizes = setup.sizes(n, has_weight=True)
    assert sizes.value == len(value) + len(found) and setup.sizes(n).value == len(value)
    assert sizes.store - setup.sizes(n).store == 18 * (n + 1) + GRAVITY_BLOCK_SIZE


def test_a_stretched_state_takes_the_motion_of_the_end_evenly():
    leaf = Leaf(LEAF, L, 4, curve=arc_nodes(np.array([0.0, 0.0, 9.0]), L, 4))
    turn, shift = np.array([0.2, -0.1, 0.4]), np.array([0.01, -0.02, 0.03])
    rest = setup.undeformed_inner(leaf.value, leaf.number)[:36].reshape(3, 12)
    found = setup.stretched_inner(leaf.value, leaf.number, leaf.d + shift, exp(turn) @ leaf.Q)[:36]
    for k, node in enumerate(found.reshape(3, 12)):
        share = (k + 1) / 4
        assert node[:3] == pytest.approx(rest[k, :3] + share * shift)
        assert node[3:] == pytest.approx(exp(share * turn).ravel())
