"""How far does a curved finger push the pawl of an indexer sideways?

After Lan (2005), chapter 2: an arc of 12 mm radius and 1.2 rad is clamped to a block that only moves along y. Its other end
is clamped to a body C on top of a straight leaf spring of 8 mm. The block moves down by 1 and 2 mm.
"""

import numpy as np

import ksd
from ksd.units import GPa, mm, mrad

radius, angle, post = 12 * mm, 1.2, 8 * mm
stuff, section = ksd.Material(E=70 * GPa, nu=0.3), ksd.rectangle(0.6 * mm, 10 * mm)
C = radius * np.array([np.sin(angle), np.cos(angle) - 1, 0])

scene = ksd.Mechanism("indexer", plane="xy")
block, joint = scene.links("block", "C")
scene.leaf(
    block,
    joint,
    start=(0, 0, 0),
    end=C,
    curve=ksd.Arc(radius=radius, angle=-angle),
    section=section,
    material=stuff,
)
scene.leaf(scene.ground, joint, start=C - (0, post, 0), end=C, section=section, material=stuff)
scene.slider(block, along="y", at=(0, 0, 0))
scene.actuate(block, along="y", at=(0, 0, 0), name="d")

solver = ksd.prepare(scene)
one, two = (solver(d=-d) for d in (1 * mm, 2 * mm))
force_one, force_two = -one.forces["d"], -two.forces["d"]
turn = float(one.rotation(joint)[2])
C_x, C_y, _ = two.displacement(joint, C)


def picture(path=None):
    """The indexer with its block 2 mm down, leaf springs coloured by stress."""
    return two.plot(path, color="stress")


print(f"block down by 1 mm: {force_one:.4f} N, C turns by {turn / mrad:.4f} mrad")
print(f"block down by 2 mm: {force_two:.4f} N, C moves by ({C_x / mm:.6f}, {C_y / mm:.6f}) mm")

if __name__ == "__main__":
    picture("indexer.png")
