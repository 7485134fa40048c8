"""Pose of a block as a record stores it: rotation vector, and chord over the joint length."""

from __future__ import annotations

import numpy as np

from ksd.library.chains import rotation_matrices, rotation_vectors
from ksd.library.functions import Array
from ksd.model.arrays import State
from ksd.model.compile import Model


def block_poses(model: Model, states: list[State], node: int, point: Array, length: float) -> Array:
    """Rotation vector and chord (g, 6) of a block about its `point` at rest, in g states."""
    R = np.array([s.R[node] for s in states])
    x = np.array([s.x[node] for s in states]) + R @ (point - model.rest.x[node])
    rotation = rotation_vectors(R)
    half = rotation_matrices(-0.5 * rotation)
    return np.concatenate([rotation, np.einsum("gij,gj->gi", half, x) / length], axis=1)
