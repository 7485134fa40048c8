"""What weight do three fingers hold that close on a ball which nothing else holds?

Three fingers 120 degrees apart about the vertical x, each on two steel leaf springs of 60 x .3 x 10 mm with a flat pad, move
inwards by 2 mm on a ball of 15 mm radius, friction .3. By beam theory each presses with 24 EI/L^3 times that, and all bear 3
mu N; a drive that moves the ball until all contacts slip takes what they bear.
"""

import numpy as np

import ksd
from ksd.units import GPa, mm

steel, blade = ksd.Material(E=200 * GPa, nu=0.3), ksd.rectangle(0.3 * mm, 10 * mm)
friction, radius = 0.3, 15 * mm
middle = np.array([70 * mm, 0, 0])


def hand(driven=False):
    """The hand, with a ball that is free or driven along x."""
    scene = ksd.Mechanism("ball in three fingers")
    ball = scene.link("ball")
    for k in range(3):
        angle = 2 * np.pi * k / 3
        out = np.array([0, np.cos(angle), np.sin(angle)])
        base, finger = scene.links(f"base{k}", f"finger{k}")
        words = {"section": blade, "material": steel, "width_axis": np.cross((1, 0, 0), out)}
        for name, r in (("inner", 20 * mm), ("outer", 40 * mm)):
            start, end = r * out, r * out + np.array([60 * mm, 0, 0])
            scene.leaf(base, finger, start=start, end=end, name=f"{name} leaf {k}", **words)
        scene.slider(base, along=-out, at=(0, 0, 0))
        scene.actuate(base, along=-out, at=(0, 0, 0), name=f"close{k}")
        pad = scene.surface(finger, ksd.shapes.wall(), at=middle + radius * out, axis=-out, name=f"pad{k}")
        place = scene.surface(ball, ksd.shapes.ball(radius), at=middle, name=f"side{k}")
        scene.contact(pad, place, friction=friction, name=f"grip{k}")
    if driven:
        scene.slider(ball, along="x", at=middle)
        scene.actuate(ball, along="x", at=middle, name="x")
    return scene


close = {f"close{k}": 2 * mm for k in range(3)}
closed = ksd.walk(hand(), [close], steps=4)[-1]
forces = np.array([c.N for c in closed.contacts.values()])
beam = float(forces[0] / (24 * steel.E * blade.Iz / (60 * mm) ** 3 * 2 * mm))
weight = ksd.pull_out(closed, "ball", along="-x", at=middle)
held = weight / (3 * friction * float(forces[0]))
here = float(closed.displacement("ball", middle)[0])
driven = ksd.walk(hand(driven=True), [close | {"x": here}, {"x": here - 2e-6}])[-1]
drive = -driven.forces["x"] / weight


def picture(path=None):
    """The ball in its fingers."""
    return closed.plot(path)


print(f"{forces.round(4)} N, {beam:.5f} of beam theory")
print(f"it holds {weight:.4f} N, {held:.4f} of 3 mu N; a drive takes {drive:.5f} of it")
if __name__ == "__main__":
    picture("ball_in_three_fingers.png")
