"""Planar compliant links against independent shooting of exact rods and the examples of Lan's thesis (2005).

Rods without stretch and shear are drawn with 1/EA and 1/GA at 1e-9 of EI/L^2: "inextensible" to 1e-9.
"""

import math

import numpy as np
import pytest
from planar_scenes import FINE, SOFT, indexer, rod, slider

import ksd


def cantilever(EI, length, force):
    scene = ksd.Mechanism("cantilever", plane="xy")
    tip = scene.link("tip")
    scene.leaf("ground", tip, start=(0, 0, 0), end=(length, 0, 0), section=rod(EI, length), material=SOFT)
    scene.load(tip, force=force, at=(length, 0, 0))
    return ksd.solve(scene)


@pytest.mark.parametrize(
    "force, x, y, angle",
    [
        # thesis, table 2.3
        ((0, 15, 0), 0.0859561617, 0.0491835530, 0.7651820133),
        # shooting, order 8
        ((20, 12, 0), 0.09802002, 0.02464237, 0.3538169),
    ],
)
def test_cantilever(force, x, y, angle):
    found = cantilever(0.08, 0.1016, force)
    place = found.displacement("tip") + np.array((0.1016, 0, 0))
    assert (*place[:2], found.rotation("tip")[2]) == pytest.approx((x, y, angle), rel=1e-6)


def planar_spring():
    """Example 4 of chapter 2: angle at rest 1.6 cos 5 pi u, its end kept at its height and angle."""
    length = 50e-6
    points, weights = np.polynomial.legendre.leggauss(200)
    chord = length * 0.5 * weights @ np.cos(1.6 * np.cos(5 * np.pi * 0.5 * (points + 1)))
    curve = ksd.FreeCurve(length, lambda s: (0, 0, -8 * math.pi * math.sin(5 * math.pi * s) / length))
    scene = ksd.Mechanism("planar spring", plane="xy")
    end = scene.link("end")
    scene.leaf("ground", end, start=(0, 0, 0), end=(chord, 0, 0), curve=curve, section=rod(1.04e-11, length),
               material=SOFT, name="spring")  # fmt: skip
    for k in range(1, 5):
        # its curve turns by 16 rad: five pieces, each with modes of its own
        scene.point("spring", 0.2 * k * length)
    scene.slider(end, along="x", at=(chord, 0, 0))
    scene.actuate(end, along="x", at=(chord, 0, 0), name="d")
    return scene


@pytest.mark.parametrize("d, secant", [(2e-6, 34224.63), (-2e-6, 31148.72)])
def test_planar_spring(d, secant):
    found = ksd.solve(planar_spring(), d=d, mesh=FINE)
    assert found.forces["d"] / d == pytest.approx(secant, rel=1e-5)


def test_planar_spring_at_rest():
    """The reference is a secant at a small force: the slope of the other two makes it 2.4e-5 stiffer at 1 nm."""
    slope = (34224.63 - 31148.72) / 4e-6
    found = ksd.solve(planar_spring(), d=0.0, mesh=FINE)
    assert found.drive_stiffness()["d"] == pytest.approx(32572.91 - 1e-9 * slope, rel=1e-5)


SIX_BAR = {
    "J1": (-0.088, 0.06), "J2": (-0.588, 0.06), "J3": (0, 0.4), "J4": (0.588, 0.06), "J5": (0, 0), "J6": (0.088, 0.06),
}  # fmt: skip
LINKS = (("J1", "J2"), ("J2", "J3"), ("J5", "J3"), ("J3", "J4"), ("J4", "J6"))


def six_bar(force):
    """Figure 5.6: a four-bar and its mirror image, all links clamped to each other."""
    places = {name: np.array([*place, 0.0]) for name, place in SIX_BAR.items()}
    scene = ksd.Mechanism("six-bar", plane="xy")
    joints = dict(zip(("J2", "J3", "J4"), scene.links("J2", "J3", "J4"), strict=True))
    for a, b in LINKS:
        length = float(np.linalg.norm(places[b] - places[a]))
        scene.leaf(joints.get(a, "ground"), joints.get(b, "ground"), start=places[a], end=places[b], name=f"{a}-{b}",
                   section=rod(0.3, length), material=SOFT)  # fmt: skip
    scene.load("J2", force=(0, force, 0), at=places["J2"])
    return ksd.solve(scene, mesh=FINE)


def test_six_bar():
    assert six_bar(-1.0).displacement("J4")[1] == pytest.approx(0.04365026, rel=1e-5)
    # the reference has a little stretch, 5e-6 of EI/L^2: 1.4e-5 along x
    found = six_bar(-4.0)
    assert found.displacement("J4")[:2] == pytest.approx((-0.0310615, 0.1606809), rel=2e-5)
    assert found.rotation("J3")[2] == pytest.approx(0.3165069, rel=1e-5)


@pytest.mark.parametrize(
    "c, force", [((1.3426,), 7.621551), ((1.1412, 0.7817), 6.017377), ((1.0628, 0.7668, 0.5197), 5.441198)]
)
def test_grasper(c, force):
    """Section 5.6: a link of Fourier sine shape, clamped and guided, moved across with its end kept along x."""
    points, weights = np.polynomial.legendre.leggauss(60)
    u = 0.5 * (points + 1)

    def angle(u):
        return sum(ci * np.sin(2 * (i + 1) * np.pi * u) for i, ci in enumerate(c))

    chord = 0.5 * weights @ np.cos(angle(u))
    # the end of a leaf that begins along its own start, turned onto x
    rise = 0.5 * weights @ np.sin(angle(u))
    length = 0.0508 / math.hypot(chord, rise)
    assert abs(rise) < 1e-9

    def curvature(s):
        slope = sum(
            ci * 2 * (i + 1) * math.pi * math.cos(2 * (i + 1) * math.pi * s) for i, ci in enumerate(c)
        )
        return 0.0, 0.0, slope / length

    scene = ksd.Mechanism("grasper", plane="xy")
    tip = scene.link("tip")
    scene.leaf("ground", tip, start=(0, 0, 0), end=(0.0508, 0, 0), curve=ksd.FreeCurve(length, curvature),
               section=rod(0.01, length), material=SOFT, name="link")  # fmt: skip
    scene.point("link", length / 3)
    scene.point("link", length / 1.5)
    scene.slider(tip, along="y", at=(0.0508, 0, 0))
    scene.actuate(tip, along="y", at=(0.0508, 0, 0), name="d")
    found = ksd.solve(scene, d=0.0127, mesh=FINE)
    assert found.forces["d"] == pytest.approx(force, rel=1e-5)


@pytest.mark.parametrize(
    "ratio, share, extra", [(0.1, 0.2, 0.00852810), (0.1, 0.6, 0.00620793), (0.2, 0.2, 0.0341186)]
)
def test_shear_of_a_cantilever(ratio, share, extra):
    """Section 2.2: the load that bends a rod without shear by a share of its length, with shear (E/G 3, k = 5/6)."""
    length, I, A = 1.0, 1.0 / 12 * ratio**2, 1.0

    def tip(load, shear):
        k = 5 / 6 if shear else 1e9
        # EA is beyond what would matter; E/G = 3 with kA of the shear area alone
        section = ksd.numbers(
            A=1e9, J=I, Iy=I, Iz=I, ky=k * A / 1e9, kz=k * A / 1e9, width=1.0, thickness=ratio
        )
        scene = ksd.Mechanism("cantilever", plane="xy")
        end = scene.link("tip")
        scene.leaf("ground", end, start=(0, 0, 0), end=(length, 0, 0), section=section,
                   material=ksd.Material(E=1.0, G=1 / 3))  # fmt: skip
        scene.load(end, force=(0, load, 0), at=(length, 0, 0))
        return float(ksd.solve(scene, strict=False).displacement("tip")[1])

    from scipy.optimize import brentq

    load = brentq(lambda p: tip(p * I, False) - share, 0.1, 8.0, xtol=1e-13) * I
    assert tip(load, True) / share - 1 == pytest.approx(extra, rel=1e-4)


STEEL = ksd.Material(E=200e9, nu=0.3)


def parallel_mechanism():
    """Example 2 of chapter 2: a rigid bar AB of .0254 m on two leaf springs of the same length, pushed at A."""
    h = (12 * 0.3 / (STEEL.E * 0.0127)) ** (1 / 3)
    scene = ksd.Mechanism("parallel mechanism", plane="xy")
    bar = scene.link("bar")
    for y in (0.0, 0.0254):
        scene.leaf(
            "ground",
            bar,
            start=(0, y, 0),
            end=(0.0254, y, 0),
            section=ksd.rectangle(h, 0.0127),
            material=STEEL,
        )
    return scene, bar


@pytest.mark.parametrize("d, force, tilt", [(6.35e-3, 2948.737, None), (12.7e-3, 7370.185, 0.0107066)])
def test_parallel_mechanism(d, force, tilt):
    scene, bar = parallel_mechanism()
    # pushed so that the bar's other end is pressed less
    a, b = (0.0254, 0, 0), (0.0254, 0.0254, 0)
    scene.actuate(bar, along="y", at=a, name="d")
    found = ksd.solve(scene, d=d, strict=False, mesh=FINE)
    if tilt is None:
        assert found.displacement("bar", a)[0] == pytest.approx(-0.94576e-3, rel=1e-5)
        assert found.displacement("bar", b)[0] == pytest.approx(-0.98923e-3, rel=1e-5)
    else:
        assert abs(found.rotation("bar")[2]) == pytest.approx(tilt, rel=1e-5)
    assert found.forces["d"] == pytest.approx(force, rel=1e-5)


@pytest.mark.parametrize(
    "phi, d, force, pin, C",
    [
        (90, 20e-3, 5.199210, (5.199210, -0.737897), (-0.03552664e-3, -2.440338e-3)),
        (45, 15e-3, 8.249490, None, (-0.922392e-3, 12.423985e-3)),
    ],
)
def test_slider(phi, d, force, pin, C):
    found = ksd.solve(slider(math.radians(phi)), d=d)
    assert found.forces["d"] == pytest.approx(force, rel=1e-5)
    assert found.displacement("one", (0.1, 0, 0))[:2] == pytest.approx(C, rel=1e-5)
    assert found.displacement("two", (0.1, 0, 0)) == pytest.approx(
        found.displacement("one", (0.1, 0, 0)), abs=1e-12
    )
    if pin is not None:
        assert found.interface_forces().of("C", "one").force[:2] == pytest.approx(pin, rel=1e-5)


@pytest.mark.parametrize(
    "d, force, turn, C",
    [(1e-3, 126.9213, -0.0365683, None), (2e-3, 212.4774, None, (0.8138033e-3, -0.0506014e-3))],
)
def test_indexer(d, force, turn, C):
    end = (12e-3 * math.sin(1.2), -12e-3 * (1 - math.cos(1.2)), 0)
    found = ksd.solve(indexer(), d=-d)
    assert abs(found.forces["d"]) == pytest.approx(force, rel=1e-5)
    if turn is not None:
        assert found.rotation("C")[2] == pytest.approx(turn, rel=1e-5)
    if C is not None:
        assert found.displacement("C", end)[:2] == pytest.approx(C, rel=1e-5)
