"""The strain-mode leaf in space: its tangents are the derivatives of its residual and of its wrench."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.polynomial import Legendre

from ksd.elements.strain import (
    fill_leaf_fields,
    leaf_fields,
    strain_condense,
    strain_gravity_block,
    strain_recover,
    strain_tangent,
)
from ksd.elements.strain_flat import is_flat
from ksd.elements.strain_uncondensed import (
    BUBBLES,
    load_derivatives,
    quadrature_points,
    strain_flexibility,
    strain_mass_root,
    stretch_shear_compliances,
    uncondensed_leaves,
)
from ksd.elements.strain_values import GRAVITY_BLOCK_SIZE, make_modes, strain_sizes, strain_values
from ksd.numerics.rotations import rotation_exp, rotation_log

pytestmark = pytest.mark.plain

L, EA, KGA = 0.1, 6e6, 1.9e6
RIGIDITY = np.array([0.75, 450.0, 0.5])
"""GJ, EIy, EIz [N m^2]."""


def exp(v):
    found = np.empty((3, 3))
    rotation_exp(np.asarray(v, float), found)
    return found


def log(R):
    found = np.empty(3)
    rotation_log(np.ascontiguousarray(R), found)
    return found


def soft(s):
    """Compliance, over that of the ends, where the thickness halves towards the middle."""
    return np.tile(1.0 / (1.0 - 2.0 * s * (1.0 - s)) ** 3, (3, 1))


class Leaf:
    """A leaf clamped at p, end q held at d, Q; with or without weight, uniform or with a profile."""

    def __init__(self, kind, gravity=(300.0, -500.0, 400.0)):
        orders = (4, 3, 6)
        table = make_modes(orders, 9, shape=soft) if kind == "profile" else make_modes(orders, 7)
        ng, self.N = len(table.s), sum(orders)
        self.value, self.number = strain_values(
            length=L,
            rigidity=RIGIDITY,
            compliance=1.0 / np.array([EA, KGA, KGA]),
            orders=orders,
            modes=table,
            line_mass=np.full(ng, 3.0) if kind == "weight" else None,
        )
        size, store = strain_sizes(self.number, has_weight=kind == "weight")
        self.inner, self.store = np.zeros(size), np.zeros(store)
        self.fields = leaf_fields(self.number)
        self.size = 0.3 if kind == "profile" else 1.0
        self.pull = np.array(gravity) if kind == "weight" else np.zeros(0)
        self.lam, self.K = np.zeros(12), np.zeros((6, 6))
        self.d, self.Q = np.array([L, 0, 0]), np.eye(3)

    def condense(self, d, Q):
        if len(self.pull):
            self.store[-GRAVITY_BLOCK_SIZE:][:3], self.store[-3:] = self.pull, 0.0
        args = self.value, self.number, self.inner, self.store, self.fields
        assert strain_condense(*args, d, Q, self.lam, self.K)[3] == 0
        strain_gravity_block(*args, self.lam, self.K)

    def first_moment(self):
        """Of its mass about end p, predicted; nothing without weight."""
        return self.store[-GRAVITY_BLOCK_SIZE:][3:6].copy() if len(self.pull) else np.zeros(0)

    def settle(self, d, Q, iterations=30):
        """Wrench (6,) with end q at d, Q, the leaf in equilibrium to rounding."""
        for _ in range(iterations):
            self.condense(d, Q)
            strain_recover(self.value, self.number, self.inner, self.store, np.zeros(6), 1.0, np.empty(6))
        return self.inner[self.N :].copy()

    def load(self, rng, steps=20):
        """A bent and twisted leaf under a large force, taken up in steps by moving its end: the pose."""
        axes = [(4.0, 4), (0.2, 3), (8.0, 6)]
        self.inner[: self.N] = np.concatenate(
            [rng.normal(size=n) * a / (1 + np.arange(n)) ** 2 for a, n in axes]
        )
        f = self.fields
        fill_leaf_fields(self.value, self.number, self.inner, self.pull, f)
        d, Q = f.end.copy(), f.R[-1].copy()
        start, more = self.settle(d, Q), np.zeros(6)
        more[:3] = f.R[-1] @ (rng.uniform(0.5, 1.0, 3) * self.size * [1500.0, 20.0, 100.0])
        for k in range(1, steps + 1):
            for _ in range(2):
                xi = np.linalg.solve(self.K, start + more * k / steps - self.settle(d, Q, 6))
                d, Q = d + xi[:3], exp(xi[3:]) @ Q
        self.settle(d, Q)
        return d, Q


KINDS = ("light", "weight", "profile")


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("seed", range(3))
def test_stiffness_is_the_derivative_of_the_wrench_under_large_loads(kind, seed):
    """Its symmetric part, that is: the moment is one for small turns of end q, which adds half its cross product."""
    leaf = Leaf(kind)
    d, Q = leaf.load(np.random.default_rng(seed))
    wrench = leaf.settle(d, Q)
    # force far above what bends the leaf its soft way
    assert np.linalg.norm(wrench[:3]) > 10 * leaf.size * RIGIDITY[2] / L**2
    K, inner = leaf.K.copy(), leaf.inner.copy()
    found, step = np.empty((6, 6)), np.array([2e-6 * L, 1e-5 * L, 2e-6 * L, 1e-4, 1e-4, 1e-4])
    for j, h in enumerate(step):
        ends = []
        for times in (1, -1, 2, -2, 3, -3):
            leaf.inner[:] = inner
            xi = times * h * np.eye(6)[j]
            ends.append(leaf.settle(d + xi[:3], exp(xi[3:]) @ Q, 8))
        one, two, three = (a - b for a, b in zip(ends[::2], ends[1::2], strict=True))
        found[:, j] = (45 * one - 9 * two + three) / (60 * h)
    scale = np.sqrt(np.abs(np.diag(K)))
    assert np.abs((0.5 * (found + found.T) - K) / np.outer(scale, scale)).max() < 1e-8
    m = wrench[3:]
    skew = np.zeros((6, 6))
    skew[3:, 3:] = 0.5 * np.array([[0, -m[2], m[1]], [m[2], 0, -m[0]], [-m[1], m[0], 0]])
    assert np.abs((0.5 * (found - found.T) + skew) / np.outer(scale, scale)).max() < 1e-8


@pytest.mark.parametrize("kind", ["light", "profile"])
@pytest.mark.parametrize("seed", range(3))
def test_steps_inside_a_leaf_converge_quadratically(kind, seed):
    """Of a tenth of the way that end q moves and turns, one step leaves a tenth of the share, whatever moment it carries."""
    leaf, rng = Leaf(kind), np.random.default_rng(seed)
    d, Q = leaf.load(rng)
    inner, xi, left = leaf.inner.copy(), rng.normal(size=6) * [1e-5, 1e-4, 1e-5, 1e-2, 1e-2, 1e-2], []
    for share in (0.1, 0.01):
        leaf.inner[:] = inner
        there = d + share * xi[:3], exp(share * xi[3:]) @ Q
        leaf.settle(*there, 1)
        once = leaf.inner.copy()
        leaf.settle(*there)
        # the moment that the leaf carries
        moment = slice(leaf.N + 3, leaf.N + 6)
        left.append(np.abs(once - leaf.inner)[moment].max() / np.abs(inner - leaf.inner)[moment].max())
    assert left[1] < 0.15 * left[0]


@pytest.mark.parametrize("kind", KINDS)
def test_tangent_of_the_amplitudes_is_the_derivative_of_their_residual(kind, rng):
    """At states that are no equilibrium, too; again the symmetric part."""
    leaf = Leaf(kind)
    N, inner = leaf.N, np.concatenate([rng.normal(size=leaf.N) * 8.0, rng.normal(size=6) * 300.0])
    f = leaf.fields

    def residual(state):
        fill_leaf_fields(leaf.value, leaf.number, state, leaf.pull, f)
        strain_tangent(leaf.value, leaf.number, state, f)
        return f.Y[:, 6].copy()

    found = np.empty((N, N))
    for j in range(N):
        one, two = (
            residual(inner + h * np.eye(N + 6)[j]) - residual(inner - h * np.eye(N + 6)[j])
            for h in (0.02, 0.04)
        )
        found[:, j] = (8 * one - two) / (12 * 0.02)
    residual(inner)
    scale = np.sqrt(np.abs(np.diag(f.W)))
    assert np.abs((0.5 * (found + found.T) - f.W) / np.outer(scale, scale)).max() < 1e-8
    # only the end moment is no gradient
    psi, m = f.psi[-1], inner[N + 3 :]
    skew = 0.5 * np.einsum("ai,bj,c,abc->ij", psi, psi, m, _levi_civita())
    off = 0.5 * (found - found.T)
    assert np.minimum(np.abs(off - skew).max(), np.abs(off + skew).max()) < 1e-8 * np.abs(f.W).max()


def _levi_civita():
    found = np.zeros((3, 3, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        found[i, j, k], found[i, k, j] = 1.0, -1.0
    return found


@pytest.mark.parametrize("kind", KINDS)
def test_a_leaf_bent_in_its_plane_is_worked_on_as_one_that_is_not(kind, rng):
    """A twist too small for any number to notice takes the way of leaf springs bent anyhow."""
    leaf = Leaf(kind, gravity=(300.0, -500.0, 0.0))
    f, N = leaf.fields, leaf.N
    inner = np.concatenate([np.zeros(7), rng.normal(size=6) * 8.0, rng.normal(size=6) * 300.0])
    inner[N + 2 : N + 5] = 0.0
    found = []
    for twist in (0.0, 1e-200):
        inner[0] = twist
        fill_leaf_fields(leaf.value, leaf.number, inner, leaf.pull, f)
        strain_tangent(leaf.value, leaf.number, inner, f)
        found.append((f.W.copy(), f.Y[:, 6].copy()))
    own = leaf.number[:2].sum()
    assert not found[0][0][:own, own:].any()
    scale = np.sqrt(np.abs(np.diag(found[1][0])))
    assert np.abs((found[0][0] - found[1][0]) / np.outer(scale, scale)).max() < 1e-13
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-12, abs=1e-12 * np.abs(found[1][1]).max())
    # far from what the leaf is without a load
    fill_leaf_fields(leaf.value, leaf.number, np.zeros(N + 6), leaf.pull, f)
    leaf.fields.n[:] = 0.0
    strain_tangent(leaf.value, leaf.number, np.zeros(N + 6), f)
    assert np.abs((found[0][0] - f.W) / np.outer(scale, scale))[:own, :own].max() > 0.1


def test_a_leaf_with_any_moment_force_or_curvature_out_of_its_plane_is_not_flat():
    number, n = np.array([2, 1, 2, 3]), np.zeros((3, 3))
    n[:, :2] = 1.0
    inner = np.concatenate([np.zeros(3), np.ones(2), [1.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    assert is_flat(number, inner, n)
    for i in (0, 1, 2, 8, 9):
        bent = inner.copy()
        bent[i] = 1e-200
        assert not is_flat(number, bent, n)
    for h in range(3):
        pulled = n.copy()
        pulled[h, 2] = 1e-200
        assert not is_flat(number, inner, pulled)


@pytest.mark.parametrize("kind", KINDS)
def test_the_leaf_before_condensation(kind):
    """Its fields are differences of its shape, its blocks those of the inverse of the whole, its mass that of its points."""
    leaf, rng = Leaf(kind), np.random.default_rng(0)
    leaf.settle(*leaf.load(rng))
    N, K, inner, number, pull = leaf.N, leaf.K.copy(), leaf.inner.copy(), leaf.number, leaf.pull

    def at(state, g=pull):
        found = uncondensed_leaves(leaf.value[None], number, state[None], g[None] if len(g) else None)
        moment = load_derivatives(leaf.value[None], number, state[None], g[None]).s[0] if len(g) else 0.0
        return found, moment

    leaves, _ = at(inner)
    S, J, steps = np.zeros((6, 6)), leaves.J[0], [*[1e-3] * N, *[1.0] * 3]
    S[:3, :3] = leaves.S[0]
    by_state = load_derivatives(leaf.value[None], number, inner[None], pull[None]) if len(pull) else None
    for i, h in enumerate(steps):
        (up, s_up), (down, s_down) = (at(inner + k * h * np.eye(N + 6)[i]) for k in (1, -1))
        moved, end = (up.r - down.r)[0] / (2 * h), (up.end - down.end)[0] / (2 * h)
        if i < N:
            turns = [log(a @ b.T) / (2 * h) for a, b in zip(up.R[0], down.R[0], strict=True)]
            assert leaves.rho[0, :, :, i] == pytest.approx(moved, rel=1e-5, abs=1e-8)
            assert leaves.psi[0, :, :, i] == pytest.approx(np.array(turns), rel=1e-5, abs=1e-8)
            assert J[:3, i] == pytest.approx(end, rel=1e-5, abs=1e-8)
        else:
            assert S[:3, i - N] == pytest.approx(end, rel=1e-5, abs=1e-6 * np.abs(S).max())
        if by_state is not None:
            found = by_state.eta[0, :, i] if i < N else by_state.B[0, :, i - N]
            size = np.abs(by_state.eta if i < N else by_state.B).max()
            assert found == pytest.approx((s_up - s_down) / (2 * h), rel=1e-5, abs=1e-7 * size)
    for i in range(len(pull)):
        s_up, s_down = (at(inner, pull + k * np.eye(3)[i])[1] for k in (1, -1))
        assert by_state.D[0, :, i] == pytest.approx(
            0.5 * (s_up - s_down), abs=1e-6 * np.abs(by_state.D).max()
        )
    assert stretch_shear_compliances(leaf.value[None], number, inner[None])[0] == pytest.approx(leaves.S[0])
    P, Z, whole = (part[0] for part in strain_flexibility(leaves))
    scale = np.sqrt(np.abs(np.diag(K)))
    assert np.abs((whole - K) / np.outer(scale, scale)).max() < 1e-9
    inverse = np.linalg.inv(np.block([[leaves.W[0], -J.T], [J, S]]))
    assert pytest.approx(inverse[:N, N:], abs=1e-9 * np.abs(P).max()) == P
    assert pytest.approx(inverse[:N, :N], abs=1e-9 * np.abs(Z).max()) == Z
    # kinetic energy of a rate of everything; stretch and shear are spread evenly, but for bubbles
    line, rate, xi, b = np.array([3.0, 0.2, 0.5, 0.1]), *(rng.normal(size=n) for n in (6, 6, N))
    bubble = 0.1 * rng.normal(size=(BUBBLES, 3))
    shapes = [Legendre.basis(j + 1, domain=[0, 1]).integ(lbnd=0) for j in range(BUBBLES)]
    a, twice = P @ xi + b, 0.0
    for w, s, r, R, rho, psi in zip(
        *(getattr(leaves, n)[0] for n in ("weight", "s", "r", "R", "rho", "psi")), strict=True
    ):
        velocity = rate[:3] + np.cross(rate[3:], r) + rho @ a + s * (xi[:3] - J[:3] @ a)
        velocity = velocity + L * sum(shape(s) * own for shape, own in zip(shapes, bubble, strict=True))
        spin = R.T @ (rate[3:] + psi @ a)
        twice += L * w * (line[0] * velocity @ velocity + spin @ (line[1:] * spin))
    root = strain_mass_root(leaves, P[None], line)[0] @ np.concatenate([rate, xi, b, bubble.ravel()])
    assert root @ root == pytest.approx(twice, rel=1e-10)
    assert leaves.s[0] == pytest.approx(quadrature_points(leaf.value, number))


@pytest.mark.parametrize("kind", KINDS)
def test_what_a_leaf_recovers_is_off_by_the_square_of_the_step(kind):
    """End q moved and turned about all axes, and gravity changed, from an equilibrium that carries force and moment."""
    leaf, rng = Leaf(kind), np.random.default_rng(1)
    d, Q = leaf.load(rng)
    inner, pull, off = leaf.inner.copy(), leaf.pull.copy(), []
    xi = np.concatenate([1e-5 * rng.normal(size=3), 3e-3 * rng.normal(size=3)])
    change = 0.2 * rng.normal(size=3) * pull if len(pull) else np.zeros(0)
    for share in (1.0, 0.01):
        leaf.inner[:], leaf.pull = inner, pull
        leaf.settle(d, Q, 2)
        leaf.condense(d, Q)
        before = np.concatenate([leaf.inner, leaf.lam[:6], leaf.first_moment()])
        if len(pull):
            # the last numbers of the gravity block are the change of gravity, which the condensation does not know
            leaf.store[-3:] = share * change
        strain_recover(leaf.value, leaf.number, leaf.inner, leaf.store, share * xi, 1.0, np.empty(6))
        recovered = leaf.inner.copy()
        leaf.inner[:], leaf.pull = inner, pull + share * change
        there = d + share * xi[:3], exp(share * xi[3:]) @ Q
        leaf.condense(*there)
        predicted = np.concatenate([recovered, leaf.lam[:6], leaf.first_moment()])
        leaf.settle(*there)
        after = np.concatenate([leaf.inner, leaf.inner[leaf.N :], leaf.first_moment()])
        cuts = np.cumsum([0, leaf.N, 3, 3, 3, 3] + [3] * (kind == "weight"))
        off.append(
            [
                np.abs((predicted - after)[i:j]).max() / np.abs((after - before)[i:j]).max()
                for i, j in pairwise(cuts)
            ]
        )
    assert np.all(np.array(off[1]) < 0.02 * np.array(off[0]))
    assert np.max(off[0]) < 0.1


@pytest.mark.parametrize("k", range(6))
def test_any_force_or_moment_alone_loads_a_leaf(k, rng):
    """As with a second one that is too small for any number to notice."""
    leaf = Leaf("light")
    f, N = leaf.fields, leaf.N
    inner, found = np.concatenate([8.0 * rng.normal(size=N), np.zeros(6)]), []
    for load in (0.0, 300.0, 300.0):
        inner[N + k] = load
        inner[N + (k + 1) % 6] = 1e-200 if len(found) == 2 else 0.0
        fill_leaf_fields(leaf.value, leaf.number, inner, leaf.pull, f)
        strain_tangent(leaf.value, leaf.number, inner, f)
        found.append(f.W.copy())
    assert found[1] == pytest.approx(found[2], rel=1e-12, abs=1e-12 * np.abs(found[2]).max())
    assert np.abs(found[1] - found[0]).max() > 1e-6 * np.abs(found[0]).max()
