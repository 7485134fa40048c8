"""Energy of springs and of links with a matrix at a state."""

from __future__ import annotations

import math

import numpy as np

from ksd.model.arrays import COIL, TURN, Motion
from ksd.model.compile import Model
from ksd.model.poses import member_pose


def spring_energy(model: Model, motion: Motion) -> dict[str, float]:
    """Energy [J] of every spring and link with a matrix, by name; empty where the model has none."""
    return {name: energy_of_spring(model, motion, i) for i, name in enumerate(model.spring_names)}


def energy_of_spring(model: Model, motion: Motion, i: int) -> float:
    """k (l - l0)^2 / 2, k (angle - rest)^2 / 2, or xi K xi / 2 of spring i."""
    springs = model.arrays.springs
    value, pose, Q = springs.value[springs.value_at[i] :], np.empty(18), np.empty((3, 3))
    member_pose(springs.node, springs.offset, springs.frame, motion.x, motion.R, i, pose, Q)
    d = pose[:9].reshape(3, 3).T @ pose[15:]
    if springs.kind[i] == COIL:
        return 0.5 * float(value[0]) * (math.sqrt(float(d @ d)) - float(value[1])) ** 2
    from scipy.spatial.transform import Rotation

    if springs.kind[i] == TURN:
        _, _, z, w = Rotation.from_matrix(Q).as_quat()
        angle = 2.0 * math.atan2(z, w)
        # the same branch as the kernel: between -180 and 180 degrees
        angle -= 2.0 * math.pi * round(angle / (2.0 * math.pi))
        return 0.5 * float(value[0]) * (angle - float(value[1])) ** 2
    turned = Rotation.from_matrix(Q @ value[3:12].reshape(3, 3).T).as_rotvec()
    xi = np.concatenate([d - value[:3], turned])
    return float(value[12:18] @ xi + 0.5 * xi @ value[18:54].reshape(6, 6) @ xi)
