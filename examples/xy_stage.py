"""Which frequencies does an XY stage have with its payload, and how do they change over the stroke?

Two parallel guides in series carry 0.5 kg. Closed form for the two drive modes with leaf springs without mass:
2 pi f = sqrt(24 EI/L^3/m), m the payload, and for x also the mass of the middle stage.
"""

import ksd
from ksd.units import GPa, g, mm

L, t, w, spacing = 60 * mm, 0.3 * mm, 25 * mm, 50 * mm
middle_mass, payload = 300 * g, 500 * g

steel = ksd.Material(E=200 * GPa, nu=0.3)
guide = ksd.ParallelGuide(steel, length=L, thickness=t, width=w, spacing=spacing)

scene = ksd.Mechanism("xy stage")
middle = scene.link("middle", mass=middle_mass, inertia=(2e-4, 2e-4, 3e-4), at=(-40 * mm, 40 * mm, 0))
table = scene.link("table", mass=payload, inertia=(2e-4, 2e-4, 3e-4), at=(20 * mm, 30 * mm, 0))
# the guide with leaf springs along y lets the middle stage move along x, the other one the table along y
lower = scene.join(scene.ground, middle, guide, at=(-40 * mm, 0, 0), axis="z", toward="y", name="x guide")
upper = scene.join(middle, table, guide, at=(-30 * mm, 30 * mm, 0), axis="z", toward="x", name="y guide")
scene.actuate(table, along="x", at=(30 * mm, 30 * mm, 0), name="x")
scene.actuate(table, along="y", at=(30 * mm, 30 * mm, 0), name="y")

rest = ksd.solve(scene, x=0.0, y=0.0)
modes = rest.frequencies(freed=["x", "y"])
moved = ksd.solve(scene, x=5 * mm, y=5 * mm)
modes_moved = moved.frequencies(freed=["x", "y"])
x_mode, y_mode, third = modes.frequency_Hz[:3]
third_moved = modes_moved.frequency_Hz[2]


def picture(path=None):
    """The stage at 5 mm in both directions."""
    return moved.plot(path)


print(f"drive modes {x_mode:.3f} and {y_mode:.3f} Hz")
print(f"first parasitic mode {third:.2f} Hz at rest, {third_moved:.2f} Hz at 5 mm in x and y")

if __name__ == "__main__":
    picture("xy_stage.png")
