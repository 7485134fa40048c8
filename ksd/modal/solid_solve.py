"""Equilibrium of a meshed solid and of its reduction under a load on face B: the full model beside the fast one.

Face A is held; face B is rigid, its pose (shift, rotation) is unknown, and a dead force and moment act on its middle.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from ksd.beam.modal import modal_recover, modal_sizes
from ksd.beam.polynomial import polynomial_condense
from ksd.errors import ConvergenceError
from ksd.modal.solid import Solid
from ksd.modal.solid_basis import SolidBasis

MOST = 40
MOST_CORRECTORS = 12
SETTLED = 0.02
"""Relative change of the indicator by one more step at which it is believed."""
SUCCESSFUL = 0.05
"""Estimated relative error beyond which a basis is no longer successful."""


@dataclass(frozen=True)
class Pressed:
    """Face B under load: shift (3,) m, rotation R (3, 3), stiffness (6, 6) of force and moment about it with the
    inside condensed (rows out of the plane zero for 2D), iterations, thread time [s] of one iteration, and the state
    (displacements of the full model, inner coordinates of the reduced one); error: relative, of the shift, of a reduced
    solid by `indicator`."""

    shift: np.ndarray
    R: np.ndarray
    stiffness: np.ndarray
    iterations: int
    time: float
    state: np.ndarray
    error: float = 0.0


def _turned(R: np.ndarray, psi: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_rotvec(psi).as_matrix() @ R)


def _turn(R: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    return np.asarray(Rotation.from_matrix(R).as_rotvec())


def _free(flat: bool) -> list[int]:
    """Motions of face B that exist: x, y and the rotation about z in 2D."""
    return [0, 1, 5] if flat else [0, 1, 2, 3, 4, 5]


class FullSolid:
    """The full model on its way: displacements u (size,) m, and shift (3,) m and rotation R (3, 3) of face B."""

    def __init__(self, solid: Solid, u: np.ndarray, shift: np.ndarray, R: np.ndarray) -> None:
        self.solid, self.u, self.shift, self.R = solid, u.copy(), shift, R
        self.inner, self.face, self.free = solid.inner, solid.face_b, _free(solid.flat)
        self.arm = solid.place[self.face] - np.array([solid.length, 0.0, 0.0])
        self.row = solid.component[self.face]
        self.stiffness, self.wrench, self.held = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
        self._inside = np.zeros((len(self.inner), 7))

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
        self.shift, self.R = self.shift + pose[:3], _turned(self.R, pose[3:])
        worst = max(away, outside) / size
        return worst < 1e-9 or bool(np.abs(step).max() < 1e-12 * self.solid.length)

    def condense(self) -> None:
        """Force and moment on face B where it is, the inside on its way to rest to first order: `wrench` (6,) N, Nm about
        its middle, in the axes of face A, and `stiffness` (6, 6)."""
        _, self._inside, _ = self._condensed()

    def follow(self, d: np.ndarray, R: np.ndarray) -> None:
        """Face B to d (3,) m, R (3, 3) in the frame of face A, and the inside after it, as `condense` left it."""
        shift = d - np.array([self.solid.length, 0.0, 0.0])
        move = np.concatenate([shift - self.shift, _turn(R @ self.R.T)])
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


def press(solid: Solid, force: np.ndarray, moment: np.ndarray, *, steps: int = 4) -> Pressed:
    """The full model under `force` (3,) [N] and `moment` (3,) [Nm], in load steps. Raises ConvergenceError."""
    full = FullSolid(solid, np.zeros(solid.size), np.zeros(3), np.eye(3))
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
    return Pressed(full.shift, full.R, full.stiffness, count, spent / count, full.u)


def press_reduced(
    body: SolidBasis,
    force: np.ndarray,
    moment: np.ndarray,
    *,
    steps: int = 4,
    estimate: bool = True,
    strict: bool = True,
) -> Pressed:
    """The same of the reduced solid, with its error by corrector steps of the full one, unless estimate=False.

    Raises ConvergenceError "basis no longer successful" where there is no equilibrium or, unless strict=False, the error
    is beyond `SUCCESSFUL`.
    """
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
            if np.abs(xi).max() < 1e-11 and np.abs(inner - before).max(initial=0.0) <= 1e-9 * (
                1e-12 + np.abs(inner).max(initial=0.0)
            ):
                break
        else:
            raise ConvergenceError(
                f"basis no longer successful: no equilibrium at {100 * k / steps:.3g} % of the load"
            )
    held = np.zeros((6, 6))
    held[np.ix_(free, free)] = K[np.ix_(free, free)]
    error = indicator(body, d, R, inner, wrench) if estimate else math.nan
    if estimate and strict:
        _believed(error, float(np.linalg.norm(d[1:]) / body.solid.length))
    return Pressed(d - [body.solid.length, 0, 0], R, held, count, spent / count, inner, error)


def _believed(error: float, stroke: float) -> None:
    """Raises ConvergenceError where the error is beyond `SUCCESSFUL`."""
    if not error <= SUCCESSFUL:
        raise ConvergenceError(
            f"basis no longer successful: the estimated error of the solid is {100 * error:.2g} % at a stroke of "
            f"{stroke:.2g} L; ask for less, raise internal or order, or press the full solid"
        )


def indicator(body: SolidBasis, d: np.ndarray, R: np.ndarray, eta: np.ndarray, wrench: np.ndarray) -> float:
    """Relative error of where face B is under `wrench` (6,), by Newton steps of the full model until they settle.

    Infinite where they do not. For a solid in a mechanism the wrench is what its member exerts.
    """
    length = np.array([body.solid.length, 0.0, 0.0])
    full = FullSolid(body.solid, body.displaced(d, R, eta), d - length, R)
    moved, last = np.linalg.norm(d - length) + 1e-12 * body.solid.length, math.inf
    for k in range(MOST_CORRECTORS):
        rests = full.step(wrench)
        error = float(np.linalg.norm(full.shift - (d - length)) / moved)
        if not math.isfinite(error):
            return math.inf
        if k > 0 and (rests or abs(error - last) <= SETTLED * error):
            return error
        last = error
    return math.inf


__all__ = ["FullSolid", "Pressed", "indicator", "press", "press_reduced"]
