"""How long until a stage stands still to 1 % after a step of its voice coil?

A stage of .5 kg on two leaf springs, pushed by .5 N from one moment to the next. A layer of damping tape on the leaf
springs is worth 5 % of critical damping. The numbers are compared with an oscillator of one mass.
"""

import numpy as np

import ksd
from ksd.units import GPa, mm, ms

loss = 0.1
steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800, loss_factor=loss)
leaf = ksd.rectangle(thickness=0.3 * mm, width=20 * mm)
scene = ksd.Mechanism("stage", plane="xy")
stage = scene.link("stage", mass=0.5, inertia=(1e-4, 1e-4, 1e-4), at=(25 * mm, 60 * mm, 0))
for x in (0, 50 * mm):
    scene.leaf("ground", stage, start=(x, 0, 0), end=(x, 60 * mm, 0), section=leaf, material=steel)
scene.load(stage, force=(0.5, 0, 0), at=(25 * mm, 60 * mm, 0), name="coil")
scene.sensor(stage, along="x", at=(25 * mm, 60 * mm, 0), name="place")

modes = ksd.solve(scene).frequencies(count=1)
frequency = float(modes.frequency_Hz[0])
end = ksd.solve(scene).displacement(stage)[0]
history = ksd.simulate(scene, until="3 s", loads={"coil": ksd.Step()}, damping_at=frequency)

off = history.sensors["place"] / end - 1.0
outside = np.flatnonzero(np.abs(off) > 0.01)[-1]
settled = float(
    np.interp(
        0.0, [abs(off[outside + 1]) - 0.01, abs(off[outside]) - 0.01], history.t[[outside + 1, outside]]
    )
)
overshoot = float(off.max())


def picture(path=None):
    """Place and energies over time."""
    return history.plot("place", "kinetic energy", "strain energy", "damped energy", path=path)


print(history)
print(f"{frequency:.3g} Hz; overshoot {100 * overshoot:.3g} %; within 1 % after {settled / ms:.0f} ms")

if __name__ == "__main__":
    picture("settling.png")
