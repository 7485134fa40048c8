"""How stiff in its plane is a stage on three folded leaf springs?

A folded leaf spring constrains one direction, that of its fold line. Three of them with tangential fold lines at radius r
constrain x, y and the rotation about z and leave tip, tilt and piston free. With the stiffness k along a fold line,
1/k = 2 (L^3/3EI + 6 L/5GA), I = t w^3/12 (van Eijk, 1985), it is 3 k/2 along x and y and 3 k r^2 about z.
"""

import numpy as np

import ksd
from ksd.units import GPa, mm

L, t, w, R = 40 * mm, 0.3 * mm, 20 * mm, 60 * mm

steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800)
folded = ksd.FoldedLeaf(steel, length=L, thickness=t, width=w)
reach = L * np.sqrt(
    2
)  # distance between the ends of a folded leaf spring; its fold lies half of that further out

scene = ksd.Mechanism("folded leaf stage")
stage = scene.link("stage", mass=0.5, inertia=(4e-4, 4e-4, 8e-4), at=(0, 0, 0))
for k in range(3):
    out = np.array([np.cos(2 * np.pi * k / 3), np.sin(2 * np.pi * k / 3), 0])
    along = np.cross((0, 0, 1), out)
    scene.constrain(
        scene.ground,
        stage,
        folded,
        at=R * out - (0, 0, reach / 2),
        axis=along,
        toward="z",
        name=f"leaf {k + 1}",
    )

pose = ksd.solve(scene)
stiff = pose.stiffness(stage, at=(0, 0, 0)).supports
x, rz, z = stiff["x"], stiff["rz"], stiff["z"]
modes = pose.frequencies(count=4)
first, fourth = modes.frequency_Hz[0], modes.frequency_Hz[3]


def picture(path=None):
    """The stage from the side."""
    return pose.plot(path, view=(-75, 20))


print(
    f"held: x {x / 1e6:.3f} N/um, about z {rz:.0f} Nm/rad; free: z {z / 1e3:.2f} N/mm, {x / z:.0f} times softer"
)
print(f"frequencies: tip, tilt and piston from {first:.1f} Hz, the first held direction at {fourth:.0f} Hz")

if __name__ == "__main__":
    picture("folded_leaf_stage.png")
