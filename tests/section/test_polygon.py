"""Any outline by finite elements, against closed forms, thin-walled theory and invariance."""

import math
import subprocess
import sys

import numpy as np
import pytest

from ksd.errors import SceneError
from ksd.section import circle, polygon, rectangle, tube
from ksd.section.outline_mesh import edge_distance, edges_of, element_sizes, triangulate

KEYS = ("A", "J", "Iy", "Iz", "Iw", "ky", "kz")


def box(t, w):
    return [(0.0, 0.0), (t, 0.0), (t, w), (0.0, w)]


def ring(radius, corners=96):
    angle = 2 * np.pi * np.arange(corners) / corners
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])


L_SHAPE = [(0, 0), (10, 0), (10, 1), (1, 1), (1, 10), (0, 10)]
T_SHAPE = [(0, 0), (10, 0), (10, 1), (5.5, 1), (5.5, 8), (4.5, 8), (4.5, 1), (0, 1)]
H_SHAPE = [
    (0, 0), (10, 0), (10, 1), (5.5, 1), (5.5, 9), (10, 9),
    (10, 10), (0, 10), (0, 9), (4.5, 9), (4.5, 1), (0, 1),
]  # fmt: skip
CHANNEL = [(0, 0), (5, 0), (5, 0.2), (0.2, 0.2), (0.2, 9.8), (5, 9.8), (5, 10), (0, 10)]


@pytest.mark.parametrize("aspect", [1, 2, 5, 20, 100])
def test_rectangle_against_the_exact_series(aspect):
    found, exact = polygon(box(1e-3, aspect * 1e-3)), rectangle(1e-3, aspect * 1e-3)
    for key in ("A", "Iy", "Iz"):
        assert getattr(found, key) == pytest.approx(getattr(exact, key), rel=1e-12)
    assert pytest.approx(exact.J, rel=5e-5) == found.J
    assert found.Iw == pytest.approx(exact.Iw, rel=2e-4)
    assert found.ky == pytest.approx(5 / 6, rel=1e-8)
    assert found.kz == pytest.approx(5 / 6, rel=1e-8)
    assert found.shear_centre == pytest.approx((0.0, 0.0), abs=1e-9)
    assert (found.tilt, found.width, found.thickness) == pytest.approx((0.0, aspect * 1e-3, 1e-3))


def test_shear_coefficient_depends_on_poisson_as_published():
    # measured-facts.md: 10:1 strip loaded along its thin side, 5/6 at nu = 0 and 0.18 at nu = 0.3
    strip = polygon(box(1.0, 10.0), nu=0.3)
    assert strip.ky == pytest.approx(0.18, abs=0.005)
    assert strip.kz == pytest.approx(5 / 6, abs=0.001)
    # Love (1927): circle (energy coefficient), 6 (1+nu)^2 / (7 + 14 nu + 8 nu^2)
    assert polygon(ring(1.0), nu=0.3).ky == pytest.approx(6 * 1.69 / (7 + 4.2 + 0.72), rel=1e-3)


def test_shear_coefficients_at_any_poisson_ratio_change_places_with_the_axes():
    wedge = np.array([(0.0, 0.0), (6.0, 0.0), (3.0, 4.0)])
    one, other = polygon(wedge, nu=0.3), polygon(wedge[::-1, ::-1], nu=0.3)
    assert abs(one.ky - polygon(wedge).ky) > 1e-3 * one.ky and abs(one.ky / one.kz - 1) > 0.01
    assert (one.ky, one.kz) == pytest.approx((other.kz, other.ky), rel=1e-4)
    assert polygon(box(3.0, 1.0), nu=0.3).kz == pytest.approx(polygon(box(1.0, 3.0), nu=0.3).ky, rel=1e-6)


def test_circle_and_tube_polygons():
    found, exact = polygon(ring(1.0, 256)), circle(2.0)
    for key in ("A", "J", "Iy", "Iz", "ky", "kz"):
        assert getattr(found, key) == pytest.approx(getattr(exact, key), rel=3e-4)
    assert found.Iw < 1e-8
    for inner in (0.4, 0.95):
        found, exact = polygon(ring(1.0, 256), [ring(inner, 256)]), tube(2.0, 2 * inner)
        for key in ("A", "J", "Iy", "Iz", "ky", "kz"):
            assert getattr(found, key) == pytest.approx(getattr(exact, key), rel=3e-4)


def test_thin_square_tube_against_bredt():
    outer, inner = box(1.0, 1.0), [(0.02, 0.02), (0.98, 0.02), (0.98, 0.98), (0.02, 0.98)]
    enclosed, middle = 0.98**2, 4 * 0.98
    bredt = 4 * enclosed**2 * 0.02 / middle + middle * 0.02**3 / 3
    coarse = polygon(outer, [inner]).J
    # the corners are stiffer than walls alone
    assert bredt < coarse < 1.012 * bredt
    assert coarse == pytest.approx(polygon(outer, [inner], mesh_size=4e-3).J, rel=1e-4)


def test_channel_shear_centre_and_warping_against_thin_walls():
    found = polygon(CHANNEL)
    b, h, t = 4.9, 9.8, 0.2
    e = 3 * b**2 / (6 * b + h)
    centroid = b**2 / (2 * b + h)
    assert found.shear_centre[0] == pytest.approx(-(e + centroid), rel=3e-3)
    assert found.shear_centre[1] == pytest.approx(0.0, abs=1e-4)
    # Timoshenko and Gere, Theory of Elastic Stability, appendix: channel of constant thickness
    warping = t * b**3 * h**2 / 12 * (3 * b + 2 * h) / (6 * b + h)
    assert found.Iw == pytest.approx(warping, rel=1e-2)
    assert pytest.approx((2 * b + h) * t**3 / 3, rel=1e-2) == found.J


def test_warping_of_h_profile():
    found = polygon(H_SHAPE)
    # two flanges 9 apart, each of second moment 1000/12
    assert found.Iw == pytest.approx(1000 / 12 / 2 * 81, rel=2e-2)
    assert found.shear_centre == pytest.approx((0.0, 0.0), abs=1e-5)


@pytest.mark.parametrize("outline", [L_SHAPE, T_SHAPE, H_SHAPE], ids=["L", "T", "H"])
def test_mesh_refinement_changes_nothing_visible(outline):
    coarse, fine = polygon(outline), polygon(outline, mesh_size=0.12)
    for key in KEYS:
        assert getattr(coarse, key) == pytest.approx(getattr(fine, key), rel=2e-4)


def test_shear_centre_of_angle_is_at_the_crossing_of_its_legs():
    found = polygon(L_SHAPE)
    assert abs(found.tilt) == pytest.approx(math.pi / 4)
    centroid = np.array([(10 * 5 + 9 * 0.5) / 19] * 2)
    c, s = math.cos(found.tilt), math.sin(found.tilt)
    drawn = centroid + np.array([[c, -s], [s, c]]) @ np.array(found.shear_centre)
    assert drawn == pytest.approx([0.5, 0.5], abs=0.15)


@pytest.mark.parametrize(("t", "w"), [(1.0, 3.0), (3.0, 1.0)], ids=["upright", "flat"])
@pytest.mark.parametrize("angle", [-0.75, -0.3, 0.0, 0.3, 0.75])
def test_y_is_the_principal_axis_within_45_degrees_of_the_one_drawn(t, w, angle):
    c, s = math.cos(angle), math.sin(angle)
    found = polygon(np.array(box(t, w)) @ np.array([[c, s], [-s, c]]))
    assert found.tilt == pytest.approx(angle, abs=1e-9)
    assert (found.thickness, found.width) == pytest.approx((t, w), rel=1e-9)
    assert (found.Iz, found.Iy) == pytest.approx((w * t**3 / 12, t * w**3 / 12), rel=1e-9)


@pytest.mark.parametrize(("b", "h"), [(10, 5), (5, 10), (10, -5), (-5, 10)])
def test_principal_axes_of_an_angle_with_unequal_legs(b, h):
    """Second moments of two rectangles, b x 1 and 1 x (h - 1), by Steiner's theorem."""
    signs = np.sign([b, h])
    outline = np.array([(0, 0), (abs(b), 0), (abs(b), 1), (1, 1), (1, abs(h)), (0, abs(h))]) * signs
    sides = np.array([(abs(b), 1), (1, abs(h) - 1)], float)
    centres, areas = (np.array([(0, 0), (0, 1)]) + sides / 2) * signs, sides.prod(axis=1)
    arms = centres - areas @ centres / areas.sum()
    moment = np.einsum("k,ki,kj->ij", areas, arms, arms) + np.diag(areas @ sides**2 / 12)
    values, axes = np.linalg.eigh(moment)
    # the axis nearest to y, pointing along y
    nearest = int(np.argmax(np.abs(axes[0])))
    y, z = axes[:, nearest] * np.sign(axes[0, nearest])
    found = polygon(outline)
    assert found.tilt == pytest.approx(math.atan2(z, y), rel=1e-9)
    assert (found.Iz, found.Iy) == pytest.approx((values[nearest], values[1 - nearest]), rel=1e-9)


def test_turning_the_drawing_turns_nothing_but_the_tilt():
    straight = polygon(T_SHAPE)
    angle = 0.3
    c, s = math.cos(angle), math.sin(angle)
    turned = polygon(np.array(T_SHAPE, float) @ np.array([[c, s], [-s, c]]) + [5.0, -7.0])
    assert turned.tilt == pytest.approx(angle, abs=1e-9)
    for key in KEYS:
        assert getattr(turned, key) == pytest.approx(getattr(straight, key), rel=1e-4)
    assert turned.shear_centre == pytest.approx(straight.shear_centre, abs=1e-3)
    assert np.allclose(turned.outline[0], straight.outline[0], atol=1e-9)


def test_where_it_is_drawn_does_not_matter():
    """A kilometre from the origin it could not be meshed."""
    here = polygon([(0, 0), (1e-3, 0), (1e-3, 1e-2), (0, 1e-2)])
    there = polygon([(y + 1e3, z - 1e3) for y, z in ((0, 0), (1e-3, 0), (1e-3, 1e-2), (0, 1e-2))])
    for name in ("A", "J", "Iy", "Iz", "ky", "kz", "Iw"):
        assert getattr(there, name) == pytest.approx(getattr(here, name), rel=1e-8), name


def test_direction_of_drawing_and_closing_point_do_not_matter():
    first = polygon(L_SHAPE)
    assert pytest.approx(first.J, rel=1e-6) == polygon([*L_SHAPE[::-1], L_SHAPE[-1]]).J


def test_hole_off_centre():
    hole = [(0.1, 0.1), (0.4, 0.1), (0.4, 0.3), (0.1, 0.3)]
    found = polygon(box(1.0, 1.0), [hole])
    assert pytest.approx(1 - 0.06, rel=1e-12) == found.A
    assert len(found.outline) == 2
    assert found.J < rectangle(1.0, 1.0).J


# edges close to each other, whose points are not opposite each other: Delaunay's triangles do not follow them at once
NARROW = [box(1.0, 1.0), [(0.1, 0.5), (0.5, 0.9), (0.9, 0.5)], [(0.12, 0.499), (0.88, 0.499), (0.5, 0.1)]]


@pytest.mark.parametrize(
    ("rings", "area"), [([H_SHAPE], 28.0), (NARROW, 1 - 0.16 - 0.15162)], ids=["H", "narrow"]
)
def test_mesh_covers_the_outline_and_follows_its_edges(rings, area):
    points, triangles = triangulate([np.array(r, float) for r in rings], mesh_size=0.5)
    a, b, c = (points[triangles[:, k]] for k in range(3))
    u, v = b - a, c - a
    assert 0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]).sum() == pytest.approx(area, rel=1e-12)
    assert len(np.unique(triangles)) == len(points)
    sides, uses = np.unique(
        np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)), axis=0, return_counts=True
    )
    edges = edges_of([np.array(r, float) for r in rings])
    for end in (0, 0.5, 1):
        on = (1 - end) * points[sides[uses == 1, 0]] + end * points[sides[uses == 1, 1]]
        assert edge_distance(on, edges).max() < 1e-12 * edges.length.sum()


def test_a_mesh_is_as_fine_upright_as_flat():
    upright, flat = (len(triangulate([np.array(box(*sides))])[0]) for sides in ((0.1, 1.0), (1.0, 0.1)))
    assert upright == pytest.approx(flat, rel=0.05)


def test_elements_follow_the_local_thickness():
    """A wedge from 1 to 0.1: elements are about a quarter of the thickness there."""
    wedge = np.array([(0.0, -0.5), (10.0, -0.05), (10.0, 0.05), (0.0, 0.5)])
    sizes = element_sizes([wedge], None)
    thin, thick = sizes.at(np.array([(9.9, 0.0), (0.1, 0.0)]))
    assert thin == pytest.approx(0.025, rel=0.6) and thick == pytest.approx(0.25, rel=0.6)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: polygon([(0, 0), (1, 0)]), ["points", "2 different corners", "three"]),
        (lambda: polygon([(0, 0), (1, 0), (1, 0), (0, 0)]), ["different corners"]),
        (lambda: polygon([]), ["0 different corners"]),
        (lambda: polygon([(0, 0), (1, 0), (2, 0)]), ["no area"]),
        (lambda: polygon([(0, 0), (1, 1), (1, 0), (0, 1)]), ["no area"]),
        (lambda: polygon([(0, 0), (2, 1), (2, 0), (0, 3)]), ["meets the edge"]),
        (lambda: polygon([(0, 0), (1, math.nan), (1, 1)]), ["not finite"]),
        (lambda: polygon("abc"), ["must be points"]),
        (lambda: polygon([(0, 0), (1e200, 0), (0, 1)]), ["coordinate that is too large"]),
        # a spike without area, drawn there and back: it was meshed for ever
        (
            lambda: polygon([(0, 0), (1, 0), (1, 1), (0.5, 1), (0.5, 3), (0.5, 1), (0, 1)]),
            ["(0.5, 1.0) to (0.5, 3.0)", "must not cross or touch"],
        ),
        (
            lambda: polygon([(0, 0), (1, 0), (1, 1), (0.5, 1), (0.5 + 1e-9, 3), (0.5 - 1e-9, 1), (0, 1)]),
            ["needs more than"],
        ),
        (lambda: polygon([(0, 0, 0), (1, 0, 0), (1, 1, 0)]), ["must be points"]),
        (lambda: polygon(box(1, 1), [[(0.5, 0.5), (2, 0.5), (2, 0.6)]]), ["meets the edge"]),
        (lambda: polygon(box(1, 1), [[(2, 2), (3, 2), (3, 3)]]), ["holes[0]", "inside"]),
        (lambda: polygon(box(1, 1), [np.array(box(0.5, 0.5)) + 0.2, np.array(box(0.2, 0.2)) + 0.3]),
         ["holes[1]", "holes[0]"]),
        (lambda: polygon(box(1, 1), [[(0, 0.2), (0.5, 0.2), (0.5, 0.5)]]), ["touch"]),
        (lambda: polygon(box(1, 1), mesh_size=-1), ["mesh_size = -1", "positive"]),
        (lambda: polygon(box(1, 1), mesh_size=1e-4), ["points", "larger mesh_size"]),
        (lambda: polygon(box(1, 1), nu=0.8), ["nu", "0.8", "between"]),
    ],
)  # fmt: skip
def test_bad_outlines_get_a_sentence(call, words):
    with pytest.raises(SceneError) as caught:
        call()
    message = str(caught.value)
    assert all(word in message for word in words), message
    assert "\n" not in message


def test_finite_elements_are_imported_only_when_used():
    code = "import sys, ksd.section; sys.exit('skfem' in sys.modules or 'scipy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
