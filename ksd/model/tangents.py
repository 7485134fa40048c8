"""Where the forces and tangents on nodes go in the block matrix and the residual, compiled."""

from __future__ import annotations

from ksd.model.arrays import ACTIVE_DOFS, DOFS_PER_NODE
from ksd.numerics.kernel import kernel


@kernel
def scatter(ints, block, T, force, a, b, matrix, rhs):
    """Add T (12, 12) to the stored blocks (pp, qq, coupling, flipped) at ints[block:] and force (12,) to the residual, of
    the unknowns that are kept of every node; a, b: the first of each end."""
    keep, w = ints[ACTIVE_DOFS], ints[DOFS_PER_NODE]
    for e in range(2):
        at, u = ints[block + e], a if e == 0 else b
        if at >= 0:
            for r in range(w):
                i = 6 * e + ints[keep + r]
                rhs[u + r] += force[i]
                for c in range(w):
                    matrix[at + w * r + c] += T[i, 6 * e + ints[keep + c]]
    couple(ints, ints[block + 2], ints[block + 3], T, matrix)


@kernel(inline="late")
def couple(ints, at, flipped, T, matrix):
    """Add the coupling of T (12, 12) to the block stored from `at` on, whose rows are of the first node where flipped."""
    keep, w = ints[ACTIVE_DOFS], ints[DOFS_PER_NODE]
    if at >= 0:
        for r in range(w):
            i = ints[keep + r]
            for c in range(w):
                j = ints[keep + c]
                matrix[at + w * r + c] += T[i, 6 + j] if flipped == 1 else T[6 + i, j]
