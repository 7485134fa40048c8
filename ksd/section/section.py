"""The cross-section of a leaf as plain numbers, independent of material and mesh."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ksd.checks import clear_argument_errors, not_negative, number, positive, show
from ksd.errors import SceneError

Point = tuple[float, float]


@dataclass(frozen=True, repr=False, kw_only=True)
class Section:
    """Cross-section numbers about the principal axes through the centroid; all SI.

    Axes: y = e2 of the leaf (thickness t), z = e3 (width w). Second moments are named by the axis of bending,
    as in paper 1 and the beam kernels: Iy = int z^2 dA = t w^3/12 about y (the stiff bending of a leaf,
    deflection along z), Iz = int y^2 dA = w t^3/12 about z (the soft bending, deflection along y).

    A [m^2]; J [m^4] Saint-Venant torsion constant (for warping-free ends); Iw [m^6] warping constant about
    the shear centre, 0 when it does not matter. ky, kz [-]: Timoshenko shear coefficients for a shear force
    along y and z, V = k G A gamma. By default they are the energy coefficients at Poisson's ratio
    0: V^2 / (2 k G A) is the shear energy per length of Saint-Venant flexure. width, thickness [m]: extents
    along z and y, needed for stress only, 0 when unknown. outline: rings of (y, z) points [m] in section
    axes, the outer ring first, then holes; None for closed forms. shear_centre (y, z) [m] from the centroid.
    tilt [rad]: angle from the y axis the outline was drawn in to the principal y axis. Raises SceneError when
    a number is not finite or not positive.

    >>> sheet = ksd.rectangle(0.5 * mm, 20 * mm)
    >>> print(f"A = {sheet.A:.3g} m^2, Iz = {sheet.Iz:.4g} m^4, J = {sheet.J:.4g} m^4")
    A = 1e-05 m^2, Iz = 2.083e-13 m^4, J = 8.202e-13 m^4
    """

    A: float
    J: float
    Iy: float
    Iz: float
    ky: float
    kz: float
    Iw: float = 0.0
    width: float = 0.0
    thickness: float = 0.0
    outline: tuple[tuple[Point, ...], ...] | None = None
    name: str = "section"
    shear_centre: Point = (0.0, 0.0)
    tilt: float = 0.0

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise SceneError(f"section: name = {show(self.name)} must be text.")
        owner, own = f"section '{self.name}'", self.__dict__
        units = {"A": "m^2", "J": "m^4", "Iy": "m^4", "Iz": "m^4", "ky": "", "kz": ""}
        for field, unit in units.items():
            own[field] = positive(own[field], field, owner=owner, unit=unit)
        for field, unit in {"Iw": "m^6", "width": "m", "thickness": "m"}.items():
            own[field] = not_negative(own[field], field, owner=owner, unit=unit)
        own["tilt"] = number(self.tilt, "tilt", owner=owner)
        own["shear_centre"] = _point(self.shear_centre, owner)
        if self.outline is not None:
            own["outline"] = _outline(self.outline, owner)

    def __repr__(self) -> str:
        lengths = (("thickness", self.thickness), ("width", self.width))
        parts = [f"{what} {1e3 * value:.4g} mm" for what, value in lengths if value]
        parts += [f"A {1e6 * self.A:.4g} mm^2"] + [
            f"{k} {1e12 * getattr(self, k):.4g} mm^4" for k in ("Iy", "Iz", "J")
        ]
        return f"<Section '{self.name}': {', '.join(parts)}>"

    def rigidity(self, *, E: float, G: float) -> tuple[float, float, float]:
        """(GJ, EIy, EIz) [N m^2] for moduli E, G [Pa]: torsion, bending about e2, bending about e3."""
        return G * self.J, E * self.Iy, E * self.Iz

    def compliance(self, *, E: float, G: float) -> tuple[float, float, float]:
        """(1/EA, 1/(ky GA), 1/(kz GA)) [1/N] for moduli E, G [Pa]: stretch, shear along y, shear along z."""
        return 1.0 / (E * self.A), 1.0 / (self.ky * G * self.A), 1.0 / (self.kz * G * self.A)


class SectionArrays(NamedTuple):
    """The numbers of k sections as arrays (k,), see `Section`."""

    A: NDArray[np.float64]
    J: NDArray[np.float64]
    Iy: NDArray[np.float64]
    Iz: NDArray[np.float64]
    ky: NDArray[np.float64]
    kz: NDArray[np.float64]
    Iw: NDArray[np.float64]
    width: NDArray[np.float64]
    thickness: NDArray[np.float64]


def _outline(value: Any, owner: str) -> tuple[tuple[Point, ...], ...]:
    """Checked rings of points (y, z) [m]. Raises SceneError."""
    try:
        rings = [list(ring) for ring in value]
    except TypeError:
        raise SceneError(
            f"{owner}: outline = {show(value)} must be a list of rings of points (y, z)."
        ) from None
    if not rings or min(map(len, rings)) < 3:
        raise SceneError(f"{owner}: outline = {show(value)}: every ring needs three points (y, z) or more.")
    return tuple(tuple(_point(p, owner) for p in ring) for ring in rings)


def _point(value: Any, owner: str) -> Point:
    """A checked point (y, z) [m]. Raises SceneError."""
    try:
        y, z = value
    except (TypeError, ValueError):
        raise SceneError(f"{owner}: point {show(value)} must be two numbers (y, z) in m.") from None
    return number(y, "point y", owner=owner, unit="m"), number(z, "point z", owner=owner, unit="m")


def thickness_and_width(section: Section) -> tuple[float, float]:
    """Thickness and width [m] of a section: as given, or of the rectangle with the same area and second moments."""
    return (
        section.thickness or math.sqrt(12 * section.Iz / section.A),
        section.width or math.sqrt(12 * section.Iy / section.A),
    )


@clear_argument_errors
def numbers(
    *,
    A: float,
    J: float,
    Iy: float,
    Iz: float,
    ky: float = 5 / 6,
    kz: float = 5 / 6,
    Iw: float = 0.0,
    width: float = 0.0,
    thickness: float = 0.0,
    outline: Any = None,
    name: str = "numbers",
    shear_centre: Point = (0.0, 0.0),
    tilt: float = 0.0,
) -> Section:
    """A section given directly by its numbers; meanings, units and errors as in `Section`.

    >>> beam = ksd.numbers(A=1e-5, J=2e-12, Iy=3e-10, Iz=1e-12)
    >>> beam.A, beam.ky
    (1e-05, 0.8333333333333334)
    """
    place = {"outline": outline, "shear_centre": shear_centre, "tilt": tilt}
    return Section(
        A=A, J=J, Iy=Iy, Iz=Iz, ky=ky, kz=kz, Iw=Iw, width=width, thickness=thickness, name=name, **place
    )
