"""Kernels that own no array are compiled without counting users; those that make some still count, and none is lost."""

from __future__ import annotations

import sys
from typing import NamedTuple

import numpy as np
import pytest
from numba.core.runtime import _nrt_python, rtsys

from ksd.numerics import within
from ksd.numerics.held import Held, part
from ksd.numerics.kernel import kernel
from ksd.numerics.local import local_vector


class Pair(NamedTuple):
    a: np.ndarray
    b: np.ndarray


@kernel
def _sum_rows(pair, out):
    here = local_vector(2)
    for i in range(len(pair.b)):
        row = pair.b[i]
        here[0] = max(row[0], 0.0) + abs(row[1])
        out[i] = pair.a[i] + here[0]
    return len(out)


@kernel
def _own_rows(pair, out):
    made = np.zeros(len(out))
    _sum_rows(pair, made)
    out[:] = made
    return made


@kernel
def _copied(pair, out):
    out[:] = pair.a
    return 0


@kernel
def _chosen(pair, out):
    at = np.argsort(pair.a)
    out[0] = pair.a[at][0]
    return 0


@kernel
def _summed(pair, out):
    twice = pair.a + pair.a
    out[0] = twice[0]
    return 0


@kernel
def total(pair, out):
    """Calls a borrowing kernel itself and through one that owns."""
    made = _own_rows(pair, out)
    return _sum_rows(pair, out) + made[0]


@kernel
def total_held(held, out):
    return _sum_rows(part(held, "pair"), out)


class Set(NamedTuple):
    pair: Pair


@pytest.fixture
def asked(monkeypatch):
    """What `borrows` said of each kernel compiled meanwhile."""
    said, real = {}, within.borrows

    def noted(state):
        said[state.func_id.func_name] = real(state)
        return said[state.func_id.func_name]

    monkeypatch.setattr(within, "borrows", noted)
    return said


def _parts() -> tuple[Pair, np.ndarray]:
    return Pair(np.arange(3.0), np.array([[1.0, -2.0], [-3.0, 4.0], [5.0, 6.0]])), np.zeros(3)


@pytest.mark.parametrize(
    ("function", "expected"),
    [(_sum_rows, True), (_own_rows, False), (_copied, False), (_chosen, False), (_summed, False)],
)
def test_only_kernels_that_make_no_array_are_uncounted(asked, function, expected):
    import numba

    pair, out = _parts()
    plain = numba.njit(pipeline_class=within._Within, no_cpython_wrapper=True, no_cfunc_wrapper=True)
    plain(function.py_func).compile((numba.typeof(pair), numba.typeof(out)))
    assert asked[function.__name__] is expected


def test_no_array_is_lost_or_freed_early():
    pair, out = _parts()
    held = Held(Set(pair))
    _nrt_python.memsys_enable_stats()
    total(pair, out), total_held(held, out)
    counts, stats = [sys.getrefcount(x) for x in (*pair, out)], rtsys.get_allocation_stats()
    for _ in range(50):
        assert total(pair, out) == 3 + out[0]
        assert total_held(held, out) == 3
    assert [sys.getrefcount(x) for x in (*pair, out)] == counts
    after = rtsys.get_allocation_stats()
    assert after.alloc - stats.alloc == after.free - stats.free > 0
    np.testing.assert_array_equal(out, [3.0, 5.0, 13.0])
