"""How stiff is a folded planar spring when it is pulled, and when it is pressed?

Lan (2005), chapter 2, example 4: a spring with the slope 1.6 cos(5 pi s/L) at rest, 50 um long, EI 1.04e-11 Nm^2, its end
held in height and angle, without stretch and shear (1e9 EI/L^2). The thesis prints 32667 N/m, the mean of a pull and a push.
"""

import numpy as np

import ksd
from ksd.units import um

EI, length, swing, stroke = 1.04e-11, 50 * um, 1.6, 2 * um

stuff = ksd.Material(E=1e9, nu=0.3)
area, inertia = 1e9 * EI / length**2 / stuff.E, EI / stuff.E
across = float(np.sqrt(12 * inertia / area))
section = ksd.numbers(A=area, J=inertia, Iy=inertia, Iz=inertia, width=across, thickness=across)

# where the curve ends: the mean of cos(angle) over its length
u = (np.arange(2000) + 0.5) / 2000
end = (length * float(np.cos(swing * np.cos(5 * np.pi * u)).mean()), 0, 0)
curve = ksd.FreeCurve(length, lambda s: (0, 0, -5 * np.pi * swing / length * np.sin(5 * np.pi * s)))

scene = ksd.Mechanism("planar spring", plane="xy")
tip = scene.link("tip")
scene.leaf(
    scene.ground, tip, start=(0, 0, 0), end=end, curve=curve, section=section, material=stuff, name="spring"
)
for k in range(1, 5):
    # its slope varies by 16 rad in total: five pieces, each with modes of its own
    scene.point("spring", 0.2 * k * length)
scene.slider(tip, along="x", at=end)
scene.actuate(tip, along="x", at=end, name="d")

solver = ksd.prepare(scene, mesh=ksd.Mesh(orders=(3, 2, 12), points=16))
pulled, pressed = solver(d=stroke), solver(d=-stroke)
pull, press = pulled.forces["d"] / stroke, -pressed.forces["d"] / stroke
at_rest = solver(d=0.0).drive_stiffness()["d"]


def picture(path=None):
    """The spring pulled by 2 um."""
    return pulled.plot(path)


print(f"secant stiffness pulled by 2 um {pull:.2f} N/m, pressed {press:.2f} N/m")
print(f"at rest {at_rest:.2f} N/m")

if __name__ == "__main__":
    picture("planar_spring.png")
