"""Tangents of states on a path by arc length, and the bordered systems that are solved with them.

The tangent K is in the block storage of load steps, so that its cost is linear in the number of nodes. [K b; c d] z = r is
solved by block elimination (Keller 1977): with y = K^-1 r and v = K^-1 b the solution is y - z v. Close to a limit point,
where K is all but singular, that loses digits of a Newton correction, which the next one takes back, but none of the
direction of the path, (-v, 1) over its length. Where blocks without pivoting break down, and for few
unknowns, the matrix is dense.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ksd.answers.tangent import (
    AssembledTangent,
    DenseTangent,
    Tangent,
    factor_released,
    skew_block,
    stored_matrix,
)
from ksd.errors import KinematicsError
from ksd.model.arrays import State, Workspace
from ksd.model.compile import Model
from ksd.numerics.indefinite import equilibration, negative_inertia

Array = NDArray[np.float64]
MAX_DENSE = 150
"""Unknowns up to which the matrix is dense: rigid links that only hinges hold need its pivoting."""
MIN_PIVOT = 1e-12
"""Relative pivot below which its sign, and a solution, are those of rounding; of long chains all are above."""


def path_tangent(model: Model, motion: State, factor: float, work: Workspace, inside: int) -> Tangent:
    """Factored tangent of the state `motion` that is assembled in `work` at a load factor, drives held.

    inside: negative pivots inside the members.
    """
    arrays = model.arrays
    skew = skew_block(arrays, motion, factor, work)
    assembled = AssembledTangent(model, motion, arrays, work.matrix.copy(), inside, skew, work)
    if arrays.plan.unknowns > MAX_DENSE and not model.has_closed_bodies:
        found, pivot = factor_released(assembled)
        if pivot > MIN_PIVOT:
            return found
    K, value = assembled.matrix(), assembled.value
    unstable = negative_inertia(K) + inside - len(arrays.terms.start)
    return DenseTangent(model, motion, arrays, value, value, value, unstable, (), skew, matrix=K)


def determinant_parity(tangent: Tangent) -> int:
    """0 where the determinant of the complete tangent, leaf springs and rows included, has the sign that it has at
    a minimum of energy, else 1; one eigenvalue more or less is negative in every metric."""
    sign = 1.0
    if tangent.skew is not None:
        sign = np.linalg.slogdet(tangent.woodbury[1])[0]
    return int((tangent.unstable + (sign < 0.0)) % 2)


def solve_bordered(tangent: Tangent, b: Array, c: Array, right: Array) -> Array:
    """z (n + 1,) of [K b; c] z = right, K with its skew part. Raises numpy.linalg.LinAlgError for a singular matrix."""
    n = len(b)
    if not isinstance(tangent, DenseTangent):
        try:
            y, v = tangent.solve(np.column_stack([right[:n], b])).T
            last = (right[n] - c[:n] @ y) / (c[n] - c[:n] @ v)
        except KinematicsError:
            pass
        else:
            return np.append(y - last * v, last)
    K = stored_matrix(tangent.arrays, tangent.assembled)
    scale = equilibration(K)
    if tangent.skew is not None:
        K[np.ix_(tangent.skew.unknowns, tangent.skew.unknowns)] += tangent.skew.matrix
    A = np.zeros((n + 1, n + 1))
    A[:n, :n], A[:n, n], A[n] = K, b, c
    rows = np.append(scale, 1.0)
    columns = rows.copy()
    columns[n] = 1.0 / max(float(np.abs(rows[:n] * b).max(initial=0.0)), 1e-300)
    A *= columns
    rows[n] = 1.0 / float(np.abs(A[n]).max())
    A *= rows[:, None]
    return columns * np.linalg.solve(A, rows * right)
