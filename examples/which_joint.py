"""Which joint for 10 degrees: crossed pivot, cartwheel, or butterfly?

All of 0.3 mm sheet, 20 mm wide, about 45 mm long. Closed forms of the stiffness at small angles: 8 (1 - 3 r + 3 r^2) EI/L of
leaf springs of length L that cross at the ratio r, cartwheel 8 EI/L, butterfly a quarter of a pivot with r = -inner/L.
"""

import numpy as np

import ksd
from ksd.units import GPa, MPa, deg, mm

L, t, w, turn = 60 * mm, 0.3 * mm, 20 * mm, 10 * deg
inner, ray = 4 * mm, 17 * mm  # of the butterfly
steel = ksd.Material(E=200 * GPa, nu=0.3)
sheet = {"thickness": t, "width": w}
joints = {
    "crossed in the middle": ksd.CrossedPivot(steel, length=L, angle=45 * deg, **sheet),
    "crossed at 0.127": ksd.CrossedPivot(steel, length=L, angle=45 * deg, ratio=0.5 - 5**0.5 / 6, **sheet),
    "cartwheel": ksd.Cartwheel(steel, length=L, angle=45 * deg, **sheet),
    "butterfly": ksd.Butterfly(steel, length=ray, inner=inner, half_angle=15 * deg, **sheet),
}


def turned(joint):
    """The joint between ground and an arm, turned."""
    scene = ksd.Mechanism("joint")
    arm = scene.link("arm")
    placed = scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="x", name="joint")
    scene.actuate_joint(placed, name="turn")
    return ksd.solve(scene, turn=turn)


poses = {name: turned(joint) for name, joint in joints.items()}
EI = steel.E * w * t**3 / 12
moments = {name: pose.forces["turn"] * L / (EI * turn) for name, pose in poses.items()}
crossed, quiet, cartwheel, butterfly = moments.values()
print("                        moment    stress  centre moves  softest support")
for name, pose in poses.items():
    shift = np.linalg.norm(pose.pivot_shift("joint").shift)
    soft, _ = pose.stiffness("arm", at=(joints[name].length_AB / 2, 0, 0)).worst
    print(
        f"{name:21} {1e3 * pose.forces['turn']:5.1f} mNm {pose.stress().largest_Pa / MPa:4.0f} MPa"
        f" {shift / mm * 1e3:9.1f} um {soft / 1e6:11.3f} N/um"
    )


def picture(path=None):
    """The butterfly, turned."""
    return poses["butterfly"].plot(path, color="stress")


if __name__ == "__main__":
    picture("which_joint.png")
