"""Poses of interface B of all joints, and their derivatives, from the database polynomials of their motions; compiled."""

from __future__ import annotations

import math

import numpy as np

from ksd.joints.joint_arrays import (
    FIRST_MOTION,
    JOINT_COUNT,
    JOINT_LENGTH,
    MONOMIAL_COUNT,
    POSE,
    POWER,
    POWER_FIRST,
)
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import exp_tangent, rotation_exp


@kernel(inline="late")
def monomials(joint_ints, theta, j, series):
    """Write the monomials of joint j and their derivatives by its one or two motions into series (3, M); return their
    number."""
    begin = joint_ints[joint_ints[POWER_FIRST] + j]
    # for a joint with one motion a = b, and the exponents of b are zero
    a, b = (
        theta[joint_ints[joint_ints[FIRST_MOTION] + j]],
        theta[joint_ints[joint_ints[FIRST_MOTION] + j + 1] - 1],
    )
    count, powers = joint_ints[joint_ints[POWER_FIRST] + j + 1] - begin, joint_ints[POWER] + 2 * begin
    # sorted by exponents p of a, then q of b; one = a^p, one_below = a^(p-1), two = b^q, two_below = b^(q-1)
    p, one, one_below = 0, 1.0, 0.0
    q, two, two_below = 0, 1.0, 0.0
    for i in range(count):
        if joint_ints[powers + 2 * i] > p:
            q, two, two_below = 0, 1.0, 0.0
        while p < joint_ints[powers + 2 * i]:
            p, one, one_below = p + 1, one * a, one
        while q < joint_ints[powers + 2 * i + 1]:
            q, two, two_below = q + 1, two * b, two
        series[0, i] = one * two
        series[1, i] = p * one_below * two
        series[2, i] = q * one * two_below
    return count


@kernel(inline="late")
def _set_planar_pose(f, length, motions, pose, j):
    """`_set_spatial_pose` for a motion in the x-y plane of the joint, ten times as fast; False where the motion leaves
    it."""
    flat = True
    for k in range(1 + motions):
        flat = flat and f[k, 0] == 0.0 and f[k, 1] == 0.0 and f[k, 5] == 0.0
    if not flat:
        return False
    for r in range(12 + 6 * motions):
        pose[j, r] = 0.0
    c, s = math.cos(f[0, 2]), math.sin(f[0, 2])
    pose[j, 0], pose[j, 1], pose[j, 3], pose[j, 4], pose[j, 8] = c, -s, s, c, 1.0
    c, s = length * math.cos(0.5 * f[0, 2]), length * math.sin(0.5 * f[0, 2])
    x, y = c * f[0, 3] - s * f[0, 4], s * f[0, 3] + c * f[0, 4]
    pose[j, 9], pose[j, 10] = x, y
    for k in range(motions):
        at, w = 12 + 6 * k, 0.5 * f[1 + k, 2]
        pose[j, at] = c * f[1 + k, 3] - s * f[1 + k, 4] - w * y
        pose[j, at + 1] = s * f[1 + k, 3] + c * f[1 + k, 4] + w * x
        pose[j, at + 5] = f[1 + k, 2]
    return True


@kernel
def _set_spatial_pose(f, length, motions, pose, j):
    """Write pose[j] of `pose_from_polynomials`; f (3, 6): rotation vector and chord, and their derivatives by the
    motions."""
    R, H, T, S = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    half, spin = np.empty(3), np.empty(3)
    for r in range(3):
        half[r] = 0.5 * f[0, r]
    rotation_exp(f[0], R)
    rotation_exp(half, H)
    exp_tangent(f[0], T)
    exp_tangent(half, S)
    for r in range(3):
        pose[j, 9 + r] = length * (H[r, 0] * f[0, 3] + H[r, 1] * f[0, 4] + H[r, 2] * f[0, 5])
        for c in range(3):
            pose[j, 3 * r + c] = R[r, c]
    for k in range(motions):
        at = 12 + 6 * k
        for r in range(3):
            spin[r] = 0.5 * (S[r, 0] * f[1 + k, 0] + S[r, 1] * f[1 + k, 1] + S[r, 2] * f[1 + k, 2])
            pose[j, at + 3 + r] = T[r, 0] * f[1 + k, 0] + T[r, 1] * f[1 + k, 1] + T[r, 2] * f[1 + k, 2]
        for r in range(3):
            i, l = (r + 1) % 3, (r + 2) % 3
            pose[j, at + r] = (
                length * (H[r, 0] * f[1 + k, 3] + H[r, 1] * f[1 + k, 4] + H[r, 2] * f[1 + k, 5])
                + spin[i] * pose[j, 9 + l] - spin[l] * pose[j, 9 + i]
            )  # fmt: skip


@kernel(inline="late")
def pose_from_polynomials(coefficients, at, size, length, series, count, motions, f, pose, j):
    """Write pose[j] (24,) of a joint or block from the polynomials of its rotation vector omega and chord c.

    coefficients: those of the six polynomials stand from `at` on, as (6, size); series (3, M): the first `count`
    monomials and their derivatives by up to two motions; length L [m]; f (3, 6): scratch.

    pose[j, 0:9]: rotation exp(omega), row-major; pose[j, 9:12]: displacement d = L exp(omega/2) c [m]; then for every
    motion the derivative of d (3,) and the spatial spin (3,).
    """
    # scalar sums: a sum in an array waits for its store at every term
    for r in range(6):
        total, first, second = 0.0, 0.0, 0.0
        for i in range(count):
            c = coefficients[at + size * r + i]
            total += c * series[0, i]
            first += c * series[1, i]
            second += c * series[2, i]
        f[0, r], f[1, r], f[2, r] = total, first, second
    if not _set_planar_pose(f, length, motions, pose, j):
        _set_spatial_pose(f, length, motions, pose, j)


@kernel
def joint_poses(joint_ints, geometry, theta, pose, series):
    """Write pose (J, 24) of all joints at the motions theta, in the axes of their interface A, see
    `pose_from_polynomials`.

    series (3, M): scratch.
    """
    size, f = joint_ints[MONOMIAL_COUNT], np.empty((3, 6))
    for j in range(joint_ints[JOINT_COUNT]):
        count, length = monomials(joint_ints, theta, j, series), geometry[joint_ints[JOINT_LENGTH] + j]
        motions = joint_ints[joint_ints[FIRST_MOTION] + j + 1] - joint_ints[joint_ints[FIRST_MOTION] + j]
        pose_from_polynomials(
            geometry, joint_ints[POSE] + 6 * size * j, size, length, series, count, motions, f, pose, j
        )
