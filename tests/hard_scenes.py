"""Scenes of the hard cases: arches, frames, columns, beams that snap, roll up or buckle."""

import numpy as np
from scenes import STEEL

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
