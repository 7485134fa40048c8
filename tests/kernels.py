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


def joints():
    """Joints by their records, modal bodies, and the five steps of both, which end in an equilibrium."""
    ksd.prepare(fourbar())(top=0.1, method="kinematic", estimate=False)
    ksd.solve(fourbar(), top=0.1, method="modal", basis=ksd.ModalBasis())
    for mesh in (None, CHAIN):
        for planar in (True, False):
            ksd.prepare(fourbar(), mesh=mesh, planar=planar)(top=0.1, method="full")


if __name__ == "__main__":
    {"equilibrium": equilibrium, "joints": joints}[sys.argv[1]]()
