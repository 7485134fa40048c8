"""A reduced solid alone under a load on face B, without a mechanism; compare `ksd.modal.solid_solve.load_face`."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ksd.beam.modal import modal_recover, modal_sizes
from ksd.beam.polynomial_solid import polynomial_condense
from ksd.errors import ConvergenceError
from ksd.modal.solid_basis import SolidBasis
from ksd.modal.solid_solve import FullSolid, LoadedFace

MOST, CORRECTORS, SETTLED = 40, 12, 0.02
"""Largest number of iterations of a load step; largest number of corrector steps of the full solid, and the relative change
at which they have converged."""


@dataclass(frozen=True)
class PressedReduced(LoadedFace):
    """As `LoadedFace`, the state being inner coordinates; error: relative, of the shift, by `indicator`."""

    error: float


def press_reduced(
    body: SolidBasis,
    force: np.ndarray,
    moment: np.ndarray,
    *,
    steps: int = 4,
) -> PressedReduced:
    """Face B of a reduced solid under `force` (3,) [N] and `moment` (3,) [Nm], in load steps. Raises ConvergenceError."""
    free = [0, 1, 5] if body.solid.is_2d else [0, 1, 2, 3, 4, 5]
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
            d, R = d + xi[:3], Rotation.from_rotvec(xi[3:]).as_matrix() @ R
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
