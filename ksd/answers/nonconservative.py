"""Tangent of loads that are not conservative, its skew part, and the number of directions in which a state diverges.

These are matrices for questions about a state; `ksd.model.follower_correction` has the terms of Newton's steps.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import null_space

from ksd.elements.pressure import skew_at
from ksd.model.arrays import Arrays, State, Workspace

Array = NDArray[np.float64]
MAX_DAMPED_SKEW_SHARE = 1e-3
"""Skew share rho of the tangent up to which flutter is left to damping: a damping ratio of rho / 2 is less than flexures
have."""
REAL_TOLERANCE = 1e-9
"""Imaginary part of an eigenvalue, relative to its magnitude, up to which it counts as real."""

_CROSS = np.cross(np.eye(3)[:, None], np.eye(3)[None]).swapaxes(1, 2).reshape(3, 9)
"""Cross product matrices [e]x of the three axes, one per row."""


def cross_matrix(v: Array) -> Array:
    """Cross product matrices [v]x (..., 3, 3) of vectors (..., 3)."""
    return (v @ _CROSS).reshape(*v.shape, 3)


def load_tangent(force: Array, moment: Array, lever: Array, *, following: bool) -> Array:
    """Tangent (6, 6) in the motion of its node of a force (3,) [N] at `lever` (3,) [m] and a moment (3,) [Nm], all global.

    following: the load turns with its node. Convention of `ksd.model.follower_correction`: symmetric for a dead force.
    """
    tangent = np.zeros((6, 6))
    if following:
        tangent[:3, 3:] = cross_matrix(force)
        tangent[3:, 3:] = 0.5 * cross_matrix(moment + np.cross(lever, force))
    else:
        both = np.outer(lever, force)
        tangent[3:, 3:] = (lever @ force) * np.eye(3) - 0.5 * (both + both.T) - 0.5 * cross_matrix(moment)
    return tangent


def skew_tangent(
    arrays: Arrays, motion: State, load_factor: float, work: Workspace | None = None
) -> Array | None:
    """Skew part (n, n) of the tangent of the loads, see `ksd.model.follower_correction`.

    work: as assembled at the state, for that of leaves under pressure, which is left out without. None where all loads are
    conservative.
    """
    loads = arrays.loads
    if arrays.conservative:
        return None
    skew = np.zeros((arrays.plan.unknowns,) * 2)
    pressed = arrays.under_pressure.tolist()
    for i in pressed if work is not None else ():
        assert work is not None
        at = skew_at(work.store[: arrays.members.store_at[i + 1]], arrays.members.number[i, 5])
        own = work.store[at : at + 144].reshape(2, 6, 2, 6)
        first = arrays.start[arrays.members.node[i]]
        for a, u in enumerate(first):
            for b, v in enumerate(first):
                if u >= 0 and v >= 0:
                    skew[u : u + 6, v : v + 6] += own[a, :, b]
    for i in np.flatnonzero(loads.skew):
        u, T, following = int(arrays.start[loads.node[i]]), motion.R[loads.node[i]], bool(loads.following[i])
        force, moment, turn = (
            load_factor * loads.force[i],
            load_factor * loads.moment[i],
            T if following else np.eye(3),
        )
        tangent = load_tangent(turn @ force, turn @ moment, T @ loads.point[i], following=following)
        skew[u : u + 6, u : u + 6] += 0.5 * (tangent - tangent.T)
    return skew


def count_negative_eigenvalues(arrays: Arrays, K: Array, skew: Array) -> int:
    """Number of real negative eigenvalues of the tangent K + skew (n, n) on the null space of the constraint rows, plus the
    number of rows, as in the inertia of K.

    K: symmetric part, multipliers included; skew: skew part. Displacements are relative to the size of the mechanism.
    """
    rows = arrays.terms.start
    unit = np.ones(len(K))
    for u in (int(s) for s in arrays.start if s >= 0):
        unit[u : u + 3] = arrays.size
    scaled = (K + skew) * np.outer(unit, unit)
    free = np.setdiff1d(np.arange(len(K)), rows)
    A = scaled[np.ix_(free, free)]
    if len(rows):
        C = scaled[np.ix_(rows, free)]
        # released rows are zero
        norm = np.linalg.norm(C, axis=1, keepdims=True)
        Z = null_space(C / np.where(norm > 0.0, norm, 1.0))
        A = Z.T @ A @ Z
    values = np.linalg.eigvals(A) if A.size else np.zeros(0)
    negative = (values.real < 0.0) & (np.abs(values.imag) <= REAL_TOLERANCE * np.abs(values))
    return len(rows) + int(negative.sum())
