"""Exponential and logarithm of rotations to rounding, on both sides of where their series end."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ksd.numerics.rotations import rotation_exp, rotation_log

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
