"""The frozen arrays of a model, views of two flat ones for compiled kernels, its state, and the workspace of a thread.

Node 0 is ground. Node frames are the identity in the undeformed configuration, so a point of a link is x + R s, with s its
undeformed offset from the reference point of the link. Lengths m, forces N, moments Nm, angles rad.

The classes `Members` to `Fields` are the table of all fields: a line there gives a field its place in the flat arrays, its
views, and its name in kernels.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import accumulate
from typing import Annotated, Any, NamedTuple, get_args, get_type_hints

import numpy as np

from ksd.elements.pressure import GIVEN_MODES
from ksd.numerics.blocks import Blocks, unflatten_blocks
from ksd.numerics.kernel import kernel

STRAIN, COROTATIONAL, LINEAR, COIL, TORSION, MODAL, SOLID, PLANAR = 0, 1, 2, 3, 4, 5, 6, 7
"""Kinds of members and springs: strain-mode leaf, chain, linear body, coil and torsion spring, modal body, polynomial solid,
strain-mode leaf in a plane."""
TRANSLATION, ROTATION, ALIGNMENT = 0, 1, 2
"""Kinds of terms of constraint rows; an alignment is zero where the node has not tilted about `direction`, however far it
has turned about its axis."""
LOAD_NUMBERS = 11
"""Number of the distributed loads of a member in `Fields.weight`."""
SETTINGS = 7
"""Number of the settings of a member."""
Ints = Annotated[np.ndarray, np.int64]
Floats = Annotated[np.ndarray, np.float64]
"""Types of fields; more numbers in `Annotated` are the shape of a row."""


class Members(NamedTuple):
    """m elastic bodies, each between end p on node[:, 0] and end q on node[:, 1].

    kind (m,): STRAIN, ...; offset (m, 2, 3): ends minus the reference points of their nodes, in node axes; frame (m, 2, 3,
    3): end axes (columns) in node axes; number (m, SETTINGS): settings; value (flat), from value_at (m,): constants;
    inner_at, store_at (m+1,): starts of the inner state, and of the numbers stored from assembly to update; length (m,);
    stiffness_scale (m,): EA/L of a leaf [N/m]; block (m, 4): offsets of the stored blocks pp, qq and coupling, -1 where an
    end is fixed, and 1 where the coupling is stored as (p, q).
    """

    kind: Ints
    node: Annotated[Ints, 2]
    offset: Annotated[Floats, 2, 3]
    frame: Annotated[Floats, 2, 3, 3]
    number: Annotated[Ints, SETTINGS]
    value_at: Ints
    value: Floats
    inner_at: Ints
    store_at: Ints
    length: Floats
    stiffness_scale: Floats
    block: Annotated[Ints, 4]


class Terms(NamedTuple):
    """c constraint rows as sums of t terms; row i has the terms first[i] .. first[i+1]-1.

    A term has coefficient, kind, node (base, node), direction (3,) fixed in the base, and point (2, 3), offsets in the axes
    of base and node, or twice the axis of an alignment. start (c,): unknown of the multiplier, -1 for a row that is left
    out. block (t, 5): offsets of the blocks that couple the multiplier with base and node, and of the blocks base-base,
    node-node and base-node; flip (t,): 1 where the last one is stored as (base, node). damping (c,) [N s/m or Nm s/rad]: of
    the dashpots, rows of one term that have no multiplier; 0 of all other rows.
    """

    first: Ints
    start: Ints
    coefficient: Floats
    kind: Ints
    node: Annotated[Ints, 2]
    direction: Annotated[Floats, 3]
    point: Annotated[Floats, 2, 3]
    block: Annotated[Ints, 5]
    flip: Ints
    damping: Floats


class Loads(NamedTuple):
    """l loads on nodes: node (l,), point (l, 3), force (l, 3), moment (l, 3), following (l,): 1 for a follower load.

    skew (l,): 1 where the tangent of the load has a skew part, so that it is not conservative
    (`ksd.model.follower_correction`); block (l,): offset of the diagonal block of the node.
    """

    node: Ints
    point: Annotated[Floats, 3]
    force: Annotated[Floats, 3]
    moment: Annotated[Floats, 3]
    following: Ints
    skew: Ints
    block: Ints


class Bodies(NamedTuple):
    """b rigid bodies with inertia, at most one per node, in a time step.

    node (b,); inertia (b, 13): mass [kg], its centre [m] and tr(J)/2 I - J [kg m^2] in node axes; block (b,): offset of the
    diagonal block of the node.
    """

    node: Ints
    inertia: Annotated[Floats, 13]
    block: Ints


class Fields(NamedTuple):
    """The fields of `Arrays`.

    size (1,): length scale [m]; plan: `Blocks.ints` of the block matrix; start (k,): first unknown of each node, -1 where it
    is fixed. The last rows of the members are `springs`, elastic bodies without inner unknowns: COIL has the constants
    (stiffness [N/m], free length [m]), TORSION (stiffness [Nm/rad], rest angle [rad]) about e3 of end p, LINEAR those of
    `ksd.elements.linear`. active_dofs (w,): which of x, y, z, rx, ry, rz of every node are unknown: all six, or three in a
    plane (`ksd.model.plane`). weight (m, 11): distributed loads of every other member (`ksd.elements.leaf_loads`): mass
    [kg], 0 without weight, gravity [m/s^2], line load at its start and its change [N/m], pressure [Pa]; (0, 11) without
    any. carried (c, 2): nodes of long chains, each with the node that carries it. In a time step (`ksd.solvers.time_steps`)
    members with inertia have weight, bodies are there, known (k, 12) are the known place and orientation of every node, and
    rates (2,) are c0 [1/s^2] and c1 [1/s], which else are zero.
    """

    size: Floats
    plan: Ints
    start: Ints
    members: Members
    terms: Terms
    loads: Loads
    weight: Annotated[Floats, LOAD_NUMBERS]
    active_dofs: Ints
    carried: Annotated[Ints, 2]
    bodies: Bodies
    known: Annotated[Floats, 12]
    rates: Floats


def _fields() -> dict[str, tuple[Any, tuple[int, ...]]]:
    """Type and shape of a row of every field, by name, "members.kind" and the like."""
    table = {}
    for part, hint in get_type_hints(Fields, include_extras=True).items():
        is_part = isinstance(hint, type)
        own = get_type_hints(hint, include_extras=True) if is_part else {part: hint}
        for name, field in own.items():
            _, dtype, *shape = get_args(field)
            table[f"{part}.{name}" if is_part else part] = dtype, tuple(shape)
    return table


FIELDS = _fields()
"""Type and shape of a row of every field, by its name."""
_COUNTED = "start", "members.kind", "terms.start", "loads.node", "active_dofs", "carried", "bodies.node"
NODES, MEMBER_COUNT, ROWS, LOADS, DOFS_PER_NODE, CARRIED_NODES, BODIES, LEAF_COUNT = range(len(_COUNTED) + 1)
"""Positions of the counts in `Arrays.ints`: lengths of the fields `_COUNTED`, and the number of members before the springs.
The starts of all fields follow."""
_STARTS: dict[str, Any] = {name: LEAF_COUNT + 1 + i for i, name in enumerate(FIELDS)}


def _positions(part: Any, name: str) -> Any:
    return part(*(_STARTS[f"{name}.{field}"] for field in part._fields))


MEMBER, TERM, LOAD = _positions(Members, "members"), _positions(Terms, "terms"), _positions(Loads, "loads")
BODY = _positions(Bodies, "bodies")
AT = Fields(*(_STARTS.get(name, -1) for name in Fields._fields))
"""Positions in `Arrays.ints` of the starts of fields, by name: entry c of row i of a field with w columns of the members is
ints[ints[MEMBER.node] + w i + c], or floats[ints[MEMBER.offset] + w i + c]. Kernels read them so, as access to arrays in
named tuples counts their references."""
LEAF_MEMBERS, BEAM_MEMBERS, ALL_MEMBERS, MOVING_MEMBERS = range(4)


class Arrays:
    """One mechanism, or D designs with a leading axis over them in all floats: `Fields`, views of two flat arrays.

    ints: counts, the start of every field, the number of floats, and the integer fields; floats (f,) or (D, f). Kernels read
    these two, so they read what is written into a field. Here `members` are those before the springs; `springs.value_at`
    counts from the constants of the springs.
    """

    start: np.ndarray
    members: Members
    terms: Terms
    loads: Loads
    springs: Members
    weight: np.ndarray
    active_dofs: np.ndarray
    carried: np.ndarray

    def __init__(self, ints: np.ndarray, floats: np.ndarray, topology: Arrays | None = None) -> None:
        """topology: arrays with the same integers, whose views are shared."""
        self.ints, self.floats, self.topology = ints, floats, topology or self

    def __reduce__(self) -> Any:
        return Arrays, (self.ints, self.floats)

    def __getattr__(self, name: str) -> Any:
        if name not in (*Fields._fields, "springs"):
            raise AttributeError(f"Arrays have no field '{name}'")
        field = self._field(name)
        setattr(self, name, field)
        return field

    def _field(self, name: str) -> Any:
        """The views of a field or part."""
        if name in FIELDS:
            return self._view(name)
        if self.topology is self:
            own = _PARTS[name](*(self._view(f"{name}.{field}") for field in _PARTS[name]._fields))
            return own._replace(value_at=own.value_at - self._split[1]) if name == "springs" else own
        views, lead = list(getattr(self.topology, name)), self.floats.shape[:-1]
        for k, place, shape in self.topology._floats_of[name]:
            views[k] = self.floats[..., place].reshape(lead + shape)
        return _PARTS[name]._make(views)

    def _view(self, name: str) -> np.ndarray:
        """The view of one field."""
        dtype, place, shape = self.topology._places[name]
        if dtype is np.int64:
            return self.ints[place].reshape(shape)
        return self.floats[..., place].reshape(self.floats.shape[:-1] + shape)

    @cached_property
    def _split(self) -> tuple[int, int]:
        """Number of the members before the springs, and of their constants."""
        leaves, at = int(self.ints[LEAF_COUNT]), int(self.ints[MEMBER.value_at])
        has_springs = leaves < self.ints[MEMBER_COUNT]
        return leaves, int(
            self.ints[at + leaves] if has_springs else self.ints[MEMBER.length] - self.ints[MEMBER.value]
        )

    @cached_property
    def _places(self) -> dict[str, tuple[Any, slice, tuple[int, ...]]]:
        """Type, place in its flat array, and shape of every field, of members and springs their own rows."""
        ends, found = {np.int64: len(self.ints), np.float64: int(self.ints[LAST])}, {}
        leaves, constants = self._split
        for name, (dtype, row) in reversed(FIELDS.items()):
            first, width = int(self.ints[_STARTS[name]]), math.prod(row)
            rows, (part, _, own) = (ends[dtype] - first) // width, name.partition(".")
            if part == "members":
                at = constants if own == "value" else leaves
                found[f"springs.{own}"] = dtype, slice(first + at * width, ends[dtype]), (rows - at, *row)
                rows = at + (own in ("inner_at", "store_at"))
            found[name] = dtype, slice(first, first + rows * width), (rows, *row)
            ends[dtype] = first
        return found

    @cached_property
    def _floats_of(self) -> dict[str, list[tuple[int, slice, tuple[int, ...]]]]:
        """Number, place and shape of the float fields of every part."""
        return {
            name: [
                (k, place, shape)
                for k, (dtype, place, shape) in enumerate(
                    self._places[f"{name}.{own}"] for own in part._fields
                )
                if dtype is np.float64
            ]
            for name, part in _PARTS.items()
        }

    @property
    def flat(self) -> tuple[np.ndarray, np.ndarray]:
        """Both flat arrays, for kernels."""
        return self.ints, self.floats

    @property
    def size(self) -> float:
        """Length scale [m] of a single mechanism."""
        return float(self.floats[0])

    @cached_property
    def plan(self) -> Blocks:
        """The plan of the block matrix."""
        if self.topology is not self:
            return self.topology.plan
        return unflatten_blocks(self._view("plan"))

    @cached_property
    def load_modes(self) -> np.ndarray:
        """Numbers of load modes (m,) of the members before the springs of a single mechanism: one of weight alone."""
        modes = self.members.number[:, 5] * np.isin(self.members.kind, (STRAIN, PLANAR))
        return np.maximum(modes, self.weight[:, 0] > 0.0) if len(self.weight) else 0 * modes

    @cached_property
    def under_pressure(self) -> np.ndarray:
        """Numbers of the members under pressure, in statics."""
        if len(self.known):
            return np.zeros(0, np.int64)
        is_leaf = np.isin(self.members.kind, (STRAIN, PLANAR))
        return np.flatnonzero(is_leaf & (self.members.number[:, 5] > GIVEN_MODES))

    @property
    def conservative(self) -> bool:
        """Whether all loads have a potential: no follower load, no pressure, and no moment in space."""
        return not (self.loads.skew.any() or len(self.under_pressure))

    @cached_property
    def member_kinds(self) -> int:
        """LEAF_MEMBERS where all members are strain-mode leaves or linear bodies without weight, there are no springs, and
        no load has a skew tangent; ALL_MEMBERS where one is a modal body or a solid; MOVING_MEMBERS in a time step; else
        BEAM_MEMBERS."""
        if self.topology is not self:
            return self.topology.member_kinds
        if len(self.known):
            return MOVING_MEMBERS
        kind = self.members.kind
        if np.isin(kind, (MODAL, SOLID)).any():
            return ALL_MEMBERS
        all_leaves = np.isin(kind, (STRAIN, PLANAR, LINEAR)).all()
        has_more = len(self.weight) or len(self.springs.kind) or not self.conservative
        return LEAF_MEMBERS if all_leaves and not has_more else BEAM_MEMBERS

    def replace(self, **fields: Any) -> Arrays:
        """New arrays of a mechanism with other `fields`, whose sizes may be others."""
        return arrays_of(**{name: getattr(self, name) for name in (*Fields._fields, "springs")} | fields)

    def copy(self) -> Arrays:
        """An independent copy of all floats."""
        return Arrays(self.ints, self.floats.copy(), self.topology)

    def designs(self, count: int) -> Arrays:
        """Arrays of `count` designs with these integers, all floats zero."""
        return Arrays(self.ints, np.zeros((count, int(self.ints[LAST]))), self.topology)

    def design(self, d: int) -> Arrays:
        """A copy of design d of several."""
        return Arrays(self.ints, self.floats[d].copy(), self.topology)


LAST = LEAF_COUNT + 1 + len(FIELDS)
"""Position in `Arrays.ints` of the number of floats."""
_PARTS: dict[str, Any] = {
    "members": Members, "springs": Members, "terms": Terms, "loads": Loads, "bodies": Bodies,
}  # fmt: skip
NO_BODIES = Bodies(np.zeros(0, np.int64), np.zeros((0, 13)), np.zeros(0, np.int64))


def arrays_of(**fields: Any) -> Arrays:
    """The arrays of a mechanism with a copy of all its `Fields` and springs; size: a number, plan: `Blocks`."""
    fields["size"], fields["plan"] = np.array([fields["size"]]), fields["plan"].ints
    members, springs = fields["members"], fields["springs"]
    joined = {
        name: np.concatenate([own, more])
        for name, own, more in zip(Members._fields, members, springs, strict=True)
    }
    for name in ("inner_at", "store_at"):
        own = getattr(members, name)
        joined[name] = np.concatenate([own, own[-1:].repeat(len(springs.kind))])
    joined["value_at"][len(members.kind) :] += len(members.value)
    fields["members"] = Members(**joined)
    values = {}
    for name in FIELDS:
        part, _, own = name.partition(".")
        values[name] = getattr(fields[part], own) if own else fields[part]
    counts = [len(values[name]) for name in _COUNTED]
    return Arrays(*join_fields([*counts, len(members.kind)], values.values()))


def write(part: Any, **values: Any) -> None:
    """Write values into the fields of these names of a part of `Arrays`."""
    for name, value in values.items():
        getattr(part, name)[...] = value


def copy_floats(part: Any, to: Any) -> None:
    """Write all float fields of a part of `Arrays` into those of another."""
    for own, other in zip(part, to, strict=True):
        if own.dtype == np.float64:
            other[...] = own


def join_fields(counts: Sequence[int], fields: Iterable[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Copies of fields in two arrays: (counts, the start of every field, the number of floats, the integer fields) and the
    float fields."""
    fields = list(fields)
    ints, floats, places = [], [np.zeros(0)], []
    at, to = len(counts) + len(fields) + 1, 0
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


def angle_count(arrays: Arrays) -> int:
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
        flat[at[6] : at[7]], at[9:], flat[at[7] : at[8]].reshape(-1, 11), flat, at,
    )  # fmt: skip


unflatten_workspace_kernel = kernel(unflatten_workspace)
"""`unflatten_workspace` for kernels."""


def make_workspace(arrays: Arrays, *, near: np.ndarray | None = None) -> Workspace:
    """Storage for one thread; near (m,): lengths of the rotation vectors about which members are linearised, if any."""
    members, rows = arrays.members, int(arrays.ints[MEMBER_COUNT])
    linearisation_at = [0] * (rows + 1) if near is None else [0, *accumulate(near.tolist())]
    sizes = (
        arrays.plan.values, arrays.plan.values, arrays.plan.unknowns, int(members.store_at[-1]), 12 * rows, 18 * rows,
        2 * len(arrays.start), linearisation_at[-1], arrays.weight.size,
    )  # fmt: skip
    at = np.array([*accumulate(sizes), *linearisation_at], np.int64)
    work = unflatten_workspace(np.zeros(at[8]), at)
    work.weight[:] = arrays.weight
    return work
