"""The outermost eigenpairs of a symmetric operator: block Lanczos, all reorthogonalised (Golub and Underwood 1977).

A few blocks of eight vectors do what ARPACK does in a hundred single ones, each of which costs more in calls than in
arithmetic at the size of a mechanism; multiple eigenvalues, which symmetric mechanisms have, come out in one go.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ksd.errors import KsdError

Array = NDArray[np.float64]
BLOCK = 8
ACCURACY = 3e-6
"""Residual of a wanted pair over its eigenvalue; the eigenvalue itself is then right to its square over the gap."""
MOST = 60
"""Blocks at the most."""


def outermost(
    apply: Callable[[Array], Array], size: int, wanted: Callable[[Array], NDArray[np.intp]]
) -> tuple[Array, Array]:
    """Eigenvalues theta (k,) and orthonormal vectors (size, k) of a symmetric operator apply: (size, b) -> (size, b).

    wanted: those asked for, out of the values found so far. The same numbers on every call. Raises KsdError when they
    do not converge in MOST blocks.
    """
    start = np.random.default_rng(0).normal(size=(size, min(BLOCK, size)))
    V, _ = np.linalg.qr(apply(start))
    basis, H = V, np.zeros((0, 0))
    for _ in range(MOST):
        W = apply(V)
        h = basis.T @ W
        W = W - basis @ h
        more = basis.T @ W
        W, h = W - basis @ more, h + more
        H = _bordered(H, h)
        theta, s = np.linalg.eigh(H)
        V, R = np.linalg.qr(W)
        off = np.linalg.norm(R @ s[len(s) - h.shape[1] :], axis=0)
        chosen = wanted(theta)
        full = basis.shape[1] + V.shape[1] > size
        if full or (len(chosen) and np.all(off[chosen] <= ACCURACY * np.abs(theta[chosen]))):
            return theta[chosen], basis @ s[:, chosen]
        # a column of nothing but rounding is not orthogonal to the others yet
        V = V - basis @ (basis.T @ V)
        basis = np.hstack([basis, V])
    raise KsdError(f"the eigenvalues asked for were not found in {MOST} blocks; ask for fewer of them")


def _bordered(H: Array, h: Array) -> Array:
    """H (n, n) grown by the new columns h (n + p, p), symmetric."""
    n, p = len(H), h.shape[1]
    found = np.zeros((n + p, n + p))
    found[:n, :n] = H
    found[:, n:] = h
    found[n:, :n] = h[:n].T
    found[n:, n:] = 0.5 * (h[n:] + h[n:].T)
    return found
