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
"""Growth of the element size per distance from a finely meshed point."""
_ELEMENTS_ACROSS = 4.0
"""Elements of degree 4 across the local thickness."""
_CORNER_REFINEMENT = 50.0
"""Element size near a re-entrant corner: that of its surroundings over this factor."""
_MAX_POINTS = 25_000
"""Largest number of mesh points."""


@dataclass(frozen=True)
class Edges:
    """Directed edges of all rings, from `tail` to `head` (n, 2) [m], material on the left."""

    tail: np.ndarray
    head: np.ndarray

    @property
    def length(self) -> np.ndarray:
        """Lengths (n,) [m]."""
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
    """Cross product (...) of plane vectors (..., 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def points_inside(points: np.ndarray, edges: Edges) -> np.ndarray:
    """Whether points (n, 2) lie inside: an odd number of edges crosses the ray to their right."""
    result = np.zeros(len(points), bool)
    for (y0, z0), (y1, z1) in zip(edges.tail, edges.head, strict=True):
        if z0 != z1:
            spans = (points[:, 1] >= min(z0, z1)) & (points[:, 1] < max(z0, z1))
            at = y0 + (points[:, 1] - z0) * ((y1 - y0) / (z1 - z0))
            result ^= spans & (points[:, 0] < at)
    return result


def edge_distance(points: np.ndarray, edges: Edges) -> np.ndarray:
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
    denominator = _cross(normals[:, None], along[None])
    with np.errstate(divide="ignore", invalid="ignore"):
        ray = _cross(gap, along[None]) / denominator
        on = _cross(gap, normals[:, None]) / denominator
    tolerance = 1e-9 * edges.length.max()
    hit = (np.abs(denominator) > 1e-12 * edges.length) & (ray > tolerance) & (on >= -1e-9) & (on <= 1 + 1e-9)
    return np.where(hit, ray, np.inf).min(axis=1)


@dataclass(frozen=True)
class ElementSizes:
    """Element size as a function of position [m]: the smallest of size_i + grading * (distance from disc i) and `largest`.

    source (k, 2), radius (k,): of the discs; size (k,): element size in them.
    """

    source: np.ndarray
    radius: np.ndarray
    size: np.ndarray
    largest: float

    def at(self, points: np.ndarray) -> np.ndarray:
        """Element size (n,) at points (n, 2)."""
        best = np.full(len(points), self.largest)
        for first in range(0, len(self.source), 64):
            part = slice(first, first + 64)
            distance = np.linalg.norm(points[:, None] - self.source[None, part], axis=2) - self.radius[part]
            best = np.minimum(best, (self.size[part] + _GRADING * np.maximum(distance, 0.0)).min(axis=1))
        return best


def _reentrant_angles(rings: Sequence[np.ndarray]) -> np.ndarray:
    """Angle (n,) [rad] by which the interior angle at each corner exceeds 180 degrees."""
    angles = []
    for ring in rings:
        before, after = ring - np.roll(ring, 1, axis=0), np.roll(ring, -1, axis=0) - ring
        angles.append(-np.arctan2(_cross(before, after), np.einsum("ij,ij->i", before, after)))
    return np.concatenate(angles)


def element_sizes(rings: Sequence[np.ndarray], mesh_size: float | None) -> ElementSizes:
    """Element sizes from the local thickness (or `mesh_size`), short edges and re-entrant corners."""
    edges = edges_of(rings)
    step = edges.length.sum() / 400
    count = np.maximum(1, np.ceil(edges.length / step)).astype(int)
    edge = np.repeat(np.arange(len(count)), count)
    s = np.concatenate([(np.arange(n) + 0.5) / n for n in count])
    points = edges.tail[edge] + s[:, None] * (edges.head - edges.tail)[edge]
    if mesh_size is None:
        size = (
            np.minimum(_thickness(points, edges.inward[edge], edges), edges.length.sum()) / _ELEMENTS_ACROSS
        )
    else:
        size = np.full(len(points), mesh_size)
    size = np.minimum(size, 1.5 * edges.length[edge])
    corners = edges.tail[_reentrant_angles(rings) > 0.3]
    # each sample point stands for its part of the edge
    bulk = ElementSizes(points, 0.5 * (edges.length / count)[edge], size, mesh_size or np.inf)
    if not len(corners):
        return bulk
    return ElementSizes(
        np.concatenate([points, corners]),
        np.concatenate([bulk.radius, np.zeros(len(corners))]),
        np.concatenate([size, bulk.at(corners) / _CORNER_REFINEMENT]),
        bulk.largest,
    )


def _check_count(count: int) -> None:
    """Raises SceneError for too many mesh points."""
    if count > _MAX_POINTS:
        raise SceneError(f"polygon: the mesh needs more than {_MAX_POINTS} points; give a larger mesh_size.")


def _boundary_points(edges: Edges, sizes: ElementSizes) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 2) on all edges, spaced by the element size, and the segments (n, 2) between them."""
    found: list[np.ndarray] = []
    total = edges.length.sum()
    for tail, head in zip(edges.tail, edges.head, strict=True):
        length = float(np.linalg.norm(head - tail))
        s = np.linspace(0.0, 1.0, 401 if length > 0.02 * total else 21)
        density = length / sizes.at(tail + s[:, None] * (head - tail))
        cells = np.concatenate([[0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(s))])
        n = max(1, int(np.ceil(cells[-1])))
        _check_count(n + sum(map(len, found)))
        at = np.interp(np.arange(n) * cells[-1] / n, cells, s)
        found.append(tail + at[:, None] * (head - tail))
    points = np.concatenate(found)
    # each edge continues with the next one of its ring
    following = np.arange(1, len(points) + 1)
    first = np.cumsum([0] + [len(f) for f in found])
    starts = [i for i in range(len(found)) if i == 0 or not np.array_equal(edges.tail[i], edges.head[i - 1])]
    for a, b in zip(starts, [*starts[1:], len(found)], strict=True):
        following[first[b] - 1] = first[a]
    return points, np.column_stack([np.arange(len(points)), following])


def _interior_points(edges: Edges, sizes: ElementSizes) -> np.ndarray:
    """Centres (n, 2) of quadtree cells of about the element size, at least half of it away from the boundary."""
    low, high = edges.tail.min(axis=0), edges.tail.max(axis=0)
    side = float(min(high - low))
    n = np.ceil((high - low) / side - 1e-9).astype(int)
    grid = np.stack(np.meshgrid(*(np.arange(k) + 0.5 for k in n), indexing="ij"), -1).reshape(-1, 2)
    cells, final = low + side * grid, []
    while len(cells):
        cells = cells[points_inside(cells, edges) | (edge_distance(cells, edges) < 0.75 * side)]
        size = sizes.at(cells)
        split = side > 1.1 * size
        final.append(np.column_stack([cells[~split], size[~split]]))
        quarter = 0.25 * side * np.array([[-1, -1], [-1, 1], [1, -1], [1, 1]])
        cells = (cells[split][:, None] + quarter).reshape(-1, 2)
        side *= 0.5
        _check_count(len(cells) // 4 + sum(map(len, final)) // 2)
    points = np.concatenate(final)
    # a small fixed perturbation: four points on one circle have no unique triangulation
    points[:, :2] += 0.05 * points[:, 2:] * np.random.default_rng(0).uniform(-1, 1, (len(points), 2))
    points = points[points_inside(points[:, :2], edges)]
    return points[edge_distance(points[:, :2], edges) > 0.5 * points[:, 2], :2]


def _triangles(points: np.ndarray, edges: Edges) -> np.ndarray:
    """Delaunay triangles (n, 3) of the points with their centre inside and an area above rounding."""
    from scipy.spatial import Delaunay

    found = Delaunay(points).simplices
    corner = points[found]
    area = 0.5 * _cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    return found[(np.abs(area) > 1e-9 * longest**2) & points_inside(corner.mean(axis=1), edges)]


def _missing_segments(segments: np.ndarray, triangles: np.ndarray, count: int) -> np.ndarray:
    """Whether boundary segments (n,) are missing among the edges of the triangles; count: number of points."""
    pairs = np.sort(
        np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1
    )
    wanted = np.sort(segments, axis=1)
    return ~np.isin(wanted[:, 0] * count + wanted[:, 1], pairs[:, 0] * count + pairs[:, 1])


def triangulate(rings: Sequence[np.ndarray], mesh_size: float | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Points (n, 2) [m] and triangles (m, 3) of a polygon with holes.

    mesh_size [m]: element size away from corners, a quarter of the local thickness when None. Raises SceneError when the
    outline cannot be meshed or needs too many points.
    """
    edges = edges_of(rings)
    sizes = element_sizes(rings, mesh_size)
    border, segments = _boundary_points(edges, sizes)
    interior = _interior_points(edges, sizes)
    for _ in range(30):
        points = np.concatenate([border, interior])
        triangles = _triangles(points, edges)
        missing = _missing_segments(segments, triangles, len(points))
        if not missing.any():
            break
        # split missing segments and clear the circle around each half
        a, b = segments[missing].T
        middle = 0.5 * (border[a] + border[b])
        radius = 0.6 * np.linalg.norm(border[a] - border[b], axis=1)
        distance = np.linalg.norm(interior[:, None] - middle[None], axis=2)
        interior = interior[(distance > radius).all(axis=1)]
        added = len(border) + np.arange(len(middle))
        border = np.concatenate([border, middle])
        _check_count(len(border) + len(interior))
        segments = np.concatenate(
            [segments[~missing], np.column_stack([a, added]), np.column_stack([added, b])]
        )
    area = 0.5 * np.abs(_cross(*(points[triangles][:, k] - points[triangles][:, 0] for k in (1, 2)))).sum()
    exact = 0.5 * _cross(edges.tail, edges.head).sum()
    if abs(area - exact) > 1e-6 * exact:
        raise SceneError("polygon: its outline cannot be meshed; remove points that nearly coincide.")
    used = np.unique(triangles)
    number = np.full(len(points), -1)
    number[used] = np.arange(len(used))
    return points[used], number[triangles]
