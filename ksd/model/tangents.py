"""Compiled addition of forces and tangents of node pairs to the block matrix and the residual."""

from __future__ import annotations

from ksd.model.arrays import ACTIVE_DOFS, DOFS_PER_NODE
from ksd.numerics.kernel import kernel


@kernel
def scatter(ints, block, T, force, a, b, matrix, rhs):
    """Add tangent T (12, 12) and force (12,) of a node pair to the block matrix and the residual, for the active degrees of
    freedom. ints[block:]: offsets of the blocks as in `Members.block`; a, b: first unknowns of the nodes."""
    active, w = ints[ACTIVE_DOFS], ints[DOFS_PER_NODE]
    for e in range(2):
        at, u = ints[block + e], a if e == 0 else b
        if at >= 0:
            for r in range(w):
                i = 6 * e + ints[active + r]
                rhs[u + r] += force[i]
                for c in range(w):
                    matrix[at + w * r + c] += T[i, 6 * e + ints[active + c]]
    couple(ints, ints[block + 2], ints[block + 3], T, matrix)


@kernel(inline="late")
def couple(ints, at, flipped, T, matrix):
    """Add the coupling block of T (12, 12) to the block stored at `at`, whose rows belong to the first node where flipped
    is 1."""
    active, w = ints[ACTIVE_DOFS], ints[DOFS_PER_NODE]
    if at >= 0:
        for r in range(w):
            i = ints[active + r]
            for c in range(w):
                j = ints[active + c]
                matrix[at + w * r + c] += T[i, 6 + j] if flipped == 1 else T[6 + i, j]
