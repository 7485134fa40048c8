"""How far does a slender cantilever bend under a transverse force at its tip?

Lan, Computational Models for Design and Analysis of Compliant Mechanisms (2005), table 2.3: EI 0.08 Nm^2, length
101.6 mm, 15 N. The thesis neglects stretch and shear, so the section here has axial and shear stiffness 1e9 EI/L^2.
"""

import numpy as np

import ksd
from ksd.units import deg, mm

EI, length, force = 0.08, 101.6 * mm, 15.0

stuff = ksd.Material(E=1e9, nu=0.3)
area, inertia = 1e9 * EI / length**2 / stuff.E, EI / stuff.E
across = float(np.sqrt(12 * inertia / area))
section = ksd.numbers(A=area, J=inertia, Iy=inertia, Iz=inertia, width=across, thickness=across)

scene = ksd.Mechanism("cantilever", plane="xy")
tip = scene.link("tip")
scene.leaf(scene.ground, tip, start=(0, 0, 0), end=(length, 0, 0), section=section, material=stuff)
scene.load(tip, force=(0, force, 0), at=(length, 0, 0))

pose = ksd.solve(scene)
u_x, y, _ = pose.displacement(tip)
x = length + u_x
angle = pose.rotation(tip)[2]
check = pose.verify().relative


def picture(path=None):
    """The bent cantilever over the straight one."""
    return pose.plot(path)


print(f"tip at x = {x / mm:.6f} mm, y = {y / mm:.6f} mm, turned by {angle / deg:.5f} deg")
print(f"it differs from an integrated rod by {100 * check:.2g} %")

if __name__ == "__main__":
    picture("cantilever.png")
