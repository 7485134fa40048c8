"""Nodes alone: the same factors as the general ones, in the same places."""

import numpy as np
import pytest

from ksd.numerics.blocks import backward_blocks, factor_blocks, forward_blocks, plan_blocks, solve_blocks
from ksd.numerics.node_blocks import factor_node_blocks


def system(rng, count, more, last, shift=0.0):
    """A random symmetric matrix of nodes in a loop with `more` couplings; the plan, its values, the matrix."""
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
def test_factors_are_those_of_the_general_ones(count, more, last, shift, rng):
    plan, value, _ = system(rng, count, more, last, shift)
    found = []
    for factor in (factor_blocks, factor_node_blocks):
        mine, spare = value.copy(), np.zeros_like(value)
        negatives, pivot = factor(plan, mine, spare, count - last)
        x = np.arange(6.0 * count)
        forward_blocks(plan, spare, x, count - last)
        backward_blocks(plan, mine, spare, x, count - last)
        found.append((negatives, pivot, mine, x))
    assert found[0][0] == found[1][0]
    assert found[0][1] == pytest.approx(found[1][1], rel=1e-9)
    for k in (2, 3):
        assert found[0][k] == pytest.approx(found[1][k], rel=1e-9, abs=1e-9 * np.abs(found[0][k]).max())


def test_they_solve(rng):
    plan, value, whole = system(rng, 9, 4, 0)
    spare, x = np.zeros_like(value), rng.normal(size=54)
    right = whole @ x
    assert factor_node_blocks(plan, value, spare, 9)[0] == 0
    solve_blocks(plan, value, spare, right)
    assert right == pytest.approx(x, rel=1e-10)


def test_a_pivot_that_vanishes_is_told(rng):
    plan, value, _ = system(rng, 4, 0, 1)
    at = plan.diagonal[0]
    value[at : at + 36] = 0.0
    assert factor_node_blocks(plan, value, np.zeros_like(value), 3) == (0, 0.0)
