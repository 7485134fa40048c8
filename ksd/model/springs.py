"""Springs and condensed links as parts of a model: what resists between two nodes without inner unknowns.

They are packed like members and go through the same levers; a model without any does not call this file's kernel.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ksd.beam.linear import linear_condense
from ksd.beam.spring import coil_condense
from ksd.model.arrays import COIL, LINEAR, TURN
from ksd.model.loading import twist
from ksd.model.pack import Member
from ksd.model.poses import member_pose
from ksd.model.tangents import member_tangent, scatter
from ksd.numerics.kernel import kernel
from ksd.scene.effects import LinkMatrix, Spring, TurnSpring


@kernel
def add_springs(springs, first, start, keep, x, R, work, rtol, noise):
    """All springs into work.value and work.rhs, as `add_members` does without inner unknowns. Returns the status.

    first: row of work.pose and work.lam of the first; start, keep: as in `Arrays`.

    A torsion spring, about u = e3 of end p turning with its node, has the moment M = k (angle - rest) and adds
    k g g^T + M (second derivatives of the angle), g its gradient; see `ksd.model.loading.twist`.
    """
    status = 0
    Q, K = np.empty((3, 3)), np.empty((6, 6))
    T, force, d = np.empty((12, 12)), np.empty(12), np.empty(3)
    starts, A, M = np.empty(2, np.int64), np.empty((6, 6)), np.empty((6, 12))
    for i in range(len(springs.kind)):
        pose, lam = work.pose[first + i], work.lam[first + i]
        member_pose(springs.node, springs.offset, springs.frame, x, R, i, pose, Q)
        for c in range(3):
            d[c] = pose[c] * pose[15] + pose[3 + c] * pose[16] + pose[6 + c] * pose[17]
        value = springs.value[springs.value_at[i] :]
        if springs.kind[i] == TURN:
            for c in range(3):
                d[c] = pose[3 * c + 2]
            T[:, :] = 0.0
            force[:] = 0.0
            Ra, Rb = R[springs.node[i, 0]], R[springs.node[i, 1]]
            # the angle first, since the moment weighs its second derivatives
            none = 0.0 * value[0]
            moment = value[0] * (twist(Ra, Rb, d, force, T, none) - value[1])
            T[:, :] = 0.0
            twist(Ra, Rb, d, force, T, moment)
            for r in range(12):
                for c in range(12):
                    T[r, c] += value[0] * force[r] * force[c]
            lam[:] = 0.0
            lam[5], lam[11] = moment, moment
            for r in range(12):
                force[r] *= moment
        else:
            if springs.kind[i] == COIL:
                status = max(status, coil_condense(value, d, lam, K))
            else:
                linear_condense(value, d, Q, lam, K)
            member_tangent(pose, lam, K, T, force, A, M)
        n = math.sqrt(lam[0] ** 2 + lam[1] ** 2 + lam[2] ** 2)
        m = math.sqrt(lam[3] ** 2 + lam[4] ** 2 + lam[5] ** 2)
        L, floor = springs.length[i], noise * springs.floor[i]
        for e in range(2):
            node, o = springs.node[i, e], 6 * e
            starts[e] = start[node]
            fm = math.sqrt(force[o + 3] ** 2 + force[o + 4] ** 2 + force[o + 5] ** 2)
            work.scale[node, 0] += rtol * (n + m / L) + floor
            work.scale[node, 1] += rtol * (max(fm, m) + n * L) + floor * L
        scatter(keep, springs.block[i], T, force, work.rhs, starts, work.value)
    return status


def across(axis: np.ndarray) -> np.ndarray:
    """Axes (3, 3), columns e1, e2, e3, with e3 along `axis`."""
    e3 = axis / np.linalg.norm(axis)
    e1 = np.cross(np.eye(3)[int(np.argmin(np.abs(e3)))], e3)
    e1 /= np.linalg.norm(e1)
    return np.column_stack([e1, np.cross(e3, e1), e3])


def _member(name: str, kind: int, nodes: tuple[int, int], offset: Any, **more: Any) -> Member:
    axes = more["axes"]
    return Member(
        name, kind, nodes, np.asarray(offset, float), np.array([axes, axes]), np.asarray(more["value"], float),
        np.zeros(1, np.int64), np.zeros(0), 0, more["length"], more["floor"],
    )  # fmt: skip


def spring_members(
    springs: tuple[Spring | TurnSpring, ...], index: Mapping[str, int], places: np.ndarray
) -> list[Member]:
    """The springs of a scene between the nodes of their links, at reference `places` (k, 3)."""
    found = []
    for s in springs:
        nodes = (index[s.a], index[s.b])
        if isinstance(s, Spring):
            ends = np.array([s.start, s.end])
            length = max(float(np.linalg.norm(ends[1] - ends[0])), s.free_length, 1e-9)
            words: dict[str, Any] = {"value": (s.stiffness, s.free_length), "axes": np.eye(3)}
            words |= {"length": length, "floor": s.stiffness}
            found.append(_member(f"spring '{s.name}'", COIL, nodes, ends - places[list(nodes)], **words))
        else:
            at = np.array([s.at, s.at]) - places[list(nodes)]
            words = {"value": (s.stiffness, s.rest_angle), "axes": across(np.asarray(s.axis))}
            # as stiff as a pair of unit arm: only the bound of rounding needs it
            words |= {"length": 1.0, "floor": s.stiffness}
            found.append(_member(f"spring '{s.name}'", TURN, nodes, at, **words))
    return found


def matrix_member(
    name: str, matrix: LinkMatrix, nodes: tuple[int, int], places: np.ndarray, axis: np.ndarray
) -> Member:
    """A link between its two interfaces, linear in the frame of the first; `axis` (3,): e3 of that frame."""
    points = np.asarray(matrix.points)
    arm = points[1] - points[0]
    along = arm - (arm @ axis) * axis
    axes = across(axis)
    if np.linalg.norm(along) > 1e-6 * np.linalg.norm(arm):
        e1 = along / np.linalg.norm(along)
        axes = np.column_stack([e1, np.cross(axis, e1), axis])
    turn = np.kron(np.eye(2), axes)
    K = turn.T @ np.asarray(matrix.stiffness)[6:, 6:] @ turn
    value = np.concatenate([axes.T @ arm, np.eye(3).ravel(), np.zeros(6), K.ravel()])
    words = {
        "value": value,
        "axes": axes,
        "length": float(np.linalg.norm(arm)),
        "floor": float(np.abs(K[:3, :3]).max()),
    }
    return _member(f"link '{name}'", LINEAR, nodes, points - places[list(nodes)], **words)
