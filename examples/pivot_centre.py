"""Where must two leaf springs cross for a pivot whose centre stays where it is?

To second order the centre moves by L angle^2 (9 r^2 - 9 r + 1)/(15 cos a), r the crossing ratio, a the angle of the leaf
springs to their mean; this is zero at r = 1/2 - sqrt(5)/6 (Zhao and others, J. Mech. Design 133, 2011).
"""

import numpy as np

import ksd
from ksd.units import GPa, deg, mm

L, turn = 60 * mm, 5 * deg
steel = ksd.Material(E=200 * GPa, nu=0.3)


def turned(ratio):
    """A crossed pivot of this crossing ratio, turned."""
    joint = ksd.CrossedPivot(
        steel, length=L, angle=45 * deg, thickness=0.2 * mm, width=15 * mm, ratio=float(ratio)
    )
    scene = ksd.Mechanism("pivot")
    arm = scene.link("arm")
    placed = scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="x", name="pivot")
    scene.actuate_joint(placed, name="turn")
    return ksd.solve(scene, turn=turn)


middle, best = 0.5, 0.5 - np.sqrt(5) / 6
symmetric, quiet = turned(middle), turned(best)
shift_middle, shift_best = (
    float(np.linalg.norm(pose.pivot_shift("pivot").shift)) for pose in (symmetric, quiet)
)
stiffness_middle, stiffness_best = (pose.forces["turn"] / turn for pose in (symmetric, quiet))


def picture(path=None):
    """The pivot whose centre stays, turned."""
    return quiet.plot(path)


print(f"turned by {turn / deg:g} degrees, the centre moves by")
print(f"{shift_middle / mm * 1e3:.4f} um where the leaf springs cross in the middle,")
print(f"{shift_best / mm * 1e3:.4f} um where they cross at {best:.4f} of their length,")
print(f"which takes {stiffness_best / stiffness_middle:.3f} times the moment")

if __name__ == "__main__":
    picture("pivot_centre.png")
