"""Steps 2 and 4 of the KSD method, compiled: near configuration, condensation to the interfaces, recovery.

The substructures are the joints of a mechanism apart from its links: interface A sits on ground at the origin, interface
B is a node, internal blocks are nodes. One assembly and one partial factorisation condense all joints at once, in
the axes of their interface A (paper 1, eqs. 2.3-2.6 and section 3); one backward sweep recovers their insides.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ksd.bodies.kinematics import Loops
from ksd.bodies.series import monomials, pose_from
from ksd.model.arrays import Arrays, Motion, Work
from ksd.model.newton import GRAIN, assemble, take_step
from ksd.model.poses import member_pose
from ksd.numerics.blocks import BLOCKS, DIAGONAL, START, backward_blocks, factor_blocks, forward_blocks
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log


class Inside(NamedTuple):
    """Database functions of the insides of J joints, flattened; polynomials in the motions of their joint.

    block_node (K,), block_joint (K,): substructure node and joint of every internal block; block_pose (K, 6, M): rotation
    vector and chord by monomial. joint (F,), target (F,), coefficient (F, M): entry `target` of the inner states (amplitudes
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


def set_near(
    substructures: Arrays,
    loops: Loops,
    inside: Inside,
    theta: np.ndarray,
    place: np.ndarray,
    motion: Motion,
    work: Work,
) -> None:
    """Step 2, first half: state of the substructures of the intended motion theta, from the database functions alone.

    place (J, 24): interface poses of step 1. Node 1 + .. of the substructures: see `Inside`; node `last J` are the Bs.
    """
    _set_near(loops, inside, theta, place, motion.x, motion.R, motion.inner, work.near)


@kernel
def _set_near(loops, inside, theta, place, x, R, inner, near):
    J, nodes, size = len(loops.node), len(x), loops.pose.shape[2]
    values, slope, counts = np.empty((J, size)), np.empty((2, size)), np.empty(J, np.int64)
    for j in range(J):
        counts[j] = monomials(loops, theta, j, values[j], slope)
        B = nodes - J + j
        for r in range(3):
            x[B, r] = place[j, 9 + r]
            for c in range(3):
                R[B, r, c] = place[j, 3 * r + c]
    put = np.empty(24)
    slope[:, :] = 0.0
    # no derivatives wanted; a variable, since a literal 0 would compile `pose_from` a second time
    motions = 0 * J
    for k in range(len(inside.block_node)):
        j = inside.block_joint[k]
        pose_from(inside.block_pose[k], loops.length[j], values[j], slope, counts[j], motions, put)
        for r in range(3):
            x[inside.block_node[k], r] = put[9 + r]
            for c in range(3):
                R[inside.block_node[k], r, c] = put[3 * r + c]
    for f in range(len(inside.joint)):
        j = inside.joint[f]
        s = 0.0
        for i in range(counts[j]):
            s += inside.coefficient[f, i] * values[j, i]
        inner[inside.target[f]] = s
    for f in range(len(inside.near_joint)):
        j = inside.near_joint[f]
        s = 0.0
        for i in range(counts[j]):
            s += inside.near_coefficient[f, i] * values[j, i]
        near[inside.near_target[f]] = s


def condense_joints(
    substructures: Arrays, joints: int, motion: Motion, work: Work, near: int, reduced_inner: np.ndarray
) -> tuple[int, float, int]:
    """Linearise all joints at `motion` and condense them; writes the linear bodies (d0, R0, F, K) of step 3.

    near: see `ksd.model.newton.assemble`. Returns (negative pivots inside, smallest relative pivot, status).
    """
    _, _, inside, status = assemble(substructures, motion, np.zeros(0), 1.0, work, 1e-8, near, GRAIN)
    negatives, pivot = _condense_blocks(
        substructures.plan.ints,
        substructures.start,
        joints,
        motion.x,
        motion.R,
        work.value,
        work.spare,
        work.rhs,
        reduced_inner,
    )
    return negatives + inside, pivot, status


@kernel
def _condense_blocks(plan, start, joints, x, R, value, spare, rhs, inner):
    stop, nodes = plan[BLOCKS] - joints, len(start)
    negatives, pivot = factor_blocks(plan, value, spare, stop)
    forward_blocks(plan, spare, rhs, stop)
    for j in range(joints):
        B, at, o = nodes - joints + j, plan[plan[DIAGONAL] + stop + j], 54 * j
        u = start[B]
        for r in range(3):
            inner[o + r] = x[B, r]
            for c in range(3):
                inner[o + 3 + 3 * r + c] = R[B, r, c]
        for r in range(6):
            inner[o + 12 + r] = rhs[u + r]
            for c in range(6):
                # the lower triangle is the one a factorisation reads
                inner[o + 18 + 6 * r + c] = value[at + 6 * max(r, c) + min(r, c)]
    return negatives, pivot


@kernel
def relative_poses(node, offset, frame, joints, x, R, relative):
    """Of the first members, with node, offset, frame as in `Members`: relative (J, 12), position d and rotation (row-major)
    of interface B in the axes of interface A."""
    nodes, offsets, frames = node.reshape(-1), offset.reshape(-1), frame.reshape(-1)
    pose, Q = np.empty(18), np.empty((3, 3))
    for j in range(joints):
        member_pose(nodes, 2 * j, offsets, 6 * j, frames, 18 * j, x, R, pose, Q)
        for r in range(3):
            relative[j, r] = pose[r] * pose[15] + pose[3 + r] * pose[16] + pose[6 + r] * pose[17]
            for c in range(3):
                relative[j, 3 + 3 * r + c] = Q[r, c]


def recover_joints(
    substructures: Arrays,
    reduced: Arrays,
    joints: int,
    reduced_motion: Motion,
    motion: Motion,
    work: Work,
    relative: np.ndarray,
) -> tuple[float, float]:
    """Step 4: substructures at the interface poses of step 3, relative (J, 12), by the factors of `condense_joints`.

    Returns the largest unintended displacement of an interface B from its reference, (m, rad).
    """
    m = reduced.members
    relative_poses(m.node, m.offset, m.frame, joints, reduced_motion.x, reduced_motion.R, relative)
    shift, twist = _recover_blocks(
        substructures.plan.ints,
        substructures.start,
        joints,
        relative,
        motion.x,
        motion.R,
        work.value,
        work.spare,
        work.rhs,
    )
    take_step(substructures, motion, work.rhs, work, 1.0)
    return shift, twist


@kernel
def _recover_blocks(plan, start, joints, relative, x, R, value, spare, rhs):
    stop = plan[BLOCKS] - joints
    turned, v = np.empty((3, 3)), np.empty(3)
    nodes = len(start)
    shift, twist = 0.0, 0.0
    for i in range(plan[plan[START] + stop]):
        rhs[i] = -rhs[i]
    for j in range(joints):
        B = nodes - joints + j
        u = start[B]
        for r in range(3):
            for c in range(3):
                turned[r, c] = (
                    relative[j, 3 + 3 * r] * R[B, c, 0]
                    + relative[j, 4 + 3 * r] * R[B, c, 1]
                    + relative[j, 5 + 3 * r] * R[B, c, 2]
                )
        rotation_log(turned, v)
        for r in range(3):
            rhs[u + r] = relative[j, r] - x[B, r]
            rhs[u + 3 + r] = v[r]
            shift = max(shift, abs(rhs[u + r]))
            twist = max(twist, abs(v[r]))
    backward_blocks(plan, value, spare, rhs, stop)
    return shift, twist


@kernel
def place_insides(node, anchor, frame, block_joint, block_node, full_node, own_x, own_R, x, R):
    """Internal blocks of the substructures (A axes) into the full model's nodes (global), links already in place.

    A block's frame is identity at rest in both, so R_full = R_a F R_own F^T with F the joint axes at rest.
    """
    RA, T = np.empty((3, 3)), np.empty((3, 3))
    for k in range(len(block_node)):
        j, b, f = block_joint[k], block_node[k], full_node[k]
        a = node[j, 0]
        F = frame[j]
        for r in range(3):
            for c in range(3):
                RA[r, c] = R[a, r, 0] * F[0, c] + R[a, r, 1] * F[1, c] + R[a, r, 2] * F[2, c]
        for r in range(3):
            s = x[a, r]
            for c in range(3):
                s += R[a, r, c] * anchor[j, 0, c] + RA[r, c] * own_x[b, c]
                T[r, c] = RA[r, 0] * own_R[b, 0, c] + RA[r, 1] * own_R[b, 1, c] + RA[r, 2] * own_R[b, 2, c]
            x[f, r] = s
        for r in range(3):
            for c in range(3):
                R[f, r, c] = T[r, 0] * F[c, 0] + T[r, 1] * F[c, 1] + T[r, 2] * F[c, 2]
