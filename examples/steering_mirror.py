"""Which moment turns a mirror by 2 degrees in 12 ms, and what does it do to its mount if its centre is off the axis?

A mirror of 40 g on a pivot of two crossed leaf springs, its centre of mass 8 mm in front of the axis, turned by a cycloid.
The numbers are those of a rigid body on an ideal hinge: the moment is (J + m r^2) alpha + 2 EI/L angle, the force on the
mount m r alpha, with alpha = 2 pi angle/T^2 at a quarter of the stroke.
"""

import numpy as np

import ksd
from ksd.units import GPa, deg, mm, ms

turn, duration = 2 * deg, 12 * ms
mass, inertia, off = 0.04, 1e-5, 8 * mm
steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800)
joint = ksd.CrossedPivot(steel, length=30 * mm, angle=45 * deg, thickness=0.1 * mm, width=10 * mm)
axis = 15 * mm * np.cos(45 * deg)  # where the leaf springs cross


def moved(centre):
    """The motion of a mirror whose centre is this far from the axis."""
    scene = ksd.Mechanism("steering mirror", plane="xy")
    mirror = scene.link("mirror", mass=mass, inertia=(inertia,) * 3, at=(axis + centre, 0, 0))
    placed = scene.join(scene.ground, mirror, joint, at=(0, 0, 0), axis="z", toward="x", name="pivot")
    scene.actuate_joint(placed, name="turn")
    return ksd.simulate(scene, "20 ms", dt="0.1 ms", drives={"turn": ksd.Cycloid(turn, duration=duration)})


def force_on_mount(history):
    """Force [N] across on ground, at a quarter of the stroke."""
    return float(history[duration / 4].interface_forces().of("pivot", "ground").force[1])


history, balanced = moved(off), moved(0.0)
torque = history.drives["turn"].force
most, quarter = float(torque.max()), float(np.interp(duration / 4, history.t, torque))
shake, rest = force_on_mount(history), force_on_mount(balanced)


def picture(path=None):
    """Angle and moment over time."""
    return history.plot("turn", "turn force", path=path)


print(history)
print(f"moment {1e3 * most:.3g} mNm; {shake:.3g} N on the mount, {rest:.2g} N with its centre on the axis")

if __name__ == "__main__":
    picture("steering_mirror.png")
