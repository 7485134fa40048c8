"""The geometrically exact rod, integrated from end p: reference for all leaf models, independent of their
discretisation.

In the frame of end p, with R the axes of the section, n and m the force and moment of the part beyond on the part
before, g gravity and mu the line mass: r' = R (e1 + C R^T n), R' = R [k]x with k = k0 + (R^T m) / (GJ, EIy, EIz), m' =
n x r', n' = -mu g - q - p w R e2, with line load q, pressure p and width w. Orientations are unit quaternions.

Source: Reissner's rod as in the note of the strain-mode leaf; Cooper and Verner, SIAM J. Numer. Anal. 9 (1972): order 8
by 11 stages at the 5 Lobatto points of a step.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log

_R = math.sqrt(21.0)  # of the coefficients of Cooper and Verner
NODES = np.array([0.0, 0.5 - _R / 14.0, 0.5, 0.5 + _R / 14.0, 1.0])
"""Points of a step, as fractions of it, at which numbers of the rod are needed."""
WEIGHTS = np.array([9.0, 49.0, 64.0, 49.0, 9.0]) / 180.0
ROD, STATE, VARIATIONS, ROD_LOADS = 12, 13, 54, 10
"""Numbers of the rod at a point: k0 (3), 1/(GJ, EIy, EIz), 1/(EA, ky GA, kz GA), mu, fraction of the leaf, width; of its
state: r (3), quaternion w x y z, m (3), n (3); and of the derivatives of r, rotation and m by the wrench at end p (6, 9);
of its loads: gravity, line load at the start of the leaf and its change to the end (3 each), pressure."""
STAGES = 11
"""Stages of a Runge-Kutta step; below, the node of each, the weights of earlier slopes in its state, and the weights of all
slopes in the step."""
_STAGE_NODE = np.array([0, 2, 2, 3, 3, 2, 1, 1, 2, 3, 4])
_STAGE_WEIGHTS = np.zeros((STAGES, STAGES))
for _i, _row in enumerate(
    (
        (), (1 / 2,), (1 / 4, 1 / 4), (1 / 7, (-7 - 3 * _R) / 98, (21 + 5 * _R) / 49),
        ((11 + _R) / 84, 0, (18 + 4 * _R) / 63, (21 - _R) / 252),
        ((5 + _R) / 48, 0, (9 + _R) / 36, (-231 + 14 * _R) / 360, (63 - 7 * _R) / 80),
        ((10 - _R) / 42, 0, (-432 + 92 * _R) / 315, (633 - 145 * _R) / 90, (-504 + 115 * _R) / 70, (63 - 13 * _R) / 35),
        (1 / 14, 0, 0, 0, (14 - 3 * _R) / 126, (13 - 3 * _R) / 63, 1 / 9),
        (1 / 32, 0, 0, 0, (91 - 21 * _R) / 576, 11 / 72, (-385 - 75 * _R) / 1152, (63 + 13 * _R) / 128),
        (1 / 14, 0, 0, 0, 1 / 9, (-733 - 147 * _R) / 2205, (515 + 111 * _R) / 504, (-51 - 11 * _R) / 56,
         (132 + 28 * _R) / 245),
        (0, 0, 0, 0, (-42 + 7 * _R) / 18, (-18 + 28 * _R) / 45, (-273 - 53 * _R) / 72, (301 + 53 * _R) / 72,
         (28 - 28 * _R) / 45, (49 - 7 * _R) / 18),
    )
):  # fmt: skip
    _STAGE_WEIGHTS[_i, : len(_row)] = _row
_STEP_WEIGHTS = np.array([9.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 49.0, 64.0, 49.0, 9.0]) / 180.0


@kernel
def _slope(rod, loads, y, out):
    """Write out (STATE,): derivative of the state y by the length of the rod, whose numbers here are `rod` (ROD,)."""
    w, a, b, c = y[3], y[4], y[5], y[6]
    # rows of R
    x0, x1, x2 = 1.0 - 2.0 * (b * b + c * c), 2.0 * (a * b - c * w), 2.0 * (a * c + b * w)
    y0, y1, y2 = 2.0 * (a * b + c * w), 1.0 - 2.0 * (a * a + c * c), 2.0 * (b * c - a * w)
    z0, z1, z2 = 2.0 * (a * c - b * w), 2.0 * (b * c + a * w), 1.0 - 2.0 * (a * a + b * b)
    m0, m1, m2, n0, n1, n2 = y[7], y[8], y[9], y[10], y[11], y[12]
    e0 = 1.0 + rod[6] * (x0 * n0 + y0 * n1 + z0 * n2)
    e1 = rod[7] * (x1 * n0 + y1 * n1 + z1 * n2)
    e2 = rod[8] * (x2 * n0 + y2 * n1 + z2 * n2)
    v0, v1, v2 = x0 * e0 + x1 * e1 + x2 * e2, y0 * e0 + y1 * e1 + y2 * e2, z0 * e0 + z1 * e1 + z2 * e2
    k0 = 0.5 * (rod[0] + rod[3] * (x0 * m0 + y0 * m1 + z0 * m2))
    k1 = 0.5 * (rod[1] + rod[4] * (x1 * m0 + y1 * m1 + z1 * m2))
    k2 = 0.5 * (rod[2] + rod[5] * (x2 * m0 + y2 * m1 + z2 * m2))
    out[0], out[1], out[2] = v0, v1, v2
    out[3], out[4] = -a * k0 - b * k1 - c * k2, w * k0 + b * k2 - c * k1
    out[5], out[6] = w * k1 + c * k0 - a * k2, w * k2 + a * k1 - b * k0
    out[7], out[8], out[9] = n1 * v2 - n2 * v1, n2 * v0 - n0 * v2, n0 * v1 - n1 * v0
    p = rod[11] * loads[9]
    out[10] = -rod[9] * loads[0] - loads[3] - rod[10] * loads[6] - p * x1
    out[11] = -rod[9] * loads[1] - loads[4] - rod[10] * loads[7] - p * y1
    out[12] = -rod[9] * loads[2] - loads[5] - rod[10] * loads[8] - p * z1


@kernel
def _variation_slope(rod, y, X, out, R, S, A):
    """Write out (6, 9), flat: derivative by the length of X (6, 9), the derivatives of position, rotation (spatial) and
    moment of the state y, one row for each component of force and moment at end p.

    R, S, A (3, 3): scratch, the axes, R C R^T and R / (GJ, EIy, EIz) R^T.
    """
    _rotation(y, R)
    for i in range(3):
        for j in range(3):
            s, a = 0.0, 0.0
            for e in range(3):
                s += R[i, e] * rod[6 + e] * R[j, e]
                a += R[i, e] * rod[3 + e] * R[j, e]
            S[i, j], A[i, j] = s, a
    m0, m1, m2, n0, n1, n2 = y[7], y[8], y[9], y[10], y[11], y[12]
    v0 = R[0, 0] + S[0, 0] * n0 + S[0, 1] * n1 + S[0, 2] * n2
    v1 = R[1, 0] + S[1, 0] * n0 + S[1, 1] * n1 + S[1, 2] * n2
    v2 = R[2, 0] + S[2, 0] * n0 + S[2, 1] * n1 + S[2, 2] * n2
    for c in range(6):
        f0, f1, f2 = 1.0 if c == 0 else 0.0, 1.0 if c == 1 else 0.0, 1.0 if c == 2 else 0.0
        p0, p1, p2 = X[9 * c + 3], X[9 * c + 4], X[9 * c + 5]
        # change of force and moment relative to the rotated section
        a0, a1, a2 = f0 + n1 * p2 - n2 * p1, f1 + n2 * p0 - n0 * p2, f2 + n0 * p1 - n1 * p0
        b0 = X[9 * c + 6] + m1 * p2 - m2 * p1
        b1 = X[9 * c + 7] + m2 * p0 - m0 * p2
        b2 = X[9 * c + 8] + m0 * p1 - m1 * p0
        r0 = p1 * v2 - p2 * v1 + S[0, 0] * a0 + S[0, 1] * a1 + S[0, 2] * a2
        r1 = p2 * v0 - p0 * v2 + S[1, 0] * a0 + S[1, 1] * a1 + S[1, 2] * a2
        r2 = p0 * v1 - p1 * v0 + S[2, 0] * a0 + S[2, 1] * a1 + S[2, 2] * a2
        out[9 * c], out[9 * c + 1], out[9 * c + 2] = r0, r1, r2
        for i in range(3):
            out[9 * c + 3 + i] = A[i, 0] * b0 + A[i, 1] * b1 + A[i, 2] * b2
        out[9 * c + 6] = f1 * v2 - f2 * v1 + n1 * r2 - n2 * r1
        out[9 * c + 7] = f2 * v0 - f0 * v2 + n2 * r0 - n0 * r2
        out[9 * c + 8] = f0 * v1 - f1 * v0 + n0 * r1 - n1 * r0


@kernel
def _rotation(y, R):
    """Write R (3, 3): axes of the state y."""
    w, a, b, c = y[3], y[4], y[5], y[6]
    R[0, 0], R[0, 1], R[0, 2] = 1.0 - 2.0 * (b * b + c * c), 2.0 * (a * b - c * w), 2.0 * (a * c + b * w)
    R[1, 0], R[1, 1], R[1, 2] = 2.0 * (a * b + c * w), 1.0 - 2.0 * (a * a + c * c), 2.0 * (b * c - a * w)
    R[2, 0], R[2, 1], R[2, 2] = 2.0 * (a * c - b * w), 2.0 * (b * c + a * w), 1.0 - 2.0 * (a * a + b * b)


@kernel
def _integrate(first, last, step, rod, loads, slope, at, y, R, S, A):
    """Integrate the state y from end p to end q, in place: STATE numbers of the rod, then their derivatives
    (VARIATIONS)."""
    size = len(y)
    for s in range(first, last):
        h = step[s]
        for stage in range(STAGES):
            for r in range(size):
                at[r] = y[r]
            for k in range(stage):
                weight = h * _STAGE_WEIGHTS[stage, k]
                if weight != 0.0:
                    for r in range(size):
                        at[r] += weight * slope[k, r]
            here = rod[s, _STAGE_NODE[stage]]
            _slope(here, loads, at, slope[stage])
            _variation_slope(here, at, at[STATE:], slope[stage, STATE:], R, S, A)
        for k in range(STAGES):
            weight = h * _STEP_WEIGHTS[k]
            if weight != 0.0:
                for r in range(size):
                    y[r] += weight * slope[k, r]
        length = math.sqrt(y[3] * y[3] + y[4] * y[4] + y[5] * y[5] + y[6] * y[6])
        for r in range(3, 7):
            y[r] /= length


class RodScratch(NamedTuple):
    """Storage for one rod at a time: slopes of the stages, state of a stage, state of the rod, and four (3, 3)."""

    slope: np.ndarray
    at: np.ndarray
    y: np.ndarray
    R: np.ndarray
    S: np.ndarray
    A: np.ndarray
    turn: np.ndarray


@kernel
def allocate_rod_scratch():
    """`RodScratch` for one rod."""
    size = STATE + VARIATIONS
    return RodScratch(
        np.empty((STAGES, size)), np.empty(size), np.empty(size), np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)),
        np.empty((3, 3)),
    )  # fmt: skip


@kernel
def integrate_rod(first, last, step, rod, loads, wrench, d, Q, gap, scratch):
    """Integrate a rod from wrench (6,) [N, Nm] at end p over the steps first to last.

    step (s,) [m]: lengths of the steps; rod (s, 5, ROD): its numbers at their `NODES`; loads (ROD_LOADS,) in frame p; d
    (3,), Q (3, 3): required pose of end q. Writes gap (6,): required pose relative to that reached [m, rad], inf where it is
    not finite, and scratch.y: the state of end q, then derivatives of its position, rotation (spatial) and moment by
    each component of the wrench (6, 9).
    """
    y, R = scratch.y, scratch.R
    y[:] = 0.0
    for r in range(3):
        y[7 + r], y[10 + r] = wrench[3 + r], wrench[r]
        y[STATE + 9 * (3 + r) + 6 + r] = 1.0
    y[3] = 1.0
    _integrate(first, last, step, rod, loads, scratch.slope, scratch.at, y, R, scratch.S, scratch.A)
    _rotation(y, R)
    for r in range(3):
        for c in range(3):
            scratch.turn[r, c] = Q[r, 0] * R[c, 0] + Q[r, 1] * R[c, 1] + Q[r, 2] * R[c, 2]
    rotation_log(scratch.turn, gap[3:])
    for r in range(3):
        gap[r] = d[r] - y[r]
    if not math.isfinite(gap[0] + gap[1] + gap[2] + gap[3] + gap[4] + gap[5]):
        gap[:] = math.inf


@kernel
def unloaded_rod_end(step, rod):
    """Position (3,) and axes (3, 3) of end q of an unloaded rod, see `integrate_rod`; frame p."""
    scratch, gap, none = allocate_rod_scratch(), np.empty(6), np.zeros(ROD_LOADS)
    position, axes = np.empty(3), np.eye(3)
    integrate_rod(0, len(step), step, rod, none, none[:6], none[:3], axes, gap, scratch)
    for r in range(3):
        position[r] = scratch.y[r]
    axes[:, :] = scratch.R
    return position, axes
