"""Block factorisation with constraint rows: solution, inertia and refinement, where the order without pivots decides."""

from fractions import Fraction

import numpy as np
import pytest

from ksd.numerics.blocks import (
    backward_blocks,
    factor_blocks,
    forward_blocks,
    plan_blocks,
    residual_blocks,
    solve_blocks,
    solve_refined,
)
from ksd.numerics.elimination import solve_small
from ksd.numerics.indefinite import equilibration, negative_inertia, solve_scaled

pytestmark = pytest.mark.plain

SOFT, STIFF = 0.3, 1e8


def spring(rng, free):
    """A semidefinite (6, 6) stiffness: `free` soft directions, the others stiff."""
    Q = np.linalg.qr(rng.normal(size=(6, 6)))[0]
    return (Q * np.where(np.arange(6) < free, SOFT, STIFF)) @ Q.T, Q[:, :free].T


def chain(rng, joints=3, free=2, loose=False):
    """Nodes in a chain from ground; every joint leaves `free` directions, held by a row each. With `loose`, a last node that
    six rows alone hold. Returns the plan, its values, and the whole matrix in the order of the plan."""
    nodes = joints + loose
    rows = joints * free + 6 * loose
    size = np.array([6] * nodes + [1] * rows)
    whole, pairs = np.zeros((6 * nodes + rows,) * 2), []
    row = 0
    for k in range(joints + loose):
        K, directions = spring(rng, free) if k < joints else (np.zeros((6, 6)), np.eye(6))
        J = np.hstack([-np.eye(6), np.eye(6)]) if k else np.eye(6)
        at = np.arange(6 * max(k - 1, 0), 6 * k + 6)
        whole[np.ix_(at, at)] += J.T @ K @ J
        if k:
            pairs.append((k - 1, k))
        for direction in directions:
            here = 6 * nodes + row
            whole[here, at] = whole[at, here] = direction @ J
            pairs += [(k, nodes + row)] + [(k - 1, nodes + row)] * bool(k)
            row += 1
    plan, position, offsets = plan_blocks(size, pairs, waits=np.arange(len(size)) >= nodes)
    first = np.concatenate([[0], np.cumsum(size)])
    order = np.concatenate([np.arange(first[k], first[k + 1]) for k in np.argsort(position)])
    whole, value = whole[np.ix_(order, order)], np.zeros(plan.values)
    for (i, j), to in offsets.items():
        block = whole[plan.start[i] : plan.start[i + 1], plan.start[j] : plan.start[j + 1]]
        value[to : to + block.size] = block.ravel()
    return plan, value, whole, len(whole) - 6 * nodes


@pytest.mark.parametrize("free", [1, 2, 3])
@pytest.mark.parametrize("loose", [False, True])
@pytest.mark.parametrize("joints", [1, 3, 6])
def test_every_joint_of_a_chain_is_held_by_rows(joints, free, loose, rng):
    plan, value, whole, rows = chain(rng, joints, free, loose)
    stored, spare, right = value.copy(), np.zeros_like(value), rng.normal(size=len(whole))
    negatives, pivot = factor_blocks(plan.ints, value, spare, len(plan.size))
    assert negatives == rows and pivot > 1e-10
    scale = 1.0 / np.sqrt(np.abs(whole).max(axis=1))
    exact = scale * np.linalg.solve(whole * np.outer(scale, scale), scale * right)
    x, change, low = right.copy(), np.empty_like(right), np.empty_like(right)
    solve_blocks(plan.ints, value, spare, x)
    assert x == pytest.approx(exact, rel=1e-6, abs=1e-7 * np.abs(exact).max())
    assert solve_refined(plan.ints, stored, value, spare, right, x, change, low) < 1e-9
    # the softness of a row is what its neighbours in other joints do not give
    for i in plan.start[plan.rows]:
        unit = np.eye(len(whole))[i]
        solve_refined(plan.ints, stored, value, spare, unit, x, change, low)
        if abs(x[i]) > 1e-3:
            assert x[i] == pytest.approx(-SOFT, rel=1e-6)


def test_inertia_is_that_of_the_matrix_with_pivoting(rng):
    for _ in range(20):
        plan, value, whole, rows = chain(rng, 4, 2)
        for k in plan.diagonal[np.flatnonzero(plan.size == 6)]:
            value[k + 7 * int(rng.integers(6))] -= STIFF * rng.uniform(0.0, 1.0)
        matrix, none = np.zeros_like(whole), np.zeros(len(whole))
        for unit, column in zip(-np.eye(len(whole)), matrix, strict=True):
            residual_blocks(plan.ints, value, none, unit, column, np.empty(len(whole)))
        assert matrix == pytest.approx(matrix.T)
        negatives, _ = factor_blocks(plan.ints, value, np.zeros_like(value), len(plan.size))
        assert negatives == negative_inertia(matrix) >= rows


@pytest.mark.parametrize("share", [1e-9, 1e-6, 1e-3, 1.0])
def test_a_node_pushed_over_that_rows_hold(share, rng):
    """Geometric stiffness makes the diagonal entry that a row acts on negative; held, it is stable."""
    plan, value, _, rows = chain(rng, 2, 1)
    node, to = int(plan.node[plan.first_node[0]]), int(plan.lever[plan.first_node[0]])
    value[to : to + 6] = np.eye(6)[0]
    at = plan.diagonal[node]
    value[at : at + 6] = value[at : at + 36 : 6] = 0.0
    value[at] = -share * STIFF
    negatives, pivot = factor_blocks(plan.ints, value, np.zeros_like(value), len(plan.size))
    assert pivot > 1e-10
    assert negatives >= rows


def test_rows_that_say_the_same_are_told(rng):
    plan, value, _, _ = chain(rng, 1, 2)
    one, two = plan.lever[:2]
    value[two : two + 6] = value[one : one + 6]
    _, pivot = factor_blocks(plan.ints, value, np.zeros_like(value), len(plan.size))
    assert pivot < 1e-12


@pytest.mark.parametrize(("noise", "lost"), [(1e-9, False), (0.5, True)])
def test_lost_digits_are_told(noise, lost, rng):
    """Refinement mends factors that are slightly wrong, and tells of those that are no factors of the matrix."""
    plan, value, whole, _ = chain(rng, 2, 1)
    stored, spare = value.copy(), np.zeros_like(value)
    factor_blocks(plan.ints, value, spare, len(plan.size))
    value *= 1.0 + noise * rng.normal(size=value.shape)
    right = rng.normal(size=len(whole))
    x, change, low = (np.empty(len(whole)) for _ in range(3))
    error = solve_refined(plan.ints, stored, value, spare, right, x, change, low)
    assert error > 1e-3 if lost else error < 1e-12


def nodes(rng, count, more, last, shift=0.0):
    """A random matrix of nodes in a loop with `more` couplings: plan, values, the matrix in its order."""
    pairs = [(k, (k + 1) % count) for k in range(count)]
    pairs += [tuple(rng.choice(count, 2, replace=False)) for _ in range(more)]
    plan, position, offsets = plan_blocks(np.full(count, 6), pairs, last=last)
    whole = np.zeros((6 * count, 6 * count))
    for a, b in pairs:
        block = rng.normal(size=(6, 6))
        i, j = (slice(6 * position[k], 6 * position[k] + 6) for k in (a, b))
        whole[i, j] += block
        whole[j, i] += block.T
    whole += 40.0 * np.eye(6 * count) - shift * np.diag(rng.uniform(size=6 * count) > 0.7)
    value = np.zeros(plan.values)
    for (i, j), at in offsets.items():
        value[at : at + 36] = whole[6 * i : 6 * i + 6, 6 * j : 6 * j + 6].ravel()
    return plan, value, whole


@pytest.mark.parametrize(("count", "more", "last"), [(3, 0, 1), (8, 3, 2), (15, 6, 1), (6, 9, 0)])
@pytest.mark.parametrize("shift", [0.0, 80.0])
def test_condensation_onto_the_last_nodes(count, more, last, shift, rng):
    """Schur complement, condensed right-hand side, inertia and what is recovered, against numpy."""
    plan, value, whole = nodes(rng, count, more, last, shift)
    stop, cut = count - last, 6 * (count - last)
    spare, right = np.zeros_like(value), rng.normal(size=6 * count)
    x = right.copy()
    negatives, pivot = factor_blocks(plan.ints, value, spare, stop)
    A, B, C = whole[:cut, :cut], whole[:cut, cut:], whole[cut:, cut:]
    assert negatives == np.sum(np.linalg.eigvalsh(A) < 0) and pivot > 1e-4
    left = C - B.T @ np.linalg.solve(A, B)
    for j in range(last):
        at, here = plan.diagonal[stop + j], slice(6 * j, 6 * j + 6)
        found = np.tril(value[at : at + 36].reshape(6, 6))
        assert found == pytest.approx(np.tril(left[here, here]), abs=1e-10 * np.abs(left).max())
    forward_blocks(plan.ints, spare, x, stop)
    condensed = right[cut:] - B.T @ np.linalg.solve(A, right[:cut])
    assert x[cut:] == pytest.approx(condensed, abs=1e-10 * np.abs(x).max())
    x[cut:] = given = rng.normal(size=6 * last)
    backward_blocks(plan.ints, value, spare, x, stop)
    inside = np.linalg.solve(A, right[:cut] - B @ given)
    assert x[:cut] == pytest.approx(inside, abs=1e-10 * np.abs(inside).max())


def test_a_pivot_that_vanishes_is_told(rng):
    plan, value, _ = nodes(rng, 4, 0, 1)
    at = plan.diagonal[0]
    value[at : at + 36] = 0.0
    assert factor_blocks(plan.ints, value, np.zeros_like(value), 3) == (0, 0.0)


@pytest.mark.parametrize("unit", [1.0, 1e-9, 1e7])
def test_the_compliance_of_a_row_is_that_of_what_it_acts_on(unit, rng):
    """By the diagonal before elimination, doubled, and no less than a hundredth of the largest of its component."""
    plan, value, _, rows = chain(rng, 3, 2, loose=True)
    value *= unit
    for lever in plan.lever:
        value[lever : lever + 6] *= rng.uniform(0.5, 2.0, 6) / unit
    nodes = np.flatnonzero(plan.size == 6)
    diagonal = {k: np.abs(value[plan.diagonal[k] : plan.diagonal[k] + 36 : 7]) for k in nodes}
    largest = np.max(list(diagonal.values()), axis=0)
    least = {k: np.maximum(own, 0.01 * largest) for k, own in diagonal.items()}
    exact = []
    for i in range(rows):
        each = range(plan.first_node[i], plan.first_node[i + 1])
        levers = {plan.node[e]: value[plan.lever[e] : plan.lever[e] + 6].copy() for e in each}
        exact.append(sum((lever**2 / (2 * least[k])).sum() for k, lever in levers.items()))
    spare = np.zeros_like(value)
    _, pivot = factor_blocks(plan.ints, value, spare, len(plan.size))
    assert spare[plan.diagonal[plan.rows]] == pytest.approx(exact, rel=1e-12)
    assert pivot > 1e-10


def test_residuals_have_twice_the_digits(rng):
    """Where nothing is left of a right-hand side but its rounding, beside fractions."""
    plan, value, whole, _ = chain(rng, 2, 2)
    x, none, low = rng.normal(size=len(whole)), np.zeros(len(whole)), np.empty(len(whole))
    for unit, column in zip(-np.eye(len(whole)), whole, strict=True):
        residual_blocks(plan.ints, value, none, unit, column, low)
    whole = whole.T
    right, rest = whole @ x, np.empty_like(x)
    residual_blocks(plan.ints, value, right, x, rest, low)
    exact = [
        float(
            Fraction(b)
            - sum(Fraction(a) * Fraction(c) for a, c in zip(row.tolist(), x.tolist(), strict=True))
        )
        for row, b in zip(whole, right.tolist(), strict=True)
    ]
    assert rest == pytest.approx(exact, rel=1e-8, abs=1e-22 * np.abs(right).max())


@pytest.mark.parametrize("n", [1, 2, 5, 9])
def test_small_systems_are_solved_with_pivoting(n, rng):
    """Also with zeros on the diagonal, where rows have to change places, and the smallest where it would do harm."""
    for zeros in (0.0, 1e-14, 1.0):
        A, B = rng.normal(size=(n, n)), rng.normal(size=(n, 3))
        A[np.diag_indices(n)] *= zeros if n > 1 else 1.0
        found = B.copy()
        solve_small(A.copy(), found)
        assert found == pytest.approx(np.linalg.solve(A, B), rel=1e-9, abs=1e-9)


def test_dense_indefinite_matrices_of_mixed_units(rng):
    """Inertia, solution and condition, whatever the units; a singular matrix has no digits."""
    for negative in range(6):
        turned, unit = np.linalg.qr(rng.normal(size=(5, 5)))[0], 10.0 ** rng.uniform(-8, 8, 5)
        plain = turned * np.where(np.arange(5) < negative, -1.0, 1.0) * np.arange(1.0, 6.0) @ turned.T
        plain[np.diag_indices(5)] *= [1.0, 1.0, 1.0, 1.0, 1.0 if negative % 2 else 0.0]
        plain = 0.5 * (plain + plain.T)
        K, b = unit[:, None] * plain * unit, rng.normal(size=(5, 2))
        assert negative_inertia(K) == np.sum(np.linalg.eigvalsh(plain) < 0)
        scale = equilibration(K)
        even = K * np.outer(scale, scale)
        assert np.abs(even).max() < 1.3 and np.abs(even).max(axis=1).min() > 0.02
        x, reciprocal = solve_scaled(K, b, scale)
        assert x * unit[:, None] == pytest.approx(np.linalg.solve(plain, b / unit[:, None]), rel=1e-9)
        assert 0.99 < reciprocal * np.linalg.cond(even, 1) < 3.0
    x, reciprocal = solve_scaled(np.zeros((2, 2)), np.ones((2, 1)), equilibration(np.zeros((2, 2))))
    assert x.tolist() == [[0.0], [0.0]] and reciprocal == 0.0
