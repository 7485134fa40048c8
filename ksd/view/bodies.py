"""Leaf springs as sheets, links as bodies and ground as hatched pads: polygons in space with their colours.

A rigid block is known by what is clamped to it. It is drawn as a pad where each joint is clamped, and a web that joins the
pads: both convex.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import permutations
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from ksd.answers.shape import Shape
from ksd.view.camera import Camera
from ksd.view.figure import FAINT_COLOR, GROUND_COLOR, LINK_COLORS, Array

PAD_HALF_THICKNESS = 0.006
"""Half the thickness of pads and webs, relative to the size of the mechanism."""
WEB_WIDTH_RATIO = 0.42
"""Width of a web relative to that of the pads it joins."""
MAX_TURN_BETWEEN_STATIONS = np.deg2rad(2.0)
"""Largest turn between two drawn stations of a leaf [rad]."""
SHARP_EDGE_COSINE = 0.9
"""Cosine of the angle between two faces below which their common edge is drawn."""
HATCH_LENGTH, HATCH_SPACING = 0.022, 0.016
"""Length and spacing of the hatching of ground, relative to the size of the mechanism."""
VISIBLE_BACK_COSINE = 0.4
"""Cosine of the angle between the back of a pad and the viewing direction above which the back is visible."""
FLAT_PAD_RATIO = 0.2
"""Thickness over length below which a pad counts as flat."""


class Polygon(NamedTuple):
    """Corners (k, 3) [m]; normal (3,) outward of a body, of either side of a sheet, None where light does not matter;
    colour, of its edge too, which is `line` points wide; body: only seen from outside."""

    corners: Array
    color: Any
    normal: Array | None = None
    line: float = 0.4
    body: bool = False


class Pad(NamedTuple):
    """Where the n leaf springs of a joint are clamped to a block, or with n = 0 a driven or hinged point.

    corners (k, 3) [m]: of all leaf springs; edges: those of each; away (n, 3): its direction away from the block.
    """

    corners: Array
    edges: tuple[Array, ...]
    away: Array


def mechanism_size(shape: Shape) -> float:
    """Largest extent [m] of leaf springs and blocks."""
    points = np.concatenate([leaf.place for leaf in shape.leaves] + [b.place for b in shape.blocks])
    return float(np.ptp(points, axis=0).max()) or 1.0


def edge_lines(place: Array, axes: Array, width: Array) -> tuple[Array, Array]:
    """The two edges (k, 3) of a leaf: centreline plus and minus half its width along e3."""
    half = 0.5 * width[:, None] * axes[:, :, 2]
    return place - half, place + half


def clamp_pads(shape: Shape, block: Any, *, rest: bool = False) -> list[Pad]:
    """The pads of a block, one per single point, joint or free leaf spring; of the undeformed block with `rest`."""
    places = block.rest if rest else block.place
    result = [Pad(point[None], (), np.zeros((0, 3))) for point in places[block.leaf < 0]]
    owners = np.where(block.leaf < 0, "", block.owner)
    for owner in dict.fromkeys(owners[block.leaf >= 0]):
        edges, away = [], []
        for k in np.flatnonzero(owners == owner):
            point = places[k]
            leaf, j = shape.leaves[block.leaf[k]], int(block.station[k])
            axes = (leaf.rest_axes if rest else leaf.axes)[j]
            sides = 0.5 * leaf.width[j] * axes[:, 2]
            edge = point + np.stack([-sides, sides])
            if has_varying_thickness(leaf):
                across = 0.5 * leaf.thickness[j] * axes[:, 1]
                edge = np.concatenate([edge - across, edge + across])
            edges.append(edge)
            away.append(axes[:, 0] if j == 0 else -axes[:, 0])
        result.append(Pad(np.concatenate(edges), tuple(edges), np.reshape(away, (-1, 3))))
    return result


def has_varying_thickness(leaf: Any) -> bool:
    """Whether the thickness of a leaf spring varies along it, so that it is drawn."""
    return bool(np.ptp(leaf.thickness) > 0.0)


def convex_parts(block: Any, pads: list[Pad], size: float) -> list[Array]:
    """Convex sets of points (k, 3) that make up a block: its pads, and a slimmer web between them, which ground has not.
    What is clamped all around has a pad per leaf spring, with a strut to the middle."""
    middles = np.array([p.corners.mean(axis=0) for p in pads])
    alone = np.ptp(middles, axis=0).max() < 0.02 * size
    clamped = []
    for pad, middle in zip(pads, middles, strict=True):
        if not len(pad.away):
            continue
        if back_direction(pad) is not None or (alone and block.name != "ground"):
            clamped.append(pad.corners)
        elif block.name == "ground":
            clamped += pad.edges
        else:
            clamped += [part for edge in pad.edges for part in (edge, np.vstack([_shrunk(edge), middle]))]
    if block.name == "ground":
        return clamped
    if alone:
        return clamped or [middles]
    return [*clamped, np.concatenate([_shrunk(p.corners) for p in pads])]


def _shrunk(corners: Array) -> Array:
    """Corners of a pad scaled about their mean by WEB_WIDTH_RATIO, for the web between pads."""
    middle = corners.mean(axis=0)
    drawn: Array = middle + WEB_WIDTH_RATIO * (corners - middle)
    return drawn


def convex_hull(points: Array) -> Array:
    """Corners (k, 2), counterclockwise, of the convex hull of points (n, 2); two where they lie on a line."""
    spread = np.linalg.svd(points - points.mean(axis=0))
    if len(points) < 3 or spread.S[1] <= 1e-6 * spread.S[0]:
        along = points @ spread.Vh[0]
        return points[[int(along.argmin()), int(along.argmax())]]
    return points[ConvexHull(points).vertices]


def thickened(points: Array, half: float) -> Array:
    """Points (8 k, 3) whose convex hull is that of `points` (k, 3) made thicker by `half` [m] all around, less where it is
    small."""
    half = min(half, max(0.06 * float(np.ptp(points, axis=0).max()), 0.2 * half))
    cube = half * np.array(np.meshgrid([-1, 1], [-1, 1], [-1, 1])).reshape(3, -1).T
    return np.concatenate([points + corner for corner in cube])


def hull_faces(points: Array, half: float, color: Any, *, edge: Any) -> list[Polygon]:
    """The faces of the convex hull of `points` (k, 3), `thickened`, and its sharp edges."""
    around = thickened(points, half)
    hull = ConvexHull(around)
    normals = hull.equations[:, :3]
    faces = [
        Polygon(around[corners], color, out, body=True)
        for corners, out in zip(hull.simplices, normals, strict=True)
    ]
    for k, (corners, neighbours) in enumerate(zip(hull.simplices, hull.neighbors, strict=True)):
        for i, j in enumerate(neighbours):
            if k < j and normals[k] @ normals[j] < SHARP_EDGE_COSINE:
                # drawn with each of its two faces, of which one may be hidden
                line = around[np.delete(corners, i)]
                faces += [Polygon(line, edge, normals[n], 0.7, body=True) for n in (k, j)]
    return faces


def leaf_faces(leaf: Any, colors: Any, *, line: float) -> list[Polygon]:
    """A leaf spring between its stations, colors (k-1, 4) or one, with its thickness where that varies."""
    low, high = edge_lines(leaf.place, leaf.axes, leaf.width)
    normals = leaf.axes[:, :, 1]
    each = [colors] * (len(low) - 1) if isinstance(colors, str) else list(colors)
    light = isinstance(colors, str)
    faces = []
    strips = [(low, high, normals)]
    if has_varying_thickness(leaf):
        off = 0.5 * leaf.thickness[:, None] * normals
        side = leaf.axes[:, :, 2]
        strips = [
            (low + off, high + off, normals), (low - off, high - off, -normals),
            (low - off, low + off, -side), (high - off, high + off, side),
        ]  # fmt: skip
    for a, b, out in strips:
        quads = np.stack([a[:-1], a[1:], b[1:], b[:-1]], axis=1)
        # colours that show a value are not shaded
        faces += [
            Polygon(quad, color, out[k] if light else None, line)
            for k, (quad, color) in enumerate(zip(quads, each, strict=True))
        ]
    return faces


def with_fewer_stations(leaf: Any) -> Any:
    """The leaf spring with only as many stations as its bend and twist need."""
    turns = leaf.axes[:-1].transpose(0, 2, 1) @ leaf.axes[1:]
    angle = np.arccos(np.clip(0.5 * (np.trace(turns, axis1=1, axis2=2) - 1.0), -1.0, 1.0))
    so_far = np.concatenate([[0.0], np.cumsum(angle)])
    turns_wanted = np.linspace(0.0, so_far[-1], int(np.ceil(so_far[-1] / MAX_TURN_BETWEEN_STATIONS)) + 1)
    stations = np.unique([0, *np.searchsorted(so_far, turns_wanted[:-1]), len(so_far) - 1])
    keys = ("s", "rest", "place", "rest_axes", "axes", "width", "thickness")
    return replace(leaf, **{key: getattr(leaf, key)[stations] for key in keys})


def facing_camera(leaf: Any, camera: Camera) -> Any:
    """The leaf spring; a wire (as thick as wide everywhere) is turned so that its width is seen."""
    if has_varying_thickness(leaf) or not np.allclose(leaf.width, leaf.thickness):
        return leaf
    turned = []
    for axes in (leaf.rest_axes, leaf.axes):
        across = np.cross(axes[:, :, 0], camera.toward)
        length = np.linalg.norm(across, axis=1, keepdims=True)
        across = np.where(length > 1e-3, across / np.maximum(length, 1e-3), axes[:, :, 2])
        turned.append(np.stack([axes[:, :, 0], np.cross(across, axes[:, :, 0]), across], axis=2))
    return replace(leaf, rest_axes=turned[0], axes=turned[1])


def leaf_outlines(leaf: Any, camera: Camera, *, rest: bool = False) -> list[Array]:
    """Closed lines (k, 3) [m] around a leaf spring: of its sheet, of its thickness where that is drawn; none of a deformed
    plain leaf seen onto a plane."""
    place, axes = (leaf.rest, leaf.rest_axes) if rest else (leaf.place, leaf.axes)
    rings = [] if camera.plane and not rest else [edge_lines(place, axes, leaf.width)]
    if has_varying_thickness(leaf):
        half = 0.5 * leaf.thickness[:, None] * axes[:, :, 1]
        side = 0.5 * leaf.width[:, None] * axes[:, :, 2]
        before = side * np.sign(side @ camera.toward)[:, None]
        rings = [(place + before - half, place + before + half)]
    return [np.concatenate([low, high[::-1], low[:1]]) for low, high in rings]


def ground_hatches(pad: Pad, size: float, camera: Camera) -> list[Array]:
    """Lines (2, 3) [m] of the ground symbol, an edge and strokes: behind a pad, or behind each of its leaf springs where the
    pad has no back; below a point. size: of the mechanism [m]."""
    if not len(pad.away):
        return _hatched_line(pad.corners, -camera.up, size, camera)
    back = back_direction(pad)
    if back is not None:
        return _hatched_line(pad.corners, back, size, camera)
    each = zip(pad.edges, pad.away, strict=True)
    return [line for edge, away in each for line in _hatched_line(edge, -away, size, camera)]


def back_direction(pad: Pad) -> Array | None:
    """Direction (3,) from a flat pad to its back; None if it is not flat or has leaf springs on both sides."""
    if not len(pad.away):
        return None
    mean = pad.away.mean(axis=0)
    spread = np.linalg.svd(pad.corners - pad.corners.mean(axis=0))
    if len(spread.S) > 2 and spread.S[1] > FLAT_PAD_RATIO * spread.S[0]:
        normal = spread.Vh[2] if spread.S[2] < FLAT_PAD_RATIO * spread.S[0] else np.zeros(3)
    else:
        normal = mean - (mean @ spread.Vh[0]) * spread.Vh[0]
    shares = pad.away @ normal
    if np.linalg.norm(normal) < 0.3 or abs(shares).min() < 0.3 or np.ptp(np.sign(shares)) > 0:
        return None
    back: Array = -np.sign(shares[0]) * normal / np.linalg.norm(normal)
    return back


def _hatched_line(corners: Array, back: Array, size: float, camera: Camera) -> list[Array]:
    """The line at the back of corners (k, 3), and slanting strokes behind it, on the side of the eye; below a back that is
    seen, on which they would lie."""
    middle = corners.mean(axis=0)
    along = np.cross(camera.toward, back)
    if camera.plane is None and len(corners) > 1:
        # the side of the outline that faces the camera most (below a visible back: that faces downward most)
        sides = [(a, b, np.cross(b - a, back)) for a, b in permutations(corners, 2)]
        outer = [side for side in sides if ((corners - side[0]) @ side[2]).max() <= 1e-9 * size**2]
        preferred = -camera.up if back @ camera.toward > VISIBLE_BACK_COSINE else camera.toward
        a, b, out = max(outer, key=lambda side: float(side[2] @ preferred))
        corners, middle, along = np.stack([a, b]), 0.5 * (a + b), a - b
        if back @ camera.toward > VISIBLE_BACK_COSINE:
            back = out / np.linalg.norm(out)
    along = along / max(float(np.linalg.norm(along)), 1e-12)
    far = (corners - middle) @ along
    reach = max(0.5 * float(np.ptp(far)), 1.5 * HATCH_SPACING * size)
    middle = middle + 0.5 * (far.min() + far.max()) * along + PAD_HALF_THICKNESS * size * back
    places = np.linspace(-reach, reach, max(3, int(2 * reach / (HATCH_SPACING * size)) + 1))[:, None] * along
    stroke = HATCH_LENGTH * size * (0.8 * back - 0.6 * along)
    lines = [np.stack([middle - reach * along, middle + reach * along])]
    return lines + [np.stack([middle + u, middle + u + stroke]) for u in places]


def block_colors(shape: Shape) -> dict[str, str]:
    """Colours by name of block: LINK_COLORS repeated for links, greys for ground and blocks inside joints."""
    names = [b.name for b in shape.blocks if b.name != "ground" and "/" not in b.name]
    turn = {name: LINK_COLORS[k % len(LINK_COLORS)] for k, name in enumerate(names)}
    return {
        b.name: turn.get(b.name, GROUND_COLOR if b.name == "ground" else FAINT_COLOR) for b in shape.blocks
    }
