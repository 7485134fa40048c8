"""Which force moves a slider on two leaf springs that are joined by a pin?

Lan (2005), chapter 2: leaf spring 1 from ground to C, leaf spring 2 from a slider along x to C, both clamped at their base
and pinned to each other at C. EI 0.08 Nm^2, 100 mm each, without stretch and shear (1e9 EI/L^2).
"""

import numpy as np

import ksd
from ksd.units import deg, mm

EI, length, slope, stroke = 0.08, 100 * mm, 90 * deg, 20 * mm

stuff = ksd.Material(E=1e9, nu=0.3)
area, inertia = 1e9 * EI / length**2 / stuff.E, EI / stuff.E
across = float(np.sqrt(12 * inertia / area))
section = ksd.numbers(A=area, J=inertia, Iy=inertia, Iz=inertia, width=across, thickness=across)

C = np.array([length, 0, 0])
base = C - length * np.array([np.cos(slope), np.sin(slope), 0])
scene = ksd.Mechanism("slider", plane="xy")
one, two, block = scene.links("one", "two", "block")
scene.leaf(scene.ground, one, start=(0, 0, 0), end=C, section=section, material=stuff)
scene.leaf(block, two, start=base, end=C, section=section, material=stuff)
scene.pin(one, two, at=C, name="C")
scene.slider(block, along="x", at=base)
scene.actuate(block, along="x", at=base, name="stroke")

pose = ksd.solve(scene, stroke=stroke)
force = pose.forces["stroke"]
pin_x, pin_y, _ = pose.interface_forces().of("C", "one").force
C_x, C_y, _ = pose.displacement(one, C)


def picture(path=None):
    """The pushed mechanism over the one at rest."""
    return pose.plot(path)


print(f"pushed by {stroke / mm:g} mm: {force:.6f} N; pin force ({pin_x:.6f}, {pin_y:.6f}) N")
print(f"the pin moves by ({C_x / mm:.6f}, {C_y / mm:.6f}) mm")

if __name__ == "__main__":
    picture("slider.png")
