"""From lists of members, constraint rows and loads to the frozen arrays of `ksd.model.arrays`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ksd.beam.strain_values import strain_scratch
from ksd.model.arrays import LINEAR, STRAIN, Arrays, Loads, Members, Motion, Terms
from ksd.numerics.blocks import plan_blocks


@dataclass(frozen=True)
class Member:
    """One elastic body between two nodes, before packing: offsets (2, 3) m, end frames (2, 3, 3), constants.

    mass [kg]: what weighs of it, 0 for a member without weight.
    """

    name: str
    kind: int
    nodes: tuple[int, int]
    offset: np.ndarray
    frame: np.ndarray
    value: np.ndarray
    number: np.ndarray
    inner: np.ndarray
    store: int
    length: float
    floor: float
    mass: float = 0.0


@dataclass(frozen=True)
class Row:
    """One constraint row: terms (coefficient, kind, base node, node, direction, point on base, point on node)."""

    terms: tuple[tuple[float, int, int, int, np.ndarray, np.ndarray, np.ndarray], ...]


@dataclass(frozen=True)
class Push:
    """One external load: node, point (offset in node axes), force, moment, following."""

    node: int
    point: np.ndarray
    force: np.ndarray
    moment: np.ndarray
    following: bool = False


@dataclass(frozen=True)
class Assembly:
    """What `pack` is given: reference positions (k, 3) of all nodes, node 0 fixed; the rest by lists; gravity (3,)."""

    reference: np.ndarray
    members: Sequence[Member]
    rows: Sequence[Row] = field(default=())
    pushes: Sequence[Push] = field(default=())
    springs: Sequence[Member] = field(default=())
    last: int = 0
    gravity: np.ndarray | None = None


def _pairs(parts: Assembly, nodes: int) -> list[tuple[int, int]]:
    """Coupled blocks: block b of node k is k - 1, constraint i is nodes - 1 + i; ground has none."""
    both = (*parts.members, *parts.springs)
    found = [(m.nodes[0] - 1, m.nodes[1] - 1) for m in both if min(m.nodes) > 0]
    for i, row in enumerate(parts.rows):
        for _, _, a, b, *_ in row.terms:
            found += [(k - 1, nodes - 1 + i) for k in (a, b) if k > 0]
            if min(a, b) > 0 and a != b:
                found.append((a - 1, b - 1))
    return found


class Places:
    """Offsets of stored blocks by (node or row) pairs; -1 where an end is fixed."""

    def __init__(self, offsets: dict, position: np.ndarray) -> None:
        self.offsets, self.position = offsets, position

    def diagonal(self, node: int) -> int:
        """Offset of the block of `node` itself."""
        return -1 if node == 0 else self.offsets[(self.position[node - 1],) * 2]

    def pair(self, a: int, b: int) -> tuple[int, int]:
        """Offset of the block coupling block numbers a, b, and 1 when a is its row."""
        i, j = int(self.position[a]), int(self.position[b])
        return self.offsets[(max(i, j), min(i, j))], int(i > j)

    def coupling(self, a: int, b: int) -> tuple[int, int]:
        """Offset of the block coupling nodes a, b and 1 when a is its row; (-1, 0) when there is none."""
        return (-1, 0) if min(a, b) == 0 or a == b else self.pair(a - 1, b - 1)


def _pack_members(members: Sequence[Member], places: Places) -> tuple[Members, np.ndarray]:
    values: list[np.ndarray] = []
    seen: dict[bytes, int] = {}
    at, total = [], 0
    for m in members:
        key = m.value.tobytes()
        if key not in seen or m.kind == LINEAR:
            seen[key] = total
            values.append(m.value)
            total += len(m.value)
        at.append(seen[key])
    block = [
        [places.diagonal(m.nodes[0]), places.diagonal(m.nodes[1]), *places.coupling(*m.nodes)]
        for m in members
    ]
    number = np.zeros((len(members), 4), np.int64)
    for row, m in zip(number, members, strict=True):
        row[: len(m.number)] = m.number
    packed = Members(
        kind=np.array([m.kind for m in members], np.int64),
        node=np.array([m.nodes for m in members], np.int64).reshape(-1, 2),
        offset=np.array([m.offset for m in members], float).reshape(-1, 2, 3),
        frame=np.array([m.frame for m in members], float).reshape(-1, 2, 3, 3),
        number=number,
        value_at=np.array(at, np.int64),
        value=np.concatenate([*values, np.zeros(1)]),
        inner_at=np.cumsum([0] + [len(m.inner) for m in members]).astype(np.int64),
        store_at=np.cumsum([0] + [m.store for m in members]).astype(np.int64),
        length=np.array([m.length for m in members], float),
        floor=np.array([m.floor for m in members], float),
        block=np.array(block, np.int64).reshape(-1, 4),
    )
    return packed, np.concatenate([np.zeros(0), *[m.inner for m in members]])


NO_SPRINGS = _pack_members((), Places({}, np.zeros(0, np.int64)))[0]
"""What all models without springs share."""


def _pack_rows(rows: Sequence[Row], places: Places, nodes: int, start: np.ndarray) -> Terms:
    first, flat, block, flip = [0], [], [], []
    for i, row in enumerate(rows):
        for term in row.terms:
            a, b = term[2], term[3]
            ends = [-1 if k == 0 else places.pair(nodes - 1 + i, k - 1)[0] for k in (a, b)]
            offset, turned = places.coupling(a, b)
            block.append([*ends, places.diagonal(a), places.diagonal(b), offset])
            flip.append(turned)
            flat.append(term)
        first.append(len(flat))
    return Terms(
        first=np.array(first, np.int64),
        start=start,
        coefficient=np.array([t[0] for t in flat], float),
        kind=np.array([t[1] for t in flat], np.int64),
        node=np.array([t[2:4] for t in flat], np.int64).reshape(-1, 2),
        direction=np.array([t[4] for t in flat], float).reshape(-1, 3),
        point=np.array([t[5:7] for t in flat], float).reshape(-1, 2, 3),
        block=np.array(block, np.int64).reshape(-1, 5),
        flip=np.array(flip, np.int64),
    )


def _pack_loads(pushes: Sequence[Push], places: Places) -> Loads:
    return Loads(
        node=np.array([p.node for p in pushes], np.int64),
        point=np.array([p.point for p in pushes], float).reshape(-1, 3),
        force=np.array([p.force for p in pushes], float).reshape(-1, 3),
        moment=np.array([p.moment for p in pushes], float).reshape(-1, 3),
        following=np.array([int(p.following) for p in pushes], np.int64),
        skew=np.array([int(p.following or np.any(p.moment)) for p in pushes], np.int64),
        block=np.array([places.diagonal(p.node) for p in pushes], np.int64),
    )


def _weight(parts: Assembly) -> np.ndarray:
    """Mass of every member and the gravity that pulls at it (m, 4); (0, 4) where none weighs anything."""
    if parts.gravity is None or not any(m.mass for m in parts.members):
        return np.zeros((0, 4))
    return np.array([[m.mass, *parts.gravity] for m in parts.members])


def spread(places: np.ndarray, offset: np.ndarray, node: np.ndarray) -> np.ndarray:
    """(D,): largest extent along an axis of the nodes at places (D, k, 3) and of the ends of members on them, offset
    (D, m, 2, 3), node (m, 2); ground, node 0, counts by those alone: a mechanism far from its origin is no larger."""
    ends = (places[:, node] + offset).reshape(len(places), -1, 3)
    seen = np.concatenate([ends, places[:, 1:]], axis=1)
    return np.ptp(seen, axis=1).max(axis=1) if seen.shape[1] else np.zeros(len(places))


def pack(parts: Assembly) -> tuple[Arrays, Motion]:
    """Arrays of a mechanism and its rest state. Nodes 1.. get six unknowns each, every row one multiplier."""
    nodes, rows = len(parts.reference), len(parts.rows)
    size = np.array([6] * (nodes - 1) + [1] * rows, np.int64)
    waits = np.arange(len(size)) >= nodes - 1
    plan, position, offsets = plan_blocks(size, _pairs(parts, nodes), waits=waits, last=parts.last)
    places = Places(offsets, position)
    start = np.full(nodes, -1, np.int64)
    start[1:] = plan.start[position[: nodes - 1]]
    members, inner = _pack_members(parts.members, places)
    springs = _pack_members(parts.springs, places)[0] if parts.springs else NO_SPRINGS
    extent = spread(np.asarray(parts.reference, float)[None], members.offset[None], members.node)[0]
    length = float(max(extent, members.length.max(initial=0.0)))
    arrays = Arrays(
        plan,
        start,
        members,
        _pack_rows(parts.rows, places, nodes, plan.start[position[nodes - 1 :]]),
        _pack_loads(parts.pushes, places),
        length,
        springs,
        max((strain_scratch(m.number) for m in parts.members if m.kind == STRAIN), default=0),
        _weight(parts),
        np.arange(6),
    )
    rest = Motion(np.array(parts.reference, float), np.tile(np.eye(3), (nodes, 1, 1)), inner, np.zeros(rows))
    return arrays, rest
