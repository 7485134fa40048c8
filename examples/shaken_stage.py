"""How far does a lens move, in nanometres, on a stage whose floor shakes?

A stage of 1.2 kg on two leaf springs, held by a voice coil that leaves it free along x, on a laboratory floor of vibration
class VC-C: 12.5 um/s rms in every third of an octave, which is a density of acceleration that grows with the frequency.
"""

import numpy as np

import ksd
from ksd.units import GPa, mm, nm

steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800, loss_factor=0.004)
leaf = ksd.rectangle(thickness=0.3 * mm, width=20 * mm)
scene = ksd.Mechanism("stage", plane="xy")
stage = scene.link("stage", mass=1.2, inertia=(2e-3, 2e-3, 2e-3), at=(25 * mm, 70 * mm, 0))
for x in (0, 50 * mm):
    scene.leaf("ground", stage, start=(x, 0, 0), end=(x, 60 * mm, 0), section=leaf, material=steel)
scene.actuate(stage, along="x", at=(25 * mm, 60 * mm, 0), name="coil")
scene.sensor(stage, along="x", at=(25 * mm, 90 * mm, 0), name="lens")
pose = ksd.solve(scene, coil=0.0)

# a third of an octave around f is .23 f wide
f = np.geomspace(1, 400, 20)
velocity = 12.5e-6**2 / (0.2316 * f)
floor = list(zip(f.tolist(), ((2 * np.pi * f) ** 2 * velocity).tolist(), strict=True))
shaken = pose.random_vibration({"base x": floor}, freed=["coil"])
rms = float(shaken.rms[0])
hit = pose.shock(ksd.HalfSine(amplitude=0.5, duration=11e-3), source="base x", freed=["coil"]).largest["lens"]


def picture(path=None):
    """Motion of the lens per motion of the floor."""
    return pose.transmissibility("x", freed=["coil"]).plot(path)


print(shaken)
print(f"the lens moves by {rms / nm:.0f} nm rms, and by {hit / nm:.0f} nm when the floor is hit")

if __name__ == "__main__":
    picture("shaken_stage.png")
