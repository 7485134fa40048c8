"""Bodies between two nodes: forces and tangents are the derivatives of an energy written down here."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ksd.elements.ends import member_norms, member_tangent
from ksd.elements.leaf_loads import add_member_loads, move_member_loads, set_member_loads
from ksd.elements.linear import linear_condense
from ksd.elements.spring import coil_condense
from ksd.elements.strain_values import GRAVITY_BLOCK_SIZE

pytestmark = pytest.mark.plain

STENCIL = ((1, 8.0), (-1, -8.0), (2, -1.0), (-2, 1.0))


def exp(v):
    return Rotation.from_rotvec(v).as_matrix()


def log(R):
    return Rotation.from_matrix(R).as_rotvec()


def differences(function, size, h):
    """Derivative (.., size) at zero by central differences of fourth order."""
    unit = h * np.eye(size)
    return np.stack([sum(w * function(k * e) for k, w in STENCIL) / (12 * h) for e in unit], axis=-1)


def hessian(function, size, h=0.01):
    return differences(lambda x: differences(lambda y: function(x + y), size, h), size, h)


def symmetric(rng, n):
    A = rng.normal(size=(n, n))
    return A + A.T


class Body:
    """V(xi, g) = F.xi + xi K xi / 2 + xi B g - s.g + g D g / 2 between two nodes at random; xi of end q from where it is."""

    def __init__(self, rng):
        self.x, self.R = rng.normal(size=(2, 3)), [exp(rng.normal(size=3)) for _ in range(2)]
        self.offset, self.frame = rng.normal(size=(2, 3)), [exp(rng.normal(size=3)) for _ in range(2)]
        self.F, self.K = rng.normal(size=6), symmetric(rng, 6)
        self.B, self.s, self.D = rng.normal(size=(6, 3)), rng.normal(size=3), symmetric(rng, 3)
        self.g, self.mass = rng.normal(size=3), 0.7
        self.d, self.Q = self.relative(np.zeros(12))[:2]

    def relative(self, move):
        """Position and axes of end q in frame p, and axes and position of end p, both nodes moved by move (12,)."""
        R = [exp(move[6 * e + 3 : 6 * e + 6]) @ self.R[e] for e in range(2)]
        x = [self.x[e] + move[6 * e : 6 * e + 3] + R[e] @ self.offset[e] for e in range(2)]
        P, Q = (R[e] @ self.frame[e] for e in range(2))
        return P.T @ (x[1] - x[0]), P.T @ Q, P, x[0]

    def energy(self, move, *, weight):
        d, Q, P, start = self.relative(move)
        xi, g = np.concatenate([d - self.d, log(Q @ self.Q.T)]), P.T @ self.g
        V = self.F @ xi + 0.5 * xi @ self.K @ xi
        if weight:
            V += xi @ self.B @ g - self.s @ g + 0.5 * g @ self.D @ g - self.mass * self.g @ start
        return V

    def pose(self):
        """(18,) as kernels take it."""
        _, _, P, start = self.relative(np.zeros(12))
        end = start + P @ self.d
        return np.concatenate([P.ravel(), end - self.x[0], end - self.x[1], end - start])


PLAIN, NOTHING = np.zeros(7, np.int64), np.zeros(0)
"""Settings and constants of a member with weight alone."""


@pytest.mark.parametrize("weight", [False, True])
def test_forces_and_tangent_on_both_nodes(weight, rng):
    """Forces take the predicted wrench and first moment, the tangent those of the present state."""
    for _ in range(3):
        body = Body(rng)
        pose, g = body.pose(), body.relative(np.zeros(12))[2].T @ body.g
        T, force, scratch = np.empty((12, 12)), np.empty(12), (np.empty((6, 6)), np.empty((6, 12)))
        wrench, store = body.F + weight * body.B @ g, rng.normal(size=GRAVITY_BLOCK_SIZE + 4)
        block = store[4:]
        set_member_loads(
            PLAIN, False, pose, np.array([body.mass, *(body.g / 0.5), *np.zeros(7)]), 0.5, NOTHING, store
        )
        assert block[:3] == pytest.approx(g)
        block[9:27], block[27:36] = body.B.ravel(), body.D.ravel()
        for predicted in (True, False):
            lam, s = rng.normal(size=12), body.s - body.D @ g
            lam[:6] = lam[:6] if not predicted else wrench
            lam[6:] = lam[6:] if predicted else wrench
            block[3:9] = rng.normal(size=6)
            block[3 if predicted else 6 :][:3] = s
            member_tangent(pose, lam, body.K, T, force, *scratch)
            if weight:
                add_member_loads(NOTHING, PLAIN, False, pose, store, body.mass, T, force)
            if predicted:
                assert force == pytest.approx(
                    differences(lambda x, b=body: b.energy(x, weight=weight), 12, 0.01), abs=1e-6
                )
            else:
                assert pytest.approx(hessian(lambda x, b=body: b.energy(x, weight=weight), 12), abs=1e-5) == T


def test_gravity_in_a_frame_that_turns(rng):
    body, store = Body(rng), rng.normal(size=GRAVITY_BLOCK_SIZE + 4)
    pose, move = body.pose(), np.concatenate([rng.normal(size=3), 1e-4 * rng.normal(size=3)])
    P = pose[:9].reshape(3, 3)
    store[4:7] = P.T @ body.g
    move_member_loads(PLAIN, False, pose, move, np.zeros(6), NOTHING, 1.0, store)
    once, back = ((exp(k * move[3:]) @ P).T @ body.g for k in (1, -1))
    assert store[-3:] == pytest.approx(0.5 * (once - back), rel=1e-6, abs=1e-10)


def test_norms_of_a_member(rng):
    lam, force, norms = rng.normal(size=12), rng.normal(size=12), np.empty(6)
    member_norms(lam, force, norms)
    exact = np.linalg.norm(np.concatenate([lam[:6], force]).reshape(6, 3), axis=1)
    assert norms == pytest.approx(exact)


def test_a_linear_body_near_its_reference(rng):
    """Wrench exact; of the stiffness what is of second order in the rotation is left out."""
    for _ in range(3):
        F, K, d0, R0 = rng.normal(size=6), symmetric(rng, 6), rng.normal(size=3), exp(rng.normal(size=3))
        inner = np.concatenate([d0, R0.ravel(), F, K.ravel()])
        size, off = 0.01, rng.normal(size=3)
        d, Q = d0 + 0.3 * rng.normal(size=3), exp(size * off / np.linalg.norm(off)) @ R0
        lam, found = np.empty(12), np.empty((6, 6))

        def energy(move, d=d, Q=Q, d0=d0, R0=R0, F=F, K=K):
            xi = np.concatenate([d + move[:3] - d0, log(exp(move[3:]) @ Q @ R0.T)])
            return F @ xi + 0.5 * xi @ K @ xi

        assert linear_condense(inner, d, Q, lam, found, np.empty((2, 6)), np.empty((6, 6))) == (
            0,
            0.0,
            0.0,
            0,
        )
        assert lam[:6] == pytest.approx(differences(energy, 6, 0.01), abs=1e-7)
        assert lam[:6].tolist() == lam[6:].tolist()
        assert pytest.approx(hessian(energy, 6), abs=0.5 * size**2) == found


@pytest.mark.parametrize("free_length", [0.0, 0.8])
def test_a_coil_spring(free_length, rng):
    k, d, lam, K = 2.3, rng.normal(size=3), np.empty(12), np.empty((6, 6))
    assert coil_condense(np.array([k, free_length]), d, lam, K) == 0

    def energy(move):
        return 0.5 * k * (np.linalg.norm(d + move) - free_length) ** 2

    assert lam == pytest.approx(np.tile([*differences(energy, 3, 0.005), 0, 0, 0], 2), abs=1e-6)
    exact = np.zeros((6, 6))
    exact[:3, :3] = hessian(energy, 3, 0.005)
    assert pytest.approx(exact, abs=1e-5) == K
    assert coil_condense(np.array([k, free_length]), np.zeros(3), lam, K) == (2 if free_length else 0)
