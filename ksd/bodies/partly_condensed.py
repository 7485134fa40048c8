"""Condensed joints beside members that are not condensed: the mechanism of all of them together.

A joint is condensed, as in step 2 of the KSD method, into one linear body between its links; the leaves of the others are
members of their own, whatever their kind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ksd.beam.linear import LINEAR_INNER
from ksd.model.arrays import LINEAR, Arrays, State, flatten_arrays, unflatten_arrays
from ksd.model.compile import Model
from ksd.model.pack import Member, pack_members
from ksd.model.reduced_bodies import inner_state
from ksd.model.scene_layout import elastic_members


class PartlyCondensed(NamedTuple):
    """A mechanism of condensed joints and of the members of a model that are in none of them.

    nodes (k,): nodes of the model it has, the links and the blocks of joints that are not condensed. joint (m,): the
    condensed joint a member stands for, else -1; member (m,): the member of the model it is, else -1.
    """

    arrays: Arrays
    rest: State
    nodes: np.ndarray
    joint: np.ndarray
    member: np.ndarray

    def inner(self, motion: State, m: int) -> np.ndarray:
        """Inner state of member m, a view."""
        at = self.arrays.members.inner_at
        return motion.inner[at[m] : at[m + 1]]


def condense_some_joints(model: Model, linear: Arrays, condensed: Sequence[bool]) -> PartlyCondensed:
    """The mechanism of `model` with some joints condensed; linear: that of all joints condensed, its first members."""
    scene = model.scene
    blocks = [f"{p.name}/" for p, c in zip(scene.joints, condensed, strict=True) if c]
    nodes = [
        k for k, name in enumerate(model.node_names)
        if k < model.links or not any(name.startswith(b) for b in blocks)
    ]  # fmt: skip
    place = {k: n for n, k in enumerate(nodes)}
    within = {
        i for s, c in zip(model.joint_members, condensed, strict=True) if c for i in range(s.start, s.stop)
    }
    joint = np.flatnonzero(condensed)
    member = [i for i in range(len(model.member_names)) if i not in within]
    parts = [_linear(linear, j, scene.joints[j].name) for j in joint.tolist()] + [
        _member(model, i, place) for i in member
    ]
    places = model.rest.x[nodes]
    # links, which rows and loads are of, have the same numbers
    arrays, rest = pack_members(places, parts, springs=elastic_members(scene, places), like=model.arrays)
    away = np.full(len(member), -1), np.full(len(joint), -1)
    return PartlyCondensed(
        arrays,
        rest,
        np.array(nodes),
        np.concatenate([joint, away[0]]),
        np.concatenate([away[1], member]).astype(np.int64),
    )


def single_member(model: Model, i: int) -> tuple[Arrays, State]:
    """Member i between two fixed ends, end p at the origin along the axes; end q is where its offset and frame put it."""
    made = _member(model, i, dict.fromkeys(range(len(model.node_names)), 0))
    arrays, rest = pack_members(np.zeros((1, 3)), [made])
    arrays.members.offset[:], arrays.members.frame[:] = 0.0, np.eye(3)
    # end q is moved in place
    return unflatten_arrays(flatten_arrays(arrays)), rest


def _linear(linear: Arrays, j: int, name: str) -> Member:
    """Condensed joint j as a member between its links."""
    m = linear.members
    return Member(
        name, LINEAR, (int(m.node[j, 0]), int(m.node[j, 1])), m.offset[j], m.frame[j], np.zeros(0),
        np.zeros(1, np.int64), np.zeros(LINEAR_INNER), 0, float(m.length[j]), float(m.floor[j]),
    )  # fmt: skip


def _member(model: Model, i: int, place: Mapping[int, int]) -> Member:
    """Member i of a model as it is, between the nodes that `place` gives."""
    m = model.arrays.members
    later = m.value_at[m.value_at > m.value_at[i]]
    stop = int(later.min()) if len(later) else len(m.value)
    a, b = m.node[i]
    return Member(
        model.member_names[i], int(m.kind[i]), (place[int(a)], place[int(b)]), m.offset[i], m.frame[i],
        m.value[m.value_at[i] : stop], m.number[i], inner_state(model, model.rest, i),
        int(m.store_at[i + 1] - m.store_at[i]), float(m.length[i]), float(m.floor[i]),
    )  # fmt: skip
