"""Dynamics: the vibrations of a guide

The parallel guide of the first tutorial carries a camera whose position is controlled. This tutorial computes its
frequencies, distinguishes the intended mode from parasitic modes, shows the influence of stroke and payload, and derives a
state-space model for the controller. All of this is linear: small vibrations about one pose.
"""

# %%
# What has mass
# -------------
#
# The mass of leaf springs follows from the density of their material. A link has the given mass, with its inertia about its
# centre of mass `at`. `scene.mass` adds mass to a link, here a camera. A mass without inertia is a point mass.

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
# Frequencies and modes
# ---------------------
#
# Drives are held unless they are named in `freed`. With `freed="push"` one mode is the intended motion. All others are
# parasitic; the first of them limits the bandwidth of the controller.

scene = guide_with()
rest = ksd.solve(scene, push=0.0)
free = rest.frequencies(freed="push", count=8)
print(free)
print(dict(zip(free.names, free.frequency_Hz.round(2).tolist(), strict=True)))

# %%
# Leaf springs have modes of their own, "between the ends", in which the stage does not move. Here they are the lowest
# parasitic modes. `names` numbers the modes of this pose from the lowest. With the drive held, as by a stiff motor, there
# is no intended mode.

held = rest.frequencies(count=2)
print(f"first parasitic: {free.first_parasitic_Hz:.2f} Hz released, {held.first_parasitic_Hz:.2f} Hz held")

# %%
# The table names the part that moves most in each mode. The picture shows the lowest parasitic mode in which the stage
# moves, with an arbitrary amplitude.

ksd.view.plot_mode(rest, mode="parasitic_3", modes=free, view="xz", amplitude=0.15)

# %%
# `ksd.view.animate_mode` makes a GIF of the same.
#
# By hand
# -------
#
# Two checks are independent of the eigenvalue problem above. First, two leaf springs with both ends clamped have the
# stiffness 24 EI/L^3, and the effective mass of each is 13/35 of its mass, by the kinetic energy of the deflected shape.

EI = steel.E * width * thickness**3 / 12
leaf_mass = steel.density * length * thickness * width
by_hand = np.sqrt(24 * EI / length**3 / (0.5 + 2 * 13 / 35 * leaf_mass)) / (2 * np.pi)
print(f"intended mode: {free.frequency_Hz[0]:.4f} Hz, by hand {by_hand:.4f} Hz")

# %%
# Second, the stage as a rigid body on the 6 by 6 stiffness at its centre of mass has six frequencies. They are slightly
# too high, because the mass of the leaf springs is neglected.

support = rest.stiffness("stage", at=centre, freed="push")
lumped_mass = np.diag((0.5, 0.5, 0.5, 3e-4, 3e-4, 5e-4))
lumped_Hz = np.sqrt(linalg.eigvalsh(support.matrix(), lumped_mass)) / (2 * np.pi)
print("rigid stage:", lumped_Hz.round(2), "Hz")

# %%
# Over the stroke
# ---------------
#
# The support stiffness of bent leaf springs is lower, so parasitic frequencies decrease. In a sweep a mode is followed by
# its shape (MAC) and keeps the name it has at the first pose, also where two modes cross. "parasitic_2" of the sweep can
# therefore differ from "parasitic_2" of `pose.frequencies()` at another pose. `first_parasitic_Hz` is the lowest parasitic
# frequency at each pose.

table = ksd.sweep(scene, push=np.linspace(0, 8, 9) * mm, questions=("frequencies",), progress=False)
for row in table.rows():
    print(
        f"{row['push_mm']:3.0f} mm: intended {row['intended_Hz']:6.3f} Hz, first parasitic {row['first_parasitic_Hz']:6.2f}"
        f" Hz ({row['first_parasitic_mode']}), MAC {row['mac']:.3f}"
    )
table.plot("frequencies")

# %%
# The cause is the torsional compliance of bent leaf springs: along z less than a quarter of the stiffness remains at 5 mm.

moved_pose = ksd.solve(scene, push=5 * mm)
bent = moved_pose.frequencies(freed="push")
ksd.view.plot_mode(moved_pose, mode="parasitic_1", modes=bent, amplitude=0.03)

# %%
# The frequencies of the stage fall below those of the leaf springs, so the first parasitic mode at rest and that at the end
# of the stroke are different motions. The lowest frequency has a kink where they cross and should not be fitted. Fit one
# mode that is followed, here "parasitic_3" of the pose at rest. The errors at poses between the three fitted ones:

print(ksd.frequency_curve(scene, "push", 8 * mm, mode="parasitic_3"))
print(ksd.frequency_curve(scene, "push", 8 * mm, mode="first_parasitic"))

# %%
# With the camera
# ---------------
#
# A payload lowers all frequencies. Its height has no influence on the intended mode, but a large influence on the modes in
# which the stage rotates.

for words in ({}, {"camera": 0.2}, {"camera": 0.2, "above": 40 * mm}):
    modes = ksd.solve(guide_with(**words), push=5 * mm).frequencies(freed="push", count=4)
    print(f"{words!s:35}", *(f"{f:8.2f}" for f in modes.frequency_Hz), "Hz")

# %%
# Weight is included if `gravity` is given. If the guide stands upright (x up), the leaf springs carry the stage in
# compression and the drive stiffness is lower; if it hangs, the stiffness is higher. To first order the change is
# 6 P/(5 L), with P the total load on the two leaf springs.

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
# State-space model for the controller
# ------------------------------------
#
# `ksd.state_space` returns the linear model about a pose. Its inputs are the drive forces, its outputs the drive
# displacements. It contains the lowest modes with the damping ratio that you give (damping is not computed), and in D the
# static compliance of all other modes. Use its four matrices in `scipy.signal`. The modal stiffness for unit modal mass is
# `omega_squared` of `frequencies`.

damping = 0.01
plant = ksd.state_space(moved_pose, modes=6, damping=damping)
print(plant)
linear = signal.StateSpace(plant.A, plant.B, plant.C, plant.D)
frequency = np.geomspace(1, 500, 4000)
_, gain = signal.freqresp(linear, 2 * np.pi * frequency)

# %%
# Three checks: the gain at zero frequency is one over the drive stiffness, the resonance peak is at f sqrt(1 - 2 zeta^2)
# with f the intended frequency, and the amplification at the peak is 1/(2 zeta).

near = plant.frequency_Hz[0] * np.linspace(0.99, 1.01, 2001)
_, peak = signal.freqresp(linear, 2 * np.pi * near)
static = 1 / moved_pose.drive_stiffness()["push"]
peak_Hz = near[np.abs(peak).argmax()]
amplification = np.abs(peak).max() / static
_, first = signal.freqresp(linear, [1e-3])
static_gain = abs(first[0]) / static
print(f"static gain over compliance {static_gain:.6f}")
print(
    f"peak at {peak_Hz:.4f} Hz, by the formula {plant.frequency_Hz[0] * np.sqrt(1 - 2 * damping**2):.4f} Hz"
)
print(f"amplification {amplification:.2f}, 1/(2 zeta) = {1 / (2 * damping):.0f}")

# %%
# The parasitic modes are hardly visible, because the drive acts at the middle of the guide and does not excite them. An
# eccentric drive or floor vibration would.
#
# Step response
# -------------
#
# The same matrices give the response to a force step that is small enough for linear behaviour. The stage overshoots to
# nearly twice the static displacement and then oscillates.

force = 0.1
seconds = np.linspace(0, 1, 2000)
_, moved, _ = signal.lsim(linear, np.full_like(seconds, force), seconds)
overshoot = moved.max() / (force * static)
print(f"overshoot {overshoot:.3f} times, 1 + exp(-pi zeta) = {1 + np.exp(-np.pi * damping):.3f}")

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
# The linear model is valid if the drive stiffness hardly changes over the vibration amplitude. Here the change is small:

for swing in (0.1 * mm, 1 * mm):
    ends = [ksd.solve(scene, push=5 * mm + side * swing).drive_stiffness()["push"] for side in (-1, 1)]
    print(f"+-{swing / mm:.1f} mm: drive stiffness {ends[0]:.1f} to {ends[1]:.1f} N/m")

# %%
# Fast motion from one pose to another is a matter of `ksd.simulate`. `plant.to_mat("plant.mat")` writes the linear model for
# MATLAB.
