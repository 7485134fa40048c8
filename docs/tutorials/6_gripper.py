"""A gripper

A monolithic plastic gripper: a parallelogram whose hinges are arcs of 270 degrees, drawn in a plane. This tutorial
computes the opening over the crank angle, moment and stress, the effect of a gripping force, and the moments that hold
the jaw in a given position.
"""

# %%
# Drawing in a plane
# ------------------
#
# `plane="xy"` constrains every link to the plane. The same gripper is also a scene file, `ksd/scenes/gripper.toml`.

import numpy as np

import ksd
from ksd.units import GPa, MPa, deg, mm

plastic = ksd.Material(E=2.5 * GPa, nu=0.3, yield_stress=50 * MPa, name="plastic")
hinge = ksd.ArcHinge(plastic, radius=4 * mm, angle=270 * deg, thickness=0.4 * mm, width=6 * mm)

scene = ksd.Mechanism("gripper", plane="xy")
crank, jaw, rocker = scene.links("crank", "jaw", "rocker")
scene.join(scene.ground, crank, hinge, at=(-4 * mm, 0, 0), axis="z", toward=(1, 1, 0), name="A")
scene.join(crank, jaw, hinge, at=(0, 34 * mm, 0), axis="z", toward=(1, -1, 0), name="B")
scene.join(jaw, rocker, hinge, at=(44 * mm, 30 * mm, 0), axis="z", toward=(-1, -1, 0), name="C")
scene.join(scene.ground, rocker, hinge, at=(36 * mm, 0, 0), axis="z", toward=(1, 1, 0), name="D")
scene.actuate(crank, about="z", name="crank")
tip = (70 * mm, 45 * mm, 0)

# %%
# Opening
# -------
#
# The tip of the jaw is a point of a link; `displacement` returns its motion.

open_pose = ksd.solve(scene, crank=15 * deg)
print(f"moment {open_pose.forces['crank'] * 1e3:.2f} mNm")
print("the tip moves by", np.round(open_pose.displacement(jaw, tip) / mm, 3), "mm")
print(f"the jaw turns by {open_pose.rotation(jaw)[2] / deg:.3f} degrees: a parallelogram, nearly")
open_pose.plot(color="stress")

# %%
# For a gripper with two jaws, `scene.distance` defines the opening as a column of sweeps; see the how-to page on planar
# linkages. A sweep over the stroke gives the moment, the stress and the stiffness of the tip.

table = ksd.sweep(
    scene,
    crank=np.linspace(-20, 20, 9) * deg,
    questions=("force", "stress", "support_stiffness", "parasitic"),
    link=jaw,
    at=tip,
    progress=False,
)
table.plot("force", "stress", "support_stiffness", "parasitic")

# %%
# The allowable stress of the plastic limits the stroke:

share = np.array(table["stress_MPa"]) / 50
for angle, used in zip(table["crank_deg"], share, strict=True):
    print(f"{angle:+5.0f} degrees: {100 * used:3.0f} % of yield")

# %%
# Gripping
# --------
#
# A gripped part exerts a force on the tip, which is modelled as a load. The moment of the crank increases accordingly.

part = ksd.sweep(
    scene,
    loads={
        "open": [],
        "gripping": [{"link": "jaw", "force": (-0.1, 0, 0), "at": tip}],
    },
    crank=[-15 * deg],
    questions=("force", "stress"),
    progress=False,
)
for row in part.rows():
    print(
        f"{row['load_case']:9} moment {1e3 * row['crank_moment_Nm']:7.2f} mNm, stress {row['stress_MPa']:.1f} MPa"
    )

# %%
# The inverse problem
# -------------------
#
# `ksd.required_loads` takes poses of links and returns the drive forces that hold them there, and the forces that the
# drives cannot balance. Links without a given pose are in equilibrium without external force. The first example uses
# the pose computed above, so the result must be the moment computed above. The second prescribes the same pose without
# rotation of the jaw: "unbalanced" lists the forces and moments that no drive exerts, which shows where an actuator is
# missing.
#
# The page :doc:`Contact </theory/contact>` shows how to compute the force of two jaws on a stiff object of given size.

poses = {name: open_pose.links[name] for name in ("crank", "jaw")}
needed = ksd.required_loads(scene, poses)
print(f"moment {needed.forces['crank'] * 1e3:.2f} mNm, balanced: {needed.balanced}")
poses["jaw"] = (open_pose.displacement(jaw), 0.0)
print(ksd.required_loads(scene, poses))

# %%
# Constant hinge stiffness
# ------------------------
#
# Grippers are often analysed with the stiffness of the hinges at rest. `method="constant"` does this and estimates the
# error.

constant = ksd.solve(scene, crank=15 * deg, method="constant", strict=False)
off = constant.forces["crank"] / open_pose.forces["crank"] - 1
print(
    f"constant stiffness: {100 * off:+.2f} % error of the moment, estimated {100 * constant.error.relative:.2f} %"
)

# %%
# To vary the length of the crank or the size of the arcs, write a function as in the tutorial on optimisation. The how-to
# page on planar linkages adds pins and sliders.
