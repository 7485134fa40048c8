"""Mirror symmetry of a meshed solid: which displacements are even or odd about its middle planes.

The energy of a solid that its mirror image covers has no term that is odd in any plane, so columns sorted by parity
leave three quarters of the tensors of a body with two planes of symmetry exactly zero.
"""

from __future__ import annotations

import numpy as np

from ksd.modal.solid import Solid
from ksd.numerics.reduction import Basis, condition_basis

IMPURE = 1e-6
"""Part of a column beyond which it is not rounding: the column is split into both."""
MirrorPlanes = list[tuple[np.ndarray, np.ndarray]]
"""Of each plane of symmetry: the degree of freedom every one is mapped to, and its sign."""


def mirror_planes(solid: Solid) -> MirrorPlanes:
    """The planes y = 0 and z = 0 about which the mesh is its own image."""
    from scipy.spatial import cKDTree

    # components far apart, so that a neighbour is one of the same component
    spots = np.column_stack([solid.position, 10.0 * solid.length * solid.component])
    tree, found = cKDTree(spots), []
    for axis in (1, 2) if not solid.is_2d else (1,):
        away, image = tree.query(spots * np.where(np.arange(4) == axis, -1.0, 1.0))
        if away.max() < 1e-9 * solid.length:
            found.append((image, np.where(solid.component == axis, -1.0, 1.0)))
    return found


def split_by_parity(columns: np.ndarray, planes: MirrorPlanes) -> tuple[np.ndarray, np.ndarray]:
    """Columns (size, k) as their even and odd parts (size, p), what is rounding left out, and the parity (p,) of each: a
    bit per plane, 1 for odd."""
    parity = np.zeros(columns.shape[1], np.int64)
    for bit, (image, sign) in enumerate(planes):
        mirrored = sign[:, None] * columns[image]
        size, parts, codes = np.linalg.norm(columns, axis=0), [], []
        for odd in (0, 1):
            part = 0.5 * (columns - mirrored if odd else columns + mirrored)
            kept = np.flatnonzero(np.linalg.norm(part, axis=0) > IMPURE * size)
            parts.append((kept, part[:, kept]))
            codes.append(parity[kept] | odd << bit)
        order = np.argsort(np.concatenate([k for k, _ in parts]), kind="stable")
        columns = np.hstack([p for _, p in parts])[:, order]
        parity = np.concatenate(codes)[order]
    return columns, parity


def condition_by_parity(columns: np.ndarray, planes: MirrorPlanes, *, cut: float) -> tuple[Basis, np.ndarray]:
    """`conditioned`, each parity on its own, so that no column mixes two; and the parity of every column."""
    size = np.linalg.norm(columns, axis=0)
    columns = columns[:, size > 1e-9 * size.max(initial=0.0)]
    pure, parity = split_by_parity(columns, planes)
    made = [(condition_basis(pure[:, parity == code], cut=cut), code) for code in np.unique(parity)]
    every = np.hstack([np.zeros((len(columns), 0)), *(b.columns for b, _ in made)])
    rank, condition = every.shape[1], max((b.condition for b, _ in made), default=1.0)
    return Basis(every, rank, condition), np.repeat(
        [code for _, code in made], [b.rank for b, _ in made]
    ).astype(np.int64)
