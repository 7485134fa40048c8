"""Curling of wide leaf springs with clamped ends, against plates of scikit-fem and in its limits."""

import numpy as np
import pytest
from ashwell import plate_factor
from numpy.testing import assert_allclose

from ksd.elements.plate_energy import curl_loss, plate_point
from ksd.section.along_leaf import element_edges, element_points
from ksd.section.plate import (
    PlateStiffening,
    Strips,
    curl_along,
    free_curl,
)


def curling(width, length, nu, *, own=0.0, held=(True, True), thickness=None):
    """(weights, x in -1..1, `Curling`) of a uniform strip, which is thin unless a thickness is given."""
    thickness = thickness or 1e-4 * width
    edges = element_edges(length, width) * length
    x, weight = element_points()
    at = edges[:-1, None] + np.diff(edges)[:, None] * x
    one = np.ones(at.shape)
    strips = Strips(width * one, thickness * one, nu * one, one, own * one)
    return np.diff(edges)[:, None] * weight / length, 2 * at / length - 1, curl_along(edges, strips, held)[0]


def stiffening(width, length, nu, **words):
    """Factors on the bending stiffness under a constant moment, and under a linear one of mean 0."""
    weight, x, found = curling(width, length, nu, **words)
    c = weight * found.compliance
    return 1.0 / c.sum(), 1.0 / (3.0 * (c * x * x).sum())


def plate_stiffening(width, length, nu, cells=12):
    """`stiffening` of a clamped Kirchhoff plate of Morley elements, extrapolated over two meshes.

    Both ends stay straight and clamped; the far one is turned about its own line, or moved.
    """
    from skfem import Basis, BilinearForm, ElementTriMorley, MeshTri, condense, solve
    from skfem.helpers import dd, ddot, eye, trace

    @BilinearForm
    def energy(u, v, _):
        return ddot((1.0 - nu) * dd(u) + nu * eye(trace(dd(u)), 2), dd(v))

    found = []
    for n in (cells, 2 * cells):
        # finer towards the clamps
        along = 0.5 * length * (1.0 - np.cos(np.linspace(0.0, np.pi, 2 * n + 1)))
        mesh = MeshTri.init_tensor(along, np.linspace(0.0, width, n + 1))
        basis = Basis(mesh, ElementTriMorley())
        K = energy.assemble(basis)
        near, far = (basis.get_dofs(lambda x, at=at: np.isclose(x[0], at)) for at in (0.0, length))
        motions = np.zeros((2, basis.N))
        # all facets of an end have the same normal
        motions[0, far.facet["u_n"]] = motions[1, far.nodal["u"]] = 1.0
        fixed = np.union1d(near.flatten(), far.flatten())
        w = np.array([solve(*condense(K, x=u, D=fixed)) for u in motions])
        (turn, both), (_, move) = w @ (K @ w.T)
        # turned with the end free to move, and moved without turning; of a beam 1/L and 12/L^3
        found.append(np.array([turn - both**2 / move, move * length**2 / 12.0]) * length)
    return (found[1] + (found[1] - found[0]) / 3.0) / (width * (1.0 - nu**2))


@pytest.mark.parametrize(
    ("width", "length", "nu"),
    [(20e-3, 60e-3, 0.3), (40e-3, 50e-3, 0.3), (40e-3, 50e-3, 0.45), (10e-3, 100e-3, 0.3)],
)
def test_clamps_stiffen_a_leaf_as_they_do_a_plate(width, length, nu):
    """To 3 % of the effect, of bending by a moment and of ends kept parallel."""
    plate = plate_stiffening(width, length, nu)
    assert_allclose(np.array(stiffening(width, length, nu)) - 1.0, plate - 1.0, rtol=0.03)


def moment_at_the_clamp(width, length, nu, cells=4):
    """Moment per width in the middle of a clamp over its mean, of half a clamped Kirchhoff plate of Argyris elements:
    bent by a moment, and with its ends kept parallel."""
    from skfem import Basis, BilinearForm, ElementTriArgyris, MeshTri, condense, solve
    from skfem.helpers import dd, ddot, eye, trace

    @BilinearForm
    def energy(u, v, _):
        return ddot((1.0 - nu) * dd(u) + nu * eye(trace(dd(u)), 2), dd(v))

    along = 0.5 * length * (1.0 - np.cos(np.linspace(0.0, np.pi, 2 * cells + 1)))
    mesh = MeshTri.init_tensor(along, 0.5 * width * np.linspace(0.0, 1.0, cells // 2 + 1))
    basis = Basis(mesh, ElementTriArgyris())
    K = energy.assemble(basis)
    near, far = (basis.get_dofs(lambda x, at=at: np.isclose(x[0], at)) for at in (0.0, length))
    middle = basis.get_dofs(lambda x: np.isclose(x[1], 0.0))
    fixed = [d.nodal[n] for d in (near, far) for n in ("u", "u_x", "u_y", "u_yy", "u_xy")]
    fixed += [middle.nodal["u_y"], middle.nodal["u_xy"], *(d.facet["u_n"] for d in (near, far, middle))]
    motions = np.zeros((2, basis.N))
    motions[0, far.nodal["u_x"]] = motions[1, far.nodal["u"]] = 1.0
    # a plane w = x, for the sense of its normals, which is another in each version of scikit-fem
    plane = np.zeros(basis.N)
    plane[basis.nodal_dofs[0]], plane[basis.nodal_dofs[1]] = mesh.p[0], 1.0
    motions[0, far.facet["u_n"]] = solve(*condense(K, x=plane, D=np.ravel(basis.nodal_dofs)))[
        far.facet["u_n"]
    ]
    w = np.array([solve(*condense(K, x=u, D=np.unique(np.concatenate(fixed)))) for u in motions])
    (turn, both), (_, move) = w @ (K @ w.T)
    (node,) = np.flatnonzero((mesh.p[0] == 0.0) & (mesh.p[1] == 0.0))
    bend = w[:, basis.nodal_dofs[basis.elem.dofnames.index("u_xx"), node]]
    bent = (bend[0] - both / move * bend[1]) / (turn - both**2 / move)
    return 0.5 * width * np.abs([bent, bend[1] / (0.5 * move * length)])


@pytest.mark.parametrize(
    ("width", "length", "nu"), [(20e-3, 60e-3, 0.3), (40e-3, 50e-3, 0.3), (10e-3, 60e-3, 0.45)]
)
def test_stress_across_the_width_at_a_clamp_is_that_of_a_plate(width, length, nu):
    """In the middle it is up to a third more than the mean; far from clamps it is even."""
    edges = element_edges(length, width)
    one = np.ones((len(edges) - 1, 4))
    strips = Strips(width * one, 1e-4 * width * one, nu * one, one, 0 * one)
    found, uneven = curl_along(edges * length, strips, (True, True))
    values = (np.ravel(found), np.concatenate([np.ravel(u) for u in uneven]))
    plate = PlateStiffening(tuple(edges), tuple(values[0]), uneven=tuple(values[1]))
    s, z = np.array([0.0, 0.5, 1.0]), np.zeros((3, 1))
    moments = np.stack([np.ones(3), 1.0 - 2.0 * s])
    more = plate.moment_across(s, z, moments)[..., 0]
    assert_allclose(1.0 + more[:, 0], moment_at_the_clamp(width, length, nu), rtol=0.015)
    assert_allclose(more[:, 2], more[:, 0] * moments[:, 2], rtol=1e-9)
    # the mean is the moment of the section
    y, weight = np.polynomial.legendre.leggauss(12)
    assert_allclose(plate.moment_across(s, np.tile(y, (3, 1)), moments) @ weight, 0.0, atol=1e-12)


def test_guides_have_the_stiffness_of_conforming_plates():
    """Argyris elements, converging from above."""
    sizes = ((60, 20), (100, 20), (50, 40), (100, 50))
    found = [100 * (stiffening(w * 1e-3, L * 1e-3, 0.3)[1] - 1.0) for L, w in sizes]
    assert_allclose(found, [5.45, 3.75, 7.95, 6.78], rtol=0.01)


def test_the_closed_form_of_one_function_is_an_upper_bound():
    """A leaf much longer than wide: with v + (y^2 - w^2/12) g each clamp takes nu^2 (1/m1 + 1/m2) of its length, m the roots
    of w^4/180 m^4 - 2/3 (1 - nu) w^2 m^2 + 4 (1 - nu^2)."""
    nu, width, length = 0.3, 1e-3, 1.0
    square = np.roots([1.0 / 180.0, -(2.0 / 3.0) * (1.0 - nu), 4.0 * (1.0 - nu**2)])
    layer = (1.0 / np.sqrt(square.astype(complex))).sum().real * width
    bound = 2.0 * nu**2 * layer / length
    effect = stiffening(width, length, nu)[0] - 1.0
    assert 0.85 * bound < effect < bound


@pytest.mark.parametrize("nu", [-0.5, 0.1, 0.3, 0.45])
def test_stiffening_lies_between_beam_and_plate(nu):
    most, before = 1.0 / (1.0 - nu**2), (1.0, 1.0)
    for ratio in (1e-4, 0.01, 0.1, 0.3, 0.8, 3.0, 30.0, 1e3):
        found = stiffening(ratio, 1.0, nu)
        assert np.all(np.array(before) < found) and np.all(np.array(found) < most)
        before = found
    assert_allclose(before, most, rtol=1e-4)
    assert_allclose(stiffening(1e-6, 1.0, nu), 1.0, atol=1e-5)


def test_without_lateral_contraction_nothing_is_stiffer():
    assert np.array_equal(curling(0.02, 0.06, 0.0)[2].compliance, np.ones((20, 4)))


def test_far_from_clamps_a_leaf_is_a_strip():
    """In the middle of a leaf 1000 times longer than wide: the beam at rest, Ashwell's strip with its own curvature."""
    for own in (0.0, 20.0, 3e3):
        _, _, found = curling(1e-3, 1.0, 0.3, own=own, thickness=1e-5)
        p = np.sqrt(np.sqrt(3 * 0.91) * 1e-6 * own / 1e-5)
        middle = len(found.compliance) // 2
        assert_allclose(found.compliance[middle], 0.91 / (1.0 - 0.09 * free_curl(np.array(p))), rtol=1e-6)
        # these act by nu^2, so that the factor is that of the strip to 1e-6
        assert_allclose([found.loss[middle], found.rate[middle]], 1.0, rtol=1e-5)


def test_an_end_that_nothing_holds_stiffens_nothing():
    both, one, none = (
        stiffening(2e-3, 0.1, 0.3, held=h)[0] - 1.0 for h in ((True, True), (True, False), (False, False))
    )
    assert one == pytest.approx(0.5 * both, rel=1e-3) and abs(none) < 1e-6 * both


@pytest.mark.parametrize("p", [1e-3, 0.3, 2.0, 5.9, 6.1, 20.0, 200.0])
def test_the_energy_far_from_clamps_is_that_of_ashwells_strip(p):
    """Its derivative is his moment, and the derivative of that by finite differences."""
    width, thickness, nu = 40e-3, 1e-3, 0.3
    B = 3.0 * (1.0 - nu**2) * (width**2 / thickness) ** 2
    curvature = p**2 / np.sqrt(B)
    value = np.array([nu**2 / (1.0 - nu**2), B, 1.0, 1.0, 0.0])
    moment, stiffness = plate_point(value, 0, curvature, curvature)
    factor = plate_factor(width, thickness, curvature, nu)
    assert 1.0 + moment / curvature == pytest.approx(factor, rel=1e-13)
    h = 1e-5 * curvature
    sides = [plate_point(value, 0, curvature + s, curvature + s)[0] for s in (h, -h)]
    assert (sides[0] - sides[1]) / (2 * h) == pytest.approx(stiffness, rel=1e-7)
    assert curl_loss(B * curvature**2)[0] == pytest.approx(
        1.0 / free_curl(np.array(p)) - 1.0, rel=1e-6, abs=1e-13
    )
