"""Steps 2 and 4 of the KSD method, compiled: near configuration, condensation to the interfaces, recovery.

The substructures are the joints without the links between them: interface A is fixed to ground at the origin, interface
B and the internal blocks are nodes. One assembly and one partial factorisation condense all joints together, in the
axes of their interface A (paper 1, eqs. 2.3-2.6 and section 3); one backward substitution recovers their internal
states.
"""

from __future__ import annotations

import numpy as np

from ksd.elements.linear import LINEAR_INNER
from ksd.joints.joint_arrays import (
    BLOCK_JOINT,
    BLOCK_NODE,
    BLOCK_POSE,
    FUNCTION_COEFFICIENT,
    FUNCTION_COUNT,
    FUNCTION_JOINT,
    FUNCTION_TARGET,
    INNER_BLOCK_COUNT,
    JOINT_AXES,
    JOINT_COUNT,
    JOINT_LENGTH,
    JOINT_NODE,
    MONOMIAL_COUNT,
    NEAR_COEFFICIENT,
    NEAR_FUNCTION_COUNT,
    NEAR_JOINT,
    NEAR_TARGET,
    JointKinematics,
)
from ksd.joints.joint_poses import monomials, pose_from_polynomials
from ksd.joints.kinematics import interface_pose
from ksd.model.arrays import Arrays, State, Workspace
from ksd.numerics.blocks import BLOCKS, DIAGONAL, START, backward_blocks, factor_blocks, forward_blocks
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log


@kernel(inline="late")
def _place_node(pose, j, x, R, node):
    """Set the pose of a node to pose[j]."""
    for r in range(3):
        x[node, r] = pose[j, 9 + r]
        for c in range(3):
            R[node, r, c] = pose[j, 3 * r + c]


@kernel(inline="late")
def _evaluate_functions(
    interior_ints, interior_floats, owner, target, coefficient, count, series, counts, values
):
    """Write the values of `count` functions; owner, target, coefficient: where these fields begin."""
    size = series.shape[2]
    for f in range(count):
        j, s = interior_ints[owner + f], 0.0
        for i in range(counts[j]):
            s += interior_floats[coefficient + size * f + i] * series[j, 0, i]
        values[interior_ints[target + f]] = s


@kernel
def set_near_configuration(
    joint_ints, geometry, interior_ints, interior_floats, theta, pose, x, R, inner, near
):  # fmt: skip
    """Step 2, first half: set the near configuration, the state of the substructures at pure intended motion theta.

    It follows from the database functions only. pose (J, 24): poses of step 1; x, R, inner: of the substructures, whose
    nodes are the internal blocks as in `InteriorFunctions` and last the J interfaces B; near:
    `ksd.model.arrays.Workspace.linearisation`.
    """
    joints, size = joint_ints[JOINT_COUNT], joint_ints[MONOMIAL_COUNT]
    series, counts = np.empty((joints, 3, size)), np.empty(joints, np.int64)
    block_pose, f = np.empty((1, 24)), np.empty((3, 6))
    for j in range(joints):
        counts[j] = monomials(joint_ints, theta, j, series[j])
        _place_node(pose, j, x, R, len(x) - joints + j)
    # no derivatives needed; an expression, since a literal 0 would compile `pose_from_polynomials` a second time
    first = 0 * joints
    for k in range(interior_ints[INNER_BLOCK_COUNT]):
        j = interior_ints[interior_ints[BLOCK_JOINT] + k]
        at, length = interior_ints[BLOCK_POSE] + 6 * size * k, geometry[joint_ints[JOINT_LENGTH] + j]
        pose_from_polynomials(
            interior_floats, at, size, length, series[j], counts[j], first, f, block_pose, first
        )
        _place_node(block_pose, first, x, R, interior_ints[interior_ints[BLOCK_NODE] + k])
    _evaluate_functions(
        interior_ints, interior_floats, interior_ints[FUNCTION_JOINT], interior_ints[FUNCTION_TARGET],
        interior_ints[FUNCTION_COEFFICIENT], interior_ints[FUNCTION_COUNT], series, counts, inner,
    )  # fmt: skip
    _evaluate_functions(
        interior_ints, interior_floats, interior_ints[NEAR_JOINT], interior_ints[NEAR_TARGET],
        interior_ints[NEAR_COEFFICIENT], interior_ints[NEAR_FUNCTION_COUNT], series, counts, near,
    )  # fmt: skip


def condense_joints(
    substructures: Arrays, joints: int, motion: State, work: Workspace, reduced_inner: np.ndarray
) -> None:
    """Condense all joints, as assembled in `work` at `motion`; write the linear bodies (d0, R0, F, K) of step 3 into
    reduced_inner."""
    _condense_blocks(
        substructures.plan.ints, substructures.start, joints, motion.x, motion.R, work.matrix, work.scaled_rows, work.rhs,
        reduced_inner,
    )  # fmt: skip


@kernel
def _condense_blocks(plan, start, joints, x, R, value, spare, rhs, inner):
    """`condense_joints` from the assembled matrix `value` and residual `rhs`; both are overwritten, spare: factors."""
    stop, nodes = plan[BLOCKS] - joints, len(start)
    factor_blocks(plan, value, spare, stop)
    forward_blocks(plan, spare, rhs, stop)
    for j in range(joints):
        B, at, o = nodes - joints + j, plan[plan[DIAGONAL] + stop + j], LINEAR_INNER * j
        u = start[B]
        for r in range(3):
            inner[o + r] = x[B, r]
            for c in range(3):
                inner[o + 3 + 3 * r + c] = R[B, r, c]
        for r in range(6):
            inner[o + 12 + r] = rhs[u + r]
            for c in range(6):
                # only the lower triangle is stored
                inner[o + 18 + 6 * r + c] = value[at + 6 * max(r, c) + min(r, c)]


@kernel
def relative_poses(joint_ints, geometry, x, R, relative):
    """Write relative (J, 12): position d and rotation (row-major) of interface B of every joint in the axes of
    interface A.

    x, R: poses of the links.
    """
    frames = np.empty((2, 4, 3))
    for j in range(joint_ints[JOINT_COUNT]):
        for end in range(2):
            interface_pose(joint_ints, geometry, j, end, x, R, frames, end)
        d0, d1, d2 = (
            frames[1, 3, 0] - frames[0, 3, 0],
            frames[1, 3, 1] - frames[0, 3, 1],
            frames[1, 3, 2] - frames[0, 3, 2],
        )
        for r in range(3):
            p, q, s = frames[0, 0, r], frames[0, 1, r], frames[0, 2, r]
            relative[j, r] = p * d0 + q * d1 + s * d2
            for c in range(3):
                relative[j, 3 + 3 * r + c] = p * frames[1, 0, c] + q * frames[1, 1, c] + s * frames[1, 2, c]


def interface_step(
    substructures: Arrays,
    kinematics: JointKinematics,
    reduced_motion: State,
    motion: State,
    work: Workspace,
    relative: np.ndarray,
) -> tuple[float, float]:
    """Step 4: write the step of the substructures to the interface poses of step 3 into work.rhs; it is not applied.

    relative (J, 12): receives these poses. Uses the factors of `condense_joints`. Returns the largest displacement [m]
    and rotation [rad] of an interface B from its linearisation point.
    """
    largest: tuple[float, float] = _recover_blocks(
        *kinematics.flat, substructures.plan.ints, substructures.start, reduced_motion.x, reduced_motion.R, relative,
        motion.x, motion.R, work.matrix, work.scaled_rows, work.rhs,
    )  # fmt: skip
    return largest


@kernel
def _recover_blocks(joint_ints, geometry, plan, start, link_x, link_R, relative, x, R, value, spare, rhs):
    """Kernel of `interface_step`: writes the step of the substructures into rhs."""
    relative_poses(joint_ints, geometry, link_x, link_R, relative)
    joints = joint_ints[JOINT_COUNT]
    stop = plan[BLOCKS] - joints
    rotation, v = np.empty((3, 3)), np.empty(3)
    nodes = len(start)
    largest_shift, largest_rotation = 0.0, 0.0
    for i in range(plan[plan[START] + stop]):
        rhs[i] = -rhs[i]
    for j in range(joints):
        B = nodes - joints + j
        u = start[B]
        for r in range(3):
            for c in range(3):
                rotation[r, c] = (
                    relative[j, 3 + 3 * r] * R[B, c, 0]
                    + relative[j, 4 + 3 * r] * R[B, c, 1]
                    + relative[j, 5 + 3 * r] * R[B, c, 2]
                )
        rotation_log(rotation, v)
        for r in range(3):
            rhs[u + r] = relative[j, r] - x[B, r]
            rhs[u + 3 + r] = v[r]
            largest_shift = max(largest_shift, abs(rhs[u + r]))
            largest_rotation = max(largest_rotation, abs(v[r]))
    backward_blocks(plan, value, spare, rhs, stop)
    return largest_shift, largest_rotation


@kernel
def place_internal_blocks(joint_ints, geometry, interior_ints, full_node, block_x, block_R, x, R, rotations):
    """Write the poses of the internal blocks of the substructures (axes of interface A) into the nodes of the full
    model (global).

    full_node (K,): node of every block in the full model; block_x, block_R: poses in the substructures; x, R, and
    counted rotation vectors (`ksd.model.turns`): of the full model, with its links in place. Frames of blocks are
    identity at rest in both, so R_full = R_a F R_block F^T with F the joint axes at rest.
    """
    frames, T = np.empty((1, 4, 3)), np.empty((3, 3))
    # an expression, since numba would compile `interface_pose` once more for a literal
    first = 0 * joint_ints[JOINT_COUNT]
    for k in range(len(full_node)):
        j, b = interior_ints[interior_ints[BLOCK_JOINT] + k], interior_ints[interior_ints[BLOCK_NODE] + k]
        f = full_node[k]
        F = joint_ints[JOINT_AXES] + 9 * j
        interface_pose(joint_ints, geometry, j, first, x, R, frames, first)
        for r in range(3):
            p, q, s = frames[0, r, 0], frames[0, r, 1], frames[0, r, 2]
            x[f, r] = frames[0, 3, r] + p * block_x[b, 0] + q * block_x[b, 1] + s * block_x[b, 2]
            for c in range(3):
                T[r, c] = p * block_R[b, 0, c] + q * block_R[b, 1, c] + s * block_R[b, 2, c]
        link = joint_ints[joint_ints[JOINT_NODE] + 2 * j]
        for r in range(3):
            rotations[f, r] = rotations[link, r]
            p, q, s = T[r, 0], T[r, 1], T[r, 2]
            for c in range(3):
                R[f, r, c] = (
                    p * geometry[F + 3 * c] + q * geometry[F + 3 * c + 1] + s * geometry[F + 3 * c + 2]
                )


@kernel
def join_states(
    joint_ints, geometry, interior_ints, full_node, block_x, block_R, block_inner,
    link_x, link_R, link_inner, link_multiplier, link_angle, x, R, inner, multiplier, angle,
):  # fmt: skip
    """Write a state of the substructures (block_...) and one of links and condensed joints (link_...) into that of the full
    model; internal blocks as in `place_internal_blocks`, counted angles as in `ksd.model.turns.copy_angles`."""
    links, own = len(link_x), len(block_inner)
    x[:links], R[:links] = link_x, link_R
    inner[:own] = block_inner
    for i in range(LINEAR_INNER * joint_ints[JOINT_COUNT], len(link_inner)):
        inner[own] = link_inner[i]
        own += 1
    multiplier[:] = link_multiplier
    relative, rotations = len(angle) - 3 * len(x), len(link_angle) - 3 * links
    angle[:relative] = link_angle[:relative]
    angle[relative : relative + 3 * links] = link_angle[rotations:]
    place_internal_blocks(
        joint_ints,
        geometry,
        interior_ints,
        full_node,
        block_x,
        block_R,
        x,
        R,
        angle[relative:].reshape(-1, 3),
    )
