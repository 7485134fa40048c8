"""A solid alone under a load on face B, without a mechanism: the meshed solid, and the reduced one.

Face A is fixed; face B is rigid, its pose (shift, rotation) is unknown, and a dead force and moment act on its middle.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ksd.elements.modal import modal_recover, modal_sizes
from ksd.elements.polynomial_solid import polynomial_condense
from ksd.errors import ConvergenceError
from ksd.modal.solid import Solid
from ksd.modal.solid_basis import SolidBasis
from ksd.modal.solid_solve import FullSolid

STEPS, MOST, CORRECTORS, SETTLED = 4, 40, 12, 0.02
"""Load steps, and the largest number of iterations of one; largest number of corrector steps of the full solid, and the
relative change at which they have converged."""


@dataclass(frozen=True)
class LoadedFace:
    """Equilibrium of face B under load.

    shift (3,) [m], rotation R (3, 3), stiffness (6, 6) about the middle of the face with the inner degrees of freedom
    condensed (rows out of the plane zero in 2D), Newton iterations, thread time [s] of one iteration, and the displacements
    `state` (size,) [m].
    """

    shift: np.ndarray
    R: np.ndarray
    stiffness: np.ndarray
    iterations: int
    time: float
    state: np.ndarray


def load_face(solid: Solid, force: np.ndarray, moment: np.ndarray, *, steps: int = 4) -> LoadedFace:
    """Equilibrium under `force` (3,) [N] and `moment` (3,) [Nm] on face B, in load steps. Raises ConvergenceError."""
    full = FullSolid(solid, np.zeros(solid.dof_count), np.zeros(3), np.eye(3))
    count, spent, wrench = 0, 0.0, np.concatenate([force, moment])
    for k in range(1, steps + 1):
        for _ in range(MOST):
            clock = time.thread_time()
            at_rest = full.step(k / steps * wrench)
            count, spent = count + 1, spent + time.thread_time() - clock
            if at_rest:
                break
        else:
            raise ConvergenceError(
                f"the solid did not come to rest within {MOST} iterations at {100 * k / steps:.3g} %"
            )
    return LoadedFace(full.shift, full.R, full.stiffness, count, spent / count, full.u)


@dataclass(frozen=True)
class PressedReduced(LoadedFace):
    """As `LoadedFace`, the state being inner coordinates; error: relative, of the shift, by `indicator`."""

    error: float


def press_reduced(body: SolidBasis, force: np.ndarray, moment: np.ndarray) -> PressedReduced:
    """The same of a reduced solid, in STEPS load steps."""
    free = [0, 1, 5] if body.solid.is_2d else [0, 1, 2, 3, 4, 5]
    m = int(body.number[1])
    d, R, inner = np.array([body.solid.length, 0.0, 0.0]), np.eye(3), np.zeros(m)
    store, lam, K = np.zeros(modal_sizes(m)[1]), np.zeros(12), np.zeros((6, 6))
    count, spent, wrench, xi = 0, 0.0, np.concatenate([force, moment]), np.zeros(6)
    for k in range(1, STEPS + 1):
        for _ in range(MOST):
            clock = time.thread_time()
            polynomial_condense(body.value, body.number, inner, store, d, R, lam, K)
            xi[free] = np.linalg.solve(K[np.ix_(free, free)], (k / STEPS * wrench - lam[:6])[free])
            before = inner.copy()
            modal_recover(body.value, body.number, inner, store, xi, 1.0)
            d, R = d + xi[:3], Rotation.from_rotvec(xi[3:]).as_matrix() @ R
            count, spent = count + 1, spent + time.thread_time() - clock
            if np.abs(xi).max() < 1e-11 and np.abs(inner - before).max(initial=0.0) <= 1e-9 * (
                1e-12 + np.abs(inner).max(initial=0.0)
            ):
                break
        else:
            raise ConvergenceError(
                f"basis no longer successful: no equilibrium at {100 * k / STEPS:.3g} % of the load"
            )
    held = np.zeros((6, 6))
    held[np.ix_(free, free)] = K[np.ix_(free, free)]
    error = indicator(body, d, R, inner, wrench)
    return PressedReduced(d - [body.solid.length, 0, 0], R, held, count, spent / count, inner, error)


def indicator(body: SolidBasis, d: np.ndarray, R: np.ndarray, eta: np.ndarray, wrench: np.ndarray) -> float:
    """Relative error of where face B is under `wrench` (6,), by Newton steps of the full model until they converge.

    Infinite where they do not. For a solid in a mechanism the wrench is what its member exerts.
    """
    length = np.array([body.solid.length, 0.0, 0.0])
    full = FullSolid(body.solid, body.displacements(d, R, eta), d - length, R)
    moved, last = np.linalg.norm(d - length) + 1e-12 * body.solid.length, math.inf
    for k in range(CORRECTORS):
        rests = full.step(wrench)
        error = float(np.linalg.norm(full.shift - (d - length)) / moved)
        if not math.isfinite(error):
            return math.inf
        if k > 0 and (rests or abs(error - last) <= SETTLED * error):
            return error
        last = error
    return math.inf
