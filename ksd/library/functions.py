"""Polynomials of the intended motions that describe a joint: of a joint family, and of one of its designs.

Paper 1, sections 2.2 and 3.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ksd.errors import RecordError

Array = NDArray[np.float64]
Mesh = str | int
"""Leaf discretisation of a set of functions: "strain" (modes), or the number of Appendix A elements per leaf."""


@dataclass(frozen=True)
class Functions:
    """Coefficients of the functions of one mesh; the last index runs over the M terms of the record.

    interface (6, M): rotation vector omega of interface B relative to A [rad], then the chord exp(-omega/2) d / L, with d
    the position of B relative to A, all in the axes of A, and L the length of the joint. blocks (blocks, 6, M): the same
    for the reference points of the internal rigid blocks. Strain mesh: amplitudes (leaf springs, N, M), L_leaf times the
    curvature amplitudes, and wrench (leaf springs, 6, M), force L_leaf^2 / EIz and moment L_leaf / EIz on end q in the
    frame of end p. Chains of n elements: rotations (leaf springs, 2n-1, 3, M), rotation vectors [rad] relative to the
    undeformed state of the n elements, then of the n-1 inner nodes, in the frame of end p.
    """

    interface: Array
    blocks: Array
    amplitudes: Array | None = None
    wrench: Array | None = None
    rotations: Array | None = None

    def groups(self) -> dict[str, Array]:
        """The groups that exist, by name."""
        return {name: array for name, array in vars(self).items() if array is not None}


@dataclass(frozen=True)
class JointFunctions:
    """Polynomials of one design in its intended motions (rad, or stroke over joint length).

    powers (P, m): exponents; functions: as in `Functions`, with P in place of M. motion_range (m, 2): trained ranges;
    orders: numbers of curvature modes (nx, ny, nz) of the amplitudes; extrapolated: names of shape parameters outside their
    trained range, which must be allowed explicitly.
    """

    mesh: Mesh
    powers: NDArray[np.int64]
    motion_range: Array
    functions: Functions
    orders: tuple[int, int, int]
    extrapolated: tuple[str, ...] = ()

    @property
    def interface(self) -> Array:
        """Rotation vector and chord of interface B (6, P)."""
        return self.functions.interface

    @property
    def blocks(self) -> Array:
        """Rotation vectors and chords of the internal rigid blocks (blocks, 6, P)."""
        return self.functions.blocks

    @property
    def amplitudes(self) -> Array:
        """L_leaf times the curvature amplitudes (leaf springs, N, P). Raises RecordError for a chain mesh."""
        return self._group("amplitudes")

    @property
    def wrench(self) -> Array:
        """Dimensionless wrench on end q (leaf springs, 6, P). Raises RecordError for a chain mesh."""
        return self._group("wrench")

    @property
    def rotations(self) -> Array:
        """Rotation vectors [rad] of elements, then nodes (leaves, 2n-1, 3, P). Raises RecordError for a strain mesh."""
        return self._group("rotations")

    def _group(self, name: str) -> Array:
        """The coefficients of a group. Raises RecordError if the mesh has none."""
        groups = self.functions.groups()
        if name not in groups:
            raise RecordError(
                f"Functions of mesh {self.mesh!r} hold no {name}; they hold {', '.join(groups)}."
            )
        return groups[name]

    def at(self, motion: float | Array, group: str = "interface") -> Array:
        """Values of the functions of `group` at motions (..., m): (..., *shape of the group without its last index)."""
        basis = monomials(self.powers, np.asarray(motion, float).reshape(*np.shape(motion)[:-1], -1))
        table = self._group(group)
        return np.tensordot(basis, table, axes=(-1, -1))


def monomials(powers: NDArray[np.int64], motion: Array) -> Array:
    """Monomials (..., P): products of the motions (..., m) raised to powers (P, m)."""
    return np.prod(np.asarray(motion, float)[..., None, :] ** powers, axis=-1)


def legendre_products(degrees: NDArray[np.int64], points: Array) -> Array:
    """Products (k, M) of Legendre polynomials of degrees (M, s) at points (k, s) in [-1, 1]."""
    product = np.ones((len(points), len(degrees)))
    for j in range(degrees.shape[1]):
        table = np.polynomial.legendre.legvander(points[:, j], int(degrees[:, j].max(initial=0)))
        product *= table[:, degrees[:, j]]
    return product
