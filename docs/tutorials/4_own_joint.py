"""A joint of your own, trained and used

The library contains the common joints. This tutorial describes one that is not in it: two leaf springs that converge
towards the moving side, so that it rotates about a remote centre outside the joint. We draw the joint, compute its
properties and train a record, so that mechanisms with many of them are solved as fast as with joints of the library.
"""

# %%
# Drawing
# -------
#
# A joint is drawn in its own axes: interface A at the origin, x towards B, z along the axis of rotation. Leaf springs
# connect blocks, two of which are `A` and `B`. `ksd.Motion` is an intended motion with its range.

import os
import tempfile

import numpy as np

import ksd
from ksd.units import GPa, MPa, deg, mm

steel = ksd.Material(E=200 * GPa, nu=0.3, density=7800, yield_stress=1300 * MPa)
length, wide, narrow = 40 * mm, 20 * mm, 8 * mm


def leaf(name, side):
    """One of the two leaf springs, on side +-1."""
    return ksd.Leaf(
        start=(0, side * wide, 0),
        end=(length, side * narrow, 0),
        width_axis="z",
        section=ksd.rectangle(0.2 * mm, 15 * mm),
        material=steel,
        name=name,
    )


joint = ksd.DrawnJoint(
    "trapezium",
    blocks={"A": (0, 0, 0), "B": (length, 0, 0)},
    leaves=[leaf("low", -1), leaf("high", +1)],
    motions=[ksd.Motion("turn", "rotation", "z", (-10 * deg, 10 * deg))],
)

# %%
# Properties of the joint
# -----------------------
#
# Without a record the joint is solved by the conventional method. The centre of rotation is the point where the lines
# of the two leaf springs intersect, at wide/(wide - narrow) times the length.

scene = ksd.Mechanism("remote centre")
arm = scene.link("arm", mass=0.1, inertia=(1e-5, 1e-5, 2e-5), at=(length, 0, 0))
placed = scene.join(scene.ground, arm, joint, at=(0, 0, 0), axis="z", toward="x", name="pivot")
scene.actuate_joint(placed, name="turn")
centre = (length * wide / (wide - narrow), 0, 0)

pose = ksd.solve(scene, turn=5 * deg)
print(f"method {pose.method}: {pose.forces['turn']:.4f} Nm, {pose.stress().largest_Pa / MPa:.0f} MPa")
print(pose.pivot_shift(placed, at=centre))
pose.plot(color="stress")

# %%
# Moment, support stiffness at the centre and stress over the range show how far the joint may rotate.

table = ksd.sweep(
    scene,
    turn=np.linspace(0, 10, 6) * deg,
    questions=("force", "support_stiffness", "stress"),
    link=arm,
    at=centre,
    progress=False,
)
table.plot("force", "support_stiffness", "stress")

# %%
# Training
# --------
#
# The fast methods need a record of the motion of the joint. Without one they raise `ksd.RecordError`.

try:
    ksd.solve(scene, turn=5 * deg, method="reduced")
except ksd.RecordError as reason:
    print(reason)

# %%
# `ksd.train` solves the finite element model of the joint over its range and writes one file with polynomials for the
# pose of B and the bending of the leaf springs. For a joint like this it takes little time. `meshes` selects the
# models of the leaf springs: without it chains of beam elements are trained as well. `out` is the folder of the record,
# by default `database/` in the current folder; the environment variable `KSD_DATABASE` names any other folder.

folder = tempfile.mkdtemp()
record = ksd.train(joint, out=folder, meshes=("strain",), progress=False)
os.environ["KSD_DATABASE"] = folder
print(record)

# %%
# The record contains the errors of its polynomials as numbers without unit: displacements over the length of the
# joint, rotations, curvatures times the length L of their leaf spring, forces times L^2/EI and moments times L/EI.
# :literal:`ksd info trapezium` prints them with range, source and age of the record, and from how many such joints on
# it is faster than `conventional`; with `--check` it also solves some trained states again. For some overconstrained
# joints the fit is less accurate than requested; a warning then says so, and `ksd.compare` shows the effect on the
# answers.

for residual in record.residuals:
    print(f"{residual.group:12} error at most {residual.fit_max:.1e}")

# %%
# Using it
# --------
#
# Now every method can solve the same scene.

for method in ("kinematic", "reduced", "full", "conventional"):
    found = ksd.solve(scene, turn=5 * deg, method=method)
    print(f"{method:13} {found.forces['turn']:.6f} Nm")

# %%
# `ksd.compare` prints answer, time and error of every method. If there is no record, the rows of the methods that need
# one say so.

print(ksd.compare(scene, turn=5 * deg, progress=False))

# %%
# The record pays in mechanisms with many joints. In this swing four joints carry a platform; the reduced method solves
# four condensed joints instead of eight leaf springs.


def swing():
    """Two arms on ground, a platform on both, four trapezia."""
    mechanism = ksd.Mechanism("swing")
    left, right, platform = mechanism.links("left", "right", "platform")
    for side, x in ((left, -60 * mm), (right, 60 * mm)):
        mechanism.join(mechanism.ground, side, joint, at=(x, 0, 0), axis="z", toward="y")
        mechanism.join(platform, side, joint, at=(x, 200 * mm, 0), axis="z", toward=(0, -1, 0))
    mechanism.actuate(platform, along="x", at=(0, 200 * mm, 0), name="push")
    return mechanism


swinging = ksd.solve(swing(), push=5 * mm, method="reduced")
exact = ksd.solve(swing(), push=5 * mm, method="conventional")
error = swinging.method_error.relative
print(
    f"reduced {swinging.forces['push']:.5f} N, estimated error {100 * error:.1g} %; "
    f"conventional {exact.forces['push']:.5f} N"
)
print(swinging.motions)
swinging.plot()

# %%
# Outside the range of the record the solve is refused; the message states the joint, the value and the range.
# `extrapolate=True` solves with a warning instead.

try:
    ksd.solve(scene, turn=15 * deg, method="reduced")
except ksd.RangeError as reason:
    print(reason)

# %%
# `ksd.Design` describes a family of joints over a range of shapes, which is trained in the same way; see the how-to page
# on the database. Joints that a record cannot represent are refused with the reason: an intended motion that is not soft,
# a second soft freedom that is not declared, leaf springs that intersect or are not symmetric about the plane of motion.

del os.environ["KSD_DATABASE"]
