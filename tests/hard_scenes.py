"""Scenes of the hard cases: arches, frames, columns, beams that snap, roll up or buckle."""

from itertools import pairwise

import numpy as np
from scenes import STEEL, cross_flexure

import ksd
from ksd.section import numbers, rectangle


def arch(half, *, hinged, parts=1):
    """Circular arch, R = 100, EI = 1e6, EA = GA = 100 EI, unit force down on its crown; the right foot is hinged."""
    stuff, section = ksd.Material(E=1e8, G=1e8), numbers(A=1.0, J=0.02, Iy=0.01, Iz=0.01, ky=1.0, kz=1.0)
    scene, R, n = ksd.Mechanism("arch"), 100.0, 2 * parts
    first = scene.link("left foot") if hinged else scene.ground
    links = [first, *(scene.link(f"p{k}") for k in range(1, n)), scene.link("right foot")]
    points = [(R * np.sin(a), R * np.cos(a), 0.0) for a in np.linspace(-half, half, n + 1)]
    for k in range(n):
        scene.leaf(links[k], links[k + 1], start=points[k], end=points[k + 1], section=section, material=stuff,
                   width_axis=(0, 0, 1), curve=ksd.Arc(radius=R, angle=-half / parts))  # fmt: skip
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
        scene.leaf(
            a, b, start=points[a.name], end=points[b.name], section=section, material=stuff, width_axis="z"
        )
    pin(scene, foot, points["foot"])
    pin(scene, far, points["far"])
    scene.load(loaded, force=(0, -1000.0, 0), at=points["loaded"], following=following)
    return scene


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


def column(share=0.0, length=0.1, load=1.0):
    """A clamped column of two leaf springs, its top guided, pressed by `load` times the Euler load; share: sideways
    part of the Euler load."""
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
    scene.load(top, force=(-load * euler, 0, 0), at=(length, 0, 0))
    if share:
        scene.load(middle, force=(0, share * euler, 0), at=(length / 2, 0, 0))
    return scene


def frame(*, unit=1.0, turn=None, shift=(0.0, 0.0, 0.0), force=0.0):
    """The fourbar of paper 1 with all lengths times `unit`, turned by the rotation matrix `turn` and shifted (3,) [m];
    force [N] out of the plane on the top link."""
    T, origin = np.eye(3) if turn is None else turn, np.asarray(shift, float)
    joint = ksd.CrossFlexure(
        STEEL, length=0.1 * unit, angle=np.pi / 4, thickness=1e-3 * unit, widths=(0.04 * unit, 0.02 * unit)
    )

    def at(x, y):
        return tuple(origin + T @ (unit * np.array([x, y, 0.0])))

    scene = ksd.Mechanism("frame")
    left, top, right = scene.links("left", "top", "right")
    for a, b, x, y, name in (
        (scene.ground, left, -0.2, 0.0, "lower left"),
        (left, top, -0.2, 0.3, "upper left"),
        (right, top, 0.2, 0.3, "upper right"),
        (scene.ground, right, 0.2, 0.0, "lower right"),
    ):
        scene.join(a, b, joint, at=at(x, y), axis=tuple(T[:, 2]), toward=tuple(T[:, 1]), name=name)
    high = 0.3 + joint.length_AB / unit
    scene.actuate(top, along=tuple(T[:, 0]), at=at(0, high))
    if force:
        scene.load(top, force=tuple(force * T[:, 2]), at=at(0, high))
    return scene


def askew(tilt):
    """The fourbar of paper 1 with one joint mounted `tilt` rad askew about x, at d = 0 without stress."""
    joint = cross_flexure()
    scene = ksd.Mechanism("askew")
    left, top, right = scene.links("left", "top", "right")
    places = ((scene.ground, left, -0.2, 0.0), (left, top, -0.2, 0.3), (right, top, 0.2, 0.3))
    for a, b, x, y in places:
        scene.join(a, b, joint, at=(x, y, 0), axis="z", toward="y")
    c, s = np.cos(tilt), np.sin(tilt)
    scene.join(scene.ground, right, joint, at=(0.2, 0, 0), axis=(0, -s, c), toward=(0, c, s), name="askew")
    scene.actuate(top, along="x", at=(0, 0.3 + joint.length_AB, 0))
    return scene


def cantilever(
    *, moment=0.0, force=(0.0, 0.0, 0.0), length=0.1, thickness=0.5e-3, width=0.02, pieces=1, level=False
):
    """A leaf along x from ground to 'tip', moment about z; pieces: lengths of the parts when not one; level: the tip is
    kept in the plane."""
    scene = ksd.Mechanism("cantilever")
    section, ends = rectangle(thickness, width), np.cumsum([0.0, *(pieces if pieces != 1 else (length,))])
    links = [scene.ground, *(scene.link(f"part {k}") for k in range(1, len(ends) - 1)), scene.link("tip")]
    for a, b, start, end in zip(links, links[1:], ends, ends[1:], strict=False):
        scene.leaf(
            a, b, start=(start, 0, 0), end=(end, 0, 0), section=section, material=STEEL, width_axis="z"
        )
    scene.load(links[-1], force=force, moment=(0, 0, moment), at=(ends[-1], 0, 0))
    for word, axes in (("along", "z"), ("about", "xy")) if level else ():
        for axis in axes:
            scene.support(links[-1], at=(ends[-1], 0, 0), **{word: axis})
    return scene


def guide(*, twist=False):
    """An overconstrained guide: two parallel leaf springs, stroke along y; twist: the shuttle is also turned about x."""
    scene = ksd.Mechanism("guide")
    shuttle = scene.link("shuttle")
    for y in (-0.03, 0.03):
        scene.leaf(scene.ground, shuttle, start=(0, y, 0), end=(0.1, y, 0), section=rectangle(0.5e-3, 0.03),
                   material=STEEL, width_axis="z")  # fmt: skip
    scene.actuate(shuttle, along="y", at=(0.1, 0, 0), name="stroke")
    if twist:
        scene.actuate(shuttle, about="x", at=(0.1, 0, 0), name="twist")
    return scene


def long_arm():
    """A link of 1 m on a leaf 50 um long and 2 um thick, driven at its far end."""
    scene = ksd.Mechanism("long arm")
    arm = scene.link("arm")
    scene.leaf(scene.ground, arm, start=(0, 0, 0), end=(50e-6, 0, 0), section=rectangle(2e-6, 20e-6), material=STEEL,
               width_axis="z")  # fmt: skip
    scene.actuate(arm, along="y", at=(1.0, 0, 0), name="end")
    return scene


def right_angle(share, flaw=0.0):
    """Argyris' right-angle frame under `share` of its critical end moments (618.3 Nmm); flaw: sideways force [N]."""
    stuff, leg = ksd.Material(E=71240e6, nu=0.31), 0.24
    q, r = rectangle(0.6e-3, 30e-3), 0.24 / np.sqrt(2)
    critical = np.pi * np.sqrt(stuff.E * q.Iz * stuff.G * q.J) / leg
    scene = ksd.Mechanism("right-angle frame")
    left, corner, right = scene.links("left", "corner", "right")
    for name, a, b, start, end in (
        ("one", left, corner, (-r, 0, 0), (0, r, 0)),
        ("two", corner, right, (0, r, 0), (r, 0, 0)),
    ):
        along = np.subtract(end, start) / leg
        scene.leaf(
            a,
            b,
            start=start,
            end=end,
            section=q,
            material=stuff,
            width_axis=(-along[1], along[0], 0),
            name=name,
        )
    for link, place, axes in ((left, (-r, 0, 0), "xyz"), (right, (r, 0, 0), "yz")):
        for axis in axes:
            scene.support(link, along=axis, at=place)
        for axis in "xy":
            scene.support(link, about=axis)
    scene.load(left, moment=(0, 0, share * critical))
    scene.load(right, moment=(0, 0, -share * critical))
    if flaw:
        scene.load(corner, force=(0, 0, flaw), at=(0, r, 0))
    return scene


def bow(rng, share=1.0):
    """A bow drawn straight, its string too short by `share` of 2 to 9 %: limbs of unequal length, thickness and slant, the
    string off their middle, in one or two pieces, perhaps drawn at a nock. Returns it and drive values."""
    length, thickness = rng.uniform(0.4, 0.7), rng.uniform(4e-3, 8e-3)
    lengths = length, length * rng.uniform(0.7, 1.3)
    offset, short = rng.uniform(-0.05, 0.05), rng.uniform(0.02, 0.09)
    glass, string = ksd.Material(E=40e9, nu=0.3), ksd.Material(E=10e9, nu=0.3)
    scene = ksd.Mechanism("bow", plane="xy")
    up, down = scene.links("up", "down")
    tips = (
        np.array([offset, 0.1 + lengths[0], 0]),
        np.array([offset * rng.uniform(0.5, 1.5), -0.1 - lengths[1], 0]),
    )
    for link, tip, thick in zip((up, down), tips, (1.0, rng.uniform(0.85, 1.15)), strict=True):
        scene.leaf("ground", link, start=(0, np.sign(tip[1]) * 0.1, 0), end=tip, material=glass,
                   section=rectangle(thick * thickness, 30e-3))  # fmt: skip
    places, links, drives = [tips[1], tips[0]], [down, up], {}
    if rng.random() < 0.6:
        places.insert(1, tips[1] + rng.uniform(0.3, 0.7) * (tips[0] - tips[1]))
        links.insert(1, scene.link("nock"))
        if rng.random() < 0.6:
            scene.actuate(links[1], along="x", at=places[1], name="draw")
            drives["draw"] = float(rng.choice([-1, 1]) * rng.uniform(0.02, 0.15))
    side = rng.choice([1e-3, 2e-3])
    for k, (start, end) in enumerate(pairwise(places)):
        piece = scene.leaf(
            links[k], links[k + 1], start=start, end=end, material=string, section=rectangle(side, side)
        )
        scene.fit(piece, natural_length=(1 - share * short) * float(np.linalg.norm(end - start)))
    return scene, drives
