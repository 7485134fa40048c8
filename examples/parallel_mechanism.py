"""How straight does a parallel mechanism move, and how does its stiffness grow?

Lan (2005), chapter 2, example 2: a bar of 25.4 mm on two leaf springs of the same length and EI 0.3 Nm^2, moved
transversely at its lower end A. Moved by half their length, leaf springs stretch as much as they bend: the answer depends
on their section.
"""

import ksd
from ksd.units import GPa, mm, mrad

EI, size, width = 0.3, 25.4 * mm, 12.7 * mm
steel = ksd.Material(E=200 * GPa, nu=0.3)
section = ksd.rectangle((12 * EI / (steel.E * width)) ** (1 / 3), width)
A, B = (size, 0, 0), (size, size, 0)

scene = ksd.Mechanism("parallel mechanism", plane="xy")
bar = scene.link("bar")
scene.leaf(scene.ground, bar, start=(0, 0, 0), end=A, section=section, material=steel)
scene.leaf(scene.ground, bar, start=(0, size, 0), end=B, section=section, material=steel)
scene.actuate(bar, along="y", at=A, name="d")

# leaf springs a tenth as thick as long, moved by half their length: no steel bears the strain, and a warning says so
solver = ksd.prepare(scene, mesh=ksd.Mesh(orders=(3, 2, 12), points=16))
quarter, half = (solver(d=d, strict=False) for d in (size / 4, size / 2))
force_quarter, force_half = quarter.forces["d"], half.forces["d"]
drop_A, drop_B = (float(quarter.displacement(bar, at)[0]) for at in (A, B))
tilt = abs(float(half.rotation(bar)[2]))


def picture(path=None):
    """The bar pushed by half of its length."""
    return half.plot(path)


print(
    f"pushed by {size / 4 / mm:g} mm: {force_quarter:.3f} N; the ends come down by {drop_A / mm:.5f}, {drop_B / mm:.5f} mm"
)
print(f"pushed by {size / 2 / mm:g} mm: {force_half:.3f} N, and the bar tilts by {tilt / mrad:.4f} mrad")

if __name__ == "__main__":
    picture("parallel_mechanism.png")
