"""Inertia in a time step: forces and tangents are derivatives of energies, in the plane and in space."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ksd.elements import planar_leaf
from ksd.elements.ends import member_pose, member_tangent
from ksd.elements.inertia import (
    add_body,
    add_member_inertia,
    inertia_store,
    inertia_tables,
    move_inertia_forces,
    set_inertia_forces,
)
from ksd.elements.strain import allocate_leaf_fields, strain_condense, strain_gravity_block, strain_recover
from ksd.elements.strain_values import make_modes, strain_values

C0, LENGTH = 50.0, 0.7


def turned(v, R):
    return Rotation.from_rotvec(v).as_matrix() @ R


def test_the_force_of_a_body_is_the_derivative_of_its_energy(rng):
    root = rng.normal(size=(3, 3))
    body = np.concatenate([[1.3], rng.normal(size=3), (root @ root.T).ravel()])
    x, R = rng.normal(size=3), turned(rng.normal(size=3), np.eye(3))
    known = np.concatenate([rng.normal(size=3), turned(rng.normal(size=3), np.eye(3)).ravel()])

    def energy(u):
        now, before = turned(u[3:], R), known[3:].reshape(3, 3)
        off = x + u[:3] + now @ body[1:4] - known[:3] - before @ body[1:4]
        spread = np.trace((now - before) @ body[4:].reshape(3, 3) @ (now - before).T)
        return 0.5 * C0 * (body[0] * off @ off + spread)

    force, tangent, h = np.zeros(6), np.zeros((6, 6)), 1e-4
    add_body(body, known, C0, x, R, force, tangent)
    step = h * np.eye(6)
    slope = [(energy(a) - energy(-a)) / (2 * h) for a in step]
    bend = [
        [(energy(a + b) - energy(a - b) - energy(b - a) + energy(-a - b)) / (4 * h * h) for b in step]
        for a in step
    ]
    assert force == pytest.approx(slope, rel=1e-6, abs=1e-6 * np.abs(force).max())
    assert tangent == pytest.approx(np.array(bend), rel=1e-5, abs=1e-5 * np.abs(tangent).max())


class Leaf:
    """A leaf with inertia, tapered, bent and moved at random, between two nodes."""

    def __init__(self, planar, counts, is_damped, rng):
        orders, points = (3, 3, 5), 8
        table, N, modes = make_modes(orders, points), sum(orders), sum(counts)
        bent = np.where(np.arange(N) >= (6 if planar else 0), 0.2, 0.0)
        value, number = strain_values(
            length=LENGTH, rigidity=np.array([2.0, 30.0, 1.5]), compliance=np.array([1e-3, 2e-3, 3e-3]), orders=orders,
            points=points, amplitudes=0.5 * bent * rng.normal(size=N),
        )  # fmt: skip
        line, radius = 0.6 * (1 + 0.5 * table.s), 0.05 * (1 + table.s)
        mass = inertia_tables(table.s, LENGTH * table.weight, LENGTH * table.integral, line, radius, counts)
        D, size = 3 * modes, 8 * N + 42 + 3 * modes * N
        if planar:
            value, number = planar_leaf.planar_values(value, number)
            size = planar_leaf.store_size(orders[2]) + 4 * orders[2] * modes
        self.value, self.number, self.planar = np.concatenate([value, mass]), number.copy(), planar
        self.number[5:7] = counts
        self.store = np.zeros(size + D * (10 + D) + inertia_store(D))
        self.fields = allocate_leaf_fields(N, points, modes)
        self.active = np.array([0, 1, 5]) if planar else np.arange(6)
        self.columns = np.concatenate([self.active, 6 + self.active])
        self.mass = LENGTH * table.weight @ line
        flat = np.array([1.0, 1.0, 0.0]) if planar else np.ones(3)
        axis = np.array([0.0, 0.0, 1.0]) if planar else 0.3 * rng.normal(size=3)
        self.offset = 0.1 * flat * rng.normal(size=(2, 3))
        self.frame = np.stack([turned(0.3 * axis, np.eye(3)), turned(-0.4 * axis, np.eye(3))])
        R = np.eye(3) if planar else turned(rng.normal(size=3), np.eye(3))
        p = R @ self.frame[0]
        end = (
            np.array([0.1, 0.2, 0.0])
            + R @ self.offset[0]
            + p @ (np.array([0.66, 0.1, 0.05]) * [1, 1, not planar])
        )
        other = p @ turned(0.3 * axis, np.eye(3)) @ self.frame[1].T
        self.R = np.stack([R, other])
        self.x = np.stack([np.array([0.1, 0.2, 0.0]), end - other @ self.offset[1]])
        self.inner = np.zeros(N + 6 + 2 * D + (1 + N) * is_damped)
        self.inner[N + 6 + D : N + 6 + 2 * D] = (0.03 * flat * rng.normal(size=(modes, 3))).ravel()
        if is_damped:
            self.inner[N + 6 + 2 * D], self.inner[N + 7 + 2 * D :] = 0.3, 0.05 * rng.normal(size=N)

    def assemble(self, x, R, inner):
        """Forces and tangent on both nodes; the residual inside is stored in self.off."""
        pose, Q, lam, K = np.zeros(18), np.zeros((3, 3)), np.zeros(12), np.zeros((6, 6))
        T, force, args = np.zeros((12, 12)), np.zeros(12), (self.value, self.number, inner, self.store)
        member_pose(np.array([0, 1]), 0, self.offset.ravel(), 0, self.frame.ravel(), 0, x, R, pose, Q)
        d = pose[:9].reshape(3, 3).T @ pose[15:18]
        set_inertia_forces(self.number, self.planar, pose, inner, self.store)
        if self.planar:
            _, n, m, status = planar_leaf.condense(*args, d, Q, lam, K)
            planar_leaf.gravity_block(*args, lam)
        else:
            _, n, m, status = strain_condense(*args, self.fields, d, Q, lam, K)
            strain_gravity_block(*args, self.fields, lam, K)
        member_tangent(pose, lam, K, T, force, np.zeros((6, 6)), np.zeros((6, 12)))
        negatives, df, _, more = add_member_inertia(
            self.active, len(self.active), C0, self.value, self.number, self.planar, x[0], pose, inner, self.store,
            self.mass, T, force,
        )  # fmt: skip
        assert (status, more, negatives) == (0, 0, 0)
        self.off = max(n, m, df)
        return pose, T, force

    def recover(self, pose, move, inner):
        xi, axes = np.zeros(6), pose[:9].reshape(3, 3)
        gap = move[6:9] - move[:3] + np.cross(move[9:], pose[12:15]) - np.cross(move[3:6], pose[9:12])
        xi[:3], xi[3:] = axes.T @ gap, axes.T @ (move[9:] - move[3:6])
        args = self.value, self.number, inner, self.store
        move_inertia_forces(
            self.active, len(self.active), self.number, self.planar, pose, move, inner, 1.0, self.store
        )
        if self.planar:
            planar_leaf.recover(*args, xi, 1.0)
        else:
            strain_recover(*args, xi, 1.0, np.zeros(6))

    def settle(self, u=None):
        """Inner state, pose, tangent and forces in balance with both nodes moved by u (12,)."""
        u = np.zeros(12) if u is None else u
        x = self.x + u.reshape(2, 6)[:, :3]
        R = np.stack([turned(v, own) for v, own in zip(u.reshape(2, 6)[:, 3:], self.R, strict=True)])
        for _ in range(15):
            pose, T, force = self.assemble(x, R, self.inner)
            if self.off < 1e-12:
                break
            self.recover(pose, np.zeros(12), self.inner)
        assert self.off < 1e-11
        return self.inner.copy(), pose, T, force


CASES = [(True, (3, 0), False), (True, (4, 2), True), (False, (3, 0), True), (False, (3, 2), False)]


@pytest.mark.parametrize("case", CASES, ids=str)
def test_the_tangent_of_a_leaf_is_the_derivative_of_its_forces(case, rng):
    leaf = Leaf(*case, rng)
    inner, _, T, _ = leaf.settle()
    h, found = 1e-5, np.zeros((12, 12))
    for c in leaf.columns:
        step = h * np.eye(12)[c]
        leaf.inner[:] = inner
        up = leaf.settle(step)[3]
        found[:, c] = (up - leaf.settle(-step)[3]) / (2 * h)
    at = np.ix_(leaf.columns, leaf.columns)
    # in the chart of rotation vectors a derivative of forces has half of each moment as its skew part
    assert T[at] == pytest.approx(T[at].T, abs=1e-10 * np.abs(T).max())
    assert T[at] == pytest.approx(0.5 * (found + found.T)[at], abs=1e-6 * np.abs(T).max())


@pytest.mark.parametrize("case", CASES, ids=str)
def test_inner_states_follow_the_nodes_to_first_order(case, rng):
    leaf = Leaf(*case, rng)
    inner, pose, _, _ = leaf.settle()
    move = np.zeros(12)
    move[leaf.columns] = rng.normal(size=len(leaf.columns))
    off = []
    for size in (2e-3, 1e-3):
        leaf.inner[:] = inner
        leaf.settle()
        before = leaf.inner.copy()
        leaf.recover(pose, size * move, leaf.inner)
        followed = leaf.inner.copy()
        leaf.inner[:] = before
        off.append(np.abs(followed - leaf.settle(size * move)[0]).max() / np.abs(followed - before).max())
    assert off[0] < 0.1
    assert off[1] == pytest.approx(0.5 * off[0], rel=0.2)


def test_the_modes_are_orthogonal_under_any_mass():
    table, line = make_modes((1, 1, 1), 9), np.linspace(1.0, 3.0, 9)
    weight, integral = LENGTH * table.weight, LENGTH * table.integral
    flat = inertia_tables(table.s, weight, integral, line, np.ones(9), (4, 1))
    Q, c, N = flat[:45].reshape(9, 5), flat[45:50], flat[50:]
    mass = weight @ line
    # the first mode is weight; the others have no mean
    assert Q[:, 0] == pytest.approx(mass - integral @ line)
    assert c == pytest.approx([mass, 0, 0, 0, 0], abs=1e-12 * mass)
    assert N[0] == pytest.approx(mass)
    assert N[4] == pytest.approx(mass)
