"""Exponential and logarithm of rotations to rounding, on both sides of where their series end."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ksd.numerics.rotations import (
    exp_tangent,
    log_tangent,
    reorthonormalise,
    rotate,
    rotation_exp,
    rotation_factors,
    rotation_log,
    rotation_log_below_150,
    tangent_factors,
)

pytestmark = pytest.mark.plain

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
    for axis in (*np.eye(3), *rng.normal(size=(20, 3))):
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


def cross(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.01, 0.0999, 0.1001, 0.5, 0.5477, 0.5478, 1.0, 1.58, 2.0, 3.0])
def test_tangents_of_the_exponential_are_their_series(angle, rng):
    """T = sum [v]x^k / (k + 1)!, b and c by the powers of the angle, b' and c' by theirs."""
    t2, factorial = angle**2, math.factorial
    b, c, db, dc = (
        math.fsum((-1) ** k * f(k) for k in range(40))
        for f in (
            lambda k: t2**k / factorial(2 * k + 2),
            lambda k: t2**k / factorial(2 * k + 3),
            lambda k: -2 * (k + 1) * t2**k / factorial(2 * k + 4),
            lambda k: -2 * (k + 1) * t2**k / factorial(2 * k + 5),
        )
    )
    assert tangent_factors(t2) == pytest.approx((b, c, db, dc), rel=4e-14)
    for _ in range(5):
        v = rng.normal(size=3)
        v *= angle / np.linalg.norm(v)
        T, inverse, R, start = np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), rng.normal(size=(3, 3))
        exact, power = np.zeros((3, 3)), np.eye(3)
        for k in range(60):
            exact, power = exact + power, power @ cross(v) / (k + 2)
        exp_tangent(v, T)
        assert pytest.approx(exact, abs=1e-14) == T
        log_tangent(v, inverse)
        assert inverse @ exact == pytest.approx(np.eye(3), abs=1e-14)
        rotation_exp(v, R)
        turned = start.copy()
        rotate(v, turned)
        assert turned == pytest.approx(R @ start, abs=4e-15)


@pytest.mark.parametrize("angle", [1e-9, 0.1, 0.35, 0.45, 1.0, 2.0, 2.6])
def test_the_logarithm_without_half_turns_is_the_whole_one(angle, rng):
    for _ in range(5):
        v, R, back = rng.normal(size=3), np.empty((3, 3)), np.empty(3)
        v *= angle / np.linalg.norm(v)
        rotation_exp(v, R)
        rotation_log_below_150(R, back)
        assert back == pytest.approx(v, abs=2e-15)


def test_drift_of_a_rotation_is_removed(rng):
    """A Newton step: what is left is of the order of its square."""
    for size in (1e-3, 1e-5):
        R = Rotation.random(random_state=1).as_matrix()
        drifted = R @ (np.eye(3) + size * rng.normal(size=(3, 3)))
        exact = 0.5 * drifted @ (3 * np.eye(3) - drifted.T @ drifted)
        reorthonormalise(drifted)
        assert drifted == pytest.approx(exact, abs=1e-15)
        assert drifted.T @ drifted == pytest.approx(np.eye(3), abs=30 * size**2)
