"""Drive forces of the kinematic answer in a plane, compiled: the planar twin of `ksd.bodies.readout.drive_forces`."""

from __future__ import annotations

import math

import numpy as np

from ksd.bodies.kinematics import least_squares, room_for
from ksd.bodies.planar_kinematics import planar_equations
from ksd.model.arrays import TRANSLATION
from ksd.model.planar_flat import PLANAR_LINEAR
from ksd.numerics.kernel import kernel


@kernel
def _work_of_loads(loads, pose, W, Q):
    """Less the work of the loads per intended motion, into Q (motions,); W (node, motion, 3): twists of the links."""
    for i in range(len(loads.node)):
        node = loads.node[i]
        c, s = math.cos(pose[node, 2]), math.sin(pose[node, 2])
        x, y = c * loads.point[i, 0] - s * loads.point[i, 1], s * loads.point[i, 0] + c * loads.point[i, 1]
        fx, fy = loads.force[i, 0], loads.force[i, 1]
        if loads.following[i] == 1:
            fx, fy = c * fx - s * fy, s * fx + c * fy
        turning = loads.moment[i] + x * fy - y * fx
        for q in range(len(Q)):
            Q[q] -= W[node, q, 0] * fx + W[node, q, 1] * fy + W[node, q, 2] * turning


@kernel
def planar_drive_forces(arrays, loops, theta, target, motion, turns, place, mu):
    """mu (c,): multipliers of the rows in step 1 by virtual work; place (J, 9) belongs to theta (q,).

    motion.inner holds the condensed joints, F at 3. Otherwise as in space.
    """
    closing, motions = 3 * len(loops.closing), len(theta)
    rows = closing + len(target)
    W = np.zeros((len(motion.pose), motions, 3))
    J, residual, Q, rate = np.zeros((rows, motions)), np.zeros(rows), np.zeros(motions), np.zeros(motions)
    reach, room = np.empty((2, len(motion.pose)), np.int64), room_for(rows, motions)
    planar_equations(
        loops, arrays.terms, arrays.size, target, motion.pose, turns, place, reach, W, J, residual
    )
    for j in range(len(loops.node)):
        o = PLANAR_LINEAR * j + 3
        for q in range(loops.first[j], loops.first[j + 1]):
            at = 3 + 3 * (q - loops.first[j])
            Q[q] += motion.inner[o] * place[j, at + 1] + motion.inner[o + 1] * place[j, at + 2]
            Q[q] += motion.inner[o + 2] * place[j, at]
    _work_of_loads(arrays.loads, motion.pose, W, Q)
    terms = arrays.terms
    for i in range(len(target)):
        residual[:] = 0.0
        residual[closing + i] = -1.0
        mu[i] = math.nan
        if least_squares(J, residual, rate, room) > 1e-13:
            s, rotations = 0.0, 0
            for q in range(motions):
                s -= Q[q] * rate[q]
            for t in range(terms.first[i], terms.first[i + 1]):
                rotations += terms.kind[t] != TRANSLATION
            # rows made of rotations alone were multiplied by the size, so their multipliers come out divided by it
            mu[i] = s * arrays.size if rotations == terms.first[i + 1] - terms.first[i] else s
