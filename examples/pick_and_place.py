"""Which way to move a carriage by 50 mm in .1 s lets its payload swing least?

A payload of .2 kg hangs on two leaf springs from a carriage on a slide. The same stroke is made by a cycloid and by a
trapezoid of speed; what swings afterwards is compared with an integral of the acceleration of the carriage.
"""

import numpy as np

import ksd
from ksd.units import GPa, mm

stroke, duration = 50 * mm, 0.1
steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800)
leaf = ksd.rectangle(thickness=0.4 * mm, width=15 * mm)
scene = ksd.Mechanism("gantry", plane="xy")
carriage = scene.link("carriage", mass=1.0, at=(20 * mm, 0, 0))
payload = scene.link("payload", mass=0.2, inertia=(1e-5, 1e-5, 1e-5), at=(20 * mm, -50 * mm, 0))
scene.slider(carriage, along="x", at=(20 * mm, 0, 0))
for x in (0, 40 * mm):
    scene.leaf(carriage, payload, start=(x, 0, 0), end=(x, -50 * mm, 0), section=leaf, material=steel)
scene.actuate(carriage, along="x", at=(20 * mm, 0, 0), name="move")
scene.sensor(payload, along="x", at=(20 * mm, -50 * mm, 0), relative_to="carriage", name="swing")

ways = {
    "cycloid": ksd.Cycloid(stroke, duration=duration),
    "trapezoid": ksd.Trapezoid(stroke, duration=duration),
}
histories = {n: ksd.simulate(scene, 0.4, drives={"move": way}, accuracy=1e-4) for n, way in ways.items()}
frequency = float(ksd.solve(scene, move=0.0).frequencies(count=1).frequency_Hz[0])


def swing_after(history):
    """Amplitude [m] of the payload on the carriage once this stands still."""
    return float(np.abs(history.sensors["swing"][history.t > duration]).max())


cycloid, trapezoid = (swing_after(h) for h in histories.values())
force = float(np.abs(histories["trapezoid"].drives["move"].force).max())


def picture(path=None):
    """Stroke, force and swing of the trapezoid."""
    return histories["trapezoid"].plot("move", "swing", "move force", path=path)


print(histories["trapezoid"])
print(
    f"payload at {frequency:.3g} Hz swings by {cycloid / mm:.3g} mm after a cycloid, {trapezoid / mm:.3g} mm after a "
    "trapezoid"
)

if __name__ == "__main__":
    picture("pick_and_place.png")
