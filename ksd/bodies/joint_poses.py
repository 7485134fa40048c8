"""Poses of interface B of all joints, with derivatives, from the database polynomials of their motions, compiled."""

from __future__ import annotations

import math

import numpy as np

from ksd.bodies.joint_arrays import FIRST, JOINT_LENGTH, JOINTS, MONOMIALS, POSE, POWER, POWER_FIRST
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import exp_tangent, rotation_exp


@kernel(inline="late")
def monomials(loops, theta, j, series):
    """Monomials of joint j, and their derivatives by its one or two motions, into the rows of series (3, M); returns how
    many."""
    begin = loops[loops[POWER_FIRST] + j]
    # of a joint with one motion both are the same, and the exponents of the second zero
    a, b = theta[loops[loops[FIRST] + j]], theta[loops[loops[FIRST] + j + 1] - 1]
    count, powers = loops[loops[POWER_FIRST] + j + 1] - begin, loops[POWER] + 2 * begin
    # exponents p rise, and for equal p exponents q: powers one and two of a and b, and the ones below them
    p, one, one_below = 0, 1.0, 0.0
    q, two, two_below = 0, 1.0, 0.0
    for i in range(count):
        if loops[powers + 2 * i] > p:
            q, two, two_below = 0, 1.0, 0.0
        while p < loops[powers + 2 * i]:
            p, one, one_below = p + 1, one * a, one
        while q < loops[powers + 2 * i + 1]:
            q, two, two_below = q + 1, two * b, two
        series[0, i] = one * two
        series[1, i] = p * one_below * two
        series[2, i] = q * one * two_below
    return count


@kernel(inline="late")
def _in_plane(f, length, motions, place, j):
    """`_in_space` for a motion in the x-y plane of the joint, ten times as fast; False where it is none."""
    flat = True
    for k in range(1 + motions):
        flat = flat and f[k, 0] == 0.0 and f[k, 1] == 0.0 and f[k, 5] == 0.0
    if not flat:
        return False
    for r in range(12 + 6 * motions):
        place[j, r] = 0.0
    c, s = math.cos(f[0, 2]), math.sin(f[0, 2])
    place[j, 0], place[j, 1], place[j, 3], place[j, 4], place[j, 8] = c, -s, s, c, 1.0
    c, s = length * math.cos(0.5 * f[0, 2]), length * math.sin(0.5 * f[0, 2])
    x, y = c * f[0, 3] - s * f[0, 4], s * f[0, 3] + c * f[0, 4]
    place[j, 9], place[j, 10] = x, y
    for k in range(motions):
        at, w = 12 + 6 * k, 0.5 * f[1 + k, 2]
        place[j, at] = c * f[1 + k, 3] - s * f[1 + k, 4] - w * y
        place[j, at + 1] = s * f[1 + k, 3] + c * f[1 + k, 4] + w * x
        place[j, at + 5] = f[1 + k, 2]
    return True


@kernel
def _in_space(f, length, motions, place, j):
    """place[j] of `pose_from_polynomials`; f (3, 6): rotation vector and chord, and their derivatives."""
    R, H, T, S = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    half, spin = np.empty(3), np.empty(3)
    for r in range(3):
        half[r] = 0.5 * f[0, r]
    rotation_exp(f[0], R)
    rotation_exp(half, H)
    exp_tangent(f[0], T)
    exp_tangent(half, S)
    for r in range(3):
        place[j, 9 + r] = length * (H[r, 0] * f[0, 3] + H[r, 1] * f[0, 4] + H[r, 2] * f[0, 5])
        for c in range(3):
            place[j, 3 * r + c] = R[r, c]
    for k in range(motions):
        at = 12 + 6 * k
        for r in range(3):
            spin[r] = 0.5 * (S[r, 0] * f[1 + k, 0] + S[r, 1] * f[1 + k, 1] + S[r, 2] * f[1 + k, 2])
            place[j, at + 3 + r] = T[r, 0] * f[1 + k, 0] + T[r, 1] * f[1 + k, 1] + T[r, 2] * f[1 + k, 2]
        for r in range(3):
            i, l = (r + 1) % 3, (r + 2) % 3
            place[j, at + r] = (
                length * (H[r, 0] * f[1 + k, 3] + H[r, 1] * f[1 + k, 4] + H[r, 2] * f[1 + k, 5])
                + spin[i] * place[j, 9 + l] - spin[l] * place[j, 9 + i]
            )  # fmt: skip


@kernel(inline="late")
def pose_from_polynomials(shapes, at, size, length, series, count, motions, f, place, j):
    """Pose and its derivatives from rotation-vector and chord polynomials, (6, size) from shapes[at] on, and the `count`
    monomials and their derivatives in series, into place[j]; f (3, 6): scratch.

    place[j, 0:9] rotation exp(omega), place[j, 9:12] d = L exp(omega/2) c, then per motion (dd, dphi), six each.
    """
    # sums in numbers of their own: one in an array waits for its store at every term
    for r in range(6):
        total, first, second = 0.0, 0.0, 0.0
        for i in range(count):
            c = shapes[at + size * r + i]
            total += c * series[0, i]
            first += c * series[1, i]
            second += c * series[2, i]
        f[0, r], f[1, r], f[2, r] = total, first, second
    if not _in_plane(f, length, motions, place, j):
        _in_space(f, length, motions, place, j)


@kernel
def joint_poses(loops, shapes, theta, place, series):
    """place (J, 24): pose of interface B of every joint and its derivatives, in the axes of interface A; series (3, M):
    scratch."""
    size, f = loops[MONOMIALS], np.empty((3, 6))
    for j in range(loops[JOINTS]):
        count, length = monomials(loops, theta, j, series), shapes[loops[JOINT_LENGTH] + j]
        motions = loops[loops[FIRST] + j + 1] - loops[loops[FIRST] + j]
        pose_from_polynomials(
            shapes, loops[POSE] + 6 * size * j, size, length, series, count, motions, f, place, j
        )
