"""Does a controller at 2 kHz hold a stage where it should be, and how far does it overshoot?

The stage of `settling.py` without its damping; a controller reads its place every half millisecond and sets the force of the
coil, which is constant in between. The loop is closed step by step, and compared with the oscillator of one mass.
"""

import numpy as np

import ksd
from ksd.units import GPa, Hz, mm

mass, wanted, sampling = 0.5, 0.5 * mm, 0.5e-3
bandwidth, ratio = 20 * Hz, 0.5
steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800)
leaf = ksd.rectangle(thickness=0.3 * mm, width=20 * mm)
scene = ksd.Mechanism("stage", plane="xy")
stage = scene.link("stage", mass=mass, inertia=(1e-4, 1e-4, 1e-4), at=(25 * mm, 60 * mm, 0))
for x in (0, 50 * mm):
    scene.leaf("ground", stage, start=(x, 0, 0), end=(x, 60 * mm, 0), section=leaf, material=steel)
scene.load(stage, force=(1, 0, 0), at=(25 * mm, 60 * mm, 0), name="coil")
scene.sensor(stage, along="x", at=(25 * mm, 60 * mm, 0), name="place")

step = ksd.stepper(scene, loads={"coil": 0.0}, longest=sampling)
state, before = step.start, 0.0
stiffness, damping = mass * bandwidth**2, 2 * ratio * mass * bandwidth
t, place, force = [0.0], [0.0], [0.0]
for _ in range(800):
    read = state.sensors["place"]
    push = stiffness * (wanted - read) - damping * (read - before) / sampling
    before = read
    state = step(state, {"coil": push}, sampling)
    t.append(state.t)
    place.append(state.sensors["place"])
    force.append(push)

end = place[-1]
overshoot = max(place) / end - 1.0


def picture(path=None):
    """Place and force over time."""
    from matplotlib.figure import Figure

    figure = Figure(layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    above.plot(t, np.array(place) / mm, color="#1f2430")
    above.set_ylabel("place [mm]")
    below.plot(t, force, color="#1f2430")
    below.set(xlabel="time [s]", ylabel="force of the coil [N]")
    return figure if path is None else figure.savefig(path)


print(state)
print(f"{end / mm:.4f} mm of {wanted / mm:g} mm, overshoot {100 * overshoot:.3g} %")

if __name__ == "__main__":
    picture("controlled_guide.png")
