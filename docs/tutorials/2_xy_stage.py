"""An XY stage with its payload

Two parallel guides in series move a camera of 0.5 kg in x and y by 5 mm. This tutorial computes the coupling of the
two axes, the stiffness and frequencies of the table over its field, the effect of gravity, and a model for the controller.
"""

# %%
# Drawing
# -------
#
# The leaf springs of the lower guide are parallel to y, so the carriage moves along x. A second guide on the carriage
# lets the table move along y. Each link has a mass; without `inertia` it would be a point mass.

import numpy as np

import ksd
from ksd.units import GPa, MPa, mm

steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800, yield_stress=1300 * MPa)
guide = ksd.ParallelGuide(steel, length=60 * mm, thickness=0.3 * mm, width=25 * mm, spacing=50 * mm)
middle = np.array((0, 30, 0)) * mm

scene = ksd.Mechanism("XY stage")
carriage = scene.link("carriage", mass=0.3, inertia=(2e-4, 2e-4, 3e-4), at=middle)
table = scene.link("table", mass=0.5, inertia=(2e-4, 2e-4, 3e-4), at=middle)
scene.join(scene.ground, carriage, guide, at=(0, 0, 0), axis="z", toward="y", name="x guide")
scene.join(carriage, table, guide, at=(-30 * mm, 30 * mm, 0), axis="z", toward="x", name="y guide")
print(scene)

# %%
# Both motors are fixed to the ground and act on the table: the drives prescribe the displacement of one of its points.
# (For a motor on the carriage use `relative_to=carriage`.)

scene.actuate(table, along="x", at=middle, name="x")
scene.actuate(table, along="y", at=middle, name="y")
print(ksd.doctor(scene))

# %%
# One position, one prepared solver
# ---------------------------------
#
# All drives need a value. To solve many poses of the same scene, call `ksd.prepare` once and then the solver.

solver = ksd.prepare(scene)
rest, corner = solver(x=0.0, y=0.0), solver(x=5 * mm, y=5 * mm)
corner.plot()

# %%
# The drive stiffness is a matrix. Its off-diagonal terms couple the force of one motor to the displacement of the other.

print(corner.drive_stiffness())

# %%
# The drives prescribe the position of the point in x and y; the parasitic motion is the rest: motion along z and
# rotation of the table.

print(corner.parasitic(table, at=middle))

# %%
# Frequencies
# -----------
#
# With both drives released the first two modes are the intended motions. The first parasitic mode limits the bandwidth
# of the controller.

free = rest.frequencies(freed=["x", "y"])
print(free)
there = corner.frequencies(freed=["x", "y"])
print(there)

# %%
# In the corner of the field the first parasitic frequency is much lower, and the table rotates while it moves along z.
# `shape` contains the modes by link (in m and rad, scaled to unit modal mass); :func:`ksd.view.animate_mode` makes a GIF.

print(
    f"first parasitic mode {free.first_parasitic_Hz:.1f} Hz at rest, {there.first_parasitic_Hz:.1f} Hz in the corner"
)
for place, modes in {"at rest": free, "in the corner": there}.items():
    for name, motion in zip(modes.model.node_names, modes.shape[modes.first_parasitic], strict=True):
        print(
            f"{place:13} {name:8} moves {np.round(motion[:3], 2)}, turns {np.round(motion[3:], 1)} about x, y, z"
        )

# %%
# Over the whole field
# --------------------
#
# A sweep solves all combinations of the drive values. Its table has one row per position, and its columns are arrays.

steps = np.linspace(-5, 5, 5) * mm
field = ksd.sweep(
    scene,
    x=steps,
    y=steps,
    questions=("support_stiffness", "frequencies"),
    link=table,
    at=middle,
    progress=False,
)
first = np.array(field["first_parasitic_Hz"]).reshape(5, 5)
print("first parasitic mode [Hz], x down, y across")
print(np.round(first, 1))

# %%
# The cause is the torsional compliance of bent leaf springs. Leaf springs with a stiff middle part, or shorter strokes,
# reduce the effect. The first is another joint of the library.

stiffer = ksd.StiffenedGuide(
    steel, length=60 * mm, flexible=0.2, thickness=0.3 * mm, width=25 * mm, spacing=50 * mm
)


def stage_of(joint):
    """The same stage on other guides."""
    stage = ksd.Mechanism("XY stage")
    lower = stage.link("carriage", mass=0.3, inertia=(2e-4, 2e-4, 3e-4), at=middle)
    upper = stage.link("table", mass=0.5, inertia=(2e-4, 2e-4, 3e-4), at=middle)
    stage.join(stage.ground, lower, joint, at=(0, 0, 0), axis="z", toward="y", name="x guide")
    stage.join(lower, upper, joint, at=(-30 * mm, 30 * mm, 0), axis="z", toward="x", name="y guide")
    stage.actuate(upper, along="x", at=middle, name="x")
    stage.actuate(upper, along="y", at=middle, name="y")
    return stage


for name, joint in {"leaf springs": guide, "with a stiff middle": stiffer}.items():
    pose = ksd.solve(stage_of(joint), x=5 * mm, y=5 * mm)
    modes = pose.frequencies(freed=["x", "y"])
    print(
        f"{name:20} {modes.first_parasitic_Hz:6.1f} Hz, {pose.forces['x']:.1f} N, "
        f"{pose.stress().largest_Pa / MPa:.0f} MPa"
    )

# %%
# Under its own weight
# --------------------
#
# So far the masses affected only the frequencies. Now gravity acts along -z, with a payload 30 mm above the leaf springs.
# The undeformed configuration is that without weight, so the parasitic motion along z is the sag of the table: small
# in the middle of the field, ten times as much in the corner.

hanging = stage_of(guide)
hanging.mass("table", mass=0.2, inertia=(5e-5, 5e-5, 5e-5), at=middle + np.array((0, 0, 30)) * mm)
for weight in (None, (0, 0, -9.81)):
    hanging.gravity = weight
    for stroke in (0.0, 5 * mm):
        pose = ksd.solve(hanging, x=stroke, y=stroke)
        moved = pose.parasitic("table", at=middle).shift
        modes = pose.frequencies(freed=["x", "y"])
        print(
            f"gravity {weight}, {stroke / mm:.0f} mm: z {1e3 * moved[2] / mm:6.1f} um, "
            f"{pose.stress().largest_Pa / MPa:5.1f} MPa, first parasitic {modes.first_parasitic_Hz:.1f} Hz"
        )

# %%
# A model for the controller
# --------------------------
#
# The inputs are the motor forces, the outputs the displacements of the drives. The model has six modes with a damping
# ratio of one percent.

plant = ksd.state_space(corner, modes=6, damping=0.01)
response = plant.response([1.0, 10.0, 100.0])
print("x per newton of x at 1, 10, 100 Hz [mm/N]:", np.round(abs(response[:, 0, 0]) / mm, 4))

# %%
# `plant.to_mat("plant.mat")` writes the model for MATLAB. The tutorial on vibrations shows its use with `scipy.signal`.
