"""Paths through limit points and bifurcations: arches, Lee's frame, a bistable beam, a column on its buckled branch."""

import numpy as np
import pytest
from scenes import STEEL

import ksd
from ksd.errors import SceneError
from ksd.model.compile import compile_scene
from ksd.section import numbers, rectangle
from ksd.solve.conventional import conventional
from ksd.solve.path import follow
from ksd.units import deg

CHAIN = ksd.Mesh("corotational", elements=16)


def arch(half, *, hinged, parts=1):
    """Circular arch, R = 100, EI = 1e6, EA = GA = 100 EI, unit force down on its crown; the right foot is hinged."""
    stuff, section = ksd.Material(E=1e8, G=1e8), numbers(A=1.0, J=0.02, Iy=0.01, Iz=0.01, ky=1.0, kz=1.0)
    scene, R, n = ksd.Mechanism("arch"), 100.0, 2 * parts
    first = scene.link("left foot") if hinged else scene.ground
    links = [first, *(scene.link(f"p{k}") for k in range(1, n)), scene.link("right foot")]
    points = [(R * np.sin(a), R * np.cos(a), 0.0) for a in np.linspace(-half, half, n + 1)]
    for k in range(n):
        scene.leaf(links[k], links[k + 1], start=points[k], end=points[k + 1], section=section, material=stuff,
                   width_axis=(0, 0, 1), curve=ksd.Arc(R, -half / parts))  # fmt: skip
    for link, point in ((links[0], points[0]), (links[-1], points[-1]))[0 if hinged else 1 :]:
        pin(scene, link, point)
    scene.load(links[parts], force=(0, -1.0, 0), at=points[parts])
    return scene


def pin(scene, link, point):
    """Hold all but the rotation about z."""
    for word, axes in (("along", "xyz"), ("about", "xy")):
        for axis in axes:
            scene.support(link, at=point, **{word: axis})


def lee(*, following=False):
    """Lee's frame (Lee, Manuel, Rossow 1968): legs 120, EI = 1.44e7, force 24 from the corner, both feet pinned."""
    stuff, section = ksd.Material(E=7.2e6, nu=0.3), rectangle(2.0, 3.0)
    scene = ksd.Mechanism("Lee's frame")
    foot, corner, loaded, far = scene.links("foot", "corner", "loaded", "far")
    points = {"foot": (0, 0, 0), "corner": (0, 120, 0), "loaded": (24, 120, 0), "far": (120, 120, 0)}
    for a, b in ((foot, corner), (corner, loaded), (loaded, far)):
        scene.leaf(a, b, start=points[a.name], end=points[b.name], section=section, material=stuff, width_axis="z")
    pin(scene, foot, points["foot"])
    pin(scene, far, points["far"])
    scene.load(loaded, force=(0, -1000.0, 0), at=points["loaded"], following=following)
    return scene


def test_deep_arch_limit_load():
    """Acceptance A: 897 (Da Deppo and Schmidt 1975: 8.97 EI/R^2), within 0.5 %, in both leaf models."""
    assert follow(arch(107.5 * deg, hinged=False), until=1000, first=20, most=60).limits[0] == pytest.approx(
        897.0, rel=1e-3
    )
    fine = follow(arch(107.5 * deg, hinged=False, parts=2), until=1000, first=20, most=60, mesh=CHAIN)
    assert fine.limits[0] == pytest.approx(897.0, rel=5e-3)


def test_deep_arch_beyond_its_limit():
    """Past the limit the path turns back, branches, and rises again; the inertia tells which states are stable."""
    found = follow(arch(107.5 * deg, hinged=False), until=1500, first=20)
    assert found.stop.startswith("the end was reached")
    assert len(found.limits) == 2
    assert found.states[0].stable and not found.states[-1].stable
    up = [s for f, s in zip(found.factor, found.states, strict=True) if f < 897][0:4]
    assert all(s.stable for s in up)


def test_shallow_arch_snaps_through():
    """Two limit points with a valley between; strain modes and chains agree; before the first it is stable."""
    found = follow(arch(15 * deg, hinged=True), until=6000, first=20)
    chain = follow(arch(15 * deg, hinged=True), until=6000, first=20, mesh=CHAIN)
    assert len(found.limits) == len(chain.limits) >= 2
    assert chain.limits == pytest.approx(found.limits, rel=2.5e-2)
    assert found.states[-1].stable


def test_lees_frame():
    """Lee, Manuel and Rossow 1968: critical load 18.55 EI/L^2 (EI/L^2 = 1000)."""
    found = follow(lee(), until=30, first=1.0)
    chain = follow(lee(), until=30, first=1.0, mesh=CHAIN)
    assert found.limits[0] == pytest.approx(18.55, rel=5e-3)
    assert chain.limits == pytest.approx(found.limits, rel=5e-3)
    assert found.states[-1].stable


def test_lees_frame_with_a_following_load():
    found = follow(lee(following=True), until=60, first=1.0)
    chain = follow(lee(following=True), until=60, first=1.0, mesh=CHAIN)
    assert chain.limits[:2] == pytest.approx(found.limits[:2], rel=2e-2)


def bistable(Q=6.0, length=0.1, thickness=0.5e-3, flaw=0.01):
    """Qiu, Lang and Slocum 2004: a cosine-shaped clamped beam, height Q times its thickness, its middle kept level.

    flaw: share of the third buckling mode in its shape, which the perfect beam branches into.
    """
    rise = Q * thickness
    scene = ksd.Mechanism("bistable beam")
    middle = scene.link("middle")
    section, half = rectangle(thickness, 0.01), length / 2
    arc = half * (1 + (np.pi * rise / length) ** 2 / 4)
    unit = rise * 2 * np.pi**2 / length**2

    def bend(s):
        return (0.0, 0.0, unit * (np.cos(np.pi * s) + 4 * flaw * np.cos(2 * np.pi * s)))

    def back(s):
        return bend(1 - s)

    for a, b, start, end, curve in (
        (scene.ground, middle, (0, 0, 0), (half, rise, 0), bend),
        (middle, scene.ground, (half, rise, 0), (length, 0, 0), back),
    ):
        scene.leaf(a, b, start=start, end=end, section=section, material=STEEL, width_axis="z",
                   curve=ksd.FreeCurve(arc, curve))  # fmt: skip
    scene.support(middle, about="z", name="level")
    scene.actuate(middle, along="y", at=(half, rise, 0), name="push")
    return scene, STEEL.E * section.Iz * rise / length**3, rise


def test_bistable_beam():
    """Qiu's approximation for large Q: a force peak of 740, a valley of -370 EI h/l^3, a second stable state near
    -2 h; at Q = 6 the axial compression lowers the peak a little."""
    scene, unit, rise = bistable()
    found = follow(scene, {"push": -2.1 * rise}, control="drives", first=0.02)
    force = -np.array([s.forces["push"] for s in found.states]) / unit
    assert found.stop.startswith("the end was reached")
    assert all(s.stable for s in found.states)
    assert force.max() == pytest.approx(740, rel=0.08)
    assert force.min() == pytest.approx(-370, rel=0.12)
    zero = np.flatnonzero(np.diff(np.sign(force[1:]))) + 1
    assert len(zero) == 2
    assert 2.1 * found.factor[zero[1]] == pytest.approx(1.99, abs=0.06)


def test_the_perfect_bistable_beam_branches_and_says_so():
    scene, _, rise = bistable(flaw=0.0)
    found = follow(scene, {"push": -0.5 * rise}, control="drives", first=0.02)
    assert found.bifurcations
    assert not found.states[-1].stable


def column(share=0.0, length=0.1):
    """A clamped column of two leafs, its top guided, pressed by the Euler load; share: sideways part of the load."""
    section = rectangle(0.5e-3, 0.02)
    euler = 4 * np.pi**2 * STEEL.E * section.Iz / length**2
    scene = ksd.Mechanism("column")
    middle, top = scene.links("middle", "top")
    scene.leaf(scene.ground, middle, start=(0, 0, 0), end=(length / 2, 0, 0), section=section, material=STEEL,
               width_axis="z")  # fmt: skip
    scene.leaf(middle, top, start=(length / 2, 0, 0), end=(length, 0, 0), section=section, material=STEEL,
               width_axis="z")  # fmt: skip
    for word, axes in (("along", "yz"), ("about", "xyz")):
        for axis in axes:
            scene.support(top, at=(length, 0, 0), **{word: axis})
    scene.load(top, force=(-euler, 0, 0), at=(length, 0, 0))
    if share:
        scene.load(middle, force=(0, share * euler, 0), at=(length / 2, 0, 0))
    return scene


def elastica(share):
    """Shortening over length of a clamped column at `share` of its Euler load, in elliptic integrals."""
    from scipy.optimize import brentq
    from scipy.special import ellipe, ellipk

    m = brentq(lambda m: (2 * ellipk(m) / np.pi) ** 2 - share, 1e-9, 0.9)
    return 2 * (1 - ellipe(m) / ellipk(m))


def test_branch_of_a_buckled_column():
    straight = follow(column(), until=1.2, first=0.2)
    (point,) = straight.bifurcations[:1]
    assert point.factor == pytest.approx(1.0, rel=1e-3)
    for side in (1, -1):
        bent = follow(column(), branch=point, side=side, until=1.1)
        assert bent.stop.startswith("the end was reached")
        last = bent.states[-1]
        assert last.stable
        assert -last.links["top"][0][0] / 0.1 == pytest.approx(elastica(1.1), rel=4e-3)
    both = [follow(column(), branch=point, side=s, until=1.1).states[-1].links["middle"][0] for s in (1, -1)]
    assert both[0][1] == pytest.approx(-both[1][1], rel=1e-6)


def test_imperfect_column_goes_through_its_buckling_load():
    found = follow(column(1e-3), until=1.2, first=0.1)
    assert not found.turnings
    assert found.states[-1].stable
    assert -found.states[-1].links["top"][0][0] / 0.1 == pytest.approx(elastica(1.2), rel=0.02)


def test_path_and_load_steps_agree():
    model = compile_scene(column(1e-2))
    state = follow(model, until=1.0, first=0.1).states[-1]
    step = conventional(model, {}, steps=20)
    assert state.motion.x == pytest.approx(step.motion.x, abs=1e-9)


def test_a_path_needs_a_parameter():
    scene, _, _ = bistable()
    with pytest.raises(SceneError, match="no load"):
        follow(scene)
    with pytest.raises(SceneError, match="targets"):
        follow(scene, control="drives")
    with pytest.raises(SceneError, match="choose"):
        follow(scene, control="force")
