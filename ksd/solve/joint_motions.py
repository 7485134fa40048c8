"""Where the joints of an answer are: their intended motions, what is left beside them, and what is not known of them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ksd.bodies.joints import JointBodies, joint_bodies
from ksd.errors import KsdError
from ksd.library import Record
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.solve.five_steps import read_joint_motions
from ksd.solve.joint_range import motion_limits


class JointMotions(NamedTuple):
    """Intended motions theta (q,) [rad, or stroke over joint length] and what is left, off (J, 6) [m, rad], of all joints.

    motions, joints: their names; scale (q,): from theta to rad or m. unknown: motions that are not known, nan, a sentence
    each.
    """

    motions: tuple[str, ...]
    joints: tuple[str, ...]
    scale: np.ndarray
    theta: np.ndarray
    off: np.ndarray
    unknown: tuple[str, ...] = ()

    def by_motion(self) -> dict[str, float]:
        """Intended motion [rad or m] by name."""
        return dict(zip(self.motions, (self.theta * self.scale).tolist(), strict=True))

    def by_joint(self) -> dict[str, np.ndarray]:
        """(6,) displacement [m] and rotation [rad] of interface B off its intended pose, by joint."""
        return dict(zip(self.joints, self.off, strict=True))


def checked_joint_motions(
    bodies: JointBodies,
    names: tuple[str, ...],
    theta: np.ndarray,
    off: np.ndarray,
    found: np.ndarray,
    *,
    near_intended: bool,
) -> JointMotions:
    """Intended motion of every joint, by `names`, what is left, and what is not known, in words.

    theta (q,), off (J, 6) and found (J,) as of `ksd.bodies.intended_motions.intended_motions`; they are changed where a
    motion was not found or lies far outside its trained range: nan, and a sentence. intended: it was seen that there is
    none such.
    """
    unknown = []
    if not near_intended:
        _, _, low, high = motion_limits(bodies.motion_range).T
        inside, first = (theta >= low) & (theta <= high), bodies.kinematics.first
        for j, name in enumerate(names):
            own = slice(first[j], first[j + 1])
            if found[j] and inside[own].all():
                continue
            theta[own], off[j] = math.nan, math.nan
            why = "lies far outside its trained range" if found[j] else "was not found"
            unknown.append(
                f"the intended motion of joint '{name}' is not known: the one nearest to its pose {why}"
            )
    return JointMotions(bodies.motion_names, names, bodies.motion_scale, theta, off, tuple(unknown))


@dataclass(frozen=True, eq=False)
class JointMotionReader:
    """Where the joints of states of one model are, from their kinematics alone; call it with a state of the full model.

    Records are read when it is first called.
    """

    model: Model
    records: Callable[[str], Record]
    extrapolate: bool

    @cached_property
    def _bodies(self) -> JointBodies | None:
        """The joints; None where a record is missing or does not fit."""
        try:
            return joint_bodies(self.model, self.records, extrapolate=self.extrapolate)
        except KsdError:
            return None

    def __call__(self, motion: State) -> JointMotions | None:
        """As `checked_joint_motions`; None where the records of the joints are not there, or do not fit.

        Unintended: (6,) per joint, displacement [m] and rotation vector [rad] in the axes of interface A. Both are nan for
        a joint whose nearest intended motion was not found, or lies far outside its trained range.
        """
        bodies = self._bodies
        if bodies is None:
            return None
        loops, limits = bodies.kinematics, motion_limits(bodies.motion_range)
        joints, start, found = len(loops.node), np.zeros(len(limits)), np.zeros(len(limits))
        off, known, seen = np.zeros((joints, 6)), np.zeros(joints, np.int64), np.zeros(2, np.int64)
        read_joint_motions(
            *loops.flat, motion.x, motion.R, start, found, np.zeros((joints, 12)), np.zeros((joints, 24)),
            np.zeros((3, loops.pose.shape[2])), off, known, limits, seen,
        )  # fmt: skip
        names = tuple(placed.name for placed in self.model.scene.joints)
        return checked_joint_motions(bodies, names, found, off, known, near_intended=bool(seen[1]))
