"""The frozen flat arrays a model is made of, as the compiled kernels read them.

Node 0 is ground. Node frames are identity at rest, so a point of a link is x + R s with s its offset at rest
from the link's reference point. Lengths m, forces N, moments Nm, angles rad.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from ksd.numerics.blocks import Blocks, unflatten_blocks
from ksd.numerics.kernel import kernel

STRAIN, COROTATIONAL, LINEAR, COIL, TORSION, MODAL, SOLID, PLANAR = 0, 1, 2, 3, 4, 5, 6, 7
TRANSLATION, ROTATION = 0, 1


class Members(NamedTuple):
    """Everything elastic: m members, each between end p on node[:, 0] and end q on node[:, 1].

    offset (m, 2, 3): end minus node reference point, in node axes; frame (m, 2, 3, 3): end axes (columns) in node
    axes; number (m, 4), value (flat) from value_at (m,): settings and constants; inner_at, store_at (m+1,): where
    inner state and what is kept from assembly to update sit; length (m,), floor (m,): EA/L [N/m]; block (m, 4):
    offsets of the stored blocks pp, qq, and coupling, -1 when an end is fixed, last: 1 when the coupling is stored as
    (p, q).
    """

    kind: np.ndarray
    node: np.ndarray
    offset: np.ndarray
    frame: np.ndarray
    number: np.ndarray
    value_at: np.ndarray
    value: np.ndarray
    inner_at: np.ndarray
    store_at: np.ndarray
    length: np.ndarray
    stiffness_scale: np.ndarray
    block: np.ndarray


class Terms(NamedTuple):
    """Constraint rows (c of them) as sums of terms; row i owns terms first[i] .. first[i+1]-1.

    Term: coefficient, kind, nodes (base, node), direction (3,) fixed in base, points (2, 3) as offsets in the
    axes of base and node. start (c,): unknown of the multiplier. block (t, 5): offsets of the rows coupling the
    multiplier with base and node, and of the node blocks base-base, node-node, coupling; flip (t,) as in Members; start is
    -1 for a row that is left out.
    """

    first: np.ndarray
    start: np.ndarray
    coefficient: np.ndarray
    kind: np.ndarray
    node: np.ndarray
    direction: np.ndarray
    point: np.ndarray
    block: np.ndarray
    flip: np.ndarray


class Loads(NamedTuple):
    """Forces and moments on nodes: node (l,), point (l, 3), force (l, 3), moment (l, 3), following (l,) 0 or 1.

    skew (l,): 1 where the tangent of the load has a skew part (`ksd.model.nonconservative`): it is not conservative.
    """

    node: np.ndarray
    point: np.ndarray
    force: np.ndarray
    moment: np.ndarray
    following: np.ndarray
    skew: np.ndarray
    block: np.ndarray


class ArrayFields(NamedTuple):
    """One mechanism as numbers. start (k,): first unknown of each node, -1 when fixed; size: length scale [m].

    springs: what resists without inner unknowns, packed as members: kind COIL with value (stiffness [N/m], free length
    [m]), TURN with (stiffness [Nm/rad], rest angle [rad]) about e3 of end p, LINEAR with the constants of
    `ksd.beam.linear`. Their rows of Work.lam and Work.pose follow those of the members. keep (w,): which of x, y, z, rx,
    ry, rz of every node are unknown: all six, or three in a plane (`ksd.model.plane`). weight (m, 4): mass of every member
    [kg], 0 where it weighs nothing, and the gravity that pulls at it [m/s^2]; (0, 4) where no member has weight.
    """

    plan: Blocks
    start: np.ndarray
    members: Members
    terms: Terms
    loads: Loads
    size: float
    springs: Members
    weight: np.ndarray
    active_dofs: np.ndarray


class Arrays(ArrayFields):
    """`Fields` as Python holds them. flat: all of them as compiled code takes them, see `FlatArrays`."""

    flat: FlatArrays

    def __getattr__(self, name: str) -> Any:
        # made when first asked for; fields that were replaced since make another one
        if name != "flat":
            raise AttributeError(name)
        self.flat = flatten_arrays(self)
        return self.flat

    def __reduce__(self) -> Any:
        return unflatten_arrays, (self.flat,)


LEAF_MEMBERS, BEAM_MEMBERS, ALL_MEMBERS = range(3)


class FlatArrays(NamedTuple):
    """`Arrays` in two, for compiled code: ints = counts, then where every field begins, and the fields of whole numbers;
    floats = size and the other fields. members: LEAVES where all members are strain-mode leaves or linear, without weight,
    there are no springs, and no load has a skew tangent; ANY where one is a modal body or a solid; else BEAMS.

    Kernels read a field by the place where it begins, which costs nothing, and no look into a named tuple, which counts the
    users of an array: entry c of row i of a field f of w columns is ints[ints[f] + w i + c], or that of floats.
    """

    ints: np.ndarray
    floats: np.ndarray
    member_kinds: int


class KernelArrays(NamedTuple):
    """`Arrays` of which there is nothing but what compiled code takes, and the weight of its members."""

    flat: FlatArrays
    weight: np.ndarray


NODES, MEMBER_COUNT, ROWS, LOADS, SPRING_COUNT, DOFS_PER_NODE, PLAN, START, MEMBERS = range(9)
KIND, NODE, OFFSET, FRAME, NUMBER, VALUE_AT, VALUE, INNER_AT, STORE_AT, LENGTH, STIFFNESS_SCALE, BLOCK = (
    range(12)
)
"""Fields of members, counted from MEMBERS, and of springs, from SPRINGS."""
TERM_FIRST, TERM_START, TERM_COEFFICIENT, TERM_KIND, TERM_NODE = range(20, 25)
TERM_DIRECTION, TERM_POINT, TERM_BLOCK, TERM_FLIP = range(25, 29)
LOAD_NODE, LOAD_POINT, LOAD_FORCE, LOAD_MOMENT, LOAD_FOLLOWING, LOAD_SKEW, LOAD_BLOCK = range(29, 36)
SPRINGS, WEIGHT, ACTIVE_DOFS, FLOATS = 36, 48, 49, 50
"""Where, in `FlatArrays.ints`, counts stand, the places of fields and, last, how many floats there are."""


def _leaves(part: Any) -> Iterator[np.ndarray]:
    for field in part:
        if isinstance(field, Blocks):
            yield field.ints
        elif isinstance(field, np.ndarray):
            yield field
        elif isinstance(field, tuple):
            yield from _leaves(field)


def join_fields(
    counts: Sequence[int], first: Sequence[float], fields: Iterable[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Copies of fields in two arrays: counts, where every field begins, how many floats there are, and the fields of whole
    numbers; the numbers `first`, and the other fields."""
    fields = list(fields)
    ints, floats, places = [], [np.array(first, float)], []
    at, to = len(counts) + len(fields) + 1, len(first)
    for field in fields:
        if field.dtype == np.int64:
            places.append(at)
            ints.append(field.reshape(-1))
            at += field.size
        else:
            places.append(to)
            floats.append(field.reshape(-1))
            to += field.size
    return np.concatenate([np.array([*counts, *places, to], np.int64), *ints]), np.concatenate(floats)


def flatten_arrays(arrays: ArrayFields) -> FlatArrays:
    """A copy of the fields, one after the other."""
    counts = (
        len(arrays.start), len(arrays.members.kind), len(arrays.terms.start), len(arrays.loads.node),
        len(arrays.springs.kind), len(arrays.active_dofs),
    )  # fmt: skip
    return FlatArrays(*join_fields(counts, (arrays.size,), _leaves(arrays)), _members_of(arrays))


def _members_of(arrays: ArrayFields) -> int:
    """`FlatArrays.member_kinds`."""
    kind = arrays.members.kind
    if np.isin(kind, (MODAL, SOLID)).any():
        return ALL_MEMBERS
    leaves = np.isin(kind, (STRAIN, PLANAR, LINEAR)).all()
    more = len(arrays.weight) or len(arrays.springs.kind) or arrays.loads.skew.any()
    return LEAF_MEMBERS if leaves and not more else BEAM_MEMBERS


_INT, _FLOAT = 0, 1
_MEMBER_ROWS = (
    (_INT, ()), (_INT, (2,)), (_FLOAT, (2, 3)), (_FLOAT, (2, 3, 3)), (_INT, (4,)), (_INT, ()), (_FLOAT, ()), (_INT, ()),
    (_INT, ()), (_FLOAT, ()), (_FLOAT, ()), (_INT, (4,)),
)  # fmt: skip
_TERM_ROWS = (
    (_INT, ()), (_INT, ()), (_FLOAT, ()), (_INT, ()), (_INT, (2,)), (_FLOAT, (3,)), (_FLOAT, (2, 3)), (_INT, (5,)),
    (_INT, ()),
)  # fmt: skip
_LOAD_ROWS = (
    (_INT, ()), (_FLOAT, (3,)), (_FLOAT, (3,)), (_FLOAT, (3,)), (_INT, ()), (_INT, ()), (_INT, ()),
)  # fmt: skip
_ROWS = (
    (_INT, ()), (_INT, ()), *_MEMBER_ROWS, *_TERM_ROWS, *_LOAD_ROWS, *_MEMBER_ROWS, (_FLOAT, (4,)), (_INT, ()),
)  # fmt: skip
"""Of every field its kind of number and the shape of its rows."""


def unflatten_arrays(flat: FlatArrays) -> Arrays:
    """Arrays whose fields are views of `flat`: what is written into them is what compiled code reads."""
    sources, ends = (flat.ints, flat.floats), [len(flat.ints), len(flat.floats)]
    views: list[np.ndarray] = []
    for (kind, shape), place in zip(reversed(_ROWS), reversed(flat.ints[PLAN:FLOATS].tolist()), strict=True):
        part = sources[kind][place : ends[kind]]
        views.append(part.reshape(-1, *shape) if shape else part)
        ends[kind] = place
    views.reverse()
    members, terms, loads, springs = 2, 14, 23, 30
    arrays = Arrays(
        unflatten_blocks(views[0]),
        views[1],
        Members(*views[members:terms]),
        Terms(*views[terms:loads]),
        Loads(*views[loads:springs]),
        float(flat.floats[0]),
        Members(*views[springs:-2]),
        *views[-2:],
    )
    arrays.flat = flat
    return arrays


def carries_load(arrays: Arrays) -> bool:
    """Whether there are loads on links or leaf springs with weight."""
    return len(arrays.loads.node) > 0 or len(arrays.weight) > 0


class State(NamedTuple):
    """Where a mechanism is: positions (k, 3) [m], rotations (k, 3, 3), inner states (flat), multipliers (c,)."""

    x: np.ndarray
    R: np.ndarray
    inner: np.ndarray
    multiplier: np.ndarray

    def copy(self) -> State:
        """An independent copy."""
        return State(self.x.copy(), self.R.copy(), self.inner.copy(), self.multiplier.copy())

    def assign(self, other: State) -> None:
        """Take over the numbers of `other`, in place."""
        for mine, theirs in zip(self, other, strict=True):
            mine[...] = theirs


class Workspace(NamedTuple):
    """Storage prepared once per model: views of one array of numbers, `flat`; at: where each begins in it, and near_at.

    value, spare: block matrix and its scaled rows; rhs (n,): residual, then the step; store: what members keep
    from assembly to update; lam (m, 12): end wrenches; pose (m, 18): frame p (9), lever of q about node p, lever
    of q, d; scale (k, 2): sums of force and moment norms at each node. near (flat), from near_at (m+1,): element
    and node rotation vectors of the near configuration of paper 1, empty except in the substructures. weight: as in
    `Arrays`, with the gravity of every substructure in the axes of its A.
    """

    matrix: np.ndarray
    scaled_rows: np.ndarray
    rhs: np.ndarray
    store: np.ndarray
    lam: np.ndarray
    pose: np.ndarray
    scale: np.ndarray
    linearisation: np.ndarray
    linearisation_at: np.ndarray
    weight: np.ndarray
    flat: np.ndarray
    at: np.ndarray


def unflatten_workspace(flat, at):  # type: ignore[no-untyped-def]
    """The fields of `Workspace`."""
    return Workspace(
        flat[: at[0]], flat[at[0] : at[1]], flat[at[1] : at[2]], flat[at[2] : at[3]],
        flat[at[3] : at[4]].reshape(-1, 12), flat[at[4] : at[5]].reshape(-1, 18), flat[at[5] : at[6]].reshape(-1, 2),
        flat[at[6] : at[7]], at[9:], flat[at[7] : at[8]].reshape(-1, 4), flat, at,
    )  # fmt: skip


unflatten_workspace_kernel = kernel(unflatten_workspace)
"""`open_work` for kernels."""


def make_workspace(arrays: Arrays, *, near: np.ndarray | None = None) -> Workspace:
    """Storage for one thread working on `arrays`; `near` (m,) lengths of the near configurations, if any."""
    members, count = arrays.members, len(arrays.members.kind)
    linearisation_at = [0] * (count + 1) if near is None else [0, *accumulate(near.tolist())]
    rows = count + len(arrays.springs.kind)
    sizes = (
        arrays.plan.values, arrays.plan.values, arrays.plan.unknowns, int(members.store_at[-1]), 12 * rows, 18 * rows,
        2 * len(arrays.start), linearisation_at[-1], arrays.weight.size,
    )  # fmt: skip
    at = np.array([*accumulate(sizes), *linearisation_at], np.int64)
    work = unflatten_workspace(np.zeros(at[8]), at)
    work.weight[:] = arrays.weight
    return work
