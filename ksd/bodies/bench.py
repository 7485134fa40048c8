"""Steps 2 and 4 of the KSD method, compiled: near configuration, condensation to the interfaces, recovery.

The bench holds every joint of a mechanism apart from its links: interface A sits on ground at the origin, interface
B is a node, internal blocks are nodes. One assembly and one partial factorisation condense all joints at once, in
the axes of their interface A (paper 1, eqs. 2.3-2.6 and section 3); one backward sweep recovers their insides.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ksd.bodies.series import monomials, pose_from
from ksd.model.poses import member_pose
from ksd.model.system import assemble, take_step
from ksd.numerics.blocks import backward_blocks, factor_blocks, forward_blocks
from ksd.numerics.kernel import kernel
from ksd.numerics.local import local_matrix, local_vector
from ksd.numerics.rotations import rotation_log


class Inside(NamedTuple):
    """Database functions of the insides of J joints, flattened; polynomials in the motions of their joint.

    block_node (K,): bench node of every internal block; block_joint (K,); block_pose (K, 6, M): rotation vector and
    chord by monomial. joint (F,), target (F,), coefficient (F, M): entry `target` of the inner states (amplitudes
    1/m, wrenches N and Nm). near_joint, near_target, near_coefficient: the same for work.near (rotation vectors).
    """

    block_node: np.ndarray
    block_joint: np.ndarray
    block_pose: np.ndarray
    joint: np.ndarray
    target: np.ndarray
    coefficient: np.ndarray
    near_joint: np.ndarray
    near_target: np.ndarray
    near_coefficient: np.ndarray


@kernel
def set_near(bench, loops, inside, theta, place, motion, work):
    """Step 2, first half: bench state of the intended motion theta, from the database functions alone.

    place (J, 24): interface poses of step 1. Node 1 + .. of the bench: see `Inside`; node `last J` are the Bs.
    """
    J, size = len(loops.node), loops.pose.shape[2]
    values, slope, counts = np.empty((J, size)), np.empty((2, size)), np.empty(J, np.int64)
    # apart from what owns these, so that nothing in it counts users (`ksd.numerics.borrowed`)
    _set_near(bench, loops, inside, theta, place, motion, work, values, slope, counts)


@kernel
def _set_near(bench, loops, inside, theta, place, motion, work, values, slope, counts):
    J, nodes = len(loops.node), len(bench.start)
    for j in range(J):
        counts[j] = monomials(loops, theta, j, values[j], slope)
        B = nodes - J + j
        for r in range(3):
            motion.x[B, r] = place[j, 9 + r]
            for c in range(3):
                motion.R[B, r, c] = place[j, 3 * r + c]
    put = local_vector(24)
    slope[:] = 0.0
    # no derivatives wanted; a variable, since a literal 0 would compile `pose_from` a second time
    motions = 0 * J
    for k in range(len(inside.block_node)):
        j = inside.block_joint[k]
        pose_from(inside.block_pose[k], loops.length[j], values[j], slope, counts[j], motions, put)
        for r in range(3):
            motion.x[inside.block_node[k], r] = put[9 + r]
            for c in range(3):
                motion.R[inside.block_node[k], r, c] = put[3 * r + c]
    for f in range(len(inside.joint)):
        j = inside.joint[f]
        s = 0.0
        for i in range(counts[j]):
            s += inside.coefficient[f, i] * values[j, i]
        motion.inner[inside.target[f]] = s
    for f in range(len(inside.near_joint)):
        j = inside.near_joint[f]
        s = 0.0
        for i in range(counts[j]):
            s += inside.near_coefficient[f, i] * values[j, i]
        work.near[inside.near_target[f]] = s


@kernel
def condense_joints(bench, joints, motion, work, near, reduced_inner):
    """Linearise all joints at `motion` and condense them; writes the linear bodies (d0, R0, F, K) of step 3.

    near: see `add_members`. Returns (negative pivots inside, smallest relative pivot, status).
    """
    none = work.rhs[:0]
    _, _, inside, status = assemble(bench, motion, none, 1.0, work, 1e-8, near, 10.0)
    stop = len(bench.plan.size) - joints
    negatives, pivot = factor_blocks(bench.plan, work.value, work.spare, stop)
    forward_blocks(bench.plan, work.spare, work.rhs, stop)
    nodes = len(bench.start)
    for j in range(joints):
        B = nodes - joints + j
        u = bench.start[B]
        at = bench.plan.diagonal[stop + j]
        o = 54 * j
        for r in range(3):
            reduced_inner[o + r] = motion.x[B, r]
            for c in range(3):
                reduced_inner[o + 3 + 3 * r + c] = motion.R[B, r, c]
        for r in range(6):
            reduced_inner[o + 12 + r] = work.rhs[u + r]
            for c in range(6):
                # the lower triangle is the one a factorisation reads
                reduced_inner[o + 18 + 6 * r + c] = work.value[at + 6 * max(r, c) + min(r, c)]
    return negatives + inside, pivot, status


@kernel
def relative_poses(members, joints, x, R, relative):
    """relative (J, 12): position d and rotation (row-major) of interface B in the axes of interface A."""
    pose, Q = local_vector(18), local_matrix(3, 3)
    for j in range(joints):
        member_pose(members, x, R, j, pose, Q)
        for r in range(3):
            relative[j, r] = pose[r] * pose[15] + pose[3 + r] * pose[16] + pose[6 + r] * pose[17]
            for c in range(3):
                relative[j, 3 + 3 * r + c] = Q[r, c]


@kernel
def recover_joints(bench, reduced, joints, reduced_motion, motion, work, relative):
    """Step 4: bench state at the interface poses of step 3, by the factors of `condense_joints`; relative (J, 12): those.

    Returns the largest unintended displacement of an interface B from its reference, (m, rad).
    """
    relative_poses(reduced.members, joints, reduced_motion.x, reduced_motion.R, relative)
    stop = len(bench.plan.size) - joints
    turned, v = local_matrix(3, 3), local_vector(3)
    nodes = len(bench.start)
    shift, twist = 0.0, 0.0
    for i in range(bench.plan.start[stop]):
        work.rhs[i] = -work.rhs[i]
    for j in range(joints):
        B = nodes - joints + j
        u = bench.start[B]
        for r in range(3):
            for c in range(3):
                turned[r, c] = (
                    relative[j, 3 + 3 * r] * motion.R[B, c, 0]
                    + relative[j, 4 + 3 * r] * motion.R[B, c, 1]
                    + relative[j, 5 + 3 * r] * motion.R[B, c, 2]
                )
        rotation_log(turned, v)
        for r in range(3):
            work.rhs[u + r] = relative[j, r] - motion.x[B, r]
            work.rhs[u + 3 + r] = v[r]
            shift = max(shift, abs(work.rhs[u + r]))
            twist = max(twist, abs(v[r]))
    backward_blocks(bench.plan, work.value, work.spare, work.rhs, stop)
    take_step(bench, motion, work.rhs, work, 1.0)
    return shift, twist


@kernel
def place_insides(loops, block_joint, block_node, full_node, motion, full):
    """Internal blocks of the bench (A axes) into the full model's nodes (global), links already in place.

    A block's frame is identity at rest in both, so R_full = R_a F R_bench F^T with F the joint axes at rest.
    """
    RA, T = local_matrix(3, 3), local_matrix(3, 3)
    for k in range(len(block_node)):
        j, b, f = block_joint[k], block_node[k], full_node[k]
        a = loops.node[j, 0]
        F = loops.frame[j]
        for r in range(3):
            for c in range(3):
                RA[r, c] = full.R[a, r, 0] * F[0, c] + full.R[a, r, 1] * F[1, c] + full.R[a, r, 2] * F[2, c]
        for r in range(3):
            s = full.x[a, r]
            for c in range(3):
                s += full.R[a, r, c] * loops.anchor[j, 0, c] + RA[r, c] * motion.x[b, c]
                T[r, c] = (
                    RA[r, 0] * motion.R[b, 0, c] + RA[r, 1] * motion.R[b, 1, c] + RA[r, 2] * motion.R[b, 2, c]
                )
            full.x[f, r] = s
        for r in range(3):
            for c in range(3):
                full.R[f, r, c] = T[r, 0] * F[c, 0] + T[r, 1] * F[c, 1] + T[r, 2] * F[c, 2]
