"""Steps 2 and 4 of the KSD method, compiled: near configuration, condensation to the interfaces, recovery.

The substructures are the joints of a mechanism apart from its links: interface A sits on ground at the origin, interface
B is a node, internal blocks are nodes. One assembly and one partial factorisation condense all joints at once, in
the axes of their interface A (paper 1, eqs. 2.3-2.6 and section 3); one backward sweep recovers their insides.
"""

from __future__ import annotations

import numpy as np

from ksd.bodies.joint_arrays import (
    AXES,
    BLOCK_JOINT,
    BLOCK_NODE,
    BLOCK_POSE,
    COEFFICIENT,
    FUNCTIONS,
    INNER_BLOCKS,
    JOINT_LENGTH,
    JOINTS,
    MONOMIALS,
    NEAR_COEFFICIENT,
    NEAR_FUNCTIONS,
    NEAR_OWNER,
    NEAR_TARGET,
    OWNER,
    TARGET,
    InteriorFunctions,
    JointKinematics,
)
from ksd.bodies.joint_poses import monomials, pose_from_polynomials
from ksd.bodies.kinematics import interface_pose
from ksd.model.arrays import Arrays, State, Workspace
from ksd.model.newton import ROUNDING_MULTIPLE, assemble
from ksd.numerics.blocks import BLOCKS, DIAGONAL, START, backward_blocks, factor_blocks, forward_blocks
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log


def set_near_configuration(
    loops: JointKinematics,
    inside: InteriorFunctions,
    theta: np.ndarray,
    place: np.ndarray,
    motion: State,
    work: Workspace,
) -> None:
    """Step 2, first half: state of the substructures of the intended motion theta, from the database functions alone.

    place (J, 24): interface poses of step 1. Node 1 + .. of the substructures: see `InteriorFunctions`; the last J
    nodes are the interfaces B.
    """
    _set_near(*loops.flat, *inside.flat, theta, place, motion.x, motion.R, motion.inner, work.linearisation)


@kernel(inline="late")
def _put(place, j, x, R, node):
    """A node where a joint or block is."""
    for r in range(3):
        x[node, r] = place[j, 9 + r]
        for c in range(3):
            R[node, r, c] = place[j, 3 * r + c]


@kernel(inline="late")
def _functions(inside, functions, owner, target, coefficient, count, series, counts, found):
    """Values of `count` functions into found, whose owner, target and coefficient begin at these places."""
    size = series.shape[2]
    for f in range(count):
        j, s = inside[owner + f], 0.0
        for i in range(counts[j]):
            s += functions[coefficient + size * f + i] * series[j, 0, i]
        found[inside[target + f]] = s


@kernel
def _set_near(loops, shapes, inside, functions, theta, place, x, R, inner, near):
    joints, size = loops[JOINTS], loops[MONOMIALS]
    series, counts = np.empty((joints, 3, size)), np.empty(joints, np.int64)
    put, f = np.empty((1, 24)), np.empty((3, 6))
    for j in range(joints):
        counts[j] = monomials(loops, theta, j, series[j])
        _put(place, j, x, R, len(x) - joints + j)
    # no derivatives wanted; a variable, since a literal 0 would compile `pose_from_polynomials` a second time
    first = 0 * joints
    for k in range(inside[INNER_BLOCKS]):
        j = inside[inside[BLOCK_JOINT] + k]
        at, length = inside[BLOCK_POSE] + 6 * size * k, shapes[loops[JOINT_LENGTH] + j]
        pose_from_polynomials(functions, at, size, length, series[j], counts[j], first, f, put, first)
        _put(put, first, x, R, inside[inside[BLOCK_NODE] + k])
    _functions(
        inside, functions, inside[OWNER], inside[TARGET], inside[COEFFICIENT], inside[FUNCTIONS], series, counts, inner
    )  # fmt: skip
    _functions(
        inside, functions, inside[NEAR_OWNER], inside[NEAR_TARGET], inside[NEAR_COEFFICIENT], inside[NEAR_FUNCTIONS],
        series, counts, near,
    )  # fmt: skip


def condense_joints(
    substructures: Arrays, joints: int, motion: State, work: Workspace, near: int, reduced_inner: np.ndarray
) -> int:
    """Linearise all joints at `motion` and condense them; writes the linear bodies (d0, R0, F, K) of step 3.

    near: see `ksd.model.newton.assemble`. Returns the worst status of a leaf.
    """
    *_, status = assemble(substructures, motion, np.zeros(0), 1.0, work, 1e-8, near, ROUNDING_MULTIPLE)
    condense_assembled(substructures, joints, motion, work, reduced_inner)
    return status


def condense_assembled(
    substructures: Arrays, joints: int, motion: State, work: Workspace, reduced_inner: np.ndarray
) -> None:
    """The second half of `condense_joints`."""
    _condense_blocks(
        substructures.plan.ints, substructures.start, joints, motion.x, motion.R, work.matrix, work.scaled_rows, work.rhs,
        reduced_inner,
    )  # fmt: skip


@kernel
def _condense_blocks(plan, start, joints, x, R, value, spare, rhs, inner):
    stop, nodes = plan[BLOCKS] - joints, len(start)
    factor_blocks(plan, value, spare, stop)
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


@kernel
def relative_poses(loops, shapes, x, R, relative):
    """relative (J, 12): position d and rotation (row-major) of interface B of every joint in the axes of interface A, the
    links at x, R."""
    frames = np.empty((2, 4, 3))
    for j in range(loops[JOINTS]):
        for end in range(2):
            interface_pose(loops, shapes, j, end, x, R, frames, end)
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
    loops: JointKinematics,
    reduced_motion: State,
    motion: State,
    work: Workspace,
    relative: np.ndarray,
) -> tuple[float, float]:
    """Step 4: what leads the substructures to the interface poses of step 3, relative (J, 12), by the factors of
    `condense_joints`, into work.rhs, to be taken.

    Returns the largest unintended displacement of an interface B from its reference, (m, rad).
    """
    found: tuple[float, float] = _recover_blocks(
        *loops.flat, substructures.plan.ints, substructures.start, reduced_motion.x, reduced_motion.R, relative, motion.x,
        motion.R, work.matrix, work.scaled_rows, work.rhs,
    )  # fmt: skip
    return found


@kernel
def _recover_blocks(loops, shapes, plan, start, link_x, link_R, relative, x, R, value, spare, rhs):
    relative_poses(loops, shapes, link_x, link_R, relative)
    joints = loops[JOINTS]
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
def place_internal_blocks(loops, shapes, inside, full_node, own_x, own_R, x, R):
    """Internal blocks of the substructures (A axes) into the full model's nodes (global), links already in place.

    A block's frame is identity at rest in both, so R_full = R_a F R_own F^T with F the joint axes at rest.
    """
    frames, T = np.empty((1, 4, 3)), np.empty((3, 3))
    # no literal, for which numba would compile `interface_pose` once more
    first = 0 * loops[JOINTS]
    for k in range(len(full_node)):
        j, b, f = inside[inside[BLOCK_JOINT] + k], inside[inside[BLOCK_NODE] + k], full_node[k]
        F = loops[AXES] + 9 * j
        interface_pose(loops, shapes, j, first, x, R, frames, first)
        for r in range(3):
            p, q, s = frames[0, r, 0], frames[0, r, 1], frames[0, r, 2]
            x[f, r] = frames[0, 3, r] + p * own_x[b, 0] + q * own_x[b, 1] + s * own_x[b, 2]
            for c in range(3):
                T[r, c] = p * own_R[b, 0, c] + q * own_R[b, 1, c] + s * own_R[b, 2, c]
        for r in range(3):
            p, q, s = T[r, 0], T[r, 1], T[r, 2]
            for c in range(3):
                R[f, r, c] = p * shapes[F + 3 * c] + q * shapes[F + 3 * c + 1] + s * shapes[F + 3 * c + 2]
