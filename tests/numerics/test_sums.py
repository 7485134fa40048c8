"""Weighted sums of rows and arrays on the stack, as compiled code uses them, against numpy."""

import numpy as np
import pytest

from ksd.numerics.kernel import kernel
from ksd.numerics.local import local_counts, local_matrix, local_vector
from ksd.numerics.sums import weighted_rows


@kernel
def _sum_rows(outputs, out, n, weight, skip, stride, count, rows, step, factor, add):
    weighted_rows(outputs, out, 2, n + 1, n, weight, 1, skip, stride, count, rows, 3, step, factor, add)


@pytest.mark.parametrize("add", [False, True])
@pytest.mark.parametrize("outputs", [1, 2, 3, 5])
@pytest.mark.parametrize("n", [1, 3, 4, 7, 8, 12, 13, 31])
def test_sums_of_rows(n, outputs, add, rng):
    """Any number of columns and of sums; what lies between the outputs is left alone."""
    count, step, skip, stride = 6, n + 2, 3, 2
    weight, rows = rng.normal(size=40), rng.normal(size=count * step + 3)
    out = rng.normal(size=outputs * (n + 1) + 4)
    expected = out.copy()
    for o in range(outputs):
        total = sum(
            weight[1 + o * skip + k * stride] * rows[3 + k * step : 3 + k * step + n] for k in range(count)
        )
        at = slice(2 + o * (n + 1), 2 + o * (n + 1) + n)
        expected[at] = -0.5 * total + (out[at] if add else 0.0)
    _sum_rows(outputs, out, n, weight, skip, stride, count, rows, step, -0.5, add)
    assert out == pytest.approx(expected, rel=1e-13, abs=1e-13)


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
