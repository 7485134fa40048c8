"""The integrated rod, beside its equations as they are written, solved by scipy, and beside differences."""

import itertools

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from ksd.elements.rod import (
    NODES,
    ROD,
    STATE,
    WEIGHTS,
    allocate_rod_scratch,
    integrate_rod,
    unloaded_rod_end,
)
from ksd.elements.strain_centreline import integrate_centrelines

pytestmark = pytest.mark.plain

GRAVITY, WRENCH = np.array([0.5, -0.7, 0.4]), np.array([0.6, -0.5, 0.8, 0.4, 0.9, -0.7])


def numbers(s):
    """Of a rod curved, tapered and heavy, at s along it: all of them vary, at different rates."""
    k0 = [0.5 + s, np.cos(2 * s), -0.4 + s**2]
    return np.array([*k0, *(0.3 + 0.2 * np.sin(s + np.arange(6))), 0.6 + 0.3 * np.cos(s), s, 0.7 + 0.2 * s])


def cross(v):
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


LOADS = np.array([*GRAVITY, 0.3, -0.2, 0.5, 0.1, 0.4, -0.3, 0.7])
"""Gravity, line load at the start and its change, and pressure."""


def exact(wrench, *, loads=LOADS):
    """Position, axes, moment of end q of a rod of unit length."""

    def slope(s, y):
        R, m, n, rod = y[3:12].reshape(3, 3), y[12:15], y[15:], numbers(s)
        v = R @ (np.array([1.0, 0, 0]) + rod[6:9] * (R.T @ n))
        k = rod[:3] + rod[3:6] * (R.T @ m)
        return np.concatenate(
            [
                v,
                (R @ cross(k)).ravel(),
                np.cross(n, v),
                -rod[9] * loads[:3] - loads[3:6] - s * loads[6:9] - loads[9] * rod[11] * R[:, 1],
            ]
        )

    start = np.concatenate([np.zeros(3), np.eye(3).ravel(), wrench[3:], wrench[:3]])
    end = solve_ivp(slope, (0, 1), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
    return end[:3], end[3:12].reshape(3, 3), end[12:15]


def integrate(wrench, steps=8, *, d=None, Q=None, loads=LOADS):
    edges = np.linspace(0, 1, steps + 1)
    rod = np.array([[numbers(a + (b - a) * x) for x in NODES] for a, b in itertools.pairwise(edges)])
    assert rod.shape == (steps, 5, ROD)
    gap, scratch = np.empty(6), allocate_rod_scratch()
    d, Q = np.zeros(3) if d is None else d, np.eye(3) if Q is None else Q
    integrate_rod(0, steps, np.diff(edges), rod, loads, wrench, d, Q, gap, scratch)
    return gap, scratch.y.copy(), scratch.R.copy(), (np.diff(edges), rod)


def test_a_rod_follows_its_equations():
    d, Q = np.array([0.4, 0.2, -0.1]), Rotation.from_rotvec([0.1, 0.3, -0.2]).as_matrix()
    gap, y, R, (step, rod) = integrate(WRENCH, d=d, Q=Q)
    r, axes, m = exact(WRENCH)
    assert y[:3] == pytest.approx(r, abs=1e-10)
    assert pytest.approx(axes, abs=1e-10) == R
    assert y[7:10] == pytest.approx(m, abs=1e-10)
    assert gap[:3] == pytest.approx(d - r, abs=1e-10)
    assert gap[3:] == pytest.approx(Rotation.from_matrix(Q @ axes.T).as_rotvec(), abs=1e-10)
    r, axes, _ = exact(np.zeros(6), loads=np.zeros(10))
    position, end = unloaded_rod_end(step, rod)
    assert position == pytest.approx(r, abs=1e-10)
    assert end == pytest.approx(axes, abs=1e-10)
    assert np.isinf(integrate(np.full(6, np.nan))[0]).all()


def test_its_error_is_of_eighth_order():
    r, axes, m = exact(WRENCH)
    errors = []
    for steps in (2, 4):
        _, y, R, _ = integrate(WRENCH, steps)
        errors.append(max(np.abs(y[:3] - r).max(), np.abs(R - axes).max(), np.abs(y[7:10] - m).max()))
    assert errors[0] < 1e-5
    assert errors[0] / errors[1] > 2**7
    # Lobatto's weights are exact to seventh order
    assert [WEIGHTS @ NODES**k for k in range(8)] == pytest.approx(1.0 / np.arange(1, 9), rel=1e-14)


def test_its_derivatives_are_differences(rng):
    # how pressure turns with the rod is left out of them
    dead, h = np.append(LOADS[:9], 0.0), 1e-4
    _, y, _R, _ = integrate(WRENCH, loads=dead)
    for c in range(6):
        (up, Ru), (down, Rd) = (integrate(WRENCH + s * np.eye(6)[c], loads=dead)[1:3] for s in (h, -h))
        turn = Rotation.from_matrix(Ru @ Rd.T).as_rotvec()
        found = np.concatenate([up[:3] - down[:3], turn, up[7:10] - down[7:10]]) / (2 * h)
        assert y[STATE + 9 * c : STATE + 9 * c + 9] == pytest.approx(found, abs=1e-7)


def test_centrelines_are_magnus_steps_of_fourth_order():
    """R' = R [kappa]x, and r' = R (e1 + C R^T n), of two leaf springs of different lengths."""
    length, force = np.array([1.0, 0.6]), np.array([[0.3, -0.2, 0.5], [-0.4, 0.1, 0.2]])
    start = Rotation.from_rotvec([[0.1, 0.2, -0.3], [0.4, 0.0, 0.2]]).as_matrix()

    def kappa(s):
        return np.array([1.0 + s, np.sin(2 * s), 2.0 - s**2])

    errors = []
    for m in (8, 16):
        at = (np.arange(m)[None, :] + 0.5 + np.array([[-1], [1]]) / np.sqrt(12)).ravel() / m
        curvature = np.array([[kappa(s) for s in L * at] for L in length])
        C = 0.1 + 0.05 * np.sin(np.arange(2 * (m + 1) * 3)).reshape(2, m + 1, 3)
        R, v = np.empty((2, m + 1, 3, 3)), np.empty((2, m + 1, 3))
        n = np.broadcast_to(force[:, None], v.shape) * (1 + np.linspace(0, 1, m + 1))[:, None]
        integrate_centrelines(curvature, C, n, length / m, start, R, v)
        for i in range(2):

            def slope(s, y):
                return (y.reshape(3, 3) @ cross(kappa(s))).ravel()

            end = solve_ivp(slope, (0, length[i]), start[i].ravel(), rtol=1e-11, atol=1e-12).y[:, -1]
            errors.append(np.abs(R[i, -1] - end.reshape(3, 3)).max())
            assert R[i, 0].tolist() == start[i].tolist()
        one = np.array([1.0, 0, 0])
        slopes = R @ (one + C * (R.swapaxes(-1, -2) @ n[..., None])[..., 0])[..., None]
        assert v == pytest.approx(slopes[..., 0], rel=1e-13)
    assert errors[0] / errors[2] > 12 and errors[1] / errors[3] > 12
