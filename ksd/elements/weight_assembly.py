"""Weight of a leaf on its two nodes: dead distributed load with its exact tangent; compiled for models with weight.

A leaf with weight has the potential V(xi, g) - mass g.x_p: x_p the position of end p, g gravity in the frame of end p
(`ksd.elements.weight`). When that frame rotates by dphi, g changes in it by g x dphi; so the following is added to the
terms of every member:

residual: -mass g on the force and -(P x g) on the moment of node a, P = mass o + s, the first moment of the mass about
the node (o the lever from the node to end p); tangent: -(P g' + g P')/2 + (P.g) I + [g]x' V_g,g [g]x on the rotation of
node a, and levers' V_xi,g [g]x between the motion of both nodes and that rotation.
"""

from __future__ import annotations

import numpy as np

from ksd.elements.strain_values import GRAVITY_BLOCK_SIZE
from ksd.numerics.kernel import kernel


@kernel
def set_member_gravity(pose, weight, i, factor, store):
    """Write gravity, weight (m, 4) = mass and acceleration, times `factor` into the gravity block of leaf i, in its
    frame p."""
    o = len(store) - GRAVITY_BLOCK_SIZE
    for r in range(3):
        store[o + r] = factor * (
            pose[r] * weight[i, 1] + pose[3 + r] * weight[i, 2] + pose[6 + r] * weight[i, 3]
        )


@kernel
def rotate_member_gravity(pose, move, store):
    """Write the change of gravity in frame p into the gravity block when node a rotates by move[3:6] [rad], for
    `recover`."""
    o = len(store) - GRAVITY_BLOCK_SIZE
    x = pose[0] * move[3] + pose[3] * move[4] + pose[6] * move[5]
    y = pose[1] * move[3] + pose[4] * move[4] + pose[7] * move[5]
    z = pose[2] * move[3] + pose[5] * move[4] + pose[8] * move[5]
    g0, g1, g2 = store[o], store[o + 1], store[o + 2]
    store[o + 36], store[o + 37], store[o + 38] = g1 * z - g2 * y, g2 * x - g0 * z, g0 * y - g1 * x


@kernel
def _times_gravity_cross(pose, block, at, g, U):
    """Write U (3, 3) = Rp B Rp^T [g]x, B row-major in the gravity block from `at`, g global."""
    T = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            T[i, j] = (
                pose[3 * i] * block[at + j]
                + pose[3 * i + 1] * block[at + 3 + j]
                + pose[3 * i + 2] * block[at + 6 + j]
            )
    for i in range(3):
        for j in range(3):
            U[i, j] = T[i, 0] * pose[3 * j] + T[i, 1] * pose[3 * j + 1] + T[i, 2] * pose[3 * j + 2]
    for i in range(3):
        a0, a1, a2 = U[i, 0], U[i, 1], U[i, 2]
        U[i, 0], U[i, 1], U[i, 2] = a1 * g[2] - a2 * g[1], a2 * g[0] - a0 * g[2], a0 * g[1] - a1 * g[0]


@kernel
def add_member_weight(pose, store, mass, T, force):
    """Add the weight of a condensed leaf of `mass` [kg] to its tangent T (12, 12) and forces (12,) on both nodes: the
    terms of the module docstring. The last numbers of `store` are its gravity block."""
    block = store[len(store) - GRAVITY_BLOCK_SIZE :]
    U, M = np.empty((3, 3)), np.empty((3, 3))
    g, P, O, column = np.empty(3), np.empty(3), np.empty(3), np.empty(12)
    for r in range(3):
        a, b, c = pose[3 * r], pose[3 * r + 1], pose[3 * r + 2]
        g[r] = a * block[0] + b * block[1] + c * block[2]
        lever = mass * (pose[9 + r] - pose[15 + r])
        P[r] = lever + a * block[3] + b * block[4] + c * block[5]
        O[r] = lever + a * block[6] + b * block[7] + c * block[8]
    w, s = pose[9:12], pose[12:15]
    Og = O[0] * g[0] + O[1] * g[1] + O[2] * g[2]
    at = 27
    _times_gravity_cross(pose, block, at, g, U)
    for r in range(3):
        j, k = (r + 1) % 3, (r + 2) % 3
        force[r] -= mass * g[r]
        force[3 + r] -= P[j] * g[k] - P[k] * g[j]
        T[3 + r, 3 + r] += Og
        for c in range(3):
            # [g]x' U, column by column: [g]x' u = u x g
            T[3 + r, 3 + c] += U[j, c] * g[k] - U[k, c] * g[j] - 0.5 * (O[r] * g[c] + g[r] * O[c])
    at -= 18
    _times_gravity_cross(pose, block, at, g, U)
    at += 9
    _times_gravity_cross(pose, block, at, g, M)
    for c in range(3):
        for r in range(3):
            j, k = (r + 1) % 3, (r + 2) % 3
            column[r], column[6 + r] = -U[r, c], U[r, c]
            column[3 + r] = U[j, c] * w[k] - U[k, c] * w[j] - M[r, c]
            column[9 + r] = U[k, c] * s[j] - U[j, c] * s[k] + M[r, c]
        for r in range(12):
            T[r, 3 + c] += column[r]
            T[3 + c, r] += column[r]
