"""Mirror symmetry of a meshed solid: displacements that are even or odd about its middle planes.

The energy of a solid that equals its mirror image has no term that is odd in any plane. With columns separated by parity,
three quarters of the tensors of a body with two planes of symmetry are exactly zero.
"""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ksd.modal.solid import Solid
from ksd.numerics.reduction import Basis, condition_basis

PARITY_TOLERANCE = 1e-6
"""Norm of the even or odd part of a column, relative to the column, below which the part is rounding."""
MirrorPlanes = list[tuple[np.ndarray, np.ndarray]]
"""Per plane of symmetry: the mirror image (size,) of every degree of freedom, and its sign (size,)."""


def mirror_planes(solid: Solid) -> MirrorPlanes:
    """The planes among y = 0 and z = 0 about which the mesh equals its mirror image."""
    # components far apart, so that the nearest point is of the same component
    points = np.column_stack([solid.position, 10.0 * solid.length * solid.component])
    tree, found = cKDTree(points), []
    for axis in (1, 2) if not solid.is_2d else (1,):
        distance, image = tree.query(points * np.where(np.arange(4) == axis, -1.0, 1.0))
        if distance.max() < 1e-9 * solid.length:
            found.append((image, np.where(solid.component == axis, -1.0, 1.0)))
    return found


def split_by_parity(columns: np.ndarray, planes: MirrorPlanes) -> tuple[np.ndarray, np.ndarray]:
    """Even and odd parts (size, p) of columns (size, k), without those of rounding, and the parity (p,) of each part.

    A parity has one bit per plane, 1 for odd.
    """
    parity = np.zeros(columns.shape[1], np.int64)
    for bit, (image, sign) in enumerate(planes):
        mirrored = sign[:, None] * columns[image]
        size, parts, codes = np.linalg.norm(columns, axis=0), [], []
        for odd in (0, 1):
            part = 0.5 * (columns - mirrored if odd else columns + mirrored)
            own = np.flatnonzero(np.linalg.norm(part, axis=0) > PARITY_TOLERANCE * size)
            parts.append((own, part[:, own]))
            codes.append(parity[own] | odd << bit)
        order = np.argsort(np.concatenate([k for k, _ in parts]), kind="stable")
        columns = np.hstack([p for _, p in parts])[:, order]
        parity = np.concatenate(codes)[order]
    return columns, parity


def condition_by_parity(columns: np.ndarray, planes: MirrorPlanes, *, cut: float) -> tuple[Basis, np.ndarray]:
    """`ksd.numerics.reduction.condition_basis` for each parity separately, and the parity of every column."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-9 * size.max(initial=0.0)]
    pure, parity = split_by_parity(columns, planes)
    bases = [(condition_basis(pure[:, parity == code], cut=cut), code) for code in np.unique(parity)]
    every = np.hstack([np.zeros((len(columns), 0)), *(b.columns for b, _ in bases)])
    rank, condition = every.shape[1], max((b.condition for b, _ in bases), default=1.0)
    return Basis(every, rank, condition), np.repeat(
        [code for _, code in bases], [b.rank for b, _ in bases]
    ).astype(np.int64)
