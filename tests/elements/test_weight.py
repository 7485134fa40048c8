"""Weight along a leaf, kernel by kernel: what it says of gravity is the derivative of what it says of force."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ksd.elements import corotational, strain
from ksd.elements import corotational_values as chains
from ksd.elements.corotational_values import ElementSection
from ksd.elements.strain_values import (
    DEFAULT_ORDERS,
    DEFAULT_POINTS,
    GRAVITY_BLOCK_SIZE,
    loads_beyond,
    make_modes,
    strain_sizes,
    strain_values,
)

pytestmark = pytest.mark.plain

L, MU = 0.1, 3.0
LEAF = ElementSection(E=200e9, G=76.9e9, A=3e-5, J=0.98e-11, Iy=2.25e-9, Iz=2.5e-12)
COMPLIANCE = np.array([1 / (LEAF.E * LEAF.A), 1.2 / (LEAF.G * LEAF.A), 1.2 / (LEAF.G * LEAF.A)])


class Space:
    """A leaf in space clamped at p, end q held at a pose; answer(g) settles it: (lam, V_xi,g, s, V_g,g)."""

    def __init__(self, kind):
        # an arc of 0.05 rad, a little off and twisted
        self.d = np.array([0.99958, 0.025, 1e-4]) * L
        (c, s), (a, b) = (np.cos(0.05), np.sin(0.05)), (np.cos(0.02), np.sin(0.02))
        self.Q = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]) @ np.array([[1, 0, 0], [0, a, -b], [0, b, a]])
        self.lam, self.K, self.at = np.zeros(12), np.zeros((6, 6)), GRAVITY_BLOCK_SIZE
        if kind == "modes":
            table = make_modes(DEFAULT_ORDERS, DEFAULT_POINTS)
            rigidity = np.array([LEAF.G * LEAF.J, LEAF.E * LEAF.Iy, LEAF.E * LEAF.Iz])
            self.value, self.number = strain_values(
                length=L, rigidity=rigidity, compliance=COMPLIANCE, modes=table, line_mass=np.full(7, MU)
            )
            assert loads_beyond(self.value, self.number)[:, 0] == pytest.approx(MU * L * (1 - table.s))
            inner, store = strain_sizes(self.number, has_weight=True)
            self.inner = np.zeros(inner)
            fields = strain.leaf_fields(self.number)

            def condense(value, number, inner, store, *rest):
                found = strain.strain_condense(value, number, inner, store, fields, *rest)
                strain.strain_gravity_block(value, number, inner, store, fields, *rest[2:])
                return found

            self.condense = condense
            self.recover = lambda *args: strain.strain_recover(*args, np.empty(6))
        else:
            value = chains.chain_values(LEAF, L, 4)
            self.value = np.concatenate([value, chains.lumped_masses(value, 4, np.full(4, MU))])
            self.number, store = np.array([4, 0]), chains.sizes(4, has_weight=True).store
            self.inner = chains.undeformed_inner(self.value, self.number)
            self.condense, self.recover = corotational.condense, corotational.recover
        self.store = np.zeros(store)

    def answer(self, g):
        pull = self.store[-self.at :]
        for _ in range(12):
            pull[:3], pull[36:] = g, 0.0
            args = self.value, self.number, self.inner, self.store
            assert self.condense(*args, self.d, self.Q, self.lam, self.K)[3] == 0
            self.recover(*args, np.zeros(6), 1.0)
        return (
            self.lam[:6].copy(),
            pull[9:27].reshape(6, 3).copy(),
            pull[3:6].copy(),
            pull[27:36].reshape(3, 3).copy(),
        )


@pytest.mark.parametrize("kind", ["modes", "chain"])
def test_the_pull_is_the_derivative_by_gravity(kind):
    leaf, g = Space(kind), np.array((40.0, -90.0, 60.0))
    _, cross, _, own = leaf.answer(g)
    for k in range(len(g)):
        step = 0.5 * np.eye(len(g))[k]
        up, down = leaf.answer(g + step), leaf.answer(g - step)
        assert up[0] - down[0] == pytest.approx(cross[:, k], rel=1e-5, abs=1e-7 * np.abs(cross).max())
        # s = -V_g
        assert down[2] - up[2] == pytest.approx(own[:, k], rel=1e-4, abs=1e-6 * np.abs(own).max())


def test_a_chain_with_weight_is_its_potential(rng):
    """Energy of its elements less the work of gravity on its lumps: wrench, stiffness and first moment."""
    leaf, g, n = Space("chain"), np.array((40.0, -90.0, 60.0)), 4
    leaf.value[-(n + 7) :] *= rng.uniform(0.5, 1.5, n + 7)
    # levers of the halves at the ends that are not along the leaf
    leaf.value[-6:] += 1e-3 * rng.normal(size=6)
    mass, d, Q = leaf.value[-(n + 7) :], leaf.d, leaf.Q

    def at(xi):
        leaf.d, leaf.Q = d + xi[:3], Rotation.from_rotvec(xi[3:]).as_matrix() @ Q
        lam, _, moment, _ = leaf.answer(g)
        inner = leaf.inner[: 12 * (n - 1)].reshape(n - 1, 12)[:, :3]
        lumps = mass[1:n] @ inner + mass[n] * leaf.d + mass[n + 1 : n + 4] + leaf.Q @ mass[n + 4 :]
        assert moment == pytest.approx(lumps, rel=1e-9)
        # the wrench before the last step, which geometric terms take, is the same one
        assert leaf.lam[6:] == pytest.approx(lam, rel=1e-6, abs=1e-6 * np.abs(lam).max())
        return corotational.energy(leaf.value, leaf.number, leaf.inner, leaf.d, leaf.Q) - g @ lumps, lam

    lam, K = at(np.zeros(6))[1], leaf.K.copy()
    slope, forces = np.empty(6), np.empty((6, 6))
    for j, h in enumerate([1e-8, 1e-6, 1e-6, 1e-4, 1e-5, 1e-4]):
        up, down = at(h * np.eye(6)[j]), at(-h * np.eye(6)[j])
        slope[j], forces[:, j] = (up[0] - down[0]) / (2 * h), (up[1] - down[1]) / (2 * h)
    scale = np.sqrt(np.abs(np.diag(K)))
    assert slope / scale == pytest.approx(lam / scale, abs=1e-5 * np.abs(lam / scale).max())
    assert np.abs((0.5 * (forces + forces.T) - K) / np.outer(scale, scale)).max() < 1e-6


@pytest.mark.parametrize("kind", ["modes", "chain"])
def test_a_change_of_gravity_is_recovered(kind):
    """From equilibrium, to first order: a tenth of the change leaves a hundredth of the error."""
    leaf, g, change, off = Space(kind), np.array((40.0, -90.0, 60.0)), np.array((30.0, 50.0, -20.0)), []
    leaf.answer(g)
    start = leaf.inner.copy()
    for share in (1.0, 0.1):
        leaf.inner[:] = start
        leaf.answer(g)
        args = leaf.value, leaf.number, leaf.inner, leaf.store
        leaf.condense(*args, leaf.d, leaf.Q, leaf.lam, leaf.K)
        leaf.store[-3:] = share * change
        leaf.recover(*args, np.zeros(6), 1.0)
        found = leaf.inner.copy()
        leaf.answer(g + share * change)
        off.append(np.abs(found - leaf.inner).max() / np.abs(leaf.inner - start).max())
    assert off[0] < 0.1 and off[1] < 0.2 * off[0]
