"""Equilibrium of a meshed solid under a load on face B, and the solid condensed to that face.

Face A is held; face B is rigid, its pose (shift, rotation) is unknown, and a dead force and moment act on its middle.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.spatial.transform import Rotation

from ksd.errors import ConvergenceError
from ksd.modal.solid import Solid

MOST = 40


@dataclass(frozen=True)
class LoadedFace:
    """Face B under load: shift (3,) m, rotation R (3, 3), stiffness (6, 6) of force and moment about it with the
    inside condensed (rows out of the plane zero for 2D), iterations, thread time [s] of one iteration, and the state
    (displacements)."""

    shift: np.ndarray
    R: np.ndarray
    stiffness: np.ndarray
    iterations: int
    time: float
    state: np.ndarray


class FullSolid:
    """The full model on its way: displacements u (size,) m, and shift (3,) m and rotation R (3, 3) of face B."""

    def __init__(self, solid: Solid, u: np.ndarray, shift: np.ndarray, R: np.ndarray) -> None:
        self.solid, self.u, self.shift, self.R = solid, u.copy(), shift, R
        self.inner, self.face = solid.inner, solid.face_b
        # motions of face B that exist
        self.free = [0, 1, 5] if solid.is_2d else [0, 1, 2, 3, 4, 5]
        self.arm = solid.position[self.face] - np.array([solid.length, 0.0, 0.0])
        self.row = solid.component[self.face]
        self.stiffness, self.wrench, self.held = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
        self._inside = np.zeros((len(self.inner), 7))

    def on_mesh(self, solid: Solid) -> FullSolid:
        """This state on another mesh of the same solid, displacements linear between the places known."""
        u = np.zeros(solid.dof_count)
        for component in range(2 if solid.is_2d else 3):
            own, theirs = self.solid.on_grid(component), solid.on_grid(component)
            at = [np.linspace(0.0, n - 1.0, m) for n, m in zip(own.shape, theirs.shape, strict=True)]
            places = np.meshgrid(*at, indexing="ij")
            u[theirs] = map_coordinates(self.u[own], places, order=1, mode="nearest")
        return FullSolid(solid, u, self.shift, self.R)

    def step(self, wrench: np.ndarray) -> bool:
        """One Newton step under `wrench` (6,) on face B, in place; whether it was at rest before, to rounding."""
        away, X, size = self._condensed()
        free, rest = self.free, self.wrench - wrench
        pose = np.zeros(6)
        pose[free] = -np.linalg.solve(self.stiffness[np.ix_(free, free)], rest[free])
        size += float(np.abs(wrench).max()) + 1e-300
        outside = float(np.abs((self.held - wrench)[free]).max()) / self.solid.length
        step = -X[:, 6] - X[:, :6] @ pose
        self.u[self.inner] += step
        self.shift, self.R = self.shift + pose[:3], Rotation.from_rotvec(pose[3:]).as_matrix() @ self.R
        worst = max(away, outside) / size
        return worst < 1e-9 or bool(np.abs(step).max() < 1e-12 * self.solid.length)

    def condense(self) -> None:
        """Force and moment on face B where it is, the inside on its way to rest to first order: `wrench` (6,) N, Nm about
        its middle, in the axes of face A, and `stiffness` (6, 6)."""
        _, self._inside, _ = self._condensed()

    def follow(self, d: np.ndarray, R: np.ndarray) -> None:
        """Face B to d (3,) m, R (3, 3) in the frame of face A, and the inside after it, as `condense` left it."""
        shift = d - np.array([self.solid.length, 0.0, 0.0])
        move = np.concatenate([shift - self.shift, Rotation.from_matrix(R @ self.R.T).as_rotvec()])
        self.u[self.inner] -= self._inside[:, 6] + self._inside[:, :6] @ move
        self.shift, self.R = shift, R.copy()

    def _condensed(self) -> tuple[float, np.ndarray, float]:
        """Largest force inside that is not balanced [N], response (inner, 7) of the inside to the pose of face B and to that
        force, and the largest force anywhere; sets `wrench`, `stiffness`, and `held`, the force on face B as it is."""
        from scipy.sparse.linalg import splu

        solid, inner, face, row = self.solid, self.inner, self.face, self.row
        turned, every = self.arm @ self.R.T, np.arange(len(face))
        self.u[face] = (self.shift + turned - self.arm)[every, row]
        T = np.zeros((len(face), 6))
        T[every, row] = 1.0
        for axis in range(3):
            T[:, 3 + axis] = np.cross(np.eye(3)[axis], turned)[every, row]
        f, K = solid.force_and_tangent(self.u)
        Kib = K[inner][:, face] @ T
        factor = splu(K[inner][:, inner].tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        X = factor.solve(np.column_stack([Kib, f[inner]]))
        S = T.T @ (K[face][:, face] @ T) - Kib.T @ X[:, :6]
        g = np.zeros((len(face), 3))
        g[every, row] = f[face]
        # second derivatives of the rotated arms: (g r^T + r g^T)/2 - (g.r) I
        gr = g.T @ turned
        S[3:, 3:] += 0.5 * (gr + gr.T) - np.trace(gr) * np.eye(3)
        self.stiffness, self.wrench, self.held = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
        free = np.ix_(self.free, self.free)
        self.stiffness[free] = S[free]
        self.held[self.free] = (T.T @ f[face])[self.free]
        self.wrench[self.free] = (T.T @ f[face] - Kib.T @ X[:, 6])[self.free]
        return float(np.abs(f[inner]).max()), X, float(np.abs(f).max())


def load_face(solid: Solid, force: np.ndarray, moment: np.ndarray, *, steps: int = 4) -> LoadedFace:
    """The full model under `force` (3,) [N] and `moment` (3,) [Nm], in load steps. Raises ConvergenceError."""
    full = FullSolid(solid, np.zeros(solid.dof_count), np.zeros(3), np.eye(3))
    count, spent, wrench = 0, 0.0, np.concatenate([force, moment])
    for k in range(1, steps + 1):
        for _ in range(MOST):
            clock = time.thread_time()
            rests = full.step(k / steps * wrench)
            count, spent = count + 1, spent + time.thread_time() - clock
            if rests:
                break
        else:
            raise ConvergenceError(
                f"the solid did not come to rest within {MOST} iterations at {100 * k / steps:.3g} %"
            )
    return LoadedFace(full.shift, full.R, full.stiffness, count, spent / count, full.u)
