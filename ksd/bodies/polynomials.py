"""Joint records contracted at the shapes of many designs at once: polynomials in the intended motions of a joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ksd.library.functions import Functions, legendre_products
from ksd.library.record import Record


def _stacked(functions: Functions) -> np.ndarray:
    """All functions of a joint as rows: interface B (6), internal blocks (6 each), then the insides of the leaves."""
    found = functions
    inside = [found.amplitudes, found.wrench] if found.rotations is None else [found.rotations]
    groups = [found.interface, found.blocks, *(g for g in inside if g is not None)]
    return np.concatenate([g.reshape(-1, g.shape[-1]) for g in groups])


class Polynomials:
    """The functions of one joint for "strain" or chains of n elements; call it with the shapes of D designs.

    powers (P, m): exponents of the motions; rows: how many functions; there (rows,): which are not zero whatever the
    shape; orders: curvature modes (nx, ny, nz) of a leaf as trained.
    """

    def __init__(self, record: Record, mesh: str | int, leaves: int) -> None:
        self.record, self.mesh, self.orders = record, mesh, record.orders
        m = len(record.motions)
        reach = np.array([motion.reach for motion in record.motions])
        self.powers, merged = np.unique(record.powers[:, :m], axis=0, return_inverse=True)
        # a sum over the terms with one power of the motions
        groups = [np.flatnonzero(merged.ravel() == p) for p in range(len(self.powers))]
        self.reach = np.prod(reach ** -record.powers[:, :m], axis=1)
        if mesh in record.functions:
            table = _stacked(record.functions[mesh])
            self.table = [(terms, np.ascontiguousarray(table[:, terms].T)) for terms in groups]
            self.there = np.any(table != 0.0, axis=1)
        else:
            self.table = []
            self.there = np.ones(6 + 6 * len(record.blocks) + leaves * 3 * (2 * int(mesh) - 1), bool)
        self.rows = len(self.there)

    def __call__(self, shapes: Sequence[Mapping[str, float]], *, extrapolate: bool) -> np.ndarray:
        """(D, rows, P) at the shape parameters of D designs.

        Raises RangeError outside the trained range unless `extrapolate`, SceneError for parameters that are not the
        record's.
        """
        record = self.record
        if not self.table:
            found = [record.contract(shape, self.mesh, extrapolate=extrapolate) for shape in shapes]
            return np.array([_stacked(f.functions) for f in found])
        places = np.array([record.places(shape, extrapolate=extrapolate)[0] for shape in shapes])
        weight = legendre_products(record.powers[:, len(record.motions) :], places) * self.reach
        out = np.empty((len(shapes), self.rows, len(self.powers)))
        for p, (terms, rows) in enumerate(self.table):
            np.matmul(weight[:, terms], rows, out=out[:, :, p])
        return out
