"""Joint records contracted at the shapes of many designs: polynomials in the intended motions of a joint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ksd.library.functions import Functions, legendre_products
from ksd.library.record import Record


def _stack_functions(functions: Functions) -> np.ndarray:
    """All functions of a joint as rows: interface B (6), internal blocks (6 each), then those of the leaf springs."""
    inside = (
        [functions.amplitudes, functions.wrench] if functions.rotations is None else [functions.rotations]
    )
    groups = [functions.interface, functions.blocks, *(g for g in inside if g is not None)]
    return np.concatenate([g.reshape(-1, g.shape[-1]) for g in groups])


class MotionPolynomials:
    """The functions of one joint for a mesh, "strain" or a number n of chain elements; call it with the shapes of D
    designs.

    powers (P, m): exponents of the motions; rows: number of functions; nonzero (rows,): which are not zero for every
    shape; orders: curvature modes (nx, ny, nz) of a leaf as trained.
    """

    def __init__(self, record: Record, mesh: str | int, leaves: int) -> None:
        self.record, self.mesh, self.orders = record, mesh, record.orders
        m = len(record.motions)
        largest_motion = np.array([motion.max_magnitude for motion in record.motions])
        self.powers, merged = np.unique(record.powers[:, :m], axis=0, return_inverse=True)
        # terms with the same powers of the motions are added
        groups = [np.flatnonzero(merged.ravel() == p) for p in range(len(self.powers))]
        self.scale = np.prod(largest_motion ** -record.powers[:, :m], axis=1)
        if mesh in record.functions:
            table = _stack_functions(record.functions[mesh])
            self.table = [(terms, np.ascontiguousarray(table[:, terms].T)) for terms in groups]
            self.nonzero = np.any(table != 0.0, axis=1)
        else:
            self.table = []
            self.nonzero = np.ones(6 + 6 * len(record.blocks) + leaves * 3 * (2 * int(mesh) - 1), bool)
        self.rows = len(self.nonzero)

    def __call__(self, shapes: Sequence[Mapping[str, float]], *, extrapolate: bool) -> np.ndarray:
        """Coefficients (D, rows, P) at the shape parameters of D designs.

        Raises RangeError outside the trained range unless `extrapolate`, SceneError for parameters that are not the
        record's.
        """
        record = self.record
        if not self.table:
            contracted = [record.contract(shape, self.mesh, extrapolate=extrapolate) for shape in shapes]
            return np.array([_stack_functions(f.functions) for f in contracted])
        shape_coordinates = np.array([record.places(shape, extrapolate=extrapolate)[0] for shape in shapes])
        weight = legendre_products(record.powers[:, len(record.motions) :], shape_coordinates) * self.scale
        out = np.empty((len(shapes), self.rows, len(self.powers)))
        for p, (terms, rows) in enumerate(self.table):
            np.matmul(weight[:, terms], rows, out=out[:, :, p])
        return out
