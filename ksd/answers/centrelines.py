"""Centrelines of leaf springs at a state: positions and section axes at stations along them.

A strain-mode leaf is integrated from its curvature, R' = R [kappa]x and r' = R (e1 + C R^T n), by fourth-order steps (a
Magnus step at two Gauss points, Simpson's rule for the position). A chain of Appendix A elements is interpolated between its
nodes by cubics with the tangents of the nodes. Global axes, SI units.
"""

from __future__ import annotations

import math
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ksd.answers.derived import cached_per_model
from ksd.answers.leaf_groups import EndFrames, LeafGroup, end_axes, end_frames, local_loads
from ksd.elements.strain_centreline import integrate_centrelines, strains_at
from ksd.elements.strain_values import loads_beyond
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.model.leaves import whole_leaf_name
from ksd.model.member_ends import Ends, table_ends
from ksd.numerics.rotations import make_rotations
from ksd.scene.joint import joint_leaves

Array = NDArray[np.float64]
DEFAULT_STATIONS = 25
"""Default number of stations per leaf."""


def member_ends(model: Model, motion: State, i: int) -> Ends:
    """End frames of member `i` at `motion`."""
    return table_ends(model.arrays.members, motion, i)


def member_arrays(model: Model, motion: State, i: int) -> tuple[Array, NDArray[np.int64], Array]:
    """Constants, settings and inner state (value, number, inner) of member `i`."""
    members = model.arrays.members
    inner = motion.inner[members.inner_at[i] : members.inner_at[i + 1]]
    return members.value[members.value_at[i] :], members.number[i], inner


class _LeafTables(NamedTuple):
    """Constants of `ksd.elements.strain_values` of k leaf springs of one group, unpacked.

    s (g,): quadrature points in 0..1; edges (p+1,): of the panels; panel: points of every panel; kappa (k, g, 3): curvature
    [1/m], soft (k, g, 3): compliance [1/N] at the points.
    """

    s: Array
    edges: Array
    panel: list[slice]
    kappa: Array
    soft: Array


def _unpacked(value: Array, number: NDArray[np.int64], amplitudes: Array) -> _LeafTables:
    """Tables of k leaf springs from their constants (k, v), common settings and amplitudes (k, N)."""
    nx, ny, nz, ng = (int(n) for n in number[:4])
    total = nx + ny + nz
    at = 1 + nx * nx + ny * ny + nz * nz + total
    s, edges, panel = _panels(value[0, at : at + ng * (1 + ng)].tobytes(), ng)
    at += ng * (1 + ng)
    basis, at = value[:, at : at + total * ng].reshape(-1, total, ng), at + total * ng
    cuts = (slice(0, nx), slice(nx, nx + ny), slice(nx + ny, total))
    kappa = np.stack([(amplitudes[:, None, c] @ basis[:, c])[:, 0] for c in cuts], axis=2)
    return _LeafTables(s, edges, panel, kappa, value[:, at : at + 3 * ng].reshape(-1, ng, 3))


@lru_cache(maxsize=512)
def _panels(numbers: bytes, ng: int) -> tuple[Array, Array, list[slice]]:
    """Quadrature points, edges of the panels, and points of each panel, from the bytes of weights and integration matrix of
    `ng` points."""
    weight, integral = np.frombuffer(numbers)[:ng], np.frombuffer(numbers)[ng:].reshape(ng, ng)
    # integrals up to a point need no points of later panels
    cuts = [0, *[k for k in range(1, ng) if not integral[:k, k:].any()], ng]
    panel = [slice(i, j) for i, j in pairwise(cuts)]
    edges = np.concatenate([[0.0], np.cumsum([weight[p].sum() for p in panel])])
    return integral.sum(axis=1), edges, panel


@lru_cache(maxsize=512)
def _lagrange_weights(nodes_bytes: bytes, x_bytes: bytes) -> Array:
    """Weights (x, nodes) of the polynomial interpolation at x between values at nodes, both given as bytes."""
    nodes, x = np.frombuffer(nodes_bytes), np.frombuffer(x_bytes)
    between_nodes = nodes[:, None] - nodes
    from_nodes = x[:, None, None] - nodes[None, None, :]
    own = np.eye(len(nodes), dtype=bool)
    weights: Array = np.prod(np.where(own, 1.0, from_nodes / np.where(own, 1.0, between_nodes)), axis=2)
    weights.flags.writeable = False
    return weights


def _interpolated(tables: _LeafTables, values: Array, x: Array, k: int) -> Array:
    """Values (leaf springs, len(x), 3) at x in panel k, from `values` at the quadrature points."""
    weights = _lagrange_weights(tables.s[tables.panel[k]].tobytes(), x.tobytes())
    interpolated: Array = weights @ values[:, tables.panel[k]]
    return interpolated


def strains_along(value: Array, number: NDArray[np.int64], inner: Array, s: Array) -> tuple[Array, Array]:
    """Curvature (n, 3) [1/m] about e1, e2, e3, and compliance (n, 3) [1/N] of stretch and shear, of a strain-mode leaf at
    fractions s (n,) in 0..1 of its length."""
    kappa, soft = np.empty((len(s), 3)), np.empty((len(s), 3))
    strains_at(value, number, inner, s, kappa, soft)
    return kappa, soft


def curvature(value: Array, number: NDArray[np.int64], inner: Array, s: Array) -> Array:
    """Curvature of `strains_along`."""
    return strains_along(value, number, inner, s)[0]


def cross_rows(a: Array, b: Array) -> Array:
    """Cross products (k, 3) of rows; b may be one row (3,). For few rows it takes a tenth of the time of `np.cross`."""
    return a[..., _NEXT] * b[..., _LAST] - a[..., _LAST] * b[..., _NEXT]


_NEXT, _LAST = [1, 2, 0], [2, 0, 1]
MIN_INTEGRATION_STEPS = 8
"""Smallest number of integration steps along a leaf, also for fewer stations."""


def strain_curves(
    value: Array, number: NDArray[np.int64], inner: Array, points: int, loads: Array | None = None
) -> tuple[Array, ...]:
    """Stations (leaves, k) [m], positions (leaves, k, 3) [m] and orientations (leaves, k, 3, 3) along strain-mode leaves of
    one group, in frames p, from constants (leaves, v) and inner states (leaves, N + 6).

    There are `points` stations or a few more, as the edges of the panels of a leaf with a profile are stations too. With
    load modes (leaves, D) in frames p, two more follow: the integrals Q (leaves, k, modes) of the modes beyond every
    station and their first moments up to there, int Q dr (leaves, k, modes, 3).
    """
    total, L = int(number[:3].sum()), value[:, 0]
    tables, n = _unpacked(value, number, inner[:, :total]), inner[:, None, total : total + 3]
    R = np.broadcast_to(np.eye(3), (len(value), 1, 3, 3)).copy()
    s, r, axes = [np.zeros((len(value), 1))], [np.zeros((len(value), 1, 3))], [R]
    weight, stations = _LoadsBeyond(value, number, loads), [0]
    for k, (a, b) in enumerate(pairwise(tables.edges)):
        steps = max(1, round((points - 1) * (b - a)))
        substeps = max(1, round(MIN_INTEGRATION_STEPS * (b - a) / steps))
        stations += range(stations[-1] + substeps, stations[-1] + substeps * steps + 1, substeps)
        half = 2 * steps * substeps
        x = np.linspace(a, b, half + 1)
        middle, gauss = 0.5 * (x[1:] + x[:-1]), (b - a) / (2 * math.sqrt(3) * half)
        h = (L * (b - a) / half)[:, None, None]
        kappa = _interpolated(tables, tables.kappa, np.concatenate([middle - gauss, middle + gauss]), k)
        start, R, v = R[:, -1], np.empty((len(value), len(x), 3, 3)), np.empty((len(value), len(x), 3))
        force = np.empty(v.shape)
        force[:] = n + weight.force(tables, x, k)
        integrate_centrelines(kappa, _interpolated(tables, tables.soft, x, k), force, h[:, 0, 0], start, R, v)
        weight.add(h, v)
        pieces = h / 3 * (v[:, :-2:2] + 4 * v[:, 1::2] + v[:, 2::2])
        s.append(L[:, None] * x[2::2])
        r.append(r[-1][:, -1:] + np.cumsum(pieces, axis=1))
        axes.append(R[:, 2::2])
    found = *(np.concatenate(parts, axis=1) for parts in (s, r, axes)), *weight.results()
    return found if len(stations) == found[0].shape[1] else tuple(along[:, stations] for along in found)


def group_curves(
    model: Model,
    motion: State,
    group: LeafGroup,
    points: int,
    load_factor: float,
    which: NDArray[np.int64] | slice = slice(None),
) -> tuple[Array, ...]:
    """`strain_curves` of leaf springs `which` of a group, integrated once for several questions about a state; read-only."""
    inner, loads = motion.inner[group.inner_index[which]], local_loads(model, motion, group, load_factor)
    loads = None if loads is None else loads[which]
    asked = (
        points,
        group.members[which].tobytes(),
        inner.tobytes(),
        None if loads is None else loads.tobytes(),
    )
    last, first = _last_curves(model), int(group.members[0])
    known = last.get(first)
    if known is None or known[0] != asked:
        found = strain_curves(group.value[which], group.number, inner, points, loads)
        for along in found:
            along.flags.writeable = False
        known = last[first] = asked, found
    return known[1]


@cached_per_model
def _last_curves(model: Model) -> dict[int, tuple[tuple[Any, ...], tuple[Array, ...]]]:
    """The last curves of every group, by its first member, after what they were asked for."""
    return {}


class _LoadsBeyond:
    """Accumulates, panel by panel, the distributed loads beyond the stations of leaves, and their first moments.

    Without load modes (leaf springs, D) there are no results.
    """

    def __init__(self, value: Array, number: NDArray[np.int64], loads: Array | None) -> None:
        self.loads = None if loads is None else loads.reshape(len(value), -1, 3)
        if loads is not None:
            self.beyond = np.stack([loads_beyond(leaf, number) for leaf in value])
            self.along: list[Array] = []
            self.first = [np.zeros((len(value), 1, self.beyond.shape[2], 3))]

    def force(self, tables: _LeafTables, x: Array, k: int) -> Array | float:
        """Force (leaf springs, len(x), 3) [N] of the loads beyond x in panel k, frame p."""
        if self.loads is None:
            return 0.0
        self.here = _interpolated(tables, self.beyond, x, k)
        self.along.append(self.here[:, (0 if k == 0 else 2) :: 2])
        return self.here @ self.loads

    def add(self, h: Array, v: Array) -> None:
        """Add the first moments of the panel of the last call of `force` by Simpson's rule; v (leaf springs, len(x), 3) is
        r'."""
        if self.loads is not None:
            y = self.here[..., None] * v[:, :, None]
            pieces = h[..., None] / 3 * (y[:, :-2:2] + 4 * y[:, 1::2] + y[:, 2::2])
            self.first.append(self.first[-1][:, -1:] + np.cumsum(pieces, axis=1))

    def results(self) -> tuple[Array, ...]:
        """Loads beyond (leaf springs, k, modes) and first moments (leaf springs, k, modes, 3), or nothing without loads."""
        both = (self.along, self.first) if self.loads is not None else ()
        return tuple(np.concatenate(parts, axis=1) for parts in both)


def chain_nodes(
    value: Array, number: NDArray[np.int64], inner: Array, d: Array, Q: Array
) -> tuple[Array, Array]:
    """Positions (..., n+1, 3) and rotations from rest (..., n+1, 3, 3) of the nodes of chains of n elements, in frame p.

    value, inner: constants (..., v) and inner states; d (..., 3), Q (..., 3, 3): pose of end q in frame p.
    """
    n, chains = int(number[0]), value.shape[:-1]
    x, R = np.zeros((*chains, n + 1, 3)), np.empty((*chains, n + 1, 3, 3))
    nodes = inner[..., : 12 * (n - 1)].reshape(*chains, n - 1, 12)
    x[..., 1:n, :], R[..., 1:n, :, :] = nodes[..., :3], nodes[..., 3:].reshape(*chains, n - 1, 3, 3)
    clamp = value[..., 16 * n : 16 * n + 9].reshape(*chains, 3, 3)
    R[..., 0, :, :], x[..., n, :], R[..., n, :, :] = np.eye(3), d, Q @ clamp.swapaxes(-1, -2)
    return x, R


def chain_axes(value: Array, number: NDArray[np.int64]) -> Array:
    """Section axes (..., n+1, 3, 3) at the nodes of undeformed chains, in frame p: means of those of adjacent elements."""
    n, chains = int(number[0]), value.shape[:-1]
    T = value[..., : 16 * n].reshape(*chains, n, 16)[..., 7:].reshape(*chains, n, 3, 3)
    axes = np.empty((*chains, n + 1, 3, 3))
    axes[..., 0, :, :] = np.eye(3)
    axes[..., 1:n, :, :] = nearest_rotations(0.5 * (T[..., :-1, :, :] + T[..., 1:, :, :]))
    axes[..., n, :, :] = value[..., 16 * n : 16 * n + 9].reshape(*chains, 3, 3)
    return axes


def nearest_rotations(A: Array) -> Array:
    """Rotations nearest to matrices (..., 3, 3) that are means of rotations."""
    found = A.reshape(-1, 3, 3).copy()
    make_rotations(found)
    return found.reshape(A.shape)


@lru_cache(maxsize=64)
def _station_cubics(points: int) -> tuple[Array, Array]:
    """Fractions (points,) of an element beyond its start, and the Hermite cubics (4, points) there, see
    `_hermite_cubics`."""
    u = np.linspace(0.0, 1.0, points + 1)[1:]
    return u, _hermite_cubics(u)


def _hermite_cubics(u: Array) -> Array:
    """Cubics (4, ...) at u in 0..1 with unit value at start and end, and with unit slope at start and end."""
    return np.array([1 - 3 * u**2 + 2 * u**3, 3 * u**2 - 2 * u**3, u - 2 * u**2 + u**3, u**3 - u**2])


def _chain_curves(
    value: Array, number: NDArray[np.int64], inner: Array, d: Array, Q: Array, points: int
) -> tuple[Array, ...]:
    """Stations (m, k) [m], positions (m, k, 3) and axes (m, k, 3, 3) along m chains of one group, in frames p, by cubics
    between their nodes; d (m, 3), Q (m, 3, 3): poses of ends q."""
    m, n = len(value), int(number[0])
    x, R = chain_nodes(value, number, inner, d, Q)
    axes = R @ chain_axes(value, number)
    lengths = value[:, : 16 * n : 16]
    u, weights = _station_cubics(max(1, math.ceil((points - 1) / n)))
    slopes = (lengths[..., None] * axes[:, part, :, 0] for part in (slice(-1), slice(1, None)))
    position = np.einsum("wk,wmni->mnki", weights, np.array([x[:, :-1], x[:, 1:], *slopes]))
    part = u[:, None, None]
    between = nearest_rotations((1 - part) * axes[:, :-1, None] + part * axes[:, 1:, None])
    s = (np.cumsum(lengths, axis=1) - lengths)[..., None] + lengths[..., None] * u
    return (
        np.concatenate([np.zeros((m, 1)), s.reshape(m, -1)], axis=1),
        np.concatenate([x[:, :1], position.reshape(m, -1, 3)], axis=1),
        np.concatenate([axes[:, :1], between.reshape(m, -1, 3, 3)], axis=1),
    )


def centrelines(
    model: Model,
    motion: State,
    group: LeafGroup,
    which: NDArray[np.int64] | slice,
    points: int,
    load_factor: float,
) -> tuple[Array, Array, Array]:
    """Stations (m, k) [m], positions (m, k, 3) and axes (m, k, 3, 3), global, along members `which` (m,) of a group of leaf
    springs or chains, which loads times load_factor along them stretch too.

    The curve of a state of a fast method ends a little off its clamp (its error); the gap is distributed along the leaf.
    """
    ends = end_frames(model, motion, group.members[which])
    if not group.is_chain:
        s, r, R, *_ = group_curves(model, motion, group, points, load_factor, which)
        r = r + (s / s[:, -1:])[..., None] * (ends.d - r[:, -1])[:, None]
    else:
        Q, inner = end_axes(model, motion, group.members[which], ends), motion.inner[group.inner_index[which]]
        s, r, R = _chain_curves(group.value[which], group.number, inner, ends.d, Q, points)
    return s, ends.start[:, None] + r @ ends.frame.swapaxes(1, 2), ends.frame[:, None] @ R


def solid_line(model: Model, motion: State, i: int) -> tuple[Array, Array, Array]:
    """Stations (k,) [m], positions (k, 3) and axes (k, 3, 3), global, along the middle of the reduced solid `i`."""
    ends, (_, _, inner) = member_ends(model, motion, i), member_arrays(model, motion, i)
    s, r, R = model.bodies[model.member_names[i]].middle_line(ends.d, ends.Q, inner)
    return s, ends.start + r @ ends.frame.T, ends.frame @ R


def poses_along(
    model: Model,
    motion: State,
    group: LeafGroup,
    which: NDArray[np.int64],
    share: Array,
    points: int,
    load_factor: float,
) -> tuple[Array, Array]:
    """Positions (s, 3) and axes (s, 3, 3), global, at fractions `share` (s,) of the lengths of members `which` (s,) of a
    group, with loads times load_factor.

    They are interpolated between `points` stations of a strain-mode leaf, and by the cubics of `member_centreline` in
    chains.
    """
    if group.is_chain:
        return _along_chains(model, motion, group, which, share)
    own, k = np.unique(which, return_inverse=True)
    s, r, R = centrelines(model, motion, group, own, points, load_factor)
    along = s / s[:, -1:]
    after = np.maximum((along[k] < share[:, None]).sum(axis=1), 1)
    low, high = along[k, after - 1, None], along[k, after, None]
    part = (share[:, None] - low) / (high - low)
    place = (1.0 - part) * r[k, after - 1] + part * r[k, after]
    part = part[..., None]
    return place, nearest_rotations((1.0 - part) * R[k, after - 1] + part * R[k, after])


def chain_lines(
    model: Model, motion: State, group: LeafGroup, which: NDArray[np.int64] | slice = slice(None)
) -> tuple[EndFrames, Array, Array]:
    """End frames of chains `which` of a group, and positions (k, n+1, 3) and axes (k, n+1, 3, 3) of their nodes, in frame
    p."""
    value, members = group.value[which], group.members[which]
    ends = end_frames(model, motion, members)
    Q = end_axes(model, motion, members, ends)
    x, R = chain_nodes(value, group.number, motion.inner[group.inner_index[which]], ends.d, Q)
    return ends, x, R @ chain_axes(value, group.number)


def _along_chains(
    model: Model, motion: State, group: LeafGroup, which: NDArray[np.int64], share: Array
) -> tuple[Array, Array]:
    """`poses_along` of chains."""
    n = int(group.number[0])
    (ends, x, node_axes), lengths = (
        chain_lines(model, motion, group, which),
        group.value[which, : 16 * n : 16],
    )
    edges, each = np.cumsum(lengths, axis=1), np.arange(len(which))
    at = share * edges[:, -1]
    e = np.minimum((edges < at[:, None]).sum(axis=1), n - 1)
    length = lengths[each, e]
    u = (1.0 - (edges[each, e] - at) / length)[:, None]
    before, after = node_axes[each, e], node_axes[each, e + 1]
    weights, slopes = _hermite_cubics(u), (length[:, None] * axes[:, :, 0] for axes in (before, after))
    local = (weights * np.array([x[each, e], x[each, e + 1], *slopes])).sum(axis=0)
    axes = nearest_rotations((1.0 - u[..., None]) * before + u[..., None] * after)
    return ends.start + (ends.frame @ local[..., None])[..., 0], ends.frame @ axes


@cached_per_model
def scene_leaves(model: Model) -> dict[str, Any]:
    """Leaf springs of the scene by full name: "joint/leaf" inside joints, the plain name for others."""
    inside = {f"{j.name}/{leaf.name}": leaf for j in model.scene.joints for leaf in joint_leaves(j.joint)}
    return inside | {leaf.name: leaf.leaf for leaf in model.scene.leaves}


@cached_per_model
def leaf_members(model: Model) -> dict[str, list[int]]:
    """Members of every leaf by full name, in order: one, or its pieces between points, or its elements in a nodal mesh."""
    leaves = scene_leaves(model)
    found: dict[str, list[int]] = {}
    for i, name in enumerate(model.member_names):
        found.setdefault(whole_leaf_name(name, leaves), []).append(i)
    return found
