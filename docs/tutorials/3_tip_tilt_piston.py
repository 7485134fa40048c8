"""A tip-tilt-piston mirror

A mirror has to tip, tilt and move up and down, but not in its own plane: three freedoms and three constraints. A folded
leaf spring constrains one direction, that of its fold line. Three of them support the mirror, and three voice coils
move it.
"""

# %%
# Drawing
# -------
#
# `ksd.FoldedLeaf` has no intended motion; it only constrains. It is therefore added by `constrain` instead of `join`,
# and needs no record.

import numpy as np

import ksd
from ksd.units import GPa, MPa, mm, mrad

steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800, yield_stress=1300 * MPa)
length, radius = 40 * mm, 60 * mm
folded = ksd.FoldedLeaf(steel, length=length, thickness=0.2 * mm, width=15 * mm)

scene = ksd.Mechanism("tip-tilt-piston")
mirror = scene.link("mirror", mass=0.2, inertia=(9e-5, 9e-5, 18e-5), at=(0, 0, 0))
for k in range(3):
    angle = 2 * np.pi * k / 3
    out = np.array((np.cos(angle), np.sin(angle), 0))
    along = np.array((-np.sin(angle), np.cos(angle), 0))
    scene.constrain(
        scene.ground,
        mirror,
        folded,
        at=(radius + folded.length_AB) * out,
        axis=along,
        toward=-out,
        name=f"leaf {k + 1}",
    )
    scene.actuate(mirror, along="z", at=radius * out, name=f"coil {k + 1}")

# %%
# `axis` is the direction of the fold line and of the widths, `toward` the direction from the ground to the mirror.
# The doctor reports no redundant constraint. The freedoms that it lists at the folds are constrained only by the bending
# stiffness of their leaf springs.

print(ksd.doctor(scene))

# %%
# Tip, tilt and piston
# --------------------
#
# The drives prescribe the vertical displacement at each coil; a tilt is a combination of the three. Drive names that
# contain a space are given in a mapping.

solver = ksd.prepare(scene)
places = radius * np.array([(np.cos(2 * np.pi * k / 3), np.sin(2 * np.pi * k / 3)) for k in range(3)])


def pose_at(piston=0.0, tip=0.0, tilt=0.0):
    """The mirror lifted [m], turned about x (tip) and about y (tilt) [rad]."""
    lifts = piston + tip * places[:, 1] - tilt * places[:, 0]
    return solver({f"coil {k + 1}": float(lift) for k, lift in enumerate(lifts)})


tilted = pose_at(tilt=5 * mrad)
print(tilted.forces)
tilted.plot(view=(-75, 20))

# %%
# The centre of the mirror moves sideways when it tilts, because the mirror rotates about a point in the plane of the fold
# lines. The lever is the distance of the mirror from that plane.

print(tilted.parasitic(mirror, at=(0, 0, 0)))
print(f"tilt times the height of the folds {5 * mrad * length / np.sqrt(2) / mm:.4f} mm")

# %%
# If this matters, mount the mirror so that its optical face is at the height of the folds.

face = (0, 0, length / np.sqrt(2))
print(tilted.parasitic(mirror, at=face))

# %%
# Support stiffness
# -----------------
#
# At rest with the coils released, at the height of the folds, the directions hardly couple: each is either constrained
# or free. The ratio of the two stiffnesses should be large.

rest = pose_at()
coils = [f"coil {k + 1}" for k in range(3)]
stiffness = rest.stiffness(mirror, at=face, freed=coils)
print(stiffness)
print(rest.frequencies(freed=coils))

# %%
# Over the stroke the leaf springs bend and the support stiffness decreases. `together=True` changes all drive values at
# the same time, here from the bottom to the top.

lifts = np.linspace(-2, 2, 9) * mm
table = ksd.sweep(
    scene,
    dict.fromkeys(coils, lifts),
    together=True,
    questions=("force", "support_stiffness", "stress"),
    link=mirror,
    at=face,
    progress=False,
)
for lift, x, stress in zip(table["coil 1_mm"], table["support_x_N_per_m"], table["stress_MPa"], strict=True):
    print(f"at {lift:+4.1f} mm: {x / 1e3:6.0f} N/mm in the plane, {stress:4.0f} MPa")

# %%
# Gravity and heat
# ----------------
#
# The sag of the mirror without coil current is computed without drives, with gravity. A second scene computes the motion
# when the coils heat the folded leaf springs by 10 K.

sagging = ksd.Mechanism("sagging mirror")
hung = sagging.link("mirror", mass=0.2, inertia=(9e-5, 9e-5, 18e-5), at=(0, 0, 0))
warm_steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800, expansion=12e-6)
warm_leaf = ksd.FoldedLeaf(warm_steel, length=length, thickness=0.2 * mm, width=15 * mm)
for k in range(3):
    angle = 2 * np.pi * k / 3
    out = np.array((np.cos(angle), np.sin(angle), 0))
    along = np.array((-np.sin(angle), np.cos(angle), 0))
    start = (radius + folded.length_AB) * out
    sagging.constrain(
        sagging.ground, hung, warm_leaf, at=start, axis=along, toward=-out, name=f"leaf {k + 1}"
    )
sagging.gravity = (0, 0, -9.81)
sagged = ksd.solve(sagging)
sagging.gravity = None
sagging.heat(10)
warm = ksd.solve(sagging)
expected = -0.2 * 9.81 / stiffness.support("z")
print(f"sag {sagged.displacement(hung)[2] / mm:.3f} mm, weight over stiffness {expected / mm:.3f} mm")
print(f"10 K warmer: moves by {abs(warm.displacement(hung)).max() / mm * 1e6:.3f} nm")

# %%
# Because the three leaf springs expand equally, the centre of the mirror does not move: it is the thermal
# centre. `print(pose.model)` lists the effects that the model contains and those it does not.
