"""Eigenpairs of the factored tangent beside the mass: all of them, or the lowest by iteration.

With M = B^T B the matrix B K^-1 B^T has the eigenvalues 1/omega^2: K may be a saddle and M singular.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.properties.krylov import outermost
from ksd.properties.mass import Inertia
from ksd.properties.tangent import Tangent

Array = NDArray[np.float64]


def _apply(tangent: Tangent, mass: Inertia, loads: Array) -> Array:
    """K^-1 loads for loads (size, k): node tangent beside the flexibilities of the leafs."""
    n = tangent.arrays.plan.unknowns
    out = np.empty_like(loads)
    out[:n] = tangent.solve(loads[:n])
    for leaf in mass.leafs:
        out[leaf.inner] = leaf.Z @ loads[leaf.inner]
    return out


def dense_pairs(tangent: Tangent, mass: Inertia, count: int) -> tuple[Array, Array]:
    """(1/omega^2, vectors (size, k)) by the dense route; complex where modes flutter."""
    from scipy.linalg import eig, eigh, lapack

    M = mass.dense()
    used = np.flatnonzero(M.diagonal() > 0.0)
    scale = 1.0 / np.sqrt(M.diagonal()[used])
    C, order, rank, _ = lapack.dpstrf(M[np.ix_(used, used)] * np.outer(scale, scale), lower=1)
    L = np.zeros((mass.size, rank))
    L[used[order - 1]] = (np.tril(C)[:, :rank].T / scale[order - 1]).T
    x = _apply(tangent, mass, L)
    A = L.T @ x
    if tangent.turning is not None:
        values, vectors = eig(A)
        kept = np.concatenate(
            [np.flatnonzero(growing_pairs(values)), np.argsort(-np.abs(values))[: 2 * count]]
        )
        kept = np.unique(kept)
        return values[kept], x @ vectors[:, kept]
    values, vectors = _outermost(0.5 * (A + A.T), count, eigh)
    return values, x @ vectors


def arnoldi_pairs(tangent: Tangent, mass: Inertia, count: int) -> tuple[Array, Array]:
    """The same of an unsymmetric tangent by Arnoldi iteration: the largest 1/omega^2."""
    from scipy.sparse.linalg import LinearOperator, eigs

    B = mass.root
    back = B.T.tocsr()
    size = B.shape[0]
    operator = LinearOperator(
        (size, size),
        matvec=lambda y: B @ _apply(tangent, mass, (back @ y.ravel())[:, None])[:, 0],
        dtype=float,
    )
    start = np.random.default_rng(0).normal(size=size)
    values, y = eigs(operator, k=min(2 * count + 4, size - 2), which="LM", v0=start)
    x = back @ y
    return values, _apply(tangent, mass, x.real) + 1j * _apply(tangent, mass, x.imag)


def growing_pairs(values: Array) -> Any:
    """Which 1/omega^2 are those of modes that grow."""
    bound = 1e-9 * np.abs(values).max(initial=0.0)
    return (values.real < -bound) | (np.abs(values.imag) > np.maximum(bound, 1e-6 * np.abs(values)))


def _outermost(A: Array, count: int, eigh: Any) -> tuple[Array, Array]:
    """The `count` largest eigenvalues of A and all clearly negative ones, with vectors."""
    size = len(A)
    values, vectors = eigh(A, subset_by_index=(max(0, size - count), size - 1))
    low, below = eigh(A, subset_by_index=(0, min(size, count) - 1))
    bad = low < -1e-9 * np.abs(np.concatenate([values, low])).max()
    keep = values > 0.0
    return np.concatenate([low[bad], values[keep]]), np.hstack([below[:, bad], vectors[:, keep]])


def lanczos_pairs(tangent: Tangent, mass: Inertia, count: int) -> tuple[Array, Array]:
    """The same by block Lanczos on B K^-1 B^T, which has the eigenvalues 1/omega^2 for M = B^T B."""
    B = mass.root
    back = B.T.tocsr()

    def apply(y: Array) -> Array:
        found: Array = B @ _apply(tangent, mass, back @ y)
        return found

    def wanted(values: Array) -> Any:
        # every unstable direction is a negative value; of the others the largest
        below = np.flatnonzero(values < -1e-9 * np.abs(values).max())[: tangent.unstable]
        return np.concatenate([below, np.argsort(-values)[:count]])

    values, y = outermost(apply, B.shape[0], wanted)
    return values, _apply(tangent, mass, back @ y)
