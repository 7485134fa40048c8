"""Geometry of a configuration: centrelines and section axes of leaf springs, points of rigid blocks, drives and loads.

A strain-mode leaf is integrated from its curvature, R' = R [kappa]x and r' = R (e1 + C R^T n), by fourth-order steps (a
Magnus step at two Gauss points, Simpson's rule for the position). A chain of Appendix A elements is interpolated between its
nodes by cubics with the tangents of the nodes. Global axes, SI units.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ksd.answers.derived import cached_per_model
from ksd.answers.leaf_groups import (
    EndFrames,
    LeafGroup,
    chain_groups,
    end_axes,
    end_frames,
    leaf_groups,
    local_loads,
)
from ksd.elements.strain_centreline import integrate_centrelines
from ksd.elements.strain_values import loads_beyond
from ksd.model.arrays import SOLID, State
from ksd.model.compile import Model
from ksd.model.leaves import whole_leaf_name
from ksd.numerics.rotations import make_rotations
from ksd.scene.effects import Spring
from ksd.scene.joint import joint_leaves
from ksd.scene.line_load import SIDES, Pressure
from ksd.scene.sensor import Damper
from ksd.scene.shapes import ContactShape
from ksd.section.closed_forms import round_ratio
from ksd.section.section import thickness_and_width

Array = NDArray[np.float64]
DEFAULT_STATIONS = 25
"""Default number of stations per leaf."""


@dataclass(frozen=True)
class LeafShape:
    """Centreline of one leaf at k stations, undeformed and deformed.

    s (k,): distance from its start along the undeformed leaf [m]. rest, place (k, 3): undeformed and deformed positions [m],
    global. rest_axes, axes (k, 3, 3): section axes e1, e2 (thickness), e3 (width) as columns, global. width, thickness (k,)
    [m]: of the section; of a section without these sizes, from its second moments. is_round: circles or tubes, of which
    both are the diameter and e2, e3 any directions.
    """

    name: str
    s: Array
    rest: Array
    place: Array
    rest_axes: Array
    axes: Array
    width: Array
    thickness: Array
    is_round: bool = False


OUTLINE_POINTS = 49
"""Points of the outline of a disc."""


@dataclass(frozen=True)
class BlockShape:
    """Points of a rigid block (link, ground, or block inside a joint): clamps of leaf springs, points of action of drives,
    loads and springs, positions of masses, and ends of distances.

    rest, place (k, 3): undeformed and deformed positions [m], global; owner (k,): name of what each point belongs to. leaf,
    station (k,): number of the leaf that ends there, -1 where none does, and its station there (0 or -1). rotation (3, 3),
    position (3,) [m]: of the global frame when it is moved with the block: what is at x at rest comes to position +
    rotation @ x.
    """

    name: str
    rest: Array
    place: Array
    rotation: Array
    position: Array
    owner: tuple[str, ...]
    leaf: NDArray[np.int64]
    station: NDArray[np.int64]


@dataclass(frozen=True)
class DrivenPoint:
    """A driven point of kind "translation" or "rotation": its undeformed and deformed position (3,) [m], direction (3,)."""

    name: str
    kind: str
    rest: Array
    place: Array
    direction: Array


@dataclass(frozen=True)
class HingeShape:
    """A "pin", "slider", "ball" or "cylindrical" hinge: its undeformed and deformed position (3,) [m] on its second
    link, and its deformed axis (3,)."""

    name: str
    kind: str
    rest: Array
    place: Array
    axis: Array


@dataclass(frozen=True)
class LoadShape:
    """A load of kind "force" [N], "moment" [Nm] or "mass" [kg]: its point of action (3,) [m] and value (3,), of a mass
    (1,)."""

    name: str
    kind: str
    place: Array
    value: Array


@dataclass(frozen=True)
class LineLoadShape:
    """A load along a leaf: points (k, 3) [m] on its centreline, the force per length there (k, 3) [N/m], and its value as
    text."""

    name: str
    place: Array
    value: Array
    text: str


@dataclass(frozen=True)
class SpringShape:
    """A coil spring with deformed ends (2, 3) [m], or a torsion spring with one point (1, 3)."""

    name: str
    ends: Array


@dataclass(frozen=True)
class DistanceShape:
    """A distance that the scene defines: its deformed ends (2, 3) [m] and the direction (3,) in which it is measured."""

    name: str
    ends: Array
    direction: Array


@dataclass(frozen=True)
class SensorShape:
    """A sensor, or a damper (`damps`): deformed place (3,) [m], and the direction (3,) along which it acts, or about which
    where it `turns`."""

    name: str
    place: Array
    direction: Array
    turns: bool
    damps: bool


@dataclass(frozen=True)
class CableShape:
    """A cable: its deformed points (n, 3) [m] in order."""

    name: str
    points: Array


@dataclass(frozen=True)
class SurfaceShape:
    """A surface that may touch: its deformed outline (n, 3) [m], closed but for a wall."""

    name: str
    outline: Array


@dataclass(frozen=True)
class StopShape:
    """A limit of an end stop: where the point meets it (3,) [m], and the direction (3,) in which the stop pushes."""

    name: str
    place: Array
    direction: Array


@dataclass(frozen=True)
class Shape:
    """Everything that is drawn of a configuration; leaf springs and blocks in the order of the model."""

    leaves: tuple[LeafShape, ...]
    blocks: tuple[BlockShape, ...]
    driven: tuple[DrivenPoint, ...]
    hinges: tuple[HingeShape, ...] = ()
    loads: tuple[LoadShape, ...] = ()
    springs: tuple[SpringShape, ...] = ()
    distances: tuple[DistanceShape, ...] = ()
    sensors: tuple[SensorShape, ...] = ()
    cables: tuple[CableShape, ...] = ()
    stops: tuple[StopShape, ...] = ()
    surfaces: tuple[SurfaceShape, ...] = ()
    line_loads: tuple[LineLoadShape, ...] = ()


@dataclass(frozen=True)
class Ends:
    """End frames of a member: p at start (3,) with axes frame (3, 3), global; q at d (3,) with axes Q (3, 3), in frame p."""

    start: Array
    frame: Array
    d: Array
    Q: Array


def member_ends(model: Model, motion: State, i: int) -> Ends:
    """End frames of member `i` at `motion`."""
    members = model.arrays.members
    a, b = members.node[i]
    frame = motion.R[a] @ members.frame[i, 0]
    start = motion.x[a] + motion.R[a] @ members.offset[i, 0]
    end = motion.x[b] + motion.R[b] @ members.offset[i, 1]
    return Ends(start, frame, frame.T @ (end - start), frame.T @ motion.R[b] @ members.frame[i, 1])


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
    tables = _unpacked(value[None], number, inner[None, : int(number[:3].sum())])
    panel = np.clip(np.searchsorted(tables.edges, s, side="right") - 1, 0, len(tables.panel) - 1)
    found = np.empty((2, len(s), 3))
    for k in np.unique(panel).tolist():
        own = panel == k
        found[:, own] = [_interpolated(tables, v, s[own], k)[0] for v in (tables.kappa, tables.soft)]
    return found[0], found[1]


def curvature(value: Array, number: NDArray[np.int64], inner: Array, s: Array) -> Array:
    """Curvature of `strains_along`."""
    return strains_along(value, number, inner, s)[0]


def quadrature_points(value: Array, number: NDArray[np.int64]) -> Array:
    """Fractions (ng,) of the length of a strain-mode leaf at which its modes are known."""
    return _unpacked(value[None], number, np.zeros((1, int(number[:3].sum())))).s


def fitted_amplitudes(value: Array, number: NDArray[np.int64], kappa: Array) -> Array:
    """Amplitudes (N,) of a strain-mode leaf whose curvature is nearest to kappa (ng, 3) [1/m] at its `quadrature_points`."""
    nx, ny, nz, ng = (int(n) for n in number[:4])
    total = nx + ny + nz
    at = 1 + nx * nx + ny * ny + nz * nz + total + ng * (1 + ng)
    basis, cuts = (
        value[at : at + total * ng].reshape(total, ng),
        (slice(0, nx), slice(nx, nx + ny), slice(nx + ny, total)),
    )
    return np.concatenate(
        [np.linalg.lstsq(basis[c].T, kappa[:, k], rcond=None)[0] for k, c in enumerate(cuts)]
    )


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


def _solid_line(model: Model, motion: State, i: int) -> tuple[Array, Array, Array]:
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


class _LeafAtRest(NamedTuple):
    """What a leaf is at its stations in every configuration: its members, those of their stations that count (the common
    one of two members does once), and fields of its `LeafShape`."""

    members: list[int]
    stations: list[slice]
    fixed: dict[str, Any]


class _Stations(NamedTuple):
    """Members to be drawn together, each a group, positions in it and number of stations, and all leaves at rest."""

    together: list[tuple[LeafGroup, NDArray[np.int64], int]]
    leaves: list[_LeafAtRest]


@cached_per_model
def _stations_by_points(model: Model) -> dict[int, _Stations]:
    """Cache of `_stations`."""
    return {}


def _stations(model: Model, points: int) -> _Stations:
    """Stations of all leaves, of each `points` or a few more, divided among its members."""
    cache = _stations_by_points(model)
    if points not in cache:
        leaves = leaf_members(model)
        count = np.zeros(len(model.member_names), int)
        for members in leaves.values():
            count[members] = max(2, math.ceil((points - 1) / len(members)) + 1)
        together = [
            (group, np.flatnonzero(count[group.members] == n), int(n))
            for group in (*leaf_groups(model), *chain_groups(model))
            for n in np.unique(count[group.members])
        ]
        lines = _member_lines(model, model.rest, together, 0.0)
        cache[points] = _Stations(
            together, [_leaf_at_rest(model, name, parts, lines) for name, parts in leaves.items()]
        )
    return cache[points]


def _member_lines(
    model: Model,
    motion: State,
    together: list[tuple[LeafGroup, NDArray[np.int64], int]],
    load_factor: float,
) -> dict[int, tuple[Array, Array, Array]]:
    """Stations (k,) [m], positions (k, 3) and axes (k, 3, 3), global, along every leaf spring, chain and solid by member."""
    kind = model.arrays.members.kind
    lines = {int(i): _solid_line(model, motion, int(i)) for i in np.flatnonzero(kind == SOLID)}
    for group, which, points in together:
        each = centrelines(model, motion, group, which, points, load_factor)
        lines |= dict(zip(group.members[which].tolist(), zip(*each, strict=True), strict=True))
    return lines


def _leaf_at_rest(
    model: Model, name: str, members: list[int], lines: dict[int, tuple[Array, Array, Array]]
) -> _LeafAtRest:
    """The whole leaf of these members, with their `lines` at rest."""
    leaf = scene_leaves(model)[name]
    own = [slice(int(k > 0), None) for k in range(len(members))]
    at = np.cumsum([0.0] + [lines[i][0][-1] for i in members])
    s = np.concatenate(
        [lines[i][0][part] + at[k] for k, (i, part) in enumerate(zip(members, own, strict=True))]
    )
    rest, rest_axes = (_joined(lines, members, own, c) for c in (1, 2))
    # at a step of the profile the larger side counts
    sections = [
        (leaf.section,) if leaf.profile is None else leaf.profile.sides(x) for x in (s / s[-1]).tolist()
    ]
    thickness, width = np.array(
        [np.max([thickness_and_width(q) for q in sides], axis=0) for sides in sections]
    ).T
    is_round = all(round_ratio(q) is not None for sides in sections for q in sides)
    fixed = {
        "name": name, "s": s, "rest": rest, "rest_axes": rest_axes, "width": width, "thickness": thickness,
        "is_round": is_round,
    }  # fmt: skip
    return _LeafAtRest(members, own, fixed)


def _joined(
    lines: dict[int, tuple[Array, Array, Array]], members: list[int], stations: list[slice], column: int
) -> Array:
    """A column of the lines of the members of a leaf, joined."""
    if len(members) == 1:
        return lines[members[0]][column]
    return np.concatenate([lines[i][column][part] for i, part in zip(members, stations, strict=True)])


def _leaf_shapes(model: Model, motion: State, points: int, load_factor: float) -> Iterator[LeafShape]:
    """Shapes of all leaves, each at `points` stations or a few more."""
    stations = _stations(model, points)
    lines = _member_lines(model, motion, stations.together, load_factor)
    for members, own, fixed in stations.leaves:
        yield LeafShape(place=_joined(lines, members, own, 1), axes=_joined(lines, members, own, 2), **fixed)


def _driven(model: Model, motion: State) -> tuple[DrivenPoint, ...]:
    index = {link: i for i, link in enumerate(model.scene.links)}
    found = []
    for drive in model.scene.drives:
        term = drive.terms[0]
        node, rest = index[term.link], np.asarray(term.point, float)
        if term.kind == "rotation" and not rest.any():
            # without a point it turns the whole link
            rest = model.rest.x[node]
        place = point_position(model, motion, node, rest)
        along = motion.R[index[term.base]] @ np.asarray(term.direction, float)
        found.append(DrivenPoint(drive.name, term.kind, rest, place, along))
    return tuple(found)


@cached_per_model
def _block_points(model: Model) -> list[tuple[int, dict[str, Any]]]:
    """Node of every block that has points, and what its `BlockShape` is in every configuration."""
    members, leaves = model.arrays.members, leaf_members(model)
    # of every block: arm, owner, leaf and station of every point
    found: list[list[tuple[Array, str, int, int]]] = [[] for _ in model.node_names]
    for k, (name, parts) in enumerate(leaves.items()):
        for i, end in ((parts[0], 0), (parts[-1], 1)):
            clamped = (members.offset[i, end], name.rsplit("/", 1)[0], k, -end)
            found[int(members.node[i, end])].append(clamped)
    index = {link: i for i, link in enumerate(model.scene.links)}
    for hinge in model.scene.hinges:
        for node in {index[hinge.a], index[hinge.b]} - ({0} if hinge.kind == "slider" else set()):
            found[node].append((np.asarray(hinge.at) - model.rest.x[node], hinge.name, -1, 0))
    for drive in model.scene.drives:
        for term in drive.terms:
            if term.kind == "translation":
                arm = np.asarray(term.point, float) - model.rest.x[index[term.link]]
                found[index[term.link]].append((arm, drive.name, -1, 0))
    for link, at, owner_name in _points_on_links(model):
        # ground is drawn only where something is clamped to it
        if index[link]:
            found[index[link]].append((np.asarray(at, float) - model.rest.x[index[link]], owner_name, -1, 0))
    blocks = []
    for node, name in enumerate(model.node_names):
        if found[node]:
            arms, owner, leaf, station = zip(*found[node], strict=True)
            fixed = {"name": name, "rest": model.rest.x[node] + np.array(arms), "owner": owner}
            blocks.append((node, fixed | {"leaf": np.array(leaf), "station": np.array(station)}))
    return blocks


def _blocks(model: Model, motion: State) -> Iterator[BlockShape]:
    for node, fixed in _block_points(model):
        R, x, x_rest = motion.R[node], motion.x[node], model.rest.x[node]
        place = x + (fixed["rest"] - x_rest) @ R.T
        yield BlockShape(place=place, rotation=R.copy(), position=x - R @ x_rest, **fixed)


def _points_on_links(model: Model) -> Iterator[tuple[str, ArrayLike, str]]:
    """Link, position (3,) [m] at rest and name of loads, masses, sensors, dampers, ends of springs and of distances."""
    scene = model.scene
    for load in scene.loads:
        if np.any(load.force):
            yield load.link, load.at, load.name
    for mass in scene.masses:
        if mass.mass:
            yield mass.link, mass.at, mass.link
    for spring in scene.springs:
        if isinstance(spring, Spring):
            yield spring.a, spring.start, spring.name
            yield spring.b, spring.end, spring.name
    for part in (*scene.sensors, *scene.dampers):
        if part.term.kind == "translation":
            yield part.term.link, part.term.point, part.name
    for distance in scene.distances:
        yield distance.a, distance.start, distance.name
        yield distance.b, distance.end, distance.name
    for cable in model.original_scene.cables:
        for link, at in cable.points:
            yield link, at, cable.name
    for surface in model.original_scene.surfaces:
        yield surface.link, surface.at, surface.name


def _hinges(model: Model, motion: State) -> tuple[HingeShape, ...]:
    index = {link: i for i, link in enumerate(model.scene.links)}
    found = []
    for hinge in model.scene.hinges:
        a, b, rest = index[hinge.a], index[hinge.b], np.asarray(hinge.at)
        place = point_position(model, motion, b, rest)
        found.append(HingeShape(hinge.name, hinge.kind, rest, place, motion.R[a] @ np.asarray(hinge.axis)))
    return tuple(found)


def _loads(model: Model, motion: State, *, factor: float) -> tuple[LoadShape, ...]:
    """Forces and moments of the scene times `factor`, and point masses."""
    index, found = {link: i for i, link in enumerate(model.scene.links)}, []
    for load in model.scene.loads:
        node = index[load.link]
        turned = factor * (motion.R[node] if load.following else np.eye(3))
        for kind in ("force", "moment"):
            value = np.asarray(getattr(load, kind))
            if value.any():
                # a moment without a point turns the whole link
                whole = not any(load.force) and not any(load.at)
                place = point_position(model, motion, node, model.rest.x[node] if whole else load.at)
                found.append(LoadShape(load.name, kind, place, turned @ value))
    for mass in model.scene.masses:
        place = point_position(model, motion, index[mass.link], mass.at)
        found.append(LoadShape(mass.link, "mass", place, np.array([mass.mass])))
    return tuple(found)


LINE_LOAD_ARROWS = 7
"""Arrows of a load along a leaf."""


def _line_loads(scene: Any, leaves: Sequence[LeafShape], factor: float) -> Iterator[LineLoadShape]:
    """Loads along leaf springs times `factor`, at a few points."""
    shapes = {leaf.name: leaf for leaf in leaves}
    for load in scene.loads_along:
        leaf = shapes[load.leaf]
        s = np.linspace(load.start, leaf.s[-1] if load.end is None else load.end, LINE_LOAD_ARROWS)
        place, side, width = (
            np.array([np.interp(s, leaf.s, column) for column in part.reshape(len(leaf.s), -1).T]).T
            for part in (leaf.place, leaf.axes[:, :, 1], leaf.width)
        )
        if isinstance(load, Pressure):
            value = SIDES[load.side] * load.pressure * width * side
            text = f"{1e-3 * factor * load.pressure:.4g} kPa"
        else:
            share = np.linspace(0.0, 1.0, LINE_LOAD_ARROWS)[:, None]
            value = (1.0 - share) * np.asarray(load.force) + share * np.asarray(load.end_force)
            ends = [f"{factor * np.linalg.norm(force):.4g}" for force in (load.force, load.end_force)]
            text = f"{' to '.join(dict.fromkeys(ends))} N/m"
        yield LineLoadShape(load.name, place, factor * value, text)


def _springs(model: Model, motion: State) -> tuple[SpringShape, ...]:
    index, found = {link: i for i, link in enumerate(model.scene.links)}, []
    for spring in model.scene.springs:
        ends = (
            ((spring.a, spring.start), (spring.b, spring.end))
            if isinstance(spring, Spring)
            else ((spring.b, spring.at),)
        )
        places = [point_position(model, motion, index[link], at) for link, at in ends]
        found.append(SpringShape(spring.name, np.array(places)))
    return tuple(found)


def _distances(model: Model, motion: State) -> tuple[DistanceShape, ...]:
    index, found = {link: i for i, link in enumerate(model.scene.links)}, []
    for distance in model.scene.distances:
        points = (distance.a, distance.start), (distance.b, distance.end)
        ends = np.array([point_position(model, motion, index[link], at) for link, at in points])
        direction = ends[1] - ends[0] if distance.along is None else np.asarray(distance.along)
        if distance.turns_with is not None:
            direction = motion.R[index[distance.turns_with]] @ direction
        norm = max(float(np.linalg.norm(direction)), 1e-300)
        found.append(DistanceShape(distance.name, ends, direction / norm))
    return tuple(found)


def _sensors(model: Model, motion: State) -> tuple[SensorShape, ...]:
    index, found = {link: i for i, link in enumerate(model.scene.links)}, []
    for part in (*model.scene.sensors, *model.scene.dampers):
        term = part.term
        turns = term.kind == "rotation"
        node = index[term.link]
        # a rotation without a point is that of the whole link
        at = model.rest.x[node] if turns and not any(term.point) else term.point
        direction = motion.R[index[term.base]] @ np.asarray(term.direction)
        place = point_position(model, motion, node, at)
        found.append(SensorShape(part.name, place, direction, turns, isinstance(part, Damper)))
    return tuple(found)


def _cables(model: Model, motion: State) -> tuple[CableShape, ...]:
    index = {link: i for i, link in enumerate(model.scene.links)}
    return tuple(
        CableShape(
            c.name, np.array([point_position(model, motion, index[link], at) for link, at in c.points])
        )
        for c in model.original_scene.cables
    )


def _stops(model: Model, motion: State) -> tuple[StopShape, ...]:
    """Limits of stops of one displacement, those of the scene; others have no place."""
    index, found = {link: i for i, link in enumerate(model.scene.links)}, []
    for stop in model.original_scene.stops:
        term = stop.terms[0]
        if len(stop.terms) > 1 or term.kind == "rotation":
            continue
        base, direction = index[term.base], motion.R[index[term.base]] @ np.asarray(term.direction)
        at_rest = point_position(model, motion, base, term.point)
        for name, value in stop.limits.items():
            inward = direction if name.endswith(".low") else -direction
            found.append(StopShape(name, at_rest + value / term.coefficient * direction, inward))
    return tuple(found)


def _surfaces(model: Model, motion: State) -> tuple[SurfaceShape, ...]:
    """Outlines of surfaces in their x and y, of a wall along its x."""
    index, found = {link: i for i, link in enumerate(model.scene.links)}, []
    turn = np.linspace(0.0, 2.0 * np.pi, OUTLINE_POINTS)
    for s in model.original_scene.surfaces:
        at_rest = np.asarray(s.at) + _outline(s.shape, turn, model.arrays.size) @ np.array(s.axes)
        outline = [point_position(model, motion, index[s.link], p) for p in at_rest]
        found.append(SurfaceShape(s.name, np.array(outline)))
    return tuple(found)


def _outline(shape: ContactShape, turn: Array, size: float) -> Array:
    """Points (n, 3) [m] of one line that shows a shape, in its axes; turn (m,) [rad]: of circles; size [m]: of a wall."""
    c, o, flat = np.cos(turn), np.sin(turn), 0.0 * turn
    if shape.kind == "wall":
        return np.array([[-0.2 * size, 0.0, 0.0], [0.2 * size, 0.0, 0.0]])
    if shape.kind == "box":
        # all edges
        return np.array(shape.tips)[[0, 1, 2, 3, 0, 4, 5, 1, 5, 6, 2, 6, 7, 3, 7, 4]]
    if shape.kind == "capsule":
        r, z = shape.sizes[0], shape.sizes[0] * o + 0.5 * shape.sizes[1] * np.sign(o)
        return np.concatenate([np.stack([r * c, flat, z], axis=1), np.stack([r * c, r * o, flat], axis=1)])
    if shape.points:
        return np.array([*shape.tips, shape.tips[0]])
    a, b, *more = shape.sizes if len(shape.sizes) > 1 else 3 * shape.sizes
    round_z = np.stack([a * c, b * o, flat], axis=1)
    if shape.is_plane:
        return round_z
    return np.concatenate([round_z, np.stack([a * c, flat, more[0] * o], axis=1)])


def point_position(model: Model, motion: State, node: int, at: ArrayLike) -> Array:
    """Deformed position (3,) [m] of the point of a node that is at `at` (3,) [m] at rest."""
    arm = np.asarray(at, float) - model.rest.x[node]
    position: Array = motion.x[node] + motion.R[node] @ arm
    return position


def mechanism_shape(
    model: Model, motion: State, *, points: int = DEFAULT_STATIONS, load_factor: float = 1.0
) -> Shape:
    """Geometry of `model` at `motion`, with at least `points` stations per leaf and loads times load_factor."""
    leaves = tuple(_leaf_shapes(model, motion, points, load_factor))
    return Shape(
        leaves, tuple(_blocks(model, motion)), _driven(model, motion),
        _hinges(model, motion),
        _loads(model, motion, factor=load_factor), _springs(model, motion), _distances(model, motion),
        _sensors(model, motion), _cables(model, motion), _stops(model, motion),
        _surfaces(model, motion), tuple(_line_loads(model.scene, leaves, load_factor)),
    )  # fmt: skip
