"""Least work of a solve: operations and bytes of one evaluation of a mechanism, counted from its arrays.

An operation is one addition or multiplication of doubles. Counted are the loops that dominate: condensation of every leaf,
its way into the matrix, and the block factorisation (exactly, from its plan); trigonometry and indices are left out, so a
pass takes more than this. Bytes: of the storage a pass reads or writes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ksd.model.arrays import LINEAR, STRAIN, Arrays, make_workspace
from ksd.numerics.blocks import Blocks

ELEMENT_OPERATIONS = 1700
"""Operations of one Appendix A element: elimination of its inner node with eight columns 650, its tangent of 12 x 12 620,
gradients, strains, stresses and frames 430."""
ASSEMBLY_OPERATIONS = 2 * (6 * 6 * 12 + 12 * 6 * 12)
"""Operations of a condensed body in the matrix of its nodes: T^T K T with K (6, 6), T (6, 12)."""


@dataclass(frozen=True)
class Pass:
    """One evaluation of a mechanism: operations of leaves (condensation), of their assembly into the matrix, and of its
    factorisation; bytes of the storage read or written."""

    leaves: int
    matrix: int
    factor: int
    bytes: int

    @property
    def operations(self) -> int:
        """Total number of operations."""
        return self.leaves + self.matrix + self.factor

    def __str__(self) -> str:
        return f"{_rounded(self.operations)} operations and {_rounded(self.bytes)} bytes"


def _rounded(n: float) -> str:
    for size, word in ((1e6, "million"), (1e3, "thousand")):
        if n >= size:
            return f"{n / size:.3g} {word}"
    return f"{n:.0f}"


def leaf_operations(kind: int, number: np.ndarray) -> int:
    """Operations of the condensation of one leaf to its ends."""
    if kind == LINEAR:
        return 0
    if kind != STRAIN:
        return ELEMENT_OPERATIONS * int(number[0])
    N, ng = int(sum(number[:3])), int(number[3])
    fields = 30 * N * ng
    tangent = 39 * N * ng + 2 * N * N * ng + 6 * N * N
    # LDL^T and seven columns; the flexibility of the ends, inverted
    return fields + tangent + N**3 // 3 + 14 * N * N + 98 * N + 432


def factor_operations(plan: Blocks) -> int:
    """Operations of the block LDL^T factorisation, from its plan."""
    total = 0
    for k, n in enumerate(plan.size.tolist()):
        rows = plan.size[plan.row[plan.first[k] : plan.first[k + 1]]]
        pairs = sum(int(a) * int(b) for i, a in enumerate(rows) for b in rows[i:])
        total += n**3 // 3 + n * n * int(rows.sum()) + 2 * n * pairs
    return total


def one_pass(arrays: Arrays) -> Pass:
    """Work of one assembly and factorisation of a mechanism in space."""
    members = arrays.members
    leaves = sum(leaf_operations(int(k), n) for k, n in zip(members.kind, members.number, strict=True))
    work = make_workspace(arrays)
    touched = (*work, members.value, members.frame, members.offset)
    size = sum(int(a.nbytes) for a in touched)
    return Pass(leaves, ASSEMBLY_OPERATIONS * len(members.kind), factor_operations(arrays.plan), size)
