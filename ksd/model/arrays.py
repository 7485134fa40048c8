"""The frozen arrays of a model, their flat form for compiled kernels, its state, and the workspace of a thread.

Node 0 is ground. Node frames are the identity in the undeformed configuration, so a point of a link is x + R s, with s its
undeformed offset from the reference point of the link. Lengths m, forces N, moments Nm, angles rad.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from itertools import accumulate
from typing import Any, NamedTuple

import numpy as np

from ksd.numerics.blocks import Blocks, unflatten_blocks
from ksd.numerics.kernel import kernel

STRAIN, COROTATIONAL, LINEAR, COIL, TORSION, MODAL, SOLID, PLANAR = 0, 1, 2, 3, 4, 5, 6, 7
"""Kinds of members and springs: strain-mode leaf, chain, linear body, coil and torsion spring, modal body, polynomial solid,
strain-mode leaf in a plane."""
TRANSLATION, ROTATION, ALIGNMENT = 0, 1, 2
"""Kinds of terms of constraint rows; an alignment is zero where the node has not tilted about `direction`, however far it
has turned about its axis."""


class Members(NamedTuple):
    """m elastic bodies, each between end p on node[:, 0] and end q on node[:, 1].

    kind (m,): STRAIN, ...; offset (m, 2, 3): ends minus the reference points of their nodes, in node axes; frame (m, 2, 3,
    3): end axes (columns) in node axes; number (m, SETTINGS): settings; value (flat), from value_at (m,): constants;
    inner_at, store_at (m+1,): starts of the inner state, and of the numbers stored from assembly to update; length (m,);
    stiffness_scale (m,): EA/L of a leaf [N/m]; block (m, 4): offsets of the stored blocks pp, qq and coupling, -1 where an
    end is fixed, and 1 where the coupling is stored as (p, q).
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
    """c constraint rows as sums of t terms; row i has the terms first[i] .. first[i+1]-1.

    A term has coefficient, kind, node (base, node), direction (3,) fixed in the base, and point (2, 3), offsets in the axes
    of base and node, or twice the axis of an alignment. start (c,): unknown of the multiplier, -1 for a row that is left
    out. block (t, 5): offsets of the blocks that couple the multiplier with base and node, and of the blocks base-base,
    node-node and base-node; flip (t,): 1 where the last one is stored as (base, node).
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
    """l loads on nodes: node (l,), point (l, 3), force (l, 3), moment (l, 3), following (l,): 1 for a follower load.

    skew (l,): 1 where the tangent of the load has a skew part, so that it is not conservative
    (`ksd.model.follower_correction`); block (l,): offset of the diagonal block of the node.
    """

    node: np.ndarray
    point: np.ndarray
    force: np.ndarray
    moment: np.ndarray
    following: np.ndarray
    skew: np.ndarray
    block: np.ndarray


class ArrayFields(NamedTuple):
    """The fields of `Arrays`.

    plan: of the block matrix; start (k,): first unknown of each node, -1 where it is fixed; size: length scale [m]. springs:
    elastic bodies without inner unknowns, packed as members: COIL has the constants (stiffness [N/m], free length [m]),
    TORSION (stiffness [Nm/rad], rest angle [rad]) about e3 of end p, LINEAR those of `ksd.elements.linear`. Their rows of
    Workspace.lam and Workspace.pose follow those of the members. active_dofs (w,): which of x, y, z, rx, ry, rz of every
    node are unknown: all six, or three in a plane (`ksd.model.plane`). weight (m, 4): mass of every member [kg], 0 without
    weight, and its gravity [m/s^2]; (0, 4) where no member has weight.
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
    carried: np.ndarray


MEMBER_FLOATS = ("offset", "frame", "value", "length", "stiffness_scale")
TERM_FLOATS = ("coefficient", "direction", "point")
LOAD_FLOATS = ("point", "force", "moment")
FLOATS_OF_PARTS = {
    "members": MEMBER_FLOATS,
    "terms": TERM_FLOATS,
    "loads": LOAD_FLOATS,
    "springs": MEMBER_FLOATS,
}
"""Names of the float fields, in the order of `FlatArrays.floats`, between the size and the weight."""


class Arrays(ArrayFields):
    """One mechanism as arrays, or D designs where float fields and size have a leading axis over them."""

    @cached_property
    def flat(self) -> FlatArrays:
        """A copy of all fields of a mechanism in the form for compiled code."""
        return flatten_arrays(self)

    @cached_property
    def joined_floats(self) -> np.ndarray:
        """`FlatArrays.floats` (D, f) of D designs."""
        size: Any = self.size
        fields = [getattr(getattr(self, part), n) for part, names in FLOATS_OF_PARTS.items() for n in names]
        return np.concatenate([f.reshape(len(size), -1) for f in (size, *fields, self.weight)], axis=1)

    @cached_property
    def float_slices(self) -> list[tuple[int, list[tuple[int, slice, tuple[int, ...]]]]]:
        """(index of the part in `Arrays`, its non-empty float fields) of every part that has floats.

        A field is given as (index in its part, slice of `FlatArrays.floats`, shape).
        """
        at, parts = 1, []
        for part, names in FLOATS_OF_PARTS.items():
            own = getattr(self, part)
            fields = [getattr(own, name) for name in names]
            ends = list(accumulate((field.size for field in fields), initial=at))
            filled = [
                (own._fields.index(name), slice(*ends[k : k + 2]), field.shape)
                for k, (name, field) in enumerate(zip(names, fields, strict=True))
                if field.size
            ]
            if filled:
                parts.append((self._fields.index(part), filled))
            at = ends[-1]
        return parts

    def __reduce__(self) -> Any:
        return unflatten_arrays, (self.flat,)


LEAF_MEMBERS, BEAM_MEMBERS, ALL_MEMBERS = range(3)


class FlatArrays(NamedTuple):
    """`Arrays` as two arrays, for compiled code.

    ints: counts, the start of every field, and the integer fields; floats: size and the float fields. member_kinds:
    LEAF_MEMBERS where all members are strain-mode leaves or linear bodies without weight, there are no springs, and no load
    has a skew tangent; ALL_MEMBERS where one is a modal body or a solid; else BEAM_MEMBERS.

    Kernels read entry c of row i of a field f with w columns as ints[ints[f] + w i + c], or as floats[ints[f] + w i + c].
    This avoids access to fields of named tuples, which counts the references of an array.
    """

    ints: np.ndarray
    floats: np.ndarray
    member_kinds: int


class KernelArrays(NamedTuple):
    """The part of `Arrays` that compiled code needs: their flat form, and the weight of the members."""

    flat: FlatArrays
    weight: np.ndarray


SETTINGS = 5
"""Number of the settings of a member."""
NODES, MEMBER_COUNT, ROWS, LOADS, SPRING_COUNT, DOFS_PER_NODE, CARRIED_NODES, PLAN, START, MEMBERS = range(10)
KIND, NODE, OFFSET, FRAME, NUMBER, VALUE_AT, VALUE, INNER_AT, STORE_AT, LENGTH, STIFFNESS_SCALE, BLOCK = (
    range(12)
)
"""Positions of the starts of the fields of members, relative to MEMBERS, and of springs, relative to SPRINGS."""
TERM_FIRST, TERM_START, TERM_COEFFICIENT, TERM_KIND, TERM_NODE = range(21, 26)
TERM_DIRECTION, TERM_POINT, TERM_BLOCK, TERM_FLIP = range(26, 30)
LOAD_NODE, LOAD_POINT, LOAD_FORCE, LOAD_MOMENT, LOAD_FOLLOWING, LOAD_SKEW, LOAD_BLOCK = range(30, 37)
SPRINGS, WEIGHT, ACTIVE_DOFS, CARRIED, FLOATS = 37, 49, 50, 51, 52
"""Positions in `FlatArrays.ints` of the counts, of the starts of fields, and last of the number of floats."""


def _flat_fields(part: Any) -> Iterator[np.ndarray]:
    for field in part:
        if isinstance(field, Blocks):
            yield field.ints
        elif isinstance(field, np.ndarray):
            yield field
        elif isinstance(field, tuple):
            yield from _flat_fields(field)


def join_fields(
    counts: Sequence[int], first: Sequence[float], fields: Iterable[np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """Copies of fields in two arrays.

    Returns (counts, the start of every field, the number of floats, the integer fields) and (the numbers `first`, the float
    fields).
    """
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
    """A copy of the fields as `FlatArrays`."""
    counts = (
        len(arrays.start), len(arrays.members.kind), len(arrays.terms.start), len(arrays.loads.node),
        len(arrays.springs.kind), len(arrays.active_dofs), len(arrays.carried),
    )  # fmt: skip
    return FlatArrays(*join_fields(counts, (arrays.size,), _flat_fields(arrays)), _member_kinds(arrays))


def _member_kinds(arrays: ArrayFields) -> int:
    """`FlatArrays.member_kinds` of these fields."""
    kind = arrays.members.kind
    if np.isin(kind, (MODAL, SOLID)).any():
        return ALL_MEMBERS
    all_leaves = np.isin(kind, (STRAIN, PLANAR, LINEAR)).all()
    has_more = len(arrays.weight) or len(arrays.springs.kind) or arrays.loads.skew.any()
    return LEAF_MEMBERS if all_leaves and not has_more else BEAM_MEMBERS


_INT, _FLOAT = 0, 1
_MEMBER_ROWS = (
    (_INT, ()), (_INT, (2,)), (_FLOAT, (2, 3)), (_FLOAT, (2, 3, 3)), (_INT, (SETTINGS,)), (_INT, ()), (_FLOAT, ()),
    (_INT, ()), (_INT, ()), (_FLOAT, ()), (_FLOAT, ()), (_INT, (4,)),
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
    (_INT, (2,)),
)  # fmt: skip
"""(integer or float, shape of a row) of every field."""


def unflatten_arrays(flat: FlatArrays) -> Arrays:
    """Arrays whose fields are views of `flat`, so that compiled code reads what is written into them."""
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
        Members(*views[springs:-3]),
        *views[-3:],
    )
    arrays.flat = flat
    return arrays


def angle_count(arrays: ArrayFields) -> int:
    """Size of `State.angle`."""
    return len(arrays.terms.node) + len(arrays.springs.kind) + 3 * len(arrays.start)


def carries_load(arrays: Arrays) -> bool:
    """Whether there are loads on links or members with weight."""
    return len(arrays.loads.node) > 0 or len(arrays.weight) > 0


class State(NamedTuple):
    """State of a mechanism: positions x (k, 3) [m] and rotations R (k, 3, 3) of nodes, inner states (flat), multipliers
    (c,), and angle (t + s + 3 k,) [rad]: angles of the constraint terms, angles of the springs, and rotation vectors of the
    nodes, with the whole turns that R does not tell (`ksd.model.turns`)."""

    x: np.ndarray
    R: np.ndarray
    inner: np.ndarray
    multiplier: np.ndarray
    angle: np.ndarray

    def copy(self) -> State:
        """An independent copy."""
        return State(*(field.copy() for field in self))

    def assign(self, other: State) -> None:
        """Copy the numbers of `other`, in place."""
        for mine, theirs in zip(self, other, strict=True):
            mine[...] = theirs

    def largest_move(self, other: State, links: int) -> tuple[float, float]:
        """Largest displacement [m] and rotation [rad] of the first `links` nodes from another state, which may have more."""
        shift, turn = self.x[:links] - other.x[:links], self.R[:links] - other.R[:links]
        # Frobenius norm of a rotation by t less the unit matrix: 2 sqrt(2) sin(t / 2)
        chord = math.sqrt(float((turn * turn).sum(axis=(1, 2)).max()) / 8.0)
        largest = math.sqrt(float((shift * shift).sum(axis=1).max()))
        return largest, 2.0 * math.asin(min(chord, 1.0))


class Workspace(NamedTuple):
    """Storage of one thread for a model, allocated once: views of the array `flat`; at: their ends in it, and
    linearisation_at.

    matrix, scaled_rows: block matrix and its scaled rows (`ksd.numerics.blocks`); rhs (n,): residual, then the step; store
    (flat): numbers of members stored from assembly to update; lam (m, 12): end wrenches; pose (m, 18): frame p (9), lever of
    q about node p, lever of q, d; scale (k, 2): bounds of the force and moment residuals of each node. linearisation (flat),
    from linearisation_at (m+1,): element and node rotation vectors of the near configuration of paper 1, empty except in the
    substructures. weight: as in `Arrays`, for a substructure with gravity in the axes of its A.
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
    """`Workspace` of views of `flat`."""
    return Workspace(
        flat[: at[0]], flat[at[0] : at[1]], flat[at[1] : at[2]], flat[at[2] : at[3]],
        flat[at[3] : at[4]].reshape(-1, 12), flat[at[4] : at[5]].reshape(-1, 18), flat[at[5] : at[6]].reshape(-1, 2),
        flat[at[6] : at[7]], at[9:], flat[at[7] : at[8]].reshape(-1, 4), flat, at,
    )  # fmt: skip


unflatten_workspace_kernel = kernel(unflatten_workspace)
"""`unflatten_workspace` for kernels."""


def make_workspace(arrays: Arrays, *, near: np.ndarray | None = None) -> Workspace:
    """Storage for one thread; near (m,): lengths of the rotation vectors about which members are linearised, if any."""
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
