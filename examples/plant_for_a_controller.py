"""How fast may a stage be controlled when the sensor is not where the force acts?

A carriage on an air bearing carries a stage on leaf springs; a linear motor pushes the carriage, an interferometer sees the
stage. The plant is a double integrator and a mode; the phase margin of a controller of one lead follows from its response.
"""

import numpy as np

import ksd
from ksd.units import GPa, mm

steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800, loss_factor=0.004)
leaf = ksd.rectangle(thickness=1 * mm, width=30 * mm)
scene = ksd.Mechanism("positioner", plane="xy")
carriage = scene.link("carriage", mass=3.0, inertia=(1e-2, 1e-2, 1e-2), at=(0, 0, 0))
stage = scene.link("stage", mass=1.0, inertia=(2e-3, 2e-3, 2e-3), at=(0, 45 * mm, 0))
scene.slider(carriage, along="x", at=(0, 0, 0), name="bearing")
for x in (-40 * mm, 40 * mm):
    scene.leaf(carriage, stage, start=(x, 0, 0), end=(x, 40 * mm, 0), section=leaf, material=steel)
scene.actuate(carriage, along="x", at=(0, 0, 0), name="motor")
scene.sensor(stage, along="x", at=(0, 45 * mm, 0), name="interferometer")
pose = ksd.solve(scene, motor=0.0)
plant = ksd.state_space(pose, modes=6, outputs=["motor", "interferometer"])

# a lead around the crossover: -1/(w^2 m) has no phase of its own
crossover, mass = 30.0, 4.0
f = np.geomspace(1, 1000, 20000)
s, w = 2j * np.pi * f, 2 * np.pi * crossover
lead = mass * w**2 / 3 * (1 + 3 * s / w) / (1 + s / (3 * w))
loop = lead * plant.response(f)[:, 1, 0]
last = np.flatnonzero((np.abs(loop[:-1]) >= 1) & (np.abs(loop[1:]) < 1))
margin = 180 + float(np.degrees(np.angle(loop))[last[0]])
mode = float(plant.frequency_Hz[1])


def picture(path=None):
    """Response of motor encoder and interferometer to the motor."""
    return pose.response(f[::20], inputs="motor", outputs=["motor", "interferometer"]).plot(path)


print(plant)
print(f"crossover at {f[last[0]]:.1f} Hz with a phase margin of {margin:.1f} degrees")
print(f"the mode at {mode:.1f} Hz reaches {np.abs(loop[f > 100]).max():.2f} of the loop gain 1")

if __name__ == "__main__":
    picture("plant_for_a_controller.png")
