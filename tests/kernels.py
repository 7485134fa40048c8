"""Compiles what most tests need: `python kernels.py equilibrium` and `python kernels.py joints`, best beside each other.

Each begins with what the other needs last, so that hardly a kernel is compiled by both.
"""

import sys

from scenes import fourbar

import ksd

CHAIN = ksd.Mesh("corotational", elements=2)


def equilibrium():
    """Newton's method in the plane and in space, of leaf springs and of chains, and what is asked of its states."""
    for mesh in (None, CHAIN):
        for planar in (True, False):
            ksd.prepare(fourbar(), mesh=mesh, planar=planar)(top=0.1, method="conventional")
    pose = ksd.solve(fourbar(), top=0.1, method="conventional")
    pose.stiffness("top")
    pose.frequencies(freed="top")
    pose.verify()
    for plane in (None, "xy"):
        scene, leaf = strip(plane)
        scene.line_load(leaf, force=(0, 1.0, 0))
        ksd.simulate(scene, 2e-3, dt=1e-3, progress=False)


def joints():
    """Joints by their records, modal bodies, and the five steps of both, which end in an equilibrium."""
    ksd.prepare(fourbar())(top=0.1, method="kinematic", estimate=False)
    ksd.solve(fourbar(), top=0.1, method="modal", basis=ksd.ModalBasis())
    for mesh in (None, CHAIN):
        for planar in (True, False):
            ksd.prepare(fourbar(), mesh=mesh, planar=planar)(top=0.1, method="full")
    for plane in (None, "xy"):
        scene, _ = strip(plane)
        scene.stop("tip", along="y", at=(0.1, 0, 0), high=1e-3, name="end")
        scene.load("tip", force=(0, 1.0, 0), at=(0.1, 0, 0))
        ksd.solve(scene)


def strip(plane):
    """A strip from ground to a tip, and the leaf."""
    scene = ksd.Mechanism("strip", plane=plane)
    tip = scene.link("tip")
    steel, section = ksd.Material(E=200e9, nu=0.3, density=7800.0), ksd.rectangle(1e-3, 0.01)
    return scene, scene.leaf("ground", tip, start=(0, 0, 0), end=(0.1, 0, 0), section=section, material=steel)


if __name__ == "__main__":
    {"equilibrium": equilibrium, "joints": joints}[sys.argv[1]]()
