"""Linkages of rigid links, pins and springs, without any flexure, against the energy of their one angle."""

import math

import numpy as np
import pytest
from scenes import fourbar
from scipy.optimize import brentq

import ksd
from ksd.joints.mobility import describe_motion
from ksd.model.compile import compile_scene

# corners of a four-bar in its plane [m]: pins on ground, crank, rocker, ground; where a coil spring and a mass are
A, B, C, D = (np.array(p) for p in ((0.0, 0.0), (0.03, 0.1), (0.25, 0.15), (0.3, 0.0)))
HOOK, FOOT = np.array([0.14, 0.12]), np.array([0.1, -0.1])
STIFFNESS, FREE, TURN, REST, MASS = 40.0, 0.1, 2.0, 0.1, 0.2


def linkage(*, springs=True, plane="xy"):
    m = ksd.Mechanism("fourbar", plane=plane)
    m.links("crank", "coupler", "rocker")
    pairs = (
        ("ground", "crank", A),
        ("crank", "coupler", B),
        ("coupler", "rocker", C),
        ("ground", "rocker", D),
    )
    for a, b, at in pairs:
        m.pin(a, b, at=(*at, 0), axis="z")
    if springs:
        # torsion first: files have coil springs first
        m.turn_spring("ground", "crank", at=(*A, 0), axis="z", stiffness=TURN, rest_angle=REST)
        m.spring("ground", "coupler", start=(*FOOT, 0), end=(*HOOK, 0), stiffness=STIFFNESS, free_length=FREE)
    return m


def turned(angle, p):
    c, s = math.cos(angle), math.sin(angle)
    return np.array([c * p[0] - s * p[1], s * p[0] + c * p[1]])


def places(phi):
    """Where B, C and the hook are, the crank turned by phi: C from two circles."""
    b = A + turned(phi, B - A)
    far, one, two = np.linalg.norm(D - b), np.linalg.norm(C - B), np.linalg.norm(C - D)
    along = (one**2 - two**2 + far**2) / (2 * far)
    e = (D - b) / far
    c = b + along * e + math.sqrt(one**2 - along**2) * np.array([-e[1], e[0]])
    tilt = math.atan2(*(c - b)[::-1]) - math.atan2(*(C - B)[::-1])
    return b, c, b + turned(tilt, HOOK - B)


def energy(phi):
    stretch = np.linalg.norm(places(phi)[2] - FOOT) - FREE
    return 0.5 * TURN * (phi - REST) ** 2 + 0.5 * STIFFNESS * stretch**2


def slope(f, x, h=1e-5):
    return (f(x + h) - f(x - h)) / (2 * h)


def minimum():
    return brentq(lambda x: slope(energy, x), 0.0, 0.5, xtol=1e-14)


def test_springs_alone_find_the_least_energy():
    pose, phi = ksd.solve(linkage()), minimum()
    assert pose.trusted and pose.stable
    b, c, hook = places(phi)
    assert pose.rotation("crank") == pytest.approx([0, 0, phi], abs=1e-9)
    for link, start, end in (("crank", B, b), ("rocker", C, c), ("coupler", HOOK, hook)):
        assert pose.displacement(link, (*start, 0))[:2] == pytest.approx(end - start, abs=1e-10)
    stiffness = slope(lambda x: slope(energy, x, 1e-4), phi, 1e-4)
    assert pose.stiffness("crank", at=(0, 0, 0)).support("rz") == pytest.approx(stiffness, rel=1e-5)


def test_a_driven_linkage_asks_for_the_slope_of_its_energy():
    m = linkage()
    m.mass("coupler", mass=MASS, at=(*HOOK, 0))
    m.gravity = (0, -9.81, 0)
    m.actuate("crank", about="z", name="q")
    for q in (-0.4, 0.0, 0.3, 0.8):
        want = slope(lambda x: energy(x) + MASS * 9.81 * places(x)[2][1], q)
        assert ksd.solve(m, q=q).forces["q"] == pytest.approx(want, abs=1e-8)
    table = ksd.sweep(m, q=[0.0, 0.3], progress=False)
    assert table["q_moment_Nm"][1] == pytest.approx(
        slope(lambda x: energy(x) + MASS * 9.81 * places(x)[2][1], 0.3), abs=1e-8
    )
    assert "stress (there is no leaf spring)" in str(table)


def test_without_springs_forces_follow_from_virtual_work():
    m = linkage(springs=False)
    m.load("rocker", force=(3.0, -1.0, 0), at=(*C, 0))
    m.actuate("crank", about="z", name="q")
    want = -slope(lambda x: np.array([3.0, -1.0]) @ places(x)[1], 0.3)
    assert ksd.solve(m, q=0.3).forces["q"] == pytest.approx(want, abs=1e-8)


def test_frequency_of_a_linkage():
    m = linkage()
    m.mass("coupler", mass=MASS, at=(*HOOK, 0))
    phi = minimum()
    speed = slope(lambda x: places(x)[2], phi)
    stiffness = slope(lambda x: slope(energy, x, 1e-4), phi, 1e-4)
    want = math.sqrt(stiffness / (MASS * speed @ speed)) / (2 * math.pi)
    assert ksd.solve(m).frequencies(count=1).frequency_Hz[0] == pytest.approx(want, rel=1e-5)


def test_a_linkage_in_space_and_a_cart():
    m = ksd.Mechanism("flap")
    m.pin("ground", m.link("flap"), at=(0.1, 0, 0), axis="x")
    m.turn_spring("ground", "flap", at=(0.1, 0, 0), axis="x", stiffness=0.5)
    m.load("flap", moment=(0.1, 0, 0))
    assert ksd.solve(m).rotation("flap") == pytest.approx([0.2, 0, 0], abs=1e-12)
    m = ksd.Mechanism("cart", plane="xy")
    cart = m.link("cart")
    m.support(cart, along="y", at=(0, 0, 0))
    m.support(cart, about="z")
    m.spring("ground", cart, start=(-0.1, 0, 0), end=(0, 0, 0), stiffness=100.0)
    m.load(cart, force=(2.0, 0, 0), at=(0, 0, 0))
    assert ksd.solve(m).displacement(cart, (0, 0, 0)) == pytest.approx([0.02, 0, 0], abs=1e-12)


def test_what_nothing_holds_is_said():
    """It was told stable at rest, where no force tells."""
    loose = ksd.Mechanism("loose", plane="xy")
    loose.pin("ground", loose.link("arm"), at=(0, 0, 0))
    with pytest.raises(ksd.ConvergenceError, match="something can move without resistance"):
        ksd.solve(loose)
    assert "1 under-constrained motion" in str(ksd.doctor(loose))
    # four pins in space fight where they do not in their plane
    with pytest.raises(
        ksd.TrustError, match=r"all pins turn about an axis normal to the plane xy: .* plane='xy'"
    ):
        ksd.solve(linkage(plane=None))


def on_a_guide(what, k, plane):
    """A guide of two leaf springs with something on it that nothing holds, at places whose rounding differs."""
    m, steel = ksd.Mechanism("guide", plane=plane), ksd.Material(E=200e9, nu=0.3)
    stage, sheet = m.link("stage"), ksd.rectangle(0.5e-3, 0.02)
    for x in (0.0, 0.05):
        m.leaf(
            "ground", stage, start=(x, 0, 0), end=(x, 0.1, 0), section=sheet, material=steel, width_axis="z"
        )
    m.actuate(stage, along="x", at=(0.025, 0.1, 0), name="push")
    free, at = m.link("free"), (0.025 + 0.0173 * k, 0.1, 0)
    if what == "slider":
        m.slider(free, along=(1, 0.3 * k, 0), at=(0.3, 0, 0))
        return m
    m.pin(stage, free, at=at, axis="z")
    if what == "leaf":
        end = (at[0] + 0.05, 0.1 + 0.01 * k, 0)
        m.leaf(free, m.link("tip"), start=at, end=end, section=sheet, material=steel, width_axis="z")
    return m


@pytest.mark.parametrize("what", ["arm", "leaf", "slider"])
@pytest.mark.parametrize("plane", ["xy", None])
def test_what_nothing_holds_is_said_whatever_its_pivot_rounds_to(what, plane):
    """By luck of that rounding it was told at rest, told unstable, or trusted."""
    for k in range(4):
        for push in (0.0, 1e-3):
            with pytest.raises(ksd.ConvergenceError, match="something can move without resistance"):
                ksd.solve(on_a_guide(what, k, plane), push=push)
    # weight holds a pendulum
    hanging = on_a_guide("arm", 2, plane)
    hanging.gravity = (0, -9.81, 0)
    hanging.mass("free", mass=0.1, at=(0.025 + 0.0346, 0.05, 0))
    assert ksd.solve(hanging, push=1e-3).trusted


def test_a_linkage_is_written_drawn_and_asked(tmp_path):
    m = linkage()
    ksd.save_scene(m, tmp_path / "a.toml")
    again, _, _ = ksd.load_scene(tmp_path / "a.toml")
    assert again.scene().fingerprint() == m.scene().fingerprint()
    pose = ksd.solve(m)
    for view in (None, "3d"):
        assert pose.plot(view=view).axes
    assert "exactly" in str(ksd.doctor(driven())) and pose.strength is None and not pose.stress().leaves
    with pytest.raises(ksd.SceneError, match="the distance of two leaf springs, and it has none"):
        pose.clearance()


def driven():
    m = linkage()
    m.actuate("crank", about="z", name="q")
    return m


def test_the_motion_that_is_named_is_the_largest():
    model = compile_scene(fourbar())
    twist = np.zeros((model.links, 6))
    twist[1, 0], twist[2, 5] = model.arrays.size, 2.0
    assert describe_motion(model, twist) == f"link '{model.node_names[2]}' can turn about z"
    twist[1, 0] *= 3.0
    assert describe_motion(model, twist) == f"link '{model.node_names[1]}' can slide along x"
