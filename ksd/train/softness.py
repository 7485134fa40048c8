"""Whether the declared motions of a joint are its soft ones, from its stiffness at rest."""

from __future__ import annotations

import numpy as np

from ksd.errors import SceneError
from ksd.library.record import Array
from ksd.model.compile import compile_scene
from ksd.scene import DrawnJoint, Mechanism
from ksd.solve.conventional import conventional

STEP = 1e-6
"""Displacement over joint length, or rotation in rad, small enough for the linear stiffness."""
MARGIN = 0.8
"""Largest stiffness of an intended motion over the softest of what is left; 0.7 in a single leaf, against its torsion."""


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
    """Raise SceneError when an intended motion of `joint` is not clearly softer than all others."""
    stiffness = rest_stiffness(joint)
    flexible = np.linalg.inv(stiffness)
    left = np.linalg.eigvalsh(stiffness)[len(joint.motions)] if len(joint.motions) < 6 else np.inf
    for motion in joint.motions:
        axis = np.zeros(6)
        axis[slice(3, 6) if motion.kind == "rotation" else slice(0, 3)] = motion.axis
        own = 1.0 / float(axis @ flexible @ axis)
        if not 0 < own < MARGIN * left:
            raise SceneError(
                f"{joint.family}: the intended motion '{motion.name}' is not the soft one: its stiffness "
                f"{own:.3g} Nm (over the joint length) is not below {MARGIN:g} of the softest other, "
                f"{left:.3g} Nm; declare the motion the leafs allow."
            )
