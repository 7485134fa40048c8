"""Scenes of motion in time with values of independent dynamic models (acceptance of motion in the plane and in space)."""

import numpy as np
from scenes import cross_flexure, fourbar

import ksd
from ksd.section import rectangle

STEEL = ksd.Material(E=200e9, nu=0.3, density=7800)
HEIGHT = 0.3 + cross_flexure().length_AB


def motion(scene, until, **words):
    """The trace of a motion with steps dt."""
    return ksd.simulate(scene, until, **words).trace


def place(trace, link, t, point=None):
    """Displacement (3,) [m] of a point of a link at an instant that is a step."""
    node, i = trace.model.node_names.index(link), int(np.argmin(np.abs(trace.t - t)))
    assert abs(trace.t[i] - t) < 1e-9
    rest = trace.model.rest.x[node]
    arm = np.zeros(3) if point is None else np.asarray(point) - rest
    return trace.position[i, node] + trace.rotation[i, node] @ arm - arm - rest


def guide(plane="xy", **words):
    """Two leaf springs of 100 x 30 x .5 mm, a shuttle of .5 kg at their ends, pushed by 20 N."""
    joint = ksd.ParallelGuide(
        ksd.Material(E=200e9, nu=0.3, density=7800, **words),
        length=0.1,
        thickness=0.5e-3,
        width=0.03,
        spacing=0.06,
    )
    scene = ksd.Mechanism("guide", plane=plane)
    stage = scene.link("stage", mass=0.5, inertia=(4e-4, 4e-4, 4e-4), at=(0.1, 0, 0))
    scene.join(scene.ground, stage, joint, at=(0, 0, 0), axis="z", toward="x")
    scene.load(stage, force=(0, 20, 0), at=(0.1, 0, 0), name="push")
    return scene


def four_hinges():
    """The fourbar of paper 1 with links that have mass, pushed by 150 N, its drive let go."""
    scene = fourbar()
    scene.mass("top", mass=2.0, inertia=(0.02, 0.02, 0.02), at=(0, HEIGHT, 0))
    for side, x in (("left", -0.2), ("right", 0.2)):
        scene.mass(side, mass=0.5, inertia=(2e-3, 2e-3, 2e-3), at=(x, HEIGHT / 2, 0))
    scene.load("top", force=(150, 0, 0), at=(0, HEIGHT, 0), name="push")
    return scene


def wire():
    """.4 m of round wire with 20 g on its end, in gravity."""
    scene = ksd.Mechanism("wire", plane="xy")
    tip = scene.link("tip", mass=0.02, at=(0.4, 0, 0))
    section = ksd.numbers(
        A=7.854e-7, J=9.818e-14, Iy=4.909e-14, Iz=4.909e-14, ky=0.9, kz=0.9, width=1e-3, thickness=1e-3
    )
    stuff = ksd.Material(E=200e9, G=200e9 / 2.6, density=7919)
    scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(0.4, 0, 0), section=section, material=stuff)
    scene.gravity = (0, -9.81, 0)
    return scene


def rod():
    """A rod of 1.11 x .0127 x .0032 m, bent by 7.187 N at its end."""
    scene = ksd.Mechanism("rod", plane="xy")
    tip = scene.link("tip")
    stuff = ksd.Material(E=200e9, G=80e9, density=7850)
    ends = {"start": (0, 0, 0), "end": (1.11, 0, 0)}
    scene.leaf(scene.ground, tip, **ends, section=rectangle(3.2e-3, 12.7e-3), material=stuff)
    scene.load(tip, force=(0, 7.187, 0), at=(1.11, 0, 0), name="pull")
    return scene


def pendulum():
    """A strip of .3 m on a pin with 50 g on its end, in gravity."""
    scene = ksd.Mechanism("pendulum", plane="xy")
    hub, tip = scene.links("hub", "tip")
    scene.pin(scene.ground, hub, at=(0, 0, 0))
    r = rectangle(0.5e-3, 20e-3)
    section = ksd.numbers(A=r.A, J=r.J, Iy=r.Iy, Iz=r.Iz, ky=0.9, kz=0.9, width=20e-3, thickness=0.5e-3)
    stuff = ksd.Material(E=2e9, G=2e9 / 2.6, density=1200)
    scene.leaf(hub, tip, start=(0, 0, 0), end=(0.3, 0, 0), section=section, material=stuff)
    scene.mass(tip, mass=0.05, inertia=(1e-6, 1e-6, 1e-6), at=(0.3, 0, 0))
    scene.gravity = (0, -9.81, 0)
    return scene


def pivot():
    """A cross flexure of .5 mm with 1 kg, its centre 20 mm beyond B, turned by 1 Nm."""
    joint = cross_flexure(thickness=0.5e-3)
    scene = ksd.Mechanism("pivot")
    tip = scene.link("tip", mass=1.0, inertia=(1e-3, 1e-3, 1e-3), at=(joint.length_AB + 0.02, 0, 0))
    scene.join(scene.ground, tip, joint, at=(0, 0, 0), axis="z", toward="x")
    scene.load(tip, moment=(0, 0, 1.0), name="turn")
    return scene


def strip(offset=0.01):
    """A strip in space with 30 g beside its axis, in gravity."""
    scene = ksd.Mechanism("strip")
    tip = scene.link("tip", mass=0.03, inertia=(2e-6, 2e-6, 2e-6), at=(0.25, 0, offset))
    stuff = ksd.Material(E=70e9, G=70e9 / 2.6, density=2700)
    scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(0.25, 0, 0), section=rectangle(0.5e-3, 20e-3), material=stuff,
        width_axis="z",
    )  # fmt: skip
    scene.gravity = (0, -9.81, 0)
    return scene


def driven_mass(mass=2.0):
    """A rigid body on a drive along x; a massless leaf on it carries 100 g that is held on it."""
    scene = ksd.Mechanism("driven", plane="xy")
    a = scene.link("a", mass=mass, inertia=(0.1, 0.1, 0.1), at=(0, 0, 0))
    b = scene.link("b", mass=0.1, inertia=(1e-4, 1e-4, 1e-4), at=(0.2, 0, 0))
    stuff = ksd.Material(E=200e9, nu=0.3)
    scene.leaf(a, b, start=(0.1, 0, 0), end=(0.2, 0, 0), section=rectangle(5e-4, 2e-2), material=stuff)
    scene.actuate(a, along="x", at=(0, 0, 0), name="push")
    scene.support(a, along="y", at=(0, 0, 0))
    scene.support(a, about="z")
    for axis in "xy":
        scene.support(b, along=axis, at=(0.2, 0, 0), relative_to=a)
    scene.support(b, about="z", relative_to=a)
    return scene
