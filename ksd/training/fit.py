"""Fits of sampled functions in product bases: monomials of the motions times Legendre products of the shape.

Total degrees are chosen by leave-one-out errors, in closed form from the projection onto the basis. A function that is
even or odd in a motion, or zero at rest, as measured over all samples, has only such terms, so these properties hold
exactly.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ksd.library import Residual
from ksd.library.functions import Array, legendre_products, monomials

TOLERANCE = {"interface": 8e-7, "blocks": 8e-7, "rotations": 4e-6, "amplitudes": 8e-6, "wrench": 2e-4}
"""Wanted leave-one-out rms errors by group; units as in `ksd.library.Residual`."""
REFUSED_MISS = 100.0
"""Errors over those of TOLERANCE above which a record is refused."""
ZERO_TOLERANCE = 1e-8
"""Samples below this count as zero in tests for symmetries and vanishing functions; solves are converged far below."""
MAX_DEGREE = 12
"""Largest total degree tried, of motions and of shape."""
DECIMALS = 10
"""Decimals of every stored coefficient."""


@dataclass(frozen=True)
class Fit:
    """A fit of functions (rows) of m motions and s shape parameters: powers (M, m + s) and coefficients (rows, M).

    motion_degree, shape_degree: its total degrees; motion_error, shape_error: leave-one-out rms errors over tolerance.
    """

    powers: NDArray[np.int64]
    coefficients: Array
    motion_degree: int
    shape_degree: int
    motion_error: float
    shape_error: float

    @property
    def converged(self) -> bool:
        """Whether both leave-one-out errors are within tolerance."""
        return max(self.motion_error, self.shape_error) <= 1.0


def exponents_up_to(variables: int, degree: int) -> NDArray[np.int64]:
    """All exponents (M, variables) whose sum is at most `degree`, by increasing sum."""
    exponents = [p for p in itertools.product(range(degree + 1), repeat=variables) if sum(p) <= degree]
    exponents.sort(key=lambda p: (sum(p), p))
    return np.array(exponents, np.int64).reshape(len(exponents), variables)


def fit_functions(values: Array, grid: Array, places: Array, *, tolerance: Array) -> Fit:
    """Fit values (k, g, rows), sampled at motions grid (g, m) and shapes places (k, s) in [-1, 1].

    grid: each motion over its largest magnitude. tolerance (rows,): wanted rms error. Of the total degrees up to
    MAX_DEGREE, of motions and of shape, the smallest with a leave-one-out error within tolerance is taken, else that with
    the smallest error.
    """
    classes = _symmetry_classes(values, grid)
    motion_degree, motion_error = _motion_degree(values, grid, classes, tolerance)
    powers = exponents_up_to(grid.shape[1], motion_degree)
    by_shape, basis = _motion_fit(values, grid, classes, powers)
    degree, shape_error = _shape_degree(by_shape, basis, places, tolerance)
    terms = exponents_up_to(places.shape[1], degree)
    solve = np.linalg.pinv(legendre_products(terms, places))
    products = np.einsum("qk,kpr->rpq", solve, by_shape)
    powers_of_terms = np.array([[*p, *t] for p in powers for t in terms], np.int64)
    coefficients = np.round(products.reshape(len(products), -1), DECIMALS) + 0.0
    used = np.any(coefficients != 0.0, axis=0)
    return Fit(powers_of_terms[used], coefficients[:, used], motion_degree, degree, motion_error, shape_error)


def _symmetry_classes(values: Array, grid: Array) -> NDArray[np.int64]:
    """(rows, m + 1): per motion 0 even, 1 odd, 2 neither; last column 1 where zero at rest, 2 where zero everywhere."""
    classes = np.full((values.shape[2], grid.shape[1] + 1), 2, np.int64)
    for j in range(grid.shape[1]):
        mirrored = grid.copy()
        mirrored[:, j] *= -1
        distance = np.abs(mirrored[:, None] - grid[None]).max(axis=2)
        mirror_point = distance.argmin(axis=1)
        if distance.min(axis=1).max() > 1e-12:
            continue
        for parity, sign in ((1, -1.0), (0, 1.0)):
            same = np.abs(values - sign * values[:, mirror_point]).max(axis=(0, 1)) < ZERO_TOLERANCE
            classes[same, j] = parity
    rest = np.linalg.norm(grid, axis=1) < 1e-12
    classes[:, -1] = 0
    if rest.any():
        classes[np.abs(values[:, rest]).max(axis=(0, 1)) < ZERO_TOLERANCE, -1] = 1
    classes[np.abs(values).max(axis=(0, 1)) < ZERO_TOLERANCE, -1] = 2
    return classes


def _allowed_powers(symmetry: Array, powers: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Mask (M,) of the powers that functions of a symmetry class can have."""
    if symmetry[-1] == 2:
        return np.zeros(len(powers), bool)
    allowed = np.ones(len(powers), bool)
    for j, parity in enumerate(symmetry[:-1]):
        if parity != 2:
            allowed &= powers[:, j] % 2 == parity
    if symmetry[-1] == 1:
        allowed &= powers.sum(axis=1) > 0
    return allowed


def _motion_degree(
    values: Array, grid: Array, classes: NDArray[np.int64], tolerance: Array
) -> tuple[int, float]:
    """Smallest total degree within tolerance when any one grid point is left out, and its error over tolerance."""
    errors = []
    for degree in range(1, MAX_DEGREE + 1):
        powers = exponents_up_to(grid.shape[1], degree)
        if len(powers) > 0.7 * len(grid):
            break
        basis = monomials(powers, grid)
        worst = 0.0
        for symmetry in np.unique(classes, axis=0):
            rows = np.all(classes == symmetry, axis=1)
            allowed = _allowed_powers(symmetry, powers)
            if allowed.any():
                residuals = _leave_one_out(basis[:, allowed], values[:, :, rows])
                worst = max(
                    worst, float((np.sqrt(np.mean(residuals**2, axis=(0, 1))) / tolerance[rows]).max())
                )
        errors.append(worst)
        if worst <= 1.0:
            break
    best = int(np.argmin(errors))
    return best + 1, errors[best]


def _leave_one_out(basis: Array, values: Array) -> Array:
    """Leave-one-out residuals of values (k, g, rows) fitted by basis (g, powers) over the grid points.

    All points have the mean leverage (generalised cross-validation), since a sweep always includes its end points.
    """
    q, _ = np.linalg.qr(basis)
    residuals = values - np.einsum("gq,hq,khr->kgr", q, q, values, optimize=True)
    return np.asarray(residuals / (1.0 - basis.shape[1] / basis.shape[0]))


def _motion_fit(
    values: Array, grid: Array, classes: NDArray[np.int64], powers: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Coefficients (k, powers, rows) that fit values (k, g, rows) at each of k shapes, and the basis (g, powers)."""
    basis = monomials(powers, grid)
    coefficients = np.zeros((len(values), len(powers), values.shape[2]))
    for symmetry in np.unique(classes, axis=0):
        rows = np.flatnonzero(np.all(classes == symmetry, axis=1))
        allowed = np.flatnonzero(_allowed_powers(symmetry, powers))
        if len(allowed):
            solve = np.linalg.pinv(basis[:, allowed])
            coefficients[:, allowed[:, None], rows] = np.einsum("pg,kgr->kpr", solve, values[:, :, rows])
    return coefficients, basis


def _shape_degree(by_shape: Array, basis: Array, places: Array, tolerance: Array) -> tuple[int, float]:
    """Smallest total degree within tolerance when any one shape is left out, and its error over tolerance."""
    if places.shape[1] == 0 or len(places) == 1:
        return 0, 0.0
    gram = basis.T @ basis / len(basis)
    errors = []
    for degree in range(MAX_DEGREE + 1):
        terms = exponents_up_to(places.shape[1], degree)
        if len(terms) > 0.6 * len(places):
            break
        q, _ = np.linalg.qr(legendre_products(terms, places))
        one_minus_leverage = np.maximum(1.0 - np.sum(q**2, axis=1), 1e-3)
        residuals = (
            by_shape - np.einsum("kq,lq,lpr->kpr", q, q, by_shape, optimize=True)
        ) / one_minus_leverage[:, None, None]
        mean_square = np.einsum("kpr,po,kor->r", residuals, gram, residuals, optimize=True) / len(places)
        errors.append(float((np.sqrt(np.maximum(mean_square, 0.0)) / tolerance).max()))
        if errors[-1] <= 1.0:
            break
    best = int(np.argmin(errors))
    return best, errors[best]


def missed_errors(residuals: Iterable[Residual], factor: float) -> tuple[float, float]:
    """Largest rms error over `factor` times the wanted ones: of the fitted shapes, and of fresh shapes too."""
    fitted = missed = 0.0
    for r in residuals:
        wanted = factor * TOLERANCE[r.group]
        fitted, missed = (
            max(fitted, r.fit_rms / wanted),
            max(missed, r.fit_rms / wanted, r.fresh_rms / wanted),
        )
    return fitted, missed
