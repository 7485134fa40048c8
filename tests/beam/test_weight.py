"""Weight along a leaf, kernel by kernel: what it says of gravity is the derivative of what it says of force."""

import numpy as np
import pytest

from ksd.beam import corotational, strain
from ksd.beam import corotational_values as chains
from ksd.beam.corotational_values import ElementSection
from ksd.beam.strain_values import (
    DEFAULT_ORDERS,
    DEFAULT_POINTS,
    GRAVITY_BLOCK_SIZE,
    make_modes,
    masses_beyond,
    strain_sizes,
    strain_values,
)

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
            assert masses_beyond(self.value, self.number) == pytest.approx(MU * L * (1 - table.s))
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
