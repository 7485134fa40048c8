"""How hard does a soft finger press on the ellipse that it bends around, and where?

A rubber finger of 178 mm, 30 to 17 mm thick, is turned against an ellipse of 99 x 67 mm semi-axes (Lan, Computational models
for design and analysis of compliant mechanisms, 2005, 6.4, Ex. II; the length is a guess), without stretch.
"""

import numpy as np

import ksd
from ksd.units import MPa, deg, mm

thick, thin, width, length, nu = 30 * mm, 17 * mm, 25 * mm, 177.8 * mm, 0.4
shear = (5 + 5 * nu) / (6 + 5 * nu)
rubber = ksd.Material(E=4.8 * MPa, G=1.71 * MPa)
open_angle, closed_angle, place = 175 * deg, 90 * deg, (50.8 * mm, 120.65 * mm, 0)


def section(s):
    """The section at fraction s, 1e4 times as stiff in stretch, by a shear factor that leaves shear as it is."""
    t = thick + s * (thin - thick)
    A, k = 1e4 * t * width, 1e-4 * shear
    Iy, Iz = t * width**3 / 12, width * t**3 / 12
    return ksd.numbers(A=A, J=Iy + Iz, Iy=Iy, Iz=Iz, ky=k, kz=k, width=width, thickness=t)


def gripper(friction):
    """A finger that is turned by its root, and an ellipse that is driven along x."""
    scene = ksd.Mechanism("finger around an ellipse", plane="xy")
    root, tip, held = scene.links("root", "tip", "ellipse")
    end = length * np.array([np.cos(open_angle), np.sin(open_angle), 0])
    words = {"section": section(0.5), "profile": ksd.Varying(section), "material": rubber}
    scene.leaf(root, tip, start=(0, 0, 0), end=end, name="finger", **words)
    scene.actuate(root, about="z", name="turn")
    scene.actuate(held, along="x", at=place, name="x")
    for link, at, along in ((root, (0, 0, 0), "x"), (root, (0, 0, 0), "y"), (held, place, "y")):
        scene.support(link, along=along, at=at)
    scene.support(held, about="z")
    outline = scene.surface(held, ksd.shapes.ellipse(99.06 * mm, 67.31 * mm), at=place, toward=(1, 0, 0))
    scene.contact("finger", outline, friction=friction, name="grip")
    return scene


closed = {"turn": closed_angle - open_angle, "x": 0.0}
pose = ksd.walk(gripper(0.0), [closed], steps=2)[-1]
# drawn to the right the ellipse drags the finger along, to the left against
ways = ([closed | {"x": x}, closed] for x in (-5 * mm, 5 * mm))
dragged, against = (ksd.walk(gripper(0.5), way, steps=2)[-1] for way in ways)
smooth, along, back = (p.contacts["grip"].N for p in (pose, dragged, against))
where = next(p.s for p in pose.model.scene.points)


def picture(path=None):
    """The finger around the ellipse."""
    return pose.plot(path)


print(f"without friction {smooth:.3f} N, {where / mm:.2f} mm from the root")
print(f"with friction .5 {along:.3f} or {back:.3f} N")
if __name__ == "__main__":
    picture("finger_around_ellipse.png")
