"""Optimisation of a pivot

A cross flexure has to rotate by 20 degrees in a housing 60 mm high. Its support stiffness in the softest direction has to
be as large as possible at every angle, with a stress of at most 500 MPa and a motor moment of at most 0.5 Nm. The
optimiser determines length, angle, thickness and widths.
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
# Sensitivities
# -------------
#
# Before you run an optimiser, look at the relative derivatives: by how many percent an answer changes per percent of a
# parameter. `ksd.gradient` gives the derivatives of any answer of a sweep.

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
# A relative derivative is the exponent of a power law. A larger thickness increases both the support stiffness and the
# moment, so the motor will limit the design.
#
# The job
# -------
#
# A job has parameters to vary with their bounds, a target, limits, and geometric rules that must not be negative; here
# the widths and the gaps have to fit in 60 mm. Target and limits are columns of a sweep and are evaluated at every pose;
# an unknown name raises an error that lists all names. Several targets are given as a tuple, of which the worst counts.
# A single number is an upper limit; for a pivot that rotates both ways give `"turn_moment_Nm": (-0.5, 0.5)`.
# `"size_mm": (60, 40, None)` limits the space along x, y, z that the leaf springs occupy in all poses together.

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
# `starts=2` adds a random start to the first. If both end in the same design, it is probably the global optimum. The
# table counts the starts that agree to 1e-4.

best = ksd.optimise(job, start=start, starts=2)
print(best)
print("ends of the starts:", *(f"{end.merit:.5g} N/m" for end in best.starts))

# %%
# Read the last table first. It lists the active limits and how many percent of stiffness is gained per percent by which a
# limit is moved. Change the limit with the largest number first: ask for leaf springs shorter than 40 mm before you ask
# for a larger motor. The stress is not in the table, so it is not an active limit.

best.plot()

# %%
# `best.plot("optimum.png")` writes the picture. The optimum is a mechanism like any other: you can plot and solve it, for
# example at its worst pose.

worst = best.pose()
print(worst.stiffness("arm", at=(0, 0, 0)))
worst.plot(color="stress")

# %%
# Tolerances
# ----------
#
# The thickness of sheet metal varies by some micrometres. The optimum lies on its limits, so many of the parts made
# will exceed them.

made = ksd.tolerance(job, best, spread={"thickness": 4 * um, "length": 20 * um}, samples=100)
print(made)

# %%
# `[2]` and `[3]` of the support stiffness are its second and third softest direction. `robust=2` tightens each limit by
# two standard deviations of the limited quantity.

safe = ksd.optimise(job, start=best.design, robust=2, spread={"thickness": 4 * um, "length": 20 * um})
safely_made = ksd.tolerance(job, safe, spread={"thickness": 4 * um, "length": 20 * um}, samples=100)
print(f"optimum {best.merit:.3g} N/m, {100 * made.yield_fraction:.0f} % hold every limit")
print(f"robust  {safe.merit:.3g} N/m, {100 * safely_made.yield_fraction:.0f} % hold every limit")

# %%
# Support stiffness against motor moment
# --------------------------------------
#
# The Pareto front contains the best design for a series of moments. Each optimisation starts from the previous design.

front = ksd.pareto(job, against="turn_moment_Nm", points=3, start=best.design)
print(front)
front.plot()

# %%
# With `resume="pivot.jsonl"` a long job saves its results and continues after Ctrl-C. `executor=` runs starts in other
# processes. Other optimisers can use `job.values(x)` and `job.jacobian(x)`; see the how-to page on jobs.
