"""Tables of the strain-mode leaf: modes, quadrature, moments over intervals, and its constants as one flat array.

Layout of the flat array (N = nx + ny + nz modes, ng points): L; stiffness blocks (nx^2, ny^2, nz^2) [N m^3 per
(1/m)^2]; stress-free amplitudes a0 (N); weights (ng), sum 1; integration matrix (ng, ng); modes (N, ng); compliances
(ng, 3): 1/EA, 1/(ky GA), 1/(kz GA); moments of the modes over the intervals (ng+1, 3, N); for a leaf with plate
stiffening the numbers and weak-bending modes of its plate points (k, 5 + nz, see `ksd.elements.plate_energy`); for a leaf
with weight the mass beyond each point (ng) [kg], with line loads or pressure `load_tables`, for one with inertia the tables
of `ksd.elements.inertia`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from ksd.elements.inertia import orthogonal_modes
from ksd.elements.plate_energy import POINT_NUMBERS
from ksd.elements.pressure import GIVEN_MODES, PRESSURE_MODES, PRESSURE_STORE
from ksd.numerics.kernel import kernel

DEFAULT_ORDERS = (4, 3, 6)
DEFAULT_POINTS = 7
"""Default orders have one weak-bending mode more than needed for a support stiffness to 1e-4: with five the elastica at
PL^2/EI = 5 has an error of 1.7e-6, with six 1.3e-7."""
GRAVITY_BLOCK_SIZE = 39
"""Length of the gravity block of a leaf with weight, see `ksd.elements.weight`."""


@kernel(inline="late")
def mode_counts(number, has_weight):
    """Number of force modes and of all modes of the distributed load of a leaf, and the length of its gravity block, which
    has D = 3 numbers per mode in place of the three of gravity.

    Weight is one force mode; a leaf with inertia has number[5] force and number[6] couple modes.
    """
    forces = number[5]
    if forces == 0 and has_weight:
        forces += 1
    modes = forces + number[6]
    return forces, modes, 3 * modes * (10 + 3 * modes)


class Modes(NamedTuple):
    """Unit-length tables of a set of curvature modes: points s, weights, integration matrix, modes.

    moments (ng+1, 3, N): their moments over the intervals as `ksd.elements.magnus` takes them; energy (N, N): stiffness for
    unit rigidity, integrals of products of modes divided by their shape; plate (k, 5 + nz): numbers of plate points, None
    without plate stiffening.
    """

    s: np.ndarray
    weight: np.ndarray
    integral: np.ndarray
    basis: np.ndarray
    moments: np.ndarray
    energy: np.ndarray
    plate: np.ndarray | None = None


def legendre_modes(orders: tuple[int, int, int], s: np.ndarray) -> np.ndarray:
    """Shifted Legendre polynomials P_k(2 s - 1) (N, len(s)), stacked for the three axes."""
    full = np.polynomial.legendre.legvander(2 * np.asarray(s) - 1, max(orders) - 1).T
    return np.concatenate([full[:n] for n in orders])


@lru_cache(maxsize=256)
def _quadrature(points: int, breaks: tuple[float, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Gauss points on the panels between `breaks`, weights (sum 1), and the matrix of integrals from 0."""
    x, w = np.polynomial.legendre.leggauss(points)
    lagrange = np.linalg.inv(np.polynomial.legendre.legvander(x, points - 1))
    # int_{-1}^{x} of the Lagrange polynomials through the points
    raised = np.array([np.polynomial.legendre.legint(c, lbnd=-1) for c in lagrange.T])
    local = np.polynomial.legendre.legval(x, raised.T).T
    s, weight, rows = [], [], []
    total = points * (len(breaks) - 1)
    for p, (a, b) in enumerate(pairwise(breaks)):
        half = 0.5 * (b - a)
        s.append(a + half * (1 + x))
        weight.append(half * w)
        block = np.zeros((points, total))
        for q in range(p):
            block[:, q * points : (q + 1) * points] = weight[q]
        block[:, p * points : (p + 1) * points] = half * local
        rows.append(block)
    return np.concatenate(s), np.concatenate(weight), np.concatenate(rows)


def make_modes(
    orders: tuple[int, int, int],
    points: int,
    *,
    breaks: tuple[float, ...] = (0.0, 1.0),
    shape: Callable[[np.ndarray], np.ndarray] | None = None,
) -> Modes:
    """Tables for given orders and quadrature points per panel.

    `shape(s)` (3, len(s)) multiplies the Legendre modes of each axis: the compliance of a tapered leaf relative to its
    mean, so that a moment linear in s needs two modes for any taper. `breaks` in units of the length.
    """
    s, weight, integral = _quadrature(points, breaks)
    axis = np.repeat(np.arange(3), orders)

    def shaped(x: np.ndarray, values: np.ndarray) -> np.ndarray:
        return values if shape is None else values * shape(x)[axis]

    edges = np.concatenate([[0.0], s, [1.0]])
    # an interval across a break is split there, since modes may jump
    panels = np.unique(np.concatenate([edges, breaks]))
    x, w, _ = _quadrature(12, (0.0, 1.0))
    at = (panels[:-1, None] + np.diff(panels)[:, None] * x).ravel()
    plain = legendre_modes(orders, at)
    values = shaped(at, plain) * (np.diff(panels)[:, None] * w).ravel()
    interval = np.searchsorted(edges, at) - 1
    # Legendre expansion over an interval: the mean, and the factors of t and t^2 about its middle
    t = 2.0 * (at - edges[interval]) / np.diff(edges)[interval] - 1.0
    expansion = np.stack([np.ones(len(t)), 6.0 * t, 15.0 * (3.0 * t * t - 1.0)])
    moments = np.add.reduceat(
        expansion * values[:, None], np.searchsorted(interval, np.arange(len(s) + 1)), axis=2
    )
    basis = shaped(s, legendre_modes(orders, s))
    return Modes(
        s, weight, integral, basis, np.ascontiguousarray(moments.transpose(2, 1, 0)), plain @ values.T
    )


@lru_cache(maxsize=64)
def uniform_modes(orders: tuple[int, int, int], points: int) -> Modes:
    """`make_modes` of a leaf without profile, cached."""
    return make_modes(orders, points)


def strain_values(
    *,
    length: float,
    rigidity: np.ndarray,
    compliance: np.ndarray,
    orders: tuple[int, int, int] = DEFAULT_ORDERS,
    points: int = DEFAULT_POINTS,
    modes: Modes | None = None,
    amplitudes: np.ndarray | None = None,
    line_mass: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Flat constants and settings (value, number) of one leaf.

    length [m]; rigidity (3,): GJ, EIy, EIz [N m^2], for a leaf with a profile those its mode shapes are relative to;
    compliance (3,) or (ng, 3): 1/EA, 1/(ky G A), 1/(kz G A) [1/N]; amplitudes (N,): stress-free [1/m], zero when None;
    line_mass (ng,) [kg/m], None without weight.
    """
    table = modes or uniform_modes(tuple(orders), points)
    nx, ny, nz = orders
    ng, total = len(table.s), sum(orders)
    C = np.broadcast_to(np.asarray(compliance, float), (ng, 3))
    y, z = slice(nx, nx + ny), slice(nx + ny, total)
    x = slice(0, nx)
    own = [length * D * table.energy[c, c].ravel() for D, c in zip(rigidity, (x, y, z), strict=True)]
    parts = [
        [length],
        *own,
        np.zeros(total) if amplitudes is None else np.asarray(amplitudes, float),
        table.weight,
        table.integral.ravel(),
        table.basis.ravel(),
        C.ravel(),
        table.moments.ravel(),
    ]
    if table.plate is not None:
        parts.append(table.plate.ravel())
    if line_mass is not None:
        parts.append(length * (table.weight - table.integral) @ line_mass)
    return np.concatenate(parts).astype(float), np.array(
        [nx, ny, nz, ng, 0 if table.plate is None else len(table.plate), 0, 0], np.int64
    )


def strain_sizes(number: np.ndarray, *, has_weight: bool = False) -> tuple[int, int]:
    """Lengths of the inner state and of the `store` of one leaf; has_weight: with weight or other distributed loads."""
    total, modes = int(number[0] + number[1] + number[2]), max(int(number[5]), int(has_weight))
    pressure = max(modes - GIVEN_MODES, 0)
    store = 8 * total + 42 + 3 * total * modes + 3 * modes * (10 + 3 * modes)
    return total + 6 + 3 * pressure, store + (pressure > 0) * PRESSURE_STORE


def strain_value_count(number: np.ndarray, *, has_weight: bool = False) -> int:
    """Number of constants of a leaf; has_weight: with weight or other distributed loads."""
    nx, ny, nz, ng, plate = (int(n) for n in number[:5])
    N = nx + ny + nz
    own = 1 + nx * nx + ny * ny + nz * nz + N + ng * (1 + ng + N + 3)
    own += 3 * N * (ng + 1) + plate * (POINT_NUMBERS + nz)
    return own + has_weight * load_constants(ng, int(number[5]))


def load_constants(points: int, modes: int) -> int:
    """Number of the constants of the distributed loads of a leaf: of weight alone (no modes), or `load_tables`."""
    return points if modes == 0 else (points + 1) * modes + points * max(modes - GIVEN_MODES, 0)


def load_tables(
    points: np.ndarray,
    weight: np.ndarray,
    integral: np.ndarray,
    line_mass: np.ndarray,
    width: np.ndarray | None,
) -> np.ndarray:
    """Constants of the distributed loads of a leaf, flat: Q (points, modes), the integrals of the modes from every point to
    the end, c (modes,) those over the leaf, and, under pressure, the table (points, PRESSURE_MODES) of
    `ksd.elements.pressure`.

    points, weight (g,): places from 0 to 1 and lengths [m] of the quadrature; integral (g, g): those of the integrals from
    0; line_mass (g,) [kg/m]; width (g,) [m] under pressure, else None.
    """
    shapes = [line_mass, np.ones(len(points)), points]
    table = np.zeros((len(points), 0))
    if width is not None:
        P = orthogonal_modes(points, weight * width, PRESSURE_MODES)
        shapes += list((width[:, None] * P).T)
        table = (weight * width)[:, None] * P
        table /= (table * P).sum(axis=0)
    modes = np.array(shapes).T
    return np.concatenate([((weight - integral) @ modes).ravel(), weight @ modes, table.ravel()])


def load_totals(value: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Integrals (k, modes) of the distributed loads over k leaves with `load_tables`; value (k, v)."""
    modes = int(number[5])
    at = strain_value_count(number) + int(number[3]) * modes
    return value[:, at : at + modes]


def loads_beyond(value: np.ndarray, number: np.ndarray) -> np.ndarray:
    """Integrals (ng, modes) of the distributed loads of a leaf between every quadrature point and end q: of weight its mass
    [kg], of line loads and pressure see `load_tables`."""
    at, modes = strain_value_count(number), max(int(number[5]), 1)
    return value[at : at + int(number[3]) * modes].reshape(-1, modes)
