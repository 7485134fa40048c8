"""Reduced bodies among the members of a model: what a modal leaf, a reduced solid and a condensed one have in common.

Such a body takes the place of a leaf between the same nodes; from then on it is a member like every other: its kernel
gives wrench and stiffness at an end pose (`condense`) and moves its inner coordinates (`recover`), which
`ksd.model.assembly` calls by its kind. Bodies share interface nodes, so a mechanism of them needs no multipliers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Protocol

import numpy as np

from ksd.beam.linear import LINEAR_INNER
from ksd.beam.modal import modal_sizes
from ksd.model.arrays import COROTATIONAL, LINEAR, Members, State
from ksd.model.compile import Model


class ReducedBody(Protocol):
    """A body in the place of a leaf. kind: that of its member (`ksd.model.arrays`)."""

    @property
    def kind(self) -> int:
        """Kind of member."""

    def constants(self) -> tuple[np.ndarray, np.ndarray]:
        """`value` and `number` (4,) of its kernel."""


def with_bodies(model: Model, bodies: Mapping[str, ReducedBody]) -> Model:
    """`model` with these bodies, by name of the leaf each takes the place of; they lie where these leaves lie, undeformed.

    One object in several places has one set of constants.
    """
    if not bodies:
        return model
    old, names = model.arrays.members, model.member_names
    kind, number, frame, value_at = (a.copy() for a in (old.kind, old.number, old.frame, old.value_at))
    states = [inner_state(model, model.rest, i) for i in range(len(kind))]
    stores, values, at = np.diff(old.store_at), [old.value], len(old.value)
    known: dict[int, int] = {}
    for name, body in bodies.items():
        i, (value, settings) = names.index(name), body.constants()
        if id(body) not in known:
            known[id(body)] = at
            values.append(value)
            at += len(value)
        # rotations of end q are those from rest, seen from end p
        frame[i, 1] = old.frame[i, 1] @ _rest_end(old, i).T
        size, stores[i] = (LINEAR_INNER, 0) if body.kind == LINEAR else modal_sizes(int(settings[1]))
        kind[i], number[i], value_at[i], states[i] = body.kind, settings, known[id(body)], np.zeros(size)
    members = old._replace(
        kind=kind, number=number, frame=frame, value_at=value_at, value=np.concatenate([*values, np.zeros(1)]),
        inner_at=np.cumsum([0] + [len(s) for s in states]).astype(np.int64),
        store_at=np.cumsum([0, *stores]).astype(np.int64),
    )  # fmt: skip
    return replace(
        model,
        arrays=model.arrays._replace(members=members),
        rest=model.rest._replace(inner=np.concatenate([np.zeros(0), *states])),
        bodies={**model.bodies, **bodies},
    )


def _rest_end(members: Members, i: int) -> np.ndarray:
    """Orientation (3, 3) of end q of member i at rest, seen from its end p."""
    if members.kind[i] == COROTATIONAL:
        at = members.value_at[i] + 16 * members.number[i, 0]
        return members.value[at : at + 9].reshape(3, 3)
    return np.asarray(members.frame[i, 0].T @ members.frame[i, 1])


def inner_state(model: Model, motion: State, i: int) -> np.ndarray:
    """Inner state of member i in a motion of `model`, a view."""
    at = model.arrays.members.inner_at
    return motion.inner[at[i] : at[i + 1]]


def relative_end_pose(members: Members, i: int, motion: State) -> tuple[np.ndarray, np.ndarray]:
    """Position d (3,) and orientation Q (3, 3) of end q of member i in the frame of its end p."""
    a, b = members.node[i]
    offset, frame = members.offset[i], members.frame[i]
    axes = motion.R[a] @ frame[0]
    d = motion.x[b] + motion.R[b] @ offset[1] - motion.x[a] - motion.R[a] @ offset[0]
    return axes.T @ d, axes.T @ motion.R[b] @ frame[1]


def transfer_state(model: Model, motion: State, other: Model) -> State:
    """The motion of `model` in a model of the same nodes and leaves: members of another kind than there are undeformed."""
    state = other.rest.copy()
    state.x[:], state.R[:], state.multiplier[:] = motion.x, motion.R, motion.multiplier
    for i in np.flatnonzero(model.arrays.members.kind == other.arrays.members.kind).tolist():
        own, theirs = inner_state(model, motion, i), inner_state(other, state, i)
        if len(own) == len(theirs):
            theirs[:] = own
    return state
