"""Does an end stop keep a guide from yielding when it is knocked, and what does it bear?

A parallel guide of steel 80 mm long, .4 x 25 mm leaf springs, has stops at +-3 mm and is pushed by 5, 12 and 40 N. A stop
carries what is left of the push after 24 EI/L^3 times its distance, for small deflections (Howell 2001).
"""

import ksd
from ksd.units import GPa, mm

steel = ksd.Material(E=200 * GPa, nu=0.3, yield_stress=1.2 * GPa)
joint = ksd.ParallelGuide(steel, length=80 * mm, thickness=0.4 * mm, width=25 * mm, spacing=60 * mm)
limit, at = 3 * mm, (80 * mm, 0, 0)


def guide(push, *, stops=True):
    """The guide under a push [N] across, with or without stops."""
    scene = ksd.Mechanism("guide with stops")
    stage = scene.link("stage")
    scene.join(scene.ground, stage, joint, at=(0, 0, 0), axis="z", toward="x")
    scene.load(stage, force=(0, push, 0), at=at)
    if stops:
        scene.stop(stage, along="y", at=at, low=-limit, high=limit, name="end")
    return scene


poses = {push: ksd.solve(guide(push)) for push in (5, 12, 40)}
stiffness = joint.stiffness_at_rest()
share = poses[12].stops["end.high"].force / (12 - stiffness * limit)
bears = poses[40].stops["end.high"].force

without = ksd.solve(guide(40, stops=False), strict=False).stress().largest_Pa / steel.yield_stress
within = poses[40].stress().largest_Pa / steel.yield_stress


def picture(path=None):
    """The guide at its stop."""
    return poses[40].plot(path)


for push, pose in poses.items():
    stop = pose.stops["end.high"]
    print(f"{push:3} N: {stop.force:8.4f} N on the stop, {stop.gap / mm:.4f} mm to it")
print(f"{share:.6f} of beam theory; stress {within:.3f} of yield with stops, {without:.3f} without")

if __name__ == "__main__":
    picture("guide_with_stops.png")
