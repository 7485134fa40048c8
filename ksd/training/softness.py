"""Check, from the stiffness at rest, that the declared motions of a joint are its soft motions, and all of them.

A freedom is a motion that thin leaf springs resist by weak bending and torsion only; a constraint is one that stretches
them or bends them in their plane. With all weak bending and torsion reduced to a quarter, freedoms have a quarter of
their stiffness and constraints keep theirs, for any scale of lengths: a generalised eigenvalue problem of the two
stiffnesses counts them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, null_space

from ksd.errors import SceneError
from ksd.library.functions import Array
from ksd.model.compile import compile_scene
from ksd.scene import DrawnJoint, Joint
from ksd.solvers.conventional import solve_conventional
from ksd.training.designs import held_joint, soften_leaves

PROBE_STEP = 1e-6
"""Displacement over joint length, or rotation in rad, small enough for the linear stiffness."""
MAX_STIFFNESS_RATIO = 0.95
"""Largest stiffness of an intended motion over that of the softest other motion.

At 1 the two exchange places, as in a square bar, which bends equally in both directions; the margin left is a Poisson's
ratio or a fillet. Hinges of several leaf springs have 0.03 at most; one leaf against its own torsion (1 + nu)/2 when
wide, 0.94 when three times as wide as thick with nu = 0.49; circular notches up to 0.87
(`tests/training/test_softness.py`).
"""
SOFTENING_FACTOR = 0.25
"""Factor on weak bending and torsion in the softened joint."""
FREEDOM_FALL = 2.0
"""Ratio of stiffnesses, before over after softening by SOFTENING_FACTOR, above which a motion is a freedom.

It is midway (in ratio) between 4 for a freedom and 1 for a constraint. Intended motions of all families of several leaf
springs have 3.8 or more, all other motions 1.02 or less.
"""
MAX_FREEDOM_RATIO = 1e3
"""A freedom more than this many times as stiff as the intended motion is ignored: thick leaf springs, ten times as
thick as the thin ones, that only hold them."""


@dataclass(frozen=True)
class Freedom:
    """An undeclared motion of B: direction (6,) of displacement over the joint length and rotation, normalised; its
    stiffness over that of the stiffest intended motion; both in words."""

    direction: Array
    ratio: float
    words: str


def scaling(joint: Joint) -> Array:
    """Units (6,) of displacements [m] and rotations."""
    return np.repeat([joint.length, 1.0], 3)


def rest_stiffness(joint: DrawnJoint) -> Array:
    """Stiffness (6, 6) [Nm] of B at rest: from displacement over the joint length and rotation to force times length
    and moment."""
    scene, link = held_joint(joint)
    for axis in "xyz":
        scene.actuate(link, along=axis, at=joint.pose_B, name=axis)
    for axis in "xyz":
        scene.actuate(link, about=axis, name=f"r{axis}")
    model = compile_scene(scene)
    scale = scaling(joint)
    columns = []
    for i in range(6):
        wanted = {name: float(PROBE_STEP * scale[i] * (i == j)) for j, name in enumerate(model.drive_names)}
        forces = solve_conventional(model, wanted).forces
        columns.append(np.array([forces[name] for name in model.drive_names]) * scale / PROBE_STEP)
    stiffness = np.array(columns)
    return np.asarray(0.5 * (stiffness + stiffness.T))


def check_soft(joint: DrawnJoint) -> None:
    """Raise SceneError when an intended motion of `joint` is not softer than all others by MAX_STIFFNESS_RATIO, or when
    the joint has an undeclared freedom."""
    stiffness, softened = rest_stiffness(joint), rest_stiffness(soften_leaves(joint, SOFTENING_FACTOR))
    freedom = undeclared_freedom(joint, stiffness, softened)
    softest = softest_other(joint, stiffness)
    own_stiffnesses = intended_stiffnesses(joint, stiffness), intended_stiffnesses(joint, softened)
    for motion, own, softened_own in zip(joint.motions, *own_stiffnesses, strict=True):
        if 0 < own < MAX_STIFFNESS_RATIO * softest or (
            freedom is not None and not joint.held_by_others and own > FREEDOM_FALL * softened_own
        ):
            continue
        raise SceneError(
            f"{joint.family}: the intended motion '{motion.name}' is not the soft one{shape_phrase(joint)}"
            f": its stiffness {own:.3g} Nm (over the joint length) is not below {MAX_STIFFNESS_RATIO:g} of the softest "
            f"other, {softest:.3g} Nm; declare the motion the leaf springs allow"
            f"{'' if freedom is None else ', ' + freedom.words}."
        )
    if freedom is not None and not joint.held_by_others:
        declare = "declare it as an intended motion, " if len(joint.motions) < 2 else ""
        raise SceneError(
            f"{joint.family}: its leaf springs leave another motion free that is not declared{shape_phrase(joint)}: "
            f"{freedom.words}, {freedom.ratio:.3g} times the intended one (over the joint length); {declare}hold it by "
            "another leaf, or say held_by_others=True where the mechanism around the joint holds it."
        )


def shape_phrase(joint: Joint) -> str:
    """Phrase naming the shape of a joint, empty without shape parameters."""
    shape = listed_values(joint.shape())
    return f" in the shape {shape}" if shape else ""


def listed_values(values: Mapping[str, float]) -> str:
    """Names and values as text, such as "angle = 0.7854, ratio = 0.5"."""
    return ", ".join(f"{name} = {value:.4g}" for name, value in values.items())


def largest_intended_stiffness(joint: Joint) -> float:
    """Stiffness [Nm] at rest of the stiffest intended motion with all else free, displacements over the joint length."""
    return max(intended_stiffnesses(joint, rest_stiffness(soften_leaves(joint, 1.0))))


def intended_stiffnesses(joint: Joint, stiffness: Array) -> list[float]:
    """Stiffness [Nm] of every intended motion with all else free; stiffness (6, 6): of `rest_stiffness`."""
    compliance = np.linalg.inv(stiffness)
    return [1.0 / float(axis @ compliance @ axis) for axis in _declared_directions(joint)]


def softest_other(joint: Joint, stiffness: Array) -> float:
    """Stiffness [Nm] of the softest motion besides as many as the joint declares, inf without one."""
    count = len(joint.motions)
    return float(np.linalg.eigvalsh(stiffness)[count]) if count < 6 else np.inf


def _declared_directions(joint: Joint) -> Array:
    """Measure (m, 6) of each intended motion: weights of the displacement of B over the joint length and of its
    rotation."""
    rows = []
    for motion in joint.motions:
        axis = np.asarray(motion.axis, float)
        if motion.kind == "rotation":
            rows.append(np.concatenate([np.zeros(3), axis]))
            continue
        lever = np.zeros(3) if motion.point is None else np.subtract(motion.point, joint.pose_B)
        rows.append(np.concatenate([axis, np.cross(lever, axis) / joint.length]))
    return np.array(rows)


def undeclared_freedom(joint: DrawnJoint, stiffness: Array, softened: Array) -> Freedom | None:
    """The softest freedom of `joint` with its intended motions fixed, up to MAX_FREEDOM_RATIO times theirs; None
    without one.

    stiffness, softened (6, 6): at rest, of the joint and of the joint softened by SOFTENING_FACTOR.
    """
    remaining = null_space(_declared_directions(joint))
    if remaining.shape[1] == 0:
        return None
    remaining_stiffness, softened_stiffness = (remaining.T @ K @ remaining for K in (stiffness, softened))
    falls, motions = eigh(remaining_stiffness, softened_stiffness)
    freedoms = motions[:, falls > FREEDOM_FALL]
    if freedoms.shape[1] == 0:
        return None
    basis, _ = np.linalg.qr(freedoms)
    values, vectors = np.linalg.eigh(basis.T @ remaining_stiffness @ basis)
    own = max(intended_stiffnesses(joint, stiffness))
    if values[0] > MAX_FREEDOM_RATIO * own:
        return None
    direction = remaining @ basis @ vectors[:, 0]
    return Freedom(
        direction, float(values[0] / own), describe_soft_motion(joint, direction, float(values[0]))
    )


def describe_soft_motion(joint: Joint, direction: Array, stiffness: float) -> str:
    """A motion (6,) of B in words, a rotation about a line or a translation.

    stiffness [Nm, over the length] is given as that of a motion of its own kind.
    """
    translation, rotation = joint.length * direction[:3], direction[3:]
    if np.linalg.norm(rotation) > 0.1:
        angle = float(np.linalg.norm(rotation))
        line = np.asarray(joint.pose_B) + np.cross(rotation, translation) / angle**2
        point = ", ".join(f"{v:.3g}" for v in np.where(np.abs(line) < 1e-6 * joint.length, 0.0, line))
        return f"a rotation about {_axis(rotation)} through ({point}) m of {stiffness / angle**2:.3g} Nm/rad"
    return (
        f"a translation along {_axis(translation)} of {stiffness / float(translation @ translation):.3g} N/m"
    )


def _axis(direction: Array) -> str:
    """x, y or z where a direction is one of them, else its components."""
    unit = direction / np.linalg.norm(direction)
    k = int(np.argmax(np.abs(unit)))
    if abs(unit[k]) > 1 - 1e-6:
        return "xyz"[k]
    return "(" + ", ".join(f"{v:g}" for v in np.round(unit * np.sign(unit[k]), 3) + 0.0) + ")"
