"""Rectangle, circle and tube in closed form, and the factor of restrained warping on the torsional stiffness of a leaf."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.checks import MAX_MAGNITUDE, MIN_POSITIVE, between, clear_argument_errors, positive, show
from ksd.errors import SceneError
from ksd.section.section import Section, SectionArrays

_ODD_SUM_5 = 31 / 32 * 1.0369277551433699
"""Sum of 1/n^5 over odd n, 31/32 zeta(5)."""
_ODD_SUM_6, _ODD_SUM_7 = math.pi**6 / 960, 127 / 128 * 1.0083492773819228
"""Sums of 1/n^6 and of 1/n^7, 127/128 zeta(7), over odd n."""
Array = NDArray[np.float64]


def _series_terms(ratio: Any) -> range:
    """Odd n for which exp(-n ratio) is more than rounding."""
    return range(1, int(40.0 / (ratio if isinstance(ratio, float) else ratio.min())) + 1, 2)


def _torsion_constant(short: Any, long: Any, exp: Callable[[Any], Any] = math.exp) -> Any:
    """Saint-Venant torsion constant [m^4] of a rectangle with these sides [m], numbers or arrays (k,).

    Exact series of Timoshenko and Goodier, Theory of Elasticity, art. 109; exp: of numbers or of arrays.
    """
    ratio, total = math.pi * long / short, _ODD_SUM_5
    for n in _series_terms(ratio):
        # 1 - tanh x = 2 / (exp(2 x) + 1): the difference from the sum of 1/n^5 decays exponentially
        decay = exp(-n * ratio)
        total = total - 2 * decay / (1 + decay) / n**5
    return long * short**3 * (1 / 3 - 64 / math.pi**5 * short / long * total)


def _warping_constant(short: Any, long: Any, exp: Callable[[Any], Any] = math.exp) -> Any:
    """Warping constant [m^6] of a rectangle with these sides [m], numbers or arrays (k,).

    int omega^2 dA with omega = y z + sum A_n sin(k_n y) sinh(k_n z), k_n = n pi/t, n odd, summed term by term.
    """
    ratio, slender, square = math.pi * long / short, long * short**5 / math.pi**6, short**6 / math.pi**7
    # all terms with T = tanh(k w / 2) = 1, then the correction for T < 1 of the first few
    total = 96 * square * _ODD_SUM_7 - 32 * slender * _ODD_SUM_6
    for n in _series_terms(ratio):
        decay = exp(-n * ratio)
        missing = 2 * decay / (1 + decay)
        total = total - 96 * square * missing / n**7 - 16 * slender * missing * (2 - missing) / n**6
    return (short * long) ** 3 / 144 + total


def _check_poisson(nu: float | None, owner: str) -> float | None:
    """Poisson's ratio of the option `cowper`, checked; None stays None. Raises SceneError."""
    return None if nu is None else between(nu, "cowper (Poisson's ratio)", -1.0, 0.500001, owner=owner)


@clear_argument_errors
def rectangle(
    thickness: float, width: float, *, cowper: float | None = None, name: str = "rectangle"
) -> Section:
    """Rectangle of `thickness` [m] along y and `width` [m] along z.

    Shear coefficients 5/6 (energy coefficient at nu = 0, both directions); `cowper=nu` uses Cowper's
    10 (1 + nu) / (12 + 11 nu) instead (J. Appl. Mech. 33, 1966, table 1). J by the exact series.
    Raises SceneError unless both lengths are positive and finite.

    >>> sheet = ksd.rectangle(0.5 * mm, 20 * mm)
    >>> print(f"A = {sheet.A:.3g} m^2, Iz = {sheet.Iz:.4g} m^4, J = {sheet.J:.4g} m^4")
    A = 1e-05 m^2, Iz = 2.083e-13 m^4, J = 8.202e-13 m^4
    """
    if not isinstance(name, str):
        raise SceneError(f"rectangle: name = {show(name)} must be text.")
    t = positive(thickness, "thickness", owner=name, unit="m")
    w = positive(width, "width", owner=name, unit="m")
    nu = _check_poisson(cowper, name)
    return _rectangle(t, w, nu, name)


@lru_cache(maxsize=256)
def _rectangle(t: float, w: float, nu: float | None, name: str) -> Section:
    k = 5 / 6 if nu is None else 10 * (1 + nu) / (12 + 11 * nu)
    sides = min(t, w), max(t, w)
    J, Iw = _torsion_constant(*sides), _warping_constant(*sides)
    A, Iy, Iz = t * w, t * w**3 / 12, w * t**3 / 12
    if not (min(A, J, Iy, Iz) >= MIN_POSITIVE and max(A, J, Iy, Iz, Iw) <= MAX_MAGNITUDE and Iw >= 0.0):
        # raises SceneError with the reason
        return Section(A=A, J=J, Iy=Iy, Iz=Iz, ky=k, kz=k, Iw=Iw, width=w, thickness=t, name=name)
    # without the checks of a section: a profile has many sections, and a design loop makes them anew for every design
    found = object.__new__(Section)
    found.__dict__.update(A=A, J=J, Iy=Iy, Iz=Iz, ky=k, kz=k, Iw=Iw, width=w, thickness=t, name=name)
    return found


def rectangles(thickness: Array, width: Array) -> SectionArrays:
    """`rectangle` for arrays of thicknesses and widths (k,) [m]. Raises SceneError as `rectangle`."""
    t, w = thickness, width
    sides = np.minimum(t, w), np.maximum(t, w)
    k = np.full(len(t), 5 / 6)
    found = SectionArrays(
        t * w,
        _torsion_constant(*sides, np.exp),
        t * w**3 / 12,
        w * t**3 / 12,
        k,
        k,
        _warping_constant(*sides, np.exp),
        w,
        t,
    )
    least, most = (end([found.A, found.J, found.Iy, found.Iz], axis=0) for end in (np.min, np.max))
    for i in np.flatnonzero(~((least >= MIN_POSITIVE) & (most <= MAX_MAGNITUDE))):
        # raises SceneError with the reason
        rectangle(float(t[i]), float(w[i]))
    return found


@clear_argument_errors
def circle(diameter: float, *, cowper: float | None = None, name: str = "circle") -> Section:
    """Full circle of `diameter` [m], the section of a wire.

    Shear coefficient 6/7 (energy coefficient at nu = 0); `cowper=nu`: 6 (1 + nu) / (7 + 6 nu).
    Raises SceneError unless the diameter is positive and finite.

    >>> wire = ksd.circle(0.5 * mm)
    >>> print(f"A = {wire.A:.4g} m^2, Iz = {wire.Iz:.4g} m^4")
    A = 1.963e-07 m^2, Iz = 3.068e-15 m^4
    """
    d = positive(diameter, "diameter", owner=name, unit="m")
    nu = _check_poisson(cowper, name) or 0.0
    k, moment = 6 * (1 + nu) / (7 + 6 * nu), math.pi * d**4 / 64
    return Section(
        A=math.pi * d**2 / 4, J=2 * moment, Iy=moment, Iz=moment, ky=k, kz=k, width=d, thickness=d, name=name
    )


@clear_argument_errors
def tube(outer: float, inner: float, *, cowper: float | None = None, name: str = "tube") -> Section:
    """Circular tube of `outer` and `inner` diameter [m].

    Shear coefficient of Cowper at nu = 0, which is the energy coefficient there, or at `cowper=nu`:
    6 (1 + nu)(1 + m^2)^2 / ((7 + 6 nu)(1 + m^2)^2 + (20 + 12 nu) m^2), m = inner/outer.
    Raises SceneError unless 0 < inner < outer.

    >>> rod = ksd.tube(10 * mm, 8 * mm)
    >>> print(f"A = {rod.A / mm**2:.3f} mm^2, J = {rod.J / mm**4:.1f} mm^4")
    A = 28.274 mm^2, J = 579.6 mm^4
    """
    D = positive(outer, "outer", owner=name, unit="m")
    d = positive(inner, "inner", owner=name, unit="m")
    if d >= D:
        raise SceneError(f"{name}: inner = {show(inner)} m must be smaller than outer = {show(outer)} m.")
    nu, ratio = _check_poisson(cowper, name) or 0.0, (d / D) ** 2
    s = (1 + ratio) ** 2
    k = 6 * (1 + nu) * s / ((7 + 6 * nu) * s + (20 + 12 * nu) * ratio)
    moment = math.pi * (D**4 - d**4) / 64
    A = math.pi * (D**2 - d**2) / 4
    return Section(A=A, J=2 * moment, Iy=moment, Iz=moment, ky=k, kz=k, width=D, thickness=D, name=name)


def is_rectangle(section: Section) -> bool:
    """Whether the warping constant is that of a rectangle of the section's width and thickness."""
    if not min(section.width, section.thickness) > 0.0:
        return False
    sides = section.thickness, section.width
    return math.isclose(section.Iw, _warping_constant(min(sides), max(sides)), rel_tol=1e-9)


def round_ratio(section: Section) -> float | None:
    """Inner over outer diameter of a tube, 0 of a full circle, None of any other section."""
    if section.outline is not None or not section.thickness == section.width > 0.0:
        return None
    # the second moments of a circle or tube follow from diameter and area
    empty = 1.0 - section.A / (math.pi * section.thickness**2 / 4)
    moment = section.A * section.thickness**2 * (1.0 + empty) / 16
    if empty > -1e-6 and all(math.isclose(own, moment, rel_tol=1e-6) for own in (section.Iy, section.Iz)):
        return math.sqrt(empty) if empty > 1e-6 else 0.0
    return None


def restrained_warping_factor(*, length: float, width: float, nu: float) -> float:
    """Factor on GJ of a thin leaf that is clamped, and so cannot warp, at both ends; 1 for long leaf springs.

    a c / (a c - 2 tanh(a c / 2)) with a = length/width, c = sqrt(24 / (1 + nu)); lengths in m, nu Poisson's
    ratio. From Vlasov's equation with Iw = (t w)^3/144. Raises SceneError for lengths that are not positive.
    """
    a = positive(length, "length", owner="warping factor", unit="m")
    a /= positive(width, "width", owner="warping factor", unit="m")
    x = a * math.sqrt(24 / (1 + between(nu, "nu", -1.0, 0.500001, owner="warping factor")))
    return clamped_ends_factor(x)


def clamped_ends_factor(x: float) -> float:
    """Factor on GJ of a uniform piece that cannot warp at its ends; x: its length times the decay of warping."""
    if x < 1e-2:
        # x - 2 tanh(x/2) = x^3/12 (1 - x^2/10 + ..), without its cancellation
        return 12 / x**2 * (1 + x**2 / 10)
    return x / (x - 2 * math.tanh(0.5 * x))
