"""Reduction bases: Craig-Bampton modes, modal derivatives, conditioning.

The functions take dense or sparse matrices, or a tangent function K(q) of additive coordinates q (n,), of any body: a leaf,
a joint or a solid. With fixed boundary coordinates the static path through q = 0 is q(eta) = sum phi_i eta_i + 1/2 sum
theta_ij eta_i eta_j + 1/6 sum chi_ijk eta_i eta_j eta_k. **theta_ij is here the second derivative of the path, symmetric, so
the quadratic manifold carries the factor 1/2** (paper 2, eq. 5, has none: its theta is half of ours). Internal vibration
modes are followed like boundary modes, with the forces that hold their amplitude constant left out, as in eq. 4. Source:
paper 2, eqs. 4-8; Craig and Bampton 1968.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, lu_factor, lu_solve
from scipy.sparse.linalg import eigsh, splu

Array = NDArray[np.float64]
Tangent = Callable[[Array], Any]
"""Tangent matrix (n, n), dense or scipy sparse, at coordinates (n,)."""


class Modes(NamedTuple):
    """First-order basis: shapes (n, k), the first `boundary` of them boundary modes; omega (k - boundary,) rad/s."""

    shapes: Array
    boundary: int
    omega: Array


class Derivatives(NamedTuple):
    """Derivatives of the static path by mode amplitudes: shapes (n, p), and the modes of each, (i, j) of theta_ij or
    (i, j, k) of chi_ijk."""

    shapes: Array
    pairs: tuple[tuple[int, ...], ...]


def craig_bampton(
    K: Any, boundary: Sequence[int], inner: Sequence[int], *, M: Any = None, internal: int = 0
) -> Modes:
    """Boundary modes and fixed-interface vibration modes (paper 2, eqs. 6-7) of a tangent K (n, n).

    boundary: coordinates that get a unit value each; inner: free coordinates; all others stay zero. internal: number of
    fixed-interface modes, lowest first, for the mass matrix M (n, n), scaled to a largest entry of 1. Raises ValueError
    where the inner block is singular (a mechanism inside the body) or M is missing for internal modes.
    """
    if internal and M is None:
        raise ValueError(f"internal = {internal}: vibration modes need the mass matrix M")
    shapes = np.zeros((K.shape[0], len(boundary) + internal))
    for k, b in enumerate(boundary):
        shapes[b, k] = 1.0
    shapes[:, : len(boundary)] += static_extension(K, shapes[:, : len(boundary)], inner)
    omega = np.zeros(0)
    if internal:
        square, vectors = _lowest(_part(K, inner, inner), _part(M, inner, inner), internal)
        peak = vectors[np.abs(vectors).argmax(axis=0), np.arange(internal)]
        shapes[inner, len(boundary) :] = vectors / peak
        omega = np.sqrt(np.maximum(square, 0.0))
    return Modes(shapes, len(boundary), omega)


def static_extension(K: Any, patterns: Array, inner: Sequence[int]) -> Array:
    """Static extension: inner coordinates (n, k), zero elsewhere, in equilibrium with the prescribed others `patterns`
    (n, k)."""
    extension = np.zeros_like(patterns)
    if patterns.shape[1]:
        extension[inner] = _solve(_part(K, inner, inner), -(K @ patterns)[inner])
    return extension


def _part(K: Any, rows: Sequence[int], columns: Sequence[int]) -> Any:
    return K[rows][:, columns]


def _lowest(K: Any, M: Any, count: int) -> tuple[Array, Array]:
    """The lowest `count` eigenvalues and vectors of K v = w M v."""
    if isinstance(K, np.ndarray):
        values, vectors = eigh(K, M, subset_by_index=(0, count - 1))
        return values, vectors
    values, vectors = eigsh(K.tocsc(), count, M.tocsc(), sigma=0.0, v0=np.ones(K.shape[0]))
    return values, vectors


def _solve(K: Any, right: Array) -> Array:
    """K^-1 right; raises ValueError where K is singular to working precision."""
    if not isinstance(K, np.ndarray):
        return np.asarray(
            splu(K.tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True}).solve(right)
        )
    scale = 1.0 / np.sqrt(np.abs(np.diag(K)) + 1e-300)
    with warnings.catch_warnings():
        # singularity is detected from the pivots below
        warnings.simplefilter("ignore")
        factor = lu_factor(scale[:, None] * K * scale)
    pivots = np.abs(np.diag(factor[0]))
    if not pivots.min() > 1e-13 * pivots.max():
        raise ValueError(
            "the tangent of the inner coordinates is singular: something inside the body can move freely"
        )
    return np.asarray(scale[:, None] * lu_solve(factor, scale[:, None] * right))


def tangent_derivative(K: Tangent, direction: Array, *, step: float) -> Any:
    """dK along `direction` (n,) at zero, by central differences of fourth order with `step`."""
    inner = K(step * direction) - K(-step * direction)
    outer = K(2 * step * direction) - K(-2 * step * direction)
    return (8 * inner - outer) / (12 * step)


def modal_derivatives(
    K: Tangent,
    modes: Modes,
    inner: Sequence[int],
    *,
    step: float = 1e-3,
    order: int = 2,
    analytic: Callable[[Array], Any] | None = None,
) -> Derivatives:
    """theta_ij, and chi_ijk with order = 3, of all modes: derivatives of the static path, zero at the boundary.

    Paper 2, eq. 8, for the inner coordinates; the boundary values of its theta are in the span of the boundary modes.
    analytic: dK along a direction, where it is known; central differences with `step` (of a mode of unit size)
    otherwise. Raises ValueError for another order than 2 or 3.
    """
    if order not in (2, 3):
        raise ValueError(f"order = {order}: modal derivatives of order 2 or 3 are made")
    k, n = modes.shapes.shape[1], len(modes.shapes)
    rest = _part(K(np.zeros(n)), inner, inner)

    def along(v: Array) -> Any:
        if analytic is not None:
            return analytic(v)
        size = np.abs(v).max()
        return tangent_derivative(K, v / size, step=step) * size

    first = [along(modes.shapes[:, i]) for i in range(k)]
    pairs = [(i, j) for i in range(k) for j in range(i, k)]
    # symmetrised: equal where K is the Hessian of an energy in these coordinates
    right = np.array(
        [0.5 * (first[j] @ modes.shapes[:, i] + first[i] @ modes.shapes[:, j]) for i, j in pairs]
    )
    shapes = np.zeros((n, len(pairs)))
    shapes[inner] = _solve(rest, -right.T[inner])
    if order == 2:
        return Derivatives(shapes, tuple(pairs))
    third, triples = _third(K, modes, (first, dict(zip(pairs, shapes.T, strict=True))), step)
    more = np.zeros((n, len(triples)))
    more[inner] = _solve(rest, -third.T[inner])
    return Derivatives(np.column_stack([shapes, more]), (*pairs, *triples))


def _third(
    K: Tangent, modes: Modes, lower: tuple[list[Any], dict], step: float
) -> tuple[Array, list[tuple[int, int, int]]]:
    """Right-hand sides (p, n) of chi_ijk: d2K[i, j] phi_k + dK[i] theta_jk + dK[j] theta_ik + dK[k] theta_ij."""
    first, theta = lower
    k, phi = modes.shapes.shape[1], modes.shapes
    h, zero = 10 * step, np.zeros(len(phi))
    triples = [(a, b, c) for a in range(k) for b in range(a, k) for c in range(b, k)]
    second = {}
    for a, b in theta:
        u, v = phi[:, a], phi[:, b]
        second[a, b] = (
            K(h * (u + v)) - K(h * (u - v)) - K(h * (v - u)) + K(-h * (u + v))
            if a != b
            else 4 * (K(h * u) - 2 * K(zero) + K(-h * u))
        ) / (4 * h * h)
    right = []
    for a, b, c in triples:
        r = first[a] @ theta[b, c] + first[b] @ theta[a, c] + first[c] @ theta[a, b]
        r += (second[b, c] @ phi[:, a] + second[a, c] @ phi[:, b] + second[a, b] @ phi[:, c]) / 3
        right.append(r)
    return np.array(right), triples


def second_derivatives(modes: Modes, derived: Derivatives) -> Array:
    """theta (k, k, n) of all pairs of modes, symmetric; derivatives of third order are left out.

    With amplitudes tied to those of the modes they give the quadratic manifold q = shapes eta + 1/2 sum theta_ij eta_i eta_j
    (paper 2, eq. 5, with the 1/2): few unknowns, but stiffer than the subspace in which modes and derivatives move freely,
    and sensitive to effects that the path leaves out.
    """
    k, n = modes.shapes.shape[1], len(modes.shapes)
    theta = np.zeros((k, k, n))
    for pair, shape in zip(derived.pairs, derived.shapes.T, strict=True):
        if len(pair) == 2:
            theta[pair[0], pair[1]] = theta[pair[1], pair[0]] = shape
    return theta


class Basis(NamedTuple):
    """A conditioned basis: columns (n, rank), orthonormal in the scaled coordinates.

    condition: ratio of the singular values that were kept, of the given columns scaled to length one.
    """

    columns: Array
    rank: int
    condition: float


def condition_basis(columns: Array, *, scale: Array | None = None, cut: float = 1e-8) -> Basis:
    """Basis of the span of columns (n, k), orthonormal in rows divided by `scale` (n,).

    Zero columns are dropped and all others scaled to length one; singular values below `cut` times the largest are left
    out.
    """
    scaled = columns if scale is None else columns / scale[:, None]
    size = np.linalg.norm(scaled, axis=0)
    keep = size > 1e-9 * size.max(initial=0.0)
    if not np.any(keep):
        return Basis(np.zeros((len(columns), 0)), 0, 1.0)
    left, values, _ = np.linalg.svd(scaled[:, keep] / size[keep], full_matrices=False)
    rank = int(np.sum(values > cut * values[0]))
    basis = left[:, :rank] if scale is None else left[:, :rank] * scale[:, None]
    return Basis(basis, rank, float(values[0] / values[rank - 1]))


def split_boundary(columns: Array, rows: Sequence[int]) -> tuple[Array, Array]:
    """Split a basis into columns (n, len(rows)) with unit values at `rows`, as far as possible, and columns (n, p) that
    are zero there and span the rest. The values at the boundary are then coordinates."""
    size = np.linalg.norm(columns, axis=0)
    unit = columns[:, size > 0] / size[size > 0]
    left, values, right = np.linalg.svd(unit[rows], full_matrices=True)
    rank = int(np.sum(values > 1e-9 * values[0]))
    inverse = (right[:rank].T / values[:rank]) @ left[:, :rank].T
    return unit @ inverse, unit @ right[rank:].T
