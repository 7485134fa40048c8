"""Curves of a few numbers: their shape against integration of their own words, chords, and errors."""

import math
from itertools import pairwise

import numpy as np
import pytest

import ksd


def angles(curve, s):
    """Angle at fractions s, by Gauss quadrature of the curvature."""
    x, w = np.polynomial.legendre.leggauss(24)
    found = []
    for end in s:
        at = 0.5 * end * (x + 1)
        found.append(
            curve.length
            * 0.5
            * end
            * sum(v * curve.curvature(float(a))[2] for v, a in zip(w, at, strict=True))
        )
    return np.array(found)


S = np.linspace(0.0, 1.0, 9)


def test_sine():
    c = (0.9, -0.4, 0.2)
    curve = ksd.FreeCurve.sine(c, length=0.2)
    want = sum(a * np.sin(2 * np.pi * (i + 1) * S) for i, a in enumerate(c))
    assert curve.length == 0.2 and angles(curve, S) == pytest.approx(want, abs=1e-12)
    assert isinstance(curve, ksd.FreeCurve) and curve.curvature(0.3)[:2].tolist() == [0, 0]
    # J0(1): chord over length of one wave
    one = ksd.FreeCurve.sine(1.0, chord=0.05)
    assert one.length == pytest.approx(0.05 / 0.7651976865579666, rel=1e-12)
    end, _ = one.line(1.0)
    assert end == pytest.approx((0.05, 0, 0), abs=1e-9)


def test_legendre():
    """The first coefficient alone is an arc."""
    arc = ksd.FreeCurve.legendre([1.2], length=0.03)
    want = ksd.Arc(0.025, 1.2)
    assert arc.length == pytest.approx(want.length) and arc.curvature(0.4) == pytest.approx(
        want.curvature(0.4)
    )
    assert ksd.FreeCurve.legendre([1.2], chord=want.chord).length == pytest.approx(0.03, rel=1e-12)
    curve = ksd.FreeCurve.legendre((0.5, -1.0, 0.7), length=0.1)
    u = 2 * S - 1
    assert 0.1 * np.array([curve.curvature(float(s))[2] for s in S]) == pytest.approx(
        0.5 - u + 0.35 * (3 * u**2 - 1)
    )
    assert angles(curve, [1.0])[0] == pytest.approx(0.5, abs=1e-12)


def test_spline():
    """Through its points, with its angles at the ends; of many points of a circle the circle."""
    points = np.array([(0, 0), (0.03, 0.01), (0.06, -0.01), (0.1, 0.0)])
    curve = ksd.FreeCurve.spline(points, start=0.3, end=-0.2)
    fine = np.linspace(0, 1, 1001)
    turn = 0.3 + curve.length * np.concatenate([[0], np.cumsum(
        [0.5 * (curve.curvature(a)[2] + curve.curvature(b)[2]) * (b - a) for a, b in pairwise(fine)]
    )])  # fmt: skip
    assert turn[-1] == pytest.approx(-0.2, abs=1e-4)
    steps = np.diff(fine)[:, None] * curve.length * np.column_stack(
        [0.5 * (f(turn[1:]) + f(turn[:-1])) for f in (np.cos, np.sin)]
    )  # fmt: skip
    line = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    for point in points:
        assert np.hypot(*(line - point).T).min() < 1e-4
    free = ksd.FreeCurve.spline(points)
    assert free.curvature(0.0)[2] == pytest.approx(0.0, abs=1e-9) == free.curvature(1.0)[2]
    turns = np.linspace(0.0, 1.5, 40)
    circle = ksd.FreeCurve.spline(
        0.02 * np.column_stack([np.sin(turns), 1 - np.cos(turns)]), start=0.0, end=1.5
    )
    assert circle.length == pytest.approx(0.03, rel=1e-8)
    assert [circle.curvature(float(s))[2] for s in S] == pytest.approx([50.0] * 9, rel=1e-3)
    straight = ksd.FreeCurve.spline([(0, 0), (0.1, 0)])
    assert straight.length == pytest.approx(0.1) and straight.curvature(0.7)[2] == pytest.approx(
        0.0, abs=1e-12
    )


def test_a_curve_of_a_leaf():
    """A leaf takes it; the ends of a spline are where its points are."""
    points = [(0, 0), (0.04, 0.015), (0.1, 0.02)]
    scene = ksd.Mechanism("spline", plane="xy")
    scene.leaf(
        "ground", scene.link("tip"), start=(0, 0, 0), end=(0.1, 0.02, 0), curve=ksd.FreeCurve.spline(points),
        section=ksd.rectangle(0.5e-3, 0.01), material=ksd.Material(E=200e9, nu=0.3),
    )  # fmt: skip
    scene.load("tip", force=(0, 1, 0), at=(0.1, 0.02, 0))
    pose = ksd.solve(scene)
    rest = pose.shape().leaves[0].rest
    assert np.linalg.norm(rest[:, :2] - points[1], axis=1).min() < 2e-3
    assert pose.trusted and not math.isclose(pose.displacement("tip")[1], 0.0)


@pytest.mark.parametrize(
    "made, message",
    [
        (lambda: ksd.FreeCurve.sine([], length=1), r"FreeCurve.sine: amplitudes = .* one or more"),
        (lambda: ksd.FreeCurve.sine("much", length=1), r"amplitudes = 'much' must be numbers"),
        (lambda: ksd.FreeCurve.sine([1.0]), r"give one of length and chord"),
        (lambda: ksd.FreeCurve.sine([1.0], length=1, chord=1), r"give one of length and chord"),
        (lambda: ksd.FreeCurve.sine([1.0], chord=-1), r"chord = -1"),
        (
            lambda: ksd.FreeCurve.legendre([2 * math.pi], chord=1),
            r"its ends meet, so that no length gives it a chord",
        ),
        (lambda: ksd.FreeCurve.legendre([math.nan], length=1), r"FreeCurve.legendre: coefficients"),
        (lambda: ksd.FreeCurve.spline([(0, 0)]), r"two or more points"),
        (lambda: ksd.FreeCurve.spline("here"), r"two or more points"),
        (lambda: ksd.FreeCurve.spline([(0, 0), (1, 0), (1, 0)]), r"points 2 and 3 coincide"),
        (lambda: ksd.FreeCurve.spline([(0, 0), (1, 0)], start="up"), r"start = 'up' is not a number"),
    ],
)
def test_errors(made, message):
    with pytest.raises(ksd.SceneError, match=message):
        made()
