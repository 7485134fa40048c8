"""Groups of strain-mode leaves with the same orders, points and panels, and of chains with the same number of elements,
evaluated together as arrays."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix

from ksd.answers.derived import cached_per_model
from ksd.answers.nonconservative import cross_matrix
from ksd.elements.pressure import GIVEN_MODES
from ksd.elements.strain_uncondensed import (
    LoadDerivatives,
    UncondensedLeaves,
    load_derivatives,
    strain_flexibility,
    uncondensed_leaves,
)
from ksd.elements.strain_values import load_totals, strain_value_count
from ksd.model.arrays import State
from ksd.model.compile import Model

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LeafGroup:
    """k leaf springs of the same layout.

    members (k,): their numbers; number (SETTINGS,): common settings; value (k, v): constants; inner_index (k, N + 6):
    positions of their inner states in the flat inner state of the model; has_loads: they have weight or other loads along
    them; is_chain: they are chains of elements.
    """

    members: NDArray[np.int64]
    number: NDArray[np.int64]
    value: Array
    inner_index: NDArray[np.int64]
    has_loads: bool = False
    is_chain: bool = False

    @property
    def modes(self) -> int:
        """Number of amplitudes N per leaf."""
        return int(self.number[:3].sum())


def panel_table_slice(number: NDArray[np.int64]) -> slice:
    """Slice of the constants of a leaf spring with the weights and integrals of its points; they are equal for equal
    panels."""
    nx, ny, nz, ng = (int(n) for n in number[:4])
    first = 1 + nx * nx + ny * ny + nz * nz + nx + ny + nz
    return slice(first, first + ng * (ng + 1))


@cached_per_model
def leaf_groups(model: Model) -> tuple[LeafGroup, ...]:
    """Groups of all strain-mode members of a model, in order of first appearance."""
    members = model.arrays.members
    found: dict[tuple[bytes, bytes, bool], list[int]] = {}
    has_loads = model.arrays.load_modes > 0
    for i in model.strain_leaves:
        own = members.value[members.value_at[i] :]
        layout = members.number[i].tobytes(), own[panel_table_slice(members.number[i])].tobytes()
        found.setdefault((*layout, bool(has_loads[i])), []).append(i)
    groups = []
    for (*_, weighs), same in found.items():
        size = strain_value_count(members.number[same[0]], has_weight=weighs)
        value = np.stack([members.value[members.value_at[i] :][:size] for i in same])
        inner = int(members.number[same[0], :3].sum()) + 6
        inner_index = np.stack([members.inner_at[i] + np.arange(inner) for i in same])
        groups.append(LeafGroup(np.array(same), members.number[same[0]], value, inner_index, weighs))
    return tuple(groups)


@cached_per_model
def chain_groups(model: Model) -> tuple[LeafGroup, ...]:
    """Groups of all chains of a model by number of elements; `value` has constants of elements, of the clamped end, and
    masses."""
    members, has_loads = model.arrays.members, model.arrays.load_modes > 0
    found: dict[tuple[int, bool], list[int]] = {}
    for i in model.chains:
        found.setdefault((int(members.number[i, 0]), bool(has_loads[i])), []).append(i)
    groups = []
    for (count, weighs), same in found.items():
        size = 16 * count + 9 + weighs * (count + 1)
        value = np.stack([members.value[members.value_at[i] :][:size] for i in same])
        inner_index = members.inner_at[same][:, None] + np.arange(12 * (count - 1))
        groups.append(
            LeafGroup(np.array(same), members.number[same[0]], value, inner_index, weighs, is_chain=True)
        )
    return tuple(groups)


@cached_per_model
def shape_scale(model: Model) -> Array:
    """Factors (n,) on inner unknowns to the shape of leaf springs: their turn [rad], or place over length; 0 on others."""
    found = np.zeros(len(model.rest.inner))
    for group in leaf_groups(model):
        found[group.inner_index[:, : group.modes]] = model.arrays.members.length[group.members, None]
    for group in chain_groups(model):
        places = group.inner_index.reshape(len(group.members), -1, 12)[..., :3]
        found[places] = 1.0 / model.arrays.members.length[group.members, None, None]
    return found


def shape_difference(model: Model, one: Array, other: Array) -> float:
    """Largest difference of two inner states (n,) in the shape of a leaf spring, see `shape_scale`."""
    return float(np.abs(shape_scale(model) * (one - other)).max(initial=0.0))


@dataclass(frozen=True)
class EndFrames:
    """End frames of k members.

    p is at start (k, 3) with axes frame (k, 3, 3), global; q at d (k, 3), in frame p. arms (k, 2, 3): vectors from the nodes
    to both ends; reach (k, 3): from the node of p to q; global.
    """

    start: Array
    frame: Array
    d: Array
    arms: Array
    reach: Array


def end_frames(model: Model, motion: State, which: NDArray[np.int64] | slice) -> EndFrames:
    """End frames of the members `which` (k,) at `motion`."""
    members = model.arrays.members
    nodes = members.node[which]
    R = motion.R[nodes]
    arms = (R @ members.offset[which][..., None])[..., 0]
    frame = R[:, 0] @ members.frame[which, 0]
    start, end = (motion.x[nodes[:, e]] + arms[:, e] for e in (0, 1))
    d = ((end - start)[:, None] @ frame)[:, 0]
    return EndFrames(start, frame, d, arms, end - motion.x[nodes[:, 0]])


def end_axes(model: Model, motion: State, which: NDArray[np.int64], ends: EndFrames) -> Array:
    """Axes (k, 3, 3) of end q of the members `which` (k,), in frame p."""
    members = model.arrays.members
    axes: Array = ends.frame.swapaxes(1, 2) @ motion.R[members.node[which, 1]] @ members.frame[which, 1]
    return axes


def end_jacobians(ends: EndFrames) -> tuple[Array, Array]:
    """Jacobians (k, 6, 12) of the motion of end p, and of end q relative to p, with respect to the motions of both nodes.

    Both motions are in frame p.
    """
    count = len(ends.start)
    own, relative = np.zeros((count, 6, 12)), np.zeros((count, 6, 12))
    turn = ends.frame.swapaxes(1, 2)
    own[:, :3, :3] = own[:, 3:, 3:6] = relative[:, :3, 6:9] = relative[:, 3:, 9:] = turn
    relative[:, :3, :3] = relative[:, 3:, 3:6] = -turn
    own[:, :3, 3:6] = -turn @ cross_matrix(ends.arms[:, 0])
    relative[:, :3, 3:6] = turn @ cross_matrix(ends.reach)
    relative[:, :3, 9:] = -turn @ cross_matrix(ends.arms[:, 1])
    return own, relative


def local_loads(model: Model, motion: State, group: LeafGroup, load_factor: float) -> Array | None:
    """Load modes (k, D) of a group of leaf springs in their frames p (`ksd.elements.leaf_loads`), the given ones times the
    load factor; None without any. For chains (k, 3): gravity."""
    if not group.has_loads:
        return None
    members, weight = model.arrays.members, model.arrays.weight[group.members]
    frame = motion.R[members.node[group.members, 0]] @ members.frame[group.members, 0]
    modes = 1 if group.is_chain else max(int(group.number[5]), 1)
    given = weight[:, 1 : 1 + 3 * min(modes, GIVEN_MODES)].reshape(len(weight), -1, 3)
    local = load_factor * (given @ frame).reshape(len(weight), -1)
    follows = np.arange(1, 1 + 3 * max(modes - GIVEN_MODES, 0))
    return np.concatenate([local, motion.inner[group.inner_index[:, -1:] + follows]], axis=1)


def group_parts(model: Model, motion: State, group: LeafGroup, load_factor: float) -> UncondensedLeaves:
    """Tangent blocks and mode fields of all leaf springs of a group (k, ...), see `ksd.elements.strain_uncondensed`."""
    loads = local_loads(model, motion, group, load_factor)
    return uncondensed_leaves(group.value, group.number, motion.inner[group.inner_index], loads)


def load_tangents(model: Model, motion: State, group: LeafGroup, load_factor: float) -> Array | float:
    """What the distributed loads of a group of leaves add to their tangents (k, 18 + N, 18 + N) in (motions of both nodes,
    a, lam), see `ksd.elements.leaf_loads`; symmetric but for pressure; zero without any."""
    loads = local_loads(model, motion, group, load_factor)
    if loads is None:
        return 0.0
    found: LoadDerivatives = load_derivatives(
        group.value, group.number, motion.inner[group.inner_index], loads
    )
    ends, N, count = end_frames(model, motion, group.members), group.modes, len(loads)
    weight, R, modes = model.arrays.weight[group.members], ends.frame, loads.shape[1] // 3
    dead = min(modes, GIVEN_MODES)
    total = weight[:, :1] if group.number[5] == 0 else load_totals(group.value, group.number)
    local = loads.reshape(count, modes, 3)
    # changes of the modes by (motions of nodes, a, lam), in frame p
    df = np.zeros((count, modes, 3, 18 + N))
    df[:, :dead, :, 3:6] = np.cross(local[:, :dead, None], R[:, None]).swapaxes(2, 3)
    pressed = found.follows.reshape(count, modes, 3, N)
    df[..., 12 : 12 + N] = load_factor * weight[:, 10, None, None, None] * pressed
    df = df.reshape(count, -1, 18 + N)
    ds = found.D @ df
    ds[..., 12 : 12 + N] += found.eta
    ds[..., 12 + N : 15 + N] += found.B.swapaxes(1, 2)
    tangent = np.zeros((count, 18 + N, 18 + N))
    tangent[:, 12 : 12 + N] -= found.eta.swapaxes(1, 2) @ df
    tangent[:, 12 + N : 15 + N] -= found.B @ df
    # of the forces and moments on node a, global
    f, s, df, ds = (
        np.einsum("kij,kmj...->kmi...", R, part.reshape(count, modes, 3, *part.shape[2:]))
        for part in (loads, found.s, df, ds)
    )
    P = total[..., None] * ends.arms[:, None, 0] + s
    turn = np.zeros((3, 18 + N))
    turn[:, 3:6] = np.eye(3)
    df, ds = df - cross_matrix(f) @ turn, ds - cross_matrix(P) @ turn
    tangent[:, :3] -= np.einsum("km,kmic->kic", total, df)
    tangent[:, 3:6] -= (cross_matrix(P) @ df - cross_matrix(f) @ ds).sum(axis=1)
    tangent[:, 3:6, 3:6] -= 0.5 * cross_matrix(np.cross(P, f).sum(axis=1))
    return tangent


def node_unknowns(model: Model, nodes: NDArray[np.int64]) -> NDArray[np.int64]:
    """Unknowns (k, 6 n) of the motions of nodes (k, n), -1 where one is fixed."""
    first = model.arrays.start[nodes][..., None]
    return np.where(first < 0, -1, first + np.arange(6)).reshape(len(nodes), -1)


@cached_per_model
def inner_unknowns(model: Model) -> tuple[NDArray[np.int64], ...]:
    """Unknowns (k, 12 + N) of the leaves of every group.

    These are the motions of both nodes in elimination order, -1 where a node is fixed, then the inner coordinates of the
    leaf, which follow all node unknowns.
    """
    at, found = model.arrays.plan.unknowns, []
    for group in leaf_groups(model):
        own = at + np.arange(group.inner_index[:, : group.modes].size).reshape(-1, group.modes)
        found.append(np.hstack([node_unknowns(model, model.arrays.members.node[group.members]), own]))
        at += own.size
    return tuple(found)


def assemble_blocks(unknowns: Sequence[NDArray[np.int64]], blocks: Sequence[Array], size: int) -> Any:
    """Sum (size, size), scipy CSR, of stacks of matrices (k, m, m) with the unknowns (k, m) of each, -1 for none."""
    values, rows, columns = [], [], []
    for at, block in zip(unknowns, blocks, strict=True):
        own = (at >= 0)[:, :, None] & (at >= 0)[:, None, :]
        values.append(block[own])
        rows.append(np.broadcast_to(at[:, :, None], own.shape)[own])
        columns.append(np.broadcast_to(at[:, None, :], own.shape)[own])
    where = np.concatenate(rows), np.concatenate(columns)
    return coo_matrix((np.concatenate(values), where), shape=(size, size)).tocsr()


@dataclass(frozen=True)
class LeafFlexibility:
    """Leaf springs of one group at a state in the coordinates (motions of both nodes, b), with amplitudes a = P xi + b.

    xi is the motion of end q relative to end p. parts: tangent blocks and fields; P (k, N, 6); Z (k, N, N): flexibility of b
    with the ends held; ends (k, 6, 6): end wrench per xi; own, relative (k, 6, 12): motion of end p, and xi, from the
    motions of both nodes; inner (k, N): unknowns of b.
    """

    parts: UncondensedLeaves
    P: Array
    Z: Array
    ends: Array
    own: Array
    relative: Array
    inner: NDArray[np.int64]


def leaf_flexibilities(model: Model, motion: State, *, load_factor: float = 1.0) -> list[LeafFlexibility]:
    """Flexibilities of all groups of leaf springs at `motion`."""
    found = []
    for group, unknowns in zip(leaf_groups(model), inner_unknowns(model), strict=True):
        parts = group_parts(model, motion, group, load_factor)
        P, Z, K = strain_flexibility(parts)
        own, relative = end_jacobians(end_frames(model, motion, group.members))
        found.append(LeafFlexibility(parts, P, Z, K, own, relative, unknowns[:, 12:]))
    return found


def elastic_stiffness(group: LeafGroup) -> Array:
    """Stiffness (k, N, N) of the amplitudes of stress-free leaves."""
    K, at, first = np.zeros((len(group.value), group.modes, group.modes)), 1, 0
    for n in (int(n) for n in group.number[:3]):
        K[:, first : first + n, first : first + n] = group.value[:, at : at + n * n].reshape(-1, n, n)
        at += n * n
        first += n
    return K
