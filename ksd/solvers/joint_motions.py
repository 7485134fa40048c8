"""Intended motions of the joints of a result, what they leave unintended, and for which joints they are not known."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ksd.errors import KsdError
from ksd.joints.joints import JointBodies, joint_bodies
from ksd.library import Record
from ksd.model.arrays import State
from ksd.model.compile import Model
from ksd.solvers.five_steps import FiveStepsStorage, read_joint_motions
from ksd.solvers.joint_range import motion_limits


class JointMotions(NamedTuple):
    """Intended motions theta (q,) [rad, or stroke over joint length] of all joints, and unintended (J, 6): displacement [m]
    and rotation vector [rad] of interface B off its intended pose, in joint axes.

    motions, joints: names; scale (q,): from theta to rad or m; unknown: a sentence for every joint whose motion is not
    known, which is nan.
    """

    motions: tuple[str, ...]
    joints: tuple[str, ...]
    scale: np.ndarray
    theta: np.ndarray
    unintended: np.ndarray
    unknown: tuple[str, ...] = ()

    def by_motion(self) -> dict[str, float]:
        """Intended motion [rad or m] by name."""
        return dict(zip(self.motions, (self.theta * self.scale).tolist(), strict=True))

    def by_joint(self) -> dict[str, np.ndarray]:
        """Unintended displacement [m] and rotation [rad] (6,) by joint."""
        return dict(zip(self.joints, self.unintended, strict=True))


def checked_joint_motions(
    bodies: JointBodies,
    names: tuple[str, ...],
    theta: np.ndarray,
    unintended: np.ndarray,
    is_known: np.ndarray,
    *,
    near_intended: bool,
) -> JointMotions:
    """Joint motions, with nan and a sentence for every joint whose motion was not found or is far outside its trained range.

    names: of the joints; theta (q,), unintended (J, 6), is_known (J,): see `FiveStepsStorage`; the first two are changed in
    place. near_intended: it is known already that there is no such joint.
    """
    unknown = []
    if not near_intended:
        _, _, low, high = motion_limits(bodies.motion_range).T
        inside, first = (theta >= low) & (theta <= high), bodies.kinematics.first
        for j, name in enumerate(names):
            own = slice(first[j], first[j + 1])
            if is_known[j] and inside[own].all():
                continue
            theta[own], unintended[j] = math.nan, math.nan
            why = "lies far outside its trained range" if is_known[j] else "was not found"
            unknown.append(
                f"the intended motion of joint '{name}' is not known: the one nearest to its pose {why}"
            )
    return JointMotions(bodies.motion_names, names, bodies.motion_scale, theta, unintended, tuple(unknown))


def stored_joint_motions(b: FiveStepsStorage) -> JointMotions:
    """Joint motions of the result in storage."""
    return checked_joint_motions(
        b.bodies, b.joint_names, b.answer_theta.copy(), b.unintended.copy(), b.is_known,
        near_intended=bool(b.checks[1]),
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class JointMotionReader:
    """Finds the joint motions of full states of one model from the kinematics of its joints; call it with a state.

    Records are read at the first call.
    """

    model: Model
    records: Callable[[str], Record]
    extrapolate: bool

    @cached_property
    def _bodies(self) -> JointBodies | None:
        """The joint bodies; None where a record is missing or does not fit."""
        try:
            return joint_bodies(self.model, self.records, extrapolate=self.extrapolate)
        except KsdError:
            return None

    def __call__(self, motion: State) -> JointMotions | None:
        """Joint motions of a state (`checked_joint_motions`); None where a record is missing or does not fit."""
        bodies = self._bodies
        if bodies is None:
            return None
        loops, limits = bodies.kinematics, motion_limits(bodies.motion_range)
        joints, initial, theta = len(loops.node), np.zeros(len(limits)), np.zeros(len(limits))
        unintended, is_known, checks = (
            np.zeros((joints, 6)),
            np.zeros(joints, np.int64),
            np.zeros(2, np.int64),
        )
        read_joint_motions(
            *loops.flat, motion.x, motion.R, initial, theta, np.zeros((joints, 12)), np.zeros((joints, 24)),
            np.zeros((3, loops.pose.shape[2])), unintended, is_known, limits, checks,
        )  # fmt: skip
        names = tuple(placed.name for placed in self.model.scene.joints)
        return checked_joint_motions(
            bodies, names, theta, unintended, is_known, near_intended=bool(checks[1])
        )
