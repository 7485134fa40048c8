"""Drive forces of step 1 of the KSD method by virtual work, compiled."""

from __future__ import annotations

import math

import numpy as np

from ksd.joints.joint_arrays import CLOSING_COUNT, FIRST_MOTION, JOINT_COUNT
from ksd.joints.kinematics import MIN_PIVOT, least_squares, least_squares_scratch, loop_equations_at
from ksd.model.arrays import LOAD, LOADS, ROWS, TERM, TRANSLATION
from ksd.numerics.kernel import kernel


@kernel
def drive_forces(ints, floats, joint_ints, geometry, theta, target, x, R, angle, pose, wrench, mu):
    """Write mu (c,): multipliers of drives and supports in step 1 by virtual work, with the links at the poses that
    theta gives.

    ints, floats: of the reduced mechanism, as in `ksd.model.arrays.Arrays`; joint_ints, geometry: as in
    `ksd.joints.joint_arrays`; x, R, angle: of its links, overwritten. wrench (54 J,): inner states of the condensed joints,
    with their wrench F at 12 (`ksd.elements.linear`). With Q the work of the joints' wrenches in pure intended motion minus
    that of the loads, mu_i = -Q . J^+ e_i, where J^+ e_i is the change of theta per unit of row i while the loops stay
    closed. Multipliers that are undetermined are nan.
    """
    closing, motions, length_scale = 6 * joint_ints[CLOSING_COUNT], len(theta), floats[0]
    residual, J, W = loop_equations_at(ints, floats, joint_ints, geometry, theta, target, x, R, angle, pose)
    Q, rate, scratch = np.zeros(motions), np.zeros(motions), least_squares_scratch(len(residual), motions)
    for j in range(joint_ints[JOINT_COUNT]):
        first = joint_ints[joint_ints[FIRST_MOTION] + j]
        for q in range(first, joint_ints[joint_ints[FIRST_MOTION] + j + 1]):
            at = 12 + 6 * (q - first)
            for r in range(6):
                Q[q] += wrench[54 * j + 12 + r] * pose[j, at + r]
    arm, force, moment = np.empty(3), np.empty(3), np.empty(3)
    for i in range(ints[LOADS]):
        node, following = ints[ints[LOAD.node] + i], ints[ints[LOAD.following] + i] == 1
        point_at, force_at = ints[LOAD.point] + 3 * i, ints[LOAD.force] + 3 * i
        moment_at = ints[LOAD.moment] + 3 * i
        for r in range(3):
            arm[r], force[r], moment[r] = 0.0, 0.0, 0.0
            for c in range(3):
                arm[r] += R[node, r, c] * floats[point_at + c]
                force[r] += R[node, r, c] * floats[force_at + c]
                moment[r] += R[node, r, c] * floats[moment_at + c]
            if not following:
                force[r], moment[r] = floats[force_at + r], floats[moment_at + r]
        for r in range(3):
            k, l = (r + 1) % 3, (r + 2) % 3
            total_moment = moment[r] + arm[k] * force[l] - arm[l] * force[k]
            for q in range(motions):
                Q[q] -= W[node, q, r] * force[r] + W[node, q, 3 + r] * total_moment
    for i in range(ints[ROWS]):
        residual[:] = 0.0
        residual[closing + i] = -1.0
        mu[i] = math.nan
        if least_squares(J, residual, rate, scratch) > MIN_PIVOT:
            s, rotations = 0.0, True
            for q in range(motions):
                s -= Q[q] * rate[q]
            for t in range(ints[ints[TERM.first] + i], ints[ints[TERM.first] + i + 1]):
                rotations = rotations and ints[ints[TERM.kind] + t] != TRANSLATION
            # rows of rotations only were multiplied by the length scale, so their multipliers are divided by it
            mu[i] = s * length_scale if rotations else s
