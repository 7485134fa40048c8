"""Derivative of the residual with respect to the load factor, for the weight of leaf springs."""

from __future__ import annotations

import numpy as np

from ksd.elements.strain_values import GRAVITY_BLOCK_SIZE
from ksd.model.arrays import Arrays, Workspace


def weight_force(arrays: Arrays, work: Workspace) -> np.ndarray:
    """Derivative (n,) of the residual with respect to the load factor, from the weight of all leaf springs.

    work: as assembled at the state. With V(xi, g) of `ksd.elements.weight`: mass times g acts on end p with its moment, and
    V_xi,g g acts through the levers of the ends.
    """
    derivative, members = np.zeros(arrays.plan.unknowns), arrays.members
    for i in np.flatnonzero(work.weight[:, 0]):
        pull = work.store[: members.store_at[i + 1]][-GRAVITY_BLOCK_SIZE:]
        pose, mass, gravity = work.pose[i], work.weight[i, 0], work.weight[i, 1:]
        frame, w, s, d = pose[:9].reshape(3, 3), pose[9:12], pose[12:15], pose[15:18]
        own = frame.T @ gravity
        force, moment = (frame @ (pull[9 + k : 18 + k].reshape(3, 3) @ own) for k in (0, 9))
        swing = frame @ (pull[27:36].reshape(3, 3) @ own)
        first = mass * (w - d) + frame @ pull[6:9]
        at_a = -moment - np.cross(w, force) - np.cross(first, gravity) + np.cross(swing, frame @ pull[:3])
        at_b = moment + np.cross(s, force)
        pushes = (np.concatenate([-force - mass * gravity, at_a]), np.concatenate([force, at_b]))
        for node, push in zip(members.node[i], pushes, strict=True):
            u = int(arrays.start[node])
            if u >= 0:
                derivative[u : u + 6] += push
    return derivative
