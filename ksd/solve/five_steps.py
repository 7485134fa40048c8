"""The five steps in space, one compiled call or two for each; storage is prepared once (`FiveStepsStorage`)."""

from __future__ import annotations

import math
import time
from copy import copy
from dataclasses import replace

import numpy as np

from ksd.bodies.drive_forces import drive_forces
from ksd.bodies.intended_motions import intended_motions
from ksd.bodies.joint_arrays import JOINT_COUNT, JOINT_LENGTH
from ksd.bodies.joints import JointBodies, place_leaf_links
from ksd.bodies.kinematics import close_loops
from ksd.bodies.substructures import (
    condense_joints,
    interface_step,
    place_internal_blocks,
    relative_poses,
    set_near_configuration,
)
from ksd.bodies.weight import gravity_in_joint_axes, place_joint_weights
from ksd.model.arrays import flatten_arrays, make_workspace, unflatten_arrays
from ksd.model.compile import Model
from ksd.model.newton import solve_equilibrium, take_step
from ksd.numerics.kernel import kernel
from ksd.solve.joint_range import check_joints, motion_limits
from ksd.solve.steps import MAX_TURN_PER_STEP, RTOL, StepRow

KINEMATIC, REDUCED, FULL = 0, 1, 2
LINEAR_SIZE = 54
MAX_CLOSURE_ITERATIONS = 40
"""Iterations of step 1 at the most."""


class FiveStepsStorage:
    """Storage for repeated solves of one model in space: what the five steps read and write. Not for two threads at once.

    theta (q,), place (J, 24), relative (J, 12), series (3, M): of the joints; found (q,), off (J, 6), known (J,): intended
    motions of the answer and what is left, see `ksd.bodies.intended_motions.intended_motions`; limits (q, 4), seen (2,): see
    `ksd.solve.joint_range`; lowest, highest (q,): trained ranges with their slack. substructures, reduced, full: states.
    """

    def __init__(self, model: Model, bodies: JointBodies) -> None:
        joints, motions = len(bodies.kinematics.node), len(bodies.motion_names)
        self.theta, self.place, self.relative = (
            np.zeros(motions),
            np.zeros((joints, 24)),
            np.zeros((joints, 12)),
        )
        self.series = np.zeros((3, bodies.kinematics.pose.shape[2]))
        self.found, self.off, self.known = (
            np.zeros(motions),
            np.zeros((joints, 6)),
            np.zeros(joints, np.int64),
        )
        self.limits, self.seen = motion_limits(bodies.motion_range), np.zeros(2, np.int64)
        self.lowest, self.highest, _, _ = self.limits.T
        self.joint_names = tuple(p.name for p in model.scene.joints)
        self.substructures, self.reduced = bodies.substructure_rest.copy(), bodies.reduced_rest.copy()
        self.full = model.rest.copy()
        self.substructure_work = make_workspace(bodies.substructures, near=bodies.near_lengths)
        self.reduced_work, self.full_work = make_workspace(bodies.reduced), make_workspace(model.arrays)
        self._hold(model, bodies)

    def of(self, model: Model, bodies: JointBodies) -> FiveStepsStorage:
        """The same arrays for a design of the same words: only one of both can be used at a time."""
        made = copy(self)
        made.full.assign(model.rest)
        made.substructure_work.weight[...] = bodies.substructures.weight
        made.reduced_work.weight[...] = bodies.reduced.weight
        made.full_work.weight[...] = model.arrays.weight
        made._hold(model, bodies)
        return made

    def _hold(self, model: Model, bodies: JointBodies) -> None:
        """Be of this design."""
        if len(bodies.joint_weights.owner):
            # step 2 sets where the weight of the joints pulls; another thread has its own
            bodies = replace(bodies, reduced=unflatten_arrays(flatten_arrays(bodies.reduced)))
        self.model, self.bodies = model, bodies

    def restart(self) -> None:
        """Back to rest, in place."""
        self.reduced.assign(self.bodies.reduced_rest)
        self.substructures.assign(self.bodies.substructure_rest)
        self.theta[:] = 0.0


def close_joints(b: FiveStepsStorage, target: np.ndarray) -> tuple[int, int, float]:
    """Step 1 from where the joints are, and links that hang on leaves alone. Returns (reason, iterations, gap left [m])."""
    found = close_loops(
        b.bodies.reduced, b.bodies.kinematics, b.theta, target, b.reduced, b.place, MAX_CLOSURE_ITERATIONS
    )
    if b.bodies.leaf_links:
        place_leaf_links(b.bodies, b.reduced)
    return found


def assemble_full_state(b: FiveStepsStorage) -> None:
    """Links, internal blocks, inner states and multipliers into the full state."""
    bodies, full, reduced, substructures = b.bodies, b.full, b.reduced, b.substructures
    links, inner = len(reduced.x), len(substructures.inner)
    full.x[:links], full.R[:links] = reduced.x, reduced.R
    free = reduced.inner[LINEAR_SIZE * len(bodies.kinematics.node) :]
    full.inner[:inner], full.inner[inner : inner + len(free)] = substructures.inner, free
    full.multiplier[:] = reduced.multiplier
    place_internal_blocks(
        *bodies.kinematics.flat, bodies.interior.flat.ints, bodies.full_node, substructures.x, substructures.R,
        full.x, full.R,
    )  # fmt: skip


def kinematic_forces(b: FiveStepsStorage, target: np.ndarray) -> None:
    """Drive forces of the kinematic answer by virtual work, into the multipliers.

    The joints' moments in pure intended motion (wrench F of the condensed joints along the motion) and the external
    loads are balanced by the loop and drive equations.
    """
    reduced = b.reduced
    drive_forces(
        *b.bodies.reduced.flat[:2], *b.bodies.kinematics.flat, b.theta, target, reduced.x.copy(), reduced.R.copy(), b.place,
        reduced.inner, reduced.multiplier,
    )  # fmt: skip
    b.full.multiplier[:] = reduced.multiplier


def set_linearisation_point(b: FiveStepsStorage) -> None:
    """Step 2, first half: the near configuration of all joints."""
    set_near_configuration(
        b.bodies.kinematics, b.bodies.interior, b.theta, b.place, b.substructures, b.substructure_work
    )


def condense_joint_bodies(b: FiveStepsStorage, near: int) -> int:
    """Step 2, second half: the joints condensed. Returns the worst status of a leaf."""
    loops, hung, substructures, work = (
        b.bodies.kinematics,
        b.bodies.joint_weights,
        b.bodies.substructures,
        b.substructure_work,
    )
    members = substructures.members
    if len(hung.owner):
        gravity_in_joint_axes(
            hung.owner, loops.node, b.reduced.R, loops.frame, substructures.weight, work.weight
        )
    status = condense_joints(substructures, len(loops.node), b.substructures, work, near, b.reduced.inner)
    if len(hung.owner):
        place_joint_weights(
            hung.owner, hung.load, members.node, members.store_at, b.substructures.x, work.pose, work.store,
            work.weight, loops.anchor, loops.frame, b.bodies.reduced.loads.point,
        )  # fmt: skip
    return status


def recover_substructures(b: FiveStepsStorage) -> tuple[float, float]:
    """Step 4. Returns the largest displacement [m] and rotation [rad] of an interface off its near pose."""
    inside, state, work = b.bodies.substructures, b.substructures, b.substructure_work
    unintended = interface_step(inside, b.bodies.kinematics, b.reduced, state, work, b.relative)
    take_step(inside, state, work.rhs, work, 1.0)
    return unintended


@kernel
def read_joint_motions(loops, shapes, x, R, theta, found, relative, place, series, off, known, limits, seen):
    """Intended motions found (q,) of all joints where links are at x, R, their search begun at theta (q,); loops, shapes: as
    in `ksd.bodies.joint_arrays`; the rest as in `FiveStepsStorage`."""
    relative_poses(loops, shapes, x, R, relative)
    for q in range(len(theta)):
        found[q] = theta[q]
    intended_motions(loops, shapes, relative, found, place, series, off, known)
    length = shapes[loops[JOINT_LENGTH] : loops[JOINT_LENGTH] + loops[JOINT_COUNT]]
    # a variable, not the literal 3
    check_joints(theta, found, off, known, 3 + 0 * len(theta), limits, length, seen)


def read_answer_motions(b: FiveStepsStorage) -> None:
    """Intended motions of the answer."""
    read_joint_motions(
        *b.bodies.kinematics.flat, b.full.x, b.full.R, b.theta, b.found, b.relative, b.place, b.series, b.off, b.known,
        b.limits, b.seen,
    )  # fmt: skip


class _Recorder:
    """Collects the rows of a solve and the thread time of each step."""

    def __init__(self) -> None:
        self.rows: list[StepRow] = []
        self._time_ns = time.thread_time_ns()

    def add(self, stop: int, iterations: int, residual: float, rotation: float = 0.0) -> None:
        """Add the row of the step that has just ended."""
        before, self._time_ns = self._time_ns, time.thread_time_ns()
        self.rows.append(StepRow(stop, iterations, residual, 1e-9 * (self._time_ns - before), rotation))


def _reduce(
    b: FiveStepsStorage, target: np.ndarray, relinearisations: int, kinematic: bool, record: _Recorder
) -> tuple[int, bool]:
    """Steps 2 to 4 from the closed loops on, with `relinearisations` relinearised rounds; kinematic: step 2 alone.

    Returns (negative pivots, whether all went well).
    """
    negatives = 0
    set_linearisation_point(b)
    for n in range(relinearisations + 1):
        status = condense_joint_bodies(b, 1 if n == 0 else 0)
        # stops of leaves: 1 a local angle, 2 singular
        record.add(status + (status > 0), 0, 0.0)
        if status != 0 or kinematic:
            return negatives, status == 0
        reason, count, worst, negatives, _ = solve_equilibrium(
            b.bodies.reduced, b.reduced, target, 1.0, b.reduced_work, RTOL, 25, math.inf, math.inf
        )
        record.add(reason, count, worst)
        if reason != 0:
            return negatives, False
        shift, twist = recover_substructures(b)
        if n == relinearisations:
            assemble_full_state(b)
        record.add(0, 0, shift, twist)
    return negatives, True


def run_five_steps(
    b: FiveStepsStorage,
    target: np.ndarray,
    method: int,
    relinearisations: int,
    gap: float,
    *,
    closed: bool = False,
) -> tuple[list[StepRow], int]:
    """Steps 1 to 4, and 5 when `method` is FULL, at the drive values target (c,).

    gap: largest one of the closed loops over the size; closed: step 1 is done already, in the storage. Returns the rows of
    the steps done, and the negative pivots of the last equilibrium.
    """
    record = _Recorder()
    if not closed:
        b.restart()
        reason, count, left = close_joints(b, target)
        record.add(reason, count, left)
        if reason != 0 or not left < gap * b.bodies.reduced.size:
            return record.rows, 0
    negatives, sound = _reduce(b, target, relinearisations, method == KINEMATIC, record)
    if not sound:
        return record.rows, negatives
    if method == KINEMATIC:
        assemble_full_state(b)
    if method == FULL:
        reason, count, worst, negatives, _ = solve_equilibrium(
            b.model.arrays, b.full, target, 1.0, b.full_work, RTOL, 30, MAX_TURN_PER_STEP, math.inf
        )
        record.add(reason, count, worst)
    read_answer_motions(b)
    return record.rows, negatives
