"""Around the compiled five steps: step 1 along the drive, forces of a kinematic answer, error estimates.

The steps of the KSD method (paper 1, section 2) themselves are in `ksd.solve.space_steps`:
1 close the loops by the database constraints; 2 near configuration and condensed stiffness of every joint; 3 equilibrium
of links and condensed joints; 4 recovery of the insides; 5 equilibrium of everything. `relinearisations` extra rounds of 2-4
relinearise every joint, geometric stiffness included, at the state recovered before.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ksd.bodies.joints import JointBodies, JointLoops, joint_loops
from ksd.bodies.readout import drive_forces
from ksd.errors import KsdError
from ksd.library import Record
from ksd.model.arrays import Motion
from ksd.model.compile import Model
from ksd.numerics.stopwatch import Stopwatch
from ksd.solve.joint_range import motion_limits
from ksd.solve.space_steps import FiveStepsStorage, close_joints, read_joints
from ksd.solve.steps import JointMotions, Step, Stop


def close(b: FiveStepsStorage, target: np.ndarray) -> Step:
    """Step 1: intended motions and link poses, from the constraint functions alone."""
    clock = Stopwatch()
    reason, count, gap = close_joints(b, target)
    return Step("1 close loops", count, clock(), gap, Stop(reason), note=f"gap {gap:.1e} m")


def kinematic_forces(b: FiveStepsStorage, target: np.ndarray) -> None:
    """Drive forces of the kinematic answer by virtual work, into the multipliers.

    The joints' moments in pure intended motion (wrench F of the condensed joints along the motion) and the external
    loads are balanced by the loop and drive equations.
    """
    reduced = b.reduced
    drive_forces(
        *b.bodies.reduced.flat[:2], *b.bodies.loops.flat, b.theta, target, reduced.x.copy(), reduced.R.copy(), b.place,
        reduced.inner, reduced.multiplier,
    )  # fmt: skip
    b.full.multiplier[:] = reduced.multiplier


def read_motions(
    bodies: JointBodies | JointLoops,
    names: tuple[str, ...],
    theta: np.ndarray,
    off: np.ndarray,
    found: np.ndarray,
    *,
    intended: bool,
) -> JointMotions:
    """Intended motion of every joint, by `names`, what is left, and what is not known, in words.

    theta (q,), off (J, 6) and found (J,) as of `ksd.bodies.readout.intended_motions`; they are changed where a motion
    was not found or lies far outside its trained range: nan, and a sentence. intended: it was seen that there is none such.
    """
    unknown = []
    if not intended:
        _, _, low, high = motion_limits(bodies.motion_range).T
        inside, first = (theta >= low) & (theta <= high), bodies.loops.first
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
class JointReader:
    """Where the joints of states of one model are, from their kinematics alone; call it with a state of the full model.

    Records are read when it is first called.
    """

    model: Model
    records: Callable[[str], Record]
    extrapolate: bool

    @cached_property
    def _loops(self) -> JointLoops | None:
        """The kinematics of the joints; None where a record is missing or does not fit."""
        try:
            return joint_loops(self.model, self.records, extrapolate=self.extrapolate)
        except KsdError:
            return None

    def __call__(self, motion: Motion) -> JointMotions | None:
        """As `read_motions`; None where the records of the joints are not there, or do not fit.

        Unintended: (6,) per joint, displacement [m] and rotation vector [rad] in the axes of interface A. Both are nan for
        a joint whose nearest intended motion was not found, or lies far outside its trained range.
        """
        if self._loops is None:
            return None
        loops, limits = self._loops.loops, motion_limits(self._loops.motion_range)
        joints, start, found = len(loops.node), np.zeros(len(limits)), np.zeros(len(limits))
        off, known, seen = np.zeros((joints, 6)), np.zeros(joints, np.int64), np.zeros(2, np.int64)
        read_joints(
            *loops.flat, motion.x, motion.R, start, found, np.zeros((joints, 12)), np.zeros((joints, 24)),
            np.zeros((3, loops.pose.shape[2])), off, known, limits, seen,
        )  # fmt: skip
        names = tuple(placed.name for placed in self.model.scene.joints)
        return read_motions(self._loops, names, found, off, known, intended=bool(seen[1]))
