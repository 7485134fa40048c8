"""Bases as pure numerics, on a small polynomial energy whose tangent and its derivative are known exactly."""

import numpy as np
import pytest

from ksd.numerics.reduction import (
    Modes,
    condition_basis,
    craig_bampton,
    modal_derivatives,
    second_derivatives,
    split_boundary,
    tangent_derivative,
)

pytestmark = pytest.mark.plain

N, BOUNDARY, INNER = 7, [5, 6], [0, 1, 2, 3, 4]
RNG = np.random.default_rng(3)
_root = RNG.normal(size=(N, N))
K2 = _root @ _root.T + N * np.eye(N)
_raw = RNG.normal(size=(N, N, N))
K3 = sum(_raw.transpose(p) for p in ((0, 1, 2), (0, 2, 1), (1, 0, 2), (1, 2, 0), (2, 0, 1), (2, 1, 0)))
V = RNG.normal(size=(4, N))


def gradient(q):
    """Of q K2 q/2 + K3 qqq/6 + sum (v.q)^4/24."""
    return K2 @ q + 0.5 * np.einsum("ijk,j,k", K3, q, q) + ((V @ q) ** 3 / 6) @ V


def tangent(q):
    return K2 + K3 @ q + (V.T * (0.5 * (V @ q) ** 2)) @ V


def static(boundary):
    """Inner coordinates in equilibrium with given boundary ones."""
    q = np.zeros(N)
    q[BOUNDARY] = boundary
    for _ in range(40):
        q[INNER] -= np.linalg.solve(tangent(q)[np.ix_(INNER, INNER)], gradient(q)[INNER])
    return q


def path(modes, derived, eta):
    """The static path summed to the order of the derivatives, factors 1/2 and 1/6 as the module states."""
    q = modes.shapes @ eta
    for key, shape in zip(derived.pairs, derived.shapes.T, strict=True):
        count = {2: 2, 3: {1: 1, 2: 3, 3: 6}[len(set(key))]}[len(key)]
        if len(key) == 2 and key[0] == key[1]:
            count = 1
        q = q + count / {2: 2, 3: 6}[len(key)] * shape * np.prod(eta[list(key)])
    return q


def test_derivatives_by_differences_and_analytic_agree():
    modes = craig_bampton(K2, BOUNDARY, INNER, M=np.eye(N), internal=2)
    one = modal_derivatives(tangent, modes, INNER)
    two = modal_derivatives(tangent, modes, INNER, analytic=lambda v: K3 @ v)
    assert np.abs(one.shapes - two.shapes).max() < 1e-9 * np.abs(two.shapes).max()
    direction = RNG.normal(size=N)
    assert tangent_derivative(tangent, direction, step=1e-3) == pytest.approx(K3 @ direction, abs=1e-8)


@pytest.mark.parametrize("order", [2, 3])
def test_path_with_its_factors_follows_the_static_solution(order):
    """With the factor 1/2 the error of the path is of order + 1; without it, of second order."""
    modes = craig_bampton(K2, BOUNDARY, INNER)
    derived = modal_derivatives(tangent, modes, INNER, order=order)
    eta = np.array([0.3, -0.2])
    wrong = [np.abs(path(modes, derived, s * eta) - static(s * eta)).max() for s in (0.5, 0.25)]
    assert np.log2(wrong[0] / wrong[1]) == pytest.approx(order + 1, abs=0.3)
    twice = modes.shapes @ eta + (path(modes, derived, eta) - modes.shapes @ eta) * 2
    assert np.abs(twice - static(eta)).max() > 5 * np.abs(path(modes, derived, eta) - static(eta)).max()


def test_quadratic_manifold():
    """The manifold is the path to second order, of derivatives of second and of third order alike."""
    modes, eta = craig_bampton(K2, BOUNDARY, INNER), np.array([0.3, -0.2])
    derived, more = (modal_derivatives(tangent, modes, INNER, order=order) for order in (2, 3))
    theta = second_derivatives(modes, derived)
    q = modes.shapes @ eta + 0.5 * np.einsum("ijn,i,j->n", theta, eta, eta)
    assert q == pytest.approx(path(modes, derived, eta))
    assert second_derivatives(modes, more) == pytest.approx(theta)


def test_craig_bampton_modes():
    modes = craig_bampton(K2, BOUNDARY, INNER, M=np.eye(N), internal=3)
    ii = np.ix_(INNER, INNER)
    assert modes.boundary == 2
    assert modes.shapes[np.ix_(BOUNDARY, [0, 1])] == pytest.approx(np.eye(2))
    assert (K2 @ modes.shapes[:, :2])[INNER] == pytest.approx(0, abs=1e-12)
    assert modes.omega**2 == pytest.approx(np.linalg.eigvalsh(K2[ii])[:3])
    with pytest.raises(ValueError, match="mass matrix"):
        craig_bampton(K2, BOUNDARY, INNER, internal=1)
    loose = K2.copy()
    loose[0], loose[:, 0] = 0.0, 0.0
    with pytest.raises(ValueError, match="can move freely"):
        craig_bampton(loose, BOUNDARY, INNER)


def test_sparse_matrices_give_the_same():
    from scipy.sparse import csr_matrix

    dense = craig_bampton(K2, BOUNDARY, INNER, M=np.eye(N), internal=2)
    sparse = craig_bampton(csr_matrix(K2), BOUNDARY, INNER, M=csr_matrix(np.eye(N)), internal=2)
    assert np.abs(sparse.shapes) == pytest.approx(np.abs(dense.shapes), abs=1e-9)
    modes = Modes(dense.shapes, 2, dense.omega)
    a = modal_derivatives(tangent, modes, INNER)
    b = modal_derivatives(lambda q: csr_matrix(tangent(q)), modes, INNER)
    assert b.shapes == pytest.approx(a.shapes, abs=1e-8)


def test_conditioning_drops_what_says_nothing():
    columns = np.column_stack(
        [1e6 * np.eye(6)[0], np.eye(6)[1], np.zeros(6), np.eye(6)[0] * 1e-3 + np.eye(6)[1]]
    )
    found = condition_basis(columns)
    assert found.rank == 2
    assert found.columns.T @ found.columns == pytest.approx(np.eye(2), abs=1e-12)
    edge, rest = split_boundary(RNG.normal(size=(N, 5)), BOUNDARY)
    assert edge[BOUNDARY] == pytest.approx(np.eye(2))
    assert rest.shape == (N, 3)
    assert rest[BOUNDARY] == pytest.approx(0, abs=1e-12)


def test_units_of_the_coordinates_change_nothing():
    """m beside um and km: the same modes, and no mechanism is seen."""
    unit = 10.0 ** np.array([6, -6, 0, 3, -3, 0, 0])
    modes = craig_bampton(K2, BOUNDARY, INNER)
    scaled = craig_bampton(unit[:, None] * K2 * unit, BOUNDARY, INNER)
    assert unit[:, None] * scaled.shapes == pytest.approx(modes.shapes, rel=1e-9)
    assert modes.omega.shape == (0,)
    inside = craig_bampton(K2, [], INNER, M=np.eye(N), internal=2)
    assert inside.boundary == 0 and inside.shapes.shape == (N, 2)
    assert modal_derivatives(tangent, modes, INNER, analytic=lambda v: 2 * K3 @ v).shapes == pytest.approx(
        2 * modal_derivatives(tangent, modes, INNER).shapes, rel=1e-7, abs=1e-9
    )


def test_a_basis_is_orthonormal_in_scaled_coordinates():
    columns, scale = RNG.normal(size=(N, 3)), 10.0 ** RNG.uniform(-3, 3, N)
    columns = np.column_stack([columns * scale[:, None], np.zeros(N), columns[:, 0] * scale])
    found = condition_basis(columns, scale=scale)
    scaled = found.columns / scale[:, None]
    assert found.rank == 3 and scaled.T @ scaled == pytest.approx(np.eye(3), abs=1e-12)
    kept = columns[:, :3] / scale[:, None]
    assert scaled @ (scaled.T @ kept) == pytest.approx(kept, abs=1e-12)
    unit = columns[:, [0, 1, 2, 4]] / scale[:, None]
    values = np.linalg.svd(unit / np.linalg.norm(unit, axis=0), compute_uv=False)
    assert found.condition == pytest.approx(values[0] / values[2])
    nothing = condition_basis(np.zeros((N, 2)))
    assert nothing.columns.shape == (N, 0) and (nothing.rank, nothing.condition) == (0, 1.0)


def test_boundary_values_that_hang_together():
    """Two rows in one proportion in every column, and a column of zeros: one coordinate at the boundary is left."""
    columns = np.column_stack([RNG.normal(size=(N, 4)), np.zeros(N)])
    columns[6] = 0.5 * columns[5]
    edge, rest = split_boundary(columns, BOUNDARY)
    along = np.array([1.0, 0.5]) / np.hypot(1.0, 0.5)
    assert edge[BOUNDARY] == pytest.approx(np.outer(along, along), abs=1e-12)
    assert rest.shape == (N, 3)
    assert rest[BOUNDARY] == pytest.approx(0, abs=1e-12)
    assert np.linalg.matrix_rank(np.column_stack([edge, rest])) == 4
