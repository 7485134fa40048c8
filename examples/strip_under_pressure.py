"""How far does a reed open under pressure, and what does it do to its clamp?

A steel reed of 100 x 10 x .5 mm, clamped at one end, under .1 to 10 kPa on one face. For small pressures its tip rises by
p w L^4/(8 EI) (Roark, table 8.1). In every state the force on the clamp is p w times its chord, turned by a quarter.
"""

import math

import ksd
from ksd.units import GPa, kPa, mm

length, thickness, width = 100 * mm, 0.5 * mm, 10 * mm
steel = ksd.Material(E=200 * GPa, nu=0.3, yield_stress=1.5 * GPa)
section = ksd.rectangle(thickness, width)
EI = steel.E * section.Iz


def reed(pressure):
    """The reed under this pressure [Pa] from below."""
    scene = ksd.Mechanism("reed", plane="xy")
    tip = scene.link("tip")
    leaf = scene.leaf(
        scene.ground, tip, start=(0, 0, 0), end=(length, 0, 0), section=section, material=steel, name="reed"
    )
    scene.pressure(leaf, pressure, side="+e2")
    return scene


poses = {p: ksd.solve(reed(p * kPa)) for p in (0.1, 1, 3, 10)}
rises = {p: float(pose.displacement("tip")[1]) for p, pose in poses.items()}
small = rises[0.1] / (0.1 * kPa * width * length**4 / (8 * EI))

most = poses[10]
clamp = most.interface_forces().of("reed", "ground").force
move = most.displacement("tip")
chord = math.hypot(length + move[0], move[1])
push = math.hypot(clamp[0], clamp[1])
stress = most.stress().largest_Pa


def picture(path=None):
    """The reed under 10 kPa."""
    return most.plot(path)


for p, rise in rises.items():
    print(f"{p:5.1f} kPa: the tip rises by {rise / mm:8.4f} mm")
print(f"small pressures: {small:.6f} of beam theory")
print(f"10 kPa: {push:.5f} N on the clamp, chord {chord / mm:.4f} mm, stress {stress / 1e6:.1f} MPa")

if __name__ == "__main__":
    picture("strip_under_pressure.png")
