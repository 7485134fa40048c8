"""The skew part of the tangent of loads that are not conservative: matrices for questions to a state (in Newton's steps:
`ksd.model.turning`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ksd.model.arrays import Arrays, Motion

Array = NDArray[np.float64]


def cross_matrix(v: Array) -> Array:
    """[v]x (3, 3)."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])


def turning_loads(arrays: Arrays, motion: Motion, factor: float) -> Array | None:
    """Skew part (n, n) of the tangent of loads that follow and of moments, None without any; see `ksd.model.turning`."""
    loads = arrays.loads
    if not loads.skew.any():
        return None
    rest = np.zeros((arrays.plan.unknowns,) * 2)
    for i in np.flatnonzero(loads.skew):
        u, T = int(arrays.start[loads.node[i]]), motion.R[loads.node[i]]
        if not loads.following[i]:
            rest[u + 3 : u + 6, u + 3 : u + 6] -= 0.5 * cross_matrix(factor * loads.moment[i])
            continue
        F = factor * (T @ loads.force[i])
        half_F = 0.5 * cross_matrix(F)
        half_M = 0.5 * cross_matrix(factor * (T @ loads.moment[i]) + np.cross(T @ loads.point[i], F))
        rest[u : u + 3, u + 3 : u + 6] += half_F
        rest[u + 3 : u + 6, u : u + 3] += half_F
        rest[u + 3 : u + 6, u + 3 : u + 6] += half_M
    return rest
