"""Equilibrium of a meshed solid and of its reduction under a load on face B: the full model beside the fast one.

Face A is held; face B is rigid, its pose (shift, rotation) is unknown, and a dead force and moment act on its middle.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from ksd.beam.modal import modal_recover, modal_sizes
from ksd.beam.modal_jets import JET
from ksd.beam.polynomial import face_jets, polynomial_condense
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
        self.stiffness = np.zeros((6, 6))

    def step(self, wrench: np.ndarray) -> bool:
        """One Newton step under `wrench` (6,) on face B, in place; whether it was at rest before, to rounding."""
        solid, row = self.solid, self.row
        turned, every = self.arm @ self.R.T, np.arange(len(self.face))
        self.u[self.face] = (self.shift + turned - self.arm)[every, row]
        T = np.zeros((len(self.face), 6))
        T[every, row] = 1.0
        for axis in range(3):
            T[:, 3 + axis] = np.cross(np.eye(3)[axis], turned)[every, row]
        parts = self.inner, self.face, T, turned, row
        step, self.stiffness, worst = _newton(solid, self.u, parts, wrench)
        self.u[self.inner] += step[0]
        move = np.zeros(6)
        move[self.free] = step[1][self.free]
        self.shift, self.R = self.shift + move[:3], _turned(self.R, move[3:])
        return worst < 1e-9 or bool(np.abs(step[0]).max() < 1e-12 * solid.length)


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
    size = np.abs(wrench).max() + np.abs(f).max() + 1e-300
    worst = max(np.abs(f[inner]).max(), np.abs((T.T @ f[face] - wrench)[free]).max() / solid.length) / size
    held = np.zeros((6, 6))
    held[np.ix_(free, free)] = S[np.ix_(free, free)]
    return (-X[:, 6] - X[:, :6] @ pose, pose), held, float(worst)


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


def displaced(body: SolidBasis, d: np.ndarray, R: np.ndarray, eta: np.ndarray) -> np.ndarray:
    """Displacements u (size,) m of the full model at a state of the reduced one: face B at d (3,) m, turned by R (3, 3)."""
    solid, jets = body.solid, np.empty((19, JET))
    face_jets(int(body.frame == "chord"), d, R, jets)
    u = body.patterns @ (jets[list(body.chosen), 0] - body.b0) + body.inner @ eta
    if body.frame == "node":
        return np.asarray(u)
    # turned from the frame of the chord into that of face A
    turn, found = jets[1:10, 0].reshape(3, 3), np.empty_like(u)
    dim = 2 if solid.flat else 3
    at = [np.flatnonzero(solid.component == c) for c in range(dim)]
    at = [a[np.lexsort(solid.place[a].T)] for a in at]
    spots = np.zeros((3, len(at[0])))
    for c in range(dim):
        spots[c] = solid.place[at[c], c] + u[at[c]]
    spots = turn @ spots
    for c in range(dim):
        found[at[c]] = spots[c] - solid.place[at[c], c]
    return found


def indicator(body: SolidBasis, d: np.ndarray, R: np.ndarray, eta: np.ndarray, wrench: np.ndarray) -> float:
    """Relative error of where face B is under `wrench` (6,), by Newton steps of the full model until they settle.

    Infinite where they do not. For a solid in a mechanism the wrench is what its member exerts.
    """
    length = np.array([body.solid.length, 0.0, 0.0])
    full = FullSolid(body.solid, displaced(body, d, R, eta), d - length, R)
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


__all__ = ["FullSolid", "Pressed", "displaced", "indicator", "press", "press_reduced"]
