"""Dense symmetric indefinite matrices, with pivoting, for cases in which the block factorisation breaks down."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigvalsh_tridiagonal, lapack, ldl

Array = NDArray[np.float64]


def equilibration(K: Array) -> Array:
    """Factors (n,) on rows and columns that give a symmetric K (n, n) entries of order 1."""
    scale = np.ones(len(K))
    for _ in range(3):
        row = np.abs(K * np.outer(scale, scale)).max(axis=1, initial=0.0)
        scale /= np.sqrt(np.where(row > 0.0, row, 1.0))
    return scale


def negative_inertia(K: Array) -> int:
    """Number of negative eigenvalues of a symmetric K (n, n), n > 0, by Bunch-Kaufman (Sylvester's law of inertia)."""
    scale = equilibration(K)
    # D has pivots of size one and two
    _, D, _ = ldl(K * np.outer(scale, scale))
    values = eigvalsh_tridiagonal(D.diagonal(), D.diagonal(-1), lapack_driver="sterf")
    return int((values < 0.0).sum())


def solve_scaled(A: Array, b: Array, scale: Array) -> tuple[Array, float]:
    """Solve A x = b for b (n, k) with rows and columns equilibrated by `scale` (n,).

    Returns x and the reciprocal condition number, zeros where A is singular.
    """
    S = A * np.outer(scale, scale)
    lu, pivots, info = lapack.dgetrf(S)
    if info != 0 or not np.isfinite(lu).all():
        return np.zeros_like(b), 0.0
    reciprocal, _ = lapack.dgecon(lu, np.abs(S).sum(axis=0).max())
    x, _ = lapack.dgetrs(lu, pivots, scale[:, None] * b)
    return scale[:, None] * x, float(reciprocal)
