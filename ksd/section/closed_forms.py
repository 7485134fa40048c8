"""Rectangle, circle and tube in closed form, and the restrained-warping factor of a clamped leaf."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ksd.checks import MAX_MAGNITUDE, MIN_POSITIVE, between, clear_argument_errors, positive, show
from ksd.errors import SceneError
from ksd.section.constants import Section, Sections

_ODD_FIFTHS = 31 / 32 * 1.0369277551433699
"""Sum of 1/n^5 over odd n, 31/32 zeta(5)."""
_ODD_SIXTHS, _ODD_SEVENTHS = math.pi**6 / 960, 127 / 128 * 1.0083492773819228
"""Those of 1/n^6 and, 127/128 zeta(7), of 1/n^7."""
Array = NDArray[np.float64]


def _terms(ratio: Any) -> range:
    """Odd numbers n of the terms of the series of the rectangle in which exp(-n ratio) is more than rounding."""
    return range(1, int(40.0 / (ratio if isinstance(ratio, float) else ratio.min())) + 1, 2)


def _torsion(short: Any, long: Any, exp: Callable[[Any], Any] = math.exp) -> Any:
    """Saint-Venant constant, exact series (Timoshenko and Goodier, Theory of Elasticity, art. 109)."""
    ratio, total = math.pi * long / short, _ODD_FIFTHS
    for n in _terms(ratio):
        # 1 - tanh x = 2 / (exp(2 x) + 1): what is left after the sum of 1/n^5 dies out exponentially
        left = exp(-n * ratio)
        total = total - 2 * left / (1 + left) / n**5
    return long * short**3 * (1 / 3 - 64 / math.pi**5 * short / long * total)


def _warping(short: Any, long: Any, exp: Callable[[Any], Any] = math.exp) -> Any:
    """int omega^2 dA, omega = y z + sum A_n sin(k_n y) sinh(k_n z), k_n = n pi/t, n odd, summed term by term."""
    ratio, slender, square = math.pi * long / short, long * short**5 / math.pi**6, short**6 / math.pi**7
    # all terms with T = tanh(k w / 2) = 1, then what T < 1 changes in the first few
    total = 96 * square * _ODD_SEVENTHS - 32 * slender * _ODD_SIXTHS
    for n in _terms(ratio):
        left = exp(-n * ratio)
        missing = 2 * left / (1 + left)
        total = total - 96 * square * missing / n**7 - 16 * slender * missing * (2 - missing) / n**6
    return (short * long) ** 3 / 144 + total


def _poisson(nu: float | None, owner: str) -> float | None:
    return None if nu is None else between(nu, "cowper (Poisson's ratio)", -1.0, 0.500001, owner=owner)


@clear_argument_errors
def rectangle(
    thickness: float, width: float, *, cowper: float | None = None, name: str = "rectangle"
) -> Section:
    """Rectangle of `thickness` [m] along y and `width` [m] along z.

    Shear coefficients 5/6 (energy coefficient at nu = 0, both directions); `cowper=nu` uses Cowper's
    10 (1 + nu) / (12 + 11 nu) instead (J. Appl. Mech. 33, 1966, table 1). J by the exact series.
    Raises SceneError unless both lengths are positive and finite.
    """
    if not isinstance(name, str):
        raise SceneError(f"rectangle: name = {show(name)} must be text.")
    t = positive(thickness, "thickness", owner=name, unit="m")
    w = positive(width, "width", owner=name, unit="m")
    nu = _poisson(cowper, name)
    return _rectangle(t, w, nu, name)


@lru_cache(maxsize=256)
def _rectangle(t: float, w: float, nu: float | None, name: str) -> Section:
    k = 5 / 6 if nu is None else 10 * (1 + nu) / (12 + 11 * nu)
    sides = min(t, w), max(t, w)
    J, Iw = _torsion(*sides), _warping(*sides)
    A, Iy, Iz = t * w, t * w**3 / 12, w * t**3 / 12
    if not (min(A, J, Iy, Iz) >= MIN_POSITIVE and max(A, J, Iy, Iz, Iw) <= MAX_MAGNITUDE and Iw >= 0.0):
        return Section(A, J, Iy, Iz, k, k, Iw, width=w, thickness=t, name=name)  # says what is wrong
    # past the checks of a section: a profile asks for many, and a design loop anew for every design
    found = object.__new__(Section)
    found.__dict__.update(A=A, J=J, Iy=Iy, Iz=Iz, ky=k, kz=k, Iw=Iw, width=w, thickness=t, name=name)
    return found


def rectangles(thickness: Array, width: Array) -> Sections:
    """`rectangle` of many thicknesses and widths (k,) [m]. Raises SceneError for numbers beyond those of a section."""
    t, w = thickness, width
    sides = np.minimum(t, w), np.maximum(t, w)
    k = np.full(len(t), 5 / 6)
    found = Sections(
        t * w, _torsion(*sides, np.exp), t * w**3 / 12, w * t**3 / 12, k, k, _warping(*sides, np.exp), w, t
    )
    least, most = (end([found.A, found.J, found.Iy, found.Iz], axis=0) for end in (np.min, np.max))
    for i in np.flatnonzero(~((least >= MIN_POSITIVE) & (most <= MAX_MAGNITUDE))):
        # says what is wrong
        rectangle(float(t[i]), float(w[i]))
    return found


@clear_argument_errors
def circle(diameter: float, *, cowper: float | None = None, name: str = "circle") -> Section:
    """Full circle of `diameter` [m], the section of a wire.

    Shear coefficient 6/7 (energy coefficient at nu = 0); `cowper=nu`: 6 (1 + nu) / (7 + 6 nu).
    Raises SceneError unless the diameter is positive and finite.
    """
    d = positive(diameter, "diameter", owner=name, unit="m")
    nu = _poisson(cowper, name) or 0.0
    k, moment = 6 * (1 + nu) / (7 + 6 * nu), math.pi * d**4 / 64
    return Section(math.pi * d**2 / 4, 2 * moment, moment, moment, k, k, width=d, thickness=d, name=name)


@clear_argument_errors
def tube(outer: float, inner: float, *, cowper: float | None = None, name: str = "tube") -> Section:
    """Circular tube of `outer` and `inner` diameter [m].

    Shear coefficient of Cowper at nu = 0, which is the energy coefficient there, or at `cowper=nu`:
    6 (1 + nu)(1 + m^2)^2 / ((7 + 6 nu)(1 + m^2)^2 + (20 + 12 nu) m^2), m = inner/outer.
    Raises SceneError unless 0 < inner < outer.
    """
    D = positive(outer, "outer", owner=name, unit="m")
    d = positive(inner, "inner", owner=name, unit="m")
    if d >= D:
        raise SceneError(f"{name}: inner = {show(inner)} m must be smaller than outer = {show(outer)} m.")
    nu, ratio = _poisson(cowper, name) or 0.0, (d / D) ** 2
    s = (1 + ratio) ** 2
    k = 6 * (1 + nu) * s / ((7 + 6 * nu) * s + (20 + 12 * nu) * ratio)
    moment = math.pi * (D**4 - d**4) / 64
    A = math.pi * (D**2 - d**2) / 4
    return Section(A, 2 * moment, moment, moment, k, k, width=D, thickness=D, name=name)


def is_rectangle(section: Section) -> bool:
    """Whether the warping constant is that of a rectangle of the section's width and thickness."""
    if not min(section.width, section.thickness) > 0.0:
        return False
    sides = section.thickness, section.width
    return math.isclose(section.Iw, _warping(min(sides), max(sides)), rel_tol=1e-9)


def restrained_warping_factor(length: float, width: float, nu: float) -> float:
    """Factor on GJ of a thin leaf clamped at both ends, where it cannot warp; 1 for long leaf springs.

    a c / (a c - 2 tanh(a c / 2)) with a = length/width, c = sqrt(24 / (1 + nu)); lengths in m, nu Poisson's
    ratio. From Vlasov's equation with Iw = (t w)^3/144. Raises SceneError for lengths that are not positive.
    """
    a = positive(length, "length", owner="warping factor", unit="m")
    a /= positive(width, "width", owner="warping factor", unit="m")
    x = a * math.sqrt(24 / (1 + between(nu, "nu", -1.0, 0.500001, owner="warping factor")))
    return clamped_ends_factor(x)


def clamped_ends_factor(x: float) -> float:
    """Factor on GJ of a uniform piece that cannot warp at its ends; x: its length times the decay of warping along it."""
    if x < 1e-2:
        # x - 2 tanh(x/2) = x^3/12 (1 - x^2/10 + ..): the difference would lose its digits
        return 12 / x**2 * (1 + x**2 / 10)
    return x / (x - 2 * math.tanh(0.5 * x))
