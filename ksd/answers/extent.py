"""Extent of the leaf springs of a configuration, and clearance between those that are not neighbours.

A sheet is divided into flat pieces between its stations. The distance of two pieces is the smallest distance of two edges,
or of a corner and a face, in closed form (Ericson, Real-Time Collision Detection, 2005, section 5.1). Half the thickness of
both is subtracted. A leaf of round section is its centreline less half the diameter.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import cdist

from ksd.answers.centrelines import leaf_members
from ksd.answers.derived import cached_per_model
from ksd.answers.printing import PrintableAnswer, format_number
from ksd.answers.shape import LeafShape, mechanism_shape
from ksd.errors import SceneError
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.scene.scene import Scene

Array = NDArray[np.float64]
_CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
PAIRS_PER_CHUNK = 32
"""Number of pairs of flat pieces evaluated together, the nearest first."""
LINE_WIDTH = 1e-6
"""Width of the centreline of a round leaf, relative to its diameter."""
_FIRST_EDGE, _SECOND_EDGE = (k.ravel() for k in np.meshgrid(np.arange(4), np.arange(4)))


def why_no_clearance(scene: Scene) -> str:
    """Why no two leaf springs have a clearance; empty where some do."""
    if scene.leaves_apart():
        return ""
    count = len(scene.leaf_names())
    if count < 2:
        return f"a clearance is the distance of two leaf springs, and it has {'one' if count else 'none'}"
    return "every two leaf springs share a block or are in one joint with windows"


@dataclass(frozen=True, repr=False)
class Clearance(PrintableAnswer):
    """Smallest distance [m] between two leaf springs that share no block and are not in one joint with windows.

    Half the thickness of both is subtracted; it is not positive where they touch. leaves: their names.
    """

    distance: float
    leaves: tuple[str, str]

    def _line(self) -> str:
        return f"{format_number(1e3 * self.distance)} mm, '{self.leaves[0]}' and '{self.leaves[1]}'"

    def __str__(self) -> str:
        return f"Smallest clearance: {self._line()}"


def leaf_extents(model: Model, motion: State) -> dict[str, Array]:
    """Smallest and largest coordinates (2, 3) [m, global] of every leaf spring, width and thickness included."""
    found = {}
    for leaf in mechanism_shape(model, motion).leaves:
        # half extent of the sections along the global axes
        second, third = (
            np.abs(leaf.axes[:, :, 1]).T * leaf.thickness,
            np.abs(leaf.axes[:, :, 2]).T * leaf.width,
        )
        half = 0.5 * (np.hypot(second, third) if leaf.is_round else second + third)
        found[leaf.name] = np.array([(leaf.place - half.T).min(axis=0), (leaf.place + half.T).max(axis=0)])
    return found


def extent(model: Model, motion: State) -> Array:
    """Smallest and largest coordinates (2, 3) [m, global] of all leaf springs."""
    return common_extent(leaf_extents(model, motion))


def common_extent(extents: Mapping[str, Array]) -> Array:
    """Smallest and largest coordinates (2, 3) of several extents (2, 3) by name."""
    ends = np.array(list(extents.values())).reshape(-1, 2, 3)
    return np.array([ends[:, 0].min(axis=0, initial=np.inf), ends[:, 1].max(axis=0, initial=-np.inf)])


def clearance(model: Model, motion: State) -> Clearance:
    """Clearance of a configuration, see `Clearance`; raises SceneError where no two leaf springs have one."""
    leaves = mechanism_shape(model, motion).leaves
    one, two = _leaf_pairs(model)
    if not len(one):
        raise SceneError(f"'{model.scene.name}' has no clearance: {why_no_clearance(model.scene)}.")
    piece = [_flat_pieces(f) for f in leaves]
    half = np.array([0.5 * f.thickness.max() for f in leaves])
    ends = [_corners(p).reshape(-1, 3) for p in piece]
    low, high = (np.array([end(c, axis=0) for c in ends]) for end in (np.min, np.max))
    least = np.linalg.norm(np.maximum(0.0, np.maximum(low[one] - high[two], low[two] - high[one])), axis=1)
    least -= half[one] + half[two]
    best, nearest = np.inf, (0, 0)
    for k in np.argsort(least):
        if least[k] >= best:
            break
        i, j = int(one[k]), int(two[k])
        distance = _sheet_distance(piece[i], piece[j], best + half[i] + half[j]) - half[i] - half[j]
        if distance < best:
            best, nearest = distance, (i, j)
    return Clearance(float(best), (leaves[nearest[0]].name, leaves[nearest[1]].name))


@cached_per_model
def _leaf_pairs(model: Model) -> NDArray[np.int64]:
    """Pairs (2, k) of leaf springs that have a clearance, as numbers in the shape."""
    index = {name: k for k, name in enumerate(leaf_members(model))}
    pairs = [(index[a], index[b]) for a, b in model.scene.leaves_apart()]
    return np.array(pairs, dtype=np.int64).reshape(-1, 2).T


def _flat_pieces(leaf: LeafShape) -> Array:
    """Centres, half edges along and half edges across (3, k, 3) of the flat pieces of a sheet; a round leaf is a line."""
    width = LINE_WIDTH * leaf.width if leaf.is_round else leaf.width
    across = 0.5 * width[:, None] * leaf.axes[:, :, 2]
    ends = leaf.place[:-1], leaf.place[1:]
    return np.array([0.5 * (ends[0] + ends[1]), 0.5 * (ends[1] - ends[0]), 0.5 * (across[:-1] + across[1:])])


def _sheet_distance(one: Array, two: Array, limit: float) -> float:
    """Distance of two sheets of pieces (3, k, 3); inf where it is not below `limit`."""
    gap = np.maximum(_box_distance_bound(one, two), _box_distance_bound(two, one).T)
    # the distance of the nearest centres is an upper bound
    i, j = np.nonzero(gap <= min(limit, float(cdist(one[0], two[0]).min())))
    nearest = np.argsort(gap[i, j])
    best = np.inf
    for part in np.split(nearest, range(PAIRS_PER_CHUNK, len(nearest), PAIRS_PER_CHUNK)):
        if len(part) and gap[i[part[0]], j[part[0]]] < best:
            best = min(best, float(_flat_distance(one[:, i[part]], two[:, j[part]]).min()))
    return best


def _box_distance_bound(one: Array, two: Array) -> Array:
    """Lower bounds (n, m) of the distances of pieces (3, n, 3) from pieces (3, m, 3), in the axes of the former."""
    axes = np.stack([one[1], np.cross(one[1], one[2]), one[2]], axis=1)
    axes[:, 2] = np.cross(axes[:, 0], axes[:, 1])
    axes /= np.linalg.norm(axes, axis=2, keepdims=True)
    middle, *edges = (part @ np.swapaxes(axes, 1, 2) for part in two[:, None])
    own = np.abs(axes @ np.moveaxis(one[1:], 0, 2)).sum(axis=2)
    offset = np.abs(middle - (axes @ one[0][:, :, None]).swapaxes(1, 2)) - own[:, None]
    gap: Array = np.linalg.norm(np.maximum(0.0, offset - np.abs(edges[0]) - np.abs(edges[1])), axis=2)
    return gap


def _flat_distance(one: Array, two: Array) -> Array:
    """Distances (n,) between n pairs of flat pieces (3, n, 3)."""
    corners = [_corners(p) for p in (one, two)]
    ends = [(c, np.roll(c, -1, axis=1)) for c in corners]
    best = _edge_distance(*(e[:, _FIRST_EDGE] for e in ends[0]), *(e[:, _SECOND_EDGE] for e in ends[1])).min(
        axis=1
    )
    for face, own in ((two, 0), (one, 1)):
        best = np.minimum(best, _face_distance(face, *ends[own]).min(axis=1))
    return best


def _corners(piece: Array) -> Array:
    """Corners (n, 4, 3) of flat pieces (3, n, 3), in order around each piece."""
    corners: Array = piece[0][:, None] + _CORNERS @ np.swapaxes(piece[1:], 0, 1)
    return corners


def _dot(a: Array, b: Array) -> Array:
    product: Array = np.einsum("...i,...i->...", a, b)
    return product


def _edge_distance(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Distances (...) between the edges from a to b and those from c to d, all (..., 3)."""
    u, v, r = b - a, d - c, a - c
    uu, vv, uv, ur, vr = _dot(u, u), _dot(v, v), _dot(u, v), _dot(u, r), _dot(v, r)
    det = uu * vv - uv * uv
    parallel = det <= 1e-12 * uu * vv
    s = np.where(parallel, 0.0, np.clip((uv * vr - ur * vv) / np.where(parallel, 1.0, det), 0.0, 1.0))
    t = np.clip((uv * s + vr) / vv, 0.0, 1.0)
    s = np.clip((uv * t - ur) / uu, 0.0, 1.0)
    distance: Array = np.linalg.norm(r + s[..., None] * u - t[..., None] * v, axis=-1)
    return distance


def _face_distance(face: Array, start: Array, end: Array) -> Array:
    """Distances (n, m) of the starts of edges (n, m, 3) from flat pieces (3, n, 3).

    inf where the normal projection of the start is not on the piece, zero where the edge passes through it.
    """
    centre, along, across = (part[:, None] for part in face)
    normal = np.cross(along, across)
    normal = normal / np.linalg.norm(normal, axis=-1, keepdims=True)
    start_height, end_height = _dot(start - centre, normal), _dot(end - centre, normal)
    distance = np.where(_is_above(start - centre, along, across), np.abs(start_height), np.inf)
    crosses = start_height * end_height < 0.0
    share = np.where(crosses, start_height / np.where(crosses, start_height - end_height, 1.0), 0.0)[
        ..., None
    ]
    passes = crosses & _is_above(start + share * (end - start) - centre, along, across)
    return np.where(passes, 0.0, distance)


def _is_above(point: Array, along: Array, across: Array) -> Any:
    """Whether the normal projection of points (n, m, 3), relative to the centre of a piece, is on the piece."""
    aa, bb, ab = _dot(along, along), _dot(across, across), _dot(along, across)
    pa, pb, det = _dot(point, along), _dot(point, across), aa * bb - ab * ab
    first, second = (bb * pa - ab * pb) / det, (aa * pb - ab * pa) / det
    return (np.abs(first) <= 1.0) & (np.abs(second) <= 1.0)
