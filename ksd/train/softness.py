"""Whether the declared motions of a joint are its soft ones, from its stiffness at rest."""

from __future__ import annotations

import numpy as np

from ksd.errors import SceneError
from ksd.library.record import Array
from ksd.model.compile import compile_scene
from ksd.scene import DrawnJoint, Mechanism, Motion
from ksd.solve.conventional import conventional

STEP = 1e-6
"""Displacement over joint length, or rotation in rad, small enough for the linear stiffness."""
MARGIN = 0.95
"""Largest stiffness of an intended motion over the softest of what is left. At 1 the two change places, as in a square bar,
which bends as readily either way; what is left free is a Poisson's ratio or a fillet. Hinges of several leafs have 0.03 at
most, one leaf against its own torsion (1 + nu)/2 when wide, .94 three times as wide as thick with nu = .49; circular notches
up to .87 (`tests/train/test_softness.py`)."""


def rest_stiffness(joint: DrawnJoint) -> Array:
    """(6, 6) [Nm]: displacement of B over the joint length, rotation, to force times length, moment."""
    scene = Mechanism(joint.family)
    link = scene.link("B")
    scene.join(scene.ground, link, joint, at=(0, 0, 0), axis="z", toward="x", name="joint")
    for axis in "xyz":
        scene.actuate(link, along=axis, at=joint.pose_B, name=axis)
    for axis in "xyz":
        scene.actuate(link, about=axis, name=f"r{axis}")
    model = compile_scene(scene)
    scale = np.repeat([joint.length, 1.0], 3)
    columns = []
    for i in range(6):
        wanted = {name: float(STEP * scale[i] * (i == j)) for j, name in enumerate(model.drive_names)}
        forces = conventional(model, wanted).forces
        columns.append(np.array([forces[name] for name in model.drive_names]) * scale / STEP)
    stiffness = np.array(columns)
    return np.asarray(0.5 * (stiffness + stiffness.T))


def check_soft(joint: DrawnJoint) -> None:
    """Raise SceneError when an intended motion of `joint` is not softer than all others by MARGIN."""
    for motion, own, left in softness(joint):
        if not 0 < own < MARGIN * left:
            shape = ", ".join(f"{name} = {value:.4g}" for name, value in joint.shape().items())
            raise SceneError(
                f"{joint.family}: the intended motion '{motion.name}' is not the soft one"
                + (f" in the shape {shape}" if shape else "")
                + f": its stiffness {own:.3g} Nm (over the joint length) is not below {MARGIN:g} of the softest other, "
                f"{left:.3g} Nm; declare the motion the leafs allow."
            )


def softness(joint: DrawnJoint) -> list[tuple[Motion, float, float]]:
    """Every intended motion, its stiffness with all else free, and that of the softest of what is left [Nm]."""
    stiffness = rest_stiffness(joint)
    flexible = np.linalg.inv(stiffness)
    left = np.linalg.eigvalsh(stiffness)[len(joint.motions)] if len(joint.motions) < 6 else np.inf
    found = []
    for motion in joint.motions:
        axis = np.zeros(6)
        axis[slice(3, 6) if motion.kind == "rotation" else slice(0, 3)] = motion.axis
        found.append((motion, 1.0 / float(axis @ flexible @ axis), float(left)))
    return found
