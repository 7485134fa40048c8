"""The integers of a model, and its arrays from a list of members.

`topology_arrays` lays out what follows from the topology and not from numbers; `ksd.model.template` fills in the numbers of
many designs, `pack` those of members made one by one.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import accumulate, pairwise
from typing import Any, NamedTuple

import numpy as np

from ksd.model.arrays import (
    LENGTH,
    LINEAR,
    MEMBERS,
    VALUE,
    Arrays,
    FlatArrays,
    Loads,
    Members,
    State,
    Terms,
)
from ksd.numerics.blocks import Blocks, plan_blocks


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
    stiffness_scale: float
    mass: float = 0.0


class MemberTopology(NamedTuple):
    """What of a member does not depend on numbers: kind, nodes, settings, how many constants, inner states and stored
    numbers, and its group: members of one group have the same constants."""

    kind: int
    nodes: tuple[int, int]
    number: tuple[int, ...]
    values: int
    inner: int
    store: int
    group: int


TermTopology = tuple[int, int, int]
"""Kind, base node and node of a term of a constraint row."""
LoadTopology = tuple[int, bool, bool]
"""Node of a load, whether it turns with it, and whether its tangent has a skew part."""


class BlockOffsets:
    """Offsets of stored blocks by (node or row) pairs; -1 where an end is fixed."""

    def __init__(self, offsets: dict[tuple[int, int], int], position: np.ndarray) -> None:
        self.offsets, self.position = offsets, position.tolist()

    def diagonal(self, node: int) -> int:
        """Offset of the block of `node` itself."""
        return -1 if node == 0 else self.offsets[(self.position[node - 1],) * 2]

    def pair(self, a: int, b: int) -> tuple[int, int]:
        """Offset of the block coupling block numbers a, b, and 1 when a is its row."""
        i, j = self.position[a], self.position[b]
        return self.offsets[(max(i, j), min(i, j))], int(i > j)

    def coupling(self, a: int, b: int) -> tuple[int, int]:
        """Offset of the block coupling nodes a, b and 1 when a is its row; (-1, 0) when there is none."""
        return (-1, 0) if min(a, b) == 0 or a == b else self.pair(a - 1, b - 1)

    def member(self, a: int, b: int) -> list[int]:
        """Stored blocks (4,) of a member between nodes, see `Members`."""
        return [self.diagonal(a), self.diagonal(b), *self.coupling(a, b)]

    def term(self, row: int, a: int, b: int) -> tuple[list[int], int]:
        """Stored blocks (5,) of a term of constraint block `row` between nodes, and its flip, see `Terms`."""
        ends = [-1 if k == 0 else self.pair(row, k - 1)[0] for k in (a, b)]
        offset, turned = self.coupling(a, b)
        return [*ends, self.diagonal(a), self.diagonal(b), offset], turned


def coupled_blocks(
    nodes: int, members: Iterable[Sequence[int]], rows: Iterable[Sequence[TermTopology]]
) -> list[tuple[int, int]]:
    """Coupled blocks: block b of node k is k - 1, constraint i is nodes - 1 + i; ground has none."""
    found = [(a - 1, b - 1) for a, b in members if a > 0 and b > 0]
    for i, row in enumerate(rows):
        for _, a, b in row:
            found += [(k - 1, nodes - 1 + i) for k in (a, b) if k > 0]
            if min(a, b) > 0 and a != b:
                found.append((a - 1, b - 1))
    return found


def number_unknowns(
    nodes: int, width: int, pairs: list[tuple[int, int]], rows: int, last: int = 0
) -> tuple[Blocks, BlockOffsets, np.ndarray, np.ndarray]:
    """Plan of `width` unknowns per node and one multiplier per row, offsets of its blocks, first unknown of every node, -1
    for ground, and of every row."""
    size = np.array([width] * (nodes - 1) + [1] * rows, np.int64)
    waits = np.arange(len(size)) >= nodes - 1
    plan, position, offsets = plan_blocks(size, pairs, waits=waits, last=last)
    start = np.full(nodes, -1, np.int64)
    start[1:] = plan.start[position[: nodes - 1]]
    return plan, BlockOffsets(offsets, position), start, plan.start[position[nodes - 1 :]]


def _members(shapes: Sequence[MemberTopology], places: BlockOffsets) -> Members:
    """Integers of members; the floats are zero."""
    first: dict[int, int] = {}
    at, total, count = [], 0, len(shapes)
    for m in shapes:
        if m.group not in first:
            first[m.group] = total
            total += m.values
        at.append(first[m.group])
    number = np.zeros((count, 4), np.int64)
    for row, m in zip(number, shapes, strict=True):
        row[: len(m.number)] = m.number
    return Members(
        kind=np.array([m.kind for m in shapes], np.int64),
        node=np.array([m.nodes for m in shapes], np.int64).reshape(-1, 2),
        offset=np.zeros((count, 2, 3)),
        frame=np.zeros((count, 2, 3, 3)),
        number=number,
        value_at=np.array(at, np.int64),
        value=np.zeros(total + 1),
        inner_at=np.cumsum([0] + [m.inner for m in shapes]).astype(np.int64),
        store_at=np.cumsum([0] + [m.store for m in shapes]).astype(np.int64),
        length=np.zeros(count),
        stiffness_scale=np.zeros(count),
        block=np.array([places.member(*m.nodes) for m in shapes], np.int64).reshape(-1, 4),
    )


NO_SPRINGS = _members((), BlockOffsets({}, np.zeros(0, np.int64)))
"""What all models without springs share."""


def _terms(
    rows: Sequence[Sequence[TermTopology]], places: BlockOffsets, nodes: int, start: np.ndarray
) -> Terms:
    """Integers of constraint rows; the floats are zero."""
    found = [places.term(nodes - 1 + i, a, b) for i, row in enumerate(rows) for _, a, b in row]
    flat = [term for row in rows for term in row]
    return Terms(
        first=np.cumsum([0] + [len(row) for row in rows]).astype(np.int64),
        start=start,
        coefficient=np.zeros(len(flat)),
        kind=np.array([t[0] for t in flat], np.int64),
        node=np.array([t[1:] for t in flat], np.int64).reshape(-1, 2),
        direction=np.zeros((len(flat), 3)),
        point=np.zeros((len(flat), 2, 3)),
        block=np.array([block for block, _ in found], np.int64).reshape(-1, 5),
        flip=np.array([turned for _, turned in found], np.int64),
    )


def _loads(shapes: Sequence[LoadTopology], places: BlockOffsets) -> Loads:
    """Integers of loads; the floats are zero."""
    count = len(shapes)
    return Loads(
        node=np.array([s[0] for s in shapes], np.int64),
        point=np.zeros((count, 3)),
        force=np.zeros((count, 3)),
        moment=np.zeros((count, 3)),
        following=np.array([s[1] for s in shapes], np.int64),
        skew=np.array([s[2] for s in shapes], np.int64),
        block=np.array([places.diagonal(s[0]) for s in shapes], np.int64),
    )


def topology_arrays(
    nodes: int,
    members: Sequence[MemberTopology],
    rows: Sequence[Sequence[TermTopology]] = (),
    loads: Sequence[LoadTopology] = (),
    springs: Sequence[MemberTopology] = (),
    *,
    last: int = 0,
) -> Arrays:
    """Arrays of the topology of a mechanism, whose floats are all still zero. Nodes 1.. get six unknowns each, every row one
    multiplier; the `last` nodes are eliminated last."""
    pairs = coupled_blocks(nodes, (m.nodes for m in (*members, *springs)), rows)
    plan, places, start, row_start = number_unknowns(nodes, 6, pairs, len(rows), last)
    return Arrays(
        plan,
        start,
        _members(members, places),
        _terms(rows, places, nodes, row_start),
        _loads(loads, places),
        0.0,
        _members(springs, places) if springs else NO_SPRINGS,
        np.zeros((0, 4)),
        np.arange(6),
    )


MEMBER_FLOATS = ("offset", "frame", "value", "length", "stiffness_scale")
TERM_FLOATS = ("coefficient", "direction", "point")
LOAD_FLOATS = ("point", "force", "moment")
_PART = {name: k for k, name in enumerate(Arrays._fields)}
_FLOATS = {"members": MEMBER_FLOATS, "terms": TERM_FLOATS, "loads": LOAD_FLOATS, "springs": MEMBER_FLOATS}


def float_fields(arrays: Arrays) -> list[np.ndarray]:
    """The fields of numbers, in the order of `FlatArrays.floats` behind the size."""
    found = [getattr(getattr(arrays, part), name) for part, names in _FLOATS.items() for name in names]
    return [*found, arrays.weight]


def _places(topology: Arrays) -> list[tuple[int, list[tuple[int, slice, tuple[int, ...]]]]]:
    """Of the parts with numbers, by their places in `Arrays`: number in its part, place in `FlatArrays.floats` and shape of
    the fields that are not empty."""
    at, found = 1, []
    for part, names in _FLOATS.items():
        own = getattr(topology, part)
        fields = [getattr(own, name) for name in names]
        ends = list(accumulate((field.size for field in fields), initial=at))
        filled = [
            (own._fields.index(name), slice(*ends[k : k + 2]), field.shape)
            for k, (name, field) in enumerate(zip(names, fields, strict=True))
            if field.size
        ]
        if filled:
            found.append((_PART[part], filled))
        at = ends[-1]
    return found


def replace_floats(topology: Arrays, floats: np.ndarray) -> Arrays:
    """Arrays with the integers of `topology`, which are shared, and other numbers, laid out as `FlatArrays.floats`: a third
    of the time of `opened`, which makes views of the integers too."""
    places = topology.__dict__.get("places")
    if places is None:
        places = topology.__dict__["places"] = _places(topology)
    made: list[Any] = list(topology)
    for part, fields in places:
        own = list(made[part])
        for k, at, shape in fields:
            own[k] = floats[at].reshape(shape)
        made[part] = made[part]._make(own)
    made[_PART["size"]] = float(floats[0])
    if topology.weight.size:
        made[_PART["weight"]] = floats[-topology.weight.size :].reshape(-1, 4)
    arrays = Arrays._make(made)
    arrays.flat = FlatArrays(topology.flat.ints, floats, topology.flat.member_kinds)
    return arrays


def replace_constants(arrays: Arrays, topology: Arrays, value: np.ndarray) -> Arrays:
    """The arrays with the integers of `topology`, and the constants `value` (v,) in the place of those of their members;
    what else there is of numbers is the same in both."""
    return replace_floats(
        topology, floats_with_constants(arrays.flat.ints, arrays.flat.floats[None], value[None])[0]
    )


def floats_with_constants(ints: np.ndarray, floats: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Numbers (D, f) of D designs, as in `FlatArrays` with these ints, with the constants `value` (D, v) in the place of
    those of their members."""
    # of the fields of numbers, lengths come next
    first, end = ints[MEMBERS + VALUE], ints[MEMBERS + LENGTH]
    return np.concatenate([floats[:, :first], value, floats[:, end:]], axis=1)


def largest_extent(places: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """(D,): largest extent along an axis of the nodes at places (D, k, 3) and of the ends of members (D, m, 2, 3); ground,
    node 0, counts by those alone: a mechanism far from its origin is no larger."""
    seen = np.concatenate([ends.reshape(len(places), -1, 3), places[:, 1:]], axis=1)
    return (seen.max(axis=1) - seen.min(axis=1)).max(axis=1) if seen.shape[1] else np.zeros(len(places))


def _shapes(members: Sequence[Member]) -> list[MemberTopology]:
    """Shapes of members; those of equal constants are a group."""
    known: dict[bytes, int] = {}
    found = []
    for i, m in enumerate(members):
        key = str(i).encode() if m.kind == LINEAR else m.value.tobytes()
        number = tuple(m.number.tolist())
        group = known.setdefault(key, i)
        found.append(MemberTopology(m.kind, m.nodes, number, len(m.value), len(m.inner), m.store, group))
    return found


def _filled(packed: Members, members: Sequence[Member]) -> Members:
    """Integers of members with their numbers."""
    value = packed.value.copy()
    for at, m in zip(packed.value_at, members, strict=True):
        value[at : at + len(m.value)] = m.value
    return packed._replace(
        offset=np.array([m.offset for m in members], float).reshape(-1, 2, 3),
        frame=np.array([m.frame for m in members], float).reshape(-1, 2, 3, 3),
        value=value,
        length=np.array([m.length for m in members], float),
        stiffness_scale=np.array([m.stiffness_scale for m in members], float),
    )


def pack_members(
    reference: np.ndarray, members: Sequence[Member], *, springs: Sequence[Member] = (), like: Arrays | None = None
) -> tuple[Arrays, State]:  # fmt: skip
    """Arrays of a mechanism given by its members and springs, without weight, and its rest state.

    reference (k, 3): positions of all nodes, node 0 fixed; like: of a model whose constraint rows and loads it has, on nodes
    of the same numbers.
    """
    rows: list[list[TermTopology]] = []
    pushes: list[LoadTopology] = []
    if like is not None:
        flat = list(zip(like.terms.kind.tolist(), *like.terms.node.T.tolist(), strict=True))
        rows = [flat[a:b] for a, b in pairwise(like.terms.first.tolist())]
        pushes = list(
            zip(*(f.tolist() for f in (like.loads.node, like.loads.following, like.loads.skew)), strict=True)
        )
    nodes = len(reference)
    laid = topology_arrays(nodes, _shapes(members), rows, pushes, _shapes(springs))
    filled = _filled(laid.members, members)
    extent = largest_extent(reference[None], (reference[filled.node] + filled.offset)[None])[0]
    arrays = laid._replace(
        members=filled,
        size=float(max(extent, filled.length.max(initial=0.0))),
        springs=_filled(laid.springs, springs) if springs else laid.springs,
    )
    if like is not None:
        arrays = arrays._replace(
            terms=laid.terms._replace(**{name: getattr(like.terms, name) for name in TERM_FLOATS}),
            loads=laid.loads._replace(**{name: getattr(like.loads, name) for name in LOAD_FLOATS}),
        )
    inner = np.concatenate([np.zeros(0), *[m.inner for m in members]])
    return arrays, State(reference, np.tile(np.eye(3), (nodes, 1, 1)), inner, np.zeros(len(rows)))
