"""Whole turns: rotations of more than half a turn, counted along the path that a solve takes.

A rotation matrix tells an angle up to whole turns. `State.angle` therefore holds every angle of a constraint term or torsion
spring, and the rotation vector of every node, as it was last counted: each Newton step adds its own rotation, to first
order, and each evaluation takes the value of the matrix that is nearest. About a fixed axis, so always in a plane, the added
rotation is exact for a step of any size; elsewhere a step may be wrong by less than half a turn.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ksd.model.arrays import (
    LEAF_COUNT,
    MEMBER,
    MEMBER_COUNT,
    NODES,
    ROTATION,
    ROWS,
    TERM,
    TORSION,
    Arrays,
    State,
)
from ksd.numerics.kernel import kernel
from ksd.numerics.rotations import FULL_TURN, nearest_turn, rotation_log

ANCHORED_ANGLE = 1.5
"""Rotation [rad] of a node up to which its vector is left as the sum of its steps."""
NO_AXIS = 1e-6
"""Rotation [rad], up to whole turns, below which the matrix of a node tells no axis."""


@kernel
def add_rotations(ints, floats, R, angle, spin):
    """Add a step to the counted angles (see `State`), in place; R (k, 3, 3): before the step.

    spin (k, 3) [rad]: rotations of the nodes in the step, global axes.
    """
    terms, leaves = ints[ints[TERM.first] + ints[ROWS]], ints[LEAF_COUNT]
    springs = ints[MEMBER_COUNT] - leaves
    for i in range(terms + springs):
        if i < terms:
            pair, first, apart = ints[TERM.node] + 2 * i, ints[TERM.direction] + 3 * i, 1
            counted = ints[ints[TERM.kind] + i] == ROTATION
        else:
            j = leaves + i - terms
            pair, first, apart = ints[MEMBER.node] + 2 * j, ints[MEMBER.frame] + 18 * j + 2, 3
            counted = ints[ints[MEMBER.kind] + j] == TORSION
        if counted:
            a, b = ints[pair], ints[pair + 1]
            for r in range(3):
                axis = 0.0
                for c in range(3):
                    axis += R[a, r, c] * floats[first + apart * c]
                angle[i] += axis * (spin[b, r] - spin[a, r])
    for k in range(ints[NODES]):
        for r in range(3):
            angle[terms + springs + 3 * k + r] += spin[k, r]


@kernel
def counted_rotation(R, counted, v):
    """Write the rotation vector v (3,) of R (3, 3), with the whole turns of the vector `counted` (3,)."""
    rotation_log(R, v)
    square, size = 0.0, 0.0
    for r in range(3):
        square += counted[r] * counted[r]
        size += v[r] * v[r]
    if not square > ANCHORED_ANGLE * ANCHORED_ANGLE:
        return
    total, size = math.sqrt(square), math.sqrt(size)
    if size < NO_AXIS:
        turns = FULL_TURN * np.rint(total / FULL_TURN) / total
        for r in range(3):
            v[r] += turns * counted[r]
        return
    along = (v[0] * counted[0] + v[1] * counted[1] + v[2] * counted[2]) / size
    factor = nearest_turn(size, along) / size
    for r in range(3):
        v[r] *= factor


@kernel
def anchor_rotations(ints, R, angle):
    """Replace the counted rotation vectors of the nodes by those of R (k, 3, 3) with the same turns, in place.

    A vector is kept where R is so near a whole turn that its axis is that of a small rotation on top of it.
    """
    at, v = len(angle) - 3 * ints[NODES], np.empty(3)
    for k in range(ints[NODES]):
        own = angle[at + 3 * k : at + 3 * k + 3]
        if own[0] * own[0] + own[1] * own[1] + own[2] * own[2] > ANCHORED_ANGLE * ANCHORED_ANGLE:
            counted_rotation(R[k], own, v)
            off = (v[0] - own[0]) ** 2 + (v[1] - own[1]) ** 2 + (v[2] - own[2]) ** 2
            if off < math.pi**2:
                for r in range(3):
                    own[r] = v[r]


def node_rotations(arrays: Arrays, motion: State) -> np.ndarray:
    """The counted rotation vectors (k, 3) [rad] of the nodes of a state, a view."""
    return motion.angle[len(motion.angle) - 3 * len(arrays.start) :].reshape(-1, 3)


def relative_angles(arrays: Arrays, motion: State) -> np.ndarray:
    """The counted angles [rad] of the constraint terms and springs of a state, 0 where nothing is counted, a view."""
    return motion.angle[: len(motion.angle) - 3 * len(arrays.start)]


def copy_angles(
    arrays: Arrays,
    motion: State,
    others: Arrays,
    other: State,
    *,
    nodes: Any = slice(None),
    of: Any = slice(None),
) -> None:
    """Copy the counted angles of a state into one with the same constraint terms and springs, whose `nodes` are the nodes
    `of` the first."""
    relative_angles(others, other)[:] = relative_angles(arrays, motion)
    node_rotations(others, other)[nodes] = node_rotations(arrays, motion)[of]


def count_from_links(arrays: Arrays, motion: State, rotations: np.ndarray) -> None:
    """Set the counted angles of a state from rotation vectors (k, 3) [rad] of its nodes with their whole turns, in place.

    An angle between two nodes is taken as the difference of their vectors along its axis, so it is counted rightly where
    both turn about parallel axes.
    """
    motion.angle[:] = 0.0
    add_rotations(arrays.ints, arrays.floats, motion.R, motion.angle, np.ascontiguousarray(rotations))
