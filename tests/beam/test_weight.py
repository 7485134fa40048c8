"""Weight along a leaf, kernel by kernel: what it says of gravity is the derivative of what it says of force."""

import numpy as np
import pytest

from ksd.beam import corotational, planar_corotational, planar_strain, strain
from ksd.beam import corotational_values as chains
from ksd.beam.corotational_values import ElementSection
from ksd.beam.strain_values import (
    DEFAULT_ORDERS,
    DEFAULT_POINTS,
    PULL,
    make_modes,
    masses_beyond,
    strain_scratch,
    strain_sizes,
    strain_values,
)
from ksd.beam.weight import PLANAR_PULL

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
        self.lam, self.K, self.at = np.zeros(12), np.zeros((6, 6)), PULL
        if kind == "modes":
            table = make_modes(DEFAULT_ORDERS, DEFAULT_POINTS)
            rigidity = np.array([LEAF.G * LEAF.J, LEAF.E * LEAF.Iy, LEAF.E * LEAF.Iz])
            self.value, self.number = strain_values(
                length=L, rigidity=rigidity, compliance=COMPLIANCE, modes=table, line_mass=np.full(7, MU)
            )
            assert masses_beyond(self.value, self.number) == pytest.approx(MU * L * (1 - table.s))
            inner, store = strain_sizes(self.number, heavy=True)
            self.inner, scratch = np.zeros(inner), np.zeros(strain_scratch(self.number))
            self.condense = lambda *a: strain.strain_condense(*a[:4], scratch, *a[4:])
            self.recover = strain.strain_recover
        else:
            value = chains.chain_values(LEAF, L, 4)
            self.value = np.concatenate([value, chains.lumped_masses(value, 4, np.full(4, MU))])
            self.number, store = np.array([4, 0]), chains.sizes(4, heavy=True).store
            self.inner = chains.start_inner(self.value, self.number)
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


class Plane:
    """The same in the plane."""

    def __init__(self, kind):
        self.pose, self.lam, self.K = np.array([0.99334 * L, 0.1 * L, 0.2]), np.zeros(6), np.zeros((3, 3))
        if kind == "modes":
            self.kind, sizes = planar_strain, planar_strain.sizes(DEFAULT_ORDERS[2], heavy=True)
            value, self.number = planar_strain.leaf_values(
                length=L, EI=LEAF.E * LEAF.Iz, cN=COMPLIANCE[0], cV=COMPLIANCE[1], modes=DEFAULT_ORDERS[2]
            )
            s = 0.5 * (1 + np.polynomial.legendre.leggauss(7)[0])
            self.value = np.concatenate([value, MU * L * (1 - s)])
        else:
            self.kind, sizes = planar_corotational, planar_corotational.sizes(4, heavy=True)[1:]
            value, half = planar_corotational.chain_values(LEAF, L, 4), MU * L / 8
            lever = half * L / 24
            masses = [half, *[2 * half] * 3, half, lever, 0.0, -lever, 0.0]
            self.value, self.number = np.concatenate([value, masses]), np.array([4, 0])
        self.store = np.zeros(sizes[1])
        self.inner = self.kind.start_inner(self.value, self.number)

    def answer(self, g):
        pull = self.store[-PLANAR_PULL:]
        for _ in range(12):
            pull[:2], pull[16:] = g, 0.0
            args = self.value, self.number, self.inner, self.store
            assert self.kind.condense(*args, self.pose, self.lam, self.K)[3] == 0
            self.kind.recover(*args, np.zeros(3), 1.0)
        return (
            self.lam[:3].copy(),
            pull[6:12].reshape(3, 2).copy(),
            pull[2:4].copy(),
            pull[12:16].reshape(2, 2).copy(),
        )


@pytest.mark.parametrize("kind", ["modes", "chain"])
@pytest.mark.parametrize("make, gravity", [(Space, (40.0, -90.0, 60.0)), (Plane, (40.0, -90.0))])
def test_the_pull_is_the_derivative_by_gravity(make, gravity, kind):
    leaf, g = make(kind), np.array(gravity)
    _, cross, _, own = leaf.answer(g)
    for k in range(len(g)):
        step = 0.5 * np.eye(len(g))[k]
        up, down = leaf.answer(g + step), leaf.answer(g - step)
        assert up[0] - down[0] == pytest.approx(cross[:, k], rel=1e-5, abs=1e-7 * np.abs(cross).max())
        # s = -V_g
        assert down[2] - up[2] == pytest.approx(own[:, k], rel=1e-4, abs=1e-6 * np.abs(own).max())


@pytest.mark.parametrize("kind", ["modes", "chain"])
def test_the_plane_says_what_space_says(kind):
    """Without gravity across the plane."""
    flat, leaf = Plane(kind), Space(kind)
    c, s = np.cos(flat.pose[2]), np.sin(flat.pose[2])
    leaf.d, leaf.Q = np.append(flat.pose[:2], 0.0), np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    one, other = flat.answer(np.array([4.0, -9.0])), leaf.answer(np.array([4.0, -9.0, 0.0]))
    plane = [0, 1, 5]
    assert one[0] == pytest.approx(other[0][plane], rel=1e-8)
    assert one[1] == pytest.approx(other[1][plane, :2], rel=1e-8, abs=1e-10)
    assert one[2] == pytest.approx(other[2][:2], rel=1e-8)
    assert one[3] == pytest.approx(other[3][:2, :2], rel=1e-6, abs=1e-10 * np.abs(one[3]).max())
    light = leaf.answer(np.zeros(3))[0]
    assert not np.allclose(light, other[0], rtol=1e-3)
