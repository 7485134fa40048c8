"""A tip-tilt-piston mirror

A mirror has to tip, tilt and move up and down, and must not move in its own plane. That is three freedoms and three
constraints. A folded leaf spring holds one direction, that of its fold line: three of them around the mirror do it,
and three voice coils move it.
"""

# %%
# Drawing
# -------
#
# `ksd.FoldedLeaf` has no intended motion: it only holds. So it is not joined but put in by `constrain`, and
# computed in full, without a record.

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
# `axis` is the fold line and the direction of the widths, `toward` goes from the ground to the mirror. The doctor
# finds nothing held twice; what it calls free are the folds, which only the bending of their own leaf springs
# holds.

print(ksd.doctor(scene))

# %%
# Tip, tilt and piston
# --------------------
#
# The drives are the lifts at the coils; a tilt is a pattern of them. Names with a space are given in a mapping.

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
# The centre of the mirror moves sideways when it tilts. Why? Fold lines lie beside the mirror, not in it, and the
# mirror turns about a point in their plane. The lever is the height of the folds.

print(tilted.parasitic(mirror, at=(0, 0, 0)))
print(f"tilt times the height of the folds {5 * mrad * length / np.sqrt(2) / mm:.4f} mm")

# %%
# If that matters, mount the mirror at the height of the folds: its optical face, not its leaf springs, is what
# must stand still.

face = (0, 0, length / np.sqrt(2))
print(tilted.parasitic(mirror, at=face))

# %%
# Is it stiff enough where it should hold?
# ----------------------------------------
#
# At rest with the coils let go, at the height of the folds, every direction is either held or free, and nothing
# couples. The difference should be large.

rest = pose_at()
coils = [f"coil {k + 1}" for k in range(3)]
stiffness = rest.stiffness(mirror, at=face, freed=coils)
print(stiffness)
print(rest.frequencies(freed=coils))

# %%
# Over the stroke the leaf springs bend and hold less. `together=True` moves all coils at the same time, here from
# the bottom to the top.

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
# Two more questions. How far does the mirror sag with the coils without current? For that the drives are left out,
# and gravity is given. And how far does it move when the coils warm the folded leaf springs by ten kelvin?

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
# Three leaf springs that grow alike push nothing anywhere: the middle is the thermal centre. `print(pose.model)` lists
# what is in the model and what is not.
