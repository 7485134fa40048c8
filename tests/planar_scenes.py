"""Planar mechanisms of Lan's thesis (2005) and of its chapter 2, for tests of what is asked of them.

Rods without stretch and shear are drawn with 1/EA and 1/GA at 1e-9 of EI/L^2: "inextensible" to 1e-9.
"""

import math

import numpy as np

import ksd

FINE = ksd.Mesh(orders=(3, 2, 12), points=16)
SOFT = ksd.Material(E=1e9, nu=0.3, name="inextensible")


def rod(EI, length):
    """A section of this EI on `SOFT` that neither stretches nor shears."""
    A = 1e9 * EI / length**2 / SOFT.E
    I = EI / SOFT.E
    return ksd.numbers(A=A, J=I, Iy=I, Iz=I, width=math.sqrt(12 * I / A), thickness=math.sqrt(12 * I / A))


def slider(phi):
    """Two leaf springs pinned together at C, one on ground, one on a slider that moves along x."""
    scene = ksd.Mechanism("slider", plane="xy")
    one, two, block = scene.links("one", "two", "slider")
    C = np.array([0.1, 0, 0])
    B = C - 0.1 * np.array([math.cos(phi), math.sin(phi), 0])
    scene.leaf("ground", one, start=(0, 0, 0), end=C, section=rod(0.08, 0.1), material=SOFT)
    scene.leaf(block, two, start=B, end=C, section=rod(0.08, 0.1), material=SOFT)
    scene.pin(one, two, at=C, name="C")
    scene.slider(block, along="x", at=B)
    scene.actuate(block, along="x", at=B, name="d")
    return scene


def indexer():
    """An arc from a block that moves along y to a joint, which a straight leaf spring holds from ground."""
    stuff, section = ksd.Material(E=70e9, nu=0.3), ksd.rectangle(0.6e-3, 10e-3)
    r, a = 12e-3, 1.2
    end = np.array([r * math.sin(a), -r * (1 - math.cos(a)), 0.0])
    scene = ksd.Mechanism("indexer", plane="xy")
    block, joint = scene.links("block", "C")
    scene.leaf(
        block,
        joint,
        start=(0, 0, 0),
        end=end,
        curve=ksd.Arc(radius=r, angle=-a),
        section=section,
        material=stuff,
    )
    scene.leaf("ground", joint, start=end - (0, 8e-3, 0), end=end, section=section, material=stuff)
    scene.slider(block, along="y", at=(0, 0, 0))
    scene.actuate(block, along="y", at=(0, 0, 0), name="d")
    return scene
