"""Which forces do three voice coils under a tip-tilt-piston mirror need?

A mirror on three folded leaf springs, moved by three drives along z at radius R. The fold lines constrain it in a plane at
the distance L/sqrt(2); it tilts about a point of that plane, so that its centre moves by tilt L/sqrt(2). The moment of the
drives must equal the tilt times the stiffness about y with free drives.
"""

import numpy as np

import ksd
from ksd.units import GPa, mm, mrad

L, t, w, R = 40 * mm, 0.2 * mm, 15 * mm, 60 * mm
tilt = 5 * mrad

steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800)
folded = ksd.FoldedLeaf(steel, length=L, thickness=t, width=w)

scene = ksd.Mechanism("tip-tilt-piston")
mirror = scene.link("mirror", mass=0.2, inertia=(9e-5, 9e-5, 18e-5), at=(0, 0, 0))
places = []
for k in range(3):
    out = np.array([np.cos(2 * np.pi * k / 3), np.sin(2 * np.pi * k / 3), 0])
    along = np.cross((0, 0, 1), out)
    # from ground outside of the mirror inwards, fold lines tangential
    start = (R + L * np.sqrt(2)) * out
    scene.constrain(scene.ground, mirror, folded, at=start, axis=along, toward=-out, name=f"leaf {k + 1}")
    places.append(R * out)
    scene.actuate(mirror, along="z", at=places[-1], name=f"coil {k + 1}")

solver = ksd.prepare(scene)
lifts = {f"coil {k + 1}": -tilt * float(place[0]) for k, place in enumerate(places)}
piston, tilted = solver(dict.fromkeys(lifts, 0.3 * mm)), solver(lifts)
force_piston = piston.forces["coil 1"]
force_tilt = tilted.forces["coil 1"]
reached = float(tilted.rotation(mirror)[1])
shift = float(np.linalg.norm(tilted.parasitic(mirror, at=(0, 0, 0)).shift))
rest = solver(dict.fromkeys(lifts, 0.0))
stiff = rest.stiffness(mirror, at=(0, 0, 0), freed=lifts)
moment = float(sum(-place[0] * force for place, force in zip(places, tilted.forces.values(), strict=True)))
moment_share, force_share = (
    moment / (stiff.support("ry") * tilt),
    3 * force_piston / (stiff.support("z") * 0.3 * mm),
)
lowest = float(rest.frequencies(freed=lifts, count=3).frequency_Hz[0])


def picture(path=None):
    """The tilted mirror from the side."""
    return tilted.plot(path, view=(-75, 20))


print(f"piston of 0.3 mm: {force_piston:.4f} N per coil; tilt of 5 mrad: {force_tilt:.4f} N from coil 1")
print(f"the mirror turns by {reached / mrad:.4f} mrad, its centre moves by {shift / mm * 1e3:.3f} um")
print(f"free coils: lowest frequency {lowest:.2f} Hz")

if __name__ == "__main__":
    picture("tip_tilt_piston.png")
