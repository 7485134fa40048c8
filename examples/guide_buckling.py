"""How much may a guide carry on its leaf springs before it buckles?

Two upright leaf springs with the load on top. Closed forms (Euler): with a free drive the stage sways at 2 pi^2 EI/L^2; with
the drive held the leaf springs buckle as clamped at both ends, at 8 pi^2 EI/L^2. Half of the first load reduces the drive
stiffness by nearly a half.
"""

import numpy as np

import ksd
from ksd.units import GPa, mm

L, t, w, spacing = 100 * mm, 0.5 * mm, 20 * mm, 80 * mm

steel = ksd.Material(E=200 * GPa, nu=0.3)
joint = ksd.ParallelGuide(steel, length=L, thickness=t, width=w, spacing=spacing)
euler = 2 * np.pi**2 * steel.E * w * t**3 / 12 / L**2


def loaded(weight):
    """The guide with a weight [N] on the middle of its stage."""
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage")
    placed = scene.join(scene.ground, stage, joint, at=(0, 0, 0), axis="z", toward="y")
    scene.actuate_joint(placed, name="d")
    if weight:
        scene.load(stage, force=(0, -weight, 0), at=(0, L, 0))
    return ksd.solve(scene, d=0.0)


bare, half = loaded(0.0), loaded(euler / 2)
weight = {"link": "stage", "at": (0, L, 0), "force": (0, -1, 0)}
let_go = bare.buckling(**weight, freed=["d"]).positive
held = bare.buckling(**weight).positive
left = half.drive_stiffness()["d"] / bare.drive_stiffness()["d"]


def picture(path=None):
    """The guide under half its buckling load."""
    return half.plot(path)


print(f"buckles at {let_go:.2f} N with a free drive, at {held:.1f} N with the drive held")
print(f"under half of the first load the drive stiffness is {100 * left:.2f} % of that without load")

if __name__ == "__main__":
    picture("guide_buckling.png")
