"""Orders of the strain-mode leafs: chosen by the accuracy asked for, and checked against the solution.

The choice follows measured errors of moment, support stiffness and buckling (see the validation tests); never below
the hard minima nz 4, nx 3, ny 2, under which support stiffness is off by factors. The check looks at the share of the
strain energy in the highest mode of every axis, and at where the series of the other parity goes: a Legendre series that
has converged has next to nothing there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ksd.model.arrays import STRAIN, Motion
from ksd.model.compile import Model
from ksd.model.mesh import Mesh

LADDER = (
    (2e-3, (4, 2, 4), 5),
    (1e-3, (4, 2, 4), 6),
    (1e-4, (4, 3, 5), 7),
    (1e-5, (5, 3, 6), 8),
    (0.0, (6, 4, 8), 10),
)
"""Accuracy reached by (nx, ny, nz) curvature modes and quadrature points, coarse to fine."""


def mesh_for(accuracy: float) -> Mesh:
    """The strain-mode mesh for a relative accuracy of forces and support stiffness."""
    for reached, orders, points in LADDER:
        if accuracy >= reached:
            return Mesh(orders=orders, points=points)
    raise ValueError(f"accuracy = {accuracy} must be a number of zero or more")


def _missing(energy: np.ndarray) -> float:
    """Energy that a leaf may miss about one axis, from that (n,) of its modes: that of the highest one, or what the
    series of the other parity, even or odd, would give the next. A guided leaf has nothing in every other mode."""
    last = float(energy[-1])
    if len(energy) < 4 or energy[-4] <= 0.0:
        return last
    return max(last, float(energy[-2]) * min(1.0, float(energy[-2] / energy[-4])))


def highest_share(model: Model, motion: Motion) -> tuple[float, str, int]:
    """Largest share of a leaf's bending and torsion energy in its highest mode, or missing in the next: (share, member
    name, axis 0, 1, 2)."""
    members = model.arrays.members
    worst, where, about = 0.0, "", 0
    energies = []
    for i in np.flatnonzero(members.kind == STRAIN):
        number = members.number[i]
        value = members.value[members.value_at[i] :]
        inner = motion.inner[members.inner_at[i] : members.inner_at[i + 1]]
        at, first, total, last = 1, 0, 0.0, []
        rest = 1 + sum(int(n) ** 2 for n in number[:3])
        for n in number[:3]:
            K = value[at : at + n * n].reshape(n, n)
            a = inner[first : first + n] - value[rest + first : rest + first + n]
            total += 0.5 * float(a @ K @ a)
            last.append(_missing(0.5 * np.diagonal(K) * a * a))
            at, first = at + n * n, first + n
        energies.append((i, total, last))
    most = max((e[1] for e in energies), default=0.0)
    for i, total, last in energies:
        # a leaf that hardly takes part does not decide
        if total <= 1e-6 * most or total == 0.0:
            continue
        axis = int(np.argmax(last))
        if last[axis] / total > worst:
            worst, where, about = last[axis] / total, model.member_names[i], axis
    return worst, where, about


def raised(mesh: Mesh, axis: int) -> Mesh:
    """The same mesh with two more modes about `axis` (0 torsion, 1 strong, 2 weak bending) and points to match."""
    nx, ny, nz = (n + 2 * (k == axis) for k, n in enumerate(mesh.orders))
    orders = (nx, ny, nz)
    return replace(mesh, orders=orders, points=max(mesh.points, max(orders) + 2))
