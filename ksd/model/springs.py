"""Springs and links with a matrix: elastic bodies between two nodes without inner unknowns.

They are packed like members and use the same levers. A model without them does not call the kernel of this file.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ksd.elements.linear import linear_condense
from ksd.elements.member_tangent import member_norms, member_tangent
from ksd.elements.spring import coil_condense
from ksd.model.arrays import (
    BLOCK,
    COIL,
    FRAME,
    KIND,
    LENGTH,
    LINEAR,
    MEMBER_COUNT,
    NODE,
    OFFSET,
    ROWS,
    SPRING_COUNT,
    SPRINGS,
    START,
    STIFFNESS_SCALE,
    TERM_FIRST,
    TORSION,
    VALUE,
    VALUE_AT,
)
from ksd.model.loading import twist, twist_curvature
from ksd.model.pack import Member
from ksd.model.poses import member_pose
from ksd.model.tangents import scatter
from ksd.model.turns import nearest_turn
from ksd.numerics.kernel import kernel
from ksd.scene.effects import LinkMatrix, Spring, TurnSpring


@kernel
def add_springs(ints, floats, x, R, angle, rtol, noise, matrix, rhs, scale, poses, lams):
    """Add all springs to the matrix and the residual, and return their status.

    Their rows of poses and lams (`Workspace`) follow those of the members. A torsion spring about u = e3 of end p, which
    rotates with its node, has the moment M = k (turn - rest), with the whole turns that `State.angle` counts, and the
    tangent k g g^T + M (second derivatives of the angle), where g is its gradient; see `ksd.model.loading.twist`.
    """
    status = 0
    terms = ints[ints[TERM_FIRST] + ints[ROWS]]
    node, value_at, block = ints[SPRINGS + NODE], ints[SPRINGS + VALUE_AT], ints[SPRINGS + BLOCK]
    Q, K, pose, lam, norms = np.empty((3, 3)), np.empty((6, 6)), np.empty(18), np.empty(12), np.empty(6)
    T, force, d, A, M = np.empty((12, 12)), np.empty(12), np.empty(3), np.empty((6, 6)), np.empty((6, 12))
    q, slope = np.empty(3), np.empty(3)
    for i in range(ints[SPRING_COUNT]):
        a, b = ints[node + 2 * i], ints[node + 2 * i + 1]
        kind, row = ints[ints[SPRINGS + KIND] + i], ints[MEMBER_COUNT] + i
        member_pose(
            ints, node + 2 * i, floats, ints[SPRINGS + OFFSET] + 6 * i, floats, ints[SPRINGS + FRAME] + 18 * i, x, R, pose, Q
        )  # fmt: skip
        for c in range(3):
            d[c] = pose[c] * pose[15] + pose[3 + c] * pose[16] + pose[6 + c] * pose[17]
        value = floats[ints[SPRINGS + VALUE] + ints[value_at + i] :]
        if kind == TORSION:
            for c in range(3):
                d[c] = pose[3 * c + 2]
            T[:, :] = 0.0
            force[:] = 0.0
            turn, q0 = twist(R[a], R[b], d, q, slope, A)
            turn = nearest_turn(turn, angle[terms + i])
            angle[terms + i] = turn
            moment = value[0] * (turn - value[1])
            twist_curvature(d, q, q0, slope, moment, T)
            for r in range(3):
                force[3 + r], force[9 + r] = -moment * slope[r], moment * slope[r]
                for c in range(3):
                    k = value[0] * slope[r] * slope[c]
                    T[3 + r, 3 + c] += k
                    T[9 + r, 9 + c] += k
                    T[3 + r, 9 + c] -= k
                    T[9 + r, 3 + c] -= k
            lam[:] = 0.0
            lam[5], lam[11] = moment, moment
        else:
            if kind == COIL:
                status = max(status, coil_condense(value, d, lam, K))
            else:
                linear_condense(value, d, Q, lam, K, A, M)
            member_tangent(pose, lam, K, T, force, A, M)
        member_norms(lam, force, norms)
        n, m, L = norms[0], norms[1], floats[ints[SPRINGS + LENGTH] + i]
        rounding = noise * floats[ints[SPRINGS + STIFFNESS_SCALE] + i]
        for e in range(2):
            k = ints[node + 2 * i + e]
            scale[k, 0] += rtol * (n + m / L) + rounding
            scale[k, 1] += rtol * (max(norms[3 + 2 * e], m) + n * L) + rounding * L
        for r in range(18):
            poses[row, r] = pose[r]
        for r in range(12):
            lams[row, r] = lam[r]
        scatter(ints, block + 4 * i, T, force, ints[ints[START] + a], ints[ints[START] + b], matrix, rhs)
    return status


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
