"""A solid flexure by scikit-fem: Green-Lagrange strain, Saint-Venant-Kirchhoff material, two rigid end faces.

It is the full model that `ksd.modal.solid_basis` reduces: a thick leaf or a notch hinge, meshed in 2D (plane stress) or 3D
with second-order elements. Axes: x along, y through the thickness, z along the width, origin in the middle of face A.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy.sparse import csr_matrix

from ksd.checks import positive, show, whole_number
from ksd.errors import SceneError
from ksd.scene.material import Material


@dataclass
class Solid:
    """A meshed solid.

    basis: scikit-fem basis; moduli (lambda, mu) [Pa]; width [m] of a 2D solid (1 in 3D); length [m]. component (size,),
    position (size, 3) [m]: axis and point of every degree of freedom; face_a, face_b: indices of those on the faces. refine:
    makes the same solid with a multiple of the cells along every axis, to estimate the error of the mesh; None where that is
    not possible.
    """

    basis: Any
    moduli: tuple[float, float]
    width: float
    length: float
    component: np.ndarray
    position: np.ndarray
    face_a: np.ndarray
    face_b: np.ndarray
    refine: Callable[[float], Solid] | None = None

    @property
    def dof_count(self) -> int:
        """Number of degrees of freedom, called size in the shapes of arrays."""
        return len(self.component)

    @property
    def is_2d(self) -> bool:
        """Whether the solid is meshed in 2D."""
        return int(self.component.max()) == 1

    @property
    def inner(self) -> Any:
        """Indices of the degrees of freedom on neither face."""
        return np.setdiff1d(np.arange(self.dof_count), np.concatenate([self.face_a, self.face_b]))

    def tangent(self, u: np.ndarray) -> Any:
        """Sparse tangent stiffness (size, size) [N/m] at the displacements u (size,) [m]."""
        return self.force_and_tangent(u)[1]

    def energy(self, u: np.ndarray) -> float:
        """Strain energy [J] at the displacements u."""
        G, w, dofs = self._shapes
        H = np.einsum("ijaeq,ea->ijeq", G, u[dofs], optimize=True)
        E = 0.5 * (H + H.swapaxes(0, 1) + np.einsum("kieq,kjeq->ijeq", H, H))
        lam, mu = self.moduli
        return float(np.sum(w * (0.5 * lam * np.trace(E) ** 2 + mu * np.einsum("ijeq,ijeq->eq", E, E))))

    def force_and_tangent(self, u: np.ndarray) -> tuple[np.ndarray, Any]:
        """Internal force (size,) [N] and sparse tangent stiffness (size, size) [N/m] at the displacements u (size,) [m].

        Total Lagrangian: dE = sym(F^T grad v), of all elements at once as products of stacked matrices. Faster than the
        form loop of scikit-fem, which visits every pair of shape functions in Python: 81 x 81 in 3D.
        """
        G, w, dofs = self._shapes
        dim, shapes, elements, points = G.shape[0], G.shape[2], G.shape[3], G.shape[4]
        H = np.einsum("ijaeq,ea->ijeq", G, u[dofs], optimize=True)
        F = H + np.eye(dim)[:, :, None, None]
        E = 0.5 * (H + H.swapaxes(0, 1) + np.einsum("kieq,kjeq->ijeq", H, H))
        lam, mu = self.moduli
        S = 2.0 * mu * E + lam * np.trace(E) * np.eye(dim)[:, :, None, None]
        P = np.einsum("ikeq,kjeq->ijeq", F, S) * w
        force = np.einsum("ijeq,ijaeq->ea", P, G, optimize=True)
        total = np.bincount(dofs.ravel(), force.ravel(), self.dof_count)
        # rows (elements, shapes, entries x points) of strain variations times the root of the elasticity matrix
        pairs = [(r, r) for r in range(dim)] + [(r, c) for r in range(dim) for c in range(r + 1, dim)]
        g, shapes_of = self._scalar_shapes
        rows = np.empty((elements, shapes, len(pairs), points))
        for c in range(dim):
            # variation of component c alone: dE = sym(F[c, :] grad N)
            varied = F[c, :, None, None] * g
            terms = [varied[r, k] if r == k else (varied[r, k] + varied[k, r]) / np.sqrt(2) for r, k in pairs]
            scaled = np.tensordot(self.elastic_root, np.stack(terms), axes=1) * np.sqrt(w)
            rows[:, shapes_of[c]] = scaled.transpose(2, 1, 0, 3)
        B = rows.reshape(elements, shapes, len(pairs) * points)
        K = B @ B.transpose(0, 2, 1)
        # the initial-stress stiffness is the same for every component
        flat = g.transpose(2, 1, 0, 3).reshape(elements, -1, dim * points)
        SG = np.einsum("kseq,kjeq->esjq", g, S * w, optimize=True).reshape(flat.shape)
        initial = SG @ flat.transpose(0, 2, 1)
        for own in shapes_of:
            K[:, own[:, None], own] += initial
        return total, self._sparse(K)

    def _sparse(self, K: np.ndarray) -> Any:
        """Sparse matrix (size, size) of the element matrices K (elements, shapes, shapes)."""
        entry, columns, starts = self._sparsity
        summed = np.bincount(entry, K.ravel(), len(columns))
        return csr_matrix((summed, columns, starts), shape=(self.dof_count, self.dof_count))

    @cached_property
    def _sparsity(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Pattern of sparse matrices: index of every entry of the element matrices, columns, and starts of the rows."""
        dofs = self._shapes[2]
        keys = (dofs[:, :, None] * self.dof_count + dofs[:, None, :]).ravel()
        used, entry = np.unique(keys, return_inverse=True)
        starts = np.searchsorted(used // self.dof_count, np.arange(self.dof_count + 1))
        return entry, used % self.dof_count, starts

    @cached_property
    def _scalar_shapes(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """Gradients (dim, scalar shapes, elements, points), and per component the indices of its vector shapes."""
        G, _, dofs = self._shapes
        of = [np.flatnonzero(self.component[dofs[0]] == c) for c in range(len(G))]
        return np.ascontiguousarray(G[0][:, of[0]]), of

    @property
    def elastic_root(self) -> np.ndarray:
        """Upper triangular root of the elasticity matrix; components 11, 22, (33,) 12, (13, 23), shear times sqrt 2."""
        lam, mu = self.moduli
        dim = 2 if self.is_2d else 3
        C = 2.0 * mu * np.eye(dim * (dim + 1) // 2)
        C[:dim, :dim] += lam
        return np.asarray(np.linalg.cholesky(C).T)

    @cached_property
    def _shapes(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Gradients (dim, dim, shapes, elements, points), volumes (elements, points), dofs (elements, shapes)."""
        gradients = np.stack(
            [
                np.broadcast_to(f[0].grad, (*np.shape(f[0].grad)[:2], *np.shape(self.basis.dx)))
                for f in self.basis.basis
            ],
            axis=2,
        )
        return gradients, np.asarray(self.basis.dx) * self.width, np.asarray(self.basis.element_dofs).T

    def mass(self) -> Any:
        """Sparse mass matrix [m^3] for unit density; it only decides which modes are lowest."""
        shape = np.shape(self.basis.dx)
        N = np.stack(
            [np.broadcast_to(np.asarray(f[0]), (len(np.asarray(f[0])), *shape)) for f in self.basis.basis], 1
        )
        return self._sparse(np.einsum("iaeq,ibeq,eq->eab", N, N, self._shapes[1], optimize=True))

    def gradients(self, u: np.ndarray) -> np.ndarray:
        """Displacement gradient (dim, dim, quadrature points) of the displacements u (size,)."""
        G, _, dofs = self._shapes
        found = np.einsum("ijaeq,ea->ijeq", G, u[dofs], optimize=True)
        return found.reshape(*found.shape[:2], -1)

    @property
    def weights(self) -> np.ndarray:
        """Volume [m^3] of every quadrature point."""
        return self._shapes[1].ravel()

    def grid_dofs(self, component: int) -> np.ndarray:
        """Degrees of freedom (nx, ny, nz) of a component on the grid of their points, of a solid made by `block`."""
        at = np.flatnonzero(self.component == component)
        x, y, z = np.round(self.position[at] / (1e-9 * self.length)).T
        nx, nz = len(np.unique(x)), len(np.unique(z))
        return at[np.lexsort((z, y, x))].reshape(nx, -1, nz)

    def face_displacement(self, end: str, row: int, column: int) -> np.ndarray:
        """Displacement (size,) [m] of face "a" or "b" by a unit entry (row, column) of its rotation matrix.

        column -1: displacement by a unit shift along axis `row`.
        """
        dofs, at = (self.face_a, 0.0) if end == "a" else (self.face_b, self.length)
        u = np.zeros(self.dof_count)
        own = dofs[self.component[dofs] == row]
        u[own] = 1.0 if column < 0 else self.position[own, column] - (at if column == 0 else 0.0)
        return u


def block(
    material: Any,
    length: float,
    thickness: float,
    *,
    width: float,
    cells: tuple[int, ...],
    outline: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Solid:
    """A straight solid of `length` x `thickness` x `width` [m] with cells (nx, ny) in 2D or (nx, ny, nz) in 3D.

    outline: thickness over `thickness` as a function of x / length (a notch), 1 at both ends. Raises SceneError for lengths
    that are not positive, a wrong number of cells, and moduli that no isotropic material has.
    """
    import skfem

    for name, value in (("length", length), ("thickness", thickness), ("width", width)):
        positive(value, name, owner="solid", unit="m")
    if not isinstance(material, Material):
        raise SceneError(f"solid: material = {show(material)} must be a Material.")
    if not isinstance(cells, tuple | list) or len(cells) not in (2, 3):
        raise SceneError(f"solid: cells = {show(cells)}: give (nx, ny) for 2D or (nx, ny, nz) for 3D.")
    for n in cells:
        whole_number(n, "cells", owner="solid")
    lines = [np.linspace(0.0, length, cells[0] + 1), np.linspace(-thickness / 2, thickness / 2, cells[1] + 1)]
    if len(cells) == 3:
        lines.append(np.linspace(-width / 2, width / 2, cells[2] + 1))
    flat = len(cells) == 2
    mesh = (skfem.MeshQuad if flat else skfem.MeshHex).init_tensor(*lines)
    if outline is not None:
        p = mesh.p.copy()
        p[1] *= outline(p[0] / length)
        mesh = type(mesh)(p, mesh.t)
    element = skfem.ElementVector(skfem.ElementQuad2() if flat else skfem.ElementHex2())
    basis = skfem.Basis(mesh, element, intorder=4)
    component, position = _components_and_positions(basis)
    tiny = 1e-9 * length
    nu = material.E / (2 * material.G) - 1
    nu_max = 1.0 if flat else 0.5
    if not -1.0 < nu < nu_max:
        raise SceneError(
            f"solid: E = {material.E:g} Pa and G = {material.G:g} Pa make a Poisson's ratio of {nu:.3g}; in "
            f"{'plane stress' if flat else 'space'} it must lie between -1 and {nu_max:g}."
        )
    lam = material.E * nu / (1 - nu**2 if flat else (1 + nu) * (1 - 2 * nu))

    def refine(factor: float) -> Solid:
        finer = tuple(math.ceil(factor * n) for n in cells)
        return block(material, length, thickness, width=width, cells=finer, outline=outline)

    return Solid(
        basis, (lam, material.G), width if flat else 1.0, length,
        component, position, np.flatnonzero(position[:, 0] < tiny), np.flatnonzero(position[:, 0] > length - tiny),
        refine,
    )  # fmt: skip


def _components_and_positions(basis: Any) -> tuple[np.ndarray, np.ndarray]:
    """Component (size,) and position (size, 3) [m] of every degree of freedom."""
    component = np.zeros(basis.N, np.int64)
    for table in (basis.nodal_dofs, basis.edge_dofs, basis.facet_dofs, basis.interior_dofs):
        if table is None or not np.size(table):
            continue
        dim = basis.mesh.dim()
        for row in range(table.shape[0]):
            component[np.asarray(table[row]).ravel()] = row % dim
    position = np.zeros((basis.N, 3))
    position[:, : basis.doflocs.shape[0]] = basis.doflocs.T
    return component, position
