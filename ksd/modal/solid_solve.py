"""Equilibrium of a meshed solid and of its reduction under a load on face B: the full model beside the fast one.

Face A is held; face B is rigid, its pose (shift, rotation) is unknown, and a dead force and moment act on its middle.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from ksd.beam.modal import modal_recover, modal_sizes
from ksd.beam.polynomial import polynomial_condense
from ksd.errors import ConvergenceError
from ksd.modal.solid import Solid
from ksd.modal.solid_basis import SolidBasis

MOST = 40


@dataclass(frozen=True)
class Pressed:
    """Face B under load: shift (3,) m, rotation R (3, 3), stiffness (6, 6) of force and moment about it with the
    inside condensed (rows out of the plane zero for 2D), iterations, thread time [s] of one iteration, and the state
    (displacements of the full model, inner coordinates of the reduced one)."""

    shift: np.ndarray
    R: np.ndarray
    stiffness: np.ndarray
    iterations: int
    time: float
    state: np.ndarray


def _turned(R: np.ndarray, psi: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(psi).as_matrix() @ R)


def _free(flat: bool) -> list[int]:
    """Motions of face B that exist: x, y and the rotation about z in 2D."""
    return [0, 1, 5] if flat else [0, 1, 2, 3, 4, 5]


def press(solid: Solid, force: np.ndarray, moment: np.ndarray, *, steps: int = 4) -> Pressed:
    """The full model under `force` (3,) [N] and `moment` (3,) [Nm], in load steps. Raises ConvergenceError."""
    u, shift, R = np.zeros(solid.size), np.zeros(3), np.eye(3)
    inner, face, free = solid.inner, solid.face_b, _free(solid.flat)
    arm = solid.place[face] - np.array([solid.length, 0.0, 0.0])
    row = solid.component[face]
    count, spent, wrench = 0, 0.0, np.concatenate([force, moment])
    stiffness = np.zeros((6, 6))
    for k in range(1, steps + 1):
        for _ in range(MOST):
            clock = time.thread_time()
            turned = arm @ R.T
            u[face] = (shift + turned - arm)[np.arange(len(face)), row]
            T = np.zeros((len(face), 6))
            T[np.arange(len(face)), row] = 1.0
            for axis in range(3):
                T[:, 3 + axis] = np.cross(np.eye(3)[axis], turned)[np.arange(len(face)), row]
            step, stiffness, worst = _newton(solid, u, (inner, face, T, turned, row), k / steps * wrench)
            count, spent = count + 1, spent + time.thread_time() - clock
            u[inner] += step[0]
            move = np.zeros(6)
            move[free] = step[1][free]
            shift, R = shift + move[:3], _turned(R, move[3:])
            if worst < 1e-9 or np.abs(step[0]).max() < 1e-12 * solid.length:
                break
        else:
            raise ConvergenceError(
                f"the solid did not come to rest within {MOST} iterations at {100 * k / steps:.3g} %"
            )
    return Pressed(shift, R, stiffness, count, spent / count, u)


def _newton(
    solid: Solid, u: np.ndarray, parts: tuple[np.ndarray, ...], wrench: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray], np.ndarray, float]:
    """Newton step (inner, pose), condensed stiffness (6, 6) of the pose, and the relative residual."""
    from scipy.sparse.linalg import splu

    inner, face, T, turned, row = parts
    free = _free(solid.flat)
    f, K = solid.force_and_tangent(u)
    Kib = K[inner][:, face] @ T
    factor = splu(K[inner][:, inner].tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
    X = factor.solve(np.column_stack([Kib, f[inner]]))
    S = T.T @ (K[face][:, face] @ T) - Kib.T @ X[:, :6]
    g = np.zeros((len(face), 3))
    g[np.arange(len(face)), row] = f[face]
    # second derivatives of the rotated arms: (g r^T + r g^T)/2 - (g.r) I
    gr = g.T @ turned
    S[3:, 3:] += 0.5 * (gr + gr.T) - np.trace(gr) * np.eye(3)
    rest = T.T @ f[face] - Kib.T @ X[:, 6] - wrench
    pose = np.zeros(6)
    pose[free] = -np.linalg.solve(S[np.ix_(free, free)], rest[free])
    size = np.abs(wrench).max() + np.abs(f).max()
    worst = max(np.abs(f[inner]).max(), np.abs((T.T @ f[face] - wrench)[free]).max() / solid.length) / size
    held = np.zeros((6, 6))
    held[np.ix_(free, free)] = S[np.ix_(free, free)]
    return (-X[:, 6] - X[:, :6] @ pose, pose), held, float(worst)


def press_reduced(body: SolidBasis, force: np.ndarray, moment: np.ndarray, *, steps: int = 4) -> Pressed:
    """The same of the reduced solid."""
    free = _free(body.solid.flat)
    m = int(body.number[1])
    d, R, inner = np.array([body.solid.length, 0.0, 0.0]), np.eye(3), np.zeros(m)
    store, lam, K = np.zeros(modal_sizes(m)[1]), np.zeros(12), np.zeros((6, 6))
    count, spent, wrench, xi = 0, 0.0, np.concatenate([force, moment]), np.zeros(6)
    for k in range(1, steps + 1):
        for _ in range(MOST):
            clock = time.thread_time()
            polynomial_condense(body.value, body.number, inner, store, d, R, lam, K)
            xi[free] = np.linalg.solve(K[np.ix_(free, free)], (k / steps * wrench - lam[:6])[free])
            before = inner.copy()
            modal_recover(body.value, body.number, inner, store, xi, 1.0)
            d, R = d + xi[:3], _turned(R, xi[3:])
            count, spent = count + 1, spent + time.thread_time() - clock
            if np.abs(xi).max() < 1e-11 and np.abs(inner - before).max() <= 1e-9 * (
                1e-12 + np.abs(inner).max()
            ):
                break
        else:
            raise ConvergenceError(
                f"basis no longer successful: no equilibrium at {100 * k / steps:.3g} % of the load"
            )
    held = np.zeros((6, 6))
    held[np.ix_(free, free)] = K[np.ix_(free, free)]
    return Pressed(d - [body.solid.length, 0, 0], R, held, count, spent / count, inner)


__all__ = ["Pressed", "press", "press_reduced"]
