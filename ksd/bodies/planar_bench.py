"""Steps 2 and 4 of the KSD method in a plane, compiled: the planar twin of `ksd.bodies.bench`."""

from __future__ import annotations

import math

from ksd.bodies.planar_kinematics import PLACE, planar_place
from ksd.model.planar_assembly import TURN, planar_pose, recover_planar
from ksd.model.planar_flat import PLANAR_LINEAR
from ksd.model.planar_system import assemble_planar, move_planar
from ksd.numerics.blocks import backward_blocks, factor_blocks, forward_blocks
from ksd.numerics.copies import copy_numbers, copy_rows
from ksd.numerics.kernel import kernel
from ksd.numerics.local import local_vector


@kernel
def set_planar_near(bench, loops, inside, value, slope, place, motion, work):
    """Bench state and near angles of the intended motions whose monomials are value (J, M); place (J, 9) of the Bs."""
    J, nodes = len(loops.node), len(bench.start)
    pose, inner, near = motion.pose, motion.inner, work.near
    for j in range(J):
        B = nodes - J + j
        pose[B, 0], pose[B, 1], pose[B, 2] = place[j, 1], place[j, 2], place[j, 0]
    if len(inside.block_node) > 0:
        put = local_vector(PLACE)
        # no derivatives wanted; a variable, since a literal 0 would compile `planar_place` a second time
        motions = 0 * J
        for k in range(len(inside.block_node)):
            j, b = inside.block_joint[k], inside.block_node[k]
            count = loops.power_first[j + 1] - loops.power_first[j]
            planar_place(inside.block_pose[k], loops.length[j], value[j], slope, count, motions, put)
            pose[b, 0], pose[b, 1], pose[b, 2] = put[1], put[2], put[0]
    for f in range(len(inside.joint)):
        j, s = inside.joint[f], 0.0
        for i in range(loops.power_first[j + 1] - loops.power_first[j]):
            s += inside.coefficient[f, i] * value[j, i]
        inner[inside.target[f]] = s
    for f in range(len(inside.near_joint)):
        j, s = inside.near_joint[f], 0.0
        for i in range(loops.power_first[j + 1] - loops.power_first[j]):
            s += inside.near_coefficient[f, i] * value[j, i]
        near[inside.near_target[f]] = s


@kernel
def condense_planar(bench, joints, motion, work, near, reduced_inner):
    """Linearise all joints at `motion` and condense them to their interfaces; see `ksd.bodies.bench.condense_joints`."""
    none = work.rhs[:0]
    _, inside, status = assemble_planar(bench, motion, none, 1.0, work, 1e-8, 10.0, near)
    plan, value, rhs = bench.plan, work.value, work.rhs
    stop = len(plan.size) - joints
    negatives, pivot = factor_blocks(plan, value, work.spare, stop)
    forward_blocks(plan, work.spare, rhs, stop)
    nodes = len(bench.start)
    for j in range(joints):
        B = nodes - joints + j
        u, at, o = bench.start[B], plan.diagonal[stop + j], PLANAR_LINEAR * j
        for r in range(3):
            reduced_inner[o + r] = motion.pose[B, r]
            reduced_inner[o + 3 + r] = rhs[u + r]
            for c in range(3):
                # the lower triangle is the one a factorisation reads
                reduced_inner[o + 6 + 3 * r + c] = value[at + 3 * max(r, c) + min(r, c)]
    return negatives + inside, pivot, status


@kernel
def planar_relative(members, joints, pose, turns, relative):
    """relative (J, 3): pose of interface B in the axes of interface A; pose (k, 3) of the links; turns: scratch."""
    for k in range(len(pose)):
        turns[2 * k], turns[2 * k + 1] = math.cos(pose[k, 2]), math.sin(pose[k, 2])
    put = local_vector(6)
    for j in range(joints):
        planar_pose(members.node[j], members.offset[j], members.frame[j], pose, turns, put, relative[j])


@kernel
def recover_planar_joints(bench, reduced, joints, pose, turns, motion, work, relative):
    """Step 4: bench state at the interface poses of step 3, by the factors of `condense_planar`.

    pose (k, 3) of the links; relative (J, 3) is filled. Returns the largest unintended displacement [m] and angle.
    """
    planar_relative(reduced.members, joints, pose, turns, relative)
    rhs = work.rhs
    stop, nodes = len(bench.plan.size) - joints, len(bench.start)
    shift, twist = 0.0, 0.0
    for i in range(bench.plan.start[stop]):
        rhs[i] = -rhs[i]
    for j in range(joints):
        B = nodes - joints + j
        u = bench.start[B]
        for r in range(3):
            rhs[u + r] = relative[j, r] - motion.pose[B, r]
        rhs[u + 2] -= TURN * round(rhs[u + 2] / TURN)
        shift, twist = max(shift, abs(rhs[u]), abs(rhs[u + 1])), max(twist, abs(rhs[u + 2]))
    backward_blocks(bench.plan, work.value, work.spare, rhs, stop)
    recover_planar(bench.members, bench.start, motion, rhs, work, 1.0)
    move_planar(bench.start, bench.terms.start, motion, rhs, 1.0)
    return shift, twist


@kernel
def place_planar(loops, inside, full_node, bench, reduced, full):
    """Everything into the planar full state: links, internal blocks, inner states, multipliers."""
    joints, inner = len(loops.node), len(bench.inner)
    pose = full.pose
    first = 0 * inner
    copy_rows(pose, reduced.pose)
    copy_numbers(full.inner, first, bench.inner, first)
    copy_numbers(full.inner, inner, reduced.inner, PLANAR_LINEAR * joints)
    copy_numbers(full.multiplier, first, reduced.multiplier, first)
    for k in range(len(full_node)):
        j, b, f = inside.block_joint[k], inside.block_node[k], full_node[k]
        a = loops.node[j, 0]
        c, s = math.cos(pose[a, 2]), math.sin(pose[a, 2])
        x, y = loops.anchor[j, 0, 0], loops.anchor[j, 0, 1]
        pose[f, 0], pose[f, 1] = pose[a, 0] + c * x - s * y, pose[a, 1] + s * x + c * y
        turned = pose[a, 2] + loops.frame[j]
        c, s = math.cos(turned), math.sin(turned)
        x, y = bench.pose[b, 0], bench.pose[b, 1]
        pose[f, 0] += c * x - s * y
        pose[f, 1] += s * x + c * y
        pose[f, 2] = pose[a, 2] + bench.pose[b, 2]
