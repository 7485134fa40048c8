"""How much support stiffness does a parallel guide lose over its stroke?

Two leaf springs, 100 mm long. Closed forms at the stroke d (Awtar, Slocum and Sevincer, J. Mech. Design 129, 2007): drive
stiffness 24 EI/L^3, lowering of the stage 0.6 d^2/L, stiffness along the leaf springs 1/K = L/EI (t^2/24 + d^2/1400).
"""

import numpy as np

import ksd
from ksd.units import GPa, mm

L, t, w, spacing = 100 * mm, 0.5 * mm, 20 * mm, 80 * mm

steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800)
guide = ksd.ParallelGuide(steel, length=L, thickness=t, width=w, spacing=spacing)

scene = ksd.Mechanism("guide")
stage = scene.link("stage")
placed = scene.join(scene.ground, stage, guide, at=(0, 0, 0), axis="z", toward="x")
scene.actuate_joint(placed, name="d")

strokes = np.array([0.0, 2.5, 5.0, 7.5, 10.0]) * mm
poses = [ksd.solve(scene, d=d) for d in strokes]
along = [pose.stiffness(stage, at=(L / 2, 0, 0)).support("x") for pose in poses]
at_rest, halfway, at_end = along[0], along[2], along[-1]
drive = poses[0].drive_stiffness()["d"]
sink = float(-poses[-1].displacement(stage, (L, 0, 0))[0])


def picture(path=None):
    """The guide at the end of its stroke."""
    return poses[-1].plot(path)


print(f"drive stiffness {drive:.2f} N/m; at {strokes[-1] / mm:g} mm the stage sinks by {sink / mm:.4f} mm")
for d, stiffness in zip(strokes, along, strict=True):
    print(f"at {d / mm:4.1f} mm: {stiffness / 1e6:.4f} N/um along the leaf springs")

if __name__ == "__main__":
    picture("guide_stiffness.png")
