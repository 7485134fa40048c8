"""Orientation and slope along strain-mode leaves by Magnus steps, for pictures and section forces."""

from __future__ import annotations

import math

import numpy as np

from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import rotation_exp


@kernel
def integrate_centrelines(kappa, compliance, force, step, start, R, v):
    """Write R (k, m+1, 3, 3) and v = r' (k, m+1, 3) after each of m steps of length step (k,) [m] along k leaf springs.

    kappa (k, 2 m, 3) [1/m]: curvature at the first Gauss point of every step, then at the second; compliance (k, m+1,
    3) [1/N]: of stretch and shear, force (k, m+1, 3) [N], at the ends of the steps; start (k, 3, 3): R before the
    first. Magnus steps of fourth order; r' = R (e1 + C R^T n).
    """
    turn, E, local = np.empty(3), np.empty((3, 3)), np.empty(3)
    steps = kappa.shape[1] // 2
    for leaf in range(len(kappa)):
        h = step[leaf]
        f = math.sqrt(3.0) / 12.0 * h * h
        for g in range(steps + 1):
            here = R[leaf, g]
            if g == 0:
                for i in range(3):
                    for j in range(3):
                        here[i, j] = start[leaf, i, j]
            else:
                one, two, last = kappa[leaf, g - 1], kappa[leaf, steps + g - 1], R[leaf, g - 1]
                for c in range(3):
                    i, j = (c + 1) % 3, (c + 2) % 3
                    turn[c] = 0.5 * h * (one[c] + two[c]) + f * (one[i] * two[j] - one[j] * two[i])
                rotation_exp(turn, E)
                for i in range(3):
                    for j in range(3):
                        here[i, j] = last[i, 0] * E[0, j] + last[i, 1] * E[1, j] + last[i, 2] * E[2, j]
            for c in range(3):
                local[c] = compliance[leaf, g, c] * (
                    here[0, c] * force[leaf, g, 0]
                    + here[1, c] * force[leaf, g, 1]
                    + here[2, c] * force[leaf, g, 2]
                )
            for i in range(3):
                v[leaf, g, i] = (
                    here[i, 0] + here[i, 0] * local[0] + here[i, 1] * local[1] + here[i, 2] * local[2]
                )
