"""Paper 2, eq. 11: bodies joined by shared interface nodes, as the package does, and by constraints with multipliers."""

import numpy as np
import pytest
from scenes import STEEL
from scipy.spatial.transform import Rotation

import ksd
from ksd.elements.modal import modal_condense, modal_recover
from ksd.modal import ModalBasis, with_modal_bodies
from ksd.model.compile import compile_scene
from ksd.model.mesh import Mesh
from ksd.solvers.conventional import solve_conventional

L, SPREAD = 0.1, 0.06
SECTION = ksd.rectangle(0.5e-3, 0.02)
EI = STEEL.E * 0.02 * 0.5e-3**3 / 12
FORCE = np.array([0.2 * EI / L**2, 5.0 * EI / L**2, 0.5 * EI / L**2])


def guide():
    scene = ksd.Mechanism("guide")
    tip = scene.link("tip")
    for k, y in enumerate((-0.5 * SPREAD, 0.5 * SPREAD)):
        scene.leaf(
            scene.ground, tip, start=(0, y, 0), end=(L, y, 0), section=SECTION, material=STEEL, width_axis="z",
            name=f"leaf {k + 1}",
        )  # fmt: skip
    scene.load(tip, force=tuple(FORCE), at=(L, 0, 0))
    return scene


def skew(v):
    return np.cross(np.eye(3), v)


class Body:
    """One modal body in its floating frame (end p, held), with the pose of end q as generalized coordinates."""

    def __init__(self, model, i):
        m = model.arrays.members
        self.value, self.number = m.value[m.value_at[i] :], m.number[i]
        self.inner = model.rest.inner[m.inner_at[i] : m.inner_at[i + 1]].copy()
        self.store, self.axes = np.zeros(m.store_at[i + 1] - m.store_at[i]), m.frame[i, 0]
        self.d, self.Q = np.array([L, 0.0, 0.0]), np.eye(3)
        self.turn = np.kron(np.eye(2), self.axes)

    def resist(self):
        """Force (6,) and tangent (6, 6) on end q, global axes, inner coordinates condensed."""
        lam, K = np.zeros(12), np.zeros((6, 6))
        modal_condense(self.value, self.number, self.inner, self.store, self.d, self.Q, lam, K)
        return self.turn @ lam[:6], self.turn @ K @ self.turn.T

    def move(self, xi):
        local = self.turn.T @ xi
        modal_recover(self.value, self.number, self.inner, self.store, local, 1.0)
        self.d, self.Q = self.d + local[:3], Rotation.from_rotvec(local[3:]).as_matrix() @ self.Q


def joined_by_multipliers(model, steps=8):
    """Newton on K q + Psi_q^T lambda = Q_a, Psi = 0 (12 equations), load by load: shift and rotation of the tip, lambda."""
    bodies = [Body(model, i) for i in range(2)]
    roots = [np.array([0.0, y, 0.0]) for y in (-0.5 * SPREAD, 0.5 * SPREAD)]
    x, R, multiplier = np.array([L, 0.0, 0.0]), np.eye(3), np.zeros((2, 6))
    for k in range(1, steps + 1):
        for _ in range(30):
            A, b = np.zeros((30, 30)), np.zeros(30)
            b[12:15] = k / steps * FORCE
            for i, (body, root) in enumerate(zip(bodies, roots, strict=True)):
                own, row = slice(6 * i, 6 * i + 6), slice(18 + 6 * i, 24 + 6 * i)
                force, A[own, own] = body.resist()
                turned = R @ root  # the arm from the loaded point to this leaf
                T = np.eye(6)
                T[:3, 3:] = -skew(turned)
                A[own, row] = A[row, own] = np.eye(6)
                A[12:18, row], A[row, 12:18] = -T.T, -T
                b[own] = -force - multiplier[i]
                b[12:18] += T.T @ multiplier[i]
                f = multiplier[i, :3]
                # the turning arm: derivative of T^T lambda by the rotation of the tip
                bend = 0.5 * (np.outer(turned, f) + np.outer(f, turned)) - (turned @ f) * np.eye(3)
                A[15:18, 15:18] -= bend
                gap = root + body.axes @ body.d - x - turned
                b[row] = -np.concatenate(
                    [gap, Rotation.from_matrix(body.axes @ body.Q @ body.axes.T @ R.T).as_rotvec()]
                )
            move = np.linalg.solve(A, b)
            for i, body in enumerate(bodies):
                body.move(move[6 * i : 6 * i + 6])
            x, R = x + move[12:15], Rotation.from_rotvec(move[15:18]).as_matrix() @ R
            multiplier += move[18:].reshape(2, 6)
            if np.abs(move[:18]).max() < 1e-11:
                break
        else:
            raise AssertionError("no equilibrium")
    return x - [L, 0, 0], R, multiplier


def test_shared_nodes_and_multipliers_are_one_equilibrium():
    """Stroke 0.2 L and a load across: the same pose both ways, the multipliers in balance with the load, and the full model
    beside them."""
    chains = compile_scene(guide(), mesh=Mesh("corotational", elements=10))
    model = with_modal_bodies(chains, ModalBasis())
    shared = solve_conventional(model, {}, planar=False, steps=4)
    shift, R, multiplier = joined_by_multipliers(model)
    assert shift[1] > 0.15 * L
    assert shift == pytest.approx(shared.displacement("tip", (L, 0, 0)), abs=1e-8 * L)
    assert Rotation.from_matrix(R).as_rotvec() == pytest.approx(shared.rotation("tip"), abs=1e-8)
    assert -multiplier[:, :3].sum(axis=0) == pytest.approx(FORCE, abs=1e-8 * np.abs(multiplier).max())
    full = solve_conventional(chains, {}, planar=False, steps=4)
    assert shift == pytest.approx(full.displacement("tip", (L, 0, 0)), abs=1e-4 * L)
