"""The five steps of the KSD method, each one or two compiled calls on a prepared storage (`FiveStepsStorage`).

1 close the loops by intended motions, 2 condense the joints at them, 3 equilibrium of links and condensed joints, 4 recover
the joints' substructures, 5 equilibrium of the full model.
"""

from __future__ import annotations

import math
import time
from copy import copy
from dataclasses import replace

import numpy as np

from ksd.joints.drive_forces import drive_forces
from ksd.joints.intended_motions import intended_motions
from ksd.joints.joint_arrays import JOINT_COUNT, JOINT_LENGTH
from ksd.joints.joint_weight import gravity_in_joint_axes, place_joint_weights
from ksd.joints.joints import JointBodies, place_leaf_links
from ksd.joints.kinematics import close_loops
from ksd.joints.substructures import (
    condense_joints,
    interface_step,
    join_states,
    relative_poses,
    set_near_configuration,
)
from ksd.model.arrays import make_workspace
from ksd.model.compile import Model
from ksd.model.newton import RTOL, assemble, solve_equilibrium, take_step
from ksd.numerics.kernel import kernel
from ksd.solvers.joint_range import check_joints, is_outside, motion_limits
from ksd.solvers.steps import MAX_TURN_PER_STEP, Step, Stop

MAX_REDUCED_ITERATIONS = 25
MAX_FULL_ITERATIONS = 30
"""Newton iterations of steps 3 and 5."""


class FiveStepsStorage:
    """What the five steps of one model read and write, for repeated solves; not for two threads at once.

    reduced_state: links and condensed joints; substructure_state: joints, each in the axes of its interface A; full_state.
    theta (q,): intended motions of step 1; joint_pose (J, 24): interface B in the axes of A at theta, with derivatives;
    relative_pose (J, 12): the same of the result; series (3, M): scratch. answer_theta (q,), unintended (J, 6), is_known
    (J,): intended motions of the result, what they leave, and 1 where they were found (`ksd.joints.intended_motions`).
    limits (q, 4), checks (2,): see `ksd.solvers.joint_range`.
    """

    def __init__(self, model: Model, bodies: JointBodies) -> None:
        joints, motions = len(bodies.kinematics.node), len(bodies.motion_names)
        self.theta, self.answer_theta = np.zeros(motions), np.zeros(motions)
        self.joint_pose, self.relative_pose = np.zeros((joints, 24)), np.zeros((joints, 12))
        self.series = np.zeros((3, bodies.kinematics.pose.shape[2]))
        self.unintended, self.is_known = np.zeros((joints, 6)), np.zeros(joints, np.int64)
        self.limits, self.checks = motion_limits(bodies.motion_range), np.zeros(2, np.int64)
        self.joint_names = tuple(p.name for p in model.scene.joints)
        self.substructure_state, self.reduced_state = (
            bodies.substructure_rest.copy(),
            bodies.reduced_rest.copy(),
        )
        self.full_state = model.rest.copy()
        self.substructure_work = make_workspace(bodies.substructures, near=bodies.near_lengths)
        self.reduced_work, self.full_work = make_workspace(bodies.reduced), make_workspace(model.arrays)
        self._set_design(model, bodies)

    def for_design(self, model: Model, bodies: JointBodies) -> FiveStepsStorage:
        """The same arrays for a design with the same structure; only one of the two can be in use at a time."""
        made = copy(self)
        made.full_state.assign(model.rest)
        made.substructure_work.weight[...] = bodies.substructures.weight
        made.reduced_work.weight[...] = bodies.reduced.weight
        made.full_work.weight[...] = model.arrays.weight
        made._set_design(model, bodies)
        return made

    def _set_design(self, model: Model, bodies: JointBodies) -> None:
        """Set the design that the arrays are used for."""
        if len(bodies.joint_weights.owner):
            # step 2 writes the points where joint weights act, so every storage needs its own copy
            bodies = replace(bodies, reduced=bodies.reduced.copy())
        self.model, self.bodies = model, bodies

    def restart(self) -> None:
        """Return to the undeformed configuration, in place."""
        self.reduced_state.assign(self.bodies.reduced_rest)
        self.substructure_state.assign(self.bodies.substructure_rest)
        self.theta[:] = 0.0


def close_joints(b: FiveStepsStorage, target: np.ndarray) -> tuple[int, int, float]:
    """Step 1 from the present motions theta; also places links that only leaves hold. Returns (stop reason, iterations, gap
    [m])."""
    found: tuple[int, int, float] = close_loops(
        *b.bodies.reduced.flat[:2], *b.bodies.kinematics.flat, b.theta, target, b.reduced_state.x, b.reduced_state.R,
        b.reduced_state.angle, b.joint_pose,
    )  # fmt: skip
    if b.bodies.leaf_links:
        place_leaf_links(b.bodies, b.reduced_state)
    return found


def assemble_full_state(b: FiveStepsStorage) -> None:
    """Write links, internal blocks, inner states and multipliers into the full state."""
    bodies, blocks = b.bodies, b.substructure_state
    join_states(
        *bodies.kinematics.flat, bodies.interior.flat.ints, bodies.full_node, blocks.x, blocks.R, blocks.inner,
        *b.reduced_state, *b.full_state,
    )  # fmt: skip


def kinematic_forces(b: FiveStepsStorage, target: np.ndarray) -> None:
    """Write the drive forces of the kinematic method into the multipliers, by virtual work.

    The loop and drive equations balance the joints' moments in pure intended motion (wrench F of the condensed joints along
    the motion) and the external loads.
    """
    reduced = b.reduced_state
    drive_forces(
        *b.bodies.reduced.flat[:2], *b.bodies.kinematics.flat, b.theta, target, reduced.x.copy(), reduced.R.copy(),
        reduced.angle.copy(), b.joint_pose, reduced.inner, reduced.multiplier,
    )  # fmt: skip
    b.full_state.multiplier[:] = reduced.multiplier


def set_linearisation_point(b: FiveStepsStorage) -> None:
    """Step 2, first half: put all substructures where their intended motions lead, to linearise them there."""
    state = b.substructure_state
    set_near_configuration(
        *b.bodies.kinematics.flat, *b.bodies.interior.flat, b.theta, b.joint_pose, state.x, state.R, state.inner,
        b.substructure_work.linearisation,
    )  # fmt: skip


def condense_joint_bodies(b: FiveStepsStorage, near: int) -> int:
    """Step 2, second half: condense the joints to their interfaces. Returns the worst status of a leaf.

    near: see `ksd.model.newton.assemble`.
    """
    loops, weights = b.bodies.kinematics, b.bodies.joint_weights
    substructures, work = b.bodies.substructures, b.substructure_work
    members = substructures.members
    if len(weights.owner):
        gravity_in_joint_axes(
            weights.owner, loops.node, b.reduced_state.R, loops.frame, substructures.weight, work.weight
        )
    motion = b.substructure_state
    *_, status = assemble(substructures, motion, np.zeros(0), 1.0, work, linearise=near)
    condense_joints(substructures, len(loops.node), motion, work, b.reduced_state.inner)
    if len(weights.owner):
        place_joint_weights(
            weights.owner, weights.load, members.node, members.store_at, b.substructure_state.x, work.pose, work.store,
            work.weight, loops.anchor, loops.frame, b.bodies.reduced.loads.point,
        )  # fmt: skip
    return status


def recover_substructures(b: FiveStepsStorage) -> tuple[float, float]:
    """Step 4: recover the joints. Returns the largest unintended displacement [m] and rotation [rad] of an interface B."""
    substructures, state, work = b.bodies.substructures, b.substructure_state, b.substructure_work
    largest = interface_step(
        substructures, b.bodies.kinematics, b.reduced_state, state, work, b.relative_pose
    )
    take_step(substructures, state, work.rhs, work, 1.0)
    return largest


@kernel
def read_joint_motions(
    loops,
    shapes,
    x,
    R,
    theta,
    answer_theta,
    relative_pose,
    joint_pose,
    series,
    unintended,
    is_known,
    limits,
    checks,
):
    """Find the intended motions answer_theta (q,) of all joints with the links at x, R, from the initial guess theta (q,).

    loops, shapes: see `ksd.joints.joint_arrays`; other arrays: see `FiveStepsStorage`.
    """
    relative_poses(loops, shapes, x, R, relative_pose)
    for q in range(len(theta)):
        answer_theta[q] = theta[q]
    intended_motions(loops, shapes, relative_pose, answer_theta, joint_pose, series, unintended, is_known)
    length = shapes[loops[JOINT_LENGTH] : loops[JOINT_LENGTH] + loops[JOINT_COUNT]]
    check_joints(theta, answer_theta, unintended, is_known, limits, length, checks)


def read_answer_motions(b: FiveStepsStorage) -> None:
    """Find the intended motions of the full state, and check them."""
    read_joint_motions(
        *b.bodies.kinematics.flat, b.full_state.x, b.full_state.R, b.theta, b.answer_theta, b.relative_pose, b.joint_pose,
        b.series, b.unintended, b.is_known, b.limits, b.checks,
    )  # fmt: skip


class _Recorder:
    """Collects the steps of a solve with their thread times."""

    def __init__(self) -> None:
        self.steps: list[Step] = []
        self._time_ns = time.thread_time_ns()

    def add(self, name: str, stop: int, iterations: int, residual: float, note: str = "") -> None:
        """Add the step that has just ended."""
        before, self._time_ns = self._time_ns, time.thread_time_ns()
        elapsed = 1e-9 * (self._time_ns - before)
        self.steps.append(Step(name, int(iterations), elapsed, residual, Stop(stop), note))


def _reduce(
    b: FiveStepsStorage, target: np.ndarray, relinearisations: int, kinematic: bool, record: _Recorder
) -> tuple[int, bool]:
    """Steps 2 to 4 from closed loops, with relinearisation steps; kinematic: step 2 alone.

    Returns (negative pivots, whether every step converged).
    """
    negatives = 0
    set_linearisation_point(b)
    for n in range(relinearisations + 1):
        status = condense_joint_bodies(b, 1 if n == 0 else 0)
        # the status of leaves is 1 for a local angle, 2 for a singular matrix
        record.add("2 joint stiffness", status + (status > 0), 0, 0.0)
        if status != 0 or kinematic:
            return negatives, status == 0
        reason, count, worst, negatives, _ = solve_equilibrium(
            b.bodies.reduced,
            b.reduced_state,
            target,
            1.0,
            b.reduced_work,
            RTOL,
            MAX_REDUCED_ITERATIONS,
            math.inf,
            math.inf,
        )
        record.add("3 reduced equilibrium", reason, count, worst)
        if reason != 0:
            return negatives, False
        shift, twist = recover_substructures(b)
        if n == relinearisations:
            assemble_full_state(b)
        record.add("4 recovery", 0, 0, 0.0, f"moved {shift:.1e} m, {twist:.1e} rad")
    return negatives, True


def full_equilibrium_step(b: FiveStepsStorage, target: np.ndarray) -> tuple[Step, int]:
    """Step 5 from the full state in storage, in place: the step, without its time, and the negative pivots."""
    reason, count, worst, negatives, _ = solve_equilibrium(
        b.model.arrays, b.full_state, target, 1.0, b.full_work, RTOL, MAX_FULL_ITERATIONS, MAX_TURN_PER_STEP, math.inf
    )  # fmt: skip
    return Step("5 full equilibrium", int(count), 0.0, worst, Stop(reason)), int(negatives)


def run_five_steps(
    b: FiveStepsStorage,
    target: np.ndarray,
    method: str,
    relinearisations: int,
    gap: float,
    limits: np.ndarray,
    *,
    closed: bool = False,
) -> tuple[list[Step], int]:
    """Take the steps of `method` at drive values target (c,): "kinematic" 1 and 2, "reduced" 1 to 4, "full" all five.

    gap: largest loop gap over the size at which step 1 counts as closed; closed: the storage holds closed loops already;
    limits (q, ..): motions in its first two columns, beyond which no step is taken after the first.
    Returns the steps taken, and the negative pivots of the last equilibrium. `read_answer_motions` reads the joints of the
    state, which is in storage.
    """
    record = _Recorder()
    if not closed:
        b.restart()
        reason, count, open_gap = close_joints(b, target)
        record.add("1 close loops", reason, count, open_gap, f"gap {open_gap:.1e} m")
        if reason != 0 or not open_gap < gap * b.bodies.reduced.size:
            return record.steps, 0
    if is_outside(b.theta, limits, 0):
        return record.steps, 0
    negatives, converged = _reduce(b, target, relinearisations, method == "kinematic", record)
    if not converged:
        return record.steps, negatives
    if method == "kinematic":
        assemble_full_state(b)
    if method == "full":
        step, negatives = full_equilibrium_step(b, target)
        record.add(step.name, step.stop, step.iterations, step.residual)
    return record.steps, negatives
