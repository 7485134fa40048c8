"""Dynamics: the vibrations of a guide

The parallel guide of the first tutorial carries a camera, and a controller is to hold it still. Which frequencies does it
have, which of them is the motion meant and which is not, where do they go over the stroke and with the payload, and what
does the controller see? All of it is linear: small vibrations about one pose, which is what the package has of dynamics.
"""

# %%
# What has mass
# -------------
#
# Leaf springs have the mass of their material's density. A link has the mass that is said, with its inertia about its
# centre of mass `at`; `scene.mass` puts more on it, here a camera. A mass without inertia is a point.

import numpy as np
from matplotlib.figure import Figure
from scipy import linalg, signal

import ksd
from ksd.units import GPa, mm

steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800, name="spring steel")
length, thickness, width = 80 * mm, 0.4 * mm, 25 * mm
leaf_springs = ksd.ParallelGuide(steel, length=length, thickness=thickness, width=width, spacing=60 * mm)
centre = np.array((40, 0, 0)) * mm


def guide_with(camera=0.0, above=0.0, gravity=None):
    """The guide with a camera of this mass [kg], its centre this far above that of the stage [m]."""
    scene = ksd.Mechanism("guide")
    stage = scene.link("stage", mass=0.5, inertia=(3e-4, 3e-4, 5e-4), at=centre)
    if camera:
        scene.mass(stage, mass=camera, inertia=camera * np.full(3, 2e-4), at=centre + np.array((0, 0, above)))
    placed = scene.join(scene.ground, stage, leaf_springs, at=(0, 0, 0), axis="z", toward="x", name="guide")
    scene.actuate_joint(placed, name="push")
    scene.gravity = gravity
    return scene


# %%
# Frequencies and what they belong to
# -----------------------------------
#
# A drive holds what it drives; `freed="push"` lets it go. One mode then is the motion meant: "intended". All others are
# parasitic, and the first of them bounds what a controller can do.

scene = guide_with()
rest = ksd.solve(scene, push=0.0)
free = rest.frequencies(freed="push", count=8)
print(free)
print(dict(zip(free.names, free.frequency_Hz.round(2).tolist(), strict=True)))

# %%
# A leaf spring has modes of its own, "between the ends": the stage stands still in them, and here they are the lowest that
# are not meant. `names` are counted at this pose, from the lowest. With the drive held the intended mode is gone; what is
# left is what a stiff motor sees.

held = rest.frequencies(count=2)
print(f"first parasitic: {free.first_parasitic_Hz:.2f} Hz let go, {held.first_parasitic_Hz:.2f} Hz held")

# %%
# The table says what moves most, the picture how: here the lowest parasitic mode in which the stage itself moves, its
# amplitude chosen for the eye.

ksd.view.plot_mode(rest, mode="parasitic_3", modes=free, view="xz", amplitude=0.15)

# %%
# `ksd.view.animate_mode` makes a GIF of the same.
#
# By hand
# -------
#
# Two checks that share nothing with the eigenvalue problem above. First, two leaf springs clamped at both ends have the
# stiffness 24 EI/L^3, and each takes part with 13/35 of its mass, that of their deflected shape.

EI = steel.E * width * thickness**3 / 12
leaf_mass = steel.density * length * thickness * width
by_hand = np.sqrt(24 * EI / length**3 / (0.5 + 2 * 13 / 35 * leaf_mass)) / (2 * np.pi)
print(f"intended mode: {free.frequency_Hz[0]:.4f} Hz, by hand {by_hand:.4f} Hz")

# %%
# Second, the stage as a rigid body on the stiffness that its centre of mass has: six frequencies without any mass of
# the leaf springs, which are a little high.

support = rest.stiffness("stage", at=centre, freed="push")
lumped_mass = np.diag((0.5, 0.5, 0.5, 3e-4, 3e-4, 5e-4))
lumped_Hz = np.sqrt(linalg.eigvalsh(support.matrix(), lumped_mass)) / (2 * np.pi)
print("rigid stage:", lumped_Hz.round(2), "Hz")

# %%
# Over the stroke
# ---------------
#
# Bent leaf springs are soft in the directions they should hold, so parasitic frequencies fall. In a sweep a mode keeps
# the name it has at the first pose, and is followed by its shape (MAC): two that cross keep their names, and
# "parasitic_2" here need not be the second one that `pose.frequencies()` counts at another pose. `first_parasitic_Hz` is
# the lowest at each pose, whichever it is.

table = ksd.sweep(scene, push=np.linspace(0, 8, 9) * mm, questions=("frequencies",), progress=False)
for row in table.rows():
    print(
        f"{row['push_mm']:3.0f} mm: intended {row['intended_Hz']:6.3f} Hz, first parasitic {row['first_parasitic_Hz']:6.2f}"
        f" Hz ({row['first_parasitic_mode']}), MAC {row['mac']:.3f}"
    )
table.plot("frequencies")

# %%
# Why do they fall so far? Across the stage less than a quarter of the stiffness is left at 5 mm, as bent leaf springs twist.

moved_pose = ksd.solve(scene, push=5 * mm)
bent = moved_pose.frequencies(freed="push")
ksd.view.plot_mode(moved_pose, mode="parasitic_1", modes=bent, amplitude=0.03)

# %%
# The modes of the stage fall below those of the leaf springs: the first parasitic mode at rest and the one at the end of
# the stroke are different motions. So a curve through three poses fits a mode that is followed, "parasitic_3" as
# counted at rest, and not the lowest of them all, which has a kink where they cross. The errors at other poses tell:

print(ksd.frequency_curve(scene, "push", 8 * mm, mode="parasitic_3"))
print(ksd.frequency_curve(scene, "push", 8 * mm, mode="first_parasitic"))

# %%
# With the camera
# ---------------
#
# A payload lowers all of them. How high it sits does not matter to the motion meant, and much to those in which the stage
# turns.

for words in ({}, {"camera": 0.2}, {"camera": 0.2, "above": 40 * mm}):
    modes = ksd.solve(guide_with(**words), push=5 * mm).frequencies(freed="push", count=4)
    print(f"{words!s:35}", *(f"{f:8.2f}" for f in modes.frequency_Hz), "Hz")

# %%
# Weight counts where it is said. Standing upright, x up, the leaf springs carry the stage and are softer for it; hanging,
# stiffer: by 6 P/(5 L) of the load P on the two of them, to first order.

upright = []
for name, gravity in {"standing": (-9.81, 0, 0), "no weight": None, "hanging": (9.81, 0, 0)}.items():
    pose = ksd.solve(guide_with(gravity=gravity), push=0.0)
    load = 0.0 if gravity is None else gravity[0] * (0.5 + leaf_mass)
    upright.append((pose.drive_stiffness()["push"], 24 * EI / length**3 + 6 * load / (5 * length)))
    print(
        f"{name:10} {upright[-1][0]:8.2f} N/m (by hand {upright[-1][1]:8.2f}), "
        f"{pose.frequencies(freed='push').frequency_Hz[0]:.3f} Hz"
    )

# %%
# What the controller sees
# ------------------------
#
# `ksd.state_space` is the linear model about a pose: forces of the drives in, their motions out, the lowest modes with
# the damping ratio that you give, and the static compliance of the modes left out in D. None of the damping is
# computed. Its four matrices go into `scipy.signal`, and the modal stiffness and mass are in `frequencies`:
# `omega_squared` for unit mass.

damping = 0.01
plant = ksd.state_space(moved_pose, modes=6, damping=damping)
print(plant)
linear = signal.StateSpace(plant.A, plant.B, plant.C, plant.D)
frequency = np.geomspace(1, 500, 4000)
_, gain = signal.freqresp(linear, 2 * np.pi * frequency)

# %%
# Three checks: the gain at zero frequency is one over the drive stiffness; the peak lies at f sqrt(1 - 2 zeta^2) of the
# intended frequency, and is 1/(2 zeta) times the static one.

near = plant.frequency_Hz[0] * np.linspace(0.99, 1.01, 2001)
_, peak = signal.freqresp(linear, 2 * np.pi * near)
static = 1 / moved_pose.drive_stiffness()["push"]
peak_Hz = near[np.abs(peak).argmax()]
amplification = np.abs(peak).max() / static
_, first = signal.freqresp(linear, [1e-3])
static_gain = abs(first[0]) / static
print(f"static gain over compliance {static_gain:.6f}")
print(f"peak at {peak_Hz:.4f} Hz, told {plant.frequency_Hz[0] * np.sqrt(1 - 2 * damping**2):.4f} Hz")
print(f"amplification {amplification:.2f}, 1/(2 zeta) = {1 / (2 * damping):.0f}")

# %%
# The parasitic modes hardly show: the drive acts through the middle of the guide and does not excite them. A drive beside
# it would, and so would floor vibration.
#
# In time
# -------
#
# The same matrices in time: a step of the force, small enough for the mechanism to stay linear. The stage overshoots to
# nearly twice the static motion and rings.

force = 0.1
seconds = np.linspace(0, 1, 2000)
_, moved, _ = signal.lsim(linear, np.full_like(seconds, force), seconds)
overshoot = moved.max() / (force * static)
print(f"overshoot {overshoot:.3f} times, exp(-pi zeta) says {1 + np.exp(-np.pi * damping):.3f}")

figure = Figure(figsize=(9, 3.6), layout="constrained")
left, right = figure.subplots(1, 2)
left.loglog(frequency, np.abs(gain) / mm, color="#c2410c")
left.set(xlabel="frequency [Hz]", ylabel="push per force [mm/N]", title="frequency response at 5 mm")
right.plot(seconds, moved / mm, color="#c2410c")
right.axhline(force * static / mm, color="#9aa3b2", lw=1)
right.set(xlabel="time [s]", ylabel="push beyond 5 mm [mm]", title=f"step of {force} N")
for axes in (left, right):
    axes.grid(color="#eceff4")
    axes.spines[["top", "right"]].set_visible(False)
figure.align_labels()
figure  # noqa: B018  (the page shows it)

# %%
# How far is linear? The stiffness of the drive must not change over the swing. Here it does by little:

for swing in (0.1 * mm, 1 * mm):
    ends = [ksd.solve(scene, push=5 * mm + side * swing).drive_stiffness()["push"] for side in (-1, 1)]
    print(f"+-{swing / mm:.1f} mm: drive stiffness {ends[0]:.1f} to {ends[1]:.1f} N/m")

# %%
# Motion at speed from one pose to another, spin-up and impact are not in the package; what stands for them is in the
# theory, on the page on vibrations. `plant.to_mat("plant.mat")` hands the linear model to a program for control.
