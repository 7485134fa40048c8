"""Orders of strain-mode leaves for a wanted accuracy, and how they are raised where they do not suffice.

The table follows measured errors of moment, support stiffness and buckling (see the validation tests). It never goes below
nz 4, nx 3, ny 2, under which the support stiffness is wrong by factors. Whether the orders suffice is checked on the
answer: `ksd.answers.mesh_adequacy`.
"""

from __future__ import annotations

from dataclasses import replace

from ksd.model.mesh import MAX_ORDER, Mesh

ORDERS_BY_ACCURACY = (
    (1e-4, (4, 3, 6), 7),
    (1e-5, (5, 3, 6), 8),
    (0.0, (6, 4, 8), 10),
)
"""(relative accuracy, curvature modes (nx, ny, nz), quadrature points), coarse to fine.

Their cost is in `benchmarks/results/leaf_cost.json`.
"""


def mesh_for_accuracy(accuracy: float) -> Mesh:
    """The coarsest strain-mode mesh with this relative accuracy of forces and support stiffness."""
    orders, points = next(
        (orders, points) for reached, orders, points in ORDERS_BY_ACCURACY if accuracy >= reached
    )
    return Mesh(orders=orders, points=points)


def raise_order(mesh: Mesh, axis: int) -> Mesh:
    """The mesh with half as many modes more (at least two) about `axis`, and enough points for them.

    axis: 0 torsion, 1 strong bending, 2 weak bending.
    """
    nx, ny, nz = (
        min(n + max(2, n // 4 * 2), MAX_ORDER) if k == axis else n for k, n in enumerate(mesh.orders)
    )
    orders = (nx, ny, nz)
    return replace(mesh, orders=orders, points=max(mesh.points, max(orders) + 2))
