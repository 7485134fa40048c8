"""What the tests of effects share."""

import numpy as np


def free_beam(points, amount):
    """Stiffness (12, 12) of a free Euler-Bernoulli beam of circular section between two points, global axes."""
    arm = np.subtract(points[1], points[0])
    L = np.linalg.norm(arm)
    E, r = 200e9 / amount, 3e-3
    A, inertia = np.pi * r**2, np.pi * r**4 / 4
    e1 = arm / L
    e2 = np.cross(e1, [0.3, 0.5, 0.7])
    e2 /= np.linalg.norm(e2)
    turn = np.column_stack([e1, e2, np.cross(e1, e2)])
    k = np.zeros((6, 6))
    a, b, c = 12 * E * inertia / L**3, 6 * E * inertia / L**2, 4 * E * inertia / L
    k[0, 0], k[3, 3] = E * A / L, E / 2.6 * 2 * inertia / L
    k[1, 1] = k[2, 2] = a
    k[1, 5] = k[5, 1] = -b
    k[2, 4] = k[4, 2] = b
    k[4, 4] = k[5, 5] = c
    k = np.kron(np.eye(2), turn) @ k @ np.kron(np.eye(2), turn).T
    # motion of the second end relative to the first
    relative = np.zeros((6, 12))
    relative[:, 6:], relative[:3, :3], relative[3:, 3:6] = np.eye(6), -np.eye(3), -np.eye(3)
    relative[:3, 3:6] = [[0, -arm[2], arm[1]], [arm[2], 0, -arm[0]], [-arm[1], arm[0], 0]]
    return relative.T @ k @ relative
