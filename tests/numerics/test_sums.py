"""Weighted sums of rows and arrays on the stack, as compiled code uses them, against numpy."""

import numpy as np
import pytest

from ksd.numerics.kernel import kernel
from ksd.numerics.lanes import load4, pick4, spread, store4, transpose4
from ksd.numerics.local import local_counts, local_matrix, local_vector
from ksd.numerics.sums import weighted_rows

SIZES = (3, 8)


@kernel
def _sum_rows(out, weight, rows, how, n, factor, add):
    between, jump, along, skip, stride, step = how[0], how[1], how[2], how[3], how[4], how[5]
    weighted_rows(
        how, out, 2, weight, 1, rows, 3, between, jump, along, skip, stride, 0 * n, step, how[6], how[7], how[8], n,
        factor, add,
    )  # fmt: skip


@kernel
def _known_sums(out, weight, rows):
    weighted_rows(
        SIZES,
        out,
        0,
        weight,
        0,
        rows,
        0,
        0,
        8,
        0,
        1,
        SIZES[0],
        0,
        SIZES[1],
        1,
        SIZES[0],
        5,
        SIZES[1],
        2.0,
        False,
    )


@pytest.mark.parametrize("add", [False, True])
@pytest.mark.parametrize("outputs", [1, 2, 3, 5, 8])
@pytest.mark.parametrize("n", [1, 4, 7, 8, 12, 13, 31])
def test_sums_of_rows(n, outputs, add, rng):
    """Any number of columns, in whole fours, and of sums; what lies between the outputs is left alone."""
    batch, count, width = 3, 6, n + 4
    along, skip, stride, step, jump = 50, 3, 7, width, width
    between = outputs * jump
    weight, rows = rng.normal(size=200), rng.normal(size=count * step + 3)
    out = rng.normal(size=batch * between + 4)
    expected, whole = out.copy(), (n + 3) // 4 * 4
    for b in range(batch):
        for o in range(outputs):
            first = 1 + b * along + o * skip
            total = sum(
                weight[first + k * stride] * rows[3 + k * step : 3 + k * step + whole] for k in range(count)
            )
            at = 2 + b * between + o * jump
            at = slice(at, at + whole)
            expected[at] = -0.5 * total + (out[at] if add else 0.0)
    how = np.array([between, jump, along, skip, stride, step, batch, outputs, count])
    _sum_rows(out, weight, rows, how, n, -0.5, add)
    assert out == pytest.approx(expected, rel=1e-13, abs=1e-13)


def test_sums_of_sizes_the_compiler_knows(rng):
    weight, rows, out = rng.normal(size=15), rng.normal(size=(5, 8)), np.zeros(24)
    _known_sums(out, weight, rows.ravel())
    assert out.reshape(3, 8) == pytest.approx(2.0 * weight.reshape(5, 3).T @ rows)


@kernel
def _four_at_a_time(x, out):
    a, b = load4(x, 0), pick4(x, 0, 2)
    c = 1.0 - a * b + spread(0.5) / 2.0
    rows = transpose4(a, b, c, 2.0 * a)
    for k in range(4):
        store4(out, 4 * k, rows[k])


def test_four_numbers_at_a_time(rng):
    x, out = rng.normal(size=8), np.zeros(16)
    _four_at_a_time(x, out)
    a, b = x[:4], x[::2]
    assert pytest.approx(np.array([a, b, 1.25 - a * b, 2 * a])) == out.reshape(4, 4).T


@kernel
def _with_local_arrays(x):
    total = 0.0
    for k in range(5):
        v, A, c = local_vector(3), local_matrix(2, 3), local_counts(2)
        c[0], c[1] = k, 2 * k
        for j in range(3):
            v[j] = x[j] * k
            A[0, j], A[1, j] = v[j], 10.0 * v[j]
        total += A[1, 2] + v[0] + c[1] + A[0, :].sum() + len(v) + A.shape[1]
    return total


def test_arrays_on_the_stack():
    x = np.array([1.0, 2.0, 3.0])
    expected = sum(10 * x[2] * k + x[0] * k + 2 * k + k * x.sum() + 6 for k in range(5))
    assert _with_local_arrays(x) == pytest.approx(expected)


def test_sizes_on_the_stack_must_be_literal():
    @kernel(cache=False)
    def open_size(n):
        return local_vector(n)[0]

    with pytest.raises(Exception, match="_vector"):
        open_size(3)
