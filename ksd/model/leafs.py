"""A leaf of the scene as a member: strain-mode body or chain of Appendix A elements, in global axes at rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np

from ksd.beam import corotational_values as chains
from ksd.beam.strain_values import DEFAULT_ORDERS, DEFAULT_POINTS, strain_sizes, strain_values
from ksd.errors import SceneError
from ksd.model.arrays import COROTATIONAL, STRAIN
from ksd.model.pack import Member


@dataclass(frozen=True)
class Mesh:
    """Which leaf model, and how fine.

    leaf: "strain" (one strain-mode body per leaf, `orders` curvature modes about x, y, z and `points` quadrature
    points) or "corotational" (a chain of `elements` Appendix A elements). mip: geometric stiffness of the chain from
    extrapolated stresses (True) or plain Newton (False). nodal: every element node is a node of the model, as in
    the paper's own program, instead of being condensed inside its chain: the same equilibria by other Newton iterates.
    """

    leaf: str = "strain"
    orders: tuple[int, int, int] = DEFAULT_ORDERS
    points: int = DEFAULT_POINTS
    elements: int = 4
    mip: bool = True
    nodal: bool = False

    def __post_init__(self) -> None:
        if self.leaf not in ("strain", "corotational"):
            raise SceneError(f"leaf = {self.leaf!r}: the leaf models are 'strain' and 'corotational'")
        if self.leaf == "corotational" and not 1 <= self.elements <= 500:
            raise SceneError(f"elements = {self.elements}: between 1 and 500 elements per leaf are possible")
        low = (1, 1, 2)
        if len(self.orders) != 3 or any(n < m or n > 12 for n, m in zip(self.orders, low, strict=True)):
            raise SceneError(f"orders = {self.orders}: three numbers, at least {low} and at most 12 each")
        if self.nodal and self.leaf != "corotational":
            raise SceneError("nodal = True: only leaf = 'corotational' has element nodes; leave it out for strain-mode leafs")
        if self.points < max(self.orders) + 1:
            raise SceneError(
                f"points = {self.points}: orders {self.orders} need at least {max(self.orders) + 1} points"
            )

    def __str__(self) -> str:
        if self.leaf == "strain":
            return f"strain-mode leafs, orders {self.orders}, {self.points} points"
        newton = "mixed integration points" if self.mip else "plain Newton"
        return f"{self.elements} Appendix A elements per leaf, {newton}{', nodal' if self.nodal else ''}"


def leaf_axes(start: np.ndarray, end: np.ndarray, width_axis: np.ndarray | None, name: str) -> np.ndarray:
    """Columns e1 (along), e2 (thickness), e3 (width) of a straight leaf; SceneError if width lies along it.

    Without a width axis (a wire) e3 is the global axis furthest from e1, turned across.
    """
    along = end - start
    e1 = along / np.linalg.norm(along)
    if width_axis is None:
        width_axis = np.eye(3)[int(np.argmin(np.abs(e1)))]
    e3 = width_axis - (width_axis @ e1) * e1
    size = np.linalg.norm(e3)
    if size < 1e-9 * np.linalg.norm(width_axis):
        raise SceneError(f"leaf '{name}': width_axis = {tuple(width_axis)} lies along the leaf; turn it across")
    e3 /= size
    return np.column_stack([e1, np.cross(e3, e1), e3])


def rigidities(leaf: Any) -> tuple[np.ndarray, np.ndarray]:
    """(GJ, EIy, EIz) [N m^2] and (1/EA, 1/(ky GA), 1/(kz GA)) [1/N] of a leaf's section and material."""
    section, E, G = leaf.section, leaf.material.E, leaf.material.G
    stiff = np.array([G * section.J, E * section.Iy, E * section.Iz])
    return stiff, 1.0 / np.array([E * section.A, section.ky * G * section.A, section.kz * G * section.A])


def _numbers(leaf: Any) -> SimpleNamespace:
    """Section and material numbers of a leaf in one place, as the chain set-up reads them."""
    q, m = leaf.section, leaf.material
    return SimpleNamespace(E=m.E, G=m.G, A=q.A, J=q.J, Iy=q.Iy, Iz=q.Iz, ky=q.ky, kz=q.kz)


def leaf_member(
    leaf: Any, mesh: Mesh, *, name: str, nodes: tuple[int, int], places: tuple[np.ndarray, np.ndarray], turn: Any = None
) -> Member:
    """The member of `leaf` between two nodes.

    `places`: reference positions (3,) of the two nodes; `turn` = (origin, rotation) takes the leaf's own coordinates
    to the nodes' (identity when None). Mesh choices carried by the leaf itself win over `mesh`.
    """
    origin, rotation = turn if turn is not None else (np.zeros(3), np.eye(3))
    start = origin + rotation @ np.asarray(leaf.start, float)
    end = origin + rotation @ np.asarray(leaf.end, float)
    width = None if leaf.width_axis is None else rotation @ np.asarray(leaf.width_axis, float)
    axes = leaf_axes(start, end, width, name)
    length = float(np.linalg.norm(end - start))
    stiff, soft = rigidities(leaf)
    if mesh.leaf == "strain":
        kind = STRAIN
        orders = tuple(leaf.orders or mesh.orders)
        points = max(mesh.points, max(orders) + 1)
        value, number = strain_values(length=length, rigidity=stiff, compliance=soft, orders=orders, points=points)
        inner_size, store = strain_sizes(number)
        inner = np.zeros(inner_size)
    else:
        kind = COROTATIONAL
        count = leaf.elements or mesh.elements
        value = chains.chain_values(_numbers(leaf), length, count)
        number = np.array([count, int(mesh.mip)], np.int64)
        _, _, store = chains.sizes(count)
        inner = chains.start_inner(value, number)
    return Member(
        name=name,
        kind=kind,
        nodes=nodes,
        offset=np.array([start - places[0], end - places[1]]),
        frame=np.array([axes, axes]),
        value=value,
        number=number,
        inner=inner,
        store=store,
        length=length,
        floor=1.0 / (soft[0] * length),
    )


def split_leaf(leaf: Any, elements: int) -> tuple[list[Any], list[np.ndarray]]:
    """The leaf cut into single-element pieces, and the points (3,) between them in the leaf's own coordinates."""
    start, end = np.asarray(leaf.start, float), np.asarray(leaf.end, float)
    cuts = [start + (end - start) * k / elements for k in range(elements + 1)]
    pieces = [
        replace(leaf, start=tuple(a), end=tuple(b), elements=1, name=f"{leaf.name}.{k + 1}")
        for k, (a, b) in enumerate(pairwise(cuts))
    ]
    return pieces, cuts[1:-1]
