"""Fits of sampled functions in product bases: monomials of the motions times Legendre products of the shape.

Total degrees are chosen by leave-one-out errors, in closed form from the projection onto the basis. A
function that is even or odd in a motion, or zero at rest, as measured over all samples, keeps only the terms
that are, so these properties hold exactly.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ksd.library.functions import Array, legendre_products, monomials

EXACT = 1e-8
"""Below this a sampled symmetry, or a sampled function, counts as exact; solves are converged far below."""
DIGITS = 10
"""Decimals kept of every coefficient."""


@dataclass(frozen=True)
class Fit:
    """powers (M, m + s), coefficients (rows, M), degrees chosen, leave-one-out rms errors over tolerance."""

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
    """(M, variables): all exponents whose sum is at most `degree`, in rising order of the sum."""
    found = [p for p in itertools.product(range(degree + 1), repeat=variables) if sum(p) <= degree]
    found.sort(key=lambda p: (sum(p), p))
    return np.array(found, np.int64).reshape(len(found), variables)


def fit_functions(
    values: Array, grid: Array, places: Array, *, tolerance: Array, degrees: tuple[int, int] = (12, 12)
) -> Fit:
    """Fit values (k, g, rows), sampled at motions grid (g, m) over their reach and shapes places (k, s) in
    [-1, 1].

    tolerance (rows,): wanted rms error. degrees: largest total degrees tried, motions and shape; the smallest
    whose leave-one-out error is within tolerance is taken, else the one with the least.
    """
    classes = _classes(values, grid)
    motion_degree, motion_error = _motion_degree(values, grid, classes, tolerance, degrees[0])
    powers = exponents_up_to(grid.shape[1], motion_degree)
    by_shape, basis = _motion_fit(values, grid, classes, powers)
    degree, shape_error = _shape_degree(by_shape, basis, places, tolerance, degrees[1])
    terms = exponents_up_to(places.shape[1], degree)
    table = np.linalg.pinv(legendre_products(terms, places))
    both = np.einsum("qk,kpr->rpq", table, by_shape)
    every = np.array([[*p, *t] for p in powers for t in terms], np.int64).reshape(
        -1, grid.shape[1] + places.shape[1]
    )
    coefficients = np.round(both.reshape(len(both), -1), DIGITS) + 0.0
    used = np.any(coefficients != 0.0, axis=0)
    return Fit(every[used], coefficients[:, used], motion_degree, degree, motion_error, shape_error)


def _classes(values: Array, grid: Array) -> NDArray[np.int64]:
    """(rows, m + 1): per motion 0 even, 1 odd, 2 neither; last 1 if zero at rest, 2 if zero everywhere."""
    found = np.full((values.shape[2], grid.shape[1] + 1), 2, np.int64)
    for j in range(grid.shape[1]):
        mirrored = grid.copy()
        mirrored[:, j] *= -1
        distance = np.abs(mirrored[:, None] - grid[None]).max(axis=2)
        other = distance.argmin(axis=1)
        if distance.min(axis=1).max() > 1e-12:
            continue
        for parity, sign in ((1, -1.0), (0, 1.0)):
            same = np.abs(values - sign * values[:, other]).max(axis=(0, 1)) < EXACT
            found[same, j] = parity
    rest = np.linalg.norm(grid, axis=1) < 1e-12
    found[:, -1] = 0
    if rest.any():
        found[np.abs(values[:, rest]).max(axis=(0, 1)) < EXACT, -1] = 1
    found[np.abs(values).max(axis=(0, 1)) < EXACT, -1] = 2
    return found


def _allowed(kind: Array, powers: NDArray[np.int64]) -> NDArray[np.bool_]:
    """(M,): the powers a class of functions may have."""
    if kind[-1] == 2:
        return np.zeros(len(powers), bool)
    keep = np.ones(len(powers), bool)
    for j, parity in enumerate(kind[:-1]):
        if parity != 2:
            keep &= powers[:, j] % 2 == parity
    if kind[-1] == 1:
        keep &= powers.sum(axis=1) > 0
    return keep


def _motion_degree(
    values: Array, grid: Array, classes: NDArray[np.int64], tolerance: Array, most: int
) -> tuple[int, float]:
    """Smallest total degree within tolerance when any one grid point is left out, and its error over
    tolerance.
    """
    errors = []
    for degree in range(1, most + 1):
        powers = exponents_up_to(grid.shape[1], degree)
        if len(powers) > 0.7 * len(grid):
            break
        basis = monomials(powers, grid)
        worst = 0.0
        for kind in np.unique(classes, axis=0):
            rows = np.all(classes == kind, axis=1)
            keep = _allowed(kind, powers)
            if keep.any():
                left = _leave_one_out(basis[:, keep], values[:, :, rows])
                worst = max(worst, float((np.sqrt(np.mean(left**2, axis=(0, 1))) / tolerance[rows]).max()))
        errors.append(worst)
        if worst <= 1.0:
            break
    best = int(np.argmin(errors))
    return best + 1, errors[best]


def _leave_one_out(basis: Array, values: Array) -> Array:
    """Residuals (k, g, rows) of the fit over 1 - (mean h): generalised, since a sweep always has its end
    points.
    """
    q, _ = np.linalg.qr(basis)
    left = values - np.einsum("gq,hq,khr->kgr", q, q, values, optimize=True)
    return np.asarray(left / (1.0 - basis.shape[1] / basis.shape[0]))


def _motion_fit(
    values: Array, grid: Array, classes: NDArray[np.int64], powers: NDArray[np.int64]
) -> tuple[Array, Array]:
    """Coefficients (k, powers, rows) at every shape, and the basis (g, powers)."""
    basis = monomials(powers, grid)
    found = np.zeros((len(values), len(powers), values.shape[2]))
    for kind in np.unique(classes, axis=0):
        rows = np.flatnonzero(np.all(classes == kind, axis=1))
        keep = np.flatnonzero(_allowed(kind, powers))
        if len(keep):
            solve = np.linalg.pinv(basis[:, keep])
            found[:, keep[:, None], rows] = np.einsum("pg,kgr->kpr", solve, values[:, :, rows])
    return found, basis


def _shape_degree(
    by_shape: Array, basis: Array, places: Array, tolerance: Array, most: int
) -> tuple[int, float]:
    """Smallest total degree within tolerance when any one shape is left out, and its error over tolerance."""
    if places.shape[1] == 0 or len(places) == 1:
        return 0, 0.0
    gram = basis.T @ basis / len(basis)
    errors = []
    for degree in range(most + 1):
        terms = exponents_up_to(places.shape[1], degree)
        if len(terms) > 0.6 * len(places):
            break
        q, _ = np.linalg.qr(legendre_products(terms, places))
        slack = np.maximum(1.0 - np.sum(q**2, axis=1), 1e-3)
        left = (by_shape - np.einsum("kq,lq,lpr->kpr", q, q, by_shape, optimize=True)) / slack[:, None, None]
        square = np.einsum("kpr,po,kor->r", left, gram, left, optimize=True) / len(places)
        errors.append(float((np.sqrt(np.maximum(square, 0.0)) / tolerance).max()))
        if errors[-1] <= 1.0:
            break
    best = int(np.argmin(errors))
    return best, errors[best]
