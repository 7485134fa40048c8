"""The frozen flat arrays a model is made of, as the compiled kernels read them.

Node 0 is ground. Node frames are identity at rest, so a point of a link is x + R s with s its offset at rest
from the link's reference point. Lengths m, forces N, moments Nm, angles rad.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ksd.numerics.blocks import Blocks
from ksd.numerics.kernel import compile_late

STRAIN, COROTATIONAL, LINEAR, COIL, TURN, MODAL, SOLID, PLANAR = 0, 1, 2, 3, 4, 5, 6, 7
TRANSLATION, ROTATION = 0, 1
ENTRIES = {
    STRAIN: ("strain_condense", "strain_recover"),
    COROTATIONAL: ("chain_condense", "chain_recover"),
    MODAL: ("modal_condense", "modal_recover"),
    SOLID: ("polynomial_condense", "modal_recover"),
    PLANAR: ("planar_condense", "planar_recover"),
}
"""Entry points of `ksd.beam.entry`, compiled only where a model has members of the kind."""
WEIGHT_ENTRIES = ("pull_member", "weigh_member", "turn_pull")
"""Entry points of `ksd.beam.weight_entry`, compiled only where a model has members with weight."""


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
    floor: np.ndarray
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

    skew (l,): 1 where the tangent of the load has a skew part (`ksd.model.turning`): it is not conservative.
    """

    node: np.ndarray
    point: np.ndarray
    force: np.ndarray
    moment: np.ndarray
    following: np.ndarray
    skew: np.ndarray
    block: np.ndarray


class Arrays(NamedTuple):
    """One mechanism as numbers. start (k,): first unknown of each node, -1 when fixed; size: length scale [m].

    springs: what resists without inner unknowns, packed as members: kind COIL with value (stiffness [N/m], free length
    [m]), TURN with (stiffness [Nm/rad], rest angle [rad]) about e3 of end p, LINEAR with the constants of
    `ksd.beam.linear`. Their rows of Work.lam and Work.pose follow those of the members. scratch: how many numbers the
    kernel of the largest member needs. keep (w,): which of x, y, z, rx, ry, rz of every node are unknown: all six, or three
    in a plane (`ksd.model.plane`). weight (m, 4): mass of every member [kg], 0 where it weighs nothing, and the
    gravity that pulls at it [m/s^2]; (0, 4) where no member has weight.
    """

    plan: Blocks
    start: np.ndarray
    members: Members
    terms: Terms
    loads: Loads
    size: float
    springs: Members
    scratch: int
    weight: np.ndarray
    keep: np.ndarray


def carries_load(arrays: Arrays) -> bool:
    """Whether there are loads on links or leafs with weight."""
    return len(arrays.loads.node) > 0 or len(arrays.weight) > 0


class Motion(NamedTuple):
    """Where a mechanism is: positions (k, 3) [m], rotations (k, 3, 3), inner states (flat), multipliers (c,)."""

    x: np.ndarray
    R: np.ndarray
    inner: np.ndarray
    multiplier: np.ndarray

    def copy(self) -> Motion:
        """An independent copy."""
        return Motion(self.x.copy(), self.R.copy(), self.inner.copy(), self.multiplier.copy())

    def assign(self, other: Motion) -> None:
        """Take over the numbers of `other`, in place."""
        for mine, theirs in zip(self, other, strict=True):
            mine[...] = theirs


class Work(NamedTuple):
    """Storage prepared once per model; with either leaf model an iteration allocates nothing (small arrays of fixed size
    are on the stack); modal bodies and solids still take scratch of their own.

    value, spare: block matrix and its scaled rows; rhs (n,): residual, then the step; store: what members keep
    from assembly to update; lam (m, 12): end wrenches; pose (m, 18): frame p (9), lever of q about node p, lever
    of q, d; scale (k, 2): sums of force and moment norms at each node. near (flat), from near_at (m+1,): element
    and node rotation vectors of the near configuration of paper 1, empty except in the joint bench. scratch: of
    the member at work. weight: as in `Arrays`, with the gravity of every joint on the bench in the axes of its A.
    """

    value: np.ndarray
    spare: np.ndarray
    rhs: np.ndarray
    store: np.ndarray
    lam: np.ndarray
    pose: np.ndarray
    scale: np.ndarray
    near: np.ndarray
    near_at: np.ndarray
    scratch: np.ndarray
    weight: np.ndarray


def turning_room(arrays: Arrays) -> int:
    """Scratch that loads with a skew tangent take in a Newton step (`ksd.model.turning`)."""
    loads = arrays.loads
    rows = len(arrays.keep) * int(np.sum((loads.skew == 1) & (arrays.start[loads.node] >= 0)))
    return rows * (arrays.plan.unknowns + rows + 1)


def _ready(arrays: Arrays) -> None:
    """Compile the kernels of what there is, where that has not been done."""
    from ksd.beam import entry, weight_entry  # noqa: F401, declares the entry points
    from ksd.model import system, turning  # noqa: F401, as above

    members = arrays.members
    compile_late(*(name for kind in set(members.kind.tolist()) for name in ENTRIES.get(kind, ())))
    if len(arrays.weight):
        compile_late(*WEIGHT_ENTRIES)
    if len(members.kind) + len(arrays.springs.kind):
        compile_late("assemble_apart")
    if len(arrays.springs.kind) or len(arrays.loads.node):
        compile_late("add_effects")


def make_work(arrays: Arrays, *, near: np.ndarray | None = None) -> Work:
    """Storage for one thread working on `arrays`; `near` (m,) lengths of the near configurations, if any.

    Compiles the kernels of the kinds of members there are, where that has not been done.
    """
    _ready(arrays)
    members = arrays.members
    if near is not None and np.any(members.kind == COROTATIONAL):
        compile_late("chain_near")
    room = turning_room(arrays)
    if room:
        compile_late("turn_step")
    held = len(members.kind)
    count = held + len(arrays.springs.kind)
    return Work(
        np.zeros(arrays.plan.values),
        np.zeros(arrays.plan.values),
        np.zeros(arrays.plan.unknowns),
        np.zeros(int(members.store_at[-1])),
        np.zeros((count, 12)),
        np.zeros((count, 18)),
        np.zeros((len(arrays.start), 2)),
        np.zeros(0 if near is None else int(np.sum(near))),
        np.zeros(held + 1, np.int64)
        if near is None
        else np.concatenate([[0], np.cumsum(near)]).astype(np.int64),
        np.zeros(max(arrays.scratch, room)),
        arrays.weight.copy(),
    )
