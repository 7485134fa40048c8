"""How much pull does a gripper with two fingers on arc flexures bear before the disc slips out?

Each plastic finger stands on two half circles of 8 mm radius, .8 x 6 mm, whose base is driven; they close on a disc of 15 mm
that nothing else holds, friction .4. A drive that moves the disc until both contacts slip takes the same force, by balance
the sum of what they bear, N and mu N in the directions of the tilted jaws.
"""

import numpy as np

import ksd
from ksd.units import GPa, mm

plastic = ksd.Material(E=2.5 * GPa, nu=0.38)
section = ksd.rectangle(0.8 * mm, 6 * mm)
friction, at, close = 0.4, (60 * mm, 0, 0), {"lower": 3 * mm, "upper": -3 * mm}


def gripper(driven=False):
    """The gripper, with a disc that is free or driven along x."""
    scene = ksd.Mechanism("disc gripper", plane="xy")
    disc = scene.link("disc")
    for name, side in (("lower", -1), ("upper", 1)):
        base, finger = scene.links(f"{name} base", f"{name} finger")
        words = {"curve": ksd.Arc(radius=8 * mm, angle=side * np.pi), "section": section, "material": plastic}
        for x in (0, 30 * mm):
            start, end = (x, side * 37 * mm, 0), (x, side * 21 * mm, 0)
            scene.leaf(base, finger, start=start, end=end, name=f"{name} {x / mm:.0f}", **words)
        scene.actuate(base, along="y", at=(15 * mm, side * 37 * mm, 0), name=name)
        scene.support(base, along="x", at=(15 * mm, side * 37 * mm, 0))
        scene.support(base, about="z")
        tip = (60 * mm, side * 15 * mm, 0)
        jaw = scene.surface(finger, ksd.shapes.wall(), at=tip, axis=(0, -side, 0))
        edge = scene.surface(disc, ksd.shapes.disc(15 * mm), at=at, name=f"{name} edge")
        scene.contact(jaw, edge, friction=friction, name=f"{name} grip")
    if driven:
        scene.actuate(disc, along="x", at=at, name="x")
    return scene


gripped = ksd.walk(gripper(), [close], steps=2)[-1]
N = gripped.contacts["lower grip"].N
pull = ksd.pull_out(gripped, "disc", along="x", at=at)
place = float(gripped.displacement("disc", at)[0])
driven = ksd.walk(gripper(driven=True), [close | {"x": place}, {"x": place + 0.42 * mm}])[-1]
drive = driven.forces["x"] / pull
balance = driven.forces["x"] / -sum(c.force[0] for c in driven.contacts.values())
slips = min(np.linalg.norm(c.T) / (friction * c.N) for c in driven.contacts.values())


def picture(path=None):
    """The gripped disc."""
    return gripped.plot(path)


print(gripped.grasp("disc", at=at))
print(f"{N:.4f} N of grip; pulled out by {pull:.4f} N, {pull / (2 * friction * N):.4f} of 2 mu N")
print(f"a drive slides it with {drive:.5f} of that, {balance:.6f} of what the contacts bear")

if __name__ == "__main__":
    picture("disc_gripper.png")
