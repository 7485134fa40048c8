"""What stress does a parallel guide get when one leaf spring is clamped 10 um out of place?

A guide of two leaf springs has one redundant constraint. `internal_stress` computes the stress of misplacing one leaf spring
in one direction, for all of them; `fit` adds such a misplacement to the scene, and the stress must be the same.
"""

import ksd
from ksd.units import GPa, MPa, mm, um

L, t, w, spacing, off = 60 * mm, 0.4 * mm, 20 * mm, 50 * mm, 10 * um

steel = ksd.Material(E=200 * GPa, nu=0.3)
joint = ksd.ParallelGuide(steel, length=L, thickness=t, width=w, spacing=spacing)


def guide(shift=None):
    """The guide, its low leaf spring clamped out of place by `shift` in leaf axes."""
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage")
    placed = scene.join(scene.ground, stage, joint, at=(0, 0, 0), axis="z", toward="x", name="guide")
    scene.actuate_joint(placed, name="d")
    if shift is not None:
        scene.fit("guide/low", shift=shift)
    return scene


found = ksd.doctor(guide())
redundant = len(found.redundant)
estimated = ksd.solve(guide(), d=0.0).internal_stress(offset=off)
across = estimated.stress_Pa["guide/low", "sideways"]
misplaced = ksd.solve(guide((0, 0, off)), d=0.0)
solved = misplaced.stress().largest_Pa


def picture(path=None):
    """The guide with a misplaced leaf spring, coloured by stress."""
    return misplaced.plot(path, color="stress")


print(f"{redundant} redundant constraint: {found.redundant[0].what}")
print(f"10 um along the width: {across / MPa:.3f} MPa estimated, {solved / MPa:.3f} MPa solved")
print(f"worst, of 10 um and 0.1 mrad: {' '.join(estimated.worst)}, {estimated.largest_Pa / MPa:.3f} MPa")

if __name__ == "__main__":
    picture("overconstrained_guide.png")
