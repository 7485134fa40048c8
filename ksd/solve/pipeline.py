"""The five steps of the KSD method (paper 1, section 2), each one compiled call.

1 close the loops by the database constraints (`close_loops`); 2 near configuration and condensed stiffness of every
joint (`set_near`, `condense_joints`); 3 equilibrium of links and condensed joints (`iterate` on the reduced model);
4 recovery of the insides (`recover_joints`); 5 equilibrium of everything (`iterate` on the full model). `passes` extra
rounds of 2-4 relinearise every joint, geometric stiffness included, at the state recovered before.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np

from ksd.bodies.bench import condense_joints, place_insides, recover_joints, relative_poses, set_near
from ksd.bodies.joints import JointBodies, hang_links
from ksd.bodies.kinematics import close_loops
from ksd.bodies.readout import drive_forces, intended_motions
from ksd.model.arrays import Motion, Work, make_work
from ksd.model.compile import Model
from ksd.model.system import assemble, solve_step
from ksd.solve.configuration import ErrorEstimate, Step
from ksd.solve.newton import iterate
from ksd.solve.stops import Stop

FAR_OUT = 1.0
"""Distance from the middle of a trained range, over its width, beyond which its polynomials mean nothing."""


@dataclass
class Bench:
    """Storage of one thread for repeated solves of one model: every array the five steps write into."""

    model: Model
    bodies: JointBodies
    full: Motion
    full_work: Work
    reduced: Motion
    reduced_work: Work
    bench: Motion
    bench_work: Work
    theta: np.ndarray
    place: np.ndarray

    @classmethod
    def of(cls, model: Model, bodies: JointBodies) -> Bench:
        """Prepared storage for `model` with its joint `bodies`."""
        return cls(
            model,
            bodies,
            model.rest.copy(),
            make_work(model.arrays),
            bodies.reduced_rest.copy(),
            make_work(bodies.reduced),
            bodies.bench_rest.copy(),
            make_work(bodies.bench, near=bodies.near),
            np.zeros(len(bodies.motion_names)),
            np.zeros((len(bodies.loops.node), 24)),
        )

    def restart(self) -> None:
        """Back to rest, in place."""
        self.full.assign(self.model.rest)
        self.reduced.assign(self.bodies.reduced_rest)
        self.bench.assign(self.bodies.bench_rest)
        self.theta[:] = 0.0


class _Clock:
    """Thread time since the last call."""

    def __init__(self) -> None:
        self.at = time.thread_time_ns()

    def __call__(self) -> float:
        now = time.thread_time_ns()
        spent, self.at = (now - self.at) * 1e-9, now
        return spent


def close(b: Bench, target: np.ndarray, *, most: int = 40) -> Step:
    """Step 1: intended motions and link poses, from the constraint functions alone."""
    clock = _Clock()
    reason, count, gap, _ = close_loops(
        b.bodies.reduced, b.bodies.loops, b.theta, target, b.reduced, b.place, most
    )
    if b.bodies.hanging:
        hang_links(b.bodies, b.reduced)
    return Step("1 close loops", count, clock(), gap, Stop(reason), note=f"gap {gap:.1e} m")


def linearise(b: Bench, *, near: int, first: bool) -> Step:
    """Step 2: near configuration (first time) and stiffness of all joints, condensed to their interfaces.

    near: 0 exact tangent at the bench state, 1 the paper's element-orientation bodies, 2 those with geometric stiffness.
    """
    clock = _Clock()
    if first:
        set_near(b.bodies.bench, b.bodies.loops, b.bodies.inside, b.theta, b.place, b.bench, b.bench_work)
    joints = len(b.bodies.loops.node)
    _, _, status = condense_joints(b.bodies.bench, joints, b.bench, b.bench_work, near, b.reduced.inner)
    stop = (Stop.CONVERGED, Stop.LOCAL_ANGLE, Stop.SINGULAR)[status]
    return Step("2 joint stiffness", 0, clock(), 0.0, stop)


def reduced_equilibrium(
    b: Bench, target: np.ndarray, *, rtol: float, most: int, factor: float = 1.0
) -> tuple[Step, int]:
    """Step 3: equilibrium of the links on condensed joints; returns the step and its negative pivots."""
    clock = _Clock()
    reason, count, residual, negatives, _ = iterate(
        b.bodies.reduced, b.reduced, target, factor, b.reduced_work, rtol, most, math.inf, math.inf
    )
    return Step("3 reduced equilibrium", count, clock(), residual, Stop(reason)), negatives


def recover(b: Bench) -> Step:
    """Step 4: insides of all joints at the interface poses of step 3, and everything placed in the full model."""
    clock = _Clock()
    shift, twist = recover_joints(
        b.bodies.bench, b.bodies.reduced, len(b.bodies.loops.node), b.reduced, b.bench, b.bench_work
    )
    place_full(b)
    return Step("4 recovery", 0, clock(), 0.0, Stop.CONVERGED, note=f"moved {shift:.1e} m, {twist:.1e} rad")


def place_full(b: Bench) -> None:
    """Write links, internal blocks, inner states and multipliers into the full model's state."""
    links = b.model.links
    inner = len(b.bench.inner)
    b.full.x[:links] = b.reduced.x
    b.full.R[:links] = b.reduced.R
    b.full.inner[:inner] = b.bench.inner
    b.full.inner[inner:] = b.reduced.inner[54 * len(b.bodies.loops.node) :]
    b.full.multiplier[:] = b.reduced.multiplier
    inside = b.bodies.inside
    place_insides(b.bodies.loops, inside.block_joint, inside.block_node, b.bodies.full_node, b.bench, b.full)


def full_equilibrium(b: Bench, target: np.ndarray, *, rtol: float, most: int, cap: float) -> tuple[Step, int]:
    """Step 5: equilibrium of all nodes from the recovered state; the same function as the conventional solver."""
    clock = _Clock()
    reason, count, residual, negatives, _ = iterate(
        b.model.arrays, b.full, target, 1.0, b.full_work, rtol, most, cap, math.inf
    )
    return Step("5 full equilibrium", count, clock(), residual, Stop(reason)), negatives


def kinematic_forces(b: Bench, target: np.ndarray) -> None:
    """Drive forces of the kinematic answer by virtual work, into the multipliers.

    The joints' moments in pure intended motion (wrench F of the condensed joints along the motion) and the external
    loads are balanced by the loop and drive equations.
    """
    drive_forces(
        b.bodies.reduced,
        b.bodies.loops,
        b.theta,
        target,
        b.reduced.copy(),
        b.place,
        b.reduced.inner,
        b.reduced.multiplier,
    )


def corrector(b: Bench, target: np.ndarray, *, rtol: float) -> tuple[ErrorEstimate, Step, int]:
    """Error estimate: one Newton step of the full model from the recovered state, looked at and not taken."""
    clock = _Clock()
    arrays = b.model.arrays
    residual, _, inside, status = assemble(arrays, b.full, target, 1.0, b.full_work, rtol, 0, 10.0)
    negatives, _ = solve_step(arrays, b.full_work)
    step = b.full_work.rhs
    force = np.abs(step[arrays.terms.start])
    shift, turn = 0.0, 0.0
    for node in range(1, b.model.links):
        u = arrays.start[node]
        shift = max(shift, float(np.linalg.norm(step[u : u + 3])))
        turn = max(turn, float(np.linalg.norm(step[u + 3 : u + 6])))
    drives = len(b.model.drive_names)
    estimate = _estimate(b, b.full, force[:drives], shift, turn)
    stop = Stop.CONVERGED if status == 0 else (Stop.LOCAL_ANGLE if status == 1 else Stop.NOT_FINITE)
    return estimate, Step("error estimate", 1, clock(), residual, stop), negatives + inside


def _estimate(b: Bench, motion: Motion, force: np.ndarray, shift: float, turn: float) -> ErrorEstimate:
    """Absolute errors made relative: drive forces by their size, displacement by the largest link displacement."""
    links, drives = b.model.links, len(b.model.drive_names)
    moved = float(np.abs(motion.x[:links] - b.model.rest.x[:links]).max())
    scale = np.abs(motion.multiplier[:drives])
    of_force = float((force / np.maximum(scale, max(scale.max(initial=0.0), 1e-300))).max(initial=0.0))
    relative = max(of_force, shift / max(moved, 1e-300))
    return ErrorEstimate(force.copy(), shift, turn, relative if math.isfinite(relative) else math.inf)


def distance(motion: Motion, b: Bench, rest: ErrorEstimate) -> ErrorEstimate:
    """Distance of a state to the one on the bench, plus the estimate `rest` of the latter's own error."""
    from scipy.spatial.transform import Rotation

    links, drives = b.model.links, len(b.model.drive_names)
    force = np.abs(motion.multiplier[:drives] - b.full.multiplier[:drives]) + rest.force
    shift = float(np.linalg.norm(motion.x[:links] - b.full.x[:links], axis=1).max()) + rest.displacement
    between = np.einsum("kij,klj->kil", motion.R[:links], b.full.R[:links])
    turn = float(Rotation.from_matrix(between).magnitude().max()) + rest.rotation
    return _estimate(b, motion, force, shift, turn)


def joint_motions(
    b: Bench, motion: Motion
) -> tuple[dict[str, float], dict[str, np.ndarray], tuple[str, ...]]:
    """Intended motion of every joint [rad or m] at `motion` of the full model, what is left, and what is not known.

    Unintended: (6,) per joint, displacement [m] and rotation vector [rad] in the axes of interface A. Both are nan for
    a joint whose nearest intended motion was not found, or lies far outside its trained range; the last says so.
    """
    loops, joints = b.bodies.loops, len(b.bodies.loops.node)
    relative = np.empty((joints, 12))
    relative_poses(b.bodies.reduced, joints, motion.x, motion.R, relative)
    theta, place, off = b.theta.copy(), np.empty_like(b.place), np.zeros((joints, 6))
    found = np.zeros(joints, np.int64)
    intended_motions(loops, relative, theta, place, off, found)
    low, high = b.bodies.motion_range.T
    inside = np.abs(theta - 0.5 * (low + high)) <= FAR_OUT * (high - low)
    names, unknown = [p.name for p in b.model.scene.joints], []
    for j, name in enumerate(names):
        own = slice(loops.first[j], loops.first[j + 1])
        if found[j] == 0 or not np.all(inside[own]):
            theta[own], off[j] = math.nan, math.nan
            why = "lies far outside its trained range" if found[j] else "was not found"
            unknown.append(
                f"the intended motion of joint '{name}' is not known: the one nearest to its pose {why}"
            )
    motions = dict(zip(b.bodies.motion_names, (theta * b.bodies.motion_scale).tolist(), strict=True))
    return motions, {n: off[j] for j, n in enumerate(names)}, tuple(unknown)
