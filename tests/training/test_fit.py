"""Fits recover what they are made of, keep measured symmetries exactly, and choose their degrees."""

import numpy as np
import pytest

from ksd.library.functions import legendre_products, monomials
from ksd.training.fit import _leave_one_out, _shape_degree, exponents_up_to, fit_functions


def sampled(function, shapes=40, seed=0):
    grid = np.cos(np.pi * np.arange(25) / 24)[:, None]
    places = np.random.default_rng(seed).uniform(-1, 1, (shapes, 2))
    values = np.array([[function(t, *s) for t in grid[:, 0]] for s in places])
    return values, grid, places


def evaluate(fit, grid, places):
    basis = legendre_products(fit.powers[:, 1:], places)
    return np.stack([(monomials(fit.powers[:, :1], grid) * row) @ fit.coefficients.T for row in basis])


def test_total_degree_counts():
    assert len(exponents_up_to(2, 3)) == 10 and len(exponents_up_to(3, 2)) == 10
    np.testing.assert_array_equal(exponents_up_to(0, 4), np.zeros((1, 0)))
    np.testing.assert_array_equal(exponents_up_to(1, 2), [[0], [1], [2]])


def test_polynomials_are_recovered_with_their_degrees():
    values, grid, places = sampled(lambda t, a, b: [1 + a * t**2, t**3 * (1 + 0.5 * a * b), 0.0])
    fit = fit_functions(values, grid, places, tolerance=np.full(3, 1e-9))
    assert (fit.motion_degree, fit.shape_degree) == (3, 2) and fit.converged
    np.testing.assert_allclose(evaluate(fit, grid, places), values, atol=1e-9)
    assert not fit.coefficients[2].any()


def test_measured_symmetry_and_rest_hold_exactly():
    values, grid, places = sampled(
        lambda t, a, b: [np.cos(t * (1 + 0.2 * a)), np.sin(t * (1 + 0.2 * b)), np.expm1(t)]
    )
    fit = fit_functions(values, grid, places, tolerance=np.full(3, 1e-6))
    odd = fit.powers[:, 0] % 2 == 1
    assert not fit.coefficients[0, odd].any() and not fit.coefficients[1, ~odd].any()
    assert not fit.coefficients[2, fit.powers[:, 0] == 0].any()
    fresh = np.random.default_rng(9).uniform(-1, 1, (5, 2))
    truth = [np.cos(0.5 * (1 + 0.2 * a)) for a, _ in fresh]
    np.testing.assert_allclose(evaluate(fit, np.array([[0.5]]), fresh)[:, 0, 0], truth, atol=1e-5)


def test_too_few_shapes_are_reported_not_hidden():
    values, grid, places = sampled(lambda t, a, b: [t * np.exp(2 * a - b)], shapes=10)
    fit = fit_functions(values, grid, places, tolerance=np.full(1, 1e-6))
    assert fit.shape_error > 100 and not fit.converged


def test_two_motions_and_no_shape():
    line = np.cos(np.pi * np.arange(9) / 8)
    grid = np.stack(np.meshgrid(line, line, indexing="ij"), axis=-1).reshape(-1, 2)
    values = np.stack([grid[:, 0] * grid[:, 1], grid[:, 0] ** 2 + grid[:, 1], grid[:, 1] ** 3], axis=-1)[None]
    fit = fit_functions(values, grid, np.zeros((1, 0)), tolerance=np.full(3, 1e-9))
    found = monomials(fit.powers, grid) @ fit.coefficients.T
    np.testing.assert_allclose(found, values[0], atol=1e-9)
    assert len(fit.powers) == 4


def refitted_without_each(basis, values):
    """(k, rows): errors at every point of fits that have not seen it."""
    left = []
    for i in range(len(basis)):
        seen = np.delete(np.arange(len(basis)), i)
        solution = np.linalg.lstsq(basis[seen], values[seen], rcond=None)[0]
        left.append(values[i] - basis[i] @ solution)
    return np.array(left)


def test_motion_errors_are_those_of_fits_that_left_a_point_out():
    """On points that weigh alike, where the generalised form is exact."""
    t = 2 * np.pi * np.arange(12) / 12
    basis = np.stack([np.ones(12), np.cos(t), np.sin(t), np.cos(2 * t), np.sin(2 * t)], axis=1)
    values = np.random.default_rng(3).standard_normal((2, 12, 3))
    for found, of_shape in zip(_leave_one_out(basis, values), values, strict=True):
        np.testing.assert_allclose(found, refitted_without_each(basis, of_shape), atol=1e-12)


def test_shape_errors_are_those_of_fits_that_left_a_shape_out(monkeypatch):
    monkeypatch.setattr("ksd.training.fit.MAX_DEGREE", 2)
    rng = np.random.default_rng(4)
    places = rng.uniform(-1, 1, (30, 2))
    values = 1 + places[:, 0] * places[:, 1] + 0.01 * rng.standard_normal(30)
    degree, error = _shape_degree(values[:, None, None], np.ones((1, 1)), places, np.full(1, 1e-9))
    left = refitted_without_each(legendre_products(exponents_up_to(2, 2), places), values)
    assert degree == 2 and 1e-9 * error == pytest.approx(np.sqrt(np.mean(left**2)), rel=1e-9)
