"""Leaves in their plane: the planar strain-mode leaf against the spatial one and the exact elastica, chains beside it."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ksd.elements import corotational as chain
from ksd.elements import corotational_values as chain_setup
from ksd.elements import planar_leaf
from ksd.elements.strain import leaf_fields, strain_condense, strain_gravity_block, strain_recover
from ksd.elements.strain_values import (
    DEFAULT_ORDERS,
    DEFAULT_POINTS,
    GRAVITY_BLOCK_SIZE,
    strain_sizes,
    strain_values,
)

pytestmark = pytest.mark.plain

L = 0.1
LEAF = chain_setup.ElementSection(E=200e9, G=76.9e9, A=3e-5, J=0.98e-11, Iy=2.25e-9, Iz=2.5e-12)
IN_PLANE = [0, 1, 5]
ELASTICA = {1: (0.30172077, 0.05643324, 0.46135195), 5: (0.71379152, 0.38762836, 1.21536812)}
"""Acceptance A, dead transverse load P L^2/EI: (w/L, u/L, angle)."""


class Leaf:
    """One leaf clamped at p that stays in its plane, of either kind, with its state."""

    def __init__(self, kind, value, number, inner, store, pose, size):
        self.kind, self.value, self.number, self.inner = kind, value, number, inner
        self.store, self.pose, self.size = np.zeros(store), np.array(pose, float), size
        self.wrench, self.stiffness = np.zeros(12), np.zeros((6, 6))

    @property
    def lam(self):
        return self.wrench[[*IN_PLANE, 6, 7, 11]]

    @property
    def K(self):
        return self.stiffness[np.ix_(IN_PLANE, IN_PLANE)]

    def condense(self, status=0):
        c, s = math.cos(self.pose[2]), math.sin(self.pose[2])
        d, Q = np.array([*self.pose[:2], 0.0]), np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
        found = self.kind.condense(
            self.value, self.number, self.inner, self.store, d, Q, self.wrench, self.stiffness
        )
        assert found[3] == status
        return found

    def move(self, xi, scale=1.0):
        whole = np.array([xi[0], xi[1], 0, 0, 0, xi[2]])
        self.kind.recover(self.value, self.number, self.inner, self.store, whole, scale)
        self.pose = self.pose + scale * xi

    def settle(self, iterations=10):
        for _ in range(iterations):
            self.condense()
            self.move(np.zeros(3))
        return self.condense()

    def load(self, wrench, steps=1, iterations=40):
        for step in range(1, steps + 1):
            target = np.asarray(wrench, float) * step / steps
            for _ in range(iterations):
                self.condense()
                xi = np.linalg.solve(self.K, target - self.lam[:3])
                self.move(xi)
                if max(abs(xi[2]), *np.abs(xi[:2]) / self.size) < 1e-12:
                    break
            else:
                pytest.fail(f"no equilibrium at load step {step}")

    def energy(self):
        """Of the planar leaf, from its constants: bending of the amplitudes, stretch and shear at the points."""
        nz, points, first, wrench = self.number[:4]
        K = self.value[: nz * nz].reshape(nz, nz)
        a = self.inner[first : first + nz]
        bend = a - self.value[nz * nz : nz * nz + nz]
        table = self.value[nz * nz + nz :][: points * (3 + nz)].reshape(points, -1)
        theta = table[:, 3 : 3 + nz] @ a
        nx, ny = self.inner[wrench : wrench + 2]
        N, V = np.cos(theta) * nx + np.sin(theta) * ny, np.cos(theta) * ny - np.sin(theta) * nx
        return 0.5 * bend @ K @ bend + 0.5 * table[:, 0] @ (table[:, 1] * N**2 + table[:, 2] * V**2)


def corotational(section, length, n, *, mip=1):
    value, number = chain_setup.chain_values(section, length, n), np.array([n, mip])
    inner = chain_setup.undeformed_inner(value, number)
    return Leaf(chain, value, number, inner, chain_setup.sizes(n).store, (length, 0, 0), length)


def constants(section, length, modes, points, amplitudes=None):
    """Of the spatial leaf whose modes of twist and strong bending are the default ones."""
    s, start = section, np.zeros(7 + modes)
    start[7:] = 0.0 if amplitudes is None else amplitudes
    return strain_values(
        length=length,
        rigidity=np.array([s.G * s.J, s.E * s.Iy, s.E * s.Iz]),
        compliance=np.array([1 / (s.E * s.A), 1 / (s.ky * s.G * s.A), 1 / (s.kz * s.G * s.A)]),
        orders=(4, 3, modes),
        points=points,
        amplitudes=start,
    )


def modal(section, length, modes=5, points=7, amplitudes=None):
    value, number = constants(section, length, modes, points, amplitudes)
    inner = np.zeros(strain_sizes(number)[0])
    inner[7 : 7 + modes] = 0.0 if amplitudes is None else amplitudes
    flat, number = planar_leaf.planar_values(value, number)
    return Leaf(planar_leaf, flat, number, inner, planar_leaf.store_size(modes), (length, 0, 0), length)


SLENDER = LEAF._replace(E=1.0, G=1.0, A=1e9, Iz=1.0)
KINDS = {
    "plain": lambda s, l: corotational(s, l, 4, mip=0),
    "mip": lambda s, l: corotational(s, l, 4),
    "modes": modal,
}


@pytest.mark.parametrize("kind", KINDS)
def test_tangent_is_the_derivative_of_the_force(kind):
    leaf = KINDS[kind](LEAF, L)
    leaf.load([20.0, 3.0, 5 * 0.5], steps=4)
    leaf.settle()
    K, pose, inner = leaf.K.copy(), leaf.pose, leaf.inner.copy()
    derivative = np.empty((3, 3))
    for j in range(3):
        xi = np.eye(3)[j] * (1e-6 * L if j < 2 else 1e-6)
        ends = []
        for sign in (1, -1):
            leaf.inner[:], leaf.pose = inner, pose + sign * xi
            leaf.settle(5)
            ends.append(leaf.lam[:3].copy())
        derivative[:, j] = (ends[0] - ends[1]) / (2 * xi[j])
    scale = np.sqrt(np.diag(K))
    assert np.abs((derivative - K) / np.outer(scale, scale)).max() < 1e-6


def test_energy_is_the_work_of_the_end_force():
    leaf = modal(LEAF, L)
    leaf.load([20.0, 3.0, 1.0], steps=2)
    leaf.settle()
    start, goal, steps = leaf.energy(), np.array([-0.001, 0.01, 0.1]), []
    for _ in range(21):
        leaf.settle(5)
        steps.append(leaf.lam[:3] @ goal / 20)
        stored = leaf.energy()
        leaf.move(goal / 20)
    simpson = np.array([1, *([4, 2] * 10)[:-1], 1]) / 3
    assert simpson @ steps == pytest.approx(stored - start, rel=1e-6)


class Spatial:
    """The kernels of the spatial leaf with room of their own, called as those of the planar one."""

    @staticmethod
    def recover(*args):
        strain_recover(*args, np.empty(6))

    def __init__(self, number):
        self.fields = leaf_fields(number)

    def condense(self, value, number, inner, store, *rest):
        return strain_condense(value, number, inner, store, self.fields, *rest)


def test_the_planar_leaf_is_the_spatial_one():
    """Followed along the same path with a big rotation: same wrench, stiffness and inner state, out of the plane nothing."""
    leaf = modal(LEAF, L, modes=DEFAULT_ORDERS[2], points=DEFAULT_POINTS)
    value, number = constants(LEAF, L, DEFAULT_ORDERS[2], DEFAULT_POINTS)
    inner, store = strain_sizes(number)
    twin = Leaf(Spatial(number), value, number, np.zeros(inner), store, (L, 0, 0), L)
    for xi in [np.array([-0.012, 0.03, 0.8]) / 8] * 8 + [np.zeros(3)] * 8:
        for one in (leaf, twin):
            one.condense()
            one.move(xi)
    for one in (leaf, twin):
        one.condense()
    for mine, theirs in ((leaf.wrench, twin.wrench), (leaf.K, twin.K), (leaf.inner, twin.inner)):
        assert np.allclose(mine, theirs, rtol=1e-11, atol=1e-12 * np.abs(theirs).max())
    assert not leaf.stiffness[[2, 3, 4]].any() and not leaf.stiffness[:, [2, 3, 4]].any()


MU = np.array([1.0, 2.0, 4.0, 3.0, 2.5, 1.5, 0.5])
"""Line mass [kg/m], not even, so that nothing cancels."""
GRAVITY = np.array([70.0, -90.0, 0.0])


class Heavy(Leaf):
    """A leaf with weight, in the plane or in space, that settles in gravity g (3,)."""

    g = GRAVITY

    @property
    def pull(self):
        return self.store[-GRAVITY_BLOCK_SIZE:]

    def condense(self, status=0):
        self.pull[:3] = self.g
        found = super().condense(status)
        args = self.value, self.number, self.inner, self.store
        if self.kind is planar_leaf:
            planar_leaf.gravity_block(*args, self.wrench)
        else:
            strain_gravity_block(*args, self.kind.fields, self.wrench, self.stiffness)
        self.pull[36:] = 0.0
        return found

    def potential(self):
        """Energy of the leaf less the work of gravity on its mass, at its present inner state."""
        nz, points, first, wrench = self.number[:4]
        table = self.value[nz * nz + nz :][: points * (3 + nz)].reshape(points, -1)
        theta = table[:, 3:] @ self.inner[first : first + nz]
        n = self.inner[wrench : wrench + 2] + self.value[-points:, None] * self.g[:2]
        c, s = np.cos(theta), np.sin(theta)
        N, V = c * n[:, 0] + s * n[:, 1], c * n[:, 1] - s * n[:, 0]
        a, b = 1 + table[:, 1] * N, table[:, 2] * V
        moment = (table[:, 0] * self.value[-points:]) @ np.column_stack([c * a - s * b, s * a + c * b])
        K, bend = self.value[: nz * nz].reshape(nz, nz), self.inner[first : first + nz]
        stored = 0.5 * table[:, 0] @ (table[:, 1] * N**2 + table[:, 2] * V**2)
        return 0.5 * bend @ K @ bend + stored - self.g[:2] @ moment


def heavy_pair():
    """The same leaf with weight in the plane and in space."""
    value, number = strain_values(
        length=L,
        rigidity=np.array([LEAF.G * LEAF.J, LEAF.E * LEAF.Iy, LEAF.E * LEAF.Iz]),
        compliance=1e2 * np.array([1 / (LEAF.E * LEAF.A), 3 / (LEAF.G * LEAF.A), 2 / (LEAF.G * LEAF.A)]),
        orders=(4, 3, 6),
        points=7,
        line_mass=MU,
    )
    inner, store = strain_sizes(number, has_weight=True)
    flat, settings = planar_leaf.planar_values(value, number, has_weight=True)
    size = planar_leaf.store_size(6, modes=1)
    return (
        Heavy(planar_leaf, flat, settings, np.zeros(inner), size, (L, 0, 0), L),
        Heavy(Spatial(number), value, number, np.zeros(inner), store, (L, 0, 0), L),
    )


def test_the_planar_leaf_with_weight_is_the_spatial_one():
    """Followed through a big rotation while gravity turns: same wrench, stiffness, inner state and pull."""
    pair = heavy_pair()
    for _ in range(8):
        for leaf in pair:
            leaf.condense()
            # the last three numbers of the pull: as if frame p turned by 0.05 rad
            leaf.pull[36:] = 0.05 * leaf.g[1], -0.05 * leaf.g[0], 0.0
            leaf.move(np.array([-0.012, 0.03, 0.8]) / 8)
    one, two = pair
    assert np.allclose(one.inner, two.inner, rtol=1e-10, atol=1e-11 * np.abs(two.inner).max())
    for leaf in pair:
        leaf.settle()
    assert np.abs(two.pull[3:36]).max() > 0.1
    for mine, theirs in ((one.wrench, two.wrench), (one.K, two.K), (one.inner, two.inner)):
        assert np.allclose(mine, theirs, rtol=1e-10, atol=1e-11 * np.abs(theirs).max())
    # in the plane: s, V_xi,g by rows x, y, rz, V_g,g
    inside = [3, 4, 6, 7, 9, 10, 12, 13, 24, 25, 27, 28, 30, 31]
    assert np.allclose(one.pull[inside], two.pull[inside], rtol=1e-9, atol=1e-11)


def test_forces_of_the_planar_leaf_with_weight_are_derivatives_of_its_potential():
    leaf, _ = heavy_pair()
    for _ in range(8):
        leaf.condense()
        leaf.move(np.array([-0.012, 0.03, 0.8]) / 8)
    leaf.settle()
    pose, wrench, moment = leaf.pose, leaf.wrench[[0, 1, 5]].copy(), leaf.pull[3:5].copy()
    cross, own = (
        leaf.pull[9:27].reshape(6, 3)[IN_PLANE, :2].copy(),
        leaf.pull[27:36].reshape(3, 3)[:2, :2].copy(),
    )
    K = leaf.K.copy()

    def at(move, gravity):
        leaf.pose, leaf.g = pose + move, GRAVITY + np.array([*gravity, 0.0])
        leaf.settle()
        return leaf.potential(), leaf.wrench[[0, 1, 5]].copy(), leaf.pull[3:5].copy()

    steps = np.diag([1e-6, 1e-6, 1e-4, 0.1, 0.1])
    for j, step in enumerate(steps):
        up, down = at(step[:3], step[3:]), at(-step[:3], -step[3:])
        slope, force, first = ((a - b) / (2 * step[j]) for a, b in zip(up, down, strict=True))
        assert slope == pytest.approx(wrench[j] if j < 3 else -moment[j - 3], rel=1e-5)
        assert force == pytest.approx(
            (K if j < 3 else cross.T)[j % 3 if j < 3 else j - 3], rel=1e-5, abs=1e-6
        )
        assert -first == pytest.approx(cross[j] if j < 3 else own[j - 3], rel=1e-5, abs=1e-9)


@pytest.mark.parametrize("load", ELASTICA)
def test_chain_converges_to_the_elastica_with_order_two(load):
    errors, tips = [], []
    for n in (8, 16, 32):
        leaf = corotational(SLENDER, 1.0, n)
        leaf.load([0.0, load, 0.0], steps=3)
        tips.append(np.array([leaf.pose[1], 1.0 - leaf.pose[0], leaf.pose[2]]))
        errors.append(np.abs(tips[-1] - ELASTICA[load]).max())
    assert np.allclose(np.log2(np.array(errors[:-1]) / errors[1:]), 2.0, atol=0.1)
    assert np.allclose((4 * tips[2] - tips[1]) / 3, ELASTICA[load], atol=1e-5)


@pytest.mark.parametrize("load", ELASTICA)
def test_modes_converge_to_the_elastica_exponentially(load):
    leaf = modal(SLENDER, 1.0, modes=10, points=14)
    leaf.load([0.0, load, 0.0], steps=3)
    assert np.allclose([leaf.pose[1], 1.0 - leaf.pose[0], leaf.pose[2]], ELASTICA[load], atol=2e-8)
    leaf = modal(SLENDER, 1.0)
    leaf.load([0.0, load, 0.0], steps=3)
    assert np.allclose([leaf.pose[1], 1.0 - leaf.pose[0], leaf.pose[2]], ELASTICA[load], atol=2e-3)


@pytest.mark.parametrize("build", [lambda: corotational(LEAF, L, 10), lambda: modal(LEAF, L, 4, 14)])
def test_end_moment_closes_a_circle(build):
    """Acceptance A: moment 2 pi EI/L, tip back at the origin within 1e-9 L; the angle is not folded."""
    leaf = build()
    leaf.load([0, 0, 2 * math.pi * LEAF.E * LEAF.Iz / L], steps=10)
    assert np.abs(leaf.pose[:2]).max() < 1e-9 * L
    assert leaf.pose[2] == pytest.approx(2 * math.pi, abs=1e-9)


CROSS = {
    2: (1.014307, 1.119823, 1.298602),
    4: (1.012007, 1.099556, 1.242758),
    6: (1.011603, 1.095977, 1.233110),
}
"""Acceptance B: normalised moment of the cross flexure at 15, 45, 75 degrees, by elements per leaf."""


class CrossFlexure:
    """Two crossed leaf springs (45 degrees, 0.1 m x 1 mm, equal widths) clamped at A; B turns, free to shift."""

    def __init__(self, make):
        self.section = LEAF._replace(A=4e-5, Iz=0.04e-9 / 12)
        self.leaves = [make(self.section), make(self.section)]
        c = math.sqrt(0.5)
        self.turns = [np.array([[c, -c], [c, c]]), np.array([[c, c], [-c, c]])]
        # the leaf springs cross in the middle, so end q of leaf 1 is half the leaf's height above B, that of 2 below
        self.arms = [np.array([0, 0.5 * c * L]), np.array([0, -0.5 * c * L])]

    def arm(self, i, turn=0.0):
        """Offset of end q of leaf i from B after B has turned further by `turn`."""
        angle = self.leaves[i].pose[2] + turn
        c, s = math.cos(angle), math.sin(angle)
        return np.array([[c, -s], [s, c]]) @ self.arms[i]

    def step(self, turn):
        """One iteration with B turned by `turn`; returns the moment."""
        force, K = np.zeros(3), np.zeros((3, 3))
        for i, (leaf, R) in enumerate(zip(self.leaves, self.turns, strict=True)):
            leaf.condense()
            x, y = self.arm(i)
            B = np.eye(3)
            B[:2, :2], B[:2, 2] = R.T, R.T @ [-y, x]
            force += B.T @ leaf.lam[:3]
            K += B.T @ leaf.K @ B
        shift = -np.linalg.solve(K[:2, :2], force[:2] + K[:2, 2] * turn)
        for i, (leaf, R) in enumerate(zip(self.leaves, self.turns, strict=True)):
            x, y = self.arm(i)
            linear = np.array([-y, x]) * turn
            exact = self.arm(i, turn) - [x, y]
            # the inner unknowns follow the linear motion the shift was solved with; the end moves exactly
            leaf.move(np.array([*(R.T @ (shift + linear)), turn]))
            leaf.pose[:2] += R.T @ (exact - linear)
        return force[2]

    def moment(self, degrees):
        """Normalised moment at a rotation of B reached in steps of 5 degrees: M / (E I_sum theta / L)."""
        for _ in range(round((degrees - math.degrees(self.leaves[0].pose[2])) / 5)):
            for iteration in range(12):
                found = self.step(math.radians(5.0) if iteration == 0 else 0.0)
        return found / (2 * self.section.E * self.section.Iz * math.radians(degrees) / L)


@pytest.mark.parametrize("n", CROSS)
def test_cross_flexure_of_paper_1(n):
    flexure = CrossFlexure(lambda section: corotational(section, L, n))
    assert np.allclose([flexure.moment(theta) for theta in (15, 45, 75)], CROSS[n], atol=2e-6)


def test_cross_flexure_with_modes():
    flexure = CrossFlexure(lambda section: modal(section, L))
    found = [flexure.moment(theta) for theta in (15, 45, 75)]
    assert np.allclose(found, [1.011284, 1.093157, 1.225562], atol=2e-6)


@pytest.mark.parametrize("turn", [1.1, -1.1, 2.0, 3.0, 4.4])
def test_local_angles_beyond_sixty_degrees_are_refused(turn):
    leaf = corotational(LEAF, L, 1)
    leaf.pose[2] = turn
    leaf.condense(status=1)


@pytest.mark.parametrize("kind", KINDS)
def test_numbers_that_are_not_finite_are_refused(kind):
    leaf = KINDS[kind](LEAF, L)
    leaf.inner[:] = math.nan
    leaf.condense(status=2)


@pytest.mark.parametrize(("kind", "below", "above"), [("plain", 1.20, 1.30), ("modes", 0.98, 1.02)])
def test_clamped_leaf_loses_stability_near_the_euler_load(kind, below, above):
    """Acceptance A: 1.25 times the Euler load with four elements, .04 % off with five modes."""
    euler = 4 * math.pi**2 * LEAF.E * LEAF.Iz / L**2
    for ratio, expected in ((below, 0), (above, 1)):
        leaf = KINDS[kind](LEAF, L)
        leaf.condense()
        leaf.move(np.array([-ratio * euler * L / (LEAF.E * LEAF.A), 0, 0]))
        assert leaf.condense()[0] == expected


def test_curved_leaf_starts_free_of_force():
    curvature = 12.0
    leaf = modal(LEAF, L, amplitudes=np.array([curvature, 0, 0, 0, 0]))
    turn = curvature * L
    leaf.pose = np.array([math.sin(turn) / curvature, (1 - math.cos(turn)) / curvature, turn])
    leaf.condense()
    assert np.abs(leaf.lam).max() < 1e-6
    assert leaf.energy() == 0.0


def test_a_leaf_with_a_profile_bends_in_its_plane_as_in_space():
    """Thickness halved towards the middle: modes that are no polynomials."""
    from ksd.elements.strain_values import make_modes

    def soft(s):
        return np.tile(1.0 / (1.0 - 2.0 * s * (1.0 - s)) ** 3, (3, 1))

    modes = make_modes((2, 2, 4), 9, shape=soft)
    words = {"length": L, "compliance": np.array([1e-7, 3e-7, 3e-7]), "orders": (2, 2, 4), "modes": modes}
    value, number = strain_values(rigidity=np.array([1.0, 400.0, 0.5]), **words)
    inner, store = strain_sizes(number)
    flat, settings = planar_leaf.planar_values(value, number)
    pair = [
        Leaf(planar_leaf, flat, settings, np.zeros(inner), planar_leaf.store_size(4), (L, 0, 0), L),
        Leaf(Spatial(number), value, number, np.zeros(inner), store, (L, 0, 0), L),
    ]
    for leaf in pair:
        for _ in range(4):
            leaf.condense()
            leaf.move(np.array([-0.004, 0.02, 0.4]) / 4)
        leaf.settle()
    assert np.allclose(pair[0].lam[:3], pair[1].lam[:3], rtol=1e-12)
    assert np.allclose(pair[0].K, pair[1].K, rtol=1e-11, atol=1e-12 * np.abs(pair[1].K).max())


def test_bad_descriptions_are_refused():
    with pytest.raises(ValueError, match="at least one element"):
        chain_setup.chain_values(LEAF, L, 0)


def test_modes_are_eliminated_as_by_a_dense_solve(rng):
    """Beside LAPACK, of as many negative eigenvalues; a pivot of rounding is told."""
    n = 6
    for negative in range(n + 1):
        turned = np.linalg.qr(rng.normal(size=(n, n)))[0]
        W = turned @ np.diag([-1.0] * negative + [2.0] * (n - negative)) @ turned.T
        right = rng.normal(size=(n, 4))
        store = np.concatenate([np.zeros(4 * n), right.ravel(), np.tril(W).ravel()])
        assert planar_leaf._solve(n, store) == (negative, 0)
        np.testing.assert_allclose(
            store[: 4 * n].reshape(n, 4), np.linalg.solve(W, right), rtol=1e-9, atol=1e-10
        )
    near = np.array([[1.0, 0.0], [1.0, 1.0 + 4e-16]])
    assert planar_leaf._solve(2, np.concatenate([np.zeros(8), np.ones(8), near.ravel()]))[1] == 2
