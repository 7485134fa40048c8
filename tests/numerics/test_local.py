"""Small arrays of fixed size on the stack, as compiled code uses them."""

import numpy as np
import pytest

from ksd.numerics.kernel import kernel
from ksd.numerics.local import local_counts, local_matrix, local_vector


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
