"""The tangent without stresses is the whole one at stresses zero."""

import numpy as np
import pytest

from ksd.elements.corotational_element import (
    C_AT,
    CHAIN_SCRATCH_SIZE,
    ELEMENT_STORE_SIZE,
    Q_AT,
    Z_AT,
    chord,
    gradients,
    load_node,
    node_axes,
    strains,
    stresses,
    tangent,
    unstressed_tangent,
)
from ksd.numerics.rotations import rotation_exp

pytestmark = pytest.mark.plain


@pytest.mark.parametrize("first", [True, False])
def test_tangents_agree_where_nothing_is_stressed(first, rng):
    v = np.concatenate([[0.02, 3e7, 0.4, 900.0, 400.0, 0.7, 0.3], np.eye(3).ravel()])
    for _ in range(10):
        s, tail = np.zeros(ELEMENT_STORE_SIZE), rng.normal(size=CHAIN_SCRATCH_SIZE)
        R = np.empty((3, 3))
        rotation_exp(0.2 * rng.normal(size=3), R)
        tail[Q_AT : Q_AT + 12] = np.concatenate([np.zeros(3), R.ravel()])
        rotation_exp(0.2 * rng.normal(size=3), R)
        load_node(tail, np.zeros(0), -1, np.array([0.02, 1e-3, -2e-3]) + 1e-4 * rng.normal(size=3), R)
        node_axes(v, tail)
        chord(s, tail)
        assert gradients(v[0], s, tail) == 0
        strains(v[0], s, tail)
        stresses(v, s, tail)
        one, other = (s.copy(), tail.copy()), (s.copy(), tail.copy())
        one[1][Z_AT:] = other[1][Z_AT:] = 0.0
        found = tangent(v, *one, first)
        assert unstressed_tangent(v, *other, first) == pytest.approx(found, rel=1e-12)
        assert other[0] == pytest.approx(one[0], rel=1e-11, abs=1e-12 * np.abs(one[0]).max())
        # scratch of the geometric part, which is not made, apart
        assert other[1][C_AT:] == pytest.approx(
            one[1][C_AT:], rel=1e-11, abs=1e-12 * np.abs(one[1][C_AT:]).max()
        )
