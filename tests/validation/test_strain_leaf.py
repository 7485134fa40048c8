"""One strain-mode leaf against closed forms and independent rods (acceptance A, D; errata, paper 3)."""

import numpy as np
import pytest
from published_beams import EI, ELASTICA, THIN, cantilever, elastica, inextensible
from published_beams import ISOTROPIC as STEEL
from scipy.interpolate import CubicSpline

import ksd
from ksd.elements.strain_values import DEFAULT_ORDERS, DEFAULT_POINTS
from ksd.model.mesh import Mesh
from ksd.units import deg

E = STEEL.E


@pytest.mark.parametrize("alpha", ELASTICA)
@pytest.mark.parametrize(
    "orders, points, tol",
    [(DEFAULT_ORDERS, DEFAULT_POINTS, 2e-7), ((5, 3, 6), 12, 2e-7), ((6, 4, 8), 12, 1e-8)],
)
def test_elastica(alpha, orders, points, tol):
    got = elastica(alpha, Mesh(orders=orders, points=points, shear=False))
    assert got == pytest.approx(ELASTICA[alpha], abs=tol)
    # default orders: 5e-9 under the small load
    assert alpha > 1 or got == pytest.approx(ELASTICA[alpha], abs=1e-8)


@pytest.mark.parametrize("alpha", ELASTICA)
def test_elastica_to_the_accuracy_asked_for(alpha):
    scene = ksd.Mechanism("cantilever")
    tip = scene.link("tip")
    words = {"section": inextensible(), "material": STEEL, "width_axis": (0, 0, 1)}
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0.1, 0, 0), **words)
    scene.load("tip", force=(0, alpha * EI / 0.01, 0), at=(0.1, 0, 0))
    for accuracy, reached in ((1e-3, 1e-6), (1e-5, 1e-6), (1e-6, 1e-7)):
        found = ksd.solve(scene, accuracy=accuracy)
        u = found.links["tip"][0] / 0.1
        assert (u[1], -u[0], found.rotation("tip")[2]) == pytest.approx(ELASTICA[alpha], abs=reached)


@pytest.mark.parametrize("leaf", ["strain", "n=10"])
def test_end_moment_rolls_up_to_a_circle(leaf):
    mesh = Mesh() if leaf == "strain" else Mesh("corotational", elements=10)
    found = cantilever(
        load={"moment": (0, 0, 2 * np.pi * EI / 0.1)}, mesh=mesh, section=inextensible(), steps=8
    )
    tip = 0.1 * np.array([1, 0, 0]) + found.links["tip"][0]
    assert np.linalg.norm(tip) < (1e-6 if leaf == "strain" else 1e-9) * 0.1


def test_axial_stiffness():
    found = cantilever(load={"force": (1000, 0, 0)})
    assert 1000 / found.links["tip"][0][0] == pytest.approx(E * THIN.A / 0.1, rel=1e-9)


def notch_compliance(ratio):
    """int 12 ds / (b t(s)^3) of the circular notch, times b R^2, by adaptive quadrature."""
    from scipy.integrate import quad

    return quad(
        lambda p: 12 * np.cos(p) / (ratio + 2 * (1 - np.cos(p))) ** 3, -np.pi / 2, np.pi / 2, limit=200
    )[0]


@pytest.mark.parametrize("ratio", [0.05, 0.1, 0.3, 0.4])
def test_circular_notch_over_its_range(ratio):
    R, b = 5e-3, 10e-3
    notch = ksd.CircularNotch(radius=R, minimum=ratio * R, width=b)
    found = cantilever(length=2 * R, load={"moment": (0, 0, 1e-3)}, section=notch.section(0.5), profile=notch)
    assert found.rotation("tip")[2] / 1e-3 * E * b * R**2 == pytest.approx(notch_compliance(ratio), rel=1e-3)


def arc_compliance(r, a):
    """Linear compliance (3, 3) of the clamped arc at its end frame (errata, paper 3, derived anew)."""
    s, c = np.sin(a), np.cos(a)
    C = np.array([
        [r**3 * (1.5 * a - 2 * s + s * c / 2), r**3 * (1 - c - s**2 / 2), r**2 * (a - s)],
        [0, r**3 * (a / 2 - s * c / 2), r**2 * (1 - c)],
        [0, 0, r * a],
    ])  # fmt: skip
    return (C + np.triu(C, 1).T) / EI


@pytest.mark.parametrize("angle", [90, 180, 270, 300])
def test_circular_arc_linear_compliance(angle):
    r, a = 0.05, angle * deg
    arc = ksd.Arc(radius=r, angle=a)
    # start at the origin along e1 of the arc; B's frame: x tangent pointing away from the beam, y towards the centre
    end = r * np.array([np.sin(a), 1 - np.cos(a), 0])
    axes = np.array([[np.cos(a), np.sin(a), 0], [-np.sin(a), np.cos(a), 0], [0, 0, 1]])
    C = np.zeros((3, 3))
    scale = 1e-7
    for k in range(3):
        force = scale * (axes[k] if k < 2 else np.zeros(3)) / r
        load = {"force": tuple(force)} if k < 2 else {"moment": (0, 0, scale)}
        found = cantilever(end=tuple(end), load=load, section=inextensible(), curve=arc)
        u = axes @ found.links["tip"][0]
        C[:, k] = np.array([u[0], u[1], found.rotation("tip")[2]]) / (scale / r if k < 2 else scale)
    expected = arc_compliance(r, a)
    size = np.sqrt(np.diag(expected))
    assert C / np.outer(size, size) == pytest.approx(expected / np.outer(size, size), abs=1e-6)


@pytest.mark.parametrize("a", [0.03, 0.1, 0.3])
def test_wavy_leaf(a):
    """Castigliano: y^2 / EI over the leaf is what a force along the chord moves its end; a force across bends and twists it.
    Angle sum a / i sin(2 pi i s). A curve that turns little and bends to and fro needs modes of its own about both: without,
    stiffness was 3 % off along and 1 % across."""
    wavy, section, force = ksd.FreeCurve.sine((a, a / 2, a / 3), chord=0.1), inextensible(), 1e-3
    s = np.linspace(0.0, 1.0, 2001)
    angle = sum(a / i * np.sin(2 * np.pi * i * s) for i in (1, 2, 3))
    x, y = (wavy.length * CubicSpline(s, way(angle)).antiderivative()(s) for way in (np.cos, np.sin))
    twist = y * np.cos(angle) + (0.1 - x) * np.sin(angle)
    bend = y * np.sin(angle) - (0.1 - x) * np.cos(angle)
    across = twist**2 / (STEEL.G * section.J) + bend**2 / (STEEL.E * section.Iy)
    for axis, energy in ((0, y**2 / EI), (2, across)):
        load = tuple(force * np.eye(3)[axis])
        expected = force * wavy.length * CubicSpline(s, energy).integrate(0.0, 1.0)
        moved = cantilever(end=(0.1, 0, 0), load={"force": load}, section=section, curve=wavy)
        assert moved.links["tip"][0][axis] == pytest.approx(expected, rel=2e-5)


def test_free_curve_equals_arc():
    a, r = 60 * deg, 0.05
    arc = ksd.Arc(radius=r, angle=a)
    free = ksd.FreeCurve(arc.length, lambda s: (0.0, 0.0, 1 / r))
    end = tuple(r * np.array([np.sin(a), 1 - np.cos(a), 0]))
    one, two = (cantilever(end=end, load={"force": (0, 20.0, 3.0)}, curve=c) for c in (arc, free))
    assert one.motion.x == pytest.approx(two.motion.x, abs=1e-12)


def test_curved_leaf_is_free_of_stress_at_rest():
    a, r = 200 * deg, 0.05
    end = tuple(r * np.array([np.sin(a), 1 - np.cos(a), 0]))
    found = cantilever(end=end, curve=ksd.Arc(radius=r, angle=a))
    assert np.abs(found.links["tip"][0]).max() < 1e-15
    assert np.abs(found.motion.inner[-6:]).max() < 1e-6


def test_curve_that_does_not_fit_its_ends_is_refused():
    with pytest.raises(ksd.SceneError, match=r"leaf 'leaf': its curve spans .* m from start to end"):
        cantilever(end=(0.2, 0, 0), curve=ksd.Arc(radius=0.05, angle=1.0))


def test_half_circle_about_the_strong_axis_is_refused():
    """Its chord lies along the width of its start, and says nothing of how the leaf is turned about it."""
    r = 0.05
    bent = ksd.FreeCurve(np.pi * r, lambda s: (0.0, 1 / r, 0.0))
    with pytest.raises(
        ksd.SceneError, match=r"leaf 'leaf': its curve ends straight along the width of its start"
    ):
        cantilever(end=(2 * r, 0, 0), curve=bent)


@pytest.mark.parametrize("elements", [8, 16, 32])
def test_chains_converge_to_the_tapered_leaf(elements):
    taper = ksd.Taper(thickness=(1e-3, 0.5e-3), width=(40e-3, 20e-3))
    words = {"load": {"force": (0, 5.0, 0)}, "section": taper.section(0.5), "profile": taper}
    exact = cantilever(**words).links["tip"][0][1]
    coarse, fine = (
        abs(cantilever(mesh=Mesh("corotational", elements=n), **words).links["tip"][0][1] / exact - 1)
        for n in (elements, 2 * elements)
    )
    assert np.log2(coarse / fine) == pytest.approx(2.0, abs=0.2)


def test_chains_converge_to_the_curved_leaf():
    a, r = 120 * deg, 0.05
    end = tuple(r * np.array([np.sin(a), 1 - np.cos(a), 0]))
    words = {"end": end, "load": {"force": (0, 3.0, 1.0)}, "curve": ksd.Arc(radius=r, angle=a)}
    exact = cantilever(**words).links["tip"][0]
    errors = [
        np.linalg.norm(cantilever(mesh=Mesh("corotational", elements=n), **words).links["tip"][0] - exact)
        for n in (8, 16)
    ]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.2)


def test_stiffened_middle_is_three_leaves_in_series():
    part, t, T = 0.4, 0.5e-3, 3e-3
    profile = ksd.StiffenedMiddle(thickness=t, width=40e-3, middle=T, part=part)
    found = cantilever(load={"moment": (0, 0, 0.1)}, section=profile.section(0.0), profile=profile)
    thin, thick = E * 40e-3 * t**3 / 12, E * 40e-3 * T**3 / 12
    assert found.rotation("tip")[2] == pytest.approx(0.1 * 0.1 * ((1 - part) / thin + part / thick), rel=1e-9)
