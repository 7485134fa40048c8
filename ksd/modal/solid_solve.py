"""A meshed solid in equilibrium under a load on face B, and condensed to that face.

Face A is fixed; face B is rigid, its pose (shift, rotation) is unknown, and a dead force and moment act on its middle.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import map_coordinates
from scipy.sparse.linalg import splu
from scipy.spatial.transform import Rotation

from ksd.modal.solid import Solid


class FullSolid:
    """A meshed solid during Newton's iteration: displacements u (size,) [m], shift (3,) [m] and rotation R (3, 3) of face B.

    wrench (6,): force and moment [N, Nm] on face B with the inner degrees of freedom condensed, about its middle, in the
    axes of face A; stiffness (6, 6): its derivative; face_wrench (6,): without the condensation.
    """

    def __init__(self, solid: Solid, u: np.ndarray, shift: np.ndarray, R: np.ndarray) -> None:
        self.solid, self.u, self.shift, self.R = solid, u.copy(), shift, R
        self.inner, self.face = solid.inner, solid.face_b
        # possible motions of face B
        self.free = [0, 1, 5] if solid.is_2d else [0, 1, 2, 3, 4, 5]
        self.arm = solid.position[self.face] - np.array([solid.length, 0.0, 0.0])
        self.row = solid.component[self.face]
        self.stiffness, self.wrench, self.face_wrench = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
        self._response = np.zeros((len(self.inner), 7))

    def on_mesh(self, solid: Solid) -> FullSolid:
        """This state on another mesh of the same solid, displacements interpolated linearly."""
        u = np.zeros(solid.dof_count)
        for component in range(2 if solid.is_2d else 3):
            old, new = self.solid.grid_dofs(component), solid.grid_dofs(component)
            at = [np.linspace(0.0, n - 1.0, m) for n, m in zip(old.shape, new.shape, strict=True)]
            points = np.meshgrid(*at, indexing="ij")
            u[new] = map_coordinates(self.u[old], points, order=1, mode="nearest")
        return FullSolid(solid, u, self.shift, self.R)

    def step(self, wrench: np.ndarray) -> bool:
        """One Newton step under `wrench` (6,) on face B, in place; returns whether it began in equilibrium, to rounding."""
        inner_residual, X, force_scale = self._condense()
        free, residual = self.free, self.wrench - wrench
        pose = np.zeros(6)
        pose[free] = -np.linalg.solve(self.stiffness[np.ix_(free, free)], residual[free])
        force_scale += float(np.abs(wrench).max()) + 1e-300
        face_residual = float(np.abs((self.face_wrench - wrench)[free]).max()) / self.solid.length
        step = -X[:, 6] - X[:, :6] @ pose
        self.u[self.inner] += step
        self.shift, self.R = self.shift + pose[:3], Rotation.from_rotvec(pose[3:]).as_matrix() @ self.R
        worst = max(inner_residual, face_residual) / force_scale
        return worst < 1e-9 or bool(np.abs(step).max() < 1e-12 * self.solid.length)

    def condense(self) -> None:
        """Set `wrench` and `stiffness` at the present pose of face B, the inner degrees of freedom in equilibrium to first
        order."""
        _, self._response, _ = self._condense()

    def follow(self, d: np.ndarray, R: np.ndarray) -> None:
        """Move face B to d (3,) [m], R (3, 3) in the frame of face A, and the inner degrees of freedom as linearised by
        `condense`."""
        shift = d - np.array([self.solid.length, 0.0, 0.0])
        move = np.concatenate([shift - self.shift, Rotation.from_matrix(R @ self.R.T).as_rotvec()])
        self.u[self.inner] -= self._response[:, 6] + self._response[:, :6] @ move
        self.shift, self.R = shift, R.copy()

    def _condense(self) -> tuple[float, np.ndarray, float]:
        """Set `wrench`, `stiffness` and `face_wrench`.

        Returns the largest inner residual [N], the response (inner, 7) of the inner degrees of freedom to the pose of face B
        and to that residual, and the largest internal force [N].
        """
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
        self.stiffness, self.wrench, self.face_wrench = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
        free = np.ix_(self.free, self.free)
        self.stiffness[free] = S[free]
        self.face_wrench[self.free] = (T.T @ f[face])[self.free]
        self.wrench[self.free] = (T.T @ f[face] - Kib.T @ X[:, 6])[self.free]
        return float(np.abs(f[inner]).max()), X, float(np.abs(f).max())
