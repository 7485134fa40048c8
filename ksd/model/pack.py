"""Integer arrays of a model from its topology, and its arrays from a list of members.

`topology_arrays` makes the integers, which follow from the topology; the floats are filled in by `ksd.model.template` for
many designs, and by `pack_members` from a list of members.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ksd.model.arrays import (
    LINEAR,
    LOAD_NUMBERS,
    MEMBER,
    NO_BODIES,
    SETTINGS,
    STRAIN,
    Arrays,
    Loads,
    Members,
    State,
    Terms,
    angle_count,
    arrays_of,
    copy_floats,
)
from ksd.numerics.blocks import Blocks, plan_blocks


@dataclass(frozen=True)
class Member:
    """One elastic body between two nodes, before packing; fields as in `ksd.model.arrays.Members`.

    offset (2, 3) [m], frame (2, 3, 3): ends in the axes of their nodes; value, number: constants and settings; inner: its
    undeformed inner state; store: count of its stored numbers; mass [kg]: 0 for a member without weight.
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
    """The part of a member that does not depend on floats.

    kind, nodes, number: its kind, nodes and settings; values, inner, store: counts of its constants, inner coordinates and
    stored numbers; group: members of one group have the same constants.
    """

    kind: int
    nodes: tuple[int, int]
    number: tuple[int, ...]
    values: int
    inner: int
    store: int
    group: int


MIN_CHAIN = 8
"""Leaf springs in a row from which a chain is long, so that its nodes are carried along in a Newton step."""
TermTopology = tuple[int, int, int]
"""(kind, base node, node) of a term of a constraint row."""
LoadTopology = tuple[int, bool, bool]
"""(node, whether it follows the node, whether its tangent has a skew part) of a load."""


class BlockOffsets:
    """Offsets of the stored blocks of pairs of nodes or rows; -1 where a node is fixed."""

    def __init__(self, offsets: dict[tuple[int, int], int], position: np.ndarray) -> None:
        self.offsets, self.position = offsets, position.tolist()

    def diagonal(self, node: int) -> int:
        """Offset of the diagonal block of `node`."""
        return -1 if node == 0 else self.offsets[(self.position[node - 1],) * 2]

    def pair(self, a: int, b: int) -> tuple[int, int]:
        """Offset of the block that couples blocks number a and b, and 1 where a is its row."""
        i, j = self.position[a], self.position[b]
        return self.offsets[(max(i, j), min(i, j))], int(i > j)

    def coupling(self, a: int, b: int) -> tuple[int, int]:
        """Offset of the block that couples nodes a and b, and 1 where a is its row; (-1, 0) where there is none."""
        return (-1, 0) if min(a, b) == 0 or a == b else self.pair(a - 1, b - 1)

    def member(self, a: int, b: int) -> list[int]:
        """Offsets (4,) of the blocks of a member between nodes a and b, see `Members.block`."""
        return [self.diagonal(a), self.diagonal(b), *self.coupling(a, b)]

    def term(self, row: int, a: int, b: int) -> tuple[list[int], int]:
        """Offsets (5,) of the blocks of a term of constraint block `row` between nodes a and b, and its `Terms.flip`."""
        ends = [-1 if k == 0 else self.pair(row, k - 1)[0] for k in (a, b)]
        offset, turned = self.coupling(a, b)
        return [*ends, self.diagonal(a), self.diagonal(b), offset], turned


def coupled_blocks(
    nodes: int, members: Iterable[Sequence[int]], rows: Iterable[Sequence[TermTopology]]
) -> list[tuple[int, int]]:
    """Pairs of coupled blocks: node k has block k - 1, constraint row i has block nodes - 1 + i, ground has none."""
    pairs = [(a - 1, b - 1) for a, b in members if a > 0 and b > 0]
    for i, row in enumerate(rows):
        for _, a, b in row:
            pairs += [(k - 1, nodes - 1 + i) for k in (a, b) if k > 0]
            if min(a, b) > 0 and a != b:
                pairs.append((a - 1, b - 1))
    return pairs


def number_unknowns(
    nodes: int, width: int, pairs: list[tuple[int, int]], rows: int, last: int = 0
) -> tuple[Blocks, BlockOffsets, np.ndarray, np.ndarray]:
    """Block plan for `width` unknowns per node and one multiplier per row; the `last` blocks are eliminated last.

    Returns the plan, the offsets of its blocks, and the first unknown of every node (-1 for ground) and of every row.
    """
    size = np.array([width] * (nodes - 1) + [1] * rows, np.int64)
    waits = np.arange(len(size)) >= nodes - 1
    plan, position, offsets = plan_blocks(size, pairs, waits=waits, last=last)
    start = np.full(nodes, -1, np.int64)
    start[1:] = plan.start[position[: nodes - 1]]
    return plan, BlockOffsets(offsets, position), start, plan.start[position[nodes - 1 :]]


def renumber(
    arrays: Arrays, active: np.ndarray, rows: Sequence[int], dashpots: Sequence[int] = ()
) -> dict[str, Any]:
    """The fields of `arrays` that follow from the degrees of freedom of nodes `active` (w,) and the constraint rows `rows`
    that have multipliers; dashpots: rows that couple their nodes without one."""
    terms, bodies, nodes = arrays.terms, arrays.bodies, len(arrays.start)
    node, first = terms.node.tolist(), terms.first.tolist()
    own = [[(0, a, b) for a, b in node[first[row] : first[row + 1]]] for row in rows]
    ends = [m.node.tolist() for m in (arrays.members, arrays.springs)]
    pulls = [t for row in dashpots for t in range(first[row], first[row + 1])]
    coupled = [*ends[0], *ends[1], *(node[t] for t in pulls)]
    plan, places, start, start_of_rows = number_unknowns(
        nodes, len(active), coupled_blocks(nodes, coupled, own), len(rows)
    )
    row_start = np.full(len(first) - 1, -1, np.int64)
    row_start[list(rows)] = start_of_rows
    block, flip = np.full((len(node), 5), -1, np.int64), np.zeros(len(node), np.int64)
    for i, row in enumerate(rows):
        for t in range(first[row], first[row + 1]):
            block[t], flip[t] = places.term(nodes - 1 + i, *node[t])
    for t in pulls:
        block[t, 2:4] = [places.diagonal(n) for n in node[t]]
        block[t, 4], flip[t] = places.coupling(*node[t])
    member_block, spring_block = (
        np.array([places.member(a, b) for a, b in pairs], np.int64).reshape(-1, 4) for pairs in ends
    )
    load_block, body_block = (
        np.array([places.diagonal(n) for n in part.node.tolist()], np.int64)
        for part in (arrays.loads, bodies)
    )
    return {
        "plan": plan,
        "start": start,
        "members": arrays.members._replace(block=member_block),
        "terms": terms._replace(start=row_start, block=block, flip=flip),
        "loads": arrays.loads._replace(block=load_block),
        "springs": arrays.springs._replace(block=spring_block),
        "bodies": bodies._replace(block=body_block),
        "active_dofs": active,
    }


def _members(topologies: Sequence[MemberTopology], places: BlockOffsets) -> Members:
    """Members with their integers; the floats are zero."""
    first: dict[int, int] = {}
    at, total, count = [], 0, len(topologies)
    for m in topologies:
        if m.group not in first:
            first[m.group] = total
            total += m.values
        at.append(first[m.group])
    number = np.zeros((count, SETTINGS), np.int64)
    for row, m in zip(number, topologies, strict=True):
        row[: len(m.number)] = m.number
    return Members(
        kind=np.array([m.kind for m in topologies], np.int64),
        node=np.array([m.nodes for m in topologies], np.int64).reshape(-1, 2),
        offset=np.zeros((count, 2, 3)),
        frame=np.zeros((count, 2, 3, 3)),
        number=number,
        value_at=np.array(at, np.int64),
        value=np.zeros(total + (count > 0)),
        inner_at=np.cumsum([0] + [m.inner for m in topologies]).astype(np.int64),
        store_at=np.cumsum([0] + [m.store for m in topologies]).astype(np.int64),
        length=np.zeros(count),
        stiffness_scale=np.zeros(count),
        block=np.array([places.member(*m.nodes) for m in topologies], np.int64).reshape(-1, 4),
    )


def _terms(
    rows: Sequence[Sequence[TermTopology]], places: BlockOffsets, nodes: int, start: np.ndarray
) -> Terms:
    """Constraint rows with their integers; the floats are zero."""
    blocks = [places.term(nodes - 1 + i, a, b) for i, row in enumerate(rows) for _, a, b in row]
    flat = [term for row in rows for term in row]
    return Terms(
        first=np.cumsum([0] + [len(row) for row in rows]).astype(np.int64),
        start=start,
        coefficient=np.zeros(len(flat)),
        kind=np.array([t[0] for t in flat], np.int64),
        node=np.array([t[1:] for t in flat], np.int64).reshape(-1, 2),
        direction=np.zeros((len(flat), 3)),
        point=np.zeros((len(flat), 2, 3)),
        block=np.array([block for block, _ in blocks], np.int64).reshape(-1, 5),
        flip=np.array([turned for _, turned in blocks], np.int64),
        damping=np.zeros(len(rows)),
    )


def _loads(topologies: Sequence[LoadTopology], places: BlockOffsets) -> Loads:
    """Loads with their integers; the floats are zero."""
    count = len(topologies)
    return Loads(
        node=np.array([s[0] for s in topologies], np.int64),
        point=np.zeros((count, 3)),
        force=np.zeros((count, 3)),
        moment=np.zeros((count, 3)),
        following=np.array([s[1] for s in topologies], np.int64),
        skew=np.array([s[2] for s in topologies], np.int64),
        block=np.array([places.diagonal(s[0]) for s in topologies], np.int64),
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
    """Arrays of a mechanism with all integers, whose floats are zero.

    nodes: their count, with ground; nodes 1.. have six unknowns each, every constraint row has one multiplier; the `last`
    nodes are eliminated last.
    """
    pairs = coupled_blocks(nodes, (m.nodes for m in (*members, *springs)), rows)
    plan, places, start, row_start = number_unknowns(nodes, 6, pairs, len(rows), last)
    return arrays_of(
        size=0.0, plan=plan, start=start, members=_members(members, places), terms=_terms(rows, places, nodes, row_start),
        loads=_loads(loads, places), springs=_members(springs, places), weight=np.zeros((0, LOAD_NUMBERS)),
        active_dofs=np.arange(6),
        carried=_carried_nodes(nodes, members, rows), bodies=NO_BODIES, known=np.zeros((0, 12)), rates=np.zeros(2),
    )  # fmt: skip


def _carried_nodes(
    nodes: int, members: Sequence[MemberTopology], rows: Sequence[Sequence[TermTopology]]
) -> np.ndarray:
    """`Arrays.carried`, along strain-mode leaf springs from ground and from the nodes of constraint rows, which move as the
    rows demand; empty where no node is MIN_CHAIN leaf springs away from these."""
    neighbours: list[list[int]] = [[] for _ in range(nodes)]
    for m in members:
        if m.kind == STRAIN:
            a, b = m.nodes
            neighbours[a].append(b)
            neighbours[b].append(a)
    depth = dict.fromkeys([0, *(node for row in rows for _, *ends in row for node in ends)], 0)
    carried, front = [], list(depth)
    for node in front:
        for other in neighbours[node]:
            if other not in depth:
                depth[other] = depth[node] + 1
                carried.append((other, node))
                front.append(other)
    if max(depth.values()) < MIN_CHAIN:
        carried = []
    return np.array(carried, np.int64).reshape(-1, 2)


def replace_constants(arrays: Arrays, topology: Arrays, value: np.ndarray) -> Arrays:
    """The arrays with the integers of `topology` and other constants `value` (v,) of the members.

    All other floats of `arrays` are kept, so both must have the same number of them.
    """
    return Arrays(
        topology.ints, floats_with_constants(arrays.topology, arrays.floats[None], value[None])[0], topology
    )


def floats_with_constants(topology: Arrays, floats: np.ndarray, value: np.ndarray) -> np.ndarray:
    """`floats` (D, f) of D designs of `topology` with other constants `value` (D, v) of the members."""
    first = topology.ints[MEMBER.value]
    return np.concatenate(
        [floats[:, :first], value, floats[:, first + len(topology.members.value) :]], axis=1
    )


def largest_extent(places: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """Largest extent (D,) [m] along a global axis of the nodes (D, k, 3) and the ends of members (D, m, 2, 3).

    The reference point of ground, node 0, is left out, so that the result does not depend on the origin.
    """
    points = np.concatenate([ends.reshape(len(places), -1, 3), places[:, 1:]], axis=1)
    return (points.max(axis=1) - points.min(axis=1)).max(axis=1) if points.shape[1] else np.zeros(len(places))


def _topologies(members: Sequence[Member]) -> list[MemberTopology]:
    """Topologies of members; members with equal constants are one group."""
    groups: dict[bytes, int] = {}
    topologies = []
    for i, m in enumerate(members):
        key = str(i).encode() if m.kind == LINEAR else m.value.tobytes()
        number = tuple(m.number.tolist())
        group = groups.setdefault(key, i)
        topologies.append(MemberTopology(m.kind, m.nodes, number, len(m.value), len(m.inner), m.store, group))
    return topologies


def _fill_members(packed: Members, members: Sequence[Member]) -> None:
    """Write the floats of members into their packed form."""
    for i, m in enumerate(members):
        packed.offset[i], packed.frame[i], packed.length[i] = m.offset, m.frame, m.length
        packed.stiffness_scale[i] = m.stiffness_scale
        packed.value[packed.value_at[i] :][: len(m.value)] = m.value


def pack_members(
    reference: np.ndarray, members: Sequence[Member], *, springs: Sequence[Member] = (), like: Arrays | None = None
) -> tuple[Arrays, State]:  # fmt: skip
    """Arrays of a mechanism without weight, given by its members and springs, and its undeformed state.

    reference (k, 3) [m]: positions of all nodes, node 0 is fixed; like: arrays whose constraint rows and loads are taken
    over, with the same node numbers.
    """
    rows: list[list[TermTopology]] = []
    load_topologies: list[LoadTopology] = []
    if like is not None:
        flat = list(zip(like.terms.kind.tolist(), *like.terms.node.T.tolist(), strict=True))
        rows = [flat[a:b] for a, b in pairwise(like.terms.first.tolist())]
        load_topologies = list(
            zip(*(f.tolist() for f in (like.loads.node, like.loads.following, like.loads.skew)), strict=True)
        )
    nodes = len(reference)
    arrays = topology_arrays(nodes, _topologies(members), rows, load_topologies, _topologies(springs))
    filled = arrays.members
    _fill_members(filled, members)
    _fill_members(arrays.springs, springs)
    extent = largest_extent(reference[None], (reference[filled.node] + filled.offset)[None])[0]
    arrays.floats[0] = max(extent, filled.length.max(initial=0.0))
    if like is not None:
        copy_floats(like.terms, arrays.terms)
        copy_floats(like.loads, arrays.loads)
    inner = np.concatenate([np.zeros(0), *[m.inner for m in members]])
    rotations = np.tile(np.eye(3), (nodes, 1, 1))
    return arrays, State(reference, rotations, inner, np.zeros(len(rows)), np.zeros(angle_count(arrays)))
