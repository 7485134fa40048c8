"""The mesh of leaf springs: which leaf model, and how fine."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, fields, replace

from ksd.checks import ClearArgumentErrors, boolean, show, whole_number
from ksd.elements.strain_values import DEFAULT_ORDERS, DEFAULT_POINTS
from ksd.errors import SceneError

MAX_ORDER = 24
"""Largest number of curvature modes about an axis; the ends of taut leaf springs bend within 1 % of their length."""


@dataclass(frozen=True)
class Mesh(metaclass=ClearArgumentErrors):
    """Which leaf model, and how fine.

    leaf: "strain" (one strain-mode body per leaf, `orders` curvature modes about x, y, z and `points` quadrature
    points) or "corotational" (a chain of `elements` Appendix A elements). mip: geometric stiffness of the chain from
    extrapolated stresses (True) or plain Newton (False). nodal: every element node is a node of the model, as in
    the paper's own program, instead of being condensed inside its chain: the same equilibria by other Newton
    iterates. warping: torsion with warping restrained at clamped ends (`ksd.section.warping`); plate: bending about e3
    with curling that clamps and curvature suppress (`ksd.section.plate`); shear: Timoshenko shear, False makes the
    leaf stiff in shear. The last three are chosen by the words of `ksd.model.chosen_effects`. Raises SceneError for numbers
    out of bounds: below orders (3, 2, 4) support stiffness is wrong by factors.

    >>> guide, stroke, _ = ksd.load_scene("guide")
    >>> chain = ksd.Mesh("corotational", elements=8)
    >>> pose = ksd.solve(guide, stroke, mesh=chain)
    >>> print(f"{pose.forces['table']:.2f} N")
    5.03 N
    """

    leaf: str = "strain"
    _: KW_ONLY
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
        for name in ("mip", "nodal", "warping", "plate", "shear"):
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

    def for_leaf(self, name: str, whole: str = "") -> Mesh:
        """The mesh of one leaf, by its name ("joint/leaf", or that of a free leaf); whole: the leaf it is a piece of."""
        return self

    def refined(self) -> Mesh:
        """The reference mesh for errors of this one: strain-mode leaves with more modes and points."""
        words = {f.name: getattr(self, f.name) for f in fields(Mesh)}
        return Refined(**{**words, "leaf": "strain", "nodal": False})

    def with_effect(self, name: str) -> Mesh:
        """The same mesh with the effect `name`, "warping" or "plate", switched on."""
        return replace(self, **{name: True})  # type: ignore[arg-type]

    def modes(self, orders: tuple[int, int, int], points: int) -> tuple[tuple[int, int, int], int]:
        """Curvature modes and quadrature points that a leaf with this minimum of them gets on this mesh."""
        return orders, points

    def __str__(self) -> str:
        if self.leaf == "strain":
            return f"strain-mode leaves, orders {self.orders}, {self.points} points"
        newton = "mixed integration points" if self.mip else "plain Newton"
        return f"{self.elements} Appendix A elements per leaf, {newton}{', nodal' if self.nodal else ''}"


DEFAULT_MESH = Mesh()
EXTRA_MODES, EXTRA_POINTS = (2, 2, 3), 4
"""Modes and points added to a leaf by refinement: the default leaf gets orders (6, 5, 9) and 11 points."""


@dataclass(frozen=True)
class Refined(Mesh):
    """Strain-mode leaves with EXTRA_MODES and EXTRA_POINTS added to each leaf, also to one with its own orders."""

    def modes(self, orders: tuple[int, int, int], points: int) -> tuple[tuple[int, int, int], int]:
        """As `Mesh.modes`, with EXTRA_MODES and EXTRA_POINTS added."""
        nx, ny, nz = (n + m for n, m in zip(orders, EXTRA_MODES, strict=True))
        return (nx, ny, nz), max(points, *orders) + EXTRA_POINTS


@dataclass(frozen=True)
class MixedMesh(Mesh):
    """A mesh with exceptions: `others` are pairs of a mesh and the names of the leaf springs that have it."""

    others: tuple[tuple[Mesh, tuple[str, ...]], ...] = ()

    def for_leaf(self, name: str, whole: str = "") -> Mesh:
        """The mesh of one leaf or piece of a leaf; a piece that is not named itself has the mesh of its whole leaf."""
        meshes = [mesh for wanted in (name, whole) for mesh, names in self.others if wanted in names]
        return meshes[0] if meshes else self

    def with_effect(self, name: str) -> Mesh:
        """As `Mesh.with_effect`, for this mesh and all exceptions."""
        others = tuple((mesh.with_effect(name), names) for mesh, names in self.others)
        words = {f.name: getattr(self, f.name) for f in fields(Mesh)}
        return MixedMesh(**{**words, name: True}, others=others)

    def __str__(self) -> str:
        others = "; ".join(f"{', '.join(names)}: {mesh}" for mesh, names in self.others)
        return f"{super().__str__()} ({others})"
