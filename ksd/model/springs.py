"""Springs and links with a matrix: elastic bodies between two nodes without inner unknowns."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ksd.model.arrays import COIL, LINEAR, TORSION, Arrays, State
from ksd.model.member_ends import table_ends
from ksd.model.pack import Member
from ksd.numerics.rotations import nearest_turn
from ksd.scene.effects import LinkMatrix, Spring, TurnSpring

ZERO_ENERGY = 1e-15
"""Energy of a spring relative to its stiffness (of a coil spring, times the size squared) up to which it has no preload."""


def axes_along(axis: np.ndarray) -> np.ndarray:
    """Axes (3, 3), columns e1, e2, e3, with e3 along `axis`."""
    e3 = axis / np.linalg.norm(axis)
    e1 = np.cross(np.eye(3)[int(np.argmin(np.abs(e3)))], e3)
    e1 /= np.linalg.norm(e1)
    return np.column_stack([e1, np.cross(e3, e1), e3])


def _member(
    name: str, kind: int, nodes: tuple[int, int], offset: np.ndarray, axes: np.ndarray, value: Any, length: float,
    stiffness_scale: float,
) -> Member:  # fmt: skip
    """A member without inner state, with the same axes (3, 3) at both ends; other arguments as in `Member`."""
    return Member(
        name, kind, nodes, offset, np.array([axes, axes]), np.asarray(value, float), np.zeros(1, np.int64), np.zeros(0), 0,
        length, stiffness_scale,
    )  # fmt: skip


def spring_members(
    springs: tuple[Spring | TurnSpring, ...], index: Mapping[str, int], places: np.ndarray
) -> list[Member]:
    """Members of the springs of a scene; index: node of each link; places (k, 3) [m]: reference points of the nodes."""
    members = []
    for s in springs:
        nodes = (index[s.a], index[s.b])
        if isinstance(s, Spring):
            kind, ends, axes, rest = COIL, np.array([s.start, s.end]), np.eye(3), s.free_length
            length = max(float(np.linalg.norm(ends[1] - ends[0])), s.free_length, 1e-9)
        else:
            kind, ends, axes, rest = (
                TORSION,
                np.array([s.at, s.at]),
                axes_along(np.array(s.axis)),
                s.rest_angle,
            )
            # for the bound of rounding only: the stiffness of a couple with unit arm
            length = 1.0
        offset, value = ends - places[list(nodes)], (s.stiffness, rest)
        members.append(_member(f"spring '{s.name}'", kind, nodes, offset, axes, value, length, s.stiffness))
    return members


def matrix_member(
    name: str, matrix: LinkMatrix, nodes: tuple[int, int], places: np.ndarray, axis: np.ndarray
) -> Member:
    """The member of a link with a matrix between its two interfaces.

    nodes, places: as in `spring_members`; axis (3,): e3 of the frame of the first interface, in which it is linear.
    """
    points = np.asarray(matrix.points)
    arm = points[1] - points[0]
    along = arm - (arm @ axis) * axis
    axes = axes_along(axis)
    if np.linalg.norm(along) > 1e-6 * np.linalg.norm(arm):
        e1 = along / np.linalg.norm(along)
        axes = np.column_stack([e1, np.cross(axis, e1), axis])
    turn = np.kron(np.eye(2), axes)
    K = turn.T @ np.asarray(matrix.stiffness)[6:, 6:] @ turn
    value = np.concatenate([axes.T @ arm, np.eye(3).ravel(), np.zeros(6), K.ravel()])
    length, stiffness_scale = float(np.linalg.norm(arm)), float(np.abs(K[:3, :3]).max())
    offset = points - places[list(nodes)]
    return _member(f"link '{name}'", LINEAR, nodes, offset, axes, value, length, stiffness_scale)


def spring_length(arrays: Arrays, motion: State, i: int) -> float | None:
    """Length [m] of spring i, of a torsion spring its angle [rad] with whole turns; None of a link with a matrix."""
    ends = table_ends(arrays.springs, motion, i)
    if arrays.springs.kind[i] == COIL:
        return math.sqrt(float(ends.d @ ends.d))
    if arrays.springs.kind[i] == TORSION:
        _, _, z, w = Rotation.from_matrix(ends.Q).as_quat()
        return float(nearest_turn(2.0 * math.atan2(z, w), motion.angle[len(arrays.terms.node) + i]))
    return None


def energy_of_one_spring(arrays: Arrays, motion: State, i: int) -> float:
    """Energy [J] of spring i: k (l - l0)^2 / 2, k (angle - rest)^2 / 2, or W xi + xi K xi / 2."""
    springs, length = arrays.springs, spring_length(arrays, motion, i)
    value, ends = springs.value[springs.value_at[i] :], table_ends(springs, motion, i)
    if length is not None:
        return 0.5 * float(value[0]) * (length - float(value[1])) ** 2
    turned = Rotation.from_matrix(ends.Q @ value[3:12].reshape(3, 3).T).as_rotvec()
    xi = np.concatenate([ends.d - value[:3], turned])
    return float(value[12:18] @ xi + 0.5 * xi @ value[18:54].reshape(6, 6) @ xi)


def is_preloaded(arrays: Arrays, rest: State, i: int) -> bool:
    """Whether spring i, which is no link with a matrix, exerts a force in the undeformed configuration."""
    springs = arrays.springs
    unit = {COIL: arrays.size**2, TORSION: 1.0}.get(int(springs.kind[i]))
    bound = ZERO_ENERGY * float(springs.value[springs.value_at[i]])
    return unit is not None and energy_of_one_spring(arrays, rest, i) > bound * unit


def relax_spring(arrays: Arrays, motion: State, i: int) -> None:
    """Change the constants of spring i so that it carries no force at `motion`."""
    springs, length = arrays.springs, spring_length(arrays, motion, i)
    here, ends = springs.value[springs.value_at[i] :], table_ends(springs, motion, i)
    if length is not None:
        here[1] = length
    else:
        # position and rotation at rest, then the wrench there
        here[:3], here[3:12] = ends.d, ends.Q.ravel()
        here[12:18] = 0.0
