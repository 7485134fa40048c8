"""Which spring takes the stiffness out of a pivot?

A spring of zero free length between two points at radius a on both sides of the pivot drives it away from rest with the
moment k a^2 sin(q), q the rotation (Herder, Energy-free systems, 2001). It also pulls the pivot along its centre shift L
q^2/(12 cos c), c the angle of the leaf springs. To second order k = K/(a^2 + a L/(3 cos c)) balances a pivot of stiffness
K.
"""

import numpy as np

import ksd
from ksd.units import GPa, deg, mm

L, t, a, turn = 60 * mm, 0.3 * mm, 50 * mm, 30 * deg

steel = ksd.Material(E=200 * GPa, nu=0.3)
joint = ksd.CrossFlexure(steel, length=L, angle=45 * deg, thickness=t, widths=(20 * mm, 10 * mm), gap=1 * mm)
K = joint.stiffness_at_rest()
middle = joint.length_AB / 2
spring = K / (a**2 + a * L / (3 * np.cos(45 * deg)))


def pivot(spring):
    """The pivot with a spring of this stiffness [N/m]."""
    scene = ksd.Mechanism("pivot")
    arm = scene.link("arm")
    placed = scene.join(scene.ground, arm, joint, at=(-middle, 0, 0), axis="z", toward="x")
    scene.actuate_joint(placed, name="turn")
    if spring:
        scene.spring("ground", arm, start=(a, 0, 0), end=(-a, 0, 0), stiffness=spring, free_length=0)
    return scene


bare = ksd.solve(pivot(0.0), turn=turn)
balanced = ksd.solve(pivot(spring), turn=turn)
moment, left = bare.forces["turn"], balanced.forces["turn"]
at_rest = ksd.solve(pivot(spring), turn=0.0).drive_stiffness()["turn"]


def picture(path=None):
    """The balanced pivot, turned."""
    return balanced.plot(path)


print(f"moment at {turn / deg:g} degrees {moment:.4f} Nm, with a spring of {spring:.2f} N/m {left:.4f} Nm")
print(f"stiffness at rest {K:.4f} Nm/rad, balanced {at_rest:.5f} Nm/rad")

if __name__ == "__main__":
    picture("balanced_pivot.png")
