"""Buckling against closed forms: Euler columns, Prandtl's strip, the right-angle frame under end moments."""

import numpy as np
import pytest
from scenes import STEEL

import ksd
from ksd.model.compile import compile_scene
from ksd.model.leaves import Mesh
from ksd.properties.buckling import buckling
from ksd.section import rectangle
from ksd.solve.conventional import conventional

L = 0.1
CLAMPED = [("along", "y"), ("along", "z"), ("about", "x"), ("about", "y"), ("about", "z")]


def strip(held=(), thickness=0.5e-3, width=0.02, mesh=None):
    scene = ksd.Mechanism("strip")
    tip = scene.link("tip")
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(L, 0, 0), section=rectangle(thickness, width), material=STEEL,
        width_axis=(0, 0, 1), name="leaf",
    )  # fmt: skip
    for kind, axis in held:
        scene.support(tip, at=(L, 0, 0), **{kind: axis})
    return compile_scene(scene, mesh=mesh)


def euler(held, mesh=None):
    """Smallest compressive load over E I/L^2."""
    model = strip(held, mesh=mesh)
    found = buckling(model, model.rest, "tip", force=(-1, 0, 0), at=(L, 0, 0))
    return found.positive / (STEEL.E * 0.02 * 0.5e-3**3 / 12 / L**2)


def test_columns():
    assert euler(CLAMPED) == pytest.approx(4 * np.pi**2, rel=1e-3)
    assert euler(()) == pytest.approx(np.pi**2 / 4, rel=1e-4)
    # clamped-pinned: tan x = x
    assert euler([h for h in CLAMPED if h != ("about", "z")]) == pytest.approx(4.493409**2, rel=1e-3)
    # guided: pi^2
    assert euler([("about", "z"), ("about", "x"), ("about", "y"), ("along", "z")]) == pytest.approx(
        np.pi**2, rel=1e-3
    )


@pytest.mark.parametrize("n, expected", [(4, 1.2157), (8, 1.0523), (16, 1.0130)])
def test_clamped_column_of_appendix_A_elements(n, expected):
    """The chain converges from above, quadratically, as the mesh is refined."""
    assert euler(CLAMPED, Mesh("corotational", elements=n)) / (4 * np.pi**2) == pytest.approx(
        expected, abs=1e-3
    )


def test_prandtl_strip_buckles_sideways_either_way():
    """Narrow cantilever under a dead force at the centroid of its tip: 4.0126 sqrt(EI GJ)/L^2 (Prandtl
    1899)."""
    thickness, width = 0.2e-3, 0.02
    model = strip(thickness=thickness, width=width)
    q = rectangle(thickness, width)
    critical = 4.0126 * np.sqrt(STEEL.E * q.Iz * STEEL.G * q.J) / L**2
    for sign in (1, -1):
        found = buckling(model, model.rest, "tip", force=(0, 0, sign), at=(L, 0, 0))
        assert found.positive == pytest.approx(critical, rel=2e-3)
        assert found.negative == pytest.approx(-critical, rel=2e-3)


def test_right_angle_frame():
    """Argyris et al. 1979: legs 240, 30 x 0.6, E 71240 MPa, nu .31, moments on simply supported ends,
    M_cr = pi sqrt(EI GJ)/L (622.2 Nmm with J = w t^3/3; 618.3 with the exact J of the rectangle)."""
    stuff, leg = ksd.Material(E=71240e6, nu=0.31), 0.24
    q = rectangle(0.6e-3, 30e-3)
    scene = ksd.Mechanism("frame")
    left, corner, right = scene.links("left", "corner", "right")
    r = leg / np.sqrt(2)
    for name, a, b, start, end in (
        ("one", left, corner, (-r, 0, 0), (0, r, 0)),
        ("two", corner, right, (0, r, 0), (r, 0, 0)),
    ):
        along = np.subtract(end, start) / leg
        across = (-along[1], along[0], 0)
        scene.leaf(a, b, start=start, end=end, section=q, material=stuff, width_axis=across, name=name)
    # a hair to ground: every mechanism hangs on it
    scene.wire(scene.ground, left, diameter=1e-4, material=stuff, start=(-r, 0, 0.1), end=(-r, 0, 0))
    for link, place, axes in ((left, (-r, 0, 0), "xyz"), (right, (r, 0, 0), "yz")):
        for axis in axes:
            scene.support(link, along=axis, at=place)
        for axis in "xy":
            scene.support(link, about=axis)
    small = 1e-3
    scene.load(left, moment=(0, 0, small))
    scene.load(right, moment=(0, 0, -small))
    state = conventional(compile_scene(scene), {})
    found = state.buckling()
    critical = np.pi * np.sqrt(stuff.E * q.Iz * stuff.G * q.J) / leg
    assert found.positive * small == pytest.approx(critical, rel=1e-3)
    assert found.negative * small == pytest.approx(-critical, rel=1e-3)
    thin = 30e-3 * 0.6e-3**3 / 3
    assert critical * np.sqrt(thin / q.J) == pytest.approx(0.6222, rel=1e-3)


def test_a_loaded_column_loses_its_stability_at_the_multiplier():
    """Negative pivots appear between .99 and 1.01 of the linearised load."""
    model = strip(CLAMPED)
    critical = buckling(model, model.rest, "tip", force=(-1, 0, 0), at=(L, 0, 0)).positive
    counts = []
    for share in (0.99, 1.01):
        scene = ksd.Mechanism("column")
        tip = scene.link("tip")
        scene.leaf(
            scene.ground, tip, start=(0, 0, 0), end=(L, 0, 0), section=rectangle(0.5e-3, 0.02), material=STEEL,
            width_axis=(0, 0, 1), name="leaf",
        )  # fmt: skip
        for kind, axis in CLAMPED:
            scene.support(tip, at=(L, 0, 0), **{kind: axis})
        scene.load(tip, force=(-share * critical, 0, 0), at=(L, 0, 0))
        state = conventional(compile_scene(scene), {})
        counts.append(state.negatives - state.expected)
    assert counts == [0, 1]
