"""What force closes a snap-fit, and what opens it again?

A plastic hook of 20 x 6 x 1.5 mm, its nose with flanks of 30 and 50 degrees, is pushed over a round catch and drawn back.
By beam theory the lateral force is 3 EI/L^3 times the deflection; a flank of the angle a makes the axial force
(tan a + mu) / (1 - mu tan a) times as large, friction mu = .2 (Bayer, Plastic part design for snap-fits).
"""

import numpy as np

import ksd
from ksd.units import GPa, deg, mm

length, friction, height = 20 * mm, 0.2, 0.8 * mm
plastic = ksd.Material(E=2.4 * GPa, nu=0.38)
section = ksd.rectangle(1.5 * mm, 6 * mm)

scene = ksd.Mechanism("snap-fit", plane="xy")
base, hook = scene.links("base", "hook")
scene.leaf(base, hook, start=(0, 0, 0), end=(length, 0, 0), section=section, material=plastic, name="beam")
scene.actuate(base, along="x", at=(0, 0, 0), name="push")
scene.support(base, along="y", at=(0, 0, 0))
scene.support(base, about="z")
# the nose hangs below the tip: flank in front, edge at the end of the beam, steep flank behind
front, behind = 1.2 * mm / np.tan(30 * deg), 1.2 * mm / np.tan(50 * deg)
nose = ksd.shapes.polygon([(-behind, 0), (0, -1.2 * mm), (front, 0)])
scene.surface(hook, nose, at=(length, 0, 0), name="nose")
catch = (length + front, -1.2 * mm - 0.5 * mm + height, 0)
scene.surface("ground", ksd.shapes.disc(0.5 * mm), at=catch, name="catch")
scene.contact("nose", "catch", friction=friction, name="snap")

walk = ksd.walk(scene, [{"push": 3.6 * mm}, {"push": 0.0}], steps=36)
travel, force = walk.along(lambda pose: [pose.targets["push"], pose.forces["push"]]).T
top, out = int(force.argmax()), int(force.argmin())
insertion, retention = float(force[top]), float(-force[out])


def share(k, flank):
    """Axial force of pose k over that of a flank, turned with the hook, from its lateral force."""
    pushes = next(c for c in walk[k].contacts.values() if c.N > 0.0).force
    tan = np.tan(flank * deg + np.sign(force[k]) * walk[k].rotation(hook)[2])
    return abs(pushes[0] / pushes[1]) / ((tan + friction) / (1 - friction * tan))


inward, outward = share(top, 30), share(out, 50)
sideways = next(c for c in walk[top].contacts.values() if c.N > 0.0).force[1]
bent = float(walk[top].displacement(hook)[1])
beam = abs(sideways) / (3 * plastic.E * section.Iz / length**3 * bent)


def picture(path=None):
    """The hook where it takes the largest force."""
    return walk[top].plot(path)


print(f"insertion {insertion:.3f} N at {travel[top] / mm:.1f} mm, retention {retention:.3f} N")
print(f"over the force of the flanks {inward:.4f} and {outward:.4f}, of beam theory {beam:.3f}")

if __name__ == "__main__":
    picture("snap_fit.png")
