"""Compiled solution of small dense linear systems."""

from __future__ import annotations

from ksd.numerics.kernel import kernel


@kernel
def solve_small(A, B):
    """B (n, k) <- A^-1 B in place, by Gaussian elimination with partial pivoting; A (n, n) is overwritten."""
    n, count = B.shape
    for c in range(n):
        best = c
        for r in range(c + 1, n):
            if abs(A[r, c]) > abs(A[best, c]):
                best = r
        for k in range(n):
            A[c, k], A[best, k] = A[best, k], A[c, k]
        for k in range(count):
            B[c, k], B[best, k] = B[best, k], B[c, k]
        for r in range(c + 1, n):
            share = A[r, c] / A[c, c]
            for k in range(c + 1, n):
                A[r, k] -= share * A[c, k]
            for k in range(count):
                B[r, k] -= share * B[c, k]
    for c in range(n - 1, -1, -1):
        for k in range(count):
            s = B[c, k]
            for r in range(c + 1, n):
                s -= A[c, r] * B[r, k]
            B[c, k] = s / A[c, c]
