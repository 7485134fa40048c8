"""Copies between arrays in compiled code, without checks: the caller's array is long enough.

``a[:] = b`` in a ``@kernel`` brings numba's code for wording an error about shapes along, seconds of compile time.
"""

from __future__ import annotations

from ksd.numerics.kernel import kernel


@kernel
def copy_numbers(to, at, of, start):
    """of (m,) from `start` on into to (n,) from `at` on."""
    for i in range(start, len(of)):
        to[at + i - start] = of[i]


@kernel
def copy_rows(to, of):
    """of (k, m) into the first rows of to (n, m)."""
    for i in range(len(of)):
        for j in range(of.shape[1]):
            to[i, j] = of[i, j]


@kernel
def copy_frames(to, of):
    """of (k, 3, 3) into the first of to (n, 3, 3)."""
    for i in range(len(of)):
        for j in range(3):
            for c in range(3):
                to[i, j, c] = of[i, j, c]
