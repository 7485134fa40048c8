"""The tangent of loads that are not conservative, its skew part, and the count of directions in which a state diverges under
them: matrices for questions to a state (in Newton's steps: `ksd.model.nonconservative`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ksd.model.arrays import Arrays, State

Array = NDArray[np.float64]
REAL_TOLERANCE = 1e-9
"""Imaginary part of an eigenvalue, over its size, below which it is real."""

_CROSS = np.cross(np.eye(3)[:, None], np.eye(3)[None]).swapaxes(1, 2).reshape(3, 9)
"""[e]x of the three axes, a row each."""


def cross_matrix(v: Array) -> Array:
    """[v]x (..., 3, 3) of vectors (..., 3)."""
    return (v @ _CROSS).reshape(*v.shape, 3)


def load_tangent(force: Array, moment: Array, lever: Array, *, following: bool) -> Array:
    """Tangent (6, 6), in the motion of its node, of a force (3,) [N] at `lever` (3,) [m] and a moment (3,) [Nm], global, in
    the convention of `ksd.model.nonconservative`: symmetric for a dead force."""
    tangent = np.zeros((6, 6))
    if following:
        tangent[:3, 3:] = cross_matrix(force)
        tangent[3:, 3:] = 0.5 * cross_matrix(moment + np.cross(lever, force))
    else:
        both = np.outer(lever, force)
        tangent[3:, 3:] = (lever @ force) * np.eye(3) - 0.5 * (both + both.T) - 0.5 * cross_matrix(moment)
    return tangent


def skew_tangent(arrays: Arrays, motion: State, factor: float) -> Array | None:
    """Skew part (n, n) of the tangent of loads, see `ksd.model.nonconservative`; None without any that follow or moments."""
    loads = arrays.loads
    if not loads.skew.any():
        return None
    rest = np.zeros((arrays.plan.unknowns,) * 2)
    for i in np.flatnonzero(loads.skew):
        u, T, following = int(arrays.start[loads.node[i]]), motion.R[loads.node[i]], bool(loads.following[i])
        force, moment, turn = factor * loads.force[i], factor * loads.moment[i], T if following else np.eye(3)
        tangent = load_tangent(turn @ force, turn @ moment, T @ loads.point[i], following=following)
        rest[u : u + 6, u : u + 6] += 0.5 * (tangent - tangent.T)
    return rest


def count_negative_eigenvalues(arrays: Arrays, K: Array, rest: Array) -> int:
    """Real negative eigenvalues of the tangent K + rest (n, n) on the motions that the constraint rows leave, and one for
    every row, as the inertia of K counts them. K: symmetric, multipliers included; rest: skew. Displacements count over the
    size of the mechanism."""
    from scipy.linalg import null_space

    rows = arrays.terms.start
    unit = np.ones(len(K))
    for u in (int(s) for s in arrays.start if s >= 0):
        unit[u : u + 3] = arrays.size
    scaled = (K + rest) * np.outer(unit, unit)
    free = np.setdiff1d(np.arange(len(K)), rows)
    A = scaled[np.ix_(free, free)]
    if len(rows):
        C = scaled[np.ix_(rows, free)]
        # those that are let go have none
        size = np.linalg.norm(C, axis=1, keepdims=True)
        Z = null_space(C / np.where(size > 0.0, size, 1.0))
        A = Z.T @ A @ Z
    values = np.linalg.eigvals(A) if A.size else np.zeros(0)
    negative = (values.real < 0.0) & (np.abs(values.imag) <= REAL_TOLERANCE * np.abs(values))
    return len(rows) + int(negative.sum())
