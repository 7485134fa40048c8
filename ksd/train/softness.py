"""Whether the declared motions of a joint are its soft ones, and all of them, from its stiffness at rest.

A freedom is a motion that thin leaves resist by weak bending and torsion alone, a constraint one that stretches them or
bends them in their plane. With all weak bending and torsion at a quarter, freedoms have a quarter of their stiffness and
constraints keep theirs, whatever the scale of lengths: a generalised eigenvalue problem of the two stiffnesses counts them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import eigh, null_space

from ksd.errors import SceneError
from ksd.library.functions import Array
from ksd.model.compile import compile_scene
from ksd.scene import DrawnJoint, Joint, Mechanism, Motion
from ksd.solve.conventional import solve_conventional
from ksd.train.designs import soften_leaves

STEP = 1e-6
"""Displacement over joint length, or rotation in rad, small enough for the linear stiffness."""
MAX_STIFFNESS_RATIO = 0.95
"""Largest stiffness of an intended motion over the softest of what is left. At 1 the two change places, as in a square bar,
which bends as readily either way; what is left free is a Poisson's ratio or a fillet. Hinges of several leaves have 0.03 at
most, one leaf against its own torsion (1 + nu)/2 when wide, .94 three times as wide as thick with nu = .49; circular notches
up to .87 (`tests/train/test_softness.py`)."""
SOFTENING_FACTOR = 0.25
FREEDOM_FALL = 2.0
"""Fall of stiffness, where bending and torsion fall to SOFTENING_FACTOR, from which a motion is a freedom: midway (in
ratio) between 4 for a freedom and 1 for a constraint. Intended motions of all families of several leaves have 3.8 or
more, all others 1.02 or less."""
MAX_FREEDOM_RATIO = 1e3
"""A freedom this many times as stiff as the intended motion counts as none: leaves ten times as thick, drawn for what holds
the thin ones."""


@dataclass(frozen=True)
class Freedom:
    """An undeclared motion of B: direction (6,) of displacement over the joint length and rotation, of length one; its
    stiffness over that of the stiffest intended motion; both in words."""

    direction: Array
    ratio: float
    words: str


def scaling(joint: Joint) -> Array:
    """(6,): what displacements [m] and rotations are measured in."""
    return np.repeat([joint.length, 1.0], 3)


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
    scale = scaling(joint)
    columns = []
    for i in range(6):
        wanted = {name: float(STEP * scale[i] * (i == j)) for j, name in enumerate(model.drive_names)}
        forces = solve_conventional(model, wanted).forces
        columns.append(np.array([forces[name] for name in model.drive_names]) * scale / STEP)
    stiffness = np.array(columns)
    return np.asarray(0.5 * (stiffness + stiffness.T))


def check_soft(joint: DrawnJoint) -> None:
    """Raise SceneError when an intended motion of `joint` is not softer than all others by MAX_STIFFNESS_RATIO, or when the
    joint has a freedom that is not declared."""
    whole, soft = rest_stiffness(joint), rest_stiffness(soften_leaves(joint, SOFTENING_FACTOR))
    other = undeclared_freedom(joint, whole, soft)
    for (motion, own, left), (_, fallen, _) in zip(
        softness(joint, whole), softness(joint, soft), strict=True
    ):
        if 0 < own < MAX_STIFFNESS_RATIO * left or (
            other is not None and not joint.held_by_others and own > FREEDOM_FALL * fallen
        ):
            continue
        raise SceneError(
            f"{joint.family}: the intended motion '{motion.name}' is not the soft one{shape_phrase(joint)}"
            f": its stiffness {own:.3g} Nm (over the joint length) is not below {MAX_STIFFNESS_RATIO:g} of the softest "
            f"other, {left:.3g} Nm; declare the motion the leaf springs allow{'' if other is None else ', ' + other.words}."
        )
    if other is not None and not joint.held_by_others:
        declare = "declare it as an intended motion, " if len(joint.motions) < 2 else ""
        raise SceneError(
            f"{joint.family}: its leaf springs leave another motion free that is not declared{shape_phrase(joint)}: "
            f"{other.words}, {other.ratio:.3g} times the intended one (over the joint length); {declare}hold it by another "
            "leaf, or say held_by_others=True where the mechanism around the joint holds it."
        )


def shape_phrase(joint: Joint) -> str:
    """Words that name the shape of a joint, none where it has no parameters."""
    shape = ", ".join(f"{name} = {value:.4g}" for name, value in joint.shape().items())
    return f" in the shape {shape}" if shape else ""


def intended_stiffness(joint: Joint) -> float:
    """That of the stiffest intended motion at rest with all else free [Nm, over the joint length]."""
    return max(own for _, own, _ in softness(joint, rest_stiffness(soften_leaves(joint, 1.0))))


def softness(joint: Joint, stiffness: Array) -> list[tuple[Motion, float, float]]:
    """Every intended motion, its stiffness with all else free, and that of the softest of what is left [Nm].

    stiffness (6, 6): at rest, as of `rest_stiffness`.
    """
    flexible = np.linalg.inv(stiffness)
    left = np.linalg.eigvalsh(stiffness)[len(joint.motions)] if len(joint.motions) < 6 else np.inf
    return [
        (motion, 1.0 / float(axis @ flexible @ axis), float(left))
        for motion, axis in zip(joint.motions, _declared(joint), strict=True)
    ]


def _declared(joint: Joint) -> Array:
    """(m, 6): what each intended motion measures of displacement of B over the joint length and rotation."""
    rows = []
    for motion in joint.motions:
        axis = np.asarray(motion.axis, float)
        if motion.kind == "rotation":
            rows.append(np.concatenate([np.zeros(3), axis]))
            continue
        arm = np.zeros(3) if motion.point is None else np.subtract(motion.point, joint.pose_B)
        rows.append(np.concatenate([axis, np.cross(arm, axis) / joint.length]))
    return np.array(rows)


def undeclared_freedom(joint: DrawnJoint, whole: Array, soft: Array) -> Freedom | None:
    """The softest freedom of `joint` with its intended motions held, up to MAX_FREEDOM_RATIO times theirs; None without one.

    whole, soft (6, 6): its stiffness at rest, and that of the joint softened to SOFTENING_FACTOR.
    """
    held = null_space(_declared(joint))
    if held.shape[1] == 0:
        return None
    kept, fallen = (held.T @ K @ held for K in (whole, soft))
    falls, motions = eigh(kept, fallen)
    free = motions[:, falls > FREEDOM_FALL]
    if free.shape[1] == 0:
        return None
    basis, _ = np.linalg.qr(free)
    values, vectors = np.linalg.eigh(basis.T @ kept @ basis)
    own = max(stiff for _, stiff, _ in softness(joint, whole))
    if values[0] > MAX_FREEDOM_RATIO * own:
        return None
    direction = held @ basis @ vectors[:, 0]
    return Freedom(
        direction, float(values[0] / own), describe_soft_motion(joint, direction, float(values[0]))
    )


def describe_soft_motion(joint: Joint, direction: Array, stiffness: float) -> str:
    """A motion (6,) of B in words, a rotation about a line or a translation, with its stiffness [Nm over the length] as one
    of its own kind."""
    shift, turn = joint.length * direction[:3], direction[3:]
    if np.linalg.norm(turn) > 0.1:
        size = float(np.linalg.norm(turn))
        line = np.asarray(joint.pose_B) + np.cross(turn, shift) / size**2
        point = ", ".join(f"{v:.3g}" for v in np.where(np.abs(line) < 1e-6 * joint.length, 0.0, line))
        return f"a rotation about {_axis(turn)} through ({point}) m of {stiffness / size**2:.3g} Nm/rad"
    return f"a translation along {_axis(shift)} of {stiffness / float(shift @ shift):.3g} N/m"


def _axis(direction: Array) -> str:
    """x, y or z where a direction is one of them, else its components."""
    unit = direction / np.linalg.norm(direction)
    k = int(np.argmax(np.abs(unit)))
    if abs(unit[k]) > 1 - 1e-6:
        return "xyz"[k]
    return "(" + ", ".join(f"{v:g}" for v in np.round(unit * np.sign(unit[k]), 3) + 0.0) + ")"
