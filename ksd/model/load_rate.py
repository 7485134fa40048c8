"""Derivative of the residual with respect to the load factor, for the distributed loads of leaf springs."""

from __future__ import annotations

import numpy as np

from ksd.elements.inertia import inertia_places
from ksd.elements.pressure import GIVEN_MODES, skew_at
from ksd.model.arrays import PLANAR, Arrays, Workspace


def distributed_force(arrays: Arrays, work: Workspace) -> np.ndarray:
    """Derivative (n,) of the residual with respect to the load factor, from the distributed loads of all leaf springs.

    work: as assembled at the state. With V(xi, f) and the modes f of `ksd.elements.leaf_loads`: they act on end p with their
    moments, and V_xi,f df through the levers of the ends.
    """
    derivative, members = np.zeros(arrays.plan.unknowns), arrays.members
    for i in np.flatnonzero(arrays.load_modes):
        modes, store = int(arrays.load_modes[i]), work.store[: members.store_at[i + 1]]
        D, pose = 3 * modes, work.pose[i]
        pull = store[-D * (10 + D) :]
        frame, w, s, d = pose[:9].reshape(3, 3), pose[9:12], pose[12:15], pose[15:18]
        total = work.weight[i, :1]
        if members.number[i, 5]:
            _, at = inertia_places(members.number[i], members.kind[i] == PLANAR)
            total = members.value[members.value_at[i] + at :][:modes]
        given = work.weight[i, 1 : 1 + 3 * min(modes, GIVEN_MODES)].reshape(-1, 3)
        df = (given @ frame).ravel()
        if modes > GIVEN_MODES:
            rows = store[skew_at(store, modes) + 144 : len(store) - D * (10 + D)]
            rows = rows.reshape(D - len(df), -1)
            df = np.concatenate([df, rows[:, 1] + rows[:, 8:] @ df])
        force, moment = (frame @ (pull[k : k + 3 * D].reshape(3, D) @ df) for k in (3 * D, 6 * D))
        swing = (pull[9 * D : 9 * D + D * D].reshape(D, D) @ df).reshape(-1, 3) @ frame.T
        first = total[:, None] * (w - d) + pull[2 * D : 3 * D].reshape(-1, 3) @ frame.T
        change, now = (part.reshape(-1, 3) @ frame.T for part in (df, pull[:D]))
        turned = np.cross(first, change) - np.cross(swing, now)
        at_a = -moment - np.cross(w, force) - turned.sum(axis=0)
        at_b = moment + np.cross(s, force)
        pushes = np.concatenate([-force - total @ change, at_a]), np.concatenate([force, at_b])
        for node, push in zip(members.node[i], pushes, strict=True):
            u = int(arrays.start[node])
            if u >= 0:
                derivative[u : u + 6] += push
    return derivative
