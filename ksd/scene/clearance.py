"""Detection of leaf springs that run through each other: oriented boxes along them and the separating-axis test."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ksd.checks import Vector, dot, whole_checks_enabled
from ksd.errors import SceneError
from ksd.scene.leaf import Leaf
from ksd.section.section import thickness_and_width

Array = NDArray[np.float64]
CLAMPED_FRACTION = 0.06
"""Fraction of a leaf next to its block within which it may overlap another leaf clamped to the same block."""
OVERLAP_TOLERANCE = 1e-6
"""Overlap relative to the size of the boxes that counts as touching, as of leaf springs cut side by side from one sheet."""
DEFORMED_OVERLAP_TOLERANCE = 0.05
"""The same for deformed joints, where neighbours cut from one sheet tolerance along their edges."""
BOX_COUNT = 8
"""Number of boxes along a curved or deformed leaf."""
FINE_BOX_COUNT = 40
"""Number of boxes along a leaf whose windows are measured, or that may run through itself."""
MIN_BOXES_APART = 2.5
"""Distance along a leaf, in boxes, from which two overlapping boxes mean that the leaf runs through itself."""


@dataclass(frozen=True)
class LeafBoxes:
    """A leaf as k boxes from its start to its end.

    name, and the blocks (start, end) it is clamped to; centre (k, 3) [m], axes (k, 3, 3) as columns, half (k, 3) [m]: half
    sizes along the axes.
    """

    name: str
    blocks: tuple[str, str]
    centre: Array
    axes: Array
    half: Array


def leaf_boxes(leaf: Leaf, *, count: int = BOX_COUNT) -> LeafBoxes:
    """The boxes of an undeformed leaf: one for a straight leaf, `count` along a curved one."""
    blocks = (leaf.start_block, leaf.end_block)
    if leaf.curve is not None:
        line, axes = zip(*(leaf.section_at(k / (2 * count)) for k in range(2 * count + 1)), strict=True)
        width = np.array(axes)[1::2, :, 2]
        return boxes_along_line(leaf.name, blocks, np.array(line)[::2], leaf, width=width)
    start, end = np.array(leaf.start), np.array(leaf.end)
    half = 0.5 * np.array([leaf.length, *thickness_and_width(leaf.section)])
    return LeafBoxes(leaf.name, blocks, 0.5 * (start + end)[None], leaf.axes[None], half[None])


def boxes_along_line(
    name: str, blocks: tuple[str, str], line: Array, leaf: Leaf, *, width: Array
) -> LeafBoxes:
    """Boxes between the points `line` (k+1, 3) [m] of a leaf; width (k, 3): direction of its width in each box."""
    along = np.diff(line, axis=0)
    length = np.linalg.norm(along, axis=1)
    e1 = along / length[:, None]
    e3 = width - np.sum(width * e1, axis=1)[:, None] * e1
    e3 = e3 / np.linalg.norm(e3, axis=1)[:, None]
    axes = np.stack([e1, np.cross(e3, e1), e3], axis=2)
    half = 0.5 * np.column_stack(
        [length, *(np.full(len(length), w) for w in thickness_and_width(leaf.section))]
    )
    return LeafBoxes(name, blocks, 0.5 * (line[1:] + line[:-1]), axes, half)


def overlapping_leaves(
    bodies: Sequence[LeafBoxes], *, tolerance: float
) -> Iterator[tuple[tuple[str, str], Array]]:
    """Pairs of names of leaf springs that overlap by more than `tolerance` (relative to the boxes), with stations (k, 2).

    The stations are those of all overlapping boxes, as fractions of the lengths of the two leaf springs.
    """
    for one, two in combinations(bodies, 2):
        if not _far_apart(one, two):
            stations = _overlapping_stations(
                _without_shared_ends(one, two), _without_shared_ends(two, one), tolerance
            )
            if len(stations):
                yield (one.name, two.name), stations


def overlaps_itself(body: LeafBoxes) -> bool:
    """Whether a leaf runs through itself: boxes overlap that are not next to each other."""
    stations = _overlapping_stations(body, body, OVERLAP_TOLERANCE)
    return bool((np.abs(stations[:, 1] - stations[:, 0]) > MIN_BOXES_APART / len(body.half)).any())


@lru_cache(maxsize=256)
def _first_overlap(leaves: tuple[Leaf, ...]) -> tuple[str, str] | None:
    """Names of two leaf springs that run through each other, or None; cached, since design loops repeat most joints."""
    boxes = [_straight_leaf_box(leaf) for leaf in leaves]
    for (one, a), (two, b) in combinations(zip(leaves, boxes, strict=True), 2):
        if a is None or b is None or not _separated_by_face(a, b):
            for names, _ in overlapping_leaves(
                [leaf_boxes(one), leaf_boxes(two)], tolerance=OVERLAP_TOLERANCE
            ):
                return names
    return None


def check_clear(leaves: Sequence[Leaf], *, owner: str, advice: str = "move them apart") -> None:
    """Raise SceneError naming two leaf springs of `owner` that run through each other undeformed."""
    pair = _first_overlap(tuple(leaves)) if whole_checks_enabled() else None
    if pair is not None:
        raise SceneError(
            f"{owner}: leaf springs '{pair[0]}' and '{pair[1]}' run through each other at rest; {advice}."
        )


_Box = tuple[Vector, tuple[Vector, Vector, Vector], Vector]
"""Centre, axes and half sizes along them of a straight leaf, as plain numbers."""


def _straight_leaf_box(leaf: Leaf) -> _Box | None:
    """The box of a straight leaf; None for a curved one."""
    if leaf.curve is not None:
        return None
    (x, y, z), (u, v, w) = leaf.start, leaf.end
    thickness, width = thickness_and_width(leaf.section)
    centre = 0.5 * (x + u), 0.5 * (y + v), 0.5 * (z + w)
    return centre, leaf.directions, (0.5 * leaf.length, 0.5 * thickness, 0.5 * width)


def _separated_by_face(one: _Box, two: _Box) -> bool:
    """Whether a face of one of two boxes separates them: a quick test that most clear leaf springs pass."""
    (centre, A, a), (other_centre, B, b) = one, two
    d = other_centre[0] - centre[0], other_centre[1] - centre[1], other_centre[2] - centre[2]
    for axes, half, other_axes, other_half in ((A, a, B, b), (B, b, A, a)):
        # the width axis first, along which leaf springs of a sheet are layered
        for axis, own in zip(reversed(axes), reversed(half), strict=True):
            extent = own + sum(h * abs(dot(axis, e)) for h, e in zip(other_half, other_axes, strict=True))
            if abs(dot(axis, d)) > (1 - OVERLAP_TOLERANCE) * extent:
                return True
    return False


def _far_apart(one: LeafBoxes, two: LeafBoxes) -> bool:
    """Whether the centres of two leaf springs are further apart than the sum of their sizes."""
    sizes = sum(
        float(np.linalg.norm(np.ptp(b.centre, axis=0)) + 2 * np.linalg.norm(b.half[0])) for b in (one, two)
    )
    gap = np.linalg.norm(one.centre.mean(axis=0) - two.centre.mean(axis=0))
    return bool(gap > sizes)


def _without_shared_ends(body: LeafBoxes, other: LeafBoxes) -> LeafBoxes:
    """The boxes without the ends at blocks that the leaf shares with the other one."""
    clamped = np.array([CLAMPED_FRACTION * (block in other.blocks) for block in body.blocks])
    if not clamped.any():
        return body
    length = 2 * body.half[:, 0]
    edges = np.concatenate([[0.0], np.cumsum(length)])
    low, high = edges[-1] * clamped[0], edges[-1] * (1 - clamped[1])
    start, end = np.clip(edges[:-1], low, high), np.clip(edges[1:], low, high)
    remaining = end > start
    shift = 0.5 * (start + end) - 0.5 * (edges[:-1] + edges[1:])
    half = body.half.copy()
    half[:, 0] = 0.5 * (end - start)
    centre = body.centre + shift[:, None] * body.axes[:, :, 0]
    return LeafBoxes(body.name, body.blocks, centre[remaining], body.axes[remaining], half[remaining])


def _overlapping_stations(one: LeafBoxes, two: LeafBoxes, tolerance: float) -> Array:
    """Stations (k, 2) of the overlapping boxes on both leaf springs (Gottschalk, Lin and Manocha 1996)."""
    d = two.centre[None] - one.centre[:, None]
    radii = (np.linalg.norm(b.half, axis=1) for b in (one, two))
    i, j = np.nonzero(np.linalg.norm(d, axis=2) < np.add.outer(*radii))
    if not len(i):
        return np.zeros((0, 2))
    d, A, B = d[i, j], np.swapaxes(one.axes, 1, 2)[i], np.swapaxes(two.axes, 1, 2)[j]
    edge_products = np.cross(A[:, :, None], B[:, None]).reshape(-1, 9, 3)
    axes = np.concatenate([A, B, edge_products], axis=1)
    norms = np.linalg.norm(axes, axis=2)
    extent = np.abs(axes @ np.swapaxes(A, 1, 2)) @ one.half[i][:, :, None]
    extent = extent + np.abs(axes @ np.swapaxes(B, 1, 2)) @ two.half[j][:, :, None]
    gap = np.abs(axes @ d[..., None])[..., 0] - (1 - tolerance) * extent[..., 0]
    # parallel edges give no axis
    separated = (gap > 0.0) & (norms > 1e-9)
    overlap = ~separated.any(axis=1)
    return np.column_stack([_box_stations(one)[i[overlap]], _box_stations(two)[j[overlap]]])


def _box_stations(body: LeafBoxes) -> Array:
    """Stations (k,) of the centres of the boxes, as fractions of the length of the leaf."""
    length = 2 * body.half[:, 0]
    return np.asarray((np.cumsum(length) - 0.5 * length) / length.sum())
