"""Curves of a few numbers: their shape against integration of their own words, chords, and errors."""

import math
import tomllib
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from test_json_schema import SCHEMA, fits

import ksd
from ksd.scene.clearance import leaf_boxes
from ksd.scene.curve import Curve, CurvePart


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
    want = ksd.Arc(radius=0.025, angle=1.2)
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
        (
            lambda: ksd.FreeCurve.legendre([1, 2, 3], length=1, breaks=[0.5]),
            r"1 breaks make 2 pieces; give a list",
        ),
        (lambda: ksd.FreeCurve.legendre([[1], [2]], length=1, breaks=[1.5]), r"must rise between 0 and 1"),
        (
            lambda: ksd.FreeCurve.legendre([[1], [2]], chord=1, breaks=[0.5]),
            r"give its length instead of a chord",
        ),
        (lambda: ksd.FreeCurve.spline([(0, 0)]), r"two or more points"),
        (lambda: ksd.FreeCurve.spline("here"), r"two or more points"),
        (lambda: ksd.FreeCurve.spline([(0, 0), (1, 0), (1, 0)]), r"points 2 and 3 coincide"),
        (lambda: ksd.FreeCurve.spline([(0, 0), (1, 0)], start="up"), r"start = 'up' is not a number"),
    ],
)
def test_errors(made, message):
    with pytest.raises(ksd.SceneError, match=message):
        made()


def test_pieces():
    """Two arcs, one after the other, and all at once what it is one by one."""
    curve = ksd.FreeCurve.legendre([[0.8], [-0.5, 0.1]], length=0.1, breaks=[0.25])
    assert curve.curvatures([0.1, 0.25, 0.625, 1.0])[:, 2] == pytest.approx([8.0, -6.0, -5.0, -4.0])
    for other in (
        ksd.FreeCurve.sine([0.4, 0.1], length=0.1),
        ksd.FreeCurve.spline([(0, 0), (1, 1), (2, 0)]),
        curve,
    ):
        assert other.curvatures(S) == pytest.approx(np.array([other.curvature(float(s)) for s in S]))


amounts = st.floats(-1.0, 1.0).filter(lambda v: abs(v) > 1e-3)
lengths = st.floats(0.01, 10.0)
lists = st.lists(amounts, min_size=1, max_size=4)
curves = st.one_of(
    st.none(),
    st.builds(ksd.Arc, radius=lengths, angle=amounts),
    st.builds(lambda c, length: ksd.FreeCurve.sine(c, length=length), lists, lengths),
    st.builds(lambda c, chord: ksd.FreeCurve.sine(c, chord=chord), lists, lengths),
    st.builds(lambda c, length: ksd.FreeCurve.legendre(c, length=length), lists, lengths),
    st.builds(
        lambda c, length, at: ksd.FreeCurve.legendre(c, length=length, breaks=[at]),
        st.tuples(lists, lists), lengths, st.floats(0.1, 0.9),
    ),
    st.builds(
        lambda rises, start, end: ksd.FreeCurve.spline(list(enumerate(rises)), start=start, end=end),
        st.lists(amounts, min_size=2, max_size=5), st.none() | amounts, st.none() | amounts,
    ),
)  # fmt: skip
profiles = st.one_of(
    st.none(),
    st.builds(ksd.Taper, thickness=st.tuples(lengths, lengths), width=st.tuples(lengths, lengths)),
    st.builds(ksd.CircularNotch, radius=lengths, minimum=lengths, width=lengths),
    st.builds(
        lambda r, t, w: ksd.FilletedNotch(length=3 * r, radius=r, minimum=t, width=w),
        lengths,
        lengths,
        lengths,
    ),
    st.builds(
        ksd.StiffenedMiddle, thickness=lengths, width=lengths, middle=lengths, part=st.floats(0.1, 0.9)
    ),
)


def curved(curve, profile):
    """A leaf with these between the ends of its curve."""
    end = (0.1, 0.0, 0.0) if curve is None else curve.line(1.0)[0]
    scene = ksd.Mechanism("curved")
    words = {"section": ksd.rectangle(1e-3, 0.01), "material": ksd.Material(E=200e9, nu=0.3), "name": "leaf"}
    scene.leaf("ground", scene.link("straight"), start=(0, 1, 0), end=(1, 1, 0), **words | {"name": "first"})
    scene.leaf("ground", scene.link("tip"), start=(0, 0, 0), end=end, curve=curve, profile=profile, **words)
    return scene


@given(curve=curves, profile=profiles)
@settings(max_examples=60, deadline=None)
@pytest.mark.filterwarnings("ignore:curved.toml")
def test_files_hold_curves_and_profiles(curve, profile, tmp_path_factory):
    """Written and read it is the same scene, to the last digit; and the schema takes it."""
    scene, file = curved(curve, profile).scene(), tmp_path_factory.mktemp("curves") / "curved.toml"
    ksd.save_scene(scene, file)
    back = ksd.load_scene(file)[0].scene()
    assert back == scene and back.fingerprint() == scene.fingerprint()
    assert fits(tomllib.loads(file.read_text()), SCHEMA)


@pytest.mark.parametrize(
    "said, line, message",
    [
        ('kind = "sin"', 35, r"curve 'sin' is unknown; did you mean \"sine\""),
        ('kind = "sine"\namplitudes = [1]', 35, r"give one of length and chord"),
        (
            'kind = "sine"\namplitudes = ["30 mm"]\nlength = 1',
            37,
            r"amplitudes\[0\] = '30 mm': an angle is expected",
        ),
        ('kind = "arc"\nradius = 1\nangel = 1', 38, r"did you mean \"angle\""),
        ("radius = 1", 35, r"key 'kind' is missing"),
    ],
)
def test_wrong_curves_in_files(said, line, message, tmp_path):
    file = tmp_path / "curved.toml"
    ksd.save_scene(curved(ksd.Arc(radius=0.1, angle=1.0), None), file)
    text = file.read_text().partition("[leaf.curve]")
    file.write_text(text[0] + text[1] + "\n" + said + "\n")
    with pytest.raises(ksd.SceneError, match=rf"line {line}, \[\[leaf\]\] 2, \[leaf.curve\].*{message}"):
        ksd.load_scene(file)


@pytest.mark.parametrize("number", [np.float64, np.float32, np.int64, int, np.array])
def test_an_arc_of_any_number_is_written_and_remembered(number, tmp_path):
    mechanism, file = curved(ksd.Arc(radius=number(1), angle=number(-1)), None), tmp_path / "arc.toml"
    ksd.save_scene(mechanism, file)
    scene = mechanism.draft()
    assert ksd.load_scene(file)[0].draft() == scene and len(scene.fingerprint()) > 1 and hash(scene)


def test_functions_are_not_written(tmp_path):
    free = ksd.FreeCurve(0.1, lambda s: (0, 0, 3 * s))
    with pytest.raises(
        ksd.SceneError, match=r"leaf 'leaf': its curve is a function.* sine, legendre, spline"
    ):
        ksd.save_scene(curved(free, None), tmp_path / "no.toml")
    varying = ksd.Varying(lambda s: ksd.rectangle(1e-3, 0.01 + 0.01 * s))
    with pytest.raises(ksd.SceneError, match=r"its profile is a function.* taper, circular_notch"):
        ksd.save_scene(curved(None, varying), tmp_path / "no.toml")


def test_a_rest_shape_is_written(tmp_path):
    """What is found stands in a file that solves to the same."""
    scene = ksd.Mechanism("leaf", plane="xy")
    scene.leaf("ground", scene.link("tip"), start=(0, 0, 0), end=(0.1, 0, 0), section=ksd.rectangle(1e-3, 0.01),
               material=ksd.Material(E=200e9, nu=0.3), name="leaf")  # fmt: skip
    scene.load("tip", force=(0, 5, 0), at=(0.1, 0, 0))
    scene.point("leaf", 0.04)
    found = ksd.rest_shape(scene)
    ksd.save_scene(found, tmp_path / "rest.toml")
    back = ksd.load_scene(tmp_path / "rest.toml")[0]
    assert ksd.solve(back).displacement("tip") == pytest.approx(
        ksd.solve(found).displacement("tip"), rel=1e-12
    )


def test_boxes_of_a_curve_in_space_follow_it():
    """A helix: they left it, their axes askew, wherever its chord was out of the plane of its start."""
    r, pitch, turn = 0.02, 0.03, 4.0
    rate = math.hypot(r, pitch / (2 * math.pi))
    bend, twist = r / rate**2, pitch / (2 * math.pi) / rate**2
    curve = ksd.FreeCurve(turn * rate, lambda s: (twist, 0.0, bend))
    climb = pitch / (2 * math.pi)
    end = np.array([r * (math.cos(turn) - 1), r * math.sin(turn), climb * turn])
    chord = float(np.linalg.norm(end))
    leaf = ksd.Leaf(
        start=(0, 0, 0), end=(chord, 0, 0), width_axis="z", section=ksd.rectangle(5e-4, 3e-3), curve=curve,
        material=ksd.Material(200e9, nu=0.3),
    )  # fmt: skip
    body = leaf_boxes(leaf, count=64)
    a = turn * (np.arange(64) + 0.5) / 64
    line = np.column_stack([r * (np.cos(a) - 1), r * np.sin(a), climb * a])
    # distances from both ends tell a point but for a turn about the chord
    for start, other in ((np.zeros(3), np.zeros(3)), (end, np.array([chord, 0, 0]))):
        want = np.linalg.norm(line - start, axis=1)
        assert np.linalg.norm(body.centre - other, axis=1) == pytest.approx(want, abs=2e-5)
    # the width stays along the binormal
    slope = climb / rate
    assert body.axes[:, :, 2] @ body.axes[:, :, 2].T == pytest.approx(
        ((r / rate) ** 2 + slope**2 * np.cos(np.subtract.outer(a, a))), abs=2e-3
    )


def planar_line(curve, breaks=()):
    """End (2,) of a plane curve over its length: its angle and its tangent by Gauss quadrature on short panels."""
    x, w = np.polynomial.legendre.leggauss(16)
    inner = 0.5 * np.vander(x, 17, increasing=True)[:, 1:] / np.arange(1, 17)
    start = 0.5 * np.vander([-1.0], 17, increasing=True)[:, 1:] / np.arange(1, 17)
    antiderivative = (inner - start) @ np.linalg.inv(np.vander(x, 16, increasing=True))
    turn, end = 0.0, np.zeros(2)
    for a, b in pairwise((0.0, *breaks, 1.0)):
        edges = np.linspace(a, b, 201)
        for left, right in pairwise(edges):
            h = right - left
            kappa = curve.length * curve.curvatures(left + 0.5 * h * (x + 1))[:, 2]
            angle = turn + h * antiderivative @ kappa
            end += 0.5 * h * np.array([w @ np.cos(angle), w @ np.sin(angle)])
            turn += 0.5 * h * w @ kappa
    return end


@pytest.mark.parametrize(
    "curve, breaks",
    [
        (ksd.FreeCurve.legendre([[0.5, 0.3], [-2.0], [1.0]], length=0.1, breaks=[0.37, 0.41]), (0.37, 0.41)),
        (ksd.FreeCurve.sine([0.0] * 39 + [0.5], length=0.1), ()),
        (ksd.FreeCurve.sine([0.0] * 24 + [0.5], chord=0.1), ()),
        (ksd.FreeCurve.spline([(0, 0), (0.03, 0.02), (0.05, -0.01), (0.1, 0)]), None),
        (ksd.FreeCurve(0.1, lambda s: (0, 0, 5.0 if s > 0.333 else -30.0)), (0.333,)),
        (ksd.FreeCurve(0.1, lambda s: (0, 0, 5.0 if s > 0.9999 else -30.0)), (0.9999,)),
    ],
)
def test_a_line_is_integrated_by_the_scale_of_its_curve(curve, breaks):
    """Jumps, known and unknown, and many waves: to 1e-10 of the length; parts of it join to the whole."""
    breaks = curve.breaks if breaks is None else breaks
    end, axes = curve.line(1.0)
    assert end[:2] / curve.length == pytest.approx(planar_line(curve, breaks), abs=1e-10)
    middle, turned = curve.line(0.3)
    rest, last = CurvePart(curve, (0.3, 1.0)).line(1.0)
    assert middle + turned @ rest == pytest.approx(end, abs=1e-10 * curve.length)
    assert turned @ last == pytest.approx(axes, abs=1e-10)


def test_curvature_without_end_is_refused():
    class Noise(Curve):
        length, generator = 0.1, np.random.default_rng(1)

        def curvatures(self, s):
            return 100 * self.generator.random((len(s), 3))

    with pytest.raises(ksd.SceneError, match=r"Noise: its curvature varies too fast to be integrated"):
        Noise().line(1.0)


STEEL = ksd.Material(E=200e9, nu=0.3)


def bent(curve, marks=(), end=None, **words):
    """A curved leaf from ground to a loaded tip, with points at fractions of its length."""
    end = tuple(curve.line(1.0)[0]) if end is None else end
    made = ksd.Mechanism("bent")
    made.leaf("ground", made.link("tip"), start=(0, 0, 0), end=end, width_axis="z", curve=curve, name="w",
              section=ksd.rectangle(0.2e-3, 5e-3), material=STEEL, **words)  # fmt: skip
    for s in marks:
        made.point("w", s * curve.length)
    made.load("tip", force=(0, 0.05, 0), at=end)
    return made


@pytest.mark.parametrize("words", [{}, {"orders": (1, 1, 1)}, {"elements": 3}])
def test_drawn_ends_that_do_not_fit_are_refused_when_drawn(words):
    """Whatever is on the leaf, and however it is meshed: the check is one of the leaf as drawn."""
    arc = ksd.Arc(radius=0.02, angle=math.radians(90))
    with pytest.raises(
        ksd.SceneError, match=r"leaf 'w': its curve spans 0.0282843 m .* are 0.0311127 m apart"
    ):
        bent(arc, end=tuple(1.1 * arc.line(1.0)[0]), **words)
    with pytest.raises(ksd.SceneError, match=r"leaf 'w': its curve spans .*e-1. m from"):
        circle = ksd.FreeCurve(0.1, lambda s: (0, 0, 20 * math.pi))
        bent(circle, end=(0.03, 0, 0), **words)


def test_many_waves_and_jumps_with_points_are_the_same_however_they_are_cut():
    """A jump with a point on it and with more; unloaded, a wavy leaf stays as it is drawn."""
    curve = ksd.FreeCurve.legendre([[0.5], [-2.0]], length=0.1, breaks=[0.37])
    once, more = (ksd.solve(bent(curve, marks)) for marks in ((0.37,), (0.2, 0.37, 0.6, 0.8)))
    assert once.displacement("tip") == pytest.approx(more.displacement("tip"), rel=1e-6, abs=1e-9)
    assert once.verify().relative < 1e-6
    waves = ksd.FreeCurve.sine([0.0] * 19 + [0.5], length=0.1)
    cuts = np.linspace(0, 1, 41)[1:-1]
    assert ksd.solve(bent(waves, cuts)).trusted


def test_where_the_drawn_shape_is_not_kept_is_said_of_the_leaf_that_was_drawn():
    waves = ksd.FreeCurve.sine([0.0] * 19 + [0.5], length=0.1)
    with pytest.raises(
        ksd.SceneError, match=r"leaf 'w': its curve bends to and fro .*mechanism.point\('w', s\)"
    ):
        ksd.solve(bent(waves))
    with pytest.raises(ksd.SceneError, match=r"leaf 'w', from s = 0 to 50 mm,: its curve bends"):
        ksd.solve(bent(waves, (0.5,)))
    jump = ksd.FreeCurve.legendre([[0.5], [-2.0]], length=0.1, breaks=[0.37])
    with pytest.raises(
        ksd.SceneError, match=r"leaf 'w' has breaks of its curvature at s = 37 mm.*put a point at each"
    ):
        ksd.solve(bent(jump))
    # below a thousandth of the chord it is an answer, which says so
    small = ksd.FreeCurve.legendre([[0.5], [0.0]], length=0.1, breaks=[0.37])
    said = [w for w in ksd.solve(bent(small)).warnings if "drawn shape" in w]
    assert said and "'w'" in said[0] and "s = 0.037 m" in said[0]
    assert not [w for w in ksd.solve(bent(small, (0.37,))).warnings if "drawn shape" in w]
