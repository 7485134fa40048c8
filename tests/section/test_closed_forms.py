"""Closed forms of rectangle, circle and tube, the warping factor, and the sentence each bad number gets."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

import ksd.section as section
from ksd.errors import SceneError
from ksd.section import circle, numbers, rectangle, restrained_warping_factor, tube
from ksd.section.along_leaf import element_edges
from ksd.section.closed_forms import clamped_ends_factor, rectangles
from ksd.section.warping import Piece, Slice, twist_along, warping_decay


def test_rectangle_moments_follow_the_stated_axes():
    leaf = rectangle(1e-3, 40e-3)
    assert pytest.approx(4e-5) == leaf.A
    assert leaf.Iz == pytest.approx(40e-3 * 1e-9 / 12)
    assert leaf.Iy == pytest.approx(1e-3 * 64e-6 / 12)
    assert (leaf.ky, leaf.kz) == (5 / 6, 5 / 6)
    assert (leaf.thickness, leaf.width) == (1e-3, 40e-3)


@pytest.mark.parametrize(
    ("aspect", "factor"),
    # Timoshenko and Goodier, Theory of Elasticity (1970), art. 109, table of k1
    [(1, 0.1406), (1.5, 0.1958), (2, 0.229), (3, 0.263), (5, 0.291), (10, 0.312), (1e6, 1 / 3)],
)
def test_torsion_of_rectangle_against_the_book(aspect, factor):
    assert rectangle(1.0, aspect).J / aspect == pytest.approx(factor, abs=5.1e-4)
    assert pytest.approx(rectangle(1.0, aspect).J, rel=1e-14) == rectangle(aspect, 1.0).J


def test_torsion_of_square_to_many_digits():
    assert pytest.approx(0.140577014955, rel=1e-10) == rectangle(1.0, 1.0).J


def test_warping_of_a_strip_tends_to_its_thin_limit():
    strip = rectangle(1e-3, 1.0)
    assert strip.Iw == pytest.approx((1e-3) ** 3 / 144, rel=1e-5)
    assert rectangle(1.0, 2.0).Iw == pytest.approx(rectangle(2.0, 1.0).Iw)


def test_scaling_with_length():
    small, large = rectangle(1e-6, 3e-6), rectangle(1.0, 3.0)
    for key, power in {"A": 2, "J": 4, "Iy": 4, "Iz": 4, "Iw": 6, "ky": 0}.items():
        assert getattr(small, key) == pytest.approx(getattr(large, key) * 1e-6**power, rel=1e-12)


def test_cowper_option():
    assert rectangle(1, 2, cowper=0.3).ky == pytest.approx(10 * 1.3 / (12 + 3.3))
    assert circle(1, cowper=0.3).kz == pytest.approx(6 * 1.3 / (7 + 1.8))
    assert tube(1, 0.5, cowper=0.0).ky == tube(1, 0.5).ky
    assert tube(1, 1e-6).ky == pytest.approx(circle(1).ky)
    assert tube(1, 0.999999).ky == pytest.approx(0.5, rel=1e-5)


def test_circle_and_tube():
    assert pytest.approx(math.pi / 2) == circle(2.0).J
    assert pytest.approx(math.pi / 2 * (1 - 1 / 16)) == tube(2.0, 1.0).J
    assert pytest.approx(math.pi * 0.75) == tube(2.0, 1.0).A


@pytest.mark.parametrize(("aspect", "factor"), [(1, 1.828058), (3, 1.183652)])
def test_restrained_warping_factor(aspect, factor):
    # acceptance.md A, nu = 0.3
    assert restrained_warping_factor(length=aspect * 0.02, width=0.02, nu=0.3) == pytest.approx(
        factor, abs=5e-7
    )


def test_warping_factor_limits():
    assert restrained_warping_factor(length=1e4, width=1.0, nu=0.3) == pytest.approx(1.0, rel=1e-4)
    left, right = (
        restrained_warping_factor(length=2.32e-3, width=1.0, nu=0.3),
        restrained_warping_factor(length=2.33e-3, width=1.0, nu=0.3),
    )
    assert left > right > 0


@pytest.mark.parametrize("x", [1e-4, 9e-3])
def test_warping_factor_of_a_very_short_piece(x):
    """Against x - 2 tanh(x/2) = x^3/12 (1 - x^2/10 + 17 x^4/1680 - ..), from the series of the hyperbolic tangent."""
    assert clamped_ends_factor(x) == pytest.approx(12 / x**2 / (1 - x**2 / 10 + 17 * x**4 / 1680), rel=1e-11)


def test_rigidity_and_compliance_order():
    s = rectangle(1e-3, 40e-3)
    GJ, EIy, EIz = s.rigidity(E=200e9, G=77e9)
    assert (GJ, EIy, EIz) == (77e9 * s.J, 200e9 * s.Iy, 200e9 * s.Iz)
    assert EIy > 1000 * EIz
    axial, along_y, along_z = s.compliance(E=200e9, G=77e9)
    assert axial == pytest.approx(1 / (200e9 * s.A))
    assert along_y == along_z == pytest.approx(1 / (5 / 6 * 77e9 * s.A))


def test_given_numbers_and_equality():
    given = numbers(A=1e-5, J=2e-12, Iy=3e-12, Iz=4e-12, ky=0.8)
    assert (given.A, given.J, given.Iy, given.Iz, given.ky, given.kz) == (
        1e-5,
        2e-12,
        3e-12,
        4e-12,
        0.8,
        5 / 6,
    )
    assert given == numbers(A=1e-5, J=2e-12, Iy=3e-12, Iz=4e-12, ky=0.8)
    assert hash(given) == hash(numbers(A=1e-5, J=2e-12, Iy=3e-12, Iz=4e-12, ky=0.8))


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: rectangle(0, 1), ["rectangle", "thickness = 0", "positive"]),
        (lambda: rectangle(-1e-3, 1), ["thickness = -0.001 m", "positive"]),
        (lambda: rectangle(1, math.nan), ["width = nan", "finite"]),
        (lambda: rectangle(1, math.inf), ["width = inf", "finite"]),
        (lambda: rectangle("1 mm", 1), ["thickness = '1 mm'", "not a number"]),
        (lambda: rectangle(True, 1), ["thickness = True", "not a number"]),
        (lambda: rectangle(1, 1, cowper=0.7), ["Poisson", "0.7", "-1"]),
        (lambda: circle(None), ["diameter = None", "not a number"]),
        (lambda: circle(10**400), ["diameter", "finite"]),
        (lambda: circle(1 << 50000), ["too long to print", "finite"]),
        (lambda: tube(1, 1), ["inner = 1", "smaller than outer = 1"]),
        (lambda: tube(1, 0), ["inner = 0", "positive"]),
        (lambda: numbers(A=-1, J=1, Iy=1, Iz=1), ["A = -1", "positive"]),
        (lambda: numbers(A=1, J=1, Iy=1, Iz=1, Iw=-1), ["Iw = -1", "zero or positive"]),
        (lambda: numbers(A=1, J=1, Iy=1, Iz=1, shear_centre=(1,)), ["point", "two numbers"]),
        (lambda: numbers(A=1, J=1, Iy=1, Iz=1, outline=3), ["outline = 3", "rings"]),
        (lambda: numbers(A=1, J=1, Iy=1, Iz=1, name=3), ["name = 3", "text"]),
        (lambda: restrained_warping_factor(length=0, width=1, nu=0.3), ["length = 0", "positive"]),
        (lambda: restrained_warping_factor(length=1, width=1, nu=-2), ["nu = -2", "between"]),
    ],
)
def test_bad_numbers_get_a_sentence(make, words):
    with pytest.raises(SceneError) as caught:
        make()
    message = str(caught.value)
    assert all(word in message for word in words), message
    assert "\n" not in message


def test_public_names():
    assert set(section.__all__) == {
        "Section", "circle", "numbers", "polygon", "rectangle", "restrained_warping_factor", "tube",
    }  # fmt: skip


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_a_thin_tube_has_the_shear_coefficient_cowper_prints(nu):
    """2 (1 + nu)/(4 + 3 nu) of a thin round tube: G. R. Cowper, J. Applied Mechanics 33 (1966), table 1."""
    assert tube(1, 0.999999, cowper=nu).ky == pytest.approx(2 * (1 + nu) / (4 + 3 * nu), rel=1e-5)


def test_a_thick_tube_has_the_shear_coefficient_cowper_prints():
    """The hollow circle of the same table at m = 1/2, nu = 0.3: 12.1875 / 19.65."""
    assert tube(1, 0.5, cowper=0.3).kz == pytest.approx(12.1875 / 19.65, rel=1e-12)


@pytest.mark.parametrize(("thickness", "width"), [(1e-3, 2e-2), (2e-2, 1e-3), (1e-6, 1e-6), (0.5, 40.0)])
def test_a_rectangle_passes_the_checks_of_a_section(thickness, width):
    """It is made past them: made anew with all checks it is the same."""
    made = rectangle(thickness, width)
    again = replace(made)
    assert again == made and hash(again) == hash(made) and repr(again) == repr(made)


@pytest.mark.parametrize(
    ("thickness", "width", "words"),
    [
        (1e-40, 1e-3, "J = 3.33333"), (1e29, 1e29, "A = 9.99999"), (1e-3, 1e29, "Iy = 8.33333"),
        (1e15, 1e-10, "Iz = 8.33333"),
    ],
)  # fmt: skip
def test_a_rectangle_out_of_all_bounds_is_refused(thickness, width, words):
    with pytest.raises(SceneError, match=words):
        rectangle(thickness, width)


def test_many_rectangles_are_those_made_one_by_one(rng):
    thickness = 10.0 ** rng.uniform(-5, -2, 50)
    width = thickness * 10.0 ** rng.uniform(-2, 2, 50)
    found = rectangles(thickness, width)
    each = [rectangle(t, w) for t, w in zip(thickness.tolist(), width.tolist(), strict=True)]
    for name, values in found._asdict().items():
        assert values == pytest.approx([getattr(q, name) for q in each], rel=1e-12), name
    # a square by its series written out
    series = sum(math.tanh(0.5 * n * math.pi) / n**5 for n in range(1, 2000, 2))
    ((square,),) = rectangles(np.ones(1), np.ones(1))[1:2]
    assert square == pytest.approx(1 / 3 - 64 / math.pi**5 * series, rel=1e-12)
    with pytest.raises(SceneError, match=r"Iy = 8\.33333"):
        rectangles(np.array([1e-3, 1e-3]), np.array([1.0, 1e29]))


def test_pieces_of_a_run_twist_as_the_solutions_of_vlasov_joined(rng):
    """g = T/GJ + a cosh ks + b sinh ks in every slice; g and GJ/k^2 g' go on, g = 0 at both ends."""
    for counts in ((1,), (1, 1), (2, 1, 3)):
        run = [[Slice(*rng.uniform(0.4, 2.0, 3)) for _ in range(n)] for n in counts]
        slices = [s for piece in run for s in piece]
        n = len(slices)
        A, right = np.zeros((2 * n, 2 * n)), np.zeros(2 * n)
        A[0, 0], right[0], right[-1] = 1.0, -1.0 / slices[0].stiffness, -1.0 / slices[-1].stiffness
        for i, (length, stiff, k) in enumerate(slices):
            c, s, at = math.cosh(k * length), math.sinh(k * length), slice(2 * i, 2 * i + 2)
            A[2 * i + 1, at] = c, s
            if i + 1 < n:
                _, after, k_after = slices[i + 1]
                A[2 * i + 1, 2 * i + 2], right[2 * i + 1] = -1.0, 1.0 / after - 1.0 / stiff
                A[2 * i + 2, at], A[2 * i + 2, 2 * i + 3] = np.array([s, c]) * stiff / k, -after / k_after
        a, b = np.linalg.solve(A, right).reshape(n, 2).T
        length, stiff, k = np.array(slices).T
        twist = length / stiff + (a * np.sinh(k * length) + b * (np.cosh(k * length) - 1.0)) / k
        ends = np.cumsum([0, *counts])
        exact = [(length / stiff)[i:j].sum() / twist[i:j].sum() for i, j in itertools.pairwise(ends)]
        pieces = [Piece(each, np.linspace(0.0, 1.0, 9)) for each in run]
        assert [twist.factor for twist in twist_along(pieces)] == pytest.approx(exact, rel=1e-9)


@pytest.mark.parametrize("x", [0.5, 5.0, 13.6, 50.0])
def test_a_torque_that_changes_along_a_leaf(x):
    """Vlasov's g'' - x^2 g = -x^2 T for T = 1 and 2 s - 1, GJ and the length 1, and its work."""
    (twist,) = twist_along([Piece([Slice(1.0, 1.0, x)], element_edges(1.0, 4.3 / x))])
    y, weight = np.polynomial.legendre.leggauss(12)
    cuts = np.array(twist.edges)
    s = (cuts[:-1, None] + np.diff(cuts)[:, None] * 0.5 * (1.0 + y)).ravel()
    weight = (np.diff(cuts)[:, None] * 0.5 * weight).ravel()
    rate, line = twist.compliance(s) / twist.factor, 2.0 * s - 1.0
    constant = 1.0 - np.cosh(x * (s - 0.5)) / np.cosh(0.5 * x)
    linear = line - np.sinh(x * (s - 0.5)) / np.sinh(0.5 * x)
    assert weight @ rate == pytest.approx(weight @ constant, rel=1e-9)
    assert weight @ (rate * line**2) == pytest.approx(weight @ (linear * line), rel=1e-4)
    assert rate.min() > -2e-3
    assert twist.turned().compliance(s) == pytest.approx(twist.compliance(1.0 - s), abs=1e-12)


def test_decay_of_warping():
    assert warping_decay(rectangle(1e-3, 0.02), 200e9, 0.3, 77e9) == pytest.approx(math.sqrt(24 / 1.3) / 0.02)
    given = numbers(A=1e-5, J=2e-12, Iy=3e-12, Iz=4e-12, Iw=5e-18)
    assert warping_decay(given, 200e9, 0.3, 77e9) == pytest.approx(math.sqrt(77e9 * 2e-12 / (200e9 * 5e-18)))
