"""Weight of the leaf springs of condensed joints; compiled for models with such weight.

A substructure is described in the axes of its interface A, so gravity is rotated into those. Once condensed, the weight
of a joint is a dead load on the link of A at the centre of mass of its leaf springs, with a part carried by B that the
wrench of its linear body contains. Both are exact, and rotate with A until the joint is linearised again.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ksd.elements.strain_values import GRAVITY_BLOCK_SIZE
from ksd.numerics.kernel import kernel


class JointWeights(NamedTuple):
    """owner (m,): joint of every substructure member; load (J,): the load of the reduced mechanism that represents the
    weight of a joint, -1 where A is on ground. Both are empty without weight."""

    owner: np.ndarray
    load: np.ndarray


NO_JOINT_WEIGHTS = JointWeights(np.zeros(0, np.int64), np.zeros(0, np.int64))


@kernel
def gravity_in_joint_axes(owner, node, R, frame, given, weight):
    """Rotate gravity of the substructures' members `given`, global, into the axes of A of their joint: `weight`, both
    tables of `Arrays.weight`.

    node (J, 2): links of the joints; R (k, 3, 3): their rotations; frame (J, 3, 3): joint axes at rest.
    """
    for i in range(len(owner)):
        link_axes, F = R[node[owner[i], 0]], frame[owner[i]]
        for r in range(3):
            weight[i, 1 + r] = 0.0
            for c in range(3):
                component = 0.0
                for k in range(3):
                    component += link_axes[c, k] * F[k, r]
                weight[i, 1 + r] += component * given[i, 1 + c]


@kernel
def place_joint_weights(owner, load, node, store_at, x, pose, store, weight, anchor, frame, point):
    """Write the centres of mass of the condensed joints into the points (l, 3) of their loads, axes of link A.

    node (m, 2), store_at (m + 1,): of the substructures' members; x (k, 3): of their nodes; pose, store, weight: of
    their `Workspace`; anchor (J, 2, 3), frame (J, 3, 3): of the joints.
    """
    total = np.zeros((len(load), 4))
    for i in range(len(owner)):
        if weight[i, 0] > 0.0:
            j, mass, p, o = owner[i], weight[i, 0], pose[i], store_at[i + 1] - GRAVITY_BLOCK_SIZE
            total[j, 0] += mass
            for r in range(3):
                start = x[node[i, 0], r] + p[9 + r] - p[15 + r]
                total[j, 1 + r] += mass * start
                for c in range(3):
                    total[j, 1 + r] += p[3 * r + c] * store[o + 3 + c]
    for j in range(len(load)):
        if load[j] >= 0:
            for r in range(3):
                s = anchor[j, 0, r]
                for c in range(3):
                    s += frame[j, r, c] * total[j, 1 + c] / total[j, 0]
                point[load[j], r] = s
