"""Orders of the strain-mode leaves: chosen by the accuracy asked for, and raised where that was not enough.

The choice follows measured errors of moment, support stiffness and buckling (see the validation tests); never below
the hard minima nz 4, nx 3, ny 2, under which support stiffness is off by factors. Whether they were enough is seen in the
answer: `ksd.properties.mesh_adequacy`.
"""

from __future__ import annotations

from dataclasses import replace

from ksd.model.mesh import MAX_ORDER, Mesh

ORDERS_BY_ACCURACY = (
    (1e-4, (4, 3, 6), 7),
    (1e-5, (5, 3, 6), 8),
    (0.0, (6, 4, 8), 10),
)
"""Accuracy reached by (nx, ny, nz) curvature modes and quadrature points, coarse to fine (what they cost:
`benchmarks/results/leaf_cost.json`)."""


def mesh_for_accuracy(accuracy: float) -> Mesh:
    """The strain-mode mesh for a relative accuracy of forces and support stiffness."""
    orders, points = next(
        (orders, points) for reached, orders, points in ORDERS_BY_ACCURACY if accuracy >= reached
    )
    return Mesh(orders=orders, points=points)


def raise_order(mesh: Mesh, axis: int) -> Mesh:
    """The same mesh with half as many modes more (two at least) about `axis` (0 torsion, 1 strong, 2 weak bending) and
    points to match."""
    nx, ny, nz = (
        min(n + max(2, n // 4 * 2), MAX_ORDER) if k == axis else n for k, n in enumerate(mesh.orders)
    )
    orders = (nx, ny, nz)
    return replace(mesh, orders=orders, points=max(mesh.points, max(orders) + 2))
