"""Mechanisms in which some joints are condensed and the other leaf springs are members of their own.

A condensed joint is one linear body between its links, as in step 2 of the KSD method; the other members can be of any
kind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ksd.elements.linear import LINEAR_INNER
from ksd.model.arrays import LINEAR, Arrays, State
from ksd.model.compile import Model
from ksd.model.pack import Member, pack_members
from ksd.model.reduced_bodies import inner_state
from ksd.model.scene_layout import elastic_members


class PartlyCondensed(NamedTuple):
    """A mechanism of condensed joints and of the members of a model outside of them.

    nodes (k,): its nodes in the model, the links and the blocks of joints that are not condensed. joint (m,): the
    condensed joint each member represents, else -1; member (m,): the member of the model it is, else -1.
    """

    arrays: Arrays
    rest: State
    nodes: np.ndarray
    joint: np.ndarray
    member: np.ndarray


def condense_some_joints(model: Model, linear: Arrays, condensed: Sequence[bool]) -> PartlyCondensed:
    """The mechanism of `model` with the joints marked in `condensed` (J,) condensed; linear: the mechanism of all
    joints condensed, one linear body per joint first."""
    scene = model.scene
    prefixes = [f"{p.name}/" for p, c in zip(scene.joints, condensed, strict=True) if c]
    nodes = [
        k for k, name in enumerate(model.node_names)
        if k < model.links or not any(name.startswith(b) for b in prefixes)
    ]  # fmt: skip
    new_node = {k: n for n, k in enumerate(nodes)}
    condensed_members = {
        i for s, c in zip(model.joint_members, condensed, strict=True) if c for i in range(s.start, s.stop)
    }
    joint = np.flatnonzero(condensed)
    member = [i for i in range(len(model.member_names)) if i not in condensed_members]
    members = [_linear_body(linear, j, scene.joints[j].name) for j in joint.tolist()] + [
        _member(model, i, new_node) for i in member
    ]
    points = model.rest.x[nodes]
    # constraint rows and loads refer to links, whose numbers stay the same
    arrays, rest = pack_members(points, members, springs=elastic_members(scene, points), like=model.arrays)
    return PartlyCondensed(
        arrays,
        rest,
        np.array(nodes),
        np.concatenate([joint, np.full(len(member), -1)]),
        np.concatenate([np.full(len(joint), -1), member]).astype(np.int64),
    )


def single_member(model: Model, i: int) -> tuple[Arrays, State]:
    """Member i between two fixed ends: end p at the origin with global axes, end q given by its offset and frame."""
    member = _member(model, i, dict.fromkeys(range(len(model.node_names)), 0))
    arrays, rest = pack_members(np.zeros((1, 3)), [member])
    arrays.members.offset[:], arrays.members.frame[:] = 0.0, np.eye(3)
    return arrays, rest


def _linear_body(linear: Arrays, j: int, name: str) -> Member:
    """Condensed joint j as a member between its links."""
    m = linear.members
    return Member(
        name, LINEAR, (int(m.node[j, 0]), int(m.node[j, 1])), m.offset[j], m.frame[j], np.zeros(0),
        np.zeros(1, np.int64), np.zeros(LINEAR_INNER), 0, float(m.length[j]), float(m.stiffness_scale[j]),
    )  # fmt: skip


def _member(model: Model, i: int, new_node: Mapping[int, int]) -> Member:
    """Member i of a model between the nodes new_node gives for its own."""
    m = model.arrays.members
    later_values = m.value_at[m.value_at > m.value_at[i]]
    stop = int(later_values.min()) if len(later_values) else len(m.value)
    a, b = m.node[i]
    return Member(
        model.member_names[i], int(m.kind[i]), (new_node[int(a)], new_node[int(b)]), m.offset[i], m.frame[i],
        m.value[m.value_at[i] : stop], m.number[i], inner_state(m, i, model.rest),
        int(m.store_at[i + 1] - m.store_at[i]), float(m.length[i]), float(m.stiffness_scale[i]),
    )  # fmt: skip
