"""Symmetric pencils K - s M of arrow shape: a few node unknowns, and many leafs that are coupled to their two nodes only.

K is diag(nodes, 1), M has the blocks [nodes, C^T; C, A]: every leaf is scaled by a root of its own flexibility. A shifted
matrix then costs one small elimination per leaf and one of the nodes, and the negative pivots count the eigenvalues
between zero and the shift (Sylvester), so that none can be missed. No pivoting, as in `ksd.numerics.blocks`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ksd.numerics.kernel import kernel

HOLLOW = 1e-13
"""Pivots of a flexibility below this share of the largest are directions that do not give at all."""


class Arrow(NamedTuple):
    """K, M (n, n) of the nodes; A (k, N, N), C (k, N, 12) of the leafs in M; at (k, 12): unknowns of both nodes of a leaf,
    -1 where there is none. Vectors are (n + k N,): nodes first."""

    K: np.ndarray
    M: np.ndarray
    A: np.ndarray
    C: np.ndarray
    at: np.ndarray


@kernel
def flexibility_roots(Z, R, left):
    """R (k, N, N) with Z = R R^T of semidefinite Z (k, N, N), by Cholesky with the largest pivot first; columns beyond the
    rank are zero. left (N,): scratch."""
    size = Z.shape[1]
    for leaf in range(len(Z)):
        largest = 0.0
        for i in range(size):
            left[i] = Z[leaf, i, i]
            largest = max(largest, left[i])
        for c in range(size):
            at = 0
            for i in range(size):
                R[leaf, i, c] = 0.0
                if left[i] > left[at]:
                    at = i
            if left[at] > HOLLOW * largest:
                root = np.sqrt(left[at])
                for i in range(size):
                    # rows that were pivots have nothing left
                    if left[i] > 0.0:
                        t = Z[leaf, i, at]
                        for b in range(c):
                            t -= R[leaf, i, b] * R[leaf, at, b]
                        R[leaf, i, c] = t / root
                        left[i] -= R[leaf, i, c] * R[leaf, i, c]
                left[at] = 0.0


@kernel
def arrow_times(arrow, X, out):
    """out (p, size) = M x for every row of X (p, size)."""
    n = len(arrow.K)
    modes = arrow.A.shape[1]
    for v in range(len(X)):
        for i in range(n):
            t = 0.0
            for j in range(n):
                t += arrow.M[i, j] * X[v, j]
            out[v, i] = t
        for leaf in range(len(arrow.A)):
            first = n + leaf * modes
            for i in range(modes):
                y = X[v, first + i]
                t = 0.0
                for j in range(modes):
                    t += arrow.A[leaf, i, j] * X[v, first + j]
                for j in range(12):
                    to = arrow.at[leaf, j]
                    if to >= 0:
                        t += arrow.C[leaf, i, j] * X[v, to]
                        out[v, to] += arrow.C[leaf, i, j] * y
                out[v, first + i] = t


@kernel
def arrow_solves(arrow, shift, F, rows, nodes, negatives):
    """Solve (K - shift M) x = F, in place, several right sides F[g] (q, size) for every shift[g].

    rows (k, N, N + 12 + q), nodes (n, n + q): scratch; negatives (g,): negative pivots met. A pivot of exactly zero
    leaves nan behind.
    """
    n = len(arrow.K)
    modes = arrow.A.shape[1]
    right = F.shape[1]
    width = modes + 12 + right
    for g in range(len(shift)):
        s = shift[g]
        count = 0
        for i in range(n):
            for j in range(i, n):
                nodes[i, j] = arrow.K[i, j] - s * arrow.M[i, j]
            for r in range(right):
                nodes[i, n + r] = F[g, r, i]
        for leaf in range(len(arrow.A)):
            # rows [1 - s A, s C, f] of the leaf, made upper triangular
            first = n + leaf * modes
            if s == 0.0:
                # K of a leaf is the identity: F holds the solution already
                continue
            for i in range(modes):
                for j in range(i, modes):
                    rows[leaf, i, j] = -s * arrow.A[leaf, i, j]
                rows[leaf, i, i] += 1.0
                for j in range(12):
                    rows[leaf, i, modes + j] = s * arrow.C[leaf, i, j]
                for r in range(right):
                    rows[leaf, i, modes + 12 + r] = F[g, r, first + i]
            for j in range(modes):
                d = rows[leaf, j, j]
                if d < 0.0:
                    count += 1
                for i in range(j + 1, modes):
                    f = rows[leaf, j, i] / d
                    for c in range(i, width):
                        rows[leaf, i, c] -= f * rows[leaf, j, c]
                # what is left of it at the nodes: - (s C)^T (1 - s A)^-1 (s C), and + ... f
                for a in range(12):
                    i = arrow.at[leaf, a]
                    if i >= 0:
                        f = rows[leaf, j, modes + a] / d
                        for b in range(12):
                            k = arrow.at[leaf, b]
                            if k >= i:
                                nodes[i, k] -= f * rows[leaf, j, modes + b]
                        for r in range(right):
                            nodes[i, n + r] += f * rows[leaf, j, modes + 12 + r]
        for j in range(n):
            d = nodes[j, j]
            if d < 0.0:
                count += 1
            for i in range(j + 1, n):
                f = nodes[j, i] / d
                if f != 0.0:
                    for c in range(i, n + right):
                        nodes[i, c] -= f * nodes[j, c]
        negatives[g] = count
        for r in range(right):
            for i in range(n - 1, -1, -1):
                t = nodes[i, n + r]
                for j in range(i + 1, n):
                    t -= nodes[i, j] * F[g, r, j]
                F[g, r, i] = t / nodes[i, i]
            for leaf in range(len(arrow.A)):
                first = n + leaf * modes
                if s == 0.0:
                    continue
                for i in range(modes - 1, -1, -1):
                    t = rows[leaf, i, modes + 12 + r]
                    for j in range(12):
                        k = arrow.at[leaf, j]
                        if k >= 0:
                            t += rows[leaf, i, modes + j] * F[g, r, k]
                    for j in range(i + 1, modes):
                        t -= rows[leaf, i, j] * F[g, r, first + j]
                    F[g, r, first + i] = t / rows[leaf, i, i]


@kernel
def row_products(X, MX, KX, a, b):
    """Scale the rows of X, MX, KX (p, size), in place, so that those of X and KX have products of one; a, b (p, p): the
    symmetric parts of X KX^T and X MX^T."""
    count, size = X.shape
    for p in range(count):
        t = 0.0
        for i in range(size):
            t += X[p, i] * KX[p, i]
        f = 1.0 / math.sqrt(abs(t))
        for i in range(size):
            X[p, i] *= f
            MX[p, i] *= f
            KX[p, i] *= f
    for p in range(count):
        for q in range(p + 1):
            k, m = 0.0, 0.0
            for i in range(size):
                k += X[p, i] * KX[q, i] + X[q, i] * KX[p, i]
                m += X[p, i] * MX[q, i] + X[q, i] * MX[p, i]
            a[p, q] = a[q, p] = 0.5 * k
            b[p, q] = b[q, p] = 0.5 * m
