"""A joint of your own, trained and used

The library has the joints of textbooks. Yours may be another: here two leaf springs that converge towards the moving
side, so that it turns about a point outside of the joint, a remote centre. We draw it, ask what it is worth, and
train it, so that mechanisms with many of them are solved as fast as with those of the library.
"""

# %%
# Drawing
# -------
#
# A joint is drawn in its own axes: interface A at the origin, x towards B, z the axis it turns about. Leaf
# springs hang between blocks; `A` and `B` are always two of them. A motion says what the joint is for, and how
# far it may go.

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
# What is it worth?
# -----------------
#
# Without a record it works like any joint, by the conventional method. The leaf springs meet where it turns
# about, at wide/(wide - narrow) of the length.

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
# How far may it turn, and how stiff is its centre? The same questions as of any mechanism.

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
# The fast methods need to know how the joint moves. Asked for without a record, they say so.

try:
    ksd.solve(scene, turn=5 * deg, method="reduced")
except ksd.RecordError as reason:
    print(reason)

# %%
# `ksd.train` moves the joint through its range, from its own finite element model, and writes polynomials of
# where B goes and how the leaf springs bend into one file. For a joint like this that is done while you wait. `meshes`
# says for which leaf springs: without it chains of beam elements are trained besides. Without `out` the record lands in
# `database/` where you are; elsewhere it is found by the environment variable `KSD_DATABASE`.

folder = tempfile.mkdtemp()
record = ksd.train(joint, out=folder, meshes=("strain",), progress=False)
os.environ["KSD_DATABASE"] = folder
print(record)

# %%
# What it learned, and by how much it may be off, relative to the length of the joint, is in the record;
# :literal:`ksd info trapezium` prints it with its range, its source and its age, and with `--check` solves a few
# of its states again. A joint whose leaf springs work against each other may be fitted less well than wanted; a
# warning says so, and `ksd.compare` what it is worth.

for residual in record.residuals:
    print(f"{residual.group:12} off by at most {residual.fit_max:.1e}")

# %%
# Using it
# --------
#
# The same scene now is solved by every method.

for method in ("kinematic", "reduced", "full", "conventional"):
    found = ksd.solve(scene, turn=5 * deg, method=method)
    print(f"{method:13} {found.forces['turn']:.6f} Nm")

# %%
# `ksd.compare` puts times and errors beside them. Without a record it works as well: the methods that need one
# are rows that say so.

print(ksd.compare(scene, turn=5 * deg, progress=False))

# %%
# Where it pays: many of them. Four of these joints carry a platform like a swing; the reduced method moves four
# condensed joints instead of eight leaf springs.


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
told = swinging.method_error.relative
print(
    f"reduced {swinging.forces['push']:.5f} N, told {100 * told:.1g} % off; "
    f"conventional {exact.forces['push']:.5f} N"
)
print(swinging.motions)
swinging.plot()

# %%
# Outside its range a record refuses, with the joint, the value and the range in the message. `extrapolate=True`
# goes on with a warning.

try:
    ksd.solve(scene, turn=15 * deg, method="reduced")
except ksd.RangeError as reason:
    print(reason)

# %%
# A family over a range of shapes, `ksd.Design`, is trained in the same way: see the how-to page on the database.
# What a record cannot say is refused with the reason: a motion that is not the soft one, a second soft freedom that
# is not declared, leaf springs that run through each other or that do not lie symmetrically about the plane of motion.

del os.environ["KSD_DATABASE"]
