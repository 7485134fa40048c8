"""Optimisation of a pivot

A cross flexure has to turn by 20 degrees inside a housing 60 mm high. It should be as stiff as possible in its worst
direction, at every angle, must not see more than 500 MPa, and the motor gives half a newton metre. Which length,
angle, thickness and widths?
"""

# %%
# A design is a function
# ----------------------

import numpy as np

import ksd
from ksd.units import GPa, deg, mm, um

steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800)


def pivot(length, angle, thickness, inner, outer):
    """A cross flexure between ground and an arm, its centre at the origin."""
    joint = ksd.CrossFlexure(
        steel,
        length=length,
        angle=angle,
        thickness=thickness,
        widths=(inner, outer),
        gap=1 * mm,
    )
    scene = ksd.Mechanism("pivot")
    arm = scene.link("arm")
    placed = scene.join(scene.ground, arm, joint, at=(-joint.length_AB / 2, 0, 0), axis="z", toward="x")
    scene.actuate_joint(placed, name="turn")
    return scene


start = {
    "length": 60 * mm,
    "angle": 45 * deg,
    "thickness": 0.4 * mm,
    "inner": 20 * mm,
    "outer": 10 * mm,
}
turns = np.array([0, 10, 20]) * deg

# %%
# What matters?
# -------------
#
# Before an optimiser runs, look at the slopes: by how many percent does an answer change per percent of a
# parameter? `ksd.gradient` gives exact derivatives of any answer of a sweep.

slopes = ksd.gradient(
    pivot,
    start,
    turn=20 * deg,
    questions=("force", "stress", "support_stiffness"),
    link="arm",
    at=(0, 0, 0),
)
print("percent per percent    moment   stress   worst support")
for name in start:
    moment, stress, support = (
        slopes.relative[answer, name][0]
        for answer in ("turn_moment_Nm", "stress_MPa", "support_worst_N_per_m")
    )
    print(f"{name:18} {moment:10.2f} {stress:8.2f} {support:12.2f}")

# %%
# A slope is an exponent. What makes the support stiff, thickness, makes the moment grow as fast: the motor will be what
# limits it.
#
# The job
# -------
#
# A job says what to vary and between which bounds, what to make large, what limits it, and rules of geometry that
# must not be negative, here that the widths and the gaps fit in 60 mm. Answers are columns of a sweep, at every pose;
# a name that is not one is answered with all there are. Several targets are a tuple: the worst of them counts. A
# limit of one number is the most: a pivot that turns both ways says `"turn_moment_Nm": (-0.5, 0.5)`. `"size_mm": (60,
# 40, None)` limits the room along x, y, z that its leaf springs take up, over all poses together.

job = ksd.Job(
    pivot,
    turn=turns,
    link="arm",
    at=(0, 0, 0),
    vary={
        "length": (40 * mm, 80 * mm),
        "angle": (35 * deg, 55 * deg),
        "thickness": (0.2 * mm, 1 * mm),
        "inner": (10 * mm, 40 * mm),
        "outer": (5 * mm, 20 * mm),
    },
    maximise="support_worst_N_per_m",
    limits={"stress_MPa": 500, "turn_moment_Nm": 0.5},
    rules=[lambda design: 60 * mm - design["inner"] - 2 * design["outer"] - 2 * mm],
)

# %%
# The optimum
# -----------
#
# Two starts, the second one random: where both end in the same design it is hardly a local one. The table counts
# those that agree to 1e-5.

best = ksd.optimise(job, start=start, starts=2)
print(best)
print("ends of the starts:", *(f"{end.merit:.5g} N/m" for end in best.starts))

# %%
# Read the last table first. It says what holds the optimum back, and what every limit is worth, in percent of stiffness per
# percent that it is moved. Of two that can be moved the larger number is where to go: ask whether leaf springs may be
# shorter than 40 mm before asking for a larger motor. The stress is not in the table, so it does not limit.

best.plot()

# %%
# `best.plot("optimum.png")` writes the picture. The optimum is a mechanism like any other: draw it, ask it, look at
# it at the pose that is worst.

worst = best.pose()
print(worst.stiffness("arm", at=(0, 0, 0)))
worst.plot(color="stress")

# %%
# Does it survive the workshop?
# -----------------------------
#
# Sheet scatters by some micrometres of thickness. The optimum lies on its limits, so much of what is made will exceed
# them.

made = ksd.tolerance(job, best, spread={"thickness": 4 * um, "length": 20 * um}, samples=100)
print(made)

# %%
# `[2]` and `[3]` of the support stiffness are its second and third softest direction. `robust=2` moves
# the limits in by two standard deviations of what they limit.

safe = ksd.optimise(job, start=best.design, robust=2, spread={"thickness": 4 * um, "length": 20 * um})
safely_made = ksd.tolerance(job, safe, spread={"thickness": 4 * um, "length": 20 * um}, samples=100)
print(f"optimum {best.merit:.3g} N/m, {100 * made.yield_fraction:.0f} % hold every limit")
print(f"robust  {safe.merit:.3g} N/m, {100 * safely_made.yield_fraction:.0f} % hold every limit")

# %%
# What does a smaller motor cost?
# -------------------------------
#
# The front: the best design for ever smaller moments, each found from its neighbour.

front = ksd.pareto(job, against="turn_moment_Nm", points=3, start=best.design)
print(front)
front.plot()

# %%
# Long jobs keep what they have computed: `resume="pivot.jsonl"` goes on where Ctrl-C ended it, and `executor=`
# runs starts in other processes. Any other optimiser takes `job.values(x)` and `job.jacobian(x)`: see the how-to
# page on jobs.
