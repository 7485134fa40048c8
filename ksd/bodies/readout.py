"""What is read from a state, compiled: the intended motion nearest to every joint, and the drive forces of step 1."""

from __future__ import annotations

import math

import numpy as np

from ksd.bodies.kinematics import _axes_turned, least_squares, loop_equations, room_for
from ksd.bodies.series import joint_places
from ksd.model.arrays import TRANSLATION
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log

MATCHES = 1e-9
"""Last correction of an intended motion (rad, or stroke over joint length) at which it counts as found."""


@kernel
def intended_motions(loops, relative, theta, place, series, off, found):
    """Split the relative poses of all joints into intended motion theta and the rest, in place (Gauss-Newton).

    relative (J, 12): d and rotation (row-major) of B in the axes of A. theta is matched to the rotation of B where the
    motion turns it, else to its displacement; a correction is limited to 0.3. off (J, 6): displacement and rotation
    vector of B off its intended pose. found (J,): 1 where the corrections died out, 0 where theta means nothing. series
    (3, M): scratch.
    """
    rel, is_at, should = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3))
    v, A, b, step = np.empty(3), np.empty((2, 2)), np.empty(2), np.empty(2)
    J = len(loops.node)
    found[:] = 0
    for _ in range(40):
        joint_places(loops, theta, place, series)
        missing = 0
        for j in range(J):
            if found[j] == 1:
                continue
            missing += 1
            for r in range(3):
                for c in range(3):
                    is_at[r, c], should[r, c] = relative[j, 3 + 3 * r + c], place[j, 3 * r + c]
            _axes_turned(is_at, should, rel)
            rotation_log(rel, v)
            for r in range(3):
                off[j, r] = relative[j, r] - place[j, 9 + r]
                off[j, 3 + r] = v[r]
            motions = loops.first[j + 1] - loops.first[j]
            spin, slide = 0.0, 0.0
            for k in range(motions):
                for r in range(3):
                    slide = max(slide, abs(place[j, 12 + 6 * k + r]))
                    spin = max(spin, abs(place[j, 15 + 6 * k + r]))
            # the slight rotation of a stage that translates must not be what its stroke is read from
            o = 3 if spin * loops.length[j] > 0.1 * slide else 0
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
                theta[loops.first[j] + k] += scale * step[k]
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
def drive_forces(arrays, loops, theta, target, motion, place, wrench, mu):
    """mu (c,): multipliers of drives and supports in step 1 by virtual work, the links left where theta puts them.

    wrench (.., 54 per joint): condensed joints, F at 12. With Q the joints' moments in pure intended motion minus the
    loads' work, mu_i = -Q . J^+ e_i: what theta does per unit of row i while the loops stay closed.
    """
    closing, motions = 6 * len(loops.closing), len(theta)
    rows = closing + len(target)
    W = np.zeros((len(motion.x), motions, 6))
    J, residual, Q, rate = np.zeros((rows, motions)), np.zeros(rows), np.zeros(motions), np.zeros(motions)
    series, room = np.empty((3, loops.pose.shape[2])), room_for(rows, motions)
    reach = np.empty((2, len(motion.x)), np.int64)
    loop_equations(
        arrays.terms,
        arrays.size,
        loops,
        theta,
        target,
        motion.x,
        motion.R,
        place,
        series,
        reach,
        W,
        J,
        residual,
    )
    for j in range(len(loops.node)):
        for q in range(loops.first[j], loops.first[j + 1]):
            at = 12 + 6 * (q - loops.first[j])
            for r in range(6):
                Q[q] += wrench[54 * j + 12 + r] * place[j, at + r]
    loads = arrays.loads
    arm, force, moment = np.empty(3), np.empty(3), np.empty(3)
    for i in range(len(loads.node)):
        node = loads.node[i]
        for r in range(3):
            arm[r], force[r], moment[r] = 0.0, loads.force[i, r], loads.moment[i, r]
            for c in range(3):
                arm[r] += motion.R[node, r, c] * loads.point[i, c]
            if loads.following[i] == 1:
                force[r], moment[r] = 0.0, 0.0
                for c in range(3):
                    force[r] += motion.R[node, r, c] * loads.force[i, c]
                    moment[r] += motion.R[node, r, c] * loads.moment[i, c]
        for r in range(3):
            k, l = (r + 1) % 3, (r + 2) % 3
            turning = moment[r] + arm[k] * force[l] - arm[l] * force[k]
            for q in range(motions):
                Q[q] -= W[node, q, r] * force[r] + W[node, q, 3 + r] * turning
    for i in range(len(target)):
        residual[:] = 0.0
        residual[closing + i] = -1.0
        mu[i] = math.nan
        if least_squares(J, residual, rate, room) > 1e-13:
            s = 0.0
            for q in range(motions):
                s -= Q[q] * rate[q]
            rotations = 0
            for t in range(arrays.terms.first[i], arrays.terms.first[i + 1]):
                if arrays.terms.kind[t] != TRANSLATION:
                    rotations += 1
            # rows made of rotations alone were multiplied by the size, so their multipliers come out divided by it
            mu[i] = s * arrays.size if rotations == arrays.terms.first[i + 1] - arrays.terms.first[i] else s
