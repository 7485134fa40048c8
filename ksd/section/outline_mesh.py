"""Triangles for a polygon with holes: graded points, Delaunay, boundary edges recovered by splitting.

Elements shrink where the section is thin and at re-entrant corners, where the shear stress is singular. All
lengths in m; rings are (n, 2) arrays of (y, z), the outer one anticlockwise, holes clockwise, material on the
left.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ksd.errors import SceneError

_GRADING = 0.35
"""Growth of the element size per length away from a fine place."""
_ACROSS = 4.0
"""Elements of degree 4 across the local thickness."""
_CORNER = 50.0
"""How much finer a re-entrant corner is meshed than its surroundings."""
_MOST_POINTS = 25_000


@dataclass(frozen=True)
class Edges:
    """Directed edges of all rings: tails and heads (n, 2)."""

    tail: np.ndarray
    head: np.ndarray

    @property
    def length(self) -> np.ndarray:
        return np.linalg.norm(self.head - self.tail, axis=1)

    @property
    def inward(self) -> np.ndarray:
        """Unit normals (n, 2) pointing into the material."""
        t = (self.head - self.tail) / self.length[:, None]
        return np.column_stack([-t[:, 1], t[:, 0]])


def edges_of(rings: Sequence[np.ndarray]) -> Edges:
    """The edges of closed rings."""
    return Edges(np.concatenate(rings), np.concatenate([np.roll(r, -1, axis=0) for r in rings]))


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def points_inside(points: np.ndarray, edges: Edges) -> np.ndarray:
    """Which points (n, 2) lie inside: an odd number of edges crosses the ray to the right."""
    result = np.zeros(len(points), bool)
    for (y0, z0), (y1, z1) in zip(edges.tail, edges.head, strict=True):
        if z0 != z1:
            spans = (points[:, 1] >= min(z0, z1)) & (points[:, 1] < max(z0, z1))
            at = y0 + (points[:, 1] - z0) * ((y1 - y0) / (z1 - z0))
            result ^= spans & (points[:, 0] < at)
    return result


def distance(points: np.ndarray, edges: Edges) -> np.ndarray:
    """Distance (n,) of points (n, 2) to the nearest edge."""
    best = np.full(len(points), np.inf)
    for tail, head in zip(edges.tail, edges.head, strict=True):
        along = head - tail
        s = np.clip((points - tail) @ along / (along @ along), 0.0, 1.0)
        best = np.minimum(best, np.linalg.norm(points - tail - s[:, None] * along, axis=1))
    return best


def _thickness(points: np.ndarray, normals: np.ndarray, edges: Edges) -> np.ndarray:
    """Distance (n,) from boundary points along their inward normals to the opposite boundary."""
    along = edges.head - edges.tail
    gap = edges.tail[None] - points[:, None]
    turn = _cross(normals[:, None], along[None])
    with np.errstate(divide="ignore", invalid="ignore"):
        ray = _cross(gap, along[None]) / turn
        on = _cross(gap, normals[:, None]) / turn
    reach = 1e-9 * edges.length.max()
    hit = (np.abs(turn) > 1e-12 * edges.length) & (ray > reach) & (on >= -1e-9) & (on <= 1 + 1e-9)
    return np.where(hit, ray, np.inf).min(axis=1)


@dataclass(frozen=True)
class Sizes:
    """Element size [m] wanted anywhere: least of size_i + grading * (distance from disc i) and `most`."""

    source: np.ndarray
    radius: np.ndarray
    size: np.ndarray
    most: float

    def at(self, points: np.ndarray) -> np.ndarray:
        best = np.full(len(points), self.most)
        for first in range(0, len(self.source), 64):
            part = slice(first, first + 64)
            away = np.linalg.norm(points[:, None] - self.source[None, part], axis=2) - self.radius[part]
            best = np.minimum(best, (self.size[part] + _GRADING * np.maximum(away, 0.0)).min(axis=1))
        return best


def _corner_turns(rings: Sequence[np.ndarray]) -> np.ndarray:
    """Angle (n,) by which the material's angle at each corner exceeds 180 degrees, in rad."""
    turns = []
    for ring in rings:
        before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
        turns.append(-np.arctan2(_cross(before, after), np.einsum("ij,ij->i", before, after)))
    return np.concatenate(turns)


def wanted_sizes(rings: Sequence[np.ndarray], mesh_size: float | None) -> Sizes:
    """Sizes from the local thickness (or `mesh_size`), short edges and re-entrant corners."""
    edges = edges_of(rings)
    step = edges.length.sum() / 400
    count = np.maximum(1, np.ceil(edges.length / step)).astype(int)
    edge = np.repeat(np.arange(len(count)), count)
    s = np.concatenate([(np.arange(n) + 0.5) / n for n in count])
    points = edges.tail[edge] + s[:, None] * (edges.head - edges.tail)[edge]
    if mesh_size is None:
        size = np.minimum(_thickness(points, edges.inward[edge], edges), edges.length.sum()) / _ACROSS
    else:
        size = np.full(len(points), mesh_size)
    size = np.minimum(size, 1.5 * edges.length[edge])
    corners = edges.tail[_corner_turns(rings) > 0.3]
    # each sample speaks for its share of the edge
    bulk = Sizes(points, 0.5 * (edges.length / count)[edge], size, mesh_size or np.inf)
    if not len(corners):
        return bulk
    return Sizes(
        np.concatenate([points, corners]),
        np.concatenate([bulk.radius, np.zeros(len(corners))]),
        np.concatenate([size, bulk.at(corners) / _CORNER]),
        bulk.most,
    )


def _refuse_more(count: int) -> None:
    if count > _MOST_POINTS:
        raise SceneError(f"polygon: the mesh needs more than {_MOST_POINTS} points; give a larger mesh_size.")


def _boundary_points(edges: Edges, sizes: Sizes) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 2) on all edges, spaced by the wanted size, and the segments (n, 2) they form."""
    found: list[np.ndarray] = []
    total = edges.length.sum()
    for tail, head in zip(edges.tail, edges.head, strict=True):
        length = float(np.linalg.norm(head - tail))
        s = np.linspace(0.0, 1.0, 401 if length > 0.02 * total else 21)
        density = length / sizes.at(tail + s[:, None] * (head - tail))
        spent = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(s))])
        n = max(1, int(np.ceil(spent[-1])))
        _refuse_more(n + sum(map(len, found)))
        at = np.interp(np.arange(n) * spent[-1] / n, spent, s)
        found.append(tail + at[:, None] * (head - tail))
    points = np.concatenate(found)
    # each edge goes on to the next one of its ring
    follow = np.arange(1, len(points) + 1)
    first = np.cumsum([0] + [len(f) for f in found])
    starts = [i for i in range(len(found)) if i == 0 or not np.array_equal(edges.tail[i], edges.head[i - 1])]
    for a, b in zip(starts, [*starts[1:], len(found)], strict=True):
        follow[first[b] - 1] = first[a]
    return points, np.column_stack([np.arange(len(points)), follow])


def _interior_points(edges: Edges, sizes: Sizes) -> np.ndarray:
    """Centres of quadtree cells of about the wanted size, kept off the boundary by half of it."""
    low, high = edges.tail.min(axis=0), edges.tail.max(axis=0)
    side = float(min(high - low))
    n = np.ceil((high - low) / side - 1e-9).astype(int)
    grid = np.stack(np.meshgrid(*(np.arange(k) + 0.5 for k in n), indexing="ij"), -1).reshape(-1, 2)
    cells, kept = low + side * grid, []
    while len(cells):
        cells = cells[points_inside(cells, edges) | (distance(cells, edges) < 0.75 * side)]
        size = sizes.at(cells)
        split = side > 1.1 * size
        kept.append(np.column_stack([cells[~split], size[~split]]))
        quarter = 0.25 * side * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
        cells = (cells[split][:, None] + quarter).reshape(-1, 2)
        side *= 0.5
        _refuse_more(len(cells) // 4 + sum(map(len, kept)) // 2)
    points = np.concatenate(kept)
    # a fixed small shake: four points on one circle have no unique triangulation
    points[:, :2] += 0.05 * points[:, 2:] * np.random.default_rng(0).uniform(-1, 1, (len(points), 2))
    points = points[points_inside(points[:, :2], edges)]
    return points[distance(points[:, :2], edges) > 0.5 * points[:, 2], :2]


def _triangles(points: np.ndarray, edges: Edges) -> np.ndarray:
    """Delaunay triangles (n, 3) of the points whose centre is inside and whose area is not zero."""
    from scipy.spatial import Delaunay

    found = Delaunay(points).simplices
    corner = points[found]
    area = 0.5 * _cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    return found[(np.abs(area) > 1e-9 * longest**2) & points_inside(corner.mean(axis=1), edges)]


def _missing(segments: np.ndarray, triangles: np.ndarray, count: int) -> np.ndarray:
    """Which boundary segments are no edge of any triangle."""
    pairs = np.sort(
        np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1
    )
    wanted = np.sort(segments, axis=1)
    return ~np.isin(wanted[:, 0] * count + wanted[:, 1], pairs[:, 0] * count + pairs[:, 1])


def triangulate(rings: Sequence[np.ndarray], mesh_size: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 2) [m] and triangles (m, 3) of a polygon with holes.

    mesh_size [m] wanted in the bulk; None takes a quarter of the local thickness. Raises SceneError when the
    outline cannot be meshed or needs too many points.
    """
    edges = edges_of(rings)
    sizes = wanted_sizes(rings, mesh_size)
    border, segments = _boundary_points(edges, sizes)
    interior = _interior_points(edges, sizes)
    for _ in range(30):
        points = np.concatenate([border, interior])
        triangles = _triangles(points, edges)
        lost = _missing(segments, triangles, len(points))
        if not lost.any():
            break
        # split lost segments and clear the circle around each half
        a, b = segments[lost].T
        middle = 0.5 * (border[a] + border[b])
        radius = 0.6 * np.linalg.norm(border[a] - border[b], axis=1)
        away = np.linalg.norm(interior[:, None] - middle[None], axis=2)
        interior = interior[(away > radius).all(axis=1)]
        fresh = len(border) + np.arange(len(middle))
        border = np.concatenate([border, middle])
        _refuse_more(len(border) + len(interior))
        segments = np.concatenate([segments[~lost], np.column_stack([a, fresh]), np.column_stack([fresh, b])])
    area = 0.5 * np.abs(_cross(*(points[triangles][:, k] - points[triangles][:, 0] for k in (1, 2)))).sum()
    wanted = 0.5 * _cross(edges.tail, edges.head).sum()
    if abs(area - wanted) > 1e-6 * wanted:
        raise SceneError("polygon: its outline cannot be meshed; remove points that nearly coincide.")
    used = np.unique(triangles)
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    return points[used], number[triangles]
