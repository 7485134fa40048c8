"""How leaf springs are meshed: which leaf model, and how fine."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

from ksd.beam.strain_values import DEFAULT_ORDERS, DEFAULT_POINTS
from ksd.checks import ClearArgumentErrors, boolean, show, whole_number
from ksd.errors import SceneError

MAX_ORDER = 24
"""Curvature modes about an axis that a mesh has at most: ends of taut leaf springs bend within a hundredth of the length."""


@dataclass(frozen=True)
class Mesh(metaclass=ClearArgumentErrors):
    """Which leaf model, and how fine.

    leaf: "strain" (one strain-mode body per leaf, `orders` curvature modes about x, y, z and `points` quadrature
    points) or "corotational" (a chain of `elements` Appendix A elements). mip: geometric stiffness of the chain from
    extrapolated stresses (True) or plain Newton (False). nodal: every element node is a node of the model, as in
    the paper's own program, instead of being condensed inside its chain: the same equilibria by other Newton
    iterates. warping: multiply the torsion constant by the factor of warping restrained at both clamped ends
    (`ksd.section.restrained_warping_factor`); plate: multiply E Iz by the factor of suppressed anticlastic bending
    (`ksd.section.plate_factor`); shear: Timoshenko shear, False makes the leaf stiff in shear. The last three are
    chosen by the words of `ksd.model.effects`. Raises SceneError for what is out of bounds: below orders (3, 2, 4)
    support stiffness is off by factors.
    """

    leaf: str = "strain"
    orders: tuple[int, int, int] = DEFAULT_ORDERS
    points: int = DEFAULT_POINTS
    elements: int = 4
    mip: bool = True
    nodal: bool = False
    warping: bool = False
    plate: bool = False
    shear: bool = True

    def __post_init__(self) -> None:
        if not isinstance(self.leaf, str) or self.leaf not in ("strain", "corotational"):
            raise SceneError(f"leaf = {show(self.leaf)}: the leaf models are 'strain' and 'corotational'")
        for name in ("mip", "nodal", "warping"):
            boolean(getattr(self, name), name, owner="Mesh")
        for name, value in (("points", self.points), ("elements", self.elements)):
            object.__setattr__(self, name, whole_number(value, name, owner="Mesh"))
        if self.elements > 500:
            raise SceneError(f"elements = {self.elements}: between 1 and 500 elements per leaf are possible")
        low = (3, 2, 4)
        if not isinstance(self.orders, list | tuple):
            raise SceneError(f"Mesh: orders = {show(self.orders)} must be three numbers, about x, y and z.")
        orders = tuple(whole_number(n, "orders", owner="Mesh") for n in self.orders)
        object.__setattr__(self, "orders", orders)
        if len(orders) != 3 or any(n < m or n > MAX_ORDER for n, m in zip(orders, low, strict=True)):
            raise SceneError(
                f"Mesh: orders = {orders}: three numbers, at least {low} and at most {MAX_ORDER} each"
            )
        if self.nodal and self.leaf != "corotational":
            raise SceneError("nodal = True: only leaf = 'corotational' has element nodes; leave nodal out")
        if self.points < max(self.orders) + 1:
            raise SceneError(
                f"points = {self.points}: orders {self.orders} need at least {max(self.orders) + 1} points"
            )

    def of(self, name: str, whole: str = "") -> Mesh:
        """The mesh of one leaf, by its name ("joint/leaf", or that of a free leaf); whole: the leaf it is a piece of."""
        return self

    def refined(self) -> Mesh:
        """The mesh that answers on this one are judged by: strain-mode leaves with more modes and points."""
        words = {f.name: getattr(self, f.name) for f in fields(Mesh)}
        return Refined(**{**words, "leaf": "strain", "nodal": False})

    def with_effect(self, name: str) -> Mesh:
        """The mesh of the same leaf springs with "warping" or "plate"."""
        return replace(self, **{name: True})  # type: ignore[arg-type]

    def modes(self, orders: tuple[int, int, int], points: int) -> tuple[tuple[int, int, int], int]:
        """Curvature modes and quadrature points of a leaf that asks for these."""
        return orders, points

    def __str__(self) -> str:
        if self.leaf == "strain":
            return f"strain-mode leaves, orders {self.orders}, {self.points} points"
        newton = "mixed integration points" if self.mip else "plain Newton"
        return f"{self.elements} Appendix A elements per leaf, {newton}{', nodal' if self.nodal else ''}"


DEFAULT_MESH = Mesh()
MORE, MORE_POINTS = (2, 2, 3), 4
"""Modes and points by which a leaf is refined: the default leaf becomes one of orders (6, 5, 9) on 11 points."""


@dataclass(frozen=True)
class Refined(Mesh):
    """Strain-mode leaves with more modes and points than each of them asks for, the orders of its own included."""

    def modes(self, orders: tuple[int, int, int], points: int) -> tuple[tuple[int, int, int], int]:
        """As `Mesh.modes`, with MORE of them."""
        nx, ny, nz = (n + m for n, m in zip(orders, MORE, strict=True))
        return (nx, ny, nz), max(points, *orders) + MORE_POINTS


@dataclass(frozen=True)
class MixedMesh(Mesh):
    """A mesh with others for some leaves: pairs of a mesh and the names of its leaf springs."""

    others: tuple[tuple[Mesh, tuple[str, ...]], ...] = ()

    def of(self, name: str, whole: str = "") -> Mesh:
        """The mesh of one leaf, or piece of one, which has that of the whole unless it is named itself."""
        found = [mesh for wanted in (name, whole) for mesh, names in self.others if wanted in names]
        return found[0] if found else self

    def with_effect(self, name: str) -> Mesh:
        """As `Mesh.with_effect`, of all."""
        others = tuple((mesh.with_effect(name), names) for mesh, names in self.others)
        words = {f.name: getattr(self, f.name) for f in fields(Mesh)}
        return MixedMesh(**{**words, name: True}, others=others)

    def __str__(self) -> str:
        said = "; ".join(f"{', '.join(names)}: {mesh}" for mesh, names in self.others)
        return f"{super().__str__()} ({said})"
