"""The intended motion nearest to the pose of every joint, compiled."""

from __future__ import annotations

import math

import numpy as np

from ksd.joints.joint_arrays import FIRST_MOTION, JOINT_COUNT, JOINT_LENGTH
from ksd.joints.joint_poses import joint_poses
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_log

CONVERGED_STEP = 1e-9
"""Correction of an intended motion (rad, or stroke over joint length) below which it has converged."""
MAX_STEP = 0.3
"""Largest correction of an intended motion in one iteration, same unit."""
MAX_ITERATIONS = 40


@kernel
def intended_motions(joint_ints, geometry, relative, theta, pose, series, residual, converged):
    """Fit the intended motions theta of all joints to their poses, in place (Gauss-Newton).

    joint_ints, geometry: as in `ksd.joints.joint_arrays`. relative (J, 12): displacement d and rotation (row-major)
    of interface B in the axes of A. theta is fitted to the rotation of B where the motion turns it, else to its
    displacement. residual (J, 6): displacement and rotation vector of B from its intended pose. converged (J,): 1 where
    the corrections converged, 0 where theta is meaningless. pose (J, 24): as of `joint_poses`; series (3, M):
    scratch.
    """
    difference, v, A, b, step = np.empty((3, 3)), np.empty(3), np.empty((2, 2)), np.empty(2), np.empty(2)
    converged[:] = 0
    for _ in range(MAX_ITERATIONS):
        joint_poses(joint_ints, geometry, theta, pose, series)
        unconverged = 0
        for j in range(joint_ints[JOINT_COUNT]):
            if converged[j] == 1:
                continue
            unconverged += 1
            for r in range(3):
                p, q, s = relative[j, 3 + 3 * r], relative[j, 4 + 3 * r], relative[j, 5 + 3 * r]
                for c in range(3):
                    difference[r, c] = p * pose[j, 3 * c] + q * pose[j, 3 * c + 1] + s * pose[j, 3 * c + 2]
            rotation_log(difference, v)
            for r in range(3):
                residual[j, r] = relative[j, r] - pose[j, 9 + r]
                residual[j, 3 + r] = v[r]
            first = joint_ints[joint_ints[FIRST_MOTION] + j]
            motions = joint_ints[joint_ints[FIRST_MOTION] + j + 1] - first
            rotation, translation = 0.0, 0.0
            for k in range(motions):
                for r in range(3):
                    translation = max(translation, abs(pose[j, 12 + 6 * k + r]))
                    rotation = max(rotation, abs(pose[j, 15 + 6 * k + r]))
            # the slight rotation of a translating stage does not measure its stroke
            o = 3 if rotation * geometry[joint_ints[JOINT_LENGTH] + j] > 0.1 * translation else 0
            for k in range(motions):
                b[k] = 0.0
                for r in range(3):
                    b[k] += pose[j, 12 + 6 * k + o + r] * residual[j, o + r]
                for l in range(motions):
                    A[k, l] = 0.0
                    for r in range(3):
                        A[k, l] += pose[j, 12 + 6 * k + o + r] * pose[j, 12 + 6 * l + o + r]
            if motions == 1:
                det, scale_of_det = A[0, 0], A[0, 0]
                step[0] = b[0] / det if det > 0.0 else math.nan
            else:
                det, scale_of_det = A[0, 0] * A[1, 1] - A[0, 1] * A[1, 0], A[0, 0] * A[1, 1]
                step[0] = (A[1, 1] * b[0] - A[0, 1] * b[1]) / det if det > 1e-8 * scale_of_det else math.nan
                step[1] = (A[0, 0] * b[1] - A[1, 0] * b[0]) / det if det > 1e-8 * scale_of_det else math.nan
            largest = 0.0
            for k in range(motions):
                largest = max(largest, abs(step[k])) if step[k] == step[k] else math.inf
            if not largest < math.inf:
                continue
            scale = MAX_STEP / largest if largest > MAX_STEP else 1.0
            for k in range(motions):
                theta[first + k] += scale * step[k]
            if largest < CONVERGED_STEP:
                converged[j] = 1
                unconverged -= 1
                # update the residual for this last correction to first order
                for k in range(motions):
                    for r in range(3):
                        residual[j, r] -= step[k] * pose[j, 12 + 6 * k + r]
                        residual[j, 3 + r] -= step[k] * pose[j, 15 + 6 * k + r]
        if unconverged == 0:
            break
