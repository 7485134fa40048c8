"""How far does a guide drift when it warms, and when one leaf spring is warmer than the other?

Closed forms, a the coefficient of expansion: a guide that is warmer by T moves by a T L along its leaf springs. If only the
upper one of two leaf springs at a distance b is warmer, the stage tilts by a T L/b; bending of the leaf springs reduces this
by at most the share t^2/(3 b^2).
"""

import ksd
from ksd.units import GPa, mm, um, urad

L, t, w, b = 80 * mm, 0.4 * mm, 20 * mm, 60 * mm
warmer = 5.0  # K

steel = ksd.Material(E=200 * GPa, nu=0.3, expansion=12e-6)
joint = ksd.ParallelGuide(steel, length=L, thickness=t, width=w, spacing=b)


def drift(leaves):
    """The guide with these leaf springs warmer, all of them for None."""
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage")
    placed = scene.join(scene.ground, stage, joint, at=(0, 0, 0), axis="z", toward="x", name="guide")
    scene.actuate_joint(placed, name="d")
    scene.heat(warmer, leaves=leaves)
    return ksd.solve(scene, d=0.0)


both, upper = drift(None), drift(["guide/high"])
grows = float(both.displacement("stage", (L, 0, 0))[0])
tilts = abs(float(upper.rotation("stage")[2]))
sideways = abs(float(upper.displacement("stage", (L, 0, 0))[1]))


def picture(path=None):
    """The guide with a warm upper leaf spring."""
    return upper.plot(path)


print(f"all {warmer:g} K warmer: the stage moves by {grows / um:.4f} um")
print(
    f"upper leaf spring alone: it tilts by {tilts / urad:.4f} urad, its edge moves sideways by {sideways / um:.4f} um"
)

if __name__ == "__main__":
    picture("heat_drift.png")
