"""What is read from a state, compiled: the intended motion nearest to every joint, and the drive forces of step 1."""

from __future__ import annotations

import math

import numpy as np

from ksd.bodies.joint_arrays import CLOSINGS, FIRST, JOINT_LENGTH, JOINTS, MONOMIALS
from ksd.bodies.joint_poses import joint_poses
from ksd.bodies.kinematics import least_squares, least_squares_scratch, loop_equations
from ksd.model.arrays import (
    LOAD_FOLLOWING,
    LOAD_FORCE,
    LOAD_MOMENT,
    LOAD_NODE,
    LOAD_POINT,
    LOADS,
    ROWS,
    TERM_FIRST,
    TERM_KIND,
    TRANSLATION,
)
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log

MATCHES = 1e-9
"""Last correction of an intended motion (rad, or stroke over joint length) at which it counts as found."""


@kernel
def intended_motions(loops, shapes, relative, theta, place, series, off, found):
    """Split the relative poses of all joints into intended motion theta and the rest, in place (Gauss-Newton).

    loops, shapes: as in `ksd.bodies.joint_arrays`. relative (J, 12): d and rotation (row-major) of B in the axes of A. theta
    is matched to the rotation of B where the motion turns it, else to its displacement; a correction is limited to 0.3. off
    (J, 6): displacement and rotation vector of B off its intended pose. found (J,): 1 where the corrections died out, 0
    where theta means nothing. series (3, M): scratch.
    """
    rel, v, A, b, step = np.empty((3, 3)), np.empty(3), np.empty((2, 2)), np.empty(2), np.empty(2)
    found[:] = 0
    for _ in range(40):
        joint_poses(loops, shapes, theta, place, series)
        missing = 0
        for j in range(loops[JOINTS]):
            if found[j] == 1:
                continue
            missing += 1
            for r in range(3):
                p, q, s = relative[j, 3 + 3 * r], relative[j, 4 + 3 * r], relative[j, 5 + 3 * r]
                for c in range(3):
                    rel[r, c] = p * place[j, 3 * c] + q * place[j, 3 * c + 1] + s * place[j, 3 * c + 2]
            rotation_log(rel, v)
            for r in range(3):
                off[j, r] = relative[j, r] - place[j, 9 + r]
                off[j, 3 + r] = v[r]
            first = loops[loops[FIRST] + j]
            motions = loops[loops[FIRST] + j + 1] - first
            spin, slide = 0.0, 0.0
            for k in range(motions):
                for r in range(3):
                    slide = max(slide, abs(place[j, 12 + 6 * k + r]))
                    spin = max(spin, abs(place[j, 15 + 6 * k + r]))
            # the slight rotation of a stage that translates must not be what its stroke is read from
            o = 3 if spin * shapes[loops[JOINT_LENGTH] + j] > 0.1 * slide else 0
            for k in range(motions):
                b[k] = 0.0
                for r in range(3):
                    b[k] += place[j, 12 + 6 * k + o + r] * off[j, o + r]
                for l in range(motions):
                    A[k, l] = 0.0
                    for r in range(3):
                        A[k, l] += place[j, 12 + 6 * k + o + r] * place[j, 12 + 6 * l + o + r]
            if motions == 1:
                det, size = A[0, 0], A[0, 0]
                step[0] = b[0] / det if det > 0.0 else math.nan
            else:
                det, size = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0], A[0, 0] * A[1, 1]
                step[0] = (A[1, 1] * b[0] - A[0, 1] * b[1]) / det if det > 1e-8 * size else math.nan
                step[1] = (A[0, 0] * b[1] - A[1, 0] * b[0]) / det if det > 1e-8 * size else math.nan
            largest = 0.0
            for k in range(motions):
                largest = max(largest, abs(step[k])) if step[k] == step[k] else math.inf
            if not largest < math.inf:
                continue
            scale = 0.3 / largest if largest > 0.3 else 1.0
            for k in range(motions):
                theta[first + k] += scale * step[k]
            if largest < MATCHES:
                found[j] = 1
                missing -= 1
                # so small a correction is followed by `off` to first order
                for k in range(motions):
                    for r in range(3):
                        off[j, r] -= step[k] * place[j, 12 + 6 * k + r]
                        off[j, 3 + r] -= step[k] * place[j, 15 + 6 * k + r]
        if missing == 0:
            break


@kernel
def drive_forces(ints, floats, loops, shapes, theta, target, x, R, place, wrench, mu):
    """mu (c,): multipliers of drives and supports in step 1 by virtual work, the links left where theta puts them.

    ints, floats: of the reduced mechanism, as in `ksd.model.arrays.FlatArrays`; x, R: of its links. wrench (.., 54 per
    joint): condensed joints, F at 12. With Q the joints' moments in pure intended motion minus the loads' work, mu_i = -Q .
    J^+ e_i: what theta does per unit of row i while the loops stay closed.
    """
    closing, motions, links = 6 * loops[CLOSINGS], len(theta), len(x)
    rows, size = closing + ints[ROWS], floats[0]
    W, J, series = np.zeros((links, motions, 6)), np.zeros((rows, motions)), np.empty((3, loops[MONOMIALS]))
    residual, Q, rate = np.zeros(rows), np.zeros(motions), np.zeros(motions)
    reach, room = np.empty((2, links), np.int64), least_squares_scratch(rows, motions)
    frames, slope = np.empty((4, 4, 3)), np.empty((8, 3))
    joint_poses(loops, shapes, theta, place, series)
    loop_equations(ints, floats, loops, shapes, target, x, R, place, reach, W, J, residual, frames, slope)
    for j in range(loops[JOINTS]):
        first = loops[loops[FIRST] + j]
        for q in range(first, loops[loops[FIRST] + j + 1]):
            at = 12 + 6 * (q - first)
            for r in range(6):
                Q[q] += wrench[54 * j + 12 + r] * place[j, at + r]
    arm, force, moment = np.empty(3), np.empty(3), np.empty(3)
    for i in range(ints[LOADS]):
        node, following = ints[ints[LOAD_NODE] + i], ints[ints[LOAD_FOLLOWING] + i] == 1
        point, own, twist = ints[LOAD_POINT] + 3 * i, ints[LOAD_FORCE] + 3 * i, ints[LOAD_MOMENT] + 3 * i
        for r in range(3):
            arm[r], force[r], moment[r] = 0.0, 0.0, 0.0
            for c in range(3):
                arm[r] += R[node, r, c] * floats[point + c]
                force[r] += R[node, r, c] * floats[own + c]
                moment[r] += R[node, r, c] * floats[twist + c]
            if not following:
                force[r], moment[r] = floats[own + r], floats[twist + r]
        for r in range(3):
            k, l = (r + 1) % 3, (r + 2) % 3
            turning = moment[r] + arm[k] * force[l] - arm[l] * force[k]
            for q in range(motions):
                Q[q] -= W[node, q, r] * force[r] + W[node, q, 3 + r] * turning
    for i in range(ints[ROWS]):
        residual[:] = 0.0
        residual[closing + i] = -1.0
        mu[i] = math.nan
        if least_squares(J, residual, rate, room) > 1e-13:
            s, rotations = 0.0, True
            for q in range(motions):
                s -= Q[q] * rate[q]
            for t in range(ints[ints[TERM_FIRST] + i], ints[ints[TERM_FIRST] + i + 1]):
                rotations = rotations and ints[ints[TERM_KIND] + t] != TRANSLATION
            # rows made of rotations alone were multiplied by the size, so their multipliers come out divided by it
            mu[i] = s * size if rotations else s
