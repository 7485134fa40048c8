"""What force does a passive gripper take to go over a pin, and what to come off again?

A plastic finger of 57 x 9.5 x 3.2 mm with a triangular jaw, lead angle 25 degrees, and a pin of 8.9 mm radius (Lan,
Computational models for design and analysis of compliant mechanisms, 2005, 6.4, Ex. I). Steeper behind, it holds better than
it goes on. A force on a flank at the angle a is (tan a + mu) / (1 - mu tan a) times as large along as across.
"""

import numpy as np

import ksd
from ksd.units import GPa, deg, mm

length, thickness, width, pin_radius, friction = 57 * mm, 3.2 * mm, 9.5 * mm, 8.9 * mm, 0.2
lead, behind, jaw_length = 25 * deg, 60 * deg, 19 * mm
height = jaw_length * np.tan(lead)
start = np.array([79 * mm, 10.5 * mm, 0])


def gripper(friction):
    """Half of the gripper, its pin driven along x."""
    scene = ksd.Mechanism("passive gripper", plane="xy")
    jaw, pin = scene.links("jaw", "pin")
    section, plastic = ksd.rectangle(thickness, width), ksd.Material(E=2.6 * GPa, nu=0.38)
    scene.leaf("ground", jaw, start=(0, 0, 0), end=(length, 0, 0), section=section, material=plastic)
    scene.actuate(pin, along="x", at=start, name="x")
    scene.support(pin, along="y", at=start)
    scene.support(pin, about="z")
    corners = [(-height / np.tan(behind), 0), (jaw_length, 0), (0, height)]
    scene.surface(jaw, ksd.shapes.polygon(corners), at=(length, 1.6 * mm, 0), name="triangle")
    scene.surface(pin, ksd.shapes.disc(pin_radius), at=start, name="round")
    scene.contact("triangle", "round", friction=friction, name="grip")
    return scene


walk = ksd.walk(gripper(friction), [{"x": -42 * mm}, {"x": 0.0}], steps=42)
travel, force = walk.along(lambda pose: [pose.targets["x"], pose.forces["x"]]).T
on, off = int(force.argmin()), int(force.argmax())
insertion, retention = float(-force[on]), float(force[off])
flanks = []
for k, flank in ((10, lead), (55, behind)):
    tan = np.tan(flank + np.sign(force[k]) * walk[k].rotation("jaw")[2])
    along, across = np.abs(walk[k].contacts["grip"].force[:2])
    flanks.append(float(along / across / ((tan + friction) / (1 - friction * tan))))
inward, outward = flanks
paper_x, paper_y, _ = ksd.solve(gripper(0.0), x=67.81 * mm - start[0]).contacts["grip"].force


def picture(path=None):
    """The gripper where it takes the largest force."""
    return walk[on].plot(path)


print(f"on by {insertion:.2f} N at {-travel[on] / mm:.0f} mm, off by {retention:.2f} N")
print(f"at 67.8 mm without friction {paper_x:.3f} and {paper_y:.3f} N")
if __name__ == "__main__":
    picture("passive_gripper.png")
