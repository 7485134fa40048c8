"""Springs and links with a matrix: elastic bodies between two nodes without inner unknowns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ksd.model.arrays import COIL, LINEAR, TORSION
from ksd.model.pack import Member
from ksd.scene.effects import LinkMatrix, Spring, TurnSpring


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
