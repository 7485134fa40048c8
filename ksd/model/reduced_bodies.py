"""Reduced bodies in the place of leaf springs: modal leaves, reduced solids and leaves of constant stiffness.

A body replaces a leaf between the same nodes and is then a member like every other: `ksd.model.assembly` calls its kernels
by its kind, `condense` for wrench and stiffness at an end pose, `recover` to update the inner coordinates. Bodies share
interface nodes, so a mechanism of them needs no multipliers.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Protocol

import numpy as np

from ksd.elements.linear import LINEAR_INNER
from ksd.elements.modal import modal_sizes
from ksd.model.arrays import COROTATIONAL, LINEAR, Members, State
from ksd.model.compile import Model


class ReducedBody(Protocol):
    """A body in the place of a leaf spring."""

    @property
    def kind(self) -> int:
        """Kind of its member, of `ksd.model.arrays`."""

    def constants(self) -> tuple[np.ndarray, np.ndarray]:
        """Constants `value` and settings `number` of its kernel."""


class LinearBody:
    """A body of constant stiffness, all of whose numbers are in its inner state (`ksd.elements.linear`)."""

    kind = LINEAR

    def constants(self) -> tuple[np.ndarray, np.ndarray]:
        """Empty: it has neither constants nor settings."""
        return np.zeros(0), np.zeros(4, np.int64)


def with_bodies(model: Model, bodies: Mapping[str, ReducedBody]) -> Model:
    """`model` with leaf springs replaced by undeformed bodies, given by the name of the leaf.

    A body that replaces several leaves has its constants stored once.
    """
    if not bodies:
        return model
    old, names = model.arrays.members, model.member_names
    kind, number, frame, value_at = (a.copy() for a in (old.kind, old.number, old.frame, old.value_at))
    states = [inner_state(old, i, model.rest) for i in range(len(kind))]
    stores, values, at = np.diff(old.store_at), [old.value], len(old.value)
    stored_at: dict[int, int] = {}
    for name, body in bodies.items():
        i, (value, settings) = names.index(name), body.constants()
        if id(body) not in stored_at:
            stored_at[id(body)] = at
            values.append(value)
            at += len(value)
        # the kernel takes rotations of end q relative to the undeformed leaf, in the frame of end p
        frame[i, 1] = old.frame[i, 1] @ _rest_orientation(old, i).T
        size, stores[i] = (LINEAR_INNER, 0) if body.kind == LINEAR else modal_sizes(int(settings[1]))
        kind[i], value_at[i], states[i] = body.kind, stored_at[id(body)], np.zeros(size)
        number[i] = 0
        number[i, : len(settings)] = settings
    members = old._replace(
        kind=kind, number=number, frame=frame, value_at=value_at, value=np.concatenate([*values, np.zeros(1)]),
        inner_at=np.cumsum([0] + [len(s) for s in states]).astype(np.int64),
        store_at=np.cumsum([0, *stores]).astype(np.int64),
    )  # fmt: skip
    return replace(
        model,
        arrays=model.arrays.replace(members=members),
        rest=model.rest._replace(inner=np.concatenate([np.zeros(0), *states])),
        bodies={**model.bodies, **bodies},
    )


def _rest_orientation(members: Members, i: int) -> np.ndarray:
    """Orientation (3, 3) of end q of undeformed member i in the frame of its end p."""
    if members.kind[i] == COROTATIONAL:
        at = members.value_at[i] + 16 * members.number[i, 0]
        return members.value[at : at + 9].reshape(3, 3)
    return np.asarray(members.frame[i, 0].T @ members.frame[i, 1])


def inner_state(members: Members, i: int, state: State) -> np.ndarray:
    """Inner state of member i in a state, a view."""
    at = members.inner_at
    return state.inner[at[i] : at[i + 1]]


def relative_end_pose(members: Members, i: int, state: State) -> tuple[np.ndarray, np.ndarray]:
    """Position d (3,) and orientation Q (3, 3) of end q of member i in the frame of its end p."""
    a, b = members.node[i]
    offset, frame = members.offset[i], members.frame[i]
    axes = state.R[a] @ frame[0]
    d = state.x[b] + state.R[b] @ offset[1] - state.x[a] - state.R[a] @ offset[0]
    return axes.T @ d, axes.T @ state.R[b] @ frame[1]


def transfer_state(model: Model, state: State, other: Model) -> State:
    """The state of `model` as a state of `other`, a model with the same nodes and members.

    Members whose kind or number of inner coordinates differs are undeformed in it.
    """
    transferred = other.rest.copy()
    transferred.x[:], transferred.R[:], transferred.multiplier[:] = state.x, state.R, state.multiplier
    transferred.angle[:] = state.angle
    members, others = model.arrays.members, other.arrays.members
    for i in np.flatnonzero(members.kind == others.kind).tolist():
        source, target = inner_state(members, i, state), inner_state(others, i, transferred)
        if len(source) == len(target):
            target[:] = source
    return transferred
