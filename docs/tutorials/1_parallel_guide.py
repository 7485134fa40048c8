"""A parallel guide, from drawing to report

A stage of half a kilogram has to move by 5 mm to both sides on two leaf springs of spring steel. What a designer
wants to know: which force moves it, how straight it runs, how stiff it stays in the directions it should hold, what
stress the leaf springs see, which frequencies there are, and whether the numbers can be believed.
"""

# %%
# Drawing
# -------
#
# All numbers are SI; `ksd.units` has the factors. The yield stress changes no answer: it lets answers say the
# share of it in use. `ksd.ParallelGuide` is two leaf springs side by side; interface A is where they leave the
# ground, interface B is on the stage.

import tempfile
from pathlib import Path

import numpy as np

import ksd
from ksd.units import GPa, MPa, mm

steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800, yield_stress=1300 * MPa, name="spring steel")
leaf_springs = ksd.ParallelGuide(steel, length=80 * mm, thickness=0.4 * mm, width=25 * mm, spacing=60 * mm)

# %%
# A mechanism is links, what joins them, and what moves them. `at` is interface A, `toward` the direction from A
# to B, `axis` the direction of the widths. A guide moves along `axis` x `toward`: here z x x, which is y; with
# `toward="y"` a positive stroke would go along -x. The stage weighs 0.5 kg, its centre of mass lies 40 mm along the
# leaf springs.

scene = ksd.Mechanism("guide")
stage = scene.link("stage", mass=0.5, inertia=(3e-4, 3e-4, 5e-4), at=(40 * mm, 0, 0))
guide = scene.join(scene.ground, stage, leaf_springs, at=(0, 0, 0), axis="z", toward="x", name="guide")
scene.actuate_joint(guide, name="push")
print(scene)

# %%
# Is it constrained as meant? The doctor counts freedoms and constraints before anything is solved. A parallel
# guide is overconstrained by one, inside the joint: both leaf springs hold the same turn. We come back to what
# that costs.

print(ksd.doctor(scene))

# %%
# One position
# ------------
#
# Drives are given by name. Without a `method` the cheapest one is taken that is within `accuracy`, one part in a
# thousand.

pose = ksd.solve(scene, push=5 * mm)
print(pose)

# %%
# The table tells more than the force. It says how the answer was found, by how much it may be off, what is not in
# the model and what that is worth here, how much of the yield stress is in use, and whether the state is stable
# and the one that was meant. Where it were not, `ksd.solve` would raise `ksd.TrustError`.

pose.plot(color="stress")

# %%
# The stage sinks towards the ground while it moves: its parasitic motion is what no drive prescribes. It follows
# 0.6 d^2/L.

print(pose.parasitic(stage, at=(40 * mm, 0, 0)))
print(f"0.6 d^2/L = {0.6 * 5**2 / 80:.4f} mm")

# %%
# How stiff is it in the directions it should hold? Stiffness is asked of a point; we take the middle of the leaf
# springs, where the stage is pushed: the drive of a joint acts on the point that the joint's docstring names, here
# half a length from A. The motion of the drive is held, so y is "held"; asked of another point, y has the stiffness
# that is left when the stage turns about the first.

print(pose.stiffness(stage, at=(40 * mm, 0, 0)))

# %%
# Frequencies with the drive let go: the first is the motion meant, the second the first that was not.

print(pose.frequencies(freed=["push"]))

# %%
# Over the stroke
# ---------------
#
# Leaf springs that are bent are soft lengthwise: the numbers at rest promise too much. `ksd.sweep` asks all
# questions at every position and returns a table.

strokes = np.linspace(0, 8, 9) * mm
table = ksd.sweep(scene, push=strokes, progress=False)
print(table)

# %%
# "support y" has no value, since the drive holds that direction. The numbers are columns with their unit in the
# name; the plot draws one panel for every question.

left = table["support_z_N_per_m"][5] / table["support_z_N_per_m"][0]
print(f"across the stage {100 * left:.0f} % of its stiffness is left at 5 mm")
table.plot("support_stiffness", "frequencies", "stress", "parasitic")

# %%
# A better guide
# --------------
#
# A stiff middle in the leaf springs keeps more of it, for a little more force and stress. Drawing a variant is
# one function; a sweep takes its parameters as `designs`.


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
# What the numbers stand on
# -------------------------
#
# Three checks before a drawing is released. First, integrate the exact rod equations along every leaf spring,
# from the forces found; by how far the ends miss is the error of forces and positions. Second, any answer with
# its own error. Third, what was left out.

print(pose.verify())
stiffness, error = pose.with_error(lambda p: p.stiffness(stage, at=(40 * mm, 0, 0)).support("z"))
print(f"across: {stiffness / 1e3:.2f} N/mm, error {abs(error) / 1e3:.1e} N/mm")
for effect, changes in pose.left_out.items():
    print(f"{effect:8}", ", ".join(f"{name} {100 * change:+.2g} %" for name, change in changes.items()))

# %%
# Leaf springs this wide are stiffer by plate stiffening than the model has it. It is put in by a word.

with_plate = ksd.solve(scene, push=5 * mm, with_="plate")
print(f"{pose.forces['push']:.4f} N, with plate stiffening {with_plate.forces['push']:.4f} N")

# %%
# And the constraint too many: what does a leaf spring cost that is clamped 10 um, or 0.1 mrad, beside its place?

print(pose.internal_stress())

# %%
# The report
# ----------
#
# The same scene as a file makes one HTML page with pictures, tables over the stroke, convergence and errors: `ksd
# report guide.toml` in a terminal. The file can be edited, and drawn again by `ksd.load_scene`.

folder = Path(tempfile.mkdtemp())
ksd.save_scene(scene, folder / "guide.toml", targets={"push": 5 * mm})
print((folder / "guide.toml").read_text())

# %%
# Next: two guides on each other make an XY stage, in the next tutorial; load cases and gravity are in the how-to page
# on loads.
