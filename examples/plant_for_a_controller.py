"""How fast may a stage be controlled when the sensor is not where the force acts?

A carriage on an air bearing carries a stage on leaf springs; a linear motor pushes the carriage, an interferometer sees the
stage. The plant is a double integrator and a mode without which the loop would be stable: the controller has a notch there.
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

# a lead around the crossover, as -1/(w^2 m) has no phase of its own, and a notch at the mode
crossover, mass, mode = 15.0, 4.0, float(plant.frequency_Hz[1])
w, wn = 2 * np.pi * crossover, 2 * np.pi * mode
zeta = float(pose.frequencies(freed=["motor"]).damping[1])
numerator = np.polymul(mass * w**2 / 3 * np.array([3 / w, 1]), [1 / wn**2, 2 * zeta / wn, 1])
denominator = np.polymul([1 / (3 * w), 1], [1 / wn**2, 0.6 / wn, 1])
f = np.geomspace(1, 1000, 20000)
s = 2j * np.pi * f
loop = np.polyval(numerator, s) / np.polyval(denominator, s) * plant.response(f)[:, 1, 0]
crossed = np.flatnonzero((np.abs(loop[:-1]) >= 1) != (np.abs(loop[1:]) >= 1))
margin = float((180 + np.degrees(np.angle(loop[crossed]))).min())
turned = np.flatnonzero((np.diff(np.sign(loop.imag)) != 0) & (loop.real[1:] < 0))
gain_margin = float(1 / np.abs(loop[turned]).max())


def picture(path=None):
    """Response of motor encoder and interferometer to the motor."""
    return pose.response(f[::20], inputs="motor", outputs=["motor", "interferometer"]).plot(path)


print(plant)
print(
    f"crossover at {f[crossed[0]]:.1f} Hz, phase margin {margin:.1f} degrees, gain margin {gain_margin:.2f}"
)
try:
    import control

    system = control.ss(plant.A, plant.B, plant.C[1:], plant.D[1:]) * control.tf(numerator, denominator)
    print(
        "python-control: gain margin {:.2f}, phase margin {:.1f}".format(*control.stability_margins(system))
    )
except ImportError:
    print("python-control is not installed (pip install 'ksd[control]'): its margins are left out")

if __name__ == "__main__":
    picture("plant_for_a_controller.png")
