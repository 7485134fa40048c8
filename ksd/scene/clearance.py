"""Leaves that run through each other: oriented boxes around pieces of leaves, parted by the separating-axis test."""

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
from ksd.section.constants import extents

Array = NDArray[np.float64]
CLAMPED_FRACTION = 0.06
"""Fraction of a leaf next to a block where it may come close to another leaf of that block: both are clamped there."""
OVERLAP_TOLERANCE = 1e-6
"""Overlap, over the size of the boxes, that still counts as touching: leaf springs cut side by side from one sheet do."""
DEFORMED_OVERLAP_TOLERANCE = 0.05
"""The same in a deformed joint, where neighbours cut from one sheet rub along their edges."""
BOX_COUNT = 8
"""Boxes along a curved or deformed leaf."""
FINE_BOX_COUNT = 40
"""Boxes along a leaf whose windows are measured, or that may run through itself."""
MIN_BOXES_APART = 2.5
"""Boxes of a leaf that are apart by fewer are next to each other."""


@dataclass(frozen=True)
class LeafBoxes:
    """A leaf as boxes: name, blocks it hangs on (start, end); centre (k, 3), axes (k, 3, 3) as columns, half (k, 3):
    half sizes along them, from its start to its end."""

    name: str
    blocks: tuple[str, str]
    centre: Array
    axes: Array
    half: Array


def leaf_boxes(leaf: Leaf, *, count: int = BOX_COUNT) -> LeafBoxes:
    """The boxes of a leaf at rest: one for a straight leaf, `count` along a curved one."""
    blocks = (leaf.start_block, leaf.end_block)
    if leaf.curve is not None:
        line, axes = zip(*(leaf.section_at(k / (2 * count)) for k in range(2 * count + 1)), strict=True)
        width = np.array(axes)[1::2, :, 2]
        return boxes_along_line(leaf.name, blocks, np.array(line)[::2], leaf, width=width)
    start, end = np.array(leaf.start), np.array(leaf.end)
    half = 0.5 * np.array([leaf.length, *extents(leaf.section)])
    return LeafBoxes(leaf.name, blocks, 0.5 * (start + end)[None], leaf.axes[None], half[None])


def boxes_along_line(
    name: str, blocks: tuple[str, str], line: Array, leaf: Leaf, *, width: Array
) -> LeafBoxes:
    """Boxes between the points `line` (k+1, 3) of a leaf; width (k, 3): direction of its width in each."""
    along = np.diff(line, axis=0)
    length = np.linalg.norm(along, axis=1)
    e1 = along / length[:, None]
    e3 = width - np.sum(width * e1, axis=1)[:, None] * e1
    e3 = e3 / np.linalg.norm(e3, axis=1)[:, None]
    axes = np.stack([e1, np.cross(e3, e1), e3], axis=2)
    half = 0.5 * np.column_stack([length, *(np.full(len(length), w) for w in extents(leaf.section))])
    return LeafBoxes(name, blocks, 0.5 * (line[1:] + line[:-1]), axes, half)


def overlapping_leaves(
    bodies: Sequence[LeafBoxes], *, touch: float
) -> Iterator[tuple[tuple[str, str], Array]]:
    """Names of every two leaves that overlap by more than `touch`, and where: stations (k, 2), as fractions of the length
    of the one and the other, of all boxes that do."""
    for one, two in combinations(bodies, 2):
        if not _far_apart(one, two):
            hit = _overlapping_stations(_without_shared_ends(one, two), _without_shared_ends(two, one), touch)
            if len(hit):
                yield (one.name, two.name), hit


def overlaps_itself(body: LeafBoxes, *, touch: float = OVERLAP_TOLERANCE) -> bool:
    """Whether a leaf runs through itself: boxes of it overlap that are not next to each other."""
    hit = _overlapping_stations(body, body, touch)
    return bool((np.abs(hit[:, 1] - hit[:, 0]) > MIN_BOXES_APART / len(body.half)).any())


@lru_cache(maxsize=256)
def _first_overlap(leaves: tuple[Leaf, ...]) -> tuple[str, str] | None:
    """Names of two leaf springs that run through each other, None when all are clear; a loop draws most joints as they
    were before."""
    boxes = [_straight_leaf_box(leaf) for leaf in leaves]
    for (one, a), (two, b) in combinations(zip(leaves, boxes, strict=True), 2):
        if a is None or b is None or not _separated_by_face(a, b):
            for names, _ in overlapping_leaves([leaf_boxes(one), leaf_boxes(two)], touch=OVERLAP_TOLERANCE):
                return names
    return None


def check_clear(leaves: Sequence[Leaf], *, owner: str, advice: str = "move them apart") -> None:
    """Raise SceneError naming two leaf springs of `owner` that run through each other at rest."""
    found = _first_overlap(tuple(leaves)) if whole_checks_enabled() else None
    if found is not None:
        raise SceneError(
            f"{owner}: leaf springs '{found[0]}' and '{found[1]}' run through each other at rest; {advice}."
        )


_Box = tuple[Vector, tuple[Vector, Vector, Vector], Vector]
"""Centre, axes and half sizes along them of a straight leaf, in plain numbers."""


def _straight_leaf_box(leaf: Leaf) -> _Box | None:
    """The box of a straight leaf, None of a curved one."""
    if leaf.curve is not None:
        return None
    (x, y, z), (u, v, w) = leaf.start, leaf.end
    thickness, width = extents(leaf.section)
    centre = 0.5 * (x + u), 0.5 * (y + v), 0.5 * (z + w)
    return centre, leaf.directions, (0.5 * leaf.length, 0.5 * thickness, 0.5 * width)


def _separated_by_face(one: _Box, two: _Box) -> bool:
    """Whether a face of one of two straight leaf springs parts them: quick, and true of most that are clear."""
    (at, A, a), (there, B, b) = one, two
    d = there[0] - at[0], there[1] - at[1], there[2] - at[2]
    for axes, half, others, reach in ((A, a, B, b), (B, b, A, a)):
        # along the widths first, across which leaf springs of a sheet are layers
        for axis, own in zip(reversed(axes), reversed(half), strict=True):
            most = own + sum(h * abs(dot(axis, e)) for h, e in zip(reach, others, strict=True))
            if abs(dot(axis, d)) > (1 - OVERLAP_TOLERANCE) * most:
                return True
    return False


def _far_apart(one: LeafBoxes, two: LeafBoxes) -> bool:
    """Whether the leaf springs are further apart than they are large."""
    reach = sum(
        float(np.linalg.norm(np.ptp(b.centre, axis=0)) + 2 * np.linalg.norm(b.half[0])) for b in (one, two)
    )
    gap = np.linalg.norm(one.centre.mean(axis=0) - two.centre.mean(axis=0))
    return bool(gap > reach)


def _without_shared_ends(body: LeafBoxes, other: LeafBoxes) -> LeafBoxes:
    """The body without its ends on blocks it shares with the other."""
    cut = np.array([CLAMPED_FRACTION * (block in other.blocks) for block in body.blocks])
    if not cut.any():
        return body
    length = 2 * body.half[:, 0]
    at = np.concatenate([[0.0], np.cumsum(length)])
    low, high = at[-1] * cut[0], at[-1] * (1 - cut[1])
    start, end = np.clip(at[:-1], low, high), np.clip(at[1:], low, high)
    kept = end > start
    middle = 0.5 * (start + end) - 0.5 * (at[:-1] + at[1:])
    half = body.half.copy()
    half[:, 0] = 0.5 * (end - start)
    centre = body.centre + middle[:, None] * body.axes[:, :, 0]
    return LeafBoxes(body.name, body.blocks, centre[kept], body.axes[kept], half[kept])


def _overlapping_stations(one: LeafBoxes, two: LeafBoxes, touch: float) -> Array:
    """Stations (k, 2) of the boxes of one and of the other that overlap (Gottschalk, Lin and Manocha 1996)."""
    d = two.centre[None] - one.centre[:, None]
    radii = (np.linalg.norm(b.half, axis=1) for b in (one, two))
    i, j = np.nonzero(np.linalg.norm(d, axis=2) < np.add.outer(*radii))
    if not len(i):
        return np.zeros((0, 2))
    d, A, B = d[i, j], np.swapaxes(one.axes, 1, 2)[i], np.swapaxes(two.axes, 1, 2)[j]
    crossed = np.cross(A[:, :, None], B[:, None]).reshape(-1, 9, 3)
    axes = np.concatenate([A, B, crossed], axis=1)
    size = np.linalg.norm(axes, axis=2)
    reach = np.abs(axes @ np.swapaxes(A, 1, 2)) @ one.half[i][:, :, None]
    reach = reach + np.abs(axes @ np.swapaxes(B, 1, 2)) @ two.half[j][:, :, None]
    gap = np.abs(axes @ d[..., None])[..., 0] - (1 - touch) * reach[..., 0]
    # parallel edges give no axis
    apart = (gap > 0.0) & (size > 1e-9)
    hit = ~apart.any(axis=1)
    return np.column_stack([_box_stations(one)[i[hit]], _box_stations(two)[j[hit]]])


def _box_stations(body: LeafBoxes) -> Array:
    """(k,): where the boxes of a leaf are along it, as fractions of its length."""
    length = 2 * body.half[:, 0]
    return np.asarray((np.cumsum(length) - 0.5 * length) / length.sum())
