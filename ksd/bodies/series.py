"""Poses of interface B of all joints, with derivatives, from the database polynomials of their motions, compiled."""

from __future__ import annotations

import math

import numpy as np

from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import exp_tangent, rotation_exp

POWERS = 24
"""Powers of a motion that are made by repeated multiplication; ``a ** p`` takes ten times as long."""


@kernel
def _power(powers, a, p):
    """a ** p by the first powers of a."""
    return powers[p] if p < POWERS else a**p


@kernel
def monomials(loops, theta, j, value, slope):
    """value (M,) and slope (2, M): the monomials of joint j and their derivatives; returns how many."""
    first = loops.first[j]
    a = theta[first]
    b = theta[first + 1] if loops.first[j + 1] - first > 1 else 0.0
    at = loops.power_first[j]
    count = loops.power_first[j + 1] - at
    A, B = np.empty(POWERS), np.empty(POWERS)
    A[0], B[0] = 1.0, 1.0
    for k in range(POWERS - 1):
        A[k + 1], B[k + 1] = A[k] * a, B[k] * b
    for i in range(count):
        p, q = loops.power[at + i, 0], loops.power[at + i, 1]
        one, two = _power(A, a, p), _power(B, b, q)
        value[i] = one * two
        slope[0, i] = p * _power(A, a, p - 1) * two if p > 0 else 0.0
        slope[1, i] = q * one * _power(B, b, q - 1) if q > 0 else 0.0
    return count


@kernel
def _in_plane(f, g, length, motions, place):
    """`pose_from` for a motion in the x-y plane of the joint, ten times as fast; False where its slopes leave it."""
    for k in range(motions):
        if not (g[k, 0] == 0.0 and g[k, 1] == 0.0 and g[k, 5] == 0.0):
            return False
    c, s = math.cos(f[2]), math.sin(f[2])
    place[0], place[1], place[2], place[3], place[4], place[5] = c, -s, 0.0, s, c, 0.0
    place[6], place[7], place[8] = 0.0, 0.0, 1.0
    c, s = length * math.cos(0.5 * f[2]), length * math.sin(0.5 * f[2])
    x, y = c * f[3] - s * f[4], s * f[3] + c * f[4]
    place[9], place[10], place[11] = x, y, 0.0
    for k in range(motions):
        at, w = 12 + 6 * k, 0.5 * g[k, 2]
        place[at] = c * g[k, 3] - s * g[k, 4] - w * y
        place[at + 1] = s * g[k, 3] + c * g[k, 4] + w * x
        place[at + 2], place[at + 3], place[at + 4], place[at + 5] = 0.0, 0.0, 0.0, g[k, 2]
    return True


@kernel
def pose_from(coefficient, length, value, slope, count, motions, place):
    """Pose and its derivatives from rotation-vector and chord polynomials, coefficient (6, M).

    place[0:9] rotation exp(omega), place[9:12] d = L exp(omega/2) c, then per motion (dd, dphi), six each.
    """
    f, g = np.empty(6), np.empty((2, 6))
    for r in range(6):
        f[r], g[0, r], g[1, r] = 0.0, 0.0, 0.0
        for i in range(count):
            f[r] += coefficient[r, i] * value[i]
            g[0, r] += coefficient[r, i] * slope[0, i]
            g[1, r] += coefficient[r, i] * slope[1, i]
    if f[0] == 0.0 and f[1] == 0.0 and f[5] == 0.0 and _in_plane(f, g, length, motions, place):
        return
    R, H, T, S = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    half, spin = np.empty(3), np.empty(3)
    for r in range(3):
        half[r] = 0.5 * f[r]
    rotation_exp(f, R)
    rotation_exp(half, H)
    exp_tangent(f, T)
    exp_tangent(half, S)
    for r in range(3):
        place[9 + r] = length * (H[r, 0] * f[3] + H[r, 1] * f[4] + H[r, 2] * f[5])
        for c in range(3):
            place[3 * r + c] = R[r, c]
    for k in range(motions):
        at = 12 + 6 * k
        for r in range(3):
            spin[r] = 0.5 * (S[r, 0] * g[k, 0] + S[r, 1] * g[k, 1] + S[r, 2] * g[k, 2])
            place[at + 3 + r] = T[r, 0] * g[k, 0] + T[r, 1] * g[k, 1] + T[r, 2] * g[k, 2]
        for r in range(3):
            i, j = (r + 1) % 3, (r + 2) % 3
            place[at + r] = (
                length * (H[r, 0] * g[k, 3] + H[r, 1] * g[k, 4] + H[r, 2] * g[k, 5])
                + spin[i] * place[9 + j] - spin[j] * place[9 + i]
            )  # fmt: skip


@kernel
def joint_places(loops, theta, place, series):
    """place (J, 24): pose of interface B of every joint and its derivatives, in the axes of interface A; series (3, M):
    scratch."""
    value, slope = series[0], series[1:]
    for j in range(len(loops.node)):
        count = monomials(loops, theta, j, value, slope)
        pose_from(
            loops.pose[j], loops.length[j], value, slope, count, loops.first[j + 1] - loops.first[j], place[j]
        )
