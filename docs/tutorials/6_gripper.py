"""A gripper

A gripper of plastic, made in one piece: a parallelogram whose hinges are arcs of 270 degrees. It lives in a plane, so
it is drawn in one. What a designer asks: how far must the crank turn for an opening, how hard does it grip, what does
the plastic bear, and can the wanted jaw positions be held at all?
"""

# %%
# Drawing in a plane
# ------------------
#
# `plane="xy"` holds every link in it: nothing can leave the plane, and a drawing in the plane is enough. The same
# gripper is a scene file, `ksd/scenes/gripper.toml`.

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
# The tip of the jaw is a point of a link; `displacement` tells where it goes.

open_pose = ksd.solve(scene, crank=15 * deg)
print(f"moment {open_pose.forces['crank'] * 1e3:.2f} mNm")
print("the tip moves by", np.round(open_pose.displacement(jaw, tip) / mm, 3), "mm")
print(f"the jaw turns by {open_pose.rotation(jaw)[2] / deg:.3f} degrees: a parallelogram, nearly")
open_pose.plot(color="stress")

# %%
# Of a gripper with two jaws `scene.distance` names the opening, a column of sweeps: see the how-to page on planar
# linkages. Over the stroke: moment, stress, and how stiff the tip is.

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
# How far may it go? Stress against what the plastic bears:

share = np.array(table["stress_MPa"]) / 50
for angle, used in zip(table["crank_deg"], share, strict=True):
    print(f"{angle:+5.0f} degrees: {100 * used:3.0f} % of yield")

# %%
# Gripping
# --------
#
# A gripped part pushes back on the tip. Its force is a load; the moment of the crank grows by what that takes.

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
# The other way round
# -------------------
#
# Which moment holds the jaw where I want it? `ksd.required_loads` takes positions of links and tells the drive
# forces, and what they cannot balance. Links without a position find their own, without a force. First the pose
# found above: the moment must come back. Then the same pose, but with a jaw that does not turn: "unbalanced" are the
# forces and moments that no drive gives, so which actuator is missing.
#
# How hard two jaws grip a stiff object of a given size is a question of contact, which is answered by a drive: see
# :doc:`Contact </theory/contact>`.

poses = {name: open_pose.links[name] for name in ("crank", "jaw")}
needed = ksd.required_loads(scene, poses)
print(f"moment {needed.forces['crank'] * 1e3:.2f} mNm, balanced: {needed.balanced}")
poses["jaw"] = (open_pose.displacement(jaw), 0.0)
print(ksd.required_loads(scene, poses))

# %%
# How grippers are often analysed
# -------------------------------
#
# With the stiffness the hinges have at rest. `method="constant"` does that, and says by how much it is off.

constant = ksd.solve(scene, crank=15 * deg, method="constant", strict=False)
off = constant.forces["crank"] / open_pose.forces["crank"] - 1
print(f"constant stiffness: {100 * off:+.2f} % off in the moment, told {100 * constant.error.relative:.2f} %")

# %%
# Next: make the crank shorter or the arcs larger by a function of their sizes, as in the tutorial on
# optimisation; give the linkage pins and sliders, as in the how-to page on planar linkages.
