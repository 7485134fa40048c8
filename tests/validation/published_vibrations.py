"""Closed forms and independent numbers of vibrations: beams, strips, rods and joints with a payload."""

from functools import partial

import numpy as np
from published import numbers
from scenes import cross_flexure, fourbar

import ksd
from ksd.section import rectangle

BEAMS, PAYLOADS = "Beams that vibrate", "Mechanisms that vibrate about rest"
STEEL = ksd.Material(E=200e9, nu=0.3, density=7800)
# roots of cos x cosh x = 1, cos x cosh x = -1 and tan x = tanh x
CLAMPED = (4.730040744862704, 7.853204624095838)
FREE = (1.8751040687119611, 4.694091132974175)
PINNED = (3.9266023120479, 7.0685827456287)
PLANAR = "independent finite elements in the plane"


def beam(held="", mesh=None, length=1.0, thickness=2e-3, width=20e-3):
    """(frequencies [Hz], unit sqrt(EI/rho A)/(2 pi L^2)) of a slender leaf whose end is held in these ways, xyz and abc
    (turning); along x it has a drive, let go where nothing is held."""
    scene = ksd.Mechanism("beam")
    tip = scene.link("tip")
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(length, 0, 0), section=rectangle(thickness, width), material=STEEL,
        width_axis=(0, 0, 1), name="leaf",
    )  # fmt: skip
    scene.actuate(tip, along="x", at=(length, 0, 0), name="pull")
    for way in held:
        if way in "xyz":
            scene.support(tip, along=way, at=(length, 0, 0))
        else:
            scene.support(tip, about="xyz"["abc".index(way)])
    rest = ksd.solve(scene, pull=0.0, method="conventional", mesh=mesh)
    unit = np.sqrt(STEEL.E * thickness**2 / 12 / STEEL.density) / length**2 / (2 * np.pi)
    return rest.frequencies(count=8, freed=() if held else ["pull"]).frequency_Hz, unit


def nearest(found, values):
    return [found[np.argmin(np.abs(found - v))] / v for v in values]


def roots(held, known):
    """k L of the modes next to the known ones."""
    found, unit = beam(held)
    return [r * np.sqrt(q) for r, q in zip(known, nearest(found, [unit * r**2 for r in known]), strict=True)]


def axial():
    """The axial mode of a bar of three leaf springs in a row, over c/(4 L)."""
    scene = ksd.Mechanism("bar")
    links, step = [scene.ground, *scene.links("a", "b", "c")], 0.02
    for k in range(3):
        scene.leaf(
            links[k], links[k + 1], start=(k * step, 0, 0), end=((k + 1) * step, 0, 0), section=rectangle(2e-3, 2e-3),
            material=STEEL, width_axis=(0, 0, 1), name=f"part {k}",
        )  # fmt: skip
    found = ksd.solve(scene, method="conventional").frequencies(count=30)
    along = found.shape[:, 3, 0] ** 2 / np.maximum((found.shape[:, 3, :3] ** 2).sum(axis=1), 1e-300)
    return (found.frequency_Hz[np.argmax(along > 0.999)] / np.sqrt(STEEL.E / STEEL.density) * 4 * 3 * step,)


def wire():
    """.4 m of round wire with 20 g on its end."""
    stuff = ksd.Material(E=200e9, G=200e9 / 2.6, density=7919)
    scene = ksd.Mechanism("wire", plane="xy")
    tip = scene.link("tip")
    section = ksd.numbers(
        A=7.854e-7, J=9.818e-14, Iy=4.909e-14, Iz=4.909e-14, ky=0.9, kz=0.9, width=1e-3, thickness=1e-3
    )
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0.4, 0, 0), section=section, material=stuff)
    scene.mass(tip, mass=0.02, at=(0.4, 0, 0))
    return ksd.solve(scene).frequencies(count=1).frequency_Hz


def rod():
    """A rod of 1.11 x .0127 x .0032 m, free at its end."""
    stuff = ksd.Material(E=200e9, G=80e9, density=7850)
    scene = ksd.Mechanism("rod", plane="xy")
    tip = scene.link("tip")
    scene.leaf(
        scene.ground,
        tip,
        start=(0, 0, 0),
        end=(1.11, 0, 0),
        section=rectangle(3.2e-3, 12.7e-3),
        material=stuff,
    )
    return ksd.solve(scene).frequencies(count=1).frequency_Hz


def pivot():
    """A cross flexure of .5 mm with a payload of 1 kg, its centre 20 mm beyond B."""
    joint = cross_flexure(thickness=0.5e-3)
    scene = ksd.Mechanism("pivot")
    tip = scene.link("tip", mass=1.0, inertia=(1e-3, 1e-3, 1e-3), at=(joint.length_AB + 0.02, 0, 0))
    scene.actuate_joint(scene.join(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x"), name="turn")
    return ksd.solve(scene, turn=0.0, method="conventional").frequencies(count=1, freed="turn").frequency_Hz


def guide():
    """Two leaf springs of 100 x 30 x .5 mm, a shuttle of .5 kg at their ends."""
    joint = ksd.ParallelGuide(STEEL, length=0.1, thickness=0.5e-3, width=0.03, spacing=0.06)
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage", mass=0.5, inertia=(4e-4, 4e-4, 4e-4), at=(0.1, 0, 0))
    scene.actuate_joint(
        scene.join(scene.ground, stage, joint, at=(0, 0, 0), axis="z", toward="x"), name="push"
    )
    return ksd.solve(scene, push=0.0, method="conventional").frequencies(count=1, freed="push").frequency_Hz


def four_hinges():
    """The fourbar of paper 1 with links that have mass, its drive let go."""
    scene = fourbar()
    height = 0.3 + cross_flexure().length_AB
    scene.mass("top", mass=2.0, inertia=(0.02, 0.02, 0.02), at=(0, height, 0))
    for side, x in (("left", -0.2), ("right", 0.2)):
        scene.mass(side, mass=0.5, inertia=(2e-3, 2e-3, 2e-3), at=(x, height / 2, 0))
    return ksd.solve(scene, top=0.0, method="conventional").frequencies(count=1, freed="top").frequency_Hz


def strip():
    """A strip with a payload of 30 g beside its axis."""
    stuff = ksd.Material(E=70e9, G=70e9 / 2.6, density=2700)
    scene = ksd.Mechanism("strip")
    tip = scene.link("tip", mass=0.03, inertia=(2e-6, 2e-6, 2e-6), at=(0.25, 0, 0.01))
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(0.25, 0, 0), section=rectangle(0.5e-3, 20e-3), material=stuff,
        width_axis="z",
    )  # fmt: skip
    return ksd.solve(scene, method="conventional").frequencies(count=3).frequency_Hz


def _rows():
    for name, held, known in (
        ("clamped-clamped", "yzabc", CLAMPED),
        ("clamped-pinned", "yzab", PINNED),
        ("clamped-free", "", FREE),
    ):
        # one mode more than in statics: 2 % without it, 2.3e-4 with it
        wanted = [
            (f"{name}, k L of mode {k + 1}", "", r, within)
            for k, (r, within) in enumerate(zip(known, (5e-5, 5e-4), strict=True))
        ]
        yield numbers(BEAMS, "Euler and Bernoulli, closed form", partial(roots, held, known), *wanted)
    wanted = ("axial mode of three leaf springs in a row, over c/(4 L)", "", 1.0, 1e-6)
    yield numbers(BEAMS, "closed form of a continuous bar", axial, wanted)
    yield numbers(BEAMS, PLANAR, wire, ("wire of 0.4 m with 20 g", "Hz", 0.75250, 1e-5))
    yield numbers(BEAMS, PLANAR, rod, ("free rod of 1.11 m", "Hz", 2.11769, 1e-5))
    wanted = [
        (f"strip, 30 g beside its axis, mode {k + 1}", "Hz", v, 1e-4)
        for k, v in enumerate((1.494487, 26.2287, 32.8205))
    ]
    yield numbers(BEAMS, "independent finite elements in space", strip, *wanted)
    for name, ask, value in (
        ("cross flexure of 0.5 mm, 1 kg", pivot, 3.21679),
        ("parallel guide, 0.5 kg", guide, 8.64181),
        ("fourbar of paper 1, links with mass", four_hinges, 2.49524),
    ):
        yield numbers(PAYLOADS, PLANAR, ask, (f"{name}, intended", "Hz", value, 2e-5))


ROWS = [row for rows in _rows() for row in rows]
