"""The options of a modal basis of a leaf, each with its reason."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, replace

from ksd.checks import ClearArgumentErrors, boolean, number, show, whole_number
from ksd.errors import SceneError

DEFAULT_INTERNAL_MODES = 2
"""Default number of internal modes; bodies of order 2 with these converge from end poses of the joint records."""


@dataclass(frozen=True)
class ModalBasis(metaclass=ClearArgumentErrors):
    """How the modal basis of a leaf is made.

    coordinates: "director" (position and two directors of every node; r' = director is linear, so a linear span can keep a
    bent leaf free of shear) or "angle" (as printed: position and rotation vector; stiffens with the fourth power of the
    stroke, and more with a finer mesh). frame: "chord" (turns with the line between the ends; more accurate by a factor of
    25 to 70 at 0.1 L) or "node" (as printed: the frame of end p). internal: number of fixed-interface modes (without them
    the support compliance of a guide is 2 to 100 times too low). order: highest derivative of the static path, 2 or 3
    (twice the unknowns; corrects the angles; with directors and ten elements more unknowns than the chain itself), or 1 for
    none. derivatives: "free" (an unknown each, as printed) or "tied" to the products of their modes, the quadratic
    manifold, for comparison: 6 unknowns, but locked, its stroke eight times too short at 0.1 L, since deformation outside
    the static path is impossible; with angles and order 2 only. elements: Appendix A elements per leaf of the model that is
    reduced. expansion: "rest", or "trained": about the kinematic state of the joint records at the given drive values
    (tangent basis), which then represents unintended loads fully. plane: derivatives of in-plane modes only: half the
    unknowns, but a wrong support stiffness out of the plane; for planar comparisons. cut: singular values below this
    fraction are dropped. Raises SceneError for values that are not possible.

    >>> guide, stroke, _ = ksd.load_scene("guide")
    >>> pose = ksd.solve(guide, stroke, method="modal", basis=ksd.ModalBasis(internal=2))
    >>> print(f"{pose.forces['table']:.2f} N")
    5.04 N
    """

    coordinates: str = "director"
    _: KW_ONLY
    frame: str = "chord"
    internal: int = DEFAULT_INTERNAL_MODES
    order: int = 2
    derivatives: str = "free"
    elements: int = 10
    expansion: str = "rest"
    plane: bool = False
    cut: float = 1e-8

    def __post_init__(self) -> None:
        _check_word("coordinates", self.coordinates, ("director", "angle"))
        _check_word("frame", self.frame, ("chord", "node"))
        _check_word("expansion", self.expansion, ("rest", "trained"))
        _check_word("derivatives", self.derivatives, ("free", "tied"))
        if self.derivatives == "tied" and (self.coordinates != "angle" or self.order != 2):
            raise SceneError(
                "derivatives = 'tied': the quadratic manifold is one of coordinates='angle' and order=2, where every "
                "mode has one amplitude"
            )
        for name in ("order", "internal", "elements"):
            whole_number(getattr(self, name), name, least=0)
        boolean(self.plane, "plane")
        if self.order not in (1, 2, 3):
            raise SceneError(f"order = {self.order}: 1 (no derivatives), 2 or 3 are possible")
        if not 0 <= self.internal <= 12:
            raise SceneError(
                f"internal = {self.internal}: between 0 and 12 fixed-interface modes are possible"
            )
        if not 2 <= self.elements <= 500:
            raise SceneError(f"elements = {self.elements}: between 2 and 500 elements per leaf are possible")
        if not 0.0 < number(self.cut, "cut") < 1e-2:
            raise SceneError(f"cut = {self.cut}: give a fraction between 0 and 0.01, for example 1e-8")

    @property
    def large(self) -> bool:
        """Whether it has so many director columns without energy that Newton fails from a rough start."""
        many = self.order == 3 or self.internal > DEFAULT_INTERNAL_MODES
        return self.coordinates == "director" and many

    @property
    def smaller(self) -> ModalBasis:
        """A smaller basis, (nearly) contained in this one, whose equilibrium is the start for this one."""
        return replace(self, order=2, internal=DEFAULT_INTERNAL_MODES)

    def __str__(self) -> str:
        plane = ", in-plane derivatives" if self.plane else ""
        about = "" if self.expansion == "rest" else ", about the trained configuration"
        tied = " on a quadratic manifold" if self.derivatives == "tied" else ""
        return (
            f"{self.coordinates} coordinates, {self.frame} frame, {self.internal} internal modes, order {self.order}{tied}, "
            f"{self.elements} elements per leaf{about}{plane}"
        )


def _check_word(name: str, value: object, known: tuple[str, ...]) -> None:
    """Raises SceneError for a value that is not one of the known words."""
    if not isinstance(value, str) or value not in known:
        raise SceneError(f"{name} = {show(value)}: choose one of {', '.join(known)}")
