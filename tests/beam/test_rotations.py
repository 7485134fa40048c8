"""Exponential and logarithm of rotations to rounding, on both sides of where their series end."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ksd.numerics.rotations import rotation_exp, rotation_factors, rotation_log

ANGLES = [
    0.0,
    1e-12,
    1e-5,
    0.1,
    0.38,
    0.3947,
    0.3948,
    0.4,
    1.0,
    1.58,
    1.5811,
    1.5812,
    2.0,
    3.0,
    3.14,
    np.pi - 1e-9,
]


@pytest.mark.parametrize("angle", ANGLES)
def test_there_and_back(angle, rng):
    for _ in range(20):
        axis = rng.normal(size=3)
        v = angle * axis / np.linalg.norm(axis)
        R, back = np.empty((3, 3)), np.empty(3)
        rotation_exp(v, R)
        assert np.abs(R - Rotation.from_rotvec(v).as_matrix()).max() < 6e-16
        rotation_log(R, back)
        # close to half a turn the axis is known to the square root of rounding only by what is left of it
        assert np.abs(back - v).max() < (2e-15 if angle < 3.0 else 1e-13)


@pytest.mark.parametrize("t", [1e-3, 0.0999, 0.1001, 1.581, 1.582, 4.0, 6.5, 9.0, 30.0])
def test_factors_up_to_many_turns(t):
    a, b = rotation_factors(t**2)
    assert a == pytest.approx(np.sin(t) / t, abs=4e-16)
    assert b == pytest.approx(2 * (np.sin(t / 2) / t) ** 2, abs=4e-16)


def test_factors_of_what_is_no_number_are_none():
    assert all(np.isnan(f) for f in rotation_factors(np.nan))
