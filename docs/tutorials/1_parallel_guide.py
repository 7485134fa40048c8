"""A parallel guide, from drawing to report

A stage of half a kilogram has to move by 5 mm to both sides on two leaf springs of spring steel. This
tutorial computes the drive force, the parasitic motion, the support stiffness over the stroke, the stress in the leaf
springs and the natural frequencies, and checks the accuracy of these numbers.
"""

# %%
# Drawing
# -------
#
# All numbers are in SI units; `ksd.units` has the factors. The yield stress does not change the solution; answers
# compare the stress with it. `ksd.ParallelGuide` consists of two parallel leaf springs. Interface A is their end at
# the ground, interface B their end at the stage.

import tempfile
from pathlib import Path

import numpy as np

import ksd
from ksd.units import GPa, MPa, mm

steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800, yield_stress=1300 * MPa, name="spring steel")
leaf_springs = ksd.ParallelGuide(steel, length=80 * mm, thickness=0.4 * mm, width=25 * mm, spacing=60 * mm)

# %%
# A mechanism consists of links, joints and drives. `at` is the position of interface A, `toward` the direction from A
# to B, `axis` the direction of the widths. A guide moves along the cross product `axis` x `toward`: here z x x = y.
# With `toward="y"` a positive stroke would be along -x. The stage has a mass of 0.5 kg; its centre of mass is 40 mm
# from the ground, at the middle of the leaf springs.

scene = ksd.Mechanism("guide")
stage = scene.link("stage", mass=0.5, inertia=(3e-4, 3e-4, 5e-4), at=(40 * mm, 0, 0))
guide = scene.join(scene.ground, stage, leaf_springs, at=(0, 0, 0), axis="z", toward="x", name="guide")
scene.actuate_joint(guide, name="push")
print(scene)

# %%
# `ksd.doctor` counts freedoms and constraints before anything is solved. A parallel guide has one redundant
# constraint, inside the joint: both leaf springs constrain the same rotation. Its effect is computed below.

print(ksd.doctor(scene))

# %%
# One position
# ------------
#
# Drive values are given by the name of the drive. Without `method` the cheapest method within `accuracy` is used; the
# default accuracy is one part in a thousand.

pose = ksd.solve(scene, push=5 * mm)
print(pose)

# %%
# Besides the force, the table shows the method, the estimated error, the effects that are not in the model and their
# size, the stress relative to the yield stress, and whether the state is stable and on the intended branch. If it is
# not, `ksd.solve` raises `ksd.TrustError`.

pose.plot(color="stress")

# %%
# The stage moves towards the ground during its stroke. Parasitic motion is the motion that no drive prescribes. Here
# it is close to the closed form 0.6 d^2/L, with stroke d and length L.

print(pose.parasitic(stage, at=(40 * mm, 0, 0)))
print(f"0.6 d^2/L = {0.6 * 5**2 / 80:.4f} mm")

# %%
# Support stiffness is the stiffness in the other directions. It is that of a point of the stage; we take the middle of
# the leaf springs, where the drive acts. (The docstring of a joint states the point on which its drive acts, here half
# a length from A.) The drive is held, so the table shows "held" for y. At another point the stiffness along y is
# finite, because the stage can rotate about the point that the drive holds.

print(pose.stiffness(stage, at=(40 * mm, 0, 0)))

# %%
# Natural frequencies with the drive released: the first mode is the intended motion, the second is the first parasitic
# mode.

print(pose.frequencies(freed=["push"]))

# %%
# Over the stroke
# ---------------
#
# The support stiffness of bent leaf springs is much lower than that of straight ones, so the values at rest are too
# optimistic. `ksd.sweep` evaluates all answers at every position and returns a table.

strokes = np.linspace(0, 8, 9) * mm
table = ksd.sweep(scene, push=strokes, progress=False)
print(table)

# %%
# "support y" has no value, because the drive holds that direction. The names of the columns contain the units. The
# plot has one panel for every question.

left = table["support_z_N_per_m"][5] / table["support_z_N_per_m"][0]
print(f"across the stage {100 * left:.0f} % of its stiffness is left at 5 mm")
table.plot("support_stiffness", "frequencies", "stress", "parasitic")

# %%
# A better guide
# --------------
#
# With a stiff middle part the leaf springs keep more of their support stiffness, at a somewhat higher force and stress.
# A function returns the mechanism for given parameters; a sweep takes values of these parameters as `designs`.


def stiffened(flexible):
    """The guide with leaf springs that bend over this share of their length at both ends."""
    joint = ksd.StiffenedGuide(
        steel,
        length=80 * mm,
        flexible=flexible,
        thickness=0.4 * mm,
        width=25 * mm,
        spacing=60 * mm,
    )
    variant = ksd.Mechanism("stiffened guide")
    table_top = variant.link("stage", mass=0.5, inertia=(3e-4, 3e-4, 5e-4), at=(40 * mm, 0, 0))
    placed = variant.join(variant.ground, table_top, joint, at=(0, 0, 0), axis="z", toward="x")
    variant.actuate_joint(placed, name="push")
    return variant


variants = ksd.sweep(stiffened, designs={"flexible": [0.2, 0.3, 0.4]}, push=strokes, progress=False)
for share in (0.2, 0.3, 0.4):
    row = variants.where(flexible=share, push_mm=5.0)
    print(
        f"flexible {share:.1f} L: {row['push_force_N'][0]:5.2f} N, {row['stress_MPa'][0]:4.0f} MPa, "
        f"{row['support_z_N_per_m'][0] / 1e3:6.0f} N/mm across, {row['first_parasitic_Hz'][0]:5.1f} Hz"
    )

# %%
# Checking the accuracy
# ---------------------
#
# Three checks before a drawing is released. First, `verify` integrates the exact rod equations along every leaf spring
# from the computed forces; the closure error at its end gives the error of forces and positions. Second, `with_error`
# computes any answer together with its error. Third, `left_out` estimates the effects that are not in the model.

print(pose.verify())
stiffness, error = pose.with_error(lambda p: p.stiffness(stage, at=(40 * mm, 0, 0)).support("z"))
print(f"across: {stiffness / 1e3:.2f} N/mm, error {abs(error) / 1e3:.1e} N/mm")
for effect, changes in pose.left_out.items():
    print(f"{effect:8}", ", ".join(f"{name} {100 * change:+.2g} %" for name, change in changes.items()))

# %%
# Plate stiffening makes leaf springs of this width stiffer than a beam. `with_="plate"` includes it.

with_plate = ksd.solve(scene, push=5 * mm, with_="plate")
print(f"{pose.forces['push']:.4f} N, with plate stiffening {with_plate.forces['push']:.4f} N")

# %%
# The redundant constraint causes internal stress if a leaf spring is clamped out of position, here by 10 um or 0.1 mrad.

print(pose.internal_stress())

# %%
# The report
# ----------
#
# Save the scene to a file and run `ksd report guide.toml` in a terminal: it writes one HTML page with pictures, tables
# over the stroke, convergence and errors. You can edit the file and read it again with `ksd.load_scene`.

folder = Path(tempfile.mkdtemp())
ksd.save_scene(scene, folder / "guide.toml", targets={"push": 5 * mm})
print((folder / "guide.toml").read_text())

# %%
# The next tutorial stacks two guides to an XY stage. The how-to page on loads shows load cases and gravity.
