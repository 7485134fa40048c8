"""How does an arm of 90 leaf springs swing when it is let go, at a third of the price?

The spatial arm of three joints of the paper, with links of 500 g and 2 N across at its end. Its leaf springs have their mass
at their ends; the same motion with their own inertia tells what that changes.
"""

import ksd
from ksd.units import N, mm, ms

scene, _, _ = ksd.load_scene("arm")
for link, at in {"first": (75, 0, 0), "second": (240, 0, 140), "third": (420, 0, 140)}.items():
    scene.mass(link, mass=0.5, inertia=(1e-3,) * 3, at=[c * mm for c in at])
scene.load("third", force=(0, 2 * N, 2 * N), at=(510 * mm, 0, 50 * mm), name="push")
scene.sensor("third", along="z", at=(510 * mm, 0, 50 * mm), name="height")
words = {"until": 60 * ms, "dt": 1 * ms, "drives": dict.fromkeys("xyz"), "loads": {"push": ksd.Ramp(20 * ms)}}

arm = ksd.simulate(scene, mass_at_ends=True, **words)
whole = ksd.simulate(scene, **words)
tip, ratio = arm.sensors["height"][-1], float(arm.sensors["height"][-1] / whole.sensors["height"][-1])


def picture(path=None):
    """Height of the tip and kinetic energy over time."""
    return arm.plot("height", "kinetic energy", path=path)


print(arm)
print(f"the tip goes {tip / mm:.2f} mm up; mass at the ends changes that by {100 * (ratio - 1):.2g} %")

if __name__ == "__main__":
    picture("swinging_arm.png")
