"""How should a fourbar of cross flexures bring a payload over by 200 mm in .25 s, and what does its drive have to give?

The shipped fourbar with links that have mass; a payload of .5 kg hangs on two leaf springs from its top link. A cycloid and
a trapezoid of speed are compared by the peak force of the drive and by what the payload swings after them, beside an
integral of the acceleration of the drive.
"""

import numpy as np

import ksd
from ksd.units import GPa, mm

stroke, duration = 200 * mm, 0.25
steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800)
scene, _, _ = ksd.load_scene("fourbar")
high = 370.71 * mm
scene.mass("top", mass=2.0, inertia=(0.02, 0.02, 0.02), at=(0, high, 0))
for side, x in (("left", -200 * mm), ("right", 200 * mm)):
    scene.mass(side, mass=0.5, inertia=(2e-3, 2e-3, 2e-3), at=(x, 0.5 * high, 0))
payload = scene.link("payload", mass=0.5, inertia=(2e-5, 2e-5, 2e-5), at=(0, high - 60 * mm, 0))
wrist = ksd.rectangle(thickness=0.8 * mm, width=30 * mm)
for x in (-20 * mm, 20 * mm):
    scene.leaf("top", payload, start=(x, high, 0), end=(x, high - 60 * mm, 0), section=wrist, material=steel)
scene.sensor(payload, along="x", at=(0, high - 60 * mm, 0), relative_to="top", name="swing")

ways = {
    "cycloid": ksd.Cycloid(stroke, duration=duration),
    "trapezoid": ksd.Trapezoid(stroke, duration=duration),
}
histories = {n: ksd.simulate(scene, 0.35, drives={"top": way}, accuracy=3e-4) for n, way in ways.items()}


def swing_after(history):
    """Amplitude [m] of the payload on the top link once this stands still."""
    swing = history.sensors["swing"][history.t > duration]
    return float(swing.max() - swing.min()) / 2


cycloid, trapezoid = (swing_after(h) for h in histories.values())
forces = [float(np.abs(h.drives["top"].force).max()) for h in histories.values()]


def picture(path=None):
    """Stroke, force and swing of the trapezoid."""
    return histories["trapezoid"].plot("top", "swing", "top force", path=path)


print(histories["trapezoid"])
for name, swing, force in zip(ways, (cycloid, trapezoid), forces, strict=True):
    print(
        f"{name}: the drive gives up to {force:.0f} N, the payload swings by {swing / mm:.3g} mm afterwards"
    )

if __name__ == "__main__":
    picture("fourbar_pick_and_place.png")
