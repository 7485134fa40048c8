"""Plate stiffening: a wide leaf bends stiffer than a beam, where its cross-section cannot curl.

Two things keep it from curling: clamps, which hold the end sections flat (`curl_along`), and bending to a large curvature,
which would stretch the edges of a curled section (`free_curl`, Ashwell's strip). `ksd.elements.plate_energy` has both.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from numpy.polynomial.legendre import Legendre, leggauss

from ksd.section.along_leaf import AlongLeaf, element_points

Array = np.ndarray
CURL_FUNCTIONS = 4
"""Even Legendre polynomials across the width, of degrees 2, 4, 6. Of the stiffening of guides by their clamps one function
has 13 % too much, two 1.5 %, three .5 %."""
TWIST_EDGES = 0.63
"""Part of J = w t^3/3 (1 - .63 t/w) that the edges of a rectangle take, over t/w."""
SMALLEST_CURL = 1e-3
"""Smallest curl in a quotient; next to clamps it is slightly negative."""
SHARE_LIMITS = 0.2, 2.0
"""Bounds of the factor by which the loss under linear moments changes that under constant ones."""


def free_curl(p: Array) -> Array:
    """Mean curling of a bent strip over that of a narrow one, 2/p (cosh p - cos p)/(sinh p + sin p).

    p^2 = sqrt(3 (1 - nu^2)) w^2 |kappa| / t, Searle's parameter times a constant. The energy of the strip is 1/2 D w kappa^2
    (1 - nu^2 times this). Source: D. G. Ashwell, The anticlastic curvature of rectangular beams and plates, J. Royal
    Aeronautical Society 54 (1950) 708-715.
    """
    q = np.clip(p, 0.05, 300.0)
    # in a very wide strip two free edges, each a layer of its own; in a narrow one a series without cancellation
    wide = 2.0 / np.maximum(p, 0.05) * (np.cosh(q) - np.cos(q)) / (np.sinh(q) + np.sin(q))
    return np.where(p < 0.05, 1.0 - np.power(p, 4) / 180.0, wide)


class Strips(NamedTuple):
    """Strips that follow one another, at the Gauss points (n, ELEMENT_POINTS) of their elements.

    width, thickness [m]; nu: Poisson's ratio, 0 where no curling is modelled; rigidity: E Iz [N m^2]; own: curvature at rest
    [1/m].
    """

    width: Array
    thickness: Array
    nu: Array
    rigidity: Array
    own: Array


@lru_cache(maxsize=1)
def _curl_tables() -> tuple[Array, ...]:
    """Integrals over the width, (K, K) each, of the curl functions f and their derivatives by 2 y / w, over the width.

    f f, f' f', f'' f'', f f'', and (K,) the mean of f''.
    """
    y, weight = leggauss(2 * CURL_FUNCTIONS + 2)
    f = [Legendre.basis(2 * k) for k in range(1, CURL_FUNCTIONS + 1)]
    plain, slope, bend = (np.array([p.deriv(n)(y) if n else p(y) for p in f]) for n in range(3))
    weight = 0.5 * weight
    pairs = ((plain, plain), (slope, slope), (bend, bend), (plain, bend))
    return (*((a * weight) @ b.T for a, b in pairs), bend @ weight)


@lru_cache(maxsize=1)
def _hermite_tables() -> Array:
    """Cubic Hermite functions (value, slope at the start, at the end) of an element of unit length at its Gauss points, and
    their first and second derivatives, (3, 4, ELEMENT_POINTS)."""
    x, _ = element_points()
    one, zero = np.ones(len(x)), 6 * x * (1 - x)
    return np.array(
        [
            [1 - 3 * x**2 + 2 * x**3, x - 2 * x**2 + x**3, 3 * x**2 - 2 * x**3, x**3 - x**2],
            [-zero, 1 - 4 * x + 3 * x**2, zero, 3 * x**2 - 2 * x],
            [12 * x - 6, 6 * x - 4 * one, 6 - 12 * x, 6 * x - 2 * one],
        ]
    )


class Curling(NamedTuple):
    """Curling along strips whose ends are held flat, at the Gauss points of elements or elsewhere.

    compliance: curvature by the moment over that of a beam, E Iz kappa / M, at small curvature; loss, rate: chi and r of
    `ksd.elements.plate_energy`.
    """

    compliance: Array
    loss: Array
    rate: Array


@dataclass(frozen=True)
class PlateStiffening(AlongLeaf):
    """Curling along a leaf or a part of one: values of `Curling`.

    uneven ((1 + 2 CURL_FUNCTIONS) n ELEMENT_POINTS,): `Uneven` at the Gauss points.
    """

    uneven: tuple[float, ...] = ()

    def __call__(self, s: Array) -> Curling:
        """Values (k,) at fractions s (k,) of the length."""
        return Curling(*self.rows(s))

    def means(self, cuts: Array) -> Curling:
        """Mean values (k,) between fractions `cuts` (k+1,) of the length."""
        return Curling(*self.mean_rows(cuts))

    def moment_across(self, s: Array, z: Array, moments: Array) -> Array:
        """What the moment per width times the width has more than the moment of the section (..., k, p), at fractions s (k,)
        of the length and at z (k, p), in half widths from the middle.

        moments (..., k): of the sections; the stress of a leaf that is loaded at its ends, at small curvature.
        """
        x, *rows = self.interpolated(self.uneven, s)
        constant, linear = np.reshape(rows, (2, CURL_FUNCTIONS, -1))
        base = np.stack([np.ones(len(x)), x], axis=1)
        parts = moments @ np.linalg.pinv(base).T
        amplitudes = parts[..., :1, None] * constant + parts[..., 1:, None] * linear
        f = np.stack([Legendre.basis(2 * k)(z) for k in range(1, CURL_FUNCTIONS + 1)])
        return np.asarray(np.einsum("...ks,ksp->...sp", amplitudes, f))

    @cached_property
    def small_factors(self) -> tuple[float, float]:
        """Factors on the bending stiffness of a uniform leaf at small curvature: under a moment, and with parallel ends."""
        cuts, (x, weight) = np.array(self.breaks), element_points()
        s = (cuts[:-1, None] + np.diff(cuts)[:, None] * x).ravel()
        c = (np.diff(cuts)[:, None] * weight).ravel() * self(s).compliance
        return 1.0 / float(c.sum()), 1.0 / (3.0 * float(c @ (2.0 * s - 1.0) ** 2))


class Uneven(NamedTuple):
    """How far the moment per width varies across the width, at the Gauss points of elements.

    place: coordinate x along the strips; constant, linear (CURL_FUNCTIONS, ...): amplitudes of the curl functions in the
    moment per width times the width, under the moments 1 and x.
    """

    place: Array
    constant: Array
    linear: Array


def curl_along(edges: Array, strips: Strips, held: tuple[bool, bool]) -> tuple[Curling, Uneven]:
    """`Curling` and `Uneven` at the Gauss points (n, ELEMENT_POINTS) of the elements of strips.

    edges (n+1,) [m]: of the elements; held: whether clamps keep the first and the last section flat.

    The deflection of the plate is v(x) + sum_k f_k(y) g_k(x), with the energy per length of a Kirchhoff plate and, in
    strips curved at rest, that of stretching, 1/2 E t (own sum f_k g_k)^2; g = g' = 0 at clamps. The curvature at a moment
    is then an integral over the moments everywhere. `compliance` is the local one that is equivalent for moments linear
    along the strips, as they are in a leaf that is loaded at its ends: that of a constant moment, plus a multiple of a
    quadratic function which has no work with constant and linear moments, so that the linear one has its own work. `loss`
    is the square of the curl over that far from clamps, to which the first energy of stretching is proportional, and `rate`
    = loss / curl makes it end where all curl is lost.
    """
    straight = strips._replace(own=np.zeros(strips.own.shape))
    narrow, curl, moved, uneven = _solve_curl(edges, straight, held)
    free = np.linalg.solve(_curl_stiffness(straight), _curl_source(straight)[..., None])[..., 0]
    plain = _curl_tables()[0]
    most = np.maximum(np.einsum("...k,kl,...l", free, plain, free), 1e-300)
    loss = np.where(strips.nu != 0.0, np.einsum("...k,kl,...l", curl, plain, curl) / most, 1.0)
    square = np.maximum(strips.nu**2, 1e-300)
    mean = np.where(strips.nu != 0.0, (1.0 - (1.0 - strips.nu**2) / narrow) / square, 1.0)
    loss = loss * _linear_share(
        edges, straight, loss, np.einsum("...k,kl,...l", moved[1], plain, moved[1]) / most, moved[0]
    )
    rate = loss / np.maximum(np.abs(mean), SMALLEST_CURL)
    return Curling(_solve_curl(edges, strips, held)[0] if strips.own.any() else narrow, loss, rate), uneven


def _linear_share(edges: Array, strips: Strips, loss: Array, square: Array, bend: Array) -> Array:
    """Factor (n, q) on `loss` with which bending by a linear moment first loses as much as its own curl does.

    square: of the curl, and bend: curvature, under a linear moment. The loss under a constant moment stays as it is.
    """
    length = edges[-1] - edges[0]
    point, weight = element_points()
    weight = (
        np.diff(edges)[:, None]
        * weight
        * strips.rigidity
        * (strips.nu / strips.thickness) ** 2
        * strips.width**4
    )
    x = (edges[:-1, None] + np.diff(edges)[:, None] * point - edges[0]) / length - 0.5
    middle = x * x - (weight * loss * x * x).sum() / max((weight * loss).sum(), 1e-300)
    own = (weight * square * bend**2).sum()
    lacking = own - (weight * loss * bend**4).sum()
    per_unit = (weight * loss * middle * bend**4).sum()
    share = 1.0 + (lacking / per_unit if per_unit > 0.0 else 0.0) * middle
    return np.asarray(np.clip(share, *SHARE_LIMITS))


def _curl_source(strips: Strips) -> Array:
    """Moment (n, q, K) on the curl functions by a unit curvature, over D w."""
    return np.asarray((4.0 * strips.nu / strips.width**2)[..., None] * _curl_tables()[4])


def _curl_stiffness(strips: Strips) -> Array:
    """Stiffness (n, q, K, K) of the curl functions far from clamps, over D w."""
    plain, _, bent, _, _ = _curl_tables()
    stretching = 12.0 * (1.0 - strips.nu**2) * (strips.own / strips.thickness) ** 2
    return np.asarray((16.0 / strips.width**4)[..., None, None] * bent + stretching[..., None, None] * plain)


def _solve_curl(
    edges: Array, strips: Strips, held: tuple[bool, bool]
) -> tuple[Array, Array, tuple[Array, Array], Uneven]:
    """`Curling.compliance`, the curl (n, q, K) by unit curvature under a constant moment, curvature and curl under a linear
    one, and `Uneven`."""
    _, thickness, nu, rigidity, own = strips
    plate, source, local = rigidity / (1.0 - nu**2), _curl_source(strips), _curl_stiffness(strips)
    point, weight = element_points()
    weight = np.diff(edges)[:, None] * weight / rigidity
    x = (edges[:-1, None] + np.diff(edges)[:, None] * point - edges[0]) / (edges[-1] - edges[0])
    x = x - (weight * x).sum() / weight.sum()
    moments = np.stack([np.ones(x.shape), x], axis=-1)
    stiff = local - source[..., None] * source[..., None, :]
    curl, bent = _CurlSystem(np.diff(edges), strips, plate, held).solve(
        stiff, source[..., None] * moments[..., None, :]
    )
    plain, _, _, mixed, _ = _curl_tables()
    # f'' less its mean, as a sum of f
    across = (4.0 * nu / strips.width**2)[..., None, None] * np.linalg.solve(plain, mixed)
    uneven = -plate[..., None, None] * (bent + across @ curl)
    bends = moments + plate[..., None] * np.einsum("...k,...ki", source, curl)
    constant, linear = np.moveaxis((1.0 - nu**2)[..., None] * bends, -1, 0)
    square = x * x - (weight * x**3).sum() / (weight * x * x).sum() * x
    square -= (weight * square).sum() / weight.sum()
    lacking = (weight * (x * linear - x * x * constant)).sum() / (weight * square * x * x).sum()
    far = (1.0 - nu**2) / (
        1.0 - np.einsum("...k,...k", source, np.linalg.solve(local, source[..., None])[..., 0])
    )
    p = np.sqrt(np.sqrt(3.0 * (1.0 - nu**2)) * strips.width**2 * np.abs(own) / thickness)
    exact = (1.0 - nu**2) / (1.0 - nu**2 * free_curl(p))
    compliance = exact + constant - far + lacking * square
    return (
        compliance,
        curl[..., 0] * (rigidity / constant)[..., None],
        (linear / rigidity, curl[..., 1]),
        Uneven(x, *np.moveaxis(uneven, (2, 3), (1, 0))),
    )


class _CurlSystem:
    """Equations of the curl amplitudes -g along strips, by cubic Hermite elements of lengths h (n,) [m].

    plate (n, ELEMENT_POINTS): D w [N m^2]; unknowns of a node are the amplitudes and their slopes, times a width, in turn.
    """

    def __init__(self, h: Array, strips: Strips, plate: Array, held: tuple[bool, bool]) -> None:
        plain, steep, _, mixed, _ = _curl_tables()
        scale, per_node = float(strips.width.mean()), 2 * CURL_FUNCTIONS
        self.weight = h[:, None] * element_points()[1]
        slopes = np.stack([np.ones(len(h)), h / scale] * 2, axis=1)
        value, slope, bend = (
            slopes[:, :, None] * table / h[:, None, None] ** n for n, table in enumerate(_hermite_tables())
        )
        self.value, self.bend, self.plate = value, bend, plate
        energy, twist = self.weight * plate, 8.0 * (1.0 - strips.nu) / strips.width**2
        # a strip of some thickness twists softer at its edges
        twist *= 1.0 - TWIST_EDGES * strips.thickness / strips.width
        poisson = np.einsum("eq,eiq,ejq->eij", energy * 4.0 * strips.nu / strips.width**2, bend, value)
        poisson = np.einsum("eij,kl->eikjl", poisson, mixed)
        self.fixed = (
            np.einsum("eij,kl->eikjl", np.einsum("eq,eiq,ejq->eij", energy * twist, slope, slope), steep)
            + np.einsum("eij,kl->eikjl", np.einsum("eq,eiq,ejq->eij", energy, bend, bend), plain)
            + poisson + poisson.transpose(0, 3, 4, 1, 2)
        )  # fmt: skip
        # unknown of Hermite function i and curl function k of an element
        i, k = np.divmod(np.arange(4 * CURL_FUNCTIONS), CURL_FUNCTIONS)
        of = per_node * (i // 2) + 2 * k + i % 2
        self.unknown = per_node * np.arange(len(h))[:, None] + of
        self.count = per_node * (len(h) + 1)
        self.kept = slice(per_node * held[0], self.count - per_node * held[1])

    def solve(self, local: Array, load: Array) -> tuple[Array, Array]:
        """Amplitudes (n, q, K, c) at the Gauss points under loads (n, q, K, c) per length, and their second derivatives;
        local (n, q, K, K): stiffness density of the amplitudes over D w."""
        from scipy.linalg import solveh_banded

        N, size = self.value, 4 * CURL_FUNCTIONS
        own = np.einsum("eq,eiq,ejq,eqkl->eikjl", self.weight * self.plate, N, N, local)
        matrix = (self.fixed + own).reshape(len(N), size, size)
        columns = load.shape[-1]
        pushed = np.einsum("eq,eiq,eqkc->eikc", self.weight, N, load).reshape(len(N), size, columns)
        high = size - 1
        row, column = np.broadcast_arrays(self.unknown[:, :, None], self.unknown[:, None, :])
        upper = row <= column
        at = (high + row - column)[upper] * self.count + column[upper]
        bands = np.bincount(at, matrix[upper], (high + 1) * self.count).reshape(high + 1, self.count)
        rhs = np.zeros((self.count, columns))
        np.add.at(rhs, self.unknown, pushed)
        found = np.zeros((self.count, columns))
        found[self.kept] = solveh_banded(bands[:, self.kept], rhs[self.kept])
        amplitudes = found[self.unknown].reshape(len(N), 4, CURL_FUNCTIONS, columns)
        first, second = (np.einsum("eiq,eikc->eqkc", values, amplitudes) for values in (N, self.bend))
        return first, second
